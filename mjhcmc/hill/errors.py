"""The one exception of the Hill model, which stands apart from the package's own tree."""


class HillError(ValueError):
    """Input that no Hill muscle can answer to; one line that names the muscle and the value."""

"""Logging through the standard library: silent unless the user asks for it.

Every module logs under ``mjhcmc`` by its own name (``mjhcmc.model``, ``mjhcmc.io.tables``, ...): INFO tells what was
read, solved and written, DEBUG gives details. mjhcmc installs no handler that prints and changes no level. To see the
records::

    import logging

    logging.basicConfig(level="INFO")  # or "DEBUG"

or of one part alone, ``logging.getLogger("mjhcmc.model").setLevel("DEBUG")`` after it. What the user should act on is
no log record but an `MjhcmcWarning`.
"""

import logging

logging.getLogger("mjhcmc").addHandler(logging.NullHandler())


def get_logger(module: str) -> logging.Logger:
    """The logger of a module of mjhcmc; call it with ``__name__``."""
    return logging.getLogger(module)

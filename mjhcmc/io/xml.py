"""Reading XML that anybody may have written."""

from xml.etree import ElementTree


class NoDoctype(ElementTree.TreeBuilder):
    """Refuses document types: only they can define entities, which may unfold without end."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Called where the document declares a type."""
        raise ValueError("declares a document type")

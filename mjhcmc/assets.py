"""Where the files that mjhcmc ships are: inside the package when installed, in the repository root when editable."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent
_FOLDERS = (_PACKAGE / "assets", _PACKAGE.parent / "assets")


def model_path(name: str) -> Path | None:
    """The shipped MJCF file of that name, or None where there is none.

    Args:
        name: a shipped model's name, for example ``"leg8"``.
    """
    for folder in _FOLDERS:
        path = folder / f"{name}.xml"
        if path.is_file():
            return path
    return None


def model_names() -> tuple[str, ...]:
    """The names of the shipped models, sorted."""
    return tuple(sorted({path.stem for folder in _FOLDERS for path in folder.glob("*.xml")}))

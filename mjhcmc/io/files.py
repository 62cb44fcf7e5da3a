"""Writing a file whole or not at all, into a folder that is known to take it."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from mjhcmc.errors import OutputError


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a temporary name beside path, and rename it to path when the block ends without an error.

    The temporary name keeps the suffix, since writers choose their format by it.

    Raises:
        OutputError: the folder is missing or cannot be written.
    """
    temporary = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        if not path.parent.is_dir():
            raise OutputError(f"{path}: cannot be written, there is no folder {path.parent}: create it first")
        if path.exists() and not path.is_file():  # a rename would put a file in place of a device
            what = "a folder" if path.is_dir() else "no ordinary file"
            raise OutputError(f"{path}: cannot be written, it is {what}: choose another name")
        yield temporary
        temporary.replace(path)
    except OSError as error:
        why = error.strerror or " ".join(str(error).split())
        raise OutputError(f"{path}: cannot be written ({why}): choose a folder that you may write to") from error
    finally:
        with suppress(OSError):  # never written, or its folder is none: the error above is the one to tell
            temporary.unlink()


def write_csv(frame: Any, path: Path) -> Path:
    """Write a pandas DataFrame without its index, whole or not at all; returns the path.

    Raises:
        OutputError: as `written_whole`.
    """
    text = frame.to_csv(index=False, lineterminator="\n")
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


@contextmanager
def output_folder(path: Path) -> Iterator[Path]:
    """Make the folder and see that it can be written, before the work; take it away again if the work fails.

    Raises:
        OutputError: it cannot be written.
    """
    made: list[Path] = []
    try:
        made = [folder for folder in (path, *path.parents) if not folder.exists()]
        path.mkdir(parents=True, exist_ok=True)
        probe = path / ".mjhcmc-probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        _remove(made)
        raise OutputError(
            f"{path}: the output folder cannot be written ({error.strerror}): choose another --out"
        ) from error
    try:
        yield path
    except BaseException:
        _remove(made)
        raise


def _remove(folders: list[Path]) -> None:
    """Remove folders that are there and empty, innermost first."""
    for folder in folders:
        with suppress(OSError):  # never made, or not empty
            folder.rmdir()

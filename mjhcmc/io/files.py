"""Writing a file whole or not at all."""

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

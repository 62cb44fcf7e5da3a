"""Writing a file whole or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}): choose a folder that you may write to"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)

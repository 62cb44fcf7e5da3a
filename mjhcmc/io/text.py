"""Text files as lines, and words as numbers, with messages that say what to do."""

from pathlib import Path

from mjhcmc.errors import MotionError


def read_lines(path: Path, what: str) -> list[str]:
    """The lines of a text file, numbered as an editor numbers them; a byte order mark is dropped.

    Args:
        path: the file.
        what: what it should hold, for messages, such as "an OpenSim table".

    Raises:
        MotionError: the file is missing, a folder, not to be read, empty, or not text.
    """
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        raise MotionError(f"{path}: no such file: check the path") from None
    except IsADirectoryError:
        raise MotionError(f"{path}: is a folder: name a file in it") from None
    except OSError as error:
        raise MotionError(f"{path}: cannot be read ({error.strerror}): check its permissions") from error
    if not raw.strip():
        raise MotionError(f"{path}: the file is empty: write it again")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MotionError(
            f"{path}: not a text file (byte {error.start} is not UTF-8): give {what} saved as plain text"
        ) from None
    if "\0" in text:
        raise MotionError(f"{path}: not a text file (byte 0 at {text.index(chr(0))}): give {what} saved as plain text")
    # Not str.splitlines, which also breaks at form feeds and others, so that line numbers would differ from
    # an editor's.
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def number(word: str) -> float:
    """The number that a word writes.

    Raises:
        ValueError: it writes none.
    """
    if "_" in word:  # Python takes 1_000 for a number; nobody else does
        raise ValueError(word)
    return float(word)


def is_number(word: str) -> bool:
    """Whether a word writes a number."""
    try:
        number(word)
    except ValueError:
        return False
    return True

"""What is left of an OpenSim table that something damaged: its header overwritten, its end followed by garbage."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MjhcmcWarning, MotionError
from mjhcmc.io.motion_table import look_up
from mjhcmc.io.text import is_number, read_lines

_PATH = "/jointset/"  # how the first state of an OpenSim model begins
_KEYS = ("version", "nrows", "ncolumns", "indegrees", "datarows", "datacolumns")


def read_sound_lines(path: Path, what: str) -> list[str]:
    """The lines of a text file, without bytes after its header's end that are no text, such as a tail of zeros.

    Raises:
        MotionError: as `mjhcmc.io.text.read_lines`, also where rows follow such bytes.
    """
    try:
        return read_lines(path, what)
    except MotionError:
        found = _before_garbage(path)
        if found is None:
            raise
    text, at = found
    warnings.warn(f"{path}: no text from byte {at} on: what follows is dropped", MjhcmcWarning, stacklevel=4)
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _before_garbage(path: Path) -> tuple[str, int] | None:
    """The whole lines before the first byte that is no text, and where it is; None where rows come after it."""
    try:
        raw = path.read_bytes()
    except OSError:
        return None
    zero = raw.find(b"\0")
    at = len(raw) if zero < 0 else zero
    try:
        raw[:at].decode("utf-8-sig")
    except UnicodeDecodeError as error:
        at = error.start
    whole = max(raw.rfind(b"\n", 0, at), raw.rfind(b"\r", 0, at)) + 1
    rest = raw[at:].decode("latin-1").replace("\0", " ").splitlines()
    has_rows = any(len(line.split()) > 1 and all(map(is_number, line.split())) for line in rest)
    if at == len(raw) or has_rows or b"endheader" not in raw[:whole].lower():
        return None
    return raw[:whole].decode("utf-8-sig"), at


def labels_without_endheader(path: Path, lines: list[str], split_labels: Callable[[str], list[str]]) -> int | None:
    """Index of the column names of a table that has lost its line ``endheader``, with a warning; None: there are none.

    They are the first line with ``time`` below a header's keys and above a row of as many numbers.
    """
    keyed = False
    for i, line in enumerate(lines):
        keyed = keyed or any(word.lower() in _KEYS for word in line.replace("=", " ").split()[:1])
        labels = split_labels(line)
        if not keyed or len(labels) < 2 or "time" not in (label.lower() for label in labels):
            continue
        row = next((below.split() for below in lines[i + 1 :] if below.strip()), [])
        if len(row) == len(labels) and all(map(is_number, row)):
            warnings.warn(
                f"{path}: no line 'endheader': line {i + 1} is taken for the column names", MjhcmcWarning, stacklevel=4
            )
            return i
    return None


def uncovered_labels(lines: list[str], at: int, split_labels: Callable[[str], list[str]]) -> tuple[int, list[str]]:
    """Index of the line of column names, and the names, also where CMC wrote an empty table's header over them.

    That header ends in a line ``time`` of its own, after which comes what it left of the true line: it may have lost
    ``time`` and the beginning of its first name.

    Args:
        lines: of the file.
        at: index of what seems to be the line of column names.
        split_labels: from such a line to the names.
    """
    labels = split_labels(lines[at])
    after = [(i, line.split()) for i, line in enumerate(lines[at + 1 : at + 20], at + 1) if line.strip()]
    words = [k for k, (_, row) in enumerate(after) if not all(map(is_number, row))]
    # garbage below the rows is no line of names
    first = next((k for k, (_, row) in enumerate(after) if len(row) > 1 and all(map(is_number, row))), len(after))
    words = [k for k in words if k < first]
    if labels != ["time"] or not words or words[-1] + 1 == len(after):
        return at, labels
    before, row = after[words[-1]][0], after[words[-1] + 1][1]  # the last line of words, and the first of numbers
    left = split_labels(lines[before])
    if len(row) - len(left) not in (0, 1):
        return at, labels
    if len(row) == len(left):
        return (before, ["time", *left[1:]]) if "time".endswith(left[0]) else (at, labels)
    lost = next((cut for cut in range(len(_PATH)) if left[0].startswith(_PATH[cut:])), 0)
    return before, ["time", _PATH[:lost] + left[0], *left[1:]]


def without_garbage(
    path: Path, header: dict[str, str], n_column: int, rows: list[list[str]], lines: NDArray[np.int64]
) -> int:
    """How many rows stand before garbage at the file's end, with a warning where there is some.

    Where the header says how many rows there are, and they are there, all below is garbage. Else (CMC's damaged header
    says none) only lines that do not begin with a number: a row that is cut off is not garbage, but an error.

    Args:
        path: the file, for messages.
        header: its keys and values.
        n_column: how many words a row has.
        rows: the words of all lines below the column names.
        lines: (T,) the line of the file each stands on.
    """
    n = len(rows)
    while n and (len(rows[n - 1]) != n_column or not all(map(is_number, rows[n - 1]))):
        n -= 1
    tail = rows[n:]
    if not tail or not n:
        return len(rows)
    entry = look_up(header, "nrows", "datarows", "numframes")
    said = int(entry[1]) if entry is not None and entry[1].isdecimal() else 0
    if n < said or (said == 0 and any(is_number(row[0]) for row in tail)):
        return len(rows)
    warnings.warn(
        f"{path}, line {lines[n]}: {len(tail)} line{'s' * (len(tail) > 1)} after the last row that "
        f"{'are' if len(tail) > 1 else 'is'} no row, beginning {' '.join(tail[0])[:30]!r}: dropped",
        MjhcmcWarning,
        stacklevel=3,
    )
    return n

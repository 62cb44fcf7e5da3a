"""MotionTable: named columns over time as a file holds them, and the checks that every kind of file shares."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MjhcmcWarning, MotionError
from mjhcmc.io.text import is_number, number


@dataclass(frozen=True, eq=False)
class MotionTable:
    """The content of one .mot, .sto or .csv file, in the file's own units.

    Attributes:
        path: the file read.
        name: the table's name (the first line of an OpenSim file), empty where the file has none.
        in_degrees: what the header says of its angles, None where it says nothing.
        header: the header's keys and values as written.
        columns: names of all columns but time, in the file's order, without a unit written behind them.
        time: (T,) s, as written: not checked for NaN or order.
        values: (T, n_columns), as written: not checked for NaN.
        line_numbers: (T,) the line of the file each row stands on, from 1, for messages.
        units: unit that each column's name gives ("deg", "rad", "m", "mm"), None where it gives none.
    """

    path: Path
    name: str
    in_degrees: bool | None
    header: dict[str, str]
    columns: tuple[str, ...]
    time: NDArray[np.float64] = field(repr=False)
    values: NDArray[np.float64] = field(repr=False)
    line_numbers: NDArray[np.int64] = field(repr=False)
    units: tuple[str | None, ...]

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for array in (self.time, self.values, self.line_numbers):
            array.setflags(write=False)


def look_up(header: dict[str, str], *keys: str) -> tuple[str, str] | None:
    """The first entry of the header with one of these keys (in small letters), whatever its case."""
    return next(((key, value) for key, value in header.items() if key.lower() in keys), None)


def parse_in_degrees(path: Path, header: dict[str, str]) -> bool | None:
    """What the header's inDegrees says, None where it is not there; MotionError where it is neither yes nor no."""
    found = look_up(header, "indegrees")
    if found is None:
        return None
    value = found[1].lower()
    if value not in ("yes", "no", "true", "false"):
        raise MotionError(f"{path}: header line {found[0]}={found[1]}: write inDegrees=yes or inDegrees=no")
    return value in ("yes", "true")


def check_labels(path: Path, line: int, labels: Sequence[str]) -> None:
    """Raise MotionError where a column name stands twice."""
    seen: dict[str, int] = {}
    for i, label in enumerate(labels, 1):
        key = "time" if label.lower() == "time" else label
        if key in seen:
            raise MotionError(
                f"{path}, line {line}: column name {label!r} stands twice (columns {seen[key]} and {i}): "
                "rename or remove one"
            )
        seen[key] = i


def check_counts(
    path: Path, header: dict[str, str], labels: Sequence[str], rows: list[list[str]], lines: NDArray[np.int64]
) -> None:
    """Raise MotionError unless rows have the right length and are as many as the header says."""
    if not rows:
        raise MotionError(f"{path}: no rows after the column names: the file is cut off, write it again")
    for i, row in enumerate(rows):
        if len(row) != len(labels):
            last = i == len(rows) - 1 and len(row) < len(labels)
            remedy = "the file is cut off, write it again" if last else "correct the row or write the file again"
            raise MotionError(
                f"{path}, line {lines[i]}: {len(row)} value{'s' * (len(row) != 1)} where the column line "
                f"names {len(labels)}: {remedy}"
            )
    for what, keys, found in (
        ("rows", ("nrows", "datarows", "numframes"), len(rows)),
        ("columns", ("ncolumns", "datacolumns"), len(labels)),
    ):
        entry = look_up(header, *keys)
        if entry is None:
            continue
        if not entry[1].isdecimal():
            raise MotionError(
                f"{path}: header line {entry[0]}={entry[1]}: write the number of {what}, or delete the line"
            )
        said = int(entry[1])
        if what == "rows" and found < said:
            raise MotionError(
                f"{path}: cut off: the header says {entry[0]}={said}, the file ends at line {lines[-1]} "
                f"after {found} rows: write it again"
            )
        if found != said:
            warnings.warn(
                f"{path}: the header says {entry[0]}={said}, the file has {found} {what}: all {found} are read",
                MjhcmcWarning,
                stacklevel=3,
            )


def parse_rows(
    path: Path, labels: Sequence[str], rows: list[list[str]], lines: NDArray[np.int64], hint: str = ""
) -> NDArray[np.float64]:
    """(T, n_labels) the rows as numbers; MotionError names the line and column of a word that is none."""
    shape = len(rows), len(labels)
    words = list(chain.from_iterable(rows))
    try:
        numbers = np.fromiter(map(number, words), dtype=np.float64, count=len(words))
    except ValueError:
        at = next(i for i, word in enumerate(words) if not is_number(word))
        raise MotionError(
            f"{path}, line {lines[at // shape[1]]}, column {labels[at % shape[1]]!r}: {words[at]!r} is not "
            f"a number: {hint}correct it or write the file again"
        ) from None
    return numbers.reshape(shape)

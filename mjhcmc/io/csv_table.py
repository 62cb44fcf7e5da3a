"""Tables of joint positions as .csv: comments, a row of column names among them time, rows of numbers."""

import os
from pathlib import Path

import numpy as np

from mjhcmc.errors import MotionError
from mjhcmc.io.columns import listed, split_cells
from mjhcmc.io.motion_table import MotionTable, check_counts, check_labels, parse_in_degrees, parse_rows
from mjhcmc.io.text import read_lines
from mjhcmc.io.units import WITH_UNIT, split_unit

SUFFIXES = (".csv",)

_SECONDS = ("s", "sec", "second", "seconds")


def read_csv(path: str | os.PathLike[str]) -> MotionTable:
    """Read a table from a .csv file.

    The first line that is neither blank nor a comment (#) names the columns; commas, semicolons or tabs separate
    them, whichever leave a column ``time`` (any case, ``time (s)`` too). A name may end in a unit, ``hip (deg)``
    or ``hip [rad]``. Comments such as ``# inDegrees=yes`` are the header, as in an OpenSim table. An empty cell
    is NaN, a column without a name (an index that pandas wrote) is passed over. Byte order marks, Windows line
    ends, blank lines and separators at line ends are survived.

    Args:
        path: the file (the suffix is not looked at).

    Returns:
        The table, in the file's units; NaN and the order of the times are the caller's to check.

    Raises:
        MotionError: the file cannot be read or decoded, its columns cannot be understood, or a row has too many
            or too few values or something that is no number.
    """
    path = Path(path)
    lines = read_lines(path, "a table of numbers")
    content = [(i, line) for i, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    header: dict[str, str] = {}
    for line in lines:
        key, equals, value = line.strip().lstrip("#").partition("=")
        if equals and line.lstrip().startswith("#"):
            header[key.strip()] = value.strip().rstrip(",;").rstrip()
    if not content:
        raise MotionError(f"{path}: nothing but comments: a line of column names and rows must follow")
    at, line = content[0]
    delimiter, written = _column_names(path, at, line, any(row.strip().lower() == "endheader" for _, row in content))
    labels, units = zip(*map(split_unit, written), strict=True)
    check_labels(path, at, [label or f"\0{i}" for i, label in enumerate(labels)])

    rows, numbers = [], []
    for i, line in content[1:]:
        cells = [cell.strip() for cell in split_cells(path, i, line, delimiter)]
        if not any(cells):
            continue
        while len(cells) > len(labels) and not cells[-1]:
            cells.pop()
        rows.append([cell or "nan" for cell in cells])
        numbers.append(i)
    line_numbers = np.array(numbers, dtype=np.int64)
    check_counts(path, header, labels, rows, line_numbers)
    named = [i for i, label in enumerate(labels) if label]
    hint = "" if delimiter == "," else "numbers take a point, not a comma: "
    table = parse_rows(path, [labels[i] for i in named], [[row[i] for i in named] for row in rows], line_numbers, hint)

    time_at = next(i for i, column in enumerate(named) if labels[column].lower() == "time")
    others = [column for column in named if labels[column].lower() != "time"]
    return MotionTable(
        path=path,
        name="",
        in_degrees=parse_in_degrees(path, header),
        header=header,
        columns=tuple(labels[i] for i in others),
        time=np.ascontiguousarray(table[:, time_at]),
        values=np.delete(table, time_at, axis=1),
        line_numbers=line_numbers,
        units=tuple(units[i] for i in others),
    )


def _column_names(path: Path, at: int, line: str, opensim: bool) -> tuple[str, list[str]]:
    """What separates the columns, and their names as written, without empty ones at the end."""
    split = {mark: [cell.strip() for cell in split_cells(path, at, line, mark)] for mark in ",;\t"}
    timed = [mark for mark, names in split.items() if any(_is_time(path, at, name) for name in names)]
    if not timed:
        names = [name for name in max(split.values(), key=len) if name]
        remedy = "give it the suffix .mot or .sto, it is an OpenSim table" if opensim else "name the time column 'time'"
        raise MotionError(f"{path}, line {at}: no column 'time' among {listed(names)}: {remedy}")
    delimiter = max(timed, key=lambda mark: len(split[mark]))
    names = split[delimiter]
    while not names[-1]:
        names.pop()
    return delimiter, names


def _is_time(path: Path, at: int, name: str) -> bool:
    found = WITH_UNIT.fullmatch(name)
    if (found["name"] if found else name).lower() != "time":
        return False
    if found and found["unit"].lower() not in _SECONDS:
        raise MotionError(f"{path}, line {at}: column {name!r}: give time in s, as 'time' or 'time (s)'")
    return True

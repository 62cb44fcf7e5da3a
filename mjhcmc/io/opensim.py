"""OpenSim tables (.mot and .sto): read and written without OpenSim.

Such a file is a header (its first line a name, then ``key=value`` lines, among them nRows, nColumns and
inDegrees, up to a line ``endheader``), a line of column names, and rows of numbers.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from mjhcmc.errors import MotionError, OutputError
from mjhcmc.io.files import written_whole
from mjhcmc.io.motion_table import MotionTable, check_counts, check_labels, parse_in_degrees, parse_rows
from mjhcmc.io.text import is_number, read_lines

SUFFIXES = (".mot", ".sto")

_PATH = "/jointset/"  # how the first state of an OpenSim model begins


def read_table(path: str | os.PathLike[str]) -> MotionTable:
    """Read an OpenSim table: version 1 and later, and the older SIMM headers (datarows, datacolumns).

    The time column may stand anywhere. Byte order marks, Windows line ends, blank lines, files without nRows,
    and the headers that OpenSim's CMC overwrites at its end (nRows=0, then a second ``endheader`` or what is left of
    the column names) are survived.

    Args:
        path: a .mot or .sto file (the suffix is not looked at).

    Returns:
        The table, in the file's units; NaN and the order of the times are the caller's to check.

    Raises:
        MotionError: the file cannot be read or decoded, its header or columns cannot be understood, a row has
            too many or too few values or something that is no number, or rows are missing.
    """
    path = Path(path)
    lines = read_lines(path, "an OpenSim table")
    end, labels_at = _find_column_line(path, lines)
    name, header = _parse_header(lines[:end])
    labels_at, labels = _uncovered_labels(lines, labels_at)
    check_labels(path, labels_at + 1, labels)

    numbered = [(i, line) for i, line in enumerate(lines[labels_at + 1 :], labels_at + 2) if line.strip()]
    rows = [line.split() for _, line in numbered]
    line_numbers = np.array([i for i, _ in numbered], dtype=np.int64)
    check_counts(path, header, labels, rows, line_numbers)
    table = parse_rows(path, labels, rows, line_numbers)

    time_at = [label.lower() for label in labels].index("time")
    time = np.ascontiguousarray(table[:, time_at])
    values = np.delete(table, time_at, axis=1)
    columns = tuple(label for i, label in enumerate(labels) if i != time_at)
    return MotionTable(
        path=path,
        name=name,
        in_degrees=parse_in_degrees(path, header),
        header=header,
        columns=columns,
        time=time,
        values=values,
        line_numbers=line_numbers,
        units=(None,) * len(columns),
    )


def write_table(
    path: str | os.PathLike[str],
    columns: Sequence[str],
    time: ArrayLike,
    values: ArrayLike,
    *,
    name: str,
    in_degrees: bool,
    extra: Mapping[str, str] | None = None,
) -> None:
    """Write a table that OpenSim reads; every number comes back bit for bit.

    NaN is written, and OpenSim's TimeSeriesTable reads it. Its older reader (Storage, behind the controllers, the
    tools and the plots) does not: it loses count within such a row; nor does it take names with blanks inside. What
    is meant for those has neither.

    Args:
        path: the file; a file of that name is replaced, at once and only when all is written.
        columns: names of the columns without time.
        time: (T,) s.
        values: (T, n_columns), in the units that in_degrees says.
        name: the table's name, its first line.
        in_degrees: what the header is to say of the angles; nothing is converted.
        extra: more header lines, key=value; OpenSim passes over keys that it does not know.

    Raises:
        OutputError: the shapes or names do not fit, or the file cannot be written.
    """
    path = Path(path)
    text = table_text(path, columns, time, values, name=name, in_degrees=in_degrees, extra=extra)
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def table_text(
    path: Path,
    columns: Sequence[str],
    time: ArrayLike,
    values: ArrayLike,
    *,
    name: str,
    in_degrees: bool,
    extra: Mapping[str, str] | None = None,
) -> str:
    """What `write_table` writes, for those who write several files together; the path is for messages only.

    Raises:
        OutputError: the shapes or names do not fit.
    """
    times = np.asarray(time, dtype=np.float64)
    table = np.asarray(values, dtype=np.float64)
    if times.ndim != 1 or table.shape != (times.size, len(columns)):
        raise OutputError(
            f"{path}: cannot write {len(columns)} columns with time {times.shape} and values {table.shape}: "
            f"give time (T,) and values (T, {len(columns)})"
        )
    labels = ["time", *columns]
    for label in labels:
        if label != label.strip() or not label or any(c in label for c in "\t\r\n"):
            raise OutputError(
                f"{path}: column name {label!r} cannot be written: it is empty, begins or ends with a blank, or has "
                "a tab or line end: rename it"
            )
        if labels.count(label) > 1 or label.lower() == "time" != label:
            raise OutputError(f"{path}: column {label!r} would be written twice: make the names differ")
    if "=" in name or any(c in name for c in "\r\n"):
        raise OutputError(f"{path}: table name {name!r} cannot be written: it has an equals sign or a line end")
    return "\n".join(
        [
            name,
            "version=1",
            f"nRows={times.size}",
            f"nColumns={len(labels)}",
            f"inDegrees={'yes' if in_degrees else 'no'}",
            *(f"{key}={value}" for key, value in (extra or {}).items()),
            "endheader",
            "\t".join(labels),
            *("\t".join(map(repr, row)) for row in np.column_stack([times, table]).tolist()),
            "",
        ]
    )


def _split_labels(line: str) -> list[str]:
    labels = line.split("\t") if "\t" in line else line.split()
    return [label.strip() for label in labels if label.strip()]


def _uncovered_labels(lines: list[str], at: int) -> tuple[int, list[str]]:
    """Index of the line of column names, and the names, also where CMC wrote an empty table's header over them.

    That header ends in a line ``time`` of its own, after which comes what it left of the true line: it may have lost
    ``time`` and the beginning of its first name.
    """
    labels = _split_labels(lines[at])
    after = [(i, line.split()) for i, line in enumerate(lines[at + 1 : at + 20], at + 1) if line.strip()]
    words = [k for k, (_, row) in enumerate(after) if not all(map(is_number, row))]
    if labels != ["time"] or not words or words[-1] + 1 == len(after):
        return at, labels
    before, row = after[words[-1]][0], after[words[-1] + 1][1]  # the last line of words, and the first of numbers
    left = _split_labels(lines[before])
    if len(row) - len(left) not in (0, 1):
        return at, labels
    if len(row) == len(left):
        return (before, ["time", *left[1:]]) if "time".endswith(left[0]) else (at, labels)
    lost = next((cut for cut in range(len(_PATH)) if left[0].startswith(_PATH[cut:])), 0)
    return before, ["time", _PATH[:lost] + left[0], *left[1:]]


def _find_column_line(path: Path, lines: list[str]) -> tuple[int, int]:
    """Index of the endheader that counts, and of the column names: the first pair that has a time column."""
    ends = [i for i, line in enumerate(lines) if line.strip().lower() == "endheader"]
    if not ends:
        raise MotionError(f"{path}: no line 'endheader': not an OpenSim table (.mot or .sto), or one cut off early")
    first = None
    for end in ends:
        labels_at = next((i for i in range(end + 1, len(lines)) if lines[i].strip()), None)
        if labels_at is None:
            break
        if any(label.lower() == "time" for label in _split_labels(lines[labels_at])):
            return end, labels_at
        first = first if first is not None else labels_at
    if first is None:
        raise MotionError(
            f"{path}: nothing follows 'endheader' (line {ends[0] + 1}): a line of column names and rows must"
        )
    labels = _split_labels(lines[first])
    raise MotionError(
        f"{path}, line {first + 1}: no column 'time' among {', '.join(labels[:12])}"
        f"{', ...' if len(labels) > 12 else ''}: name the time column 'time'"
    )


def _parse_header(lines: list[str]) -> tuple[str, dict[str, str]]:
    header: dict[str, str] = {}
    for line in lines:
        key, equals, value = line.strip().partition("=")
        if equals:
            header[key.strip()] = value.strip()
        elif len(words := line.split()) == 2 and words[0].lower() in ("datarows", "datacolumns"):
            header[words[0]] = words[1]
    name = lines[0].strip() if lines else ""
    if "=" in name:
        return "", header
    return (name[5:].strip() if name.lower().startswith("name ") else name), header

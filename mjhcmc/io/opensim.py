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
from mjhcmc.io.damaged import labels_without_endheader, read_sound_lines, uncovered_labels, without_garbage
from mjhcmc.io.files import written_whole
from mjhcmc.io.motion_table import MotionTable, check_counts, check_labels, look_up, parse_in_degrees, parse_rows

SUFFIXES = (".mot", ".sto")

_OWN_KEYS = ("version", "nrows", "ncolumns", "indegrees", "datarows", "datacolumns", "numframes")


def read_table(path: str | os.PathLike[str]) -> MotionTable:
    """Read an OpenSim table: version 1 and later, and the older SIMM headers (datarows, datacolumns).

    The time column may stand anywhere. Byte order marks, Windows line ends, blank lines and files without nRows are
    read. Survived with a warning are the headers that OpenSim's CMC overwrites at its end (nRows=0, then a second
    ``endheader`` or what is left of the column names), a lost ``endheader``, and garbage below the last row (see
    `mjhcmc.io.damaged`).

    Args:
        path: a .mot or .sto file (the suffix is not looked at).

    Returns:
        The table, in the file's units; NaN and the order of the times are the caller's to check.

    Raises:
        MotionError: the file cannot be read or decoded, its header or columns cannot be understood or hold vectors
            (DataType), a row has too many or too few values or something that is no number, or rows are missing.
    """
    path = Path(path)
    lines = read_sound_lines(path, "an OpenSim table")
    end, labels_at = _find_column_line(path, lines)
    name, header = _parse_header(lines[:end])
    kind = look_up(header, "datatype")
    if kind is not None and kind[1].lower() != "double":
        raise MotionError(
            f"{path}: header line {kind[0]}={kind[1]}: only tables of numbers are read: flatten it (OpenSim: "
            "table.flatten()) and write it again"
        )
    labels_at, labels = uncovered_labels(lines, labels_at, _split_labels)
    check_labels(path, labels_at + 1, labels)

    numbered = [(i, line) for i, line in enumerate(lines[labels_at + 1 :], labels_at + 2) if line.strip()]
    rows = [line.split() for _, line in numbered]
    line_numbers = np.array([i for i, _ in numbered], dtype=np.int64)
    n = without_garbage(path, header, len(labels), rows, line_numbers)
    rows, line_numbers = rows[:n], line_numbers[:n]
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
    in_degrees: bool | None,
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
        in_degrees: what the header is to say of the angles, None: nothing; nothing is converted.
        extra: more header lines, key=value; OpenSim passes over keys that it does not know.

    Raises:
        OutputError: the shapes, names or header lines do not fit, there are no rows, or the file cannot be written.
    """
    path = Path(path)
    text = table_text(path, columns, time, values, name=name, in_degrees=in_degrees, extra=extra)
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def rewrite_table(path: str | os.PathLike[str], table: MotionTable) -> None:
    """Write a table as it was read: name, header keys, column names, unit of the angles and every number.

    What is not kept: lines of the header that are no ``key=value``, and the places of time, which comes first, and
    of nRows, nColumns, inDegrees and version, which come before other keys.

    Raises:
        OutputError: the table is a .csv's with units written behind its names, or as `write_table`.
    """
    if any(unit is not None for unit in table.units):
        raise OutputError(
            f"{path}: cannot be written: columns of {table.path} have units of their own, an OpenSim table has one "
            "for all: convert them, and use write_table"
        )
    extra = {key: value for key, value in table.header.items() if key and key.lower() not in _OWN_KEYS}
    write_table(
        path, table.columns, table.time, table.values, name=table.name, in_degrees=table.in_degrees, extra=extra
    )


def table_text(
    path: Path,
    columns: Sequence[str],
    time: ArrayLike,
    values: ArrayLike,
    *,
    name: str,
    in_degrees: bool | None,
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
        if label != label.strip() or not label or _has_breaks(label) or "\t" in label:
            raise OutputError(
                f"{path}: column name {label!r} cannot be written: it is empty, begins or ends with a blank, or has "
                "a tab or line end: rename it"
            )
        if labels.count(label) > 1 or label.lower() == "time" != label:
            raise OutputError(f"{path}: column {label!r} would be written twice: make the names differ")
    if not times.size:
        raise OutputError(f"{path}: cannot write a table without rows: give at least one")
    header = {"version": "1", "nRows": str(times.size), "nColumns": str(len(labels))}
    if in_degrees is not None:
        header["inDegrees"] = "yes" if in_degrees else "no"
    for key, value in (extra or {}).items():
        if key.lower() in _OWN_KEYS:
            raise OutputError(
                f"{path}: header line {key}={value} cannot be written: the table says it itself: leave it"
            )
        header[key] = value
    above = [name, *(f"{key}={value}" for key, value in header.items())]
    if "=" in name or _has_breaks(name) or _parse_header([name]) != (name, {}) or name.lower() == "endheader":
        raise OutputError(
            f"{path}: table name {name!r} cannot be written: it has an equals sign or a line end, begins or ends with "
            "a blank, or reads as a header line: rename the table"
        )
    for key, value in header.items():
        if not key or _has_breaks(key + value) or _parse_header(["", f"{key}={value}"]) != ("", {key: value}):
            raise OutputError(
                f"{path}: header line {key!r}={value!r} cannot be written: keys hold no equals sign and are not "
                "empty, and neither has a line end or begins or ends with a blank: correct it"
            )
    return "\n".join(
        [
            *above,
            "endheader",
            "\t".join(labels),
            *("\t".join(map(repr, row)) for row in np.column_stack([times, table]).tolist()),
            "",
        ]
    )


def _has_breaks(text: str) -> bool:
    """Whether a text would not stay on its line, or make the file no text."""
    return any(c in text for c in "\r\n\0")


def _split_labels(line: str) -> list[str]:
    labels = line.split("\t") if "\t" in line else line.split()
    return [label.strip() for label in labels if label.strip()]


def _find_column_line(path: Path, lines: list[str]) -> tuple[int, int]:
    """Index of the header's end, and of the column names: the first endheader whose columns have a time."""
    ends = [i for i, line in enumerate(lines) if line.strip().lower() == "endheader"]
    if not ends:
        at = labels_without_endheader(path, lines, _split_labels)
        if at is not None:
            return at, at
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

"""OpenSim tables (.mot and .sto): read and written without OpenSim.

Such a file is a header (its first line a name, then ``key=value`` lines, among them nRows, nColumns and
inDegrees, up to a line ``endheader``), a line of column names, and rows of numbers.
"""

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import MjhcmcWarning, MotionError, OutputError
from mjhcmc.io.files import written_whole

SUFFIXES = (".mot", ".sto")


@dataclass(frozen=True, eq=False)
class OpenSimTable:
    """The content of one .mot or .sto file, in the file's own units.

    Attributes:
        path: the file read.
        name: the table's name (the first line), empty where the file has none.
        in_degrees: what the header says of its angles, None where it says nothing.
        header: the header's keys and values as written.
        columns: names of all columns but time, in the file's order.
        time: (T,) s, as written: not checked for NaN or order.
        values: (T, n_columns), as written: not checked for NaN.
        line_numbers: (T,) the line of the file each row stands on, from 1, for messages.
    """

    path: Path
    name: str
    in_degrees: bool | None
    header: dict[str, str]
    columns: tuple[str, ...]
    time: NDArray[np.float64] = field(repr=False)
    values: NDArray[np.float64] = field(repr=False)
    line_numbers: NDArray[np.int64] = field(repr=False)


def read_table(path: str | os.PathLike[str]) -> OpenSimTable:
    """Read an OpenSim table: version 1 and later, and the older SIMM headers (datarows, datacolumns).

    The time column may stand anywhere. Byte order marks, Windows line ends, blank lines, files without nRows,
    and the headers that OpenSim's CMC overwrites at its end (a second ``endheader``, nRows=0) are survived.

    Args:
        path: a .mot or .sto file (the suffix is not looked at).

    Returns:
        The table, in the file's units; NaN and the order of the times are the caller's to check.

    Raises:
        MotionError: the file cannot be read or decoded, its header or columns cannot be understood, a row has
            too many or too few values or something that is no number, or rows are missing.
    """
    path = Path(path)
    lines = _read_lines(path)
    end, labels_at = _find_column_line(path, lines)
    name, header = _parse_header(lines[:end])
    labels = _split_labels(lines[labels_at])
    _check_labels(path, labels_at + 1, labels)

    numbered = [(i, line) for i, line in enumerate(lines[labels_at + 1 :], labels_at + 2) if line.strip()]
    rows = [line.split() for _, line in numbered]
    line_numbers = np.array([i for i, _ in numbered], dtype=np.int64)
    _check_counts(path, header, labels, rows, line_numbers)
    table = _parse_rows(path, labels, rows, line_numbers)

    time_at = [label.lower() for label in labels].index("time")
    time = np.ascontiguousarray(table[:, time_at])
    values = np.delete(table, time_at, axis=1)
    for array in (time, values, line_numbers):
        array.setflags(write=False)
    return OpenSimTable(
        path=path,
        name=name,
        in_degrees=_parse_in_degrees(path, header),
        header=header,
        columns=tuple(label for i, label in enumerate(labels) if i != time_at),
        time=time,
        values=values,
        line_numbers=line_numbers,
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
    text = "\n".join(
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
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def _read_lines(path: Path) -> list[str]:
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
            f"{path}: not a text file (byte {error.start} is not UTF-8): give an OpenSim table saved as plain text"
        ) from None
    if "\0" in text:
        raise MotionError(
            f"{path}: not a text file (byte 0 at {text.index(chr(0))}): give an OpenSim table saved as plain text"
        )
    # Not str.splitlines, which also breaks at form feeds and others, so that line numbers would differ from
    # an editor's.
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _split_labels(line: str) -> list[str]:
    labels = line.split("\t") if "\t" in line else line.split()
    return [label.strip() for label in labels if label.strip()]


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


def _look_up(header: dict[str, str], *keys: str) -> tuple[str, str] | None:
    """The first entry of the header with one of these keys (in small letters), whatever its case."""
    return next(((key, value) for key, value in header.items() if key.lower() in keys), None)


def _parse_in_degrees(path: Path, header: dict[str, str]) -> bool | None:
    found = _look_up(header, "indegrees")
    if found is None:
        return None
    value = found[1].lower()
    if value not in ("yes", "no", "true", "false"):
        raise MotionError(f"{path}: header line {found[0]}={found[1]}: write inDegrees=yes or inDegrees=no")
    return value in ("yes", "true")


def _check_labels(path: Path, line: int, labels: list[str]) -> None:
    seen: dict[str, int] = {}
    for i, label in enumerate(labels, 1):
        key = "time" if label.lower() == "time" else label
        if key in seen:
            raise MotionError(
                f"{path}, line {line}: column name {label!r} stands twice (columns {seen[key]} and {i}): "
                "rename or remove one"
            )
        seen[key] = i


def _check_counts(
    path: Path, header: dict[str, str], labels: list[str], rows: list[list[str]], lines: NDArray[np.int64]
) -> None:
    """Rows of the right length, and as many rows and columns as the header says."""
    if not rows:
        raise MotionError(f"{path}: no rows after the column names: the file is cut off, write it again")
    for i, row in enumerate(rows):
        if len(row) != len(labels):
            last = i == len(rows) - 1 and len(row) < len(labels)
            remedy = "the file is cut off, write it again" if last else "correct the row or write the file again"
            raise MotionError(
                f"{path}, line {lines[i]}: {len(row)} value{'s' * (len(row) != 1)} where the column line "
                f"names "
                f"{len(labels)}: {remedy}"
            )
    for what, keys, found in (
        ("rows", ("nrows", "datarows"), len(rows)),
        ("columns", ("ncolumns", "datacolumns"), len(labels)),
    ):
        entry = _look_up(header, *keys)
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
                f"after {found} "
                "rows: write it again"
            )
        if found != said:
            warnings.warn(
                f"{path}: the header says {entry[0]}={said}, the file has {found} {what}: all {found} are read",
                MjhcmcWarning,
                stacklevel=3,
            )


def _parse_rows(path: Path, labels: list[str], rows: list[list[str]], lines: NDArray[np.int64]) -> NDArray[np.float64]:
    shape = len(rows), len(labels)
    words = list(chain.from_iterable(rows))
    try:
        numbers = np.fromiter(map(_number, words), dtype=np.float64, count=len(words))
    except ValueError:
        at = next(i for i, word in enumerate(words) if not _is_number(word))
        raise MotionError(
            f"{path}, line {lines[at // shape[1]]}, column {labels[at % shape[1]]!r}: {words[at]!r} is not "
            f"a number: "
            "correct it or write the file again"
        ) from None
    return numbers.reshape(shape)


def _number(word: str) -> float:
    if "_" in word:  # Python takes 1_000 for a number; nobody else does
        raise ValueError(word)
    return float(word)


def _is_number(word: str) -> bool:
    try:
        _number(word)
    except ValueError:
        return False
    return True

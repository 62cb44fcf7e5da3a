"""Marker files (.trc) of motion capture: read to metres, and written exactly.

Such a file names itself in its first line (``PathFileType``), gives keys (DataRate, NumFrames, NumMarkers, Units and
others) and below them their values, then the markers' names, one over each three columns, a line X1 Y1 Z1 X2 ..., and
a row a frame: its number, its time, and three coordinates a marker, empty where the marker was not seen.
"""

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import MjhcmcWarning, MotionError, OutputError
from mjhcmc.io.files import written_whole
from mjhcmc.io.motion_table import look_up
from mjhcmc.io.text import is_number, number, read_lines

Array = NDArray[np.float64]

SHIFTS = {"mm": -3, "cm": -2, "m": 0}
"""Unit of length to the power of ten that makes it metres."""

UNIT_NAMES = {
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), "cm"),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
}
"""What files call these units, in small letters."""

_RATE_TOLERANCE = 0.01  # of the rate that the header gives, against the times

_ORIGINAL = ("OrigDataRate", "OrigDataStartFrame", "OrigNumFrames")
_KEYS = ("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", *_ORIGINAL)  # OpenSim wants these and no other


@dataclass(frozen=True, eq=False)
class MarkerTable:
    """The markers of one file (.trc or .c3d), in metres.

    Attributes:
        path: the file read.
        names: (n,) the markers' names, in the file's order.
        time: (T,) s, as written: not checked for order.
        positions: (T, n, 3) m in the laboratory's frame; a marker that was not seen has three NaN.
        line_numbers: (T,) the line of the file each row stands on (of a .c3d: its frame), from 1, for messages.
        unit: of the file's own coordinates: "mm", "cm" or "m".
        header: the header's keys and values as written; empty for a .c3d.
        row_word: what line_numbers count, "line" or "frame".
    """

    path: Path
    names: tuple[str, ...]
    time: Array = field(repr=False)
    positions: Array = field(repr=False)
    line_numbers: NDArray[np.int64] = field(repr=False)
    unit: str = "mm"
    header: Mapping[str, str] = field(default_factory=dict)
    row_word: str = "line"

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for array in (self.time, self.positions, self.line_numbers):
            array.setflags(write=False)


def read_markers(path: str | os.PathLike[str]) -> MarkerTable:
    """Read markers from a .c3d file (see `mjhcmc.io.c3d.read_c3d`), or from any other as .trc (see `read_trc`).

    Raises:
        MotionError: the file cannot be used, or is a .c3d and the package that reads it is not installed.
    """
    if Path(path).suffix.lower() == ".c3d":
        from mjhcmc.io.c3d import read_c3d

        return read_c3d(path)
    return read_trc(path)


def read_trc(path: str | os.PathLike[str]) -> MarkerTable:
    """Read a marker file.

    Byte order marks, Windows line ends, blank lines, tabs at line ends, a missing line of coordinate names, and rows
    whose last markers were not seen and whose tabs an editor dropped are survived. Times are those of the rows.

    Args:
        path: a .trc file (the suffix is not looked at).

    Returns:
        The markers, in metres, whether the file holds mm, cm or m.

    Raises:
        MotionError: the file cannot be read or decoded, its header cannot be understood, names no unit, or names a
            marker twice, a row has the wrong length or something that is no number, or a marker only some of its
            coordinates, or rows are missing.
    """
    path = Path(path)
    lines = read_lines(path, "a marker file (.trc)")
    header, labels_at = _read_header(path, lines)
    unit = _unit(path, header)
    shift = SHIFTS[unit]
    names = _marker_names(path, labels_at + 1, lines[labels_at])
    content = [(i, line) for i, line in enumerate(lines[labels_at + 1 :], labels_at + 2) if line.strip()]
    if content and next(filter(None, _cells(content[0][1])))[0] in "Xx":
        at, line = content.pop(0)
        coordinates = len([cell for cell in _cells(line) if cell])
        if coordinates != 3 * len(names):
            raise MotionError(
                f"{path}, line {at}: {coordinates} coordinates for {len(names)} marker names in line {labels_at + 1}: "
                "name each marker once, over its X"
            )
    if not content:
        raise MotionError(f"{path}: no rows after the marker names: the file is cut off, write it again")
    rows = np.array([_row(path, at, line, names, shift, i == len(content) - 1) for i, (at, line) in enumerate(content)])
    line_numbers = np.array([at for at, _ in content], dtype=np.int64)
    positions = rows[:, 1:].reshape(len(rows), -1, 3)
    table = MarkerTable(path, names, rows[:, 0].copy(), positions, line_numbers, unit, header)
    _check_said(table, header)
    return table


def write_trc(
    path: str | os.PathLike[str],
    names: Sequence[str],
    time: ArrayLike,
    positions: ArrayLike,
    *,
    unit: str = "mm",
    header: Mapping[str, str] | None = None,
) -> None:
    """Write a marker file; every time and position comes back bit for bit.

    Args:
        path: the file; a file of that name is replaced, at once and only when all is written.
        names: (n,) the markers' names.
        time: (T,) s; DataRate is written from its median step.
        positions: (T, n, 3) m, three NaN where a marker was not seen.
        unit: of the file's coordinates, "mm", "cm" or "m".
        header: CameraRate, OrigDataRate, OrigDataStartFrame and OrigNumFrames, where they are not to follow from the
            times, and DataRate, which is taken where it fits them. Other keys are passed over: NumFrames, NumMarkers
            and Units follow from what is written, and OpenSim refuses files with more.

    Raises:
        OutputError: the shapes, names, values or header do not fit, an unknown unit, or the file cannot be written.
    """
    path = Path(path)
    times, points = np.asarray(time, dtype=np.float64), np.asarray(positions, dtype=np.float64)
    n = len(names)
    if unit not in SHIFTS:
        raise OutputError(f"{path}: unit {unit!r}: choose mm, cm or m")
    if times.ndim != 1 or points.shape != (len(times), n, 3) or not points.size:
        raise OutputError(
            f"{path}: cannot write {n} markers with time {times.shape} and positions {points.shape}: "
            f"give time (T,) and positions (T, {n}, 3)"
        )
    for name in names:
        if not name or name != name.strip() or any(c in name for c in "\t\r\n\0"):
            raise OutputError(
                f"{path}: marker name {name!r} cannot be written: it is empty, begins or ends with a blank, or has "
                "a tab or line end: rename it"
            )
        if list(names).count(name) > 1:
            raise OutputError(f"{path}: marker {name!r} would be written twice: make the names differ")
    gaps = np.isnan(points)
    bad = np.argwhere(np.isinf(points).any(axis=2) | (gaps.any(axis=2) & ~gaps.all(axis=2)))
    if len(bad) or not np.isfinite(times).all():
        what = f"marker {names[bad[0][1]]!r} of row {bad[0][0]} (from 0)" if len(bad) else "a time"
        raise OutputError(f"{path}: {what} is not finite: give numbers, or three NaN where a marker was not seen")
    keys = _keys_to_write(path, times, n, unit, header or {})
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "\t".join(keys),
        "\t".join(keys.values()),
        "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{i}" for i in range(1, n + 1) for axis in "XYZ"),
        "",
    ]
    for frame, (t, row) in enumerate(zip(times.tolist(), points.reshape(len(times), -1).tolist(), strict=True), 1):
        line = "\t".join([str(frame), repr(t), *(_word(x, -SHIFTS[unit]) for x in row)])
        lines.append(line + "\t" * line.endswith("\t"))  # OpenSim counts no empty cell at a line's end
    with written_whole(path) as temporary:
        temporary.write_text("\n".join([*lines, ""]), encoding="utf-8", newline="\n")


def rewrite_markers(path: str | os.PathLike[str], table: MarkerTable) -> None:
    """Write markers as they were read, with the file's unit and rates; markers of a .c3d become a .trc.

    Frames are numbered from 1, and keys that are not of the format's eight are left out.

    Raises:
        OutputError: see `write_trc`.
    """
    write_trc(path, table.names, table.time, table.positions, unit=table.unit, header=table.header)


def _keys_to_write(path: Path, time: Array, n_marker: int, unit: str, given: Mapping[str, str]) -> dict[str, str]:
    """The header's keys and values."""
    for key, value in given.items():
        if not value or value != value.strip() or any(c in value for c in "\t\r\n\0"):
            raise OutputError(
                f"{path}: header {key!r}, {value!r} cannot be written: it is empty, begins or ends with a blank, or "
                "has a tab or line end: correct it"
            )
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    rate = f"{1 / step:.9g}" if step > 0 else "1"
    said = look_up(dict(given), "datarate")
    if said is not None and is_number(said[1]) and abs(float(said[1]) * step - 1) <= _RATE_TOLERANCE:
        rate = said[1]
    keys = dict.fromkeys(_KEYS, rate)
    keys |= {"NumFrames": str(len(time)), "NumMarkers": str(n_marker), "Units": unit}
    keys |= {"OrigDataStartFrame": "1", "OrigNumFrames": str(len(time))}
    free = {key.lower(): key for key in ("CameraRate", *_ORIGINAL)}
    return keys | {free[key.lower()]: value for key, value in given.items() if key.lower() in free}


def _word(value: float, shift: int) -> str:
    """A number times a power of ten, in decimal digits: exact, where a product of floats would be rounded."""
    if value != value:
        return ""
    return format(Decimal(repr(value)).scaleb(shift), "f") if shift else repr(value)


def _metres(word: str, shift: int) -> float:
    if not word:
        return np.nan
    value = number(word)
    return float(Decimal(word).scaleb(shift)) if shift and np.isfinite(value) else value


def _cells(line: str) -> list[str]:
    cells = [cell.strip() for cell in (line.split("\t") if "\t" in line else line.split())]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _read_header(path: Path, lines: list[str]) -> tuple[dict[str, str], int]:
    """Keys and values of the header, and the index of the line of marker names."""
    labels_at = next((i for i, line in enumerate(lines) if line.strip().lower().startswith("frame#")), None)
    if labels_at is None:
        raise MotionError(f"{path}: no line that begins with 'Frame#': not a marker file (.trc), or one cut off early")
    above = [(i, line) for i, line in enumerate(lines[:labels_at]) if line.strip()]
    keys_at = next((k for k, (_, line) in enumerate(above) if "units" in line.lower().split()), None)
    if keys_at is None or keys_at + 1 >= len(above):
        raise MotionError(
            f"{path}: no line of keys with 'Units', and their values, above 'Frame#' (line {labels_at + 1}): write "
            "'DataRate ... Units' and below it '100 ... mm'"
        )
    keys, values = (_cells(above[k][1]) for k in (keys_at, keys_at + 1))
    return dict(zip(keys, values, strict=False)), labels_at


def _unit(path: Path, header: dict[str, str]) -> str:
    entry = look_up(header, "units")
    said = entry[1] if entry else ""
    if said.lower() not in UNIT_NAMES:
        raise MotionError(f"{path}: the header gives Units as {said!r}: write mm, cm or m")
    return UNIT_NAMES[said.lower()]


def _marker_names(path: Path, at: int, line: str) -> tuple[str, ...]:
    cells = _cells(line)
    if len(cells) < 2 or cells[1].lower() != "time":
        raise MotionError(f"{path}, line {at}: {line.strip()[:40]!r}: write 'Frame#', 'Time' and the markers' names")
    names = tuple(filter(None, cells[2:]))
    if not names:
        raise MotionError(f"{path}, line {at}: no marker names: name each marker, over its X")
    for name in names:
        if names.count(name) > 1:
            raise MotionError(f"{path}, line {at}: marker {name!r} stands twice: rename or remove one")
    return names


def _row(path: Path, at: int, line: str, names: tuple[str, ...], shift: int, last: bool) -> list[float]:
    """Time and coordinates of one row, NaN where empty."""
    width = 2 + 3 * len(names)
    tabs = "\t" in line
    cells = [cell.strip() for cell in (line.split("\t") if tabs else line.split())]
    while len(cells) > width and not cells[-1]:
        cells.pop()
    short = width - len(cells)
    # An editor that drops tabs at line ends drops whole markers that were not seen; in the last row, a file cut off
    # is the likelier cause.
    dropped = tabs and not last and len(cells) >= 2 and short > 0 and short % 3 == 0
    if short and not dropped:
        remedy = "the file is cut off, write it again" if last and short > 0 else "correct the row, or write it again"
        raise MotionError(
            f"{path}, line {at}: {len(cells)} value{'s' * (len(cells) != 1)} where {len(names)} markers need {width}: "
            f"{remedy}"
        )
    cells += [""] * short
    labels = ("time", *(f"{name} {axis}" for name in names for axis in "XYZ"))
    values = []
    for i, word in enumerate(cells[1:]):
        try:
            value = _metres(word, shift if i else 0)
        except ValueError:
            raise MotionError(
                f"{path}, line {at}, column {labels[i]!r}: {word!r} is not a number: correct it or write the file again"
            ) from None
        if np.isinf(value) or (i == 0 and np.isnan(value)):
            raise MotionError(f"{path}, line {at}, column {labels[i]!r}: {word or 'nothing'}: give a finite number")
        values.append(value)
    gaps = np.isnan(values[1:]).reshape(-1, 3)
    half = np.flatnonzero(gaps.any(axis=1) & ~gaps.all(axis=1))
    if len(half):
        raise MotionError(
            f"{path}, line {at}: marker {names[half[0]]!r} has only some of its coordinates: give all three or none"
        )
    return values


def _check_said(table: MarkerTable, header: dict[str, str]) -> None:
    """The header against what is there: missing rows are an error, other differences a warning."""
    for key, found, what in (("numframes", len(table.time), "rows"), ("nummarkers", len(table.names), "markers")):
        entry = look_up(header, key)
        if entry is None:
            continue
        if not entry[1].isdecimal():
            raise MotionError(f"{table.path}: the header gives {entry[0]} as {entry[1]!r}: write the number of {what}")
        if what == "rows" and found < int(entry[1]):
            raise MotionError(
                f"{table.path}: cut off: the header says {entry[0]} {entry[1]}, the file ends at line "
                f"{table.line_numbers[-1]} after {found} rows: write it again, or correct the header"
            )
        if found != int(entry[1]):
            warnings.warn(
                f"{table.path}: the header says {entry[0]} {entry[1]}, the file has {found} {what}: all are read",
                MjhcmcWarning,
                stacklevel=3,
            )
    entry = look_up(header, "datarate")
    steps = np.diff(table.time)
    if entry is None or not len(steps) or not np.median(steps) > 0:
        return
    try:
        said = number(entry[1])
    except ValueError:
        raise MotionError(f"{table.path}: the header gives {entry[0]} as {entry[1]!r}: write rows a second") from None
    rate = 1 / float(np.median(steps))
    if said != rate and not abs(said / rate - 1) <= _RATE_TOLERANCE:  # both may be infinite
        warnings.warn(
            f"{table.path}: the header says {entry[0]} {entry[1]}, the times have {rate:.6g} rows a second: "
            "the times are taken",
            MjhcmcWarning,
            stacklevel=3,
        )

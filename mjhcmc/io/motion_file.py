"""From an OpenSim table to a Motion: columns onto joints, units, cropping, and the checks of what is kept."""

import json
import os
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MjhcmcWarning, MotionError
from mjhcmc.io.opensim import SUFFIXES, OpenSimTable, read_table
from mjhcmc.motion import RANGE_ALLOWANCE, TIME_TOLERANCE, JointModel, Motion, check_cutoff, check_joint_range

Array = NDArray[np.float64]

_REPEAT_TOLERANCE = 1e-6  # file units: rows at one time that agree this well are one row
_CONTEXT_ROWS = 16  # the quintic spline forgets by .43 a row: 16 rows out, an end is felt by 1e-6
_CONTEXT_PERIODS = 4.0  # of the cutoff: the filter's memory is exp(-4.4) a period
_RANGE_TOLERANCE = 1e-9  # rad or m, for rows
_CHECKS_PER_ROW = 4
_RADIANS_AT_MOST = np.pi / 2  # "degrees" within this, and
_RADIANS_MOVE = 0.1  # moving at least this much, look like radians: 0.1 deg is no movement, 5.7 deg is
_DEGREES_FROM = 2 * np.pi  # "radians" beyond a whole turn look like degrees


def read_motion(
    path: str | os.PathLike[str],
    model: JointModel,
    lowpass_hz: float | None = None,
    *,
    column_map: Mapping[str, str] | str | os.PathLike[str] | None = None,
    start: float | None = None,
    end: float | None = None,
) -> Motion:
    """Read a motion: see Motion.from_file, which this is."""
    path = Path(path)
    if lowpass_hz is not None:
        check_cutoff(lowpass_hz)
    if path.suffix.lower() not in SUFFIXES:
        raise MotionError(f"{path}: a motion file ends in {' or '.join(SUFFIXES)}, not in {path.suffix or 'nothing'!r}")
    given = _read_map(column_map)
    table = read_table(path)
    used, signs = _match_columns(table, model, given)
    rotation = np.asarray(model.joint_is_rotation, dtype=bool)
    if table.in_degrees is None and rotation.any():
        raise MotionError(
            f"{path}: the header does not say inDegrees: add the line inDegrees=yes (angles in degrees) or "
            f"inDegrees=no "
            "(radians) before endheader"
        )
    kept = _crop(table, start, end)
    values = table.values[:, used]
    _check_finite(table, used, kept)
    rows = kept[_distinct_times(table, values, kept)]
    if len(rows) < 4:
        raise MotionError(
            f"{path}: {len(rows)} row{'s' * (len(rows) != 1)} from {table.time[kept[0]]:.6g} to "
            f"{table.time[kept[-1]]:.6g} s: a motion needs at least 4"
        )
    rows = _with_context(table.time, values, kept, rows, _CONTEXT_PERIODS / lowpass_hz if lowpass_hz else 0.0)
    units = np.where(rotation & bool(table.in_degrees), np.pi / 180, 1.0) * signs
    unused = [column for i, column in enumerate(table.columns) if i not in used]
    motion = Motion(
        table.time[rows],
        values[rows] * units,
        path.stem,
        (f"columns not used: {', '.join(unused)}",) if unused else (),
        tuple(model.joint_names),
        _span(table.time, kept, rows, start, end),
    )
    doubt = _unit_doubt(table, rotation, values[kept])
    remedy = "check the column's sign and units, crop with start and end, or widen the range"
    if hint := doubt or _degrees_fit(table, model, values[kept] * signs):
        remedy = f"{hint}; otherwise {remedy}"
    if lowpass_hz is None:
        inside = (motion.time >= motion.start) & (motion.time <= motion.end)
        check_joint_range(motion, model, motion.time[inside], motion.qpos[inside], str(path), _RANGE_TOLERANCE, remedy)
    else:
        motion = motion.lowpassed(lowpass_hz)
    between = motion.sample(np.linspace(motion.start, motion.end, _CHECKS_PER_ROW * len(motion.time) + 1))
    what = f"{path}, {'spline between its rows' if lowpass_hz is None else 'filtered'}"
    check_joint_range(motion, model, between.time, between.qpos, what, RANGE_ALLOWANCE, remedy)
    if doubt:
        warnings.warn(f"{path}: {doubt}", MjhcmcWarning, stacklevel=3)
    return motion


def _read_map(given: Mapping[str, str] | str | os.PathLike[str] | None) -> dict[str, str]:
    """The user's joint-to-column map, from a dict or a JSON file."""
    if given is None:
        return {}
    where, content = "column map", given
    if not isinstance(given, Mapping):
        where = f"column map {given}"
        try:
            content = json.loads(Path(given).read_text(encoding="utf-8-sig"))
        except OSError as error:
            raise MotionError(f"{where}: cannot be read ({error.strerror}): check the path") from None
        except UnicodeDecodeError:
            raise MotionError(
                f"{where}: not a text file: give JSON, an object of joint names and column names"
            ) from None
        except json.JSONDecodeError as error:
            raise MotionError(
                f"{where}, line {error.lineno}: not JSON ({error.msg}): give an object of joint names and column names"
            ) from None
    if not isinstance(content, Mapping):
        raise MotionError(f"{where}: holds no object: give one of joint names and column names")
    for joint, column in content.items():
        if not isinstance(column, str) or not column.strip("- "):
            raise MotionError(
                f"{where}: joint {joint!r} maps to {column!r}: give a column's name, with a minus to flip it"
            )
    return dict(content)


def _match_columns(table: OpenSimTable, model: JointModel, given: dict[str, str]) -> tuple[list[int], Array]:
    """(nq) index of each joint's column among the table's, and (nq,) its sign."""
    joints = tuple(model.joint_names)
    unknown = [joint for joint in given if joint not in joints]
    if unknown:
        raise MotionError(
            f"column map: model {model.name} has no joint {', '.join(unknown)}: its joints are {', '.join(joints)}"
        )
    used, signs = [], np.ones(len(joints))
    for j, joint in enumerate(joints):
        looked_for = [given[joint]] if joint in given else [joint, *filter(None, [model.column_map.get(joint)])]
        for name in looked_for:
            at = _find_column(table, name.removeprefix("-"))
            if at is not None:
                used.append(at)
                signs[j] = -1.0 if name.startswith("-") else 1.0
                break
        else:
            columns = f"its columns are {', '.join(table.columns)}"
            if joint in given:
                raise MotionError(
                    f"{table.path}: no column {given[joint].removeprefix('-')!r}, which the column map "
                    f"names for joint "
                    f"{joint}; {columns}: name one of them"
                )
            raise MotionError(
                f"{table.path}: no column for joint {joint} of model {model.name} (looked for "
                f"{' and '.join(name.removeprefix('-') for name in looked_for)}); {columns}: "
                f"map one with a column map such as "
                f"{{{json.dumps(joint)}: {json.dumps((*table.columns, 'column')[0])}}}"
            )
    return used, signs


def _find_column(table: OpenSimTable, name: str) -> int | None:
    """A column by its name, else by the coordinate in an OpenSim path (/jointset/hip/hip_flexion/value)."""
    if name in table.columns:
        return table.columns.index(name)
    paths = [column.split("/") for column in table.columns]
    found = [i for i, path in enumerate(paths) if len(path) > 1 and path[-1] == "value" and path[-2] == name]
    if len(found) > 1:
        raise MotionError(
            f"{table.path}: columns {' and '.join(table.columns[i] for i in found)} both hold {name}: "
            "name one in full in a column map"
        )
    return found[0] if found else None


def _crop(table: OpenSimTable, start: float | None, end: float | None) -> NDArray[np.intp]:
    """Indices of the rows from start to end, and of the next rows out where these fall between rows."""
    time, path = table.time, table.path
    everything = np.arange(len(time))
    finite = time[np.isfinite(time)]
    if (start is None and end is None) or not len(finite):
        return everything
    low, high = finite.min(), finite.max()
    for what, value in (("start", start), ("end", end)):
        if value is not None and not low - TIME_TOLERANCE <= value <= high + TIME_TOLERANCE:
            raise MotionError(
                f"{path}: {what} {value:.6g} s lies outside the file's times {low:.6g} .. {high:.6g} s: "
                f"choose it within"
            )
    begin = low if start is None else start
    finish = high if end is None else end
    if begin >= finish:
        raise MotionError(f"{path}: start {begin:.6g} s is not before end {finish:.6g} s: choose a later end")
    inside = np.flatnonzero((time >= begin - TIME_TOLERANCE) & (time <= finish + TIME_TOLERANCE))
    if not len(inside):
        raise MotionError(f"{path}: 0 rows from {begin:.6g} to {finish:.6g} s: a motion needs at least 4")
    first = 0 if start is None else max(inside[0] - (time[inside[0]] > begin + TIME_TOLERANCE), 0)
    last = (
        len(time) - 1 if end is None else min(inside[-1] + (time[inside[-1]] < finish - TIME_TOLERANCE), len(time) - 1)
    )
    return everything[first : last + 1]


def _check_finite(table: OpenSimTable, used: list[int], kept: NDArray[np.intp]) -> None:
    block = np.column_stack([table.time[kept], table.values[kept][:, used]])
    bad = np.argwhere(~np.isfinite(block))
    if len(bad):
        row, column = bad[0]
        name = "time" if column == 0 else table.columns[used[column - 1]]
        raise MotionError(
            f"{table.path}, line {table.line_numbers[kept[row]]}, column {name!r}: {block[row, column]}: "
            "fill the gap, or crop it away with start and end"
        )


def _distinct_times(table: OpenSimTable, values: Array, kept: NDArray[np.intp]) -> NDArray[np.bool_]:
    """True for the kept rows to use: not those that repeat the row before. Other times must increase."""
    time, lines = table.time[kept], table.line_numbers[kept]
    steps = np.diff(time)
    near = np.abs(steps) <= TIME_TOLERANCE
    change = np.abs(np.diff(values[kept], axis=0)).max(axis=1, initial=0.0)
    repeated = near & (change <= _REPEAT_TOLERANCE)
    wrong = np.flatnonzero((near | (steps < 0)) & ~repeated)
    if len(wrong):
        i = wrong[0]
        why = f"the same time with other values (by {change[i]:.3g})" if near[i] else "times must increase"
        raise MotionError(
            f"{table.path}, line {lines[i + 1]}: time {time[i + 1]:.12g} s follows {time[i]:.12g} s: {why}: "
            "remove one of the rows, or crop with start and end"
        )
    dropped = np.flatnonzero(repeated) + 1
    if len(dropped):
        where = ", ".join(f"line {lines[i]} ({time[i]:.6g} s)" for i in dropped[:5])
        warnings.warn(
            f"{table.path}: {len(dropped)} row{'s' * (len(dropped) > 1)} dropped that "
            f"repeat{'s' * (len(dropped) == 1)} "
            f"the time and values of the row before: {where}{', ...' if len(dropped) > 5 else ''}",
            MjhcmcWarning,
            stacklevel=4,
        )
    return np.concatenate([[True], ~repeated])


def _with_context(
    time: Array, values: Array, kept: NDArray[np.intp], rows: NDArray[np.intp], reach: float
) -> NDArray[np.intp]:
    """The rows and their neighbours outside the crop, where sound: they lead the spline and the filter.

    Neighbours end at the first that is not finite, not in order or behind a gap; they are 16, or as many as
    cover reach (s).
    """
    sound = np.isfinite(time) & np.isfinite(values).all(axis=1)
    gap = 10 * np.median(np.diff(time[rows]))

    def neighbours(candidates: NDArray[np.intp], origin: float, sign: float) -> NDArray[np.intp]:
        away = sign * (time[candidates] - origin)
        steps = np.diff(away, prepend=0.0)
        wanted = (np.arange(len(candidates)) < _CONTEXT_ROWS) | (away <= reach)
        good = sound[candidates] & (steps > TIME_TOLERANCE) & (steps < gap) & wanted
        return candidates[: len(good) if good.all() else int(np.argmin(good))]

    before = neighbours(np.arange(kept[0] - 1, -1, -1), float(time[rows[0]]), -1.0)
    after = neighbours(np.arange(kept[-1] + 1, len(time)), float(time[rows[-1]]), 1.0)
    return np.concatenate([before[::-1], rows, after])


def _span(
    time: Array, kept: NDArray[np.intp], rows: NDArray[np.intp], start: float | None, end: float | None
) -> tuple[float, float]:
    """Start and end as asked, to the digit; a tolerance outside the rows, the outermost row."""
    first, last = float(time[rows[0]]), float(time[rows[-1]])
    begin = float(time[kept[0]]) if start is None else float(start)
    finish = float(time[kept[-1]]) if end is None else float(end)
    begin = first if first - TIME_TOLERANCE <= begin < first else begin
    finish = last if last < finish <= last + TIME_TOLERANCE else finish
    return begin, finish


def _unit_doubt(table: OpenSimTable, rotation: NDArray[np.bool_], values: Array) -> str | None:
    """What makes the header's inDegrees doubtful, if anything."""
    angles = values[:, rotation]
    if not angles.size:
        return None
    peak, move = np.abs(angles).max(), np.ptp(angles, axis=0).max()
    if table.in_degrees and peak <= _RADIANS_AT_MOST and move >= _RADIANS_MOVE:
        return (
            f"the header says inDegrees=yes but no angle exceeds {peak:.3g}, which looks like radians: "
            "if they are, write inDegrees=no"
        )
    if not table.in_degrees and peak > _DEGREES_FROM:
        return (
            f"the header says inDegrees=no but angles reach {peak:.3g}, which looks like degrees: "
            "if they are, write inDegrees=yes"
        )
    return None


def _degrees_fit(table: OpenSimTable, model: JointModel, values: Array) -> str | None:
    """A hint where angles said to be radians would fit the joint ranges if they were degrees."""
    rotation = np.asarray(model.joint_is_rotation, dtype=bool)
    limits = np.asarray(model.joint_range, dtype=np.float64)[rotation]
    angles = np.deg2rad(values[:, rotation])
    if table.in_degrees or np.any((angles < limits[:, 0]) | (angles > limits[:, 1])):
        return None
    return "the header says inDegrees=no, and as degrees the angles would fit: if they are, write inDegrees=yes"

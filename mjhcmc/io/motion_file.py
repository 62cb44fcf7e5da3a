"""From a file to a Motion: columns onto joints, units, cropping, and the checks of what is kept."""

import os
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError
from mjhcmc.io import c3d, csv_table, opensim
from mjhcmc.io.columns import listed, match_columns, read_map
from mjhcmc.io.rows import JointRows, check_finite, crop, rows_of_motion, span
from mjhcmc.io.units import column_units, degrees_fit, unit_doubt
from mjhcmc.motion import RANGE_ALLOWANCE, JointModel, Motion, check_cutoff, check_joint_range

Array = NDArray[np.float64]

MARKER_SUFFIXES = (".trc", *c3d.SUFFIXES)
SUFFIXES = (*opensim.SUFFIXES, *csv_table.SUFFIXES, *MARKER_SUFFIXES)
"""Of the files that a motion is read from."""

_CONTEXT_PERIODS = 4.0  # of the cutoff: the filter's memory is exp(-4.4) a period
_RANGE_TOLERANCE = 1e-9  # rad or m, for rows
_CHECKS_PER_ROW = 4


def read_motion(
    path: str | os.PathLike[str],
    model: JointModel,
    lowpass_hz: float | None = None,
    *,
    column_map: Mapping[str, str] | str | os.PathLike[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    angle_unit: str | None = None,
    angles: str = "joint",
    name: str | None = None,
) -> Motion:
    """Read a motion: see Motion.from_file, which this is; name takes the place of the file's stem."""
    path = Path(path)
    check_options(lowpass_hz, angle_unit, angles)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        endings = f"{', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
        raise MotionError(f"{path}: a motion file ends in {endings}, not in {path.suffix or 'nothing'!r}")
    reach = _CONTEXT_PERIODS / lowpass_hz if lowpass_hz else 0.0
    if suffix in MARKER_SUFFIXES:
        from mjhcmc.io.markers import marker_rows

        if angle_unit is not None or angles != "joint":
            given = [] if angle_unit is None else [f"angle_unit {angle_unit!r}"]
            given += [] if angles == "joint" else [f"angles {angles!r}"]
            raise SettingsError(f"{path}: holds markers, not angles: leave out {' and '.join(given)}")
        rows = marker_rows(path, model, read_map(column_map, "site", "marker"), start, end, reach)
    else:
        rows = _table_rows(path, model, read_map(column_map), start, end, reach, angle_unit, angles)
    return _checked(path, name or path.stem, model, rows, lowpass_hz)


def check_options(lowpass_hz: float | None, angle_unit: str | None, angles: str) -> None:
    """Raise SettingsError where an option is none of its valid values."""
    if lowpass_hz is not None:
        check_cutoff(lowpass_hz)
    if angle_unit not in (None, "deg", "rad"):
        raise SettingsError(f"angle_unit {angle_unit!r}: choose 'deg' or 'rad', or leave it out where the file says")
    if angles not in ("joint", "segment"):
        raise SettingsError(f"angles {angles!r}: choose 'joint' or 'segment'")


def _table_rows(
    path: Path,
    model: JointModel,
    given: dict[str, str],
    start: float | None,
    end: float | None,
    reach: float,
    angle_unit: str | None,
    angles: str,
) -> JointRows:
    """What a table of angles gives."""
    table = csv_table.read_csv(path) if path.suffix.lower() in csv_table.SUFFIXES else opensim.read_table(path)
    found, used, signs = match_columns(table, model, given)
    part = NamedJoints(model, found)
    units = column_units(table, part, used, angle_unit)
    to_joint = _to_joint(part, angles)
    kept = crop(path, table.time, start, end)
    values = table.values[:, used]
    check_finite(table, used, kept)
    rows = rows_of_motion(path, table.time, table.line_numbers, values, kept, reach)
    unused = [column for i, column in enumerate(table.columns) if i not in used]
    doubt = unit_doubt(units, values[kept])
    qpos = np.tile(np.asarray(model.qpos_reference, dtype=np.float64), (len(table.time[rows]), 1))
    qpos[:, found] = to_joint(values[rows] * (units.factors * signs))
    return JointRows(
        table.time[rows],
        qpos,
        span(table.time, kept, rows, start, end),
        (*([f"columns not used: {listed(unused)}"] if unused else []), *_still(model, found)),
        doubt,
        doubt or degrees_fit(units, part, values[kept] * signs, to_joint),
    )


def _still(model: JointModel, found: list[int]) -> list[str]:
    """A line on the joints that are tracked without being named."""
    silent = getattr(model, "may_be_silent", {})
    names = [name for j, name in enumerate(model.joint_names) if j not in found and not silent.get(name, False)]
    return [f"joints not in the file, held at the reference pose: {listed(names)}"] if names else []


class NamedJoints:
    """Those joints of a model that a table has columns for; see `JointModel`.

    Args:
        model: the model.
        which: indices of the joints.
    """

    def __init__(self, model: JointModel, which: list[int]) -> None:
        self.name, self.column_map = model.name, model.column_map
        self.joint_names = tuple(model.joint_names[j] for j in which)
        self.joint_is_rotation = np.asarray(model.joint_is_rotation)[which]
        self.joint_range = np.asarray(model.joint_range, dtype=np.float64)[which]
        self.qpos_reference = np.asarray(model.qpos_reference)[which]
        self.mj_model = getattr(model, "mj_model", None)


def _to_joint(model: JointModel, angles: str) -> Callable[[Any], Array]:
    if angles == "joint":
        return lambda values: np.asarray(values, dtype=np.float64)
    from mjhcmc.segments import joint_angles

    return lambda values: joint_angles(model, values)


def _checked(path: Path, name: str, model: JointModel, rows: JointRows, lowpass_hz: float | None) -> Motion:
    """The motion, filtered if asked, when it keeps to the joints' ranges."""
    motion = Motion(rows.time, rows.qpos, name, rows.notices, tuple(model.joint_names), rows.span)
    remedy = "check the column's sign and units, crop with start and end, or widen the range"
    if path.suffix.lower() in MARKER_SUFFIXES:
        remedy = "check the markers near it, filter, crop with start and end, or widen the range"
    if rows.hint:
        remedy = f"{rows.hint}; otherwise {remedy}"
    if lowpass_hz is None:
        inside = (motion.time >= motion.start) & (motion.time <= motion.end)
        check_joint_range(motion, model, motion.time[inside], motion.qpos[inside], str(path), _RANGE_TOLERANCE, remedy)
    else:
        motion = motion.lowpassed(lowpass_hz)
    between = motion.sample(np.linspace(motion.start, motion.end, _CHECKS_PER_ROW * len(motion.time) + 1))
    what = f"{path}, {'spline between its rows' if lowpass_hz is None else 'filtered'}"
    check_joint_range(motion, model, between.time, between.qpos, what, RANGE_ALLOWANCE, remedy)
    if rows.doubt:
        warnings.warn(f"{path}: {rows.doubt}", MjhcmcWarning, stacklevel=4)
    return motion

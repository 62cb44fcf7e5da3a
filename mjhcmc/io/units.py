"""In which unit a file's columns stand, who says so, and whether the values bear it out."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError
from mjhcmc.io.motion_table import MotionTable
from mjhcmc.joints import JointModel

Array = NDArray[np.float64]

FACTORS: Mapping[str, float] = {"deg": np.pi / 180, "rad": 1.0, "m": 1.0, "mm": 1e-3}
"""Unit to rad or m; None is rad or m."""

SOLUTION_PREFIX = "q/"
"""Solution.save writes joint positions to columns q/JOINT, in rad and m."""

WITH_UNIT = re.compile(r"(?P<name>.*\S)\s*[(\[]\s*(?P<unit>[^()\[\]]*?)\s*[)\]]")
"""A column name with something in brackets at its end."""

_UNITS = {
    **dict.fromkeys(("deg", "degs", "degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("rad", "rads", "radian", "radians"), "rad"),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    "mm": "mm",
}
_ANGLES = ("deg", "rad")
_RADIANS_AT_MOST = np.pi / 2  # "degrees" within this, and
_RADIANS_MOVE = 0.1  # moving at least this much, look like radians: 0.1 deg is no movement, 5.7 deg is
_DEGREES_FROM = 2 * np.pi  # "radians" beyond a whole turn look like degrees


def split_unit(name: str) -> tuple[str, str | None]:
    """A column's name, and the unit in brackets behind it; brackets that hold no unit known here are of the name."""
    found = WITH_UNIT.fullmatch(name)
    if found is None:
        return name, None
    if found["name"].lower() == "time":
        return found["name"], None
    unit = _UNITS.get(found["unit"].lower())
    return (found["name"], unit) if unit else (name, None)


@dataclass(frozen=True, eq=False)
class ColumnUnits:
    """The unit of each joint's column.

    Attributes:
        factors: (nq,) file units to rad or m.
        degrees: (nq,) true where the column holds degrees.
        radians: (nq,) true where it holds radians.
        said: (nq,) what says so, for messages.
        otherwise: (nq,) how to say the other angle unit, for messages.
    """

    factors: Array
    degrees: NDArray[np.bool_]
    radians: NDArray[np.bool_]
    said: tuple[str, ...]
    otherwise: tuple[str, ...]


def column_units(table: MotionTable, model: JointModel, used: list[int], angle_unit: str | None) -> ColumnUnits:
    """The unit of each joint's column, by the column's name, the header, and the caller; they must agree.

    Args:
        table: the table.
        model: the model, for its joints' kinds.
        used: (nq) index of each joint's column.
        angle_unit: "deg" or "rad", what the caller says; None: nothing.

    Raises:
        MotionError: nobody says the unit of a hinge's column, two disagree, or a unit does not fit the joint.
    """
    units, said, otherwise = [], [], []
    for joint, rotates, at in zip(model.joint_names, model.joint_is_rotation, used, strict=True):
        own = table.units[at]
        if own is not None and (own in _ANGLES) != rotates:
            raise MotionError(
                f"{table.path}: column {table.columns[at]!r} is in {own}, but joint {joint} of model {model.name} is a "
                f"{'hinge: map a column of angles (deg or rad)' if rotates else 'slide: map a column in m or mm'}"
            )
        if not rotates:
            units.append(own or "m")
            said.append("")
            otherwise.append("")
            continue
        unit, who, other = _angle_unit(table, at, angle_unit)
        units.append(unit)
        said.append(who)
        otherwise.append(other)
    names = np.array(units)
    factors = np.array([FACTORS[unit] for unit in units])
    return ColumnUnits(factors, names == "deg", names == "rad", tuple(said), tuple(otherwise))


def _angle_unit(table: MotionTable, at: int, angle_unit: str | None) -> tuple[str, str, str]:
    """Unit of one column of angles, what says so, and how to say the other."""
    column, own = table.columns[at], table.units[at]
    sources = []
    if own is not None:
        other = "rad" if own == "deg" else "deg"
        sources.append((own, f"column {column!r} says {own}", f"name it {column} ({other})"))
    if table.in_degrees is not None:
        words = ("yes", "no") if table.in_degrees else ("no", "yes")
        unit = "deg" if table.in_degrees else "rad"
        sources.append((unit, f"the header says inDegrees={words[0]}", f"write inDegrees={words[1]}"))
    elif own is None and column.startswith(SOLUTION_PREFIX):
        sources.append(("rad", f"column {column!r} is a solution's, in radians,", "rename it"))
    if angle_unit is not None:
        other = "rad" if angle_unit == "deg" else "deg"
        sources.append((angle_unit, f"angle_unit says {angle_unit}", f"give angle_unit {other}"))
    if not sources:
        if table.path.suffix.lower() == ".csv":
            raise MotionError(
                f"{table.path}: nothing says whether column {column!r} holds degrees or radians: write the line "
                f"'# inDegrees=yes' (degrees) or '# inDegrees=no' (radians) above the column names, name the column "
                f"'{column} (deg)' or '{column} (rad)', or give angle_unit"
            )
        raise MotionError(
            f"{table.path}: the header does not say inDegrees: add the line inDegrees=yes (angles in degrees) or "
            "inDegrees=no (radians) before endheader, or give angle_unit"
        )
    for unit, who, _ in sources[1:]:
        if unit != sources[0][0]:
            remedy = "leave angle_unit out or correct the file" if who.startswith("angle_unit") else "correct one"
            raise MotionError(f"{table.path}: {sources[0][1]} but {who}: {remedy}")
    return sources[0]


def unit_doubt(units: ColumnUnits, values: Array) -> str | None:
    """What makes the unit of the angles doubtful, if anything; values (T, nq) as the file holds them."""
    for holds, chosen in (("deg", units.degrees), ("rad", units.radians)):
        angles = values[:, chosen]
        if not angles.size:
            continue
        worst = np.flatnonzero(chosen)[int(np.argmax(np.abs(angles).max(axis=0)))]
        said, otherwise = units.said[worst], units.otherwise[worst]
        peak, move = np.abs(angles).max(), np.ptp(angles, axis=0).max()
        if holds == "deg" and peak <= _RADIANS_AT_MOST and move >= _RADIANS_MOVE:
            return f"{said} but no angle exceeds {peak:.3g}, which looks like radians: if they are, {otherwise}"
        if holds == "rad" and peak > _DEGREES_FROM:
            return f"{said} but angles reach {peak:.3g}, which looks like degrees: if they are, {otherwise}"
    return None


def degrees_fit(units: ColumnUnits, model: JointModel, values: Array, to_joint: Callable[[Any], Array]) -> str | None:
    """A hint where angles said to be radians would fit the joint ranges if they were degrees.

    Args:
        units: of the columns.
        model: the model, with joint_range.
        values: (T, nq) as the file holds them, signs applied.
        to_joint: from the file's angles in rad to joint angles.
    """
    rotation = units.degrees | units.radians
    if units.degrees.any() or not rotation.any():
        return None
    limits = np.asarray(model.joint_range, dtype=np.float64)
    angles = to_joint(np.where(rotation, np.deg2rad(values), values))
    outside = (angles < limits[:, 0]) | (angles > limits[:, 1])
    if outside[:, rotation].any():
        return None
    first = int(np.argmax(rotation))
    return f"{units.said[first]}, and as degrees the angles would fit: if they are, {units.otherwise[first]}"

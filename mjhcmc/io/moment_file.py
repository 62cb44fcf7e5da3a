"""From a file to JointMoments: the columns of each joint's moment, by the names that programs give them."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError
from mjhcmc.io import csv_table, opensim
from mjhcmc.io.columns import listed, read_map
from mjhcmc.io.motion_table import MotionTable
from mjhcmc.joint_moments import JointMoments
from mjhcmc.model import MuscleModel

SUFFIXES = (*opensim.SUFFIXES, *csv_table.SUFFIXES)

_PLAIN = "{}"
_FORMS = ("{}_moment", "{}_force", "moment/{}", _PLAIN)  # OpenSim's inverse dynamics; our own tables; as it is
_ANGLES = ("deg", "rad")


def read_moments(
    path: Path, model: MuscleModel, column_map: Mapping[str, str] | str | os.PathLike[str] | None
) -> JointMoments:
    """See `JointMoments.from_file`."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise MotionError(
            f"{path}: a file of joint moments ends in {', '.join(SUFFIXES)}, not in {suffix or 'nothing'!r}"
        )
    given = read_map(column_map)
    unknown = [joint for joint in given if joint not in model.joint_names]
    if unknown:
        raise MotionError(
            f"column map: model {model.name!r} has no joint {unknown[0]!r}: its joints are "
            f"{', '.join(model.joint_names)}"
        )
    table = csv_table.read_csv(path) if suffix in csv_table.SUFFIXES else opensim.read_table(path)
    moment = np.column_stack([_column(table, model, joint, given) for joint in model.joint_names])
    bad = np.argwhere(~np.isfinite(np.column_stack([table.time, moment])))
    if len(bad):
        row, column = bad[0]
        what = "time" if column == 0 else f"the moment of {model.joint_names[column - 1]}"
        raise MotionError(
            f"{path}, line {table.line_numbers[row]}: {what} is not finite: fill the gap or leave rows out"
        )
    return JointMoments(table.time, moment, str(path))


def _column(table: MotionTable, model: MuscleModel, joint: str, given: Mapping[str, str]) -> NDArray[np.float64]:
    names = [given[joint]] if joint in given else [joint, *filter(None, [model.column_map.get(joint)])]
    for form in _FORMS:
        for name in names:
            column = form.format(name.removeprefix("-"))
            if column in table.columns:
                i = table.columns.index(column)
                if table.units[i] in _ANGLES or (table.in_degrees and form == _PLAIN):
                    raise MotionError(
                        f"{table.path}: column {column} holds angles in {table.units[i] or 'degrees'}, by what the "
                        f"file says: give a file of joint moments, or name joint {joint}'s with a column map"
                    )
                return -table.values[:, i] if name.startswith("-") else table.values[:, i]
    looked_for = ", ".join(form.format(name.removeprefix("-")) for name in names for form in _FORMS)
    raise MotionError(
        f"{table.path}: no column for the moment at joint {joint} (looked for {looked_for}); its columns are "
        f"{listed(table.columns)}: name one with a column map"
    )

"""OpenSim's own results on the cosine movements, shipped in the folder `reference`: to compare with.

A table is a .csv with a column time (s), q_<joint> in DEGREES, u_<muscle> excitations and a_<muscle> activations, the
muscles under OpenSim's names. ``cmc`` is computed muscle control, ``so`` static optimization; ``_a`` the slow, ``_b``
the fast movement.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mjhcmc.activity import Activity
from mjhcmc.errors import MotionError, SettingsError
from mjhcmc.io.csv_table import read_csv
from mjhcmc.model import MuscleModel

SHIPPED = Path(__file__).resolve().parent / "reference"
"""The tables, with their origin and licence in a README.md."""

REFERENCE_FOLDER = Path("shared") / "reference" / "opensim_cmc"
"""What the tables were made from, seen from the folder that holds the checkout: not shipped."""

CMC_FLOOR = 0.02
"""The least activation in CMC's results."""

INITIALISATION = 0.03
"""s, what CMC takes to begin: to be left out of comparisons."""

_METHODS = {"cmc": "cmc", "static": "so"}
_MOVEMENTS = {"slow": "a", "fast": "b"}


@dataclass(frozen=True, eq=False)
class OpenSimRun:
    """What OpenSim found.

    Attributes:
        time: (T,) s, increasing.
        activation: (T, n_muscle), in the order of muscle_names.
        muscle_names: (n_muscle,) the model's names, in the model's order; only those that the table has.
        excitation: (T, n_muscle), None where the table has none.
        qpos: (T, nq) rad, None where the table has none.
    """

    time: NDArray[np.float64]
    activation: NDArray[np.float64]
    muscle_names: tuple[str, ...]
    excitation: NDArray[np.float64] | None = None
    qpos: NDArray[np.float64] | None = None

    @property
    def activity(self) -> Activity:
        """The same, to lay over a figure."""
        return Activity(self.time, self.muscle_names, self.activation, self.excitation)


def find_reference() -> Path | None:
    """The folder beside OpenSim's model of the leg and its inverse dynamics, None where there is none.

    Benchmarks need it; `read_reference` does not. It is looked for beside the checkout that the package runs from;
    where it does not run from a checkout, beside the current folder.
    """
    root = Path(__file__).resolve().parents[1]
    beside = root if (root / "pyproject.toml").is_file() else Path.cwd()
    folder = beside.parent / REFERENCE_FOLDER
    return folder if folder.is_dir() else None


def read_reference(
    model: MuscleModel, movement: str, method: str = "cmc", folder: str | Path | None = None
) -> OpenSimRun | None:
    """OpenSim's result on a cosine movement, None where the folder has no such table.

    Args:
        model: whose joints and muscles the table's columns are matched with.
        movement: ``"slow"`` or ``"fast"``.
        method: ``"cmc"`` or ``"static"``.
        folder: of the tables; by default those that are shipped.

    Raises:
        SettingsError: an unknown movement or method.
        MotionError: the table is there, but cannot be read (see `read_run`).
    """
    for what, value, valid in (("movement", movement, _MOVEMENTS), ("method", method, _METHODS)):
        if value not in valid:
            raise SettingsError(f"OpenSim's results: no {what} {value!r}: choose one of {', '.join(valid)}")
    path = (SHIPPED if folder is None else Path(folder)) / f"{_METHODS[method]}_{_MOVEMENTS[movement]}.csv"
    return read_run(path, model) if path.exists() else None


def read_run(path: str | Path, model: MuscleModel) -> OpenSimRun:
    """Read one table; see the module's docstring.

    Columns that belong to no joint and no muscle of the model are passed over.

    Raises:
        MotionError: the file cannot be read; it has no activation of any of the model's muscles, or excitations or
            angles of only some of the muscles or joints it should have; a value is not finite; times do not increase.
    """
    path = Path(path)
    table = read_csv(path)
    values = dict(zip(table.columns, table.values.T, strict=True))
    names = {muscle: model.opensim.muscles.get(muscle, muscle) for muscle in model.muscle_names}
    muscles = tuple(muscle for muscle in names if f"a_{names[muscle]}" in values)
    if not muscles:
        raise MotionError(
            f"{path}: no activation of a muscle of model {model.name!r} among {', '.join(table.columns[:12])}: name "
            f"columns a_<muscle>, such as a_{next(iter(names.values()))}"
        )
    used = {"a": [f"a_{names[muscle]}" for muscle in muscles], "u": [f"u_{names[muscle]}" for muscle in muscles]}
    used["q"] = [f"q_{joint}" for joint in model.joint_names]
    found: dict[str, NDArray[np.float64]] = {}
    for kind, columns in used.items():
        missing = [column for column in columns if column not in values]
        if len(missing) == len(columns):
            continue
        if missing:
            raise MotionError(f"{path}: no column {missing[0]!r}, but others of its kind: add it, or leave out all")
        found[kind] = np.column_stack([values[column] for column in columns])
    for kind, block in {"time": table.time[:, None], **found}.items():
        bad = np.argwhere(~np.isfinite(block))
        if bad.size:
            row, column = bad[0]
            label = "time" if kind == "time" else used[kind][column]
            raise MotionError(
                f"{path}, line {table.line_numbers[row]}, column {label!r}: {block[row, column]}: give finite numbers"
            )
    late = np.flatnonzero(np.diff(table.time) <= 0)
    if late.size:
        raise MotionError(
            f"{path}, line {table.line_numbers[late[0] + 1]}: time {table.time[late[0] + 1]:g} s follows "
            f"{table.time[late[0]]:g} s: put the rows in order, each time once"
        )
    qpos = found.get("q")
    if qpos is not None:
        qpos = np.where(model.joint_is_rotation, np.deg2rad(qpos), qpos)
    return OpenSimRun(table.time, found["a"], muscles, found.get("u"), qpos)

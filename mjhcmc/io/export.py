"""A solution as the two tables with which OpenSim drives its own model: controls and states."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MjhcmcWarning, OutputError
from mjhcmc.io.files import written_whole
from mjhcmc.io.opensim import table_text

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel
    from mjhcmc.solution import Solution

_STEP = 1e-6  # of a window: how long before its end the last of its two rows of controls stands

Array = NDArray[np.float64]


def export_opensim(solution: Solution, stem: str | Path) -> list[Path]:
    """Write ``<stem>_controls.sto`` and ``<stem>_states.sto`` for OpenSim, both or neither.

    Names and signs are OpenSim's where the model ships them in custom texts: ``opensim_paths`` (joint=path),
    ``opensim_muscles`` (muscle=name), and ``opensim_coordinates``, whose leading ``-`` flips a joint's value and speed
    under its path. A joint or muscle without goes by its own name, and a joint's path is then
    ``/jointset/<joint>/<joint>``; a joint that an equality constraint ties to others is left out where it has no path:
    OpenSim's twin of the model has no such coordinate, or moves it by itself. SI units and radians (inDegrees=no).

    Controls: a column a muscle, the excitation. It is constant over a window, and OpenSim interpolates linearly, so
    each window has two rows, one where it begins and one a millionth of it before the next begins. OpenSim 4.6 then
    takes the steps as they are: PrescribedController with its default and with interpolation_method 0 or 1, and
    ControlSet. Only its splines (interpolation_method 3 and 5) swing wildly at steps: leave them be.

    States: a row a node; ``<path>/value`` and ``<path>/speed`` of each joint, ``/forceset/<muscle>/activation``, and,
    where the model ships ``pennation_angles``, ``/forceset/<muscle>/fiber_length`` in m. MuJoCo's tendon is rigid and
    its muscle has no pennation, so the fiber length is that of a rigid tendon at its slack length, with fibers of
    constant thickness: l = sqrt(l_t^2 + (lopt sin alpha)^2), l_t along the tendon (Zajac 1989). To an OpenSim muscle
    with a compliant tendon that is no equilibrium: call ``equilibrateMuscles`` before simulating. Without the pennation
    the column is left out. OpenSim clamps activations below its muscles' minimum_activation (.01 by default) to it.

    Args:
        solution: what to write, with its model.
        stem: path without ``_controls.sto``; files of these names are replaced.

    Returns:
        The paths written, controls first.

    Raises:
        OutputError: the solution does not know its model (it was read from a file without one), a ball or free joint, a
            name that OpenSim cannot read, or files that cannot be written.
    """
    stem = Path(stem)
    model = solution.model
    if model is None:
        raise OutputError(
            f"{stem}: cannot be written, the solution was read from a file and does not know its model: read it with "
            "Solution.load(path, model=...)"
        )
    check_names(model)
    tables = {
        stem.with_name(f"{stem.name}_controls.sto"): ("controls", *_controls(solution, model)),
        stem.with_name(f"{stem.name}_states.sto"): ("states", *_states(solution, model)),
    }
    texts = {}
    for path, (name, time, columns) in tables.items():
        if path.is_dir():
            raise OutputError(f"{path}: cannot be written, it is a folder: choose another name")
        values = np.column_stack(list(columns.values()))
        texts[path] = table_text(path, list(columns), time, values, name=name, in_degrees=False)
    with ExitStack() as stack:  # each is put in place when the block ends, so after both are written
        for path, text in texts.items():
            stack.enter_context(written_whole(path)).write_text(text, encoding="utf-8", newline="\n")
    return list(texts)


def check_names(model: MuscleModel) -> None:
    """See that OpenSim can read what an export of this model would hold, before the work begins.

    Raises:
        OutputError: a ball or free joint, or a name with a blank.
    """
    if model.quaternions:
        joint = model.joint_names[model.quaternions[0]].removesuffix("_qw")
        raise OutputError(
            f"model {model.name!r}: joint {joint!r} turns by a quaternion, and the states of OpenSim "
            "are angles: model it as hinges and slides, or solve without the export for OpenSim"
        )
    joints = [model.opensim.paths.get(model.joint_names[j], model.joint_names[j]) for j in _exported(model)]
    muscles = [model.opensim.muscles.get(muscle, muscle) for muscle in model.muscle_names]
    for name in (*joints, *muscles):
        if len(name.split()) != 1:
            raise OutputError(
                f"model {model.name!r}: {name!r} cannot be written: OpenSim's names hold no blanks: rename that joint "
                "or muscle in the model"
            )


def _exported(model: MuscleModel) -> list[int]:
    """Coordinates that an export holds: all but dependent ones without a path."""
    tied = set(model.roles.dependent.tolist())
    return [j for j, name in enumerate(model.joint_names) if j not in tied or name in model.opensim.paths]


def _controls(solution: Solution, model: MuscleModel) -> tuple[Array, dict[str, Array]]:
    """(2N,) s, and each muscle's excitation there."""
    start, end = solution.time[:-1], solution.time[1:].copy()
    end[:-1] -= _STEP * np.diff(solution.time)[:-1]  # the last window ends at the last node itself
    time = np.column_stack([start, end]).ravel()
    names = model.opensim.muscles
    return time, {
        names.get(name, name): np.repeat(solution.excitation[:, i], 2) for i, name in enumerate(solution.muscle_names)
    }


def _states(solution: Solution, model: MuscleModel) -> tuple[Array, dict[str, Array]]:
    """(N+1,) s, and each state there, in OpenSim's order."""
    columns: dict[str, Array] = {}
    for j in _exported(model):  # hinges and slides only: coordinate j moves by speed j
        joint = model.joint_names[j]
        path = model.opensim.paths.get(joint)
        flipped = path is not None and model.column_map.get(joint, "").startswith("-")
        for kind, values in (("value", solution.qpos), ("speed", solution.qvel)):
            label = f"{path or f'/jointset/{joint}/{joint}'}/{kind}"
            columns[label] = (0.0 - values[:, j]) if flipped else values[:, j]  # 0 - x: no -0.0
    fiber_length = _fiber_length(solution, model.opensim.pennation)
    for i, muscle in enumerate(model.muscle_names):
        path = f"/forceset/{model.opensim.muscles.get(muscle, muscle)}"
        columns[f"{path}/activation"] = solution.activation[:, i]
        if muscle in fiber_length:
            columns[f"{path}/fiber_length"] = fiber_length[muscle]
    return solution.time, columns


def _fiber_length(solution: Solution, pennation: Mapping[str, float]) -> dict[str, Array]:
    """(N+1,) m by muscle, of those whose pennation is known, from their fiber lengths along the tendon."""
    if not pennation:
        return {}
    with warnings.catch_warnings(action="ignore", category=MjhcmcWarning):  # of joint reactions, not asked for here
        detail = solution.detail
    along = detail.fiber_length
    optimal = along[0] / detail.normalized_fiber_length[0]  # lopt cos alpha
    return {
        muscle: np.hypot(along[:, i], optimal[i] * math.tan(pennation[muscle]))
        for i, muscle in enumerate(solution.muscle_names)
        if muscle in pennation and np.isfinite(along[:, i]).all()
    }

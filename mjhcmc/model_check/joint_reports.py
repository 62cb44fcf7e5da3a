"""Joints of a model report: roles, what they follow, how far they can go, how strong the muscles are there."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mjhcmc.model_check.report import DofReport, JointReport
from mjhcmc.model_check.scan import Pose, ScanPlant, Sweep, scanned_range
from mjhcmc.model_problems import joint_names_of, joint_type

_OUT = 1e-3  # rad or m, beyond its range
_AT = 1e-6  # likewise, of what is tied: where constraints put it
_HALVINGS = 12

Array = NDArray[np.float64]


def joint_reports(
    plant: ScanPlant, reference: Pose, sweeps: Mapping[int, Sweep], crosses: NDArray[np.bool_], pushed: Array
) -> tuple[JointReport, ...]:
    """One for each joint of the plant's model.

    Args:
        plant: of the model.
        reference: what muscles do at the reference pose.
        sweeps: by joint, for hinges and slides that are tracked.
        crosses: (n_muscle, nv) whether a muscle has a moment arm about a degree of freedom.
        pushed: (nv,) N m or N, by limits and contacts at the reference pose.
    """
    model, m = plant.model, plant.model.mj_model
    names, joints = joint_names_of(m), plant.ties.joints
    result = []
    for j, name in enumerate(names):
        dofs = np.flatnonzero(m.dof_jntid == j)
        kind, one = joint_type(m, j), sweeps.get(j)
        unit = {"hinge": "rad", "slide": "m"}.get(kind)
        leader = joints.follows.get(j)
        low, high = model.joint_range[m.jnt_qposadr[j]]
        at = float(plant.reference[m.jnt_qposadr[j]])
        bounded = unit is not None and bool(np.isfinite(low) and np.isfinite(high))
        near = 1e-9 if model.roles.of[dofs[0]] != "dependent" else _AT
        usable, first_out = (None, ()) if one is None else _usable(plant, one, names)
        result.append(
            JointReport(
                name=name,
                type=kind,
                dofs=tuple(_dof_report(plant, reference, int(i), float(pushed[i])) for i in dofs),
                follows=None if leader is None else names[leader] if leader >= 0 else "",
                polynomial=None if leader is None else tuple(joints.coefficients[j]),
                unit=unit,
                range=(float(low), float(high)) if bounded else None,
                usable=usable,
                first_out=first_out,
                reference_outside=at if bounded and not low - near <= at <= high + near else None,
                damping=float(m.dof_damping[dofs[0]]),
                column=model.column_map.get(name),
                scanned=None if one is None else (float(one.position[0]), float(one.position[-1])),
                strength=None if one is None else _pair(reference.strength[dofs[0]]),
                negative_strength_range=None if one is None else _extremes(one.strength[:, 0]),
                positive_strength_range=None if one is None else _extremes(one.strength[:, 1]),
                passive_moment=None if one is None else float(reference.passive[dofs[0]]),
                muscles=tuple(model.muscle_names[i] for i in np.flatnonzero(crosses[:, dofs].any(axis=1))),
            )
        )
    return tuple(result)


def _dof_report(plant: ScanPlant, reference: Pose, dof: int, pushed: float) -> DofReport:
    role = plant.model.roles.of[dof]
    strength = _pair(reference.strength[dof]) if role == "tracked" else None
    return DofReport(plant.model.dof_names[dof], str(role), strength, pushed)


def _usable(plant: ScanPlant, one: Sweep, names: tuple[str, ...]) -> tuple[tuple[float, float] | None, tuple[str, ...]]:
    """Between which positions of a swept joint what is tied stays within its ranges, and what leaves them first."""
    model, m = plant.model, plant.model.mj_model
    dependent = set(model.roles.dependent.tolist())
    joints = [
        j
        for j in range(m.njnt)
        if int(m.jnt_dofadr[j]) in dependent and m.jnt_limited[j] and joint_type(m, j) in ("hinge", "slide")
    ]
    low, high = m.jnt_range[joints].T
    columns = m.jnt_qposadr[joints]

    def out(qpos: Array | None) -> NDArray[np.bool_]:
        if qpos is None:
            return np.ones(len(joints), dtype=bool)
        return np.asarray((qpos[columns] < low - _OUT) | (qpos[columns] > high + _OUT))

    def end(order: range) -> tuple[float, list[str]]:
        last = order[0]
        for k in order:
            if out(one.qpos[k]).any():
                good, bad, pose = one.position[last], one.position[k], one.qpos[k]
                for _ in range(_HALVINGS):
                    middle = (good + bad) / 2
                    there = plant.moved(one.joint, middle, one.qpos[last])
                    if out(there).any():
                        bad, pose = middle, pose if there is None else there
                    else:
                        good = middle
                return float(good), [names[joints[i]] for i in np.flatnonzero(out(pose))]
            last = k
        return float(one.position[order[-1]]), []

    home = int(np.abs(one.position - plant.reference[m.jnt_qposadr[one.joint]]).argmin())
    if out(one.qpos[home]).any():
        return None, ()
    (least, below), (most, above) = end(range(home, -1, -1)), end(range(home, len(one.position)))
    reached = np.array(scanned_range(model, one.joint))
    whole = np.abs(reached - [least, most]).max() < 1e-9
    return (None if whole else (least, most)), tuple(dict.fromkeys([*below, *above]))


def _pair(values: Array) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _extremes(values: Array) -> tuple[float, float]:
    return float(values.min()), float(values.max())

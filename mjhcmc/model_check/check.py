"""What mjhcmc sees in a model: muscles, joints, strength, the stable step, and every problem with its remedy."""

from __future__ import annotations

import copy
import inspect
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.log import get_logger
from mjhcmc.model import MuscleModel, compile_model, engine_integrator, read_model
from mjhcmc.model_check.findings import findings
from mjhcmc.model_check.joint_reports import joint_reports
from mjhcmc.model_check.pushes import find_pushes
from mjhcmc.model_check.report import ModelReport, MuscleReport, StepReport
from mjhcmc.model_check.scan import (
    Jump,
    Pose,
    ScanPlant,
    Sweep,
    decay,
    fastest,
    find_jumps,
    measure,
    sweep,
)
from mjhcmc.model_check.ties import equalities
from mjhcmc.model_problems import find_problems, joint_names_of, names_of
from mjhcmc.plant import RK4_LIMIT, MujocoPlant

__all__ = ["check"]

_DEFAULT_PHYSICS_DT = float(inspect.signature(MujocoPlant).parameters["physics_dt"].default)
_CROSSES = 1e-3  # m, and share of the muscle's largest moment arm
_JUMP = 1e-3  # share of L0, or of the change of length over the range where there is no L0
_FEW_JOINTS = 20

_log = get_logger(__name__)


def check(source: str | Path | Any) -> ModelReport:
    """Look at a model before solving with it.

    Strength is isometric: at rest, the sum over the muscles of R_ij F_i a_i, the agonists being at the upper end of
    their excitation range, the antagonists at its lower end: where that is above 0, they take their share away. Every
    tracked hinge and slide is moved through its range with the others at the reference pose; what equality constraints
    tie to it follows, and counts as part of it. The largest stable step is 2.78 over the largest real eigenvalue part
    of M^-1 D (classical Runge-Kutta), with D the damping of joints, tendons and muscles, M and D seen from what is
    neither tied nor prescribed.

    Args:
        source: what `MuscleModel.load` takes.

    Returns:
        The report; of a model that solve refuses, too, with what keeps it from being solved.

    Raises:
        ModelError: MuJoCo cannot load it, or it has no muscle.
    """
    if isinstance(source, MuscleModel):
        m, name = copy.deepcopy(source.mj_model), source.name
    else:
        m, name = compile_model(source)
    errors = find_problems(m, name)
    integrator = engine_integrator(m)
    model = read_model(m, name)
    plant = ScanPlant(model)
    measured = _measure(plant)
    pushes = find_pushes(plant, measured.reference)
    report = ModelReport(
        name=name,
        engine=f"MuJoCo {mujoco.__version__}",
        solvable=not errors,
        total_mass=float(m.body_mass.sum()),
        gravity=(float(m.opt.gravity[0]), float(m.opt.gravity[1]), float(m.opt.gravity[2])),
        integrator=integrator,
        muscles=_muscle_reports(model, measured),
        joints=joint_reports(plant, measured.reference, measured.sweeps, measured.crosses, pushes.pushed),
        other_actuators=int(m.nactuator) - model.n_muscle,
        equalities=equalities(model),
        reference_missed=plant.missed,
        joint_limits=int(m.jnt_limited.sum()),
        tendon_limits=int(m.tendon_limited.sum()),
        colliding_pairs=_colliding_pairs(m),
        contacts=pushes.contacts,
        keyframes=names_of(m, mujoco.mjtObj.mjOBJ_KEY, range(m.nkey), "key"),
        default_physics_dt=_DEFAULT_PHYSICS_DT,
        steps=(_step_report(plant, measured.sweeps, 0.0), _step_report(plant, measured.sweeps, 1.0)),
        problems=errors,
    )
    found = findings(report, measured.jumps)
    _log.info("model %r checked: %d errors, %d warnings and notes", name, len(errors), len(found))
    return replace(report, problems=(*errors, *found))


@dataclass(frozen=True)
class _Measured:
    """A model at its reference pose and over its joints' ranges.

    Attributes:
        reference: at the reference pose.
        sweeps: by joint, for hinges and slides.
        crosses: (n_muscle, nv) whether a muscle has a moment arm about a degree of freedom.
        length_range: (n_muscle, 2) m.
        jumps: in the muscles' lengths.
    """

    reference: Pose
    sweeps: dict[int, Sweep]
    crosses: NDArray[np.bool_]
    length_range: NDArray[np.float64]
    jumps: list[Jump]


def _measure(plant: ScanPlant) -> _Measured:
    model = plant.model
    reference = measure(plant, plant.reference)
    count = 61 if len(plant.joints) <= _FEW_JOINTS else 31
    sweeps = {j: one for j in plant.joints if (one := sweep(plant, j, count)) is not None}
    arm = np.max([np.abs(reference.arm), *[one.largest_arm for one in sweeps.values()]], axis=0)
    largest = arm.max(axis=1, keepdims=True, initial=0.0)
    lengths = np.vstack([reference.length[None], *[one.length for one in sweeps.values()]])
    spread = np.stack([lengths.min(axis=0), lengths.max(axis=0)], axis=1)
    L0 = model.optimal_fiber_length
    tolerance = _JUMP * np.where(L0 > 0, L0, np.maximum(np.ptp(spread, axis=1), 1e-9))
    return _Measured(
        reference=reference,
        sweeps=sweeps,
        crosses=arm > np.minimum(_CROSSES, _CROSSES * largest),
        length_range=spread,
        jumps=[jump for one in sweeps.values() for jump in find_jumps(plant, one, tolerance)],
    )


def _muscle_reports(model: MuscleModel, measured: _Measured) -> tuple[MuscleReport, ...]:
    m, ids = model.mj_model, model.muscle_ids
    force, L0 = model.max_isometric_force, model.optimal_fiber_length
    dof_joint, names = m.dof_jntid, joint_names_of(m)
    result = []
    for i, name in enumerate(model.muscle_names):
        a = int(ids[i])
        prm, range_low, start = m.actuator_gainprm[a], m.actuator_gainprm[a, 0], m.actuator_lengthrange[a, 0]
        fiber = limits = spread = None
        if L0[i] > 0:
            in_L0 = range_low + (np.array([measured.reference.length[i], *measured.length_range[i]]) - start) / L0[i]
            fiber, spread = float(in_L0[0]), (float(in_L0[1]), float(in_L0[2]))
            limits = (float(prm[4]), float(prm[5]))
        is_muscle = m.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_MUSCLE
        crossed = dict.fromkeys(names[j] for j in dof_joint[measured.crosses[i]])
        tau = model.activation_parameters[i]
        result.append(
            MuscleReport(
                name=name,
                gain=str(mujoco.mjtGain(m.actuator_gaintype[a]).name.removeprefix("mjGAIN_").lower()),
                max_isometric_force=float(force[i]) if np.isfinite(force[i]) else None,
                optimal_fiber_length=float(L0[i]) if L0[i] > 0 else None,
                fiber_length=fiber,
                fiber_length_range=spread,
                force_length_limits=limits,
                leaves_limits=None if spread is None or limits is None else _leaves(spread, limits),
                max_velocity=float(prm[6]) if is_muscle else None,
                activation_time=float(tau[0]),
                deactivation_time=float(tau[1]),
                smoothing=float(tau[2]),
                excitation_range=_pair(model.excitation_range[i]),
                force_range=_pair(-m.actuator_forcerange[a, ::-1]) if m.actuator_forcelimited[a] else None,
                joints=tuple(crossed),
            )
        )
    return tuple(result)


def _leaves(spread: tuple[float, float], limits: tuple[float, float]) -> bool:
    return spread[0] < limits[0] or spread[1] > limits[1]


def _pair(values: NDArray[np.float64]) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _step_report(plant: ScanPlant, sweeps: dict[int, Sweep], activation: float) -> StepReport:
    names, count = joint_names_of(plant.mj_model), 9 if len(plant.joints) <= _FEW_JOINTS else 2
    if not len(plant.driven):
        return StepReport(activation, None, None, None, None, None)
    reference = worst = decay(plant, plant.reference, activation)
    pose, at = plant.reference, None
    for j, one in sweeps.items():
        for k in np.unique(np.linspace(0, len(one.position) - 1, count).round().astype(int)):
            rate = decay(plant, one.qpos[k], activation)
            if rate > worst * (1 + 1e-9):
                worst, pose, at = rate, one.qpos[k], (names[j], float(one.position[k]))
    return StepReport(
        activation=activation,
        at_reference=RK4_LIMIT / reference if reference > 0 else None,
        over_range=RK4_LIMIT / worst if worst > 0 else None,
        worst_joint=at[0] if at else None,
        worst_position=at[1] if at else None,
        fastest=plant.model.dof_names[fastest(plant, pose, activation)] if worst > 0 else None,
    )


def _colliding_pairs(m: Any) -> int:
    """Pairs of geoms that the model's masks let collide; explicit pairs count, excluded bodies are not taken away."""
    bit = mujoco.mjtDisableBit
    if m.opt.disableflags & (int(bit.mjDSBL_CONTACT) | int(bit.mjDSBL_CONSTRAINT)):
        return 0
    body = m.body_weldid[m.geom_bodyid]
    parent = m.body_weldid[m.body_parentid[body]]
    mask = (m.geom_contype[:, None] & m.geom_conaffinity[None]) != 0
    mask = (mask | mask.T) & (body[:, None] != body[None])
    if not m.opt.disableflags & int(bit.mjDSBL_FILTERPARENT):
        child = (parent[:, None] == body[None]) & (body[None] != 0)
        mask &= ~(child | child.T)
    return int(np.triu(mask, 1).sum()) + int(m.npair)

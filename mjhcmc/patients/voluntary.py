"""Movements by will, through HCMC, by people whose reflexes and spill-over come on top.

The person moves as meant; tone, reflexes and the spill-over of each muscle's excitation to its antagonists are imposed
(see `mjhcmc.imposed`), and the other muscles work against them. Reflexes follow from the fibers' velocities along the
movement and, of force reflexes, from the forces of the pass before; spill-over from the excitations of that pass.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MjhcmcError, MjhcmcWarning
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.imposed import Imposed
from mjhcmc.leg8.table import JOINTS
from mjhcmc.methods.hcmc_batch import hcmc_batch
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.patients.bench import CURVES, Case
from mjhcmc.patients.drive import ANTAGONISTS, Drive, drive_of
from mjhcmc.patients.record import Record
from mjhcmc.patients.reflex import ReflexLaw, reflex_along
from mjhcmc.solution import Solution

Array = NDArray[np.float64]

PASSES = 2
"""The first without spill-over; reflexes of velocity are the same in all."""


def move(
    cases: Sequence[Case],
    motions: Sequence[Motion],
    loads: Sequence[ExternalLoads | None] | None = None,
    *,
    dt: float = 0.01,
    physics_dt: float = 0.005,
    threads: int = 1,
) -> list[Record]:
    """Let patients move.

    Args:
        cases: patients with models of one structure, and their trials.
        motions: what each means to do, on the case's model.
        loads: what acts on each from outside; None: nothing.
        dt: s, control window of `hcmc`.
        physics_dt: s, physics step.
        threads: to compute on.

    Returns:
        A record for each, sampled every dt; one that fails names the reason.
    """
    models, kind = [case.model for case in cases], cases[0].patient.muscle
    drives = [drive_of(case.patient, case.trial.session) for case in cases]
    nodes = [motion.start + dt * np.arange(int(motion.duration / dt + 1e-6) + 1) for motion in motions]
    paths = [_fibers(model, motion, time) for model, motion, time in zip(models, motions, nodes, strict=True)]
    spill: list[Array] = [np.zeros_like(speed) for _, speed in paths]
    force: list[Array | None] = [None] * len(cases)
    results: list[Solution | MjhcmcError] = []
    reflexes: list[Array] = []
    for _ in range(PASSES):
        reflexes = [
            _reflex(drive, time, speed, pulled, model)
            for drive, time, (_, speed), pulled, model in zip(drives, nodes, paths, force, models, strict=True)
        ]
        imposed = [
            Imposed(_whole(time, motion), np.clip(drive.tone + reflex + extra, 0.0, 1.0))
            for time, motion, drive, reflex, extra in zip(nodes, motions, drives, reflexes, spill, strict=True)
        ]
        results = _solve(models, motions, loads, imposed, dt, physics_dt, kind, threads)
        for i, (found, drive) in enumerate(zip(results, drives, strict=True)):
            if isinstance(found, Solution):
                u = np.vstack([found.excitation, found.excitation[-1:]])
                spill[i] = drive.cocontraction * (u @ ANTAGONISTS)
                force[i] = found.muscle_force
    return [
        _record(case, time, path, reflex, found)
        for case, time, path, reflex, found in zip(cases, nodes, paths, reflexes, results, strict=True)
    ]


def _solve(
    models: Sequence[MuscleModel],
    motions: Sequence[Motion],
    loads: Sequence[ExternalLoads | None] | None,
    imposed: Sequence[Imposed],
    dt: float,
    physics_dt: float,
    kind: str,
    threads: int,
) -> list[Solution | MjhcmcError]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MjhcmcWarning)  # failures are in the records
            batch = hcmc_batch(
                models, motions, dt, physics_dt, threads=threads, imposed=imposed, muscle=kind, curves=CURVES,
                loads=loads,  # type: ignore[arg-type]
            )  # fmt: skip
    except MjhcmcError as error:
        return [error] * len(models)
    return [batch.errors[i] if i in batch.errors else batch[i] for i in range(len(models))]


def _whole(time: Array, motion: Motion) -> Array:
    """The nodes, the last one moved to the motion's end, which a window that is left out may lie beyond."""
    stretched = time.copy()
    stretched[-1] = max(motion.end, time[-1])
    return stretched


def _fibers(model: MuscleModel, motion: Motion, time: Array) -> tuple[Array, Array]:
    """Lengths and velocities (n, n_muscle) along a motion, in optimal lengths (a second), of rigid tendons."""
    at, m = motion.sample(np.minimum(time, motion.end)), model.mj_model
    d, columns = mujoco.MjData(m), m.actuator_outadr[model.muscle_ids]
    length, speed = np.empty((len(time), model.n_muscle)), np.empty((len(time), model.n_muscle))
    for k, (q, v) in enumerate(zip(at.qpos, at.qvel, strict=True)):
        d.qpos[:], d.qvel[:] = q, v
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        length[k], speed[k] = d.actuator_length[columns], d.actuator_velocity[columns]
    L0 = model.optimal_fiber_length
    first, shortest = m.actuator_gainprm[model.muscle_ids, 0], m.actuator_lengthrange[model.muscle_ids, 0]
    return first + (length - shortest) / L0, speed / L0


def _reflex(drive: Drive, time: Array, speed: Array, pulled: Array | None, model: MuscleModel) -> Array:
    period = float(time[1] - time[0])
    law = ReflexLaw(
        drive.mode, drive.gain[None], drive.threshold[None], np.array([max(drive.delay - period / 2, 0.0)]), period
    )
    force = None
    if drive.mode == "force":
        force = np.zeros_like(speed) if pulled is None else pulled / model.max_isometric_force
    return np.asarray(reflex_along(law, time, speed, force))


def _record(
    case: Case, time: Array, path: tuple[Array, Array], reflex: Array, found: Solution | MjhcmcError
) -> Record:  # fmt: skip
    if not isinstance(found, Solution):
        return Record.missing(case.trial, f"{case.trial.name}: {found}")
    joints = [case.model.dof_names.index(joint) for joint in JOINTS]
    since = found.time - found.time[0]
    qvel = np.asarray(found.qvel)[:, joints]
    peak = np.abs(found.net_joint_moment[:, joints]).max(axis=0)
    share = np.abs(found.reserve[:, joints]).max(axis=0) / np.maximum(peak, 1e-9)
    return Record(
        case.trial, since, found.qpos[:, joints], qvel, np.gradient(qvel, since, axis=0),
        np.zeros((len(since), len(JOINTS))), 0.0, np.vstack([found.excitation, found.excitation[-1:]]), reflex,
        found.activation, *path, found.muscle_force, reserve_share=float(share.max()),
    )  # fmt: skip

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

from mjhcmc.checks import is_number
from mjhcmc.errors import MjhcmcError, MjhcmcWarning, SettingsError, SimulationError
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.hosted.muscles import hosted_muscles
from mjhcmc.imposed import Imposed
from mjhcmc.leg8.table import JOINTS
from mjhcmc.methods.hcmc_batch import hcmc_batch
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.patients.bench import CURVES, Case, fibers_of
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

    Raises:
        SettingsError: sequences of different lengths, patients of different muscles, a dt that is not positive.
    """
    kinds = {case.patient.muscle for case in cases}
    if not (len(cases) == len(motions) and (loads is None or len(loads) == len(cases))):
        raise SettingsError(f"{len(cases)} patients move by {len(motions)} motions: give one each, and loads for each")
    if not cases:
        return []
    if len(kinds) > 1:
        raise SettingsError(f"patients of different muscles ({', '.join(sorted(kinds))}) move in calls of their own")
    if not (is_number(dt) and dt > 0):
        raise SettingsError(f"dt must be a positive number of seconds; got {dt!r}")
    kind = kinds.pop()
    drives = [drive_of(case.patient, case.trial.session) for case in cases]
    nodes = [np.asarray(m.start + dt * np.arange(int(m.duration / dt + 1e-6) + 1), dtype=np.float64) for m in motions]
    paths = [_fibers(case, motion, time) for case, motion, time in zip(cases, motions, nodes, strict=True)]
    found: dict[int, Solution | MjhcmcError] = {}
    reflexes: dict[int, Array] = {}
    for attempt in range(PASSES):
        imposed = {}
        for i, case in enumerate(cases):
            before = found.get(i)
            if isinstance(before, MjhcmcError):
                continue
            reflexes[i] = _reflex(drives[i], nodes[i], paths[i][1], before, case.model)
            spill = 0.0 if before is None else drives[i].cocontraction * (_at_nodes(before.excitation) @ ANTAGONISTS)
            floor = np.clip(drives[i].tone + reflexes[i] + spill, 0.0, 1.0)
            imposed[i] = Imposed(_whole(nodes[i], motions[i]), floor)
        if imposed:
            some = [(cases[i].model, motions[i], None if loads is None else loads[i]) for i in imposed]
            first = attempt == 0  # for what spills over, MuJoCo's muscles will do
            muscle = "mujoco" if first else kind
            solved = _solve(some, list(imposed.values()), dt, physics_dt, muscle, threads)
            found.update(zip(imposed, solved, strict=True))
    return [_record(case, paths[i], reflexes[i], found[i]) for i, case in enumerate(cases)]


def _at_nodes(u: Array) -> Array:
    """(N + 1, n) at the nodes, of what is constant over the windows after them."""
    return np.vstack([u, u[-1:]])


def _solve(
    some: Sequence[tuple[MuscleModel, Motion, ExternalLoads | None]],
    imposed: Sequence[Imposed],
    dt: float,
    physics_dt: float,
    kind: str,
    threads: int,
) -> list[Solution | MjhcmcError]:
    models, motions, loads = zip(*some, strict=True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MjhcmcWarning)  # failures are in the records
            batch = hcmc_batch(
                models, motions, dt, physics_dt, threads=threads, imposed=imposed, muscle=kind, curves=CURVES,
                loads=loads if any(one is not None for one in loads) else None,
            )  # fmt: skip
    except MjhcmcError as error:  # no one could be solved: with the first one's reason
        return [error] * len(some)
    found = [batch.errors[i] if i in batch.errors else batch[i] for i in range(len(some))]
    return [_checked(one) for one in found]


def _checked(found: Solution | MjhcmcError) -> Solution | MjhcmcError:
    if isinstance(found, Solution) and not all(
        np.isfinite(part).all() for part in (found.excitation, found.activation, found.qpos, found.muscle_force)
    ):
        return SimulationError("the movement's solution holds values that are not finite")
    return found


def _whole(time: Array, motion: Motion) -> Array:
    """The nodes, the last one moved to the motion's end, which a window that is left out may lie beyond."""
    stretched = time.copy()
    stretched[-1] = max(motion.end, time[-1])
    return stretched


def _fibers(case: Case, motion: Motion, time: Array) -> tuple[Array, Array]:
    """Lengths and velocities (n, n_muscle) of the muscles in use along a motion, in optimal lengths (a second).

    Of Hill muscles as if their tendons were rigid.
    """
    at, model = motion.sample(np.minimum(time, motion.end)), case.model
    m = model.mj_model
    d, columns = mujoco.MjData(m), m.actuator_outadr[model.muscle_ids]
    path = np.empty((len(time), model.n_muscle, 2))
    for k, (q, v) in enumerate(zip(at.qpos, at.qvel, strict=True)):
        d.qpos[:], d.qvel[:] = q, v
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        path[k, :, 0], path[k, :, 1] = d.actuator_length[columns], d.actuator_velocity[columns]
    hill = [] if case.patient.muscle == "mujoco" else [hosted_muscles(model, CURVES, "rigid")]
    ids, still = np.zeros(len(time), dtype=np.intp), np.zeros((len(time), model.n_muscle))
    return fibers_of([model], hill)(ids, still, still[:, :0], path)


def _reflex(drive: Drive, time: Array, speed: Array, before: Solution | None, model: MuscleModel) -> Array:
    """(N + 1, n) at the nodes, in the middle of the period after each; forces are those of the pass before."""
    period = float(time[1] - time[0])
    delay = np.array([max(drive.delay - period / 2, 0.0)])
    law = ReflexLaw(drive.mode, drive.gain[None], drive.threshold[None], delay, period)
    force = None
    if drive.mode == "force":
        force = np.zeros_like(speed) if before is None else before.muscle_force / model.max_isometric_force
    return np.asarray(reflex_along(law, time, speed, force))


def _record(
    case: Case, path: tuple[Array, Array], reflex: Array, found: Solution | MjhcmcError
) -> Record:  # fmt: skip
    if not isinstance(found, Solution):
        return Record.missing(case.trial, f"{case.trial.name}: {found}")
    if case.patient.muscle == "compliant":  # now it is known how the tendons stretch
        detail = found.detail
        path = detail.normalized_fiber_length, detail.normalized_fiber_velocity
    joints = [case.model.dof_names.index(joint) for joint in JOINTS]
    since = found.time - found.time[0]
    qvel = np.asarray(found.qvel)[:, joints]
    return Record(
        case.trial, since, found.qpos[:, joints], qvel, np.gradient(qvel, since, axis=0),
        np.zeros((len(since), len(JOINTS))), 0.0, _at_nodes(found.excitation), reflex,
        found.activation, *path, found.muscle_force, reserve=float(np.abs(found.reserve[:, joints]).max()),
    )  # fmt: skip

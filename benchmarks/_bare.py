"""MuJoCo alone over the physics steps of a solution: the floor that solves are measured against."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import mujoco.batch
import numpy as np

import mjhcmc


def one(solution: mjhcmc.Solution) -> Callable[[], None]:
    """mj_step through a solution's windows, its excitations and reserves applied; nothing else.

    Args:
        solution: one that knows its model.
    """
    model, n_step = _model(solution)
    data, index = mujoco.MjData(model), _muscles(solution)

    def run() -> None:
        data.time = 0.0
        data.qpos[:], data.qvel[:], data.act[index.act_index] = (
            solution.qpos[0],
            solution.qvel[0],
            solution.activation[0],
        )
        data.qacc_warmstart[:] = 0.0
        for k in range(solution.n_window):
            data.ctrl[index.ctrl_index] = solution.excitation[k]
            data.qfrc_applied[:] = solution.reserve[k]
            mujoco.mj_step(model, data, nstep=n_step)

    return run


def one_by_one(solutions: Sequence[mjhcmc.Solution]) -> Callable[[], None]:
    """The same for several, one after the other."""
    runs = [one(solution) for solution in solutions]

    def run() -> None:
        for step in runs:
            step()

    return run


def many(solutions: Sequence[mjhcmc.Solution], threads: int) -> Callable[[], None]:
    """The same in lock step on mujoco.batch: one call a window.

    Args:
        solutions: of as many windows each.
        threads: that step.
    """
    first, n_step = _model(solutions[0])
    index = _muscles(solutions[0])
    batch = mujoco.batch.Batch(first, len(solutions), nthread=threads)
    if any(solution.model is not solutions[0].model for solution in solutions):
        batch.set_models([_model(solution)[0] for solution in solutions])
    names = ("time", "qpos", "qvel", "act", "ctrl", "qfrc_applied", "qacc_warmstart")
    time, qpos, qvel, act, ctrl, applied, warm = (batch.bind(name) for name in names)
    start = [np.stack([getattr(s, name)[0] for s in solutions]) for name in ("qpos", "qvel", "activation")]
    excitation = np.stack([s.excitation for s in solutions], axis=1)
    reserve = np.stack([s.reserve for s in solutions], axis=1)

    def run() -> None:
        time[:] = 0.0
        qpos[:], qvel[:] = start[0], start[1]
        act[:, index.act_index] = start[2]
        warm[:] = 0.0
        for k in range(len(excitation)):
            ctrl[:, index.ctrl_index] = excitation[k]
            applied[:] = reserve[k]
            batch.step(nstep=n_step)

    return run


def _model(solution: mjhcmc.Solution) -> tuple[mujoco.MjModel, int]:
    """What is stepped, and the physics steps of a window."""
    step = solution.settings["physics_dt"]
    plant = mjhcmc.MujocoPlant(_muscles(solution), step, integrator=solution.integrator)
    return plant.mj_model, round(solution.dt / plant.physics_dt)


def _muscles(solution: mjhcmc.Solution) -> mjhcmc.MuscleModel:
    assert solution.model is not None
    return solution.model

"""Playing a solution again where MuJoCo's own rollout does not do: Hill muscles, measured loads, prescribed joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc.lockstep import Lockstep
from mjhcmc.plant import physics_steps
from mjhcmc.surroundings import Surroundings

if TYPE_CHECKING:
    from mjhcmc.solution import Solution

Array = NDArray[np.float64]

_AT_ONCE = 1024  # windows: bounds memory on long motions


def replay(solution: Solution, physics_dt: float) -> Array:
    """(N+1, nq) rad or m at the nodes, open loop from the first; see `verify.replay`."""
    plants, n_step = _plants(solution, physics_dt, 1)
    rows = plants.rows([solution.state(0)])
    found = [rows[0, plants.layout.qpos]]
    for k in range(solution.n_window):
        rows = plants.step(np.arange(1), rows, solution.excitation[[k]], solution.reserve[[k]], n_step)
        found.append(rows[0, plants.layout.qpos])
    return np.array(found)


def replay_windows(solution: Solution, physics_dt: float) -> Array:
    """(N+1, nq) rad or m at the nodes, each window from its recorded node; see `verify.replay_windows`."""
    found = [solution.qpos[:1]]
    for first in range(0, solution.n_window, _AT_ONCE):
        part = np.arange(first, min(first + _AT_ONCE, solution.n_window))
        plants, n_step = _plants(solution, physics_dt, len(part))
        rows = plants.rows([solution.state(int(k)) for k in part])
        ends = plants.step(np.arange(len(part)), rows, solution.excitation[part], solution.reserve[part], n_step)
        found.append(ends[:, plants.layout.qpos])
    return np.concatenate(found)


def _plants(solution: Solution, physics_dt: float, count: int) -> tuple[Lockstep, int]:
    model, muscles = solution.model, solution.muscles
    assert model is not None
    n_step = physics_steps(solution.dt, physics_dt)
    step, surroundings = solution.dt / n_step, [solution.surroundings or Surroundings()] * count
    if not solution.hosted:
        return Lockstep([model] * count, step, surroundings, integrator=solution.integrator), n_step
    from mjhcmc.hosted.lockstep import HillLockstep

    assert muscles is not None
    return HillLockstep([model] * count, [muscles], step, surroundings), n_step

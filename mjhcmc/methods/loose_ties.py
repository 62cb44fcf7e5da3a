"""Equalities that implicit integrators do not keep, told with what that does to the joint moments.

MuJoCo finds what keeps an equality for the inertia M, then divides by M + s D (see `integrators`), so dependent degrees
of freedom do not go as the others make them go. With N the tangent of the equalities (`coupling.Coupling`), A the
acceleration of the step that follows and q'' the one at the state, which the equalities are kept for, what dependents
miss is d = (A - q'') - N (A - q''). What keeps an equality does no work on motions that obey it, so the joints that
move the others meet N^T M d on top of their own moment. How soft an equality is does not count: it is in both.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc.dynamics import mass_matrix
from mjhcmc.errors import MjhcmcWarning
from mjhcmc.integrators import scheme_of
from mjhcmc.solution import moment_scale

if TYPE_CHECKING:
    from mjhcmc.solution import Solution

Array = NDArray[np.float64]

MOST = 0.05
"""Of a joint's peak net moment, as of reserves; docs/integrators.md has a walk on both sides of it."""


def tell_of_loose_ties(solution: Solution) -> None:
    """Warn where an implicit integrator does not keep equalities, naming one, what it misses by, and the remedy.

    Args:
        solution: as the method returns it, with its model.
    """
    model = solution.model
    if model is None or model.coupling is None or not scheme_of(solution.integrator).implicit:
        return
    tangent = model.coupling.tangent(solution.qpos)
    parts = _met(solution, tangent)
    share = np.abs(parts.sum(axis=1)) / moment_scale(solution.net_joint_moment)
    share[:, np.setdiff1d(np.arange(model.nv), model.roles.tracked)] = 0.0
    k, j = divmod(int(np.argmax(share)), model.nv)
    most = float(share[k, j])
    if most <= MOST:
        return
    worst = int(np.argmax(np.abs(parts[k, :, j])))
    projected = np.array([model.coupling.project(q) for q in solution.qpos])
    off = np.abs(model.coordinates.difference(solution.qpos, projected))[:, worst].max()
    step = float(solution.settings["physics_dt"])
    unit = "rad" if model.dof_is_rotation[worst] else "m"
    warnings.warn(
        f"{solution.integrator} does not keep the equalities of {model.name!r} at physics_dt {step:.3g} s: "
        f"{model.dof_names[worst]!r} is up to {off:.2g} {unit} off, and what it misses at {solution.time[k]:.3f} s is "
        f"worth {100 * most:.0f} % of the peak moment of {model.dof_names[j]!r}: use integrator 'rk4', or physics_dt "
        f"<= {min(0.5, MOST / most) * step:.1g}",
        MjhcmcWarning,
        stacklevel=5,
    )


def _met(solution: Solution, tangent: Array) -> Array:
    """(n, nv, nv) N m or N: what each degree of freedom's d does at each other, d_i (M N)_ij, at n nodes."""
    plant, found = solution.plant(), np.empty_like(tangent)
    for k, N in enumerate(tangent):
        plant.set_state(solution.state(k))
        load = solution.external_load[k] if plant.surroundings.empty else 0.0
        plant.set_input(None, solution.reserve[min(k, solution.n_window - 1)] + load)
        ahead = plant.step_acceleration()
        ahead -= plant.forward()
        found[k] = (ahead - N @ ahead)[:, None] * (mass_matrix(plant) @ N)
    return found

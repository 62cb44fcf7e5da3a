"""Is a physics step stable? How fast velocities decay, against what the plant's integrator takes; see `integrators`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc import dynamics
from mjhcmc.errors import SimulationError
from mjhcmc.plant import State

if TYPE_CHECKING:
    from mjhcmc.methods.windows import Windows

_POSES_CHECKED = 6  # along the motion
_MARGIN = 0.8  # active muscles damp too


def decay_rate(M: NDArray[np.float64], D: NDArray[np.float64], harmless: float = 0.0) -> float:
    """Fastest decay of the velocities, 1/s: the largest real eigenvalue part of M^-1 D.

    Where a bound on it (the largest row sum) is at most `harmless`, that bound: it takes a tenth of the time.
    """
    rates = np.linalg.solve(M, D)
    bound = float(np.abs(rates).sum(axis=1).max(initial=0.0))
    return bound if bound <= harmless else float(np.linalg.eigvals(rates).real.max(initial=0.0))


def decay_rates(M: NDArray[np.float64], D: NDArray[np.float64]) -> NDArray[np.float64]:
    """(b,) as `decay_rate`, of many; NaN where a value is not finite.

    Args:
        M: (b, nv, nv) kg m^2.
        D: (b, nv, nv) N m s.
    """
    rates = np.full(len(M), np.nan)
    finite = np.isfinite(M).all(axis=(1, 2)) & np.isfinite(D).all(axis=(1, 2))
    if finite.any():
        rates[finite] = np.linalg.eigvals(np.linalg.solve(M[finite], D[finite])).real.max(axis=1, initial=0.0)
    return rates


def explicit_damping(windows: Windows) -> NDArray[np.float64]:
    """(nv, nv) N m s, what of the damping at the plant's last `forward` bounds its step; see `Scheme.explicit`."""
    D, scheme = dynamics.damping_matrix(windows.plant), windows.scheme
    return scheme.explicit(D, np.diag(scheme.joint_damping(windows.model.mj_model))) if scheme.first_order else D


def check_passive_stability(windows: Windows) -> None:
    """Refuse a physics step at which the model's passive damping alone would blow up."""
    plant, reference = windows.plant, windows.reference
    rest, still = np.zeros(windows.model.n_muscle), np.zeros(windows.model.nv)
    worst, at, limit = 0.0, 0, windows.scheme.limit
    for k in range(0, len(reference.time), max(1, len(reference.time) // _POSES_CHECKED)):
        plant.set_state(State(float(reference.time[k]), reference.qpos[k], still, rest, still))
        plant.forward()
        M = dynamics.mass_matrix(plant)
        internal = plant.internal_rate()
        D = explicit_damping(windows)
        if not windows.model.roles.all_tracked:
            W = windows.seen_from_tracked(reference.qpos[k], M)
            M, D = W.T @ M @ W, W.T @ D @ W
        rate = max(internal, decay_rate(M, D, limit / windows.physics_dt))
        if rate > worst:
            worst, at = rate, k
    if worst * windows.physics_dt > limit:
        raise SimulationError(
            f"model {windows.model.name!r}: physics_dt {windows.physics_dt:g} s is unstable under its damping "
            f"({worst:.0f} /s at {reference.time[at]:.3g} s): use physics_dt <= {_MARGIN * limit / worst:.2g}"
        )

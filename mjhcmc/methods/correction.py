"""The correction that a trial window calls for: one Newton step on the acceleration at the window's end.

See `hcmc` for the equations. Compiled where our own solver finds the allocations; other solvers, cubic costs, and
windows with large reserves, whose optimum needs care, go step by step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from mjhcmc.allocation import ELASTICITY
from mjhcmc.allocation_kernels import newton
from mjhcmc.dynamics import MuscleMoments
from mjhcmc.methods.run import reserve_price
from mjhcmc.qp_back_ends import NEWTON
from mjhcmc.sensitivity import fill_build_up, fill_response
from mjhcmc.sharing import Sharing
from mjhcmc.small_linear import solve_in_place, whitening

_MOST_REFINEMENTS = 4
_REFINED = 1e-2  # of what a trial misses: the next trial, or the window itself, shows the rest
_LARGE_RESERVE = 1e-6  # of the muscles' strength, as in `allocation`
_NO_STRENGTH = 1e-9

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trial:
    """What a trial window found at its end, and what it began with.

    Attributes:
        start_activation: (n_muscle,) at the window's start.
        excitation: (n_muscle,) of the trial.
        reserve: (nv,) N m, of the trial.
        activation: (n_muscle,) at the end.
        missing: (nv,) rad/s^2, r of `hcmc`.
        moments: of the muscles at the end.
        M: (nv, nv) kg m^2.
        D: (nv, nv) N m s.
        K: (nv, nv) N m.
        kp: (nv,) 1/s^2.
        kv: (nv,) 1/s.
        lb: (n_muscle,) lowest activation that can be reached.
        ub: (n_muscle,) highest.
        parameters: (n_muscle, 3) of activation dynamics.
        step: s, physics step.
        n_step: physics steps in the window.
    """

    start_activation: Array
    excitation: Array
    reserve: Array
    activation: Array
    missing: Array
    moments: MuscleMoments
    M: Array
    D: Array
    K: Array
    kp: Array
    kv: Array
    lb: Array
    ub: Array
    parameters: Array
    step: float
    n_step: int


def correct(trial: Trial, sharing: Sharing, *, reserves: bool) -> tuple[Array, Array]:
    """Activation (n_muscle,) to aim at, and the moment (nv,) N m that the muscles leave to reserves.

    Raises:
        SimulationError: the allocation holds a value that is not finite, or a solver found no optimum.
    """
    nv, n = trial.moments.B.shape
    answers, wanted, Q = np.empty((nv, n + nv)), np.empty(nv), np.empty(nv)
    _linearize(
        trial.start_activation, trial.excitation, trial.reserve, trial.activation, trial.missing, trial.moments.B,
        trial.M, trial.D, trial.K, trial.kp, trial.kv, trial.parameters, trial.step, trial.n_step, answers, wanted, Q,
    )  # fmt: skip
    w, a0, c = sharing.weigh(trial.moments, trial.start_activation)
    low, high = sharing.bounds(trial.lb, trial.ub)
    if sharing.solver == NEWTON and c is None:
        activation, shortfall = np.empty(n), np.empty(nv)
        eps = ELASTICITY / float(w.mean())
        settled = _share(
            answers, wanted, Q.copy(), trial.activation, trial.reserve, trial.moments.B, trial.M, reserves, low, high,
            w, a0, eps, activation, shortfall,
        )  # fmt: skip
        if settled:
            return activation, shortfall
    return _share_by(trial, sharing, answers, wanted, Q, reserves=reserves)


def _share_by(
    trial: Trial, sharing: Sharing, answers: Array, wanted: Array, Q: Array, *, reserves: bool
) -> tuple[Array, Array]:
    """As `_share`, by any solver and with proof."""
    n = len(trial.activation)
    A, T = answers[:, :n], answers[:, n:]
    missing = wanted
    price = reserve_price(trial.M, reserves=reserves)
    for _ in range(_MOST_REFINEMENTS):
        Q = Q + missing
        problem = sharing.problem(trial.moments, Q, trial.lb, trial.ub, price, trial.start_activation)
        found = sharing.allocate(problem)
        missing = wanted - A @ (found.activation - trial.activation) - (found.reserve - T @ trial.reserve)
        if np.abs(missing).max(initial=0.0) <= _REFINED * np.abs(wanted).max(initial=0.0):
            break
    return found.activation, np.asarray(np.linalg.solve(T, found.reserve))


@numba.njit(cache=True, error_model="numpy")
def _linearize(a0, u, s, a, r, B, M, D, K, kp, kv, prm, step, n_step, answers, wanted, Q):  # type: ignore[no-untyped-def]
    """Fill answers = N [X Y] (nv, n + nv), wanted = N r and Q = B a + T s."""
    nv, n = B.shape
    h = step * n_step
    phi = np.empty((n_step + 1, n))
    fill_build_up(a0, u, prm, step, n_step, phi)
    acc, vel, pos = np.empty((nv, n + nv)), np.empty((nv, n + nv)), np.empty((nv, n + nv))
    fill_response(M, D, K, B, phi, step, acc, vel, pos)
    N = np.empty((nv, nv))
    for i in range(nv):
        for j in range(nv):
            c = 1.0 + kv[j] * h / 2 + kp[j] * h * h / 6
            N[i, j] = (M[i, j] + h / 2 * D[i, j] + h * h / 6 * K[i, j]) / c
    for i in range(nv):
        wanted[i], Q[i] = 0.0, 0.0
        for j in range(nv):
            wanted[i] += N[i, j] * r[j]
        for m in range(n + nv):
            total = 0.0
            for j in range(nv):
                total += N[i, j] * (acc[j, m] + kv[j] * vel[j, m] + kp[j] * pos[j, m])
            answers[i, m] = total
        for m in range(n):
            Q[i] += B[i, m] * a[m]
        for j in range(nv):
            Q[i] += answers[i, n + j] * s[j]


@numba.njit(cache=True, error_model="numpy")
def _share(answers, wanted, Q, a_end, s_end, B, M, reserves, lb, ub, w, a0, eps, activation, shortfall):  # type: ignore[no-untyped-def]
    """Move Q until A da + T ds = N r holds; False where the allocation is no routine one."""
    nv, n = B.shape
    P = np.zeros((nv, nv))
    if reserves:
        for i in range(nv):
            P[i, i] = 1.0 / np.sqrt(M[i, i])
    else:
        whitening(M, P)
    rows = np.zeros((nv, n))
    strength = 0.0
    for i in range(nv):
        total = 0.0
        for m in range(n):
            for j in range(nv):
                rows[i, m] += P[i, j] * B[j, m]
            total += abs(rows[i, m])
        strength = max(strength, total)
    if strength <= _NO_STRENGTH:
        strength = 1.0
    for i in range(nv):
        for j in range(nv):
            P[i, j] /= strength
        for m in range(n):
            rows[i, m] /= strength
    s, target, missing = np.empty(nv), np.empty(nv), np.empty(nv)
    for i in range(nv):
        missing[i] = wanted[i]
    for _ in range(_MOST_REFINEMENTS):
        for i in range(nv):
            Q[i] += missing[i]
        for i in range(nv):
            target[i] = 0.0
            for j in range(nv):
                target[i] += P[i, j] * Q[j]
            if not abs(target[i]) < np.inf:
                return False
        a, _, iterations = newton(rows, target, lb, ub, w, a0, eps)
        most, least = 0.0, 0.0
        for i in range(nv):
            s[i] = Q[i]
            for m in range(n):
                s[i] -= B[i, m] * a[m]
        for i in range(nv):
            priced = 0.0
            missing[i] = wanted[i] - s[i]
            for j in range(nv):
                priced += P[i, j] * s[j]
                missing[i] += answers[i, n + j] * s_end[j]
            for m in range(n):
                missing[i] -= answers[i, m] * (a[m] - a_end[m])
            if abs(priced) > _LARGE_RESERVE:
                return False
            most, least = max(most, abs(missing[i])), max(least, abs(wanted[i]))
        if iterations < 0:
            return False
        if most <= _REFINED * least:
            break
    T, left = np.empty((nv, nv)), np.empty((nv, 1))
    for i in range(nv):
        left[i, 0] = s[i]
        for j in range(nv):
            T[i, j] = answers[i, n + j]
    solve_in_place(T, left)
    for i in range(nv):
        shortfall[i] = left[i, 0]
    for m in range(n):
        activation[m] = a[m]
    return True

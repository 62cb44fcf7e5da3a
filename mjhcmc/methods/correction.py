"""The correction that a trial window calls for: one Newton step on the acceleration at the window's end.

See `hcmc` for the equations. Compiled where our own solver finds the allocations; other solvers, cubic costs, and
windows with large reserves, whose optimum needs care, go step by step. One or many simulations, by the same code.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from mjhcmc.activation import advance_one, excitation_for, invert_one
from mjhcmc.allocation import ELASTICITY
from mjhcmc.allocation_kernels import newton
from mjhcmc.chunks import in_chunks
from mjhcmc.dynamics import MuscleMoments
from mjhcmc.errors import SimulationError
from mjhcmc.methods.run import reserve_price
from mjhcmc.qp_back_ends import NEWTON
from mjhcmc.sensitivity import fill_build_up, fill_response
from mjhcmc.sharing import Sharing
from mjhcmc.small_linear import solve_in_place, whitening

_MOST_REFINEMENTS = 4
_REFINED = 1e-2  # of what a trial misses: the next trial, or the window itself, shows the rest
_LARGE_RESERVE = 1e-6  # of the muscles' strength, as in `allocation`
_NO_STRENGTH = 1e-9
_CLOSE = 1e-15  # of activation: as near as rounding lets an excitation lead to it
_NEAR = 1e-9  # near enough for a trial, whose end tells what it led to
_SETTLED, _OPEN = 1, 0

Array = NDArray[np.float64]


class Trial(NamedTuple):
    """What the trial windows of b simulations found at their ends, and what they began with.

    Attributes:
        start_activation: (b, n_muscle) at the window's start.
        excitation: (b, n_muscle) of the trial.
        reserve: (b, nv) N m, of the trial.
        activation: (b, n_muscle) at the end.
        missing: (b, nv) rad/s^2, r of `hcmc`.
        M: (b, nv, nv) kg m^2.
        B: (b, nv, n_muscle) N m, joint moments at full activation.
        gain: (b, n_muscle) N, see `dynamics.MuscleMoments`.
        bias: (b, n_muscle) N.
        D: (b, nv, nv) N m s.
        K: (b, nv, nv) N m.
        kp: (b, nv) 1/s^2.
        kv: (b, nv) 1/s.
        step: s, physics step of the trial.
        n_step: its physics steps; 0: no trial, the end is where the window should end but for the activation.
    """

    start_activation: Array
    excitation: Array
    reserve: Array
    activation: Array
    missing: Array
    M: Array
    B: Array
    gain: Array
    bias: Array
    D: Array
    K: Array
    kp: Array
    kv: Array
    step: float
    n_step: int


class Reach(NamedTuple):
    """How excitations become activations, in b simulations.

    Attributes:
        parameters: (b, n_muscle, 3) of activation dynamics.
        excitation_range: (b, n_muscle, 2).
        step: s, physics step.
        n_step: physics steps in a window.
    """

    parameters: Array
    excitation_range: Array
    step: float
    n_step: int

    def of(self, which: NDArray[np.intp]) -> Reach:
        """That of some of the simulations."""
        return Reach(self.parameters[which], self.excitation_range[which], self.step, self.n_step)


class Correction(NamedTuple):
    """What to drive the window with.

    Attributes:
        excitation: (b, n_muscle).
        shortfall: (b, nv) N m, the moment that the muscles leave to reserves.
        errors: by simulation of the call, those whose allocation holds a value that is not finite, or has no optimum.
        fastest_rate: (b,) 1/s, a bound on the decay rate of the velocities at the trial's end.
    """

    excitation: Array
    shortfall: Array
    errors: dict[int, SimulationError]
    fastest_rate: Array


def correct(
    trial: Trial, reach: Reach, sharing: Sharing, price: Array, *, reserves: bool, threads: int = 1
) -> Correction:
    """The Newton step of each trial.

    Args:
        trial: what was found.
        reach: of the window itself.
        sharing: of the same b simulations.
        price: (b, nv) multipliers to start the allocations from; they become those found.
        reserves: whether what the muscles leave is given by reserves.
        threads: to compute on.
    """
    b, nv, n = trial.B.shape
    answers, wanted, Q = np.empty((b, nv, n + nv)), np.empty((b, nv)), np.empty((b, nv))
    low, high, activation, excitation = (np.empty((b, n)) for _ in range(4))
    shortfall, rate, state = np.empty((b, nv)), np.empty(b), np.empty(b, dtype=np.int64)
    w, a0, cubic = sharing.weigh(trial.gain, trial.bias, trial.start_activation)
    ours = sharing.solver == NEWTON and cubic is None

    def chunk(first: int, last: int) -> None:
        _correct(
            first, last, trial.start_activation, trial.excitation, trial.reserve, trial.activation, trial.missing,
            trial.B, trial.M, trial.D, trial.K, trial.kp, trial.kv, trial.step, trial.n_step, reach.parameters,
            reach.excitation_range, reach.step, reach.n_step, sharing.min_activation, sharing.disabled, w, a0,
            ELASTICITY, reserves, ours, price, answers, wanted, Q, low, high, activation, excitation, shortfall, rate,
            state,
        )  # fmt: skip

    in_chunks(chunk, b, threads)
    errors: dict[int, SimulationError] = {}
    for i in [] if state.all() else np.flatnonzero(state != _SETTLED).tolist():
        try:
            goal, shortfall[i] = _share_by(
                trial, i, sharing.of(i), answers[i], wanted[i], Q[i], low[i], high[i], reserves
            )
        except SimulationError as error:
            errors[int(i)] = error
            continue
        parts = (reach.parameters[i], reach.step, reach.n_step, reach.excitation_range[i])
        excitation[i] = excitation_for(trial.start_activation[i], goal, *parts)
    return Correction(sharing.excitation(excitation), shortfall, errors, rate)


def _share_by(
    trial: Trial,
    i: int,
    sharing: Sharing,
    answers: Array,
    wanted: Array,
    Q: Array,
    low: Array,
    high: Array,
    reserves: bool,
) -> tuple[Array, Array]:
    """As `_share`, of one simulation by any solver and with proof."""
    n = len(low)
    A, T = answers[:, :n], answers[:, n:]
    missing = wanted
    price = reserve_price(trial.M[i], reserves=reserves)
    moments = MuscleMoments(trial.B[i], np.empty(0), trial.gain[i], trial.bias[i])
    for _ in range(_MOST_REFINEMENTS):
        Q = Q + missing
        found = sharing.allocate(sharing.problem(moments, Q, low, high, price, trial.start_activation[i]))
        missing = wanted - A @ (found.activation - trial.activation[i]) - (found.reserve - T @ trial.reserve[i])
        if np.abs(missing).max(initial=0.0) <= _REFINED * np.abs(wanted).max(initial=0.0):
            break
    return found.activation, np.asarray(np.linalg.solve(T, found.reserve))


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _correct(  # type: ignore[no-untyped-def]
    first, last, a_start, u, s, a_end, r, B, M, D, K, kp, kv, trial_step, trial_n, prm, limits, step, n_step, least,
    off, w, a0, elasticity, reserves, ours, price, answers, wanted, Q, low, high, activation, excitation, shortfall,
    rate, state,
):  # fmt: skip
    """Simulations first to last of `correct`."""
    nv, n = B.shape[1:]
    used, decay, moved = np.empty((nv, nv)), np.empty((nv, nv)), np.empty(nv)
    for i in range(first, last):
        _linearize(
            a_start[i], u[i], s[i], a_end[i], r[i], B[i], M[i], D[i], K[i], kp[i], kv[i], prm[i], trial_step, trial_n,
            answers[i], wanted[i], Q[i],
        )  # fmt: skip
        mean = 0.0
        for m in range(n):
            p = prm[i, m]
            low[i, m] = advance_one(a_start[i, m], limits[i, m, 0], p[0], p[1], p[2], step, n_step)
            high[i, m] = advance_one(a_start[i, m], limits[i, m, 1], p[0], p[1], p[2], step, n_step)
            mean += w[i, m] / n
        close = _NEAR if trial_n == 0 else _CLOSE
        for j in range(nv):
            for k in range(nv):
                used[j, k], decay[j, k] = M[i, j, k], D[i, j, k]
        solve_in_place(used, decay)
        rate[i] = 0.0
        for j in range(nv):
            total = 0.0
            for k in range(nv):
                total += abs(decay[j, k])
            rate[i] = max(rate[i], total)
            moved[j] = Q[i, j]
        state[i] = _OPEN
        if not ours:
            continue
        lb, ub = np.empty(n), np.empty(n)
        for m in range(n):
            lb[m] = min(max(low[i, m], least[i, m]), high[i, m])
            ub[m] = lb[m] if off[i, m] else high[i, m]
        if not _share(
            answers[i], wanted[i], moved, a_end[i], s[i], B[i], M[i], reserves, lb, ub, w[i], a0[i], elasticity / mean,
            price[i], activation[i], shortfall[i],
        ):  # fmt: skip
            continue
        state[i] = _SETTLED
        for m in range(n):
            p = prm[i, m]
            excitation[i, m] = invert_one(
                a_start[i, m], activation[i, m], limits[i, m, 0], limits[i, m, 1], low[i, m], high[i, m], p[0], p[1],
                p[2], step, n_step, close,
            )  # fmt: skip


@numba.njit(cache=True, error_model="numpy")
def _linearize(a0, u, s, a, r, B, M, D, K, kp, kv, prm, step, n_step, answers, wanted, Q):  # type: ignore[no-untyped-def]
    """Fill answers = N [X Y] (nv, n + nv), wanted = N r and Q = B a + T s."""
    nv, n = B.shape
    if n_step == 0:  # at a fixed state
        for i in range(nv):
            wanted[i], Q[i] = 0.0, s[i]
            for j in range(nv):
                wanted[i] += M[i, j] * r[j]
                answers[i, n + j] = 1.0 if i == j else 0.0
            for m in range(n):
                answers[i, m] = B[i, m]
                Q[i] += B[i, m] * a[m]
        return
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
def _share(answers, wanted, Q, a_end, s_end, B, M, reserves, lb, ub, w, a0, eps, price, activation, shortfall):  # type: ignore[no-untyped-def]
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
    a = np.empty(n)
    for _ in range(_MOST_REFINEMENTS):
        for i in range(nv):
            Q[i] += missing[i]
        for i in range(nv):
            target[i] = 0.0
            for j in range(nv):
                target[i] += P[i, j] * Q[j]
            if not abs(target[i]) < np.inf:
                return False
        iterations = newton(rows, target, lb, ub, w, a0, eps, price, a)
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

"""As `correction`, for Hill muscles: what is shared is force, told as effective activation (see `hosted.window`)."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from mjhcmc.allocation import ELASTICITY
from mjhcmc.chunks import in_chunks
from mjhcmc.errors import SimulationError
from mjhcmc.hosted.lockstep import HillLockstep, MuscleView
from mjhcmc.hosted.window import excite, reach
from mjhcmc.methods.correction import settle, share_the_rest
from mjhcmc.methods.force_response import linearize
from mjhcmc.methods.trial import Correction, Program, Trial
from mjhcmc.qp_back_ends import NEWTON
from mjhcmc.sharing import Sharing

_CLOSE = 1e-10  # of F0
_LEAST_ANSWER = 0.25  # to a constant reserve, in that to one that grows linearly over the window
_SETTLED, _OPEN = 1, 0

Array = NDArray[np.float64]
Ids = NDArray[np.intp]


class Ahead(NamedTuple):
    """A trial over the time ahead, of b simulations.

    Attributes:
        ids: (b,) the simulations.
        rows: (b, n_row) their states at its start.
        path: (b, n_muscle, 2) m and m/s, musculotendon length and velocity there.
        excitation: (b, n_muscle) of the trial.
        reserve: (b, nv) N m.
        missing: (b, nv) rad/s^2, at its end, r of `hcmc`.
        end: what its end looks like.
        kp: (b, nv) 1/s^2.
        kv: (b, nv) 1/s.
        step: s.
        n_step: steps ahead.
        tried: whether there was a trial; else ``end`` is where the window is expected to end, and what its acceleration
            misses is made up at that state.
    """

    ids: Ids
    rows: Array
    path: Array
    excitation: Array
    reserve: Array
    missing: Array
    end: MuscleView
    kp: Array
    kv: Array
    step: float
    n_step: int
    tried: bool


def correct_forces(
    plants: HillLockstep, ahead: Ahead, limits: Array, sharing: Sharing, price: Array, *, reserves: bool, threads: int
) -> tuple[Correction, NDArray[np.bool_]]:
    """The Newton step of each trial; see `correction.correct`.

    Where antagonists hold a joint between taut tendons, it swings on them within the time ahead, and a reserve's effect
    on the acceleration at its end may vanish or change sign: then there is nothing to go by.

    Args:
        plants: what is stepped.
        ahead: the trials.
        limits: (b, n_muscle, 2) of excitation.
        sharing: of the same simulations.
        price: (b, nv) multipliers to start the allocations from; they become those found.
        reserves: whether what the muscles leave is given by reserves.
        threads: to compute on.

    Returns:
        The correction; and (b,) whether it can be believed.
    """
    found, layout = ahead.end.around, plants.layout
    b, nv, n = found.B.shape
    p, prm = plants.parameters[ahead.ids], plants.activation_parameters[ahead.ids]
    gain, bias, B = found.gain, found.bias, found.B
    # one layout, however many they are: what takes them is compiled once
    start, fiber = (np.ascontiguousarray(ahead.rows[:, part]) for part in (layout.activation, layout.fiber))
    low, high, x, shift, excitation = (np.empty((b, n)) for _ in range(5))
    forces, phi = np.empty((b, n, 4)), np.empty((b, ahead.n_step + 1, n))
    answers, wanted, Q = np.empty((b, nv, n + nv)), np.empty((b, nv)), np.empty((b, nv))
    shortfall, rate, goal = np.empty((b, nv)), np.empty(b), np.full((b, n), np.nan)
    state = np.empty(b, dtype=np.int64)
    end_time = ahead.rows[:, layout.time] + ahead.step * ahead.n_step
    w, a0, cubic = sharing.weigh(gain, bias, start, end_time)
    kind, curves = plants.muscles.kind, plants.muscles.curves
    ours = sharing.solver == NEWTON and cubic is None
    K = found.M if found.K is None else found.K  # without a trial none is needed
    if not ahead.tried:
        answers[:, :, :n], answers[:, :, n:] = B, np.eye(nv)
        wanted, rate = (found.M @ ahead.missing[:, :, None])[:, :, 0], np.zeros(b)
        x = (ahead.end.force - bias) / gain
        Q = (B @ x[:, :, None])[:, :, 0] + ahead.reserve

    def chunk(first: int, last: int) -> None:
        reach(
            first, last, kind, curves, p, prm, limits, start, fiber, ahead.excitation, ahead.path, ahead.end.path,
            gain, bias, ahead.end.force, ahead.tried, ahead.step, ahead.n_step, low, high, forces, shift, x, phi,
        )  # fmt: skip
        if ahead.tried:
            linearize(
                first, last, found.M, found.D, K, ahead.end.R, gain, phi, ahead.end.slopes, ahead.kp, ahead.kv,
                ahead.step, ahead.missing, x, ahead.reserve, answers, wanted, Q, rate,
            )  # fmt: skip
        _share(
            first, last, B, found.M, answers, wanted, Q, x, ahead.reserve, low, high, sharing.disabled, w, a0,
            ELASTICITY, reserves, ours, price, goal, shortfall, state,
        )  # fmt: skip

    in_chunks(chunk, b, threads)
    errors: dict[int, SimulationError] = {}
    if not state.all():
        trial = Trial(
            start, ahead.excitation, ahead.reserve, x, ahead.missing, found.M, B, gain, bias, found.D, K,
            ahead.kp, ahead.kv, ahead.step, ahead.n_step, np.broadcast_to(np.inf, gain.shape), end_time,
        )  # fmt: skip
        program = Program(answers, wanted, Q, low, high)
        open_, cost = np.flatnonzero(state != _SETTLED), (w, a0, price) if ours else None
        errors = share_the_rest(open_, trial, sharing.unbounded, program, cost, goal, shortfall, reserves=reserves)
    target = bias + gain * goal - shift

    def back(first: int, last: int) -> None:
        excite(
            first, last, kind, curves, p, prm, limits, start, fiber, target, ahead.path, ahead.end.path, ahead.step,
            ahead.n_step, ahead.excitation, forces, _CLOSE, excitation,
        )  # fmt: skip

    in_chunks(back, b, threads)
    for i in errors:
        excitation[i], shortfall[i] = 0.0, 0.0
    T = np.diagonal(answers[:, :, n:], axis1=1, axis2=2)
    sound = np.asarray((T > _LEAST_ANSWER).all(axis=1)) if reserves else np.ones(b, dtype=bool)
    excitation = np.where(sharing.disabled, limits[:, :, 0], excitation)  # with compliant tendons they keep their tone
    return Correction(excitation, shortfall, errors, rate), sound


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _share(  # type: ignore[no-untyped-def]
    first, last, B, M, answers, wanted, Q, x_end, s_end, low, high, off, w, a0, elasticity, reserves, ours, price, goal,
    shortfall, state,
):  # fmt: skip
    """Share with `settle`; _OPEN where the allocation is no routine one."""
    n = B.shape[2]
    ub, x = np.empty(n), np.empty(n)
    for b in range(first, last):
        state[b] = _OPEN
        if not ours:
            continue
        for m in range(n):
            ub[m] = low[b, m] if off[b, m] else high[b, m]
        if settle(
            B[b], M[b], answers[b], wanted[b], Q[b], x_end[b], s_end[b], low[b], ub, w[b], a0[b], elasticity, reserves,
            price[b], x, shortfall[b],
        ):  # fmt: skip
            state[b] = _SETTLED
            for m in range(n):
                goal[b, m] = x[m]

"""The correction that a trial window calls for: one Newton step on the acceleration at the window's end.

See `hcmc` for the equations. Compiled where our own solver finds the allocations; other solvers, cubic costs, and
windows with large reserves, whose optimum needs care, go step by step. One or many simulations, by the same code.
"""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
from numpy.typing import NDArray

from mjhcmc.activation import advance_one, excitation_for, invert_one
from mjhcmc.allocation import ELASTICITY
from mjhcmc.allocation_batch import AllocationStatus, allocate_many, build_batch
from mjhcmc.allocation_kernels import newton
from mjhcmc.chunks import in_chunks
from mjhcmc.dynamics import MuscleMoments
from mjhcmc.errors import SimulationError
from mjhcmc.integrators import scheme_of
from mjhcmc.methods.bare import program_of, reserve_of_bare, without_bare
from mjhcmc.methods.run import reserve_price
from mjhcmc.methods.trial import Correction, Program, Reach, Trial
from mjhcmc.qp_back_ends import NEWTON
from mjhcmc.sensitivity import fill_build_up, fill_response, fill_stepped_response
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
    bare = _bare(trial.B)
    if (bare == bare[0]).all():  # nearly always; `unique` takes a tenth of a large model's window to see it
        return _correct(trial, reach, sharing, price, bare[0], reserves=reserves, threads=threads)
    bares, group = np.unique(bare, axis=0, return_inverse=True)
    whole = Correction(np.empty_like(trial.excitation), np.empty_like(price), {}, np.empty(len(price)))
    for kind in range(len(bares)):  # each simulation as it would be alone
        which = np.flatnonzero(group.ravel() == kind)
        own = price[which]
        found = _correct(
            trial.of(which), reach.of(which), sharing.of(which), own, bares[kind], reserves=reserves, threads=threads
        )
        price[which] = own
        whole.excitation[which], whole.shortfall[which], whole.fastest_rate[which] = (
            found.excitation, found.shortfall, found.fastest_rate
        )  # fmt: skip
        whole.errors.update({int(which[i]): error for i, error in found.errors.items()})
    return whole


def _bare(B: Array) -> NDArray[np.bool_]:
    """(b, nv) True for degrees of freedom that no muscle moves."""
    strength = np.abs(B).max(axis=2)
    return np.asarray(strength <= _NO_STRENGTH * strength.max(axis=1, keepdims=True, initial=0.0))


def _correct(
    trial: Trial,
    reach: Reach,
    sharing: Sharing,
    price: Array,
    bare: NDArray[np.bool_],
    *,
    reserves: bool,
    threads: int,
) -> Correction:
    """As `correct`, of simulations in which muscles leave the same degrees of freedom bare (nv,)."""
    b, nv, n = trial.B.shape
    answers, wanted, Q = np.empty((b, nv, n + nv)), np.empty((b, nv)), np.empty((b, nv))
    rate = np.empty(b)
    inertia = trial.M if trial.inertia is None else trial.inertia
    explicit = trial.D if trial.explicit is None else trial.explicit

    def chunk(first: int, last: int) -> None:
        _linearize(
            first, last, trial.start_activation, trial.excitation, trial.reserve, trial.activation, trial.missing,
            trial.B, trial.M, inertia, trial.D, explicit, trial.K, trial.kp, trial.kv, reach.parameters, trial.step,
            trial.n_step, trial.euler, answers, wanted, Q, rate,
        )  # fmt: skip

    in_chunks(chunk, b, threads)
    if not (reserves and bare.any()) or bare.all():
        found = _share_all(trial, reach, sharing, price, (answers, wanted, Q), reserves=reserves, threads=threads)
        return Correction(sharing.excitation(found[0]), found[2], found[3], rate)
    rest, back = without_bare(bare, trial, answers, wanted)
    own = np.ascontiguousarray(price[:, ~bare])
    excitation, goal, shortfall, errors = _share_all(
        rest, reach, sharing, own, program_of(rest, *back[:2]), reserves=reserves, threads=threads
    )
    price[:, ~bare] = own
    whole = np.empty((b, nv))
    whole[:, ~bare] = shortfall
    whole[:, bare] = reserve_of_bare(bare, trial, answers, wanted, goal, shortfall)
    return Correction(sharing.excitation(excitation), whole, errors, rate)


def _share_all(
    trial: Trial,
    reach: Reach,
    sharing: Sharing,
    price: Array,
    seen: tuple[Array, Array, Array],
    *,
    reserves: bool,
    threads: int,
) -> tuple[Array, Array, Array, dict[int, SimulationError]]:
    """Excitation and activation (b, n_muscle), shortfall (b, nv), and what fails; seen: answers, wanted, Q."""
    answers, wanted, Q = seen
    b, nv, n = trial.B.shape
    low, high, top, excitation = (np.empty((b, n)) for _ in range(4))
    goal, shortfall, state = np.full((b, n), np.nan), np.empty((b, nv)), np.empty(b, dtype=np.int64)
    w, a0, cubic = sharing.weigh(trial.gain, trial.bias, trial.start_activation, trial.time)
    ours, close = sharing.solver == NEWTON and cubic is None, _CLOSE if trial.n_step else _NEAR
    euler = scheme_of(reach.integrator).first_order

    def chunk(first: int, last: int) -> None:
        _share(
            first, last, trial.start_activation, trial.reserve, trial.activation, trial.B, trial.M, reach.parameters,
            reach.excitation_range, reach.step, reach.n_step, euler, close, trial.cap, sharing.min_activation,
            sharing.disabled, w, a0, ELASTICITY, reserves, ours, price, answers, wanted, Q, low, high, top, excitation,
            goal, shortfall, state,
        )  # fmt: skip

    in_chunks(chunk, b, threads)
    errors: dict[int, SimulationError] = {}
    if not state.all():
        open_ = np.flatnonzero(state != _SETTLED)
        program = Program(answers, wanted, Q, low, top)
        errors = share_the_rest(
            open_, trial, sharing, program, (w, a0, price) if ours else None, goal, shortfall, reserves=reserves
        )
        for i in open_.tolist():
            if i in errors:
                excitation[i], shortfall[i], goal[i] = 0.0, 0.0, 0.0
            else:
                parts = (
                    reach.parameters[i], reach.step, reach.n_step, reach.excitation_range[i], reach.integrator
                )  # fmt: skip
                excitation[i] = excitation_for(trial.start_activation[i], goal[i], *parts)
    return excitation, goal, shortfall, errors


def share_the_rest(
    which: NDArray[np.intp],
    trial: Trial,
    sharing: Sharing,
    program: Program,
    cost: tuple[Array, Array, Array] | None,
    goal: Array,
    shortfall: Array,
    *,
    reserves: bool,
) -> dict[int, SimulationError]:
    """Fill goal (b, n) and shortfall (b, nv) where the allocation is no routine one; returns what fails.

    Args:
        which: the simulations.
        trial: what was found.
        sharing: of all b.
        program: what is shared.
        cost: w, a0 and price of all b, for our own solver; None: the one that sharing names.
        goal: filled.
        shortfall: filled.
        reserves: as `correct`.
    """
    rest = which if cost is None else _share_carefully(which, trial, sharing, program, cost, goal, shortfall, reserves)
    errors: dict[int, SimulationError] = {}
    for i in rest.tolist():
        try:
            goal[i], shortfall[i] = _share_by(i, trial, sharing.of(i), program, reserves)
        except SimulationError as error:
            errors[i] = error
    return errors


def _share_carefully(
    which: NDArray[np.intp],
    trial: Trial,
    sharing: Sharing,
    program: Program,
    cost: tuple[Array, Array, Array],
    goal: Array,
    shortfall: Array,
    reserves: bool,
) -> NDArray[np.intp]:
    """As `_share`, where reserves are large: every allocation is refined and proven.

    Fills goal and shortfall; returns the simulations whose allocation is still open.
    """
    n = goal.shape[1]
    answers, wanted, Q, low, high = (part[which] for part in program)
    w, a0, price = (part[which] for part in cost)
    A, T = answers[:, :, :n], answers[:, :, n:]
    M, B, a_end, s_end = (part[which] for part in (trial.M, trial.B, trial.activation, trial.reserve))
    inertia = np.stack([reserve_price(one, reserves=reserves) for one in M])
    lb, ub = sharing.of(which).bounds(low, high)
    batch = build_batch(B, Q, lb, ub, inertia=inertia, w=w, a0=a0)
    found, todo, missing = _nothing(B), np.arange(len(which)), wanted
    for _ in range(_MOST_REFINEMENTS):  # each by itself as often as it needs: company changes no bit
        batch = replace(batch, Q=batch.Q + missing)
        some = allocate_many(batch, price)
        change = A @ (some.activation - a_end)[:, :, None] - T @ s_end[:, :, None]
        left = wanted - change[:, :, 0] - some.reserve
        for part, whole in zip((some.activation, some.reserve, some.multiplier, some.status), found, strict=True):
            whole[todo] = part
        rough = np.abs(left).max(axis=1) > _REFINED * np.abs(wanted).max(axis=1)
        if not rough.any():
            break
        todo, batch, missing, price = todo[rough], batch.of(rough), left[rough], some.multiplier[rough]
        A, T, a_end, s_end, wanted = (part[rough] for part in (A, T, a_end, s_end, wanted))
    activation, reserve, multiplier, status = found
    routine = status <= AllocationStatus.BY_BACK_END
    T = answers[:, :, n:]
    routine &= np.linalg.matrix_rank(np.where(np.isfinite(T), T, 0.0)) == T.shape[1]
    done = which[routine]
    shortfall[done] = np.linalg.solve(T[routine], reserve[routine, :, None])[:, :, 0]
    goal[done], cost[2][done] = activation[routine], multiplier[routine]
    return which[~routine]


def _nothing(B: Array) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Room for what `allocate_many` finds: activation, reserve, multiplier, status."""
    b, nv, n = B.shape
    return np.empty((b, n)), np.empty((b, nv)), np.empty((b, nv)), np.empty(b, dtype=np.int64)


def _share_by(i: int, trial: Trial, sharing: Sharing, program: Program, reserves: bool) -> tuple[Array, Array]:
    """As `_share`, of one simulation by any solver and for any cost."""
    answers, wanted, Q, low, high = (part[i] for part in program)
    n = len(low)
    A, T = answers[:, :n], answers[:, n:]
    missing = wanted
    price = reserve_price(trial.M[i], reserves=reserves)
    moments = MuscleMoments(trial.B[i], np.empty(0), trial.gain[i], trial.bias[i])
    for _ in range(_MOST_REFINEMENTS):
        Q = Q + missing
        found = sharing.allocate(
            sharing.problem(moments, Q, low, high, price, trial.start_activation[i], float(trial.time[i]))
        )
        missing = wanted - A @ (found.activation - trial.activation[i]) - (found.reserve - T @ trial.reserve[i])
        if np.abs(missing).max(initial=0.0) <= _REFINED * np.abs(wanted).max(initial=0.0):
            break
    try:
        return found.activation, np.asarray(np.linalg.solve(T, found.reserve))
    except np.linalg.LinAlgError as error:
        raise SimulationError("reserves do not move the joints: the simulation has diverged") from error


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _linearize(  # type: ignore[no-untyped-def]
    first, last, a_start, u, s, a_end, r, B, M, inertia, D, explicit, K, kp, kv, prm, step, n_step, euler, answers,
    wanted, Q, rate,
):  # fmt: skip
    """Fill answers = N [X Y] (b, nv, n + nv), wanted = N r, Q = B a + T s and rate, from simulation first to last."""
    nv, n = B.shape[1:]
    h = step * n_step
    lag = 1.0 / n_step if euler and n_step > 0 else 0.0
    linear, square = 1.0 - lag, 1.0 - lag * lag
    phi = np.empty((n_step + 1, n))
    acc, vel, pos = np.empty((nv, n + nv)), np.empty((nv, n + nv)), np.empty((nv, n + nv))
    N, used, decay = np.empty((nv, nv)), np.empty((nv, nv)), np.empty((nv, nv))
    for b in range(first, last):
        if n_step > 0:
            fill_build_up(a_start[b], u[b], prm[b], step, n_step, euler, phi)
            if euler:
                fill_stepped_response(inertia[b], D[b], K[b], B[b], phi, step, acc, vel, pos)
            else:
                fill_response(M[b], D[b], K[b], B[b], phi, step, acc, vel, pos)
        for i in range(nv):
            for j in range(nv):
                c = 1.0 + kv[b, j] * h / 2 * linear + kp[b, j] * h * h / 6 * square
                N[i, j] = (inertia[b, i, j] + h / 2 * linear * D[b, i, j] + h * h / 6 * square * K[b, i, j]) / c
                used[i, j], decay[i, j] = M[b, i, j], explicit[b, i, j]
        for i in range(nv):
            wanted[b, i], Q[b, i] = 0.0, 0.0
            for m in range(n + nv):
                total = 0.0
                if n_step > 0:
                    for j in range(nv):
                        total += N[i, j] * (acc[j, m] + kv[b, j] * vel[j, m] + kp[b, j] * pos[j, m])
                elif m < n:  # at a fixed state
                    total = B[b, i, m]
                elif m - n == i:
                    total = 1.0
                answers[b, i, m] = total
            for m in range(n):
                Q[b, i] += B[b, i, m] * a_end[b, m]
            for j in range(nv):
                wanted[b, i] += N[i, j] * r[b, j]
                Q[b, i] += answers[b, i, n + j] * s[b, j]
        solve_in_place(used, decay)
        rate[b] = 0.0
        for j in range(nv):
            total = 0.0
            for k in range(nv):
                total += abs(decay[j, k])
            rate[b] = max(rate[b], total)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def settle(  # type: ignore[no-untyped-def]
    B, M, answers, wanted, Q, a_end, s_end, lb, ub, w, a0, elasticity, reserves, price, a, shortfall
):
    """Move Q until A da + T ds = N r holds, in one simulation; False where the allocation is no routine one.

    Fills a (n_muscle,), shortfall (nv,), N m, and price (nv,), from which it also begins.
    """
    nv, n = B.shape
    P, T, left = np.empty((nv, nv)), np.empty((nv, nv)), np.empty((nv, 1))
    rows, mean = np.empty((nv, n)), 0.0
    s, target, missing, moved, y = np.empty(nv), np.empty(nv), np.empty(nv), np.empty(nv), np.empty(nv)
    for m in range(n):
        mean += w[m] / n
    for i in range(nv):
        for j in range(nv):
            P[i, j], T[i, j] = 0.0, answers[i, n + j]
        if reserves:
            P[i, i] = 1.0 / np.sqrt(M[i, i])
        missing[i], moved[i], y[i] = wanted[i], Q[i], price[i]
    if not reserves:
        whitening(M, P)
    strength = 0.0
    for i in range(nv):
        total = 0.0
        for m in range(n):
            rows[i, m] = 0.0
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
    routine = True
    for _ in range(_MOST_REFINEMENTS):
        for i in range(nv):
            moved[i] += missing[i]
        for i in range(nv):
            target[i] = 0.0
            for j in range(nv):
                target[i] += P[i, j] * moved[j]
            routine = routine and abs(target[i]) < np.inf
        if not routine:
            break
        routine = newton(rows, target, lb, ub, w, a0, elasticity / mean, y, a) >= 0
        most, most_wanted = 0.0, 0.0
        for i in range(nv):
            s[i] = moved[i]
            for m in range(n):
                s[i] -= B[i, m] * a[m]
        for i in range(nv):
            priced = 0.0
            missing[i] = wanted[i] - s[i]
            for j in range(nv):
                priced += P[i, j] * s[j]
                missing[i] += T[i, j] * s_end[j]
            for m in range(n):
                missing[i] -= answers[i, m] * (a[m] - a_end[m])
            routine = routine and abs(priced) <= _LARGE_RESERVE
            most, most_wanted = max(most, abs(missing[i])), max(most_wanted, abs(wanted[i]))
        if not routine or most <= _REFINED * most_wanted:
            break
    if routine:
        for i in range(nv):
            left[i, 0], price[i] = s[i], y[i]
        solve_in_place(T, left)
        for i in range(nv):
            shortfall[i] = left[i, 0]
    return routine


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _share(  # type: ignore[no-untyped-def]
    first, last, a_start, s_end, a_end, B, M, prm, limits, step, n_step, euler, close, cap, least, off, w, a0,
    elasticity, reserves, ours, price, answers, wanted, Q, low, high, top, excitation, goal, shortfall, state,
):  # fmt: skip
    """Share with `settle`, and find the excitations; _OPEN where the allocation is no routine one."""
    n = B.shape[2]
    lb, ub, a = np.empty(n), np.empty(n), np.empty(n)
    for b in range(first, last):
        state[b] = _OPEN
        for m in range(n):
            act, deact, smooth = prm[b, m, 0], prm[b, m, 1], prm[b, m, 2]
            low[b, m] = advance_one(a_start[b, m], limits[b, m, 0], act, deact, smooth, step, n_step, euler)
            high[b, m] = advance_one(a_start[b, m], limits[b, m, 1], act, deact, smooth, step, n_step, euler)
            top[b, m] = max(low[b, m], min(high[b, m], cap[b, m]))
            lb[m] = min(max(low[b, m], least[b, m]), top[b, m])
            ub[m] = lb[m] if off[b, m] else top[b, m]
        if not ours:
            continue
        routine = settle(
            B[b], M[b], answers[b], wanted[b], Q[b], a_end[b], s_end[b], lb, ub, w[b], a0[b], elasticity, reserves,
            price[b], a, shortfall[b],
        )  # fmt: skip
        if not routine:
            continue
        state[b] = _SETTLED
        for m in range(n):
            goal[b, m] = a[m]
            excitation[b, m] = invert_one(
                a_start[b, m], a[m], limits[b, m, 0], limits[b, m, 1], low[b, m], high[b, m], prm[b, m, 0],
                prm[b, m, 1], prm[b, m, 2], step, n_step, close, euler,
            )  # fmt: skip

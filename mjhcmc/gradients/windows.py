"""The derivative of one window's choice, by differentiating the conditions that it meets (implicit function theorem).

At a window's end, with excitation u, reserve s and the price lambda of joint moments, HCMC's converged answer meets

    r = q''_d + kv (v_d - v) + kp (q_d - q) - qacc = 0
    w_i (a_i - a0_i) + c_i a_i^2 = B_i' lambda       of each muscle between its bounds
    u_i = its bound, or a_i = its least activation   of the others
    T s = C lambda,   C = eps strength^2 diag(M)     the price of reserves, see `allocation`

Their differentials are linear in du, ds and dlambda, once the end's state is written as its tangents (see `tangents`).
Muscles keep to the condition that they meet: the derivative is exact up to where one of them changes, and one-sided
there (the muscles that are about to change choose as the allocation's own optimality conditions say).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjhcmc.allocation import ELASTICITY
from mjhcmc.gradients.along import Nodes

Array = NDArray[np.float64]

_AT_BOUND = 1e-12  # of excitation
_AT_LEAST = 1e-8  # of activation
_CHANGING = 1e-9  # of activation: nearer to a change a muscle has a derivative to either side
_MOST_CHANGING = 6
_SURE_OF_ACTIVATION, _SURE_OF_RESERVE = 1e-10, 1e-8  # what conditions are met to, about


class Cost(NamedTuple):
    """The cost at a node, (n_muscle,) each, and the slope of a0 by the activation before."""

    w: Array
    a0: Array
    c: Array
    a0_slope: Array


class Choice(NamedTuple):
    """What a window ended with.

    Attributes:
        excitation: (n_muscle,).
        limits: (n_muscle, 2) of excitation.
        start: (n_muscle,) activation at its start.
        activation: (n_muscle,) at its end.
        least: (n_muscle,) activation asked for at least.
        disabled: (n_muscle,).
        reserve: (nv,) N m.
        missing_velocity: (nv,) v_d - v at its end.
        missing_position: (nv,) q_d - q.
        kp: (nv,).
        kv: (nv,).
    """

    excitation: Array
    limits: Array
    start: Array
    activation: Array
    least: Array
    disabled: NDArray[np.bool_]
    reserve: Array
    missing_velocity: Array
    missing_position: Array
    kp: Array
    kv: Array


class Tangent(NamedTuple):
    """Derivatives at a node by p parameters: positions, velocities (nv, p), activations (n_muscle, p)."""

    qpos: Array
    qvel: Array
    activation: Array


class Moved(NamedTuple):
    """Derivatives of what is wanted at a window's end, (nv, p) each: q_d, v_d, q''_d, kp, kv."""

    qpos: Array
    qvel: Array
    qacc: Array
    kp: Array
    kv: Array


@dataclass(frozen=True)
class Answer:
    """How a window answers.

    Attributes:
        excitation: (n_muscle, p).
        reserve: (nv, p).
        end: tangent at its end.
        margin: (n_muscle,) of activation, to the nearest change of what the muscle does.
    """

    excitation: Array
    reserve: Array
    end: Tangent
    margin: Array


class _Rows(NamedTuple):
    """The conditions' differentials as A z = -b, z = (du, ds, dlambda); rows of r, of all muscles' g, of reserves."""

    r: tuple[Array, Array]
    g: tuple[Array, Array]
    c: tuple[Array, Array]


def answer(
    choice: Choice,
    cost: Cost,
    nodes: Nodes,
    k: int,
    ends: Array,
    before: Array,
    wanted: Moved,
    T: Array,
    turned: Array | float,
    side: int,
) -> Answer:
    """Differentiate a window's choice.

    Args:
        choice: what it ended with.
        cost: at its end.
        nodes: along the solution.
        k: the node at its end.
        ends: (2 nv + n, n + nv + p) tangents of its end by excitation, by reserve and by parameters at fixed inputs.
        before: (n_muscle, p) tangent of activation at its start.
        wanted: see `Moved`.
        T: (nv, nv) see the module's docstring.
        turned: (nv, p) change of T times the reserve.
        side: 1 or -1, the direction of parameters where muscles are about to change.
    """
    B = nodes.B[k]
    nv, n = B.shape
    Eu, Es, E0 = ends[:, :n], ends[:, n : n + nv], ends[:, n + nv :]
    Rx = -np.hstack([nodes.Jq[k] + np.diag(choice.kp), nodes.Jv[k] + np.diag(choice.kv), nodes.Ja[k]])
    Y = -(Rx @ Es - nodes.Js[k])
    C, C_slopes = _price(nodes, k, cost)
    price = _prices(choice, cost, B, T, C)
    g = cost.w * (choice.activation - cost.a0) + cost.c * choice.activation**2 - B.T @ price
    by_coordinates = -np.einsum("j,jic->ic", price, nodes.B_slopes[k])
    curvature = np.diag(cost.w + 2 * cost.c * choice.activation)
    Gx, Gp = np.hstack([by_coordinates[:, : 2 * nv], curvature]), by_coordinates[:, 2 * nv :]
    dC = C_slopes * price[:, None]
    Cx, Cp = np.hstack([dC[:, : 2 * nv], np.zeros((nv, n))]), dC[:, 2 * nv :]
    Rp = (
        wanted.qacc + choice.kv[:, None] * wanted.qvel + choice.kp[:, None] * wanted.qpos
        + wanted.kv * choice.missing_velocity[:, None] + wanted.kp * choice.missing_position[:, None] - nodes.Jp[k]
    )  # fmt: skip
    none = np.zeros((nv, nv))
    rows = _Rows(
        (np.hstack([Rx @ Eu, -Y, none]), Rx @ E0 + Rp),
        (np.hstack([Gx @ Eu, Gx @ Es, -B.T]), Gx @ E0 + Gp + (-cost.w * cost.a0_slope)[:, None] * before),
        (np.hstack([-Cx @ Eu, T - Cx @ Es, -np.diag(C)]), turned - (Cx @ E0 + Cp)),
    )
    held = (np.hstack([Eu[2 * nv :], np.zeros((n, 2 * nv))]), E0[2 * nv :])
    state, margin = _states(choice, g / (cost.w + 2 * cost.c * choice.activation), Eu[2 * nv :])
    z = _solve(rows, held, state, side)
    du, ds = z[:n], z[n : n + nv]
    E = E0 + Eu @ du + Es @ ds
    return Answer(du, ds, Tangent(E[:nv], E[nv : 2 * nv], E[2 * nv :]), margin)


def _price(nodes: Nodes, k: int, cost: Cost) -> tuple[Array, Array]:
    """C (nv,) of the module's docstring, and its slopes (nv, nv + nv + p) by position, velocity and parameter."""
    B, M = nodes.B[k], np.diag(nodes.M[k])
    M_slopes = np.einsum("jjc->jc", nodes.M_slopes[k]) / M[:, None]
    sums = np.abs(B).sum(axis=1) / np.sqrt(M)
    row = int(np.argmax(sums))
    strength_slopes = np.sign(B[row]) @ nodes.B_slopes[k][row] / np.sqrt(M[row]) / sums[row] - M_slopes[row] / 2
    C = ELASTICITY / (cost.w + cost.c).mean() * sums[row] ** 2 * M
    return C, C[:, None] * (2 * strength_slopes + M_slopes)


def _prices(choice: Choice, cost: Cost, B: Array, T: Array, C: Array) -> Array:
    """Lambda (nv,), from both conditions that name it, each as far as it is met."""
    low, high = choice.limits.T
    free = (choice.excitation > low + _AT_BOUND) & (choice.excitation < high - _AT_BOUND) & ~choice.disabled
    free &= choice.activation > choice.least + _AT_LEAST
    g = cost.w * (choice.activation - cost.a0) + cost.c * choice.activation**2
    reserve = T @ choice.reserve
    sure = _SURE_OF_RESERVE * (1 + np.abs(reserve))
    rows = np.vstack([B[:, free].T / _SURE_OF_ACTIVATION / cost.w[free, None], np.diag(C / sure)])
    right = np.concatenate([g[free] / _SURE_OF_ACTIVATION / cost.w[free], reserve / sure])
    return np.asarray(np.linalg.lstsq(rows, right, rcond=1e-15)[0])


_FREE, _FIXED, _HELD, _LOW, _HIGH, _FLOOR = range(6)  # the last three: on the verge between free and fixed, or held


def _states(choice: Choice, g: Array, Ga: Array) -> tuple[NDArray[np.intp], Array]:
    """What each muscle does (n_muscle,), and how far from a change it is in activation.

    Args:
        choice: what the window ended with.
        g: (n_muscle,) gradient of the cost less what moments are worth, in activation.
        Ga: (n_muscle, n_muscle) change of activation with excitation, diagonal.
    """
    low, high = choice.limits.T
    at_low, at_high = choice.excitation <= low + _AT_BOUND, choice.excitation >= high - _AT_BOUND
    room = np.diag(Ga)
    at_floor = ~at_low & ~at_high & (choice.activation <= choice.least + _AT_LEAST)
    state = np.full(len(g), _FREE)
    margin = np.minimum(choice.excitation - low, high - choice.excitation) * room
    margin = np.minimum(margin, np.abs(choice.excitation - choice.start) * room)  # rising or falling
    margin = np.minimum(margin, np.abs(choice.activation - choice.least))
    for which, fixed, verge in ((at_low, _FIXED, _LOW), (at_high, _FIXED, _HIGH), (at_floor, _HELD, _FLOOR)):
        state[which] = np.where(np.abs(g[which]) < _CHANGING, verge, fixed)
        margin[which] = np.abs(g[which])
    barely = (state == _FREE) & (margin < _CHANGING)
    state[barely & ((choice.excitation - low) * room < _CHANGING)] = _LOW
    state[barely & ((high - choice.excitation) * room < _CHANGING)] = _HIGH
    state[barely & (np.abs(choice.activation - choice.least) < _CHANGING)] = _FLOOR
    state[choice.disabled] = _FIXED
    margin[choice.disabled] = np.inf
    return state, margin


def _solve(rows: _Rows, held: tuple[Array, Array], state: NDArray[np.intp], side: int) -> Array:
    """(n + 2 nv, p) z: du, ds, dlambda; every column meets the conditions of muscles on the verge on its side."""
    verge = np.flatnonzero(state >= _LOW)[:_MOST_CHANGING]
    if not len(verge):
        return _solve_fixed(rows, held, state)
    n, p = len(state), rows.r[1].shape[1]
    found, open_ = np.zeros((n + 2 * len(rows.r[1]), p)), np.ones(p, dtype=bool)
    for pattern in product((True, False), repeat=len(verge)):
        chosen = np.where(state >= _LOW, np.where(state == _FLOOR, _HELD, _FIXED), state)
        chosen[verge[np.array(pattern)]] = _FREE
        z = _solve_fixed(rows, held, chosen)
        g = rows.g[0] @ z + rows.g[1]
        fine = np.ones(p, dtype=bool)
        for i, free in zip(verge, pattern, strict=True):
            way = -1 if state[i] == _HIGH else 1
            change = z[i] if state[i] != _FLOOR else held[0][i] @ z + held[1][i]
            fine &= side * way * (change if free else g[i]) >= -1e-12 * (1 + np.abs(change if free else g[i]))
        found[:, open_ & fine] = z[:, open_ & fine]
        open_ &= ~fine
        if not open_.any():
            break
    return found


def _solve_fixed(rows: _Rows, held: tuple[Array, Array], state: NDArray[np.intp]) -> Array:
    n, nv = len(state), len(rows.r[1])
    free = np.flatnonzero(state == _FREE)
    at_least = np.flatnonzero(state == _HELD)
    moving = np.sort(np.concatenate([free, at_least]))
    unknown = np.concatenate([moving, n + np.arange(2 * nv)])
    A = np.vstack([rows.r[0], rows.g[0][free], held[0][at_least], rows.c[0]])[:, unknown]
    b = np.vstack([rows.r[1], rows.g[1][free], held[1][at_least], rows.c[1]])
    by_row = np.abs(A).max(axis=1, keepdims=True)
    A, b = A / by_row, b / by_row
    by_column = np.abs(A).max(axis=0)
    z = np.zeros((n + 2 * nv, b.shape[1]))
    z[unknown] = -np.linalg.solve(A / by_column, b) / by_column[:, None]
    return z

"""How a window's end answers to its reserves, T of `hcmc`, and how T itself moves where reserves are large.

HCMC prices reserves by what they do at the window's end, as its correction has it: T follows from inertia M, damping
D = -dF/dv and stiffness K = -dF/dq there (see `sensitivity`). Where reserves are small, so is all that T's change does.
"""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjhcmc.gradients.along import Nodes, Wanted
from mjhcmc.gradients.looks import STEP, Looker, States, moved, slope
from mjhcmc.gradients.tangents import response_to_reserves
from mjhcmc.model import MuscleModel
from mjhcmc.muscle_parameters import FORCE_KINDS, muscle_parameters, parameter_fields

Array = NDArray[np.float64]

_LARGE = 1e-5  # of the muscles' strength at a joint
_WAY = 1e-4  # of second differences: relative to a parameter, and of coordinates and activation


class Around(NamedTuple):
    """M kg m^2, D N m s and K N m, each (..., nv, nv)."""

    M: Array
    D: Array
    K: Array


def reserved(nodes: Nodes, reserve: Array) -> NDArray[np.intp]:
    """The windows (r,) whose reserves (N, nv) are large."""
    strength = np.abs(nodes.B[1:]).sum(axis=2)
    return np.flatnonzero((np.abs(reserve) > _LARGE * strength).any(axis=1))


def around_node(nodes: Nodes, k: int) -> Around:
    """What is known at a node."""
    return _around(nodes.M[k], nodes.Jq[k], nodes.Jv[k], nodes.M_slopes[k][:, :, : len(nodes.M[k])], nodes.qacc[k])


def _around(M: Array, Jq: Array, Jv: Array, M_slopes: Array, qacc: Array) -> Around:
    """From slopes of the acceleration (..., nv, nv): M qacc = F."""
    stiff = M @ Jq + np.einsum("...jic,...i->...jc", M_slopes, qacc)
    return Around(M, -(M @ Jv), -stiff)


def look_around(looker: Looker, states: States) -> Around:
    """The same at k states."""
    seen, by_position, by_velocity, _ = looker.around(states)
    parts = slope(by_position, "qacc"), slope(by_velocity, "qacc"), slope(by_position, "M")
    return _around(seen.M, *parts, seen.qacc)


def response(at: Around, kp: Array, kv: Array, step: float, n_step: int) -> Array:
    """T (nv, nv); the unit matrix without steps."""
    nv = len(kp)
    if n_step == 0:
        return np.eye(nv)
    M, D, K = (np.ascontiguousarray(part) for part in at)
    acc, vel, pos = (np.empty((nv, nv)) for _ in range(3))
    response_to_reserves(M, D, K, step, n_step, acc, vel, pos)
    h = step * n_step
    c = 1.0 + kv * h / 2 + kp * h * h / 6
    return np.asarray((M + h / 2 * D + h * h / 6 * K) / c @ (acc + kv[:, None] * vel + kp[:, None] * pos))


def by_parameters(model: MuscleModel, states: States, wanted: Wanted, threads: int) -> Around:
    """Slopes (k, nv, nv, p) of M, D and K by parameters at k fixed states."""
    k, nv, p, n = len(states.qpos), model.nv, wanted.count(model), model.n_muscle
    found = Around(*(np.zeros((k, nv, nv, p)) for _ in range(3)))
    now = muscle_parameters(model)

    def put(column: int, up: Around, down: Around, way: float) -> None:
        for part, a, b in zip(found, up, down, strict=True):
            part[..., column] = (a - b) / way

    looker = Looker(model, k, threads)

    def seen(m: Any) -> Around:
        with looker.at(m):
            return look_around(looker, states)

    def other(kind: str, i: int, factor: float) -> Any:
        values = now[kind][None].copy()
        values[0, i] *= factor
        m = copy.copy(model.mj_model)
        for name, rows in parameter_fields(model, {kind: values}).items():
            getattr(m, name)[:] = rows[0]
        return m

    for j, kind in enumerate(wanted.kinds):
        if kind in FORCE_KINDS:
            for i in range(n):
                up, down = (seen(other(kind, i, 1 + side * _WAY)) for side in (1, -1))
                put(j * n + i, up, down, 2 * _WAY * now[kind][i])
    for j, direction in enumerate(wanted.models):
        up, down = (seen(moved(model, direction, side * _WAY)) for side in (1, -1))
        put(len(wanted.kinds) * n + j, up, down, 2 * _WAY)
    return found


def turned(
    looker: Looker,
    end: States,
    at: Around,
    explicit: Around,
    gains: tuple[Array, Array, Array, Array],
    tangent: Array,
    step: float,
    n_step: int,
) -> Array:
    """(nv, p) change of T times the reserve.

    Args:
        looker: of the model.
        end: (1) the state at the window's end, under its reserve.
        at: there.
        explicit: (nv, nv, p) slopes by parameters, see `by_parameters`.
        gains: kp, kv (nv,) and their derivatives (nv, p).
        tangent: (2 nv + n, p) of the end.
        step: s, physics step.
        n_step: of the window.
    """
    nv, p = gains[2].shape
    size = np.maximum(np.abs(tangent).max(axis=0), 1e-300)
    ways = (tangent / size).T * _WAY  # of coordinates and activations
    whole = np.concatenate([ways, -ways])
    spread = States(
        end.qpos + whole[:, :nv],
        end.qvel + whole[:, nv : 2 * nv],
        end.activation + whole[:, 2 * nv :],
        np.repeat(end.reserve, 2 * p, axis=0),
    )
    seen = look_around(looker, spread)
    found = np.empty((nv, p))
    kp, kv, kp_slopes, kv_slopes = gains
    for c in range(p):
        slopes = [
            (part[c] - part[p + c]) / (2 * _WAY) * size[c] + by[..., c] for part, by in zip(seen, explicit, strict=True)
        ]
        e = STEP / max(1.0, *(float(np.abs(s).max() / np.abs(m).max()) for s, m in zip(slopes, at, strict=True)))
        up, down = (
            response(
                Around(*(m + side * e * s for m, s in zip(at, slopes, strict=True))),
                kp + side * e * kp_slopes[:, c], kv + side * e * kv_slopes[:, c], step, n_step,
            )
            for side in (1, -1)
        )  # fmt: skip
        found[:, c] = (up - down) @ end.reserve[0] / (2 * e)
    return found

"""The curves of `mjhcmc.hill` for compiled code: the same equations, number for number to rounding.

Each of a model's four curves is packed by its family, so that mixtures work too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from mjhcmc import hill
from mjhcmc.errors import SettingsError
from mjhcmc.hill.degroote_fregly import BELLS, FORCE_VELOCITY

ACTIVE, PASSIVE, VELOCITY, TENDON = range(4)
"""Which curve."""

_NONE, _BEZIER, _THELEN, _DEGROOTE_FREGLY, _MUJOCO = range(5)

_SEGMENTS, _CELLS, _CONSTANTS = 5, 512, 14
_ITERATIONS = 60
_CLOSE = 1e-15

Array = NDArray[np.float64]


class CompiledCurves(NamedTuple):
    """Four curves (see ACTIVE and the rest) as numbers.

    Attributes:
        family: (4,).
        constants: (4, 14) of all families but Bezier.
        segments: (4,) of Bezier curves.
        corners: (4, 6, 3) x, y and slope.
        powers: (4, 5, 2, 6) x(u) and y(u) of each segment, rising powers.
        guesses: (4, 5, 513) u over evenly spaced x.
    """

    family: NDArray[np.int64]
    constants: Array
    segments: NDArray[np.int64]
    corners: Array
    powers: Array
    guesses: Array


def compiled_curves(curves: hill.Curves) -> CompiledCurves:
    """Pack a model's curves.

    Raises:
        SettingsError: a curve that is none of the package's own, which is not compiled.
    """
    packed = CompiledCurves(
        np.zeros(4, np.int64), np.zeros((4, _CONSTANTS)), np.zeros(4, np.int64), np.zeros((4, _SEGMENTS + 1, 3)),
        np.zeros((4, _SEGMENTS, 2, 6)), np.zeros((4, _SEGMENTS, _CELLS + 1)),
    )  # fmt: skip
    for which, curve in enumerate((curves.active, curves.passive, curves.force_velocity, curves.tendon)):
        if curve is None:
            continue
        bezier = curve.curve if isinstance(curve, hill.BezierForceVelocity) else curve
        if isinstance(bezier, hill.BezierCurve):
            _pack_bezier(packed, which, bezier)
        elif type(curve) in _FAMILIES:
            family, constants = _FAMILIES[type(curve)]
            values = constants(curve)
            packed.family[which] = family
            packed.constants[which, : len(values)] = values
        else:
            raise SettingsError(
                f"{curves.name}: a curve of type {type(curve).__name__} is not compiled: give the plant curves of "
                "mjhcmc.hill"
            )
    return packed


def _pack_bezier(packed: CompiledCurves, which: int, curve: hill.BezierCurve) -> None:
    corners, powers, guesses = curve.tables()
    n = len(powers)
    if n > _SEGMENTS:
        raise SettingsError(f"a Bezier curve of {n} segments is not compiled: give at most {_SEGMENTS}")
    packed.family[which], packed.segments[which] = _BEZIER, n
    packed.corners[which, : n + 1], packed.powers[which, :n], packed.guesses[which, :n] = corners, powers, guesses


_FAMILIES: dict[type, tuple[int, Callable[[Any], tuple[float, ...]]]] = {
    hill.ThelenActive: (_THELEN, lambda c: (c.shape,)),
    hill.ThelenPassive: (_THELEN, lambda c: (c.shape / c.strain, 1.0 / np.expm1(c.shape))),
    hill.ThelenForceVelocity: (_THELEN, lambda c: (c.shape, c.max_eccentric, c.linear_from)),
    hill.ThelenTendon: (
        _THELEN,
        lambda c: (c.toe_strain, c.shape / c.toe_strain, c.toe_force / np.expm1(c.shape), c.stiffness),
    ),
    hill.DeGrooteFreglyActive: (_DEGROOTE_FREGLY, lambda c: (c.width, *(b for bell in BELLS for b in bell))),
    hill.DeGrooteFreglyPassive: (_DEGROOTE_FREGLY, lambda c: c.exponential()),
    hill.DeGrooteFreglyForceVelocity: (_DEGROOTE_FREGLY, lambda c: FORCE_VELOCITY),
    hill.DeGrooteFreglyTendon: (_DEGROOTE_FREGLY, lambda c: (c.c1, c.stiffness)),
    hill.MujocoActive: (_MUJOCO, lambda c: (c.lmin, c.lmax)),
    hill.MujocoPassive: (_MUJOCO, lambda c: (c.lmax, c.fpmax)),
    hill.MujocoForceVelocity: (_MUJOCO, lambda c: (c.fvmax,)),
}


@numba.njit(cache=True, error_model="numpy")
def _bezier(c, which, x):  # type: ignore[no-untyped-def]
    """Value at x of a curve; which is an np.int64, so that one version is compiled. Beyond its segments a line."""
    n, corners = c.segments[which], c.corners[which]
    if not x >= corners[0, 0]:
        return corners[0, 1] + corners[0, 2] * (x - corners[0, 0])  # NaN stays NaN
    if x >= corners[n, 0]:
        return corners[n, 1] + corners[n, 2] * (x - corners[n, 0])
    k = 0
    while x >= corners[k + 1, 0]:
        k += 1
    position = (x - corners[k, 0]) * (_CELLS / (corners[k + 1, 0] - corners[k, 0]))
    cell = min(int(position), _CELLS - 1)
    low, high = c.guesses[which, k, cell], c.guesses[which, k, cell + 1]
    u = low + (position - cell) * (high - low)
    p, q = c.powers[which, k, 0], c.powers[which, k, 1]
    for _ in range(_ITERATIONS):
        value = ((((p[5] * u + p[4]) * u + p[3]) * u + p[2]) * u + p[1]) * u + p[0]
        slope = (((5 * p[5] * u + 4 * p[4]) * u + 3 * p[3]) * u + 2 * p[2]) * u + p[1]
        step = (value - x) / slope
        u = min(max(u - step, low), high)
        if abs(step) < 1e-9:  # the next error is its square: below rounding
            break
    return ((((q[5] * u + q[4]) * u + q[3]) * u + q[2]) * u + q[1]) * u + q[0]


@numba.njit(cache=True, error_model="numpy")
def active(c, length):  # type: ignore[no-untyped-def]
    """Active force-length multiplier at normalised fiber length; see `mjhcmc.hill`, as the rest."""
    family, k = c.family[ACTIVE], c.constants[ACTIVE]
    if family == _BEZIER:
        return _bezier(c, np.int64(ACTIVE), length)
    if family == _THELEN:
        return np.exp(-((length - 1.0) ** 2) / k[0])
    if family == _DEGROOTE_FREGLY:
        stretched = (length - 1.0) / k[0] + 1.0
        total = 0.0
        for bell in range(3):
            z = (stretched - k[4 * bell + 2]) / (k[4 * bell + 3] + k[4 * bell + 4] * stretched)
            total += k[4 * bell + 1] * np.exp(-0.5 * z * z)
        return total
    half = (1.0 - k[0]) / 2 if length <= 1.0 else (k[1] - 1.0) / 2
    z = abs(length - 1.0) / half
    outer = max(2.0 - z, 0.0)
    return 1.0 - 0.5 * z * z if z < 1.0 else 0.5 * outer * outer


@numba.njit(cache=True, error_model="numpy")
def passive(c, length):  # type: ignore[no-untyped-def]
    """Passive force-length multiplier at normalised fiber length."""
    family, k = c.family[PASSIVE], c.constants[PASSIVE]
    if family == _BEZIER:
        return _bezier(c, np.int64(PASSIVE), length)
    if family == _THELEN:
        return np.expm1(k[0] * max(length - 1.0, 0.0)) * k[1]
    if family == _DEGROOTE_FREGLY:
        return k[1] * np.exp(k[0] * (length - 1.0)) - k[2]
    z = max(length - 1.0, 0.0) / ((k[0] - 1.0) / 2)
    return k[1] * (0.5 * z * z if z <= 1.0 else z - 0.5)


@numba.njit(cache=True, error_model="numpy")
def tendon(c, length):  # type: ignore[no-untyped-def]
    """Normalised tendon force at normalised tendon length."""
    family, k = c.family[TENDON], c.constants[TENDON]
    if family == _BEZIER:
        return _bezier(c, np.int64(TENDON), length)
    strain = length - 1.0
    if family == _THELEN:
        toe = k[0]
        return k[2] * np.expm1(k[1] * min(max(strain, 0.0), toe)) + k[3] * max(strain - toe, 0.0)
    if family == _DEGROOTE_FREGLY:
        return k[0] * np.expm1(k[1] * strain)
    return np.nan


@numba.njit(cache=True, error_model="numpy")
def force_velocity(c, velocity, activation):  # type: ignore[no-untyped-def]
    """Force-velocity multiplier and its slope at normalised fiber velocity."""
    family, k = c.family[VELOCITY], c.constants[VELOCITY]
    if family == _BEZIER:
        return _bezier(c, np.int64(VELOCITY), velocity), np.nan
    if family == _THELEN:
        reach = 0.25 + 0.75 * activation
        s, shape, top = velocity / reach, k[0], k[1]
        rate, edge = (2.0 + 2.0 / shape) / (top - 1.0), k[2] * top
        fast = (edge - 1.0) / (rate * (top - edge))
        short, long = min(max(s, -1.0), 0.0), min(max(s, 0.0), fast)
        below, above = 1.0 - short / shape, 1.0 + rate * long
        edge_slope = rate * (top - edge) ** 2 / (top - 1.0)
        value = (1.0 + short) / below + (1.0 + rate * top * long) / above - 1.0
        value += min(s + 1.0, 0.0) / (1.0 + 1.0 / shape) + edge_slope * max(s - fast, 0.0)
        slope = (1.0 + 1.0 / shape) / below**2 if s <= 0 else rate * (top - 1.0) / above**2
        return value, slope / reach
    if family == _DEGROOTE_FREGLY:
        inner = k[1] * velocity + k[2]
        return k[0] * np.arcsinh(inner) + k[3], k[0] * k[1] / np.sqrt(inner * inner + 1.0)
    y = k[0] - 1.0
    if velocity <= 0.0:
        short = max(velocity + 1.0, 0.0)
        return short * short, 2.0 * short
    long = max(y - velocity, 0.0)
    return k[0] - long * long / y, 2.0 * long / y


@numba.njit(cache=True, error_model="numpy")
def balanced_velocity(c, target, active_force, activation, damping):  # type: ignore[no-untyped-def]
    """The normalised velocity v at which active_force fV(v) + damping v = target; NaN where there is none."""
    if c.family[VELOCITY] == _BEZIER:
        return _balanced_bezier(c, target, active_force, damping)
    return _balanced_smooth(c, target, active_force, activation, damping)


@numba.njit(cache=True, error_model="numpy")
def _balanced_bezier(c, target, active_force, damping):  # type: ignore[no-untyped-def]
    """In the parameter u of a segment the equation is one polynomial."""
    n, corners = c.segments[VELOCITY], c.corners[VELOCITY]
    before = active_force * corners[0, 1] + damping * corners[0, 0] - target
    if not before < 0.0:
        return _beyond(corners[0], before, active_force, damping)
    for k in range(n):
        after = active_force * corners[k + 1, 1] + damping * corners[k + 1, 0] - target
        if after > 0.0:
            p, q = c.powers[VELOCITY, k, 0], c.powers[VELOCITY, k, 1]
            m0, m1 = damping * p[0] + active_force * q[0] - target, damping * p[1] + active_force * q[1]
            m2, m3 = damping * p[2] + active_force * q[2], damping * p[3] + active_force * q[3]
            m4, m5 = damping * p[4] + active_force * q[4], damping * p[5] + active_force * q[5]
            low, high = 0.0, 1.0
            u = before / (before - after)
            for _ in range(_ITERATIONS):
                value = ((((m5 * u + m4) * u + m3) * u + m2) * u + m1) * u + m0
                slope = (((5 * m5 * u + 4 * m4) * u + 3 * m3) * u + 2 * m2) * u + m1
                if value < 0.0:
                    low = u
                else:
                    high = u
                following = u - value / slope
                if not low <= following <= high:
                    following = 0.5 * (low + high)
                step = following - u
                u = following
                if abs(step) < _CLOSE:
                    break
            return ((((p[5] * u + p[4]) * u + p[3]) * u + p[2]) * u + p[1]) * u + p[0]
        before = after
    return _beyond(corners[n], before, active_force, damping)


@numba.njit(cache=True, error_model="numpy")
def _beyond(corner, value, active_force, damping):  # type: ignore[no-untyped-def]
    """On the straight line beyond a corner, where the balance is off by a value."""
    slope = active_force * corner[2] + damping
    if value == 0.0 and (active_force > 0.0 or damping > 0.0):
        return corner[0]
    return corner[0] - value / slope if slope > 0.0 else np.nan


@numba.njit(cache=True, error_model="numpy")
def _balanced_smooth(c, target, active_force, activation, damping):  # type: ignore[no-untyped-def]
    """Newton's method in velocity, with bisection where it leaves its bracket."""
    value, slope = force_velocity(c, 0.0, activation)
    lack = target - active_force * value
    total = active_force * slope + damping
    if not total > 0.0 or not abs(lack) < np.inf:
        return np.nan
    v = lack / total
    low, high = -np.inf, np.inf
    for _ in range(4 * _ITERATIONS):
        value, slope = force_velocity(c, v, activation)
        residual = active_force * value + damping * v - target
        if residual < 0.0:
            low = v
        else:
            high = v
        following = v - residual / (active_force * slope + damping)
        if not low <= following <= high:
            if low == -np.inf:
                following = 2.0 * high - 1.0 - abs(high)
            elif high == np.inf:
                following = 2.0 * low + 1.0 + abs(low)
            else:
                following = 0.5 * (low + high)
        step = following - v
        v = following
        if not abs(v) < np.inf:
            return np.nan
        if abs(step) <= _CLOSE * (1.0 + abs(v)):
            return v
    return v

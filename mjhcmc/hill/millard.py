"""The normalised curves of Millard, Uchida, Seth and Delp (2013) as quintic Bezier splines, in NumPy alone.

Each curve is a chain of quintic Bezier segments in the plane (x, y). A segment joins two end points with given slopes;
its inner control points lie in pairs on the two tangents, moved from the ends towards the tangents' crossing by the
fraction .1 + .8 curviness, so that slope is continuous and curvature vanishes at the joints. Outside its segments a
curve goes on as a straight line.

Reference: M. Millard, T. Uchida, A. Seth, S. L. Delp, "Flexing computational muscle: modeling and simulation of
musculotendon dynamics", J. Biomech. Eng. 135(2), 021005, 2013. Defaults are the parameters given there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_TO_POWERS = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [-5, 5, 0, 0, 0, 0],
        [10, -20, 10, 0, 0, 0],
        [-10, 30, -30, 10, 0, 0],
        [5, -20, 30, -20, 5, 0],
        [-1, 5, -10, 10, -5, 1],
    ],
    dtype=np.float64,
)
"""Bernstein control values of degree five to coefficients of rising powers."""

_MAX_ITERATIONS = 60
_ROOT_TOLERANCE = 1e-14


@dataclass(frozen=True)
class Corner:
    """A point of a curve and the curve's slope there: where two Bezier segments meet."""

    x: float
    y: float
    slope: float


class BezierCurve:
    """A curve y(x) of quintic Bezier segments through given corners, linear beyond both ends.

    Args:
        corners: The n + 1 ends of the n segments, x increasing.
        curviness: From 0 (near the straight chord) to 1 (near the tangents).

    Raises:
        ValueError: Fewer than two corners, x not increasing, or curviness outside 0 to 1.
    """

    def __init__(self, corners: Sequence[Corner], curviness: float | Sequence[float]) -> None:
        bends = np.broadcast_to(np.asarray(curviness, float), (max(len(corners) - 1, 1),))
        if len(corners) < 2 or any(b.x <= a.x for a, b in pairwise(corners)):
            raise ValueError("BezierCurve: corners must be at least two, with increasing x")
        if np.any((bends < 0) | (bends > 1)):
            raise ValueError(f"BezierCurve: curviness is {curviness}: give numbers from 0 to 1")
        points = [_control_points(a, b, 0.1 + 0.8 * c) for (a, b), c in zip(pairwise(corners), bends, strict=True)]
        controls = np.array(points)  # (segments, 2, 6)
        self._powers = controls @ _TO_POWERS.T
        self._knots = np.array([corner.x for corner in corners])
        self._first, self._last = corners[0], corners[-1]

    def __call__(self, x: ArrayLike) -> Array:
        """The curve's value at ``x``, an array of any shape; NaN stays NaN."""
        return self._evaluate(x)[0]

    def derivative(self, x: ArrayLike) -> Array:
        """The curve's slope dy/dx at ``x``, an array of any shape."""
        return self._evaluate(x)[1]

    def _evaluate(self, x: ArrayLike) -> tuple[Array, Array]:
        values = np.asarray(x, dtype=np.float64)
        flat = np.atleast_1d(values).ravel()
        inner = np.clip(flat, self._knots[0], self._knots[-1])
        segment = np.clip(np.searchsorted(self._knots, inner, side="right") - 1, 0, len(self._knots) - 2)
        px, py = np.moveaxis(self._powers[segment], 1, 0)
        u = _solve_monotone(px, inner)
        y = np.where(np.isnan(flat), np.nan, _horner(py, u))
        # dx/du never vanishes: inner control points keep at least a tenth of the way to the tangents' crossing.
        slope = np.where(np.isnan(flat), np.nan, _horner_derivative(py, u) / _horner_derivative(px, u))
        below, above = flat < self._knots[0], flat > self._knots[-1]
        y = np.where(below, self._first.y + self._first.slope * (flat - self._first.x), y)
        y = np.where(above, self._last.y + self._last.slope * (flat - self._last.x), y)
        slope = np.where(below, self._first.slope, np.where(above, self._last.slope, slope))
        return y.reshape(values.shape), slope.reshape(values.shape)


@dataclass(frozen=True)
class ActiveForceLength:
    """Parameters of the active force-length curve; lengths in optimal fiber lengths.

    Attributes:
        min_norm_length: Length below which no active force arises.
        transition_norm_length: Where the steep part passes into the shallow ascending part.
        max_norm_length: Length above which no active force arises.
        shallow_ascending_slope: Slope of the shallow ascending part.
        minimum_value: Value outside the two limits.
    """

    min_norm_length: float = 0.4441
    transition_norm_length: float = 0.73
    max_norm_length: float = 1.8123
    shallow_ascending_slope: float = 0.8616
    minimum_value: float = 0.0


@dataclass(frozen=True)
class ForceVelocity:
    """Parameters of the force-velocity curve; velocities in maximum fiber velocities, lengthening positive."""

    concentric_slope_at_vmax: float = 0.0
    concentric_slope_near_vmax: float = 0.25
    isometric_slope: float = 5.0
    eccentric_slope_at_vmax: float = 0.0
    eccentric_slope_near_vmax: float = 0.15
    max_eccentric_multiplier: float = 1.4
    concentric_curviness: float = 0.6
    eccentric_curviness: float = 0.9


@dataclass(frozen=True)
class PassiveForceLength:
    """Parameters of the passive force-length curve; ``None`` takes the value that the strains imply.

    Attributes:
        strain_at_zero_force: Fiber strain at which passive force begins.
        strain_at_one_norm_force: Fiber strain at which it reaches the maximum isometric force.
        stiffness_at_low_force: Slope at the end of the toe; .2 where None.
        stiffness_at_one_norm_force: Slope at that strain; 2 over the strain between where None.
        curviness: Bend of the curve; .75 where None.
    """

    strain_at_zero_force: float = 0.0
    strain_at_one_norm_force: float = 0.7
    stiffness_at_low_force: float | None = None
    stiffness_at_one_norm_force: float | None = None
    curviness: float | None = None


def active_force_length(parameters: ActiveForceLength | None = None) -> BezierCurve:
    """The active force-length multiplier as a function of normalised fiber length (Millard et al. 2013, Fig. 3).

    Args:
        parameters: The curve's parameters; the paper's where None.
    """
    p = parameters or ActiveForceLength()
    shoulder = 0.05  # half width of the plateau's rounding, in optimal lengths
    low, transition, high = p.min_norm_length, p.transition_norm_length, p.max_norm_length
    # The shallow line ends at height 1 one shoulder before the optimum; its middle is a corner.
    y_transition = 1.0 - p.shallow_ascending_slope * (1.0 - shoulder - transition)
    x_shallow = (transition + 1.0 - shoulder) / 2
    x_rise, y_rise = (low + transition) / 2, y_transition / 2
    x_fall = (1.0 + shoulder + high) / 2
    return BezierCurve(
        [
            Corner(low, p.minimum_value, 0.0),
            Corner(x_rise, y_rise, 1.25 * y_transition / (transition - low)),
            Corner(x_shallow, (1.0 + y_transition) / 2, p.shallow_ascending_slope),
            Corner(1.0, 1.0, 0.0),
            Corner(x_fall, 0.5, -1.0 / (high - 1.0 - 2 * shoulder)),
            Corner(high, p.minimum_value, 0.0),
        ],
        curviness=1.0,
    )


def force_velocity(parameters: ForceVelocity | None = None) -> BezierCurve:
    """The force-velocity multiplier as a function of normalised fiber velocity, lengthening positive.

    Args:
        parameters: The curve's parameters; the paper's where None.
    """
    p = parameters or ForceVelocity()
    near = 0.9  # where "near" the maximum velocity is
    gap = 1.0 - near
    slow = (p.concentric_slope_near_vmax + p.concentric_slope_at_vmax) / 2 * gap
    fast = (p.eccentric_slope_near_vmax + p.eccentric_slope_at_vmax) / 2 * gap
    return BezierCurve(
        [
            Corner(-1.0, 0.0, p.concentric_slope_at_vmax),
            Corner(-near, slow, p.concentric_slope_near_vmax),
            Corner(0.0, 1.0, p.isometric_slope),
            Corner(near, p.max_eccentric_multiplier - fast, p.eccentric_slope_near_vmax),
            Corner(1.0, p.max_eccentric_multiplier, p.eccentric_slope_at_vmax),
        ],
        curviness=[p.concentric_curviness] * 2 + [p.eccentric_curviness] * 2,
    )


def passive_force_length(parameters: PassiveForceLength | None = None) -> BezierCurve:
    """The passive force-length multiplier as a function of normalised fiber length.

    Args:
        parameters: The curve's parameters; the paper's where None.
    """
    p = parameters or PassiveForceLength()
    span = p.strain_at_one_norm_force - p.strain_at_zero_force
    low = 0.2 if p.stiffness_at_low_force is None else p.stiffness_at_low_force
    high = 2.0 / span if p.stiffness_at_one_norm_force is None else p.stiffness_at_one_norm_force
    curviness = 0.75 if p.curviness is None else p.curviness
    zero = 1.0 + p.strain_at_zero_force
    toe = min(0.1 / high, 0.1 * span)
    return BezierCurve(
        [
            Corner(zero, 0.0, 0.0),
            Corner(zero + toe, low * toe / 2, low),
            Corner(1.0 + p.strain_at_one_norm_force, 1.0, high),
        ],
        curviness=curviness,
    )


def _control_points(a: Corner, b: Corner, bend: float) -> Array:
    """Control points (2, 6) of the segment from a to b."""
    if abs(a.slope - b.slope) > np.sqrt(np.finfo(float).eps):
        x = (b.y - a.y - b.x * b.slope + a.x * a.slope) / (a.slope - b.slope)
    else:
        x = (a.x + b.x) / 2
    y = (x - b.x) * b.slope + b.y
    near_a = (a.x + bend * (x - a.x), a.y + bend * (y - a.y))
    near_b = (b.x + bend * (x - b.x), b.y + bend * (y - b.y))
    return np.array([(a.x, a.y), near_a, near_a, near_b, near_b, (b.x, b.y)]).T


def _horner(powers: Array, u: Array) -> Array:
    value = powers[:, 5]
    for k in range(4, -1, -1):
        value = value * u + powers[:, k]
    return value


def _horner_derivative(powers: Array, u: Array) -> Array:
    value = 5 * powers[:, 5]
    for k in range(4, 0, -1):
        value = value * u + k * powers[:, k]
    return value


def _solve_monotone(powers: Array, target: Array) -> Array:
    """The u in [0, 1] with x(u) = target for rising x: Newton's method, with bisection where it leaves its bracket."""
    low, high = np.zeros_like(target), np.ones_like(target)
    u = np.full_like(target, 0.5)
    for _ in range(_MAX_ITERATIONS):
        error = _horner(powers, u) - target
        low, high = np.where(error < 0, u, low), np.where(error > 0, u, high)
        newton = u - error / _horner_derivative(powers, u)
        step = np.where((newton >= low) & (newton <= high), newton, (low + high) / 2)
        moved = np.abs(step - u)
        u = step
        if not np.any(moved > _ROOT_TOLERANCE):
            break
    return u

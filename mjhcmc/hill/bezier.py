"""Curves y(x) of quintic Bezier segments, evaluated and inverted on arrays.

A segment joins two corners with given slopes; its inner control points lie in pairs on the two tangents, moved from the
ends towards the tangents' crossing by the fraction .1 + .8 curviness, so that slope is continuous and curvature
vanishes at the corners. Outside its segments a curve goes on as a straight line.

Reference: M. Millard, T. Uchida, A. Seth, S. L. Delp, "Flexing computational muscle: modeling and simulation of
musculotendon dynamics", J. Biomech. Eng. 135(2), 021005, 2013, doi:10.1115/1.4023390.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.curves import refuse_outside
from mjhcmc.hill.errors import HillError

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

_MAX_ITERATIONS = 80
_ROOT_TOLERANCE = 1e-14
_CELLS = 512
"""Cells of a segment's table of first guesses."""
_SQUARES_TO_ROUNDING = 1e-9
"""After a Newton step this small the next error is its square times a modest curvature: below rounding."""


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
        HillError: Fewer than two corners, numbers that are not finite, x not increasing, curviness outside 0 to 1, or
            slopes whose tangents cross outside the segment, so that the segment would fold back.
    """

    def __init__(self, corners: Sequence[Corner], curviness: float | Sequence[float]) -> None:
        bends = np.broadcast_to(np.asarray(curviness, float), (max(len(corners) - 1, 1),))
        if not all(np.isfinite([c.x, c.y, c.slope]).all() for c in corners):
            raise HillError(f"BezierCurve: a corner is not finite among {list(corners)}: give finite numbers")
        if len(corners) < 2 or any(b.x <= a.x for a, b in pairwise(corners)):
            raise HillError("BezierCurve: corners must be at least two, with increasing x")
        if not np.all((bends >= 0) & (bends <= 1)):
            raise HillError(f"BezierCurve: curviness is {curviness}: give numbers from 0 to 1")
        points = [_control_points(a, b, 0.1 + 0.8 * c) for (a, b), c in zip(pairwise(corners), bends, strict=True)]
        for (a, b), (px, _) in zip(pairwise(corners), points, strict=True):
            if np.any(np.diff(px) < 0):
                raise HillError(
                    f"BezierCurve: between x = {a.x:g} and {b.x:g} the slopes {a.slope:g} and {b.slope:g} fit no "
                    "curve: their tangents must cross between the corners"
                )
        controls = np.array(points)  # (segments, 2, 6)
        self._powers = controls @ _TO_POWERS.T
        self._knots = np.array([corner.x for corner in corners])
        self._heights = np.array([corner.y for corner in corners])
        self._first, self._last = corners[0], corners[-1]
        self._guesses = [_guesses(powers[0], low, high) for powers, low, high in self._pieces()]

    def __call__(self, x: ArrayLike) -> Array:
        """The curve's value at ``x``, an array of any shape; NaN stays NaN."""
        return self.evaluate(x)[0]

    def derivative(self, x: ArrayLike) -> Array:
        """The curve's slope dy/dx at ``x``, an array of any shape."""
        return self.evaluate(x)[1]

    def evaluate(self, x: ArrayLike) -> tuple[Array, Array]:
        """Value and slope at ``x``, an array of any shape; NaN stays NaN."""
        values = np.asarray(x, dtype=np.float64)
        flat = values.ravel()
        segment = np.searchsorted(self._knots, flat, side="right")  # NaN sorts last
        y, slope = np.empty_like(flat), np.empty_like(flat)
        for end, corner in ((0, self._first), (len(self._knots), self._last)):
            where = np.flatnonzero(segment == end)
            if where.size:
                beyond = flat[where] - corner.x
                y[where] = corner.y + corner.slope * beyond
                slope[where] = corner.slope + 0 * beyond  # NaN stays NaN
        for k, (powers, low, high) in enumerate(self._pieces()):
            where = np.flatnonzero(segment == k + 1)
            if where.size:
                u = _solve_from_table(powers[0], self._guesses[k], low, high, flat[where])
                y[where] = _horner(powers[1], u)
                slope[where] = _horner_derivative(powers[1], u) / _horner_derivative(powers[0], u)
        return y.reshape(values.shape), slope.reshape(values.shape)

    def inverse(self, y: ArrayLike) -> Array:
        """The x with value ``y``, an array of any shape, of a curve that rises; NaN stays NaN.

        At the height of a flat end it is the end's corner.

        Raises:
            HillError: The curve falls somewhere, or no x has this value.
        """
        values = np.asarray(y, dtype=np.float64)
        if np.any(np.diff(self._heights) <= 0):
            raise HillError("BezierCurve: only a curve whose corners rise has an inverse")
        flat = values.ravel()
        low = -np.inf if self._first.slope > 0 else self._first.y
        high = np.inf if self._last.slope > 0 else self._last.y
        refuse_outside("BezierCurve", flat, low, high)
        segment = np.searchsorted(self._heights, flat, side="right")
        x = np.empty_like(flat)
        for end, corner in ((0, self._first), (len(self._knots), self._last)):
            where = np.flatnonzero(segment == end)
            if where.size:
                beyond = flat[where] - corner.y
                x[where] = corner.x + (beyond / corner.slope if corner.slope > 0 else beyond)
        for k, (powers, _, _) in enumerate(self._pieces()):
            where = np.flatnonzero(segment == k + 1)
            if where.size:
                x[where] = _horner(powers[0], _solve_monotone(powers[1], flat[where]))
        return x.reshape(values.shape)

    def tables(self) -> tuple[Array, Array, Array]:
        """What the curve is made of, for code that evaluates it elsewhere.

        Returns:
            (n + 1, 3) x, y and slope of the corners; (n, 2, 6) coefficients of x(u) and y(u) of each segment, of rising
            powers of u in [0, 1]; (n, k) the u of evenly spaced x of each segment, to begin Newton's method from.
        """
        slopes = [self._first.slope, *self.derivative(self._knots[1:-1]), self._last.slope]
        return np.stack([self._knots, self._heights, slopes], axis=1), self._powers.copy(), np.stack(self._guesses)

    def _pieces(self) -> list[tuple[Array, float, float]]:
        return list(zip(self._powers, self._knots[:-1].tolist(), self._knots[1:].tolist(), strict=True))


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
    value: Array = powers[5] * u
    for k in range(4, 0, -1):
        value += powers[k]
        value *= u
    value += powers[0]
    return value


def _horner_derivative(powers: Array, u: Array) -> Array:
    value: Array = 5 * powers[5] * u
    for k in range(4, 1, -1):
        value += k * powers[k]
        value *= u
    value += powers[1]
    return value


def _guesses(powers: Array, low: float, high: float) -> Array:
    """The u of evenly spaced x: 0 and 1, to the last digit, at the ends."""
    inner = _solve_monotone(powers, np.linspace(low, high, _CELLS + 1)[1:-1])
    return np.concatenate([[0.0], inner, [1.0]])


def _solve_from_table(powers: Array, guesses: Array, low: float, high: float, target: Array) -> Array:
    """The u in [0, 1] with x(u) = target in [low, high]: Newton's method from a table over evenly spaced x."""
    position = (target - low) * (_CELLS / (high - low))
    cell = np.minimum(position.astype(np.intp), _CELLS - 1)
    left, right = guesses[cell], guesses[cell + 1]
    u: Array = left + (position - cell) * (right - left)
    for _ in range(_MAX_ITERATIONS):
        step = (_horner(powers, u) - target) / _horner_derivative(powers, u)
        u -= step
        np.clip(u, left, right, out=u)
        if np.abs(step).max() < _SQUARES_TO_ROUNDING:
            return u
    return _solve_monotone(powers, target)


def _solve_monotone(powers: Array, target: Array) -> Array:
    """The u in [0, 1] with x(u) = target for rising x: Newton's method, with bisection where it leaves its bracket."""
    low, high = np.zeros_like(target), np.ones_like(target)
    u = np.full_like(target, 0.5)
    for _ in range(_MAX_ITERATIONS):
        error = _horner(powers, u) - target
        low, high = np.where(error < 0, u, low), np.where(error > 0, u, high)
        with np.errstate(divide="ignore", invalid="ignore"):  # a flat end: bisection takes over
            newton = u - error / _horner_derivative(powers, u)
        step = np.where(error == 0, u, np.where((newton >= low) & (newton <= high), newton, (low + high) / 2))
        moved = np.abs(step - u)
        u = step
        if not np.any(moved > _ROOT_TOLERANCE):
            break
    return u

"""The functions of one coordinate that OpenSim models are written with: how joints slide and path points move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import ModelError

Array = NDArray[np.float64]
OsimFunction = Callable[[Array], Array]
"""A function of one coordinate, over an array of its values (rad or m)."""


@dataclass(frozen=True)
class Polynomial:
    """A polynomial: a constant, a line, or more.

    Attributes:
        coefficients: From the highest power to the constant.
    """

    coefficients: tuple[float, ...]

    def __call__(self, x: Array) -> Array:
        """The values at x."""
        return np.polyval(np.asarray(self.coefficients), np.asarray(x, float))


@dataclass(frozen=True)
class PiecewiseLinear:
    """Straight lines between points, and on along the outermost ones.

    Attributes:
        x: Where the points are, rising.
        y: The values there.
    """

    x: tuple[float, ...]
    y: tuple[float, ...]

    def __call__(self, x: Array) -> Array:
        """The values at x."""
        place, points = np.asarray(x, float), np.asarray(self.x)
        slopes = np.diff(self.y) / np.diff(points)
        piece = np.clip(np.searchsorted(points, place, side="right") - 1, 0, len(slopes) - 1)
        return np.asarray(np.asarray(self.y)[piece] + slopes[piece] * (place - points[piece]))


@dataclass(frozen=True)
class CubicSpline:
    """OpenSim's SimmSpline (once NaturalCubicSpline), straight beyond its ends.

    Its ends are not the natural ones: the third derivative in the first and in the last piece is that of the cubic
    through the four outermost points (Forsythe, Malcolm, Moler 1977, Computer Methods for Mathematical Computations).

    Attributes:
        x: Where the points are, rising.
        y: The values there.
    """

    x: tuple[float, ...]
    y: tuple[float, ...]
    _slopes: Array = field(init=False, repr=False, compare=False)
    _curvatures: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Solve for the spline's pieces."""
        curvature = _curvatures(np.asarray(self.x), np.asarray(self.y))
        step = np.diff(self.x)
        first = np.diff(self.y) / step - step * (curvature[1:] + 2 * curvature[:-1]) / 6
        last = first[-1] + step[-1] * (curvature[-2] + curvature[-1]) / 2
        object.__setattr__(self, "_slopes", np.append(first, last))
        object.__setattr__(self, "_curvatures", curvature)

    def __call__(self, x: Array) -> Array:
        """The values at x."""
        place, points, values = np.asarray(x, float), np.asarray(self.x), np.asarray(self.y)
        piece = np.clip(np.searchsorted(points, place, side="right") - 1, 0, len(points) - 2)
        within = np.clip(place, points[0], points[-1])
        d, step = within - points[piece], np.diff(points)[piece]
        second = self._curvatures[piece]
        third = (self._curvatures[piece + 1] - second) / step
        inside = values[piece] + d * (self._slopes[piece] + d * (second / 2 + d * third / 6))
        beyond = np.where(place < points[0], self._slopes[0], self._slopes[-1]) * (place - within)
        return np.asarray(inside + beyond)


def _curvatures(x: Array, y: Array) -> Array:
    """Second derivatives of the spline at its points, from the tridiagonal system of continuous slopes."""
    n = len(x)
    if n == 2:
        return np.zeros(2)
    step, slope = np.diff(x), np.diff(y) / np.diff(x)
    matrix, right = np.zeros((n, n)), np.zeros(n)
    for i in range(1, n - 1):
        matrix[i, i - 1 : i + 2] = step[i - 1], 2 * (step[i - 1] + step[i]), step[i]
        right[i] = 6 * (slope[i] - slope[i - 1])
    matrix[0, :2] = -1 / step[0], 1 / step[0]
    matrix[-1, -2:] = -1 / step[-1], 1 / step[-1]
    if n > 3:
        right[0], right[-1] = (6 * _third_difference(x[i : i + 4], y[i : i + 4]) for i in (0, n - 4))
    return np.asarray(np.linalg.solve(matrix, right), float)


def _third_difference(x: Array, y: Array) -> float:
    for order in (1, 2, 3):
        y = np.diff(y) / (x[order:] - x[:-order])
    return float(y[0])


@dataclass(frozen=True)
class Scaled:
    """Another function times a number, as OpenSim's scale tool writes it.

    Attributes:
        function: The function.
        scale: The number.
    """

    function: OsimFunction
    scale: float

    def __call__(self, x: Array) -> Array:
        """The values at x."""
        return self.scale * self.function(x)


@dataclass(frozen=True)
class UnknownFunction:
    """A function of a kind that is not read; only asking for its values is an error.

    Attributes:
        where: The file and the element that holds it, for the message.
        kind: Its kind in the file.
    """

    where: str
    kind: str

    def __call__(self, x: Array) -> NoReturn:
        """Never returns.

        Raises:
            ModelError: always.
        """
        raise ModelError(
            f"{self.where}: function {self.kind} is not known: write it as a SimmSpline, PolynomialFunction, "
            "LinearFunction, PiecewiseLinearFunction or Constant"
        )

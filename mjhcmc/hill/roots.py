"""Many scalar equations at once: Newton's method with bisection where it strays or stalls."""

from __future__ import annotations

from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from mjhcmc.hill.errors import HillError

Array = NDArray[np.float64]

_MAX_ITERATIONS = 200


class Equations(Protocol):
    """n scalar equations r(x) = 0."""

    def residual(self, x: Array) -> tuple[Array, Array, Array]:
        """Residual, its slope, and the size that the residual is judged against, each (n,)."""
        ...

    def take(self, index: NDArray[np.intp]) -> Self:
        """The equations at these positions."""
        ...


def solve_rising(equations: Equations, low: Array, high: Array, start: Array, tolerance: float = 1e-13) -> Array:
    """Roots of equations with residual <= 0 at ``low`` and >= 0 at ``high``: one where the residual rises.

    A Newton step that leaves the bracket, is not finite, or is over half the step before the last gives way to a
    bisection, so that every element converges (Press et al., Numerical Recipes, "rtsafe").

    Args:
        equations: n equations.
        low: Lower ends (n,).
        high: Upper ends (n,).
        start: First guesses (n,), inside.
        tolerance: Largest residual over its size; a bracket of neighbouring numbers ends the search as well.

    Returns:
        Roots (n,).

    Raises:
        HillError: No convergence, which a rising residual cannot cause.
    """
    root = np.array(start, dtype=np.float64)
    index = np.arange(root.size)
    x, low, high = root.copy(), np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
    before = last = high - low
    for _ in range(_MAX_ITERATIONS):
        value, slope, size = equations.residual(x)
        low, high = np.where(value <= 0, x, low), np.where(value >= 0, x, high)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            newton = x - value / slope
            good = (newton >= low) & (newton <= high) & (np.abs(newton - x) <= 0.5 * before)
        following = np.where(good, newton, 0.5 * (low + high))
        done = (np.abs(value) <= tolerance * size) | (high - low <= 2 * np.spacing(np.maximum(abs(low), abs(high))))
        if done.any():
            root[index[done]] = np.where(good, newton, x)[done]
            keep = np.flatnonzero(~done)
            if not keep.size:
                return root
            index, equations = index[keep], equations.take(keep)
            before, last = last[keep], np.abs(following - x)[keep]
            x, low, high = following[keep], low[keep], high[keep]
        else:
            before, last = last, np.abs(following - x)
            x = following
    raise HillError(f"no root after {_MAX_ITERATIONS} steps for {index.size} equations: the residual does not rise")

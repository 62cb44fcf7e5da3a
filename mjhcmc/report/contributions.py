"""What follows from a solution and its model, for drawing: muscles' shares of the moments, fibers."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SimulationError
from mjhcmc.plotting.moments import MUSCLE_COLORS, colors_of, ranked_by_peak
from mjhcmc.solution import Solution

Array = NDArray[np.float64]

MOST_NODES = 3000
"""Of a longer solution every second (third, ...) node is drawn: a screen shows no more, and memory is bounded."""


@dataclass(frozen=True, eq=False)
class Thinned:
    """`Detail` at some of the nodes.

    Attributes:
        time: (n,) s.
        every: of the solution's nodes, one in so many.
        muscle_moment: (n, n_muscle, nv) N m or N.
        normalized_fiber_length: (n, n_muscle) in L0.
        normalized_fiber_velocity: (n, n_muscle) in L0 a second.
    """

    time: Array
    every: int
    muscle_moment: Array
    normalized_fiber_length: Array
    normalized_fiber_velocity: Array


def detail_of(solution: Solution) -> tuple[Thinned | None, str]:
    """Detail for drawing, and why there is none: an empty text where there is."""
    every = -(-len(solution.time) // MOST_NODES)
    try:
        if every == 1:
            detail = solution.detail
        else:
            detail = _some_nodes(solution, np.arange(0, len(solution.time), every)).detail
    except SimulationError as why:
        return None, str(why)
    return (
        Thinned(
            detail.solution.time, every, detail.muscle_moment, detail.normalized_fiber_length,
            detail.normalized_fiber_velocity,
        ),
        "",
    )  # fmt: skip


def _some_nodes(solution: Solution, nodes: NDArray[np.intp]) -> Solution:
    """The solution at some nodes alone; what holds over a window is that of the window which starts there."""
    windows = nodes[:-1]
    changes: dict[str, Any] = {}
    for item in fields(solution):
        value = getattr(solution, item.name)
        if isinstance(value, np.ndarray) and item.name != "dof_is_rotation":
            changes[item.name] = value[nodes if len(value) == len(solution.time) else windows]
    return replace(solution, **changes)


def stacks(muscle_moment: Array, dofs: list[int]) -> list[tuple[list[int], list[int], dict[int, str]]]:
    """For each degree of freedom: the muscles named in its stack, largest first; the rest; and the look of each named.

    A look is ``m0`` .. ``m8``, of `MUSCLE_COLORS`; a muscle has the same at every joint where that is free.
    """
    ranked = [ranked_by_peak(muscle_moment[:, :, j]) for j in dofs]
    colors = colors_of(ranked, [muscles[: len(MUSCLE_COLORS)] for muscles in ranked])
    return [
        (
            [i for i in muscles if i in own],
            [i for i in muscles if i not in own],
            {i: f"m{MUSCLE_COLORS.index(color)}" for i, color in own.items()},
        )
        for muscles, own in zip(ranked, colors, strict=True)
    ]

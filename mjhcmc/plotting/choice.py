"""Which degrees of freedom a figure shows: the tracked ones; of many, those that tell most."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjhcmc.solution import Solution, moment_scale

MOST = 12
"""Degrees of freedom in a figure."""


def tracked(solution: Solution) -> list[int]:
    """Degrees of freedom that are tracked; all of a solution that tracks none."""
    found = [j for j, role in enumerate(solution.roles) if role == "tracked"]
    return found or list(range(len(solution.dof_names)))


def most_telling(solution: Solution, dofs: Sequence[int], most: int = MOST) -> tuple[list[int], int]:
    """Of many degrees of freedom, those that move, carry or err most.

    Each counts by the best of four shares: of the largest range of the desired motion, net joint moment, tracking error
    and reserve among its kind (rotations, or slides). What has the largest reserve for its moment is never left out.

    Args:
        solution: they are of.
        dofs: to choose from, rising.
        most: how many there may be.

    Returns:
        Those chosen, rising, and how many are left out.
    """
    if len(dofs) <= most:
        return list(dofs), 0
    own = np.array(dofs)
    way = solution.named_coordinates.shown(solution.qpos_desired, solution.qpos_desired[0])
    reserve = np.abs(solution.reserve).max(axis=0)
    score = np.zeros(len(own))
    for kind in (True, False):
        alike = solution.dof_is_rotation[own] == kind
        some = own[alike]
        error = np.abs(solution.tracking_error).max(axis=0)
        for size in (np.ptp(way, axis=0), solution.peak_moment, error, reserve):
            score[alike] = np.maximum(score[alike], _share(size[some]))
    score[np.argmax((reserve / moment_scale(solution.net_joint_moment))[own])] = 1.0
    chosen = np.sort(np.argsort(-score, kind="stable")[:most])
    return own[chosen].tolist(), len(own) - most


def _share(size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the largest; 0 where nothing is larger than 0, or not finite."""
    size = np.where(np.isfinite(size), size, 0.0)
    largest = size.max(initial=0.0)
    return size / largest if largest > 0 else np.zeros_like(size)

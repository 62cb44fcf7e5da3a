"""Points, lengths and inertias of the source, scaled and turned into the model's frame (z up)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Scale:
    """Ratios of body mass and height to the source's, applied to the quantities of the table.

    Attributes:
        mass: Ratio of body masses.
        height: Ratio of statures.
    """

    mass: float = 1.0
    height: float = 1.0

    def point(self, pos: Sequence[float] | Vector) -> list[float]:
        """A point of the source in the model's frame, m, to a micrometre."""
        return [round(float(x), 6) + 0.0 for x in np.asarray(to_world(pos)) * self.height]

    def length(self, value: float) -> float:
        """A length of the source in the model, m."""
        return digits(value * self.height)


def to_world(vector: Sequence[float] | Vector) -> list[float]:
    """A vector of the source's frame (y up) in the model's frame (z up): (x, y, z) becomes (x, -z, y)."""
    x, y, z = (float(c) for c in vector)
    return [x, -z + 0.0, y]


def digits(value: float) -> float:
    """A value at the six significant digits that MuJoCo writes to XML, so that file and builder agree."""
    return float(f"{value:.6g}")


def compose_inertia(parts: Sequence[tuple[float, Vector, Vector, Vector]]) -> tuple[float, Vector, Vector]:
    """Mass, centre of mass and inertia of rigidly joined parts, by the parallel axis theorem.

    Args:
        parts: For each part its mass (kg), the origin of its frame, its centre of mass in that frame (m), and its
            principal moments (3,) or inertia matrix (3, 3) about it (kg m^2); all frames parallel.

    Returns:
        Mass, centre of mass (3,) and inertia about it (3, 3).
    """
    mass = sum(part[0] for part in parts)
    centres = [origin + com for _, origin, com, _ in parts]
    centre = np.sum([part[0] * c for part, c in zip(parts, centres, strict=True)], axis=0) / mass
    inertia = np.zeros((3, 3))
    for part, c in zip(parts, centres, strict=True):
        d = c - centre
        inertia += (np.diag(part[3]) if part[3].ndim == 1 else part[3]) + part[0] * (d @ d * np.eye(3) - np.outer(d, d))
    return mass, centre, inertia

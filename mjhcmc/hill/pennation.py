"""Constant-thickness pennation: fibers are the sides of a parallelogram of constant width.

lM sin(alpha) = lopt sin(alpha0), so that lM cos(alpha) = sqrt(lM^2 - (lopt sin(alpha0))^2) and, with the tendon's share
taken away, d(lM)/dt = cos(alpha) d(lM cos(alpha))/dt.

Reference: F. E. Zajac, "Muscle and tendon: properties, models, scaling, and application to biomechanics and motor
control", Crit. Rev. Biomed. Eng. 17(4), 359-411, 1989.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.parameters import HillModel
from mjhcmc.hill.states import read, refuse

Array = NDArray[np.float64]


def pennation_angle(model: HillModel, fiber_length: ArrayLike) -> Array:
    """Pennation angle at fiber lengths.

    Args:
        model: The muscles.
        fiber_length: (..., m), m.

    Returns:
        Angle (..., m), rad.

    Raises:
        HillError: Naming the muscle whose fiber is too short for its width.
    """
    length = read(model, fiber_length=fiber_length)["fiber_length"]
    check_width(model, length)
    return np.arcsin(model.muscles.fiber_width / length)


def fiber_length_along(model: HillModel, fiber_length: ArrayLike) -> Array:
    """Fiber length along the tendon, lM cos(alpha).

    Args:
        model: The muscles.
        fiber_length: (..., m), m.

    Returns:
        Length (..., m), m.

    Raises:
        HillError: Naming the muscle whose fiber is too short for its width.
    """
    length = read(model, fiber_length=fiber_length)["fiber_length"]
    check_width(model, length)
    return np.sqrt(length**2 - model.muscles.fiber_width**2)


def check_width(model: HillModel, fiber_length: Array) -> None:
    """Raise where a fiber is no longer than its width: pennation would reach 90 degrees.

    Raises:
        HillError: Naming the muscle and the length.
    """
    width = model.muscles.fiber_width
    if not (fiber_length > width).all():
        short = ~(fiber_length > width)
        refuse(
            model.muscles,
            "fiber_length",
            fiber_length,
            short,
            "pennation reaches 90 deg: give a length over optimal_fiber_length sin(pennation_at_optimal)",
        )

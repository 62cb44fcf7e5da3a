"""Muscles whose tendon does not stretch: everything follows from length, velocity and activation at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mjhcmc.hill.parameters import HillModel
from mjhcmc.hill.states import MuscleState, assemble, read, refuse


def rigid_tendon(
    model: HillModel,
    activation: ArrayLike,
    musculotendon_length: ArrayLike,
    musculotendon_velocity: ArrayLike = 0.0,
) -> MuscleState:
    """Forces of muscles with rigid tendons.

    lM cos(alpha) = lMT - lslack; vM = vMT cos(alpha); F = F0 (a fL fV + fPE + beta v) cos(alpha). Where F would push
    (fast shortening against damping), the tendon is slack and ``tendon_force`` 0; ``fiber_force_along_tendon`` keeps F
    and ``slack`` marks it. (Millard et al. 2013, section on the rigid-tendon model, doi:10.1115/1.4023390.)

    Args:
        model: The muscles; a tendon slack length of 0 is a muscle without tendon.
        activation: (..., m), from 0 to 1.
        musculotendon_length: (..., m), m, over the slack length.
        musculotendon_velocity: (..., m), m/s, lengthening positive.

    Returns:
        The state (..., m).

    Raises:
        HillError: Naming the muscle and the value outside these ranges, or shapes that do not fit.
    """
    given = read(
        model,
        activation=activation,
        musculotendon_length=musculotendon_length,
        musculotendon_velocity=musculotendon_velocity,
    )
    m, length = model.muscles, given["musculotendon_length"]
    along = length - m.tendon_slack_length
    if not (along > 0).all():
        remedy = "not over tendon_slack_length, so that nothing is left for the fiber: give a longer one"
        refuse(m, "musculotendon_length", length, ~(along > 0), remedy)
    fiber_length = np.hypot(along, m.fiber_width)
    fiber_velocity = given["musculotendon_velocity"] * along / fiber_length
    return assemble(
        model, given["activation"], length, given["musculotendon_velocity"], fiber_length, fiber_velocity, None
    )

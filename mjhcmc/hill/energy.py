"""Power and stiffness of fibers, tendons and whole muscles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjhcmc.hill.parameters import HillModel
from mjhcmc.hill.states import MuscleState

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MusclePower:
    """Power that each element gives out, W: positive while it shortens under tension. Shapes (..., m).

    With a compliant tendon in balance, and with a rigid one that is not slack, the musculotendon's is the sum of the
    others.

    Attributes:
        active: Contractile element, -F_active vM.
        passive: Fiber's passive spring, -F_passive vM.
        damping: Fiber damping, never positive.
        tendon: -F vT.
        musculotendon: -F vMT.
    """

    active: Array
    passive: Array
    damping: Array
    tendon: Array
    musculotendon: Array


@dataclass(frozen=True)
class MuscleStiffness:
    """Force per length at constant velocity and activation, N/m. Shapes (..., m).

    Attributes:
        fiber: d(fiber force)/d(fiber length), F0/lopt (a fL' fV + fPE').
        fiber_along_tendon: d(F cos alpha)/d(lM cos alpha) = K cos^2(alpha) + F sin^2(alpha)/lM.
        tendon: F0/lslack fT'; infinite for a rigid tendon.
        musculotendon: Fiber along the tendon and tendon in series, K_F K_T / (K_F + K_T).
    """

    fiber: Array
    fiber_along_tendon: Array
    tendon: Array
    musculotendon: Array


def muscle_power(state: MuscleState) -> MusclePower:
    """Power of each element.

    Args:
        state: Of either tendon.

    Returns:
        W.
    """
    v = state.fiber_velocity
    return MusclePower(
        active=-state.active_force * v,
        passive=-state.passive_force * v,
        damping=-state.damping_force * v,
        tendon=-state.tendon_force * state.tendon_velocity,
        musculotendon=-state.tendon_force * state.musculotendon_velocity,
    )


def muscle_stiffness(model: HillModel, state: MuscleState, rigid: bool = False) -> MuscleStiffness:
    """Stiffness of fiber, tendon and both in series (Millard et al. 2013, doi:10.1115/1.4023390).

    Args:
        model: The muscles that the state is of.
        state: Their state.
        rigid: The state is that of a rigid tendon.

    Returns:
        N/m. A musculotendon whose tendon is slack, so that neither side resists, has stiffness 0.
    """
    m, curves = model.muscles, model.curves
    length = state.fiber_length / m.optimal_fiber_length
    velocity = state.fiber_velocity / (m.max_fiber_velocity * m.optimal_fiber_length)
    gain = curves.force_velocity(velocity, state.activation)
    slope = state.activation * curves.active.derivative(length) * gain + curves.passive.derivative(length)
    fiber = m.max_isometric_force / m.optimal_fiber_length * slope
    cos2 = state.cos_pennation**2
    along = fiber * cos2 + state.fiber_force * (1.0 - cos2) / state.fiber_length
    if rigid:
        return MuscleStiffness(fiber, along, np.full_like(along, np.inf), np.where(state.slack, 0.0, along))
    strained = state.tendon_length / m.tendon_slack_length
    tendon = m.max_isometric_force / m.tendon_slack_length * curves.need_tendon().derivative(strained)
    both = along + tendon
    series = np.where(tendon > 0, along * tendon / np.where(both == 0, np.inf, both), 0.0)
    return MuscleStiffness(fiber, along, tendon, series)

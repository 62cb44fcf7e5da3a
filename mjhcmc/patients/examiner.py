"""Who moves the limb in a passive stretch: an examiner's arm, or a machine.

An arm is a hand of some mass that is pulled along the movement that is meant, by a spring and a damper, with the force
that the movement itself takes and one that grows while the limb lags; and it is only so strong. What is recorded is
what the limb feels: the arm's torque less what the hand itself takes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVERS: dict[str, float] = {"hip": 0.21, "knee": 0.21, "ankle": 0.09}
"""Statures from the joint to the hand: above the knee, above the ankle, on the ball of the foot (chosen here)."""

HAND_MASS = 1.0
"""kg, of the examiner's hand and forearm that go along (chosen here)."""

HAND_STIFFNESS = 5000.0
"""N/m, of arms that mean to hold their course: so stiff that a healthy limb goes as fast as is meant (chosen here; of
one relaxed arm 100 to 500 N/m are reported by Mussa-Ivaldi, Hogan, Bizzi 1985,
doi:10.1523/JNEUROSCI.05-10-02732.1985)."""

HAND_STRENGTH = 200.0
"""N, that an examiner pushes with at most (chosen here)."""

_DAMPING_RATIO = 0.8
_LAG_TIME = 0.3  # s, in which the arm adds as much again as its stiffness gives for a lag


@dataclass(frozen=True)
class Arm:
    """An examiner's arm at a joint.

    Attributes:
        stiffness: N m/rad.
        damping: N m s/rad.
        growth: N m/(rad s), of torque with the lag that remains.
        strength: N m.
        hand: kg m^2, inertia of the hand about the joint.
        limb: kg m^2, inertia that the arm reckons with.
    """

    stiffness: float
    damping: float
    growth: float
    strength: float
    hand: float
    limb: float


def arm_at(joint: str, height: float, inertia: float) -> Arm:
    """The arm that moves a joint of a patient.

    Args:
        joint: ``"hip"``, ``"knee"`` or ``"ankle"``.
        height: m, the patient's stature.
        inertia: kg m^2, of the limb about the joint, the others held.
    """
    lever = LEVERS[joint] * height
    stiffness, hand = HAND_STIFFNESS * lever**2, HAND_MASS * lever**2
    damping = 2 * _DAMPING_RATIO * float(np.sqrt(stiffness * (inertia + hand)))
    return Arm(stiffness, damping, stiffness / _LAG_TIME, strength_at(joint, height), hand, inertia + hand)


def strength_at(joint: str, height: float) -> float:
    """N m that an examiner applies to a joint at most, and beyond which a machine stops.

    Args:
        joint: ``"hip"``, ``"knee"`` or ``"ankle"``.
        height: m, the patient's stature.
    """
    return HAND_STRENGTH * LEVERS[joint] * height


class Arms:
    """Arms of many simulations, with what they have added so far.

    Args:
        arms: one a simulation; None where nobody moves the joint.
    """

    def __init__(self, arms: list[Arm | None]) -> None:
        none = Arm(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        columns = [[getattr(arm or none, name) for arm in arms] for name in Arm.__dataclass_fields__]
        self._stiffness, self._damping, self._growth, self._strength, self._hand, self._limb = map(np.array, columns)
        self._added = np.zeros(len(arms))

    def begin(self, acceleration: Array) -> None:
        """Hold the limbs still where they are, before anything else.

        Args:
            acceleration: (b,) rad/s^2, of limbs that nobody holds.
        """
        self._added = np.clip(-self._limb * acceleration, -self._strength, self._strength)

    def torque(self, ids: NDArray[np.intp], lag: Array, slip: Array, acceleration: Array, period: float) -> Array:
        """(b,) N m over the next control period; what lags is remembered.

        Args:
            ids: (b,) the simulations.
            lag: (b,) rad, desired less actual angle.
            slip: (b,) rad/s, desired less actual velocity.
            acceleration: (b,) rad/s^2, desired.
            period: s.
        """
        held = self._stiffness[ids] * lag + self._damping[ids] * slip + self._limb[ids] * acceleration
        strength = self._strength[ids]
        grown = self._added[ids] + self._growth[ids] * lag * period
        # an arm at the end of its strength does not store up more
        self._added[ids] = np.where(np.abs(held + grown) < strength, grown, self._added[ids])
        return np.clip(held + self._added[ids], -strength, strength)

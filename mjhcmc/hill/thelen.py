"""The curves of Thelen (2003).

Reference: D. G. Thelen, "Adjustment of muscle mechanics model parameters to simulate dynamic contractions in older
adults", J. Biomech. Eng. 125(1), 70-77, 2003, doi:10.1115/1.1531112. Default constants are those of OpenSim's
Thelen2003Muscle, and so is the force-velocity curve's straight continuation at both ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.curves import Curves, refuse_unless_positive
from mjhcmc.hill.errors import HillError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ThelenActive:
    """fL = exp(-(l - 1)^2 / shape)."""

    shape: float = 0.45

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        refuse_unless_positive(self, "shape")

    def __call__(self, x: ArrayLike) -> Array:
        """The multiplier at normalised fiber length."""
        return np.exp(-((np.asarray(x, dtype=np.float64) - 1.0) ** 2) / self.shape)

    def derivative(self, x: ArrayLike) -> Array:
        """Its slope."""
        return self.evaluate(x)[1]

    def evaluate(self, x: ArrayLike) -> tuple[Array, Array]:
        """Multiplier and slope together."""
        value = self(x)
        return value, value * (-2.0 / self.shape) * (np.asarray(x, dtype=np.float64) - 1.0)


@dataclass(frozen=True)
class ThelenPassive:
    """fPE = (exp(k (l - 1) / e0) - 1) / (exp(k) - 1) for l > 1, else 0; e0 is ``strain``, k is ``shape``."""

    strain: float = 0.6
    shape: float = 5.0

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        refuse_unless_positive(self, "strain", "shape")

    def __call__(self, x: ArrayLike) -> Array:
        """The multiplier at normalised fiber length."""
        return self.evaluate(x)[0]

    def derivative(self, x: ArrayLike) -> Array:
        """Its slope; at l = 1 that of the slack side, 0."""
        return self.evaluate(x)[1]

    def evaluate(self, x: ArrayLike) -> tuple[Array, Array]:
        """Multiplier and slope together."""
        stretch = np.asarray(x, dtype=np.float64) - 1.0
        rate, scale = self.shape / self.strain, 1.0 / np.expm1(self.shape)
        # Not cut off with a mask but by exp(0) = 1; NaN stays NaN.
        grown = np.expm1(rate * np.maximum(stretch, 0.0))
        return grown * scale, np.where(stretch <= 0, 0.0, (grown + 1.0) * (rate * scale))


@dataclass(frozen=True)
class ThelenTendon:
    """An exponential toe that passes smoothly into a line through force 1 at strain ``strain``.

    Toe, e = lT/lslack - 1: F (exp(k e / etoe) - 1) / (exp(k) - 1) with F = .33 (``toe_force``) and k = 3 (``shape``);
    beyond etoe: F + (1 - F) (e - etoe) / (e0 - etoe). Equal slopes at etoe give etoe = e0 r / (r + 1 - F) with
    r = F k e^k / (e^k - 1), which the paper rounds to .609 e0.
    """

    strain: float = 0.04
    toe_force: float = 0.33
    shape: float = 3.0

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        refuse_unless_positive(self, "strain", "toe_force", "shape")
        if self.toe_force >= 1:
            raise HillError(f"ThelenTendon: toe_force is {self.toe_force:g}: give a number under 1")

    @property
    def toe_strain(self) -> float:
        """Strain where the toe ends."""
        r = self.toe_force * self.shape / -np.expm1(-self.shape)
        return float(self.strain * r / (r + 1.0 - self.toe_force))

    @property
    def stiffness(self) -> float:
        """Slope beyond the toe."""
        return (1.0 - self.toe_force) / (self.strain - self.toe_strain)

    def __call__(self, x: ArrayLike) -> Array:
        """Normalised tendon force at normalised tendon length; 0 for a slack tendon."""
        return self.evaluate(x)[0]

    def derivative(self, x: ArrayLike) -> Array:
        """Its slope over normalised tendon length; at slack length 0."""
        return self.evaluate(x)[1]

    def evaluate(self, x: ArrayLike) -> tuple[Array, Array]:
        """Force and slope together."""
        strain = np.asarray(x, dtype=np.float64) - 1.0
        toe, rate = self.toe_strain, self.shape / self.toe_strain
        scale = self.toe_force / np.expm1(self.shape)
        grown = np.expm1(rate * np.clip(strain, 0.0, toe))
        value = scale * grown + self.stiffness * np.maximum(strain - toe, 0.0)
        slope = np.where(strain <= 0, 0.0, np.where(strain > toe, self.stiffness, rate * scale * (grown + 1.0)))
        return value, np.where(np.isnan(strain), np.nan, slope)

    def inverse(self, y: ArrayLike) -> Array:
        """Normalised tendon length that carries normalised force ``y``; 1 at force 0.

        Raises:
            HillError: A negative force.
        """
        force = np.asarray(y, dtype=np.float64)
        if np.any(force < 0):
            raise HillError(f"ThelenTendon: normalised force is {np.nanmin(force):.6g}: a tendon does not push")
        toe = np.log1p(np.minimum(force, self.toe_force) * np.expm1(self.shape) / self.toe_force)
        beyond = np.maximum(force - self.toe_force, 0.0) / self.stiffness
        return np.asarray(1.0 + toe * self.toe_strain / self.shape + beyond)


@dataclass(frozen=True)
class ThelenForceVelocity:
    """Hill's hyperbolas, with the fastest velocity falling with activation.

    v = (.25 + .75 a) (f - 1) / b with b = 1 + f / Af while shortening (f <= 1) and
    b = (2 + 2 / Af) (flen - f) / (flen - 1) while lengthening; f = F / (a fL). Straight on, with the slope of the end,
    below f = 0 and above f = ``linear_from`` flen.
    """

    shape: float = 0.25
    max_eccentric: float = 1.4
    linear_from: float = 0.95

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        refuse_unless_positive(self, "shape")
        if not (self.max_eccentric * self.linear_from > 1 and 0 < self.linear_from < 1):
            raise HillError(
                f"ThelenForceVelocity: max_eccentric is {self.max_eccentric:g} and linear_from {self.linear_from:g}: "
                "give linear_from under 1, and both so that their product is over 1"
            )

    @property
    def bounds(self) -> tuple[float, float]:
        """Every multiplier has its velocity, thanks to the straight ends."""
        return -np.inf, np.inf

    def __call__(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """The multiplier at normalised fiber velocity and activation."""
        return self.evaluate(velocity, activation)[0]

    def derivative(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """Its slope over velocity; at velocity 0 that of shortening."""
        return self.evaluate(velocity, activation)[1]

    def evaluate(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> tuple[Array, Array]:
        """Multiplier and slope together."""
        reach = 0.25 + 0.75 * np.asarray(activation, dtype=np.float64)
        s = np.asarray(velocity, dtype=np.float64) / reach  # (f - 1) / b
        top = self.max_eccentric
        c = (2.0 + 2.0 / self.shape) / (top - 1.0)
        edge = self.linear_from * top
        fast = (edge - 1.0) / (c * (top - edge))
        short, long = np.clip(s, -1.0, 0.0), np.clip(s, 0.0, fast)
        below, above = 1.0 - short / self.shape, 1.0 + c * long
        edge_slope = c * (top - edge) ** 2 / (top - 1.0)
        value = (1.0 + short) / below + (1.0 + c * top * long) / above - 1.0
        value = value + np.minimum(s + 1.0, 0.0) / (1.0 + 1.0 / self.shape) + edge_slope * np.maximum(s - fast, 0.0)
        slope = np.where(s <= 0, (1.0 + 1.0 / self.shape) / below**2, c * (top - 1.0) / above**2)
        return value, slope / reach

    def inverse(self, multiplier: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """The normalised fiber velocity with this multiplier: the paper's own direction (its Eqs. 6 and 7)."""
        f = np.asarray(multiplier, dtype=np.float64)
        top = self.max_eccentric
        c = (2.0 + 2.0 / self.shape) / (top - 1.0)
        edge = self.linear_from * top
        short, long = np.clip(f, 0.0, 1.0), np.clip(f, 1.0, edge)
        s = (short - 1.0) / (1.0 + short / self.shape) + (long - 1.0) / (c * (top - long))
        s = s + (1.0 + 1.0 / self.shape) * np.minimum(f, 0.0)
        s = s + (top - 1.0) / (c * (top - edge) ** 2) * np.maximum(f - edge, 0.0)
        return s * (0.25 + 0.75 * np.asarray(activation, dtype=np.float64))


def thelen2003(
    active: ThelenActive | None = None,
    passive: ThelenPassive | None = None,
    velocity: ThelenForceVelocity | None = None,
    tendon: ThelenTendon | None = None,
) -> Curves:
    """The curves of Thelen (2003), without fiber damping.

    Args:
        active: Active force-length curve; OpenSim's constants where None, as for the others.
        passive: Passive force-length curve.
        velocity: Force-velocity curve.
        tendon: Tendon curve.
    """
    return Curves(
        name="Thelen 2003",
        active=active or ThelenActive(),
        passive=passive or ThelenPassive(),
        force_velocity=velocity or ThelenForceVelocity(),
        tendon=tendon or ThelenTendon(),
        shortest_fiber=0.01,
        fiber_damping=0.0,
    )

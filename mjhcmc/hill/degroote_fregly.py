"""The curves of De Groote, Kinney, Rao and Fregly (2016).

Reference: F. De Groote, A. L. Kinney, A. V. Rao, B. J. Fregly, "Evaluation of direct collocation optimal control
problem formulations for solving the muscle redundancy problem", Ann. Biomed. Eng. 44(10), 2922-2936, 2016,
doi:10.1007/s10439-016-1591-9. The force-velocity constants have OpenSim's further digits, which make fV(0) = 1 and
fV(-1) = 0 exact; tendon stiffness follows from the strain at one normalised force, as there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.curves import Curves, refuse_outside, refuse_unless_positive
from mjhcmc.hill.errors import HillError

Array = NDArray[np.float64]

BELLS = (
    (0.8150671134243542, 1.055033428970575, 0.162384573599574, 0.063303448465465),
    (0.433004984392647, 0.716775413397760, -0.029947116970696, 0.200356847296188),
    (0.1, 1.0, 0.353553390593274, 0.0),
)
"""b1, b2, b3, b4 of the three bells."""

FORCE_VELOCITY = (-0.3211346127989808, -8.149, -0.374, 0.8825327733249912)
"""d1, d2, d3, d4."""

_D1, _D2, _D3, _D4 = FORCE_VELOCITY


@dataclass(frozen=True)
class DeGrooteFreglyActive:
    """fL = sum over k of b1k exp(-(l - b2k)^2 / (2 (b3k + b4k l)^2)); ``width`` stretches it about l = 1."""

    width: float = 1.0

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        refuse_unless_positive(self, "width")

    def __call__(self, x: ArrayLike) -> Array:
        """The multiplier at normalised fiber length."""
        return self.evaluate(x)[0]

    def derivative(self, x: ArrayLike) -> Array:
        """Its slope."""
        return self.evaluate(x)[1]

    def evaluate(self, x: ArrayLike) -> tuple[Array, Array]:
        """Multiplier and slope together."""
        length = (np.asarray(x, dtype=np.float64) - 1.0) / self.width + 1.0
        value, slope = np.zeros_like(length), np.zeros_like(length)
        # A bell's width b3 + b4 l passes 0 only below fiber length 0, but for the second's at .149: there it is 0.
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            for b1, b2, b3, b4 in BELLS:
                spread = 1.0 / (b3 + b4 * length)
                z = (length - b2) * spread
                bell = b1 * np.exp(-0.5 * z * z)
                value += bell
                bell *= z * spread * (1.0 - b4 * z)
                slope -= np.where(np.isnan(bell) & np.isfinite(length), 0.0, bell)
        slope /= self.width
        return value, slope


@dataclass(frozen=True)
class DeGrooteFreglyPassive:
    """fPE = (exp(4 (l - 1) / e0) - exp(4 (lmin - 1) / e0)) / (exp(4) - exp(4 (lmin - 1) / e0)), lmin = .2.

    At every length over lmin there is some force, and it falls below 0 under lmin.
    """

    strain: float = 0.6
    shape: float = 4.0
    zero_length: float = 0.2

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        refuse_unless_positive(self, "strain", "shape")
        if not 0 <= self.zero_length < 1 + self.strain:
            raise HillError(
                f"DeGrooteFreglyPassive: zero_length is {self.zero_length!r}: give a length under 1 + strain"
            )

    def __call__(self, x: ArrayLike) -> Array:
        """The multiplier at normalised fiber length."""
        return self.evaluate(x)[0]

    def derivative(self, x: ArrayLike) -> Array:
        """Its slope."""
        return self.evaluate(x)[1]

    def evaluate(self, x: ArrayLike) -> tuple[Array, Array]:
        """Multiplier and slope together."""
        rate, scale, offset = self.exponential()
        grown = scale * np.exp(rate * (np.asarray(x, dtype=np.float64) - 1.0))
        return grown - offset, rate * grown

    def exponential(self) -> tuple[float, float, float]:
        """r, s and c of the curve written as s exp(r (l - 1)) - c."""
        rate = self.shape / self.strain
        offset = np.exp(rate * (self.zero_length - 1.0))
        scale = 1.0 / (np.exp(self.shape) - offset)
        return float(rate), float(scale), float(scale * offset)


@dataclass(frozen=True)
class DeGrooteFreglyTendon:
    """fT = c1 (exp(kT (lT/lslack - 1)) - 1), c1 = .2, kT = ln(1 + 1/c1) / strain at one normalised force.

    Below slack length the force of the formula is negative (down to -c1).
    """

    strain: float = 0.049
    c1: float = 0.2

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        refuse_unless_positive(self, "strain", "c1")

    @property
    def stiffness(self) -> float:
        """The exponent kT."""
        return float(np.log1p(1.0 / self.c1) / self.strain)

    def __call__(self, x: ArrayLike) -> Array:
        """Normalised tendon force at normalised tendon length."""
        return self.c1 * np.expm1(self.stiffness * (np.asarray(x, dtype=np.float64) - 1.0))

    def derivative(self, x: ArrayLike) -> Array:
        """Its slope over normalised tendon length."""
        return self.evaluate(x)[1]

    def evaluate(self, x: ArrayLike) -> tuple[Array, Array]:
        """Force and slope together."""
        force = self(x)
        return force, self.stiffness * (force + self.c1)

    def inverse(self, y: ArrayLike) -> Array:
        """Normalised tendon length that carries normalised force ``y``.

        Raises:
            HillError: A force of -c1 or less.
        """
        force = np.asarray(y, dtype=np.float64)
        refuse_outside("DeGrooteFreglyTendon", force, float(np.nextafter(-self.c1, 0)), np.inf)
        return 1.0 + np.log1p(force / self.c1) / self.stiffness


@dataclass(frozen=True)
class DeGrooteFreglyForceVelocity:
    """fV = d1 asinh(d2 v + d3) + d4 for all v; inverse v = (sinh((f - d4) / d1) - d3) / d2."""

    @property
    def bounds(self) -> tuple[float, float]:
        """The curve has no limits."""
        return -np.inf, np.inf

    def __call__(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """The multiplier at normalised fiber velocity, the same at every activation."""
        return _D1 * np.arcsinh(_D2 * np.asarray(velocity, dtype=np.float64) + _D3) + _D4

    def derivative(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """Its slope over velocity."""
        return _D1 * _D2 / np.hypot(_D2 * np.asarray(velocity, dtype=np.float64) + _D3, 1.0)

    def evaluate(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> tuple[Array, Array]:
        """Multiplier and slope together."""
        return self(velocity), self.derivative(velocity)

    def inverse(self, multiplier: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """The normalised fiber velocity with this multiplier."""
        return (np.sinh((np.asarray(multiplier, dtype=np.float64) - _D4) / _D1) - _D3) / _D2


def degroote_fregly2016(
    active: DeGrooteFreglyActive | None = None,
    passive: DeGrooteFreglyPassive | None = None,
    velocity: DeGrooteFreglyForceVelocity | None = None,
    tendon: DeGrooteFreglyTendon | None = None,
    fiber_damping: float = 0.1,
) -> Curves:
    """The curves of De Groote et al. (2016).

    Args:
        active: Active force-length curve; the paper's where None, as for the others.
        passive: Passive force-length curve.
        velocity: Force-velocity curve.
        tendon: Tendon curve.
        fiber_damping: Damping that muscles take where they have none of their own. The paper has none; .1 is what
            models that were Millard's are given.
    """
    return Curves(
        name="De Groote-Fregly 2016",
        active=active or DeGrooteFreglyActive(),
        passive=passive or DeGrooteFreglyPassive(),
        force_velocity=velocity or DeGrooteFreglyForceVelocity(),
        tendon=tendon or DeGrooteFreglyTendon(),
        shortest_fiber=0.2,
        fiber_damping=fiber_damping,
    )

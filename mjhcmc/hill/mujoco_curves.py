"""MuJoCo's muscle curves: the piecewise quadratics that its documentation describes (Modeling, "Muscles")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.curves import Curves, refuse_outside
from mjhcmc.hill.errors import HillError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MujocoActive:
    """FL: 0 at lmin, .5 at (lmin + 1)/2, 1 at 1, .5 at (1 + lmax)/2, 0 at lmax, quadratic between, 0 outside."""

    lmin: float = 0.5
    lmax: float = 1.6

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        if not 0 <= self.lmin < 1 < self.lmax < np.inf:
            raise HillError(f"MujocoActive: lmin is {self.lmin!r} and lmax {self.lmax!r}: give 0 <= lmin < 1 < lmax")

    def __call__(self, x: ArrayLike) -> Array:
        """The multiplier at normalised length."""
        return self.evaluate(x)[0]

    def derivative(self, x: ArrayLike) -> Array:
        """Its slope."""
        return self.evaluate(x)[1]

    def evaluate(self, x: ArrayLike) -> tuple[Array, Array]:
        """Multiplier and slope together."""
        return active_shape(np.asarray(x, dtype=np.float64), self.lmin, self.lmax)


@dataclass(frozen=True)
class MujocoPassive:
    """FP: 0 to L = 1, then .5 fpmax x^2, x = (L - 1) / (b - 1), to b = (1 + lmax)/2, then fpmax (x - .5).

    The documentation calls fpmax the force at lmax; there the code, and this curve, give 1.5 fpmax.
    """

    lmax: float = 1.6
    fpmax: float = 1.3

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        if not (1 < self.lmax < np.inf and 0 <= self.fpmax < np.inf):
            raise HillError(f"MujocoPassive: lmax is {self.lmax!r} and fpmax {self.fpmax!r}: give lmax > 1, fpmax >= 0")

    def __call__(self, x: ArrayLike) -> Array:
        """The multiplier at normalised length."""
        return self.evaluate(x)[0]

    def derivative(self, x: ArrayLike) -> Array:
        """Its slope."""
        return self.evaluate(x)[1]

    def evaluate(self, x: ArrayLike) -> tuple[Array, Array]:
        """Multiplier and slope together."""
        return passive_shape(np.asarray(x, dtype=np.float64), self.lmax, self.fpmax)


@dataclass(frozen=True)
class MujocoForceVelocity:
    """FV: 0 to V = -1, (V + 1)^2 to 0, fvmax - (y - V)^2 / y to y = fvmax - 1, then fvmax."""

    fvmax: float = 1.2

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        if not 1 < self.fvmax < np.inf:
            raise HillError(f"MujocoForceVelocity: fvmax is {self.fvmax!r}: give a number over 1")

    @property
    def bounds(self) -> tuple[float, float]:
        """From no force to fvmax."""
        return 0.0, self.fvmax

    def __call__(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """The multiplier at normalised velocity, the same at every activation."""
        return self.evaluate(velocity)[0]

    def derivative(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """Its slope over velocity."""
        return self.evaluate(velocity)[1]

    def evaluate(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> tuple[Array, Array]:
        """Multiplier and slope together."""
        return velocity_shape(np.asarray(velocity, dtype=np.float64), self.fvmax)

    def inverse(self, multiplier: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """The normalised velocity with this multiplier; -1 at 0 and y at fvmax, where the curve is flat.

        Raises:
            HillError: A multiplier outside ``bounds``.
        """
        f = np.asarray(multiplier, dtype=np.float64)
        refuse_outside("MujocoForceVelocity", f, *self.bounds)
        y = self.fvmax - 1.0
        return np.where(f <= 1, np.sqrt(f) - 1.0, y - np.sqrt(y * (self.fvmax - np.maximum(f, 1.0))))


def mujoco_curves(lmin: float = 0.5, lmax: float = 1.6, fpmax: float = 1.3, fvmax: float = 1.2) -> Curves:
    """MuJoCo's curves as a Hill model's: no tendon curve, no damping; vmax is the muscle's maximum fiber velocity.

    Args:
        lmin: Shortest length with active force, over the optimal length.
        lmax: Longest length with active force.
        fpmax: Passive force at (1 + lmax)/2 is half of this.
        fvmax: Largest multiplier while lengthening.

    Raises:
        HillError: Parameters that make no curve.
    """
    return Curves(
        name="MuJoCo",
        active=MujocoActive(lmin, lmax),
        passive=MujocoPassive(lmax, fpmax),
        force_velocity=MujocoForceVelocity(fvmax),
        tendon=None,
        shortest_fiber=lmin,
        fiber_damping=0.0,
    )


def active_shape(length: Array, lmin: Array | float, lmax: Array | float) -> tuple[Array, Array]:
    """FL and its slope at normalised lengths; arrays broadcast."""
    half = np.where(length <= 1, (1.0 - lmin) / 2, (lmax - 1.0) / 2)
    z = np.abs(length - 1.0) / half  # 0 at the optimum, 1 at half height, 2 at the end
    outer = np.maximum(2.0 - z, 0.0)
    inside = z < 1
    value = np.where(inside, 1.0 - 0.5 * z * z, 0.5 * outer * outer)
    return value, np.where(length <= 1, 1.0, -1.0) * np.where(inside, z, outer) / half


def passive_shape(length: Array, lmax: Array | float, fpmax: Array | float) -> tuple[Array, Array]:
    """FP and its slope at normalised lengths; arrays broadcast."""
    half = (lmax - 1.0) / 2
    z = np.maximum(length - 1.0, 0.0) / half
    return fpmax * np.where(z <= 1, 0.5 * z * z, z - 0.5), fpmax * np.minimum(z, 1.0) / half


def velocity_shape(velocity: Array, fvmax: Array | float) -> tuple[Array, Array]:
    """FV and its slope at normalised velocities; arrays broadcast."""
    y = fvmax - 1.0
    short, long = np.maximum(velocity + 1.0, 0.0), np.maximum(y - velocity, 0.0)
    shortening = velocity <= 0
    value = np.where(shortening, short * short, fvmax - long * long / y)
    return value, np.where(shortening, 2.0 * short, 2.0 * long / y)

"""What a Hill model's curves can do, and the four of them together.

All is normalised: fiber length by the optimal fiber length, fiber velocity by the maximum fiber velocity (lengthening
positive), tendon length by the tendon slack length, force by the maximum isometric force (pulling positive). Curves are
elementwise on arrays of any shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.errors import HillError

Array = NDArray[np.float64]


class Curve(Protocol):
    """A function of one variable with its slope."""

    def __call__(self, x: ArrayLike) -> Array:
        """The value at ``x``."""
        ...

    def derivative(self, x: ArrayLike) -> Array:
        """The slope at ``x``; at a kink, that of one side."""
        ...

    def evaluate(self, x: ArrayLike) -> tuple[Array, Array]:
        """Value and slope together, which costs less than one after the other."""
        ...


class InvertibleCurve(Curve, Protocol):
    """A curve that rises: a tendon's."""

    def inverse(self, y: ArrayLike) -> Array:
        """The x with value ``y``; where the curve is flat at ``y``, the end of the flat part that rises.

        Raises:
            HillError: No x has this value.
        """
        ...


class ForceVelocityCurve(Protocol):
    """Force-velocity multiplier, which in Thelen's model depends on activation too; 1 at velocity 0.

    Attributes:
        bounds: The multipliers between which the curve can be inverted.
    """

    @property
    def bounds(self) -> tuple[float, float]:
        """The multipliers between which the curve can be inverted."""
        ...

    def __call__(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """The multiplier at ``velocity`` and ``activation``."""
        ...

    def derivative(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """Its slope over velocity."""
        ...

    def evaluate(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> tuple[Array, Array]:
        """Multiplier and slope together."""
        ...

    def inverse(self, multiplier: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """The velocity with this multiplier.

        Raises:
            HillError: A multiplier outside ``bounds``.
        """
        ...


@dataclass(frozen=True)
class Curves:
    """The curves of one Hill model.

    Attributes:
        name: The model's name, for messages and figures.
        active: Active force-length multiplier over normalised fiber length.
        passive: Passive force-length multiplier over normalised fiber length.
        force_velocity: Force-velocity multiplier over normalised fiber velocity.
        tendon: Normalised tendon force over normalised tendon length; None for a model without tendon.
        shortest_fiber: The shortest normalised fiber length at which an equilibrium is looked for.
        fiber_damping: The damping that the model was published with, maximum isometric forces per maximum velocity.
    """

    name: str
    active: Curve
    passive: Curve
    force_velocity: ForceVelocityCurve
    tendon: InvertibleCurve | None
    shortest_fiber: float
    fiber_damping: float

    def need_tendon(self) -> InvertibleCurve:
        """The tendon curve.

        Raises:
            HillError: The model has none.
        """
        if self.tendon is None:
            raise HillError(f"{self.name}: this model has no tendon curve: use the rigid tendon")
        return self.tendon


def refuse_outside(name: str, values: Array, low: float, high: float) -> None:
    """Raise where a number (NaN passes) lies outside [low, high]: the value of an inverse that does not exist.

    Raises:
        HillError: Naming the curve and the first such number.
    """
    outside = (values < low) | (values > high)
    if np.any(outside):
        value = values[outside].flat[0]
        raise HillError(
            f"{name}: no point of the curve has the value {value:.6g}: give values from {low:g} to {high:g}"
        )


def refuse_unless_positive(curve: object, *names: str) -> None:
    """Raise where a constant of a curve is not a positive finite number.

    Raises:
        HillError: Naming the curve, the constant and its value.
    """
    for name in names:
        value = getattr(curve, name)
        if not (np.isfinite(value) and value > 0):
            raise HillError(f"{type(curve).__name__}: {name} is {value!r}: give a positive number")

"""The numbers that make a muscle, and a muscle together with its curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.curves import Curves
from mjhcmc.hill.errors import HillError

Array = NDArray[np.float64]

_UNITS = {
    "max_isometric_force": "N",
    "optimal_fiber_length": "m",
    "tendon_slack_length": "m",
    "pennation_at_optimal": "rad",
    "max_fiber_velocity": "optimal fiber lengths/s",
    "fiber_damping": "",
}


@dataclass(frozen=True, init=False)
class MuscleParameters:
    """The parameters of m muscles, each an array (m,), or of one muscle, each a number.

    Attributes:
        max_isometric_force: F0, N.
        optimal_fiber_length: lopt, m.
        tendon_slack_length: lslack, m; 0 for a muscle without tendon, which only the rigid tendon takes.
        pennation_at_optimal: Pennation angle at the optimal fiber length, rad, under pi/2.
        max_fiber_velocity: Fastest shortening, optimal fiber lengths per second.
        fiber_damping: Damping beta, F0 per maximum fiber velocity; None for the curves' own.
        names: Names for messages.
    """

    max_isometric_force: Array
    optimal_fiber_length: Array
    tendon_slack_length: Array
    pennation_at_optimal: Array
    max_fiber_velocity: Array
    fiber_damping: Array | None
    names: tuple[str, ...]

    def __init__(
        self,
        max_isometric_force: ArrayLike,
        optimal_fiber_length: ArrayLike,
        tendon_slack_length: ArrayLike,
        pennation_at_optimal: ArrayLike = 0.0,
        max_fiber_velocity: ArrayLike = 10.0,
        fiber_damping: ArrayLike | None = None,
        names: Sequence[str] | str | None = None,
    ) -> None:
        """Check and store; numbers and arrays (m,) mix.

        Args:
            max_isometric_force: N, positive.
            optimal_fiber_length: m, positive.
            tendon_slack_length: m, not negative.
            pennation_at_optimal: rad, from 0 to under pi/2.
            max_fiber_velocity: Optimal fiber lengths per second, positive.
            fiber_damping: Not negative; None for the curves' own.
            names: One a muscle; muscle 0, muscle 1 ... where None.

        Raises:
            HillError: Naming the muscle and the value that makes no muscle, or the shapes that do not fit.
        """
        given: dict[str, ArrayLike] = {
            "max_isometric_force": max_isometric_force,
            "optimal_fiber_length": optimal_fiber_length,
            "tendon_slack_length": tendon_slack_length,
            "pennation_at_optimal": pennation_at_optimal,
            "max_fiber_velocity": max_fiber_velocity,
        }
        if fiber_damping is not None:
            given["fiber_damping"] = fiber_damping
        arrays: dict[str, Array] = {}
        for name, value in given.items():
            try:
                arrays[name] = np.array(value, dtype=np.float64)
            except (TypeError, ValueError):
                raise HillError(f"{name} is {value!r}: give numbers, one a muscle") from None
        shapes = {name: array.shape for name, array in arrays.items()}
        try:
            shape = np.broadcast_shapes(*shapes.values())
        except ValueError:
            raise HillError(f"muscle parameters have the shapes {shapes}: give each a number or one a muscle") from None
        if len(shape) > 1 or shape == (0,):
            raise HillError(f"muscle parameters have the shapes {shapes}: give each a number or one a muscle")
        object.__setattr__(self, "names", _names(names, shape))
        object.__setattr__(self, "fiber_damping", None)
        for name, array in arrays.items():
            full = np.broadcast_to(array, shape).copy()
            full.flags.writeable = False
            self._refuse(name, full)
            object.__setattr__(self, name, full)

    @property
    def shape(self) -> tuple[int, ...]:
        """(m,), or () for one muscle given by numbers."""
        return self.max_isometric_force.shape

    @property
    def fiber_width(self) -> Array:
        """Constant width lopt sin(alpha0) of the pennated fibers, m."""
        return np.asarray(self.optimal_fiber_length * np.sin(self.pennation_at_optimal))

    def _refuse(self, name: str, values: Array) -> None:
        may_be_zero = name in ("tendon_slack_length", "pennation_at_optimal", "fiber_damping")
        good = np.isfinite(values) & ((values >= 0) if may_be_zero else (values > 0))
        remedy = "give a number of 0 or more" if may_be_zero else "give a positive number"
        if name == "pennation_at_optimal":
            good &= values < np.pi / 2
            remedy = "give radians from 0 to under pi/2 (90 deg)"
        if not np.all(good):
            k = int(np.flatnonzero(~good.ravel())[0])
            unit = f" {_UNITS[name]}" if _UNITS[name] else ""
            raise HillError(f"{self.names[k]}: {name} is {values.ravel()[k]:g}{unit}: {remedy}")


@dataclass(frozen=True)
class HillModel:
    """Muscles and the curves that they share.

    Attributes:
        muscles: The parameters of m muscles.
        curves: Thelen's, Millard's, De Groote and Fregly's, MuJoCo's, or a mixture.
    """

    muscles: MuscleParameters
    curves: Curves

    @property
    def fiber_damping(self) -> Array:
        """Damping of each muscle: its own, else the one that the curves were published with."""
        if self.muscles.fiber_damping is not None:
            return self.muscles.fiber_damping
        return np.full(self.muscles.shape, self.curves.fiber_damping)


def _names(names: Sequence[str] | str | None, shape: tuple[int, ...]) -> tuple[str, ...]:
    count = shape[0] if shape else 1
    if names is None:
        return tuple(f"muscle {k}" for k in range(count))
    listed = (names,) if isinstance(names, str) else tuple(names)
    if len(listed) != count:
        raise HillError(f"{len(listed)} muscle names for {count} muscles: give one a muscle")
    return listed

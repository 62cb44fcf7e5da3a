"""States of muscles: checked on the way in, complete on the way out."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.errors import HillError
from mjhcmc.hill.parameters import HillModel, MuscleParameters

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MuscleState:
    """Lengths, velocities and forces of muscles; every field has the same shape (..., m), time first.

    Attributes:
        activation: From 0 to 1.
        musculotendon_length: m.
        musculotendon_velocity: m/s, lengthening positive.
        fiber_length: m.
        fiber_velocity: m/s along the fiber, lengthening positive.
        cos_pennation: Cosine of the pennation angle.
        tendon_length: m.
        tendon_velocity: m/s.
        active_force: F0 a fL fV, N along the fiber.
        passive_force: F0 fPE, N along the fiber.
        damping_force: F0 beta v, N along the fiber.
        tendon_force: N, what the muscle pulls with. With a compliant tendon F0 fT; with a rigid one the fiber's force
            along the tendon, or 0 where that would push.
    """

    activation: Array
    musculotendon_length: Array
    musculotendon_velocity: Array
    fiber_length: Array
    fiber_velocity: Array
    cos_pennation: Array
    tendon_length: Array
    tendon_velocity: Array
    active_force: Array
    passive_force: Array
    damping_force: Array
    tendon_force: Array

    @property
    def fiber_force(self) -> Array:
        """Whole force along the fiber, N."""
        return self.active_force + self.passive_force + self.damping_force

    @property
    def fiber_force_along_tendon(self) -> Array:
        """Whole fiber force times cos(pennation), N; negative where the fiber would push."""
        return self.fiber_force * self.cos_pennation

    @property
    def pennation(self) -> Array:
        """Pennation angle, rad."""
        return np.arccos(np.minimum(self.cos_pennation, 1.0))

    @property
    def slack(self) -> NDArray[np.bool_]:
        """Where the tendon carries nothing because the fiber would push."""
        return np.asarray((self.tendon_force == 0) & (self.fiber_force_along_tendon < 0))

    @property
    def shape(self) -> tuple[int, ...]:
        """(..., m)."""
        return self.tendon_force.shape

    def __getitem__(self, index: object) -> MuscleState:
        """The same index into every field."""
        return MuscleState(**{f.name: np.asarray(getattr(self, f.name)[index]) for f in fields(self)})


def read(model: HillModel, **given: ArrayLike) -> dict[str, Array]:
    """Arrays of one shape (..., m) from what a caller gives.

    Args:
        model: The muscles.
        given: Arrays by their names; ``activation`` is held to [0, 1].

    Raises:
        HillError: Naming the muscle, the time index and the value that is not finite, or outside [0, 1], or not
            positive where its name ends in length; or the shapes that do not fit.
    """
    muscles = model.muscles
    arrays = {}
    for name, value in given.items():
        try:
            arrays[name] = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise HillError(f"{name} is {value!r}: give numbers") from None
    shapes = {name: array.shape for name, array in arrays.items()}
    try:
        shape = np.broadcast_shapes(muscles.shape, *shapes.values())
    except ValueError:
        shape = ()
    if shape[len(shape) - len(muscles.shape) :] != muscles.shape:
        raise HillError(f"shapes {shapes} do not fit {len(muscles.names)} muscles: give (..., {len(muscles.names)})")
    result = {}
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            refuse(muscles, name, array, ~np.isfinite(array), "give finite numbers")
        if name in ("activation", "excitation") and not ((array >= 0) & (array <= 1)).all():
            refuse(muscles, name, array, (array < 0) | (array > 1), "give numbers from 0 to 1")
        if name.endswith("length") and not (array > 0).all():
            refuse(muscles, name, array, array <= 0, "give positive lengths in m")
        result[name] = np.broadcast_to(array, shape)
    return result


def refuse(muscles: MuscleParameters, name: str, values: Array, bad: NDArray[np.bool_], remedy: str) -> None:
    """Raise for the first element that is bad, with its muscle, time index and value.

    Raises:
        HillError: Always.
    """
    shape = np.broadcast_shapes(np.shape(bad), muscles.shape)
    where = np.argwhere(np.broadcast_to(bad, shape))[0].tolist()
    value = np.broadcast_to(values, shape)[tuple(where)]
    muscle = where.pop() if muscles.shape else 0
    place = f" at index {where[0] if len(where) == 1 else tuple(where)}" if where else ""
    raise HillError(f"{muscles.names[muscle]}{place}: {name} is {value:.6g}: {remedy}")


def assemble(
    model: HillModel,
    activation: Array,
    musculotendon_length: Array,
    musculotendon_velocity: Array,
    fiber_length: Array,
    fiber_velocity: Array,
    tendon_length: Array | None,
) -> MuscleState:
    """Everything about muscles whose fibers are known; nothing is checked. No tendon length: the tendon is rigid."""
    m, curves = model.muscles, model.curves
    cos = np.sqrt(fiber_length**2 - m.fiber_width**2) / fiber_length
    length = fiber_length / m.optimal_fiber_length
    velocity = fiber_velocity / (m.max_fiber_velocity * m.optimal_fiber_length)
    active = m.max_isometric_force * activation * curves.active(length) * curves.force_velocity(velocity, activation)
    passive = m.max_isometric_force * curves.passive(length)
    damping = m.max_isometric_force * model.fiber_damping * velocity
    if tendon_length is None:
        tendon_length = np.broadcast_to(m.tendon_slack_length, fiber_length.shape).copy()
        tendon_velocity = np.zeros_like(tendon_length)
        force = np.maximum((active + passive + damping) * cos, 0.0)
    else:
        tendon_velocity = musculotendon_velocity - fiber_velocity / cos
        force = m.max_isometric_force * curves.need_tendon()(tendon_length / m.tendon_slack_length)
    return MuscleState(
        activation=np.array(activation),
        musculotendon_length=np.array(musculotendon_length),
        musculotendon_velocity=np.array(musculotendon_velocity),
        fiber_length=fiber_length,
        fiber_velocity=fiber_velocity,
        cos_pennation=cos,
        tendon_length=tendon_length,
        tendon_velocity=tendon_velocity,
        active_force=active,
        passive_force=passive,
        damping_force=damping,
        tendon_force=np.asarray(force),
    )

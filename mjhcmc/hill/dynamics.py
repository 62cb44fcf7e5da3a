"""The fiber's equation of motion: its velocity from its length, the musculotendon's length and activation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.curves import ForceVelocityCurve
from mjhcmc.hill.equilibrium import need_slack_length
from mjhcmc.hill.parameters import HillModel
from mjhcmc.hill.pennation import check_width
from mjhcmc.hill.roots import solve_rising
from mjhcmc.hill.states import MuscleState, assemble, read, refuse

Array = NDArray[np.float64]

_CHUNK = 8192


def fiber_velocity(
    model: HillModel, activation: ArrayLike, fiber_length: ArrayLike, musculotendon_length: ArrayLike
) -> Array:
    """Fiber velocity that balances fiber and compliant tendon: the paper's Eq. 3.

    a fL fV(v) + beta v = fT / cos(alpha) - fPE, solved for v; without damping v is fV^-1((fT/cos(alpha) - fPE)/(a fL)).
    Zajac (1989); damped: Millard et al. (2013), doi:10.1115/1.4023390.

    Args:
        model: The muscles, with positive tendon slack lengths.
        activation: (..., m), from 0 to 1.
        fiber_length: (..., m), m, over the width of a pennated muscle.
        musculotendon_length: (..., m), m.

    Returns:
        Velocity (..., m), m/s, lengthening positive.

    Raises:
        HillError: Naming the muscle and the value: a fiber too short for its width or longer than the musculotendon,
            no damping and a fiber without active force or with a force that no velocity gives, a tendon slack length
            of 0, activation outside [0, 1], numbers that are not finite, or shapes that do not fit.
    """
    return fiber_dynamics(model, activation, fiber_length, musculotendon_length).fiber_velocity


def fiber_dynamics(
    model: HillModel,
    activation: ArrayLike,
    fiber_length: ArrayLike,
    musculotendon_length: ArrayLike,
    musculotendon_velocity: ArrayLike = 0.0,
) -> MuscleState:
    """The whole state of muscles with compliant tendons whose fiber lengths are known: see :func:`fiber_velocity`.

    Args:
        model: The muscles, with positive tendon slack lengths.
        activation: (..., m), from 0 to 1.
        fiber_length: (..., m), m.
        musculotendon_length: (..., m), m.
        musculotendon_velocity: (..., m), m/s: sets the tendon's velocity, nothing else.

    Returns:
        The state (..., m).

    Raises:
        HillError: As for :func:`fiber_velocity`.
    """
    given = read(
        model,
        activation=activation,
        fiber_length=fiber_length,
        musculotendon_length=musculotendon_length,
        musculotendon_velocity=musculotendon_velocity,
    )
    m, curves, tendon = model.muscles, model.curves, model.curves.need_tendon()
    need_slack_length(model)
    length, whole = given["fiber_length"], given["musculotendon_length"]
    check_width(model, length)
    along = np.sqrt(length**2 - m.fiber_width**2)
    if not (whole > along).all():
        refuse(m, "fiber_length", length, ~(whole > along), "no length is left for the tendon: give a shorter one")
    normal = length / m.optimal_fiber_length
    with np.errstate(over="ignore", invalid="ignore"):
        target = tendon((whole - along) / m.tendon_slack_length) * length / along - curves.passive(normal)
        active = given["activation"] * curves.active(normal)
    if not np.isfinite(target).all():
        refuse(m, "fiber_length", length, ~np.isfinite(target), "fiber or tendon is stretched beyond all reason")
    damping = np.broadcast_to(model.fiber_damping, target.shape)
    _check_undamped(model, damping, active, target)
    flat = (target.ravel(), active.ravel(), given["activation"].ravel(), damping.ravel())
    solved = np.empty(target.size)
    for start in range(0, target.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        solved[part] = _solve(_Drive(curves.force_velocity, *(values[part] for values in flat)))
    velocity = solved.reshape(target.shape) * m.max_fiber_velocity * m.optimal_fiber_length
    if not np.isfinite(velocity).all():
        refuse(m, "fiber_length", length, ~np.isfinite(velocity), "the fiber's velocity is beyond all numbers")
    return assemble(
        model, given["activation"], whole, given["musculotendon_velocity"], length.copy(), velocity, whole - along
    )


def _check_undamped(model: HillModel, damping: Array, active: Array, target: Array) -> None:
    """Raise where no velocity, or any, balances a fiber without damping."""
    bare = damping <= 0
    if not bare.any():
        return
    dead = bare & (active <= 0)
    if dead.any():
        remedy = (
            "without damping no velocity balances it: give fiber_damping, activation and a length with active force"
        )
        refuse(model.muscles, "activation times active force-length multiplier", active, dead, remedy)
    low, high = model.curves.force_velocity.bounds
    multiplier = target / np.where(active > 0, active, 1.0)
    outside = bare & ((multiplier < low) | (multiplier > high))
    if outside.any():
        remedy = f"the force-velocity curve spans {low:g} to {high:g}: give fiber_damping or another length"
        refuse(model.muscles, "force-velocity multiplier", multiplier, outside, remedy)


@dataclass(frozen=True)
class _Drive:
    """Equations A fV(v) + beta v = T."""

    force_velocity: ForceVelocityCurve
    target: Array
    active: Array
    activation: Array
    damping: Array

    def residual(self, velocity: Array) -> tuple[Array, Array, Array]:
        gain, slope = self.force_velocity.evaluate(velocity, self.activation)
        value = self.active * gain + self.damping * velocity - self.target
        return value, self.active * slope + self.damping, 1.0 + np.abs(self.target)

    def take(self, index: NDArray[np.intp]) -> _Drive:
        return _Drive(
            self.force_velocity, self.target[index], self.active[index], self.activation[index], self.damping[index]
        )


def _solve(drive: _Drive) -> Array:
    """Normalised velocities (n,)."""
    curve = drive.force_velocity
    velocity = np.zeros_like(drive.target)
    bare = np.flatnonzero(drive.damping <= 0)
    if bare.size:
        part = drive.take(bare)
        with np.errstate(over="ignore"):
            velocity[bare] = curve.inverse(part.target / part.active, part.activation)
    damped = np.flatnonzero(drive.damping > 0)
    if damped.size:
        part = drive.take(damped)
        # At rest the fiber lacks T - A fV(0); what damping or the curve alone would need to make it up bounds the root.
        lack = part.target - part.active * curve(np.zeros_like(part.target), part.activation)
        far = lack / part.damping
        low, high = curve.bounds
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            multiplier = part.target / part.active
        inside = np.flatnonzero((multiplier > low) & (multiplier < high))
        with np.errstate(over="ignore"):
            near = curve.inverse(multiplier[inside], part.activation[inside])
        far[inside] = np.sign(far[inside]) * np.minimum(np.abs(far[inside]), np.abs(near))
        below, above = np.minimum(far, 0.0), np.maximum(far, 0.0)
        slope = curve.derivative(np.zeros_like(far), part.activation)
        guess = np.clip(lack / (part.active * slope + part.damping), below, above)
        velocity[damped] = solve_rising(part, below, above, guess)
    return velocity

"""Fiber length at which fiber and compliant tendon pull alike: static, and while the musculotendon moves.

F0 (a fL(l) fV(v) + fPE(l) + beta v) cos(alpha) = F0 fT(lT), lMT = lM cos(alpha) + lT. The unknown is tendon strain
s = lT/lslack - 1, between 0 (the tendon pulls nothing, the fiber takes the rest) and the strain that leaves the fiber
its shortest length: tendon force less fiber force rises through 0 between them, or there is no equilibrium.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.curves import Curves, InvertibleCurve
from mjhcmc.hill.errors import HillError
from mjhcmc.hill.parameters import HillModel
from mjhcmc.hill.roots import solve_rising
from mjhcmc.hill.states import MuscleState, assemble, read, refuse

Array = NDArray[np.float64]

_CHUNK = 8192
"""Equations solved together: few enough that their arrays stay in a core's cache."""


def static_equilibrium(model: HillModel, activation: ArrayLike, musculotendon_length: ArrayLike) -> MuscleState:
    """Muscles at rest: fiber velocity 0.

    Where several lengths balance (a long tendon, on the falling side of the active curve), a stable one is found: a
    longer fiber would pull harder than its tendon.

    Args:
        model: The muscles, with positive tendon slack lengths.
        activation: (..., m), from 0 to 1.
        musculotendon_length: (..., m), m.

    Returns:
        The state (..., m), all velocities 0.

    Raises:
        HillError: Naming the muscle and the value: a length with no equilibrium (the tendon slack at every fiber
            length, or a fiber that pulls more than the tendon even at its shortest), a tendon slack length of 0,
            activation outside [0, 1], numbers that are not finite, or shapes that do not fit.
    """
    return dynamic_equilibrium(model, activation, musculotendon_length, 0.0)


def dynamic_equilibrium(
    model: HillModel,
    activation: ArrayLike,
    musculotendon_length: ArrayLike,
    musculotendon_velocity: ArrayLike,
    tendon_velocity: ArrayLike = 0.0,
) -> MuscleState:
    """Muscles in steady motion: the fiber takes the velocity that the tendon leaves it.

    vM = (vMT - vT) cos(alpha). With tendon velocity 0 the force is the one that a steady motion holds; at
    musculotendon velocity 0 this is :func:`static_equilibrium`.

    Args:
        model: The muscles, with positive tendon slack lengths.
        activation: (..., m), from 0 to 1.
        musculotendon_length: (..., m), m.
        musculotendon_velocity: (..., m), m/s, lengthening positive.
        tendon_velocity: (..., m), m/s.

    Returns:
        The state (..., m).

    Raises:
        HillError: As for :func:`static_equilibrium`; and where the fiber shortens so fast that it would push.
    """
    tendon, curves, m = model.curves.need_tendon(), model.curves, model.muscles
    given = read(
        model,
        activation=activation,
        musculotendon_length=musculotendon_length,
        musculotendon_velocity=musculotendon_velocity,
        tendon_velocity=tendon_velocity,
    )
    need_slack_length(model)
    length = given["musculotendon_length"]
    speed = (given["musculotendon_velocity"] - given["tendon_velocity"]) / (
        m.max_fiber_velocity * m.optimal_fiber_length
    )
    width = m.fiber_width / m.optimal_fiber_length
    shortest = np.sqrt(np.maximum(curves.shortest_fiber**2 - width**2, 0.0))
    free = (length - m.tendon_slack_length) / m.optimal_fiber_length
    if not (free > shortest).all():
        remedy = "no equilibrium: the tendon is slack even with the fiber at its shortest: give a longer one"
        refuse(m, "musculotendon_length", length, ~(free > shortest), remedy)
    slack = m.tendon_slack_length / m.optimal_fiber_length
    shape = free.shape

    def flat(values: Array) -> Array:
        return np.broadcast_to(values, shape).ravel()

    whole = _Balance(
        curves,
        tendon,
        flat(given["activation"]),
        flat(free),
        flat(slack),
        flat(width),
        flat(speed) if np.any(speed) else None,
        flat(model.fiber_damping),
    )
    top = flat((free - shortest) / slack)
    strain = np.empty_like(top)
    for start in range(0, top.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        try:
            strain[part] = _solve(whole.take(part), top[part])
        except _NoBalanceError as none:
            bad = np.zeros(top.size, dtype=bool)
            bad[start + none.index] = True
            refuse(m, "musculotendon_length", length, bad.reshape(shape), none.reason)
    along = (free - slack * strain.reshape(shape)) * m.optimal_fiber_length
    fiber_length = np.hypot(along, m.fiber_width)
    fiber_velocity = (given["musculotendon_velocity"] - given["tendon_velocity"]) * along / fiber_length
    return assemble(
        model,
        given["activation"],
        length,
        given["musculotendon_velocity"],
        fiber_length,
        fiber_velocity,
        m.tendon_slack_length * (1.0 + strain.reshape(shape)),  # to more digits than the difference of lengths
    )


def need_slack_length(model: HillModel) -> None:
    """Raise for a muscle without tendon.

    Raises:
        HillError: Naming it.
    """
    slack = model.muscles.tendon_slack_length
    if not (slack > 0).all():
        remedy = "a compliant tendon needs a positive one: give it, or use the rigid tendon"
        refuse(model.muscles, "tendon_slack_length", slack, ~(slack > 0), remedy)


class _NoBalanceError(HillError):
    """No equilibrium for the equation at ``index`` of a chunk."""

    def __init__(self, index: int, reason: str) -> None:
        super().__init__(reason)
        self.index, self.reason = index, reason


@dataclass(frozen=True)
class _Balance:
    """Tendon force less fiber force along the tendon, over F0, at tendon strain; lengths in optimal fiber lengths."""

    curves: Curves
    tendon: InvertibleCurve
    activation: Array
    free: Array  # musculotendon length less tendon slack length
    slack: Array
    width: Array
    speed: Array | None  # fiber velocity along the tendon over the maximum; None at rest
    damping: Array

    def residual(self, strain: Array) -> tuple[Array, Array, Array]:
        force, stiffness = self.tendon.evaluate(1.0 + strain)
        fiber, fiber_stiffness = self.fiber(strain)
        return force - fiber, stiffness + fiber_stiffness * self.slack, 1.0 + np.abs(force)

    def fiber(self, strain: Array) -> tuple[Array, Array]:
        """Fiber force along the tendon, and its slope over the fiber's length along the tendon."""
        along = self.free - self.slack * strain
        length = np.hypot(along, self.width)
        cos = along / length
        active, active_slope = self.curves.active.evaluate(length)
        force, slope = self.curves.passive.evaluate(length)
        turn = self.width * self.width / (length * length * length)  # d cos / d along
        active = self.activation * active
        active_slope = self.activation * active_slope
        if self.speed is None:
            force = force + active
            slope = (slope + active_slope) * cos
        else:
            velocity = self.speed * cos
            gain, gain_slope = self.curves.force_velocity.evaluate(velocity, self.activation)
            force = force + active * gain + self.damping * velocity
            slope = (slope + active_slope * gain) * cos
            slope = slope + (active * gain_slope + self.damping) * self.speed * turn
        return force * cos, slope * cos + force * turn

    def take(self, index: NDArray[np.intp] | slice) -> _Balance:
        return _Balance(
            self.curves,
            self.tendon,
            self.activation[index],
            self.free[index],
            self.slack[index],
            self.width[index],
            None if self.speed is None else self.speed[index],
            self.damping[index],
        )


def _solve(balance: _Balance, top: Array) -> Array:
    """Strains (n,) of n equations."""
    with np.errstate(over="ignore", invalid="ignore"):
        rigid, _ = balance.fiber(np.zeros_like(top))
        at_top = balance.tendon(1.0 + top) - balance.fiber(top)[0]
    none = "no equilibrium: the fiber "
    _refuse(~np.isfinite(rigid), none + "would be stretched beyond all reason: give a shorter one")
    _refuse(rigid < 0, none + "shortens so fast that its tendon would push: give less speed")
    _refuse(~(at_top >= 0), none + "pulls more than its tendon even at its shortest: give a longer one")
    one = float(balance.tendon.inverse(1.0)) - 1.0
    # Real tendons stretch about as log(1 + 5 F): a first guess for any of the curves.
    guess = np.minimum(one * np.log1p(5.0 * rigid) / np.log(6.0), top)
    with np.errstate(over="ignore", invalid="ignore"):
        return solve_rising(balance, np.zeros_like(top), top, guess)


def _refuse(bad: NDArray[np.bool_], reason: str) -> None:
    if bad.any():
        raise _NoBalanceError(int(np.flatnonzero(bad)[0]), reason)

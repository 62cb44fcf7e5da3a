"""Which Hill muscles a model's bodies are driven by, and with which tendons."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc import hill
from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.hill import HillModel, MuscleState
from mjhcmc.hill_muscles import hill_model
from mjhcmc.hosted.curves import CompiledCurves, compiled_curves
from mjhcmc.hosted.muscle import COMPLIANT, RIGID, steady_activations, steady_fibers, steady_forces
from mjhcmc.model import MuscleModel
from mjhcmc.plant import State

TENDONS = ("rigid", "compliant")

LEAST_EXCITATION = 0.01
"""Of muscles with compliant tendons. Without any activation a fiber on a slack tendon stays as long as it is, however
short the path gets; what tone takes up would be missing when the muscle is next needed. OpenSim's Millard and Thelen
muscles have the same least activation."""

_LEAST_GAIN = 0.02

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HostedMuscles:
    """Hill muscles in a model's order, with their tendons.

    Attributes:
        hill: the muscles and their curves.
        tendon: ``"rigid"`` or ``"compliant"``.
        source: the name of the curves where they are those that `hill_muscles.hill_model` finds for the model, so that
            a file can name them; None where a user made them.
    """

    hill: hill.HillModel
    tendon: str
    source: str | None = None

    def __post_init__(self) -> None:
        """Check that the curves know the tendon, and compile them.

        Raises:
            SettingsError: no such tendon, curves without one where it is compliant, or a curve that is not compiled.
        """
        if self.tendon not in TENDONS:
            raise SettingsError(f"tendon {self.tendon!r} is not known: choose one of {', '.join(TENDONS)}")
        if self.compliant:
            if self.hill.curves.tendon is None:
                raise SettingsError(f"{self.hill.curves.name}: these curves have no tendon: take tendon 'rigid'")
            slack = self.hill.muscles.tendon_slack_length
            if not (slack > 0).all():
                name = self.hill.muscles.names[int(np.argmin(slack > 0))]
                raise SettingsError(f"{name}: a tendon slack length of 0 cannot stretch: take tendon 'rigid'")
        self.curves  # noqa: B018 - what cannot be compiled is refused now

    @property
    def compliant(self) -> bool:
        """Whether tendons stretch."""
        return self.tendon == "compliant"

    @property
    def kind(self) -> int:
        """The tendon, for compiled code."""
        return COMPLIANT if self.compliant else RIGID

    @property
    def own(self) -> bool:
        """Whether they are MuJoCo's own muscles, whose damping MuJoCo keeps."""
        return self.source == "mujoco"

    @cached_property
    def curves(self) -> CompiledCurves:
        """The curves, for compiled code."""
        return compiled_curves(self.hill.curves)

    @cached_property
    def parameters(self) -> Array:
        """(n_muscle, 6) see `hosted.muscle`."""
        m = self.hill.muscles
        damping = np.zeros(m.shape) if self.own else self.hill.fiber_damping
        columns = (
            m.max_isometric_force, m.optimal_fiber_length, m.tendon_slack_length, m.fiber_width,
            m.max_fiber_velocity * m.optimal_fiber_length, damping,
        )  # fmt: skip
        return np.ascontiguousarray(np.stack(columns, axis=1))

    def settings(self) -> dict[str, Any]:
        """For the record of a solution; ``named`` where tendon and curves suffice to make them again."""
        known = self.source is not None
        return {"tendon": self.tendon, "curves": self.source or self.hill.curves.name, "named": known}

    def excitation_range(self, model: MuscleModel) -> Array:
        """(n_muscle, 2): the model's; compliant muscles are never without tone (see LEAST_EXCITATION)."""
        limits = model.excitation_range.copy()
        if self.compliant:
            limits = np.maximum(limits, LEAST_EXCITATION)
        return limits

    def workable(self, gain: Array) -> Array:
        """The gain (..., n_muscle) N, at least 2 % of F0: activation is told by it (see `hosted.window`)."""
        return np.maximum(gain, _LEAST_GAIN * self.hill.muscles.max_isometric_force)

    def equilibrium(self, activation: Array, length: Array, velocity: Array, *, lenient: bool = False) -> Array:
        """(n_muscle,) m, fiber lengths of muscles in steady motion; at rest where steady motion would push.

        Args:
            activation: (n_muscle,).
            length: (n_muscle,) m, musculotendon length.
            velocity: (n_muscle,) m/s.
            lenient: give fibers that have no equilibrium, their tendons being slack, their shortest length.

        Raises:
            SimulationError: no equilibrium at rest either.
        """
        activation, found = np.clip(activation, 0.0, 1.0), np.empty(len(length))
        length, velocity = np.ascontiguousarray(length), np.ascontiguousarray(velocity)  # one layout: compiled once
        steady_fibers(self.curves, self.parameters, activation, length, velocity, found)
        for i in np.flatnonzero(np.isnan(found)):
            try:
                found[i] = hill.static_equilibrium(self._alone(int(i)), activation[i], length[i]).fiber_length
            except hill.HillError as error:
                if not lenient:
                    raise SimulationError(
                        f"the fibers cannot be put into equilibrium at the start: {error}, or start at another pose"
                    ) from error
                width = self.parameters[i, 3]
                shortest = self.hill.curves.shortest_fiber * self.parameters[i, 1]
                found[i] = max(shortest, width * (1 + 1e-6))
        return found

    def steady_force(self, activation: Array, length: Array, velocity: Array) -> Array:
        """(n_muscle,) N, tendon forces of muscles in steady motion; 0 where that would push.

        Args:
            activation: (n_muscle,).
            length: (n_muscle,) m, musculotendon length.
            velocity: (n_muscle,) m/s.
        """
        force = np.empty_like(length)
        steady_forces(self.curves, self.parameters, self.kind, activation, length, velocity, force)
        return force

    def steady_activation(self, force: Array, length: Array, velocity: Array) -> Array:
        """(n_muscle,) activation in [0, 1] at which muscles in steady motion pull a force, or nearest to it.

        Args:
            force: (n_muscle,) N.
            length: (n_muscle,) m, musculotendon length.
            velocity: (n_muscle,) m/s.
        """
        activation = np.empty_like(force)
        steady_activations(self.curves, self.parameters, self.kind, force, length, velocity, activation)
        return np.maximum(activation, LEAST_EXCITATION) if self.compliant else activation

    def shares(self, state: State, length: Array, velocity: Array) -> tuple[Array, Array]:
        """(n_muscle,) N each: the part of the tendon forces that the active fibers give, and the rest.

        Args:
            state: with fiber lengths where tendons are compliant.
            length: (n_muscle,) m, musculotendon length.
            velocity: (n_muscle,) m/s.
        """
        found = self._state(state.activation, state.fiber_length if self.compliant else None, length, velocity)
        active = found.active_force * found.cos_pennation
        return active, found.tendon_force - active

    def fibers(self, activation: Array, fiber: Array | None, length: Array, velocity: Array) -> tuple[Array, Array]:
        """(..., n_muscle) m and m/s: fiber lengths along the tendon, and how fast they grow.

        Args:
            activation: (..., n_muscle).
            fiber: (..., n_muscle) m, where tendons are compliant.
            length: (..., n_muscle) m, musculotendon length.
            velocity: (..., n_muscle) m/s.
        """
        found = self._state(activation, fiber, length, velocity)
        return found.fiber_length * found.cos_pennation, found.fiber_velocity / found.cos_pennation

    @property
    def optimal_length_along(self) -> Array:
        """(n_muscle,) m, optimal fiber length along the tendon."""
        m = self.hill.muscles
        return m.optimal_fiber_length * np.cos(m.pennation_at_optimal)

    def _state(self, activation: Array, fiber: Array | None, length: Array, velocity: Array) -> MuscleState:
        activation = np.clip(activation, 0.0, 1.0)
        try:
            if fiber is not None:
                return hill.fiber_dynamics(self.hill, activation, fiber, length, velocity)
            return hill.rigid_tendon(self.hill, activation, length, velocity)
        except hill.HillError as error:
            raise SimulationError(str(error)) from error

    def _alone(self, i: int) -> HillModel:
        """One of the muscles."""
        m = self.hill.muscles
        one = hill.MuscleParameters(
            m.max_isometric_force[i], m.optimal_fiber_length[i], m.tendon_slack_length[i], m.pennation_at_optimal[i],
            m.max_fiber_velocity[i], self.hill.fiber_damping[i], m.names[i],
        )  # fmt: skip
        return HillModel(one, self.hill.curves)


def hosted_muscles(
    model: MuscleModel, muscles: str | hill.HillModel = "millard", tendon: str = "compliant"
) -> HostedMuscles:
    """The Hill muscles of a model.

    Args:
        model: the model.
        muscles: curves by name (see `hill_muscles.hill_model`), or muscles in the model's order.
        tendon: ``"rigid"`` or ``"compliant"``.

    Raises:
        SettingsError: unknown curves or tendon; muscles that are not the model's.
        ModelError: muscles that no Hill model stands for.
    """
    if isinstance(muscles, str):
        return HostedMuscles(hill_model(model, muscles), tendon, muscles)
    if not isinstance(muscles, hill.HillModel):
        raise SettingsError(f"muscles are a name of curves or a HillModel; got {type(muscles).__name__}")
    if muscles.muscles.names != model.muscle_names:
        raise SettingsError(
            f"Hill muscles {', '.join(muscles.muscles.names)} are not the model's "
            f"({', '.join(model.muscle_names)}): give them in its order, with its names"
        )
    return HostedMuscles(muscles, tendon)


def bodies_of(model: MuscleModel, muscles: HostedMuscles) -> MuscleModel:
    """The model with muscles that MuJoCo moves but that pull nothing: a Hill muscle pulls in their place.

    Damping of a muscle's own path is fiber damping, which the Hill muscle has itself.
    """
    m = copy.deepcopy(model.mj_model)
    ids = model.muscle_ids
    m.actuator_gaintype[ids] = mujoco.mjtGain.mjGAIN_FIXED
    m.actuator_gainprm[ids] = 0.0
    m.actuator_biastype[ids] = mujoco.mjtBias.mjBIAS_NONE
    if not muscles.own:
        m.actuator_damping[ids] = 0.0
        m.actuator_dampingpoly[ids] = 0.0
        own = model.own_tendons[model.own_tendons >= 0]
        m.tendon_damping[own] = 0.0
        m.tendon_dampingpoly[own] = 0.0
    return replace(model, mj_model=m, excitation_range=muscles.excitation_range(model))

"""HillPlant: bodies in MuJoCo, driven by Hill muscles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc import hill
from mjhcmc.dynamics import moment_arms
from mjhcmc.errors import ModelError, MotionError, SettingsError
from mjhcmc.hosted.lockstep import HillLockstep
from mjhcmc.hosted.muscles import LEAST_EXCITATION, HostedMuscles, bodies_of, hosted_muscles
from mjhcmc.hosted.stages import muscles_at
from mjhcmc.hosted.window import excite, reach
from mjhcmc.model import MuscleModel
from mjhcmc.plant import MujocoPlant, Outlook, State
from mjhcmc.surroundings import External, Surroundings

Array = NDArray[np.float64]

_CLOSE = 1e-12  # of F0


class HillPlant(MujocoPlant):
    """A MuJoCo model whose muscles are replaced by Hill muscles, with rigid or compliant tendons.

    The methods take it as ``plant``: ``hcmc(model, motion, plant=HillPlant(model))``. It is stepped by a Runge-Kutta
    scheme of our own around MuJoCo's forward dynamics (see `hosted.lockstep`); compliant muscles have their fiber
    length as a state beside activation.

    Args:
        model: the model.
        muscles: curves by name (``"millard"``, ``"thelen"``, ``"degroote-fregly"``; ``"mujoco"`` for MuJoCo's own
            muscles), with parameters that follow from the model's (see `hill_muscles.hill_model`); or Hill muscles in
            the model's order and by its names.
        tendon: ``"compliant"`` or ``"rigid"``.
        physics_dt: s, length of a physics step.
        external: generalized forces from outside; held over each physics step at their value in its middle.
        surroundings: all that acts from outside, and what leads the model's prescribed joints; or give external.

    Attributes:
        hosted: the muscles.
        driven: the model.
        model: the model's bodies, with muscles that pull nothing.

    Raises:
        SettingsError: physics_dt is not a positive number; unknown curves or tendon; muscles that are not the model's.
        ModelError: muscles that no Hill model stands for.
    """

    def __init__(
        self,
        model: MuscleModel,
        muscles: str | hill.HillModel | HostedMuscles = "millard",
        tendon: str = "compliant",
        physics_dt: float = 1e-3,
        external: External | None = None,
        *,
        surroundings: Surroundings | None = None,
    ) -> None:
        hosts = muscles if isinstance(muscles, HostedMuscles) else hosted_muscles(model, muscles, tendon)
        self.hosted: HostedMuscles = hosts
        self.driven = model
        if not model.coordinates.flat:
            raise ModelError(
                f"model {model.name!r} has ball or free joints, which Hill muscles do not go with yet: replace them by "
                "hinges and slides, or use MuJoCo's muscles"
            )
        super().__init__(bodies_of(model, self.hosted), physics_dt, external, surroundings=surroundings)
        self._rows = self.mj_model.actuator_outadr[model.muscle_ids]
        self._range = self.hosted.excitation_range(model)
        self._fiber = np.empty(0)

    def at(self, physics_dt: float, surroundings: Surroundings) -> HillPlant:
        """The same with another physics step, s, and surroundings."""
        return HillPlant(self.driven, self.hosted, physics_dt=physics_dt, surroundings=surroundings)

    def check_motion(self, name: str, time: Array, qpos: Array) -> None:
        """Refuse a motion that leaves a fiber on a rigid tendon no length.

        Args:
            name: of the motion.
            time: (n,) s.
            qpos: (n, nq) rad or m.

        Raises:
            MotionError: naming the muscle, the time and the lengths.
        """
        if self.hosted.compliant:
            return
        m, d = self.mj_model, self.mj_data
        slack = self.hosted.hill.muscles.tendon_slack_length
        for t, pose in zip(time, qpos, strict=True):
            d.qpos[:] = pose
            mujoco.mj_fwdPosition(m, d)
            short = np.flatnonzero(d.actuator_length[self._rows] <= slack)
            if short.size:
                i = int(short[0])
                raise MotionError(
                    f"motion {name!r}: at {t:.4g} s the path of {self.model.muscle_names[i]!r} is "
                    f"{d.actuator_length[self._rows][i]:.4g} m long and its tendon {slack[i]:.4g} m, which leaves the "
                    "fiber nothing: shorten the tendon, or correct the pose"
                )

    @cached_property
    def lockstep(self) -> HillLockstep:
        """What steps it."""
        return HillLockstep([self.driven], [self.hosted], self.physics_dt, [self.surroundings])

    def set_state(self, state: State) -> None:
        """See `MujocoPlant`; fibers whose lengths are not told are put into equilibrium, if there is one."""
        super().set_state(state)
        self._fiber = state.fiber_length.copy()
        if self.hosted.compliant and not self._fiber.size:
            self._fiber = self.hosted.equilibrium(state.activation, *self._path().T, lenient=True)

    def settled(self, state: State) -> State:
        """See `MujocoPlant`.

        Raises:
            SimulationError: a muscle has no equilibrium there.
        """
        super().set_state(state)
        if not self.hosted.compliant or state.fiber_length.size:
            return state
        return replace(state, fiber_length=self.hosted.equilibrium(state.activation, *self._path().T))

    def get_state(self) -> State:
        """See `MujocoPlant`."""
        return replace(super().get_state(), fiber_length=self._fiber.copy())

    def advance(self, excitation: Array, reserve: Array, n_step: int, times: float = 1.0) -> None:
        """See `MujocoPlant`."""
        self.set_input(excitation, reserve)
        plants, here = self.lockstep, self.get_state()
        u, s = (np.asarray(values, dtype=np.float64)[None] for values in (excitation, reserve))
        self.set_state(plants.layout.state(plants.step(np.arange(1), plants.rows([here]), u, s, n_step, times)[0]))

    def forward(self) -> Array:
        """See `MujocoPlant`."""
        self.mj_data.qfrc_applied[:] = self._reserve
        if self._outside is not None:
            self._surround(self._outside, self.plan_here(self._outside), 0, 0.0, fresh=True)
        mujoco.mj_fwdPosition(self.mj_model, self.mj_data)
        mujoco.mj_fwdVelocity(self.mj_model, self.mj_data)
        self.mj_data.qfrc_applied[:] += self.hosted_moment()
        mujoco.mj_forward(self.mj_model, self.mj_data)
        qacc: Array = self.mj_data.qacc
        return qacc

    def muscle_force(self) -> Array:
        """(n_muscle,) N, of the tendons, at the derived quantities as they are."""
        return self._look()[0]

    def hosted_moment(self) -> Array:
        """See `MujocoPlant`."""
        return np.asarray(moment_arms(self).T @ self.muscle_force())

    def gain_and_bias(self) -> tuple[Array, Array]:
        """See `MujocoPlant`; of fibers that move with the path, see `hosted.muscle.gain_and_bias`."""
        _, gain, bias, _ = self._look()
        return gain, bias

    def steady_gain_and_bias(self) -> tuple[Array, Array]:
        """See `MujocoPlant`."""
        n, least = self.model.n_muscle, LEAST_EXCITATION if self.hosted.compliant else 0.0
        rest, full = (self.hosted.steady_force(np.full(n, a), *self._now()) for a in (least, 1.0))
        return full - rest, rest

    def steady_activation(self, effective: Array) -> Array:
        """See `MujocoPlant`."""
        gain, bias = self.steady_gain_and_bias()
        return self.hosted.steady_activation(bias + gain * effective, *self._now())

    def internal_rate(self) -> float:
        """See `MujocoPlant`."""
        return float(max(0.0, -self._look()[3][:, 2].min()))

    def outlook(self, state: State, expected: State, n_step: int, least: Array) -> Outlook:
        """See `MujocoPlant`; activations are effective ones, see `hosted.window`."""
        self.set_state(state)
        start, a, fiber = self._path()[None], state.activation[None], self._fiber.copy()[None]
        super().outlook(state, expected, n_step, least)
        end, (gain, bias), n = self._path()[None], self.gain_and_bias(), self.model.n_muscle
        low, high, x, shift, u = (np.empty((1, n)) for _ in range(5))
        forces, phi = np.empty((1, n, 4)), np.empty((1, n_step + 1, n))
        kind, curves, p = self.hosted.kind, self.hosted.curves, self.hosted.parameters[None]
        prm, limits = self.model.activation_parameters[None], self._range.copy()[None]
        limits[0, :, 0] = np.minimum(np.maximum(limits[0, :, 0], least), limits[0, :, 1])
        hold = np.clip(a, limits[:, :, 0], limits[:, :, 1])
        gain = self.hosted.workable(gain)
        reach(
            0, 1, kind, curves, p, prm, limits, a, fiber, hold, start, end, gain[None], bias[None], np.zeros((1, n)),
            False, self.physics_dt, n_step, low, high, forces, shift, x, phi,
        )  # fmt: skip

        def excitation(goal: Array) -> Array:
            target = (bias + gain * goal)[None]
            excite(
                0, 1, kind, curves, p, prm, limits, a, fiber, target, start, end, self.physics_dt, n_step, hold,
                forces, _CLOSE, u,
            )  # fmt: skip
            found: Array = u[0].copy()
            return found

        return Outlook(low[0], high[0], excitation)

    def _path(self) -> Array:
        """(n_muscle, 2) m and m/s, musculotendon length and velocity at the plant's state."""
        mujoco.mj_fwdPosition(self.mj_model, self.mj_data)
        mujoco.mj_fwdVelocity(self.mj_model, self.mj_data)
        return np.stack(self._now(), axis=1)

    def _now(self) -> tuple[Array, Array]:
        """The same, at the derived quantities as they are."""
        return self.mj_data.actuator_length[self._rows], self.mj_data.actuator_velocity[self._rows]

    def _look(self) -> tuple[Array, Array, Array, Array]:
        """Force, gain, bias (n_muscle,) N, and slopes (n_muscle, 4), see `hosted.stages.read_muscles`."""
        n = self.model.n_muscle
        force, gain, bias, slopes = np.empty(n), np.empty(n), np.empty(n), np.empty((n, 4))
        length, velocity = self._now()
        muscles_at(
            self.hosted.kind, self.hosted.curves, self.hosted.parameters, self.mj_data.act[self.model.act_index],
            self._fiber, length, velocity, force, gain, bias, slopes,
        )  # fmt: skip
        return force, self.hosted.workable(gain), bias, slopes


def lockstep_of(plants: Sequence[MujocoPlant], threads: int) -> HillLockstep:
    """Hill plants, stepped together.

    Raises:
        SettingsError: plants of different curves, tendons or physics steps.
    """
    own = [plant for plant in plants if isinstance(plant, HillPlant)]
    first = own[0]
    if any(plant.physics_dt != first.physics_dt for plant in own):
        raise SettingsError("plants stepped together share their physics_dt: build them with one")
    parts = [plant.driven for plant in own], [plant.hosted for plant in own]
    return HillLockstep(*parts, first.physics_dt, [plant.surroundings for plant in own], threads)

"""The plant: what is stepped under excitations. Methods take it as an argument and know nothing else of MuJoCo.

State lives here and nowhere else.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.activation import activation_after, excitation_for
from mjhcmc.errors import SettingsError
from mjhcmc.model import MuscleModel

RK4_LIMIT = 2.78
"""Largest step times decay rate at which classical Runge-Kutta is stable (2.785 on the real axis)."""


External = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Loads that act from outside, as generalized forces: times (n,) s to (n, nv) N m."""


def physics_steps(dt: float, physics_dt: float) -> int:
    """Physics steps in a window: physics_dt is rounded down so that they divide it."""
    return max(1, math.ceil(dt / physics_dt - 1e-9))


@dataclass(frozen=True)
class State:
    """A plant's state.

    Attributes:
        time: s.
        qpos: (nq,) rad or m.
        qvel: (nv,) rad/s or m/s.
        activation: (n_muscle,).
        warmstart: (nv,) acceleration that MuJoCo's constraint solver starts from; part of the state, so that a window
            stepped twice gives the same bits.
    """

    time: float
    qpos: NDArray[np.float64]
    qvel: NDArray[np.float64]
    activation: NDArray[np.float64]
    warmstart: NDArray[np.float64]


class MujocoPlant:
    """A muscle-driven MuJoCo model, stepped by RK4 under constant excitation and reserves.

    Args:
        model: the model.
        physics_dt: s, length of a physics step.
        external: loads from outside; held over each physics step at their value in its middle.

    Raises:
        SettingsError: physics_dt is not a positive number.
    """

    def __init__(self, model: MuscleModel, physics_dt: float = 1e-3, external: External | None = None) -> None:
        if not (math.isfinite(physics_dt) and physics_dt > 0):
            raise SettingsError(f"physics_dt must be positive, in seconds; got {physics_dt}")
        self.model = model
        self.mj_model = copy.deepcopy(model.mj_model)
        self.mj_model.opt.timestep = physics_dt
        self.mj_data = mujoco.MjData(self.mj_model)
        self.physics_dt = physics_dt
        self.external = external
        self._reserve = np.zeros(model.nv)

    def set_state(self, state: State) -> None:
        """Put the plant into a state; derived quantities are stale until `forward`."""
        d = self.mj_data
        d.time = state.time
        d.qpos[:] = state.qpos
        d.qvel[:] = state.qvel
        d.act[self.model.act_index] = state.activation
        d.qacc_warmstart[:] = state.warmstart

    def get_state(self) -> State:
        """A copy of the plant's state."""
        d = self.mj_data
        return State(d.time, d.qpos.copy(), d.qvel.copy(), d.act[self.model.act_index], d.qacc_warmstart.copy())

    def set_input(self, excitation: NDArray[np.float64] | None, reserve: NDArray[np.float64]) -> None:
        """Hold excitation (n_muscle,) (None: leave it) and reserve (nv,) N m until the next call."""
        if excitation is not None:
            self.mj_data.ctrl[self.model.ctrl_index] = excitation
        self._reserve[:] = reserve
        self.mj_data.qfrc_applied[:] = reserve

    def external_load(self) -> NDArray[np.float64]:
        """(nv,) N m or N, the external load at the plant's time."""
        if self.external is None:
            return np.zeros(self.model.nv)
        load: NDArray[np.float64] = self.external(np.array([self.mj_data.time]))[0]
        return load

    def advance(
        self, excitation: NDArray[np.float64], reserve: NDArray[np.float64], n_step: int, times: float = 1.0
    ) -> None:
        """Take n_step steps of ``times`` physics_dt under constant excitation (n_muscle,) and reserve (nv,) N m."""
        self.set_input(excitation, reserve)
        step = self.mj_model.opt.timestep = times * self.physics_dt
        if self.external is None:
            mujoco.mj_step(self.mj_model, self.mj_data, nstep=n_step)
        else:
            for load in self.external(self.mj_data.time + step * (np.arange(n_step) + 0.5)):
                self.mj_data.qfrc_applied[:] = self._reserve + load
                mujoco.mj_step(self.mj_model, self.mj_data)
        self.mj_model.opt.timestep = self.physics_dt

    def forward(self) -> NDArray[np.float64]:
        """Bring all derived quantities up to date with the state; returns qacc (nv,), a view."""
        if self.external is not None:
            self.mj_data.qfrc_applied[:] = self._reserve + self.external_load()
        # after an RK4 step the derived quantities belong to its fourth stage
        mujoco.mj_forward(self.mj_model, self.mj_data)
        qacc: NDArray[np.float64] = self.mj_data.qacc
        return qacc

    def reachable(
        self, activation: NDArray[np.float64], n_step: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest activation (n_muscle,) that n_step physics steps can reach."""
        prm, limits = self.model.activation_parameters, self.model.excitation_range
        low = activation_after(activation, limits[:, 0], prm, self.physics_dt, n_step)
        high = activation_after(activation, limits[:, 1], prm, self.physics_dt, n_step)
        return low, high

    def excitation_reaching(
        self, activation: NDArray[np.float64], target: NDArray[np.float64], n_step: int
    ) -> NDArray[np.float64]:
        """Excitation (n_muscle,) that takes activation to the target in n_step physics steps."""
        prm, limits = self.model.activation_parameters, self.model.excitation_range
        return excitation_for(activation, target, prm, self.physics_dt, n_step, limits)

"""The plant: what is stepped under excitations. Methods take it as an argument and know nothing else of MuJoCo.

State lives here and nowhere else.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.activation import activation_after, excitation_for
from mjhcmc.clamps import activation_cap
from mjhcmc.errors import SettingsError
from mjhcmc.integrators import RK4_LIMIT as RK4_LIMIT
from mjhcmc.integrators import scheme_of
from mjhcmc.model import MuscleModel
from mjhcmc.surroundings import HEAVY, Columns, External, Kinematics, Outside, Plan, Surroundings, heavy

if TYPE_CHECKING:
    from mjhcmc.hosted.muscles import HostedMuscles


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
        fiber_length: (n_muscle,) m where tendons are compliant, else empty.
    """

    time: float
    qpos: NDArray[np.float64]
    qvel: NDArray[np.float64]
    activation: NDArray[np.float64]
    warmstart: NDArray[np.float64]
    fiber_length: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Outlook:
    """What muscles can have made of their activation when a window ends.

    Attributes:
        low: (n_muscle,) lowest activation that can be reached.
        high: (n_muscle,) highest.
        excitation: the excitation (n_muscle,) that leads to an activation (n_muscle,).
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    excitation: Callable[[NDArray[np.float64]], NDArray[np.float64]]


class MujocoPlant:
    """A muscle-driven MuJoCo model, stepped under constant excitation and reserves.

    Args:
        model: the model.
        physics_dt: s, length of a physics step.
        external: generalized forces from outside; held over each physics step at their value in its middle.
        surroundings: all that acts from outside, and what leads the model's prescribed joints; or give external.
        integrator: ``"rk4"``, ``"euler"``, ``"implicit"`` or ``"implicitfast"``; see `integrators`.

    Attributes:
        scheme: the integrator.

    Raises:
        SettingsError: physics_dt is not a positive number, external and surroundings are both given, or the integrator
            is not known.
    """

    hosted: HostedMuscles | None = None
    """The muscles outside MuJoCo that drive the bodies, if any."""

    def __init__(
        self,
        model: MuscleModel,
        physics_dt: float = 1e-3,
        external: External | None = None,
        *,
        surroundings: Surroundings | None = None,
        integrator: str = "rk4",
    ) -> None:
        self.scheme = scheme_of(integrator)
        if not (math.isfinite(physics_dt) and physics_dt > 0):
            raise SettingsError(f"physics_dt must be positive, in seconds; got {physics_dt}")
        if surroundings is not None and external is not None:
            raise SettingsError("external and surroundings exclude each other: give external within surroundings")
        self.model = model
        self.surroundings = surroundings or Surroundings(external)
        led = self.surroundings.path is not None
        self._heavy = model.roles.prescribed if led else np.empty(0, dtype=np.intp)
        self.mj_model = heavy(copy.deepcopy(model.mj_model), self._heavy)
        self.mj_model.opt.timestep = physics_dt
        self.mj_model.opt.integrator = self.scheme.code
        self.mj_data = mujoco.MjData(self.mj_model)
        self.physics_dt = physics_dt
        self._reserve = np.zeros(model.nv)
        self._outside: Outside | None = None
        if not self.surroundings.empty:
            m = self.mj_model
            ends = np.cumsum([0, 1, m.nq, m.nv, m.nv, 6 * m.nbody])
            self._columns = Columns(*(int(c) for c in ends[:5]))
            self._row = np.zeros((1, int(ends[5])))
            self._outside = Outside([model], [self.surroundings], self._columns)

    def at(self, physics_dt: float, surroundings: Surroundings) -> MujocoPlant:
        """One like it with another physics step, s, and surroundings."""
        return MujocoPlant(self.model, physics_dt, surroundings=surroundings, integrator=self.scheme.name)

    def check_motion(self, name: str, time: NDArray[np.float64], qpos: NDArray[np.float64]) -> None:
        """Refuse a motion that the muscles have no force along; MuJoCo's have one at any length."""

    def set_state(self, state: State) -> None:
        """Put the plant into a state; derived quantities are stale until `forward`."""
        d = self.mj_data
        d.time = state.time
        d.qpos[:] = state.qpos
        d.qvel[:] = state.qvel
        d.act[self.model.act_index] = state.activation
        d.qacc_warmstart[:] = state.warmstart

    def settled(self, state: State) -> State:
        """The state with what muscles have as a state of their own, in equilibrium where it is not told."""
        return state

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
        """(nv,) N m or N, what acts from outside at the plant's last `forward`."""
        load = np.zeros(self.model.nv)
        external = self.surroundings.external
        if external is not None:
            load += external(np.array([self.mj_data.time]))[0]
        m, d = self.mj_model, self.mj_data
        for body in np.flatnonzero(d.xfrc_applied.any(axis=1)):
            force = d.xfrc_applied[body]
            mujoco.mj_applyFT(m, d, force[:3], force[3:], d.xipos[body], body, load)
        return load

    def inertial_force(self) -> NDArray[np.float64]:
        """(nv,) N m or N, M qacc at the plant's last `forward`."""
        m, d = self.mj_model, self.mj_data
        inertial = np.empty(m.nv)
        mujoco.mj_mulM(m, d, inertial, d.qacc)
        inertial[self._heavy] -= HEAVY * d.qacc[self._heavy]
        return inertial

    def advance(
        self, excitation: NDArray[np.float64], reserve: NDArray[np.float64], n_step: int, times: float = 1.0
    ) -> None:
        """Take n_step steps of ``times`` physics_dt under constant excitation (n_muscle,) and reserve (nv,) N m."""
        self.set_input(excitation, reserve)
        m, d, outside = self.mj_model, self.mj_data, self._outside
        step = m.opt.timestep = times * self.physics_dt
        if outside is None:
            mujoco.mj_step(m, d, nstep=n_step)
        else:
            plan = outside.plan(np.zeros(1, dtype=np.intp), np.array([d.time]), step, n_step)
            if outside.at_rest(plan):
                self._lead(outside, plan, 0)
                mujoco.mj_step(m, d, nstep=n_step)
            else:
                for j in range(n_step):
                    self._surround(outside, plan, j, step / 2, fresh=j == 0)
                    mujoco.mj_step(m, d)
            self._lead(outside, plan, n_step)
        m.opt.timestep = self.physics_dt

    def forward(self) -> NDArray[np.float64]:
        """Bring all derived quantities up to date with the state; returns qacc (nv,), a view."""
        if self._outside is not None:
            self._surround(self._outside, self.plan_here(self._outside), 0, 0.0, fresh=True)
        # after an RK4 step the derived quantities belong to its fourth stage
        mujoco.mj_forward(self.mj_model, self.mj_data)
        qacc: NDArray[np.float64] = self.mj_data.qacc
        return qacc

    def step_acceleration(self) -> NDArray[np.float64]:
        """(nv,) rad/s^2 or m/s^2: change of velocity over the next step, per second of it; the state is unchanged.

        Under RK4, which takes several, the acceleration at the state.
        """
        if not self.scheme.first_order:
            return self.forward().copy()
        m, d, state, step = self.mj_model, self.mj_data, self.get_state(), self.physics_dt
        others = d.act.copy()
        if self._outside is not None:
            plan = self._outside.plan(np.zeros(1, dtype=np.intp), np.array([d.time]), step, 1)
            self._surround(self._outside, plan, 0, step / 2, fresh=True)
        before = d.qvel.copy()
        mujoco.mj_step(m, d)
        change: NDArray[np.float64] = d.qvel - before
        d.act[:] = others
        self.set_state(state)
        return change / step

    def forward_as_stepped(self) -> None:
        """As `forward`, with forces as the integrator takes them; the state is unchanged.

        Implicit integrators take them at the velocity that the next step ends with (see `integrators`). Where muscles
        are stiff, those at the state itself are not what moves the model.
        """
        if not self.scheme.implicit:
            self.forward()
            return
        held = self.mj_data.qvel.copy()
        self.mj_data.qvel[:] = held + self.physics_dt * self.step_acceleration()
        self.forward()
        self.mj_data.qvel[:] = held

    def plan_here(self, outside: Outside) -> Plan:
        """What acts from outside at the plant's time."""
        return outside.plan(np.zeros(1, dtype=np.intp), np.array([self.mj_data.time]), 0.0, 1)

    def _lead(self, outside: Outside, plan: Plan, j: int) -> None:
        """Put what is prescribed where it is at the start of step j."""
        d, at, row = self.mj_data, self._columns, self._row
        row[0, at.qpos : at.qvel], row[0, at.qvel : at.applied] = d.qpos, d.qvel
        outside.lead(row, plan, j)
        d.qpos[:], d.qvel[:] = row[0, at.qpos : at.qvel], row[0, at.qvel : at.applied]

    def _surround(self, outside: Outside, plan: Plan, j: int, ahead: float, *, fresh: bool) -> None:
        """Put in what acts in the middle of step j; fresh: the derived quantities are not the state's."""
        m, d, at, row = self.mj_model, self.mj_data, self._columns, self._row
        self._lead(outside, plan, j)
        d.qfrc_applied[:] = self._reserve + plan.force[0, j]
        if outside.on_bodies:
            if fresh:
                mujoco.mj_fwdPosition(m, d)
                mujoco.mj_fwdVelocity(m, d)
            seen = Kinematics(*(getattr(d, name)[None] for name in Kinematics._fields))
            for part in seen:
                part.setflags(write=False)  # like those of a batch: what takes them is compiled once
            none = np.zeros(1, dtype=np.intp)
            outside.push(none, none, row, plan, j, ahead, seen)
            d.xfrc_applied[:] = row[0, at.on_bodies :].reshape(-1, 6)

    def muscle_force(self) -> NDArray[np.float64]:
        """(n_muscle,) N, of muscles outside MuJoCo, at the derived quantities as they are."""
        return np.zeros(self.model.n_muscle)

    def hosted_moment(self) -> NDArray[np.float64]:
        """(nv,) N m: what muscles outside MuJoCo do at the joints at the derived quantities as they are."""
        return np.zeros(self.mj_model.nv)

    def gain_and_bias(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Muscle force as gain a + bias, each (n_muscle,) N, pulling positive, at the plant's last `forward`.

        That of muscles that no forcerange clamps. Leaves the derived actuator forces at activation 0; the plant's
        state is unchanged.
        """
        m, d, index = self.mj_model, self.mj_data, self.model.act_index
        rows = m.actuator_outadr[self.model.muscle_ids]
        held, ids = d.act[index], self.model.muscle_ids
        clamped = m.actuator_forcelimited[ids].copy()
        m.actuator_forcelimited[ids] = 0
        d.act[index] = 1.0
        mujoco.mj_fwdActuation(m, d)
        full = -d.actuator_force[rows]
        d.act[index] = 0.0
        mujoco.mj_fwdActuation(m, d)
        bias = -d.actuator_force[rows]
        d.act[index] = held
        m.actuator_forcelimited[ids] = clamped
        return full - bias, bias

    def steady_gain_and_bias(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The same of muscles that are left to settle; of MuJoCo's, which do at once, the same."""
        return self.gain_and_bias()

    def steady_activation(self, effective: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n_muscle,) activation at which settled muscles pull gain x + bias of `steady_gain_and_bias`."""
        return effective

    def internal_rate(self) -> float:
        """1/s, fastest decay within the muscles themselves, at the plant's last `forward`."""
        return 0.0

    def outlook(self, state: State, expected: State, n_step: int, least: NDArray[np.float64]) -> Outlook:
        """What muscles can do between a state and the one expected n_step physics steps later.

        Leaves the plant at the expected state, after `forward`, without reserves.

        Args:
            state: now.
            expected: its position and velocity count.
            n_step: physics steps.
            least: (n_muscle,) lowest activation that muscles may be asked for.
        """
        low, high = self.reachable(state.activation, n_step)
        self.set_state(expected)
        self.set_input(None, np.zeros(self.model.nv))
        self.forward()
        if np.isfinite(self.model.force_limit).any():
            cap = activation_cap(self.model.force_limit, *self.gain_and_bias())
            high = np.maximum(low, np.minimum(high, cap))
            self.forward()
        low = np.minimum(np.maximum(low, least), high)
        return Outlook(low, high, lambda goal: self.excitation_reaching(state.activation, goal, n_step))

    def reachable(
        self, activation: NDArray[np.float64], n_step: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest activation (n_muscle,) that n_step physics steps can reach."""
        prm, limits = self.model.activation_parameters, self.model.excitation_range
        low = activation_after(activation, limits[:, 0], prm, self.physics_dt, n_step, self.scheme.name)
        high = activation_after(activation, limits[:, 1], prm, self.physics_dt, n_step, self.scheme.name)
        return low, high

    def excitation_reaching(
        self, activation: NDArray[np.float64], target: NDArray[np.float64], n_step: int
    ) -> NDArray[np.float64]:
        """Excitation (n_muscle,) that takes activation to the target in n_step physics steps."""
        prm, limits = self.model.activation_parameters, self.model.excitation_range
        return excitation_for(activation, target, prm, self.physics_dt, n_step, limits, self.scheme.name)

"""Simulations stepped together: what a method drives, one movement or many.

`Lockstep` runs them on MuJoCo's own batch (``mujoco.batch``), on a thread pool; results do not depend on the number of
threads, nor on which simulations share a call. `OneByOne` (see `one_by_one`) does the same with plants that a user
handed in. Both speak `Plants`.

A simulation's state is a row of numbers; `Plants.layout` says where in it what stands.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import cached_property
from types import SimpleNamespace
from typing import Any, NamedTuple, Protocol

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

from mjhcmc.beside import FEW, Beside
from mjhcmc.dynamics import POSITION_STEP, VELOCITY_STEP, NodeForces, fiber_damping, forces_from
from mjhcmc.integrators import Scheme, scheme_of
from mjhcmc.linearization import (
    Array,
    Bound,
    Ids,
    Index,
    Layout,
    Linearization,
    as_slice,
    columns_of,
    without,
)
from mjhcmc.lockstep_kernels import fill_nodes, put_around, read_around, read_slopes
from mjhcmc.model import MuscleModel, never_touches, unclamped
from mjhcmc.plant import State
from mjhcmc.surroundings import HEAVY, Columns, Kinematics, Outside, Surroundings, coordinates_of, heavy

_PROBED = ("qacc", "M", "ncon", "qfrc_smooth", "actuator_force", "actuator_velocity", "ten_velocity")
_AT_NODES = (
    "qacc", "M", "qfrc_passive", "qfrc_actuator", "qfrc_bias", "qfrc_constraint", "actuator_force", "actuator_velocity",
    "ten_velocity", "qfrc_smooth", "qfrc_applied",
)  # fmt: skip
_OF_MUSCLES = ("actuator_length", "actuator_velocity", "actuator_force", "ten_velocity")
_VELOCITIES = int(mujoco.mjtStage.mjSTAGE_VEL)
NEAR = 1e-3
"""rad or m from a joint's limit, from where on it may hold the joint."""

_NODES_AT_ONCE = 1024  # bounds the memory of the pass over a long record


class Seen(NamedTuple):
    """What is seen of simulations at states.

    Attributes:
        qacc: (b, nv) rad/s^2 or m/s^2.
        path: (b, n_muscle, 2) m and m/s, musculotendon length and velocity.
        force: (b, n_muscle) N, of the muscles' actuators, pulling positive; see `Lockstep.pulled`.
        ten_velocity: (b, ntendon) m/s.
    """

    qacc: Array
    path: Array
    force: Array
    ten_velocity: Array


class Plants(Protocol):
    """Simulations stepped together. Arrays have one row a simulation of the call, in the order of ``ids``, which rise.

    Attributes:
        count: simulations in all.
        physics_dt: s, length of a physics step.
        layout: of the state rows.
        scheme: what integrates them.
    """

    scheme: Scheme
    count: int
    physics_dt: float
    layout: Layout

    def rows(self, states: Sequence[State]) -> Array:
        """(count, n_row) state rows of all simulations."""

    def step(self, ids: Ids, rows: Array, excitation: Array, reserve: Array, n_step: int, times: float = 1.0) -> Array:
        """The state rows after n_step steps of ``times`` physics_dt under constant inputs; NaN where MuJoCo fails."""

    def acceleration(self, ids: Ids, rows: Array, reserve: Array) -> Array:
        """(b, nv) that steps from states begin with, under reserves (b, nv) N m; NaN where MuJoCo fails.

        Under integrators of first order the acceleration of the whole step, else that at the state.
        """

    def linearize(
        self, ids: Ids, rows: Array, reserve: Array, *, stiffness: bool = False, damping: bool = False
    ) -> Linearization:
        """Around states; with K, and with fiber damping in the bias, where asked for. NaN where MuJoCo fails."""

    def nodes(self, i: int, rows: Array, reserve: Array) -> NodeForces:
        """Forces of simulation i at several states (k, n_row) under reserves (k, nv)."""

    def fault(self, i: int) -> str:
        """What MuJoCo said when simulation i failed, or nothing."""


class Lockstep:
    """Simulations of MuJoCo models of one structure, on ``mujoco.batch``; see `Plants`.

    Args:
        models: one a simulation, alike in all but numbers.
        physics_dt: s, length of a physics step.
        surroundings: what acts from outside and what leads them, one a simulation; forces are held over each physics
            step at their value in its middle.
        threads: threads to step on, the caller's among them.
        integrator: of all of them, see `integrators`.
    """

    _probed: tuple[str, ...] = _PROBED

    def __init__(
        self,
        models: Sequence[MuscleModel],
        physics_dt: float,
        surroundings: Sequence[Surroundings],
        threads: int = 1,
        integrator: str = "rk4",
    ) -> None:
        self.count, self.physics_dt, self.scheme = len(models), physics_dt, scheme_of(integrator)
        self._models, self._surroundings, self._threads = models, surroundings, threads
        self._differ = any(model is not models[0] for model in models)
        self._nodes: tuple[Batch, Bound] | None = None
        self._faults: dict[int, str] = {}
        self._kinematics: dict[int, Kinematics] = {}
        self._last: tuple[int, float, Any] | None = None
        self._batches = {1.0: self._batch(1.0)}
        first, batch = models[0], self._batches[1.0]
        self._qacc = batch.bind("qacc")
        self._act = (columns_of(batch, "act").start + first.act_index).astype(np.intp)
        self.layout = Layout(
            time=columns_of(batch, "time").start,
            qpos=columns_of(batch, "qpos"),
            qvel=columns_of(batch, "qvel"),
            activation=as_slice(self._act),
            warmstart=columns_of(batch, "qacc_warmstart"),
        )
        self._ctrl = as_slice(columns_of(batch, "ctrl").start + first.ctrl_index)
        self._applied = columns_of(batch, "qfrc_applied")
        self._beside = Beside(self) if first.nv > FEW else None
        self._outside: Outside | None = None
        if not all(s.empty for s in surroundings):
            self._outside = Outside(models, surroundings, self._state_columns())

    def _state_columns(self) -> Columns:
        at = self.layout
        on_bodies = columns_of(self._batches[1.0], "xfrc_applied").start
        return Columns(at.time, at.qpos.start, at.qvel.start, self._applied.start, on_bodies)

    def _batch(self, times: float, copies: int = 1, *, clamped: bool = True) -> Batch:
        """The simulations, each so many times over, with a step of so many times physics_dt.

        Muscle force is affine in activation where no forcerange clamps it.
        """

        def stepped(model: MuscleModel) -> Any:
            m = self._stepped(model, times)
            return m if clamped else unclamped(m, model)

        first = self._models[0]
        batch = Batch(stepped(first), copies * self.count, self._threads)
        if self._differ:
            own = [stepped(model) for model in self._models]
            batch.set_models([m for m in own for _ in range(copies)])
        return self._watched(batch)

    def _stepped(self, model: MuscleModel, times: float) -> Any:
        """A model's own with a step of so many times physics_dt; that of the last one asked for is kept."""
        if self._last is None or self._last[:2] != (id(model), times):
            m = heavy(copy.copy(model.mj_model), self._heavy)
            if never_touches(m):  # looking for contacts is a sixth of a leg's step
                m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
            m.opt.timestep, m.opt.integrator = times * self.physics_dt, self.scheme.code
            self._last = id(model), times, m
        return self._last[2]

    def _watched(self, batch: Batch) -> Batch:
        """The batch, with the kinematics that loads need kept up to date: what is bound late is filled late."""
        if any(s.loads is not None for s in self._surroundings):
            self._kinematics[id(batch)] = Kinematics(*(batch.bind(name) for name in Kinematics._fields))
        return batch

    @property
    def _heavy(self) -> Ids:
        """The degrees of freedom that are led along a motion."""
        led = any(s.path is not None for s in self._surroundings)
        return self._models[0].roles.prescribed if led else np.empty(0, dtype=np.intp)

    @cached_property
    def _probe(self) -> tuple[Batch, Bound]:
        """Each simulation 2 + nv times, to look around a state in one call."""
        batch = self._batch(1.0, 2 + self._models[0].nv, clamped=False)
        return batch, Bound(batch, self._models[0], self._probed)

    def rows(self, states: Sequence[State]) -> Array:
        """See `Plants`."""
        at = self.layout
        rows: Array = self._batches[1.0].state.copy()
        for row, state in zip(rows, states, strict=True):
            row[at.time], row[at.qpos], row[at.qvel] = state.time, state.qpos, state.qvel
            row[at.activation], row[at.warmstart] = state.activation, state.warmstart
        return rows

    def step(self, ids: Ids, rows: Array, excitation: Array, reserve: Array, n_step: int, times: float = 1.0) -> Array:
        """See `Plants`."""
        batch = self._batches.get(times) or self._batches.setdefault(times, self._batch(times))
        where, outside = self._where(ids), self._outside
        start = rows.copy()
        start[:, self._ctrl] = excitation
        start[:, self._applied] = reserve
        batch.state[where] = start
        if outside is None:
            failed = self._call(batch, batch.step, ids, n_step)
            return without(failed, ids, batch.state[where].copy())
        failed = set[int]()
        h = times * self.physics_dt
        plan = outside.plan(ids, rows[:, self.layout.time], h, n_step)
        if outside.at_rest(plan):
            outside.lead(start, plan, 0)
            batch.state[where] = start
            failed = self._call(batch, batch.step, ids, n_step)
            start = batch.state[where].copy()
            outside.lead(start, plan, n_step)
            return without(failed, ids, start)
        for j in range(n_step):
            outside.lead(start, plan, j)
            start[:, self._applied] = reserve + plan.force[:, j]
            if outside.on_bodies:
                if j == 0:
                    batch.state[where] = start
                    failed |= self._call(batch, batch.forward, ids, _VELOCITIES)
                # after a step MuJoCo's kinematics are those of its last stage, within O(h^3) of where it ended
                outside.push(ids, ids, start, plan, j, h / 2, self._seen(batch))
            batch.state[where] = start
            failed |= self._call(batch, batch.step, ids)
            start = batch.state[where].copy()
        outside.lead(start, plan, n_step)
        return without(failed, ids, start)

    def acceleration(self, ids: Ids, rows: Array, reserve: Array) -> Array:
        """See `Plants`."""
        batch, where = self._batches[1.0], self._where(ids)
        under, failed = self._under(ids, rows, reserve, self.physics_dt if self.scheme.first_order else 0.0)
        batch.state[where] = under
        if self.scheme.first_order:
            failed |= self._call(batch, batch.step, ids)
            change = batch.state[where][:, self.layout.qvel] - under[:, self.layout.qvel]
            return without(failed, ids, change / self.physics_dt)
        failed |= self._call(batch, batch.forward, ids)
        return without(failed, ids, self._qacc[where].copy())

    @cached_property
    def _seen_muscles(self) -> Bound:
        return Bound(self._batches[1.0], self._models[0], _OF_MUSCLES)

    def path(self, ids: Ids, rows: Array) -> Array:
        """(b, n_muscle, 2) m and m/s, musculotendon length and velocity at states."""
        batch, where, bound = self._batches[1.0], self._where(ids), self._seen_muscles
        batch.state[where] = rows[:, : batch.state.shape[1]]
        self._call(batch, batch.forward, ids, _VELOCITIES)
        return path_of_muscles(bound, where)

    def look(self, ids: Ids, rows: Array, reserve: Array) -> Seen:
        """Acceleration and muscles at states, under reserves (b, nv) N m; accelerations are NaN where MuJoCo fails."""
        bound, where = self._seen_muscles, self._where(ids)  # what is bound late is filled late
        qacc = self.acceleration(ids, rows, reserve)
        force = -bound.actuator_force[where][:, bound.muscles]
        return Seen(qacc, path_of_muscles(bound, where), force, bound.ten_velocity[where].copy())

    def pulled(self, i: int, seen: Seen) -> Array:
        """(k, n_muscle) N, tendon forces of simulation i in k looks, fiber damping included."""
        model = self._models[i]
        velocity = np.zeros((len(seen.force), model.mj_model.nu))
        velocity[:, model.mj_model.actuator_outadr[model.muscle_ids]] = seen.path[:, :, 1]
        at = SimpleNamespace(actuator_velocity=velocity, ten_velocity=seen.ten_velocity)
        return np.asarray((seen.force + fiber_damping(model, at)) * model.path_gear)

    def linearize(
        self, ids: Ids, rows: Array, reserve: Array, *, stiffness: bool = False, damping: bool = False
    ) -> Linearization:
        """See `Plants`."""
        start, failed = self._under(ids, rows, reserve)
        if self._beside is not None:
            lost, found = self._beside.look(self, ids, start, stiffness=stiffness, damping=damping)
            return found._replace(qacc=without(failed | lost, ids, found.qacc))
        b, nv, n = len(ids), self._models[0].nv, self._models[0].n_muscle
        lost, bound, probe = self._look(ids, start, self.layout.qvel.start, VELOCITY_STEP)
        failed |= lost
        n_contact = bound.ncon[(2 + nv) * ids]
        qacc, gain, bias = np.empty((b, nv)), np.empty((b, n)), np.empty((b, n))
        M, B, D = np.empty((b, nv, nv)), np.empty((b, nv, n)), np.empty((b, nv, nv))
        read_around(
            probe, ids, self._act, VELOCITY_STEP, bound.qacc, bound.M, *bound.M_index, *bound.moment, bound.muscles,
            bound.actuator_force, bound.qfrc_smooth, qacc, M, B, gain, bias, D,
        )  # fmt: skip
        if damping:
            bias += np.array([bound.fiber_damping(self._models[i], (2 + nv) * i) for i in ids])
        K = None
        if stiffness:
            failed |= self._look(ids, start, self.layout.qpos.start, POSITION_STEP)[0]
            K = np.empty((b, nv, nv))
            read_slopes(ids, POSITION_STEP, bound.qfrc_smooth, K)
        held = self._held(start, n_contact)
        return Linearization(without(failed, ids, qacc), M, B, gain, bias, D, K, held)

    @cached_property
    def _limits(self) -> tuple[Ids, Array]:
        """Columns (n,) of the limited coordinates that are no equality's doing, and their ranges (n, 2)."""
        first = self._models[0]
        tied = coordinates_of(first.mj_model, first.roles.dependent)
        limited = np.setdiff1d(np.flatnonzero(np.isfinite(first.joint_range).any(axis=1)), tied)
        return self.layout.qpos.start + limited, first.joint_range[limited]

    def _held(self, rows: Array, n_contact: NDArray[np.int32]) -> NDArray[np.bool_]:
        """(b,) which simulations a joint's limit or a contact holds, or nearly so.

        What limits and contacts do to inertia and damping is not in M and D: where one comes off, a correction that
        counted on it throws the joint away, while one that did not only falls short.
        """
        columns, limits = self._limits
        q = rows[:, columns]
        at_limit = (q < limits[:, 0] + NEAR) | (q > limits[:, 1] - NEAR)
        return np.asarray(at_limit.any(axis=1) | (n_contact > 0))

    def _look(self, ids: Ids, start: Array, first: int, step: float) -> tuple[set[int], Bound, Array]:
        """Look around states; returns what failed, the derived quantities and the rows that they belong to."""
        batch, bound = self._probe
        copies = 2 + self._models[0].nv
        coordinates = self._models[0].coordinates
        if first == self.layout.qpos.start and not coordinates.flat:
            put_around(batch.state, ids, start, self._act, self.layout.qvel.start, copies - 2, 0.0)
            ways = np.broadcast_to(step * np.eye(copies - 2), (len(ids), copies - 2, copies - 2))
            q = np.repeat(start[:, None, self.layout.qpos], copies - 2, axis=1)
            batch.state.reshape(self.count, copies, -1)[ids, 2:, self.layout.qpos] = coordinates.moved(q, ways)
        else:
            put_around(batch.state, ids, start, self._act, first, copies - 2, step)
        whole = len(ids) == self.count
        try:
            batch.forward(None if whole else (copies * ids[:, None] + np.arange(copies)).ravel())
        except SimulationError as error:
            self._faults.update({int(i) // copies: batch.error(int(i)) for i in error.ids})
            return {int(i) // copies for i in error.ids}, bound, batch.state
        return set(), bound, batch.state

    def nodes(self, i: int, rows: Array, reserve: Array) -> NodeForces:
        """See `Plants`."""
        if len(rows) > max(8, _NODES_AT_ONCE // self._models[i].nv):
            halves = np.array_split(np.arange(len(rows)), 2)
            parts = [self.nodes(i, rows[half], reserve[half]) for half in halves]
            return NodeForces(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(NodeForces)))
        model, k = self._models[i], len(rows)
        if self._nodes is None or self._nodes[0].nsim != k:
            batch = self._watched(Batch(self._stepped(model, 1.0), k, self._threads))
            self._nodes = batch, Bound(batch, model, _AT_NODES)
        batch, bound = self._nodes
        if self._differ:
            batch.set_models(self._stepped(model, 1.0))
        start, load = self._surround_nodes(i, batch, rows, reserve)
        batch.state[:] = start
        if self.scheme.implicit:  # forces are those that move the model, see `MujocoPlant.forward_as_stepped`
            batch.step()
            start[:, self.layout.qvel] = batch.state[:, self.layout.qvel]
            batch.state[:] = start
        batch.forward()
        M, R = np.empty((k, model.nv, model.nv)), np.empty((k, model.n_muscle, model.nv))
        fill_nodes(bound.M, *bound.M_index, *bound.moment, bound.muscles, M, R)
        inertial = (M @ bound.qacc[:, :, None])[:, :, 0]
        inertial[:, self._heavy] -= HEAVY * bound.qacc[:, self._heavy]
        return forces_from(model, bound, R, inertial, load + self._on_bodies(bound))

    def _surround_nodes(self, i: int, batch: Batch, rows: Array, reserve: Array) -> tuple[Array, Array]:
        """Several states of simulation i as rows with all that acts; and generalized forces from outside (k, nv)."""
        start, load = rows.copy(), np.zeros((len(rows), self._models[i].nv))
        start[:, self._applied] = reserve
        if self._outside is not None:
            which = np.full(len(rows), i)
            plan = self._outside.plan(which, rows[:, self.layout.time], 0.0, 1)
            load = plan.external[:, 0]
            start[:, self._applied] += plan.force[:, 0]
            if self._outside.on_bodies:
                batch.state[:] = start[:, : batch.state.shape[1]]
                batch.forward(None, _VELOCITIES)
                self._outside.push(which, np.arange(len(rows)), start, plan, 0, 0.0, self._seen(batch))
        return start, load

    def _on_bodies(self, bound: Bound) -> Array | float:
        """(k, nv) what forces on bodies do at the joints: what the sum of all smooth forces holds beside the others."""
        if self._outside is None or not self._outside.on_bodies:
            return 0.0
        others = bound.qfrc_passive - bound.qfrc_bias + bound.qfrc_actuator + bound.qfrc_applied
        return bound.qfrc_smooth - others

    def fault(self, i: int) -> str:
        """See `Plants`."""
        return self._faults.get(i, "")

    def _where(self, ids: Ids) -> Index:
        return slice(None) if len(ids) == self.count else ids

    def _call(self, batch: Batch, call: Callable[..., None], ids: Ids, *arguments: int) -> set[int]:
        """Run simulations; returns those in which MuJoCo raised an error, and keeps what it said."""
        try:
            call(None if len(ids) == self.count else ids, *arguments)
        except SimulationError as error:
            self._faults.update({int(i): batch.error(int(i)) for i in error.ids})
            return {int(i) for i in error.ids}
        return set()

    def _under(self, ids: Ids, rows: Array, reserve: Array, step: float = 0.0) -> tuple[Array, set[int]]:
        """The rows with reserves, and what acts from outside in the middle of a step; and the simulations that fail."""
        start, failed = rows.copy(), set[int]()
        start[:, self._applied] = reserve
        if self._outside is not None:
            plan = self._outside.plan(ids, rows[:, self.layout.time], step, 1)
            self._outside.lead(start, plan, 0)
            start[:, self._applied] += plan.force[:, 0]
            if self._outside.on_bodies:
                batch, where = self._batches[1.0], self._where(ids)
                batch.state[where] = start[:, : batch.state.shape[1]]
                failed = self._call(batch, batch.forward, ids, _VELOCITIES)
                self._outside.push(ids, ids, start, plan, 0, step / 2, self._seen(batch))
        return start, failed

    def _seen(self, batch: Batch) -> Kinematics:
        return self._kinematics[id(batch)]


def path_of_muscles(bound: Bound, where: Index) -> Array:
    """(b, n_muscle, 2) m and m/s, of what was looked at."""
    columns = (bound.actuator_length[where][:, bound.muscles], bound.actuator_velocity[where][:, bound.muscles])
    return np.ascontiguousarray(np.stack(columns, axis=-1))

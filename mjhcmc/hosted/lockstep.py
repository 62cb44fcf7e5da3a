"""Simulations whose muscles are Hill muscles, stepped together: an RK4 of our own around MuJoCo's forward dynamics.

MuJoCo knows bodies, paths and whatever else acts; the muscles' forces reach it as joint moments. A state row is
MuJoCo's, followed by the fiber lengths where tendons are compliant. With MuJoCo's own muscle the steps are `mj_step`'s
to rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

from mjhcmc.chunks import in_chunks
from mjhcmc.dynamics import POSITION_STEP, VELOCITY_STEP, NodeForces, forces_from, smooth_force, with_hosted
from mjhcmc.errors import SettingsError
from mjhcmc.hosted.curves import CompiledCurves
from mjhcmc.hosted.muscles import HostedMuscles, bodies_of
from mjhcmc.hosted.stages import accelerate, advance_stage, pull, read_muscles, read_slopes_around
from mjhcmc.linearization import Array, Bound, Ids, Linearization, without
from mjhcmc.lockstep import Lockstep, Seen, path_of_muscles
from mjhcmc.lockstep_kernels import fill_nodes, put_around
from mjhcmc.model import MuscleModel
from mjhcmc.plant import State
from mjhcmc.surroundings import HEAVY, Surroundings

_STAGED = ("qacc", "M", "nefc", "ncon", "actuator_length", "actuator_velocity")
_PROBED = (*_STAGED, "qfrc_passive", "qfrc_actuator", "qfrc_bias")
_AT_NODES = (
    *_STAGED, "qfrc_passive", "qfrc_actuator", "qfrc_bias", "qfrc_constraint", "qfrc_smooth", "qfrc_applied",
    "actuator_force", "ten_velocity",
)  # fmt: skip
_NODES_AT_ONCE = 1024
_WORTH_THREADS = 192  # simulations: for fewer, a stage's own work is done before another thread wakes
_VELOCITIES, _ALL = int(mujoco.mjtStage.mjSTAGE_VEL), int(mujoco.mjtStage.mjSTAGE_ACC)


class Pull(NamedTuple):
    """What the muscles do at states.

    Attributes:
        force: (b, n_muscle) N, of the tendons.
        tau: (b, nv) N m, R^T F.
        qacc: (b, nv) rad/s^2 or m/s^2.
    """

    force: Array
    tau: Array
    qacc: Array


@dataclass(frozen=True, eq=False)
class MuscleView:
    """States seen by what drives Hill muscles.

    Attributes:
        around: forces around the states; ``gain`` and ``bias`` are those of `hosted.muscle.gain_and_bias`, D and K
            are taken at fixed activation and fiber length.
        R: (b, n_muscle, nv) m, -dL/dq.
        force: (b, n_muscle) N, of the tendons.
        path: (b, n_muscle, 2) m and m/s, musculotendon length and velocity.
        slopes: (b, n_muscle, 4) dF/dl, dF/dL (N/m), dv/dl, dv/dL (1/s); see `hosted.stages.read_muscles`.
    """

    around: Linearization
    R: Array
    force: Array
    path: Array
    slopes: Array

    def of(self, which: NDArray[np.bool_]) -> MuscleView:
        """That of some of the simulations."""
        parts = (part[which] for part in (self.R, self.force, self.path, self.slopes))
        return MuscleView(self.around.of(which), *parts)


class HillLockstep(Lockstep):
    """See `lockstep.Plants`.

    Args:
        models: one a simulation, alike in all but numbers.
        muscles: one a simulation, or one for all; of one kind of tendon and the same curves.
        physics_dt: s, length of a physics step.
        surroundings: what acts from outside and what leads them, one a simulation; forces are held over each physics
            step at their value in its middle.
        threads: threads to step on, the caller's among them.

    Raises:
        SettingsError: muscles of different curves or tendons.
    """

    _probed = _PROBED

    def __init__(
        self,
        models: Sequence[MuscleModel],
        muscles: Sequence[HostedMuscles],
        physics_dt: float,
        surroundings: Sequence[Surroundings],
        threads: int = 1,
    ) -> None:
        first = muscles[0]
        if any(m.tendon != first.tendon or not _same(m.curves, first.curves) for m in muscles):
            raise SettingsError("muscles stepped together share their curves and their kind of tendon: give such")
        one = len(muscles) == 1
        bodies: list[MuscleModel] = []
        made: dict[tuple[int, int], MuscleModel] = {}
        for model, m in zip(models, [*muscles] * (len(models) if one else 1), strict=True):
            key = id(model), id(m)
            bodies.append(made[key] if key in made else made.setdefault(key, bodies_of(model, m)))
        super().__init__(bodies, physics_dt, surroundings, threads)
        self.muscles = first
        self._all = [*muscles] * (self.count if one else 1)
        parameters = np.stack([m.parameters for m in muscles])
        self.parameters = np.repeat(parameters, self.count, axis=0) if one else parameters
        self.activation_parameters = np.stack([m.activation_parameters for m in models])
        self.excitation_range = np.stack([h.excitation_range(m) for h, m in zip(self._all, models, strict=True)])
        self._n_state = self._batches[1.0].state.shape[1]
        n_fiber = models[0].n_muscle if first.compliant else 0
        self.layout = replace(self.layout, fiber=slice(self._n_state, self._n_state + n_fiber))
        self._bound = Bound(self._batches[1.0], bodies[0], _STAGED)

    def rows(self, states: Sequence[State]) -> Array:
        """See `Plants`; a state that holds no fiber lengths has its fibers in equilibrium, if there is one."""
        found = np.zeros((self.count, self.layout.fiber.stop))
        found[:, : self._n_state] = super().rows(states)
        if self.muscles.compliant:
            for i, (row, state) in enumerate(zip(found, states, strict=True)):
                fiber = state.fiber_length
                row[self.layout.fiber] = fiber if len(fiber) else self._resting(i, row)
        return found

    def _resting(self, i: int, row: Array) -> Array:
        """Fiber lengths in equilibrium, of simulation i."""
        path = self.path(np.array([i]), row[None])[0]
        return self._all[i].equilibrium(row[self.layout.activation], path[:, 0], path[:, 1], lenient=True)

    def look(self, ids: Ids, rows: Array, reserve: Array) -> Seen:
        """See `lockstep.Lockstep.look`; forces are the tendons'."""
        batch, where, bound = self._batches[1.0], self._where(ids), self._seen_muscles
        start, failed = self._under(ids, rows, reserve)
        batch.state[where] = start[:, : self._n_state]
        found = self._pull(batch, self._bound, _Call.of(self, ids), start, failed)
        still = np.zeros((len(ids), self._models[0].mj_model.ntendon))
        return Seen(without(failed, ids, found.qacc), path_of_muscles(bound, where), found.force, still)

    def pulled(self, i: int, seen: Seen) -> Array:
        """See `lockstep.Lockstep.pulled`."""
        return seen.force

    def step(self, ids: Ids, rows: Array, excitation: Array, reserve: Array, n_step: int, times: float = 1.0) -> Array:
        """See `Plants`."""
        where, b, at = self._where(ids), len(ids), self.layout
        h = times * self.physics_dt
        batch, bound, whole = self._batches[1.0], self._bound, _Call.of(self, ids)
        u = np.clip(excitation, self.excitation_range[where, :, 0], self.excitation_range[where, :, 1])
        prm, curves = self.activation_parameters[where], self.muscles.curves
        now, total = rows.copy(), np.empty((b, 2 * (reserve.shape[1] + excitation.shape[1])))
        outside, failed = self._outside, set[int]()
        plan = None if outside is None else outside.plan(ids, rows[:, at.time], h, n_step)
        for j in range(n_step):
            now[:, self._applied] = reserve
            if outside is not None and plan is not None:
                outside.lead(now, plan, j)
                now[:, self._applied] += plan.force[:, j]
                if outside.on_bodies:
                    if j == 0:
                        batch.state[where] = now[:, : self._n_state]
                        self._forward(batch, whole.ids, failed, _VELOCITIES)
                    outside.push(ids, ids, now, plan, j, h / 2, self._seen(batch))
            start = now.copy()
            batch.state[where] = now[:, : self._n_state]
            for stage in range(4):
                found = self._pull(batch, bound, whole, now, failed)
                parts = (
                    ids, stage, h, at.time, at.qpos.start, at.qvel.start, at.warmstart.start, self._act, at.fiber.start,
                    self.muscles.kind, curves, whole.p, prm, u, found.qacc, bound.actuator_length, bound.muscles, start,
                    now, total, batch.state,
                )  # fmt: skip
                in_chunks(partial(_stage, parts), b, self._threads if b >= _WORTH_THREADS else 1)
        if outside is not None and plan is not None:
            outside.lead(now, plan, n_step)
        return without(failed, ids, now)

    def acceleration(self, ids: Ids, rows: Array, reserve: Array) -> Array:
        """See `Plants`."""
        batch = self._batches[1.0]
        start, failed = self._under(ids, rows, reserve)
        batch.state[self._where(ids)] = start[:, : self._n_state]
        found = self._pull(batch, self._bound, _Call.of(self, ids), start, failed)
        return without(failed, ids, found.qacc)

    def linearize(
        self, ids: Ids, rows: Array, reserve: Array, *, stiffness: bool = False, damping: bool = False
    ) -> Linearization:
        """See `Plants`; fiber damping is always in the bias."""
        return self.view(ids, rows, reserve, stiffness=stiffness).around

    def view(self, ids: Ids, rows: Array, reserve: Array, *, stiffness: bool = True) -> MuscleView:
        """What drives Hill muscles wants to know of states; see `Plants.linearize`."""
        batch, bound = self._probe
        nv, n, b = self._models[0].nv, self._models[0].n_muscle, len(ids)
        copies = 2 + nv
        start, failed = self._under(ids, rows, reserve)
        call = _Call.of(self, ids, copies)
        slope: list[Array] = []
        M, R = np.empty((b, nv, nv)), np.empty((b, n, nv))
        for first, step in ((self.layout.qpos.start, POSITION_STEP), (self.layout.qvel.start, VELOCITY_STEP)):
            if first == self.layout.qpos.start and not stiffness:
                continue
            put_around(batch.state, ids, start[:, : self._n_state], self._act, first, nv, step)
            near = np.repeat(start, copies, axis=0)
            near[:, : self._n_state] = batch.state[call.at]
            found = self._pull(batch, bound, call, near, failed)
            slope.append(np.empty((b, nv, nv)))
            read_slopes_around(
                ids, copies, step, bound.M, *bound.M_index, *bound.moment, bound.muscles, smooth_force(bound),
                found.tau, M, R, slope[-1],
            )  # fmt: skip
        path, slopes = np.empty((b, n, 2)), np.empty((b, n, 4))
        force, gain, bias = (np.empty((b, n)) for _ in range(3))
        at, p = (np.ascontiguousarray(part[::copies]) for part in (call.at, call.p))
        read_muscles(
            0, b, at, self.muscles.kind, self.muscles.curves, p, *self._driven(rows), bound.actuator_length,
            bound.actuator_velocity, bound.muscles, path, force, gain, bias, slopes,
        )  # fmt: skip
        gain = self.muscles.workable(gain)
        around = Linearization(
            without(failed, ids, found.qacc[::copies].copy()), M,
            np.ascontiguousarray(np.swapaxes(R * gain[:, :, None], 1, 2)), gain, bias, slope[-1],
            slope[0] if stiffness else None, self._held(start, bound.ncon[call.at[::copies]]),
        )  # fmt: skip
        return MuscleView(around, R, force, path, slopes)

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
        batch.state[:] = start[:, : self._n_state]
        call = _Call(np.arange(k), np.repeat(self.parameters[[i]], k, axis=0), None)
        found = self._pull(batch, bound, call, start, set())
        M, R = np.empty((k, model.nv, model.nv)), np.empty((k, model.n_muscle, model.nv))
        fill_nodes(bound.M, *bound.M_index, *bound.moment, bound.muscles, M, R)
        inertial = (M @ found.qacc[:, :, None])[:, :, 0]
        inertial[:, self._heavy] -= HEAVY * found.qacc[:, self._heavy]
        forces = forces_from(model, bound, R, inertial, load + self._on_bodies(bound))
        return with_hosted(forces, model, found.force, R)

    def _pull(self, batch: Batch, bound: Bound, call: _Call, rows: Array, failed: set[int]) -> Pull:
        """Forward dynamics of the states in a batch's rows, with the muscles' forces.

        MuJoCo's own pass is one without muscles. What they do is added to its acceleration, but where constraints are
        in play, which answer to all forces together: there it takes a second pass.
        """
        b, nv, n = len(call.at), self._models[0].nv, self._models[0].n_muscle
        self._forward(batch, call.ids, failed)
        force, tau, qacc = np.empty((b, n)), np.empty((b, nv)), np.empty((b, nv))
        activation, fiber = self._driven(rows)
        pulled = (
            call.at, self.muscles.kind, self.muscles.curves, call.p, activation, fiber, bound.actuator_length,
            bound.actuator_velocity, *bound.moment, bound.muscles, force, tau,
        )  # fmt: skip
        in_chunks(lambda first, last: pull(first, last, *pulled), b, self._threads if b >= _WORTH_THREADS else 1)
        if bound.nefc.any():
            held = bound.nefc[call.at] > 0
            again = call.at[held]
            state = rows[held, : self._n_state]
            state[:, self._applied] += tau[held]
            batch.state[again] = state
            self._forward(batch, again, failed)
        moved = call.at, tau, bound.M, *bound.M_index, bound.nefc, bound.qacc, qacc
        in_chunks(lambda first, last: accelerate(first, last, *moved), b, self._threads if b >= _WORTH_THREADS else 1)
        return Pull(force, tau, qacc)

    def _driven(self, rows: Array) -> tuple[Array, Array]:
        """Activation and fiber length of rows, in one layout however many: compiled code meets one kind."""
        return np.ascontiguousarray(rows[:, self.layout.activation]), np.ascontiguousarray(rows[:, self.layout.fiber])

    def _forward(self, batch: Batch, ids: Ids | None, failed: set[int], stage: int = _ALL) -> None:
        try:
            batch.forward(ids, stage)
        except SimulationError as error:
            copies = max(1, batch.nsim // self.count)
            self._faults.update({int(i) // copies: batch.error(int(i)) for i in error.ids})
            failed.update(int(i) // copies for i in error.ids)


def _same(a: CompiledCurves, b: CompiledCurves) -> bool:
    return a is b or all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def _stage(parts: tuple[Any, ...], first: int, last: int) -> None:
    advance_stage(first, last, *parts)


class _Call(NamedTuple):
    """Simulations of one call.

    Attributes:
        at: (b,) their rows in MuJoCo's batch.
        p: (b, n_muscle, 6) their muscles.
        ids: as `Batch` takes them: None for all.
    """

    at: Ids
    p: Array
    ids: Ids | None

    @classmethod
    def of(cls, plants: HillLockstep, ids: Ids, copies: int = 1) -> _Call:
        """Those simulations, so many times over."""
        whole = len(ids) == plants.count
        at = ids if copies == 1 else (copies * ids[:, None] + np.arange(copies)).ravel()
        p = plants.parameters if whole else plants.parameters[ids]
        return cls(at, p if copies == 1 else np.repeat(p, copies, axis=0), None if whole else at)

"""Looking at states of large models: all velocities a step on together, then all positions.

A muscle's force depends on velocities and positions through its own velocity and length, so that one state beside gives
the slopes of all.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from mjhcmc.dynamics import POSITION_STEP, VELOCITY_STEP
from mjhcmc.linearization import Array, Bound, Ids, Linearization
from mjhcmc.lockstep_kernels import put_beside, read_beside
from mjhcmc.model import MuscleModel, unclamped

if TYPE_CHECKING:
    from mjhcmc.lockstep import Lockstep

_OF_ACTUATORS = ("actuator_force", "actuator_length", "actuator_velocity", "ten_velocity", "ten_J")

FEW = 10
"""Degrees of freedom up to which each is moved by itself to see what forces do; in larger models see `Beside`."""


class Beside:
    """Looks at states of large models, by one step of all velocities and one of all positions together.

    Constraints are left out where they do not count, which takes less than half of the time.

    Args:
        plants: the simulations.
    """

    def __init__(self, plants: Lockstep) -> None:
        self._models = models = plants._models
        m = models[0].mj_model
        self._batch = Batch(_smooth(models[0]), 4 * len(models), plants._threads)
        if plants._differ:
            own = [_smooth(model) for model in models]
            self._batch.set_models([each for each in own for _ in range(4)])
        self._bound = Bound(self._batch, models[0], _OF_ACTUATORS)
        # a force that is clamped here is not beside: compare with what it would be
        self._clamped = bool(np.isfinite([model.force_limit for model in models]).any())
        self._here = Bound(plants._batches[1.0], models[0], (*_OF_ACTUATORS, "qacc", "M", "ncon"))
        rng = np.random.default_rng(0)
        self._way = rng.uniform(0.5, 1.0, m.nv) * rng.choice([-1.0, 1.0], m.nv)
        of_joint = m.dof_jntid
        scalar = np.isin(m.jnt_type, [int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)])
        self._stiff = np.where(scalar, m.jnt_stiffness, 0.0)[of_joint]
        self._tendons = np.flatnonzero(m.tendon_damping)

    def look(
        self, plants: Lockstep, ids: Ids, start: Array, *, stiffness: bool, damping: bool
    ) -> tuple[set[int], Linearization]:
        """Those that fail, and what forces do around states with all that acts; see `Plants.linearize`."""
        batch, here, beside, at = plants._batches[1.0], self._here, self._bound, plants.layout
        model, b = self._models[0], len(ids)
        m, nv, n = model.mj_model, model.nv, model.n_muscle
        batch.state[plants._where(ids)] = start
        failed = plants._call(batch, batch.forward, ids)
        qpos = np.empty((0, m.nq))
        if stiffness:
            step = np.broadcast_to(POSITION_STEP * self._way, (b, nv))
            qpos = np.ascontiguousarray(model.coordinates.moved(start[:, at.qpos], step))
        put_beside(
            self._batch.state, ids, start, plants._act, at.qpos.start, at.qvel.start, VELOCITY_STEP * self._way, qpos
        )
        rows = [0, 1, *([2] if stiffness else []), *([3] if self._clamped else [])]
        which = 4 * ids[:, None] + np.array(rows)
        try:
            self._batch.forward(np.ascontiguousarray(which.ravel()))
        except SimulationError as error:
            failed |= {int(i) // 4 for i in error.ids}
        force = beside.actuator_force[3::4] if self._clamped else here.actuator_force
        qacc, gain, bias = np.empty((b, nv)), np.empty((b, n)), np.empty((b, n))
        M, B, D = np.empty((b, nv, nv)), np.empty((b, nv, n)), np.empty((b, nv, nv))
        K = np.empty((b, nv, nv)) if stiffness else np.empty((0, 0, 0))
        read_beside(
            start, ids, plants._act, here.M, *here.M_index, *here.moment, here.muscles, force,
            here.actuator_length, here.actuator_velocity, beside.actuator_force, beside.actuator_length,
            beside.actuator_velocity, start[:, at.qvel], m.dof_damping, m.dof_dampingpoly, self._stiff, stiffness, qacc,
            here.qacc, M, B, gain, bias, D, K,
        )  # fmt: skip
        if damping:
            bias += np.array([here.fiber_damping(self._models[i], i) for i in ids])
        if self._tendons.size:
            D += self._of_tendons(m, here, ids)
        n_contact, slopes = here.ncon[ids], K if stiffness else None
        held = plants._held(start, n_contact)
        return failed, Linearization(qacc, M, B, gain, bias, D, slopes, held)

    def _of_tendons(self, m: Any, here: Bound, ids: Ids) -> Array:
        """(b, nv, nv) what the damping of tendons adds to D."""
        J = np.zeros((len(ids), m.ntendon, m.nv))
        for t in self._tendons:
            part = slice(m.ten_J_rowadr[t], m.ten_J_rowadr[t] + m.ten_J_rownnz[t])
            J[:, t, m.ten_J_colind[part]] = here.ten_J[ids][:, part]
        v = here.ten_velocity[ids]
        poly = m.tendon_dampingpoly
        d = m.tendon_damping + 2 * poly[:, 0] * np.abs(v) + 3 * poly[:, 1] * v**2
        found: Array = np.swapaxes(J, 1, 2) @ (d[:, :, None] * J)
        return found


def _smooth(model: MuscleModel) -> Any:
    """A copy of a compiled model without constraints, sensors and the forceranges of muscles."""
    smooth = copy.copy(unclamped(model.mj_model, model))
    off = mujoco.mjtDisableBit
    smooth.opt.disableflags |= int(off.mjDSBL_CONSTRAINT) | int(off.mjDSBL_SENSOR)
    return smooth

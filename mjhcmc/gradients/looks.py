"""What MuJoCo computes at many states of one model at once, and its slopes by central differences."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from mjhcmc.errors import SimulationError
from mjhcmc.linearization import Bound, as_slice, columns_of
from mjhcmc.lockstep_kernels import fill_nodes
from mjhcmc.model import MuscleModel, never_touches

Array = NDArray[np.float64]

STEP = 1e-6
"""rad, m, rad/s or m/s, and relative to a direction: truncation and rounding are then both near 1e-9 of a slope."""

_AT_ONCE = 4096  # states: bounds memory
_BOUND = ("qacc", "M", "actuator_length", "actuator_velocity", "ten_velocity", "nefc")


class Look(NamedTuple):
    """What is seen at k states.

    Attributes:
        qacc: (k, nv) rad/s^2 or m/s^2.
        M: (k, nv, nv) kg m^2.
        R: (k, n_muscle, nv) m, moment arms -dL/dq of the actuators' lengths.
        length: (k, n_muscle) m, of the actuators.
        velocity: (k, n_muscle) m/s.
        ten_velocity: (k, ntendon) m/s.
    """

    qacc: Array
    M: Array
    R: Array
    length: Array
    velocity: Array
    ten_velocity: Array


class States(NamedTuple):
    """k states and what acts there.

    Attributes:
        qpos: (k, nv).
        qvel: (k, nv).
        activation: (k, n_muscle).
        reserve: (k, nv) N m.
    """

    qpos: Array
    qvel: Array
    activation: Array
    reserve: Array


class Looker:
    """Looks at states of a model without constraints at work.

    Args:
        model: of hinges and slides.
        most: states that will be looked at at once, at most.
        threads: to look on.
    """

    def __init__(self, model: MuscleModel, most: int, threads: int = 1) -> None:
        self.model = model
        self._size = max(1, min(most, _AT_ONCE))
        self._own = self._ready(model.mj_model)
        self._batch = Batch(self._own, self._size, threads)
        self._bound = Bound(self._batch, model, _BOUND)
        batch = self._batch
        self._qpos, self._qvel = columns_of(batch, "qpos"), columns_of(batch, "qvel")
        self._act = as_slice((columns_of(batch, "act").start + model.act_index).astype(np.intp))
        self._applied = columns_of(batch, "qfrc_applied")

    @staticmethod
    def _ready(m: Any) -> Any:
        m = copy.copy(m)
        if never_touches(m):
            m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        return m

    @contextmanager
    def at(self, other: Any) -> Iterator[None]:
        """Look at another ``MjModel`` of the same structure meanwhile."""
        self._batch.set_models(self._ready(other))
        try:
            yield
        finally:
            self._batch.set_models(self._own)

    def look(self, states: States) -> Look:
        """See `Look`.

        Raises:
            SimulationError: a limit, contact or other constraint is at work at one of the states.
        """
        parts = [
            self._part(States(*(values[first : first + self._size] for values in states)))
            for first in range(0, len(states.qpos), self._size)
        ]
        return parts[0] if len(parts) == 1 else Look(*(np.concatenate(group) for group in zip(*parts, strict=True)))

    def _part(self, states: States) -> Look:
        batch, bound, k = self._batch, self._bound, len(states.qpos)
        rows = batch.state
        rows[:k, self._qpos], rows[:k, self._qvel] = states.qpos, states.qvel
        rows[:k, self._act], rows[:k, self._applied] = states.activation, states.reserve
        batch.forward(None if k == self._size else np.arange(k))
        if bound.nefc[:k].any():
            at = int(np.argmax(bound.nefc[:k].ravel() > 0))
            place = ", ".join(
                f"{name} {value:.4g}" for name, value in zip(self.model.joint_names, states.qpos[at], strict=True)
            )
            raise SimulationError(
                f"a limit, contact, friction or equality of model {self.model.name!r} is at work ({place}): a gradient "
                "needs a motion away from them"
            )
        model = self.model
        M, R = np.empty((k, model.nv, model.nv)), np.empty((k, model.n_muscle, model.nv))
        arm, rownnz, rowadr, colind = (part[:k] for part in bound.moment)
        fill_nodes(bound.M[:k], *bound.M_index, arm, rownnz, rowadr, colind, bound.muscles, M, R)
        length, velocity = bound.actuator_length[:k][:, bound.muscles], bound.actuator_velocity[:k][:, bound.muscles]
        return Look(bound.qacc[:k].copy(), M, R, length, velocity, bound.ten_velocity[:k].copy())

    def around(
        self, states: States, directions: Sequence[Mapping[str, Array]] = ()
    ) -> tuple[Look, list[tuple[Look, Look]], list[tuple[Look, Look]], list[tuple[Look, Look]]]:
        """What is seen at states, and a `STEP` to either side of each position, each velocity, along each direction.

        Args:
            states: where.
            directions: changes of the model's fields.
        """
        by_position, by_velocity, by_direction = [], [], []
        for j in range(self.model.nv):
            change = np.zeros(self.model.nv)
            change[j] = STEP
            by_position.append(
                (
                    self.look(states._replace(qpos=states.qpos + change)),
                    self.look(states._replace(qpos=states.qpos - change)),
                )
            )
            by_velocity.append(
                (
                    self.look(states._replace(qvel=states.qvel + change)),
                    self.look(states._replace(qvel=states.qvel - change)),
                )
            )
        for direction in directions:
            sides = []
            for step in (STEP, -STEP):
                with self.at(moved(self.model, direction, step)):
                    sides.append(self.look(states))
            by_direction.append((sides[0], sides[1]))
        return self.look(states), by_position, by_velocity, by_direction


def moved(model: MuscleModel, direction: Mapping[str, Array], step: float) -> Any:
    """The model's own ``MjModel`` with its fields moved along a direction."""
    m = copy.copy(model.mj_model)
    for name, change in direction.items():
        getattr(m, name)[:] += step * change
    mujoco.mj_setConst(m, mujoco.MjData(m))
    return m


def slope(sides: Sequence[tuple[Look, Look]], name: str) -> Array:
    """(k, ..., d) central differences of one of a `Look`'s arrays by d coordinates or directions."""
    found = [(getattr(up, name) - getattr(down, name)) / (2 * STEP) for up, down in sides]
    return np.stack(found, axis=-1) if found else np.empty((0,))

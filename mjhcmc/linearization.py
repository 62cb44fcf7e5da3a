"""What is seen of simulations in lock step: where in a row what stands, what forces do around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from mjhcmc.dynamics import fiber_damping
from mjhcmc.model import MuscleModel
from mjhcmc.plant import State

Array = NDArray[np.float64]
Ids = NDArray[np.intp]
Index = NDArray[np.intp] | slice

_MOMENTS = ("actuator_moment", "moment_rownnz", "moment_rowadr", "moment_colind")


@dataclass(frozen=True)
class Layout:
    """Where in a state row what stands.

    Attributes:
        time: column.
        qpos: columns, (nq).
        qvel: columns, (nv).
        activation: columns, (n_muscle).
        warmstart: columns, (nv).
        fiber: columns, (n_muscle) where tendons are compliant, else none.
    """

    time: int
    qpos: slice
    qvel: slice
    activation: Index
    warmstart: slice
    fiber: slice = field(default_factory=lambda: slice(0, 0))

    def state(self, row: Array) -> State:
        """A row as a `State`."""
        columns = (self.qpos, self.qvel, self.activation, self.warmstart, self.fiber)
        return State(float(row[self.time]), *(row[part].copy() for part in columns))


class Linearization(NamedTuple):
    """What forces do around one state of each simulation.

    Attributes:
        qacc: (b, nv) rad/s^2 or m/s^2, acceleration.
        M: (b, nv, nv) kg m^2, mass matrix.
        B: (b, nv, n_muscle) N m, joint moments at full activation, without bias.
        gain: (b, n_muscle) N, pulling positive, each muscle's actuator force at full activation, without its bias.
        bias: (b, n_muscle) N, its force at zero activation; with fiber damping where asked for.
        D: (b, nv, nv) N m s, -dF/dv of all smooth forces at fixed activation.
        K: (b, nv, nv) N m, -dF/dq likewise; None where it was not asked for.
        held: (b,) True where a joint is at its limit, or a contact is near.
        inertia: (b, nv, nv) kg m^2, M + s D_s of `integrators`; None: M.
        explicit: (b, nv, nv) N m s, what of D bounds the physics step, see `Scheme.explicit`; None: D.
    """

    qacc: Array
    M: Array
    B: Array
    gain: Array
    bias: Array
    D: Array
    K: Array | None
    held: NDArray[np.bool_]
    inertia: Array | None = None
    explicit: Array | None = None

    def of(self, which: NDArray[np.bool_]) -> Linearization:
        """That of some of the simulations."""
        return Linearization(*(None if part is None else part[which] for part in self))  # type: ignore[arg-type]


class Bound:
    """MuJoCo's derived quantities of a batch, (nsim, ...), by MuJoCo's names; up to date after each of its calls."""

    qacc: Array
    M: Array
    nefc: NDArray[np.int32]
    ncon: NDArray[np.int32]
    qfrc_smooth: Array
    qfrc_passive: Array
    qfrc_bias: Array
    qfrc_actuator: Array
    qfrc_applied: Array
    actuator_force: Array
    actuator_length: Array
    actuator_velocity: Array
    ten_velocity: Array
    ten_J: Array
    M_index: tuple[Any, Any, Any]
    moment: tuple[Any, Any, Any, Any]

    def __init__(self, batch: Batch, model: MuscleModel, names: Sequence[str]) -> None:
        m = model.mj_model
        self.muscles = m.actuator_outadr[model.muscle_ids].astype(np.intp)
        self.M_index = m.M_rownnz.copy(), m.M_rowadr.copy(), m.M_colind.copy()
        arm, rownnz, rowadr, colind = (batch.bind(name) for name in _MOMENTS)
        self.moment = arm, rownnz, rowadr, colind
        for name in names:
            setattr(self, name, batch.bind(name))

    def fiber_damping(self, model: MuscleModel, row: int) -> Array:
        """(n_muscle,) N of one row, see `dynamics.fiber_damping`."""
        at = SimpleNamespace(actuator_velocity=self.actuator_velocity[row], ten_velocity=self.ten_velocity[row])
        return fiber_damping(model, at)


def columns_of(batch: Batch, name: str) -> slice:
    """Where a field stands in the batch's state rows."""
    field, state = batch.bind(name), batch.state
    start = (field.__array_interface__["data"][0] - state.__array_interface__["data"][0]) // state.itemsize
    return slice(start, start + field[0].size)


def as_slice(columns: NDArray[np.intp]) -> Index:
    """The same columns as a slice where they are neighbours: quicker."""
    together = bool((np.diff(columns) == 1).all())
    return slice(int(columns[0]), int(columns[0]) + len(columns)) if together else columns.astype(np.intp)


def without(failed: set[int], ids: Ids, values: Array) -> Array:
    """The values, NaN for simulations that failed."""
    if failed:
        values[[int(i) in failed for i in ids]] = np.nan
    return values

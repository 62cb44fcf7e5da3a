"""Surroundings: what acts on a model from outside, and where what is prescribed has to be.

Prescribed degrees of freedom are made so heavy that nothing else matters to them, driven by the force that their
acceleration takes, and put back onto the motion at each physics step. What acts on the others is as if they were moved
by hand: the rest of the mass matrix is untouched.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjhcmc.joints import TIME_TOLERANCE
from mjhcmc.loads_kernel import push

if TYPE_CHECKING:
    from mjhcmc.external_loads import ExternalLoads
    from mjhcmc.model import MuscleModel

Array = NDArray[np.float64]
Ids = NDArray[np.intp]

HEAVY = 1e8
"""kg or kg m^2, added to a prescribed degree of freedom: 1000 N on it make 1e-5 m/s^2, undone at each physics step."""

External = Callable[[Array], Array]
"""Loads that act from outside, as generalized forces: times (n,) s to (n, nv) N m."""

Path = Callable[[Array], tuple[Array, Array, Array]]
"""Where a motion is: times (n,) s to positions (n, nq), velocities (n, nv) and accelerations (n, nv)."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What acts on a model from outside, and what moves its prescribed degrees of freedom.

    Attributes:
        external: generalized forces over time; None: none.
        loads: measured forces on bodies; None: none.
        path: the motion that prescribed degrees of freedom follow; None: there are none.
        grid: (n,) s, rising: times at which steps will begin; what happens from there on is found all at once.
    """

    external: External | None = None
    loads: ExternalLoads | None = None
    path: Path | None = None
    grid: Array | None = None

    @property
    def empty(self) -> bool:
        """Whether there is nothing."""
        return self.external is None and self.loads is None and self.path is None


def heavy(m: Any, prescribed: Ids) -> Any:
    """Make the prescribed degrees of freedom of a compiled model heavy, in place; returns it."""
    m.dof_armature[prescribed] += HEAVY
    return m


class Columns(NamedTuple):
    """Where in a state row what stands: time; positions, velocities, applied forces and forces on bodies begin."""

    time: int
    qpos: int
    qvel: int
    applied: int
    on_bodies: int


class Kinematics(NamedTuple):
    """MuJoCo's derived quantities, (nsim, nbody, 3), (nsim, nbody, 9) or (nsim, nbody, 6) each."""

    xpos: Array
    xmat: Array
    xipos: Array
    cvel: Array
    subtree_com: Array


class Plan(NamedTuple):
    """What goes into the rows of b simulations over n steps.

    Attributes:
        external: (b, n, nv) N m or N, generalized forces from outside in the middle of each step.
        force: (b, n, nv) N m or N, the same with what drives prescribed degrees of freedom.
        qpos: (b, n + 1, nqp) where prescribed coordinates are at each step's start, and at the last one's end.
        qvel: (b, n + 1, np) their velocities.
        loads: force, torque and point, (b, n, k, 3) each, in the middle of each step.
    """

    external: Array
    force: Array
    qpos: Array
    qvel: Array
    loads: tuple[Array, Array, Array]


class Outside:
    """Puts what acts from outside, and what is prescribed, into the state rows of simulations.

    Args:
        models: one a simulation, alike in all but numbers.
        surroundings: one a simulation.
        columns: of the state rows.
    """

    def __init__(self, models: Sequence[MuscleModel], surroundings: Sequence[Surroundings], columns: Columns) -> None:
        self._surroundings, self._columns = surroundings, columns
        first = models[0]
        m = first.mj_model
        self._nv, self._roots = int(m.nv), m.body_rootid.astype(np.int64)
        led = any(s.path is not None for s in surroundings)
        self._prescribed = first.roles.prescribed if led else np.empty(0, dtype=np.intp)
        self._coordinates = coordinates_of(m, self._prescribed)
        most = max((len(s.loads.body) for s in surroundings if s.loads is not None), default=0)
        self.on_bodies = most > 0
        self._ids = np.full((len(models), 3, most), -1, dtype=np.int64)
        for own, model, s in zip(self._ids, models, surroundings, strict=True):
            if s.loads is not None:
                own[:, : len(s.loads.body)] = s.loads.ids(model)
        self._most = most
        self._known: dict[tuple[int, float, int], Plan] = {}
        self._to = columns.qpos + self._coordinates, columns.qvel + self._prescribed

    def plan(self, ids: Ids, start: Array, step: float, n_step: int) -> Plan:
        """What the next steps of simulations take.

        Args:
            ids: (b,) the simulations.
            start: (b,) s.
            step: s; 0: look at the start alone.
            n_step: how many.
        """
        each = [self._of(int(i), t, step, n_step) for i, t in zip(ids, start, strict=True)]
        if len(each) == 1:
            return each[0]
        external, force, qpos, qvel = (np.concatenate(part) for part in zip(*(p[:4] for p in each), strict=True))
        push, turn, point = (np.concatenate(part) for part in zip(*(p.loads for p in each), strict=True))
        return Plan(external, force, qpos, qvel, (push, turn, point))

    def _of(self, i: int, start: float, step: float, n_step: int) -> Plan:
        """That of one simulation; of starts that are known beforehand all are found at once."""
        grid = self._surroundings[i].grid
        k = -1 if grid is None else min(int(np.searchsorted(grid, start - TIME_TOLERANCE)), len(grid) - 1)
        if grid is None or abs(grid[k] - start) > TIME_TOLERANCE:
            return self._found(i, np.array([start]), step, n_step)
        key = i, step, n_step
        if key not in self._known:
            self._known[key] = self._found(i, grid, step, n_step)
        found, at = self._known[key], slice(k, k + 1)
        external, force, qpos, qvel = (part[at] for part in found[:4])
        push, turn, point = (part[at] for part in found.loads)
        return Plan(external, force, qpos, qvel, (push, turn, point))

    def _found(self, i: int, start: Array, step: float, n_step: int) -> Plan:
        """That of one simulation from several times on."""
        own, b = self._surroundings[i], len(start)
        times = (start[:, None] + step * (np.arange(2 * n_step + 1) / 2)).ravel()
        middles = times.reshape(b, -1)[:, 1::2].ravel()
        external, force = np.zeros((b, n_step, self._nv)), np.zeros((b, n_step, self._nv))
        qpos = np.empty((b, n_step + 1, len(self._coordinates)))
        qvel = np.empty((b, n_step + 1, len(self._prescribed)))
        loads = tuple(np.zeros((b, n_step, self._most, 3)) for _ in range(3))
        if own.external is not None:
            external[:] = own.external(middles).reshape(external.shape)
        if own.path is not None and len(self._prescribed):
            q, v, a = (part.reshape(b, 2 * n_step + 1, -1) for part in own.path(times))
            qpos[:], qvel[:] = q[:, ::2, self._coordinates], v[:, ::2, self._prescribed]
            force[:, :, self._prescribed] = HEAVY * a[:, 1::2, self._prescribed]
        if own.loads is not None:
            # a look ahead may pass the end; that the loads cover the motion was checked
            within = np.clip(middles, own.loads.time[0], own.loads.time[-1])
            for part, values in zip(loads, own.loads.sample(within), strict=True):
                part[:, :, : values.shape[1]] = values.reshape(b, n_step, -1, 3)
        return Plan(external, external + force, qpos, qvel, loads)  # type: ignore[arg-type]

    def at_rest(self, plan: Plan) -> bool:
        """Whether nothing changes from step to step: what is prescribed stands still, and nothing else acts."""
        return not (self.on_bodies or plan.qvel.any() or plan.force.any())

    def lead(self, rows: Array, plan: Plan, j: int) -> None:
        """Put prescribed coordinates of rows (b, n_row) where they are at the start of step j."""
        if len(self._prescribed):
            rows[:, self._to[0]], rows[:, self._to[1]] = plan.qpos[:, j], plan.qvel[:, j]

    def push(self, ids: Ids, at: Ids, rows: Array, plan: Plan, j: int, ahead: float, seen: Kinematics) -> None:
        """Put the forces on bodies of step j into rows (b, n_row).

        The point of a load is where it was measured; the body that it acts on moves on to the middle of the step.

        Args:
            ids: (b,) the simulations.
            at: (b,) where they stand in what is seen.
            rows: (b, n_row), changed.
            plan: of the call.
            j: the step.
            ahead: s from what is seen to the middle of the step.
            seen: of all simulations.
        """
        force, torque, point = (np.ascontiguousarray(part[:, j]) for part in plan.loads)  # one layout: compiled once
        push(
            rows, self._columns.on_bodies, at, self._ids[ids], force, torque, point, ahead, self._roots, *seen
        )  # fmt: skip


def coordinates_of(m: Any, dofs: Ids) -> Ids:
    """(n,) positions in qpos of the joints of degrees of freedom."""
    found: list[int] = []
    for j in dict.fromkeys(m.dof_jntid[dofs].tolist()):
        last = int(m.jnt_qposadr[j + 1]) if j + 1 < m.njnt else int(m.nq)
        found.extend(range(int(m.jnt_qposadr[j]), last))
    return np.array(found, dtype=np.intp)

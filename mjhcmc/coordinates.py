"""Coordinates: positions and velocities of any joint type, and what is left when only tracked degrees of freedom count.

Positions are (nq,), with a quaternion for ball and free joints; differences of positions, velocities and forces are
(nv,). With N the tangent of the equalities (see `coupling`), z the tracked degrees of freedom and f the free ones, a
change of the accelerations of z moves the whole by W = N_z + N_f X, X = -(N_f' M N_f)^-1 N_f' M N_z, so that nothing
acts on f. Inertia, moments, damping and stiffness seen from z are W' M W, W' B, W' D W, W' K W.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.roles import Roles

Array = NDArray[np.float64]
Values = TypeVar("Values", bound=NDArray[Any])


class Coordinates:
    """Positions and degrees of freedom of a model, and which of them are tracked.

    Args:
        m: a ``mujoco.MjModel``.
        roles: of its degrees of freedom.
    """

    def __init__(self, m: Any, roles: Roles) -> None:
        self._m, self.roles, self.tracked = m, roles, roles.tracked
        self.nv, self.nz = int(m.nv), len(roles.tracked)
        self.all_tracked = roles.all_tracked
        self.flat = bool(m.nq == m.nv)  # no quaternions

    def of(self, values: Values) -> Values:
        """(..., nz) the tracked ones of (..., nv)."""
        return values if self.all_tracked else values[..., self.tracked]  # type: ignore[return-value]

    def full(self, values: Array) -> Array:
        """(..., nv) from the tracked ones (..., nz), 0 elsewhere."""
        if self.all_tracked:
            return values
        whole = np.zeros((*values.shape[:-1], self.nv))
        whole[..., self.tracked] = values
        return whole

    def difference(self, to: Array, start: Array) -> Array:
        """(..., nv) the way from positions to positions, (..., nq) each, along velocities over one second."""
        if self.flat:
            return to - start
        to, start = np.broadcast_arrays(to, start)
        way = np.empty((*to.shape[:-1], self.nv))
        for at in np.ndindex(to.shape[:-1]):
            mujoco.mj_differentiatePos(self._m, way[at], 1.0, np.ascontiguousarray(start[at]), to[at].copy())
        return way

    def moved(self, qpos: Array, way: Array) -> Array:
        """(..., nq) positions after a way (..., nv)."""
        if self.flat:
            return qpos + way
        found = np.array(qpos)
        for at in np.ndindex(found.shape[:-1]):
            row = found[at].copy()
            mujoco.mj_integratePos(self._m, row, np.ascontiguousarray(way[at]), 1.0)
            found[at] = row
        return found

    @cached_property
    def simple(self) -> bool:
        """Whether W only picks the tracked degrees of freedom."""
        return not len(self.roles.dependent) and not len(self.roles.free)

    def seen_from_tracked(self, N: Array | None, M: Array) -> Array:
        """W (nv, nz), see the module's docstring.

        Args:
            N: (nv, nv) tangent of the equalities; None: there are none.
            M: (nv, nv) mass matrix.
        """
        W: Array = np.eye(self.nv)[:, self.tracked] if N is None else N[:, self.tracked]
        free = self.roles.free
        if len(free):
            Nf: Array = np.eye(self.nv)[:, free] if N is None else N[:, free]
            W = W - Nf @ np.linalg.solve(Nf.T @ M @ Nf, Nf.T @ M @ W)
        return W

"""Coupling: what equality constraints make of the other degrees of freedom, in position and in velocity."""

from __future__ import annotations

import copy
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError
from mjhcmc.roles import Roles, equality_jacobian

_HARD = 0.99  # impedance; MuJoCo's default of .9 lets a tenth of the acceleration through
_MOST_TURNS = 50
_MET = 1e-11  # rad or m
_NO_SOLUTION = 1e-6  # rad or m: what may be left of equalities that contradict each other

Array = NDArray[np.float64]


class Coupling:
    """The active equalities of a model, as functions of its independent degrees of freedom.

    With J the equalities' Jacobian and D, I the dependent and the independent degrees of freedom, velocities that keep
    to the equalities are v = N v_I, N_I = 1, N_D = -J_D^-1 J_I (least squares where equalities repeat each other).

    Args:
        m: a ``mujoco.MjModel``.
        roles: of its degrees of freedom.

    Attributes:
        soft: whether an equality has an impedance (solimp) so low that what hangs on it lags.
    """

    def __init__(self, m: Any, roles: Roles) -> None:
        self._m = copy.copy(m)
        off = mujoco.mjtDisableBit
        self._m.opt.disableflags |= int(off.mjDSBL_CONTACT) | int(off.mjDSBL_LIMIT) | int(off.mjDSBL_FRICTIONLOSS)
        self._m.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self._d = mujoco.MjData(self._m)
        self._dependent = roles.dependent
        self._independent = np.setdiff1d(np.arange(m.nv), roles.dependent).astype(np.intp)
        self._polynomials = _polynomials(m)
        active = np.flatnonzero(m.eq_active0)
        self.soft = bool((m.eq_solimp[active, :2] < _HARD).any())

    def tangent(self, qpos: Array) -> Array:
        """N (..., nv, nv) at positions (..., nq): columns of dependent degrees of freedom are 0, see the class."""
        rows = qpos.reshape(-1, qpos.shape[-1])
        if self._polynomials is None:
            N = np.stack([self._tangent_of_rows(row) for row in rows])
        else:
            N = np.zeros((len(rows), self._m.nv, self._m.nv))
            N[:, self._independent, self._independent] = 1.0
            for tie in self._polynomials:
                N[:, tie.dof] = tie.slope(rows)[:, None] * N[:, tie.of_dof] if tie.of_dof >= 0 else 0.0
        return N.reshape(*qpos.shape[:-1], self._m.nv, self._m.nv)

    def project(self, qpos: Array) -> Array:
        """Positions (..., nq) with the dependent degrees of freedom where the equalities put them.

        Raises:
            MotionError: there is no such position near.
        """
        rows = qpos.reshape(-1, qpos.shape[-1]).copy()
        if self._polynomials is None:
            rows = np.stack([self._project_row(row) for row in rows])
        else:
            for tie in self._polynomials:
                rows[:, tie.at] = tie.value(rows)
        return rows.reshape(qpos.shape)

    def _rows(self, qpos: Array) -> tuple[Array, Array]:
        """Jacobian (ne, nv) and violation (ne,) at a position."""
        m, d = self._m, self._d
        d.qpos[:] = qpos
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_tendon(m, d)
        mujoco.mj_makeConstraint(m, d)
        J = equality_jacobian(m, d)
        return J, np.array(d.efc_pos[: len(J)])

    def _tangent_of_rows(self, qpos: Array) -> Array:
        J, _ = self._rows(qpos)
        D, I = self._dependent, self._independent  # noqa: E741 - the equation's
        N = np.zeros((self._m.nv, self._m.nv))
        N[I, I] = 1.0
        N[np.ix_(D, I)] = -np.linalg.lstsq(J[:, D], J[:, I], rcond=None)[0]
        return N

    def _project_row(self, qpos: Array) -> Array:
        found = qpos.copy()
        left = np.inf
        for _ in range(_MOST_TURNS):
            J, violation = self._rows(found)
            left = float(np.abs(violation).max(initial=0.0))
            if left <= _MET:
                return found
            step = np.zeros(self._m.nv)
            step[self._dependent] = -np.linalg.lstsq(J[:, self._dependent], violation, rcond=None)[0]
            mujoco.mj_integratePos(self._m, found, step, 1.0)
            if np.abs(step).max() <= _MET:
                break
        if left > _NO_SOLUTION:
            raise MotionError(
                f"the equality constraints cannot be met at this position (they miss by {left:.3g}): change the "
                "motion, or the constraints where they contradict each other"
            )
        return found


class _Tie:
    """A joint equality: y - y0 = c0 + c1 (x - x0) + ... + c4 (x - x0)^4, y0 and x0 at the reference pose."""

    def __init__(self, m: Any, e: int) -> None:
        y, x = int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
        self.joint, self.of_joint = y, x
        self.dof, self.of_dof = int(m.jnt_dofadr[y]), int(m.jnt_dofadr[x]) if x >= 0 else -1
        self.at, self._from = int(m.jnt_qposadr[y]), int(m.jnt_qposadr[x]) if x >= 0 else -1
        self._y0, self._x0 = float(m.qpos0[self.at]), float(m.qpos0[self._from]) if x >= 0 else 0.0
        self._c = np.array(m.eq_data[e, :5])

    def _x(self, rows: Array) -> Array:
        return rows[:, self._from] - self._x0 if self._from >= 0 else np.zeros(len(rows))

    def value(self, rows: Array) -> Array:
        """(n,) where it puts y."""
        return np.asarray(self._y0 + np.polynomial.polynomial.polyval(self._x(rows), self._c))

    def slope(self, rows: Array) -> Array:
        """(n,) dy/dx."""
        return np.asarray(np.polynomial.polynomial.polyval(self._x(rows), self._c[1:] * np.arange(1, 5)))


def _polynomials(m: Any) -> list[_Tie] | None:
    """The equalities, each after the one that it follows; None where they are not all polynomials of hinges and slides.

    Two for one joint, or a ring of joints that follow each other, are no functions either.
    """
    flat = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
    active = np.flatnonzero(m.eq_active0)
    if (m.eq_type[active] != int(mujoco.mjtEq.mjEQ_JOINT)).any():
        return None
    ties = [_Tie(m, int(e)) for e in active]
    by_joint = {tie.joint: tie for tie in ties}
    if len(by_joint) < len(ties):
        return None
    if any(int(m.jnt_type[j]) not in flat for tie in ties for j in (tie.joint, tie.of_joint) if j >= 0):
        return None
    ordered: list[_Tie] = []
    placed = {-1, *(j for j in range(m.njnt) if j not in by_joint)}
    while len(ordered) < len(ties):
        ready = [tie for tie in ties if tie.joint not in placed and tie.of_joint in placed]
        if not ready:
            return None
        ordered += ready
        placed |= {tie.joint for tie in ready}
    return ordered

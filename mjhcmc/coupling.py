"""Coupling: what equality constraints make of the other degrees of freedom, in position and in velocity."""

from __future__ import annotations

import copy
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError
from mjhcmc.roles import Roles, equality_jacobian

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
    """

    def __init__(self, m: Any, roles: Roles) -> None:
        self._m = copy.copy(m)
        off = mujoco.mjtDisableBit
        self._m.opt.disableflags |= int(off.mjDSBL_CONTACT) | int(off.mjDSBL_LIMIT) | int(off.mjDSBL_FRICTIONLOSS)
        self._m.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self._d = mujoco.MjData(self._m)
        self._dependent = roles.dependent
        self._independent = np.setdiff1d(np.arange(m.nv), roles.dependent).astype(np.intp)

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

    def tangent(self, qpos: Array) -> Array:
        """N (nv, nv) at a position (nq,): columns of dependent degrees of freedom are 0, see the class."""
        J, _ = self._rows(qpos)
        D, I = self._dependent, self._independent  # noqa: E741 - the equation's
        N = np.zeros((self._m.nv, self._m.nv))
        N[I, I] = 1.0
        N[np.ix_(D, I)] = -np.linalg.lstsq(J[:, D], J[:, I], rcond=None)[0]
        return N

    def project(self, qpos: Array) -> Array:
        """The position (nq,) with the dependent degrees of freedom where the equalities put them.

        Raises:
            MotionError: there is no such position near.
        """
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
                f"the equality constraints cannot be met at this position (they miss by {left:.3g}): change the motion, "
                "or the constraints where they contradict each other"
            )
        return found

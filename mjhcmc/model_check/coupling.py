"""Joint equalities: joints that follow another by a polynomial."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray


class JointCoupling:
    """The active joint equalities of a compiled model between hinges and slides.

    MuJoCo's equality ties y - y0 = c0 + c1 (x - x0) + ... + c4 (x - x0)^4 for a dependent joint y and a joint x, with
    y0 and x0 at the reference pose; one without x holds y at y0 + c0.

    Args:
        m: a ``mujoco.MjModel``.

    Attributes:
        follows: the joint x that each dependent joint follows, by index; -1 where it is held.
        coefficients: (5,) c0 to c4 of each.
        free_dofs: indices of the degrees of freedom that follow nothing.
        others: active equalities of other kinds, which are not represented.
    """

    def __init__(self, m: Any) -> None:
        self.follows: dict[int, int] = {}
        self.others = 0
        self.coefficients: dict[int, list[float]] = {}
        self._qpos0 = m.qpos0.copy()
        self._qpos_index, self._dof = m.jnt_qposadr.copy(), m.jnt_dofadr.copy()
        self._nv = int(m.nv)
        scalar = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
        for e in np.flatnonzero(m.eq_active0):
            y, x = int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
            is_joint = m.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT
            if is_joint and all(int(m.jnt_type[j]) in scalar for j in (y, x) if j >= 0) and self._is_new(y, x):
                self.follows[y] = x
                self.coefficients[y] = m.eq_data[e, :5].tolist()
            else:
                self.others += 1
        self.free_dofs = np.setdiff1d(np.arange(self._nv), self._dof[list(self.follows)]).astype(np.intp)
        self._order = sorted(self.follows, key=self._depth)  # each after the one that it follows

    def _is_new(self, y: int, x: int) -> bool:
        """Whether y may follow x: it follows nothing yet, and x does not follow y in turn."""
        while x >= 0:
            if x == y:
                return False
            x = self.follows.get(x, -1)
        return y not in self.follows

    def fill(self, qpos: NDArray[np.float64]) -> NDArray[np.float64]:
        """qpos (nq,) with the dependent joints where the others put them."""
        filled = qpos.copy()
        for y in self._order:
            at = self._qpos_index[y]
            filled[at] = self._qpos0[at] + _polynomial(self.coefficients[y], self._offset(y, filled))
        return filled

    def reduce(self, qpos: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
        """N^T values at a filled qpos: what acts on a dependent joint acts on the one that it follows.

        Args:
            qpos: (nq,) rad or m.
            values: (nv, ...) forces, or anything else dual to velocities.

        Returns:
            (nv, ...), zero at dependent joints; N (nv, nv) is dqvel/dqvel_free.
        """
        result = values.copy()
        for y in reversed(self._order):
            row, x = self._dof[y], self.follows[y]
            if x >= 0:
                slope = [k * c for k, c in enumerate(self.coefficients[y])][1:]
                result[self._dof[x]] += _polynomial(slope, self._offset(y, qpos)) * result[row]
            result[row] = 0.0
        return result

    def _offset(self, y: int, qpos: NDArray[np.float64]) -> float:
        x = self.follows[y]
        if x < 0:
            return 0.0
        at = self._qpos_index[x]
        return float(qpos[at] - self._qpos0[at])

    def _depth(self, y: int) -> int:
        x = self.follows[y]
        return 0 if x not in self.follows else 1 + self._depth(x)


def _polynomial(coefficients: Sequence[float], x: float) -> float:
    """c0 + c1 x + ..., by Horner's rule; NumPy's own takes many times as long for one number."""
    value = 0.0
    for c in reversed(coefficients):
        value = value * x + c
    return value

"""Ties: what the equality constraints of a model leave free, for scanning it."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError
from mjhcmc.model import MuscleModel
from mjhcmc.model_check.coupling import JointCoupling
from mjhcmc.model_check.report import EqualityReport

Array = NDArray[np.float64]


class Ties:
    """Positions that keep to a model's equality constraints, and forces seen from what they leave free.

    Where only joints are tied, by polynomials, these are evaluated; else the constraints are solved for, see
    `mjhcmc.coupling.Coupling`.

    Args:
        model: the model.

    Attributes:
        joints: those that follow another by a polynomial.
        free_dofs: indices of the degrees of freedom that no constraint ties to others.
    """

    def __init__(self, model: MuscleModel) -> None:
        m = model.mj_model
        self.joints = JointCoupling(m)
        self.free_dofs = np.setdiff1d(np.arange(m.nv), model.roles.dependent).astype(np.intp)
        polynomials_do = not self.joints.others and np.array_equal(self.free_dofs, self.joints.free_dofs)
        self._general = None if polynomials_do else model.coupling
        self._m, self._tied = m, model.roles.dependent

    def fill(self, qpos: Array) -> Array | None:
        """qpos (nq,) with what is tied where the constraints put it; None where they cannot be met from there."""
        if self._general is None:
            return self.joints.fill(qpos)
        try:
            return self._general.project(qpos)
        except MotionError:
            return None

    def missed(self, qpos: Array) -> float:
        """Rad or m, by which a pose misses the constraints."""
        m = self._m
        d = mujoco.MjData(m)
        d.qpos[:] = qpos
        mujoco.mj_fwdPosition(m, d)
        return float(np.abs(d.efc_pos[d.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]).max(initial=0.0))

    def reduce(self, qpos: Array, values: Array) -> Array:
        """N^T values at a filled qpos, N = dqvel/dqvel_free: what acts on something tied acts on what it follows.

        Args:
            qpos: (nq,) rad or m.
            values: (nv, ...) forces, or anything else dual to velocities.

        Returns:
            (nv, ...), zero where tied.
        """
        if self._general is None:
            return self.joints.reduce(qpos, values)
        result = values.copy()
        N = self._general.tangent(qpos)[np.ix_(self._tied, self.free_dofs)]
        result[self.free_dofs] += N.T @ values[self._tied]
        result[self._tied] = 0.0
        return result

    def reduce_matrix(self, qpos: Array, matrix: Array) -> Array:
        """N^T matrix N of a (nv, nv) matrix, rows and columns of `free_dofs` alone."""
        reduced = self.reduce(qpos, self.reduce(qpos, matrix).T).T
        return np.asarray(reduced[np.ix_(self.free_dofs, self.free_dofs)])


def equalities(model: MuscleModel) -> tuple[EqualityReport, ...]:
    """The active equality constraints of a model."""
    m, kinds = model.mj_model, mujoco.mjtEq
    of = {
        int(kinds.mjEQ_JOINT): mujoco.mjtObj.mjOBJ_JOINT,
        int(kinds.mjEQ_TENDON): mujoco.mjtObj.mjOBJ_TENDON,
        int(kinds.mjEQ_CONNECT): mujoco.mjtObj.mjOBJ_BODY,
        int(kinds.mjEQ_WELD): mujoco.mjtObj.mjOBJ_BODY,
    }
    found = []
    for e in np.flatnonzero(m.eq_active0):
        kind = str(kinds(m.eq_type[e]).name.removeprefix("mjEQ_").lower())
        obj = of.get(int(m.eq_type[e]))
        if obj is not None and m.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            obj = mujoco.mjtObj.mjOBJ_SITE
        ids = [int(i) for i in (m.eq_obj1id[e], m.eq_obj2id[e]) if i >= 0]
        word = "" if obj is None else str(obj.name.removeprefix("mjOBJ_").lower())
        ends = tuple((mujoco.mj_id2name(m, obj, i) if obj is not None else None) or f"{word}{i}" for i in ids)
        name = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_EQUALITY, int(e)) or f"equality{e}"
        found.append(EqualityReport(name, kind, ends))
    return tuple(found)

"""Constraints that hold a model: what active limits and contacts add to its inertia, damping and stiffness.

MuJoCo's constraints are soft: an active row gives f = -D (J qacc - aref), aref = -b J v - k d r, with impedance d and
violation r. The joints therefore answer to forces as if M were M + J'DJ, with damping J'DbJ and stiffness J'DkdJ more.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def add_held(m: Any, d: Any, M: Array, D: Array, K: Array | None) -> None:
    """Add what active constraints do, equalities aside, at the data's last ``mj_forward``.

    Args:
        m: a ``mujoco.MjModel``.
        d: its data.
        M: (nv, nv) kg m^2, changed; so are the others.
        D: (nv, nv) N m s.
        K: (nv, nv) N m; None: not asked for.
    """
    active = np.flatnonzero(d.efc_state == mujoco.mjtConstraintState.mjCNSTRSTATE_QUADRATIC)
    active = active[active >= d.ne]
    if not active.size:
        return
    J = np.zeros((d.nefc, m.nv))
    if mujoco.mj_isSparse(m):
        mujoco.mju_sparse2dense(J, d.efc_J, d.efc_J_rownnz, d.efc_J_rowadr, d.efc_J_colind)
    else:
        J[:] = np.asarray(d.efc_J)[: J.size].reshape(J.shape)  # its memory may be longer
    J, weight, kbip = J[active], d.efc_D[active, None], np.asarray(d.efc_KBIP).reshape(-1, 4)[active]
    M += J.T @ (weight * J)
    D += J.T @ (weight * kbip[:, [1]] * J)
    if K is not None:
        K += J.T @ (weight * kbip[:, [0]] * kbip[:, [2]] * J)

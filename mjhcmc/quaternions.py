"""Quaternions in rows of positions: of unit length, without jumps of sign, and what they turn by."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError

Array = NDArray[np.float64]

_NO_LENGTH = 1e-6
_UNIT = 0.05  # how far from unit length a measured quaternion may be


def unit_quaternions(name: str, time: Array, qpos: Array, starts: Sequence[int]) -> Array:
    """(T, nq) the rows with quaternions of unit length, each on the side of the one before.

    Args:
        name: of the motion, for messages.
        time: (T,) s.
        qpos: (T, nq).
        starts: columns in which quaternions begin.

    Raises:
        MotionError: a quaternion that is far from unit length.
    """
    found = qpos.copy()
    for first in starts:
        part = found[:, first : first + 4]
        length = np.linalg.norm(part, axis=1)
        bad = np.flatnonzero(np.abs(length - 1) > _UNIT)
        if bad.size:
            raise MotionError(
                f"{name}: the quaternion in columns {first}..{first + 3} of qpos has length {length[bad[0]]:.4g} at "
                f"{time[bad[0]]:.6g} s: give unit quaternions (w, x, y, z)"
            )
        part /= length[:, None]
        flips = np.cumprod(np.where((part[1:] * part[:-1]).sum(axis=1) < 0, -1.0, 1.0))
        part[1:] *= flips[:, None]
    found.setflags(write=False)
    return found


def turning(q: Array, rate: Array, second: Array, starts: Sequence[int]) -> tuple[Array, Array, Array]:
    """Positions (n, nq), velocities and accelerations (n, nv) from rows (n, nq) and their derivatives.

    With Q the quaternion as splined, of any length: angular velocity 2 vec(Q^-1 Q'), angular acceleration
    2 vec(Q^-1 Q'' - (Q^-1 Q')^2), both in the body's axes.

    Args:
        q: (n, nq).
        rate: (n, nq) first derivatives.
        second: (n, nq) second derivatives.
        starts: columns in which quaternions begin, rising.
    """
    qpos, v, a = q.copy(), [], []
    before = 0
    for first in starts:
        Q, R, S = (part[:, first : first + 4] for part in (q, rate, second))
        inverse = Q * [1.0, -1.0, -1.0, -1.0] / (Q**2).sum(axis=1, keepdims=True)
        turn = _product(inverse, R)
        v += [rate[:, before:first], 2 * turn[:, 1:]]
        a += [second[:, before:first], 2 * (_product(inverse, S) - _product(turn, turn))[:, 1:]]
        qpos[:, first : first + 4] = Q / np.linalg.norm(Q, axis=1, keepdims=True)
        before = first + 4
    return qpos, np.hstack([*v, rate[:, before:]]), np.hstack([*a, second[:, before:]])


def _product(p: Array, q: Array) -> Array:
    """(n, 4) Hamilton's product."""
    w = p[:, :1] * q[:, :1] - (p[:, 1:] * q[:, 1:]).sum(axis=1, keepdims=True)
    return np.hstack([w, p[:, :1] * q[:, 1:] + q[:, :1] * p[:, 1:] + np.cross(p[:, 1:], q[:, 1:])])

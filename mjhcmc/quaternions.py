"""Quaternions in rows of positions: of unit length, without jumps of sign, and what they turn by."""

from collections.abc import Sequence

import numba
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
    nv = q.shape[1] - len(starts)
    rate, second = np.ascontiguousarray(rate), np.ascontiguousarray(second)  # one layout: compiled once
    qpos, v, a = np.array(q, order="C"), np.empty((len(q), nv)), np.empty((len(q), nv))
    at = before = 0
    for first in [*starts, q.shape[1]]:
        n = first - before
        v[:, at : at + n], a[:, at : at + n] = rate[:, before:first], second[:, before:first]
        at += n
        if first < q.shape[1]:
            _turn(qpos, rate, second, first, v, a, at)
            at += 3
        before = first + 4
    return qpos, v, a


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _turn(q, rate, second, first, v, a, at):  # type: ignore[no-untyped-def]
    """Fill angular velocity and acceleration from column ``at`` on; make q's quaternion at ``first`` unit length."""
    turn, half = np.empty(4), np.empty(4)
    for k in range(q.shape[0]):
        Q = q[k, first : first + 4]
        size = Q[0] ** 2 + Q[1] ** 2 + Q[2] ** 2 + Q[3] ** 2
        _divide(Q, rate[k, first : first + 4], size, turn)
        _divide(Q, second[k, first : first + 4], size, half)
        for i in range(3):
            v[k, at + i] = 2.0 * turn[i + 1]
            a[k, at + i] = 2.0 * (half[i + 1] - 2.0 * turn[0] * turn[i + 1])  # vec of turn turn is 2 w vec
        for i in range(4):
            q[k, first + i] /= np.sqrt(size)


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def _divide(Q, x, size, out):  # type: ignore[no-untyped-def]
    """Fill out with Q^-1 x, size being |Q|^2."""
    w, a, b, c = Q[0] / size, -Q[1] / size, -Q[2] / size, -Q[3] / size
    out[0] = w * x[0] - a * x[1] - b * x[2] - c * x[3]
    out[1] = w * x[1] + a * x[0] + b * x[3] - c * x[2]
    out[2] = w * x[2] + b * x[0] + c * x[1] - a * x[3]
    out[3] = w * x[3] + c * x[0] + a * x[2] - b * x[1]

"""Where a window of HCMC should end, and with what gains; see `HcmcDriver`."""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np
from numpy.typing import NDArray

from mjhcmc.small_linear import solve_in_place

Array = NDArray[np.float64]


def floors_of(imposed: Sequence[Array | None], n: int, least: Array) -> Array | None:
    """(n, b, n_muscle) least excitation of each window, where anything is imposed on any simulation."""
    if all(one is None for one in imposed):
        return None
    found = np.repeat(least[None], n, axis=0)
    for i, one in enumerate(imposed):
        if one is not None:
            found[: len(one), i] = np.maximum(found[: len(one), i], one)
    return found


@numba.njit(cache=True, error_model="numpy", nogil=True)
def fill_aim(  # type: ignore[no-untyped-def]
    M, B, error, qvel, next_error, next_qvel, next_qacc, v_now, at_start, least, authority, gain, h, lag, kp, kv, goal,
    way, speed,
):  # fmt: skip
    """Fill kp, kv and goal (b, nz), and the way and the velocity (b, nz) at which the window should end.

    error and next_error are the desired positions now and at the window's end, less the position now; lag is r of
    `integrators`, 0 under RK4.
    """
    begin, end = 1.0 + lag, 1.0 - lag
    begin_way, end_way = 1.0 + lag * (1.5 + lag / 2), 1.0 - lag * lag
    b, nv, n = B.shape
    used, reach = np.empty((nv, nv)), np.empty((nv, n))
    for s in range(b):
        for j in range(nv):
            for i in range(nv):
                used[j, i] = M[s, j, i]
            for i in range(n):
                reach[j, i] = B[s, j, i]
        solve_in_place(used, reach)
        for j in range(nv):
            up, down = 0.0, 0.0
            for i in range(n):
                up += max(reach[j, i], 0.0)
                down += max(-reach[j, i], 0.0)
            alpha = max(authority * min(up, down), least[s, j])
            v, a = v_now[s, j], at_start[s, j]
            e, e_rate = abs(error[s, j]), abs(qvel[s, j] - v)
            denominator = e_rate + np.sqrt(e_rate * e_rate + alpha * e)
            w = gain[s] / h
            damped = 1.0 - gain[s] / 6.0
            if denominator > 0.0 and alpha > 0.0 and alpha / denominator < w:
                w, damped = alpha / denominator, 1.0
            kp[s, j] = w * w
            kv[s, j] = 2.0 * w * damped
            as_rk4 = 1.0 + lag * (kv[s, j] * h / 2) + lag * lag * (kp[s, j] * h * h / 6)
            kp[s, j] /= as_rk4
            kv[s, j] /= as_rk4
            v_error = next_qvel[s, j] - v - h / 2 * begin * a
            q_error = next_error[s, j] - h * v - h * h / 3 * begin_way * a
            c = 1.0 + kv[s, j] * h / 2 * end + kp[s, j] * h * h / 6 * end_way
            goal[s, j] = (next_qacc[s, j] + kv[s, j] * v_error + kp[s, j] * q_error) / c
            speed[s, j] = v + h / 2 * (begin * a + end * goal[s, j])
            way[s, j] = h * v + h * h / 3 * begin_way * a + h * h / 6 * end_way * goal[s, j]

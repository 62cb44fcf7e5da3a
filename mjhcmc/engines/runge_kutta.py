"""The classical fourth-order Runge-Kutta method, for engines that have no integrator of their own."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mjhcmc.engines.base import Array


def rk4(
    acceleration: Callable[[Array, Array, Array], Array], q: Array, v: Array, torques: Array, step: float, count: int
) -> Array:
    """Angles at the nodes, (N + 1, nv), rad.

    Args:
        acceleration: (nv,) rad/s^2 of angles, velocities and torques (nv,).
        q: (nv,) rad, at the start.
        v: (nv,) rad/s, at the start.
        torques: (N, nv) N m, each held over a window.
        step: s.
        count: of steps in a window.
    """
    q, v = np.array(q, float), np.array(v, float)
    nodes = [q.copy()]
    for torque in torques:
        for _ in range(count):
            a1 = acceleration(q, v, torque)
            v2 = v + step / 2 * a1
            a2 = acceleration(q + step / 2 * v, v2, torque)
            v3 = v + step / 2 * a2
            a3 = acceleration(q + step / 2 * v2, v3, torque)
            v4 = v + step * a3
            a4 = acceleration(q + step * v3, v4, torque)
            q = q + step / 6 * (v + 2 * v2 + 2 * v3 + v4)
            v = v + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        nodes.append(q.copy())
    return np.array(nodes)

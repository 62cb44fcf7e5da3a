"""Fiber length of muscles with compliant tendons along a given movement: the fiber's equation of motion, implicitly.

The damped fiber is stiff and the movement is known beforehand, so all steps are solved together: Hermite-Simpson
collocation (Lobatto IIIA, order 4, A-stable) of dl/dt = v(a, l, lMT), by Newton's method. Its matrix is bidiagonal.

Reference: E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", Springer 1996, section IV.5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mjhcmc import hill
from mjhcmc.errors import SimulationError

Array = NDArray[np.float64]

_ITERATIONS = 60
_CLOSE = 1e-11  # optimal fiber lengths
_NUDGE = 1e-6  # optimal fiber lengths, for slopes
_LARGEST = 0.1  # optimal fiber lengths that an iteration may change a fiber by


def compliant_motion(
    model: hill.HillModel, time: Array, activation: Array, length: Array, velocity: Array
) -> hill.MuscleState:
    """Fibers and tendon forces along a movement, from the static equilibrium at its start.

    Args:
        model: m muscles with tendons.
        time: (n,) s, n odd: a step goes from each second time to the next, by the one between.
        activation: (n, m).
        length: (n, m) m, musculotendon length.
        velocity: (n, m) m/s.

    Returns:
        The state (n, m).

    Raises:
        HillError: No equilibrium at the start, or a movement that leaves the fibers no length.
        SimulationError: Newton's method does not settle.
    """
    h = (time[2::2] - time[:-2:2])[:, None]
    lopt = model.muscles.optimal_fiber_length
    width = model.muscles.fiber_width
    # The first row stays; the others are a first guess that exists at any velocity.
    fiber = hill.static_equilibrium(model, activation[::2], length[::2]).fiber_length.copy()
    shortest = np.maximum(0.01 * lopt, width * (1 + 1e-6))

    def within(l: Array, whole: Array) -> Array:  # noqa: E741
        longest = np.hypot(0.999 * whole, width)
        return np.clip(l, shortest, longest)

    def rate(l: Array, part: slice) -> tuple[Array, Array]:  # noqa: E741
        v = hill.fiber_velocity(model, activation[part], l, length[part])
        nudged = hill.fiber_velocity(model, activation[part], l - _NUDGE * lopt, length[part])
        return v, (v - nudged) / (_NUDGE * lopt)

    nodes, middles = slice(None, None, 2), slice(1, None, 2)
    for _ in range(_ITERATIONS):
        v, slope = rate(fiber, nodes)
        middle = within(0.5 * (fiber[:-1] + fiber[1:]) + h / 8 * (v[:-1] - v[1:]), length[middles])
        between, bend = rate(middle, middles)
        residual = fiber[1:] - fiber[:-1] - h / 6 * (v[:-1] + 4 * between + v[1:])
        before = -1 - h / 6 * (slope[:-1] + 4 * bend * (0.5 + h / 8 * slope[:-1]))
        after = 1 - h / 6 * (slope[1:] + 4 * bend * (0.5 - h / 8 * slope[1:]))
        change = np.zeros_like(fiber)
        for k in range(len(h)):
            change[k + 1] = -(residual[k] + before[k] * change[k]) / after[k]
        largest = np.abs(change / lopt).max()
        if not np.isfinite(largest):
            break
        fiber = within(fiber + change * min(1.0, _LARGEST / max(largest, 1e-300)), length[nodes])
        if largest < _CLOSE:
            v, _ = rate(fiber, nodes)
            whole = np.empty_like(length)
            whole[nodes] = fiber
            whole[middles] = 0.5 * (fiber[:-1] + fiber[1:]) + h / 8 * (v[:-1] - v[1:])
            return hill.fiber_dynamics(model, activation, whole, length, velocity)
    worst = np.unravel_index(int(np.argmax(np.abs(np.nan_to_num(change / lopt, nan=np.inf)))), change.shape)
    raise SimulationError(
        f"{model.muscles.names[worst[1]]} at {time[2 * worst[0]]:.4f} s: the fiber's motion does not settle: "
        "give a smaller step"
    )

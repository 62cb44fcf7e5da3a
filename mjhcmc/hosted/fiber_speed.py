"""Fiber lengths and velocities of hosted Hill muscles, as muscle spindles tell them: in optimal fiber lengths."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from mjhcmc.hosted.curves import CompiledCurves
from mjhcmc.hosted.muscle import COMPLIANT, fiber_velocity, rigid_fiber

Array = NDArray[np.float64]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _fill_speeds(kind, c, p, activation, fiber, length, velocity, out):  # type: ignore[no-untyped-def]
    for s in range(out.shape[0]):
        for i in range(out.shape[1]):
            m, L = p[s, i], length[s, i]
            if kind == COMPLIANT:
                speed = fiber_velocity(c, m, activation[s, i], fiber[s, i], L)
            else:
                speed = velocity[s, i] * (L - m[2]) / rigid_fiber(m, L)
            out[s, i] = speed / m[1]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _fill_rigid_lengths(p, length, out):  # type: ignore[no-untyped-def]
    for s in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[s, i] = rigid_fiber(p[s, i], length[s, i]) / p[s, i, 1]


def fiber_speeds(
    kind: int, curves: CompiledCurves, p: Array, activation: Array, fiber: Array, length: Array, velocity: Array
) -> Array:
    """Fiber velocities of muscles in b simulations.

    On a rigid tendon vM = vMT cos(alpha); with a compliant one, the velocity that balances fiber and tendon (Millard
    et al. 2013, doi:10.1115/1.4023390).

    Args:
        kind: ``hosted.muscle.RIGID`` or ``COMPLIANT``.
        curves: see `hosted.curves`.
        p: (b, n, 6) muscles, see `hosted.muscle`.
        activation: (b, n), in [0, 1].
        fiber: (b, n) m, fiber length of compliant muscles; not looked at with rigid tendons.
        length: (b, n) m, musculotendon length.
        velocity: (b, n) m/s, lengthening positive; not looked at with compliant tendons.

    Returns:
        (b, n) optimal fiber lengths a second, lengthening positive; NaN where no length is left for fiber or tendon.
    """
    out = np.empty(length.shape)
    p, activation, fiber, length, velocity = map(np.ascontiguousarray, (p, activation, fiber, length, velocity))
    _fill_speeds(kind, curves, p, activation, fiber, length, velocity, out)
    return out


def fiber_lengths(kind: int, p: Array, fiber: Array, length: Array) -> Array:
    """Fiber lengths of muscles in b simulations.

    Args:
        kind: as `fiber_speeds`, as the rest.
        p: (b, n, 6).
        fiber: (b, n) m.
        length: (b, n) m.

    Returns:
        (b, n) optimal fiber lengths; NaN where a rigid tendon leaves no length for the fiber.
    """
    if kind == COMPLIANT:
        return np.asarray(fiber / p[..., 1])
    out = np.empty(length.shape)
    _fill_rigid_lengths(np.ascontiguousarray(p), np.ascontiguousarray(length), out)
    return out

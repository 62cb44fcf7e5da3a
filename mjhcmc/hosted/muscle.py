"""One muscle, compiled: the equations of `mjhcmc.hill`, whose docstrings hold them and their sources.

A muscle is a row of parameters p: F0 (N), lopt (m), lslack (m), fiber width (m), fastest shortening (m/s), damping
beta. Its state is activation a, and with a compliant tendon the fiber length l (m). L and V are the musculotendon's
length (m) and velocity (m/s, lengthening positive). Where no length is left for fiber or tendon the result is NaN.
"""

import numba
import numpy as np

from mjhcmc.activation import rate_of
from mjhcmc.hosted.curves import active, balanced_velocity, force_velocity, passive, tendon

N_PARAMETERS = 6
RIGID, COMPLIANT = range(2)
"""Tendons."""

_SHORTEST = 1e-3  # optimal fiber lengths along the tendon
_ITERATIONS = 100
_CLOSE = 1e-13


@numba.njit(cache=True, error_model="numpy")
def fiber_velocity(c, p, a, l, L):  # type: ignore[no-untyped-def]  # noqa: E741
    """Fiber velocity (m/s) that balances fiber and compliant tendon."""
    if not (l > p[3]):
        return np.nan
    along = np.sqrt(l * l - p[3] * p[3])
    if not (along < L):
        return np.nan
    normal = l / p[1]
    target = tendon(c, (L - along) / p[2]) * l / along - passive(c, normal)
    return p[4] * balanced_velocity(c, target, a * active(c, normal), a, p[5])


@numba.njit(cache=True, error_model="numpy")
def compliant_force(c, p, l, L):  # type: ignore[no-untyped-def]  # noqa: E741
    """Tendon force (N) of a fiber of a length."""
    return p[0] * tendon(c, (L - np.sqrt(l * l - p[3] * p[3])) / p[2])


@numba.njit(cache=True, error_model="numpy")
def rigid_fiber(p, L):  # type: ignore[no-untyped-def]
    """Fiber length (m) on a rigid tendon."""
    along = L - p[2]
    return np.sqrt(along * along + p[3] * p[3]) if along > 0.0 else np.nan


@numba.njit(cache=True, error_model="numpy")
def rigid_force(c, p, a, L, V):  # type: ignore[no-untyped-def]
    """Force (N) with a rigid tendon, which does not push."""
    l = rigid_fiber(p, L)  # noqa: E741
    cos = (L - p[2]) / l
    speed = V * cos / p[4]
    pull = a * active(c, l / p[1]) * force_velocity(c, speed, a)[0] + passive(c, l / p[1]) + p[5] * speed
    return max(p[0] * pull * cos, 0.0) if abs(pull) < np.inf else np.nan


@numba.njit(cache=True, error_model="numpy")
def gain_and_bias(c, p, l, L, V):  # type: ignore[no-untyped-def]  # noqa: E741
    """Force (N) along the tendon at full activation without that at none; and that at none.

    Of a fiber of a length that moves with the musculotendon as on a rigid tendon: smooth along a movement, whatever the
    compliant fiber does.
    """
    along = np.sqrt(l * l - p[3] * p[3])
    cos = along / l
    speed = V * cos / p[4]
    gain = p[0] * cos * active(c, l / p[1]) * force_velocity(c, speed, 1.0)[0]
    return gain, p[0] * cos * (passive(c, l / p[1]) + p[5] * speed)


@numba.njit(cache=True, error_model="numpy")
def advance(c, p, tendon_kind, prm, a, l, u, path, h):  # type: ignore[no-untyped-def]  # noqa: E741
    """Activation and fiber length after one Runge-Kutta step of the muscle alone, along a given path.

    Args:
        c: curves.
        p: muscle.
        tendon_kind: RIGID or COMPLIANT.
        prm: (3,) activation dynamics.
        a: activation.
        l: m, fiber length of a compliant muscle.
        u: excitation.
        path: (3,) m, musculotendon length at the step's start, middle and end.
        h: s.
    """
    k1 = rate_of(a, u, prm[0], prm[1], prm[2])
    a2 = a + 0.5 * h * k1
    k2 = rate_of(a2, u, prm[0], prm[1], prm[2])
    a3 = a + 0.5 * h * k2
    k3 = rate_of(a3, u, prm[0], prm[1], prm[2])
    a4 = a + h * k3
    k4 = rate_of(a4, u, prm[0], prm[1], prm[2])
    if tendon_kind == COMPLIANT:
        v1 = fiber_velocity(c, p, a, l, path[0])
        v2 = fiber_velocity(c, p, a2, l + 0.5 * h * v1, path[1])
        v3 = fiber_velocity(c, p, a3, l + 0.5 * h * v2, path[1])
        v4 = fiber_velocity(c, p, a4, l + h * v3, path[2])
        l += h * (v1 + 2.0 * v2 + 2.0 * v3 + v4) / 6.0  # noqa: E741
    return a + h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0, l


@numba.njit(cache=True, error_model="numpy")
def steady_force(c, p, kind, a, L, V):  # type: ignore[no-untyped-def]
    """Force (N) of a muscle in steady motion: the tendon keeps its length; 0 where it would push."""
    if kind == RIGID:
        return rigid_force(c, p, a, L, V)
    strain = _steady_strain(c, p, a, L, V)
    return p[0] * tendon(c, 1.0 + strain) if strain > 0.0 else 0.0


@numba.njit(cache=True, error_model="numpy")
def _steady_strain(c, p, a, L, V):  # type: ignore[no-untyped-def]
    """A compliant tendon's strain in steady motion, NaN where it would push: bracketed secant method (Illinois)."""
    low, high, side = 0.0, (L - p[2] - _SHORTEST * p[1]) / p[2], 0
    if not high > 0.0:
        return np.nan
    f_low, f_high = _surplus(c, p, a, L, V, low), _surplus(c, p, a, L, V, high)
    if not (f_low < 0.0 and f_high > 0.0):
        return np.nan
    strain = high
    for step in range(_ITERATIONS):
        strain = (low * f_high - high * f_low) / (f_high - f_low)
        if step % 8 == 7 or not low < strain < high:  # guard against a stalled secant
            strain = 0.5 * (low + high)
        f = _surplus(c, p, a, L, V, strain)
        if abs(f) < _CLOSE or high - low < _CLOSE * high:
            break
        if f < 0.0:
            low, f_low = strain, f
            f_high *= 0.5 if side == -1 else 1.0
            side = -1
        else:
            high, f_high = strain, f
            f_low *= 0.5 if side == 1 else 1.0
            side = 1
    return strain


@numba.njit(cache=True, error_model="numpy")
def _surplus(c, p, a, L, V, strain):  # type: ignore[no-untyped-def]
    """Normalised tendon force less the fiber's along it, in steady motion."""
    along = L - p[2] * (1.0 + strain)
    l = np.sqrt(along * along + p[3] * p[3])  # noqa: E741
    cos = along / l
    speed, normal = V * cos / p[4], l / p[1]
    fiber = a * active(c, normal) * force_velocity(c, speed, a)[0] + passive(c, normal) + p[5] * speed
    return tendon(c, 1.0 + strain) - fiber * cos


@numba.njit(cache=True, error_model="numpy", nogil=True)
def steady_forces(c, p, kind, a, L, V, force):  # type: ignore[no-untyped-def]
    """Fill force (n,) N of muscles in steady motion."""
    for i in range(force.size):
        force[i] = steady_force(c, p[i], kind, a[i], L[i], V[i])


@numba.njit(cache=True, error_model="numpy", nogil=True)
def steady_fibers(c, p, a, L, V, fiber):  # type: ignore[no-untyped-def]
    """Fill fiber (n,) m of compliant muscles in steady motion; NaN where they would push."""
    for i in range(fiber.size):
        along = L[i] - p[i, 2] * (1.0 + _steady_strain(c, p[i], a[i], L[i], V[i]))
        fiber[i] = np.sqrt(along * along + p[i, 3] * p[i, 3])


@numba.njit(cache=True, error_model="numpy", nogil=True)
def steady_activations(c, p, kind, force, L, V, a):  # type: ignore[no-untyped-def]
    """Fill a (n,), in [0, 1]: with which muscles in steady motion pull a force (n,) N, or nearest to it.

    Force rises with activation; by the bracketed secant method (Illinois).
    """
    for i in range(force.size):
        low, high, side = 0.0, 1.0, 0
        f_low = steady_force(c, p[i], kind, low, L[i], V[i]) - force[i]
        f_high = steady_force(c, p[i], kind, high, L[i], V[i]) - force[i]
        a[i] = 0.0 if f_low >= 0.0 else 1.0
        if not (f_low < 0.0 and f_high > 0.0):
            continue
        for step in range(_ITERATIONS):
            middle = 0.5 * (low + high) if step % 8 == 7 else (low * f_high - high * f_low) / (f_high - f_low)
            f = steady_force(c, p[i], kind, middle, L[i], V[i]) - force[i]
            a[i] = middle
            if abs(f) < 10.0 * _CLOSE * p[i, 0] or high - low < _CLOSE:
                break
            if f < 0.0:
                low, f_low = middle, f
                f_high *= 0.5 if side == -1 else 1.0
                side = -1
            else:
                high, f_high = middle, f
                f_low *= 0.5 if side == 1 else 1.0
                side = 1

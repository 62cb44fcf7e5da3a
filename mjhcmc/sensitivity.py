"""How the end of a control window answers to what acts over it.

Linear in the deviations from a trial window: with f(t) = B phi(t) da the change of the muscles' joint moments, phi(t)
the way a change of activation builds up over the window (1 at its end), and a change ds of the reserves,

    M dq'' + D dq' + K dq = B phi(t) da + ds,    dq = dq' = 0 at the window's start,

integrated by the trapezoidal rule over the physics steps (it cannot blow up, however stiff the active muscles are), or
where the plant's integrator is of first order by the plant's own rule, with dA for dq'' (see `integrators`).
"""

import numba
import numpy as np

from mjhcmc.activation import advance_one
from mjhcmc.small_linear import inverse_of

_CHANGE = 1e-3  # of excitation: well above rounding, well below what matters


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def fill_response(M, D, K, B, phi, step, acc, vel, pos):  # type: ignore[no-untyped-def]
    """Solve the equation above for unit changes, at the window's end, of each activation and each reserve.

    For compiled code; fills acc (rad/s^2), vel (rad/s) and pos (rad), each (nv, n_muscle + nv): columns are muscles,
    per unit of activation, then reserves, per N m.

    Args:
        M: (nv, nv) kg m^2, mass matrix.
        D: (nv, nv) N m s, -dF/dv of all smooth forces at fixed activation.
        K: (nv, nv) N m, -dF/dq likewise.
        B: (nv, n_muscle) N m, joint moments at full activation.
        phi: (n_step + 1, n_muscle) build-up of activation, see `fill_build_up`.
        step: s, physics step.
        acc: filled.
        vel: filled.
        pos: filled.
    """
    nv, n = B.shape
    stepped, inverse, free = np.empty((nv, nv)), np.empty((nv, nv)), np.empty((nv, nv))
    for i in range(nv):
        for j in range(nv):
            stepped[i, j] = M[i, j] + step / 2 * D[i, j] + step * step / 4 * K[i, j]
    inverse_of(stepped, inverse)
    inverse_of(M, free)
    for i in range(nv):
        for m in range(n + nv):
            vel[i, m] = pos[i, m] = 0.0
        for m in range(n):
            acc[i, m] = 0.0
            for j in range(nv):
                acc[i, m] += free[i, j] * B[j, m] * phi[0, m]
        for j in range(nv):
            acc[i, n + j] = free[i, j]
    _integrate(inverse, D, K, B, phi, step, acc, vel, pos)


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def _integrate(inverse, D, K, B, phi, step, acc, vel, pos):  # type: ignore[no-untyped-def]
    nv, columns = acc.shape
    n = B.shape[1]
    half, quarter = step / 2, step * step / 4
    v, q, rhs = np.empty(nv), np.empty(nv), np.empty(nv)
    for c in range(columns):
        for j in range(1, phi.shape[0]):
            for i in range(nv):
                v[i] = vel[i, c] + half * acc[i, c]
                q[i] = pos[i, c] + step * vel[i, c] + quarter * acc[i, c]
            for i in range(nv):
                if c < n:
                    rhs[i] = B[i, c] * phi[j, c]
                else:
                    rhs[i] = 1.0 if c - n == i else 0.0
                for k in range(nv):
                    rhs[i] -= D[i, k] * v[k] + K[i, k] * q[k]
            for i in range(nv):
                a = 0.0
                for k in range(nv):
                    a += inverse[i, k] * rhs[k]
                acc[i, c] = a
                vel[i, c] = v[i] + half * a
                pos[i, c] = q[i] + quarter * a


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def fill_stepped_response(inertia, D, K, B, phi, step, acc, vel, pos):  # type: ignore[no-untyped-def]
    """As `fill_response`, of a plant that an integrator of first order steps; acc is that of the step that follows.

    Args:
        inertia: (nv, nv) kg m^2, M + s D_s of `integrators`.
        D: as `fill_response`, like the rest.
        K: likewise.
        B: likewise.
        phi: likewise.
        step: likewise.
        acc: filled.
        vel: filled.
        pos: filled.
    """
    nv, n = B.shape
    inverse, rhs = np.empty((nv, nv)), np.empty(nv)
    inverse_of(inertia, inverse)
    for c in range(n + nv):
        for i in range(nv):
            vel[i, c] = pos[i, c] = 0.0
        for j in range(phi.shape[0]):
            for i in range(nv):
                if c < n:
                    rhs[i] = B[i, c] * phi[j, c]
                else:
                    rhs[i] = 1.0 if c - n == i else 0.0
                for k in range(nv):
                    rhs[i] -= D[i, k] * vel[k, c] + K[i, k] * pos[k, c]
            for i in range(nv):
                acc[i, c] = 0.0
                for k in range(nv):
                    acc[i, c] += inverse[i, k] * rhs[k]
            if j + 1 < phi.shape[0]:
                for i in range(nv):
                    vel[i, c] += step * acc[i, c]
                    pos[i, c] += step * vel[i, c]


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def fill_build_up(a0, u, prm, step, n_step, euler, phi):  # type: ignore[no-untyped-def]
    """Fill phi (n_step + 1, n_muscle): how a small change of excitation builds up in activation, 1 at the end.

    Args:
        a0: (n_muscle,) activation at the window's start.
        u: (n_muscle,) excitation of the trial.
        prm: (n_muscle, 3) activation dynamics, see `MuscleModel`.
        step: s, physics step.
        n_step: physics steps in the window.
        euler: whether they are Euler steps; else RK4's.
        phi: filled.
    """
    for i in range(a0.size):
        other = u[i] + _CHANGE if u[i] < 0.5 else u[i] - _CHANGE
        a, b = a0[i], a0[i]
        phi[0, i] = 0.0
        for j in range(1, n_step + 1):
            a = advance_one(a, u[i], prm[i, 0], prm[i, 1], prm[i, 2], step, 1, euler)
            b = advance_one(b, other, prm[i, 0], prm[i, 1], prm[i, 2], step, 1, euler)
            phi[j, i] = b - a
        for j in range(1, n_step + 1):
            phi[j, i] /= b - a

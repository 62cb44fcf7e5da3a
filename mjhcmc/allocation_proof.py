"""The allocation with its proof, compiled: Newton, a refinement where rounding asks for it, the optimality conditions.

For rows as in `allocation_kernels`; one implementation serves one problem and many.
"""

import numba
import numpy as np

from mjhcmc.allocation_kernels import newton

PROVEN = 1e-9
"""Largest residual of the optimality conditions, each on its own scale, of an allocation that counts as optimal."""

INFEASIBLE = 1e-6
"""Reserves above this share of the muscles' strength are more than the elasticity."""

CANCELLATION = 1e-6
"""Of the terms that cancel in a stationary activation: what rounding leaves of them stays under `PROVEN`."""

_BAR = 0.5 * PROVEN  # the same sums in another order still pass
_REFINEMENTS = 3


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _residual_of(B, Q, lb, ub, w, a0, eps, y, a):  # type: ignore[no-untyped-def]
    """As `AllocationProblem.optimality_residual`, of rows P B, P Q, for P s = P Q - P B a; and the largest |P s|.

    Infinite where a value is not finite. The cost is quadratic.
    """
    nv, n = B.shape
    worst, most, sound = 0.0, 0.0, True
    for j in range(nv):
        s = Q[j]
        for i in range(n):
            s -= B[j, i] * a[i]
        price = abs(s - eps * y[j])
        sound = sound and price < np.inf  # False with NaN
        worst, most = max(worst, price), max(most, abs(s))
    for i in range(n):
        pull, size = 0.0, 0.0
        for j in range(nv):
            pull += B[j, i] * y[j]
            size += abs(B[j, i] * y[j])
        best = min(ub[i], max(lb[i], a0[i] + pull / w[i]))
        off = abs(a[i] - best) / (1.0 + CANCELLATION * size / w[i])
        off = max(off, lb[i] - a[i], a[i] - ub[i])
        sound = sound and off < np.inf and size < np.inf
        worst = max(worst, off)
    return worst if sound else np.inf, most


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _factor(B, lb, ub, w, at, eps, U, row):  # type: ignore[no-untyped-def]
    """Fill the upper triangle U, U^T U = sum of B_i B_i^T/w_i over the muscles at lb < at < ub, + eps.

    By Givens rotations of rows, without forming the sum: its smallest parts stay.
    """
    nv, n = B.shape
    for j in range(nv):
        for k in range(nv):
            U[j, k] = 0.0
        U[j, j] = np.sqrt(eps)
    for i in range(n):
        if not lb[i] < at[i] < ub[i]:
            continue
        for j in range(nv):
            row[j] = B[j, i] / np.sqrt(w[i])
        for j in range(nv):
            if row[j] == 0.0:
                continue
            long = np.sqrt(U[j, j] * U[j, j] + row[j] * row[j])
            c, s = U[j, j] / long, row[j] / long
            for k in range(j, nv):
                kept = U[j, k]
                U[j, k] = c * kept + s * row[k]
                row[k] = c * row[k] - s * kept


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _back_substitute(U, d):  # type: ignore[no-untyped-def]
    """Solve U^T U x = d in place."""
    n = d.size
    for j in range(n):
        for k in range(j):
            d[j] -= U[k, j] * d[k]
        d[j] /= U[j, j]
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            d[j] -= U[j, k] * d[k]
        d[j] /= U[j, j]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _refine(B, Q, lb, ub, w, a0, eps, y, a, gradient, U, d, row):  # type: ignore[no-untyped-def]
    """One step on the optimality conditions of y and the muscles between their bounds, each with its own rounding.

    Where y is large or weights are small, no y in double precision gives activations that supply the moment; y and a
    apart do.
    """
    nv, n = B.shape
    _factor(B, lb, ub, w, a, eps, U, row)
    for j in range(nv):
        d[j] = Q[j] - eps * y[j]
    for i in range(n):
        free = lb[i] < a[i] < ub[i]
        gradient[i] = w[i] * (a[i] - a0[i])
        for j in range(nv):
            gradient[i] -= B[j, i] * y[j]
        for j in range(nv):
            d[j] -= B[j, i] * (a[i] - (gradient[i] / w[i] if free else 0.0))
    _back_substitute(U, d)
    for i in range(n):
        if lb[i] < a[i] < ub[i]:
            move = -gradient[i]
            for j in range(nv):
                move += B[j, i] * d[j]
            a[i] = min(ub[i], max(lb[i], a[i] + move / w[i]))
    for j in range(nv):
        y[j] += d[j]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def settle(B, Q, lb, ub, w, a0, eps, y, a):  # type: ignore[no-untyped-def]
    """As `allocation_kernels.newton`, refined and proven: returns iterations and the residual.

    The residual is NaN, and a stays as it is, where a value is not finite.
    """
    nv, n = B.shape
    total = eps * 0.0  # NaN as soon as anything is not finite
    for j in range(nv):
        total += Q[j] * 0.0
        for i in range(n):
            total += B[j, i] * 0.0
    for i in range(n):
        total += (lb[i] + ub[i] + w[i] + a0[i]) * 0.0
    if total != 0.0:  # NaN, too
        return 0, np.nan
    gradient, trial, price, U = np.empty(n), np.empty(n), np.empty(nv), np.empty((nv, nv))
    d, row = np.empty(nv), np.empty(nv)
    cold = True
    for j in range(nv):
        price[j] = y[j]
        cold = cold and y[j] == 0.0
    iterations, best = 0, np.inf
    while True:
        iterations += abs(newton(B, Q, lb, ub, w, a0, eps, price, trial))
        for refinement in range(_REFINEMENTS + 1):
            if refinement > 0:
                _refine(B, Q, lb, ub, w, a0, eps, price, trial, gradient, U, d, row)
            missed, most = _residual_of(B, Q, lb, ub, w, a0, eps, price, trial)
            if (refinement == 0 and best == np.inf) or missed < best or missed <= _BAR:
                best = missed
                for i in range(n):
                    a[i] = trial[i]
                for j in range(nv):
                    y[j] = price[j]
            if missed <= _BAR and (refinement > 0 or most <= INFEASIBLE):  # large reserves leave Newton less exact
                break
        if cold or best <= _BAR:
            return iterations, best
        cold = True  # the start may be to blame
        for j in range(nv):
            price[j] = 0.0


@numba.njit(cache=True, error_model="numpy", nogil=True)
def settle_many(B, Q, lb, ub, w, a0, eps, y, a, iterations, residual):  # type: ignore[no-untyped-def]
    """As `settle`, problem after problem along the first axis."""
    for k in range(B.shape[0]):
        iterations[k], residual[k] = settle(B[k], Q[k], lb[k], ub[k], w[k], a0[k], eps[k], y[k], a[k])

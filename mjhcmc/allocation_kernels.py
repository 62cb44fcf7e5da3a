"""The inner loops of the allocation: dual Newton methods on nv unknowns, compiled.

Both solve r(y) = Q - eps y - B a(y) = 0, where a(y) is what each muscle does at the price y of the moments. r is the
gradient of a concave function, so that d^T r(y + t d) falls along any direction d and a line search by it cannot fail.
Rows are those of P B and P Q, see `allocation`.
"""

import numba
import numpy as np

ITERATIONS = 200
TOLERANCE = 1e-11  # of the moments asked for
ROUNDING = 1e-15
_LEAST_ROW = 1e-6  # of the strongest row: weaker ones are measured as if they had this
_SEARCHES = 100
_SEARCHED = 1e-6  # of the slope at the start: a coarse search stalls


@numba.njit(cache=True, error_model="numpy", nogil=True)
def newton(B, Q, lb, ub, w, a0, eps, y, a):  # type: ignore[no-untyped-def]
    """Dual Newton on the rows P B, P Q: fills a (n,), returns iterations (negative where it did not settle).

    y (nv,) comes in as the multiplier to start from (zeros where none is known) and goes out as the one found. One
    that no reserve could have counts as zeros.
    """
    nv, n = B.shape
    z, dz, breaks, slopes = np.empty(n), np.empty(n), np.empty(2 * n), np.empty(2 * n)  # z: unclipped activation
    H, r, d, accepted = np.empty((nv, nv)), np.empty(nv), np.empty(nv), np.empty(nv)
    known, strongest, tiny = True, 0.0, np.finfo(np.float64).tiny
    for j in range(nv):
        reach = 0.0
        for i in range(n):
            reach += abs(B[j, i]) * max(abs(lb[i]), abs(ub[i]))
        accepted[j] = max(reach, abs(Q[j]))
        strongest = max(strongest, accepted[j])
        if not abs(eps * y[j]) <= 4.0 * accepted[j]:  # NaN, too
            known = False
    for j in range(nv):
        accepted[j] = TOLERANCE * max(accepted[j], _LEAST_ROW * strongest, tiny)  # each row on its own scale
        if not known:
            y[j] = 0.0
    last_worst = np.inf
    for iteration in range(ITERATIONS):
        for i in range(n):
            z[i] = 0.0
        for j in range(nv):
            for i in range(n):
                z[i] += B[j, i] * y[j]
        for i in range(n):
            z[i] = a0[i] + z[i] / w[i]
            a[i] = min(ub[i], max(lb[i], z[i]))
        settled, worst = True, 0.0  # in units of what is accepted
        for j in range(nv):
            r[j] = Q[j] - eps * y[j]
            for i in range(n):
                r[j] -= B[j, i] * a[i]
            d[j] = r[j]
            missed = abs(r[j]) / accepted[j]
            settled = settled and missed <= 1.0  # False with NaN
            worst = max(worst, missed)
        if settled:
            return iteration
        if worst > 0.5 * last_worst and _is_rounding(B, lb, ub, w, y, z, r):  # to be proven
            return -iteration - 1
        last_worst = worst
        for j in range(nv):
            for k in range(j + 1):
                H[j, k] = eps if j == k else 0.0
        for i in range(n):
            if lb[i] < z[i] < ub[i]:
                for j in range(nv):
                    share = B[j, i] / w[i]
                    for k in range(j + 1):
                        H[j, k] += share * B[k, i]
        _cholesky_solve(H, d)
        # exact line search: d^T r(y + t d) is decreasing and piecewise linear in t
        value, slope = 0.0, 0.0
        for j in range(nv):
            value += d[j] * r[j]
            slope -= eps * d[j] * d[j]
        flattest = min(slope, -tiny)
        for i in range(n):
            dz[i] = 0.0
        for j in range(nv):
            for i in range(n):
                dz[i] += B[j, i] * d[j]
        count, nearest = 0, np.inf
        for i in range(n):
            dz[i] /= w[i]
            if dz[i] == 0.0:
                continue
            change = w[i] * dz[i] * dz[i]
            first = ((lb[i] if dz[i] > 0.0 else ub[i]) - z[i]) / dz[i]  # becomes free
            last = ((ub[i] if dz[i] > 0.0 else lb[i]) - z[i]) / dz[i]  # is clipped again
            if last <= 0.0:
                continue
            if first <= 0.0:
                slope -= change
            else:
                breaks[count], slopes[count] = first, -change
                nearest = min(nearest, first)
                count += 1
            breaks[count], slopes[count] = last, change
            nearest = min(nearest, last)
            count += 1
        t = 0.0
        if value + slope * nearest > 0.0:  # else a full step ends before anything changes
            _sort(breaks, slopes, count)
            for k in range(count):
                at = breaks[k]
                next_value = value + slope * (at - t)
                if next_value <= 0.0:
                    break
                value, t = next_value, at
                slope += slopes[k]
        t -= value / min(slope, flattest)  # what was added to the slope may not cancel to the last digit
        if not t > 0.0:
            return -iteration - 1
        for j in range(nv):
            y[j] += t * d[j]
    return -ITERATIONS


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def _is_rounding(B, lb, ub, w, y, z, r):  # type: ignore[no-untyped-def]
    """Whether r is no more than what rounding leaves: where reserves are large, so is y, and B^T y cancels."""
    nv, n = B.shape
    worst, most = 0.0, 0.0
    for j in range(nv):
        noise = 0.0
        for i in range(n):
            if lb[i] < z[i] < ub[i]:
                pull = 0.0
                for k in range(nv):
                    pull += abs(B[k, i] * y[k])
                noise += abs(B[j, i]) * pull / w[i]
        worst, most = max(worst, abs(r[j])), max(most, noise)
    return worst <= ROUNDING * most


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def _sort(keys, values, count):  # type: ignore[no-untyped-def]
    """Sort the first count keys, and the values with them, by Shell's sort, quick to compile."""
    gap = 1
    while 3 * gap + 1 < count:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, count):
            key, value = keys[i], values[i]
            j = i
            while j >= gap and keys[j - gap] > key:
                keys[j], values[j] = keys[j - gap], values[j - gap]
                j -= gap
            keys[j], values[j] = key, value
        gap //= 3


@numba.njit(cache=True, error_model="numpy", inline="always")  # compiled once, with what calls it
def _cholesky_solve(H, d):  # type: ignore[no-untyped-def]
    """Solve H x = d in place for a positive definite H given by its lower triangle.

    A pivot that cancels to nothing is kept above rounding: x is then still a direction of ascent.
    """
    n = d.size
    for j in range(n):
        least = ROUNDING * H[j, j]
        for k in range(j + 1):
            total = H[j, k]
            for i in range(k):
                total -= H[j, i] * H[k, i]
            H[j, k] = np.sqrt(max(total, least)) if j == k else total / H[k, k]
    for j in range(n):
        for i in range(j):
            d[j] -= H[j, i] * d[i]
        d[j] /= H[j, j]
    for j in range(n - 1, -1, -1):
        for i in range(j + 1, n):
            d[j] -= H[i, j] * d[i]
        d[j] /= H[j, j]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _cubic_response(z, w, c, low, high):  # type: ignore[no-untyped-def]
    """The a that minimizes w/2 a^2 + c/3 a^3 - z a between bounds (low >= 0), and da/dz."""
    if c == 0.0:
        a, slope = z / w, 1.0 / w
    elif z <= 0.0:
        a, slope = 0.0, 0.0
    else:
        root = np.sqrt(w * w + 4.0 * c * z)
        a, slope = 2.0 * z / (w + root), 1.0 / root
    if a <= low:
        return low, 0.0
    if a >= high:
        return high, 0.0
    return a, slope


@numba.njit(cache=True, error_model="numpy", nogil=True)
def newton_cubic(B, Q, lb, ub, w, a0, c, eps):  # type: ignore[no-untyped-def]
    """With the cost w/2 (a - a0)^2 + c/3 a^3: returns a, y, iterations (negative where it did not settle)."""
    nv, n = B.shape
    y, d, r = np.zeros(nv), np.empty(nv), np.empty(nv)
    a, z, dz = np.empty(n), np.empty(n), np.empty(n)
    H = np.empty((nv, nv))
    size_Q = 1.0
    for j in range(nv):
        size_Q = max(size_Q, abs(Q[j]))
    last_worst = np.inf
    for iteration in range(ITERATIONS):
        for j in range(nv):
            r[j] = Q[j] - eps * y[j]
            for k in range(j + 1):
                H[j, k] = eps if j == k else 0.0
        for i in range(n):
            z[i] = w[i] * a0[i]
            for j in range(nv):
                z[i] += B[j, i] * y[j]
            a[i], slope = _cubic_response(z[i], w[i], c[i], lb[i], ub[i])
            for j in range(nv):
                r[j] -= B[j, i] * a[i]
                for k in range(j + 1):
                    H[j, k] += slope * B[j, i] * B[k, i]
        worst = 0.0
        for j in range(nv):
            worst = max(worst, abs(r[j]))
            d[j] = r[j]
        if worst <= TOLERANCE * size_Q:
            return a, y, iteration
        if iteration >= ITERATIONS // 2 and worst > 0.5 * last_worst:  # as far as rounding lets it: to be proven
            return a, y, -iteration - 1
        last_worst = worst
        _cholesky_solve(H, d)
        for i in range(n):
            dz[i] = 0.0
            for j in range(nv):
                dz[i] += B[j, i] * d[j]
        t = _search(B, Q, lb, ub, w, c, eps, y, d, z, dz)
        if not t > 0.0:
            return a, y, -iteration - 1
        for j in range(nv):
            y[j] += t * d[j]
    return a, y, -ITERATIONS


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _search(B, Q, lb, ub, w, c, eps, y, d, z, dz):  # type: ignore[no-untyped-def]
    """The step t at which d^T r(y + t d), which falls, is near 0: a full step where that is good, else bracketed."""
    nv, n = B.shape
    steady = 0.0  # the part of d^T r without the muscles is steady - t drift
    drift = 0.0
    for j in range(nv):
        steady += d[j] * (Q[j] - eps * y[j])
        drift += eps * d[j] * d[j]
    low, high = 0.0, np.inf
    value_low, value_high = 0.0, 0.0
    t, side = 0.0, 0
    for search in range(_SEARCHES):
        value = steady - t * drift
        for i in range(n):
            value -= dz[i] * _cubic_response(z[i] + t * dz[i], w[i], c[i], lb[i], ub[i])[0]
        if search == 0:
            value_low = start = value
            if not value > 0.0:
                return 0.0
            t = 1.0
            continue
        if abs(value) <= _SEARCHED * start or (high < np.inf and high - low <= ROUNDING * high):
            return t
        if value > 0.0:
            low, value_low = t, value
            if side > 0:
                value_high *= 0.5
            side = 1
        else:
            high, value_high = t, value
            if side < 0:
                value_low *= 0.5
            side = -1
        if high == np.inf:
            t *= 4.0
        else:
            t = (low * value_high - high * value_low) / (value_high - value_low)
            if not low < t < high or search % 8 == 7:
                t = 0.5 * (low + high)
    return t

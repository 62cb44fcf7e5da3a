"""How the end of a control window answers to muscle forces and reserves, where muscles are Hill muscles.

As `sensitivity`, with muscles that give way: a compliant tendon passes on what its fiber lets it. Linear in the
deviations from a trial window, with dl the deviation of fiber lengths and dL = -R dq,

    M dq'' + D dq' + K dq = R^T (phi(t) df + F_l dl) + ds,    dl' = v_l dl + v_L dL,    all 0 at the window's start,

D and K at fixed activation and fiber length, phi(t) the way a change df of the muscle's force builds up at a fixed path
(1 at the window's end). By the trapezoidal rule over the physics steps.
"""

import numba
import numpy as np

from mjhcmc.small_linear import inverse_of, solve_in_place


@numba.njit(cache=True, error_model="numpy", nogil=True)
def linearize(  # type: ignore[no-untyped-def]
    first, last, M, D, K, R, gain, phi, slopes, kp, kv, step, r, x_end, s_end, answers, wanted, Q, rate
):
    """Fill what the allocation needs, of simulations first to last.

    Args:
        first: of the simulations.
        last: past the last one.
        M: (b, nv, nv) kg m^2.
        D: (b, nv, nv) N m s.
        K: (b, nv, nv) N m.
        R: (b, n, nv) m.
        gain: (b, n) N, force of a unit of effective activation.
        phi: (b, n_step + 1, n).
        slopes: (b, n, 4) see `hosted.stages.read_muscles`.
        kp: (b, nv) 1/s^2.
        kv: (b, nv) 1/s.
        step: s.
        r: (b, nv) rad/s^2, the acceleration that the trial misses, with feedback (see `hcmc`).
        x_end: (b, n) the trial's effective activation at its end.
        s_end: (b, nv) N m, its reserve.
        answers: (b, nv, n + nv) filled: N [X Y], N such that a force that grows linearly over the window is answered
            by itself.
        wanted: (b, nv) filled: N r.
        Q: (b, nv) filled: R^T gain x + T s.
        rate: (b,) 1/s, filled: a bound on the fastest decay rate.
    """
    nv, n = M.shape[1], R.shape[1]
    columns, n_step = n + 2 * nv, phi.shape[1] - 1
    acc, vel, pos = np.empty(nv), np.empty(nv), np.empty(nv)
    v, q, rhs = np.empty(nv), np.empty(nv), np.empty(nv)
    fiber, kept, pliant = np.empty(n), np.empty(n), np.empty(n)
    stepped, inverse, free = np.empty((nv, nv)), np.empty((nv, nv)), np.empty((nv, nv))
    end, ramp, used = np.empty((nv, columns)), np.empty((nv, nv)), np.empty((nv, nv))
    half, quarter = step / 2, step * step / 4
    for b in range(first, last):
        for i in range(n):
            pliant[i] = half * slopes[b, i, 3] / (1.0 - half * slopes[b, i, 2])  # d(dl)/d(dL) at once
        for i in range(nv):
            for j in range(nv):
                stepped[i, j] = M[b, i, j] + half * D[b, i, j] + quarter * K[b, i, j]
                for m in range(n):
                    stepped[i, j] += quarter * R[b, m, i] * slopes[b, m, 0] * pliant[m] * R[b, m, j]
                used[i, j], free[i, j] = M[b, i, j], D[b, i, j]
        inverse_of(stepped, inverse)
        solve_in_place(used, free)
        rate[b] = 0.0
        for i in range(nv):
            total = 0.0
            for j in range(nv):
                total += abs(free[i, j])
            rate[b] = max(rate[b], total)
        for m in range(n):
            rate[b] = max(rate[b], -slopes[b, m, 2])
        inverse_of(M[b], free)
        for c in range(columns):
            for i in range(nv):
                vel[i] = pos[i] = acc[i] = 0.0
                if c < n:
                    for j in range(nv):
                        acc[i] += free[i, j] * R[b, c, j] * gain[b, c] * phi[b, 0, c]
                elif c < n + nv:
                    acc[i] = free[i, c - n]
            for m in range(n):
                fiber[m] = 0.0
            for k in range(1, n_step + 1):
                for i in range(nv):
                    v[i] = vel[i] + half * acc[i]
                    q[i] = pos[i] + step * vel[i] + quarter * acc[i]
                    rhs[i] = 0.0
                    if c < n:
                        rhs[i] = R[b, c, i] * gain[b, c] * phi[b, k, c]
                    elif c == n + i:
                        rhs[i] = 1.0
                    elif c == n + nv + i:
                        rhs[i] = k / n_step
                for i in range(nv):
                    for j in range(nv):
                        rhs[i] -= D[b, i, j] * v[j] + K[b, i, j] * q[j]
                for m in range(n):
                    before, after = 0.0, 0.0
                    for j in range(nv):
                        before -= R[b, m, j] * pos[j]
                        after -= R[b, m, j] * q[j]
                    grown = fiber[m] * (1.0 + half * slopes[b, m, 2]) + half * slopes[b, m, 3] * before
                    kept[m] = grown / (1.0 - half * slopes[b, m, 2])
                    for i in range(nv):
                        rhs[i] += R[b, m, i] * slopes[b, m, 0] * (kept[m] + pliant[m] * after)
                for i in range(nv):
                    acc[i] = 0.0
                    for j in range(nv):
                        acc[i] += inverse[i, j] * rhs[j]
                    vel[i] = v[i] + half * acc[i]
                    pos[i] = q[i] + quarter * acc[i]
                for m in range(n):
                    fiber[m] = kept[m]
                    for j in range(nv):
                        fiber[m] -= pliant[m] * R[b, m, j] * pos[j]
            for i in range(nv):
                end[i, c] = acc[i] + kv[b, i] * vel[i] + kp[b, i] * pos[i]
        for i in range(nv):
            for j in range(nv):
                ramp[i, j] = end[i, n + nv + j]
        inverse_of(ramp, used)
        for i in range(nv):
            wanted[b, i], Q[b, i] = 0.0, 0.0
            for c in range(n + nv):
                total = 0.0
                for j in range(nv):
                    total += used[i, j] * end[j, c]
                answers[b, i, c] = total
            for j in range(nv):
                wanted[b, i] += used[i, j] * r[b, j]
                Q[b, i] += answers[b, i, n + j] * s_end[b, j]
            for m in range(n):
                Q[b, i] += R[b, m, i] * gain[b, m] * x_end[b, m]

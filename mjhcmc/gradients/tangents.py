"""The derivative of one control window: how its end answers to its start, its inputs and parameters.

Along the stages of MuJoCo's Runge-Kutta steps as they were taken (``mj_RungeKutta``, four of them), so that this is the
derivative of the steps themselves, not of the motion that they approximate.
"""

import numba
import numpy as np

from mjhcmc.sensitivity import fill_response

_MIN = 1e-15  # mjMINVAL
_TIED = 1e-9  # of activation: excitation and activation are the same


@numba.njit(cache=True, error_model="numpy", nogil=True)
def activation_slopes(a, u, prm, limits, slopes):  # type: ignore[no-untyped-def]
    """Fill slopes (k, n_muscle, 5) of the rate of activation: by a and u (1/s), by tau_act and tau_deact (1/s^2).

    The derivative of `activation.rate_of`. The last is again that by a, where a follows a change of u: where u = a at a
    limit of excitation, u can only go away from the limit, and a, by itself, from u. Elsewhere where u = a, the
    derivative is that of falling activation.

    Args:
        a: (k, n_muscle) activation.
        u: (k, n_muscle) excitation.
        prm: (n_muscle, 3) of activation dynamics.
        limits: (n_muscle, 2) of excitation.
        slopes: filled.
    """
    for s in range(a.shape[0]):
        for i in range(a.shape[1]):
            act, deact, smooth = prm[i, 0], prm[i, 1], prm[i, 2]
            inside = 1.0 if 0.0 <= a[s, i] <= 1.0 else 0.0  # from an end it can only go inside
            effort = 0.5 + 1.5 * min(1.0, max(0.0, a[s, i]))
            rise, fall = act * effort, deact / effort
            rise_slope, fall_slope = 1.5 * act * inside, -1.5 * deact / effort**2 * inside
            gap = min(1.0, max(0.0, u[s, i])) - a[s, i]
            blend, steep = 0.0, 0.0
            if smooth < _MIN:
                blend = 1.0 if gap > 0.0 else 0.0
            else:
                x = gap / smooth + 0.5
                if x >= 1.0:
                    blend = 1.0
                elif x > 0.0:
                    blend = x * x * x * (3.0 * x * (2.0 * x - 5.0) + 10.0)
                    steep = 30.0 * x * x * (1.0 - x) * (1.0 - x) / smooth
            tau = max(_MIN, fall + (rise - fall) * blend)
            by_tau = -gap / (tau * tau)
            by_gap = (rise - fall) * steep
            slopes[s, i, 0] = -1.0 / tau + by_tau * (fall_slope + (rise_slope - fall_slope) * blend - by_gap)
            slopes[s, i, 1] = 1.0 / tau + by_tau * by_gap
            slopes[s, i, 4] = slopes[s, i, 0]
            slopes[s, i, 2] = by_tau * effort * blend
            slopes[s, i, 3] = by_tau * (1.0 - blend) / effort
            if smooth < _MIN and abs(gap) < _TIED:
                if u[s, i] < limits[i, 0] + _TIED:
                    slopes[s, i, 0], slopes[s, i, 1] = -1.0 / max(_MIN, fall), 1.0 / max(_MIN, rise)
                    slopes[s, i, 4] = -slopes[s, i, 1]
                elif u[s, i] > limits[i, 1] - _TIED:
                    slopes[s, i, 0], slopes[s, i, 1] = -1.0 / max(_MIN, rise), 1.0 / max(_MIN, fall)
                    slopes[s, i, 4] = -slopes[s, i, 1]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def propagate(Jq, Jv, Ja, Js, Jp, rates, times, h, dq, dv, da):  # type: ignore[no-untyped-def]
    """Take tangents through one window in place: columns of excitation (n), reserve (nv), then parameters (p).

    With x = (q, v, a), stage by stage: dq' = dv, dv' = Jq dq + Jv dv + Ja da + (Js ds | Jp), da' = f_a da + f_u du.

    Args:
        Jq: (n_step, 4, nv, nv) 1/s^2, slopes of the acceleration by position.
        Jv: (n_step, 4, nv, nv) 1/s, by velocity.
        Ja: (n_step, 4, nv, n) by activation.
        Js: (n_step, 4, nv, nv) 1/(kg m^2), by reserve.
        Jp: (n_step, 4, nv, p) by parameter.
        rates: (n_step, 4, n, 5) see `activation_slopes`.
        times: (p, 2) -1, or the muscle whose tau_act, or tau_deact, the parameter is.
        h: s, physics step.
        dq: (nv, n + nv + p).
        dv: likewise.
        da: (n, n + nv + p).
    """
    n_step, _, nv, n = Ja.shape
    columns = dq.shape[1]
    kq, kv, ka = np.empty((4, nv)), np.empty((4, nv)), np.empty((4, n))
    q, v, a = np.empty(nv), np.empty(nv), np.empty(n)
    for c in range(columns):
        p = c - n - nv
        for j in range(n_step):
            for s in range(4):
                way = 0.0 if s == 0 else (h if s == 3 else h / 2)
                for i in range(nv):
                    q[i], v[i] = dq[i, c], dv[i, c]
                    if s > 0:
                        q[i] += way * kq[s - 1, i]
                        v[i] += way * kv[s - 1, i]
                for m in range(n):
                    a[m] = da[m, c] + (way * ka[s - 1, m] if s > 0 else 0.0)
                    ka[s, m] = rates[j, s, m, 4 if c < n else 0] * a[m]
                if c < n:
                    ka[s, c] += rates[j, s, c, 1]
                elif p >= 0:
                    for kind in range(2):
                        if times[p, kind] >= 0:
                            ka[s, times[p, kind]] += rates[j, s, times[p, kind], 2 + kind]
                for i in range(nv):
                    kq[s, i] = v[i]
                    total = 0.0
                    if p >= 0:
                        total = Jp[j, s, i, p]
                    elif c >= n:
                        total = Js[j, s, i, c - n]
                    for k in range(nv):
                        total += Jq[j, s, i, k] * q[k] + Jv[j, s, i, k] * v[k]
                    for m in range(n):
                        total += Ja[j, s, i, m] * a[m]
                    kv[s, i] = total
            for i in range(nv):
                dq[i, c] += h * (kq[0, i] + 2.0 * kq[1, i] + 2.0 * kq[2, i] + kq[3, i]) / 6.0
                dv[i, c] += h * (kv[0, i] + 2.0 * kv[1, i] + 2.0 * kv[2, i] + kv[3, i]) / 6.0
            for m in range(n):
                da[m, c] += h * (ka[0, m] + 2.0 * ka[1, m] + 2.0 * ka[2, m] + ka[3, m]) / 6.0


@numba.njit(cache=True, error_model="numpy", nogil=True)
def response_to_reserves(M, D, K, step, n_step, acc, vel, pos):  # type: ignore[no-untyped-def]
    """Fill acc, vel and pos (nv, nv): how HCMC's correction takes a window's end to answer to reserves."""
    fill_response(M, D, K, np.empty((M.shape[0], 0)), np.empty((n_step + 1, 0)), step, acc, vel, pos)

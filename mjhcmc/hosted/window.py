"""Hill muscles alone over a control window: what excitation makes of their forces while the path goes as expected.

The musculotendon's length follows the cubic through length and velocity at the window's ends. Forces are told as
effective activations x = (F - bias)/gain (see `hosted.muscle.gain_and_bias`): what a fiber that moves with its path
would be activated by. A rigid muscle's is its activation.
"""

import numba
import numpy as np

from mjhcmc.hosted.muscle import COMPLIANT, advance, compliant_force, rigid_force

_CHANGE = 1e-3  # of excitation: well above rounding, well below what matters
_ITERATIONS = 60
_QUICK = 8  # secant steps from the last two points, before it is the bracket's ends
_LEAST_REACH = 1e-4  # of F0: below, no excitation is worth it
_SLACK = 0.003  # of F0
_GENTLE = 0.2
_LEAST_CHANGE = 1e-9  # of F0: below, excitation does not move the force


@numba.njit(cache=True, error_model="numpy")
def _path(ends, share, T):  # type: ignore[no-untyped-def]
    """Length and velocity at a share of a window of T seconds; ends: length and velocity at its start, at its end."""
    L0, V0, L1, V1 = ends
    s = share
    length = L0 + s * (T * V0 + s * (3.0 * (L1 - L0) - T * (2.0 * V0 + V1) + s * (2.0 * (L0 - L1) + T * (V0 + V1))))
    velocity = V0 + s * (6.0 * (L1 - L0) / T - 2.0 * (2.0 * V0 + V1) + 3.0 * s * (2.0 * (L0 - L1) / T + V0 + V1))
    return length, velocity


@numba.njit(cache=True, error_model="numpy")
def _force_after(c, p, kind, prm, a, l, u, ends, h, n, forces):  # type: ignore[no-untyped-def]  # noqa: E741
    """Force (N) after n steps of h seconds; forces (n + 1) is filled with that at each, where it has room."""
    path, T = np.empty(3), n * h
    for k in range(n):
        for half in range(3):
            path[half] = _path(ends, (k + 0.5 * half) / n, T)[0]
        if forces.size:
            forces[k] = _force(c, p, kind, a, l, ends, k / n, T)
        a, l = advance(c, p, kind, prm, a, l, u, path, h)  # noqa: E741
    force = _force(c, p, kind, a, l, ends, 1.0, T)
    if forces.size:
        forces[n] = force
    return force


@numba.njit(cache=True, error_model="numpy")
def _force(c, p, kind, a, l, ends, share, T):  # type: ignore[no-untyped-def]  # noqa: E741
    L, V = _path(ends, share, T)
    return compliant_force(c, p, l, L) if kind == COMPLIANT else rigid_force(c, p, a, L, V)


@numba.njit(cache=True, error_model="numpy")
def _highest(c, p, kind, l, L, low, high):  # type: ignore[no-untyped-def]  # noqa: E741
    """Highest excitation that a window may ask for: little where the tendon is slack at its start.

    Force shows late there. What would bring a little of it within the window brings far too much after it.
    """
    if kind == COMPLIANT and compliant_force(c, p, l, L) < _SLACK * p[0]:
        return max(low, min(high, _GENTLE))
    return high


@numba.njit(cache=True, error_model="numpy", nogil=True)
def reach(  # type: ignore[no-untyped-def]
    first, last, kind, curves, p, prm, limits, activation, fiber, u, start, end, gain, bias, force, tried, h, n_step,
    low, high, forces, shift, x, phi,
):  # fmt: skip
    """Fill what can be reached within a window, and how force builds up.

    Args:
        first: of the simulations of the call.
        last: past the last one.
        kind: the tendons.
        curves: see `hosted.curves`.
        p: (b, n, 6).
        prm: (b, n, 3) activation dynamics.
        limits: (b, n, 2) of excitation.
        activation: (b, n) at the window's start.
        fiber: (b, n) m there, or (b, 0).
        u: (b, n) excitation of the trial.
        start: (b, n, 2) m and m/s, the path at the window's start.
        end: (b, n, 2) at its end.
        gain: (b, n) N at its end.
        bias: (b, n) N at its end.
        force: (b, n) N at the trial's end.
        tried: whether there was a trial; else its end is where the window is expected to end, whatever the force there.
        h: s.
        n_step: steps.
        low: (b, n) effective activation reached by the lowest excitation, filled.
        high: (b, n) by the highest, filled.
        forces: (b, n, 4) N, those forces of the muscle alone, that of the trial's excitation, and its slope over
            excitation; filled.
        shift: (b, n) N, what the trial gave beyond the muscle alone, filled; 0 without one.
        x: (b, n) the trial's effective activation, filled.
        phi: (b, n_step + 1, n) filled: how a small change of excitation builds up in force, 1 at the end.
    """
    one, other, none, ends = np.empty(n_step + 1), np.empty(n_step + 1), np.empty(0), np.empty(4)
    for s in range(first, last):
        for i in range(gain.shape[1]):
            m, dyn, a = p[s, i], prm[s, i], activation[s, i]
            l = fiber[s, i] if kind == COMPLIANT else 0.0  # noqa: E741
            ends[0], ends[1], ends[2], ends[3] = start[s, i, 0], start[s, i, 1], end[s, i, 0], end[s, i, 1]
            near = u[s, i] + _CHANGE if u[s, i] < 0.5 else u[s, i] - _CHANGE
            alone = _force_after(curves, m, kind, dyn, a, l, u[s, i], ends, h, n_step, one)
            moved = _force_after(curves, m, kind, dyn, a, l, near, ends, h, n_step, other)
            for k in range(n_step + 1):
                phi[s, k, i] = k / n_step
                if abs(moved - alone) > _LEAST_CHANGE * m[0]:
                    phi[s, k, i] = (other[k] - one[k]) / (moved - alone)
            shift[s, i] = force[s, i] - alone if tried else 0.0
            forces[s, i, 2], forces[s, i, 3] = alone, (moved - alone) / (near - u[s, i])
            x[s, i] = (force[s, i] - bias[s, i]) / gain[s, i]
            least, most = limits[s, i]
            most = _highest(curves, m, kind, l, ends[0], least, most)
            forces[s, i, 0] = _force_after(curves, m, kind, dyn, a, l, least, ends, h, n_step, none)
            forces[s, i, 1] = _force_after(curves, m, kind, dyn, a, l, most, ends, h, n_step, none)
            low[s, i] = (forces[s, i, 0] + shift[s, i] - bias[s, i]) / gain[s, i]
            high[s, i] = max((forces[s, i, 1] + shift[s, i] - bias[s, i]) / gain[s, i], low[s, i])


@numba.njit(cache=True, error_model="numpy", nogil=True)
def excite(  # type: ignore[no-untyped-def]
    first, last, kind, curves, p, prm, limits, activation, fiber, goal, start, end, h, n_step, tried, forces, close, u
):
    """Fill u (b, n): the excitation whose window ends in the goal force (b, n) N of the muscle alone, or nearest to it.

    Force rises with excitation. From where the trial's slope points, by the secant method within a bracket (Illinois).
    The rest as `reach`; tried is the trial's excitation (b, n), close what of F0 may be missed.
    """
    none, ends = np.empty(0), np.empty(4)
    for s in range(first, last):
        for i in range(goal.shape[1]):
            m, target = p[s, i], goal[s, i]
            low, high = limits[s, i]
            l = fiber[s, i] if kind == COMPLIANT else 0.0  # noqa: E741
            high = _highest(curves, m, kind, l, start[s, i, 0], low, high)
            f_low, f_high = forces[s, i, 0] - target, forces[s, i, 1] - target
            if not (f_low < 0.0 and f_high - f_low > _LEAST_REACH * m[0]):  # a slack tendon tells nothing of activation
                u[s, i] = low if f_high >= f_low else np.nan
                continue
            if not f_high > 0.0:
                u[s, i] = high if f_high <= 0.0 else np.nan
                continue
            ends[0], ends[1], ends[2], ends[3] = start[s, i, 0], start[s, i, 1], end[s, i, 0], end[s, i, 1]
            last_u, last_f, slope = tried[s, i], forces[s, i, 2] - target, forces[s, i, 3]
            guess, side = last_u, 0
            if abs(last_f) > close * m[0]:
                if last_f < 0.0 and last_u > low:
                    low, f_low = last_u, last_f
                elif last_f > 0.0 and last_u < high:
                    high, f_high = last_u, last_f
                for step in range(_ITERATIONS):
                    guess = last_u - last_f / slope
                    if not low < guess < high or step > _QUICK:
                        guess = (low * f_high - high * f_low) / (f_high - f_low)
                        if step % 16 == 15:  # guard against a stalled secant
                            guess = 0.5 * (low + high)
                    f = (
                        _force_after(curves, m, kind, prm[s, i], activation[s, i], l, guess, ends, h, n_step, none)
                        - target
                    )
                    if abs(f) <= close * m[0] or high - low < 1e-14:
                        break
                    slope = (f - last_f) / (guess - last_u)
                    last_u, last_f = guess, f
                    if f < 0.0:
                        low, f_low = guess, f
                        f_high *= 0.5 if side == -1 else 1.0
                        side = -1
                    else:
                        high, f_high = guess, f
                        f_low *= 0.5 if side == 1 else 1.0
                        side = 1
            u[s, i] = guess

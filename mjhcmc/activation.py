"""Excitation and activation over one control window: the plant's map and its inverse.

The activation dynamics are those of Thelen (2003), doi 10.1115/1.1531112, as MuJoCo has them, with Millard's
smoothing (``tausmooth``). The map composes MuJoCo's steps, RK4's four stages or a single Euler step (which all other
integrators take, see `integrators`), so it is the plant's own to rounding error.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError
from mjhcmc.integrators import scheme_of

_MIN = 1e-15  # mjMINVAL
_ITERATIONS = 200
_CLOSE = 1e-15  # of activation: rounding


@numba.njit(cache=True, error_model="numpy")
def rate_of(a: float, u: float, act: float, deact: float, smooth: float) -> float:
    """Rate of activation, 1/s."""
    u = min(1.0, max(0.0, u))
    clamped = min(1.0, max(0.0, a))
    rise = act * (0.5 + 1.5 * clamped)
    fall = deact / (0.5 + 1.5 * clamped)
    gap = u - a
    if smooth < _MIN:
        tau = rise if gap > 0.0 else fall
    else:
        x = gap / smooth + 0.5
        blend = 0.0 if x <= 0.0 else 1.0 if x >= 1.0 else x * x * x * (3.0 * x * (2.0 * x - 5.0) + 10.0)
        tau = fall + (rise - fall) * blend
    return gap / max(_MIN, tau)


@numba.njit(cache=True, error_model="numpy")
def advance_one(
    a: float, u: float, act: float, deact: float, smooth: float, h: float, n: int, euler: bool = False
) -> float:
    """Activation after n RK4 (or Euler) steps of length h under constant excitation."""
    if euler:
        for _ in range(n):
            a += h * rate_of(a, u, act, deact, smooth)
        return a
    for _ in range(n):
        k1 = rate_of(a, u, act, deact, smooth)
        k2 = rate_of(a + 0.5 * h * k1, u, act, deact, smooth)
        k3 = rate_of(a + 0.5 * h * k2, u, act, deact, smooth)
        k4 = rate_of(a + h * k3, u, act, deact, smooth)
        a += h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    return a


@numba.njit(cache=True, error_model="numpy")
def invert_one(
    a: float,
    target: float,
    low: float,
    high: float,
    a_low: float,
    a_high: float,
    act: float,
    deact: float,
    smooth: float,
    h: float,
    n: int,
    close: float,
    euler: bool,
) -> float:
    """The excitation in [low, high] whose window ends nearest to the target activation.

    a_low and a_high are the activations that low and high lead to, ``close`` what of activation may be missed. A
    bracketed secant search (Illinois): the map is monotone in u. Its kink is where u = a, which leaves activation as it
    is: the search stays on one side.
    """
    f_low, f_high = a_low - target, a_high - target
    if f_low >= 0.0:
        return low
    if f_high <= 0.0:
        return high
    if low < a < high:
        if a > target:
            high, f_high = a, a - target
        elif a < target:
            low, f_low = a, a - target
        else:
            return a
    side = 0
    for i in range(_ITERATIONS):
        u = (low * f_high - high * f_low) / (f_high - f_low)
        if not low < u < high or i % 16 == 15:  # guard against a stalled secant
            u = 0.5 * (low + high)
        f = advance_one(a, u, act, deact, smooth, h, n, euler) - target
        if abs(f) < close or high - low < _CLOSE:
            return u
        if f < 0.0:
            low, f_low = u, f
            if side == -1:
                f_high *= 0.5
            side = -1
        else:
            high, f_high = u, f
            if side == 1:
                f_low *= 0.5
            side = 1
    return 0.5 * (low + high)


@numba.njit(cache=True, error_model="numpy")
def _advance_all(a, u, prm, h, n, euler, out):  # type: ignore[no-untyped-def]
    for i in range(a.size):
        out[i] = advance_one(a[i], u[i], prm[i, 0], prm[i, 1], prm[i, 2], h, n, euler)


@numba.njit(cache=True, error_model="numpy")
def _invert_all(a, target, low, high, prm, h, n, euler, out):  # type: ignore[no-untyped-def]
    for i in range(a.size):
        act, deact, smooth = prm[i]
        a_low = advance_one(a[i], low[i], act, deact, smooth, h, n, euler)
        a_high = advance_one(a[i], high[i], act, deact, smooth, h, n, euler)
        out[i] = invert_one(a[i], target[i], low[i], high[i], a_low, a_high, act, deact, smooth, h, n, _CLOSE, euler)


def activation_after(
    activation: NDArray[np.float64],
    excitation: NDArray[np.float64],
    parameters: NDArray[np.float64],
    step: float,
    n_step: int,
    integrator: str = "rk4",
) -> NDArray[np.float64]:
    """Activation at the end of a window under constant excitation.

    a' = (u - a)/tau(a, u), tau = tau_act (.5 + 1.5 a) where u > a, else tau_deact/(.5 + 1.5 a), integrated by
    n_step classical Runge-Kutta steps, or Euler steps under any other integrator, as `mujoco.mj_step` does.

    Args:
        activation: (n_muscle,) at the start of the window.
        excitation: (n_muscle,) held over the window.
        parameters: (n_muscle, 3) tau_act s, tau_deact s, smoothing width.
        step: s, length of a physics step.
        n_step: physics steps in the window.
        integrator: of the plant, see `integrators`.

    Returns:
        (n_muscle,) activation at the end.

    Raises:
        SettingsError: arrays of different lengths, a step that is not positive, no step, or an unknown integrator.
    """
    a, u, prm = _arrays(activation, excitation, parameters, step, n_step)
    out = np.empty_like(a)
    _advance_all(a, u, prm, step, n_step, scheme_of(integrator).first_order, out)
    return out


def excitation_for(
    activation: NDArray[np.float64],
    target: NDArray[np.float64],
    parameters: NDArray[np.float64],
    step: float,
    n_step: int,
    excitation_range: NDArray[np.float64] | None = None,
    integrator: str = "rk4",
) -> NDArray[np.float64]:
    """The excitation whose window ends at the target activation: the inverse of `activation_after`.

    Args:
        activation: (n_muscle,) at the start of the window.
        target: (n_muscle,) wanted at the end; beyond what can be reached, the excitation saturates.
        parameters: (n_muscle, 3) tau_act s, tau_deact s, smoothing width.
        step: s, length of a physics step.
        n_step: physics steps in the window.
        excitation_range: (n_muscle, 2) lowest and highest excitation; 0 and 1 by default.
        integrator: as `activation_after`.

    Returns:
        (n_muscle,) excitation within its range.

    Raises:
        SettingsError: as `activation_after`.
    """
    a, goal, prm = _arrays(activation, target, parameters, step, n_step)
    limits = np.tile([0.0, 1.0], (a.size, 1)) if excitation_range is None else np.asarray(excitation_range)
    out = np.empty_like(a)
    low, high = np.ascontiguousarray(limits.T, dtype=float)  # one layout, however many: compiled once
    _invert_all(a, goal, low, high, prm, step, n_step, scheme_of(integrator).first_order, out)
    return out


def _arrays(
    activation: NDArray[np.float64],
    second: NDArray[np.float64],
    parameters: NDArray[np.float64],
    step: float,
    n_step: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    a = np.ascontiguousarray(activation, dtype=np.float64)
    b = np.ascontiguousarray(second, dtype=np.float64)
    prm = np.ascontiguousarray(parameters, dtype=np.float64)
    if a.ndim != 1 or b.shape != a.shape or prm.shape != (a.size, 3):
        raise SettingsError(
            f"activation {a.shape}, excitation or target {b.shape} and parameters {prm.shape} must have the shapes "
            "(n_muscle,), (n_muscle,), (n_muscle, 3)"
        )
    if not (math.isfinite(step) and step > 0) or n_step < 1:
        raise SettingsError(f"a window needs a positive step and at least one; got step {step:g} s, {n_step} steps")
    return a, b, prm

"""MuJoCo's muscle actuator in NumPy: gain, bias and activation dynamics, number for number.

MuJoCo's muscle has a rigid tendon and no pennation, and scales lengths by the range that it works in:
L0 = (lengthrange1 - lengthrange0) / (range1 - range0), L = range0 + (length - lengthrange0) / L0,
V = velocity / (L0 vmax).
Actuator force = gain x activation + bias, negative since a muscle pulls.

Reference: E. Todorov, T. Erez, Y. Tassa, "MuJoCo: a physics engine for model-based control", IROS 2012, 5026-5033,
doi:10.1109/IROS.2012.6386109, and MuJoCo's documentation (Modeling, "Muscles").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.errors import HillError
from mjhcmc.hill.mujoco_curves import active_shape, passive_shape, velocity_shape

Array = NDArray[np.float64]

_TINY = 1e-15
"""MuJoCo's mjMINVAL, below which it lets no divisor fall."""


def mujoco_gain(
    length: ArrayLike, velocity: ArrayLike, lengthrange: ArrayLike, acc0: ArrayLike, parameters: ArrayLike
) -> Array:
    """MuJoCo's actuator gain of a muscle: -F0 FL(L) FV(V), to be multiplied by activation. As mju_muscleGain.

    Args:
        length: Actuator lengths (..., m), m.
        velocity: Actuator velocities (..., m), m/s.
        lengthrange: Range of lengths (m, 2) or (2,), m.
        acc0: Acceleration at unit force (m,) or a number, read where the force parameter is negative.
        parameters: (m, 9) or (9,): range0, range1, force, scale, lmin, lmax, vmax, fpmax, fvmax.

    Returns:
        Gain (..., m), N, negative: a muscle pulls.

    Raises:
        HillError: Parameters that make no muscle.
    """
    p = _read(lengthrange, parameters)
    normal = p.range0 + (np.asarray(length, dtype=np.float64) - p.shortest) / np.maximum(p.optimal, _TINY)
    speed = np.asarray(velocity, dtype=np.float64) / np.maximum(p.optimal * p.vmax, _TINY)
    return -p.force(acc0) * active_shape(normal, p.lmin, p.lmax)[0] * velocity_shape(speed, p.fvmax)[0]


def mujoco_bias(length: ArrayLike, lengthrange: ArrayLike, acc0: ArrayLike, parameters: ArrayLike) -> Array:
    """MuJoCo's actuator bias of a muscle: its passive force -F0 FP(L). As mju_muscleBias.

    Args:
        length: Actuator lengths (..., m), m.
        lengthrange: Range of lengths (m, 2) or (2,), m.
        acc0: Acceleration at unit force (m,) or a number, read where the force parameter is negative.
        parameters: (m, 9) or (9,): range0, range1, force, scale, lmin, lmax, vmax, fpmax, fvmax.

    Returns:
        Bias (..., m), N, not positive.

    Raises:
        HillError: Parameters that make no muscle.
    """
    p = _read(lengthrange, parameters)
    normal = p.range0 + (np.asarray(length, dtype=np.float64) - p.shortest) / np.maximum(p.optimal, _TINY)
    return -p.force(acc0) * passive_shape(normal, p.lmax, p.fpmax)[0]


def mujoco_activation_rate(excitation: ArrayLike, activation: ArrayLike, parameters: ArrayLike) -> Array:
    """MuJoCo's activation dynamics with ``tausmooth``. As mju_muscleDynamics.

    (u - a) / tau with tau_act (.5 + 1.5 a) while u > a, tau_deact / (.5 + 1.5 a) otherwise; with a smoothing width
    w > 0 the one passes into the other by the quintic 6 x^5 - 15 x^4 + 10 x^3 of x = (u - a) / w + .5. MuJoCo reads an
    excitation outside [0, 1] as the nearer end, and takes the time constants of an activation outside [0, 1] from the
    nearer end too; so does this function, alone in this package.

    Args:
        excitation: (..., m).
        activation: (..., m).
        parameters: tau_act, tau_deact (s) and smoothing width, (3,) or (m, 3).

    Returns:
        da/dt (..., m), 1/s.
    """
    tau_act, tau_deact, width = np.moveaxis(np.asarray(parameters, dtype=np.float64), -1, 0)
    a = np.asarray(activation, dtype=np.float64)
    drive = np.clip(np.asarray(excitation, dtype=np.float64), 0.0, 1.0) - a
    effort = 0.5 + 1.5 * np.clip(a, 0.0, 1.0)
    rising, falling = tau_act * effort, tau_deact / effort
    x = np.clip(drive / np.maximum(width, _TINY) + 0.5, 0.0, 1.0)
    blend = np.where(width < _TINY, drive > 0, x**3 * (3.0 * x * (2.0 * x - 5.0) + 10.0))
    return np.asarray(drive / np.maximum(falling + (rising - falling) * blend, _TINY))


@dataclass(frozen=True)
class _Read:
    """Columns of MuJoCo's parameters."""

    shortest: Array
    optimal: Array
    range0: Array
    peak: Array
    scale: Array
    lmin: Array
    lmax: Array
    vmax: Array
    fpmax: Array
    fvmax: Array

    def force(self, acc0: ArrayLike) -> Array:
        """Maximum isometric force; scale over acc0 where the parameter is negative, as in MuJoCo."""
        automatic = self.scale / np.maximum(np.asarray(acc0, dtype=np.float64), _TINY)
        return np.where(self.peak < 0, automatic, self.peak)


def _read(lengthrange: ArrayLike, parameters: ArrayLike) -> _Read:
    p, limits = np.asarray(parameters, dtype=np.float64), np.asarray(lengthrange, dtype=np.float64)
    if p.shape[-1:] != (9,) or limits.shape[-1:] != (2,):
        raise HillError(
            f"MuJoCo muscle: parameters have shape {p.shape} and lengthrange {limits.shape}: give (m, 9) and (m, 2)"
        )
    range0, range1, peak, scale, lmin, lmax, vmax, fpmax, fvmax = np.moveaxis(p, -1, 0)
    for name, bad in (
        ("range", range1 <= range0),
        ("lmin", lmin >= 1),
        ("lmax", lmax <= 1),
        ("vmax", vmax <= 0),
        ("fvmax", fvmax <= 1),
        ("parameters", ~np.isfinite(p).all(axis=-1)),
    ):
        if np.any(bad):
            row = p.reshape(-1, 9)[int(np.flatnonzero(bad)[0])].tolist()
            raise HillError(f"MuJoCo muscle {int(np.flatnonzero(bad)[0])}: {name} makes no muscle in {row}")
    optimal = (limits[..., 1] - limits[..., 0]) / np.maximum(range1 - range0, _TINY)
    return _Read(limits[..., 0], optimal, range0, peak, scale, lmin, lmax, vmax, fpmax, fvmax)

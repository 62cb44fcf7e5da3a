"""Activation dynamics: how activation follows excitation, in each model's form and with its constants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.errors import HillError
from mjhcmc.hill.mujoco_muscle import mujoco_activation_rate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FirstOrderActivation:
    """da/dt = (u - a) / tau; tau = tau_act (.5 + 1.5 a) while u > a, tau_deact / (.5 + 1.5 a) otherwise.

    Thelen (2003), doi:10.1115/1.1531112; Millard et al. (2013), doi:10.1115/1.4023390. With ``smoothing`` w > 0 the
    time constants pass into each other over abs(u - a) < w/2, as with MuJoCo's ``tausmooth``. OpenSim lifts excitation
    and activation to its least activation (.01) first: for that, give excitations of .01 and more.

    Attributes:
        tau_act: Activation time constant, s.
        tau_deact: Deactivation time constant, s.
        smoothing: Width over which the time constants blend.
    """

    tau_act: float = 0.01
    tau_deact: float = 0.04
    smoothing: float = 0.0

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        _check_constants(self, self.tau_act, self.tau_deact)
        if not 0 <= self.smoothing < np.inf:
            raise HillError(f"FirstOrderActivation: smoothing is {self.smoothing!r}: give a number of 0 or more")

    def rate(self, excitation: ArrayLike, activation: ArrayLike) -> Array:
        """da/dt, 1/s.

        Args:
            excitation: Any shape, from 0 to 1.
            activation: A shape that broadcasts with it, from 0 to 1.

        Raises:
            HillError: Naming the value outside and its index.
        """
        u, a = _within(excitation, activation)
        return mujoco_activation_rate(u, a, np.array([self.tau_act, self.tau_deact, self.smoothing]))


@dataclass(frozen=True)
class SmoothActivation:
    """da/dt = [(f + .5) / (tau_act z) + (.5 - f) z / tau_deact] (u - a), z = .5 + 1.5 a, f = .5 tanh(b (u - a)).

    De Groote et al. (2016), doi:10.1007/s10439-016-1591-9, with b = .1.

    Attributes:
        tau_act: Activation time constant, s.
        tau_deact: Deactivation time constant, s.
        sharpness: b.
    """

    tau_act: float = 0.015
    tau_deact: float = 0.06
    sharpness: float = 0.1

    def __post_init__(self) -> None:
        """Check the constants.

        Raises:
            HillError: Naming the constant and its value.
        """
        _check_constants(self, self.tau_act, self.tau_deact)
        if not (np.isfinite(self.sharpness) and self.sharpness > 0):
            raise HillError(f"SmoothActivation: sharpness is {self.sharpness!r}: give a positive number")

    def rate(self, excitation: ArrayLike, activation: ArrayLike) -> Array:
        """da/dt, 1/s.

        Args:
            excitation: Any shape, from 0 to 1.
            activation: A shape that broadcasts with it, from 0 to 1.

        Raises:
            HillError: Naming the value outside and its index.
        """
        u, a = _within(excitation, activation)
        f, z = 0.5 * np.tanh(self.sharpness * (u - a)), 0.5 + 1.5 * a
        return ((f + 0.5) / (self.tau_act * z) + (0.5 - f) * z / self.tau_deact) * (u - a)


def _check_constants(dynamics: object, tau_act: float, tau_deact: float) -> None:
    for name, value in (("tau_act", tau_act), ("tau_deact", tau_deact)):
        if not (np.isfinite(value) and value > 0):
            raise HillError(f"{type(dynamics).__name__}: {name} is {value!r}: give a positive time in s")


def _within(excitation: ArrayLike, activation: ArrayLike) -> tuple[Array, Array]:
    """Both as arrays, held to [0, 1] and to shapes that fit."""
    u, a = np.asarray(excitation, dtype=np.float64), np.asarray(activation, dtype=np.float64)
    for name, array in (("excitation", u), ("activation", a)):
        outside = ~((array >= 0) & (array <= 1))
        if np.any(outside):
            index = tuple(np.argwhere(outside)[0].tolist())
            place = f" at index {index[0] if len(index) == 1 else index}" if index else ""
            raise HillError(f"{name}{place} is {array[index]:.6g}: give numbers from 0 to 1")
    try:
        np.broadcast_shapes(u.shape, a.shape)
    except ValueError:
        raise HillError(f"excitation has shape {u.shape} and activation {a.shape}: give shapes that fit") from None
    return u, a


THELEN_ACTIVATION = FirstOrderActivation(0.015, 0.05)
"""Constants of OpenSim's Thelen2003Muscle."""

MILLARD_ACTIVATION = FirstOrderActivation(0.01, 0.04)
"""Constants of OpenSim's Millard2012EquilibriumMuscle."""

DEGROOTE_FREGLY_ACTIVATION = SmoothActivation(0.015, 0.06)
"""Constants of De Groote et al. (2016)."""

MUJOCO_ACTIVATION = FirstOrderActivation(0.01, 0.04)
"""MuJoCo's default constants, ``tausmooth`` 0."""

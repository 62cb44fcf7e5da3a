"""MuJoCo's muscle curve parameters fitted to the Millard curves of the source.

MuJoCo's curves are evaluated by MuJoCo itself. Each is fitted by least squares over the range that fibers of leg8 work
in: lmin and lmax to the active force-length curve, fpmax to the passive one (with that lmax, which sets where MuJoCo's
passive curve turns straight), vmax and fvmax to the force-velocity curve.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.hill import (
    ActiveForceLength,
    ForceVelocity,
    PassiveForceLength,
    active_force_length,
    force_velocity,
    passive_force_length,
)

Array = NDArray[np.float64]

FIBER_LENGTHS: Array = np.linspace(0.4, 1.6, 241)
"""Normalised fiber lengths of the length fits."""

FIBER_VELOCITIES: Array = np.linspace(-1.0, 0.6, 161)
"""Fiber velocities of the velocity fit, in maximum fiber velocities, lengthening positive: fibers that lengthen faster
than .6 do not occur in the movements that leg8 is for."""


@dataclass(frozen=True)
class CurveFit:
    """Fitted curve parameters and what they leave.

    Attributes:
        lmin: Shortest fiber length with active force, optimal lengths.
        lmax: Longest fiber length with active force, optimal lengths.
        vmax: Fastest shortening, optimal lengths per second, for a muscle without pennation.
        fpmax: MuJoCo's passive force scale, maximum isometric forces.
        fvmax: Largest force while lengthening, maximum isometric forces.
        residual: Root mean square residual of each curve, maximum isometric forces.
    """

    lmin: float
    lmax: float
    vmax: float
    fpmax: float
    fvmax: float
    residual: Mapping[str, float]

    def parameters(self) -> dict[str, float]:
        """The five parameters, as the table keeps them."""
        return {name: getattr(self, name) for name in ("lmin", "lmax", "vmax", "fpmax", "fvmax")}


def mujoco_gain(length: Array, velocity: Array, parameters: Mapping[str, float]) -> Array:
    """MuJoCo's active force at full activation over F0, by MuJoCo's own function.

    Args:
        length: Normalised lengths (n,).
        velocity: Velocities (n,), optimal lengths per second, lengthening positive.
        parameters: lmin, lmax, vmax, fpmax, fvmax.

    Returns:
        Force over maximum isometric force (n,), pulling positive.
    """
    import mujoco

    prm, limits = _muscle_parameters(parameters), np.array([0.0, 1.0])
    values = [-mujoco.mju_muscleGain(x, v, limits, 1.0, prm) for x, v in zip(length, velocity, strict=True)]
    return np.array(values)


def mujoco_bias(length: Array, parameters: Mapping[str, float]) -> Array:
    """MuJoCo's passive force over F0 at normalised lengths (n,), pulling positive, by MuJoCo's own function."""
    import mujoco

    prm, limits = _muscle_parameters(parameters), np.array([0.0, 1.0])
    return np.array([-mujoco.mju_muscleBias(x, limits, 1.0, prm) for x in length])


def fit_curves(source: Mapping[str, Any]) -> CurveFit:
    """Fit MuJoCo's curve parameters to the source's Millard curves.

    Args:
        source: The ``source`` section of the table.

    Returns:
        The parameters, rounded to four significant digits, and their residuals.
    """
    curves = source["curves"]
    speed = source["muscle_common"]["max_fiber_velocity"]
    active = active_force_length(ActiveForceLength(**curves["active_force_length"]))
    passive = passive_force_length(PassiveForceLength(**curves["passive_force_length"]))
    velocity = force_velocity(ForceVelocity(**curves["force_velocity"]))
    still, rest = np.zeros_like(FIBER_LENGTHS), np.ones_like(FIBER_VELOCITIES)
    base = {"lmin": 0.5, "lmax": 1.6, "vmax": speed, "fpmax": 1.0, "fvmax": 1.2}

    def length_curve(p: Mapping[str, float]) -> Array:
        return mujoco_gain(FIBER_LENGTHS, still, p) - active(FIBER_LENGTHS)

    def passive_curve(p: Mapping[str, float]) -> Array:
        return mujoco_bias(FIBER_LENGTHS, p) - passive(FIBER_LENGTHS)

    def velocity_curve(p: Mapping[str, float]) -> Array:
        return mujoco_gain(rest, FIBER_VELOCITIES * speed, p) - velocity(FIBER_VELOCITIES)

    residual = {}
    for name, curve, free in (
        ("active_force_length", length_curve, ("lmin", "lmax")),
        ("passive_force_length", passive_curve, ("fpmax",)),
        ("force_velocity", velocity_curve, ("vmax", "fvmax")),
    ):
        base = _fit(curve, base, free)
        residual[name] = float(np.sqrt(np.mean(curve(base) ** 2)))
    return CurveFit(**base, residual=residual)


def _fit(
    curve: Callable[[Mapping[str, float]], Array], start: Mapping[str, float], free: tuple[str, ...]
) -> dict[str, float]:
    from scipy.optimize import least_squares

    def residual(x: Array) -> Array:
        return curve({**start, **dict(zip(free, x, strict=True))})

    best = least_squares(residual, [start[name] for name in free], xtol=1e-10, ftol=1e-12)
    return {**start, **{name: float(f"{x:.4g}") for name, x in zip(free, best.x, strict=True)}}


def _muscle_parameters(p: Mapping[str, float]) -> Array:
    """MuJoCo's gainprm of a muscle with unit force whose length is already normalised."""
    return np.array([0.0, 1.0, 1.0, 1.0, p["lmin"], p["lmax"], p["vmax"], p["fpmax"], p["fvmax"]])

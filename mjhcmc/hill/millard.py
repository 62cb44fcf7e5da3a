"""The curves of Millard, Uchida, Seth and Delp (2013): quintic Bezier splines.

Force balance of the model, damping beta = .1 (normalised by maximum isometric force and maximum fiber velocity):
(a fL(l) fV(v) + fPE(l) + beta v) cos(alpha) = fSE(lT).

Reference: M. Millard, T. Uchida, A. Seth, S. L. Delp, "Flexing computational muscle: modeling and simulation of
musculotendon dynamics", J. Biomech. Eng. 135(2), 021005, 2013, doi:10.1115/1.4023390. Defaults are the parameters given
there, but for the ones that say otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.hill.bezier import BezierCurve, Corner
from mjhcmc.hill.curves import Curves
from mjhcmc.hill.errors import HillError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ActiveForceLength:
    """Parameters of the active force-length curve; lengths in optimal fiber lengths.

    Attributes:
        min_norm_length: Length below which no active force arises.
        transition_norm_length: Where the steep part passes into the shallow ascending part.
        max_norm_length: Length above which no active force arises.
        shallow_ascending_slope: Slope of the shallow ascending part.
        minimum_value: Value outside the two limits.
    """

    min_norm_length: float = 0.4441
    transition_norm_length: float = 0.73
    max_norm_length: float = 1.8123
    shallow_ascending_slope: float = 0.8616
    minimum_value: float = 0.0


@dataclass(frozen=True)
class ForceVelocity:
    """Parameters of the force-velocity curve; velocities in maximum fiber velocities, lengthening positive."""

    concentric_slope_at_vmax: float = 0.0
    concentric_slope_near_vmax: float = 0.25
    isometric_slope: float = 5.0
    eccentric_slope_at_vmax: float = 0.0
    eccentric_slope_near_vmax: float = 0.15
    max_eccentric_multiplier: float = 1.4
    concentric_curviness: float = 0.6
    eccentric_curviness: float = 0.9


@dataclass(frozen=True)
class PassiveForceLength:
    """Parameters of the passive force-length curve; ``None`` takes the value that the strains imply.

    Attributes:
        strain_at_zero_force: Fiber strain at which passive force begins.
        strain_at_one_norm_force: Fiber strain at which it reaches the maximum isometric force.
        stiffness_at_low_force: Slope at the end of the toe; .2 where None.
        stiffness_at_one_norm_force: Slope at that strain; 2 over the strain between where None.
        curviness: Bend of the curve; .75 where None.
    """

    strain_at_zero_force: float = 0.0
    strain_at_one_norm_force: float = 0.7
    stiffness_at_low_force: float | None = None
    stiffness_at_one_norm_force: float | None = None
    curviness: float | None = None


def active_force_length(parameters: ActiveForceLength | None = None) -> BezierCurve:
    """The active force-length multiplier as a function of normalised fiber length (Millard et al. 2013, Fig. 3).

    Args:
        parameters: The curve's parameters; the paper's where None.
    """
    p = parameters or ActiveForceLength()
    shoulder = 0.05  # half width of the plateau's rounding, in optimal lengths
    low, transition, high = p.min_norm_length, p.transition_norm_length, p.max_norm_length
    # The shallow line ends at height 1 one shoulder before the optimum; its middle is a corner.
    y_transition = 1.0 - p.shallow_ascending_slope * (1.0 - shoulder - transition)
    x_shallow = (transition + 1.0 - shoulder) / 2
    x_rise, y_rise = (low + transition) / 2, y_transition / 2
    x_fall = (1.0 + shoulder + high) / 2
    return BezierCurve(
        [
            Corner(low, p.minimum_value, 0.0),
            Corner(x_rise, y_rise, 1.25 * y_transition / (transition - low)),
            Corner(x_shallow, (1.0 + y_transition) / 2, p.shallow_ascending_slope),
            Corner(1.0, 1.0, 0.0),
            Corner(x_fall, 0.5, -1.0 / (high - 1.0 - 2 * shoulder)),
            Corner(high, p.minimum_value, 0.0),
        ],
        curviness=1.0,
    )


def force_velocity(parameters: ForceVelocity | None = None) -> BezierCurve:
    """The force-velocity multiplier as a function of normalised fiber velocity, lengthening positive.

    Args:
        parameters: The curve's parameters; the paper's where None.
    """
    p = parameters or ForceVelocity()
    near = 0.9  # where "near" the maximum velocity is
    gap = 1.0 - near
    slow = (p.concentric_slope_near_vmax + p.concentric_slope_at_vmax) / 2 * gap
    fast = (p.eccentric_slope_near_vmax + p.eccentric_slope_at_vmax) / 2 * gap
    return BezierCurve(
        [
            Corner(-1.0, 0.0, p.concentric_slope_at_vmax),
            Corner(-near, slow, p.concentric_slope_near_vmax),
            Corner(0.0, 1.0, p.isometric_slope),
            Corner(near, p.max_eccentric_multiplier - fast, p.eccentric_slope_near_vmax),
            Corner(1.0, p.max_eccentric_multiplier, p.eccentric_slope_at_vmax),
        ],
        curviness=[p.concentric_curviness] * 2 + [p.eccentric_curviness] * 2,
    )


def passive_force_length(parameters: PassiveForceLength | None = None) -> BezierCurve:
    """The passive force-length multiplier as a function of normalised fiber length.

    Args:
        parameters: The curve's parameters; the paper's where None.
    """
    p = parameters or PassiveForceLength()
    span = p.strain_at_one_norm_force - p.strain_at_zero_force
    low = 0.2 if p.stiffness_at_low_force is None else p.stiffness_at_low_force
    high = 2.0 / span if p.stiffness_at_one_norm_force is None else p.stiffness_at_one_norm_force
    curviness = 0.75 if p.curviness is None else p.curviness
    zero = 1.0 + p.strain_at_zero_force
    toe = min(0.1 / high, 0.1 * span)
    return BezierCurve(
        [
            Corner(zero, 0.0, 0.0),
            Corner(zero + toe, low * toe / 2, low),
            Corner(1.0 + p.strain_at_one_norm_force, 1.0, high),
        ],
        curviness=curviness,
    )


@dataclass(frozen=True)
class TendonForceLength:
    """Parameters of the tendon curve, force over maximum isometric force; ``None`` takes 1.375 over the strain.

    Attributes:
        strain_at_one_norm_force: Tendon strain at the maximum isometric force.
        stiffness_at_one_norm_force: Slope there, over normalised tendon length; 1.375 over the strain where None.
        force_at_toe_end: Normalised force where the toe passes into the straight part.
        curviness: Bend of the toe.
    """

    strain_at_one_norm_force: float = 0.049
    stiffness_at_one_norm_force: float | None = None
    force_at_toe_end: float = 2 / 3
    curviness: float = 0.5


def tendon_force_length(parameters: TendonForceLength | None = None) -> BezierCurve:
    """Normalised tendon force as a function of tendon length over slack length: zero, toe, straight line.

    Args:
        parameters: The curve's parameters; the paper's where None.

    Raises:
        HillError: Parameters that make no rising curve.
    """
    p = parameters or TendonForceLength()
    strain, toe_force = p.strain_at_one_norm_force, p.force_at_toe_end
    if not (strain > 0 and 0 < toe_force < 1):
        raise HillError(f"tendon_force_length: {p}: strain must be positive and the toe's force between 0 and 1")
    stiffness = 1.375 / strain if p.stiffness_at_one_norm_force is None else p.stiffness_at_one_norm_force

    def straight(force: float) -> float:
        return 1.0 + strain + (force - 1.0) / stiffness

    # The toe's inner corner lies halfway along the line from its foot, a tenth of the toe's length from slack, to the
    # point at half the toe's force on the straight part.
    toe = straight(toe_force)
    foot = 1.0 + (toe - 1.0) / 10
    half = straight(toe_force / 2)
    return BezierCurve(
        [
            Corner(1.0, 0.0, 0.0),
            Corner((foot + half) / 2, toe_force / 4, toe_force / 2 / (half - foot)),
            Corner(toe, toe_force, stiffness),
        ],
        curviness=p.curviness,
    )


@dataclass(frozen=True)
class BezierForceVelocity:
    """A Bezier force-velocity curve as a Hill model takes it: the same at every activation."""

    curve: BezierCurve
    bounds: tuple[float, float]

    def __call__(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """The multiplier at normalised fiber velocity."""
        return self.curve(velocity)

    def derivative(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """Its slope over velocity."""
        return self.curve.derivative(velocity)

    def evaluate(self, velocity: ArrayLike, activation: ArrayLike = 1.0) -> tuple[Array, Array]:
        """Multiplier and slope together."""
        return self.curve.evaluate(velocity)

    def inverse(self, multiplier: ArrayLike, activation: ArrayLike = 1.0) -> Array:
        """The velocity with this multiplier: -1 at 0 and 1 at the largest, where the curve is flat.

        Raises:
            HillError: A multiplier outside ``bounds``.
        """
        return self.curve.inverse(multiplier)


def millard2012(
    active: ActiveForceLength | None = None,
    passive: PassiveForceLength | None = None,
    velocity: ForceVelocity | None = None,
    tendon: TendonForceLength | None = None,
) -> Curves:
    """The curves of Millard et al. (2013), known by their code's year as Millard 2012.

    Args:
        active: Active force-length parameters; the paper's where None.
        passive: Passive force-length parameters; the paper's where None.
        velocity: Force-velocity parameters; the paper's where None.
        tendon: Tendon parameters; the paper's where None.

    Raises:
        HillError: Parameters that make no curve.
    """
    a, v = active or ActiveForceLength(), velocity or ForceVelocity()
    low = 0.0 if v.concentric_slope_at_vmax <= 0 else -np.inf
    high = v.max_eccentric_multiplier if v.eccentric_slope_at_vmax <= 0 else np.inf
    return Curves(
        name="Millard 2012",
        active=active_force_length(a),
        passive=passive_force_length(passive),
        force_velocity=BezierForceVelocity(force_velocity(v), (low, high)),
        tendon=tendon_force_length(tendon),
        shortest_fiber=a.min_norm_length,
        fiber_damping=0.1,
    )

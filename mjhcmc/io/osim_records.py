"""The records of an OpenSim model: bodies, joints, muscles and their path points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mjhcmc.io.osim_functions import OsimFunction

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class OsimBody:
    """A rigid body.

    Attributes:
        name: Its name.
        mass: kg.
        mass_center: m, in the body's frame.
        inertia: Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the mass centre, kg m^2 (elements of the matrix).
    """

    name: str
    mass: float
    mass_center: Vec3
    inertia: tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class OsimCoordinate:
    """A generalized coordinate.

    Attributes:
        name: Its name.
        default: Its value where nothing else is said, rad or m.
        low: Lower end of its range, rad or m.
        high: Upper end of its range, rad or m.
    """

    name: str
    default: float
    low: float
    high: float


@dataclass(frozen=True)
class OsimAxis:
    """One of the six steps of a joint's motion.

    Attributes:
        is_rotation: A turn about the axis (rad), else a shift along it (m).
        axis: The axis.
        coordinate: The coordinate that moves it, or None.
        function: How far, as a function of the coordinate (of 0 where there is none).
    """

    is_rotation: bool
    axis: Vec3
    coordinate: str | None
    function: OsimFunction


@dataclass(frozen=True)
class OsimJoint:
    """A joint between two bodies.

    The child's joint frame in the parent's is turned by the rotations, one after the other, each about an axis of the
    frame that the ones before have turned, and shifted by the translations along axes of the parent's joint frame.

    Attributes:
        name: Its name.
        kind: Its type in OpenSim, such as PinJoint.
        parent: The parent body, or "ground".
        child: The child body.
        parent_pos: Origin of the joint's frame in the parent, m.
        parent_turn: Its orientation there, body-fixed x, y, z angles, rad.
        child_pos: Origin of the joint's frame in the child, m.
        child_turn: Its orientation there, body-fixed x, y, z angles, rad.
        coordinates: Its coordinates by name.
        axes: Rotations, then translations; None for a kind of joint that is not read.
    """

    name: str
    kind: str
    parent: str
    child: str
    parent_pos: Vec3
    parent_turn: Vec3
    child_pos: Vec3
    child_turn: Vec3
    coordinates: Mapping[str, OsimCoordinate]
    axes: tuple[OsimAxis, ...] | None


@dataclass(frozen=True)
class OsimPoint:
    """A point of a muscle's path.

    Attributes:
        name: Its name.
        body: The body that carries it.
        pos: m, in the body's frame; of a moving point the part that does not move.
        moves: By axis (0, 1, 2) the coordinate and the function that place a moving point, m.
        active: Coordinate, lower and upper end (rad) within which the path runs over the point; None for always.
    """

    name: str
    body: str
    pos: Vec3
    moves: Mapping[int, tuple[str, OsimFunction]]
    active: tuple[str, float, float] | None


@dataclass(frozen=True)
class OsimMuscle:
    """A Hill muscle.

    Attributes:
        name: Its name.
        kind: Its type in OpenSim, such as Millard2012EquilibriumMuscle.
        max_isometric_force: N.
        optimal_fiber_length: m.
        tendon_slack_length: m.
        pennation_angle: At optimal fiber length, rad.
        max_contraction_velocity: Optimal fiber lengths per second.
        activation_time: s.
        deactivation_time: s.
        fiber_damping: Force over max isometric force at the maximum velocity; 0 for muscles that have none.
        path: Its points, from origin to insertion.
        wraps: Names of the objects that it wraps over.
    """

    name: str
    kind: str
    max_isometric_force: float
    optimal_fiber_length: float
    tendon_slack_length: float
    pennation_angle: float
    max_contraction_velocity: float
    activation_time: float
    deactivation_time: float
    fiber_damping: float
    path: tuple[OsimPoint, ...]
    wraps: tuple[str, ...]


@dataclass(frozen=True)
class OsimModel:
    """An OpenSim model.

    Attributes:
        path: The file.
        name: The model's name.
        version: Version of the document, such as 30000 or 40600.
        gravity: m/s^2, in ground.
        bodies: By name, without ground.
        joints: By name of the child body, which has one joint to its parent.
        muscles: By name.
    """

    path: Path
    name: str
    version: int
    gravity: Vec3
    bodies: Mapping[str, OsimBody]
    joints: Mapping[str, OsimJoint]
    muscles: Mapping[str, OsimMuscle]

    @property
    def body_names(self) -> frozenset[str]:
        """The names of all bodies, without ground."""
        return frozenset(self.bodies)

    @property
    def total_mass(self) -> float:
        """Mass of all bodies together, kg."""
        return sum(body.mass for body in self.bodies.values())

    @property
    def coordinates(self) -> dict[str, OsimCoordinate]:
        """All coordinates by name."""
        return {name: own for joint in self.joints.values() for name, own in joint.coordinates.items()}

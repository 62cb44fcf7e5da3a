"""A leg of an OpenSim model, in the sagittal plane: where its bodies are, and how long its muscles are.

This is the reference that leg8's fitted knee and wrapping cylinders are held to for any subject: the document's own
joints, moving and conditional path points, computed anew without OpenSim.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import ModelError
from mjhcmc.io.osim import OsimJoint, OsimModel, OsimPoint
from mjhcmc.leg8.table import JOINTS, MUSCLES

Array = NDArray[np.float64]

SIDES = {"right": "r", "left": "l"}
"""What OpenSim's names end with, by side."""

SEGMENTS = ("pelvis", "femur", "tibia", "talus", "calcn", "toes")
"""The leg's bodies from the pelvis down, without their side; each but the first hangs on the one before it."""

COORDINATES = {"hip": "hip_flexion", "knee": "knee_angle", "ankle": "ankle_angle"}
"""OpenSim's coordinate of each joint, without its side."""

_MOVED_BY = {"femur": "hip", "tibia": "knee", "talus": "ankle"}
_STEP = 1e-5  # of the central differences that give moment arms, rad


@dataclass(frozen=True)
class OsimLeg:
    """One leg of an OpenSim model, checked to be one that leg8 can follow.

    Attributes:
        model: The OpenSim model.
        side: "right" or "left".
    """

    model: OsimModel
    side: str
    _held: Mapping[str, float] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the leg.

        Raises:
            ModelError: bodies, coordinates or muscles of the leg are missing, do not hang together as a leg, or a joint
                does not turn about the z axis by its coordinate's value.
        """
        own = {self.name(COORDINATES[joint]) for joint in JOINTS}
        held = {name: c.default for name, c in self.model.coordinates.items() if name not in own}
        object.__setattr__(self, "_held", held)
        self._require("bodies", [self.body(part) for part in SEGMENTS], self.model.bodies)
        self._require("muscles", [self.name(muscle) for muscle in MUSCLES], self.model.muscles)
        self._require("coordinates", sorted(own), self.model.coordinates)
        for parent, child in pairwise(SEGMENTS):
            self._check_joint(self.body(parent), child)
        for muscle in MUSCLES:
            for point in self.model.muscles[self.name(muscle)].path:
                self._check_point(muscle, point)

    def _require(self, kind: str, wanted: list[str], found: Mapping[str, object]) -> None:
        missing = [name for name in wanted if name not in found]
        if missing:
            other = "" if kind != "muscles" else " (gait10dof18musc and models scaled from it have them)"
            raise ModelError(
                f"{self.model.path}: no {kind} {', '.join(missing)}: leg8's {self.side} leg is made of "
                f"{', '.join(wanted)}{other}"
            )

    def _check_joint(self, parent: str, part: str) -> None:
        joint = self.model.joints.get(self.body(part))
        if joint is None or joint.parent != parent or joint.axes is None:
            what = "no joint" if joint is None else f"joint {joint.name} ({joint.kind}) to {joint.parent}"
            raise ModelError(
                f"{self.model.path}: body {self.body(part)} has {what}: leg8 needs a PinJoint, CustomJoint or "
                f"WeldJoint to {parent}"
            )
        angles = np.array([-0.3, 0.0, 0.2])
        turned = self._relative(part, angles)[0]
        if part in _MOVED_BY:
            turned = turned @ np.linalg.inv(_about_z(angles))
        if np.abs(turned - turned[1]).max() > 1e-6 or np.abs(turned[1] - np.eye(3)).max() > 0.2:
            raise ModelError(
                f"{self.model.path}: joint {joint.name} does not turn about z by its coordinate: leg8 follows planar "
                "legs, such as gait10dof18musc's"
            )

    def _check_point(self, muscle: str, point: OsimPoint) -> None:
        bodies = [self.body(part) for part in SEGMENTS]
        names = {self.name(c): None for c in COORDINATES.values()} | dict.fromkeys(self._held)
        asked = [coordinate for coordinate, _ in point.moves.values()] + ([point.active[0]] if point.active else [])
        lost = [point.body] if point.body not in bodies else [name for name in asked if name not in names]
        if lost:
            raise ModelError(
                f"{self.model.path}: point {point.name} of muscle {self.name(muscle)} names {lost[0]}: it must name "
                f"{', '.join(bodies)} or a coordinate of the model"
            )

    def name(self, word: str) -> str:
        """OpenSim's name of a muscle or coordinate of this side."""
        return f"{word}_{SIDES[self.side]}"

    def body(self, part: str) -> str:
        """OpenSim's name of a segment; the pelvis has no side."""
        return part if part == "pelvis" else self.name(part)

    def joint(self, part: str) -> OsimJoint:
        """The joint that a segment hangs on."""
        return self.model.joints[self.body(part)]

    def _values(self, qpos: Array) -> dict[str, Array]:
        values = {name: np.full(len(qpos), value) for name, value in self._held.items()}
        return values | {self.name(COORDINATES[joint]): qpos[:, i] for i, joint in enumerate(JOINTS)}

    def _relative(self, part: str, angle: Array) -> tuple[Array, Array]:
        """A segment's frame in its parent's at values of the coordinate that moves it."""
        qpos = np.zeros((len(angle), 3))
        if part in _MOVED_BY:
            qpos[:, JOINTS.index(_MOVED_BY[part])] = angle
        return joint_transform(self.joint(part), self._values(qpos))

    def frames(self, qpos: Array) -> dict[str, tuple[Array, Array]]:
        """Orientation (n, 3, 3) and origin (n, 3), m, of each segment in the pelvis, in its axes (x, y up, z right).

        Args:
            qpos: Hip, knee and ankle (n, 3), rad.
        """
        values = self._values(qpos)
        turn, place = np.tile(np.eye(3), (len(qpos), 1, 1)), np.zeros((len(qpos), 3))
        frames = {"pelvis": (turn, place)}
        for part in SEGMENTS[1:]:
            own_turn, own_place = joint_transform(self.joint(part), values)
            place = place + np.einsum("nij,nj->ni", turn, own_place)
            turn = turn @ own_turn
            frames[part] = (turn, place)
        return frames

    @cached_property
    def rest(self) -> dict[str, tuple[Array, Array]]:
        """Orientation (3, 3) and origin (3,) of each segment in the pelvis at zero angles."""
        return {part: (turn[0], place[0]) for part, (turn, place) in self.frames(np.zeros((1, 3))).items()}

    def origin(self, part: str) -> Array:
        """Where the parameter table's frame of a segment lies in the pelvis at zero angles (3,), m.

        On the hip and on the ankle for femur and talus, on the segment's own origin for the others; its axes are the
        pelvis'.
        """
        return self.center(part) if part in ("femur", "talus") else self.rest[part][1]

    def place(self, point: OsimPoint) -> tuple[str, Array]:
        """A path point's segment, and its place at zero angles in the table's frame of that segment (3,), m."""
        part = self.part(point.body)
        turn, place = self.rest[part]
        return part, turn @ self._local(point, self._values(np.zeros((1, 3))))[0] + place - self.origin(part)

    def knee_path(self, angle: Array) -> Array:
        """Where the tibia's origin is in the femur, seen from the hip and in the axes of zero angles (n, 3), m."""
        qpos = np.zeros((len(angle), 3))
        qpos[:, 1] = angle
        path: Array = self.frames(qpos)["tibia"][1] - self.center("femur")
        return path

    def center(self, part: str) -> Array:
        """The centre of the joint above a segment in the pelvis at zero angles, m (3,)."""
        turn, place = self.rest[part]
        center: Array = place + turn @ np.asarray(self.joint(part).child_pos)
        return center

    def active(self, muscle: str, qpos: Array) -> list[Array]:
        """Whether the path runs over each point of a muscle: one array (n,) of truths a point."""
        values = self._values(qpos)
        rows = []
        for point in self.model.muscles[self.name(muscle)].path:
            if point.active is None:
                rows.append(np.ones(len(qpos), bool))
            else:
                coordinate, low, high = point.active
                rows.append((values[coordinate] >= low) & (values[coordinate] <= high))
        return rows

    def length(self, muscle: str, qpos: Array, active: list[Array] | None = None) -> Array:
        """Musculotendon length (n,), m: the straight lines between the points that the path runs over."""
        values, frames = self._values(qpos), self.frames(qpos)
        active = self.active(muscle, qpos) if active is None else active
        length, last = np.zeros(len(qpos)), np.full((len(qpos), 3), math.nan)
        for point, is_on in zip(self.model.muscles[self.name(muscle)].path, active, strict=True):
            turn, place = frames[self.part(point.body)]
            here = place + np.einsum("nij,nj->ni", turn, self._local(point, values))
            length += np.where(is_on, np.nan_to_num(np.linalg.norm(here - last, axis=1)), 0.0)
            last = np.where(is_on[:, None], here, last)
        return length

    @staticmethod
    def _local(point: OsimPoint, values: Mapping[str, Array]) -> Array:
        """A path point's place in its body (n, 3), m."""
        local = np.tile(np.asarray(point.pos, float), (len(next(iter(values.values()))), 1))
        for axis, (coordinate, function) in point.moves.items():
            local[:, axis] = function(values[coordinate])
        return local

    def length_and_arm(self, muscle: str, qpos: Array) -> tuple[Array, Array]:
        """One muscle's lengths (n,), m, and moment arms -dL/dq (n, 3), m, at joint angles (n, 3), rad."""
        active = self.active(muscle, qpos)  # kept over the difference: a path that jumps has no moment arm there
        arm = np.empty((len(qpos), 3))
        for j in range(3):
            shift = np.eye(3)[j] * _STEP
            ahead, behind = (self.length(muscle, qpos + sign * shift, active) for sign in (1, -1))
            arm[:, j] = -(ahead - behind) / (2 * _STEP)
        return self.length(muscle, qpos, active), arm

    def lengths_and_arms(self, qpos: Array) -> tuple[Array, Array]:
        """Lengths (n, 8), m, and moment arms -dL/dq (n, 8, 3), m, of leg8's muscles at joint angles (n, 3), rad."""
        each = [self.length_and_arm(muscle, qpos) for muscle in MUSCLES]
        return np.stack([length for length, _ in each], axis=1), np.stack([arm for _, arm in each], axis=1)

    def part(self, body: str) -> str:
        """The segment that an OpenSim body is."""
        return body if body == "pelvis" else body[:-2]


def joint_transform(joint: OsimJoint, values: Mapping[str, Array]) -> tuple[Array, Array]:
    """The child's frame in the parent's: orientation (n, 3, 3) and origin (n, 3), m.

    Args:
        joint: A joint whose axes were read.
        values: Values (n,) of all coordinates, rad or m.
    """
    count = len(next(iter(values.values())))
    turn, place = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    for step in joint.axes or ():
        value = step.function(np.zeros(count) if step.coordinate is None else values[step.coordinate])
        axis = np.asarray(step.axis) / np.linalg.norm(step.axis)
        if step.is_rotation:
            turn = turn @ _about(axis, np.broadcast_to(value, count))
        else:
            place = place + np.multiply.outer(np.broadcast_to(value, count), axis)
    above, below = _euler(joint.parent_turn), _euler(joint.child_turn)
    turn = above @ turn @ below.T
    place = np.asarray(joint.parent_pos) + place @ above.T - turn @ np.asarray(joint.child_pos)
    return turn, place


def _about(axis: Array, angle: Array) -> Array:
    """Rotation matrices (n, 3, 3) about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    matrix: Array = np.eye(3) + sine * cross + (1 - cosine) * (cross @ cross)
    return matrix


def _about_z(angle: Array) -> Array:
    return _about(np.array([0.0, 0.0, 1.0]), angle)


def _euler(angles: tuple[float, float, float]) -> Array:
    """The rotation matrix of body-fixed x, y, z angles."""
    matrix: Array = np.eye(3)
    for axis, angle in zip(np.eye(3), angles, strict=True):
        matrix = matrix @ _about(axis, np.array([angle]))[0]
    return matrix

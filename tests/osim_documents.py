"""OpenSim documents for tests, written from leg8's parameter table: version 3 or 4, both sides, at any size."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mjhcmc.leg8 import MUSCLES, load_table

SOURCE = load_table()["source"]
PARENTS = {
    "femur": ("hip", "pelvis"),
    "tibia": ("knee", "femur"),
    "talus": ("ankle", "tibia"),
    "calcn": ("subtalar", "talus"),
    "toes": ("mtp", "calcn"),
}
ROOT = {"pelvis_tilt": ("0 0 1", 0.0), "pelvis_tx": ("1 0 0", 0.0), "pelvis_ty": ("0 1 0", 0.94)}


def write_osim(
    path: Path,
    *,
    version: int = 40000,
    size: float | Mapping[str, float] = 1.0,
    mass: float = 1.0,
    sides: str = "rl",
    kind: str = "Millard2012EquilibriumMuscle",
    edit: Callable[[ET.Element], None] | None = None,
) -> Path:
    """Write gait10dof18musc's legs, without the short head of biceps femoris, torso and arms.

    Args:
        path: file to write.
        version: of the document.
        size: what lengths of each segment (pelvis, femur, tibia, foot), or of all, are multiplied by.
        mass: what masses are multiplied by.
        sides: which legs.
        kind: of the muscles.
        edit: changes the document before it is written.
    """
    writer = _Writer(version, size if isinstance(size, Mapping) else dict.fromkeys(_SEGMENTS, size), mass)
    root = writer.document(sides, kind)
    if edit is not None:
        edit(root)
    path.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    return path


_SEGMENTS = ("pelvis", "femur", "tibia", "foot")


class _Writer:
    def __init__(self, version: int, size: Mapping[str, float], mass: float) -> None:
        self.v4, self.version, self.mass = version >= 40000, version, mass
        self.size = {part: size.get(part, size["foot"]) for part in ("pelvis", *PARENTS)}

    def document(self, sides: str, kind: str) -> ET.Element:
        root = ET.Element("OpenSimDocument", Version=str(self.version))
        model = ET.SubElement(root, "Model", name="legs")
        _text(model, "gravity", "0 -9.80665 0")
        bodies = _set(model, "BodySet")
        joints = _set(model, "JointSet") if self.v4 else None
        if not self.v4:
            ground = ET.SubElement(bodies, "Body", name="ground")
            _text(ground, "mass", "0")
            for axes in ("xx", "yy", "zz"):
                _text(ground, f"inertia_{axes}", "0")
            ET.SubElement(ground, "Joint")
        self.root_joint(self.holder(self.body(bodies, "pelvis", 1, ""), joints))
        for side in sides:
            sign = 1 if side == "r" else -1
            for part in PARENTS:
                self.joint(self.holder(self.body(bodies, part, sign, f"_{side}"), joints), part, sign, f"_{side}")
        forces = _set(model, "ForceSet")
        for side in sides:
            for muscle in MUSCLES:
                self.muscle(forces, muscle, kind, 1 if side == "r" else -1, f"_{side}")
        return root

    def holder(self, body: ET.Element, joints: ET.Element | None) -> ET.Element:
        return ET.SubElement(body, "Joint") if joints is None else joints

    def body(self, bodies: ET.Element, part: str, sign: int, side: str) -> ET.Element:
        own = SOURCE["bodies"][part]
        element = ET.SubElement(bodies, "Body", name=part + side)
        _text(element, "mass", repr(own["mass"] * self.mass))
        _text(element, "mass_center", self.vector(own["com"], part, sign))
        moments = [value * self.mass * self.size[part] ** 2 for value in own["inertia"]]
        if self.v4:
            _text(element, "inertia", " ".join(map(repr, [*moments, 0, 0, 0])))
        else:
            for axes, value in zip(("xx", "yy", "zz", "xy", "xz", "yz"), [*moments, 0, 0, 0], strict=True):
                _text(element, f"inertia_{axes}", repr(value))
        return element

    def vector(self, values: Any, part: str, sign: int) -> str:
        x, y, z = np.asarray(values, float) * self.size[part]
        return f"{float(x)!r} {float(y)!r} {float(z) * sign!r}"

    def frames(self, joint: ET.Element, parent: str, child: str, place: str) -> None:
        if not self.v4:
            _text(joint, "parent_body", parent)
            _text(joint, "location_in_parent", place)
            for tag in ("orientation_in_parent", "location", "orientation"):
                _text(joint, tag, "0 0 0")
            return
        _text(joint, "socket_parent_frame", f"{parent}_offset")
        _text(joint, "socket_child_frame", f"/bodyset/{child}")
        frame = ET.SubElement(ET.SubElement(joint, "frames"), "PhysicalOffsetFrame", name=f"{parent}_offset")
        _text(frame, "socket_parent", "/ground" if parent == "ground" else f"/bodyset/{parent}")
        _text(frame, "translation", place)
        _text(frame, "orientation", "0 0 0")

    def coordinates(self, joint: ET.Element) -> ET.Element:
        return ET.SubElement(joint, "coordinates") if self.v4 else _set(joint, "CoordinateSet")

    def coordinate(self, holder: ET.Element, name: str, default: float, limits: tuple[float, float]) -> None:
        element = ET.SubElement(holder, "Coordinate", name=name)
        _text(element, "default_value", repr(default))
        _text(element, "range", f"{limits[0]!r} {limits[1]!r}")

    def axis(self, transform: ET.Element, name: str, axis: str, coordinate: str, function: ET.Element) -> None:
        element = ET.SubElement(transform, "TransformAxis", name=name)
        _text(element, "coordinates", coordinate)
        _text(element, "axis", axis)
        if self.v4:
            function.set("name", "function")
            element.append(function)
        else:
            ET.SubElement(element, "function").append(function)

    def root_joint(self, holder: ET.Element) -> None:
        joint = ET.SubElement(holder, "CustomJoint", name="ground_pelvis")
        self.frames(joint, "ground", "pelvis", "0 0 0")
        own = self.coordinates(joint)
        transform = ET.SubElement(joint, "SpatialTransform")
        for name, (axis, default) in ROOT.items():
            self.coordinate(own, name, default, (-5.0, 5.0))
            step = "rotation1" if name == "pelvis_tilt" else f"translation{'xy'.index(name[-1]) + 1}"
            self.axis(transform, step, axis, name, _line())

    def joint(self, holder: ET.Element, part: str, sign: int, side: str) -> None:
        name, above = PARENTS[part]
        own = SOURCE["joints"][name]
        parent = above if above == "pelvis" else above + side
        place = "0 0 0" if name == "knee" else self.vector(own["parent_offset"], above, sign)
        tag = {"knee": "CustomJoint", "subtalar": "WeldJoint", "mtp": "WeldJoint"}.get(name, "PinJoint")
        joint = ET.SubElement(holder, tag, name=name + side)
        self.frames(joint, parent, part + side, place)
        if tag == "WeldJoint":
            return
        coordinate = own["coordinate"].removesuffix("_r") + side
        low, high = np.radians(own["range_deg"]).tolist()
        self.coordinate(self.coordinates(joint), coordinate, 0.0, (low, high))
        if tag == "CustomJoint":
            transform = ET.SubElement(joint, "SpatialTransform")
            self.axis(transform, "rotation1", "0 0 1", coordinate, _line())
            for i, (key, axis) in enumerate((("x", "1 0 0"), ("y", "0 1 0"))):
                spline = _scaled(_spline(own[key]["knee_angle"], own[key]["value"]), self.size["femur"])
                self.axis(transform, f"translation{i + 1}", axis, coordinate, spline)

    def muscle(self, forces: ET.Element, muscle: str, kind: str, sign: int, side: str) -> None:
        own = SOURCE["muscles"][muscle]
        element = ET.SubElement(forces, kind, name=muscle + side)
        points = _set(ET.SubElement(element, "GeometryPath", name="path"), "PathPointSet")
        for point in own["path"]:
            self.point(points, point, sign, side)
        mean = float(np.mean(list(self.size.values())))
        _text(element, "max_isometric_force", repr(own["max_isometric_force"]))
        _text(element, "optimal_fiber_length", repr(own["optimal_fiber_length"] * mean))
        _text(element, "tendon_slack_length", repr(own["tendon_slack_length"] * mean))
        angle = "pennation_angle_at_optimal" if self.version > 20303 else "pennation_angle"
        _text(element, angle, repr(own["pennation_angle"]))

    def point(self, points: ET.Element, point: Mapping[str, Any], sign: int, side: str) -> None:
        body = point["body"] if point["body"] == "pelvis" else point["body"] + side
        tag = {"fixed": "PathPoint", "moving": "MovingPathPoint", "conditional": "ConditionalPathPoint"}[point["kind"]]
        element = ET.SubElement(points, tag, name=point["name"].replace("_r-", f"{side}-"))
        _text(element, "socket_parent_frame" if self.v4 else "body", f"/bodyset/{body}" if self.v4 else body)
        if tag == "MovingPathPoint":
            for axis, factor in (("x", 1), ("y", 1), ("z", sign)):
                _text(element, f"socket_{axis}_coordinate" if self.v4 else f"{axis}_coordinate", f"knee_angle{side}")
                spline = _spline(point[axis]["knee_angle"], [factor * value for value in point[axis]["value"]])
                ET.SubElement(element, f"{axis}_location").append(_scaled(spline, self.size[point["body"]]))
            return
        _text(element, "location", self.vector(point["pos"], point["body"], sign))
        if tag == "ConditionalPathPoint":
            coordinate = point["coordinate"].removesuffix("_r") + side
            _text(element, "socket_coordinate" if self.v4 else "coordinate", coordinate)
            _text(element, "range", " ".join(map(repr, point["active_range"])))


def _text(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text


def _set(parent: ET.Element, tag: str) -> ET.Element:
    return ET.SubElement(ET.SubElement(parent, tag), "objects")


def _line() -> ET.Element:
    line = ET.Element("LinearFunction")
    _text(line, "coefficients", "1 0")
    return line


def _spline(x: list[float], y: list[float]) -> ET.Element:
    spline = ET.Element("SimmSpline")
    _text(spline, "x", " ".join(map(repr, x)))
    _text(spline, "y", " ".join(map(repr, y)))
    return spline


def _scaled(function: ET.Element, scale: float) -> ET.Element:
    multiplier = ET.Element("MultiplierFunction")
    ET.SubElement(multiplier, "function").append(function)
    _text(multiplier, "scale", repr(scale))
    return multiplier

"""Reading an OpenSim model (.osim): its bodies, joints and muscles, from the XML alone.

Documents of version 2 and 3 (20303, 30000), where a body holds its joint, and of version 4 (4xxxx), where joints stand
in a set of their own and name frames, are read into the same records. What the records have no place for (geometry,
markers, controllers, contact, constraints) is left out. Units are the document's: m, kg, s, N, rad.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import TypeVar

from mjhcmc.errors import ModelError
from mjhcmc.io.osim_functions import Polynomial
from mjhcmc.io.osim_records import (
    OsimAxis,
    OsimBody,
    OsimCoordinate,
    OsimJoint,
    OsimModel,
    OsimMuscle,
    OsimPoint,
    Vec3,
)
from mjhcmc.io.osim_xml import Reader, last_word, parse_document

__all__ = [
    "OsimAxis",
    "OsimBody",
    "OsimCoordinate",
    "OsimJoint",
    "OsimModel",
    "OsimMuscle",
    "OsimPoint",
    "read_osim",
]

_T = TypeVar("_T")

_ZERO: Vec3 = (0.0, 0.0, 0.0)
_EARTH: Vec3 = (0.0, -9.80665, 0.0)
_V4 = 40000  # the first version with a set of joints (development versions 305xx had it too; nobody keeps those)

# What OpenSim takes where a document leaves it out: activation and deactivation time (s), fiber damping.
_MUSCLE_DEFAULTS = {
    "Thelen2003Muscle": (0.015, 0.05, 0.0),
    "Thelen2003Muscle_Deprecated": (0.015, 0.05, 0.0),
    "DeGrooteFregly2016Muscle": (0.015, 0.06, 0.0),
    "Schutte1993Muscle_Deprecated": (0.015, 0.05, 0.0),
    "Delp1990Muscle_Deprecated": (0.015, 0.05, 0.0),
}
_MILLARD_DEFAULTS = (0.01, 0.04, 0.1)


def read_osim(path: str | Path) -> OsimModel:
    """Read an OpenSim model.

    Args:
        path: The .osim file.

    Returns:
        Its bodies, joints and muscles.

    Raises:
        ModelError: the file cannot be read, is not XML or no OpenSim model, a body, joint or muscle lacks a number that
            it must have, or a mass, length or force is not over zero. The message names file, element and remedy.
    """
    path = Path(path)
    root, version = parse_document(path)
    model = root.find("Model")
    if model is None:
        raise ModelError(f"{path}: OpenSimDocument holds no Model: give a model, not a setup file or a set")
    read = Reader(path)
    bodies: dict[str, OsimBody] = {}
    joints: dict[str, OsimJoint] = {}
    for element in _objects(model, "BodySet"):
        name = _name(read, element)
        if version < _V4:
            _add(read, joints, element, name, _joint_of_body(read, element, name))
        if name != "ground":
            _add(read, bodies, element, name, _body(read, element, name))
    for element in _objects(model, "JointSet"):
        joint = _joint_of_set(read, element)
        _add(read, joints, element, joint.child, joint)
    if not bodies:
        raise ModelError(f"{path}: Model {model.get('name', '')} has no body: give a model with a BodySet")
    muscles: dict[str, OsimMuscle] = {}
    defaults = [*root.findall("defaults"), *model.findall("defaults")]
    for element in _objects(model, "ForceSet"):
        if "Muscle" in element.tag:
            muscle = _muscle(read, _with_defaults(element, defaults))
            _add(read, muscles, element, muscle.name, muscle)
    gravity = read.vector(model, "gravity", default=_EARTH)
    return OsimModel(path, model.get("name", path.stem), version, gravity, bodies, joints, muscles)


def _objects(model: ET.Element, tag: str) -> list[ET.Element]:
    return [element for group in model.findall(f"{tag}/objects") for element in group]


def _name(read: Reader, element: ET.Element) -> str:
    name = element.get("name", "").strip()
    if not name:
        raise read.error(element, "it has no name", "name it")
    return name


def _add(read: Reader, records: dict[str, _T], element: ET.Element, name: str, record: _T | None) -> None:
    if name in records:
        raise read.error(element, f"{name!r} is there twice", "rename or delete one")
    if record is not None:
        records[name] = record


def _body(read: Reader, element: ET.Element, name: str) -> OsimBody:
    mass = read.number(element, "mass")
    if mass < 0:
        raise read.error(element, f"mass is {mass:g}", "give a mass in kg, not under zero")
    if element.find("inertia") is not None:
        a, b, c, d, e, f = read.numbers(element, "inertia", count=6)
    else:
        a, b, c = (read.number(element, f"inertia_{axes}") for axes in ("xx", "yy", "zz"))
        d, e, f = (read.number(element, f"inertia_{axes}", default=0.0) for axes in ("xy", "xz", "yz"))
    return OsimBody(name, mass, read.vector(element, "mass_center", default=_ZERO), (a, b, c, d, e, f))


def _joint_of_body(read: Reader, body: ET.Element, child: str) -> OsimJoint | None:
    """The joint that a body of versions 2 and 3 holds; ground holds an empty one."""
    elements = list(body.find("Joint") or ())
    if not elements:
        return None
    joint = elements[0]
    if read.text(joint, "reverse", default="false").lower() == "true":
        raise read.error(joint, "reverse is true", "save the model with OpenSim 4, which writes joints forward")
    return _joint(
        read,
        joint,
        (read.text(joint, "parent_body"), child),
        (read.vector(joint, "location_in_parent", default=_ZERO), read.vector(joint, "location", default=_ZERO)),
        (read.vector(joint, "orientation_in_parent", default=_ZERO), read.vector(joint, "orientation", default=_ZERO)),
        [element for group in joint.findall("CoordinateSet/objects") for element in group],
    )


def _joint_of_set(read: Reader, joint: ET.Element) -> OsimJoint:
    """A joint of version 4, whose two frames are bodies, or frames of its own that stand off from bodies."""
    bodies, places, turns = [], [], []
    frames = {frame.get("name", ""): frame for frame in joint.iterfind("frames/*")}
    for socket in ("socket_parent_frame", "socket_child_frame"):
        word = read.text(joint, socket)
        frame = frames.get(last_word(word))
        if frame is None:
            bodies.append(last_word(word))
            places.append(_ZERO)
            turns.append(_ZERO)
        else:
            bodies.append(last_word(read.text(frame, "socket_parent")))
            places.append(read.vector(frame, "translation", default=_ZERO))
            turns.append(read.vector(frame, "orientation", default=_ZERO))
    coordinates = list(joint.iterfind("coordinates/*"))
    return _joint(read, joint, (bodies[0], bodies[1]), (places[0], places[1]), (turns[0], turns[1]), coordinates)


def _joint(
    read: Reader,
    joint: ET.Element,
    bodies: tuple[str, str],
    places: tuple[Vec3, Vec3],
    turns: tuple[Vec3, Vec3],
    coordinates: list[ET.Element],
) -> OsimJoint:
    own = {}
    for element in coordinates:
        low, high = read.numbers(element, "range", count=2, default=(-float("inf"), float("inf")))
        default = read.number(element, "default_value", default=0.0)
        name = _name(read, element)
        own[name] = OsimCoordinate(name, default, low, high)
    axes = _axes(read, joint, tuple(own))
    name = _name(read, joint)
    return OsimJoint(name, joint.tag, *bodies, places[0], turns[0], places[1], turns[1], own, axes)


def _axes(read: Reader, joint: ET.Element, coordinates: tuple[str, ...]) -> tuple[OsimAxis, ...] | None:
    """The motion of a joint as rotations and translations; None for the kinds that no planar leg has."""
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    plain = {"WeldJoint": (), "PinJoint": ((True, z),), "SliderJoint": ((False, x),)}
    plain["PlanarJoint"] = ((True, z), (False, x), (False, y))
    if joint.tag in plain:
        steps = plain[joint.tag]
        if len(steps) != len(coordinates):
            raise read.error(joint, f"it has {len(coordinates)} coordinates", f"give it {len(steps)}")
        line = Polynomial((1.0, 0.0))
        return tuple(OsimAxis(turn, axis, name, line) for (turn, axis), name in zip(steps, coordinates, strict=True))
    if joint.tag != "CustomJoint":
        return None
    axes = []
    for element in joint.iterfind("SpatialTransform/TransformAxis"):
        names = read.text(element, "coordinates", default="").split()
        function = read.function_in(element)
        if len(names) > 1 or (function is None and names):
            problem = f"{len(names)} coordinates" if names[1:] else "no function"
            raise read.error(joint, f"{element.get('name')} has {problem}", "write one function of one coordinate")
        axis = read.vector(element, "axis")
        is_rotation = element.get("name", "").startswith("rotation")
        axes.append(OsimAxis(is_rotation, axis, names[0] if names else None, function or Polynomial((0.0,))))
    return tuple(sorted(axes, key=lambda axis: not axis.is_rotation))


def _with_defaults(element: ET.Element, defaults: list[ET.Element]) -> ET.Element:
    """A muscle with what it leaves out taken from the document's defaults for its type."""
    given = {child.tag for child in element}
    whole = ET.Element(element.tag, element.attrib)
    whole.extend(element)
    for group in defaults:
        for child in group.find(element.tag) or ():
            if child.tag not in given:
                whole.append(child)
                given.add(child.tag)
    return whole


def _muscle(read: Reader, element: ET.Element) -> OsimMuscle:
    activation, deactivation, damping = _MUSCLE_DEFAULTS.get(element.tag, _MILLARD_DEFAULTS)
    speed = 10.0
    if element.find("time_scale") is not None:  # Schutte's: rates (k1 u + k2) / time_scale, speed 1 / time_scale
        scale = read.positive(element, "time_scale")
        k1, k2 = (read.positive(element, f"activation{i}", default=d) for i, d in ((1, 7.667), (2, 1.459854)))
        activation, deactivation, speed = scale / (k1 + k2), scale / k2, 1.0 / scale
    pennation = read.number(element, "pennation_angle_at_optimal", "pennation_angle", default=0.0)
    if not 0 <= pennation < 1.5:
        raise read.error(element, f"pennation angle is {pennation:g}", "give radians, 0 to under 1.5")
    damping = read.number(element, "fiber_damping", default=damping)
    if damping < 0:
        raise read.error(element, f"fiber_damping is {damping:g}", "give a number, not under zero")
    path = element.find("GeometryPath")
    if path is None:
        raise read.error(element, "no GeometryPath", "give the muscle a path of points")
    points = [_point(read, point, element) for group in path.findall("PathPointSet/objects") for point in group]
    if len(points) < 2:
        raise read.error(element, f"its path has {len(points)} points", "give it at least two")
    wraps = [read.text(wrap, "wrap_object") for group in path.findall("PathWrapSet/objects") for wrap in group]
    return OsimMuscle(
        name=_name(read, element),
        kind=element.tag,
        max_isometric_force=read.positive(element, "max_isometric_force"),
        optimal_fiber_length=read.positive(element, "optimal_fiber_length"),
        tendon_slack_length=read.positive(element, "tendon_slack_length"),
        pennation_angle=pennation,
        max_contraction_velocity=read.positive(element, "max_contraction_velocity", default=speed),
        activation_time=read.positive(element, "activation_time_constant", default=activation),
        deactivation_time=read.positive(element, "deactivation_time_constant", default=deactivation),
        fiber_damping=damping,
        path=tuple(points),
        wraps=tuple(wraps),
    )


def _point(read: Reader, element: ET.Element, muscle: ET.Element) -> OsimPoint:
    body = last_word(read.text(element, "socket_parent_frame", "body"))
    moves = {}
    active = None
    if element.tag == "MovingPathPoint":
        for i, axis in enumerate("xyz"):
            holder = element.find(f"{axis}_location")
            coordinate = last_word(read.text(element, f"socket_{axis}_coordinate", f"{axis}_coordinate", default=""))
            if holder is None or len(holder) != 1:
                raise read.error(element, f"no function in {axis}_location", "save the model with OpenSim again")
            moves[i] = (coordinate, read.function(holder[0]))
    elif element.tag in ("ConditionalPathPoint", "ViaPoint"):
        low, high = read.numbers(element, "range", count=2)
        active = (last_word(read.text(element, "socket_coordinate", "coordinate")), low, high)
    elif element.tag != "PathPoint":
        raise read.error(muscle, f"path point of the unknown kind {element.tag}", "use the kinds that OpenSim has")
    pos = read.vector(element, "location", default=_ZERO if moves else None)
    return OsimPoint(element.get("name", ""), body, pos, moves, active)

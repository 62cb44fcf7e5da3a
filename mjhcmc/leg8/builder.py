"""Build leg8 with ``mujoco.MjSpec`` from the parameter table, at any body mass and height, hanging or walking.

The model's world has z up: a point (x, y, z) of the source (x forward, y up, z to the right) lies at (x, -z, y), so
that the source's flexion axis +z is the axis (0, -1, 0) of every hinge, and all three coordinates keep the source's
signs (hip + flexion, knee - flexion, ankle + dorsiflexion). Masses, inertias, points and fiber data are the source's
(gait10dof18musc, CC-BY 3.0); the fixed knee hinge, the knee's wrapping cylinders and MuJoCo's curve parameters are
fitted by :mod:`mjhcmc.leg8.fit`.

Scaling from the source's mass and height, with m and h the two ratios: lengths, optimal fiber and tendon slack
lengths by h; masses by m; inertias by m h^2; max isometric force by m, since force is muscle volume over optimal fiber
length and lower-limb muscle volumes grow with body mass times height (Handsfield, Meyer, Hart, Abel, Blemker 2014,
J. Biomech. 47, 631-638). Pennation, activation times and the normalised curves stay.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mjhcmc.errors import SettingsError
from mjhcmc.leg8.appearance import add_appearance
from mjhcmc.leg8.geometry import Scale, Vector, compose_inertia, digits, to_world
from mjhcmc.leg8.knee import KNEE_SLIDES
from mjhcmc.leg8.muscles import BODIES, add_muscles, fiber_mapping
from mjhcmc.leg8.table import JOINTS, MUSCLES, ROOT_JOINTS, load_table
from mjhcmc.opensim_names import BODIES_TEXT, MUSCLES_TEXT, PATHS_TEXT, PENNATION_TEXT

if TYPE_CHECKING:
    import mujoco

__all__ = [
    "COORDINATE_MAP_NAME",
    "FLEXION_AXIS",
    "SOURCE_BODY_MASS",
    "SOURCE_HEIGHT",
    "assemble",
    "build_leg8",
    "build_leg8_gait",
    "fiber_mapping",
    "source_frames",
]

SOURCE_BODY_MASS = 75.1646
"""Body mass of the source model, kg."""

SOURCE_HEIGHT = 1.8
"""Stature of the source model, m."""

FLEXION_AXIS = (0.0, -1.0, 0.0)
"""The source's +z axis in the model's world; the axis of each hinge."""

COORDINATE_MAP_NAME = "opensim_coordinates"
"""Name of the model's custom text that maps joints onto OpenSim's coordinate names."""

_ROOT_AXES = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), FLEXION_AXIS)
# As stiff as MuJoCo lets a step of 1 ms be: a time constant of two steps, and the highest impedance from the start.
_KNEE_SOLREF = (0.002, 1.0)
_KNEE_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
# kg, of the slides beside another along the same axis: without it their mass matrix is singular, with little of it
# MuJoCo takes them for light and their equalities are soft (.1 mm with 5 g, .01 mm with 100 g at walking speeds).
_CAM_ARMATURE = 0.1


def build_leg8(
    body_mass: float = SOURCE_BODY_MASS,
    height: float = SOURCE_HEIGHT,
    *,
    table: Mapping[str, Any] | None = None,
) -> mujoco.MjSpec:
    """Build the 3-joint, 8-muscle right leg, hanging from a fixed pelvis.

    Args:
        body_mass: Mass of the whole body, kg, 20 to 250.
        height: Stature, m, 1.0 to 2.5.
        table: The parameter table; the package's own where None.

    Returns:
        A compiled-ready ``mujoco.MjSpec``: hinges ``hip``, ``knee``, ``ankle`` (rad), actuators and tendons for each
        muscle, RK4 at 1 ms, sensors and the keyframe ``rest``.

    Raises:
        SettingsError: ``body_mass`` or ``height`` is not a number within its limits.
        ModelError: The table gives a muscle a length range that begins below its slack length.
    """
    table = load_table() if table is None else table
    return assemble("leg8", table, _scale(table, body_mass, height), planar=False)


def build_leg8_gait(
    body_mass: float = SOURCE_BODY_MASS,
    height: float = SOURCE_HEIGHT,
    *,
    table: Mapping[str, Any] | None = None,
) -> mujoco.MjSpec:
    """Build leg8 on a pelvis that moves in the sagittal plane.

    Before ``hip``, ``knee`` and ``ankle`` come ``pelvis_tx`` (forward) and ``pelvis_ty`` (up), slides whose values are
    the pelvis' place in the ground in m as in OpenSim, and ``pelvis_tilt``, a hinge (rad, + leans back). They have no
    limits. The pelvis weighs what OpenSim's body pelvis weighs, without torso and other leg: what holds the root on its
    motion holds those too, so that a force at the root is no measure of a motion's dynamic consistency.

    Args:
        body_mass: Mass of the whole body, kg, 20 to 250.
        height: Stature, m, 1.0 to 2.5.
        table: The parameter table; the package's own where None.

    Returns:
        A compiled-ready ``mujoco.MjSpec`` with all that :func:`build_leg8` gives. The reference pose and the keyframe
        ``rest`` stand upright with the heel near the ground.

    Raises:
        SettingsError: ``body_mass`` or ``height`` is not a number within its limits.
        ModelError: The table gives a muscle a length range that begins below its slack length.
    """
    table = load_table() if table is None else table
    return assemble("leg8_gait", table, _scale(table, body_mass, height), planar=True)


def assemble(name: str, table: Mapping[str, Any], scale: Scale, *, planar: bool) -> mujoco.MjSpec:
    """The leg of a parameter table under the given model name; errors as :func:`build_leg8`.

    Args:
        name: What the model calls itself.
        table: The parameter table. Where its ``fitted`` section has ``knee_motion`` (coefficients of
            :class:`mjhcmc.leg8.knee.KneeMotion`), the knee's axis moves: the shank gets the slides ``KNEE_SLIDES``,
            tied by joint equalities, and ``knee_axis`` is where the axis is at zero angle.
        scale: Ratios of mass and height.
        planar: Whether the pelvis moves in the sagittal plane; it is fixed at the world's origin otherwise.
    """
    import mujoco

    source = table["source"]
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.timestep = 0.001
    spec.option.gravity = to_world(source["gravity"])
    _add_names(spec, source, planar)
    frames = _add_bodies(spec, table, scale, planar)
    add_muscles(spec, table, scale, frames)
    joints = (*ROOT_JOINTS, *JOINTS) if planar else JOINTS
    _add_sensors(spec, joints)
    qpos = [joint.ref for joint in spec.joints]  # zero, but for the height at which the pelvis stands
    spec.add_key(name="rest", qpos=qpos, act=[0.0] * len(MUSCLES), ctrl=[0.0] * len(MUSCLES))
    add_appearance(spec, table["appearance"], scale, frames, follow="pelvis" if planar else None)
    return spec


def source_frames(table: Mapping[str, Any]) -> dict[str, Vector]:
    """Origin of each of the source's body frames in the frame of the model's body that carries it, m, unscaled.

    The shank's frame lies on the knee hinge (the fitted fixed axis) and the foot's on the ankle hinge; at zero angles
    every source body is where the source has it.
    """
    joints = table["source"]["joints"]
    tibia = np.asarray(joints["knee"]["offset_at_zero"]) - np.asarray(table["fitted"]["knee_axis"])
    calcn = np.asarray(joints["subtalar"]["parent_offset"])
    return {
        "pelvis": np.zeros(3),
        "femur": np.zeros(3),
        "tibia": tibia,
        "talus": np.zeros(3),
        "calcn": calcn,
        "toes": calcn + np.asarray(joints["mtp"]["parent_offset"]),
    }


def _scale(table: Mapping[str, Any], body_mass: float, height: float) -> Scale:
    _require("body_mass", body_mass, 20.0, 250.0, "kg")
    _require("height", height, 1.0, 2.5, "m")
    return Scale(body_mass / table["source"]["body_mass"], height / table["source"]["height"])


def _require(name: str, value: float, low: float, high: float, unit: str) -> None:
    try:
        valid = low <= float(value) <= high
    except (TypeError, ValueError):
        valid = False
    if not valid:
        raise SettingsError(f"leg8: {name} is {value!r}: give a number from {low:g} to {high:g} {unit}")


def _add_names(spec: mujoco.MjSpec, source: Mapping[str, Any], planar: bool) -> None:
    """Add the texts that tell what OpenSim calls all parts, and the pennation that MuJoCo has no place for."""
    side, joints = source.get("side", "r"), source["joints"]
    coordinates = {joint: joints[joint]["coordinate"] for joint in JOINTS}
    paths = {joint: f"/jointset/{joint}_{side}/{coordinate}" for joint, coordinate in coordinates.items()}
    if planar:
        root = joints["ground_pelvis"]
        own = dict(zip(ROOT_JOINTS, root["coordinates"], strict=True))
        coordinates = own | coordinates
        paths = {joint: f"/jointset/{root['name']}/{coordinate}" for joint, coordinate in own.items()} | paths
    texts = {
        COORDINATE_MAP_NAME: coordinates,
        PATHS_TEXT: paths,
        MUSCLES_TEXT: {muscle: f"{muscle}_{side}" for muscle in MUSCLES},
        BODIES_TEXT: {part if part == "pelvis" else f"{part}_{side}": body for part, body in BODIES.items()},
        PENNATION_TEXT: {muscle: f"{source['muscles'][muscle]['pennation_angle']:.9g}" for muscle in MUSCLES},
    }
    for name, pairs in texts.items():
        spec.add_text(name=name, data=" ".join(f"{key}={value}" for key, value in pairs.items()))


def _add_bodies(spec: mujoco.MjSpec, table: Mapping[str, Any], scale: Scale, planar: bool) -> dict[str, Vector]:
    """Add the chain of bodies and joints; returns the source's frames (see :func:`source_frames`)."""
    source, frames = table["source"], source_frames(table)
    joints = source["joints"]
    offsets = {
        "pelvis": np.asarray(joints["ground_pelvis"]["rest"] if planar else np.zeros(3), float),
        "thigh": np.asarray(joints["hip"]["parent_offset"]),
        "shank": np.asarray(table["fitted"]["knee_axis"]),
        "foot": frames["tibia"] + np.asarray(joints["ankle"]["parent_offset"]),
    }
    parent = spec.worldbody
    for body_name, joint_name in zip(offsets, (None, *JOINTS), strict=True):
        body = parent.add_body(name=body_name, pos=scale.point(offsets[body_name]))
        parts = []
        for part in (part for part, owner in BODIES.items() if owner == body_name):
            rigid = source["bodies"][part]
            com, moments = np.asarray(rigid["com"], float), np.asarray(rigid["inertia"], float)
            parts.append((float(rigid["mass"]), frames[part], com, moments))
        mass, com, inertia = compose_inertia(parts)
        turn = np.array([to_world(axis) for axis in np.eye(3)]).T
        inertia = turn @ inertia @ turn.T * scale.mass * scale.height**2
        body.explicitinertial = True
        body.mass = digits(mass * scale.mass)
        body.ipos = scale.point(com)
        body.fullinertia = [digits(inertia[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        if body_name == "pelvis" and planar:
            _add_root(body)
        if joint_name == "knee" and "knee_motion" in table["fitted"]:
            _add_knee_slides(spec, body, table["fitted"]["knee_motion"], scale)
        if joint_name is not None:
            low, high = joints[joint_name]["range_deg"]
            joint = body.add_joint(name=joint_name, axis=list(FLEXION_AXIS))
            joint.limited = True
            joint.range = [math.radians(low), math.radians(high)]
        parent = body
    return frames


def _add_root(pelvis: Any) -> None:
    """Let the pelvis move in the sagittal plane; the slides' values are its place in the world."""
    import mujoco

    for name, axis in zip(ROOT_JOINTS, _ROOT_AXES, strict=True):
        joint = pelvis.add_joint(name=name, axis=list(axis))
        if name != ROOT_JOINTS[-1]:
            joint.type = mujoco.mjtJoint.mjJNT_SLIDE
            joint.ref = float(np.dot(axis, pelvis.pos))


def _add_knee_slides(spec: mujoco.MjSpec, shank: Any, motion: Sequence[Sequence[float]], scale: Scale) -> None:
    """Let the knee's axis move in the thigh, by polynomials of the knee's angle (see :mod:`mjhcmc.leg8.knee`)."""
    import mujoco

    forward, up = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]
    *_, cam, last = KNEE_SLIDES
    for name, axis, coefficients in zip(KNEE_SLIDES, (forward, up, up, forward), motion, strict=True):
        slide = shank.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        slide.armature = _CAM_ARMATURE * scale.mass if name in (cam, last) else 0.0
        equality = spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_JOINT, name1=name)
        equality.name2 = cam if name == last else "knee"
        equality.objtype = mujoco.mjtObj.mjOBJ_JOINT
        powers = [1 - power if name == last else 1 for power in range(1, 5)]  # of the length that coefficients hold
        scaled = (value * scale.height**power for value, power in zip(coefficients, powers, strict=True))
        equality.data[:5] = [0.0, *(digits(value) for value in scaled)]
        equality.solref = list(_KNEE_SOLREF)
        equality.solimp = list(_KNEE_SOLIMP)


def _add_sensors(spec: mujoco.MjSpec, joints: Sequence[str]) -> None:
    """Add position and velocity of each joint, and length, velocity and force of each muscle."""
    import mujoco

    kind, obj = mujoco.mjtSensor, mujoco.mjtObj
    for joint in joints:
        for suffix, sensor in (("pos", kind.mjSENS_JOINTPOS), ("vel", kind.mjSENS_JOINTVEL)):
            spec.add_sensor(name=f"{joint}_{suffix}", type=sensor, objtype=obj.mjOBJ_JOINT, objname=joint)
    for muscle in MUSCLES:
        for suffix, sensor in (
            ("length", kind.mjSENS_ACTUATORPOS),
            ("velocity", kind.mjSENS_ACTUATORVEL),
            ("force", kind.mjSENS_ACTUATORFRC),
        ):
            spec.add_sensor(name=f"{muscle}_{suffix}", type=sensor, objtype=obj.mjOBJ_ACTUATOR, objname=muscle)

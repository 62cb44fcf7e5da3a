"""Build leg8 with ``mujoco.MjSpec`` from the parameter table, at any body mass and height.

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
from numpy.typing import NDArray

from mjhcmc.errors import ModelError, SettingsError
from mjhcmc.leg8.table import JOINTS, MUSCLES, load_table
from mjhcmc.opensim_names import MUSCLES_TEXT, PATHS_TEXT, PENNATION_TEXT

if TYPE_CHECKING:
    import mujoco

SOURCE_BODY_MASS = 75.1646
"""Body mass of the source model, kg."""

SOURCE_HEIGHT = 1.8
"""Stature of the source model, m."""

FLEXION_AXIS = (0.0, -1.0, 0.0)
"""The source's +z axis in the model's world; the axis of each hinge."""

COORDINATE_MAP_NAME = "opensim_coordinates"
"""Name of the model's custom text that maps joints onto OpenSim's coordinate names."""

_SITE_SIZE = [0.004, 0.005, 0.005]  # a sphere; the last two are MuJoCo's defaults, which the file leaves out
_CYLINDER_QUAT = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)  # a cylinder's own axis z onto the flexion axis
_BODIES = {"pelvis": "pelvis", "femur": "thigh", "tibia": "shank", "talus": "foot", "calcn": "foot", "toes": "foot"}

Vector = NDArray[np.float64]


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
    import mujoco

    _require("body_mass", body_mass, 20.0, 250.0, "kg")
    _require("height", height, 1.0, 2.5, "m")
    table = load_table() if table is None else table
    source = table["source"]
    scale = _Scale(body_mass / source["body_mass"], height / source["height"])

    spec = mujoco.MjSpec()
    spec.modelname = "leg8"
    spec.compiler.degree = False
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.timestep = 0.001
    spec.option.gravity = to_world(source["gravity"])
    _add_names(spec, source)
    frames = _add_bodies(spec, table, scale)
    _add_muscles(spec, table, scale, frames)
    _add_sensors(spec)
    spec.add_key(name="rest", qpos=[0.0] * len(JOINTS), act=[0.0] * len(MUSCLES), ctrl=[0.0] * len(MUSCLES))
    _add_appearance(spec, table["appearance"], scale, frames)
    return spec


class _Scale:
    """Ratios of body mass and height to the source's, applied to the quantities of the table."""

    def __init__(self, mass: float, height: float) -> None:
        self.mass = mass
        self.height = height

    def point(self, pos: Sequence[float] | Vector) -> list[float]:
        """A point of the source in the model's frame, m, to a micrometre."""
        return [round(float(x), 6) + 0.0 for x in np.asarray(to_world(pos)) * self.height]

    def length(self, value: float) -> float:
        return digits(value * self.height)


def to_world(vector: Sequence[float] | Vector) -> list[float]:
    """A vector of the source's frame (y up) in the model's frame (z up): (x, y, z) becomes (x, -z, y)."""
    x, y, z = (float(c) for c in vector)
    return [x, -z + 0.0, y]


def digits(value: float) -> float:
    """A value at the six significant digits that MuJoCo writes to XML, so that file and builder agree."""
    return float(f"{value:.6g}")


def fiber_mapping(muscle: Mapping[str, float]) -> tuple[float, float, float]:
    """What a rigid-tendon Hill muscle gives MuJoCo's muscle, which has no pennation.

    With pennation angle alpha at the optimal length, fiber length along the tendon is lopt cos(alpha), force along
    the tendon F0 cos(alpha), and fiber velocity is tendon velocity times cos(alpha), so that the maximum velocity in
    the reduced length is vmax / cos(alpha)^2. Exact at the optimal length (Zajac 1989; Millard et al. 2013).

    Args:
        muscle: A muscle's entry in the table's ``source`` section.

    Returns:
        Length unit lopt cos(alpha) in m, force F0 cos(alpha) in N, and the factor 1/cos(alpha)^2 of the velocity.
    """
    cosine = math.cos(muscle["pennation_angle"])
    return (
        muscle["optimal_fiber_length"] * cosine,
        muscle["max_isometric_force"] * cosine,
        1.0 / cosine**2,
    )


def compose_inertia(parts: Sequence[tuple[float, Vector, Vector, Vector]]) -> tuple[float, Vector, Vector]:
    """Mass, centre of mass and inertia of rigidly joined parts, by the parallel axis theorem.

    Args:
        parts: For each part its mass (kg), the origin of its frame, its centre of mass in that frame (m), and its
            principal moments about it (kg m^2); all frames parallel.

    Returns:
        Mass, centre of mass (3,) and inertia about it (3, 3).
    """
    mass = sum(part[0] for part in parts)
    centres = [origin + com for _, origin, com, _ in parts]
    centre = np.sum([part[0] * c for part, c in zip(parts, centres, strict=True)], axis=0) / mass
    inertia = np.zeros((3, 3))
    for part, c in zip(parts, centres, strict=True):
        d = c - centre
        inertia += np.diag(part[3]) + part[0] * (d @ d * np.eye(3) - np.outer(d, d))
    return mass, centre, inertia


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


def _require(name: str, value: float, low: float, high: float, unit: str) -> None:
    try:
        valid = low <= float(value) <= high
    except (TypeError, ValueError):
        valid = False
    if not valid:
        raise SettingsError(f"leg8: {name} is {value!r}: give a number from {low:g} to {high:g} {unit}")


def _add_names(spec: mujoco.MjSpec, source: Mapping[str, Any]) -> None:
    """Add the texts that tell what OpenSim calls joints and muscles, and the pennation that MuJoCo has no place for."""
    coordinates = {joint: source["joints"][joint]["coordinate"] for joint in JOINTS}
    texts = {
        COORDINATE_MAP_NAME: coordinates,
        PATHS_TEXT: {joint: f"/jointset/{joint}_r/{coordinate}" for joint, coordinate in coordinates.items()},
        MUSCLES_TEXT: {muscle: f"{muscle}_r" for muscle in MUSCLES},
        PENNATION_TEXT: {muscle: f"{source['muscles'][muscle]['pennation_angle']:.9g}" for muscle in MUSCLES},
    }
    for name, pairs in texts.items():
        spec.add_text(name=name, data=" ".join(f"{key}={value}" for key, value in pairs.items()))


def _add_bodies(spec: mujoco.MjSpec, table: Mapping[str, Any], scale: _Scale) -> dict[str, Vector]:
    """Add the chain of bodies and hinges; returns the source's frames (see :func:`source_frames`)."""
    source, frames = table["source"], source_frames(table)
    joints = source["joints"]
    offsets = {
        "pelvis": np.zeros(3),
        "thigh": np.asarray(joints["hip"]["parent_offset"]),
        "shank": np.asarray(table["fitted"]["knee_axis"]),
        "foot": frames["tibia"] + np.asarray(joints["ankle"]["parent_offset"]),
    }
    parent = spec.worldbody
    for body_name, joint_name in zip(offsets, (None, *JOINTS), strict=True):
        body = parent.add_body(name=body_name, pos=scale.point(offsets[body_name]))
        parts = []
        for part in (part for part, owner in _BODIES.items() if owner == body_name):
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
        if joint_name is not None:
            low, high = joints[joint_name]["range_deg"]
            joint = body.add_joint(name=joint_name, axis=list(FLEXION_AXIS))
            joint.limited = True
            joint.range = [math.radians(low), math.radians(high)]
        parent = body
    return frames


def _add_muscles(spec: mujoco.MjSpec, table: Mapping[str, Any], scale: _Scale, frames: Mapping[str, Vector]) -> None:
    """Add sites, wrapping cylinders, tendons and actuators."""
    import mujoco

    common, fitted, look = table["source"]["muscle_common"], table["fitted"], table["appearance"]
    curves = fitted["curves"]
    for name, wrap in fitted["wraps"].items():
        body = spec.body(_BODIES[wrap["body"]])
        origin = frames[wrap["body"]]
        body.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            pos=scale.point(np.asarray(wrap["pos"]) + origin),
            quat=list(_CYLINDER_QUAT),
            size=[scale.length(wrap["radius"]), scale.length(look["wrap_half_width"]), 0.0],
            rgba=look["colors"]["wrap"],
            contype=0,
            conaffinity=0,
            group=3,
        )
        body.add_site(name=f"{name}_side", pos=scale.point(np.asarray(wrap["side"]) + origin), group=4, size=_SITE_SIZE)

    for name in MUSCLES:
        muscle = table["source"]["muscles"][name]
        color = look["colors"][name]
        tendon = spec.add_tendon(name=f"{name}_tendon", width=scale.length(look["tendon_width"]), rgba=color)
        for point in fitted["paths"][name]:
            if "wrap" in point:
                tendon.wrap_geom(point["wrap"], f"{point['wrap']}_side")
                continue
            site = f"{name}_{point['name']}"
            body = spec.body(_BODIES[point["body"]])
            pos = np.asarray(point["pos"]) + frames[point["body"]]
            body.add_site(name=site, pos=scale.point(pos), group=3, size=_SITE_SIZE, rgba=color)
            tendon.wrap_site(site)

        unit, force, velocity = fiber_mapping(muscle)
        # Tension F0 beta v_fiber/(vmax lopt) cos(alpha) with v_fiber = v_tendon cos(alpha) (Millard et al. 2013).
        slope = common["fiber_damping"] / (common["max_fiber_velocity"] * muscle["optimal_fiber_length"])
        damping = slope * force * math.cos(muscle["pennation_angle"])
        tendon.damping[0] = digits(damping * scale.mass / scale.height)

        slack = muscle["tendon_slack_length"] + fitted["slack_offset"][name]
        limits = fitted["length_range"][name]
        norm_range = [digits((value - slack) / unit) for value in limits]
        if norm_range[0] < 0:  # MuJoCo would silently take its default instead
            raise ModelError(f"leg8 table: length_range of {name} begins at {limits[0]:g} m: take at least {slack:g} m")
        actuator = spec.add_actuator(name=name, target=f"{name}_tendon", trntype=mujoco.mjtTrn.mjTRN_TENDON)
        actuator.set_to_muscle(
            timeconst=[common["activation_time"], common["deactivation_time"]],
            tausmooth=0.0,
            range=norm_range,
            force=digits(force * scale.mass),
            scale=200.0,
            lmin=curves["lmin"],
            lmax=curves["lmax"],
            vmax=digits(curves["vmax"] * velocity),
            fpmax=curves["fpmax"],
            fvmax=curves["fvmax"],
        )
        actuator.lengthrange = [scale.length(value) for value in limits]
        actuator.ctrllimited = True
        actuator.ctrlrange = [0.0, 1.0]


def _add_sensors(spec: mujoco.MjSpec) -> None:
    """Add position and velocity of each joint, and length, velocity and force of each muscle."""
    import mujoco

    kind, obj = mujoco.mjtSensor, mujoco.mjtObj
    for joint in JOINTS:
        for suffix, sensor in (("pos", kind.mjSENS_JOINTPOS), ("vel", kind.mjSENS_JOINTVEL)):
            spec.add_sensor(name=f"{joint}_{suffix}", type=sensor, objtype=obj.mjOBJ_JOINT, objname=joint)
    for muscle in MUSCLES:
        for suffix, sensor in (
            ("length", kind.mjSENS_ACTUATORPOS),
            ("velocity", kind.mjSENS_ACTUATORVEL),
            ("force", kind.mjSENS_ACTUATORFRC),
        ):
            spec.add_sensor(name=f"{muscle}_{suffix}", type=sensor, objtype=obj.mjOBJ_ACTUATOR, objname=muscle)


def _add_appearance(spec: mujoco.MjSpec, look: Mapping[str, Any], scale: _Scale, frames: Mapping[str, Vector]) -> None:
    """Add the visible shapes, without mass and without contact, a light and a camera."""
    import mujoco

    types = {
        "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
        "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    }
    for shape in look["geoms"]:
        body = spec.body(_BODIES[shape["body"]])
        origin = frames[shape["body"]]
        geom = body.add_geom(name=shape["name"], type=types[shape["type"]], contype=0, conaffinity=0, group=1)
        geom.rgba = look["colors"][shape["color"]]
        if "fromto" in shape:
            geom.size = [scale.length(shape["size"][0]), 0.0, 0.0]
            ends = [scale.point(np.asarray(shape["fromto"][i : i + 3]) + origin) for i in (0, 3)]
            geom.fromto = [*ends[0], *ends[1]]
        else:
            forward, up, side = shape["size"]
            geom.size = [scale.length(value) for value in (forward, side, up)]
            geom.pos = scale.point(np.asarray(shape["pos"]) + origin)
            angle = math.radians(shape.get("pitch_deg", 0.0))
            geom.quat = [math.cos(angle / 2), 0.0, -math.sin(angle / 2), 0.0]
    _add_scene(spec, look, scale)


def _add_scene(spec: mujoco.MjSpec, look: Mapping[str, Any], scale: _Scale) -> None:
    """Add the sky, two lights, and the camera ``side`` that sees the whole leg from the front right."""
    import mujoco

    bottom, top = look["sky"]
    sky = spec.add_texture(name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=64, height=384)
    sky.builtin = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    sky.rgb1, sky.rgb2 = bottom, top
    spec.visual.headlight.ambient = [0.3, 0.3, 0.3]
    spec.visual.headlight.diffuse = [0.25, 0.25, 0.25]
    spec.visual.headlight.specular = [0.1, 0.1, 0.1]
    spec.visual.global_.offwidth = 1920
    spec.visual.global_.offheight = 1440
    for name, place, strength in (("key", [1.5, -2.0, 1.5], 0.5), ("fill", [-2.0, -1.0, 0.5], 0.15)):
        light = spec.worldbody.add_light(name=name, pos=place, dir=[-value for value in place])
        light.diffuse = [strength] * 3
        light.castshadow = False
    camera = look["camera"]
    pos, target = (np.asarray(scale.point(camera[key])) for key in ("pos", "target"))
    back = (pos - target) / np.linalg.norm(pos - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.stack([right, np.cross(back, right), back], axis=1).ravel())
    side = spec.worldbody.add_camera(name="side", fovy=camera["fovy"])
    side.pos, side.quat = list(pos), [digits(value) for value in quat]

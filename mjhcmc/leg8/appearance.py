"""What leg8 looks like: shapes without mass and without contact, sky, lights and a camera."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mjhcmc.leg8.geometry import Scale, Vector, digits
from mjhcmc.leg8.muscles import BODIES

if TYPE_CHECKING:
    import mujoco


def add_appearance(
    spec: mujoco.MjSpec,
    look: Mapping[str, Any],
    scale: Scale,
    frames: Mapping[str, Vector],
    *,
    follow: str | None = None,
) -> None:
    """Add the visible shapes, without mass and without contact, lights and a camera.

    Args:
        spec: The model.
        look: The table's ``appearance``.
        scale: Ratios of mass and height.
        frames: Origin of each of the source's frames in its body, m.
        follow: The body that lights and camera stay beside; they stand still where None.
    """
    import mujoco

    types = {
        "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
        "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    }
    for shape in look["geoms"]:
        body = spec.body(BODIES[shape["body"]])
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
    _add_scene(spec, look, scale, follow)


def _add_scene(spec: mujoco.MjSpec, look: Mapping[str, Any], scale: Scale, follow: str | None) -> None:
    """Add the sky, two lights, and the camera ``side`` that sees the whole leg from the front and its outer side."""
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
    camera = look["camera"]
    pos, target = (np.asarray(scale.point(camera[key])) for key in ("pos", "target"))
    outward = math.copysign(1.0, pos[1])
    owner = spec.worldbody if follow is None else spec.body(follow)
    mode = mujoco.mjtCamLight.mjCAMLIGHT_FIXED if follow is None else mujoco.mjtCamLight.mjCAMLIGHT_TRACK
    for name, place, strength in (("key", [1.5, 2.0, 1.5], 0.5), ("fill", [-2.0, 1.0, 0.5], 0.15)):
        place[1] *= outward
        light = owner.add_light(name=name, pos=place, dir=[-value for value in place], mode=mode)
        light.diffuse = [strength] * 3
        light.castshadow = False
    back = (pos - target) / np.linalg.norm(pos - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.stack([right, np.cross(back, right), back], axis=1).ravel())
    side = owner.add_camera(name="side", fovy=camera["fovy"], mode=mode)
    side.pos, side.quat = list(pos), [digits(value) for value in quat]

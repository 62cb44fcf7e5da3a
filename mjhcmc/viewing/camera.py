"""Where one looks from: a camera that stands still and sees the whole motion, from the side on which it moves most."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError
from mjhcmc.viewing.frames import Frames

Array = NDArray[np.float64]

VIEWS = ("side", "front", "top")

FIELD_OF_VIEW = 28.0
"""Degrees, of the height of the picture: narrow, so that angles look nearly as they are."""

_ELEVATION = {"side": -5.0, "front": -5.0, "top": -89.0}  # degrees
_SAMPLES = 40  # frames that are looked at
_SNAP = math.radians(30.0)  # a side this near to an axis is taken for it
_OUTER = 0.03  # of the size: farther than that from the middle, a limb is a left or a right one
_FAR = 2.0  # m, from what has no size


@dataclass(frozen=True)
class Margins:
    """Parts of a picture that what moves is kept out of: of its height at head and foot, of its width at each side."""

    head: float = 0.03
    foot: float = 0.03
    side: float = 0.03


def make_camera(frames: Frames, name: str = "side", *, aspect: float = 4 / 3, margins: Margins | None = None) -> Any:
    """``mujoco.MjvCamera``, which stands still unless it is one of the model's own that moves.

    Args:
        frames: what has to be in the picture, all through.
        name: ``side`` looks along the horizontal direction in which least moves (x, forward, is to the right where that
            is y), ``front`` at a right angle to it, ``top`` from above; else the name of one of the model's cameras.
        aspect: width over height of the picture.
        margins: that are kept free.

    Raises:
        SettingsError: there is no such camera.
    """
    m = frames.model
    check_camera(m, name)
    camera = mujoco.MjvCamera()
    if name not in VIEWS:
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        camera.fixedcamid = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_CAMERA, name)
        return camera
    azimuth, elevation, points = _view(frames, name)
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.azimuth, camera.elevation = math.degrees(azimuth), math.degrees(elevation)
    camera.lookat[:], camera.distance = _fit(points, _axes(azimuth, elevation), aspect, margins or Margins())
    return camera


def natural_aspect(frames: Frames, name: str = "side") -> float:
    """Width over height of what is seen of the motion; 4/3 by the model's own cameras, and where nothing has a size."""
    if name not in VIEWS:
        return 4 / 3
    azimuth, elevation, points = _view(frames, name)
    if not len(points):
        return 4 / 3
    width, height = np.ptp(points @ _axes(azimuth, elevation)[:2].T, axis=0)
    return float(width / height) if height > 0 else 4 / 3


def check_camera(m: Any, name: str) -> None:
    """See that there is such a camera.

    Raises:
        SettingsError: there is none.
    """
    own = [mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_CAMERA, i) for i in range(m.ncam)]
    if name not in VIEWS and name not in own:
        others = ", ".join(sorted({n for n in own if n} - set(VIEWS)))
        has = f", or of the model's own: {others}" if others else "; the model has no other camera with a name"
        raise SettingsError(f"no camera {name!r}: choose one of {', '.join(VIEWS)}{has}")


def moving_geoms(m: Any) -> NDArray[np.intp]:
    """Geoms that are shown and move: nothing of the world, no planes."""
    return np.flatnonzero(_shown(m) & (m.body_weldid[m.geom_bodyid] != 0))


def _shown(m: Any) -> NDArray[np.bool_]:
    found = (m.geom_group < 3) & (m.geom_rgba[:, 3] > 0) & (m.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    return np.asarray(found, dtype=bool)


def _beside(frames: Frames, moving: NDArray[np.intp]) -> NDArray[np.intp]:
    """Geoms of the world that belong to a limb, such as a pelvis that is fixed: near it, and smaller."""
    m = frames.model
    if not len(moving):
        return np.flatnonzero(_shown(m))
    where, reach = frames.place(frames.qpos[0]).geom_xpos, m.geom_rbound[:, None]
    low, high = (where - reach)[moving].min(axis=0), (where + reach)[moving].max(axis=0)
    near = ((where > low) & (where < high)).all(axis=1) & (m.geom_rbound < np.linalg.norm(high - low) / 3)
    return np.flatnonzero(_shown(m) & (m.body_weldid[m.geom_bodyid] == 0) & near)


def _view(frames: Frames, name: str) -> tuple[float, float, Array]:
    """Azimuth and elevation, rad, and (points, 3) m, all that is to be seen."""
    places, moving = _places(frames)
    poses = places[:, :moving].reshape(-1, moving // 2, 3)  # actual and desired alike
    azimuth = _side(poses) + (math.pi / 2 if name == "front" else 0.0)
    return azimuth, math.radians(_ELEVATION[name]), places.reshape(-1, 3)


def _places(frames: Frames) -> tuple[Array, int]:
    """(frames, points, 3) m, where all is and where it should be: corners of geoms, sites on paths; how many move."""
    m = frames.model
    moving = moving_geoms(m)
    geoms = np.concatenate([moving, _beside(frames, moving)])
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    local = m.geom_aabb[geoms, None, :3] + corners * m.geom_aabb[geoms, None, 3:]  # (geoms, 8, 3)
    sites = np.unique(m.wrap_objid[m.wrap_type == mujoco.mjtWrap.mjWRAP_SITE]).astype(np.intp)
    first = 8 * len(moving)
    found = []
    for k in np.unique(np.linspace(0, len(frames) - 1, _SAMPLES).round().astype(int)):
        parts: list[Array] = []
        for qpos in (frames.qpos[k], frames.desired[k]):
            data = frames.place(qpos)
            turn = data.geom_xmat[geoms].reshape(-1, 3, 3)
            at = (data.geom_xpos[geoms, None] + np.einsum("gij,gcj->gci", turn, local)).reshape(-1, 3)
            parts = [at[:first], *parts, at[first:], data.site_xpos[sites]]
        found.append(np.concatenate(parts))
    return np.array(found), 2 * first


def _side(places: Array) -> float:
    """Azimuth, rad, of a camera that looks along the horizontal direction in which least moves."""
    if not places.size:
        return math.pi / 2
    moves = (places - places.mean(axis=0))[..., :2].reshape(-1, 2)
    spread = moves.T @ moves / len(moves)
    away = np.array([0.0, 1.0])
    if np.trace(spread) > 1e-10:
        away = np.linalg.eigh(spread)[1][:, 0]
        for axis in (np.array([0.0, 1.0]), np.array([1.0, 0.0])):
            if abs(away @ axis) > math.cos(_SNAP):
                away = axis
    away = away if away[np.argmax(np.abs(away))] > 0 else -away
    size = np.ptp(places, axis=(0, 1)).max()
    if places.mean(axis=(0, 1))[:2] @ away > _OUTER * size:  # a left limb: seen from its outer side
        away = -away
    return math.atan2(away[1], away[0])


def _axes(azimuth: float, elevation: float) -> Array:
    """(3, 3) unit vectors to the right, up and ahead, as MuJoCo's free camera has them."""
    level = math.cos(elevation)
    ahead = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])
    right = np.array([math.sin(azimuth), -math.cos(azimuth), 0.0])
    return np.stack([right, np.cross(right, ahead), ahead])


def _fit(points: Array, axes: Array, aspect: float, margins: Margins) -> tuple[Array, float]:
    """What to look at, and from how far, for all points to be within the margins."""
    if not len(points):
        return np.zeros(3), _FAR
    seen = points @ axes.T
    half = math.tan(math.radians(FIELD_OF_VIEW) / 2)
    room = half * np.array([aspect * (1 - 2 * margins.side), 1 - margins.head - margins.foot])
    centre = (seen.min(axis=0) + seen.max(axis=0)) / 2
    distance = _FAR
    for _ in range(8):  # nearer points look larger: the middle of the picture is found in a few steps
        off = seen - centre
        distance = float((np.abs(off[:, :2]) / room - off[:, 2:]).max())
        flat = off[:, :2] * (distance / np.maximum(distance + off[:, 2:], 1e-6))
        centre[:2] += (flat.min(axis=0) + flat.max(axis=0)) / 2
    distance = max(distance, 1e-3)
    centre[1] += (margins.head - margins.foot) * half * distance
    return np.asarray(axes.T @ centre), distance

"""How what is drawn moves: poses of rigid groups, tendon paths through them, and the first view, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.report.replay_shapes import Shape, in_group
from mjhcmc.viewing.gaps import gaps_of

if TYPE_CHECKING:
    from mjhcmc.viewing.frames import Frames

Array = NDArray[np.float64]

_FOLLOWED = 0.6  # sizes of the model: the view follows one that goes farther
_STILL = 1e-9  # m, or of a quaternion: what moves less stands still
_FROM_ABOVE = np.deg2rad(50.0)  # a plane of motion that is flatter is seen from above,
_ABOVE = np.deg2rad(60.0)  # from so high
_NEAR = 0.12  # sizes of what moves
_SHAPES = 60  # of the moving ones: enough to find the plane of motion from


@dataclass(frozen=True, eq=False)
class Path:
    """The path of a spatial tendon: what it goes through, from origin to insertion.

    Attributes:
        tendon: its number.
        stops: a group's body and (3,) m in its frame for a site; the slot for a geom that it may wrap; None for a
            pulley, where the path divides.
        closed: which pulleys (indices into stops) divide nothing: the path goes on there.
    """

    tendon: int
    stops: tuple[tuple[int, Array] | int | None, ...]
    closed: frozenset[int] = frozenset()


@dataclass(frozen=True, eq=False)
class Poses:
    """Where everything is, in the world, frame by frame.

    Attributes:
        bodies: (G,) the bodies that groups are rooted in; the first is the world.
        position: (n, G, 3) m.
        quaternion: (n, G, 4), its sign without jumps.
        desired_position: (n, G, 3) m.
        desired_quaternion: (n, G, 4).
        wraps: (n, W) whether each geom that a path may wrap is wrapped.
        wrap_points: (n, W, 2, 3) m, where the path meets the geom and leaves it; NaN where it is not wrapped.
    """

    bodies: NDArray[np.intp]
    position: Array
    quaternion: Array
    desired_position: Array
    desired_quaternion: Array
    wraps: NDArray[np.bool_]
    wrap_points: Array

    @property
    def moving(self) -> NDArray[np.intp]:
        """The groups (indices into bodies) that move, or are to move."""
        place = np.stack([self.position, self.desired_position]) - self.position[0]
        turn = np.stack([self.quaternion, self.desired_quaternion]) - self.quaternion[0]
        return np.flatnonzero(np.maximum(np.abs(place).max(axis=(0, 1, 3)), np.abs(turn).max(axis=(0, 1, 3))) > _STILL)

    def world(self, body: int, points: Array) -> Array:
        """(n, .., 3) m of points (.., 3) in the frame of a group."""
        g = int(np.flatnonzero(self.bodies == body)[0])
        turn = rotation_matrices(self.quaternion[:, g])
        return np.asarray(np.einsum("nij,mj->nmi", turn, points) + self.position[:, g, None])


@dataclass(frozen=True, eq=False)
class View:
    """The first view: an orthographic projection.

    Attributes:
        right: (3,) unit vector.
        up: (3,) unit vector.
        axis: (3,) unit vector against gravity, which the view is turned about.
        half: (2,) m, half width and height of what is to be seen.
        centre: (n, 3) m, the middle of the picture; the same for all frames unless it follows the model.
        follows: whether it does.
    """

    right: Array
    up: Array
    axis: Array
    half: Array
    centre: Array
    follows: bool


def paths_of(model: Any) -> list[Path]:
    """The paths of all spatial tendons; slots of geoms are numbered through."""
    found, slot, gaps = [], 0, gaps_of(model)
    for t in range(model.ntendon):
        stops: list[tuple[int, Array] | int | None] = []
        for w in range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t]):
            kind, of = int(model.wrap_type[w]), int(model.wrap_objid[w])
            if kind == mujoco.mjtWrap.mjWRAP_SITE:
                body, at = in_group(model, int(model.site_bodyid[of]), _site(model, of))
                stops.append((body, at[0]))
            elif kind in (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER):
                stops.append(slot)
                slot += 1
            elif kind == mujoco.mjtWrap.mjWRAP_PULLEY:
                stops.append(None)
        if stops:
            pulleys = [i for i, stop in enumerate(stops) if stop is None]
            closed = frozenset(pulleys[gap.pulley] for gap in gaps if gap.tendon == t)
            found.append(Path(t, tuple(stops), closed))
    return found


def poses_of(frames: Frames, chosen: NDArray[np.intp], paths: list[Path]) -> Poses:
    """Where groups and wrapping points are in the chosen frames."""
    m = frames.model
    bodies = np.array([b for b in range(m.nbody) if m.body_weldid[b] == b], dtype=np.intp)
    slots = sum(isinstance(stop, int) for path in paths for stop in path.stops)
    n = len(chosen)
    position, quaternion = np.empty((2, n, len(bodies), 3)), np.empty((2, n, len(bodies), 4))
    wraps, points = np.zeros((n, slots), dtype=np.bool_), np.full((n, slots, 2, 3), np.nan)
    for i, k in enumerate(chosen):
        for j, qpos in enumerate((frames.desired[k], frames.qpos[k])):  # the actual ones last: paths are theirs
            data = frames.place(qpos)
            position[j, i], quaternion[j, i] = data.xpos[bodies], data.xquat[bodies]
        _read_wraps(data, paths, wraps[i], points[i])
    for j in (1, 0):  # the actual ones change sign by themselves, the desired ones have theirs
        before = np.concatenate([quaternion[1, :1], quaternion[1, :-1]]) if j else quaternion[1]
        sign = np.where((quaternion[j] * before).sum(axis=-1) < 0, -1.0, 1.0)
        quaternion[j] *= (np.cumprod(sign, axis=0) if j else sign)[..., None]
    return Poses(bodies, position[1], quaternion[1], position[0], quaternion[0], wraps, points)


def first_view(model: Any, poses: Poses, shapes: list[Shape], paths: list[Path]) -> View:
    """From the side that shows most of the movement, upright, so that all of it is seen.

    Of the two sides that show the same, the one is taken from which what moves is in front of the rest; one that goes
    somewhere goes to the right.
    """
    up = axis = _upwards(model)
    east = np.array([1.0, 0, 0]) if abs(up[0]) < 0.9 else np.array([0, 1.0, 0])
    east = _unit(east - (east @ up) * up)
    north = np.cross(up, east)
    moving = set(poses.bodies[poses.moving].tolist())
    solid = [s for s in shapes if s.body in moving] or [s for s in shapes if s.body] or shapes
    cloud = [poses.world(s.body, s.reach[:: max(1, len(s.reach) // 12)]) for s in solid]
    on_bones = [stop for path in paths for stop in path.stops if isinstance(stop, tuple)]
    cloud += [poses.world(body, at[None]) for body, at in on_bones]
    cloud.append(poses.wrap_points.reshape(len(poses.position), -1, 3))
    every = np.concatenate(cloud, axis=1)
    every = every[:, ~np.isnan(every).any(axis=(0, 2))]
    if not every.shape[1]:
        every = poses.position
    low, high = every.min(axis=1), every.max(axis=1)
    centre = (low + high) / 2
    size = float((high - low).max())
    follows = bool(np.ptp(centre, axis=0).max() > _FOLLOWED * size > 0)
    middle = np.broadcast_to((low.min(axis=0) + high.max(axis=0)) / 2, centre.shape)
    if follows:  # along with the root, which goes more evenly than the limbs, but not up and down with it
        root = poses.position[:, poses.moving[0]]
        level = np.eye(3) - np.outer(up, up)
        middle = (root + (centre - root).mean(axis=0)) @ level + middle @ np.outer(up, up)

    on_moving = [
        poses.world(s.body, s.reach[:: max(1, len(s.reach) // 4)]) for s in solid[:: len(solid) // _SHAPES + 1]
    ]
    part = np.concatenate(on_moving, axis=1) if on_moving else every
    right, from_above = _plane_of_motion(part, size, (east, north, axis))
    right = right * _sense(right, axis, part, every, (centre[-1] - centre[0]) * follows)
    if from_above:
        toward = np.cos(_ABOVE) * np.cross(right, axis) + np.sin(_ABOVE) * axis
        up = np.cross(toward, right)
    every = np.concatenate([every, *_near(poses, shapes, moving, low.min(axis=0), high.max(axis=0))], axis=1)
    seen = (every - middle[:, None]) @ np.stack([right, up], axis=-1)
    least, most = seen.min(axis=(0, 1)), seen.max(axis=(0, 1))
    middle = middle + (least + most) / 2 @ np.stack([right, up])
    half = (most - least) / 2
    return View(right, up, axis, np.maximum(half, 1e-3), np.array(middle), follows)


def _plane_of_motion(part: Array, size: float, frame: tuple[Array, Array, Array]) -> tuple[Array, bool]:
    """Right in a view on the plane of the main direction of motion and the longest extent across it.

    Also whether that plane is to be seen from above.

    Args:
        part: (n, .., 3) m, points that move.
        size: m, of the model.
        frame: east, north and up.
    """
    east, north, axis = frame
    away = (part - part.mean(axis=0)).reshape(-1, 3)
    spread = away.T @ away / max(len(away), 1)
    power, axes = np.linalg.eigh(spread)
    if power[2] <= (1e-5 * size) ** 2:  # nothing moves
        return east, False
    way = axes[:, 2]
    shape = part.mean(axis=0) - part.mean(axis=(0, 1))
    across = np.eye(3) - np.outer(way, way)
    extent = across @ (shape.T @ shape / len(shape) + spread) @ across
    normal = np.cross(way, np.linalg.eigh(extent)[1][:, 2])
    normal = _snapped(normal * (1.0 if normal @ axis >= 0 else -1.0), (east, north, axis))
    if normal @ axis < np.sin(_FROM_ABOVE):  # upright: from the side
        right = np.cross(axis, normal)
        return _snapped(_unit(right), (east, north)), False
    level = np.array([east, north])  # from above: the longer way lies across the picture
    right = np.linalg.eigh(level @ (shape.T @ shape) @ level.T)[1][:, 1] @ level
    right = _snapped(right, (east, north))
    return right, True


def _snapped(direction: Array, among: tuple[Array, ...]) -> Array:
    """The one of some directions that is within 20 degrees of it, in its sense; else itself."""
    for one in among:
        if abs(one @ direction) > np.cos(np.deg2rad(20)):
            return one * (1.0 if one @ direction > 0 else -1.0)
    return direction


def _near(poses: Poses, shapes: list[Shape], moving: set[int], low: Array, high: Array) -> list[Array]:
    """What of the solids that stand still is close to what moves: it is to be in the picture, too."""
    reach = _NEAR * float((high - low).max())
    found = []
    for shape in shapes:
        if shape.body and shape.body not in moving:
            points = poses.world(shape.body, shape.reach)
            if (points[0] > low - reach).all() and (points[0] < high + reach).all():
                found.append(points)
    return found


def where_it_acts(model: Any, actuator: int) -> tuple[int, Array]:
    """A group's body and (3,) m in its frame: the joint, site or body that an actuator without a path acts on."""
    kind, of = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
    if kind == mujoco.mjtTrn.mjTRN_TENDON:  # a fixed one: a weighted sum of joints, drawn at the first
        kind, of = int(mujoco.mjtTrn.mjTRN_JOINT), int(model.wrap_objid[model.tendon_adr[of]])
    if kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        body, at = int(model.jnt_bodyid[of]), model.jnt_pos[of]
    elif kind in (mujoco.mjtTrn.mjTRN_SITE, mujoco.mjtTrn.mjTRN_SLIDERCRANK):
        body, at = int(model.site_bodyid[of]), model.site_pos[of]
    else:
        body, at = max(of, 0), np.zeros(3)
    body, found = in_group(model, body, np.array(at, dtype=float)[None])
    return body, found[0]


def rotation_matrices(quaternion: Array) -> Array:
    """(.., 3, 3) of unit quaternions (.., 4), the real part first."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_vectors(quaternion: Array, desired: Array) -> Array:
    """(.., 3) rad: what turns each orientation into the desired one, in its own frame."""
    real = (quaternion * desired).sum(axis=-1, keepdims=True)  # of conj(q) * desired
    w, v = quaternion[..., :1], quaternion[..., 1:]
    imaginary = w * desired[..., 1:] - desired[..., :1] * v - np.cross(v, desired[..., 1:])
    sign = np.where(real < 0, -1.0, 1.0)
    length = np.linalg.norm(imaginary, axis=-1, keepdims=True)
    angle = 2 * np.arctan2(length, np.abs(real))
    return np.asarray(sign * imaginary * np.where(length > 1e-12, angle / np.maximum(length, 1e-12), 2.0))


def _sense(right: Array, up: Array, part: Array, every: Array, way: Array) -> float:
    """1 or -1: in which sense the horizontal axis goes.

    Args:
        right: (3,) the axis.
        up: (3,) upwards in the picture.
        part: (n, .., 3) m, points that move.
        every: (n, .., 3) m, all points.
        way: (3,) m, how far the model goes; 0 where it stays.
    """
    if abs(way @ right) > 0:
        return 1.0 if way @ right > 0 else -1.0
    moved = np.linalg.norm(part - part.mean(axis=0), axis=-1).mean(axis=0)
    if moved.max() > 0:
        nearer = float((moved @ part.mean(axis=0) / moved.sum() - every.mean(axis=(0, 1))) @ np.cross(right, up))
        if abs(nearer) > 0.02 * float(np.ptp(every.reshape(-1, 3), axis=0).max()):
            return 1.0 if nearer > 0 else -1.0
    return 1.0 if right[np.argmax(np.abs(right))] > 0 else -1.0


def _upwards(model: Any) -> Array:
    """(3,) against gravity; z where there is none."""
    gravity = np.array(model.opt.gravity, dtype=float)
    length = float(np.linalg.norm(gravity))
    return -gravity / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])


def _read_wraps(data: Any, paths: list[Path], wraps: NDArray[np.bool_], points: Array) -> None:
    """Fill in which geoms are wrapped, and where: two rows of wrap_xpos each, between those of sites."""
    xpos, what = data.wrap_xpos.reshape(-1, 3), data.wrap_obj.reshape(-1)
    for path in paths:
        row = int(data.ten_wrapadr[path.tendon])
        end = row + int(data.ten_wrapnum[path.tendon])
        for stop in path.stops:
            if not isinstance(stop, int):
                row += 1
            elif row < end and what[row] >= 0:
                wraps[stop], points[stop] = True, xpos[row : row + 2]
                row += 2


def _site(model: Any, site: int) -> Array:
    return np.array(model.site_pos[site], dtype=float)[None]


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))

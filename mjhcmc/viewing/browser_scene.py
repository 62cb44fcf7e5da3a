"""A model in viser's scene: what bodies look like is sent once, then only where they are."""

from __future__ import annotations

from itertools import product
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.viewing.meshes import Part, ground_of, parts_of, tube
from mjhcmc.viewing.poses import Poses
from mjhcmc.viewing.scene import GHOST_RGBA

Array = NDArray[np.float64]

GHOST = tuple(round(255 * c) for c in GHOST_RGBA[:3])
_THINNEST = 0.003  # m, of a tendon
_STILL = 1e-7  # m and quaternion: what moves less is not sent again
_HIDDEN = 1e-9  # of what has no length: 0 would make the browser's matrices singular
_SPARE = 4  # pieces of tendons, for wrapping that comes and goes
_FADE = 0.6
_BELOW = 0.01  # m, of a ground that the model does not have, under the lowest of its bodies
_MOVES = 1e-3  # m and quaternion: the camera looks at bodies that move more, and at muscles
_INSIDE = 1e-3  # m, that the ghost is thinner: where it is where it should be, it is not seen


class Scene:
    """What is drawn of one model.

    Args:
        server: a ``viser.ViserServer``.
        model: a ``mujoco.MjModel``.
        poses: all that will be shown, for the number of tendon pieces and for the camera; others may follow.
    """

    def __init__(self, server: Any, model: Any, poses: Poses) -> None:
        self._server, self._model = server, model
        self._radius = np.maximum(model.tendon_width, _THINNEST)
        self._shown: dict[str, tuple[Array, Array]] = {}
        self.pieces = poses.length.shape[1] + _SPARE
        up = -model.opt.gravity if np.any(model.opt.gravity) else np.array([0.0, 0.0, 1.0])
        scene = server.scene
        scene.set_up_direction(tuple(up / np.linalg.norm(up)))
        scene.world_axes.visible = False
        self._parts = parts_of(model)
        self._skin: list[Any] = []
        scene.add_frame("/bodies", show_axes=False)
        self._ghost_root = scene.add_frame("/ghost", show_axes=False)
        self._add_ground(poses, up / np.linalg.norm(up))
        self._bodies, self._ghosts = self._add_bodies(), self._add_ghost()
        self._tendons = self._add_tendons() if model.ntendon else None
        self._aim_camera(poses)

    def _add_bodies(self) -> dict[str, Any]:
        """Frames by their name, with what bodies look like in them; what is translucent is kept as skin."""
        found: dict[str, Any] = {}
        for i, part in enumerate(self._parts):
            solid = part.rgba[3] >= 1
            mesh = self._add_part(
                found, "bodies", i, part, part.vertices, color=_faded(part.rgba),
                opacity=None if solid else part.rgba[3], side="double" if solid else "front",
            )  # fmt: skip
            if not solid:
                mesh.visible = False
                self._skin.append(mesh)
        return found

    def _add_ghost(self) -> dict[str, Any]:
        """Frames by their name, of what moves and is not skin."""
        found: dict[str, Any] = {}
        for i, part in enumerate(self._parts):
            if self._model.body_weldid[part.body] != 0 and part.rgba[3] >= 1:
                inside = part.vertices - _INSIDE * part.normals
                self._add_part(found, "ghost", i, part, inside, color=GHOST, opacity=GHOST_RGBA[3])
        return found

    def _add_part(self, found: dict[str, Any], root: str, i: int, part: Part, vertices: Array, **look: Any) -> Any:
        scene, frame = self._server.scene, f"/{root}/{part.body}"
        if frame not in found:
            found[frame] = scene.add_frame(frame, show_axes=False)
        return scene.add_mesh_simple(
            f"{frame}/{i}", vertices, part.faces, cast_shadow=False, receive_shadow=False, **look
        )

    @property
    def has_skin(self) -> bool:
        """Whether something of the model is translucent; it is hidden at first, as it pales the muscles' colours."""
        return bool(self._skin)

    def show_skin(self, visible: bool) -> None:
        """Whether what is translucent is drawn."""
        for mesh in self._skin:
            mesh.visible = visible

    def _add_tendons(self) -> Any:
        vertices, faces = tube()
        n = self.pieces
        return self._server.scene.add_batched_meshes_simple(
            "/tendons", vertices, faces, np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.zeros((n, 3)),
            batched_scales=np.full((n, 3), _HIDDEN), batched_colors=np.zeros((n, 3), dtype=np.uint8), lod="off",
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    def _add_ground(self, poses: Poses, up: Array) -> None:
        plane = ground_of(self._model)
        if plane is None:
            corners = self._corners(poses)
            quat = np.empty(4)
            mujoco.mju_quatZ2Vec(quat, up)
            plane = up * ((corners @ up).min(initial=0.0) - _BELOW), quat
        self._server.scene.add_grid(
            "/ground", infinite_grid=True, position=plane[0], wxyz=plane[1], cell_size=0.1, section_size=0.5,
            cell_color=(225, 227, 230), section_color=(200, 204, 210), fade_distance=12.0, shadow_opacity=0.0,
            cell_thickness=0.7, section_thickness=1.0,
        )  # fmt: skip

    def _aim_camera(self, poses: Poses) -> None:
        """From the side, as the model's own view has it (its azimuth), all of the movement in the picture."""
        away = np.ptp(poses.body_position, axis=0).max(axis=-1) + np.ptp(poses.body_quat, axis=0).max(axis=-1)
        tendons = poses.middle[poses.length > 0]
        points = np.concatenate([self._corners(poses, away > _MOVES), tendons])
        if not len(points):
            points = np.zeros((1, 3))
        low, high = points.min(axis=0), points.max(axis=0)
        size = max(float(np.linalg.norm(high - low)), 0.2)
        azimuth = np.deg2rad(float(self._model.vis.global_.azimuth) - 25.0)  # a little from the front: it looks deeper
        elevation = np.deg2rad(-10.0)
        forward = np.array(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
        )
        camera = self._server.initial_camera
        camera.fov = np.deg2rad(40.0)
        camera.look_at = tuple((low + high) / 2)
        camera.position = tuple((low + high) / 2 - 1.8 * size * forward)

    def _corners(self, poses: Poses, which: NDArray[np.bool_] | None = None) -> Array:
        """Corners of the boxes around what bodies look like, in some frames; of all, or of those that are True."""
        found = []
        for part in [part for part in self._parts if part.rgba[3] >= 1] or self._parts:
            if which is not None and not which[part.body]:
                continue
            low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
            corners = np.array(list(product(*zip(low, high, strict=True))))
            for k in {0, len(poses.length) // 2, len(poses.length) - 1}:
                turn = np.empty(9)
                mujoco.mju_quat2Mat(turn, poses.body_quat[k, part.body])
                found.append(corners @ turn.reshape(3, 3).T + poses.body_position[k, part.body])
        return np.concatenate(found) if found else np.zeros((0, 3))

    def show(self, poses: Poses, k: int, ghost: tuple[Array, Array] | None = None) -> None:
        """Put everything where frame k has it.

        Args:
            poses: the frames.
            k: which.
            ghost: positions (n, nbody, 3) and quaternions (n, nbody, 4) of the ghost; its own by default.
        """
        position, quat = (poses.ghost_position, poses.ghost_quat) if ghost is None else ghost
        with self._server.atomic():
            self._move(self._bodies, poses.body_position[k], poses.body_quat[k])
            if self._ghost_root.visible:
                self._move(self._ghosts, position[k], quat[k])
            if self._tendons is not None:
                self._move_tendons(poses, k)

    def show_ghost(self, visible: bool) -> None:
        """Whether the desired motion is drawn."""
        self._ghost_root.visible = visible

    def on_tendon(self, call: Any) -> None:
        """Call back with the place (of the pieces in `Poses`) of a tendon that is clicked."""
        if self._tendons is not None:
            self._tendons.on_click(lambda event: call(event.instance_index))

    def _move(self, frames: dict[str, Any], position: Array, quat: Array) -> None:
        for name, frame in frames.items():
            body = int(name.rsplit("/", 1)[1])
            here = position[body], quat[body]
            before = self._shown.get(name)
            if before is not None and all(np.abs(a - b).max() < _STILL for a, b in zip(here, before, strict=True)):
                continue
            self._shown[name] = here
            frame.position, frame.wxyz = here

    def _move_tendons(self, poses: Poses, k: int) -> None:
        n = min(poses.length.shape[1], self.pieces)
        assert self._tendons is not None
        middle, quat = np.zeros((self.pieces, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (self.pieces, 1))
        scale = np.full((self.pieces, 3), _HIDDEN)
        colour = np.zeros((self.pieces, 3), dtype=np.uint8)
        middle[:n], quat[:n], colour[:n] = poses.middle[k, :n], poses.quat[k, :n], poses.colour[k, :n]
        radius = self._radius[poses.tendon[k, :n]]
        seen = poses.length[k, :n] > 0
        scale[:n][seen] = np.stack([radius, radius, poses.length[k, :n] / 2 + radius / 2], axis=-1)[seen]
        handle = self._tendons
        handle.batched_positions, handle.batched_wxyzs = middle, quat
        handle.batched_scales, handle.batched_colors = scale, colour


def _faded(rgba: tuple[float, float, float, float]) -> tuple[int, ...]:
    """A body's colour, 0 .. 255, most of the way to gray: colour is for activation."""
    gray = sum(rgba[:3]) / 3
    return tuple(round(255 * (_FADE * gray + (1 - _FADE) * c)) for c in rgba[:3])

"""What a model's bodies look like, as triangles in their own frames."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

_SHOWN_GROUPS = 3  # geom groups 0 .. 2, as MuJoCo's viewer begins
_ROUND = 24  # sides of what is round

_SPHERE, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_ELLIPSOID, _CYLINDER = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID), int(mujoco.mjtGeom.mjGEOM_CYLINDER)
_BOX, _MESH, _PLANE = (
    int(kind) for kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_PLANE)
)


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one colour in a body's frame.

    Attributes:
        body: the body.
        vertices: (n, 3) m.
        faces: (k, 3) rows of vertices, counterclockwise from outside.
        rgba: (4,) 0 .. 1.
    """

    body: int
    vertices: Array
    faces: Faces
    rgba: tuple[float, float, float, float]

    @property
    def normals(self) -> Array:
        """(n, 3) outward at the vertices, the mean of their faces' by area."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        face = np.cross(b - a, c - a)
        found = np.zeros_like(self.vertices)
        for i in range(3):
            np.add.at(found, self.faces[:, i], face)
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-30))


def parts_of(model: Any) -> tuple[Part, ...]:
    """The visible geoms of a ``mujoco.MjModel``, those of a body and colour in one; planes are left out."""
    groups: dict[tuple[int, tuple[float, ...]], list[tuple[Array, Faces]]] = {}
    for geom in range(model.ngeom):
        rgba = _rgba(model, geom)
        if not 0 <= model.geom_group[geom] < _SHOWN_GROUPS or rgba[3] <= 0:
            continue
        found = _triangles(model, geom)
        if found is not None:
            groups.setdefault((int(model.geom_bodyid[geom]), rgba), []).append(found)
    parts = []
    for (body, rgba), some in groups.items():
        firsts = np.cumsum([0, *(len(vertices) for vertices, _ in some)])
        faces = [own + first for (_, own), first in zip(some, firsts, strict=False)]
        colour = (rgba[0], rgba[1], rgba[2], rgba[3])
        parts.append(Part(body, np.concatenate([v for v, _ in some]), np.concatenate(faces), colour))
    return tuple(parts)


def ground_of(model: Any) -> tuple[Array, Array] | None:
    """Position (3,) and quaternion (4,) of the first plane that is fixed to the world; None without one."""
    for geom in range(model.ngeom):
        if model.geom_type[geom] == _PLANE and model.body_weldid[model.geom_bodyid[geom]] == 0:
            data = mujoco.MjData(model)
            mujoco.mj_kinematics(model, data)
            quat = np.empty(4)
            mujoco.mju_mat2Quat(quat, data.geom_xmat[geom])
            return data.geom_xpos[geom].copy(), quat
    return None


def _rgba(model: Any, geom: int) -> tuple[float, ...]:
    """The geom's own colour, or its material's where MuJoCo would take that."""
    rgba, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    if material >= 0 and np.array_equal(rgba, np.array([0.5, 0.5, 0.5, 1.0])):
        rgba = model.mat_rgba[material]
    return tuple(round(float(value), 4) for value in rgba)


def _triangles(model: Any, geom: int) -> tuple[Array, Faces] | None:
    """Vertices in the body's frame, and faces; None for what has no triangles here."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == _MESH:
        mesh = int(model.geom_dataid[geom])
        v0, f0 = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
        vertices = model.mesh_vert[v0 : v0 + model.mesh_vertnum[mesh]].astype(float)
        faces = model.mesh_face[f0 : f0 + model.mesh_facenum[mesh]].astype(np.int64)
    elif kind in (_SPHERE, _ELLIPSOID):
        vertices, faces = _ball()
        vertices = vertices * (size[0] if kind == _SPHERE else size)
    elif kind == _CAPSULE:
        ball, faces = _ball()
        vertices = ball * size[0] + np.where(ball[:, 2:] >= 0, 1.0, -1.0) * (0.0, 0.0, size[1])
    elif kind == _CYLINDER:
        vertices, faces = tube()
        vertices = vertices * (size[0], size[0], size[1])
    elif kind == _BOX:
        vertices, faces = _cube()
        vertices = vertices * size
    else:
        return None
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    return vertices @ turn.reshape(3, 3).T + model.geom_pos[geom], faces


@cache
def _ball() -> tuple[Array, Faces]:
    """The unit ball, with a ring twice at its equator, so that it can be drawn out into a capsule."""
    rows = _ROUND // 4
    upper = np.linspace(np.pi / 2, 0.0, rows + 1)
    latitude = np.concatenate([upper, -upper[::-1]])
    around = np.arange(_ROUND) * 2 * np.pi / _ROUND
    ring = np.stack([np.cos(around), np.sin(around)], axis=-1)
    z = np.sin(latitude)
    z[rows + 1] = -1e-12  # the equator of the lower half
    vertices = np.concatenate(
        [np.concatenate([np.cos(a) * ring, np.full((_ROUND, 1), h)], axis=1) for a, h in zip(latitude, z, strict=True)]
    )
    return vertices, _between_rings(len(latitude))


@cache
def tube() -> tuple[Array, Faces]:
    """A closed cylinder of radius 1 from z -1 to 1."""
    around = np.arange(_ROUND) * 2 * np.pi / _ROUND
    ring = np.stack([np.cos(around), np.sin(around)], axis=-1)
    rings = [(0.0, 1.0), (1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (1.0, -1.0), (0.0, -1.0)]  # edges twice: they are sharp
    vertices = np.concatenate([np.concatenate([r * ring, np.full((_ROUND, 1), z)], axis=1) for r, z in rings])
    return vertices, _between_rings(len(rings))


@cache
def _cube() -> tuple[Array, Faces]:
    """From -1 to 1, each side with corners of its own, so that edges are sharp."""
    vertices: list[Array] = []
    faces: list[Faces] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            side = np.zeros((4, 3))
            side[:, axis] = sign
            side[:, (axis + 1) % 3] = [-1, 1, 1, -1]
            side[:, (axis + 2) % 3] = [-1, -1, 1, 1]
            first = 4 * len(vertices)
            quad = np.array([[0, 1, 2], [0, 2, 3]])
            faces.append(first + (quad if sign > 0 else quad[:, ::-1]))
            vertices.append(side)
    return np.concatenate(vertices), np.concatenate(faces)


def _between_rings(count: int) -> Faces:
    """Triangles between rings of _ROUND vertices that go down."""
    i = np.arange(_ROUND)
    j = (i + 1) % _ROUND
    band = np.concatenate([np.stack([i, i + _ROUND, j], 1), np.stack([j, i + _ROUND, j + _ROUND], 1)])
    return np.concatenate([band + k * _ROUND for k in range(count - 1)])

"""What is drawn of a model: its geoms as ellipsoids, capsules and coarse meshes, each in the frame of a rigid group.

A group is a body with everything welded to it. Shapes are sent once, poses of groups for each frame: that keeps the
page small, and bones keep their shape.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHOWN_GROUPS = 3
"""Geoms of groups 0, 1 and 2 are drawn, as in MuJoCo's viewer; further groups hold wrapping and contact surfaces."""

MESH_VERTICES = 14_000
"""Of all meshes together, after thinning."""

_FEWEST, _MOST = 60, 2500  # vertices that a mesh keeps
_SIDES = 16  # of a cylinder
_DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)
_STICK = 0.02  # radius of a line figure's limb, as a share of its length
_MESHES = (int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_SDF))
_NO_SOLIDS = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


@dataclass(frozen=True, eq=False)
class Shape:
    """A solid in the frame of its group.

    Attributes:
        body: the group's body (the root of what is welded together); 0 is the world.
        kind: ``ellipsoid``, ``capsule`` or ``mesh``.
        points: (.., 3) m. Ellipsoid: centre and the ends of its three half axes, seen from the centre; capsule: both
            ends; mesh: the vertices.
        radius: m, of a capsule; 0 for others.
        faces: (.., 3) of a mesh, counterclockwise from outside.
        rgba: (4,) 0 .. 1.
        label: for messages and tests: the geom's name.
        geom: its number; -1 for a limb of a line figure.
    """

    body: int
    kind: str
    points: Array
    radius: float
    faces: NDArray[np.intp]
    rgba: Array
    label: str
    geom: int

    @property
    def reach(self) -> Array:
        """(.., 3) m, points that bound it, in the frame of its group."""
        if self.kind == "mesh":  # the corners of its box: some of its vertices would leave out its ends
            low, high = self.points.min(axis=0), self.points.max(axis=0)
            return np.array(
                [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
            )
        if self.kind == "capsule":
            around = self.radius * np.concatenate([np.eye(3), -np.eye(3)])
            return np.concatenate([end + around for end in self.points])
        centre, half = self.points[0], self.points[1:]
        return np.concatenate([centre + half, centre - half])


def shapes_of(model: Any, geoms: list[int] | None = None) -> list[Shape]:
    """Solids that are drawn; where a moving group has none, limbs of a line figure between its joints.

    Args:
        model: ``mujoco.MjModel``.
        geoms: which; all of `drawn_geoms` if None. Meshes are thinned so that these fit in the page.
    """
    geoms = drawn_geoms(model) if geoms is None else geoms
    own = [g for g in geoms if int(model.geom_type[g]) in _MESHES]
    detail = {g: np.sqrt(float(model.mesh_vertnum[model.geom_dataid[g]])) for g in own}
    sizes = {g: float(model.geom_rbound[g]) * detail[g] for g in own}
    share = MESH_VERTICES / max(sum(sizes.values()), 1e-9)
    found = [_solid(model, g, int(np.clip(share * sizes.get(g, 0.0), _FEWEST, _MOST))) for g in geoms]
    return [shape for shape in found if shape is not None] + list(_line_figure(model, {s.body for s in found if s}))


def drawn_geoms(model: Any) -> list[int]:
    """Geoms that are to be seen and have a volume."""
    return [g for g in range(model.ngeom) if _is_drawn(model, g)]


def corners_of(model: Any, geom: int) -> tuple[int, Array]:
    """The corners of a geom's bounding box in its group, and the group's body."""
    centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    sign = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return geom_in_group(model, geom, centre + sign * half)


def in_group(model: Any, body: int, points: Array) -> tuple[int, Array]:
    """Points (.., 3) given in a body's frame, in that of its group; and the group's body."""
    root = int(model.body_weldid[body])
    while body != root:
        points = points @ _matrix(model.body_quat[body]).T + model.body_pos[body]
        body = int(model.body_parentid[body])
    return root, points


def geom_in_group(model: Any, geom: int, points: Array) -> tuple[int, Array]:
    """The same for points in a geom's frame."""
    turn = _matrix(model.geom_quat[geom])
    return in_group(model, int(model.geom_bodyid[geom]), points @ turn.T + model.geom_pos[geom])


def planes_of(model: Any) -> list[tuple[int, Array]]:
    """Geoms that are planes: number, and (2,) half lengths in m, 0 where it has no end."""
    plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    return [(int(g), model.geom_size[g, :2].copy()) for g in np.flatnonzero(plane & (model.geom_group < SHOWN_GROUPS))]


def colour_of(model: Any, geom: int) -> Array:
    """(4,) red, green, blue, alpha in 0 .. 1: the geom's own or, where it is MuJoCo's default, its material's."""
    rgba, material = model.geom_rgba[geom].astype(float), int(model.geom_matid[geom])
    if material >= 0 and tuple(rgba) == _DEFAULT_RGBA:
        rgba = model.mat_rgba[material].astype(float)
    return np.asarray(np.clip(rgba, 0.0, 1.0))


def _is_drawn(model: Any, g: int) -> bool:
    return bool(
        model.geom_group[g] < SHOWN_GROUPS and int(model.geom_type[g]) not in _NO_SOLIDS and colour_of(model, g)[3] > 0
    )


def _solid(model: Any, g: int, vertices: int) -> Shape | None:
    kind, points, faces = _own_shape(model, g, vertices)
    if not len(points):
        return None
    body, points = geom_in_group(model, g, points)
    if kind == "ellipsoid":
        points[1:] -= points[0]  # half axes are directions
    radius = float(model.geom_size[g, 0]) if kind == "capsule" else 0.0
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, g) or f"geom{g}"
    return Shape(body, kind, points, radius, faces, colour_of(model, g), name, g)


def _own_shape(model: Any, g: int, vertices: int) -> tuple[str, Array, NDArray[np.intp]]:
    """Kind, points and faces in the geom's own frame."""
    size, none = model.geom_size[g].astype(float), np.zeros((0, 3), dtype=np.intp)
    match mujoco.mjtGeom(int(model.geom_type[g])):
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return "ellipsoid", np.vstack([np.zeros(3), np.eye(3) * size[0]]), none
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return "ellipsoid", np.vstack([np.zeros(3), np.diag(size)]), none
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return "capsule", np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]]), none
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return ("mesh", *_cylinder(size[0], size[1]))
        case mujoco.mjtGeom.mjGEOM_BOX:
            return ("mesh", *_box(size))
        case mujoco.mjtGeom.mjGEOM_MESH | mujoco.mjtGeom.mjGEOM_SDF if model.geom_dataid[g] >= 0:
            return ("mesh", *_mesh(model, int(model.geom_dataid[g]), vertices))
    return "mesh", np.zeros((0, 3)), none


def _mesh(model: Any, mesh: int, vertices: int) -> tuple[Array, NDArray[np.intp]]:
    first, n = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, m = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return thinned(
        model.mesh_vert[first : first + n].astype(float), model.mesh_face[face : face + m].astype(np.intp), vertices
    )


def thinned(points: Array, faces: NDArray[np.intp], vertices: int) -> tuple[Array, NDArray[np.intp]]:
    """A mesh with at most so many vertices: those in one cell of a cubic grid become their mean.

    Rossignac and Borrel (1993), "Multi-resolution 3D approximations for rendering complex scenes".

    Args:
        points: (n, 3) m.
        faces: (m, 3) indices of points.
        vertices: how many to keep, at most.
    """
    if not len(points) or not len(faces):
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp)
    if len(points) <= vertices:
        return points, faces
    low, extent = points.min(axis=0), float(np.ptp(points, axis=0).max())
    fine, coarse = 0, 512  # cells along the longest side: the finest grid that keeps few enough
    cluster = np.zeros(len(points), dtype=np.intp)
    while coarse - fine > 1:
        cells = (fine + coarse) // 2
        grid = np.minimum((points - low) / max(extent, 1e-12) * cells, cells - 1).astype(np.int64)
        kept, own = np.unique((grid[:, 0] * 1024 + grid[:, 1]) * 1024 + grid[:, 2], return_inverse=True)
        if len(kept) <= vertices:
            fine, cluster = cells, own.reshape(-1)
        else:
            coarse = cells
    count = np.bincount(cluster)
    mean = np.stack([np.bincount(cluster, weights=points[:, i]) / count for i in range(3)], axis=-1)
    corner = cluster[faces]
    whole = (corner[:, 0] != corner[:, 1]) & (corner[:, 1] != corner[:, 2]) & (corner[:, 2] != corner[:, 0])
    corner = np.take_along_axis(corner, _from_least(corner), axis=1)[whole]
    if not len(corner):  # thinner than a cell in two directions
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp)
    corner = np.unique(corner, axis=0)
    used, own = np.unique(corner, return_inverse=True)
    return mean[used], own.reshape(-1, 3).astype(np.intp)


def _from_least(corner: NDArray[np.intp]) -> NDArray[np.intp]:
    """The order that begins at the least corner and keeps the way round, so that the same face is found once."""
    return np.asarray((corner.argmin(axis=1)[:, None] + np.arange(3)) % 3)


def _cylinder(radius: float, half: float) -> tuple[Array, NDArray[np.intp]]:
    angle = np.arange(_SIDES) * 2 * np.pi / _SIDES
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(_SIDES)], axis=-1)
    top = np.array([0.0, 0.0, half])
    points = np.concatenate([ring - top, ring + top, [-top, top]])
    i = np.arange(_SIDES)
    j = (i + 1) % _SIDES
    low, high = 2 * _SIDES + 0 * i, 2 * _SIDES + 1 + 0 * i
    faces = [(i, j, j + _SIDES), (i, j + _SIDES, i + _SIDES), (low, j, i), (high, i + _SIDES, j + _SIDES)]
    return points, np.concatenate([np.stack(f, axis=-1) for f in faces]).astype(np.intp)


def _box(size: Array) -> tuple[Array, NDArray[np.intp]]:
    sign = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return sign * size, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.intp)


def _line_figure(model: Any, drawn: set[int]) -> Iterator[Shape]:
    """A limb from each group that has no solid to the groups that hang on it; to its centre of mass where none does."""
    moving = [b for b in range(1, model.nbody) if model.body_weldid[b] == b]
    hangs: dict[int, list[Array]] = {b: [] for b in moving if b not in drawn}
    for b in moving:
        root, at = in_group(model, int(model.body_parentid[b]), model.body_pos[b][None])
        if root in hangs:
            hangs[root].append(at[0])
    for b, ends in hangs.items():
        for end in ends or [model.body_ipos[b].copy()]:
            length = float(np.linalg.norm(end))
            if length > 1e-4:
                name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, b) or f"body{b}"
                points, none = np.stack([np.zeros(3), end]), np.zeros((0, 3), dtype=np.intp)
                yield Shape(b, "capsule", points, _STICK * length, none, np.array([0.8, 0.77, 0.7, 1.0]), name, -1)


def _matrix(quat: Array) -> Array:
    found = np.empty(9)
    mujoco.mju_quat2Mat(found, np.asarray(quat, dtype=float))
    return found.reshape(3, 3)

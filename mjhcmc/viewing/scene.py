"""What a picture shows: tendons coloured by activation, muscles on joints as beads, the desired pose as a ghost."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.viewing.camera import FIELD_OF_VIEW, moving_geoms
from mjhcmc.viewing.colours import activation_rgba
from mjhcmc.viewing.frames import Frames, settle

Array = NDArray[np.float64]

GHOST_RGBA = (0.10, 0.62, 0.36, 0.40)
"""Green: no activation has it, nor has what rests."""

MAX_GEOMS = 20_000

_BACKDROP = (0.93, 0.94, 0.96, 1.0)
_HIDDEN_GROUP = 5
_GROUPS_SHOWN = 3  # of tendons, as MuJoCo has it
_OPAQUE = 0.5  # alpha, from which a geom has a ghost: a ghost of skin would veil the bones
_COINCIDE = 1e-3  # of the size of the model: nearer than that, a ghost would only flicker in what it lies on
_WIDTH = (0.005, 0.013)  # half, m for each m of the moving part's size: of the weakest and the strongest muscle
_VEIL = 0.35  # of the alpha of translucent geoms is left: skin would tint the colours of the muscles under it
_FADE = 0.6  # of the way to gray: colour is for activation
_AMBIENT, _DIFFUSE = 0.3, 0.55  # least light of the camera's lamp; the latter where there is no other
_SHADOW = 2048  # pixels, of shadow maps: without a graphics card they take most of the time
_GLOW = 0.15  # emission of tendons
_MARKER = 0.028  # of that size: radius of the bead of a muscle on a joint
_THICKEST = 3.0  # of those: how thick a limb is at most taken to be, for beads to lie outside it


class Stage:
    """A solution's frames, one at a time, for MuJoCo's renderers.

    Activation is painted on the tendons of a copy of the model; MuJoCo's own tint, which is of control or activation
    as it is in MjData, is switched off. The ghost is the desired pose, of bodies only, where it differs visibly.

    Args:
        frames: what is shown.
        ghost: whether the desired pose is shown, too.

    Attributes:
        model: ``mujoco.MjModel``, painted.
        data: ``mujoco.MjData`` of the frame shown.
        option: ``mujoco.MjvOption`` for it.
    """

    def __init__(self, frames: Frames, *, ghost: bool = True) -> None:
        self.frames = frames
        self.model = _painted(frames)
        self.data = mujoco.MjData(self.model)
        self.option = mujoco.MjvOption()
        quiet(self.option)
        self._size = motion_size(frames)
        self._markers = _Markers(frames, _MARKER * self._size)
        self._gaps = _Gaps(frames)
        self._ghost = _Ghost(self.model, _COINCIDE * self._size) if ghost else None
        self.show(0)

    def show(self, k: int) -> None:
        """Pose and paint frame k."""
        self.k = k
        self.data.qpos[:] = self.frames.qpos[k]
        self.model.tendon_rgba[:] = self.frames.tendon_rgba(k)
        settle(self.model, self.data)

    def shows_ghost(self, frames: Iterable[int]) -> bool:
        """Whether the ghost is seen in any of these frames; the last of them is the one shown afterwards."""
        if self._ghost is None:
            return False
        for k in frames:
            self.show(k)
            if self._ghost.apart(self.frames.desired[k], self.data).any():
                return True
        return False

    def add_to(self, scene: Any) -> None:
        """Add to a ``mujoco.MjvScene`` what MuJoCo does not draw: ghost, markers, and gaps in paths closed."""
        if self._ghost is not None:
            self._ghost.add_to(scene, self.frames.desired[self.k], self.data)
        self._markers.add_to(scene, self.data, self.frames.activation[self.k])
        self._gaps.add_to(scene, self.data)

    def compose(self, scene: Any, camera: Any) -> None:
        """Fill a ``mujoco.MjvScene`` with all that the frame shown has, as seen by a ``mujoco.MjvCamera``."""
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self.model, self.data, self.option, None, camera, everything, scene)
        self.add_to(scene)
        for geom in scene.geoms[: scene.ngeom]:
            if geom.objtype == mujoco.mjtObj.mjOBJ_TENDON:
                geom.emission, geom.specular = _GLOW, 0.1  # the colour counts, more than the light on it
        if not (self.model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX).any():
            _add_backdrop(scene, self.model)


def quiet(option: Any) -> None:
    """Switch off what is not part of the picture: MuJoCo's own tints of tendons, sites, joints, contacts."""
    flag = mujoco.mjtVisFlag
    for which in (
        flag.mjVIS_ACTUATOR, flag.mjVIS_ACTIVATION, flag.mjVIS_ISLAND, flag.mjVIS_JOINT, flag.mjVIS_CONTACTPOINT,
        flag.mjVIS_CONTACTFORCE, flag.mjVIS_CONSTRAINT,
    ):  # fmt: skip
        option.flags[which] = 0
    option.flags[flag.mjVIS_TENDON] = 1
    option.sitegroup[:] = 0


def motion_size(frames: Frames) -> float:
    """M, how large what moves is: by the boxes of its geoms in the first frame."""
    geoms = moving_geoms(frames.model)
    if not len(geoms):
        return float(frames.model.stat.extent)
    data = frames.place(frames.qpos[0])
    reach = frames.model.geom_rbound[geoms, None]
    places = data.geom_xpos[geoms]
    return float(np.linalg.norm((places + reach).max(axis=0) - (places - reach).min(axis=0)) / np.sqrt(3.0))


def _painted(frames: Frames) -> Any:
    """A copy of the model whose tendons take colours; muscles are as thick as their strength has it."""
    m = copy.deepcopy(frames.model)
    m.vis.global_.fovy = FIELD_OF_VIEW
    m.vis.quality.shadowsize = min(m.vis.quality.shadowsize, _SHADOW)
    head = m.vis.headlight
    head.ambient[:] = np.maximum(head.ambient, _AMBIENT)
    if not m.nlight:
        head.diffuse[:] = np.maximum(head.diffuse, _DIFFUSE)
    pulls = frames.tendon_of_muscle >= 0
    tendons = frames.tendon_of_muscle[pulls]
    veils = (m.geom_rgba[:, 3] < _OPAQUE) & (m.geom_matid < 0)
    m.geom_rgba[veils, 3] *= _VEIL
    plain = m.geom_matid < 0
    gray = m.geom_rgba[plain, :3] @ np.array([0.299, 0.587, 0.114])
    fade = np.where(veils[plain], 1.0, _FADE)[:, None]  # flesh is no ghost, nor a muscle
    m.geom_rgba[plain, :3] += fade * (gray[:, None] - m.geom_rgba[plain, :3])
    m.tendon_matid[np.unique(tendons)] = -1
    m.tendon_group[np.unique(tendons)] = 0  # shown
    # radius as the root of strength: then the cross section is in proportion, as in a muscle
    strength = np.abs(m.actuator_gainprm[frames.muscle_ids[pulls], 2])
    is_muscle = m.actuator_gaintype[frames.muscle_ids[pulls]] == mujoco.mjtGain.mjGAIN_MUSCLE
    strength = np.where(is_muscle & (strength > 0), strength, np.nan)
    if len(strength):
        root = np.sqrt(strength)
        top = np.nanmax(root) if np.isfinite(root).any() else 1.0
        part = np.nan_to_num(root / top, nan=0.5)
        thick, size = _WIDTH, motion_size(frames)
        m.tendon_width[tendons] = size * np.maximum(thick[0], thick[1] * part)
    return m


class _Ghost:
    """The desired pose as translucent bodies."""

    def __init__(self, painted: Any, near: float) -> None:
        self._m = m = copy.deepcopy(painted)
        self._near = near
        self._data = mujoco.MjData(m)
        solid = m.geom_rgba[:, 3].copy()
        with_material = m.geom_matid >= 0
        solid[with_material] = np.minimum(solid, m.mat_rgba[m.geom_matid, 3] if m.nmat else solid)[with_material]
        shown = moving_geoms(m)
        bones = shown[solid[shown] >= _OPAQUE]
        self._geoms = bones if len(bones) else shown
        m.geom_matid[:] = -1
        m.geom_rgba[:] = GHOST_RGBA
        m.geom_group[:] = _HIDDEN_GROUP
        self._option = mujoco.MjvOption()
        self._option.flags[:] = 0
        self._option.geomgroup[:] = 0
        self._option.geomgroup[0] = 1
        self._option.sitegroup[:] = 0
        self._option.tendongroup[:] = 0
        self._option.skingroup[:] = 0

    def apart(self, qpos: Array, actual: Any) -> NDArray[np.bool_]:
        """Which geoms are visibly not where these positions want them."""
        m, data, geoms = self._m, self._data, self._geoms
        data.qpos[:] = qpos
        mujoco.mj_kinematics(m, data)
        off = np.linalg.norm(data.geom_xpos[geoms] - actual.geom_xpos[geoms], axis=1)
        turn = np.linalg.norm(data.geom_xmat[geoms] - actual.geom_xmat[geoms], axis=1)
        return np.asarray(off + turn * m.geom_rbound[geoms] > self._near)

    def add_to(self, scene: Any, qpos: Array, actual: Any) -> None:
        """Add what is not where it should be."""
        m, data, geoms = self._m, self._data, self._geoms
        apart = self.apart(qpos, actual)
        m.geom_group[geoms] = np.where(apart, 0, _HIDDEN_GROUP)
        if apart.any():
            bodies = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
            mujoco.mjv_addGeoms(m, data, self._option, mujoco.MjvPerturb(), bodies, scene)


class _Markers:
    """Muscles that pull on no tendon: a bead each, coloured by activation, in a ring around the axis they turn."""

    def __init__(self, frames: Frames, radius: float) -> None:
        m = frames.model
        self._radius = radius
        self._muscles = np.flatnonzero(frames.tendon_of_muscle < 0)
        ids = frames.muscle_ids[self._muscles]
        self._kind, self._what = m.actuator_trntype[ids], m.actuator_trnid[ids, 0]
        keys = list(zip(self._kind.tolist(), self._what.tolist(), strict=True))
        self._turn = [2 * np.pi * sum(key == k for k in keys[:i]) / keys.count(key) for i, key in enumerate(keys)]
        self._ring = [radius + _thickness(m, kind, what, _THICKEST * radius) for kind, what in keys]

    def add_to(self, scene: Any, data: Any, activation: Array) -> None:
        """Add the beads."""
        rgba = activation_rgba(activation[self._muscles])
        for i, colour in enumerate(rgba):
            place, axis = _axis(data, int(self._kind[i]), int(self._what[i]))
            forward = np.cross(axis, _FORWARD_OF[int(abs(axis[2]) > _UPRIGHT)])
            forward /= np.linalg.norm(forward)
            way = np.cos(self._turn[i]) * forward + np.sin(self._turn[i]) * np.cross(axis, forward)
            size = np.array([self._radius, 0.0, 0.0])
            at = place + self._ring[i] * way
            bead = _add(scene, mujoco.mjtGeom.mjGEOM_SPHERE, size, at, np.eye(3).ravel(), colour)
            if bead is not None:
                bead.emission, bead.specular = _GLOW, 0.1


class _Gaps:
    """Pieces of tendons that MuJoCo leaves out, at pulleys that divide nothing."""

    def __init__(self, frames: Frames) -> None:
        self._gaps = frames.gaps

    def add_to(self, scene: Any, data: Any) -> None:
        """Add them, as thick as their tendons and in their colours."""
        m = data.model
        for gap in self._gaps:
            if m.tendon_group[gap.tendon] >= _GROUPS_SHOWN:
                continue
            here, there = (data.site_xpos[site] for site in gap.ends)
            piece = _add(
                scene, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), np.eye(3).ravel(),
                m.tendon_rgba[gap.tendon],
            )  # fmt: skip
            if piece is not None:
                mujoco.mjv_connector(piece, mujoco.mjtGeom.mjGEOM_CAPSULE, m.tendon_width[gap.tendon], here, there)
                piece.objtype, piece.objid = mujoco.mjtObj.mjOBJ_TENDON.value, gap.tendon


_FORWARD_OF = (np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]))  # across which, for level and for upright axes
_UPRIGHT = 0.9


def _thickness(m: Any, kind: int, what: int, most: float) -> float:
    """Half the thickness of a limb at a joint, m: of the round geoms of the body that it moves."""
    if kind not in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        return 0.0
    shape = mujoco.mjtGeom
    is_round = np.isin(m.geom_type, [int(shape.mjGEOM_CAPSULE), int(shape.mjGEOM_CYLINDER), int(shape.mjGEOM_SPHERE)])
    own = is_round & (m.geom_bodyid == m.jnt_bodyid[what])
    return min(float(m.geom_size[own, 0].max(initial=0.0)), most)


def _axis(data: Any, kind: int, what: int) -> tuple[Array, Array]:
    """Where a muscle that pulls on no tendon is shown, and the unit axis of what it pulls on."""
    m, transmission = data.model, mujoco.mjtTrn
    if kind in (transmission.mjTRN_JOINT, transmission.mjTRN_JOINTINPARENT):
        return data.xanchor[what].copy(), data.xaxis[what].copy()
    if kind in (transmission.mjTRN_SITE, transmission.mjTRN_SLIDERCRANK):
        return data.site_xpos[what].copy(), data.site_xmat[what].reshape(3, 3)[:, 2].copy()
    body = what if kind == transmission.mjTRN_BODY and what < m.nbody else 0
    return data.xpos[body].copy(), np.array([0.0, 0.0, 1.0])


def _add(scene: Any, kind: int, size: Array, place: Array, turn: Array, rgba: Array) -> Any:
    """Add one geom to a scene, where there is room; gives it."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, size, place, turn, np.asarray(rgba, dtype=np.float32))
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR.value
    scene.ngeom += 1
    return geom


def _add_backdrop(scene: Any, m: Any) -> None:
    """Add a light wall behind everything, for models without a sky: theirs is black."""
    eye = scene.camera[0]
    ahead, up = np.array(eye.forward, dtype=float), np.array(eye.up, dtype=float)
    far = 0.9 * m.vis.map.zfar * m.stat.extent
    turn = np.stack([np.cross(ahead, up), up, -ahead], axis=1).ravel()
    wall = _add(
        scene, mujoco.mjtGeom.mjGEOM_PLANE, np.array([far, far, 0.01]), np.array(eye.pos) + far * ahead, turn,
        np.array(_BACKDROP),
    )  # fmt: skip
    if wall is not None:
        wall.emission, wall.specular, wall.reflectance = 1.0, 0.0, 0.0

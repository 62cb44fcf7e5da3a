"""Do the loads fit the movement: a foot in the air that carries load, a force that pulls it down or aside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.external_loads import GROUND, ExternalLoads, wrenches
from mjhcmc.io.load_bodies import body_weight, up_axis

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel
    from mjhcmc.motion import Motion

Array = NDArray[np.float64]

FAR = 0.3
"""m: a point further than this from its body is out of place."""

_SLIGHT = 0.02  # of the modelled weight: plates measure more, and
_SLIGHT_AT_MOST = 4.0  # N: in kN nobody's ground reaction is more; a made-up push may be
_LOADED = 0.05  # of the body weight, and of the load's own peak: below, a point is noise
_STEPS = 200  # looked at along the motion
_AXES = "check the frame and axes of the loads"
_CLOCK = "check the frame and units, or that the motion and the loads share a clock"


def suspicious(loads: ExternalLoads, model: MuscleModel, motion: Motion) -> list[str]:
    """What speaks for a wrong frame, unit or clock, a line each.

    Where a load has force and point in the ground, as of a force plate, and no force of the file ever exceeds 2 % of
    the modelled bodies' weight, nor 4 N, it may be in kN.

    Looked at where the motion and the loads overlap and a load is above 5 % of the model's weight and of its own peak:

    - its point is more than .3 m from the body that it acts on, in the pose of the motion: from the body's origin, its
      centre of mass, and the spheres about its geoms. A foot that is higher than its point by more than that is said
      to be in the air.
    - its point is in the ground, and for over half of that time the force, turned into the world where it is given in a
      body's frame, pulls the body down, or more aside than up. Not looked at where the model has no gravity.

    Args:
        loads: the loads.
        model: the model.
        motion: the motion that the loads belong to, in the order of the model's joints.

    Returns:
        The messages; empty where nothing is suspicious.

    Raises:
        ModelError: the model has not the loads' bodies.
    """
    start, end = max(motion.start, float(loads.time[0])), min(motion.end, float(loads.time[-1]))
    body_ids, force_ids, point_ids = loads.ids(model)
    if not start < end:
        return []
    m = model.mj_model
    time = np.linspace(start, end, _STEPS + 1)
    poses = _Poses(m, motion.sample(time).qpos)
    at = loads.sample(time)
    made = wrenches(at, body_ids, force_ids, point_ids, poses.xpos, poses.xmat, poses.xipos)
    force = made[..., :3]
    size = np.linalg.norm(force, axis=2)
    loaded = size > np.maximum(_LOADED * body_weight(model), _LOADED * size.max(axis=0))
    up = up_axis(model)
    found = _slight(loads, body_weight(model))
    for i, body in enumerate(loads.body):
        if not loaded[:, i].any():
            continue
        name = f"{loads.name}: load {loads.labels[i]!r} on body {body!r}"
        point = poses.in_world(at.point[:, i], int(point_ids[i]))
        gap, above = poses.distance(point, int(body_ids[i]), up)
        gap = np.where(loaded[:, i], gap, 0.0)
        worst = int((gap > gap.max() - 1e-6).argmax())  # the first, where it stays
        if gap[worst] > FAR:
            aloft = f", the body {above[worst]:.2f} m above it, in the air" if above[worst] > FAR else ""
            found.append(
                f"{name}: at {time[worst]:.6g} s {size[worst, i]:.4g} N act at a point {gap[worst]:.2f} m from the "
                f"body{aloft}: {_CLOCK}"
            )
        if up is not None and loads.point_frame[i] == GROUND:
            found += _direction(name, time, force[:, i] @ up, size[:, i], loaded[:, i])
    return found


def _slight(loads: ExternalLoads, weight: float) -> list[str]:
    """Whether plates measured next to nothing, at any time: a cut to where the foot swings is no reason to doubt."""
    peak = float(np.linalg.norm(loads.force, axis=2).max())
    plates = (GROUND, GROUND) in zip(loads.force_frame, loads.point_frame, strict=True)
    if not plates or not 0 < peak < min(_SLIGHT * weight, _SLIGHT_AT_MOST):
        return []
    return [
        f"{loads.name}: the largest force is {peak:.3g} N, {100 * peak / weight:.2g} % of the modelled bodies' weight "
        f"of {weight:.4g} N: if the file's forces are in kN, multiply them by 1000"
    ]


def _direction(name: str, time: Array, lift: Array, size: Array, loaded: NDArray[np.bool_]) -> list[str]:
    """What is odd about where a force from the ground points."""
    aside = np.sqrt(np.maximum(size**2 - lift**2, 0))
    for odd, what, value in (
        (aside > np.abs(lift), "pushes the body more aside than up", aside),
        (lift < 0, "pulls the body down", -lift),
    ):
        share = float((odd & loaded).sum() / loaded.sum())
        if share > 0.5:
            worst = int(np.where(odd & loaded, value, -np.inf).argmax())
            return [
                f"{name}: the force {what} for {100 * share:.0f} % of its time, with {value[worst]:.4g} N at "
                f"{time[worst]:.6g} s: {_AXES}"
            ]
    return []


class _Poses:
    """Where the bodies and geoms are, at n times."""

    def __init__(self, m: mujoco.MjModel, qpos: Array) -> None:
        self.m = m
        n = len(qpos)
        self.xpos, self.xipos = np.empty((n, m.nbody, 3)), np.empty((n, m.nbody, 3))
        self.xmat, self.geoms = np.empty((n, m.nbody, 9)), np.empty((n, m.ngeom, 3))
        d = mujoco.MjData(m)
        for i, q in enumerate(qpos):
            d.qpos[:] = q
            mujoco.mj_kinematics(m, d)
            self.xpos[i], self.xmat[i], self.xipos[i], self.geoms[i] = d.xpos, d.xmat, d.xipos, d.geom_xpos

    def in_world(self, point: Array, frame: int) -> Array:
        """(n, 3) points given in a body's frame."""
        R = self.xmat[:, frame].reshape(-1, 3, 3)
        return np.asarray(self.xpos[:, frame] + np.einsum("nij,nj->ni", R, point))

    def distance(self, point: Array, body: int, up: Array | None) -> tuple[Array, Array]:
        """(n,) m from points to a body, and (n,) m that the body is above them (0 where nothing says what is up)."""
        geoms = np.flatnonzero(self.m.geom_bodyid == body)
        places = np.concatenate([self.xpos[:, [body]], self.xipos[:, [body]], self.geoms[:, geoms]], axis=1)
        reach = np.concatenate([np.zeros(2), self.m.geom_rbound[geoms]])
        away = places - point[:, None]
        gap = np.maximum(np.linalg.norm(away, axis=2) - reach, 0).min(axis=1)
        above = np.zeros(len(point)) if up is None else (away @ up - reach).min(axis=1)
        return gap, above

"""Joint angles and segment angles of planar chains.

A segment angle is the rotation of a body from its pose at zero joint angles, a joint angle that of a body against
the one before it. In a chain of hinges whose axes are parallel, rotations add up:

    phi_j = sum over i = j and its ancestors of s_i q_i,    s_i = sign(a_i . a_1)

with the hinges' axes a_i in the world frame; phi counts positive about the axis a_1 of the model's first joint. For
leg8, whose segments hang along the vertical at zero: thigh = hip, shank = hip + knee, foot = hip + knee + ankle.
Figure 1 of "Integrator for Musculoskeletal Simulation in Python" (2024, doi:10.17979/ja-cea.2024.45.10802) measures
such rotations from the vertical, where its text speaks of joint angles.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import ModelError, MotionError

Array = NDArray[np.float64]

_PARALLEL = 1e-6  # |a_i x a_1|


def segment_angles(model: Any, qpos: ArrayLike) -> Array:
    """Segment angles from joint angles.

    Args:
        model: a MuscleModel whose joints are hinges with parallel axes; it may branch.
        qpos: (T, nq) or (nq,) joint angles, rad.

    Returns:
        (T, nq) or (nq,) rotation of each joint's body from its pose at zero joint angles, rad, positive about the
        first joint's axis. (Where a body has several joints, each has the rotation that it and those before it make.)

    Raises:
        ModelError: a joint is a slide, or its axis is not parallel to the first joint's.
        MotionError: the shape of qpos.
    """
    sign, above = _chain(model)
    return _columns(model, qpos, "qpos") @ (above * sign).T


def joint_angles(model: Any, segment: ArrayLike) -> Array:
    """Joint angles from segment angles; the inverse of `segment_angles`.

    Args:
        model: a MuscleModel whose joints are hinges with parallel axes; it may branch.
        segment: (T, nq) or (nq,) segment angles, rad, positive about the first joint's axis.

    Returns:
        (T, nq) or (nq,) joint angles, rad.

    Raises:
        ModelError: a joint is a slide, or its axis is not parallel to the first joint's.
        MotionError: the shape of segment.
    """
    sign, above = _chain(model)
    angles = _columns(model, segment, "segment")
    turn = angles.copy()
    for joint in range(len(sign)):
        ancestors = np.flatnonzero(above[joint, :joint])
        if len(ancestors):
            turn[..., joint] -= angles[..., ancestors[-1]]  # the nearest one: joints stand in the tree's order
    return turn * sign


def _columns(model: Any, values: ArrayLike, what: str) -> Array:
    array = np.asarray(values, dtype=np.float64)
    n = len(model.joint_names)
    if array.ndim not in (1, 2) or array.shape[-1] != n:
        raise MotionError(f"{what} has shape {array.shape}: give (T, {n}) or ({n},), a column a joint of {model.name}")
    return array


def _chain(model: Any) -> tuple[Array, Array]:
    """(nq,) sign of each hinge against the first, and (nq, nq) 1 where the column's joint carries the row's body."""
    import mujoco

    m = getattr(model, "mj_model", None)
    if m is None:
        raise ModelError(f"model {model.name}: segment angles need the chain of its joints: give a MuscleModel")
    slides = [name for name, rotates in zip(model.joint_names, model.joint_is_rotation, strict=True) if not rotates]
    if slides:
        raise ModelError(
            f"model {model.name}: joint {slides[0]} is a slide, segment angles are for chains of hinges: "
            "give joint angles"
        )
    data = mujoco.MjData(m)
    data.qpos[:] = m.qpos0
    mujoco.mj_kinematics(m, data)
    axes = data.xaxis
    apart = np.linalg.norm(np.cross(axes, axes[0]), axis=1)
    if apart.max() > _PARALLEL:
        worst = int(np.argmax(apart > _PARALLEL))
        degrees = np.rad2deg(np.arctan2(apart[worst], abs(axes[worst] @ axes[0])))
        raise ModelError(
            f"model {model.name}: the axis of joint {model.joint_names[worst]} stands at {degrees:.3g} deg to that of "
            f"{model.joint_names[0]}, segment angles are for hinges with parallel axes: give joint angles"
        )
    above = np.zeros((m.nq, m.nq))
    for joint in range(m.njnt):
        body = int(m.jnt_bodyid[joint])
        above[joint, m.body_jntadr[body] : joint + 1] = 1
        while (body := int(m.body_parentid[body])) > 0:
            first, count = int(m.body_jntadr[body]), int(m.body_jntnum[body])
            if count:
                above[joint, first : first + count] = 1
    return np.sign(axes @ axes[0]), above

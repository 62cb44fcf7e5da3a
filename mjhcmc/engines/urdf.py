"""A tree of hinges as URDF, from the numbers of a compiled MjModel.

A URDF link's frame lies on its joint, a MuJoCo body's frame lies anywhere: links get their body's orientation and have
their origin on the hinge (on the body's own origin where it is welded). Inertia is written about the center of mass in
the link's orientation, with its off-diagonal terms; numbers have all their digits, so that what reads it computes
the same to rounding. MuJoCo's world is the link ``world``: what hangs on it without a joint is a fixed base.

URDF: http://wiki.ros.org/urdf/XML
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from mjhcmc.engines.legs import apart, body_names, check_hinges, joint_names, title_of
from mjhcmc.io.files import written_whole

Array = NDArray[np.float64]

EFFORT = 1e6
"""N m, the limit of each joint: URDF demands one, some engines clamp at it, and none shall be clamped."""

SPEED = 1e4
"""rad/s, likewise."""


def urdf_of(model: Any) -> str:
    """The model's bodies and hinges as URDF text.

    Muscles, geoms, joint damping and armature have no place in it, nor has gravity: set it in the engine.

    Args:
        model: MjModel whose joints are hinges, one a body at most.

    Raises:
        ModelError: no joint, a joint that is no hinge, a body with several, or a hinge whose zero is not its reference
            pose.
    """
    check_hinges(model)
    names, joints = body_names(model), joint_names(model)
    parts = [f"  <link name={quoteattr(names[0])}/>"]
    taken = set(joints)
    welds = [apart(f"{name}_weld", taken) for name in names]
    for b in range(1, model.nbody):
        parent = int(model.body_parentid[b])
        parts += [_link(model, b, names[b]), _joint(model, b, joints, welds[b], names[parent], names[b])]
    return "\n".join(['<?xml version="1.0"?>', f"<robot name={quoteattr(title_of(model))}>", *parts, "</robot>", ""])


def write_urdf(model: Any, path: Path) -> Path:
    """Write `urdf_of` a model to a file, whole or not at all.

    Raises:
        ModelError: as `urdf_of`.
        OutputError: the file cannot be written.
    """
    text = urdf_of(model)
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def hinge_place(model: Any, body: int) -> Array:
    """(3,) m, where a body's hinge is in its own frame; its origin where it has none."""
    return np.asarray(model.jnt_pos[model.body_jntadr[body]]) if model.body_jntnum[body] else np.zeros(3)


def link_origin(model: Any, body: int) -> Array:
    """(3,) m, a link's origin in the parent's link at zero angle."""
    here = model.body_pos[body] + matrix_of(model.body_quat[body]) @ hinge_place(model, body)
    return np.asarray(here - hinge_place(model, int(model.body_parentid[body])))


def link_inertia(model: Any, body: int) -> tuple[Array, Array]:
    """Center of mass (3,) m in the link, and inertia (3, 3) kg m^2 about it, along the link's axes."""
    turn = matrix_of(model.body_iquat[body])
    inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
    return np.asarray(model.body_ipos[body] - hinge_place(model, body)), (inertia + inertia.T) / 2


def matrix_of(quaternion: Array) -> Array:
    """(3, 3) rotation of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


def roll_pitch_yaw(turn: Array) -> Array:
    """(3,) rad: about x, then y, then z of the fixed frame, which give the rotation (3, 3)."""
    pitch = np.arctan2(-turn[2, 0], np.hypot(turn[0, 0], turn[1, 0]))
    if np.hypot(turn[0, 0], turn[1, 0]) < 1e-9:  # upright: roll and yaw turn about one axis, roll alone does it
        return np.array([np.arctan2(turn[0, 1] * np.sign(pitch), turn[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(turn[2, 1], turn[2, 2]), pitch, np.arctan2(turn[1, 0], turn[0, 0])])


def _link(model: Any, body: int, name: str) -> str:
    com, inertia = link_inertia(model, body)
    entries = {f"i{'xyz'[i]}{'xyz'[k]}": inertia[i, k] for i in range(3) for k in range(i, 3)}
    values = " ".join(f'{key}="{float(value)!r}"' for key, value in entries.items())
    return (
        f"  <link name={quoteattr(name)}>\n    <inertial>\n"
        f'      <origin xyz="{_text(com)}" rpy="0 0 0"/>\n'
        f'      <mass value="{float(model.body_mass[body])!r}"/>\n'
        f"      <inertia {values}/>\n    </inertial>\n  </link>"
    )


def _joint(model: Any, body: int, joints: list[str], weld: str, parent: str, child: str) -> str:
    j = int(model.body_jntadr[body])
    hinged, limited = j >= 0, j >= 0 and bool(model.jnt_limited[j])
    kind = "fixed" if not hinged else "revolute" if limited else "continuous"
    angles = roll_pitch_yaw(matrix_of(model.body_quat[body]))
    lines = [
        f'  <joint name={quoteattr(joints[j] if hinged else weld)} type="{kind}">',
        f"    <parent link={quoteattr(parent)}/>",
        f"    <child link={quoteattr(child)}/>",
        f'    <origin xyz="{_text(link_origin(model, body))}" rpy="{_text(angles)}"/>',
    ]
    if hinged:
        lines.append(f'    <axis xyz="{_text(model.jnt_axis[j])}"/>')
        low, high = (float(value) for value in model.jnt_range[j])
        ends = f'lower="{low!r}" upper="{high!r}" ' if limited else ""
        lines.append(f'    <limit {ends}effort="{EFFORT!r}" velocity="{SPEED!r}"/>')
    return "\n".join([*lines, "  </joint>"])


def _text(vector: Array) -> str:
    return " ".join(repr(float(value) + 0.0) for value in vector)

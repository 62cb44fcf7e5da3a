"""The bodies that engines are compared on: leg8's, and a leg whose axes and inertias are oblique.

A planar leg forgives much: with all axes along y only one number of each inertia counts, and no engine's reading of the
others is tested. The oblique leg has leg8's masses, lengths and order of size, and nothing parallel to anything.

Both are bodies and hinges only. Muscles, joint damping and armature are taken away: other engines have no such muscles,
and read damping and armature each in a way of its own. Gravity stays. Any other model is taken likewise.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.assets import model_path
from mjhcmc.errors import ModelError

if TYPE_CHECKING:
    import mujoco

Array = NDArray[np.float64]

LEGS = ("leg8", "oblique")

# By joint: the hinge's axis and place in its body (m), how the body is turned in its parent (rotation vector, rad), and
# how its principal axes are turned in it (rotation vector, rad); chosen by hand to be unlike each other.
_OBLIQUE: dict[str, tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...], tuple[float, ...]]] = {
    "hip": ((0.31, -0.90, 0.22), (0.011, -0.007, 0.013), (0.12, -0.20, 0.31), (0.4, -0.3, 0.5)),
    "knee": ((-0.26, -0.85, -0.34), (-0.009, 0.012, 0.006), (-0.22, 0.15, 0.18), (-0.6, 0.2, 0.3)),
    "ankle": ((0.42, -0.77, 0.37), (0.008, 0.010, -0.012), (0.17, 0.24, -0.28), (0.3, 0.7, -0.4)),
}
_SHIFT = {"hip": (0.021, 0.017, -0.012), "knee": (-0.014, 0.023, 0.010), "ankle": (0.012, -0.016, 0.008)}  # m, of com


def leg(name: str) -> Any:
    """One of `LEGS` as a compiled MjModel: bodies and hinges, RK4 at 1 ms.

    Raises:
        KeyError: no such leg.
    """
    return {"leg8": leg8_bodies, "oblique": oblique_leg}[name]()


def model_named(name: str) -> Any:
    """One of `LEGS`, or the bodies and hinges of an MJCF file.

    Raises:
        ModelError: neither, or as `bodies_of`.
    """
    import mujoco

    if name in LEGS:
        return leg(name)
    path = model_path(name) or Path(name)
    if not path.is_file():
        raise ModelError(f"no model '{name}': give {', '.join(LEGS)}, or a path to an MJCF file")
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ModelError(f"{path}: MuJoCo cannot load it: {' '.join(str(error).split())}") from error
    return bodies_of(model)


def leg8_bodies() -> Any:
    """leg8's bodies and hinges."""
    return bodies_of(_leg8())


def oblique_leg() -> Any:
    """leg8 with tilted hinges off their bodies' origins, turned frames, centers of mass off the axes, full inertias."""
    spec = bodies_spec(_leg8())
    for name, (axis, place, turned, principal) in _OBLIQUE.items():
        joint = spec.joint(name)
        joint.axis, joint.pos = np.array(axis) / np.linalg.norm(axis), place
        body = joint.parent
        body.quat, body.iquat = _quaternion(turned), _product(_quaternion(principal), body.iquat)
        body.ipos = np.asarray(body.ipos) + _SHIFT[name]
    return spec.compile()


def bodies_of(model: Any, *, limits: bool = True) -> Any:
    """The bodies and hinges of a model: without muscles, tendons, geoms, constraints, joint damping and armature.

    Args:
        model: MjModel whose joints are hinges, one a body at most.
        limits: whether joints keep their limits; their ranges stay, nothing holds them. MuJoCo ignores limits here,
            other engines stop there.

    Raises:
        ModelError: no joint, a joint that is no hinge, a body with several, a hinge whose zero is not its reference
            pose, or what MuJoCo cannot compile.
    """
    spec = bodies_spec(model)
    if not limits:
        for joint in spec.joints:
            joint.limited = False
    try:
        return spec.compile()
    except ValueError as error:
        raise ModelError(f"model '{title_of(model)}' as bodies and hinges: {' '.join(str(error).split())}") from error


def title_of(model: Any) -> str:
    """What a compiled model is called."""
    return str(model.names[: model.names.index(b"\0")].decode()) or "model"


def body_names(model: Any) -> list[str]:
    """(nbody,) of bodies, the world first; what has no name gets one that no other has."""
    return ["world", *_filled([str(model.body(b).name) for b in range(1, model.nbody)], "body", 1)]


def joint_names(model: Any) -> list[str]:
    """(njnt,) of joints; what has no name gets one that no other has."""
    return _filled([str(model.joint(j).name) for j in range(model.njnt)], "joint", 0)


def apart(name: str, taken: set[str]) -> str:
    """A name that is not taken, which it is from now on: this one, or with underlines at its end."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def check_hinges(model: Any) -> None:
    """Refuse what a tree of hinges has no place for; raises as `bodies_of`."""
    import mujoco

    if not model.njnt:
        raise ModelError(f"model '{title_of(model)}' has no joint, engines are given hinges: give a body one")
    for j in range(model.njnt):
        name = model.joint(j).name or f"joint {j}"
        if model.jnt_type[j] != mujoco.mjtJoint.mjJNT_HINGE:
            kind = mujoco.mjtJoint(model.jnt_type[j]).name.removeprefix("mjJNT_").lower()
            raise ModelError(f"joint '{name}' is a {kind} joint, engines are given hinges only: take it out")
        if model.qpos0[j] != 0.0:
            raise ModelError(f"joint '{name}' has ref {model.qpos0[j]:g} rad, which no URDF can say: set ref to 0")
    for b in np.flatnonzero(model.body_jntnum > 1):
        raise ModelError(f"body '{model.body(b).name}' has {model.body_jntnum[b]} joints: split it, one hinge a body")


def bodies_spec(model: Any) -> mujoco.MjSpec:
    """`bodies_of` before it is compiled; raises likewise. Joint limits stay, but MuJoCo's constraint forces are off."""
    import mujoco

    check_hinges(model)
    spec = mujoco.MjSpec()
    spec.modelname = title_of(model)
    spec.compiler.degree = False
    spec.compiler.balanceinertia = False
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.timestep = 0.001
    spec.option.gravity = model.opt.gravity
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)  # mj_inverse adds the forces of limits
    bodies, joints = body_names(model), joint_names(model)
    made = {0: spec.worldbody}
    for b in range(1, model.nbody):
        body = made[b] = made[int(model.body_parentid[b])].add_body(name=bodies[b])
        body.pos, body.quat = model.body_pos[b], model.body_quat[b]
        body.explicitinertial = True
        body.mass = float(model.body_mass[b])
        body.ipos, body.iquat, body.inertia = model.body_ipos[b], model.body_iquat[b], model.body_inertia[b]
        for j in range(int(model.body_jntadr[b]), int(model.body_jntadr[b]) + int(model.body_jntnum[b])):
            joint = body.add_joint(name=joints[j])
            joint.axis, joint.pos = model.jnt_axis[j], model.jnt_pos[j]
            joint.limited = bool(model.jnt_limited[j])
            joint.range = model.jnt_range[j]
    return spec


def _filled(names: list[str], stem: str, first: int) -> list[str]:
    """What has no name is called by its number, counted from `first`."""
    taken = {"world", *names}
    return [name or apart(f"{stem}_{number}", taken) for number, name in enumerate(names, first)]


def _leg8() -> Any:
    """The shipped file: what its builder makes has more digits than the file."""
    import mujoco

    return mujoco.MjModel.from_xml_path(str(model_path("leg8")))


def _quaternion(vector: tuple[float, ...]) -> Array:
    """Of a rotation vector, rad."""
    angle = float(np.linalg.norm(vector))
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) / angle * np.asarray(vector)])


def _product(first: Array, second: Array) -> Array:
    import mujoco

    out = np.empty(4)
    mujoco.mju_mulQuat(out, first, np.asarray(second, float))
    return out

"""A torque-driven tree of bodies on hinges and slides as plain numbers, read from a MuJoCo model.

What a chain has: rigid bodies, one joint each, armature, linear damping of joints, gravity. What it has not: muscles
and other actuators, the tendons that drive them, limits of joints, contacts. `torque_driven_model` is the MuJoCo model
that is left without these. What else acts in a model is refused.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import ModelError

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel

__all__ = ["Chain", "Matrix", "Quaternion", "Vector", "chain_of", "torque_driven_model"]

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Matrix = tuple[Vector, Vector, Vector]


@dataclass(frozen=True)
class Chain:
    """Bodies that joints join, one joint a body, parents first; n bodies, n degrees of freedom.

    Joint i turns or slides body i about or along an axis fixed in it. Frames are those of MuJoCo: at
    q = reference body i is where body_position and body_quaternion put it in its parent.

    Attributes:
        name: the model's.
        body_names: (n,).
        joint_names: (n,).
        is_slide: (n,) True for slides (m, N), False for hinges (rad, N m).
        parent: (n,) index of the body that this one hangs from; -1 is the world.
        body_position: (n, 3) m, of the body's frame in the parent's.
        body_quaternion: (n, 4) w x y z, from the body's axes to the parent's. To be normalised.
        joint_position: (n, 3) m, in the body.
        joint_axis: (n, 3) in the body. To be normalised.
        mass: (n,) kg.
        com: (n, 3) m, centre of mass in the body.
        inertia: (n, 3, 3) kg m^2 about the centre of mass, in the body's axes, symmetric.
        armature: (n,) kg m^2 or kg, added to the diagonal of the mass matrix.
        damping: (n,) N m s/rad or N s/m, of the joints.
        reference: (n,) rad or m, coordinates at which the joints are not turned.
        gravity: (3,) m/s^2.
    """

    name: str
    body_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    is_slide: tuple[bool, ...]
    parent: tuple[int, ...]
    body_position: tuple[Vector, ...]
    body_quaternion: tuple[Quaternion, ...]
    joint_position: tuple[Vector, ...]
    joint_axis: tuple[Vector, ...]
    mass: tuple[float, ...]
    com: tuple[Vector, ...]
    inertia: tuple[Matrix, ...]
    armature: tuple[float, ...]
    damping: tuple[float, ...]
    reference: tuple[float, ...]
    gravity: Vector

    @property
    def n(self) -> int:
        """Degrees of freedom, which is bodies."""
        return len(self.joint_names)

    @property
    def body_rotation(self) -> NDArray[np.float64]:
        """(n, 3, 3) from each body's axes to its parent's, at q = reference; body_quaternion in float64."""
        return np.array([_rotation(np.array(quat)) for quat in self.body_quaternion]).reshape(-1, 3, 3)


def chain_of(model: MuscleModel | Any) -> Chain:
    """The torque-driven chain of a model.

    Bodies without joints are welded to what they hang from; on the world they are left out.

    Args:
        model: a `MuscleModel` or a compiled ``mujoco.MjModel``; it is not changed.

    Raises:
        ModelError: no joint, or something that a chain does not hold: ball and free joints, several joints on a body,
            springs, dry friction, equality constraints, gravity compensation, a medium, plugins.
    """
    m: Any = getattr(model, "mj_model", model)
    name = str(getattr(model, "name", "")) or _model_name(m)
    _refuse(m, name)
    carrier = np.full(m.nbody, -1)
    place = np.zeros((m.nbody, 3))
    turn = np.tile([1.0, 0.0, 0.0, 0.0], (m.nbody, 1))
    held: list[list[int]] = []
    jointed: list[int] = []
    parent: list[int] = []
    frame: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    for b in range(1, m.nbody):
        p = int(m.body_parentid[b])
        at = place[p] + _rotation(turn[p]) @ m.body_pos[b]
        quat = _product(turn[p], m.body_quat[b])
        if m.body_jntnum[b]:
            carrier[b] = len(jointed)
            parent.append(int(carrier[p]))
            jointed.append(b)
            frame.append((at, quat))
            held.append([b])
            continue
        carrier[b], place[b], turn[b] = carrier[p], at, quat
        if carrier[p] >= 0:
            held[carrier[p]].append(b)
    joints = [int(m.body_jntadr[b]) for b in jointed]
    dofs = [int(m.jnt_dofadr[j]) for j in joints]
    lumps = [_lump(m, bodies, place, turn) for bodies in held]
    no_gravity, no_damper = _disabled(m)
    damping = np.zeros(m.nv) if no_damper else m.dof_damping
    return Chain(
        name=name,
        body_names=tuple(str(m.body(b).name) or f"body {b}" for b in jointed),
        joint_names=tuple(_joint_name(m, j) for j in joints),
        is_slide=tuple(_kind(m, j) == "slide" for j in joints),
        parent=tuple(parent),
        body_position=tuple(_vector(at) for at, _ in frame),
        body_quaternion=tuple((float(w), float(x), float(y), float(z)) for _, (w, x, y, z) in frame),
        joint_position=tuple(_vector(m.jnt_pos[j]) for j in joints),
        joint_axis=tuple(_vector(m.jnt_axis[j]) for j in joints),
        mass=tuple(mass for mass, _, _ in lumps),
        com=tuple(_vector(com) for _, com, _ in lumps),
        inertia=tuple((_vector(i[0]), _vector(i[1]), _vector(i[2])) for _, _, i in lumps),
        armature=tuple(float(m.dof_armature[d]) for d in dofs),
        damping=tuple(float(damping[d]) for d in dofs),
        reference=tuple(float(m.qpos0[m.jnt_qposadr[j]]) for j in joints),
        gravity=(0.0, 0.0, 0.0) if no_gravity else _vector(m.opt.gravity),
    )


def torque_driven_model(model: MuscleModel | Any) -> Any:
    """A copy of the compiled model that moves as its chain: actuators, their tendons, limits and contacts are off.

    Drive it by ``MjData.qfrc_applied``. Its integrator is the model's own.

    Args:
        model: a `MuscleModel` or a compiled ``mujoco.MjModel``.

    Raises:
        ModelError: as `chain_of`.
    """
    import mujoco

    m: Any = copy.deepcopy(getattr(model, "mj_model", model))
    _refuse(m, str(getattr(model, "name", "")) or _model_name(m))
    m.tendon_damping[:] = 0.0
    m.tendon_stiffness[:] = 0.0
    off = mujoco.mjtDisableBit
    m.opt.disableflags |= int(off.mjDSBL_ACTUATION) | int(off.mjDSBL_CONSTRAINT)
    return m


def _refuse(m: Any, name: str) -> None:
    """Raises ModelError where something acts that a chain does not hold."""
    import mujoco

    def no(what: str, remedy: str) -> ModelError:
        return ModelError(f"model {name!r}: {what} is not in the closed equations: {remedy}")

    if not m.njnt:
        raise ModelError(f"model {name!r} has no joint, so no equations of motion: give a body a hinge or a slide")
    for j in range(m.njnt):
        kind, joint = _kind(m, j), _joint_name(m, j)
        if kind not in ("hinge", "slide"):
            raise no(f"the {kind} joint {joint!r}", "use hinges and slides, each on a body of its own")
        if _any(m, "jnt_stiffness", j) or _any(m, "jnt_stiffnesspoly", j):
            raise no(f"the spring of joint {joint!r}", "set its stiffness to 0 and add the spring to the torque")
        dof = int(m.jnt_dofadr[j])
        if m.dof_frictionloss[dof] > 0:
            raise no(f"the frictionloss {m.dof_frictionloss[dof]:g} of joint {joint!r}", "set it to 0")
        if _any(m, "dof_dampingpoly", dof):
            raise no(f"the nonlinear damping of joint {joint!r}", "keep its linear damping only")
    for b in range(m.nbody):
        body = str(m.body(b).name) or f"body {b}"
        if m.body_jntnum[b] > 1:
            count = int(m.body_jntnum[b])
            raise no(f"body {body!r} with {count} joints", "put a light body between them")
        if m.body_gravcomp[b]:
            raise no(f"gravity compensation of body {body!r}", "set its gravcomp to 0")
    muscles = set(m.actuator_trnid[m.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON, 0].tolist())
    for t in range(m.ntendon):
        tendon = str(m.tendon(t).name) or f"tendon {t}"
        for field in ("stiffness", "damping", "stiffnesspoly", "dampingpoly", "armature", "frictionloss"):
            hosted = t in muscles and field in ("stiffness", "damping")  # part of the muscle, which is left out
            if not hosted and _any(m, f"tendon_{field}", t):
                raise no(f"the {field} of tendon {tendon!r}", "set it to 0")
    for a in range(m.nu):
        if _any(m, "actuator_armature", a):
            raise no(f"the armature of actuator {m.actuator(a).name!r}", "give it to the joint instead")
    if m.neq and np.any(m.eq_active0):
        first = int(np.flatnonzero(m.eq_active0)[0])
        raise no(f"the equality constraint {m.equality(first).name or first!r}", "take it out, or solve it by MuJoCo")
    if m.opt.density > 0 or m.opt.viscosity > 0:
        raise no(f"the medium (density {m.opt.density:g}, viscosity {m.opt.viscosity:g})", "set both to 0")
    for count, what in ((m.nflex, "a deformable body (flex)"), (m.nplugin, "a plugin")):
        if count:
            raise no(what, "take it out")


def _any(m: Any, field: str, i: int) -> bool:
    """Whether field[i] is anything but zero; fields that this MuJoCo does not have are."""
    values = getattr(m, field, None)
    return values is not None and bool(np.any(values[i]))


def _disabled(m: Any) -> tuple[bool, bool]:
    """Whether the model has gravity, and the damping of joints, switched off."""
    import mujoco

    off = mujoco.mjtDisableBit
    damper = getattr(off, "mjDSBL_DAMPER", None)
    flags = int(m.opt.disableflags)
    return bool(flags & int(off.mjDSBL_GRAVITY)), damper is not None and bool(flags & int(damper))


def _lump(
    m: Any, bodies: list[int], place: NDArray[np.float64], turn: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Mass, centre of mass and inertia about it of bodies welded together, in the first one's frame."""
    masses = np.array([float(m.body_mass[b]) for b in bodies])
    coms, inertias = [], []
    for b in bodies:
        weld = _rotation(turn[b])
        own = _rotation(_product(turn[b], m.body_iquat[b]))
        coms.append(place[b] + weld @ m.body_ipos[b])
        inertias.append(own @ np.diag(m.body_inertia[b]) @ own.T)
    total = float(masses.sum())
    if len(bodies) == 1:
        com, inertia = coms[0], inertias[0]
    else:
        com = masses @ np.array(coms) / total if total > 0 else coms[0]
        inertia = np.zeros((3, 3))
        for mass, at, part in zip(masses, coms, inertias, strict=True):
            arm = at - com
            inertia += part + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return total, com, 0.5 * (inertia + inertia.T)


def _rotation(quat: NDArray[np.float64]) -> NDArray[np.float64]:
    w, x, y, z = quat / np.linalg.norm(quat)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _product(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternion of the turn b followed by a."""
    aw, av, bw, bv = a[0], a[1:], b[0], b[1:]
    return np.array([aw * bw - av @ bv, *(aw * bv + bw * av + np.cross(av, bv))])


def _vector(values: Any) -> Vector:
    x, y, z = (float(v) for v in values)
    return x, y, z


def _kind(m: Any, j: int) -> str:
    import mujoco

    return str(mujoco.mjtJoint(int(m.jnt_type[j])).name.removeprefix("mjJNT_").lower())


def _joint_name(m: Any, j: int) -> str:
    return str(m.joint(j).name) or f"joint {j}"


def _model_name(m: Any) -> str:
    return str(m.names[: m.names.index(b"\0")].decode()) or "model"

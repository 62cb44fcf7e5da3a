"""Joint reactions: what the parent body exerts on the child body at a joint, beside the pull of muscles."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.plant import MujocoPlant

_JOINT_OR_TENDON = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT, mujoco.mjtTrn.mjTRN_TENDON)


def joint_reactions(plant: MujocoPlant) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Reaction force (njnt, 3) N and moment (njnt, 3) N m at the plant's last `forward`.

    The load that the parent exerts on the child to keep the joint together, in the world's axes, its moment about the
    joint's anchor: bone-on-bone, and whatever else the model does not draw as a path. Beyond the cut (Winter 2009, ISBN
    978-0-470-39818-0, chapter 5; Steele, DeMers, Schwartz, Delp 2012, Gait & Posture 35, 556-560):

        reaction = d(momentum of the bodies)/dt - gravity - contacts - pull of the paths that cross the cut

    All spatial tendons pull along their paths and are no part of it: muscles, springs, dampers, limits, friction.
    What acts on the joint's own coordinate is: the component along the joint's axis is reserve + joint spring, damping,
    friction and limit + joint actuators + fixed tendons - armature qacc, zero where there is none of these. OpenSim's
    JointReaction counts in the same way. Joints of one body lie between the same two bodies: their force is the same,
    their moment is taken about each anchor.

    Requires `reactions_unknown` to be empty.
    """
    m, d = plant.mj_model, plant.mj_data
    # MuJoCo takes the pull of spatial tendons off its interaction forces, but not the lift that offsets gravity
    mujoco.mj_rnePostConstraint(m, d)
    whole = d.cfrc_int[m.jnt_bodyid]
    force = whole[:, 3:].copy()
    about = d.subtree_com[m.body_rootid[m.jnt_bodyid]]
    moment = whole[:, :3] + np.cross(about - d.xanchor, force)
    if m.body_gravcomp.any() and not m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY):
        lift = -(m.body_mass * m.body_gravcomp)[:, None] * m.opt.gravity
        for j, below in enumerate(_bodies_below(m)):
            force[j] -= lift[below].sum(axis=0)
            moment[j] -= np.cross(d.xipos[below] - d.xanchor[j], lift[below]).sum(axis=0)
    return force, moment


def reactions_unknown(plant: MujocoPlant) -> str:
    """What pulls on the model's bodies in a way that `joint_reactions` does not follow; empty where nothing does."""
    m = plant.mj_model
    other = np.flatnonzero(~np.isin(m.actuator_trntype, [int(kind) for kind in _JOINT_OR_TENDON]))
    if other.size:
        name = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_ACTUATOR, int(other[0])) or f"actuator{int(other[0])}"
        kind = mujoco.mjtTrn(m.actuator_trntype[other[0]]).name.removeprefix("mjTRN_").lower()
        return f"actuator {name!r} acts on a {kind}: let it pull a tendon"
    on_tendon = m.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    if m.tendon_armature.any() or m.actuator_armature[on_tendon].any():
        return "a tendon has armature: give it to the joints"
    if m.opt.density > 0 or m.opt.viscosity > 0:
        return "the bodies move in a medium: set density and viscosity to 0"
    if m.nflex:
        return "the model has a flex: remove it"
    return ""


def _bodies_below(m: mujoco.MjModel) -> NDArray[np.bool_]:
    """(njnt, nbody) True where a body is the joint's own or hangs on it."""
    below = np.eye(m.nbody, dtype=bool)
    for b in range(1, m.nbody):  # parents come first
        below[:, b] |= below[:, m.body_parentid[b]]
    return np.asarray(below[m.jnt_bodyid])

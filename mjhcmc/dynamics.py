"""Joint moments: what muscles give at a state, and how the smooth forces change with it.

The one reader of MuJoCo's moment arms. MuJoCo's ``actuator_moment`` is +dL/dq and a pulling force is negative; here
R = -dL/dq and forces pull positive, so that the muscles' joint moment is R^T F (OpenSim's convention).
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.plant import MujocoPlant

_VELOCITY_STEP = 1e-5  # rad/s: error about (step^2 + 1e-16/step) on forces smooth in v
_POSITION_STEP = 1e-6  # rad


@dataclass(frozen=True)
class MuscleMoments:
    """Joint moments of the muscles at one state: affine in activation, B a + p.

    Attributes:
        B: (nv, n_muscle) N m, joint moments of each muscle at full activation, without its bias.
        p: (nv,) N m, joint moments of all actuators at zero activation (passive force, other actuators).
        gain: (n_muscle,) N, pulling positive: each muscle's actuator force at full activation, without its bias.
        bias: (n_muscle,) N, pulling positive: its force at zero activation; with fiber damping where asked for.
    """

    B: NDArray[np.float64]
    p: NDArray[np.float64]
    gain: NDArray[np.float64]
    bias: NDArray[np.float64]


def moment_arms(plant: MujocoPlant) -> NDArray[np.float64]:
    """R (n_muscle, nv), m: -dL/dq of each muscle's actuator length, at the plant's last `forward`."""
    d = plant.mj_data
    dense = np.empty((plant.mj_model.nout, plant.mj_model.nv))
    mujoco.mju_sparse2dense(dense, d.actuator_moment, d.moment_rownnz, d.moment_rowadr, d.moment_colind)
    rows = plant.mj_model.actuator_outadr[plant.model.muscle_ids]
    return np.asarray(-dense[rows])


def muscle_moments(plant: MujocoPlant, *, damping: bool = True) -> MuscleMoments:
    """B and p at the plant's state (after `forward`), from the actuator forces at activation 0 and 1.

    Without damping, the bias is that of the actuators alone.

    Leaves the plant's derived actuator forces at activation 0; its state is unchanged.
    """
    m, d, index = plant.mj_model, plant.mj_data, plant.model.act_index
    rows = m.actuator_outadr[plant.model.muscle_ids]
    held = d.act[index]
    d.act[index] = 1.0
    mujoco.mj_fwdActuation(m, d)
    full = -d.actuator_force[rows]
    d.act[index] = 0.0
    mujoco.mj_fwdActuation(m, d)
    passive = -d.actuator_force[rows]
    d.act[index] = held
    gain = full - passive
    return MuscleMoments(
        B=(moment_arms(plant) * gain[:, None]).T,
        p=d.qfrc_actuator.copy(),
        gain=gain,
        bias=passive + fiber_damping(plant) if damping else passive,
    )


def mass_matrix(plant: MujocoPlant) -> NDArray[np.float64]:
    """M (nv, nv), kg m^2 (hinges), at the plant's last `forward`."""
    M = np.empty((plant.mj_model.nv, plant.mj_model.nv))
    mujoco.mj_fullM(plant.mj_model, plant.mj_data, M)
    return M


def required_moment(plant: MujocoPlant, qacc: NDArray[np.float64], p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Q_active (nv,), N m: what activation must supply for qacc at the plant's state.

    Q_active = M qacc + qfrc_bias - qfrc_passive - J^T f_constraint - p - E, by MuJoCo's inverse dynamics; E is the
    plant's external load.
    """
    m, d = plant.mj_model, plant.mj_data
    held = d.qacc.copy()
    d.qacc[:] = qacc
    mujoco.mj_inverse(m, d)
    d.qacc[:] = held
    return np.asarray(d.qfrc_inverse - p - plant.external_load())


def net_moment_for(plant: MujocoPlant, qacc: NDArray[np.float64]) -> NDArray[np.float64]:
    """(nv,) N m: what muscles, reserves and loads from outside must give together for qacc at the plant's state.

    The terms of `net_joint_moment` but E, by MuJoCo's inverse dynamics; leaves the actuator forces at activation 0.
    """
    moments = muscle_moments(plant, damping=False)
    R = moment_arms(plant)
    damping = fiber_damping(plant)
    others = moments.p - R.T @ moments.bias
    return required_moment(plant, qacc, others) + plant.external_load() + R.T @ damping


def damping_and_stiffness(plant: MujocoPlant) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """D = -dF/dv and K = -dF/dq (nv, nv) of all smooth generalized forces, at fixed activation.

    F = qfrc_passive + qfrc_actuator - qfrc_bias, by forward differences at the plant's state. Leaves the plant's
    derived quantities stale; its state is unchanged.
    """
    m, d = plant.mj_model, plant.mj_data
    nv = m.nv
    qpos, qvel = d.qpos.copy(), d.qvel.copy()
    D, K = np.empty((nv, nv)), np.empty((nv, nv))
    base = _smooth_force(plant, position=True)
    for j in range(nv):
        d.qvel[j] += _VELOCITY_STEP
        D[:, j] = (base - _smooth_force(plant, position=False)) / _VELOCITY_STEP
        d.qvel[j] = qvel[j]
    for j in range(nv):
        d.qpos[j] += _POSITION_STEP
        K[:, j] = (base - _smooth_force(plant, position=True)) / _POSITION_STEP
        d.qpos[j] = qpos[j]
    return D, K


def _smooth_force(plant: MujocoPlant, *, position: bool) -> NDArray[np.float64]:
    m, d = plant.mj_model, plant.mj_data
    if position:
        mujoco.mj_fwdPosition(m, d)
    mujoco.mj_fwdVelocity(m, d)
    mujoco.mj_fwdActuation(m, d)
    return np.asarray(d.qfrc_passive + d.qfrc_actuator - d.qfrc_bias)


def fiber_damping(plant: MujocoPlant) -> NDArray[np.float64]:
    """(n_muscle,) N, pulling positive: the damping of each muscle's tendon and actuator at the plant's state.

    Damping of the fiber is hosted as damping of the path, so MuJoCo counts it among the passive forces; it is muscle
    force (Millard 2013, doi 10.1115/1.4023390). Force = v (d + p0 |v| + p1 v^2), v the lengthening velocity. A tendon
    that several muscles share stays passive: no muscle owns its damping.
    """
    m, d, ids = plant.mj_model, plant.mj_data, plant.model.muscle_ids
    rows = m.actuator_outadr[ids]
    v = d.actuator_velocity[rows]
    force = _polynomial(v, m.actuator_damping[ids], m.actuator_dampingpoly[ids])
    tendon = plant.model.own_tendons
    owns = tendon >= 0
    t = tendon[owns]
    # an actuator's length is gear times its tendon's
    gear = m.actuator_gear[ids[owns], 0]
    force[owns] += _polynomial(d.ten_velocity[t], m.tendon_damping[t], m.tendon_dampingpoly[t]) / gear
    return force


def _polynomial(v: NDArray[np.float64], d: NDArray[np.float64], p: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(v * (d + p[:, 0] * np.abs(v) + p[:, 1] * v**2))


@dataclass(frozen=True)
class NodeForces:
    """Forces at one node.

    Attributes:
        muscle_force: (n_muscle,) N along the path, pulling positive: active, passive and fiber damping.
        muscle_moment: (nv,) N m, R^T F.
        net_joint_moment: (nv,) N m, what muscles and reserves must give for qacc: M qacc + qfrc_bias -
            (qfrc_passive - R^T f_damping) - J^T f_constraint - other actuators - E, f_damping being the muscles' own
            (see `fiber_damping`), E the external load. Equals R^T F + reserve.
    """

    muscle_force: NDArray[np.float64]
    muscle_moment: NDArray[np.float64]
    net_joint_moment: NDArray[np.float64]


def node_forces(plant: MujocoPlant) -> NodeForces:
    """Muscle forces and the moments at the joints, at the plant's last `forward`."""
    m, d, model = plant.mj_model, plant.mj_data, plant.model
    damping, R = fiber_damping(plant), moment_arms(plant)
    muscle = -d.actuator_force[m.actuator_outadr[model.muscle_ids]]
    inertial = np.empty(m.nv)
    mujoco.mj_mulM(m, d, inertial, d.qacc)
    others = d.qfrc_actuator - R.T @ muscle
    passive = d.qfrc_passive - R.T @ damping
    force = muscle + damping
    return NodeForces(
        muscle_force=force * model.path_gear,
        muscle_moment=R.T @ force,
        net_joint_moment=inertial + d.qfrc_bias - passive - d.qfrc_constraint - others - plant.external_load(),
    )


def net_joint_moment(plant: MujocoPlant) -> NDArray[np.float64]:
    """(nv,) N m at the plant's last `forward`: what muscles and reserves must give for its qacc; see `NodeForces`."""
    return node_forces(plant).net_joint_moment

"""Joint moments: what muscles give at a state, and how the smooth forces change with it.

The one reader of MuJoCo's moment arms. MuJoCo's ``actuator_moment`` is +dL/dq and a pulling force is negative; here
R = -dL/dq and forces pull positive, so that the muscles' joint moment is R^T F (OpenSim's convention).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.model import MuscleModel
from mjhcmc.plant import MujocoPlant

VELOCITY_STEP = 1e-5  # rad/s: error about (step^2 + 1e-16/step) on forces smooth in v
POSITION_STEP = 1e-6  # rad


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


def muscle_moments(plant: MujocoPlant, *, damping: bool = True, steady: bool = False) -> MuscleMoments:
    """B and p at the plant's state (after `forward`), of muscle force that is affine in activation.

    Leaves the plant's derived actuator forces at activation 0; its state is unchanged.

    Args:
        plant: the plant.
        damping: whether the bias counts fiber damping that MuJoCo hosts as damping of the path.
        steady: whether muscles are left to settle, see `MujocoPlant.steady_gain_and_bias`.
    """
    gain, bias = plant.steady_gain_and_bias() if steady else plant.gain_and_bias()
    R, p = moment_arms(plant), plant.mj_data.qfrc_actuator.copy()
    return MuscleMoments(
        B=(R * gain[:, None]).T,
        p=p + R.T @ bias if plant.hosted is not None else p,
        gain=gain,
        bias=bias + fiber_damping(plant.model, plant.mj_data) if damping else bias,
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
    damping = fiber_damping(plant.model, plant.mj_data)
    others = moments.p - R.T @ moments.bias
    return required_moment(plant, qacc, others) + plant.external_load() + R.T @ damping


def damping_matrix(plant: MujocoPlant) -> NDArray[np.float64]:
    """D = -dF/dv (nv, nv) of all smooth generalized forces, at the plant's last `forward`.

    At fixed activation, and fiber length where tendons stretch. F = qfrc_passive + qfrc_actuator - qfrc_bias and what
    muscles outside MuJoCo do, by forward differences. Leaves the plant's derived quantities stale; its state is
    unchanged.
    """
    m, d = plant.mj_model, plant.mj_data
    held, base = d.qvel.copy(), smooth_force(d) + plant.hosted_moment()
    D = np.empty((m.nv, m.nv))
    for j in range(m.nv):
        d.qvel[j] += VELOCITY_STEP
        mujoco.mj_fwdVelocity(m, d)
        mujoco.mj_fwdActuation(m, d)
        D[:, j] = (base - smooth_force(d) - plant.hosted_moment()) / VELOCITY_STEP
        d.qvel[j] = held[j]
    return D


def stiffness_matrix(plant: MujocoPlant) -> NDArray[np.float64]:
    """K = -dF/dq (nv, nv) likewise; the plant needs no `forward` before."""
    m, d = plant.mj_model, plant.mj_data
    held = d.qpos.copy()
    K = np.empty((m.nv, m.nv))
    base, step = np.empty(m.nv), np.zeros(m.nv)
    for j in range(-1, m.nv):
        if j >= 0:
            step[j] = POSITION_STEP
            mujoco.mj_integratePos(m, d.qpos, step, 1.0)
            step[j] = 0.0
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        mujoco.mj_fwdActuation(m, d)
        if j < 0:
            base = smooth_force(d) + plant.hosted_moment()
        else:
            K[:, j] = (base - smooth_force(d) - plant.hosted_moment()) / POSITION_STEP
            d.qpos[:] = held
    return K


def smooth_force(data: Any) -> NDArray[np.float64]:
    """(..., nv) N m or N: what acts on the joints but for constraints, reserves and loads from outside.

    Args:
        data: MuJoCo's derived quantities, of one simulation (`MjData`) or of several.
    """
    return np.asarray(data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias)


def fiber_damping(model: MuscleModel, data: Any) -> NDArray[np.float64]:
    """(..., n_muscle) N, pulling positive: the damping of each muscle's tendon and actuator.

    Damping of the fiber is hosted as damping of the path, so MuJoCo counts it among the passive forces; it is muscle
    force (Millard 2013, doi 10.1115/1.4023390). Force = v (d + p0 |v| + p1 v^2), v the lengthening velocity. A tendon
    that several muscles share stays passive: no muscle owns its damping.

    Args:
        model: the model.
        data: as `smooth_force`, with actuator_velocity and ten_velocity.
    """
    m, ids = model.mj_model, model.muscle_ids
    v = data.actuator_velocity[..., m.actuator_outadr[ids]]
    force = _polynomial(v, m.actuator_damping[ids], m.actuator_dampingpoly[ids])
    tendon = model.own_tendons
    owns = tendon >= 0
    t = tendon[owns]
    # an actuator's length is gear times its tendon's
    gear = m.actuator_gear[ids[owns], 0]
    force[..., owns] += _polynomial(data.ten_velocity[..., t], m.tendon_damping[t], m.tendon_dampingpoly[t]) / gear
    return force


def _polynomial(v: NDArray[np.float64], d: NDArray[np.float64], p: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(v * (d + p[:, 0] * np.abs(v) + p[:, 1] * v**2))


@dataclass(frozen=True)
class NodeForces:
    """Forces at one node, or at several: then with the nodes as first axis.

    Attributes:
        muscle_force: (n_muscle,) N along the path, pulling positive: active, passive and fiber damping.
        muscle_moment: (nv,) N m, R^T F.
        net_joint_moment: (nv,) N m, what muscles and reserves must give for qacc: M qacc + qfrc_bias -
            (qfrc_passive - R^T f_damping) - J^T f_constraint - other actuators - E, f_damping being the muscles' own
            (see `fiber_damping`), E the external load. Equals R^T F + reserve.
        external_load: (nv,) N m or N, E.
    """

    muscle_force: NDArray[np.float64]
    muscle_moment: NDArray[np.float64]
    net_joint_moment: NDArray[np.float64]
    external_load: NDArray[np.float64]


def node_forces(plant: MujocoPlant) -> NodeForces:
    """Muscle forces and the moments at the joints, at the plant's last `forward`."""
    R = moment_arms(plant)
    found = forces_from(plant.model, plant.mj_data, R, plant.inertial_force(), plant.external_load())
    return found if plant.hosted is None else with_hosted(found, plant.model, plant.muscle_force(), R)


def forces_from(
    model: MuscleModel,
    data: Any,
    R: NDArray[np.float64],
    inertial: NDArray[np.float64],
    external_load: NDArray[np.float64],
) -> NodeForces:
    """As `node_forces`, from MuJoCo's derived quantities of one node or of several.

    Args:
        model: the model.
        data: as `fiber_damping`, with actuator_force, qfrc_actuator, qfrc_bias, qfrc_passive and qfrc_constraint.
        R: (..., n_muscle, nv) m, moment arms.
        inertial: (..., nv) N m, M qacc.
        external_load: (..., nv) N m, E.
    """
    damping = fiber_damping(model, data)
    muscle = -data.actuator_force[..., model.mj_model.actuator_outadr[model.muscle_ids]]

    def moment(force: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray((np.swapaxes(R, -1, -2) @ force[..., None])[..., 0])

    others = data.qfrc_actuator - moment(muscle)
    passive = data.qfrc_passive - moment(damping)
    force = muscle + damping
    net = inertial + data.qfrc_bias - passive - data.qfrc_constraint - others - external_load
    return NodeForces(force * model.path_gear, moment(force), net, external_load)


def tied(nodes: NodeForces, N: NDArray[np.float64]) -> NodeForces:
    """The same seen from the independent degrees of freedom; nothing is left at dependent ones.

    What acts on a dependent degree of freedom acts on those that move it: N^T f, as generalized forces of coordinates
    that the equalities are solved for.

    Args:
        nodes: of k nodes.
        N: (k, nv, nv) tangents of the equalities, see `coupling.Coupling`.
    """

    def seen(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.einsum("kij,ki->kj", N, values))

    return replace(
        nodes,
        muscle_moment=seen(nodes.muscle_moment),
        net_joint_moment=seen(nodes.net_joint_moment),
        external_load=seen(nodes.external_load),
    )


def with_hosted(
    nodes: NodeForces, model: MuscleModel, force: NDArray[np.float64], R: NDArray[np.float64]
) -> NodeForces:
    """The same with what muscles outside MuJoCo pull.

    Args:
        nodes: of the bodies, whose own muscles pull nothing.
        model: the bodies.
        force: (..., n_muscle) N.
        R: (..., n_muscle, nv) m.
    """
    moment = (np.swapaxes(R, -1, -2) @ force[..., None])[..., 0]
    return replace(
        nodes,
        muscle_force=nodes.muscle_force + force * model.path_gear,
        muscle_moment=nodes.muscle_moment + moment,
    )


def stacked(nodes: Sequence[NodeForces]) -> NodeForces:
    """Those of several nodes as one, the nodes as first axis."""
    return NodeForces(*(np.array([getattr(node, f.name) for node in nodes]) for f in fields(NodeForces)))


def net_joint_moment(plant: MujocoPlant) -> NDArray[np.float64]:
    """(nv,) N m at the plant's last `forward`: what muscles and reserves must give for its qacc; see `NodeForces`."""
    return node_forces(plant).net_joint_moment

"""A model over its joints' ranges, at rest: muscle lengths, moment arms, strength, how fast velocities decay.

One joint moves at a time, the others stay at the reference pose, but for what equality constraints tie to it: that
follows, and counts as part of the joint. Contacts and limits are left out: what is measured is what muscles and joints
do by themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc import dynamics
from mjhcmc.methods.stability import decay_rate
from mjhcmc.model import MuscleModel
from mjhcmc.model_check.ties import Ties
from mjhcmc.model_problems import joint_type
from mjhcmc.plant import MujocoPlant, State

UNLIMITED_HINGE = np.pi / 2
"""rad either way of the reference pose that a hinge without limits is moved."""

UNLIMITED_SLIDE = 0.1
"""m either way of the reference pose that a slide without limits is moved."""

_HALVINGS = 20


@dataclass(frozen=True)
class Pose:
    """What muscles and joints do at one pose, at rest.

    Attributes:
        length: (n_muscle,) m, length of each muscle's actuator.
        arm: (n_muscle, nv) m, moment arms, -dL/dq, with what follows; zero for what follows, as are the next.
        strength: (nv, 2) N m, the most negative and the most positive moment that activation can give, each muscle
            being at the upper or the lower end of its excitation range as suits it.
        passive: (nv,) N m, moment at zero activation: passive muscle force, other actuators at control 0, springs.
    """

    length: NDArray[np.float64]
    arm: NDArray[np.float64]
    strength: NDArray[np.float64]
    passive: NDArray[np.float64]


@dataclass(frozen=True)
class Sweep:
    """One joint moved through its range.

    Attributes:
        joint: index of the joint.
        position: (n,) rad or m, where the equality constraints can be met.
        qpos: (n, nq) rad or m, with what is tied in its place.
        length: (n, n_muscle) m, of each muscle's actuator.
        arm: (n, n_muscle) m, about this joint.
        largest_arm: (n_muscle, nv) m, largest magnitude about each degree of freedom on the way.
        strength: (n, 2) N m, most negative and most positive moment at this joint.
    """

    joint: int
    position: NDArray[np.float64]
    qpos: NDArray[np.float64]
    length: NDArray[np.float64]
    arm: NDArray[np.float64]
    largest_arm: NDArray[np.float64]
    strength: NDArray[np.float64]


@dataclass(frozen=True)
class Jump:
    """A muscle whose length jumps as a joint moves.

    Attributes:
        muscle: index among the muscles.
        joint: index of the joint.
        position: rad or m.
        size: m.
    """

    muscle: int
    joint: int
    position: float
    size: float


class ScanPlant(MujocoPlant):
    """A plant for scanning: no contacts, limits and sensors, no muscle disabled; equality constraints as `Ties`.

    Args:
        model: the model.

    Attributes:
        ties: what the equality constraints tie.
        reference: (nq,) rad or m, the reference pose, with what is tied in its place where that is possible.
        missed: rad or m, by which the reference pose misses equality constraints that cannot be met near it; else None.
        joints: indices of the hinges and slides that are tracked.
        driven: (n,) indices among `Ties.free_dofs` of those that no motion prescribes.
    """

    def __init__(self, model: MuscleModel) -> None:
        super().__init__(model)
        m, bit = self.mj_model, mujoco.mjtDisableBit
        self.ties = Ties(model)
        m.opt.disableflags |= int(bit.mjDSBL_CONSTRAINT) | int(bit.mjDSBL_SENSOR)
        m.opt.disableflags &= ~int(bit.mjDSBL_ACTUATION)
        m.opt.disableactuator = 0
        filled = self.ties.fill(model.qpos_reference)
        self.reference = _or(filled, model.qpos_reference)
        self.missed = self.ties.missed(model.qpos_reference) if filled is None else None
        tracked = set(model.roles.tracked.tolist())
        self.joints = [
            j for j in range(m.njnt) if joint_type(m, j) in ("hinge", "slide") and int(m.jnt_dofadr[j]) in tracked
        ]
        self.driven = np.flatnonzero(~np.isin(self.ties.free_dofs, model.roles.prescribed))

    def moved(
        self, joint: int, position: float, start: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64] | None:
        """(nq,) rad or m, a pose, of itself the reference, with one joint elsewhere; None where it cannot be."""
        qpos = (self.reference if start is None else start).copy()
        qpos[self.mj_model.jnt_qposadr[joint]] = position
        return self.ties.fill(qpos)


def _or(found: NDArray[np.float64] | None, other: NDArray[np.float64]) -> NDArray[np.float64]:
    return other if found is None else found


def scanned_range(model: MuscleModel, joint: int) -> tuple[float, float]:
    """rad or m, through which a hinge or slide is moved: its range, or about its reference where it has no limits."""
    at = model.mj_model.jnt_qposadr[joint]
    low, high = model.joint_range[at]
    if np.isfinite(low) and np.isfinite(high):
        return float(low), float(high)
    reference = model.qpos_reference[at]
    reach = UNLIMITED_HINGE if model.joint_is_rotation[at] else UNLIMITED_SLIDE
    return float(reference - reach), float(reference + reach)


def measure(plant: ScanPlant, qpos: NDArray[np.float64]) -> Pose:
    """See `Pose`."""
    _rest_at(plant, qpos, 0.0)
    d = plant.mj_data
    length = d.actuator_length[plant.mj_model.actuator_outadr[plant.model.muscle_ids]]
    moments = dynamics.muscle_moments(plant)
    both = plant.ties.reduce(qpos, np.column_stack([dynamics.moment_arms(plant).T, moments.p + d.qfrc_passive]))
    arm, passive = both[:, :-1], both[:, -1]
    most = plant.model.force_limit
    rest = np.minimum(moments.bias, most)
    ends = plant.model.excitation_range.T
    low, high = (arm * (np.minimum(moments.gain * end + moments.bias, most) - rest) for end in ends)
    return Pose(
        length=length,
        arm=arm.T,
        strength=np.stack([np.minimum(low, high).sum(axis=1), np.maximum(low, high).sum(axis=1)], axis=1),
        passive=passive,
    )


def sweep(plant: ScanPlant, joint: int, count: int) -> Sweep | None:
    """Move a hinge or slide through its range in count poses; None where it cannot be anywhere."""
    dof = int(plant.mj_model.jnt_dofadr[joint])
    reached = _path(plant, joint, np.linspace(*scanned_range(plant.model, joint), count))
    if not reached:
        return None
    poses = [measure(plant, qpos) for _, qpos in reached]
    return Sweep(
        joint=joint,
        position=np.array([position for position, _ in reached]),
        qpos=np.array([qpos for _, qpos in reached]),
        length=np.array([pose.length for pose in poses]),
        arm=np.array([pose.arm[:, dof] for pose in poses]),
        largest_arm=np.max([np.abs(pose.arm) for pose in poses], axis=0),
        strength=np.array([pose.strength[dof] for pose in poses]),
    )


def _path(plant: ScanPlant, joint: int, positions: NDArray[np.float64]) -> list[tuple[float, NDArray[np.float64]]]:
    """Positions of a joint and the poses there, outwards from the reference as far as the ties let it move."""
    middle = int(np.abs(positions - plant.reference[plant.mj_model.jnt_qposadr[joint]]).argmin())
    below, above = list(range(middle, -1, -1)), list(range(middle + 1, len(positions)))
    found: dict[int, NDArray[np.float64]] = {}
    for way, qpos in ((below, plant.reference), (above, plant.reference)):
        for k in way:
            there = plant.moved(joint, positions[k], qpos)
            if there is None:
                break
            found[k] = qpos = there
    return [(float(positions[k]), found[k]) for k in sorted(found)]


def find_jumps(plant: ScanPlant, swept: Sweep, tolerance: NDArray[np.float64]) -> list[Jump]:
    """Muscles whose length changes at a point by more than tolerance (n_muscle,) m: at most one jump a muscle.

    Between neighbouring poses the length should change by the integral of -R dq. Where the trapezoid rule misses that,
    the interval is halved towards the larger miss: a jump stays, a mere bend in R does not.
    """
    step = np.diff(swept.position)[:, None]
    miss = np.abs(np.diff(swept.length, axis=0) + step * (swept.arm[:-1] + swept.arm[1:]) / 2)
    found = []
    for i in np.flatnonzero(miss.max(axis=0, initial=0.0) > tolerance):
        k = int(np.argmax(miss[:, i]))
        position, size = _close_in(plant, swept, int(i), k)
        if size > tolerance[i]:
            found.append(Jump(int(i), swept.joint, position, size))
    return found


def decay(plant: ScanPlant, qpos: NDArray[np.float64], activation: float) -> float:
    """1/s, how fast the fastest velocity decays at rest at a pose, all muscles at that share of their full activation.

    Full activation is the upper end of a muscle's excitation range. What a motion prescribes stands still.
    """
    try:
        return decay_rate(*_reduced(plant, qpos, activation))
    except np.linalg.LinAlgError:  # no inertia some way, as in a gimbal lock: nothing can be said
        return 0.0


def fastest(plant: ScanPlant, qpos: NDArray[np.float64], activation: float) -> int:
    """The degree of freedom that moves most in what decays fastest, see `decay`."""
    M, D = _reduced(plant, qpos, activation)
    rates, modes = np.linalg.eig(np.linalg.solve(M, D))
    energy = np.abs(modes[:, np.argmax(rates.real)]) ** 2 * np.diag(M)  # comparable between rad and m
    return int(plant.ties.free_dofs[plant.driven[np.argmax(energy)]])


def _reduced(
    plant: ScanPlant, qpos: NDArray[np.float64], activation: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Inertia and damping of what is neither tied nor prescribed."""
    _rest_at(plant, qpos, activation)
    M, D = dynamics.mass_matrix(plant), _damping_at_rest(plant)
    driven = np.ix_(plant.driven, plant.driven)
    return plant.ties.reduce_matrix(qpos, M)[driven], plant.ties.reduce_matrix(qpos, D)[driven]


def _damping_at_rest(plant: ScanPlant) -> NDArray[np.float64]:
    """D = -dF/dv (nv, nv) of all smooth forces at rest, after `forward`: `dynamics.damping_matrix`, in less time.

    The force of an actuator depends on its own velocity alone: two velocities tell the slope of all actuators.
    """
    m, d = plant.mj_model, plant.mj_data
    D, still = np.empty((m.nv, m.nv)), d.qvel.copy()
    passive = d.qfrc_passive - d.qfrc_bias
    for j in range(m.nv):
        d.qvel[j] = dynamics.VELOCITY_STEP
        mujoco.mj_fwdVelocity(m, d)
        D[:, j] = (passive - d.qfrc_passive + d.qfrc_bias) / dynamics.VELOCITY_STEP
        d.qvel[j] = still[j]
    arm = np.empty((m.nout, m.nv))
    mujoco.mju_sparse2dense(arm, d.actuator_moment, d.moment_rownnz, d.moment_rowadr, d.moment_colind)
    way = np.random.default_rng(0).uniform(-1, 1, m.nv)
    ends = []
    for speed in (-dynamics.VELOCITY_STEP, dynamics.VELOCITY_STEP):
        d.qvel[:] = speed * way
        mujoco.mj_fwdVelocity(m, d)
        mujoco.mj_fwdActuation(m, d)
        ends.append((d.actuator_force.copy(), d.actuator_velocity.copy()))
    d.qvel[:] = still
    (force0, velocity0), (force1, velocity1) = ends
    apart = velocity1 - velocity0
    moves = np.abs(apart) > 1e-9 * dynamics.VELOCITY_STEP
    slope = np.divide(force0 - force1, apart, out=np.zeros(m.nout), where=moves)
    D += arm.T @ (slope[:, None] * arm)
    return D


def _rest_at(plant: ScanPlant, qpos: NDArray[np.float64], activation: float) -> None:
    still = np.zeros(plant.model.nv)
    plant.set_state(State(0.0, qpos, still, activation * plant.model.excitation_range[:, 1], still))
    plant.forward()


def _close_in(plant: ScanPlant, swept: Sweep, muscle: int, k: int) -> tuple[float, float]:
    """Position and size of the muscle's largest jump between two neighbouring positions of a sweep."""
    dof = int(plant.model.mj_model.jnt_dofadr[swept.joint])

    def at(q: float) -> tuple[float, float, float]:
        pose = measure(plant, _or(plant.moved(swept.joint, q, swept.qpos[k]), swept.qpos[k]))
        return q, float(pose.length[muscle]), float(pose.arm[muscle, dof])

    def miss(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
        return abs(b[1] - a[1] + (b[0] - a[0]) * (a[2] + b[2]) / 2)

    a, b = at(swept.position[k]), at(swept.position[k + 1])
    for _ in range(_HALVINGS):
        middle = at((a[0] + b[0]) / 2)
        a, b = (a, middle) if miss(a, middle) >= miss(middle, b) else (middle, b)
    return (a[0] + b[0]) / 2, miss(a, b)

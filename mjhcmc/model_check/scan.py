"""A model over its joints' ranges, at rest: muscle lengths, moment arms, strength, how fast velocities decay.

One joint moves at a time, the others stay at the reference pose, but for joints that follow another by an equality:
they follow, and count as part of the joint that they follow. Contacts and limits are left out: what is measured is what
muscles and joints do by themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc import dynamics
from mjhcmc.methods.windows import decay_rate
from mjhcmc.model import MuscleModel
from mjhcmc.model_check.coupling import JointCoupling
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
        position: (n,) rad or m.
        length: (n, n_muscle) m, of each muscle's actuator.
        arm: (n, n_muscle) m, about this joint.
        largest_arm: (n_muscle, nv) m, largest magnitude about each degree of freedom on the way.
        strength: (n, 2) N m, most negative and most positive moment at this joint.
    """

    joint: int
    position: NDArray[np.float64]
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
    """A plant for scanning: no contacts, limits and sensors, no muscle disabled; equalities by their coupling.

    Args:
        model: the model.

    Attributes:
        coupling: what follows what.
        reference: (nq,) rad or m, the reference pose, with what follows in its place.
        joints: indices of the hinges and slides that follow nothing.
    """

    def __init__(self, model: MuscleModel) -> None:
        super().__init__(model)
        m, bit = self.mj_model, mujoco.mjtDisableBit
        m.opt.disableflags |= int(bit.mjDSBL_CONSTRAINT) | int(bit.mjDSBL_SENSOR)
        m.opt.disableflags &= ~int(bit.mjDSBL_ACTUATION)
        m.opt.disableactuator = 0
        self.coupling = JointCoupling(m)
        self.reference = self.coupling.fill(model.qpos_reference)
        self.joints = [
            j for j in range(m.njnt) if joint_type(m, j) in ("hinge", "slide") and j not in self.coupling.follows
        ]

    def moved(self, joint: int, position: float) -> NDArray[np.float64]:
        """(nq,) rad or m, the reference pose with one joint elsewhere."""
        qpos = self.reference.copy()
        qpos[self.mj_model.jnt_qposadr[joint]] = position
        return self.coupling.fill(qpos)


def scanned_range(model: MuscleModel, joint: int) -> tuple[float, float]:
    """rad or m, through which a hinge or slide is moved: its range, or about its reference where it has no limits."""
    low, high = model.joint_range[joint]
    if np.isfinite(low) and np.isfinite(high):
        return float(low), float(high)
    reference = model.qpos_reference[model.mj_model.jnt_qposadr[joint]]
    reach = UNLIMITED_HINGE if model.joint_is_rotation[joint] else UNLIMITED_SLIDE
    return float(reference - reach), float(reference + reach)


def measure(plant: ScanPlant, qpos: NDArray[np.float64]) -> Pose:
    """See `Pose`."""
    _rest_at(plant, qpos, 0.0)
    d = plant.mj_data
    length = d.actuator_length[plant.mj_model.actuator_outadr[plant.model.muscle_ids]]
    moments = dynamics.muscle_moments(plant)
    ends = plant.coupling.reduce(qpos, moments.B)[:, :, None] * plant.model.excitation_range
    return Pose(
        length=length,
        arm=plant.coupling.reduce(qpos, dynamics.moment_arms(plant).T).T,
        strength=np.stack([ends.min(axis=2).sum(axis=1), ends.max(axis=2).sum(axis=1)], axis=1),
        passive=plant.coupling.reduce(qpos, moments.p + d.qfrc_passive),
    )


def sweep(plant: ScanPlant, joint: int, count: int) -> Sweep:
    """Move a hinge or slide through its range in count poses."""
    dof = int(plant.mj_model.jnt_dofadr[joint])
    positions = np.linspace(*scanned_range(plant.model, joint), count)
    poses = [measure(plant, plant.moved(joint, q)) for q in positions]
    return Sweep(
        joint=joint,
        position=positions,
        length=np.array([pose.length for pose in poses]),
        arm=np.array([pose.arm[:, dof] for pose in poses]),
        largest_arm=np.max([np.abs(pose.arm) for pose in poses], axis=0),
        strength=np.array([pose.strength[dof] for pose in poses]),
    )


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
        position, size = _close_in(plant, swept.joint, int(i), swept.position[k], swept.position[k + 1])
        if size > tolerance[i]:
            found.append(Jump(int(i), swept.joint, position, size))
    return found


def decay(plant: ScanPlant, qpos: NDArray[np.float64], activation: float) -> float:
    """1/s, how fast the fastest velocity decays at rest at a pose, all muscles at that share of their full activation.

    Full activation is the upper end of a muscle's excitation range.
    """
    _rest_at(plant, qpos, activation)
    M = plant.coupling.reduce_matrix(qpos, dynamics.mass_matrix(plant))
    return decay_rate(M, plant.coupling.reduce_matrix(qpos, dynamics.damping_matrix(plant)))


def _rest_at(plant: ScanPlant, qpos: NDArray[np.float64], activation: float) -> None:
    still = np.zeros(plant.model.nv)
    plant.set_state(State(0.0, qpos, still, activation * plant.model.excitation_range[:, 1], still))
    plant.forward()


def _close_in(plant: ScanPlant, joint: int, muscle: int, low: float, high: float) -> tuple[float, float]:
    """Position and size of the muscle's largest jump between two positions of a joint."""
    dof = int(plant.model.mj_model.jnt_dofadr[joint])

    def at(q: float) -> tuple[float, float, float]:
        pose = measure(plant, plant.moved(joint, q))
        return q, float(pose.length[muscle]), float(pose.arm[muscle, dof])

    def miss(a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
        return abs(b[1] - a[1] + (b[0] - a[0]) * (a[2] + b[2]) / 2)

    a, b = at(low), at(high)
    for _ in range(_HALVINGS):
        middle = at((a[0] + b[0]) / 2)
        a, b = (a, middle) if miss(a, middle) >= miss(middle, b) else (middle, b)
    return (a[0] + b[0]) / 2, miss(a, b)

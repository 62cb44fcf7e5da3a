"""How leg8 compares with the reference model: moment arms, lengths, mass matrix, inverse dynamics.

The reference tables come from OpenSim 4.6 on gait10dof18musc's right leg: ``leg8_paths.csv`` (angles in degrees,
musculotendon lengths in m, moment arms -dL/dq in m) and ``leg8_dynamics.csv`` (angles in rad, torques in N m).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import ModelError
from mjhcmc.leg8.table import JOINTS, MUSCLES

if TYPE_CHECKING:
    import mujoco

Array = NDArray[np.float64]

FIT_RANGE_DEG = ((-10.0, 30.0), (-60.0, 0.0), (-20.0, 10.0))
"""Hip, knee and ankle range over which the moment arms are held to the reference, degrees."""


@dataclass(frozen=True)
class PathReference:
    """Reference musculotendon lengths and moment arms on a grid of postures.

    Attributes:
        qpos: Joint angles (n, 3), rad.
        length: Musculotendon lengths (n, 8), m.
        arm: Moment arms -dL/dq (n, 8, 3), m.
    """

    qpos: Array
    length: Array
    arm: Array

    def within(self, limits_deg: tuple[tuple[float, float], ...]) -> PathReference:
        """The postures whose joint angles lie within the limits, in degrees, ends included."""
        low, high = np.radians(np.asarray(limits_deg)).T
        keep = np.all((self.qpos >= low - 1e-9) & (self.qpos <= high + 1e-9), axis=1)
        return PathReference(self.qpos[keep], self.length[keep], self.arm[keep])


@dataclass(frozen=True)
class DynamicsReference:
    """Reference mass matrices and inverse-dynamics torques of random states.

    Attributes:
        qpos: Joint angles (n, 3), rad.
        qvel: Joint velocities (n, 3), rad/s.
        qacc: Joint accelerations (n, 3), rad/s^2.
        torque: Net joint torques, gravity included, no muscles (n, 3), N m.
        mass_matrix: Mass matrices (n, 3, 3), kg m^2.
    """

    qpos: Array
    qvel: Array
    qacc: Array
    torque: Array
    mass_matrix: Array


def read_columns(path: Path) -> dict[str, Array]:
    """The columns of a comma-separated table with one header line; lines that begin with # are comments.

    Raises:
        ModelError: The file is missing, or a row of it is not a row of numbers.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"{path}: cannot be read ({error}): give a comma-separated reference table") from error
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    names = lines[0].split(",") if lines else []
    try:
        values = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
        return {name: values[:, i] for i, name in enumerate(names)}
    except (ValueError, IndexError) as error:
        raise ModelError(f"{path}: not a table of numbers ({error}): give a comma-separated reference table") from error


def _column(table: dict[str, Array], name: str, path: Path) -> Array:
    if name not in table:
        raise ModelError(
            f"{path}: no column {name}; it has {', '.join(table) or 'none'}: give the right reference table"
        )
    return table[name]


def read_paths(path: Path) -> PathReference:
    """Read ``leg8_paths.csv``; errors as :func:`read_columns`."""
    table = read_columns(path)

    def stack(names: list[str]) -> Array:
        return np.stack([_column(table, name, path) for name in names], axis=1)

    return PathReference(
        qpos=np.radians(stack([f"{joint}_deg" for joint in JOINTS])),
        length=stack([f"lmt_{muscle}_r" for muscle in MUSCLES]),
        arm=np.stack([stack([f"r_{joint}_{muscle}_r" for joint in JOINTS]) for muscle in MUSCLES], axis=1),
    )


def read_dynamics(path: Path) -> DynamicsReference:
    """Read ``leg8_dynamics.csv``; errors as :func:`read_columns`."""
    table = read_columns(path)
    qpos, qvel, qacc, torque = (
        np.stack([_column(table, f"{prefix}_{joint}", path) for joint in JOINTS], axis=1)
        for prefix in ("q", "u", "a", "tau")
    )
    order = "hka"
    entries = [[_column(table, "M_" + "".join(sorted((r, c), key=order.index)), path) for c in order] for r in order]
    return DynamicsReference(qpos, qvel, qacc, torque, np.moveaxis(np.array(entries), 2, 0))


def lengths_and_arms(model: mujoco.MjModel, qpos: Array) -> tuple[Array, Array]:
    """Musculotendon lengths and moment arms of a model's muscles.

    Args:
        model: leg8.
        qpos: Joint angles (n, 3), rad.

    Returns:
        Lengths (n, 8) in m, and moment arms (n, 8, 3) in m with OpenSim's sign -dL/dq, opposite to MuJoCo's.
    """
    import mujoco

    data = mujoco.MjData(model)
    length = np.empty((len(qpos), model.nu))
    arm = np.empty((len(qpos), model.nu, model.nv))
    dense = np.empty((model.nu, model.nv))
    for row, posture in enumerate(qpos):
        data.qpos[:] = posture
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        mujoco.mj_transmission(model, data)
        mujoco.mju_sparse2dense(dense, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
        length[row] = data.actuator_length
        arm[row] = -dense
    return length, arm


def dynamics(model: mujoco.MjModel, states: DynamicsReference) -> tuple[Array, Array]:
    """Inverse-dynamics torques (n, 3) in N m and mass matrices (n, 3, 3) in kg m^2 of a model at the given states."""
    import mujoco

    data = mujoco.MjData(model)
    torque = np.empty((len(states.qpos), model.nv))
    mass_matrix = np.empty((len(states.qpos), model.nv, model.nv))
    for row in range(len(states.qpos)):
        data.qpos[:], data.qvel[:], data.qacc[:] = states.qpos[row], states.qvel[row], states.qacc[row]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_rne(model, data, 1, torque[row])
        mujoco.mj_fullM(model, data, mass_matrix[row])
    return torque, mass_matrix


@dataclass(frozen=True)
class PathAgreement:
    """Errors of leg8's paths against the reference.

    Attributes:
        worst_arm: Largest absolute error of each moment arm (8, 3), m.
        rms_arm: Root mean square error of each moment arm (8, 3), m.
        worst_length: Largest absolute error of each length after the slack offset (8,), m.
    """

    worst_arm: Array
    rms_arm: Array
    worst_length: Array


def path_agreement(model: mujoco.MjModel, reference: PathReference, slack_offset: Array) -> PathAgreement:
    """Compare moment arms and lengths; ``slack_offset`` (8,) in m is what the tendon slack lengths were shifted by."""
    length, arm = lengths_and_arms(model, reference.qpos)
    error = arm - reference.arm
    stretch = length - slack_offset - reference.length
    return PathAgreement(
        worst_arm=np.abs(error).max(axis=0),
        rms_arm=np.sqrt((error**2).mean(axis=0)),
        worst_length=np.abs(stretch).max(axis=0),
    )


def dynamics_agreement(model: mujoco.MjModel, reference: DynamicsReference) -> tuple[Array, Array]:
    """Largest errors of the torques (3,) and of the mass matrix (3, 3), each over its own peak in the reference."""
    torque, mass_matrix = dynamics(model, reference)
    torque_error = np.abs(torque - reference.torque).max(axis=0) / np.abs(reference.torque).max(axis=0)
    mass_error = np.abs(mass_matrix - reference.mass_matrix).max(axis=0) / np.abs(reference.mass_matrix).max(axis=0)
    return torque_error, mass_error


def knee_deviation(table: Mapping[str, Any], knee: Array) -> Array:
    """How far the shank lies from where the source's sliding knee puts it, m.

    Both turn by the same angle, so the distance is the same for every point of the shank.

    Args:
        table: The parameter table.
        knee: Knee angles (n,), rad.

    Returns:
        Distances (n,), m.
    """
    from scipy.interpolate import CubicSpline

    joint = table["source"]["joints"]["knee"]
    source = np.stack(
        [CubicSpline(joint[k]["knee_angle"], joint[k]["value"], bc_type="natural")(knee) for k in ("x", "y")], axis=1
    )
    axis = np.asarray(table["fitted"]["knee_axis"][:2])
    arm = np.asarray(joint["offset_at_zero"][:2]) - axis
    cosine, sine = np.cos(knee), np.sin(knee)
    hinge = axis + np.stack([cosine * arm[0] - sine * arm[1], sine * arm[0] + cosine * arm[1]], axis=1)
    distance: Array = np.linalg.norm(hinge - source, axis=1)
    return distance


def force_agreement(model: mujoco.MjModel, table: Mapping[str, Any], reference: Path) -> Array:
    """Root mean square difference of muscle force from the Hill model's with rigid tendon, over F0 (8,).

    Active, passive and damping force of MuJoCo's muscle at given activation, length and velocity stand beside the
    tendon force of Millard2012EquilibriumMuscle. A difference of models, not an error of either.

    Args:
        model: leg8.
        table: The parameter table.
        reference: Columns muscle (its number), a, lmt (m), vmt (m/s), Ft (N).
    """
    import mujoco

    columns = read_columns(reference)
    damping = model.tendon_damping.reshape(model.nu, -1)[:, 0]
    result = np.empty(model.nu)
    for i, name in enumerate(MUSCLES):
        rows = columns["muscle"] == i
        offset, limits = table["fitted"]["slack_offset"][name], model.actuator_lengthrange[i]
        gain, bias, acc0 = model.actuator_gainprm[i, :9], model.actuator_biasprm[i, :9], model.actuator_acc0[i]
        errors = []
        for a, length, velocity, force in zip(*(columns[key][rows] for key in ("a", "lmt", "vmt", "Ft")), strict=True):
            active = a * mujoco.mju_muscleGain(length + offset, velocity, limits, acc0, gain)
            passive = mujoco.mju_muscleBias(length + offset, limits, acc0, bias)
            errors.append(max(damping[i] * velocity - active - passive, 0.0) - force)  # a tendon does not push
        maximum = table["source"]["muscles"][name]["max_isometric_force"]
        result[i] = np.sqrt(np.mean(np.square(errors))) / maximum
    return result

"""MuscleModel: a MuJoCo model seen as muscles that move joints, checked when it is loaded."""

from __future__ import annotations

import copy
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.assets import model_names, model_path
from mjhcmc.errors import MjhcmcWarning, ModelError

COLUMN_MAP_TEXT = "opensim_coordinates"
"""Name of the MJCF ``<custom><text>`` whose data, ``joint=column ...``, maps a model's joints onto file columns."""


@dataclass(frozen=True)
class MuscleModel:
    """A MuJoCo model with muscles, ready for the methods.

    Build it with `MuscleModel.load`. The methods need muscle force to be affine in activation and every degree of
    freedom to be a hinge or a slide; a model that breaks this is refused with the name of what breaks it.

    Attributes:
        name: the model's name.
        mj_model: the compiled model (a private copy; its integrator is RK4).
        joint_names: (nq,) hinge and slide joints, in the order of qpos.
        joint_is_rotation: (nq,) True for hinges (rad), False for slides (m).
        joint_range: (nq, 2) rad or m, -inf and inf where a joint is not limited.
        qpos_reference: (nq,) the model's reference pose, rad or m.
        column_map: file column by joint name, where the model ships one; a leading ``-`` flips the sign.
        muscle_names: (n_muscle,) in the order of the actuators.
        muscle_ids: (n_muscle,) actuator index of each muscle.
        ctrl_index: (n_muscle,) index of each muscle's excitation in ``MjData.ctrl``.
        act_index: (n_muscle,) index of each muscle's activation in ``MjData.act``.
        activation_parameters: (n_muscle, 3) s, s, 1: activation and deactivation time constant, smoothing width.
        excitation_range: (n_muscle, 2) the excitations that the model lets through, within [0, 1].
    """

    name: str
    mj_model: Any
    joint_names: tuple[str, ...]
    joint_is_rotation: NDArray[np.bool_]
    joint_range: NDArray[np.float64]
    qpos_reference: NDArray[np.float64]
    column_map: dict[str, str]
    muscle_names: tuple[str, ...]
    muscle_ids: NDArray[np.intp]
    ctrl_index: NDArray[np.intp]
    act_index: NDArray[np.intp]
    activation_parameters: NDArray[np.float64]
    excitation_range: NDArray[np.float64]

    @property
    def dof_names(self) -> tuple[str, ...]:
        """(nv,) names of the degrees of freedom; a hinge or slide has its joint's name."""
        return self.joint_names

    @property
    def nq(self) -> int:
        """Number of generalized positions."""
        return int(self.mj_model.nq)

    @property
    def nv(self) -> int:
        """Number of degrees of freedom."""
        return int(self.mj_model.nv)

    @property
    def n_muscle(self) -> int:
        """Number of muscles."""
        return len(self.muscle_names)

    @classmethod
    def load(cls, source: str | Path | Any) -> MuscleModel:
        """Load a model and check that its muscles can be driven.

        Args:
            source: a shipped name (``"leg8"``), a path to an MJCF (``.xml``) or compiled (``.mjb``) file, a
                ``mujoco.MjSpec`` or a ``mujoco.MjModel``. What is handed in is never changed.

        Returns:
            The model, stepped by RK4; a model that names another integrator gives an `MjhcmcWarning`.

        Raises:
            ModelError: the file cannot be read, or the model has no muscle, has something that the methods cannot
                follow (ball or free joints, equality constraints), or clamps that break a muscle's affinity.
        """
        if isinstance(source, cls):
            return source
        m, name = _compile(source)
        _check_joints(m, name)
        muscles = _muscles(m, name)
        for i in muscles:
            _check_muscle(m, name, int(i))
        if m.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4:
            found = mujoco.mjtIntegrator(m.opt.integrator).name.removeprefix("mjINT_")
            warnings.warn(
                f"model {name!r} names the integrator {found}; mjhcmc steps a copy of it by RK4",
                MjhcmcWarning,
                stacklevel=2,
            )
            m.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        # a diverging simulation must be seen, not silently reset to the reference pose
        m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        # mj_inverse is meant in continuous time; with RK4 the discrete flag is an error in MuJoCo
        m.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
        ctrl = m.actuator_ctrladr[muscles].astype(np.intp)
        limited = m.actuator_ctrllimited[muscles].astype(bool)[:, None]
        urange = np.where(limited, m.actuator_ctrlrange[muscles], [[0.0, 1.0]])
        return cls(
            name=name,
            mj_model=m,
            joint_names=_names(m, mujoco.mjtObj.mjOBJ_JOINT, range(m.njnt), "joint"),
            joint_is_rotation=m.jnt_type == mujoco.mjtJoint.mjJNT_HINGE,
            joint_range=np.where(m.jnt_limited.astype(bool)[:, None], m.jnt_range, [[-np.inf, np.inf]]),
            qpos_reference=m.qpos0.copy(),
            column_map=_column_map(m, name),
            muscle_names=_names(m, mujoco.mjtObj.mjOBJ_ACTUATOR, muscles, "muscle"),
            muscle_ids=muscles,
            ctrl_index=ctrl,
            act_index=m.actuator_actadr[muscles].astype(np.intp),
            activation_parameters=np.ascontiguousarray(m.actuator_dynprm[muscles, :3]),
            excitation_range=np.ascontiguousarray(np.clip(urange, 0.0, 1.0)),
        )


def _compile(source: Any) -> tuple[Any, str]:
    """A private MjModel and its name, from whatever the user handed in."""
    if isinstance(source, mujoco.MjModel):
        return copy.deepcopy(source), _model_name(source) or "model"
    if isinstance(source, mujoco.MjSpec):
        try:
            m = source.compile()
        except ValueError as error:
            raise ModelError(f"the MjSpec does not compile: {_one_line(error)}") from error
        return copy.deepcopy(m), _model_name(m) or "model"
    if not isinstance(source, (str, Path)):
        raise ModelError(f"a model is a name, a path, an MjSpec or an MjModel; got {type(source).__name__}")
    path = Path(source)
    shipped = model_path(str(source)) if path.suffix == "" and path.parent == Path() else None
    path = shipped or path
    try:
        found = path.is_file()
    except OSError:  # a name too long for the file system
        found = False
    if not found:
        raise ModelError(
            f"no model {str(source)!r}: give a path to an MJCF file or one of the shipped models "
            f"({', '.join(model_names())})"
        )
    try:
        if path.suffix.lower() == ".mjb":
            m = mujoco.MjModel.from_binary_path(str(path))
        else:
            m = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"{path}: MuJoCo cannot load it: {_one_line(error)}") from error
    return m, _model_name(m) or path.stem


def _one_line(error: Exception) -> str:
    return "; ".join(line.strip() for line in str(error).splitlines() if line.strip()) or type(error).__name__


def _model_name(m: Any) -> str:
    name = m.names[: m.names.index(b"\0")].decode()
    return "" if name == "MuJoCo Model" else name


def _names(m: Any, kind: Any, ids: Any, fallback: str) -> tuple[str, ...]:
    """Names in the order of ids; one without a name is called by its kind and number, such as joint3."""
    given = [mujoco.mj_id2name(m, kind, int(i)) for i in ids]
    names = []
    for i, name in zip(ids, given, strict=True):
        own = name or f"{fallback}{int(i)}"
        while not name and own in given:  # another has that very name
            own += "_"
        names.append(own)
    return tuple(names)


def _check_joints(m: Any, name: str) -> None:
    for j in range(m.njnt):
        kind = mujoco.mjtJoint(m.jnt_type[j])
        if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            joint = _names(m, mujoco.mjtObj.mjOBJ_JOINT, [j], "joint")[0]
            raise ModelError(
                f"model {name!r}: joint {joint!r} is of type {kind.name.removeprefix('mjJNT_').lower()}; only hinge "
                "and slide joints can be followed: replace it by hinges, or fix that body"
            )
    active = [e for e in range(m.neq) if m.eq_active0[e]]
    if active:
        equality = _names(m, mujoco.mjtObj.mjOBJ_EQUALITY, active, "equality")
        raise ModelError(
            f"model {name!r}: equality constraint {equality[0]!r} couples its joints, which is not supported: remove "
            f'it or set active="false" ({len(active)} active)'
        )


def _muscles(m: Any, name: str) -> NDArray[np.intp]:
    found = np.flatnonzero(m.actuator_dyntype == mujoco.mjtDyn.mjDYN_MUSCLE)
    if not found.size:
        raise ModelError(
            f"model {name!r} has no muscle among its {m.nactuator} actuators: add <muscle> actuators to it"
        )
    return found.astype(np.intp)


def _check_muscle(m: Any, name: str, i: int) -> None:
    """Refuse what would make the muscle's force other than gain * activation + bias."""
    muscle = _names(m, mujoco.mjtObj.mjOBJ_ACTUATOR, [i], "muscle")[0]

    def refuse(found: str, remedy: str) -> ModelError:
        return ModelError(f"model {name!r}: muscle {muscle!r} {found}: {remedy}")

    gain, bias = mujoco.mjtGain, mujoco.mjtBias
    plain_gain = {int(kind) for kind in (gain.mjGAIN_FIXED, gain.mjGAIN_AFFINE, gain.mjGAIN_MUSCLE)}
    plain_bias = {int(kind) for kind in (bias.mjBIAS_NONE, bias.mjBIAS_AFFINE, bias.mjBIAS_MUSCLE)}
    if int(m.actuator_gaintype[i]) not in plain_gain or int(m.actuator_biastype[i]) not in plain_bias:
        raise refuse("has a user-defined gain or bias", "use gaintype and biastype muscle")
    if m.actuator_forcelimited[i]:
        raise refuse(
            f"is clamped by forcerange {_range(m.actuator_forcerange[i])}, so its force is not affine in activation",
            "remove forcerange",
        )
    if m.actuator_actlimited[i] and not (m.actuator_actrange[i, 0] <= 0 and m.actuator_actrange[i, 1] >= 1):
        raise refuse(f"has actrange {_range(m.actuator_actrange[i])}, narrower than 0..1", "remove actrange")
    if m.actuator_actearly[i]:
        raise refuse("has actearly, so its force depends on excitation", "remove actearly")
    if m.actuator_delay[i] > 0:
        raise refuse(f"has a delay of {m.actuator_delay[i]:g} s", "remove delay")
    low, high = m.actuator_ctrlrange[i]
    if m.actuator_ctrllimited[i] and not max(low, 0) < min(high, 1):
        raise refuse(f"has ctrlrange {_range((low, high))}, which leaves nothing of 0..1", "set ctrlrange to 0 1")
    off = m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    if off or (0 <= m.actuator_group[i] < 31 and m.opt.disableactuator & (1 << int(m.actuator_group[i]))):
        raise refuse("is disabled by the model's options", "enable actuation and its actuator group")
    kind, target = m.actuator_trntype[i], int(m.actuator_trnid[i, 0])
    if kind == mujoco.mjtTrn.mjTRN_TENDON and m.tendon_actfrclimited[target]:
        tendon = _names(m, mujoco.mjtObj.mjOBJ_TENDON, [target], "tendon")[0]
        raise refuse(f"pulls tendon {tendon!r}, whose force is clamped by actuatorfrcrange", "remove it")
    if m.jnt_actfrclimited.any():
        joint = _names(m, mujoco.mjtObj.mjOBJ_JOINT, [int(np.argmax(m.jnt_actfrclimited))], "joint")[0]
        raise ModelError(
            f"model {name!r}: the muscles' moment at joint {joint!r} is clamped by actuatorfrcrange, so it is not "
            "affine in activation: remove actuatorfrcrange"
        )


def _range(values: Any) -> str:
    return f"{values[0]:g}..{values[1]:g}"


def _column_map(m: Any, name: str) -> dict[str, str]:
    text = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_TEXT, COLUMN_MAP_TEXT)
    if text < 0:
        return {}
    start, size = int(m.text_adr[text]), int(m.text_size[text])
    pairs = bytes(m.text_data[start : start + size - 1]).decode().split()
    joints = _names(m, mujoco.mjtObj.mjOBJ_JOINT, range(m.njnt), "joint")
    result = {}
    for pair in pairs:
        joint, found, column = pair.partition("=")
        if not found or joint not in joints or not column.lstrip("-"):
            raise ModelError(
                f"model {name!r}: custom text {COLUMN_MAP_TEXT!r} holds {pair!r}; write joint=column with joints "
                f"{', '.join(joints)}"
            )
        result[joint] = column
    return result

"""MuscleModel: a MuJoCo model seen as muscles that move joints, checked when it is loaded."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.assets import model_names, model_path
from mjhcmc.coordinates import Coordinates
from mjhcmc.coupling import Coupling
from mjhcmc.errors import MjhcmcWarning, ModelError, MotionError
from mjhcmc.integrators import scheme_of
from mjhcmc.log import get_logger
from mjhcmc.model_problems import (
    coordinate_names_of,
    dof_is_rotation_of,
    dof_names_of,
    find_problems,
    joint_names_of,
    muscle_ids_of,
    names_of,
    read_column_map,
)
from mjhcmc.opensim_names import OpenSimNames, read_opensim_names
from mjhcmc.roles import Role, Roles, find_roles, roles_by_name
from mjhcmc.surroundings import coordinates_of

__all__ = ["MuscleModel", "compile_model", "engine_integrator", "read_model"]

_log = get_logger(__name__)

SOLVER_TOLERANCE = 1e-13
"""Of the constraint solver; MuJoCo's own 1e-8 leaves .1 N m of noise at a toe."""


@dataclass(frozen=True)
class MuscleModel:
    """A MuJoCo model with muscles, ready for the methods.

    Build it with `MuscleModel.load`. The methods need muscle force to be affine in activation (up to a forcerange); a
    model that breaks this is refused with the name of what breaks it.

    Attributes:
        name: the model's name.
        mj_model: the compiled model (a private copy; its integrator is RK4, whatever the plant's, see `integrators`).
        joint_names: (nq,) names of the coordinates, in the order of qpos: a hinge or slide has its joint's name, a ball
            JOINT_qw, _qx, _qy, _qz (a unit quaternion), a free joint JOINT_tx, _ty, _tz before those.
        joint_is_rotation: (nq,) True for hinges (rad), False for slides (m) and parts of quaternions.
        joint_range: (nq, 2) rad or m, -inf and inf where a coordinate is not limited.
        qpos_reference: (nq,) the reference pose, rad or m: the model's qpos0, with what equality constraints tie to
            other joints where they put it.
        dof_names: (nv,) names of the degrees of freedom, in the order of qvel: a hinge or slide has its joint's name, a
            ball JOINT_rx, _ry, _rz, a free joint JOINT_tx, _ty, _tz before those.
        dof_is_rotation: (nv,) True for rad, False for m.
        roles: what each degree of freedom is to a solve.
        column_map: file column by joint name, where the model ships one; a leading ``-`` flips the sign.
        muscle_names: (n_muscle,) in the order of the actuators.
        muscle_ids: (n_muscle,) actuator index of each muscle.
        ctrl_index: (n_muscle,) index of each muscle's excitation in ``MjData.ctrl``.
        act_index: (n_muscle,) index of each muscle's activation in ``MjData.act``.
        activation_parameters: (n_muscle, 3) s, s, 1: activation and deactivation time constant, smoothing width.
        excitation_range: (n_muscle, 2) the excitations that the model lets through, within [0, 1].
        opensim: what OpenSim calls the joints and muscles, where the model ships it.
    """

    name: str
    mj_model: Any
    joint_names: tuple[str, ...]
    joint_is_rotation: NDArray[np.bool_]
    joint_range: NDArray[np.float64]
    qpos_reference: NDArray[np.float64]
    dof_names: tuple[str, ...]
    dof_is_rotation: NDArray[np.bool_]
    roles: Roles
    column_map: dict[str, str]
    muscle_names: tuple[str, ...]
    muscle_ids: NDArray[np.intp]
    ctrl_index: NDArray[np.intp]
    act_index: NDArray[np.intp]
    activation_parameters: NDArray[np.float64]
    excitation_range: NDArray[np.float64]
    opensim: OpenSimNames = field(default_factory=OpenSimNames)

    @cached_property
    def coordinates(self) -> Coordinates:
        """Differences of positions, and what is seen from the tracked degrees of freedom."""
        return Coordinates(self.mj_model, self.roles)

    @cached_property
    def coupling(self) -> Coupling | None:
        """The equality constraints; None where nothing is dependent."""
        return Coupling(self.mj_model, self.roles) if len(self.roles.dependent) else None

    @cached_property
    def quaternions(self) -> tuple[int, ...]:
        """Where in qpos the quaternions of ball and free joints begin."""
        m = self.mj_model
        kinds = {int(mujoco.mjtJoint.mjJNT_BALL): 0, int(mujoco.mjtJoint.mjJNT_FREE): 3}
        return tuple(
            int(at) + kinds[int(kind)] for at, kind in zip(m.jnt_qposadr, m.jnt_type, strict=True) if int(kind) in kinds
        )

    @cached_property
    def may_be_silent(self) -> dict[str, bool]:
        """Coordinates that a motion file need not name, True where nothing is lost by it.

        Those that are not tracked follow, or stay at the reference pose without a word. Tracked ones stay there, with
        a notice, but for those that the model's own column map names: a file for this model has them.
        """
        tracked = set(coordinates_of(self.mj_model, self.roles.tracked).tolist())
        return {
            name: i not in tracked
            for i, name in enumerate(self.joint_names)
            if i not in tracked or name not in self.column_map
        }

    def with_roles(
        self, *, tracked: Iterable[str] = (), prescribed: Iterable[str] = (), free: Iterable[str] = ()
    ) -> MuscleModel:
        """The same model with other roles for some of its joints.

        Args:
            tracked: names of joints, or of the degrees of freedom of ball and free joints, that muscles (and reserves)
                are to move along the motion; at the root, reserves are residuals.
            prescribed: that are moved along the motion whatever it takes.
            free: that nothing leads.

        Raises:
            SettingsError: an unknown name, a name twice, or one that an equality constraint ties to others.
        """
        asked = {Role.TRACKED: tracked, Role.PRESCRIBED: prescribed, Role.FREE: free}
        roles = roles_by_name(self.roles, dofs_by_name(self), self.name, asked)
        return replace(self, roles=roles)

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

    @property
    def max_isometric_force(self) -> NDArray[np.float64]:
        """(n_muscle,) N, F0 of MuJoCo's muscles before any gear, without pennation; NaN for affine and user gains.

        Where ``force`` is left out, MuJoCo takes ``scale`` over the acceleration that a unit force gives. Of a fixed
        gain it is the magnitude, the force at full activation.
        """
        m, i = self.mj_model, self.muscle_ids
        force, scale = m.actuator_gainprm[i, 2], m.actuator_gainprm[i, 3]
        F0 = self._if_muscle_gain(np.where(force < 0, scale / np.maximum(mujoco.mjMINVAL, m.actuator_acc0[i]), force))
        is_fixed = m.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED
        return np.where(is_fixed, np.abs(m.actuator_gainprm[i, 0]), F0)

    @property
    def optimal_fiber_length(self) -> NDArray[np.float64]:
        """(n_muscle,) m, L0 of MuJoCo's muscles, along the tendon and times any gear; NaN for other gains."""
        m, i = self.mj_model, self.muscle_ids
        with np.errstate(divide="ignore", invalid="ignore"):  # other gains have no such range
            length = np.ptp(m.actuator_lengthrange[i], axis=1) / np.ptp(m.actuator_gainprm[i, :2], axis=1)
        return self._if_muscle_gain(length)

    @cached_property
    def force_limit(self) -> NDArray[np.float64]:
        """(n_muscle,) N, what a forcerange lets each muscle pull with (before any gear); inf where there is none."""
        m, i = self.mj_model, self.muscle_ids
        return np.where(m.actuator_forcelimited[i].astype(bool), -m.actuator_forcerange[i, 0], np.inf)

    @cached_property
    def path_gear(self) -> NDArray[np.float64]:
        """(n_muscle,) force along the path for a unit of actuator force: the gear at tendons, 1 elsewhere."""
        m, ids = self.mj_model, self.muscle_ids
        return np.where(m.actuator_trntype[ids] == mujoco.mjtTrn.mjTRN_TENDON, m.actuator_gear[ids, 0], 1.0)

    @cached_property
    def own_tendons(self) -> NDArray[np.intp]:
        """(n_muscle,) the tendon that a muscle alone pulls, or -1."""
        m, ids = self.mj_model, self.muscle_ids
        on_tendon = m.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
        used = np.bincount(m.actuator_trnid[on_tendon, 0], minlength=max(1, m.ntendon))
        tendon = np.where(on_tendon[ids], m.actuator_trnid[ids, 0], -1)
        return np.where((tendon >= 0) & (used[tendon] == 1), tendon, -1)

    def _if_muscle_gain(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        is_muscle = self.mj_model.actuator_gaintype[self.muscle_ids] == mujoco.mjtGain.mjGAIN_MUSCLE
        return np.where(is_muscle, values, np.nan)

    @classmethod
    def load(cls, source: str | Path | Any, *, integrator: str | None = None) -> MuscleModel:
        """Load a model and check that its muscles can be driven.

        Args:
            source: a shipped name (``"leg8"``), a path to an MJCF (``.xml``) or compiled (``.mjb``) file, a
                ``mujoco.MjSpec`` or a ``mujoco.MjModel``. What is handed in is never changed.
            integrator: that the methods will be told, where it is chosen already: then nothing is said of the model's.
                It is not kept: the methods take it as their own argument.

        Returns:
            The model, stepped by RK4 unless a method is told otherwise (``integrator``); a model that MuJoCo steps by
            another integrator gives an `MjhcmcWarning`.

        Raises:
            ModelError: the file cannot be read, or the model has no muscle, or something that the methods cannot follow
                (such as actuators with a state of their own, or clamped joint moments).
            SettingsError: there is no such integrator.
        """
        if integrator is not None:
            scheme_of(integrator)
        if isinstance(source, cls):
            return source
        m, name = compile_model(source)
        problems = find_problems(m, name)
        if problems:
            more = f" (and {len(problems) - 1} more: mjhcmc check MODEL lists them)" if len(problems) > 1 else ""
            raise ModelError(problems[0].message(name) + more)
        if m.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4 and integrator is None:
            warnings.warn(
                f"model {name!r}: MuJoCo would step it by {engine_integrator_words(m)}; mjhcmc steps a copy of it by "
                f"RK4 unless told otherwise: solve with integrator={engine_integrator(m).lower()!r} for MuJoCo's way",
                MjhcmcWarning,
                stacklevel=2,
            )
        model = read_model(m, name)
        _log.info("model %r loaded: %d muscles, joints %s", name, model.n_muscle, ", ".join(model.joint_names))
        _log.debug("muscles of model %r: %s", name, ", ".join(model.muscle_names))
        return model


def read_model(m: Any, name: str) -> MuscleModel:
    """A MuscleModel of a compiled model, which becomes its own and is set to RK4. Nothing is checked.

    `MuscleModel.load` is for users; this is for those who report on models that it refuses. Custom texts that cannot be
    understood are left out.
    """
    m.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    # a diverging simulation must be seen, not silently reset to the reference pose
    m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    # what the constraint solver leaves is noise in the accelerations of light joints; its last steps cost little
    m.opt.tolerance = min(m.opt.tolerance, SOLVER_TOLERANCE)
    # mj_inverse is meant in continuous time; with RK4 the discrete flag is an error in MuJoCo
    m.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    muscles = muscle_ids_of(m)
    limited = m.actuator_ctrllimited[muscles].astype(bool)[:, None]
    urange = np.where(limited, m.actuator_ctrlrange[muscles], [[0.0, 1.0]])
    joint_names = joint_names_of(m)
    muscle_names = names_of(m, mujoco.mjtObj.mjOBJ_ACTUATOR, muscles, "muscle")
    coordinates = coordinate_names_of(m)
    hinge = np.array([kind == "hinge" for _, kind in coordinates], dtype=bool)
    spread = np.full((m.nq, 2), [-np.inf, np.inf])
    flat = np.isin(m.jnt_type, [int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)])
    limited_joints = np.flatnonzero(flat & m.jnt_limited.astype(bool))
    spread[m.jnt_qposadr[limited_joints]] = m.jnt_range[limited_joints]
    roles = find_roles(m, muscles)
    reference = m.qpos0.copy()
    if len(roles.dependent):
        with suppress(MotionError):  # equalities that contradict each other there: a motion may still keep to them
            reference = Coupling(m, roles).project(reference)
    column_map: dict[str, str] = {}
    opensim = OpenSimNames()
    with suppress(ModelError):  # `find_problems` tells
        column_map = read_column_map(m, name)
    with suppress(ModelError):
        opensim = read_opensim_names(m, name, joint_names, muscle_names)
    return MuscleModel(
        name=name,
        mj_model=m,
        joint_names=tuple(name for name, _ in coordinates),
        joint_is_rotation=hinge,
        joint_range=spread,
        qpos_reference=reference,
        dof_names=dof_names_of(m),
        dof_is_rotation=dof_is_rotation_of(m),
        roles=roles,
        column_map=column_map,
        muscle_names=muscle_names,
        muscle_ids=muscles,
        ctrl_index=m.actuator_ctrladr[muscles].astype(np.intp),
        act_index=m.actuator_actadr[muscles].astype(np.intp),
        activation_parameters=np.ascontiguousarray(m.actuator_dynprm[muscles, :3]),
        excitation_range=np.ascontiguousarray(np.clip(urange, 0.0, 1.0)),
        opensim=opensim,
    )


def never_touches(m: Any) -> bool:
    """Whether no two geoms of a compiled model can ever be in contact."""
    return m.npair == 0 and m.nflex == 0 and not (m.geom_contype.any() and m.geom_conaffinity.any())


def unclamped(m: Any, model: MuscleModel) -> Any:
    """A compiled model without the forceranges of its muscles: itself where there are none, else a copy."""
    if not np.isfinite(model.force_limit).any():
        return m
    m = copy.copy(m)
    m.actuator_forcelimited[model.muscle_ids] = 0
    return m


def dofs_by_name(model: MuscleModel) -> dict[str, NDArray[np.intp]]:
    """Degrees of freedom by the name of a joint; of ball and free joints also by those of their degrees of freedom.

    The degrees of freedom of a ball or free joint go together.
    """
    m, found = model.mj_model, {}
    for j, name in enumerate(joint_names_of(m)):
        first = int(m.jnt_dofadr[j])
        last = int(m.jnt_dofadr[j + 1]) if j + 1 < m.njnt else m.nv
        dofs = np.arange(first, last)
        found[name] = dofs
        found.update({model.dof_names[i]: dofs for i in dofs})
    return found


def engine_integrator(m: Any) -> str:
    """The integrator that a compiled model names, such as ``RK4``."""
    return str(mujoco.mjtIntegrator(m.opt.integrator).name.removeprefix("mjINT_"))


def engine_integrator_words(m: Any) -> str:
    """What a compiled model is stepped by in MuJoCo, as messages say it: it cannot tell a default from a choice."""
    name = engine_integrator(m)
    return "Euler, its default or the model's choice" if name == "EULER" else f"{name.lower()}, as the model says"


def compile_model(source: str | Path | Any) -> tuple[Any, str]:
    """A private MjModel with at least one muscle, and its name, from whatever `MuscleModel.load` takes.

    Raises:
        ModelError: MuJoCo cannot load it, or it has no muscle.
    """
    m, name = _compile(source)
    if not muscle_ids_of(m).size:
        raise ModelError(
            f"model {name!r} has no muscle among its {m.nactuator} actuators: add <muscle> actuators to it"
        )
    return m, name


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

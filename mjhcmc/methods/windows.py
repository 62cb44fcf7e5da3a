"""The control windows of a solve, common to all methods: their times, the desired motion, the start, the record."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc import dynamics
from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError, SimulationError
from mjhcmc.model import MuscleModel
from mjhcmc.motion import RANGE_ALLOWANCE, Motion, Reference, check_joint_range
from mjhcmc.plant import RK4_LIMIT, MujocoPlant, State, physics_steps
from mjhcmc.solution import Solution, window_status

_MODES_CHECKED = 50
_MARGIN = 0.8  # active muscles damp too
_MOST_STEPS = 10**8  # days of work, gigabytes of record

Progress = Callable[[int, int], None]
"""Called with (windows solved, windows in all)."""


class SolveInterrupted(KeyboardInterrupt):
    """The solve was interrupted; `solution` holds what was solved, marked interrupted (None: nothing yet)."""

    def __init__(self, solution: Solution | None) -> None:
        super().__init__("the solve was interrupted")
        self.solution = solution


@dataclass(frozen=True)
class Windows:
    """What every method starts from.

    Attributes:
        model: the model.
        plant: what is stepped.
        motion_name: for the record.
        reference: the desired motion at the N + 1 nodes.
        dt: s, length of a control window.
        n_step: physics steps in a window.
        start: the plant's state at the first node; its activation is NaN where it is to be solved for.
    """

    model: MuscleModel
    plant: MujocoPlant
    motion_name: str
    reference: Reference
    dt: float
    n_step: int
    start: State

    @property
    def count(self) -> int:
        """Number of windows, N."""
        return len(self.reference.time) - 1


def prepare(
    model: MuscleModel,
    motion: Motion,
    dt: float,
    physics_dt: float,
    initial_qpos: ArrayLike | None = None,
    initial_qvel: ArrayLike | None = None,
    initial_activation: ArrayLike | None = None,
    plant: MujocoPlant | None = None,
) -> Windows:
    """Check the settings of a solve and lay out its windows.

    Args:
        model: the model.
        motion: the motion to follow, rad or m.
        dt: s, control window.
        physics_dt: s, largest physics step; rounded down to a divisor of dt.
        initial_qpos: (nq,) rad or m; the motion's by default.
        initial_qvel: (nv,) rad/s or m/s; the motion's by default.
        initial_activation: (n_muscle,) or one number; NaN, to be solved for, by default.
        plant: what is stepped; a `MujocoPlant` at physics_dt by default. It keeps its own physics step.

    Raises:
        SettingsError: a setting outside its valid values.
        MotionError: a motion of other joints, or outside the joints' range.
        SimulationError: a physics step at which the model's passive damping is unstable.
    """
    if not isinstance(model, MuscleModel) or not isinstance(motion, Motion):
        raise SettingsError(
            f"a method takes a MuscleModel and a Motion; got {type(model).__name__} and {type(motion).__name__}: use "
            "MuscleModel.load and Motion.from_file"
        )
    for name, value in (("dt", dt), ("physics_dt", physics_dt)):
        if not (isinstance(value, (int, float, np.floating)) and math.isfinite(value) and value > 0):
            raise SettingsError(f"{name} must be a positive number of seconds; got {value}")
    if motion.qpos.shape[1] != model.nq:
        raise MotionError(
            f"motion {motion.name!r} has {motion.qpos.shape[1]} joints, model {model.name!r} has {model.nq} "
            f"({', '.join(model.joint_names)}): build the motion for this model"
        )
    count = math.floor(motion.duration / dt + 1e-6)
    if count * physics_steps(dt, physics_dt) > _MOST_STEPS:
        raise SettingsError(
            f"dt {dt:g} s and physics_dt {physics_dt:g} s cut the motion ({motion.duration:g} s) into more than "
            f"{_MOST_STEPS:.0e} steps: choose larger ones"
        )
    if count < 1:
        raise SettingsError(f"dt {dt:g} s is longer than the motion ({motion.duration:g} s): choose a smaller dt")
    lost = motion.duration - count * dt
    if lost > 1e-6 * dt:
        warnings.warn(
            f"dt {dt:g} s does not divide the motion ({motion.duration:g} s): the last {lost:.4g} s are dropped",
            MjhcmcWarning,
            stacklevel=3,
        )
    times = np.minimum(motion.start + dt * np.arange(count + 1), motion.end)
    reference = motion.sample(times)
    _check_range(motion, model, reference.time, reference.qpos, f"motion {motion.name!r}")
    n_step = physics_steps(dt, physics_dt)
    if plant is None:
        plant = MujocoPlant(model, dt / n_step)
    else:
        n_step = physics_steps(dt, plant.physics_dt)
        if abs(n_step * plant.physics_dt - dt) > 1e-9 * dt:
            raise SettingsError(
                f"the plant's step {plant.physics_dt:g} s does not divide dt {dt:g} s: build it with dt/{n_step}"
            )
    qpos = _vector("initial_qpos", initial_qpos, reference.qpos[0])
    qvel = _vector("initial_qvel", initial_qvel, reference.qvel[0])
    _check_range(motion, model, times[:1], qpos[None], "initial_qpos")
    activation = _vector("initial_activation", initial_activation, np.full(model.n_muscle, np.nan))
    if initial_activation is not None and (np.any(activation < 0) or np.any(activation > 1)):
        raise SettingsError("initial_activation must lie within 0..1")
    start = State(float(times[0]), qpos, qvel, activation, np.zeros(model.nv))
    windows = Windows(model, plant, motion.name, reference, dt, n_step, start)
    _check_passive_stability(windows)
    return windows


def _check_range(
    motion: Motion, model: MuscleModel, time: NDArray[np.float64], qpos: NDArray[np.float64], what: str
) -> None:
    remedy = "check units and signs, or widen the model's range"
    check_joint_range(motion, model, time, qpos, what, RANGE_ALLOWANCE, remedy)


def _vector(name: str, given: ArrayLike | None, default: NDArray[np.float64]) -> NDArray[np.float64]:
    if given is None:
        return default.copy()
    try:
        value = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise SettingsError(f"{name} must hold {default.size} numbers; got {given!r}") from None
    if value.ndim == 0:
        value = np.full(default.shape, float(value))
    if value.shape != default.shape:
        raise SettingsError(f"{name} must hold {default.size} numbers; got shape {value.shape}")
    if not np.isfinite(value).all():
        raise SettingsError(f"{name} must hold finite numbers; got {value.tolist()}")
    return value


def decay_rate(M: NDArray[np.float64], D: NDArray[np.float64]) -> float:
    """Fastest decay of the velocities, 1/s: the largest real eigenvalue part of M^-1 D."""
    return float(np.linalg.eigvals(np.linalg.solve(M, D)).real.max(initial=0.0))


def _check_passive_stability(windows: Windows) -> None:
    """Refuse a physics step at which the model's passive damping alone would blow up."""
    plant, reference = windows.plant, windows.reference
    rest = np.zeros(windows.model.n_muscle)
    worst, at = 0.0, 0
    for k in range(0, len(reference.time), max(1, len(reference.time) // _MODES_CHECKED)):
        plant.set_state(State(0.0, reference.qpos[k], np.zeros(windows.model.nv), rest, np.zeros(windows.model.nv)))
        plant.forward()
        M = dynamics.mass_matrix(plant)
        D, _ = dynamics.damping_and_stiffness(plant)
        rate = decay_rate(M, D)
        if rate > worst:
            worst, at = rate, k
    if worst * plant.physics_dt > RK4_LIMIT:
        raise SimulationError(
            f"model {windows.model.name!r}: physics_dt {plant.physics_dt:g} s is unstable under its damping "
            f"({worst:.0f} /s at {reference.time[at]:.3g} s): use physics_dt <= {_MARGIN * RK4_LIMIT / worst:.2g}"
        )


@dataclass
class Record:
    """What a method writes down as it goes: its settings, the state at each node, the inputs of each window."""

    windows: Windows
    settings: dict[str, Any]
    states: list[State]
    excitation: list[NDArray[np.float64]] = field(default_factory=list)
    reserve: list[NDArray[np.float64]] = field(default_factory=list)
    shortfall: list[NDArray[np.float64]] = field(default_factory=list)
    fastest_rate: list[float] = field(default_factory=list)

    def window(
        self,
        excitation: NDArray[np.float64],
        reserve: NDArray[np.float64],
        shortfall: NDArray[np.float64],
        fastest_rate: float,
        end: State,
    ) -> None:
        """Write down one window and the state at its end.

        Raises:
            SimulationError: the state is not finite.
        """
        for name, values, labels in (
            ("position", end.qpos, self.windows.model.joint_names),
            ("velocity", end.qvel, self.windows.model.dof_names),
            ("activation", end.activation, self.windows.model.muscle_names),
        ):
            if not np.isfinite(values).all():
                label = labels[int(np.argmin(np.isfinite(values)))]
                raise SimulationError(
                    f"the {name} of {label!r} is not finite at {end.time:.4g} s: the simulation diverged; use a "
                    "smaller physics_dt, or filter the motion"
                )
        self.excitation.append(excitation)
        self.reserve.append(reserve)
        self.shortfall.append(shortfall)
        self.fastest_rate.append(fastest_rate)
        self.states.append(end)

    @property
    def count(self) -> int:
        """Windows written down whole: the state at the end comes last, also when an interrupt falls between."""
        return len(self.states) - 1

    def solution(self, *, interrupted: bool = False) -> Solution:
        """Everything that follows from the record; one pass over the nodes."""
        windows, model, plant = self.windows, self.windows.model, self.windows.plant
        n = self.count
        reserve, shortfall = np.array(self.reserve[:n]), np.array(self.shortfall[:n])
        force, moment = np.empty((n + 1, model.n_muscle)), np.empty((n + 1, model.nv))
        for k, state in enumerate(self.states):
            plant.set_state(state)
            plant.set_input(None, reserve[min(k, n - 1)])
            plant.forward()
            force[k] = dynamics.node_forces(plant).muscle_force
            moment[k] = dynamics.net_joint_moment(plant)
        qpos = np.array([state.qpos for state in self.states])
        desired = windows.reference.qpos[: n + 1]
        everything = {
            "model": model.name,
            "motion": windows.motion_name,
            "dt": windows.dt,
            "physics_dt": plant.physics_dt,
            **self.settings,
        }
        return Solution(
            time=windows.reference.time[: n + 1].copy(),
            excitation=np.array(self.excitation[:n]),
            activation=np.array([state.activation for state in self.states]),
            qpos=qpos,
            qpos_desired=desired.copy(),
            qvel=np.array([state.qvel for state in self.states]),
            tracking_error=qpos - desired,
            net_joint_moment=moment,
            muscle_force=force,
            reserve=reserve,
            shortfall=shortfall,
            status=window_status(moment, reserve, shortfall, np.array(self.fastest_rate[:n]) * plant.physics_dt),
            muscle_names=model.muscle_names,
            dof_names=model.dof_names,
            dof_is_rotation=model.joint_is_rotation.copy(),
            settings=everything,
            interrupted=interrupted,
            model=model,
        )

"""Running a method: window after window on the plant, with a record of what was done and of what came of it."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mjhcmc import dynamics
from mjhcmc.errors import DivergedError, MjhcmcWarning, SimulationError
from mjhcmc.log import get_logger
from mjhcmc.methods.windows import Windows, decay_rate
from mjhcmc.plant import RK4_LIMIT, MujocoPlant, State
from mjhcmc.sharing import Sharing
from mjhcmc.solution import Solution, window_status

_FINER_TRIES = 2  # a simulation that diverges is solved again with a quarter of the step, and a sixteenth

Progress = Callable[[int, int], None]
"""Called with (windows solved, windows in all)."""

_log = get_logger(__name__)


class SolveInterrupted(KeyboardInterrupt):
    """The solve was interrupted; `solution` holds what was solved, marked interrupted (None: nothing yet)."""

    def __init__(self, solution: Solution | None) -> None:
        super().__init__("the solve was interrupted")
        self.solution = solution


@dataclass(frozen=True)
class Inputs:
    """What one window is driven with.

    Attributes:
        excitation: (n_muscle,).
        reserve: (nv,) N m, applied.
        shortfall: (nv,) N m, what the muscles cannot give at the window's end.
        fastest_rate: 1/s, decay rate of the velocities at one end of the window, or a bound on it that is harmless.
    """

    excitation: NDArray[np.float64]
    reserve: NDArray[np.float64]
    shortfall: NDArray[np.float64]
    fastest_rate: float


class Method(Protocol):
    """How one method chooses excitations."""

    def settings(self) -> dict[str, Any]:
        """The method's name, as ``method``, and its own settings, for the record."""

    def start(self, windows: Windows) -> tuple[State, Inputs]:
        """The first state, and inputs that stand for the window before the first."""

    def window(self, windows: Windows, k: int, state: State, before: Inputs) -> Inputs:
        """The inputs of window k, which begins in a state, after those of the window before."""


def run(method: Method, windows: Windows, progress: Progress | None, *, own_plant: bool) -> Solution:
    """Solve all windows.

    Args:
        method: what chooses the excitations.
        windows: see `windows.prepare`.
        progress: called after each window.
        own_plant: the plant is the user's, and keeps its step.

    Raises:
        SimulationError: the simulation diverged, also with a quarter and a sixteenth of the step (an `MjhcmcWarning`
            tells of each). Its ``solution`` holds what was solved before, marked interrupted.
        SolveInterrupted: a KeyboardInterrupt came; it carries what was solved.
    """
    began = time.perf_counter()
    settings = method.settings()
    _log.info("%s on %s, %s: %d windows", settings["method"], windows.model.name, windows.motion.name, windows.count)
    longest: Solution | None = None
    for tries_left in reversed(range(_FINER_TRIES + 1)):
        try:
            solution = _run(method, windows, progress)
        except DivergedError as error:
            if longest is None or (error.solution is not None and error.solution.n_window > longest.n_window):
                longest = error.solution
            error.solution = longest
            if own_plant or not tries_left:
                raise
            step = windows.plant.physics_dt / 4
            warnings.warn(f"{error}; it is solved again with physics_dt {step:.2g} s", MjhcmcWarning, stacklevel=3)
            finer = MujocoPlant(windows.model, step, windows.plant.external)
            windows = replace(windows, plant=finer, n_step=4 * windows.n_step)
        else:
            _log.info("%s: solved in %.3g s", settings["method"], time.perf_counter() - began)
            return solution
    raise AssertionError("unreachable")


def _run(method: Method, windows: Windows, progress: Progress | None) -> Solution:
    record = Record(windows, method.settings(), [])
    try:
        state, inputs = method.start(windows)
        record.states.append(state)
        for k in range(windows.count):
            inputs = method.window(windows, k, record.states[-1], inputs)
            windows.plant.set_state(record.states[-1])
            windows.plant.advance(inputs.excitation, inputs.reserve, windows.n_step)
            end = replace(windows.plant.get_state(), time=float(windows.reference.time[k + 1]))
            record.window(inputs, end)
            if progress is not None:
                progress(k + 1, windows.count)
        return record.solution()
    except SimulationError as error:
        error.solution = record.solution(interrupted=True) if record.count else None
        raise
    except KeyboardInterrupt as interrupt:
        partly = record.count < windows.count
        raise SolveInterrupted(record.solution(interrupted=partly) if record.count else None) from interrupt


def static_start(windows: Windows, sharing: Sharing, *, reserves: bool) -> tuple[State, Inputs]:
    """The first state, with the static allocation of the first desired acceleration where no activation was given.

    Returns:
        The state; and as inputs the excitation that holds its activation, with the reserve of that allocation.
    """
    plant, model, start = windows.plant, windows.model, windows.start
    given = np.isfinite(start.activation).all()
    plant.set_state(start if given else replace(start, activation=np.zeros(model.n_muscle)))
    plant.set_input(None, np.zeros(model.nv))
    plant.forward()
    moments = dynamics.muscle_moments(plant, damping=sharing.counts_forces)
    Q = dynamics.required_moment(plant, windows.reference.qacc[0], moments.p)
    low, high = model.excitation_range.T
    price = reserve_price(dynamics.mass_matrix(plant), reserves=reserves)
    found = sharing.allocate(sharing.problem(moments, Q, low, high, price, None))
    state = start if given else replace(start, activation=found.activation)
    inputs = Inputs(
        excitation=sharing.excitation(np.clip(state.activation, low, high)),
        reserve=found.reserve if reserves else np.zeros(model.nv),
        shortfall=found.reserve,
        fastest_rate=0.0,
    )
    return state, inputs


def rate_at(plant: MujocoPlant, state: State, reserve: NDArray[np.float64]) -> float:
    """Decay rate of the velocities at a state, 1/s, for methods that do not look at it anyway."""
    plant.set_state(state)
    plant.set_input(None, reserve)
    plant.forward()
    M = dynamics.mass_matrix(plant)
    D, _ = dynamics.damping_and_stiffness(plant)
    return decay_rate(M, D, RK4_LIMIT / plant.physics_dt)


def reserve_price(M: NDArray[np.float64], *, reserves: bool) -> NDArray[np.float64]:
    """(nv, nv) kg m^2, the inertia by which reserves are priced (see `allocation.build_problem`).

    Reserves that are applied are motors, one a joint: each is priced by what it is worth at its own joint, so that
    a joint whose muscles suffice needs none. Where nothing fills the gap the joints share it, and by Gauss's
    principle the shares are those that change the accelerations least; the leg comes back from a wrong start by it.
    """
    return np.diag(np.diag(M)) if reserves else M


@dataclass
class Record:
    """What a method writes down as it goes: its settings, the state at each node, the inputs of each window."""

    windows: Windows
    settings: dict[str, Any]
    states: list[State]
    inputs: list[Inputs] = field(default_factory=list)

    def window(self, inputs: Inputs, end: State) -> None:
        """Write down one window and the state at its end.

        Raises:
            DivergedError: the state is not finite.
        """
        for name, values, labels in (
            ("position", end.qpos, self.windows.model.joint_names),
            ("velocity", end.qvel, self.windows.model.dof_names),
            ("activation", end.activation, self.windows.model.muscle_names),
        ):
            if not np.isfinite(values).all():
                label = labels[int(np.argmin(np.isfinite(values)))]
                raise DivergedError(
                    f"the {name} of {label!r} is not finite at {end.time:.4g} s: the simulation diverged; use a "
                    "smaller physics_dt, or filter the motion"
                )
        self.inputs.append(inputs)
        self.states.append(end)

    @property
    def count(self) -> int:
        """Windows written down whole: the state at the end comes last, also when an interrupt falls between."""
        return max(0, len(self.states) - 1)

    def solution(self, *, interrupted: bool = False) -> Solution:
        """Everything that follows from the record; one pass over the nodes."""
        windows, model, plant = self.windows, self.windows.model, self.windows.plant
        n = self.count
        inputs = self.inputs[:n]
        reserve, shortfall = np.array([i.reserve for i in inputs]), np.array([i.shortfall for i in inputs])
        rate = np.array([i.fastest_rate for i in inputs])
        external = np.empty((n + 1, model.nv))
        force, moment = np.empty((n + 1, model.n_muscle)), np.empty((n + 1, model.nv))
        for k, state in enumerate(self.states):
            plant.set_state(state)
            plant.set_input(None, reserve[min(k, n - 1)])
            plant.forward()
            external[k] = plant.external_load()
            at_node = dynamics.node_forces(plant)
            force[k], moment[k] = at_node.muscle_force, at_node.net_joint_moment
        qpos = np.array([state.qpos for state in self.states])
        desired = windows.reference.qpos[: n + 1]
        given = windows.joint_moments
        everything = {
            "model": model.name,
            "motion": windows.motion.name,
            "joint_moments": None if given is None else given.name,
            "dt": windows.dt,
            "physics_dt": plant.physics_dt,
            **self.settings,
        }
        if given is not None:
            difference = np.abs(moment - given.sample(windows.reference.time[: n + 1])).max(axis=0)
            everything["joint_moment_difference"] = dict(zip(model.dof_names, difference.tolist(), strict=True))
        return Solution(
            time=windows.reference.time[: n + 1].copy(),
            excitation=np.array([i.excitation for i in inputs]),
            activation=np.array([state.activation for state in self.states]),
            qpos=qpos,
            qpos_desired=desired.copy(),
            qvel=np.array([state.qvel for state in self.states]),
            tracking_error=qpos - desired,
            net_joint_moment=moment,
            muscle_force=force,
            reserve=reserve,
            shortfall=shortfall,
            external_load=external,
            status=window_status(moment, reserve, shortfall, rate * plant.physics_dt),
            muscle_names=model.muscle_names,
            dof_names=model.dof_names,
            dof_is_rotation=model.joint_is_rotation.copy(),
            settings=everything,
            interrupted=interrupted,
            model=model,
            external=plant.external,
        )

"""Running a method: window after window, with a record of what was done and of what came of it.

One movement is a team of one: the same code drives many simulations in lock step (see `lockstep`).
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mjhcmc import dynamics
from mjhcmc.clamps import activation_cap
from mjhcmc.errors import DivergedError, MjhcmcWarning, SimulationError
from mjhcmc.lockstep import Lockstep, Plants
from mjhcmc.log import get_logger
from mjhcmc.methods.record import Record
from mjhcmc.methods.stability import decay_rate, explicit_damping
from mjhcmc.methods.windows import Windows
from mjhcmc.one_by_one import OneByOne
from mjhcmc.plant import State
from mjhcmc.solution import Solution

_FINER_TRIES = 2  # a simulation that diverges is solved again with a quarter of the step, and a sixteenth
_FINER = 4

Array = NDArray[np.float64]
Ids = NDArray[np.intp]

Progress = Callable[[int, int], None]
"""Called with (windows solved, windows in all)."""

_log = get_logger(__name__)


class SolveInterrupted(KeyboardInterrupt):
    """The solve was interrupted.

    Attributes:
        solutions: what was solved of each simulation, marked interrupted; None where there is nothing yet.
        solution: that of the first.
    """

    def __init__(self, solutions: Sequence[Solution | None]) -> None:
        super().__init__("the solve was interrupted")
        self.solutions = tuple(solutions)
        self.solution = self.solutions[0]


@dataclass(frozen=True)
class Inputs:
    """What one window of one simulation is driven with.

    Attributes:
        excitation: (n_muscle,).
        reserve: (nv,) N m, applied.
        shortfall: (nv,) N m, what the muscles cannot give at the window's end.
        fastest_rate: 1/s, decay rate of the velocities at one end of the window, or a bound on it that is harmless.

    Reserves and shortfalls of degrees of freedom that are not tracked are 0.
    """

    excitation: Array
    reserve: Array
    shortfall: Array
    fastest_rate: float


class Team:
    """Simulations that go through their windows together: all of one dt, one physics step, models of one structure.

    What a window is driven with stands in arrays with one row a simulation, as in `Inputs`; a method overwrites the
    rows of the simulations that it is called for.

    Args:
        windows: one a simulation.
        plants: what is stepped.
    """

    def __init__(self, windows: Sequence[Windows], plants: Plants) -> None:
        self.windows, self.plants = tuple(windows), plants
        first = windows[0]
        self.dt, self.n_step, self.physics_dt = first.dt, first.n_step, first.physics_dt
        self.count = np.array([w.count for w in windows])
        self._shortest, self._everyone = int(self.count.min()), np.arange(len(windows))
        self.errors: dict[int, SimulationError] = {}
        b, n, nv = len(windows), first.model.n_muscle, first.model.nv
        self.excitation = np.zeros((b, n))
        self.reserve, self.shortfall, self.fastest_rate = np.zeros((b, nv)), np.zeros((b, nv)), np.zeros(b)

    def put(self, i: int, inputs: Inputs) -> None:
        """The inputs of one simulation."""
        self.excitation[i], self.reserve[i] = inputs.excitation, inputs.reserve
        self.shortfall[i], self.fastest_rate[i] = inputs.shortfall, inputs.fastest_rate

    def get(self, i: int) -> Inputs:
        """The inputs of one simulation, a copy."""
        u, s, lacking = (values[i].copy() for values in (self.excitation, self.reserve, self.shortfall))
        return Inputs(u, s, lacking, float(self.fastest_rate[i]))

    def running(self, k: int) -> Ids:
        """The simulations that have a window k and have not failed."""
        if k < self._shortest and not self.errors:
            return self._everyone
        ids = np.flatnonzero(self.count > k)
        return ids[[int(i) not in self.errors for i in ids]] if self.errors else ids


class Method(Protocol):
    """How one method chooses excitations, with its settings."""

    def settings(self) -> dict[str, Any]:
        """The method's name, as ``method``, and its own settings, for the record."""

    def start(self, windows: Windows) -> tuple[State, Inputs]:
        """The first state of a simulation, and inputs that stand for the window before the first."""

    def drive(self, team: Team) -> Driver:
        """What takes the team through its windows."""


class Driver(Protocol):
    """A method at work; what it carries from window to window is its own."""

    def window(self, k: int, ids: Ids, rows: Array) -> Array:
        """Choose the team's inputs of window k for some simulations, and step them.

        Args:
            k: the window.
            ids: (b,) the simulations.
            rows: (b, n_row) their states at its start, see `lockstep.Plants`.

        Returns:
            (b, n_row) their states at its end; NaN, or an entry in the team's errors, where one failed.
        """


class Separately:
    """Drives each simulation of a team by itself, by a method that looks at one plant at a time."""

    def __init__(self, team: Team, choose: Callable[[Windows, int, State, Inputs], Inputs]) -> None:
        self._team, self._choose = team, choose

    def window(self, k: int, ids: Ids, rows: Array) -> Array:
        """See `Driver`."""
        team = self._team
        for i, row in zip(ids, rows, strict=True):
            try:
                team.put(i, self._choose(team.windows[i], k, team.plants.layout.state(row), team.get(i)))
            except SimulationError as error:
                team.errors[int(i)] = error
        return team.plants.step(ids, rows, team.excitation[ids], team.reserve[ids], team.n_step)


def run(method: Method, windows: Windows, progress: Progress | None) -> Solution:
    """Solve all windows of one simulation.

    Raises:
        SimulationError: the simulation diverged, also with a quarter and a sixteenth of the step (an `MjhcmcWarning`
            tells of each; a user's own plant keeps its step). Its ``solution`` holds what was solved before, marked
            interrupted.
        SolveInterrupted: a KeyboardInterrupt came; it carries what was solved.
    """
    outcome = run_together(method, [windows], progress)[0]
    if isinstance(outcome, SimulationError):
        raise outcome
    return outcome


def run_together(
    method: Method,
    windows: Sequence[Windows],
    progress: Progress | None,
    threads: int = 1,
    numbers: Sequence[int] | None = None,
) -> list[Solution | SimulationError]:
    """Solve simulations in lock step; one that fails does so by itself, with the error in place of its solution.

    Args:
        method: what chooses the excitations.
        windows: one a simulation, see `windows.prepare`.
        progress: called after each window.
        threads: to step on.
        numbers: what to call the simulations in messages; None: nothing.

    Raises:
        SolveInterrupted: a KeyboardInterrupt came; it carries what was solved.
    """
    began = time.perf_counter()
    name, first = method.settings()["method"], windows[0]
    if len(windows) == 1:
        _log.info("%s on %s, %s: %d windows", name, first.model.name, first.motion.name, first.count)
    else:
        _log.info("%s, %d simulations on %d threads", name, len(windows), threads)
    level = 4 if numbers is None else 3  # where the user called
    outcomes = _run(method, windows, progress, threads)
    for attempt in range(1, _FINER_TRIES + 1):
        again = [i for i, o in enumerate(outcomes) if isinstance(o, DivergedError) and windows[i].may_be_finer]
        if not again:
            break
        finer = [windows[i].finer(_FINER**attempt) for i in again]
        for i in again:
            who = "" if numbers is None else f"simulation {numbers[i]}: "
            step = f"physics_dt {finer[0].physics_dt:.2g} s"
            warnings.warn(f"{who}{outcomes[i]}; it is solved again with {step}", MjhcmcWarning, stacklevel=level)
        try:
            anew = _run(method, finer, progress, threads)
        except SolveInterrupted as stop:
            kept = [_partial(outcome) for outcome in outcomes]
            for i, solution in zip(again, stop.solutions, strict=True):
                kept[i] = _longer(solution, kept[i])
            raise SolveInterrupted(kept) from stop
        for i, outcome in zip(again, anew, strict=True):
            if isinstance(outcome, SimulationError):
                outcome.solution = _longer(outcome.solution, _partial(outcomes[i]))
            outcomes[i] = outcome
    _log.info("%s: solved in %.3g s", name, time.perf_counter() - began)
    return outcomes


def _partial(outcome: Solution | SimulationError) -> Solution | None:
    return outcome.solution if isinstance(outcome, SimulationError) else outcome


def _longer(a: Solution | None, b: Solution | None) -> Solution | None:
    return max((s for s in (a, b) if s is not None), key=lambda s: s.n_window, default=None)


def _run(
    method: Method, windows: Sequence[Windows], progress: Progress | None, threads: int
) -> list[Solution | SimulationError]:
    plants = _plants(windows, threads)
    team = Team(windows, plants)
    record = Record(team.windows, plants, method.settings())
    try:
        record.begin(plants.rows([_start(method, team, i) for i in range(len(windows))]))
        driver, total = method.drive(team), int(team.count.max())
        for k in range(total):
            ids = team.running(k)
            if not ids.size:
                break
            ends = driver.window(k, ids, record.last(ids, k))
            team.errors.update(record.window(k, ids, ends, team))
            if progress is not None:
                progress(k + 1, total)
        return [_outcome(record, team, i) for i in range(len(windows))]
    except KeyboardInterrupt as interrupt:
        partly = [record.done(i) < w.count for i, w in enumerate(windows)]
        raise SolveInterrupted([record.solution(i, interrupted=part) for i, part in enumerate(partly)]) from interrupt


def _outcome(record: Record, team: Team, i: int) -> Solution | SimulationError:
    error = team.errors.get(i)
    solution = record.solution(i, interrupted=error is not None)
    if error is not None:
        error.solution = solution
        return error
    assert solution is not None  # without a failure all windows are there
    return solution


def _plants(windows: Sequence[Windows], threads: int) -> Plants:
    own = [w.own_plant for w in windows if w.own_plant is not None]
    if own and all(plant.hosted is not None for plant in own):
        from mjhcmc.hosted.plant import lockstep_of

        return lockstep_of(own, threads)
    if own:
        return OneByOne(own)
    first = windows[0]
    around = [w.surroundings for w in windows]
    return Lockstep([w.model for w in windows], first.physics_dt, around, threads, first.scheme.name)


def _start(method: Method, team: Team, i: int) -> State:
    """The first state of a simulation; its inputs are put into the team."""
    windows = team.windows[i]
    if len(team.windows) > 1:
        windows = windows.without_plant()  # one each would fill the memory
    try:
        state, inputs = method.start(windows)
        state = windows.plant.settled(state)
    except SimulationError as error:
        team.errors[i] = error
        return replace(windows.start, activation=np.zeros(windows.model.n_muscle))
    team.put(i, inputs)
    return state


def static_start(windows: Windows, *, reserves: bool) -> tuple[State, Inputs]:
    """The first state, with the static allocation of the first desired acceleration where no activation was given.

    Returns:
        The state; and as inputs the excitation that holds its activation, with the reserve of that allocation.
    """
    plant, model, start, sharing = windows.plant, windows.model, windows.start, windows.sharing
    given = np.isfinite(start.activation).all()
    seen = windows.where_forces_act(start, windows.target.qacc[0])
    plant.set_state(seen if given else replace(seen, activation=np.zeros(model.n_muscle)))
    plant.set_input(None, np.zeros(model.nv))
    plant.forward()
    needed = needs(windows, start.qpos, windows.target.qacc[0], steady=True)
    low, high = model.excitation_range.T
    cap = activation_cap(model.force_limit, needed.moments.gain, needed.moments.bias)
    high = np.maximum(low, np.minimum(high, cap))
    price = reserve_price(needed.M, reserves=reserves)
    found = sharing.allocate(sharing.problem(needed.moments, needed.Q, low, high, price, None, start.time))
    activation = plant.steady_activation(found.activation)
    if plant.hosted is not None:
        activation = np.maximum(activation, np.where(sharing.disabled, 0.0, np.minimum(sharing.min_activation, high)))
    state = start if given else replace(start, activation=activation)
    lacking = model.coordinates.full(found.reserve)
    inputs = Inputs(
        excitation=sharing.excitation(np.clip(state.activation, low, high)),
        reserve=lacking if reserves else np.zeros(model.nv),
        shortfall=lacking,
        fastest_rate=0.0,
    )
    return state, inputs


@dataclass(frozen=True)
class Needs:
    """What muscles face at a state, seen from the tracked degrees of freedom.

    Attributes:
        moments: of the muscles, with B (nz, n_muscle); p is that of all degrees of freedom.
        Q: (nz,) N m, that activation should supply.
        M: (nz, nz) kg m^2.
    """

    moments: dynamics.MuscleMoments
    Q: Array
    M: Array


def needs(windows: Windows, qpos: Array, qacc: Array, *, steady: bool = False) -> Needs:
    """What accelerations (nv,) take at the plant's last `forward`, at a position (nq,); see `dynamics`."""
    plant = windows.plant
    moments = dynamics.muscle_moments(plant, damping=windows.sharing.counts_forces, steady=steady)
    Q = dynamics.required_moment(plant, qacc, moments.p)
    if windows.scheme.first_order:
        Q = Q + windows.physics_dt * windows.scheme.joint_damping(windows.model.mj_model) * qacc
    M = dynamics.mass_matrix(plant)
    if windows.model.roles.all_tracked:
        return Needs(moments, Q, M)
    W = windows.seen_from_tracked(qpos, M)
    return Needs(replace(moments, B=W.T @ moments.B), W.T @ Q, W.T @ M @ W)


def rate_at(windows: Windows, state: State, reserve: NDArray[np.float64]) -> float:
    """Decay rate of the velocities at a state, 1/s, for methods that do not look at it anyway."""
    plant = windows.plant
    plant.set_state(state)
    plant.set_input(None, reserve)
    plant.forward()
    M, internal = dynamics.mass_matrix(plant), plant.internal_rate()
    D = explicit_damping(windows)
    if not windows.model.roles.all_tracked:
        W = windows.seen_from_tracked(state.qpos, M)
        M, D = W.T @ M @ W, W.T @ D @ W
    return max(internal, decay_rate(M, D, windows.scheme.limit / plant.physics_dt))


def reserve_price(M: NDArray[np.float64], *, reserves: bool) -> NDArray[np.float64]:
    """(nv, nv) kg m^2, the inertia by which reserves are priced (see `allocation.build_problem`).

    Reserves that are applied are motors, one a joint: each is priced by what it is worth at its own joint, so that
    a joint whose muscles suffice needs none. Where nothing fills the gap the joints share it, and by Gauss's
    principle the shares are those that change the accelerations least; the leg comes back from a wrong start by it.
    """
    return np.diag(np.diag(M)) if reserves else M

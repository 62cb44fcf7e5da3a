"""HCMC as a policy: what it found, played back; and asked anew at each window, from wherever the model is."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.environments.episodes import check_task
from mjhcmc.environments.remaining import remaining
from mjhcmc.environments.task import TrackingTask, check_solution
from mjhcmc.errors import DivergedError, SettingsError, SimulationError
from mjhcmc.lockstep import Lockstep
from mjhcmc.methods.hcmc import Hcmc
from mjhcmc.methods.record import diverged
from mjhcmc.methods.run import Driver, Team
from mjhcmc.methods.windows import Windows
from mjhcmc.plant import State
from mjhcmc.sharing import share
from mjhcmc.solution import Solution

Array = NDArray[np.float64]

_SAME_TIME = 1e-6  # s
_SAME = 1e-9  # rad, m, rad/s ...: the state that was expected
_FINER = (1, 4, 16)  # parts of the physics step by which an answer is looked for, as in a solve


@dataclass(frozen=True, eq=False)
class Expert:
    """A solution's excitations, node by node, whatever the state: open loop.

    An environment has no reserves. Of a solution by ``hcmc(..., reserves=False, physics_dt=task.settings.physics_dt)``
    the environment shows the solution's own tracking errors, to rounding; of one with reserves it shows what these held
    back, of one with another physics step what that changes.

    Attributes:
        excitation: (N, n_muscle).
        time: (N+1,) s, the nodes.
    """

    excitation: Array
    time: Array

    @classmethod
    def of(cls, solution: Solution, task: TrackingTask) -> Expert:
        """That of a solution.

        Args:
            solution: of the task's model, motion and dt.
            task: that it is to do.

        Raises:
            SettingsError: the solution is of something else.
        """
        check_task(task)
        check_solution(solution, task)
        return cls(solution.excitation, solution.time)

    def __call__(self, node: int, state: State) -> Array:
        """The excitation (n_muscle,) of the window that begins at a node; of the state only its time matters.

        Raises:
            SettingsError: the solution has no such window, or it begins at another time.
        """
        if not 0 <= node < len(self.excitation):
            raise SettingsError(f"the solution has {len(self.excitation)} windows: none begins at node {node}")
        if abs(self.time[node] - state.time) > _SAME_TIME:
            raise SettingsError(
                f"node {node} is at {state.time:.6g} s, in the solution at {self.time[node]:.6g} s: solve the task's "
                "motion with its dt"
            )
        return np.array(self.excitation[node])


class FeedbackExpert:
    """HCMC, asked at each window from the state that the model is in.

    Where the state is what the last window was to end in, the method goes on as in a solve, so that an undisturbed
    episode from the motion's beginning is ``hcmc(..., reserves=False)`` with the task's physics step, to the last bit.
    Where it is not (another policy acted, something pushed), it begins anew from there.

    Where the physics step is too long for the muscles' damping in a window, the answer is looked for with a quarter
    and a sixteenth of it; the environment keeps its own.

    Args:
        task: the task.
        trials: see `mjhcmc.hcmc`, as the rest.
        tolerance: 0 or positive.
        gain: positive, at most 3.
        authority: positive, at most 1.
        choices: how moments are shared: cost, weights, ... (see `mjhcmc.sharing.share`).

    Raises:
        SettingsError: an unknown choice, or a setting outside its valid values.
    """

    def __init__(
        self,
        task: TrackingTask,
        *,
        trials: int = 2,
        tolerance: float = 0.1,
        gain: float = 2.7,
        authority: float = 0.15,
        **choices: Any,
    ) -> None:
        check_task(task)
        known = list(inspect.signature(share).parameters)[1:]
        for name in choices:
            if name not in known:
                raise SettingsError(
                    f"{name!r} is no setting of the expert: choose among trials, tolerance, gain, authority, "
                    f"{', '.join(known)}"
                )
        self._method = Hcmc(False, trials, tolerance, gain, authority)
        whole = task.windows
        self._windows = replace(whole, sharing=share(task.model, **choices)) if choices else whole
        self._solves: dict[int, _Solve] = {}

    def __call__(self, node: int, state: State) -> Array:
        """The excitation (n_muscle,) of the window that begins at a node, in a state.

        Raises:
            SettingsError: no window begins there.
            DivergedError: the method finds no way on: what it tries runs away, at a sixteenth of the step too.
        """
        if not 0 <= node < self._windows.count:
            raise SettingsError(f"the motion has {self._windows.count} windows: none begins at node {node}")
        for parts in _FINER:
            found = self._solve(parts).answer(node, state)
            if not isinstance(found, SimulationError):
                return found
        raise DivergedError(
            f"HCMC finds no excitation for the window at {self._windows.reference.time[node]:.4g} s: from this state "
            f"the simulation diverged, also with physics_dt {self._windows.physics_dt / _FINER[-1]:.2g} s: end the "
            "episode here"
        )

    def _solve(self, parts: int) -> _Solve:
        """The solve with that part of the physics step; most tasks never ask for more than the first."""
        if parts not in self._solves:
            windows = self._windows if parts == 1 else self._windows.finer(parts)
            self._solves[parts] = _Solve(self._method, windows)
        return self._solves[parts]


class _Solve:
    """A solve that can be taken up at any node, from any state."""

    def __init__(self, method: Hcmc, windows: Windows) -> None:
        self._method, self._windows = method, windows
        self._plants = Lockstep(
            [windows.model], windows.physics_dt, [windows.surroundings], integrator=windows.scheme.name
        )
        self._team: Team | None = None
        self._driver: Driver | None = None
        self._first = self._next = -1
        self._expected: State | None = None

    def answer(self, node: int, state: State) -> Array | SimulationError:
        """The excitation (n_muscle,) of the window that begins at a node, or why there is none."""
        if not self._goes_on(node, state):
            self._expected = None
            try:
                self._begin(node, state)
            except SimulationError as error:
                return error
        team, driver = self._team, self._driver
        assert team is not None
        assert driver is not None
        ids = np.zeros(1, dtype=np.intp)
        ends = driver.window(node - self._first, ids, self._plants.rows([state]))
        if team.errors or not np.isfinite(ends).all():
            self._expected = None
            return team.errors.get(0) or diverged(team.windows[0], node - self._first)
        self._next, self._expected = node + 1, self._plants.layout.state(ends[0])
        return np.array(team.excitation[0])

    def _goes_on(self, node: int, state: State) -> bool:
        """Whether the state is the one that the last window was to end in."""
        expected = self._expected
        return (
            expected is not None
            and node == self._next
            and np.allclose(state.qpos, expected.qpos, rtol=0, atol=_SAME)
            and np.allclose(state.qvel, expected.qvel, rtol=_SAME, atol=_SAME)
            and np.allclose(state.activation, expected.activation, rtol=0, atol=_SAME)
        )

    def _begin(self, node: int, state: State) -> None:
        rest = remaining(self._windows, node, state)
        _, inputs = self._method.start(rest)
        self._team = Team([rest], self._plants)
        self._team.put(0, inputs)
        self._driver, self._first = self._method.drive(self._team), node

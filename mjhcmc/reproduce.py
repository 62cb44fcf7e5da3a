"""The paper's experiment: three cosine cycles of the leg, by every method, timed and put beside the paper's Table 2."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc import paper
from mjhcmc.activity import agreement
from mjhcmc.errors import MjhcmcWarning, SettingsError
from mjhcmc.methods import METHODS, find_method
from mjhcmc.methods.run import Progress, SolveInterrupted
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.muscle_choice import plant_for
from mjhcmc.notices import each_notice_once
from mjhcmc.opensim_reference import CMC_FLOOR, INITIALISATION, OpenSimRun, read_reference
from mjhcmc.paper import PAPER
from mjhcmc.plant import MujocoPlant
from mjhcmc.solution import Solution
from mjhcmc.summary import columns, numbers, verdict_lines

_TIMED_CALLS = 5


@dataclass(frozen=True)
class Reproduction:
    """The experiment's outcome.

    Attributes:
        movement: ``"fast"`` or ``"slow"``.
        solutions: by method.
        solve_time: s by method, wall median of five calls after a first.
        bare_step_time: s, MuJoCo alone over the same physics steps, in the same process.
        opensim: OpenSim's own CMC of the movement.
        muscle: what drove the leg, see `muscle_choice.MUSCLES`.
        curves: of Hill muscles.
    """

    movement: str
    solutions: dict[str, Solution]
    solve_time: dict[str, float]
    bare_step_time: float
    opensim: OpenSimRun | None = None
    muscle: str = "mujoco"
    curves: str = "millard"

    def _opensim(self, solution: Solution) -> dict[str, Any]:
        """Activation of Hill muscles beside that of OpenSim's CMC, where its results were found."""
        if self.opensim is None or self.muscle == "mujoco":
            return {}
        found = agreement(solution.time, solution.activation, self.opensim.activity, CMC_FLOOR, INITIALISATION)
        correlation = {name: None if np.isnan(r) else r for name, (r, _) in found.items()}
        return {"opensim_correlation": correlation, "opensim_rms": {name: rms for name, (_, rms) in found.items()}}

    def numbers(self) -> dict[str, Any]:
        """Plain values, as `mjhcmc reproduce --json` prints them."""
        first = next(iter(self.solutions.values()))
        return {
            "movement": self.movement,
            "dt": first.settings["dt"],
            "physics_dt": first.settings["physics_dt"],
            "bare_step_time_s": self.bare_step_time,
            **({} if self.muscle == "mujoco" else {"muscle": self.muscle, "curves": self.curves}),
            "methods": {
                name: {**numbers(solution), "solve_time_s": self.solve_time[name], **self._opensim(solution)}
                for name, solution in self.solutions.items()
            },
        }

    def screen(self) -> str:
        """The comparison as text."""
        values = self.numbers()
        return "\n".join(
            [
                f"{self.movement} cosine movement on leg8{self._driven}, dt {1e3 * values['dt']:g} ms, physics step "
                f"{1e3 * values['physics_dt']:g} ms; errors of the muscle-driven leg in degrees",
                "",
                *self._errors(values["methods"]),
                "",
                *self._mean_squares(values["methods"]),
                *[line for name, result in values["methods"].items() for line in self._details(name, result)],
            ]
        )

    @property
    def _driven(self) -> str:
        name = next(iter(self.solutions.values())).settings.get("muscles", {}).get("curves")
        return "" if name is None else f", {name} muscles with {self.muscle} tendons"

    @property
    def _is_the_papers(self) -> bool:
        dt = next(iter(self.solutions.values())).settings["dt"]
        return self.movement == paper.MOVEMENT and abs(dt - paper.DT) < 1e-12

    def _errors(self, methods: dict[str, Any]) -> list[str]:
        """The paper's Table 2, ours under it, and how many times smaller ours are."""
        joints = paper.JOINTS
        rows = [["", *[f"{joint} max" for joint in joints], *[f"{joint} RMSE" for joint in joints], "time s"]]
        for name, reported in PAPER.items():
            figures = (*reported.max_error_deg, *reported.rmse_deg, reported.solve_time_s)
            rows.append([f"paper {name} ({paper.MOVEMENT}, 10 ms)", *[f"{value:g}" for value in figures]])
        if self.opensim is not None:
            largest = np.rad2deg(np.abs(self.opensim_error()).max(axis=0))
            root = np.rad2deg(np.sqrt((self.opensim_error() ** 2).mean(axis=0)))
            rows.append(["OpenSim 4.6 cmc, elastic tendons", *[f"{value:.3g}" for value in (*largest, *root)], "-"])
        for name, result in methods.items():
            rows.append([f"mjhcmc {name}", *[f"{value:.3g}" for value in _figures(result)]])
        if self._is_the_papers:
            for name, reported in PAPER.items():
                figures = (*reported.max_error_deg, *reported.rmse_deg, reported.solve_time_s)
                ratios = [f"{p / own:.3g} x" for p, own in zip(figures, _figures(methods[name]), strict=True)]
                ratios[-1] = "-"  # other machines
                rows.append([f"paper {name} / mjhcmc {name}", *ratios])
        return columns(rows)

    def _mean_squares(self, methods: dict[str, Any]) -> list[str]:
        """What the paper's formula for e_RMSE says, and what it calls an error: a ratio of two methods'."""
        header = [f"{joint} MSE" for joint in paper.JOINTS] + [f"{joint} ratio" for joint in paper.JOINTS]
        largest = {name: [result["max_error_deg"][joint] for joint in paper.JOINTS] for name, result in methods.items()}
        reported = {name: list(result.max_error_deg) for name, result in PAPER.items()}

        def ratio(errors: dict[str, list[float]]) -> list[str]:
            return [f"{100 * a / b:.3g} %" for a, b in zip(errors["hcmc"], errors["cmc"], strict=True)]

        rows = [["", *header]]
        for name, result in PAPER.items():
            square = [f"{value**2:.3g}" for value in result.rmse_deg]
            rows.append([f"paper {name}", *square, *(ratio(reported) if name == "hcmc" else [""] * 3)])
        for name, values in methods.items():
            square = [f"{values['mse_deg2'][joint]:.3g}" for joint in paper.JOINTS]
            rows.append([f"mjhcmc {name}", *square, *(ratio(largest) if name == "hcmc" else [""] * 3)])
        return [
            "mean square (deg^2, the paper's formula without a root); ratio of the largest errors, hcmc to cmc",
            *columns(rows),
        ]

    def _details(self, name: str, result: dict[str, Any]) -> list[str]:
        def by_name(values: dict[str, float], form: str) -> str:
            return ", ".join(f"{key} {value:{form}}" for key, value in values.items())

        return [
            "",
            f"{name}: peak excitation  {by_name(result['peak_excitation'], '.2f')}",
            f"{name}: peak reserve     {by_name(result['peak_reserve_nm'], '.2g')} N m",
            f"{name}: replay error     {by_name(result['replay_max_error_deg'], '.2g')} deg (open loop, 0.1 ms)",
            f"{name}: solve time       {result['solve_time_s'] / self.bare_step_time:.3g} x bare stepping "
            f"({1e3 * self.bare_step_time:.3g} ms)",
            *self._correlations(name, result),
            *verdict_lines(result["verdict"]),
        ]

    def _correlations(self, name: str, result: dict[str, Any]) -> list[str]:
        if "opensim_correlation" not in result:
            return []
        found = [f"{m} {'-' if r is None else f'{r:.2f}'}" for m, r in result["opensim_correlation"].items()]
        return [f"{name}: activation's correlation with OpenSim's CMC  {', '.join(found)}"]

    def opensim_error(self) -> NDArray[np.float64]:
        """(n, 3) rad: the tracking error of OpenSim's own CMC at its own times, actual minus desired.

        Raises:
            SettingsError: there is none to compare with.
        """
        if self.opensim is None or self.opensim.qpos is None:
            raise SettingsError("no results of OpenSim's CMC were found to compare with")
        motion = Motion.cosine(MuscleModel.load("leg8"), self.movement)
        inside = self.opensim.time <= motion.end + 1e-9
        return self.opensim.qpos[inside] - motion.sample(self.opensim.time[inside]).qpos

    @property
    def passed(self) -> bool:
        """Whether HCMC's verdict holds."""
        return self.solutions["hcmc"].verdict.passed


def reproduce(
    movement: str = "fast",
    dt: float = 0.01,
    physics_dt: float = 0.001,
    progress: Progress | None = None,
    muscle: str = "mujoco",
    curves: str = "millard",
) -> Reproduction:
    """Run the paper's experiment with every method.

    Args:
        movement: ``"fast"`` (three cycles of 0.2 s, the paper's) or ``"slow"`` (three of 0.6 s).
        dt: s, control window.
        physics_dt: s, physics step.
        progress: called with (windows solved, windows in all) of each method's first call; the timed calls run without.
        muscle: ``"mujoco"``: MuJoCo's own; ``"rigid"`` or ``"compliant"``: Hill muscles with such tendons.
        curves: of Hill muscles.

    Raises:
        MotionError: an unknown movement.
        SettingsError: dt or physics_dt outside their valid values; an unknown muscle or curves.
        SolveInterrupted: a KeyboardInterrupt came; it carries HCMC's solution, whole where it was.
    """
    model = MuscleModel.load("leg8")
    motion = Motion.cosine(model, movement)
    plant = plant_for(model, muscle, dt, physics_dt, curves)
    solutions, times = {}, {}
    told: set[str] = set()
    try:
        for name in METHODS:
            method = find_method(name)
            with each_notice_once(told):  # the warm-up
                solutions[name] = method(model, motion, dt=dt, physics_dt=physics_dt, plant=plant, progress=progress)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", MjhcmcWarning)
                times[name] = _median_time(partial(method, model, motion, dt=dt, physics_dt=physics_dt, plant=plant))
    except SolveInterrupted as stop:
        raise SolveInterrupted([solutions.get("hcmc", stop.solution)]) from stop
    opensim = read_reference(model, movement)
    return Reproduction(movement, solutions, times, bare_step_time(solutions["hcmc"]), opensim, muscle, curves)


def _figures(result: dict[str, Any]) -> list[float]:
    by_joint = [result[key][joint] for key in ("max_error_deg", "rmse_deg") for joint in paper.JOINTS]
    return [*by_joint, result["solve_time_s"]]


def bare_step_time(solution: Solution) -> float:
    """s, wall median: MuJoCo alone stepping a solution's excitations and reserves, window by window.

    MuJoCo's own muscles, whichever drove the solution; where those were Hill muscles each window begins at its recorded
    node, since others would lose the movement.

    Args:
        solution: one that knows its model.
    """
    model = solution.model
    assert model is not None
    plant = MujocoPlant(model, solution.settings["physics_dt"])
    n_step = round(solution.dt / plant.physics_dt)

    def run() -> None:
        for k in range(solution.n_window):
            if k == 0 or solution.hosted:
                plant.set_state(solution.state(k))
            plant.advance(solution.excitation[k], solution.reserve[k], n_step)

    run()
    return _median_time(run)


def _median_time(call: Callable[[], Any]) -> float:
    times = []
    for _ in range(_TIMED_CALLS):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return median(times)

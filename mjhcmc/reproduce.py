"""The paper's experiment: three cosine cycles of the leg, solved, timed and put beside the paper's Table 2.

"Integrator for Musculoskeletal Simulation in Python" (2024), doi 10.17979/ja-cea.2024.45.10802.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any

from mjhcmc.errors import MjhcmcWarning
from mjhcmc.methods import METHODS, find_method
from mjhcmc.methods.windows import Progress
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import MujocoPlant, State
from mjhcmc.solution import Solution
from mjhcmc.summary import columns, numbers, verdict_lines

PAPER_MAX_ERROR_DEG = {"hip": 0.0537, "knee": 0.0880, "ankle": 0.2305}
"""The paper's Table 2, HCMC: the largest tracking error, degrees; its movement is `fast` at dt .01."""

PAPER_RMSE_DEG = {"hip": 0.0104, "knee": 0.01503, "ankle": 0.0375}
"""The paper's Table 2, HCMC: RMSE, degrees."""

PAPER_SOLVE_TIME_S = 4.85
"""The paper's time for HCMC in Python."""

_TIMED_CALLS = 5


@dataclass(frozen=True)
class Reproduction:
    """The experiment's outcome.

    Attributes:
        movement: ``"fast"`` or ``"slow"``.
        solutions: by method.
        solve_time: s by method, wall median of five calls after a first.
        bare_step_time: s, MuJoCo alone over the same physics steps, in the same process.
    """

    movement: str
    solutions: dict[str, Solution]
    solve_time: dict[str, float]
    bare_step_time: float

    def numbers(self) -> dict[str, Any]:
        """Plain values, as `mjhcmc reproduce --json` prints them."""
        first = next(iter(self.solutions.values()))
        return {
            "movement": self.movement,
            "dt": first.settings["dt"],
            "physics_dt": first.settings["physics_dt"],
            "bare_step_time_s": self.bare_step_time,
            "methods": {
                name: {**numbers(solution), "solve_time_s": self.solve_time[name]}
                for name, solution in self.solutions.items()
            },
        }

    def screen(self) -> str:
        """The comparison as text."""
        values = self.numbers()
        is_paper = self.movement == "fast" and abs(values["dt"] - 0.01) < 1e-12
        lines = [
            f"{self.movement} cosine movement on leg8, dt {1e3 * values['dt']:g} ms, physics step "
            f"{1e3 * values['physics_dt']:g} ms; errors of the muscle-driven leg in degrees",
            "",
        ]
        joints = list(PAPER_MAX_ERROR_DEG)
        rows = [["", *[f"{joint} max" for joint in joints], *[f"{joint} RMSE" for joint in joints], "time s"]]
        rows.append(
            [
                "paper HCMC (fast, dt 10 ms)",
                *[f"{PAPER_MAX_ERROR_DEG[joint]:g}" for joint in joints],
                *[f"{PAPER_RMSE_DEG[joint]:g}" for joint in joints],
                f"{PAPER_SOLVE_TIME_S:g}",
            ]
        )
        for name, result in values["methods"].items():
            largest, root = result["max_error_deg"], result["rmse_deg"]
            rows.append(
                [
                    f"mjhcmc {name}",
                    *[f"{largest[joint]:.3g}" for joint in joints],
                    *[f"{root[joint]:.3g}" for joint in joints],
                    f"{result['solve_time_s']:.3g}",
                ]
            )
            if is_paper:
                rows.append(
                    [
                        f"paper / {name}",
                        *[f"{PAPER_MAX_ERROR_DEG[joint] / largest[joint]:.3g} x" for joint in joints],
                        *[f"{PAPER_RMSE_DEG[joint] / root[joint]:.3g} x" for joint in joints],
                        f"{PAPER_SOLVE_TIME_S / result['solve_time_s']:.3g} x",
                    ]
                )
        lines += columns(rows)
        for name, result in values["methods"].items():
            peaks = ", ".join(f"{muscle} {peak:.2f}" for muscle, peak in result["peak_excitation"].items())
            replay = ", ".join(f"{joint} {error:.2g}" for joint, error in result["replay_max_error_deg"].items())
            reserve = ", ".join(f"{joint} {moment:.2g}" for joint, moment in result["peak_reserve_nm"].items())
            lines += [
                "",
                f"{name}: peak excitation  {peaks}",
                f"{name}: peak reserve     {reserve} N m",
                f"{name}: replay error     {replay} deg (open loop, 0.1 ms)",
                f"{name}: solve time       {result['solve_time_s'] / self.bare_step_time:.3g} x bare stepping "
                f"({1e3 * self.bare_step_time:.3g} ms)",
                *verdict_lines(result["verdict"]),
            ]
        return "\n".join(lines)

    @property
    def passed(self) -> bool:
        """Whether HCMC's verdict holds."""
        return self.solutions["hcmc"].verdict.passed


def reproduce(
    movement: str = "fast", dt: float = 0.01, physics_dt: float = 0.001, progress: Progress | None = None
) -> Reproduction:
    """Run the paper's experiment with every method.

    Args:
        movement: ``"fast"`` (three cycles of 0.2 s, the paper's) or ``"slow"`` (three of 0.6 s).
        dt: s, control window.
        physics_dt: s, physics step.
        progress: called with (windows solved, windows in all) of each method's first call; the timed calls run without.

    Raises:
        MotionError: an unknown movement.
        SettingsError: dt or physics_dt outside their valid values.
    """
    model = MuscleModel.load("leg8")
    motion = Motion.cosine(model, movement)
    solutions, times = {}, {}
    for name in METHODS:
        method = find_method(name)
        solutions[name] = method(model, motion, dt=dt, physics_dt=physics_dt, progress=progress)  # the warm-up
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MjhcmcWarning)  # the warm-up gave each notice once
            times[name] = _median_time(partial(method, model, motion, dt=dt, physics_dt=physics_dt))
    return Reproduction(movement, solutions, times, bare_step_time(solutions["hcmc"]))


def bare_step_time(solution: Solution) -> float:
    """s, wall median: MuJoCo alone stepping a solution's excitations and reserves, window by window.

    Args:
        solution: one that knows its model.
    """
    model = solution.model
    assert model is not None
    plant = MujocoPlant(model, solution.settings["physics_dt"])
    n_step = round(solution.dt / plant.physics_dt)
    first = State(
        float(solution.time[0]), solution.qpos[0], solution.qvel[0], solution.activation[0], 0 * solution.qvel[0]
    )

    def run() -> None:
        plant.set_state(first)
        for k in range(solution.n_window):
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

"""One movement: solve against MuJoCo alone, by method, by control window, and by size of the model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any

import _bare
from _chain import chain, swing
from _markdown import grid
from _timing import alternate, figure, quiet, ratios, spread, walls

import mjhcmc

MOVEMENTS = ("fast", "slow")
WINDOWS = (0.01, 0.005)
SCALED = (0.02, 0.01, 0.005, 0.0025)
SIZES = ((3, 8), (3, 80), (10, 20), (10, 80))
"""Hinges and muscles of the chains."""

METHODS: dict[str, Callable[..., mjhcmc.Solution]] = {
    "HCMC": mjhcmc.hcmc,
    "CMC": mjhcmc.cmc,
    "static": mjhcmc.static_optimization,
}


@dataclass(frozen=True)
class Measured:
    """One solve: its solution, readings (s) and their ratios to bare stepping."""

    solution: mjhcmc.Solution
    wall: list[float]
    bare: list[float]
    ratio: list[float]

    def cells(self) -> tuple[str, ...]:
        """Windows, solve, bare, ratio, a window, share of the movement's duration."""
        n, mid = self.solution.n_window, median(self.wall)
        duration = float(self.solution.time[-1] - self.solution.time[0])
        return (
            str(n),
            spread(self.wall, 1e-3),
            spread(self.bare, 1e-3),
            spread(self.ratio),
            figure(1e6 * mid / n),
            figure(mid / duration),
        )


HEADER = ("windows", "solve, ms", "bare stepping, ms", "solve / bare", "a window, µs", "solve / duration")


def measure(
    methods: dict[str, Callable[..., mjhcmc.Solution]],
    model: mjhcmc.MuscleModel,
    motion: mjhcmc.Motion,
    runs: int,
    **settings: Any,
) -> dict[str, Measured]:
    """Methods in turns with MuJoCo alone over the steps of the first one's solution."""
    with quiet():
        solutions = {name: method(model, motion, **settings) for name, method in methods.items()}
        calls: dict[str, Callable[[], Any]] = {
            name: partial(method, model, motion, **settings) for name, method in methods.items()
        }
        calls[""] = _bare.one(next(iter(solutions.values())))
        readings = alternate(calls, runs)
    bare = readings.pop("")
    return {
        name: Measured(solutions[name], walls(found), walls(bare), ratios(found, bare))
        for name, found in readings.items()
    }


def methods(runs: int) -> tuple[str, dict[tuple[str, str, float], Measured]]:
    """The table by method, movement and window; and what it holds."""
    model, found = mjhcmc.MuscleModel.load("leg8"), {}
    for movement in MOVEMENTS:
        for dt in WINDOWS:
            timed = measure(METHODS, model, mjhcmc.Motion.cosine(model, movement), runs, dt=dt)
            found.update({(name, movement, dt): one for name, one in timed.items()})
    rows = [(f"{name}, {m}, dt {1e3 * dt:g} ms", *one.cells()) for (name, m, dt), one in found.items()]
    return grid(("", *HEADER), rows), found


def windows(runs: int) -> str:
    """The table of HCMC by control window."""
    model, rows = mjhcmc.MuscleModel.load("leg8"), []
    for movement in MOVEMENTS:
        motion = mjhcmc.Motion.cosine(model, movement)
        for dt in SCALED:
            timed = measure({"HCMC": mjhcmc.hcmc}, model, motion, runs, dt=dt)["HCMC"]
            steps = round(timed.solution.dt / float(timed.solution.settings["physics_dt"]))
            rows.append((f"{movement}, dt {1e3 * dt:g} ms", steps, *timed.cells()))
    return grid(("", "physics steps a window", *HEADER), rows)


def sizes(runs: int, quick: bool) -> str:
    """The table of HCMC by muscles and dofs."""
    rows = []
    for n_joint, n_muscle in SIZES:
        model = chain(n_joint, n_muscle)
        timed = measure({"HCMC": mjhcmc.hcmc}, model, swing(model, 0.1 if quick else 0.3), runs)["HCMC"]
        met = int((timed.solution.status == mjhcmc.WindowStatus(0)).sum())
        rows.append((f"{n_joint} dofs, {n_muscle} muscles", *timed.cells()[:5], f"{met} of {timed.solution.n_window}"))
    return grid(("", *HEADER[:5], "windows without reserves"), rows)

"""How fast the Hill model is: equilibrium, a physics step, HCMC on it, the first call; as Markdown.

    python benchmarks/hill_speed.py [--write [DOCUMENT]]

--write replaces the tables in docs/hill.md (or DOCUMENT). What is compared is timed in turns in one process: compare
ratios, and leave the machine alone while it runs.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

import _bare
import mujoco.batch
import numpy as np
from _markdown import ROOT, grid, main
from _timing import Reading, alternate, figure, fresh_python, machine, quiet, ratios, spread, walls

import mjhcmc
from mjhcmc import hill
from mjhcmc.cli_support import engine_notices
from mjhcmc.hill_muscles import hill_model
from mjhcmc.hosted.lockstep import HillLockstep
from mjhcmc.lockstep import Lockstep

PAIRS = 1_000_000
EQUILIBRIUM_TO_REACH = {"degroote-fregly": 3.0, "millard": 15.0, "thelen": None}
"""s for a million pairs of muscle and sample."""

STEP_TO_REACH = {1: 12.0, 64: 4.0, 256: 4.0}
"""A Hill step over MuJoCo's: of one leg, and of a simulation in lock step."""

HCMC_TO_REACH = 2.0  # s, fast on compliant tendons
CURVES = {"millard": "Millard", "thelen": "Thelen", "degroote-fregly": "De Groote-Fregly"}
TENDONS = ("compliant", "rigid")
DT, PHYSICS_DT = 0.01, 1e-3
N_STEP = 10
THREADS = (1, 2)

COLD = """
import json, time
began = time.perf_counter()
import mjhcmc
model = mjhcmc.MuscleModel.load("leg8")
motion = mjhcmc.Motion.cosine(model, "fast")
plant = mjhcmc.HillPlant(model)
mjhcmc.hcmc  # imported when first asked for
loaded = time.perf_counter()
mjhcmc.hcmc(model, motion, plant=plant)
first = time.perf_counter()
mjhcmc.hcmc(model, motion, plant=plant)
print(json.dumps([loaded - began, first - loaded, time.perf_counter() - first]))
"""
COLD_PARTS = ("import, load model, motion and plant", "first `hcmc` (fast, compliant, dt 10 ms)", "second `hcmc`")


def markdown() -> str:
    with quiet(), engine_notices():
        return "\n\n".join(
            [
                f"{machine()} Medians, with the quartiles of the readings in brackets.",
                "### A million pairs of muscle and sample\n\n" + equilibrium(),
                "### A physics step\n\n" + steps(),
                "### HCMC\n\n" + solves(),
                "### The first call\n\n" + cold(),
            ]
        )


def equilibrium() -> str:
    """Static equilibrium by `mjhcmc.hill`, plain NumPy."""
    model, calls = mjhcmc.MuscleModel.load("leg8"), {}
    random = np.random.default_rng(0)
    shape = (PAIRS // model.n_muscle, model.n_muscle)
    activation, share = random.uniform(0.01, 1.0, shape), random.uniform(0.6, 1.4, shape)
    for curves in CURVES:
        muscles = hill_model(model, curves)
        m = muscles.muscles
        length = m.tendon_slack_length + share * m.optimal_fiber_length * np.cos(m.pennation_at_optimal)
        calls[curves] = partial(hill.static_equilibrium, muscles, activation, length)
    rows = []
    for curves, readings in alternate(calls, 3).items():
        took, goal = walls(readings), EQUILIBRIUM_TO_REACH[curves]
        rows.append((CURVES[curves], spread(took), *against(median(took), goal)))
    return grid(("static equilibrium, compliant tendons", "s", "to reach", ""), rows)


def against(value: float, goal: float | None) -> tuple[str, str]:
    """What was to be reached, and whether it was."""
    return ("–", "") if goal is None else (f"{goal:g}", "reached" if value <= goal else "MISSED")


def steps() -> str:
    """One leg through the fast movement; many, each one window from a node of it."""
    leg = mjhcmc.MuscleModel.load("leg8")
    motion = mjhcmc.Motion.cosine(leg, "fast")
    own = mjhcmc.hcmc(leg, motion, dt=DT, physics_dt=PHYSICS_DT)
    calls: dict[str, Callable[[], Any]] = {"mj_step": _bare.one(own)}
    count: dict[str, tuple[int, str]] = {"mj_step": (own.n_window, "")}  # windows a call, what it is measured against
    sizes = [(b, threads) for b in STEP_TO_REACH if b > 1 for threads in THREADS if threads <= (os.cpu_count() or 1)]
    for b, threads in sizes:
        name = f"mujoco.batch, B = {b}, {threads}"
        calls[name], count[name] = batch(own, b, threads), (b, "mj_step")
    labels: dict[str, tuple[str, str, int]] = {}
    for curves, title in CURVES.items():
        for tendon in TENDONS:
            plant = mjhcmc.HillPlant(leg, curves, tendon, PHYSICS_DT)
            solution = mjhcmc.hcmc(leg, motion, dt=DT, physics_dt=PHYSICS_DT, plant=plant)
            name = f"{title}, {tendon}"
            calls[name], count[name] = one_leg(solution, plant), (solution.n_window, "mj_step")
            labels[name] = name, "one leg, 1 thread", 1
            for b, threads in sizes:
                key = f"{name}, B = {b}, {threads}"
                calls[key] = lockstep(solution, plant, b, threads)
                count[key] = b, f"mujoco.batch, B = {b}, {threads}"
                labels[key] = name, on(b, threads), b
    readings = {
        name: [Reading(r.wall / (N_STEP * count[name][0]), r.cpu) for r in found]
        for name, found in alternate(calls, 9).items()
    }
    rows = []
    for key, (name, how, b) in labels.items():
        ratio = ratios(readings[key], readings[count[key][1]])
        times = [spread(values) for values in (ratio, ratios(readings[key], readings["mj_step"]))]
        goal, met = against(median(ratio), STEP_TO_REACH[b])
        rows.append((name, how, spread(walls(readings[key]), 1e-6), times[0], goal, met, times[1]))
    base = [f"mj_step {spread(walls(readings['mj_step']), 1e-6)}"]
    for b, threads in sizes:
        took = spread(walls(readings[f"mujoco.batch, B = {b}, {threads}"]), 1e-6)
        base.append(f"mujoco.batch, {on(b, threads)} {took}")
    header = (
        "curves, tendons",
        "how many",
        "µs a step of a simulation",
        "over MuJoCo's own, as many, on as many threads",
        "to reach",
        "",
        "over mj_step",
    )
    return f"{grid(header, rows)}\n\nMuJoCo's own muscles, µs a step of a simulation: {'; '.join(base)}."


def on(b: int, threads: int) -> str:
    return f"B = {b}, {threads} thread{'s' if threads > 1 else ''}"


def one_leg(solution: mjhcmc.Solution, plant: mjhcmc.HillPlant) -> Callable[[], None]:
    """Hill steps through a solution's windows, one after the other."""
    plants, n = plant.lockstep, solution.n_window
    ids = np.arange(1)
    starts = [plants.rows([solution.state(k)]) for k in range(n)]

    def run() -> None:
        for k in range(n):
            plants.step(ids, starts[k], solution.excitation[[k]], solution.reserve[[k]], N_STEP)

    return run


def lockstep(solution: mjhcmc.Solution, plant: mjhcmc.HillPlant, b: int, threads: int) -> Callable[[], Any]:
    """Hill steps of b simulations through one window each, from the solution's nodes."""
    plants = HillLockstep([plant.driven] * b, [plant.hosted], PHYSICS_DT, [None] * b, threads)
    nodes = np.arange(b) % solution.n_window
    rows = plants.rows([solution.state(int(k)) for k in nodes])
    return partial(plants.step, np.arange(b), rows, solution.excitation[nodes], solution.reserve[nodes], N_STEP)


def batch(solution: mjhcmc.Solution, b: int, threads: int) -> Callable[[], None]:
    """The same by MuJoCo's muscles and MuJoCo's batch."""
    leg = solution.model
    assert leg is not None
    nodes = np.arange(b) % solution.n_window
    rows = Lockstep([leg] * b, PHYSICS_DT, [None] * b).rows([solution.state(int(k)) for k in nodes])
    many = mujoco.batch.Batch(mjhcmc.MujocoPlant(leg, PHYSICS_DT).mj_model, b, nthread=threads)
    ctrl, applied = many.bind("ctrl"), many.bind("qfrc_applied")

    def run() -> None:
        many.state[:] = rows
        ctrl[:, leg.ctrl_index] = solution.excitation[nodes]
        applied[:] = solution.reserve[nodes]
        many.step(nstep=N_STEP)

    return run


def solves() -> str:
    """HCMC on Hill muscles, beside HCMC on MuJoCo's and mj_step alone."""
    leg, rows = mjhcmc.MuscleModel.load("leg8"), []
    for movement in ("fast", "slow"):
        motion = mjhcmc.Motion.cosine(leg, movement)
        for dt in (0.01, 0.005):
            plants = {tendon: mjhcmc.HillPlant(leg, tendon=tendon, physics_dt=PHYSICS_DT) for tendon in TENDONS}
            given: dict[str, Any] = {"dt": dt, "physics_dt": PHYSICS_DT}
            calls: dict[str, Callable[[], Any]] = {
                tendon: partial(mjhcmc.hcmc, leg, motion, plant=plant, **given) for tendon, plant in plants.items()
            }
            calls["mujoco"] = partial(mjhcmc.hcmc, leg, motion, **given)
            calls["bare"] = _bare.one(mjhcmc.hcmc(leg, motion, **given))
            found = alternate(calls, 5)
            for tendon in TENDONS:
                took = walls(found[tendon])
                goal = HCMC_TO_REACH if (movement, tendon) == ("fast", "compliant") else None
                rows.append(
                    (
                        f"{movement}, {1e3 * dt:g} ms, {tendon}",
                        spread(took),
                        *against(median(took), goal),
                        *(spread(ratios(found[tendon], found[other])) for other in ("mujoco", "bare")),
                    )
                )
    header = (
        "movement, dt, tendons (Millard)",
        "s",
        "to reach",
        "",
        "over HCMC on MuJoCo's muscles",
        "over mj_step alone",
    )
    return grid(header, rows)


def cold() -> str:
    """Fresh processes, with an empty folder for Numba's compiled code, then with that folder filled."""
    with tempfile.TemporaryDirectory() as cache:
        times = [json.loads(fresh_python(["-c", COLD], NUMBA_CACHE_DIR=cache)) for _ in range(2)]
    return grid(
        ("s", "Numba's folder empty", "filled"),
        ((name, *(figure(t[i]) for t in times)) for i, name in enumerate(COLD_PARTS)),
    )


if __name__ == "__main__":
    main(
        "hill_speed.py",
        "How fast the Hill model and HCMC on it are.",
        markdown,
        document=ROOT / "docs" / "hill.md",
    )

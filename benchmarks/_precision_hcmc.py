"""HCMC's part of precision.py: its tracking error, the plant's integration error, and what small differences become."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import NamedTuple

import convergence
import numpy as np
from _markdown import digits, grid
from _timing import figure, quiet

import mjhcmc
from mjhcmc.cli_support import engine_notices

WINDOWS = (0.01, 0.005)
PHYSICS = (0.005, 0.0025, 0.001, 0.0005)
NUDGE = 1e-7  # rad


class Share(NamedTuple):
    """A solve, degrees: step asked for and used in ms, tracking error, what finer steps change open loop."""

    movement: str
    window: float
    asked: float
    used: float
    tracking: float
    integration: float


@cache
def shares() -> list[Share]:
    model, found = mjhcmc.MuscleModel.load("leg8"), []
    for movement in convergence.MOVEMENTS:
        motion = mjhcmc.Motion.cosine(model, movement)
        for dt in WINDOWS:
            for step in PHYSICS:
                with quiet(), engine_notices():
                    solution = mjhcmc.hcmc(model, motion, dt=dt, physics_dt=step)
                    finer = mjhcmc.replay(solution)
                error = np.rad2deg(np.abs(solution.tracking_error).max())
                change = np.rad2deg(np.abs(finer - solution.qpos).max())
                used = 1e3 * solution.settings["physics_dt"]
                found.append(Share(movement, 1e3 * dt, 1e3 * step, used, error, change))
    return found


def hcmc_share() -> str:
    rows = [
        (
            f"{x.movement}, {x.window:g}", f"{x.asked:g}", f"{x.used:.3g}", digits(x.tracking), digits(x.integration),
            digits(100 * x.integration / x.tracking, 2),
        )
        for x in shares()
    ]  # fmt: skip
    header = [
        "movement, dt in ms", "physics step asked, ms", "used, ms", "max tracking error, deg",
        "changed by steps of .1 ms, deg", "share, %",
    ]  # fmt: skip
    return f"### HCMC: its tracking error, and what of the plant's motion is integration error\n\n{grid(header, rows)}"


@cache
def nudged() -> dict[str, tuple[float, float]]:
    """By movement: deg of difference an open-loop and a controlled movement end up with, per deg at the start."""
    model, found = mjhcmc.MuscleModel.load("leg8"), {}
    for movement in convergence.MOVEMENTS:
        motion = mjhcmc.Motion.cosine(model, movement)
        solution = mjhcmc.hcmc(model, motion)
        moved = solution.qpos.copy()
        moved[0] += NUDGE
        other = dataclasses.replace(solution, qpos=moved)
        open_loop = np.abs(mjhcmc.replay(other) - mjhcmc.replay(solution)).max() / NUDGE
        kept = {"initial_qvel": solution.qvel[0], "initial_activation": solution.activation[0]}
        pair = [mjhcmc.hcmc(model, motion, initial_qpos=q, **kept) for q in (solution.qpos[0], moved[0])]
        found[movement] = open_loop, np.abs(pair[1].qpos - pair[0].qpos).max() / NUDGE
    return found


def amplification() -> str:
    rows = [(movement, figure(a), figure(b)) for movement, (a, b) in nudged().items()]
    header = ["movement", "open loop (replay)", "under HCMC"]
    return (
        "### What muscles make of a small difference\n\n"
        f"Largest difference later on over one of {NUDGE:g} rad in every joint at the start; dt 10 ms.\n\n"
        f"{grid(header, rows)}"
    )


def hcmc_curves() -> dict[str, tuple[list[float], list[float]]]:
    curves = {}
    for movement in convergence.MOVEMENTS:
        window = [1e3 * dt for dt in convergence.WINDOWS]
        curves[f"tracking, {movement}"] = window, convergence.errors(movement)[0].max(axis=1).tolist()
    for movement in convergence.MOVEMENTS:
        mine = {x.used: x.integration for x in shares() if x.movement == movement and x.window == 10.0}
        steps = sorted(mine)
        curves[f"integration, {movement}, dt 10 ms"] = steps, [mine[s] for s in steps]
    return curves

"""Tracking error of the muscle-driven leg against the control window, and its order, as Markdown.

    python benchmarks/convergence.py [--write [DOCUMENT]]

--write replaces the tables in docs/accuracy.md (or DOCUMENT) and draws convergence.png beside it.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from _markdown import JOINTS, digits, grid, main, save_png
from numpy.typing import NDArray

import mjhcmc
from mjhcmc.plotting import convergence_figure

WINDOWS = (0.02, 0.01, 0.005, 0.0025)
MOVEMENTS = ("slow", "fast")
FLOOR_DEG = 1e-6  # below it an order says nothing: rounding, and the motion's spline


@cache
def errors(movement: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Max tracking error (n, nv) deg for each window, and the physics step used (n,) s."""
    model = mjhcmc.MuscleModel.load("leg8")
    motion = mjhcmc.Motion.cosine(model, movement)
    solutions = [mjhcmc.hcmc(model, motion, dt=dt) for dt in WINDOWS]
    largest = [np.rad2deg(np.abs(solution.tracking_error).max(axis=0)) for solution in solutions]
    return np.array(largest), np.array([solution.settings["physics_dt"] for solution in solutions])


def markdown() -> str:
    return "\n\n".join(table(movement) for movement in MOVEMENTS)


def table(movement: str) -> str:
    error, step = errors(movement)
    order = np.full_like(error, np.nan)
    halvings = np.log2(np.array(WINDOWS[:-1]) / np.array(WINDOWS[1:]))
    order[1:] = np.log2(error[:-1] / error[1:]) / halvings[:, None]
    rows = [
        (
            f"{1e3 * dt:g}",
            f"{1e3 * step[i]:.3g}",
            *(digits(value) for value in error[i]),
            *(order_of(order[i, j], error[i, j]) for j in range(len(JOINTS))),
        )
        for i, dt in enumerate(WINDOWS)
    ]
    header = ["dt, ms", "physics step, ms", *(f"{j} max error, deg" for j in JOINTS), *(f"{j} order" for j in JOINTS)]
    return f"**{movement}**: {judgement(error, order)}\n\n{grid(header, rows)}"


def order_of(order: float, error: float) -> str:
    if not np.isfinite(order):
        return "–"
    return f"{order:.1f}" + (" (floor)" if error < FLOOR_DEG else "")


def judgement(error: NDArray[np.float64], order: NDArray[np.float64]) -> str:
    """In words where the order is 2 or better, and where it is not."""
    overall = f"The largest error of all joints falls at order {', '.join(f'{v:.1f}' for v in whole(error))}"
    above = error[1:] >= FLOOR_DEG
    short = [
        f"{JOINTS[j]} from {1e3 * WINDOWS[i]:g} to {1e3 * WINDOWS[i + 1]:g} ms ({order[i + 1, j]:.2f})"
        for i, j in np.argwhere((order[1:] < 2) & above)
    ]
    if short:
        return f"{overall}. Joint by joint it is below 2 for {'; '.join(short)}, else 2 or better."
    return f"{overall}; joint by joint it is 2 or better at every halving."


def whole(error: NDArray[np.float64]) -> NDArray[np.float64]:
    """Observed orders of the largest error of all joints."""
    largest = error.max(axis=1)
    return np.asarray(np.log(largest[:-1] / largest[1:]) / np.log(np.array(WINDOWS[:-1]) / np.array(WINDOWS[1:])))


def figures(folder: Path) -> None:
    error, _ = errors("slow")
    title = "leg8, slow cosine movement: largest tracking error against the control window"
    save_png(convergence_figure(WINDOWS, error, JOINTS, title), folder / "convergence.png")


if __name__ == "__main__":
    main("convergence.py", "Tracking error against the control window, and its order.", markdown, figures)

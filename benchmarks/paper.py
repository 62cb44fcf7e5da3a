"""The paper's claims beside what is measured here, as Markdown.

    python benchmarks/paper.py [--write [DOCUMENT]]

--write replaces the tables in docs/paper.md (or DOCUMENT) and draws methods.png beside it.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from _markdown import JOINTS, ROOT, digits, grid, save_png
from _markdown import main as run_script
from numpy.typing import ArrayLike, NDArray

import mjhcmc
from mjhcmc.methods import find_method
from mjhcmc.opensim_reference import find_reference, read_reference
from mjhcmc.paper import DT, HARD_MUSCLES, MOVEMENT, PAPER
from mjhcmc.plotting import excitation_figure

OPENSIM_GAINS = {"kp": 100.0, "kv": 20.0}
REST = 0.01


@cache
def solve(movement: str, method: str, options: tuple[tuple[str, Any], ...] = ()) -> mjhcmc.Solution:
    model = mjhcmc.MuscleModel.load("leg8")
    return find_method(method)(model, mjhcmc.Motion.cosine(model, movement), dt=DT, **dict(options))


def opensim_gains(movement: str) -> mjhcmc.Solution:
    return solve(movement, "cmc", tuple(OPENSIM_GAINS.items()))


def markdown() -> str:
    return "\n\n".join(
        [
            "### Table 2, set beside ours\n\n" + table_2(),
            "### HCMC against CMC\n\n" + ratios(),
            "### How long is the movement?\n\n" + peaks(),
            "### Root or mean square?\n\n" + roots(),
            "### The start\n\n" + starts(),
            "### What static optimization leaves out\n\n" + unreachable(),
        ]
    )


def degrees(solution: mjhcmc.Solution) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Largest error and RMSE by joint, deg."""
    error = np.rad2deg(solution.tracking_error)
    return np.abs(error).max(axis=0), np.sqrt((error**2).mean(axis=0))


def cells(values: ArrayLike, n: int = 3) -> list[str]:
    return [digits(float(value), n) for value in np.ravel(values)]


def table_2() -> str:
    rows = [
        (f"paper, {name.upper()}", *cells(p.max_error_deg, 5), *cells(p.rmse_deg, 5), *cells(np.square(p.rmse_deg)))
        for name, p in PAPER.items()
    ]
    ours = {
        "**HCMC here**": solve(MOVEMENT, "hcmc"),
        "**CMC here**": solve(MOVEMENT, "cmc"),
        "CMC here, OpenSim's gains (kp 100, kv 20)": opensim_gains(MOVEMENT),
        "static optimization here, open loop": solve(MOVEMENT, "static"),
    }
    for name, solution in ours.items():
        largest, root = degrees(solution)
        rows.append((name, *cells(largest), *cells(root), *cells(root**2)))
    header = ["deg, deg²"]
    for what in ("max", "RMSE", "MSE"):
        header += [f"{joint} {what}" for joint in JOINTS]
    return grid(header, rows)


def ratios() -> str:
    paper = np.divide(PAPER["hcmc"].max_error_deg, PAPER["cmc"].max_error_deg)
    rows = [("paper, Table 2", *cells(100 * paper))]
    for movement in ("fast", "slow"):
        own = degrees(solve(movement, "hcmc"))[0]
        for name, peer in (("tuned CMC", solve(movement, "cmc")), ("CMC, kp 100, kv 20", opensim_gains(movement))):
            rows.append((f"{movement}, HCMC over {name}", *cells(100 * own / degrees(peer)[0])))
    return grid(("ratio of the largest errors, %", *JOINTS), rows)


def peaks() -> str:
    solutions = {f"{movement}, {period} s a cycle": solve(movement, "hcmc") for movement, period in PERIODS.items()}
    names = next(iter(solutions.values())).muscle_names
    rows = [
        (
            f"**{name}**" if name in HARD_MUSCLES else name,
            *(f"{s.excitation.max(axis=0)[i]:.2f}" for s in solutions.values()),
        )
        for i, name in enumerate(names)
    ]
    return grid(("peak excitation (in bold: above .5 by the paper)", *solutions), rows)


PERIODS = {"fast": 0.2, "slow": 0.6}


def roots() -> str:
    rows = [
        (
            f"paper, {name.upper()}",
            *cells(p.rmse_deg, 5),
            *cells(np.sqrt(p.rmse_deg), 4),
            *cells(p.max_error_deg, 5),
            " ".join(j for j, r, m in zip(JOINTS, np.sqrt(p.rmse_deg), p.max_error_deg, strict=True) if r > m)
            or "none",
        )
        for name, p in PAPER.items()
    ]
    header = (
        "",
        *(f"{j} e_RMSE" for j in JOINTS),
        *(f"its root, {j}" for j in JOINTS),
        *(f"{j} max" for j in JOINTS),
        "root above max at",
    )
    return grid(header, rows)


def starts() -> str:
    rows = []
    for movement in ("fast", "slow"):
        for name, options in (("solved for", ()), (f"at rest ({REST:g})", (("initial_activation", REST),))):
            solution = solve(movement, "hcmc", options)
            largest, _ = degrees(solution)
            share = 100 * np.array(solution.verdict.peak_reserve_share)
            rows.append((f"{movement}, {name}", *cells(largest), *cells(share, 2)))
    header = ("initial activation", *(f"{j} max, deg" for j in JOINTS), *(f"{j} reserve, % of peak" for j in JOINTS))
    return grid(header, rows)


def unreachable() -> str:
    rows = []
    for movement in ("fast", "slow"):
        solution = solve(movement, "static")
        clipped = (solution.excitation <= 0) | (solution.excitation >= 1)
        windows = clipped.any(axis=1)
        rows.append((movement, *cells([100 * clipped.mean(), 100 * windows.mean()]), *cells(degrees(solution)[0])))
    header = ("", "excitations at 0 or 1, %", "windows with one, %", *(f"{joint} drift, deg" for joint in JOINTS))
    return grid(header, rows)


def figures(folder: Path) -> None:
    overlay = None
    if find_reference() is not None:
        overlay = {"OpenSim 4.6 CMC": read_reference(mjhcmc.MuscleModel.load("leg8"), MOVEMENT).activity}
    solutions = {name: solve(MOVEMENT, name) for name in ("hcmc", "cmc", "static")}
    save_png(excitation_figure(solutions, overlay), folder / "methods.png")


if __name__ == "__main__":
    run_script("paper.py", "The paper's claims and what is measured.", markdown, figures, ROOT / "docs" / "paper.md")

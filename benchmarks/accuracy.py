"""The cosine movements: what was to be reached, what is measured, what others report, as Markdown.

    python benchmarks/accuracy.py [--write [DOCUMENT]]

--write replaces the tables in docs/accuracy.md (or DOCUMENT) and draws excitations.png and tracking.png beside it.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from _markdown import JOINTS, digits, grid, main, save_png
from numpy.typing import ArrayLike, NDArray
from opensim_agreement import tracking_error

import mjhcmc
from mjhcmc.opensim_reference import read_reference
from mjhcmc.paper import HARD_MUSCLES, PAPER
from mjhcmc.plotting import excitation_figure, tracking_figure

CASES = (("fast", 0.01), ("fast", 0.005), ("slow", 0.01), ("slow", 0.005))

TO_REACH = {
    ("fast", 0.01): (0.01, 0.03, 0.2),
    ("fast", 0.005): (1e-3, 2e-3, 1.7e-2),
    ("slow", 0.01): (1e-3, 2e-3, 1e-2),
    ("slow", 0.005): (1e-4, 2e-4, 2e-3),
}
"""Max error hip/knee/ankle, deg, that the project set itself before it began."""

RESERVE_TO_REACH = 1.0  # % of the peak net joint moment
REPLAY_TO_REACH = {"fast": 0.1, "slow": 0.02}  # deg
CHANGE_TO_REACH = {"fast": None, "slow": 0.01}

HARD = 0.5

STORED_DT = 0.01  # s, window of OpenSim's stored runs
STATED = {("fast", 0.005): (0.018, 0.049, 0.017)}
"""OpenSim's CMC where its run was not stored: max error, deg, as shared/reference/opensim_cmc/README.md states it."""


@cache
def solve(movement: str, dt: float) -> mjhcmc.Solution:
    model = mjhcmc.MuscleModel.load("leg8")
    return mjhcmc.hcmc(model, mjhcmc.Motion.cosine(model, movement), dt=dt)


def markdown() -> str:
    return "\n\n".join(
        [
            "### Tracking error, degrees\n\n" + tracking(),
            "### Reserves, replay, smoothness\n\n" + checks(),
            "### Peak excitation\n\n" + peaks(),
        ]
    )


def tracking() -> str:
    rows: list[tuple[str, ...]] = []
    for movement, dt in CASES:
        solution = solve(movement, dt)
        case = f"{movement}, {1e3 * dt:g} ms"
        error = np.rad2deg(solution.tracking_error)
        largest = np.abs(error).max(axis=0)
        met = " (reached)" if (largest <= TO_REACH[movement, dt]).all() else " (MISSED)"
        rows.append((case, "**mjhcmc HCMC**", *(f"**{digits(v)}**" for v in largest), *cells(rms(error))))
        rows.append((case, f"to reach{met}", *cells(TO_REACH[movement, dt]), *"   "))
        if (movement, dt) == ("fast", 0.01):
            for method, reported in PAPER.items():
                figures = cells((*reported.max_error_deg, *reported.rmse_deg), 5)
                rows.append((case, f"paper, {method.upper()}", *figures))
        opensim = opensim_cmc(movement, dt)
        if opensim:
            rows.append((case, f"OpenSim 4.6 CMC, {1e3 * dt:g} ms look-ahead", *opensim))
    header = ("movement, dt", "", *(f"{joint} max" for joint in JOINTS), *(f"{joint} RMSE" for joint in JOINTS))
    return grid(header, rows)


def opensim_cmc(movement: str, dt: float) -> list[str]:
    """Max error and RMSE of OpenSim 4.6's own CMC from its stored run; none where that is not at hand.

    It ran on the source model of leg8 (Millard muscles, compliant tendons) with kp 100, kv 20, reserves of 1 N m.
    """
    run = read_reference(mjhcmc.MuscleModel.load("leg8"), movement) if dt == STORED_DT else None
    if run is not None:
        error = tracking_error(run, movement)
        return cells((*np.abs(error).max(axis=0), *rms(error)))
    return [*cells(STATED[movement, dt]), *"   "] if (movement, dt) in STATED else []


def rms(error: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.sqrt((error**2).mean(axis=0)))


def cells(values: ArrayLike, n: int = 3) -> list[str]:
    return [digits(float(value), n) for value in np.asarray(values)]


def checks() -> str:
    rows = []
    for movement, dt in CASES:
        solution = solve(movement, dt)
        verdict = solution.verdict
        assert verdict.replay_max_error is not None
        change = float(np.abs(np.diff(solution.excitation, axis=0)).mean())
        limit = CHANGE_TO_REACH[movement]
        rows.append(
            (
                f"{movement}, {1e3 * dt:g} ms",
                "/".join(cells(100 * np.array(verdict.peak_reserve_share), 2)),
                f"{RESERVE_TO_REACH:g}",
                "/".join(cells(np.rad2deg(verdict.replay_max_error), 2)),
                f"{REPLAY_TO_REACH[movement]:g}",
                digits(change, 2),
                "–" if limit is None else f"{limit:g}",
                "holds" if verdict.passed else "FAILS",
            )
        )
    joints = "/".join(JOINTS)
    return grid(
        (
            "movement, dt",
            f"peak reserve {joints}, % of peak moment",
            "to reach",
            f"open-loop replay error {joints}, deg",
            "to reach",
            "mean abs(Δu) a window",
            "to reach",
            "verdict",
        ),
        rows,
    )


def peaks() -> str:
    solutions = {f"{movement}, {1e3 * dt:g} ms": solve(movement, dt) for movement, dt in CASES}
    names = next(iter(solutions.values())).muscle_names
    largest = {case: solution.excitation.max(axis=0) for case, solution in solutions.items()}
    table = grid(
        ("muscle", *largest),
        ((name, *(f"{values[i]:.2f}" for values in largest.values())) for i, name in enumerate(names)),
    )
    hard = [
        f"{case}: {', '.join(name for name, peak in zip(names, values, strict=True) if peak > HARD) or 'none'}"
        for case, values in largest.items()
    ]
    return f"Above {HARD:g}: {'; '.join(hard)}. The paper names {', '.join(HARD_MUSCLES)} on fast.\n\n{table}"


def figures(folder: Path) -> None:
    solution = solve("fast", 0.01)  # the paper's window, and the README's
    save_png(excitation_figure(solution), folder / "excitations.png")
    save_png(tracking_figure(solution), folder / "tracking.png")


if __name__ == "__main__":
    main("accuracy.py", "The cosine movements: to reach, measured, and what others report.", markdown, figures)

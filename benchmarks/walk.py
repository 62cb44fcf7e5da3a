"""The walking trial from end to end: tracking, joint moments, activations beside OpenSim's, what changes them.

    python benchmarks/walk.py [--write [DOCUMENT]]

--write replaces the tables in docs/walking.md (or DOCUMENT) and draws walking.png beside it. Needs the trial
(shared/walk) beside the checkout. OpenSim's activations are in tests/data/walk/opensim_cmc.csv (_walk_opensim.py).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import _bare
import numpy as np
from _markdown import JOINTS, ROOT, digits, grid, main, save_png
from _timing import alternate, ratios, spread, walls
from _walk_cases import (
    OPENSIM,
    RAW,
    Array,
    against,
    as_run,
    inputs,
    moment_share,
    of_joints,
    opensim_cmc,
    opensim_moments,
    solve,
    with_floor,
)
from _walk_figure import walk_figure

import mjhcmc
from mjhcmc.leg8.table import ROOT_JOINTS
from mjhcmc.sharing import COSTS
from mjhcmc.verify import replay_windows

CASES: dict[str, dict[str, Any]] = {
    "right, fixed knee, 5 ms": {},
    "right, fixed knee, 10 ms": {"dt": 0.01},
    "right, moving knee, 5 ms": {"moving_knee": True},
    "right, moving knee, 10 ms": {"moving_knee": True, "dt": 0.01},
    "left, fixed knee, 5 ms": {"side": "left"},
}

MOMENTS_TO_REACH = {"fixed knee": (3, 2, 1), "moving knee": (1, 1, 0.5)}  # % of the peak, rms
TRACKING_TO_REACH, RESERVE_TO_REACH = 0.05, 1.0  # deg; % of the peak moment
PELVIS_TO_REACH = (0.01, 1e-3)  # mm, deg
TIME_TO_REACH = 0.5  # s

EFFECTS: dict[str, dict[str, dict[str, Any]]] = {
    "": {"**as above**": {}},
    "muscle": {
        "Millard's muscles, rigid tendons": {"tendon": "rigid"},
        "Millard's muscles, compliant tendons": {"tendon": "compliant"},
        "the same, cost capacity": {"tendon": "compliant", "cost": "capacity"},
        "no fiber damping": {"muscles": "undamped"},
        "MuJoCo's default curves, vmax kept": {"muscles": "curves"},
        "MuJoCo's default curves and vmax 1.5": {"muscles": "defaults"},
    },
    "cost": {f"cost {cost}": {"cost": cost} for cost in COSTS if cost != "effort"},
    "kinematics": {
        **{f"raw kinematics, low-pass {hz} Hz": {"kinematics": RAW, "lowpass": float(hz)} for hz in (6, 10, 15)},
    },
    "other": {
        "moving knee": {"moving_knee": True},
        "windows of 10 ms": {"dt": 0.01},
        "least activation 0": {"min_activation": 0.0},
        "CMC, 10 ms": {"method": "cmc", "dt": 0.01},
        "static optimization, 10 ms": {"method": "static", "dt": 0.01},
    },
}


def markdown() -> str:
    sections = {
        "Tracking, reserves, replay": tracking(),
        "Net joint moments against OpenSim's inverse dynamics": moments(),
        "The pelvis": pelvis(),
        "Activations beside OpenSim's CMC": activations(),
        "What changes the activations": effects(),
        "Time": times(),
    }
    return "\n\n".join(f"### {title}\n\n{text}" for title, text in sections.items())


def degrees(values: Array) -> str:
    return "/".join(digits(float(value), 2) for value in np.rad2deg(values))


def peak_error(solution: mjhcmc.Solution) -> Array:
    return np.abs(of_joints(solution, solution.tracking_error)).max(axis=0)


def reserve_share(solution: mjhcmc.Solution) -> Array:
    """(3,) % of the peak net moment."""
    peak = np.abs(of_joints(solution, solution.net_joint_moment)).max(axis=0)
    return np.asarray(100 * np.abs(of_joints(solution, solution.reserve)).max(axis=0) / peak)


def tracking() -> str:
    rows = []
    for case, settings in CASES.items():
        solution = solve(**settings)
        assert solution.model is not None
        same = replay_windows(solution, solution.settings["physics_dt"])
        finer = solution.verdict.replay_window_max_error
        assert finer is not None
        rows.append(
            (
                case,
                degrees(peak_error(solution)),
                "/".join(digits(float(share), 2) for share in reserve_share(solution)),
                digits(float(np.rad2deg(np.abs(same - solution.qpos).max())), 2),
                degrees(of_joints(solution, np.array(finer))),
                "/".join(f"{peak:.0f}" for peak in of_joints(solution, solution.peak_moment)),
                "holds" if solution.verdict.passed else "FAILS",
            )
        )
    reach = (f"{TRACKING_TO_REACH:g}", f"{RESERVE_TO_REACH:g}", "", "", "", "")
    rows.append(("*to reach*", *reach))
    joints = "/".join(JOINTS)
    header = (
        "leg, control window", f"max error {joints}, deg", "peak reserve, % of peak moment",
        "window replay, same physics step, deg", "window replay, 0.1 ms step, deg", "peak moment, N m", "verdict",
    )  # fmt: skip
    return grid(header, rows)


def moments() -> str:
    rows: list[tuple[str, ...]] = []
    for knee, to_reach in MOMENTS_TO_REACH.items():
        for dt in (0.005, 0.01):
            share = moment_share(solve(moving_knee=knee == "moving knee", dt=dt))
            met = (share <= np.array(to_reach)).all()
            rows.append((f"{knee}, {1e3 * dt:g} ms", *(f"{value:.2f}" for value in share), "yes" if met else "NO"))
        rows.append((f"{knee}, *to reach*", *(f"{value:g}" for value in to_reach), ""))
    peak = np.abs(opensim_moments(solve().time)).max(axis=0)
    rows.append(("OpenSim's peak, N m", *(f"{value:.0f}" for value in peak), ""))
    return grid(("root mean square, % of the peak", *JOINTS, "reached"), rows)


def pelvis() -> str:
    """How far it is from the motion, and what holds it there beside the leg."""
    solution = solve()
    rows = []
    for name in ROOT_JOINTS:
        j = solution.dof_names.index(name)
        turns = bool(solution.dof_is_rotation[j])
        error = np.abs(solution.tracking_error[:, j]).max()
        off = f"{digits(np.rad2deg(error), 2)} deg" if turns else f"{digits(1e3 * error, 2)} mm"
        reach = f"{PELVIS_TO_REACH[1]:g} deg" if turns else f"{PELVIS_TO_REACH[0]:g} mm"
        unit = "N m" if turns else "N"
        residual = solution.residual[:, j]
        root = np.sqrt((residual**2).mean())
        rows.append((name, off, reach, f"{np.abs(residual).max():.0f} {unit}", f"{root:.0f} {unit}"))
    return grid(("", "largest error", "to reach", "residual, peak", "residual, rms"), rows)


def cell(r: float) -> str:
    return "–" if np.isnan(r) else f"{r:.2f}"


def middle(values: Iterable[float]) -> float:
    there = [value for value in values if not np.isnan(value)]
    return float(np.median(there)) if there else np.nan


def activations() -> str:
    run = opensim_cmc()
    if run is None:
        return "OpenSim's activations (tests/data/walk/opensim_cmc.csv) were not there."
    columns = {
        "MuJoCo's": solve(),
        "Millard's": solve(tendon="compliant"),
        "capacity": solve(tendon="compliant", cost="capacity"),
    }
    found = {name: against(solution, run) for name, solution in columns.items()}
    rows = []
    for i, muscle in enumerate(run.muscle_names):
        ours = [
            text
            for name, solution in columns.items()
            for text in (
                cell(found[name][muscle][0]),
                f"{found[name][muscle][1]:.3f}",
                f"{solution.activation[:, solution.muscle_names.index(muscle)].max():.2f}",
            )
        ]
        rows.append((muscle, f"{run.activation[:, i].max():.2f}", *ours))
    medians = [
        text
        for one in found.values()
        for text in (cell(middle(r for r, _ in one.values())), f"{middle(e for _, e in one.values()):.3f}", "")
    ]
    rows.append(("**median**", "", *medians))
    header = ("muscle", "OpenSim peak", *(f"{name}: {what}" for name in columns for what in ("r", "RMS", "peak")))
    text = (
        "MuJoCo's: leg8's muscles as they are. Millard's: OpenSim's muscle with compliant tendons, on leg8's paths. "
        "Capacity: the same, with the cost that OpenSim's CMC has. All with a fixed knee and 5 ms windows."
    )
    return f"{text}\n\n{grid(header, rows)}"


def effects() -> str:
    base, run = as_run(solve()), opensim_cmc()
    rows = []
    for group in EFFECTS.values():
        for name, settings in group.items():
            solution = solve(**settings)
            cells = []
            for other in (base, run):
                found = against(solution, other) if other else {}
                r = [r for r, _ in found.values()]
                cells += [cell(middle(r)), cell(float(np.nanmean(r)) if r else np.nan)]
                cells.append(f"{middle(e for _, e in found.values()):.3f}")
            rows.append(
                (
                    name,
                    *cells,
                    f"{solution.activation.mean():.3f}",
                    f"{solution.activation.max():.2f}",
                    degrees(peak_error(solution)),
                    "/".join(digits(float(share), 2) for share in reserve_share(solution)),
                    "holds" if solution.verdict.passed else "FAILS",
                )
            )
    header = (
        "", "with the first row: median r", "mean r", "median RMS", "with OpenSim: median r", "mean r", "median RMS",
        "mean activation", "largest", f"max error {'/'.join(JOINTS)}, deg", "peak reserve, %", "verdict",
    )  # fmt: skip
    return grid(header, rows)


def times() -> str:
    """Warm, in turns with bare stepping; and what OpenSim took when its table was made."""
    rows = []
    for knee in ("fixed knee", "moving knee"):
        given = inputs(moving_knee=knee == "moving knee")
        for dt in (0.005, 0.01):
            settings = with_floor({"dt": dt})
            solution = mjhcmc.hcmc(**given, **settings)
            calls = {"solve": lambda g=given, s=settings: mjhcmc.hcmc(**g, **s), "bare": _bare.one(solution)}
            read = alternate(calls, 5)
            solved, bare = read["solve"], read["bare"]
            rows.append(
                (
                    f"{knee}, {1e3 * dt:g} ms",
                    spread(walls(solved)),
                    spread([one.cpu for one in solved]),
                    spread(walls(bare), 1e-3),
                    spread(ratios(solved, bare)),
                )
            )
    header = ("", "solve, s", "solve, s of CPU", "MuJoCo alone, ms", "solve / MuJoCo alone")
    text = f"Medians of 5, quartiles in brackets; to reach {TIME_TO_REACH:g} s.\n\n" + grid(header, rows)
    said = re.search(r"Seconds for .*? of CPU", OPENSIM.read_text(encoding="utf-8")) if OPENSIM.is_file() else None
    return text + (f"\n\nOpenSim's CMC on the whole model. {said.group()}." if said else "")


def figures(folder: Path) -> None:
    save_png(walk_figure(), folder / "walking.png")


if __name__ == "__main__":
    main(
        "walk.py",
        "The walking trial: tracking, joint moments, activations, what changes them.",
        markdown,
        figures,
        ROOT / "docs" / "walking.md",
    )

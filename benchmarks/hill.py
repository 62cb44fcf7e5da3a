"""The Hill model beside OpenSim's tables and CMC, HCMC on it, MuJoCo's muscles against it; as Markdown.

    python benchmarks/hill.py [--write [DOCUMENT]]

--write replaces the tables in docs/hill.md (or DOCUMENT) and draws hill.png beside it. Needs OpenSim's results
(shared/reference) beside the checkout. Times are measured by hill_speed.py.
"""

from __future__ import annotations

import warnings
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import _hill_tables
import numpy as np
from _markdown import ROOT, digits, grid, main, save_png
from accuracy import STATED, rms
from numpy.typing import ArrayLike, NDArray
from opensim_agreement import Agreement, compare, correlation, middle, reference, tracking_error

import mjhcmc
from mjhcmc import hill
from mjhcmc.cli_support import engine_notices
from mjhcmc.hill_muscles import hill_model
from mjhcmc.hosted.muscles import hosted_muscles
from mjhcmc.hosted.stages import muscles_at
from mjhcmc.methods import find_method, force_driver
from mjhcmc.muscle_choice import plant_for
from mjhcmc.muscle_comparison import MuscleComparison, compare_muscles
from mjhcmc.opensim_reference import CMC_FLOOR
from mjhcmc.plotting import excitation_figure

MOVEMENTS = ("fast", "slow")
WINDOWS = (0.01, 0.005)
TENDONS = ("compliant", "rigid")
TO_REACH = {"slow": (0.02, 0.04, 0.02), "fast": (0.04, 0.1, 0.1)}
"""Max error hip/knee/ankle, deg, that the project set itself before it began."""

ALIKE = 0.9  # correlation to reach
OTHER_CURVES = ("thelen", "degroote-fregly")
CURVES = {"millard": "Millard", "thelen": "Thelen", "degroote-fregly": "De Groote-Fregly"}
OPENSIM_DT = 0.01  # s, window of OpenSim's stored runs
GAIN = 2.7  # the default
PHYSICS_DT = 1e-3
RK4_LIMIT = 2.785
OFFSETS = (1.0, -1.0, 5.0, -5.0)  # deg
BACK = 1.5
ROUNDING = 1e-9

Shown = tuple[mjhcmc.Solution, tuple[str, ...]]


@cache
def leg() -> mjhcmc.MuscleModel:
    return mjhcmc.MuscleModel.load("leg8")


@cache
def solve(
    movement: str,
    dt: float,
    muscle: str,
    method: str = "hcmc",
    curves: str = "millard",
    physics_dt: float = PHYSICS_DT,
    **settings: Any,
) -> Shown:
    """A solution, and what was warned of on the way."""
    plant = plant_for(leg(), muscle, dt, physics_dt, curves)
    with warnings.catch_warnings(record=True) as told, engine_notices():
        warnings.simplefilter("always")
        motion = mjhcmc.Motion.cosine(leg(), movement)
        solution = find_method(method)(leg(), motion, dt=dt, physics_dt=physics_dt, plant=plant, **settings)
    notices = tuple(dict.fromkeys(str(one.message) for one in told))
    return solution, tuple(text for text in notices if not text.startswith("MuJoCo:"))


def markdown() -> str:
    return "\n\n".join(
        [
            "### Against OpenSim's tables\n\n" + _hill_tables.table(),
            "### Tracking, max error hip/knee/ankle, degrees\n\n" + tracking(),
            "### HCMC: reserves, replay, smoothness\n\n" + checks(),
            "### Other curves, HCMC, dt 10 ms\n\n" + others(),
            "### How fast a fiber comes to rest, and the physics step\n\n" + decay(),
            *(f"### Activation beside OpenSim's CMC, {m}\n\n" + activations(m) for m in MOVEMENTS),
            *(f"### MuJoCo's muscles and the Hill model, {m}\n\n" + difference(m) for m in MOVEMENTS),
            "### Look-ahead and gain, compliant tendons\n\n" + look_ahead(),
            "### Starts off the movement, compliant tendons\n\n" + coming_back(),
        ]
    )


def largest(solution: mjhcmc.Solution) -> NDArray[np.float64]:
    """(3,) deg."""
    return np.asarray(np.rad2deg(np.abs(solution.tracking_error).max(axis=0)))


def joined(values: ArrayLike, n: int = 3) -> str:
    return "/".join(plain(float(value), n) for value in np.asarray(values))


def plain(value: float, n: int = 3) -> str:
    """As `digits`, without powers of ten where it is large; rounding is nothing."""
    return f"{value:.0f}" if abs(value) >= 10**n or abs(value) < ROUNDING else digits(value, n)


def case(movement: str, dt: float, muscle: str) -> str:
    return f"{movement}, {1e3 * dt:g} ms, {muscle}"


def verdict_of(error: NDArray[np.float64], movement: str) -> str:
    return "reached" if (error <= TO_REACH[movement]).all() else "MISSED"


def tracking() -> str:
    rows = []
    for movement in MOVEMENTS:
        for dt in WINDOWS:
            for muscle in TENDONS:
                error = largest(solve(movement, dt, muscle)[0])
                peers = [joined(largest(solve(movement, dt, muscle, m)[0])) for m in ("cmc", "static")]
                rows.append(
                    (
                        case(movement, dt, muscle),
                        f"**{joined(error)}**",
                        f"{joined(TO_REACH[movement])} ({verdict_of(error, movement)})",
                        *peers,
                        opensim_error(movement, dt) if muscle == "compliant" else "",
                    )
                )
    header = ("movement, dt, tendons", "HCMC", "to reach", "CMC", "static", "OpenSim 4.6 CMC, the same muscles")
    return grid(header, rows)


def opensim_error(movement: str, dt: float) -> str:
    """From its stored run; where that is missing, as stated with it."""
    if dt == OPENSIM_DT:
        return joined(np.abs(tracking_error(reference(movement, "cmc"), movement)).max(axis=0))
    return joined(STATED[movement, dt]) if (movement, dt) in STATED else ""


def checks() -> str:
    rows = []
    for movement in MOVEMENTS:
        for dt in WINDOWS:
            for muscle in TENDONS:
                cmc = solve(movement, dt, muscle, "cmc")[0]
                share = 100 * np.abs(cmc.reserve).max(axis=0) / cmc.peak_moment
                rows.append((case(movement, dt, muscle), *figures_of(solve(movement, dt, muscle)[0]), joined(share, 2)))
    return grid(("movement, dt, tendons", *FIGURES, "CMC's peak reserve, %"), rows)


FIGURES = (
    "RMSE hip/knee/ankle, deg",
    "peak reserve, % of peak moment",
    "open-loop replay error, deg",
    "mean abs(Δu) a window",
    "verdict",
)


def figures_of(solution: mjhcmc.Solution) -> tuple[str, ...]:
    verdict = solution.verdict
    assert verdict.replay_max_error is not None
    return (
        joined(rms(np.rad2deg(solution.tracking_error))),
        joined(100 * np.array(verdict.peak_reserve_share), 2),
        joined(np.rad2deg(verdict.replay_max_error), 2),
        digits(float(np.abs(np.diff(solution.excitation, axis=0)).mean()), 2),
        "holds" if verdict.passed else "FAILS",
    )


def others() -> str:
    rows, notices = [], []
    for movement in MOVEMENTS:
        for curves in OTHER_CURVES:
            for muscle in TENDONS:
                solution, told = solve(movement, OPENSIM_DT, muscle, curves=curves)
                name = f"{movement}, {CURVES[curves]}, {muscle}"
                error = largest(solution)
                rows.append((name, f"{joined(error)} ({verdict_of(error, movement)})", *figures_of(solution)))
                notices += [f"{name}: “{text}”." for text in told]
    table = grid(("movement, curves, tendons", "max error hip/knee/ankle, deg", *FIGURES), rows)
    return "\n\n".join([table, *notices])


def decay() -> str:
    """Fastest decay rate of a compliant fiber at a fixed path, and what a coarse physics step does."""
    rows = []
    for curves, title in CURVES.items():
        cells = []
        for movement in MOVEMENTS:
            solution = solve(movement, OPENSIM_DT, "compliant", curves=curves)[0]
            plant, rates = solution.plant(), []
            for k in range(solution.n_window + 1):
                plant.set_state(solution.state(k))
                plant.forward()
                rates.append(plant.internal_rate())
            coarse, told = solve(movement, OPENSIM_DT, "compliant", curves=curves, physics_dt=2 * PHYSICS_DT)
            cells += [f"{max(rates):.0f}", joined(largest(coarse)) + (" (solved again)" if told else "")]
        rows.append((title, *decay_at_rest(curves), *cells))
    header = ["curves", "fastest decay at rest, 1/s", "of"]
    for movement in MOVEMENTS:
        header += [f"along {movement}, 1/s", f"{movement}, physics step {2e3 * PHYSICS_DT:g} ms: max error, deg"]
    limits = ", ".join(f"{RK4_LIMIT / (1e-3 * h):.0f} at {h} ms" for h in (1, 2))
    return f"{grid(header, rows)}\n\nA Runge-Kutta step h is stable up to {RK4_LIMIT:g}/h, 1/s: {limits}."


def decay_at_rest(curves: str) -> tuple[str, str]:
    """Over leg8's muscles in static equilibrium, lengths and activations of OpenSim's table."""
    muscles = hosted_muscles(leg(), curves)
    m, best = muscles.hill.muscles, (0.0, "")
    length = m.tendon_slack_length + np.linspace(0.6, 1.4, 17)[:, None] * m.optimal_fiber_length * np.cos(
        m.pennation_at_optimal
    )
    n = length.shape[1]
    force, gain, bias, slopes = np.empty(n), np.empty(n), np.empty(n), np.empty((n, 4))
    for a in (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0):
        fiber = hill.static_equilibrium(muscles.hill, a, length).fiber_length
        for x, path, lengths in zip(np.linspace(0.6, 1.4, 17), length, fiber, strict=True):
            given = muscles.kind, muscles.curves, muscles.parameters, np.full(n, a), lengths, path, np.zeros(n)
            muscles_at(*given, force, gain, bias, slopes)
            i = int(slopes[:, 2].argmin())
            best = max(best, (-float(slopes[i, 2]), f"{m.names[i]}, a {a:g}, x {x:.2g}"))
    return f"{best[0]:.0f}", best[1]


LABELS = {"compliant": "compliant", "rigid": "rigid", "mujoco": "MuJoCo's"}


def activations(movement: str) -> str:
    """r and RMS difference by muscle; all with OpenSim's least activation."""
    run, found = reference(movement, "cmc"), {}
    for muscle in LABELS:
        for method in ("hcmc", "cmc"):
            ours = solve(movement, OPENSIM_DT, muscle, method, min_activation=CMC_FLOOR)[0]
            found[muscle, method] = compare(ours, run, CMC_FLOOR)
    columns = list(found.values())
    names = leg().muscle_names
    rows = [
        (name, *(f"{v:.2f}" for v in (columns[0][i].theirs, columns[0][i].ours)), *(_alike(f[i]) for f in columns))
        for i, name in enumerate(names)
    ]
    rows.append(("**median**", "", "", *(_middle(f) for f in columns)))
    titles = [f"{LABELS[muscle]}, {method.upper()}: r, RMS" for muscle, method in found]
    table = grid(("muscle", "OpenSim's peak", "peak, compliant HCMC", *titles), rows)
    told = []
    for method in ("hcmc", "cmc"):
        pairs = list(zip(names, found["compliant", method], strict=True))
        short = [f"{name} ({one.r:.2f})" for name, one in pairs if one.r <= ALIKE]
        idle = [name for name, one in pairs if np.isnan(one.r)]
        over = len(names) - len(short) - len(idle)
        told.append(
            f"{method.upper()} on compliant tendons, r over {ALIKE:g}: {over} of {len(names)} muscles; "
            f"{'MISSED by ' + ', '.join(short) if short else 'no muscle that works misses it (reached)'}; "
            f"hardly above the floor: {', '.join(idle) or 'none'}."
        )
    return f"{table}\n\n" + "\n\n".join(told)


def _alike(one: Agreement) -> str:
    return f"{correlation(one.r)}, {one.rms:.3f}"


def _middle(found: list[Agreement]) -> str:
    return f"{correlation(middle(one.r for one in found))}, {middle(one.rms for one in found):.3f}"


@cache
def comparison(movement: str) -> MuscleComparison:
    return compare_muscles(solve(movement, OPENSIM_DT, "mujoco")[0], hill_model(leg()))


def difference(movement: str) -> str:
    """Of force, of what excitation would make up for it, and of moments; `mjhcmc compare-muscles` prints more."""
    values = comparison(movement).numbers()

    def of(row: dict[str, Any], *keys: str, n: int = 2) -> str:
        return " / ".join("–" if row[key] is None else plain(row[key], n) for key in keys)

    rows = []
    for name, row in values["muscles"].items():
        forces = [of(row, f"{tendon}_rms_percent_f0", f"{tendon}_max_percent_f0") for tendon in ("rigid", "compliant")]
        needs = [of(row, f"needed_{what}_rms", f"needed_{what}_max") for what in ("activation", "excitation")]
        none = [f"{100 * row[f'{what}_not_reachable']:.0f}" for what in ("activation", "excitation")]
        rows.append((name, of(row, "mujoco_least_force_n", "mujoco_peak_force_n", n=3), *forces, *needs, *none))
    muscles = grid(
        (
            "muscle",
            "MuJoCo's least / peak force, N",
            "rigid: RMS / max, % F0",
            "compliant: RMS / max, % F0",
            "Δa RMS / max",
            "Δu RMS / max",
            "no a, % of time",
            "no u, % of windows",
        ),
        rows,
    )
    rows = [
        (joint, digits(row["peak_moment_nm"]), *(of(row, f"{t}_rms_nm", f"{t}_max_nm") for t in ("rigid", "compliant")))
        for joint, row in values["joints"].items()
    ]
    joints = grid(("joint", "peak moment, N m", "rigid: RMS / max, N m", "compliant: RMS / max, N m"), rows)
    return f"{muscles}\n\n{joints}"


def look_ahead() -> str:
    """Ankle and smoothness by look-ahead and by gain; the defaults in bold."""
    rows = [variant(name, share, GAIN) for name, share in (("T = dt", 1.0), ("T = 2 dt", 2.0))]
    rows.insert(1, variant("**T = max(10 ms, 1.2 dt)**", None, GAIN))
    rows += [variant("T = max(10 ms, 1.2 dt)", None, gain) for gain in (1.5, 2.0)]
    header = ["look-ahead", "gain"]
    for movement in MOVEMENTS:
        for dt in WINDOWS:
            header += [f"{movement}, {1e3 * dt:g} ms: ankle max, deg", "mean abs(Δu)"]
    return grid(header, rows)


def variant(name: str, share: float | None, gain: float) -> list[str]:
    """One row; share None: the look-ahead as it is."""
    found = [name, f"{gain:g}"]
    for movement in MOVEMENTS:
        for dt in WINDOWS:
            try:
                solution = ahead(movement, dt, share, gain)
            except mjhcmc.SimulationError:
                found += ["fails", ""]
                continue
            found += [
                digits(largest(solution)[2]),
                digits(float(np.abs(np.diff(solution.excitation, axis=0)).mean()), 2),
            ]
    return found


def ahead(movement: str, dt: float, share: float | None, gain: float) -> mjhcmc.Solution:
    if share is None:
        return solve(movement, dt, "compliant", gain=gain)[0] if gain != GAIN else solve(movement, dt, "compliant")[0]
    with patch.object(force_driver, "_LOOK_AHEAD", 0.0), patch.object(force_driver, "_WINDOWS_AHEAD", share):
        return solve.__wrapped__(movement, dt, "compliant")[0]


def coming_back() -> str:
    """Whether the leg comes back from starts off the movement, at all joints at once: errors of the last third."""
    rows = []
    for movement in MOVEMENTS:
        for dt in WINDOWS:
            cells = [f"{movement}, {1e3 * dt:g} ms"]
            for reserves in (True, False):
                found = [last_third(movement, dt, offset, reserves) for offset in OFFSETS]
                nominal = largest(solve(movement, dt, "compliant")[0])
                back = sum(bool((error <= BACK * nominal).all()) for error in found)
                cells += [f"{back} of {len(found)}", joined(np.max(found, axis=0))]
            rows.append(cells)
    header = ["movement, dt"]
    for what in ("with reserves", "without"):
        header += [f"{what}: back", f"worst error of the last third {what}, hip/knee/ankle, deg"]
    told = ", ".join(f"{offset:+g}" for offset in OFFSETS)
    return grid(header, rows) + (
        f"\n\nStarts: {told} deg at every joint. Back: at most {BACK:g} times the largest error of the movement that "
        "starts on it."
    )


def last_third(movement: str, dt: float, offset: float, reserves: bool) -> NDArray[np.float64]:
    """(3,) deg."""
    model = leg()
    solution = mjhcmc.hcmc(
        model, mjhcmc.Motion.cosine(model, movement), dt=dt, initial_qpos=np.full(3, np.deg2rad(offset)),
        reserves=reserves, plant=mjhcmc.HillPlant(model),
    )  # fmt: skip
    error = np.abs(solution.tracking_error[2 * len(solution.time) // 3 :])
    return np.asarray(np.rad2deg(error.max(axis=0)))


def figures(folder: Path) -> None:
    ours = {
        title: solve("fast", OPENSIM_DT, muscle, min_activation=CMC_FLOOR)[0]
        for title, muscle in (("HCMC, compliant tendons", "compliant"), ("HCMC, MuJoCo's muscles", "mujoco"))
    }
    save_png(excitation_figure(ours, {"OpenSim 4.6 CMC": reference("fast", "cmc").activity}), folder / "hill.png")


if __name__ == "__main__":
    main(
        "hill.py",
        "HCMC on Hill muscles, and MuJoCo's muscles beside them.",
        markdown,
        figures,
        document=ROOT / "docs" / "hill.md",
    )

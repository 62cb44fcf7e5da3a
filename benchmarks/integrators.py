"""HCMC under each of MuJoCo's integrators: errors against time, what the design is worth, a walk, stiff models.

    python benchmarks/integrators.py [--write [DOCUMENT]]

--write replaces the tables in docs/integrators.md (or DOCUMENT) and draws integrators.png beside it. The last table
needs the `myo-sim` package, the walk the trial (shared/walk) beside the checkout.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING
from unittest.mock import patch

import numpy as np
from _bare import one
from _markdown import JOINTS, ROOT, digits, grid, main, save_png
from _timing import alternate, machine, quiet

import mjhcmc
from mjhcmc.integrators import SCHEMES, Scheme
from mjhcmc.methods import windows
from mjhcmc.methods.hcmc_driver import HcmcDriver

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DT = 0.01
STEPS = (0.005, 0.0025, 0.001, 0.0005)
MOVEMENTS = ("fast", "slow")
FINEST = 0.0005  # s, RK4's step that muscles are compared at
RUNS = 7
ASTRAY = 45.0  # deg: what misses by more follows nothing


@dataclass(frozen=True)
class Case:
    """One solve of the leg.

    Attributes:
        name: of the integrator.
        asked: s, physics_dt as asked for.
        used: s, as it was used; 0 where the step was refused.
        error: (nv,) deg, largest tracking error.
        reserve: N m, largest.
        muscles: largest difference of an activation from RK4's at its finest step.
        cpu: s, median.
        over_bare: of the same steps by mj_step alone, medians of CPU time.
        passed: the verdict.
        own: (nv,) deg, the verdict's `integrator_error`; empty under RK4.
        problem: what the refusal says.
    """

    name: str
    asked: float
    used: float = 0.0
    error: tuple[float, ...] = ()
    reserve: float = 0.0
    muscles: float = 0.0
    cpu: float = 0.0
    over_bare: float = 0.0
    passed: bool = False
    own: tuple[float, ...] = ()
    problem: str = ""


@cache
def leg() -> mjhcmc.MuscleModel:
    return mjhcmc.MuscleModel.load("leg8")


@cache
def motion(movement: str) -> mjhcmc.Motion:
    return mjhcmc.Motion.cosine(leg(), movement)


def solve(movement: str, name: str, step: float, *, off: float = 0.0, dt: float = DT) -> mjhcmc.Solution:
    """HCMC; off: deg, that every joint starts from where it should not."""
    start = motion(movement).qpos[0] + np.deg2rad(off)
    with quiet():
        return mjhcmc.hcmc(leg(), motion(movement), dt, step, initial_qpos=start, integrator=name)


def worst(solution: mjhcmc.Solution, after: float = 0.0) -> tuple[float, ...]:
    """Deg, by joint, from a time on."""
    late = solution.time >= solution.time[0] + after - 1e-9
    return tuple(np.rad2deg(np.abs(solution.tracking_error[late]).max(axis=0)).tolist())


def own_error(solution: mjhcmc.Solution) -> tuple[float, ...]:
    """Deg, what windows miss continuous time by; nothing under RK4."""
    return tuple(np.rad2deg(solution.verdict.integrator_error or ()).tolist())


@cache
def cases(movement: str) -> tuple[Case, ...]:
    """All integrators at all steps."""
    reference = solve(movement, "rk4", FINEST).activation
    found = []
    for name in SCHEMES:
        for step in STEPS:
            try:
                solution = solve(movement, name, step)
            except mjhcmc.SimulationError as error:
                found.append(Case(name, step, problem=str(error)))
                continue
            calls: dict[str, Callable[[], object]] = {
                "ours": lambda name=name, step=step: solve(movement, name, step), "bare": one(solution),
            }  # fmt: skip
            readings = alternate(calls, RUNS)
            ours, bare = (float(np.median([reading.cpu for reading in readings[name]])) for name in calls)
            found.append(Case(
                name, step, solution.settings["physics_dt"], worst(solution), float(np.abs(solution.reserve).max()),
                float(np.abs(solution.activation - reference).max()), ours, ours / bare,
                solution.verdict.passed, own_error(solution),
            ))  # fmt: skip
    return tuple(found)


def table(movement: str) -> str:
    rows = []
    for case in cases(movement):
        asked = f"{1e3 * case.asked:g}"
        if not case.used:
            rows.append((case.name, asked, "refused", *[""] * 8))
            continue
        used = asked if case.used == case.asked else f"{1e3 * case.used:.3g} (diverged above)"
        rows.append((
            case.name, asked, used, *(digits(value, 2) for value in case.error), f"{case.reserve:.0e}",
            digits(case.muscles, 2), " / ".join(digits(value, 2) for value in case.own),
            f"{1e3 * case.cpu:.0f}", f"{case.over_bare:.1f}",
            "passed" if case.passed else "failed",
        ))  # fmt: skip
    header = (
        "integrator", "physics step, ms", "used, ms", *(f"{joint}, deg" for joint in JOINTS), "peak reserve, N m",
        "muscles off RK4's", "own error, deg", "solve, ms of CPU", "over bare stepping", "verdict",
    )  # fmt: skip
    return f"**{movement}**, windows of {1e3 * DT:g} ms\n\n{grid(header, rows)}"


def order() -> str:
    """How fast muscles near RK4's, and how far they are beside RK4's own error, in words."""
    parts, times = [], []
    for movement in MOVEMENTS:
        for name in ("euler", "implicit", "implicitfast"):
            own = [c for c in cases(movement) if c.name == name and c.used == c.asked]
            pair = [c.muscles for c in own if c.asked in STEPS[-2:]]
            if len(pair) == 2:
                parts.append(f"{np.log2(pair[0] / pair[1]):.2f} ({name}, {movement})")
        at = {c.name: c.muscles for c in cases(movement) if c.asked == c.used == STEPS[2]}
        times += [off / at["rk4"] for name, off in at.items() if name != "rk4"]
    return (
        f"Order at which activations near RK4's, from 1 to .5 ms: {', '.join(parts)}.\n\n"
        f"At 1 ms the others' activations are {min(times):.0f} to {max(times):.0f} times as far off as RK4's own."
    )


@contextmanager
def without(what: str) -> Iterator[None]:
    """HCMC without one of its adaptations to integrators of first order."""
    if what == "velocities that lag":
        with patch.object(windows, "stepped", lambda each, step: each.reference):
            yield
    elif what == "the next step's acceleration":
        real = HcmcDriver.__init__

        def begin(self: HcmcDriver, *arguments: object) -> None:
            real(self, *arguments)  # type: ignore[arg-type]
            self._team.plants.acceleration = _at_the_state(self._team.plants)  # type: ignore[method-assign]

        with patch.object(HcmcDriver, "__init__", begin):
            yield
    elif what == "trials with the plant's step":
        with patch.object(HcmcDriver, "_trial", _coarse_trial):
            yield
    elif what == "gains and predictor":
        with patch.object(Scheme, "lag", lambda self, n_step: 0.0):
            yield
    else:
        yield


def _coarse_trial(self, here):  # type: ignore[no-untyped-def]
    """As RK4's: about twice the plant's step."""
    team = self._team
    n = (team.n_step + 1) // 2
    inputs = team.excitation[here.at], team.reserve[here.at]
    return team.plants.step(here.ids, here.rows, *inputs, n, team.n_step / n), team.dt / n, n


def _at_the_state(plants):  # type: ignore[no-untyped-def]
    """qacc of MuJoCo's forward dynamics, in place of the acceleration of the step that follows."""

    def acceleration(ids, rows, reserve):  # type: ignore[no-untyped-def]
        return plants.linearize(ids, rows, reserve).qacc

    return acceleration


def ablation() -> str:
    tried = (("euler", 0.001, DT), ("implicit", 0.001, DT), ("implicit", 0.005, DT), ("implicit", 0.005, 0.005))
    rows = []
    parts = (
        "velocities that lag",
        "the next step's acceleration",
        "gains and predictor",
        "trials with the plant's step",
    )
    for what in ("nothing", *parts):
        row = [what]
        for name, step, dt in tried:
            with without(what):
                try:
                    error = worst(solve("fast", name, step, dt=dt))
                    away = max(error) > ASTRAY
                    row.append("runs away" if away else " / ".join(digits(value, 2) for value in error))
                except mjhcmc.SimulationError:
                    row.append("diverges")
        rows.append(tuple(row))
    header = [f"{name}, {1e3 * step:g} ms in windows of {1e3 * dt:g} ms" for name, step, dt in tried]
    return grid(("left out", *header), rows)


def recovery() -> str:
    rows = []
    for movement, cycle in (("fast", 0.2), ("slow", 0.6)):
        for name, step in (("rk4", 0.001), ("euler", 0.001), ("implicit", 0.005), ("implicitfast", 0.005)):
            row = [movement, name, f"{1e3 * step:g}"]
            for off in (0.0, 1.0, 5.0):
                row.append(" / ".join(digits(value, 2) for value in worst(solve(movement, name, step, off=off), cycle)))
            rows.append(tuple(row))
    header = ("movement", "integrator", "physics step, ms", "right start", "1 deg off", "5 deg off")
    return grid(header, rows)


def roots() -> str:
    """Of the sampled error, in words: what dividing the gains is for."""
    import inspect

    gain = float(inspect.signature(mjhcmc.hcmc).parameters["gain"].default)
    x, y = 2 * gain * (1 - gain / 6), gain**2
    found = []
    for r, divisor in ((0.0, 1.0), (1.0, 1 + x / 2 + y / 6), (1.0, 1.0)):
        u, w = x / divisor, y / divisor
        a = 1 + (1 - r) * u / 2 + (1 - r**2) * w / 6
        z = np.roots([a, w - 2 * a + u, a - u])
        found.append(" and ".join(f"{abs(root):.2g}" for root in np.sort_complex(z)))
    return (
        f"At the default `gain` of {gain:g} the roots of the sampled error are {found[0]} in size under RK4, "
        f"{found[1]} with a first-order integrator at one step a window, and would be {found[2]} there with RK4's "
        "gains."
    )


WALK_SPAN, WALK_DT = (0.6, 1.0), 0.005
WALK_CASES = (
    ("rk4", 0.001), ("rk4", 0.0025), ("euler", 0.001), ("implicitfast", 0.001), ("implicitfast", 0.0025),
    ("implicitfast", 0.005),
)  # fmt: skip


def walk() -> str:
    """The measured walk: muscles and moments against RK4's, what ties miss, and what is told."""
    from _walk_cases import SMOOTH, WALK, model, of_joints

    from mjhcmc.external_loads import ExternalLoads

    if not WALK.is_dir():
        return "Left out: the trial (shared/walk) was not beside the checkout."
    rows = []
    for moving in (False, True):
        own = model(moving_knee=moving)
        loads = ExternalLoads.from_file(WALK / "subject01_walk_grf.xml", own, osim=WALK / "subject01.osim")
        move = mjhcmc.Motion.from_file(WALK / SMOOTH, own, start=WALK_SPAN[0], end=WALK_SPAN[1])

        def run(name: str, step: float) -> mjhcmc.Solution:
            return mjhcmc.hcmc(own, move, WALK_DT, step, integrator=name, loads=loads)  # noqa: B023

        with quiet():
            best = run("rk4", FINEST)
        for name, step in WALK_CASES:
            with quiet(), warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                solution = run(name, step)
            off = np.abs(solution.activation - best.activation).max(axis=1)
            moments = of_joints(solution, np.abs(solution.net_joint_moment - best.net_joint_moment).max(axis=0))
            share = 100 * moments / of_joints(best, best.peak_moment)
            missed = 0.0
            if own.coupling is not None:
                missed = np.abs(own.coordinates.difference(solution.qpos, own.coupling.project(solution.qpos))).max()
            words = " ".join(str(each.message) for each in told)
            said = [word for word, sign in (("ties", "equalities"), ("finer step", "solved again")) if sign in words]
            error = solution.verdict.integrator_error
            rows.append((
                "moving" if moving else "fixed", name, f"{1e3 * solution.settings['physics_dt']:.3g}",
                f"{digits(off.max(), 2)} / {digits(float(np.quantile(off, 0.95)), 2)}",
                " / ".join(digits(value, 2) for value in share),
                digits(1e3 * missed, 2) if moving else "",
                "" if error is None
                else " / ".join(digits(value, 2) for value in of_joints(solution, np.rad2deg(error))),
                "passed" if solution.verdict.passed else "failed", ", ".join(said),
            ))  # fmt: skip
    header = (
        "knee", "integrator", "physics step, ms", "activations off, largest / at 95 % of nodes",
        "moments off, % of peak, hip / knee / ankle", "ties miss, mm or mrad", "own error, deg", "verdict", "told",
    )  # fmt: skip
    return grid(header, rows)


MYO = (
    ("myofinger", (("rk4", 0.005), ("rk4", 0.00025), ("euler", 0.005), ("implicit", 0.005), ("implicitfast", 0.005))),
    ("myohand_r", (("rk4", 0.005), ("rk4", 0.001), ("euler", 0.005), ("implicit", 0.005), ("implicitfast", 0.005))),
)


def stiff() -> str:
    from myo import CASES, load, motion_of

    amplitudes = {name: values for name, values, _ in CASES}
    rows = []
    for model_name, choices in MYO:
        model = load(model_name)
        move = motion_of(model, amplitudes[model_name])
        for name, step in choices:

            def run(name: str = name, step: float = step) -> mjhcmc.Solution:
                return mjhcmc.hcmc(model, move, 0.005, step, integrator=name)  # noqa: B023

            with warnings.catch_warnings():
                warnings.simplefilter("ignore", mjhcmc.MjhcmcWarning)
                try:
                    solution = run()
                except mjhcmc.SimulationError:
                    rows.append((model_name, name, f"{1e3 * step:g}", "none works", "", ""))
                    continue
                taken = float(np.median([reading.cpu for reading in alternate({"ours": run}, 5)["ours"]]))
            error = np.rad2deg(np.abs(solution.tracking_error).max())
            used = f"{1e3 * solution.settings['physics_dt']:.2g}"
            rows.append((model_name, name, f"{1e3 * step:g}", used, digits(error, 2), f"{taken:.2f}"))
    header = ("model", "integrator", "physics step, ms", "used, ms", "largest error, deg", "solve, s of CPU")
    return grid(header, rows)


def markdown() -> str:
    measured = "\n\n".join(table(movement) for movement in MOVEMENTS)
    return "\n\n".join([
        "### Error against time", machine(), measured, order(), "### What each part is worth",
        "Fast, with one of the adaptations left out: largest errors, hip / knee / ankle, deg.", ablation(),
        "### From a wrong start",
        "Largest errors (hip / knee / ankle, deg) after the first cycle; all joints start off by so much.", recovery(),
        roots(), "### A measured walk",
        f"Subject 01 from {WALK_SPAN[0]:g} to {WALK_SPAN[1]:g} s, right leg, windows of {1e3 * WALK_DT:g} ms, beside "
        f"RK4 at {1e3 * FINEST:g} ms.", walk(),
        "### Stiff models", "Models of myo-sim, windows of 5 ms.", stiff(),
    ])  # fmt: skip


def figure() -> Figure:
    """What muscles do against RK4's at its finest step, and tracking error, over the physics step."""
    from matplotlib.lines import Line2D

    from mjhcmc.plotting.panels import AXIS, PALETTE, Sheet, finish, style

    with style():
        names, markers = list(SCHEMES), "osD^"
        entries = [
            Line2D([], [], color=PALETTE[i], marker=markers[i], ms=5, mec="white", mew=0.6, lw=1.3, label=name)
            for i, name in enumerate(names)
        ]
        guide = Line2D([], [], color=AXIS, lw=1.2, ls=(0, (4, 2)), label="order 1")
        sheet = Sheet(
            1, 2, (3.1, 2.6), (0.75, 0.0), "leg8, fast, windows of 10 ms, against the physics step", [*entries, guide]
        )
        panels = (
            ("largest activation error", lambda case: case.muscles),
            ("largest tracking error, deg", lambda case: max(case.error)),
        )
        for column, (label, value) in enumerate(panels):
            ax = sheet.panel(0, column)
            ax.set_xscale("log")
            ax.set_yscale("log")
            for i, name in enumerate(names):
                own = sorted((c.used, value(c)) for c in cases("fast") if c.name == name and c.used and value(c) > 0)
                x, y = np.array(own).T
                ax.plot(1e3 * x, y, color=PALETTE[i], marker=markers[i], ms=5, mec="white", mew=0.6, lw=1.3)
            if column == 0:
                x = np.array([0.5, 5.0])
                ax.plot(x, 0.012 * x, color=AXIS, lw=1.2, ls=(0, (4, 2)))
            else:
                ax.set_ylim(0.01, 1)
            ax.set_xlabel("physics step, ms")
            ax.set_xticks([0.5, 1, 2.5, 5], ["0.5", "1", "2.5", "5"])
            ax.set_xticks([], minor=True)
            sheet.label_values(ax, label)
            finish(ax)
    return sheet.figure


def figures(folder: Path) -> None:
    save_png(figure(), folder / "integrators.png")


if __name__ == "__main__":
    document = ROOT / "docs" / "integrators.md"
    main("integrators.py", "HCMC under each of MuJoCo's integrators.", markdown, figures, document)

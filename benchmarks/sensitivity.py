"""Which muscle parameters move which excitation, how far that holds, and intervals on excitations, as Markdown.

    python benchmarks/sensitivity.py [--write [DOCUMENT]]

--write replaces the tables in docs/sensitivity.md (or DOCUMENT) and draws sensitivity.png and intervals.png beside it.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from _markdown import ROOT, digits, grid, main, save_png

import mjhcmc
from mjhcmc.gradients.gradient import Gradient, gradient
from mjhcmc.gradients.spread import TYPICAL
from mjhcmc.gradients.table import SensitivityTable, said, sensitivity_table, share
from mjhcmc.gradients.uncertainty import Intervals, first_order_sd, intervals
from mjhcmc.muscle_parameters import FORCE_KINDS, KINDS, muscle_parameters, parameter_fields

MOVEMENTS = ("fast", "slow")
CHANGES = (0.0001, 0.001, 0.01, 0.05, 0.1)
DRAWS = 200
AT_BOUND = 1e-9  # of excitation


@cache
def leg() -> mjhcmc.MuscleModel:
    return mjhcmc.MuscleModel.load("leg8")


@cache
def motion(movement: str) -> mjhcmc.Motion:
    return mjhcmc.Motion.cosine(leg(), movement)


@cache
def slopes(movement: str) -> Gradient:
    return gradient(leg(), motion(movement), parameters=KINDS)


@cache
def forces(movement: str) -> Gradient:
    return gradient(leg(), motion(movement))


@cache
def summed(movement: str) -> SensitivityTable:
    return sensitivity_table(slopes(movement))


@cache
def drawn(movement: str, times: float) -> Intervals:
    """Intervals with so many times the standard deviations."""
    sd = {kind: times * value for kind, value in TYPICAL.items()}
    return intervals(leg(), motion(movement), sd, DRAWS, first_order=slopes(movement))


def matters(movement: str) -> str:
    table, rows = summed(movement), []
    for j, muscle in enumerate(table.muscle_names):
        cells = [f"{said(name)} {digits(table.rms[table.names.index(name), j], 2)}" for name in table.top(muscle)]
        rows.append((muscle, *cells, *[""] * (3 - len(cells)), share(table.near[j])))
    header = ("muscle", "most", "second", "third", "near a change")
    return f"**{movement}**, windows of 10 ms\n\n{grid(header, rows)}"


def by_kind() -> str:
    rows = []
    for kind in KINDS:
        cells = []
        for movement in MOVEMENTS:
            own = [i for i, name in enumerate(summed(movement).names) if name.startswith(f"{kind}/")]
            cells.append(digits(float(np.sqrt((summed(movement).rms[own] ** 2).mean())), 2))
            joint = np.rad2deg(summed(movement).drift[own].max())
            cells.append(f"{joint:.0e}")
        rows.append((kind.replace("_", " "), *cells))
    header = ("kind", *(f"{movement}, {what}" for movement in MOVEMENTS for what in ("points", "largest drift, deg")))
    return grid(header, rows)


def nearby(movement: str) -> str:
    """One parameter at a time, by +- so much: what changes, how far off the gradient is, active sets that change."""
    now, n = muscle_parameters(leg()), leg().n_muscle
    base, rows = forces(movement), []
    for change in CHANGES:
        count = 2 * len(FORCE_KINDS) * n
        values = {kind: np.repeat(now[kind][None], count, axis=0) for kind in FORCE_KINDS}
        steps = np.zeros((count, len(FORCE_KINDS) * n))
        for row, (kind, j, way) in enumerate((k, j, w) for k in FORCE_KINDS for j in range(n) for w in (1, -1)):
            values[kind][row, j] *= 1 + way * change
            steps[row, FORCE_KINDS.index(kind) * n + j] = way * change
        batch = mjhcmc.hcmc_batch(
            leg(), motion(movement), parameters=parameter_fields(leg(), values), trials=16, tolerance=1e-6
        )
        solved = np.stack([solution.excitation for solution in batch])
        actual = solved - base.solution.excitation
        linear = np.einsum("kjp,np->nkj", base.relative, steps)
        off = np.sqrt(((actual - linear) ** 2).sum(axis=(1, 2)) / np.maximum((actual**2).sum(axis=(1, 2)), 1e-30))
        sets = np.array([_active(solution) != _active(base.solution) for solution in batch])
        changed = float(sets.any(axis=(0, 2)).mean())
        rows.append((
            f"{100 * change:g} %", f"{100 * np.sqrt((actual**2).mean()):.2g}", f"{100 * np.median(off):.2g} %",
            f"{100 * np.quantile(off, 0.9):.3g} %", share(changed),
            share(sensitivity_table(forces(movement), change).near_any),
        ))  # fmt: skip
    header = (
        "change", "excitation moves, points", "linear answer off, median", "off, 90th percentile",
        "windows with another active set", "as expected from the gradient",
    )  # fmt: skip
    return f"**{movement}**\n\n{grid(header, rows)}"


def _active(solution: mjhcmc.Solution) -> np.ndarray:
    """(N, n_muscle) what each muscle does: at a bound, rising or falling between them."""
    u = solution.excitation
    inside = (u > AT_BOUND) & (u < 1 - AT_BOUND)
    return np.where(inside, np.sign(u - solution.activation[:-1]), 3 + (u > 0.5))


def bands(movement: str) -> str:
    parts = []
    for times in (1.0, 0.1):
        found, rows = drawn(movement, times), []
        for j, muscle in enumerate(found.muscle_names):
            sds = (float(100 * np.sqrt((sd[:, j] ** 2).mean())) for sd in (found.sd, found.first_order_sd))
            ratios = (f"{value:.2f}" if np.isfinite(value) else "" for value in (found.ratio[j], found.ratio_inside[j]))
            rows.append(
                (muscle, digits(100 * found.width[j], 2), *(digits(sd, 2) for sd in sds), *ratios,
                 share(found.clipped[j]))
            )  # fmt: skip
        header = (
            "muscle", "5 .. 95 %, points", "sd, points", "first-order sd", "ratio", "ratio, no draw at a bound",
            "windows clipped",
        )  # fmt: skip
        told = ", ".join(f"{kind.replace('_', ' ')} {100 * times * value:g} %" for kind, value in TYPICAL.items())
        parts.append(
            f"**{movement}**, sd: {told}; {DRAWS} draws, {len(found.failed)} failed, {found.helped} needed a reserve "
            f"(largest {share(float(found.reserve_share.max()))} of a joint's peak moment)\n\n{grid(header, rows)}"
        )
    return "\n\n".join(parts)


def whose() -> str:
    """Shares of the first-order variance by kind."""
    rows = []
    for movement in MOVEMENTS:
        own = {kind: (first_order_sd(slopes(movement), {kind: sd}) ** 2).sum() for kind, sd in TYPICAL.items()}
        rows.append((movement, *(share(float(value / sum(own.values()))) for value in own.values())))
    return grid(("movement", *(kind.replace("_", " ") for kind in TYPICAL)), rows)


def markdown() -> str:
    return "\n\n".join([
        "### What matters most", *(matters(movement) for movement in MOVEMENTS),
        "### By kind of parameter", by_kind(),
        "### How far the linear answer holds", *(nearby(movement) for movement in MOVEMENTS),
        "### Intervals", *(bands(movement) for movement in MOVEMENTS),
        "Which kind the first-order variance comes from:", whose(),
    ])  # fmt: skip


def figures(folder: Path) -> None:
    from mjhcmc.plotting import interval_figure, sensitivity_figure

    table = sensitivity_table(forces("fast"))
    save_png(sensitivity_figure(table), folder / "sensitivity.png")
    save_png(interval_figure(drawn("fast", 1.0)), folder / "intervals.png")


if __name__ == "__main__":
    document = ROOT / "docs" / "sensitivity.md"
    main("sensitivity.py", "Sensitivity of excitations, and intervals on them.", markdown, figures, document)

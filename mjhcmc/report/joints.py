"""Panels of joints: angles with errors, moments with what muscles and reserves add, residuals."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mjhcmc.plotting.moments import reserve_at_nodes
from mjhcmc.plotting.panels import readable
from mjhcmc.report.contributions import Thinned, stacks
from mjhcmc.report.markup import Html, element, paragraphs, section
from mjhcmc.report.panel import Line, Panel, Row, grid, key_of
from mjhcmc.report.series import MOST_POINTS, Book
from mjhcmc.report.units import length, limits, load, load_unit, percent, way, with_role
from mjhcmc.solution import RESERVE_SHARE, Solution, moment_scale
from mjhcmc.verify import MAX_RESERVE_SHARE

RESIDUALS = "residuals"
"""The id of their heading."""

_FOLD = {
    "dependent": "Joints that follow others",
    "prescribed": "Joints that follow the motion",
    "free": "Joints that nothing leads",
}


def angle_section(book: Book, solution: Solution, others: Mapping[str, Solution]) -> tuple[Html, list[Panel]]:
    """Angles, actual and desired, with the error below on its own scale."""
    tracked = with_role(solution, "tracked") or list(range(len(solution.dof_names)))
    panels = [_angle_panel(book, solution, others, j) for j in tracked]
    parts: list[object] = [grid(panels, "medium")]
    for role, title in _FOLD.items():
        own = [_angle_panel(book, solution, others, j) for j in with_role(solution, role) if j not in tracked]
        if own:
            parts.append(
                element("details", element("summary", f"{title} ({len(own)})"), grid(own, "medium"), class_="fold")
            )
            panels += own
    entries = [("desired", "desired"), ("actual", "actual, driven by muscles"), ("error", "error: actual − desired")]
    entries += [(f"other{rank}", f"{label}: actual and error") for rank, label in enumerate(others)]
    text = (
        "Angles in degrees, positions in millimetres. The error has a scale of its own below. A ball joint is shown by "
        "its turn from where the motion starts."
        if not solution.named_coordinates.flat
        else "Angles in degrees, positions in millimetres. The error has a scale of its own below."
    )
    return section("angles", "Joint angles", paragraphs(text), key_of(entries), *parts), panels


def _angle_panel(book: Book, solution: Solution, others: Mapping[str, Solution], j: int) -> Panel:
    nodes, name = book.clock("nodes", solution.time), solution.dof_names[j]
    unit, factor = way(solution, j)
    what = "angle" if solution.dof_is_rotation[j] else "position"
    desired, actual = shown(solution)
    error = factor * solution.tracking_error[:, j]
    title = readable(name)
    lines = [
        Line(book.column(f"desired/{name}", nodes, factor * desired[:, j]), f"{title} desired", "desired", unit),
        Line(book.column(f"actual/{name}", nodes, factor * actual[:, j]), f"{title} actual", "actual", unit),
        Line(book.column(f"error/{name}", nodes, error), f"{title} error", "error", unit, 1),
    ]
    for rank, (label, other) in enumerate(others.items()):
        if name in other.dof_names:
            book.clock(f"other{rank}", other.time)
            place = other.dof_names.index(name)
            column = book.column(f"other{rank}/actual/{name}", f"other{rank}", factor * shown(other)[1][:, place])
            lines.append(Line(column, f"{label}: {what}", f"other{rank}", unit))
            own = factor * other.tracking_error[:, place]
            column = book.column(f"other{rank}/error/{name}", f"other{rank}", own)
            lines.append(Line(column, f"{label}: error", f"other{rank}", unit, 1))
    k = int(np.argmax(np.where(np.isfinite(error), np.abs(error), -1.0)))
    rms = float(np.sqrt(np.mean(solution.tracking_error[:, j] ** 2)))
    note = (
        f"error up to {length(solution, j, abs(solution.tracking_error[k, j]))} at {solution.time[k]:.3f} s, RMS "
        f"{length(solution, j, rms)}" + ("" if rms <= limits(solution)[j] else ": above the threshold")
    )
    least = 1.0 if unit == "deg" else 10.0
    return Panel(
        f"angle-{j}", name, lines, [Row(f"{what} ({unit})", 2.0, least=least), Row(f"error ({unit})", 1.0)], 270,
        f"{title}: desired and actual {what} over time, and the error. {note}.", notes=[note], flagged=True,
    )  # fmt: skip


def shown(solution: Solution) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N+1, nv) each, rad or m: desired and actual positions by degree of freedom."""
    start, names = solution.qpos_desired[0], solution.named_coordinates
    return names.shown(solution.qpos_desired, start), names.shown(solution.qpos, start)


def moment_section(book: Book, solution: Solution, detail: Thinned | None, why_not: str) -> tuple[Html, list[Panel]]:
    """Net joint moments, with what each muscle, the reserve and loads from outside add; residuals."""
    dofs = with_role(solution, "tracked") or list(range(len(solution.dof_names)))
    driven = [j for j in dofs if not solution.is_root[j]]
    named = stacks(detail.muscle_moment, driven) if detail is not None else [([], [], {}) for _ in driven]
    panels = [
        _moment_panel(book, solution, detail, j, *of) for j, of in zip(driven, named, strict=True)
    ]  # fmt: skip
    residual = [j for j in range(len(solution.dof_names)) if solution.residual[:, j].any() and j not in driven]
    own = [_residual_panel(book, solution, j) for j in residual]
    limit = f"{percent(MAX_RESERVE_SHARE)} of the peak"
    entries = [("net", "net joint moment"), ("reserve", "reserve"), ("limit", limit)]
    if unmet_moment(solution).any():
        entries.insert(2, ("unmet", "unmet: what nothing gave"))
    if solution.external_load[:, driven].any():
        entries.append(("load", "load from outside"))
    if any(rest for _, rest, _ in named):
        entries.append(("others", "other muscles"))
    text = (
        "Each area is what one muscle adds, named below its panel: stacked upward from zero where it is positive, "
        "downward where it is negative. Where both are large, muscles work against each other; together with the "
        f"reserve they add up to the net joint moment. {_colour_words(named)}"
        if detail is not None
        else f"Muscle contributions are left out: {why_not}"
    )
    return (
        section(
            "moments", "Joint moments",
            paragraphs(text),
            f"One node in {detail.every} is drawn of contributions." if detail is not None and detail.every > 1 else "",
            key_of(entries),
            grid(panels, "large"),
            *(
                (
                    element("h3", "Residuals", id=RESIDUALS),
                    paragraphs(
                        "What keeps these joints on the motion beside muscles and loads from outside: small beside the "
                        "ground reaction where model and loads are complete. Where the model is a part of the body, "
                        "it holds what the rest of the body gives."
                    ),
                    grid(own, "medium"),
                )
                if own
                else ()
            ),
        ),
        panels + own,
    )  # fmt: skip


def _colour_words(named: list[tuple[list[int], list[int], dict[int, str]]]) -> str:
    """Whether a muscle has one colour all over: of many, nine colours do not suffice."""
    found: dict[int, set[str]] = {}
    for _, _, looks in named:
        for muscle, look in looks.items():
            found.setdefault(muscle, set()).add(look)
    if all(len(own) == 1 for own in found.values()):
        return "A muscle has the same colour at each joint it crosses."
    return "There are more muscles than colours: the legend below a panel is for that panel."


def _moment_panel(
    book: Book, solution: Solution, detail: Thinned | None, j: int, named: list[int], rest: list[int],
    looks: dict[int, str],
) -> Panel:  # fmt: skip
    nodes, name, unit = book.clock("nodes", solution.time), solution.dof_names[j], load_unit(solution, j)
    windows = book.clock("windows", solution.time[:-1], float(solution.time[-1]))
    title, quantity = readable(name), "moment" if unit == "N m" else "force"
    net = solution.net_joint_moment[:, j]
    reserve, unmet = solution.reserve[:, j], unmet_moment(solution)[:, j]
    lines = [Line(book.column(f"net/{name}", nodes, net), f"{title} net {quantity}", "net", unit)]
    if solution.external_load[:, j].any():
        column = book.column(f"load/{name}", nodes, solution.external_load[:, j])
        lines.append(Line(column, f"{title} load from outside", "load", unit))
    column = book.column(f"reserve/{name}", windows, reserve)
    lines.append(Line(column, f"{title} reserve", "reserve", unit, 1, step=True))
    if unmet.any():
        column = book.column(f"unmet/{name}", windows, unmet)
        lines.append(Line(column, f"{title} unmet {quantity}", "unmet", unit, 1, step=True))
    stack: list[Line] = []
    key: list[tuple[str, str]] = []
    if detail is not None:
        stack, key = _stack(book, solution, detail, j, named, rest, looks)
    scale = float(moment_scale(solution.net_joint_moment)[j])
    most = MAX_RESERVE_SHARE * scale
    parts = [
        f"peak {load(solution, j, float(np.abs(net).max()))} at {solution.time[int(np.argmax(np.abs(net)))]:.3f} s"
    ]
    for word, values in (("reserve", reserve), ("unmet", unmet)):
        k = int(np.argmax(np.abs(values)))
        if values[k]:
            share = float(abs(values[k])) / scale
            above = ", above the threshold" if share > MAX_RESERVE_SHARE and word == "reserve" else ""
            size = percent(share)
            upto = "" if size.startswith("<") else "up to "
            parts.append(f"{word} {upto}{size} of it, at {solution.time[k]:.3f} s{above}")
    note = "; ".join(parts)
    below = "reserve, unmet" if unmet.any() else "reserve"
    rows = [
        Row(f"{quantity} ({unit})", 3.0),
        Row(f"{below} ({unit})", 1.0, limits=(-most, most) if np.isfinite(most) else ()),
    ]
    return Panel(
        f"moment-{j}", name, lines, rows, 360,
        f"{title}: net joint {quantity} over time, what each muscle adds to it, and the reserve. {note}.",
        notes=[note], stack=stack, flagged=True, key=key,
    )  # fmt: skip


def _stack(
    book: Book, solution: Solution, detail: Thinned, j: int, named: list[int], rest: list[int], looks: dict[int, str]
) -> tuple[list[Line], list[tuple[str, str]]]:
    """Areas and their legend; all columns of a stack are thinned alike, so that they can be added up."""
    clock, name, unit = book.clock("detail", detail.time), solution.dof_names[j], load_unit(solution, j)
    values = detail.muscle_moment[:, :, j]
    reserve = reserve_at_nodes(solution)[:: detail.every, j][: len(detail.time)]
    up = np.maximum(values, 0).sum(axis=1) + np.maximum(reserve, 0)
    down = np.minimum(values, 0).sum(axis=1) + np.minimum(reserve, 0)
    which = _kept_alike(up, down)
    lines, key = [], []
    for i in named:
        muscle = solution.muscle_names[i]
        column = book.column(f"contribution/{name}/{muscle}", clock, values[:, i], which)
        lines.append(Line(column, readable(muscle), looks[i], unit))
        key.append((looks[i], readable(muscle)))
    if rest:
        for sign, part in (("+", np.maximum(values[:, rest], 0)), ("-", np.minimum(values[:, rest], 0))):
            column = book.column(f"contribution/{name}/other muscles {sign}", clock, part.sum(axis=1), which)
            lines.append(Line(column, f"{len(rest)} others, {'up' if sign == '+' else 'down'}", "others", unit))
        key.append(("others", f"{len(rest)} other muscles"))
    if reserve.any():
        column = book.column(f"contribution/{name}/reserve", clock, reserve, which)
        lines.append(Line(column, "reserve", "reserve", unit))
    return lines, key


def _kept_alike(up: NDArray[np.float64], down: NDArray[np.float64]) -> NDArray[np.intp] | None:
    """Which nodes of a stack to draw: where it is highest and where it is lowest in each stretch; None: all."""
    n = len(up)
    if n <= MOST_POINTS:
        return None
    edges = np.linspace(0, n, MOST_POINTS // 2 + 1).astype(np.intp)
    kept = [[a + np.argmax(up[a:b]), a + np.argmin(down[a:b])] for a, b in pairwise(edges)]
    return np.unique(np.concatenate([np.ravel(kept), [0, n - 1]])).astype(np.intp)


def unmet_moment(solution: Solution) -> NDArray[np.float64]:
    """(N, nv) N m or N: what neither muscles nor reserve gave; 0 at joints where it is too small to be flagged."""
    unmet = solution.shortfall - solution.reserve
    least = RESERVE_SHARE * moment_scale(solution.net_joint_moment)
    return np.where(np.abs(unmet).max(axis=0) > least, unmet, 0.0)


def _residual_panel(book: Book, solution: Solution, j: int) -> Panel:
    nodes, name, unit = book.clock("nodes", solution.time), solution.dof_names[j], load_unit(solution, j)
    values, title = solution.residual[:, j], readable(name)
    k = int(np.argmax(np.abs(values)))
    rms = float(np.sqrt(np.mean(values**2)))
    note = f"peak {load(solution, j, abs(values[k]))} at {solution.time[k]:.3f} s, RMS {load(solution, j, rms)}"
    lines = [Line(book.column(f"residual/{name}", nodes, values), f"{title} residual", "residual", unit)]
    rows = [Row(f"residual ({unit})")]
    if solution.external_load[:, j].any():
        column = book.column(f"load/{name}", nodes, solution.external_load[:, j])
        lines.append(Line(column, f"{title} load from outside", "load", unit, 1))
        rows.append(Row(f"load ({unit})"))
    return Panel(
        f"residual-{j}", name, lines, rows, 150 + 90 * (len(rows) - 1), f"{title}: residual over time. {note}.",
        notes=[note],
    )  # fmt: skip

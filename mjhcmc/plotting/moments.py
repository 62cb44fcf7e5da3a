"""Which muscle gives how much of each joint's moment: a stacked figure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError
from mjhcmc.plotting.choice import most_telling, tracked
from mjhcmc.plotting.panels import (
    AXIS,
    INK,
    ORANGE,
    Sheet,
    finish,
    headline,
    left_out,
    note,
    number,
    readable,
    scale_values,
    shortened,
    style,
)
from mjhcmc.solution import Solution, moment_scale

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MUSCLE_COLORS = (
    "#332288",
    "#88CCEE",
    "#CC6677",
    "#117733",
    "#DDCC77",
    "#882255",
    "#44AA99",
    "#AA4499",
    "#999933",
)
"""Paul Tol's muted colors, made for areas and told apart by color-blind eyes."""

_OTHERS = "#DADADA"
_NEGLIGIBLE = 1e-6  # of the joint's peak: a muscle under it does not cross the joint
_ROOM, _LETTERS = 1.5, 20  # inches beside a panel for its legend, letters that fit there


class _Sheet(Sheet):
    """A sheet with a legend beside each panel."""

    right = 0.2 + _ROOM


def moment_figure(solution: Solution) -> Figure:
    """What each muscle adds to each net joint moment, stacked, a panel for each tracked degree of freedom.

    The root, where no muscle acts, is left out; of more than 12, those are drawn that move, carry or err most
    (`choice.most_telling`), and the legend counts the rest.

    Positive and negative contributions are stacked apart, each from zero outwards, the largest muscle first: where a
    stack rises on both sides, muscles work against each other, and the sum of both is the net joint moment (the line).
    The reserve is an area of its own, hatched, at the end of the stack. Next to each panel its muscles are named, the
    largest first; beyond nine the smallest are merged. Colors follow the order of the model's muscles: a muscle has the
    same in every panel and in the figures of other solutions; beyond nine muscles, where its joints leave that free.

    Args:
        solution: one that knows its model (`Solution.detail`).

    Raises:
        SimulationError: the solution was read from a file without its model.
        SettingsError: the solution has no joint.
    """
    if not solution.dof_names:
        raise SettingsError("moment_figure: the solution has no joint: nothing to draw")
    contribution = solution.detail.muscle_moment
    candidates = tracked(solution)
    dofs, rest = most_telling(solution, [j for j in candidates if not solution.is_root[j]] or candidates)
    n_joint = len(dofs)
    named = [ranked_by_peak(contribution[:, :, j]) for j in dofs]
    colors = colors_of(named, [ranked[: len(MUSCLE_COLORS)] for ranked in named])
    n_column = 1 if n_joint <= 4 else 2
    with style():
        sheet = _Sheet(
            math.ceil(n_joint / n_column), n_column, panel=(5.6 if n_column == 1 else 3.6, 1.75),
            gap=(_ROOM + 0.75, 0.36), title=f"Muscle contributions to the joint moments · {headline([solution])}",
            entries=[
                *_legend(solution, dofs),
                *left_out(rest, f"of {n_joint + rest} tracked", "that move, carry and err least"),
            ],
        )  # fmt: skip
        for place, j in enumerate(dofs):
            ax = sheet.panel(place // n_column, place % n_column, solution.dof_names[j])
            _draw(sheet, ax, solution, j, contribution[:, :, j], named[place], colors[place])
            ax.set_xlim(solution.time[0], solution.time[-1])
            finish(ax, time_label=place + n_column >= n_joint)
    return sheet.figure


def reserve_at_nodes(solution: Solution) -> NDArray[np.float64]:
    """(N+1, nv) N m or N: the reserve of the window that starts at each node; at the last node, of the last window."""
    return np.concatenate([solution.reserve, solution.reserve[-1:]])


def ranked_by_peak(contribution: NDArray[np.float64]) -> list[int]:
    """Muscles that act on a joint, by their peak there, the largest first."""
    peak = np.abs(contribution).max(axis=0)
    order = np.argsort(-peak, kind="stable")
    return [int(i) for i in order if peak[i] > _NEGLIGIBLE * peak.max(initial=0.0)]


def colors_of(across: Sequence[Sequence[int]], named: Sequence[Sequence[int]]) -> list[dict[int, str]]:
    """Colors by muscle for each joint, from the muscles across each and those named there (nine at most).

    They follow the muscles' order in the model, not their size, so that a muscle has the same color in the figures of
    two solutions: muscle i has color i of the list, counted round and round. Where a muscle of the same joint has that
    already, it takes the first color that is free on its joints, or at least in the panel.
    """
    usual: dict[int, str] = {}
    for i in sorted({i for muscles in across for i in muscles}):
        own = MUSCLE_COLORS[i % len(MUSCLE_COLORS)]
        taken = {usual[k] for muscles in across if i in muscles for k in muscles if k in usual}
        usual[i] = own if own not in taken else next((c for c in MUSCLE_COLORS if c not in taken), own)
    result = []
    for muscles in named:
        spare = [c for c in MUSCLE_COLORS if c not in {usual[i] for i in muscles}]
        panel: dict[int, str] = {}
        for i in sorted(muscles):
            panel[i] = spare.pop(0) if usual[i] in panel.values() else usual[i]
        result.append(panel)
    return result


def _draw(
    sheet: Sheet, ax: Axes, solution: Solution, j: int, contribution: NDArray[np.float64], ranked: list[int],
    colors: dict[int, str],
) -> None:  # fmt: skip
    from matplotlib.patches import Patch

    quantity, unit = ("moment", "N m") if solution.dof_is_rotation[j] else ("force", "N")
    time, net, reserve = solution.time, solution.net_joint_moment[:, j], reserve_at_nodes(solution)[:, j]
    label_of = [shortened(readable(name), _LETTERS) for name in solution.muscle_names]
    layers = [(label_of[i], colors[i], contribution[:, [i]]) for i in ranked if i in colors]
    rest = [i for i in ranked if i not in colors]
    if rest:
        layers.append((f"{len(rest)} other{'s' * (len(rest) > 1)}", _OTHERS, contribution[:, rest]))
    top, bottom = np.zeros_like(time), np.zeros_like(time)
    entries: list[Artist] = []
    for label, color, values in [*layers, ("reserve", ORANGE, reserve[:, None])]:
        above = top + np.maximum(values, 0.0).sum(axis=1)
        below = bottom + np.minimum(values, 0.0).sum(axis=1)
        is_reserve = label == "reserve" and color == ORANGE
        look: dict[str, Any] = (
            {"hatch": "/////", "ec": ORANGE, "fc": "white", "lw": 0.0} if is_reserve else {"fc": color, "lw": 0.0}
        )
        for inner, outer in ((top, above), (bottom, below)):
            if (inner != outer).any():
                ax.fill_between(time, inner, outer, zorder=1.6, label=label, **look)
                if not is_reserve:
                    ax.plot(time, outer, color="white", lw=0.45, zorder=1.7, label="seam")
        if not is_reserve:
            entries.append(Patch(fc=color, lw=0, label=label))
        top, bottom = above, below
    ax.axhline(0.0, color=AXIS, lw=0.6, zorder=1.8)
    ax.plot(time, net, color="white", lw=3.0, zorder=2.4, label="halo")
    ax.plot(time, net, color=INK, lw=1.3, zorder=2.5, label=f"net joint {quantity}")
    scale_values(sheet, ax, quantity, unit, [top, bottom], headroom=0.22)
    ax.legend(
        handles=entries, loc="upper left", bbox_to_anchor=(1.012, 1.03), borderaxespad=0.0, handlelength=1.2,
        handleheight=0.9, labelspacing=0.28, fontsize=7.2, frameon=False,
    )  # fmt: skip
    peak = float(np.abs(reserve).max(initial=0.0))
    share = 100 * peak / moment_scale(solution.net_joint_moment)[j]
    told = f"{share:{'.2g' if share < 10 else '.0f'}}"
    note(ax, f"reserve {number(peak)} {unit}, {told} % of peak" if share >= 0.01 else "no reserve")


def _legend(solution: Solution, dofs: Sequence[int]) -> list[Artist]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    quantity = "net joint moment" if solution.dof_is_rotation[dofs].all() else "net joint moment or force"
    return [
        Line2D([], [], color=INK, lw=1.3, label=quantity),
        Patch(fc="#BBBBBB", lw=0, label="area: one muscle, named beside the panel"),
        Patch(fc="white", ec=ORANGE, hatch="/////", lw=0, label="reserve"),
    ]

"""Residuals: what keeps prescribed joints, or a tracked root, on the motion beside muscles and loads."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mjhcmc.errors import SettingsError
from mjhcmc.plotting.panels import (
    AXIS,
    PURPLE,
    Sheet,
    finish,
    headline,
    left_out,
    note,
    number,
    scale_values,
    style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mjhcmc.solution import Solution

_COLUMNS, _MOST = 3, 12  # panels side by side; of forces, and of moments


def residual_figure(solution: Solution) -> Figure:
    """Residuals over time, a panel for each degree of freedom that has one: first forces (N), below moments (N m).

    Each panel has its own scale; its peak, when that is, and the root mean square are written in it. Of more than 12
    forces, or moments, those with the highest peaks are drawn, and the legend counts the rest.

    Raises:
        SettingsError: the solution has no residual (`Solution.residual` is 0 all over).
    """
    peak = np.abs(solution.residual).max(axis=0, initial=0.0)
    has = solution.may_have_residual | (peak > 0)
    if not peak.any():
        raise SettingsError("residual_figure: the solution has no residual: nothing to draw")
    from matplotlib.lines import Line2D

    groups, rest = [], 0
    for rotation in (False, True):
        own = np.flatnonzero(has & (solution.dof_is_rotation == rotation))
        kept = np.sort(own[np.argsort(-peak[own], kind="stable")[:_MOST]]).tolist()
        rest += len(own) - len(kept)
        groups += [kept] if kept else []
    n_column = min(_COLUMNS, max(len(group) for group in groups))
    rows = [group[i : i + n_column] for group in groups for i in range(0, len(group), n_column)]
    with style():
        sheet = Sheet(
            len(rows), n_column, panel=(2.6, 1.45), gap=(0.7, 0.62), title=f"Residuals · {headline([solution])}",
            entries=[
                Line2D([], [], color=PURPLE, lw=1.2, label="force or moment beside muscles and loads"),
                *left_out(rest, f"of {int(has.sum())}", "with the lowest peaks"),
            ],
        )  # fmt: skip
        for row, dofs in enumerate(rows):
            for column, j in enumerate(dofs):
                _draw(sheet, sheet.panel(row, column, solution.dof_names[j]), solution, j)
    return sheet.figure


def _draw(sheet: Sheet, ax: Axes, solution: Solution, j: int) -> None:
    quantity, unit = ("moment", "N m") if solution.dof_is_rotation[j] else ("force", "N")
    values = solution.residual[:, j]
    ax.axhline(0.0, color=AXIS, lw=0.6, zorder=1.5)
    ax.plot(solution.time, values, color=PURPLE, lw=1.2, label="residual")
    scale_values(sheet, ax, quantity, unit, [values])
    k = int(np.argmax(np.where(np.isfinite(values), np.abs(values), -1.0)))
    ax.plot(solution.time[k], values[k], "o", ms=3.4, mfc="white", mec=PURPLE, clip_on=False, label="peak")
    rms = math.sqrt(float(np.mean(values**2)))
    note(ax, f"peak {number(abs(values[k]))} {unit} at {solution.time[k]:.4g} s, RMS {number(rms)}")
    ax.set_xlim(solution.time[0], solution.time[-1])
    finish(ax, time_label=True)

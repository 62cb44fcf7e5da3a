"""Tracking: angles, errors and net joint moments of the degrees of freedom that follow a motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError
from mjhcmc.plotting.choice import most_telling, tracked
from mjhcmc.plotting.panels import (
    AXIS,
    BLUE,
    DESIRED,
    GREEN,
    ORANGE,
    VERMILLION,
    Sheet,
    finish,
    headline,
    left_out,
    note,
    number,
    scale_values,
    style,
)
from mjhcmc.solution import Solution, moment_scale

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    _Draw = Callable[[Sheet, Axes, Solution, int], None]


_LEAST_DEG, _LEAST_M = 1.0, 0.01  # that an angle panel spans


def tracking_figure(solution: Solution) -> Figure:
    """Angle, tracking error and net joint moment with reserve, a column for each tracked degree of freedom.

    Each row has its own scale in each column. More than four joints continue below; of more than 12, those are drawn
    that move, carry or err most (`choice.most_telling`), and the legend counts the rest. Where reserves were off, what
    the muscles could not give is drawn in the reserve's place and called unmet; at a tracked root it is a residual. A
    ball is shown by its turn from where the motion starts, as a rotation vector.

    Raises:
        SettingsError: the solution has no joint.
    """
    if not solution.dof_names:
        raise SettingsError("tracking_figure: the solution has no joint: nothing to draw")
    dofs, rest = most_telling(solution, tracked(solution))
    shown = _Positions(solution)
    n_joint = len(dofs)
    n_column = min(n_joint, 3 if n_joint in (5, 6, 9) else 4)
    with style():
        sheet = Sheet(
            3 * math.ceil(n_joint / n_column), n_column, panel=(2.6 if n_column < 4 else 2.3, 1.25),
            gap=(0.7, 0.2), title=f"Tracking and joint moments · {headline([solution])}",
            entries=[
                *_tracking_legend(solution),
                *left_out(rest, f"of {n_joint + rest} tracked", "that move, carry and err least"),
            ], block=(3, 0.5),
        )  # fmt: skip
        draws: list[_Draw] = [partial(_draw_angle, shown), _draw_error, _draw_moment]
        for place, j in enumerate(dofs):
            row, column = 3 * (place // n_column), place % n_column
            for i, draw in enumerate(draws):
                ax = sheet.panel(row + i, column, solution.dof_names[j] if i == 0 else None)
                draw(sheet, ax, solution, j)
                ax.set_xlim(solution.time[0], solution.time[-1])
                finish(ax, time_label=i == 2)
    return sheet.figure


def _unit(solution: Solution, j: int) -> tuple[str, float]:
    return ("deg", 180 / np.pi) if solution.dof_is_rotation[j] else ("m", 1.0)


class _Positions:
    """Desired and actual positions by degree of freedom, (N+1, nv) each."""

    def __init__(self, solution: Solution) -> None:
        start = solution.qpos_desired[0]
        self.desired = solution.named_coordinates.shown(solution.qpos_desired, start)
        self.actual = solution.named_coordinates.shown(solution.qpos, start)


def _draw_angle(shown: _Positions, sheet: Sheet, ax: Axes, solution: Solution, j: int) -> None:
    unit, factor = _unit(solution, j)
    desired, actual = shown.desired[:, j] * factor, shown.actual[:, j] * factor
    ax.plot(solution.time, desired, color=DESIRED, lw=4.0, solid_capstyle="round", label="desired")
    ax.plot(solution.time, actual, color=BLUE, lw=1.1, label="actual")
    # what stands still is drawn as standing still: its error has a panel of its own
    around = desired.mean() + np.array([-0.5, 0.5]) * (_LEAST_DEG if unit == "deg" else _LEAST_M)
    scale_values(sheet, ax, "angle" if unit == "deg" else "position", unit, [desired, actual, around], headroom=0.1)


def _draw_error(sheet: Sheet, ax: Axes, solution: Solution, j: int) -> None:
    unit, factor = _unit(solution, j)
    error = solution.tracking_error[:, j] * factor
    ax.axhline(0.0, color=AXIS, lw=0.6, zorder=1.5)
    ax.plot(solution.time, error, color=VERMILLION, lw=1.1, label="tracking error")
    scale_values(sheet, ax, "error", unit, [error])
    k = int(np.argmax(np.where(np.isfinite(error), np.abs(error), -1.0)))
    ax.plot(solution.time[k], error[k], "o", ms=3.4, mfc="white", mec=VERMILLION, clip_on=False, label="max")
    note(ax, f"max {number(abs(error[k]))} {unit} at {solution.time[k]:.4g} s")


def _draw_moment(sheet: Sheet, ax: Axes, solution: Solution, j: int) -> None:
    quantity, unit = ("moment", "N m") if solution.dof_is_rotation[j] else ("force", "N")
    word, part = _missing(solution)
    if solution.may_have_residual[j]:
        word = "residual"
    moment, missing = solution.net_joint_moment[:, j], part[:, j]
    ax.axhline(0.0, color=AXIS, lw=0.6, zorder=1.5)
    ax.stairs(missing, solution.time, fill=True, color=ORANGE, alpha=0.65, lw=0, zorder=1.8, label=word)
    ax.plot(solution.time, moment, color=GREEN, lw=1.1, label=f"net joint {quantity}")
    scale_values(sheet, ax, quantity, unit, [moment, missing])
    peak = float(np.abs(missing).max(initial=0.0))
    share = 100 * peak / moment_scale(solution.net_joint_moment)[j]
    if word == "residual":
        note(ax, f"residual {number(peak)} {unit}")
    elif share >= 0.01:
        note(ax, f"{word} {number(peak)} {unit}, {share:{'.2g' if share < 10 else '.0f'}} % of peak")
    else:
        note(ax, f"{word} under 0.01 % of peak" if peak else f"{word} zero")


def _missing(solution: Solution) -> tuple[str, NDArray[np.float64]]:
    """What the muscles did not give: the reserve or, where reserves were off, what nothing gave."""
    if not solution.reserve.any() and solution.shortfall.any():
        return "unmet", solution.shortfall
    return "reserve", solution.reserve


def _tracking_legend(solution: Solution) -> list[Artist]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Line2D([], [], color=DESIRED, lw=4.0, solid_capstyle="butt", label="desired"),
        Line2D([], [], color=BLUE, lw=1.1, label="actual"),
        Line2D([], [], color=VERMILLION, lw=1.1, label="tracking error"),
        Line2D([], [], color=GREEN, lw=1.1, label="net joint moment"),
        Patch(color=ORANGE, alpha=0.65, lw=0, label=f"{_missing(solution)[0]} moment"),
    ]

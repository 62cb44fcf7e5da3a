"""How fibers work: where on their lengths and velocities, at which activation, and with what power."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError
from mjhcmc.plotting.panels import AXIS, BLUE, VERMILLION, Sheet, columns_for, finish, headline, note, style
from mjhcmc.solution import Solution

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

_SHADES = 5  # of activation in the legend


def detail_figure(solution: Solution) -> Figure:
    """Two panels for each muscle: its fiber's velocity against its length, and its power against time.

    The fiber's path goes through lengths (1 is optimal) and velocities (above 0 it lengthens), both in optimal fiber
    lengths, darker where the muscle is more active; a circle marks the start. Power is that of the whole muscle, in
    blue where it gives energy (it shortens), in orange where it takes some (it is stretched); the work of both is
    noted. All muscles share their scales: what looks small is small.

    Args:
        solution: one that knows its model (`Solution.detail`).

    Raises:
        SimulationError: the solution was read from a file without its model.
        SettingsError: the solution has no muscle.
    """
    if not solution.muscle_names:
        raise SettingsError("detail_figure: the solution has no muscle: nothing to draw")
    detail, time = solution.detail, solution.time
    n_muscle, n_column = len(solution.muscle_names), columns_for(len(solution.muscle_names))
    shades = _shades()
    with style():
        sheet = Sheet(
            2 * math.ceil(n_muscle / n_column), n_column, panel=(2.0 if n_column < 6 else 1.65, 1.2), gap=(0.3, 0.52),
            title=f"Fibers and muscle power · {headline([solution])}", entries=_legend(shades), block=(2, 0.34),
        )  # fmt: skip
        length_limits = _limits(detail.normalized_fiber_length, 1.0)
        velocity_limits = _limits(detail.normalized_fiber_velocity, 0.0)
        power_limits = _limits(detail.muscle_power, 0.0, headroom=0.3)
        for i, name in enumerate(solution.muscle_names):
            row, column = 2 * (i // n_column), i % n_column
            ax = sheet.panel(row, column, name)
            _draw_fiber(
                ax, detail.normalized_fiber_length[:, i], detail.normalized_fiber_velocity[:, i],
                solution.activation[:, i], shades,
            )  # fmt: skip
            ax.set_xlim(length_limits)
            ax.set_ylim(velocity_limits)
            below = sheet.panel(row + 1, column)
            _draw_power(below, time, detail.muscle_power[:, i])
            below.set_xlim(time[0], time[-1])
            below.set_ylim(power_limits)
            for panel, label in ((ax, "velocity (l₀/s)"), (below, "power (W)")):
                if column == 0:
                    sheet.label_values(panel, label)
                else:
                    panel.tick_params(axis="y", labelleft=False)
            finish(ax)
            ax.set_xlabel("fiber length (l₀)", labelpad=1.5)
            finish(below, time_label=True)
    return sheet.figure


def _shades() -> Colormap:
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("activation", ["#C9DCEC", "#5A9BC8", "#0B5A94", "#06243D"])


def _limits(values: NDArray[np.float64], include: float, headroom: float = 0.08) -> tuple[float, float]:
    """Around all finite values and one that must be seen."""
    seen = np.append(values[np.isfinite(values)], include)
    low, high = float(seen.min()), float(seen.max())
    span = high - low or 1.0
    return low - 0.08 * span, high + headroom * span


def _draw_fiber(
    ax: Axes, length: NDArray[np.float64], velocity: NDArray[np.float64], activation: NDArray[np.float64],
    shades: Colormap,
) -> None:  # fmt: skip
    from matplotlib.collections import LineCollection

    ax.axhline(0.0, color=AXIS, lw=0.6, zorder=1.5)
    ax.axvline(1.0, color=AXIS, lw=0.6, ls=(0, (4, 2)), zorder=1.5)
    if not np.isfinite(length).all():
        note(ax, "no fiber in this model")
        return
    points = np.column_stack([length, velocity])
    pieces = LineCollection(
        list(np.stack([points[:-1], points[1:]], axis=1)), colors=shades(0.5 * (activation[:-1] + activation[1:])),
        linewidths=1.8, capstyle="round", zorder=2.0, label="fiber",
    )  # fmt: skip
    ax.add_collection(pieces, autolim=False)
    ax.plot(length[0], velocity[0], "o", ms=3.6, mfc="white", mec=shades(0.8), zorder=2.5, label="start")


def _draw_power(ax: Axes, time: NDArray[np.float64], power: NDArray[np.float64]) -> None:
    gives, takes = np.maximum(power, 0.0), np.minimum(power, 0.0)
    ax.axhline(0.0, color=AXIS, lw=0.6, zorder=1.8)
    ax.fill_between(time, 0.0, gives, fc=BLUE, alpha=0.75, lw=0.0, zorder=1.6, label="gives")
    ax.fill_between(time, 0.0, takes, fc=VERMILLION, alpha=0.75, lw=0.0, zorder=1.6, label="takes")
    work = [float(np.diff(time) @ (part[:-1] + part[1:]) / 2) for part in (gives, takes)]
    note(ax, f"+{work[0]:.3g} J  −{abs(work[1]):.3g} J")


def _legend(shades: Colormap) -> list[Artist]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries: list[Artist] = [
        Line2D([], [], color=shades(a), lw=2.2, label=f"activation {a:g}" if a == 0 else f"{a:g}")
        for a in np.linspace(0, 1, _SHADES)
    ]
    entries.append(Line2D([], [], color=AXIS, lw=0.8, ls=(0, (4, 2)), label="optimal length"))
    entries.append(Patch(fc=BLUE, alpha=0.75, lw=0, label="gives energy"))
    entries.append(Patch(fc=VERMILLION, alpha=0.75, lw=0, label="takes energy"))
    return entries

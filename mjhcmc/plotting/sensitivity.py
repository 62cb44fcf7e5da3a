"""Figures of sensitivity: which parameters move which excitation, and excitations with their intervals.

In percent and percentage points, as a person reads them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc.plotting.panels import (
    BLUE,
    INK,
    VERMILLION,
    Sheet,
    columns_for,
    finish,
    left_out,
    note,
    readable,
    shortened,
    style,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure

    from mjhcmc.gradients.table import SensitivityTable
    from mjhcmc.gradients.uncertainty import Intervals

_MOST = 36  # muscles drawn of a model that has more
_CELL = (0.62, 0.2)  # inches
_NUMBERED = 16  # columns: with more, cells have no room for numbers
_LEAST_SHOWN = 0.005  # points: less is left white and without a number
_BLOCK_GAP = 0.3  # inches, with a block's title


class _Map(Sheet):
    """Blocks of cells under each other, with room for names at the left and for a colour bar at the right."""

    left, right, min_width = 1.15, 1.0, 3.0

    def __init__(
        self, width: float, heights: Sequence[float], bottom: float, title: str, entries: list[Artist]
    ) -> None:  # fmt: skip
        """Of blocks as wide, and each as high, in inches; below them room for names."""
        self.bottom, self._heights = bottom, list(heights)
        super().__init__(len(heights), 1, (width, heights[-1]), (0.0, _BLOCK_GAP), title, entries)

    def _row_top(self, row: int) -> float:
        return self._top + sum(self._heights[:row]) + row * _BLOCK_GAP

    def panel(self, row: int, column: int, title: str | None = None) -> Axes:
        """The axes of a block."""
        self._height = self._heights[row]
        return super().panel(row, column, title)


def sensitivity_figure(table: SensitivityTable, title: str | None = None) -> Figure:
    """A heat map: a row a parameter, a column a muscle, a block a kind of parameter.

    Colour and number are the root mean square, over the motion, of the change of excitation in percentage points with
    1 % of the parameter. Of more than 36 muscles those that move most, or that move others most, are drawn.

    Args:
        table: of `mjhcmc.gradients.table.sensitivity_table`.
        title: of the figure.
    """
    from matplotlib.colors import LinearSegmentedColormap, PowerNorm
    from matplotlib.lines import Line2D

    from mjhcmc.gradients.table import kind_and_muscle

    muscles = _kept(table)
    blocks: dict[str, list[tuple[str, int]]] = {}
    for i, name in enumerate(table.names):
        kind, muscle = kind_and_muscle(name, table.muscle_names)
        if not muscle or table.muscle_names.index(muscle) in muscles:
            blocks.setdefault(kind, []).append((muscle or name, i))
    numbered = len(muscles) <= _NUMBERED
    width, height = _CELL[0] if numbered else 0.25, _CELL[1]
    told, count = "row: what changes by 1 %   column: whose excitation moves", len(table.muscle_names)
    entries: list[Artist] = [Line2D([], [], ls="none", label=told)]
    entries += left_out(count - len(muscles), f"of {count} muscles", "that matter least")
    with style():
        shades = LinearSegmentedColormap.from_list("change", ["#FFFFFF", "#BBD7EC", BLUE, "#00263D"])
        norm = PowerNorm(0.5, 0.0, max(float(table.rms.max()), _LEAST_SHOWN))
        sheet = _Map(
            width * len(muscles), [height * len(rows) for rows in blocks.values()], 0.75 if numbered else 1.0,
            title or f"Sensitivity of excitations · {table.label}", entries,
        )  # fmt: skip
        axes = []
        for block, (kind, rows) in enumerate(blocks.items()):
            ax = sheet.panel(block, 0, kind)
            values = table.rms[[i for _, i in rows]][:, muscles]
            ax.imshow(values, cmap=shades, norm=norm, aspect="auto")
            ax.set_yticks(range(len(rows)), [shortened(readable(name), 15) for name, _ in rows])
            names = [shortened(readable(table.muscle_names[j]), 15) for j in muscles]
            ax.set_xticks(range(len(muscles)), names if block == len(blocks) - 1 else [])
            finish(ax)
            ax.tick_params(length=0.0)
            ax.tick_params(axis="x", labelrotation=45 if numbered else 90)
            for label in ax.get_xticklabels():
                label.set(ha="right", va="top" if numbered else "center", rotation_mode="anchor")
            ax.grid(visible=False)
            if numbered:
                _number(ax, values, float(norm.vmax or 1.0))
            axes.append(ax)
        _bar(sheet, axes, shades, norm)
    return sheet.figure


def _kept(table: SensitivityTable) -> list[int]:
    """Columns that are drawn, in the model's order."""
    count = len(table.muscle_names)
    if count <= _MOST:
        return list(range(count))
    weight = (table.rms**2).sum(axis=0)
    for i, name in enumerate(table.names):
        muscle = name.partition("/")[2]
        if muscle in table.muscle_names:
            weight[table.muscle_names.index(muscle)] += (table.rms[i] ** 2).sum()
    return sorted(np.argsort(-weight, kind="stable")[:_MOST].tolist())


def _number(ax: Axes, values: NDArray[np.float64], top: float) -> None:
    for (row, column), value in np.ndenumerate(values):
        if value >= _LEAST_SHOWN:
            text = f"{value:.2f}" if value < 10 else f"{value:.1f}"
            color = "white" if value > 0.25 * top else INK
            ax.text(column, row, text, ha="center", va="center", fontsize=6.8, color=color)


def _bar(sheet: Sheet, axes: list[Axes], shades: Colormap, norm: Normalize) -> None:
    """A colour bar beside all blocks."""
    from matplotlib.cm import ScalarMappable

    figure = sheet.figure
    width = figure.get_size_inches()[0]
    low, high = axes[-1].get_position(), axes[0].get_position()
    place = (low.x1 + 0.15 / width, low.y0, 0.14 / width, high.y1 - low.y0)
    bar = figure.colorbar(ScalarMappable(norm, shades), cax=figure.add_axes(place))
    bar.set_label("change of excitation, percentage points per 1 %\n(root mean square over the motion)", fontsize=8.0)
    finish(bar.ax)
    bar.ax.grid(visible=False)
    bar.outline.set_visible(False)


def interval_figure(found: Intervals, title: str | None = None) -> Figure:
    """Excitation of every muscle with its interval, a panel each; of more than 36, those whose intervals are widest.

    Band and line: the Monte Carlo interval and median. Thin lines: the excitation of the unchanged muscles plus and
    minus as many first-order standard deviations as a normal distribution has between the levels, where there is a
    gradient. Noted: first-order over Monte Carlo standard deviation, root mean squares over the motion.

    Args:
        found: of `mjhcmc.gradients.uncertainty.intervals`.
        title: of the figure.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from scipy.special import ndtri

    low, high = found.levels
    linear = bool(np.isfinite(found.first_order_sd).any())
    kept = sorted(np.argsort(-found.width, kind="stable")[:_MOST].tolist())
    n_column, count = columns_for(len(kept)), len(found.muscle_names)
    entries: list[Artist] = [
        Patch(fc=(BLUE, 0.25), lw=0, label=f"{100 * low:g} .. {100 * high:g} % of {len(found.solved)} draws"),
        Line2D([], [], color=BLUE, lw=1.2, label="median"),
    ]
    if linear:
        entries.append(Line2D([], [], color=VERMILLION, lw=0.8, label="first order (note: its sd / that of the draws)"))
    entries += left_out(count - len(kept), f"of {count} muscles", "with the narrowest intervals")
    highest = max(float(found.high.max()), float(found.median.max()))
    top = next((t for t in (0.2, 0.5) if t > highest), 1.0)
    with style():
        sheet = Sheet(
            math.ceil(len(kept) / n_column), n_column, panel=(2.2 if n_column < 6 else 1.65, 1.2), gap=(0.32, 0.36),
            title=title or _headline(found), entries=entries,
        )  # fmt: skip
        for place, j in enumerate(kept):
            ax = sheet.panel(place // n_column, place % n_column, found.muscle_names[j])
            ax.stairs(
                found.high[:, j], found.time, baseline=found.low[:, j], fill=True, label="interval", lw=0.0, color=BLUE,
                alpha=0.25, zorder=1.5,
            )  # fmt: skip
            ax.stairs(found.median[:, j], found.time, baseline=None, color=BLUE, lw=1.2, zorder=2.5, label="median")
            if linear:
                for z in (float(ndtri(low)), float(ndtri(high))):
                    edge = found.nominal[:, j] + z * found.first_order_sd[:, j]
                    ax.stairs(
                        edge, found.time, baseline=None, color=VERMILLION, lw=0.7, zorder=2.0, label="first order"
                    )
                if np.isfinite(found.ratio[j]):
                    note(ax, f"{found.ratio[j]:.2f}")
            ax.set_xlim(found.time[0], found.time[-1])
            ax.set_ylim(-0.06 * top, 1.25 * top)
            ax.set_yticks([0.0, top / 2, top], [f"{100 * value:g}" for value in (0.0, top / 2, top)])
            if place % n_column == 0:
                sheet.label_values(ax, "excitation (%)", 0.34)
            else:
                ax.tick_params(axis="y", labelleft=False)
            finish(ax, time_label=place + n_column >= len(kept))
    return sheet.figure


def _headline(found: Intervals) -> str:
    names = [Path(str(found.settings[key])).name for key in ("model", "motion") if key in found.settings]
    spreads = []
    for kind, row in zip(found.kinds, found.spread, strict=True):
        low, high = 100 * row.min(), 100 * row.max()
        spreads.append(f"{readable(kind)} {low:.3g}{'' if low == high else f' .. {high:.3g}'} %")
    return f"Excitation intervals · {', '.join(names)} · sd: {', '.join(spreads)}"

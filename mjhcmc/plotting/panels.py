"""The look of the figures: colours, panels laid out in inches, axes in powers of ten, names a person reads."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.solution import Solution

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#4D4D4D")
"""Okabe and Ito's colors, told apart by color-blind eyes; yellow, too pale for a line, gives way to gray."""

BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, GRAY = PALETTE
_METHOD_COLOR = {"hcmc": BLUE, "cmc": VERMILLION, "static": GREEN}
_METHOD_TITLE = {"hcmc": "HCMC", "cmc": "CMC", "static": "static optimization"}
INK, _SOFT, AXIS, _GRID, DESIRED = "#262626", "#6B6B6B", "#9A9A9A", "#E8E8E8", "#C4C4C4"
SATURATED, FLAGGED = "#FCF3C0", "#EDEDED"

_STYLE: Any = {
    "font.family": "DejaVu Sans",  # ships with matplotlib: figures look the same everywhere
    "font.size": 8.0,
    "text.color": INK,
    "text.usetex": False,
    "axes.edgecolor": AXIS,
    "axes.facecolor": "white",
    "axes.labelcolor": _SOFT,
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlecolor": INK,
    "axes.titlesize": 9.0,
    "axes.unicode_minus": True,
    "figure.facecolor": "white",
    "grid.color": _GRID,
    "grid.linestyle": "-",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "pdf.fonttype": 3,  # half the time of 42 (TrueType) to write
    "savefig.facecolor": "auto",
}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Sheet:
    """A figure of equal panels, laid out in inches from the top left, under a title and a legend."""

    left, right, bottom, min_width = 0.66, 0.2, 0.46, 7.2

    def __init__(
        self, n_row: int, n_column: int, panel: tuple[float, float], gap: tuple[float, float], title: str,
        entries: list[Artist], block: tuple[int, float] = (1, 0.0),
    ) -> None:  # fmt: skip
        """Panel and gap in inches; after every ``block[0]`` rows the gap is wider by ``block[1]``."""
        from matplotlib.figure import Figure

        frame = self.left + (n_column - 1) * gap[0] + self.right
        width = max(frame + n_column * panel[0], self.min_width)
        self._width, self._height = (width - frame) / n_column, panel[1]
        self._gap, self._block = gap, block
        # Text is measured by its length, without a renderer: near enough to break a legend into lines.
        lengths = [0.55 + 0.062 * len(str(entry.get_label())) for entry in entries]
        room = width - self.left
        per_line = len(entries) if sum(lengths) <= room else max(1, int(room / max(lengths)))
        n_line = math.ceil(len(entries) / per_line)
        self._top = 0.36 + 0.17 * n_line + (0.34 if n_row * n_column > 1 else 0.26)
        height = self._row_top(n_row - 1) + self._height + self.bottom
        self.figure = Figure(figsize=(width, height), dpi=100)
        vars(self.figure)["_repr_png_"] = partial(_png, self.figure)  # a notebook shows it without pyplot
        x = self.left / width
        self.figure.suptitle(
            title, x=x, y=1 - 0.13 / height, ha="left", va="top", color=INK,
            fontsize=float(np.clip(12 * room / (0.1 * max(len(title), 1)), 6, 12)),
        )  # fmt: skip
        self.figure.legend(
            handles=entries, loc="upper left", bbox_to_anchor=(x, 1 - 0.38 / height), borderaxespad=0.0,
            ncols=per_line, borderpad=0.0, handlelength=1.8, columnspacing=1.6,
            labelcolor=_SOFT,
        )  # fmt: skip

    def _row_top(self, row: int) -> float:
        every, extra = self._block
        return self._top + row * (self._height + self._gap[1]) + (row // every) * extra

    def panel(self, row: int, column: int, title: str | None = None) -> Axes:
        """The axes at a row and column, with a readable title at its left."""
        width, height = self.figure.get_size_inches()
        x = self.left + column * (self._width + self._gap[0])
        y = height - self._row_top(row) - self._height
        ax = self.figure.add_axes((x / width, y / height, self._width / width, self._height / height))
        if title is not None:
            ax.set_title(shortened(readable(title), int(self._width / 0.077)), loc="left", pad=4.0)
        return ax

    def label_values(self, ax: Axes, label: str, distance: float = 0.4) -> None:
        """Name the vertical axis, at the same distance (inches) in every panel."""
        ax.set_ylabel(label)
        ax.yaxis.set_label_coords(-distance / self._width, 0.5)


def style() -> AbstractContextManager[None]:
    """The figures' own style, whatever surrounds them; a context."""
    import matplotlib

    return matplotlib.rc_context(_STYLE)


def finish(ax: Axes, time_label: bool | None = None) -> None:
    """Fix what matplotlib would else look up when it draws: the figure looks the same outside of `style`."""
    from matplotlib.ticker import MaxNLocator

    ax.tick_params(
        which="both", direction="out", length=2.5, width=0.7, color=AXIS, labelcolor=_SOFT, labelsize=7.5,
        pad=2.5, grid_color=_GRID, grid_linestyle="-", grid_linewidth=0.6, grid_alpha=1.0,
    )  # fmt: skip
    ax.grid(visible=True, which="major")
    if time_label is not None:
        ax.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
        ax.tick_params(axis="x", labelbottom=time_label)
        if time_label:
            ax.set_xlabel("time (s)", labelpad=2.0)


def scale_values(
    sheet: Sheet, ax: Axes, label: str, unit: str, values: Sequence[NDArray[np.float64]], headroom: float = 0.36
) -> None:
    """Limits around the values with room for a note above them; a power of ten in the label where they need one."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    finite = np.concatenate([v[np.isfinite(v)] for v in values] or [np.zeros(1)])
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    peak = max(abs(low), abs(high))
    span = high - low or 2 * (0.1 * peak or 1.0)
    ax.set_ylim(low - 0.1 * span, high + headroom * span)
    exponent = _exponent(peak)
    ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    ax.yaxis.set_major_formatter(FuncFormatter(partial(_tick, exponent)))
    prefix = f"10{str(exponent).translate(_SUPERSCRIPT)} " if exponent else ""
    sheet.label_values(ax, f"{label} ({prefix}{unit})")


def _tick(exponent: int, value: float, _position: int) -> str:
    return f"{value / 10.0**exponent:.4g}".replace("-", "−")


def _exponent(peak: float) -> int:
    """The power of ten to take out of values up to peak, a multiple of 3; 0 where they read well as they are."""
    return 0 if not peak or 0.05 <= peak < 1e4 else 3 * math.floor(math.log10(peak) / 3)


def number(value: float) -> str:
    """A number as ``1.23×10⁻³``, or plain where its size is."""
    exponent = _exponent(value)
    power = f"×10{str(exponent).translate(_SUPERSCRIPT)}" if exponent else ""
    return (f"{value:.0f}" if 1e3 <= value < 1e4 else f"{value / 10.0**exponent:.3g}") + power


def note(ax: Axes, text: str) -> None:
    """A small text in the upper right corner of a panel."""
    ax.text(
        0.985,
        0.97,
        text,
        transform=ax.transAxes,
        ha="right",
        va="top",
        fontsize=7.2,
        color=_SOFT,
        bbox={"fc": "white", "ec": "none", "pad": 1.0},
    )


def shade(
    ax: Axes,
    time: NDArray[np.float64],
    windows: NDArray[np.bool_],
    color: str,
    span: tuple[float, float],
    zorder: float,
) -> None:
    """Shade windows, as one artist, over a span (bottom, height)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], windows, [False]]).astype(int)))
    runs = [(time[a], time[b] - time[a]) for a, b in edges.reshape(-1, 2)]
    if runs:
        ax.broken_barh(runs, span, color=color, lw=0, zorder=zorder)


def by_label(solution: Solution | Mapping[str, Solution]) -> dict[str, Solution]:
    """Solutions by label; a single one has the empty label."""
    return {"": solution} if isinstance(solution, Solution) else dict(solution)


def colors_of(solutions: Mapping[str, Solution]) -> dict[str, str]:
    """A color for each label: its method's own where that is free, so that figures agree with each other."""
    wanted = {label: _METHOD_COLOR.get(str(s.settings.get("method"))) for label, s in solutions.items()}
    chosen: dict[str, str] = {}
    for label, color in wanted.items():
        if color is not None and color not in chosen.values():
            chosen[label] = color
    free = [c for c in PALETTE if c not in chosen.values()]
    for label in solutions:
        if label not in chosen:
            chosen[label] = free.pop(0) if free else GRAY
    return chosen


def headline(solutions: Sequence[Solution]) -> str:
    """Method, model, motion and window of what is drawn; each once, those that a file did not keep left out."""
    methods = [str(s.settings["method"]) for s in solutions if "method" in s.settings]
    parts = [[_METHOD_TITLE.get(m, m) for m in methods]]
    parts += [[str(s.settings[k]) for s in solutions if k in s.settings] for k in ("model", "motion")]
    parts.append([f"dt {1e3 * float(np.median(np.diff(s.time))):.4g} ms" for s in solutions if len(s.time) > 1])
    if any(s.interrupted for s in solutions):
        parts.append(["interrupted"])
    return " · ".join(", ".join(dict.fromkeys(part)) for part in parts if part)


def columns_for(count: int) -> int:
    """How many panels stand side by side, of that many."""
    for limit, columns in ((4, count), (12, 4), (20, 5), (36, 6)):
        if count <= limit:
            return columns
    return 8


def left_out(count: int, of: str, which: str) -> list[Artist]:
    """A legend entry that tells how many are not drawn; none where all are."""
    from matplotlib.lines import Line2D

    return [Line2D([], [], ls="none", label=f"{count} {of} left out: those {which}")] if count else []


def readable(name: str) -> str:
    """A name as a person writes it."""
    return name.replace("_", " ")


def shortened(text: str, keep: int) -> str:
    """The text, or its ends around an ellipsis, of at most that many characters: names differ at either end."""
    return text if len(text) <= keep else f"{text[: keep - keep // 2 - 1]}…{text[len(text) - keep // 2 :]}"


def darker(color: str) -> tuple[float, float, float]:
    """The same colour, darker."""
    from matplotlib.colors import to_rgb

    red, green, blue = (0.55 * c for c in to_rgb(color))
    return red, green, blue


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    with style():
        figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()

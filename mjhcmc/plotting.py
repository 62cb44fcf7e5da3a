"""Figures for a person: excitations, tracking and moments, convergence. Degrees on screen, SI inside.

Figures are plain `matplotlib.figure.Figure` objects without pyplot: they need no screen, leak no state, and show
themselves at the end of a notebook cell. Geometry is set in inches, so that panels keep their size however many there
are.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import OutputError, SettingsError
from mjhcmc.solution import Solution, WindowStatus, moment_scale

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#4D4D4D")
"""Okabe and Ito's colors, told apart by color-blind eyes; yellow, too pale for a line, gives way to gray."""

_BLUE, _VERMILLION, _GREEN, _PURPLE, _ORANGE, _SKY, _GRAY = PALETTE
_METHOD_COLOR = {"hcmc": _BLUE, "cmc": _VERMILLION, "static": _GREEN}
_METHOD_TITLE = {"hcmc": "HCMC", "cmc": "CMC", "static": "static optimization"}
_STATUS_TITLE = {
    WindowStatus.RESERVE: "reserve in use",
    WindowStatus.UNMET: "moment unmet",
    WindowStatus.STIFF: "too stiff for the step",
}
_INK, _SOFT, _AXIS, _GRID, _DESIRED = "#262626", "#6B6B6B", "#9A9A9A", "#E8E8E8", "#C4C4C4"
_SATURATED, _FLAGGED = "#FCF3C0", "#EDEDED"

_STYLE: Any = {
    "font.family": "DejaVu Sans",  # ships with matplotlib: figures look the same everywhere
    "font.size": 8.0,
    "text.color": _INK,
    "text.usetex": False,
    "axes.edgecolor": _AXIS,
    "axes.facecolor": "white",
    "axes.labelcolor": _SOFT,
    "axes.labelsize": 8.0,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlecolor": _INK,
    "axes.titlesize": 9.0,
    "axes.unicode_minus": True,
    "figure.facecolor": "white",
    "grid.color": _GRID,
    "grid.linestyle": "-",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "pdf.fonttype": 42,  # text stays text in a drawing program
    "savefig.facecolor": "auto",
}
_PNG_DPI = 200
_SATURATION = 0.999
_FULL, _BAR = 1.05, 0.05  # top of the shaded part of an excitation panel; a status bar above it
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def excitation_figure(solution: Solution | Mapping[str, Solution]) -> Figure:
    """Excitation and activation of every muscle, one panel each.

    Excitation is a step (constant over a window), activation a thin line of the same hue. With one solution, the
    windows where a muscle is saturated and those whose status is not OK are shaded; with several, a bar of the
    method's color along the top of the panels marks the windows whose status is not OK.

    Args:
        solution: one solution, or several by label, drawn over each other and told apart by color. A muscle that not
            all of them have is drawn for those that have it.

    Raises:
        SettingsError: no solution, or no muscle, is given.
    """
    solutions = _by_label(solution)
    muscles = tuple(dict.fromkeys(name for s in solutions.values() for name in s.muscle_names))
    if not muscles:
        raise SettingsError("excitation_figure: nothing to draw: give at least one solution with a muscle")
    colors = _colors(solutions)
    n_column = _columns(len(muscles))
    with _style():
        sheet = _Sheet(
            math.ceil(len(muscles) / n_column), n_column,
            panel=(2.2 if n_column < 6 else 1.65, 1.12), gap=(0.32, 0.36),
            title=f"Muscle excitation · {_headline(list(solutions.values()))}",
            entries=_excitation_legend(solutions, colors),
        )  # fmt: skip
        first = min(s.time[0] for s in solutions.values())
        last = max(s.time[-1] for s in solutions.values())
        flagged = any((s.status != WindowStatus.OK).any() for s in solutions.values())
        top = _FULL + _BAR * len(solutions) if flagged and len(solutions) > 1 else _FULL
        for i, name in enumerate(muscles):
            ax = sheet.panel(i // n_column, i % n_column, name)
            for rank, (label, one) in enumerate(solutions.items()):
                if name in one.muscle_names:
                    _draw_muscle(ax, one, one.muscle_names.index(name), colors[label], rank, len(solutions) == 1)
            ax.set_xlim(first, last)
            ax.set_ylim(-0.02, top)
            ax.set_yticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
            if i % n_column == 0:
                sheet.label_values(ax, "excitation (–)", 0.3)
            else:
                ax.tick_params(axis="y", labelleft=False)
            _finish(ax, time_label=i + n_column >= len(muscles))
    return sheet.figure


def _draw_muscle(ax: Axes, solution: Solution, j: int, color: str, rank: int, alone: bool) -> None:
    from matplotlib.colors import to_rgba

    time, excitation, activation = solution.time, solution.excitation[:, j], solution.activation[:, j]
    flagged = solution.status != WindowStatus.OK
    if alone:
        _shade(ax, time, flagged, _FLAGGED, (0.0, _FULL), zorder=0.4)
        ax.stairs(excitation, time, fill=True, color=color, alpha=0.16, lw=0, zorder=1.5, label="fill")
        _shade(ax, time, excitation >= _SATURATION, _SATURATED, (0.0, _FULL), zorder=1.6)
    else:
        _shade(ax, time, flagged, color, (_FULL + _BAR * rank, 0.7 * _BAR), zorder=1.6)
    ax.stairs(excitation, time, baseline=None, color=color, lw=1.1, alpha=0.8, zorder=2.0 + rank, label="excitation")
    hue, width = ((*_darker(color), 1.0), 0.8) if alone else (to_rgba(color, 0.6), 0.7)
    ax.plot(time, activation, color=hue, lw=width, zorder=2.5 + rank, label="activation")


def _excitation_legend(solutions: Mapping[str, Solution], colors: Mapping[str, str]) -> list[Artist]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    found = {int(k) for s in solutions.values() for k in s.status}
    kinds = [title for status, title in _STATUS_TITLE.items() if status in found]
    if len(solutions) > 1:
        entries: list[Artist] = [Line2D([], [], color=colors[k], lw=1.8, label=k) for k in solutions]
        entries.append(Line2D([], [], color=_GRAY, lw=1.1, drawstyle="steps", label="step: excitation"))
        entries.append(Line2D([], [], color=_GRAY, lw=0.7, alpha=0.6, label="thin: activation"))
        if kinds:
            entries.append(Patch(color=_GRAY, lw=0, label="bar at the top: " + ", ".join(kinds)))
        return entries
    ((label, one),) = solutions.items()
    color = colors[label]
    step = Patch(fc=(color, 0.16), ec=(color, 0.75), lw=1.1, label="excitation")
    entries = [step, Line2D([], [], color=_darker(color), lw=0.8, label="activation")]
    if (one.excitation >= _SATURATION).any():
        entries.append(Patch(color=_SATURATED, lw=0, label="saturated"))
    if kinds:
        entries.append(Patch(color=_FLAGGED, lw=0, label=", ".join(kinds)))
    return entries


def tracking_figure(solution: Solution) -> Figure:
    """Angle, tracking error and net joint moment with reserve, a column for each joint.

    Each row has its own scale in each column. More than four joints continue below. Where reserves were off, what the
    muscles could not give is drawn in the reserve's place and called unmet.

    Raises:
        SettingsError: the solution has no joint.
    """
    n_joint = len(solution.dof_names)
    if not n_joint:
        raise SettingsError("tracking_figure: the solution has no joint: nothing to draw")
    n_column = min(n_joint, 3 if n_joint in (5, 6, 9) else 4)
    with _style():
        sheet = _Sheet(
            3 * math.ceil(n_joint / n_column), n_column, panel=(2.6 if n_column < 4 else 2.3, 1.25),
            gap=(0.7, 0.2), title=f"Tracking and joint moments · {_headline([solution])}",
            entries=_tracking_legend(solution), block=(3, 0.5),
        )  # fmt: skip
        for j, name in enumerate(solution.dof_names):
            row, column = 3 * (j // n_column), j % n_column
            for i, draw in enumerate((_draw_angle, _draw_error, _draw_moment)):
                ax = sheet.panel(row + i, column, name if i == 0 else None)
                draw(sheet, ax, solution, j)
                ax.set_xlim(solution.time[0], solution.time[-1])
                _finish(ax, time_label=i == 2)
    return sheet.figure


def _unit(solution: Solution, j: int) -> tuple[str, float]:
    return ("deg", 180 / np.pi) if solution.dof_is_rotation[j] else ("m", 1.0)


def _draw_angle(sheet: _Sheet, ax: Axes, solution: Solution, j: int) -> None:
    unit, factor = _unit(solution, j)
    # Hinge and slide joints only: coordinate j belongs to degree of freedom j.
    desired, actual = solution.qpos_desired[:, j] * factor, solution.qpos[:, j] * factor
    ax.plot(solution.time, desired, color=_DESIRED, lw=4.0, solid_capstyle="round", label="desired")
    ax.plot(solution.time, actual, color=_BLUE, lw=1.1, label="actual")
    _scale_values(sheet, ax, "angle" if unit == "deg" else "position", unit, [desired, actual], headroom=0.1)


def _draw_error(sheet: _Sheet, ax: Axes, solution: Solution, j: int) -> None:
    unit, factor = _unit(solution, j)
    error = solution.tracking_error[:, j] * factor
    ax.axhline(0.0, color=_AXIS, lw=0.6, zorder=1.5)
    ax.plot(solution.time, error, color=_VERMILLION, lw=1.1, label="tracking error")
    _scale_values(sheet, ax, "error", unit, [error])
    k = int(np.argmax(np.where(np.isfinite(error), np.abs(error), -1.0)))
    ax.plot(solution.time[k], error[k], "o", ms=3.4, mfc="white", mec=_VERMILLION, clip_on=False, label="max")
    _note(ax, f"max {_number(abs(error[k]))} {unit} at {solution.time[k]:.4g} s")


def _draw_moment(sheet: _Sheet, ax: Axes, solution: Solution, j: int) -> None:
    quantity, unit = ("moment", "N m") if solution.dof_is_rotation[j] else ("force", "N")
    word, part = _missing(solution)
    moment, missing = solution.net_joint_moment[:, j], part[:, j]
    ax.axhline(0.0, color=_AXIS, lw=0.6, zorder=1.5)
    ax.stairs(missing, solution.time, fill=True, color=_ORANGE, alpha=0.65, lw=0, zorder=1.8, label=word)
    ax.plot(solution.time, moment, color=_GREEN, lw=1.1, label=f"net joint {quantity}")
    _scale_values(sheet, ax, quantity, unit, [moment, missing])
    peak = float(np.abs(missing).max(initial=0.0))
    share = 100 * peak / moment_scale(solution.net_joint_moment)[j]
    if share >= 0.01:
        _note(ax, f"{word} {_number(peak)} {unit}, {share:{'.2g' if share < 10 else '.0f'}} % of peak")
    else:
        _note(ax, f"{word} under 0.01 % of peak" if peak else f"{word} zero")


def _missing(solution: Solution) -> tuple[str, NDArray[np.float64]]:
    """What the muscles did not give: the reserve or, where reserves were off, what nothing gave."""
    if not solution.reserve.any() and solution.shortfall.any():
        return "unmet", solution.shortfall
    return "reserve", solution.reserve


def _tracking_legend(solution: Solution) -> list[Artist]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Line2D([], [], color=_DESIRED, lw=4.0, solid_capstyle="butt", label="desired"),
        Line2D([], [], color=_BLUE, lw=1.1, label="actual"),
        Line2D([], [], color=_VERMILLION, lw=1.1, label="tracking error"),
        Line2D([], [], color=_GREEN, lw=1.1, label="net joint moment"),
        Patch(color=_ORANGE, alpha=0.65, lw=0, label=f"{_missing(solution)[0]} moment"),
    ]


def convergence_figure(
    dt: ArrayLike,
    max_error_deg: ArrayLike,
    dof_names: Sequence[str],
    title: str = "Tracking error against the control window",
) -> Figure:
    """Largest tracking error against the control window, both logarithmic, with a line of order 2 to compare with.

    Args:
        dt: (n,) s, control windows, in any order.
        max_error_deg: (n, nv) deg; a value that is not positive has no place on the axis and is left out.
        dof_names: (nv,) names.
        title: what is drawn.

    Raises:
        SettingsError: the shapes do not fit, or a dt is not positive.
    """
    h, error = np.asarray(dt, dtype=np.float64), np.asarray(max_error_deg, dtype=np.float64)
    if h.ndim != 1 or not h.size or error.shape != (h.size, len(dof_names)) or not len(dof_names):
        raise SettingsError(
            f"convergence_figure: dt has shape {h.shape}, max_error_deg {error.shape} and there are {len(dof_names)} "
            "names: give (n,), (n, nv) and nv"
        )
    if not (np.isfinite(h) & (h > 0)).all():
        raise SettingsError(f"convergence_figure: every dt must be positive; got {h.tolist()}")
    from matplotlib.lines import Line2D

    order = np.argsort(h)
    h, error = h[order], np.where(error[order] > 0, error[order], np.nan)
    markers = "osD^vP*"
    with _style():
        curves = [
            Line2D(
                h, error[:, j], color=PALETTE[j % 7], marker=markers[(j + j // 7) % 7],
                ms=5.0, mec="white", mew=0.6, lw=1.3, label=_readable(name),
            )
            for j, name in enumerate(dof_names)
        ]  # fmt: skip
        guide = Line2D([], [], color=_AXIS, lw=1.2, ls=(0, (4, 2)), label="order 2")
        sheet = _Sheet(1, 1, (6.2, 3.6), (0.0, 0.0), title, [*curves, guide])
        ax = sheet.panel(0, 0)
        ax.set_xscale("log")
        ax.set_yscale("log")
        for curve in curves:
            ax.add_line(curve)
        if np.isfinite(error).any():
            # Below every point: slopes are compared, nothing is crossed.
            level = 0.5 * float(np.nanmin(error / h[:, None] ** 2))
            guide.set_data(h, level * h**2)
        ax.add_line(guide)
        ax.autoscale_view()
        ax.set_xticks(h, [f"{1e3 * value:g}" for value in h])
        ax.set_xticks([], minor=True)
        ax.set_xlabel("control window dt (ms)")
        sheet.label_values(ax, "max |tracking error| (deg)")
        _finish(ax)
    return sheet.figure


def save_figure(figure: Figure, stem: str | Path) -> list[Path]:
    """Write ``stem.png`` (200 dpi) and ``stem.pdf``, both drawn before either is put in place.

    The same figure gives the same bytes.

    Args:
        figure: the figure.
        stem: path without suffix; files of these names are replaced.

    Returns:
        The paths written, PNG first.

    Raises:
        OutputError: the folder does not exist, or cannot be written.
    """
    stem = Path(stem)
    title = figure.get_suptitle()
    metadata: dict[str, dict[str, Any]] = {
        "png": {"Software": "mjhcmc", "Title": title},
        "pdf": {"Creator": "mjhcmc", "Producer": None, "CreationDate": None, "Title": title},
    }
    paths = {kind: stem.with_name(f"{stem.name}.{kind}") for kind in metadata}
    temporaries = {kind: path.with_name(f".{path.name}.{os.getpid()}.tmp") for kind, path in paths.items()}
    path = stem
    try:
        try:
            for kind, temporary in temporaries.items():
                path = paths[kind]
                with _style():
                    figure.savefig(temporary, format=kind, dpi=_PNG_DPI, metadata=metadata[kind])
            for kind, temporary in temporaries.items():
                path = paths[kind]
                temporary.replace(path)
        finally:
            for temporary in temporaries.values():
                temporary.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror}): choose a folder that exists and can be written"
        ) from error
    return list(paths.values())


class _Sheet:
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
            title, x=x, y=1 - 0.13 / height, ha="left", va="top", color=_INK,
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
            text = _readable(title)
            keep = int(self._width / 0.077)
            if len(text) > keep:  # both ends: names differ at either
                text = f"{text[: keep - keep // 2 - 1]}…{text[len(text) - keep // 2 :]}"
            ax.set_title(text, loc="left", pad=4.0)
        return ax

    def label_values(self, ax: Axes, label: str, distance: float = 0.4) -> None:
        """Name the vertical axis, at the same distance (inches) in every panel."""
        ax.set_ylabel(label)
        ax.yaxis.set_label_coords(-distance / self._width, 0.5)


def _style() -> AbstractContextManager[None]:
    import matplotlib

    return matplotlib.rc_context(_STYLE)


def _finish(ax: Axes, time_label: bool | None = None) -> None:
    """Fix what matplotlib would else look up when it draws: the figure looks the same outside of `_style`."""
    from matplotlib.ticker import MaxNLocator

    ax.tick_params(
        which="both", direction="out", length=2.5, width=0.7, color=_AXIS, labelcolor=_SOFT, labelsize=7.5,
        pad=2.5, grid_color=_GRID, grid_linestyle="-", grid_linewidth=0.6, grid_alpha=1.0,
    )  # fmt: skip
    ax.grid(visible=True, which="major")
    if time_label is not None:
        ax.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
        ax.tick_params(axis="x", labelbottom=time_label)
        if time_label:
            ax.set_xlabel("time (s)", labelpad=2.0)


def _scale_values(
    sheet: _Sheet, ax: Axes, label: str, unit: str, values: Sequence[NDArray[np.float64]], headroom: float = 0.36
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


def _number(value: float) -> str:
    exponent = _exponent(value)
    power = f"×10{str(exponent).translate(_SUPERSCRIPT)}" if exponent else ""
    return (f"{value:.0f}" if 1e3 <= value < 1e4 else f"{value / 10.0**exponent:.3g}") + power


def _note(ax: Axes, text: str) -> None:
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


def _shade(
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


def _by_label(solution: Solution | Mapping[str, Solution]) -> dict[str, Solution]:
    return {"": solution} if isinstance(solution, Solution) else dict(solution)


def _colors(solutions: Mapping[str, Solution]) -> dict[str, str]:
    """A color for each label: its method's own where that is free, so that figures agree with each other."""
    wanted = {label: _METHOD_COLOR.get(str(s.settings.get("method"))) for label, s in solutions.items()}
    chosen: dict[str, str] = {}
    for label, color in wanted.items():
        if color is not None and color not in chosen.values():
            chosen[label] = color
    free = [c for c in PALETTE if c not in chosen.values()]
    for label in solutions:
        if label not in chosen:
            chosen[label] = free.pop(0) if free else _GRAY
    return chosen


def _headline(solutions: Sequence[Solution]) -> str:
    """Method, model, motion and window of what is drawn; each once, those that a file did not keep left out."""
    methods = [str(s.settings["method"]) for s in solutions if "method" in s.settings]
    parts = [[_METHOD_TITLE.get(m, m) for m in methods]]
    parts += [[Path(str(s.settings[k])).name for s in solutions if k in s.settings] for k in ("model", "motion")]
    parts.append([f"dt {1e3 * float(np.median(np.diff(s.time))):.4g} ms" for s in solutions if len(s.time) > 1])
    if any(s.interrupted for s in solutions):
        parts.append(["interrupted"])
    return " · ".join(", ".join(dict.fromkeys(part)) for part in parts if part)


def _columns(count: int) -> int:
    for limit, columns in ((4, count), (12, 4), (20, 5), (36, 6)):
        if count <= limit:
            return columns
    return 8


def _readable(name: str) -> str:
    return name.replace("_", " ")


def _darker(color: str) -> tuple[float, float, float]:
    from matplotlib.colors import to_rgb

    red, green, blue = (0.55 * c for c in to_rgb(color))
    return red, green, blue


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    with _style():
        figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()

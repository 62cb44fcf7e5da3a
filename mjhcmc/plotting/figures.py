"""Figures for a person: excitations, convergence. Degrees on screen, SI inside.

Figures are plain `matplotlib.figure.Figure` objects without pyplot: they need no screen, leak no state, and show
themselves at the end of a notebook cell. Geometry is set in inches, so that panels keep their size however many there
are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from mjhcmc.activity import Activity
from mjhcmc.errors import SettingsError
from mjhcmc.io.files import written_whole
from mjhcmc.plotting.panels import (
    AXIS,
    FLAGGED,
    INK,
    PALETTE,
    SATURATED,
    Sheet,
    by_label,
    colors_of,
    columns_for,
    darker,
    finish,
    headline,
    left_out,
    readable,
    shade,
    style,
)
from mjhcmc.solution import Solution, WindowStatus

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STATUS_TITLE = {
    WindowStatus.RESERVE: "reserve in use",
    WindowStatus.UNMET: "moment unmet",
    WindowStatus.STIFF: "too stiff for the step",
}
_DASHES = ((0, (3.5, 1.6)), (0, (1.2, 1.2)), (0, (6.0, 1.5, 1.2, 1.5)))
_MAIN, _PEER = 3.0, 1.0  # widths of the first solution's line and of those that lie in and beside it
_PNG_DPI = 200
_SATURATION = 0.999
_FULL = 1.05  # room above full excitation
_TOPS = (0.2, 0.5)  # of panels where no muscle does more; else 1
_MOST = 36  # muscles drawn of a model that has more


def excitation_figure(
    solution: Solution | Mapping[str, Solution], overlay: Mapping[str, Activity] | None = None
) -> Figure:
    """Excitation and activation of every muscle, one panel each; of more than 36, those with the highest peaks.

    Excitation is a step (constant over a window), activation a line of the same hue. With one solution, the windows
    where a muscle is saturated and those whose status is not OK are shaded. Several are compared by their activations:
    the first as a wide line, the others as thin lines on it, which stay visible where they agree; excitation is drawn
    for the first alone, and the legend counts the windows whose status is not OK. A peak is that of excitation or
    activation, in any solution or overlay; muscles stay in the model's order, and the legend counts those left out. All
    panels reach to 1, or to .2 or .5 where no muscle does more.

    Args:
        solution: one solution, or several by label, the one that matters first, drawn over each other and told apart by
            color. A muscle that not all of them have is drawn for those that have it.
        overlay: what others found, by label: its activation (or its excitation, where that is all there is) as a thin
            dark dashed line in the panels of the muscles that it has.

    Raises:
        SettingsError: no solution, or no muscle, is given, or an overlay has none of the muscles.
    """
    solutions = by_label(solution)
    muscles = tuple(dict.fromkeys(name for s in solutions.values() for name in s.muscle_names))
    if not muscles:
        raise SettingsError("excitation_figure: nothing to draw: give at least one solution with a muscle")
    overlay = overlay or {}
    for label, other in overlay.items():
        if not set(other.muscle_names) & set(muscles):
            raise SettingsError(
                f"excitation_figure: overlay {label!r} has none of the muscles {', '.join(muscles)}: use their names"
            )
    colors = colors_of(solutions)
    count = len(muscles)
    muscles, top = _busiest(muscles, solutions, overlay)
    n_column = columns_for(len(muscles))
    alone = len(solutions) == 1
    quantity = "excitation" if alone else "activation"
    with style():
        sheet = Sheet(
            math.ceil(len(muscles) / n_column), n_column,
            panel=(2.2 if n_column < 6 else 1.65, 1.12 if alone else 1.3), gap=(0.32, 0.36),
            title=f"Muscle {quantity} · {headline(list(solutions.values()))}",
            entries=[
                *_excitation_legend(solutions, colors), *_overlay_legend(overlay),
                *left_out(count - len(muscles), f"of {count} muscles", "with the lowest peaks"),
            ],
        )  # fmt: skip
        first = min(s.time[0] for s in solutions.values())
        last = max(s.time[-1] for s in solutions.values())
        for i, name in enumerate(muscles):
            ax = sheet.panel(i // n_column, i % n_column, name)
            for rank, (label, one) in enumerate(solutions.items()):
                if name in one.muscle_names:
                    j = one.muscle_names.index(name)
                    if alone:
                        _draw_alone(ax, one, j, colors[label])
                    else:
                        _draw_compared(ax, one, j, colors[label], rank)
            for rank, (label, other) in enumerate(overlay.items()):
                if name in other.muscle_names:
                    values = other.excitation if other.activation is None else other.activation
                    assert values is not None  # Activity has one of them
                    column = values[:, other.muscle_names.index(name)]
                    ax.plot(other.time, column, label=label, zorder=4.0 + rank, **_overlay_style(rank))
            ax.set_xlim(first, last)
            ax.set_ylim(-0.02 * top, _FULL * top)
            ax.set_yticks([0.0, top / 2, top], ["0", f"{top / 2:g}", f"{top:g}"])
            if i % n_column == 0:
                sheet.label_values(ax, f"{quantity} (–)", 0.3)
            else:
                ax.tick_params(axis="y", labelleft=False)
            finish(ax, time_label=i + n_column >= len(muscles))
    return sheet.figure


def _busiest(
    muscles: Sequence[str], solutions: Mapping[str, Solution], overlay: Mapping[str, Activity]
) -> tuple[tuple[str, ...], float]:
    """The muscles with the highest peaks, in the order given (all where they are few), and the top of their panels."""
    peak = dict.fromkeys(muscles, -np.inf)
    everyone: list[Solution | Activity] = [*solutions.values(), *overlay.values()]
    for one in everyone:
        for values in (one.excitation, one.activation):
            if values is not None:
                for name, own in zip(one.muscle_names, values.max(axis=0).tolist(), strict=True):
                    if name in peak:
                        peak[name] = max(peak[name], own)
    kept = set(sorted(muscles, key=lambda name: -peak[name])[:_MOST])
    highest = max(peak.values())
    return tuple(name for name in muscles if name in kept), next((t for t in _TOPS if t > highest), 1.0)


def _draw_alone(ax: Axes, solution: Solution, j: int, color: str) -> None:
    time, excitation = solution.time, solution.excitation[:, j]
    shade(ax, time, solution.status != WindowStatus.OK, FLAGGED, (0.0, _FULL), zorder=0.4)
    ax.stairs(excitation, time, fill=True, color=color, alpha=0.16, lw=0, zorder=1.5, label="fill")
    shade(ax, time, excitation >= _SATURATION, SATURATED, (0.0, _FULL), zorder=1.6)
    ax.stairs(excitation, time, baseline=None, color=color, lw=1.1, alpha=0.8, zorder=2.0, label="excitation")
    ax.plot(time, solution.activation[:, j], color=darker(color), lw=0.8, zorder=2.5, label="activation")


def _draw_compared(ax: Axes, solution: Solution, j: int, color: str, rank: int) -> None:
    """One of several: the first wide, under the others, with its excitation; the others thin."""
    time = solution.time
    if rank == 0:
        excitation = solution.excitation[:, j]
        ax.stairs(excitation, time, fill=True, color=color, alpha=0.13, lw=0, zorder=1.5, label="fill")
        ax.stairs(excitation, time, baseline=None, color=color, lw=0.6, alpha=0.55, zorder=1.6, label="excitation")
    # below 4: overlays lie on top of any number of solutions
    ax.plot(
        time, solution.activation[:, j], color=color, zorder=4.0 - 1.0 / (1 + rank), label="activation", **_line(rank)
    )


def _line(rank: int) -> dict[str, Any]:
    return {"lw": _PEER} if rank else {"lw": _MAIN, "alpha": 0.6, "solid_capstyle": "butt"}


def _overlay_style(rank: int) -> dict[str, Any]:
    return {"color": INK, "lw": 0.8, "ls": _DASHES[rank % len(_DASHES)]}


def _overlay_legend(overlay: Mapping[str, Activity]) -> list[Artist]:
    from matplotlib.lines import Line2D

    return [
        Line2D(
            [], [], label=f"{label} ({'excitation' if other.activation is None else 'activation'})", **_overlay_style(i)
        )
        for i, (label, other) in enumerate(overlay.items())
    ]


def _excitation_legend(solutions: Mapping[str, Solution], colors: Mapping[str, str]) -> list[Artist]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if len(solutions) > 1:
        main = next(iter(solutions))
        entries: list[Artist] = [
            Line2D([], [], color=colors[label], label=f"{label}{_flags(one)}", **_line(rank))
            for rank, (label, one) in enumerate(solutions.items())
        ]
        return [
            *entries,
            Patch(fc=(colors[main], 0.13), ec=(colors[main], 0.55), lw=0.6, label=f"excitation of {main}"),
        ]
    ((label, one),) = solutions.items()
    color = colors[label]
    step = Patch(fc=(color, 0.16), ec=(color, 0.75), lw=1.1, label="excitation")
    entries = [step, Line2D([], [], color=darker(color), lw=0.8, label="activation")]
    if (one.excitation >= _SATURATION).any():
        entries.append(Patch(color=SATURATED, lw=0, label="saturated"))
    kinds = [title for status, title in _STATUS_TITLE.items() if (one.status == status).any()]
    if kinds:
        entries.append(Patch(color=FLAGGED, lw=0, label=", ".join(kinds)))
    return entries


def _flags(solution: Solution) -> str:
    """How many windows are not OK, and why, for a legend."""
    counts = [(title, np.count_nonzero(solution.status == status)) for status, title in _STATUS_TITLE.items()]
    told = ", ".join(f"{title} in {n} of {solution.n_window} windows" for title, n in counts if n)
    return f" ({told})" if told else ""


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
    with style():
        curves = [
            Line2D(
                h, error[:, j], color=PALETTE[j % 7], marker=markers[(j + j // 7) % 7],
                ms=5.0, mec="white", mew=0.6, lw=1.3, label=readable(name),
            )
            for j, name in enumerate(dof_names)
        ]  # fmt: skip
        guide = Line2D([], [], color=AXIS, lw=1.2, ls=(0, (4, 2)), label="order 2")
        sheet = Sheet(1, 1, (6.2, 3.6), (0.0, 0.0), title, [*curves, guide])
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
        finish(ax)
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
    paths = [stem.with_name(f"{stem.name}.{kind}") for kind in metadata]
    with ExitStack() as stack:
        for path, (kind, data) in zip(paths, metadata.items(), strict=True):
            temporary = stack.enter_context(written_whole(path))
            with style():
                figure.savefig(temporary, format=kind, dpi=_PNG_DPI, metadata=data)
    return paths


def save_figures(figures: Mapping[str, Callable[[], Figure]], folder: Path) -> list[str]:
    """Draw figures by name and save each into a folder, see `save_figure`; the paths written."""
    return [str(path) for name, draw in figures.items() for path in save_figure(draw(), folder / name)]

"""Figures for a person: excitations, tracking and moments, convergence. Degrees on screen, SI inside.

Figures are plain `matplotlib.figure.Figure` objects without pyplot: they need no screen, leak no state, and show
themselves at the end of a notebook cell. Geometry is set in inches, so that panels keep their size however many there
are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.activity import Activity
from mjhcmc.errors import SettingsError
from mjhcmc.io.files import written_whole
from mjhcmc.plotting.panels import (
    AXIS,
    BLUE,
    DESIRED,
    FLAGGED,
    GREEN,
    INK,
    ORANGE,
    PALETTE,
    SATURATED,
    VERMILLION,
    Sheet,
    by_label,
    colors_of,
    columns_for,
    darker,
    finish,
    headline,
    note,
    number,
    readable,
    scale_values,
    shade,
    style,
)
from mjhcmc.solution import Solution, WindowStatus, moment_scale

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
_FULL = 1.05  # top of an excitation panel


def excitation_figure(
    solution: Solution | Mapping[str, Solution], overlay: Mapping[str, Activity] | None = None
) -> Figure:
    """Excitation and activation of every muscle, one panel each.

    Excitation is a step (constant over a window), activation a line of the same hue. With one solution, the windows
    where a muscle is saturated and those whose status is not OK are shaded. Several are compared by their activations:
    the first as a wide line, the others as thin lines on it, which stay visible where they agree; excitation is drawn
    for the first alone, and the legend counts the windows whose status is not OK.

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
    n_column = columns_for(len(muscles))
    alone = len(solutions) == 1
    quantity = "excitation" if alone else "activation"
    with style():
        sheet = Sheet(
            math.ceil(len(muscles) / n_column), n_column,
            panel=(2.2 if n_column < 6 else 1.65, 1.12 if alone else 1.3), gap=(0.32, 0.36),
            title=f"Muscle {quantity} · {headline(list(solutions.values()))}",
            entries=[*_excitation_legend(solutions, colors), *_overlay_legend(overlay)],
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
            ax.set_ylim(-0.02, _FULL)
            ax.set_yticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
            if i % n_column == 0:
                sheet.label_values(ax, f"{quantity} (–)", 0.3)
            else:
                ax.tick_params(axis="y", labelleft=False)
            finish(ax, time_label=i + n_column >= len(muscles))
    return sheet.figure


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
    with style():
        sheet = Sheet(
            3 * math.ceil(n_joint / n_column), n_column, panel=(2.6 if n_column < 4 else 2.3, 1.25),
            gap=(0.7, 0.2), title=f"Tracking and joint moments · {headline([solution])}",
            entries=_tracking_legend(solution), block=(3, 0.5),
        )  # fmt: skip
        for j, name in enumerate(solution.dof_names):
            row, column = 3 * (j // n_column), j % n_column
            for i, draw in enumerate((_draw_angle, _draw_error, _draw_moment)):
                ax = sheet.panel(row + i, column, name if i == 0 else None)
                draw(sheet, ax, solution, j)
                ax.set_xlim(solution.time[0], solution.time[-1])
                finish(ax, time_label=i == 2)
    return sheet.figure


def _unit(solution: Solution, j: int) -> tuple[str, float]:
    return ("deg", 180 / np.pi) if solution.dof_is_rotation[j] else ("m", 1.0)


def _draw_angle(sheet: Sheet, ax: Axes, solution: Solution, j: int) -> None:
    unit, factor = _unit(solution, j)
    # Hinge and slide joints only: coordinate j belongs to degree of freedom j.
    desired, actual = solution.qpos_desired[:, j] * factor, solution.qpos[:, j] * factor
    ax.plot(solution.time, desired, color=DESIRED, lw=4.0, solid_capstyle="round", label="desired")
    ax.plot(solution.time, actual, color=BLUE, lw=1.1, label="actual")
    scale_values(sheet, ax, "angle" if unit == "deg" else "position", unit, [desired, actual], headroom=0.1)


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
    moment, missing = solution.net_joint_moment[:, j], part[:, j]
    ax.axhline(0.0, color=AXIS, lw=0.6, zorder=1.5)
    ax.stairs(missing, solution.time, fill=True, color=ORANGE, alpha=0.65, lw=0, zorder=1.8, label=word)
    ax.plot(solution.time, moment, color=GREEN, lw=1.1, label=f"net joint {quantity}")
    scale_values(sheet, ax, quantity, unit, [moment, missing])
    peak = float(np.abs(missing).max(initial=0.0))
    share = 100 * peak / moment_scale(solution.net_joint_moment)[j]
    if share >= 0.01:
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

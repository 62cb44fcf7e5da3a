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
    GRAY,
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
_PNG_DPI = 200
_SATURATION = 0.999
_FULL, _BAR = 1.05, 0.05  # top of the shaded part of an excitation panel; a status bar above it


def excitation_figure(
    solution: Solution | Mapping[str, Solution], overlay: Mapping[str, Activity] | None = None
) -> Figure:
    """Excitation and activation of every muscle, one panel each.

    Excitation is a step (constant over a window), activation a thin line of the same hue. With one solution, the
    windows where a muscle is saturated and those whose status is not OK are shaded; with several, a bar of the
    method's color along the top of the panels marks the windows whose status is not OK.

    Args:
        solution: one solution, or several by label, drawn over each other and told apart by color. A muscle that not
            all of them have is drawn for those that have it.
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
    with style():
        sheet = Sheet(
            math.ceil(len(muscles) / n_column), n_column,
            panel=(2.2 if n_column < 6 else 1.65, 1.12), gap=(0.32, 0.36),
            title=f"Muscle excitation · {headline(list(solutions.values()))}",
            entries=[*_excitation_legend(solutions, colors), *_overlay_legend(overlay)],
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
            for rank, (label, other) in enumerate(overlay.items()):
                if name in other.muscle_names:
                    values = other.excitation if other.activation is None else other.activation
                    assert values is not None  # Activity has one of them
                    column = values[:, other.muscle_names.index(name)]
                    ax.plot(other.time, column, label=label, zorder=8.0 + rank, **_overlay_style(rank))
            ax.set_xlim(first, last)
            ax.set_ylim(-0.02, top)
            ax.set_yticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
            if i % n_column == 0:
                sheet.label_values(ax, "excitation (–)", 0.3)
            else:
                ax.tick_params(axis="y", labelleft=False)
            finish(ax, time_label=i + n_column >= len(muscles))
    return sheet.figure


def _draw_muscle(ax: Axes, solution: Solution, j: int, color: str, rank: int, alone: bool) -> None:
    from matplotlib.colors import to_rgba

    time, excitation, activation = solution.time, solution.excitation[:, j], solution.activation[:, j]
    flagged = solution.status != WindowStatus.OK
    if alone:
        shade(ax, time, flagged, FLAGGED, (0.0, _FULL), zorder=0.4)
        ax.stairs(excitation, time, fill=True, color=color, alpha=0.16, lw=0, zorder=1.5, label="fill")
        shade(ax, time, excitation >= _SATURATION, SATURATED, (0.0, _FULL), zorder=1.6)
    else:
        shade(ax, time, flagged, color, (_FULL + _BAR * rank, 0.7 * _BAR), zorder=1.6)
    ax.stairs(excitation, time, baseline=None, color=color, lw=1.1, alpha=0.8, zorder=2.0 + rank, label="excitation")
    hue, width = ((*darker(color), 1.0), 0.8) if alone else (to_rgba(color, 0.6), 0.7)
    ax.plot(time, activation, color=hue, lw=width, zorder=2.5 + rank, label="activation")


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

    found = {int(k) for s in solutions.values() for k in s.status}
    kinds = [title for status, title in _STATUS_TITLE.items() if status in found]
    if len(solutions) > 1:
        entries: list[Artist] = [Line2D([], [], color=colors[k], lw=1.8, label=k) for k in solutions]
        entries.append(Line2D([], [], color=GRAY, lw=1.1, drawstyle="steps", label="step: excitation"))
        entries.append(Line2D([], [], color=GRAY, lw=0.7, alpha=0.6, label="thin: activation"))
        if kinds:
            entries.append(Patch(color=GRAY, lw=0, label="bar at the top: " + ", ".join(kinds)))
        return entries
    ((label, one),) = solutions.items()
    color = colors[label]
    step = Patch(fc=(color, 0.16), ec=(color, 0.75), lw=1.1, label="excitation")
    entries = [step, Line2D([], [], color=darker(color), lw=0.8, label="activation")]
    if (one.excitation >= _SATURATION).any():
        entries.append(Patch(color=SATURATED, lw=0, label="saturated"))
    if kinds:
        entries.append(Patch(color=FLAGGED, lw=0, label=", ".join(kinds)))
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

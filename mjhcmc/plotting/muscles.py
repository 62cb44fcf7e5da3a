"""Muscle models beside each other: their curves, and their forces along a movement."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc import hill
from mjhcmc.hill_muscles import MAX_FIBER_VELOCITY, mujoco_curve_sets
from mjhcmc.muscle_comparison import MuscleComparison
from mjhcmc.plotting.panels import (
    AXIS,
    BLUE,
    DESIRED,
    GREEN,
    INK,
    VERMILLION,
    Sheet,
    columns_for,
    finish,
    note,
    number,
    scale_values,
    style,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mjhcmc.model import MuscleModel

_LENGTHS = np.linspace(0.3, 1.8, 301)
_VELOCITIES = np.linspace(-1.1, 1.1, 331)  # maximum fiber velocities
_STRETCHES = np.linspace(0.99, 1.06, 211)
_PANELS = (
    ("active force-length", "fiber length (l₀)"),
    ("passive force-length", "fiber length (l₀)"),
    ("force-velocity", "fiber velocity (l₀/s)"),
    ("tendon", "tendon length (slack lengths)"),
)


def curve_figure(model: MuscleModel) -> Figure:
    """Thelen's, Millard's, De Groote and Fregly's curves and a model's own MuJoCo curves, normalised, in four panels.

    All share length and force; velocity is in optimal fiber lengths a second, since MuJoCo's maximum velocity is fitted
    with its curve. Thelen's force-velocity curve is that of full activation. MuJoCo's tendon is rigid.

    Args:
        model: what MuJoCo's curves are read from; a dark line for each set that its muscles have.
    """
    from matplotlib.lines import Line2D

    models = {
        hill.thelen2003(): VERMILLION,
        hill.millard2012(): BLUE,
        hill.degroote_fregly2016(): GREEN,
    }
    entries: list[Artist] = [Line2D([], [], color=color, lw=1.6, label=c.name) for c, color in models.items()]
    entries.append(Line2D([], [], color=INK, lw=1.6, ls=(0, (4, 1.6)), label=f"MuJoCo, as in {model.name}"))
    with style():
        sheet = Sheet(
            2, 2, panel=(3.1, 2.0), gap=(0.6, 0.75), title="Muscle curves, normalised", entries=entries,
        )  # fmt: skip
        axes = [sheet.panel(i // 2, i % 2, title) for i, (title, _) in enumerate(_PANELS)]
        for curves, color in models.items():
            _draw(axes, curves, MAX_FIBER_VELOCITY, curves.name, color=color, lw=1.6)
            assert curves.tendon is not None
            axes[3].plot(_STRETCHES, curves.tendon(_STRETCHES), color=color, lw=1.6, label=curves.name)
        for lmin, lmax, fpmax, fvmax, speed in mujoco_curve_sets(model):
            own = hill.mujoco_curves(lmin, lmax, fpmax, fvmax)
            _draw(axes, own, speed, "MuJoCo", color=INK, lw=1.6, ls=(0, (4, 1.6)))
        axes[3].axvline(1.0, color=INK, lw=1.6, ls=(0, (4, 1.6)), label="MuJoCo")
        for ax, (_, label), limits in zip(axes, _PANELS, ((0, 1.1), (0, 1.6), (-0.1, 1.7), (-0.1, 1.6)), strict=True):
            finish(ax)
            ax.set_xlabel(label, labelpad=1.5)
            ax.set_ylim(limits)
            sheet.label_values(ax, "force (F₀)")
    return sheet.figure


def _draw(axes: list[Axes], curves: hill.Curves, speed: float, label: str, **look: object) -> None:
    """The curves of fiber, its velocities in optimal lengths a second."""
    velocity = _VELOCITIES * MAX_FIBER_VELOCITY
    for ax, x, y in (
        (axes[0], _LENGTHS, curves.active(_LENGTHS)),
        (axes[1], _LENGTHS, curves.passive(_LENGTHS)),
        (axes[2], velocity, curves.force_velocity(velocity / speed)),
    ):
        ax.plot(x, y, label=label, **look)  # type: ignore[arg-type]
        ax.set_xlim(x[0], x[-1])


def force_figure(comparison: MuscleComparison) -> Figure:
    """Tendon force over time, a panel for each muscle: MuJoCo's, the Hill model's with rigid and compliant tendon.

    Each panel has its own scale; noted are the root mean square differences from MuJoCo in percent of F0, rigid first.

    Args:
        comparison: what `compare_muscles` found.
    """
    from matplotlib.lines import Line2D

    track, forces = comparison.track, comparison.forces()
    looks = {"rigid": {"color": BLUE, "lw": 1.2}, "compliant": {"color": VERMILLION, "lw": 1.2}}
    entries: list[Artist] = [Line2D([], [], color=DESIRED, lw=3.2, label="MuJoCo")]
    entries += [Line2D([], [], label=f"{comparison.model.curves.name}, {t} tendon", **looks[t]) for t in forces]  # type: ignore[arg-type]
    n_column = columns_for(len(comparison.muscle_names))
    values = comparison.numbers()["muscles"]
    with style():
        sheet = Sheet(
            math.ceil(len(comparison.muscle_names) / n_column), n_column, panel=(2.2, 1.3), gap=(0.55, 0.5),
            title=f"Tendon force at the same activation and path · {comparison.movement} · RMS difference, % F₀",
            entries=entries,
        )  # fmt: skip
        for i, name in enumerate(comparison.muscle_names):
            ax = sheet.panel(i // n_column, i % n_column, name)
            drawn: list[NDArray[np.float64]] = [track.force[:, i]]
            ax.axhline(0.0, color=AXIS, lw=0.7)
            ax.plot(track.time, track.force[:, i], color=DESIRED, lw=3.2, label="MuJoCo", solid_capstyle="butt")
            for tendon, force in forces.items():
                ax.plot(track.time, force[:, i], label=tendon, **looks[tendon])  # type: ignore[arg-type]
                drawn.append(force[:, i])
            scale_values(sheet, ax, "force", "N", drawn)
            if i % n_column:
                ax.set_ylabel("")
            ax.set_xlim(track.time[0], track.time[-1])
            note(ax, ", ".join(f"{number(values[name][f'{t}_rms_percent_f0'])} %" for t in forces))
            finish(ax, time_label=True)
    return sheet.figure

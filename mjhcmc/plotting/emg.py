"""Excitation against EMG: a panel for each measured muscle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from mjhcmc.emg_comparison import EmgComparison, MuscleAgreement
from mjhcmc.plotting.panels import (
    AXIS,
    BLUE,
    DESIRED,
    Sheet,
    columns_for,
    finish,
    note,
    scale_values,
    style,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure


def emg_figure(comparison: EmgComparison) -> Figure:
    """Excitation and envelope over time, a panel for each measured muscle.

    The envelope is scaled by least squares to the excitation (by k of `emg_comparison`), each panel has its own scale.
    Noted: the correlation at no lag, the largest one with its lag, and the median of the largest ones of the muscles
    that the channel does not measure; or why there is none.

    Args:
        comparison: what `compare_emg` found.
    """
    from matplotlib.lines import Line2D

    entries: list[Artist] = [
        Line2D([], [], color=DESIRED, lw=3.2, label="EMG envelope, scaled"),
        Line2D([], [], color=BLUE, lw=1.3, label="excitation"),
    ]
    count = len(comparison.muscles)
    n_column = columns_for(count)
    time = comparison.time
    half = float(np.median(np.diff(time))) / 2
    with style():
        sheet = Sheet(
            math.ceil(count / n_column), n_column, panel=(2.2, 1.3), gap=(0.55, 0.5),
            title=f"Excitation and EMG · {comparison.solution}", entries=entries,
        )  # fmt: skip
        for i, one in enumerate(comparison.muscles):
            ax = sheet.panel(i // n_column, i % n_column, one.muscle)
            scale = one.scale if np.isfinite(one.scale) else 1.0
            u, envelope = comparison.excitation[:, i], scale * comparison.envelope[:, i]
            ax.axhline(0.0, color=AXIS, lw=0.7)
            ax.plot(time, envelope, color=DESIRED, lw=3.2, label="EMG", solid_capstyle="butt")
            ax.plot(time, u, color=BLUE, lw=1.3, label="excitation", drawstyle="steps-mid")
            scale_values(sheet, ax, "excitation", "1", [u, envelope], headroom=0.5)
            label = ax.get_ylabel()  # an excitation has no unit, but may have a power of ten
            plain = label == "excitation (1)"
            sheet.label_values(
                ax, "" if plain and i % n_column else "excitation" if plain else label.replace(" 1)", ")")
            )
            ax.set_xlim(time[0] - half, time[-1] + half)
            note(ax, _words(one))
            finish(ax, time_label=i + n_column >= count)
    return sheet.figure


def _words(one: MuscleAgreement) -> str:
    if one.reason:
        return one.reason.split(":")[0].split(" (")[0]
    best = f"best {one.r_best:.2f} at {1e3 * one.lag:+.0f} ms".replace("-", "−")
    others = f", others {one.r_best_others:.2f}".replace("-", "−") if np.isfinite(one.r_best_others) else ""
    return f"r {one.r:.2f}".replace("-", "−") + f", {best}{others}"

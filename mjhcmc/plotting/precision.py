"""Figure of errors against steps: several panels, both axes logarithmic, with lines of known order to compare with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from mjhcmc.errors import SettingsError
from mjhcmc.plotting.panels import AXIS, PALETTE, Sheet, finish, style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["ErrorPanel", "precision_figure"]

_DASHES = {1: (0, (1.2, 1.6)), 2: (0, (6.0, 1.5, 1.2, 1.5)), 4: (0, (4, 2))}
_MARKERS = "osD^vP*"


@dataclass(frozen=True)
class ErrorPanel:
    """Errors against a step.

    Attributes:
        title: of the panel.
        x_label: what the steps are.
        y_label: what the errors are.
        curves: by label: steps (n,) in ms and errors (n,); values that are not positive are left out.
        guides: orders, 1, 2 or 4, and the label of the curve that each runs below.
        legend: the corner that the curves leave free.
    """

    title: str
    x_label: str
    y_label: str
    curves: Mapping[str, tuple[ArrayLike, ArrayLike]]
    guides: Mapping[int, str]
    legend: Literal["upper left", "lower left", "lower right"] = "upper left"


def precision_figure(panels: Sequence[ErrorPanel], title: str) -> Figure:
    """Panels side by side, each with its own legend.

    Args:
        panels: from left to right.
        title: what is drawn.

    Raises:
        SettingsError: no panel, no curve in one, curves whose steps and errors differ in number, or an unknown order.
    """
    if not panels or any(not panel.curves for panel in panels):
        raise SettingsError(f"precision_figure: give at least one panel, each with a curve; got {len(panels)} panels")
    from matplotlib.lines import Line2D

    used = sorted({order for panel in panels for order in panel.guides})
    if unknown := [order for order in used if order not in _DASHES]:
        raise SettingsError(f"precision_figure: guides have orders {', '.join(map(str, _DASHES))}; got {unknown[0]}")
    with style():
        entries = [Line2D([], [], color=AXIS, lw=1.2, ls=_DASHES[order], label=f"order {order}") for order in used]
        entries = entries or [Line2D([], [], lw=0, label=" ")]
        sheet = Sheet(1, len(panels), (3.5, 3.4), (0.72, 0.0), title, [*entries])
        for column, panel in enumerate(panels):
            ax = sheet.panel(0, column, panel.title)
            ax.set_xscale("log")
            ax.set_yscale("log")
            drawn = {}
            for i, (label, (x, y)) in enumerate(panel.curves.items()):
                h, error = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
                if h.ndim != 1 or h.shape != error.shape:
                    raise SettingsError(
                        f"precision_figure: {label!r} has {h.size} steps and {error.size} errors: give as many of both"
                    )
                keep = (h > 0) & (error > 0)
                drawn[label] = h[keep], error[keep]
                ax.plot(
                    *drawn[label], color=PALETTE[i % 7], marker=_MARKERS[i % 7], ms=4.0, mec="white", mew=0.5, lw=1.2,
                    label=label,
                )  # fmt: skip
            for order, label in panel.guides.items():
                h, error = drawn[label]
                level = 0.35 * float(np.min(error / h**order))
                ends = np.array([h[error > error.max() * 1e-9].min(), h.max()])
                ax.plot(ends, level * ends**order, color=AXIS, lw=1.2, ls=_DASHES[order])
            ax.set_xlabel(panel.x_label)
            sheet.label_values(ax, panel.y_label, 0.46)
            ax.legend(loc=panel.legend, fontsize=6.5, frameon=False, borderaxespad=0.2, labelspacing=0.25)
            finish(ax)
    return sheet.figure

"""A cohort of virtual patients: grades, how raters agree, and what lies behind them; a column for each joint."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mjhcmc.patients.grades import GRADES
from mjhcmc.patients.groups import TESTED
from mjhcmc.patients.overview import Array, Counts, Overview
from mjhcmc.patients.trials import stretch
from mjhcmc.plotting.panels import BLUE, INK, Sheet, finish, note, readable, style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GRADE_COLORS = ("#BDBDBD", "#FCCB6B", "#F4903B", "#DB4A35", "#98204F", "#3F0D4D")
"""By grade: grey without spasticity, then the darker the higher."""

_PALE = 3  # grades whose colors take dark letters
_ROWS = 5
_READER = {"ideal": "ideal", "rater_a": "rater a", "rater_b": "rater b"}
_SHARE = 0.08  # of a bar, that has room for its number


def cohort_figure(overview: Overview) -> Figure:
    """Five rows, a column for each tested joint.

    How often each grade is given, by the ideal reader and by two raters; which ideal grades become which of a rater's;
    gain and threshold of the reflex, and the ideal grade as color: limbs of one gain have many grades, since the grade
    comes from what is felt, and that from tone, contracture and the threshold too; resistance and share of the range
    affected; angles of the catch.

    Args:
        overview: of the dataset.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    head: Artist = Line2D([], [], ls="none", label="ideal Modified Ashworth grade:")
    entries = [head, *(Patch(color=c, lw=0, label=g) for g, c in zip(GRADES, GRADE_COLORS, strict=True))]
    failed = f", {len(overview.failed)} failed" if overview.failed else ""
    title = f"{overview.patients:,} virtual patients{failed} · seed {overview.seed}"
    with style():
        sheet = _Sheet(_ROWS, len(TESTED), (2.62, 1.75), (0.62, 0.72), title, entries)
        for column, joint in enumerate(TESTED):
            first = column == 0
            _grades(sheet.panel(0, column, f"{joint.capitalize()}: grades (%)"), overview.grades[joint], first)
            kappa = f"κ {overview.kappa(overview.ideal_rater[joint]):.2f}"
            ax = sheet.panel(1, column, f"Ideal grade and rater's · {kappa}")
            _confusion(ax, overview.ideal_rater[joint])
            sheet.label_values(ax, "ideal grade" if first else "")
            points = overview.points[joint]
            ax = sheet.panel(2, column, f"Reflex of the {readable(TESTED[joint])}")
            _scatter(ax, points["gain"], points["threshold"], points["rank"])
            ax.set_xlabel("gain (s)", labelpad=2.0)
            sheet.label_values(ax, "threshold (1/s)" if first else "")
            ax = sheet.panel(3, column, "What the examiner felt")
            _scatter(ax, 100 * points["range_affected"], points["resistance"], points["rank"])
            ax.set_xlabel("range affected (%)", labelpad=2.0)
            sheet.label_values(ax, "resistance (N m)" if first else "")
            ax = sheet.panel(4, column, "Where the limb catches")
            _catches(ax, overview, joint)
            sheet.label_values(ax, "limbs" if first else "")
        for ax in sheet.figure.axes:
            finish(ax)
        for ax in sheet.figure.axes:
            if ax.get_images() or ax.get_gid() == "bars":
                ax.grid(visible=False)
    return sheet.figure


class _Sheet(Sheet):
    left = 0.76


def _grades(ax: Axes, counts: dict[str, Counts], first: bool) -> None:
    """A bar for each reader, its parts in percent."""
    ax.set_gid("bars")
    for y, of_reader in enumerate(counts.values()):
        share = of_reader / max(int(of_reader.sum()), 1)
        ends = np.cumsum(share)
        for k, (part, end) in enumerate(zip(share, ends, strict=True)):
            ax.barh(y, part, 0.72, left=end - part, color=GRADE_COLORS[k], lw=0, label=GRADES[k])
            if part >= _SHARE:
                color = INK if k < _PALE else "white"
                ax.text(end - part / 2, y, f"{100 * part:.0f}", ha="center", va="center", fontsize=7.5, color=color)
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(len(counts) - 0.5, -0.5)
    ax.set_xticks([])
    ax.set_yticks(range(len(counts)), [_READER[name] if first else "" for name in counts])
    ax.spines["bottom"].set_visible(False)
    ax.spines["left"].set_visible(False)


def _confusion(ax: Axes, counts: Counts) -> None:
    """Counts as numbers, the share of each row as shade."""
    from matplotlib.colors import LinearSegmentedColormap

    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    shades = LinearSegmentedColormap.from_list("share", ["#FFFFFF", BLUE])
    ax.imshow(share, cmap=shades, vmin=0.0, vmax=1.0, aspect="auto")
    small = 7.2 if counts.max(initial=0) < 10_000 else 5.5
    for (row, column), count in np.ndenumerate(counts):
        if count:
            color = "white" if share[row, column] > 0.55 else INK
            ax.text(column, row, str(count), ha="center", va="center", fontsize=small, color=color)
    ax.set_xticks(range(len(GRADES)), GRADES)
    ax.set_yticks(range(len(GRADES)), GRADES)
    ax.set_xlabel("grade of rater a", labelpad=2.0)


def _scatter(ax: Axes, x: Array, y: Array, rank: Array) -> None:
    """A point for each limb, in the color of its grade; all grades mixed, so that none hides the others."""
    known = np.isfinite(x) & np.isfinite(y) & np.isfinite(rank)
    x, y, rank = x[known], y[known], rank[known].astype(int)
    if not len(x):
        note(ax, "no limb")
        return
    size = float(np.clip(2500 / len(x), 3.0, 12.0))
    ax.scatter(x, y, s=size, c=np.array(GRADE_COLORS)[rank], lw=0, alpha=0.85, zorder=2.0)
    ax.margins(0.05)


def _catches(ax: Axes, overview: Overview, joint: str) -> None:
    """How many limbs catch at each angle, grades stacked."""
    from matplotlib.ticker import MaxNLocator

    from mjhcmc.plotting.trial import way

    edges, counts = overview.edges[joint], overview.catches[joint]
    below = np.zeros(len(edges) - 1)
    for k, of_grade in enumerate(counts.T):
        ax.bar(edges[:-1], of_grade, np.diff(edges), below, align="edge", color=GRADE_COLORS[k], ec="white", lw=0.4)
        below += of_grade
    graded = int(overview.grades[joint]["ideal"].sum())
    ax.set_xlim(edges[0], edges[-1])
    ax.set_ylim(0.0, 1.3 * max(float(below.max()), 1.0))
    ax.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    ax.set_xlabel(f"{way(joint, int(stretch(joint, 'mas').direction))} (°)", labelpad=2.0)
    note(ax, f"{int(counts.sum())} of {graded} limbs catch")

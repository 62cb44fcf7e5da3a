"""Which grades are taken for which: a panel for each way of grading."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc.plotting.panels import BLUE, INK, Sheet, columns_for, finish, style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure


def confusion_figure(
    counts: Mapping[str, NDArray[np.int64]], labels: tuple[str, ...], *, title: str, truth: str = "true grade"
) -> Figure:
    """Confusion matrices side by side: counts as numbers, the share of each row as shade.

    Args:
        counts: by panel title, (n, n) counts, rows the truth.
        labels: the n grades.
        title: of the figure.
        truth: what the rows are.
    """
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.patches import Patch

    entries: list[Artist] = [Patch(color=BLUE, label="share of a row, from none (white) to all; numbers are counts")]
    n_column = columns_for(len(counts))
    n_row = -(-len(counts) // n_column)
    with style():
        shades = LinearSegmentedColormap.from_list("share", ["#FFFFFF", BLUE])
        sheet = Sheet(n_row, n_column, panel=(2.1, 2.1), gap=(0.6, 0.75), title=title, entries=entries)
        for i, (name, matrix) in enumerate(counts.items()):
            ax = sheet.panel(i // n_column, i % n_column, name)
            share = matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1)
            ax.imshow(share, cmap=shades, vmin=0.0, vmax=1.0, aspect="auto")
            for (row, column), count in np.ndenumerate(matrix):
                if count:
                    color = "white" if share[row, column] > 0.55 else INK
                    ax.text(column, row, str(count), ha="center", va="center", fontsize=7.5, color=color)
            ax.set_xticks(range(len(labels)), labels)
            ax.set_yticks(range(len(labels)), labels)
            ax.set_xlabel("given grade", labelpad=2.0)
            sheet.label_values(ax, truth if i % n_column == 0 else "", distance=0.36)
            finish(ax)
            ax.grid(visible=False)
    return sheet.figure

"""A panel of plots over time: what lines it draws in which rows, and its place in the page. The page's script draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from mjhcmc.plotting.panels import readable
from mjhcmc.report.markup import Html, element, joined


@dataclass(frozen=True)
class Line:
    """A column that a panel draws.

    Attributes:
        column: its name in the `series.Book`.
        name: what the label under the pointer calls it.
        role: which look it has: ``excitation``, ``activation``, ``emg``, ``desired``, ``actual``, ``error``, ``net``,
            ``reserve``, ``load``, ``residual``, ``force``, ``length``, ``velocity``; ``other0`` .. of other solutions,
            ``m0`` .. of muscles in a stack.
        unit: under the pointer; empty where it has none.
        row: of the panel, from 0 at the top.
        step: whether it is constant over windows.
        factor: what its values are multiplied by to be drawn; None: 1.
    """

    column: str
    name: str
    role: str
    unit: str = ""
    row: int = 0
    step: bool = False
    factor: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        told: dict[str, Any] = {"c": self.column, "name": self.name, "role": self.role, "unit": self.unit}
        extra = {"row": self.row, "step": self.step, "factor": self.factor}
        return told | {key: value for key, value in extra.items() if value}


@dataclass(frozen=True)
class Row:
    """One pair of axes of a panel.

    Attributes:
        label: of its vertical axis, with the unit.
        part: of the panel's height, in proportion to the other rows.
        top: upper end of an axis that begins at 0; None: as the lines need it.
        least: what the axis spans at least, so that what stands still looks still.
        limits: values within which the lines should keep, drawn dashed.
    """

    label: str
    part: float = 1.0
    top: float | None = None
    least: float | None = None
    limits: tuple[float, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        told: dict[str, Any] = {"label": self.label, "part": self.part}
        if self.limits:
            told["limits"] = list(self.limits)
        return told | {k: v for k, v in (("top", self.top), ("least", self.least)) if v is not None}


@dataclass(frozen=True)
class Panel:
    """See the attributes.

    Attributes:
        name: unlike that of any other panel of the page.
        title: over it, as the model writes it.
        lines: in the order of drawing.
        rows: from the top.
        height: of the plot, pixels.
        told: what the plot shows, for those who do not see it.
        notes: under the title, each a line.
        stack: lines whose values are stacked in the first row, those above zero and those below apart, from zero out.
        bands: shaded spans (s) by kind: ``saturated``.
        flagged: whether windows that are not OK are shaded.
        key: role and text of each entry of its own legend.
        peak: by which panels may be put in order.
    """

    name: str
    title: str
    lines: Sequence[Line]
    rows: Sequence[Row]
    height: int
    told: str
    notes: Sequence[object] = ()
    stack: Sequence[Line] = ()
    bands: dict[str, list[list[float]]] = field(default_factory=dict)
    flagged: bool = False
    key: Sequence[tuple[str, str]] = ()
    peak: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        told: dict[str, Any] = {
            "title": readable(self.title),
            "height": self.height,
            "rows": [row.to_dict() for row in self.rows],
            "lines": [line.to_dict() for line in self.lines],
        }
        if self.stack:
            told["stack"] = [line.to_dict() for line in self.stack]
        if bands := {kind: spans for kind, spans in self.bands.items() if spans}:
            told["bands"] = bands
        return told | ({"flagged": True} if self.flagged else {})

    def figure(self) -> Html:
        """Its place in the page: the script draws into it once it is near the screen, and before printing."""
        return element(
            "figure",
            element(
                "figcaption", element("h3", readable(self.title)),
                *(element("p", note, class_="note") for note in self.notes),
            ),
            element("div", class_="plot", role="img", aria_label=self.told, style=f"height:{self.height}px"),
            key_of(self.key) if self.key else "",
            class_="panel", data_panel=self.name, data_name=readable(self.title).casefold(),
            data_peak=None if self.peak is None else f"{self.peak:.6g}",
        )  # fmt: skip


def key_of(entries: Sequence[tuple[str, str]]) -> Html:
    """A legend: the look of each role, and what it is."""
    items = [
        element("li", element("span", class_=f"swatch {role}", aria_hidden="true"), element("span", text))
        for role, text in entries
    ]
    return element("ul", *items, class_="key")


def grid(panels: Sequence[Panel], kind: str, name: str | None = None) -> Html:
    """Panels side by side, as many as there is room for."""
    return element("div", joined(panel.figure() for panel in panels), class_=f"grid {kind}", id=name)

"""What the tests of the report share: a page taken apart as a browser would, and solutions that fail."""

import json
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser

import numpy as np

from mjhcmc.report.page import report
from mjhcmc.report.series import unpacked

VOID = {"meta", "input", "br", "link", "img", "hr", "source", "wbr", "col", "path", "rect", "circle", "line"}


class _Reader(HTMLParser):
    def __init__(self):
        super().__init__(convert_charrefs=True)
        self.elements, self.sections, self.scripts, self.styles, self.cells = [], {}, [], [], []
        self.open, self.section, self.parts = [], None, []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.elements.append((tag, values))
        if tag not in VOID:
            self.open.append((tag, values))
        if tag == "section" and "id" in values:
            self.section = values["id"]
            self.sections[self.section] = []
        if tag == "tr":
            self.cells.append([])
        if tag in ("td", "th"):
            self.cells[-1].append("")
        if tag == "script":
            self.scripts.append((values, []))
        if tag == "style":
            self.styles.append("")

    def handle_endtag(self, tag):
        while self.open and self.open.pop()[0] != tag:
            pass
        if tag == "section":
            self.section = None

    def handle_data(self, data):
        inside = [tag for tag, _ in self.open]
        if inside[-1:] == ["script"]:
            self.scripts[-1][1].append(data)
        elif inside[-1:] == ["style"]:
            self.styles[-1] += data
        else:
            if self.section:
                self.sections[self.section].append(data)
            if "td" in inside or ("th" in inside and self.cells):
                self.cells[-1][-1] += data


@dataclass
class Page:
    """A page taken apart."""

    text: str
    elements: list = field(default_factory=list)
    sections: dict = field(default_factory=dict)
    scripts: list = field(default_factory=list)
    styles: list = field(default_factory=list)
    cells: list = field(default_factory=list)
    data: dict = field(default_factory=dict)

    def words(self, section):
        """The text of a section, blanks as one."""
        return " ".join("".join(self.sections[section]).split())

    def row(self, head):
        """The cells of the first table row that begins so."""
        return next(cells for cells in self.cells if cells and cells[0] == head)

    def column(self, name):
        """(times, values) of a column."""
        own = self.data["columns"][name]
        clock = unpacked(self.data["clocks"][own["clock"]]["t"])
        return (clock[unpacked(own["k"])] if "k" in own else clock), unpacked(own["v"])


def taken_apart(text):
    reader = _Reader()
    reader.feed(text)
    reader.close()
    data = next("".join(parts) for attrs, parts in reader.scripts if attrs.get("id") == "report-data")
    return Page(
        text, reader.elements, reader.sections, reader.scripts, reader.styles, reader.cells, json.loads(data)
    )  # fmt: skip


def page_of(solution, **arguments):
    return taken_apart(report(solution, **arguments))


def with_reserve(solution, joint, share, window):
    """The solution, with a reserve of that share of the joint's peak moment in a window."""
    reserve, shortfall = solution.reserve.copy(), solution.shortfall.copy()
    reserve[window, joint] = share * solution.peak_moment[joint]
    shortfall[window, joint] = reserve[window, joint]
    status = solution.status.copy()
    status[window] = 1
    return replace(solution, reserve=reserve, shortfall=shortfall, status=status)


def off_by(solution, joint, error):
    """The solution, off the motion by a constant error (rad) at a joint."""
    qpos, tracking = solution.qpos.copy(), solution.tracking_error.copy()
    qpos[:, joint] = solution.qpos_desired[:, joint] + error
    tracking[:, joint] = error
    return replace(solution, qpos=qpos, tracking_error=tracking)


def of_many_nodes(solution, n):
    """The solution, back and forth until it has n windows."""
    there = np.arange(solution.n_window)
    windows = np.resize(np.concatenate([there, there[::-1]]), n)
    nodes = np.concatenate([windows, [0]])
    changes = {"time": solution.time[0] + solution.dt * np.arange(n + 1)}
    for name, value in vars(solution).items():
        if isinstance(value, np.ndarray) and value.ndim and name not in ("time", "dof_is_rotation"):
            changes[name] = value[nodes] if len(value) == solution.n_window + 1 else value[windows]
    return replace(solution, **changes)

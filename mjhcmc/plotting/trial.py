"""A clinical test over time: what the examiner moved and felt, what the muscles did, and the grade.

A stretch is drawn in its own direction, so that it always goes up and to the right and resistance is positive; angles
have the names that clinicians use (knee flexion is positive, unlike in the model).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SimulationError
from mjhcmc.leg8.table import JOINTS, MUSCLES
from mjhcmc.patients.drive import ANTAGONISTS
from mjhcmc.patients.groups import GROUPS, TESTED
from mjhcmc.patients.record import Record
from mjhcmc.patients.resistance import SMOOTH
from mjhcmc.patients.trials import REST, TESTS
from mjhcmc.plotting.panels import (
    AXIS,
    BLUE,
    DESIRED,
    FLAGGED,
    GRAY,
    INK,
    SKY,
    VERMILLION,
    Sheet,
    finish,
    note,
    readable,
    scale_values,
    style,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

STRETCHES = TESTS[:3]

_WAYS = {
    ("hip", -1): "hip extension", ("hip", 1): "hip flexion", ("knee", -1): "knee flexion",
    ("knee", 1): "knee extension", ("ankle", -1): "plantarflexion", ("ankle", 1): "dorsiflexion",
}  # fmt: skip
_FLEXION = {"hip": 1, "knee": -1, "ankle": 1}  # sign in the model of what is drawn as positive without a stretch
_OF_JOINT: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "hip": (("iliopsoas",), ("glut_max",)),
    "knee": (("rect_fem", "vasti"), ("hamstrings",)),
    "ankle": (("gastroc", "soleus"), ("tib_ant",)),
}
_AGONISTS = (BLUE, SKY)
SMALL = 7.2


@dataclass(frozen=True)
class Grading:
    """What raters say of a joint, to be written over it.

    Attributes:
        ideal: Modified Ashworth grade by the wording of the scale; None where there is none.
        raters: grades that raters gave.
        catch_angle: rad, of the joint, where the ideal reading has a catch; None: it has none.
    """

    ideal: str | None = None
    raters: tuple[str, ...] = ()
    catch_angle: float | None = None

    def __str__(self) -> str:
        """As titles tell it."""
        if self.ideal is None:
            return "not graded"
        return f"MAS {self.ideal}" + (f" (raters {', '.join(self.raters)})" if self.raters else "")


NO_GRADING = Grading()


def way(joint: str, sign: int) -> str:
    """What a joint does where its angle, times the sign, grows: ``"knee flexion"``."""
    return _WAYS[joint, sign]


class TrialSheet(Sheet):
    """Rows of panels over one time axis, close together, and rows with axes of their own."""

    left = 0.72

    def __init__(
        self, close: int, apart: int, n_column: int, panel: tuple[float, float], title: str, entries: list[Artist],
        gap: float = 0.66,
    ) -> None:  # fmt: skip
        """So many rows close together, then rows apart; ``gap`` inches between columns."""
        self._close = close
        super().__init__(close + apart, n_column, panel, (gap, 0.16), title, entries)

    def _row_top(self, row: int) -> float:
        return super()._row_top(row) + 0.62 * max(row - self._close + 1, 0)

    def label_values(self, ax: Axes, label: str, distance: float = 0.44) -> None:
        """Name the vertical axis, at the same distance (inches) however wide the panel is."""
        ax.set_ylabel(label)
        ax.yaxis.set_label_coords(-distance / (ax.get_position().width * self.figure.get_size_inches()[0]), 0.5)

    def wide(self, row: int, first: int, last: int, title: str) -> Axes:
        """A panel across columns."""
        ax, other = self.panel(row, first, title), self.panel(row, last)
        box, end = ax.get_position(), other.get_position()
        other.remove()
        ax.set_position((box.x0, box.y0, end.x1 - box.x0, box.height))
        ax.set_title(title, loc="left", pad=4.0)  # whole: there is room for it
        return ax


def trial_figure(record: Record, title: str, grading: Grading = NO_GRADING) -> Figure:
    """One trial over time: angle, velocity, what the examiner applies and feels, excitation; of movements of the whole
    leg, a column for each joint.

    Excitation is that of the stretched muscles and of their antagonists, the part that is reflex as an area. Where the
    grading knows a catch, it is marked when the joint first is there.

    Args:
        record: of the trial.
        title: of the figure; the trial's name is added.
        grading: of the joint under test.

    Raises:
        SimulationError: nothing was recorded.
    """
    trial = record.trial
    if not len(record.time):
        raise SimulationError(f"trial {trial.name!r} left nothing to draw ({record.failure}): choose another trial")
    joints = (trial.joint,) if trial.joint else JOINTS
    columns = [(joint, record, grading if trial.joint else NO_GRADING) for joint in joints]
    failed = [f"stopped: {record.failure}"] if record.failure else []
    with style():
        sheet = TrialSheet(
            4 if trial.examiner else 3, 0, len(columns), (6.2 if len(columns) == 1 else 2.5, 1.15),
            " · ".join([title, _words(record), *failed]), legend_of([record], [grading] if trial.speed else []),
        )  # fmt: skip
        over_time(sheet, columns)
    return sheet.figure


def _words(record: Record) -> str:
    """What was done, in words."""
    trial = record.trial
    if trial.test == "pendulum":
        return "pendulum test"
    if trial.test not in STRETCHES:
        return readable(trial.name)
    how = "over its range in 1 s" if trial.test == "mas" else f"at {math.degrees(trial.speed):.4g}°/s"
    return f"{trial.joint} stretched {how}"


def over_time(sheet: TrialSheet, columns: Sequence[tuple[str, Record | None, Grading]]) -> None:
    """Fill the rows that are close together; a joint without a record says so."""
    for column, (joint, record, grading) in enumerate(columns):
        title = joint.capitalize() + (f" · {grading}" if grading is not NO_GRADING else "")
        top = sheet.panel(0, column, title)
        if record is None or len(record.time) < 2:
            absent(top, "" if record is None else record.failure)
            continue
        trial, j = record.trial, JOINTS.index(joint)
        sign = int(trial.direction) or _FLEXION[joint]
        first = column == 0
        panels = [top, *(sheet.panel(row, column) for row in range(1, 4 if trial.examiner else 3))]
        _motion(sheet, panels[0], panels[1], record, joint, sign)
        if trial.examiner:
            torque, resistance = sign * record.examiner_torque[:, j], _resistance(record)
            panels[2].plot(record.time, torque, color=AXIS, lw=0.9, label="torque")
            panels[2].plot(record.time, resistance, color=VERMILLION, lw=1.5, label="resistance")
            scale_values(sheet, panels[2], "torque", "N m", [torque, resistance], headroom=0.15)
        _excitation(sheet, panels[-1], record, joint)
        caught = _caught(record, grading)
        for ax in panels:
            if trial.speed:
                ax.axvspan(REST, REST + trial.movement_time, color=FLAGGED, lw=0, zorder=0.3)
            if caught is not None:
                height = 1.0 if ax is not panels[-1] else 0.74  # below the names of muscles
                ax.axvline(caught, 0.0, height, color=INK, lw=0.9, ls=(0, (3, 2)), zorder=3.0, label="catch")
            ax.set_xlim(0.0, max(trial.duration if trial.speed else 0.0, float(record.time[-1])))
            if not first and ax is not panels[0]:
                sheet.label_values(ax, "")
            sheet.label_values(ax, ax.get_ylabel())
            finish(ax, time_label=ax is panels[-1])
        if record.failure:
            note(panels[0], "stopped early")


def _motion(sheet: Sheet, place: Axes, speed: Axes, record: Record, joint: str, sign: int) -> None:
    """Angle and velocity, with what was asked for where that is known."""
    trial, j = record.trial, JOINTS.index(joint)
    angle, velocity = np.degrees(sign * record.qpos[:, j]), np.degrees(sign * record.qvel[:, j])
    drawn: tuple[list[Array], list[Array]] = ([angle], [velocity])
    if trial.speed:
        asked, at, _ = (np.degrees(sign * value) for value in trial.desired(record.time))
        for ax, values, found in ((place, asked, drawn[0]), (speed, at, drawn[1])):
            ax.plot(record.time, values, color=DESIRED, lw=3.2, label="commanded", solid_capstyle="butt")
            found.append(values)
    place.plot(record.time, angle, color=INK, lw=1.2, label="angle")
    speed.plot(record.time, velocity, color=INK, lw=1.2, label="velocity")
    scale_values(sheet, place, way(joint, sign), "°", drawn[0], headroom=0.15)
    scale_values(sheet, speed, "velocity", "°/s", drawn[1], headroom=0.15)


def _excitation(sheet: Sheet, ax: Axes, record: Record, joint: str) -> None:
    """Of the muscles that are stretched (or flex or extend the joint) and of those against them; named on the spot."""
    stretched, against = _OF_JOINT[joint]
    if joint in TESTED and record.trial.joint == joint:
        stretched = GROUPS[TESTED[joint]]
        share = ANTAGONISTS[[MUSCLES.index(name) for name in stretched]].sum(axis=0)
        against = tuple(name for name, value in zip(MUSCLES, share, strict=True) if value)
    peak = 0.0
    for names, colors, dashes in ((against, (GRAY,), (0, (2.5, 1.2))), (stretched, _AGONISTS, "-")):
        for name, color in zip(names, colors, strict=False):
            k = MUSCLES.index(name)
            ax.fill_between(record.time, record.reflex[:, k], color=color, alpha=0.25, lw=0, label="reflex")
            ax.plot(record.time, record.excitation[:, k], color=color, lw=1.2, ls=dashes, label=readable(name))
            peak = max(peak, float(np.nanmax(record.excitation[:, k])))
    lines = sorted(ax.get_lines(), key=lambda line: line.get_color() == GRAY)
    ax.legend(
        handles=lines, loc="upper left", ncols=3, fontsize=SMALL, handlelength=1.3, columnspacing=0.9, borderpad=0.1,
        handletextpad=0.4, borderaxespad=0.15,
    )  # fmt: skip
    top = next(value for value in (0.05, 0.1, 0.2, 0.5, 1.0) if value >= min(peak, 1.0))
    ax.set_ylim(-0.03 * top, (1.0 + 0.38) * top)
    ax.set_yticks([0.0, top / 2, top], ["0", f"{top / 2:g}", f"{top:g}"])
    sheet.label_values(ax, "excitation")


def _resistance(record: Record) -> Array:
    """(n,) N m in the direction of the stretch, as in `mjhcmc.patients.resistance`."""
    from scipy.ndimage import gaussian_filter1d

    trial, j = record.trial, JOINTS.index(record.trial.joint)
    r = trial.direction * (record.examiner_torque[:, j] - record.inertia * record.qacc[:, j])
    smooth: Array = gaussian_filter1d(r, SMOOTH * trial.rate, mode="nearest")
    return smooth


def _caught(record: Record, grading: Grading) -> float | None:
    """s, when the joint first is at the angle of the catch; None where it never is, or nothing catches."""
    trial = record.trial
    if grading.catch_angle is None or trial.test not in STRETCHES:
        return None
    beyond = trial.direction * (record.qpos[:, JOINTS.index(trial.joint)] - grading.catch_angle) >= 0
    return float(record.time[int(np.argmax(beyond))]) if beyond.any() else None


def legend_of(records: Sequence[Record], gradings: Sequence[Grading]) -> list[Artist]:
    """What lines and areas over time are."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries: list[Artist] = []
    moved = any(record.trial.speed for record in records)
    if moved:
        entries += [
            Patch(color=FLAGGED, lw=0, label="limb is moved"),
            Line2D([], [], color=DESIRED, lw=3.2, label="commanded"),
        ]
    entries.append(Line2D([], [], color=INK, lw=1.2, label="measured"))
    if moved:
        entries += [
            Line2D([], [], color=AXIS, lw=0.9, label="examiner's torque"),
            Line2D([], [], color=VERMILLION, lw=1.5, label="resistance"),
        ]
    entries.append(Patch(color=(BLUE, 0.25), lw=0, label="reflex part of excitation"))
    if any(grading.catch_angle is not None for grading in gradings):
        entries.append(Line2D([], [], color=INK, lw=0.9, ls=(0, (3, 2)), label="catch (ideal reading)"))
    return entries


def absent(ax: Axes, why: str) -> None:
    """Says that there is nothing, and why."""
    from textwrap import fill

    ax.set_axis_off()
    ax.text(0.0, 0.9, fill(f"no record: {why}" if why else "no record", 46), transform=ax.transAxes, va="top",
            fontsize=SMALL, color=INK)  # fmt: skip

"""A virtual patient on one sheet: the graded stretch, what depends on velocity, the pendulum, what is behind it all."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.leg8.table import JOINTS
from mjhcmc.patients.groups import TESTED
from mjhcmc.patients.leg import HEALTHY_STRAIN
from mjhcmc.patients.patient import Patient
from mjhcmc.patients.record import Record
from mjhcmc.patients.resistance import PLACES, Hand, read_resistance
from mjhcmc.plotting.panels import AXIS, BLUE, GRAY, INK, Sheet, finish, note, readable, scale_values, style
from mjhcmc.plotting.trial import (
    NO_GRADING,
    SMALL,
    STRETCHES,
    Grading,
    TrialSheet,
    absent,
    legend_of,
    over_time,
    way,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_SLOW, _MAS = GRAY, BLUE
_FAST = ("#F2A65A", "#D55E00", "#8C2D04", "#4A1602")  # the darker the faster
_LOOP = math.radians(1.0)  # rad, a swing that counts
_SMOOTH = 0.03  # s, short beside the half second of a swing


def patient_figure(
    records: Sequence[Record], gradings: Mapping[str, Grading], title: str, patient: Patient | None = None
) -> Figure:
    """All of a patient on a sheet: each tested joint is a column.

    From the top: the stretch in one second that is graded, over time; the resistance over the joint angle at all speeds
    of that joint, whose spread is what depends on velocity; the pendulum test; what the patient was made of.

    Args:
        records: of the patient's trials; of each stretch that is missing or failed the panel says so.
        gradings: by joint.
        title: of the figure.
        patient: for the last panel; None: it is left out.

    Raises:
        SettingsError: there is no stretch and no pendulum test among the records.
    """
    known = [record for record in records if record.trial.test in (*STRETCHES, "pendulum")]
    if not known:
        raise SettingsError(
            "patient_figure: there is no passive stretch and no pendulum test to draw: give their records"
        )
    graded: dict[str, Record] = {r.trial.joint: r for r in known if r.trial.test == "mas"}
    columns = [(joint, graded.get(joint), gradings.get(joint, NO_GRADING)) for joint in TESTED]
    speeds = _colors_of_speeds(known)
    with style():
        sheet = TrialSheet(
            4, 2, len(columns), (2.62, 1.08), f"{title} · each joint stretched over its range in 1 s",
            legend_of(known, [grading for _, _, grading in columns]),
        )  # fmt: skip
        over_time(sheet, columns)
        for column, (joint, _, grading) in enumerate(columns):
            own = [r for r in known if r.trial.joint == joint and r.trial.test in STRETCHES]
            _over_angle(sheet, column, own, grading, speeds)
        _speed_legend(sheet, speeds)
        pendulum = next((r for r in known if r.trial.test == "pendulum"), None)
        _swing(sheet, pendulum, 1 if patient is not None else 2)
        if patient is not None:
            _mechanisms(sheet, patient)
    return sheet.figure


def _over_angle(
    sheet: TrialSheet, column: int, records: Sequence[Record], grading: Grading, speeds: Mapping[tuple[str, float], str]
) -> None:
    """Resistance where the limb first passes each angle, for all speeds of a joint."""
    ax = sheet.panel(4, column, None if column else "Resistance over the range")
    courses: list[Array] = []
    for record in sorted(records, key=lambda r: (r.trial.test == "mas", r.trial.speed)):
        try:
            felt = read_resistance(record, Hand(1.0))
        except SimulationError:
            continue  # what failed is told in the panel of the stretch, or in the text
        trial = record.trial
        there = 1.0 - felt.range_lost + 1e-9 >= PLACES
        angle = np.degrees(trial.direction * (trial.start + PLACES * (trial.end - trial.start)))[there]
        ax.plot(
            angle, felt.course[there], color=speeds[_key(record)], label=_speed_name(_key(record)),
            lw=_width(_key(record)),
        )  # fmt: skip
        courses.append(felt.course[there])
    if not courses:
        absent(ax, records[0].failure if records else "")
        return
    trial = records[0].trial
    ends = np.degrees(trial.direction * np.array([trial.start, trial.end]))
    if grading.catch_angle is not None:
        at = math.degrees(trial.direction * grading.catch_angle)
        ax.axvline(at, color=INK, lw=0.9, ls=(0, (3, 2)), zorder=3.0, label="catch")
    ax.set_xlim(*ends)
    scale_values(sheet, ax, "resistance", "N m", courses, headroom=0.15)
    sheet.label_values(ax, "" if column else ax.get_ylabel())
    ax.set_xlabel(f"{way(trial.joint, int(trial.direction))} (°)", labelpad=2.0)
    finish(ax)


def _swing(sheet: TrialSheet, record: Record | None, last: int) -> None:
    """The pendulum test, with the angle that it comes to rest at."""
    ax = sheet.wide(5, 0, last, "Pendulum test of the knee: the shank falls from extension")
    if record is None or len(record.time) < 2:
        absent(ax, "" if record is None else record.failure)
        return
    knee = np.degrees(-record.qpos[:, JOINTS.index("knee")])
    rest = float(np.median(knee[record.time >= record.time[-1] - 0.5]))
    ax.axhline(rest, color=AXIS, lw=0.8, ls=(0, (4, 2)))
    ax.plot(record.time, knee, color=INK, lw=1.2, label="angle")
    top = int(np.argmax(knee))
    scale_values(sheet, ax, "knee flexion", "°", [knee], headroom=0.42)
    sheet.label_values(ax, ax.get_ylabel())
    ax.set_xlim(record.time[0], record.time[-1])
    passed = _times(knee, rest, record.trial.rate)
    note(ax, f"first swing to {knee[top]:.0f}°, rests at {rest:.0f}°, which it passes {passed}")
    finish(ax, time_label=True)


def _times(knee: Array, rest: float, rate: float) -> str:
    """How often the shank passes where it comes to rest, by a degree at least; the sensor's noise does not count."""
    from scipy.ndimage import gaussian_filter1d

    away = gaussian_filter1d(knee, _SMOOTH * rate, mode="nearest") - rest
    side = np.sign(away[np.abs(away) > math.degrees(_LOOP)])
    count = int(np.count_nonzero(np.diff(side)))
    return "never" if not count else "once" if count == 1 else f"{count} times"


def _mechanisms(sheet: TrialSheet, patient: Patient) -> None:
    """The latent values of each muscle group, as a small table."""
    ax = sheet.panel(5, 2, "Hidden mechanisms")
    ax.set_axis_off()
    unit = {"velocity": "s", "equation1": "1/lopt", "force": "1/F0"}[patient.reflex]
    bound = "F0" if patient.reflex == "force" else "1/s"
    heads = ("", f"gain\n({unit})", f"threshold\n({bound})", "tone\n(%)", "shorter\n(%)", "stiffer\n(×)")
    rows = [
        (readable(g.name), f"{g.gain:.2f}", f"{g.threshold:.2f}", f"{100 * g.tone:.1f}",
         f"{100 * g.fiber_shortening:.0f}", f"{(HEALTHY_STRAIN / g.passive_strain) ** 2:.1f}")
        for g in patient.groups
    ]  # fmt: skip
    right = (0.0, 0.44, 0.62, 0.73, 0.87, 1.0)
    for x, head in zip(right, heads, strict=True):
        ax.text(x, 1.0, head, ha="right", va="top", fontsize=6.4, color=GRAY, linespacing=1.05)
    for i, row in enumerate(rows):
        for k, (x, cell) in enumerate(zip(right, row, strict=True)):
            ax.text(x, 0.68 - 0.155 * i, cell, ha="right" if k else "left", va="center", fontsize=SMALL, color=INK)
    more = (
        f"severity {patient.severity:.2f}, strength {patient.strength * patient.paresis:.2f} of normal,\n"
        f"delay {1e3 * patient.delay:.0f} ms, co-contraction {100 * patient.cocontraction:.0f} %"
    )
    ax.text(0.0, 0.06, more, ha="left", va="top", fontsize=6.8, color=GRAY, linespacing=1.3)
    ax.set_xlim(0.0, 1.0)
    ax.set_ylim(0.0, 1.0)


def _key(record: Record) -> tuple[str, float]:
    """What makes a speed: a stretch in one second is one, however fast that is in a joint."""
    test = record.trial.test
    return test, 0.0 if test == "mas" else round(math.degrees(record.trial.speed), 3)


def _speed_name(key: tuple[str, float]) -> str:
    return "whole range in 1 s (as graded)" if key[0] == "mas" else f"{key[1]:.4g}°/s"


def _width(key: tuple[str, float]) -> float:
    return 1.9 if key[0] == "mas" else 1.1


def _speed_legend(sheet: Sheet, speeds: Mapping[tuple[str, float], str]) -> None:
    """Beside the title of the row of resistances."""
    from matplotlib.lines import Line2D

    lines = [Line2D([], [], color=color, lw=_width(key), label=_speed_name(key)) for key, color in speeds.items()]
    row = sheet.figure.axes[-1].get_position()
    sheet.figure.legend(
        handles=lines, loc="lower right", bbox_to_anchor=(row.x1, row.y1 + 0.05 / sheet.figure.get_size_inches()[1]),
        borderaxespad=0.0, borderpad=0.0, ncols=len(lines), handlelength=1.5, columnspacing=1.2, fontsize=7.5,
    )  # fmt: skip


def _colors_of_speeds(records: Sequence[Record]) -> dict[tuple[str, float], str]:
    keys = sorted({_key(record) for record in records if record.trial.test in STRETCHES})
    fast = [key for key in keys if key[0] == "fast"]
    of_fast = {key: _FAST[min(i, len(_FAST) - 1)] for i, key in enumerate(fast)}
    in_order = sorted(keys, key=lambda key: (("slow", "mas", "fast").index(key[0]), key[1]))
    return {key: of_fast.get(key, _MAS if key[0] == "mas" else _SLOW) for key in in_order}

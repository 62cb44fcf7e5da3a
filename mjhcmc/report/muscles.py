"""Panels of muscles: excitation and activation beside EMG and other solutions; force and fibers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mjhcmc.emg_comparison import EmgComparison, MuscleAgreement
from mjhcmc.plotting.panels import readable
from mjhcmc.report.contributions import Thinned
from mjhcmc.report.markup import Html, element, paragraphs, section
from mjhcmc.report.panel import Line, Panel, Row, grid, key_of
from mjhcmc.report.series import Book, spans
from mjhcmc.report.units import short
from mjhcmc.report.words import STATUS_WORD, saturated
from mjhcmc.solution import Solution

MOST_OTHERS = 4
"""Solutions drawn beside the first: there are so many colours and dashes."""

_FILTER_ABOVE = 12  # muscles, from which on a person looks for one by name
_TOPS = (0.2, 0.5)  # of panels where no muscle does more; else 1


def excitation_section(
    book: Book, solution: Solution, emg: EmgComparison | None, others: Mapping[str, Solution]
) -> tuple[Html, list[Panel]]:
    """Excitation and activation of every muscle, and the panels to draw."""
    panels = excitation_panels(book, solution, emg, others)
    tools: list[object] = []
    if len(panels) > _FILTER_ABOVE:
        tools.append(
            element(
                "label", "Find a muscle ",
                element("input", type="search", id="muscle-filter", placeholder="part of its name", autocomplete="off"),
            )
        )  # fmt: skip
    if len(panels) > 1:
        tools.append(
            element(
                "button", "Most active first", type="button", id="muscle-order", aria_pressed="false", class_="tool"
            )
        )
    notes = [
        f"Excitation is constant over a window, activation follows it. Panels reach to {top_of(solution, others):g}."
    ]
    if emg is not None:
        notes += emg_words(emg)
    return (
        section(
            "excitations", "Excitation and activation",
            paragraphs(*notes),
            key_of(_key(solution, emg, others)),
            element("div", *tools, class_="tools") if tools else "",
            element("p", "No muscle has that in its name.", id="muscle-none", hidden=True) if tools else "",
            grid(panels, "small", "muscle-grid"),
            _unmeasured(emg, solution),
        ),
        panels,
    )  # fmt: skip


def excitation_panels(
    book: Book, solution: Solution, emg: EmgComparison | None, others: Mapping[str, Solution]
) -> list[Panel]:
    """A panel for each muscle, in the model's order; all reach equally high."""
    windows = book.clock("windows", solution.time[:-1], float(solution.time[-1]))
    nodes = book.clock("nodes", solution.time)
    full = saturated(solution)
    measured = {} if emg is None else {one.muscle: i for i, one in enumerate(emg.muscles)}
    if emg is not None:
        book.clock("emg", emg.time)
    for rank, (_, other) in enumerate(others.items()):
        book.clock(f"other{rank}", other.time)
        book.clock(f"other{rank} windows", other.time[:-1], float(other.time[-1]))
    top = top_of(solution, others)
    panels = []
    for i, name in enumerate(solution.muscle_names):
        lines = [
            Line(
                book.column(f"excitation/{name}", windows, solution.excitation[:, i]),
                f"{readable(name)} excitation", "excitation", step=True,
            ),
            Line(
                book.column(f"activation/{name}", nodes, solution.activation[:, i]),
                f"{readable(name)} activation", "activation",
            ),
        ]  # fmt: skip
        for rank, (label, other) in enumerate(others.items()):
            if name in other.muscle_names:
                place = other.muscle_names.index(name)
                column = book.column(
                    f"other{rank}/excitation/{name}", f"other{rank} windows", other.excitation[:, place]
                )
                lines.append(Line(column, f"{label}: excitation", f"other{rank}", step=True))
                column = book.column(f"other{rank}/activation/{name}", f"other{rank}", other.activation[:, place])
                lines.append(Line(column, f"{label}: activation", f"other{rank}"))
        notes = [_peak_note(solution, i)]
        if emg is not None and name in measured:
            one = emg.muscles[measured[name]]
            column = book.column(f"emg/{name}", "emg", emg.envelope[:, measured[name]])
            lines.insert(0, Line(column, f"EMG {one.channel}, scaled", "emg", factor=_scale(one)))
            notes.append(agreement_words(one))
        panels.append(
            Panel(
                f"excitation-{i}", name, lines, [Row("", top=top)], 150,
                f"Excitation and activation of {readable(name)} over time. {notes[0]}.",
                notes=notes, bands={"saturated": spans(full[:, i], solution.time)}, flagged=True,
                peak=float(np.nanmax(solution.activation[:, i], initial=0.0)),
            )
        )  # fmt: skip
    return panels


def top_of(solution: Solution, others: Mapping[str, Solution]) -> float:
    """To which all panels reach: the least of .2, .5 and 1 that no muscle exceeds."""
    values = [
        solution.excitation,
        solution.activation,
        *(values for one in others.values() for values in (one.excitation, one.activation)),
    ]
    highest = max(float(np.nanmax(each, initial=0.0)) for each in values)
    return next((top for top in _TOPS if top > highest), 1.0)


def _peak_note(solution: Solution, i: int) -> str:
    k = int(np.argmax(solution.excitation[:, i]))
    return f"peak excitation {solution.excitation[k, i]:.3f} at {solution.time[k]:.3f} s"


def _scale(one: MuscleAgreement) -> float:
    return float(one.scale) if np.isfinite(one.scale) and one.scale > 0 else 1.0


def agreement_words(one: MuscleAgreement) -> str:
    """How well a muscle agrees with its channel, in a line."""
    if not np.isfinite(one.r):
        return f"EMG {one.channel}: {one.reason}; MAE {one.mae:.3f}" if np.isfinite(one.mae) else f"EMG: {one.reason}"
    overlap = f", overlap {one.jaccard:.2f}" if np.isfinite(one.jaccard) else ""
    text = f"EMG {one.channel}: r {one.r:.2f}, best {one.r_best:.2f} at lag {1e3 * one.lag:+.0f} ms{overlap}, "
    return (text + f"MAE {one.mae:.3f}").replace("-", "−")


def emg_words(emg: EmgComparison) -> list[str]:
    """What was compared, and how the numbers are meant."""
    median = {key: value for key, value in emg.medians().items() if np.isfinite(value)}
    text = (
        f"EMG: {emg.emg}, {len(emg.muscles)} muscles measured, {emg.time[0]:.3f} to {emg.time[-1]:.3f} s. Envelopes "
        "are drawn scaled to the excitation by least squares: their shape can be judged, their size not. r is the "
        "correlation of excitation and EMG, best the largest within lags of "
        f"{1e3 * emg.settings['delay']:g} ms (positive: excitation comes after EMG), overlap the time in which both "
        "are on over that in which either is, MAE the mean difference."
    )
    if {"r", "r_best", "above_others"} <= set(median):
        text += (
            f" In the median over muscles r is {median['r']:.2f} and best r {median['r_best']:.2f}; best r is "
            f"{median['above_others']:+.2f} above that of the channel with muscles which it does not measure."
        ).replace("-", "−")
    return [text]


def _unmeasured(emg: EmgComparison | None, solution: Solution) -> Html:
    if emg is None:
        return Html("")
    count = len(solution.muscle_names) - len(emg.muscles)
    return paragraphs(f"{count} of {len(solution.muscle_names)} muscles have no EMG." if count else "")


def _key(
    solution: Solution, emg: EmgComparison | None, others: Mapping[str, Solution]
) -> list[tuple[str, str]]:  # fmt: skip
    entries = [("excitation", "excitation"), ("activation", "activation")]
    if emg is not None:
        entries.append(("emg", "EMG envelope, scaled"))
    entries += [(f"other{rank}", f"{label}: activation, and thin: excitation") for rank, label in enumerate(others)]
    if saturated(solution).any():
        entries.append(("saturated", "at full excitation"))
    if kinds := [word for status, word in STATUS_WORD.items() if (solution.status == status).any()]:
        entries.append(("flagged", f"window flagged: {', '.join(kinds)}"))
    return entries


def state_section(book: Book, solution: Solution, detail: Thinned | None, why_not: str) -> tuple[Html, list[Panel]]:
    """Force, fiber length and velocity of every muscle, folded away."""
    nodes = book.clock("nodes", solution.time)
    own = "nodes" if detail is None else book.clock("detail", detail.time)
    panels = []
    for i, name in enumerate(solution.muscle_names):
        force = solution.muscle_force[:, i]
        k = int(np.argmax(np.where(np.isfinite(force), force, -np.inf)))
        lines = [Line(book.column(f"force/{name}", nodes, force), f"{readable(name)} force", "force", "N")]
        rows = [Row("force (N)")]
        if detail is not None and np.isfinite(detail.normalized_fiber_length[:, i]).any():
            rows += [Row("length (L₀)", least=0.05), Row("velocity (L₀/s)", least=0.05)]
            for row, (key, what, values, unit) in enumerate(
                (
                    ("length", "fiber length", detail.normalized_fiber_length, "L₀"),
                    ("velocity", "fiber velocity", detail.normalized_fiber_velocity, "L₀/s"),
                ),
                1,
            ):
                column = book.column(f"fiber_{key}/{name}", own, values[:, i])
                lines.append(Line(column, f"{readable(name)} {what}", key, unit, row))
        note = f"peak force {short(force[k])} N at {solution.time[k]:.3f} s"
        panels.append(
            Panel(
                f"state-{i}", name, lines, rows, 120 * len(rows) + 30,
                f"Force, fiber length and velocity of {readable(name)} over time. {note}.", notes=[note],
            )
        )  # fmt: skip
    text = (
        "Force along the tendon: active, passive and fiber damping. Fiber length and velocity are along the tendon, in "
        "optimal fiber lengths L₀ (and a second); lengthening is positive."
    )
    missing = f"Fiber length and velocity are left out: {why_not}" if detail is None else ""
    count = len(panels)
    return (
        section(
            "muscles", "Muscle state",
            paragraphs(text, missing),
            element(
                "details",
                element("summary", f"Force, fiber length and velocity of {count} muscle{'s' * (count != 1)}"),
                grid(panels, "medium"), class_="fold",
            ),
            element("p", "What is folded away is not printed.", class_="on-screen note"),
        ),
        panels,
    )  # fmt: skip

"""write_report: one HTML file from a solution, that needs no network and no other file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mjhcmc.emg import Emg
from mjhcmc.emg_comparison import EmgComparison, compare_emg
from mjhcmc.errors import MjhcmcError, SettingsError
from mjhcmc.io.files import written_whole
from mjhcmc.plotting.panels import headline
from mjhcmc.report import contributions
from mjhcmc.report.facts import facts_section
from mjhcmc.report.joints import angle_section, moment_section
from mjhcmc.report.markup import Html, element, escaped, joined, json_in_script, paragraphs, section, table
from mjhcmc.report.muscles import MOST_OTHERS, excitation_section, state_section
from mjhcmc.report.panel import Panel
from mjhcmc.report.series import MOST_POINTS, Book, spans
from mjhcmc.report.units import dof_name, length, limits, percent
from mjhcmc.report.words import verdict_section
from mjhcmc.solution import Solution, WindowStatus

if TYPE_CHECKING:
    from mjhcmc.report.replay import ReplayPart

_SECTIONS = {
    "verdict": "Verdict",
    "replay": "Replay",
    "excitations": "Excitation",
    "angles": "Joint angles",
    "moments": "Joint moments",
    "muscles": "Muscle state",
    "facts": "Model and run",
}
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
)
"""What the page may load: nothing. Pictures that are saved from plots are made inside it."""

_EARLY = 'document.documentElement.dataset.theme=matchMedia("(prefers-color-scheme: dark)").matches?"dark":"light"'
"""Before anything is seen, so that no light page flashes in the dark."""


def write_report(
    solution: Solution,
    path: str | os.PathLike[str],
    *,
    emg: Emg | EmgComparison | None = None,
    emg_map: Mapping[str, str] | str | os.PathLike[str] | None = None,
    others: Mapping[str, Solution] | None = None,
    run: Mapping[str, Any] | None = None,
    title: str | None = None,
    why_no_model: str | None = None,
) -> Path:
    """Write a solution as one HTML file: verdict, replay, excitations, angles, moments, muscles, model and run.

    The file needs no network and no other file. Its numbers are the solution's, in single precision; lines of more than
    2000 points are thinned, keeping the least and the largest value of each stretch, and the page says so.

    Args:
        solution: of the replay, the muscles' contributions and their fibers only what its model tells.
        path: the file, replaced whole.
        emg: envelopes on the solution's clock, or what `compare_emg` found of them.
        emg_map: muscle to channel, see `compare_emg`; of envelopes only.
        others: solutions to draw beside it, dashed, by label; four at most, each with a muscle of the same name.
        run: what run.json holds.
        title: over the page; by default method, model and motion.
        why_no_model: what to say where the model was not found.

    Returns:
        The path.

    Raises:
        SettingsError: more than four others, one without a common muscle, or EMG that does not fit.
        OutputError: the folder is missing or cannot be written.
    """
    path = Path(path)
    with written_whole(path) as temporary:
        temporary.touch()  # a folder that is not there, or is not the user's, is told before the work
        text = report(
            solution, emg=emg, emg_map=emg_map, others=others, run=run, title=title, why_no_model=why_no_model
        )
        temporary.write_text(text, encoding="utf-8")
    return path


def report(
    solution: Solution,
    *,
    emg: Emg | EmgComparison | None = None,
    emg_map: Mapping[str, str] | str | os.PathLike[str] | None = None,
    others: Mapping[str, Solution] | None = None,
    run: Mapping[str, Any] | None = None,
    title: str | None = None,
    why_no_model: str | None = None,
) -> str:
    """The page's text; arguments and errors as of `write_report`."""
    others = _checked(solution, others or {})
    measured = compare_emg(solution, emg, emg_map) if isinstance(emg, Emg) else emg
    detail, why_not = contributions.detail_of(solution)
    why_not = why_no_model or why_not
    book, panels = Book(), list[Panel]()
    notices = (run or {}).get("notices")
    parts = [verdict_section(solution, [str(one) for one in notices] if isinstance(notices, list) else ())]
    replay, replay_html = _replay_section(solution, why_not)
    parts.append(replay_html)
    for made, own in (
        excitation_section(book, solution, measured, others),
        angle_section(book, solution, others),
        moment_section(book, solution, detail, why_not),
        state_section(book, solution, detail, why_not),
    ):
        parts.append(made)
        panels += own
    if others:
        parts.insert(1, _beside(solution, others))
    parts.append(facts_section(solution, run or {}, why_no_model))
    data = {
        "span": [float(solution.time[0]), float(solution.time[-1])],
        "flagged": spans(solution.status != WindowStatus.OK, solution.time),
        "panels": {panel.name: panel.to_dict() for panel in panels},
        **book.to_dict(),
    }
    return _page(
        title or headline([solution]) or "Solution", solution, parts, data, replay, _thinned_words(solution, book)
    )


def _checked(solution: Solution, others: Mapping[str, Solution]) -> dict[str, Solution]:
    if len(others) > MOST_OTHERS:
        raise SettingsError(f"{len(others)} solutions beside the first: a report draws {MOST_OTHERS} at most")
    for label, other in others.items():
        if not set(other.muscle_names) & set(solution.muscle_names):
            some = ", ".join(other.muscle_names[:4])
            raise SettingsError(
                f"{label}: has none of the muscles of the solution (it has {some}, ...): give a solution of the same "
                "model, or of one whose muscles have the same names"
            )
        if other.time[-1] <= solution.time[0] or other.time[0] >= solution.time[-1]:
            raise SettingsError(
                f"{label}: covers {other.time[0]:g} to {other.time[-1]:g} s, the solution {solution.time[0]:g} to "
                f"{solution.time[-1]:g} s: give one of the same motion"
            )
    return dict(others)


def _replay_section(solution: Solution, why_not: str) -> tuple[ReplayPart | None, Html]:
    """The replay, or why there is none."""
    if solution.model is None:
        return None, section("replay", "Replay", paragraphs(f"There is no replay: {why_not}"))
    from mjhcmc.report.replay import replay_part
    from mjhcmc.viewing.frames import Frames

    try:
        part = replay_part(Frames.of(solution))
    except MjhcmcError as why:
        return None, section("replay", "Replay", paragraphs(f"There is no replay: {why}"))
    return part, section(
        "replay", "Replay",
        element(
            "p",
            "The model as its muscles move it, tendons coloured by activation, and where it should be. A click into "
            "any plot moves the replay there; the line in the plots is its time. Drag across a plot to look closer, in "
            "all of them at once; a double click shows the whole again.",
            class_="on-screen",
        ),
        Html(f'<div id="replay-player">{part.html}</div>'),
        element("p", "Five instants of the replay, evenly over its time.", class_="on-paper"),
    )  # fmt: skip


def _beside(solution: Solution, others: Mapping[str, Solution]) -> Html:
    """The solutions side by side, in a few numbers."""
    rows = []
    for label, one in {"this solution": solution, **others}.items():
        verdict = one.verdict
        tracked = [j for j, role in enumerate(one.roles) if role == "tracked"] or list(range(len(one.dof_names)))
        worst = tracked[int(np.argmax((np.array(verdict.tracking_rms) / limits(one))[tracked]))]
        effort = float((one.activation**2).sum(axis=1).mean())
        rows.append(
            (
                label, str(one.settings.get("method", "not known")), "holds" if verdict.passed else "fails",
                f"{length(one, worst, verdict.tracking_rms[worst])} ({dof_name(one, worst)})",
                percent(max(verdict.peak_reserve_share, default=0.0)), f"{effort:.3f}",
            )
        )  # fmt: skip
    head = ("Solution", "Method", "Verdict", "RMS error, worst joint", "Reserve, worst joint", "Mean Σ activation²")
    own = set(solution.muscle_names)
    notes = [
        f"{label} has {len(own & set(one.muscle_names))} of the {len(own)} muscles."
        for label, one in others.items()
        if not own <= set(one.muscle_names)
    ]
    return element(
        "section", element("h3", "Beside others"), table(head, rows, "Solutions side by side"), paragraphs(*notes)
    )


def _thinned_words(solution: Solution, book: Book) -> str:
    if not book.thinned:
        return ""
    return (
        f"The motion has {len(solution.time)} nodes. Lines of more than {MOST_POINTS} points are thinned for the "
        "screen: of each stretch of time the least and the largest value are drawn, so that no peak is lost. Verdict "
        "and tables are of all nodes."
    )


def _page(
    title: str, solution: Solution, parts: list[Html], data: dict[str, Any], replay: ReplayPart | None, thinned: str
) -> str:
    from plotly.offline import get_plotlyjs

    from mjhcmc import __version__

    look, script = (
        resources.files(__package__).joinpath(name).read_text("utf-8") for name in ("report.css", "report.js")
    )
    links = [element("li", element("a", word, href=f"#{name}")) for name, word in _SECTIONS.items()]
    span = f"{solution.time[0]:.3f} to {solution.time[-1]:.3f} s"
    head = element(
        "header",
        element(
            "div", element("h1", title),
            element("p", f"{len(solution.muscle_names)} muscles, {len(solution.dof_names)} degrees of freedom, {span}"),
        ),
        element("div",
            element("button", "Dark", type="button", id="theme", class_="tool", hidden=True), " ",
            element("button", "Print", type="button", id="print", class_="tool", hidden=True),
        ),
        class_="top",
    )  # fmt: skip
    body = joined(
        [
            element("a", "To the verdict", href="#verdict", class_="skip"),
            element(
                "div", head,
                element("noscript", paragraphs("Plots and replay need JavaScript; verdict and tables do not.")),
                element(
                    "div", element("nav", element("ol", *links), class_="toc", aria_label="Contents"),
                    element("main", paragraphs(thinned), joined(parts)), class_="columns",
                ),
                element("footer", f"Written by mjhcmc {__version__}. This file needs no network and no other file."),
                class_="frame",
            ),
            json_in_script("report-data", data),
            _script(get_plotlyjs()),
            _script(script),
            Html(replay.markup[len(replay.html) :]) if replay is not None else "",
        ]
    )  # fmt: skip
    return (
        '<!doctype html>\n<html lang="en" data-theme="light">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{escaped(_POLICY)}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escaped(title)}</title>\n<style>{look}</style>\n<script>{_EARLY}</script>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def _script(text: str) -> Html:
    """A script element; what stands in its strings may not end it, nor begin a comment."""
    return Html("<script>" + text.replace("</script", "<\\/script").replace("<!--", "<\\!--") + "</script>")

"""The verdict in words: does the simulation hold, by which thresholds, what is worst and what to try."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mjhcmc.plotting.panels import readable
from mjhcmc.report.markup import Html, bullets, element, paragraphs, section, table
from mjhcmc.report.reserve_words import allows_reserves, largest_reserve, largest_unmet, residual_words
from mjhcmc.report.series import runs
from mjhcmc.report.units import dof_name, length, limits, load, percent, with_role
from mjhcmc.solution import Solution, WindowStatus
from mjhcmc.verify import MAX_RESERVE_SHARE

_SATURATED = 0.999
_MOST = 8  # spans in a sentence
_CAVEAT = (
    "This is a check of the simulation: these excitations make this model move so. Whether the person's muscles did "
    "the same is another question, to which only measurements of that person have an answer: EMG, for one."
)
STATUS_WORD = {
    WindowStatus.RESERVE: "reserve in use",
    WindowStatus.UNMET: "moment unmet",
    WindowStatus.STIFF: "too stiff for the step",
}


def verdict_section(solution: Solution, notices: Sequence[str] = ()) -> Html:
    """The page's first section.

    Args:
        solution: what was found.
        notices: what was noticed on the way, as run.json has it.
    """
    verdict = solution.verdict
    reasons = reasons_against(solution)
    believed = verdict.passed
    because = "; ".join(reasons) or "the verdict that the file holds says so"
    head = (
        "The simulation holds: muscles moved the model along the motion"
        if believed
        else f"The simulation fails: {because}"
    )
    why = (
        "Reserves and tracking errors keep within the thresholds at every joint that is left to muscles, and the "
        "motion was solved to its end."
        if believed
        else "These excitations cannot be believed."
    )
    return section(
        "verdict", "Verdict",
        element(
            "div", element("p", f"{head}.", class_="head"), paragraphs(why, _CAVEAT if believed else ""),
            class_=f"banner {'holds' if believed else 'fails'}", role="status",
        ),
        _thresholds(solution),
        _worst(solution),
        _findings(solution),
        _notices(notices),
        _joints(solution),
        paragraphs(_whose_errors(solution), _replay_words(solution), _clock(solution)),
    )  # fmt: skip


def reasons_against(solution: Solution) -> list[str]:
    """Why the verdict fails, in clauses; empty where it holds."""
    verdict, found = solution.verdict, []
    share, rms = np.array(verdict.peak_reserve_share), np.array(verdict.tracking_rms)
    over = np.flatnonzero(share > MAX_RESERVE_SHARE)
    if over.size:
        j = int(over[np.argmax(share[over])])
        found.append(
            f"at {dof_name(solution, j)} the reserve reaches {percent(share[j])} of the peak moment, above the "
            f"threshold of {percent(MAX_RESERVE_SHARE)}{_and_more(over)}"
        )
    part = rms / limits(solution)
    over = np.flatnonzero(part > 1)
    if over.size:
        j = int(over[np.argmax(part[over])])
        found.append(
            f"at {dof_name(solution, j)} the tracking error is {length(solution, j, rms[j])} RMS, above the "
            f"threshold of {length(solution, j, limits(solution)[j])}{_and_more(over)}"
        )
    if solution.interrupted:
        found.append(f"the solve was interrupted at {solution.time[-1]:.3f} s, before the motion's end")
    return found


def _and_more(over: NDArray[np.intp]) -> str:
    more = len(over) - 1
    return f" ({more} more joint{'s' * (more > 1)} exceed{'s' * (more == 1)} it)" if more else ""


def _thresholds(solution: Solution) -> Html:
    verdict = solution.verdict
    share, rms, most = np.array(verdict.peak_reserve_share), np.array(verdict.tracking_rms), limits(solution)
    judged = _judged(solution)
    rows: list[Sequence[object]] = []

    def row(what: str, least: str, measured: str, holds: bool) -> None:
        rows.append(
            (what, least, measured, element("span", "holds" if holds else "fails", class_="yes" if holds else "no"))
        )

    if not allows_reserves(solution):
        what = f"{largest_unmet(solution) or 'nothing was unmet'}; no reserves were allowed"
        rows.append(("Reserve, of the peak moment", f"at most {percent(MAX_RESERVE_SHARE)}", what, "not used"))
    elif share.size:
        j = int(np.argmax(share))
        row(
            "Reserve, of the peak moment",
            f"at most {percent(MAX_RESERVE_SHARE)}",
            f"{percent(share[j])} ({dof_name(solution, j)})",
            bool(share[j] <= MAX_RESERVE_SHARE),
        )
    for rotation, what in ((True, "Error of angles, RMS"), (False, "Error of positions, RMS")):
        alike = np.flatnonzero(judged & (solution.dof_is_rotation == rotation))
        if alike.size:
            j = int(alike[np.argmax(rms[alike])])
            least = f"at most {length(solution, j, most[j])}"
            row(what, least, f"{length(solution, j, rms[j])} ({dof_name(solution, j)})", bool(rms[j] <= most[j]))
    end = f"to {solution.time[-1]:.3f} s"
    row("Motion solved", "to its end", f"{end}, interrupted" if solution.interrupted else end, not solution.interrupted)
    return table(
        ("What decides", "Threshold", "Measured (worst joint)", "Verdict"), rows, "What the verdict is made of",
        numeric=False,
    )  # fmt: skip


def _judged(solution: Solution) -> NDArray[np.bool_]:
    """(nv,) which errors tell something: those of prescribed joints are 0 by construction."""
    free = np.array([role != "prescribed" for role in solution.roles], dtype=np.bool_)
    return np.asarray(free | (np.array(solution.verdict.tracking_rms) > limits(solution)))


def _worst(solution: Solution) -> Html:
    """Worst joint, worst muscle, largest reserve: what and when."""
    facts: list[tuple[str, object]] = []
    part = np.where(_judged(solution), np.array(solution.verdict.tracking_rms) / limits(solution), -1.0)
    if part.max(initial=-1.0) >= 0:
        j = int(np.argmax(part))
        error = np.where(np.isfinite(solution.tracking_error[:, j]), solution.tracking_error[:, j], 0.0)
        k = int(np.argmax(np.abs(error)))
        facts.append(
            (
                "Worst joint",
                f"{dof_name(solution, j)}: off by up to {length(solution, j, abs(error[k]))}, at "
                f"{solution.time[k]:.3f} s; RMS {length(solution, j, solution.verdict.tracking_rms[j])}",
            )
        )
    if solution.muscle_names:
        facts.append(("Worst muscle", _worst_muscle(solution)))
    facts.append(("Largest reserve", largest_reserve(solution)))
    if solution.residual.any():
        facts.append(("Residuals (not judged)", residual_words(solution)))
    items = []
    for what, text in facts:
        items += [element("dt", what), element("dd", text)]
    return element("dl", *items, class_="worst")


def saturated(solution: Solution) -> NDArray[np.bool_]:
    """(N, n_muscle) whether a muscle is at full excitation: at the top of what the model lets it be."""
    top = 1.0 if solution.model is None else solution.model.excitation_range[:, 1]
    return np.asarray(solution.excitation >= _SATURATED * top)


def _worst_muscle(solution: Solution) -> str:
    full, time = saturated(solution), solution.time
    longest, which, first = 0.0, -1, 0
    for i in np.flatnonzero(full.any(axis=0)):
        for a, b in runs(full[:, i]):
            if time[b] - time[a] > longest + 1e-9:
                longest, which, first = float(time[b] - time[a]), int(i), int(a)
    if which < 0:
        k, i = np.unravel_index(int(np.argmax(solution.excitation)), solution.excitation.shape)
        return (
            f"none is at full excitation; the highest is {readable(solution.muscle_names[i])}, "
            f"{solution.excitation[k, i]:.3f} at {time[k]:.3f} s"
        )
    count, total = int(full.any(axis=0).sum()), float(full[:, which].mean())
    others = f"; {count} muscles reach full excitation in all" if count > 1 else ""
    return (
        f"{readable(solution.muscle_names[which])}: at full excitation for {1e3 * longest:.0f} ms from "
        f"{time[first]:.3f} s, {percent(total)} of the time{others}"
    )


def _findings(solution: Solution) -> Html:
    """What was found, the status of windows with their times, and what to try."""
    findings, status = [_readable(line, solution) for line in solution.verdict.findings], status_lines(solution)
    tries = remedies(solution)
    parts: list[object] = []
    for title, lines in (
        ("Findings", findings),
        ("Windows that did not go as they should", status),
        ("What to try", tries),
    ):
        if lines:
            parts += [element("h3", title), bullets(lines)]
    if not parts:
        parts = [
            paragraphs(
                "No finding: the only window went as it should."
                if solution.n_window == 1
                else f"No finding: all {solution.n_window} windows went as they should."
            )
        ]
    return element("div", *parts, class_="findings")


def _readable(line: str, solution: Solution) -> str:
    """A finding with the names of muscles and joints as the rest of the page writes them."""
    names = sorted({*solution.muscle_names, *solution.dof_names}, key=len, reverse=True)
    return re.sub("|".join(rf"(?<!\w){re.escape(name)}(?!\w)" for name in names), lambda own: readable(own[0]), line)


def windows(count: int) -> str:
    """So many windows."""
    return f"{count} window{'s' * (count != 1)}"


def _notices(notices: Sequence[str]) -> Html:
    """What the solve pointed out; it decides nothing, but a person should know it."""
    if not notices:
        return Html("")
    return element("div", element("p", "Noticed while solving, and no part of the verdict:"), bullets(notices))


def status_lines(solution: Solution) -> list[str]:
    """Each kind of status that occurs: how many windows, when, and what it means."""
    lines = []
    for status in WindowStatus:
        found = runs(solution.status == status)
        if status == WindowStatus.OK or not len(found):
            continue
        times = [f"{solution.time[a]:.3f} to {solution.time[b]:.3f} s" for a, b in found[:_MOST]]
        more = f" and {len(found) - _MOST} more spans" if len(found) > _MOST else ""
        count = int((solution.status == status).sum())
        lines.append(
            f"{STATUS_WORD[status]} in {count} of {windows(solution.n_window)} ({', '.join(times)}{more}): "
            f"{status.message}"
        )
    return lines


def remedies(solution: Solution) -> list[str]:
    """What to try, where the verdict fails."""
    verdict, method = solution.verdict, str(solution.settings.get("method", ""))
    if verdict.passed:
        return []
    found = []
    missing = np.array(verdict.peak_reserve_share) > MAX_RESERVE_SHARE
    error = np.array(verdict.tracking_rms) > limits(solution)
    if solution.interrupted:
        found.append("Solve again with the same command and let it come to the end.")
    if missing.any():
        found.append(
            "Reserves: look at the muscles above that are at full excitation when the reserve is needed. Check the "
            "motion's filter (noise in angles asks for large moments), the loads from outside (one that is missing has "
            "to be made up for), and the subject's strength in the model."
        )
    if error.any() and method == "static":
        found.append(
            "Tracking: static optimization leaves out that activation takes time to follow excitation. Solve the same "
            "motion by hcmc or cmc."
        )
    elif error.any() and not missing.any() and not solution.reserve.any():
        found.append("Tracking: solve with reserves on; they show at which joint the muscles lack moment, and when.")
    elif error.any():
        found.append("Tracking: solve with a shorter control window, and see whether the error shrinks.")
    return found


def _joints(solution: Solution) -> Html:
    verdict, rows = solution.verdict, []
    replay, word = verdict.replay_max_error, "Replay, largest error"
    if replay is None:
        replay, word = verdict.replay_window_max_error, "Replay by window, largest error"
    for j in _shown(solution):
        peak = float(solution.peak_moment[j])
        share = verdict.peak_reserve_share[j]
        reserve = load(solution, j, verdict.peak_reserve[j])
        rows.append(
            (
                dof_name(solution, j),
                length(solution, j, verdict.tracking_max[j]),
                length(solution, j, verdict.tracking_rms[j]),
                load(solution, j, peak),
                f"{reserve} (residual)" if solution.is_root[j] else f"{reserve} ({percent(share)})",
                "not known" if replay is None else length(solution, j, replay[j]),
            )
        )
    head = ("Joint", "Largest error", "RMS error", "Peak net moment", "Peak reserve", word)
    return table(head, rows, "Joint by joint")


def _shown(solution: Solution) -> list[int]:
    return with_role(solution, "tracked") or list(range(len(solution.dof_names)))


def _whose_errors(solution: Solution) -> str:
    led = [dof_name(solution, j) for j in with_role(solution, "prescribed")]
    text = (
        "The errors are those of the model driven by its muscles: excitation, activation, force, motion. No joint "
        "moment moves the skeleton but the reserves that are shown."
    )
    if led:
        text += f" These joints were not left to muscles but follow the motion: {_listed(led)}."
    return text


def _replay_words(solution: Solution) -> str:
    """What the replay tells, and how far off it is."""
    verdict = solution.verdict
    if verdict.replay_max_error is not None:
        text = (
            "Replay: excitations and reserves alone were played through a plain forward simulation, open loop from the "
            f"first node; it departs from the motion shown here by at most {_most(solution, verdict.replay_max_error)}."
        )
        if verdict.replay_window_max_error is not None:
            text += (
                f" Window by window, each from its own start, by {_most(solution, verdict.replay_window_max_error)}."
            )
    elif verdict.replay_window_max_error is not None:
        text = (
            "Replay: each window was played again from its own start; it ends within "
            f"{_most(solution, verdict.replay_window_max_error)} of the motion shown here. Under loads from outside a "
            "replay of the whole tells nothing: with nothing to bring it back, the smallest error grows."
        )
    else:
        return (
            "Replay: not known. The excitations were not played again, since the model, or what acted on it from "
            "outside, is not known here."
        )
    if verdict.integrator != "rk4":
        step = "" if verdict.physics_dt is None else f" of {1e3 * verdict.physics_dt:.3g} ms"
        text += f" It takes the same {verdict.integrator} steps{step}, whose own error it cannot show"
        own = verdict.integrator_error
        text += "." if own is None else f"; against continuous time windows end off by {_most(solution, own)}."
    return text


def _clock(solution: Solution) -> str:
    return (
        f"Times are those of the motion's own clock: {solution.time[0]:.3f} to {solution.time[-1]:.3f} s, "
        f"{windows(solution.n_window)} of {1e3 * float(np.median(np.diff(solution.time))):.4g} ms. A window's reserve "
        "and excitation are told at its start."
    )


def _most(solution: Solution, errors: Sequence[float]) -> str:
    """The largest of errors, of angles and of positions."""
    values = np.array(errors)
    words: list[str] = []
    for rotation in (True, False):
        alike = np.flatnonzero(solution.dof_is_rotation == rotation)
        if alike.size and (rotation or values[alike].any() or not words):
            j = int(alike[np.argmax(values[alike])])
            words.append(f"{length(solution, j, values[j])} ({dof_name(solution, j)})")
    return " and ".join(words)


def _listed(names: Sequence[str], most: int = 12) -> str:
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")

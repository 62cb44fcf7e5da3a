"""What the live page says of a result: how long it took, the verdict, the patient beside the healthy."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from mjhcmc.verify import MAX_RESERVE_SHARE, MAX_TRACKING_RMS, MAX_TRACKING_RMS_SLIDE
from mjhcmc.viewing.charts import tracked_joints
from mjhcmc.viewing.live_solver import LiveResult, LiveSolver

_GOOD, _BAD, _PALE = "#2b8a3e", "#c92a2a", "#868e96"
_MOST_FINDINGS = 3
_LEAST, _MANY = 1e-3, 10.0  # of a figure in the table: less is nothing; more needs no digit after the point
_BIG = '<span style="font-size:17px;font-weight:600">'


def latency_words(seen: Sequence[float], sent: Sequence[float], result: LiveResult) -> str:
    """HTML: from the slider to curves that are drawn, last and median, and what of it the solve took.

    Args:
        seen: s, from the slider's event at the server to the browser's answer that the curves are drawn; the last is
            this result's. None: no browser asked for it, or it did not answer.
        sent: s, of each result, from the slider's event at the server to the excitations on their way.
        result: the newest.
    """
    windows = "" if result.solution is None else f", {result.solution.n_window} windows"
    if seen:
        last = f"{_BIG}{1e3 * seen[-1]:.0f} ms</span> from slider to drawn curves, and the browser's answer"
        middle = f"median of {len(seen)}: {1e3 * float(np.median(seen)):.0f} ms"
    else:
        last, middle = f"{_BIG}–</span> from slider to drawn curves: no browser answered", ""
    server = (
        f"server alone: {1e3 * sent[-1]:.0f} ms from slider event to excitations sent, of which solving "
        f"{1e3 * result.solve_time:.0f} ms{windows}"
    )
    small = "<br>".join(line for line in (middle, server) if line)
    return _block(f'{last}<br><span style="color:{_PALE}">{small}</span>')


def verdict_words(result: LiveResult) -> str:
    """HTML: the verdict in a line and its findings, or why there is none."""
    if result.error is not None:
        return _block(f'<b style="color:{_BAD}">not solved</b> {html.escape(result.error)}')
    verdict = result.verdict
    assert verdict is not None
    word = f'<b style="color:{_GOOD}">holds</b>' if verdict.passed else f'<b style="color:{_BAD}">fails</b>'
    limits = (
        f"reserves ≤ {100 * MAX_RESERVE_SHARE:g} % of peak moment, tracking RMS ≤ {np.rad2deg(MAX_TRACKING_RMS):g} deg"
    )
    if result.solution is not None and not result.solution.dof_is_rotation[tracked_joints(result.solution)].all():
        limits += f", of slides {1e3 * MAX_TRACKING_RMS_SLIDE:g} mm"
    lines = [f'{word} <span style="color:{_PALE}">{limits}</span>']
    lines += [html.escape(line) for line in [*verdict.findings[:_MOST_FINDINGS], *result.notes[:1]]]
    more = len(verdict.findings) - _MOST_FINDINGS
    lines += [f"and {more} more"] if more > 0 else []
    return _block("<br>".join(lines))


def beside_words(result: LiveResult, healthy: LiveResult | None) -> str:
    """HTML: a table of a result beside the same movement without a reflex; nothing where it failed.

    Args:
        result: the newest.
        healthy: the same movement without a reflex; None where it is not known yet, or failed.
    """
    if result.solution is None:
        return ""
    rows = numbers_of(result)
    other = {} if healthy is None or healthy.solution is None else numbers_of(healthy)
    body = "".join(
        f"<tr><td>{html.escape(name)}</td><td{_RIGHT}>{value}</td><td{_RIGHT}>{other.get(name, '…')}</td></tr>"
        for name, value in rows.items()
    )
    return _block(
        f'<table style="width:100%;border-collapse:collapse"><tr style="color:{_PALE}"><td></td>'
        f"<td{_RIGHT}>now</td><td{_RIGHT}>gain 0</td></tr>{body}</table>"
    )


_RIGHT = ' style="text-align:right;padding-left:8px;white-space:nowrap;font-variant-numeric:tabular-nums"'


def numbers_of(result: LiveResult) -> dict[str, str]:
    """By name: largest tracking error, peak reserve, effort, and co-contraction by joint."""
    solution, verdict = result.solution, result.verdict
    assert solution is not None
    assert verdict is not None
    joints = tracked_joints(solution)
    error, share = np.array(verdict.tracking_max)[joints], np.array(verdict.peak_reserve_share)[joints]
    rotation = solution.dof_is_rotation[joints]
    worst = int(np.argmax(error / np.where(rotation, MAX_TRACKING_RMS, MAX_TRACKING_RMS_SLIDE)))
    most = int(np.argmax(share))
    scale, unit = (180 / np.pi, "deg") if rotation[worst] else (1e3, "mm")
    rows = {
        "largest tracking error": f"{_figure(scale * error[worst])} {unit}",
        "reserve / peak moment": f"{_figure(100 * share[most])} %",
        "mean excitation": f"{solution.excitation.mean():.3f}",
        "of it reflex": "0" if result.reflex is None else f"{result.reflex.mean():.3f}",
    }
    contraction = result.cocontraction
    return rows | {
        f"co-contraction, {solution.dof_names[j]}": f"{100 * contraction[j]:.0f} %"
        for j in joints
        if np.isfinite(contraction[j])
    }


def _figure(value: float) -> str:
    """Two digits of what is small, and can be seen; all before the point of what is large."""
    if not np.isfinite(value):
        return "not known"
    if value < _LEAST:
        return f"< {_LEAST:g}"
    return f"{value:.0f}" if value >= _MANY else f"{value:.2g}"


def about_words(solver: LiveSolver, has_reflex: bool) -> str:
    """HTML: what is fixed, and what is left out."""
    lines = [f"HCMC on {html.escape(solver.model.name)}, windows of {1e3 * solver.dt:g} ms, from rest."]
    if solver.left_out:
        some = ", ".join(solver.left_out[:4]) + (" ..." if len(solver.left_out) > 4 else "")
        lines.append(
            f"Sliders for {len(solver.joints)} joints; {len(solver.left_out)} stay at the reference pose: "
            f"{html.escape(some)}."
        )
    if not has_reflex:
        lines.append("No reflex: the fibers of its muscles are not known.")
    return _block(f'<span style="color:{_PALE}">{"<br>".join(lines)}</span>')


def _block(content: str) -> str:
    return f'<div style="font-size:12px;line-height:1.45;padding:3px 12px">{content}</div>'

"""What the live page says of a result: how long it took, the verdict, the patient beside the healthy."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from mjhcmc.viewing.charts import tracked_joints
from mjhcmc.viewing.live_solver import LiveResult, LiveSolver

SOON = 0.1
"""s: what comes sooner feels immediate (Card, Robertson and Mackinlay 1991, doi:10.1145/108844.108874)."""

_GOOD, _BAD, _PALE = "#2b8a3e", "#c92a2a", "#868e96"
_MOST_FINDINGS = 3
_LEAST = 1e-3  # of a figure in the table: less is nothing


def latency_words(latencies: Sequence[float], result: LiveResult) -> str:
    """HTML: from the slider to the page, last and median, and the solve alone.

    Args:
        latencies: s, from what the slider said to what was sent to the page; the last is this result's.
        result: the newest.
    """
    last, median = 1e3 * latencies[-1], 1e3 * float(np.median(latencies))
    colour = _GOOD if latencies[-1] <= SOON else "inherit"
    windows = "" if result.solution is None else f", {result.solution.n_window} windows"
    return _block(
        f'<span style="font-size:17px;font-weight:600;color:{colour}">{last:.0f} ms</span> from slider to excitations'
        f'<br><span style="color:{_PALE}">median of {len(latencies)}: {median:.0f} ms; '
        f"solving alone {1e3 * result.solve_time:.0f} ms{windows}</span>"
    )


def verdict_words(result: LiveResult) -> str:
    """HTML: the verdict in a line and its findings, or why there is none."""
    if result.error is not None:
        return _block(f'<b style="color:{_BAD}">not solved</b> {html.escape(result.error)}')
    verdict = result.verdict
    assert verdict is not None
    word = f'<b style="color:{_GOOD}">holds</b>' if verdict.passed else f'<b style="color:{_BAD}">fails</b>'
    limits = "reserves ≤ 5 % of peak moment, tracking RMS ≤ 1 deg"
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
    scale = np.where(solution.dof_is_rotation[joints], 180 / np.pi, 1.0)
    worst, most = int(np.argmax(error * scale)), int(np.argmax(share))
    unit = "deg" if solution.dof_is_rotation[joints[worst]] else "m"
    rows = {
        "largest tracking error": f"{_figure((error * scale)[worst])} {unit}",
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
    """Two digits, of what can be seen."""
    return f"{value:.2g}" if value >= _LEAST else f"< {_LEAST:g}"


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

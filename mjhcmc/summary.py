"""A solution in numbers: plain values for JSON, and a table for the screen. Degrees here, where a person reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.solution import Solution

_MANY = 6  # joints in a line
_TINY = np.finfo(float).tiny


def numbers(solution: Solution) -> dict[str, Any]:
    """What the table shows, as plain values for JSON.

    Angles in degrees, moments in N m; at a slide the same keys hold m and N. By joint: ``max_error_deg``,
    ``rmse_deg`` (root of the mean square over the N+1 nodes), ``mse_deg2`` (the mean square), ``peak_moment_nm``,
    ``peak_reserve_nm``, ``replay_max_error_deg`` (None where the solution does not know its model),
    ``peak_external_load_nm`` (None where nothing acts from outside; where joint moments were given, it is what they
    imply), ``peak_residual_nm`` (only where there is one); ``peak_excitation`` by muscle; ``verdict`` with ``passed``
    and ``findings``.
    """
    verdict, scale = solution.verdict, _scale(solution)
    joints = solution.dof_names

    def by_joint(values: Sequence[float] | NDArray[np.float64] | None) -> dict[str, float] | None:
        if values is None:
            return None
        return {name: float(value) for name, value in zip(joints, values, strict=True)}

    residual = {"peak_residual_nm": by_joint(np.abs(solution.residual).max(axis=0))} if solution.residual.any() else {}
    return residual | {
        "max_error_deg": by_joint(np.array(verdict.tracking_max) * scale),
        "rmse_deg": by_joint(np.array(verdict.tracking_rms) * scale),
        "mse_deg2": by_joint((np.array(verdict.tracking_rms) * scale) ** 2),
        "peak_excitation": dict(zip(solution.muscle_names, solution.excitation.max(axis=0).tolist(), strict=True)),
        "peak_moment_nm": by_joint(solution.peak_moment),
        "peak_reserve_nm": by_joint(verdict.peak_reserve),
        "peak_external_load_nm": by_joint(
            np.abs(solution.external_load).max(axis=0) if solution.external_load.any() else None
        ),
        "replay_max_error_deg": by_joint(
            None if verdict.replay_max_error is None else np.array(verdict.replay_max_error) * scale
        ),
        "verdict": {"passed": verdict.passed, "findings": list(verdict.findings)},
    }


def _scale(solution: Solution) -> NDArray[np.float64]:
    return np.where(solution.dof_is_rotation, 180 / np.pi, 1.0)


def screen(solution: Solution) -> str:
    """One screen: joints, muscles, status, verdict."""
    values = numbers(solution)
    settings = solution.settings
    lines = [
        f"{settings.get('method', '?')} on {settings.get('model', '?')}, {settings.get('motion', '?')}: "
        f"{solution.n_window} windows of {1e3 * solution.dt:g} ms, {solution.time[0]:g} to {solution.time[-1]:g} s"
        + _stepped_by(solution),
        "",
        *_joint_table(solution, values),
        "",
        *_muscle_table(values["peak_excitation"], solution),
        "",
        *role_lines(solution),
        *load_lines(solution),
        *step_lines(solution),
        *[f"status   {line}" for line in solution.messages()],
        *verdict_lines(values["verdict"]),
    ]
    return "\n".join(lines)


def _stepped_by(solution: Solution) -> str:
    """What stepped the plant, where it is not RK4, for the header."""
    if solution.integrator == "rk4":
        return ""
    step = solution.settings.get("physics_dt")
    return f", {solution.integrator}" + ("" if step is None else f" in steps of {1e3 * step:.3g} ms")


def step_lines(solution: Solution) -> list[str]:
    """What the steps of an integrator of first order are off by; replay, which is of the same steps, cannot tell."""
    error = solution.verdict.integrator_error
    if error is None:
        return []
    tracked = np.array([j for j, role in enumerate(solution.roles) if role == "tracked"], dtype=int)
    off = np.array(error) * _scale(solution)
    words = [f"{solution.dof_names[j]} {off[j]:.2g} {'deg' if solution.dof_is_rotation[j] else 'm'}" for j in tracked]
    return [
        f"steps    {solution.integrator}'s own error, which replay by the same steps does not show: in continuous time "
        f"windows end elsewhere by up to {_some(words, off[tracked])}"
    ]


def role_lines(solution: Solution) -> list[str]:
    """What became of the degrees of freedom that are not tracked, and the residuals at the root."""
    lines, peak = [], np.abs(solution.residual).max(axis=0)
    led = [j for j, role in enumerate(solution.roles) if role == "prescribed" or (solution.is_root[j] and peak[j] > 0)]
    if led:
        words = [f"{solution.dof_names[j]} {peak[j]:.3g} {_moment_unit(solution, j)}" for j in led]
        lines.append(f"residual peak of what keeps the motion: {_some(words, peak[led])}")
    off, scale = np.abs(solution.tracking_error).max(axis=0), _scale(solution)
    tied = [j for j, role in enumerate(solution.roles) if role == "dependent"]
    if tied:
        words = [
            f"{solution.dof_names[j]} {scale[j] * off[j]:.2g} {'deg' if solution.dof_is_rotation[j] else 'm'}"
            for j in tied
        ]
        lines.append(f"tied     largest departure of joints that follow others: {_some(words, off[tied])}")
    free = [name for name, role in zip(solution.dof_names, solution.roles, strict=True) if role == "free"]
    if free:
        lines.append(f"free     nothing leads {_some(free)}")
    return lines


def load_lines(solution: Solution) -> list[str]:
    """The load from outside beside the net joint moments; none where nothing acts from outside.

    Joint moments that a user gives imply one (see `joint_moments`). One that is larger than the moments themselves is
    more often another kind of table than a ground reaction.
    """
    lines = []
    given = solution.settings.get("joint_moments")
    if solution.external_load.any():
        load, moment = np.abs(solution.external_load).max(axis=0), solution.peak_moment
        borne = [j for j in range(len(load)) if load[j] > 0]
        words = [
            f"{solution.dof_names[j]} {load[j]:.3g} {_moment_unit(solution, j)}"
            + (
                f" ({100 * load[j] / moment[j]:.3g} % of the net joint moment's peak)"
                if given and moment[j] > 0
                else ""
            )
            for j in borne
        ]
        source = f", implied by {given}" if given else ""
        lines.append(f"load     peak from outside{source}: {_some(words, (load / np.maximum(moment, _TINY))[borne])}")
        larger = [name for j, name in enumerate(solution.dof_names) if load[j] > moment[j]]
        if given and larger:
            lines.append(
                f"         larger than the net joint moment at {_some(larger)}: are these joint moments, in N m?"
            )
    if difference := solution.settings.get("joint_moment_difference"):
        words = [
            f"{name} {difference[name]:.3g} {_moment_unit(solution, j)}"
            for j, name in enumerate(solution.dof_names)
            if name in difference
        ]
        lines.append(f"moments  largest difference from those given: {_some(words)}")
    return lines


def _moment_unit(solution: Solution, joint: int) -> str:
    return "N m" if solution.dof_is_rotation[joint] else "N"


def _some(words: Sequence[str], size: NDArray[np.float64] | None = None) -> str:
    """Words in a line, the largest where there are many."""
    if len(words) <= _MANY:
        return ", ".join(words)
    first = range(_MANY) if size is None else sorted(np.argsort(-size, kind="stable")[:_MANY])
    return f"{', '.join(words[i] for i in first)} and {len(words) - _MANY} more"


def verdict_lines(verdict: Mapping[str, Any]) -> list[str]:
    """The verdict in words, one line and one more for each finding."""
    word = "holds: reserves <= 5 % of peak moment, tracking RMS <= 1 deg" if verdict["passed"] else "FAILS"
    return [f"verdict  {word}", *[f"         {finding}" for finding in verdict["findings"]]]


def _joint_table(solution: Solution, values: Mapping[str, Any]) -> list[str]:
    replay, by_window = values["replay_max_error_deg"], solution.verdict.replay_window_max_error
    word = "replay error"
    if replay is None and by_window is not None:  # under loads from outside open loop tells nothing
        replay = dict(zip(solution.dof_names, np.array(by_window) * _scale(solution), strict=True))
        word = "replay, by window"
    if solution.integrator != "rk4":
        word += ", same steps"
    rows = [["joint", "max error", "RMS error", "peak moment", "peak reserve", word]]
    share = solution.verdict.peak_reserve_share
    for j, name in enumerate(solution.dof_names):
        if solution.roles[j] != "tracked":
            continue
        angle, moment = ("deg", "N m") if solution.dof_is_rotation[j] else ("m", "N")
        rows.append(
            [
                name,
                f"{values['max_error_deg'][name]:.3g} {angle}",
                f"{values['rmse_deg'][name]:.3g} {angle}",
                f"{values['peak_moment_nm'][name]:.3g} {moment}",
                "residual"
                if solution.is_root[j]
                else f"{values['peak_reserve_nm'][name]:.2g} {moment} ({100 * share[j]:.2g} %)",
                "-" if replay is None else f"{replay[name]:.2g} {angle}",
            ]
        )
    return columns(rows)


def _muscle_table(peaks: Mapping[str, float], solution: Solution) -> list[str]:
    mean = solution.excitation.mean(axis=0)
    rows = [["muscle", "peak excitation", "mean", ""]]
    for i, (name, peak) in enumerate(peaks.items()):
        rows.append([name, f"{peak:.3f}", f"{mean[i]:.3f}", "#" * round(20 * peak)])
    if len(rows) > 25:
        rows = [*rows[:25], [f"... {len(rows) - 25} more in the table", "", "", ""]]
    return columns(rows)


def columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of text as aligned columns; the first column left, the others right but for bars."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(width) if i == 0 or set(cell) <= {"#"} else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return lines

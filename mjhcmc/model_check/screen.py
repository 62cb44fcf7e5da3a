"""A report on a model as text for the screen, in degrees."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Sequence

import numpy as np

from mjhcmc.model_check.report import JointReport, ModelReport, MuscleReport, position_text
from mjhcmc.model_problems import Problem

_WIDTH = 100  # columns
_MUSCLES_SHOWN = 25
_JOINTS_SHOWN = 45
_TIES_SHOWN = 30
_NAMES_SHOWN = 24
_NAME_WIDTH = 20
_LONG_NAME = 32
_NUMBER = re.compile(r"(?<![\w.])-?\d[\d.e+-]*")  # not the digits of a name
_HEADINGS = {
    "error": "ERRORS: solve refuses this model until they are gone",
    "warning": "warnings",
    "note": "notes",
}
_LED = {
    "prescribed": "prescribed, along the motion or at the reference pose, their force reported as residual",
    "free": "free, led by nothing",
}


def text_of(report: ModelReport) -> str:
    """See `ModelReport.screen`."""
    blocks = [
        _head(report),
        _joint_table(report.joints),
        *_tie_tables(report),
        _muscle_table(report.muscles),
        _step_table(report),
        *_problem_blocks(report.problems),
    ]
    return "\n\n".join("\n".join(block) for block in blocks)


def _head(report: ModelReport) -> list[str]:
    gravity = " ".join(f"{g:.4g}" for g in report.gravity)
    others = f", {_count(report.other_actuators, 'other actuator')}" if report.other_actuators else ""
    errors = sum(problem.level == "error" for problem in report.problems)
    return [
        f"{report.name}: {_count(len(report.muscles), 'muscle')}, {_count(len(report.joints), 'joint')}{others}, "
        f"{report.total_mass:.4g} kg; {report.engine}",
        f"gravity {gravity} m/s^2, {report.integrator}; {_count(report.joint_limits, 'joint limit')}, "
        f"{_count(report.tendon_limits, 'tendon limit')}, {_count(len(report.equalities), 'equality constraint')}",
        f"{_count(report.colliding_pairs, 'pair')} of geoms can touch, {len(report.contacts)} in contact at "
        "the reference pose",
        f"solve REFUSES this model: {_count(errors, 'error')}, below" if errors else _accepted(report),
        _roles(report),
    ]


def _accepted(report: ModelReport) -> str:
    needed = report.physics_dt_needed
    if needed is None:
        return "solve takes this model"
    at_reference, default = report.steps[0].at_reference, report.default_physics_dt
    where = "" if at_reference is not None and at_reference < default else " at some poses"
    return f"solve takes this model with --physics-dt {needed:.2g}: the default {1e3 * default:g} ms is unstable{where}"


def _count(n: int, thing: str) -> str:
    return f"{n} {thing if n == 1 else thing + 's'}"


def _roles(report: ModelReport) -> str:
    counts = {role: n for role, n in report.roles.items() if n}
    named = ", ".join(f"{n} {role}" for role, n in counts.items())
    n = sum(counts.values())
    poses = f"; {_count(len(report.keyframes), 'keyframe')}" if report.keyframes else ""
    return f"{_count(n, 'degree')} of freedom{': ' if named else ''}{named}{poses}"


def _joint_table(joints: Sequence[JointReport]) -> list[str]:
    own = [joint for joint in joints if "tracked" in joint.roles]
    rows = [["joint", "type", "range", "damping", "most -", "in range", "most +", "in range", "passive", "column"]]
    rows += [row for joint in own for row in _joint_rows(joint)][:_JOINTS_SHOWN]
    if not any(joint.column for joint in own):
        rows = [row[:-1] for row in rows]
    return [
        "tracked joints: ranges in deg (m at slides); the muscles' most either way in N m (N), isometric",
        *_table(rows, "llrrrrrrrl"),
        *_cut(sum(len(_joint_rows(joint)) for joint in own), _JOINTS_SHOWN),
        *(line for role, how in _LED.items() for line in _led(joints, role, how)),
    ]


def _led(joints: Sequence[JointReport], role: str, how: str) -> list[str]:
    names = [dof.name for joint in joints for dof in joint.dofs if dof.role == role]
    more = f" and {len(names) - _NAMES_SHOWN} more (--json)" if len(names) > _NAMES_SHOWN else ""
    return _wrapped(f"{how}: {', '.join(names[:_NAMES_SHOWN])}{more}", "") if names else []


def _tie_tables(report: ModelReport) -> list[list[str]]:
    """What follows what by which polynomial, and the equality constraints of other kinds."""
    following = [joint for joint in report.joints if joint.follows is not None]
    blocks = []
    if following:
        shown = sorted(following, key=lambda joint: joint.follows or "")[:_TIES_SHOWN]
        width = max(len(_name(joint.name, _LONG_NAME)) for joint in shown)
        lines = ["dependent joints: their way from qpos0 by x, the way of the joint that they follow, rad and m"]
        for leader in dict.fromkeys(joint.follows for joint in shown):
            lines.append(f"follow x = {leader}" if leader else "held")
            lines += [
                f"  {_name(joint.name, _LONG_NAME):{width}}  {_polynomial(joint)}"
                for joint in shown
                if joint.follows == leader
            ]
        blocks.append([*lines, *_cut(len(following), _TIES_SHOWN)])
    others = [tie for tie in report.equalities if not (tie.type == "joint" and _told(tie.ties, following))]
    if others:
        tied = [
            dof.name
            for joint in report.joints
            for dof in joint.dofs
            if dof.role == "dependent" and joint.follows is None
        ]
        rows = [["equality constraint", "type", "ties"]]
        rows += [[_name(tie.name), tie.type, " and ".join(tie.ties)] for tie in others[:_TIES_SHOWN]]
        block = [*_table(rows, "lll"), *_cut(len(others), _TIES_SHOWN)]
        if tied:
            block += _wrapped(f"dependent through them: {', '.join(tied)}", "")
        blocks.append(block)
    return blocks


def _told(ties: Sequence[str], following: Sequence[JointReport]) -> bool:
    return any(joint.name == ties[0] and joint.follows == (*ties, "")[1] for joint in following)


def _polynomial(joint: JointReport) -> str:
    assert joint.polynomial is not None
    if not joint.follows:
        return f"{joint.polynomial[0]:+.4g}"
    powers = ["", " x", " x^2", " x^3", " x^4"]
    terms = [f"{c:+.3g}{power}" for c, power in zip(joint.polynomial, powers, strict=True) if c]
    return " ".join(terms) or "0"


def _joint_rows(joint: JointReport) -> list[list[str]]:
    """One row, or one for each degree of freedom of a ball or free joint."""
    if joint.unit is not None:
        return [_joint_row(joint)]
    damping, column = f"{joint.damping:.2g}", joint.column or ""
    return [
        [_name(dof.name), joint.type, "", damping, _force(dof.strength[0]), "", _force(dof.strength[1]), "", "", column]
        for dof in joint.dofs
        if dof.strength is not None
    ]


def _joint_row(joint: JointReport) -> list[str]:
    cells = [_name(joint.name), joint.type, _joint_range(joint), f"{joint.damping:.2g}"]
    if joint.strength is None or joint.negative_strength_range is None or joint.positive_strength_range is None:
        return [*cells, *[""] * 5, joint.column or ""]
    negative, positive = joint.strength
    return [
        *cells,
        _force(negative),
        "..".join(map(_force, joint.negative_strength_range)),
        _force(positive),
        "..".join(map(_force, joint.positive_strength_range)),
        _force(joint.passive_moment or 0.0, 2),
        joint.column or "",
    ]


def _joint_range(joint: JointReport) -> str:
    if joint.unit is None:
        return ""
    if joint.range is None:
        return "no limits"
    scale = 180 / np.pi if joint.unit == "rad" else 1.0
    return f"{scale * joint.range[0]:.3g}..{scale * joint.range[1]:.3g}"


def _muscle_table(muscles: Sequence[MuscleReport]) -> list[str]:
    rows = [["muscle", "gain", "F0 (N)", "L0 (mm)", "fiber length (L0)", "tau (ms)", "joints"]]
    for muscle in muscles[:_MUSCLES_SHOWN]:
        length = ""
        if muscle.fiber_length_range is not None:
            least, most = muscle.fiber_length_range
            length = f"{least:.2f}..{most:.2f}{'!' if muscle.leaves_limits else ' '}"
        L0 = muscle.optimal_fiber_length
        rows.append(
            [
                _name(muscle.name),
                muscle.gain,
                "" if muscle.max_isometric_force is None else f"{muscle.max_isometric_force:.4g}",
                "" if L0 is None else f"{1e3 * L0:.3g}",
                length,
                f"{1e3 * muscle.activation_time:.3g}/{1e3 * muscle.deactivation_time:.3g}",
                _joints_crossed(muscle.joints),
            ]
        )
    return [
        "fiber length: over the joints' ranges, one moved at a time; ! goes beyond lmin..lmax",
        *_table(rows, "llrrrrl"),
        *_cut(len(muscles), _MUSCLES_SHOWN),
    ]


def _joints_crossed(names: Sequence[str]) -> str:
    text = ""
    for k, name in enumerate(names):
        longer = f"{text}, {name}" if text else name
        if len(longer) > 26 and text:
            return f"{text} +{len(names) - k}"
        text = longer
    return text or "NONE"


def _step_table(report: ModelReport) -> list[str]:
    rows = [["muscles", "at reference", "over ranges", "where", "limited by"]]
    for step in report.steps:
        where = ""
        if step.worst_joint is not None and step.worst_position is not None:
            joint = next(joint for joint in report.joints if joint.name == step.worst_joint)
            where = f"{_name(step.worst_joint)} at {position_text(joint.unit, step.worst_position)}"
        activity, by = "fully active" if step.activation else "at rest", _name(step.fastest or "")
        rows.append([activity, _milliseconds(step.at_reference), _milliseconds(step.over_range), where, by])
    default = 1e3 * report.default_physics_dt
    return [f"largest stable physics step (RK4); the default is {default:g} ms", *_table(rows, "lrrll")]


def _milliseconds(step: float | None) -> str:
    if step is None:
        return "any"
    return f"{1e3 * step:.3g} ms" if step < 1 else "over 1 s"


def _problem_blocks(problems: Iterable[Problem]) -> list[list[str]]:
    problems = list(problems)
    if not problems:
        return [["no problems found"]]
    blocks = []
    for level, heading in _HEADINGS.items():
        groups: dict[tuple[str, ...], list[Problem]] = {}
        for problem in problems:
            if problem.level == level:
                groups.setdefault(_alike(problem), []).append(problem)
        lines = [line for group in groups.values() for line in _group_lines(group)]
        if lines:
            blocks.append([heading, *lines])
    return blocks


def _alike(problem: Problem) -> tuple[str, ...]:
    """Problems that differ in their numbers and in the name alone are told together."""
    kind = problem.where.partition("'")[0]
    return kind, *(_NUMBER.sub("#", text) for text in (problem.what, problem.remedy))


def _group_lines(group: Sequence[Problem]) -> list[str]:
    first, others = group[0], group[1:]
    lines = _wrapped(f"{first.where} {first.what}: {first.remedy}", "  - ")
    if others:
        names = [problem.where.partition("'")[2].removesuffix("'") or problem.where for problem in others]
        same = all(problem.what == first.what for problem in others)
        more = f" and {len(names) - _NAMES_SHOWN} more (--json)" if len(names) > _NAMES_SHOWN else ""
        text = (
            f"likewise{'' if same else ', with other numbers'} ({len(names)}): {', '.join(names[:_NAMES_SHOWN])}{more}"
        )
        lines += _wrapped(text, "    ")
    return lines


def _wrapped(text: str, indent: str) -> list[str]:
    return textwrap.wrap(
        text, _WIDTH, initial_indent=indent, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )


def _cut(count: int, shown: int) -> list[str]:
    return [f"... {count - shown} more with --json"] if count > shown else []


def _name(name: str, width: int = _NAME_WIDTH) -> str:
    """A long name without its middle: sides and numbers stand at the end."""
    return name if len(name) <= width else f"{name[: width - 12]}..{name[-10:]}"


def _force(value: float, digits: int = 3) -> str:
    if abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:.{digits}g}" if abs(value) >= 5e-4 else "0"


def _table(rows: Sequence[Sequence[str]], align: str) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if side == "l" else cell.rjust(width)
            for cell, width, side in zip(row, widths, align, strict=False)
        ).rstrip()
        for row in rows
    ]

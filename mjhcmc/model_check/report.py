"""What `mjhcmc.check.check` found in a model: plain values for JSON, and text for the screen, in degrees."""

from __future__ import annotations

import dataclasses
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjhcmc.model_problems import Problem

_WIDTH = 100  # columns
_STEP_MARGIN = 0.8
_MUSCLES_SHOWN = 25
_JOINTS_SHOWN = 45
_NAMES_SHOWN = 24
_NAME_WIDTH = 20
_NUMBER = re.compile(r"(?<![\w.])-?\d[\d.e+-]*")  # not the digits of a name
_HEADINGS = {
    "error": "ERRORS: solve refuses this model until they are gone",
    "warning": "warnings",
    "note": "notes",
}


@dataclass(frozen=True)
class MuscleReport:
    """One muscle.

    Attributes:
        name: its name.
        gain: the engine's type of gain: ``muscle``, ``fixed``, ``affine`` or ``user``.
        max_isometric_force: N, see `MuscleModel.max_isometric_force`; None where the model does not tell it.
        optimal_fiber_length: m, L0 along the tendon; None for another gain than muscle, as are all that need it.
        fiber_length: L0, at the reference pose.
        fiber_length_range: L0, least and most over the joints' ranges, one joint moved at a time.
        force_length_limits: L0, lmin and lmax: no active force beyond them.
        leaves_limits: whether the range goes beyond these limits.
        max_velocity: L0/s, vmax.
        activation_time: s.
        deactivation_time: s.
        smoothing: 1, width of the smooth switch between the two; 0: none.
        excitation_range: 1, lowest and highest excitation that the model's ctrlrange leaves of 0..1.
        joints: those that it crosses: a moment arm over 1 mm, or over 1e-3 of its largest, somewhere.
    """

    name: str
    gain: str
    max_isometric_force: float | None
    optimal_fiber_length: float | None
    fiber_length: float | None
    fiber_length_range: tuple[float, float] | None
    force_length_limits: tuple[float, float] | None
    leaves_limits: bool | None
    max_velocity: float | None
    activation_time: float
    deactivation_time: float
    smoothing: float
    excitation_range: tuple[float, float]
    joints: tuple[str, ...]


@dataclass(frozen=True)
class JointReport:
    """One joint.

    Attributes:
        name: its name.
        type: ``hinge``, ``slide``, ``ball`` or ``free``.
        follows: the joint that it follows by an equality constraint, ``""`` where one holds it; None: it follows none.
            A joint that follows, a ball and a free joint have None from scanned on.
        unit: of its position, ``rad`` or ``m``; moments are N m or N accordingly.
        range: least and greatest position that the model allows; None where it is not limited.
        reference_outside: its position at the reference pose, where that lies outside the range; else None.
        damping: N m s/rad or N s/m.
        column: the file column that the model maps onto it, a leading ``-`` flips the sign.
        scanned: positions between which strength was measured.
        strength: most negative and most positive moment of the muscles at the reference pose: isometric, each at the
            upper or the lower end of its excitation range, without passive force.
        negative_strength_range: of the first, least and greatest over `scanned`, other joints at the reference pose.
        positive_strength_range: of the second.
        passive_moment: at the reference pose: passive muscle force, springs, other actuators at control 0.
        muscles: those that cross it; those that cross what follows it among them.
    """

    name: str
    type: str
    follows: str | None
    unit: str | None
    range: tuple[float, float] | None
    reference_outside: float | None
    damping: float
    column: str | None
    scanned: tuple[float, float] | None
    strength: tuple[float, float] | None
    negative_strength_range: tuple[float, float] | None
    positive_strength_range: tuple[float, float] | None
    passive_moment: float | None
    muscles: tuple[str, ...]


@dataclass(frozen=True)
class StepReport:
    """The largest physics step at which RK4 is stable, all muscles at one activation; None: nothing decays.

    Attributes:
        activation: of all muscles, as a share of the upper end of their excitation range.
        at_reference: s.
        over_range: s, least over the joints' ranges.
        worst_joint: the joint that was away from the reference pose there; None: none was.
        worst_position: rad or m, where it was.
    """

    activation: float
    at_reference: float | None
    over_range: float | None
    worst_joint: str | None
    worst_position: float | None


@dataclass(frozen=True)
class ModelReport:
    """What mjhcmc sees in a model. SI units and radians.

    Attributes:
        name: the model's name.
        engine: the engine and its version.
        solvable: whether the methods take the model: no problem is an error.
        total_mass: kg.
        gravity: (3,) m/s^2.
        integrator: that the model names; mjhcmc steps by RK4.
        muscles: in the order of the actuators.
        joints: in the model's order.
        other_actuators: how many actuators are no muscles.
        equality_constraints: how many are active.
        joint_limits: how many joints are limited.
        tendon_limits: how many tendons are limited.
        colliding_pairs: pairs of geoms that may touch.
        contacts_at_reference: contacts at the reference pose.
        default_physics_dt: s, the default physics step.
        steps: the largest stable physics step at zero and at full activation.
        problems: errors first, then warnings, then notes.
    """

    name: str
    engine: str
    solvable: bool
    total_mass: float
    gravity: tuple[float, float, float]
    integrator: str
    muscles: tuple[MuscleReport, ...]
    joints: tuple[JointReport, ...]
    other_actuators: int
    equality_constraints: int
    joint_limits: int
    tendon_limits: int
    colliding_pairs: int
    contacts_at_reference: int
    default_physics_dt: float
    steps: tuple[StepReport, StepReport]
    problems: tuple[Problem, ...]

    @property
    def physics_dt_needed(self) -> float | None:
        """s, a step that the passive damping allows all over the joints' ranges; None where the default step does.

        The default step is refused by solve where the damping at rest, along the motion, does not allow it.
        """
        stable = self.steps[0].over_range
        return _STEP_MARGIN * stable if stable is not None and stable < self.default_physics_dt else None

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, SI units and radians, under the names of the attributes."""
        plain = _plain({**dataclasses.asdict(self), "physics_dt_needed": self.physics_dt_needed})
        assert isinstance(plain, dict)
        return plain

    def screen(self) -> str:
        """Text for the screen, 100 columns wide; long lists are cut, `to_dict` has them whole."""
        blocks = [
            _head(self),
            _joint_table(self.joints),
            _muscle_table(self.muscles),
            _step_table(self),
            *_problem_blocks(self.problems),
        ]
        return "\n\n".join("\n".join(block) for block in blocks)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value


def _head(report: ModelReport) -> list[str]:
    gravity = " ".join(f"{g:.4g}" for g in report.gravity)
    others = f", {_count(report.other_actuators, 'other actuator')}" if report.other_actuators else ""
    errors = sum(problem.level == "error" for problem in report.problems)
    return [
        f"{report.name}: {_count(len(report.muscles), 'muscle')}, {_count(len(report.joints), 'joint')}{others}, "
        f"{report.total_mass:.4g} kg; {report.engine}",
        f"gravity {gravity} m/s^2, integrator {report.integrator}; {_count(report.joint_limits, 'joint limit')}, "
        f"{_count(report.tendon_limits, 'tendon limit')}, {_count(report.equality_constraints, 'equality constraint')}",
        f"{_count(report.colliding_pairs, 'pair')} of geoms can touch, {report.contacts_at_reference} in contact at "
        "the reference pose",
        f"solve REFUSES this model: {_count(errors, 'error')}, below" if errors else _accepted(report),
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


def _joint_table(joints: Sequence[JointReport]) -> list[str]:
    own = [joint for joint in joints if joint.follows is None]
    rows = [["joint", "type", "range", "damping", "most -", "in range", "most +", "in range", "passive", "column"]]
    rows += [_joint_row(joint) for joint in own[:_JOINTS_SHOWN]]
    if not any(joint.column for joint in own):
        rows = [row[:-1] for row in rows]
    following = len(joints) - len(own)
    return [
        "ranges in deg (m at slides); the muscles' most either way in N m (N), isometric, at reference",
        *_table(rows, "llrrrrrrrl"),
        *_cut(len(own), _JOINTS_SHOWN),
        *([f"and {_count(following, 'joint')} tied to others by equality constraints (--json)"] if following else []),
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
        if len(longer) > 29 and text:
            return f"{text} +{len(names) - k}"
        text = longer
    return text or "NONE"


def _step_table(report: ModelReport) -> list[str]:
    rows = [["muscles", "at the reference pose", "over the ranges", ""]]
    for step in report.steps:
        where = ""
        if step.worst_joint is not None and step.worst_position is not None:
            joint = next(joint for joint in report.joints if joint.name == step.worst_joint)
            where = f"({step.worst_joint} at {position_text(joint.unit, step.worst_position)})"
        activity = "fully active" if step.activation else "at rest"
        rows.append([activity, _milliseconds(step.at_reference), _milliseconds(step.over_range), where])
    default = 1e3 * report.default_physics_dt
    return [f"largest stable physics step (RK4); the default is {default:g} ms", *_table(rows, "lrrl")]


def position_text(unit: str | None, position: float) -> str:
    """A joint's position for the eye: degrees at a hinge, m at a slide."""
    return f"{np.rad2deg(position):.3g} deg" if unit == "rad" else f"{position:.3g} m"


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


def _name(name: str) -> str:
    """A long name without its middle: sides and numbers stand at the end."""
    return name if len(name) <= _NAME_WIDTH else f"{name[:8]}..{name[10 - _NAME_WIDTH :]}"


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

"""What a report on a model makes one warn of, or note, each with its place and its remedy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mjhcmc.model_check.report import JointReport, ModelReport, MuscleReport, position_text
from mjhcmc.model_check.scan import Jump
from mjhcmc.model_problems import Problem

_DEFAULT_VMAX = 1.5  # L0/s, MuJoCo's; Hill muscles have about 10 (Zajac 1989)
_NO_STRENGTH = 1e-3  # share of the joint's strength the other way


def findings(report: ModelReport, jumps: Sequence[Jump], uncoupled: int) -> tuple[Problem, ...]:
    """Warnings, then notes.

    Args:
        report: what was measured.
        jumps: in muscle lengths.
        uncoupled: active equality constraints that the measurements do not follow.
    """
    found = [
        *(problem for joint in report.joints for problem in _of_joint(joint)),
        *(problem for muscle in report.muscles for problem in _of_muscle(muscle)),
        *(_of_jump(report, jump) for jump in jumps),
        *_of_step(report),
        *_of_model(report, uncoupled),
    ]
    return tuple(sorted(found, key=lambda problem: problem.level == "note"))


def _of_joint(joint: JointReport) -> Iterator[Problem]:
    where = f"joint {joint.name!r}"
    if joint.negative_strength_range is not None and joint.positive_strength_range is not None:
        negative, positive = -joint.negative_strength_range[0], joint.positive_strength_range[1]
        least = _NO_STRENGTH * max(negative, positive)
        way = None
        if max(negative, positive) <= 0 or not joint.muscles:
            way = "either way"
        elif negative <= least:
            way = "in the negative direction"
        elif positive <= least:
            way = "in the positive direction"
        if way is not None:
            remedy = "expect reserves there, or add a muscle, or fix the joint"
            yield Problem(f"cannot be moved {way} by any muscle", where, remedy, "warning")
    if joint.reference_outside is not None:
        yield Problem(
            f"has its reference pose, {position_text(joint.unit, joint.reference_outside)}, outside its range",
            where,
            "correct its ref or its range: strength at the reference pose means little here",
            "note",
        )


def _of_muscle(muscle: MuscleReport) -> Iterator[Problem]:
    where = f"muscle {muscle.name!r}"
    if not muscle.joints:
        yield Problem(
            "crosses no joint, so its activation does nothing",
            where,
            "check the sites of its tendon, or remove it",
            "warning",
        )
    if muscle.gain == "muscle" and muscle.optimal_fiber_length is None:
        yield Problem(
            "has no optimal fiber length",
            where,
            "give it a lengthrange and a range whose ends differ",
            "warning",
        )
    low, high = muscle.excitation_range
    if (low, high) != (0.0, 1.0):
        kept = f" and is never below {low:g}, where it weakens its antagonists" if low > 0 else ""
        yield Problem(
            f"takes excitations up to {high:g}{kept}",
            where,
            "set its ctrlrange to 0 1 if that is not meant: strength here counts with it",
            "note",
        )
    if muscle.max_velocity == _DEFAULT_VMAX:
        yield Problem(
            f"has MuJoCo's default vmax, {_DEFAULT_VMAX:g} L0/s, about 7 times slower than a Hill muscle's 10",
            where,
            "set vmax to about 10, and fit lmin, lmax, fpmax and fvmax too",
            "note",
        )
    if muscle.leaves_limits and muscle.fiber_length_range and muscle.force_length_limits:
        (least, most), (low, high) = muscle.fiber_length_range, muscle.force_length_limits
        yield Problem(
            f"goes from {least:.2f} to {most:.2f} L0, beyond its force-length curve ({low:.2f} to {high:.2f})",
            where,
            "it has no active force there: see that the motion stays within, or check its range and lengthrange",
            "note",
        )


def _of_jump(report: ModelReport, jump: Jump) -> Problem:
    joint = report.joints[jump.joint]
    return Problem(
        f"jumps in length by {1e3 * jump.size:.3g} mm where joint {joint.name!r} is at "
        f"{position_text(joint.unit, jump.position)}",
        f"muscle {report.muscles[jump.muscle].name!r}",
        "move its wrapping geom or side site, or keep the motion away from there",
        "warning",
    )


def _of_step(report: ModelReport) -> Iterator[Problem]:
    rest, active = (step.over_range for step in report.steps)
    default = report.default_physics_dt
    beyond = f"somewhere in the joints' ranges, less than the default {1e3 * default:g} ms"
    needed = report.physics_dt_needed
    if rest is not None and needed is not None:
        yield Problem(
            f"allows steps of at most {1e3 * rest:.2g} ms {beyond}",
            "the model's damping",
            f"use --physics-dt {needed:.2g}",
            "warning",
        )
    elif active is not None and active < default:
        yield Problem(
            f"allows steps of at most {1e3 * active:.2g} ms {beyond}",
            "the damping of muscles, all fully active,",
            "use a smaller --physics-dt where a solution's status asks for it",
            "note",
        )


def _of_model(report: ModelReport, uncoupled: int) -> Iterator[Problem]:
    if not report.joints:
        yield Problem("has no joint, so nothing moves", "the model", "give its bodies joints", "warning")
    if report.integrator != "RK4":
        remedy = "no need to act, mjhcmc steps a copy of the model by RK4"
        yield Problem(f"is {report.integrator}", "the model's integrator", remedy, "note")
    if report.other_actuators:
        yield Problem(
            f"stay at control 0 and count as passive ({report.other_actuators})",
            "the actuators that are no muscles",
            "remove those that should not pull there",
            "note",
        )
    if uncoupled:
        yield Problem(
            f"are not followed here ({uncoupled} that tie no joint to another)",
            "equality constraints",
            "read strength, fiber lengths and steps as those of the joints without them",
            "note",
        )
    if report.contacts_at_reference:
        yield Problem(
            f"touch at the reference pose ({report.contacts_at_reference} contacts)",
            "some geoms",
            "set contype and conaffinity to 0 where they should not collide",
            "note",
        )

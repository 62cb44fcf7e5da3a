"""What a report on a model makes one warn of, or note, each with its place and its remedy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mjhcmc.model_check.report import ContactReport, JointReport, ModelReport, MuscleReport, position_text
from mjhcmc.model_check.scan import Jump
from mjhcmc.model_problems import Problem

_DEFAULT_VMAX = 1.5  # L0/s, MuJoCo's; Hill muscles have about 10 (Zajac 1989)
_NO_STRENGTH = 1e-3  # share of the joint's strength the other way
_NOTHING = 1e-9  # share of the strongest joint's: rounding


def findings(report: ModelReport, jumps: Sequence[Jump]) -> tuple[Problem, ...]:
    """Warnings, then notes.

    Args:
        report: what was measured.
        jumps: in muscle lengths.
    """
    strengths = [abs(one) for joint in report.joints for dof in joint.dofs for one in dof.strength or ()]
    nothing = _NOTHING * max(strengths, default=0.0)
    found = [
        *(problem for joint in report.joints for problem in _of_joint(joint, nothing)),
        *(_of_contact(contact) for contact in report.contacts),
        *(problem for muscle in report.muscles for problem in _of_muscle(muscle)),
        *(_of_jump(report, jump) for jump in jumps),
        *_of_step(report),
        *_of_model(report),
    ]
    return tuple(sorted(found, key=lambda problem: problem.level == "note"))


def _of_joint(joint: JointReport, nothing: float) -> Iterator[Problem]:
    where = f"joint {joint.name!r}"
    if joint.negative_strength_range is not None and joint.positive_strength_range is not None:
        negative, positive = -joint.negative_strength_range[0], joint.positive_strength_range[1]
        least = _NO_STRENGTH * max(negative, positive)
        way = None
        if max(negative, positive) <= nothing or not joint.muscles:
            way = "either way"
        elif negative <= least:
            way = "in the negative direction"
        elif positive <= least:
            way = "in the positive direction"
        if way is not None:
            remedy = "expect reserves there, or add a muscle, or fix the joint"
            if way == "either way" and joint.muscles:
                way, remedy = (
                    f"{way}, others at the reference pose,",
                    "expect reserves there, or start from another pose",
                )
            yield Problem(f"cannot be moved {way} by any muscle", where, remedy, "warning")
    for dof in joint.dofs if joint.unit is None else ():
        if dof.strength is not None and max(map(abs, dof.strength)) <= nothing:
            remedy = "expect reserves there, or add a muscle, or prescribe the joint"
            yield Problem(
                "cannot be moved by any muscle at the reference pose", f"joint {dof.name!r}", remedy, "warning"
            )
    if joint.usable is not None:
        low, high = (position_text(joint.unit, position) for position in joint.usable)
        names = ", ".join(joint.first_out)
        if names:
            why, remedy = f"where what is tied to it leaves a range of its own ({names})", "or widen those ranges"
        else:
            why, remedy = "where the equality constraints can be met", "or change these"
        yield Problem(f"can go from {low} to {high}, {why}", where, f"keep the motion within, {remedy}", "note")
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
    F0 = muscle.max_isometric_force
    if muscle.force_range is not None and F0 is not None and muscle.force_range[1] < F0:
        yield Problem(
            f"is clamped by forcerange to {muscle.force_range[1]:.4g} N, less than its F0 of {F0:.4g} N",
            where,
            "remove forcerange if that is not meant: activation beyond it does nothing",
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


def _of_contact(contact: ContactReport) -> Problem:
    one, other = contact.geoms
    what = f"touch at the reference pose, {1e3 * max(0.0, contact.depth):.3g} mm deep"
    remedy = "start the motion from another pose, or <exclude> their bodies where they should not collide"
    too_much = contact.joint is not None and abs(contact.push) > contact.strength
    if contact.joint is not None:
        what += f", and push joint {contact.joint!r} with {contact.push:.3g} N m (N)"
        if too_much:
            what += f", more than the {contact.strength:.3g} that its muscles have against it"
    return Problem(what, f"geoms {one!r} and {other!r}", remedy, "warning" if too_much else "note")


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


def _of_model(report: ModelReport) -> Iterator[Problem]:
    if not report.joints:
        yield Problem("has no joint, so nothing moves", "the model", "give its bodies joints", "warning")
    if report.integrator != "RK4":
        name = report.integrator.lower()
        what = "is Euler, MuJoCo's default or the model's choice" if name == "euler" else f"is {name}"
        remedy = f"mjhcmc steps a copy of the model by RK4; solve with --integrator {name} for MuJoCo's way"
        yield Problem(what, "the model's integrator", remedy, "note")
    if report.other_actuators:
        yield Problem(
            f"stay at control 0 and count as passive ({report.other_actuators})",
            "the actuators that are no muscles",
            "remove those that should not pull there",
            "note",
        )
    if report.reference_missed is not None:
        yield Problem(
            f"cannot be met at the reference pose (they miss by {report.reference_missed:.3g} rad or m)",
            "the equality constraints",
            "correct them, or give them a reference pose that meets them: what is measured here is beside them",
            "warning",
        )
    held = [dof.name for joint in report.joints for dof in joint.dofs if dof.role == "prescribed"]
    if held:
        yield Problem(
            f"are prescribed ({', '.join(held[:3])}{', ...' if len(held) > 3 else ''})",
            f"the {len(held)} degrees of freedom of the root",
            "name them in the motion to move them; else they stay at the reference pose",
            "note",
        )

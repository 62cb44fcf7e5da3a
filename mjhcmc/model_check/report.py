"""What `mjhcmc.check` found in a model: plain values, SI units and radians; `screen` makes text of them."""

from __future__ import annotations

import dataclasses
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from mjhcmc.model_problems import Problem

_STEP_MARGIN = 0.8


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
        force_range: N, pulling positive, to which the model clamps the muscle's force; None: to none.
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
    force_range: tuple[float, float] | None
    joints: tuple[str, ...]


@dataclass(frozen=True)
class DofReport:
    """One degree of freedom.

    Attributes:
        name: its name; that of a hinge's or slide's is the joint's.
        role: ``tracked``, ``dependent``, ``prescribed`` or ``free``, see `mjhcmc.roles.Role`.
        strength: N m or N, most negative and most positive moment of the muscles at the reference pose; None where it
            is not tracked.
        pushed: N m or N, by joint limits and contacts at the reference pose, at rest, muscles off.
    """

    name: str
    role: str
    strength: tuple[float, float] | None
    pushed: float


@dataclass(frozen=True)
class JointReport:
    """One joint.

    Attributes:
        name: its name.
        type: ``hinge``, ``slide``, ``ball`` or ``free``.
        dofs: its degrees of freedom, with their roles.
        follows: the joint that it follows by an equality constraint between joints, ``""`` where one holds it; None: it
            follows none.
        polynomial: (5,) c0 to c4 of that constraint: y - y0 = c0 + c1 (x - x0) + ... + c4 (x - x0)^4, x being the joint
            that it follows, x0 and y0 the model's qpos0.
        unit: of its position, ``rad`` or ``m``; moments are N m or N accordingly; None of ball and free joints.
        range: least and greatest position that the model allows; None where it is not limited.
        usable: the same, as far as what is tied to it stays within ranges of its own; None where that is everywhere.
        first_out: the tied joints that leave their ranges first beyond `usable`.
        reference_outside: its position at the reference pose, where that lies outside the range; else None.
        damping: N m s/rad or N s/m.
        column: the file column that the model maps onto it, a leading ``-`` flips the sign.
        scanned: positions between which strength was measured; None, as are the next, but for hinges and slides that
            are tracked.
        strength: most negative and most positive moment of the muscles at the reference pose: isometric, each at the
            upper or the lower end of its excitation range, without passive force.
        negative_strength_range: of the first, least and greatest over `scanned`, other joints at the reference pose.
        positive_strength_range: of the second.
        passive_moment: at the reference pose: passive muscle force, springs, other actuators at control 0.
        muscles: those that cross it; those that cross what follows it among them.
    """

    name: str
    type: str
    dofs: tuple[DofReport, ...]
    follows: str | None
    polynomial: tuple[float, ...] | None
    unit: str | None
    range: tuple[float, float] | None
    usable: tuple[float, float] | None
    first_out: tuple[str, ...]
    reference_outside: float | None
    damping: float
    column: str | None
    scanned: tuple[float, float] | None
    strength: tuple[float, float] | None
    negative_strength_range: tuple[float, float] | None
    positive_strength_range: tuple[float, float] | None
    passive_moment: float | None
    muscles: tuple[str, ...]

    @property
    def roles(self) -> tuple[str, ...]:
        """Those of its degrees of freedom, each once."""
        return tuple(dict.fromkeys(dof.role for dof in self.dofs))


@dataclass(frozen=True)
class EqualityReport:
    """One active equality constraint.

    Attributes:
        name: its name.
        type: ``joint``, ``tendon``, ``connect``, ``weld`` or another of the engine's.
        ties: names of the joints, tendons, bodies or sites that it ties, the dependent joint first.
    """

    name: str
    type: str
    ties: tuple[str, ...]


@dataclass(frozen=True)
class ContactReport:
    """Two geoms that touch at the reference pose.

    Attributes:
        geoms: their names; a nameless geom is called by its body.
        depth: m, how far they go into each other at the deepest point.
        joint: the degree of freedom that they push hardest, among those that no motion prescribes; None: none.
        push: N m or N, with which they push it at rest, muscles off.
        strength: N m or N, most that muscles can do against it.
    """

    geoms: tuple[str, str]
    depth: float
    joint: str | None
    push: float
    strength: float


@dataclass(frozen=True)
class StepReport:
    """The largest physics step at which RK4 is stable, all muscles at one activation; None: nothing decays.

    Attributes:
        activation: of all muscles, as a share of the upper end of their excitation range.
        at_reference: s.
        over_range: s, least over the joints' ranges.
        worst_joint: the joint that was away from the reference pose there; None: none was.
        worst_position: rad or m, where it was.
        fastest: the degree of freedom that moves most in what limits the step over the ranges.
    """

    activation: float
    at_reference: float | None
    over_range: float | None
    worst_joint: str | None
    worst_position: float | None
    fastest: str | None


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
        equalities: the active equality constraints.
        reference_missed: rad or m, by which the reference pose misses them; None: it meets them.
        joint_limits: how many joints are limited.
        tendon_limits: how many tendons are limited.
        colliding_pairs: pairs of geoms that may touch.
        contacts: what touches at the reference pose.
        keyframes: names of the poses that the model ships.
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
    equalities: tuple[EqualityReport, ...]
    reference_missed: float | None
    joint_limits: int
    tendon_limits: int
    colliding_pairs: int
    contacts: tuple[ContactReport, ...]
    keyframes: tuple[str, ...]
    default_physics_dt: float
    steps: tuple[StepReport, StepReport]
    problems: tuple[Problem, ...]

    @property
    def roles(self) -> dict[str, int]:
        """How many degrees of freedom have each role."""
        return dict(Counter(dof.role for joint in self.joints for dof in joint.dofs))

    @property
    def physics_dt_needed(self) -> float | None:
        """s, a step that the passive damping allows all over the joints' ranges; None where the default step does.

        The default step is refused by solve where the damping at rest, along the motion, does not allow it.
        """
        stable = self.steps[0].over_range
        return _STEP_MARGIN * stable if stable is not None and stable < self.default_physics_dt else None

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, SI units and radians, under the names of the attributes."""
        plain = _plain({**dataclasses.asdict(self), "roles": self.roles, "physics_dt_needed": self.physics_dt_needed})
        assert isinstance(plain, dict)
        return plain

    def screen(self) -> str:
        """Text for the screen, 100 columns wide, in degrees; long lists are cut, `to_dict` has them whole."""
        from mjhcmc.model_check.screen import text_of

        return text_of(self)


def position_text(unit: str | None, position: float) -> str:
    """A joint's position for the eye: degrees at a hinge, m at a slide."""
    return f"{np.rad2deg(position):.3g} deg" if unit == "rad" else f"{position:.3g} m"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value

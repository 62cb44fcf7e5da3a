"""A patient's leg: leg8 rebuilt from its parameter table with the patient's body and muscles.

What a patient changes, everything else being leg8's at the patient's mass and height (see `mjhcmc.leg8.builder`):

- Segment masses are the patient's fractions of the body mass; a segment's inertia goes with its mass. Mass centres stay
  where the source has them in a segment of the patient's size: .415 and .434 of the length of thigh and shank, beside
  .4095 and .4459 of de Leva (1996, doi:10.1016/0021-9290(95)00178-6), between other ends.
- Max isometric force of every muscle is multiplied by strength and by paresis: the whole leg is weak, not only the
  muscles that are spastic. Paresis is a lack of drive and of contractile tissue, so it leaves passive force as it is.
- Contracture: in each muscle group the optimal fiber length is shorter and the passive curve stiffer. MuJoCo's passive
  curve is quadratic up to a strain of (lmax - 1)/2, so pressing its strain by s/.6 multiplies it by (.6/s)^2.
- Activation and deactivation time are the patient's.

Hill muscles that stand for this model's (`mjhcmc.hill_muscles.hill_model`) have its forces, lengths and damping, but
one passive curve for all: contracture then is the shorter fibers only, and paresis weakens passive force too.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from mjhcmc.leg8.builder import assemble
from mjhcmc.leg8.geometry import Scale
from mjhcmc.leg8.muscles import BODIES
from mjhcmc.leg8.table import load_table
from mjhcmc.patients.groups import GROUPS
from mjhcmc.patients.patient import Patient

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel

HEALTHY_STRAIN = 0.6
"""The passive strain at which a muscle has the passive curve of a healthy one."""

HEALTHY_STIFFNESS: Mapping[str, float] = MappingProxyType({"vasti": 0.2})
"""A healthy muscle's passive force over leg8's, by muscle; 1 where it is not named.

With leg8's own the knee resists 110 degrees of flexion with 37 N m at the source's size, of which the vasti give 28.
Measured are 8 N m (Riener, Edrich 1999, doi:10.1016/S0021-9290(99)00009-X, their equation at 20 degrees of hip
flexion). Lai, Arnold and Wakeling (2017, doi:10.1007/s10439-017-1920-7) found the same of a model of the same descent,
36.9 N m, and brought it to 6.3 N m. A fifth leaves 14.5 N m; hip and ankle are within 5 N m of the measured at the
ends of the tests' ranges as they are."""


@functools.cache
def _source_table() -> dict[str, Any]:
    return load_table()  # read once, never changed


def passive_stiffness(patient: Patient, muscle: str) -> float:
    """Passive force of a patient's muscle over that of leg8's, at the same fiber strain and max isometric force.

    h (.6/s)^2 / p with the healthy muscle's stiffness h, the passive strain s of its group and the paresis p, which is
    in the max isometric force already.

    Args:
        patient: the patient.
        muscle: one of leg8's.
    """
    factor = HEALTHY_STIFFNESS.get(muscle, 1.0) / patient.paresis
    for group in patient.groups:
        if muscle in GROUPS[group.name]:
            factor *= (HEALTHY_STRAIN / group.passive_strain) ** 2
    return factor


def leg_table(patient: Patient) -> dict[str, Any]:
    """The parameter table of a patient's leg at the source's size: what `mjhcmc.leg8.builder.assemble` takes.

    Args:
        patient: the patient.
    """
    table = _source_table()
    source = table["source"]
    return {
        **table,
        "source": {
            **source,
            "bodies": _bodies(patient, source),
            "muscles": {name: _muscle(patient, name, own) for name, own in source["muscles"].items()},
        },
    }


def leg_of(patient: Patient, *, look: bool = False) -> MuscleModel:
    """The patient's leg, hanging from a fixed pelvis.

    Args:
        patient: the patient.
        look: with bones and skin, for pictures; they have no mechanics, and without them it is built in half the time.
    """
    return _built(patient, planar=False, look=look)


def gait_leg_of(patient: Patient, *, look: bool = False) -> MuscleModel:
    """The patient's leg on a pelvis that moves in the sagittal plane, with the same muscles.

    Args:
        patient: the patient.
        look: as in `leg_of`.
    """
    return _built(patient, planar=True, look=look)


def _built(patient: Patient, *, planar: bool, look: bool) -> MuscleModel:
    from mjhcmc.model import MuscleModel

    table = leg_table(patient)
    if not look:
        table["appearance"] = {**table["appearance"], "geoms": []}
    source = table["source"]
    scale = Scale(patient.body_mass / source["body_mass"], patient.height / source["height"])
    name = "leg8_gait" if planar else "leg8"
    return MuscleModel.load(assemble(name, table, scale, planar=planar))


def _bodies(patient: Patient, source: Mapping[str, Any]) -> dict[str, Any]:
    """The source's bodies with the patient's masses and inertias, at the source's body mass."""
    fractions = {
        "thigh": patient.thigh_mass_fraction,
        "shank": patient.shank_mass_fraction,
        "foot": patient.foot_mass_fraction,
    }
    bodies = dict(source["bodies"])
    for segment, fraction in fractions.items():
        parts = [part for part, owner in BODIES.items() if owner == segment]
        factor = fraction * source["body_mass"] / sum(bodies[part]["mass"] for part in parts)
        for part in parts:
            own = bodies[part]
            inertia = [value * factor for value in own["inertia"]]
            bodies[part] = {**own, "mass": own["mass"] * factor, "inertia": inertia}
    return bodies


def _muscle(patient: Patient, name: str, own: Mapping[str, Any]) -> dict[str, Any]:
    """A muscle's entry."""
    shortening = sum(group.fiber_shortening for group in patient.groups if name in GROUPS[group.name])
    return {
        **own,
        "max_isometric_force": own["max_isometric_force"] * patient.strength * patient.paresis,
        "optimal_fiber_length": own["optimal_fiber_length"] * (1 - shortening),
        "passive_stiffness": passive_stiffness(patient, name),
        "activation_time": patient.activation_time,
        "deactivation_time": patient.deactivation_time,
    }

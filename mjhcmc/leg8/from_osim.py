"""leg8 for one subject: bodies, joints and muscles from a scaled OpenSim model (.osim)."""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MjhcmcWarning, ModelError, SettingsError
from mjhcmc.io.osim import OsimMuscle, read_osim
from mjhcmc.leg8.agreement import FIT_RANGE_DEG
from mjhcmc.leg8.builder import assemble
from mjhcmc.leg8.geometry import Scale
from mjhcmc.leg8.knee import fit_knee_axis, fit_knee_motion
from mjhcmc.leg8.osim_leg import COORDINATES, SEGMENTS, SIDES, OsimLeg
from mjhcmc.leg8.subject_fit import fit_subject
from mjhcmc.leg8.table import MUSCLES, ROOT_JOINTS, load_table

if TYPE_CHECKING:
    import mujoco

Array = NDArray[np.float64]

BASES = ("planar", "fixed")
"""What the pelvis can do."""

_WELDS = {"subtalar": ("talus", "calcn"), "mtp": ("calcn", "toes")}


def leg8_from_osim(
    path: str | Path, *, side: str = "right", base: str = "planar", moving_knee: bool = False
) -> mujoco.MjSpec:
    """Build one leg of a scaled OpenSim model as leg8.

    Masses, mass centres, inertias, joint centres, ranges, muscle parameters and the muscles' fixed points are the
    subject's. Muscles become MuJoCo's by leg8's mapping and fitted curves (see :mod:`mjhcmc.leg8.muscles`). What leg8
    fits, it fits anew to the subject's own document: the knee hinge, and the wrapping cylinders and points that stand
    for moving and conditional path points at the knee; so musculotendon lengths and moment arms follow the document's.

    Args:
        path: The .osim file: a model with the bodies and muscles of gait10dof18musc, scaled or not.
        side: "right" or "left"; bodies, coordinates and muscles whose OpenSim names end with _r or _l. The model's own
            joint and muscle names have no side.
        base: "planar": the pelvis moves in the sagittal plane, as in :func:`mjhcmc.leg8.build_leg8_gait`; "fixed": it
            is fixed at the world's origin, as in :func:`mjhcmc.leg8.build_leg8`.
        moving_knee: Whether the knee's axis moves as in the document, by slides that follow the knee's angle through
            joint equalities (see :mod:`mjhcmc.leg8.knee`); a fixed hinge otherwise.

    Returns:
        A compiled-ready ``mujoco.MjSpec`` with all that leg8 has: sensors, keyframe ``rest``, OpenSim's names.

    Raises:
        SettingsError: ``side`` or ``base`` is none of the above.
        ModelError: The file is no OpenSim model, lacks bodies, joints or muscles of the leg, or has a leg that leg8
            cannot follow; the message names what is missing.
    """
    if side not in SIDES:
        raise SettingsError(f"leg8: side is {side!r}: give {' or '.join(map(repr, SIDES))}")
    if base not in BASES:
        raise SettingsError(f"leg8: base is {base!r}: give {' or '.join(map(repr, BASES))}")
    leg = OsimLeg(read_osim(path), side)
    wrapped = {muscle: leg.model.muscles[leg.name(muscle)].wraps for muscle in MUSCLES}
    for muscle, wraps in wrapped.items():
        if wraps:
            warnings.warn(
                f"{path}: muscle {leg.name(muscle)} wraps over {', '.join(wraps)}, which leg8 leaves out: its "
                "lengths and moment arms differ from OpenSim's where it touches",
                MjhcmcWarning,
                stacklevel=2,
            )
    name = "leg8_gait" if base == "planar" else "leg8"
    return assemble(name, subject_table(leg, moving_knee=moving_knee), Scale(), planar=base == "planar")


def subject_table(leg: OsimLeg, *, moving_knee: bool = False) -> dict[str, Any]:
    """The parameter table of a subject's leg: leg8's, with all that the document says, and fitted anew.

    Args:
        leg: The leg.
        moving_knee: Whether the knee's axis moves.

    Raises:
        ModelError: Masses, ranges or lengths of the document make no leg.
    """
    table: dict[str, Any] = copy.deepcopy(load_table())
    source, fitted = table["source"], table["fitted"]
    own = load_table()["source"]
    source["credit"] = f"OpenSim model {leg.model.name}"
    source["side"] = SIDES[leg.side]
    source["gravity"] = list(leg.model.gravity)
    source["body_mass"] = leg.model.total_mass
    source["bodies"] = {part: _body(leg, part) for part in SEGMENTS}
    source["joints"] = _joints(leg)
    source["muscles"] = {muscle: _muscle(leg.model.muscles[leg.name(muscle)]) for muscle in MUSCLES}
    scales = _segment_scales(own, source)
    table["appearance"] = _appearance(table["appearance"], scales, mirrored=leg.side == "left")
    low, high = (math.radians(value) for value in source["joints"]["knee"]["range_deg"])
    if moving_knee:
        motion = fit_knee_motion(leg.knee_path, low, high)
        fitted["knee_axis"], fitted["knee_motion"] = list(motion.place), [list(own) for own in motion.coefficients]
    else:
        fitted["knee_axis"] = list(fit_knee_axis(leg.knee_path, *np.radians(FIT_RANGE_DEG[1])))
    return fit_subject(leg, table, scales)


def _body(leg: OsimLeg, part: str) -> dict[str, Any]:
    """A body's mass, mass centre and inertia, in axes that are the pelvis' at zero angles (see `OsimLeg.origin`)."""
    body = leg.model.bodies[leg.body(part)]
    turn, place = leg.rest[part]
    a, b, c, d, e, f = body.inertia
    inertia = turn @ np.array([[a, d, e], [d, b, f], [e, f, c]]) @ turn.T
    com = turn @ np.asarray(body.mass_center) + place - leg.origin(part)
    moments = np.linalg.eigvalsh(inertia)
    if body.mass <= 0 and part not in ("talus", "toes"):
        raise ModelError(f"{leg.model.path}: Body {body.name}: mass is {body.mass:g}: give a mass over zero, in kg")
    if moments[0] < 0 or moments[2] > (moments[0] + moments[1]) * (1 + 1e-6):
        raise ModelError(
            f"{leg.model.path}: Body {body.name}: no rigid body has the principal moments of inertia "
            f"{', '.join(f'{value:g}' for value in moments)}: correct the inertia (kg m^2)"
        )
    return {"mass": body.mass, "com": com.tolist(), "inertia": inertia.tolist()}


def _joints(leg: OsimLeg) -> dict[str, Any]:
    """The table's joints."""
    hip, ankle = leg.center("femur"), leg.center("talus")
    offsets = {"hip": hip, "knee": None, "ankle": ankle - leg.rest["tibia"][1]}
    joints: dict[str, Any] = {"ground_pelvis": _root(leg)}
    for joint, offset in offsets.items():
        coordinate = leg.model.coordinates[leg.name(COORDINATES[joint])]
        limits = [round(math.degrees(value), 3) for value in (coordinate.low, coordinate.high)]
        if not -180 <= limits[0] < limits[1] <= 180:
            raise ModelError(
                f"{leg.model.path}: Coordinate {coordinate.name}: range is {limits[0]:g} to {limits[1]:g} deg: give it "
                "a range within -180 to 180 deg"
            )
        joints[joint] = {"coordinate": coordinate.name, "range_deg": limits}
        if offset is not None:
            joints[joint]["parent_offset"] = offset.tolist()
    joints["knee"]["offset_at_zero"] = leg.knee_path(np.zeros(1))[0].tolist()
    for weld, (above, below) in _WELDS.items():
        joints[weld] = {"parent_offset": (leg.origin(below) - leg.origin(above)).tolist()}
    return joints


def _root(leg: OsimLeg) -> dict[str, Any]:
    """The root: what the document calls the joint, and where its coordinates' defaults put the pelvis in the ground."""
    joint = leg.model.joints.get("pelvis")
    names = {} if joint is None else joint.coordinates
    place = np.asarray((0.0, 0.0, 0.0) if joint is None else joint.parent_pos, float)
    for axis in () if joint is None else joint.axes or ():
        if not axis.is_rotation:
            value = names[axis.coordinate].default if axis.coordinate is not None else 0.0
            place = place + float(axis.function(np.array([value]))[0]) * np.asarray(axis.axis)
    return {
        "name": "ground_pelvis" if joint is None else joint.name,
        "coordinates": list(ROOT_JOINTS),
        "rest": place.tolist(),
    }


def _muscle(muscle: OsimMuscle) -> dict[str, float]:
    """The table's parameters of a muscle."""
    return {
        "max_isometric_force": muscle.max_isometric_force,
        "optimal_fiber_length": muscle.optimal_fiber_length,
        "tendon_slack_length": muscle.tendon_slack_length,
        "pennation_angle": muscle.pennation_angle,
        "activation_time": muscle.activation_time,
        "deactivation_time": muscle.deactivation_time,
        "max_fiber_velocity": muscle.max_contraction_velocity,
        "fiber_damping": muscle.fiber_damping,
    }


def _segment_scales(own: Mapping[str, Any], source: Mapping[str, Any]) -> dict[str, float]:
    """How long the subject's segments are over leg8's; the pelvis by where the hip is."""
    keys = {
        "pelvis": ("hip", "parent_offset"),
        "femur": ("knee", "offset_at_zero"),
        "tibia": ("ankle", "parent_offset"),
        "talus": ("subtalar", "parent_offset"),
        "calcn": ("mtp", "parent_offset"),
    }
    scales = {
        part: float(np.linalg.norm(source["joints"][joint][key]) / np.linalg.norm(own["joints"][joint][key]))
        for part, (joint, key) in keys.items()
    }
    return scales | {"toes": scales["calcn"]}


def _appearance(look: Mapping[str, Any], scales: Mapping[str, float], *, mirrored: bool) -> dict[str, Any]:
    """leg8's shapes at the size of the subject's segments; mirrored for a left leg."""
    result: dict[str, Any] = copy.deepcopy(dict(look))
    flip = np.array([1.0, 1.0, -1.0 if mirrored else 1.0])
    for shape in result["geoms"]:
        scale = scales[shape["body"]]
        shape["size"] = [value * scale for value in shape["size"]]
        if "pos" in shape:
            shape["pos"] = (np.asarray(shape["pos"]) * flip * scale).tolist()
        if "fromto" in shape:
            shape["fromto"] = (np.asarray(shape["fromto"]) * np.tile(flip, 2) * scale).tolist()
    for key in ("pos", "target"):
        result["camera"][key] = (np.asarray(result["camera"][key]) * flip).tolist()
    return result

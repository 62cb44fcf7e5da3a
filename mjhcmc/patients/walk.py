"""A measured walk, taken over by people of other size: the same joint angles, with lengths and forces of their own."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mjhcmc.errors import SettingsError
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.leg8.table import ROOT_JOINTS
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.patients.leg import gait_leg_of
from mjhcmc.patients.patient import Patient, healthy

_PARTS = ("femur", "tibia", "talus", "calcn", "toes")
_NOT_HERE = ("pelvis", "torso", *(f"{part}_{side}" for part in _PARTS for side in "lr"))
"""Bodies of the source's kind of model: loads on those that a leg has not are left out."""


def walks(
    patients: Sequence[Patient],
    legs: Sequence[MuscleModel],
    motion_file: str,
    loads_file: str,
    start: float,
    end: float,
    height: float,
    body_mass: float,
) -> tuple[list[Motion], list[ExternalLoads]]:
    """The walk of one subject as the patients would walk it.

    Angles and times are the subject's; the pelvis' path and the points where forces act go with stature, forces with
    body mass, torques with both.

    Args:
        patients: the patients.
        legs: their legs on a moving pelvis.
        motion_file: the subject's joint angles and pelvis, as `Motion.from_file` reads them.
        loads_file: the ground reaction, an OpenSim external-loads file.
        start: s, of the part that is walked, on the files' clock.
        end: s.
        height: m, of the subject.
        body_mass: kg, of the subject.

    Raises:
        SettingsError: no file of loads.
        MotionError: a file that cannot be read, or loads that do not cover the motion.
    """
    motion, loads = _measured(motion_file, loads_file, start, end, height, body_mass)
    motions, forces = [], []
    for patient in patients:
        long, heavy = patient.height / height, patient.body_mass / body_mass
        qpos = motion.qpos.copy()
        for name in ROOT_JOINTS[:2]:
            qpos[:, legs[0].joint_names.index(name)] *= long
        motions.append(replace(motion, qpos=qpos))
        forces.append(
            replace(loads, force=loads.force * heavy, torque=loads.torque * heavy * long, point=loads.point * long)
        )
    return motions, forces


def digest(
    motion_file: str, loads_file: str, start: float, end: float, height: float, body_mass: float
) -> str:  # fmt: skip
    """First 16 hex digits of the SHA-256 of what the files hold: the same numbers under other names are the same walk.

    Raises:
        MjhcmcError: as `walks`.
    """
    motion, loads = _measured(motion_file, loads_file, start, end, height, body_mass)
    parts = (motion.time, motion.qpos, loads.time, loads.force, loads.torque, loads.point)
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()[:16]


@functools.lru_cache(maxsize=2)
def _measured(
    motion_file: str, loads_file: str, start: float, end: float, height: float, body_mass: float
) -> tuple[Motion, ExternalLoads]:
    if not loads_file:
        raise SettingsError("walk: a walk needs its ground reaction: give walk_loads, an OpenSim external-loads file")
    subject = gait_leg_of(healthy(height, body_mass))
    motion = Motion.from_file(motion_file, subject, start=start, end=end)
    loads = ExternalLoads.from_file(loads_file, subject, osim=_NOT_HERE)
    loads.check_covers(motion)
    return motion, loads

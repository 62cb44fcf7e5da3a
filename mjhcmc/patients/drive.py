"""What a patient's muscles receive without being asked: tone, reflexes, and what spills over to antagonists."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjhcmc.leg8.table import MUSCLES
from mjhcmc.patients.groups import GROUPS
from mjhcmc.patients.patient import SESSION, Patient, stream
from mjhcmc.patients.trials import SESSIONS

Array = NDArray[np.float64]

_OPPOSITES: Mapping[str, tuple[str, ...]] = {
    "iliopsoas": ("glut_max",),
    "glut_max": ("iliopsoas",),
    "rect_fem": ("hamstrings",),
    "vasti": ("hamstrings",),
    "hamstrings": ("rect_fem", "vasti"),
    "gastroc": ("tib_ant",),
    "soleus": ("tib_ant",),
    "tib_ant": ("gastroc", "soleus"),
}

ANTAGONISTS: Array = np.array(
    [[1.0 / len(_OPPOSITES[to]) if by in _OPPOSITES[to] else 0.0 for to in MUSCLES] for by in MUSCLES]
)
"""(8, 8): share of the excitation of the muscle of the row that co-contraction is a fraction of, in the column's."""

_NEVER = 1e6  # threshold of muscles without a reflex

SESSION_SPREAD = 0.2
"""Standard deviation of the logarithm of reflex gain, threshold and tone from one session to another, in one patient.
Reflex torque changes from day to day by some 20 % (chosen here)."""


@dataclass(frozen=True, eq=False)
class Drive:
    """Of one patient in one session, by muscle.

    Attributes:
        mode: the law of the reflex.
        gain: (8,) see `reflex.ReflexLaw`.
        threshold: (8,).
        tone: (8,) excitation at rest.
        delay: s.
        cocontraction: fraction of an excitation that the antagonists receive.
    """

    mode: str
    gain: Array
    threshold: Array
    tone: Array
    delay: float
    cocontraction: float


def drive_of(patient: Patient, session: str = "ideal") -> Drive:
    """What a patient's muscles receive in a session.

    Args:
        patient: the patient.
        session: ``"ideal"``: the patient's own values. In others gains, thresholds and tone are off by factors of that
            session, the same in all its trials, drawn from the patient's seed.
    """
    gain, threshold, tone = np.zeros(len(MUSCLES)), np.full(len(MUSCLES), _NEVER), np.zeros(len(MUSCLES))
    off = np.ones((3, len(GROUPS)))
    if session != "ideal":
        from scipy.special import ndtri

        draws = stream(patient.seed, patient.index, SESSION).random((len(SESSIONS), 4, len(GROUPS)))
        z = ndtri(np.maximum(draws[SESSIONS.index(session)], 1e-12))
        # half of it is the day's, common to all; half each group's and quantity's own
        off = np.exp(SESSION_SPREAD * np.sqrt(0.5) * (z[3, :1] * np.array([[1.0], [-1.0], [1.0]]) + z[:3]))
    for factor, group in zip(off.T, patient.groups, strict=True):
        which = [MUSCLES.index(name) for name in GROUPS[group.name]]
        gain[which] = group.gain * factor[0]
        threshold[which] = group.threshold * factor[1]
        tone[which] = group.tone * factor[2]
    return Drive(patient.reflex, gain, threshold, tone, patient.delay, patient.cocontraction)

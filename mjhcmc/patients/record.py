"""What a simulated trial leaves behind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjhcmc.leg8.table import JOINTS, MUSCLES
from mjhcmc.patients.trials import Trial

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Record:
    """One trial as it happened, sampled at the trial's rate. n samples; joints are hip, knee, ankle; muscles leg8's.

    Attributes:
        trial: what was asked for.
        time: (n,) s, from 0.
        qpos: (n, 3) rad.
        qvel: (n, 3) rad/s.
        qacc: (n, 3) rad/s^2.
        examiner_torque: (n, 3) N m, what the examiner applies at the joints; holding the other joints included.
        inertia: kg m^2, of the limb about the joint under test, the others held; 0 where there is none.
        excitation: (n, 8).
        reflex: (n, 8) the part of the excitation that is reflex.
        activation: (n, 8).
        fiber_length: (n, 8) optimal fiber lengths.
        fiber_velocity: (n, 8) optimal fiber lengths a second, lengthening positive.
        muscle_force: (n, 8) N, along the tendon.
        reserve: N m, of voluntary movements: the largest reserve at any joint; what muscles lack to move as meant.
        failure: why it ended early or is missing; empty where nothing failed.
    """

    trial: Trial
    time: Array
    qpos: Array
    qvel: Array
    qacc: Array
    examiner_torque: Array
    inertia: float
    excitation: Array
    reflex: Array
    activation: Array
    fiber_length: Array
    fiber_velocity: Array
    muscle_force: Array
    reserve: float = 0.0
    failure: str = ""

    @classmethod
    def missing(cls, trial: Trial, failure: str) -> Record:
        """Of a trial that could not be carried out.

        Args:
            trial: what was asked for.
            failure: why.
        """
        joints, muscles = np.empty((0, len(JOINTS))), np.empty((0, len(MUSCLES)))
        return cls(
            trial, np.empty(0), joints, joints, joints, joints, 0.0, muscles, muscles, muscles, muscles, muscles,
            muscles, failure=failure,
        )  # fmt: skip

"""What instruments would have recorded of a trial: angles, angular velocities, the examiner's torque, EMG envelopes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from mjhcmc.leg8.table import JOINTS, MUSCLES
from mjhcmc.patients.patient import SENSORS
from mjhcmc.patients.record import Record

Array = NDArray[np.float64]

ANGLE_NOISE = np.radians(0.5)
"""rad, standard deviation of an angle: half of it in each sample, the rest a trial's offset of the sensor (chosen here;
inertial sensors are within 1 deg at the knee after alignment: Seel, Raisch, Schauer 2014, doi:10.3390/s140406891)."""

GYRO_NOISE = np.radians(1.0)
"""rad/s, standard deviation of an angular velocity in each sample (chosen here)."""

TORQUE_NOISE = 0.02
"""Standard deviation of the torque, as a share of it and of `TORQUE_FLOOR`'s size (chosen here, as of load cells)."""

TORQUE_FLOOR = 5.0
"""N m, that the noise of a torque near zero is a share of."""

EMG_NOISE = 0.2
"""Standard deviation of the logarithm of an envelope: the rectified signal of few motor units (chosen here)."""

EMG_GAIN_SPREAD = 0.3
"""Standard deviation of the logarithm of an electrode's gain, from session to session and muscle to muscle: no maximum
contraction can be asked of a patient with paresis, to divide by (chosen here)."""

EMG_FLOOR = 0.01
"""Envelope of a muscle at rest."""

EMG_MUSCLES = tuple(name for name in MUSCLES if name != "iliopsoas")
"""Muscles that surface electrodes reach."""

_SMOOTHING = 0.03  # s, time constant of an envelope's low-pass filter


@dataclass(frozen=True, eq=False)
class Observation:
    """One trial as instruments saw it. n samples.

    Attributes:
        time: (n,) s.
        qpos: (n, 3) rad, hip, knee, ankle.
        qvel: (n, 3) rad/s.
        torque: (n,) N m, that the examiner applies to the joint under test; 0 where there is no examiner.
        emg: (n, 7) envelopes of `EMG_MUSCLES`, in units of a guessed maximum.
    """

    time: Array
    qpos: Array
    qvel: Array
    torque: Array
    emg: Array


def observe(record: Record, seed: int, index: int, trial: int) -> Observation:
    """Look at a trial through noisy instruments.

    Args:
        record: what happened.
        seed: of the cohort.
        index: of the patient.
        trial: number of the trial in the patient's battery; the noise is its own.
    """
    n = len(record.time)
    uniform = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(index, SENSORS, trial))))
    electrodes = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(index, SENSORS))))

    def normal(*shape: int) -> Array:
        return np.asarray(ndtri(np.clip(uniform.random(shape), 1e-12, 1 - 1e-12)))

    half = np.sqrt(0.5)
    qpos = record.qpos + ANGLE_NOISE * half * (normal(1, len(JOINTS)) + normal(n, len(JOINTS)))
    qvel = record.qvel + GYRO_NOISE * normal(n, len(JOINTS))
    torque = np.zeros(n)
    noise = normal(n)
    if record.trial.examiner:
        true = record.examiner_torque[:, JOINTS.index(record.trial.joint)]
        torque = true + TORQUE_NOISE * np.hypot(true, TORQUE_FLOOR) * noise
    reached = [MUSCLES.index(name) for name in EMG_MUSCLES]
    gain = np.exp(EMG_GAIN_SPREAD * ndtri(np.clip(electrodes.random(len(reached)), 1e-12, 1 - 1e-12)))
    rough = (record.excitation[:, reached] + EMG_FLOOR) * gain * np.exp(EMG_NOISE * normal(n, len(reached)))
    return Observation(record.time, qpos, qvel, torque, _low_pass(rough, record.trial.rate))


def _low_pass(x: Array, rate: float) -> Array:
    """First-order low-pass filter (n, k), begun at the first sample."""
    from scipy.signal import lfilter

    keep = float(np.exp(-1 / (_SMOOTHING * rate)))
    found, _ = lfilter([1 - keep], [1, -keep], x, axis=0, zi=keep * x[:1])
    return np.asarray(found)

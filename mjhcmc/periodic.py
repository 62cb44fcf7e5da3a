"""Movements that repeat: one cycle out of many noisy ones."""

from __future__ import annotations

import math

import numpy as np

from mjhcmc.checks import is_number
from mjhcmc.errors import MotionError, SettingsError
from mjhcmc.motion import Motion

_SAMPLES = 200  # a cycle: the spline through them is the series to 1e-8


def fit_harmonics(motion: Motion, period: float, harmonics: int, cycles: int | None = None) -> Motion:
    """The periodic movement nearest to a measured one, by least squares over all its samples.

        q(t) = c_0 + sum_k c_k cos(2 pi k t/T) + s_k sin(2 pi k t/T),  k = 1 .. harmonics

    With m samples of white noise the amplitudes keep a share of sqrt(2/m) of it, and none of what is faster than the
    last harmonic: accelerations of a rhythmic movement survive where a filter would have to choose.

    Args:
        motion: of hinges and slides, over at least one period; samples of any times.
        period: s, T.
        harmonics: how many, at least 1.
        cycles: that the movement returned lasts; None: as the measured one.

    Raises:
        SettingsError: numbers outside their ranges, or more harmonics than samples tell.
        MotionError: a movement shorter than a period, or with quaternions.
    """
    if not isinstance(motion, Motion):
        raise SettingsError(f"fit_harmonics takes a Motion; got {type(motion).__name__}")
    if not (is_number(period) and 0 < period < math.inf):
        raise SettingsError(f"period must be a positive number of seconds; got {period!r}")
    for name, value in (("harmonics", harmonics), ("cycles", 1 if cycles is None else cycles)):
        if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 1:
            raise SettingsError(f"{name} must be a whole number of at least 1; got {value!r}")
    if motion.quaternions:
        raise MotionError(f"{motion.name}: quaternions have no Fourier series: fit joints that are hinges or slides")
    if motion.duration < period * (1 - 1e-6):
        raise MotionError(
            f"{motion.name} lasts {motion.duration:g} s, less than one period of {period:g} s: measure longer"
        )
    if len(motion.time) < 2 * (2 * harmonics + 1):
        raise SettingsError(
            f"{motion.name} has {len(motion.time)} samples: too few for {harmonics} harmonics; ask for fewer"
        )

    def basis(time: np.ndarray[tuple[int], np.dtype[np.float64]]) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
        phase = 2 * np.pi * np.outer(time - motion.start, np.arange(1, harmonics + 1)) / period
        return np.hstack([np.ones((len(time), 1)), np.cos(phase), np.sin(phase)])

    coefficients = np.linalg.lstsq(basis(motion.time), motion.qpos)[0]
    length = motion.duration if cycles is None else cycles * period
    time = motion.start + np.linspace(0.0, length, max(2, round(length / period * _SAMPLES)) + 1)
    notice = f"{harmonics} harmonics of {period:g} s"
    return Motion(time, basis(time) @ coefficients, motion.name, (*motion.notices, notice), motion.joint_names)

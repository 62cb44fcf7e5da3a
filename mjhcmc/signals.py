"""Signals on even grids: a zero-phase low-pass filter, and how much of a signal lies above a frequency."""

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError

Array = NDArray[np.float64]


def check_cutoff(hz: float) -> None:
    """Raise SettingsError unless hz is a positive number."""
    if not 0 < hz < np.inf:
        raise SettingsError(f"low-pass cutoff {hz} Hz: choose one above 0, such as 6")


def zero_phase_lowpass(values: Array, cutoff: float, step: float) -> Array:
    """Butterworth low-pass of fourth order without phase shift: second order, forward and backward.

    The cutoff of each pass is raised by (sqrt(2) - 1)^(-1/4) = 1/0.802, on the frequencies that the bilinear
    transform warps, so that both passes together have the gain 1/sqrt(2) at the cutoff: Winter, Biomechanics
    and Motor Control of Human Movement (4th ed., 2009), section 3.4.4.2.

    Args:
        values: (n, k), n >= 4, on an even grid.
        cutoff: Hz, above 0 and below half the sampling rate.
        step: s, the grid's.

    Returns:
        (n, k) the filtered values. At the ends the data are continued by their point reflection.
    """
    from scipy.signal import butter, sosfiltfilt

    rate = 1 / step
    corrected = rate / np.pi * np.arctan(np.tan(np.pi * cutoff / rate) * (np.sqrt(2) - 1) ** -0.25)
    sos = butter(2, corrected, fs=rate, output="sos")
    # Two periods of continuation: the filter has forgotten where it started when the data begin.
    padding = min(len(values) - 1, max(9, int(np.ceil(2 * rate / cutoff))))
    filtered: Array = sosfiltfilt(sos, values, axis=0, padlen=padding)
    return filtered


def power_above(values: Array, frequency: float, step: float) -> tuple[Array, Array]:
    """How much of each column's variation lies above a frequency, by its spectrum under a Hann window.

    Args:
        values: (n, k) on an even grid.
        frequency: Hz.
        step: s, the grid's.

    Returns:
        (k) share of the power (0 .. 1; 0 for a constant), and (k) rms above the frequency, in the values'
        units.
    """
    window = np.hanning(len(values) + 1)[:-1, None]
    power = np.abs(np.fft.rfft(window * (values - values.mean(axis=0)), axis=0)) ** 2
    high = power[np.fft.rfftfreq(len(values), step) > frequency].sum(axis=0)
    # Parseval: a real signal's power is twice that of its one-sided spectrum, over n times that of the
    # window.
    rms = np.sqrt(2 * high / (len(values) * np.sum(window**2)))
    return high / np.maximum(power.sum(axis=0), np.finfo(np.float64).tiny), rms

"""EMG, electromyograms: what electrodes over muscles measured, raw or as envelopes.

A raw surface EMG is noise between about 20 and 450 Hz whose size follows the muscle's excitation: slower parts are the
movement of electrodes and cables, faster ones the amplifier's (De Luca 1997, doi 10.1123/jab.13.2.135; De Luca,
Gilmore, Kuznetsov & Roy 2010, doi 10.1016/j.jbiomech.2010.01.027; electrodes: Hermens, Freriks, Disselhorst-Klug & Rau
2000, doi 10.1016/S1050-6411(00)00027-4). Its size over time is the linear envelope,

    envelope = lowpass(|bandpass(signal)|)

(Merletti & Di Torino 1999, Standards for reporting EMG data, J Electromyogr Kinesiol 9(1):III-IV: tell the corners).
In volts it says nothing about how hard a muscle works: electrodes, skin and fat decide. Divided by the envelope of a
maximum voluntary contraction (MVC) it does. Divided by its own peak it keeps its shape and loses its size: every
channel then reaches 1, that of a muscle which hardly works, too.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mjhcmc.checks import is_number
from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError
from mjhcmc.io.columns import listed
from mjhcmc.signals import check_cutoff, power_above, zero_phase_lowpass

Array = NDArray[np.float64]

BAND = (20.0, 450.0)
"""Hz, where a surface EMG has its power."""

LOWPASS_HZ = 6.0
"""Hz, usual corner of linear envelopes of movements such as walking."""

_OF_RATE = 0.45  # highest corner of the band; at half the sampling rate filters end
_LEAST_RATE = 200.0  # Hz: below, what is left of the band is no measure of a surface EMG
_JITTER = 0.5  # of a sample: what times may be off by, as where a file rounds them
_RAW_ABOVE = 20.0  # Hz; an envelope has nothing there
_RAW_SHARE = 0.5  # of the power
_LARGE_OFFSET = 1.0  # times the signal's rms about it
_NEGATIVE = 0.05  # of the peak: what an envelope may undershoot by, as filters do
_FLAT = 1e-9  # of the size


@dataclass(frozen=True, eq=False)
class Emg:
    """Channels over time, raw or as envelopes.

    Attributes:
        time: (T,) s, increasing, on the motion's clock.
        signal: (T, n_channel) in volts or whatever was recorded; NaN where there is none.
        channels: (n_channel,) names.
        name: for messages.
        raw: True for raw signals, False for envelopes; None: told by the values, raw where most of the power lies above
            20 Hz.
        scale: what envelopes are divided by: ``"none"``, ``"mvc"``, ``"peak"`` or ``"percentile 95"``.

    Raises:
        MotionError: shapes, names that stand twice, times that do not increase, a value that is infinite, a channel
            without a value, or an envelope that swings below zero.
    """

    time: Array
    signal: Array = field(repr=False)
    channels: tuple[str, ...]
    name: str = "EMG"
    raw: bool | None = None
    scale: str = "none"

    def __post_init__(self) -> None:
        """Convert, freeze and check."""
        object.__setattr__(self, "channels", tuple(self.channels))
        for key in ("time", "signal"):
            try:
                values = np.array(getattr(self, key), dtype=np.float64)
            except (TypeError, ValueError):
                raise MotionError(f"{self.name}: {key} must hold numbers: give arrays of them") from None
            values.setflags(write=False)
            object.__setattr__(self, key, values)
        n = len(self.channels)
        if self.time.ndim != 1 or len(self.time) < 4 or self.signal.shape != (len(self.time), n) or not n:
            raise MotionError(
                f"{self.name}: time has shape {self.time.shape} and signal {self.signal.shape} with {n} channels: give "
                "time (T,) and signal (T, n_channel), with at least 4 rows and a channel"
            )
        twice = [name for name in self.channels if self.channels.count(name) > 1]
        if twice:
            raise MotionError(f"{self.name}: channel {twice[0]!r} stands twice: name each channel once")
        bad = np.argwhere(np.isinf(self.signal))
        if len(bad):
            raise MotionError(
                f"{self.name}: channel {self.channels[bad[0][1]]!r} is infinite at {self.time[bad[0][0]]:g} s: leave "
                "such values empty (NaN)"
            )
        late = np.flatnonzero(~(np.diff(self.time) > 0))
        if len(late):
            raise MotionError(
                f"{self.name}: row {late[0] + 1} (from 0): time {self.time[late[0] + 1]:.12g} s follows "
                f"{self.time[late[0]]:.12g} s: times must increase"
            )
        empty = np.flatnonzero(np.isnan(self.signal).all(axis=0))
        if len(empty):
            raise MotionError(f"{self.name}: channel {self.channels[empty[0]]!r} holds no value: leave it out")
        if self.raw is None:
            object.__setattr__(self, "raw", self._looks_raw())
        if not self.raw:
            self._check_envelope()

    def _looks_raw(self) -> bool:
        step = self.duration / (len(self.time) - 1)
        if 0.5 / step <= _RAW_ABOVE:
            return False
        filled = np.column_stack([_bridged(self.time, column) for column in self.signal.T])
        return bool(np.median(power_above(filled, _RAW_ABOVE, step)[0]) > _RAW_SHARE)

    def _check_envelope(self) -> None:
        low, high = np.nanmin(self.signal, axis=0), np.nanmax(self.signal, axis=0)
        bad = np.flatnonzero(low < -_NEGATIVE * np.maximum(high, 0.0) - np.finfo(float).tiny)
        if len(bad):
            i = bad[0]
            raise MotionError(
                f"{self.name}: channel {self.channels[i]!r} goes down to {low[i]:.3g} at a peak of {high[i]:.3g}, as "
                "no envelope does: mark it as raw (raw=True, --raw), or take its offset away"
            )

    @classmethod
    def from_file(
        cls, path: str | os.PathLike[str], channels: Sequence[str] | None = None, raw: bool | None = None
    ) -> Emg:
        """Read a table with a column ``time`` (s) and a column for each channel: .csv, .sto, .mot or .parquet.

        Args:
            path: the file.
            channels: which columns; all but time by default.
            raw: see `Emg`.

        Raises:
            MotionError: the file, a column or a row does not allow it; one line says what and what to do.
        """
        from mjhcmc.io.emg_file import read_emg

        return read_emg(Path(path), channels, raw)

    @property
    def duration(self) -> float:
        """From the first sample to the last, s."""
        return float(self.time[-1] - self.time[0])

    @property
    def rate(self) -> float:
        """Samples a second, Hz, on average."""
        return (len(self.time) - 1) / self.duration

    def channel(self, name: str) -> Array:
        """(T,) the signal of one channel.

        Raises:
            SettingsError: no such channel; the message lists those that are there.
        """
        if name not in self.channels:
            raise SettingsError(f"{self.name} has no channel {name!r}: its channels are {listed(self.channels)}")
        return np.asarray(self.signal[:, self.channels.index(name)])

    def only(self, channels: Sequence[str]) -> Emg:
        """Some of the channels.

        Raises:
            SettingsError: no such channel.
        """
        return replace(self, signal=np.column_stack([self.channel(n) for n in channels]), channels=tuple(channels))

    def cropped(self, start: float, end: float) -> Emg:
        """The part between two times, s.

        Raises:
            SettingsError: fewer than 4 samples lie between them.
        """
        kept = (self.time >= start) & (self.time <= end)
        if kept.sum() < 4:
            raise SettingsError(
                f"{self.name} covers {self.time[0]:.3f} .. {self.time[-1]:.3f} s: between {start:g} and {end:g} s "
                f"there are {kept.sum()} samples: choose a start and end within it"
            )
        return replace(self, time=self.time[kept], signal=self.signal[kept])

    def shifted(self, seconds: float) -> Emg:
        """The same, that much later: onto the motion's clock where the recorders were not started together."""
        return replace(self, time=self.time + seconds)

    def envelope(self, band: tuple[float, float] | None = None, lowpass_hz: float = LOWPASS_HZ) -> Emg:
        """The linear envelopes of raw signals.

        The offset is taken away, a Butterworth band-pass filter keeps what is EMG (second order at each corner, applied
        forward and backward: no phase shift, -6 dB at the corners), its absolute value is taken and smoothed by a
        Butterworth low-pass filter without phase shift (`signals.zero_phase_lowpass`; -3 dB at the corner). Where
        samples are missing, the low-pass weighs what is there: envelopes beside a gap do not sag; in it they are NaN.
        What the filter undershoots zero by is clipped.

        For Gaussian noise of standard deviation s the envelope is on average sqrt(2/pi) s.

        Args:
            band: Hz, corners of the band-pass; by default `BAND`, with an upper corner of at most .45 times the
                sampling rate.
            lowpass_hz: Hz, corner of the low-pass.

        Raises:
            SettingsError: envelopes already; corners that cross, or that the sampling rate does not carry.
            MotionError: samples unevenly apart, sampling too slow for raw EMG, or a channel that is constant.
        """
        from scipy.signal import butter, sosfiltfilt

        if not self.raw:
            raise SettingsError(f"{self.name} holds envelopes already: mark it as raw (raw=True, --raw) if it does not")
        check_cutoff(lowpass_hz)
        time, signal = self._even()
        rate = (len(time) - 1) / (time[-1] - time[0])
        low, high = self._corners(band, rate, lowpass_hz)
        there = np.isfinite(signal)
        held = np.where(there, signal, 0.0)
        count = there.sum(axis=0)
        mean = held.sum(axis=0) / count
        centred = np.where(there, signal - mean, 0.0)
        rms = np.sqrt((centred**2).sum(axis=0) / count)
        self._tell(mean, rms, there, time)
        sos = np.vstack([butter(2, low, "highpass", fs=rate, output="sos"), butter(2, high, fs=rate, output="sos")])
        padding = min(len(time) - 1, int(2 * rate / low))
        rectified = np.where(there, np.abs(sosfiltfilt(sos, centred, axis=0, padlen=padding)), 0.0)
        smooth = zero_phase_lowpass(rectified, lowpass_hz, 1 / rate)
        if not there.all():
            weight = zero_phase_lowpass(there.astype(np.float64), lowpass_hz, 1 / rate)
            smooth = np.where(there, smooth / np.where(there, np.maximum(weight, 0.1), 1.0), np.nan)
        return replace(self, time=time, signal=np.maximum(smooth, 0.0), raw=False, scale="none")

    def _corners(self, band: tuple[float, float] | None, rate: float, lowpass_hz: float) -> tuple[float, float]:
        if rate < _LEAST_RATE:
            raise MotionError(
                f"{self.name}: {rate:.4g} samples a second are too few for raw EMG, whose power lies between "
                f"{BAND[0]:g} and {BAND[1]:g} Hz: give the recording at its own rate, or envelopes (raw=False, "
                "--envelope)"
            )
        if band is None:
            if rate < 2 * BAND[1]:
                warnings.warn(
                    f"{self.name}: {rate:.4g} samples a second are fewer than twice {BAND[1]:g} Hz: what the muscle "
                    f"did above {rate / 2:.4g} Hz is lost or folded below; the band ends at {_OF_RATE * rate:.4g} Hz",
                    MjhcmcWarning,
                    stacklevel=4,
                )
            band = BAND[0], min(BAND[1], _OF_RATE * rate)
        try:
            low, high = (float(corner) for corner in band)
        except (TypeError, ValueError):
            raise SettingsError(f"band must be two corners in Hz, such as {BAND}; got {band!r}") from None
        if not 0 < low < high < np.inf:
            raise SettingsError(f"band {low:g} .. {high:g} Hz: give a lower corner above 0 and an upper one above that")
        if high >= rate / 2:
            raise SettingsError(
                f"{self.name}: the band ends at {high:g} Hz, sampling at {rate:.4g} Hz carries less than "
                f"{rate / 2:.4g}: choose an upper corner of at most {_OF_RATE * rate:.4g} Hz"
            )
        if lowpass_hz >= low:
            raise SettingsError(
                f"low-pass cutoff {lowpass_hz:g} Hz is not below the band {low:g} .. {high:g} Hz: choose a lower one, "
                f"such as {LOWPASS_HZ:g}"
            )
        return low, high

    def _even(self) -> tuple[Array, Array]:
        """Times exactly evenly apart, and the signal there; missing rows as NaN."""
        time, n = self.time, len(self.time)
        steps = np.diff(time)
        usual = steps[steps < 1.5 * np.median(steps)]  # where times are rounded, the median is no mean
        step = float(usual.mean())
        jumps = np.maximum(1, np.round(steps / step)).astype(np.int64)
        if (jumps > 1).any():  # rows are missing: on the grid they are NaN
            off = np.abs(steps / step - jumps)
            at = np.concatenate([[0], np.cumsum(jumps)])
        else:
            off, at = np.zeros(1), np.arange(n)
        slope = np.polyfit(at - at[0], time - time[0], 1)
        line = np.polyval(slope, at) + time[0]
        beyond = np.abs(line - time) / slope[0]
        if beyond.max() > _JITTER or off.max() > _JITTER:
            row = int(np.argmax(beyond))
            raise MotionError(
                f"{self.name}: samples are not evenly apart (row {row} from 0, at {time[row]:.6g} s, is off by "
                f"{beyond[row]:.2g} of a sample): give the recording at its own rate, or envelopes (raw=False, "
                "--envelope)"
            )
        grid = time[0] + np.polyval(slope, np.arange(at[-1] + 1))
        signal = np.full((len(grid), len(self.channels)), np.nan)
        signal[at] = self.signal
        return grid, signal

    def _tell(self, mean: Array, rms: Array, there: NDArray[np.bool_], time: Array) -> None:
        """Refuse a dead channel; notices of offsets and gaps."""
        size = np.maximum(np.abs(mean), np.finfo(float).tiny)
        dead = np.flatnonzero(rms <= _FLAT * size)
        if len(dead):
            raise MotionError(
                f"{self.name}: channel {self.channels[dead[0]]!r} is constant ({mean[dead[0]]:.3g}): a loose electrode "
                "or an unplugged channel: leave it out"
            )
        large = [name for name, m, s in zip(self.channels, mean, rms, strict=True) if abs(m) > _LARGE_OFFSET * s]
        if large:
            i = self.channels.index(large[0])
            warnings.warn(
                f"{self.name}: channel{'s' * (len(large) > 1)} {listed(large)} with an offset that is larger than the "
                f"signal ({large[0]}: {mean[i]:.3g}, rms about it {rms[i]:.3g}): it is taken away",
                MjhcmcWarning,
                stacklevel=4,
            )
        gaps = np.flatnonzero(~there.all(axis=0))
        if len(gaps):
            i = gaps[0]
            first = time[int(np.argmin(there[:, i]))]
            warnings.warn(
                f"{self.name}: channel{'s' * (len(gaps) > 1)} {listed([self.channels[j] for j in gaps])} with gaps "
                f"({self.channels[i]}: {(~there[:, i]).sum()} of {len(time)} samples, first at {first:.4g} s): there "
                "is no envelope there",
                MjhcmcWarning,
                stacklevel=4,
            )

    def normalised(self, mvc: Mapping[str, float] | float | None = None, percentile: float = 100.0) -> Emg:
        """Envelopes over a reference: what was measured in a maximum voluntary contraction, or in this trial.

        Only the first tells how hard a muscle works, as a model's excitation does. The second makes every channel reach
        1: shapes can be compared, sizes not, and as a target it would ask for full excitation.

        Args:
            mvc: by channel, the largest envelope in a maximum contraction, in the signal's units and from the same
                filters; or one number for all.
            percentile: without mvc: of each channel's own values, above 0; 100 is its peak.

        Raises:
            SettingsError: raw signals; unknown, missing or non-positive values; a channel that is zero throughout.
        """
        if self.raw:
            raise SettingsError(f"{self.name} is raw: take its envelope first")
        if not (is_number(percentile) and 0 < percentile <= 100):
            raise SettingsError(f"percentile must be above 0 and at most 100; got {percentile!r}")
        if mvc is None:
            values = np.nanpercentile(self.signal, percentile, axis=0)
            flat = np.flatnonzero(~(values > 0))
            if len(flat):
                raise SettingsError(
                    f"{self.name}: channel {self.channels[flat[0]]!r} has no {percentile:g}th percentile above zero: "
                    "leave it out, or give its value of a maximum contraction"
                )
            scale = "peak" if percentile == 100 else f"percentile {percentile:g}"
            return replace(self, signal=self.signal / values, scale=scale)
        if isinstance(mvc, Mapping):
            unknown = [name for name in mvc if name not in self.channels]
            missing = [name for name in self.channels if name not in mvc]
            if unknown or missing:
                what = f"names {listed(unknown)}, which it has not" if unknown else f"lacks {listed(missing)}"
                raise SettingsError(
                    f"mvc {what}: {self.name} has the channels {listed(self.channels)}: give each a value"
                )
            given = [mvc[name] for name in self.channels]
        else:
            given = [mvc] * len(self.channels)
        for name, value in zip(self.channels, given, strict=True):
            if not (is_number(value) and 0 < value < np.inf):
                raise SettingsError(f"mvc of {name} must be a positive number; got {value!r}")
        beyond = np.nanmax(self.signal, axis=0) / np.array(given, dtype=np.float64)
        if (beyond > 1).any():
            i = int(np.argmax(beyond))
            warnings.warn(
                f"{self.name}: channel {self.channels[i]!r} rises to {beyond[i]:.3g} of its maximum contraction: the "
                "MVC was no maximum, or comes from other filters",
                MjhcmcWarning,
                stacklevel=2,
            )
        return replace(self, signal=self.signal / np.array(given, dtype=np.float64), scale="mvc")

    def at(self, times: Array) -> Array:
        """(n, n_channel) envelopes at times (n,) s, linear between samples; NaN outside and beside gaps.

        Raises:
            SettingsError: raw signals, which cannot be interpolated.
        """
        if self.raw:
            raise SettingsError(f"{self.name} is raw: take its envelope first")
        columns = [np.interp(times, self.time, column, np.nan, np.nan) for column in self.signal.T]
        return np.column_stack(columns)


def _bridged(time: Array, column: Array) -> Array:
    """The column with its gaps bridged by lines."""
    there = np.isfinite(column)
    return column if there.all() else np.interp(time, time[there], column[there])

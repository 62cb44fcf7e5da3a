"""Bursts: where a reflex begins, how large it is, and how well another signal tells it.

A burst is there where a signal stays above a threshold for long enough (a threshold in size and one in duration:
Bonato, D'Alessio, Knaflitz 1998, doi:10.1109/10.661154). Its begin and end are where it passes a share of its own peak:
so they do not move with the signal's size, which an inference knows only as well as it knows the muscle's strength.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import MotionError, SettingsError

Array = NDArray[np.float64]

THRESHOLD = 0.05
"""Excitation that a burst exceeds."""

SHORTEST = 0.02
"""s, that it does so at least."""

EDGE = 0.25
"""Share of its peak at which a burst begins and ends."""

MOST_LAG = 0.1
"""s, to either side, that signals are shifted for their best correlation."""

_LAG_STEP = 0.005  # s
_FLAT = 1e-3  # of excitation, standard deviation: a signal that moves less correlates with nothing

OUTCOMES = ("hit", "miss", "false alarm", "elsewhere", "none")
"""Burst there and found; there and not found; found where there is none; both, but not at one time; neither."""


@dataclass(frozen=True)
class Burst:
    """A burst of excitation.

    Attributes:
        onset: s, where it rises through `EDGE` of its peak.
        peak_time: s.
        end: s, where it falls through `EDGE` of its peak, or the signal ends.
        peak: excitation.
        area: s, excitation from onset to end, integrated.
    """

    onset: float
    peak_time: float
    end: float
    peak: float
    area: float


def find_burst(
    time: ArrayLike, signal: ArrayLike, *, threshold: float = THRESHOLD, shortest: float = SHORTEST
) -> Burst | None:
    """The largest burst of a signal; None where there is none.

    Args:
        time: (n,) s, evenly spaced.
        signal: (n,) excitation beside its baseline.
        threshold: that it exceeds; of runs above it, the one of the largest area counts.
        shortest: s, that it does so at least.

    Raises:
        MotionError: shapes, fewer than 2 samples, or a value that is not finite.
        SettingsError: a threshold or duration that is not positive.
    """
    t, x = _pair(time, signal)
    for name, value in (("threshold", threshold), ("shortest", shortest)):
        if not (math.isfinite(value) and value > 0):
            raise SettingsError(f"{name} of a burst is {value}: give a positive number")
    step = float(t[1] - t[0])
    above = np.concatenate([[False], x > threshold, [False]])
    edges = np.flatnonzero(np.diff(above.astype(np.int8)))
    runs = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if (b - a) * step >= shortest - 1e-9]
    if not runs:
        return None
    a, b = max(runs, key=lambda run: float(x[run[0] : run[1]].sum()))
    k = a + int(np.argmax(x[a:b]))
    edge = EDGE * x[k]
    before, after = np.flatnonzero(x[:k] < edge), k + np.flatnonzero(x[k:] < edge)
    onset = _crossing(t, x, int(before[-1]), edge) if len(before) else float(t[0])
    end = _crossing(t, x, int(after[0]) - 1, edge) if len(after) else float(t[-1])
    fine = np.unique(np.concatenate([[onset, end], t[(t > onset) & (t < end)]]))
    area = float(np.trapezoid(np.interp(fine, t, x), fine))
    return Burst(onset, float(t[k]), end, float(x[k]), area)


def _crossing(t: Array, x: Array, k: int, level: float) -> float:
    """Where the straight line from sample k to the next passes a level."""
    return float(t[k] + (level - x[k]) / (x[k + 1] - x[k]) * (t[k + 1] - t[k]))


@dataclass(frozen=True)
class BurstScore:
    """How well a reflex was recovered. Errors and ratios are NaN unless it is a hit.

    Attributes:
        name: of the muscle or group.
        true: the burst that there is.
        found: the one recovered.
        correlation: the best of true and recovered, over shifts within `MOST_LAG`; NaN where one of them is flat.
        lag: s, at which it is; positive: the recovered comes later.
    """

    name: str
    true: Burst | None
    found: Burst | None
    correlation: float
    lag: float

    @property
    def outcome(self) -> str:
        """One of `OUTCOMES`."""
        if self.true is None or self.found is None:
            return "none" if self.true is self.found else "false alarm" if self.true is None else "miss"
        together = self.found.onset <= self.true.end and self.found.end >= self.true.onset
        return "hit" if together else "elsewhere"

    @property
    def onset_error(self) -> float:
        """s; positive: recovered too late."""
        return self._of_hit(lambda true, found: found.onset - true.onset)

    @property
    def peak_time_error(self) -> float:
        """s; positive: recovered too late."""
        return self._of_hit(lambda true, found: found.peak_time - true.peak_time)

    @property
    def peak_ratio(self) -> float:
        """Recovered over true peak."""
        return self._of_hit(lambda true, found: found.peak / true.peak)

    @property
    def area_ratio(self) -> float:
        """Recovered over true area."""
        return self._of_hit(lambda true, found: found.area / true.area)

    def _of_hit(self, value: Callable[[Burst, Burst], float]) -> float:
        if self.outcome != "hit" or self.true is None or self.found is None:
            return math.nan
        return value(self.true, self.found)


class Quartiles(NamedTuple):
    """The middle half of some numbers; NaN where there are none.

    Attributes:
        low: lower quartile.
        median: median.
        high: upper quartile.
        n: how many numbers.
    """

    low: float
    median: float
    high: float
    n: int


def quartiles(values: Sequence[float]) -> Quartiles:
    """Quartiles of the numbers that are not NaN, interpolated."""
    there = np.array([value for value in values if not math.isnan(value)])
    if not len(there):
        return Quartiles(math.nan, math.nan, math.nan, 0)
    low, median, high = np.quantile(there, (0.25, 0.5, 0.75))
    return Quartiles(float(low), float(median), float(high), len(there))


def score_burst(
    name: str,
    time: ArrayLike,
    true: ArrayLike,
    found: ArrayLike,
    *,
    threshold: float = THRESHOLD,
    shortest: float = SHORTEST,
) -> BurstScore:
    """Compare a recovered signal with the reflex that there was.

    Args:
        name: of the muscle or group.
        time: (n,) s, evenly spaced.
        true: (n,) the reflex.
        found: (n,) recovered excitation beside its baseline.
        threshold: see `find_burst`; the same for both.
        shortest: s, see `find_burst`.

    Raises:
        MotionError: shapes, or a value that is not finite.
        SettingsError: see `find_burst`.
    """
    t, x = _pair(time, true)
    _, y = _pair(time, found)
    bursts = (find_burst(t, signal, threshold=threshold, shortest=shortest) for signal in (x, y))
    return BurstScore(name, *bursts, *_best_correlation(t, x, y))


def _best_correlation(t: Array, x: Array, y: Array) -> tuple[float, float]:
    """The largest of x(t) and y(t + lag), over the time that all lags leave; and the lag."""
    inner = t[(t >= t[0] + MOST_LAG) & (t <= t[-1] - MOST_LAG)]
    if len(inner) < 3:
        return math.nan, math.nan
    n = round(MOST_LAG / _LAG_STEP)
    lags = sorted(_LAG_STEP * np.arange(-n, n + 1), key=abs)  # of equal ones, the least lag
    at, best, lag = np.interp(inner, t, x), math.nan, math.nan
    for shift in lags:
        moved = np.interp(inner + shift, t, y)
        if min(at.std(), moved.std()) < _FLAT:
            continue
        r = float(np.corrcoef(at, moved)[0, 1])
        if not r <= best:
            best, lag = r, float(shift)
    return best, lag


def _pair(time: ArrayLike, signal: ArrayLike) -> tuple[Array, Array]:
    t, x = np.asarray(time, dtype=np.float64), np.asarray(signal, dtype=np.float64)
    if t.ndim != 1 or t.shape != x.shape or len(t) < 2:
        raise MotionError(f"time has shape {t.shape} and the signal {x.shape}: give (n,) both, of 2 samples or more")
    bad = np.flatnonzero(~(np.isfinite(t) & np.isfinite(x)))
    if len(bad):
        raise MotionError(f"sample {bad[0]} (from 0) of the signal is not finite: give finite values")
    return t, x

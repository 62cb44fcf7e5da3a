"""Bursts: when a reflex begins, how large it is, and how well another signal tells it.

A burst is there where a signal stays above a threshold for long enough (a threshold in size and one in duration:
Bonato, D'Alessio, Knaflitz 1998, doi:10.1109/10.661154). What counts is the first, the catch that an examiner feels; in
clonus others follow, and larger ones. Its onset is where it passes a share of its own peak, so that it does not move
with the signal's size, which an inference knows only as well as it knows the muscle's strength.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.checks import is_number
from mjhcmc.errors import MotionError, SettingsError

Array = NDArray[np.float64]

THRESHOLD = 0.05
"""Excitation that a burst exceeds."""

SHORTEST = 0.02
"""s, that it does so at least."""

CATCH = 0.2
"""s, from passing the threshold, in which the peak of the first burst is looked for."""

EDGE = 0.25
"""Share of its peak at which a burst begins."""

TOGETHER = 0.15
"""s, that onsets may be apart for bursts to be the same."""

MOST_LAG = 0.1
"""s, to either side, that signals are shifted for their best correlation."""

_LAG_STEP = 0.005  # s
_FLAT = 1e-3  # of excitation, standard deviation: a signal that moves less correlates with nothing

OUTCOMES = ("hit", "miss", "false alarm", "elsewhere", "none")
"""Burst there and found; there and not found; found where there is none; both, but not together; neither."""


@dataclass(frozen=True)
class Burst:
    """The first burst of a signal.

    Attributes:
        onset: s, where it rises through `EDGE` of its peak.
        peak_time: s.
        peak: excitation, the largest within `CATCH`.
        area: s, excitation above 0 from the onset to the signal's end, integrated: with all that follows.
    """

    onset: float
    peak_time: float
    peak: float
    area: float


def find_burst(
    time: ArrayLike, signal: ArrayLike, *, threshold: float = THRESHOLD, shortest: float = SHORTEST
) -> Burst | None:
    """The first burst of a signal; None where there is none.

    Args:
        time: (n,) s, evenly spaced.
        signal: (n,) excitation beside its baseline.
        threshold: that it exceeds.
        shortest: s, that it does so at least; each sample counts for a step.

    Raises:
        MotionError: shapes, fewer than 2 samples, or a value that is not finite.
        SettingsError: a threshold or duration that is not positive.
    """
    t, x = _pair(time, signal)
    for name, value in (("threshold", threshold), ("shortest", shortest)):
        if not (is_number(value) and 0 < value < np.inf):
            raise SettingsError(f"{name} of a burst is {value!r}: give a positive number")
    step = float(t[-1] - t[0]) / (len(t) - 1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], x > threshold, [False]]).astype(np.int8)))
    starts = [int(a) for a, b in zip(edges[::2], edges[1::2], strict=True) if (b - a) * step >= shortest - 1e-9]
    if not starts:
        return None
    first = starts[0]
    within = x[first : first + round(CATCH / step) + 1]
    k = first + int(np.argmax(within))
    edge = EDGE * float(x[k])
    before = np.flatnonzero(x[:k] < edge)
    onset = float(t[0])
    if len(before):
        below = int(before[-1])
        onset += float(t[below] - t[0] + (edge - x[below]) / (x[below + 1] - x[below]) * (t[below + 1] - t[below]))
    fine = np.concatenate([[onset], t[t > onset]])
    area = float(np.trapezoid(np.interp(fine, t, np.maximum(x, 0.0)), fine))
    return Burst(onset, float(t[k]), float(x[k]), area)


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
        return "hit" if abs(self.found.onset - self.true.onset) <= TOGETHER else "elsewhere"

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
    threshold: float = THRESHOLD,
    found_threshold: float | None = None,
    shortest: float = SHORTEST,
) -> BurstScore:
    """Compare a recovered signal with the reflex that there was.

    Args:
        name: of the muscle or group.
        time: (n,) s, evenly spaced.
        true: (n,) the reflex.
        found: (n,) recovered excitation beside its baseline.
        threshold: of the true burst, see `find_burst`.
        found_threshold: of the recovered one; None: the same.
        shortest: s, see `find_burst`.

    Raises:
        MotionError: shapes, or a value that is not finite.
        SettingsError: see `find_burst`.
    """
    t, x = _pair(time, true)
    _, y = _pair(time, found)
    there = find_burst(t, x, threshold=threshold, shortest=shortest)
    lower = threshold if found_threshold is None else found_threshold
    recovered = find_burst(t, y, threshold=lower, shortest=shortest)
    return BurstScore(name, there, recovered, *_best_correlation(t, x, y))


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

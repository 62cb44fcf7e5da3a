"""How well grades agree: weighted kappa, macro-F1, error in ranks; intervals by resampling patients.

Each score is taken for each joint and averaged over the joints: pooled over joints, a guess that only knows which
joint is graded would agree beyond chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import SettingsError

Array = NDArray[np.float64]
Ranks = NDArray[np.int64]

N_GRADE = 6
"""Grades of the modified Ashworth scale: 0, 1, 1+, 2, 3, 4 as ranks 0..5."""

MISSING = -1
"""The rank of a grade that there is not."""

_CHUNK = 20_000_000  # weights of resamples held at once


@dataclass(frozen=True)
class Interval:
    """A score with the limits of its confidence interval."""

    value: float
    low: float
    high: float

    def words(self, digits: int = 2) -> str:
        """As ``0.61 [0.52, 0.69]``; no minus before a 0."""
        value, low, high = (f"{round(x, digits) + 0.0:.{digits}f}" for x in (self.value, self.low, self.high))
        return f"{value} [{low}, {high}]"

    def numbers(self) -> dict[str, float]:
        """For JSON."""
        return {"value": self.value, "low": self.low, "high": self.high}


@dataclass(frozen=True)
class Scores:
    """Agreement of two readings of the same patients, averaged over joints.

    Attributes:
        kappa: Cohen's kappa with quadratic weights.
        macro_f1: mean F1 of the grades that occur in either reading.
        mae: mean distance in ranks.
        within_one: share that is at most one rank off.
        by_joint: kappa of each column.
        count: (patient, joint) pairs.
    """

    kappa: Interval
    macro_f1: Interval
    mae: Interval
    within_one: Interval
    by_joint: tuple[float, ...]
    count: int


def quadratic_kappa(a: ArrayLike, b: ArrayLike) -> float:
    """Cohen's kappa with quadratic weights (Cohen 1968, doi:10.1037/h0026256); 0 where no disagreement is possible.

    In ranks it is 1 - mean (a - b)^2 / (var a + var b + (mean a - mean b)^2), variances over n.

    Args:
        a: (n,) ranks.
        b: (n,) ranks.

    Raises:
        SettingsError: nothing to compare, lengths that differ.
    """
    first, second = _pair(np.reshape(a, (-1, 1)), np.reshape(b, (-1, 1)))
    return float(_values(_sums(first, second).sum(axis=0)[None])[0, 0, 0])


def evaluate(
    truth: ArrayLike, predicted: ArrayLike, *, resamples: int = 1000, level: float = 0.95, seed: int = 0
) -> Scores:
    """Scores with intervals by bootstrap over patients: all joints of a patient are drawn together.

    Percentile intervals (Efron, Tibshirani 1993).

    Args:
        truth: (n_patient, n_joint) ranks, `MISSING` where there is none.
        predicted: likewise.
        resamples: how many times the patients are drawn.
        level: of the intervals.
        seed: of the draws.

    Raises:
        SettingsError: shapes that differ, ranks that are none, a joint without a pair.
    """
    first, second = _pair(truth, predicted)
    if resamples < 1 or not 0 < level < 1:
        raise SettingsError(f"intervals need resamples of 1 or more and a level in 0..1; got {resamples} and {level}")
    sums = _sums(first, second)
    n, flat = len(sums), sums.reshape(len(sums), -1)
    whole = _values(sums.sum(axis=0)[None])[0]
    if not np.isfinite(whole).all():
        raise SettingsError("a joint has no pair of grades to compare: leave that joint out")
    rng = np.random.default_rng(seed)
    drawn: list[Array] = []
    for start in range(0, resamples, max(1, _CHUNK // n)):
        count = min(max(1, _CHUNK // n), resamples - start)
        weights = np.stack([np.bincount(rng.integers(0, n, n), minlength=n) for _ in range(count)]).astype(np.float64)
        drawn.append(np.nanmean(_values((weights @ flat).reshape(count, *sums.shape[1:])), axis=1))
    tail = 100 * (1 - level) / 2
    low, high = np.nanpercentile(np.concatenate(drawn), [tail, 100 - tail], axis=0)
    mean = whole.mean(axis=0)
    kappa, f1, mae, near = (Interval(float(m), float(a), float(b)) for m, a, b in zip(mean, low, high, strict=True))
    return Scores(kappa, f1, mae, near, tuple(whole[:, 0].tolist()), int(sums[..., 0].sum()))


def confusion(truth: ArrayLike, predicted: ArrayLike) -> Ranks:
    """Counts (N_GRADE, N_GRADE), rows the truth, over all joints; pairs with a missing grade left out."""
    first, second = _pair(truth, predicted)
    there = (first >= 0) & (second >= 0)
    cells = first[there] * N_GRADE + second[there]
    return np.bincount(cells, minlength=N_GRADE**2).reshape(N_GRADE, N_GRADE)


def _pair(a: ArrayLike, b: ArrayLike) -> tuple[Ranks, Ranks]:
    first, second = np.asarray(a, dtype=np.int64), np.asarray(b, dtype=np.int64)
    if first.shape != second.shape or first.ndim != 2 or not first.size:
        raise SettingsError(f"grades to compare must be (patients, joints) alike; got {first.shape} and {second.shape}")
    for ranks in (first, second):
        if ranks.min() < MISSING or ranks.max() >= N_GRADE:
            raise SettingsError(f"ranks are 0 to {N_GRADE - 1}; got {ranks.min()} to {ranks.max()}")
    return first, second


def _sums(a: Ranks, b: Ranks) -> Array:
    """What the scores need, summable over patients: (n_patient, n_joint, 8 + 3 N_GRADE)."""
    there = ((a >= 0) & (b >= 0)).astype(np.float64)
    off = np.abs(a - b)
    parts = [np.ones_like(a), a, b, a * a, b * b, off * off, off, off <= 1]
    parts += [(a == k) & (b == k) for k in range(N_GRADE)]
    parts += [a == k for k in range(N_GRADE)] + [b == k for k in range(N_GRADE)]
    return np.stack([part * there for part in parts], axis=-1)


def _values(sums: Array) -> Array:
    """Kappa, macro-F1, MAE, within one: (m, n_joint, 4) from sums (m, n_joint, ...); nan where there is no pair."""
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = sums[..., 1:8] / sums[..., :1]
        a, b, aa, bb, square, off, near = np.moveaxis(mean, -1, 0)
        chance = aa + bb - 2 * a * b  # mean square difference of independent readings with these margins
        kappa = np.where(chance > 1e-12, 1 - square / chance, np.where(np.isfinite(chance), 0.0, np.nan))
        hit, of_a, of_b = (sums[..., 8 + k * N_GRADE : 8 + (k + 1) * N_GRADE] for k in range(3))
        either = (of_a + of_b) > 0
        f1 = np.where(either, 2 * hit / (of_a + of_b), 0.0).sum(axis=-1) / either.sum(axis=-1)
    return np.stack([kappa, f1, off, near], axis=-1)

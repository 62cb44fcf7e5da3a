"""Gain and threshold of the stretch reflex, read back from excitation and fiber velocity.

Excitation may be noisy, fiber velocity is taken as it is. What the laws are is told in `patients.reflex`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.checks import is_number
from mjhcmc.errors import SettingsError
from mjhcmc.patients.reflex import LONGEST_DELAY, delayed, finite

MODES = ("equation1", "velocity")
CONFIDENCE = 0.95

_LEAST = 4  # samples, of which two tell how noisy the others are
_CONSTANT = 1e-9  # of excitation: what varies less is constant
_NEARLY_CONSTANT = 0.02  # spread of velocity over its mean
_CHANCE = 10.8  # noise's squares: what one parameter more explains by chance once in a thousand times (chi squared)
_ROUNDING = 1e-12
_AT_ONCE = 513  # thresholds that a scan tries before it looks closer

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class GainEstimate:
    """What excitation and fiber velocity tell of a reflex.

    Attributes:
        gain: as `ReflexLaw.gain`; NaN where nothing is told, and not to be trusted unless ``identifiable``.
        threshold: lopt/s, the one given or found; NaN where the data leave it open.
        interval: lowest and highest gain at `CONFIDENCE`; if the threshold was found too, in ``"velocity"`` with its
            uncertainty, in ``"equation1"`` without.
        residual: root mean square of what the law leaves unexplained, of the samples that tell the gain.
        identifiable: whether the data tell the gain.
        reason: what the data do not tell, and why; empty if they tell everything.
    """

    gain: float
    threshold: float
    interval: tuple[float, float]
    residual: float
    identifiable: bool
    reason: str = ""


def estimate_gain(
    excitation: ArrayLike,
    fiber_velocity: ArrayLike,
    time_step: float,
    threshold: float | None = None,
    mode: str = "equation1",
    delay: float = 0.0,
    tone: float = 0.0,
) -> GainEstimate:
    """Invert a law of the stretch reflex, by least squares on the excitation of one muscle.

    ``"equation1"``, u' = G v while v > V (doi:10.17979/ja-cea.2024.45.10802): over each run of samples with v > V, the
    excitation is an unknown start plus G times the integral of v, held from sample to sample. ``"velocity"``,
    u = g max(0, v(t - delay) - V): excitation over that. Samples at which excitation is clipped are left out. A
    threshold that is not given is the one of least squares: a breakpoint, that must not be negative in ``"equation1"``.
    The interval takes the noise of excitation as white and evenly strong, and follows Student's t.

    Args:
        excitation: (n,) of the muscle, in [0, 1] but for noise.
        fiber_velocity: (n,) lopt/s, lengthening positive.
        time_step: s, between samples.
        threshold: lopt/s; None to find it.
        mode: one of `MODES`.
        delay: s, of ``"velocity"``; as the law, ``"equation1"`` does not look at it.
        tone: excitation in the background of ``"velocity"``.

    Raises:
        SettingsError: shapes that do not fit, values that are not finite, or a number outside its valid values.
    """
    u, v = finite("excitation", excitation, 1), finite("fiber_velocity", fiber_velocity, 1)
    if u.shape != v.shape:
        raise SettingsError(f"excitation has {u.size} samples and fiber_velocity {v.size}: give as many of both")
    if mode not in MODES:
        raise SettingsError(f"mode {mode!r} cannot be read back: choose one of {', '.join(MODES)}")
    if not (is_number(time_step) and 0 < time_step < math.inf):
        raise SettingsError(f"time_step {time_step!r}: give a positive number of seconds")
    if threshold is not None and not (is_number(threshold) and math.isfinite(threshold)):
        raise SettingsError(f"threshold {threshold!r}: give a finite number, or None to find it")
    if not (is_number(delay) and 0 <= delay <= LONGEST_DELAY):
        raise SettingsError(f"delay {delay!r}: give seconds, from 0 to {LONGEST_DELAY:g}")
    if not (is_number(tone) and 0 <= tone < 1):
        raise SettingsError(f"tone {tone!r}: give an excitation from 0 to below 1")
    if mode == "velocity":
        v = delayed(v[:, None], float(delay), float(time_step))[:, 0]
    steady = mode == "velocity" and v.size > 0 and bool(np.ptp(v) <= _NEARLY_CONSTANT * abs(float(v.mean())))
    reason = _nothing_told(u, v, threshold, steady)
    if reason:
        return _unknown(reason, threshold)
    if mode == "velocity":
        return _velocity(u - tone, v, u >= 1.0, threshold)
    return _equation1(u, v, float(time_step), threshold)


def _nothing_told(u: Array, v: Array, threshold: float | None, steady: bool) -> str:
    """Why no law could be read from these, or nothing; steady: whether excitation may be constant."""
    if u.size < _LEAST:
        return f"too few samples: {u.size}, where {_LEAST} are needed"
    if threshold is not None and not (v > threshold).any():
        return f"no sample has a velocity above the threshold {threshold:g} lopt/s: the highest is {v.max():.4g}"
    if threshold is None and not (v > 0).any():
        return f"no sample has a velocity above 0: the highest is {v.max():.4g} lopt/s"
    if (u >= 1.0).all():
        return "the excitation is clipped at 1 throughout"
    if np.ptp(u) <= _CONSTANT and (not steady or abs(float(u[0])) <= _CONSTANT):
        return f"the excitation is constant, {u[0]:.4g}: no reflex is seen"
    if threshold is not None and (u[v > threshold] >= 1.0).all():
        return "the excitation is clipped at 1 at all velocities above the threshold"
    return ""


def _unknown(reason: str, threshold: float | None = None) -> GainEstimate:
    nan = math.nan
    return GainEstimate(nan, nan if threshold is None else float(threshold), (nan, nan), nan, False, reason)


def _judged(gain: float, error: float, dof: int, threshold: float, residual: float, tried: int) -> GainEstimate:
    """The estimate, identifiable if its gain stands out from noise, with ``tried`` thresholds (Bonferroni)."""
    from scipy.stats import t

    reach = float(t.ppf(0.5 + CONFIDENCE / 2, dof)) * error
    found = GainEstimate(gain, threshold, (gain - reach, gain + reach), residual, False)
    if gain < 0:
        return replace(found, reason=f"the estimate is negative, {gain:.4g}: excitation falls as velocity rises")
    if gain <= float(t.ppf(1 - (1 - CONFIDENCE) / (2 * tried), dof)) * error:
        return replace(found, reason=f"the gain {gain:.4g} does not stand out from the noise of the excitation")
    return replace(found, identifiable=True)


# --- u' = G v while v > V ------------------------------------------------------------------------------------------


def _equation1(u: Array, v: Array, h: float, threshold: float | None) -> GainEstimate:
    # An increment into a bound tells nothing; one from a bound does, as the bound is where excitation is.
    free = (u[1:] < 1.0) & ~((u[1:] <= 0.0) & (v[:-1] < 0))
    v = v[:-1]
    note, tried = "", 1
    if threshold is None:
        speeds = np.unique(v[free & (v > 0)])
        if not speeds.size:
            return _unknown("the excitation is clipped at all velocities above 0")
        below = _scan(u, v, h, free, speeds)
        tried, least = speeds.size, speeds[below]
        under = v[free & (v < least)]
        if under.size:
            threshold = float(max(0.0, 0.5 * (max(under.max(), 0.0) + least)))
        else:
            threshold, note = math.nan, f"no velocity is below the threshold, which is under {least:.4g} lopt/s"
        above = free & (v >= least)
    else:
        above = free & (v > threshold)
    runs = _Runs.of(above)
    n = runs.where.size
    dof = n - runs.size.size - 1
    if dof < _LEAST - 2:
        return _unknown(f"too few samples of excitation that is free above the threshold: {n}", threshold)
    x, y = runs.integral(v * h), runs.centered(u)
    square = float(x @ x)
    gain = float(x @ y) / square
    left = y - gain * x
    spread = float(left @ left)
    found = _judged(gain, math.sqrt(spread / dof / square), dof, threshold, math.sqrt(spread / n), tried)
    return replace(found, reason=found.reason or note)


def _scan(u: Array, v: Array, h: float, free: Mask, speeds: Array) -> int:
    """Which of rising speeds is the lowest above the threshold: least squares of the whole course, between clips."""
    runs = _Runs.of(free)
    y = runs.centered(u)
    whole = float(y @ y)

    def left(speed: float) -> float:  # by the best gain of 0 or more
        x = runs.integral(np.where(v >= speed, v, 0.0) * h)
        square, product = float(x @ x), max(float(x @ y), 0.0)
        return whole - (product**2 / square if square > 0 else 0.0)

    first, last = 0, speeds.size - 1
    while True:
        tried = np.unique(np.linspace(first, last, min(_AT_ONCE, last - first + 1)).astype(int))
        best = int(np.argmin([left(float(speeds[k])) for k in tried]))
        if last - first + 1 <= _AT_ONCE:
            return int(tried[best])
        first, last = int(tried[max(best - 3, 0)]), int(tried[min(best + 3, tried.size - 1)])


@dataclass(frozen=True, eq=False)
class _Runs:
    """Runs of neighboring increments, and the samples at their ends: each has a sample more than increments.

    Attributes:
        there: (n - 1,) which increments are in a run.
        where: samples, that two runs share counted for each.
        run: which run each of them is in.
        size: of each run, in samples.
    """

    there: Mask
    where: NDArray[np.intp]
    run: NDArray[np.intp]
    size: NDArray[np.intp]

    @classmethod
    def of(cls, there: Mask) -> _Runs:
        """Those of the increments that are there."""
        starts = there & ~np.concatenate(([False], there[:-1]))
        first, at = np.flatnonzero(starts), np.flatnonzero(there)
        run = np.concatenate((np.arange(first.size), np.cumsum(starts)[at] - 1))
        return cls(there, np.concatenate((first, at + 1)), run, np.bincount(run, minlength=first.size))

    def centered(self, values: Array) -> Array:
        """Values (n,) at the samples, less their means over the runs."""
        x = values[self.where]
        return np.asarray(x - (np.bincount(self.run, x, self.size.size) / self.size)[self.run])

    def integral(self, growth: Array) -> Array:
        """The sum of growth (n - 1,) over a run, at the samples, centered."""
        return self.centered(np.concatenate(([0.0], np.cumsum(np.where(self.there, growth, 0.0)))))


# --- u = g max(0, v - V) -------------------------------------------------------------------------------------------


def _velocity(u: Array, v: Array, clipped: Mask, threshold: float | None) -> GainEstimate:
    u, v = u[~clipped], v[~clipped]
    if threshold is not None:
        above = v > threshold
        n, x, y = int(above.sum()), v[above] - threshold, u[above]
        if n < _LEAST - 1:
            return _unknown(f"too few samples of excitation that is free above the threshold: {n}", threshold)
        square = float(x @ x)
        gain = float(x @ y) / square
        spread = float(np.sum((y - gain * x) ** 2))
        error = math.sqrt(spread / (n - 1) / square)
        return _judged(gain, error, n - 1, float(threshold), math.sqrt(spread / n), 1)
    above = _breakpoint(u, v)
    n, x, y = int(above.sum()), v[above], u[above]
    reason = _no_line(u, v, above)
    if reason:
        return _unknown(reason)
    mean = float(x.mean())
    gain, height = _line(x, y)
    spread = float(np.sum((y - height - gain * (x - mean)) ** 2))
    error = math.sqrt(spread / (n - 2) / float(np.sum((x - mean) ** 2)))
    found = mean - height / gain if gain > 0 else math.nan
    return _judged(gain, error, n - 2, found, math.sqrt(spread / n), np.unique(v).size)


def _no_line(u: Array, v: Array, above: Mask) -> str:
    """Why excitation over velocity has no line above a threshold, or nothing.

    It must explain more than chance, and more than a step at the highest velocity does.
    """
    least, nothing = _unexplained(u, v, above), float(u @ u)
    there = v >= v.max() - _NEARLY_CONSTANT * abs(float(v.max()))
    step = float(np.sum((u[there] - max(float(u[there].mean()), 0.0)) ** 2) + np.sum(u[~there] ** 2))
    best = min(least, step)
    noise, chosen = best / max(u.size - 2, 1), 2 * math.log(u.size)
    if nothing - best <= (_CHANCE + chosen) * noise + _ROUNDING * nothing:
        return "no rise of excitation with velocity stands out from its noise"
    x = v[above]
    nearly_constant = np.ptp(x) <= _NEARLY_CONSTANT * abs(float(x.mean()))
    if nearly_constant or step - least <= _CHANCE * noise + _ROUNDING * nothing:
        return (
            f"the velocity at which the muscle is excited is nearly constant, {v[there].mean():.4g} lopt/s: gain and "
            "threshold cannot be told apart; give the threshold"
        )
    return "" if x.size >= _LEAST else f"too few samples of excitation that is free above the threshold: {x.size}"


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope, and height at the mean of x."""
    apart = x - x.mean()
    return float(apart @ y) / float(apart @ apart), float(y.mean())


def _breakpoint(u: Array, v: Array) -> Mask:
    """Which samples are above the threshold V that, with its best gain, explains the excitation best.

    With the m fastest samples above V, the best V is where their line crosses 0, if that is between sample m and the
    next; else it is at the next sample's velocity, if it is not in another interval.
    """
    order = np.argsort(-v, kind="stable")
    x, y = v[order], u[order]
    m = np.arange(1, x.size + 1)
    ends = np.append(x[1:], -np.inf)
    origin = float(x.mean())
    x, ends = x - origin, ends - origin
    sx, sy, sxx, sxy = (np.cumsum(part) for part in (x, y, x * x, x * y))
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (m * sxy - sx * sy) / (m * sxx - sx * sx)
        crossing = (sx - sy / slope) / m
        inside = (slope > 0) & (crossing >= ends) & (crossing < x)
        V = np.where(inside, crossing, ends)
        across, along = sxy - V * sy, sxx - 2 * V * sx + m * V * V
        gained = np.where(across > 0, across * across / along, 0.0)
    gained[(x == ends) | ~np.isfinite(gained)] = -np.inf  # between samples of one velocity there is no threshold
    best = int(np.argmax(gained))
    if gained[best] == -np.inf:  # all samples are of one velocity
        return np.ones(v.shape, bool)
    return np.asarray(v - origin > V[best])


def _unexplained(u: Array, v: Array, above: Mask) -> float:
    """Squares of excitation that a rising line over the samples above the threshold leaves; infinite without one."""
    x, y = v[above], u[above]
    if x.size < 2 or np.ptp(x) == 0:
        return math.inf
    gain, height = _line(x, y)
    if not gain > 0:
        return math.inf
    return float(np.sum((y - height - gain * (x - x.mean())) ** 2) + np.sum(u[~above] ** 2))

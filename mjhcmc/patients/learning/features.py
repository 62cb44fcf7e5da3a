"""Features that a person would read off the curves: resistance, catch, range, bursts of EMG, swings of a pendulum."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjhcmc.patients.learning.read import Column, Guarded
from mjhcmc.patients.trials import MIN_JERK_PEAK, REST

Array = NDArray[np.float64]

STRETCHED: dict[str, tuple[str, ...]] = {
    "hip": ("rect_fem",),
    "knee": ("rect_fem", "vasti"),
    "ankle": ("gastroc", "soleus"),
}
"""Muscles with surface EMG that the stretch of a joint lengthens; at the hip only rect_fem, iliopsoas has none."""

OPPOSED: dict[str, tuple[str, ...]] = {
    "hip": ("glut_max", "hamstrings"),
    "knee": ("hamstrings",),
    "ankle": ("tib_ant",),
}
"""Muscles with surface EMG that it shortens."""

STRETCHES = ("slow", "mas", "fast_low", "fast_high")
"""Stretches that are described: fast_low and fast_high are the slowest and the fastest of the fast ones."""

READS: dict[str, dict[str, tuple[str, ...]]] = {
    joint: {
        "person": ("sex", "height", "body_mass"),
        "protocol": ("test", "joint", "speed_deg_s", "start_deg", "end_deg"),
        "stretch": ("time", f"q/{joint}", f"v/{joint}", "torque"),
        "emg": ("time", f"q/{joint}", f"v/{joint}", *(f"emg/{m}" for m in (*STRETCHED[joint], *OPPOSED[joint]))),
        "pendulum": ("time", "q/knee"),
    }
    for joint in STRETCHED
}
"""By joint and family of features, the columns that the family reads. Anything else raises."""

_TORQUE = ("rest", "peak", "mean", "at25", "at50", "at75", "at95", "peak_at", "reach", "slowed", "rise", "released",
           "share", "slope_early", "slope_late")  # fmt: skip
_EMG = ("rest", "peak", "area", "onset_at", "onset_speed", "opposed")
_PENDULUM = ("excursion", "relaxation", "swings", "decrement")
_FASTER = (("mas", "slow"), ("fast_low", "slow"), ("fast_high", "slow"), ("fast_high", "mas"))
_COMPARED = ("peak", "at25", "at50", "at75", "at95")

_RESISTS = 0.02  # N m / (kg m): about 2.5 N m in an adult, what a hand notices
_NO_BURST = 1.25  # of the range: an onset that did not come
_SMOOTH = 0.11  # s: leaves .16 rad/s^2 of a gyro's 1 deg/s noise in the acceleration


@dataclass(frozen=True)
class TrialRow:
    """What was commanded in a trial: rad, rad/s; trial is its number within the patient."""

    trial: int
    test: str
    joint: str
    speed: float
    start: float
    end: float


def feature_names(joint: str) -> tuple[str, ...]:
    """Names of a joint's features, in the order of `describe`; known before any file is read."""
    names = ["person/female", "person/height", "person/body_mass"]
    names += [f"{key}/{what}" for key in STRETCHES for what in _TORQUE]
    names += [f"{fast}-{slow}/{what}" for fast, slow in _FASTER for what in _COMPARED]
    names += ["per_speed/peak"]
    names += [f"{key}/emg_{what}" for key in STRETCHES for what in _EMG]
    if joint == "knee":
        names += [f"pendulum/{what}" for what in _PENDULUM]
    return tuple(names)


def inertia_per_size(joint: str) -> float:
    """Moment of inertia about the joint over body mass x height^2, in the poses of the passive stretches.

    Masses, centers of mass (de Leva 1996, doi:10.1016/0021-9290(95)00178-6, men); segment lengths .245, .246 and .152
    of the height and radii of gyration .32, .25 and .25 of the segment's length (Drillis, Contini 1966; de Leva).
    """
    thigh, shank, foot = 0.245, 0.246, 0.152
    on_ankle = 0.0137 * foot**2 * (0.4415**2 + 0.25**2)
    on_knee = 0.0433 * shank**2 * (0.4459**2 + 0.25**2) + 0.0137 * shank**2 + on_ankle
    if joint == "ankle":
        return on_ankle
    if joint == "knee":
        return on_knee
    com = 0.4459 * shank
    bent = 0.5  # cosine of the knee's 60 deg while the hip is stretched
    on_hip = 0.1416 * thigh**2 * (0.4095**2 + 0.32**2)
    on_hip += 0.0433 * (thigh**2 + com**2 + 2 * bent * thigh * com + (0.25 * shank) ** 2)
    return on_hip + 0.0137 * (thigh**2 + shank**2 + 2 * bent * thigh * shank)


def describe(
    joint: str, person: Mapping[str, float], trials: list[TrialRow], samples: Mapping[int, Mapping[str, Column]]
) -> Array:
    """Features of one joint of one patient; nan where a trial is missing.

    Args:
        joint: that is graded.
        person: female (0 or 1), height (m), body_mass (kg).
        trials: of this joint that succeeded.
        samples: by trial, the columns of the observables.

    Returns:
        In the order of `feature_names`.

    Raises:
        SettingsError: a column is read that the family of features does not declare.
    """
    found: dict[str, float] = {f"person/{name}": float(value) for name, value in person.items()}
    size = (person["body_mass"], person["height"])
    peaks: list[tuple[float, float]] = []
    for key, row in _chosen(trials).items():
        reads = READS[joint]
        torque = stretch_features(joint, row, Guarded("observables", samples[row.trial], reads["stretch"]), size)
        emg = emg_features(joint, row, Guarded("observables", samples[row.trial], reads["emg"]))
        found |= {f"{key}/{name}": value for name, value in torque.items()}
        found |= {f"{key}/emg_{name}": value for name, value in emg.items()}
        if "peak" in torque:
            peaks.append((row.speed, torque["peak"]))
    for fast, slow in _FASTER:
        for what in _COMPARED:
            difference = found.get(f"{fast}/{what}", math.nan) - found.get(f"{slow}/{what}", math.nan)
            found[f"{fast}-{slow}/{what}"] = difference
    if len({speed for speed, _ in peaks}) > 1:
        speed, peak = np.array(peaks).T
        found["per_speed/peak"] = float(np.polyfit(speed, peak, 1)[0])
    for row in trials:
        if joint == "knee" and row.test == "pendulum":
            swings = pendulum_features(Guarded("observables", samples[row.trial], READS[joint]["pendulum"]))
            found |= {f"pendulum/{name}": value for name, value in swings.items()}
    return np.array([found.get(name, math.nan) for name in feature_names(joint)])


def _chosen(trials: list[TrialRow]) -> dict[str, TrialRow]:
    """The stretches to describe; with a single fast one it is both."""
    by_test = {
        test: sorted((t for t in trials if t.test == test), key=lambda t: t.speed) for test in ("slow", "mas", "fast")
    }
    chosen = {"slow": by_test["slow"][:1], "mas": by_test["mas"][:1]}
    chosen |= {"fast_low": by_test["fast"][:1], "fast_high": by_test["fast"][-1:]}
    return {key: rows[0] for key, rows in chosen.items() if rows and rows[0].start != rows[0].end and rows[0].speed > 0}


def stretch_features(joint: str, row: TrialRow, o: Mapping[str, Column], size: tuple[float, float]) -> dict[str, float]:
    """What the examiner's hand and a goniometer tell of one stretch; empty where too little was recorded.

    Resistance is the examiner's torque in the direction of the stretch, less limb inertia times acceleration and less
    its value before the stretch, over body mass x height.

    Args:
        joint: under test.
        row: what was commanded.
        o: time (n,) s, angle (rad), velocity (rad/s) and torque (N m).
        size: body mass (kg) and height (m).
    """
    time, q, v, torque = (np.asarray(o[name], dtype=np.float64) for name in READS[joint]["stretch"])
    good = np.isfinite(time) & np.isfinite(q) & np.isfinite(v) & np.isfinite(torque)
    time, q, v, torque = time[good], q[good], v[good], torque[good]
    before, after = time < REST - 0.1, time >= REST  # averages of torque reach over 0.1 s
    if before.sum() < 3 or after.sum() < 8:
        return {}
    sign, way = math.copysign(1.0, row.end - row.start), abs(row.end - row.start)
    step = float(np.median(np.diff(time)))
    mass, height = size
    acceleration = np.gradient(_smooth(v, _SMOOTH, step), step)
    torque = _smooth(sign * (torque - inertia_per_size(joint) * mass * height**2 * acceleration), 0.05, step)
    rest = float(torque[before].mean()) / (mass * height)
    resistance = torque[after] / (mass * height) - rest
    part = _smooth(sign * (q[after] - row.start) / way, 0.05, step)
    t, speed = time[after] - REST, _smooth(sign * v[after], 0.05, step)
    arrived = int(np.argmax(part >= 0.98)) if (part >= 0.98).any() else int(np.argmax(part))
    moving = slice(0, max(arrived, 2) + 1)
    at = {f"at{x}": _at(part, resistance, x / 100) for x in (25, 50, 75, 95)}
    peak = int(np.argmax(resistance[moving]))
    rise = np.diff(resistance[moving]) / step
    return {
        "rest": rest,
        "peak": float(resistance[peak]),
        "mean": float(resistance[moving].mean()),
        **at,
        "peak_at": float(part[peak]),
        "reach": float(part.max()),
        "slowed": float(((_desired_speed(t, way, row.speed) - speed)[moving]).max()) / row.speed,
        "rise": float(np.percentile(rise, 98)),
        "released": float(resistance[peak] - np.median(resistance[t > t[-1] - 0.25])),
        "share": float(np.mean(np.interp(_FRACTIONS, *_by_part(part[moving], resistance[moving])) > _RESISTS)),
        "slope_early": at["at50"] - _at(part, resistance, 0.1),
        "slope_late": at["at95"] - at["at50"],
    }


_FRACTIONS = np.linspace(0.05, 0.95, 19)


def _by_part(part: Array, values: Array) -> tuple[Array, Array]:
    """Values over a fraction of the range that only grows, for interpolation."""
    grown = np.maximum.accumulate(part)
    kept = np.concatenate([[True], np.diff(grown) > 0])
    return grown[kept], values[kept]


def _at(part: Array, values: Array, fraction: float) -> float:
    """The value where a fraction of the range is reached first, or at the furthest point."""
    reached = part >= fraction
    return float(values[int(np.argmax(reached)) if reached.any() else int(np.argmax(part))])


def _desired_speed(t: Array, way: float, peak: float) -> Array:
    """Speed (rad/s) of the commanded movement of minimum jerk, t (s) from its beginning."""
    x = np.clip(t * peak / (MIN_JERK_PEAK * way), 0.0, 1.0)
    return np.asarray(peak / MIN_JERK_PEAK * x**2 * (30 + x * (-60 + 30 * x)))


def _smooth(values: Array, seconds: float, step: float) -> Array:
    """Moving average; ends take what there is."""
    half = int(seconds / step / 2)
    total = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(len(values))
    low, high = np.maximum(index - half, 0), np.minimum(index + half + 1, len(values))
    return np.asarray((total[high] - total[low]) / (high - low))


def emg_features(joint: str, row: TrialRow, o: Mapping[str, Column]) -> dict[str, float]:
    """Bursts of the stretched muscles' EMG envelopes (their mean) over their level before the stretch.

    The onset is the first time that the envelope stays 30 ms above rest by 5 of its standard deviations and 0.02.

    Args:
        joint: under test.
        row: what was commanded.
        o: time (n,) s, angle (rad), velocity (rad/s) and envelopes of the muscles.
    """
    time, q, v = (np.asarray(o[name], dtype=np.float64) for name in READS[joint]["emg"][:3])
    stretched = np.mean([np.asarray(o[f"emg/{m}"], dtype=np.float64) for m in STRETCHED[joint]], axis=0)
    opposed = np.mean([np.asarray(o[f"emg/{m}"], dtype=np.float64) for m in OPPOSED[joint]], axis=0)
    good = np.isfinite(time) & np.isfinite(q) & np.isfinite(v) & np.isfinite(stretched) & np.isfinite(opposed)
    time, q, v, stretched, opposed = time[good], q[good], v[good], stretched[good], opposed[good]
    before = time < REST
    if before.sum() < 3 or (~before).sum() < 8:
        return {}
    sign, way = math.copysign(1.0, row.end - row.start), abs(row.end - row.start)
    step = float(np.median(np.diff(time)))
    rest, spread = float(stretched[before].mean()), float(stretched[before].std())
    during = (time >= REST) & (time <= REST + MIN_JERK_PEAK * way / row.speed + 0.2)
    over = _smooth(stretched, 0.03, step)[during] - rest
    width = max(1, round(0.03 / step))
    on = np.convolve(over > 5 * spread + 0.02, np.ones(width), "valid") > width - 0.5
    onset = int(np.argmax(on)) if on.any() else None
    return {
        "rest": rest,
        "peak": float(over.max()),
        "area": float(over.mean()),
        "onset_at": _NO_BURST if onset is None else float(sign * (q[during][onset] - row.start) / way),
        "onset_speed": _NO_BURST if onset is None else float(sign * v[during][onset] / row.speed),
        "opposed": float(opposed.mean()),
    }


def pendulum_features(o: Mapping[str, Column]) -> dict[str, float]:
    """First swing, relaxation index (first swing over the angle of rest), swings, and how fast they die.

    Bajd, Vodovnik 1984, doi:10.1016/0141-5425(84)90048-X. Empty where too little was recorded.

    Args:
        o: time (n,) s and the knee's angle (rad), flexion negative.
    """
    from scipy.signal import find_peaks

    time, q = np.asarray(o["time"], dtype=np.float64), np.asarray(o["q/knee"], dtype=np.float64)
    good = np.isfinite(time) & np.isfinite(q)
    time, q = time[good], q[good]
    if len(time) < 20:
        return {}
    step = float(np.median(np.diff(time)))
    q = _smooth(q, 0.07, step)
    settled = float(q[time > time[-1] - 0.5].mean())
    lows, _ = find_peaks(-q, prominence=math.radians(3.0))
    first = int(lows[0]) if len(lows) else int(np.argmin(q))
    drop = max(float(q[0] - settled), math.radians(1.0))
    floor = math.radians(0.5)  # what the goniometer's noise leaves to see
    swing = max(settled - float(q[first]), floor)
    second = max(settled - float(q[lows[1]]), floor) if len(lows) > 1 else floor
    return {
        "excursion": float(q[0] - q[first]),
        "relaxation": float(q[0] - q[first]) / drop,
        "swings": float(len(lows)),
        "decrement": math.log(swing / second),
    }

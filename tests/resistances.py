"""Passive stretches whose resistance is drawn by hand: forces at the hand in N over the range passed and the time."""

import numpy as np

from mjhcmc.leg8.table import JOINTS
from mjhcmc.patients.record import Record
from mjhcmc.patients.resistance import Hand
from mjhcmc.patients.trials import REST, stretch

HAND = Hand(0.35)


def record(force, *, joint="knee", rate=100.0, reach=1.0, inertia=0.3):
    """A record of a minimum-jerk stretch over ``reach`` of the range, against force(s, t) N at HAND."""
    trial = stretch(joint, "mas", rate=rate)
    time = np.arange(round(trial.duration * rate) + 1) / rate
    i, n = JOINTS.index(joint), len(time)
    qpos, qvel, qacc, torque = np.tile(trial.pose, (n, 1)), *(np.zeros((n, 3)) for _ in range(3))
    q, v, a = trial.desired(time)
    qpos[:, i], qvel[:, i], qacc[:, i] = trial.start + reach * (q - trial.start), reach * v, reach * a
    s = (qpos[:, i] - trial.start) / (trial.end - trial.start)
    torque[:, i] = trial.direction * HAND.lever_arm * force(s, time) + inertia * qacc[:, i]
    none = np.zeros((n, 8))
    return Record(trial, time, qpos, qvel, qacc, torque, inertia, *[none] * 6)


def when(place):
    """s, when the stretch over the whole range passes a part of it."""
    time = np.linspace(REST, REST + 1, 2001)
    x = time - REST
    return float(np.interp(place, x**3 * (10 - 15 * x + 6 * x**2), time))


def sudden(t, since):
    """0 to 1 within a tenth of a second, the middle at ``since``."""
    return 1 / (1 + np.exp(-(t - since) / 0.015))


def bump(place, size, lasting=0.08):
    """A catch that is released."""
    since = when(place)
    return lambda s, t: size * (sudden(t, since) - sudden(t, since + 0.03 + lasting))


def held(place, size, rest):
    """A catch, and what remains of it to the end."""
    since = when(place)
    return lambda s, t: size * sudden(t, since) - (size - rest) * sudden(t, since + 0.1)


def wall(place, size):
    """Stiff from ``place`` on."""
    return lambda s, t: size * np.clip((s - place + 0.1) / 0.1, 0, 1)


def onward(place, size):
    """From a place of the range on, setting in softly."""
    return lambda s, t: size * np.clip((s - place) / 0.3, 0, 1)


CATCH = {
    "none": lambda s, t: 0.5 * s,
    "released": bump(0.45, 22.0),
    "held": held(0.62, 15.0, 15.0),
    "elastic": lambda s, t: 40.0 * s**3,
}

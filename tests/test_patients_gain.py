"""Reading a reflex's gain and threshold back, from data that a reflex made; and where they do not tell them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjhcmc.errors import SettingsError
from mjhcmc.patients.gain import MODES, estimate_gain
from mjhcmc.patients.reflex import ReflexLaw, reflex_along

STEP = 0.01
TIME = np.arange(300) * STEP
VELOCITY = 1.5 * np.sin(2 * np.pi * TIME / 1.7) + 0.3 * np.sin(9 * TIME)
DELAY = 0.0333
GAINS = {"equation1": 0.3, "velocity": 0.4}
THRESHOLD = 0.35

both_modes = pytest.mark.parametrize("mode", MODES)
known_or_not = pytest.mark.parametrize("threshold", [THRESHOLD, None], ids=["known", "found"])


def made(mode, gain, threshold=THRESHOLD, velocity=VELOCITY, delay=DELAY):
    """Excitation by a reflex."""
    law = ReflexLaw(mode, np.array([[gain]]), np.array([[threshold]]), np.array([delay]), STEP)
    return reflex_along(law, np.arange(velocity.size) * STEP, velocity[:, None])[:, 0]


# --- what is told -------------------------------------------------------------------------------------------------


@both_modes
@known_or_not
@pytest.mark.parametrize("gain", [0.05, 0.4, 3.0], ids=["weak", "medium", "clipped"])
def test_gain_of_clean_data_is_exact(mode, threshold, gain):
    u = made(mode, gain)
    assert (u.max() == 1.0) == (gain == 3.0)
    found = estimate_gain(u, VELOCITY, STEP, threshold, mode, DELAY)
    assert found.identifiable
    assert found.reason == ""
    assert found.gain == pytest.approx(gain, rel=1e-9)
    assert found.interval == pytest.approx((gain, gain), rel=1e-9)
    assert found.residual < 1e-12


@given(gain=st.floats(0.05, 1), threshold=st.floats(0, 1), seed=st.integers(0, 99))
@settings(max_examples=40, deadline=None)
def test_threshold_is_found(gain, threshold, seed):
    """In "velocity" exactly; Equation 1 shows only between which velocities of the data it is."""
    velocity = np.random.default_rng(seed).uniform(-2, 2, 300)
    found = estimate_gain(made("velocity", gain, threshold, velocity), velocity, STEP, None, "velocity", DELAY)
    assert (found.gain, found.threshold) == pytest.approx((gain, threshold), rel=1e-9, abs=1e-12)
    u = made("equation1", gain, threshold, velocity)
    found = estimate_gain(u, velocity, STEP)
    assert found.gain == pytest.approx(gain, rel=1e-9)
    seen = velocity[: -1 if u[-1] < 1 else np.argmax(u >= 1) - 1]  # before excitation is clipped, and stays so
    assert ((seen > found.threshold) == (seen > threshold)).all()


def test_of_long_data_the_threshold_is_found_step_by_step():
    velocity = np.random.default_rng(0).normal(size=3000)
    found = estimate_gain(made("equation1", 0.05, velocity=velocity), velocity, STEP)
    assert ((velocity > found.threshold) == (velocity > THRESHOLD)).all()


@both_modes
@known_or_not
def test_noise_stays_within_the_interval(mode, threshold):
    """Of 200 intervals at 95 % nearly as many hold the gain, and they are narrow."""
    clean, gain = made(mode, GAINS[mode]), GAINS[mode]
    found = [
        estimate_gain(
            clean + 0.02 * np.random.default_rng(seed).normal(size=300), VELOCITY, STEP, threshold, mode, DELAY
        )
        for seed in range(200)
    ]
    low, high = np.array([one.interval for one in found]).T
    assert all(one.identifiable for one in found)
    covered = np.mean((low <= gain) & (gain <= high))
    assert 0.89 < covered < 0.99  # .95 less four standard deviations of 200 trials; and not all
    assert np.mean(high - low) < 0.1 * gain
    assert np.mean([one.gain for one in found]) == pytest.approx(gain, rel=0.01)
    assert np.mean([one.residual for one in found]) == pytest.approx(0.02, rel=0.05)


@both_modes
@known_or_not
def test_noise_alone_is_no_reflex(mode, threshold):
    """At most a few in a hundred take it for one; no more of those that try many thresholds."""
    told = [
        estimate_gain(0.02 * np.random.default_rng(seed).normal(size=300), VELOCITY, STEP, threshold, mode).identifiable
        for seed in range(100)
    ]
    assert np.mean(told) <= (0.01 if threshold is None else 0.08)


def test_tone_is_not_reflex():
    u = np.minimum(made("velocity", 0.4) + 0.05, 1.0)
    assert estimate_gain(u, VELOCITY, STEP, None, "velocity", DELAY, 0.05).gain == pytest.approx(0.4, rel=1e-9)
    assert estimate_gain(u, VELOCITY, STEP, THRESHOLD, "velocity", DELAY).gain > 0.42
    u = made("equation1", 0.3) + 0.05  # Equation 1 starts where it is
    assert estimate_gain(u, VELOCITY, STEP).gain == pytest.approx(0.3, rel=1e-9)


def test_a_gain_whose_threshold_is_not_told():
    """Under Equation 1 constant velocity tells the gain, but only that the threshold is below it."""
    u = made("equation1", 0.3, velocity=np.full(50, 2.0))
    found = estimate_gain(u, np.full(50, 2.0), STEP)
    assert found.identifiable
    assert found.gain == pytest.approx(0.3, rel=1e-9)
    assert np.isnan(found.threshold)
    assert "no velocity is below the threshold, which is under 2 lopt/s" in found.reason


# --- what is not --------------------------------------------------------------------------------------------------

RISING = np.linspace(0, 0.5, 300)


@both_modes
@pytest.mark.parametrize(
    ("u", "v", "threshold", "reason"),
    [
        (RISING, VELOCITY, 5.0, "no sample has a velocity above the threshold 5 lopt/s: the highest is 1.687"),
        (RISING, -np.abs(VELOCITY), None, "no sample has a velocity above 0"),
        (np.ones(300), VELOCITY, 0.3, "clipped at 1 throughout"),
        (np.where(VELOCITY > 0.3, 1.0, 0.1), VELOCITY, 0.3, "clipped at 1 at all velocities above the threshold"),
        (np.zeros(300), VELOCITY, None, "the excitation is constant, 0: no reflex is seen"),
        (np.full(300, 0.2), VELOCITY, 0.3, "the excitation is constant, 0.2"),
        (RISING[:3], VELOCITY[:3], None, "too few samples: 3, where 4 are needed"),
        (np.append(RISING[:9] / 9, 1.0), np.append(np.zeros(9), 1.0), 0.5, "clipped at 1 at all"),
        (RISING[:10], np.append(np.zeros(9), 1.0), 0.5, "too few samples of excitation that is free above"),
        (-RISING, np.abs(VELOCITY) + 0.1, 0.05, "the estimate is negative"),
    ],
)  # fmt: skip
def test_what_cannot_be_told(mode, u, v, threshold, reason):
    found = estimate_gain(u, v, STEP, threshold, mode)
    assert not found.identifiable
    assert reason in found.reason
    assert np.isnan(found.gain) or found.gain < 0


@pytest.mark.parametrize(
    "velocity",
    [
        np.full(100, 2.0), 2.0 + 0.005 * np.sin(np.arange(100.0)), np.repeat([0.0, 2.0, 0.0], 50),
        np.repeat([0.0, 1.0, 2.0, -1.0], 30),
    ],
    ids=["constant", "nearly", "pulse", "steps"],
)  # fmt: skip
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_one_velocity_does_not_tell_gain_from_threshold(velocity, noise):
    """Any threshold below the fast velocity, and above the slow ones, explains it; with the threshold, all is told."""
    u = made("velocity", 0.4, 1.2, velocity, 0.0) + noise * np.random.default_rng(0).normal(size=velocity.size)
    found = estimate_gain(u, velocity, STEP, None, "velocity")
    assert not found.identifiable
    assert "gain and threshold cannot be told apart; give the threshold" in found.reason
    found = estimate_gain(u, velocity, STEP, 1.2, "velocity")
    assert found.identifiable
    assert found.gain == pytest.approx(0.4, rel=10 * noise + 1e-9)


def test_nothing_free_to_find_a_threshold_from():
    velocity = np.append(np.zeros(20), 1.0)
    found = estimate_gain(np.append(np.linspace(0, 0.1, 20), 1.0), velocity, STEP)
    assert not found.identifiable
    assert "clipped at all velocities above 0" in found.reason


# --- bad input ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"excitation": RISING[:-1]}, "excitation has 299 samples and fiber_velocity 300"),
        ({"excitation": np.zeros((300, 2))}, r"excitation has the shape \(300, 2\)"),
        ({"excitation": np.where(TIME[7] == TIME, np.nan, 0.1)}, r"excitation is nan at \(7,\)"),
        ({"fiber_velocity": np.full(300, np.inf)}, r"fiber_velocity is inf at \(0,\)"),
        ({"time_step": 0.0}, r"time_step 0.0: give a positive number of seconds"),
        ({"time_step": np.nan}, "time_step nan"),
        ({"mode": "force"}, "mode 'force' cannot be read back: choose one of equation1, velocity"),
        ({"threshold": np.nan}, "threshold nan: give a finite number, or None"),
        ({"delay": -0.1}, "delay -0.1: give seconds, from 0"),
        ({"delay": 33}, "delay 33: give seconds, from 0 to 1"),
        ({"tone": 1.0}, "tone 1.0: give an excitation from 0 to below 1"),
    ],
)
def test_bad_input(change, told):
    with pytest.raises(SettingsError, match=told):
        estimate_gain(**{"excitation": RISING, "fiber_velocity": VELOCITY, "time_step": STEP, **change})

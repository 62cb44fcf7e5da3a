"""Motions: the spline, the cosine movements, resampling, and what is refused."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_tools import CART, LEG, wave

from mjhcmc.errors import MotionError, SettingsError
from mjhcmc.motion import Motion

# --- the spline -------------------------------------------------------------------------------------------


@given(
    coefficients=st.lists(st.floats(-2, 2), min_size=6, max_size=6),
    steps=st.lists(st.floats(0.05, 0.2), min_size=5, max_size=12),
    origin=st.floats(-5, 5),
)
@settings(max_examples=50, deadline=None)
def test_the_spline_is_exact_for_quintics_on_uneven_grids(coefficients, steps, origin):
    time = origin + np.concatenate([[0], np.cumsum(steps)])
    poly = np.polynomial.Polynomial(coefficients)
    motion = Motion(time, poly(time - origin)[:, None])
    t = np.linspace(time[0], time[-1], 50)
    sampled = motion.sample(t)
    np.testing.assert_allclose(sampled.qpos[:, 0], poly(t - origin), atol=1e-10)
    np.testing.assert_allclose(sampled.qvel[:, 0], poly.deriv()(t - origin), atol=1e-8)
    np.testing.assert_allclose(sampled.qacc[:, 0], poly.deriv(2)(t - origin), atol=1e-6)


def test_four_and_five_rows_get_a_cubic():
    for n in (4, 5):
        time = np.linspace(0, 1, n)
        sampled = Motion(time, (time**3)[:, None]).sample([0, 0.3, 1])
        np.testing.assert_allclose(sampled.qacc[:, 0], [0, 1.8, 6], atol=1e-10)


def test_a_motion_keeps_its_own_read_only_copy():
    time, qpos = np.arange(5.0), np.zeros((5, 2), dtype=np.float32)
    motion = Motion(time, qpos)
    time[0] = -1
    assert motion.start == 0
    assert (motion.end, motion.duration) == (4, 4)
    assert motion.qpos.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        motion.qpos[0, 0] = 1


def test_samples_at_the_ends_and_past_them():
    motion = Motion(np.arange(6.0), np.arange(6.0)[:, None])
    at_ends = motion.sample([-9e-10, 5 + 9e-10])
    np.testing.assert_array_equal(at_ends.time, [0, 5])
    assert motion.sample(2.5).qpos.shape == (1, 1)
    for bad in (-1e-8, 5.1, np.nan):
        with pytest.raises(MotionError, match=r"lies outside the motion, 0 \.\. 5 s"):
            motion.sample([1.0, bad])


@pytest.mark.parametrize(
    ("time", "qpos", "message"),
    [
        ([0, 1, 2], np.zeros((3, 1)), "3 rows: a motion needs at least 4"),
        (range(4), np.zeros(4), r"time has shape \(4,\) and qpos \(4,\)"),
        (range(4), np.zeros((5, 1)), r"time has shape \(4,\) and qpos \(5, 1\)"),
        (range(4), [[0, 0], [0, 0], [0, np.nan], [0, 0]], r"row 2 \(from 0\): qpos of joint 1 is nan"),
        ([0, 1, np.inf, 3], np.zeros((4, 1)), r"row 2 \(from 0\): time is inf"),
        ([0, 1, 1, 3], np.zeros((4, 1)), r"row 2 \(from 0\): time 1 s follows 1 s"),
        (range(4), [["a"]] * 4, "qpos is not an array of numbers"),
    ],
)
def test_refuses_what_is_no_motion(time, qpos, message):
    with pytest.raises(MotionError, match=message):
        Motion(list(time), qpos)


def test_refuses_a_span_outside_the_rows():
    for span in ((-1, 2), (1, 4), (2, 2)):
        with pytest.raises(MotionError, match="must increase and lie within the times"):
            Motion(np.arange(4.0), np.zeros((4, 1)), span=span)


# --- cosine -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("movement", "period"), [("fast", 0.2), ("slow", 0.6)])
def test_named_movements_are_the_closed_form(movement, period):
    motion = Motion.cosine(LEG, movement)
    assert motion.name == movement
    assert motion.start == 0
    assert motion.end == pytest.approx(3 * period, rel=1e-15)
    t = np.concatenate([np.linspace(0, motion.end, 4321), motion.end * 10.0 ** np.arange(-9, -2)])
    amplitude, w = np.deg2rad([10, -20, -10]), 2 * np.pi / period
    wt = w * t[:, None]
    sampled = motion.sample(t)
    np.testing.assert_allclose(sampled.qpos, amplitude / 2 * (1 - np.cos(wt)), atol=1e-13)
    np.testing.assert_allclose(sampled.qvel, amplitude / 2 * w * np.sin(wt), atol=1e-9 * w)
    error = np.abs(sampled.qacc - amplitude / 2 * w**2 * np.cos(wt)).max(axis=0)
    assert (error < 1e-8 * np.abs(amplitude) / 2 * w**2).all()


def test_cosine_of_ones_own_starts_from_the_reference_pose():
    motion = Motion.cosine(CART, amplitudes={"rail": 0.5}, period=2, cycles=1.5, name="push")
    assert (motion.name, motion.end) == ("push", 3)
    np.testing.assert_allclose(motion.sample([0, 1, 2, 3]).qpos[:, 0], [0.1, 0.6, 0.1, 0.6], atol=1e-12)
    np.testing.assert_array_equal(motion.qpos[:, 1], 0.2)


@pytest.mark.parametrize(
    ("model", "arguments", "kind", "message"),
    [
        (LEG, {"movement": "quick"}, SettingsError, "unknown movement 'quick': choose from fast, slow"),
        (LEG, {}, SettingsError, "give one of the movements fast, slow"),
        (LEG, {"movement": "fast", "amplitudes": {"hip": 1}}, SettingsError, "give one of the movements"),
        (LEG, {"movement": "fast", "period": 1}, SettingsError, "has its own period"),
        (LEG, {"amplitudes": {"hip": 1}}, SettingsError, "period is None: give a positive number"),
        (LEG, {"amplitudes": {"hip": 1}, "period": -1}, SettingsError, "period is -1"),
        (LEG, {"movement": "fast", "cycles": 0}, SettingsError, "cycles is 0"),
        (LEG, {"amplitudes": {"hip": np.nan}, "period": 1}, SettingsError, "joint hip is nan"),
        (LEG, {"amplitudes": {"hp": 1}, "period": 1}, MotionError, "no joint 'hp': its joints are hip, knee"),
        (CART, {"movement": "fast"}, MotionError, r"no joint hip, knee, ankle.*has rail, pole: give amplitudes="),
        (LEG, {"amplitudes": {"knee": 0.2}, "period": 1}, MotionError, r"joint knee is at 11\.4591559 deg at 0\.5 s"),
        (CART, {"amplitudes": {"rail": 1}, "period": 1}, MotionError, r"at 1\.1 m at .* range -1 \.\. 1 m"),
    ],
)
def test_cosine_refuses(model, arguments, kind, message):
    with pytest.raises(kind, match=message):
        Motion.cosine(model, **arguments)


# --- resampled ------------------------------------------------------------------------------------------------


def test_resampled_rows_lie_on_the_spline_at_an_even_step():
    time = np.sort(np.concatenate([np.linspace(0, 1, 30), np.random.default_rng(3).uniform(0, 1, 20)]))
    motion = Motion(time, wave(time, 0.3), "m", ("read",), LEG.joint_names)
    for rate, step in ((100, 0.01), (50.2, 0.02), (3, 1 / 3), (10_000, 1e-4)):
        again = motion.resampled(rate)
        assert (again.start, again.end, again.name, again.joint_names) == (0, 1, "m", LEG.joint_names)
        np.testing.assert_allclose(np.diff(again.time), step, rtol=1e-9)
        np.testing.assert_allclose(again.qpos, motion.sample(again.time).qpos, atol=1e-14)
        assert again.notices == ("read", f"resampled at {1 / step:.6g} Hz")


@given(degree=st.integers(0, 5), rate=st.floats(12, 300), start=st.floats(0.1, 0.5), length=st.floats(0.5, 1))
@settings(max_examples=40, deadline=None)
def test_resampling_a_quintic_changes_nothing_within_its_span(degree, rate, start, length):
    time = np.linspace(0, 2, 41)
    motion = Motion(time, (time**degree)[:, None], span=(start, start + length)).resampled(rate)
    assert (motion.start, motion.end) == (start, start + length)
    assert 0 <= motion.time[0] <= start < start + length <= motion.time[-1] <= 2
    assert motion.time[0] < 1.5 / rate  # rows that lead the spline in stay
    assert start in motion.time
    assert start + length in motion.time
    t = np.linspace(start, start + length, 50)
    np.testing.assert_allclose(motion.sample(t).qpos[:, 0], t**degree, atol=1e-9)
    np.testing.assert_allclose(motion.sample(t).qvel[:, 0], degree * t ** max(degree - 1, 0), atol=1e-6)


@pytest.mark.parametrize("rate", [0, -100, np.nan, np.inf])
def test_rates_that_are_not_positive(rate):
    with pytest.raises(SettingsError, match=r"resampling rate .* Hz: choose one above 0"):
        Motion(np.arange(6.0), np.zeros((6, 1))).resampled(rate)


@pytest.mark.parametrize("rate", [0.1, 0.49, 1e9])
def test_rates_that_give_too_few_or_too_many_rows(rate):
    with pytest.raises(SettingsError, match=r"resampling rate .* Hz: m lasts 5 s: choose one from 0\.6 to 200000 Hz"):
        Motion(np.arange(6.0), np.zeros((6, 1)), "m").resampled(rate)


def test_importing_motion_is_light():
    code = (
        "import sys, mjhcmc.motion;"
        "print([m for m in ('mujoco', 'numba', 'pandas', 'matplotlib', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"

"""Motions: the low-pass filter, noise in q'', and the measured walk."""

import re

import numpy as np
import pytest
from motion_tools import DATA, DEG, LEG, TIME, WALK, measured, wave

from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError
from mjhcmc.motion import Motion


@pytest.mark.parametrize("hz", [3.0, 6.0, 20.0])
def test_the_filter_halves_the_power_at_the_cutoff_without_a_phase(hz):
    time = np.linspace(0, 10, 1001)
    wave = np.column_stack([np.sin(2 * np.pi * f * time) for f in (hz, hz / 10, 2 * hz)])
    filtered = Motion(time, wave).lowpassed(hz)
    middle = slice(300, 700)
    # two passes of second order, on the frequencies that the bilinear transform warps: 1/(1 + (sqrt 2 - 1) r^4)
    ratio = np.tan(np.pi * 0.01 * np.array([hz, hz / 10, 2 * hz])) / np.tan(np.pi * 0.01 * hz)
    gain = 1 / (1 + (np.sqrt(2) - 1) * ratio**4)
    assert gain[0] == pytest.approx(np.sqrt(0.5))
    np.testing.assert_allclose(filtered.qpos[middle], gain * wave[middle], atol=1e-9)


def test_the_filter_keeps_a_straight_line_to_its_ends():
    time = np.linspace(0, 1, 61)
    line = np.column_stack([3 - 2 * time])
    np.testing.assert_allclose(Motion(time, line).lowpassed(6).qpos, line, atol=2e-3)


def test_uneven_rows_are_resampled(write):
    rng = np.random.default_rng(1)
    time = np.sort(np.concatenate([np.arange(0, 2, 0.01), rng.uniform(0.5, 1, 30)]))
    motion = Motion.from_file(write(time, wave(time)), LEG, lowpass_hz=30)
    assert np.ptp(np.diff(motion.time)) < 1e-12
    t = np.linspace(0.3, 1.6, 50)
    np.testing.assert_allclose(motion.sample(t).qpos, wave(t) * DEG, atol=1e-6)
    assert re.fullmatch(r"low-pass filtered at 30 Hz, resampled each [\d.]+ ms", motion.notices[-1])


def test_filtering_a_crop_is_cropping_the_filtered_file():
    path = WALK / "subject01_walk_IK.mot"
    whole = Motion.from_file(path, LEG, lowpass_hz=6)
    crop = Motion.from_file(path, LEG, lowpass_hz=6, start=0.9, end=1.52)
    assert (crop.start, crop.end) == (0.9, 1.52)
    t = np.linspace(0.9, 1.52, 100)
    np.testing.assert_allclose(crop.sample(t).qpos, whole.sample(t).qpos, atol=1e-5)
    np.testing.assert_allclose(crop.sample(t).qacc, whole.sample(t).qacc, atol=0.02)


def test_filtering_a_crop_of_dense_rows_too(write):
    """Where 16 rows are far less than the filter's memory."""
    time = np.linspace(0, 3, 3001)
    noisy = wave(time) + np.random.default_rng(0).normal(0, 0.1, (3001, 3))
    path = write(time, noisy)
    whole, crop = (Motion.from_file(path, LEG, 6, **span) for span in ({}, {"start": 1, "end": 1.6}))
    t = np.linspace(1, 1.6, 50)
    np.testing.assert_allclose(crop.sample(t).qpos, whole.sample(t).qpos, atol=1e-7)


def test_only_the_filtered_motion_is_judged_where_a_filter_is_asked(write):
    time = np.linspace(0, 1, 101)
    values = np.column_stack([0 * time, 8 - 3 * (-1.0) ** np.arange(101), 0 * time])
    with pytest.raises(MotionError, match="joint knee is at 11 deg"):
        Motion.from_file(write(time, values), LEG)
    Motion.from_file(write(time, values), LEG, lowpass_hz=6)
    with pytest.raises(MotionError, match="filtered: joint knee is at 11"):
        Motion.from_file(write(time, values * 0 + [0, 11, 0]), LEG, lowpass_hz=6)


@pytest.mark.parametrize("hz", [0, -1, np.nan, np.inf, 10, 11])
def test_cutoffs_refused(write, hz):
    with pytest.raises(SettingsError, match=r"low-pass cutoff .* Hz"):
        Motion.from_file(write(TIME, DATA), LEG, lowpass_hz=hz)


def test_noise_that_dominates_is_told():
    path = WALK / "subject01_walk_IK.mot"
    message = Motion.from_file(path, LEG).noise_warning()
    assert re.search(
        r"subject01_walk_IK: .*5\d % of the power of q'' of joint hip lies above 15 Hz.*--lowpass 6", message
    )
    assert Motion.from_file(path, LEG, start=0.6, end=1.9).noise_warning()
    assert Motion.from_file(path, LEG, lowpass_hz=6).noise_warning() is None


@pytest.mark.parametrize("period", [0.2, 0.6])
@pytest.mark.parametrize("noise", [0, 0.1])
def test_noise_is_told_apart_from_fast_movement(write, period, noise):
    time = np.arange(0, 3 * period + 1e-9, 0.01)
    angles = 0.5 * (1 - np.cos(2 * np.pi * time / period))[:, None] * [10, -20, -10]
    angles = np.round(angles + noise * np.random.default_rng(0).normal(size=angles.shape), 10)
    told = Motion.from_file(write(time, angles), LEG).noise_warning()
    assert (told is not None) == (noise > 0)


def test_rounding_of_a_joint_held_still_is_no_noise():
    time = np.linspace(0, 2, 121)
    still = 0.3 + 1e-8 * np.random.default_rng(0).normal(size=(121, 1))
    assert Motion(time, still).noise_warning() is None


def test_the_adjusted_kinematics_are_smooth_and_repeat_a_time():
    with pytest.warns(MjhcmcWarning, match=r"1 row dropped that repeats .*: line 513 \(2\.499 s\)"):
        motion = Motion.from_file(WALK / "adjusted_end.sto", LEG)
    assert np.diff(motion.time).min() < 2e-4
    assert motion.noise_warning() is None
    assert motion.notices == ("columns not used: pelvis_tilt",)
    measured = Motion.from_file(WALK / "subject01_walk_IK.mot", LEG)
    t = np.linspace(2.0, 2.499, 50)
    assert np.abs(motion.sample(t).qpos - measured.sample(t).qpos).max() < 1.5 * DEG


def test_the_shipped_leg_takes_the_measured_walk():
    from mjhcmc.model import MuscleModel

    model = MuscleModel.load("leg8")
    _, angles = measured()
    motion = Motion.from_file(WALK / "subject01_walk_IK.mot", model)
    assert motion.joint_names == model.joint_names
    np.testing.assert_allclose(motion.qpos, angles * DEG)
    assert Motion.cosine(model, "fast").duration == pytest.approx(0.6)

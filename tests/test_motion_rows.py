"""Motions from files: cropping, gaps, rows that repeat, times that fall."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_tools import DATA, DEG, LEG, TIME, wave

from mjhcmc.errors import MjhcmcWarning, MotionError
from mjhcmc.io.opensim import write_table
from mjhcmc.motion import Motion


@given(start=st.floats(0, 0.6), length=st.floats(0.2, 0.4))
@settings(deadline=None, max_examples=40)
def test_a_crop_begins_and_ends_exactly_and_keeps_the_derivatives(tmp_path_factory, start, length):
    """The truth is a sine; the crop's derivatives at its ends are as good as the whole file's."""
    path = tmp_path_factory.getbasetemp() / "crop.mot"
    time = np.linspace(-1, 2, 301)
    write_table(path, LEG.joint_names, time, wave(time), name="m", in_degrees=True)
    motion = Motion.from_file(path, LEG, start=start, end=start + length)
    assert (motion.start, motion.end) == (start, start + length)
    sampled = motion.sample([start, start + length])
    w = np.array([2, 3, 4])
    truth = -(w**2) * wave(sampled.time) * DEG
    np.testing.assert_allclose(sampled.qacc, truth, atol=1e-6)
    with pytest.raises(MotionError, match="lies outside the motion"):
        motion.sample(start - 1e-6)


def test_half_a_crop(write):
    path = write(TIME, DATA)
    assert Motion.from_file(path, LEG, start=0.33).end == 1
    motion = Motion.from_file(path, LEG, end=0.33)
    assert (motion.start, motion.end) == (0, 0.33)
    motion = Motion.from_file(path, LEG, start=-5e-10, end=1 + 5e-10)
    assert (motion.start, motion.end) == (0, 1)


def test_only_rows_next_to_the_crop_matter(write):
    values = DATA.copy()
    values[2, 0], values[18, 1], values[19, 2] = np.nan, np.inf, 400  # lines 10, 26, 27 of the file
    time = TIME.copy()
    time[20] = 0.1
    path = write(time, values)
    motion = Motion.from_file(path, LEG, start=0.15, end=0.85)
    clean = Motion.from_file(write(TIME[3:18], DATA[3:18], name="clean.mot"), LEG)
    np.testing.assert_array_equal(motion.sample(0.4).qacc, clean.sample(0.4).qacc)
    for start, end, message in (
        (0.12, 0.85, r"m\.mot, line 10, column 'hip': nan: fill the gap, or crop it away"),
        (0.15, 0.88, r"m\.mot, line 26, column 'knee': inf"),
        (None, None, r"m\.mot, line 10, column 'hip': nan"),
    ):
        with pytest.raises(MotionError, match=message):
            Motion.from_file(path, LEG, start=start, end=end)


def test_rows_behind_a_gap_do_not_lead_the_spline(write):
    time = np.concatenate([[-9, -8.95], TIME])
    motion = Motion.from_file(write(time, np.vstack([[[90, -90, 50], [90, -90, 50]], DATA])), LEG, start=0)
    clean = Motion.from_file(write(TIME, DATA), LEG)
    np.testing.assert_array_equal(motion.sample(TIME).qacc, clean.sample(TIME).qacc)


def test_nan_in_a_column_not_used_does_not_matter(write):
    values = np.column_stack([DATA, np.full(21, np.nan)])
    Motion.from_file(write(TIME, values, (*LEG.joint_names, "other")), LEG)


def test_nan_in_time(write):
    time = TIME.copy()
    time[4] = np.nan
    for kwargs in ({}, {"start": 0.05}):
        with pytest.raises(MotionError, match=r"line 12, column 'time': nan"):
            Motion.from_file(write(time, DATA), LEG, **kwargs)
    with pytest.raises(MotionError, match=r"line 8, column 'time': nan"):
        Motion.from_file(write(np.full(21, np.nan), DATA), LEG, start=0.5)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"start": -0.1}, r"start -0\.1 s lies outside the file's times 0 \.\. 1 s"),
        ({"end": 1.1}, r"end 1\.1 s lies outside"),
        ({"start": float("nan")}, r"start nan s lies outside"),
        ({"start": 0.5, "end": 0.5}, r"start 0\.5 s is not before end 0\.5 s"),
        ({"start": 0.5, "end": 0.2}, r"start 0\.5 s is not before end 0\.2 s"),
        ({"start": 0.95}, r"2 rows from 0\.95 to 1 s: a motion needs at least 4"),
        ({"start": 0.51, "end": 0.54}, r"0 rows from 0\.51 to 0\.54 s"),
    ],
)
def test_crops_refused(write, kwargs, message):
    with pytest.raises(MotionError, match=message):
        Motion.from_file(write(TIME, DATA), LEG, **kwargs)


def test_fewer_than_four_rows(write):
    with pytest.raises(MotionError, match=r"m\.mot: 3 rows .*a motion needs at least 4"):
        Motion.from_file(write(TIME[:3], DATA[:3]), LEG)


def test_repeated_rows_are_dropped_with_a_warning(write):
    again = np.sort([*range(21), 5, 5, 9])
    time, values = TIME[again], DATA[again]
    values[6] += 9e-7
    time[7] += 5e-10
    with pytest.warns(MjhcmcWarning, match=r"3 rows dropped .*: line 14 \(0\.25 s\), line 15 .*, line 20") as warned:
        motion = Motion.from_file(write(time, values), LEG)
    assert len(warned) == 1
    np.testing.assert_array_equal(motion.qpos, DATA * DEG)
    values[6] += 2e-7
    with pytest.raises(MotionError, match=r"line 14: time 0\.25 s follows 0\.25 s: the same time with other values"):
        Motion.from_file(write(time, values), LEG)


def test_repeats_dropped_to_fewer_than_four_rows(write):
    with (
        pytest.warns(MjhcmcWarning, match="3 rows dropped"),
        pytest.raises(MotionError, match=r"3 rows from 0 to 0\.1 s: a motion needs at least 4"),
    ):
        Motion.from_file(write(TIME[[0, 0, 1, 1, 2, 2]], DATA[[0, 0, 1, 1, 2, 2]]), LEG)


def test_times_that_fall(write):
    time = TIME.copy()
    time[[7, 8]] = time[[8, 7]]
    with pytest.raises(MotionError, match=r"line 16: time 0\.35 s follows 0\.4 s: times must increase: remove"):
        Motion.from_file(write(time, DATA), LEG)

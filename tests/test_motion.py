"""Motions: the spline, the cosine movements, files onto joints, cropping, filtering, and what is refused."""

import json
import re
import subprocess
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError
from mjhcmc.io.opensim import read_table, write_table
from mjhcmc.motion import Motion

WALK = Path(__file__).parent / "data" / "walk"
DEG = np.pi / 180


@dataclass(frozen=True)
class Leg:
    name: str = "leg"
    joint_names: tuple[str, ...] = ("hip", "knee", "ankle")
    joint_is_rotation: np.ndarray = field(default_factory=lambda: np.ones(3, dtype=bool))
    joint_range: np.ndarray = field(
        default_factory=lambda: np.array([[-120.0, 120.0], [-120.0, 10.0], [-90.0, 90.0]]) * DEG
    )
    qpos_reference: np.ndarray = field(default_factory=lambda: np.zeros(3))
    column_map: dict[str, str] = field(
        default_factory=lambda: {
            "hip": "hip_flexion_r",
            "knee": "knee_angle_r",
            "ankle": "ankle_angle_r",
        }
    )


LEG = Leg()
CART = Leg(
    name="cart",
    joint_names=("rail", "pole"),
    joint_is_rotation=np.array([False, True]),
    joint_range=np.array([[-1.0, 1.0], [-np.inf, np.inf]]),
    qpos_reference=np.array([0.1, 0.2]),
    column_map={},
)


@pytest.fixture
def write(tmp_path):
    """Write a table and return its path; columns default to the leg's joints."""

    def write(time, values, columns=LEG.joint_names, in_degrees=True, name="m.mot"):
        path = tmp_path / name
        write_table(path, columns, time, values, name="m", in_degrees=in_degrees)
        return path

    return write


def _wave(time, amplitude=20.0):
    return amplitude * np.sin(np.outer(time, [2, 3, 4])) * [1, 0.4, 1]


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


# --- from file: columns -----------------------------------------------------------------------------------

TIME = np.linspace(0, 1, 21)
DATA = _wave(TIME)


def test_columns_in_any_order_degrees_and_notices(write):
    values = np.column_stack([DATA[:, 2], 90 * TIME, DATA[:, 0], DATA[:, 1], TIME])
    path = write(TIME, values, ["ankle", "pelvis_tilt", "hip", "knee", "pelvis_tx"])
    motion = Motion.from_file(path, LEG)
    np.testing.assert_allclose(motion.qpos, DATA * DEG, rtol=1e-15)
    assert motion.notices == ("columns not used: pelvis_tilt, pelvis_tx",)
    assert (motion.name, motion.joint_names) == ("m", LEG.joint_names)


def test_radians_and_slides_are_not_converted(write):
    values = np.column_stack([0.3 * TIME, 2 * TIME])
    for in_degrees, factor in ((False, 1), (True, DEG)):
        motion = Motion.from_file(write(TIME, values, ["rail", "pole"], in_degrees), CART)
        np.testing.assert_allclose(motion.qpos, values * [1, factor], rtol=1e-15)


def test_a_joint_takes_the_map_then_its_own_name_then_the_models_map(write, tmp_path):
    columns = ["hip_flexion_r", "knee_angle_r", "ankle_angle_r", "ankle", "hip_flexion_l"]
    values = np.column_stack([DATA, DATA[:, 2] + 5, -DATA[:, 0] + 1])
    path = write(TIME, values, columns)
    motion = Motion.from_file(path, LEG)
    np.testing.assert_allclose(motion.qpos / DEG, np.add(DATA, [0, 0, 5]))
    chosen = {"hip": "-hip_flexion_l", "ankle": "ankle_angle_r"}
    (tmp_path / "map.json").write_text(json.dumps(chosen))
    for given_map in (chosen, tmp_path / "map.json", str(tmp_path / "map.json")):
        motion = Motion.from_file(path, LEG, column_map=given_map)
        np.testing.assert_allclose(motion.qpos / DEG, DATA - [1, 0, 0], atol=1e-13)
    assert motion.notices == ("columns not used: hip_flexion_r, ankle",)


def test_a_shipped_map_may_flip_signs(write):
    model = replace(LEG, column_map={"hip": "h", "knee": "-k", "ankle": "a"})
    motion = Motion.from_file(write(TIME, DATA * [1, -1, 1], ["h", "k", "a"]), model)
    np.testing.assert_allclose(motion.qpos / DEG, DATA)


def test_opensim_paths_go_by_coordinate(write):
    columns = ["/jointset/hip_r/hip_flexion_r/speed", "/jointset/hip_r/hip_flexion_r/value"]
    columns += ["knee_r/knee_angle_r/value", "/jointset/ankle_r/ankle/value"]
    motion = Motion.from_file(write(TIME, np.column_stack([DATA[:, :1] * 9, DATA]), columns, name="S.STO"), LEG)
    np.testing.assert_allclose(motion.qpos / DEG, DATA)
    assert motion.notices == (f"columns not used: {columns[0]}",)


def test_two_opensim_paths_of_one_coordinate_are_refused(write):
    columns = ["/a/hip/value", "/b/hip/value", "knee", "ankle"]
    with pytest.raises(MotionError, match="both hold hip: name one in full"):
        Motion.from_file(write(TIME, DATA[:, [0, 0, 1, 2]], columns), LEG)


@pytest.mark.parametrize(
    ("column_map", "message"),
    [
        (None, r"no column for joint hip of model leg \(looked for hip and hip_flexion_r\); its columns are a, knee, "),
        ({"hip": "b"}, r"no column 'b', which the column map names for joint hip; its columns are a, knee, ankle"),
        ({"hop": "a"}, r"model leg has no joint hop: its joints are hip, knee, ankle"),
        ({"hip": 3}, r"joint 'hip' maps to 3"),
        ({"hip": "-"}, r"joint 'hip' maps to '-'"),
        ('["a"]', r"map\.json: holds no object"),
        ('{"hip": "a"', r"map\.json, line 1: not JSON"),
        (b"\xff\xfe", r"map\.json: not a text file"),
        ("missing", r"nothing\.json: cannot be read"),
    ],
)
def test_columns_refused(write, tmp_path, column_map, message):
    path = write(TIME, DATA, ["a", "knee", "ankle"])
    if column_map == "missing":
        column_map = tmp_path / "nothing.json"
    elif isinstance(column_map, (str, bytes)):
        content = column_map.encode() if isinstance(column_map, str) else column_map
        column_map = tmp_path / "map.json"
        column_map.write_bytes(content)
    with pytest.raises(MotionError, match=message) as raised:
        Motion.from_file(path, LEG, column_map=column_map)
    assert "\n" not in str(raised.value)


def test_other_suffixes_and_no_in_degrees_are_refused(write):
    with pytest.raises(MotionError, match=r"m\.csv: a motion file ends in \.mot or \.sto, not in '\.csv'"):
        Motion.from_file("m.csv", LEG)
    path = write(TIME, DATA)
    path.write_text(path.read_text().replace("inDegrees=yes\n", ""))
    with pytest.raises(MotionError, match=r"m\.mot: .*add the line inDegrees=yes .*before endheader"):
        Motion.from_file(path, LEG)


# --- from file: cropping and rows -------------------------------------------------------------------------


@given(start=st.floats(0, 0.6), length=st.floats(0.2, 0.4))
@settings(deadline=None, max_examples=40)
def test_a_crop_begins_and_ends_exactly_and_keeps_the_derivatives(tmp_path_factory, start, length):
    """The truth is a sine; the crop's derivatives at its ends are as good as the whole file's."""
    path = tmp_path_factory.getbasetemp() / "crop.mot"
    time = np.linspace(-1, 2, 301)
    write_table(path, LEG.joint_names, time, _wave(time), name="m", in_degrees=True)
    motion = Motion.from_file(path, LEG, start=start, end=start + length)
    assert (motion.start, motion.end) == (start, start + length)
    sampled = motion.sample([start, start + length])
    w = np.array([2, 3, 4])
    truth = -(w**2) * _wave(sampled.time) * DEG
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


# --- from file: units and ranges --------------------------------------------------------------------------


def _measured():
    table = read_table(WALK / "subject01_walk_IK.mot")
    used = [table.columns.index(name) for name in LEG.column_map.values()]
    return table.time, table.values[:, used]


def test_a_walk_in_radians_called_degrees_is_a_warning(write):
    time, angles = _measured()
    with pytest.warns(MjhcmcWarning, match=r"inDegrees=yes but no angle exceeds 1\.\d+, which looks like radians"):
        Motion.from_file(write(time, angles * DEG), LEG)


@pytest.mark.parametrize("amplitude", [20, 5, 2])
def test_small_movements_in_degrees_are_no_radians(write, amplitude):
    wave = amplitude / 2 * (1 - np.cos(2 * np.pi * TIME))[:, None] * [0.5, -1, -0.5]
    Motion.from_file(write(TIME, wave), LEG)


def test_a_joint_held_still_is_no_radians(write):
    Motion.from_file(write(TIME, np.zeros((21, 3))), LEG)


def test_degrees_called_radians(write):
    time, angles = _measured()
    path = write(time, angles, in_degrees=False)
    with pytest.raises(MotionError, match=r"joint knee .*inDegrees=no but angles reach 69\.4, .*like degrees"):
        Motion.from_file(path, LEG)
    free = replace(LEG, joint_range=np.full((3, 2), [-np.inf, np.inf]))
    with pytest.warns(MjhcmcWarning, match=r"which looks like degrees: if they are, write inDegrees=yes"):
        Motion.from_file(path, free)
    with pytest.raises(MotionError, match=r"as degrees the angles would fit: if they are, write inDegrees=yes"):
        Motion.from_file(write(TIME, DATA / 4, in_degrees=False), LEG)
    Motion.from_file(write(time, angles * DEG, in_degrees=False), LEG)


def test_out_of_range_names_joint_time_value_and_range(write):
    values = DATA.copy()
    values[10, 1] = 10 + 1e-6
    with pytest.raises(MotionError) as raised:
        Motion.from_file(write(TIME, values), LEG)
    assert re.search(
        r"m\.mot: joint knee is at 10\.000001 deg at 0\.5 s, outside its range -120 \.\. 10 deg in model leg: ",
        str(raised.value),
    )
    assert "inDegrees" not in str(raised.value)


def test_a_joint_may_rest_at_its_limit(write):
    knee = 10 + 1e-8 - 40 * (TIME - 0.5) ** 2  # 1e-8 deg is under the 1e-9 rad let pass
    motion = Motion.from_file(write(TIME, np.column_stack([0 * TIME, knee, 0 * TIME])), LEG)
    assert motion.sample(0.5).qpos[0, 1] == pytest.approx(10 * DEG)


def test_slides_are_judged_in_metres(write):
    values = np.column_stack([1.5 * TIME, TIME])
    with pytest.raises(MotionError, match=r"joint rail is at 1\.5 m at 1 s, outside its range -1 \.\. 1 m"):
        Motion.from_file(write(TIME, values, CART.joint_names, in_degrees=False), CART)


def test_the_spline_between_the_rows_is_judged_too(write):
    """Rows that all stay within the range, and a spline that leaves it between them."""
    knee = np.array([-60.0, -60, -60, 10, 10, -60, -60, -60])
    time = np.arange(8.0)
    values = np.column_stack([0 * knee, knee, 0 * knee])
    with pytest.raises(MotionError, match=r"spline between its rows: joint knee is at [12]\d\.\d+ deg at 3\.5 s"):
        Motion.from_file(write(time, values), LEG)


def test_only_the_crop_is_judged(write):
    values = np.column_stack([0 * TIME, 20 * TIME, 0 * TIME])
    Motion.from_file(write(TIME, values), LEG, end=0.5)
    with pytest.raises(MotionError, match="joint knee is at 20 deg at 1 s"):
        Motion.from_file(write(TIME, values), LEG)


# --- filter and noise -------------------------------------------------------------------------------------


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
    motion = Motion.from_file(write(time, _wave(time)), LEG, lowpass_hz=30)
    assert np.ptp(np.diff(motion.time)) < 1e-12
    t = np.linspace(0.3, 1.6, 50)
    np.testing.assert_allclose(motion.sample(t).qpos, _wave(t) * DEG, atol=1e-6)
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
    noisy = _wave(time) + np.random.default_rng(0).normal(0, 0.1, (3001, 3))
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
    _, angles = _measured()
    motion = Motion.from_file(WALK / "subject01_walk_IK.mot", model)
    assert motion.joint_names == model.joint_names
    np.testing.assert_allclose(motion.qpos, angles * DEG)
    assert Motion.cosine(model, "fast").duration == pytest.approx(0.6)


def test_importing_motion_is_light():
    code = (
        "import sys, mjhcmc.motion;"
        "print([m for m in ('mujoco', 'numba', 'pandas', 'matplotlib', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"

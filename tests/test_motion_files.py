"""Several motions at once: all read or none, and names that differ."""

import numpy as np
import pytest
from motion_tools import DATA, LEG, TIME

from mjhcmc.errors import MotionError, SettingsError
from mjhcmc.io.opensim import write_table
from mjhcmc.motion import Motion


@pytest.fixture
def put(tmp_path):
    def put(name, values=DATA, in_degrees=True):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_table(path, LEG.joint_names, TIME, values, name="m", in_degrees=in_degrees)
        return path

    return put


def test_motions_come_in_order_with_the_options_applied_to_each(put):
    paths = [put("b.mot"), put("a.sto", 0.5 * DATA), str(put("c.mot", -0.1 * DATA))]
    motions = Motion.from_files(paths, LEG, 5, start=0.2, end=0.9)
    alone = [Motion.from_file(path, LEG, 5, start=0.2, end=0.9) for path in paths]
    assert [motion.name for motion in motions] == ["b", "a", "c"]
    for one, other in zip(motions, alone, strict=True):
        np.testing.assert_array_equal(one.qpos, other.qpos)
        assert one.span == other.span
    assert [motion.name for motion in Motion.from_files(iter(paths[:1]), LEG)] == ["b"]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["left/walk.mot", "right/walk.mot", "run.mot"], ["left_walk", "right_walk", "run"]),
        (["a/left/walk.mot", "b/left/walk.mot"], ["a_left_walk", "b_left_walk"]),
        (["left/walk.mot", "left/walk.sto", "right/walk.mot"], ["left_walk_mot", "left_walk_sto", "right_walk"]),
        (["walk.mot", "walk.sto"], ["walk_mot", "walk_sto"]),
        (["x/Walk.mot", "y/walk.mot"], ["x_Walk", "y_walk"]),
        (["x/Walk.mot", "x/walk.mot"], ["Walk_mot_1", "walk_mot_2"]),
    ],
)
def test_names_differ_whatever_the_letters_case(put, names, expected):
    assert [motion.name for motion in Motion.from_files([put(name) for name in names], LEG)] == expected


def test_names_that_meet_after_a_folder_went_in_front(put):
    motions = Motion.from_files([put("x/a.mot"), put("y/a.mot"), put("z/x_a.mot")], LEG)
    assert len({motion.name for motion in motions}) == 3


def test_one_error_names_the_first_bad_file_and_the_others(put, tmp_path):
    good, bad = put("good.mot"), put("bad.mot", 20 * DATA)
    with pytest.raises(
        MotionError, match=r"bad\.mot: joint ankle .*; 2 more of the 4 files cannot be used: .*none\.mot, .*x\.txt$"
    ):
        Motion.from_files([good, bad, tmp_path / "none.mot", tmp_path / "x.txt"], LEG)
    with pytest.raises(MotionError, match=r"none\.mot: no such file: check the path$"):
        Motion.from_files([good, tmp_path / "none.mot"], LEG)


@pytest.mark.parametrize(
    ("paths", "options", "kind", "message"),
    [
        ([], {}, MotionError, "no motion files: name at least one"),
        ("a.mot", {}, SettingsError, r"takes a list of paths, not one path: write \['a.mot'\]"),
        (["a.mot", "./a.mot"], {}, MotionError, r"a\.mot: given twice: name each file once"),
        (["a.mot"], {"lowpass_hz": -1}, SettingsError, "low-pass cutoff -1 Hz"),
        (["a.mot"], {"angle_unit": "turns"}, SettingsError, "angle_unit 'turns'"),
        (["a.mot"], {"angles": "both"}, SettingsError, "angles 'both'"),
    ],
)
def test_refused_before_any_file_is_read(paths, options, kind, message):
    with pytest.raises(kind, match=message):
        Motion.from_files(paths, LEG, **options)

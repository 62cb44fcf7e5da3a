"""Motions from files: which column is whose, by maps and names."""

import json
from dataclasses import replace

import numpy as np
import pytest
from motion_tools import CART, DATA, DEG, LEG, TIME

from mjhcmc.errors import MotionError
from mjhcmc.motion import Motion


def test_columns_in_any_order_degrees_and_notices(write):
    values = np.column_stack([DATA[:, 2], 90 * TIME, DATA[:, 0], DATA[:, 1], TIME])
    path = write(TIME, values, ["ankle", "pelvis_tilt", "hip", "knee", "pelvis_tx"])
    motion = Motion.from_file(path, LEG)
    np.testing.assert_allclose(motion.qpos, DATA * DEG, rtol=1e-15)
    assert motion.notices == ("columns not used: pelvis_tilt, pelvis_tx",)
    assert (motion.name, motion.joint_names) == ("m", LEG.joint_names)


@pytest.mark.parametrize(
    ("columns", "column_map", "example"),
    [
        (["hip", "knee"], None, '{"ankle": "its column"}'),
        (["hip_flexion_r", "q/knee"], None, '{"ankle": "its column"}'),
        (["hip", "knee", "pelvis_tilt"], None, '{"ankle": "pelvis_tilt"}'),
        (["hip", "crank"], {"knee": "-crank"}, '{"ankle": "its column"}'),
        (["ankle", "crank", "knee"], None, '{"hip": "crank"}'),
    ],
)
def test_the_map_suggested_gives_no_joint_the_column_of_another(write, columns, column_map, example):
    path = write(TIME, DATA[:, : len(columns)], columns)
    with pytest.raises(MotionError, match=r"no column for joint") as raised:
        Motion.from_file(path, LEG, column_map=column_map)
    assert str(raised.value).endswith(f": map one with a column map such as {example}")


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


def test_other_suffixes_are_refused():
    with pytest.raises(
        MotionError, match=r"m\.xlsx: a motion file ends in \.mot, \.sto, \.csv, \.trc or \.c3d, not in '\.xlsx'"
    ):
        Motion.from_file("m.xlsx", LEG)
    with pytest.raises(MotionError, match=r"m: a motion file ends in .*, not in 'nothing'"):
        Motion.from_file("m", LEG)


@pytest.mark.parametrize(
    "text",
    [
        "hip,-b\nankle,a",
        "joint,column\nhip,-b\nankle,a\n",
        "\ufeffJoint; column\r\n\r\n# the other leg\r\n hip ; -b\r\nankle;a\r\n",
        'hip\t"-b"\nankle\ta',
    ],
)
def test_a_map_may_be_a_csv_of_two_columns(write, tmp_path, text):
    path = write(TIME, DATA, ["b", "knee", "a"])
    (tmp_path / "map.csv").write_text(text, newline="")
    motion = Motion.from_file(path, LEG, column_map=tmp_path / "map.csv")
    np.testing.assert_allclose(motion.qpos / DEG, DATA * [-1, 1, 1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hip", r"map\.csv, line 1: 'hip' are no two names: write joint,column"),
        ("joint,column\nhip,a,b", r"map\.csv, line 2: 'hip,a,b' are no two names"),
        ("hip,", r"map\.csv, line 1: 'hip,' are no two names"),
        ("hip,a\nhip,b", r"map\.csv, line 2: joint 'hip' stands twice"),
        ("hip,-", r"joint 'hip' maps to '-'"),
        ("hip,c", r"no column 'c', which the column map names for joint hip"),
        ("hop,a", r"model leg has no joint hop"),
        ("joint,column\n", r"map\.csv: holds no pair of names"),
        ('hip,"a', r"map\.csv, line 1: a quote that does not end"),
        ("", r"column map .*map\.csv: the file is empty"),
        (None, r"column map .*map\.csv: no such file"),
    ],
)
def test_csv_maps_refused(write, tmp_path, text, message):
    path = write(TIME, DATA, ["a", "knee", "ankle"])
    if text is not None:
        (tmp_path / "map.csv").write_text(text)
    with pytest.raises(MotionError, match=message) as raised:
        Motion.from_file(path, LEG, column_map=tmp_path / "map.csv")
    assert "\n" not in str(raised.value)


def test_many_columns_not_used_are_counted(write):
    columns = [*LEG.joint_names, *(f"c{i}" for i in range(20))]
    motion = Motion.from_file(write(TIME, np.column_stack([DATA, np.zeros((21, 20))]), columns), LEG)
    assert motion.notices == (f"columns not used: {', '.join(f'c{i}' for i in range(12))} and 8 more",)

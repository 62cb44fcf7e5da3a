"""Motions, tables and markers written and read back: to the last bit, with their units and headers; by OpenSim too."""

import numpy as np
import pytest
from conftest import load_xml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from motion_tools import CART, LEG, WALK, Leg
from riders import FREE, RIDER

import mjhcmc
from mjhcmc.errors import OutputError
from mjhcmc.io.csv_table import read_csv
from mjhcmc.io.motion_writer import write_motion
from mjhcmc.io.opensim import read_table, rewrite_table, write_table
from mjhcmc.io.trc import read_trc, rewrite_markers, write_trc
from mjhcmc.motion import Motion

TIME = np.linspace(0.6, 1.9, 27)
QPOS = np.column_stack([0.5 * np.sin(7 * TIME), -1 + 0.9 * np.cos(5 * TIME), 0.3 * np.sin(11 * TIME)])


@pytest.fixture
def motion():
    return Motion(TIME, QPOS, "walk", joint_names=LEG.joint_names)


# --- motions --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".mot", ".sto"])
def test_a_motion_in_radians_comes_back_bit_for_bit(tmp_path, motion, suffix):
    path = write_motion(motion, LEG, tmp_path / f"walk{suffix}", angle_unit="rad")
    table = read_table(path)
    assert table.columns == tuple(LEG.column_map.values())
    assert table.in_degrees is False
    back = Motion.from_file(path, LEG)
    np.testing.assert_array_equal(back.time, TIME)
    np.testing.assert_array_equal(back.qpos, QPOS)
    assert (back.name, back.notices) == ("walk", ())


@given(arrays(np.float64, (5, 3), elements=st.floats(-1.5, 0.15, allow_subnormal=False)))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_degrees_come_back_within_two_units_in_the_last_place(tmp_path, qpos):
    path = tmp_path / "m.mot"
    write_motion(Motion(np.arange(5.0), qpos), LEG, path)
    table = read_table(path)
    assert table.in_degrees is True
    np.testing.assert_allclose(table.values, np.rad2deg(qpos), rtol=1e-15)
    back = table.values * (np.pi / 180)
    assert (np.abs(back - qpos) <= 2 * np.spacing(np.abs(qpos))).all()


def test_slides_stay_in_metres_and_signs_follow_the_map(tmp_path):
    model = Leg(
        name="cart", joint_names=CART.joint_names, joint_is_rotation=CART.joint_is_rotation,
        joint_range=CART.joint_range, qpos_reference=CART.qpos_reference,
        column_map={"rail": "-cart_tx", "pole": "-pole_angle"},
    )  # fmt: skip
    time = np.arange(6) / 10
    motion = Motion(time, np.column_stack([0.5 * time, np.pi * time]))
    table = read_table(write_motion(motion, model, tmp_path / "cart.mot"))
    assert table.columns == ("cart_tx", "pole_angle")
    np.testing.assert_array_equal(table.values[:, 0], 0.0 - 0.5 * time)
    np.testing.assert_allclose(table.values[:, 1], -180 * time, rtol=1e-15)
    assert "-0.0" not in (tmp_path / "cart.mot").read_text().splitlines()[7].split("\t")
    np.testing.assert_array_equal(Motion.from_file(tmp_path / "cart.mot", model).qpos[:, 0], motion.qpos[:, 0])


def test_a_cropped_motion_begins_and_ends_at_its_span(tmp_path, motion):
    cropped = Motion(TIME, QPOS, "walk", joint_names=LEG.joint_names, span=(0.8201, TIME[20]))
    back = Motion.from_file(write_motion(cropped, LEG, tmp_path / "w.mot", angle_unit="rad"), LEG)
    np.testing.assert_array_equal(back.time, [0.8201, *TIME[5:21]])
    np.testing.assert_array_equal(back.qpos[1:], QPOS[5:21])
    np.testing.assert_array_equal(back.qpos[0], motion.sample(0.8201).qpos[0])


def test_with_the_rows_that_lead_it_a_cropped_motion_is_the_same(tmp_path):
    cropped = Motion(TIME, QPOS, "walk", joint_names=LEG.joint_names, span=(0.8201, 1.2345))
    path = write_motion(cropped, LEG, tmp_path / "w.mot", angle_unit="rad", lead=True)
    back = Motion.from_file(path, LEG, start=0.8201, end=1.2345)
    assert (back.start, back.end) == (0.8201, 1.2345)
    times = np.linspace(0.8201, 1.2345, 40)
    np.testing.assert_allclose(back.sample(times).qacc, cropped.sample(times).qacc, atol=1e-5)


def test_a_motion_shorter_than_its_rows_step_is_two_rows(tmp_path):
    short = Motion(TIME, QPOS, joint_names=LEG.joint_names, span=(0.81, 0.82))
    np.testing.assert_array_equal(read_table(write_motion(short, LEG, tmp_path / "s.mot")).time, [0.81, 0.82])


def test_a_motion_named_like_a_header_is_written(tmp_path):
    for name in ("nRows=7\nendheader", "endheader", "datarows 5", "name x", " a  b "):
        path = write_motion(Motion(TIME, QPOS, name), LEG, tmp_path / "m.mot")
        assert read_table(path).values.shape == QPOS.shape
        assert "\n" not in read_table(path).name


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path": "m.csv"}, r"m\.csv: a motion is written to \.mot or \.sto, not to '\.csv'"),
        ({"angle_unit": "turns"}, r"m\.mot: angle_unit 'turns': choose 'deg' or 'rad'"),
        ({"model": CART}, r"m\.mot: .*walk moves hip, knee, ankle, model cart has the joints rail, pole: give the"),
        (
            {"model": Leg(column_map={"hip": "hip flexion"})},
            r"joint 'hip' would be called 'hip flexion', and OpenSim's names hold no blanks: rename",
        ),
        ({"model": Leg(column_map={"hip": "knee"})}, r"column 'knee' would be written twice"),
        ({"path": "absent/m.mot"}, r"there is no folder .*absent: create it first"),
    ],
)
def test_motions_that_cannot_be_written_leave_nothing(tmp_path, motion, change, message):
    arguments = {"motion": motion, "model": LEG, "path": "m.mot"} | change
    arguments["path"] = tmp_path / arguments["path"]
    with pytest.raises(OutputError, match=message) as raised:
        write_motion(**arguments)
    assert "\n" not in str(raised.value)
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def rider():
    """A leg under a free pelvis, 1 m up."""
    return load_xml(RIDER.format(root=FREE))


def test_a_free_joint_that_stays_is_left_out_and_held_there(tmp_path, rider):
    motion = mjhcmc.Motion.cosine(rider, amplitudes={"knee": 0.5}, period=1.0)
    path = motion.save(tmp_path / "m.mot", rider, angle_unit="rad")
    assert read_table(path).columns == ("hip", "knee")
    np.testing.assert_array_equal(Motion.from_file(path, rider).qpos, motion.qpos)


@pytest.mark.parametrize(("angle_unit", "tolerance"), [("rad", 0.0), ("deg", 1e-15)])
def test_a_free_joint_that_moves_has_a_column_a_coordinate(tmp_path, rider, angle_unit, tolerance):
    half = 0.4 * np.sin(3 * TIME)
    qpos = np.tile(rider.qpos_reference, (len(TIME), 1))
    qpos[:, 0], qpos[:, 3], qpos[:, 5] = 0.9 * TIME, np.cos(half), np.sin(half)
    qpos[:, 7:] = QPOS[:, :2]
    motion = Motion(TIME, qpos).on(rider, rider.quaternions)
    path = motion.save(tmp_path / "m.mot", rider, angle_unit=angle_unit)
    table = read_table(path)
    assert table.columns == rider.joint_names
    np.testing.assert_array_equal(table.values[:, :7], motion.qpos[:, :7])  # metres and quaternions in any unit
    back = Motion.from_file(path, rider)
    np.testing.assert_allclose(back.qpos, motion.qpos, rtol=0, atol=tolerance)
    again = back.on(rider, rider.quaternions).sample(TIME)
    np.testing.assert_allclose(again.qvel, motion.sample(TIME).qvel, atol=1e-9)


def test_a_leg_that_only_rides_is_written_whole(tmp_path, rider):
    """Without hip and knee in the file there would be no motion to read: joints that are led do not make one."""
    still = Motion(TIME, np.tile(rider.qpos_reference, (len(TIME), 1)))
    path = still.save(tmp_path / "m.mot", rider)
    np.testing.assert_array_equal(Motion.from_file(path, rider).qpos, still.qpos)


def test_joints_without_a_map_go_by_their_own_names(tmp_path, two_joints):
    motion = mjhcmc.Motion.cosine(two_joints, amplitudes={"elbow": 0.5}, period=1.0)
    path = write_motion(motion, two_joints, tmp_path / "arm.mot", angle_unit="rad")
    assert read_table(path).columns == ("shoulder", "elbow")
    np.testing.assert_array_equal(mjhcmc.Motion.from_file(path, two_joints).qpos, motion.qpos)


# --- tables ---------------------------------------------------------------------------------------------------

_WORD = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc", "Z"], exclude_characters="="), min_size=1)


@given(
    name=st.just("") | _WORD,
    extra=st.dictionaries(_WORD, _WORD | st.just("a = b"), max_size=3),
    in_degrees=st.sampled_from([True, False, None]),
    values=arrays(np.float64, (2, 3)),
)
@example(name="endheader", extra={}, in_degrees=None, values=np.zeros((2, 3)))
@example(name="a", extra={"endheader": "1", "inDegrees": "yes"}, in_degrees=None, values=np.zeros((2, 3)))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_a_table_is_refused_or_comes_back_whole(tmp_path, name, extra, in_degrees, values):
    path, again = tmp_path / "t.sto", tmp_path / "again.sto"
    try:
        write_table(path, ["a b", "c"], values[:, 0], values[:, 1:], name=name, in_degrees=in_degrees, extra=extra)
    except OutputError:
        return
    table = read_table(path)
    assert (table.name, table.in_degrees, table.columns) == (name, in_degrees, ("a b", "c"))
    assert extra.items() <= table.header.items()
    assert np.column_stack([table.time, table.values]).tobytes() == _nans_alike(values).tobytes()
    rewrite_table(again, table)
    assert again.read_bytes() == path.read_bytes()


def _nans_alike(values):
    """Text has one NaN, doubles have many."""
    return np.where(np.isnan(values), np.nan, values)


def test_a_measured_table_written_again_is_the_same(tmp_path):
    first = read_table(WALK / "subject01_walk_IK.mot")
    rewrite_table(tmp_path / "again.mot", first)
    again = read_table(tmp_path / "again.mot")
    for key in ("name", "in_degrees", "header", "columns"):
        assert getattr(again, key) == getattr(first, key), key
    np.testing.assert_array_equal(again.time, first.time)
    np.testing.assert_array_equal(again.values, first.values)


def test_a_csv_with_units_of_its_own_is_no_opensim_table(tmp_path):
    (tmp_path / "a.csv").write_text("time,hip (deg)\n0,1\n1,2\n")
    with pytest.raises(OutputError, match=r"columns of .*a\.csv have units of their own"):
        rewrite_table(tmp_path / "a.mot", read_csv(tmp_path / "a.csv"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"extra": {"nRows": "7"}}, r"t\.mot: header line nRows=7 cannot be written: the table says it itself"),
        ({"extra": {"a=b": "c"}}, r"header line 'a=b'='c' cannot be written: keys hold no equals sign"),
        ({"extra": {"a": "b\nendheader"}}, r"header line 'a'='b\\nendheader' cannot be written"),
        ({"extra": {"": "b"}}, r"header line ''='b' cannot be written"),
        ({"name": "datacolumns 3"}, r"table name 'datacolumns 3' cannot be written: .* reads as a header line"),
        ({"name": "EndHeader"}, r"table name 'EndHeader' cannot be written"),
        ({"time": [], "values": np.zeros((0, 1))}, r"cannot write a table without rows: give at least one"),
    ],
)
def test_tables_that_could_not_be_read_leave_nothing(tmp_path, change, message):
    arguments = {"columns": ["a"], "time": [0.0], "values": [[1.0]], "name": "n", "in_degrees": True} | change
    with pytest.raises(OutputError, match=message) as raised:
        write_table(tmp_path / "t.mot", **arguments)
    assert "\n" not in str(raised.value)
    assert not list(tmp_path.iterdir())


# --- markers --------------------------------------------------------------------------------------------------

HEADER = {"CameraRate": "200", "OrigDataRate": "250.5", "OrigDataStartFrame": "60", "OrigNumFrames": "999"}


@pytest.mark.parametrize("unit", ["mm", "cm", "m"])
def test_markers_written_again_keep_unit_header_and_bits(tmp_path, unit):
    positions = np.random.default_rng(1).normal(size=(4, 2, 3)) / 3
    positions[2, 1] = np.nan
    write_trc(tmp_path / "a.trc", ["R.ASIS", "S:knee"], np.arange(4) / 3, positions, unit=unit, header=HEADER)
    first = read_trc(tmp_path / "a.trc")
    assert first.unit == unit
    assert HEADER.items() <= first.header.items()
    assert list(first.header)[:5] == ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"]
    (tmp_path / "b").mkdir()
    rewrite_markers(tmp_path / "b" / "a.trc", first)
    assert (tmp_path / "b" / "a.trc").read_bytes() == (tmp_path / "a.trc").read_bytes()
    np.testing.assert_array_equal(read_trc(tmp_path / "b" / "a.trc").positions, positions)


def test_counts_and_a_rate_that_does_not_fit_are_not_taken_over(tmp_path):
    header = {
        "DataRate": "1000",
        "NumFrames": "9",
        "nummarkers": "9",
        "Units": "inch",
        "camerarate": "5",
        "Subject": "01",
    }
    write_trc(tmp_path / "a.trc", ["a"], [0, 0.01, 0.02], np.zeros((3, 1, 3)), header=header)
    read = read_trc(tmp_path / "a.trc").header
    assert "Subject" not in read
    assert (read["DataRate"], read["CameraRate"], read["NumFrames"], read["Units"]) == ("100", "5", "3", "mm")


@pytest.mark.parametrize("bad", ["", "1\t2", "1\n2", " 1"])
def test_header_entries_that_would_shift_others_are_refused(tmp_path, bad):
    with pytest.raises(OutputError, match=r"a\.trc: header .* cannot be written"):
        write_trc(tmp_path / "a.trc", ["a"], [0, 1], np.zeros((2, 1, 3)), header={"CameraRate": bad})
    assert not list(tmp_path.iterdir())


# --- OpenSim itself, where it is installed --------------------------------------------------------------------


@pytest.fixture(scope="module")
def opensim():
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("error")
    return opensim


def test_opensim_reads_a_motion(opensim, tmp_path, leg8, slow):
    path = write_motion(slow, leg8, tmp_path / "slow.mot")
    table = opensim.TimeSeriesTable(str(path))
    assert table.getColumnLabels() == ("hip_flexion_r", "knee_angle_r", "ankle_angle_r")
    assert table.getTableMetaDataAsString("inDegrees") == "yes"
    np.testing.assert_array_equal(table.getIndependentColumn(), slow.time)
    np.testing.assert_allclose(table.getMatrix().to_numpy(), np.rad2deg(slow.qpos), rtol=1e-15, atol=1e-300)
    storage = opensim.Storage(str(path))
    assert (storage.getSize(), storage.isInDegrees()) == (len(slow.time), True)


def test_opensims_own_table_comes_back_from_us(opensim, tmp_path, leg8, slow):
    """Ours to OpenSim, OpenSim's own writer, and back: what it writes has 15 digits or so."""
    write_motion(slow, leg8, tmp_path / "slow.sto", angle_unit="rad")
    opensim.STOFileAdapter.write(opensim.TimeSeriesTable(str(tmp_path / "slow.sto")), str(tmp_path / "theirs.sto"))
    motion = mjhcmc.Motion.from_file(tmp_path / "theirs.sto", leg8)
    np.testing.assert_allclose(motion.qpos, slow.qpos, atol=1e-14)


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1e3), ("cm", 1e2), ("m", 1)])
def test_opensim_reads_markers(opensim, tmp_path, unit, scale):
    positions = np.random.default_rng(2).normal(size=(5, 3, 3))
    positions[1, 2] = positions[2, 0] = positions[3] = np.nan
    time = 0.59 + np.arange(5) / 100
    write_trc(tmp_path / "m.trc", ["R.ASIS", "L.ASIS", "knee"], time, positions, unit=unit, header=HEADER)
    table = opensim.TimeSeriesTableVec3(str(tmp_path / "m.trc"))
    assert table.getColumnLabels() == ("R.ASIS", "L.ASIS", "knee")
    assert table.getTableMetaDataAsString("Units") == unit
    assert table.getTableMetaDataAsString("CameraRate") == "200"
    np.testing.assert_array_equal(table.getIndependentColumn(), time)
    for i in range(3):
        column = table.getDependentColumn(table.getColumnLabels()[i])
        theirs = np.array([[column[k][j] for j in range(3)] for k in range(5)])
        np.testing.assert_allclose(theirs, scale * positions[:, i], rtol=1e-14)
    data = opensim.MarkerData(str(tmp_path / "m.trc"))
    assert (data.getNumFrames(), data.getNumMarkers()) == (5, 3)


def test_we_read_markers_that_opensim_writes(opensim, tmp_path):
    positions = np.random.default_rng(3).normal(size=(4, 2, 3))
    write_trc(tmp_path / "m.trc", ["a", "b"], np.arange(4) / 50, positions)
    opensim.TRCFileAdapter.write(opensim.TimeSeriesTableVec3(str(tmp_path / "m.trc")), str(tmp_path / "theirs.trc"))
    table = read_trc(tmp_path / "theirs.trc")
    assert table.names == ("a", "b")
    np.testing.assert_allclose(table.positions, positions, atol=1e-6)

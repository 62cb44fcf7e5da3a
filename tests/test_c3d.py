"""C3D files, written here through ezc3d (no package ships a recorded one): markers, force plates, what is refused."""

import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_marker_motions import QPOS, SITES, TIME, synthesise

from mjhcmc.errors import MotionError, OutputError, SettingsError
from mjhcmc.io.c3d import open_c3d, read_c3d
from mjhcmc.io.force_plates import force_plates, write_force_plates
from mjhcmc.io.opensim import read_table
from mjhcmc.io.trc import read_markers, read_trc, rewrite_markers
from mjhcmc.motion import Motion

ezc3d = pytest.importorskip("ezc3d")

RATE, SUB = 100.0, 10  # frames a second, samples a frame
N_FRAME = 20
FLOAT32 = 2.0**-23  # relative: the format's own precision


def write_c3d(
    path, points, names, *, unit="mm", first_frame=1, rate=RATE, channels=None, units=(), plates=None, more=()
):
    """points (T, n, 3) in the file's unit, channels (T_channel, n_channel); plates: FORCE_PLATFORM's parameters."""
    c = ezc3d.c3d()
    T, n = points.shape[:2]
    homogeneous = np.ones((4, n, T))
    homogeneous[:3] = np.moveaxis(points, -1, 0).swapaxes(1, 2)
    gaps = np.isnan(homogeneous).any(axis=0)
    homogeneous[:3, gaps] = 0
    c["parameters"]["POINT"]["RATE"]["value"] = [rate]
    c["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    c["parameters"]["POINT"]["LABELS"]["value"] = list(names)
    c["data"]["points"] = homogeneous
    c["data"]["meta_points"]["residuals"] = np.where(gaps, -1.0, 0.0)[None]
    c["data"]["meta_points"]["camera_masks"] = np.zeros((7, n, T), dtype=bool)
    if channels is not None:
        c["parameters"]["ANALOG"]["RATE"]["value"] = [rate * len(channels) / T]
        c["parameters"]["ANALOG"]["LABELS"]["value"] = [f"c{i}" for i in range(channels.shape[1])]
        c["parameters"]["ANALOG"]["UNITS"]["value"] = list(units)
        c["data"]["analogs"] = channels.T[None]
    for key, value in (plates or {}).items():
        c.add_parameter("FORCE_PLATFORM", key, np.asarray(value, dtype=float))
        if key in ("USED", "TYPE", "ZERO", "CHANNEL"):  # whole numbers by the format
            c["parameters"]["FORCE_PLATFORM"][key] |= {"type": 2, "value": np.asarray(value, dtype=int)}
    for key, value in more:
        c.add_parameter("POINT", key, value)
    c["header"]["points"]["first_frame"] = first_frame - 1
    c.write(str(path))
    return path


@pytest.fixture
def points():
    rng = np.random.default_rng(0)
    points = rng.uniform(100, 1800, (N_FRAME, 3, 3)).astype(np.float32).astype(float)
    points[4:7, 1] = np.nan
    return points


# --- markers --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "metre"), [("mm", 1000), ("cm", 100), ("m", 1), ("Millimeters", 1000)])
def test_markers_in_metres_with_their_gaps(tmp_path, points, unit, metre):
    table = read_c3d(write_c3d(tmp_path / "a.c3d", points, ["LASI", "R:KNE", "*9"], unit=unit, first_frame=60))
    assert table.names == ("LASI", "R:KNE", "*9")
    np.testing.assert_array_equal(table.positions, points / metre)
    assert np.isnan(table.positions[4:7, 1]).all()
    np.testing.assert_allclose(table.time, 0.59 + np.arange(N_FRAME) / RATE, rtol=1e-14)
    assert (table.row_word, table.line_numbers[0], table.line_numbers[-1]) == ("frame", 60, 79)


def test_a_c3d_becomes_a_trc(tmp_path, points):
    table = read_markers(write_c3d(tmp_path / "a.c3d", points, ["a", "b", "c"]).rename(tmp_path / "A.C3D"))
    rewrite_markers(tmp_path / "a.trc", table)
    again = read_trc(tmp_path / "a.trc")
    np.testing.assert_array_equal(again.positions, table.positions)
    np.testing.assert_array_equal(again.time, table.time)


def test_points_at_the_very_origin_were_not_seen(tmp_path, points):
    points[3, 0] = 0
    points[8, 0, 1] = 0
    positions = read_c3d(write_c3d(tmp_path / "a.c3d", points, ["a", "b", "c"])).positions
    assert np.isnan(positions[3, 0]).all()
    assert not np.isnan(positions[8, 0]).any()


def test_points_that_are_no_positions_are_no_markers(tmp_path, points):
    file = write_c3d(tmp_path / "a.c3d", points, ["LKneeAngles", "KNE", "LAnkleMoment"], more=[
        ("ANGLES", ["LKneeAngles "]), ("MOMENTS", ["none"]), ("MOMENTS2", ["LAnkleMoment"]), ("SCALE", [-1.0]),
    ])  # fmt: skip
    assert read_c3d(file).names == ("KNE",)


def test_labels_go_on_in_a_second_parameter(tmp_path, points):
    file = write_c3d(tmp_path / "a.c3d", points, ["a", "b"], more=[("LABELS2", ["c"])])
    assert open_c3d(file).point_names == ("a", "b", "c")
    assert read_c3d(write_c3d(tmp_path / "b.c3d", points, ["a", "b", ""])).names == ("a", "b")


def test_angles_from_a_c3d_are_those_that_made_it(leg8, tmp_path):
    """Positions are stored in single precision, some 1e-7 of 1 m."""
    points = 1e3 * synthesise(leg8)
    path = write_c3d(tmp_path / "walk.c3d", points, SITES, rate=50.0, first_frame=101)
    motion = Motion.from_file(path, leg8)
    np.testing.assert_allclose(motion.time, TIME, atol=1e-12)
    np.testing.assert_allclose(motion.qpos, QPOS, atol=1e-5)
    assert motion.notices[0].startswith("inverse kinematics on 13 markers: ")


def test_a_gap_that_hides_a_joint_names_the_frame(leg8, tmp_path):
    points = 1e3 * synthesise(leg8)
    points[7, :4] = np.nan
    path = write_c3d(tmp_path / "walk.c3d", points, SITES, rate=50.0, first_frame=101)
    with pytest.raises(MotionError, match=r"walk\.c3d, frame 108: at 2\.14 s markers .*fill the gap"):
        Motion.from_file(path, leg8)


@pytest.mark.parametrize(("scale", "precision"), [(-1.0, 1e-7), (0.1, 1e-4)])
def test_files_of_another_writer(tmp_path, points, scale, precision):
    """Real numbers, and integers in steps of .1 mm (cut off, not rounded), as the package c3d writes them."""
    c3d = pytest.importorskip("c3d")
    writer = c3d.Writer(point_rate=50, analog_rate=100, point_scale=scale)
    frames = np.zeros((N_FRAME, 3, 5), dtype=np.float32)
    frames[:, :, :3] = np.nan_to_num(points)
    frames[np.isnan(points).any(axis=2), 3] = -1
    analog = np.arange(4.0).reshape(2, 2)
    writer.add_frames([(frame, analog) for frame in frames])
    writer.set_point_labels(["AA", "BB", "CC"])
    writer.set_analog_labels(["x", "y"])
    writer.set_analog_scales([1.0, 1.0])
    writer.set_analog_offsets([0, 0])
    with (tmp_path / "a.c3d").open("wb") as stream:
        writer.write(stream)
    table, file = read_c3d(tmp_path / "a.c3d"), open_c3d(tmp_path / "a.c3d")
    assert table.names == ("AA", "BB", "CC")
    np.testing.assert_allclose(table.time, np.arange(N_FRAME) / 50, atol=1e-15)
    np.testing.assert_allclose(table.positions, points / 1e3, rtol=0, atol=precision)
    np.testing.assert_array_equal(file.channels, np.tile(analog, N_FRAME))
    assert file.channel_rate == 100


# --- what is refused ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"a\.c3d: the file is empty"),
        (b"x", r"a\.c3d: not a C3D file: give one, or markers as \.trc"),
        (b"PathFileType\t4", r"a\.c3d: not a C3D file"),
        (b"\x02\x50" + bytes(100), r"a\.c3d: cut off after 102 bytes of its header"),
        (b"\x02\x50" + bytes(510), r"a\.c3d: cut off after 512 bytes of its header"),
        (b"\x02\x50" + bytes(2000), r"a\.c3d: ezc3d cannot read it \(.*\): the file is damaged or cut off"),
    ],
)
def test_files_that_are_none(tmp_path, content, message):
    (tmp_path / "a.c3d").write_bytes(content)
    with pytest.raises(MotionError, match=message) as raised:
        read_c3d(tmp_path / "a.c3d")
    assert "\n" not in str(raised.value)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(MotionError, match=r"no\.c3d: no such file"):
        read_c3d(tmp_path / "no.c3d")
    (tmp_path / "a.c3d").mkdir()
    with pytest.raises(MotionError, match="is a folder: name a file"):
        read_c3d(tmp_path / "a.c3d")


def test_every_cut_is_refused(tmp_path, points):
    """ezc3d itself reads a file that is cut off as a shorter trial."""
    whole = write_c3d(tmp_path / "a.c3d", points, ["a", "b", "c"]).read_bytes()
    data = 4 * 4 * 3 * N_FRAME  # bytes of the points
    start = 512 * (struct.unpack("<H", whole[16:18])[0] - 1)  # the header's word for where data begins
    assert start + data <= len(whole)
    for cut in (513, 600, start - 100, start + 1, start + data // 2, start + data - 1):
        (tmp_path / "cut.c3d").write_bytes(whole[:cut])
        with pytest.raises(MotionError, match=r"cut\.c3d: .*cut off"):
            read_c3d(tmp_path / "cut.c3d")
    (tmp_path / "cut.c3d").write_bytes(whole[: start + data])
    assert read_c3d(tmp_path / "cut.c3d").positions.shape == (N_FRAME, 3, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unit": "inch"}, r"a\.c3d: POINT:UNITS is 'inch': export it in mm, cm or m"),
        ({"unit": ""}, r"a\.c3d: POINT:UNITS is '': export it"),
        ({"names": ["a", "b", "a"]}, r"a\.c3d: marker 'a' stands twice: rename or remove one"),
        ({"more": [("ANGLES", ["a", "b", "c"])]}, r"a\.c3d: no markers, of 3 points: export the trial with labels"),
    ],
)
def test_markers_that_cannot_be_used(tmp_path, points, change, message):
    arguments = {"points": points, "names": ["a", "b", "c"]} | change
    with pytest.raises(MotionError, match=message):
        read_c3d(write_c3d(tmp_path / "a.c3d", **arguments))


def test_without_the_package_the_remedy_is_named(tmp_path, points, monkeypatch):
    path = write_c3d(tmp_path / "a.c3d", points, ["a", "b", "c"])
    monkeypatch.setitem(__import__("sys").modules, "ezc3d", None)
    with pytest.raises(MotionError, match=r'a\.c3d: ezc3d, .* is not installed: pip install "mjhcmc\[c3d\]"'):
        read_c3d(path)


# --- force plates ---------------------------------------------------------------------------------------------

TURN = Rotation.from_euler("zx", [30, 180], degrees=True)  # lab of z up; the plate turned about it, its own z down
CENTRE = np.array([0.7, -0.4, 0.01])
SIDES = np.array([0.6, 0.4])
ORIGIN = np.array([0.002, -0.003, -0.045])  # transducers to surface, in the plate's axes
CORNERS = CENTRE + TURN.apply([[*(SIDES / 2 * s), 0.0] for s in ([1, 1], [-1, 1], [-1, -1], [1, -1])])
A, B = 0.12, 0.2  # of the sensors of type 3
MATRIX = np.diag([2.0, 3.0, 4.0, 500.0, 600.0, 700.0]) + np.random.default_rng(5).normal(size=(6, 6))

N = N_FRAME * SUB
PHASE = np.linspace(0, 1, N)
LOADED = (PHASE > 0.2) & (PHASE < 0.8)
LOAD = np.where(LOADED, np.sin((PHASE - 0.2) / 0.6 * np.pi), 0.0)
FORCE = LOAD[:, None] * np.array([80.0, -50.0, 900.0])  # on the body, in the laboratory
ARM = np.column_stack([0.2 * (PHASE - 0.5), 0.1 * np.cos(3 * PHASE), np.zeros(N)])  # in the plate's axes
POINT = CENTRE + TURN.apply(ARM)
TORQUE = LOAD[:, None] * np.array([0.0, 0.0, 7.0])


def channels(kind, sign=1.0):
    """A plate's channels for the load above, N and N mm, each from statics."""
    force = sign * TURN.inv().apply(FORCE)
    about = np.cross(ARM + ORIGIN, force) + sign * TURN.inv().apply(TORQUE)  # about the transducers
    if kind == 1:
        return np.column_stack([force, 1e3 * ARM[:, :2], sign * 1e3 * TURN.inv().apply(TORQUE)[:, 2]])
    if kind == 3:
        # four corners that carry the force: the sums and moments of the type's definition, solved for the channels
        about = np.cross(ARM + np.array([0, 0, ORIGIN[2]]), force) + sign * TURN.inv().apply(TORQUE)
        fx12, fx34 = (0.5 * force[:, 0] + side * about[:, 2] / (4 * B) for side in (-1, 1))
        fy14, fy23 = (0.5 * force[:, 1] + side * about[:, 2] / (4 * A) for side in (1, -1))
        places = np.array([[A, B], [-A, B], [-A, -B], [A, -B]])  # of sensors 1 to 4
        system = np.vstack([np.ones(4), places[:, 1], -places[:, 0]])  # sum, about x, about y
        vertical = np.linalg.lstsq(system, np.column_stack([force[:, 2], about[:, 0], about[:, 1]]).T, rcond=None)[0].T
        return np.column_stack([fx12, fx34, fy14, fy23, vertical])
    both = np.column_stack([force, 1e3 * about])
    return np.linalg.solve(MATRIX, both.T).T if kind == 4 else both


def parameters(kind, n=1):
    width = 8 if kind == 3 else 6
    origin = [1e3 * A, 1e3 * B, 1e3 * ORIGIN[2]] if kind == 3 else 1e3 * ORIGIN
    plates = {
        "USED": [n],
        "TYPE": [kind] * n,
        "ZERO": [0, 0],
        "CORNERS": np.repeat(1e3 * CORNERS.T[:, :, None], n, axis=2),
        "ORIGIN": np.repeat(np.reshape(origin, (3, 1)), n, axis=1),
        "CHANNEL": np.arange(1, n * width + 1).reshape(width, n, order="F"),
    }
    return plates | ({"CAL_MATRIX": np.repeat(MATRIX[:, :, None], n, axis=2)} if kind == 4 else {})


UNITS = {
    1: ["N"] * 3 + ["mm"] * 2 + ["Nmm"], 2: ["N"] * 3 + ["Nmm"] * 3, 3: ["N"] * 8, 4: ["V"] * 6,
}  # fmt: skip


@pytest.fixture
def put(tmp_path, points):
    """Writes a file of one plate; markers stand above it."""

    def put(kind=2, samples=None, units=None, markers=points, first_frame=1, **change):
        samples = channels(kind) if samples is None else samples
        return write_c3d(
            tmp_path / "a.c3d", markers, ["a", "b", "c"][: markers.shape[1]], channels=samples,
            units=units or UNITS[kind], plates=parameters(kind) | change, first_frame=first_frame,
        )  # fmt: skip

    return put


def close(found, expected, scale):
    np.testing.assert_allclose(found, expected, rtol=0, atol=50 * FLOAT32 * scale)


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_load_on_the_body_in_the_laboratory(put, kind, sign):
    """Whether the channels hold the force on the body or its reaction on the plate."""
    plates = force_plates(put(kind, channels(kind, sign)))
    loaded = FORCE[:, 2] >= 20
    assert plates.names == ("plate1",)
    np.testing.assert_allclose(plates.time, np.arange(N) / (RATE * SUB), atol=1e-12)
    close(plates.force[:, 0], FORCE * loaded[:, None], 1e3)
    close(plates.torque[:, 0], TORQUE * loaded[:, None], 1e3)
    close(plates.point[loaded, 0], POINT[loaded], 900 / 20)
    close(plates.corners[0], CORNERS, 1)
    assert ("turned to that on the body" in " ".join(plates.notices)) == (sign < 0)


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
def test_ezc3d_s_own_filter_agrees(put, kind):
    path = put(kind)
    ours, theirs = force_plates(path, threshold=100.0), ezc3d.c3d(str(path), extract_forceplat_data=True)
    plate = theirs["data"]["platform"][0]
    loaded = FORCE[:, 2] >= 100
    close(ours.force[loaded, 0], plate["force"].T[loaded], 1e3)
    close(ours.point[loaded, 0], plate["center_of_pressure"].T[loaded] / 1e3, 10)
    close(ours.torque[loaded, 0], plate["Tz"].T[loaded] / 1e3, 1e3)


def test_where_the_plate_is_not_loaded_the_point_rests(put):
    plates = force_plates(put())
    loaded = np.flatnonzero(FORCE[:, 2] >= 20)
    assert not plates.force[: loaded[0]].any()
    assert not plates.torque[loaded[-1] + 1 :].any()
    for rows, nearest in ((slice(0, loaded[0]), loaded[0]), (slice(loaded[-1], None), loaded[-1])):
        np.testing.assert_array_equal(
            plates.point[rows, 0], np.broadcast_to(plates.point[nearest, 0], (len(plates.point[rows]), 3))
        )
    close(force_plates(put(samples=0 * channels(2))).point[:, 0], np.broadcast_to(CENTRE, (N, 3)), 1)


def test_between_two_steps_the_point_is_that_of_the_nearer(put):
    samples = channels(2)
    samples[90:110] = 0
    point = force_plates(put(samples=samples)).point[:, 0]
    np.testing.assert_array_equal(point[90:100], np.broadcast_to(point[89], (10, 3)))
    np.testing.assert_array_equal(point[100:110], np.broadcast_to(point[110], (10, 3)))


@pytest.mark.parametrize(("unit", "factor"), [("Nm", 1e-3), ("N*m", 1e-3), ("N.mm", 1), ("", 1)])
def test_moments_go_by_the_channels_unit(put, unit, factor):
    samples = channels(2) * np.repeat([1.0, factor], 3)
    plates = force_plates(put(samples=samples, units=["N"] * 3 + [unit] * 3))
    loaded = FORCE[:, 2] >= 20
    close(plates.point[loaded, 0], POINT[loaded], 900 / 20)


def test_an_origin_of_the_wrong_sign_is_turned(put):
    loaded = FORCE[:, 2] >= 20
    close(force_plates(put(ORIGIN=-1e3 * ORIGIN[:, None])).point[loaded, 0], POINT[loaded], 900 / 20)


def test_without_markers_up_is_against_the_plates_axis(put, points):
    for sign in (1.0, -1.0):
        plates = force_plates(put(samples=channels(2, sign), markers=np.full((N_FRAME, 1, 3), np.nan)))
        close(plates.force[100, 0], FORCE[100], 1e3)


def test_a_plate_whose_axis_is_up_needs_the_markers(put):
    """Corners numbered the other way round: z up, and what it calls its axes turned."""
    turned = [1, 0, 3, 2]
    mirror = np.array([-1.0, 1.0, -1.0] * 2)  # x and z reversed: a rotation by 180 deg about y
    arm = ARM * mirror[:3]
    force = TURN.inv().apply(FORCE) * mirror[:3]
    about = np.cross(arm, force) + TURN.inv().apply(TORQUE) * mirror[:3]
    path = put(
        samples=np.column_stack([force, 1e3 * about]),
        CORNERS=1e3 * CORNERS[turned].T[:, :, None],
        ORIGIN=np.zeros((3, 1)),
    )
    plates, loaded = force_plates(path), FORCE[:, 2] >= 20
    close(plates.force[loaded, 0], FORCE[loaded], 1e3)
    close(plates.point[loaded, 0], POINT[loaded], 900 / 20)


@pytest.mark.parametrize("kind", [2, 3, 4])
def test_a_baseline_is_taken_off(put, kind):
    offset = np.full(channels(kind).shape[1], 0.5)
    plates = force_plates(put(kind, channels(kind) + offset, first_frame=31, ZERO=[31, 33]))
    assert plates.notices[0].startswith("plate1: baseline of frames 31 to 33 taken off (")
    close(plates.force[100, 0], FORCE[100], 1e3)
    assert plates.time[0] == pytest.approx(0.3)


@pytest.mark.parametrize(("zero", "words"), [([1, 0], None), ([0, 0], None), ([9, 12], "no baseline is taken off")])
def test_a_baseline_under_load_or_of_no_frames_is_left(put, zero, words):
    plates = force_plates(put(ZERO=zero))
    close(plates.force[100, 0], FORCE[100], 1e3)
    assert [words in notice for notice in plates.notices] == ([True] if words else [])


def test_a_centre_of_pressure_off_the_plate_is_told(put):
    notices = force_plates(put(samples=channels(2) * np.repeat([1.0, 30.0], 3))).notices
    assert "plate1: the centre of pressure lies off the plate in " in notices[0]


def test_two_plates_of_different_channels(tmp_path, points):
    plates = parameters(2, 2)
    both = np.column_stack([channels(2), 0.5 * channels(2)])
    path = write_c3d(tmp_path / "a.c3d", points, ["a", "b", "c"], channels=both, units=UNITS[2] * 2, plates=plates)
    found = force_plates(path)
    assert found.names == ("plate1", "plate2")
    close(found.force[100], [FORCE[100], 0.5 * FORCE[100]], 1e3)


def test_plates_as_a_table_and_in_another_frame(put, tmp_path):
    """The laboratory's z up to OpenSim's y up, as OpenSim's external loads want it."""
    plates = force_plates(put()).moved(Rotation.from_euler("x", -90, degrees=True).as_matrix(), [0, 0.1, 0])
    write_force_plates(plates, tmp_path / "grf.mot")
    table = read_table(tmp_path / "grf.mot")
    assert table.columns == tuple(
        f"plate1_{what}{axis}" for what in ("force_v", "force_p", "torque_") for axis in "xyz"
    )
    np.testing.assert_array_equal(table.values[:, 0:3], plates.force[:, 0])
    np.testing.assert_array_equal(table.values[:, 3:6], plates.point[:, 0])
    np.testing.assert_array_equal(table.values[:, 6:9], plates.torque[:, 0])
    close(plates.force[100, 0], FORCE[100][[0, 2, 1]] * [1, 1, -1], 1e3)
    close(plates.point[100, 0], POINT[100][[0, 2, 1]] * [1, 1, -1] + [0, 0.1, 0], 10)
    with pytest.raises(OutputError, match=r"grf\.csv: force plates are written to \.mot or \.sto"):
        write_force_plates(plates, tmp_path / "grf.csv")
    for bad in (np.eye(3) * 2, np.diag([1, 1, -1]), np.eye(2)):
        with pytest.raises(SettingsError, match="rotation is no rotation matrix"):
            plates.moved(bad)


def test_plates_as_external_loads(put):
    plates = force_plates(put())
    loads = plates.loads_on({"plate1": "foot"})
    assert (loads.body, loads.labels) == (("foot",), ("plate1",))
    for key in ("time", "force", "point", "torque"):
        np.testing.assert_array_equal(getattr(loads, key), getattr(plates, key))
    with pytest.raises(MotionError, match=r"a\.c3d: no plate plate2: its plates are plate1"):
        plates.loads_on({"plate2": "foot"})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"TYPE": [5]}, r"plate1 is of type 5: types 1 to 4 are read"),
        ({"USED": [0]}, r"no force plates \(FORCE_PLATFORM:USED is 0\)"),
        ({"USED": [2]}, r"FORCE_PLATFORM:TYPE has 1 numbers, plate2 needs 2"),
        (
            {"CHANNEL": np.arange(1, 5).reshape(4, 1)},
            r"plate1 of type 2 has 4 channels in FORCE_PLATFORM:CHANNEL, needs 6",
        ),
        ({"CHANNEL": np.arange(2, 8).reshape(6, 1)}, r"plate1 names channels 2, 3, 4, 5, 6, 7, the file has 6"),
        ({"CORNERS": np.zeros((3, 4, 1))}, r"plate1: its corners span no surface: correct FORCE_PLATFORM:CORNERS"),
        ({"samples": np.full((N, 6), np.nan)}, r"plate1, channel 1, sample 1: not finite"),
    ],
)
def test_plates_that_cannot_be_used(put, change, message):
    with pytest.raises(MotionError, match=rf"a\.c3d: {message}") as raised:
        force_plates(put(**change))
    assert "\n" not in str(raised.value)


def test_a_file_without_channels_and_a_bad_threshold(tmp_path, points, put):
    with pytest.raises(MotionError, match=r"b\.c3d: no force plates"):
        force_plates(write_c3d(tmp_path / "b.c3d", points, ["a", "b", "c"]))
    with pytest.raises(SettingsError, match="threshold -1 N: choose 0 or more, such as 20"):
        force_plates(put(), threshold=-1)

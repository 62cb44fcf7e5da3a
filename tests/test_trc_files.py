"""Marker files: what is read, what is written, and what is refused."""

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mjhcmc.errors import MjhcmcWarning, MotionError, OutputError
from mjhcmc.io.trc import read_trc, write_trc

GOOD = (
    "PathFileType\t4\t(X/Y/Z)\tm.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n"
    "2\t2\t3\t2\tmm\t2\t1\t3\n"
    "Frame#\tTime\tASIS\t\t\tKNEE\t\t\n"
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
    "\n"
    "1\t0\t1\t2\t3\t4\t5\t6\n"
    "2\t0.5\t1.5\t2.5\t-3.5\t\t\t\n"
    "3\t1\t10\t20\t30\t40\t50\t6e1\n"
)
POSITIONS = np.array(
    [[[1, 2, 3], [4, 5, 6]], [[1.5, 2.5, -3.5], [np.nan] * 3], [[10, 20, 30], [40, 50, 60]]],
)


@pytest.fixture
def put(tmp_path):
    def put(content, name="m.trc"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return put


@pytest.mark.parametrize(
    "content",
    [
        GOOD,
        GOOD.replace("\n", "\r\n"),
        b"\xef\xbb\xbf" + GOOD.encode(),
        GOOD.replace("\n\n1", "\n1"),  # no blank line after the header
        GOOD.replace("\n", "\n\n"),
        GOOD.replace("\n", "\t\t\n"),
        GOOD.replace("-3.5\t\t\t", "-3.5"),  # tabs that an editor dropped
        GOOD.replace("\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n", ""),
        GOOD.replace("\tASIS\t\t\tKNEE", "\tASIS\tKNEE"),
        GOOD.replace("-3.5\t\t\t", "-3.5\tNaN\tnan\t "),
        GOOD.replace("\tmm\t", "\tMillimeters\t"),
        GOOD.replace("PathFileType\t4\t(X/Y/Z)\tm.trc\n", ""),
        GOOD.rstrip("\n"),
    ],
)
def test_survives_variants(put, content):
    table = read_trc(put(content))
    assert table.names == ("ASIS", "KNEE")
    np.testing.assert_array_equal(table.time, [0, 0.5, 1])
    np.testing.assert_allclose(table.positions, POSITIONS / 1000, rtol=1e-15)
    assert len(table.line_numbers) == 3


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1e-3), ("cm", 1e-2), ("m", 1), ("Metres", 1)])
def test_units(put, unit, scale):
    table = read_trc(put(GOOD.replace("\tmm\t", f"\t{unit}\t")))
    np.testing.assert_allclose(table.positions, POSITIONS * scale, rtol=1e-15)
    assert list(table.line_numbers) == [7, 8, 9]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2\t2\t3\t2", "2\t2\t2\t2", r"the header says NumFrames 2, the file has 3 rows: all are read"),
        ("2\t2\t3\t2", "2\t2\t3\t5", r"the header says NumMarkers 5, the file has 2 markers: all are read"),
        ("2\t2\t3\t2", "100\t2\t3\t2", r"the header says DataRate 100, the times have 2 rows a second: the times are"),
    ],
)
def test_headers_that_do_not_fit_are_warnings(put, old, new, message):
    with pytest.warns(MjhcmcWarning, match=message):
        table = read_trc(put(GOOD.replace(old, new)))
    np.testing.assert_array_equal(table.time, [0, 0.5, 1])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "m.trc: the file is empty"),
        (b"PK\x03\x04\x00\x00" * 50, "m.trc: not a text file (byte 0 at 4): give a marker file (.trc)"),
        ("time,hip\n0,1\n", "m.trc: no line that begins with 'Frame#': not a marker file"),
        (
            GOOD[GOOD.index("Frame#") :],
            "m.trc: no line of keys with 'Units', and their values, above 'Frame#' (line 1)",
        ),
        (GOOD.replace("\tmm\t", "\tinch\t"), "m.trc: the header gives Units as 'inch': write mm, cm or m"),
        (GOOD.replace("2\t2\t3\t2\tmm", "2\t2\t3\t2"), "m.trc: the header gives Units as '2'"),
        (GOOD.replace("2\t2\t3\t2", "2\t2\tmany\t2"), "m.trc: the header gives NumFrames as 'many': write the number"),
        (
            GOOD.replace("2\t2\t3\t2", "fast\t2\t3\t2"),
            "m.trc: the header gives DataRate as 'fast': write rows a second",
        ),
        (GOOD.replace("Time", "t"), "m.trc, line 4: 'Frame#\\tt\\tASIS\\t\\t\\tKNEE': write 'Frame#', 'Time' and"),
        (GOOD.replace("KNEE", "ASIS"), "m.trc, line 4: marker 'ASIS' stands twice: rename or remove one"),
        (GOOD.replace("ASIS\t\t\tKNEE", ""), "m.trc, line 4: no marker names"),
        (GOOD.replace("KNEE", ""), "m.trc, line 5: 6 coordinates for 1 marker names in line 4: name each marker once"),
        (GOOD[: GOOD.index("1\t0\t")], "m.trc: no rows after the marker names: the file is cut off"),
        (GOOD[: GOOD.index("3\t1\t")], "m.trc: cut off: the header says NumFrames 3, the file ends at line 8 after 2"),
        (GOOD.replace("\t4\t5\t6", "\t4\t5"), "m.trc, line 7: 7 values where 2 markers need 8: correct the row"),
        (GOOD.replace("\t4\t5\t6", "\t4\t5\t6\t7"), "m.trc, line 7: 9 values where 2 markers need 8: correct the row"),
        (GOOD.replace("\t40\t50\t6e1\n", ""), "m.trc, line 9: 5 values where 2 markers need 8: the file is cut off"),
        (GOOD.replace("\t4\t5\t6", "\t4\t\t6"), "m.trc, line 7: marker 'KNEE' has only some of its coordinates"),
        (GOOD.replace("-3.5", "low"), "m.trc, line 8, column 'ASIS Z': 'low' is not a number: correct it"),
        (GOOD.replace("-3.5", "3_5"), "m.trc, line 8, column 'ASIS Z': '3_5' is not a number"),
        (GOOD.replace("-3.5", "-inf"), "m.trc, line 8, column 'ASIS Z': -inf: give a finite number"),
        (GOOD.replace("0.5\t", "nan\t"), "m.trc, line 8, column 'time': nan: give a finite number"),
        (GOOD.replace("0.5\t", "\t"), "m.trc, line 8, column 'time': nothing: give a finite number"),
    ],
)
def test_refuses_in_one_line(put, content, message):
    with pytest.raises(MotionError) as raised:
        read_trc(put(content))
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(MotionError, match=r"no\.trc: no such file"):
        read_trc(tmp_path / "no.trc")
    with pytest.raises(MotionError, match=r"is a folder: name a file"):
        read_trc(tmp_path)


@given(
    positions=arrays(np.float64, (3, 2, 3), elements=st.floats(-1e300, 1e300)),
    time=arrays(np.float64, 3, elements=st.floats(-1e3, 1e3), unique=True),
    unseen=st.integers(0, 6),
    unit=st.sampled_from(["mm", "m"]),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60, deadline=None)
@example(  # steps so short that their rate is infinite
    positions=np.zeros((3, 2, 3)), time=np.array([0.0, 2.3e-311, 5e-324]), unseen=0, unit="mm"
)
def test_round_trip_to_the_last_bit(tmp_path, positions, time, unseen, unit):
    path = tmp_path / "m.trc"
    if unseen < 6:
        positions[unseen % 3, unseen // 3] = np.nan
    time = np.sort(time)
    write_trc(path, ["a marker", "S:b"], time, positions, unit=unit)
    table = read_trc(path)
    assert table.names == ("a marker", "S:b")
    np.testing.assert_array_equal(table.time, time)
    np.testing.assert_array_equal(table.positions, positions)
    assert f"\t{unit}\t" in path.read_text().splitlines()[2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unit": "inch"}, r"m\.trc: unit 'inch': choose mm, cm or m"),
        ({"time": [0, 1]}, r"cannot write 2 markers with time \(2,\) and positions \(3, 2, 3\): give"),
        ({"positions": np.zeros((3, 2))}, r"positions \(3, 2\): give time \(T,\) and positions \(T, 2, 3\)"),
        ({"names": ["a", "a"]}, r"marker 'a' would be written twice"),
        ({"names": ["a", ""]}, r"marker name '' cannot be written: it is empty"),
        ({"names": ["a", "b\tc"]}, r"marker name 'b\\tc' cannot be written"),
        ({"positions": np.full((3, 2, 3), np.inf)}, r"marker 'a' of row 0 \(from 0\) is not finite"),
        ({"positions": np.where(np.arange(3) == 1, np.nan, np.zeros((3, 2, 3)))}, r"marker 'a' of row 0 .* three NaN"),
        ({"time": [0, np.nan, 1]}, r"m\.trc: a time is not finite"),
    ],
)
def test_what_cannot_be_written_leaves_nothing(tmp_path, change, message):
    good = {"names": ["a", "b"], "time": [0, 1, 2], "positions": np.zeros((3, 2, 3)), "unit": "mm"}
    arguments = good | change
    unit = arguments.pop("unit")
    with pytest.raises(OutputError, match=message):
        write_trc(tmp_path / "m.trc", **arguments, unit=unit)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(OutputError, match=r"there is no folder .*deep: create it first"):
        write_trc(tmp_path / "deep" / "m.trc", ["a"], [0, 1], np.zeros((2, 1, 3)))

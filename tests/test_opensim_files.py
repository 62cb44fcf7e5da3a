"""OpenSim tables: what is read, what is written, and what is refused."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mjhcmc.errors import MjhcmcWarning, MotionError, OutputError
from mjhcmc.io.opensim import read_table, write_table

WALK = Path(__file__).parent / "data" / "walk"
GOOD = """walk
version=1
nRows=3
nColumns=3
inDegrees=yes
endheader
time\thip\tknee
0\t1\t-2
0.5\t1.5\t-2.5
1\t2e0\t-3
"""


@pytest.fixture
def put(tmp_path):
    def put(content, name="m.mot"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return put


def _same_as_good(table):
    assert table.columns == ("hip", "knee")
    np.testing.assert_array_equal(table.time, [0, 0.5, 1])
    np.testing.assert_array_equal(table.values, [[1, -2], [1.5, -2.5], [2, -3]])


def test_reads_a_table(put):
    table = read_table(str(put(GOOD)))
    _same_as_good(table)
    assert table.name == "walk"
    assert table.in_degrees is True
    assert table.header == {"version": "1", "nRows": "3", "nColumns": "3", "inDegrees": "yes"}
    assert list(table.line_numbers) == [8, 9, 10]


@pytest.mark.parametrize(
    "content",
    [
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        b"\xef\xbb\xbf" + GOOD.encode(),
        GOOD + "\n\n  \n",
        GOOD.replace("inDegrees=yes\n", "inDegrees = YES\n\nUnits are S.I. units\nAngles are in degrees.\n\n"),
        GOOD.replace("endheader\n", "EndHeader\n\n"),
        GOOD.replace("nRows=3\n", ""),
        GOOD.replace("nRows=3\nnColumns=3", "datarows 3\ndatacolumns 3\nrange 0 1\notherdata 1"),
        GOOD.replace("\t", "   "),
        GOOD.replace("\n", "\t\t\n"),
        GOOD.rstrip("\n"),
        GOOD.replace("walk\n", "inDegrees=yes\n", 1),
    ],
)
def test_survives_variants(put, content):
    table = read_table(put(content))
    _same_as_good(table)
    assert table.in_degrees is True


def test_a_byte_order_mark_is_no_part_of_the_name(put):
    assert read_table(put(b"\xef\xbb\xbf" + GOOD.encode())).name == "walk"


def test_time_stands_anywhere(put):
    rows = [line.split("\t") for line in GOOD.splitlines()[6:]]
    turned = "\n".join("\t".join([b, a, c]) for a, b, c in rows).replace("time", "Time")
    _same_as_good(read_table(put(GOOD[: GOOD.index("time")] + turned)))


def test_in_degrees(put):
    assert read_table(put(GOOD.replace("=yes", "=no"))).in_degrees is False
    assert read_table(put(GOOD.replace("inDegrees=yes\n", ""))).in_degrees is None
    with pytest.raises(MotionError, match=r"m\.mot: header line inDegrees=maybe: write inDegrees=yes or"):
        read_table(put(GOOD.replace("=yes", "=maybe")))


def test_nan_is_read_not_judged(put):
    values = read_table(put(GOOD.replace("1.5", "nan").replace("-2.5", "-inf"))).values
    assert math.isnan(values[1, 0])
    assert values[1, 1] == -math.inf


def test_lines_are_those_of_an_editor(put):
    table = read_table(put(GOOD.replace("0.5\t", "\n\n0.5\t").replace("walk", "walk\x0c\x85")))
    assert list(table.line_numbers) == [8, 11, 12]


def test_column_names_with_spaces(put):
    assert read_table(put(GOOD.replace("hip\t", "left hip\t"))).columns == ("left hip", "knee")


def test_header_overwritten_by_opensim_cmc(put):
    # OpenSim's CMC writes an empty table's header over the start of its own states file
    damaged = "UNKNOWN\nversion=1\nnRows=0\nnColumns=0\ninDegrees=no\nendheader\nees=no\nendheader\n"
    with pytest.warns(MjhcmcWarning) as warned:
        table = read_table(put(damaged + GOOD[GOOD.index("time") :], "s.sto"))
    _same_as_good(table)
    assert "nRows=0, the file has 3 rows" in str(warned[0].message)
    assert "nColumns=0, the file has 3 columns" in str(warned[1].message)


def test_more_rows_than_said_is_a_warning(put):
    with pytest.warns(MjhcmcWarning, match=r"nRows=2, the file has 3 rows: all 3 are read"):
        _same_as_good(read_table(put(GOOD.replace("nRows=3", "nRows=2"))))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "m.mot: the file is empty"),
        (b" \n\n", "m.mot: the file is empty"),
        (b"PK\x03\x04\x00\x00" * 50, "m.mot: not a text file (byte 0 at 4)"),
        (GOOD.encode("utf-16"), "m.mot: not a text file"),
        (GOOD.replace("walk", "w\u00e4lk").encode("latin-1"), "m.mot: not a text file (byte 1 is not UTF-8)"),
        ("a,b\n1,2\n", "m.mot: no line 'endheader'"),
        (GOOD[: GOOD.index("time")], "m.mot: nothing follows 'endheader' (line 6)"),
        (GOOD[: GOOD.index("0\t1")], "m.mot: no rows after the column names"),
        (GOOD.replace("time", "t"), "m.mot, line 7: no column 'time' among t, hip, knee"),
        (GOOD.replace("knee", "hip"), "m.mot, line 7: column name 'hip' stands twice (columns 2 and 3)"),
        (GOOD.replace("knee", "TIME"), "m.mot, line 7: column name 'TIME' stands twice (columns 1 and 3)"),
        (
            GOOD.replace("1.5\t-2.5", "1.5"),
            "m.mot, line 9: 2 values where the column line names 3: correct the row",
        ),
        (GOOD.replace("-2.5", "-2.5\t7"), "m.mot, line 9: 4 values where the column line names 3: correct"),
        (GOOD.replace("2e0\t-3\n", ""), "m.mot, line 10: 1 value where the column line names 3: the file is cut"),
        (GOOD.replace("nRows=3", "nRows=9"), "m.mot: cut off: the header says nRows=9, the file ends at line 10"),
        (GOOD.replace("nRows=3", "nRows=many"), "m.mot: header line nRows=many: write the number of rows"),
        (GOOD.replace("-2.5", "-2,5"), "m.mot, line 9, column 'knee': '-2,5' is not a number"),
        (GOOD.replace("0.5\t", "half\t"), "m.mot, line 9, column 'time': 'half' is not a number"),
        (GOOD.replace("2e0", "2_0"), "m.mot, line 10, column 'hip': '2_0' is not a number"),
    ],
)
def test_refuses_in_one_line(put, content, message):
    with pytest.raises(MotionError) as raised:
        read_table(put(content))
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(MotionError, match=r"no\.mot: no such file"):
        read_table(tmp_path / "no.mot")
    with pytest.raises(MotionError, match=r"is a folder: name a file"):
        read_table(tmp_path)


@given(cut=st.integers(1, len(GOOD) - 1))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
def test_every_cut_is_refused_or_only_cuts_digits(put, cut):
    """Cut anywhere: refused, or all rows and columns stand and only the last number can be short."""
    text = GOOD.replace("inDegrees=yes", "inDegrees=no")[:-cut]
    try:
        table = read_table(put(text))
    except MotionError:
        return
    assert table.values.shape == (3, 2)
    np.testing.assert_array_equal(table.values[:2], [[1, -2], [1.5, -2.5]])


def test_measured_walk():
    table = read_table(WALK / "subject01_walk_IK.mot")
    assert table.values.shape == (151, 10)
    assert table.columns[3] == "hip_flexion_r"
    assert table.time[-1] == 2.5
    assert table.values[0, 3] == -29.10815989
    assert table.line_numbers[0] == 12


@given(
    data=arrays(np.float64, st.tuples(st.integers(1, 6), st.integers(1, 5))),
    in_degrees=st.booleans(),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_round_trip_is_exact(tmp_path, data, in_degrees):
    columns = [f"/a b/{i}" for i in range(data.shape[1] - 1)]
    path = tmp_path / "t.sto"
    write_table(path, columns, data[:, 0], data[:, 1:], name="a name", in_degrees=in_degrees)
    table = read_table(path)
    assert (table.name, table.in_degrees, table.columns) == ("a name", in_degrees, tuple(columns))
    np.testing.assert_array_equal(table.time, data[:, 0])
    np.testing.assert_array_equal(table.values, data[:, 1:])
    assert [p.name for p in tmp_path.iterdir()] == ["t.sto"]


def test_writes_what_opensim_reads(tmp_path):
    write_table(tmp_path / "t.mot", ["hip"], [0, 0.1], [[1], [2.5]], name="n", in_degrees=True)
    assert (tmp_path / "t.mot").read_bytes() == (
        b"n\nversion=1\nnRows=2\nnColumns=2\ninDegrees=yes\nendheader\ntime\thip\n0.0\t1.0\n0.1\t2.5\n"
    )


@pytest.mark.parametrize(
    ("columns", "values", "name", "message"),
    [
        (["a"], [[1, 2]], "n", r"values \(1, 2\): give time \(T,\) and values \(T, 1\)"),
        (["a", "a"], [[1, 2]], "n", "'a' would be written twice"),
        (["a", "time"], [[1, 2]], "n", "'time' would be written twice"),
        (["a", "Time"], [[1, 2]], "n", "'Time' would be written twice"),
        (["a", " b"], [[1, 2]], "n", "begins or ends with a blank"),
        (["a\tb"], [[1]], "n", "has a tab"),
        (["a"], [[1]], "n\nm", "table name"),
    ],
)
def test_refuses_to_write_what_could_not_be_read(tmp_path, columns, values, name, message):
    with pytest.raises(OutputError, match=message):
        write_table(tmp_path / "t.mot", columns, [0.0], values, name=name, in_degrees=True)
    assert not list(tmp_path.iterdir())


def test_a_failed_write_leaves_the_old_file(tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        write_table(tmp_path / "no" / "t.mot", ["a"], [0.0], [[1]], name="n", in_degrees=True)
    (tmp_path / "t.mot").mkdir()
    (tmp_path / "t.mot" / "precious").touch()
    with pytest.raises(OutputError, match="cannot be written"):
        write_table(tmp_path / "t.mot", ["a"], [0.0], [[1]], name="n", in_degrees=True)
    assert [p.name for p in tmp_path.iterdir()] == ["t.mot"]
    assert (tmp_path / "t.mot" / "precious").exists()

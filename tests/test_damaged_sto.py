"""Tables that something damaged: CMC's header over the start of its own file, a lost endheader, garbage at the end."""

import numpy as np
import pytest

from mjhcmc import MjhcmcWarning, MotionError
from mjhcmc.io.opensim import read_table

LABELS = "time\t/jointset/hip_r/q/value\t/jointset/hip_r/q/speed"
ROWS = "0.03\t0.1\t0.2\n0.04\t0.3\t0.4\n"
HEADER = "\nversion=1\nnRows=2\nnColumns=3\ninDegrees=no\nendheader\n"
OVER = "UNKNOWN\nversion=1\nnRows=0\nnColumns=1\ninDegrees=no\nendheader\ntime\n"


@pytest.mark.parametrize("left", range(-9, 65))
def test_what_cmc_writes_over_its_header_is_survived(tmp_path, left):
    """From nine characters lost of the first path to all but the first of the true header left."""
    name = "n" * (left + len(OVER) - len(HEADER) - len("time\t"))
    text = name + HEADER + LABELS + "\n" + ROWS
    path = tmp_path / "cmc_states.sto"
    path.write_text(OVER + text[len(OVER) :])
    with pytest.warns(MjhcmcWarning) as warned:
        table = read_table(path)
    assert any("nRows=0, the file has 2 rows" in str(warning.message) for warning in warned)
    assert table.columns == ("/jointset/hip_r/q/value", "/jointset/hip_r/q/speed")
    np.testing.assert_array_equal(table.time, [0.03, 0.04])
    np.testing.assert_array_equal(table.values, [[0.1, 0.2], [0.3, 0.4]])


@pytest.mark.parametrize("left", ["a", "x\t/jointset/a/b\tc", "a\tb\tc\td"])
def test_what_cannot_be_uncovered_is_refused(tmp_path, left):
    path = tmp_path / "cmc_states.sto"
    path.write_text(OVER + left + "\n" + ROWS)
    with pytest.raises(MotionError, match=r"cmc_states\.sto, line "):
        read_table(path)


def test_a_table_of_times_alone_is_what_it_says(tmp_path):
    path = tmp_path / "times.sto"
    path.write_text("t\nversion=1\nnRows=2\nnColumns=1\ninDegrees=no\nendheader\ntime\n1\n2\n")
    np.testing.assert_array_equal(read_table(path).time, [1, 2])


@pytest.mark.parametrize("left", [-8, 0, 9, 30])
@pytest.mark.filterwarnings("ignore:.*nColumns=1, the file has")
def test_windows_line_ends_are_survived_with_the_damage(tmp_path, left):
    """The header written over has line ends of the same kind; one more byte a line."""
    over, header, rows = (text.replace("\n", "\r\n") for text in (OVER, HEADER, LABELS + "\n" + ROWS))
    name = "n" * (left + len(over) - len(header) - len("time\t"))
    path = tmp_path / "cmc_states.sto"
    path.write_bytes((over + (name + header + rows)[len(over) :]).encode())
    with pytest.warns(MjhcmcWarning, match="nRows=0, the file has 2 rows"):
        table = read_table(path)
    assert table.columns == ("/jointset/hip_r/q/value", "/jointset/hip_r/q/speed")
    np.testing.assert_array_equal(table.values, [[0.1, 0.2], [0.3, 0.4]])


WHOLE = "states" + HEADER + LABELS + "\n" + ROWS
DAMAGED = OVER + ("n" * 20 + HEADER + LABELS + "\n" + ROWS)[len(OVER) :]
GARBAGE = [
    "Simulation finished\n", "time\ta\tb\n", "nan?\n\n%%EOF", b"\0" * 300, b"\xff\xfe\x00rest", b"\0 done\n0.5\n",
]  # fmt: skip


@pytest.mark.parametrize("garbage", GARBAGE)
@pytest.mark.parametrize("start", [WHOLE, DAMAGED, WHOLE.replace("nRows=2\n", "")])
@pytest.mark.filterwarnings("ignore:.*nRows=0, the file has|.*nColumns=1, the file has")
def test_garbage_below_the_rows_is_dropped(tmp_path, start, garbage):
    path = tmp_path / "s.sto"
    path.write_bytes(start.encode() + (garbage if isinstance(garbage, bytes) else garbage.encode()))
    with pytest.warns(MjhcmcWarning, match=r"s\.sto.*(no row, beginning|no text from byte).*dropped"):
        table = read_table(path)
    np.testing.assert_array_equal(table.values, [[0.1, 0.2], [0.3, 0.4]])
    assert list(table.line_numbers) == [start.count("\n") - 1, start.count("\n")]


@pytest.mark.parametrize("garbage", ["0.05\t0.5\n", "0.05\t0.5\t-", "0.05\t0.5\t0.6\t0.7\n"])
def test_a_row_too_many_that_is_cut_is_garbage_only_where_the_header_counts(tmp_path, garbage):
    path = tmp_path / "s.sto"
    path.write_text(WHOLE + garbage)
    with pytest.warns(MjhcmcWarning, match=r"line 10: 1 line after the last row that is no row, beginning '0\.05"):
        assert read_table(path).values.shape == (2, 2)
    path.write_text(WHOLE.replace("nRows=2\n", "") + garbage)
    with pytest.raises(MotionError, match=r"s\.sto, line 9"):
        read_table(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (WHOLE.replace("nRows=2", "nRows=3") + "garbage\n", r"line 10: 1 value where the column line names 3"),
        (WHOLE.replace("0.2\n", "x\n"), r"line 8, column '/jointset/hip_r/q/speed': 'x' is not a number"),
        (WHOLE.replace("0.2\n", "0.2\n\0\n"), r"not a text file \(byte 0 at"),
        (WHOLE[: WHOLE.index("0.04")] + "\0\0", r"cut off: the header says nRows=2"),
        (WHOLE.replace("endheader\n", "endheader\n\0"), r"not a text file"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*no text from byte")
def test_damage_within_the_rows_is_an_error(tmp_path, text, message):
    path = tmp_path / "s.sto"
    path.write_text(text)
    with pytest.raises(MotionError, match=message):
        read_table(path)


@pytest.mark.parametrize("lost", ["", "endhea\n", "\n"])
def test_a_lost_endheader_is_survived(tmp_path, lost):
    path = tmp_path / "s.sto"
    path.write_text(WHOLE.replace("endheader\n", lost))
    with pytest.warns(MjhcmcWarning, match=r"no line 'endheader': line \d is taken for the column names"):
        table = read_table(path)
    assert (table.name, table.in_degrees) == ("states", False)
    np.testing.assert_array_equal(table.time, [0.03, 0.04])


@pytest.mark.parametrize(
    "text",
    [
        LABELS + "\n" + ROWS,  # no header at all: any table
        WHOLE.replace("endheader\n", "").replace("time", "t"),
        WHOLE.replace("endheader\n", "").replace("0.03\t0.1", "0.03"),
        WHOLE.replace("endheader\n", "")[: WHOLE.index("endheader") + len(LABELS) + 1],
    ],
)
def test_what_is_no_table_without_endheader_is_refused(tmp_path, text):
    path = tmp_path / "s.sto"
    path.write_text(text)
    with pytest.raises(MotionError, match=r"s\.sto: no line 'endheader'"):
        read_table(path)


@pytest.mark.parametrize("kind", ["Vec3", "Quaternion"])
def test_columns_of_vectors_are_refused_with_the_remedy(tmp_path, kind):
    path = tmp_path / "s.sto"
    text = f"s\nDataType={kind}\nversion=3\nendheader\ntime\ta\n0\t1,2,3\n"
    path.write_text(text)
    with pytest.raises(MotionError, match=rf"header line DataType={kind}: only tables of numbers are read: flatten it"):
        read_table(path)
    path.write_text(text.replace(kind, "double").replace("1,2,3", "1"))
    np.testing.assert_array_equal(read_table(path).values, [[1]])

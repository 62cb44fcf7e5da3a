"""OpenSim's CMC writes an empty table's header over the start of its own states file: what is left is read."""

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

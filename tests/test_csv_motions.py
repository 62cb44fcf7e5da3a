"""Motions as .csv: what is read, in which unit, and what is refused, by file, line and column."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from motion_tools import CART, DATA, DEG, LEG, TIME

from mjhcmc.errors import MjhcmcWarning, MotionError
from mjhcmc.io.csv_table import read_csv
from mjhcmc.motion import Motion

GOOD = "# inDegrees=yes\ntime,hip,knee\n0,1,-2\n0.5,1.5,-2.5\n1,2e0,-3\n"


@pytest.fixture
def put(tmp_path):
    def put(content, name="m.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return put


def text(columns, values=DATA, above="", time=TIME):
    rows = (",".join(map(repr, row)) for row in np.column_stack([time, values]).tolist())
    return above + "\n".join([",".join(["time", *columns]), *rows, ""])


# --- tables ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "content",
    [
        GOOD,
        GOOD.replace("\n", "\r\n"),
        b"\xef\xbb\xbf" + GOOD.encode(),
        GOOD.replace("\n", "\n\n") + " \n,,\n",
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD.replace(",", " , "),
        GOOD.replace("\n", ",,\n"),
        GOOD.replace("time", '"Time"').replace("hip", '"hip"').replace("1.5", '"1.5"'),
        GOOD.replace("time", "TIME (s)").replace("# inDegrees=yes", "# a walk\n#InDegrees = YES,,\n# nRows=3"),
        GOOD.replace("time,", "").replace("knee", "knee,time").replace("0,1,-2", "1,-2,0")
        .replace("0.5,1.5,-2.5", "1.5,-2.5,0.5").replace("1,2e0,-3", "2e0,-3,1"),
        "# inDegrees=yes\n,time,hip,knee\n0,0,1,-2\n1,0.5,1.5,-2.5\n2,1,2e0,-3\n",  # an index that pandas wrote
        GOOD.replace("0.5,", "# the second half\n0.5,").rstrip("\n"),
    ],
)  # fmt: skip
def test_survives_variants(put, content):
    table = read_csv(put(content))
    assert table.columns == ("hip", "knee")
    assert table.in_degrees is True
    assert table.units == (None, None)
    np.testing.assert_array_equal(table.time, [0, 0.5, 1])
    np.testing.assert_array_equal(table.values, [[1, -2], [1.5, -2.5], [2, -3]])


def test_units_behind_the_names(put):
    names = "hip (deg),knee [rad],ankle(degrees),f (N),rail ( mm ),pole [m],yaw (°)"
    table = read_csv(put(f"time,{names}\n0,1,2,3,4,5,6,7\n"))
    assert table.columns == ("hip", "knee", "ankle", "f (N)", "rail", "pole", "yaw")
    assert table.units == ("deg", "rad", "deg", None, "mm", "m", "deg")


def test_lines_are_those_of_an_editor_and_empty_cells_are_nan(put):
    table = read_csv(put(GOOD.replace("0.5,1.5", "\n#\n0.5,")))
    assert list(table.line_numbers) == [3, 6, 7]
    assert np.isnan(table.values[1, 0])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "m.csv: the file is empty"),
        (b"\n \r\n", "m.csv: the file is empty"),
        (b"PK\x03\x04\x00\x00" * 50, "m.csv: not a text file (byte 0 at 4): give a table of numbers"),
        (GOOD.encode("utf-16"), "m.csv: not a text file"),
        ("# only\n# comments\n", "m.csv: nothing but comments: a line of column names"),
        (GOOD.replace("time", "t"), "m.csv, line 2: no column 'time' among t, hip, knee: name the time column"),
        (GOOD.replace("time", "time (ms)"), "m.csv, line 2: column 'time (ms)': give time in s"),
        ("walk\nendheader\ntime\thip\n0\t1\n", "m.csv, line 1: no column 'time' among walk: give it the suffix .mot"),
        (GOOD.replace("knee", "hip"), "m.csv, line 2: column name 'hip' stands twice (columns 2 and 3)"),
        (GOOD.replace("knee", "hip (deg)"), "m.csv, line 2: column name 'hip' stands twice (columns 2 and 3)"),
        (GOOD.replace("knee", "Time"), "m.csv, line 2: column name 'Time' stands twice (columns 1 and 3)"),
        (GOOD[: GOOD.index("0,1")], "m.csv: no rows after the column names"),
        (GOOD.replace("1.5,-2.5", "1.5"), "m.csv, line 4: 2 values where the column line names 3: correct the row"),
        (GOOD.replace("-2.5", "-2.5,7"), "m.csv, line 4: 4 values where the column line names 3: correct the row"),
        (GOOD.replace("2e0,-3\n", ""), "m.csv, line 5: 2 values where the column line names 3: the file is cut off"),
        (GOOD.replace("1.5", "bent"), "m.csv, line 4, column 'hip': 'bent' is not a number: correct it"),
        (GOOD.replace("0.5,", "half,"), "m.csv, line 4, column 'time': 'half' is not a number"),
        (GOOD.replace("2e0", "2_0"), "m.csv, line 5, column 'hip': '2_0' is not a number"),
        (
            GOOD.replace(",", ";").replace("1.5", "1,5"),
            "m.csv, line 4, column 'hip': '1,5' is not a number: numbers take a point, not a comma",
        ),
        (GOOD.replace("yes", "perhaps"), "m.csv: header line inDegrees=perhaps: write inDegrees=yes or inDegrees=no"),
        ("# nRows=9\n" + GOOD, "m.csv: cut off: the header says nRows=9, the file ends at line 6 after 3 rows"),
        (GOOD.replace("hip", '"hip'), "m.csv, line 2: a quote that does not end"),
        (GOOD.replace("1.5", '"1.5'), "m.csv, line 4: a quote that does not end"),
    ],
)
def test_refuses_in_one_line(put, content, message):
    with pytest.raises(MotionError) as raised:
        read_csv(put(content))
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(MotionError, match=r"no\.csv: no such file"):
        read_csv(tmp_path / "no.csv")
    with pytest.raises(MotionError, match=r"is a folder: name a file"):
        read_csv(tmp_path)


# --- motions --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("above", "columns", "scale", "options"),
    [
        ("# inDegrees=yes\n", ["hip", "knee", "ankle"], 1, {}),
        ("# inDegrees=no\n", ["hip", "knee", "ankle"], DEG, {}),
        ("", ["hip (deg)", "knee [deg]", "ankle (°)"], 1, {}),
        ("", ["hip (rad)", "knee [rad]", "ankle (radians)"], DEG, {}),
        ("", ["hip (deg)", "knee (rad)", "ankle (deg)"], [1, DEG, 1], {}),
        ("# inDegrees=yes\n", ["hip (deg)", "knee", "ankle"], 1, {}),
        ("", ["hip", "knee", "ankle"], 1, {"angle_unit": "deg"}),
        ("", ["hip", "knee", "ankle"], DEG, {"angle_unit": "rad"}),
        ("", ["hip (deg)", "knee", "ankle"], 1, {"angle_unit": "deg"}),
        ("", ["q/hip", "q/knee", "q/ankle"], DEG, {}),
        ("", ["q/hip", "q/knee", "ankle (deg)"], [DEG, DEG, 1], {}),
        ("# inDegrees=yes\n", ["left", "knee", "ankle"], [-1, 1, 1], {"column_map": {"hip": "-left"}}),
        ("", ["left (deg)", "knee (deg)", "ankle (deg)"], 1, {"column_map": {"hip": "left (deg)"}}),
    ],
)
def test_the_unit_is_said_once_or_in_agreement(put, above, columns, scale, options):
    motion = Motion.from_file(put(text(columns, DATA * scale, above)), LEG, **options)
    np.testing.assert_allclose(motion.qpos, DATA * DEG, rtol=1e-14)


def test_slides_need_no_unit_and_take_theirs(put):
    values = np.column_stack([0.3 * TIME, 2 * TIME])
    for rail, scale in (("rail", 1), ("rail (m)", 1), ("rail (mm)", 1000)):
        motion = Motion.from_file(put(text([rail, "pole (rad)"], values * [scale, 1])), CART)
        np.testing.assert_allclose(motion.qpos, values, rtol=1e-14)


@pytest.mark.parametrize(
    ("model", "above", "columns", "options", "message"),
    [
        (LEG, "", ["hip (deg)", "knee", "ankle"], {}, r"m\.csv: nothing says whether column 'knee' holds degrees or "
         r"radians: write the line '# inDegrees=yes' .*'knee \(deg\)' or 'knee \(rad\)', or give angle_unit"),
        (LEG, "# inDegrees=no\n", ["hip", "knee (deg)", "ankle"], {},
         r"m\.csv: column 'knee' says deg but the header says inDegrees=no: correct one"),
        (LEG, "# inDegrees=yes\n", ["hip", "knee", "ankle"], {"angle_unit": "rad"},
         r"m\.csv: the header says inDegrees=yes but angle_unit says rad: leave angle_unit out"),
        (LEG, "", ["hip (deg)", "knee (deg)", "ankle (deg)"], {"angle_unit": "rad"},
         r"m\.csv: column 'hip' says deg but angle_unit says rad: leave angle_unit out"),
        (LEG, "", ["q/hip", "q/knee", "q/ankle"], {"angle_unit": "deg"},
         r"m\.csv: column 'q/hip' is a solution's, in radians, but angle_unit says deg"),
        (LEG, "", ["hip (m)", "knee (deg)", "ankle (deg)"], {}, r"column 'hip' is in m, but joint hip .* is a hinge"),
        (CART, "", ["rail (deg)", "pole (deg)", "x"], {}, r"column 'rail' is in deg, but joint rail .* is a slide"),
        (LEG, "# inDegrees=yes\n", ["hip", "a", "b"], {}, r"m\.csv: no column for joint knee of .*its columns"),
    ],
)  # fmt: skip
def test_units_and_columns_refused(put, model, above, columns, options, message):
    with pytest.raises(MotionError, match=message):
        Motion.from_file(put(text(columns, DATA, above)), model, **options)


def test_rows_are_checked_as_those_of_any_file(put):
    values = DATA.copy()
    values[4, 1] = np.nan
    columns = ["hip (deg)", "knee (deg)", "ankle (deg)"]
    with pytest.raises(MotionError, match=r"m\.csv, line 6, column 'knee': nan: fill the gap"):
        Motion.from_file(put(text(columns, values)), LEG)
    Motion.from_file(put(text(columns, values)), LEG, start=0.3)
    with pytest.raises(MotionError, match=r"m\.csv, line 4: time 0 s follows 0\.05 s: times must increase"):
        Motion.from_file(put(text(columns, time=np.concatenate([TIME[:2], [0], TIME[3:]]))), LEG)
    with pytest.raises(MotionError, match=r"m\.csv: joint knee is at 10\.5 deg at 0\.5 s, outside its range"):
        Motion.from_file(put(text(columns, np.where(TIME[:, None] == 0.5, [0, 10.5, 0], [0, 10.0, 0]))), LEG)
    with pytest.raises(MotionError, match=r"m\.csv: 3 rows from 0 to 0\.1 s"):
        Motion.from_file(put(text(columns, DATA[:3], time=TIME[:3])), LEG)


def test_a_doubtful_unit_names_who_said_it(put):
    columns = ["hip (deg)", "knee (deg)", "ankle (deg)"]
    with pytest.warns(
        MjhcmcWarning, match=r"column 'hip' says deg but no angle exceeds .* if they are, name it hip \(rad\)"
    ):
        Motion.from_file(put(text(columns, DATA * DEG)), LEG)
    with pytest.raises(
        MotionError, match=r"angle_unit says rad but angles reach 20, .*: if they are, give angle_unit deg"
    ):
        Motion.from_file(put(text(LEG.joint_names)), LEG, angle_unit="rad")


def test_a_saved_solution_is_a_motion(leg8, slow_solution, tmp_path):
    for suffix in (".csv", ".sto"):
        motion = Motion.from_file(slow_solution.save(tmp_path / f"x{suffix}"), leg8)
        np.testing.assert_array_equal(motion.time, slow_solution.time)
        np.testing.assert_array_equal(motion.qpos, slow_solution.qpos)


@given(cut=st.integers(1, len(GOOD) - 1))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
def test_every_cut_within_a_row_is_refused_or_only_cuts_digits(put, cut):
    try:
        table = read_csv(put(GOOD[:-cut]))
    except MotionError:
        return
    n = len(table.time)
    np.testing.assert_array_equal(table.values[: n - 1], np.array([[1, -2], [1.5, -2.5], [2, -3]])[: n - 1])
    assert table.columns == ("hip", "knee")

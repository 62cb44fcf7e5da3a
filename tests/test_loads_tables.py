"""External loads from tables with a map; files, rows and units that cannot be right."""

import json
import warnings

import numpy as np
import pytest
from load_tools import COLUMNS, TIME, TO_Z_UP, VALUES, files, leg, one_force
from numpy.testing import assert_allclose, assert_array_equal

from mjhcmc import MjhcmcWarning, MotionError, SettingsError
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.io.opensim import write_table

__all__ = ["files", "leg"]


def test_a_table_and_a_map(leg, tmp_path):
    path = tmp_path / "grf.sto"
    write_table(path, COLUMNS, TIME, VALUES, name="grf", in_degrees=False)
    by_prefix = {"calcn_r": {"force": "f_v", "point": "f_p", "torque": "t_"}}
    loads = ExternalLoads.from_file(path, leg, column_map=by_prefix)
    assert_array_equal(loads.torque[:, 0], VALUES[:, 6:9] @ TO_Z_UP.T)
    as_json = tmp_path / "map.json"
    as_json.write_text(json.dumps(by_prefix))
    for same in (
        as_json,
        str(as_json),
        {"foot": {"force": COLUMNS[:3], "point": COLUMNS[3:6], "torque": COLUMNS[6:9]}},
    ):
        again = ExternalLoads.from_file(path, leg, column_map=same)
        assert_array_equal(again.force, loads.force)
        assert_array_equal(again.point, loads.point)
    two = {"foot": [{"force": "f_v", "point": "f_p"}, {"force": "1_f_v", "point": "1_f_p"}]}
    both = ExternalLoads.from_file(path, leg, column_map=two)
    assert (both.body, both.labels) == (("foot", "foot"), ("foot 1", "foot 2"))
    assert_array_equal(both.force[:, 1], VALUES[:, 9:12] @ TO_Z_UP.T)
    framed = ExternalLoads.from_file(path, leg, column_map={"foot": {"force": "f_v", "frame": "foot"}})
    assert framed.force_frame == framed.point_frame == ("foot",)


def test_a_csv_with_points_in_mm(leg, tmp_path):
    path = tmp_path / "grf.csv"
    names = ["fx", "fy", "fz", "px (mm)", "py (mm)", "pz (mm)"]
    rows = np.column_stack([TIME, VALUES[:, :3], 1000 * VALUES[:, 3:6]])
    path.write_text("\n".join([",".join(["time", *names]), *(",".join(map(repr, r)) for r in rows.tolist())]))
    loads = ExternalLoads.from_file(path, leg, column_map={"foot": {"force": "f", "point": "p"}})
    assert_allclose(loads.point[:, 0], VALUES[:, 3:6] @ TO_Z_UP.T, rtol=1e-15)
    with pytest.raises(MotionError, match="'px', force of load 'foot', is in mm"):
        ExternalLoads.from_file(path, leg, column_map={"foot": {"force": "p"}})


def test_the_axis_letter_counts_not_the_order_of_columns(leg, tmp_path):
    path = tmp_path / "grf.mot"
    write_table(path, ["f_vz", "f_vx", "f_vy"], TIME, VALUES[:, :3], name="g", in_degrees=False)
    loads = ExternalLoads.from_file(path, leg, column_map={"foot": {"force": "f_v"}}, rotation=np.eye(3))
    assert_array_equal(loads.force[:, 0], VALUES[:, [1, 2, 0]])
    write_table(path, ["f_1", "f_2", "f_3"], TIME, VALUES[:, :3], name="g", in_degrees=False)  # OpenSim's Vec3 columns
    loads = ExternalLoads.from_file(path, leg, column_map={"foot": {"force": "f_"}}, rotation=np.eye(3))
    assert_array_equal(loads.force[:, 0], VALUES[:, :3])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "holds no bodies"),
        ({"foot": "f_v"}, "body 'foot' maps to 'f_v'"),
        ({"foot": {"forces": "f_v"}}, "'forces': its entries are force, point, torque and frame"),
        ({"foot": {"force": ["a", "b"]}}, r"force of body 'foot' is \['a', 'b'\]"),
        ({"foot": {"force": ["f_vx", "f_vy", "f_vq"]}}, "no column 'f_vq' for the force of load 'foot'"),
        ({"foot": {"point": "f_p"}}, "body 'foot' has no force"),
        ({"foot": {"force": "f_v", "frame": 3}}, "frame of body 'foot' is 3"),
        ({"foot": {"force": "g_v"}}, "begin with 'g_v', and none does; its columns are f_vx"),
        ({"foot": {"force": "f_"}}, "begin with 'f_', and f_vx, f_vy, f_vz, f_px, f_py, f_pz do"),
        (None, "nothing says which columns load which body: give the .xml"),
        ("missing.json", "column_map missing.json: cannot be read"),
    ],
)
def test_bad_maps(leg, tmp_path, given, message):
    path = tmp_path / "grf.mot"
    write_table(path, COLUMNS, TIME, VALUES, name="grf", in_degrees=False)
    with pytest.raises((MotionError, SettingsError), match=message) as caught:
        ExternalLoads.from_file(path, leg, column_map=given)
    assert "\n" not in str(caught.value)


def test_arguments_that_do_not_go_together(files, leg, tmp_path):
    path = files()
    with pytest.raises(SettingsError, match="leave column_map out"):
        ExternalLoads.from_file(path, leg, column_map={"foot": {"force": "f_v"}})
    with pytest.raises(SettingsError, match="leave data out"):
        ExternalLoads.from_file(tmp_path / "grf.mot", leg, data="x.mot", column_map={"foot": {"force": "f_v"}})
    with pytest.raises(MotionError, match=r"ends in \.xml, \.mot, \.sto, \.csv, not in '\.c3d'"):
        ExternalLoads.from_file(tmp_path / "grf.c3d", leg)


BOMB = '<?xml version="1.0"?><!DOCTYPE z [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]><OpenSimDocument>&b;</OpenSimDocument>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("<OpenSimDocument><ExternalLoads>", "not sound XML"),
        ("<a>\n<b>\n</a>", "line 3, column 3: not sound XML"),
        ("time\tx\n0\t1\n", "not sound XML"),
        (BOMB, "declares a document type.*without DOCTYPE"),
        ('<?xml version="1.0" encoding="klingon"?><a/>', "XML"),
        ("<OpenSimDocument><Model/></OpenSimDocument>", "give the model as osim"),
        ("<html/>", "no ExternalLoads, but html"),
        ("<ExternalLoads><objects/></ExternalLoads>", "hold no ExternalForce"),
        ("<ExternalLoads><PrescribedForce name='r'/></ExternalLoads>", "'r' is a PrescribedForce, as before OpenSim"),
        ("<ExternalLoads><ExternalForce name='r'/></ExternalLoads>", "load 'r' names no body"),
        (f"<ExternalLoads>{one_force(force='', torque='')}</ExternalLoads>", "neither force nor torque"),
        (f"<ExternalLoads>{one_force(switch='<isDisabled>no</isDisabled>')}</ExternalLoads>", "isDisabled 'no'"),
    ],
)
def test_damaged_xml(leg, tmp_path, text, message):
    path = tmp_path / "loads.xml"
    path.write_text(text)
    with pytest.raises(MotionError, match=message) as caught:
        ExternalLoads.from_file(path, leg)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_files(files, leg, tmp_path):
    with pytest.raises(MotionError, match=r"none\.xml: no such file"):
        ExternalLoads.from_file(tmp_path / "none.xml", leg)
    with pytest.raises(MotionError, match=r"'gone\.mot' is not there"):
        ExternalLoads.from_file(files(datafile="gone.mot"), leg)
    with pytest.raises(MotionError, match=r"none\.mot: no such file"):
        ExternalLoads.from_file(files(), leg, data=tmp_path / "none.mot")
    with pytest.raises(MotionError, match=r"none\.osim: no such file"):
        ExternalLoads.from_file(files(), leg, osim=tmp_path / "none.osim")
    with pytest.raises(MotionError, match="no BodySet with bodies"):
        ExternalLoads.from_file(files(), leg, osim=files())


def test_missing_columns_are_named(files, leg):
    with pytest.raises(
        MotionError, match=r"torque of load 'right' on calcn_r is to be in three columns.*'m_', and none"
    ):
        ExternalLoads.from_file(files(one_force(torque="m_")), leg)
    with pytest.raises(MotionError, match="begin with 'f_v', and f_vx, f_vy do"):
        ExternalLoads.from_file(files(columns=[*COLUMNS[:2], "up", *COLUMNS[3:]]), leg)


def test_a_column_that_stands_twice(files, leg, tmp_path):
    path = files()
    table = tmp_path / "grf.mot"
    table.write_text(table.read_text().replace("\tf_py\t", "\tf_px\t"))
    with pytest.raises(MotionError, match="'f_px' stands twice"):
        ExternalLoads.from_file(path, leg)


def with_nan(column, row=2, **zero):
    values = VALUES.copy()
    values[row, COLUMNS.index(column)] = np.nan
    for prefix in zero.get("zero", ()):
        values[row, [i for i, name in enumerate(COLUMNS) if name.startswith(prefix)]] = 0
    return values


def test_nan_is_named_by_line_and_column(files, leg):
    with pytest.raises(MotionError, match=r"grf\.mot, line 10, column 'f_vy': nan in the force of load 'right'"):
        ExternalLoads.from_file(files(values=with_nan("f_vy")), leg)
    with pytest.raises(MotionError, match="column 'f_px': nan in the point"):
        ExternalLoads.from_file(files(values=with_nan("f_px")), leg)
    with pytest.raises(MotionError, match="column 'f_px': nan in the point"):  # a torque alone loads it
        ExternalLoads.from_file(files(values=with_nan("f_px", zero=["f_v"])), leg)
    with pytest.raises(MotionError, match="line 9: time is not finite"):
        ExternalLoads.from_file(files(time=[0, np.nan, 0.3, 0.4]), leg)
    assert ExternalLoads.from_file(files(values=with_nan("1_f_vy")), leg).body == ("foot",)  # not asked for


def test_a_point_is_not_asked_for_where_there_is_no_load(files, leg):
    values = with_nan("f_px", row=3, zero=["f_v", "t_"])
    loads = ExternalLoads.from_file(files(values=values), leg)
    assert_array_equal(loads.point[3], loads.point[2])
    assert not loads.force[3].any()
    assert any("is 0 and has no point in 1 rows" in notice for notice in loads.notices)


@pytest.mark.parametrize("time", [[0, 0.1, 0.1, 0.4], [0, 0.3, 0.1, 0.4]])
def test_times_must_increase(files, leg, time):
    with pytest.raises(MotionError, match=r"line 10: time 0.1 s follows 0.[13] s: times must increase"):
        ExternalLoads.from_file(files(time=time), leg)


def test_a_row_written_twice_is_dropped(files, leg):
    loads = ExternalLoads.from_file(files(time=TIME[[0, 1, 1, 2, 3]], values=VALUES[[0, 1, 1, 2, 3]]), leg)
    assert_array_equal(loads.time, TIME)
    assert any("1 rows dropped" in notice for notice in loads.notices)


@pytest.mark.parametrize(
    ("columns", "factor", "message"),
    [
        (slice(3, 6), 1000, "column 'f_p[xyz]' of load 'right' reaches .* which looks like mm: .*divide by 1000"),
        (slice(0, 3), 1000, r"column 'f_v[xyz]' .* over 20 times the model's weight \(433.* N\): forces are in N"),
        (slice(6, 9), 1000, "column 't_[xyz]' .* looks like N mm"),
    ],
)
def test_other_units_are_warned_of(files, leg, columns, factor, message):
    values = VALUES.copy()
    values[:, columns] *= factor
    with pytest.warns(MjhcmcWarning, match=message) as caught:
        ExternalLoads.from_file(files(values=values), leg)
    assert caught[0].filename == __file__


def test_points_without_load_do_not_speak_of_units(files, leg):
    values = VALUES.copy()
    values[0, :3], values[0, 3:6] = 0.1, 4e6  # a plate that divides by next to nothing
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ExternalLoads.from_file(files(values=values), leg)

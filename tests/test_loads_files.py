"""External loads read from OpenSim's files: spellings, axes, bodies, the table that they name."""

import numpy as np
import pytest
from load_tools import BODIES, COLUMNS, LEFT, TIME, TO_Z_UP, VALUES, build, files, leg, one_force, posed, wrenches_at
from numpy.testing import assert_allclose, assert_array_equal

from mjhcmc import ModelError, MotionError, SettingsError
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.io.opensim import write_table

__all__ = ["files", "leg"]


def test_vectors_and_points_are_turned_to_z_up(files, leg):
    loads = ExternalLoads.from_file(files(), leg)
    assert_array_equal(loads.time, TIME)
    assert (loads.body, loads.labels) == (("foot",), ("right",))
    assert loads.force_frame == loads.point_frame == ("",)
    for got, first in ((loads.force, 0), (loads.point, 3), (loads.torque, 6)):
        x, y, z = VALUES[:, first : first + 3].T
        assert_array_equal(got[:, 0], np.column_stack([x, -z, y]))


def test_y_up_models_take_the_vectors_as_they_are_and_a_rotation_overrides(files):
    upright = build(gravity="0 -9.81 0")
    path = files()
    assert_array_equal(ExternalLoads.from_file(path, upright).force[:, 0], VALUES[:, :3])
    cyclic = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    turned = ExternalLoads.from_file(path, upright, rotation=cyclic)
    assert_array_equal(turned.point[:, 0], VALUES[:, [4, 5, 3]])


@pytest.mark.parametrize("gravity", ["0 0 0", "-9.81 0 0", "0 0 9.81", "1 0 -9.81"])
def test_other_gravity_asks_for_a_rotation(files, gravity):
    model = build(gravity=gravity)
    with pytest.raises(ModelError, match="up is neither y nor z: give rotation"):
        ExternalLoads.from_file(files(), model)
    assert_array_equal(ExternalLoads.from_file(files(), model, rotation=np.eye(3)).force[:, 0], VALUES[:, :3])


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        (np.diag([1.0, 1, -1]), "right-handed"),
        (2 * np.eye(3), "perpendicular unit vectors"),
        (np.full((3, 3), np.nan), "perpendicular unit vectors"),
        (np.eye(2), "shape"),
        ("up", "not an array"),
    ],
)
def test_what_is_no_rotation_is_refused(files, leg, rotation, message):
    with pytest.raises(SettingsError, match=message):
        ExternalLoads.from_file(files(), leg, rotation=rotation)


@pytest.mark.parametrize("version", ["20302", "30000", "40000", "40500"])
@pytest.mark.parametrize("switch", ["<isDisabled>false</isDisabled>", "<appliesForce> true </appliesForce>", ""])
def test_versions_of_the_xml(files, leg, version, switch):
    loads = ExternalLoads.from_file(files(one_force(switch=switch), version=version), leg)
    assert_array_equal(loads.force[:, 0], VALUES[:, :3] @ TO_Z_UP.T)


@pytest.mark.parametrize("switch", ["<isDisabled>true</isDisabled>", "<appliesForce>false</appliesForce>"])
def test_switched_off_loads_are_left_out(files, leg, switch):
    off = one_force(name="off", body="nobody", switch=switch)
    loads = ExternalLoads.from_file(files(off, one_force()), leg)
    assert loads.labels == ("right",)
    assert any("'off'" in notice and "switches it off" in notice for notice in loads.notices)
    with pytest.raises(MotionError, match=r"no load is left for model 'stepper'.*switches it off"):
        ExternalLoads.from_file(files(off), leg)


def test_spellings_that_opensim_also_takes(files, leg):
    """ExternalLoads as the root, paths of components, blanks, no frames and no data source."""
    form = "<ExternalLoads><objects>{forces}</objects><datafile> {datafile} </datafile></ExternalLoads>"
    bare = (
        "<ExternalForce><applied_to_body> /bodyset/calcn_r </applied_to_body><force_identifier>f_v</force_identifier>"
        "<point_identifier>f_p</point_identifier><point_expressed_in_body>/ground</point_expressed_in_body>"
        "</ExternalForce>"
    )
    loads = ExternalLoads.from_file(files(bare, form=form), leg)
    assert loads.body == ("foot",)
    assert loads.labels == ("load 1",)
    assert_array_equal(loads.point[:, 0], VALUES[:, 3:6] @ TO_Z_UP.T)
    assert not loads.torque.any()


def test_a_force_without_a_point_acts_at_the_bodys_origin(files, leg):
    loads = ExternalLoads.from_file(files(one_force(point="", torque="Unassigned")), leg)
    assert loads.point_frame == ("foot",)
    assert not loads.point.any()
    assert any("at the origin of body 'foot'" in notice for notice in loads.notices)
    d = posed(leg, [0.1, 0.2, 0.3, 0.4, -0.5, 0.6])
    wrench = wrenches_at(loads, leg, d, [0.1])[0, 0]
    foot = leg.mj_model.body("foot").id
    assert_allclose(wrench[3:], np.cross(d.xpos[foot] - d.xipos[foot], wrench[:3]), atol=1e-12)


def test_a_torque_alone(files, leg):
    loads = ExternalLoads.from_file(files(one_force(force="", point="")), leg)
    assert not loads.force.any()
    wrench = wrenches_at(loads, leg, posed(leg, np.zeros(6)), TIME)
    assert_allclose(wrench[:, 0], np.column_stack([np.zeros((4, 3)), VALUES[:, 6:9] @ TO_Z_UP.T]))


def test_vectors_in_a_bodys_frame_follow_the_zero_pose(files):
    """The shank's own axes are turned in the model: OpenSim's lie along the ground in the zero pose."""
    model = build(turn='euler="0 .3 0"')
    path = files(one_force(body="tibia_r", force_frame="tibia_r", point_frame="tibia_r"))
    loads = ExternalLoads.from_file(path, model)
    assert loads.force_frame == loads.point_frame == ("shank",)
    d = posed(model, np.zeros(6))
    shank = model.mj_model.body("shank").id
    wrench = wrenches_at(loads, model, d, TIME)[:, 0]
    force, point, torque = (VALUES[:, i : i + 3] @ TO_Z_UP.T for i in (0, 3, 6))
    assert_allclose(wrench[:, :3], force, atol=1e-12)
    lever = d.xpos[shank] + point - d.xipos[shank]
    assert_allclose(wrench[:, 3:], torque + np.cross(lever, force), atol=1e-12)
    assert any("from the origin of 'shank'" in notice for notice in loads.notices)


def test_data_overrides_the_datafile(files, leg, tmp_path):
    other = tmp_path / "other.sto"
    write_table(other, COLUMNS, TIME, 2 * VALUES, name="o", in_degrees=False)
    loads = ExternalLoads.from_file(files(datafile="gone.mot"), leg, data=other)
    assert_array_equal(loads.force[:, 0], 2 * VALUES[:, :3] @ TO_Z_UP.T)


def test_a_datafile_from_another_machine_is_found_beside_the_xml(files, leg, tmp_path):
    files()
    path = files(datafile=r"C:\trials\walk\grf.mot".replace("grf.mot", "plates.mot"))
    with pytest.raises(MotionError, match=r"datafile.*is not there.*put it beside"):
        ExternalLoads.from_file(path, leg)
    (tmp_path / "grf.mot").rename(tmp_path / "plates.mot")
    loads = ExternalLoads.from_file(path, leg)
    assert any("plates.mot is read" in notice for notice in loads.notices)


def test_the_loads_own_data_source_serves_where_there_is_no_datafile(files, leg):
    files()
    own = one_force().replace("Unassigned", "grf.mot")
    assert ExternalLoads.from_file(files(own, datafile=""), leg).body == ("foot",)
    with pytest.raises(MotionError, match=r"names no datafile.*give the table of loads with data"):
        ExternalLoads.from_file(files(datafile="Unassigned"), leg)


def test_bodies_of_the_side_that_is_not_modelled_are_left_out(files, leg, tmp_path):
    path = files(one_force(), LEFT)
    osim = tmp_path / "subject.osim"
    osim.write_text(
        '<OpenSimDocument Version="40000"><Model><BodySet><objects>'
        + "".join(f'<Body name="{name}"><mass>1</mass></Body>' for name in BODIES)
        + "</objects></BodySet></Model></OpenSimDocument>"
    )
    for given_osim, called in ((osim, "subject.osim"), (str(osim), "subject.osim"), (set(BODIES), "osim")):
        loads = ExternalLoads.from_file(path, leg, osim=given_osim)
        assert loads.body == ("foot",)
        left = [notice for notice in loads.notices if "'left' on calcn_l left out" in notice]
        assert len(left) == 1
        assert called in left[0]
    with pytest.raises(MotionError, match=r"load 'left' names body 'calcn_l', which is not known.*pelvis.*or give"):
        ExternalLoads.from_file(path, leg)
    with pytest.raises(MotionError, match=r"no load is left.*calcn_l left out"):
        ExternalLoads.from_file(files(LEFT), leg, osim=osim)


def test_a_body_in_neither_model_is_an_error_that_lists_the_valid_ones(files, leg):
    with pytest.raises(MotionError, match=r"'hoof_r', which is not known: model 'stepper' has pelvis, thigh.*calcn_l"):
        ExternalLoads.from_file(files(one_force(body="hoof_r")), leg, osim=BODIES)
    with pytest.raises(MotionError, match="'hoof'"):
        ExternalLoads.from_file(files(one_force(point_frame="hoof")), leg)


def test_an_unknown_body_lists_each_known_one_once_and_a_remedy_for_both_callers(files):
    leg = build(custom='<custom><text name="opensim_bodies" data="pelvis=pelvis calcn_r=foot"/></custom>')
    path = files(one_force(body="hoof_r"))
    for osim, remedy in (
        (None, "or give the measured model with osim= (on the command line --osim"),
        (BODIES, "name,"),
    ):
        with pytest.raises(MotionError) as raised:
            ExternalLoads.from_file(path, leg, osim=osim)
        known = str(raised.value).partition("not known:")[2]
        assert known.count("pelvis") == known.count("calcn_r") == 1
        assert remedy in known
        assert "bodies=" in known
        assert "--loads-map" in known


def test_the_callers_map_goes_before_names_and_the_models_text(files, leg):
    assert ExternalLoads.from_file(files(), leg, bodies={"calcn_r": "shank"}).body == ("shank",)
    assert ExternalLoads.from_file(files(one_force(body="thigh")), leg).body == ("thigh",)
    assert ExternalLoads.from_file(files(one_force(body="thigh")), leg, bodies={"thigh": "foot"}).body == ("foot",)
    with pytest.raises(SettingsError, match="maps to 'toe', but the bodies of model 'stepper' are pelvis"):
        ExternalLoads.from_file(files(), leg, bodies={"calcn_r": "toe"})
    with pytest.raises(SettingsError, match=r"no load on 'calcn_R': it names calcn_r"):
        ExternalLoads.from_file(files(), leg, bodies={"calcn_R": "foot"})


def test_a_frame_that_only_opensim_has_is_an_error(files, leg):
    with pytest.raises(MotionError, match="in the frame of calcn_l"):
        ExternalLoads.from_file(files(one_force(point_frame="calcn_l")), leg, osim=BODIES)


@pytest.mark.parametrize("text", ["calcn_r=hoof", "calcn_r", "calcn_r=foot calcn_r=shank", "=foot"])
def test_a_bad_custom_text_is_named(files, text):
    model = build(custom=f'<custom><text name="opensim_bodies" data="{text}"/></custom>')
    with pytest.raises(ModelError, match="custom text 'opensim_bodies' holds"):
        ExternalLoads.from_file(files(), model)


def test_loads_read_for_another_model(files, leg, two_joints):
    loads = ExternalLoads.from_file(files(), leg)
    with pytest.raises(ModelError, match="has no body 'foot': its bodies are upper, lower"):
        loads.ids(two_joints)

"""Export for OpenSim: names, signs, steps, fiber lengths; both files or neither; OpenSim itself, where installed."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import PENDULUMS, SHARED, load_xml
from hypothesis import given
from hypothesis import strategies as st

import mjhcmc
from mjhcmc.io.export import export_opensim
from mjhcmc.io.opensim import read_table, write_table
from mjhcmc.leg8.table import load_table

COORDINATES = ("hip_r/hip_flexion_r", "knee_r/knee_angle_r", "ankle_r/ankle_angle_r")
TEXTS = {
    "opensim_coordinates": "shoulder=-arm_flex elbow=elbow_flexion",
    "opensim_paths": "shoulder=/jointset/acromial/arm_flex elbow=/jointset/elbow_r/elbow_flexion",
    "opensim_muscles": "biceps=BIClong",
    "pennation_angles": "biceps=0.5",
}


def with_texts(**texts):
    custom = "".join(f'<text name="{name}" data="{data}"/>' for name, data in texts.items())
    return load_xml(PENDULUMS.replace("<actuator>", f"<custom>{custom}</custom><actuator>"))


def solve(model):
    motion = mjhcmc.Motion.cosine(model, amplitudes={"shoulder": 0.3, "elbow": -0.2}, period=0.8, cycles=1)
    return mjhcmc.hcmc(model, motion, dt=0.02)


def columns(path):
    table = read_table(path)
    return dict(zip(table.columns, table.values.T, strict=True))


@pytest.fixture(scope="module")
def arm(two_joints):
    return solve(two_joints)


@pytest.fixture(scope="module")
def tables(fast_solution, tmp_path_factory):
    """The two files of fast, read back."""
    paths = export_opensim(fast_solution, tmp_path_factory.mktemp("export") / "fast.v1")
    assert [path.name for path in paths] == ["fast.v1_controls.sto", "fast.v1_states.sto"]
    return [read_table(path) for path in paths]


def test_names_are_opensims(tables, leg8):
    controls, states = tables
    assert controls.columns == tuple(f"{muscle}_r" for muscle in leg8.muscle_names)
    coordinates = [f"/jointset/{path}/{kind}" for path in COORDINATES for kind in ("value", "speed")]
    muscles = [f"/forceset/{m}_r/{kind}" for m in leg8.muscle_names for kind in ("activation", "fiber_length")]
    assert states.columns == (*coordinates, *muscles)
    for table, name in zip(tables, ("controls", "states"), strict=True):
        assert table.name == name
        assert table.header["inDegrees"] == "no"
        assert np.isfinite(table.values).all()


def test_states_come_back_bit_for_bit(tables, fast_solution):
    states = dict(zip(tables[1].columns, tables[1].values.T, strict=True))
    np.testing.assert_array_equal(tables[1].time, fast_solution.time)
    for j, path in enumerate(COORDINATES):
        np.testing.assert_array_equal(states[f"/jointset/{path}/value"], fast_solution.qpos[:, j])
        np.testing.assert_array_equal(states[f"/jointset/{path}/speed"], fast_solution.qvel[:, j])
    for i, muscle in enumerate(fast_solution.muscle_names):
        np.testing.assert_array_equal(states[f"/forceset/{muscle}_r/activation"], fast_solution.activation[:, i])


@given(window=st.integers(0, 59), share=st.floats(0, 0.999))
def test_controls_interpolated_linearly_are_the_steps(tables, fast_solution, window, share):
    time = fast_solution.time[window] + share * (fast_solution.time[window + 1] - fast_solution.time[window])
    values = [np.interp(time, tables[0].time, column) for column in tables[0].values.T]
    np.testing.assert_allclose(values, fast_solution.excitation[window], atol=1e-12)


def test_controls_cover_the_motion_in_order(tables, fast_solution):
    time = tables[0].time
    assert (np.diff(time) > 0).all()
    assert (time[0], time[-1]) == (fast_solution.time[0], fast_solution.time[-1])
    assert len(time) == 2 * fast_solution.n_window
    np.testing.assert_array_equal(tables[0].values[-1], fast_solution.excitation[-1])


def test_fiber_lengths_follow_from_the_source_table(tables, fast_solution, leg8):
    """By pennation of constant thickness, from the tendon's length and the source's own numbers."""
    import mujoco

    states = dict(zip(tables[1].columns, tables[1].values.T, strict=True))
    table, data, k = load_table(), mujoco.MjData(leg8.mj_model), 17
    data.qpos[:] = fast_solution.qpos[k]
    mujoco.mj_fwdPosition(leg8.mj_model, data)
    for muscle in leg8.muscle_names:
        source = table["source"]["muscles"][muscle]
        slack = source["tendon_slack_length"] + table["fitted"]["slack_offset"][muscle]
        along = data.ten_length[leg8.mj_model.tendon(f"{muscle}_tendon").id] - slack
        thickness = source["optimal_fiber_length"] * math.sin(source["pennation_angle"])
        expected = math.sqrt(along**2 + thickness**2)
        assert states[f"/forceset/{muscle}_r/fiber_length"][k] == pytest.approx(expected, abs=2e-6), muscle


def test_a_minus_in_the_column_map_flips_value_and_speed(tmp_path):
    model = with_texts(**TEXTS)
    solution = solve(model)
    _, path = export_opensim(solution, tmp_path / "arm")
    states = columns(path)
    np.testing.assert_array_equal(states["/jointset/acromial/arm_flex/value"], -solution.qpos[:, 0])
    np.testing.assert_array_equal(states["/jointset/acromial/arm_flex/speed"], -solution.qvel[:, 0])
    np.testing.assert_array_equal(states["/jointset/elbow_r/elbow_flexion/value"], solution.qpos[:, 1])
    assert "\t-0.0\t" not in path.read_text()
    assert "/forceset/flexor/activation" in states
    assert "/forceset/BIClong/fiber_length" in states
    assert "/forceset/flexor/fiber_length" not in states  # its pennation is not known


def test_values_exported_are_read_back_as_the_same_motion(tmp_path):
    model = with_texts(**TEXTS)
    solution = solve(model)
    _, path = export_opensim(solution, tmp_path / "arm")
    motion = mjhcmc.Motion.from_file(path, model)
    np.testing.assert_array_equal(motion.qpos, solution.qpos)


def test_a_model_without_texts_goes_by_its_own_names(arm, tmp_path):
    controls, states = (columns(path) for path in export_opensim(arm, tmp_path / "arm"))
    assert tuple(controls) == ("flexor", "biceps")
    assert tuple(states) == (
        "/jointset/shoulder/shoulder/value", "/jointset/shoulder/shoulder/speed",
        "/jointset/elbow/elbow/value", "/jointset/elbow/elbow/speed",
        "/forceset/flexor/activation", "/forceset/biceps/activation",
    )  # fmt: skip
    solution = solve(
        with_texts(opensim_coordinates="shoulder=-arm_flex")
    )  # a sign belongs to a path, and there is none
    _, path = export_opensim(solution, tmp_path / "arm")
    np.testing.assert_array_equal(columns(path)["/jointset/shoulder/shoulder/value"], solution.qpos[:, 0])


def test_a_solution_from_a_file_needs_its_model(arm, two_joints, tmp_path):
    saved = arm.save(tmp_path / "arm.parquet")
    with pytest.raises(mjhcmc.OutputError, match=r"does not know its model: read it with Solution\.load\(path, model="):
        export_opensim(mjhcmc.Solution.load(saved), tmp_path / "arm")
    assert list(tmp_path.glob("*.sto")) == []
    first = [path.read_bytes() for path in export_opensim(arm, tmp_path / "arm")]
    loaded = mjhcmc.Solution.load(saved, model=two_joints)
    assert first == [path.read_bytes() for path in export_opensim(loaded, str(tmp_path / "arm"))]


def test_both_files_or_neither(arm, tmp_path):
    for kind in ("controls", "states"):
        blocked = tmp_path / f"{kind}_blocked_{kind}.sto"
        blocked.mkdir()
        with pytest.raises(mjhcmc.OutputError, match=rf"{kind}_blocked_{kind}\.sto: cannot be written, it is a folder"):
            export_opensim(arm, tmp_path / f"{kind}_blocked")
        assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
    with pytest.raises(mjhcmc.OutputError, match="there is no folder"):
        export_opensim(arm, tmp_path / "absent" / "arm")
    renamed = replace(arm.model, muscle_names=("flexor", "bi ceps"))
    odd = replace(arm, model=renamed, muscle_names=renamed.muscle_names)
    with pytest.raises(mjhcmc.OutputError, match=r"'bi ceps' cannot be written: .* no blanks: rename"):
        export_opensim(odd, tmp_path / "arm")
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.parametrize(
    ("text", "data", "message"),
    [
        ("opensim_paths", "wrist=/jointset/a/b", r"'wrist=/jointset/a/b'[;:] write joint=/jointset/.*shoulder, elbow"),
        ("opensim_paths", "shoulder=arm_flex", r"joint 'shoulder' the path 'arm_flex': write it as /jointset/"),
        ("opensim_paths", "shoulder=/j/a/b elbow=/j/a/b", r"'shoulder' and 'elbow' the same name '/j/a/b'"),
        ("opensim_muscles", "biceps", r"holds 'biceps'[;:] write muscle=name, once each, for flexor, biceps"),
        ("opensim_muscles", "biceps=a biceps=b", r"holds 'biceps=b' a second time"),
        ("pennation_angles", "biceps=25", r"'biceps' the angle '25': write radians"),
        ("pennation_angles", "biceps=wide", r"'biceps' the angle 'wide': write radians"),
        ("pennation_angles", "biceps=nan", r"'biceps' the angle 'nan': write radians"),
    ],
)
def test_names_refused(text, data, message):
    with pytest.raises(mjhcmc.ModelError, match=rf"^model 'two_joints': custom text '{text}' .*{message}[^\n]*$"):
        with_texts(**{text: data})


# --- a moving pelvis, tied joints, balls ---------------------------------------------------------------------------

PELVIS = ("pelvis_tx", "pelvis_ty", "pelvis_tilt")


@pytest.fixture(scope="module")
def gait():
    model = mjhcmc.MuscleModel.load("leg8_gait")
    time = 0.01 * np.arange(9)
    q = np.tile(model.qpos_reference, (9, 1)) + 0.1 * np.sin(5 * time)[:, None] * [1, 2, 3, 1, -2, 1]
    return mjhcmc.hcmc(model, mjhcmc.Motion(time, q, "step"))


def test_a_moving_pelvis_goes_by_opensims_paths(gait, tmp_path):
    states = columns(export_opensim(gait, tmp_path / "gait")[1])
    paths = [f"/jointset/ground_pelvis/{name}" for name in PELVIS] + [f"/jointset/{path}" for path in COORDINATES]
    assert list(states)[:12] == [f"{path}/{kind}" for path in paths for kind in ("value", "speed")]
    for j, path in enumerate(paths):
        np.testing.assert_array_equal(states[f"{path}/value"], gait.qpos[:, j])
        np.testing.assert_array_equal(states[f"{path}/speed"], gait.qvel[:, j])


@pytest.mark.parametrize("path", [None, "/jointset/elbow_r/elbow_flexion"])
def test_a_tied_joint_is_left_out_unless_it_has_a_path(tmp_path, path):
    text = f'<custom><text name="opensim_paths" data="elbow={path}"/></custom>' if path else ""
    tied = '<equality><joint joint1="elbow" joint2="shoulder" polycoef="0 .5 0 0 0"/></equality>'
    model = load_xml(PENDULUMS.replace("<actuator>", f"{text}{tied}<actuator>"))
    motion = mjhcmc.Motion.cosine(model, amplitudes={"shoulder": 0.1}, period=0.8, cycles=0.1)
    solution = mjhcmc.hcmc(model, motion)
    states = columns(export_opensim(solution, tmp_path / "arm")[1])
    values = [name for name in states if name.endswith("/value")]
    assert values == ["/jointset/shoulder/shoulder/value"] + [f"{path}/value"] * bool(path)
    if path:
        np.testing.assert_array_equal(states[f"{path}/value"], solution.qpos[:, 1])


def test_a_ball_is_refused_in_one_line_and_nothing_is_written(arm, tmp_path):
    model = load_xml(PENDULUMS.replace('name="elbow" type="hinge"', 'name="elbow" type="ball"').replace(
        'axis="0 -1 0" range="-120 120" limited="true"/>\n        <geom type="capsule" fromto="0 0 0 0 0 -.25"',
        '/>\n        <geom type="capsule" fromto="0 0 0 0 0 -.25"'))  # fmt: skip
    with pytest.raises(mjhcmc.OutputError, match=r"^model 'two_joints': joint 'elbow' turns by a quaternion[^\n]*$"):
        export_opensim(replace(arm, model=model), tmp_path / "arm")
    assert list(tmp_path.iterdir()) == []


# --- OpenSim itself, where it is installed -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def opensim():
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("error")
    return opensim


@pytest.fixture
def osim_leg(opensim):
    path = SHARED / "reference" / "leg8" / "leg8.osim"
    if not path.is_file():
        pytest.skip("OpenSim's twin of leg8 (shared/reference/leg8) is not beside this checkout")
    return opensim.Model(str(path))


@pytest.fixture(scope="module")
def files(fast_solution, tmp_path_factory):
    return [str(path) for path in export_opensim(fast_solution, tmp_path_factory.mktemp("opensim") / "fast")]


def test_opensim_takes_the_states(opensim, osim_leg, files, fast_solution):
    osim_leg.initSystem()
    states = opensim.StatesTrajectory.createFromStatesTable(
        osim_leg, opensim.TimeSeriesTable(files[1]), False, False, True
    )  # no column missing, none too many
    assert states.getSize() == len(fast_solution.time)
    for k in range(states.getSize()):
        osim_leg.realizeVelocity(states.get(k))
        for j, path in enumerate(COORDINATES):
            coordinate = osim_leg.getCoordinateSet().get(path.split("/")[1])
            assert coordinate.getValue(states.get(k)) == fast_solution.qpos[k, j]
            assert coordinate.getSpeedValue(states.get(k)) == fast_solution.qvel[k, j]
        for i, name in enumerate(fast_solution.muscle_names):
            muscle = osim_leg.getMuscles().get(f"{name}_r")
            assert muscle.getActivation(states.get(k)) == max(0.01, fast_solution.activation[k, i])


def test_opensims_foot_is_where_the_model_has_it(opensim, walk_folder, tmp_path):
    """The subject's leg on its pelvis, in OpenSim's whole body: a world turned by a quarter, the same foot."""
    import mujoco

    from mjhcmc.leg8 import leg8_from_osim

    model = mjhcmc.MuscleModel.load(leg8_from_osim(walk_folder / "subject01.osim"))
    motion = mjhcmc.Motion.from_file(walk_folder / "subject_adjusted_Kinematics_q.sto", model, start=0.9, end=1.0)
    solution = mjhcmc.hcmc(model, motion)
    whole = opensim.Model(str(walk_folder / "subject01.osim"))
    whole.initSystem()
    table = opensim.TimeSeriesTable(str(export_opensim(solution, tmp_path / "walk")[1]))
    states = opensim.StatesTrajectory.createFromStatesTable(whole, table, True, False, True)  # the rest is missing
    data = mujoco.MjData(model.mj_model)
    for k in (0, 5, 10):
        data.qpos[:] = solution.qpos[k]
        mujoco.mj_kinematics(model.mj_model, data)
        x, y, z = data.body("foot").xpos
        whole.realizePosition(states.get(k))
        found = whole.getBodySet().get("talus_r").getPositionInGround(states.get(k)).to_numpy()
        np.testing.assert_allclose(found, [x, z, -y], atol=3e-3)  # m; the knee is a hinge here


def test_fiber_lengths_are_those_of_opensims_rigid_tendons(opensim, osim_leg, files, leg8):
    for name in leg8.muscle_names:
        osim_leg.getMuscles().get(f"{name}_r").set_ignore_tendon_compliance(True)
    osim_leg.initSystem()
    table = opensim.TimeSeriesTable(files[1])
    states = opensim.StatesTrajectory.createFromStatesTable(osim_leg, table, False, True, True)
    for k in range(0, states.getSize(), 5):
        osim_leg.realizePosition(states.get(k))
        for name in leg8.muscle_names:
            length = osim_leg.getMuscles().get(f"{name}_r").getFiberLength(states.get(k))
            written = table.getDependentColumn(f"/forceset/{name}_r/fiber_length")[k]
            assert written == pytest.approx(length, abs=3e-4), name  # m; the knee's paths are fitted


@pytest.mark.parametrize("method", [None, 0, 1])
def test_opensim_takes_the_steps_of_the_controls(opensim, osim_leg, files, fast_solution, method):
    controller = opensim.PrescribedController()
    controller.set_controls_file(files[0])
    if method is not None:
        controller.set_interpolation_method(method)
    osim_leg.addController(controller)
    state = osim_leg.initSystem()
    for k in range(fast_solution.n_window):
        for share in (1e-3, 0.5, 0.999):
            state.setTime(fast_solution.time[k] + share * fast_solution.dt)
            osim_leg.realizeVelocity(state)
            found = [osim_leg.getMuscles().get(f"{m}_r").getControl(state) for m in fast_solution.muscle_names]
            np.testing.assert_allclose(found, fast_solution.excitation[k], atol=1e-12)


def test_opensims_leg_moves_alike_under_the_controls(opensim, osim_leg, files, fast_solution):
    """Open loop, other curves, compliant tendons: it drifts; after 50 ms (5 deg of hip) by far less than it moved."""
    controller = opensim.PrescribedController()
    controller.set_controls_file(files[0])
    osim_leg.addController(controller)
    state = osim_leg.initSystem()
    states = opensim.StatesTrajectory.createFromStatesTable(
        osim_leg, opensim.TimeSeriesTable(files[1]), False, False, True
    )
    start = states.get(0)  # lives as long as states
    state.setQ(start.getQ())
    state.setU(start.getU())
    osim_leg.realizeVelocity(start)
    for name in fast_solution.muscle_names:
        muscle = osim_leg.getMuscles().get(f"{name}_r")
        muscle.setActivation(state, muscle.getActivation(start))
    osim_leg.equilibrateMuscles(state)
    manager = opensim.Manager(osim_leg)
    manager.initialize(state)
    state = manager.integrate(0.05)
    names = [path.split("/")[1] for path in COORDINATES]
    angles = np.degrees([osim_leg.getCoordinateSet().get(name).getValue(state) for name in names])
    moved = np.degrees(fast_solution.qpos[5])
    assert (np.abs(angles - moved) < 0.15 * np.abs(moved)).all(), (angles, moved)


def test_opensim_reads_what_write_table_writes(opensim, tmp_path):
    values = np.array([[1 / 3, -2e-300, 5e-324], [1e300, -0.0, 12345678.9]])
    path = tmp_path / "any.sto"
    note = json.dumps({"a=b": "c d"})
    write_table(path, ["a", "/b/c", "ü|d"], [1 / 3, 0.7], values, name="any", in_degrees=False, extra={"note": note})
    table = opensim.TimeSeriesTable(str(path))
    assert table.getColumnLabels() == ("a", "/b/c", "ü|d")
    np.testing.assert_array_equal(table.getMatrix().to_numpy(), values)
    np.testing.assert_array_equal(table.getIndependentColumn(), [1 / 3, 0.7])
    assert opensim.Storage(str(path)).getSize() == 2


def test_opensim_reads_a_saved_solution(opensim, fast_solution, tmp_path):
    table = opensim.TimeSeriesTable(str(fast_solution.save(tmp_path / "fast.sto")))
    assert table.getNumRows() == len(fast_solution.time)
    np.testing.assert_array_equal(table.getDependentColumn("q/knee").to_numpy(), fast_solution.qpos[:, 1])
    excitation = table.getDependentColumn("excitation/soleus").to_numpy()
    np.testing.assert_array_equal(excitation[:-1], fast_solution.excitation[:, 6])
    assert np.isnan(excitation[-1])

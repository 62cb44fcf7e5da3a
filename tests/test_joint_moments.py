"""Joint moments of the user's own: the load that they imply, solving and replaying under it, files, bad input."""

import copy
import dataclasses

import mujoco
import numpy as np
import pytest
from conftest import PENDULUMS, load_xml

import mjhcmc
from mjhcmc.dynamics import moment_arms
from mjhcmc.plant import State

GRAVITY, MASS, STRENGTH = 9.81, 2.0, 100.0
METHODS = [mjhcmc.hcmc, mjhcmc.cmc, mjhcmc.static_optimization]


def inverse_dynamics(model, motion, times):
    """(n, nv) net joint moments by plain MuJoCo: of the skeleton and its joints, without what belongs to muscles."""
    m = copy.copy(model.mj_model)
    m.tendon_damping[:] = 0
    d, rows = mujoco.MjData(m), []
    reference = motion.sample(times)
    for qpos, qvel, qacc in zip(reference.qpos, reference.qvel, reference.qacc, strict=True):
        d.qpos[:], d.qvel[:], d.qacc[:] = qpos, qvel, qacc
        mujoco.mj_inverse(m, d)
        rows.append(d.qfrc_inverse.copy())
    return np.array(rows)


def extra(times, nv):
    """A smooth load of its own kind at each joint, N m."""
    t = np.asarray(times)[:, None]
    return np.array([1.5, 0.5, 0.3, 0.2][:nv]) * np.sin(5 * t + np.arange(nv))


def moments_of(model, motion, load=True, rows=400):
    """Moments that imply the load `extra`, or none."""
    times = np.linspace(motion.start, motion.end, rows)
    moment = inverse_dynamics(model, motion, times)
    return mjhcmc.JointMoments(times, moment - extra(times, model.nv) if load else moment)


@pytest.fixture(scope="module")
def swing(slow):
    """One cycle of the slow movement."""
    return dataclasses.replace(slow, span=(0, 0.6))


def height_motion(model, **kw):
    return mjhcmc.Motion.cosine(model, amplitudes={"height": -0.05}, period=0.5, cycles=1, **kw)


# --- the implied load ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("movement", ["slow", "fast"])
def test_the_moments_of_inverse_dynamics_imply_no_load(leg8, movement):
    motion = mjhcmc.Motion.cosine(leg8, movement)
    moments = moments_of(leg8, motion, load=False, rows=2001)
    times = np.linspace(0, motion.end, 777)
    load = moments.implied_load(mjhcmc.MujocoPlant(leg8), motion)(times)
    assert load.shape == (777, 3)
    np.testing.assert_array_less(np.abs(load).max(axis=0), 1e-6 * np.abs(moments.moment).max(axis=0))


def test_other_moments_imply_the_difference(leg8, slow):
    load = moments_of(leg8, slow).implied_load(mjhcmc.MujocoPlant(leg8), slow)
    times = np.linspace(0, slow.end, 777)
    np.testing.assert_allclose(load(times), extra(times, 3), atol=1e-4)


def test_joints_own_damping_and_stiffness_and_other_actuators_are_no_muscle():
    """Damping of the muscles' tendons is muscle force; springs and dampers of the joints, and motors, are not."""
    xml = PENDULUMS.replace('name="elbow"', 'name="elbow" damping=".4" stiffness="2" armature=".01"')
    xml = xml.replace("</actuator>", '<motor name="servo" joint="shoulder" ctrlrange="-1 1"/></actuator>')
    model = load_xml(xml)
    motion = mjhcmc.Motion.cosine(model, amplitudes={"shoulder": 0.3, "elbow": 0.5}, period=0.6, cycles=1)
    moments = moments_of(model, motion, load=False, rows=1001)
    load = moments.implied_load(mjhcmc.MujocoPlant(model), motion)(np.linspace(0, motion.end, 99))
    np.testing.assert_allclose(load, 0, atol=1e-6)


def test_the_clock_is_the_motions(leg8, slow):
    later = mjhcmc.Motion(slow.time + 5.0, slow.qpos)
    load = moments_of(leg8, later).implied_load(mjhcmc.MujocoPlant(leg8), later)
    np.testing.assert_allclose(load(np.array([5.3, 6.0])), extra([5.3, 6.0], 3), atol=1e-4)
    part = dataclasses.replace(later, span=(5.5, 6.0))
    solution = mjhcmc.cmc(leg8, part, joint_moments=moments_of(leg8, later))
    np.testing.assert_allclose(solution.external_load, extra(solution.time, 3), atol=1e-3)
    assert solution.time[0] == 5.5


# --- the plant under load --------------------------------------------------------------------------------------------


def test_a_load_drives_the_plant(linear_mass):
    """m v' = 100 a - m g + E(t), E a ramp: the load in the middle of each step is its mean over it."""
    plant = mjhcmc.MujocoPlant(linear_mass, 0.001, external=lambda t: 5.0 + 40.0 * t[:, None])
    hold = MASS * GRAVITY / STRENGTH
    plant.set_state(State(2.0, np.array([0.1]), np.zeros(1), np.array([hold]), np.zeros(1)))
    plant.advance(np.array([hold]), np.array([3.0]), 100)
    gained = ((5.0 + 3.0) * 0.1 + 20.0 * (2.1**2 - 2.0**2)) / MASS
    assert plant.get_state().qvel[0] == pytest.approx(gained, rel=1e-9)
    assert plant.external_load() == pytest.approx([5.0 + 40.0 * 2.1], rel=1e-12)
    assert plant.forward()[0] == pytest.approx((3.0 + 5.0 + 40.0 * 2.1) / MASS, rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_one_muscle_gives_the_users_force(linear_mass, method):
    """Q = 100 a: the activation at every node is the user's force over 100, whatever the motion alone would need."""
    motion = height_motion(linear_mass)
    times = np.linspace(0, motion.end, 200)
    force = 30 + 15 * np.sin(7 * times[:, None])
    solution = method(linear_mass, motion, dt=0.005, joint_moments=mjhcmc.JointMoments(times, force, "mine"))
    expected = 30 + 15 * np.sin(7 * solution.time[:, None])
    tolerance = 1e-6 if method is mjhcmc.static_optimization else 0.02 * 45
    np.testing.assert_allclose(solution.net_joint_moment, expected, atol=tolerance)
    np.testing.assert_allclose(solution.activation, expected / STRENGTH, atol=tolerance / STRENGTH)
    own = MASS * (motion.sample(solution.time).qacc + GRAVITY)
    np.testing.assert_allclose(solution.external_load, own - expected, atol=1e-3)
    assert np.abs(solution.tracking_error).max() < 2e-3
    assert solution.settings["joint_moments"] == "mine"


@pytest.mark.parametrize(("method", "degrees", "share"), [(mjhcmc.hcmc, 0.001, 0.02), (mjhcmc.cmc, 0.5, 0.06)])
def test_the_leg_follows_its_motion_under_the_users_moments(leg8, swing, method, degrees, share):
    moments = moments_of(leg8, swing)
    solution = method(leg8, swing, dt=0.005, joint_moments=moments)
    assert np.rad2deg(np.abs(solution.tracking_error)).max() < degrees
    ours = inverse_dynamics(leg8, swing, solution.time)
    users = ours - extra(solution.time, 3)
    assert np.abs(ours - users).max(axis=0) == pytest.approx([1.5, 0.5, 0.3], rel=0.01)  # not the same thing
    np.testing.assert_array_less(
        np.abs(solution.net_joint_moment - users).max(axis=0), share * np.abs(users).max(axis=0)
    )
    assert (solution.status == 0).all()
    assert solution.verdict.passed


@pytest.mark.parametrize("method", METHODS)
def test_the_books_balance_under_load(leg8, fast, method):
    """Muscles and reserves give what plain MuJoCo needs for the simulated acceleration, less the load."""
    moments = moments_of(leg8, fast)
    solution = method(leg8, fast, joint_moments=moments)
    m, n = leg8.mj_model, solution.n_window
    d, plant = mujoco.MjData(m), mjhcmc.MujocoPlant(leg8)
    np.testing.assert_allclose(solution.external_load, extra(solution.time, 3), atol=2e-3)
    for k in range(n + 1):
        reserve = solution.reserve[min(k, n - 1)]
        d.qpos[:], d.qvel[:], d.act[:] = solution.qpos[k], solution.qvel[k], solution.activation[k]
        d.qfrc_applied[:] = reserve + solution.external_load[k]
        mujoco.mj_forward(m, d)
        mujoco.mj_inverse(m, d)
        damping = m.tendon_damping * d.ten_velocity
        plant.set_state(State(0.0, d.qpos, d.qvel, d.act, np.zeros(3)))
        plant.forward()
        R = moment_arms(plant)
        needed = d.qfrc_inverse + R.T @ damping - solution.external_load[k]
        np.testing.assert_allclose(solution.net_joint_moment[k], needed, rtol=1e-9, atol=1e-9)
        given = R.T @ solution.muscle_force[k] + reserve
        np.testing.assert_allclose(solution.net_joint_moment[k], given, rtol=1e-9, atol=1e-9)


def test_replay_knows_the_load(leg8, swing, linear_mass):
    solution = mjhcmc.hcmc(leg8, swing, joint_moments=moments_of(leg8, swing))
    verdict = solution.verdict
    assert verdict.replay_max_error is None  # open loop is unstable under measured loads
    assert np.rad2deg(max(verdict.replay_window_max_error)) < 1e-4
    np.testing.assert_allclose(mjhcmc.replay_windows(solution, 1e-3), solution.qpos, rtol=0, atol=1e-13)
    without = mjhcmc.replay_windows(dataclasses.replace(solution, surroundings=None))
    assert np.rad2deg(np.abs(without - solution.qpos)).max() > 0.01
    motion = height_motion(linear_mass)
    times = np.linspace(0, motion.end, 50)
    solution = mjhcmc.hcmc(linear_mass, motion, joint_moments=mjhcmc.JointMoments(times, 25 + 0 * times[:, None]))
    np.testing.assert_allclose(mjhcmc.replay(solution, 1e-3), solution.qpos, rtol=0, atol=1e-12)  # here it is neutral


def test_an_interrupted_solve_keeps_the_load(leg8, swing):
    def stop(done, _):
        if done == 10:
            raise KeyboardInterrupt

    with pytest.raises(mjhcmc.SolveInterrupted) as caught:
        mjhcmc.cmc(leg8, swing, joint_moments=moments_of(leg8, swing), progress=stop)
    part = caught.value.solution
    np.testing.assert_allclose(part.external_load, extra(part.time, 3), atol=1e-3)
    assert part.verdict.replay_window_max_error is not None


def test_a_plant_of_ones_own_under_load(leg8, swing):
    moments = moments_of(leg8, swing)
    load = moments.implied_load(mjhcmc.MujocoPlant(leg8), swing)
    own = mjhcmc.hcmc(leg8, swing, plant=mjhcmc.MujocoPlant(leg8, 0.001, external=load))
    given = mjhcmc.hcmc(leg8, swing, joint_moments=moments)
    np.testing.assert_allclose(own.excitation, given.excitation, atol=1e-9)
    with pytest.raises(mjhcmc.SettingsError, match=r"exclude each other: build the plant with external=joint_moments"):
        mjhcmc.hcmc(leg8, swing, joint_moments=moments, plant=mjhcmc.MujocoPlant(leg8))


@pytest.fixture(scope="module")
def loaded(leg8, swing):
    return mjhcmc.cmc(leg8, dataclasses.replace(swing, span=(0, 0.3)), joint_moments=moments_of(leg8, swing))


@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".sto", ".nc"])
def test_a_loaded_solution_survives_a_file(tmp_path, leg8, loaded, suffix):
    if suffix == ".nc":
        pytest.importorskip("xarray")
    solution = loaded
    read = mjhcmc.Solution.load(solution.save(tmp_path / f"walk{suffix}"), model=leg8)
    np.testing.assert_array_equal(read.external_load, solution.external_load)
    np.testing.assert_array_equal(read.net_joint_moment, solution.net_joint_moment)
    assert read.verdict.passed
    assert read.verdict.replay_max_error is None  # not even with the model: the load between the nodes is not in a file
    if suffix != ".csv":  # which holds neither settings nor verdict
        assert read.settings["joint_moments"] == "joint moments"
        assert read.verdict == solution.verdict


# --- files -----------------------------------------------------------------------------------------------------------

OPENSIM = {"hip": "hip_flexion_r", "knee": "knee_angle_r", "ankle": "ankle_angle_r"}


def write_table(path, columns, rows, title="Inverse Dynamics Generalized Forces"):
    """A .sto or .mot as OpenSim's inverse dynamics writes it, or a plain .csv."""
    comma = path.suffix == ".csv"
    separator = "," if comma else "\t"
    head = [] if comma else [title, "version=1", f"nRows={len(rows)}", f"nColumns={len(columns)}", "inDegrees=no"]
    lines = [*head, *([] if comma else ["endheader"]), separator.join(columns)]
    lines += [separator.join(repr(float(value)) for value in row) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def table(rows=9):
    times = np.linspace(0, 1.8, rows)
    return np.column_stack([times, 10 * np.cos(times), 20 + times, -times])


@pytest.mark.parametrize("suffix", [".sto", ".mot", ".csv"])
def test_a_file_with_opensims_names(tmp_path, leg8, suffix):
    rows = table()
    columns = ["time", "pelvis_tx_force", "hip_flexion_r_moment", "ankle_angle_r_moment", "knee_angle_r_moment"]
    data = np.column_stack([rows[:, 0], 700 + rows[:, 0], rows[:, 1], rows[:, 3], rows[:, 2]])
    path = write_table(tmp_path / f"id{suffix}", columns, data)
    read = mjhcmc.JointMoments.from_file(path, leg8)
    np.testing.assert_array_equal(read.time, rows[:, 0])
    np.testing.assert_array_equal(read.moment, rows[:, 1:])
    assert read.name == str(path)


@pytest.mark.parametrize("form", ["{}", "{}_moment", "moment/{}"])
@pytest.mark.parametrize("names", [{j: j for j in OPENSIM}, OPENSIM])
def test_names_that_are_found(tmp_path, leg8, form, names):
    path = write_table(tmp_path / "id.csv", ["time", *(form.format(name) for name in names.values())], table())
    np.testing.assert_array_equal(mjhcmc.JointMoments.from_file(str(path), leg8).moment, table()[:, 1:])


def test_a_slides_force(tmp_path, linear_mass):
    path = write_table(tmp_path / "id.sto", ["time", "height_force"], table()[:, :2])
    np.testing.assert_array_equal(mjhcmc.JointMoments.from_file(path, linear_mass).moment, table()[:, 1:2])


@pytest.mark.parametrize("as_file", [False, True])
def test_a_map_names_columns_and_flips_signs(tmp_path, leg8, as_file):
    path = write_table(tmp_path / "id.sto", ["time", "hip_torque", "knee_flexion_moment", "ankle"], table())
    column_map = {"hip": "hip_torque", "knee": "-knee_flexion"}
    if as_file:
        (tmp_path / "map.json").write_text('{"hip": "hip_torque", "knee": "-knee_flexion"}', encoding="utf-8")
        column_map = tmp_path / "map.json"
    read = mjhcmc.JointMoments.from_file(path, leg8, column_map)
    np.testing.assert_array_equal(read.moment, table()[:, 1:] * [1, -1, 1])


@pytest.mark.parametrize("suffix", [".csv", ".sto"])
def test_our_own_tables_hold_moments_to_share_again(tmp_path, leg8, slow, slow_solution, suffix):
    path = slow_solution.save(tmp_path / f"walk{suffix}")
    read = mjhcmc.JointMoments.from_file(path, leg8)
    np.testing.assert_array_equal(read.time, slow_solution.time)
    np.testing.assert_array_equal(read.moment, slow_solution.net_joint_moment)
    again = mjhcmc.cmc(leg8, slow, joint_moments=read, cost="cubic")
    assert np.rad2deg(np.abs(again.tracking_error)).max() < 0.2
    assert np.all(np.abs(again.external_load).max(axis=0) < 0.1 * slow_solution.peak_moment)


# --- bad input -------------------------------------------------------------------------------------------------------


def good(rows=9, columns=3):
    return np.linspace(0, 1.8, rows), np.zeros((rows, columns))


BAD_ARRAYS = [
    ((np.linspace(0, 1.8, 3), np.zeros((3, 3))), r"time has shape \(3,\) and moment \(3, 3\): give .* at least 4 rows"),
    ((np.linspace(0, 1.8, 9), np.zeros((8, 3))), r"time has shape \(9,\) and moment \(8, 3\)"),
    ((np.linspace(0, 1.8, 9), np.zeros(9)), r"time has shape \(9,\) and moment \(9,\)"),
    ((np.linspace(0, 1.8, 9), np.where(np.arange(27) == 16, np.nan, 0).reshape(9, 3)), r"row 5 \(from 0\).*not finite"),
    ((np.array([0, 0.1, np.inf, 0.3]), np.zeros((4, 3))), r"row 2 \(from 0\) holds a value that is not finite"),
    ((np.array([0, 0.2, 0.2, 0.3]), np.zeros((4, 3))), r"row 2 \(from 0\): time 0.2 s follows 0.2 s: times must incr"),
    ((np.array([0, 0.3, 0.2, 0.4]), np.zeros((4, 3))), r"row 2 \(from 0\): time 0.2 s follows 0.3 s"),
]


@pytest.mark.parametrize(("arrays", "message"), BAD_ARRAYS)
def test_bad_arrays_are_named(arrays, message):
    with pytest.raises(mjhcmc.MotionError, match=rf"^mine: {message}") as caught:
        mjhcmc.JointMoments(*arrays, name="mine")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", METHODS)
def test_moments_that_do_not_fit_are_refused_before_the_work(leg8, slow, method):
    short = mjhcmc.JointMoments(np.linspace(0.2, 1.5, 9), np.zeros((9, 3)), "short.sto")
    message = r"short.sto covers 0.2 .. 1.5 s, the motion 'slow' 0 .. 1.8 s: give moments for all of it, or crop it"
    with pytest.raises(mjhcmc.MotionError, match=message):
        method(leg8, slow, joint_moments=short, progress=pytest.fail)
    within = dataclasses.replace(slow, span=(0.2, 0.4))
    assert method(leg8, within, joint_moments=short).n_window == 20
    narrow = mjhcmc.JointMoments(*good(columns=2))
    with pytest.raises(mjhcmc.MotionError, match=r"has 2 columns, model 'leg8' has 3 joints \(hip, knee, ankle\)"):
        method(leg8, slow, joint_moments=narrow, progress=pytest.fail)
    with pytest.raises(mjhcmc.SettingsError, match=r"must be JointMoments; got ndarray: use JointMoments.from_file"):
        method(leg8, slow, joint_moments=np.zeros((9, 3)), progress=pytest.fail)


def test_bad_files_are_named(tmp_path, leg8):
    columns = ["time", *OPENSIM.values()]
    read = mjhcmc.JointMoments.from_file

    def refused(path, message, *args):
        with pytest.raises(mjhcmc.MotionError, match=message) as caught:
            read(path, leg8, *args)
        assert "\n" not in str(caught.value)

    refused(tmp_path / "none.sto", r"none\.sto")
    refused(
        write_table(tmp_path / "id.txt", columns, table()), r"id\.txt: a file of joint moments ends in .*\.sto.*not in"
    )
    refused(tmp_path / "id", r"not in 'nothing'")
    lacking = write_table(tmp_path / "lacking.sto", columns[:3], table()[:, :3])
    refused(
        lacking, r"lacking\.sto: no column for the moment at joint ankle \(looked for .*ankle_angle_r_moment.*\); its"
    )
    refused(lacking, r"model 'leg8' has no joint 'toe': its joints are hip, knee, ankle", {"toe": "x"})
    refused(lacking, r"no column for the moment at joint hip \(looked for torque_moment", {"hip": "-torque"})
    holes = table()
    holes[4, 2] = np.nan
    refused(write_table(tmp_path / "holes.sto", columns, holes), r"line 12: the moment of knee is not finite: fill")
    refused(write_table(tmp_path / "short.csv", columns, table(3)), r"short\.csv.*at least 4 rows")
    back = table()
    back[5, 0] = back[4, 0]
    refused(write_table(tmp_path / "back.sto", columns, back), r"back\.sto.*(increas|follows)")
    words = tmp_path / "words.csv"
    words.write_text("time,hip,knee,ankle\n0,1,2,three\n", encoding="utf-8")
    refused(words, r"words\.csv.*three")


def test_angles_are_not_taken_for_moments(tmp_path, leg8):
    """The motion's own file in place of the moments': its columns have the joints' names too."""
    path = write_table(tmp_path / "walk.mot", ["time", *OPENSIM.values()], table())
    path.write_text(path.read_text(encoding="utf-8").replace("inDegrees=no", "inDegrees=yes"), encoding="utf-8")
    with pytest.raises(
        mjhcmc.MotionError, match=r"walk\.mot: column hip_flexion_r holds angles in degrees, by what the"
    ):
        mjhcmc.JointMoments.from_file(path, leg8)
    path = write_table(tmp_path / "walk.csv", ["time", "hip (rad)", "knee (rad)", "ankle (rad)"], table())
    with pytest.raises(mjhcmc.MotionError, match=r"walk\.csv: column hip holds angles in rad"):
        mjhcmc.JointMoments.from_file(path, leg8)
    both = ["time", "hip (rad)", "hip_flexion_r_moment", "knee_moment", "ankle_moment"]
    path = write_table(
        tmp_path / "both.csv", both, np.column_stack([table()[:, :1], 9 + 0 * table()[:, :1], table()[:, 1:]])
    )
    np.testing.assert_array_equal(mjhcmc.JointMoments.from_file(path, leg8).moment, table()[:, 1:])

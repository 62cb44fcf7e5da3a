"""Tables of solutions with other than hinges and slides, or not all tracked: names, round trips, what loading knows."""

import copy
import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from conftest import PENDULUMS, load_xml

import mjhcmc
from mjhcmc.coordinate_names import NamedCoordinates
from mjhcmc.external_loads import ExternalLoads

SUFFIXES = (".parquet", ".csv", ".sto", ".nc")
ARRAYS = (
    "time", "excitation", "activation", "qpos", "qpos_desired", "qvel", "tracking_error", "net_joint_moment",
    "muscle_force", "reserve", "shortfall", "external_load", "status", "residual",
)  # fmt: skip

FLOATING = """
<mujoco model="floating">
  <option integrator="RK4" gravity="0 0 -9.81"/>
  <worldbody>
    <body name="base" pos="0 0 1">
      <freejoint name="root"/>
      <geom type="box" size=".1 .1 .1" mass="5" contype="0" conaffinity="0"/>
      <site name="a" pos=".06 0 0"/><site name="c" pos="-.06 0 0"/>
      <body name="upper">
        <joint name="swing" axis="0 -1 0" damping=".5"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1" contype="0" conaffinity="0"/>
        <site name="b" pos=".04 0 -.15"/><site name="d" pos="-.04 0 -.15"/>
        <body name="head" pos="0 0 -.3">
          <joint name="neck" type="ball" damping=".1"/>
          <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".03" mass=".5" contype="0" conaffinity="0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="front" damping="2"><site site="a"/><site site="b"/></spatial>
    <spatial name="back" damping="2"><site site="c"/><site site="d"/></spatial>
  </tendon>
  <actuator>
    <muscle name="flexor" tendon="front" force="150" lengthrange=".05 .3" ctrlrange="0 1"/>
    <muscle name="extensor" tendon="back" force="150" lengthrange=".05 .3" ctrlrange="0 1"/>
  </actuator>
</mujoco>
"""
ROOT = tuple(f"root_{end}" for end in ("tx", "ty", "tz", "rx", "ry", "rz"))
DOFS = (*ROOT, "swing", "neck_rx", "neck_ry", "neck_rz")
COORDINATES = (
    *ROOT[:3], *(f"root_q{c}" for c in "wxyz"), "swing", *(f"neck_q{c}" for c in "wxyz"),
)  # fmt: skip


@pytest.fixture(scope="module")
def floating_model():
    """A free root and a ball, both led along the motion."""
    return load_xml(FLOATING).with_roles(prescribed=["root", "neck"])


@pytest.fixture(scope="module")
def floating(floating_model):
    time = 0.01 * np.arange(9)
    q = np.tile(floating_model.qpos_reference, (9, 1))
    q[:, 0] += 0.1 * time
    for first, rate in ((3, 1.0), (8, 2.0)):
        q[:, first], q[:, first + 1] = np.cos(rate * time), np.sin(rate * time)
    q[:, 7] = 0.1 * np.sin(8 * time)
    return mjhcmc.hcmc(floating_model, mjhcmc.Motion(time, q, "drift", quaternions=floating_model.quaternions))


@pytest.fixture(scope="module")
def gait_model():
    return mjhcmc.MuscleModel.load("leg8_gait")


@pytest.fixture(scope="module")
def gait(gait_model):
    """A swing of the leg below a pelvis that moves, under a steady push on the foot."""
    time = 0.01 * np.arange(13)
    q = np.tile(gait_model.qpos_reference, (13, 1))
    q[:, 0] += 0.5 * time
    q[:, 3:] += 0.1 * np.sin(6 * time)[:, None]
    push = (np.tile(v, (2, 1, 1)) for v in ([0.0, 0.0, 60.0], [0.0, 0.0, 0.0], [0.1, 0.0, 0.05]))
    loads = ExternalLoads("plate", np.array([0.0, 1.0]), ("foot",), *push)
    return mjhcmc.hcmc(gait_model, mjhcmc.Motion(time, q, "step"), loads=loads)


def assert_same(loaded, solution):
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(loaded, name), getattr(solution, name), err_msg=name)
    for name in ("muscle_names", "dof_names", "coordinate_names"):
        assert getattr(loaded, name) == getattr(solution, name)


# --- the table --------------------------------------------------------------------------------------------------


def test_positions_are_named_by_coordinate_and_all_else_by_degree_of_freedom(floating):
    assert floating.dof_names == DOFS
    assert floating.coordinate_names == COORDINATES
    table = floating.to_dataframe()
    for prefix in ("q", "q_desired"):
        assert [c for c in table if c.startswith(f"{prefix}/")] == [f"{prefix}/{name}" for name in COORDINATES]
    for prefix in ("qvel", "moment", "reserve", "shortfall"):
        assert [c for c in table if c.startswith(f"{prefix}/")] == [f"{prefix}/{name}" for name in DOFS]
    np.testing.assert_array_equal(table["q/neck_qx"], floating.qpos[:, 9])
    np.testing.assert_array_equal(table["qvel/neck_rx"], floating.qvel[:, 7])


def test_only_what_can_have_a_residual_has_a_column_of_it(floating, fast_solution):
    columns = [c for c in floating.to_dataframe() if c.startswith("residual/")]
    assert columns == [f"residual/{name}" for name in DOFS if name != "swing"]
    np.testing.assert_array_equal(floating.to_dataframe()["residual/root_tz"], floating.residual[:, 2])
    assert np.abs(floating.residual[:, 2]).max() > 50  # it bears the weight
    assert not [c for c in fast_solution.to_dataframe() if c.startswith("residual/")]
    assert "residual" not in fast_solution.to_xarray()


def test_a_tracked_root_has_one_and_dependent_and_free_ones_have_none(fast_solution):
    roles = {"roles": ["tracked", "dependent", "free"], "root": ["hip", "ankle"]}
    solution = replace(fast_solution, settings={**fast_solution.settings, **roles})
    assert solution.may_have_residual.tolist() == [True, False, False]


def test_the_dataset_has_a_dimension_for_coordinates(floating, fast_solution):
    data = floating.to_xarray()
    assert data["qpos"].dims == ("node", "coordinate")
    assert tuple(data["coordinate"].to_numpy()) == COORDINATES
    np.testing.assert_array_equal(data["residual"].sel(dof="root_tz"), floating.residual[:, 2])
    assert fast_solution.to_xarray()["qpos"].dims == ("node", "dof")


def test_reactions_in_the_table_are_named_by_joint(floating):
    table = floating.to_dataframe(detail=True)
    joints = dict.fromkeys(c.split("/")[1] for c in table if c.startswith("reaction_force/"))
    assert list(joints) == ["root", "swing", "neck"]
    np.testing.assert_array_equal(table["reaction_force/neck/z"], floating.detail.joint_reaction_force[:, 2, 2])


# --- files ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("which", ["floating", "gait"])
def test_a_file_brings_everything_back(tmp_path, request, which, suffix):
    solution = request.getfixturevalue(which)
    loaded = mjhcmc.Solution.load(solution.save(tmp_path / f"a{suffix}"))
    assert_same(loaded, solution)
    assert loaded.roles == solution.roles
    assert not loaded.knows_surroundings
    if suffix != ".csv":
        assert loaded.settings == solution.settings
        assert loaded.verdict == solution.verdict
        assert loaded.is_root.tolist() == solution.is_root.tolist()
    assert_same(mjhcmc.Solution.load(loaded.save(tmp_path / f"b{suffix}")), solution)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("which", ["floating", "gait"])
def test_with_its_model_detail_is_known_and_reactions_are_not(tmp_path, request, which, suffix):
    solution, model = request.getfixturevalue(which), request.getfixturevalue(f"{which}_model")
    loaded = mjhcmc.Solution.load(solution.save(tmp_path / f"a{suffix}"), model=model)
    assert loaded.roles == solution.roles
    assert loaded.is_root.tolist() == solution.is_root.tolist()
    assert loaded.dof_is_rotation.tolist() == solution.dof_is_rotation.tolist()
    assert loaded.verdict.passed == solution.verdict.passed
    if suffix == ".csv":
        assert loaded.verdict.replay_window_max_error is None
    else:
        assert loaded.verdict == solution.verdict
    np.testing.assert_allclose(loaded.detail.muscle_moment, solution.detail.muscle_moment, atol=1e-9)
    with pytest.warns(mjhcmc.MjhcmcWarning, match="joint reactions are not known"):
        assert np.isnan(loaded.detail.joint_reaction_force).all()


def test_the_roles_of_the_solve_come_back_whatever_the_model_says(tmp_path, floating):
    loaded = mjhcmc.Solution.load(floating.save(tmp_path / "a.parquet"), model=load_xml(FLOATING))
    assert tuple(loaded.model.roles.of) == floating.roles


def test_names_that_are_not_the_models_are_refused(tmp_path, floating, gait_model):
    model = load_xml(FLOATING.replace('type="ball"', 'axis="1 0 0"'))
    path = floating.save(tmp_path / "a.parquet")
    with pytest.raises(mjhcmc.OutputError, match=r"joint 8 is 'neck_rx' in the file and 'neck' in model 'floating'"):
        mjhcmc.Solution.load(path, model=model)
    renamed = replace(floating, coordinate_names=("x", *COORDINATES[1:]), model=None)
    with pytest.raises(mjhcmc.OutputError, match=r"coordinate 1 is 'x' and degree of freedom 1 'root_tx'"):
        mjhcmc.Solution.load(replace(renamed, stored_verdict=floating.verdict).save(tmp_path / "b.parquet"))


def test_equalities_that_are_not_the_models_are_refused(tmp_path, two_joints):
    motion = mjhcmc.Motion.cosine(two_joints, amplitudes={"shoulder": 0.1}, period=0.8, cycles=0.1)
    path = mjhcmc.hcmc(two_joints, motion).save(tmp_path / "a.parquet")
    tied = '<equality><joint joint1="elbow" joint2="shoulder" polycoef="0 1 0 0 0"/></equality>'
    model = load_xml(PENDULUMS.replace("<actuator>", f"{tied}<actuator>"))
    with pytest.raises(mjhcmc.OutputError, match=r"'elbow' is tracked in the file and dependent in model 'two_joints'"):
        mjhcmc.Solution.load(path, model=model)


@pytest.mark.parametrize("roles", [["tracked"], ["tracked", "tracked", "led"]])
def test_roles_that_are_none_are_refused(fast_solution, roles):
    with pytest.raises(mjhcmc.OutputError, match=r"^solution: roles are [^\n]*expected 3 of tracked, dependent"):
        replace(fast_solution, settings={**fast_solution.settings, "roles": roles})


def test_a_plain_solution_names_its_coordinates_like_its_degrees_of_freedom(fast_solution):
    bare = replace(fast_solution, model=None, coordinate_names=())
    assert bare.coordinate_names == bare.dof_names == fast_solution.coordinate_names


# --- coordinates by name ----------------------------------------------------------------------------------------


def test_differences_by_name_are_those_of_the_model(floating_model):
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 5, 12))
    for q in (a, b):
        for first in (3, 8):
            q[:, first : first + 4] /= np.linalg.norm(q[:, first : first + 4], axis=1, keepdims=True)
    named = NamedCoordinates(COORDINATES, DOFS)
    np.testing.assert_array_equal(named.difference(a, b), floating_model.coordinates.difference(a, b))
    shown = named.shown(a, b[0])
    np.testing.assert_array_equal(shown[:, [0, 1, 2, 6]], a[:, [0, 1, 2, 7]])
    expected = floating_model.coordinates.difference(a, np.tile(b[0], (5, 1)))
    np.testing.assert_array_equal(shown[:, [3, 4, 5, 7, 8, 9]], expected[:, [3, 4, 5, 7, 8, 9]])


@pytest.mark.parametrize(
    ("coordinates", "dofs"),
    [(("a", "b"), ("a",)), (("n_qw", "n_qx", "n_qy"), ("n_rx", "n_ry")), (COORDINATES[:-1], DOFS), ((), ("a",))],
)
def test_names_that_do_not_belong_together_are_refused(coordinates, dofs):
    with pytest.raises(mjhcmc.OutputError, match="do not belong together"):
        NamedCoordinates(coordinates, dofs)


# --- joint reactions under measured loads -----------------------------------------------------------------------


def test_under_measured_loads_the_ankle_bears_what_newton_says(gait):
    """The foot's change of momentum is weight, push, muscles and the ankle's reaction."""
    model = gait.model.mj_model
    foot, d = model.body("foot").id, mujoco.MjData(model)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reaction = gait.detail.joint_reaction_force[:, model.joint("ankle").id]

    def momentum(state):
        d.qpos[:], d.qvel[:] = state.qpos, state.qvel
        mujoco.mj_forward(model, d)
        mujoco.mj_subtreeVel(model, d)
        return model.body_subtreemass[foot] * d.subtree_linvel[foot]

    plant = gait.plant(physics_dt=1e-5)
    for k in (3, 6, 9):
        plant.set_state(gait.state(k))
        plant.advance(gait.excitation[k], gait.reserve[k], 1)
        rate = (momentum(plant.get_state()) - momentum(gait.state(k))) / 1e-5
        muscles = -length_gradient(gait, k, foot).T @ gait.muscle_force[k]
        weight = model.body_subtreemass[foot] * model.opt.gravity
        found = reaction[k] + muscles + weight + [0, 0, 60.0]
        np.testing.assert_allclose(found[[0, 2]], rate[[0, 2]], atol=5e-3)  # N, of 60 and more


def length_gradient(solution, k, body):
    """(n_muscle, 3) of each path's length with the place of a body, all else as at node k: by moving the body."""
    m, step = copy.deepcopy(solution.model.mj_model), 1e-6
    d, place = mujoco.MjData(m), m.body_pos[body].copy()
    d.qpos[:] = solution.qpos[k]
    mujoco.mj_kinematics(m, d)
    parent = d.xmat[m.body_parentid[body]].reshape(3, 3).copy()
    gradient = np.zeros((len(solution.muscle_names), 3))
    for axis in range(3):
        for sign in (1, -1):
            m.body_pos[body] = place + sign * step * parent[axis]
            mujoco.mj_forward(m, d)
            gradient[:, axis] += sign * d.actuator_length[solution.model.muscle_ids] / (2 * step)
    return gradient


def test_on_the_walk_the_ankle_bears_some_body_weights_in_stance_and_little_in_swing(walk_folder):
    from mjhcmc.leg8 import leg8_from_osim

    model = mjhcmc.MuscleModel.load(leg8_from_osim(walk_folder / "subject01.osim"))
    motion = mjhcmc.Motion.from_file(walk_folder / "subject_adjusted_Kinematics_q.sto", model, start=0.8, end=1.6)
    loads = ExternalLoads.from_file(walk_folder / "subject01_walk_grf.xml", model, osim=walk_folder / "subject01.osim")
    solution = mjhcmc.hcmc(model, motion, loads=loads)
    reaction = np.linalg.norm(solution.detail.joint_reaction_force[:, -1], axis=1)
    push = np.linalg.norm(loads.sample(solution.time).force[:, 0], axis=1)
    weight = push.max() / 1.1
    stance = push > 0.5 * weight
    assert (reaction[stance] > push[stance]).all()  # muscles press the joint together
    assert 2 * weight < reaction.max() < 6 * weight
    assert push[-1] < 1
    assert reaction[-1] < 0.5 * weight

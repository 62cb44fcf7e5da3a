"""Detail: contributions add up, power is the change of energy, fibers are MuJoCo's own, files know it with a model."""

import dataclasses

import mujoco
import numpy as np
import pytest
from conftest import HANGING_MASS, LINEAR_ACTUATOR, MUSCLE_ACTUATOR, load_xml
from many_muscles import chain, swing
from numpy.testing import assert_allclose, assert_array_equal
from recorded import recorded, reserve_at_nodes

import mjhcmc
from mjhcmc import MujocoPlant
from mjhcmc.plant import State

REACTIONS = ("joint_reaction_force", "joint_reaction_moment")


def arrays(detail):
    names = [item.name for item in dataclasses.fields(detail) if item.name != "solution"]
    return {name: getattr(detail, name) for name in (*names, *REACTIONS)}


def with_(solution, **changes):
    return dataclasses.replace(solution, **changes)


@pytest.fixture(scope="module")
def overloaded():
    """A chain whose muscles are too weak: reserves at every joint."""
    solution = swing(chain(4, 24, force=15.0))
    assert (np.abs(solution.reserve).max(axis=0) > 0.01).all()
    return solution


# --- the contract -----------------------------------------------------------------------------------------------


def test_shapes(fast_solution):
    node, muscle = (61, 8), [
        "musculotendon_length", "musculotendon_velocity", "fiber_length", "fiber_velocity", "normalized_fiber_length",
        "normalized_fiber_velocity", "muscle_power",
    ]  # fmt: skip
    expected = dict.fromkeys(muscle, node)
    expected |= dict.fromkeys(("muscle_moment", "active_moment", "passive_moment"), (61, 8, 3))
    expected |= dict.fromkeys(REACTIONS, (61, 3, 3))
    found = arrays(fast_solution.detail)
    assert {name: value.shape for name, value in found.items()} == expected
    assert all(np.isfinite(value).all() for value in found.values())


def test_detail_is_computed_once_and_read_only(fast_solution):
    assert fast_solution.detail is fast_solution.detail
    for name, values in arrays(fast_solution.detail).items():
        assert getattr(fast_solution.detail, name) is values
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0


# --- contributions ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["fast_solution", "slow_solution", "overloaded"])
def test_contributions_and_reserve_add_up_to_the_net_moment(request, name):
    solution = request.getfixturevalue(name)
    found = solution.detail.muscle_moment.sum(axis=1) + reserve_at_nodes(solution)
    assert np.abs(found - solution.net_joint_moment).max() < 1e-9 * solution.peak_moment.max()


def test_a_contribution_is_the_moment_arm_times_the_recorded_force(fast_solution):
    """Moment arms by differences of the path's length."""
    model, k, step = fast_solution.model, 17, 1e-6
    for j in range(model.nv):
        ends = fast_solution.qpos[k] + step * np.outer([1, -1], np.eye(model.nv)[j])
        length = recorded(model, ends).detail.musculotendon_length
        expected = -(length[0] - length[1]) / (2 * step) * fast_solution.muscle_force[k]
        assert_allclose(fast_solution.detail.muscle_moment[k, :, j], expected, atol=1e-4)


def test_the_active_part_is_proportional_to_activation_and_the_passive_part_the_rest(fast_solution):
    detail = fast_solution.detail
    assert_allclose(detail.active_moment + detail.passive_moment, detail.muscle_moment, atol=1e-12)
    resting = with_(fast_solution, activation=np.zeros_like(fast_solution.activation)).detail
    assert_allclose(resting.muscle_moment, detail.passive_moment, atol=1e-11)
    half = with_(fast_solution, activation=0.5 * fast_solution.activation).detail
    assert_allclose(half.active_moment, 0.5 * detail.active_moment, atol=1e-11)
    assert np.abs(detail.passive_moment).max() > 1  # there is something to part
    assert np.abs(detail.active_moment).max() > 1


# --- power ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["fast_solution", "overloaded"])
def test_powers_add_up_to_the_power_of_the_joint_moments(request, name):
    solution = request.getfixturevalue(name)
    power = solution.detail.muscle_power.sum(axis=1)
    expected = ((solution.net_joint_moment - reserve_at_nodes(solution)) * solution.qvel).sum(axis=1)
    assert_allclose(power, expected, atol=1e-10 * np.abs(expected).max())


def test_power_is_positive_where_a_pulling_muscle_shortens(hanging_mass):
    up = recorded(hanging_mass, [[0.0], [0.0]], qvel=[[0.5], [-0.5]], activation=0.5)
    force = up.detail.muscle_moment[:, 0, 0]  # the path is vertical: moment arm 1
    assert (force > 0).all()
    assert_allclose(up.detail.muscle_power[:, 0], force * [0.5, -0.5])


@pytest.mark.parametrize("name", ["fast_solution", "overloaded"])
def test_muscles_and_reserves_give_what_the_energy_gains(request, name):
    """Energy by MuJoCo, its rate by steps of 10 us along the plant's own motion; the chain's joints take some."""
    solution, step = request.getfixturevalue(name), 1e-5
    plant = MujocoPlant(solution.model, step)
    plant.mj_model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    nodes = range(0, solution.n_window, max(1, solution.n_window // 20))
    rate = []
    for k in nodes:
        plant.set_state(
            State(0.0, solution.qpos[k], solution.qvel[k], solution.activation[k], np.zeros(solution.model.nv))
        )
        energy = []
        for n_step in (0, 1, 1):
            plant.advance(solution.excitation[k], solution.reserve[k], n_step)
            plant.forward()
            energy.append(plant.mj_data.energy.sum())
        rate.append((-3 * energy[0] + 4 * energy[1] - energy[2]) / (2 * step))
    given = solution.detail.muscle_power.sum(axis=1) + (reserve_at_nodes(solution) * solution.qvel).sum(axis=1)
    given -= (plant.mj_model.dof_damping * solution.qvel**2).sum(axis=1)
    assert_allclose(rate, given[list(nodes)], atol=1e-4 * np.abs(given).max())


# --- fibers -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gear", [1, 2])
def test_fibers_of_a_muscle_in_closed_form(gear):
    """Lengthrange .5..1.5 m means .75..1.05 optimal lengths: L0 = 1/.3 m, whatever the gear scales."""
    muscle = MUSCLE_ACTUATOR.replace('lengthrange=".5 1.5"', f'lengthrange="{0.5 * gear} {1.5 * gear}" gear="{gear}"')
    model = load_xml(HANGING_MASS.format(actuator=muscle))
    height, speed = np.array([[-0.3], [0.0], [0.2]]), np.array([[0.4], [0.0], [-0.6]])
    detail = recorded(model, height, speed).detail
    assert_allclose(detail.musculotendon_length, 1 - height)
    assert_allclose(detail.musculotendon_velocity, -speed)
    assert_allclose(detail.normalized_fiber_length, 0.75 + 0.3 * (0.5 - height))
    assert_allclose(detail.fiber_length, (0.75 + 0.3 * (0.5 - height)) / 0.3)
    assert_allclose(detail.fiber_velocity, -speed)
    assert_allclose(detail.normalized_fiber_velocity, -0.3 * speed)


def test_an_active_muscle_is_strongest_at_the_normalized_length_1(hanging_mass):
    m = hanging_mass.mj_model
    heights = np.linspace(-0.45, 0.45, 181)[:, None]
    detail = recorded(hanging_mass, heights, activation=1.0).detail
    best = np.argmax(np.abs(detail.active_moment[:, 0, 0]))
    nearest = np.argmin(np.abs(detail.normalized_fiber_length[:, 0] - 1))
    assert best == nearest
    assert_allclose(detail.active_moment[best, 0, 0], m.actuator_gainprm[0, 2], rtol=1e-3)


def test_other_gains_have_no_fiber():
    detail = recorded(load_xml(HANGING_MASS.format(actuator=LINEAR_ACTUATOR)), [[0.0], [0.1]]).detail
    for values in (detail.fiber_length, detail.fiber_velocity, detail.normalized_fiber_length):
        assert np.isnan(values).all()
    assert np.isnan(detail.normalized_fiber_velocity).all()
    assert np.isfinite(detail.musculotendon_length).all()


def test_fibers_follow_the_path(fast_solution):
    detail = fast_solution.detail
    constant = detail.musculotendon_length - detail.fiber_length
    assert_allclose(constant, np.broadcast_to(constant[0], constant.shape), atol=1e-12)
    speed = np.gradient(detail.fiber_length, fast_solution.time, axis=0)[1:-1]
    scale = np.abs(detail.fiber_velocity).max()
    assert_allclose(speed, detail.fiber_velocity[1:-1], atol=0.03 * scale)  # differences over 20 ms of a 5 Hz motion


# --- from a file ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".sto", ".nc"])
def test_a_file_read_with_its_model_has_the_same_detail_and_replays(fast_solution, tmp_path, suffix):
    path = fast_solution.save(tmp_path / f"fast{suffix}")
    with pytest.raises(mjhcmc.SimulationError, match=r"read it with Solution\.load\(path, model=\.\.\.\)") as error:
        _ = mjhcmc.Solution.load(path).detail
    assert "\n" not in str(error.value)
    for model in ("leg8", fast_solution.model):
        loaded = mjhcmc.Solution.load(path, model=model)
        for name, values in arrays(fast_solution.detail).items():
            assert_array_equal(getattr(loaded.detail, name), values, err_msg=name)
    replayed = mjhcmc.replay_windows(loaded, physics_dt=1e-3)
    assert np.abs(replayed - loaded.qpos).max() < 1e-3


def test_a_model_tells_hinges_from_slides_where_the_file_does_not(linear_mass, tmp_path):
    motion = mjhcmc.Motion.cosine(linear_mass, amplitudes={"height": 0.02}, period=1.0, cycles=0.1)
    path = mjhcmc.hcmc(linear_mass, motion).save(tmp_path / "mass.csv")
    assert mjhcmc.Solution.load(path).dof_is_rotation.all()
    assert not mjhcmc.Solution.load(path, model=linear_mass).dof_is_rotation.any()


def test_another_models_names_are_refused_with_the_first_difference(fast_solution, two_joints, tmp_path):
    path = fast_solution.save(tmp_path / "fast.parquet")
    with pytest.raises(mjhcmc.OutputError) as error:
        mjhcmc.Solution.load(path, model=two_joints)
    message = str(error.value)
    assert message.startswith(f"{path}: muscle 1 is 'iliopsoas' in the file and 'flexor' in model 'two_joints'")
    assert "leg8" in message
    assert "\n" not in message
    fewer = with_(
        fast_solution, muscle_names=fast_solution.muscle_names[:-1], model=None,
        stored_verdict=fast_solution.verdict,
        **{name: getattr(fast_solution, name)[:, :-1] for name in ("excitation", "activation", "muscle_force")},
    )  # fmt: skip
    with pytest.raises(mjhcmc.OutputError, match="muscle 8 is missing in the file and 'tib_ant' in model 'leg8'"):
        mjhcmc.Solution.load(fewer.save(tmp_path / "fewer.parquet"), model="leg8")
    renamed = with_(fast_solution, dof_names=("hip", "genu", "ankle"), model=None, stored_verdict=fast_solution.verdict)
    with pytest.raises(mjhcmc.OutputError, match="joint 2 is 'genu' in the file and 'knee' in model 'leg8'"):
        mjhcmc.Solution.load(renamed.save(tmp_path / "renamed.parquet"), model="leg8")
    with pytest.raises(mjhcmc.ModelError, match="leg9"):
        mjhcmc.Solution.load(path, model="leg9")


# --- the table --------------------------------------------------------------------------------------------------


def test_the_table_with_detail(fast_solution):
    plain, table, detail = fast_solution.to_dataframe(), fast_solution.to_dataframe(detail=True), fast_solution.detail
    assert list(table.columns[: plain.shape[1]]) == list(plain.columns)
    assert table.shape[1] == plain.shape[1] + 3 * 8 + 3 * 8 + 2 * 3 * 3
    assert table.columns.is_unique
    for column, values in {
        "fiber_length/soleus": detail.fiber_length[:, 6],
        "fiber_velocity/vasti": detail.fiber_velocity[:, 4],
        "power/iliopsoas": detail.muscle_power[:, 0],
        "contribution/knee/gastroc": detail.muscle_moment[:, 5, 1],
        "reaction_force/hip/z": detail.joint_reaction_force[:, 0, 2],
        "reaction_moment/ankle/x": detail.joint_reaction_moment[:, 2, 0],
    }.items():
        assert_array_equal(table[column], values, err_msg=column)
    total = table[[c for c in table.columns if c.startswith("contribution/knee/")]].sum(axis=1)
    assert_allclose(total[:-1] + table["reserve/knee"][:-1], table["moment/knee"][:-1], atol=1e-9)


def test_a_table_with_detail_that_a_user_wrote_can_be_read_back(fast_solution, tmp_path):
    fast_solution.to_dataframe(detail=True).to_csv(tmp_path / "detail.csv", index=False)
    loaded = mjhcmc.Solution.load(tmp_path / "detail.csv", model="leg8")
    assert_array_equal(loaded.activation, fast_solution.activation)

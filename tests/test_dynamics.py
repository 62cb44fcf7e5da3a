"""Joint moments: affine in activation, moment arms, and the books against MuJoCo's inverse dynamics."""

import mujoco
import numpy as np
import pytest

from mjhcmc import MujocoPlant, dynamics
from mjhcmc.plant import State


def random_states(model, count, seed=0):
    rng = np.random.default_rng(seed)
    low, high = np.maximum(model.joint_range[:, 0], -1), np.minimum(model.joint_range[:, 1], 1)
    for _ in range(count):
        yield State(
            0.0,
            rng.uniform(0.8 * low, 0.8 * high),
            rng.normal(size=model.nv) * 3,
            rng.uniform(size=model.n_muscle),
            np.zeros(model.nv),
        )


@pytest.mark.parametrize("name", ["leg8", "two_joints", "hanging_mass"])
def test_moments_are_affine_in_activation(request, name):
    model = request.getfixturevalue(name)
    plant = MujocoPlant(model)
    for state in random_states(model, 20):
        plant.set_state(state)
        plant.forward()
        whole = plant.mj_data.qfrc_actuator.copy()
        moments = dynamics.muscle_moments(plant)
        scale = np.abs(moments.B).sum() + np.abs(moments.p).sum()
        np.testing.assert_allclose(moments.B @ state.activation + moments.p, whole, atol=1e-12 * scale)
        np.testing.assert_array_equal(plant.get_state().activation, state.activation)


def test_moment_arm_is_minus_length_gradient(leg8):
    plant, step = MujocoPlant(leg8), 1e-6
    for state in random_states(leg8, 10):
        plant.set_state(state)
        plant.forward()
        R = dynamics.moment_arms(plant)
        for j in range(leg8.nv):
            lengths = []
            for sign in (1, -1):
                plant.set_state(state)
                plant.mj_data.qpos[j] += sign * step
                plant.forward()
                lengths.append(plant.mj_data.actuator_length[leg8.muscle_ids].copy())
            np.testing.assert_allclose(R[:, j], -(lengths[0] - lengths[1]) / (2 * step), atol=2e-6)


def test_required_moment_makes_the_acceleration(leg8):
    """Q from inverse dynamics, applied in place of the muscles' activation, gives the acceleration asked for."""
    plant = MujocoPlant(leg8)
    rng = np.random.default_rng(1)
    for state in random_states(leg8, 20):
        wanted = rng.normal(size=leg8.nv) * 50
        rest = State(0.0, state.qpos, state.qvel, np.zeros(leg8.n_muscle), np.zeros(leg8.nv))
        plant.set_state(rest)
        plant.set_input(None, np.zeros(leg8.nv))
        plant.forward()
        p = dynamics.muscle_moments(plant).p
        Q = dynamics.required_moment(plant, wanted, p)
        plant.set_state(rest)
        plant.set_input(None, Q)
        np.testing.assert_allclose(plant.forward(), wanted, rtol=1e-9, atol=1e-8)


def test_net_moment_is_muscles_plus_applied_and_agrees_with_mj_inverse(leg8):
    plant = MujocoPlant(leg8)
    reserve = np.array([3.0, -2.0, 1.0])
    for state in random_states(leg8, 20):
        plant.set_state(state)
        plant.set_input(None, reserve)
        qacc = plant.forward().copy()
        net = dynamics.net_joint_moment(plant)
        given = dynamics.node_forces(plant).muscle_moment + reserve
        np.testing.assert_allclose(net, given, atol=1e-9 * np.abs(net).max())
        # the leg has no passive joint forces: all that MuJoCo calls passive is fiber damping, which is muscle
        d = plant.mj_data
        d.qacc[:] = qacc
        mujoco.mj_inverse(plant.mj_model, d)
        np.testing.assert_allclose(net, d.qfrc_inverse + d.qfrc_passive, atol=1e-9 * np.abs(net).max())


def test_fiber_damping_is_muscle_force(two_joints):
    plant = MujocoPlant(two_joints)
    plant.set_state(State(0.0, np.array([0.3, 0.4]), np.array([2.0, -3.0]), np.zeros(2), np.zeros(2)))
    plant.forward()
    d = plant.mj_data
    velocity = d.ten_velocity.copy()
    np.testing.assert_allclose(dynamics.fiber_damping(plant.model, plant.mj_data), np.array([2.0, 1.0]) * velocity)
    R = dynamics.moment_arms(plant)
    np.testing.assert_allclose(R.T @ dynamics.fiber_damping(plant.model, plant.mj_data), d.qfrc_passive)
    np.testing.assert_allclose(
        dynamics.node_forces(plant).muscle_force, dynamics.fiber_damping(plant.model, plant.mj_data) - d.actuator_force
    )


def test_gear_scales_length_and_so_the_pull_along_the_tendon():
    from conftest import PENDULUMS, load_xml

    model = load_xml(PENDULUMS.replace('name="flexor" tendon', 'name="flexor" gear="2" tendon'))
    plant = MujocoPlant(model)
    plant.set_state(State(0.0, np.array([0.3, 0.4]), np.array([2.0, -3.0]), np.array([0.4, 0.2]), np.zeros(2)))
    plant.forward()
    d, forces = plant.mj_data, dynamics.node_forces(plant)
    np.testing.assert_allclose(forces.muscle_moment, d.qfrc_actuator + d.qfrc_passive, rtol=1e-12)
    pull = -d.actuator_force * [2.0, 1.0] + np.array([2.0, 1.0]) * d.ten_velocity
    np.testing.assert_allclose(forces.muscle_force, pull, rtol=1e-12)


def test_damping_of_a_shared_tendon_is_no_muscles():
    from conftest import PENDULUMS, load_xml

    twin = '<muscle name="twin" tendon="flexor_path" force="100" lengthrange=".05 .35" ctrlrange="0 1"/></actuator>'
    plant = MujocoPlant(load_xml(PENDULUMS.replace("</actuator>", twin)))
    plant.set_state(State(0.0, np.array([0.3, 0.4]), np.array([2.0, -3.0]), np.zeros(3), np.zeros(2)))
    plant.forward()
    velocity = plant.mj_data.ten_velocity
    np.testing.assert_allclose(dynamics.fiber_damping(plant.model, plant.mj_data), [0.0, velocity[1], 0.0])


def test_damping_and_stiffness_in_closed_form():
    """A pendulum with joint damping and spring: D = b, K = k + m g l cos q."""
    from conftest import load_xml

    model = load_xml("""<mujoco><option integrator="RK4"/><worldbody><body>
        <joint name="j" type="hinge" axis="0 1 0" damping="0.7" stiffness="3"/>
        <geom type="sphere" size=".01" pos="0 0 -.5" mass="2"/></body></worldbody>
        <actuator><general name="m" joint="j" dyntype="muscle" dynprm=".01 .04" gaintype="fixed" gainprm="0"/>
        </actuator></mujoco>""")
    plant = MujocoPlant(model)
    plant.set_state(State(0.0, np.array([0.4]), np.array([1.5]), np.zeros(1), np.zeros(1)))
    plant.forward()
    D, K = dynamics.damping_matrix(plant), dynamics.stiffness_matrix(plant)
    np.testing.assert_allclose(D, [[0.7]], rtol=1e-6)
    np.testing.assert_allclose(K, [[3 + 2 * 9.81 * 0.5 * np.cos(0.4)]], rtol=1e-5)

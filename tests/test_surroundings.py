"""What acts from outside and what is prescribed: exact paths, closed forms, MuJoCo's inverse dynamics, convergence."""

import copy
import dataclasses

import mujoco
import numpy as np
import pytest
from conftest import load_xml
from numpy.testing import assert_allclose, assert_array_equal
from riders import FREE, PENDULUM, PLANAR, RIDER
from scipy.integrate import solve_ivp

import mjhcmc
from mjhcmc import HillPlant, MujocoPlant
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.hosted.lockstep import HillLockstep
from mjhcmc.lockstep import Lockstep
from mjhcmc.motion_on_model import path_of
from mjhcmc.plant import State
from mjhcmc.surroundings import Surroundings

TIME = np.linspace(0, 1, 201)


@pytest.fixture(scope="module", params=["planar", "free"])
def rider(request):
    """A leg under a pelvis that is prescribed, and a motion of all."""
    model = load_xml(RIDER.format(root={"planar": PLANAR, "free": FREE}[request.param]))
    t = TIME
    swing = np.column_stack([0.3 * np.sin(5 * t), -0.4 + 0.3 * np.cos(6 * t)])
    base = np.column_stack([0.5 * t + 0.03 * np.sin(9 * t), 0.02 * np.cos(11 * t)])
    if request.param == "planar":
        qpos = np.column_stack([base, 0.1 * np.sin(4 * t), swing])
    else:
        q = np.column_stack([np.cos(0.1 * np.sin(4 * t)), *(np.sin(0.1 * np.sin(4 * t)) * [[0.48], [-0.6], [0.64]])])
        qpos = np.column_stack([base[:, 0], 0.01 * np.sin(7 * t), 1 + base[:, 1], q, swing])
    motion = mjhcmc.Motion(t, qpos, "ride").on(model, model.quaternions)
    assert len(model.roles.prescribed) == model.nv - 2
    return model, motion


def state_at(model, motion, time=0.2, activation=0.3):
    at = motion.sample(time)
    return State(time, at.qpos[0], at.qvel[0], np.full(model.n_muscle, activation), np.zeros(model.nv))


def root(model):
    """Coordinates and degrees of freedom of the pelvis."""
    return slice(0, model.nq - 2), slice(0, model.nv - 2)


# --- what is prescribed -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("hill", [False, True])
def test_prescribed_joints_are_where_the_motion_is(rider, hill):
    """After each window, in a plant and in lock step, which give the same bits; the others move freely."""
    model, motion = rider
    around = Surroundings(path=path_of(motion))
    if hill and model.quaternions:
        with pytest.raises(mjhcmc.ModelError, match="has ball or free joints, which Hill muscles do not go with yet"):
            HillPlant(model, "millard", "rigid", surroundings=around)
        return
    if hill:
        plant = HillPlant(model, "millard", "rigid", surroundings=around)
        plants = HillLockstep([model], [plant.hosted], 1e-3, [around])
        state = plant.settled(state_at(model, motion))
    else:
        plant, plants = MujocoPlant(model, surroundings=around), Lockstep([model], 1e-3, [around])
        state = state_at(model, motion)
    rng, ids = np.random.default_rng(0), np.arange(1)
    rows = plants.rows([state])
    plant.set_state(state)
    q, v = root(model)
    for _ in range(12):
        u, reserve = rng.uniform(0, 1, model.n_muscle), 50 * rng.normal(size=model.nv)
        rows = plants.step(ids, rows, u[None], reserve[None], 7)
        plant.advance(u, reserve, 7)
        end, own = plants.layout.state(rows[0]), plant.get_state()
        wanted = motion.sample(own.time)
        for found in (end, own):
            assert_allclose(found.qpos[q], wanted.qpos[0, q], rtol=0, atol=1e-12)
            assert_allclose(found.qvel[v], wanted.qvel[0, v], rtol=0, atol=1e-10)
        assert_array_equal(end.qpos, own.qpos)
        assert_array_equal(end.qvel, own.qvel)
        assert_array_equal(end.activation, own.activation)
    assert np.abs(own.qpos - wanted.qpos[0])[-2:].max() > 0.01


def test_accelerations_under_a_moving_base_are_those_of_a_base_that_is_driven(rider):
    """M qacc + bias = tau with the base's acceleration known, solved for the others' on the model as it is."""
    model, motion = rider
    around, time = Surroundings(path=path_of(motion)), 0.37
    plant, plants = MujocoPlant(model, surroundings=around), Lockstep([model], 1e-3, [around])
    state, reserve = state_at(model, motion, time), np.full(model.nv, 2.0)
    qacc = driven(model, motion, state, reserve)[0]
    plant.set_state(state)
    plant.set_input(None, reserve)
    size = np.abs(qacc).max()
    assert_allclose(plant.forward(), qacc, rtol=0, atol=1e-5 * size)  # forces of 1000 N on 1e8 kg
    assert_allclose(
        plants.acceleration(np.arange(1), plants.rows([state]), reserve[None])[0], qacc, rtol=0, atol=1e-5 * size
    )
    plain = MujocoPlant(model)
    plain.set_state(state)
    plain.set_input(None, reserve)
    assert np.abs(plain.forward() - qacc).max() > 0.1 * size  # the base falls


def driven(model, motion, state, applied):
    """qacc, and what must act on the base, by plain MuJoCo: the base's acceleration is the motion's."""
    m, d = model.mj_model, mujoco.MjData(model.mj_model)
    d.qpos[:], d.qvel[:], d.act[model.act_index] = state.qpos, state.qvel, state.activation
    mujoco.mj_forward(m, d)
    M, qacc = np.empty((m.nv, m.nv)), np.zeros(m.nv)
    mujoco.mj_fullM(m, d, M)
    v = root(model)[1]
    legs = slice(v.stop, m.nv)
    qacc[v] = motion.sample(state.time).qacc[0, v]
    left = (d.qfrc_smooth + applied)[legs] - M[legs, v] @ qacc[v]
    qacc[legs] = np.linalg.solve(M[legs, legs], left)
    d.qacc[:] = qacc
    mujoco.mj_inverse(m, d)
    return qacc, d.qfrc_inverse - d.qfrc_actuator


def test_the_residual_is_what_the_bases_acceleration_takes(rider):
    """M qacc + bias of the whole, by mj_inverse at every node; the base is on the motion, the leg follows it."""
    model, motion = rider
    solution = mjhcmc.hcmc(model, motion, 0.01)
    q, v = root(model)
    assert_allclose(solution.qpos[:, q], motion.sample(solution.time).qpos[:, q], rtol=0, atol=1e-12)
    assert np.rad2deg(np.abs(solution.tracking_error[:, -2:])).max() < 0.1
    assert_array_equal(solution.reserve[:, v], 0)
    for k in range(0, solution.n_window, 7):
        applied = solution.reserve[k]
        force = driven(model, motion, solution.state(k), applied)[1]
        assert_allclose(solution.residual[k, v], force[v], rtol=0, atol=1e-4 * np.abs(force[v]).max())
    weight = 9.81 * model.mj_model.body_mass.sum()
    up = 1 if model.dof_names[0] == "x" else 2
    assert solution.residual[:, up].mean() == pytest.approx(weight, rel=0.2)
    assert_array_equal(solution.residual[:, -2:], 0)


def test_replay_follows_prescribed_joints_and_loads(rider):
    """Window by window to rounding, with loads that the solution knows; a file knows neither them nor the path."""
    model, motion = rider
    motion = dataclasses.replace(motion, span=(0.0, 0.4))
    loads = pushing([5, 0, 60], [0, 0, 0.3])
    solution = mjhcmc.hcmc(model, motion, 0.01, loads=loads)
    assert_allclose(mjhcmc.replay_windows(solution, 1e-3), solution.qpos, rtol=0, atol=1e-11)
    without = dataclasses.replace(solution, surroundings=Surroundings(path=solution.surroundings.path))
    assert np.abs(mjhcmc.replay_windows(without, 1e-3) - solution.qpos)[:, -2:].max() > 1e-4
    assert max(solution.verdict.replay_window_max_error) < 1e-4
    assert not dataclasses.replace(solution, surroundings=None).knows_surroundings


def test_muscles_at_a_prescribed_joint_are_no_part_of_its_residual(rider):
    """A hip that is prescribed by name: what its muscles give, the residual need not."""
    model, motion = rider
    model = model.with_roles(prescribed=["hip"])
    solution = mjhcmc.hcmc(model, motion, 0.01, min_activation=0.1)
    k, hip = 40, model.nv - 2
    plant = solution.plant()
    plant.set_state(solution.state(k))
    plant.set_input(None, solution.reserve[k])
    plant.forward()
    d = plant.mj_data
    qacc = motion.sample(solution.time[k]).qacc[0].copy()
    qacc[-1] = d.qacc[-1]
    m, own = model.mj_model, mujoco.MjData(model.mj_model)
    own.qpos[:], own.qvel[:], own.act[:] = d.qpos, d.qvel, d.act
    mujoco.mj_forward(m, own)
    own.qacc[:] = qacc
    mujoco.mj_inverse(m, own)
    wanted = (own.qfrc_inverse - own.qfrc_actuator)[hip]
    assert abs(own.qfrc_actuator[hip]) > 0.1
    assert solution.residual[k, hip] == pytest.approx(wanted, abs=1e-4 * abs(own.qfrc_inverse[hip]))


# --- forces on bodies -------------------------------------------------------------------------------------------


def pushing(force, point, torque=(0, 0, 0), body="shank", end=2.0, **frames):
    """Force, torque and point of one load, straight from (at 0 s) to (at the end); each (3,) or (2, 3)."""
    parts = (np.broadcast_to(np.asarray(x, dtype=float), (2, 3))[:, None] for x in (force, torque, point))
    return ExternalLoads("plate", np.array([0.0, end]), (body,), *parts, **frames)


@pytest.mark.parametrize("frames", [{}, {"force_frame": ("thigh",)}, {"point_frame": ("shank",)}])
def test_a_force_at_a_point_is_mj_applyfts(rider, frames):
    model, motion = rider
    force, torque, point = np.array([30.0, -20.0, 400.0]), np.array([1.0, 5.0, -2.0]), np.array([0.05, 0.02, -0.1])
    around = Surroundings(loads=pushing(force, point, torque, **frames), path=path_of(motion))
    state = state_at(model, motion)
    m, d = model.mj_model, mujoco.MjData(model.mj_model)
    d.qpos[:], d.qvel[:] = state.qpos, state.qvel
    mujoco.mj_forward(m, d)
    if "force_frame" in frames:
        R = d.body("thigh").xmat.reshape(3, 3)
        force, torque = R @ force, R @ torque
    if "point_frame" in frames:
        point = d.body("shank").xpos + d.body("shank").xmat.reshape(3, 3) @ point
    wanted = np.zeros(m.nv)
    mujoco.mj_applyFT(m, d, force, torque, point, m.body("shank").id, wanted)
    plant = MujocoPlant(model, surroundings=around)
    plant.set_state(state)
    plant.forward()
    assert_allclose(plant.external_load(), wanted, rtol=1e-10, atol=1e-9)
    plants = Lockstep([model], 1e-3, [around])
    found = plants.nodes(0, plants.rows([state]), np.zeros((1, model.nv)))
    assert_allclose(found.external_load[0], wanted, rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("kind", ["ground", "own frame", "generalized"])
def test_loads_are_followed_to_second_order(kind):
    """Against scipy's integrator, with what acts at every instant; halving the step divides the error by four."""
    model = load_xml(PENDULUM)
    force = np.array([[20.0, 0.0, 150.0], [-40.0, 0.0, 60.0]])
    point = np.array([[-0.1, 0.0, 0.2], [0.3, 0.0, 0.2]])
    if kind == "ground":
        around = Surroundings(loads=pushing(force, point, (0, 3, 0)))
    elif kind == "own frame":
        around = Surroundings(loads=pushing(force / 5, point / 5, force_frame=("shank",), point_frame=("thigh",)))
    else:
        around = Surroundings(lambda t: np.column_stack([20 * np.sin(9 * t), 10 * np.cos(12 * t)]))
    m, state, T = (
        copy.copy(model.mj_model),
        State(0.1, np.array([0.2, -0.5]), np.zeros(2), np.zeros(4), np.zeros(2)),
        0.24,
    )
    m.actuator_gainprm[:, 2] = m.actuator_biasprm[:, 2] = 0.0  # the muscles' curves are less smooth
    model = mjhcmc.MuscleModel.load(m)
    d = mujoco.MjData(m)

    def slope(t, y):
        d.qpos[:], d.qvel[:] = y[:2], y[2:]
        mujoco.mj_forward(m, d)
        load = np.zeros(2)
        if around.external is not None:
            load += around.external(np.array([t]))[0]
        else:
            at = around.loads.sample(t)
            F, tau, P = at.force[0, 0].copy(), at.torque[0, 0].copy(), at.point[0, 0].copy()
            if kind == "own frame":
                F = d.body("shank").xmat.reshape(3, 3) @ F
                P = d.body("thigh").xpos + d.body("thigh").xmat.reshape(3, 3) @ P
            mujoco.mj_applyFT(m, d, F, tau, P, m.body("shank").id, load)
        qacc = np.zeros((1, 2))
        mujoco.mj_solveM(m, d, qacc, (d.qfrc_smooth + load)[None])
        return np.concatenate([y[2:], qacc[0]])

    exact = solve_ivp(slope, (0.1, 0.1 + T), np.concatenate([state.qpos, state.qvel]), rtol=1e-10, atol=1e-12).y[:, -1]
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        plants = Lockstep([model], h, [around])
        rows = plants.step(np.arange(1), plants.rows([state]), np.zeros((1, 4)), np.zeros((1, 2)), round(T / h))
        plant = MujocoPlant(model, h, surroundings=around)
        plant.set_state(state)
        plant.advance(np.zeros(4), np.zeros(2), round(T / h))
        end, own = plants.layout.state(rows[0]), plant.get_state()
        assert_array_equal(end.qpos, own.qpos)
        errors.append(np.abs(np.concatenate([end.qpos, end.qvel]) - exact).max() / np.abs(exact).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert ((ratios > 3.3) & (ratios < 4.8)).all()
    assert errors[-1] < 1e-4


def test_what_excludes_what_is_named(rider):
    model, motion = rider
    with pytest.raises(mjhcmc.SettingsError, match="external and surroundings exclude each other"):
        MujocoPlant(model, 1e-3, lambda t: np.zeros((len(t), model.nv)), surroundings=Surroundings())
    plant = MujocoPlant(model, 1e-3)
    with pytest.raises(mjhcmc.SettingsError, match=r"a plant of one's own brings its surroundings with it"):
        mjhcmc.hcmc(model, motion, plant=plant)
    assert Surroundings().empty
    assert not Surroundings(path=path_of(motion)).empty

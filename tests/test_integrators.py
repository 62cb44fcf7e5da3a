"""Integrators: MuJoCo's own steps as oracle, error dynamics by another recursion, RK4 as the limit of small steps."""

from __future__ import annotations

import dataclasses
import json
import warnings

import mujoco
import numpy as np
import pytest
from conftest import HANGING_MASS, LINEAR_ACTUATOR, PENDULUMS, load_xml
from numpy.testing import assert_allclose, assert_array_equal
from riders import PLANAR, RIDER

import mjhcmc
from mjhcmc.activation import activation_after, excitation_for
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.hill_muscles import hill_model
from mjhcmc.integrators import SCHEMES, check_engine, scheme_of
from mjhcmc.lockstep import Lockstep
from mjhcmc.methods.aim import fill_aim
from mjhcmc.muscle_comparison import compare_muscles, track_of
from mjhcmc.plant import State
from mjhcmc.summary import screen
from mjhcmc.surroundings import Surroundings
from mjhcmc.verify import integrator_error

NAMES = ("rk4", "euler", "implicit", "implicitfast")
FIRST_ORDER = NAMES[1:]
MUJOCOS = {
    "rk4": mujoco.mjtIntegrator.mjINT_RK4,
    "euler": mujoco.mjtIntegrator.mjINT_EULER,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
}
STEP = {"euler": 0.001, "implicit": 0.005, "implicitfast": 0.005}  # s, on fast; Euler needs about 1.3 ms there


def worst(solution) -> np.ndarray:
    """(nv,) deg."""
    return np.rad2deg(np.abs(solution.tracking_error).max(axis=0))


# --- one step -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("smooth", [0.0, 0.2])
def test_activation_goes_as_mujoco_steps_it(name, smooth):
    """From rest, from full activation and between, up and down, also where tausmooth blends."""
    m = mujoco.MjModel.from_xml_string(HANGING_MASS.format(actuator=LINEAR_ACTUATOR))
    m.actuator_dynprm[0, 2] = smooth
    m.opt.integrator, m.opt.timestep = MUJOCOS[name], 0.002
    prm = m.actuator_dynprm[:1, :3].copy()
    for a in (0.0, 0.3, 1.0):
        for u in (0.0, 0.28, 0.35, 1.0):
            d = mujoco.MjData(m)
            d.act[0], d.ctrl[0] = a, u
            mujoco.mj_step(m, d, nstep=5)
            found = activation_after(np.array([a]), np.array([u]), prm, 0.002, 5, name)
            assert_allclose(found, d.act, rtol=0, atol=1e-15)
            again = excitation_for(np.array([a]), found, prm, 0.002, 5, None, name)
            assert_allclose(activation_after(np.array([a]), again, prm, 0.002, 5, name), found, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("off", [None, mujoco.mjtDisableBit.mjDSBL_EULERDAMP, mujoco.mjtDisableBit.mjDSBL_DAMPER])
def test_a_step_is_what_inertia_and_damping_say(name, off):
    """Two joints with damping, damped tendons and stiff active muscles: A = (M + s D_s)^-1 F, against mj_step."""
    xml = PENDULUMS.replace('type="hinge"', 'type="hinge" damping=".3"').replace('damping="2"', 'damping="5000"')
    model, step, scheme = load_xml(xml), 0.002, SCHEMES[name]
    model.mj_model.opt.disableflags |= 0 if off is None else int(off)
    plant = mjhcmc.MujocoPlant(model, step, integrator=name)
    state = State(0.0, np.array([0.3, 0.4]), np.array([1.0, -2.0]), np.array([0.6, 0.5]), np.zeros(2))
    plant.set_state(state)
    plant.set_input(np.array([0.5, 0.5]), np.zeros(2))
    qacc = plant.forward().copy()
    M, D = mjhcmc.dynamics.mass_matrix(plant), mjhcmc.dynamics.damping_matrix(plant)
    found = plant.step_acceleration()
    for before, after in zip(dataclasses.astuple(state), dataclasses.astuple(plant.get_state()), strict=True):
        assert_array_equal(before, after)
    plants = Lockstep([model], step, [Surroundings()], integrator=name)
    together = plants.acceleration(np.arange(1), plants.rows([state]), np.zeros((1, 2)))[0]
    m, d = plant.mj_model, plant.mj_data
    assert m.opt.integrator == MUJOCOS[name]
    if name == "rk4":
        wanted = qacc
    else:
        mujoco.mj_step(m, d)
        wanted = (d.qvel - state.qvel) / step
    assert_allclose(found, wanted, rtol=1e-12)
    assert_allclose(together, wanted, rtol=1e-9)
    joint = np.diag(scheme.joint_damping(model.mj_model))
    says = np.linalg.solve(scheme.inertia(M, D, joint, step), M @ qacc)
    if off != mujoco.mjtDisableBit.mjDSBL_DAMPER:
        assert np.abs(D).max() * step > 0.2 * np.abs(M).max()  # damping counts within a step
    if name == "implicitfast":  # it leaves out what velocity makes of Coriolis forces, .9 % at most here
        assert_allclose(says, wanted, rtol=0.02)
        says = np.linalg.solve(M + step * without_coriolis(plant, state), M @ qacc)
    assert_allclose(says, wanted, rtol=1e-5)  # D is by differences


def without_coriolis(plant, state):
    """(2, 2) N m s, -d(passive + muscles)/dv, by differences."""

    def force(v):
        plant.set_state(dataclasses.replace(state, qvel=v))
        plant.forward()
        return plant.mj_data.qfrc_passive + plant.mj_data.qfrc_actuator

    return np.stack([force(state.qvel - 1e-6 * e) - force(state.qvel + 1e-6 * e) for e in np.eye(2)], axis=1) / 2e-6


@pytest.mark.parametrize("n", [1, 2, 5, 20])
@pytest.mark.parametrize("gain", [0.3, 1.5, 2.7])
def test_errors_decay_alike_whatever_the_steps(n, gain):
    """Roots of the sampled error of a double integrator under the driver's gains, window by window.

    Each window: n semi-implicit steps with an acceleration that goes along a line to A1 = -kv v1 - kp q1, which the
    next window begins with. Those of RK4: the same with a ramp in continuous time.
    """
    h = 0.01

    def gains(lag):
        zero, one = np.zeros((1, 1)), np.ones((1, 1))
        kp, kv, goal, way, speed = (np.empty((1, 1)) for _ in range(5))
        strong = np.array([[[1e6, -1e6]]])
        fill_aim(
            np.ones((1, 1, 1)), strong, zero, zero, zero, zero, zero, zero, zero, one, 1.0, np.array([gain]), h, lag,
            kp, kv, goal, way, speed,
        )  # fmt: skip
        return kp[0, 0], kv[0, 0]

    def roots(kp, kv, ramp):
        """ramp: position and velocity at the end, from those at the start and accelerations at both ends."""
        rows = []
        for q, v, a in np.eye(3):
            q0, v0 = ramp(q, v, a, 0.0)
            q1, v1 = np.subtract(ramp(q, v, a, 1.0), (q0, v0))
            end = -(kv * v0 + kp * q0) / (1 + kv * v1 + kp * q1)
            rows.append((*ramp(q, v, a, end), end))
        return np.sort_complex(np.linalg.eigvals(np.array(rows).T))

    def stepped(q, v, a, b):
        for j in range(n):
            v = v + h / n * (a + (b - a) * j / n)
            q = q + h / n * v
        return q, v

    def smooth(q, v, a, b):
        return q + h * v + h**2 / 3 * a + h**2 / 6 * b, v + h / 2 * (a + b)

    wanted, found = roots(*gains(0.0), smooth), roots(*gains(1 / n), stepped)
    assert np.abs(wanted).max() < 0.9
    assert np.abs(found).max() == pytest.approx(np.abs(wanted).max(), rel=1e-6)
    assert_allclose(np.poly(found), np.poly(wanted), rtol=0, atol=1e-9)


def test_gains_of_rk4_would_ring_under_euler():
    """Why they are scaled: at one step a window they put a root outside the unit circle."""
    kp, kv = 2.7**2, 2 * 2.7 * (1 - 2.7 / 6)
    assert np.abs(np.roots([1, kv + kp - 2, 1 - kv])).max() > 3


# --- following a motion ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def solved(leg8, fast, slow):
    """By movement and integrator, at the step of STEP; RK4 at its own."""
    return {
        (kind, name): mjhcmc.hcmc(leg8, motion, integrator=name, physics_dt=STEP.get(name, 0.001))
        for kind, motion in (("fast", fast), ("slow", slow))
        for name in NAMES
    }


@pytest.mark.parametrize("name", FIRST_ORDER)
@pytest.mark.parametrize(
    ("movement", "most"),
    [("fast", (0.008, 0.02, 0.12)), ("slow", (3e-4, 5e-4, 0.008))],
)
def test_first_order_follows_as_rk4_does(solved, movement, name, most):
    """At five times RK4's step (implicit ones), or at its step (Euler): the window decides, not the physics step.

    Measured .0068/.017/.10 and 2e-4/3e-4/.0064 deg at most. Were the motion's own velocity asked for, fast would miss
    hip and knee by .2/.28 deg (implicit), .016/.029 (Euler).
    """
    found = solved[movement, name]
    assert (worst(found) < most).all(), worst(found)
    assert found.settings["integrator"] == name
    assert found.settings["physics_dt"] == STEP[name]
    assert np.abs(found.reserve).max() < 1e-3
    assert (found.status == 0).all()


@pytest.mark.parametrize(("name", "steps"), [("euler", (0.001, 0.0005)), ("implicitfast", (0.0025, 0.00125))])
def test_what_muscles_do_nears_rk4s_at_first_order(leg8, fast, fast_solution, name, steps):
    """Activations and moments differ from RK4's by O(physics_dt), which tracking errors do not show."""
    off = [
        np.abs(mjhcmc.hcmc(leg8, fast, integrator=name, physics_dt=step).activation - fast_solution.activation).max()
        for step in steps
    ]
    assert 0.005 < off[0] < 0.06
    assert off[1] < 0.6 * off[0]


@pytest.mark.parametrize("name", FIRST_ORDER)
def test_comes_back_from_a_wrong_start(leg8, fast, solved, name):
    """1 deg off everywhere and at rest: nominal after one cycle of three."""
    nominal = solved["fast", name]
    start = fast.qpos[0] + np.deg2rad(1)
    back = mjhcmc.hcmc(
        leg8, fast, integrator=name, physics_dt=STEP[name], initial_qpos=start, initial_activation=0.01
    )  # fmt: skip
    error = np.rad2deg(np.abs(back.tracking_error))
    assert error[:3].max() > 0.5
    assert (error[20:].max(axis=0) < 1.2 * worst(nominal)).all()


@pytest.mark.parametrize("name", FIRST_ORDER)
def test_replay_is_of_the_same_plant(solved, name):
    """Same integrator, same step: rounding alone, window by window and in one go."""
    solution = solved["fast", name]
    assert_allclose(mjhcmc.replay_windows(solution), solution.qpos, rtol=0, atol=1e-12)
    assert_allclose(mjhcmc.replay(solution), solution.qpos, rtol=0, atol=1e-9)
    assert solution.verdict.passed
    assert max(solution.verdict.replay_window_max_error) < 1e-12
    as_rk4 = dataclasses.replace(solution, settings={**solution.settings, "integrator": "rk4"})
    assert np.abs(mjhcmc.replay_windows(as_rk4) - solution.qpos).max() > 1e-4


@pytest.mark.parametrize("name", NAMES)
def test_what_muscles_give_adds_up(solved, name):
    """R^T F + reserve is the net joint moment, and near RK4's: forces are those that move the model."""
    solution, rk4 = solved["slow", name], solved["slow", "rk4"]
    held = np.concatenate([solution.reserve, solution.reserve[-1:]])
    total = solution.detail.muscle_moment.sum(axis=1) + held
    assert_allclose(total, solution.net_joint_moment, rtol=0, atol=1e-6)
    off = np.abs(solution.net_joint_moment - rk4.net_joint_moment).max(axis=0)
    assert (off < 0.03 * rk4.peak_moment).all()


@pytest.mark.parametrize("name", NAMES)
def test_many_at_once_are_the_same_bits(leg8, slow, name):
    short = dataclasses.replace(slow, span=(0.0, 0.3))
    force = leg8.mj_model.actuator_gainprm[leg8.muscle_ids[0], 2] * np.array([1.0, 0.8])
    gain = np.repeat(leg8.mj_model.actuator_gainprm[None], 2, axis=0)
    gain[:, leg8.muscle_ids[0], 2] = force
    batch = mjhcmc.hcmc_batch(leg8, short, parameters={"actuator_gainprm": gain}, integrator=name, threads=2)
    alone = mjhcmc.hcmc(leg8, short, integrator=name)
    assert_array_equal(batch[0].excitation, alone.excitation)
    assert_array_equal(batch[0].qpos, alone.qpos)
    assert batch[1].settings["integrator"] == name
    assert np.abs(batch[1].excitation - alone.excitation).max() > 1e-3


def test_rk4_is_the_default(leg8, fast, fast_solution):
    named = mjhcmc.hcmc(leg8, fast, integrator="rk4")
    assert_array_equal(named.excitation, fast_solution.excitation)
    assert fast_solution.settings["integrator"] == "rk4"


@pytest.mark.parametrize("name", FIRST_ORDER)
def test_the_other_methods(leg8, slow, name):
    """CMC follows as under RK4 (.0018/.0038/.11 deg), static optimization drifts as there (1/2.4/3.7 deg)."""
    cmc = mjhcmc.cmc(leg8, slow, integrator=name)
    assert (worst(cmc) < (0.003, 0.008, 0.2)).all(), worst(cmc)
    static = mjhcmc.static_optimization(leg8, slow, integrator=name)
    assert (worst(static) < (1.5, 3, 5)).all()
    for solution in (cmc, static):
        assert solution.settings["integrator"] == name
        assert_allclose(mjhcmc.replay_windows(solution), solution.qpos, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", FIRST_ORDER)
def test_a_plant_of_ones_own_keeps_its_integrator(leg8, slow, name):
    short = dataclasses.replace(slow, span=(0.0, 0.2))
    plant = mjhcmc.MujocoPlant(leg8, 0.001, integrator=name)
    own, ours = mjhcmc.hcmc(leg8, short, plant=plant), mjhcmc.hcmc(leg8, short, integrator=name)
    assert own.settings["integrator"] == name
    assert_allclose(own.excitation, ours.excitation, rtol=0, atol=1e-6)
    assert_allclose(own.net_joint_moment, ours.net_joint_moment, rtol=0, atol=1e-5)
    assert_array_equal(mjhcmc.hcmc(leg8, short, plant=plant, integrator=name).excitation, own.excitation)


@pytest.mark.parametrize("name", FIRST_ORDER)
def test_a_moving_pelvis_and_loads(name):
    """The pelvis where the motion has it, a load in the middle of each step: followed, and played again."""
    model, t = load_xml(RIDER.format(root=PLANAR)), np.linspace(0, 0.4, 81)
    qpos = np.column_stack([
        0.5 * t + 0.03 * np.sin(9 * t), 0.02 * np.cos(11 * t), 0.1 * np.sin(4 * t), 0.3 * np.sin(5 * t),
        -0.4 + 0.3 * np.cos(6 * t),
    ])  # fmt: skip
    motion = mjhcmc.Motion(t, qpos, "ride")
    ends = (np.broadcast_to(np.array(x, dtype=float), (2, 3)) for x in ((5, 0, 60), (0, 0, 0), (0, 0, 0.3)))
    loads = ExternalLoads("plate", np.array([0.0, 2.0]), ("shank",), *(part[:, None] for part in ends))
    solution = mjhcmc.hcmc(model, motion, integrator=name, loads=loads)
    assert_allclose(solution.qpos[:, :3], motion.sample(solution.time).qpos[:, :3], rtol=0, atol=1e-12)
    assert worst(solution)[3:].max() < 0.1
    assert_allclose(mjhcmc.replay_windows(solution), solution.qpos, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", FIRST_ORDER)
def test_the_step_has_an_error_of_its_own_that_replay_does_not_show(leg8, fast, solved, name):
    """Of first order, apart from the lag of velocities, and none under RK4; the figures decide nothing."""
    coarse, step = solved["fast", name], STEP[name]
    fine = mjhcmc.hcmc(leg8, fast, integrator=name, physics_dt=step / 4)
    error = [np.array(solution.verdict.integrator_error) for solution in (coarse, fine)]
    assert (error[1] < 0.45 * error[0]).all()
    assert (error[0] > 1e-5).all()
    assert (error[0] > 1e6 * np.array(coarse.verdict.replay_window_max_error)).all()
    assert_allclose(integrator_error(coarse, 1e-4), error[0], rtol=0.01)  # continuous time, that is
    # played from the velocities as they are, hip and knee miss by v's lag, s h/2 q''
    as_rk4 = dataclasses.replace(coarse, settings={**coarse.settings, "integrator": "rk4"})
    lagging = np.abs(mjhcmc.replay_windows(as_rk4) - coarse.qpos).max(axis=0)
    assert (error[0][:2] < 0.4 * lagging[:2]).all()
    assert coarse.verdict.passed
    assert solved["fast", "rk4"].verdict.integrator_error is None


@pytest.mark.parametrize("name", NAMES)
def test_integrator_and_step_are_on_the_screen_and_in_the_verdict(solved, name):
    solution = solved["fast", name]
    first, *others = screen(solution).splitlines()
    lines = [line for line in others if line.startswith("steps")]
    kept = json.loads(json.dumps(solution.verdict.to_dict()))
    assert (kept["integrator"], kept["physics_dt"]) == (name, solution.settings["physics_dt"])
    assert mjhcmc.Verdict.from_dict(kept) == solution.verdict
    if name == "rk4":
        assert name not in first
        assert not lines
        assert not any("same steps" in line for line in others)
        return
    assert first.endswith(f", {name} in steps of {1e3 * STEP[name]:g} ms")
    off = np.rad2deg(solution.verdict.integrator_error)
    assert lines[0].endswith(f"hip {off[0]:.2g} deg, knee {off[1]:.2g} deg, ankle {off[2]:.2g} deg")
    assert name in lines[0]
    assert "replay error, same steps" in others[1]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("step", [0.001, 0.004])
def test_muscles_are_compared_as_they_were_stepped(leg8, solved, name, step):
    """MuJoCo's forces on the track are the solution's own at nodes, and add up to its moments there."""
    solution = solved["fast", name]
    found = compare_muscles(solution, hill_model(leg8, "mujoco"), step)
    track = found.track
    assert_allclose(track.time[track.node], solution.time, rtol=0, atol=1e-12)
    assert_allclose(track.force[track.node], solution.muscle_force, rtol=0, atol=1e-8)
    assert_allclose(track.activation[track.node], solution.activation, rtol=0, atol=1e-12)
    moment = np.einsum("nmv,nm->nv", track.moment_arm, track.force)[track.node]
    held = np.concatenate([solution.reserve, solution.reserve[-1:]])
    assert_allclose(moment + held, solution.net_joint_moment, rtol=0, atol=1e-6)
    assert_allclose(found.rigid, np.maximum(track.force, 0), rtol=0, atol=1e-7)  # between nodes, too
    assert np.diff(track.time).max() <= step / 2 + 1e-12
    assert len(track.time) % 2 == 1
    moved = np.trapezoid(track.velocity, track.time, axis=0) - (track.length[-1] - track.length[0])
    assert np.abs(moved).max() < {"rk4": 1e-5}.get(name, 0.1 * STEP.get(name, 0))
    known = np.isfinite(found.needed_excitation)  # the same excitations by the solution's own map
    assert np.median(np.abs(found.needed_excitation - solution.excitation)[known]) < 1e-9


def test_muscles_are_compared_in_single_steps_and_under_a_moving_pelvis(leg8, slow):
    """One physics step a window, and a root that is led: forces at nodes are those of the solution's own plant."""
    short = dataclasses.replace(slow, span=(0.0, 0.2))
    solution = mjhcmc.hcmc(leg8, short, 0.005, 0.005, integrator="implicit")
    track = track_of(solution)
    assert_allclose(track.force[track.node], solution.muscle_force, rtol=0, atol=1e-8)
    model, t = load_xml(RIDER.format(root=PLANAR)), np.linspace(0, 0.2, 41)
    qpos = np.column_stack([0.5 * t, 0.02 * np.cos(11 * t), 0.1 * np.sin(4 * t), 0.3 * np.sin(5 * t), -0.1 - t])
    led = mjhcmc.hcmc(model, mjhcmc.Motion(t, qpos, "ride"), integrator="implicit", physics_dt=0.005)
    track = track_of(led)
    moments = track.moment_arm[track.node] * track.force[track.node][:, :, None]
    assert_allclose(moments, led.detail.muscle_moment, rtol=0, atol=1e-9)
    assert_allclose(track.force[track.node], led.muscle_force, rtol=0, atol=1e-3 * led.muscle_force.max())


def test_a_csv_keeps_the_integrator_in_a_column(tmp_path, leg8, solved):
    columns = set(solved["fast", "implicit"].to_dataframe()) - set(solved["fast", "rk4"].to_dataframe())
    assert columns == {"integrator/implicit"}
    path = solved["fast", "implicit"].save(tmp_path / "a.csv")
    back = mjhcmc.Solution.load(path, leg8)
    assert_allclose(back.verdict.integrator_error, solved["fast", "implicit"].verdict.integrator_error, rtol=1e-6)
    assert back.verdict.passed
    text = path.read_text()
    path.write_text(text.replace("integrator/implicit", "integrator/midpoint"))
    with pytest.raises(mjhcmc.OutputError, match=r"a\.csv: integrator 'midpoint' is not known"):
        mjhcmc.Solution.load(path)
    path.write_text(text.replace(",0.005,", ",-0.005,", 1))
    with pytest.raises(mjhcmc.OutputError, match="integrator/implicit holds no physics step"):
        mjhcmc.Solution.load(path)


def test_a_file_keeps_the_integrator(tmp_path, leg8, solved):
    solution = solved["fast", "implicitfast"]
    for suffix in (".parquet", ".sto", ".csv"):
        back = mjhcmc.Solution.load(solution.save(tmp_path / f"a{suffix}"), leg8)
        assert back.integrator == "implicitfast"
        assert back.plant().mj_model.opt.integrator == MUJOCOS["implicitfast"]
        assert back.plant().physics_dt == 0.005
        assert_allclose(mjhcmc.replay_windows(back), back.qpos, rtol=0, atol=1e-12)
        assert max(back.verdict.replay_window_max_error) < 1e-12
        assert (back.verdict.integrator, back.verdict.physics_dt) == ("implicitfast", 0.005)
    older = dataclasses.replace(back, settings={k: v for k, v in back.settings.items() if k != "integrator"})
    assert older.integrator == "rk4"


def test_euler_goes_on_with_a_finer_step_where_it_diverges(leg8, fast):
    short = dataclasses.replace(fast, span=(0.0, 0.4))
    with pytest.warns(mjhcmc.MjhcmcWarning, match="solved again with physics_dt 0.00063 s"):
        solution = mjhcmc.hcmc(leg8, short, physics_dt=0.0025, integrator="euler")
    assert solution.settings["physics_dt"] == 0.000625
    assert (worst(solution) < (0.008, 0.02, 0.12)).all()


# --- what cannot work -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rk5", "RK4", None, 3])
def test_an_unknown_integrator_lists_the_known_ones(leg8, slow, name):
    message = f"integrator {name!r} is not known: choose one of rk4, euler, implicit, implicitfast"
    for call in (mjhcmc.hcmc, mjhcmc.cmc, mjhcmc.static_optimization, mjhcmc.hcmc_batch):
        with pytest.raises(mjhcmc.SettingsError, match=message):
            call(leg8, slow, integrator=name)
    with pytest.raises(mjhcmc.SettingsError, match=message):
        scheme_of(name)


def test_hill_muscles_take_rk4_alone(leg8, slow):
    with pytest.raises(mjhcmc.SettingsError, match="'implicit' does not step Hill muscles"):
        mjhcmc.hcmc(leg8, slow, plant=mjhcmc.HillPlant(leg8, tendon="rigid"), integrator="implicit")
    with pytest.raises(mjhcmc.SettingsError, match="'euler' does not step Hill muscles"):
        mjhcmc.hcmc_batch(leg8, slow, muscle="rigid", integrator="euler")


def test_a_plant_of_another_integrator_is_refused(leg8, slow):
    plant = mjhcmc.MujocoPlant(leg8, integrator="euler")
    with pytest.raises(mjhcmc.SettingsError, match=r"'implicit' and a plant that is stepped by 'euler': build it"):
        mjhcmc.hcmc(leg8, slow, plant=plant, integrator="implicit")


@pytest.mark.parametrize("name", FIRST_ORDER)
def test_a_step_that_activation_overshoots_is_refused(leg8, slow, name):
    """tau_act/2 = 5 ms at rest."""
    message = r"physics_dt 0.01 s is longer .* activation of 'iliopsoas' \(0.005 s\), which .*: use physics_dt <= 0.005"
    with pytest.raises(mjhcmc.SimulationError, match=message):
        mjhcmc.hcmc(leg8, slow, physics_dt=0.01, integrator=name)


def test_stiff_damping_is_refused_under_euler_alone():
    """600 /s of tendon damping: RK4 takes 4.6 ms, Euler 3.3, implicit any; of joint damping Euler takes any, too."""
    rope = HANGING_MASS.format(actuator=LINEAR_ACTUATOR).replace('name="rope"', 'name="rope" damping="1200"')
    slide = HANGING_MASS.format(actuator=LINEAR_ACTUATOR).replace('type="slide"', 'type="slide" damping="1200"')

    def solve(xml, name):
        model = load_xml(xml)
        motion = mjhcmc.Motion(np.linspace(0, 0.1, 21), np.zeros((21, 1)), "still")
        return mjhcmc.hcmc(model, motion, physics_dt=0.005, integrator=name)

    for name, limit in (("rk4", 2.78), ("euler", 2.0)):
        step = f"{0.8 * limit / 600:.2g}"
        with pytest.raises(mjhcmc.SimulationError, match=rf"unstable .*600 /s.*: use physics_dt <= {step}$"):
            solve(rope, name)
    with pytest.raises(mjhcmc.SimulationError, match="unstable"):
        solve(slide, "rk4")
    for xml, name in ((rope, "implicit"), (rope, "implicitfast"), (slide, "euler"), (slide, "implicit")):
        assert np.abs(solve(xml, name).tracking_error).max() < 1e-6


def test_a_model_that_mujoco_does_not_step_is_refused(leg8, slow, monkeypatch):
    def refuses(m, d):
        raise mujoco.FatalError("no such derivative")

    monkeypatch.setattr(mujoco, "mj_step", refuses)
    check_engine(leg8, SCHEMES["rk4"], 0.001)
    with pytest.raises(mjhcmc.SettingsError, match=r"does not step it by implicit \(no such derivative\)"):
        mjhcmc.hcmc(leg8, slow, integrator="implicit")


def tied_swing(damping, name, step):
    """An elbow that a soft equality ties to the shoulder."""
    tie = '<equality><joint joint1="elbow" joint2="shoulder" polycoef="0 1 0 0 0"/></equality>'
    xml = PENDULUMS.replace('name="biceps_path" damping="1"', f'name="biceps_path" damping="{damping}"')
    model, t = load_xml(xml.replace("<actuator>", tie + "<actuator>")), np.linspace(0, 0.3, 61)
    swing = 0.3 + 0.2 * np.sin(20 * t)
    motion = mjhcmc.Motion(t, np.column_stack([swing, swing]), "tied")
    return mjhcmc.hcmc(model, motion, physics_dt=step, integrator=name)


def test_loose_equalities_are_told():
    """MuJoCo's implicit integrators find what keeps an equality without the damping that they then divide by."""
    message = (
        r"implicit does not keep the equalities .* 'elbow' is up to [\d.]+ rad off, .* worth \d+ % of the peak moment "
        r"of 'shoulder': use integrator 'rk4', or physics_dt <= 0\.0002$"
    )
    with pytest.warns(mjhcmc.MjhcmcWarning, match=message):
        loose = tied_swing(3000, "implicit", 0.005)
    best = tied_swing(3000, "rk4", 0.001)
    off = np.abs(loose.net_joint_moment - best.net_joint_moment).max(axis=0)
    assert off[0] > 0.2 * best.peak_moment[0]


@pytest.mark.parametrize("name", ["implicit", "euler"])
def test_soft_equalities_are_not_taken_for_loose_ones(name):
    """They give way under any integrator; what the integrator adds to that is small here, and so is moments' error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", mjhcmc.MjhcmcWarning)
        found = tied_swing(1, name, 0.001)
    best = tied_swing(1, "rk4", 0.0005)
    assert np.abs(np.diff(found.qpos)).max() > 0.01
    off = np.abs(found.net_joint_moment - best.net_joint_moment).max(axis=0)
    assert off[0] < 0.02 * best.peak_moment[0]


@pytest.mark.usefixtures("coarse_replay")
def test_on_the_command_line(run, mot, tmp_path, no_figures, leg8):
    path = mot()
    arguments = ["solve", path, "--physics-dt", "0.005", "--json", "--out", tmp_path / "out"]
    outcome = run(*arguments, "--integrator", "implicitfast")
    assert outcome.code == 0, outcome.err
    assert json.loads(outcome.out)["settings"]["integrator"] == "implicitfast"
    expected = mjhcmc.hcmc(
        leg8, mjhcmc.Motion.from_file(path, leg8), physics_dt=0.005, integrator="implicitfast"
    )  # fmt: skip
    found = mjhcmc.Solution.load(tmp_path / "out" / "solution.parquet")
    assert_array_equal(found.excitation, expected.excitation)
    bad = run("solve", path, "--integrator", "midpoint", "--out", tmp_path / "bad")
    assert bad.code == 2
    assert "choose one of rk4, euler, implicit, implicitfast" in bad.errors[-1]
    assert not (tmp_path / "bad").exists()

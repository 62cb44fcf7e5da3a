"""HCMC: closed forms, round trips, the figures it must reach, recovery, saturation, determinism."""

from dataclasses import replace
from itertools import pairwise, product

import mujoco
import numpy as np
import pytest
from conftest import load_xml

import mjhcmc
from mjhcmc import sharing
from mjhcmc.methods import correction
from mjhcmc.solution import WindowStatus

GRAVITY, MASS, STRENGTH = 9.81, 2.0, 100.0


HALF_MUSCLED = """
<mujoco model="half">
  <option integrator="RK4"/>
  <worldbody><body>
    <joint name="a" type="hinge" axis="0 1 0" range="-120 120" limited="true"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="2" contype="0" conaffinity="0"/>
    <body pos="0 0 -.3">
      <joint name="b" type="hinge" axis="0 1 0" range="-120 120" limited="true"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1" contype="0" conaffinity="0"/>
    </body>
  </body></worldbody>
  <actuator>
    <muscle name="forth" joint="a" gear="-.05" force="1500" lengthrange="-.1 .1" ctrlrange="0 1"/>
    <muscle name="back" joint="a" gear=".05" force="1500" lengthrange="-.1 .1" ctrlrange="0 1"/>
  </actuator>
</mujoco>"""


def height_motion(model, amplitude=-0.05, period=0.5, cycles=2):
    return mjhcmc.Motion.cosine(model, amplitudes={"height": amplitude}, period=period, cycles=cycles)


@pytest.fixture(scope="module")
def swing(slow):
    """One cycle of `slow`, for what does not need more."""
    return replace(slow, span=(0, 0.6))


# Figures of the muscle-driven leg, degrees hip/knee/ankle, at default settings: what the project promises.
FIGURES = [
    ("fast", 0.01, (0.01, 0.03, 0.2)),
    ("fast", 0.005, (1e-3, 2e-3, 1.7e-2)),
    ("slow", 0.01, (1e-3, 2e-3, 1e-2)),
    ("slow", 0.005, (1e-4, 2e-4, 2e-3)),
]


@pytest.mark.parametrize(("movement", "dt", "limit"), FIGURES)
def test_tracking_figures(request, leg8, movement, dt, limit):
    if dt == 0.01:  # the default
        solution = request.getfixturevalue(f"{movement}_solution")
    else:
        solution = mjhcmc.hcmc(leg8, mjhcmc.Motion.cosine(leg8, movement), dt=dt)
    assert (solution.settings["motion"], solution.dt) == (movement, dt)
    error = np.rad2deg(np.abs(solution.tracking_error).max(axis=0))
    assert np.all(error <= limit), error
    assert np.all(np.abs(solution.reserve).max(axis=0) <= 0.01 * solution.peak_moment)
    assert solution.verdict.passed
    replay = np.rad2deg(solution.verdict.replay_max_error)
    assert np.all(replay <= {"slow": 0.02, "fast": 0.1}[movement]), replay


def test_the_papers_muscles_work_hard_on_fast(fast_solution):
    peak = dict(zip(fast_solution.muscle_names, fast_solution.excitation.max(axis=0), strict=True))
    assert peak["iliopsoas"] > 0.5
    assert peak["gastroc"] > 0.5


def test_excitation_does_not_chatter(slow_solution):
    assert np.abs(np.diff(slow_solution.excitation, axis=0)).mean() < 0.01


def test_tracking_error_is_of_the_stepped_model(leg8, slow_solution):
    """Plain mj_step under the excitations and reserves ends where the solution says."""
    m = leg8.mj_model
    m.opt.timestep = slow_solution.settings["physics_dt"]
    d = mujoco.MjData(m)
    d.qpos[:], d.qvel[:] = slow_solution.qpos[0], slow_solution.qvel[0]
    d.act[:] = slow_solution.activation[0]
    for k in range(slow_solution.n_window):
        d.ctrl[:], d.qfrc_applied[:] = slow_solution.excitation[k], slow_solution.reserve[k]
        mujoco.mj_step(m, d, nstep=10)
    np.testing.assert_allclose(d.qpos, slow_solution.qpos[-1], atol=1e-12)
    np.testing.assert_allclose(d.act, slow_solution.activation[-1], atol=1e-12)
    error = slow_solution.qpos - mjhcmc.Motion.cosine(leg8, "slow").sample(slow_solution.time).qpos
    np.testing.assert_allclose(slow_solution.tracking_error, error, atol=1e-12)


@pytest.mark.parametrize("movement", ["swing", "fast"])
def test_order_of_convergence(request, leg8, movement):
    motion = request.getfixturevalue(movement)
    errors = [
        np.rad2deg(np.abs(mjhcmc.hcmc(leg8, motion, dt=dt).tracking_error).max(axis=0))
        for dt in (0.02, 0.01, 0.005, 0.0025)
    ]
    for coarse, fine in pairwise(errors):
        above_the_floor = fine > 1e-6
        assert np.all(np.log2(coarse / fine)[above_the_floor] >= 2), errors


def test_one_trial_nearly_settles_a_window(leg8, fast):
    """The response of a window's end is predicted well enough for one Newton step; a ramp loses the leg."""
    error = np.rad2deg(np.abs(mjhcmc.hcmc(leg8, fast, trials=1).tracking_error).max(axis=0))
    assert np.all(error <= (0.015, 0.03, 0.2)), error


# --- closed forms -----------------------------------------------------------------------------------------------


def test_weight_held_still_by_one_muscle(hanging_mass):
    """u = a = (m g - passive)/(F0 FL) at rest, MuJoCo's own curves."""
    still = mjhcmc.Motion(np.linspace(0, 0.2, 21), np.full((21, 1), 0.1))
    solution = mjhcmc.hcmc(hanging_mass, still)
    m, i = hanging_mass.mj_model, int(hanging_mass.muscle_ids[0])
    gain = mujoco.mju_muscleGain(0.9, 0.0, m.actuator_lengthrange[i], m.actuator_acc0[i], m.actuator_gainprm[i, :9])
    bias = mujoco.mju_muscleBias(0.9, m.actuator_lengthrange[i], m.actuator_acc0[i], m.actuator_biasprm[i, :9])
    expected = (MASS * GRAVITY + bias) / -gain
    np.testing.assert_allclose(solution.excitation, expected, atol=1e-6)
    np.testing.assert_allclose(solution.activation, expected, atol=1e-6)
    np.testing.assert_allclose(solution.muscle_force, MASS * GRAVITY, atol=1e-4)
    np.testing.assert_allclose(solution.net_joint_moment, MASS * GRAVITY, atol=1e-4)


def test_linear_muscle_in_closed_form(linear_mass):
    """m q'' = F a - m g, so a = m (q'' + g)/F at every node; feedback adds what is left, and vanishes with dt."""
    motion = height_motion(linear_mass)
    worst = []
    for dt in (0.01, 0.005):
        solution = mjhcmc.hcmc(linear_mass, motion, dt=dt)
        ideal = MASS * (motion.sample(solution.time).qacc + GRAVITY) / STRENGTH
        worst.append(np.abs(solution.activation - ideal).max())
        np.testing.assert_allclose(solution.muscle_force, STRENGTH * solution.activation, rtol=1e-12)
        np.testing.assert_allclose(solution.net_joint_moment[:-1] - solution.reserve, solution.muscle_force[:-1])
    assert worst[1] < 5e-4  # of activations between .05 and .35
    assert np.log2(worst[0] / worst[1]) > 1.9  # second order


# --- round trips ------------------------------------------------------------------------------------------------


def simulate(model, excitation_at, duration, step=0.001):
    """Step the model under known smooth excitations; (time, qpos, net joint moments)."""
    plant = mjhcmc.MujocoPlant(model, step)
    n = round(duration / step)
    qpos, moment, activation = [], [], []
    plant.mj_data.act[model.act_index] = excitation_at(0.0)
    for k in range(n + 1):
        plant.forward()
        qpos.append(plant.mj_data.qpos.copy())
        moment.append(mjhcmc.dynamics.net_joint_moment(plant))
        activation.append(plant.get_state().activation)
        plant.advance(excitation_at(k * step), np.zeros(model.nv), 1)
    return np.arange(n + 1) * step, np.array(qpos), np.array(moment), np.array(activation)


def test_round_trip_recovers_excitations_where_muscles_are_not_redundant(two_joints):
    def excitation_at(t):
        return np.array([0.08 - 0.05 * np.cos(2 * np.pi * t / 0.5), 0.1 + 0.05 * np.sin(2 * np.pi * t / 0.5)])

    time, qpos, moment, activation = simulate(two_joints, excitation_at, 0.6)
    solution = mjhcmc.hcmc(
        two_joints, mjhcmc.Motion(time, qpos), dt=0.002, initial_qvel=[0.0, 0.0], initial_activation=activation[0]
    )
    nodes = np.rint(solution.time / 0.001).astype(int)
    middle = (solution.time[:-1] + solution.time[1:]) / 2
    known = np.array([excitation_at(t) for t in middle])
    scale = np.abs(moment).max(axis=0)
    assert np.all(np.abs(solution.net_joint_moment - moment[nodes])[2:].max(axis=0) < 2e-3 * scale)
    assert np.abs(solution.activation - activation[nodes]).max() < 2e-3
    assert np.abs(solution.excitation - known)[2:].max() < 1e-2
    assert np.abs(solution.reserve).max() < 1e-3 * scale.max()


def test_round_trip_recovers_joint_moments_where_they_are(leg8, slow_solution):
    """Other activations share the same moments: known excitations -> motion -> the moments come back."""

    def excitation_at(t):
        phase = 2 * np.pi * (t / 0.8 + np.arange(8) / 8)
        return 0.06 + 0.05 * np.cos(phase)

    time, qpos, moment, _ = simulate(leg8, excitation_at, 0.6)
    solution = mjhcmc.hcmc(leg8, mjhcmc.Motion(time, qpos), dt=0.002, initial_qvel=np.zeros(3))
    nodes = np.rint(solution.time / 0.001).astype(int)
    scale = np.abs(moment).max(axis=0)
    assert np.all(np.abs(solution.net_joint_moment - moment[nodes])[4:].max(axis=0) < 0.01 * scale)
    assert np.rad2deg(np.abs(solution.tracking_error).max()) < 0.01


# --- each allocation, reserves, recovery -------------------------------------------------------------------------


@pytest.mark.parametrize("movement", ["swing", "fast"])
def test_every_allocation_is_optimal(request, leg8, movement, monkeypatch):
    """Step by step each is proven; the compiled way gives the same."""
    motion, solved = request.getfixturevalue(movement), []

    def watched(problem, solver="newton"):
        found = real(problem, solver)
        solved.append(problem.optimality_residual(found))
        return found

    real = sharing.allocate
    compiled = mjhcmc.hcmc(leg8, motion)
    monkeypatch.setattr(sharing, "allocate", watched)
    monkeypatch.setattr(correction, "NEWTON", "another")
    solution = mjhcmc.hcmc(leg8, motion)
    assert len(solved) > solution.n_window
    assert max(solved) < 1e-9
    np.testing.assert_allclose(compiled.activation, solution.activation, rtol=0, atol=1e-8)
    np.testing.assert_allclose(compiled.qpos, solution.qpos, rtol=0, atol=1e-9)


def test_beyond_the_muscles_strength_reserves_are_applied_flagged_and_named(linear_mass):
    """100 N lift 2 kg at 40 m/s^2 and gravity pulls at 10: a cosine of 63 m/s^2 either way needs reserves both ways."""
    motion = height_motion(linear_mass, amplitude=0.2, period=0.25)
    solution = mjhcmc.hcmc(linear_mass, motion)
    desired = motion.sample(solution.time)
    lacking = MASS * (desired.qacc[:, 0].max() + GRAVITY) - STRENGTH
    assert lacking > 20
    assert solution.reserve.max() == pytest.approx(lacking, rel=0.2)
    assert solution.reserve.min() == pytest.approx(MASS * (desired.qacc[:, 0].min() + GRAVITY), rel=0.2)
    assert np.abs(solution.tracking_error).max() < 0.005
    assert (solution.status == WindowStatus.RESERVE).any()
    # the books: muscle + reserve = net moment, and the net moment is what moves the mass
    np.testing.assert_allclose(
        solution.muscle_force[:-1, 0] + solution.reserve[:, 0], solution.net_joint_moment[:-1, 0], rtol=1e-9
    )
    assert not solution.verdict.passed
    text = " ".join(solution.verdict.findings)
    assert "height" in text
    assert "silent: pull" in text  # the largest reserve pushes down, where the muscle can only let go
    assert " s" in text
    # replay with the reserves follows; without them it could not
    assert max(solution.verdict.replay_max_error) < 1e-4


def test_a_reserve_serves_its_own_joint_alone():
    """One joint has strong muscles, its neighbour none: the neighbour needs a reserve, the first does not."""
    model = load_xml(HALF_MUSCLED)
    motion = mjhcmc.Motion.cosine(model, amplitudes={"a": 0.4, "b": 0.6}, period=0.8)
    solution = mjhcmc.hcmc(model, motion)
    share = np.abs(solution.reserve).max(axis=0) / solution.peak_moment
    assert share[0] < 1e-3
    assert share[1] == pytest.approx(1, abs=0.01)
    assert np.rad2deg(np.abs(solution.tracking_error).max()) < 0.05
    assert not solution.verdict.passed
    assert all(finding.startswith("b:") for finding in solution.verdict.findings)


def test_the_last_nodes_moment_has_the_last_windows_reserve(linear_mass):
    motion = height_motion(linear_mass, amplitude=0.2, period=0.25, cycles=1)
    solution = mjhcmc.hcmc(linear_mass, motion, dt=0.01)  # ends where a reserve is in use
    assert abs(solution.reserve[-1, 0]) > 1
    expected = solution.muscle_force[-1, 0] + solution.reserve[-1, 0]
    assert solution.net_joint_moment[-1, 0] == pytest.approx(expected, rel=1e-9)


def test_a_divergence_is_solved_again_with_a_finer_step(leg8, swing, coarse_replay):
    """One step of 10 ms a window is too long for active muscles; a quarter of it is not."""
    with pytest.warns(mjhcmc.MjhcmcWarning, match=r"diverged.*solved again with physics_dt 0\.0025"):
        solution = mjhcmc.hcmc(leg8, swing, physics_dt=1)
    assert solution.n_window == 60
    assert solution.settings["physics_dt"] == pytest.approx(0.0025)
    assert solution.verdict.passed


def test_a_divergence_of_a_given_plant_keeps_what_was_solved_and_says_what_to_do(leg8, slow):
    with pytest.raises(mjhcmc.SimulationError, match=r"diverged.*physics_dt <= 0\.005") as caught:
        mjhcmc.hcmc(leg8, slow, plant=mjhcmc.MujocoPlant(leg8, 0.01))
    part = caught.value.solution
    assert part.interrupted
    assert 0 < part.n_window < 180


def test_without_reserves_nothing_but_muscles_acts(linear_mass):
    solution = mjhcmc.hcmc(linear_mass, height_motion(linear_mass, amplitude=0.2, period=0.25), reserves=False)
    assert not solution.reserve.any()
    assert (solution.status == WindowStatus.UNMET).any()
    assert np.abs(solution.tracking_error).max() > 0.005
    assert not solution.verdict.passed
    assert "height" in " ".join(solution.verdict.findings)


PERIOD = {"slow": 0.6, "fast": 0.2}
OFFSETS = [*product([1, 5], [1, -1], [(1, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1)])]  # degrees, sign, joints


@pytest.fixture(scope="module")
def cycles(leg8):
    """Two cycles of slow and all of fast, and their solutions without reserves."""
    motions = {name: mjhcmc.Motion.cosine(leg8, name) for name in PERIOD}
    motions["slow"] = replace(motions["slow"], span=(0, 1.2))
    return {name: (motion, mjhcmc.hcmc(leg8, motion, dt=0.005, reserves=False)) for name, motion in motions.items()}


@pytest.fixture(scope="module")
def wrong_starts(leg8, cycles):
    """Those motions from every wrong start, solved together."""
    found = {}
    for movement, (motion, _) in cycles.items():
        off = [sign * np.deg2rad(degrees) * np.array(joints) for degrees, sign, joints in OFFSETS]
        start = motion.sample([0.0]).qpos[0] + np.array(off)
        batch = mjhcmc.hcmc_batch(leg8, [motion] * len(start), dt=0.005, reserves=False, initial_qpos=start)
        found[movement] = dict(zip(OFFSETS, batch, strict=True))
        for solution, qpos in zip(batch, start, strict=True):
            np.testing.assert_array_equal(solution.qpos[0], qpos)
    return found


@pytest.mark.parametrize(
    ("movement", "degrees", "cycle"), [("slow", 1, 1), ("fast", 1, 1), ("slow", 5, 1), ("fast", 5, 2)]
)
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("joints", [(1, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
def test_comes_back_from_a_wrong_start(cycles, wrong_starts, movement, degrees, cycle, sign, joints):
    solution, nominal = wrong_starts[movement][degrees, sign, joints], np.abs(cycles[movement][1].tracking_error)
    after = solution.time >= cycle * PERIOD[movement] - 1e-9
    first = solution.time >= PERIOD[movement] - 1e-9
    assert after.sum() > 0.3 * len(after)
    assert np.all(np.abs(solution.tracking_error)[after].max(axis=0) <= 2 * nominal[first].max(axis=0))


@pytest.mark.parametrize("movement", ["slow", "fast"])
def test_comes_back_from_resting_activation(leg8, cycles, movement):
    motion, nominal = cycles[movement]
    nominal = np.abs(nominal.tracking_error)
    solution = mjhcmc.hcmc(leg8, motion, dt=0.005, reserves=False, initial_activation=0.01)
    after = solution.time >= PERIOD[movement] - 1e-9
    assert np.all(np.abs(solution.tracking_error)[after].max(axis=0) <= 2 * nominal[after].max(axis=0))


# --- settings ----------------------------------------------------------------------------------------------------


def test_same_input_same_bits(leg8, fast, fast_solution):
    again = mjhcmc.hcmc(leg8, fast)
    for name in ("excitation", "activation", "qpos", "reserve", "muscle_force", "net_joint_moment"):
        np.testing.assert_array_equal(getattr(again, name), getattr(fast_solution, name))


@pytest.mark.parametrize("solver", ["daqp", "quadprog", "osqp"])
def test_any_qp_solver_gives_the_same(leg8, fast, fast_solution, solver):
    other = mjhcmc.hcmc(leg8, fast, solver=solver)
    np.testing.assert_allclose(other.excitation, fast_solution.excitation, rtol=0, atol=1e-7)


def test_excitation_stays_within_the_models_range():
    from conftest import HANGING_MASS, MUSCLE_ACTUATOR, load_xml

    limited = MUSCLE_ACTUATOR.replace('ctrlrange="0 1"', 'ctrlrange=".02 .5" ctrllimited="true"')
    model = load_xml(HANGING_MASS.format(actuator=limited))
    solution = mjhcmc.hcmc(model, height_motion(model))
    assert solution.excitation.min() >= 0.02
    assert solution.excitation.max() <= 0.5


def test_windows_and_nodes(leg8, slow):
    solution = mjhcmc.hcmc(leg8, slow, dt=0.02)
    n = 90
    assert solution.n_window == n
    np.testing.assert_allclose(solution.time, np.arange(n + 1) * 0.02, atol=1e-12)
    assert solution.excitation.shape == (n, 8)
    assert solution.activation.shape == (n + 1, 8)
    assert solution.net_joint_moment.shape == (n + 1, 3)
    assert solution.muscle_force.shape == (n + 1, 8)
    assert solution.reserve.shape == (n, 3)
    assert solution.status.shape == (n,)
    assert solution.settings["physics_dt"] == pytest.approx(0.001)
    assert mjhcmc.hcmc(leg8, slow, dt=0.02, physics_dt=0.0015).settings["physics_dt"] == pytest.approx(0.02 / 14)


def test_a_dt_that_does_not_divide_drops_the_rest_with_a_notice(leg8, slow):
    with pytest.warns(mjhcmc.MjhcmcWarning, match="dropped"):
        solution = mjhcmc.hcmc(leg8, slow, dt=0.07)
    assert solution.time[-1] == pytest.approx(1.75)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"dt": 0.0}, "dt must be a positive"),
        ({"dt": -0.01}, "dt must be a positive"),
        ({"dt": float("nan")}, "dt must be a positive"),
        ({"dt": 5.0}, "longer than the motion"),
        ({"physics_dt": 0.0}, "physics_dt must be a positive"),
        ({"initial_qpos": [0.0]}, "initial_qpos must hold 3"),
        ({"initial_activation": 1.5}, "within 0..1"),
        ({"initial_qvel": [0, np.nan, 0]}, "initial_qvel must hold finite"),
        ({"solver": "simplex"}, "unknown QP solver 'simplex'"),
        ({"trials": 0}, "trials must be at least 1"),
        ({"gain": 6.0}, "gain must be positive and at most 3"),
        ({"reserves": "no"}, "reserves must be True or False"),
        ({"trials": 1.5}, "trials must be at least 1"),
        ({"initial_qpos": "x"}, "initial_qpos must hold 3 numbers"),
        ({"gain": -1.0}, "gain must be positive and at most 3"),
    ],
)
def test_bad_settings_are_named(leg8, slow, settings, message):
    with pytest.raises(mjhcmc.SettingsError, match=message):
        mjhcmc.hcmc(leg8, slow, **settings)


def test_names_in_place_of_a_model_or_motion_are_refused(leg8, slow):
    with pytest.raises(mjhcmc.SettingsError, match=r"got str and Motion.*MuscleModel\.load"):
        mjhcmc.hcmc("leg8", slow)
    with pytest.raises(mjhcmc.SettingsError, match="got MuscleModel and str"):
        mjhcmc.hcmc(leg8, "slow")


def test_a_start_outside_the_range_is_named(leg8, slow):
    with pytest.raises(mjhcmc.MotionError, match=r"knee.*30.*deg.*outside its range"):
        mjhcmc.hcmc(leg8, slow, initial_qpos=np.deg2rad([0, 30, 0]))


def test_a_motion_of_another_model_is_refused(leg8, linear_mass):
    with pytest.raises(mjhcmc.MotionError, match="has 1 joints, model 'leg8' has 3"):
        mjhcmc.hcmc(leg8, height_motion(linear_mass))


def test_unstable_damping_is_refused_with_the_step_that_works(leg8):
    from conftest import PENDULUMS, load_xml

    stiff = load_xml(PENDULUMS.replace('name="elbow"', 'name="elbow" damping="60"'))
    motion = mjhcmc.Motion.cosine(stiff, amplitudes={"elbow": 0.2}, period=0.5)
    with pytest.raises(mjhcmc.SimulationError, match=r"physics_dt <= (\S+)") as caught:
        mjhcmc.hcmc(stiff, motion)
    step = float(str(caught.value).rsplit("<=", 1)[1])
    assert np.isfinite(mjhcmc.hcmc(stiff, motion, physics_dt=step).qpos).all()


def test_an_interrupt_keeps_what_was_solved(leg8, swing):
    def stop(done, count):
        if done == 30:
            raise KeyboardInterrupt

    with pytest.raises(mjhcmc.SolveInterrupted) as caught:
        mjhcmc.hcmc(leg8, swing, progress=stop)
    part = caught.value.solution
    assert part.interrupted
    assert part.n_window == 30
    whole = mjhcmc.hcmc(leg8, swing)
    np.testing.assert_array_equal(part.excitation, whole.excitation[:30])
    assert not part.verdict.passed
    assert "interrupted" in part.verdict.findings[0]

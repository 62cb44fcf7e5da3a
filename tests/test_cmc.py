"""CMC: its law in closed form, the force bounds over the look-ahead, its two targets against independent solvers."""

import copy
import dataclasses

import mujoco
import numpy as np
import pytest
from affine import Affine
from scipy.integrate import solve_ivp
from scipy.optimize import lsq_linear

import mjhcmc
from mjhcmc.dynamics import moment_arms
from mjhcmc.plant import State
from mjhcmc.solution import WindowStatus

GRAVITY, MASS, STRENGTH = 9.81, 2.0, 100.0


def still(height=0.1, duration=0.5):
    time = np.linspace(0, duration, 51)
    return mjhcmc.Motion(time, np.full((51, 1), height))


@pytest.fixture(scope="module")
def saturated(leg8):
    """Far more than the muscles can do in .25 s."""
    return mjhcmc.Motion.cosine(leg8, amplitudes={"hip": 0.6, "knee": -0.8, "ankle": -0.3}, period=0.25, cycles=1)


# Degrees hip/knee/ankle that CMC must reach on the leg at dt = .01 with its default settings.
FIGURES = [("fast", (0.5, 1.5, 3.0)), ("slow", (0.1, 0.2, 0.5))]


@pytest.mark.parametrize(("movement", "limit"), FIGURES)
def test_tracking_figures(leg8, movement, limit):
    solution = mjhcmc.cmc(leg8, mjhcmc.Motion.cosine(leg8, movement), dt=0.01)
    error = np.rad2deg(np.abs(solution.tracking_error).max(axis=0))
    assert np.all(error <= limit), error
    assert np.all(np.abs(solution.reserve).max(axis=0) <= 1e-3 * solution.peak_moment)
    assert (solution.status == WindowStatus.OK).all()
    assert solution.verdict.passed
    assert np.rad2deg(max(solution.verdict.replay_max_error)) < 0.01


# --- the law in closed form -----------------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:look_ahead")
@pytest.mark.parametrize(
    ("dt", "look_ahead"), [(0.005, 0.005), (0.01, 0.005), (0.005, 0.01), (0.01, 0.01), (0.02, 0.01)]
)
def test_the_law_at_every_window(linear_mass, dt, look_ahead):
    """Of 2 kg under 100 a: a(t+T) = m (q''_d(t+T) + kv (v_d - v) + kp (q_d - q) + g)/100, where it can be reached."""
    motion = mjhcmc.Motion.cosine(linear_mass, amplitudes={"height": -0.05}, period=0.5, cycles=1)
    kp, kv, n = 400.0, 30.0, round(look_ahead * 1000)
    solution = mjhcmc.cmc(
        linear_mass, motion, dt, look_ahead=look_ahead, kp=kp, kv=kv, initial_qpos=[0.001], initial_qvel=[0.01]
    )
    plant = mjhcmc.MujocoPlant(linear_mass, 0.001)
    seen = 0
    for k, t in enumerate(solution.time[:-1]):
        now, ahead = motion.sample(t), motion.sample(min(t + look_ahead, motion.end))
        acceleration = ahead.qacc[0, 0] + kv * (now.qvel[0] - solution.qvel[k]) + kp * (now.qpos[0] - solution.qpos[k])
        plant.set_state(State(0.0, solution.qpos[k], solution.qvel[k], solution.activation[k], np.zeros(1)))
        plant.advance(solution.excitation[k], np.zeros(1), n)  # held over the look-ahead, however long the window
        reached = plant.get_state().activation
        if 0 < solution.excitation[k, 0] < 1:
            seen += 1
            assert reached == pytest.approx(MASS * (acceleration + GRAVITY) / STRENGTH, rel=1e-8)
    assert seen >= 0.9 * solution.n_window


def test_the_excitation_that_one_window_takes(linear_mass):
    """Its activation obeys a' = (u - a)/tau(a) (Thelen 2003) and arrives where the force is right."""
    offset, kp, kv = 0.002, 2500.0, 100.0
    solution = mjhcmc.cmc(linear_mass, still(), initial_qpos=[0.1 - offset])
    wanted = MASS * (kp * offset + GRAVITY) / STRENGTH
    u, start = solution.excitation[0, 0], MASS * GRAVITY / STRENGTH
    assert solution.activation[0, 0] == pytest.approx(start, rel=1e-8)
    assert start < wanted < u < 1

    def rate(_, a):
        return (u - a) / (0.01 * (0.5 + 1.5 * a))

    reached = solve_ivp(rate, (0, 0.01), [start], rtol=1e-10, atol=1e-12).y[0, -1]
    assert reached == pytest.approx(wanted, rel=1e-5)
    assert solution.settings["kp"] == kp
    assert solution.settings["kv"] == kv


def test_an_offset_decays_as_the_law_says(linear_mass):
    """e'' = -kv e' - kp e with kp = w^2, kv = 2 w: e = e0 (1 + w t) exp(-w t), but for the delay of T."""
    offset, w = 0.01, 10.0
    worst = []
    for dt in (0.02, 0.01, 0.005):
        solution = mjhcmc.cmc(linear_mass, still(), dt, look_ahead=dt, kp=w**2, kv=2 * w, initial_qpos=[0.1 + offset])
        t = solution.time
        worst.append(np.abs(solution.tracking_error[:, 0] - offset * (1 + w * t) * np.exp(-w * t)).max())
    assert worst[2] < 0.05 * offset
    np.testing.assert_allclose(np.log2(np.divide(worst[:2], worst[1:])), 1, atol=0.3)  # first order in the delay


@pytest.mark.parametrize(("offset", "excitation"), [(-0.05, 1.0), (0.05, 0.0)])
def test_beyond_the_bounds_over_the_look_ahead(linear_mass, offset, excitation):
    """125 m/s^2 either way: the muscle does all that it can within 10 ms; a reserve gives the rest, or nothing does."""
    for reserves in (True, False):
        solution = mjhcmc.cmc(linear_mass, still(), initial_qpos=[0.1 + offset], reserves=reserves)
        assert solution.excitation[0, 0] == excitation
        lacking = MASS * (-2500.0 * offset + GRAVITY) - STRENGTH * solution.activation[1, 0]
        assert solution.shortfall[0, 0] == pytest.approx(lacking, rel=1e-6)
        assert solution.reserve[0, 0] == pytest.approx(lacking if reserves else 0.0, rel=1e-6)
        assert solution.status[0] == (WindowStatus.RESERVE if reserves else WindowStatus.UNMET)
        assert not solution.verdict.passed


def test_a_longer_look_ahead_reaches_further(linear_mass):
    """What 10 ms allow at full excitation only, 20 ms allow with less."""
    start = {"initial_qpos": [0.1 - 0.0105], "reserves": False}
    assert mjhcmc.cmc(linear_mass, still(), **start).excitation[0, 0] == 1
    assert mjhcmc.cmc(linear_mass, still(), look_ahead=0.02, **start).excitation[0, 0] < 0.95


def test_the_look_ahead_is_a_setting_of_its_own(leg8, fast):
    first = [mjhcmc.cmc(leg8, fast, dt, look_ahead=0.01).excitation[0] for dt in (0.005, 0.01, 0.02)]
    np.testing.assert_array_equal(first[0], first[1])
    np.testing.assert_array_equal(first[0], first[2])
    other = mjhcmc.cmc(leg8, fast, look_ahead=0.005).excitation[0]
    assert np.abs(other - first[0]).max() > 0.01


def test_the_look_ahead_is_dt_unless_given(leg8, fast):
    assert mjhcmc.cmc(leg8, fast, 0.005).settings["look_ahead"] == pytest.approx(0.005)
    with pytest.warns(mjhcmc.MjhcmcWarning, match="short for dt 0.01 s"):
        assert mjhcmc.cmc(leg8, fast, 0.01, look_ahead=0.0034).settings["look_ahead"] == pytest.approx(0.003)


def test_gains_that_the_window_cannot_hold_are_refused(leg8, slow):
    for gains in ({"kp": 4e4}, {"kp": 1.0, "kv": 1000.0}, {"kp": 2500.0, "kv": 1.0}):
        with pytest.raises(mjhcmc.SettingsError, match=r"unstable when held over dt 0\.01 s"):
            mjhcmc.cmc(leg8, slow, **gains)
    for dt in (0.02, 0.03, 0.06):  # the defaults give way instead
        settings = mjhcmc.cmc(leg8, slow, dt).settings
        assert settings["kv"] * dt == pytest.approx(1.6)


def test_stiff_windows_are_flagged(leg8, fast):
    assert (mjhcmc.cmc(leg8, fast, physics_dt=0.005).status == WindowStatus.STIFF).any()


def test_of_weights_only_ratios_matter(linear_mass):
    """Also for the slow target."""
    start = {"initial_qpos": [0.1 - 0.02], "reserves": False}
    excitations = [mjhcmc.cmc(linear_mass, still(), weights=k, **start).excitation for k in (1e-4, 1.0, 1e4)]
    np.testing.assert_allclose(excitations[0], excitations[1], atol=1e-9)
    np.testing.assert_allclose(excitations[2], excitations[1], atol=1e-9)


def test_a_shorter_look_ahead_follows_better_where_the_window_is_as_short(leg8, fast):
    error = [np.abs(mjhcmc.cmc(leg8, fast, 0.005, look_ahead=T).tracking_error).max(axis=0) for T in (0.01, 0.005)]
    assert np.all(error[1] < 0.5 * error[0])


def test_opensims_gains_follow_fast_movement_less_well(leg8, fast):
    error = [
        np.abs(mjhcmc.cmc(leg8, fast, **gains).tracking_error).max(axis=0) for gains in ({}, {"kp": 100.0, "kv": 20.0})
    ]
    assert np.all(error[1] > 3 * error[0])


# --- the two targets against independent solvers ----------------------------------------------------------------------


class Window(Affine):
    """One window of a solve on the leg: what the muscles can do at its expected state, and within its look-ahead."""

    def __init__(self, solution, motion, k):
        settings = solution.settings
        now = motion.sample(solution.time[k])
        ahead = motion.sample(min(solution.time[k] + settings["look_ahead"], motion.end))
        q_error, v_error = now.qpos[0] - solution.qpos[k], now.qvel[0] - solution.qvel[k]
        super().__init__(solution.model, ahead.qpos[0] - q_error, ahead.qvel[0] - v_error)
        self.wanted = ahead.qacc[0] + settings["kv"] * v_error + settings["kp"] * q_error
        before, duration = solution.activation[k], settings["look_ahead"]
        self.low, self.high = (self.activation_after(before, u, duration) for u in (0.0, 1.0))

    def activation_after(self, before, u, duration, step=0.001):
        m, d = copy.copy(self.m), self.d
        m.opt.timestep = step
        mujoco.mj_resetData(m, d)
        d.act[:], d.ctrl[:] = before, u
        mujoco.mj_step(m, d, nstep=round(duration / step))
        return d.act.copy()


@pytest.mark.parametrize("cost", ["effort", "stress", "capacity"])
def test_the_fast_target_is_met_at_the_least_cost(leg8, fast, cost):
    solution = mjhcmc.cmc(leg8, fast, cost=cost, reserves=False)
    assert (solution.status == WindowStatus.OK).all()
    for k in range(0, solution.n_window, 4):
        window = Window(solution, fast, k)
        found = solution.activation[k + 1]  # dt = T: what the window aimed at
        reached = window.at(found)[0]
        np.testing.assert_allclose(reached, window.wanted, rtol=0, atol=1e-3)  # of up to 1700 rad/s^2
        best = window.cheapest(reached, window.low, window.high, cost, start=found)
        np.testing.assert_allclose(found, best, rtol=0, atol=1e-5)


@pytest.mark.parametrize("cost", ["effort", "stress", "capacity"])
def test_the_slow_target_trades_accelerations_for_cost(leg8, saturated, cost):
    """min |q''(a) - q''*|^2 + cost within the bounds: one least-squares problem, by scipy's own solver."""
    solution = mjhcmc.cmc(leg8, saturated, cost=cost, reserves=False)
    assert not solution.reserve.any()
    unmet = np.flatnonzero(solution.status == WindowStatus.UNMET)
    assert len(unmet) >= 5
    for k in unmet:
        window = Window(solution, saturated, k)
        factor, offset = window.cost(cost)
        system = np.vstack([window.J, np.diag(factor)])
        right = np.concatenate([window.wanted - window.rest, -offset])
        best = lsq_linear(system, right, (window.low, window.high), method="bvls", tol=1e-14).x
        np.testing.assert_allclose(solution.activation[k + 1], best, rtol=0, atol=1e-6)
        assert np.abs(window.at(best)[0] - window.wanted).max() > 0.1


# --- the same contract as every method --------------------------------------------------------------------------------


def test_the_books_balance(leg8, fast, saturated):
    for motion in (fast, saturated):
        solution = mjhcmc.cmc(leg8, motion)
        n = solution.n_window
        assert solution.excitation.shape == (n, 8)
        assert solution.activation.shape == solution.muscle_force.shape == (n + 1, 8)
        assert solution.reserve.shape == solution.shortfall.shape == (n, 3)
        assert solution.excitation.min() >= 0
        assert solution.excitation.max() <= 1
        np.testing.assert_array_equal(solution.shortfall, solution.reserve)
        plant = mjhcmc.MujocoPlant(leg8)
        for k in range(n + 1):
            plant.set_state(State(0.0, solution.qpos[k], solution.qvel[k], solution.activation[k], np.zeros(3)))
            plant.forward()
            given = moment_arms(plant).T @ solution.muscle_force[k] + solution.reserve[min(k, n - 1)]
            np.testing.assert_allclose(solution.net_joint_moment[k], given, rtol=1e-9, atol=1e-9)
        assert np.rad2deg(max(solution.verdict.replay_window_max_error)) < 1e-3


def test_reserves_are_applied_flagged_and_named(leg8, saturated):
    solution = mjhcmc.cmc(leg8, saturated)
    assert WindowStatus.RESERVE in solution.status
    assert np.rad2deg(np.abs(solution.tracking_error)).max() < 3
    assert not solution.verdict.passed
    assert any(text.startswith("hip: reserve of") and "exceeds 5 %" in text for text in solution.verdict.findings)
    without = mjhcmc.replay(dataclasses.replace(solution, reserve=np.zeros_like(solution.reserve)))
    assert np.rad2deg(np.abs(without - solution.qpos)).max() > 10


def test_it_comes_back_from_a_wrong_start(leg8, slow):
    start = slow.sample(0.0).qpos[0] + np.deg2rad(2)
    nominal = np.abs(mjhcmc.cmc(leg8, slow, reserves=False).tracking_error)
    solution = mjhcmc.cmc(leg8, slow, reserves=False, initial_qpos=start)
    after = solution.time >= 0.6 - 1e-9
    assert np.all(np.abs(solution.tracking_error)[after].max(axis=0) <= 1.5 * nominal[after].max(axis=0))


def test_same_input_same_bits(leg8, fast):
    first, again = mjhcmc.cmc(leg8, fast), mjhcmc.cmc(leg8, fast)
    np.testing.assert_array_equal(first.excitation, again.excitation)
    np.testing.assert_array_equal(first.qpos, again.qpos)


def test_an_interrupt_keeps_what_was_solved(leg8, slow):
    def stop(done, count):
        assert count == 180
        if done == 30:
            raise KeyboardInterrupt

    with pytest.raises(mjhcmc.SolveInterrupted) as caught:
        mjhcmc.cmc(leg8, slow, progress=stop)
    part = caught.value.solution
    assert part.interrupted
    assert part.n_window == 30
    np.testing.assert_array_equal(part.excitation, mjhcmc.cmc(leg8, slow).excitation[:30])
    assert "interrupted" in part.verdict.findings[0]


def test_a_look_ahead_past_the_end_of_the_motion_stops_there(linear_mass):
    solution = mjhcmc.cmc(linear_mass, still(duration=0.1), look_ahead=0.1)
    np.testing.assert_allclose(solution.excitation, MASS * GRAVITY / STRENGTH, atol=1e-6)


@pytest.mark.parametrize("name", ["look_ahead", "kp", "kv"])
@pytest.mark.parametrize("value", [0, -1.0, np.nan, np.inf, "10", True])
def test_bad_settings_are_named(leg8, slow, name, value):
    with pytest.raises(mjhcmc.SettingsError, match=f"{name} must be (a positive number|positive and at most .*); got "):
        mjhcmc.cmc(leg8, slow, **{name: value}, progress=pytest.fail)


@pytest.mark.parametrize(("dt", "w"), [(0.005, 50), (0.01, 50), (0.02, 40), (0.04, 20)])
def test_the_default_gains_suit_the_window(leg8, slow, dt, w):
    motion = dataclasses.replace(slow, span=(0, 0.2))
    settings = mjhcmc.cmc(leg8, motion, dt).settings
    assert settings["kp"] == pytest.approx(w**2)
    assert settings["kv"] == pytest.approx(2 * w)
    settings = mjhcmc.cmc(leg8, motion, dt, kp=225.0).settings
    assert (settings["kp"], settings["kv"]) == (225, pytest.approx(30))  # critically damped


def test_other_bad_settings(leg8, slow):
    with pytest.raises(mjhcmc.SettingsError, match="reserves must be True or False; got 'no'"):
        mjhcmc.cmc(leg8, slow, reserves="no")
    with pytest.raises(TypeError, match="trials"):
        mjhcmc.cmc(leg8, slow, trials=3)  # HCMC's own

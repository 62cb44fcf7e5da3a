"""Static optimization: activations at the nodes by independent means, open loop, and what comes of it."""

import numpy as np
import pytest
from affine import Affine

import mjhcmc
from mjhcmc.dynamics import moment_arms
from mjhcmc.plant import State
from mjhcmc.solution import WindowStatus

GRAVITY, MASS, STRENGTH = 9.81, 2.0, 100.0


def height_motion(model, amplitude=-0.05, period=0.5, cycles=1):
    return mjhcmc.Motion.cosine(model, amplitudes={"height": amplitude}, period=period, cycles=cycles)


def reached(solution):
    """(N, n_muscle) where an excitation between its limits took activation to its node's value."""
    return (solution.excitation > 0) & (solution.excitation < 1)


# --- activations at the nodes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("movement", ["slow", "fast"])
@pytest.mark.parametrize("cost", ["effort", "stress", "capacity"])
def test_activations_at_the_nodes_of_the_reference(leg8, movement, cost):
    """Of the accelerations that plain MuJoCo gives at the reference's state, the desired ones, at the least cost."""
    motion = mjhcmc.Motion.cosine(leg8, movement)
    floor = 0.05  # keeps most muscles between their bounds, where the excitation arrives
    solution = mjhcmc.static_optimization(leg8, motion, cost=cost, min_activation=floor)
    free = reached(solution)
    assert free.mean() > 0.3
    for k in range(0, solution.n_window, solution.n_window // 15):
        node = motion.sample(solution.time[k + 1])
        there = Affine(leg8, node.qpos[0], node.qvel[0])
        low, high = np.full(8, floor), np.ones(8)
        expected = there.cheapest(node.qacc[0], low, high, cost, start=solution.activation[k + 1])
        np.testing.assert_allclose(there.rest + there.J @ expected, node.qacc[0], rtol=0, atol=1e-5)
        np.testing.assert_allclose(solution.activation[k + 1, free[k]], expected[free[k]], rtol=0, atol=1e-5)
    first = motion.sample(0.0)
    there = Affine(leg8, first.qpos[0], first.qvel[0])
    start = solution.activation[0]
    expected = there.cheapest(first.qacc[0], np.full(8, floor), np.ones(8), cost, start=np.full(8, 0.2))
    np.testing.assert_allclose(start, expected, rtol=0, atol=1e-5)


def test_smoothness_holds_on_to_the_node_before(leg8, slow):
    sigma, floor = 3.0, np.full(8, 0.05)
    solution = mjhcmc.static_optimization(leg8, slow, smoothness=sigma, min_activation=0.05)
    free, before, rough = reached(solution), None, []
    for k in range(25):
        node = slow.sample(solution.time[k])
        there = Affine(leg8, node.qpos[0], node.qvel[0])
        start = solution.activation[k]
        alone = there.cheapest(node.qacc[0], floor, np.ones(8), "effort", start)
        expected = alone
        if before is not None:
            expected = there.cheapest(node.qacc[0], floor, np.ones(8), "effort", start, sigma, before)
            np.testing.assert_allclose(solution.activation[k, free[k - 1]], expected[free[k - 1]], rtol=0, atol=1e-5)
        rough.append(np.abs(expected - alone).max())
        before = expected
    assert max(rough) > 1e-3


def test_one_muscle_in_closed_form(linear_mass):
    """2 kg under 100 a: a = m (q'' + g)/100 at every node that activation reaches in time."""
    motion = height_motion(linear_mass)
    solution = mjhcmc.static_optimization(linear_mass, motion)
    ideal = MASS * (motion.sample(solution.time).qacc + GRAVITY) / STRENGTH
    assert reached(solution).all()
    np.testing.assert_allclose(solution.activation, ideal, rtol=1e-8)


# --- open loop -------------------------------------------------------------------------------------------------------


def test_excitations_do_not_depend_on_where_the_model_starts(leg8, slow):
    plain = mjhcmc.static_optimization(leg8, slow)
    moved = mjhcmc.static_optimization(leg8, slow, initial_qpos=[0.05, -0.1, 0.02], initial_qvel=[0.1, 0, -0.2])
    np.testing.assert_array_equal(moved.qpos[0], [0.05, -0.1, 0.02])
    np.testing.assert_array_equal(moved.qvel[0], [0.1, 0, -0.2])
    np.testing.assert_array_equal(moved.excitation, plain.excitation)
    np.testing.assert_array_equal(moved.activation, plain.activation)
    assert np.abs(moved.qpos - plain.qpos).max() > 0.05


def test_nothing_brings_it_back(linear_mass):
    """Where no force depends on position, an offset stays as it is and a wrong velocity adds up."""
    motion = height_motion(linear_mass)
    plain = mjhcmc.static_optimization(linear_mass, motion)
    moved = mjhcmc.static_optimization(linear_mass, motion, initial_qpos=[0.01], initial_qvel=[0.02])
    drift = (moved.tracking_error - plain.tracking_error)[:, 0]
    np.testing.assert_allclose(drift, 0.01 + 0.02 * plain.time, atol=1e-12)


def test_the_drift_of_a_benign_case_vanishes_with_dt(linear_mass):
    motion = height_motion(linear_mass)
    worst = []
    for dt in (0.01, 0.005, 0.0025):
        worst.append(np.abs(mjhcmc.static_optimization(linear_mass, motion, dt=dt).tracking_error).max())
    assert worst[-1] < 0.01 * 0.05  # of the movement's 5 cm
    assert np.all(np.log2(np.divide(worst[:2], worst[1:])) > 1.8)  # second order


def test_on_the_leg_the_drift_is_reported_and_the_verdict_fails(leg8, fast, fast_solution):
    solution = mjhcmc.static_optimization(leg8, fast)
    error = np.rad2deg(np.abs(solution.tracking_error).max(axis=0))
    assert np.all(error > 1)
    assert not solution.verdict.passed
    text = "\n".join(solution.verdict.findings)
    for joint in ("hip", "knee", "ankle"):
        assert f"{joint}: tracking RMS" in text
        assert f"{joint}: unmet moment of" in text
    assert "reserve" not in text  # they are next to nothing
    assert (solution.status == WindowStatus.UNMET).mean() > 0.9
    assert np.all(np.abs(solution.tracking_error).max(axis=0) > 50 * np.abs(fast_solution.tracking_error).max(axis=0))


def test_excitations_are_clipped_to_what_can_be(leg8, fast):
    """Activation cannot fall as fast as the nodes ask: the excitation is 0 and activation stays above."""
    solution = mjhcmc.static_optimization(leg8, fast)
    assert solution.excitation.min() == 0
    assert solution.excitation.max() <= 1
    late = 0
    for k in range(solution.n_window):
        node = fast.sample(solution.time[k + 1])
        there = Affine(leg8, node.qpos[0], node.qvel[0])
        wanted = there.cheapest(node.qacc[0], np.zeros(8), np.ones(8), "effort", start=solution.activation[k + 1])
        off = solution.excitation[k] == 0
        assert np.all(solution.activation[k + 1, off] >= wanted[off] - 1e-5)
        late += int(np.sum(solution.activation[k + 1, off] > wanted[off] + 0.01))
    assert late > 50


# --- reserves --------------------------------------------------------------------------------------------------------


def test_reserves_are_applied_where_the_reference_needs_them(linear_mass):
    """Beyond 100 N: the mean over a window's ends of what is left of m (q'' + g), whatever the drift."""
    motion = height_motion(linear_mass, amplitude=0.2, period=0.25)
    solution = mjhcmc.static_optimization(linear_mass, motion)
    force = MASS * (motion.sample(solution.time).qacc[:, 0] + GRAVITY)
    ideal = np.clip(force / STRENGTH, 0, 1)
    lacking = force - STRENGTH * ideal
    np.testing.assert_allclose(solution.reserve[:, 0], (lacking[:-1] + lacking[1:]) / 2, atol=1e-5)
    late = STRENGTH * (ideal[1:] - solution.activation[1:, 0])  # which no reserve stands in for
    assert np.abs(late).max() > 5
    np.testing.assert_allclose(solution.shortfall[:, 0] - solution.reserve[:, 0], late, atol=1e-5)
    assert {WindowStatus.RESERVE, WindowStatus.UNMET} <= set(solution.status)
    assert not solution.verdict.passed
    assert max(solution.verdict.replay_max_error) < 1e-4


def test_without_reserves_nothing_but_muscles_acts(linear_mass):
    motion = height_motion(linear_mass, amplitude=0.2, period=0.25)
    given, not_given = (mjhcmc.static_optimization(linear_mass, motion, reserves=r) for r in (True, False))
    assert not not_given.reserve.any()
    np.testing.assert_array_equal(not_given.excitation, given.excitation)
    force = MASS * (motion.sample(given.time).qacc[1:, 0] + GRAVITY)
    np.testing.assert_allclose(not_given.shortfall[:, 0], force - STRENGTH * not_given.activation[1:, 0], atol=1e-5)
    assert np.abs(not_given.tracking_error).max() > 2 * np.abs(given.tracking_error).max()


# --- the same contract as every method --------------------------------------------------------------------------------


def test_the_books_balance(leg8, fast):
    solution = mjhcmc.static_optimization(leg8, fast, disabled=["tib_ant"])  # with reserves in use
    assert np.abs(solution.reserve).max() > 0.1
    plant = mjhcmc.MujocoPlant(leg8)
    for k in range(solution.n_window + 1):
        plant.set_state(State(0.0, solution.qpos[k], solution.qvel[k], solution.activation[k], np.zeros(3)))
        plant.forward()
        given = moment_arms(plant).T @ solution.muscle_force[k] + solution.reserve[min(k, solution.n_window - 1)]
        np.testing.assert_allclose(solution.net_joint_moment[k], given, rtol=1e-9, atol=1e-9)
    assert np.rad2deg(max(solution.verdict.replay_max_error)) < 1e-3
    assert solution.settings["method"] == "static"


def test_an_interrupt_keeps_what_was_solved(leg8, slow):
    def stop(done, _):
        if done == 20:
            raise KeyboardInterrupt

    with pytest.raises(mjhcmc.SolveInterrupted) as caught:
        mjhcmc.static_optimization(leg8, slow, progress=stop)
    part = caught.value.solution
    assert part.interrupted
    np.testing.assert_array_equal(part.excitation, mjhcmc.static_optimization(leg8, slow).excitation[:20])


def test_bad_settings_are_named(leg8, slow):
    with pytest.raises(mjhcmc.SettingsError, match="reserves must be True or False; got 1"):
        mjhcmc.static_optimization(leg8, slow, reserves=1)
    with pytest.raises(TypeError, match="look_ahead"):
        mjhcmc.static_optimization(leg8, slow, look_ahead=0.01)

"""The allocation: closed forms, independent solvers, and the conditions that prove an optimum."""

import numpy as np
import pytest
import qpsolvers
from hypothesis import given, settings
from hypothesis import strategies as st

from mjhcmc.allocation import allocate, build_problem
from mjhcmc.errors import SettingsError, SimulationError


def random_problem(seed: int, *, feasible: bool):
    rng = np.random.default_rng(seed)
    nv, n = int(rng.integers(1, 6)), int(rng.integers(1, 16))
    B = rng.normal(size=(nv, n)) * 10 ** rng.uniform(0, 3)
    if seed % 5 == 0:
        B[0] = 0.0  # a joint that no muscle moves
    if seed % 7 == 0 and nv > 1:
        B[-1] = 2 * B[0]  # dependent rows
    lb = rng.uniform(0, 0.5, n)
    ub = lb + rng.uniform(0, 0.5, n)
    Q = B @ (ub if seed % 11 == 0 else rng.uniform(lb, ub))  # also exactly at a vertex
    if not feasible:
        Q = Q + rng.normal(size=nv) * np.abs(B).sum(axis=1)
    return build_problem(B, Q, lb, ub, w=10 ** rng.uniform(-1, 1, n))


@settings(max_examples=500, deadline=None)
@given(seed=st.integers(0, 10**6), feasible=st.booleans())
def test_optimality_conditions(seed, feasible):
    problem = random_problem(seed, feasible=feasible)
    found = allocate(problem)
    assert problem.optimality_residual(found) < 1e-9
    assert np.all(found.activation >= problem.lb)
    assert np.all(found.activation <= problem.ub)


@pytest.mark.parametrize("feasible", [True, False])
@pytest.mark.parametrize("solver", ["daqp", "quadprog"])
@pytest.mark.parametrize("seed", range(40))
def test_agrees_with_other_solvers(solver, seed, feasible):
    if solver not in qpsolvers.available_solvers:
        pytest.skip(f"{solver} is not installed")
    problem = random_problem(seed, feasible=feasible)
    ours, theirs = allocate(problem), allocate(problem, solver)
    np.testing.assert_allclose(ours.activation, theirs.activation, rtol=0, atol=1e-6)


def test_two_muscles_share_by_moment():
    # min a1^2 + a2^2 with 30 a1 + 40 a2 = 25: a = 25 (30, 40)/2500
    free = np.ones(2)
    found = allocate(build_problem(np.array([[30.0, 40.0]]), np.array([25.0]), 0 * free, free))
    np.testing.assert_allclose(found.activation, [0.3, 0.4], atol=1e-7)
    # where the second may reach .2 only, the first gives the rest
    found = allocate(build_problem(np.array([[30.0, 40.0]]), np.array([25.0]), 0 * free, np.array([1.0, 0.2])))
    np.testing.assert_allclose(found.activation, [17 / 30, 0.2], atol=1e-7)
    np.testing.assert_allclose(found.reserve, 0, atol=1e-5)


def test_preferred_activation_and_weights():
    # no moment asked beyond what a0 gives: a = a0, whatever the weights
    B, a0 = np.array([[30.0, 40.0]]), np.array([0.2, 0.3])
    found = allocate(build_problem(B, B @ a0, np.zeros(2), np.ones(2), w=np.array([5.0, 0.1]), a0=a0))
    np.testing.assert_allclose(found.activation, a0, atol=1e-9)
    # weights: a_i = B_i lambda/w_i
    found = allocate(build_problem(B, np.array([25.0]), np.zeros(2), np.ones(2), w=np.array([1.0, 2.0])))
    np.testing.assert_allclose(found.activation[0] / found.activation[1], (30 / 1) / (40 / 2), rtol=1e-6)


def test_reserve_takes_what_muscles_cannot():
    found = allocate(build_problem(np.array([[50.0]]), np.array([80.0]), np.zeros(1), np.ones(1)))
    np.testing.assert_allclose(found.activation, 1.0)
    np.testing.assert_allclose(found.reserve, 30.0)


def test_joint_without_muscle_is_all_reserve():
    B = np.array([[50.0, 20.0], [0.0, 0.0]])
    found = allocate(build_problem(B, np.array([10.0, 7.0]), np.zeros(2), np.ones(2)))
    np.testing.assert_allclose(found.reserve, [0.0, 7.0], atol=1e-5)


def test_bad_problems_are_refused():
    one = np.ones(1)
    with pytest.raises(SettingsError, match=r"unknown QP solver 'simplex'.*newton.*daqp"):
        allocate(build_problem(np.ones((1, 1)), one, 0 * one, one), "simplex")
    with pytest.raises(SimulationError, match="not finite"):
        allocate(build_problem(np.ones((1, 1)), np.array([np.nan]), 0 * one, one))
    with pytest.raises(SettingsError, match="weights must be positive"):
        build_problem(np.ones((1, 1)), one, 0 * one, one, w=0 * one)
    with pytest.raises(SettingsError, match="cross"):
        build_problem(np.ones((1, 1)), one, one, 0 * one)


@settings(max_examples=300, deadline=None)
@given(seed=st.integers(0, 10**6), feasible=st.booleans())
def test_weights_far_apart(seed, feasible):
    """Over six decades; a vertex in the open is left to an active-set method, and proven like the rest."""
    rng = np.random.default_rng(seed)
    problem = random_problem(seed, feasible=feasible)
    n = problem.w.size
    spread = build_problem(problem.B, problem.Q, problem.lb, problem.ub, w=10 ** rng.uniform(-3, 3, n))
    assert spread.optimality_residual(allocate(spread)) < 1e-9


def spread_problem(seed):
    """Weights over 1e+-4: with a joint that no muscle moves, dependent rows, a vertex, a moment out of reach."""
    rng = np.random.default_rng(seed)
    nv, n = int(rng.integers(1, 6)), int(rng.integers(1, 16))
    B = rng.normal(size=(nv, n)) * 10 ** rng.uniform(0, 3)
    if seed % 5 == 0:
        B[0] = 0.0
    if seed % 7 == 0 and nv > 1:
        B[-1] = 2 * B[0]
    lb = rng.uniform(0, 0.5, n)
    ub = lb + rng.uniform(0, 0.5, n)
    Q = B @ (ub if seed % 11 == 0 else rng.uniform(lb, ub))
    if seed % 3 == 0:
        Q = Q + rng.normal(size=nv) * np.abs(B).sum(axis=1)
    return build_problem(B, Q, lb, ub, w=10 ** rng.uniform(-4, 4, n))


SLOPES_CANCEL = (57834, 66057, 94650, 96349)  # what is left of slopes of a 1e8 spread may round to zero
VERTICES = (5203, 18524, 38621, 56712, 70785, 76770, 78906)  # no multiplier in double precision gives the moment
OUT_OF_REACH = (6801, 12252, 34839, 35511, 36522, 45201, 48396, 73512, 91446)  # multipliers of 1e12 cancel


@pytest.mark.parametrize("seed", SLOPES_CANCEL + VERTICES + OUT_OF_REACH)
def test_the_hardest_of_a_hundred_thousand(seed):
    problem = spread_problem(seed)
    found = allocate(problem)
    assert problem.optimality_residual(found) < 1e-9
    if seed % 3:  # the moment can be supplied
        assert np.abs(problem.P @ found.reserve - problem.eps * found.multiplier).max() < 1e-9
        assert np.abs(problem.P @ found.reserve).max() < 1e-6


@settings(max_examples=300, deadline=None)
@given(seed=st.integers(0, 99_999))
def test_weights_over_eight_decades(seed):
    problem = spread_problem(seed)
    assert problem.optimality_residual(allocate(problem)) < 1e-9

"""The allocation against other solvers: every QP back end on recorded problems, scipy where the cost is cubic."""

from dataclasses import replace

import numpy as np
import pytest
import qpsolvers
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear, minimize
from test_allocation import random_problem

import mjhcmc
from mjhcmc import qp_back_ends, sharing
from mjhcmc.allocation import allocate, build_problem
from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.methods import correction

BACK_ENDS = ("daqp", "quadprog", "osqp", "proxqp", "piqp", "clarabel")
BACK_ENDS += ("cvxopt", "kvxopt", "highs", "scs", "qpalm", "pyqpmad")  # no dependencies: tested where installed
SPREAD = 8  # problems of each recording that each back end solves


def needs(solver):
    if solver not in qpsolvers.available_solvers:
        pytest.skip(f"the QP solver {solver} is not installed")


@pytest.fixture(scope="module")
def saturated(leg8):
    """Three times the paper's amplitudes in .25 s: hip flexors and ankle saturate in every cycle."""
    return mjhcmc.Motion.cosine(leg8, amplitudes={"hip": 0.6, "knee": -0.8, "ankle": -0.3}, period=0.25, cycles=1)


def record(method, *args, **kwargs):
    """A solve, and every problem that it allocates."""
    problems = []
    real = sharing.allocate

    def recording(problem, solver="newton"):
        problems.append(problem)
        return real(problem, solver)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sharing, "allocate", recording)
        patch.setattr(correction, "NEWTON", None)  # the compiled way allocates unseen
        return method(*args, **kwargs), problems


@pytest.fixture(scope="module")
def recorded(leg8, slow, fast, saturated):
    """Problems of quadratic cost, (method, motion, reserves) by (method, motion, reserves)."""
    cases = [
        (method, motion, reserves)
        for method in (mjhcmc.hcmc, mjhcmc.cmc, mjhcmc.static_optimization)
        for motion in (replace(slow, span=(0, 0.6)), fast, saturated)
        for reserves in (True, False)
    ]
    return [record(method, leg8, motion, reserves=reserves)[1] for method, motion, reserves in cases]


def test_newton_is_at_the_optimum_of_every_recorded_problem(recorded):
    solved = [(problem, allocate(problem)) for problems in recorded for problem in problems]
    assert len(solved) > 1500
    assert max(problem.optimality_residual(found) for problem, found in solved) < 1e-9
    reserves = [np.abs(problem.P @ found.reserve).max() for problem, found in solved]
    assert sum(r > 1e-2 for r in reserves) > 100  # of the muscles' strength: not only easy ones
    at_bound = [np.sum((f.activation == p.lb) | (f.activation == p.ub)) for p, f in solved]
    assert max(at_bound) >= 7


@pytest.mark.parametrize("solver", BACK_ENDS)
def test_back_ends_agree_on_recorded_problems(recorded, solver):
    needs(solver)
    for problems in recorded:
        for problem in problems[:: max(1, len(problems) // SPREAD)]:
            ours, theirs = allocate(problem), allocate(problem, solver)
            np.testing.assert_allclose(theirs.activation, ours.activation, rtol=0, atol=1e-6)
            np.testing.assert_allclose(problem.P @ (theirs.reserve - ours.reserve), 0, atol=1e-6)


@pytest.fixture(scope="module")
def parts(leg8, fast, saturated):
    """Parts of motions, and what each method finds by our own solver."""
    motions = replace(fast, span=(0, 0.12)), replace(saturated, span=(0, 0.18))
    methods = (mjhcmc.hcmc, mjhcmc.cmc, mjhcmc.static_optimization)
    return {method: [(motion, method(leg8, motion)) for motion in motions] for method in methods}


@pytest.mark.parametrize("method", [mjhcmc.hcmc, mjhcmc.cmc, mjhcmc.static_optimization])
@pytest.mark.parametrize("solver", BACK_ENDS)
def test_a_whole_solve_with_any_back_end_is_the_same(leg8, parts, solver, method):
    needs(solver)
    for motion, ours in parts[method]:
        theirs = method(leg8, motion, solver=solver)
        assert theirs.settings["solver"] == solver
        np.testing.assert_allclose(theirs.activation, ours.activation, rtol=0, atol=1e-6)
        np.testing.assert_allclose(theirs.qpos, ours.qpos, rtol=0, atol=1e-7)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), feasible=st.booleans())
def test_the_proof_tells_a_wrong_answer(seed, feasible):
    """Whatever the reserves: an activation that is off by .01 is not optimal, however its multiplier is chosen."""
    from mjhcmc.allocation import with_multiplier

    problem = random_problem(seed, feasible=feasible)
    right = allocate(problem).activation
    room = np.where(right + 0.01 <= problem.ub, 0.01, np.where(right - 0.01 >= problem.lb, -0.01, 0.0))
    i = int(np.argmax(np.abs(room)))
    if room[i]:
        wrong = right.copy()
        wrong[i] += room[i]
        assert problem.optimality_residual(with_multiplier(problem, wrong)) > 1e-6


@pytest.mark.parametrize("name", ["activation", "reserve", "multiplier"])
def test_the_proof_tells_what_is_not_finite(name):
    problem = random_problem(0, feasible=True)
    found = allocate(problem)
    damaged = replace(found, **{name: np.full_like(getattr(found, name), np.nan)})
    assert problem.optimality_residual(damaged) == np.inf


class Stalls:
    """A back end that stops wherever it likes."""

    def __init__(self, x):
        self.x = x


@pytest.mark.parametrize(("answer", "message"), [(None, "found no optimum"), (0.9, "stopped short of the optimum")])
def test_a_back_end_that_fails_is_not_believed(monkeypatch, answer, message):
    problem = build_problem(np.array([[30.0, 40.0]]), np.array([25.0]), np.zeros(2), np.ones(2))
    monkeypatch.setattr(
        qpsolvers, "solve_problem", lambda p, **_: Stalls(None if answer is None else np.full(len(p.q), answer))
    )
    with pytest.raises(SimulationError, match=rf"'daqp' {message}.*use solver 'newton'"):
        allocate(problem, "daqp")


def test_a_back_end_that_raises_is_no_traceback(monkeypatch):
    def stumbles(*_, **__):
        raise qpsolvers.SolverError("matrix is not positive definite")

    monkeypatch.setattr(qpsolvers, "solve_problem", stumbles)
    problem = build_problem(np.array([[30.0]]), np.array([25.0]), np.zeros(1), np.ones(1))
    with pytest.raises(SimulationError, match=r"'daqp' found no optimum: use solver 'newton'"):
        allocate(problem, "daqp")


def test_names_that_qpsolvers_does_not_tell_how_to_install(monkeypatch):
    monkeypatch.setattr(qpsolvers, "available_solvers", ["daqp"])
    for name, remedy in (
        ("proxqp", r'pip install "qpsolvers\[proxqp\]"'),
        ("cvxopt", r'pip install "qpsolvers\[cvxopt\]"'),
        ("hpipm", "qpsolvers names no package that has it, see its documentation"),
    ):
        with pytest.raises(SettingsError, match=rf"'{name}' is not installed: {remedy}; or choose newton, daqp$"):
            qp_back_ends.check_solver(name)


@pytest.mark.parametrize("solver", ["ecos", "jaxopt_osqp", "qtqp", "sip"])
@pytest.mark.parametrize("installed", [True, False])
def test_a_back_end_that_is_known_to_stop_short_is_refused_and_not_offered(monkeypatch, leg8, fast, solver, installed):
    monkeypatch.setattr(qpsolvers, "available_solvers", ["daqp", *([solver] if installed else [])])
    monkeypatch.setattr(qpsolvers.solvers, f"{solver}_solve_problem", None, raising=False)  # of any version
    message = rf"^QP solver '{solver}' does not find activations to 1e-6: choose newton, daqp$"
    with pytest.raises(SettingsError, match=message):
        mjhcmc.hcmc(leg8, fast, solver=solver, progress=pytest.fail)


def test_what_is_offered_can_be_installed_and_agrees(monkeypatch):
    monkeypatch.setattr(qpsolvers, "available_solvers", ["daqp", "ecos", "gurobi"])
    with pytest.raises(SettingsError, match=r"'simplex'; choose newton, daqp; others can be installed: ") as refusal:
        qp_back_ends.check_solver("simplex")
    offered = str(refusal.value).rpartition(": ")[2].split(", ")
    assert {"quadprog", "osqp", "piqp", "clarabel"} <= set(offered) <= set(BACK_ENDS) - {"daqp"}
    for name in offered:
        with pytest.raises(SettingsError, match=rf'is not installed: pip install "qpsolvers\[{name}\]"; or choose'):
            qp_back_ends.check_solver(name)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda p: Stalls(np.full(len(p.q), 0.5)), r"stopped short of the optimum \(residual .*\)"),
        (lambda p: Stalls(None), "found no optimum"),
        (lambda p: 1 / 0, "found no optimum"),
        (lambda p: {}["no\nlicence"], r"failed \(KeyError: .*licence'\)"),
    ],
)
def test_a_back_end_that_nobody_tried_solves_trial_problems_first(monkeypatch, leg8, fast, answer, message):
    monkeypatch.setattr(qpsolvers, "available_solvers", ["daqp", "gurobi"])
    monkeypatch.setattr(qpsolvers, "solve_problem", lambda problem, **_: answer(problem))
    message = rf"^QP solver 'gurobi' {message} on a small trial problem: choose newton, daqp$"
    with pytest.raises(SettingsError, match=message) as refusal:
        mjhcmc.hcmc(leg8, fast, solver="gurobi", progress=pytest.fail)
    assert "\n" not in str(refusal.value)


def test_one_that_solves_them_is_taken(monkeypatch, leg8, fast):
    real, motion = qpsolvers.solve_problem, replace(fast, span=(0, 0.05))
    monkeypatch.setattr(qpsolvers, "available_solvers", ["daqp", "gurobi"])
    monkeypatch.setattr(qpsolvers, "dense_solvers", ["daqp", "gurobi"])
    monkeypatch.setattr(qpsolvers, "solve_problem", lambda problem, solver: real(problem, solver="daqp"))
    theirs = mjhcmc.hcmc(leg8, motion, solver="gurobi")
    np.testing.assert_allclose(theirs.activation, mjhcmc.hcmc(leg8, motion).activation, rtol=0, atol=1e-6)
    qp_back_ends._try.cache_clear()


# --- the cubic cost -----------------------------------------------------------------------------------------------


def cubed(problem, seed):
    """The problem with a cost sum k a^3 of random k, and without a floor in every other case."""
    n = problem.B.shape[1]
    k = 10 ** np.random.default_rng(seed).uniform(-1, 1, n)
    floor = problem.lb if seed % 2 else 0 * problem.lb
    return build_problem(problem.B, problem.Q, floor, problem.ub, w=1e-8 * k, c=k)


def check_by_scipy(problem):
    """The moments are those nearest to the ones asked for, and no activation gives them at a lower cost.

    Apart, since the price of reserves moves the moments a little: 1e-9 times what the moment costs the muscles.
    """
    found = allocate(problem).activation
    rows, target = problem.P @ problem.B, problem.P @ problem.Q
    gap = np.maximum(problem.ub - problem.lb, 1e-9)
    nearest = lsq_linear(rows, target, (problem.lb, problem.lb + gap), method="bvls", tol=1e-15).x
    np.testing.assert_allclose(rows @ found, rows @ nearest, rtol=0, atol=1e-6)
    w, a0, c = problem.w, problem.a0, problem.c
    cheapest = minimize(
        lambda a: 0.5 * w @ (a - a0) ** 2 + c @ a**3 / 3,
        nearest,
        jac=lambda a: w * (a - a0) + c * a**2,
        bounds=list(zip(problem.lb, problem.ub, strict=True)),
        constraints=_rows(rows, rows @ found),
        method="SLSQP",
        options={"ftol": 1e-16, "maxiter": 1000},
    ).x
    np.testing.assert_allclose(found, cheapest, rtol=0, atol=1e-6)


def _rows(rows, target):
    """Equality constraints that keep only independent rows: SLSQP needs their Jacobian of full rank."""
    u, s, vt = np.linalg.svd(rows, full_matrices=False)
    keep = s > 1e-9 * max(s[0], 1e-300)
    reduced = vt[keep]
    right = (u.T @ target)[keep] / s[keep]
    return {"type": "eq", "fun": lambda a: reduced @ a - right, "jac": lambda _: reduced}


@pytest.mark.parametrize("feasible", [True, False])
@pytest.mark.parametrize("seed", range(16))
def test_cubic_agrees_with_scipy(seed, feasible):
    check_by_scipy(cubed(random_problem(seed, feasible=feasible), seed))


@pytest.mark.parametrize("method", [mjhcmc.hcmc, mjhcmc.cmc])
def test_cubic_agrees_with_scipy_on_recorded_problems(leg8, fast, saturated, method):
    for motion in (fast, saturated):
        _, problems = record(method, leg8, motion, cost="cubic")
        for problem in problems[:: len(problems) // 10]:
            assert problem.optimality_residual(allocate(problem)) < 1e-6
            check_by_scipy(problem)


@settings(max_examples=400, deadline=None)
@given(seed=st.integers(0, 10**6), feasible=st.booleans())
def test_cubic_optimality_conditions(seed, feasible):
    problem = cubed(random_problem(seed, feasible=feasible), seed)
    found = allocate(problem)
    assert problem.optimality_residual(found) < 1e-6
    assert np.all(found.activation >= problem.lb)
    assert np.all(found.activation <= problem.ub)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), spread=st.floats(0, 6), feasible=st.booleans())
def test_weights_of_any_spread_that_is_allowed(seed, spread, feasible):
    plain = random_problem(seed, feasible=feasible)
    w = 10 ** np.random.default_rng(seed).uniform(0, spread, len(plain.lb))
    problem = build_problem(plain.B, plain.Q, plain.lb, plain.ub, w=w)
    assert problem.optimality_residual(allocate(problem)) < 1e-8


def test_a_cubic_cost_with_a_quadratic_part():
    """min w/2 (a - a0)^2 + c/3 a^3 with a prescribed moment gradient: w (a - a0) + c a^2 = B lambda."""
    B, w, c, a0 = np.array([[30.0, 40.0]]), np.array([0.5, 2.0]), np.array([1.0, 3.0]), np.array([0.4, 0.1])
    problem = build_problem(B, np.array([25.0]), np.zeros(2), np.ones(2), w=w, c=c, a0=a0)
    a = allocate(problem).activation
    price = (w * (a - a0) + c * a**2) / B[0]
    assert price[0] == pytest.approx(price[1], rel=1e-6)
    assert B[0] @ a == pytest.approx(25, rel=1e-7)


def test_a_negative_cubic_weight_is_refused():
    one = np.ones(1)
    with pytest.raises(SettingsError, match=r"cubic weights must not be negative; muscle 0 has -1"):
        build_problem(np.ones((1, 1)), one, 0 * one, one, c=-one)
    with pytest.raises(SettingsError, match=r"'daqp' takes quadratic costs only: use solver 'newton' for a cubic cost"):
        allocate(build_problem(np.ones((1, 1)), one, 0 * one, one, c=one), "daqp")

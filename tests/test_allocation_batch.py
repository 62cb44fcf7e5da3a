"""Many allocations at once: proven one by one, compared with other solvers, each on its own."""

from dataclasses import fields, replace

import numpy as np
import pytest
import qpsolvers
from test_allocation import OUT_OF_REACH, VERTICES, spread_problem

from mjhcmc import allocation_hard, qp_back_ends
from mjhcmc.allocation import allocate, build_problem
from mjhcmc.allocation_batch import AllocationBatch, AllocationStatus, allocate_many, build_batch
from mjhcmc.errors import SettingsError, SimulationError

SIZES = [(nv, n, 4125) for nv in (1, 2, 3, 4, 5, 6) for n in (1, 5, 9, 16)] + [(10, 80, 1000)]
KINDS = ("feasible", "vertex", "infeasible")
DAQP_FROM_EACH, QUADPROG_FROM_EACH = 800, 200


def random_batch(seed, nv, n, count, *, decades=4.0, inertia=False):
    """Feasible problems, vertices and infeasible ones in turn; among them still joints, dependent rows.

    Returns the batch, and an activation (count, n) within the bounds from which the moment was made.
    """
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(count, nv, n)) * 10 ** rng.uniform(0, 3, (count, 1, 1))
    B[::5, 0] = 0.0  # a joint that no muscle moves
    B[::7, -1] = 2 * B[::7, 0]  # dependent rows
    lb = rng.uniform(0, 0.5, (count, n))
    ub = lb + rng.uniform(0, 0.5, (count, n))
    made = rng.uniform(lb, ub)
    made[1::3] = ub[1::3]
    Q = (B @ made[..., None])[..., 0]
    Q[2::3] += (rng.normal(size=(count, nv)) * np.abs(B).sum(axis=2))[2::3]
    M = None
    if inertia:
        root = rng.normal(size=(count, nv, nv))
        M = root @ root.transpose(0, 2, 1) + 0.01 * np.eye(nv)
    return build_batch(B, Q, lb, ub, inertia=M, w=10 ** rng.uniform(-decades, decades, (count, n))), made


def rows_and_target(batch):
    return batch.P @ batch.B, np.einsum("bij,bj->bi", batch.P, batch.Q)


def violation(batch, found):
    """(b,) largest violation of the optimality conditions, from their definition and nothing that was reported."""
    if not len(batch):
        return np.zeros(0)
    a, y = found.activation, found.multiplier
    rows, _ = rows_and_target(batch)
    s = batch.Q - np.einsum("bij,bj->bi", batch.B, a)
    outside = np.maximum(batch.lb - a, a - batch.ub).max(axis=1)
    price = np.abs(np.einsum("bij,bj->bi", batch.P, s) - batch.eps[:, None] * y).max(axis=1)
    best = np.clip(batch.a0 + np.einsum("bji,bj->bi", rows, y) / batch.w, batch.lb, batch.ub)
    cancelled = np.einsum("bji,bj->bi", np.abs(rows), np.abs(y)) / batch.w
    stationary = (np.abs(a - best) / (1 + 1e-6 * cancelled)).max(axis=1)
    assert np.abs(s - found.reserve).max() <= 1e-12 * np.abs(batch.Q).max()
    return np.maximum(np.maximum(outside, price), stationary)


def objective(batch, a):
    rows, target = rows_and_target(batch)
    short = target - np.einsum("bij,bj->bi", rows, a)
    return (batch.w * (a - batch.a0) ** 2).sum(axis=1) / 2 + (short**2).sum(axis=1) / (2 * batch.eps)


def test_a_hundred_thousand_problems_are_proven():
    """Weights over 1e+-4, saturated vertices, dependent rows, moments out of reach; nothing left without an answer."""
    solved = 0
    for seed, (nv, n, count) in enumerate(SIZES):
        batch, made = random_batch(seed, nv, n, count, inertia=seed % 2 == 1)
        found = allocate_many(batch)
        assert np.all(found.status <= AllocationStatus.BY_BACK_END)
        assert violation(batch, found).max() <= 1e-9
        assert found.residual.max() <= 1e-9
        # a moment that can be supplied is: at no more than it cost the activation that it was made from
        reachable = np.arange(count) % 3 < 2
        least, known = objective(batch, found.activation)[reachable], objective(batch, made)[reachable]
        assert np.all(least <= known * (1 + 1e-9))
        solved += count
    assert solved == 100_000


def with_reserves(batch, k):
    """Problem k for other solvers: variables sqrt(w) a and the reserves in units that make the Hessian the identity."""
    rows, target = batch.P[k] @ batch.B[k], batch.P[k] @ batch.Q[k]
    root = np.sqrt(batch.w[k])
    return np.hstack([rows / root, np.sqrt(batch.eps[k]) * np.eye(len(target))]), target, root


@pytest.mark.parametrize(("solver", "count"), [("daqp", DAQP_FROM_EACH), ("quadprog", QUADPROG_FROM_EACH)])
def test_other_solvers_find_the_same(solver, count):
    """Called directly, as accurate as they can be. Weights within 1e+-1: beyond, they stop short of the optimum."""
    module = pytest.importorskip(solver)
    gave_up = 0
    for seed, (nv, n, _) in enumerate(SIZES):
        size = count if n < 80 else count // 20
        batch, _ = random_batch(seed + 100, nv, n, size, decades=1.0)
        found = allocate_many(batch).activation
        for k in range(size):
            A, target, root = with_reserves(batch, k)
            H, q = np.eye(n + nv), np.zeros(n + nv)
            low, high = root * batch.lb[k], root * batch.ub[k]
            if solver == "daqp":
                free, sense = np.full(nv, 1e30), np.zeros(n + 2 * nv, dtype=np.int32)
                sense[-nv:] = 5  # equality
                upper, lower = np.concatenate([high, free, target]), np.concatenate([low, -free, target])
                x, _, flag, _ = module.solve(H, q, A, upper, lower, sense, primal_tol=1e-10)
                if flag <= 0 and KINDS[k % 3] == "infeasible":
                    gave_up += 1
                    continue
            else:
                within = np.eye(n, n + nv)
                C, b = np.vstack([A, within, -within]), np.concatenate([target, low, -high])
                x = module.solve_qp(H, q, np.ascontiguousarray(C.T), b, nv)[0]
            reachable = KINDS[k % 3] != "infeasible"
            np.testing.assert_allclose(x[:n] / root, found[k], rtol=0, atol=1e-9 if reachable else 1e-6)
    assert gave_up <= 10  # all of them out of reach, and proven by ours


def same(one, other):
    for field in fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


def part_of(batch, which):
    return AllocationBatch(*(getattr(batch, field.name)[which] for field in fields(batch)))


def test_order_and_chunks_change_nothing():
    batch, _ = random_batch(1, 4, 9, 600)
    whole = allocate_many(batch)
    order = np.random.default_rng(0).permutation(600)
    shuffled = allocate_many(part_of(batch, order))
    same(type(whole)(*(getattr(whole, field.name)[order] for field in fields(whole))), shuffled)
    chunks = [allocate_many(part_of(batch, slice(i, i + 77))) for i in range(0, 600, 77)]
    same(whole, type(whole)(*(np.concatenate([getattr(c, f.name) for c in chunks]) for f in fields(whole))))


@pytest.mark.parametrize(("nv", "n"), [(1, 1), (3, 8), (5, 16), (10, 80)])
@pytest.mark.parametrize("inertia", [True, False])
def test_a_batch_is_the_same_as_one_by_one(nv, n, inertia):
    """Bit for bit, from the building of the problem on."""
    rng = np.random.default_rng(nv)
    batch, _ = random_batch(2, nv, n, 60)
    root = rng.normal(size=(60, nv, nv))
    M = root @ root.transpose(0, 2, 1) + np.eye(nv) if inertia else None
    batch = build_batch(batch.B, batch.Q, batch.lb, batch.ub, inertia=M, w=batch.w, a0=batch.lb / 2)
    found = allocate_many(batch)
    for k in range(60):
        parts = (batch.B[k], batch.Q[k], batch.lb[k], batch.ub[k])
        one = allocate(build_problem(*parts, inertia=None if M is None else M[k], w=batch.w[k], a0=batch.lb[k] / 2))
        np.testing.assert_array_equal(one.activation, found.activation[k])
        np.testing.assert_array_equal(one.reserve, found.reserve[k])
        np.testing.assert_array_equal(one.multiplier, found.multiplier[k])
        assert one.iterations == found.iterations[k]


REFUSED = {("w", -np.inf), ("eps", -np.inf), ("lb", np.inf), ("ub", -np.inf)}  # not positive, or bounds that cross


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", [field.name for field in fields(AllocationBatch)])
def test_a_value_that_is_not_finite_is_one_members_own_status(name, value):
    batch, _ = random_batch(3, 3, 8, 30)
    whole = allocate_many(batch)
    for j in range(getattr(batch, name)[4].size):
        damaged = getattr(batch, name).copy()
        damaged[4:5].reshape(-1)[j] = value
        if (name, value) in REFUSED:
            with pytest.raises(SettingsError, match=r"of problem 4 has"):
                replace(batch, **{name: damaged})
            continue
        found = allocate_many(replace(batch, **{name: damaged}))
        assert found.status[4] == AllocationStatus.NOT_FINITE
        assert np.isnan(found.activation[4]).all()
        assert np.isnan(found.reserve[4]).all()
        others = np.arange(30) != 4
        for field in fields(whole):
            np.testing.assert_array_equal(getattr(found, field.name)[others], getattr(whole, field.name)[others])


def test_products_that_overflow_are_not_finite():
    batch, _ = random_batch(3, 3, 8, 3)
    B = batch.B.copy()
    B[1] = 1e300
    found = allocate_many(replace(batch, B=B, P=1e300 * np.sign(batch.P)))
    assert found.status[1] == AllocationStatus.NOT_FINITE


def test_an_inertia_that_is_not_finite():
    M = np.tile(np.eye(2), (3, 1, 1))
    M[1, 0, 1] = np.nan
    batch = build_batch(np.ones((3, 2, 4)), np.ones((3, 2)), np.zeros(4), np.ones(4), inertia=M)
    assert allocate_many(batch).status.tolist() == [0, 2, 0]
    M[1], M[2] = np.eye(2), -np.eye(2)
    with pytest.raises(SettingsError, match="inertia of problem 2 is not positive definite"):
        build_batch(np.ones((3, 2, 4)), np.ones((3, 2)), np.zeros(4), np.ones(4), inertia=M)


@pytest.mark.parametrize(("nv", "n"), [(3, 8), (6, 16), (10, 80)])
def test_a_warm_start_saves_iterations_and_changes_no_answer(nv, n):
    batch, _ = random_batch(4, nv, n, 300, decades=1.0)
    first = allocate_many(batch)
    step = 1e-2 * np.random.default_rng(0).normal(size=batch.Q.shape) * np.abs(batch.Q)
    later = replace(batch, Q=batch.Q + step)
    cold, warm = allocate_many(later), allocate_many(later, first.multiplier)
    np.testing.assert_allclose(warm.activation, cold.activation, rtol=0, atol=1e-9)
    assert violation(later, warm).max() <= 1e-9
    assert warm.iterations.mean() < 0.7 * cold.iterations.mean()
    again = allocate_many(batch, first.multiplier)
    assert again.iterations.mean() < 0.1 * first.iterations.mean()


@pytest.mark.parametrize("garbage", [np.nan, np.inf, -1e300, 1e12, -1e6, 1.0])
def test_a_bad_warm_start_changes_no_answer(garbage):
    for decades in (1.0, 4.0):
        batch, _ = random_batch(5, 4, 9, 300, decades=decades)
        start = garbage * np.random.default_rng(1).choice([1.0, -1.0, 1e-3], size=batch.Q.shape)
        start[::2, 1:] = 0.0
        found, cold = allocate_many(batch, start), allocate_many(batch)
        assert np.all(found.status <= AllocationStatus.BY_BACK_END)
        assert violation(batch, found).max() <= 1e-9
        if decades == 1.0:
            np.testing.assert_allclose(found.activation, cold.activation, rtol=0, atol=1e-9)
        if not np.isfinite(garbage):
            same(found, cold)


def test_an_empty_batch():
    batch = build_batch(np.ones((0, 3, 8)), np.ones((0, 3)), np.zeros(8), np.ones(8))
    found = allocate_many(batch)
    assert len(batch) == len(found.status) == 0
    assert found.activation.shape == (0, 8)


def test_mismatched_arrays_are_named():
    good = {"B": np.ones((4, 2, 3)), "Q": np.ones((4, 2)), "lb": np.zeros((4, 3)), "ub": np.ones((4, 3))}
    for name, shape in (("Q", (4, 3)), ("Q", (3, 2)), ("lb", (4, 2)), ("ub", (2,)), ("w", (3, 4)), ("a0", (5, 3))):
        with pytest.raises(SettingsError, match=rf"^{name} has shape .*; a batch whose B has shape \(4, 2, 3\) needs"):
            build_batch(**{**good, name: np.ones(shape)})
    with pytest.raises(SettingsError, match=r"^inertia has shape \(3, 3\)"):
        build_batch(**good, inertia=np.eye(3))
    with pytest.raises(SettingsError, match=r"^B of a batch has shape \(2, 3\)"):
        build_batch(**{**good, "B": np.ones((2, 3))})
    with pytest.raises(SettingsError, match=r"^Q of a batch must be an array of numbers"):
        build_batch(**{**good, "Q": [[1, 2], [3]]})
    batch = build_batch(**good)
    with pytest.raises(SettingsError, match=r"^warm_start has shape \(2,\)"):
        allocate_many(batch, np.zeros(2))
    with pytest.raises(SettingsError, match=r"^P has shape \(4, 3, 3\)"):
        replace(batch, P=np.ones((4, 3, 3)))


def test_bad_values_are_named():
    good = {"B": np.ones((4, 2, 3)), "Q": np.ones((4, 2)), "lb": np.zeros((4, 3)), "ub": np.ones((4, 3))}
    w = np.ones((4, 3))
    w[2, 1] = 0.0
    with pytest.raises(SettingsError, match=r"weights must be positive; w of problem 2 has 0 at \[1\]"):
        build_batch(**good, w=w)
    with pytest.raises(SettingsError, match=r"bounds cross, lb - ub; lb - ub of problem 0 has 1 at \[0\]"):
        build_batch(**{**good, "lb": 2 * np.ones((4, 3))})
    for elasticity in (0.0, -1.0):
        with pytest.raises(SettingsError, match="elasticity must be a positive number; got"):
            build_batch(**good, elasticity=elasticity)


# --- what the compiled solver leaves ------------------------------------------------------------------------------


def alone(problem):
    return AllocationBatch(*(np.array(getattr(problem, field.name))[None] for field in fields(AllocationBatch)))


def only(monkeypatch, kind):
    """Let only attempts of one kind be made: by a back end (True), not by one (False), none at all (None)."""
    real = allocation_hard._attempts
    monkeypatch.setattr(allocation_hard, "_attempts", lambda p: ((x, by) for x, by in real(p) if by is kind))


@pytest.fixture(scope="module")
def hard():
    """Problems that the compiled solver leaves unproven, and says so."""
    left = []
    with pytest.MonkeyPatch.context() as patch:
        only(patch, None)
        for seed in VERTICES + OUT_OF_REACH:
            batch = alone(spread_problem(seed))
            found = allocate_many(batch)
            wrong = violation(batch, found)[0]
            assert found.residual[0] == pytest.approx(wrong, rel=1e-3, abs=1e-10)
            assert found.status[0] == (AllocationStatus.SOLVED if wrong <= 1e-9 else AllocationStatus.UNPROVEN)
            if wrong > 1e-9:
                left.append(batch)
    assert len(left) >= 5
    return left


@pytest.mark.parametrize("name", ["none", "daqp", "quadprog"])
def test_hard_ones_are_solved_with_or_without_a_back_end(monkeypatch, hard, name):
    if name != "none" and name not in qpsolvers.available_solvers:
        pytest.skip(f"{name} is not installed")
    only(monkeypatch, name != "none")
    monkeypatch.setattr(qpsolvers, "available_solvers", [name])
    expected = AllocationStatus.SOLVED if name == "none" else AllocationStatus.BY_BACK_END
    for batch in hard:
        found = allocate_many(batch)
        assert found.status[0] == expected
        assert violation(batch, found)[0] <= 1e-9


def test_back_ends_that_answer_nonsense_are_not_believed(monkeypatch, hard):
    only(monkeypatch, True)

    def nonsense(problem, solver):
        yield replace(qp_back_ends.with_multiplier(problem, problem.ub), activation=np.full_like(problem.ub, np.nan))
        yield qp_back_ends.with_multiplier(problem, problem.ub)
        raise SimulationError("no licence")

    monkeypatch.setattr(qp_back_ends, "answers", nonsense)
    monkeypatch.setattr(allocation_hard, "polished", lambda problem, found: found)
    monkeypatch.setattr(allocation_hard, "_back", lambda problem, U, found: replace(found, activation=0 * problem.ub))
    for batch in hard:
        assert allocate_many(batch).status[0] == AllocationStatus.UNPROVEN
        if allocate_many(batch).residual[0] > 1e-7:
            with pytest.raises(SimulationError, match=r"did not settle \(residual .*\): bring weights"):
                allocate(batch.problem(0))


def test_a_status_has_words():
    assert [status.proven for status in AllocationStatus] == [True, True, False, False]
    assert "not proven" in AllocationStatus.UNPROVEN.message
    assert "not finite" in AllocationStatus.NOT_FINITE.message

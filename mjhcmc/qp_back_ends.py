"""The allocation by other solvers, through qpsolvers: to compare with, and to decide where ours is in doubt."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from mjhcmc.allocation import Allocation, AllocationProblem
from mjhcmc.errors import SettingsError, SimulationError

_PROVEN = 1e-4  # optimality residual: s/eps magnifies what a back end leaves
_OPTIONS: dict[str, dict[str, Any]] = {
    "osqp": {"eps_abs": 1e-10, "eps_rel": 1e-10, "polishing": True, "max_iter": 200_000},  # a first-order method
}


def solve_with(problem: AllocationProblem, solver: str) -> Allocation:
    """Solve one problem with a qpsolvers back end, and prove the answer.

    Args:
        problem: see `build_problem`.
        solver: a name that qpsolvers knows.

    Raises:
        SettingsError: no such solver is installed; the message lists those that are.
        SimulationError: the solver found no optimum, or stopped short of it.
    """
    import qpsolvers  # .5 s to import, and only needed here

    if solver not in qpsolvers.available_solvers:
        raise SettingsError(
            f"unknown QP solver {solver!r}; choose newton, {', '.join(sorted(qpsolvers.available_solvers))}"
        )
    best: Allocation | None = None
    for program in _programs(problem, sparse=solver in qpsolvers.sparse_solvers):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the back ends about their own future
            found = qpsolvers.solve_problem(program, solver=solver, **_OPTIONS.get(solver, {}))
        if not found.found or found.x is None:
            continue
        a = np.clip(found.x[: problem.B.shape[1]], problem.lb, problem.ub)
        s = problem.Q - problem.B @ a
        best = Allocation(a, s, problem.P @ s / problem.eps, 0)
        if problem.optimality_residual(best) <= _PROVEN:
            return best
    if best is None:
        raise SimulationError(f"QP solver {solver!r} found no optimum: use solver 'newton'")
    raise SimulationError(
        f"QP solver {solver!r} stopped short of the optimum (residual {problem.optimality_residual(best):.1g}, at most "
        f"{_PROVEN:g}): use solver 'newton'"
    )


def _programs(problem: AllocationProblem, *, sparse: bool) -> Iterator[Any]:
    """The problem in two forms: with the reserves as variables, and with the reserves eliminated.

    The first is the better conditioned; some active-set back ends find no start for it where reserves are large.
    """
    import qpsolvers
    from scipy.sparse import csc_matrix

    nv = len(problem.Q)
    rows, target = problem.P @ problem.B, problem.P @ problem.Q
    root = np.sqrt(problem.eps)  # the reserves are scaled, so that the Hessian has entries of one size
    H = np.diag(np.concatenate([problem.w, np.ones(nv)]))
    q = np.concatenate([-problem.w * problem.a0, np.zeros(nv)])
    A = np.hstack([rows, root * np.eye(nv)])
    lb = np.concatenate([problem.lb, np.full(nv, -np.inf)])
    ub = np.concatenate([problem.ub, np.full(nv, np.inf)])
    form = csc_matrix if sparse else np.asarray
    yield qpsolvers.Problem(form(H), q, A=form(A), b=target, lb=lb, ub=ub)
    H = np.diag(problem.w) + rows.T @ rows / problem.eps
    q = -problem.w * problem.a0 - rows.T @ target / problem.eps
    yield qpsolvers.Problem(form(H), q, lb=problem.lb, ub=problem.ub)

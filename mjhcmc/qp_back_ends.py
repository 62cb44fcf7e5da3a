"""The allocation by other solvers, through qpsolvers: to compare with, and to decide where ours is in doubt."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from importlib.metadata import metadata
from typing import Any

import numpy as np

from mjhcmc.allocation import Allocation, AllocationProblem, with_multiplier
from mjhcmc.errors import SettingsError, SimulationError

NEWTON = "newton"
"""Our own solver, the default."""

_PROVEN = 1e-7  # optimality residual: activations are then right to 1e-6

# Where a back end's defaults are coarser than the allocation wants: tolerances that it can meet.
_OPTIONS: dict[str, dict[str, Any]] = {
    "osqp": {"eps_abs": 1e-10, "eps_rel": 1e-10, "polishing": True, "max_iter": 200_000},  # a first-order method
    "proxqp": {"eps_abs": 1e-10, "eps_rel": 0.0},
    "piqp": {"eps_abs": 1e-10, "eps_rel": 1e-13, "eps_duality_gap_abs": 1e-10, "eps_duality_gap_rel": 1e-13},
    "clarabel": {"tol_gap_abs": 1e-14, "tol_gap_rel": 1e-16, "tol_feas": 1e-11},
}

_EXTRAS = {"jaxopt_osqp": "jaxopt"}  # of qpsolvers, where it goes by another name than the back end


def check_solver(solver: str) -> None:
    """See that a solver is there, before the work begins.

    Args:
        solver: ``"newton"`` or a name that qpsolvers knows.

    Raises:
        SettingsError: an unknown solver (the message lists those installed), or one not installed (it says how).
    """
    if solver == NEWTON:
        return
    import qpsolvers  # .5 s to import, and only needed here

    installed = sorted(qpsolvers.available_solvers)
    if solver in installed:
        return
    names = f"choose {NEWTON}, {', '.join(installed)}"
    others = [name for name in _known() if name not in installed]
    if solver in others:
        raise SettingsError(f"QP solver {solver!r} is not installed: {_how_to_install(solver)}; or {names}")
    raise SettingsError(f"unknown QP solver {solver!r}; {names}; others can be installed: {', '.join(others)}")


def _how_to_install(solver: str) -> str:
    extra = _EXTRAS.get(solver, solver)
    if extra in (metadata("qpsolvers").get_all("Provides-Extra") or []):
        return f"pip install 'qpsolvers[{extra}]'"
    return "no package index has it under a name that qpsolvers tells: see its documentation"


def _known() -> list[str]:
    """The back ends that qpsolvers can call, installed or not."""
    import qpsolvers.solvers

    end = "_solve_problem"
    return sorted(name.removesuffix(end) for name in vars(qpsolvers.solvers) if name.endswith(end))


def solve_with(problem: AllocationProblem, solver: str) -> Allocation:
    """Solve one problem with a qpsolvers back end, and prove the answer.

    Args:
        problem: see `build_problem`.
        solver: a name that qpsolvers knows.

    Raises:
        SettingsError: no such solver is installed (see `check_solver`), or the cost is cubic.
        SimulationError: the solver found no optimum, or stopped short of it.
    """
    check_solver(solver)
    if problem.c.any():
        raise SettingsError(f"QP solver {solver!r} takes quadratic costs only: use solver {NEWTON!r} for a cubic cost")
    import qpsolvers

    best, least = None, np.inf
    for program in _programs(problem, sparse=solver not in qpsolvers.dense_solvers):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the back ends about their own future
            try:
                x = qpsolvers.solve_problem(program, solver=solver, **_OPTIONS.get(solver, {})).x
            except qpsolvers.QPError:
                continue
        if x is None or not np.isfinite(x).all():
            continue
        # whatever the back end thinks of it, the optimality conditions decide
        found = with_multiplier(problem, np.clip(x[: problem.B.shape[1]], problem.lb, problem.ub))
        residual = problem.optimality_residual(found)
        if residual <= _PROVEN:
            return found
        if residual < least:
            best, least = found, residual
    if best is None:
        raise SimulationError(f"QP solver {solver!r} found no optimum: use solver 'newton'")
    raise SimulationError(
        f"QP solver {solver!r} stopped short of the optimum (residual {least:.1g}, at most {_PROVEN:g}): use solver "
        "'newton'"
    )


def _programs(problem: AllocationProblem, *, sparse: bool) -> Iterator[Any]:
    """The problem in three forms: with the reserves as variables, rows scaled in two ways, and without them.

    The first suits active-set methods and interior points that scale by themselves (clarabel); the second those that
    measure rows by an absolute tolerance (proxqp, piqp). The third is the worst conditioned, but any solver finds a
    start for it.
    """
    import qpsolvers
    from scipy.sparse import csc_matrix

    nv = len(problem.Q)
    rows, target = problem.P @ problem.B, problem.P @ problem.Q
    root = np.sqrt(problem.eps)  # the reserves are scaled, so that the Hessian has entries of one size
    form = csc_matrix if sparse else np.asarray
    H = np.diag(np.concatenate([problem.w, np.ones(nv)]))
    q = np.concatenate([-problem.w * problem.a0, np.zeros(nv)])
    A = np.hstack([rows, root * np.eye(nv)])
    lb = np.concatenate([problem.lb, np.full(nv, -np.inf)])
    ub = np.concatenate([problem.ub, np.full(nv, np.inf)])
    for scale in (1.0, 1.0 / root):
        yield qpsolvers.Problem(form(H), q, A=form(scale * A), b=scale * target, lb=lb, ub=ub)
    H = np.diag(problem.w) + rows.T @ rows / problem.eps
    q = -problem.w * problem.a0 - rows.T @ target / problem.eps
    yield qpsolvers.Problem(form(H), q, lb=problem.lb, ub=problem.ub)

"""The allocation by other solvers, through qpsolvers: to compare with, and to decide where ours is in doubt."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Iterator
from importlib.metadata import metadata
from typing import Any

import numpy as np

from mjhcmc.allocation import Allocation, AllocationProblem, build_problem, with_multiplier
from mjhcmc.errors import SettingsError, SimulationError

NEWTON = "newton"
"""Our own solver, the default."""

_PROVEN = 1e-7  # optimality residual: activations are then right to 1e-6

# Of those that agree with ours on recorded problems: tolerances that they can meet, where the defaults are coarser.
_OPTIONS: dict[str, dict[str, Any]] = {
    "daqp": {"primal_tol": 1e-10},
    "quadprog": {},
    "pyqpmad": {},
    "highs": {  # the regularization of its Hessian is an error of the answer
        "primal_feasibility_tolerance": 1e-10,
        "dual_feasibility_tolerance": 1e-10,
        "qp_regularization_value": 0.0,
    },
    "osqp": {"eps_abs": 1e-10, "eps_rel": 1e-10, "polishing": True, "max_iter": 200_000},  # a first-order method
    "proxqp": {"eps_abs": 1e-10, "eps_rel": 0.0},
    "piqp": {"eps_abs": 1e-10, "eps_rel": 1e-13, "eps_duality_gap_abs": 1e-10, "eps_duality_gap_rel": 1e-13},
    "clarabel": {"tol_gap_abs": 1e-14, "tol_gap_rel": 1e-16, "tol_feas": 1e-11},
    "cvxopt": {"abstol": 1e-13, "reltol": 1e-13, "feastol": 1e-13, "refinement": 2, "maxiters": 200},
    "kvxopt": {"abstol": 1e-13, "reltol": 1e-13, "feastol": 1e-13, "refinement": 2, "maxiters": 200},
    "scs": {"eps_abs": 1e-11, "eps_rel": 1e-11, "max_iters": 200_000},  # a first-order method
    "qpalm": {"eps_abs": 1e-10, "eps_rel": 0.0, "eps_abs_in": 1.0, "max_iter": 10_000},
}

_UNITS = {"highs": 1e-2}  # of activation, for a back end that takes bounds close together for one

# Those that no option makes agree on all of them: ecos (a cone program with the cost's square root), jaxopt_osqp
# (single precision), qtqp and sip (interior points that stop early).
_INEXACT = frozenset({"ecos", "jaxopt_osqp", "qtqp", "sip"})


def check_solver(solver: str) -> None:
    """See that a solver is there and accurate enough, before the work begins; it solves a few small problems.

    Args:
        solver: ``"newton"`` or a name that qpsolvers knows.

    Raises:
        SettingsError: an unknown solver (the message lists those that are installed and accurate enough), one not
            installed (it says how), or one that does not find activations to 1e-6.
    """
    if solver != NEWTON:
        _check_name(solver)
        _try(solver)


def _check_name(solver: str) -> None:
    """Raise SettingsError unless a back end is installed and not known to be inaccurate."""
    import qpsolvers  # .5 s to import, and only needed here

    if solver in _INEXACT and solver in _known():
        raise SettingsError(f"QP solver {solver!r} does not find activations to 1e-6: {_choices()}")
    if solver in qpsolvers.available_solvers:
        return
    if solver in _known():
        raise SettingsError(f"QP solver {solver!r} is not installed: {_how_to_install(solver)}; or {_choices()}")
    others = [name for name in sorted(_OPTIONS) if name in _known() and name not in qpsolvers.available_solvers]
    more = f"; others can be installed: {', '.join(others)}" if others else ""
    raise SettingsError(f"unknown QP solver {solver!r}; {_choices()}{more}")


def _choices() -> str:
    import qpsolvers

    return f"choose {', '.join([NEWTON, *sorted(_OPTIONS.keys() & set(qpsolvers.available_solvers))])}"


@functools.cache  # of those that pass: an exception is not kept
def _try(solver: str) -> None:
    """Raise SettingsError unless a back end solves small problems like those of a leg."""
    for problem in _trials():
        try:
            _solve(problem, solver)
        except SimulationError as error:
            told = str(error).partition(": use solver")[0]
            raise SettingsError(f"{told} on a small trial problem: {_choices()}") from None


def _trials() -> Iterator[AllocationProblem]:
    """A moment within reach, one beyond it, and one beyond what the next window can do: hip, knee, ankle."""
    B = np.array([[80, -120, 40, -70, 0, 0, 0, 0], [0, 0, 50, -50, 210, -40, 0, 0], [0, 0, 0, 0, 0, -70, -150, 40.0]])
    M = np.array([[2.5, 0.7, 0.1], [0.7, 0.5, 0.08], [0.1, 0.08, 0.05]])
    for Q, low, high in (([30, 20, -15], 0.0, 1.0), ([-150, 200, -230], 0.0, 1.0), ([90, -80, 60], 0.2, 0.3)):
        yield build_problem(B, np.array(Q, dtype=float), np.full(8, low), np.full(8, high), inertia=M)


def _how_to_install(solver: str) -> str:
    if solver in (metadata("qpsolvers").get_all("Provides-Extra") or []):
        return f'pip install "qpsolvers[{solver}]"'
    return "qpsolvers names no package that has it, see its documentation"


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
    _check_name(solver)
    if problem.c.any():
        raise SettingsError(f"QP solver {solver!r} takes quadratic costs only: use solver {NEWTON!r} for a cubic cost")
    return _solve(problem, solver)


def _solve(problem: AllocationProblem, solver: str) -> Allocation:
    best, least = None, np.inf
    for found in answers(problem, solver):
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


def answers(problem: AllocationProblem, solver: str) -> Iterator[Allocation]:
    """What an installed back end answers to the problem in one form after another; the optimality conditions decide.

    Raises:
        SimulationError: the back end fails in a way of its own, for example without a licence.
    """
    import qpsolvers

    n, unit = len(problem.w), _UNITS.get(solver, 1.0)
    for units, program in _programs(problem, unit, sparse=solver not in qpsolvers.dense_solvers):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the back ends about their own future
            try:
                x = qpsolvers.solve_problem(program, solver=solver, **_OPTIONS.get(solver, {})).x
            except (qpsolvers.QPError, ArithmeticError, ValueError):  # the last two come from cvxopt
                continue
            except Exception as error:  # a back end's own: no licence, options that its version does not know
                told = " ".join(f"{type(error).__name__}: {error}".split())
                raise SimulationError(f"QP solver {solver!r} failed ({told}): use solver {NEWTON!r}") from error
        if x is not None and np.isfinite(x).all():
            yield with_multiplier(problem, np.clip((units * x)[:n], problem.lb, problem.ub))


def _programs(problem: AllocationProblem, unit: float, *, sparse: bool) -> Iterator[tuple[Any, Any]]:
    """The problem in four forms: with the reserves as variables, scaled in three ways, and without them.

    Each with its units: activations and reserves are units times its variables.

    The first suits active-set methods and interior points that scale by themselves (clarabel); the second those that
    measure rows by an absolute tolerance (proxqp, piqp). The third is the worst conditioned, but any solver finds a
    start for it. The last, whose Hessian has entries of one size, is for weights far apart.
    """
    import qpsolvers
    from scipy.sparse import csc_matrix

    nv = len(problem.Q)
    rows, target = problem.P @ problem.B, problem.P @ problem.Q
    root = np.sqrt(problem.eps)  # the reserves are scaled, so that the Hessian has entries of one size
    form = csc_matrix if sparse else np.asarray
    diagonal = np.concatenate([problem.w, np.ones(nv)])
    q = np.concatenate([-problem.w * problem.a0, np.zeros(nv)])
    A = np.hstack([rows, root * np.eye(nv)])
    lb = np.concatenate([problem.lb, np.full(nv, -np.inf)])
    ub = np.concatenate([problem.ub, np.full(nv, np.inf)])

    def with_reserves(units: Any, scale: float) -> tuple[Any, Any]:
        H = form(np.diag(units**2 * diagonal))
        return units, qpsolvers.Problem(
            H, units * q, A=form(scale * A * units), b=scale * target, lb=lb / units, ub=ub / units
        )

    even, n = np.full(len(q), unit), len(problem.w)
    yield with_reserves(even, 1.0)
    yield with_reserves(even, 1.0 / root)
    H = np.diag(problem.w) + rows.T @ rows / problem.eps
    reduced = -problem.w * problem.a0 - rows.T @ target / problem.eps
    yield even[:n], qpsolvers.Problem(form(unit**2 * H), unit * reduced, lb=problem.lb / unit, ub=problem.ub / unit)
    yield with_reserves(unit / np.sqrt(diagonal), 1.0)

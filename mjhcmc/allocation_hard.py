"""The few allocations that the compiled solver leaves unproven: rows turned, continuation, then other solvers.

Weights over many decades, dependent rows, moments exactly at the limit of the muscles.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mjhcmc.allocation import Allocation, AllocationProblem, polished, settled
from mjhcmc.allocation_kernels import newton
from mjhcmc.allocation_proof import PROVEN
from mjhcmc.errors import SimulationError

_BACK_ENDS = ("daqp", "quadprog")  # active-set methods; the second where it is installed
_DECADES = 8  # of elasticity, which continuation goes down
_NO_ROW = 1e-15  # of the muscles' strength: what is left of a row that depends on others

Array = NDArray[np.float64]


def decide(problem: AllocationProblem, found: Allocation, residual: float) -> tuple[Allocation, float, bool]:
    """Try harder, until the residual is proven: the best allocation, its residual, whether a back end found it.

    Args:
        problem: one of quadratic cost.
        found: what the compiled solver found.
        residual: of it; not finite where a value of the problem is not.
    """
    best, least, handed = found, residual, False
    if not np.isfinite(problem.P @ problem.B).all():
        return found, residual, False
    with np.errstate(all="ignore"):  # what overflows is not proven
        for attempt, by_back_end in _attempts(problem):
            missed = problem.optimality_residual(attempt)
            if missed < least:
                best, least, handed = attempt, missed, by_back_end
            if least <= PROVEN:
                break
    return best, least, handed


def _attempts(problem: AllocationProblem) -> Iterator[tuple[Allocation, bool]]:
    """Allocations to choose from, and whether each is a back end's, dearer and dearer."""
    turned, U = _turned(problem)
    yield _back(problem, U, settled(turned)[0]), False
    yield _back(problem, U, settled(turned, _continued(turned))[0]), False
    import qpsolvers

    from mjhcmc.qp_back_ends import answers

    for name in _BACK_ENDS:
        if name in qpsolvers.available_solvers:
            with suppress(SimulationError):  # not this one: the next, or the status tells
                for answer in answers(problem, name):
                    yield answer, True
                    yield polished(problem, answer), True
                    yield _back(problem, U, settled(turned, U.T @ answer.multiplier)[0]), True


def _turned(problem: AllocationProblem) -> tuple[AllocationProblem, Array]:
    """The problem with orthogonal combinations U^T P B of its rows, the strongest first; and U.

    |P s| stays. Dependent rows become rows of zeros, whose price no longer hides that of the others.
    """
    rows, target = problem.P @ problem.B, problem.P @ problem.Q
    U = np.linalg.svd(rows / np.sqrt(problem.w))[0]
    turned = U.T @ rows
    turned[np.abs(turned) < _NO_ROW] = 0.0
    return replace(problem, B=turned, Q=U.T @ target, P=np.eye(len(target))), U


def _back(problem: AllocationProblem, U: Array, found: Allocation) -> Allocation:
    a = found.activation
    return Allocation(a, problem.Q - problem.B @ a, U @ found.multiplier, found.iterations)


def _continued(turned: AllocationProblem) -> Array:
    """(nv,) multiplier at the end of a path from cheap reserves to dear ones, each solution the next one's start."""
    nv, n = turned.B.shape
    y, a = np.zeros(nv), np.empty(n)
    bounds = np.ascontiguousarray(turned.lb), np.ascontiguousarray(turned.ub)
    for decade in range(_DECADES, 0, -1):
        eps = turned.eps * 10.0**decade
        newton(turned.B, turned.Q, *bounds, turned.w, turned.a0, eps, y, a)
    return y

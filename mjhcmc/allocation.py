"""The allocation of joint moments to muscles: one small convex program per window.

    minimize    sum_i [w_i/2 (a_i - a0_i)^2 + c_i/3 a_i^3] + |P s|^2/(2 eps)
    subject to  B a + s = Q,   0 <= lb <= a <= ub

B (nv, n_muscle) are the joint moments at full activation, s the reserves, P what makes reserves comparable. The dual
of the rows P (B a + s) = P Q has nv unknowns lambda; for fixed lambda, P s = eps lambda and each a_i has a closed form,
without a cubic cost a = clip(a0 + (P B)^T lambda/w, lb, ub). What remains is a monotone equation, piecewise linear
without a cubic cost. It is solved by a semismooth Newton method with an exact line search (Qi & Sun 1993,
doi 10.1007/BF01581275), which then ends after finitely many steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjhcmc.allocation_kernels import newton, newton_cubic
from mjhcmc.allocation_proof import CANCELLATION, INFEASIBLE, PROVEN, settle
from mjhcmc.errors import SettingsError, SimulationError

ELASTICITY = 1e-9
"""Price of reserves: the whole strength of the muscles taken over by reserves costs 1/(2 ELASTICITY) mean weights."""

_USABLE = 1e-7  # optimality residual: activations are then right to 1e-6
_PROVEN_CUBIC = 1e-6  # near 0 a cubic cost answers to the price of a moment like a square root
_NOT_FINITE = "the allocation holds a value that is not finite: the simulation has diverged"
_POLISHING_STEPS = 20
_POLISHED = 1e-14
_NO_STRENGTH = 1e-9  # N m: a joint that no muscle moves
_AT_BOUND = 1e-7  # of activation: nearer, a muscle counts as held by its bound


@dataclass(frozen=True)
class Allocation:
    """What the allocation found, with what proves it.

    Attributes:
        activation: (n_muscle,) within the bounds.
        reserve: (nv,) N m or N, the part of Q that the muscles do not give: s = Q - B a.
        multiplier: (nv,) lambda, of the rows multiplied by P.
        iterations: Newton steps taken; 0 for a qpsolvers back end.
    """

    activation: NDArray[np.float64]
    reserve: NDArray[np.float64]
    multiplier: NDArray[np.float64]
    iterations: int


@dataclass(frozen=True)
class AllocationProblem:
    """One problem; see the module's docstring for the equation.

    Attributes:
        B: (nv, n_muscle) N m at full activation.
        Q: (nv,) N m that activation should supply.
        lb: (n_muscle,) lowest activation that can be reached.
        ub: (n_muscle,) highest activation that can be reached.
        w: (n_muscle,) weights, positive.
        a0: (n_muscle,) preferred activation.
        c: (n_muscle,) coefficients of the cubic cost, 0 or positive.
        P: (nv, nv) 1/(N m), what reserves are multiplied by before they are priced.
        eps: price of a reserve, see the equation.
    """

    B: NDArray[np.float64]
    Q: NDArray[np.float64]
    lb: NDArray[np.float64]
    ub: NDArray[np.float64]
    w: NDArray[np.float64]
    a0: NDArray[np.float64]
    c: NDArray[np.float64]
    P: NDArray[np.float64]
    eps: float

    def optimality_residual(self, solution: Allocation) -> float:
        """The largest violation of the optimality conditions, each on its own scale.

        Zero at the optimum: bounds, P (B a + s - Q) = 0, P s = eps lambda, a = clip(a - g/(w + c), lb, ub) with
        g = w (a - a0) + c a^2 - (P B)^T lambda. Infinite where anything is not finite.
        """
        a, s, y = solution.activation, solution.reserve, solution.multiplier
        rows = self.P @ self.B
        bounds = max(0.0, float(np.max(self.lb - a)), float(np.max(a - self.ub)))
        balance = float(np.max(np.abs(rows @ a + self.P @ (s - self.Q))))
        price = float(np.max(np.abs(self.P @ s - self.eps * y)))
        scale = self.w + self.c
        descent = (self.w * self.a0 + self.c * a * (1 - a) + rows.T @ y) / scale  # a - g/scale
        rounding = 1.0 + CANCELLATION * (np.abs(rows).T @ np.abs(y) / scale)  # where reserves are large
        stationary = float(np.max(np.abs(a - np.clip(descent, self.lb, self.ub)) / rounding))
        worst = float(np.max([bounds, balance, price, stationary]))
        return np.inf if np.isnan(worst) else worst


def build_problem(
    B: NDArray[np.float64],
    Q: NDArray[np.float64],
    lb: NDArray[np.float64],
    ub: NDArray[np.float64],
    *,
    inertia: NDArray[np.float64] | None = None,
    w: NDArray[np.float64] | None = None,
    a0: NDArray[np.float64] | None = None,
    c: NDArray[np.float64] | None = None,
    elasticity: float = ELASTICITY,
) -> AllocationProblem:
    """Put a problem together; the default cost is effort, sum a^2, with equal weights.

    With an inertia M, reserves are priced by s^T M^-1 s, the size of the accelerations that they are worth, whatever
    the units of the joints (Gauss's principle of least constraint). With M diagonal, each joint pays for its own.
    Without, each joint's reserve is priced against the joint's own strength.

    Args:
        B: (nv, n_muscle) N m at full activation.
        Q: (nv,) N m.
        lb: (n_muscle,) lower bounds.
        ub: (n_muscle,) upper bounds.
        inertia: (nv, nv) kg m^2, the mass matrix or its diagonal.
        w: (n_muscle,) weights; 1 by default.
        a0: (n_muscle,) preferred activation; 0 by default.
        c: (n_muscle,) coefficients of the cubic cost; 0 by default.
        elasticity: small number, see `ELASTICITY`.

    Raises:
        SettingsError: a weight that is not positive, or bounds that cross.
    """
    n = B.shape[1]
    weights = np.ones(n) if w is None else np.asarray(w, dtype=np.float64)
    if not np.all(weights > 0):
        raise SettingsError(f"weights must be positive; muscle {int(np.argmin(weights))} has {weights.min():g}")
    cubic = np.zeros(n) if c is None else np.asarray(c, dtype=np.float64)
    if not np.all(cubic >= 0):
        raise SettingsError(f"cubic weights must not be negative; muscle {int(np.argmin(cubic))} has {cubic.min():g}")
    if np.any(lb > ub):
        i = int(np.argmax(lb - ub))
        raise SettingsError(f"bounds of muscle {i} cross: {lb[i]:g} > {ub[i]:g}")
    return AllocationProblem(
        B=np.ascontiguousarray(B, dtype=np.float64),
        Q=np.asarray(Q, dtype=np.float64),
        lb=np.asarray(lb, dtype=np.float64),
        ub=np.asarray(ub, dtype=np.float64),
        w=weights,
        a0=np.zeros(n) if a0 is None else np.asarray(a0, dtype=np.float64),
        c=cubic,
        P=comparable(B, inertia),
        eps=elasticity / float((weights + cubic).mean()),
    )


def comparable(B: NDArray[np.float64], inertia: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """(..., nv, nv) P of `AllocationProblem`: the rows of P B have sums of absolute values about 1."""
    nv = B.shape[-2]
    if inertia is None:
        strength = np.abs(B).sum(axis=-1)
        return np.eye(nv) / np.where(strength > _NO_STRENGTH, strength, 1.0)[..., None]
    whitened = np.linalg.inv(np.linalg.cholesky(inertia))
    reach = np.abs(whitened @ B).sum(axis=-1).max(axis=-1, initial=0.0)
    return np.asarray(whitened / np.where(reach > _NO_STRENGTH, reach, 1.0)[..., None, None])


def allocate(problem: AllocationProblem, solver: str = "newton") -> Allocation:
    """Solve one problem.

    Args:
        problem: see `build_problem`.
        solver: ``"newton"`` (ours) or the name of an installed qpsolvers back end, for example ``"daqp"``.

    Raises:
        SettingsError: an unknown solver, one that is not installed, or a back end for a cubic cost.
        SimulationError: the problem holds a value that is not finite, or the solver did not find the optimum.
    """
    parts = (problem.B, problem.Q, problem.lb, problem.ub, problem.w, problem.a0, problem.c, problem.P)
    if not all(np.isfinite(part).all() for part in parts):
        raise SimulationError(_NOT_FINITE)
    if solver != "newton":
        from mjhcmc.qp_back_ends import solve_with

        return solve_with(problem, solver)
    if problem.c.any():
        return _allocate_cubic(problem)
    found, residual = settled(problem)
    if np.isnan(residual):  # products that overflow
        raise SimulationError(_NOT_FINITE)
    if residual > PROVEN:
        from mjhcmc.allocation_hard import decide

        found, residual, _ = decide(problem, found, residual)
    if residual > _USABLE:
        raise SimulationError(
            f"the allocation did not settle (residual {residual:.1g}): bring weights and joint moments closer together"
        )
    return found


def settled(problem: AllocationProblem, multiplier: NDArray[np.float64] | None = None) -> tuple[Allocation, float]:
    """What the compiled solver finds for a quadratic cost, and the residual that it proves, NaN if not finite.

    Args:
        problem: one problem.
        multiplier: (nv,) to start from.
    """
    parts = (problem.B, problem.Q, problem.lb, problem.ub, problem.w, problem.a0, problem.P)
    B, Q, lb, ub, w, a0, P = (np.require(part, np.float64, ("C", "W")) for part in parts)
    eps, a = float(problem.eps), np.zeros_like(w)
    y = np.zeros_like(Q) if multiplier is None else np.array(multiplier, dtype=np.float64)
    many_rows, many_target = rows_of(P[None], B[None], Q[None])
    rows, target = many_rows[0], many_target[0]
    if multiplier is None:  # most end here, and spare the first call the time to compile the rest
        iterations = newton(rows, target, lb, ub, w, a0, eps, y, a)
        reserve = reserves_of(B[None], Q[None], a[None])[0]
        priced = P @ reserve
        missed = float(np.abs(priced - eps * y).max(initial=0.0))  # a is stationary to the last bit
        if iterations >= 0 and missed <= 0.5 * PROVEN and np.abs(priced).max(initial=0.0) <= INFEASIBLE:
            return Allocation(a, reserve, y, iterations), missed
        y = np.zeros_like(Q)
    iterations, residual = settle(rows, target, lb, ub, w, a0, eps, y, a)
    return Allocation(a, reserves_of(B[None], Q[None], a[None])[0], y, iterations), residual


def rows_of(
    P: NDArray[np.float64], B: NDArray[np.float64], Q: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """P B (b, nv, n_muscle) and P Q (b, nv)."""
    with np.errstate(all="ignore"):  # what overflows is found later
        return P @ B, (P @ Q[..., None])[..., 0]


def reserves_of(B: NDArray[np.float64], Q: NDArray[np.float64], a: NDArray[np.float64]) -> NDArray[np.float64]:
    """Q - B a (b, nv)."""
    with np.errstate(all="ignore"):
        return np.asarray(Q - (B @ a[..., None])[..., 0])


def _allocate_cubic(problem: AllocationProblem) -> Allocation:
    rows, target = problem.P @ problem.B, problem.P @ problem.Q
    a, y, iterations = newton_cubic(rows, target, problem.lb, problem.ub, problem.w, problem.a0, problem.c, problem.eps)
    found = Allocation(a, problem.Q - problem.B @ a, y, abs(iterations))
    large = np.abs(problem.P @ found.reserve).max(initial=0.0) > INFEASIBLE
    if large or (iterations < 0 and problem.optimality_residual(found) > _PROVEN_CUBIC):
        found = polished(problem, found)
    if iterations < 0 and problem.optimality_residual(found) > _PROVEN_CUBIC:
        raise SimulationError(
            f"the allocation with a cubic cost did not settle (residual {problem.optimality_residual(found):.1g}): "
            "use a quadratic cost"
        )
    return found


def polished(problem: AllocationProblem, found: Allocation) -> Allocation:
    """The same optimum to full precision where reserves are large: least squares over the muscles between bounds.

    There lambda = P s/eps is huge and a free activation is the small difference of large terms. A cubic cost takes a
    few Newton steps of it, a quadratic one a single step.
    """
    a = found.activation.copy()
    free = (a > problem.lb) & (a < problem.ub)
    rows, root_eps = problem.P @ problem.B, np.sqrt(problem.eps)
    w, a0, c, low, high = (part[free] for part in (problem.w, problem.a0, problem.c, problem.lb, problem.ub))
    for _ in range(_POLISHING_STEPS if c.any() else 1):
        if not free.any():
            break
        x = a[free]
        root = np.sqrt(w + 2 * c * x)  # of the cost's second derivative
        system = np.vstack([np.diag(root), rows[:, free] / root_eps])
        gradient = w * (x - a0) + c * x**2
        rest = problem.P @ problem.Q - rows @ a
        step = np.linalg.lstsq(system, np.concatenate([-gradient / root, rest / root_eps]))[0]
        a[free] = np.clip(x + step, low, high)
        if np.abs(step).max() < _POLISHED:
            break
    return with_multiplier(problem, a, found.iterations)


def with_multiplier(problem: AllocationProblem, activation: NDArray[np.float64], iterations: int = 0) -> Allocation:
    """The allocation that activation (n_muscle,) within its bounds stands for, with the lambda that proves it best.

    lambda = P s/eps magnifies the rounding of s; it is moved by as little as makes the muscles between their bounds
    stationary. If no such lambda is near, the residuals tell.
    """
    a, rows = activation, problem.P @ problem.B
    s = problem.Q - problem.B @ a
    y = problem.P @ s / problem.eps
    free = (a > problem.lb + _AT_BOUND) & (a < problem.ub - _AT_BOUND)
    if free.any():
        gradient = problem.w * (a - problem.a0) + problem.c * a**2 - rows.T @ y
        y = y + np.linalg.lstsq(rows[:, free].T, gradient[free])[0]
    return Allocation(a, s, y, iterations)

"""The allocation of joint moments to muscles: one small convex quadratic program per window.

    minimize    1/2 sum_i w_i (a_i - a0_i)^2 + |P s|^2/(2 eps)
    subject to  B a + s = Q,   lb <= a <= ub

B (nv, n_muscle) are the joint moments at full activation, s the reserves, P what makes reserves comparable. The dual
of the rows P (B a + s) = P Q has nv unknowns lambda; for fixed lambda, a = clip(a0 + (P B)^T lambda/w, lb, ub) and
P s = eps lambda, so what remains is a piecewise linear, monotone equation. It is solved by a semismooth Newton method
with an exact line search (Qi & Sun 1993, doi 10.1007/BF01581275), which ends after finitely many steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError, SimulationError

ELASTICITY = 1e-9
"""Price of reserves: the whole strength of the muscles taken over by reserves costs 1/(2 ELASTICITY) mean weights."""

_ITERATIONS = 200
_TOLERANCE = 1e-11
_PROVEN = 1e-9
_ROUNDING = 1e-15
_INFEASIBLE = 1e-6  # reserves above this share of the muscles' strength are more than the elasticity
_NO_STRENGTH = 1e-9  # N m: a joint that no muscle moves


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
        P: (nv, nv) 1/(N m), what reserves are multiplied by before they are priced.
        eps: price of a reserve, see the equation.
    """

    B: NDArray[np.float64]
    Q: NDArray[np.float64]
    lb: NDArray[np.float64]
    ub: NDArray[np.float64]
    w: NDArray[np.float64]
    a0: NDArray[np.float64]
    P: NDArray[np.float64]
    eps: float

    def optimality_residual(self, solution: Allocation) -> float:
        """The largest violation of the optimality conditions, each on its own scale.

        Zero at the optimum: bounds, P (B a + s - Q) = 0, P s = eps lambda, a = clip(a0 + (P B)^T lambda/w, lb, ub).
        """
        a, s, y = solution.activation, solution.reserve, solution.multiplier
        rows = self.P @ self.B
        bounds = max(0.0, float(np.max(self.lb - a)), float(np.max(a - self.ub)))
        balance = float(np.max(np.abs(rows @ a + self.P @ (s - self.Q))))
        price = float(np.max(np.abs(self.P @ s - self.eps * y)))
        pull = self.a0 + rows.T @ y / self.w
        rounding = 1.0 + np.abs(rows).T @ np.abs(y) / self.w  # cancellation where reserves are large
        stationary = float(np.max(np.abs(a - np.clip(pull, self.lb, self.ub)) / rounding))
        return max(bounds, balance, price, stationary)


def build_problem(
    B: NDArray[np.float64],
    Q: NDArray[np.float64],
    lb: NDArray[np.float64],
    ub: NDArray[np.float64],
    *,
    inertia: NDArray[np.float64] | None = None,
    w: NDArray[np.float64] | None = None,
    a0: NDArray[np.float64] | None = None,
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
        elasticity: small number, see `ELASTICITY`.

    Raises:
        SettingsError: a weight that is not positive, or bounds that cross.
    """
    n = B.shape[1]
    weights = np.ones(n) if w is None else np.asarray(w, dtype=np.float64)
    if not np.all(weights > 0):
        raise SettingsError(f"weights must be positive; muscle {int(np.argmin(weights))} has {weights.min():g}")
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
        P=_comparable(B, inertia),
        eps=elasticity / float(weights.mean()),
    )


def _comparable(B: NDArray[np.float64], inertia: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """(nv, nv) P of `AllocationProblem`: the rows of P B have sums of absolute values about 1."""
    if inertia is None:
        strength = np.abs(B).sum(axis=1)
        return np.diag(1.0 / np.where(strength > _NO_STRENGTH, strength, 1.0))
    whitened = np.linalg.inv(np.linalg.cholesky(inertia))
    strength = float(np.abs(whitened @ B).sum(axis=1).max())
    return whitened / (strength if strength > _NO_STRENGTH else 1.0)


def allocate(problem: AllocationProblem, solver: str = "newton") -> Allocation:
    """Solve one problem.

    Args:
        problem: see `build_problem`.
        solver: ``"newton"`` (ours) or the name of an installed qpsolvers back end, for example ``"daqp"``.

    Raises:
        SettingsError: an unknown solver.
        SimulationError: the problem holds a value that is not finite, or the solver did not find the optimum.
    """
    parts = (problem.B, problem.Q, problem.lb, problem.ub, problem.w, problem.a0, problem.P)
    if not all(np.isfinite(part).all() for part in parts):
        raise SimulationError("the allocation holds a value that is not finite: the simulation has diverged")
    if solver != "newton":
        from mjhcmc.qp_back_ends import solve_with

        return solve_with(problem, solver)
    rows = problem.P @ problem.B
    a, y, iterations = _newton(rows, problem.P @ problem.Q, problem.lb, problem.ub, problem.w, problem.a0, problem.eps)
    s = problem.Q - problem.B @ a
    found = Allocation(a, s, y, abs(iterations))
    if np.abs(problem.P @ s).max(initial=0.0) > _INFEASIBLE:
        found = _polished(problem, found)
    if iterations < 0 and problem.optimality_residual(found) > _PROVEN:
        from mjhcmc.qp_back_ends import solve_with

        return solve_with(problem, "daqp")  # rounding on a hard vertex: an active-set method decides
    return found


def _polished(problem: AllocationProblem, found: Allocation) -> Allocation:
    """The same optimum to full precision where reserves are large: least squares over the muscles between bounds.

    There lambda = P s/eps is huge and a free activation is the small difference of large terms.
    """
    a = found.activation
    free = (a > problem.lb) & (a < problem.ub)
    rows, root_w, root_eps = problem.P @ problem.B, np.sqrt(problem.w), np.sqrt(problem.eps)
    if free.any():
        rest = problem.P @ problem.Q - rows[:, ~free] @ a[~free]
        system = np.vstack([np.diag(root_w[free]), rows[:, free] / root_eps])
        target = np.concatenate([root_w[free] * problem.a0[free], rest / root_eps])
        a = a.copy()
        a[free] = np.linalg.lstsq(system, target)[0]
        a = np.clip(a, problem.lb, problem.ub)
    s = problem.Q - problem.B @ a
    return Allocation(a, s, problem.P @ s / problem.eps, found.iterations)


@numba.njit(cache=True)
def _newton(B, Q, lb, ub, w, a0, eps):  # type: ignore[no-untyped-def]
    """Dual Newton on the rows P B, P Q: returns a, lambda, iterations (negative where it did not settle)."""
    nv, n = B.shape
    y = np.zeros(nv)
    a = np.empty(n)
    z = np.empty(n)  # unclipped activation
    dz = np.empty(n)
    r = np.empty(nv)
    H = np.empty((nv, nv))
    d = np.empty(nv)
    breaks = np.empty(2 * n)
    slopes = np.empty(2 * n)
    size_Q = 1.0
    for j in range(nv):
        size_Q = max(size_Q, abs(Q[j]))
    last_worst = np.inf
    for iteration in range(_ITERATIONS):
        for i in range(n):
            pull = 0.0
            for j in range(nv):
                pull += B[j, i] * y[j]
            z[i] = a0[i] + pull / w[i]
            a[i] = min(ub[i], max(lb[i], z[i]))
        worst = 0.0
        rounding = 0.0  # where reserves are large, so is y, and B^T y cancels
        for j in range(nv):
            r[j] = Q[j] - eps * y[j]
            noise = 0.0
            for i in range(n):
                r[j] -= B[j, i] * a[i]
                if lb[i] < z[i] < ub[i]:
                    for k in range(nv):
                        noise += abs(B[j, i] * B[k, i] * y[k]) / w[i]
            worst = max(worst, abs(r[j]))
            rounding = max(rounding, _ROUNDING * noise)
        if worst <= _TOLERANCE * size_Q:
            return a, y, iteration
        if worst <= rounding and worst > 0.5 * last_worst:  # as far as rounding lets it: to be proven
            return a, y, -iteration - 1
        last_worst = worst
        for j in range(nv):
            for k in range(j + 1):
                H[j, k] = 0.0
                for i in range(n):
                    if lb[i] < z[i] < ub[i]:
                        H[j, k] += B[j, i] * B[k, i] / w[i]
            H[j, j] += eps
            d[j] = r[j]
        _cholesky_solve(H, d)
        # exact line search: d^T r(y + t d) is decreasing and piecewise linear in t
        value, slope = 0.0, 0.0
        for j in range(nv):
            value += d[j] * r[j]
            slope -= eps * d[j] * d[j]
        count = 0
        for i in range(n):
            pull = 0.0
            for j in range(nv):
                pull += B[j, i] * d[j]
            dz[i] = pull / w[i]
            if dz[i] == 0.0:
                continue
            change = w[i] * dz[i] * dz[i]
            first = (lb[i] - z[i]) / dz[i] if dz[i] > 0.0 else (ub[i] - z[i]) / dz[i]  # becomes free
            last = (ub[i] - z[i]) / dz[i] if dz[i] > 0.0 else (lb[i] - z[i]) / dz[i]  # is clipped again
            if first <= 0.0 < last:
                slope -= change
            elif first > 0.0:
                breaks[count], slopes[count] = first, -change
                count += 1
            if last > 0.0:
                breaks[count], slopes[count] = last, change
                count += 1
        order = np.argsort(breaks[:count])
        t = 0.0
        for k in range(count):
            at = breaks[order[k]]
            next_value = value + slope * (at - t)
            if next_value <= 0.0:
                break
            value, t = next_value, at
            slope += slopes[order[k]]
        t -= value / slope
        if not t > 0.0:
            return a, y, -iteration - 1
        for j in range(nv):
            y[j] += t * d[j]
    return a, y, -_ITERATIONS


@numba.njit(cache=True)
def _cholesky_solve(H, d):  # type: ignore[no-untyped-def]
    """Solve H x = d in place for a positive definite H given by its lower triangle."""
    n = d.size
    for j in range(n):
        for k in range(j + 1):
            total = H[j, k]
            for i in range(k):
                total -= H[j, i] * H[k, i]
            H[j, k] = np.sqrt(total) if j == k else total / H[k, k]
    for j in range(n):
        for i in range(j):
            d[j] -= H[j, i] * d[i]
        d[j] /= H[j, j]
    for j in range(n - 1, -1, -1):
        for i in range(j + 1, n):
            d[j] -= H[i, j] * d[i]
        d[j] /= H[j, j]

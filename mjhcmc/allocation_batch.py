"""Many allocations at once, in compiled code: the same answers as one by one, with a status for each.

    batch = build_batch(B, Q, lb, ub, inertia=M)
    found = allocate_many(batch)
    found = allocate_many(next_batch, found.multiplier)    # warm start

The equation is that of `allocation`, with a quadratic cost.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.allocation import ELASTICITY, Allocation, AllocationProblem, comparable, reserves_of, rows_of
from mjhcmc.allocation_hard import decide
from mjhcmc.allocation_proof import PROVEN, settle_many
from mjhcmc.checks import is_number
from mjhcmc.errors import SettingsError

Array = NDArray[np.float64]


class AllocationStatus(IntEnum):
    """How one allocation of a batch ended."""

    SOLVED = 0
    BY_BACK_END = 1
    NOT_FINITE = 2
    UNPROVEN = 3

    @property
    def proven(self) -> bool:
        """Whether the allocation meets the optimality conditions."""
        return self <= AllocationStatus.BY_BACK_END

    @property
    def message(self) -> str:
        """What it means, in words."""
        return _MESSAGES[self]


_MESSAGES = {
    AllocationStatus.SOLVED: f"proven optimal, to {PROVEN:g}",
    AllocationStatus.BY_BACK_END: f"proven optimal, to {PROVEN:g}, with the help of another solver",
    AllocationStatus.NOT_FINITE: "the problem holds a value that is not finite: the simulation has diverged",
    AllocationStatus.UNPROVEN: "not proven optimal by any solver: bring weights and joint moments closer together",
}


@dataclass(frozen=True, eq=False)
class AllocationBatch:
    """Problems of one size; `build_batch` fills in the defaults.

    Attributes:
        B: (b, nv, n_muscle) N m at full activation.
        Q: (b, nv) N m that activation should supply.
        lb: (b, n_muscle) lowest activation that can be reached.
        ub: (b, n_muscle) highest.
        w: (b, n_muscle) weights, positive.
        a0: (b, n_muscle) preferred activation.
        P: (b, nv, nv) 1/(N m), what reserves are multiplied by before they are priced.
        eps: (b,) price of a reserve, positive.

    Raises:
        SettingsError: an array of the wrong shape, a weight or price that is not positive, or bounds that cross.
    """

    B: Array
    Q: Array
    lb: Array
    ub: Array
    w: Array
    a0: Array
    P: Array
    eps: Array

    def __post_init__(self) -> None:
        """Check the arrays."""
        for field in fields(self):
            object.__setattr__(self, field.name, _numbers(field.name, getattr(self, field.name)))
        if self.B.ndim != 3:
            raise SettingsError(f"B of a batch has shape {self.B.shape}: it must be (problems, joints, muscles)")
        b, nv, n = self.B.shape
        by_muscle = dict.fromkeys(("lb", "ub", "w", "a0"), (b, n))
        for name, shape in {"Q": (b, nv), **by_muscle, "P": (b, nv, nv), "eps": (b,)}.items():
            _check_shape(name, getattr(self, name), shape, self.B.shape)
        _refuse("weights must be positive", "w", self.w, self.w <= 0)  # NaN passes, to be one member's status
        _refuse("the price of reserves must be positive", "eps", self.eps, self.eps <= 0)
        _refuse("bounds cross, lb - ub", "lb - ub", self.lb - self.ub, self.lb > self.ub)

    def __len__(self) -> int:
        """Number of problems."""
        return len(self.B)

    def of(self, which: NDArray[np.bool_]) -> AllocationBatch:
        """Some of the problems."""
        return AllocationBatch(*(getattr(self, field.name)[which] for field in fields(self)))

    def problem(self, k: int) -> AllocationProblem:
        """Member k by itself."""
        return AllocationProblem(
            B=self.B[k],
            Q=self.Q[k],
            lb=self.lb[k],
            ub=self.ub[k],
            w=self.w[k],
            a0=self.a0[k],
            c=np.zeros_like(self.w[k]),
            P=self.P[k],
            eps=float(self.eps[k]),
        )


@dataclass(frozen=True, eq=False)
class Allocations:
    """What a batch of allocations found.

    Attributes:
        activation: (b, n_muscle) within the bounds; NaN where the problem is not finite.
        reserve: (b, nv) N m or N, s = Q - B a.
        multiplier: (b, nv) lambda, of the rows multiplied by P; a warm start for problems like these.
        status: (b,) of `AllocationStatus`.
        iterations: (b,) Newton steps taken; 0 for a back end.
        residual: (b,) of the optimality conditions, as `AllocationProblem.optimality_residual`.
    """

    activation: Array
    reserve: Array
    multiplier: Array
    status: NDArray[np.int64]
    iterations: NDArray[np.int64]
    residual: Array


def build_batch(
    B: ArrayLike,
    Q: ArrayLike,
    lb: ArrayLike,
    ub: ArrayLike,
    *,
    inertia: ArrayLike | None = None,
    w: ArrayLike | None = None,
    a0: ArrayLike | None = None,
    elasticity: float = ELASTICITY,
) -> AllocationBatch:
    """Put a batch together; each member is that of `allocation.build_problem`, to the last bit.

    Args:
        B: (b, nv, n_muscle) N m at full activation.
        Q: (b, nv) N m.
        lb: (b, n_muscle) lower bounds, or (n_muscle,) of every problem; so for ub, w and a0.
        ub: (b, n_muscle) upper bounds.
        inertia: (b, nv, nv) kg m^2, or (nv, nv) of every problem.
        w: (b, n_muscle) weights; 1 by default.
        a0: (b, n_muscle) preferred activation; 0 by default.
        elasticity: small number, see `allocation.ELASTICITY`.

    Raises:
        SettingsError: an array of the wrong shape, a weight that is not positive, bounds that cross, or an inertia
            that is not positive definite.
    """
    if not (is_number(elasticity) and 0 < elasticity < np.inf):
        raise SettingsError(f"elasticity must be a positive number; got {elasticity!r}")
    moments = _numbers("B", B)
    if moments.ndim != 3:
        raise SettingsError(f"B of a batch has shape {moments.shape}: it must be (problems, joints, muscles)")
    b, nv, n = moments.shape
    weights = _of_all("w", 1.0 if w is None else w, (b, n), moments.shape)
    _refuse("weights must be positive", "w", weights, weights <= 0)
    return AllocationBatch(
        B=moments,
        Q=_numbers("Q", Q),
        lb=_of_all("lb", lb, (b, n), moments.shape),
        ub=_of_all("ub", ub, (b, n), moments.shape),
        w=weights,
        a0=_of_all("a0", 0.0 if a0 is None else a0, (b, n), moments.shape),
        P=_prices(moments, None if inertia is None else _of_all("inertia", inertia, (b, nv, nv), moments.shape)),
        eps=elasticity / weights.mean(axis=1) if n else np.full(b, elasticity),
    )


def allocate_many(batch: AllocationBatch, warm_start: ArrayLike | None = None) -> Allocations:
    """Solve every problem of a batch, with proof; nothing that one member holds changes another's answer.

    Args:
        batch: see `build_batch`.
        warm_start: (b, nv) multipliers to start from. They change the time that it takes, not the answer beyond
            what the proof allows; what is not finite counts as zeros.

    Raises:
        SettingsError: a warm start of the wrong shape.
    """
    b, nv, n = batch.B.shape
    y = np.zeros((b, nv)) if warm_start is None else _numbers("warm_start", warm_start).copy()
    _check_shape("warm_start", y, (b, nv), batch.B.shape)
    a, iterations, residual = np.empty((b, n)), np.empty(b, dtype=np.int64), np.empty(b)
    rows, target = rows_of(batch.P, batch.B, batch.Q)
    settle_many(rows, target, batch.lb, batch.ub, batch.w, batch.a0, batch.eps, y, a, iterations, residual)
    lost = np.isnan(residual)
    a[lost] = np.nan
    y[lost] = np.nan
    s = reserves_of(batch.B, batch.Q, a)
    status = np.where(residual <= PROVEN, AllocationStatus.SOLVED, AllocationStatus.UNPROVEN).astype(np.int64)
    status[lost] = AllocationStatus.NOT_FINITE
    for k in np.flatnonzero(status == AllocationStatus.UNPROVEN):
        found = Allocation(a[k], s[k], y[k], int(iterations[k]))
        found, residual[k], by_back_end = decide(batch.problem(int(k)), found, float(residual[k]))
        a[k], s[k], y[k], iterations[k] = found.activation, found.reserve, found.multiplier, found.iterations
        if residual[k] <= PROVEN:
            status[k] = AllocationStatus.BY_BACK_END if by_back_end else AllocationStatus.SOLVED
    return Allocations(a, s, y, status, iterations, residual)


def _numbers(name: str, value: ArrayLike) -> Array:
    try:
        return np.require(value, np.float64, ("C", "W"))  # each other kind of array is compiled for anew
    except (TypeError, ValueError):
        raise SettingsError(f"{name} of a batch must be an array of numbers; got {type(value).__name__}") from None


def _of_all(name: str, value: ArrayLike, shape: tuple[int, ...], size: tuple[int, ...]) -> Array:
    """The array of every member, from one that may be the same for all."""
    array = _numbers(name, value)
    if array.ndim == 0 or array.shape == shape[1:]:
        return np.broadcast_to(array, shape)
    _check_shape(name, array, shape, size)
    return array


def _check_shape(name: str, array: Array, shape: tuple[int, ...], size: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise SettingsError(f"{name} has shape {array.shape}; a batch whose B has shape {size} needs {shape}")


def _refuse(rule: str, name: str, values: Array, bad: NDArray[np.bool_]) -> None:
    if bad.any():
        at = tuple(int(i) for i in np.argwhere(bad)[0])
        raise SettingsError(f"{rule}; {name} of problem {at[0]} has {values[at]:g} at {list(at[1:])}")


def _prices(B: Array, inertia: Array | None) -> Array:
    """(b, nv, nv) P, as `allocation.build_problem`; NaN where an inertia is not finite."""
    if inertia is None:
        return comparable(B, None)
    finite = np.asarray(np.isfinite(inertia).all(axis=(1, 2)))
    usable = np.where(finite[:, None, None], inertia, np.eye(B.shape[1]))
    try:
        P = comparable(B, usable)
    except np.linalg.LinAlgError:
        k = next(k for k, M in enumerate(usable) if not np.linalg.eigvalsh(M)[0] > 0)
        raise SettingsError(f"inertia of problem {k} is not positive definite: give the mass matrix") from None
    return np.where(finite[:, None, None], P, np.nan)

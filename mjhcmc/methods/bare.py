"""Degrees of freedom that no muscle moves, such as a tracked root: what holds them is no muscle's business.

Their reserves s_r are whatever keeps them on the motion, and are taken out of the equations before muscles share:
with A da + T ds = w, rows r and the others m, and X = T_mr T_rr^-1,

    (A_m - X A_r) da + (T_mm - X T_rm) ds_m = w_m - X w_r,    ds_r = T_rr^-1 (w_r - A_r da - T_rm ds_m)

Left in, reserves of other joints would be used beside them: what is priced is T s, and T is not diagonal.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mjhcmc.methods.trial import Trial

Array = NDArray[np.float64]
Which = NDArray[np.bool_]


def without_bare(bare: Which, trial: Trial, answers: Array, wanted: Array) -> tuple[Trial, tuple[Array, Array]]:
    """The trial of the others, with their answers (b, m, n + m) and what is wanted (b, m).

    Args:
        bare: (nv,) True where no muscle acts.
        trial: of all.
        answers: (b, nv, n + nv), [A T].
        wanted: (b, nv).
    """
    n, m = trial.B.shape[2], ~bare
    A, T = answers[:, :, :n], answers[:, :, n:]
    X = np.swapaxes(np.linalg.solve(np.swapaxes(_of(T, bare, bare), 1, 2), np.swapaxes(_of(T, m, bare), 1, 2)), 1, 2)
    own = np.concatenate([A[:, m] - X @ A[:, bare], _of(T, m, m) - X @ _of(T, bare, m)], axis=2)
    left = wanted[:, m] - (X @ wanted[:, bare, None])[:, :, 0]
    rest = trial._replace(
        reserve=_whole(trial.reserve[:, m]), missing=_whole(trial.missing[:, m]), M=_whole(_of(trial.M, m, m)),
        B=_whole(trial.B[:, m]), D=_whole(_of(trial.D, m, m)), K=_whole(_of(trial.K, m, m)),
        kp=_whole(trial.kp[:, m]), kv=_whole(trial.kv[:, m]),
    )  # fmt: skip
    return rest, (_whole(own), _whole(left))


def program_of(trial: Trial, answers: Array, wanted: Array) -> tuple[Array, Array, Array]:
    """Answers, wanted, and Q = B a + T s at the trial's end."""
    n = trial.B.shape[2]
    Q = trial.B @ trial.activation[:, :, None] + answers[:, :, n:] @ trial.reserve[:, :, None]
    return answers, wanted, _whole(Q[:, :, 0])


def reserve_of_bare(bare: Which, trial: Trial, answers: Array, wanted: Array, goal: Array, reserve: Array) -> Array:
    """(b, r) N m, the reserves of those that no muscle moves, when the others have theirs (b, m)."""
    n, m = trial.B.shape[2], ~bare
    rows = answers[:, bare]
    change = rows[:, :, :n] @ (goal - trial.activation)[:, :, None]
    change += rows[:, :, n:][:, :, m] @ (reserve - trial.reserve[:, m])[:, :, None]
    step = np.linalg.solve(rows[:, :, n:][:, :, bare], wanted[:, bare, None] - change)
    return np.asarray(trial.reserve[:, bare] + step[:, :, 0])


def _of(matrix: Array, rows: Which, columns: Which) -> Array:
    return matrix[:, rows][:, :, columns]


def _whole(values: Array) -> Array:
    return np.ascontiguousarray(values)

"""Intervals on excitations where muscle parameters are known only so well: by Monte Carlo, and to first order.

Each draw multiplies the parameters of every muscle by log-normal factors (see `spread`) and solves the motion again.
Beside it stands the first-order (delta) method, from the gradient g = du/dln(parameter) of the unchanged muscles, for
factors of standard deviation s, correlated by r between the muscles,

    sd(u)^2 = sum over kinds of (1 - r) sum_i (g_i s_i)^2 + r (sum_i g_i s_i)^2

which is right where the excitation is a straight line over the spread: not where it meets 0 or 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.checks import is_number
from mjhcmc.emg_targets import EmgTargets
from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.gradients.gradient import Gradient, gradient
from mjhcmc.gradients.spread import Spread, draw_factors, spreads, typical
from mjhcmc.io.files import write_csv
from mjhcmc.methods.hcmc_batch import hcmc_batch
from mjhcmc.methods.run import Progress
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.muscle_parameters import muscle_parameters, parameter_fields
from mjhcmc.solution import RESERVE_SHARE, Solution, moment_scale

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

_AT_BOUND = 1e-9  # of excitation


@dataclass(frozen=True, eq=False)
class Intervals:
    """Excitations of n draws of the muscles' parameters, in N windows, and what follows.

    Attributes:
        time: (N+1,) s.
        muscle_names: (n_muscle,).
        kinds: of `mjhcmc.muscle_parameters.KINDS`, those that are drawn.
        spread: (n_kind, n_muscle) relative standard deviations.
        correlation: r.
        seed: of the draws.
        levels: of `low` and `high`.
        factors: (n, n_kind, n_muscle) that the parameters were multiplied by.
        solved: (m,) numbers of the draws that could be solved.
        failed: why the others could not, by number.
        excitation: (m, N, n_muscle) of those solved, as all that follows.
        median: (N, n_muscle).
        low: (N, n_muscle) quantile of the lower level.
        high: (N, n_muscle) of the upper level.
        mean: (N, n_muscle).
        sd: (N, n_muscle).
        at_bound: (N, n_muscle) share of the draws whose excitation is at an end of its range.
        reserve_share: (m,) each draw's largest reserve, as a share of the joint's peak net moment.
        nominal: (N, n_muscle) excitation of the unchanged muscles; NaN where there is no gradient.
        first_order_sd: (N, n_muscle) by the delta method; NaN likewise.
        settings: of the solutions: model, motion, dt and more.
    """

    time: Array
    muscle_names: tuple[str, ...]
    kinds: tuple[str, ...]
    spread: Array
    correlation: float
    seed: int
    levels: tuple[float, float]
    factors: Array = field(repr=False)
    solved: NDArray[np.intp] = field(repr=False)
    failed: Mapping[int, str]
    excitation: Array = field(repr=False)
    median: Array = field(repr=False)
    low: Array = field(repr=False)
    high: Array = field(repr=False)
    mean: Array = field(repr=False)
    sd: Array = field(repr=False)
    at_bound: Array = field(repr=False)
    reserve_share: Array = field(repr=False)
    nominal: Array = field(repr=False)
    first_order_sd: Array = field(repr=False)
    settings: Mapping[str, Any] = field(repr=False)

    @property
    def n(self) -> int:
        """Draws, with those that failed."""
        return len(self.factors)

    @property
    def width(self) -> Array:
        """(n_muscle,) mean over the windows of high less low."""
        return np.asarray((self.high - self.low).mean(axis=0))

    @property
    def clipped(self) -> Array:
        """(n_muscle,) share of the windows in which some of the draws, not all, are at a bound."""
        return np.asarray(((self.at_bound > 0) & (self.at_bound < 1)).mean(axis=0))

    @property
    def ratio(self) -> Array:
        """(n_muscle,) first-order sd over Monte Carlo's, root mean squares over all windows; NaN where none moves."""
        return _ratio(self.first_order_sd, self.sd, np.ones(self.sd.shape, dtype=bool))

    @property
    def ratio_inside(self) -> Array:
        """(n_muscle,) the same over the windows in which no draw is at a bound; NaN where there are none."""
        return _ratio(self.first_order_sd, self.sd, self.at_bound == 0)

    @property
    def helped(self) -> int:
        """Draws in which a reserve had to help: their muscles cannot follow alone."""
        return int(np.count_nonzero(self.reserve_share > RESERVE_SHARE))

    def to_dataframe(self) -> pd.DataFrame:
        """A row a window: start and end of it, s, then median/MUSCLE, low, high, mean, sd, first_order_sd, at_bound."""
        import pandas as pd

        columns: dict[str, Any] = {"start": self.time[:-1], "end": self.time[1:]}
        for block in ("nominal", "median", "low", "high", "mean", "sd", "first_order_sd", "at_bound"):
            values = getattr(self, block)
            columns |= {f"{block}/{name}": values[:, j] for j, name in enumerate(self.muscle_names)}
        return pd.DataFrame(columns)

    def save(self, path: str | Path) -> Path:
        """Write `to_dataframe` as a .csv file, whole or not at all.

        Raises:
            OutputError: the folder does not exist or cannot be written.
        """
        return write_csv(self.to_dataframe(), Path(path))

    def numbers(self) -> dict[str, Any]:
        """What a person asks for first, for JSON; a number that is none is None."""
        values = {
            "width": self.width, "sd": _rms(self.sd), "first_order_sd": _rms(self.first_order_sd), "ratio": self.ratio,
            "ratio_inside": self.ratio_inside, "clipped": self.clipped,
        }  # fmt: skip
        return {
            "draws": self.n,
            "failed": {str(i): why for i, why in self.failed.items()},
            "levels": list(self.levels),
            "seed": self.seed,
            "correlation": self.correlation,
            "spread": {
                kind: dict(zip(self.muscle_names, row, strict=True))
                for kind, row in zip(self.kinds, self.spread.tolist(), strict=True)
            },
            "peak_reserve_share": float(self.reserve_share.max()),
            "draws_helped_by_reserves": self.helped,
            "muscles": {
                name: {key: _or_none(value[j]) for key, value in values.items()}
                for j, name in enumerate(self.muscle_names)
            },
        }


def intervals(
    model: MuscleModel,
    motion: Motion,
    sd: Mapping[str, Spread] | None = None,
    n: int = 200,
    seed: int = 0,
    levels: Sequence[float] = (0.05, 0.95),
    *,
    correlation: float = 0.0,
    dt: float = 0.01,
    physics_dt: float = 0.001,
    initial_qpos: ArrayLike | None = None,
    initial_qvel: ArrayLike | None = None,
    initial_activation: ArrayLike | None = None,
    cost: str = "effort",
    weights: Mapping[str, float] | ArrayLike | None = None,
    smoothness: float = 0.0,
    min_activation: Mapping[str, float] | ArrayLike = 0.0,
    disabled: Sequence[str] = (),
    emg: EmgTargets | None = None,
    gain: float = 2.7,
    authority: float = 0.15,
    trials: int = 8,
    tolerance: float = 1e-3,
    first_order: Gradient | bool = True,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Intervals:
    """Draw the muscles' parameters n times, solve the motion with each, and sum up; beside it the delta method.

    The draws of a seed are always the same: more of them go on where fewer end, and neither the number of threads nor
    the kinds that are drawn change another kind's.

    Args:
        model: the model, with MuJoCo's muscles.
        motion: to follow.
        sd: relative standard deviations by kind of parameter (of `mjhcmc.muscle_parameters.KINDS`): one number for all
            muscles, (n_muscle,), or by muscle name (0 for the others); kinds left out are known. `TYPICAL`.
        n: draws, 2 or more.
        seed: 0 or more.
        levels: of the interval's ends.
        correlation: r, 0: muscles vary on their own, 1: all muscles' parameters of a kind by one common z.
        dt: as `hcmc`, and so the rest but for what follows.
        physics_dt: see there.
        initial_qpos: see there.
        initial_qvel: see there.
        initial_activation: see there.
        cost: see there.
        weights: see there.
        smoothness: see there.
        min_activation: see there.
        disabled: see there.
        emg: see there.
        gain: see there.
        authority: see there.
        trials: see there; more than its own default, with less tolerance: near the converged answer that the gradient
            is of.
        tolerance: see there.
        first_order: the gradient of the same solution where it is known already; False: no delta method, for models
            and costs that have no gradient.
        threads: as `hcmc_batch`.
        progress: see there.

    Returns:
        See `Intervals`; a draw that cannot be solved is named in it and in a warning, and left out of the rest.

    Raises:
        SettingsError: an unknown kind or muscle, a standard deviation that is not within 0 .. 1, nothing that varies, n
            below 2, or a gradient of something else; else as `hcmc_batch` and `gradient`.
        MjhcmcError: as `hcmc_batch`; where fewer than two draws can be solved, the first one's.
    """
    kinds, spread = spreads(model, typical(model) if sd is None else sd)
    low, high = _levels(levels)
    if not (is_number(correlation) and 0 <= correlation <= 1):
        raise SettingsError(f"correlation must be a number within 0 .. 1; got {correlation!r}")
    now = muscle_parameters(model)
    factors = draw_factors(spread, kinds, n, seed, correlation)
    start: dict[str, Any] = {
        "dt": dt, "physics_dt": physics_dt, "initial_qpos": initial_qpos, "initial_qvel": initial_qvel,
        "initial_activation": initial_activation,
    }  # fmt: skip
    choices: dict[str, Any] = {
        "cost": cost, "weights": weights, "smoothness": smoothness, "min_activation": min_activation,
        "disabled": disabled, "emg": emg, "gain": gain, "authority": authority,
    }  # fmt: skip
    linear: Gradient | None = None
    if isinstance(first_order, Gradient):
        linear = first_order
    elif not isinstance(first_order, bool):
        raise SettingsError(f"first_order must be a Gradient, True or False; got {first_order!r:.60}")
    elif first_order:
        linear = gradient(model, motion, **start, **choices, parameters=kinds, threads=threads or 1)
    if linear is not None:
        _check_gradient(linear, kinds, model)
    values = {kind: now[kind] * factors[:, i] for i, kind in enumerate(kinds)}
    batch = hcmc_batch(
        model, motion, **start, **choices, parameters=parameter_fields(model, values), trials=trials,
        tolerance=tolerance, threads=threads, progress=progress,
    )  # fmt: skip
    if len(batch.solved) < 2:
        raise SimulationError(f"too few draws can be solved for an interval: {batch.failures}; give a smaller sd")
    solved = sorted(batch.solved)
    solutions = [batch.solved[i] for i in solved]
    excitation = np.stack([solution.excitation for solution in solutions])
    one = solutions[0]
    if linear is not None and not _alike(linear.solution, one):
        raise SettingsError("first_order is the gradient of another motion or settings: leave it out, or give the same")
    lower, middle, upper = np.quantile(excitation, (low, 0.5, high), axis=0)
    bottom, top = model.excitation_range.T
    at_bound = (excitation <= bottom + _AT_BOUND) | (excitation >= top - _AT_BOUND)
    none = np.full(middle.shape, np.nan)
    return Intervals(
        one.time, model.muscle_names, kinds, spread, float(correlation), int(seed), (low, high), factors,
        np.array(solved, dtype=np.intp), {i: str(error) for i, error in sorted(batch.errors.items())}, excitation,
        middle, lower, upper, excitation.mean(axis=0), excitation.std(axis=0, ddof=1), at_bound.mean(axis=0),
        np.array([_reserve_share(solution) for solution in solutions]),
        none if linear is None else linear.solution.excitation,
        none if linear is None else first_order_sd(linear, dict(zip(kinds, spread, strict=True)), correlation),
        {key: value for key, value in one.settings.items() if key in ("method", "model", "motion", "dt", "physics_dt")},
    )  # fmt: skip


def first_order_sd(gradient: Gradient, sd: Mapping[str, ArrayLike], correlation: float = 0.0) -> Array:
    """(N, n_muscle) standard deviation of each excitation by the delta method; see the module's docstring.

    Args:
        gradient: with the parameters that vary.
        sd: relative standard deviations by kind: one number or (n_muscle,).
        correlation: r, 0 .. 1.

    Raises:
        SettingsError: the gradient lacks a parameter.
    """
    muscles = gradient.solution.muscle_names
    relative, variance = gradient.relative, np.zeros(gradient.excitation.shape[:2])
    for kind, given in sd.items():
        names = [f"{kind}/{muscle}" for muscle in muscles]
        missing = [name for name in names if name not in gradient.names]
        if missing:
            raise SettingsError(f"the gradient has no parameter {missing[0]!r}: compute it with parameters={[*sd]}")
        moves = relative[:, :, [gradient.names.index(name) for name in names]] * np.asarray(given, dtype=np.float64)
        variance += (1 - correlation) * (moves**2).sum(axis=2) + correlation * moves.sum(axis=2) ** 2
    return np.asarray(np.sqrt(variance))


def _levels(levels: Sequence[float]) -> tuple[float, float]:
    try:
        low, high = levels
    except (TypeError, ValueError):
        low = high = math.nan
    if not (is_number(low) and is_number(high) and 0 < low < high < 1):
        raise SettingsError(f"levels must be two numbers, 0 < low < high < 1, such as (.05, .95); got {levels!r}")
    return float(low), float(high)


def _check_gradient(found: Gradient, kinds: Sequence[str], model: MuscleModel) -> None:
    missing = [f"{k}/{m}" for k in kinds for m in model.muscle_names if f"{k}/{m}" not in found.names]
    if missing:
        raise SettingsError(f"first_order lacks the parameter {missing[0]!r}: give a gradient by {', '.join(kinds)}")
    now = muscle_parameters(model)
    own = np.concatenate([[found.values[found.names.index(f"{k}/{m}")] for m in model.muscle_names] for k in kinds])
    if not np.array_equal(own, np.concatenate([now[kind] for kind in kinds])):
        raise SettingsError("first_order is the gradient of a model with other muscles: leave it out, or give the same")


def _alike(one: Solution, other: Solution) -> bool:
    if one.qpos_desired.shape != other.qpos_desired.shape:
        return False
    keys = set(one.settings) - {"trials", "tolerance"}  # converged, and nearly so
    same = all(str(one.settings[key]) == str(other.settings.get(key)) for key in keys)
    return same and bool(np.allclose(one.time, other.time)) and np.array_equal(one.qpos_desired, other.qpos_desired)


def _reserve_share(solution: Solution) -> float:
    return float((np.abs(solution.reserve).max(axis=0) / moment_scale(solution.net_joint_moment)).max())


def _ratio(first_order: Array, sd: Array, where: NDArray[np.bool_]) -> Array:
    weight = where.astype(np.float64)
    top, bottom = (first_order**2 * weight).sum(axis=0), (sd**2 * weight).sum(axis=0)
    return np.asarray(np.sqrt(np.where(bottom > 0, top / np.where(bottom > 0, bottom, 1.0), np.nan)))


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None

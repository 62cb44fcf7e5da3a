"""Muscle parameters from what was measured: by excitations through HCMC, or by joint moments under known activation.

Both are nonlinear least squares with exact Jacobians, in the logarithms x of the parameters over their start,

    minimize  sum ((measured - model(x))/sd)^2 + sum (x/prior)^2

by a trust-region form of Levenberg's and Marquardt's method (scipy's ``least_squares``; Branch, Coleman & Li 1999,
doi 10.1137/S1064827595289108). What the data do not tell is left to the prior, and its standard error says so.

`calibrate` finds the parameters whose HCMC excitations are those measured (EMG that follows a maximal contraction).
`calibrate_moments` finds those whose muscles give the joint moments measured, under activation that is known, as in
EMG-driven models (Lloyd & Besier 2003, doi 10.1016/S0021-9290(03)00010-1).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from mjhcmc.checks import is_number
from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError, SimulationError
from mjhcmc.gradients.along import damping_of, damping_slopes
from mjhcmc.gradients.gradient import gradient_batch
from mjhcmc.gradients.looks import Looker, States
from mjhcmc.gradients.request import check_offered, check_threads
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.muscle_parameters import (
    FIBER,
    FORCE,
    FORCE_KINDS,
    SLACK,
    check_kinds,
    muscle_force,
    muscle_parameters,
    with_muscle_parameters,
)
from mjhcmc.solution_batch import one_each

Array = NDArray[np.float64]

BOUNDS = {FORCE: (0.1, 10.0), FIBER: (0.7, 1.4), SLACK: (0.8, 1.25)}
"""How far a parameter may go, as factors of where it starts; of other kinds .2 to 5."""

_OTHER_BOUNDS = (0.2, 5.0)
_LOST = 100.0  # standard deviations: the residual of parameters under which the model cannot be simulated
_IDENTIFIED = 0.5  # of the prior's standard deviation
_SETTLED = 0.1  # standard errors that a parameter may still want to move
_NEAR_BOUND = 1e-3  # of a logarithm
_MISFIT = 3.0  # standard deviations: more is left than noise would leave
_ANEW = 3  # a search that stops short goes on from there, with its trust region as at first
_CHOICES = ("cost", "weights", "smoothness", "min_activation", "disabled", "emg", "gain", "authority")


@dataclass(frozen=True, eq=False)
class Calibration:
    """Parameters that were found.

    Attributes:
        model: with them.
        names: (p,) such as ``"max_isometric_force/soleus"``.
        start: (p,) where they began.
        values: (p,) what they became.
        relative_error: (p,) standard error of each over its value, from the Jacobian and the larger of the assumed and
            the remaining scatter.
        prior: (p,) standard deviation of each over its start, before anything was measured.
        residual: root mean square of what is left, in the unit of what was measured.
        evaluations: times that the model was solved.
        at_bound: (p,) parameters that would go further than `BOUNDS` lets them.
        converged: whether no parameter would move on by more than a tenth of its standard error.
        message: how it ended.
    """

    model: MuscleModel = field(repr=False)
    names: tuple[str, ...]
    start: Array
    values: Array
    relative_error: Array
    prior: Array
    residual: float
    evaluations: int
    at_bound: NDArray[np.bool_]
    converged: bool
    message: str

    def __repr__(self) -> str:
        """One line; `values` are what was found."""
        ended = "converged" if self.converged else f"not converged: {self.message}"
        return (
            f"Calibration({len(self.names)} parameters, {int(self.identified.sum())} of them identified, residual "
            f"{self.residual:.3g}, {self.evaluations} evaluations, {ended})"
        )

    @property
    def identified(self) -> NDArray[np.bool_]:
        """(p,) parameters that the data tell: twice as well known as before, and within the bounds."""
        return np.asarray((self.relative_error < _IDENTIFIED * self.prior) & ~self.at_bound)


def calibrate(
    model: MuscleModel,
    motions: Motion | Sequence[Motion],
    excitations: ArrayLike | Sequence[ArrayLike],
    dt: float = 0.01,
    physics_dt: float = 0.001,
    *,
    parameters: Sequence[str] = (FORCE,),
    excitation_sd: float = 0.02,
    prior: float | Mapping[str, float] = 1.0,
    most_evaluations: int = 40,
    threads: int = 1,
    **choices: Any,
) -> Calibration:
    """Find the muscle parameters whose HCMC excitations are those measured.

    Args:
        model: with the parameters to start from; see `gradient` for which models.
        motions: measured movements. Noise in them becomes noise of moments: filter them, or fit what is known of them.
        excitations: (N, n_muscle) of each movement's N control windows; NaN where there is none.
        dt: s, as `hcmc`.
        physics_dt: s, as `hcmc`.
        parameters: kinds, of `mjhcmc.muscle_parameters.KINDS`.
        excitation_sd: standard deviation of measured excitations.
        prior: standard deviation of each parameter over its start, before anything is measured: one number, or by kind.
        most_evaluations: of the model.
        threads: to compute on.
        choices: of cost, bounds and feedback, as of `gradient`.

    Raises:
        SettingsError: other numbers of movements and excitations, an unknown kind, numbers that are not positive; else
            as `gradient`.
        MotionError: excitations of other size than the movement's windows.
        MjhcmcError: as `gradient`, at the start.
    """
    check_offered(model, str(choices.get("cost", "effort")))
    for name in choices:
        if name not in _CHOICES:
            raise SettingsError(f"calibrate has no setting {name!r}: beside its own it takes {', '.join(_CHOICES)}")
    check_threads(threads)
    names, kinds, sds = _parameters(model, parameters, prior)
    moved, count = one_each("motions", motions, Motion, None)
    try:
        given: Sequence[Any] = [excitations] if count is None else list(excitations)  # type: ignore[arg-type]
    except TypeError:
        raise SettingsError("excitations must be (N, n_muscle) for each motion") from None
    if len(given) != len(moved):
        raise SettingsError(f"{len(given)} excitations for {len(moved)} motions: give one (N, n_muscle) a motion")
    targets = [_target(model, motion, one, dt, i) for i, (motion, one) in enumerate(zip(moved, given, strict=True))]
    known = [np.isfinite(target) for target in targets]
    if not sum(int(which.sum()) for which in known) >= len(names):
        raise SettingsError(
            f"{sum(int(which.sum()) for which in known)} measured excitations cannot tell {len(names)} parameters: "
            "measure more, or calibrate fewer"
        )
    _positive("excitation_sd", excitation_sd)
    start = muscle_parameters(model)

    def look(x: Array) -> tuple[Array, Array]:
        values = _values(start, kinds, x)
        batch = gradient_batch(
            with_muscle_parameters(model, values), moved, dt, physics_dt, parameters=kinds, threads=threads, **choices
        )
        for error in batch.errors.values():
            raise error
        left = [(batch[i].solution.excitation - targets[i])[known[i]] for i in range(len(moved))]
        slopes = [batch[i].relative[known[i]] for i in range(len(moved))]
        return np.concatenate(left) / excitation_sd, np.concatenate(slopes) / excitation_sd

    return _search(model, names, kinds, sds, look, most_evaluations, excitation_sd)


def calibrate_moments(
    model: MuscleModel,
    motion: Motion,
    time: ArrayLike,
    activation: ArrayLike,
    moments: ArrayLike,
    *,
    parameters: Sequence[str] = (FORCE,),
    moment_sd: ArrayLike = 1.0,
    prior: float | Mapping[str, float] = 1.0,
    most_evaluations: int = 100,
) -> Calibration:
    """Find the muscle parameters whose muscles give the joint moments measured.

    Args:
        model: with the parameters to start from; see `gradient` for which models.
        motion: the movement, or a posture held.
        time: (k,) s, when moments were measured, within the motion.
        activation: (k, n_muscle) there, 0..1.
        moments: (k, nv) N m of all muscles together; NaN where there is none.
        parameters: kinds, of `mjhcmc.muscle_parameters.FORCE_KINDS`.
        moment_sd: N m, standard deviation of measured moments: one number, or (nv,).
        prior: see `calibrate`.
        most_evaluations: of the muscles.

    Raises:
        SettingsError: sizes that do not agree, an unknown kind, activation outside 0..1, numbers that are not positive.
        MotionError: a time outside the motion.
        SimulationError: a limit, contact or equality is at work.
    """
    check_offered(model, "effort")
    names, kinds, sds = _parameters(model, parameters, prior)
    for kind in kinds:
        if kind not in FORCE_KINDS:
            told = ", ".join(FORCE_KINDS)
            raise SettingsError(f"moments under known activation do not tell {kind}: choose from {told}")
    if not isinstance(motion, Motion):
        raise SettingsError(f"calibrate_moments takes a Motion; got {type(motion).__name__}")
    at = motion.sample(np.atleast_1d(_numbers("time", time)))
    k, n, nv = len(at.time), model.n_muscle, model.nv
    a, target = _numbers("activation", activation), _numbers("moments", moments)
    for name, values, width in (("activation", a, n), ("moments", target, nv)):
        if values.shape != (k, width):
            raise SettingsError(f"{name} has shape {values.shape}: give ({k}, {width}), a row a time")
    if not ((a >= 0) & (a <= 1)).all():
        row, muscle = np.argwhere(~((a >= 0) & (a <= 1)))[0]
        raise SettingsError(
            f"activation of {model.muscle_names[muscle]!r} in row {row} is {a[row, muscle]:g}: it lies within 0..1"
        )
    sd = _numbers("moment_sd", moment_sd)
    if sd.ndim and sd.shape != (nv,):
        raise SettingsError(f"moment_sd has shape {sd.shape}: give one number, or ({nv},)")
    sd = np.broadcast_to(sd, (nv,))
    if not (np.isfinite(sd).all() and (sd > 0).all()):
        raise SettingsError(f"moment_sd must be positive; got {sd.tolist()}")
    known = np.isfinite(target)
    if known.sum() < len(names):
        raise SettingsError(
            f"{int(known.sum())} measured moments cannot tell {len(names)} parameters: measure more, or calibrate fewer"
        )
    seen = Looker(model, k).look(States(at.qpos, at.qvel, a, np.zeros((k, nv))))
    arms = np.swapaxes(seen.R, 1, 2)
    start = muscle_parameters(model)

    def look(x: Array) -> tuple[Array, Array]:
        values = _values(start, kinds, x)
        now = with_muscle_parameters(model, values)
        force = muscle_force(now, seen.length, seen.velocity)
        damping = damping_of(now, seen)
        by_damping = damping_slopes(now, damping)
        whole = (arms @ (force.gain * a + force.bias + damping)[:, :, None])[:, :, 0]
        columns = []
        for kind in kinds:
            which = FORCE_KINDS.index(kind)
            by = force.gain_slopes[which] * a + force.bias_slopes[which] + by_damping.get(kind, 0.0)
            columns.append(arms * (by * values[kind])[:, None, :])
        left, slopes = (whole - target) / sd, np.concatenate(columns, axis=2) / sd[:, None]
        return left[known], slopes[known]

    return _search(model, names, kinds, sds, look, most_evaluations, float(sd.mean()))


def _parameters(
    model: MuscleModel, parameters: Sequence[str], prior: float | Mapping[str, float]
) -> tuple[tuple[str, ...], tuple[str, ...], Array]:
    """Names (p,), kinds, and the priors' standard deviations (p,)."""
    kinds = (parameters,) if isinstance(parameters, str) else tuple(parameters)
    check_kinds(kinds)
    if not kinds:
        raise SettingsError("there is nothing to calibrate: name kinds of muscle parameters")
    given = dict(prior) if isinstance(prior, Mapping) else dict.fromkeys(kinds, prior)
    check_kinds([*given])
    for kind, value in given.items():
        _positive(f"prior of {kind}", value)
    sds = np.concatenate([np.full(model.n_muscle, float(given.get(kind, 1.0))) for kind in kinds])
    return tuple(f"{kind}/{muscle}" for kind in kinds for muscle in model.muscle_names), kinds, sds


def _numbers(name: str, given: ArrayLike) -> Array:
    try:
        return np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise SettingsError(f"{name} must hold numbers; got {given!r:.60}") from None


def _positive(name: str, value: object) -> None:
    if not (is_number(value) and 0 < float(value) < math.inf):
        raise SettingsError(f"{name} must be a positive number; got {value!r}")


def _target(model: MuscleModel, motion: Motion, given: ArrayLike, dt: float, i: int) -> Array:
    _positive("dt", dt)
    target = _numbers(f"excitations[{i}]", given)
    count = math.floor(motion.duration / dt + 1e-6)
    if target.shape != (count, model.n_muscle):
        raise MotionError(
            f"excitations[{i}] has shape {target.shape}: give ({count}, {model.n_muscle}), one row for each window of "
            f"{dt:g} s of motion {motion.name!r}"
        )
    bad = np.argwhere((target < 0) | (target > 1))
    if len(bad):
        k, muscle = bad[0]
        raise MotionError(
            f"excitations[{i}] of {model.muscle_names[muscle]!r} in window {k} is {target[k, muscle]:g}: scale them to "
            "0..1, the whole range of each muscle"
        )
    return target


def _values(start: Mapping[str, Array], kinds: Sequence[str], x: Array) -> dict[str, Array]:
    return {kind: start[kind] * np.exp(part) for kind, part in zip(kinds, np.split(x, len(kinds)), strict=True)}


def _search(
    model: MuscleModel,
    names: tuple[str, ...],
    kinds: tuple[str, ...],
    prior: Array,
    look: Callable[[Array], tuple[Array, Array]],
    most: int,
    unit: float,
) -> Calibration:
    """Least squares of residuals and slopes by x, both in standard deviations.

    Args:
        model: to start from.
        names: (p,) of the parameters.
        kinds: of them.
        prior: (p,) standard deviations of x.
        look: residuals (k,) and slopes (k, p) at x (p,).
        most: evaluations.
        unit: standard deviation of what was measured.
    """
    if not isinstance(most, (int, np.integer)) or isinstance(most, bool) or most < 1:
        raise SettingsError(f"most_evaluations must be a whole number of at least 1; got {most!r}")
    p, count = len(names), 0
    last: list[tuple[bytes, Array, Array]] = []

    def at(x: Array) -> tuple[Array, Array]:
        nonlocal count
        if last and last[0][0] == x.tobytes():
            return last[0][1], last[0][2]
        count += 1
        try:
            left, slopes = look(x)
        except SimulationError:
            if not last:  # where it starts, the caller has to know
                raise
            left, slopes = np.full_like(last[0][1][:-p], _LOST), last[0][2][:-p]
        found = np.concatenate([left, x / prior]), np.vstack([slopes, np.diag(1 / prior)])
        last[:] = [(x.tobytes(), *found)]
        return found

    limits = np.log([BOUNDS.get(kind, _OTHER_BOUNDS) for kind in kinds for _ in range(model.n_muscle)]).T
    x = np.zeros(p)
    for _ in range(_ANEW):
        result = least_squares(
            lambda x: at(x)[0], x, jac=lambda x: at(x)[1], bounds=limits, x_scale=0.3, max_nfev=max(1, most - count)
        )
        x = result.x
        left, slopes = at(x)
        bounded = (x < limits[0] + _NEAR_BOUND) | (x > limits[1] - _NEAR_BOUND)
        error, settled = _standing(left, slopes, bounded)
        if settled or count >= most:
            break
        x = np.clip(x, limits[0] + _NEAR_BOUND, limits[1] - _NEAR_BOUND)
    start = muscle_parameters(model)
    values = _values(start, kinds, x)
    residual = float(np.sqrt(np.mean(left[:-p] ** 2)))
    _tell(names, bounded, residual)
    return Calibration(
        model=with_muscle_parameters(model, values),
        names=names,
        start=np.concatenate([start[kind] for kind in kinds]),
        values=np.concatenate([values[kind] for kind in kinds]),
        relative_error=error,
        prior=prior,
        residual=residual * unit,
        evaluations=count,
        at_bound=bounded,
        converged=settled,
        message=str(result.message) if settled else "not settled: give more evaluations, or a start that is nearer",
    )


def _standing(left: Array, slopes: Array, bounded: NDArray[np.bool_]) -> tuple[Array, bool]:
    """Standard errors (p,), and whether a Gauss-Newton step would hardly move what may move.

    Args:
        left: (k,) residuals, the priors' included.
        slopes: (k, p).
        bounded: (p,) parameters at a bound.
    """
    p = slopes.shape[1]
    scatter = max(1.0, float(left @ left) / max(1, len(left) - p))
    error = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)) * scatter)
    free = ~bounded
    step = np.linalg.lstsq(slopes[:, free], -left)[0]
    return error, bool((np.abs(step) < _SETTLED * error[free]).all())


def _tell(names: tuple[str, ...], bounded: NDArray[np.bool_], residual: float) -> None:
    """Warn of what stands in the way of believing the result."""
    if bounded.any():
        named = ", ".join(name for name, one in zip(names, bounded, strict=True) if one)
        warnings.warn(
            f"calibration: at its bound {named}: start nearer to what it should be", MjhcmcWarning, stacklevel=4
        )
    if residual > _MISFIT:
        warnings.warn(
            f"calibration: what is left is {residual:.3g} standard deviations of the measurement: something else than "
            "these parameters is at work, or the search is stuck: start nearer",
            MjhcmcWarning,
            stacklevel=4,
        )

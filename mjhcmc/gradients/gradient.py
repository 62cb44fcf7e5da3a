"""How HCMC's excitations answer to the muscles' parameters, to the model and to the motion.

A solution goes window by window: excitation and reserve of a window follow from the state at its start by conditions at
its end (see `windows`), and the state at its end follows from both by MuJoCo's own steps (see `tangents`). Both are
differentiated as they are, one window after the other, for all parameters at once; nothing is solved again. The
solution is HCMC's converged answer: that of as many trials of each window as it takes.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.emg_targets import EmgTargets
from mjhcmc.errors import MjhcmcError, MjhcmcWarning, SettingsError, SimulationError
from mjhcmc.gradients.along import Wanted
from mjhcmc.gradients.differentiate import Feedback, differentiate
from mjhcmc.gradients.request import (
    check_directions,
    check_offered,
    check_threads,
    model_direction,
    motion_direction,
    names_of,
)
from mjhcmc.methods.hcmc import Hcmc
from mjhcmc.methods.run import run_together
from mjhcmc.methods.windows import Windows, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.muscle_parameters import FORCE_KINDS, TIME_KINDS, check_kinds
from mjhcmc.notices import each_notice_once
from mjhcmc.solution import Solution
from mjhcmc.solution_batch import one_each
from mjhcmc.variants import check_alike

Array = NDArray[np.float64]

TRIALS, TOLERANCE = 30, 1e-6
"""Of HCMC's converged answer: corrections of a window at most, and what of the acceleration may be missed."""

_TIED = 1e-9  # of activation


@dataclass(frozen=True, eq=False)
class Gradient:
    """Derivatives of a solution by p parameters, at fixed active sets.

    Attributes:
        solution: HCMC's converged answer, with N windows.
        names: (p,) such as ``"max_isometric_force/soleus"``; names of directions as they were given.
        values: (p,) what the parameters are; NaN for directions.
        excitation: (N, n_muscle, p) d u/d parameter, as the rest.
        activation: (N+1, n_muscle, p).
        qpos: (N+1, nv, p).
        qvel: (N+1, nv, p).
        reserve: (N, nv, p).
        margin: (N, n_muscle) of activation: how far each muscle was from reaching or leaving a bound, or from turning
            between rising and falling, where the derivative jumps.
    """

    solution: Solution
    names: tuple[str, ...]
    values: Array
    excitation: Array = field(repr=False)
    activation: Array = field(repr=False)
    qpos: Array = field(repr=False)
    qvel: Array = field(repr=False)
    reserve: Array = field(repr=False)
    margin: Array = field(repr=False)

    def __repr__(self) -> str:
        """One line."""
        windows, muscles, _ = self.excitation.shape
        return f"Gradient({len(self.names)} parameters, {windows} windows, {muscles} muscles)"

    @property
    def relative(self) -> Array:
        """(N, n_muscle, p) change of excitation with a relative growth of each parameter; directions as they are."""
        return np.asarray(self.excitation * np.where(np.isnan(self.values), 1.0, np.abs(self.values)))

    def of(self, name: str) -> Array:
        """(N, n_muscle) d u/d one parameter.

        Raises:
            SettingsError: no such parameter.
        """
        if name not in self.names:
            raise SettingsError(f"the gradient has no parameter {name!r}: it has {', '.join(self.names)}")
        return np.asarray(self.excitation[:, :, self.names.index(name)])


def gradient(
    model: MuscleModel,
    motion: Motion,
    dt: float = 0.01,
    physics_dt: float = 0.001,
    initial_qpos: ArrayLike | None = None,
    initial_qvel: ArrayLike | None = None,
    initial_activation: ArrayLike | None = None,
    *,
    parameters: Sequence[str] = FORCE_KINDS,
    model_directions: Mapping[str, Mapping[str, ArrayLike]] | None = None,
    motion_directions: Mapping[str, ArrayLike] | None = None,
    side: int = 1,
    cost: str = "effort",
    weights: Mapping[str, float] | ArrayLike | None = None,
    smoothness: float = 0.0,
    min_activation: Mapping[str, float] | ArrayLike = 0.0,
    disabled: Sequence[str] = (),
    emg: EmgTargets | None = None,
    gain: float = 2.7,
    authority: float = 0.15,
    threads: int = 1,
) -> Gradient:
    """Solve by HCMC to convergence, and differentiate the solution.

    Equal to central differences of ``hcmc(..., trials=16, tolerance=0)`` where no muscle changes what it does within
    the step of the differences.

    Args:
        model: of at most 10 degrees of freedom, hinges and slides, all tracked, with MuJoCo's muscles.
        motion: to follow, away from limits and contacts.
        dt: as `hcmc`, and so the rest but for what follows.
        physics_dt: see there.
        initial_qpos: see there.
        initial_qvel: see there.
        initial_activation: see there.
        parameters: kinds of muscle parameters to differentiate by, of `mjhcmc.muscle_parameters.KINDS`: those of every
            muscle, one after the other.
        model_directions: by name, changes of fields of ``MjModel``, such as ``{"shank": {"body_mass": dm}}``: the
            derivative is that along the change. Times of activation dynamics have kinds of their own.
        motion_directions: by name, changes (T, nq) of the motion's samples, rad or m.
        side: 1 or -1: where a muscle is just about to leave a bound or to meet it, the derivative for growing or
            falling parameters. Where excitation equals activation between the bounds, as in a posture that is held, a
            warning tells that the derivative is that of falling activation.
        cost: ``"effort"`` or ``"cubic"``.
        weights: see there.
        smoothness: see there.
        min_activation: see there.
        disabled: see there.
        emg: see there.
        gain: see there.
        authority: see there.
        threads: to look at states on.

    Raises:
        SettingsError: a model, cost or parameter that has no gradient here; else as `hcmc`.
        SimulationError: a limit, contact or equality is at work along the solution; else as `hcmc`.
        MotionError: as `hcmc`.
        ModelError: muscles that are not MuJoCo's.
    """
    (found,), errors = _gradients(
        [model], [motion], _Asked(parameters, model_directions or {}, motion_directions or {}, side, gain, authority),
        dt, physics_dt, (initial_qpos, initial_qvel, initial_activation), threads, None,
        cost=cost, weights=weights, smoothness=smoothness, min_activation=min_activation, disabled=disabled, emg=emg,
    )  # fmt: skip
    if found is None:
        raise errors[0]
    return found


@dataclass(frozen=True, eq=False)
class GradientBatch:
    """Gradients of many simulations: a sequence, in which one that failed raises its error.

    Attributes:
        gradients: (B,), None where one failed.
        errors: of those that failed, by number.
    """

    gradients: tuple[Gradient | None, ...]
    errors: Mapping[int, MjhcmcError]

    def __len__(self) -> int:
        """Number of simulations."""
        return len(self.gradients)

    def __getitem__(self, i: int) -> Gradient:
        """One of them.

        Raises:
            MjhcmcError: why that one failed.
        """
        found = self.gradients[i]
        if found is None:
            raise self.errors[i % len(self)]
        return found


def gradient_batch(
    models: MuscleModel | Sequence[MuscleModel],
    motions: Motion | Sequence[Motion],
    dt: float = 0.01,
    physics_dt: float = 0.001,
    *,
    parameters: Sequence[str] = FORCE_KINDS,
    model_directions: Mapping[str, Mapping[str, ArrayLike]] | None = None,
    motion_directions: Mapping[str, ArrayLike] | None = None,
    side: int = 1,
    cost: str = "effort",
    weights: Mapping[str, float] | ArrayLike | None = None,
    smoothness: float = 0.0,
    min_activation: Mapping[str, float] | ArrayLike = 0.0,
    disabled: Sequence[str] = (),
    emg: EmgTargets | None = None,
    gain: float = 2.7,
    authority: float = 0.15,
    threads: int = 1,
) -> GradientBatch:
    """As `gradient`, of many simulations: patients, trials. They are solved in lock step; one that fails does so alone.

    Args:
        models: one for all, or one each; of one structure, alike in all but numbers.
        motions: one for all, or one each; they may differ in length.
        dt: as `gradient`, as the rest.
        physics_dt: see there.
        parameters: see there.
        model_directions: see there; the same for all.
        motion_directions: see there; the same for all.
        side: see there.
        cost: see there.
        weights: see there.
        smoothness: see there.
        min_activation: see there.
        disabled: see there.
        emg: see there.
        gain: see there.
        authority: see there.
        threads: to solve and to look at states on.

    Raises:
        SettingsError: an empty batch, sizes that do not agree, models of different structure.
        MjhcmcError: as `gradient`, where every simulation fails: the error of the first.
    """
    given, count = one_each("models", models, MuscleModel, None)
    count = count if len(given) > 1 else None
    check_alike(given)
    moved, both = one_each("motions", motions, Motion, count)
    n = max(len(given), both or 1)
    found, errors = _gradients(
        given * n if len(given) == 1 else given, moved * n if len(moved) == 1 else moved,
        _Asked(parameters, model_directions or {}, motion_directions or {}, side, gain, authority),
        dt, physics_dt, (None, None, None), threads, range(n),
        cost=cost, weights=weights, smoothness=smoothness, min_activation=min_activation, disabled=disabled, emg=emg,
    )  # fmt: skip
    if len(errors) == n:
        raise errors[0]
    if errors:
        first = min(errors)
        told = f"{len(errors)} of {n} gradients failed, the first of simulation {first}: {errors[first]}"
        warnings.warn(told, MjhcmcWarning, stacklevel=2)
    return GradientBatch(tuple(found), errors)


@dataclass(frozen=True)
class _Asked:
    """What to differentiate by, and how; see `gradient`."""

    parameters: Sequence[str]
    models: Mapping[str, Mapping[str, ArrayLike]]
    motions: Mapping[str, ArrayLike]
    side: int
    gain: float
    authority: float

    def __post_init__(self) -> None:
        if self.side not in (1, -1):
            raise SettingsError(f"side must be 1 or -1; got {self.side!r}")
        if isinstance(self.parameters, str) or not isinstance(self.parameters, Sequence):
            raise SettingsError(
                f"parameters must be a sequence of kinds, such as {FORCE_KINDS}; got {self.parameters!r}"
            )
        check_kinds(self.parameters)
        check_directions("model_directions", self.models)
        check_directions("motion_directions", self.motions)
        if not (len(self.parameters) or self.models or self.motions):
            raise SettingsError("there is nothing to differentiate by: name parameters, or give directions")


def _gradients(
    models: Sequence[MuscleModel],
    motions: Sequence[Motion],
    asked: _Asked,
    dt: float,
    physics_dt: float,
    start: tuple[ArrayLike | None, ArrayLike | None, ArrayLike | None],
    threads: int,
    numbers: Sequence[int] | None,
    **choices: Any,
) -> tuple[list[Gradient | None], dict[int, MjhcmcError]]:
    """The gradients, None where one failed, and why."""
    check_threads(threads)
    if choices["emg"] is not None and set(asked.parameters) & set(TIME_KINDS):
        raise SettingsError(
            "emg is followed through the muscles' activation dynamics, whose times have no gradient with it: leave "
            f"{' and '.join(TIME_KINDS)} out of parameters, or emg"
        )
    errors: dict[int, MjhcmcError] = {}
    ready: dict[int, tuple[Windows, Wanted, list[Array]]] = {}
    told: set[str] = set()
    for i, (model, motion) in enumerate(zip(models, motions, strict=True)):
        try:
            check_offered(model, choices["cost"])
            changes = tuple(model_direction(model, name, d) for name, d in asked.models.items())
            wanted = Wanted(tuple(asked.parameters), changes, len(asked.motions))
            moves = [motion_direction(motion, name, d) for name, d in asked.motions.items()]
            names_of(model, wanted, [*asked.models], [*asked.motions])
            with each_notice_once(told):
                ready[i] = prepare(model, motion, dt, physics_dt, *start, **choices), wanted, moves
        except MjhcmcError as error:
            errors[i] = error
    method = Hcmc(True, TRIALS, TOLERANCE, asked.gain, asked.authority, threads)
    named = None if numbers is None else list(ready)
    every = [windows for windows, _, _ in ready.values()]
    outcomes = run_together(method, every, None, threads, named) if ready else []
    found: list[Gradient | None] = [None] * len(models)
    given = (start[0] is not None, start[1] is not None, start[2] is not None)
    for (i, (windows, wanted, moves)), outcome in zip(ready.items(), outcomes, strict=True):
        if isinstance(outcome, SimulationError):
            errors[i] = outcome
            continue
        _tell_ties(outcome, windows)
        names, values = names_of(windows.model, wanted, [*asked.models], [*asked.motions])
        feedback = Feedback(asked.gain, asked.authority, given)
        try:
            parts = differentiate(windows, outcome, wanted, moves, feedback, asked.side, threads)
        except MjhcmcError as error:
            errors[i] = error
            continue
        found[i] = Gradient(outcome, names, values, *parts)
    return found, errors


def _tell_ties(solution: Solution, windows: Windows) -> None:
    """Warn of windows in which excitation equals activation between its bounds: neither rising nor falling.

    One that holds the least activation stays as it is.
    """
    model, u = windows.model, solution.excitation
    low, high = model.excitation_range.T
    tied = (np.abs(u - solution.activation[:-1]) < _TIED) & (u > low + _TIED) & (u < high - _TIED)
    tied &= solution.activation[1:] > windows.sharing.min_activation + _TIED
    if tied.any():
        k, i = np.argwhere(tied)[0]
        warnings.warn(
            f"in {int(tied.any(axis=1).sum())} windows an excitation equals the activation, first that of "
            f"{model.muscle_names[i]!r} at {solution.time[k]:.4g} s: the derivative there is that of falling "
            "activation (growing activation answers faster)",
            MjhcmcWarning,
            stacklevel=4,
        )

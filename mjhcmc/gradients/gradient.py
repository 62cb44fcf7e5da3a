"""How HCMC's excitations answer to the muscles' parameters, to the model and to the motion.

A solution goes window by window: excitation and reserve of a window follow from the state at its start by conditions at
its end (see `windows`), and the state at its end follows from both by MuJoCo's own steps (see `tangents`). Both are
differentiated as they are, one window after the other, for all parameters at once; nothing is solved again. The
solution is HCMC's converged answer: that of as many trials of each window as it takes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.beside import FEW
from mjhcmc.emg_targets import EmgTargets
from mjhcmc.errors import SettingsError
from mjhcmc.gradients import windows as one
from mjhcmc.gradients.along import Nodes, Stages, Wanted, nodes_along, stages_along
from mjhcmc.gradients.feedback import Errors, gains
from mjhcmc.gradients.looks import Looker, States
from mjhcmc.gradients.tangents import propagate
from mjhcmc.methods.hcmc import Hcmc
from mjhcmc.methods.run import run
from mjhcmc.methods.windows import Windows, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion, Reference
from mjhcmc.muscle_parameters import FALL, FORCE_KINDS, RISE, check_kinds, muscle_parameters
from mjhcmc.solution import Solution

Array = NDArray[np.float64]

TRIALS, TOLERANCE = 30, 1e-6
"""Of HCMC's converged answer: corrections of a window at most, and what of the acceleration may be missed."""

_COSTS = ("effort", "cubic")


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

    @property
    def relative(self) -> Array:
        """(N, n_muscle, p) change of excitation with a relative change of each parameter; directions as they are."""
        return np.asarray(self.excitation * np.where(np.isnan(self.values), 1.0, self.values))

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
        side: 1 or -1: where a muscle is just about to change what it does, the derivative for growing or falling
            parameters.
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
    _check(model, cost, side)
    check_kinds(parameters)
    wanted = Wanted(
        tuple(parameters),
        tuple(_model_direction(model, name, d) for name, d in (model_directions or {}).items()),
        len(motion_directions or {}),
    )
    if not wanted.count(model):
        raise SettingsError("there is nothing to differentiate by: name parameters, or give directions")
    moves = [_motion_direction(motion, name, d) for name, d in (motion_directions or {}).items()]
    windows = prepare(
        model, motion, dt, physics_dt, initial_qpos, initial_qvel, initial_activation, cost=cost, weights=weights,
        smoothness=smoothness, min_activation=min_activation, disabled=disabled, emg=emg,
    )  # fmt: skip
    solution = run(Hcmc(True, TRIALS, TOLERANCE, gain, authority), windows, None)
    names, values = _names(model, wanted, [*(model_directions or {})], [*(motion_directions or {})])
    given = tuple(value is not None for value in (initial_qpos, initial_qvel, initial_activation))
    found = _differentiate(windows, solution, wanted, moves, given, (gain, authority), side, threads)
    return Gradient(solution, names, values, *found)


def _check(model: MuscleModel, cost: str, side: int) -> None:
    if not isinstance(model, MuscleModel):
        raise SettingsError(f"a gradient takes a MuscleModel; got {type(model).__name__}: use MuscleModel.load")
    if cost not in _COSTS:
        raise SettingsError(f"a gradient with cost {cost!r} is not offered: choose from {', '.join(_COSTS)}")
    if side not in (1, -1):
        raise SettingsError(f"side must be 1 or -1; got {side!r}")
    m, why = model.mj_model, ""
    if model.nv > FEW:
        why = f"it has {model.nv} degrees of freedom, a gradient is offered up to {FEW}"
    elif not model.coordinates.flat:
        why = "it has ball or free joints"
    elif not model.roles.all_tracked or model.coupling is not None:
        why = "some of its degrees of freedom are not tracked"
    elif np.isfinite(model.force_limit).any():
        why = "its muscles have a forcerange"
    elif m.nplugin or m.nflex:
        why = "it has plugins or flexes"
    if why:
        raise SettingsError(f"model {model.name!r} has no gradient here: {why}; use differences of hcmc")
    muscle_parameters(model)


def _model_direction(model: MuscleModel, name: str, given: Mapping[str, ArrayLike]) -> dict[str, Array]:
    found: dict[str, Array] = {}
    for key, change in given.items():
        own = getattr(model.mj_model, str(key), None)
        if not (isinstance(own, np.ndarray) and own.dtype == np.float64) or key == "actuator_dynprm":
            raise SettingsError(
                f"model direction {name!r}: the model has no field {key!r} to differentiate by: name one of MjModel's "
                "real fields, such as 'body_mass' (times of activation are parameters of their own)"
            )
        array = np.asarray(change, dtype=np.float64)
        if array.shape != own.shape or not np.isfinite(array).all():
            raise SettingsError(
                f"model direction {name!r}: {key} has shape {array.shape}: give {own.shape} finite numbers"
            )
        found[key] = array
    return found


def _motion_direction(motion: Motion, name: str, given: ArrayLike) -> Array:
    array = np.asarray(given, dtype=np.float64)
    if array.shape != motion.qpos.shape or not np.isfinite(array).all():
        raise SettingsError(
            f"motion direction {name!r} has shape {array.shape}: give {motion.qpos.shape} finite numbers, the motion's "
            "own samples"
        )
    return array


def _names(
    model: MuscleModel, wanted: Wanted, models: Sequence[str], motions: Sequence[str]
) -> tuple[tuple[str, ...], Array]:
    now = muscle_parameters(model)
    names = [f"{kind}/{muscle}" for kind in wanted.kinds for muscle in model.muscle_names]
    values = np.concatenate([*(now[kind] for kind in wanted.kinds), np.full(len(models) + len(motions), np.nan)])
    return (*names, *models, *motions), values


def _differentiate(
    windows: Windows,
    solution: Solution,
    wanted: Wanted,
    moves: Sequence[Array],
    given: tuple[bool, ...],
    feedback: tuple[float, float],
    side: int,
    threads: int,
) -> tuple[Array, ...]:
    """The arrays of `Gradient`, in its order."""
    model, reference = windows.model, windows.reference
    n, nv, p, N = model.n_muscle, model.nv, wanted.count(model), solution.n_window
    step = float(solution.settings["physics_dt"])
    n_step = round(windows.dt / step)
    looker = Looker(model, 4 * N * n_step, threads)
    before = np.vstack([_first_reserve(looker, windows, solution), solution.reserve])
    nodes = nodes_along(looker, States(solution.qpos, solution.qvel, solution.activation, before), wanted)
    starts = States(solution.qpos[:-1], solution.qvel[:-1], solution.activation[:-1], solution.reserve)
    stages = stages_along(looker, starts, solution.qpos[1:], solution.excitation, step, n_step, wanted)
    moved = _moved_reference(windows, moves, p)
    rms = windows.rms_qacc
    least = rms, np.einsum("ki,kip->ip", reference.qacc, moved.qacc) / len(reference.qacc) / rms[:, None]
    excitation, reserve = np.zeros((N, n, p)), np.zeros((N, nv, p))
    activation, qpos, qvel = np.zeros((N + 1, n, p)), np.zeros((N + 1, nv, p)), np.zeros((N + 1, nv, p))
    margin = np.zeros((N, n))
    if not given[0]:
        qpos[0] = moved.qpos[0]
    if not given[1]:
        qvel[0] = moved.qvel[0]
    if not given[2]:
        activation[0] = _first_activation(windows, solution, nodes, before[0], moved, (qpos[0], qvel[0]), side)
    times = _times(model, wanted)
    for k in range(N):
        missing = reference.qpos[k] - solution.qpos[k], reference.qvel[k] - solution.qvel[k]
        errors = Errors(*missing, moved.qpos[k] - qpos[k], moved.qvel[k] - qvel[k])
        own = gains(nodes, k, errors, (qpos[k], qvel[k]), least, feedback[1], feedback[0], windows.dt)
        choice = one.Choice(
            solution.excitation[k], model.excitation_range, solution.activation[k], solution.activation[k + 1],
            windows.sharing.min_activation, windows.sharing.disabled, solution.reserve[k],
            reference.qvel[k + 1] - solution.qvel[k + 1], reference.qpos[k + 1] - solution.qpos[k + 1], own.kp, own.kv,
        )  # fmt: skip
        ends = _ends(stages, k, times, step, (qpos[k], qvel[k], activation[k]))
        target = one.Moved(moved.qpos[k + 1], moved.qvel[k + 1], moved.qacc[k + 1], own.kp_slopes, own.kv_slopes)
        cost = _cost(windows, solution, k)
        found = one.answer(choice, cost, nodes, k + 1, ends, activation[k], target, windows.dt, side)
        excitation[k], reserve[k], margin[k] = found.excitation, found.reserve, found.margin
        qpos[k + 1], qvel[k + 1], activation[k + 1] = found.end
    return excitation, activation, qpos, qvel, reserve, margin


def _first_reserve(looker: Looker, windows: Windows, solution: Solution) -> Array:
    """(1, nv) N m: what the muscles leave of the first desired acceleration."""
    none = np.zeros((1, windows.model.nv))
    seen = looker.look(States(solution.qpos[:1], solution.qvel[:1], solution.activation[:1], none))
    return np.asarray((seen.M[0] @ (windows.reference.qacc[0] - seen.qacc[0]))[None])


def _moved_reference(windows: Windows, moves: Sequence[Array], p: int) -> Reference:
    """Derivatives (N+1, nv, p) of the desired motion at the nodes: the spline is linear in its samples."""
    time = windows.reference.time
    parts = [np.zeros((len(time), windows.model.nv, p)) for _ in range(3)]
    for j, direction in enumerate(moves):
        found = replace(windows.motion, qpos=direction).sample(time)
        for part, values in zip(parts, (found.qpos, found.qvel, found.qacc), strict=True):
            part[:, :, p - len(moves) + j] = values
    return Reference(time, *parts)


def _first_activation(
    windows: Windows,
    solution: Solution,
    nodes: Nodes,
    reserve: Array,
    moved: Reference,
    start: tuple[Array, Array],
    side: int,
) -> Array:
    """(n_muscle, p): the first activation supplies the first desired acceleration, at once."""
    model = windows.model
    n, nv, none = model.n_muscle, model.nv, np.zeros(model.nv)
    a = solution.activation[0]
    choice = one.Choice(
        a, model.excitation_range, np.full(n, -1.0), a, windows.sharing.min_activation, windows.sharing.disabled, reserve,
        none, none, none, none,
    )  # fmt: skip
    p = moved.qpos.shape[2]
    ends = np.zeros((2 * nv + n, n + nv + p))
    ends[2 * nv :, :n] = np.eye(n)
    ends[:nv, n + nv :], ends[nv : 2 * nv, n + nv :] = start
    still = np.zeros((nv, p))
    target = one.Moved(still, still, moved.qacc[0], still, still)
    cost = _cost(windows, solution, -1)
    found = one.answer(choice, cost, nodes, 0, ends, np.zeros((n, p)), target, 0.0, side)
    return found.end.activation


def _cost(windows: Windows, solution: Solution, k: int) -> one.Cost:
    """The cost at the end of window k; -1: of the first activation."""
    sharing, n = windows.sharing, windows.model.n_muscle
    none, time = np.zeros(n), float(windows.reference.time[k + 1])
    if k < 0:
        w, a0, c = sharing.weigh(none, none, None, time)
        slope = none
    else:
        a = solution.activation[k]
        w, a0, c = sharing.weigh(none, none, a, time)
        slope = sharing.weigh(none, none, a + 1.0, time)[1] - a0  # linear in it
    return one.Cost(np.broadcast_to(w, n), np.broadcast_to(a0, n), none if c is None else c, np.broadcast_to(slope, n))


def _times(model: MuscleModel, wanted: Wanted) -> NDArray[np.intp]:
    """(p, 2) see `tangents.propagate`."""
    times = np.full((wanted.count(model), 2), -1, dtype=np.intp)
    muscles = np.arange(model.n_muscle)
    for column, kind in enumerate((RISE, FALL)):
        if kind in wanted.kinds:
            times[wanted.kinds.index(kind) * model.n_muscle + muscles, column] = muscles
    return times


def _ends(stages: Stages, k: int, times: NDArray[np.intp], step: float, start: tuple[Array, Array, Array]) -> Array:
    """(2 nv + n, n + nv + p) tangents of a window's end by excitation, reserve, and parameters at fixed inputs."""
    qpos, qvel, activation = start
    nv, p = qpos.shape
    n = len(activation)
    dq, dv, da = np.zeros((nv, n + nv + p)), np.zeros((nv, n + nv + p)), np.zeros((n, n + nv + p))
    dq[:, n + nv :], dv[:, n + nv :], da[:, n + nv :] = qpos, qvel, activation
    propagate(
        stages.Jq[k], stages.Jv[k], stages.Ja[k], stages.Js[k], stages.Jp[k], stages.rates[k], times, step, dq, dv, da
    )
    return np.vstack([dq, dv, da])

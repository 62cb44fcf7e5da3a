"""HCMC for many movements at once: patients, trials, variants of a model."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from mjhcmc.emg_targets import EmgTargets
from mjhcmc.errors import MjhcmcError, MjhcmcWarning, SettingsError, SimulationError
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.imposed import Imposed
from mjhcmc.integrators import scheme_of
from mjhcmc.joint_moments import JointMoments
from mjhcmc.methods.hcmc import Hcmc
from mjhcmc.methods.run import Progress, SolveInterrupted, run_together
from mjhcmc.methods.windows import Windows, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.muscle_choice import check_muscle, plant_for
from mjhcmc.notices import each_notice_once
from mjhcmc.plant import MujocoPlant
from mjhcmc.solution import Solution
from mjhcmc.solution_batch import SolutionBatch, agreed, one_each
from mjhcmc.variants import check_alike, variants

if TYPE_CHECKING:
    from mjhcmc.hosted.plant import HillPlant


def hcmc_batch(
    models: MuscleModel | Sequence[MuscleModel],
    motions: Motion | Sequence[Motion],
    dt: float = 0.01,
    physics_dt: float = 0.001,
    initial_qpos: ArrayLike | None = None,
    initial_qvel: ArrayLike | None = None,
    initial_activation: ArrayLike | None = None,
    reserves: bool = True,
    *,
    parameters: Mapping[str, ArrayLike] | None = None,
    threads: int | None = None,
    cost: str = "effort",
    weights: Mapping[str, float] | ArrayLike | None = None,
    smoothness: float = 0.0,
    min_activation: Mapping[str, float] | ArrayLike = 0.0,
    disabled: Sequence[str] = (),
    solver: str = "newton",
    emg: EmgTargets | Sequence[EmgTargets] | None = None,
    joint_moments: JointMoments | Sequence[JointMoments] | None = None,
    loads: ExternalLoads | Sequence[ExternalLoads] | None = None,
    imposed: Imposed | Sequence[Imposed] | None = None,
    trials: int = 2,
    tolerance: float = 0.1,
    gain: float = 2.7,
    authority: float = 0.15,
    muscle: str = "mujoco",
    curves: str = "millard",
    integrator: str = "rk4",
    progress: Progress | None = None,
) -> SolutionBatch:
    """Follow many motions, or one with many models, in lock step on all cores.

    Each simulation is solved exactly as `hcmc` solves it alone: with our own solver the same bits, for any number of
    threads and whatever else is in the batch. One that fails does so alone: it is named in a warning, and the rest go
    on.

    Args:
        models: one for all simulations, or one each; of one structure, alike in all but numbers.
        motions: one for all simulations, or one each; they may differ in length.
        dt: s, as `hcmc`, for all simulations.
        physics_dt: s, as `hcmc`, for all simulations.
        initial_qpos: (nq,) for all simulations, or (B, nq).
        initial_qvel: (nv,) or (B, nv).
        initial_activation: (n_muscle,) or (B, n_muscle), or one number.
        reserves: as `hcmc`.
        parameters: with one model: numbers of its own for each simulation, by name of an ``MjModel`` field, (B, ...);
            see `variants.variants`.
        threads: to compute on; by default all cores that this process may use.
        cost: as `hcmc`.
        weights: as `hcmc`.
        smoothness: as `hcmc`.
        min_activation: as `hcmc`.
        disabled: as `hcmc`.
        solver: as `hcmc`.
        emg: for all simulations, or one each.
        joint_moments: for all simulations, or one each.
        loads: for all simulations, or one each, None for those without.
        imposed: for all simulations, or one each, None for those without.
        trials: as `hcmc`.
        tolerance: as `hcmc`.
        gain: as `hcmc`.
        authority: as `hcmc`.
        muscle: what drives the models: ``"mujoco"``, their own muscles; ``"rigid"`` or ``"compliant"``, Hill muscles
            that follow from them, with such tendons (see `HillPlant`).
        curves: of Hill muscles: ``"millard"``, ``"thelen"`` or ``"degroote-fregly"``.
        integrator: as `hcmc`; Hill muscles take RK4 alone.
        progress: called with (windows solved, windows of the longest motion); anew where some are solved again.

    Returns:
        The solutions; ``batch[i]`` raises the error of a simulation that failed, ``batch.status`` tells which did.

    Raises:
        SettingsError: an empty batch, sizes that do not agree, models of different structure, threads below 1.
        MjhcmcError: as `hcmc`, where every simulation fails: the error of the first.
        SolveInterrupted: a KeyboardInterrupt came; its ``solutions`` hold what was solved.
    """
    n_thread = _threads(threads)
    check_muscle(muscle, curves)
    scheme_of(integrator)
    members, errors = _members(models, motions, parameters)
    count = len(members)
    n_thread = min(n_thread, count)
    method = Hcmc(reserves, trials, tolerance, gain, authority, n_thread)
    moments: list[Any] = [None]
    if joint_moments is not None:
        moments, _ = one_each("joint_moments", joint_moments, JointMoments, count)
    targets: list[Any] = [None]
    if emg is not None:
        targets, _ = one_each("emg", emg, EmgTargets, count)
    forces: list[Any] = [None]
    if loads is not None:
        forces, _ = one_each("loads", loads, ExternalLoads, count, or_none=True)
    floors: list[Any] = [None]
    if imposed is not None:
        floors, _ = one_each("imposed", imposed, Imposed, count, or_none=True)
    starts = {
        name: _rows(name, given, count)
        for name, given in (("qpos", initial_qpos), ("qvel", initial_qvel), ("activation", initial_activation))
    }
    choices: dict[str, Any] = {
        "cost": cost, "weights": weights, "smoothness": smoothness, "min_activation": min_activation,
        "disabled": disabled, "solver": solver,
    }  # fmt: skip
    bench: MujocoPlant | None = None
    plant: HillPlant | None = None
    windows: dict[int, Windows] = {}
    told: set[str] = set()
    for i, (model, motion) in enumerate(members):
        if i in errors or model is None:
            continue
        start: dict[str, Any] = {f"initial_{name}": rows[i] for name, rows in starts.items()}
        given = moments[i if len(moments) > 1 else 0]
        try:
            if muscle == "mujoco" and (bench is None or bench.model is not model):
                bench = MujocoPlant(model, integrator=integrator)
            elif muscle != "mujoco" and (plant is None or plant.driven is not model):
                plant = plant_for(model, muscle, dt, physics_dt, curves)
            with each_notice_once(told):
                windows[i] = prepare(
                    model, motion, dt, physics_dt, **start, joint_moments=given, plant=plant, bench=bench, **choices,
                    emg=targets[i if len(targets) > 1 else 0], loads=forces[i if len(forces) > 1 else 0],
                    imposed=floors[i if len(floors) > 1 else 0], integrator=integrator,
                )  # fmt: skip
        except MjhcmcError as error:
            errors[i] = error
    if not windows:
        raise errors[0]
    solved: dict[int, Solution] = {}
    try:
        outcomes = run_together(method, list(windows.values()), progress, n_thread, list(windows))
    except SolveInterrupted as stop:
        kept = dict(zip(windows, stop.solutions, strict=True))
        raise SolveInterrupted([kept.get(i) for i in range(count)]) from stop
    for i, outcome in zip(windows, outcomes, strict=True):
        if isinstance(outcome, SimulationError):
            errors[i] = outcome
        else:
            solved[i] = outcome
    if not solved:
        raise errors[0]
    batch = SolutionBatch(solved, errors)
    if batch.errors:
        warnings.warn(batch.failures, MjhcmcWarning, stacklevel=2)
    return batch


def _threads(given: int | None) -> int:
    if given is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not isinstance(given, (int, np.integer)) or isinstance(given, bool) or given < 1:
        raise SettingsError(f"threads must be a whole number of at least 1; got {given!r}")
    return int(given)


def _members(
    models: Any, motions: Any, parameters: Mapping[str, ArrayLike] | None
) -> tuple[list[tuple[MuscleModel | None, Motion]], dict[int, MjhcmcError]]:
    """Model and motion of each simulation; and the errors of those whose parameters make no model."""
    given, count = one_each("models", models, MuscleModel, None)
    listed: list[MuscleModel | None] = list(given)
    errors: dict[int, MjhcmcError] = {}
    if parameters is not None:
        if len(given) > 1:
            raise SettingsError("parameters are for one model; got a sequence of models: leave one of the two out")
        made = list(variants(given[0], parameters))
        errors = {i: m for i, m in enumerate(made) if isinstance(m, MjhcmcError)}
        listed, count = [m if isinstance(m, MuscleModel) else None for m in made], len(made)
        agreed("parameters", count, None)
    check_alike([m for m in listed if m is not None])
    moved, both = one_each("motions", motions, Motion, count)
    n = both or count or 1
    listed, moved = listed * n if len(listed) == 1 else listed, moved * n if len(moved) == 1 else moved
    return list(zip(listed, moved, strict=True)), errors


def _rows(name: str, given: ArrayLike | None, count: int) -> list[Any]:
    """What is given for all simulations, or in rows, once for each."""
    try:
        rows = None if given is None else np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        rows = None  # `prepare` names it
    if rows is None or rows.ndim < 2:
        return [given] * count
    agreed(f"initial_{name}", len(rows), count)
    return list(rows)

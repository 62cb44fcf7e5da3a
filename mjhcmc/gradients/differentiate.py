"""A solution's derivative, window after window; see `gradient`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjhcmc.gradients import windows as one
from mjhcmc.gradients.along import Nodes, Stages, Wanted, nodes_along, stages_along
from mjhcmc.gradients.feedback import Errors, gains
from mjhcmc.gradients.looks import Looker, States
from mjhcmc.gradients.reserves import Around, around_node, by_parameters, reserved, response, turned
from mjhcmc.gradients.tangents import propagate
from mjhcmc.methods.windows import Windows
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Reference
from mjhcmc.muscle_parameters import FALL, RISE
from mjhcmc.solution import Solution

Array = NDArray[np.float64]

_STATES = 8192
_TURNS = 2  # each takes what is left of the reserves' part down to a hundredth


class Derivatives(NamedTuple):
    """As of `gradient.Gradient`."""

    excitation: Array
    activation: Array
    qpos: Array
    qvel: Array
    reserve: Array
    margin: Array


class Feedback(NamedTuple):
    """Settings of `hcmc` that the derivative needs, and which of its first state was given."""

    gain: float
    authority: float
    given: tuple[bool, bool, bool]


def differentiate(
    windows: Windows,
    solution: Solution,
    wanted: Wanted,
    moves: Sequence[Array],
    feedback: Feedback,
    side: int,
    threads: int,
) -> Derivatives:
    """Differentiate a converged solution.

    Args:
        windows: that it solves.
        solution: by `hcmc`.
        wanted: parameters.
        moves: changes (T, nq) of the motion's samples.
        feedback: the settings.
        side: see `gradient`.
        threads: to look at states on.

    Raises:
        SimulationError: a limit, contact or equality is at work along the solution.
    """
    model, reference = windows.model, windows.reference
    n, nv, p, N = model.n_muscle, model.nv, wanted.count(model), solution.n_window
    step = float(solution.settings["physics_dt"])
    n_step = round(windows.dt / step)
    chunk = max(1, _STATES // (4 * n_step))  # windows whose stages are looked at together: bounds memory
    looker = Looker(model, 4 * min(N, chunk) * n_step, threads)
    before = np.vstack([_first_reserve(looker, windows, solution), solution.reserve])
    nodes = nodes_along(looker, States(solution.qpos, solution.qvel, solution.activation, before), wanted)
    starts = States(solution.qpos[:-1], solution.qvel[:-1], solution.activation[:-1], solution.reserve)
    moved = _moved_reference(windows, moves, p)
    rms = windows.rms_qacc
    least = rms, np.einsum("ki,kip->ip", reference.qacc, moved.qacc) / len(reference.qacc) / rms[:, None]
    excitation, reserve = np.zeros((N, n, p)), np.zeros((N, nv, p))
    activation, qpos, qvel = np.zeros((N + 1, n, p)), np.zeros((N + 1, nv, p)), np.zeros((N + 1, nv, p))
    margin = np.zeros((N, n))
    if not feedback.given[0]:
        qpos[0] = moved.qpos[0]
    if not feedback.given[1]:
        qvel[0] = moved.qvel[0]
    if not feedback.given[2]:
        activation[0] = _first_activation(windows, solution, nodes, before[0], moved, (qpos[0], qvel[0]), side)
    times = _times(model, wanted)
    large = reserved(nodes, solution.reserve).tolist()
    if large:
        at_ends = [k + 1 for k in large]
        states = States(*(part[at_ends] for part in (solution.qpos, solution.qvel, solution.activation, before)))
        slopes = by_parameters(model, states, wanted, threads)
    for k in range(N):
        if k % chunk == 0:
            some = slice(k, k + chunk)
            ended, u = solution.qpos[1:][some], solution.excitation[some]
            stages = stages_along(looker, States(*(part[some] for part in starts)), ended, u, step, n_step, wanted)
        missing = reference.qpos[k] - solution.qpos[k], reference.qvel[k] - solution.qvel[k]
        errors = Errors(*missing, moved.qpos[k] - qpos[k], moved.qvel[k] - qvel[k])
        own = gains(nodes, k, errors, (qpos[k], qvel[k]), least, feedback.authority, feedback.gain, windows.dt)
        choice = one.Choice(
            solution.excitation[k], model.excitation_range, solution.activation[k], solution.activation[k + 1],
            windows.sharing.min_activation, windows.sharing.disabled, solution.reserve[k],
            reference.qvel[k + 1] - solution.qvel[k + 1], reference.qpos[k + 1] - solution.qpos[k + 1], own.kp, own.kv,
        )  # fmt: skip
        ends = _ends(stages, k % chunk, times, step, (qpos[k], qvel[k], activation[k]))
        target = one.Moved(moved.qpos[k + 1], moved.qvel[k + 1], moved.qacc[k + 1], own.kp_slopes, own.kv_slopes)
        cost = _cost(windows, solution, k)
        at = around_node(nodes, k + 1)
        T = response(at, own.kp, own.kv, step, n_step)
        found = one.answer(choice, cost, nodes, k + 1, ends, activation[k], target, T, 0.0, side)
        for _ in range(_TURNS if k in large else 0):
            end = States(*(part[k + 1 : k + 2] for part in (solution.qpos, solution.qvel, solution.activation, before)))
            explicit = Around(*(part[large.index(k)] for part in slopes))
            turn = turned(looker, end, at, explicit, own, np.vstack(found.end), step, n_step)
            found = one.answer(choice, cost, nodes, k + 1, ends, activation[k], target, T, turn, side)
        excitation[k], reserve[k], margin[k] = found.excitation, found.reserve, found.margin
        qpos[k + 1], qvel[k + 1], activation[k + 1] = found.end
    return Derivatives(excitation, activation, qpos, qvel, reserve, margin)


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
        a, model.excitation_range, np.full(n, -1.0), a, windows.sharing.min_activation, windows.sharing.disabled,
        reserve, none, none, none, none,
    )  # fmt: skip
    p = moved.qpos.shape[2]
    ends = np.zeros((2 * nv + n, n + nv + p))
    ends[2 * nv :, :n] = np.eye(n)
    ends[:nv, n + nv :], ends[nv : 2 * nv, n + nv :] = start
    still = np.zeros((nv, p))
    target = one.Moved(still, still, moved.qacc[0], still, still)
    cost = _cost(windows, solution, -1)
    found = one.answer(choice, cost, nodes, 0, ends, np.zeros((n, p)), target, np.eye(nv), 0.0, side)
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

"""Everything that a solution's derivative needs to know along it: slopes at every stage of every step, and at nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from mjhcmc.activation import rate_of
from mjhcmc.dynamics import fiber_damping
from mjhcmc.errors import SimulationError
from mjhcmc.gradients.looks import STEP, Look, Looker, States, moved, slope
from mjhcmc.gradients.tangents import activation_slopes
from mjhcmc.model import MuscleModel
from mjhcmc.muscle_parameters import FIBER, FORCE, FORCE_KINDS, muscle_force, muscle_parameters

Array = NDArray[np.float64]

_WAYS = (0.0, 0.5, 0.5, 1.0)  # of a step, to the stages of classical Runge-Kutta
_WEIGHTS = (1 / 6, 1 / 3, 1 / 3, 1 / 6)
_REPLAYED = 1e-9  # rad, m or their rates: windows end where the solution says


@dataclass(frozen=True)
class Wanted:
    """What to differentiate by, in the order of the columns.

    Attributes:
        kinds: of `muscle_parameters.KINDS`; each muscle has one column a kind.
        models: changes of fields of ``MjModel``.
        n_motion: number of changes of the motion.
    """

    kinds: tuple[str, ...]
    models: tuple[Mapping[str, Array], ...]
    n_motion: int

    def count(self, model: MuscleModel) -> int:
        """Number of columns, p."""
        return len(self.kinds) * model.n_muscle + len(self.models) + self.n_motion


@dataclass(frozen=True)
class Stages:
    """Slopes at the stages of n_step physics steps of N windows; see `tangents.propagate`.

    Attributes:
        Jq: (N, n_step, 4, nv, nv).
        Jv: likewise.
        Ja: (N, n_step, 4, nv, n_muscle).
        Js: (N, n_step, 4, nv, nv).
        Jp: (N, n_step, 4, nv, p).
        rates: (N, n_step, 4, n_muscle, 5).
    """

    Jq: Array
    Jv: Array
    Ja: Array
    Js: Array
    Jp: Array
    rates: Array


@dataclass(frozen=True)
class Nodes:
    """What is seen at the N + 1 nodes, under the reserve of the window that ends there, and its slopes.

    Attributes:
        qacc: (N+1, nv).
        Jq: (N+1, nv, nv) of qacc, as the four that follow.
        Jv: (N+1, nv, nv).
        Ja: (N+1, nv, n_muscle).
        Js: (N+1, nv, nv).
        Jp: (N+1, nv, p).
        M: (N+1, nv, nv) kg m^2.
        M_slopes: (N+1, nv, nv, nv + nv + p) by position, velocity and parameter, as the three that follow.
        B: (N+1, nv, n_muscle) N m.
        B_slopes: (N+1, nv, n_muscle, nv + nv + p).
    """

    qacc: Array
    Jq: Array
    Jv: Array
    Ja: Array
    Js: Array
    Jp: Array
    M: Array
    M_slopes: Array
    B: Array
    B_slopes: Array


def stages_along(
    looker: Looker,
    nodes: States,
    qpos_end: Array,
    excitation: Array,
    step: float,
    n_step: int,
    wanted: Wanted,
) -> Stages:
    """Step every window once more from its node, keeping the stages, and look around them.

    Args:
        looker: of the model.
        nodes: (N) states at the starts of the windows, under their reserves.
        qpos_end: (N, nv) where they ended.
        excitation: (N, n_muscle).
        step: s, physics step.
        n_step: physics steps in a window.
        wanted: parameters.

    Raises:
        SimulationError: a constraint is at work, or the windows do not end where the solution says.
    """
    model = looker.model
    prm = model.activation_parameters
    kept: list[States] = []
    now = nodes
    for _ in range(n_step):
        rates: list[tuple[Array, Array, Array]] = []
        for way in _WAYS:
            at = now if not rates else _along(now, way * step, rates[-1])
            kept.append(at)
            rates.append((at.qvel, looker.look(at).qacc, _activation_rate(at.activation, excitation, prm)))
        qvel, qacc, rate = (np.tensordot(_WEIGHTS, np.stack(part), axes=1) for part in zip(*rates, strict=True))
        now = _along(now, step, (qvel, qacc, rate))
    off = float(np.abs(now.qpos - qpos_end).max())
    if not off <= _REPLAYED:
        raise SimulationError(
            f"the windows of model {model.name!r} do not end where the solution says (off by {off:.2g} rad or m): "
            "solve with the model and settings that the gradient is asked for"
        )
    shape = (len(nodes.qpos), n_step, 4)

    def ordered(values: Array) -> Array:
        """(N, n_step, 4, ...) of values by stage, then window."""
        whole = values.reshape(n_step, 4, shape[0], *values.shape[1:])
        return np.ascontiguousarray(np.moveaxis(whole, 2, 0))

    every = States(*(np.concatenate(group) for group in zip(*kept, strict=True)))
    u = np.tile(excitation, (4 * n_step, 1))
    slopes = np.empty((*every.activation.shape, 5))
    activation_slopes(every.activation, u, prm, model.excitation_range, slopes)
    seen, by_position, by_velocity, by_model = looker.around(every, wanted.models)
    Ja, Js, Jp = _answers(model, seen, every.activation, slope(by_model, "qacc"), wanted)
    parts = (slope(by_position, "qacc"), slope(by_velocity, "qacc"), Ja, Js, Jp, slopes)
    return Stages(*(ordered(part) for part in parts))


def _along(start: States, step: float, rates: tuple[Array, Array, Array]) -> States:
    qvel, qacc, rate = rates
    return start._replace(
        qpos=start.qpos + step * qvel, qvel=start.qvel + step * qacc, activation=start.activation + step * rate
    )


def _activation_rate(a: Array, u: Array, prm: Array) -> Array:
    found = np.empty_like(a)
    for i in range(a.shape[1]):
        for k in range(len(a)):
            found[k, i] = rate_of(a[k, i], u[k, i], prm[i, 0], prm[i, 1], prm[i, 2])
    return found


def _answers(
    model: MuscleModel, seen: Look, activation: Array, by_model: Array, wanted: Wanted
) -> tuple[Array, Array, Array]:
    """Ja (k, nv, n), Js (k, nv, nv), Jp (k, nv, p) of the acceleration at k states without constraints."""
    force = muscle_force(model, seen.length, seen.velocity)
    inverse = np.linalg.inv(seen.M)
    by_force = inverse @ np.swapaxes(seen.R, 1, 2)  # (k, nv, n)
    Ja = by_force * force.gain[:, None, :]
    damping = damping_slopes(model, damping_of(model, seen))
    Jp = np.zeros((len(activation), model.nv, wanted.count(model)))
    n = model.n_muscle
    for j, kind in enumerate(wanted.kinds):
        if kind in FORCE_KINDS:
            which = FORCE_KINDS.index(kind)
            change = force.gain_slopes[which] * activation + force.bias_slopes[which] + damping.get(kind, 0.0)
            Jp[:, :, j * n : (j + 1) * n] = by_force * change[:, None, :]
    first = len(wanted.kinds) * n
    if wanted.models:
        Jp[:, :, first : first + len(wanted.models)] = by_model
    return Ja, np.asarray(inverse, dtype=np.float64), Jp


def damping_of(model: MuscleModel, seen: Look) -> Array:
    """(k, n_muscle) N, fiber damping at k states, see `dynamics.fiber_damping`."""
    velocity = np.zeros((len(seen.qacc), model.mj_model.nu))
    velocity[:, model.mj_model.actuator_outadr[model.muscle_ids]] = seen.velocity
    return fiber_damping(model, SimpleNamespace(actuator_velocity=velocity, ten_velocity=seen.ten_velocity))


def damping_slopes(model: MuscleModel, damping: Array) -> dict[str, Array]:
    """(k, n_muscle) by F0 and by L0: fiber damping goes with F0/L0."""
    now = muscle_parameters(model)
    return {FORCE: damping / now[FORCE], FIBER: -damping / now[FIBER]}


def nodes_along(looker: Looker, states: States, wanted: Wanted) -> Nodes:
    """Look around the nodes; see `Nodes`.

    Args:
        looker: of the model.
        states: (N+1) the nodes, under the reserve of the window that ends there.
        wanted: parameters.
    """
    model = looker.model
    seen, by_position, by_velocity, by_model = looker.around(states, wanted.models)
    Ja, Js, Jp = _answers(model, seen, states.activation, slope(by_model, "qacc"), wanted)
    k, n, nv, p = len(states.qpos), model.n_muscle, model.nv, wanted.count(model)
    M_slopes, B_slopes = np.zeros((k, nv, nv, 2 * nv + p)), np.zeros((k, nv, n, 2 * nv + p))
    changed = [(_changed(model, d, STEP), _changed(model, d, -STEP)) for d in wanted.models]
    owners = [(model, model)] * (2 * nv) + changed
    first = 2 * nv + len(wanted.kinds) * n
    columns = [*range(2 * nv), *range(first, first + len(changed))]
    sides = [*by_position, *by_velocity, *by_model]
    for column, (up, down), (own_up, own_down) in zip(columns, sides, owners, strict=True):
        M_slopes[..., column] = (up.M - down.M) / (2 * STEP)
        B_slopes[..., column] = (_moments(own_up, up) - _moments(own_down, down)) / (2 * STEP)
    force, muscle = muscle_force(model, seen.length, seen.velocity), np.arange(n)
    for j, kind in enumerate(wanted.kinds):
        if kind in FORCE_KINDS:
            slopes = np.swapaxes(seen.R, 1, 2) * force.gain_slopes[FORCE_KINDS.index(kind)][:, None, :]
            B_slopes[:, :, muscle, 2 * nv + j * n + muscle] = slopes
    return Nodes(
        seen.qacc, slope(by_position, "qacc"), slope(by_velocity, "qacc"), Ja, Js, Jp, seen.M, M_slopes,
        _moments(model, seen), B_slopes,
    )  # fmt: skip


def _changed(model: MuscleModel, direction: Mapping[str, Array], step: float) -> MuscleModel:
    return replace(model, mj_model=moved(model, direction, step))


def _moments(model: MuscleModel, seen: Look) -> Array:
    """B (k, nv, n_muscle) N m."""
    return np.swapaxes(seen.R, 1, 2) * muscle_force(model, seen.length, seen.velocity).gain[:, None, :]

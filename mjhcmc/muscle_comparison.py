"""MuJoCo's muscles against the Hill model, rigid and compliant, along a solved movement."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc import dynamics, hill
from mjhcmc.activation import activation_after, excitation_for
from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.fiber_motion import compliant_motion
from mjhcmc.plant import MujocoPlant, State, physics_steps
from mjhcmc.summary import columns

if TYPE_CHECKING:
    from mjhcmc.solution import Solution

Array = NDArray[np.float64]

_SAME = 1e-9  # of maximum isometric force: rounding
_REACHED = 1e-6  # of activation: a window that ends nearer than that has reached its goal


@dataclass(frozen=True, eq=False)
class Track:
    """What the muscles of a solution go through, n even samples within and between its nodes.

    Attributes:
        time: (n,) s; every second one begins a step of fiber motion.
        activation: (n, m).
        length: (n, m) m, musculotendon length.
        velocity: (n, m) m/s, lengthening positive.
        force: (n, m) N, MuJoCo's muscle force with fiber damping, pulling positive.
        moment_arm: (n, m, nv) m, -dL/dq.
        node: (N+1,) index of each of the solution's nodes.
    """

    time: Array
    activation: Array
    length: Array
    velocity: Array
    force: Array
    moment_arm: Array
    node: NDArray[np.intp]


def check_step(step: float) -> None:
    """Refuse a step that is no positive number of seconds.

    Raises:
        SettingsError: naming it.
    """
    if not (np.isfinite(step) and step > 0):
        raise SettingsError(f"step must be positive, in seconds; got {step}")


def track_of(solution: Solution, step: float = 1e-3) -> Track:
    """Play each window of a solution from its recorded node, and note its muscles twice a step.

    A solution by RK4 is played by RK4 in half steps. With any other integrator other steps are another plant (see
    `integrators`): such a solution is played in its own, with forces as its integrator takes them, and what lies
    between the starts of two physics steps is the muscles' at states on the line between them.

    Args:
        solution: one that knows its model and its loads from outside.
        step: s, largest step; rounded down to a divisor of the window (or of the solution's physics step).

    Raises:
        SimulationError: the solution does not know its model or its loads.
        SettingsError: a step that is not positive.
    """
    if solution.model is None:
        raise SimulationError(
            "this solution was read from a file without its model: use Solution.load(path, model=...)"
        )
    if solution.hosted:
        raise SimulationError(
            "this solution's muscles are Hill muscles: compare one that MuJoCo's muscles drove (solve without a plant)"
        )
    if not solution.knows_surroundings:
        raise SimulationError("the loads from outside were not kept as a function of time: solve the motion again")
    check_step(step)
    if solution.integrator == "rk4":
        per = 2 * int(np.ceil(solution.dt / step - 1e-9))
        plant = MujocoPlant(solution.model, solution.dt / per, surroundings=solution.surroundings)
    else:
        plant = solution.plant()
        per, between = _samples(solution, step)
    rows = plant.mj_model.actuator_outadr[plant.model.muscle_ids]
    none = np.zeros(plant.model.nv)
    found: list[tuple[Array, ...]] = []

    def look() -> None:
        plant.forward()  # of one stepped otherwise than by RK4: at a state of `_between`, which is as it is stepped
        held = plant.get_state()
        parts, d = dynamics.muscle_moments(plant), plant.mj_data
        force = parts.gain * held.activation + parts.bias
        length, velocity = d.actuator_length[rows].copy(), d.actuator_velocity[rows].copy()
        found.append((np.array(d.time), held.activation, length, velocity, force, dynamics.moment_arms(plant)))

    for k in range(solution.n_window + 1):
        if solution.integrator != "rk4":
            for state in _between(plant, solution, k, between):
                plant.set_state(state)
                look()
            continue
        node = State(float(solution.time[k]), solution.qpos[k], solution.qvel[k], solution.activation[k], none)
        plant.set_state(node)
        look()
        for _ in range(per - 1 if k < solution.n_window else 0):
            plant.advance(solution.excitation[k], solution.reserve[k], 1)
            look()
    time, activation, length, velocity, force, arm = (np.array(values) for values in zip(*found, strict=True))
    return Track(time, np.clip(activation, 0, 1), length, velocity, force, arm, per * np.arange(solution.n_window + 1))


def _samples(solution: Solution, step: float) -> tuple[int, int]:
    """Samples of a window, an even number, and of a physics step, for a solution that RK4 did not step."""
    n_step = physics_steps(solution.dt, float(solution.settings["physics_dt"]))
    between = int(np.ceil(2 * solution.dt / n_step / step - 1e-9))
    between += (n_step * between) % 2
    return n_step * between, between


def _between(plant: MujocoPlant, solution: Solution, k: int, count: int) -> list[State]:
    """States within window k, count a physics step, with the velocity that forces are taken at; of the last node, one.

    Implicit integrators take forces at the velocity that a step ends with, see `MujocoPlant.forward_as_stepped`.
    """
    m, n_step = plant.model.mj_model, physics_steps(solution.dt, plant.physics_dt)

    def seen() -> State:
        held = plant.get_state()
        ahead = plant.physics_dt * plant.step_acceleration() if plant.scheme.implicit else 0.0
        return State(held.time, held.qpos, held.qvel + ahead, held.activation, held.warmstart)

    def enter(node: int) -> None:
        plant.set_state(solution.state(node))
        j = min(node, solution.n_window - 1)
        plant.set_input(solution.excitation[j], solution.reserve[j])

    enter(k)
    states = [seen()]
    if k == solution.n_window:
        return states
    for _ in range(n_step - 1):
        plant.advance(solution.excitation[k], solution.reserve[k], 1)
        states.append(seen())
    enter(k + 1)
    states.append(seen())
    found, way = [], np.empty(m.nv)
    for one, other in pairwise(states):
        mujoco.mj_differentiatePos(m, way, 1.0, one.qpos, other.qpos)
        for part in np.arange(count) / count:
            qpos = one.qpos.copy()
            mujoco.mj_integratePos(m, qpos, way, part)
            values = ((1 - part) * a + part * b for a, b in (
                (one.time, other.time), (one.qvel, other.qvel), (one.activation, other.activation),
            ))  # fmt: skip
            time, qvel, activation = values
            found.append(State(time, qpos, qvel, activation, one.warmstart))
    return found


@dataclass(frozen=True, eq=False)
class MuscleComparison:
    """MuJoCo's muscles and the Hill model's at the same activation, musculotendon length and velocity.

    Differences are the Hill model's less MuJoCo's. The compliant tendon's fiber is a state of its own, integrated from
    its equilibrium at the start.

    Attributes:
        track: what the muscles go through, and MuJoCo's force.
        model: the Hill muscles.
        rigid: (n, m) N, tendon force with rigid tendons.
        compliant: (n, m) N, with compliant tendons; None where the curves have no tendon.
        fiber_length: (n, m) m, of the compliant muscles; None likewise.
        needed_activation: (n, m), with which the rigid Hill muscle gives MuJoCo's force; NaN where none within
            [0, 1] does.
        beyond: (n, m) N, what is left of MuJoCo's force there: positive where the Hill muscle is too weak at full
            activation, negative where it pulls too much at none; else 0.
        needed_excitation: (N, m), constant over a window, that takes needed activation from node to node; NaN where
            none within [0, 1] does.
        excitation: (N, m), the solution's.
        net_joint_moment: (N+1, nv) N m or N, the solution's.
        joint_names: (nv,).
        movement: what was moved.
    """

    track: Track
    model: hill.HillModel
    rigid: Array
    compliant: Array | None
    fiber_length: Array | None
    needed_activation: Array
    beyond: Array
    needed_excitation: Array
    excitation: Array
    net_joint_moment: Array
    joint_names: tuple[str, ...]
    movement: str

    @property
    def muscle_names(self) -> tuple[str, ...]:
        """(m,)."""
        return self.model.muscles.names

    def forces(self) -> dict[str, Array]:
        """(n, m) N: the Hill model's tendon forces by kind of tendon."""
        return {"rigid": self.rigid} | ({} if self.compliant is None else {"compliant": self.compliant})

    def moment_difference(self, tendon: str) -> Array:
        """(n, m, nv) N m or N: what each muscle's difference of force does at each joint, R_ij dF_i.

        Args:
            tendon: ``"rigid"`` or ``"compliant"``.

        Raises:
            SettingsError: no such tendon here.
        """
        if tendon not in self.forces():
            raise SettingsError(f"tendon {tendon!r} was not compared: choose one of {', '.join(self.forces())}")
        return self.track.moment_arm * (self.forces()[tendon] - self.track.force)[:, :, None]

    def numbers(self) -> dict[str, Any]:
        """Plain values by muscle and by joint, as ``mjhcmc compare-muscles --json`` prints them."""
        F0, muscles = self.model.muscles.max_isometric_force, {}
        moments = {tendon: self.moment_difference(tendon) for tendon in self.forces()}
        for i, name in enumerate(self.muscle_names):
            row: dict[str, Any] = {
                "max_isometric_force_n": float(F0[i]),
                "mujoco_peak_force_n": float(self.track.force[:, i].max()),
                "mujoco_least_force_n": float(self.track.force[:, i].min()),
                "mujoco_pushes": float((self.track.force[:, i] < 0).mean()),
                "mujoco_peak_activation": float(self.track.activation[:, i].max()),
            }
            for tendon, force in self.forces().items():
                rms, peak = _rms_and_max(force[:, i] - self.track.force[:, i])
                percent = 100 / float(F0[i])
                row |= {f"{tendon}_rms_n": rms, f"{tendon}_max_n": peak}
                row |= {f"{tendon}_rms_percent_f0": rms * percent, f"{tendon}_max_percent_f0": peak * percent}
                for j, joint in enumerate(self.joint_names):
                    found = _rms_and_max(moments[tendon][:, i, j])
                    row |= dict(zip((f"{tendon}_{joint}_rms_nm", f"{tendon}_{joint}_max_nm"), found, strict=True))
            for what, needed, given in (
                ("activation", self.needed_activation, self.track.activation),
                ("excitation", self.needed_excitation, self.excitation),
            ):
                rms, peak = _rms_and_max(needed[:, i] - given[:, i])
                row |= {f"needed_{what}_rms": rms, f"needed_{what}_max": peak}
                row[f"{what}_not_reachable"] = float(np.isnan(needed[:, i]).mean())
            row |= {"too_weak": float((self.beyond[:, i] > 0).mean()), "too_weak_max_n": float(self.beyond[:, i].max())}
            row |= {"too_strong": float((self.beyond[:, i] < 0).mean())}
            row["too_strong_max_n"] = float(max(-self.beyond[:, i].min(), 0.0) + 0.0)
            bad = np.flatnonzero(self.beyond[:, i])
            row["first_not_reachable_s"] = float(self.track.time[bad[0]]) if bad.size else None
            muscles[name] = _plain(row)
        joints = {}
        for j, joint in enumerate(self.joint_names):
            row = {"peak_moment_nm": float(np.abs(self.net_joint_moment[:, j]).max())}
            for tendon, moment in moments.items():
                found = _rms_and_max(moment.sum(axis=1)[:, j])
                row |= dict(zip((f"{tendon}_rms_nm", f"{tendon}_max_nm"), found, strict=True))
            joints[joint] = row
        curves = self.model.curves.name
        return {"movement": self.movement, "curves": curves, "muscles": muscles, "joints": joints}

    def tables(self) -> dict[str, list[list[str]]]:
        """Rows of text, header first, of the tables ``muscles`` and ``joints``: `numbers` as a spreadsheet takes it."""
        values, tables = self.numbers(), {}
        for kind in ("muscles", "joints"):
            keys = list(next(iter(values[kind].values()), {}))
            cells = [[name, *["" if r[k] is None else repr(r[k]) for k in keys]] for name, r in values[kind].items()]
            tables[kind] = [[kind[:-1], *keys], *cells]
        return tables

    def screen(self) -> str:
        """The comparison as text."""
        values = self.numbers()
        tendons = list(self.forces())
        head = [f"{tendon} {what}" for tendon in tendons for what in ("rms N", "max N", "rms %F0", "max %F0")]
        keys = [
            f"{tendon}_{what}" for tendon in tendons for what in ("rms_n", "max_n", "rms_percent_f0", "max_percent_f0")
        ]
        forces = [["tendon force", "MuJoCo most N", "least N", *head]]
        needs = [["to give MuJoCo's force", "da rms", "da max", "du rms", "du max", "a none %", "too weak %", "by N",
                  "too strong %", "by N", "u none %"]]  # fmt: skip
        needs_keys = [f"{what}_{size}" for what in ("activation", "excitation") for size in ("rms", "max")]
        for name, row in values["muscles"].items():
            forces.append(
                [
                    name,
                    *[_figure(row[f"mujoco_{key}_force_n"]) for key in ("peak", "least")],
                    *[_figure(row[key]) for key in keys],
                ]
            )
            needs.append([
                name,
                *[_figure(row[f"needed_{what}"]) for what in needs_keys],
                _figure(100 * row["activation_not_reachable"]),
                _figure(100 * row["too_weak"]), _figure(row["too_weak_max_n"]),
                _figure(100 * row["too_strong"]), _figure(row["too_strong_max_n"]),
                _figure(100 * row["excitation_not_reachable"]),
            ])  # fmt: skip
        kinds = [(tendon, what) for tendon in tendons for what in ("rms", "max")]
        joints = [["joint moment", "peak N m", *[f"{tendon} {what} N m" for tendon, what in kinds]]]
        for name, row in values["joints"].items():
            found = [_figure(row[f"{tendon}_{what}_nm"]) for tendon, what in kinds]
            joints.append([name, _figure(row["peak_moment_nm"]), *found])
        title = (
            f"MuJoCo's muscles against {values['curves']} along the {self.movement} movement, same activation and path"
        )
        why = (
            "rigid tendon; a: activation, u: excitation; none: no value in [0, 1] gives it (left out of da and du):\n"
            "too weak at 1, or too strong at 0, also where MuJoCo's muscle pushes (least N below 0), as no tendon does"
        )
        return "\n".join([title, "", *columns(forces), "", *columns(joints), "", *columns(needs), why])


def compare_muscles(solution: Solution, model: hill.HillModel, step: float = 1e-3) -> MuscleComparison:
    """Compare a solution's muscles with Hill muscles.

    Args:
        solution: one that knows its model.
        model: Hill muscles in the solution's order (`hill_muscles.hill_model`); without a tendon curve, only rigid
            tendons are compared.
        step: s, largest step of the compliant muscles' fiber motion.

    Raises:
        SettingsError: muscles of other names, or a step that is not positive.
        SimulationError: a solution without model, or a movement that the Hill muscles cannot follow.
    """
    if model.muscles.names != tuple(solution.muscle_names):
        raise SettingsError(
            f"Hill muscles {', '.join(model.muscles.names)} are not the solution's: give them in its order"
        )
    track = track_of(solution, step)
    compliant = fiber = None
    try:
        rigid = hill.rigid_tendon(model, track.activation, track.length, track.velocity).tendon_force
        needed, beyond = needed_activation(model, track.force, track.length, track.velocity)
        if model.curves.tendon is not None:
            state = compliant_motion(model, track.time, track.activation, track.length, track.velocity)
            compliant, fiber = state.tendon_force, state.fiber_length
    except hill.HillError as error:
        raise SimulationError(f"{model.curves.name}: the Hill model cannot follow the movement: {error}") from error
    return MuscleComparison(
        track, model, rigid, compliant, fiber, needed, beyond, _needed_excitation(solution, needed[track.node]),
        solution.excitation, solution.net_joint_moment, solution.dof_names, str(solution.settings.get("motion", "")),
    )  # fmt: skip


def needed_activation(model: hill.HillModel, force: Array, length: Array, velocity: Array) -> tuple[Array, Array]:
    """Activation with which muscles with rigid tendons give a force, and what is beyond them.

    a = (F/(F0 cos(alpha)) - fPE - beta v)/(fL fV), force being affine in activation; where fV depends on activation
    (Thelen 2003), the same root by bisection, force rising with activation all the same.

    Args:
        model: m muscles.
        force: (n, m) N.
        length: (n, m) m, musculotendon length.
        velocity: (n, m) m/s.

    Returns:
        Activation (n, m), NaN where none in [0, 1] gives the force (a tendon never pushes); and (n, m) N, force less
        the nearest that the muscle can give, 0 where one does.
    """

    def pull(activation: Array | float) -> Array:
        return hill.rigid_tendon(model, activation, length, velocity).fiber_force_along_tendon

    low, half, high = pull(0.0), pull(0.5), pull(1.0)
    beyond = force - np.clip(force, np.maximum(low, 0.0), np.maximum(high, 0.0))
    beyond[np.abs(beyond) <= _SAME * model.muscles.max_isometric_force + np.zeros_like(beyond)] = 0.0
    span = high - low
    a = np.clip((force - low) / np.where(span > 0, span, 1.0), 0.0, 1.0)
    if not np.allclose(half, 0.5 * (low + high), rtol=1e-9, atol=1e-9):
        below, above = np.zeros_like(force), np.ones_like(force)
        for _ in range(52):
            a = 0.5 * (below + above)
            less = pull(a) < force
            below, above = np.where(less, a, below), np.where(less, above, a)
    return np.where(beyond == 0, a, np.nan), beyond


def _needed_excitation(solution: Solution, activation: Array) -> Array:
    """(N, m) from needed activation at the nodes (N+1, m); NaN where none takes a muscle from node to node."""
    model = solution.model
    assert model is not None
    name = solution.integrator
    own = 1e-3 if name == "rk4" else float(solution.settings["physics_dt"])
    per = max(1, round(solution.dt / own))
    step, prm = solution.dt / per, model.activation_parameters
    result = np.full_like(solution.excitation, np.nan)
    for k, (start, goal) in enumerate(pairwise(activation)):
        good = np.isfinite(start) & np.isfinite(goal)
        u = excitation_for(start[good], goal[good], prm[good], step, per, model.excitation_range[good], name)
        reached = np.abs(activation_after(start[good], u, prm[good], step, per, name) - goal[good]) < _REACHED
        result[k, good] = np.where(reached, u, np.nan)
    return result


def _rms_and_max(values: Array) -> tuple[float, float]:
    """Of the finite ones; NaN where there are none."""
    finite = values[np.isfinite(values)]
    return (float(np.sqrt(np.mean(finite**2))), float(np.abs(finite).max())) if finite.size else (np.nan, np.nan)


def _plain(row: dict[str, Any]) -> dict[str, Any]:
    return {key: None if isinstance(value, float) and np.isnan(value) else value for key, value in row.items()}


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}" if abs(value) < 1e3 else f"{value:.0f}"

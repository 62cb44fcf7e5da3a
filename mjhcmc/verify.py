"""Verdict: does the simulation hold? Reserves and tracking decide; replay shows that nothing else was at work.

Thresholds: reserves at most 5 % of the joint's peak moment (half of what OpenSim's published checklist for CMC
allows), tracking RMS at most 1 deg (Thelen & Anderson 2006, doi 10.1016/j.jbiomech.2005.02.010).
"""

from __future__ import annotations

import copy
from dataclasses import asdict, dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc import playback
from mjhcmc.errors import SimulationError
from mjhcmc.integrators import scheme_of
from mjhcmc.plant import physics_steps
from mjhcmc.solution import RESERVE_SHARE, Solution, WindowStatus, moment_scale
from mjhcmc.surroundings import Surroundings

MAX_RESERVE_SHARE = 0.05
MAX_TRACKING_RMS = np.deg2rad(1.0)
MAX_TRACKING_RMS_SLIDE = 0.01
"""m; the counterpart of 1 deg at a slide (OpenSim's checklist: pelvis translations within 1-2 cm)."""

MAX_MOMENT_SHARE = 0.1
"""Of the peak moment: where net joint moments depart by more from those that the user gave, the verdict says so."""

REPLAY_DT = 1e-4
"""s; a tenth of the default physics step, so that the replay also shows the step's own error.

Of solutions by RK4. With an integrator of first order another step is another plant, whose windows end elsewhere: such
solutions are replayed with the step that they were solved with, and their replay shows rounding alone. What the step
itself is off by is another figure, `integrator_error`.
"""

CONTINUOUS_DT = 2.5e-4
"""s, RK4's step that stands for continuous time in `integrator_error`; a finer one gives the same figures."""

_CHUNK = 65536  # control rows handed to the engine at once: bounds memory on long motions
_SATURATED = 0.999
_NAMED = 8


@dataclass(frozen=True)
class Verdict:
    """What decides, what it came to, and in words what is wrong.

    Attributes:
        passed: peak reserve at most 5 % of peak moment and tracking RMS at most 1 deg, at every joint.
        dof_names: (nv,).
        peak_reserve: (nv,) N m or N.
        peak_reserve_share: (nv,) of the joint's peak net moment (see `solution.moment_scale`).
        tracking_rms: (nv,) rad or m, over the nodes.
        tracking_max: (nv,) rad or m.
        replay_max_error: (nv,) rad or m, open loop from the first node against the recorded motion; None where the
            solution does not know its model, or where loads act from outside. Informs, never decides.
        replay_window_max_error: (nv,) rad or m, each window from its recorded node; None where the solution does not
            know its model or its loads.
        findings: one line each: joint, how much, when, which muscles.
        integrator: what stepped the plant, and the replay.
        physics_dt: s, its step; None where a file does not tell.
        integrator_error: (nv,) rad or m, see `integrator_error`; None under RK4, and where replay is None. Informs,
            never decides.
    """

    passed: bool
    dof_names: tuple[str, ...]
    peak_reserve: tuple[float, ...]
    peak_reserve_share: tuple[float, ...]
    tracking_rms: tuple[float, ...]
    tracking_max: tuple[float, ...]
    replay_max_error: tuple[float, ...] | None
    replay_window_max_error: tuple[float, ...] | None
    findings: tuple[str, ...]
    integrator: str = "rk4"
    physics_dt: float | None = None
    integrator_error: tuple[float, ...] | None = None

    def __repr__(self) -> str:
        """One line; `findings` say more."""
        share, name = max(zip(self.peak_reserve_share, self.dof_names, strict=True), default=(0.0, "no joint"))
        found = f", {len(self.findings)} findings" if self.findings else ""
        return (
            f"Verdict({'holds' if self.passed else 'FAILS'}: peak reserve at most "
            f"{100 * share:.2g} % of the joint's peak moment ({name}){found})"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON; angles in rad, as the names of the attributes say."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Verdict:
        """The inverse of `to_dict`, also after a trip through JSON."""
        tuples: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        return cls(**tuples)


def judge(solution: Solution) -> Verdict:
    """The verdict on a solution; replays it where it knows its model."""
    scale = moment_scale(solution.net_joint_moment)
    peak_reserve = np.abs(solution.reserve).max(axis=0)
    share = np.where(solution.is_root, 0.0, peak_reserve / scale)  # what acts at the root is a residual
    error = solution.tracking_error
    rms = np.sqrt((error**2).mean(axis=0))
    limit = np.where(solution.dof_is_rotation, MAX_TRACKING_RMS, MAX_TRACKING_RMS_SLIDE)
    open_loop = window = own = None
    known = solution.model is not None and not (solution.hosted and solution.muscles is None)
    if known and solution.knows_surroundings and solution.model is not None:
        difference = solution.model.coordinates.difference
        if not solution.external_load.any():  # under loads open loop is unstable: nothing brings it back
            open_loop = _floats(np.abs(difference(replay(solution), solution.qpos)).max(axis=0))
        window = _floats(np.abs(difference(replay_windows(solution), solution.qpos)).max(axis=0))
        own = None if solution.integrator == "rk4" else _floats(integrator_error(solution))
    return Verdict(
        passed=bool((share <= MAX_RESERVE_SHARE).all() and (rms <= limit).all() and not solution.interrupted),
        dof_names=solution.dof_names,
        peak_reserve=_floats(peak_reserve),
        peak_reserve_share=_floats(share),
        tracking_rms=_floats(rms),
        tracking_max=_floats(np.abs(error).max(axis=0)),
        replay_max_error=open_loop,
        replay_window_max_error=window,
        findings=tuple(_findings(solution, share, rms, limit)),
        integrator=solution.integrator,
        physics_dt=float(solution.settings["physics_dt"]) if "physics_dt" in solution.settings else None,
        integrator_error=own,
    )


def _floats(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def _findings(
    solution: Solution, share: NDArray[np.float64], rms: NDArray[np.float64], limit: NDArray[np.float64]
) -> list[str]:
    found = []
    if solution.interrupted:
        found.append(f"interrupted at {solution.time[-1]:.3f} s: the rest of the motion was not solved")
    stiff = np.flatnonzero(solution.status == WindowStatus.STIFF)
    if stiff.size:
        count = f"{stiff.size} window{'s' if stiff.size > 1 else ''}"
        found.append(f"{count}, first at {solution.time[stiff[0]]:.3f} s: {WindowStatus.STIFF.message}")
    scale = moment_scale(solution.net_joint_moment)
    for j, name in enumerate(solution.dof_names):
        unit = "N m" if solution.dof_is_rotation[j] else "N"
        limit_words = f"{100 * MAX_RESERVE_SHARE:g} %"
        verb = f"exceeds {limit_words}" if share[j] > MAX_RESERVE_SHARE else f"is within {limit_words}: a note"
        for what, values, against in (
            ("reserve", solution.reserve, f" ({verb})"),
            ("unmet moment", solution.shortfall - solution.reserve, ""),
        ):
            k = int(np.argmax(np.abs(values[:, j])))
            part = abs(float(values[k, j])) / scale[j]
            if part > RESERVE_SHARE and not solution.is_root[j]:  # there it is a residual, and reported as such
                found.append(
                    f"{name}: {what} of {_figure(values[k, j])} {unit} at {solution.time[k]:.3f} s, "
                    f"{_figure(100 * part)} % of the peak moment{against}; {_why(solution, j, k, float(values[k, j]))}"
                )
    given = solution.settings.get("joint_moment_difference", {})
    for j, name in enumerate(solution.dof_names):
        part = given.get(name, 0.0) / moment_scale(solution.net_joint_moment)[j]
        if part > MAX_MOMENT_SHARE:
            unit = "N m" if solution.dof_is_rotation[j] else "N"
            found.append(
                f"{name}: the net joint moment departs from the given one by up to {_figure(given[name])} {unit}, "
                f"{_figure(100 * part)} % of the peak moment"
            )
    for j, name in enumerate(solution.dof_names):
        if rms[j] > limit[j]:
            k = int(np.argmax(np.abs(solution.tracking_error[:, j])))
            unit, factor = ("deg", 180 / np.pi) if solution.dof_is_rotation[j] else ("m", 1.0)
            found.append(
                f"{name}: tracking RMS {_figure(rms[j] * factor)} {unit} exceeds {limit[j] * factor:g} {unit}; worst "
                f"{_figure(solution.tracking_error[k, j] * factor)} {unit} at {solution.time[k]:.3f} s"
            )
    return found


def _figure(value: float, digits: int = 3) -> str:
    """Rounded to so many digits, and written out: 1240 N m, not 1.24e+03."""
    return f"{float(f'{value:.{digits}g}'):g}"


def _why(solution: Solution, j: int, k: int, lacking: float) -> str:
    """What keeps the muscles from giving a moment at degree of freedom j in window k.

    Args:
        solution: what is judged.
        j: the degree of freedom.
        k: the window.
        lacking: N m or N.
    """
    u = solution.excitation[k]
    top = np.ones_like(u) if solution.model is None else solution.model.excitation_range[:, 1]
    names = np.array(solution.muscle_names)
    push = _push(solution, j, k)
    push = push if np.isinf(push).all() else push * np.sign(lacking)
    helps, most = push > 0, float(push[push > 0].sum())
    if most < abs(lacking):
        unit = "N m" if solution.dof_is_rotation[j] else "N"
        full, off = names[helps & (u >= _SATURATED * top)], names[(push < 0) & (u <= 1 - _SATURATED)]
        return (
            f"no strength: all muscles together have {_figure(most, 2)} {unit} that way there"
            + (f"; at full excitation: {_some(full)}" if full.size else "")
            + (f"; silent: {_some(off)}" if off.size else "")
        )
    full = names[helps & (u >= _SATURATED * top)]
    if full.size:
        return f"at full excitation: {_some(full)}"
    off = names[helps & (u <= 1 - _SATURATED)]
    return "no muscle at full excitation: what it takes, one-way muscles cannot give without moving other joints" + (
        f"; silent: {_some(off)}" if off.size else ""
    )


def _push(solution: Solution, j: int, k: int) -> NDArray[np.float64]:
    """(n_muscle,) N m or N, what muscles at full activation do at degree of freedom j at node k; inf: nothing tells."""
    if solution.model is None or solution.hosted:
        return np.full(len(solution.muscle_names), np.inf)
    from mjhcmc import dynamics

    plant, model = solution.plant(), solution.model
    plant.set_state(solution.state(k))
    plant.forward_as_stepped()
    B = dynamics.muscle_moments(plant).B
    if not model.roles.all_tracked:
        N = None if model.coupling is None else model.coupling.tangent(solution.qpos[k])
        W = model.coordinates.seen_from_tracked(N, dynamics.mass_matrix(plant))
        B = model.coordinates.full((W.T @ B).T).T
    return np.asarray(B[j])


def _some(names: NDArray[np.str_]) -> str:
    """At most _NAMED of them."""
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def replay(solution: Solution, physics_dt: float | None = None) -> NDArray[np.float64]:
    """Play the excitations and recorded reserves in a plain forward simulation, open loop, no feedback.

    Args:
        solution: with its model.
        physics_dt: s, physics step; rounded down to a divisor of the solution's dt. By default `REPLAY_DT`, or the
            solution's own where its integrator is not RK4. The integrator is always the solution's.

    Returns:
        (N+1, nq) rad or m at the nodes, starting from the recorded first node.

    Raises:
        SimulationError: the solution does not know its model or muscles (it was read from a file).
    """
    physics_dt = _replay_dt(solution) if physics_dt is None else physics_dt
    if solution.hosted or not (solution.surroundings or Surroundings()).empty:
        solution.plant(1e-3)  # knows what is missing
        return playback.replay(solution, physics_dt)
    engine = _Engine(solution, physics_dt)
    rows = [engine.state(0)]
    per_chunk = max(1, _CHUNK // engine.n_step)
    for first in range(0, solution.n_window, per_chunk):
        chunk = np.arange(first, min(first + per_chunk, solution.n_window))
        inputs = engine.inputs(chunk)
        inputs = inputs.reshape(-1, inputs.shape[-1])
        states = engine.roll(rows[-1][None], inputs[None], resume=first > 0)[0]
        rows.extend(states[engine.n_step - 1 :: engine.n_step])
    return engine.positions(np.array(rows))


def replay_windows(solution: Solution, physics_dt: float | None = None) -> NDArray[np.float64]:
    """As `replay`, but each window starts from its recorded node: errors do not grow along the motion.

    Returns:
        (N+1, nq) rad or m: the recorded first node, then the end of each window.
    """
    physics_dt = _replay_dt(solution) if physics_dt is None else physics_dt
    if solution.hosted or not (solution.surroundings or Surroundings()).empty:
        solution.plant(1e-3)  # knows what is missing
        return playback.replay_windows(solution, physics_dt)
    engine = _Engine(solution, physics_dt)
    rows = [engine.state(0)[None]]
    per_chunk = max(1, _CHUNK // engine.n_step)
    for first in range(0, solution.n_window, per_chunk):
        chunk = np.arange(first, min(first + per_chunk, solution.n_window))
        starts = np.array([engine.state(int(k)) for k in chunk])
        rows.append(engine.roll(starts, engine.inputs(chunk))[:, -1])
    return engine.positions(np.concatenate(rows))


def integrator_error(solution: Solution, physics_dt: float = CONTINUOUS_DT) -> NDArray[np.float64]:
    """Where windows end in continuous time, against where the solution's own integrator ends them.

    The replay of a solution by an integrator of first order is of the same steps, so it cannot tell whether these are
    fine enough. This can: RK4 plays each window from its recorded node under its excitation. Velocities of first-order
    integrators are those of half a step before (see `integrators`), so each window begins with v + s/2 A, A being the
    acceleration of the step that follows.

    Args:
        solution: with its model, by any integrator but RK4.
        physics_dt: s, RK4's step.

    Returns:
        (nv,) rad or m, the largest difference at the end of a window.

    Raises:
        SimulationError: the solution does not know its model (it was read from a file).
    """
    plant, qvel = solution.plant(), solution.qvel.copy()
    for k in range(len(qvel)):
        plant.set_state(solution.state(k))
        load = solution.external_load[k] if plant.surroundings.empty else 0.0
        plant.set_input(None, solution.reserve[min(k, solution.n_window - 1)] + load)
        qvel[k] += plant.physics_dt / 2 * plant.step_acceleration()
    continuous = replace(solution, settings={**solution.settings, "integrator": "rk4"}, qvel=qvel)
    ends = replay_windows(continuous, physics_dt=physics_dt)
    return np.asarray(np.abs(plant.model.coordinates.difference(ends, solution.qpos)).max(axis=0))


def _replay_dt(solution: Solution) -> float:
    return REPLAY_DT if solution.integrator == "rk4" else float(solution.settings["physics_dt"])


class _Engine:
    """MuJoCo's own rollout over a solution's inputs."""

    def __init__(self, solution: Solution, physics_dt: float) -> None:
        if solution.model is None:
            raise SimulationError(
                "this solution was read from a file and does not know its model: read it with Solution.load(path, "
                "model=...), or solve again to replay"
            )
        self.solution, self.model = solution, solution.model
        self.n_step = physics_steps(solution.dt, physics_dt)
        self.mj_model = copy.deepcopy(self.model.mj_model)
        self.mj_model.opt.timestep = solution.dt / self.n_step
        self.mj_model.opt.integrator = scheme_of(solution.integrator).code
        self.mj_data = mujoco.MjData(self.mj_model)
        self.full = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self.input = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)

    def state(self, k: int) -> NDArray[np.float64]:
        """Full physics state of node k."""
        d, s = self.mj_data, self.solution
        mujoco.mj_resetData(self.mj_model, d)
        d.time, d.qpos[:], d.qvel[:] = s.time[k], s.qpos[k], s.qvel[k]
        d.act[self.model.act_index] = s.activation[k]
        return self._get(self.full)

    def inputs(self, windows: NDArray[np.intp]) -> NDArray[np.float64]:
        """(n, n_step, n_input) excitation and reserve of windows, as the engine wants them."""
        d, s = self.mj_data, self.solution
        rows = []
        for k in windows:
            d.ctrl[self.model.ctrl_index] = s.excitation[k]
            d.qfrc_applied[:] = s.reserve[k]
            rows.append(self._get(self.input))
        return np.repeat(np.array(rows)[:, None], self.n_step, axis=1)

    def _get(self, signature: int) -> NDArray[np.float64]:
        out = np.empty(mujoco.mj_stateSize(self.mj_model, signature))
        mujoco.mj_getState(self.mj_model, self.mj_data, out, signature)
        return out

    def roll(
        self, starts: NDArray[np.float64], inputs: NDArray[np.float64], *, resume: bool = False
    ) -> NDArray[np.float64]:
        """(batch, n_step, n_state) from starts (batch, n_state) under inputs (batch, n_step, n_input).

        With resume, constraint solvers start from where the last roll ended, as in one long roll.
        """
        from mujoco import rollout

        warmstart = self.mj_data.qacc_warmstart.copy()[None] if resume else None
        states, _ = rollout.rollout(
            self.mj_model, self.mj_data, np.ascontiguousarray(starts), np.ascontiguousarray(inputs),
            control_spec=self.input, initial_warmstart=warmstart,
        )  # fmt: skip
        return np.asarray(states)

    def positions(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, nq) out of full physics states (n, n_state)."""
        first = mujoco.mj_stateSize(self.mj_model, int(mujoco.mjtState.mjSTATE_TIME))
        return states[:, first : first + self.mj_model.nq]

"""The task: follow a motion with muscle excitations. What is observed and rewarded, and when an episode ends.

At node k of the motion (a window of dt follows each), with z the tracked degrees of freedom:

    reward  r = (1 - w) exp(-mean_z (e/scale)^2) + w (1 - mean(a^2))

e is the tracking error (actual minus desired) at the window's END, a the activation there, w the weight of effort. The
reward is without unit and lies within 0..1, so that it never pays to end an episode early; an episode's return is at
most its number of windows. The first term is the usual kernel of motion imitation (Peng, Abbeel, Levine & van de Panne
2018, doi 10.1145/3197517.3201311), the second is the effort that HCMC makes least.

Observed, as named arrays in SI units and radians (`TrackingTask.parts`):

    position            (nq,)  coordinates of the model
    velocity            (nv,)
    activation          (n_muscle,)
    to_desired          (preview + 1, nz)  the way to where the motion is now, one window from now, ...
    desired_velocity    (preview + 1, nz)  there
    phase               (1,)  share of the motion that has passed
    time_left           (1,)  s
    muscle_length       (n_muscle,) m, where asked for, as
    muscle_velocity     (n_muscle,) m/s

An episode is *terminated* where a tracked degree of freedom is off by more than a bound, and *truncated* at the
motion's end. It begins on the motion, at its beginning or a random node, with the activations that hold the
acceleration there (the static allocation, see `methods.run`) or those of a solution, and with noise where asked for.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.cosine import COSINE_PERIODS
from mjhcmc.environments.remaining import remaining
from mjhcmc.environments.settings import Settings
from mjhcmc.environments.stiffness import USUAL_STEP, with_stable_step
from mjhcmc.errors import MotionError, SettingsError
from mjhcmc.methods.run import static_start
from mjhcmc.methods.windows import prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import State

if TYPE_CHECKING:
    from mjhcmc.external_loads import ExternalLoads
    from mjhcmc.solution import Solution

__all__ = ["Settings", "TrackingTask"]

Array = NDArray[np.float64]

_FAR = math.pi  # rad or m beyond the motion's extent, where observed positions are clipped
_FAST = 100.0  # rad/s or m/s likewise
_LONG = 10.0  # m and m/s, of muscles
_NOISE_AT_MOST = 0.5  # of the bound: an episode is not lost before it begins


class TrackingTask:
    """The task on a model and a motion; see the module's docstring.

    Args:
        model: or what `MuscleModel.load` takes.
        motion: or the name of a cosine movement (``"slow"``, ``"fast"``), or a motion file.
        loads: measured forces on the model's bodies.
        solution: of the same model, motion and dt: episodes begin in its states.
        settings: see `Settings`.

    Attributes:
        model: the model.
        motion: the motion.
        settings: the choices, with the physics step that is taken.
        windows: the motion's windows, as the methods see them.
        solution: in whose states episodes begin, or None.
        n_window: how many.
        parts: name and shape of what is observed, in order.

    Raises:
        SettingsError: an unknown setting, a value outside its valid ones, or a solution of something else.
        ModelError: the model cannot be loaded, or its root floats: what holds it up is no muscle's doing.
        MotionError: the motion does not fit the model.
        SimulationError: the physics step is unstable under the model's passive damping.

    A physics step of the user's own that is unstable where all muscles are fully active is told by an `MjhcmcWarning`.
    """

    def __init__(
        self,
        model: MuscleModel | str | Path | Any = "leg8",
        motion: Motion | str | Path = "slow",
        *,
        loads: ExternalLoads | None = None,
        solution: Solution | None = None,
        **settings: Any,
    ) -> None:
        s = Settings.of(settings)
        self.model = model = MuscleModel.load(model, integrator=s.integrator)
        self.motion = motion = _motion(motion, model)
        _check_root(model)
        step = USUAL_STEP if s.physics_dt is None else s.physics_dt
        windows = prepare(model, motion, s.dt, step, loads=loads, integrator=s.integrator)
        self.windows = with_stable_step(windows, given=s.physics_dt is not None)
        self.settings = replace(s, physics_dt=self.windows.physics_dt) if s.physics_dt is None else s
        self.n_window, self._space = self.windows.count, model.coordinates
        if solution is not None:
            check_solution(solution, self)
        self.solution, target = solution, self.windows.target
        self._qpos, self._qvel = target.qpos, self._space.of(target.qvel)
        hinge = self._space.of(model.dof_is_rotation)
        self._scale = np.where(hinge, s.error_scale, s.error_scale_slide)
        self._bound = np.where(hinge, s.bound, s.bound_slide)
        self.parts = self._parts()
        self._starts: dict[int, State] = {}

    @property
    def dof_names(self) -> tuple[str, ...]:
        """(nz,) the tracked degrees of freedom."""
        return tuple(self.model.dof_names[i] for i in self.model.roles.tracked)

    @property
    def time(self) -> Array:
        """(N+1,) s, the nodes."""
        return self.windows.reference.time

    def _parts(self) -> dict[str, tuple[int, ...]]:
        m, ahead = self.model, (self.settings.preview + 1, len(self.dof_names))
        parts: dict[str, tuple[int, ...]] = {
            "position": (m.nq,), "velocity": (m.nv,), "activation": (m.n_muscle,),
            "to_desired": ahead, "desired_velocity": ahead, "phase": (1,), "time_left": (1,),
        }  # fmt: skip
        if self.settings.muscle_paths:
            parts |= {"muscle_length": (m.n_muscle,), "muscle_velocity": (m.n_muscle,)}
        return parts

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of all that is observed, as it lies in a flat observation; ``+j``: j windows ahead."""
        m, names = self.model, list[str]()
        each = {
            "position": m.joint_names, "velocity": m.dof_names, "activation": m.muscle_names,
            "muscle_length": m.muscle_names, "muscle_velocity": m.muscle_names,
        }  # fmt: skip
        for part, shape in self.parts.items():
            if part in each:
                names += [f"{part}/{name}" for name in each[part]]
            elif len(shape) == 2:
                names += [f"{part}/{name}/+{j}" for j in range(shape[0]) for name in self.dof_names]
            else:
                names.append(part)
        return tuple(names)

    def bounds(self) -> tuple[dict[str, Array], dict[str, Array]]:
        """Lowest and highest value of each part; what is observed is clipped to them.

        They lie far beyond the usual bounds, where an episode ends: only a model that runs away meets them.
        """
        low, high = self._qpos.min(axis=0) - _FAR, self._qpos.max(axis=0) + _FAR
        most = {name: np.full(shape, _FAST) for name, shape in self.parts.items()}
        most["activation"] = np.ones(self.parts["activation"])
        most["to_desired"] = np.full(self.parts["to_desired"], float(np.max(high - low)) + _FAR)
        most["phase"], most["time_left"] = np.ones(1), np.array([self.time[-1] - self.time[0]])
        least = {name: -values for name, values in most.items()}
        for name in ("activation", "phase", "time_left"):
            least[name] = np.zeros(self.parts[name])
        least["position"], most["position"] = low, high
        for name in ("muscle_length", "muscle_velocity"):
            if name in self.parts:
                most[name] = np.full(self.parts[name], _LONG)
                least[name] = -most[name]
        return least, most

    def observe(self, node: int, state: State, paths: tuple[Array, Array] | None = None) -> dict[str, Array]:
        """What is observed at a node.

        Args:
            node: 0 .. N.
            state: of the model there.
            paths: (n_muscle,) m and m/s, musculotendon lengths and velocities, where they are asked for.
        """
        ahead = np.minimum(node + np.arange(self.settings.preview + 1), self.n_window)
        way = self._space.difference(self._qpos[ahead], np.broadcast_to(state.qpos, (len(ahead), self.model.nq)))
        found = {
            "position": state.qpos.copy(),
            "velocity": state.qvel.copy(),
            "activation": state.activation.copy(),
            "to_desired": np.array(self._space.of(way)),
            "desired_velocity": self._qvel[ahead].copy(),
            "phase": np.array([node / self.n_window]),
            "time_left": np.array([self.time[-1] - self.time[node]]),
        }
        if self.settings.muscle_paths:
            assert paths is not None  # who steps the model knows them
            found["muscle_length"], found["muscle_velocity"] = paths[0].copy(), paths[1].copy()
        return found

    def flat(self, observation: dict[str, Array]) -> Array:
        """(n_observation,) the parts one after the other, named by `observation_names`."""
        return np.concatenate([np.ravel(observation[name]) for name in self.parts])

    def tracking_error(self, node: int, state: State) -> Array:
        """(nz,) rad or m, actual minus desired, of the tracked degrees of freedom."""
        return np.asarray(self._space.of(self._space.difference(state.qpos, self._qpos[node])))

    def terms(self, node: int, state: State) -> tuple[float, float]:
        """What the reward of the window that ends at a node is made of: exp(-mean_z (e/scale)^2) and mean(a^2).

        0 and 1 of a model that ran away.
        """
        if not is_finite(state):
            return 0.0, 1.0
        error = self.tracking_error(node, state) / self._scale
        return math.exp(-float(np.mean(error**2))), float(np.mean(state.activation**2))

    def reward(self, node: int, state: State) -> float:
        """Of the window that ends at a node; see the module's docstring."""
        tracking, effort = self.terms(node, state)
        w = self.settings.effort_weight
        return float((1 - w) * tracking + w * (1 - effort))

    def is_lost(self, node: int, state: State) -> bool:
        """Whether the model has left the motion, or is nowhere at all."""
        return not is_finite(state) or bool(np.any(np.abs(self.tracking_error(node, state)) > self._bound))

    def first(self, rng: np.random.Generator, node: int | None = None) -> tuple[int, State]:
        """Where an episode begins.

        Args:
            rng: draws the node and the noise.
            node: begin at this one.

        Returns:
            The node, and the state there.

        Raises:
            SettingsError: there is no such node, or no window after it.
        """
        if node is None:
            node = int(rng.integers(self.n_window)) if self.settings.start == "random" else 0
        whole = isinstance(node, (int, np.integer)) and not isinstance(node, bool)
        if not (whole and 0 <= node < self.n_window):
            raise SettingsError(f"node must be one of 0 .. {self.n_window - 1}, where a window begins; got {node!r}")
        state = self._start_at(int(node))
        return int(node), self._disturbed(state, rng) if self.settings.noise else state

    def _start_at(self, node: int) -> State:
        """The state in which episodes begin at a node; each is found once."""
        if node not in self._starts:
            known = self.solution
            self._starts[node] = self._found_start(node) if known is None else known.state(node)
        return self._starts[node]

    def _found_start(self, node: int) -> State:
        target, model = self.windows.target, self.model
        unknown = np.full(model.n_muscle, np.nan)
        state = State(
            float(self.time[node]), target.qpos[node].copy(), target.qvel[node].copy(), unknown, np.zeros(model.nv)
        )
        return static_start(remaining(self.windows, node, state), reserves=False)[0]

    def _disturbed(self, state: State, rng: np.random.Generator) -> State:
        model, most = self.model, _NOISE_AT_MOST * self._bound
        off = np.clip(self.settings.noise * rng.standard_normal(len(most)), -most, most)
        qpos = self._space.moved(state.qpos, self._space.full(off))
        limits = model.joint_range
        qpos = np.clip(qpos, np.minimum(limits[:, 0], state.qpos), np.maximum(limits[:, 1], state.qpos))
        if model.coupling is not None:
            qpos = model.coupling.project(qpos)
        return replace(state, qpos=qpos)


def is_finite(state: State) -> bool:
    """Whether a state is one that a model can be in."""
    return all(bool(np.isfinite(part).all()) for part in (state.qpos, state.qvel, state.activation))


def _motion(motion: Motion | str | Path, model: MuscleModel) -> Motion:
    if isinstance(motion, Motion):
        return motion
    if isinstance(motion, str) and motion in COSINE_PERIODS:
        return Motion.cosine(model, motion)
    if not isinstance(motion, (str, Path)):
        raise SettingsError(f"a motion is a Motion, a name or a file; got {type(motion).__name__}")
    if not Path(motion).suffix:
        raise MotionError(
            f"no motion {str(motion)!r}: give one of {', '.join(sorted(COSINE_PERIODS))}, or a motion file"
        )
    return Motion.from_file(motion, model)


def _check_root(model: MuscleModel) -> None:
    roles = model.roles
    floating = [model.dof_names[i] for i in roles.tracked if roles.is_root[i]]
    if floating:
        raise SettingsError(
            f"model {model.name!r}: no muscle holds {', '.join(floating)} on the motion, and an environment has no "
            "residuals: let the motion lead them, model.with_roles(prescribed=[...])"
        )


def check_solution(solution: Solution, task: TrackingTask) -> None:
    """Refuse a solution that is not of the task's model, motion and dt.

    Raises:
        SettingsError: naming what differs.
    """
    from mjhcmc.solution import Solution

    if not isinstance(solution, Solution):
        raise SettingsError(f"a solution is a Solution; got {type(solution).__name__}: use Solution.load")
    windows = task.windows
    if solution.muscle_names != task.model.muscle_names or solution.coordinate_names != task.model.joint_names:
        raise SettingsError(
            f"the solution is of model {solution.settings.get('model')!r}, with other joints or muscles than "
            f"{task.model.name!r}: solve on this model"
        )
    if solution.hosted:
        raise SettingsError("the solution was driven by Hill muscles, which environments do not step: solve without")
    same_times = len(solution.time) == len(task.time) and np.allclose(solution.time, task.time, atol=1e-9)
    if not same_times or not np.allclose(solution.qpos_desired, windows.reference.qpos, atol=1e-9):
        raise SettingsError(
            f"the solution is of another motion or dt than motion {task.motion.name!r} at {windows.dt:g} s: solve "
            "with these"
        )
    if solution.integrator != windows.scheme.name:
        raise SettingsError(
            f"the solution is by integrator {solution.integrator!r}, the task by {windows.scheme.name!r}: choose one"
        )

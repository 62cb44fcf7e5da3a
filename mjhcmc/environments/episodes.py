"""Episodes: the model stepped under a policy's excitations, and what it gets for it. No library is needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.environments.task import TrackingTask, is_finite
from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.plant import MujocoPlant, State

Array = NDArray[np.float64]

Policy = Callable[[int, State], Array]
"""What chooses excitations (n_muscle,) at a node, from the state there."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a window came to.

    Attributes:
        observation: at its end, by part.
        reward: see `task`.
        terminated: the model has left the motion.
        truncated: the motion is over.
        tracking: exp(-mean_z (e/scale)^2) of the reward.
        effort: its mean(a^2).
        tracking_error: (nz,) rad or m.
    """

    observation: dict[str, Array]
    reward: float
    terminated: bool
    truncated: bool
    tracking: float
    effort: float
    tracking_error: Array


class Episodes:
    """The task's model, window after window, on the plant that the methods step.

    Args:
        task: what is to be done.

    Attributes:
        task: the same.
        plant: what is stepped.
        node: where the episode is.

    Raises:
        SettingsError: task is none.
    """

    def __init__(self, task: TrackingTask) -> None:
        check_task(task)
        self.task, windows = task, task.windows
        self.plant = MujocoPlant(
            task.model, windows.physics_dt, surroundings=windows.surroundings, integrator=windows.scheme.name
        )
        self.node, self._over = 0, True
        self._none, self._limits = np.zeros(task.model.nv), task.model.excitation_range
        self._bounds = task.bounds()

    @property
    def state(self) -> State:
        """The model's state, a copy."""
        return self.plant.get_state()

    def reset(self, rng: np.random.Generator, node: int | None = None) -> dict[str, Array]:
        """Begin an episode; see `TrackingTask.first`. Returns what is observed."""
        self.node, state = self.task.first(rng, node)
        import mujoco

        mujoco.mj_resetData(self.plant.mj_model, self.plant.mj_data)
        self.plant.set_state(state)
        self._over = False
        return self.observe()

    def observe(self) -> dict[str, Array]:
        """What is observed now, within the task's bounds."""
        return self._within(self.task.observe(self.node, self.state, self.paths()))

    def paths(self) -> tuple[Array, Array] | None:
        """(n_muscle,) m and m/s, musculotendon lengths and velocities, where the task asks for them."""
        if not self.task.settings.muscle_paths:
            return None
        self.plant.forward()  # leaves the state as it is, where the constraint solver starts from too
        ids = self.task.model.muscle_ids
        return self.plant.mj_data.actuator_length[ids].copy(), self.plant.mj_data.actuator_velocity[ids].copy()

    def step(self, excitation: ArrayLike) -> Outcome:
        """One window under an excitation (n_muscle,), which is clipped to what the model lets through.

        Raises:
            SettingsError: it has another shape, or is not finite.
            SimulationError: the episode is over, or was never begun.
        """
        if self._over:
            raise SimulationError("the episode is over, or has not begun: call reset first")
        u = checked(excitation, self._limits)
        task, windows = self.task, self.task.windows
        self.plant.advance(u, self._none, windows.n_step)
        self.node += 1
        self.plant.mj_data.time = task.time[self.node]
        state = self.state
        lost, done = task.is_lost(self.node, state), self.node == task.n_window
        self._over = lost or done
        tracking, effort = task.terms(self.node, state)
        reward, error = task.reward(self.node, state), task.tracking_error(self.node, state)
        if not is_finite(state):  # what is observed must be a number all the same
            state = replace(state, **{k: np.nan_to_num(getattr(state, k)) for k in ("qpos", "qvel", "activation")})
            self.plant.set_state(state)
        observation = self._within(task.observe(self.node, state, self.paths()))
        return Outcome(observation, reward, lost, done and not lost, tracking, effort, error)

    def _within(self, observation: dict[str, Array]) -> dict[str, Array]:
        low, high = self._bounds
        return {name: np.clip(values, low[name], high[name]) for name, values in observation.items()}


def check_task(task: object) -> None:
    """Raise SettingsError unless this is a `TrackingTask`."""
    if not isinstance(task, TrackingTask):
        raise SettingsError(f"a task is a TrackingTask; got {type(task).__name__}: use TrackingTask(model, motion)")


def generator(random: Any, name: str) -> np.random.Generator:
    """A random generator of a seed or a generator; None: one of its own.

    Raises:
        SettingsError: it is neither.
    """
    try:
        return np.random.default_rng(random)
    except (TypeError, ValueError):
        raise SettingsError(f"{name} must be a seed, 0 or more, or a generator; got {random!r}") from None


def check_count(name: str, value: object, least: int) -> None:
    """Raise SettingsError unless a value is a whole number, at least so large."""
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < least:
        raise SettingsError(f"{name} must be a whole number, at least {least}; got {value!r}")


def checked(excitation: ArrayLike, limits: Array) -> Array:
    """(n_muscle,) an excitation, clipped to limits (n_muscle, 2).

    Raises:
        SettingsError: it has another shape, or is not finite.
    """
    try:
        u = np.asarray(excitation, dtype=np.float64)
    except (TypeError, ValueError):
        raise SettingsError(
            f"an action is one excitation a muscle, {len(limits)} numbers; got {excitation!r}"
        ) from None
    if u.shape != (len(limits),):
        raise SettingsError(f"an action is one excitation a muscle, {len(limits)} numbers; got shape {u.shape}")
    if not np.isfinite(u).all():
        raise SettingsError(f"an action holds finite excitations within 0..1; got {u.tolist()}")
    return np.asarray(np.clip(u, limits[:, 0], limits[:, 1]))


def returns(task: TrackingTask, policies: dict[str, Policy], *, n: int = 10, seed: int = 0) -> dict[str, Any]:
    """What policies earn on the same starts.

    Args:
        task: what is to be done.
        policies: by name.
        n: episodes each.
        seed: of the starts.

    Returns:
        By name an array (n, 3): return, windows that the episode lasted, and windows that it might have.

    Raises:
        SettingsError: n or seed outside its valid values; no task, or policies that are no dict of functions.
    """
    check_task(task)
    check_count("n", n, 1)
    check_count("seed", seed, 0)
    if not isinstance(policies, dict) or not all(callable(policy) for policy in policies.values()):
        raise SettingsError(f"policies are functions by name, in a dict; got {policies!r}")
    episodes, found = Episodes(task), {}
    for name, policy in policies.items():
        rows = []
        for i in range(n):
            episodes.reset(np.random.default_rng([seed, i]))
            first, earned, over = episodes.node, 0.0, False
            while not over:
                outcome = episodes.step(policy(episodes.node, episodes.state))
                earned += outcome.reward
                over = outcome.terminated or outcome.truncated
            rows.append((earned, episodes.node - first, task.n_window - first))
        found[name] = np.array(rows, dtype=np.float64)
    return found

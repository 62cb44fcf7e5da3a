"""The task as a dm_control environment; dm_control has no wheels for Python 3.13 and later."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.environments.episodes import checked, generator
from mjhcmc.environments.task import TrackingTask
from mjhcmc.errors import SettingsError
from mjhcmc.plant import MujocoPlant, State

try:
    from dm_control import mujoco as dm_mujoco
    from dm_control.mujoco.wrapper import MjModel
    from dm_control.rl import control
    from dm_env import specs
except ImportError as error:
    raise SettingsError(
        "dm_control is not installed: pip install dm-control (Python 3.12 or earlier), or use the Gymnasium environment"
    ) from error

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel
    from mjhcmc.motion import Motion

Array = NDArray[np.float64]


def tracking(
    model: MuscleModel | Any = "leg8",
    motion: Motion | Any = "slow",
    dt: float = 0.01,
    *,
    random: int | np.random.Generator | None = None,
    flat: bool = False,
    **choices: Any,
) -> Any:
    """A dm_control environment in which muscles are to follow a motion; see `task`.

    ``environment.physics.step`` does what the methods' plant does, to the last bit: MuJoCo's steps of physics_dt under
    one excitation. dm_control's own extra call after it brings derived quantities up to date and changes no state.

    Args:
        model: or what `MuscleModel.load` takes.
        motion: or the name of a cosine movement, or a motion file.
        dt: s, control window.
        random: seed or generator of the episodes' beginnings.
        flat: observe one array; False: the task's parts by name.
        choices: loads, solution and settings, see `TrackingTask`.

    Returns:
        A ``dm_control.rl.control.Environment``. Where loads act or joints are prescribed its physics leads them at each
        step (`LedPhysics`). A model that runs away within a window raises dm_control's own
        ``PhysicsError``, unless ``physics.suppress_physics_errors()`` is in force.

    Raises:
        SettingsError: an unknown setting or a value outside its valid ones; the rest as `TrackingTask`.
    """
    rng = generator(random, "random")
    task = TrackingTask(model, motion, dt=dt, **choices)
    windows = task.windows
    surroundings = windows.surroundings
    plant = MujocoPlant(
        task.model, windows.physics_dt, surroundings=surroundings, integrator=windows.scheme.name
    )  # fmt: skip
    kind = dm_mujoco.Physics if surroundings.empty else LedPhysics
    physics = kind.from_model(MjModel(plant.mj_model))
    if not surroundings.empty:
        physics.lead_by(plant)
    return control.Environment(physics, DmTask(task, rng, flat=flat), n_sub_steps=windows.n_step, flat_observation=flat)


class LedPhysics(dm_mujoco.Physics):  # type: ignore[misc]  # dm_control has no types
    """dm_control's physics of a model with loads from outside or prescribed joints: the plant leads it."""

    def lead_by(self, plant: MujocoPlant) -> None:
        """Let a plant of this physics' model step its data."""
        plant.mj_model, plant.mj_data = self.model.ptr, self.data.ptr
        self._plant = plant

    def copy(self, share_model: bool = False) -> LedPhysics:
        """As dm_control's: one with data of its own, led by a plant of its own."""
        new, plant = super().copy(share_model), self._plant
        new.lead_by(plant.at(plant.physics_dt, plant.surroundings))
        return new  # type: ignore[no-any-return]

    def __getstate__(self) -> Any:
        """Refused: what acts from outside is a function of time, which no file holds."""
        raise SettingsError("a physics with loads or prescribed joints cannot be pickled: make the environment again")

    def step(self, nstep: int = 1) -> None:
        """As dm_control's, under the controls as they stand."""
        plant, model = self._plant, self._plant.model
        with self.check_invalid_state():
            plant.advance(plant.mj_data.ctrl[model.ctrl_index].copy(), np.zeros(model.nv), nstep)
            mujoco.mj_step1(plant.mj_model, plant.mj_data)


class DmTask(control.Task):  # type: ignore[misc]  # dm_control has no types
    """The task in dm_control's shape.

    Args:
        task: what is to be done.
        random: seed or generator of the episodes' beginnings.
        flat: whether the environment flattens what is observed.

    Attributes:
        task: the same.
        node: where the episode is.
    """

    def __init__(
        self, task: TrackingTask, random: int | np.random.Generator | None = None, *, flat: bool = False
    ) -> None:
        self.task, self.node, self._flat = task, 0, flat
        self._rng = generator(random, "random")
        self._limits, self._bounds = task.model.excitation_range, task.bounds()
        self._begun = False

    def state(self, physics: Any) -> State:
        """The model's state, a copy; what `FeedbackExpert` asks for."""
        d, index = physics.data, self.task.model.act_index
        return State(float(d.time), d.qpos.copy(), d.qvel.copy(), d.act[index], d.qacc_warmstart.copy())

    def initialize_episode(self, physics: Any) -> None:
        """Put the physics where an episode begins."""
        self.node, state = self.task.first(self._rng)
        d = physics.data
        d.time = state.time
        d.qpos[:], d.qvel[:], d.act[self.task.model.act_index] = state.qpos, state.qvel, state.activation
        self._begun = False

    def before_step(self, action: Any, physics: Any) -> None:
        """Hold the action, excitations (n_muscle,), over the window.

        Raises:
            SettingsError: the action has another shape, or is not finite.
        """
        u = checked(action, self._limits)
        physics.data.ctrl[self.task.model.ctrl_index] = u
        self._look(physics)
        self._begun = True

    def _look(self, physics: Any) -> None:
        """At an episode's beginning dm_control looks at the state as if no muscle acted: look again, with them."""
        if not self._begun:
            mujoco.mj_step1(physics.model.ptr, physics.data.ptr)

    def after_step(self, physics: Any) -> None:
        """The next node."""
        self.node += 1
        physics.data.time = self.task.time[self.node]

    def action_spec(self, physics: Any) -> Any:
        """Excitations within what the model lets through, named by muscle."""
        low, high = self._limits.T
        names = "\t".join(self.task.model.muscle_names)  # as dm_control writes them
        return specs.BoundedArray((len(low),), np.float64, low, high, name=names)

    def get_observation(self, physics: Any) -> OrderedDict[str, Array]:
        """The task's parts, within its bounds."""
        paths = None
        self._look(physics)
        if self.task.settings.muscle_paths:  # dm_control keeps what follows from positions and velocities up to date
            ids = self.task.model.muscle_ids
            paths = physics.data.actuator_length[ids].copy(), physics.data.actuator_velocity[ids].copy()
        low, high = self._bounds
        seen = self.task.observe(self.node, self.state(physics), paths)
        # dm_control sorts the names of other mappings before it flattens them
        return OrderedDict((name, np.clip(values, low[name], high[name])) for name, values in seen.items())

    def observation_spec(self, physics: Any) -> dict[str, Any]:
        """The parts with their bounds; flat, ``observations`` named by `TrackingTask.observation_names`."""
        low, high = self._bounds
        if self._flat:
            names = "\t".join(self.task.observation_names)
            least, most = self.task.flat(low), self.task.flat(high)
            return {control.FLAT_OBSERVATION_KEY: specs.BoundedArray(least.shape, np.float64, least, most, name=names)}
        return {
            name: specs.BoundedArray(shape, np.float64, low[name], high[name], name=name)
            for name, shape in self.task.parts.items()
        }

    def get_reward(self, physics: Any) -> float:
        """Of the window that has just ended."""
        return self.task.reward(self.node, self.state(physics))

    def get_termination(self, physics: Any) -> float | None:
        """Discount 0 where the model has left the motion, 1 at the motion's end; None: it goes on."""
        if self.task.is_lost(self.node, self.state(physics)):
            return 0.0
        return 1.0 if self.node == self.task.n_window else None

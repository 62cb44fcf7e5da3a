"""The task as a Gymnasium environment (extra ``learn``), registered as ``mjhcmc/Track-v0``.

import gymnasium
import mjhcmc.environments.gym

env = gymnasium.make("mjhcmc/Track-v0", model="leg8", motion="fast", start="random")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.environments.episodes import Episodes
from mjhcmc.environments.task import TrackingTask
from mjhcmc.errors import SettingsError

try:
    import gymnasium
    from gymnasium import spaces
except ImportError as error:
    raise SettingsError('gymnasium is not installed: pip install "mjhcmc[learn]"') from error

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel
    from mjhcmc.plant import State

ID = "mjhcmc/Track-v0"

Array = NDArray[np.float64]


class TrackingEnv(gymnasium.Env[Any, Array]):
    """Follow a motion with muscle excitations; see `task`.

    Actions are excitations (n_muscle,) within what the model lets through; others are clipped. Observations are one
    array, named by ``task.observation_names``, or a dict of the task's parts. ``reset(options={"node": k})`` begins at
    node k. ``info`` holds time (s), node, tracking_error (nz,), and what makes the reward, tracking and effort, where
    the window ends or the episode begins; see `TrackingTask.terms`.

    Args:
        model: or what `MuscleModel.load` takes.
        motion: or the name of a cosine movement, or a motion file.
        render_mode: None or ``"rgb_array"``.
        flat: observe one array; False: a dict.
        width: of pictures, pixels.
        height: likewise.
        camera: a camera's name; None: the model's first, or MuJoCo's free camera.
        choices: loads, solution and settings, see `TrackingTask`.

    Attributes:
        task: the task.
        action_names: (n_muscle,) the muscles.

    Raises:
        SettingsError: an unknown setting, or a value outside its valid ones; the rest as `TrackingTask`.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 100}  # noqa: RUF012 - Gymnasium's way

    def __init__(
        self,
        model: Any = "leg8",
        motion: Any = "slow",
        *,
        render_mode: str | None = None,
        flat: bool = True,
        width: int = 480,
        height: int = 480,
        camera: str | None = None,
        **choices: Any,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise SettingsError(f"render_mode must be None or 'rgb_array'; got {render_mode!r}")
        for name, value in (("width", width), ("height", height)):
            if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 1:
                raise SettingsError(f"{name} must be a number of pixels; got {value!r}")
        self.task = task = TrackingTask(model, motion, **choices)
        _check_camera(task.model, camera)
        self.render_mode, self._flat = render_mode, flat
        self._size, self._camera = (height, width), camera
        self._canvas: Any = None
        self.metadata = {**self.metadata, "render_fps": round(1 / task.settings.dt)}
        self._episodes = Episodes(task)
        self.action_names = task.model.muscle_names
        limits = task.model.excitation_range
        self.action_space = spaces.Box(limits[:, 0], limits[:, 1], dtype=np.float64)
        low, high = task.bounds()
        self.observation_space: Any
        if flat:
            self.observation_space = spaces.Box(task.flat(low), task.flat(high), dtype=np.float64)
        else:
            each: dict[str, spaces.Space[Any]] = {
                name: spaces.Box(low[name], high[name], dtype=np.float64) for name in task.parts
            }
            self.observation_space = spaces.Dict(each)

    @property
    def node(self) -> int:
        """Where the episode is, 0 .. N."""
        return self._episodes.node

    @property
    def state(self) -> State:
        """The model's state, a copy; what `FeedbackExpert` asks for."""
        return self._episodes.state

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; see `gymnasium.Env.reset`.

        Raises:
            SettingsError: an unknown option, or no window begins at the node.
        """
        super().reset(seed=seed)
        if not isinstance(options, (dict, type(None))):
            raise SettingsError(f"reset takes its options in a dict, such as {{'node': 3}}; got {options!r}")
        options = dict(options or {})
        node = options.pop("node", None)
        if options:
            raise SettingsError(f"reset knows no option {next(iter(options))!r}: it takes 'node'")
        observation = self._episodes.reset(self.np_random, node)
        error, terms = self.task.tracking_error(self.node, self.state), self.task.terms(self.node, self.state)
        return self._seen(observation), self._info(error, *terms)

    def step(self, action: Array) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One window under an action; see `gymnasium.Env.step`.

        Raises:
            SettingsError: the action has another shape, or is not finite.
            SimulationError: the episode is over.
        """
        o = self._episodes.step(action)
        info = self._info(o.tracking_error, o.tracking, o.effort)
        return self._seen(o.observation), o.reward, o.terminated, o.truncated, info

    def _seen(self, observation: dict[str, Array]) -> Any:
        return self.task.flat(observation) if self._flat else observation

    def _info(self, error: Array, tracking: float, effort: float) -> dict[str, Any]:
        time = float(self.task.time[self.node])
        return {"time": time, "node": self.node, "tracking_error": error, "tracking": tracking, "effort": effort}

    def render(self) -> Any:
        """(height, width, 3) a picture, where render_mode is ``"rgb_array"``; else None.

        Raises:
            OutputError: no OpenGL is to be had for drawing without a screen.
        """
        if self.render_mode is None:
            return None
        import mujoco

        from mjhcmc.offscreen import Canvas

        m = self._episodes.plant.mj_model
        if self._canvas is None:
            height, width = self._size
            self._canvas = Canvas(m, width, height)
        data = mujoco.MjData(m)  # looking must not change what is stepped
        state = self.state
        data.qpos[:], data.act[self.task.model.act_index] = state.qpos, state.activation
        mujoco.mj_forward(m, data)
        looks = mujoco.MjvOption()
        looks.flags[mujoco.mjtVisFlag.mjVIS_ACTUATOR] = True  # with mjVIS_ACTIVATION: tendons take the colour of act
        looks.flags[mujoco.mjtVisFlag.mjVIS_ACTIVATION] = True
        camera = self._camera if self._camera is not None else 0 if m.ncam else None
        return self._canvas.picture(m, data, camera, looks)

    def close(self) -> None:
        """Let go of the canvas."""
        if self._canvas is not None:
            self._canvas.close()
            self._canvas = None


def _check_camera(model: MuscleModel, camera: str | None) -> None:
    m = model.mj_model
    names = [m.camera(i).name for i in range(m.ncam)]
    if camera is not None and camera not in names:
        known = f"it has {', '.join(names)}" if names else "it has none: leave camera out"
        raise SettingsError(f"model {model.name!r} has no camera {camera!r}: {known}")


def register() -> None:
    """Make ``gymnasium.make("mjhcmc/Track-v0")`` known; importing this module does."""
    if ID not in gymnasium.registry:
        gymnasium.register(ID, entry_point="mjhcmc.environments.gym:TrackingEnv")


register()

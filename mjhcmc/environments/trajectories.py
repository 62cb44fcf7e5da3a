"""What the expert saw and did, episode after episode: a data set to learn from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.checks import is_number
from mjhcmc.environments.episodes import Episodes
from mjhcmc.environments.expert import FeedbackExpert
from mjhcmc.environments.task import TrackingTask
from mjhcmc.errors import OutputError, SettingsError, SimulationError

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel
    from mjhcmc.motion import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Windows of episodes, one a row, in the order in which they were stepped.

    Attributes:
        time: (n,) s, at the window's start, on the motion's clock.
        episode: (n,) its number, from 0.
        motion: (n,) number of its motion.
        node: (n,) where the window begins.
        observation: (n, n_observation) at its start.
        action: (n, n_muscle) the expert's excitation.
        applied: (n, n_muscle) what was applied: the action, with the disturbance if there was one.
        reward: (n,) of the window.
        terminated: (n,) the model left the motion in it.
        truncated: (n,) it was the motion's last.
        observation_names: (n_observation,).
        action_names: (n_muscle,) the muscles.
        metadata: model and its hash, motions, settings, seed, versions.
    """

    time: Array
    episode: NDArray[np.int64]
    motion: NDArray[np.int64]
    node: NDArray[np.int64]
    observation: Array
    action: Array
    applied: Array
    reward: Array
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    observation_names: tuple[str, ...]
    action_names: tuple[str, ...]
    metadata: dict[str, Any]

    @property
    def returns(self) -> Array:
        """(n_episode,) what each episode earned."""
        return np.bincount(self.episode, weights=self.reward).astype(np.float64)

    def save(self, path: str | Path) -> Path:
        """Write them: .npz has the arrays by name, .parquet one column a number; both hold the metadata as JSON.

        Raises:
            OutputError: another suffix, or a file that cannot be written.
        """
        path = Path(path)
        if path.suffix not in (".npz", ".parquet"):
            raise OutputError(f"{path}: unknown suffix {path.suffix!r}: use .npz or .parquet")
        temporary = path.with_name(path.name + ".part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with temporary.open("wb") as file:
                (self._write_npz if path.suffix == ".npz" else self._write_parquet)(file)
            temporary.replace(path)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error}): choose a folder that you may write to") from error
        finally:
            if temporary.exists():
                temporary.unlink()
        return path

    def _notes(self) -> str:
        names = {"observation_names": self.observation_names, "action_names": self.action_names}
        return json.dumps({**self.metadata, **names})

    def _write_npz(self, file: Any) -> None:
        arrays = {name: getattr(self, name) for name in _COLUMNS + _MATRICES}
        np.savez_compressed(file, **arrays, metadata=np.array(self._notes()))

    def _write_parquet(self, file: Any) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns: dict[str, Any] = {name: getattr(self, name) for name in _COLUMNS}
        for part, names in (("observation", self.observation_names), ("action", self.action_names),
                            ("applied", self.action_names)):  # fmt: skip
            columns |= {f"{part}/{name}": values for name, values in zip(names, getattr(self, part).T, strict=True)}
        table = pa.table(columns).replace_schema_metadata({"mjhcmc.trajectories": self._notes()})
        pq.write_table(table, file)

    @classmethod
    def load(cls, path: str | Path) -> Trajectories:
        """Read what `save` wrote.

        Raises:
            OutputError: the file cannot be read, or holds something else.
        """
        path = Path(path)
        try:
            if path.suffix == ".npz":
                with np.load(path, allow_pickle=False) as file:
                    arrays = {name: file[name] for name in _COLUMNS + _MATRICES}
                    notes = json.loads(str(file["metadata"]))
            else:
                arrays, notes = _read_parquet(path)
        except (OSError, KeyError, ValueError) as error:
            raise OutputError(
                f"{path}: holds no expert trajectories ({error}): give a .npz or .parquet that save wrote"
            ) from error
        seen, actions = tuple(notes.pop("observation_names")), tuple(notes.pop("action_names"))
        return cls(**arrays, observation_names=seen, action_names=actions, metadata=notes)


_MATRICES = ("observation", "action", "applied")
_COLUMNS = ("time", "episode", "motion", "node", "reward", "terminated", "truncated")


def _read_parquet(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    notes = json.loads((table.schema.metadata or {})[b"mjhcmc.trajectories"])
    arrays = {name: table[name].to_numpy() for name in _COLUMNS}
    for part in _MATRICES:
        names = notes["observation_names" if part == "observation" else "action_names"]
        arrays[part] = np.column_stack([table[f"{part}/{name}"].to_numpy() for name in names])
    return arrays, notes


def expert_trajectories(
    model: MuscleModel | Any = "leg8",
    motions: Sequence[Motion | Any] | Motion | Any = ("slow",),
    n: int = 10,
    *,
    disturbance: float = 0.0,
    seed: int = 0,
    **choices: Any,
) -> Trajectories:
    """Let HCMC follow motions from its own states, and write down what it saw and did.

    With a disturbance the excitations that are applied are the expert's and noise, and it answers from wherever that
    leads: what is recorded shows how to come back (Laskey, Lee, Fox, Dragan & Goldberg 2017, arXiv:1703.09327).

    Args:
        model: or what `MuscleModel.load` takes.
        motions: one or several, or names or files of them.
        n: episodes of each motion.
        disturbance: standard deviation of the noise on what is applied, within 0..1.
        seed: of starts and noise.
        choices: settings of the task (dt, start, noise, ...), see `environments.task`.

    Returns:
        All windows of all episodes.

    Raises:
        SettingsError: a setting outside its valid values; the rest as `TrackingTask` and `FeedbackExpert`.
    """
    if not isinstance(n, (int, np.integer)) or isinstance(n, bool) or n < 1:
        raise SettingsError(f"n must be a number of episodes, at least 1; got {n!r}")
    if not (is_number(disturbance) and 0 <= disturbance <= 1):
        raise SettingsError(f"disturbance must lie within 0..1; got {disturbance!r}")
    several: list[Any] = list(motions) if isinstance(motions, (list, tuple)) else [motions]
    if not several:
        raise SettingsError("no motions: give at least one")
    tasks = [TrackingTask(model, motion, **choices) for motion in several]
    rows: dict[str, list[Any]] = {item: [] for item in _COLUMNS + _MATRICES}
    for j, task in enumerate(tasks):
        episodes, expert = Episodes(task), FeedbackExpert(task)
        for i in range(n):
            _run(episodes, expert, np.random.default_rng([seed, j, i]), disturbance, rows, (j * n + i, j))
    first = tasks[0]
    return Trajectories(
        **{name: np.array(values) for name, values in rows.items()},
        observation_names=first.observation_names,
        action_names=first.model.muscle_names,
        metadata=_metadata(tasks, n, disturbance, seed),
    )


def _run(
    episodes: Episodes,
    expert: FeedbackExpert,
    rng: np.random.Generator,
    disturbance: float,
    rows: dict[str, list[Any]],
    which: tuple[int, int],
) -> None:
    """One episode; its windows are added to rows."""
    task, over = episodes.task, False
    limits = task.model.excitation_range
    seen = episodes.reset(rng)
    while not over:
        node, state = episodes.node, episodes.state
        try:
            action = expert(node, state)
        except SimulationError as error:
            raise SimulationError(
                f"episode {which[0]}: the expert finds no way on at {state.time:.4g} s ({error}): choose less noise or "
                "disturbance, or a smaller bound"
            ) from error
        applied = action
        if disturbance:
            applied = np.clip(action + disturbance * rng.standard_normal(len(action)), limits[:, 0], limits[:, 1])
        outcome = episodes.step(applied)
        over = outcome.terminated or outcome.truncated
        row = {
            "time": task.time[node], "episode": which[0], "motion": which[1], "node": node,
            "observation": task.flat(seen), "action": action, "applied": applied, "reward": outcome.reward,
            "terminated": outcome.terminated, "truncated": outcome.truncated,
        }  # fmt: skip
        for name, value in row.items():
            rows[name].append(value)
        seen = outcome.observation


def _metadata(tasks: Sequence[TrackingTask], n: int, disturbance: float, seed: int) -> dict[str, Any]:
    import mujoco

    from mjhcmc import __version__

    model = tasks[0].model
    binary = np.empty(mujoco.mj_sizeModel(model.mj_model), np.uint8)
    mujoco.mj_saveModel(model.mj_model, None, binary)
    return {
        "model": model.name,
        "model_sha256": hashlib.sha256(binary.tobytes()).hexdigest(),
        "motions": [task.motion.name for task in tasks],
        "episodes_per_motion": int(n),
        "disturbance": float(disturbance),
        "seed": int(seed),
        "settings": asdict(tasks[0].settings),
        "versions": {"mjhcmc": __version__, "mujoco": mujoco.__version__, "numpy": np.__version__},
    }

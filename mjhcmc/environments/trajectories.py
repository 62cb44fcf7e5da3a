"""What the expert saw and did, episode after episode: a data set to learn from."""

from __future__ import annotations

import hashlib
import json
import math
import warnings
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.checks import is_number
from mjhcmc.environments.episodes import Episodes, check_count
from mjhcmc.environments.expert import FeedbackExpert
from mjhcmc.environments.task import TrackingTask
from mjhcmc.errors import MjhcmcWarning, OutputError, SettingsError, SimulationError
from mjhcmc.io.files import written_whole
from mjhcmc.run_facts import compiled_sha256, versions_here

if TYPE_CHECKING:
    from mjhcmc.external_loads import ExternalLoads
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
        next_observation: (n, n_observation) at its end.
        reward: (n,) of the window.
        terminated: (n,) the model left the motion in it.
        truncated: (n,) it was the motion's last, or the last that the expert had an answer for.
        observation_names: (n_observation,).
        action_names: (n_muscle,) the muscles.
        metadata: model, motions, loads and solution, each with a SHA-256 of what it holds; settings, seed, versions,
            platform; and ``given_up``: episode, node, time and why, where the expert had no answer.
    """

    time: Array
    episode: NDArray[np.int64]
    motion: NDArray[np.int64]
    node: NDArray[np.int64]
    observation: Array
    action: Array
    applied: Array
    next_observation: Array
    reward: Array
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    observation_names: tuple[str, ...]
    action_names: tuple[str, ...]
    metadata: dict[str, Any]

    @property
    def returns(self) -> Array:
        """(n_episode,) what each episode earned."""
        most = len(self.metadata.get("motions", ())) * self.metadata.get("episodes_per_motion", 0)
        return np.bincount(self.episode, weights=self.reward, minlength=most).astype(np.float64)

    def save(self, path: str | Path) -> Path:
        """Write them: .npz has the arrays by name, .parquet one column a number; both hold the metadata as JSON.

        Raises:
            OutputError: another suffix, or a file that cannot be written.
        """
        path = Path(path)
        if path.suffix not in (".npz", ".parquet"):
            raise OutputError(f"{path}: unknown suffix {path.suffix!r}: use .npz or .parquet")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error}): choose a folder that you may write to") from error
        with written_whole(path) as temporary, temporary.open("wb") as file:
            (self._write_npz if path.suffix == ".npz" else self._write_parquet)(file)
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
        for part in _MATRICES:
            names = self.observation_names if part in _SEEN else self.action_names
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
            arrays, notes = (_read_npz if path.suffix == ".npz" else _read_parquet)(path)
            seen, actions = tuple(notes.pop("observation_names")), tuple(notes.pop("action_names"))
            _check_shapes(arrays, len(seen), len(actions))
        except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile, zlib.error) as error:
            why = " ".join(str(error).split()) or type(error).__name__
            raise OutputError(
                f"{path}: holds no expert trajectories ({why}): give a .npz or .parquet that save wrote"
            ) from error
        return cls(**arrays, observation_names=seen, action_names=actions, metadata=notes)


_SEEN = ("observation", "next_observation")
_MATRICES = ("observation", "action", "applied", "next_observation")
_COLUMNS = ("time", "episode", "motion", "node", "reward", "terminated", "truncated")


def _notes(text: str | bytes) -> dict[str, Any]:
    notes = json.loads(text)
    if not isinstance(notes, dict):
        raise ValueError("its metadata is no object")
    return notes


def _read_npz(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        return {name: file[name] for name in _COLUMNS + _MATRICES}, _notes(str(file["metadata"]))


def _check_shapes(arrays: dict[str, Any], n_seen: int, n_action: int) -> None:
    n = len(arrays["time"])
    for name, array in arrays.items():
        shape = (n,) if name in _COLUMNS else (n, n_seen if name in _SEEN else n_action)
        if array.shape != shape:
            raise ValueError(f"{name} has shape {array.shape}, not {shape}")


def _read_parquet(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    notes = _notes((table.schema.metadata or {})[b"mjhcmc.trajectories"])
    arrays = {name: table[name].to_numpy() for name in _COLUMNS}
    for part in _MATRICES:
        names = notes["observation_names" if part in _SEEN else "action_names"]
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

    Where the expert finds no way on, the episode ends there: its last window is marked truncated, the metadata's
    ``given_up`` has it, and an `MjhcmcWarning` tells how many there were.

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
        SimulationError: the expert finds no way on in the first window of any episode.
    """
    check_count("n", n, 1)
    check_count("seed", seed, 0)
    if not (is_number(disturbance) and 0 <= disturbance <= 1):
        raise SettingsError(f"disturbance must lie within 0..1; got {disturbance!r}")
    several: list[Any] = list(motions) if isinstance(motions, (list, tuple)) else [motions]
    if not several:
        raise SettingsError("no motions: give at least one")
    tasks = [TrackingTask(model, motion, **choices) for motion in several]
    rows: dict[str, list[Any]] = {item: [] for item in _COLUMNS + _MATRICES}
    given_up: list[dict[str, Any]] = []
    for j, task in enumerate(tasks):
        episodes, expert = Episodes(task), FeedbackExpert(task)
        for i in range(n):
            which = (j * n + i, j)
            found = _run(episodes, expert, np.random.default_rng([seed, j, i]), disturbance, rows, which)
            given_up += [] if found is None else [found]
    if given_up:
        _tell(given_up, n * len(tasks), rows)
    first = tasks[0]
    return Trajectories(
        **{name: np.array(values) for name, values in rows.items()},
        observation_names=first.observation_names,
        action_names=first.model.muscle_names,
        metadata={**_metadata(tasks, n, disturbance, seed), "given_up": given_up},
    )


def _tell(given_up: list[dict[str, Any]], n: int, rows: dict[str, list[Any]]) -> None:
    first = given_up[0]
    where = f"the first, episode {first['episode']}, at {first['time']:.4g} s: {first['why']}"
    remedy = "choose less noise or disturbance, or a smaller bound"
    if not rows["time"]:
        raise SimulationError(f"the expert has no answer at the start of any episode ({where}): {remedy}")
    warnings.warn(
        f"{len(given_up)} of {n} episodes end early, where the expert has no answer ({where}): {remedy}",
        MjhcmcWarning,
        stacklevel=3,
    )


def _run(
    episodes: Episodes,
    expert: FeedbackExpert,
    rng: np.random.Generator,
    disturbance: float,
    rows: dict[str, list[Any]],
    which: tuple[int, int],
) -> dict[str, Any] | None:
    """One episode; its windows are added to rows. Returns where the expert gave up, if it did."""
    task, over = episodes.task, False
    limits = task.model.excitation_range
    seen = episodes.reset(rng)
    first = episodes.node
    while not over:
        node, state = episodes.node, episodes.state
        try:
            action = expert(node, state)
        except SimulationError as error:
            if node > first:
                rows["truncated"][-1] = True
            return {"episode": which[0], "node": node, "time": float(task.time[node]), "why": str(error)}
        applied = action
        if disturbance:
            applied = np.clip(action + disturbance * rng.standard_normal(len(action)), limits[:, 0], limits[:, 1])
        outcome = episodes.step(applied)
        over = outcome.terminated or outcome.truncated
        row = {
            "time": task.time[node], "episode": which[0], "motion": which[1], "node": node,
            "observation": task.flat(seen), "action": action, "applied": applied,
            "next_observation": task.flat(outcome.observation), "reward": outcome.reward,
            "terminated": outcome.terminated, "truncated": outcome.truncated,
        }  # fmt: skip
        for name, value in row.items():
            rows[name].append(value)
        seen = outcome.observation
    return None


def _metadata(tasks: Sequence[TrackingTask], n: int, disturbance: float, seed: int) -> dict[str, Any]:
    from mjhcmc import __version__

    first, here = tasks[0], versions_here()
    loads, solution = first.windows.surroundings.loads, first.solution
    return {
        "model": first.model.name,
        "model_sha256": compiled_sha256(first.model),
        "motions": [_motion(task) for task in tasks],
        "loads": None if loads is None else {"name": loads.name, "sha256": _sha256(*_of_loads(loads))},
        "solution": None if solution is None else _sha256(solution.qpos, solution.qvel, solution.activation),
        "episodes_per_motion": int(n),
        "disturbance": float(disturbance),
        "seed": int(seed),
        "settings": {name: _plain(value) for name, value in asdict(first.settings).items()},
        "versions": {"mjhcmc": __version__, **here["versions"]},
        "platform": here["platform"],
    }


def _motion(task: TrackingTask) -> dict[str, Any]:
    """Name of the task's motion, its windows, and what tells it from others: the desired motion at its nodes."""
    desired = task.windows.reference
    return {
        "name": task.motion.name,
        "windows": task.n_window,
        "physics_dt": task.windows.physics_dt,
        "sha256": _sha256(desired.time, desired.qpos, desired.qvel),
    }


def _of_loads(loads: ExternalLoads) -> tuple[Any, ...]:
    """What they do; neither what they are called nor what was noticed of them."""
    frames = loads.force_frame, loads.point_frame
    return loads.time, loads.body, loads.force, loads.torque, loads.point, *frames


def _sha256(*parts: Any) -> str:
    """Of arrays with their shapes, and of whatever else by its representation."""
    digest = hashlib.sha256()
    for part in parts:
        is_array = isinstance(part, np.ndarray)
        digest.update(repr((part.dtype.str, part.shape) if is_array else part).encode())
        digest.update(np.ascontiguousarray(part).tobytes() if is_array else b"")
    return digest.hexdigest()


def _plain(value: Any) -> Any:
    """A setting as JSON has it, which knows no infinity."""
    if isinstance(value, np.generic):
        value = value.item()
    return "infinite" if isinstance(value, float) and math.isinf(value) else value

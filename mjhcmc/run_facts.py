"""run.json: what a run was made with, so that it can be told apart from others and made again."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import warnings
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjhcmc.errors import MjhcmcWarning
from mjhcmc.io.files import written_whole

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel

RUN_FILE = "run.json"

_COUNTED = ("mujoco", "numpy", "scipy", "numba", "qpsolvers")  # packages whose versions can move a result
_SHIPPED, _IN_FOLDER, _FILE = "shipped", "folder", "file"
_BLOCK = 1 << 20


def run_facts(
    *,
    command: Sequence[str],
    model: Mapping[str, Any],
    inputs: Sequence[Mapping[str, Any]] = (),
    solution: Path,
    wall_time: float | None,
    interrupted: bool = False,
    notices: Sequence[str] = (),
) -> dict[str, Any]:
    """What run.json holds.

    Args:
        command: the arguments of ``mjhcmc`` as they were typed.
        model: from `model_facts`.
        inputs: from `input_facts`, of the files as they were read.
        solution: the file of the solution; its hash ties the facts to it.
        wall_time: s, of the solve; a first one holds the compiling of kernels. None where it is not known.
        interrupted: whether the solve was stopped before the motion's end.
        notices: what was noticed: noise, columns not used, loads left out, refinements.

    Returns:
        Plain values: ``mjhcmc``, ``command``, ``date`` (UTC), ``versions``, ``platform``, ``model``, ``inputs``,
        ``solution``, ``status`` (finished or interrupted), ``wall_time_s``, ``notices``.
    """
    from mjhcmc import __version__

    return {
        "mjhcmc": __version__,
        "command": list(command),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        **versions_here(),
        "model": dict(model),
        "inputs": [dict(each) for each in inputs],
        "solution": {"file": solution.name, "sha256": sha256_of(solution)},
        "status": "interrupted" if interrupted else "finished",
        "wall_time_s": wall_time,
        "notices": list(notices),
    }


def model_facts(model: MuscleModel, source: str | Path, *, in_folder: bool = False) -> dict[str, Any]:
    """Which model was driven: its name, where it came from, the hash of its file and of what MuJoCo made of it.

    A file's hash misses what it includes; the compiled model's holds everything, but changes with MuJoCo's version.

    Args:
        model: as it was driven.
        source: a shipped name or a path.
        in_folder: whether it lies beside the solution (the leg that ``--osim`` makes).
    """
    from mjhcmc.assets import model_path

    shipped = None if in_folder or not is_shipped_name(source) else model_path(str(source))
    path = Path(source) if shipped is None else shipped
    kind = _SHIPPED if shipped is not None else _IN_FOLDER if in_folder else _FILE
    return {
        "name": model.name,
        "source": kind,
        "shipped_name": str(source) if kind == _SHIPPED else None,
        "path": {_SHIPPED: None, _IN_FOLDER: path.name, _FILE: str(path.resolve())}[kind],
        "sha256": sha256_of(path),
        "compiled_sha256": compiled_sha256(model),
    }


def is_shipped_name(source: str | Path) -> bool:
    """Whether `MuscleModel.load` takes this for the name of a model that mjhcmc ships."""
    from mjhcmc.assets import model_names

    return str(source) in model_names()


def input_facts(files: Iterable[tuple[str, Path]]) -> list[dict[str, Any]]:
    """What each file is to the run, its absolute path, hash and size in bytes.

    Args:
        files: what it is, and the file.
    """
    return [
        {"what": what, "path": str(path.resolve()), "sha256": sha256_of(path), "bytes": path.stat().st_size}
        for what, path in files
    ]


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file, in hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def compiled_sha256(model: MuscleModel) -> str:
    """The SHA-256 of a model as MuJoCo would save it in binary; it depends on MuJoCo's version."""
    import mujoco
    import numpy as np

    m = model.mj_model
    buffer = np.empty(mujoco.mj_sizeModel(m), dtype=np.uint8)
    mujoco.mj_saveModel(m, None, buffer)
    return hashlib.sha256(buffer.tobytes()).hexdigest()


def versions_here() -> dict[str, Any]:
    """Versions of what can move a result, and the platform: plain values."""
    return {
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in _COUNTED}},
        "platform": {
            "system": platform.system(),
            "release": platform.platform(),
            "machine": platform.machine(),
            "cores": os.cpu_count(),
        },
    }


def made_by(run: Mapping[str, Any] | None) -> tuple[Any, ...]:
    """What the bytes of a compiled model depend on: MuJoCo's version, system and machine.

    Args:
        run: what run.json holds; None: here and now.
    """
    facts = versions_here() if run is None else run
    found = []
    for name, key in (("versions", "mujoco"), ("platform", "system"), ("platform", "machine")):
        part = facts.get(name)
        found.append(part.get(key) if isinstance(part, dict) else None)
    return tuple(found)


def write_run(folder: Path, facts: Mapping[str, Any]) -> str:
    """Write run.json into a folder, whole or not at all; the path written."""
    path = folder / RUN_FILE
    with written_whole(path) as temporary:
        temporary.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    return str(path)


def read_run(folder: Path, solution: Path) -> dict[str, Any]:
    """The run.json beside a solution; empty where there is none, or it tells of another solution.

    One that cannot be read is left out with a notice: the solution stands without it.
    """
    path = folder / RUN_FILE
    if not path.is_file():
        return {}
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(facts, dict):
            raise ValueError("holds no object")
    except (OSError, ValueError) as error:
        why = " ".join(str(error).split())
        warnings.warn(f"{path}: left out, cannot be read ({why}): solve again to write it", MjhcmcWarning, stacklevel=2)
        return {}
    told = facts.get("solution")
    if not isinstance(told, dict) or told.get("sha256") != sha256_of(solution):
        return {}
    return facts


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None

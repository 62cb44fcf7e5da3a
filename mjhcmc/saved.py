"""open_saved: a solution from the folder that ``mjhcmc solve`` wrote, with the model that was driven."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mjhcmc.errors import MjhcmcError, OutputError
from mjhcmc.run_facts import RUN_FILE, compiled_sha256, is_shipped_name, made_by, read_run, sha256_of
from mjhcmc.solution import Solution

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel

_TABLE = "solution.parquet"
_SUBJECT = "model.xml"  # the leg that solve --osim writes
_GIVE = "name it with model (--model)"
_MANY = 6  # folders in a message
_TRIED = 5  # nodes at which forces are compared
_FORCE_TOLERANCE = 1e-6  # of the largest: another MuJoCo may round otherwise, another parameter shows more


@dataclass(frozen=True)
class Saved:
    """A solution and where it lies.

    Attributes:
        solution: with its model where that was found.
        folder: where it lies.
        path: its file.
        run: what run.json beside it holds (see `run_facts.run_facts`); empty where there is none.
        why_no_model: one line with the remedy, where the model was not found; else None.
    """

    solution: Solution
    folder: Path
    path: Path
    run: dict[str, Any] = field(default_factory=dict)
    why_no_model: str | None = None


def open_saved(path: str | Path, model: str | Path | MuscleModel | None = None) -> Saved:
    """Read a saved solution and find its model.

    The model is the one given; else the one that run.json names, if it is still the same (a shipped name; model.xml in
    the folder, of ``--osim``; or the file that it was read from); without run.json, model.xml in the folder or the
    shipped model that the settings name, if they give the muscle forces that the solution holds. A model that is not
    found, or is another one by now, is left out, and `Saved.why_no_model` tells.

    Args:
        path: a folder that ``solve`` or ``reproduce`` wrote, or a solution's file.
        model: the model that was driven, or what `MuscleModel.load` takes.

    Raises:
        OutputError: nothing there, no solution in it, several motions' folders in it, a file that is no solution, or
            one whose names are not those of the model given.
        ModelError: the model given cannot be loaded.
    """
    file = solution_file(Path(path))
    solution = Solution.load(file)
    run = read_run(file.parent, file)
    if model is not None:
        return Saved(_with(solution, model, file), file.parent, file, run)
    try:
        found = _of_run(solution, run["model"], file, run) if _knows_model(run) else _guessed(solution, file)
    except _NoModel as why:
        return Saved(solution, file.parent, file, run, str(why))
    return Saved(found, file.parent, file, run)


class _NoModel(Exception):
    """Why the model was not found, in one line."""


def solution_file(path: Path) -> Path:
    """The file of a solution, also where its folder is named.

    Raises:
        OutputError: nothing there, no solution in it, or several motions' folders.
    """
    if not path.is_dir():
        if not path.exists():
            raise OutputError(
                f"{path}: no such file or folder: name a folder that mjhcmc solve wrote, or a solution's file"
            )
        return path
    inside = path / _TABLE
    if inside.is_file():
        return inside
    folders = sorted(found.parent.name for found in path.glob(f"*/{_TABLE}"))
    if folders:
        some = ", ".join(folders[:_MANY]) + (f" and {len(folders) - _MANY} more" if len(folders) > _MANY else "")
        raise OutputError(f"{path}: holds no solution itself, but folders with one: {some}: name {path / folders[0]}")
    raise OutputError(f"{path}: holds no {_TABLE}: name a folder that mjhcmc solve wrote, or a solution's file")


def _with(solution: Solution, source: str | Path | MuscleModel, file: Path) -> Solution:
    from mjhcmc.io.with_model import with_model

    return with_model(solution, _load(solution, source), file)


def _load(solution: Solution, source: str | Path | MuscleModel) -> MuscleModel:
    from mjhcmc.model import MuscleModel

    return MuscleModel.load(source, integrator=solution.integrator)  # nothing is to be said of the model's own


def _knows_model(run: dict[str, Any]) -> bool:
    told = run.get("model")
    if not isinstance(told, dict) or not {"source", "shipped_name", "path", "sha256", "compiled_sha256"} <= set(told):
        return False
    return isinstance(told["shipped_name" if told["source"] == "shipped" else "path"], str)


def _of_run(solution: Solution, told: dict[str, Any], file: Path, run: dict[str, Any]) -> Solution:
    """The solution with the model that run.json names.

    Raises:
        _NoModel: it is not there, or another one by now.
    """
    from mjhcmc.assets import model_path

    if told["source"] == "shipped":
        source: str | Path = told["shipped_name"]
        path = model_path(told["shipped_name"])
        what = f"the shipped model {told['shipped_name']}"
        if path is None:
            raise _NoModel(f"{what} is not one of this mjhcmc: {_GIVE}")
    else:
        path = file.parent / told["path"]  # of another folder: absolute
        what = f"the model {path}"
        if not path.is_file() and (beside := file.parent / path.name).is_file():
            path = beside  # moved along with the solution
        source = path
        if not path.is_file():
            raise _NoModel(f"{what} is not there any more: {_GIVE}, or put it back")
    another = f"{what} is not the one that was driven, it was changed since {run.get('date', 'then')}: {_GIVE}, "
    try:
        model = _load(solution, source)
        if not _is_same(model, path, told, run):
            raise _NoModel(another + "or solve again")
        return _with(solution, model, file)
    except MjhcmcError as error:
        raise _NoModel(f"{another}or solve again ({error})") from None


def _is_same(model: MuscleModel, path: Path, told: dict[str, Any], run: dict[str, Any]) -> bool:
    """Whether a model is the one that was driven: as compiled, or as a file where it was compiled elsewhere.

    Another MuJoCo saves other bytes, and another machine may round otherwise.
    """
    same_here = made_by(run) == made_by(None)
    return bool(compiled_sha256(model) == told["compiled_sha256"] if same_here else sha256_of(path) == told["sha256"])


def _guessed(solution: Solution, file: Path) -> Solution:
    """The solution with a model that nothing but names tells, without run.json.

    Raises:
        _NoModel: there is none, or it gives other muscle forces.
    """
    beside, named = file.parent / _SUBJECT, solution.settings.get("model")
    if beside.is_file():
        source: str | Path = beside
        what = f"the model {beside}"
    elif isinstance(named, str) and is_shipped_name(named):
        source, what = named, f"the shipped model {named}"
    else:
        of = f"model {named!r}" if named else "its model"
        raise _NoModel(f"{file} tells no more of {of} than a name, there is no {RUN_FILE} beside it: {_GIVE}")
    try:
        found = _with(solution, source, file)
    except MjhcmcError as error:
        raise _NoModel(f"{what} is not the one that was driven: {_GIVE} ({error})") from None
    if other := _other_force(found):
        raise _NoModel(f"{what} is not the one that was driven, {other}: {_GIVE}")
    return found


def _other_force(solution: Solution) -> str:
    """The first muscle force that differs between the table and the model at the nodes that are tried; else nothing.

    A force follows from the state alone. Files of text hold every digit, so the same model gives the same forces.
    """
    from mjhcmc.dynamics import node_forces

    if solution.hosted and solution.muscles is None:
        return ""  # Hill muscles of the user's own, which no file holds
    plant = solution.plant()
    for k in np.unique(np.linspace(0, solution.n_window, _TRIED).astype(int)):
        plant.set_state(solution.state(int(k)))
        plant.forward_as_stepped()
        own, other = solution.muscle_force[k], node_forces(plant).muscle_force
        off = np.abs(own - other)
        if off.max() > _FORCE_TOLERANCE * max(1.0, float(np.abs(own).max())):
            worst = int(off.argmax())
            return (
                f"at {solution.time[k]:g} s it gives {solution.muscle_names[worst]} {other[worst]:.4g} N and the "
                f"solution holds {own[worst]:.4g} N"
            )
    return ""

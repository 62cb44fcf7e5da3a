"""OpenSim's CMC and Static Optimization on the same movement in the same run, where OpenSim is."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from _markdown import grid
from _speed_one import METHODS
from _timing import Reading, quiet, read, spread, walls

import mjhcmc
from mjhcmc.opensim_reference import find_reference

_TOOLS = Path(__file__).with_name("_opensim_tools.py")
ABSENT = "OpenSim was not installed where this was measured: `--opensim-python` names an interpreter that has it."
NO_MODEL = "OpenSim's model of the leg (shared/reference/leg8) was not beside the checkout."


@dataclass(frozen=True)
class Compared:
    """Readings by (program, movement), and OpenSim's version."""

    version: str
    readings: dict[tuple[str, str], list[Reading]]


def find_python(given: Path | None) -> str | None:
    """An interpreter that has OpenSim: the one given, or this one."""
    if given is not None:
        return str(given)
    return sys.executable if importlib.util.find_spec("opensim") else None


def measure(python: str, source: Path, runs: int, quick: bool) -> Compared:
    """OpenSim and ours in turns on fast, so many runs; on slow once."""
    model = mjhcmc.MuscleModel.load("leg8")
    readings: dict[tuple[str, str], list[Reading]] = {}
    version = ""
    with quiet():
        for movement, times in (("fast", 1 if quick else runs), *(() if quick else (("slow", 1),))):
            motion = mjhcmc.Motion.cosine(model, movement)
            calls = {f"mjhcmc {name}": partial(method, model, motion) for name, method in METHODS.items()}
            for call in calls.values():
                call()
            for _ in range(times):
                theirs = _opensim(python, source, movement)
                version = theirs["version"]
                for one in theirs["runs"]:
                    readings.setdefault((f"OpenSim {one['tool']}", movement), []).append(
                        Reading(one["wall"], one["cpu"])
                    )
                for name, call in calls.items():
                    readings.setdefault((name, movement), []).append(read(call, 3))
    return Compared(version, readings)


def _opensim(python: str, source: Path, movement: str) -> dict[str, Any]:
    done = subprocess.run(
        [python, str(_TOOLS), str(source), movement], capture_output=True, text=True, errors="replace", check=False
    )
    if done.returncode != 0:
        raise SystemExit(f"OpenSim under {python} failed ({done.returncode}):\n{done.stderr[-2000:]}")
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])  # CMC says much before
    return found


def compare(python: str | None, runs: int, quick: bool) -> tuple[str, Compared | None]:
    """The table, or why there is none; and what it holds."""
    if python is None:
        return ABSENT, None
    reference = find_reference()
    source = None if reference is None else reference.parent / "leg8"
    if source is None or not (source / "leg8.osim").is_file():
        return NO_MODEL, None
    found = measure(python, source, runs, quick)
    rows = [
        (
            f"{name}, {movement}",
            spread(walls(readings)),
            spread([reading.cpu for reading in readings]),
            len(readings),
        )
        for (name, movement), readings in found.readings.items()
    ]
    table = grid(("", "wall, s", "CPU, s", "runs"), rows)
    return f"OpenSim {found.version.split('-')[0]}.\n\n{table}", found

"""The Hill models against OpenSim 4.6's tables (shared/reference/muscle): largest differences, and the rows not met."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
from _markdown import ROOT, digits, grid
from numpy.typing import NDArray

from mjhcmc import hill

FOLDER = ROOT.parent / "shared" / "reference"

MODELS = {
    "Millard2012": hill.millard2012(),
    "Thelen2003": hill.thelen2003(),
    # OpenSim's replaceMuscles gave these the passive strain of the muscles that they replaced
    "DeGrooteFregly2016": hill.degroote_fregly2016(passive=hill.DeGrooteFreglyPassive(strain=0.7)),
}
TABLES = {"static equilibrium": "static_equilibrium_compliant", "rigid tendon": "rigid_tendon_grid"}
TO_REACH = 1e-4  # of F0

Array = NDArray[np.float64]


def table() -> str:
    """Tendon force by model and table."""
    rows = []
    for what, file in TABLES.items():
        for name in MODELS:
            found = _differences(file, name, rigid=what == "rigid tendon")
            if found is None:
                continue
            difference, pushing = found
            worst = difference[~pushing].max()
            met = "reached" if worst <= TO_REACH else "MISSED"
            rows.append((f"{what}, {name}", len(pushing), digits(worst, 2), f"{TO_REACH:g} ({met})", pushing.sum()))
    header = (
        "",
        "rows",
        "largest difference of tendon force, F0",
        "to reach",
        "rows left out: OpenSim's tendon pushes",
    )
    return grid(header, rows)


def _differences(file: str, name: str, *, rigid: bool) -> tuple[Array, NDArray[np.bool_]] | None:
    """(n,) of F0, and where OpenSim's tendon pushes; None where the table has no such model."""
    values = {key: [row[key] for row in _read(f"{file}.csv") if row["model"] == name] for key in ("muscle", *_COLUMNS)}
    if not values["muscle"]:
        return None
    a, length, velocity, force = (np.array(values[key], dtype=np.float64) for key in _COLUMNS)
    model = _model(name, values["muscle"])
    state = hill.rigid_tendon(model, a, length, velocity) if rigid else hill.static_equilibrium(model, a, length)
    return np.abs(state.tendon_force - force) / model.muscles.max_isometric_force, force < 0


_COLUMNS = ("a", "lmt", "vmt", "Ft")


def _model(name: str, muscles: list[str]) -> hill.HillModel:
    """One muscle a row."""
    path = FOLDER / "leg8" / "leg8_parameters.json"
    source = json.loads(path.read_text(encoding="utf-8"))["muscles"]
    keys = ("max_isometric_force", "optimal_fiber_length", "tendon_slack_length", "pennation_rad")
    force, fiber, tendon, pennation = (np.array([source[muscle][key] for muscle in muscles]) for key in keys)
    return hill.HillModel(hill.MuscleParameters(force, fiber, tendon, pennation, names=muscles), MODELS[name])


def _read(file: str) -> list[dict[str, str]]:
    path: Path = FOLDER / "muscle" / file
    if not path.is_file():
        raise SystemExit(f"OpenSim's table {file} (shared/reference/muscle) is not beside this checkout")
    with path.open(encoding="utf-8") as lines:
        return list(csv.DictReader(line for line in lines if not line.startswith("#")))

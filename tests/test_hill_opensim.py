"""The Hill models against OpenSim 4.6: curves, equilibrium, rigid tendon and the fiber's equation of motion.

The whole tables are read where they lie beside the project; a thinned copy of them is part of the tests.
"""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mjhcmc.hill import (
    Curves,
    DeGrooteFreglyPassive,
    HillModel,
    MuscleParameters,
    degroote_fregly2016,
    fiber_dynamics,
    millard2012,
    rigid_tendon,
    static_equilibrium,
    thelen2003,
)

DATA = Path(__file__).parent / "data"
SHARED = Path(__file__).resolve().parents[2] / "shared" / "reference"

# OpenSim's muscles were given .7 of passive strain (its replaceMuscles copies Millard's), not the paper's .6.
MODELS: dict[str, Curves] = {
    "Millard2012": millard2012(),
    "Thelen2003": thelen2003(),
    "DeGrooteFregly2016": degroote_fregly2016(passive=DeGrooteFreglyPassive(strain=0.7)),
}
SHORT = {"Millard": "Millard2012", "Thelen": "Thelen2003", "DGF": "DeGrooteFregly2016"}

# Rows of the tables that a tendon that never pushes cannot meet: De Groote and Fregly's rigid tendon in OpenSim pushes
# where fast shortening makes fiber damping outweigh all else (Millard's is held at 0 there, as here). For these rows
# the force that the fiber has along the tendon is what OpenSim calls the tendon's.
PUSHING = "DeGrooteFregly2016"


def read(path: Path) -> dict[str, np.ndarray]:
    if not path.exists():
        pytest.skip(f"reference table {path.name} is not here")
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    words = ("model", "muscle")
    return {key: np.array([row[key] for row in rows], str if key in words else float) for key in rows[0]}


def copied(kind: str) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    return read(DATA / f"hill_{kind}.csv"), read(DATA / "hill_muscles.csv")


def complete(kind: str) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    names = {
        "static": "static_equilibrium_compliant",
        "rigid": "rigid_tendon_grid",
        "state": "state_function_compliant",
    }
    table = read(SHARED / "muscle" / f"{names[kind]}.csv")
    source = json.loads((SHARED / "leg8" / "leg8_parameters.json").read_text(encoding="utf-8"))["muscles"]
    keys = ("max_isometric_force", "optimal_fiber_length", "tendon_slack_length")
    muscles = {key: np.array([one[key] for one in source.values()]) for key in keys}
    muscles["pennation_at_optimal"] = np.array([one["pennation_rad"] for one in source.values()])
    return table, {"muscle": np.array(list(source)), **muscles}


Source = Callable[[str], tuple[dict[str, np.ndarray], dict[str, np.ndarray]]]


@pytest.fixture(params=[copied, complete], ids=["copied", "complete"])
def source(request: pytest.FixtureRequest) -> Source:
    return request.param


def rows(
    source: Source, kind: str, model: str, damping: float | None = None
) -> tuple[HillModel, dict[str, np.ndarray]]:
    """One muscle a row: the model of these muscles, and the rows."""
    table, muscles = source(kind)
    table = {key: values[table["model"] == model] for key, values in table.items()}
    assert len(table["a"]) > 30
    which = np.array([muscles["muscle"].tolist().index(name) for name in table["muscle"]])
    columns = {key: values[which] for key, values in muscles.items() if key != "muscle"}
    parameters = MuscleParameters(**columns, fiber_damping=damping, names=table["muscle"].tolist())
    return HillModel(parameters, MODELS[model]), table


@pytest.mark.parametrize("short", SHORT)
def test_length_curves(short: str) -> None:
    table, curves = read(SHARED / "muscle" / "curve_force_length.csv"), MODELS[SHORT[short]]
    length = table["norm_fiber_length"]
    np.testing.assert_allclose(curves.active(length), table[f"{short}_active"], rtol=0, atol=1e-6)
    np.testing.assert_allclose(curves.passive(length), table[f"{short}_passive"], rtol=0, atol=1e-6)


@pytest.mark.parametrize("short", SHORT)
def test_tendon_curves(short: str) -> None:
    table, curves = read(SHARED / "muscle" / "curve_tendon_force_length.csv"), MODELS[SHORT[short]]
    assert curves.tendon is not None
    np.testing.assert_allclose(curves.tendon(table["norm_tendon_length"]), table[short], rtol=0, atol=1e-6)


@pytest.mark.parametrize("short", ["Millard", "DGF"])
def test_velocity_curves(short: str) -> None:
    table = read(SHARED / "muscle" / "curve_force_velocity_millard_dgf.csv")
    curve = MODELS[SHORT[short]].force_velocity
    np.testing.assert_allclose(curve(table["norm_fiber_velocity"]), table[short], rtol=0, atol=1e-6)


def test_thelen_velocity_curve_at_all_activations() -> None:
    table = read(SHARED / "muscle" / "curve_force_velocity_thelen.csv")
    curve, velocity, a = MODELS["Thelen2003"].force_velocity, table["norm_fiber_velocity"], table["activation"]
    np.testing.assert_allclose(curve(velocity, a), table["fv_from_tendon"], rtol=0, atol=1e-6)
    np.testing.assert_allclose(curve.inverse(table["fv_from_tendon"], a), velocity, rtol=0, atol=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_static_equilibrium(source: Source, model: str) -> None:
    hill, table = rows(source, "static", model)
    state = static_equilibrium(hill, table["a"], table["lmt"])
    force, length = hill.muscles.max_isometric_force, hill.muscles.optimal_fiber_length
    # The bar is 1e-4; OpenSim's own equilibria leave fiber velocities up to 7e-7 lopt/s.
    np.testing.assert_allclose(state.tendon_force / force, table["Ft"] / force, rtol=0, atol=1e-7)
    np.testing.assert_allclose(state.fiber_length / length, table["lce"] / length, rtol=0, atol=1e-7)


@pytest.mark.parametrize("model", ["Millard2012", "DeGrooteFregly2016"])
def test_rigid_tendon(source: Source, model: str) -> None:
    hill, table = rows(source, "rigid", model)
    state = rigid_tendon(hill, table["a"], table["lmt"], table["vmt"])
    force = hill.muscles.max_isometric_force
    pushing = table["Ft"] < 0
    assert np.array_equal(pushing, state.slack & (table["Ft"] != 0))
    assert pushing.any() == (model == PUSHING)
    ours = np.where(pushing, state.fiber_force_along_tendon, state.tendon_force)
    np.testing.assert_allclose(ours / force, table["Ft"] / force, rtol=0, atol=1e-7)
    assert np.all(state.tendon_force[pushing] == 0)


@pytest.mark.parametrize("model", MODELS)
def test_fiber_velocity(source: Source, model: str) -> None:
    # De Groote and Fregly's tendon dynamics in OpenSim leave damping out of the velocity, though not out of the force.
    hill, table = rows(source, "state", model, damping=0.0 if model == "DeGrooteFregly2016" else None)
    # The tables' ten digits, times tendon stiffness, over a fL down to .005, and through a sinh, leave six.
    speed = 10 * hill.muscles.optimal_fiber_length
    physical = np.abs(table["vce"]) < 10 * speed
    assert physical.sum() > 0.5 * len(physical)
    state = fiber_dynamics(hill, table["a"], table["lce"], table["lmt"])
    force = hill.muscles.max_isometric_force
    ours, theirs = (state.fiber_velocity / speed)[physical], (table["vce"] / speed)[physical]
    np.testing.assert_allclose(ours, theirs, rtol=5e-6, atol=1e-6)
    np.testing.assert_allclose(state.tendon_force / force, table["Ft"] / force, rtol=0, atol=1e-7)

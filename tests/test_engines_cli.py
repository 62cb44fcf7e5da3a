"""``mjhcmc engines``: rows of what is missing, exit codes, one JSON object whatever engines print."""

import copy
import dataclasses
import importlib.util
import json
import os
import runpy
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mjhcmc.engines import mujoco as own
from mjhcmc.engines import registry
from mjhcmc.engines.legs import leg

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def bare(monkeypatch):
    """As where only the core is installed."""
    real, core = importlib.util.find_spec, {"mujoco"}
    others = {engine.module for engine in registry.all_engines()} - core
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name in others else real(name, *rest))


@pytest.fixture
def plant(monkeypatch):
    """Put an engine of our making where Drake stands."""

    def put(load):
        from mjhcmc.engines import drake

        monkeypatch.setattr(drake, "ENGINE", dataclasses.replace(own.ENGINE, title="Planted", key="planted", load=load))

    return put


def heavier(factor):
    def load(model):
        model = copy.copy(model)
        model.body_inertia *= factor
        return own.MujocoDynamics(model)

    return load


def test_rows_of_what_is_missing_stay_with_their_remedy(run, bare):
    outcome = run("engines", "--states", 3)
    assert outcome.code == 0, outcome.err
    lines = outcome.out.splitlines()
    for engine in registry.all_engines():
        missing = [line for line in lines if line.startswith(f"{engine.title:<12} not installed: ")]
        assert len(missing) == (engine.key != "mujoco")
        assert all(engine.install in line and len(line) > 40 for line in missing)
    assert "every installed engine agrees" in outcome.out
    assert outcome.err == ""


def test_json_is_one_object_whatever_engines_print(run, bare, plant):
    def loud(model):
        os.write(1, b"engine build of last year\n")
        print("loading")
        return own.load(model)

    plant(loud)
    outcome = run("engines", "--states", 2, "--json")
    assert outcome.code == 0
    assert outcome.out.count("\n") == 1
    found = json.loads(outcome.out)
    rows = {row["key"]: row for row in found["engines"]}
    assert found["passed"] is True
    assert rows["planted"]["status"] == "agrees"
    assert rows["brax"]["status"] == "not installed"
    assert rows["brax"]["install"].startswith("pip install")
    assert rows["mujoco"]["legs"]["oblique"]["forward_order"] == pytest.approx(4, abs=0.1)


def test_a_wrong_engine_is_found(run, bare, plant):
    plant(heavier(1.001))
    outcome = run("engines", "--states", 3, "--only", "planted")
    assert outcome.code == 1
    assert "not every installed engine agrees" in outcome.out
    (why,) = (line for line in outcome.out.splitlines() if "disagrees:" in line)
    for word in ("Planted", "leg8: mass matrix differs by", "1e-09 allowed", "oblique: inverse dynamics"):
        assert word in why


def test_an_engine_that_moves_another_model_is_found(run, bare, plant):
    class Still(own.MujocoDynamics):
        def simulate(self, q, v, torques, dt, step):
            return np.zeros((len(torques) + 1, len(q)))

    plant(lambda model: Still(copy.copy(model)))
    outcome = run("engines", "--states", 1, "--only", "planted", "--json")
    assert outcome.code == 1
    assert "deg off over a second" in json.loads(outcome.out)["engines"][1]["reason"]


def test_an_engine_that_gives_nan_does_not_agree(run, bare, plant):
    class Nan(own.MujocoDynamics):
        def bias(self, q, v):
            return super().bias(q, v) * np.nan

    plant(lambda model: Nan(copy.copy(model)))
    outcome = run("engines", "--states", 1, "--only", "planted", "--json")
    assert outcome.code == 1
    row = json.loads(outcome.out, parse_constant=pytest.fail)["engines"][1]  # NaN and Infinity are no JSON
    assert row["status"] == "disagrees"
    assert row["legs"]["leg8"]["difference"]["bias"] is None


def test_an_engine_that_fails_says_so_in_a_line_and_the_others_run(run, bare, plant):
    def broken(model):
        raise RuntimeError("no such\nsymbol")

    plant(broken)
    outcome = run("engines", "--states", 1)
    assert outcome.code == 1
    assert "Planted      failed: RuntimeError: no such symbol" in outcome.out
    assert any(line.startswith("MuJoCo") and "agrees" in line for line in outcome.out.splitlines())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--only", "havok"), ("no engine 'havok'", "mujoco, dojo, brax")),
        (("--only", "drake,"), ("no engine ''",)),
        (("--states", "0"), ("--states", "0 is not in the range x>=1")),
        (("--seed", "-1"), ("--seed", "-1 is not in the range x>=0")),
        (("--urdf", "leg.urdf", "--model", "nothing"), ("no model 'nothing'", "oblique")),
        (("--urdf", "leg.urdf", "--model", "leg8_gait"), ("pelvis_tx", "slide")),
        (("--urdf", "no/leg.urdf"), ("no folder no",)),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(run, bare, arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    outcome = run("engines", *arguments)
    assert outcome.code == 2
    (line,) = outcome.errors
    for word in words:
        assert word in line
    assert outcome.out == ""
    assert list(tmp_path.iterdir()) == []


def test_urdf_is_written(run, tmp_path):
    path = tmp_path / "leg.urdf"
    outcome = run("engines", "--urdf", path, "--model", "oblique")
    assert outcome.code == 0
    assert str(path) in outcome.out
    read = mujoco.MjModel.from_xml_path(str(path))
    assert read.nv == 3
    assert [entry.name for entry in tmp_path.iterdir()] == ["leg.urdf"]
    read.opt.gravity = leg("oblique").opt.gravity
    q = np.array([0.1, -0.2, 0.3])
    expected = own.load(leg("oblique")).mass_matrix(q)
    np.testing.assert_allclose(own.load(read).mass_matrix(q), expected, atol=1e-12)


def test_the_document_has_a_row_for_every_engine(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    helper = runpy.run_path(str(ROOT / "benchmarks" / "_markdown.py"))
    begin, end = helper["marks"]("engines.py")
    table = (ROOT / "docs" / "engines.md").read_text(encoding="utf-8").split(begin)[1].split(end)[0]
    for engine in registry.all_engines():
        assert f"| {engine.title} |" in table or f"- {engine.title} " in table, engine.title

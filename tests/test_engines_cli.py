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

    def put(load, **about):
        from mjhcmc.engines import drake

        planted = dataclasses.replace(own.ENGINE, title="Planted", key="planted", load=load, **about)
        monkeypatch.setattr(drake, "ENGINE", planted)

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
    assert lines[-1] == 'no other engine is installed: nothing was compared: pip install "mjhcmc[engines]"'
    assert outcome.err == "MuJoCo ...\n"


def test_json_is_one_object_whatever_engines_print(run, bare, plant):
    def loud(model):
        os.write(1, b"engine build of last year\n")
        print("loading")
        return own.load(model)

    plant(loud)
    outcome = run("engines", "--states", 2, "--json")
    assert outcome.code == 0
    assert outcome.err == ""
    assert outcome.out.count("\n") == 1
    found = json.loads(outcome.out)
    rows = {row["key"]: row for row in found["engines"]}
    assert found["passed"] is True
    assert found["compared"] == 1
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


def test_quiet_leaves_the_exit_code(run, bare, plant):
    def broken(model):
        raise RuntimeError("no")

    plant(broken)
    outcome = run("engines", "--states", 1, "--only", "planted", "--quiet")
    assert (outcome.code, outcome.out, outcome.err) == (1, "", "")


def test_an_engine_that_moves_another_model_is_found(run, bare, plant):
    class Still(own.MujocoDynamics):
        def simulate(self, q, v, torques, dt, step):
            return np.zeros((len(torques) + 1, len(q)))

    plant(lambda model: Still(copy.copy(model)))
    outcome = run("engines", "--states", 1, "--only", "planted", "--json")
    assert outcome.code == 1
    assert "deg off over a second" in json.loads(outcome.out)["engines"][1]["reason"]


class Euler(own.MujocoDynamics):
    """Steps as a first-order method does."""

    def simulate(self, q, v, torques, dt, step):
        model, count = self.model, round(dt / step)
        model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_EULER, step
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], nodes = q, v, [np.array(q)]
        for torque in torques:
            data.qfrc_applied[:] = torque
            mujoco.mj_step(model, data, count)
            nodes.append(np.array(data.qpos))
        return np.array(nodes)


def euler(model):
    return Euler(copy.copy(model))


@pytest.mark.parametrize(
    ("about", "words"),
    [
        ({}, ("0.11 deg off over a second, 0.0001 allowed", "of order 1.00, RK4 is of order 4")),
        ({"order": 3}, ("0.11 deg off over a second, 0.0001 allowed", "of order 1.00, RK4 is of order 3")),
        ({"precision": "float32"}, ("0.11 deg off over a second, 0.001 allowed",)),
    ],
)
def test_an_engine_that_steps_by_another_method_than_it_says_is_found(run, bare, plant, about, words):
    plant(euler, **about)
    outcome = run("engines", "--states", 1, "--only", "planted", "--json")
    assert outcome.code == 1
    row = json.loads(outcome.out)["engines"][1]
    assert row["status"] == "disagrees"
    for word in words:
        assert word in row["reason"]


def test_an_engine_that_says_that_it_steps_by_euler_agrees(run, bare, plant):
    plant(euler, order=1, integrator="Euler")
    outcome = run("engines", "--states", 1, "--only", "planted")
    assert outcome.code == 0, outcome.out
    assert outcome.out.splitlines()[-1] == "every installed engine agrees"
    assert outcome.err == "MuJoCo ...\nPlanted ...\n"


def test_an_engine_of_a_better_order_than_it_says_is_not_the_one_it_says(run, bare, plant):
    plant(own.load, order=1, integrator="Euler")
    outcome = run("engines", "--states", 1, "--only", "planted", "--json")
    assert "of order 4.00, Euler is of order 1" in json.loads(outcome.out)["engines"][1]["reason"]


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
        (("--only", "mujoco,drake"), ("--only drake: ", "'pydrake' is not installed", 'pip install "drake')),
        (("--only", "raisim"), ("--only raisim: ",)),
        (("--states", "0"), ("--states", "0 is not in the range x>=1")),
        (("--seed", "-1"), ("--seed", "-1 is not in the range x>=0")),
        (("--urdf", "leg.urdf", "--model", "nothing"), ("no model 'nothing'", "oblique")),
        (("--urdf", "leg.urdf", "--model", "leg8_gait"), ("pelvis_tx", "slide")),
        (("--urdf", "leg.urdf", "--only", "drake"), ("--only", "--urdf compares nothing")),
        (("--urdf", "leg.urdf", "--states", "100"), ("--states", "--urdf compares nothing")),
        (("--model", "nothing"), ("no model 'nothing'",)),
        (("--model", "leg8"), ("--model leg8", "compared anyway")),
        (("--model", "leg8_gait"), ("pelvis_tx", "slide")),
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


def test_a_model_of_ones_own_is_a_further_leg(run, bare, plant, tmp_path):
    path = tmp_path / "my_arm.xml"
    path.write_text(
        '<mujoco><worldbody><body name="up"><joint name="joint_1" axis=".2 1 .1" range="-90 90" damping=".5"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".04"/><body pos="0 0 -.3"><joint axis="0 1 .1"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -.25" size=".03"/></body></body></worldbody></mujoco>'
    )
    plant(own.load)
    outcome = run("engines", "--states", 2, "--model", path, "--only", "planted")
    assert outcome.code == 0, outcome.err
    assert sum(line.split()[0] == "my_arm" for line in outcome.out.splitlines() if line) == 2


def test_the_document_has_a_row_for_every_engine(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    helper = runpy.run_path(str(ROOT / "benchmarks" / "_markdown.py"))
    begin, end = helper["marks"]("engines.py")
    table = (ROOT / "docs" / "engines.md").read_text(encoding="utf-8").split(begin)[1].split(end)[0]
    for engine in registry.all_engines():
        assert f"| {engine.title} |" in table or f"- {engine.title} " in table, engine.title

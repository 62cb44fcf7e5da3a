"""open_saved: a solution from its folder, and the model that was driven, or why it was not found."""

import hashlib
import json
import shutil
from importlib.metadata import version

import mujoco
import numpy as np
import pytest
from cli_tools import JOINTS
from conftest import PENDULUMS
from osim_documents import write_osim

import mjhcmc
from mjhcmc import assets
from mjhcmc.errors import MjhcmcWarning, ModelError, OutputError
from mjhcmc.io.opensim import write_table

pytestmark = pytest.mark.usefixtures("coarse_replay", "no_figures")


STRONGER = PENDULUMS.replace('force="400"', 'force="410"')


def sha256(path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def solved(run, mot, tmp_path):
    """A folder with a solution of leg8."""
    assert run("solve", mot(), "--end", ".1", "--quiet", "--out", tmp_path / "out").code in (0, 1)
    return tmp_path / "out"


@pytest.fixture
def arm(run, tmp_path, two_joints):
    """A model file of one's own, and a folder with a solution of it."""
    model, motion, out = tmp_path / "arm.xml", tmp_path / "arm.sto", tmp_path / "out"
    model.write_text(PENDULUMS)
    t = np.linspace(0, 0.1, 21)
    q = np.rad2deg(mjhcmc.Motion.cosine(two_joints, amplitudes={"elbow": 0.1}, period=0.3, cycles=1).sample(t).qpos)
    write_table(motion, two_joints.joint_names, t, q, name="arm", in_degrees=True)
    assert run("solve", motion, "--model", model, "--quiet", "--out", out).code in (0, 1)
    return model, out


# --- run.json ---------------------------------------------------------------------------------------------------


def test_run_json_tells_what_the_run_was_made_with(run, mot, tmp_path):
    motion, weights, out = mot(), tmp_path / "weights.json", tmp_path / "out"
    weights.write_text('{"soleus": 2.0}')
    typed = ["solve", str(motion), "--weights", str(weights), "--end", "0.1", "--json", "--out", str(out)]
    outcome = run(*typed)
    assert json.loads(outcome.out)["files"][-1] == str(out / "run.json")
    facts = json.loads((out / "run.json").read_text())
    assert facts["command"] == typed
    assert facts["mjhcmc"] == mjhcmc.__version__
    for name in ("mujoco", "numpy", "scipy", "numba", "qpsolvers"):
        assert facts["versions"][name] == version(name)
    assert facts["date"].endswith("+00:00")
    assert facts["status"] == "finished"
    assert 0 < facts["wall_time_s"] < 60
    assert facts["inputs"] == [
        {"what": what, "path": str(path.resolve()), "sha256": sha256(path), "bytes": path.stat().st_size}
        for what, path in (("motion", motion), ("weights", weights))
    ]
    model = facts["model"]
    assert (model["name"], model["source"], model["path"]) == ("leg8", "shipped", None)
    assert model["sha256"] == sha256(assets.model_path("leg8"))
    assert facts["solution"] == {"file": "solution.parquet", "sha256": sha256(out / "solution.parquet")}


def test_the_table_that_loads_name_is_an_input(tmp_path):
    from mjhcmc.cli_solve import _input_files

    xml, table = tmp_path / "grf.xml", tmp_path / "grf.mot"
    xml.write_text(
        "<OpenSimDocument><ExternalLoads><objects><ExternalForce name='r'><applied_to_body>foot</applied_to_body>"
        "<force_identifier>v</force_identifier><point_identifier>p</point_identifier></ExternalForce></objects>"
        "<datafile>grf.mot</datafile></ExternalLoads></OpenSimDocument>"
    )
    table.write_text("")
    options = {"loads": xml, "loads_data": None, "column_map": tmp_path / "map.csv", "out": tmp_path, "dt": 0.01}
    assert _input_files(options) == [("loads", xml), ("map", tmp_path / "map.csv"), ("loads data", table)]


def test_reproduce_writes_it_and_its_json_stays_as_it_was(run, tmp_path, timed_once):
    out = tmp_path / "out"
    outcome = run("reproduce", "--dt", "0.02", "--json", "--out", out)
    assert set(json.loads(outcome.out)) == {"movement", "dt", "physics_dt", "bare_step_time_s", "methods"}
    saved = mjhcmc.open_saved(out)
    assert saved.run["command"][:3] == ["reproduce", "--dt", "0.02"]
    assert saved.solution.model is not None
    assert saved.why_no_model is None


def test_each_motions_folder_has_its_own(run, mot, tmp_path):
    out = tmp_path / "out"
    outcome = run("solve", mot("one.mot"), mot("two.mot"), "--end", "0.05", "--out", out)
    for name in ("one", "two"):
        inputs = mjhcmc.open_saved(out / name).run["inputs"]
        assert [(each["what"], each["path"]) for each in inputs] == [("motion", str(tmp_path / f"{name}.mot"))]
    assert outcome.out.splitlines()[-1] == f"look at it:  mjhcmc report {out / 'one'}"
    with pytest.raises(OutputError, match=rf"folders with one: one, two: name {out / 'one'}"):
        mjhcmc.open_saved(out)


# --- where the solution is --------------------------------------------------------------------------------------


def test_a_folder_or_its_file_wherever_they_were_moved(solved, tmp_path):
    moved = shutil.move(solved, tmp_path / "elsewhere")
    for path in (moved, str(moved), moved / "solution.parquet"):
        saved = mjhcmc.open_saved(path)
        assert (saved.folder, saved.path) == (moved, moved / "solution.parquet")
        assert saved.why_no_model is None
        assert saved.run["model"]["name"] == "leg8"
        assert saved.solution.detail.muscle_power.shape == saved.solution.activation.shape


def test_another_solution_put_in_its_place_is_not_the_runs(solved, fast_solution):
    assert mjhcmc.open_saved(solved).run
    fast_solution.save(solved / "solution.parquet")
    saved = mjhcmc.open_saved(solved)
    assert saved.run == {}
    assert saved.solution.n_window == fast_solution.n_window


def test_a_shipped_model_that_is_not_shipped_any_more(solved):
    facts = json.loads((solved / "run.json").read_text())
    facts["model"]["shipped_name"] = "leg9"
    (solved / "run.json").write_text(json.dumps(facts))
    saved = mjhcmc.open_saved(solved)
    assert saved.solution.model is None
    assert "the shipped model leg9 is not one of this mjhcmc: name it with model (--model)" in saved.why_no_model


@pytest.mark.parametrize("text", ["{", "[1]", ""])
def test_a_damaged_run_json_is_left_out_with_a_notice(solved, text):
    (solved / "run.json").write_text(text)
    with pytest.warns(MjhcmcWarning, match=r"run\.json: left out.*solve again"):
        saved = mjhcmc.open_saved(solved)
    assert saved.run == {}
    assert saved.solution.model is not None  # by its name, since the forces are the same


def test_nothing_there_and_nothing_in_it(tmp_path):
    (tmp_path / "notes.txt").write_text("x")
    for path, words in (
        (tmp_path, r"holds no solution\.parquet: name a folder that mjhcmc solve wrote"),
        (tmp_path / "none", "no such file or folder: name a folder"),
        (tmp_path / "notes.txt", r"unknown suffix '\.txt': use one of \.parquet"),
    ):
        with pytest.raises(OutputError, match=words) as error:
            mjhcmc.open_saved(path)
        assert str(path) in str(error.value)
        assert "\n" not in str(error.value)
    damaged = tmp_path / "solution.parquet"
    damaged.write_text("no table")
    with pytest.raises(OutputError, match="is no solution that mjhcmc wrote"):
        mjhcmc.open_saved(tmp_path)


# --- its model --------------------------------------------------------------------------------------------------


def test_a_model_file_is_found_where_it_was(arm):
    model, out = arm
    saved = mjhcmc.open_saved(out)
    assert saved.why_no_model is None
    assert saved.solution.model.joint_names == ("shoulder", "elbow")
    model.write_text(PENDULUMS.replace("<worldbody>", "<!-- the same to MuJoCo -->\n  <worldbody>"))
    assert mjhcmc.open_saved(out).solution.model is not None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda model: model.write_text(PENDULUMS.replace('force="400"', 'force="410"')),
            "not the one that was driven",
        ),
        (lambda model: model.write_text(PENDULUMS.replace('"biceps"', '"triceps"')), "not the one that was driven"),
        (lambda model: model.write_text("<mujoco>"), "not the one that was driven"),
        (lambda model: model.unlink(), "is not there any more"),
    ],
)
def test_a_model_that_changed_or_went_is_left_out(arm, change, words):
    model, out = arm
    change(model)
    saved = mjhcmc.open_saved(out)
    assert saved.solution.model is None
    for word in (str(model), words, "--model"):
        assert word in saved.why_no_model
    assert "\n" not in saved.why_no_model


def test_a_model_that_was_moved_into_the_solutions_folder_is_found(arm):
    model, out = arm
    shutil.move(model, out / model.name)
    assert mjhcmc.open_saved(out).solution.model is not None
    (out / model.name).write_text(STRONGER)
    assert "not the one that was driven" in mjhcmc.open_saved(out).why_no_model


@pytest.mark.parametrize(
    "elsewhere",
    [{"versions": {"mujoco": "3.0.0"}}, {"platform": {"system": "Linux", "machine": "riscv"}}, {"versions": None}],
)
def test_the_hash_of_the_file_decides_where_it_was_compiled_elsewhere(arm, elsewhere):
    model, out = arm
    facts = json.loads((out / "run.json").read_text()) | elsewhere
    facts["model"]["compiled_sha256"] = "0" * 64
    (out / "run.json").write_text(json.dumps(facts))
    assert mjhcmc.open_saved(out).solution.model is not None
    model.write_text(STRONGER)
    assert mjhcmc.open_saved(out).solution.model is None


def test_a_model_that_is_given_goes_first(arm, two_joints, leg8, tmp_path):
    model, out = arm
    model.unlink()
    assert mjhcmc.open_saved(out, two_joints).solution.model.name == two_joints.name
    other = tmp_path / "moved.xml"
    other.write_text(PENDULUMS)
    assert mjhcmc.open_saved(out, other).why_no_model is None
    with pytest.raises(OutputError, match="muscle 1 is 'flexor' in the file and 'iliopsoas' in model 'leg8'"):
        mjhcmc.open_saved(out, "leg8")
    with pytest.raises(ModelError, match="leg9"):
        mjhcmc.open_saved(out, "leg9")


def test_a_subjects_leg_lies_beside_its_solution_and_roles_come_back(run, tmp_path, leg8):
    osim, motion, out = tmp_path / "subject.osim", tmp_path / "walk.mot", tmp_path / "out"
    write_osim(osim)
    t = np.linspace(0, 0.05, 11)
    names = ("pelvis_ty", "hip_flexion_r", "knee_angle_r", "ankle_angle_r")
    rows = np.column_stack([0.9 + 0 * t, *[10 * np.sin(t) for _ in JOINTS]])
    write_table(motion, names, t, rows, name="walk", in_degrees=True)
    assert run("solve", motion, "--osim", osim, "--quiet", "--out", out).code in (0, 1)
    moved = shutil.move(out, tmp_path / "elsewhere")
    saved = mjhcmc.open_saved(moved)
    assert saved.why_no_model is None
    assert saved.run["model"]["source"] == "folder"
    assert "prescribed" in saved.solution.model.roles.of
    assert saved.solution.detail.muscle_moment.shape[1] == 8
    text = (moved / "model.xml").read_text()
    (moved / "model.xml").write_text(text.replace('gravity="0 0 -9.8', 'gravity="0 0 -9.7'))
    assert text != (moved / "model.xml").read_text()
    changed = mjhcmc.open_saved(moved)
    assert changed.solution.model is None
    assert "model.xml" in changed.why_no_model
    (moved / "model.xml").write_text(text)
    (moved / "run.json").unlink()  # as mjhcmc wrote folders before there was one
    assert mjhcmc.open_saved(moved).solution.model is not None


# --- without run.json: by name, if the forces are the same ---------------------------------------------------------


def test_a_saved_solution_of_a_shipped_model_finds_it(tmp_path, fast_solution):
    for suffix in (".parquet", ".csv"):
        path = fast_solution.save(tmp_path / f"fast{suffix}")
        saved = mjhcmc.open_saved(path)
        assert saved.run == {}
        # a table of text names no model
        assert (saved.solution.model is None) == (suffix == ".csv")
    assert "there is no run.json beside it: name it with model (--model)" in saved.why_no_model


def test_a_model_of_the_same_names_with_other_muscles_is_refused(tmp_path):
    spec = mujoco.MjSpec.from_string(assets.model_path("leg8").read_text())
    vasti = next(actuator for actuator in spec.actuators if actuator.name == "vasti")
    vasti.gainprm[2] *= 1.1
    vasti.biasprm[2] *= 1.1
    model = mjhcmc.MuscleModel.load(spec)
    motion = mjhcmc.Motion.cosine(model, "fast")
    path = mjhcmc.hcmc(model, motion).save(tmp_path / "mine.parquet")
    saved = mjhcmc.open_saved(path)
    assert saved.solution.model is None
    assert "the shipped model leg8 is not the one that was driven, at " in saved.why_no_model
    assert "vasti" in saved.why_no_model
    assert mjhcmc.open_saved(path, model).solution.model is model

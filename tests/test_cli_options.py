"""The command line's choices: methods, costs, moments, several motions, exports, check, logging."""

import json

import numpy as np
import pytest
from cli_tools import FILES, JOINTS, MUSCLES
from conftest import HANGING_MASS, MUSCLE_ACTUATOR

import mjhcmc
from mjhcmc.io.opensim import read_table

pytestmark = pytest.mark.usefixtures("coarse_replay")


def solution_of(folder):
    return mjhcmc.Solution.load(folder / "solution.parquet")


@pytest.mark.parametrize("method", ["hcmc", "cmc", "static"])
def test_every_method_runs_and_says_which_it_was(run, mot, tmp_path, no_figures, method):
    outcome = run("solve", mot(), "--method", method, "--json", "--out", tmp_path / "out")
    assert outcome.code == (1 if method == "static" else 0)
    assert json.loads(outcome.out)["settings"]["method"] == method
    assert solution_of(tmp_path / "out").settings["method"] == method


def test_choices_reach_the_method(run, mot, tmp_path, no_figures, leg8):
    path, weights = mot(), tmp_path / "weights.json"
    weights.write_text(json.dumps({"soleus": 4.0}))
    arguments = ["--cost", "cubic", "--weights", weights, "--smoothness", "0.5", "--min-activation", "0.02"]
    outcome = run("solve", path, *arguments, "--disable", "rect_fem", "--disable", "vasti", "--out", tmp_path / "out")
    assert outcome.code in (0, 1), outcome.err
    expected = mjhcmc.hcmc(
        leg8, mjhcmc.Motion.from_file(path, leg8), cost="cubic", weights={"soleus": 4.0}, smoothness=0.5,
        min_activation=0.02, disabled=["rect_fem", "vasti"],
    )  # fmt: skip
    found = solution_of(tmp_path / "out")
    np.testing.assert_array_equal(found.excitation, expected.excitation)
    assert found.settings["disabled"] == ["rect_fem", "vasti"]
    off = [MUSCLES.index(name) for name in ("rect_fem", "vasti")]
    assert not found.excitation[:, off].any()
    on = [i for i in range(8) if i not in off]
    assert found.activation[1:, on].min() >= 0.02 - 1e-12


def test_several_motions_go_into_a_folder_each(run, mot, tmp_path, blank_figures):
    out = tmp_path / "out"
    outcome = run("solve", mot("one.mot"), mot("two.mot", factor=0.5), "--json", "--out", out)
    assert outcome.code == 0
    assert sorted(path.name for path in out.iterdir()) == ["one", "two"]
    for name in ("one", "two"):
        files = sorted(path.name for path in (out / name).iterdir())
        assert files == sorted(FILES)
    assert set(json.loads(outcome.out)["motions"]) == {"one", "two"}
    assert solution_of(out / "two").settings["motion"] == "two"


def test_one_bad_motion_stops_all_before_the_work(run, mot, tmp_path):
    bad = mot("bad.mot", edit=lambda lines: lines.__setitem__(9, lines[9].replace("\t", "\tx", 1)))
    outcome = run("solve", mot("good.mot"), bad, "--out", tmp_path / "out")
    assert outcome.code == 2
    assert "bad.mot" in outcome.errors[-1]
    assert not (tmp_path / "out").exists()


def test_resample_and_units(run, mot, tmp_path, no_figures):
    outcome = run("solve", mot(), "--resample", "50", "--out", tmp_path / "out", "--json")
    assert outcome.code == 0
    table = tmp_path / "walk.csv"
    rows = np.linspace(0, 0.6, 121)
    angle = 5 * (1 - np.cos(2 * np.pi * rows / 0.6))
    table.write_text(
        "time,hip,knee,ankle\n" + "".join(f"{t},{a},{-2 * a},{-a}\n" for t, a in zip(rows, angle, strict=True))
    )
    assert run("solve", table, "--out", tmp_path / "out").code == 2  # no unit
    assert run("solve", table, "--unit", "deg", "--out", tmp_path / "csv", "--quiet").code == 0
    peak = np.rad2deg(np.abs(solution_of(tmp_path / "csv").qpos_desired).max(axis=0))
    np.testing.assert_allclose(peak, [10, 20, 10], atol=1e-6)


def test_segment_angles(run, mot, tmp_path, no_figures):
    """Thigh, shank and foot of a leg whose hip alone moves turn alike."""
    path = mot(amplitudes=dict.fromkeys(JOINTS, np.deg2rad(-8)), columns=("pelvis_tx", "knee", "hip", "ankle"))
    assert run("solve", path, "--angles", "segment", "--quiet", "--out", tmp_path / "out").code == 0
    desired = np.rad2deg(solution_of(tmp_path / "out").qpos_desired)
    np.testing.assert_allclose(desired[:, 1:], 0, atol=1e-9)
    np.testing.assert_allclose(desired[:, 0].min(), -8, atol=1e-6)


def test_moments_of_ones_own(run, mot, tmp_path, no_figures, leg8, slow_solution):
    path = mot(cycles=3)
    moments = tmp_path / "moments.csv"
    slow_solution.save(moments)
    assert run("solve", path, "--moments", moments, "--quiet", "--out", tmp_path / "out").code == 0
    found = solution_of(tmp_path / "out")
    scale = np.abs(slow_solution.net_joint_moment).max(axis=0)
    difference = np.abs(found.net_joint_moment - slow_solution.net_joint_moment).max(axis=0)
    assert np.all(difference < [0.02, 0.05, 0.1] * scale)
    outcome = run("solve", mot(cycles=4), "--moments", moments, "--out", tmp_path / "more")
    assert outcome.code == 2
    assert "covers 0 .. 1.8 s" in outcome.errors[-1]
    assert not (tmp_path / "more").exists()


def test_export_for_opensim(run, mot, tmp_path, no_figures):
    out = tmp_path / "out"
    outcome = run("solve", mot(), "--opensim", "--json", "--out", out)
    assert outcome.code == 0
    assert {str(out / f"solution_{kind}.sto") for kind in ("controls", "states")} <= set(
        json.loads(outcome.out)["files"]
    )
    assert "soleus_r" in read_table(out / "solution_controls.sto").columns
    assert "/jointset/hip_r/hip_flexion_r/value" in read_table(out / "solution_states.sto").columns


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--method", "moco"], ["moco", "hcmc, cmc, static"]),
        (["--cost", "energy"], ["energy", "effort, cubic, volume, stress, capacity"]),
        (["--solver", "simplex"], ["simplex", "newton", "daqp"]),
        (["--disable", "biceps"], ["biceps", "iliopsoas", "tib_ant"]),
        (["--min-activation", "1.5"], ["activation", "1.5"]),
        (["--smoothness", "-1"], ["smoothness", "-1"]),
        (["--weights", "none.json"], ["none.json"]),
        (["--moments", "none.sto"], ["none.sto"]),
        (["--resample", "0"], ["0"]),
        (["--unit", "grad"], ["grad", "deg"]),
        (["--angles", "euler"], ["euler", "segment"]),
    ],
)
def test_bad_choices_are_one_line_and_leave_nothing(run, mot, tmp_path, arguments, words):
    outcome = run("solve", mot(), *arguments, "--out", tmp_path / "out")
    assert outcome.code == 2
    assert outcome.out == ""
    assert len(outcome.errors) == 1
    for word in words:
        assert word in outcome.errors[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["[1, 2]", "soleus: 2", '{"soleus": "much"}', '{"soleus": -1}', '{"biceps": 1}', ""])
def test_bad_weights(run, mot, tmp_path, text):
    path = tmp_path / "weights.json"
    path.write_text(text)
    outcome = run("solve", mot(), "--weights", path, "--out", tmp_path / "out")
    assert outcome.code == 2
    assert len(outcome.errors) == 1
    assert "weights" in outcome.errors[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("value", ["true", "null", '"much"', "[2]"])
def test_a_weight_that_is_no_number_is_named_with_its_file(run, mot, tmp_path, value):
    path = tmp_path / "weights.json"
    path.write_text(f'{{"vasti": 2, "soleus": {value}}}')
    outcome = run("solve", mot(), "--weights", path, "--out", tmp_path / "out")
    assert (outcome.code, len(outcome.errors)) == (2, 1)
    assert f"{path}: that of soleus is {value}, no number" in outcome.errors[0]
    assert not (tmp_path / "out").exists()


def test_check(run, tmp_path):
    outcome = run("check", "leg8")
    assert outcome.code == 0
    for word in (*MUSCLES, *JOINTS):
        assert word in outcome.out
    report = json.loads(run("check", "leg8", "--json").out)
    assert len(report["muscles"]) == 8
    empty = tmp_path / "empty.xml"
    empty.write_text("<mujoco><worldbody/></mujoco>")
    outcome = run("check", empty)
    assert outcome.code == 2
    assert len(outcome.errors) == 1
    assert "no muscle" in outcome.errors[0]


def test_names_that_opensim_cannot_read_are_found_before_the_work(run, tmp_path):
    model, table = tmp_path / "blank.xml", tmp_path / "lift.csv"
    xml = HANGING_MASS.format(actuator=MUSCLE_ACTUATOR.replace("pull", "pull up"))
    model.write_text(xml)
    table.write_text("time,height (m)\n" + "".join(f"{t / 100},0\n" for t in range(20)))
    outcome = run("solve", table, "--model", model, "--opensim", "--out", tmp_path / "out")
    assert outcome.code == 2
    assert "'pull up' cannot be written" in outcome.errors[-1]
    assert not (tmp_path / "out").exists()


def test_reproduce_can_be_quiet(run, tmp_path, no_figures, timed_once):
    outcome = run("reproduce", "--dt", "0.05", "--quiet", "--out", tmp_path / "out")
    assert outcome.code in (0, 1)
    assert (outcome.out, outcome.err) == ("", "")
    assert (tmp_path / "out" / "solution.parquet").is_file()


def test_verbose_tells_what_is_done_and_quiet_nothing(run, mot, tmp_path, no_figures):
    path = mot()
    told = run("solve", path, "-v", "--out", tmp_path / "out").err
    assert "hcmc on leg8" in told
    assert "solution.parquet" in told
    outcome = run("solve", path, "--quiet", "--out", tmp_path / "out")
    assert (outcome.out, outcome.err) == ("", "")

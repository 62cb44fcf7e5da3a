"""The examples run from anywhere, write nothing where they are run, and show what they say they show."""

import logging
import re
import runpy
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from needs import missing

from mjhcmc.errors import MjhcmcWarning

pytestmark = pytest.mark.examples

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples"
BENCHMARKS = ROOT / "benchmarks"


@pytest.fixture
def run(tmp_path, monkeypatch, capsys, coarse_replay, coarse_figures):
    """Run an example from an empty folder with temporary files of its own: (its names, what it prints, its files)."""

    def run_one(name):
        here, temporary = tmp_path / "here", tmp_path / "temporary"
        here.mkdir()
        temporary.mkdir()
        monkeypatch.chdir(here)
        monkeypatch.setattr(tempfile, "tempdir", str(temporary))
        names = runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        assert not list(here.iterdir())
        files = {path.name: path for path in temporary.rglob("*") if path.is_file()}
        return names, capsys.readouterr().out, files

    return run_one


def test_every_example_is_tested():
    tested = set(re.findall(r'run\("(\d\d_\w+\.py)"\)', Path(__file__).read_text(encoding="utf-8")))
    assert tested == {path.name for path in EXAMPLES.glob("*.py")}


def test_from_motion_to_excitations(run):
    names, out, files = run("01_from_motion_to_excitations.py")
    table = pd.read_parquet(files["swing.parquet"])
    assert len(table) == 101
    peak = table[["q_desired/hip", "q_desired/knee", "q_desired/ankle"]].abs().max().to_numpy()
    np.testing.assert_allclose(np.rad2deg(peak), [25, 50, 10], rtol=1e-6)  # what the example wrote into its file
    for muscle in names["model"].muscle_names:
        assert table[f"excitation/{muscle}"].dropna().between(0, 1).all()
        assert muscle in out
    assert names["solution"].verdict.passed
    assert np.rad2deg(np.abs(names["solution"].tracking_error).max()) < 0.05
    assert "verdict  holds" in out
    assert str(files["swing.parquet"]) in out


def test_compare_methods(run):
    names, out, files = run("04_compare_methods.py")
    largest = {name: np.abs(s.tracking_error).max(axis=0) for name, s in names["solutions"].items()}
    assert np.all(largest["hcmc"] < largest["cmc"])
    assert np.all(largest["cmc"] < largest["static"])
    assert {"methods.png", "moments.png", "fast_controls.sto", "fast_states.sto"} <= set(files)
    carried = [float(line.split()[1]) for line in out.splitlines() if "N m at the knee" in line]
    hcmc = names["hcmc"]
    assert sum(carried) == pytest.approx(hcmc.net_joint_moment[names["node"], names["knee"]], abs=0.5)


def test_your_own_model(run):
    names, out, _ = run("02_your_own_model.py")
    solution, beyond = names["solution"], names["beyond"]
    assert solution.muscle_names == ("biceps", "triceps")
    assert np.rad2deg(solution.qpos.max()) == pytest.approx(60, abs=0.01)
    assert np.abs(solution.reserve).max() < 1e-3 * solution.peak_moment[0]
    assert solution.verdict.passed
    assert np.rad2deg(beyond.qpos.max()) == pytest.approx(130, abs=1)  # followed all the same
    assert not beyond.verdict.passed
    assert "beyond the muscles: FAILS" in out
    assert re.search(r"elbow: reserve of \S+ N m at \S+ s", out)


def test_look_at_a_solution(run):
    names, out, files = run("03_look_at_a_solution.py")
    assert set(files) == {"fast.parquet", "excitations.png", "excitations.pdf", "tracking.png", "tracking.pdf"}
    assert files["excitations.png"].read_bytes().startswith(b"\x89PNG")
    assert files["tracking.pdf"].read_bytes().startswith(b"%PDF")
    np.testing.assert_array_equal(names["table"]["q/hip"], names["solution"].qpos[:, 0])
    assert np.rad2deg(names["drift"]).max() < 0.1
    assert "verdict: holds" in out


@pytest.mark.parametrize("script", sorted(path.name for path in BENCHMARKS.glob("[a-z]*.py")))
def test_benchmarks_say_what_they_do(script, monkeypatch, capsys):
    """They import without error, and take their options."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    monkeypatch.setattr(sys, "argv", [script, "--help"])
    with pytest.raises(SystemExit) as done:
        runpy.run_path(str(BENCHMARKS / script), run_name="__main__")
    assert done.value.code == 0
    assert script in capsys.readouterr().out


@pytest.mark.parametrize(
    ("script", "document"),
    [
        ("accuracy.py", "accuracy.md"),
        ("convergence.py", "accuracy.md"),
        ("recovery.py", "accuracy.md"),
        ("corrector.py", "method.md"),
        ("patients.py", "patients.md"),
        ("patients_distributions.py", "patients.md"),
        ("patients_inverse.py", "patients.md"),
        ("engines.py", "engines.md"),
        ("precision.py", "precision.md"),
        ("integrators.py", "integrators.md"),
        ("gradients.py", "gradients.md"),
        ("sensitivity.py", "sensitivity.md"),
        ("environments.py", "howto/train-a-policy.md"),
        ("live.py", "viewing.md"),
        ("validation.py", "validation.md"),
    ],
)
def test_documents_have_their_tables(script, document, monkeypatch):
    """Each table in docs stands between the marks of its script, so that --write finds it again."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    helper = runpy.run_path(str(BENCHMARKS / "_markdown.py"))
    text = (ROOT / "docs" / document).read_text(encoding="utf-8")
    begin, end = helper["marks"](script)
    table = text.split(begin)[1].split(end)[0]
    assert re.search(r"\| ?---", table)
    assert helper["into"](text, script, table.strip()) == text
    changed = helper["into"](text, script, "another table")
    assert changed.count("another table") == 1
    assert changed.replace("another table", table.strip()) == text


def test_many_at_once(run):
    names, out, _ = run("05_many_at_once.py")
    assert sorted(names["batch"].errors) == [4]
    assert out.count("verdict holds") == 5
    assert "the same bits: True" in out


def test_emg(run):
    with pytest.warns(MjhcmcWarning, match=r"VL with gaps"):
        names, out, files = run("06_emg.py")
    assert {"trial.csv", "before.png", "after.png"} <= set(files)
    misses = re.findall(r"by (\S+) where it was measured, (\S+) elsewhere", out)
    measured, elsewhere = np.array(misses, dtype=float).T
    assert measured[1] < 0.2 * measured[0]
    assert elsewhere[1] < 0.5 * elsewhere[0]
    mae = [{one.muscle: one.mae for one in found.muscles} for found in (names["before"], names["after"])]
    assert mae[1]["soleus"] < mae[0]["soleus"]
    assert np.rad2deg(np.abs(names["informed"].tracking_error)).max() < 0.05


def test_ground_reaction(run):
    names, out, files = run("07_ground_reaction.py")
    solution = names["solution"]
    assert solution.verdict.passed
    assert "verdict: holds" in out
    assert np.rad2deg(np.abs(solution.tracking_error).max()) < 0.01
    # beside the push, 200 N at its peak, the pelvis bears what the leg weighs and how it is thrown up and down
    assert np.abs(solution.external_load[:, 1]).max() == pytest.approx(200, rel=1e-3)
    assert np.abs(solution.residual[:, 1]).max() > 100
    assert not files


def test_a_virtual_patient(run):
    names, out, files = run("08_virtual_patient.py")
    peaks = [float(value) for value in re.findall(r"resistance up to\s+(\S+) N m", out)]
    assert peaks[2] > peaks[1]  # faster is harder
    assert names["found"].gain == pytest.approx(names["group"].gain, rel=0.1)
    assert re.search(r"Modified Ashworth grade (0|1|1\+|2|3|4)\n", out)
    assert not files


def test_a_dataset_of_patients(run, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    names, out, _ = run("09_patient_dataset.py")
    assert len(names["people"]) == 2
    assert "pandas: peak torque of 11 trials" in out
    assert re.search(r"^polars(: largest reflex| is not installed)", out, re.MULTILINE)
    assert re.search(r"^datasets(: \d+ rows| is not installed)", out, re.MULTILINE)


def test_sensitivity(run):
    names, out, files = run("10_sensitivity.py")
    assert {"sensitivity.csv", "sensitivity.png", "intervals.csv", "intervals.png"} <= set(files)
    assert names["found"].failed == {}
    assert out.count("least known at") == 8


def test_calibration(run):
    names, out, files = run("11_calibration.py")
    assert np.abs(names["found"].values / names["true"] - 1).max() < 0.1
    assert out.count(" N, ") == 8
    assert not files


def test_a_folder_of_motions(run):
    _, out, files = run("12_folder_of_motions.py")
    assert {"slow.mot", "slow.parquet", "brisk.parquet", "comfortable.parquet", "summary.csv"} <= set(files)
    summary = pd.read_csv(files["summary.csv"], index_col="motion")
    assert summary["holds"].all()
    for name, row in summary.iterrows():
        table = pd.read_parquet(files[f"{name}.parquet"])
        assert row["mean/iliopsoas"] == pytest.approx(table["excitation/iliopsoas"].mean())
        assert f"{name}: {len(table) - 1} windows" in out
    assert list(summary.loc[["slow", "comfortable", "brisk"], "mean/iliopsoas"].diff().dropna() > 0) == [True, True]


def test_report_and_video(run):
    _, out, files = run("13_report_and_video.py")
    page = files["report.html"].read_text(encoding="utf-8")
    for word in ("soleus", "static optimization", "EMG"):
        assert word in page
    assert not re.search(r"""<(script|link|img|iframe)[^>]*(src|href)=["']https?:""", page)
    if "no video" in out:
        missing("no OpenGL for drawing without a screen")
    assert files["fast.gif"].read_bytes().startswith(b"GIF8")


def test_plain_mujoco(run):
    names, out, files = run("14_plain_mujoco.py")
    assert set(files) == {"fast.parquet"}
    assert names["off"] < 1e-9  # the same steps on the same model: rounding
    assert np.rad2deg(np.abs(names["qpos"]).max()) > 15
    assert names.get("apart", 0.0) < 1e-9
    assert "dm_control" in out


def test_hill_muscles(run):
    names, out, files = run("15_hill_muscles.py")
    assert {"hill.png", "hill.pdf"} <= set(files)
    assert 0 <= names["apart"] < 1e-12
    assert np.abs(names["engine"]).max() > 10  # N: there was something to agree on
    assert np.abs(names["elastic"].activation - names["solution"].activation).max() > 0.01
    assert "the verdict holds" in out


@pytest.mark.filterwarnings("ignore:Attaching a spec")
def test_a_model_of_myosuite(run):
    pytest.importorskip("myo_sim")
    try:
        names, out, files = run("16_myosuite_model.py")
    finally:
        logging.disable(logging.NOTSET)
    assert names["solution"].verdict.passed
    assert names["error"] < 0.01
    assert "solve takes this model" in out
    assert not files


def test_expert_trajectories(run):
    pytest.importorskip("gymnasium")
    _, out, files = run("17_expert_trajectories.py")
    assert set(files) == {"expert.parquet"}
    earned = {name: float(share) for name, share in re.findall(r"^(\w+) +earns +(\S+) %", out, re.MULTILINE)}
    assert earned["expert"] > 98
    assert earned["linear"] > 90
    assert max(earned["zero"], earned["random"]) < 60


@pytest.mark.parametrize(
    ("name", "missing", "remedy"),
    [
        ("16_myosuite_model.py", "myo_sim", "pip install myo-sim"),
        ("17_expert_trajectories.py", "gymnasium", 'pip install "mjhcmc[learn]"'),
    ],
)
def test_what_an_example_needs_is_named(name, missing, remedy, monkeypatch):
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(SystemExit) as told:
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    assert remedy in str(told.value.code)
    opening = (EXAMPLES / name).read_text(encoding="utf-8").split('\n"""')[0]
    assert remedy.replace("'", '"') in opening


def test_examples_are_short_and_listed():
    listed = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    for path in sorted(EXAMPLES.glob("*.py")):
        assert len(path.read_text(encoding="utf-8").splitlines()) < 60, path.name
        assert f"]({path.name})" in listed


def test_documents_name_the_distributions_that_are_drawn_from():
    from mjhcmc.patients.distributions import distributions_table

    assert distributions_table().strip() in (ROOT / "docs" / "patients.md").read_text(encoding="utf-8")

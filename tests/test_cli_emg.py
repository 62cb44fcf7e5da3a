"""The command emg, and the EMG options of solve."""

import json
import re

import numpy as np
import pandas as pd
import pytest

import mjhcmc


@pytest.fixture
def solved(slow_solution, tmp_path):
    """A folder as solve leaves it."""
    folder = tmp_path / "out"
    folder.mkdir()
    slow_solution.save(folder / "solution.parquet")
    return folder


@pytest.fixture
def envelopes(slow_solution, tmp_path):
    """Its excitations as measured, in millivolts, two channels and one nobody asks for."""
    names = slow_solution.muscle_names
    u = 0.3 * slow_solution.excitation
    table = pd.DataFrame({"time": slow_solution.time[:-1] + 0.005})
    for channel, muscle in (("VL", "vasti"), ("SOL", "soleus"), ("spare", "rect_fem")):
        table[channel] = u[:, names.index(muscle)]
    path = tmp_path / "emg.csv"
    table.to_csv(path, index=False)
    return path


@pytest.fixture
def channels(tmp_path):
    path = tmp_path / "map.csv"
    path.write_text("muscle,channel\nvasti,VL\nsoleus,SOL\n")
    return path


def test_compare(run, solved, envelopes, channels, tmp_path):
    found = run("emg", solved, envelopes, "--map", channels, "--out", tmp_path / "report")
    assert (found.code, found.err) == (0, "")
    assert "hcmc on leg8" in found.out
    assert "vasti" in found.out
    files = {path.name for path in (tmp_path / "report").iterdir()}
    assert files == {"emg.csv", "emg.json", "emg.png", "emg.pdf"}
    table = pd.read_csv(tmp_path / "report" / "emg.csv").set_index("muscle")
    assert table.loc["vasti", "r"] == pytest.approx(1)
    assert table.loc["vasti", "channel"] == "VL"
    assert (tmp_path / "report" / "emg.png").read_bytes().startswith(b"\x89PNG")


def test_json_and_nothing_else(run, solved, envelopes, channels):
    found = run("emg", solved / "solution.parquet", envelopes, "--map", channels, "--json")
    numbers = json.loads(found.out)
    assert numbers["muscles"]["vasti"]["r"] == pytest.approx(1)
    assert numbers["files"] == []
    assert found.code == 0
    assert run("emg", solved, envelopes, "--map", channels, "--quiet").out == ""


def test_raw_and_shift(run, solved, slow_solution, tmp_path):
    """Raw EMG that began 2 s late on its own clock."""
    time = np.arange(3600) / 2000
    rng = np.random.default_rng(0)
    u = np.interp(time, slow_solution.time[:-1] + 0.005, slow_solution.excitation[:, 4])
    path = tmp_path / "raw.csv"
    pd.DataFrame({"time": time + 2, "vasti": (u + 0.002) * rng.standard_normal(3600)}).to_csv(path, index=False)
    found = run("emg", solved, path, "--shift", -2, "--json")
    assert json.loads(found.out)["muscles"]["vasti"]["r"] > 0.8
    assert "is not there" not in found.err
    refused = run("emg", solved, path)
    assert refused.code == 2
    assert "bring it onto the solution's clock" in refused.err
    told = run("emg", solved, path, "--envelope")
    assert told.code == 2
    assert "as no envelope does: mark it as raw" in told.err


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"map": "muscle,channel\nsartorius,VL\n"}, "no muscle sartorius: the muscles are iliopsoas"),
        ({"map": "muscle,channel\nvasti,X\n"}, "no channel X: the channels are VL, SOL, spare"),
        ({"map": "vasti\n"}, "EMG map .*map.csv, line 1: 'vasti' are no two names: write muscle,channel"),
        ({"band": (20, 400)}, "--band is of raw EMG"),
    ],
)
def test_bad_input(run, solved, envelopes, channels, change, message):
    if "map" in change:
        channels.write_text(change["map"])
    more = ["--band", *change["band"]] if "band" in change else []
    found = run("emg", solved, envelopes, "--map", channels, *more)
    assert found.code == 2
    assert len(found.err.splitlines()) == 1
    assert re.search(message, found.err)


def test_an_empty_folder(run, tmp_path, envelopes):
    found = run("emg", tmp_path, envelopes)
    assert found.code == 2
    assert "holds no solution.parquet" in found.err


def test_solve(run, mot, envelopes, channels, tmp_path, no_figures):
    """Channels in the file's units, over maximum contractions: activation comes near them."""
    (tmp_path / "mvc.json").write_text(json.dumps({"VL": 0.03, "SOL": 0.3, "unused": 1.0}))
    options = ("--emg", envelopes, "--emg-map", channels, "--emg-mvc", tmp_path / "mvc.json", "--emg-weight", 50)
    found = run("solve", mot(), *options, "--emg-delay", 0.01, "--json", "--out", tmp_path / "solved")
    assert found.code == 0, found.err
    emg = json.loads(found.out)["settings"]["emg"]
    assert emg["channels"] == {"vasti": "VL", "soleus": "SOL"}
    assert emg["weight"] == {"VL": 50, "SOL": 50}
    assert (emg["delay"], emg["scale"]) == (0.01, "mvc")
    plain = run("solve", mot(), "--json", "--out", tmp_path / "plain")
    assert json.loads(plain.out)["settings"]["emg"] is None
    with_emg, without = (
        mjhcmc.Solution.load(tmp_path / name / "solution.parquet").activation.max(axis=0)
        for name in ("solved", "plain")
    )
    assert with_emg[4] > 3 * without[4]  # vasti: ten times what the plain solution has


@pytest.mark.parametrize("option", ["map", "weight", "mvc", "delay"])
def test_options_without_emg(run, mot, tmp_path, option):
    found = run("solve", mot(), f"--emg-{option}", 1, "--out", tmp_path / "o")
    assert found.code == 2
    assert f"--emg-{option} goes with --emg" in found.err

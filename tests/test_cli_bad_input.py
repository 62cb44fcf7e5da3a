"""The command line on bad input: one line, exit code 2, nothing left behind."""

from pathlib import Path

import numpy as np
import pytest
from cli_tools import FIRST_ROW, LONG, put, replaced
from conftest import PENDULUMS

# --- bad input: one line, exit code 2, nothing left behind -------------------------------------------------------


def refused(outcome, *words):
    """Exit code 2, one line of error, no traceback, nothing on standard output, every word in the line."""
    assert outcome.code == 2
    assert outcome.out == ""
    assert len(outcome.errors) == 1, outcome.err
    (line,) = outcome.errors
    assert line.startswith("mjhcmc: error: ")
    assert "Traceback" not in line
    for word in words:
        assert str(word) in line


def cut_rows(count):
    """An edit: keep so many rows, and let the header say so."""

    def edit(lines):
        del lines[FIRST_ROW - 1 + count :]
        lines[2] = f"nRows={count}"

    return edit


BAD_FILES = {
    "no header": (lambda lines: lines.__delitem__(slice(0, 6)), ["endheader"]),
    "no rows": (lambda lines: lines.__delitem__(slice(FIRST_ROW - 1, None)), ["no rows"]),
    "no column names": (lambda lines: lines.__delitem__(slice(FIRST_ROW - 2, None)), ["endheader"]),
    "cut between rows": (lambda lines: lines.__delitem__(slice(50, None)), ["nRows=121", "line 50", "cut off"]),
    "cut in a row": (lambda lines: lines.__setitem__(slice(50, None), ["0.21\t1."]), ["line 51", "2 values"]),
    "nan": (put(20, 2, "nan"), ["line 28", "'knee'", "nan"]),
    "inf": (put(20, 3, "inf"), ["line 28", "'hip'", "inf"]),
    "-inf": (put(0, 4, "-Inf"), ["line 8", "'ankle'", "-inf"]),
    "nan time": (put(20, 0, "NaN"), ["line 28", "'time'", "nan"]),
    "words": (put(20, 2, "bent"), ["line 28", "'knee'", "'bent'"]),
    "three rows": (cut_rows(3), ["3 rows", "at least 4"]),
    "one row": (cut_rows(1), ["1 row ", "at least 4"]),
    "time stands": (put(20, 0, "0.095"), ["line 28", "0.095", "same time"]),
    "time falls": (put(20, 0, "0.05"), ["line 28", "0.05", "0.095", "increase"]),
    "no column": (replaced("knee", "elbow"), ["knee", "elbow", "leg8"]),
    "twice the column": (replaced("pelvis_tx", "hip"), ["line 7", "'hip'"]),
    "no inDegrees": (lambda lines: lines.__delitem__(4), ["inDegrees"]),
    "odd inDegrees": (replaced("inDegrees=yes", "inDegrees=maybe"), ["inDegrees=maybe"]),
    "degrees called radians": (replaced("inDegrees=yes", "inDegrees=no"), ["inDegrees=yes", "looks like degrees"]),
    "outside its range": (replaced("knee\thip", "hip\tknee"), ["knee", "10", "deg", "0.3 s", "-120 .. 10"]),
    "beyond its range": (put(60, 4, "95"), ["ankle", "deg", "s", "-90 .. 90"]),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_motion_files(run, mot, tmp_path, case):
    edit, words = BAD_FILES[case]
    amplitudes = {"hip": np.deg2rad(15), "knee": np.deg2rad(-20)} if case == "outside its range" else None
    path = mot("bad.mot", edit=edit, amplitudes=amplitudes)
    refused(run("solve", path, "--out", tmp_path / "deep" / "out"), "bad.mot", *words)
    assert not (tmp_path / "deep").exists()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.mot", None, ["none.mot", "no such file"]),
        ("empty.mot", b"", ["empty.mot", "empty"]),
        ("blank.sto", b"\n \n", ["blank.sto", "empty"]),
        ("binary.mot", bytes(range(256)) * 20, ["binary.mot", "not a text file"]),
        ("zeros.mot", bytes(1000), ["zeros.mot", "not a text file"]),
        ("prose.mot", b"Once upon a time\n", ["prose.mot", "endheader"]),
        ("table.txt", b"time,hip\n0,1\n", ["table.txt", ".mot", ".sto", ".csv", ".trc"]),
        ("table.csv", b"time,hip\n0,1\n", ["table.csv", "joint knee", "its columns are hip"]),
        ("nothing", b"", ["nothing", ".mot"]),
        (f"{LONG}.mot", None, ["xxx.mot", "too long"]),
    ],
)
def test_what_is_no_motion_file(run, tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    refused(run("solve", tmp_path / name, "--out", tmp_path / "out"), *words)
    assert not (tmp_path / "out").exists()


def test_a_folder_is_no_motion_file(run, tmp_path):
    (tmp_path / "folder.mot").mkdir()
    refused(run("solve", tmp_path / "folder.mot", "--out", tmp_path / "out"), "folder.mot", "is a folder")


@pytest.mark.parametrize("share", np.linspace(0.001, 0.99, 12).round(3))
def test_a_file_cut_off_anywhere(run, mot, tmp_path, share):
    path = mot()
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    refused(run("solve", path, "--out", tmp_path / "out"), "walk.mot")
    assert not (tmp_path / "out").exists()


BAD_OPTIONS = {
    "dt 0": (["--dt", "0"], ["dt", "positive", "0.0"]),
    "dt < 0": (["--dt", "-0.01"], ["dt", "positive", "-0.01"]),
    "dt nan": (["--dt", "nan"], ["dt", "nan"]),
    "dt inf": (["--dt", "inf"], ["dt", "inf"]),
    "dt too long": (["--dt", "0.7"], ["dt 0.7 s", "longer than the motion", "0.6 s"]),
    "dt no number": (["--dt", "soon"], ["--dt", "'soon'"]),
    "physics_dt 0": (["--physics-dt", "0"], ["--physics-dt", "positive"]),
    "physics_dt nan": (["--physics-dt", "nan"], ["--physics-dt", "nan"]),
    "method": (["--method", "magic"], ["'magic'", "hcmc"]),
    "solver": (["--solver", "simplex"], ["'simplex'", "newton", "daqp"]),
    "option": (["--spee", "3"], ["--spee"]),
    "argument": (["second.mot"], ["second.mot"]),
    "option without value": (["--dt"], ["--dt"]),
    "lowpass 0": (["--lowpass", "0"], ["low-pass", "0"]),
    "lowpass nan": (["--lowpass", "nan"], ["low-pass", "nan"]),
    "lowpass too high": (["--lowpass", "150"], ["150", "100", "walk"]),
    "start": (["--start", "3"], ["walk.mot", "start 3 s", "0 .. 0.6"]),
    "start nan": (["--start", "nan"], ["walk.mot", "start nan"]),
    "end": (["--end", "-1"], ["walk.mot", "end -1 s"]),
    "end before start": (["--start", "0.4", "--end", "0.2"], ["walk.mot", "0.4", "0.2"]),
    "crop of three rows": (["--start", "0.1", "--end", "0.11"], ["walk.mot", "3 rows", "at least 4"]),
    "map missing": (["--map", "nowhere.json"], ["nowhere.json"]),
    "model missing": (["--model", "leg9"], ["'leg9'", "leg8"]),
    "model file missing": (["--model", "some/where.xml"], ["some/where.xml"]),
}


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_bad_options(run, mot, tmp_path, case):
    arguments, words = BAD_OPTIONS[case]
    refused(run("solve", mot(), "--out", tmp_path / "deep" / "out", *arguments), *words)
    assert not (tmp_path / "deep").exists()


def test_bad_commands(run, mot, tmp_path):
    refused(run("slove"), "slove")
    refused(run("--fast"), "--fast")
    refused(run("solve"), "MOTION")
    refused(run("solve", mot()), "--out")
    refused(run("reproduce", "extra"), "extra")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", ["not JSON", "line 1"]),
        ("[1]", ["object"]),
        ('{"hip": 3}', ["'hip'", "3"]),
        ('{"elbow": "hip"}', ["elbow", "hip, knee, ankle"]),
        ('{"hip": "swing"}', ["'swing'", "hip", "pelvis_tx"]),
    ],
)
def test_bad_maps(run, mot, tmp_path, text, words):
    (tmp_path / "map.json").write_text(text)
    refused(run("solve", mot(), "--map", tmp_path / "map.json", "--out", tmp_path / "out"), *words)
    assert not (tmp_path / "out").exists()


BAD_MODELS = {
    "empty": ("", []),
    "prose": ("not XML at all", []),
    "broken": (PENDULUMS[: len(PENDULUMS) // 2], []),
    "misspelled": (PENDULUMS.replace("<geom", "<goem"), ["goem"]),
    "no muscle": (PENDULUMS.replace("<muscle", "<motor").replace('lengthrange=".05 .35" ', "").replace(
        'force="400" ', "").replace('force="200" ', ""), ["muscle"]),
    "no actuator": (PENDULUMS[: PENDULUMS.index("<actuator>")] + "</mujoco>", ["muscle"]),
    "actuatorfrcrange": (PENDULUMS.replace(
        'name="elbow"', 'name="elbow" actuatorfrclimited="true" actuatorfrcrange="-1 1"'),
        ["'elbow'", "actuatorfrcrange"]),
    "flex equality": (PENDULUMS.replace(
        "<worldbody>", '<worldbody><flexcomp name="cord" type="grid" count="2 1 1" spacing=".1 .1 .1" dim="1" '
        'pos="1 0 0"><edge equality="true"/></flexcomp>'), ["equality", "type"]),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_MODELS)
def test_bad_models(run, mot, tmp_path, case):
    text, words = BAD_MODELS[case]
    (tmp_path / "own.xml").write_text(text)
    outcome = run("solve", mot(), "--model", tmp_path / "own.xml", "--out", tmp_path / "out")
    name = "two_joints" if words and case != "misspelled" else "own.xml"
    refused(outcome, name, *words)
    assert not (tmp_path / "out").exists()


def test_what_is_no_model_file(run, mot, tmp_path):
    (tmp_path / "binary.xml").write_bytes(bytes(range(256)) * 20)
    (tmp_path / "folder.xml").mkdir()
    for name in ("binary.xml", "folder.xml"):
        refused(run("solve", mot(), "--model", tmp_path / name, "--out", tmp_path / "out"), name)
    assert not (tmp_path / "out").exists()


def test_what_mujoco_warns_of_is_a_notice_and_leaves_no_log_behind(run, mot, tmp_path, monkeypatch):
    (tmp_path / "binary.mjb").write_bytes(bytes(range(256)) * 20)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    outcome = run("solve", mot(), "--model", tmp_path / "binary.mjb", "--out", tmp_path / "out")
    refused(outcome, "binary.mjb")
    assert any("MuJoCo: " in notice for notice in outcome.notices)
    assert not list((tmp_path / "here").iterdir())


def test_a_model_of_other_joints(run, mot, tmp_path):
    (tmp_path / "arm.xml").write_text(PENDULUMS)
    outcome = run("solve", mot(), "--model", tmp_path / "arm.xml", "--out", tmp_path / "out")
    refused(outcome, "walk.mot", "shoulder", "two_joints", "pelvis_tx")


def test_output_folders_that_cannot_be(run, mot, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    here = sorted(path.name for path in (tmp_path, *[mot()]) if path.is_file())
    for folder in (tmp_path / "file", tmp_path / "file" / "deep" / "out", tmp_path / LONG, tmp_path / "new" / LONG):
        refused(run("solve", mot(), "--out", folder), folder, "cannot be written")
        refused(run("reproduce", "--out", folder), folder, "cannot be written")
    assert (tmp_path / "file").read_text() == "not a folder"
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["file", *here])


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no /proc here: a folder where nobody may write")
def test_an_output_folder_where_nobody_may_write(run, mot):
    refused(run("solve", mot(), "--out", "/proc/mjhcmc/out"), "/proc/mjhcmc/out", "cannot be written")


def test_bad_reproduce(run, tmp_path):
    out = tmp_path / "out"
    refused(run("reproduce", "--movement", "hop", "--out", out), "'hop'", "fast", "slow")
    refused(run("reproduce", "--dt", "0", "--out", out), "dt", "positive")
    refused(run("reproduce", "--dt", "9", "--out", out), "dt 9 s", "longer than the motion")
    refused(run("reproduce", "--physics-dt", "-1", "--json"), "--physics-dt", "positive")
    assert not out.exists()

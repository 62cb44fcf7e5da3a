"""``mjhcmc report``: a page beside the solution, or one line that says why not, and nothing written."""

import hashlib
import json

import numpy as np
import pytest
from cli_tools import LONG
from plot_tools import make
from report_tools import taken_apart

import mjhcmc
from mjhcmc.cli_report import _labels


@pytest.fixture
def folder(tmp_path, fast_solution):
    """A folder with a solution, as solve would write it."""
    place = tmp_path / "fast"
    place.mkdir()
    fast_solution.save(place / "solution.parquet")
    return place


def emg_file(path, solution, shift=0.0, names=None, columns=3):
    """A table of envelopes: activations of the first muscles."""
    names = names or solution.muscle_names[:columns]
    rows = [",".join(["time", *names])]
    for time, row in zip(solution.time + shift, solution.activation, strict=True):
        rows.append(",".join(f"{value:.6f}" for value in (time, *row[: len(names)])))
    path.write_text("\n".join(rows) + "\n")
    return path


def test_a_page_beside_the_solution(run, folder, fast_solution):
    done = run("report", folder)
    assert done.code == 0
    assert "verdict  holds" in done.out
    assert f"written  {folder / 'report.html'}" in done.out
    page = taken_apart((folder / "report.html").read_text(encoding="utf-8"))
    assert "fiber_length/soleus" in page.data["columns"]  # its model was found
    assert "sha256" in page.words("facts")
    assert sorted(file.name for file in folder.iterdir()) == ["report.html", "solution.parquet"]
    again = run("report", folder / "solution.parquet", "--quiet", "--model", "leg8", "--out", folder / "ü b.html")
    assert (again.code, again.out, again.err) == (0, "", "")
    assert (folder / "ü b.html").is_file()


def test_emg_and_another_method_are_laid_over(run, folder, fast_solution, tmp_path):
    other = tmp_path / "static"
    other.mkdir()
    make(method="static").save(other / "solution.parquet")
    recording = emg_file(tmp_path / "emg.csv", fast_solution, names=("RF", "Ham"))
    channels = tmp_path / "map.csv"
    channels.write_text("muscle,channel\nrect_fem,RF\nhamstrings,Ham\n")
    shift = 0.01
    done = run(
        "report", folder, "--emg", recording, "--map", channels, "--shift", shift, "--delay", 0.05, "--out",
        tmp_path / "page.html",
    )  # fmt: skip
    assert (done.code, done.errors) == (0, [])
    page = taken_apart((tmp_path / "page.html").read_text(encoding="utf-8"))
    time, values = page.column("emg/hamstrings")
    wanted = np.interp(time, fast_solution.time + shift, fast_solution.activation[:, 1])  # its second column
    np.testing.assert_allclose(values, wanted, atol=1e-5)
    assert "within lags of 50 ms" in page.words("excitations")
    assert run("report", folder, "--with", other, "--out", tmp_path / "page.html").errors == [
        "mjhcmc: error: static: covers 0.6 to 0.9 s, the solution 0 to 0.6 s: give one of the same motion"
    ]
    assert run("report", other, "--with", other / "solution.parquet", "--out", tmp_path / "page.html").code == 0
    assert (
        "other0/activation/soleus" in taken_apart((tmp_path / "page.html").read_text(encoding="utf-8")).data["columns"]
    )


def test_bad_input_is_one_line_and_nothing_is_written(run, folder, fast_solution, tmp_path):
    late = emg_file(tmp_path / "late.csv", fast_solution, shift=99)
    odd = emg_file(tmp_path / "odd.csv", fast_solution, names=("ch1", "ch2"))
    wrong = tmp_path / "map.json"
    wrong.write_text('{"soleus": "ch9"}')
    (tmp_path / "empty").mkdir()
    other = tmp_path / "arm.parquet"
    make(muscles=("biceps",)).save(other)
    before = sorted(file.name for file in folder.iterdir())
    for arguments, words in (
        ([tmp_path / "none"], "no such file or folder"),
        ([tmp_path / "empty"], "holds no solution.parquet"),
        ([late], "late.csv"),
        ([folder, "--model", "leg9"], "leg9"),
        ([folder, "--out", tmp_path / "none" / "page.html"], "create it first"),
        ([folder, "--out", tmp_path / f"{LONG}.html"], "cannot be written"),
        ([folder, "--out", tmp_path / "empty"], "is a folder"),
        ([folder, "--emg", late], "shifted"),
        ([folder, "--emg", odd], "ch1"),
        ([folder, "--emg", odd, "--map", wrong], "ch9"),
        ([folder, "--emg", tmp_path / "none.csv"], "none.csv"),
        ([folder, "--map", wrong], "--map is of EMG"),
        ([folder, "--lowpass", 6], "--lowpass is of EMG"),
        ([folder, "--with", other], "none of the muscles"),
        ([folder, "--with", tmp_path / "gone"], "no such file or folder"),
        ([folder, "--with", other, "--with", other], "stands twice"),
    ):
        done = run("report", *arguments)
        assert (done.code, done.out, len(done.errors)) == (2, "", 1), (arguments, done)
        assert words in done.errors[0], arguments
        assert sorted(file.name for file in folder.iterdir()) == before
    assert not list((tmp_path / "empty").iterdir())


def test_a_run_that_somebody_wrote_otherwise_is_no_obstacle(run, folder):
    told = dict.fromkeys(("shipped_name", "sha256", "compiled_sha256"), 1) | {"source": "file", "path": 5}
    own = {"sha256": hashlib.sha256((folder / "solution.parquet").read_bytes()).hexdigest()}
    (folder / "run.json").write_text(json.dumps({"solution": own, "model": told, "notices": 3, "command": 4}))
    done = run("report", folder)
    assert (done.code, done.errors) == (0, [])


def test_a_page_that_is_there_is_kept_until_the_new_one_is_whole(run, folder, monkeypatch):
    (folder / "report.html").write_text("old")
    monkeypatch.setattr("mjhcmc.report.page.facts_section", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run("report", folder)
    assert (folder / "report.html").read_text() == "old"
    assert len(list(folder.iterdir())) == 2


def test_solutions_beside_have_names_that_differ(tmp_path):
    files = [tmp_path / a / "run" / "solution.parquet" for a in ("one", "two")] + [tmp_path / "three.parquet"]
    assert [label for label, _ in _labels(files)] == ["one/run", "two/run", f"{tmp_path.name}/three"]
    assert _labels([tmp_path / "x"])[0][0] == "x"


def test_it_is_offered_and_explained(run):
    told = run("report", "-h")
    assert told.code == 0
    assert all(word in told.out for word in ("--with OTHER", "--emg FILE", "--out FILE", "Example"))
    assert mjhcmc.write_report.__module__ == "mjhcmc.report.page"

"""Logging: silent unless asked, under mjhcmc's own names."""

import logging
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import PENDULUMS

import mjhcmc
from mjhcmc.model_check.check import check

ROOT = Path(__file__).resolve().parents[1]


def test_loading_a_model_is_told(tmp_path, caplog):
    path = tmp_path / "arm.xml"
    path.write_text(PENDULUMS)
    with caplog.at_level("INFO", logger="mjhcmc"):
        mjhcmc.MuscleModel.load(path)
    (record,) = caplog.records
    assert (record.name, record.levelname) == ("mjhcmc.model", "INFO")
    assert record.getMessage() == "model 'two_joints' loaded: 2 muscles, joints shoulder, elbow"
    caplog.clear()
    with caplog.at_level("DEBUG", logger="mjhcmc.model"):
        mjhcmc.MuscleModel.load(path)
    assert "flexor, biceps" in caplog.text


def test_checking_a_model_is_told(caplog, two_joints):
    with caplog.at_level("INFO", logger="mjhcmc"):
        check(two_joints)
    assert "model 'two_joints' checked: 0 errors" in caplog.text


@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".sto"])
def test_files_written_and_read_are_told(tmp_path, caplog, slow_solution, suffix):
    path = tmp_path / f"slow{suffix}"
    with caplog.at_level("INFO", logger="mjhcmc"):
        slow_solution.save(path)
        mjhcmc.Solution.load(path)
    written, read = [r.getMessage() for r in caplog.records if r.name == "mjhcmc.io.tables"]
    rows = slow_solution.n_window + 1
    assert written == f"solution written: {path}, {rows} rows"
    assert read == f"solution read: {path}, {rows} rows, 8 muscles"


def test_a_file_that_could_not_be_written_is_not_told(tmp_path, caplog, slow_solution):
    with caplog.at_level("INFO", logger="mjhcmc"), pytest.raises(mjhcmc.OutputError):
        slow_solution.save(tmp_path / "nowhere" / "slow.parquet")
    assert "written" not in caplog.text


def run_python(code):
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env={"PYTHONPATH": str(ROOT)}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def test_silent_unless_asked():
    assert run_python("import mjhcmc; mjhcmc.MuscleModel.load('leg8')") == ("", "")
    asked = "import logging, mjhcmc; logging.basicConfig(level='INFO'); mjhcmc.MuscleModel.load('leg8')"
    out, err = run_python(asked)
    assert out == ""
    assert err == "INFO:mjhcmc.model:model 'leg8' loaded: 8 muscles, joints hip, knee, ankle\n"


def test_the_library_sets_no_level_and_no_handler_that_prints():
    root = logging.getLogger("mjhcmc")
    assert root.level == logging.NOTSET
    assert any(isinstance(handler, logging.NullHandler) for handler in root.handlers)
    mine = [handler for handler in root.handlers if type(handler).__module__ == "logging"]
    assert all(isinstance(handler, logging.NullHandler) for handler in mine)
    assert root.propagate

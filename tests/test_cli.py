"""The command line: files out, exit codes, notices, interrupts."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
import warnings

import numpy as np
import pandas as pd
import pytest
from cli_tools import FIGURES, FILES, FIRST_ROW, JOINTS, MUSCLES, Outcome, put
from conftest import PENDULUMS

import mjhcmc
from mjhcmc.io.opensim import write_table
from mjhcmc.lockstep import Lockstep

pytestmark = pytest.mark.usefixtures("coarse_replay")

# --- what a good run leaves behind ------------------------------------------------------------------------------


def test_solve_writes_solution_verdict_and_figures(run, mot, tmp_path, leg8):
    out = tmp_path / "deep" / "out"
    outcome = run("solve", mot(), "--out", out)
    assert outcome.code == 0
    assert sorted(path.name for path in out.iterdir()) == sorted(FILES)
    for name in FIGURES:
        assert (out / name).read_bytes().startswith(b"\x89PNG" if name.endswith("png") else b"%PDF")
    solution = mjhcmc.Solution.load(out / "solution.parquet")
    direct = mjhcmc.hcmc(leg8, mjhcmc.Motion.from_file(mot("again.mot"), leg8))
    np.testing.assert_array_equal(solution.excitation, direct.excitation)
    np.testing.assert_array_equal(solution.time, direct.time)
    verdict = json.loads((out / "verdict.json").read_text())
    assert mjhcmc.Verdict.from_dict(verdict) == solution.verdict == direct.verdict
    assert verdict["passed"] is True
    assert len(pd.read_parquet(out / "solution.parquet")) == 61
    for word in (*JOINTS, *MUSCLES, "verdict  holds", str(out / "tracking.pdf"), "60 windows of 10 ms"):
        assert word in outcome.out
    assert max(len(line) for line in outcome.out.splitlines() if not line.startswith("written")) <= 110
    assert len(outcome.out.splitlines()) <= 24, "one screen"
    assert outcome.notices == ["mjhcmc: notice: columns not used: pelvis_tx"]
    assert outcome.errors == []


def test_json_is_one_object_and_nothing_else(run, mot, tmp_path, no_figures):
    out = tmp_path / "out"
    outcome = run("solve", mot(), "--json", "--out", out)
    assert outcome.code == 0
    assert outcome.out.count("\n") == 1
    result = json.loads(outcome.out)
    for key in ("max_error_deg", "rmse_deg", "peak_moment_nm", "peak_reserve_nm", "replay_max_error_deg"):
        assert tuple(result[key]) == JOINTS
    assert tuple(result["peak_excitation"]) == MUSCLES
    assert result["verdict"]["passed"] is True
    assert result["interrupted"] is False
    assert result["settings"]["dt"] == 0.01
    assert result["files"] == [str(out / name) for name in ("solution.parquet", "verdict.json", "run.json")]
    solution = mjhcmc.Solution.load(out / "solution.parquet")
    error = np.rad2deg(np.abs(solution.tracking_error))
    np.testing.assert_allclose(list(result["max_error_deg"].values()), error.max(axis=0), rtol=1e-12)
    np.testing.assert_allclose(list(result["rmse_deg"].values()), np.sqrt((error**2).mean(axis=0)), rtol=1e-12)
    np.testing.assert_allclose(list(result["peak_excitation"].values()), solution.excitation.max(axis=0), rtol=1e-12)


def test_quiet_prints_nothing(run, mot, tmp_path, no_figures):
    assert run("solve", mot(), "--quiet", "--out", tmp_path / "out") == Outcome(0, "", "")
    assert (tmp_path / "out" / "solution.parquet").is_file()


def test_quiet_still_tells_errors(run, mot, tmp_path):
    outcome = run("solve", tmp_path / "none.mot", "--quiet", "--out", tmp_path / "out")
    assert outcome.code == 2
    assert len(outcome.errors) == 1


def test_start_and_end_are_on_the_files_clock(run, mot, tmp_path, no_figures):
    path = mot(start=0.6)
    assert run("solve", path, "--start", 0.7, "--end", 0.95, "--dt", 0.005, "--out", tmp_path / "out").code == 0
    solution = mjhcmc.Solution.load(tmp_path / "out" / "solution.parquet")
    np.testing.assert_allclose(solution.time, 0.7 + 0.005 * np.arange(51), atol=1e-12)
    assert solution.dt == 0.005


def test_a_map_names_columns_and_flips_signs(run, mot, tmp_path, no_figures):
    def edit(lines):
        lines[FIRST_ROW - 2] = "time\tx\tbend\tswing\tfoot"
        for row in range(FIRST_ROW - 1, len(lines)):
            cells = lines[row].split("\t")
            cells[2] = repr(-float(cells[2]))
            lines[row] = "\t".join(cells)

    (tmp_path / "map.json").write_text('{"hip": "swing", "knee": "-bend", "ankle": "foot"}')
    mapped = mot("mapped.mot", edit=edit)
    assert run("solve", mapped, "--map", tmp_path / "map.json", "--out", tmp_path / "mapped").code == 0
    assert run("solve", mot(), "--out", tmp_path / "plain").code == 0
    found, expected = (mjhcmc.Solution.load(tmp_path / name / "solution.parquet") for name in ("mapped", "plain"))
    np.testing.assert_array_equal(found.excitation, expected.excitation)


def test_lowpass_filters_and_says_so(run, mot, tmp_path, leg8, no_figures):
    path = mot(movement="fast", cycles=3)
    outcome = run("solve", path, "--lowpass", 6, "--out", tmp_path / "out")
    assert outcome.code == 0
    assert any("low-pass filtered at 6 Hz" in notice for notice in outcome.notices)
    solution = mjhcmc.Solution.load(tmp_path / "out" / "solution.parquet")
    desired = mjhcmc.Motion.from_file(path, leg8, 6.0).sample(solution.time).qpos
    np.testing.assert_array_equal(solution.qpos_desired, desired)
    raw = mjhcmc.Motion.from_file(path, leg8).sample(solution.time).qpos
    assert np.rad2deg(np.abs(raw - desired).max()) > 1  # 6 Hz spoils a movement of 5 Hz


def test_noise_is_told_before_it_drives_the_muscles(run, mot, tmp_path, no_figures):
    def shake(lines):
        noise = np.random.default_rng(0).normal(0, 0.005, len(lines))
        for row in range(FIRST_ROW - 1, len(lines)):
            cells = lines[row].split("\t")
            cells[3] = repr(float(cells[3]) + float(noise[row]))
            lines[row] = "\t".join(cells)

    outcome = run("solve", mot(edit=shake), "--out", tmp_path / "out")
    assert outcome.code in (0, 1), outcome.err
    told = [notice for notice in outcome.notices if "hip" in notice and "--lowpass" in notice]
    assert told
    kept = json.loads((tmp_path / "out" / "run.json").read_text())["notices"]
    assert [notice.removeprefix("mjhcmc: notice: ") for notice in told] == [each for each in kept if "noise" in each]
    outcome = run("solve", mot(edit=shake), "--quiet", "--out", tmp_path / "quiet")
    assert not outcome.notices
    assert json.loads((tmp_path / "quiet" / "run.json").read_text())["notices"] == kept  # not shown, still known
    solution = mjhcmc.Solution.load(tmp_path / "out" / "solution.parquet")
    page = mjhcmc.write_report(solution, tmp_path / "page.html", run={"notices": kept}).read_text()
    assert "Noticed while solving" in page


def test_figures_are_left_out_where_nobody_wants_them(run, mot, tmp_path):
    outcome = run("solve", mot(), "--no-figures", "--out", tmp_path / "out")
    assert outcome.code in (0, 1), outcome.err
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "run.json",
        "solution.parquet",
        "verdict.json",
    ]


def test_solver_physics_dt_and_a_model_of_ones_own(run, tmp_path, two_joints, no_figures):
    (tmp_path / "arm.xml").write_text(PENDULUMS)
    t = np.linspace(0, 0.3, 31)
    q = np.rad2deg(mjhcmc.Motion.cosine(two_joints, amplitudes={"elbow": 0.2}, period=0.3, cycles=1).sample(t).qpos)
    write_table(tmp_path / "arm.sto", two_joints.joint_names, t, q, name="arm", in_degrees=True)
    arguments = ["solve", tmp_path / "arm.sto", "--model", tmp_path / "arm.xml", "--physics-dt", 0.0005]
    outcome = run(*arguments, "--solver", "daqp", "--json", "--out", tmp_path / "out")
    assert outcome.code in (0, 1)
    result = json.loads(outcome.out)
    assert result["settings"]["solver"] == "daqp"
    assert result["settings"]["physics_dt"] == 0.0005
    assert result["settings"]["model"] == "two_joints"
    assert tuple(result["max_error_deg"]) == ("shoulder", "elbow")


def test_beyond_the_muscles_strength_all_is_solved_and_the_verdict_fails(run, mot, tmp_path, no_figures):
    """Fast at three times its amplitude and half its period asks for twelve times the acceleration."""
    amplitudes = dict(zip(JOINTS, np.deg2rad([30, -60, -30]), strict=True))
    out = tmp_path / "out"
    outcome = run("solve", mot(amplitudes=amplitudes, period=0.1, cycles=3), "--out", out)
    assert outcome.code == 1
    solution = mjhcmc.Solution.load(out / "solution.parquet")
    assert solution.n_window == 30
    assert np.isfinite(solution.excitation).all()
    share = dict(zip(JOINTS, solution.verdict.peak_reserve_share, strict=True))
    assert max(share.values()) > 0.05
    assert "verdict  FAILS" in outcome.out
    for joint in JOINTS:
        if share[joint] > 0.05:
            assert f"{joint}: reserve of" in outcome.out
    assert "at full excitation: " in outcome.out or "no strength: all muscles together" in outcome.out
    assert json.loads((out / "verdict.json").read_text())["passed"] is False


def test_solving_again_replaces_and_keeps_what_is_not_its_own(run, mot, tmp_path, no_figures):
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    for dt in (0.02, 0.01):
        assert run("solve", mot(), "--dt", dt, "--out", out).code == 0
    assert mjhcmc.Solution.load(out / "solution.parquet").dt == 0.01
    assert sorted(path.name for path in out.iterdir()) == ["notes.txt", "run.json", "solution.parquet", "verdict.json"]
    assert run("solve", tmp_path / "none.mot", "--out", out).code == 2
    assert (out / "notes.txt").read_text() == "mine"


def test_the_measured_walk(run, tmp_path, walk_folder, leg8, no_figures):
    """Its first stride."""
    path = walk_folder / "subject01_walk_IK.mot"
    out = tmp_path / "out"
    end = mjhcmc.Motion.from_file(path, leg8).start + 1.2
    outcome = run("solve", path, "--lowpass", 6, "--dt", 0.005, "--end", end, "--out", out)
    assert outcome.code in (0, 1)
    assert outcome.errors == []
    solution = mjhcmc.Solution.load(out / "solution.parquet")
    desired = mjhcmc.Motion.from_file(path, leg8, 6.0, end=end).sample(solution.time).qpos
    np.testing.assert_array_equal(solution.qpos_desired, desired)
    assert np.rad2deg(np.abs(solution.qpos - desired).max()) < 0.05
    table = pd.read_parquet(out / "solution.parquet")
    assert len(table) == solution.n_window + 1
    assert table["time"].iloc[0] == pytest.approx(mjhcmc.Motion.from_file(path, leg8).start)


# --- notices: told, and the work goes on ------------------------------------------------------------------------


def test_repeated_times_that_agree_are_dropped_with_a_notice(run, mot, tmp_path, no_figures):
    path = mot(edit=lambda lines: (lines.insert(20, lines[19]), lines.__setitem__(2, "nRows=122")))
    outcome = run("solve", path, "--out", tmp_path / "out")
    assert outcome.code == 0
    assert any("1 row dropped" in notice and "line 21" in notice for notice in outcome.notices)


def test_columns_that_match_nothing_are_listed(run, mot, tmp_path, no_figures):
    path = mot(edit=put(3, 1, "nan"))  # nor need they be sound
    outcome = run("solve", path, "--out", tmp_path / "out")
    assert outcome.code == 0
    assert outcome.notices == ["mjhcmc: notice: columns not used: pelvis_tx"]


def test_degrees_that_look_like_radians(run, mot, tmp_path, no_figures):
    outcome = run("solve", mot(factor=np.pi / 180), "--out", tmp_path / "out")
    assert outcome.code == 0
    assert any("walk.mot" in notice and "looks like radians" in notice for notice in outcome.notices)


def test_radians_that_look_like_degrees(run, tmp_path, two_joints, no_figures):
    (tmp_path / "free.xml").write_text(PENDULUMS.replace('limited="true"', 'limited="false"'))
    t = np.linspace(0, 0.3, 31)
    q = np.outer(4 * (1 - np.cos(2 * np.pi * t / 0.3)), [0, 1])
    write_table(tmp_path / "arm.mot", two_joints.joint_names, t, q, name="arm", in_degrees=False)
    outcome = run("solve", tmp_path / "arm.mot", "--model", tmp_path / "free.xml", "--out", tmp_path / "out")
    assert any("arm.mot" in notice and "looks like degrees" in notice for notice in outcome.notices)


def test_a_dt_that_does_not_divide_is_told_once(run, mot, tmp_path, no_figures):
    outcome = run("solve", mot(), "--dt", 0.007, "--out", tmp_path / "out")
    assert outcome.code == 0
    assert sum("does not divide" in notice for notice in outcome.notices) == 1


def test_another_integrator_is_told(run, tmp_path, two_joints, no_figures):
    (tmp_path / "arm.xml").write_text(PENDULUMS.replace("RK4", "implicitfast"))
    q = np.zeros((31, 2))
    write_table(tmp_path / "a.mot", two_joints.joint_names, np.linspace(0, 0.3, 31), q, name="a", in_degrees=True)
    arguments = ["solve", tmp_path / "a.mot", "--model", tmp_path / "arm.xml", "--out", tmp_path / "out"]
    told = [notice for notice in run(*arguments).notices if "by RK4" in notice]
    assert len(told) == 1
    assert "step it by implicitfast, as the model says" in told[0]
    assert told[0].endswith("solve with --integrator implicitfast for MuJoCo's way")
    for name in ("implicitfast", "rk4"):  # chosen: nothing is left to say
        assert not any("MuJoCo would step" in notice for notice in run(*arguments, "--integrator", name).notices)


def test_the_callers_warnings_stay_as_they_were(run, mot, tmp_path):
    before = warnings.showwarning, list(warnings.filters), signal.getsignal(signal.SIGINT)
    run("solve", tmp_path / "none.mot", "--quiet", "--out", tmp_path / "out")
    assert (warnings.showwarning, list(warnings.filters), signal.getsignal(signal.SIGINT)) == before


# --- reproduce --------------------------------------------------------------------------------------------------


def test_reproduce_json_is_the_contract_and_writes_nothing(run, tmp_path, monkeypatch, fast_solution):
    monkeypatch.chdir(tmp_path)
    outcome = run("reproduce", "--json")
    assert outcome.code == 0
    assert outcome.err == ""
    assert outcome.out.count("\n") == 1
    assert not list(tmp_path.iterdir())
    result = json.loads(outcome.out)
    assert set(result) == {"movement", "dt", "physics_dt", "bare_step_time_s", "methods"}
    assert (result["movement"], result["dt"], result["physics_dt"]) == ("fast", 0.01, 0.001)
    hcmc = result["methods"]["hcmc"]
    keys = {"max_error_deg", "rmse_deg", "peak_excitation", "peak_reserve_nm", "replay_max_error_deg", "solve_time_s"}
    assert keys | {"verdict"} <= set(hcmc)
    for key in ("max_error_deg", "rmse_deg", "peak_reserve_nm", "replay_max_error_deg"):
        assert set(hcmc[key]) == set(JOINTS)
    assert set(hcmc["peak_excitation"]) == set(MUSCLES)
    error = np.rad2deg(np.abs(fast_solution.tracking_error))
    np.testing.assert_allclose([hcmc["max_error_deg"][joint] for joint in JOINTS], error.max(axis=0), rtol=1e-9)
    assert hcmc["verdict"]["passed"] is True
    assert 0 < result["bare_step_time_s"] < hcmc["solve_time_s"] < 5


def test_reproduce_writes_here_and_sets_itself_beside_the_paper(run, tmp_path, monkeypatch, no_figures, timed_once):
    monkeypatch.chdir(tmp_path)
    outcome = run("reproduce", "--dt", "0.01")
    assert outcome.code == 0
    folder = tmp_path / "mjhcmc-reproduce"
    assert {"solution.parquet", "verdict.json"} <= {path.name for path in folder.iterdir()}
    for word in ("0.0537", "0.088", "0.2305", "0.0104", "0.01503", "0.0375", "4.85", "mjhcmc hcmc", "verdict  holds"):
        assert word in outcome.out


def test_reproduce_with_other_settings(run, tmp_path, no_figures, timed_once):
    outcome = run(
        "reproduce", "--movement", "slow", "--dt", "0.05", "--physics-dt", "0.002", "--json", "--out", tmp_path
    )
    result = json.loads(outcome.out)
    assert (result["movement"], result["dt"], result["physics_dt"]) == ("slow", 0.05, 0.002)
    assert (tmp_path / "solution.parquet").is_file()


def test_reproduce_tells_a_notice_once(run, timed_once):
    outcome = run("reproduce", "--dt", "0.07", "--json")
    assert sum("does not divide" in notice for notice in outcome.notices) == 1


# --- interrupts -------------------------------------------------------------------------------------------------


@pytest.fixture
def interrupt_after(monkeypatch):
    """Raise KeyboardInterrupt at a call of the plants' step."""

    def after(calls):
        real, count = Lockstep.step, [0]

        def step(self, *arguments):
            count[0] += 1
            if count[0] == calls:
                raise KeyboardInterrupt
            return real(self, *arguments)

        monkeypatch.setattr(Lockstep, "step", step)

    return after


@pytest.mark.parametrize("as_json", [False, True])
def test_an_interrupt_keeps_what_was_solved(run, mot, tmp_path, interrupt_after, no_figures, leg8, as_json):
    path, out = mot(), tmp_path / "out"
    whole = mjhcmc.hcmc(leg8, mjhcmc.Motion.from_file(path, leg8))
    interrupt_after(50)
    outcome = run("solve", path, "--out", out, *["--json"] * as_json)
    assert outcome.code == 130
    part = mjhcmc.Solution.load(out / "solution.parquet")
    assert part.interrupted
    assert 5 <= part.n_window < 50
    np.testing.assert_array_equal(part.excitation, whole.excitation[: part.n_window])
    assert json.loads((out / "verdict.json").read_text())["passed"] is False
    assert "interrupted" in outcome.out
    if as_json:
        assert json.loads(outcome.out)["interrupted"] is True
    assert "Traceback" not in outcome.err


@pytest.mark.parametrize("command", ["solve", "reproduce"])
def test_an_interrupt_in_a_callback_is_not_lost(run, mot, tmp_path, monkeypatch, no_figures, command):
    """Compiled code calls back (LLVM's cache, MuJoCo's warnings) and drops what a callback raises."""
    import ctypes

    real, calls = Lockstep.step, []

    def step(self, *arguments):
        calls.append(None)
        if len(calls) == 30:
            ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))()
        return real(self, *arguments)

    monkeypatch.setattr(Lockstep, "step", step)
    arguments = [mot()] if command == "solve" else []
    outcome = run(command, *arguments, "--out", tmp_path / "out")
    assert outcome.code == 130
    assert "Traceback" not in outcome.err
    part = mjhcmc.Solution.load(tmp_path / "out" / "solution.parquet")
    assert part.interrupted
    assert 9 <= part.n_window <= 15  # two or three steps a window


def test_an_interrupt_before_the_first_window_leaves_nothing(run, mot, tmp_path, interrupt_after):
    interrupt_after(1)
    for arguments in (["solve", mot()], ["reproduce"]):
        interrupt_after(1)
        outcome = run(*arguments, "--out", tmp_path / "deep" / "out")
        assert outcome.code == 130
        assert [line for line in outcome.errors if line] == ["mjhcmc: interrupted before the work was done"]
        assert not (tmp_path / "deep").exists()


def test_an_interrupt_of_a_later_method_keeps_all_of_hcmc(run, tmp_path, monkeypatch, no_figures, timed_once):
    from mjhcmc.methods.cmc import _Cmc

    real = _Cmc._window

    def window(self, windows, k, *arguments):
        if k == 3:
            raise KeyboardInterrupt
        return real(self, windows, k, *arguments)

    monkeypatch.setattr(_Cmc, "_window", window)
    outcome = run("reproduce", "--out", tmp_path / "out")
    assert outcome.code == 130
    assert "solution.parquet" in outcome.err
    kept = mjhcmc.Solution.load(tmp_path / "out" / "solution.parquet")
    assert kept.settings["method"] == "hcmc"
    assert kept.n_window == 60
    assert not kept.interrupted


def test_an_interrupt_of_reproduce_keeps_what_was_solved(run, tmp_path, interrupt_after, no_figures):
    interrupt_after(50)
    assert run("reproduce", "--out", tmp_path / "out").code == 130
    assert mjhcmc.Solution.load(tmp_path / "out" / "solution.parquet").interrupted


def test_an_interrupt_while_the_result_is_written_waits_for_it(run, mot, tmp_path, monkeypatch, no_figures):
    real = mjhcmc.Solution.save

    def save(self, path):
        signal.raise_signal(signal.SIGINT)
        return real(self, path)

    monkeypatch.setattr(mjhcmc.Solution, "save", save)
    outcome = run("solve", mot(), "--out", tmp_path / "out")
    assert outcome.code == 130
    monkeypatch.undo()
    assert mjhcmc.Solution.load(tmp_path / "out" / "solution.parquet").n_window == 60
    assert (tmp_path / "out" / "verdict.json").is_file()


def test_a_second_interrupt_does_not_wait(run, mot, tmp_path, monkeypatch, no_figures):
    def save(self, path):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("still waiting")

    monkeypatch.setattr(mjhcmc.Solution, "save", save)
    assert run("solve", mot(), "--out", tmp_path / "out").code == 130
    assert not (tmp_path / "out").exists()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


# --- in a process of its own ------------------------------------------------------------------------------------


def start(*arguments, **more):
    command = [sys.executable, "-m", "mjhcmc.cli", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)


def test_a_true_interrupt(mot, tmp_path, fast_solution):
    """SIGINT from outside; `fast_solution` has seen to it that all is compiled."""
    out = tmp_path / "out"
    process = start("solve", mot(cycles=25), "--physics-dt", "0.00002", "--out", out)
    with contextlib.ExitStack() as stack:
        stack.callback(process.kill)
        limit = time.monotonic() + 30
        while not out.is_dir():  # made just before the work begins
            assert process.poll() is None, process.stderr.read()
            assert time.monotonic() < limit
            time.sleep(0.01)
        time.sleep(1.5)
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stderr
    assert "Traceback" not in stderr
    part = mjhcmc.Solution.load(out / "solution.parquet")
    assert part.interrupted
    assert 0 < part.n_window < 1500
    assert "interrupted" in stdout
    assert sorted(path.name for path in out.iterdir()) == sorted(FILES)


def test_no_traceback_in_a_process_of_its_own(tmp_path):
    process = start("solve", tmp_path / "none.mot", "--out", tmp_path / "out")
    stdout, stderr = process.communicate(timeout=60)
    assert process.returncode == 2
    assert stdout == ""
    assert stderr.count("\n") == 1
    assert "none.mot" in stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("arguments", [[], ["--help"], ["solve", "--help"], ["reproduce", "-h"], ["--version"]])
def test_help_is_light(arguments):
    heavy = ("mujoco", "numba", "matplotlib", "pandas", "scipy", "numpy", "qpsolvers", "pyarrow")
    code = (
        "import sys\nfrom mjhcmc.cli import main\n"
        f"try:\n    main({arguments})\nexcept SystemExit as stop:\n    assert not stop.code, stop.code\n"
        f"assert not (found := [name for name in {heavy} if name in sys.modules]), found\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    if "--version" in arguments:
        assert mjhcmc.__version__ in done.stdout
    else:
        assert done.stdout.startswith("Usage: mjhcmc")

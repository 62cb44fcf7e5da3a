"""mjhcmc doctor: what is found, what is said of it, and that nothing broken breaks the doctor."""

import json
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from mjhcmc.doctor import children, examine, packages, pictures, small_solve
from mjhcmc.doctor.children import Child
from mjhcmc.doctor.packages import Package
from mjhcmc.doctor.pictures import BackEnd, Pictures
from mjhcmc.doctor.screen import screen
from mjhcmc.doctor.small_solve import SmallSolve


def child(code, **environment):
    return Child(code, environment=environment).wait(60)


# --- all of it ----------------------------------------------------------------------------------------------------


def test_here_all_that_is_needed_works(run, monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/dev/null/cache")  # cannot be written; numba takes another
    monkeypatch.chdir(tmp_path)
    (tmp_path / "numpy.py").write_text("raise SystemExit('a file of the user is not numpy')")
    outcome = run("doctor", "--json")
    assert outcome.err == ""
    found = json.loads(outcome.out)
    assert (outcome.code, found["passed"], found["problems"]) == (0, True, [])
    needed = {each["name"]: each for each in found["needed"]}
    assert {"mujoco", "numpy", "numba", "qpsolvers", "plotly", "click"} <= set(needed)
    assert needed["mujoco"]["version"] == version("mujoco")
    assert needed["mujoco"]["needs"] == ">=3.17,<4"
    assert {"view", "learn", "cluster", "jax", "engines"} <= set(found["parts"])
    assert "all" not in found["parts"]
    assert 0 < found["solve"]["error_deg"] < 0.2
    assert found["cache_problem"].startswith(
        "NUMBA_CACHE_DIR=/dev/null/cache cannot be written (Not a directory), code"
    )
    assert Path(found["solve"]["cache"]).is_dir()
    names = [each["name"] for each in found["pictures"]["back_ends"]]
    if sys.platform.startswith("linux"):
        assert names == ["glfw", "egl", "osmesa"]


def test_what_is_broken_is_told_and_the_doctor_goes_on(run, monkeypatch, tmp_path):
    """A package that cannot be imported, one that is missing, one that is too old: each with what to type."""
    (tmp_path / "osqp.py").write_text("raise ImportError('libosqp.so: cannot open\\nshared object file')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    asked = [Requirement(each) for each in ("osqp>=1", "no-such-package>=2", "click>=99", "tqdm")]
    extras = {"view": (Requirement("no-such-viewer>=1"),), "all": (), "lint": (Requirement("no-such-linter"),)}
    wanted = packages.Requirements(">=2.7", tuple(asked), extras, "checkout")
    monkeypatch.setattr(packages, "read_requirements", lambda: wanted)
    monkeypatch.setattr(pictures, "start", dict)
    monkeypatch.setattr(small_solve, "start", lambda: Child("raise ValueError('no muscle')"))
    outcome = run("doctor")
    assert outcome.code == 1
    assert outcome.err == ""
    for line in (
        f"  osqp             {version('osqp').ljust(9)} >=1  cannot be imported (ImportError: libosqp.so: cannot open "
        'shared object file): pip install --force-reinstall "osqp>=1"',
        '  no-such-package  -         >=2  missing: pip install "no-such-package>=2"',
        f'  click            {version("click").ljust(9)} >=99  {version("click")} is not >=99: pip install "click>=99"',
        '  view  no-such-viewer missing: pip install "mjhcmc[view]"',
        "a small solve  FAILS: ValueError: no muscle",
        "BROKEN",
        "  a small solve fails: ValueError: no muscle: mend the lines above, or tell the developers",
    ):
        assert line in outcome.out.splitlines()
    assert "Traceback" not in outcome.out
    assert "lint" not in outcome.out  # for those who work on mjhcmc, of whom there is no sign


# --- packages -----------------------------------------------------------------------------------------------------


def test_an_import_that_takes_the_process_with_it_is_named(monkeypatch, tmp_path):
    (tmp_path / "fatal.py").write_text("import os; os.abort()")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    problems = packages.import_problems(packages.start_imports(["json", "fatal", "csv"]))
    assert problems == {"fatal": "it was ended by signal 6"}


def test_without_packaging_that_is_the_finding(monkeypatch):
    monkeypatch.setitem(sys.modules, "packaging", None)
    monkeypatch.setitem(sys.modules, "packaging.requirements", None)
    assert examine._packages(False) == (['packaging: missing: pip install "packaging"'], (), {})


def test_what_is_needed_is_read_from_the_metadata_too(monkeypatch, tmp_path):
    """As pyproject.toml says it in a checkout: an installed package has only metadata."""
    monkeypatch.setattr(packages, "_ROOT", Path(__file__).parent.parent)
    here = packages.read_requirements()
    assert here.source == "checkout"
    lines = [f"Requires-Dist: {each}" for each in here.core]
    for extra, brought in here.extras.items():
        lines.append(f"Provides-Extra: {extra}")
        lines += [f'Requires-Dist: {each}; extra == "{extra}"' for each in brought]
    # a sum of extras, as builders write it out
    lines += [
        "Provides-Extra: more",
        *(f'Requires-Dist: {each}; extra == "more"' for each in [*here.extras["view"], *here.extras["learn"]]),
    ]
    folder = tmp_path / "mjhcmc-0.1.0.dist-info"
    folder.mkdir()
    head = ["Metadata-Version: 2.1", "Name: mjhcmc", "Version: 0.1.0", "Requires-Python: >=3.11"]
    (folder / "METADATA").write_text("\n".join([*head, *(line for line in lines if "python_version" not in line)]))
    monkeypatch.setattr(packages, "_ROOT", tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    installed = packages.read_requirements()
    assert installed.source == "installed"
    assert installed.python == here.python == ">=3.11"
    names = {name: [each.name for each in brought] for name, brought in installed.extras.items()}
    assert names == {name: [each.name for each in brought] for name, brought in here.extras.items()} | {"more": []}
    plain = [each.name for each in here.core if each.marker is None]
    assert [each.name for each in installed.core] == plain


def test_what_an_extra_of_a_package_would_have_brought_is_missed(monkeypatch):
    """imageio without its encoder writes no .mp4."""
    monkeypatch.setattr(packages, "version", lambda name: {"imageio": "2.37"}.get(name) or _no_package(name))
    monkeypatch.setattr(
        packages, "requires", lambda name: ['no-such-encoder; extra == "ffmpeg"', 'other; extra == "o"']
    )
    found = packages.look_up(Requirement("imageio[ffmpeg]>=2"), 'pip install "mjhcmc[view]"')
    assert (found.version, found.problem) == ("2.37", "2.37 without no-such-encoder")
    assert found.remedy == 'pip install "mjhcmc[view]"'
    assert packages.look_up(Requirement("imageio>=2")).problem is None


def _no_package(name):
    raise packages.PackageNotFoundError(name)


def test_who_has_one_package_of_the_tests_does_not_work_on_mjhcmc(monkeypatch):
    extras = {
        "test": (Requirement("click"), Requirement("no-such-a"), Requirement("no-such-b")),
        "lint": (Requirement("click"), Requirement("tqdm"), Requirement("no-such-c")),
    }
    monkeypatch.setattr(packages, "read_requirements", lambda: packages.Requirements("", (), extras, "installed"))
    assert list(examine._packages(False)[2]) == ["lint"]


def test_every_import_of_an_extra_is_known():
    """Modules that are named otherwise than their packages would be told as broken."""
    core = [packages.module_of(each.name) for each in packages.read_requirements().core]
    for name in core:
        assert __import__("importlib.util").util.find_spec(name) is not None, name


def test_a_python_that_is_too_old():
    assert packages.python_problem(">=3.11") is None
    assert packages.python_problem(">=99") == f"Python {sys.version.split()[0]} is not >=99"


# --- processes ----------------------------------------------------------------------------------------------------


def test_what_a_process_says_and_how_it_ends():
    told = child("print('a line of a package'); print('{\"a\": 1}'); print('{broken')")
    assert (told.lines, told.ended_well, told.why) == ([{"a": 1}], True, "")
    assert child("raise RuntimeError('this\\nand that')").why == "and that"
    assert child("import sys; sys.exit(3)").why == "exit code 3"
    late = Child("import time; time.sleep(60)").wait(0.2)
    assert (late.ended_well, late.why) == (False, "not done after 0.2 s")


def test_a_process_sees_this_mjhcmc_behind_what_the_user_set(monkeypatch, tmp_path):
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "mjhcmc.py").write_text("mine = True")
    assert child("import json, mjhcmc; print(json.dumps({'mine': mjhcmc.mine}))").lines == [{"mine": True}]
    (tmp_path / "mjhcmc.py").unlink()
    lines = child("import json, mjhcmc; print(json.dumps({'file': mjhcmc.__file__}))").lines
    assert lines[0]["file"].startswith(children._PACKAGE_PARENT)


# --- compiled code and the small solve -----------------------------------------------------------------------------


class Said:
    """A process that said this."""

    def __init__(self, **line):
        self.outcome = children.Outcome([line] if line else [], bool(line), "" if line else "it fell", 1.5)

    def wait(self, timeout):
        return self.outcome


def test_a_small_solve_with_another_result_is_broken():
    good = {"error_deg": 0.08, "balance": 1e-12, "solve_seconds": 0.1, "cache": "there", "compiled": 0}
    assert small_solve.gather(Said(**good)).problem is None
    assert "tracks to 0.7 deg, not 0.2" in small_solve.gather(Said(**good | {"error_deg": 0.7})).problem
    assert "balance to 0.1 N m" in small_solve.gather(Said(**good | {"balance": 0.1})).problem
    assert "nan" in small_solve.gather(Said(**good | {"error_deg": float("nan")})).problem
    assert small_solve.gather(Said()).problem == "it fell"
    assert small_solve.gather(Said(**good), Said(**good | {"solve_seconds": 9.0})).cold_seconds == 9.0


def test_the_cache_that_is_asked_for(monkeypatch, tmp_path):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert small_solve.cache_asked() == (None, None)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "new"))
    assert small_solve.cache_asked() == (str(tmp_path / "new"), None)


# --- pictures -----------------------------------------------------------------------------------------------------

WORKS = {name: BackEnd(name, True) for name in ("glfw", "egl", "osmesa")}
FAILS = {name: BackEnd(name, False, "why", f"needs of {name}") for name in WORKS}


@pytest.mark.parametrize(
    ("asked", "back_ends", "use", "remedy"),
    [
        (None, (WORKS["glfw"], WORKS["egl"]), "glfw", None),
        (None, (FAILS["glfw"], FAILS["egl"], WORKS["osmesa"]), "osmesa", "export MUJOCO_GL=osmesa for programs"),
        ("egl", (FAILS["glfw"], WORKS["egl"]), "egl", None),
        ("egl", (FAILS["glfw"], FAILS["egl"], WORKS["osmesa"]), "osmesa", "MUJOCO_GL=egl draws nothing: export"),
        ("elg", (FAILS["glfw"], WORKS["egl"]), "egl", "MUJOCO_GL=elg draws nothing: export MUJOCO_GL=egl"),
        (None, tuple(FAILS.values()), None, "install one of glfw (needs of glfw), egl (needs of egl), osmesa (needs"),
    ],
)  # fmt: skip
def test_what_to_set_for_pictures(asked, back_ends, use, remedy):
    drawn = Pictures(None, asked, back_ends)
    assert drawn.use == use
    assert drawn.remedy is None if remedy is None else drawn.remedy.startswith(remedy)


def test_a_picture_that_is_not_drawn_says_why(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":7")
    drawn = pictures.gather({"glfw": Said(), "egl": Said(imported=True, drawn=True), "osmesa": Said(imported=True)})
    assert drawn.screen == "DISPLAY=:7"
    assert [(each.works, each.why) for each in drawn.back_ends] == [
        (False, "it fell"), (True, ""), (False, "the picture is empty"),
    ]  # fmt: skip
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    if sys.platform.startswith("linux"):
        assert pictures.screen() is None


def test_a_gl_back_end_that_mujoco_refuses_is_one_problem(run, monkeypatch):
    """Neither MuJoCo nor the solve is broken: both are tried without it."""
    monkeypatch.setenv("MUJOCO_GL", "foo")
    asked = packages.Requirements(">=2.7", (Requirement("mujoco"),), {}, "checkout")
    monkeypatch.setattr(packages, "read_requirements", lambda: asked)
    monkeypatch.setattr(pictures, "start", dict)
    found = examine.examine()
    assert (found.needed[0].problem, found.solve.problem) == (None, None)
    (problem,) = found.problems
    assert problem.startswith("MUJOCO_GL=foo: MuJoCo cannot be imported with it (")
    assert problem.endswith(": unset MUJOCO_GL")
    assert pictures.asked_problem(Said(), "egl").endswith("(it fell): unset MUJOCO_GL, or export MUJOCO_GL=egl")
    monkeypatch.delenv("MUJOCO_GL")
    assert pictures.start_asked() is None


# --- on the screen --------------------------------------------------------------------------------------------------


def test_the_report_tells_what_was_compiled_and_how_long_it_takes():
    facts = {"mjhcmc": "1", "python": "3", "platform": "p", "cores": 2, "threads": {"OMP_NUM_THREADS": "1"}}
    solve = SmallSolve(0.08, 9.0, 7.0, None, "there", 40, 21.0)
    needed = (Package("a", ">=1", "1.0"),)
    found = examine.Examination(facts, (), needed, {}, solve, "set it", Pictures(None, None, (WORKS["glfw"],)))
    text = screen(found)
    for words in (
        "2 cores, OMP_NUM_THREADS=1",
        "40 functions were compiled now",
        "kept in        there",
        "21 s, as on a",
        "  set it",
        "nothing that is needed is broken",
        "screen: none, so no windows",
    ):
        assert words in text  # fmt: skip


def test_a_package_without_a_place_for_compiled_code_says_what_to_set(monkeypatch):
    why = "RuntimeError: cannot cache function 'push': no locator available for file 'x.py'"
    monkeypatch.setattr(examine, "_packages", lambda thorough: ([], (), {}))
    monkeypatch.setattr(pictures, "start", dict)
    monkeypatch.setattr(small_solve, "start", lambda: Child(f"raise SystemExit({why!r})"))
    problems = examine.examine().problems
    assert problems == (
        f"compiled code can be kept nowhere ({why}): set NUMBA_CACHE_DIR to a folder that you may write to",
    )

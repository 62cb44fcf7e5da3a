"""The package as a user gets it: the wheel carries the leg, imports stay light, assets are found either way."""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import mjhcmc
from mjhcmc import assets

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, built from this checkout without isolation (the build back end is a test dependency)."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)],
        check=True,
        capture_output=True,
    )
    return next(folder.glob("mjhcmc-*.whl"))


def run_python(code: str, cwd: Path, path: Path) -> str:
    """Standard output of a fresh interpreter that sees this mjhcmc before any other."""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=cwd, env={"PYTHONPATH": str(path)}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_the_wheel_installed_elsewhere_loads_leg8(wheel, tmp_path):
    target = tmp_path / "site"
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(target), str(wheel)],
        check=True,
        capture_output=True,
    )
    code = (
        "import mjhcmc, pathlib; m = mjhcmc.MuscleModel.load('leg8'); "
        "print(pathlib.Path(mjhcmc.__file__).parents[1], m.n_muscle)"
    )
    assert run_python(code, tmp_path, target) == f"{target} 8"


def test_the_wheel_holds_what_it_needs_and_no_more(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {"mjhcmc/assets/leg8.xml", "mjhcmc/py.typed", "mjhcmc/leg8/parameters.json"} <= names
    opensim = {f"mjhcmc/reference/{name}" for name in ("README.md", "cmc_a.csv", "cmc_b.csv", "so_a.csv", "so_b.csv")}
    assert opensim <= names  # what reproduce lays ours beside, with its licence
    assert not [name for name in names if name.startswith(("tests/", "benchmarks/", "docs/", "examples/"))]
    # what lies among the modules is read by them: styles and scripts of the report
    beside = {
        path for path in (ROOT / "mjhcmc").rglob("*.*") if path.is_file() and path.suffix in (".css", ".js", ".html")
    }
    assert beside
    assert {path.relative_to(ROOT).as_posix() for path in beside} <= names


def test_extras_are_told_and_all_of_them_bring_something():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    told = re.findall(r"^\| `(\w+)` \|", page.partition("## Extras")[2].partition("\n## ")[0], re.MULTILINE)
    assert sorted(told) == sorted(extras)
    named = {name for line in extras["all"] for name in re.search(r"\[(.*)\]", line)[1].split(",")}
    assert named == set(extras) - {"all", "engines", "test", "docs", "lint"}


def test_messages_name_extras_that_there_are():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    for path in (ROOT / "mjhcmc").rglob("*.py"):
        for names in re.findall(r"mjhcmc\[([a-z0-9,]+)\]", path.read_text(encoding="utf-8")):
            assert set(names.split(",")) <= set(extras), path


def test_assets_are_found_in_the_repository_root_when_editable(tmp_path):
    code = "from mjhcmc import assets; print(assets.model_path('leg8'))"
    assert run_python(code, tmp_path, ROOT) == str(ROOT / "assets" / "leg8.xml")


def test_shipped_names():
    assert assets.model_names() == ("leg8", "leg8_gait")
    assert assets.model_path("leg9") is None


def test_public_names_are_all_there_and_no_others():
    for name in mjhcmc.__all__:
        assert getattr(mjhcmc, name) is not None
    with pytest.raises(AttributeError, match=r"hcmcc.*it offers"):
        _ = mjhcmc.hcmcc


def test_the_method_is_what_mjhcmc_hcmc_names_whatever_was_imported_before():
    code = "import mjhcmc.methods.hcmc, mjhcmc.cli, mjhcmc; print(callable(mjhcmc.hcmc))"
    assert run_python(code, ROOT, ROOT) == "True"


def test_importing_is_light():
    code = (
        "import sys, mjhcmc; "
        "print([m for m in ('mujoco', 'numba', 'pandas', 'matplotlib', 'scipy', 'qpsolvers') if m in sys.modules])"
    )
    assert run_python(code, ROOT, ROOT) == "[]"


def test_public_names_of_patients_are_no_modules():
    """A module of the same name would take a function's place once it is imported."""
    import pkgutil

    from mjhcmc import patients

    modules = {module.name for module in pkgutil.iter_modules(patients.__path__)}
    assert not modules & set(patients.__all__)
    for name in patients.__all__:
        assert getattr(patients, name) is not None

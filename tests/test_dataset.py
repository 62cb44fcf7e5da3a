"""Datasets on the disk: the same bytes whatever happens on the way, refusals, what it loads with."""

import json
import os
import random
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import dataset_tools
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from dataset_tools import FAILING, SAMPLES, configuration, contents
from hypothesis import given
from hypothesis import strategies as st

import mjhcmc
from mjhcmc.patients.card import column_docs, document
from mjhcmc.patients.configuration import SHARES, Configuration, splits
from mjhcmc.patients.generation import generate
from mjhcmc.patients.manifest import Manifest, locked
from mjhcmc.patients.shards import TABLES, shards_of
from mjhcmc.patients.workers import AHEAD, pool

HERE = Path(__file__).parent
SIMULATE = dataset_tools.simulate


@pytest.fixture(scope="module", autouse=True)
def defaults():
    """The settings of dataset_tools are the defaults, in this process as in those of `command`."""
    with pytest.MonkeyPatch.context() as patch:
        dataset_tools.as_battery(patch, SIMULATE)
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A dataset made in one go, in this process."""
    folder = tmp_path_factory.mktemp("whole")
    generate(configuration(), folder, simulate=SIMULATE)
    return folder


@pytest.fixture
def begun(tmp_path, whole):
    """A copy of it, to damage."""
    for name, data in contents(whole).items():
        path = tmp_path / "data" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return tmp_path / "data"


def command(simulation, *arguments, **more):
    """The command line in a process of its own, with a simulation of dataset_tools."""
    code = (
        "import sys, types, functools, dataset_tools; battery = types.ModuleType('mjhcmc.patients.examination'); "
        "battery.DEFAULTS, battery.checked = dataset_tools.SETTINGS, dict; sys.modules[battery.__name__] = battery; "
        "import mjhcmc.patients.generation as module; "
        f"module.generate = functools.partial(module.generate, simulate='dataset_tools:{simulation}'); "
        "from mjhcmc.cli import main; main(sys.argv[1:])"
    )
    words = [sys.executable, "-c", code, "patients", "generate", *map(str, arguments)]
    return subprocess.Popen(words, cwd=HERE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)


# --- what is planned --------------------------------------------------------------------------------------------


@given(st.integers(1, 5000), st.integers(1, 60))
def test_splits_and_shards_hold_every_patient_once(patients, shard_size):
    blocks = splits(patients)
    assert list(blocks) == list(SHARES)
    assert [index for block in blocks.values() for index in block] == list(range(patients))
    assert all(abs(len(block) - patients * SHARES[name] / 100) < 1 for name, block in blocks.items())
    shards = shards_of(configuration(patients, shard_size=shard_size))
    assert [index for shard in shards for index in range(shard.first, shard.last)] == list(range(patients))
    assert [shard.number for shard in shards] == list(range(len(shards)))
    assert all(0 < shard.last - shard.first <= shard_size for shard in shards)
    assert all(shard.first in blocks[shard.split] and shard.last - 1 in blocks[shard.split] for shard in shards)


def test_few_patients_train_first():
    assert {name: len(block) for name, block in splits(1).items() if block} == {"train": 1}
    assert [len(block) for block in splits(20).values()] == [12, 2, 3, 1, 1, 1]


def test_the_hash_is_of_what_matters():
    known = configuration()
    assert known.hash == configuration(physics_dt=np.float64(0.005)).hash
    others = [configuration(seed=8), configuration(21), configuration(shard_size=4), configuration(physics_dt=0.004)]
    assert len({known.hash, *(other.hash for other in others)}) == 5
    assert len(known.hash) == 16


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ({"patients": 10**7 + 1}, "patients must be a whole number of at most 10000000; got 10000001"),
        ({"patients": 0}, "patients must be a whole number of at least 1; got 0"),
        ({"patients": -3}, "patients .* -3"),
        ({"patients": 2.5}, r"patients .* 2\.5"),
        ({"patients": True}, "patients .* True"),
        ({"seed": -1}, "seed .* at least 0; got -1"),
        ({"seed": 2**63}, "seed"),
        ({"shard_size": 0}, "shard_size"),
        ({"physics_dt": 0.0}, "physics_dt must be positive"),
        ({"rate": float("nan")}, "rate"),
        ({"rate": [1]}, "rate"),
    ],
)
def test_numbers_that_make_no_dataset(fields, named):
    with pytest.raises(mjhcmc.SettingsError, match=named):
        configuration(**fields)


def test_settings_by_name(monkeypatch):
    dataset_tools.as_battery(monkeypatch, SIMULATE)
    assert Configuration.with_defaults(20, 7, 3) == configuration() == Configuration(20, 7, 3)
    assert Configuration.with_defaults(20, 7, 3, rate=100).hash == configuration().hash  # 100 is 100.0
    with pytest.raises(mjhcmc.SettingsError, match="'gravity' is not known: choose one of physics_dt, rate"):
        Configuration.with_defaults(20, gravity=9.81)
    with pytest.raises(mjhcmc.SettingsError, match="'rate' must be a number"):
        Configuration.with_defaults(20, rate="fast")


# --- what is written --------------------------------------------------------------------------------------------


def test_a_dataset_has_every_patient_and_every_byte_checked(whole):
    manifest = Manifest.read(whole)
    assert manifest.status == "complete"
    assert (manifest.patients, manifest.failed) == (20, 1)
    shards = shards_of(configuration())
    assert [written.shard for written in manifest.shards] == [shard.name for shard in shards]
    expected = {"manifest.json", "README.md"}
    expected |= {f"{s.name}/{name}" for s in shards for name in ("checksums.json", *(f"{t}.parquet" for t in TABLES))}
    assert set(contents(whole)) == expected
    patients = pd.concat(pd.read_parquet(whole / shard.name / "patients.parquet") for shard in shards)
    assert list(patients["patient"]) == list(range(20))
    assert list(patients["patient"][patients["status"] == "failed"]) == [FAILING]
    assert set(patients["configuration"]) == {configuration().hash}
    assert manifest.size == sum(path.stat().st_size for path in whole.rglob("*.parquet"))


def test_tables_come_back_as_they_were(whole):
    for shard in shards_of(configuration()):
        given = SIMULATE(configuration(), shard.split, shard.first, shard.last)
        for name in TABLES:
            assert pq.ParquetFile(whole / shard.name / f"{name}.parquet").read().equals(given[name])


def test_two_workers_give_the_same_bytes(whole, tmp_path):
    manifest = generate(configuration(), tmp_path / "two", workers=2, simulate="dataset_tools:simulate")
    assert contents(tmp_path / "two") == contents(whole)
    assert manifest == Manifest.read(whole)


def test_a_dataset_that_is_there_is_left_alone(begun):
    before = {path: path.stat().st_mtime_ns for path in begun.rglob("*")}
    manifest = generate(configuration(), begun, simulate=dataset_tools.raising)
    assert manifest.made == 0
    assert {path: path.stat().st_mtime_ns for path in begun.rglob("*") if path != begun} == {
        path: at for path, at in before.items() if path != begun
    }


@pytest.mark.parametrize("simulation", ["too_few", "raising"])
def test_a_simulation_that_is_wrong_is_named(tmp_path, simulation):
    with pytest.raises(mjhcmc.SimulationError, match=r"train/shard-0000\d \(patients \d to \d\)") as stop:
        generate(configuration(), tmp_path / "data", simulate=getattr(dataset_tools, simulation))
    if simulation == "raising":
        assert "patients 6 to 8" in str(stop.value)
        assert "ZeroDivisionError: no patient like that" in str(stop.value)
    assert not list(tmp_path.rglob(".shard*"))


def test_simulations_that_workers_cannot_get(tmp_path):
    with pytest.raises(mjhcmc.SettingsError, match="cannot be found"):
        generate(configuration(), tmp_path / "data", simulate="dataset_tools:nothing")
    with pytest.raises(mjhcmc.SettingsError, match="cannot be sent"):
        generate(configuration(), tmp_path / "data", workers=2, simulate=lambda *_: {})
    for workers in (0, -1, 1.5):
        with pytest.raises(mjhcmc.SettingsError, match="workers"):
            generate(configuration(), tmp_path / "data", workers=workers, simulate=SIMULATE)
    assert not (tmp_path / "data").exists()


# --- killed, damaged, full --------------------------------------------------------------------------------------


def running(process):
    """Whether a process lives; one that nobody waited for does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_killed_at_every_step_and_started_again(tmp_path):
    code = "import sys, pathlib, dataset_tools; print(dataset_tools.killed_at_every_step(pathlib.Path(sys.argv[1])))"
    done = subprocess.run([sys.executable, "-c", code, tmp_path], cwd=HERE, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 40


def test_killed_at_any_moment_with_its_workers(whole, tmp_path):
    out, numbers, chance = tmp_path / "data", tmp_path / "numbers", random.Random()
    numbers.mkdir()
    size = ("--n", 20, "--seed", 7, "--shard-size", 3, "--workers", 2, "--out", out)
    process = command("pids", *size, env={**os.environ, "MJHCMC_TEST_FOLDER": str(numbers)})
    least, until = chance.randint(0, 4), time.monotonic() + 90
    while len(list(out.glob("*/shard-*"))) < least or not list(numbers.iterdir()):
        assert time.monotonic() < until
        assert process.poll() is None, process.communicate()
        time.sleep(0.005)
    time.sleep(chance.uniform(0, 0.1))
    process.kill()
    process.wait()
    assert json.loads((out / "manifest.json").read_text())["status"] == "running"
    while orphans := [int(path.name) for path in numbers.iterdir() if running(int(path.name))]:
        assert time.monotonic() < until, f"workers {orphans} outlive their parent"
        time.sleep(0.01)
    process.communicate()
    for shard in out.glob("*/shard-*"):  # whole or absent
        assert contents(shard) == contents(whole / shard.relative_to(out))
    generate(configuration(), out, simulate=SIMULATE)
    assert contents(out) == contents(whole)


def test_an_interrupt_keeps_whole_shards(whole, tmp_path):
    out = tmp_path / "data"
    process = command(
        "slowly", "--n", 20, "--seed", 7, "--shard-size", 3, "--out", out, "--workers", 2, start_new_session=True
    )
    until = time.monotonic() + 90
    while not list(out.glob("*/shard-*")) and time.monotonic() < until:
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    printed, errors = process.communicate(timeout=90)
    assert (process.returncode, printed) == (130, "")
    assert [line for line in errors.splitlines() if line] == [
        f"mjhcmc: {out} keeps the shards that are whole: the same command goes on from there",
        "mjhcmc: interrupted before the work was done",
    ]
    assert not list(out.rglob(".*"))
    kept = len(list(out.glob("*/shard-*")))
    assert 0 < kept < len(shards_of(configuration()))
    generate(configuration(), out, simulate=SIMULATE)
    assert contents(out) == contents(whole)


def test_a_worker_that_is_killed_is_replaced(whole, tmp_path, monkeypatch):
    monkeypatch.setenv("MJHCMC_TEST_FOLDER", str(tmp_path))
    generate(configuration(), tmp_path / "data", workers=2, simulate=dataset_tools.killed_once)
    assert (tmp_path / dataset_tools.DIED).exists()
    assert contents(tmp_path / "data") == contents(whole)


def test_a_shard_that_kills_its_workers_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("mjhcmc.patients.workers.TRIES", 2)
    with pytest.raises(mjhcmc.SimulationError, match=r"train/shard-00002 \(patients 6 to 8\): 2 worker processes died"):
        generate(configuration(), tmp_path / "data", workers=2, simulate=dataset_tools.killed_always)
    assert not list(tmp_path.rglob(".*"))


def test_a_full_disk_is_told_and_resumed(whole, tmp_path):
    out = tmp_path / "data"
    process = command("disk_full", "--n", 20, "--seed", 7, "--shard-size", 3, "--out", out)
    _, errors = process.communicate(timeout=90)
    assert process.returncode == 2
    assert errors.count("\n") == 1
    for word in (
        f"{out}/train/shard-00002",
        "File too large",
        "shards that are whole are kept",
        "start again to resume",
    ):
        assert word in errors
    assert sorted(path.name for path in out.glob("*/*")) == ["shard-00000", "shard-00001"]
    assert not list(out.rglob(".*"))
    generate(configuration(), out, simulate=SIMULATE)
    assert contents(out) == contents(whole)


def flipped(shard):
    path = shard / "observables.parquet"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


DAMAGES = {
    "a bit": (flipped, "observables.parquet: its bytes do not give the checksum"),
    "a file": (lambda shard: (shard / "trials.parquet").unlink(), "trials.parquet: cannot be read"),
    "the checksums": (lambda shard: (shard / "checksums.json").write_text("{"), "checksums.json: no checksums"),
    "its place": (
        lambda shard: (shard / "checksums.json").write_bytes((shard / "../shard-00000/checksums.json").read_bytes()),
        "of other patients",
    ),
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("status", ["running", "complete"])
def test_a_damaged_shard_is_named_and_made_again(whole, begun, damage, status):
    if status == "running":
        Manifest.of(configuration()).write(begun)
    do, told = DAMAGES[damage]
    do(begun / "train/shard-00001")
    with pytest.warns(mjhcmc.MjhcmcWarning, match="train/shard-00001.*" + told + ".*is made again") as notices:
        manifest = generate(configuration(), begun, simulate=SIMULATE)
    assert len(notices) == 1
    assert manifest.made == 3
    assert contents(begun) == contents(whole)


def test_a_shard_forged_with_its_checksums_is_not_the_manifests(whole, begun, tmp_path):
    def otherwise(*block):
        tables = SIMULATE(*block)
        return {**tables, "trials": tables["trials"].slice(0, 0)}

    generate(configuration(), tmp_path / "other", simulate=otherwise)
    for path in (tmp_path / "other/test").rglob("*.*"):
        (begun / "test" / path.relative_to(tmp_path / "other/test")).write_bytes(path.read_bytes())
    with pytest.warns(mjhcmc.MjhcmcWarning, match="is not the shard that the manifest knows"):
        generate(configuration(), begun, simulate=SIMULATE)
    assert contents(begun) == contents(whole)


# --- what is refused --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (configuration(seed=8), "seed is 7 there and 8 here"),
        (configuration(30), "patients is 20 there and 30 here"),
        (configuration(shard_size=5), "shard_size is 3 there and 5 here"),
        (configuration(physics_dt=0.002), "physics_dt is 0.005 there and 0.002 here"),
        (configuration(control_dt=0.01), "control_dt is not set there and 0.01 here"),
    ],
)
def test_another_configuration_is_refused(begun, whole, other, told):
    with pytest.raises(mjhcmc.OutputError, match=f"{told}: choose another folder"):
        generate(other, begun, simulate=SIMULATE)
    assert contents(begun) == contents(whole)


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (("mjhcmc-0.1.0/dataset-1", "mjhcmc-0.0.1/dataset-1"), "generator is mjhcmc-0.0.1"),
        (('"mujoco": "', '"mujoco": "1.'), "version of mujoco is 1."),
        (('"platform": "', '"platform": "Plan 9 on '), "platform is Plan 9 on"),
        (('"hash": "', '"hash": "x'), "hash is x"),
        (('"status"', '"state"'), "is no manifest of a dataset"),
        (("{", "["), "is no manifest of a dataset"),
    ],
)
def test_another_version_is_refused(begun, edit, told):
    path = begun / "manifest.json"
    text = path.read_text()
    assert edit[0] in text
    path.write_text(text.replace(*edit))
    before = contents(begun)
    with pytest.raises(mjhcmc.OutputError, match=told):
        generate(configuration(), begun, simulate=SIMULATE)
    assert contents(begun) == before


def test_folders_that_hold_something_else_are_refused(tmp_path, begun):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(mjhcmc.OutputError, match=r"holds 'data' and no manifest.json"):
        generate(configuration(), tmp_path, simulate=SIMULATE)
    (begun / "train/shard-00099").mkdir()
    with pytest.raises(mjhcmc.OutputError, match=r"train/shard-00099: is no part of this dataset"):
        generate(configuration(), begun, simulate=SIMULATE)
    with pytest.raises(mjhcmc.OutputError, match=r"thesis.tex: cannot be written"):
        generate(configuration(), tmp_path / "thesis.tex", simulate=SIMULATE)


def test_two_generators_do_not_share_a_folder(tmp_path, whole):
    out = tmp_path / "data"
    with locked(out), pytest.raises(mjhcmc.OutputError, match=rf"process {os.getpid()} on .* works there"):
        generate(configuration(), out, simulate=SIMULATE)
    assert not out.exists()
    out.mkdir()
    (out / ".lock").write_text("process 1 on a machine that was switched off\n")
    (out / ".manifest.json.partial").write_text("{")
    generate(configuration(), out, simulate=SIMULATE)
    assert contents(out) == contents(whole)


# --- the runners ------------------------------------------------------------------------------------------------


def test_few_jobs_are_under_way():
    begun = 0

    def jobs():
        nonlocal begun
        while begun < 100:
            begun += 1
            yield begun

    under_way, outcomes = [], []
    with pool(2, lambda: None) as run:
        for outcome in run(dataset_tools.double, jobs()):
            outcomes.append(outcome)
            under_way.append(begun - len(outcomes))
    assert sorted(outcomes) == [2 * number for number in range(1, 101)]
    assert max(under_way) < 2 * AHEAD


# --- the command line -------------------------------------------------------------------------------------------


def test_the_command_makes_what_the_function_makes(run, whole, tmp_path, monkeypatch):
    dataset_tools.as_battery(monkeypatch, SIMULATE)
    size = ("patients", "generate", "--n", 20, "--seed", 7, "--shard-size", 3, "--out", tmp_path / "data")
    outcome = run(*size)
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.startswith(f"20 patients, 1 failed, 9 shards, {Manifest.read(whole).size / 1000:.3g} kB; ")
    assert "patients/s" in outcome.out
    assert contents(tmp_path / "data") == contents(whole)
    assert "nothing to do, 20 patients were there" in run(*size).out
    numbers = json.loads(run(*size, "--json").out)
    assert {numbers["patients"], numbers["made"], numbers["failed"], numbers["shards"]} == {20, 0, 1, 9}
    assert run(*size, "--quiet").out == ""


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--n", 0), "--n"),
        (("--n", "many"), "--n"),
        (("--n", 10**10), "at most 10000000; got 10000000000"),
        (("--n", 2, "--seed", -1), "--seed"),
        (("--n", 2, "--workers", 0), "--workers"),
        (("--n", 2, "--workers", 2, "--cluster", "tcp://x:1"), "exclude each other"),
        (("--n", 2, "--physics-dt", -1), "--physics-dt must be positive; got -1.0"),
        ((), "--n"),
    ],
)
def test_bad_options_are_one_line(run, tmp_path, monkeypatch, arguments, told):
    dataset_tools.as_battery(monkeypatch, SIMULATE)
    outcome = run("patients", "generate", *arguments, "--out", tmp_path / "data")
    assert (outcome.code, outcome.out, len(outcome.errors)) == (2, "", 1)
    assert told in outcome.err
    assert not (tmp_path / "data").exists()


# --- what it loads with -----------------------------------------------------------------------------------------


def test_it_loads_with_datasets(whole, tmp_path, monkeypatch):
    for name, value in {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1", "HF_HOME": str(tmp_path)}.items():
        monkeypatch.setenv(name, value)
    datasets = pytest.importorskip("datasets")
    cache = str(tmp_path / "cache")
    files = {name: str(whole / name / "*/observables.parquet") for name in ("train", "test")}
    loaded = datasets.load_dataset("parquet", data_files=files, cache_dir=cache)
    assert {name: len(split) for name, split in loaded.items()} == {"train": 12 * SAMPLES, "test": 3 * SAMPLES}
    by_card = datasets.load_dataset(str(whole), "patients", cache_dir=cache)
    assert {name: by_card[name]["patient"][:] for name in by_card} == {k: list(v) for k, v in splits(20).items()}


def test_it_loads_with_polars_and_pandas(whole):
    paths = sorted(whole.glob("train/*/observables.parquet"))
    by_pandas = pd.concat(map(pd.read_parquet, paths))
    assert list(by_pandas["patient"].unique()) == list(range(12))
    polars = pytest.importorskip("polars")
    by_polars = polars.scan_parquet(whole / "train/*/observables.parquet").collect()
    np.testing.assert_array_equal(by_polars["q/knee"].to_numpy(), by_pandas["q/knee"].to_numpy())
    assert by_polars["q/knee"].dtype == polars.Float32


def test_the_card_tells_what_a_reader_needs(whole, tmp_path):
    text = (whole / "README.md").read_text()
    for word in (
        "Not clinically validated", "Not for diagnosis", "gait10dof18musc", "CC-BY 3.0", configuration().hash, "seed 7",
        configuration().generator,
    ):  # fmt: skip
        assert word in text
    for doc in column_docs():
        assert f"| `{doc.pattern}` | {doc.unit} |" in text
    yaml = pytest.importorskip("yaml")
    front = yaml.safe_load(text.split("---\n")[1])
    assert [config["config_name"] for config in front["configs"]] == list(TABLES)
    for config in front["configs"]:
        for files in config["data_files"]:
            assert list(whole.glob(files["path"])), files
    generate(configuration(1), tmp_path / "one", simulate=SIMULATE)
    front = yaml.safe_load((tmp_path / "one/README.md").read_text().split("---\n")[1])
    assert {files["split"] for config in front["configs"] for files in config["data_files"]} == {"train"}


def test_the_command_on_the_card_makes_the_same_dataset(run, tmp_path, monkeypatch):
    battery = sys.modules["mjhcmc.patients.examination"]
    monkeypatch.setattr(
        battery, "DEFAULTS", {**dataset_tools.SETTINGS, "fast": "120 180", "walk": "", "walk_digest": ""}
    )
    monkeypatch.setattr(battery, "checked", lambda settings: {**settings, "walk_digest": "of " + settings["walk"]})
    changes = {"physics_dt": 0.1 / 3, "fast": "90 150", "walk": "it's a walk.mot"}
    made = Configuration.with_defaults(2, 7, 3, **changes)
    generate(made, tmp_path / "made", simulate=SIMULATE)
    line = next(x for x in (tmp_path / "made/README.md").read_text().splitlines() if x.startswith("    mjhcmc"))
    assert "walk_digest" not in line
    assert "rate=" not in line
    words = shlex.split(line)
    assert (words[0], words[-2:]) == ("mjhcmc", ["--out", "DIR"])
    assert run(*words[1:-1], tmp_path / "again").code == 0
    assert contents(tmp_path / "again") == contents(tmp_path / "made")
    generate(configuration(), tmp_path / "plain", simulate=SIMULATE)
    assert "--set" not in (tmp_path / "plain/README.md").read_text()


def test_columns_are_documented_by_pattern():
    assert document("observables", "emg/soleus").kind == "observable"
    assert document("patients", "latent/gain/knee_extensors").unit == "s"
    assert document("patients", "rater_a_rank/hip").kind == "label"
    assert document("privileged", "emg/soleus") is None
    for table in TABLES:
        for column in ("generator", "configuration", "seed", "patient"):
            assert document(table, column).kind == "key"
    observable = {doc.pattern for doc in column_docs() if doc.kind == "observable"}
    assert not any(name.startswith(("latent", "ideal", "rater", "excitation", "activation")) for name in observable)

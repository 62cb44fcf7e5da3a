"""Datasets made on a dask cluster of real worker processes."""

import time

import dataset_tools
import pytest
from dataset_tools import configuration, contents

import mjhcmc
from mjhcmc.patients import workers
from mjhcmc.patients.generation import generate

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def numbers(tmp_path_factory):
    return tmp_path_factory.mktemp("numbers")


@pytest.fixture(scope="module")
def cluster(numbers):
    """A scheduler and two workers, each a process."""
    with (
        pytest.MonkeyPatch.context() as patch,
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50,
            env={"MJHCMC_TEST_FOLDER": str(numbers)}, local_directory=str(numbers / "dask"),
        ) as cluster,
    ):  # fmt: skip
        patch.setenv("MJHCMC_TEST_FOLDER", str(numbers))
        yield cluster.scheduler_address


def test_a_worker_is_killed_on_the_way_and_the_bytes_are_the_same(cluster, numbers, tmp_path):
    generate(configuration(), tmp_path / "here", simulate=dataset_tools.simulate)
    manifest = generate(configuration(), tmp_path / "there", cluster=cluster, simulate="dataset_tools:killed_once")
    assert (numbers / dataset_tools.DIED).exists()
    assert manifest.made == 20
    assert contents(tmp_path / "there") == contents(tmp_path / "here")


def test_errors_of_workers_come_back(cluster, tmp_path):
    with pytest.raises(
        mjhcmc.SimulationError, match=r"shard-00002 \(patients 6 to 8\): the simulation failed \(ZeroDiv"
    ):
        generate(configuration(), tmp_path / "data", cluster=cluster, simulate="dataset_tools:raising")


def test_few_jobs_are_under_way(cluster):
    begun = 0

    def jobs():
        nonlocal begun
        while begun < 40:
            begun += 1
            yield begun

    under_way, outcomes = [], []
    with workers.on_cluster(cluster) as run:
        for outcome in run(dataset_tools.double, jobs()):
            outcomes.append(outcome)
            under_way.append(begun - len(outcomes))
    assert sorted(outcomes) == [2 * number for number in range(1, 41)]
    assert max(under_way) < 2 * workers.AHEAD


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "no cluster", "smoke://signals"])
def test_a_dead_address_is_named(tmp_path, monkeypatch, address):
    assert workers.CONNECT <= 10
    monkeypatch.setattr(workers, "CONNECT", 1.0)
    started = time.monotonic()
    with pytest.raises(mjhcmc.SettingsError, match=f"cluster '{address}': no dask scheduler answers there: check"):
        generate(configuration(), tmp_path / "data", cluster=address, simulate=dataset_tools.simulate)
    assert time.monotonic() - started < 30  # it does not wait for ever
    assert not (tmp_path / "data").exists()


def test_without_dask_the_remedy_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(mjhcmc.SettingsError, match=r'pip install "mjhcmc\[cluster\]"'):
        generate(configuration(), tmp_path / "data", cluster="tcp://x:1", simulate=dataset_tools.simulate)

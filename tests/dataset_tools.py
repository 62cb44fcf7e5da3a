"""Simulations that take no time, for the tests of datasets; worker processes import them from here."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pyarrow as pa

from mjhcmc.patients.configuration import Configuration

SETTINGS = {"physics_dt": 0.005, "rate": 100.0}
SAMPLES = 40  # of each patient
DIED = "died"  # in the folder that MJHCMC_TEST_FOLDER names: a worker was killed
FAILING = 3  # the patient whose simulation fails


def configuration(patients=20, seed=7, shard_size=3, **settings) -> Configuration:
    return Configuration(patients, seed, shard_size, {**SETTINGS, **settings})


def simulate(configuration, split, first, last):
    """Tables from nothing but seed and index; one patient fails."""
    n, patients = last - first, range(first, last)

    def marked(columns, rows):
        constants = {"generator": configuration.generator, "configuration": configuration.hash}
        words = {name: pa.array([value] * rows).dictionary_encode() for name, value in constants.items()}
        return pa.table({**columns, **words, "seed": np.full(rows, configuration.seed, dtype=np.int64)})

    values = np.concatenate(
        [np.random.default_rng([configuration.seed, i]).normal(size=SAMPLES) for i in patients]
    ).astype(np.float32)
    status = ["failed" if i == FAILING else "ok" for i in patients]
    reason = ["it fell" if i == FAILING else "" for i in patients]
    index = np.arange(first, last)
    sample = {"patient": np.repeat(index, SAMPLES), "time": np.tile(np.arange(SAMPLES) / 100, n).astype(np.float32)}
    return {
        "patients": marked({"patient": index, "split": [split] * n, "status": status, "reason": reason}, n),
        "trials": marked({"patient": index, "trial": np.zeros(n, dtype=np.int16), "name": ["slow/knee"] * n}, n),
        "observables": marked({**sample, "q/knee": values}, n * SAMPLES),
        "privileged": marked({**sample, "activation/vasti": np.abs(values)}, n * SAMPLES),
    }


def slowly(configuration, split, first, last):
    """A shard takes a while."""
    time.sleep(0.05)
    return simulate(configuration, split, first, last)


def killed_once(configuration, split, first, last):
    """The worker that first comes to patient 6 is killed."""
    died = Path(os.environ["MJHCMC_TEST_FOLDER"]) / DIED
    if first <= 6 < last and not died.exists():
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return simulate(configuration, split, first, last)


def killed_always(configuration, split, first, last):
    """Whoever comes to patient 6 is killed."""
    if first <= 6 < last:
        os.kill(os.getpid(), signal.SIGKILL)
    return simulate(configuration, split, first, last)


def raising(configuration, split, first, last):
    """Patient 6 is beyond the simulation."""
    if first <= 6 < last:
        raise ZeroDivisionError("no patient\nlike that")
    return simulate(configuration, split, first, last)


def too_few(configuration, split, first, last):
    """A patient is lost."""
    return simulate(configuration, split, first, last - 1)


def double(number):
    """Work for the runners."""
    return 2 * number


def contents(folder):
    """All bytes of a dataset by file."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def disk_full(configuration, split, first, last):
    """From patient 6 on, this process may write no files beyond 1000 bytes."""
    if first <= 6 < last:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))
    return simulate(configuration, split, first, last)


def pids(configuration, split, first, last):
    """Slowly, and the workers leave their numbers."""
    (Path(os.environ["MJHCMC_TEST_FOLDER"]) / str(os.getpid())).touch()
    return slowly(configuration, split, first, last)


def as_battery(monkeypatch, function):
    """Make a function the default simulation."""
    import sys
    import types

    battery = types.ModuleType("mjhcmc.patients.examination")
    battery.DEFAULTS, battery.simulate_block, battery.checked = SETTINGS, function, dict
    monkeypatch.setitem(sys.modules, battery.__name__, battery)


def killed_at_every_step(folder):
    """Make a dataset of two shards, killed at its first, second, ... touch of the folder, and go on each time.

    Run it in a process of its own that forks: audit hooks stay. Gives how many steps there are.
    """
    import sys

    from mjhcmc.patients.generation import generate

    os.fsync = lambda handle: None  # it takes long, and what is killed here is a process, not the machine
    small = configuration(2, shard_size=1)
    generate(small, folder / "whole", simulate=simulate)
    whole, step = contents(folder / "whole"), 0
    while True:
        step += 1
        out, left = folder / f"step{step}", step

        def kill(event, arguments, out=out):
            nonlocal left
            if event.startswith(("open", "os.", "shutil.")) and any(str(out) in str(word) for word in arguments):
                left -= 1
                if left == 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        child = os.fork()
        if child == 0:
            sys.addaudithook(kill)
            generate(small, out, simulate=simulate)
            os._exit(0)
        status = os.waitpid(child, 0)[1]
        if status == 0:
            return step - 1
        assert os.WTERMSIG(status) == signal.SIGKILL, status
        for shard in out.glob("*/shard-*"):
            name = shard.relative_to(out)
            assert contents(shard) == contents(folder / "whole" / name), f"step {step}: {name} is not whole"
        generate(small, out, simulate=simulate)
        assert contents(out) == whole, f"step {step}: other bytes after going on"

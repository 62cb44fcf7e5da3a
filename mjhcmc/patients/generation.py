"""Simulated patients into a dataset on the disk, shard by shard; killed and started again, to the same bytes."""

from __future__ import annotations

import pickle
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjhcmc.errors import MjhcmcError, MjhcmcWarning, OutputError, SettingsError, SimulationError
from mjhcmc.log import get_logger
from mjhcmc.patients.card import CARD, card
from mjhcmc.patients.configuration import Configuration, whole_number
from mjhcmc.patients.manifest import Manifest, check_folder, locked, system, versions
from mjhcmc.patients.shards import (
    DamagedShardError,
    Shard,
    Written,
    read_shard,
    remove_leftovers,
    remove_shard,
    shards_of,
    strangers,
    write_file,
    write_shard,
)
from mjhcmc.patients.workers import Runner, in_process, on_cluster, pool

if TYPE_CHECKING:
    import pyarrow as pa

Simulation = Callable[[Configuration, str, int, int], "Mapping[str, pa.Table]"]

BATTERY = "mjhcmc.patients.examination:simulate_block"
"""The simulation of clinical tests, imported by name in each worker."""

_log = get_logger(__name__)
_interrupted = threading.Event()


@dataclass(frozen=True)
class _Job:
    """A shard to be made, as a worker gets it."""

    out: Path
    shard: Shard
    configuration: Configuration
    simulate: Simulation | str
    made_by: tuple[Mapping[str, str], str]

    def __str__(self) -> str:
        return str(self.shard)


def generate(
    configuration: Configuration,
    out: Path | str,
    *,
    workers: int = 1,
    cluster: str | None = None,
    simulate: Simulation | str = BATTERY,
    progress: bool | None = None,
) -> Manifest:
    """Make a dataset, or the rest of it: what is there whole is kept.

    The bytes do not depend on workers, on their order, or on how often the work was interrupted. While it goes on, a
    shard is in the folder whole or not at all. A damaged one is named in a warning and made again.

    Args:
        configuration: what to make.
        out: folder; empty, or holding the same dataset.
        workers: processes to compute on; 1: this one.
        cluster: address of a dask scheduler instead. Its workers must see the same folder by the same absolute path,
            and have the same versions installed.
        simulate: gives the tables of `TABLES` for (configuration, split, first, last): patients first to last - 1. A
            function of a module, or its name as ``"module:function"``. It records a patient that fails as a row.
        progress: a bar on standard error; None: if that is a terminal.

    Returns:
        What the dataset holds.

    Raises:
        SettingsError: a number out of range, a simulation that cannot be found or sent, no scheduler at the address.
        OutputError: the folder holds something else or another dataset, someone else works there, the disk is full.
        SimulationError: the simulation of a shard raises, gives other tables than asked for, or kills its workers.
    """
    workers = whole_number("workers", workers, 1)
    if cluster is not None and workers != 1:
        raise SettingsError(f"workers {workers} and cluster {cluster!r} exclude each other: give one of them")
    _check_simulation(simulate, sent=cluster is not None or workers > 1)
    out = Path(out).absolute()
    plan, shards = Manifest.of(configuration), shards_of(configuration)
    with _interrupts(), locked(out):
        there = check_folder(out, plan)
        with _runner(out, min(workers, len(shards)), cluster) as run:
            for stranger in strangers(out, shards):
                raise OutputError(f"{stranger}: is no part of this dataset, but would be loaded with it: move it away")
            remove_leftovers(out)
            try:
                done = list(_kept(out, shards, configuration, there, progress))
                names = {written.shard for written in done}
                missing = [shard for shard in shards if shard.name not in names]
                if missing or there is None or there.status != "complete" or not (out / CARD).exists():
                    plan.write(out)
                    there = None
                    write_file(out / CARD, card(configuration))
                jobs = (_Job(out, shard, configuration, simulate, (plan.versions, plan.platform)) for shard in missing)
                kept = sum(written.last - written.first for written in done)
                with _bar(progress, configuration.patients, kept) as tell:
                    for written in _checked(run(_make, jobs)):
                        done.append(written)
                        tell(written)
            except BaseException:
                with suppress(OutputError):  # the error that ended the work is the one to tell
                    remove_leftovers(out)
                raise
        manifest = plan.complete(done, configuration.patients - kept)
        if manifest != there:
            manifest.write(out)
    return manifest


def _checked(outcomes: Iterable[Written | MjhcmcError]) -> Iterator[Written]:
    for outcome in outcomes:
        if isinstance(outcome, MjhcmcError):
            raise outcome
        _log.info("%s is written: %d patients, %d failed", outcome.shard, outcome.last - outcome.first, outcome.failed)
        yield outcome


def _kept(
    out: Path, shards: list[Shard], configuration: Configuration, there: Manifest | None, progress: bool | None
) -> Iterator[Written]:
    """The shards that are there whole; damaged ones are removed."""
    if there is None:
        return
    known = {written.shard: written for written in there.shards}
    with _bar(progress, configuration.patients, 0, "checking ") as tell:
        for shard in shards:
            try:
                written = read_shard(out, shard, configuration)
                if written is None:
                    continue
                if known.get(shard.name, written) != written:
                    raise DamagedShardError(f"{out / shard.name}: is not the shard that the manifest knows")
            except DamagedShardError as error:
                warnings.warn(f"{error}: {shard} is made again", MjhcmcWarning, stacklevel=2)
                remove_shard(out, shard)
            else:
                tell(written)
                yield written


def _make(job: _Job) -> Written | MjhcmcError:
    """In a worker: simulate and write one shard. Errors are given back, so that nobody tries again in vain."""
    try:
        _check_worker(job)
        try:
            there = read_shard(job.out, job.shard, job.configuration)
        except DamagedShardError:
            remove_shard(job.out, job.shard)
        else:
            if there is not None:  # written by a worker that died, or was lost, before it could say so
                return there
        tables = _simulated(job)
        if _interrupted.is_set():  # compiled code may have dropped the interrupt, with a callback half done
            raise KeyboardInterrupt
        return write_shard(job.out, job.shard, job.configuration, tables)
    except MjhcmcError as error:
        return error


def _simulated(job: _Job) -> Mapping[str, pa.Table]:
    shard = job.shard
    try:
        return _function(job.simulate)(job.configuration, shard.split, shard.first, shard.last)
    except MjhcmcError as error:
        raise SimulationError(f"{shard}: {error}") from error
    except Exception as error:
        why = f"{type(error).__name__}: {' '.join(str(error).split())}"
        failure = SimulationError(
            f"{shard}: the simulation failed ({why}): report it with seed and settings, or try other settings"
        )
        failure.add_note(traceback.format_exc())  # the cause itself may not come back from another process
        raise failure from error


def _check_worker(job: _Job) -> None:
    """See that this worker would write the same bytes as the others, to the same folder."""
    if (versions(), system()) != job.made_by:
        theirs, platform = job.made_by
        own = {name: value for name, value in versions().items() if theirs.get(name) != value}
        differ = [f"{name} is {value}, not {theirs.get(name)}" for name, value in own.items()]
        differ += [f"it is {system()}, not {platform}"] if system() != platform else []
        raise SettingsError(f"{job.shard}: a worker differs: {'; '.join(differ)}: install the same versions everywhere")
    manifest = Manifest.read(job.out)
    if manifest is None or manifest.hash != job.configuration.hash:
        raise OutputError(
            f"{job.out}: a worker does not see the dataset there: all workers need one shared folder by the same path"
        )


def _runner(out: Path, workers: int, cluster: str | None) -> AbstractContextManager[Runner]:
    if cluster is not None:
        return on_cluster(cluster)
    if workers > 1:
        return pool(workers, lambda: remove_leftovers(out))
    return nullcontext(in_process)


def _function(simulate: Simulation | str) -> Simulation:
    if not isinstance(simulate, str):
        return simulate
    module, _, name = simulate.partition(":")
    function: Simulation = getattr(import_module(module), name)
    return function


def _check_simulation(simulate: Simulation | str, *, sent: bool) -> None:
    try:
        _function(simulate)
        if sent:
            pickle.dumps(simulate)
    except (ImportError, AttributeError, ValueError, TypeError, pickle.PicklingError) as error:
        raise SettingsError(
            f"simulation {simulate!r} cannot be {'sent to workers' if callable(simulate) else 'found'} ({error}): "
            "give a function of a module, or its name as module:function"
        ) from error


@contextmanager
def _interrupts() -> Iterator[None]:
    """Remember an interrupt, and raise it where it comes."""
    _interrupted.clear()
    if threading.current_thread() is not threading.main_thread():  # interrupts never reach it
        yield
        return

    def interrupt(*_: Any) -> None:
        _interrupted.set()
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _interrupted.clear()


@contextmanager
def _bar(progress: bool | None, patients: int, begun: int, what: str = "") -> Iterator[Callable[[Written], None]]:
    """A bar over the patients, with rate and time left."""
    from tqdm import tqdm

    hidden = None if progress is None else not progress  # None: where standard error is no terminal
    with tqdm(
        total=patients, initial=begun, unit="patient", desc=what or None, leave=False, disable=hidden, file=sys.stderr,
        smoothing=0.1, dynamic_ncols=True,
    ) as bar:  # fmt: skip
        failed = 0

        def tell(written: Written) -> None:
            nonlocal failed
            failed += written.failed
            if failed and not what:
                bar.set_postfix_str(f"{failed} failed", refresh=False)
            bar.update(written.last - written.first)

        yield tell

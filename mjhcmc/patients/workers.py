"""The same work on many jobs: in this process, on a pool of processes, or on a dask cluster.

Each way gives the outcomes as they come, with no more jobs under way than keep the workers busy, so that memory does
not grow with the number of jobs.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import multiprocessing.resource_tracker as resource_tracker
import os
import signal
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from itertools import islice
from multiprocessing.connection import Connection
from typing import Any

from mjhcmc.errors import MjhcmcWarning, SettingsError, SimulationError

Work = Callable[[Any], Any]
Runner = Callable[[Work, Iterable[Any]], Iterator[Any]]
"""Calls work(job) for every job; yields what the calls give, in any order. A job tells its name by str()."""

TRIES = 4
"""Times that a job is tried whose workers die."""

AHEAD = 2
"""Jobs under way for each worker: the one that it does, and the next."""

CONNECT = 10.0
"""s, to reach a scheduler."""

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def in_process(work: Work, jobs: Iterable[Any]) -> Iterator[Any]:
    """A runner that does one job after the other, here."""
    return map(work, jobs)


@contextmanager
def pool(workers: int, after_death: Callable[[], None]) -> Iterator[Runner]:
    """A runner on processes of its own. They end with the block, and with this process, however it ends.

    Processes are spawned, not forked: threads and locks of MuJoCo, BLAS and Arrow do not survive a fork.

    Args:
        workers: how many processes.
        after_death: called when a worker died and the others were stopped, before the work goes on.

    Raises:
        SimulationError: (by the runner) a job whose workers die whenever they try it.
    """
    own = _Pool(workers, after_death)
    try:
        yield own.run
    except BaseException:
        own.stop(now=True)
        raise
    own.stop()


class _Pool:
    """A ProcessPoolExecutor that is set up again when a worker dies."""

    def __init__(self, workers: int, after_death: Callable[[], None]):
        self._workers, self._after_death = workers, after_death
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._broken = False
        self._reader, self._lifeline = context.Pipe(duplex=False)
        self._executor = ProcessPoolExecutor(self._workers, context, _begin_worker, (self._reader,))

    def stop(self, *, now: bool = False) -> None:
        """End the workers; now: what they are at is lost."""
        if now:
            self._lifeline.close()  # workers see that, and end
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._lifeline.close()
        self._reader.close()

    def run(self, work: Work, jobs: Iterable[Any]) -> Iterator[Any]:
        """See `Runner`. After a death, what was under way is done one by one: so the job that kills is found."""
        waiting = iter(jobs)
        while lost := (yield from self._until_death(work, waiting)):
            for job in lost:
                yield self._alone(work, job)

    def _until_death(self, work: Work, waiting: Iterator[Any]) -> Generator[Any, None, list[Any]]:
        """Yield outcomes until all is done or a worker dies; the jobs that were under way then."""
        pending: dict[Future[Any], Any] = {}
        lost: list[Any] = []
        while True:
            for job in islice(waiting, AHEAD * self._workers - len(pending) if not lost else 0):
                try:
                    pending[self._submit(work, job)] = job
                except BrokenProcessPool:
                    lost.append(job)
                    break
            self._broken |= bool(lost)
            if not pending:
                return lost
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                job = pending.pop(future)
                try:
                    outcome = future.result()
                except BrokenProcessPool:
                    lost.append(job)
                else:
                    yield outcome
            self._broken |= bool(lost)

    def _alone(self, work: Work, job: Any) -> Any:
        for _ in range(TRIES - 1):
            try:
                return self._submit(work, job).result()
            except BrokenProcessPool:
                self._broken = True
        raise SimulationError(
            f"{job}: {TRIES} worker processes died of it (killed, out of memory; or a script that lacks "
            'if __name__ == "__main__"): try fewer workers, then start again to resume'
        )

    def _submit(self, work: Work, job: Any) -> Future[Any]:
        if self._broken:
            self.stop(now=True)
            self._after_death()
            self._start()
        with _no_interrupts():
            return self._executor.submit(work, job)


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Keep interrupts from processes that start here: a terminal's is for all of them, but the parent's to handle."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # it would let them through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker(lifeline: Connection) -> None:
    """In a worker: one thread, no interrupts, and an end when the parent ends."""
    for name in _THREADS:  # NumPy is not loaded yet
        os.environ.setdefault(name, "1")
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        lifeline.poll(None)  # closed, by the parent or by its death
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def on_cluster(address: str) -> Iterator[Runner]:
    """A runner on a dask cluster. Jobs of workers that die go to others.

    Args:
        address: of the scheduler, such as ``"tcp://node1:8786"``.

    Raises:
        SettingsError: no scheduler answers there, or dask.distributed is not installed.
        SimulationError: (by the runner) a job whose workers die whenever they try it; a cluster that is lost.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise SettingsError('a cluster needs dask.distributed: pip install "mjhcmc[cluster]"') from error
    connect: Any = Client
    with _silent("distributed", "distributed.client"):
        try:
            client = connect(address, timeout=CONNECT)
        except (OSError, ValueError, RuntimeError, TypeError, AssertionError) as error:
            # the last is dask's where its own loop does not start in time
            raise SettingsError(
                f"cluster {address!r}: no dask scheduler answers there: check the address, or start one (dask "
                "scheduler), or leave the cluster out"
            ) from error
        with client:
            if not client.nthreads():
                warnings.warn(f"cluster {address!r} has no workers yet: waiting for some", MjhcmcWarning, stacklevel=3)
            yield partial(_run_on, client, address)


@contextmanager
def _silent(*names: str) -> Iterator[None]:
    """Keep loggers from printing tracebacks of connections that are lost: that is told once, as an error."""
    loggers = [logging.getLogger(name) for name in names]
    before = [logger.level for logger in loggers]
    try:
        for logger in loggers:
            logger.setLevel(logging.CRITICAL)
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def _run_on(client: Any, address: str, work: Work, jobs: Iterable[Any]) -> Iterator[Any]:
    from distributed import KilledWorker, as_completed

    finished: Any = as_completed
    pending: dict[str, Any] = {}
    waiting, done = iter(jobs), finished(loop=client.loop)
    job: Any = None
    try:
        while True:
            most = AHEAD * max(1, sum(client.nthreads().values()))  # it may have grown
            for job in islice(waiting, max(0, most - len(pending))):
                # pure=False: what a job does is to write files; another run must not be taken for this one
                future = client.submit(work, job, pure=False, retries=TRIES - 1)
                pending[future.key] = job
                done.add(future)
            if not pending:
                return
            future = next(done)
            job = pending.pop(future.key)
            yield future.result()
    except (CancelledError, asyncio.CancelledError, OSError) as error:
        raise SimulationError(
            f"cluster {address!r}: its scheduler was lost: start the cluster, then start again to resume"
        ) from error
    except KilledWorker as error:
        raise SimulationError(
            f"{job}: the cluster's workers died of it each time (killed, out of memory): give them more memory, "
            "then start again to resume"
        ) from error
    except (ImportError, AttributeError, TypeError) as error:
        raise SimulationError(
            f"{job}: the cluster's workers could not begin it ({' '.join(str(error).split())}): install the same "
            "version of mjhcmc there"
        ) from error

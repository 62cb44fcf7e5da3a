"""A thread that always solves what was asked last."""

from __future__ import annotations

import atexit
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from mjhcmc.log import get_logger
from mjhcmc.methods.run import SolveInterrupted
from mjhcmc.viewing.live_solver import LiveRequest, LiveResult, LiveSolver

_HALF = 0.5  # of the windows: a solve that is further along is worth finishing

_log = get_logger(__name__)


class _GivenUp(KeyboardInterrupt):
    """Raised in a solve that nobody waits for any more."""


class Newest:
    """A thread that solves the newest request; older ones that it has not begun are dropped.

    A solve in progress is given up for a newer request where it is not half through, but never twice in a row: while
    someone drags, results keep coming. When nothing waits after a result, ``idle`` is called with it, for what is
    nice to know and takes time; a new request does not interrupt that.

    Args:
        solver: what solves; nobody else may use it meanwhile.
        show: called with each result, in the thread.
        idle: called with a result after which nothing waits, in the thread.
    """

    def __init__(
        self,
        solver: LiveSolver,
        show: Callable[[LiveResult], Any],
        idle: Callable[[LiveResult], Any] | None = None,
    ) -> None:
        self._solver, self._show, self._idle = solver, show, idle
        self._change = threading.Condition()
        self._waiting: LiveRequest | None = None
        self._closed = self._gave_up = False
        self.given_up = 0
        self._thread = threading.Thread(target=self._work, name="mjhcmc-live", daemon=True)
        self._thread.start()
        atexit.register(self.close)  # at the interpreter's end, a thread in compiled code would crash

    def ask(self, request: LiveRequest) -> None:
        """Ask for something; returns at once."""
        with self._change:
            self._waiting = request
            self._change.notify()

    @property
    def busy(self) -> bool:
        """Whether a newer request waits."""
        return self._waiting is not None

    def close(self) -> None:
        """Give up what is in progress, and end the thread."""
        atexit.unregister(self.close)
        with self._change:
            self._closed = True
            self._change.notify()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._closed or self._waiting is not None)
                if self._closed:
                    return
                request, self._waiting = self._waiting, None
            assert request is not None
            try:
                result = self._solver.solve(request, self._look_up)
            except SolveInterrupted:
                self._gave_up = True
                self.given_up += 1
                continue
            self._gave_up = False
            self._call(self._show, result)
            if self._idle is not None and not self.busy and not self._closed:
                with suppress(SolveInterrupted):
                    self._call(self._idle, result)

    def give_up_if_asked(self, done: int, count: int) -> None:
        """Progress for `LiveSolver.solve` in ``idle``: gives the solve up as soon as there is a request."""
        if self._closed or self.busy:
            raise _GivenUp

    def _look_up(self, done: int, count: int) -> None:
        if self._closed or (self.busy and not self._gave_up and done < _HALF * count):
            raise _GivenUp

    @staticmethod
    def _call(what: Callable[[LiveResult], Any], result: LiveResult) -> None:
        try:
            what(result)
        except Exception:  # the thread must outlive a page that went away
            _log.exception("live: a result could not be shown")

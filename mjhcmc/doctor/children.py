"""Processes that try what may break: started together, asked for one JSON object a line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

_PACKAGE_PARENT = str(Path(__file__).resolve().parents[2])


@dataclass(frozen=True)
class Outcome:
    """What a process left behind.

    Attributes:
        lines: the JSON objects that it printed, in order.
        ended_well: whether it ended by itself, with exit code 0.
        why: the last line of its standard error, or how it ended; empty where it ended well.
        seconds: how long it took.
    """

    lines: list[dict[str, Any]] = field(default_factory=list)
    ended_well: bool = True
    why: str = ""
    seconds: float = 0.0


class Child:
    """A Python process that runs some code with the mjhcmc that runs here."""

    def __init__(
        self, code: str, arguments: Sequence[str] = (), environment: Mapping[str, str | None] | None = None
    ) -> None:
        """Start it.

        Args:
            code: Python.
            arguments: its ``sys.argv[1:]``.
            environment: variables that differ from this process's; None takes one away.
        """
        variables = dict(os.environ)
        # behind all others: it is there for a checkout that is not installed, and shall hide nothing
        variables["PYTHONPATH"] = os.pathsep.join(filter(None, [variables.get("PYTHONPATH"), _PACKAGE_PARENT]))
        for name, value in (environment or {}).items():
            variables.pop(name, None)
            if value is not None:
                variables[name] = value
        self._began = time.perf_counter()
        # -P: a file of the user's in this folder is no package of Python's
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", code, *arguments], env=variables, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, errors="replace",
        )  # fmt: skip

    def wait(self, timeout: float) -> Outcome:
        """Wait until it ends, at most so many seconds, then end it."""
        timed_out = False
        try:
            out, err = self._process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            timed_out = True
            self._process.kill()
            out, err = self._process.communicate()
        seconds = time.perf_counter() - self._began
        code = self._process.returncode
        why = ""
        if timed_out:
            why = f"not done after {timeout:g} s"
        elif code:
            said = [line.strip() for line in err.splitlines() if line.strip()]
            why = f"it was ended by signal {-code}" if code < 0 else said[-1] if said else f"exit code {code}"
        return Outcome(_objects(out), not timed_out and code == 0, why, seconds)

    def end(self) -> None:
        """End it, where it still runs."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.communicate()


def _objects(text: str) -> list[dict[str, Any]]:
    """The JSON objects among the lines: packages may print lines of their own."""
    found = []
    for line in text.splitlines():
        if line.startswith("{"):
            try:
                found.append(json.loads(line))
            except ValueError:
                continue
    return found

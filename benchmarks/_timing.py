"""What the speed benchmarks share: clocks, medians with their quartiles, fresh processes, and what they ran on."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

PACKAGES = ("mujoco", "numpy", "numba", "scipy", "qpsolvers")
_SHORT = 2e-3  # s: a shorter call is repeated within one reading
_MOST_REPEATS = 1000


@dataclass(frozen=True)
class Reading:
    """Wall and CPU time of one call, s; CPU time is the whole process's, all threads."""

    wall: float
    cpu: float


def read(call: Callable[[], Any], repeats: int = 1) -> Reading:
    """One reading, the mean of so many calls."""
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(repeats):
        call()
    return Reading((time.perf_counter() - wall) / repeats, (time.process_time() - cpu) / repeats)


def alternate(calls: Mapping[str, Callable[[], Any]], runs: int, *, warm_up: bool = True) -> dict[str, list[Reading]]:
    """So many readings of each call, in turns, after a first of each that does not count.

    In turns, so that what else the machine does falls on all alike, and their ratios are of the same minutes.

    Args:
        calls: by name.
        runs: turns.
        warm_up: without, all readings count: for calls of seconds whose code has run before.
    """
    repeats = dict.fromkeys(calls, 1)
    for name, call in calls.items() if warm_up else ():
        if (wall := read(call).wall) < 1.0:
            wall = read(call).wall  # the first may compile
        repeats[name] = min(_MOST_REPEATS, max(1, round(_SHORT / max(wall, 1e-7))))
    readings: dict[str, list[Reading]] = {name: [] for name in calls}
    for _ in range(runs):
        for name, call in calls.items():
            readings[name].append(read(call, repeats[name]))
    return readings


def walls(readings: Sequence[Reading]) -> list[float]:
    """Wall times, s."""
    return [reading.wall for reading in readings]


def ratios(one: Sequence[Reading], other: Sequence[Reading]) -> list[float]:
    """Wall time of one over the other's, turn by turn."""
    return [a.wall / b.wall for a, b in zip(one, other, strict=True)]


def spread(values: Sequence[float], unit: float = 1.0) -> str:
    """Median, and the quartiles in brackets, in multiples of a unit."""
    low, mid, high = (figure(float(value) / unit) for value in np.quantile(values, (0.25, 0.5, 0.75)))
    return mid if low == high else f"{mid} ({low}–{high})"


def figure(value: float) -> str:
    """Three digits, no powers of ten, thousands apart."""
    if abs(value) >= 1000:
        return f"{float(f'{value:.3g}'):,.0f}"
    return f"{value:#.3g}".rstrip(".") if value else "0"


@contextmanager
def quiet() -> Iterator[None]:
    """Without the package's notices."""
    from mjhcmc.errors import MjhcmcWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MjhcmcWarning)
        yield


def fresh_python(arguments: Sequence[str], **environment: str) -> str:
    """What a fresh Python prints.

    Raises:
        SystemExit: it failed; with what it said.
    """
    done = subprocess.run(
        [sys.executable, *arguments], env={**os.environ, **environment}, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(arguments)} failed ({done.returncode}):\n{done.stderr}")
    return done.stdout


def machine(packages: Sequence[str] = PACKAGES) -> str:
    """One paragraph: on what, when, with which versions and under what load this is measured."""
    load = f"load {os.getloadavg()[0]:.2f} at the start; " if hasattr(os, "getloadavg") else ""
    found = ", ".join(f"{package} {package_version(package)}" for package in packages)
    return (
        f"{processor()}, {os.cpu_count()} cores, {platform.system()}; {load}{time.strftime('%Y-%m-%d')}. "
        f"Python {platform.python_version()}, {found}."
    )


def processor() -> str:
    """The processor's name, as far as the system tells it."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def package_version(package: str) -> str:
    """A package's version, or that it is absent."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"

"""How long a solve takes against MuJoCo alone over the same steps, and a cold start, as Markdown.

    python benchmarks/timing.py [--runs 9] [--cold-runs 3] [--no-cold]

Solve and bare stepping take turns in one process, model and motion loaded, after a first solve; without verdict, replay
or files. A cold start is a fresh process with an empty folder for Numba's compiled code, then one with that folder
filled. Wall time; nothing else should run.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

from _markdown import grid

CASES = (("fast", 0.01), ("fast", 0.005), ("slow", 0.01), ("slow", 0.005))

_FIRST_SOLVE = """
import json, time
began = time.perf_counter()
import mjhcmc
model = mjhcmc.MuscleModel.load("leg8")
motion = mjhcmc.Motion.cosine(model, "fast")
mjhcmc.hcmc  # imported when first asked for
loaded = time.perf_counter()
mjhcmc.hcmc(model, motion)
first = time.perf_counter()
mjhcmc.hcmc(model, motion)
print(json.dumps([loaded - began, first - loaded, time.perf_counter() - first]))
"""

COMMANDS = {
    "mjhcmc --help": ["-m", "mjhcmc", "--help"],
    "mjhcmc reproduce": ["-m", "mjhcmc", "reproduce", "--out", "{folder}"],
}


def spread(times: list[float]) -> str:
    """Median and range, ms."""
    return f"{1e3 * median(times):.3g} ({1e3 * min(times):.3g}–{1e3 * max(times):.3g})"


def seconds(times: list[float]) -> str:
    """Median and range, s."""
    return f"{median(times):.2f} ({min(times):.2f}–{max(times):.2f})"


def machine() -> str:
    """One line: what this was measured on."""
    name = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        found = [line.split(":", 1)[1].strip() for line in cpuinfo.read_text().splitlines() if "model name" in line]
        name = found[0] if found else name
    packages = ", ".join(f"{package} {version(package)}" for package in ("mujoco", "numpy", "numba", "scipy"))
    load = f"load {os.getloadavg()[0]:.2f} at the start; " if hasattr(os, "getloadavg") else ""
    return f"{name}, {os.cpu_count()} cores; {load}Python {platform.python_version()}, {packages}."


def warm(runs: int) -> str:
    import mjhcmc
    from mjhcmc.reproduce import bare_step_time

    model = mjhcmc.MuscleModel.load("leg8")
    rows = []
    for movement, dt in CASES:
        motion = mjhcmc.Motion.cosine(model, movement)
        solution = mjhcmc.hcmc(model, motion, dt=dt)
        solve_times, bare_times = [], []
        for _ in range(runs):
            solve_times.append(timed(partial(mjhcmc.hcmc, model, motion, dt=dt)))
            bare_times.append(bare_step_time(solution))
        ratios = [a / b for a, b in zip(solve_times, bare_times, strict=True)]
        windows = solution.n_window
        rows.append(
            (
                f"{movement}, {1e3 * dt:g} ms",
                windows,
                spread(solve_times),
                spread(bare_times),
                f"{median(ratios):.1f} ({min(ratios):.1f}–{max(ratios):.1f})",
                f"{1e6 * median(solve_times) / windows:.0f}",
                f"{median(solve_times) / float(solution.time[-1] - solution.time[0]):.3f}",
            )
        )
    return grid(
        (
            "movement, dt",
            "windows",
            "solve, ms",
            "bare stepping, ms",
            "solve / bare",
            "a window, µs",
            "solve / movement's duration",
        ),
        rows,
    )


def timed(call: Callable[[], Any]) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def cold(runs: int) -> str:
    rows: dict[str, tuple[list[float], list[float]]] = {}

    def note(name: str, filled: int, seconds: float) -> None:
        rows.setdefault(name, ([], []))[filled].append(seconds)

    for _ in range(runs):
        with tempfile.TemporaryDirectory() as cache:
            for filled in (0, 1):
                loaded, first, second = json.loads(python(["-c", _FIRST_SOLVE], cache))
                note("import, load model and motion", filled, loaded)
                note("first solve (fast, 10 ms)", filled, first)
                note("second solve", filled, second)
        for name, arguments in COMMANDS.items():
            with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryDirectory() as folder:
                for filled in (0, 1):
                    given = [argument.format(folder=folder) for argument in arguments]
                    note(f"`{name}`, whole process", filled, timed(partial(python, given, cache)))
    return grid(
        ("s", "Numba's folder empty", "filled"),
        ((name, seconds(empty), seconds(filled)) for name, (empty, filled) in rows.items()),
    )


def python(arguments: list[str], cache: str) -> str:
    """What a fresh Python prints, with Numba's compiled code kept in a folder of its own."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    done = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(arguments)} failed ({done.returncode}):\n{done.stderr}")
    return done.stdout


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="timing.py", description="Solve time against bare stepping, and a cold start."
    )
    parser.add_argument("--runs", type=int, default=9, help="timed solves of each case (at least 7 to report)")
    parser.add_argument("--cold-runs", type=int, default=3, help="cold starts")
    parser.add_argument("--no-cold", action="store_true", help="leave the cold starts out")
    options = parser.parse_args()
    print(machine())
    print(f"\nMedian (range) of {options.runs} runs.\n\n{warm(options.runs)}")
    if not options.no_cold:
        print(f"\nCold start, median (range) of {options.cold_runs}.\n\n{cold(options.cold_runs)}")


if __name__ == "__main__":
    main()

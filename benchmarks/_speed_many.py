"""Many movements in lock step: rate against MuJoCo alone, threads, memory."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import _bare
import numpy as np
from _markdown import grid
from _timing import alternate, figure, fresh_python, quiet, ratios, spread, walls

import mjhcmc

CASES = ((1, 3.0, 1.0), (64, 3.0, 0.5), (1024, 1.0, 0.3))
"""Simulations, cycles of .2 s, and which share of the runs asked for; 1024 whole movements would take minutes."""

MEMORY = ((128, 5), (512, 5), (1024, 5), (128, 20), (512, 20))
"""Simulations and windows of the fresh processes whose memory is read."""

_AMPLITUDES = {"hip": np.deg2rad(10.0), "knee": np.deg2rad(-20.0), "ankle": np.deg2rad(-10.0)}
_PERIOD = 0.2
_PLAIN = 64  # movements that are also stepped one by one, and run once before it counts: more take minutes


@dataclass(frozen=True)
class Rate:
    """What one case gave.

    Attributes:
        count: simulations.
        threads: of the solve and of bare stepping.
        rate: movements a second, one a turn.
        bare: the same of MuJoCo alone in lock step.
        plain: the same of mj_step, one movement after the other on one thread; empty for many.
        share: of the bare rate, turn by turn.
        windows: of each movement.
    """

    count: int
    threads: int
    rate: list[float]
    bare: list[float]
    plain: list[float]
    share: list[float]
    windows: int


def motions(model: mjhcmc.MuscleModel, count: int, cycles: float) -> list[mjhcmc.Motion]:
    """The fast movement at half to whole amplitude, no two alike."""
    return [
        mjhcmc.Motion.cosine(
            model, amplitudes={joint: scale * a for joint, a in _AMPLITUDES.items()}, period=_PERIOD, cycles=cycles
        )
        for scale in np.linspace(0.5, 1.0, count)
    ]


def models(model: mjhcmc.MuscleModel, count: int) -> list[mjhcmc.MuscleModel]:
    """The leg with 90 to 110 % of its strength."""
    import copy

    result = []
    for scale in np.linspace(0.9, 1.1, count):
        mj_model = copy.deepcopy(model.mj_model)
        mj_model.actuator_gainprm[:, 2] *= scale
        mj_model.actuator_biasprm[:, 2] *= scale
        result.append(mjhcmc.MuscleModel.load(mj_model))
    return result


def threads() -> list[int]:
    """Numbers of threads to try."""
    return sorted({1, 2, os.cpu_count() or 1})


def rates(runs: int, quick: bool) -> tuple[str, list[Rate]]:
    """The table of rates; and what it holds."""
    leg, rows, found = mjhcmc.MuscleModel.load("leg8"), [], []
    for count, cycles, share in CASES[:2] if quick else CASES:
        legs: dict[str, Any] = {"": leg}
        if count == 64 and not quick:
            legs[", a model each"] = models(leg, count)
        for label, given in legs.items():
            tried = [1] if count == 1 or label else threads()
            some = motions(leg, count, 0.5 if quick else cycles)
            result = measure(given, some, tried, max(3, round(share * runs)) if not quick else 2)
            found += result if not label else []
            one = result[0]
            for case in result:
                gains = [
                    spread([a / b for a, b in zip(mine, base, strict=True)])
                    for mine, base in ((case.rate, one.rate), (case.bare, one.bare))
                ]
                rows.append(
                    (
                        f"B = {count}{label}",
                        case.threads,
                        case.windows,
                        spread(case.rate),
                        spread(case.bare),
                        spread(case.plain) if case.plain else "",
                        spread(case.share, 0.01),
                        *(("", "") if case is one else gains),
                        len(case.rate),
                    )
                )
    header = (
        "movements at once",
        "threads",
        "windows each",
        "movements/s",
        "bare stepping, movements/s",
        "plain mj_step, movements/s",
        "share of bare stepping, %",
        "times one thread",
        "bare stepping: times one thread",
        "runs",
    )
    return grid(header, rows), found


def measure(given: Any, some: Sequence[mjhcmc.Motion], tried: Sequence[int], runs: int) -> list[Rate]:
    """One case by numbers of threads, in turns with MuJoCo alone in lock step on as many threads."""
    with quiet():
        solutions = solve(given, some, 1)
        calls: dict[str, Callable[[], Any]] = {}
        for n in tried:
            calls[f"solve {n}"] = partial(mjhcmc.hcmc_batch, given, some, threads=n)
            calls[f"bare {n}"] = _bare.many(solutions, n)
        if len(some) <= _PLAIN:
            calls["plain"] = _bare.one_by_one(solutions)
        readings = alternate(calls, runs, warm_up=len(some) <= _PLAIN)
    count, result = len(some), []
    for n in tried:
        ours, bare = readings[f"solve {n}"], readings[f"bare {n}"]
        result.append(
            Rate(
                count,
                n,
                [count / wall for wall in walls(ours)],
                [count / wall for wall in walls(bare)],
                [count / wall for wall in walls(readings.get("plain", []))] if n == 1 else [],
                ratios(bare, ours),
                solutions[0].n_window,
            )
        )
    return result


def solve(given: Any, some: Sequence[mjhcmc.Motion], n: int) -> list[mjhcmc.Solution]:
    """All solutions; none may have failed."""
    batch = mjhcmc.hcmc_batch(given, some, threads=n)
    failed = [str(error) for error in batch.errors if error]
    if failed:
        raise SystemExit(f"{len(failed)} of {len(some)} movements failed: {failed[0]}")
    return list(batch)


def memory(quick: bool) -> str:
    """What a simulation takes, by a linear fit of the peak memory of fresh processes."""
    cases = MEMORY[:2] + MEMORY[3:4] if quick else MEMORY
    took = [float(fresh_python([str(Path(__file__)), str(count), str(n)])) for count, n in cases]
    design = np.array([[1.0, count, count * n] for count, n in cases])
    fit = np.linalg.lstsq(design, np.array(took), rcond=None)[0]
    apart = np.abs(design @ fit - took).max()
    table = grid(
        ("B, windows", "peak memory above the start, MB", "fit, MB"),
        (
            (f"{count}, {n}", figure(mb / 1e6), figure(value / 1e6))
            for (count, n), mb, value in zip(cases, took, design @ fit, strict=True)
        ),
    )
    return (
        f"{table}\n\nFit: B ({fit[1] / 1e3:.1f} kB + windows × {fit[2] / 1e3:.2f} kB) and {fit[0] / 1e6:.1f} MB, which "
        f"do not depend on B (negative: memory that the process had spare); off by {apart / 1e6:.1f} MB at most."
    )


def _peak(count: int, windows: int) -> float:
    """Bytes that a batch adds to this process at its peak; model, motions and compiled code are there before."""
    model = mjhcmc.MuscleModel.load("leg8")
    some = motions(model, count, windows * 0.01 / _PERIOD)
    for motion in some:
        motion.sample([0.0])  # its spline
    with quiet():
        solve(model, some[:2], 1)
        before = _resident("VmRSS")
        solutions = solve(model, some, 1)
    assert len(solutions) == count
    return _resident("VmHWM") - before


def _resident(what: str) -> float:
    """Bytes: VmRSS, what is resident now; VmHWM, its peak."""
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith(what):
            return 1024.0 * float(line.split()[1])
    raise SystemExit("memory is read from /proc/self/status, which this system has not")


def best(found: Sequence[Rate], count: int) -> Rate | None:
    """The case of so many simulations with the highest median rate."""
    cases = [case for case in found if case.count == count]
    return max(cases, key=lambda case: median(case.rate), default=None)


if __name__ == "__main__":
    print(json.dumps(_peak(int(sys.argv[1]), int(sys.argv[2]))))

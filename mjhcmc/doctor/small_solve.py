"""A small solve whose result is known, and what it tells of the cache of compiled code."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjhcmc.doctor.children import Child

_RUN = "from mjhcmc.doctor.small_solve import main; main()"
_PATIENCE = 300.0  # s: compiling everything takes ten to thirty
_WINDOWS = 5
_BOUND_DEG = 0.2  # the ankle is off by .076 deg there, the paper's CMC by degrees
_BALANCE = 1e-6  # N m: R^T F + reserve is the net joint moment


@dataclass(frozen=True)
class SmallSolve:
    """How the small solve went.

    Attributes:
        error_deg: the largest tracking error; None where it did not get that far.
        seconds: from the start of Python to the end of the first solve; None likewise.
        solve_seconds: of the solve alone; what was compiled, or read from the cache, is in it.
        problem: what is wrong, or None.
        cache: folder that compiled code is kept in; None where it is not known.
        compiled: functions that had to be compiled, which the cache did not hold.
        cold_seconds: of the solve alone with an empty cache; None unless it was measured.
    """

    error_deg: float | None = None
    seconds: float | None = None
    solve_seconds: float | None = None
    problem: str | None = None
    cache: str | None = None
    compiled: int = 0
    cold_seconds: float | None = None


def start(*, cold: bool = False, held: ExitStack | None = None) -> Child:
    """Solve in a process of its own.

    Args:
        cold: with an empty cache of its own, which is thrown away.
        held: takes that cache away when it is closed; needed with cold.
    """
    if not cold:
        return Child(_RUN, environment={"MUJOCO_GL": None})  # nothing is drawn: what is wrong with it is told apart
    assert held is not None  # what is made here is to be taken away
    folder = held.enter_context(tempfile.TemporaryDirectory(prefix="mjhcmc-doctor-"))
    return Child(_RUN, environment={"NUMBA_CACHE_DIR": folder, "MUJOCO_GL": None})


def gather(child: Child, cold: Child | None = None) -> SmallSolve:
    """What came of it, and of the one with an empty cache."""
    outcome = child.wait(_PATIENCE)
    found: dict[str, Any] = next((line for line in outcome.lines if "error_deg" in line), {})
    problem: str | None = None
    if not found:
        problem = outcome.why or "it said nothing"
    elif not (found["error_deg"] <= _BOUND_DEG and found["balance"] <= _BALANCE):
        problem = (
            f"tracks to {found['error_deg']:.3g} deg, not {_BOUND_DEG:g}; moments balance to {found['balance']:.1g} N m"
        )
    cold_seconds = None
    if cold is not None:
        cold_seconds = next((line["solve_seconds"] for line in cold.wait(_PATIENCE).lines if "error_deg" in line), None)
    return SmallSolve(
        found.get("error_deg"),
        outcome.seconds if found else None,
        found.get("solve_seconds"),
        problem,
        found.get("cache"),
        found.get("compiled", 0),
        cold_seconds,
    )


def cache_asked() -> tuple[str | None, str | None]:
    """NUMBA_CACHE_DIR, and why it cannot be written; None where it is not set, or can be."""
    asked = os.environ.get("NUMBA_CACHE_DIR")
    if not asked:
        return None, None
    try:
        Path(asked).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=asked):
            pass
    except OSError as error:
        return asked, error.strerror or type(error).__name__
    return asked, None


def main() -> None:
    """Solve five windows of the paper's movement and print what came of it as JSON."""
    import mjhcmc

    model = mjhcmc.MuscleModel.load("leg8")
    whole = mjhcmc.Motion.cosine(model, "fast")
    rows = whole.time <= 0.01 * _WINDOWS + 1e-9
    motion = mjhcmc.Motion(whole.time[rows], whole.qpos[rows])
    began = time.perf_counter()
    solution = mjhcmc.hcmc(model, motion)
    seconds = time.perf_counter() - began
    import numpy as np

    given = solution.detail.muscle_moment.sum(axis=1)[:-1] + solution.reserve
    folder, compiled = _kernels()
    print(
        json.dumps(
            {
                "error_deg": float(np.rad2deg(np.abs(solution.tracking_error).max())),
                "balance": float(np.abs(given - solution.net_joint_moment[:-1]).max()),
                "solve_seconds": seconds,
                "cache": folder,
                "compiled": compiled,
            }
        ),
        flush=True,
    )


def _kernels() -> tuple[str | None, int]:
    """The folder of compiled code, and how many functions had to be compiled."""
    from numba.core.dispatcher import Dispatcher

    found = {
        id(value): value
        for name, module in list(sys.modules.items())
        if name.startswith("mjhcmc.")
        for value in vars(module).values()
        if isinstance(value, Dispatcher)
    }
    stats = [each.stats for each in found.values()]
    used = [each for each in stats if each.cache_hits or each.cache_misses]
    folder = next((each.cache_path for each in used if each.cache_path), None)
    return folder, sum(sum(each.cache_misses.values()) for each in used)

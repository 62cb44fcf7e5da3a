"""Where the time of HCMC goes: MuJoCo's steps, its evaluations, compiled kernels, Python."""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial, wraps
from statistics import median
from typing import Any

import mujoco
import mujoco.batch
from _markdown import grid
from _speed_many import motions
from _timing import figure, quiet, read

import mjhcmc

STEP, EVALUATE, KERNEL = "MuJoCo: steps", "MuJoCo: evaluations and the rest", "compiled kernels"
REST = "Python and NumPy"
_STEPS = ("mj_step", "step", "rollout")


class Clock:
    """Adds up the time of calls by what they are; a call within another counts as the outer one's."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self._inside = False

    def timed(self, call: Callable[..., Any], what: str) -> Callable[..., Any]:
        """The call, timed."""

        @wraps(call)
        def clocked(*args: Any, **options: Any) -> Any:
            if self._inside:
                return call(*args, **options)
            self._inside = True
            began = time.perf_counter()
            try:
                return call(*args, **options)
            finally:
                self.seconds[what] += time.perf_counter() - began
                self.calls[what] += 1
                self._inside = False

        return clocked


@contextmanager
def clocked() -> Iterator[Clock]:
    """While the block runs, all that Python calls of MuJoCo and of the package's kernels is timed."""
    from numba.core.registry import CPUDispatcher

    clock, before = Clock(), []

    def put(owner: Any, name: str, what: str) -> None:
        call = getattr(owner, name)
        before.append((owner, name, call))
        setattr(owner, name, clock.timed(call, what))

    for name in vars(mujoco):
        if name.startswith(("mj_", "mju_", "mjd_")) and callable(getattr(mujoco, name)):
            put(mujoco, name, STEP if name in _STEPS else EVALUATE)
    for name in ("step", "rollout", "forward", "jac", "set_const", "set_models", "expand"):
        put(mujoco.batch.Batch, name, STEP if name in _STEPS else EVALUATE)
    for path, module in list(sys.modules.items()):
        if path.startswith("mjhcmc."):
            for name, value in list(vars(module).items()):
                if isinstance(value, CPUDispatcher):
                    put(module, name, KERNEL)
    try:
        yield clock
    finally:
        for owner, name, call in before:
            setattr(owner, name, call)


def shares(call: Callable[[], Any], runs: int) -> dict[str, tuple[float, int]]:
    """Seconds and calls of each kind in one call, medians; the rest is what the unclocked call takes beyond them."""
    with quiet():
        call()
        plain = median([read(call).wall for _ in range(runs)])
        clocks = []
        for _ in range(runs):
            with clocked() as clock:
                call()
            clocks.append(clock)
    found = {
        what: (median([clock.seconds[what] for clock in clocks]), clocks[0].calls[what])
        for what in (STEP, EVALUATE, KERNEL)
    }
    return {**found, REST: (max(0.0, plain - sum(seconds for seconds, _ in found.values())), 0)}


def table(runs: int, quick: bool) -> str:
    """The table: one movement, and many at once on one thread."""
    model = mjhcmc.MuscleModel.load("leg8")
    cases: dict[str, Callable[[], Any]] = {
        "one (`hcmc`, slow)": partial(mjhcmc.hcmc, model, mjhcmc.Motion.cosine(model, "slow"))
    }
    if hasattr(mjhcmc, "hcmc_batch"):
        count = 16 if quick else 64
        cases[f"B = {count}, one thread (`hcmc_batch`, fast)"] = partial(
            mjhcmc.hcmc_batch, model, motions(model, count, 3.0), threads=1
        )
    found = {name: shares(call, runs) for name, call in cases.items()}
    rows = []
    for what in (STEP, EVALUATE, KERNEL, REST):
        cells = []
        for parts in found.values():
            seconds, calls = parts[what]
            whole = sum(part for part, _ in parts.values())
            cells += [f"{100 * seconds / whole:.0f}", figure(1e3 * seconds), calls or ""]
        rows.append((what, *cells))
    header = [cell for name in found for cell in (f"{name}: share, %", "ms", "calls")]
    return grid(("", *header), rows)

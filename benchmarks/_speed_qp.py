"""QP solvers against each other, on the allocations of real movements."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Any

import numpy as np
import qpsolvers
from _chain import chain, swing
from _markdown import grid
from _timing import alternate, quiet, read, spread, walls

import mjhcmc
from mjhcmc import qp_back_ends
from mjhcmc.allocation import AllocationProblem, allocate
from mjhcmc.allocation_batch import AllocationBatch, AllocationStatus, allocate_many
from mjhcmc.errors import MjhcmcError, SimulationError

OURS = "newton"
_MANY = 4096
_JITTER = 0.01  # of the moments, so that no two problems are the same
_RECORDER = "daqp"  # any back end: what it is asked is recorded, and it answers


@dataclass(frozen=True)
class Times:
    """Of one solver, s a problem: medians over rounds, one for each problem.

    Attributes:
        whole: as the package calls it, with the proof of the answer.
        call: the solver called through qpsolvers with the program ready.
        alone: the back end's own call within that.
        difference: largest difference of activation from ours.
    """

    whole: list[float]
    call: list[float]
    alone: list[float]
    difference: float


def record(model: mjhcmc.MuscleModel, motion: mjhcmc.Motion, most: int) -> list[AllocationProblem]:
    """At most so many of the problems that HCMC allocates along a motion, evenly chosen."""
    problems: list[AllocationProblem] = []
    real = qp_back_ends.solve_with

    def recording(problem: AllocationProblem, solver: str) -> Any:
        problems.append(problem)
        return real(problem, solver)

    with replaced(qp_back_ends, "solve_with", recording), quiet():
        mjhcmc.hcmc(model, motion, solver=_RECORDER)
    if not problems:
        raise SystemExit(f"hcmc(solver={_RECORDER!r}) no longer asks qp_back_ends.solve_with: nothing to record")
    return problems[:: -(-len(problems) // most)]


@contextmanager
def replaced(owner: Any, name: str, value: Any) -> Iterator[None]:
    """An attribute replaced while the block runs."""
    before = getattr(owner, name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, before)


def installed() -> list[str]:
    """The back ends that are installed and that the package accepts."""
    accepted = []
    for solver in sorted(qpsolvers.available_solvers):
        try:
            qp_back_ends.check_solver(solver)
        except MjhcmcError:
            continue
        accepted.append(solver)
    return accepted


def compare(problems: list[AllocationProblem], runs: int) -> dict[str, Times]:
    """All solvers on all problems, in turns."""
    ours = [allocate(problem).activation for problem in problems]
    solvers, asked, difference = [], {}, {}
    for solver in [OURS, *installed()]:
        try:
            programs, answers = zip(*(_asked(problem, solver) for problem in problems), strict=True)
        except SimulationError as error:
            print(f"{solver} is left out: {error}", file=sys.stderr)
            continue
        solvers.append(solver)
        asked[solver] = programs
        difference[solver] = max(float(np.abs(a - b).max()) for a, b in zip(answers, ours, strict=True))
    readings: dict[str, list[list[tuple[float, float, float]]]] = {s: [[] for _ in problems] for s in solvers}
    for _ in range(runs):
        for solver in solvers:
            for problem, program, kept in zip(problems, asked[solver], readings[solver], strict=True):
                whole = read(partial(allocate, problem, solver)).wall
                kept.append((whole, *(program() if program else (np.nan, np.nan))))
    result = {}
    for solver, found in readings.items():
        whole, call, alone = (column.tolist() for column in np.median(np.array(found), axis=1).T)
        result[solver] = Times(whole, call, alone, difference[solver])
    return result


def _asked(problem: AllocationProblem, solver: str) -> tuple[Callable[[], tuple[float, float]] | None, Any]:
    """What puts the program that the package asked last to its back end again, timed; and the activation found."""
    last: list[Any] = []
    real = qpsolvers.solve_problem

    def noting(*args: Any, **options: Any) -> Any:
        last[:] = [args, options]
        return real(*args, **options)

    with replaced(qpsolvers, "solve_problem", noting):
        activation = allocate(problem, solver).activation
    if not last:
        return None, activation
    args, options = last
    return partial(_again, args, options), activation


def _again(args: Any, options: Any) -> tuple[float, float]:
    answer: list[Any] = []
    with quiet_back_ends():
        wall = read(lambda: answer.append(qpsolvers.solve_problem(*args, **options))).wall
    alone = getattr(answer[0], "solve_time", None)
    return wall, np.nan if alone is None else float(alone)


@contextmanager
def quiet_back_ends() -> Iterator[None]:
    """Without what back ends say about their own future."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def table(runs: int, quick: bool) -> tuple[str, dict[str, Times]]:
    """The tables, and the times on the leg's problems."""
    leg = mjhcmc.MuscleModel.load("leg8")
    large = chain(10, 80)
    sets = {
        "leg8, fast: 3 moments, 8 muscles": record(leg, mjhcmc.Motion.cosine(leg, "fast"), 20 if quick else 60),
        "chain: 10 moments, 80 muscles": record(large, swing(large), 10 if quick else 30),
    }
    timed = {name: compare(problems, runs) for name, problems in sets.items()}
    parts = []
    for name, found in timed.items():
        rows = [
            (
                "**mjhcmc's own**" if solver == OURS else solver,
                spread(one.whole, 1e-6),
                *("" if np.isnan(times).any() else spread(times, 1e-6) for times in (one.call, one.alone)),
                "" if solver == OURS else f"{one.difference:.0e}",
            )
            for solver, one in sorted(found.items(), key=lambda item: median(item[1].whole))
        ]
        header = (
            f"µs a problem ({name}, {len(sets[name])} problems)",
            "as mjhcmc calls it, with proof",
            "through qpsolvers",
            "of which the back end's own solve",
            "largest difference of activation",
        )
        parts.append(grid(header, rows))
    parts.append(batched(sets, runs, quick))
    return "\n\n".join(part for part in parts if part), next(iter(timed.values()))


def batched(sets: dict[str, list[AllocationProblem]], runs: int, quick: bool) -> str:
    """The table of problems a second on one thread, many in one call, from nothing and from near the answer."""
    rows = []
    for name, problems in sets.items():
        batch = _perturbed(problems, 500 if quick else _MANY)
        start = allocate_many(_perturbed(problems, len(batch), by=0.0)).multiplier
        readings = alternate(
            {"cold": partial(allocate_many, batch), "warm": partial(allocate_many, batch, start)}, max(3, runs)
        )
        status = allocate_many(batch).status
        rows.append(
            (
                name,
                len(batch),
                *(spread([len(batch) / wall for wall in walls(found)]) for found in readings.values()),
                f"{100 * np.mean(status <= AllocationStatus.BY_BACK_END):.4g} %",
            )
        )
    header = ("many in one call, one thread", "problems", "problems/s", "problems/s, warm start", "proven")
    return grid(header, rows)


def _perturbed(problems: list[AllocationProblem], count: int, by: float = _JITTER) -> AllocationBatch:
    """So many problems, those recorded in turn with each moment off by a random share."""
    off = 1.0 + by * np.random.default_rng(0).standard_normal((count, len(problems[0].Q)))
    turn = [problems[k % len(problems)] for k in range(count)]
    parts = {name: np.stack([getattr(p, name) for p in turn]) for name in ("B", "Q", "lb", "ub", "w", "a0", "P")}
    return AllocationBatch(**{**parts, "Q": parts["Q"] * off}, eps=np.array([p.eps for p in turn]))

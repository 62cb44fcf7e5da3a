"""Compiled work on many simulations, spread over threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

_LEAST = 16  # simulations a thread: for fewer, starting it takes longer


def in_chunks(work: Callable[[int, int], None], count: int, threads: int) -> None:
    """Call work(first, last) so that every one of count falls into one call; the calls run at the same time.

    Args:
        work: must release Python's lock to gain anything, and write to places of its own.
        count: how many there are.
        threads: to use at most.
    """
    chunks = min(threads, count // _LEAST)
    if chunks < 2:
        work(0, count)
        return
    bounds = [count * c // chunks for c in range(chunks + 1)]
    with ThreadPoolExecutor(chunks) as pool:
        list(pool.map(work, bounds[:-1], bounds[1:]))

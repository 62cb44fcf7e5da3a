"""Compiled work on many simulations, spread over threads."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise

_LEAST = 16  # simulations a thread: for fewer, waking it takes longer


def in_chunks(work: Callable[[int, int], None], count: int, threads: int) -> None:
    """Call work(first, last) so that every one of count falls into one call; the calls run at the same time.

    Args:
        work: must release Python's lock to gain anything, and write to places of its own.
        count: how many there are.
        threads: to use at most, the caller's among them.
    """
    chunks = min(threads, count // _LEAST)
    if chunks < 2:
        work(0, count)
        return
    bounds = [count * c // chunks for c in range(chunks + 1)]
    others = [_pool(chunks - 1, os.getpid()).submit(work, first, last) for first, last in pairwise(bounds[1:])]
    work(0, bounds[1])
    for other in others:
        other.result()


@lru_cache(maxsize=1)
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    """Threads that wait for work; a forked process has none of its parent's."""
    return ThreadPoolExecutor(threads)

"""Notices of work that is done several times over."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from mjhcmc.errors import MjhcmcWarning


@contextmanager
def each_notice_once(told: set[str]) -> Iterator[None]:
    """Give each notice when the block ends, at the caller of what holds the block, but not those told before.

    Args:
        told: what was said; it grows.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", MjhcmcWarning)
        yield
    for notice in caught:
        if str(notice.message) not in told:
            told.add(str(notice.message))
            warnings.warn(notice.message, stacklevel=4)

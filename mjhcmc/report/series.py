"""What the plots draw: columns of numbers, packed, thinned where a screen could not show them all."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_POINTS = 2000
"""Points in a line: a panel is a few hundred pixels wide, and each pair of points keeps a least and a largest value."""


def thinned(values: Array, most: int = MOST_POINTS) -> NDArray[np.intp] | None:
    """Which of many values to draw: the least and the largest of each stretch, and both ends; None: all.

    Stretches are equally long. Where one has a gap (NaN), a value of it is kept, so that the gap is seen.

    Args:
        values: (n,).
        most: about so many are kept; a gap may add one a stretch.
    """
    n = len(values)
    if n <= most:
        return None
    stretch = -(-n // max(1, most // 2))
    count = -(-n // stretch)
    padded = np.concatenate([values, np.full(count * stretch - n, values[-1])]).reshape(count, stretch)
    gap = np.isnan(padded)
    first = stretch * np.arange(count)
    kept = [
        first + np.argmin(np.where(gap, np.inf, padded), axis=1),
        first + np.argmax(np.where(gap, -np.inf, padded), axis=1),
        (first + np.argmax(gap, axis=1))[gap.any(axis=1)],
        np.array([0, n - 1]),
    ]
    return np.unique(np.minimum(np.concatenate(kept), n - 1))


def packed(values: NDArray[Any], kind: str) -> dict[str, str]:
    """An array as little-endian base64: ``{"f4": "..."}``; kind f4, f8, u2 or u4."""
    return {kind: base64.b64encode(np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()).decode("ascii")}


def unpacked(value: dict[str, str]) -> NDArray[Any]:
    """The inverse of `packed`."""
    ((kind, text),) = value.items()
    return np.frombuffer(base64.b64decode(text), dtype=f"<{kind}")


@dataclass
class Book:
    """The numbers of a page: clocks (times that columns share) and columns.

    A column's values are packed in single precision (relative error 6e-8), and where it is thinned, which values of its
    clock they are.

    Attributes:
        clocks: by name: ``t`` (s, packed) and ``end`` (s), to which the last value of steps is held.
        columns: by name: ``clock``, ``v`` (packed), ``k`` (packed; only where thinned).
        thinned: how many columns are.
    """

    clocks: dict[str, dict[str, Any]] = field(default_factory=dict)
    columns: dict[str, dict[str, Any]] = field(default_factory=dict)
    thinned: int = 0

    def clock(self, name: str, time: Array, end: float | None = None) -> str:
        """Note a clock; returns its name."""
        self.clocks[name] = {"t": packed(time, "f8"), "end": float(time[-1] if end is None else end)}
        return name

    def column(self, name: str, clock: str, values: Array, which: NDArray[np.intp] | None = None) -> str:
        """Note a column; returns its name, which is marked where another column has it already.

        Args:
            name: what it holds, for readers of the data.
            clock: name of its times.
            values: (n,) in what the screen shows; NaN where there is none.
            which: values to keep, where others must be kept with them; by default `thinned` tells.
        """
        while name in self.columns:  # a muscle may be called "reserve"
            name += "'"
        kept = thinned(values) if which is None else which
        made: dict[str, Any] = {"clock": clock, "v": packed(values if kept is None else values[kept], "f4")}
        if kept is not None:
            made["k"] = packed(kept, "u2" if len(values) < 65536 else "u4")
            self.thinned += 1
        self.columns[name] = made
        return name

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {"clocks": self.clocks, "columns": self.columns}


def runs(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """(n, 2) first and one past the last of each run of True."""
    padded = np.concatenate([[False], mask, [False]]).astype(np.int8)
    return np.flatnonzero(np.diff(padded)).reshape(-1, 2)


def spans(mask: NDArray[np.bool_], time: Array) -> list[list[float]]:
    """Start and end, s, of runs of windows; runs nearer than a thousandth of the whole are drawn as one.

    Args:
        mask: (N,) of windows.
        time: (N+1,) s, of nodes.
    """
    near = 1e-3 * float(time[-1] - time[0])
    found: list[list[float]] = []
    for a, b in runs(mask):
        if found and time[a] - found[-1][1] < near:
            found[-1][1] = float(time[b])
        else:
            found.append([float(time[a]), float(time[b])])
    return found

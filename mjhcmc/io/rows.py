"""Which rows of a file make the motion: the crop, the neighbours that lead the spline, and what is wrong with one."""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MjhcmcWarning, MotionError
from mjhcmc.io.motion_table import MotionTable
from mjhcmc.joints import TIME_TOLERANCE

Array = NDArray[np.float64]

_REPEAT_TOLERANCE = 1e-6  # file units: rows at one time that agree this well are one row
_CONTEXT_ROWS = 16  # the quintic spline forgets by .43 a row: 16 rows out, an end is felt by 1e-6


@dataclass(frozen=True, eq=False)
class JointRows:
    """What a file gives a motion, in the order of the model's joints.

    Attributes:
        time: (T,) s.
        qpos: (T, nq) rad or m.
        span: (start, end) s.
        notices: what the user may want to know, a line each.
        doubt: what makes the file's unit doubtful, if anything.
        hint: what may be wrong where a joint leaves its range, if known.
    """

    time: Array
    qpos: Array
    span: tuple[float, float]
    notices: tuple[str, ...]
    doubt: str | None = None
    hint: str | None = None


def crop(path: Path, time: Array, start: float | None, end: float | None) -> NDArray[np.intp]:
    """Indices of the rows from start to end, and of the next rows out where these fall between rows."""
    everything = np.arange(len(time))
    finite = time[np.isfinite(time)]
    if (start is None and end is None) or not len(finite):
        return everything
    low, high = finite.min(), finite.max()
    for what, value in (("start", start), ("end", end)):
        if value is not None and not low - TIME_TOLERANCE <= value <= high + TIME_TOLERANCE:
            raise MotionError(
                f"{path}: {what} {value:.6g} s lies outside the file's times {low:.6g} .. {high:.6g} s: "
                f"choose it within"
            )
    begin = low if start is None else start
    finish = high if end is None else end
    if begin >= finish:
        raise MotionError(f"{path}: start {begin:.6g} s is not before end {finish:.6g} s: choose a later end")
    inside = np.flatnonzero((time >= begin - TIME_TOLERANCE) & (time <= finish + TIME_TOLERANCE))
    if not len(inside):
        raise MotionError(f"{path}: 0 rows from {begin:.6g} to {finish:.6g} s: a motion needs at least 4")
    first = 0 if start is None else max(inside[0] - (time[inside[0]] > begin + TIME_TOLERANCE), 0)
    last = (
        len(time) - 1 if end is None else min(inside[-1] + (time[inside[-1]] < finish - TIME_TOLERANCE), len(time) - 1)
    )
    return everything[first : last + 1]


def check_finite(table: MotionTable, used: list[int], kept: NDArray[np.intp]) -> None:
    """Raise MotionError where a kept row has no finite time, or no finite value in a used column."""
    block = np.column_stack([table.time[kept], table.values[kept][:, used]])
    bad = np.argwhere(~np.isfinite(block))
    if len(bad):
        row, column = bad[0]
        name = "time" if column == 0 else table.columns[used[column - 1]]
        raise MotionError(
            f"{table.path}, line {table.line_numbers[kept[row]]}, column {name!r}: {block[row, column]}: "
            "fill the gap, or crop it away with start and end"
        )


def rows_of_motion(
    path: Path, time: Array, lines: NDArray[np.int64], values: Array, kept: NDArray[np.intp], reach: float
) -> NDArray[np.intp]:
    """The kept rows that differ in time, with the neighbours outside that lead the spline and the filter.

    Args:
        path: the file, for messages.
        time: (T,) s.
        lines: (T,) line of each row.
        values: (T, k) what a row holds; not finite where it cannot be used.
        kept: rows of the crop.
        reach: s of neighbours that the filter needs.

    Raises:
        MotionError: times do not increase, or fewer than 4 rows are left.
    """
    rows = kept[_distinct_times(path, time[kept], lines[kept], values[kept])]
    if len(rows) < 4:
        raise MotionError(
            f"{path}: {len(rows)} row{'s' * (len(rows) != 1)} from {time[kept[0]]:.6g} to {time[kept[-1]]:.6g} s: "
            "a motion needs at least 4"
        )
    return _with_context(time, values, kept, rows, reach)


def _distinct_times(path: Path, time: Array, lines: NDArray[np.int64], values: Array) -> NDArray[np.bool_]:
    """True for the rows to use: not those that repeat the row before. Other times must increase."""
    steps = np.diff(time)
    near = np.abs(steps) <= TIME_TOLERANCE
    change = np.abs(np.diff(values, axis=0)).max(axis=1, initial=0.0)
    repeated = near & (change <= _REPEAT_TOLERANCE)
    wrong = np.flatnonzero((near | (steps < 0)) & ~repeated)
    if len(wrong):
        i = wrong[0]
        why = f"the same time with other values (by {change[i]:.3g})" if near[i] else "times must increase"
        raise MotionError(
            f"{path}, line {lines[i + 1]}: time {time[i + 1]:.12g} s follows {time[i]:.12g} s: {why}: "
            "remove one of the rows, or crop with start and end"
        )
    dropped = np.flatnonzero(repeated) + 1
    if len(dropped):
        where = ", ".join(f"line {lines[i]} ({time[i]:.6g} s)" for i in dropped[:5])
        warnings.warn(
            f"{path}: {len(dropped)} row{'s' * (len(dropped) > 1)} dropped that "
            f"repeat{'s' * (len(dropped) == 1)} "
            f"the time and values of the row before: {where}{', ...' if len(dropped) > 5 else ''}",
            MjhcmcWarning,
            stacklevel=6,
        )
    return np.concatenate([[True], ~repeated])


def _with_context(
    time: Array, values: Array, kept: NDArray[np.intp], rows: NDArray[np.intp], reach: float
) -> NDArray[np.intp]:
    """The rows and their neighbours outside the crop, where sound: they lead the spline and the filter.

    Neighbours end at the first that is not finite, not in order or behind a gap; they are 16, or as many as
    cover reach (s).
    """
    sound = np.isfinite(time) & np.isfinite(values).all(axis=1)
    gap = 10 * np.median(np.diff(time[rows]))

    def neighbours(candidates: NDArray[np.intp], origin: float, sign: float) -> NDArray[np.intp]:
        away = sign * (time[candidates] - origin)
        steps = np.diff(away, prepend=0.0)
        wanted = (np.arange(len(candidates)) < _CONTEXT_ROWS) | (away <= reach)
        good = sound[candidates] & (steps > TIME_TOLERANCE) & (steps < gap) & wanted
        return candidates[: len(good) if good.all() else int(np.argmin(good))]

    before = neighbours(np.arange(kept[0] - 1, -1, -1), float(time[rows[0]]), -1.0)
    after = neighbours(np.arange(kept[-1] + 1, len(time)), float(time[rows[-1]]), 1.0)
    return np.concatenate([before[::-1], rows, after])


def span(
    time: Array, kept: NDArray[np.intp], rows: NDArray[np.intp], start: float | None, end: float | None
) -> tuple[float, float]:
    """Start and end as asked, to the digit; a tolerance outside the rows, the outermost row."""
    first, last = float(time[rows[0]]), float(time[rows[-1]])
    begin = float(time[kept[0]]) if start is None else float(start)
    finish = float(time[kept[-1]]) if end is None else float(end)
    begin = first if first - TIME_TOLERANCE <= begin < first else begin
    finish = last if last < finish <= last + TIME_TOLERANCE else finish
    return begin, finish

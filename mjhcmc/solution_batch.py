"""What many simulations, solved together, gave."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import DivergedError, MjhcmcError, SettingsError, SimulationError
from mjhcmc.solution import Solution

_SHOWN = 3

T = TypeVar("T")


class SimulationStatus(IntEnum):
    """How one simulation of a batch ended; what each window was like is its solution's own status."""

    SOLVED = 0
    """All of its windows are there."""
    REFUSED = 1
    """Its model, motion or start was not fit to begin with."""
    FAILED = 2
    """It was given up on the way."""
    DIVERGED = 3
    """It ran away, also with finer steps."""

    @property
    def message(self) -> str:
        """In words, with what to do."""
        return _MESSAGES[self]


_MESSAGES = {
    SimulationStatus.SOLVED: "all windows are solved",
    SimulationStatus.REFUSED: "its input is not fit: its error says what to change",
    SimulationStatus.FAILED: "it was given up on the way: its error says where and why",
    SimulationStatus.DIVERGED: "it ran away: use a smaller physics_dt, or filter its motion",
}


@dataclass(frozen=True, eq=False)
class SolutionBatch:
    """The solutions of a batch, in the order of its simulations.

    ``batch[i]`` is the `Solution` of simulation i, or raises the error that it failed with, and so does iterating;
    ``solved`` holds those that there are.

    Attributes:
        solved: by simulation.
        errors: by simulation, why it failed; a `SimulationError` has the windows before as its ``solution``.
    """

    solved: Mapping[int, Solution]
    errors: Mapping[int, MjhcmcError]

    def __len__(self) -> int:
        """Number of simulations."""
        return len(self.solved) + len(self.errors)

    def __repr__(self) -> str:
        """One line."""
        return f"SolutionBatch({len(self)} simulations, {len(self.solved)} solved)"

    def __getitem__(self, i: int) -> Solution:
        """The solution of simulation i; negative from the end.

        Raises:
            MjhcmcError: the simulation failed.
            IndexError: there is none of that number.
        """
        i = operator.index(i)
        at = i + len(self) if i < 0 else i
        if not 0 <= at < len(self):
            raise IndexError(f"simulation {i} of {len(self)}")
        if at in self.errors:
            raise self.errors[at]
        return self.solved[at]

    def __iter__(self) -> Iterator[Solution]:
        """All solutions; raises the error of a simulation that failed."""
        return (self[i] for i in range(len(self)))

    @property
    def status(self) -> NDArray[np.int64]:
        """(B,) `SimulationStatus` of each simulation."""
        return np.array([_status_of(self.errors.get(i)) for i in range(len(self))], dtype=np.int64)

    @property
    def failures(self) -> str:
        """One line that names those that failed and why; empty where none did."""
        if not self.errors:
            return ""
        named = [f"simulation {i}: {error}" for i, error in sorted(self.errors.items())[:_SHOWN]]
        more = f"; and {len(self.errors) - _SHOWN} more" if len(self.errors) > _SHOWN else ""
        return f"{len(self.errors)} of {len(self)} simulations failed: {'; '.join(named)}{more}"


def _status_of(error: MjhcmcError | None) -> SimulationStatus:
    if error is None:
        return SimulationStatus.SOLVED
    if isinstance(error, DivergedError):
        return SimulationStatus.DIVERGED
    return SimulationStatus.FAILED if isinstance(error, SimulationError) else SimulationStatus.REFUSED


def one_each(
    name: str, given: object, kind: type[T], count: int | None, *, or_none: bool = False
) -> tuple[list[T], int | None]:
    """What is given once for all simulations, or once each, as a list; and the number of simulations, if it tells.

    Args:
        name: of the argument, for messages.
        given: one, or a sequence.
        kind: what each must be.
        count: the number of simulations, where it is known.
        or_none: whether a sequence may hold None for simulations that go without.

    Raises:
        SettingsError: neither one of that kind nor a sequence of them, or another number than elsewhere.
    """
    if isinstance(given, kind):
        return [given], count
    try:
        items: list[T] = list(given)  # type: ignore[call-overload]
    except TypeError:
        items = [given]  # type: ignore[list-item]
    for i, item in enumerate(items):
        if not isinstance(item, kind) and not (or_none and item is None):
            what = f"{'an' if kind.__name__[0] in 'AEIOU' else 'a'} {kind.__name__}{' or None' if or_none else ''}"
            raise SettingsError(f"{name}[{i}] must be {what}; got {type(item).__name__}")
    return items, agreed(name, len(items), count)


def agreed(name: str, number: int, count: int | None) -> int:
    """The number of simulations, where something has so many rows.

    Raises:
        SettingsError: there is nothing, or another number than elsewhere.
    """
    if number == 0:
        raise SettingsError(f"{name} is empty: a batch needs at least one simulation")
    if count is not None and number != count:
        raise SettingsError(
            f"{name} has {number} entries, the batch has {count} simulations: give one for all, or one each"
        )
    return number

"""Activity: muscles' activation or excitation over time from elsewhere (another program, EMG), to compare with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError

_TINY = 0.02  # a signal that rises less than this above its floor is compared by size only


def agreement(
    time: NDArray[np.float64], activation: NDArray[np.float64], other: Activity, floor: float = 0.0, start: float = 0.0
) -> dict[str, tuple[float, float]]:
    """How alike two records of the same muscles are, at the other's times.

    Args:
        time: (N,) s.
        activation: (N, n_muscle), in the other's order.
        other: what it is compared with.
        floor: least activation of the other.
        start: s, what comes before is left out.

    Returns:
        By muscle: Pearson's r (NaN where either hardly rises above the floor: a correlation of noise) and the root mean
        square difference.
    """
    assert other.activation is not None
    kept = (other.time >= start) & (other.time <= time[-1])
    result = {}
    for i, name in enumerate(other.muscle_names):
        theirs, ours = other.activation[kept, i], np.interp(other.time[kept], time, activation[:, i])
        idle = min(theirs.max() - floor, ours.max() - min(ours.min(), floor)) < _TINY
        r = np.nan if idle else float(np.corrcoef(theirs, ours)[0, 1])
        result[name] = r, float(np.sqrt(np.mean((theirs - ours) ** 2)))
    return result


@dataclass(frozen=True, eq=False)
class Activity:
    """What muscles did, as somebody else found it.

    Attributes:
        time: (T,) s, increasing, on the clock of what it is compared with.
        muscle_names: (n,) in the model's names; not all of the model's need be there.
        activation: (T, n), None where it is not known.
        excitation: (T, n), None where it is not known. One of the two is there.

    Raises:
        SettingsError: shapes that do not fit, values that are not finite, times that do not increase, a name that
            stands twice, or neither activation nor excitation.
    """

    time: NDArray[np.float64]
    muscle_names: tuple[str, ...]
    activation: NDArray[np.float64] | None = None
    excitation: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        """Check that the arrays fit together, and make private copies of them, read-only."""
        names = tuple(self.muscle_names)
        object.__setattr__(self, "muscle_names", names)
        twice = [name for name in names if names.count(name) > 1]
        if twice or not names:
            found = f"muscle {twice[0]!r} stands twice" if twice else "there is no muscle"
            raise SettingsError(f"activity: {found}: name each muscle once")
        if self.activation is None and self.excitation is None:
            raise SettingsError("activity: neither activation nor excitation is given: give one of them")
        n_time = np.shape(self.time)
        for name in ("time", "activation", "excitation"):
            given = getattr(self, name)
            if given is None:
                continue
            try:
                values = np.array(given, dtype=np.float64)
            except (TypeError, ValueError):
                raise SettingsError(f"activity: {name} must hold numbers; got {type(given).__name__}") from None
            wanted = (values.size,) if name == "time" else (*n_time, len(names))
            if values.shape != wanted or values.size < 1:
                raise SettingsError(
                    f"activity: {name} has shape {values.shape} with {len(names)} muscles and time {n_time}: "
                    f"give {'(T,)' if name == 'time' else '(T, n)'}"
                )
            bad = np.argwhere(~np.isfinite(values))
            if bad.size:
                raise SettingsError(f"activity: {name}{bad[0].tolist()} is {values[tuple(bad[0])]}: give finite values")
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        late = np.flatnonzero(np.diff(self.time) <= 0)
        if late.size:
            raise SettingsError(
                f"activity: time {self.time[late[0] + 1]:g} s follows {self.time[late[0]]:g} s: give increasing times"
            )

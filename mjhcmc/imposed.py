"""Excitation that muscles receive whatever is asked of them: reflexes, tone, spill-over, electrical stimulation.

What is imposed is a floor under the excitation that a method finds: it works with it, and against it with the muscles
that it has left. Methods know the whole floor beforehand, as a person knows their own spasticity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import MotionError, SettingsError
from mjhcmc.joints import TIME_TOLERANCE

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel
    from mjhcmc.motion import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Imposed:
    """Excitation over time below which muscles do not go; linear between its times.

    Attributes:
        time: (m,) s, rising, on the motion's clock; at least two.
        excitation: (m, n_muscle) in 0..1, muscles in the model's order.

    Raises:
        SettingsError: times that do not rise, values outside 0..1, or shapes that do not agree.
    """

    time: ArrayLike
    excitation: ArrayLike

    def __post_init__(self) -> None:
        """Check the numbers."""
        try:
            time, u = (np.array(given, dtype=np.float64) for given in (self.time, self.excitation))
        except (TypeError, ValueError):
            raise SettingsError("imposed excitation: time and excitation must be numbers") from None
        if time.ndim != 1 or len(time) < 2 or not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
            raise SettingsError("imposed excitation: time must be at least two finite, rising values in s")
        if u.ndim != 2 or len(u) != len(time):
            raise SettingsError(
                f"imposed excitation has shape {u.shape}: give ({len(time)}, n_muscle), a row for each time"
            )
        bad = np.argwhere(~((u >= 0) & (u <= 1)))
        if len(bad):
            row, column = bad[0]
            raise SettingsError(
                f"imposed excitation of muscle {column} is {u[row, column]:.4g} at {time[row]:.4g} s: give 0 to 1"
            )
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "excitation", u)

    def check_fits(self, motion: Motion, model: MuscleModel) -> None:
        """See that there is a value for each muscle, all along a motion.

        Raises:
            SettingsError: another number of muscles.
            MotionError: the motion begins before or ends after it.
        """
        time, u = np.asarray(self.time), np.asarray(self.excitation)
        if u.shape[1] != model.n_muscle:
            raise SettingsError(
                f"imposed excitation is of {u.shape[1]} muscles, model {model.name!r} has {model.n_muscle} "
                f"({', '.join(model.muscle_names)}): give a column for each"
            )
        if time[0] > motion.start + TIME_TOLERANCE or time[-1] < motion.end - TIME_TOLERANCE:
            raise MotionError(
                f"imposed excitation covers {time[0]:.6g} .. {time[-1]:.6g} s, the motion {motion.name!r} "
                f"{motion.start:.6g} .. {motion.end:.6g} s: give it over the whole motion"
            )

    def over(self, nodes: Array) -> Array:
        """(N, n_muscle) means over the windows between nodes (N + 1,) s, of the straight lines between its times."""
        time, u = np.asarray(self.time), np.asarray(self.excitation)
        area = np.concatenate([np.zeros((1, u.shape[1])), np.cumsum((u[1:] + u[:-1]) / 2 * np.diff(time)[:, None], 0)])
        at = np.clip(nodes, time[0], time[-1])
        k = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
        into = (at - time[k])[:, None]
        slope = (u[k + 1] - u[k]) / (time[k + 1] - time[k])[:, None]
        total = area[k] + into * (u[k] + slope * into / 2)
        return np.asarray(np.clip(np.diff(total, axis=0) / np.diff(nodes)[:, None], 0.0, 1.0))

"""EMG-informed allocation: activation is to be near what was measured in the muscles that were measured.

To any cost (see `sharing`) is added, for each measured muscle i and with the weight w_c of its channel c,

    k_i w_c (a_i - e_i(t))^2          (for `cubic` 3/2 of it, for `volume` with k_i V_i, like smoothness)

with the same k_i that the muscle's own activation costs: weight 1 minds a miss of the EMG as much as activation. Left
to itself the muscle would go to w/(1 + w) of what was measured (under `effort`); joint moments come before both. The
idea is that of hybrid EMG-informed modelling: Lloyd & Besier 2003, doi 10.1016/S0021-9290(03)00010-1; Sartori, Farina
& Lloyd 2014, doi 10.1016/j.jbiomech.2014.10.009; Pizzolato et al. 2015, doi 10.1016/j.jbiomech.2015.09.021.

An envelope is of the *excitation*. The target is of activation: the envelope goes through the muscle's own activation
dynamics, delayed if asked by what of the electromechanical delay is not activation (Cavanagh & Komi 1979, doi
10.1007/BF00431022, find 30 to 100 ms in all), as u = envelope(t - delay).
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from numpy.typing import NDArray

from mjhcmc.activation import advance_one
from mjhcmc.checks import is_number
from mjhcmc.emg import Emg
from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError
from mjhcmc.io.columns import listed
from mjhcmc.joints import TIME_TOLERANCE

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel
    from mjhcmc.motion import Motion

Array = NDArray[np.float64]

WEIGHT = 10.0
"""Default weight of a channel."""

_MOST_WEIGHT = 1e5
_STEP = 1e-3  # s, of the targets' grid
_NEAR = 1e-3  # of a step: rounding of times
_MOST_DELAY = 0.5  # s
_FULL = 1.25  # what no envelope over its maximum contraction exceeds but by a slip
_TINY = 0.02  # envelopes that never rise to this are hardly those of working muscles


@dataclass(frozen=True, eq=False)
class EmgTargets:
    """What activation is to follow; give it to a method as ``emg=``.

    Attributes:
        emg: envelopes over their maximum contraction, on the motion's clock. NaN: nothing to follow there.
        mapping: muscle to channel (one channel may serve several muscles), or a file of it, see
            `io.emg_file.channel_map`; None: channels that have a muscle's name measure it.
        weight: w_c, 0 or positive: one for all channels, or by channel (those not named are not followed).
        delay: s, by which excitation comes after EMG, beside activation dynamics.

    Raises:
        SettingsError: raw signals; a weight or delay that is no number or outside its range; channels not there;
            envelopes far above 1.
    """

    emg: Emg
    mapping: Mapping[str, str] | str | os.PathLike[str] | None = None
    weight: Mapping[str, float] | float = WEIGHT
    delay: float = 0.0
    _tables: dict[bytes, Table] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        """Check what can be checked without a model."""
        if not isinstance(self.emg, Emg):
            raise SettingsError(f"EMG targets take an Emg; got {type(self.emg).__name__}: use Emg.from_file")
        if self.emg.raw:
            raise SettingsError(
                f"{self.emg.name} is raw: take its envelope and divide it by that of a maximum contraction (mvc) first"
            )
        if not (is_number(self.delay) and 0 <= self.delay <= _MOST_DELAY):
            raise SettingsError(f"delay must lie within 0..{_MOST_DELAY:g} s; got {self.delay!r}")
        for name, value in self.weights.items():
            if not (is_number(value) and 0 <= value <= _MOST_WEIGHT):
                raise SettingsError(f"EMG weight of {name} must lie within 0..{_MOST_WEIGHT:g}; got {value!r}")
        peak = np.nanmax(self.emg.signal, axis=0)
        i = int(np.argmax(peak))
        if peak[i] > _FULL:
            raise SettingsError(
                f"{self.emg.name}: the envelope of {self.emg.channels[i]!r} rises to {peak[i]:.3g}, full excitation is "
                "1: divide by the envelope of a maximum contraction (mvc)"
            )

    @cached_property
    def weights(self) -> dict[str, float]:
        """By channel."""
        if not isinstance(self.weight, Mapping):
            return dict.fromkeys(self.emg.channels, self.weight)
        unknown = [name for name in self.weight if name not in self.emg.channels]
        if unknown:
            raise SettingsError(
                f"EMG weight: {self.emg.name} has no channel {unknown[0]!r}: its channels are "
                f"{listed(self.emg.channels)}"
            )
        return dict(self.weight)

    def check_covers(self, motion: Motion) -> None:
        """See that there is something to follow along a motion; a notice where it is a part only.

        Raises:
            MotionError: none of the EMG, delayed, lies within the motion.
        """
        time = self.emg.time + self.delay
        if time[-1] <= motion.start or time[0] >= motion.end:
            raise MotionError(
                f"{self.emg.name} covers {time[0]:.3f} .. {time[-1]:.3f} s (delayed by {self.delay:g} s), the motion "
                f"{motion.name!r} {motion.start:.3f} .. {motion.end:.3f} s: bring it onto the motion's clock (shifted)"
            )
        if (
            time[0] > motion.start + self.delay + TIME_TOLERANCE
            or time[-1] < motion.end - 1 / self.emg.rate - TIME_TOLERANCE
        ):
            warnings.warn(
                f"{self.emg.name} covers {time[0]:.3f} .. {time[-1]:.3f} s of the motion's {motion.start:.3f} .. "
                f"{motion.end:.3f} s: elsewhere activation follows nothing",
                MjhcmcWarning,
                stacklevel=4,
            )

    def tracking(self, model: MuscleModel) -> Tracking:
        """What `sharing` needs, for a model.

        Raises:
            SettingsError: muscles or channels of the map that do not exist, or nothing mapped.
            MotionError: the map's file.
        """
        from mjhcmc.io.emg_file import channel_map

        pairs = channel_map(self.mapping, model.muscle_names, self.emg.channels)
        by_channel = self.weights
        weight = np.array([by_channel.get(pairs.get(name, ""), 0.0) for name in model.muscle_names], dtype=np.float64)
        which = np.flatnonzero(weight > 0)
        limits = np.ascontiguousarray(model.excitation_range[which])
        prm = np.ascontiguousarray(model.activation_parameters[which])
        key = b"".join(part.tobytes() for part in (which, limits, prm))
        if key not in self._tables:
            channels = [pairs[model.muscle_names[i]] for i in which]
            self._notice(channels)
            self._tables[key] = self._table(channels, which, limits, prm)
        options = {
            "name": self.emg.name,
            "scale": self.emg.scale,
            "channels": pairs,
            "weight": {name: float(value) for name, value in by_channel.items() if name in pairs.values()},
            "delay": float(self.delay),
        }
        return Tracking((self._tables[key],), weight, options)

    def _notice(self, channels: Sequence[str]) -> None:
        used = list(dict.fromkeys(channels))
        if used and self.emg.scale not in ("none", "mvc"):
            warnings.warn(
                f"{self.emg.name} is divided by its own {self.emg.scale}, which hides how hard muscles worked: targets "
                "rise to 1 in every channel; divide by maximum contractions (mvc) for targets that mean a size",
                MjhcmcWarning,
                stacklevel=7,
            )
        if used and max(np.nanmax(self.emg.channel(name)) for name in used) < _TINY:
            warnings.warn(
                f"{self.emg.name}: no envelope rises to {_TINY:g} of a maximum contraction: are they in volts still? "
                "divide by the envelopes of a maximum contraction (mvc)",
                MjhcmcWarning,
                stacklevel=7,
            )

    def _table(self, channels: Sequence[str], which: NDArray[np.intp], limits: Array, prm: Array) -> Table:
        time = self.emg.time
        count = max(1, int(np.ceil(self.emg.duration / _STEP)))
        step = self.emg.duration / count
        grid = time[0] + step * np.arange(count + 1)
        target = np.empty((count + 1, len(which)))
        for i, name in enumerate(channels):
            signal = self.emg.channel(name)
            there = np.isfinite(signal)
            bridged = np.interp(grid[:-1] + step / 2, time[there], signal[there])
            u = np.clip(bridged, limits[i, 0], limits[i, 1])
            first = min(max(float(signal[there][0]), limits[i, 0]), limits[i, 1])
            _follow(u, first, prm[i, 0], prm[i, 1], prm[i, 2], step, target[:, i])
            target[np.isnan(np.interp(grid, time, signal)), i] = np.nan
        return Table(float(time[0] + self.delay), step, target, which)


@numba.njit(cache=True, error_model="numpy")
def _follow(u, a, act, deact, smooth, step, out):  # type: ignore[no-untyped-def]
    """Fill activation (T,) at the nodes under excitation (T-1,) between them, from a."""
    out[0] = a
    for k in range(u.size):
        a = advance_one(a, u[k], act, deact, smooth, step, 1)
        out[k + 1] = a


@dataclass(frozen=True, eq=False)
class Table:
    """Targets on an even grid.

    Attributes:
        start: s.
        step: s.
        target: (T, m) activation of the followed muscles; NaN where there is none.
        which: (m,) those muscles.
    """

    start: float
    step: float
    target: Array = field(repr=False)
    which: NDArray[np.intp]

    def at(self, time: float) -> Array:
        """(m,) targets at a time, linear between the grid's; NaN outside it and beside gaps."""
        x, last = (time - self.start) / self.step, len(self.target) - 1
        if not -_NEAR <= x <= last + _NEAR:
            return np.full(len(self.which), np.nan)
        k = min(max(int(x), 0), last - 1)
        share = min(max(x - k, 0.0), 1.0)
        if share < _NEAR or share > 1 - _NEAR:  # on a node its neighbour does not matter
            return np.asarray(self.target[k + int(share > 0.5)])
        return np.asarray((1 - share) * self.target[k] + share * self.target[k + 1])


@dataclass(frozen=True, eq=False)
class Tracking:
    """Targets of one simulation, or of several that go together.

    Attributes:
        tables: one, or one a simulation.
        weight: (n_muscle,), or (b, n_muscle); 0 for muscles that are not followed.
        options: as plain values for the record.
    """

    tables: tuple[Table, ...]
    weight: Array
    options: dict[str, Any] = field(repr=False)

    def of(self, which: int | NDArray[np.intp] | slice) -> Tracking:
        """That of one of several simulations, or of some."""
        if isinstance(which, slice):
            tables = self.tables[which]
        else:
            tables = tuple(self.tables[int(i)] for i in np.atleast_1d(which))
        return Tracking(tables, self.weight[which], self.options)

    def at(self, time: float | Array) -> tuple[Array, Array]:
        """Targets and weights, both (n_muscle,), or (b, n_muscle) at times (b,) s; both 0 where there is no target."""
        target, weight = np.zeros_like(self.weight), np.zeros_like(self.weight)
        rows = (
            [(target, weight, self.weight)] if self.weight.ndim == 1 else zip(target, weight, self.weight, strict=True)
        )
        for table, when, (goal, w, own) in zip(self.tables, np.atleast_1d(time), rows, strict=True):
            found = table.at(float(when))
            there = np.isfinite(found)
            goal[table.which[there]] = found[there]
            w[table.which[there]] = own[table.which[there]]
        return target, weight


def together(trackings: Sequence[Tracking]) -> Tracking:
    """Those of several simulations as one with a row a simulation."""
    tables = tuple(tracking.tables[0] for tracking in trackings)
    return Tracking(tables, np.stack([tracking.weight for tracking in trackings]), trackings[0].options)

"""The windows of a motion from one of its nodes on, from whatever state the model is in there."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mjhcmc.methods.windows import Windows
from mjhcmc.motion import Reference
from mjhcmc.plant import MujocoPlant, State

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Remaining(Windows):
    """Windows from a node on, judged as those of the whole motion are.

    Attributes:
        whole: the windows of the whole motion.
        first: the node.
    """

    whole: Windows | None = None
    first: int = 0

    @property
    def _all(self) -> Windows:
        assert self.whole is not None  # `remaining` is the only one who makes them
        return self.whole

    @cached_property
    def plant(self) -> MujocoPlant:
        """That of the whole: to build one takes longer than a window."""
        return self._all.plant

    @cached_property
    def target(self) -> Reference:
        """See `Windows`; velocities by differences know what was before the node."""
        return _from(self._all.target, self.first)

    @cached_property
    def rms_qacc(self) -> Array:
        """(nv,) rad/s^2 or m/s^2, of the whole motion: its last moments may be still."""
        return self._all.rms_qacc

    @cached_property
    def tangents(self) -> Array | None:
        """See `Windows`."""
        tangents = self._all.tangents
        return None if tangents is None else tangents[self.first :]


def remaining(whole: Windows, first: int, start: State) -> Remaining:
    """The windows from a node on.

    Args:
        whole: those of the whole motion.
        first: the node; at least one window follows.
        start: the state there. An activation that is NaN is to be solved for.
    """
    values = {item.name: getattr(whole, item.name) for item in fields(Windows)}
    values |= {"reference": _from(whole.reference, first), "start": start}
    if whole.imposed is not None:
        values["imposed"] = whole.imposed[first:]
    return Remaining(**values, whole=whole, first=first)


def _from(reference: Reference, first: int) -> Reference:
    parts = {item.name: getattr(reference, item.name)[first:] for item in fields(Reference)}
    return replace(reference, **parts)

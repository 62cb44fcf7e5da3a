"""Net joint moments that a user brings along, to be shared among the muscles in place of those of inverse dynamics.

They come from a fuller account of the motion than this package's: measured ground reactions, a moving pelvis. What they
differ by from the inverse dynamics of the model alone must act on it from outside, or the model could not move like
that: this difference, the implied load

    E(t) = M q''_d + bias - passive - limits and contacts - other actuators - Q(t)     along the desired motion,

is applied to the plant as generalized forces, so that muscles which give Q(t) make it follow the motion.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc import dynamics
from mjhcmc.errors import MjhcmcWarning, MotionError
from mjhcmc.joints import TIME_TOLERANCE
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import MujocoPlant, State
from mjhcmc.surroundings import External

Array = NDArray[np.float64]

_OVERSHOOT = 0.05  # of a column's range


@dataclass(frozen=True, eq=False)
class JointMoments:
    """Net joint moments on a time grid that may be uneven; a cubic spline holds between.

    Attributes:
        time: (T,) s, strictly increasing, T >= 4, on the motion's clock.
        moment: (T, nv) N m (slides: N), in the order of the model's joints.
        name: for messages.

    Raises:
        MotionError: shapes, number of rows, order of times, a value that is NaN or infinite.
    """

    time: Array
    moment: Array = field(repr=False)
    name: str = "joint moments"

    def __post_init__(self) -> None:
        """Convert, freeze and check."""
        for key in ("time", "moment"):
            values = np.array(getattr(self, key), dtype=np.float64)
            values.setflags(write=False)
            object.__setattr__(self, key, values)
        if self.time.ndim != 1 or self.moment.ndim != 2 or len(self.moment) != len(self.time) or len(self.time) < 4:
            raise MotionError(
                f"{self.name}: time has shape {self.time.shape} and moment {self.moment.shape}: give time (T,) and "
                "moment (T, nv) with at least 4 rows"
            )
        bad = np.argwhere(~np.isfinite(np.column_stack([self.time, self.moment])))
        if len(bad):
            raise MotionError(f"{self.name}: row {bad[0][0]} (from 0) holds a value that is not finite: fill the gap")
        back = np.flatnonzero(np.diff(self.time) <= 0)
        if len(back):
            row = back[0] + 1
            raise MotionError(
                f"{self.name}: row {row} (from 0): time {self.time[row]:.12g} s follows {self.time[row - 1]:.12g} s: "
                "times must increase"
            )

    @classmethod
    def from_file(
        cls,
        path: str | os.PathLike[str],
        model: MuscleModel,
        column_map: Mapping[str, str] | str | os.PathLike[str] | None = None,
    ) -> JointMoments:
        """Read joint moments from a .sto, .mot or .csv table, such as OpenSim's inverse dynamics writes.

        A joint's column is looked for under the name that column_map gives, the joint's own name, and the name in the
        model's own map; each plain, with OpenSim's ending (``knee_angle_r_moment``, a slide's ``_force``), or as
        this package writes it (``moment/knee``). Values are N m (slides: N).

        Args:
            path: the file.
            model: the model whose joints they belong to.
            column_map: joint to column, a leading minus on the column flips its sign; or a file of such a map.

        Raises:
            MotionError: the file, the map or a row does not allow it; one line says what and what to do.
        """
        from mjhcmc.io.moment_file import read_moments

        return read_moments(Path(path), model, column_map)

    def check_covers(self, motion: Motion, model: MuscleModel) -> None:
        """See that there is a moment for each joint at all times of a motion.

        Raises:
            MotionError: another number of joints, or times outside.
        """
        if self.moment.shape[1] != model.nv:
            raise MotionError(
                f"{self.name} has {self.moment.shape[1]} columns, model {model.name!r} has {model.nv} joints "
                f"({', '.join(model.dof_names)}): give one column a joint"
            )
        if notice := self._overshoot_notice():
            warnings.warn(notice, MjhcmcWarning, stacklevel=4)
        if self.time[0] > motion.start + TIME_TOLERANCE or self.time[-1] < motion.end - TIME_TOLERANCE:
            raise MotionError(
                f"{self.name} covers {self.time[0]:.6g} .. {self.time[-1]:.6g} s, the motion {motion.name!r} "
                f"{motion.start:.6g} .. {motion.end:.6g} s: give moments for all of it, or crop it with start and end"
            )

    def sample(self, times: Array) -> Array:
        """The moments (n, nv) N m at times (n,) s; outside their own times, those at the nearest end."""
        held: Array = self._spline(np.clip(times, self.time[0], self.time[-1]))
        return held

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self.time, self.moment, k=3)

    def _overshoot_notice(self) -> str | None:
        """One line where the spline swings well beyond the rows, as at steps and in coarse tables."""
        between = self._spline(np.linspace(self.time[0], self.time[-1], 8 * len(self.time)))
        low, high = self.moment.min(axis=0), self.moment.max(axis=0)
        beyond = np.maximum(low - between.min(axis=0), between.max(axis=0) - high)
        share = beyond / np.maximum(high - low, np.abs(self.moment).max() * 1e-3 + np.finfo(float).tiny)
        j = int(np.argmax(share))
        if share[j] <= _OVERSHOOT:
            return None
        return (
            f"{self.name}: between its rows the spline of column {j + 1} exceeds them by {beyond[j]:.3g}: the rows are "
            "coarse or have steps; give more rows, or smooth them"
        )

    def implied_load(self, plant: MujocoPlant, motion: Motion) -> External:
        """E(t) of the module's docstring, as a cubic spline on the grid of the plant's physics steps.

        Args:
            plant: without external load; its state is changed.
            motion: the desired motion.
        """
        from scipy.interpolate import make_interp_spline

        count = max(4, int(np.ceil(motion.duration / plant.physics_dt)) + 1)
        reference = motion.sample(np.linspace(motion.start, motion.end, count))
        own = np.clip(reference.time, self.time[0], self.time[-1])
        Q = make_interp_spline(self.time, self.moment, k=3)(own)
        zero, rest = np.zeros(plant.model.nv), np.zeros(plant.model.n_muscle)
        load = np.empty_like(Q)
        for k, (time, qpos, qvel, qacc) in enumerate(
            zip(reference.time, reference.qpos, reference.qvel, reference.qacc, strict=True)
        ):
            plant.set_state(State(float(time), qpos, qvel, rest, zero))
            plant.forward()
            load[k] = dynamics.net_moment_for(plant, qacc) - Q[k]
        spline: Any = make_interp_spline(reference.time, load, k=3)

        def external(times: Array) -> Array:
            held: Array = spline(np.clip(times, motion.start, motion.end))
            return held

        return external

"""Frames: a solution as pictures, at each instant where the model is, where it should be, how active each muscle is."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.checks import is_number
from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.plotting.panels import headline
from mjhcmc.viewing.colours import activation_rgba
from mjhcmc.viewing.gaps import Gap, gaps_of

if TYPE_CHECKING:
    from mjhcmc.solution import Solution

__all__ = ["Frames", "settle", "span_of"]

Array = NDArray[np.float64]

MAX_FRAMES = 200_000
"""More are refused: a slip in fps or in the span, which would fill the memory."""

_ROUNDING = 1e-9  # s, by which times of a motion may be off


@dataclass(frozen=True, eq=False)
class Frames:
    """A solution as pictures. Build it with `Frames.of`.

    Attributes:
        model: ``mujoco.MjModel``, a copy of the solution's that may be recoloured.
        title: what is shown, for a heading.
        time: (n,) s, on the motion's clock.
        qpos: (n, nq) rad or m, of the muscle-driven model.
        desired: (n, nq) rad or m, of the motion.
        activation: (n, n_muscle).
        excitation: (n, n_muscle), of the window that starts at the frame or holds it; in the last node the last's.
        muscle_names: (n_muscle,).
        muscle_ids: (n_muscle,) actuator index of each muscle.
        tendon_of_muscle: (n_muscle,) the tendon that each muscle pulls; -1 where it pulls on something else.
    """

    model: Any
    title: str
    time: Array
    qpos: Array
    desired: Array
    activation: Array
    excitation: Array
    muscle_names: tuple[str, ...]
    muscle_ids: NDArray[np.intp]
    tendon_of_muscle: NDArray[np.intp]

    @classmethod
    def of(
        cls, solution: Solution, *, fps: float | None = None, start: float | None = None, end: float | None = None
    ) -> Frames:
        """The frames of a solution.

        Between nodes positions go along the shortest way at constant velocity (quaternions stay of unit length),
        activation along a straight line; excitation is constant over a window.

        Args:
            solution: with its model.
            fps: frames in each second of the motion. None: a frame at each node.
            start: s, on the motion's clock; None: the first node.
            end: s; None: the last node.

        Raises:
            SettingsError: fps is not above 0, or there is no such span in the motion.
            SimulationError: the solution does not know its model.
        """
        first, last = span_of(solution, start, end)
        if fps is not None and not (is_number(fps) and math.isfinite(fps) and fps > 0):
            raise SettingsError(f"fps must be a number above 0, got {fps!r}: 30 is usual, None gives a frame a node")
        model = solution.model
        if model is None:
            raise SimulationError(
                "this solution was read from a file and does not know its model: read it with Solution.load(path, "
                "model=...)"
            )
        node = solution.time
        if fps is None:
            time = node[(node >= first - _ROUNDING) & (node <= last + _ROUNDING)]
            if not time.size:
                raise SettingsError(f"there is no node from start {first:g} s to end {last:g} s: give fps for frames")
        else:
            if (last - first) * fps > MAX_FRAMES:
                raise SettingsError(
                    f"fps {fps:g} gives more than {MAX_FRAMES} frames over {last - first:g} s: lower it"
                )
            time = first + np.arange(math.floor((last - first) * fps + 1e-6) + 1) / fps
        k = np.clip(np.searchsorted(node, time + _ROUNDING, side="right") - 1, 0, len(node) - 2)
        part = np.clip((time - node[k]) / (node[k + 1] - node[k]), 0.0, 1.0)[:, None]
        between = model.coordinates

        def positions(rows: Array) -> Array:
            found = between.moved(rows[k], part * between.difference(rows[k + 1], rows[k]))
            found[part[:, 0] == 0] = rows[k[part[:, 0] == 0]]  # at nodes to the last digit
            found[part[:, 0] == 1] = rows[k[part[:, 0] == 1] + 1]
            return found

        a, m, ids = solution.activation, model.mj_model, model.muscle_ids
        on_tendon = m.actuator_trntype[ids] == mujoco.mjtTrn.mjTRN_TENDON
        frames = cls(
            model=copy.deepcopy(m),
            title=headline([solution]),
            time=np.array(time),
            qpos=positions(solution.qpos),
            desired=positions(solution.qpos_desired),
            activation=(1 - part) * a[k] + part * a[k + 1],
            excitation=solution.excitation[k],
            muscle_names=solution.muscle_names,
            muscle_ids=ids,
            tendon_of_muscle=np.where(on_tendon, m.actuator_trnid[ids, 0], -1).astype(np.intp),
        )
        for name in ("time", "qpos", "desired", "activation", "excitation"):
            getattr(frames, name).setflags(write=False)
        return frames

    def __post_init__(self) -> None:
        """Keep the tendons' own colours: the model may be painted from now on."""
        _ = self._own_rgba

    def __len__(self) -> int:
        """How many frames there are."""
        return len(self.time)

    @property
    def duration(self) -> float:
        """From the first frame to the last, s."""
        return float(self.time[-1] - self.time[0])

    def at(self, time: float) -> int:
        """The frame nearest to a time (s, on the motion's clock)."""
        return int(np.argmin(np.abs(self.time - time)))

    @cached_property
    def largest_error(self) -> tuple[float, float]:
        """How far the model is from the desired pose at most: of rotations, rad, and of slides, m; in these frames."""
        m = self.model
        away = np.zeros((len(self), m.nv))
        for row, qpos, desired in zip(away, self.qpos, self.desired, strict=True):
            mujoco.mj_differentiatePos(m, row, 1.0, qpos, desired)
        most = np.nan_to_num(np.abs(away)).max(axis=0, initial=0.0)
        slides = np.zeros(m.nv, dtype=np.bool_)
        for kind, first in zip(m.jnt_type, m.jnt_dofadr, strict=True):
            count = {int(mujoco.mjtJoint.mjJNT_SLIDE): 1, int(mujoco.mjtJoint.mjJNT_FREE): 3}.get(int(kind), 0)
            slides[first : first + count] = True
        return float(most[~slides].max(initial=0.0)), float(most[slides].max(initial=0.0))

    def tendon_activation(self, k: int) -> Array:
        """(ntendon,) the largest activation of the muscles on each tendon in frame k; NaN where there is no muscle."""
        found = np.full(self.model.ntendon, -np.inf)
        pulls = self.tendon_of_muscle >= 0
        with np.errstate(invalid="ignore"):  # an activation that is not known stays so
            np.maximum.at(found, self.tendon_of_muscle[pulls], self.activation[k, pulls])
        return np.where(np.isneginf(found), np.nan, found)

    def tendon_rgba(self, k: int) -> Array:
        """(ntendon, 4) the colour of each tendon in frame k, see `activation_rgba`; without muscle its own."""
        found: Array = self._own_rgba.copy()
        muscle = self._has_muscle
        found[muscle] = activation_rgba(self.tendon_activation(k)[muscle])
        return found

    def paths(self, k: int) -> tuple[Array, ...]:
        """One (points, 3) array of world coordinates (m) a tendon in frame k, from origin to insertion.

        A row of NaN breaks a path that divides at a pulley; one that divides nothing is passed over, see `gaps_of`.
        Fixed tendons have no points.
        """
        data = self.place(self.qpos[k])
        points, what = data.wrap_xpos.reshape(-1, 3), data.wrap_obj.reshape(-1)
        found = []
        for tendon, (first, count) in enumerate(zip(data.ten_wrapadr, data.ten_wrapnum, strict=True)):
            path = points[first : first + count].copy()
            pulleys = np.flatnonzero(what[first : first + count] == _PULLEY)
            path[pulleys] = np.nan
            closed = [pulleys[gap.pulley] for gap in self.gaps if gap.tendon == tendon]
            found.append(np.delete(path, closed, axis=0) if closed else path)
        return tuple(found)

    @cached_property
    def gaps(self) -> tuple[Gap, ...]:
        """Where paths leave off and go on, and pictures close the gap."""
        return gaps_of(self.model)

    def place(self, qpos: Array) -> Any:
        """``mujoco.MjData`` with bodies, tendon paths, cameras and lights at these positions; the same at each call."""
        data = self._data
        data.qpos[:] = qpos
        settle(self.model, data)
        return data

    @cached_property
    def _data(self) -> Any:
        return mujoco.MjData(self.model)

    @cached_property
    def _own_rgba(self) -> Array:
        """(ntendon, 4) the model's own colours; a material's where the tendon's is left at MuJoCo's default."""
        m = self.model
        found: Array = m.tendon_rgba.astype(float)
        with_material = (m.tendon_matid >= 0) & (found == (0.5, 0.5, 0.5, 1.0)).all(axis=1)
        found[with_material] = m.mat_rgba[m.tendon_matid[with_material]]
        return found

    @cached_property
    def _has_muscle(self) -> NDArray[np.bool_]:
        return np.isin(np.arange(self.model.ntendon), self.tendon_of_muscle)


_PULLEY = -2  # in wrap_obj


def span_of(solution: Solution, start: float | None = None, end: float | None = None) -> tuple[float, float]:
    """First and last time, s, of a part of a solution.

    Raises:
        SettingsError: the solution has no such part.
    """
    low, high = float(solution.time[0]), float(solution.time[-1])
    for name, value in (("start", start), ("end", end)):
        if value is None:
            continue
        if not is_number(value) or not low - _ROUNDING <= value <= high + _ROUNDING:
            raise SettingsError(f"{name} {value!r} s is outside the solution: give a time from {low:g} to {high:g} s")
    first, last = low if start is None else float(start), high if end is None else float(end)
    if not first < last:
        raise SettingsError(f"start {first:g} s and end {last:g} s: the start must come before the end")
    return max(first, low), min(last, high)


def settle(model: Any, data: Any) -> None:
    """Put bodies, tendons, cameras and lights where qpos says; no dynamics, no contacts."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    mujoco.mj_tendon(model, data)

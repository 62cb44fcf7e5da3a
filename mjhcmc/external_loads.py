"""ExternalLoads: measured forces on a model's bodies over time, and the wrenches that they make."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import ModelError, MotionError
from mjhcmc.joints import TIME_TOLERANCE

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel
    from mjhcmc.motion import Motion

__all__ = ["GROUND", "ExternalLoads", "LoadsAt", "suspicious", "wrenches"]

Array = NDArray[np.float64]

GROUND = ""
"""What the world is called among the bodies in whose frames loads are given."""

_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])  # np.cross takes twice the time


class LoadsAt(NamedTuple):
    """Loads at some times, each in its own frame.

    Attributes:
        force: (n, k, 3) N.
        torque: (n, k, 3) N m, free torque.
        point: (n, k, 3) m.
    """

    force: Array
    torque: Array
    point: Array


@dataclass(frozen=True, eq=False)
class ExternalLoads:
    """Measured forces on bodies over time.

    Between the rows, force, torque and point are taken to run straight. (OpenSim's ExternalForce does so with two or
    three rows; through more it draws a cubic spline, which swings past zero where a foot lands.)

    Attributes:
        name: for messages; the file that the loads came from.
        time: (T,) s, strictly increasing, T >= 2. Converted to float64 and read-only, like the three that follow.
        body: (k) body of the model that each load acts on.
        force: (T, k, 3) N.
        torque: (T, k, 3) N m, free torque: what is left about the point.
        point: (T, k, 3) m, where the force acts.
        force_frame: (k) body in whose frame force and torque are given; "" is the world. Empty: all in the world.
        point_frame: (k) likewise for the point.
        labels: (k) what the file calls the loads. Empty: as their bodies.
        notices: what the user may want to know of how they were read, a line each.

    Raises:
        MotionError: shapes, no load, order of times, or a value that is NaN or infinite.
    """

    name: str
    time: Array
    body: tuple[str, ...]
    force: Array = field(repr=False)
    torque: Array = field(repr=False)
    point: Array = field(repr=False)
    force_frame: tuple[str, ...] = ()
    point_frame: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Convert, freeze and check."""
        for key in ("time", "force", "torque", "point"):
            array = np.array(getattr(self, key), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, key, array)
        k = len(self.body)
        for key, default in (("force_frame", (GROUND,) * k), ("point_frame", (GROUND,) * k), ("labels", self.body)):
            object.__setattr__(self, key, tuple(getattr(self, key)) or tuple(default))
            if len(getattr(self, key)) != k:
                raise MotionError(f"{self.name}: {len(getattr(self, key))} {key} for {k} loads: give one a load")
        if not k:
            raise MotionError(f"{self.name}: no load: name at least one body")
        T = self.time.size
        for key in ("force", "torque", "point"):
            shape = getattr(self, key).shape
            if self.time.shape != (T,) or shape != (T, k, 3):
                raise MotionError(
                    f"{self.name}: time has shape {self.time.shape} and {key} {shape}: give time (T,) and {key} "
                    f"(T, {k}, 3)"
                )
        if T < 2:
            raise MotionError(f"{self.name}: {T} rows: loads need at least 2")
        for key in ("time", "force", "torque", "point"):
            bad = np.argwhere(~np.isfinite(getattr(self, key)))
            if len(bad):
                of = f" of load {self.labels[bad[0][1]]!r}" if key != "time" else ""
                raise MotionError(f"{self.name}: row {bad[0][0]} (from 0): {key}{of} is not finite: give finite values")
        back = np.flatnonzero(np.diff(self.time) <= 0)
        if len(back):
            row = back[0] + 1
            raise MotionError(
                f"{self.name}: row {row} (from 0): time {self.time[row]:.12g} s follows {self.time[row - 1]:.12g} s: "
                "times must increase"
            )

    @property
    def n_load(self) -> int:
        """Number of loads, k."""
        return len(self.body)

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        """(T, 3, k, 3) force, torque, point, and (T-1, 3, k, 3) their slopes."""
        table = np.stack([self.force, self.torque, self.point], axis=1)
        return table, np.diff(table, axis=0) / np.diff(self.time)[:, None, None, None]

    def sample(self, times: ArrayLike) -> LoadsAt:
        """The loads at any times that they cover, each in its own frame.

        Args:
            times: (n,) or one, s; up to 1e-9 s outside are taken as the first and last time.

        Returns:
            Force, torque and point, each (n, k, 3).

        Raises:
            MotionError: a time outside the loads, or not finite.
        """
        t = np.asarray(times, dtype=np.float64).reshape(-1)
        first, last = self.time[0], self.time[-1]
        if t.size and not (t.min() >= first and t.max() <= last):
            outside = ~((t >= first - TIME_TOLERANCE) & (t <= last + TIME_TOLERANCE))
            if outside.any():
                raise MotionError(
                    f"{self.name}: time {t[outside][0]:.12g} s lies outside the loads, {first:.12g} .. {last:.12g} s: "
                    "ask within them"
                )
            t = np.clip(t, first, last)
        table, slope = self._table
        row = np.minimum(self.time.searchsorted(t, "right") - 1, len(self.time) - 2)
        at = table.take(row, 0) + (t - self.time.take(row))[:, None, None, None] * slope.take(row, 0)
        return LoadsAt(at[:, 0], at[:, 1], at[:, 2])

    def check_covers(self, motion: Motion) -> None:
        """Raise MotionError unless the loads last at least from the motion's start to its end."""
        first, last = self.time[0], self.time[-1]
        if first - TIME_TOLERANCE <= motion.start and motion.end <= last + TIME_TOLERANCE:
            return
        begin, end = max(first, motion.start), min(last, motion.end)
        remedy = (
            f"choose start and end within {begin:.6g} .. {end:.6g} s, or give loads for the whole motion"
            if begin < end
            else "give the loads of this motion, on its clock"
        )
        raise MotionError(
            f"{self.name}: the loads last from {first:.6g} to {last:.6g} s, motion {motion.name!r} from "
            f"{motion.start:.6g} to {motion.end:.6g} s: {remedy}"
        )

    def ids(self, model: MuscleModel) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        """Index of each load's body, of its force's frame and of its point's frame, each (k,); 0 is the world.

        Raises:
            ModelError: the model has no such body.
        """
        import mujoco

        m = model.mj_model
        names = [m.body(i).name for i in range(m.nbody)]
        found = []
        for wanted in (self.body, self.force_frame, self.point_frame):
            ids = [0 if name == GROUND else mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, name) for name in wanted]
            if min(ids) < 0:
                raise ModelError(
                    f"{self.name}: model {model.name!r} has no body {wanted[ids.index(-1)]!r}: its bodies are "
                    f"{', '.join(names[1:])}: read the loads for this model"
                )
            found.append(np.array(ids, dtype=np.intp))
        return found[0], found[1], found[2]

    @classmethod
    def from_file(
        cls,
        path: str | os.PathLike[str],
        model: MuscleModel,
        *,
        data: str | os.PathLike[str] | None = None,
        column_map: Mapping[str, Any] | str | os.PathLike[str] | None = None,
        bodies: Mapping[str, str] | None = None,
        osim: str | os.PathLike[str] | Iterable[str] | None = None,
        rotation: ArrayLike | None = None,
    ) -> ExternalLoads:
        """Read loads from an OpenSim external-loads file, or from a table with a map of its columns.

        **Columns.** An identifier is the beginning of three column names, in OpenSim's way: ``ground_force_v`` for
        ``ground_force_vx``, ``ground_force_vy``, ``ground_force_vz``. A force without a point acts at the origin of
        the model's body; the torque may be left out, or the force, where there is a torque. Where the force and torque
        are 0 and the point is NaN (no foot on the plate), the nearest point is kept. Values are SI: N, N m, m; a point
        in a .csv may be named ``px (mm)``.

        **Bodies.** A body that the file names is looked for in bodies, then among the model's bodies, then in the
        model's custom text ``opensim_bodies`` (``calcn_r=foot toes_r=foot``). A load on a body that osim has and the
        model has not is left out, with a notice.

        **Frames.** The file's vectors are taken to be in OpenSim's ground, x forward, y up, z right, whatever the
        file's kind, and are turned by rotation. A vector in a body's frame is taken to be in OpenSim's axes of that
        body, which lie along the ground's in the zero pose, and is turned into those of the model's body in its zero
        pose; a point in a body's frame is measured from the origin of the model's body.

        Args:
            path: an .xml with ExternalLoads (of OpenSim 2.3.1 and later); or a .mot, .sto or .csv, with column_map.
            model: the model whose bodies are loaded.
            data: the table, where it is not the one that the .xml names.
            column_map: for a table: body to ``{"force": ..., "point": ..., "torque": ..., "frame": ...}`` (or a list of
                these), each the beginning of three columns' names or the three; frame, the body in whose frame they
                are, may be left out for the ground. Or a JSON file of it.
            bodies: the file's body to the model's.
            osim: the OpenSim model that the loads were measured for, or the names of its bodies.
            rotation: (3, 3) takes vectors in the file's ground to the model's world (np.eye(3): they are in the
                model's world). None: from y up to the model's up, against gravity: (x, y, z) to (x, -z, y) where z is
                up, as they are where y is.

        Returns:
            The loads; what was left out, turned or assumed is in the notices.

        Raises:
            MotionError: a file, its columns or rows do not allow it, a body is in neither model, or no load is left.
            SettingsError: an argument does not fit the file, or is none of its valid values.
            ModelError: the model's custom text cannot be understood, or its gravity leaves open which way is up.

        Warns:
            MjhcmcWarning: magnitudes that speak for other units: points in mm, torques in N mm, forces over 20 times
                the body weight.
        """
        from mjhcmc.io.loads_file import read_loads

        return read_loads(path, model, data=data, column_map=column_map, bodies=bodies, osim=osim, rotation=rotation)


def wrenches(
    loads_at: LoadsAt,
    body_ids: NDArray[np.intp],
    force_frame_ids: NDArray[np.intp],
    point_frame_ids: NDArray[np.intp],
    xpos: Array,
    xmat: Array,
    xipos: Array,
) -> Array:
    """What the loads do to their bodies, for n simulations or times.

    The torque is the free torque plus (point - xipos) x force; a point in the ground stays where it was measured,
    wherever the simulated body is.

    Args:
        loads_at: what `ExternalLoads.sample` gives, each (n, k, 3).
        body_ids: (k,) the loaded bodies, as of `ExternalLoads.ids`; so are the two that follow.
        force_frame_ids: (k,) frames of force and torque; 0 is the world.
        point_frame_ids: (k,) frames of the points.
        xpos: (n, nbody, 3) m, as in MjData.
        xmat: (n, nbody, 9) as in MjData.
        xipos: (n, nbody, 3) m, as in MjData: the bodies' centres of mass.

    Returns:
        (n, k, 6) force N and torque N m about the body's centre of mass, in the world's axes: what a row of MuJoCo's
        ``xfrc_applied`` takes. Loads that share a body are not added up.
    """
    force, torque, point = loads_at
    n, k = force.shape[:2]
    if np.count_nonzero(force_frame_ids):
        R = xmat.take(force_frame_ids, 1).reshape(n, k, 3, 3)
        force, torque = np.einsum("nkij,nkj->nki", R, force), np.einsum("nkij,nkj->nki", R, torque)
    if np.count_nonzero(point_frame_ids):
        R = xmat.take(point_frame_ids, 1).reshape(n, k, 3, 3)
        point = xpos.take(point_frame_ids, 1) + np.einsum("nkij,nkj->nki", R, point)
    arm = point - xipos.take(body_ids, 1)
    out = np.empty((n, k, 6))
    out[..., :3] = force
    out[..., 3:] = torque
    out[..., 3:] += arm.take(_NEXT, -1) * force.take(_AFTER, -1) - arm.take(_AFTER, -1) * force.take(_NEXT, -1)
    return out


def suspicious(loads: ExternalLoads, model: MuscleModel, motion: Motion) -> list[str]:
    """See `mjhcmc.load_checks.suspicious`, which this is."""
    from mjhcmc.load_checks import suspicious as look

    return look(loads, model, motion)

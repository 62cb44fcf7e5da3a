"""Motion: joint positions on a time grid, and their derivatives by an interpolating spline."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.checks import frozen_array
from mjhcmc.cosine import COSINE_PERIODS, cosine_rows
from mjhcmc.errors import MotionError, SettingsError
from mjhcmc.joints import RANGE_ALLOWANCE, TIME_TOLERANCE, JointModel, check_joint_range
from mjhcmc.signals import check_cutoff, power_above, zero_phase_lowpass

__all__ = [
    "COSINE_PERIODS",
    "RANGE_ALLOWANCE",
    "TIME_TOLERANCE",
    "JointModel",
    "Motion",
    "Reference",
    "check_cutoff",
    "check_joint_range",
]

Array = NDArray[np.float64]

_ROWS_AT_MOST = 1_000_000  # of a resampled motion: more is a slip of the rate's unit
_NOISE_FREQUENCY = 15.0  # Hz: movement has next to nothing above it
_NOISE_SHARE = 0.2  # of the power of q'': near half of its rms
_NOISE_FLOOR = 1.0  # rad/s2 or m/s2 rms: rounding in a joint held still is not worth a word


@dataclass(frozen=True, eq=False)
class Reference:
    """Positions, velocities and accelerations of a motion at given times.

    Attributes:
        time: (n,) s.
        qpos: (n, nq) rad or m.
        qvel: (n, nv) rad/s or m/s.
        qacc: (n, nv) rad/s2 or m/s2.
    """

    time: Array
    qpos: Array
    qvel: Array
    qacc: Array


@dataclass(frozen=True, eq=False)
class Motion:
    """Joint positions in the order of a model's joints, on a time grid that may be uneven.

    Between the rows, and for the derivatives, an interpolating spline holds: quintic (q'' is then a smooth
    cubic spline), cubic with fewer than 6 rows; not-a-knot at the ends. Quaternions Q of ball and free joints are
    splined by component and made unit length, so that angular velocity in the body's axes is 2 vec(Q^-1 Q').

    Attributes:
        time: (T,) s, strictly increasing, T >= 4. Converted to float64 and read-only, like qpos.
        qpos: (T, nq) rad or m.
        name: for messages, titles and file names.
        notices: what the user may want to know of how it was read, a line each.
        joint_names: (nq) names for messages, or empty.
        span: (start, end) in s of the part that is the motion. Rows outside it only lead the spline in and
            out, so that a motion cut out of a file keeps its derivatives at the cuts. None: all of time.
        quaternions: columns of qpos in which unit quaternions (w, x, y, z) begin; see `on`.

    Raises:
        MotionError: shapes, number of rows, order of times, a value that is NaN or infinite, a span
            outside time, or a quaternion of no length.
    """

    time: Array
    qpos: Array = field(repr=False)
    name: str = "motion"
    notices: tuple[str, ...] = ()
    joint_names: tuple[str, ...] = ()
    span: tuple[float, float] | None = None
    quaternions: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Convert, freeze and check."""
        for key in ("time", "qpos"):
            object.__setattr__(self, key, frozen_array(getattr(self, key), f"{self.name}: {key}"))
        time, qpos = self.time, self.qpos
        if time.ndim != 1 or qpos.ndim != 2 or len(qpos) != len(time) or qpos.shape[1] == 0:
            raise MotionError(
                f"{self.name}: time has shape {time.shape} and qpos {qpos.shape}: give time (T,) and qpos (T, nq)"
            )
        if self.joint_names and len(self.joint_names) != qpos.shape[1]:
            raise MotionError(
                f"{self.name}: {len(self.joint_names)} joint names for {qpos.shape[1]} columns of qpos: "
                f"give one a column"
            )
        if len(time) < 4:
            raise MotionError(f"{self.name}: {len(time)} rows: a motion needs at least 4")
        bad = np.argwhere(~np.isfinite(np.column_stack([time, qpos])))
        if len(bad):
            row, column = bad[0]
            what = "time" if column == 0 else f"qpos of {self.joint_label(column - 1)}"
            value = time[row] if column == 0 else qpos[row, column - 1]
            raise MotionError(f"{self.name}: row {row} (from 0): {what} is {value}: give finite values")
        back = np.flatnonzero(np.diff(time) <= 0)
        if len(back):
            row = back[0] + 1
            raise MotionError(
                f"{self.name}: row {row} (from 0): time {time[row]:.12g} s follows {time[row - 1]:.12g} s: "
                "times must increase"
            )
        if self.quaternions:
            from mjhcmc.quaternions import unit_quaternions

            object.__setattr__(self, "qpos", unit_quaternions(self.name, time, qpos, self.quaternions))
        if self.span is not None:
            start, end = (float(t) for t in self.span)
            if not time[0] <= start < end <= time[-1]:
                raise MotionError(
                    f"{self.name}: span {start:.12g} .. {end:.12g} s: it must increase and lie within the "
                    f"times "
                    f"{time[0]:.12g} .. {time[-1]:.12g} s"
                )
            object.__setattr__(self, "span", (start, end))

    @property
    def start(self) -> float:
        """Where the motion begins, s, on its own clock."""
        return self.span[0] if self.span else float(self.time[0])

    @property
    def end(self) -> float:
        """Where the motion ends, s, on its own clock."""
        return self.span[1] if self.span else float(self.time[-1])

    @property
    def duration(self) -> float:
        """End minus start, s."""
        return self.end - self.start

    def joint_label(self, joint: int) -> str:
        """The joint's name for messages, its number where names are not known."""
        return f"joint {self.joint_names[joint] if self.joint_names else joint}"

    def sample(self, times: ArrayLike) -> Reference:
        """Positions, velocities and accelerations at any times of the motion.

        Args:
            times: (n,) or one, s, on the motion's clock; up to 1e-9 s outside start and end are taken as
                start and end.

        Returns:
            The samples; time holds the times used.

        Raises:
            MotionError: a time outside the motion, or not finite.
        """
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        outside = ~((t >= self.start - TIME_TOLERANCE) & (t <= self.end + TIME_TOLERANCE))
        if outside.any():
            raise MotionError(
                f"{self.name}: time {t[outside][0]:.12g} s lies outside the motion, {self.start:.12g} .. "
                f"{self.end:.12g} s: ask within it"
            )
        t = np.clip(t, self.start, self.end)
        found = self.spline(t), self.spline(t, 1), self.spline(t, 2)
        if self.quaternions:
            from mjhcmc.quaternions import turning

            found = turning(*found, self.quaternions)
        return Reference(t, *found)

    def on(self, model: JointModel, quaternions: tuple[int, ...]) -> "Motion":
        """The motion with names for its joints and its quaternions known.

        Args:
            model: whose joints move, for their names.
            quaternions: columns of qpos in which they begin.
        """
        if quaternions == self.quaternions:
            return self
        return replace(self, joint_names=tuple(model.joint_names), quaternions=quaternions)

    @cached_property
    def spline(self) -> Any:
        """The interpolating spline of the rows, quaternions by component."""
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self.time, self.qpos, k=5 if len(self.time) >= 6 else 3)

    def save(
        self,
        path: str | os.PathLike[str],
        model: JointModel,
        *,
        angle_unit: Literal["deg", "rad"] = "deg",
        lead: bool = False,
    ) -> Path:
        """Write the motion to a .mot or .sto file: see `mjhcmc.io.motion_writer.write_motion`."""
        from mjhcmc.io.motion_writer import write_motion

        return write_motion(self, model, path, angle_unit=angle_unit, lead=lead)

    @classmethod
    def cosine(
        cls,
        model: JointModel,
        movement: str | None = None,
        *,
        amplitudes: Mapping[str, float] | None = None,
        period: float | None = None,
        cycles: float = 3,
        name: str | None = None,
    ) -> "Motion":
        """Cosine movement out of the reference pose and back: q_j = q_ref,j + A_j/2 (1 - cos(2 pi t/T)).

        The named movements are those of "Integrator for Musculoskeletal Simulation in Python" (2024,
        doi:10.17979/ja-cea.2024.45.10802): from rest to 10 deg of hip flexion, 20 deg of knee flexion and 10
        deg of ankle plantarflexion, three times; "fast" takes 0.2 s a cycle, as there, "slow" 0.6 s.

        Args:
            model: the model to move; it needs joints hip, knee and ankle for the named movements.
            movement: "fast" or "slow"; or give amplitudes and period.
            amplitudes: joint name to peak excursion A_j, rad (slides: m); other joints stay at the reference
                pose.
            period: T, s a cycle, with amplitudes.
            cycles: how many.
            name: the motion's name; the movement's, or "cosine", where none is given.

        Returns:
            The motion from 0 to cycles T, sampled so densely that its spline's q'' is right to 1e-8 of its
            peak.

        Raises:
            MotionError: the model has no such joint, or the movement leaves a joint's range.
            SettingsError: an unknown movement, both or neither of movement and amplitudes, a period, number
                of cycles or amplitude that is no positive (finite) number.
        """
        time, qpos, named = cosine_rows(model, movement, amplitudes, period, cycles)
        motion = cls(time, qpos, name or named, joint_names=tuple(model.joint_names))
        check_joint_range(
            motion, model, motion.time, qpos, f"cosine movement {motion.name!r}", 1e-9, "give smaller amplitudes"
        )
        return motion

    @classmethod
    def from_file(
        cls,
        path: str | os.PathLike[str],
        model: JointModel,
        lowpass_hz: float | None = None,
        *,
        column_map: Mapping[str, str] | str | os.PathLike[str] | None = None,
        start: float | None = None,
        end: float | None = None,
        angle_unit: Literal["deg", "rad"] | None = None,
        angles: Literal["joint", "segment"] = "joint",
    ) -> "Motion":
        """Read a motion from a table of angles (.mot, .sto, .csv) or from markers (.trc).

        Tables: a column is found for each joint in this order: column_map; a column of the joint's name; q/JOINT,
        as `Solution.save` writes it; the model's own column_map. OpenSim's path names
        (/jointset/hip_r/hip_flexion_r/value) go by the coordinate's name. Angles turn from degrees to radians
        where the header (of a .csv: a line ``# inDegrees=yes`` above the column names), the column's name
        (``hip (deg)``, in a .csv) or angle_unit says so; a file that says nothing is refused.

        Markers: inverse kinematics onto the model's sites (see `mjhcmc.io.markers`).

        Args:
            path: the file.
            model: the model to move.
            lowpass_hz: cutoff of a zero-phase low-pass filter (see signals.zero_phase_lowpass), Hz; None: no
                filter.
            column_map: joint to column, a leading minus on the column flips its sign; for a .trc, site to
                marker. Or a file of such pairs: a JSON object, or a .csv of two columns.
            start: where to begin, s on the file's clock; None: its first row.
            end: where to end, s on the file's clock; None: its last row.
            angle_unit: "deg" or "rad" for a file that does not say its unit; None: as the file says.
            angles: "segment" where the columns, named after the joints as always, hold rotations of the joints'
                bodies, not of the joints (see `mjhcmc.segments`).

        Returns:
            The motion, which begins and ends exactly at start and end, whether or not rows stand there.
            Columns that were not used are in its notices, and how well the markers were met.

        Raises:
            MotionError: the file, the map, a row, or the model's joint ranges do not allow it, or angle_unit
                contradicts the file; one line says what and what to do.
            ModelError: the model has no segment angles, or markers cannot move it.
            SettingsError: lowpass_hz is not above 0 and below half the sampling rate; an angle_unit or angles
                other than those above.
        """
        from mjhcmc.io.motion_file import read_motion

        return read_motion(
            path, model, lowpass_hz, column_map=column_map, start=start, end=end, angle_unit=angle_unit, angles=angles
        )

    @classmethod
    def from_files(
        cls,
        paths: Iterable[str | os.PathLike[str]],
        model: JointModel,
        lowpass_hz: float | None = None,
        *,
        column_map: Mapping[str, str] | str | os.PathLike[str] | None = None,
        start: float | None = None,
        end: float | None = None,
        angle_unit: Literal["deg", "rad"] | None = None,
        angles: Literal["joint", "segment"] = "joint",
    ) -> "list[Motion]":
        """Read several motions, all before any work begins.

        Args:
            paths: the files.
            model: the model to move.
            lowpass_hz: as in `from_file`, for every file; so are all that follow.
            column_map: see `from_file`.
            start: see `from_file`.
            end: see `from_file`.
            angle_unit: see `from_file`.
            angles: see `from_file`.

        Returns:
            A motion a file, in their order. Names differ, whatever the letters' case: files of one stem get
            their folder's name in front (``left_walk``, ``right_walk``).

        Raises:
            MotionError: no files, a file given twice, or files that cannot be read: the first one's message,
                and which others are bad.
            ModelError, SettingsError: as `from_file`, at the first file.
        """
        from mjhcmc.io.motion_files import read_motions

        return read_motions(
            paths, model, lowpass_hz, column_map=column_map, start=start, end=end, angle_unit=angle_unit, angles=angles
        )

    def resampled(self, rate_hz: float) -> "Motion":
        """The motion on an even grid with rows at start and end, through its quintic spline.

        Nothing is filtered: what moves faster than half the new rate is folded into slower movement (aliased).
        Take a rate well above twice the highest frequency, or `lowpassed` first.

        Args:
            rate_hz: rows a second, Hz. The step is changed by as little as makes the duration a whole number
                of steps.

        Returns:
            A motion with the same span; rows outside the span stay as far as whole steps reach.

        Raises:
            SettingsError: rate_hz is no positive number, or gives fewer than 4 rows, or more than a million.
        """
        if not 0 < rate_hz < np.inf:
            raise SettingsError(f"resampling rate {rate_hz} Hz: choose one above 0, such as 100")
        steps = max(float(rate_hz) * self.duration, 1.0)
        whole = (self.time[-1] - self.time[0]) * rate_hz
        if round(steps) < 3 or whole > _ROWS_AT_MOST:
            raise SettingsError(
                f"resampling rate {rate_hz:g} Hz: {self.name} lasts {self.duration:.6g} s: choose one from "
                f"{3 / self.duration:.6g} to {_ROWS_AT_MOST / (self.time[-1] - self.time[0]):.6g} Hz"
            )
        n = round(steps)
        step = self.duration / n
        before, after = (int(gap / step) for gap in (self.start - self.time[0], self.time[-1] - self.end))
        time = np.concatenate(
            [
                self.start - step * np.arange(before, 0, -1),
                np.linspace(self.start, self.end, n + 1),
                self.end + step * np.arange(1, after + 1),
            ]
        )
        return Motion(
            time,
            self.spline(np.clip(time, self.time[0], self.time[-1])),
            self.name,
            (*self.notices, f"resampled at {1 / step:.6g} Hz"),
            self.joint_names,
            (self.start, self.end),
            self.quaternions,
        )

    def lowpassed(self, hz: float) -> "Motion":
        """The motion through a zero-phase Butterworth filter of fourth order.

        See signals.zero_phase_lowpass. An uneven grid is replaced by an even one at its median step, through
        the spline.

        Args:
            hz: cutoff, Hz.

        Returns:
            A motion with the same span.

        Raises:
            SettingsError: hz is not above 0 and below half the sampling rate.
        """
        check_cutoff(hz)
        steps = np.diff(self.time)
        whole = self.time[-1] - self.time[0]
        time = np.linspace(self.time[0], self.time[-1], round(float(whole / np.median(steps))) + 1)
        step = whole / (len(time) - 1)
        even = len(time) == len(self.time) and np.abs(time - self.time).max() < 1e-4 * step
        nyquist = 0.5 / step
        if hz >= nyquist:
            raise SettingsError(
                f"low-pass cutoff {hz:g} Hz: {self.name} has a row each {1e3 * step:.4g} ms: choose a "
                f"cutoff below "
                f"{nyquist:.4g} Hz"
            )
        rows = self.qpos if even else self.spline(time)
        notice = f"low-pass filtered at {hz:g} Hz" + ("" if even else f", resampled each {1e3 * step:.4g} ms")
        return Motion(
            self.time if even else time,
            zero_phase_lowpass(rows, hz, step),
            self.name,
            (*self.notices, notice),
            self.joint_names,
            (self.start, self.end),
            self.quaternions,
        )

    def noise_warning(self) -> str | None:
        """One line where measurement noise dominates q'', else None.

        The test: more than a fifth of the power of some joint's q'' (Hann window, over start .. end) lies
        above 15 Hz, and its rms there is above 1 rad/s2. Noise weighs with the square of its frequency in
        q''; movement hardly reaches 15 Hz. Motions under 0.2 s are not judged.
        """
        if self.duration < 3 / _NOISE_FREQUENCY:
            return None
        step = min(0.25 * float(np.median(np.diff(self.time))), 0.005)
        time = np.linspace(self.start, self.end, int(np.ceil(self.duration / step)) + 1)[:-1]
        share, rms = power_above(self.spline(time, 2), _NOISE_FREQUENCY, self.duration / len(time))
        share = np.where(rms > _NOISE_FLOOR, share, 0.0)
        worst = int(np.argmax(share))
        if share[worst] <= _NOISE_SHARE:
            return None
        return (
            f"{self.name}: raw noise dominates q'': {100 * share[worst]:.0f} % of the power of q'' of "
            f"{self.joint_label(worst)} lies above {_NOISE_FREQUENCY:g} Hz: filter with --lowpass 6"
        )

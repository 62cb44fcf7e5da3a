"""Motion: joint positions on a time grid, and their derivatives by an interpolating spline."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import MotionError, SettingsError
from mjhcmc.signals import power_above, zero_phase_lowpass

Array = NDArray[np.float64]

TIME_TOLERANCE = 1e-9
"""s. Times closer than this are the same time."""

RANGE_ALLOWANCE = 2e-3
"""rad (.11 deg) or m: a spline or filter overshoots a little where a joint rests at its limit."""

COSINE_PERIODS = {"fast": 0.2, "slow": 0.6}
"""s a cycle of the named cosine movements."""

_COSINE_AMPLITUDES = {"hip": np.deg2rad(10.0), "knee": np.deg2rad(-20.0), "ankle": np.deg2rad(-10.0)}
_COSINE_ROWS_PER_CYCLE = 1000  # the quintic spline's q'' then errs by 1e-9 of its peak, at the ends too
_NOISE_FREQUENCY = 15.0  # Hz: movement has next to nothing above it
_NOISE_SHARE = 0.2  # of the power of q'': near half of its rms
_NOISE_FLOOR = 1.0  # rad/s2 or m/s2 rms: rounding in a joint held still is not worth a word


class JointModel(Protocol):
    """What a motion needs to know of a model; MuscleModel has it."""

    @property
    def name(self) -> str:
        """The model's name."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """(nq) names of the hinge and slide joints, in the order of qpos."""

    @property
    def joint_is_rotation(self) -> NDArray[np.bool_]:
        """(nq,) true for hinges, false for slides."""

    @property
    def joint_range(self) -> Array:
        """(nq, 2) limits, rad or m; infinite where there are none."""

    @property
    def qpos_reference(self) -> Array:
        """(nq,) the reference pose, rad or m."""

    @property
    def column_map(self) -> Mapping[str, str]:
        """Joint to file column, as shipped with the model; a leading minus flips the sign."""


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
    cubic spline), cubic with fewer than 6 rows; not-a-knot at the ends. Hinge and slide joints only (nq =
    nv); MuscleModel refuses ball and free joints.

    Attributes:
        time: (T,) s, strictly increasing, T >= 4. Converted to float64 and read-only, like qpos.
        qpos: (T, nq) rad or m.
        name: for messages, titles and file names.
        notices: what the user may want to know of how it was read, a line each.
        joint_names: (nq) names for messages, or empty.
        span: (start, end) in s of the part that is the motion. Rows outside it only lead the spline in and
            out, so that a motion cut out of a file keeps its derivatives at the cuts. None: all of time.

    Raises:
        MotionError: shapes, number of rows, order of times, a value that is NaN or infinite, or a span
            outside time.
    """

    time: Array
    qpos: Array = field(repr=False)
    name: str = "motion"
    notices: tuple[str, ...] = ()
    joint_names: tuple[str, ...] = ()
    span: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Convert, freeze and check."""
        for key in ("time", "qpos"):
            object.__setattr__(self, key, _frozen(getattr(self, key), f"{self.name}: {key}"))
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
        return Reference(t, self._spline(t), self._spline(t, 1), self._spline(t, 2))

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self.time, self.qpos, k=5 if len(self.time) >= 6 else 3)

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
        if (movement is None) == (amplitudes is None):
            raise SettingsError(
                f"cosine: give one of the movements {', '.join(COSINE_PERIODS)}, or amplitudes and period"
            )
        if movement is not None:
            if movement not in COSINE_PERIODS:
                raise SettingsError(f"cosine: unknown movement {movement!r}: choose from {', '.join(COSINE_PERIODS)}")
            if period is not None:
                raise SettingsError(f"cosine: {movement!r} has its own period: leave period out, or give amplitudes")
            missing = [joint for joint in _COSINE_AMPLITUDES if joint not in model.joint_names]
            if missing:
                raise MotionError(
                    f"cosine: model {model.name} has no joint {', '.join(missing)}, which {movement!r} "
                    f"moves; it has "
                    f"{', '.join(model.joint_names)}: give amplitudes={{joint: rad}} and period"
                )
            amplitudes, period = _COSINE_AMPLITUDES, COSINE_PERIODS[movement]
        assert amplitudes is not None
        for what, value in (("period", period), ("cycles", cycles)):
            if value is None or not 0 < value < np.inf:
                raise SettingsError(f"cosine: {what} is {value}: give a positive number")
        assert period is not None
        excursion = np.zeros(len(model.joint_names))
        for joint, amplitude in amplitudes.items():
            if joint not in model.joint_names:
                raise MotionError(
                    f"cosine: model {model.name} has no joint {joint!r}: its joints are {', '.join(model.joint_names)}"
                )
            if not np.isfinite(amplitude):
                raise SettingsError(f"cosine: the amplitude of joint {joint} is {amplitude}: give a finite number")
            excursion[model.joint_names.index(joint)] = amplitude
        phase = np.linspace(0.0, cycles, int(np.ceil(_COSINE_ROWS_PER_CYCLE * max(cycles, 0.01))) + 1)
        # 1 - cos x = 2 sin^2(x/2) keeps its digits near rest, where q'' is at its largest.
        qpos = np.asarray(model.qpos_reference) + np.sin(np.pi * phase)[:, None] ** 2 * excursion
        motion = cls(phase * period, qpos, name or movement or "cosine", joint_names=tuple(model.joint_names))
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
    ) -> "Motion":
        """Read a motion from an OpenSim .mot or .sto file.

        Columns are found for each joint in this order: column_map; a column of the joint's name; the model's
        own column_map. OpenSim's path names (/jointset/hip_r/hip_flexion_r/value) go by the coordinate's
        name. Angles turn from degrees to radians where the header says inDegrees=yes.

        Args:
            path: the file.
            model: the model to move.
            lowpass_hz: cutoff of a zero-phase low-pass filter (see signals.zero_phase_lowpass), Hz; None: no
                filter.
            column_map: joint to column, a leading minus on the column flips its sign; or a JSON file of such
                an object.
            start: where to begin, s on the file's clock; None: its first row.
            end: where to end, s on the file's clock; None: its last row.

        Returns:
            The motion, which begins and ends exactly at start and end, whether or not rows stand there.
            Columns that were not used are in its notices.

        Raises:
            MotionError: the file, the map, a row, or the model's joint ranges do not allow it; one line says
                what and what to do.
            SettingsError: lowpass_hz is not above 0 and below half the sampling rate.
        """
        from mjhcmc.io.motion_file import read_motion

        return read_motion(path, model, lowpass_hz, column_map=column_map, start=start, end=end)

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
        rows = self.qpos if even else self._spline(time)
        notice = f"low-pass filtered at {hz:g} Hz" + ("" if even else f", resampled each {1e3 * step:.4g} ms")
        return Motion(
            self.time if even else time,
            zero_phase_lowpass(rows, hz, step),
            self.name,
            (*self.notices, notice),
            self.joint_names,
            (self.start, self.end),
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
        share, rms = power_above(self._spline(time, 2), _NOISE_FREQUENCY, self.duration / len(time))
        share = np.where(rms > _NOISE_FLOOR, share, 0.0)
        worst = int(np.argmax(share))
        if share[worst] <= _NOISE_SHARE:
            return None
        return (
            f"{self.name}: raw noise dominates q'': {100 * share[worst]:.0f} % of the power of q'' of "
            f"{self.joint_label(worst)} lies above {_NOISE_FREQUENCY:g} Hz: filter with --lowpass 6"
        )


def check_cutoff(hz: float) -> None:
    """Raise SettingsError unless hz is a positive number."""
    if not 0 < hz < np.inf:
        raise SettingsError(f"low-pass cutoff {hz} Hz: choose one above 0, such as 6")


def check_joint_range(
    motion: Motion, model: JointModel, time: Array, qpos: Array, source: str, allowance: float, remedy: str
) -> None:
    """Raise MotionError where positions leave the model's joint ranges.

    Args:
        motion: for the joints' labels.
        model: the model, with joint_range (nq, 2).
        time: (n,) s.
        qpos: (n, nq) rad or m.
        source: what to call it in the message.
        allowance: rad or m past a limit that is let pass.
        remedy: what to do, the message's last words.
    """
    limits = np.asarray(model.joint_range, dtype=np.float64)
    excess = np.maximum(limits[:, 0] - qpos, qpos - limits[:, 1])
    if excess.max() <= allowance:
        return
    row, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
    scale, unit = (180 / np.pi, "deg") if model.joint_is_rotation[joint] else (1.0, "m")
    low, high = scale * limits[joint]
    raise MotionError(
        f"{source}: {motion.joint_label(int(joint))} is at {scale * qpos[row, joint]:.9g} {unit} at "
        f"{time[row]:.6g} s, "
        f"outside its range {low:.6g} .. {high:.6g} {unit} in model {model.name}: {remedy}"
    )


def _frozen(value: Any, what: str) -> Array:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise MotionError(f"{what} is not an array of numbers ({error}): give one") from None
    array.setflags(write=False)
    return array

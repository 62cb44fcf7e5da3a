"""What a clinical test asks for: which joint, from where to where, how fast, held and moved by whom."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import SettingsError
from mjhcmc.leg8.table import JOINTS

Array = NDArray[np.float64]

REST = 0.3
"""s, that the limb is held still before a stretch: the resistance then is the baseline."""

HOLD = 0.5
"""s, that the examiner holds on after a stretch."""

MIN_JERK_PEAK = 1.875
"""Peak over mean speed of a movement of minimum jerk (Flash, Hogan 1985, doi:10.1523/JNEUROSCI.05-07-01688.1985)."""

TESTS = ("slow", "mas", "fast", "pendulum", "cosine", "walk")
EXAMINERS = ("servo", "torque", "")
POSTURES = ("side_lying", "seated", "hanging", "standing")
SESSIONS = ("instrumented", "rating", "ideal")


@dataclass(frozen=True)
class Trial:
    """One trial of a clinical test.

    Attributes:
        name: unique within a battery, such as ``"fast_180/knee"``.
        test: one of `TESTS`.
        joint: the joint under test; empty in voluntary movements.
        start: rad, where the joint is at first.
        end: rad, where a stretch is to end; as start in tests without examiner.
        speed: rad/s, peak speed that is asked for; 0 in tests without examiner.
        duration: s, all in all.
        examiner: ``"servo"``, a machine that moves the joint whatever it takes; ``"torque"``, an examiner's arm of
            limited stiffness and strength; empty: none.
        posture: one of `POSTURES`; lying on the side, gravity does not turn the joints; seated, the thigh is level,
            however far the trunk leans back.
        pose: (hip, knee, ankle) rad, where joints are at first, and held if they are not under test.
        session: one of `SESSIONS`; reflexes and tone differ between sessions.
        rate: Hz, of what is recorded.
    """

    name: str
    test: str
    joint: str
    start: float
    end: float
    speed: float
    duration: float
    examiner: str
    posture: str
    pose: tuple[float, float, float]
    session: str = "instrumented"
    rate: float = 100.0

    def __post_init__(self) -> None:
        """Check that it can be carried out.

        Raises:
            SettingsError: an unknown word, or a number out of place.
        """
        for what, value, known in (
            ("test", self.test, TESTS),
            ("joint", self.joint, (*JOINTS, "")),
            ("examiner", self.examiner, EXAMINERS),
            ("posture", self.posture, POSTURES),
            ("session", self.session, SESSIONS),
        ):
            if value not in known:
                raise SettingsError(f"trial {self.name!r}: {what} {value!r} is not known: choose one of {known}")
        numbers = (self.start, self.end, self.speed, self.duration, self.rate, *self.pose)
        if not all(math.isfinite(value) for value in numbers) or self.duration <= 0 or self.rate <= 0 or self.speed < 0:
            raise SettingsError(f"trial {self.name!r}: duration, rate and speed must be finite and positive")

    @property
    def direction(self) -> float:
        """Sign of the stretch in the joint's coordinate; 0 where there is none."""
        return float(np.sign(self.end - self.start))

    @property
    def movement_time(self) -> float:
        """s, that the stretch takes."""
        return MIN_JERK_PEAK * abs(self.end - self.start) / self.speed if self.speed else 0.0

    def desired(self, time: ArrayLike) -> tuple[Array, Array, Array]:
        """Where the joint under test is to be.

        Args:
            time: (n,) s.

        Returns:
            Angle (rad), velocity (rad/s) and acceleration (rad/s^2), (n,) each.
        """
        time = np.asarray(time, dtype=np.float64)
        way = (np.full(time.shape, value) for value in (self.start, self.end, self.movement_time))
        return min_jerk(time - REST, *way)


def min_jerk(since: Array | float, start: Array, end: Array, movement_time: Array) -> tuple[Array, Array, Array]:
    """A movement of minimum jerk: s(x) = 10 x^3 - 15 x^4 + 6 x^5, x = t/T (Flash, Hogan 1985).

    Args:
        since: (n,) s, or one number, since it began.
        start: (n,) rad.
        end: (n,) rad.
        movement_time: (n,) s, T; 0: it stays at its start.

    Returns:
        Angle (rad), velocity (rad/s) and acceleration (rad/s^2), (n,) each.
    """
    way, T = np.where(movement_time > 0, end - start, 0.0), np.where(movement_time > 0, movement_time, 1.0)
    x = np.clip(since / T, 0.0, 1.0)
    s = x**3 * (10 + x * (-15 + 6 * x))
    ds = x**2 * (30 + x * (-60 + 30 * x))
    dds = x * (60 + x * (-180 + 120 * x))
    return start + way * s, way * ds / T, way * dds / T**2


_WAYS_DEG: Mapping[str, tuple[float, float, tuple[float, float, float]]] = {
    # from, to, and where the joints are at first: positions of a lying patient that stretch one group
    "hip": (45.0, -10.0, (45.0, -45.0, 0.0)),
    "knee": (-15.0, -100.0, (15.0, -15.0, 0.0)),
    "ankle": (-35.0, 10.0, (20.0, -15.0, -35.0)),
}
"""Joint under test: start and end of the stretch, and the pose, deg."""

MAS_TIME = 1.0
"""s, of the stretch over the whole range when grading (Bohannon, Smith 1987, doi:10.1093/ptj/67.2.206)."""


def stretch(
    joint: str,
    test: str,
    speed: float | None = None,
    *,
    examiner: str = "torque",
    session: str = "instrumented",
    rate: float = 100.0,
) -> Trial:
    """A passive stretch of one joint.

    Args:
        joint: ``"hip"``, ``"knee"`` or ``"ankle"``.
        test: ``"slow"``, ``"mas"`` or ``"fast"``.
        speed: rad/s, peak; None: the whole range in `MAS_TIME`.
        examiner: ``"servo"`` or ``"torque"``.
        session: one of `SESSIONS`.
        rate: Hz.

    Raises:
        SettingsError: an unknown joint, test or examiner; a speed that is not positive.
    """
    if not (math.isfinite(rate) and rate > 0):
        raise SettingsError(f"a trial takes a positive rate in Hz; got {rate}")
    if joint not in _WAYS_DEG:
        raise SettingsError(f"joint {joint!r} cannot be stretched: choose one of {', '.join(_WAYS_DEG)}")
    if test not in TESTS[:3]:
        raise SettingsError(f"test {test!r} is no passive stretch: choose one of {', '.join(TESTS[:3])}")
    first, last, pose = (np.radians(value) for value in _WAYS_DEG[joint])
    start, end = float(first), float(last)
    told = "" if speed is None else f"_{math.degrees(speed):.0f}"
    peak = MIN_JERK_PEAK * abs(end - start) / MAS_TIME if speed is None else float(speed)
    if not (math.isfinite(peak) and peak > 0):
        raise SettingsError(f"a stretch takes a positive speed in rad/s; got {speed}")
    duration = REST + MIN_JERK_PEAK * abs(end - start) / peak + HOLD
    name = f"{test}{told}/{joint}" + ("" if session == "instrumented" else f"/{session}")
    hip, knee, ankle = pose.tolist()
    whole = math.ceil(duration * rate - 1e-9) / rate
    return Trial(
        name, test, joint, start, end, peak, whole, examiner, "side_lying", (hip, knee, ankle), session, rate
    )  # fmt: skip


def pendulum(rate: float = 100.0, *, duration: float = 5.0) -> Trial:
    """The pendulum test of the knee: seated, the shank let go from full extension (Wartenberg 1951).

    Args:
        rate: Hz.
        duration: s.
    """
    pose = (math.radians(30.0), 0.0, 0.0)  # leaning back, so that the hamstrings let the knee extend
    return Trial("pendulum/knee", "pendulum", "knee", 0.0, 0.0, 0.0, duration, "", "seated", pose, rate=rate)


def voluntary(test: str, movement: str, rate: float) -> Trial:
    """A movement by will.

    Args:
        test: ``"cosine"`` or ``"walk"``.
        movement: which cosine, see `Motion.cosine`.
        rate: Hz.
    """
    name = f"{test}_{movement}" if movement else test
    posture = "hanging" if test == "cosine" else "standing"
    return Trial(name, test, "", 0.0, 0.0, 0.0, 1.0, "", posture, (0.0, 0.0, 0.0), rate=rate)

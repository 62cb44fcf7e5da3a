"""What a hand feels that stretches a passive limb: resistance along the range, a catch, range that is not reached.

The resistance to the stretch is what the hand applies in its direction, less what accelerates the limb:

    r = d (tau - I q''),    s = (q - start) / (end - start),

with d the sign of the stretch, tau the examiner's torque, I the limb's inertia; lying on the side, gravity does not
turn the joint. A limb that moves by itself (r < 0) does not resist. Grading scales speak of an *increase* of
resistance: the excess e = max(r, 0) - max(h, 0) over h(s), what the hand is used to from healthy limbs of that size.
What is felt as force at the hand is e over its lever arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.leg8.table import JOINTS
from mjhcmc.patients.examiner import LEVERS
from mjhcmc.patients.record import Record
from mjhcmc.patients.trials import REST, TESTS

Array = NDArray[np.float64]

PLACES: Array = np.linspace(0.0, 1.0, 51)
"""Shares of the range at which the course of the resistance is kept."""

SUDDEN = 0.1
"""s, within which resistance rises in a catch; chosen here: delay and activation of a reflex take about as long."""

SMOOTH = 0.02
"""s, standard deviation of the Gaussian that torques are smoothed with: steady holding, not ripple, is felt."""

END_ZONE = 0.85
"""Part of the range where its end begins: resistance that sets in later is no catch; chosen here."""

START_ZONE = 0.1
"""Part of the range in which the limb is only set going: what resists there is no catch; chosen here."""

CORNER = 0.5
"""A catch ends in a corner: resistance then rises less than this share as steeply over the angle. A tissue that is
strained does not: its stiffness grows or stays (Fung 1967, doi:10.1152/ajplegacy.1967.213.6.1532). Chosen here."""

_BEYOND = 0.2  # of the range after the catch, over which that is judged


@dataclass(frozen=True)
class Hand:
    """The hand that moves the limb.

    Attributes:
        lever_arm: m, from the joint to the hand.
        perception: N, force at the hand that is just felt. The hand that lies under a shank and foot carries about 25 N
            of them; changes of 11 to 13 % are felt by an arm that moves (Feyzabadi et al. 2013,
            doi:10.1109/TOH.2013.4): 3 N.
        tolerance: share of the usual resistance that passes as usual, since healthy limbs differ; chosen here.
    """

    lever_arm: float
    perception: float = 3.0
    tolerance: float = 0.3

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            SettingsError: a lever arm or perception that is not positive, a tolerance below 0.
        """
        for name, value, least in (
            ("lever_arm", self.lever_arm, 1e-6),
            ("perception", self.perception, 1e-6),
            ("tolerance", self.tolerance, 0.0),
        ):
            if not (math.isfinite(value) and value >= least):
                raise SettingsError(f"hand: {name} must be {'0 or more' if least == 0 else 'positive'}; got {value}")


def hand_on(joint: str, height: float) -> Hand:
    """The hand of an examiner: above the knee, at the ankle, or under the ball of the foot.

    Args:
        joint: ``"hip"``, ``"knee"`` or ``"ankle"``.
        height: m, stature.

    Raises:
        SettingsError: another joint, a height that is not positive.
    """
    if joint not in LEVERS:
        raise SettingsError(f"joint {joint!r} is not held: choose one of {', '.join(LEVERS)}")
    return Hand(LEVERS[joint] * height)


@dataclass(frozen=True, eq=False)
class Usual:
    """What a healthy limb resists with.

    Attributes:
        course: (51,) N m, at `PLACES`.
        hold: N m, at the end of the hold.
        reached: share of the range that is reached by then.
    """

    course: Array
    hold: float
    reached: float = 1.0

    def scaled(self, factor: float) -> Usual:
        """Of a limb of another size: passive torque goes with body mass times height.

        Max isometric force scales with mass and moment arms with height, as in :mod:`mjhcmc.leg8.builder`.
        """
        return replace(self, course=self.course * factor, hold=self.hold * factor)


@dataclass(frozen=True, eq=False)
class Resistance:
    """What was felt. Torques in N m at the joint; positions s as share of the range; NaN where there is none.

    Attributes:
        joint: the joint under test.
        hand: what felt it.
        course: (51,) resistance max(r, 0), where the limb first passes each of `PLACES`; beyond what is
            reached the last value.
        usual: (51,) what a healthy limb of that size resists with.
        baseline: mean r before the stretch.
        onset: s where an increase is first felt.
        peak: largest excess.
        peak_usual: usual resistance at that place.
        mean: excess where there is any, mean over the whole range.
        end: excess at the end of the hold.
        catch: whether there is a sudden rise that ends in a corner.
        catch_time: s, in the trial.
        catch_angle: rad, of the joint.
        catch_position: s.
        catch_size: the sudden rise.
        released: whether the excess falls to less than half while the limb still moves: of the catch's height, or of
            its largest where nothing is sudden.
        mean_after_catch: excess, mean over the range passed after the catch.
        peak_after_catch: largest excess from the catch on.
        range_affected: share of the range where an increase is felt, what is not reached included.
        range_lost: share of the range that is not reached by the end of the hold, though it usually is.
    """

    joint: str
    hand: Hand
    course: Array
    usual: Array
    baseline: float
    onset: float
    peak: float
    peak_usual: float
    mean: float
    end: float
    catch: bool
    catch_time: float
    catch_angle: float
    catch_position: float
    catch_size: float
    released: bool
    mean_after_catch: float
    peak_after_catch: float
    range_affected: float
    range_lost: float

    def felt(self, *, force: float = 1.0, usual: float = 1.0, perception: float = 1.0) -> Resistance:
        """The same limb in another hand; all 1 gives back what is here.

        Args:
            force: resistance seems this much larger.
            usual: that hand is used to this much more.
            perception: factor of what is just felt.
        """
        hand = replace(self.hand, perception=self.hand.perception * perception)
        course, known = self.course * force, self.usual * usual
        onset, mean, affected = _along(course, known, hand, self.range_lost)
        return replace(
            self, hand=hand, course=course, usual=known, onset=onset, mean=mean, range_affected=affected,
            peak=(self.peak + self.peak_usual) * force - self.peak_usual * usual, peak_usual=self.peak_usual * usual,
            catch_size=self.catch_size * force,
        )  # fmt: skip


def usual_resistance(record: Record) -> Usual:
    """What a hand gets used to: the resistance of a healthy limb in the same trial.

    Raises:
        SettingsError, SimulationError: as in `read_resistance`.
    """
    time, s, r = _signals(record)
    last = time > time[-1] - SUDDEN
    return Usual(_course(s, r, time >= REST), float(r[last].mean()), float(min(s[last].mean(), 1.0)))


def read_resistance(record: Record, hand: Hand, usual: Usual | None = None) -> Resistance:
    """Read a passive stretch.

    A catch is the first rise within `SUDDEN` that is at least half of the largest, can be felt, sets in after
    `START_ZONE` and before `END_ZONE`, and ends in a corner (`CORNER`): the resistance of a strained tissue keeps
    rising with the angle.

    Args:
        record: of a passive stretch, ``"mas"`` as a rule.
        hand: what feels it, see `hand_on`.
        usual: what a healthy limb of that size resists with; None: nothing.

    Raises:
        SettingsError: no passive stretch.
        SimulationError: a record that failed, has too few samples, or values that are not finite.
    """
    time, s, r = _signals(record)
    trial = record.trial
    known = np.maximum(np.zeros(len(PLACES)) if usual is None else usual.course, 0.0)
    hold = 0.0 if usual is None else max(usual.hold, 0.0)
    moving = (time >= REST) & (time <= REST + trial.movement_time + SUDDEN)
    last = time > time[-1] - SUDDEN
    reached = float(np.clip(s[last].mean(), 0.0, 1.0))
    whole = 1.0 if usual is None else usual.reached
    lost = max(whole - reached, 0.0)
    course = np.maximum(_course(s, r, time >= REST), 0.0)
    onset, mean, affected = _along(course, known, hand, lost)

    excess = np.maximum(r, 0.0) - np.interp(s, PLACES, known)
    top = int(np.argmax(np.where(moving, excess, -np.inf)))
    peak = float(excess[top])
    found = _catch(time, s, excess, moving)
    caught = found is not None and found[1] >= hand.perception * hand.lever_arm
    t, size = found if found and caught else (math.nan, math.nan)
    place = float(np.interp(t, time, s)) if caught else math.nan
    after = moving & (time >= t)
    beyond = (place <= PLACES) & (reached >= PLACES)
    return Resistance(
        joint=trial.joint,
        hand=hand,
        course=course,
        usual=known,
        baseline=float(r[time < REST].mean()),
        onset=onset,
        peak=peak,
        peak_usual=float(np.interp(s[top], PLACES, known)),
        mean=mean,
        end=float(max(r[last].mean(), 0.0) - hold),
        catch=caught,
        catch_time=t,
        catch_angle=trial.start + place * (trial.end - trial.start),
        catch_position=place,
        catch_size=size,
        released=_released(time, s, excess, moving, found[0] if found else None),
        mean_after_catch=float((course - known)[beyond].mean()) if beyond.any() else math.nan,
        peak_after_catch=float(excess[after].max()) if caught else math.nan,
        range_affected=affected,
        range_lost=lost,
    )


def _signals(record: Record) -> tuple[Array, Array, Array]:
    """Time, share of the range, smoothed resistance; or what is wrong with the record."""
    trial = record.trial
    if trial.test not in TESTS[:3] or trial.joint not in JOINTS or trial.direction == 0:
        raise SettingsError(f"trial {trial.name!r} is no passive stretch: resistance is read from {TESTS[:3]}")
    if record.failure:
        raise SimulationError(f"trial {trial.name!r} failed ({record.failure}): there is no resistance to read")
    time, joint = np.asarray(record.time), JOINTS.index(trial.joint)
    least = REST + 2 * SUDDEN
    if len(time) < 20 or time[-1] < least:
        end = f"{time[-1]:.3g} s" if len(time) else "the start"
        raise SimulationError(
            f"trial {trial.name!r} has {len(time)} samples to {end}: "
            f"at least 20 to {least:.3g} s are needed; simulate it anew"
        )
    q = np.asarray(record.qpos, dtype=np.float64)[:, joint]
    r = trial.direction * (record.examiner_torque[:, joint] - record.inertia * record.qacc[:, joint])
    broken = ~(np.isfinite(q) & np.isfinite(r))
    if broken.any():
        at = time[int(np.argmax(broken))]
        raise SimulationError(f"trial {trial.name!r} is not finite at {at:.3f} s ({trial.joint}): simulate it anew")
    step = float(time[-1] - time[0]) / (len(time) - 1)
    return time, (q - trial.start) / (trial.end - trial.start), _smooth(r, SMOOTH / step)


def _smooth(values: Array, sigma: float) -> Array:
    """Gaussian of ``sigma`` samples, ends weighted anew."""
    half = math.ceil(4 * sigma)
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    weight = np.convolve(np.ones(len(values)), kernel)[half:-half]
    smooth: Array = np.convolve(values, kernel)[half:-half] / weight
    return smooth


def _course(s: Array, r: Array, moving: NDArray[np.bool_]) -> Array:
    """(51,) resistance where the limb first passes each place."""
    s, r = s[moving], r[moving]
    furthest = np.maximum.accumulate(s)
    new = np.concatenate([[True], np.diff(furthest) > 1e-9])
    course: Array = np.interp(PLACES, furthest[new], r[new])
    return course


def _along(course: Array, usual: Array, hand: Hand, lost: float) -> tuple[float, float, float]:
    """Onset, mean excess, share of the range affected."""
    excess = course - usual
    margin = excess - hand.perception * hand.lever_arm - hand.tolerance * usual
    places = (np.arange(2000) + 0.5) / 2000  # the course crosses what is just felt between its places
    more = np.interp(places, PLACES, margin) > 0
    onset = float(places[np.argmax(more)]) if more.any() else math.nan
    return (
        onset,
        float(np.interp(places, PLACES, np.maximum(excess, 0.0)).mean()),
        float(np.mean(more | (places > 1.0 - lost))),
    )


def _released(time: Array, s: Array, excess: Array, moving: NDArray[np.bool_], catch: float | None) -> bool:
    """Whether it gives way, whatever its size: half of the top is lost before .95 of the way are made."""
    near = moving if catch is None else moving & (time >= catch) & (time <= catch + 2 * SUDDEN)
    top = int(np.argmax(np.where(near, excess, -np.inf)))
    way = moving & (np.arange(len(time)) > top) & (np.maximum.accumulate(s) < 0.95 * s.max())
    return bool(excess[top] > 0 and (excess[way] < 0.5 * excess[top]).any())


def _catch(time: Array, s: Array, excess: Array, moving: NDArray[np.bool_]) -> tuple[float, float] | None:
    """Time and size of a sudden rise that ends in a corner; its size may be too small to be felt."""
    half = SUDDEN / 2
    felt = np.maximum(excess, 0.0)
    rise = np.interp(time + half, time, felt) - np.interp(time - half, time, felt)
    rise = np.where(moving & (s >= START_ZONE), rise, -np.inf)
    inner = (rise[1:-1] > rise[:-2]) & (rise[1:-1] >= rise[2:]) & (rise[1:-1] >= 0.5 * rise.max()) & (rise[1:-1] > 0)
    for i in np.flatnonzero(inner) + 1:
        t0, t1 = time[i] - half, time[i] + half
        before, at = np.interp((t0, t1), time, s)
        if np.interp(time[i], time, s) >= END_ZONE:
            return None
        steep = rise[i] / max(at - before, 1e-3)
        furthest = np.maximum.accumulate(s)
        stop = min(at + _BEYOND, float(furthest[moving].max()))
        if stop - at < 0.25 * _BEYOND:  # stopped, by the catch or by the end of the range
            yields = felt[time > t1].max(initial=0.0) < np.interp(t1, time, felt) + rise[i]  # a wall is pushed harder
            return (float(time[i]), float(rise[i])) if yields and stop < 1.0 - 0.25 * _BEYOND else None
        then = time[int(np.argmax(furthest >= stop))]
        if np.interp(then, time, felt) - np.interp(t1, time, felt) < CORNER * steep * (stop - at):
            return float(time[i]), float(rise[i])
    return None

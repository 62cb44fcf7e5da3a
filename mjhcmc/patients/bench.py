"""Clinical tests on the muscle-driven leg: many patients and trials in lock step.

Muscles are driven by tone, reflexes and co-contraction alone. Joints that the trial holds still, and the joint that a
machine moves, are led as prescribed joints are (see `surroundings`): so heavy that nothing else matters to them, and
put back onto their course at each control period; what that takes is the examiner's torque. The joint in an examiner's
hand carries that hand's inertia. Each trial is what it is alone, to the last bit, in any company.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError
from mjhcmc.hosted.fiber_speed import fiber_lengths, fiber_speeds
from mjhcmc.hosted.lockstep import HillLockstep
from mjhcmc.hosted.muscles import HostedMuscles, hosted_muscles
from mjhcmc.leg8.table import JOINTS, MUSCLES
from mjhcmc.lockstep import Lockstep, Seen
from mjhcmc.model import MuscleModel
from mjhcmc.patients.drive import ANTAGONISTS, drive_of
from mjhcmc.patients.examiner import Arm, Arms, arm_at, strength_at
from mjhcmc.patients.patient import Patient
from mjhcmc.patients.record import Record
from mjhcmc.patients.reflex import ReflexArc, ReflexLaw
from mjhcmc.patients.trials import REST, Trial, min_jerk
from mjhcmc.plant import State
from mjhcmc.surroundings import HEAVY, Surroundings, heavy

Array = NDArray[np.float64]
Ids = NDArray[np.intp]

_GRAVITY = 9.80665  # m/s^2
_JUDGED = 0.05  # s, from one look of a machine at its torque to the next
_AT_ONCE = 96  # trials; more do not fit the processor's cache
CURVES = "millard"
"""Of patients' Hill muscles."""


class Clock(NamedTuple):
    """How time is cut: physics steps of ``step`` s, ``n_step`` of them a control period."""

    step: float
    n_step: int

    @property
    def period(self) -> float:
        """s."""
        return self.step * self.n_step


LED = Clock(0.01, 1)
"""Where the course is given, only activations are integrated."""

FREE = Clock(0.005, 1)
"""Of hip and knee."""

LIGHT = Clock(0.00125, 2)
"""Of the ankle, whose damping by active muscles is stiff beside the foot's inertia."""


_STRETCHING = 0.00125  # s, largest step of muscles whose tendons stretch: fibers are stiff


def clock_of(trial: Trial, muscle: str = "mujoco") -> Clock:
    """How a trial's time is cut.

    Args:
        trial: the trial.
        muscle: the kind of muscles, see `Patient`.
    """
    clock = LED if trial.examiner == "servo" else LIGHT if trial.joint == "ankle" else FREE
    times = math.ceil(clock.step / _STRETCHING - 1e-9) if muscle == "compliant" else 1
    return Clock(clock.step / times, clock.n_step * times)


@dataclass(frozen=True, eq=False)
class Case:
    """A patient in a trial.

    Attributes:
        patient: the patient.
        model: the patient's leg.
        trial: what is asked for; of a patient at rest.
    """

    patient: Patient
    model: MuscleModel
    trial: Trial


def run_trials(cases: Sequence[Case], *, threads: int = 1, finer: int = 1) -> list[Record]:
    """Carry out trials on patients who do not move by will: passive stretches, the pendulum test.

    Args:
        cases: any mixture of patients and trials.
        threads: to compute on.
        finer: divides physics steps and control periods, to see what they cost in accuracy.

    Returns:
        A record for each case, in their order; one whose simulation fails names the reason.

    Raises:
        SettingsError: a trial of a movement by will, a leg of other joints or muscles than leg8's, or a rate that the
            trial's clock does not divide.
        MjhcmcError: a patient's muscles or leg cannot be simulated at all.
    """
    if not isinstance(finer, int) or finer < 1:
        raise SettingsError(f"finer must be a whole number of at least 1; got {finer!r}")
    for case in cases:
        _check(case)
    groups: dict[tuple[Clock, str, str, float], list[int]] = {}
    for i, case in enumerate(cases):
        key = clock_of(case.trial, case.patient.muscle), case.patient.muscle, case.patient.reflex, case.trial.rate
        groups.setdefault(key, []).append(i)
    found: dict[int, Record] = {}
    for (clock, *_), members in groups.items():
        members.sort(key=lambda i: (-cases[i].trial.duration, i))
        cut = Clock(clock.step / finer, clock.n_step)
        for first in range(0, len(members), _AT_ONCE):
            some = members[first : first + _AT_ONCE]
            found.update(zip(some, _Team([cases[i] for i in some], cut, threads).run(), strict=True))
    return [found[i] for i in range(len(cases))]


def _check(case: Case) -> None:
    """Raise SettingsError where a trial cannot be carried out on the leg."""
    trial, model = case.trial, case.model
    if not trial.joint:
        raise SettingsError(f"trial {trial.name!r} is a movement by will: let the patient move (`patients.move`)")
    if model.dof_names != JOINTS or model.muscle_names != MUSCLES:
        raise SettingsError(f"trial {trial.name!r}: model {model.name!r} is not leg8 with its fixed pelvis: use leg_of")
    periods = 1.0 / (trial.rate * clock_of(trial).period)
    if abs(periods - round(periods)) > 1e-6 or round(periods) < 1:
        raise SettingsError(
            f"trial {trial.name!r}: a rate of {trial.rate:g} Hz is not kept by control periods of "
            f"{1e3 * clock_of(trial).period:g} ms: choose {1 / clock_of(trial).period:g} Hz or a whole part of it"
        )


class _Team:
    """Trials that share a clock, a kind of muscle, a law of reflexes and a rate; the longest first."""

    def __init__(self, cases: list[Case], clock: Clock, threads: int) -> None:
        self._cases, self._clock, b = cases, clock, len(cases)
        trials = [case.trial for case in cases]
        self._drives = [drive_of(case.patient, case.trial.session) for case in cases]
        self._joint = np.array([JOINTS.index(trial.joint) for trial in trials])
        self._machine = np.array([trial.examiner == "servo" for trial in trials])
        self._led = np.ones((b, len(JOINTS)), dtype=bool)
        self._led[np.arange(b), self._joint] = self._machine
        self._inertia = [limb_inertia(case.model, case.trial) for case in cases]
        arms = [
            arm_at(trial.joint, case.patient.height, inertia) if trial.examiner == "torque" else None
            for case, trial, inertia in zip(cases, trials, self._inertia, strict=True)
        ]
        self._most = np.array(
            [strength_at(t.joint, case.patient.height) for t, case in zip(trials, cases, strict=True)]
        )
        self._stopped = np.full(b, np.inf)
        self._arms, self._hand = Arms(arms), np.array([arm.hand if arm else 0.0 for arm in arms])
        self._bodies = [_body(case, led, arm) for case, led, arm in zip(cases, self._led, arms, strict=True)]
        nothing, kind = [Surroundings()] * b, cases[0].patient.muscle
        self._hill: list[HostedMuscles] = []
        if kind == "mujoco":
            self._plants = Lockstep(self._bodies, clock.step, nothing, threads)
        else:
            self._hill = [hosted_muscles(body, CURVES, kind) for body in self._bodies]
            self._plants = HillLockstep(self._bodies, self._hill, clock.step, nothing, threads)
        self._strength = np.stack([body.max_isometric_force for body in self._bodies])
        self._fibers = fibers_of(self._bodies, self._hill)
        self._pose = np.array([trial.pose for trial in trials])
        self._start, self._end, self._time = (
            np.array([getattr(trial, name) for trial in trials]) for name in ("start", "end", "movement_time")
        )

    def run(self) -> list[Record]:
        """Carry out the trials."""
        clock, plants, b, trials = self._clock, self._plants, len(self._cases), [case.trial for case in self._cases]
        n_period = np.array([round(trial.duration / clock.period) for trial in trials])
        every = round(1.0 / (trials[0].rate * clock.period))
        judge = max(1, round(_JUDGED / clock.period))
        arc, at = ReflexArc(self._law()), plants.layout
        tone = np.stack([drive.tone for drive in self._drives])
        spill = np.array([[drive.cocontraction] for drive in self._drives])
        rows = plants.rows([self._first(i, tone[i]) for i in range(b)])
        samples = _Samples(int(n_period.max()) // every + 1, b, len(MUSCLES))
        failed = np.full(b, -1)
        always = self._drives[0].mode == "force"
        unheld = plants.look(np.arange(b), rows, np.zeros((b, len(JOINTS))))
        self._arms.begin(unheld.qacc[np.arange(b), self._joint])
        for k in range(int(n_period.max()) + 1):
            ids = np.flatnonzero((n_period >= k) & (failed < 0))
            if not len(ids):
                break
            now, one, joint = rows[ids], np.arange(len(ids)), self._joint[ids]
            q, v, a = self._desired(ids, k * clock.period)
            middle = self._desired(ids, (k + 0.5) * clock.period)[2]  # second order, where a torque is held
            self._lead(ids, now, q, v)
            tested = np.zeros((len(ids), len(JOINTS)))
            lag, slip = q - now[one, at.qpos.start + joint], v - now[one, at.qvel.start + joint]
            tested[one, joint] = self._arms.torque(ids, lag, slip, middle, clock.period)
            pushed, sampled = self._push(ids, a), k % every == 0
            judged = k % judge == 0 and bool(self._machine[ids].any())
            seen = plants.look(ids, now, tested + pushed) if sampled or always or judged else None
            path = plants.path(ids, now) if seen is None else seen.path
            length, speed = self._fibers(ids, now[:, at.activation], now[:, at.fiber], path)
            reflex = arc.step(ids, speed, None if seen is None else seen.force / self._strength[ids])
            u = np.clip(tone[ids] + reflex + spill[ids] * (reflex @ ANTAGONISTS), 0.0, 1.0)
            if seen is not None and (sampled or judged):
                torque = np.where(self._led[ids], pushed - HEAVY * seen.qacc, tested)
                torque[one, joint] -= self._hand[ids] * seen.qacc[one, joint]
            if judged:
                stops = self._machine[ids] & (np.abs(torque[one, joint]) > self._most[ids])
                self._stopped[ids[stops]] = np.minimum(self._stopped[ids[stops]], k * clock.period)
            if sampled and seen is not None:
                samples.keep(
                    k // every, ids, now[:, at.qpos], now[:, at.qvel], seen, torque, u, reflex, now[:, at.activation],
                    length, speed,
                )  # fmt: skip
            rows[ids] = plants.step(ids, now, u, tested + self._push(ids, middle), clock.n_step)
            failed[ids[~np.isfinite(rows[ids]).all(axis=1)]] = k
        return [self._record(i, samples, every, int(n_period[i]), int(failed[i])) for i in range(b)]

    def _law(self) -> ReflexLaw:
        """Of all trials; what is held over a control period is the reflex in its middle."""
        first, half = self._drives[0], self._clock.period / 2
        return ReflexLaw(
            first.mode,
            np.stack([drive.gain for drive in self._drives]),
            np.stack([drive.threshold for drive in self._drives]),
            np.array([max(drive.delay - half, 0.0) for drive in self._drives]),
            self._clock.period,
        )

    def _first(self, i: int, tone: Array) -> State:
        pose, none = self._pose[i].copy(), np.zeros(len(JOINTS))
        pose[self._joint[i]] = self._start[i]
        least = self._hill[i].excitation_range(self._bodies[i])[:, 0] if self._hill else 0.0
        return State(0.0, pose, none, np.maximum(tone, least), none)

    def _desired(self, ids: Ids, time: float) -> tuple[Array, Array, Array]:
        """Where the joints under test are to be; a machine that met too much stands still."""
        stopped = self._stopped[ids]
        q, v, a = min_jerk(np.minimum(time, stopped) - REST, self._start[ids], self._end[ids], self._time[ids])
        moving = time < stopped
        return q, v * moving, a * moving

    def _lead(self, ids: Ids, rows: Array, q: Array, v: Array) -> None:
        """Put what is held, or moved by a machine, where it is to be."""
        at, led = self._plants.layout, self._led[ids]
        pose, speed = self._pose[ids].copy(), np.zeros(led.shape)
        one, joint = np.arange(len(ids)), self._joint[ids]
        pose[one, joint], speed[one, joint] = q, v
        rows[:, at.qpos] = np.where(led, pose, rows[:, at.qpos])
        rows[:, at.qvel] = np.where(led, speed, rows[:, at.qvel])

    def _push(self, ids: Ids, a: Array) -> Array:
        """(b, 3) N m, what accelerates the joints that a machine moves."""
        push = np.zeros((len(ids), len(JOINTS)))
        push[np.arange(len(ids)), self._joint[ids]] = np.where(self._machine[ids], HEAVY * a, 0.0)
        return push

    def _times(self, n: int, every: int) -> Array:
        return np.asarray(every * self._clock.period * np.arange(n), dtype=np.float64)

    def _record(self, i: int, samples: _Samples, every: int, n_period: int, failed: int) -> Record:
        case = self._cases[i]
        n = (n_period if failed < 0 else failed) // every + 1
        why = ""
        if failed >= 0:
            told = self._plants.fault(i) or "the simulation diverged"
            why = f"{case.trial.name} at {failed * self._clock.period:.3f} s: {told}"
        seen = samples.seen(i, n)
        return Record(
            case.trial, self._times(n, every), samples.qpos[:n, i].copy(),
            samples.qvel[:n, i].copy(), seen.qacc, samples.torque[:n, i].copy(), self._inertia[i],
            samples.excitation[:n, i].copy(), samples.reflex[:n, i].copy(), samples.activation[:n, i].copy(),
            samples.fiber_length[:n, i].copy(), samples.fiber_velocity[:n, i].copy(), self._plants.pulled(i, seen),
            failure=why,
        )  # fmt: skip


class _Samples:
    """What is kept of all trials: (n, b, ...) each."""

    def __init__(self, n: int, b: int, n_muscle: int) -> None:
        of_joints, of_muscles = (n, b, len(JOINTS)), (n, b, n_muscle)
        self.qpos, self.qvel, self.qacc, self.torque = (np.full(of_joints, np.nan) for _ in range(4))
        self.excitation, self.reflex, self.activation = (np.full(of_muscles, np.nan) for _ in range(3))
        self.fiber_length, self.fiber_velocity = (np.full(of_muscles, np.nan) for _ in range(2))
        self.force, self.ten_velocity = (np.full(of_muscles, np.nan) for _ in range(2))
        self.path = np.full((*of_muscles, 2), np.nan)

    def keep(
        self, s: int, ids: Ids, qpos: Array, qvel: Array, seen: Seen, torque: Array, u: Array, reflex: Array, a: Array,
        length: Array, speed: Array,
    ) -> None:  # fmt: skip
        """Keep sample s of the trials."""
        for name, value in (
            ("qpos", qpos), ("qvel", qvel), ("qacc", seen.qacc), ("torque", torque), ("excitation", u),
            ("reflex", reflex), ("activation", a), ("fiber_length", length), ("fiber_velocity", speed),
            ("force", seen.force), ("ten_velocity", seen.ten_velocity), ("path", seen.path),
        ):  # fmt: skip
            getattr(self, name)[s, ids] = value

    def seen(self, i: int, n: int) -> Seen:
        """What was seen of trial i."""
        return Seen(*(getattr(self, name)[:n, i].copy() for name in Seen._fields))


def fibers_of(
    models: Sequence[MuscleModel], hill: Sequence[HostedMuscles]
) -> Callable[[Ids, Array, Array, Array], tuple[Array, Array]]:
    """Fiber lengths and velocities of the muscles in use.

    Of MuJoCo's muscles, whose fibers are what their tendons are not: L = r0 + (l - l0)/L0 and V = l'/L0 along the path
    (see `MuscleModel.optimal_fiber_length`). Of Hill muscles, the fiber's own.

    Args:
        models: one a simulation.
        hill: the Hill muscles, one a simulation; none: MuJoCo's.

    Returns:
        A function of simulations (b,), activations (b, n), fiber lengths (b, n) m where tendons are compliant, and
        paths (b, n, 2) m and m/s, to lengths (b, n) in optimal fiber lengths, and velocities a second.
    """
    if hill:
        p, kind, curves = np.stack([own.parameters for own in hill]), hill[0].kind, hill[0].curves

        def of_hill(ids: Ids, activation: Array, fiber: Array, path: Array) -> tuple[Array, Array]:
            own, length, velocity = p[ids], *np.moveaxis(path, -1, 0)
            speeds = fiber_speeds(kind, curves, own, activation, fiber, length, velocity)
            return fiber_lengths(kind, own, fiber, length), speeds

        return of_hill
    optimal = np.stack([model.optimal_fiber_length for model in models])
    first = np.stack([model.mj_model.actuator_gainprm[model.muscle_ids, 0] for model in models])
    shortest = np.stack([model.mj_model.actuator_lengthrange[model.muscle_ids, 0] for model in models])

    def of_mujoco(ids: Ids, activation: Array, fiber: Array, path: Array) -> tuple[Array, Array]:
        L0 = optimal[ids]
        return first[ids] + (path[:, :, 0] - shortest[ids]) / L0, path[:, :, 1] / L0

    return of_mujoco


def _body(case: Case, led: NDArray[np.bool_], arm: Arm | None) -> MuscleModel:
    """The leg as the trial has it: what is led is heavy, what a hand holds carries the hand."""
    m = heavy(copy.copy(case.model.mj_model), np.flatnonzero(led))
    m.opt.gravity[:] = gravity_of(case.trial)
    if arm is not None:
        m.dof_armature[JOINTS.index(case.trial.joint)] += arm.hand
    return replace(case.model, mj_model=m)


def gravity_of(trial: Trial) -> tuple[float, float, float]:
    """m/s^2, as the pelvis sees it."""
    if trial.posture == "side_lying":
        return 0.0, -_GRAVITY, 0.0
    if trial.posture == "seated":  # at right angles to the thigh
        return -_GRAVITY * math.cos(trial.pose[0]), 0.0, -_GRAVITY * math.sin(trial.pose[0])
    return 0.0, 0.0, -_GRAVITY


def limb_inertia(model: MuscleModel, trial: Trial) -> float:
    """kg m^2, of the limb about the joint under test, the other joints held: what an examiner's torque also moves.

    Args:
        model: the patient's leg.
        trial: one with a joint under test.
    """
    m = model.mj_model
    d, joint = mujoco.MjData(m), JOINTS.index(trial.joint)
    d.qpos[:] = trial.pose
    d.qpos[joint] = trial.start
    mujoco.mj_forward(m, d)
    M = np.empty((m.nv, m.nv))
    mujoco.mj_fullM(m, d, M)
    return float(M[joint, joint])

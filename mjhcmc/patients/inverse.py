"""Inverse: excitations from what instruments saw of a passive stretch, by HCMC, and how well reflexes are recovered.

The joint under test is tracked by its muscles, the joints that the examiner holds are prescribed, and what the examiner
applies to the joint under test acts from outside, as measured. Nothing is known of the patient's reflexes, tone and
co-contraction, and of the muscles only what the given leg says: that of a healthy person of the patient's height and
mass or, to see what not knowing better costs, the patient's own.

What no such inference can tell, however exact the measurements:

- One joint's moment is one number, its muscles are several. Least effort shares it by moment arm and strength: within
  the group (rect_fem and vasti, gastroc and soleus), and with others that pull the same way (at the hip, rect_fem beside
  iliopsoas). So judge the group, not the muscle.
- Muscles that pull against each other cancel out. Least effort has none of it: tone and co-contraction of antagonists
  stay unseen, and of a reflex what its antagonists take back.
- Size goes with strength: a muscle half as strong as the leg's, half excited, is taken for one quarter excited.
- A passive moment that the leg lacks (contracture) is taken for excitation that grows with the angle. A slow stretch of
  the same joint tells it, and with it the tone; see ``slow``.
"""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from mjhcmc.errors import MjhcmcError, MjhcmcWarning, MotionError, SettingsError
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.leg8.builder import FLEXION_AXIS, build_leg8
from mjhcmc.leg8.table import JOINTS, MUSCLES, load_table
from mjhcmc.methods.hcmc_batch import hcmc_batch
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.patients.bench import _gravity
from mjhcmc.patients.bursts import SHORTEST, THRESHOLD, BurstScore, Quartiles, quartiles, score_burst
from mjhcmc.patients.groups import GROUPS, TESTED
from mjhcmc.patients.leg import leg_of
from mjhcmc.patients.patient import Patient, healthy
from mjhcmc.patients.record import Record
from mjhcmc.patients.sensors import EMG_MUSCLES, Observation, observe
from mjhcmc.patients.trials import REST, Trial
from mjhcmc.signals import check_cutoff, zero_phase_lowpass
from mjhcmc.solution import Solution

Array = NDArray[np.float64]

MODELS = ("generic", "own")
"""Legs to infer with: leg8 at the patient's height and mass; the patient's own, as if all but the drive were known."""

LOWPASS_HZ = 10.0
DT = 0.01
PHYSICS_DT = 0.0025

SETTLED = 0.1
"""s, after which the limb has settled in the examiner's hands: before, nothing is judged."""

_SLOW_HZ = 1.0  # cutoff of a slow stretch, in which nothing is fast
_ANGLES = 60  # at which a slow stretch's torque is kept
_FEWEST = 10  # samples


@dataclass(frozen=True, eq=False)
class Recovery:
    """What was inferred from a trial, beside what was. n samples, at the trial's rate from `SETTLED` on.

    Attributes:
        trial: the trial.
        time: (n,) s.
        excitation: (n, 8) inferred, each beside its median before the stretch.
        reflex: (n, 8) the reflex that there was, within 0 .. 1.
        moment: (n,) N m, inferred of muscles at the joint under test.
        true_moment: (n,) N m, the same as it was.
        reserve: N m, the largest at the joint under test: what the leg's muscles could not give.
        group: score of the stretched group, whose muscles count by leg8's max isometric force; None where it failed.
        muscles: scores of the group's muscles, each by itself.
        failure: why there is nothing; empty where there is.
    """

    trial: Trial
    time: Array = field(repr=False)
    excitation: Array = field(repr=False)
    reflex: Array = field(repr=False)
    moment: Array = field(repr=False)
    true_moment: Array = field(repr=False)
    reserve: float = 0.0
    group: BurstScore | None = None
    muscles: tuple[BurstScore, ...] = ()
    failure: str = ""

    @property
    def moment_error(self) -> float:
        """Root mean square error of the moment over the largest true one; NaN where it failed."""
        if self.failure:
            return math.nan
        peak = float(np.abs(self.true_moment).max())
        return float(np.sqrt(np.mean((self.moment - self.true_moment) ** 2))) / peak if peak else math.nan

    @classmethod
    def missing(cls, trial: Trial, failure: str) -> Recovery:
        """Of a trial that nothing could be inferred from.

        Args:
            trial: the trial.
            failure: why.
        """
        none, muscles = np.empty(0), np.empty((0, len(MUSCLES)))
        return cls(trial, none, muscles, muscles, none, none, failure=failure)


@dataclass(frozen=True)
class Summary:
    """Of many recoveries, by their groups.

    Attributes:
        n: recoveries.
        failed: without result.
        hits: bursts recovered.
        misses: bursts not recovered, or elsewhere.
        false_alarms: bursts recovered that there were not, or elsewhere.
        quiet: trials without burst in which none was recovered.
        onset_error: s, of hits, as the four that follow.
        peak_time_error: s.
        peak_ratio: recovered over true.
        area_ratio: recovered over true.
        correlation: the best within `bursts.MOST_LAG`, of trials with a true burst; and so
        lag: s.
        moment_error: see `Recovery`, of all.
    """

    n: int
    failed: int
    hits: int
    misses: int
    false_alarms: int
    quiet: int
    onset_error: Quartiles
    peak_time_error: Quartiles
    peak_ratio: Quartiles
    area_ratio: Quartiles
    correlation: Quartiles
    lag: Quartiles
    moment_error: Quartiles


def exact(record: Record) -> Observation:
    """What perfect instruments would have seen of a trial; their EMG is left out (0).

    Args:
        record: of a trial.
    """
    torque = record.examiner_torque[:, _joint(record.trial)]
    return Observation(record.time, record.qpos, record.qvel, torque, np.zeros((len(record.time), len(EMG_MUSCLES))))


def generic_leg(height: float, body_mass: float) -> MuscleModel:
    """Leg8 at a height (m) and body mass (kg); errors as `mjhcmc.leg8.builder.build_leg8`."""
    return MuscleModel.load(build_leg8(body_mass, height))


def infer(
    observations: Sequence[Observation],
    trials: Sequence[Trial],
    legs: Sequence[MuscleModel],
    *,
    slow: Sequence[Observation | None] | None = None,
    lowpass_hz: float = LOWPASS_HZ,
    dt: float = DT,
    physics_dt: float = PHYSICS_DT,
    threads: int = 1,
) -> list[Solution | MjhcmcError]:
    """Excitations from what instruments saw of passive stretches, by `hcmc_batch`.

    Args:
        observations: one a trial.
        trials: passive stretches, any mixture.
        legs: one a trial, of leg8's structure.
        slow: slow stretches of the same joints and patients, None for trials without. What they took at each angle
            beyond the leg's passive muscles is taken off the torque.
        lowpass_hz: cutoff of angle and torque alike, see `Motion.lowpassed`, Hz.
        dt: s, control window of `hcmc`.
        physics_dt: s, physics step.
        threads: to compute on.

    Returns:
        The solution of each, or why there is none.

    Raises:
        MotionError: a trial that is no passive stretch by an examiner, or samples that are too few, not finite, or of
            the wrong shape.
        SettingsError: lists of different length, or a setting outside its valid values.
    """
    extra = list(slow) if slow is not None else [None] * len(trials)
    for what, given in (("observations", observations), ("legs", legs), ("slow stretches", extra)):
        if len(given) != len(trials):
            raise SettingsError(f"{len(given)} {what} for {len(trials)} trials: give one a trial")
    check_cutoff(lowpass_hz)
    for trial, seen, other in zip(trials, observations, extra, strict=True):
        _check(trial, seen)
        if other is not None:
            _check(trial, other)
    found: dict[int, Solution | MjhcmcError] = {}
    for joint in JOINTS:  # a batch's models have one structure, and so the same joints held
        members = [i for i, trial in enumerate(trials) if trial.joint == joint]
        models = [_held(legs[i], trials[i]) for i in members]
        inputs = [
            _inputs(observations[i], trials[i], model, extra[i], lowpass_hz)
            for i, model in zip(members, models, strict=True)
        ]
        if members:
            results = _solve(models, inputs, dt, physics_dt, threads)
            found.update(zip(members, results, strict=True))
    return [found[i] for i in range(len(trials))]


def _solve(
    models: list[MuscleModel], inputs: list[tuple[Motion, ExternalLoads]], dt: float, physics_dt: float, threads: int
) -> list[Solution | MjhcmcError]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MjhcmcWarning)  # failures are in the results
            motions, loads = zip(*inputs, strict=True)
            batch = hcmc_batch(models, motions, dt, physics_dt, loads=loads, threads=threads)
    except SettingsError:
        raise
    except MjhcmcError as error:  # of all
        return [error] * len(models)
    return [batch.errors[i] if i in batch.errors else batch[i] for i in range(len(models))]


def _held(leg: MuscleModel, trial: Trial) -> MuscleModel:
    """The leg with the trial's gravity, its joints held but for the one under test."""
    m = copy.copy(leg.mj_model)
    m.opt.gravity[:] = _gravity(trial)
    return replace(leg, mj_model=m).with_roles(prescribed=[name for name in JOINTS if name != trial.joint])


def _inputs(
    seen: Observation, trial: Trial, model: MuscleModel, slow: Observation | None, lowpass_hz: float
) -> tuple[Motion, ExternalLoads]:
    """What to follow, and what acts from outside."""
    joint = _joint(trial)
    qpos = _pose(seen, joint)
    motion = Motion(seen.time, qpos, trial.name, joint_names=JOINTS).lowpassed(lowpass_hz)
    torque = zero_phase_lowpass(seen.torque[:, None], lowpass_hz, _step(seen))[:, 0]
    if slow is not None:
        torque = torque - _beyond_passive(slow, model, joint)(motion.qpos[:, joint])
    body = model.mj_model.body(model.mj_model.jnt_bodyid[joint]).name
    # What a free torque on the body does to the joints above is taken by what holds them.
    about = torque[:, None, None] * np.array(FLEXION_AXIS)
    none = np.zeros_like(about)
    return motion, ExternalLoads(f"examiner of {trial.name}", seen.time, (body,), none, about, none)


def _pose(seen: Observation, joint: int) -> Array:
    """(n, 3) rad: joints that are held at their mean, the one under test as gyro and angle tell together.

    The gyro's integral, with the offset and drift of least squares beside the angle: its noise is white in velocity,
    that of an angle in the angle, where the second derivative makes a hundred times as much of it.
    """
    qpos = np.tile(seen.qpos.mean(axis=0), (len(seen.time), 1))
    turned = cumulative_trapezoid(seen.qvel[:, joint], seen.time, initial=0.0)
    qpos[:, joint] = turned + np.polyval(np.polyfit(seen.time, seen.qpos[:, joint] - turned, 1), seen.time)
    return qpos


class _beyond_passive:
    """Torque of a slow stretch less that of the leg's passive muscles, by angle."""

    def __init__(self, slow, model, joint):
        qpos = _pose(slow, joint)
        torque = zero_phase_lowpass(slow.torque[:, None], _SLOW_HZ, _step(slow))[:, 0]
        order = np.argsort(qpos[:, joint])
        q, tau = qpos[order, joint], torque[order]
        edges = np.linspace(q[0], q[-1], _ANGLES + 1)
        which = np.clip(np.searchsorted(edges, q, side="right") - 1, 0, _ANGLES - 1)
        count = np.bincount(which, minlength=_ANGLES)
        ok = count > 0
        self.q = np.bincount(which, q, _ANGLES)[ok] / count[ok]
        tau = np.bincount(which, tau, _ANGLES)[ok] / count[ok]
        m = model.mj_model
        d = mujoco.MjData(m)
        passive = []
        for angle in self.q:
            d.qpos[:] = qpos[0]
            d.qpos[joint] = angle
            mujoco.mj_forward(m, d)
            passive.append(d.qfrc_actuator[joint] + d.qfrc_passive[joint] - d.qfrc_bias[joint])
        self.d = tau + np.array(passive)

    def __call__(self, q):
        return np.interp(q, self.q, self.d)


def recover(
    records: Sequence[Record],
    patients: Sequence[Patient],
    *,
    numbers: Sequence[int] | None = None,
    slow: Sequence[Record | None] | None = None,
    model: str = "generic",
    lowpass_hz: float = LOWPASS_HZ,
    dt: float = DT,
    physics_dt: float = PHYSICS_DT,
    threshold: float = THRESHOLD,
    shortest: float = SHORTEST,
    threads: int = 1,
) -> list[Recovery]:
    legs = {}
    for p in patients:
        if id(p) not in legs:
            legs[id(p)] = leg_of(p) if model == "own" else leg_of(healthy(p.height, p.body_mass)) if model == "healthy" else generic_leg(p.height, p.body_mass)
    trials = [r.trial for r in records]
    look = lambda r, p, k: None if r is None else exact(r) if numbers is None else observe(r, p.seed, p.index, k)
    obs = [look(r, p, numbers[i] if numbers is not None else 0) for i, (r, p) in enumerate(zip(records, patients))]
    sl = None if slow is None else [look(r, p, 1000 + (numbers[i] if numbers is not None else 0)) for i, (r, p) in enumerate(zip(slow, patients))]
    res = infer(obs, trials, [legs[id(p)] for p in patients], slow=sl, lowpass_hz=lowpass_hz, dt=dt, physics_dt=physics_dt, threads=threads)
    return [score(r, s, threshold=threshold, shortest=shortest) for r, s in zip(records, res)]


def score(record, found, *, threshold=THRESHOLD, shortest=SHORTEST):
    trial, joint = record.trial, _joint(record.trial)
    if not isinstance(found, Solution):
        return Recovery.missing(trial, f"{trial.name}: {found}")
    keep = record.time >= SETTLED - 1e-9
    time = record.time[keep]
    middles = found.time[:-1] + found.dt / 2
    u = np.stack([np.interp(time, middles, own) for own in found.excitation.T], axis=1)
    u = u - np.median(u[time <= REST], axis=0)
    reflex = np.clip(record.reflex[keep], 0.0, 1.0)
    true_moment = record.inertia * record.qacc[keep, joint] - record.examiner_torque[keep, joint]
    names = GROUPS[TESTED[trial.joint]]
    source = load_table()["source"]["muscles"]
    share = np.array([source[n]["max_isometric_force"] if n in names else 0.0 for n in MUSCLES])
    share = share / share.sum()
    group = score_burst(TESTED[trial.joint], time, reflex @ share, u @ share, threshold=threshold, shortest=shortest)
    muscles = tuple(score_burst(n, time, reflex[:, k], u[:, k], threshold=threshold, shortest=shortest) for k, n in ((MUSCLES.index(n), n) for n in names))
    return Recovery(trial, time, u, reflex, np.interp(time, found.time, found.net_joint_moment[:, joint]), true_moment, float(np.abs(found.reserve[:, joint]).max()), group, muscles)


def summary(recoveries):
    there = [r for r in recoveries if r.group is not None]
    scores = [r.group for r in there]
    count = {o: sum(s.outcome == o for s in scores) for o in ("hit", "miss", "false alarm", "elsewhere", "none")}
    q = lambda name: quartiles([getattr(s, name) for s in scores])
    tr = [s for s in scores if s.true is not None]
    return Summary(len(recoveries), len(recoveries) - len(there), count["hit"], count["miss"] + count["elsewhere"], count["false alarm"] + count["elsewhere"], count["none"], q("onset_error"), q("peak_time_error"), q("peak_ratio"), q("area_ratio"), quartiles([s.correlation for s in tr]), quartiles([s.lag for s in tr]), quartiles([r.moment_error for r in there]))


def _joint(trial: Trial) -> int:
    return JOINTS.index(trial.joint)


def _step(seen: Observation) -> float:
    return float(seen.time[-1] - seen.time[0]) / (len(seen.time) - 1)

def _check(trial, seen):
    pass

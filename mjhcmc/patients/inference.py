"""Inverse: excitations from what instruments saw of a passive stretch, by HCMC.

The joint under test is tracked by its muscles, the joints that the examiner holds are prescribed, and what the examiner
applies to the joint under test acts from outside, as measured. Nothing is known of the patient's reflexes, tone and
co-contraction, and of the muscles only what the given leg says: that of a healthy person of the patient's height and
mass or, to see what not knowing better costs, the patient's own.

What no such inference can tell, however exact the measurements:

- One joint's moment is one number, its muscles are several. Least effort shares it by moment arm and strength: within
  the group (rect_fem and vasti, gastroc and soleus), and with others that pull the same way (at the hip, rect_fem
  beside iliopsoas). So judge the group, not the muscle.
- Muscles that pull against each other cancel out. Least effort has none of it: tone and co-contraction of antagonists
  stay unseen, and of a reflex what its antagonists take back.
- Size goes with strength: a muscle half as strong as the leg's, half excited, is taken for one a quarter excited.
- A passive moment that the leg lacks (contracture) is taken for excitation that grows with the angle. A slow stretch of
  the same joint tells it: what it took at an angle beyond the leg's passive muscles is taken off the torque. With it
  goes tone, and what reflex the slow stretch itself met.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from mjhcmc.errors import MjhcmcError, MjhcmcWarning, MotionError, SettingsError
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.leg8.builder import FLEXION_AXIS
from mjhcmc.leg8.table import JOINTS
from mjhcmc.methods.hcmc_batch import hcmc_batch
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.patients.bench import gravity_of
from mjhcmc.patients.groups import TESTED
from mjhcmc.patients.sensors import Observation
from mjhcmc.patients.trials import Trial
from mjhcmc.signals import check_cutoff, zero_phase_lowpass
from mjhcmc.solution import Solution

Array = NDArray[np.float64]

LOWPASS_HZ: Mapping[str, float] = MappingProxyType({"hip": 6.0, "knee": 10.0, "ankle": 15.0})
"""Cutoff of angle and torque by joint: the heavier the limb, the more of its acceleration's noise is torque, and the
slower is what it does; at the ankle lower ones flatten clonus."""

DT = 0.01
"""s, control window: half of it costs twice the time and tells no more."""

PHYSICS_DT = 0.0025
"""s, physics step."""

_SLOW_HZ = 1.0  # cutoff of a slow stretch, in which nothing is fast
_SLOW_ANGLES = 60  # at which its torque is kept
_FEWEST = 10  # samples
_COARSEST = 0.1  # s, between samples


@dataclass(frozen=True, eq=False)
class Inference:
    """What was inferred from one trial.

    Attributes:
        trial: the trial.
        solution: of `hcmc`; None where it failed.
        time: (n,) s, of the samples.
        taken_off: (n,) N m, that the slow stretch took off the torque; 0 without one.
        failure: why there is no solution; empty where there is.
    """

    trial: Trial
    solution: Solution | None
    time: Array = field(repr=False)
    taken_off: Array = field(repr=False)
    failure: str = ""


def infer(
    observations: Sequence[Observation],
    trials: Sequence[Trial],
    legs: Sequence[MuscleModel],
    *,
    slow: Sequence[Observation | None] | None = None,
    lowpass_hz: float | None = None,
    dt: float = DT,
    physics_dt: float = PHYSICS_DT,
    threads: int = 1,
) -> list[Inference]:
    """Excitations from what instruments saw of passive stretches, by `hcmc_batch`.

    Args:
        observations: one a trial.
        trials: passive stretches, any mixture.
        legs: one a trial, of leg8's structure.
        slow: slow stretches of the same joints and patients, None for trials without.
        lowpass_hz: cutoff of angle and torque alike, Hz, see `mjhcmc.signals.zero_phase_lowpass`; None: the joint's of
            `LOWPASS_HZ`.
        dt: s, control window of `hcmc`.
        physics_dt: s, physics step.
        threads: to compute on.

    Returns:
        One a trial; one that fails names the reason.

    Raises:
        MotionError: a trial that is no passive stretch by an examiner, or samples that are too few, not finite, or of
            the wrong shape.
        SettingsError: lists of different length, or a setting outside its valid values.
    """
    extra = list(slow) if slow is not None else [None] * len(trials)
    for what, given in (("observations", observations), ("legs", legs), ("slow stretches", extra)):
        if len(given) != len(trials):
            raise SettingsError(f"{len(given)} {what} for {len(trials)} trials: give one a trial")
    if lowpass_hz is not None:
        check_cutoff(lowpass_hz)
    for trial, seen, other in zip(trials, observations, extra, strict=True):
        check_trial(trial)
        _check_samples(trial.name, seen)
        if other is not None:
            _check_samples(f"slow stretch for {trial.name}", other)
    found: dict[int, Inference] = {}
    for joint in JOINTS:  # a batch's models have one structure, and so the same joints held
        members = [i for i, trial in enumerate(trials) if trial.joint == joint]
        hz = LOWPASS_HZ[joint] if lowpass_hz is None else lowpass_hz
        tasks = [_task(observations[i], trials[i], legs[i], extra[i], hz) for i in members]
        if tasks:
            found.update(zip(members, _solve(tasks, dt, physics_dt, threads), strict=True))
    return [found[i] for i in range(len(trials))]


def check_trial(trial: Trial) -> None:
    """Raise MotionError unless a trial is a passive stretch by an examiner."""
    if trial.joint not in TESTED or not trial.examiner:
        raise MotionError(
            f"trial {trial.name!r} is no passive stretch by an examiner: infer from trials such as mas/knee"
        )


@dataclass(frozen=True, eq=False)
class _Task:
    """One inference: what `hcmc_batch` takes, and what the answer tells beside."""

    trial: Trial
    model: MuscleModel
    motion: Motion
    loads: ExternalLoads
    taken_off: Array


def _task(seen: Observation, trial: Trial, leg: MuscleModel, slow: Observation | None, lowpass_hz: float) -> _Task:
    """What to follow, and what acts from outside."""
    joint, m = _joint(trial), copy.copy(leg.mj_model)
    m.opt.gravity[:] = gravity_of(trial)
    held = replace(leg, mj_model=m).with_roles(prescribed=[name for name in JOINTS if name != trial.joint])
    motion = Motion(seen.time, _pose(seen, joint), trial.name, joint_names=JOINTS).lowpassed(lowpass_hz)
    torque = zero_phase_lowpass(seen.torque[:, None], lowpass_hz, _step(seen))[:, 0]
    taken = np.zeros_like(torque)
    if slow is not None:
        taken = np.interp(motion.qpos[:, joint], *_beyond_passive(slow, held, joint))
    # A free torque on the body: what it does to the joints above is taken by what holds them.
    about = (torque - taken)[:, None, None] * np.array(FLEXION_AXIS)
    none, body = np.zeros_like(about), str(m.body(int(m.jnt_bodyid[joint])).name)
    loads = ExternalLoads(f"examiner of {trial.name}", seen.time, (body,), none, about, none)
    return _Task(trial, held, motion, loads, taken)


def _solve(tasks: list[_Task], dt: float, physics_dt: float, threads: int) -> list[Inference]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MjhcmcWarning)  # failures are in the results
        try:
            batch = hcmc_batch(
                [task.model for task in tasks], [task.motion for task in tasks], dt, physics_dt,
                loads=[task.loads for task in tasks], threads=threads,
            )  # fmt: skip
            solved, errors = dict(batch.solved), dict(batch.errors)
        except SettingsError:
            raise
        except MjhcmcError as error:  # of all
            solved, errors = {}, dict.fromkeys(range(len(tasks)), error)
    return [
        Inference(task.trial, solved.get(i), task.motion.time, task.taken_off,
                  f"{task.trial.name}: {errors[i]}" if i in errors else "")
        for i, task in enumerate(tasks)
    ]  # fmt: skip


def _pose(seen: Observation, joint: int) -> Array:
    """(n, 3) rad: joints that are held at their mean, the one under test as gyro and angle tell together.

    It is the gyro's integral, with the offset and drift that least squares find beside the angle. The angle's own
    second derivative is ten times as noisy.
    """
    qpos = np.tile(seen.qpos.mean(axis=0), (len(seen.time), 1))
    turned = cumulative_trapezoid(seen.qvel[:, joint], seen.time, initial=0.0)
    qpos[:, joint] = turned + np.polyval(np.polyfit(seen.time, seen.qpos[:, joint] - turned, 1), seen.time)
    return qpos


def _beyond_passive(slow: Observation, model: MuscleModel, joint: int) -> tuple[Array, Array]:
    """Angles, rising, and what a slow stretch took at them beyond what the leg's muscles take without activation."""
    pose = _pose(slow, joint)
    torque = zero_phase_lowpass(slow.torque[:, None], _SLOW_HZ, _step(slow))[:, 0]
    edges = np.linspace(pose[:, joint].min(), pose[:, joint].max(), _SLOW_ANGLES + 1)
    bins = np.clip(np.searchsorted(edges, pose[:, joint], side="right") - 1, 0, _SLOW_ANGLES - 1)
    count = np.bincount(bins, minlength=_SLOW_ANGLES)
    angle, beyond = (
        np.bincount(bins, of, _SLOW_ANGLES)[count > 0] / count[count > 0] for of in (pose[:, joint], torque)
    )
    m = model.mj_model
    d = mujoco.MjData(m)
    for i, q in enumerate(angle):
        d.qpos[:] = pose[0]
        d.qpos[joint] = q
        mujoco.mj_forward(m, d)
        beyond[i] += d.qfrc_actuator[joint] + d.qfrc_passive[joint] - d.qfrc_bias[joint]
    return angle, beyond


def _joint(trial: Trial) -> int:
    return JOINTS.index(trial.joint)


def _step(seen: Observation) -> float:
    return float(seen.time[-1] - seen.time[0]) / (len(seen.time) - 1)


def _check_samples(name: str, seen: Observation) -> None:
    n = len(seen.time)
    if n < _FEWEST:
        raise MotionError(f"{name}: {n} samples: an inference needs at least {_FEWEST}")
    for what, shape in (("time", (n,)), ("qpos", (n, len(JOINTS))), ("qvel", (n, len(JOINTS))), ("torque", (n,))):
        value = np.asarray(getattr(seen, what))
        if value.shape != shape:
            raise MotionError(f"{name}: {what} has shape {value.shape}: give {shape}")
        bad = np.argwhere(~np.isfinite(value))
        if len(bad):
            raise MotionError(f"{name}: sample {bad[0][0]} (from 0): {what} is not finite: give finite values")
    steps = np.diff(seen.time)
    if not (steps.min() > 0 and steps.max() < 1.001 * steps.min() and steps.max() <= _COARSEST):
        raise MotionError(f"{name}: times must rise evenly, by {_COARSEST:g} s at most: resample it")

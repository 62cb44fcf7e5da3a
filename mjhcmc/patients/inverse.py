"""How well reflexes of simulated patients are recovered from what instruments saw of them (see `inference`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError
from mjhcmc.leg8.table import JOINTS, MUSCLES, load_table
from mjhcmc.model import MuscleModel
from mjhcmc.patients.bursts import SHORTEST, THRESHOLD, BurstScore, Quartiles, quartiles, score_burst
from mjhcmc.patients.groups import GROUPS, TESTED
from mjhcmc.patients.inference import DT, PHYSICS_DT, Inference, check_trial, infer
from mjhcmc.patients.leg import leg_of
from mjhcmc.patients.patient import Patient, healthy
from mjhcmc.patients.record import Record
from mjhcmc.patients.sensors import EMG_MUSCLES, Observation
from mjhcmc.patients.trials import REST, Trial

Array = NDArray[np.float64]

MODELS = ("generic", "own")
"""Legs to infer with: a healthy one of the patient's height and mass; the patient's own, as if all but the drive were
known."""

SETTLED = 0.1
"""s, after which the limb has settled in the examiner's hands: before, nothing is judged."""


@dataclass(frozen=True, eq=False)
class Recovery:
    """What was inferred from a trial, beside what was. n samples, at the trial's rate from `SETTLED` on.

    Attributes:
        trial: the trial.
        time: (n,) s.
        excitation: (n, 8) inferred, each beside its median before the stretch.
        reflex: (n, 8) the reflex that there was, within 0 .. 1.
        moment: (n,) N m, inferred of muscles at the joint under test, with what a slow stretch took off.
        true_moment: (n,) N m, of muscles as it was.
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
        """Root mean square error of the moment over the largest true one; NaN where there is neither."""
        peak = float(np.abs(self.true_moment).max(initial=0.0))
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
    """What perfect instruments would have seen of a trial by an examiner; their EMG is left out (0).

    Args:
        record: of the trial.

    Raises:
        MotionError: the trial has no examiner.
    """
    check_trial(record.trial)
    torque = record.examiner_torque[:, JOINTS.index(record.trial.joint)]
    return Observation(record.time, record.qpos, record.qvel, torque, np.zeros((len(record.time), len(EMG_MUSCLES))))


def leg_for(patient: Patient, model: str = "generic") -> MuscleModel:
    """The leg to infer with.

    Args:
        patient: of whom the generic leg knows height and mass; all else is of `mjhcmc.patients.patient.healthy`.
        model: one of `MODELS`.

    Raises:
        SettingsError: an unknown model.
    """
    if model not in MODELS:
        raise SettingsError(f"model {model!r} is not known: choose one of {', '.join(MODELS)}")
    return leg_of(patient if model == "own" else healthy(patient.height, patient.body_mass))


def recover(
    records: Sequence[Record],
    patients: Sequence[Patient],
    observations: Sequence[Observation] | None = None,
    *,
    slow: Sequence[Observation | None] | None = None,
    model: str = "generic",
    lowpass_hz: float | None = None,
    dt: float = DT,
    physics_dt: float = PHYSICS_DT,
    threshold: float = THRESHOLD,
    found_threshold: float | None = None,
    shortest: float = SHORTEST,
    threads: int = 1,
) -> list[Recovery]:
    """Infer excitations of simulated patients, and compare them with the reflexes that there were.

    Args:
        records: passive stretches; what only they know is looked at after the inference.
        patients: one a record.
        observations: one a record, as of `mjhcmc.patients.sensors.observe`; None: what perfect instruments see.
        slow: see `infer`.
        model: one of `MODELS`.
        lowpass_hz: see `infer`, as the two that follow.
        dt: s.
        physics_dt: s.
        threshold: excitation that a burst exceeds, see `bursts.find_burst`.
        found_threshold: the same of what was inferred; None: as the reflex. Lower finds what an underrated size hides.
        shortest: s, that it does so at least.
        threads: to compute on.

    Returns:
        One a record; one that was not simulated or inferred names the reason.

    Raises:
        MotionError: as `infer`.
        SettingsError: as `infer`; an unknown model; a threshold or duration of bursts that is not positive.
    """
    if len(patients) != len(records):
        raise SettingsError(f"{len(patients)} patients for {len(records)} records: give one a record")
    for name, value in (("observations", observations), ("slow stretches", slow)):
        if value is not None and len(value) != len(records):
            raise SettingsError(f"{len(value)} {name} for {len(records)} records: give one a record")
    legs = {patient: leg_for(patient, model) for patient in dict.fromkeys(patients)}
    there = [i for i, record in enumerate(records) if not record.failure]
    found = infer(
        [exact(records[i]) if observations is None else observations[i] for i in there],
        [records[i].trial for i in there],
        [legs[patients[i]] for i in there],
        slow=None if slow is None else [slow[i] for i in there],
        lowpass_hz=lowpass_hz, dt=dt, physics_dt=physics_dt, threads=threads,
    )  # fmt: skip
    recoveries = [Recovery.missing(record.trial, record.failure) for record in records]
    for i, inferred in zip(there, found, strict=True):
        recoveries[i] = score(
            records[i], inferred, threshold=threshold, found_threshold=found_threshold, shortest=shortest
        )
    return recoveries


def score(
    record: Record,
    found: Inference,
    *,
    threshold: float = THRESHOLD,
    found_threshold: float | None = None,
    shortest: float = SHORTEST,
) -> Recovery:
    """Compare what was inferred from a trial with what was.

    Args:
        record: what was.
        found: what was inferred.
        threshold: see `recover`, as the two that follow.
        found_threshold: see there.
        shortest: s.

    Raises:
        SettingsError: a threshold or duration that is not positive.
    """
    trial, solution = record.trial, found.solution
    if solution is None:
        return Recovery.missing(trial, found.failure)
    joint, keep = JOINTS.index(trial.joint), record.time >= SETTLED - 1e-9
    time = record.time[keep]
    middles = solution.time[:-1] + solution.dt / 2
    u = np.stack([np.interp(time, middles, own) for own in solution.excitation.T], axis=1)
    u -= np.median(u[time <= REST], axis=0)
    reflex = np.clip(record.reflex[keep], 0.0, 1.0)
    group = TESTED[trial.joint]
    share = _shares(group)
    moment = np.interp(time, solution.time, solution.net_joint_moment[:, joint])
    return Recovery(
        trial, time, u, reflex, moment - np.interp(time, found.time, found.taken_off),
        record.inertia * record.qacc[keep, joint] - record.examiner_torque[keep, joint],
        float(np.abs(solution.reserve[:, joint]).max()),
        score_burst(group, time, reflex @ share, u @ share, threshold, found_threshold, shortest),
        tuple(
            score_burst(name, time, reflex[:, m], u[:, m], threshold, found_threshold, shortest)
            for m, name in enumerate(MUSCLES) if name in GROUPS[group]
        ),
    )  # fmt: skip


def summary(recoveries: Sequence[Recovery]) -> Summary:
    """Sum up recoveries of a cohort, by their groups.

    Args:
        recoveries: of `recover`.
    """
    scores = [one.group for one in recoveries if one.group is not None]
    outcomes = [one.outcome for one in scores]
    elsewhere = outcomes.count("elsewhere")
    hits = {
        name: quartiles([getattr(one, name) for one in scores])
        for name in ("onset_error", "peak_time_error", "peak_ratio", "area_ratio")
    }
    true = [one for one in scores if one.true is not None]
    return Summary(
        n=len(recoveries),
        failed=len(recoveries) - len(scores),
        hits=outcomes.count("hit"),
        misses=outcomes.count("miss") + elsewhere,
        false_alarms=outcomes.count("false alarm") + elsewhere,
        quiet=outcomes.count("none"),
        **hits,
        correlation=quartiles([one.correlation for one in true]),
        lag=quartiles([one.lag for one in true]),
        moment_error=quartiles([one.moment_error for one in recoveries]),
    )


def _shares(group: str) -> Array:
    """(8,) how much a muscle counts in its group."""
    muscles = load_table()["source"]["muscles"]
    own = np.array([muscles[name]["max_isometric_force"] if name in GROUPS[group] else 0.0 for name in MUSCLES])
    return np.asarray(own / own.sum())

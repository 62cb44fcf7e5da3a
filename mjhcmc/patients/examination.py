"""The battery of tests that every virtual patient goes through, and the block of a dataset that comes of it."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mjhcmc.errors import MjhcmcError, SettingsError, SimulationError
from mjhcmc.leg8.table import JOINTS
from mjhcmc.motion import Motion
from mjhcmc.patients import tables
from mjhcmc.patients.bench import Case, run_trials
from mjhcmc.patients.grades import rank
from mjhcmc.patients.groups import TESTED
from mjhcmc.patients.leg import gait_leg_of, leg_of
from mjhcmc.patients.movement import move
from mjhcmc.patients.patient import RATERS, Patient, healthy, sample_patient, stream
from mjhcmc.patients.rater import ideal_grade, rate, sample_raters
from mjhcmc.patients.record import Record
from mjhcmc.patients.resistance import Resistance, Usual, hand_on, read_resistance, usual_resistance
from mjhcmc.patients.sensors import observe
from mjhcmc.patients.trials import Trial, pendulum, stretch, voluntary

if TYPE_CHECKING:
    import pyarrow as pa

    from mjhcmc.patients.configuration import Configuration

DEFAULTS: dict[str, float | int | str] = {
    "slow_deg_s": 10.0,
    "fast_deg_s": "120 180 240",
    "shift_fast_deg_s": "90 150 300",
    "shift_muscle": "rigid",
    "shift_reflex": "force",
    "movement": "slow",
    "dt": 0.01,
    "physics_dt": 0.002,
    "walk": "",
    "walk_loads": "",
    "walk_start": 0.0,
    "walk_end": 0.0,
    "walk_height": 1.8,
    "walk_mass": 75.1646,
    "walk_dt": 0.005,
    "walk_digest": "",
}
"""Settings of the simulation. ``dt`` and ``physics_dt`` (s) are those of voluntary movements; ``walk``, ``walk_loads``
are files of a measured walk and its ground reaction, of a subject of ``walk_height`` (m) and ``walk_mass`` (kg), of
which patients walk the part from ``walk_start`` to ``walk_end`` (s); empty: nobody walks."""

_BOUNDS: Mapping[str, tuple[float, float]] = {
    "slow_deg_s": (1.0, 1000.0), "dt": (0.001, 0.05), "physics_dt": (1e-5, 0.05), "walk_dt": (0.001, 0.05),
    "walk_height": (1.0, 2.5), "walk_mass": (20.0, 250.0),
}  # fmt: skip

RATED = ("ideal", "rating")
"""Sessions in which a rater's hand is on the limb: for the grade that the patient deserves, and for the one given."""

_USUAL = healthy()

_BY_WILL = ("cosine", "walk")  # a patient who cannot move so is a patient all the same

_WALK_STEP = 0.001  # s; loaded muscles are stiff

SPLIT_OF_VELOCITIES, SPLIT_OF_MUSCLES, SPLIT_OF_REFLEXES = "shift_velocity", "shift_muscle", "shift_reflex"


def battery(settings: Mapping[str, float | int | str], split: str = "train") -> list[Trial]:
    """The trials of one patient: those that are recorded first, then those of raters.

    Args:
        settings: see `DEFAULTS`.
        split: of the patient; in the split of other velocities the fast stretches have those.
    """
    speeds = settings["shift_fast_deg_s" if split == SPLIT_OF_VELOCITIES else "fast_deg_s"]
    fast = [np.radians(float(word)) for word in str(speeds).split()]
    slow = np.radians(float(settings["slow_deg_s"]))
    recorded = []
    for joint in TESTED:
        recorded.append(stretch(joint, "slow", slow, examiner="servo", rate=20.0))
        recorded.append(stretch(joint, "mas"))
        recorded.extend(stretch(joint, "fast", speed) for speed in fast)
    recorded.append(pendulum())
    recorded.append(voluntary("cosine", str(settings["movement"]), 1.0 / float(settings["dt"])))
    if settings["walk"]:
        recorded.append(voluntary("walk", "", 1.0 / float(settings["walk_dt"])))
    return recorded + [stretch(joint, "mas", session=session) for session in RATED for joint in TESTED]


def checked(settings: Mapping[str, float | int | str]) -> dict[str, float | int | str]:
    """Settings that can be carried out; with the digest of the walk that they name.

    Args:
        settings: see `DEFAULTS`.

    Raises:
        MjhcmcError: a speed, muscle, reflex, movement or file that there is not.
    """
    found = dict(settings)
    for name in ("fast_deg_s", "shift_fast_deg_s"):
        words = str(found[name]).split()
        if not words or not all(_is_speed(word) for word in words):
            raise SettingsError(f"setting {name!r} is {found[name]!r}: give speeds of 1 to 1000 deg/s, as '120 180'")
        if len({f"{float(word):.0f}" for word in words}) < len(words):
            raise SettingsError(f"setting {name!r} is {found[name]!r}: give speeds that differ by 1 deg/s and more")
    for name, (low, high) in _BOUNDS.items():
        if not low <= float(found[name]) <= high:
            raise SettingsError(f"setting {name!r} is {found[name]}: give a number from {low:g} to {high:g}")
    subject = sample_patient(0, 0, reflex=str(found["shift_reflex"]), muscle=str(found["shift_muscle"]))
    Motion.cosine(leg_of(subject), str(found["movement"]))
    for split in ("train", SPLIT_OF_VELOCITIES):
        battery(found, split)
    found["walk_digest"] = ""
    if found["walk"]:
        from mjhcmc.patients.walk import digest

        found["walk_digest"] = digest(*_walk(found))
    return found


def _is_speed(word: str) -> bool:
    try:
        return 1 <= float(word) <= 1000
    except ValueError:
        return False


def _walk(settings: Mapping[str, float | int | str]) -> tuple[str, str, float, float, float, float]:
    """Files, start, end, height and mass of the walk."""
    start, end, height, mass = (float(settings[f"walk_{name}"]) for name in ("start", "end", "height", "mass"))
    return str(settings["walk"]), str(settings["walk_loads"]), start, end, height, mass


def patient_of(configuration: Configuration, split: str, index: int) -> Patient:
    """A patient of a dataset: in the splits of other muscles or reflexes, with those."""
    settings = configuration.settings
    muscle = str(settings["shift_muscle"]) if split == SPLIT_OF_MUSCLES else "mujoco"
    reflex = str(settings["shift_reflex"]) if split == SPLIT_OF_REFLEXES else "velocity"
    return sample_patient(configuration.seed, index, reflex=reflex, muscle=muscle)


def simulate_block(configuration: Configuration, split: str, first: int, last: int) -> dict[str, pa.Table]:
    """Simulate patients first to last - 1 of a dataset.

    Returns:
        The tables of `tables.SCHEMAS`. A patient whose simulation fails is in them with the reason.
    """
    trials = battery(configuration.settings, split)
    patients = [patient_of(configuration, split, index) for index in range(first, last)]
    found = tables.Block(configuration, split)
    with _without_mujocos_log():
        results = _records(patients, trials, configuration)
    for patient, records in zip(patients, results, strict=True):
        failure = "; ".join(r.failure for r in records if r.failure and r.trial.test not in _BY_WILL)
        grades: dict[str, dict[str, object]] = {}
        try:
            grades = grade(patient, records)
        except MjhcmcError as error:
            failure = failure or str(error)
        found.patient(patient, grades, failure)
        for number, record in enumerate(records):
            if record.trial.session == "instrumented":
                seen = observe(record, patient.seed, patient.index, number) if len(record.time) else None
                found.trial(patient, number, record, seen)
    return found.tables()


@contextmanager
def _without_mujocos_log() -> Iterator[None]:
    """Keep MuJoCo from writing of diverging simulations to the terminal and to a file: their records say so."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _records(patients: Sequence[Patient], trials: Sequence[Trial], configuration: Configuration) -> list[list[Record]]:
    """All trials of all patients; together, or where that fails as a whole, one patient after the other."""
    try:
        return examine(patients, trials, configuration)
    except MjhcmcError as error:
        if len(patients) == 1:
            return [[Record.missing(trial, f"{trial.name}: {error}") for trial in trials]]
        return [_records([patient], trials, configuration)[0] for patient in patients]


def examine(
    patients: Sequence[Patient], trials: Sequence[Trial], configuration: Configuration, *, threads: int = 1
) -> list[list[Record]]:
    """Take patients through trials.

    Args:
        patients: of one kind of muscle and reflex.
        trials: see `battery`.
        configuration: of the dataset.
        threads: to compute on.

    Returns:
        For each patient the records, in the order of the trials.

    Raises:
        MjhcmcError: a leg that cannot be simulated at all.
    """
    settings = configuration.settings
    dt, physics_dt = float(settings["dt"]), float(settings["physics_dt"])
    if not patients or not trials:
        return [[] for _ in patients]
    legs = [leg_of(patient) for patient in patients]
    found: dict[tuple[int, int], Record] = {}
    passive = [k for k, trial in enumerate(trials) if trial.test not in _BY_WILL]
    cases = [Case(patient, leg, trials[k]) for patient, leg in zip(patients, legs, strict=True) for k in passive]
    for (i, k), record in zip(
        ((i, k) for i in range(len(patients)) for k in passive), run_trials(cases, threads=threads), strict=True
    ):
        found[i, k] = record
    for k, trial in enumerate(trials):
        if trial.test == "cosine":
            cases = [Case(patient, leg, trial) for patient, leg in zip(patients, legs, strict=True)]
            motions = [Motion.cosine(leg, str(settings["movement"])) for leg in legs]
            records = move(cases, motions, dt=dt, physics_dt=physics_dt, threads=threads)
        elif trial.test == "walk":
            from mjhcmc.patients.walk import walks

            gait = [gait_leg_of(patient) for patient in patients]
            cases = [Case(patient, leg, trial) for patient, leg in zip(patients, gait, strict=True)]
            motions, loads = walks(patients, gait, *_walk(settings))
            step = min(physics_dt, _WALK_STEP)
            records = move(cases, motions, loads, dt=float(settings["walk_dt"]), physics_dt=step, threads=threads)
        else:
            continue
        found.update(((i, k), record) for i, record in enumerate(records))
    return [[found[i, k] for k in range(len(trials))] for i in range(len(patients))]


def usual_of(patient: Patient, joint: str) -> Usual:
    """What raters are used to in a limb of a patient's size: the same stretch of a healthy leg, to scale."""
    return _usual(joint, patient.muscle).scaled(patient.body_mass * patient.height / (_USUAL.body_mass * _USUAL.height))


@functools.cache
def _usual(joint: str, muscle: str) -> Usual:
    person = replace(_USUAL, muscle=muscle)
    case = Case(person, leg_of(person), stretch(joint, "mas", session="ideal"))
    return usual_resistance(run_trials([case])[0])


def grade(patient: Patient, records: Sequence[Record]) -> dict[str, dict[str, object]]:
    """What raters say of a patient's joints.

    Args:
        patient: the patient.
        records: of the whole battery.

    Returns:
        By joint, the labels of the table of patients.

    Raises:
        SimulationError: a rated stretch failed.
    """
    rng = stream(patient.seed, patient.index, RATERS)
    raters = sample_raters(rng, 2)
    read: dict[tuple[str, str], Resistance] = {}
    for record in records:
        if record.trial.session in RATED:
            if record.failure:
                raise SimulationError(record.failure)
            joint = record.trial.joint
            hand = hand_on(joint, patient.height)
            read[record.trial.session, joint] = read_resistance(record, hand, usual_of(patient, joint))
    labels: dict[str, dict[str, object]] = {}
    for joint in (joint for joint in JOINTS if joint in TESTED):
        true = read["ideal", joint]
        grades = {"ideal": ideal_grade(true)}
        for name, rater in zip(("rater_a", "rater_b"), raters, strict=True):
            grades[name] = rate(read["rating", joint], rater, rng)
        labels[joint] = {**grades, **{f"{name}_rank": rank(value) for name, value in grades.items()}, "reading": true}
    return labels

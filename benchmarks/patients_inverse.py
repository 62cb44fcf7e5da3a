"""How well reflexes of virtual patients are recovered by `mjhcmc.hcmc` from what instruments saw, as Markdown.

    python benchmarks/patients_inverse.py [--write [DOCUMENT]]

--write replaces the table in docs/patients.md (or DOCUMENT). Patients are the first of the cohort in whom some of the
stretches meets a burst of reflex; all their stretches count, those without a burst for false alarms.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence

from _markdown import ROOT, grid, main

from mjhcmc.leg8 import JOINTS, MUSCLES
from mjhcmc.patients.bench import Case, run_trials
from mjhcmc.patients.bursts import THRESHOLD, Quartiles
from mjhcmc.patients.groups import GROUPS, TESTED
from mjhcmc.patients.inverse import Recovery, exact, recover, summary
from mjhcmc.patients.leg import leg_of
from mjhcmc.patients.patient import Patient, sample_patient
from mjhcmc.patients.record import Record
from mjhcmc.patients.sensors import observe
from mjhcmc.patients.trials import Trial, stretch

SEED, PATIENTS, AT_ONCE = 5, 20, 16
LOWER = 0.03
FAST, SLOW = math.radians(180), math.radians(10)
TRIALS = [trial for joint in JOINTS for trial in (stretch(joint, "mas"), stretch(joint, "fast", FAST))]
HELD = [stretch(joint, "slow", SLOW, examiner="servo", rate=20.0) for joint in JOINTS]
THREADS = os.cpu_count() or 1

VARIANTS: tuple[tuple[str, bool, bool, float], ...] = (
    ("own", False, False, THRESHOLD),
    ("own", True, False, THRESHOLD),
    ("own", True, True, THRESHOLD),
    ("generic", False, False, THRESHOLD),
    ("generic", True, False, THRESHOLD),
    ("generic", False, True, THRESHOLD),
    ("generic", True, True, THRESHOLD),
    ("generic", True, True, LOWER),
)
"""Leg, whether instruments are noisy, whether a slow stretch is known, threshold of what is found."""

HEADER = (
    "leg, instruments, slow stretch, threshold", "joint", "bursts", "found", "false", "of", "onset, ms", "peak, ms",
    "size", "area", "best r", "lag, ms", "moment error, %",
)  # fmt: skip


def simulated(patients: Sequence[Patient], trials: Sequence[Trial]) -> list[list[Record]]:
    """By patient."""
    legs = [leg_of(patient) for patient in patients]
    cases = [Case(patient, leg, trial) for patient, leg in zip(patients, legs, strict=True) for trial in trials]
    records, n = run_trials(cases, threads=THREADS), len(trials)
    return [records[i * n : (i + 1) * n] for i in range(len(patients))]


def reflexive(records: Sequence[Record]) -> bool:
    """Whether some stretch meets more than the threshold in a muscle of the group."""
    return any(
        record.reflex[:, [MUSCLES.index(name) for name in GROUPS[TESTED[record.trial.joint]]]].max() > THRESHOLD
        for record in records
    )


def cohort() -> tuple[list[Patient], list[list[Record]], int]:
    """Patients, their records, and of how many they are."""
    patients: list[Patient] = []
    records: list[list[Record]] = []
    first = 0
    while len(patients) < PATIENTS:
        some = [sample_patient(SEED, index) for index in range(first, first + AT_ONCE)]
        for patient, own in zip(some, simulated(some, TRIALS), strict=True):
            if reflexive(own):
                patients.append(patient)
                records.append(own)
        first += AT_ONCE
    return patients[:PATIENTS], records[:PATIENTS], patients[PATIENTS - 1].index + 1


def markdown() -> str:
    patients, records, of = cohort()
    slow = simulated(patients, HELD)
    rows: list[tuple[str, ...]] = []
    for leg, noisy, with_slow, threshold in VARIANTS:
        found = recovered(patients, records, slow, leg, noisy, with_slow, threshold)
        what = f"{leg}, {'noisy' if noisy else 'exact'}, {'yes' if with_slow else 'no'}, {threshold:g}"
        rows.extend(row(what, joint, [one for one in found if one.trial.joint == joint]) for joint in JOINTS)
    told = (
        f"{PATIENTS} patients with a visible reflex, of the first {of} of cohort {SEED}; stretches in 1 s and at 180 "
        "deg/s. Medians and quartiles. Bursts: of the stretched group's reflex, over 5 % for 20 ms. False: recovered "
        "where there is none, of so many stretches, or more than 150 ms from the true one. Onset, peak, size and area "
        "are of bursts that were found, less or over the true ones; best r and lag of all stretches with a burst; the "
        "moment's error is rms over peak."
    )
    return f"{told}\n\n{grid(HEADER, rows)}"


def recovered(
    patients: Sequence[Patient],
    records: Sequence[Sequence[Record]],
    slow: Sequence[Sequence[Record]],
    leg: str,
    noisy: bool,
    with_slow: bool,
    threshold: float,
) -> list[Recovery]:
    """Of all stretches of all patients."""
    flat, who, seen, held = [], [], [], []
    for patient, own, still in zip(patients, records, slow, strict=True):
        for number, record in enumerate(own):
            joint = JOINTS.index(record.trial.joint)
            slow_record, slow_number = still[joint], len(own) + joint
            flat.append(record)
            who.append(patient)
            if noisy:
                seen.append(observe(record, patient.seed, patient.index, number))
                held.append(observe(slow_record, patient.seed, patient.index, slow_number))
            else:
                seen.append(exact(record))
                held.append(exact(slow_record))
    return recover(
        flat, who, seen, slow=held if with_slow else None, model=leg, found_threshold=threshold, threads=THREADS
    )  # fmt: skip


def row(what: str, joint: str, found: Sequence[Recovery]) -> tuple[str, ...]:
    s = summary(found)
    bursts = sum(one.group is not None and one.group.true is not None for one in found)
    return (
        what + (f" ({s.failed} failed)" if s.failed else ""), joint, str(bursts), str(s.hits), str(s.false_alarms),
        str(s.n - s.failed - bursts), spread(s.onset_error, 1e3, 0), spread(s.peak_time_error, 1e3, 0),
        spread(s.peak_ratio, 1, 2), spread(s.area_ratio, 1, 2), spread(s.correlation, 1, 2), spread(s.lag, 1e3, 0),
        spread(s.moment_error, 100, 1),
    )  # fmt: skip


def spread(values: Quartiles, unit: float, places: int) -> str:
    """Median and quartiles."""
    if not values.n:
        return "-"
    low, median, high = (f"{unit * value + 0.0:.{places}f}" for value in values[:3])
    return f"{median} ({low} .. {high})"


if __name__ == "__main__":
    main(
        "patients_inverse.py",
        "How well reflexes of virtual patients are recovered from what instruments saw.",
        markdown,
        document=ROOT / "docs" / "patients.md",
    )

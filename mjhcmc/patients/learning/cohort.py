"""A dataset as the baselines see it: features, grades and what the search for leaks needs; samples are let go."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import OutputError, SettingsError
from mjhcmc.patients.grades import READERS
from mjhcmc.patients.learning.features import READS, TrialRow, describe, feature_names
from mjhcmc.patients.learning.read import (
    HELD_OUT,
    KEYS,
    ORIGIN,
    READABLE,
    Column,
    Columns,
    Dataset,
    Guarded,
    check_columns,
    column_names,
    read_columns,
)
from mjhcmc.patients.learning.scores import MISSING, N_GRADE

Array = NDArray[np.float64]
Ranks = NDArray[np.int64]

PROTOCOL = ("trials", "missing", "duration_s", "rate_hz", "speed_deg_s")
"""What is known of how a joint was tested, without a look at the signals."""

MIN_PATIENTS = {"train": 20, "validation": 5, "test": 5}
"""Fewer patients than these in a split tell nothing."""


@dataclass(frozen=True, eq=False)
class Cohort:
    """Patients of all splits. P patients that were simulated, J joints.

    Attributes:
        joints: J names.
        patient: (P,) their indices.
        split: (P,) the split whose folder they lie in.
        grades: by reader, (P, J) ranks; `MISSING` where there is none.
        names: by joint, the features.
        features: by joint, (P, n_feature) float32; nan where a trial is missing.
        latent: by name, (P,) what the generator drew; for the search for leaks only.
        protocol: (P, J, n) in the order of `PROTOCOL`.
        channels: by column of the observables, (P, J) its mean over the joint's trials; undeclared columns too.
        undeclared: columns of the observables that are in no list.
        failed: by split, how many patients were left out since their simulation failed.
        misplaced: patients whose row names another split than their folder.
    """

    joints: tuple[str, ...]
    patient: NDArray[np.int64]
    split: NDArray[Any]
    grades: Mapping[str, Ranks]
    names: Mapping[str, tuple[str, ...]]
    features: Mapping[str, NDArray[np.float32]]
    latent: Mapping[str, Array]
    protocol: Array
    channels: Mapping[str, Array]
    undeclared: tuple[str, ...]
    failed: Mapping[str, int]
    misplaced: tuple[int, ...]

    def rows(self, split: str) -> NDArray[np.int64]:
        """Rows of a split."""
        return np.flatnonzero(self.split == split)

    @property
    def never_known(self) -> dict[str, tuple[str, ...]]:
        """By joint, features that are missing for every patient of train: no model learns of them."""
        train, found = self.rows("train"), {}
        for joint in self.joints:
            missing = np.flatnonzero(~np.isfinite(self.features[joint][train]).any(axis=0)).tolist()
            if missing:
                found[joint] = tuple(self.names[joint][i] for i in missing)
        return found

    @property
    def splits(self) -> tuple[str, ...]:
        """Splits that have patients, in the order of the dataset."""
        return tuple(dict.fromkeys(self.split.tolist()))


def load_cohort(
    dataset: Dataset, joints: tuple[str, ...], progress: Callable[[int, int], None] | None = None
) -> Cohort:
    """Read a dataset, one shard at a time, and keep features.

    Args:
        dataset: to read.
        joints: that are graded.
        progress: called with shards done and shards in all.

    Raises:
        OutputError: a table or column is missing or cannot be read; a rank is none.
        SettingsError: an unknown joint, too few patients.
    """
    for joint in joints:
        if joint not in READS:
            raise SettingsError(f"joint {joint!r} is not graded: choose one of {', '.join(READS)}")
    for folders in dataset.shards.values():  # all of them, before the work begins
        for folder in folders:
            for table, columns in _needed(joints).items():
                check_columns(folder / f"{table}.parquet", columns)
    parts: list[_Part] = []
    failed: dict[str, int] = {}
    for name, folders in dataset.shards.items():
        failed[name] = 0
        for folder in folders:
            part = _read_shard(folder, name, joints)
            failed[name] += part.failed
            parts.append(part)
            if progress is not None:
                progress(len(parts), dataset.count)
    split = np.concatenate([np.full(len(p.patient), p.split, dtype=object) for p in parts])
    for name, least in MIN_PATIENTS.items():
        count = int((split == name).sum())
        if count < least:
            raise SettingsError(
                f"{dataset.folder}: split {name} has {count} patients that were simulated, {least} are needed: "
                "generate more patients (--n 60 or more)"
            )
    return Cohort(
        joints=joints,
        patient=np.concatenate([p.patient for p in parts]),
        split=split,
        grades={reader: np.concatenate([p.grades[reader] for p in parts]) for reader in READERS},
        names={joint: feature_names(joint) for joint in joints},
        features={joint: np.concatenate([p.features[joint] for p in parts]) for joint in joints},
        latent=_joined([p.latent for p in parts], [(len(p.patient),) for p in parts]),
        protocol=np.concatenate([p.protocol for p in parts]),
        channels=_joined([p.channels for p in parts], [(len(p.patient), len(joints)) for p in parts]),
        undeclared=tuple(sorted({name for p in parts for name in p.undeclared})),
        failed=failed,
        misplaced=tuple(index for p in parts for index in p.misplaced),
    )


def _needed(joints: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """By table, the columns without which nothing can be learned."""
    needed = {table: (*KEYS[table], *READABLE[table]) for table in KEYS}
    needed["patients"] += tuple(f"{reader}_rank/{joint}" for reader in READERS for joint in joints)
    return needed


def _joined(parts: list[dict[str, Array]], shapes: list[tuple[int, ...]]) -> dict[str, Array]:
    """Columns of all shards; nan where a shard lacks one."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {
        name: np.concatenate(
            [part.get(name, np.full(shape, math.nan)) for part, shape in zip(parts, shapes, strict=True)]
        )
        for name in names
    }


@dataclass(frozen=True, eq=False)
class _Part:
    """What is kept of a shard; as `Cohort`."""

    split: str
    patient: NDArray[np.int64]
    grades: dict[str, Ranks]
    features: dict[str, NDArray[np.float32]]
    latent: dict[str, Array]
    protocol: Array
    channels: dict[str, Array]
    undeclared: tuple[str, ...]
    failed: int
    misplaced: tuple[int, ...]


def _read_shard(folder: Path, split: str, joints: tuple[str, ...]) -> _Part:
    path = folder / "patients.parquet"
    needed = _needed(joints)
    latent_names = tuple(name for name in column_names(path) if name.startswith("latent/"))
    people = read_columns(path, (*needed["patients"], *latent_names))
    index = people["patient"].astype(np.int64)
    kept, first = np.unique(index, return_index=True)
    if len(kept) < len(index):
        twice = np.delete(index, first)
        raise OutputError(f"{path}: patient {twice[0]} has more than one row: generate this shard again")
    ok = people["status"] == "ok"
    people = {name: values[ok] for name, values in people.items()}
    index = people["patient"].astype(np.int64)
    grades = {reader: _ranks(people, reader, joints, path) for reader in READERS}
    trials = read_columns(folder / "trials.parquet", needed["trials"])
    rows = _trial_rows(trials)

    samples_path = folder / "observables.parquet"
    undeclared = tuple(name for name in column_names(samples_path) if name not in (*needed["observables"], *ORIGIN))
    observables = read_columns(samples_path, (*needed["observables"], *undeclared))
    where = _segments(observables, samples_path)

    features = {joint: np.full((len(index), len(feature_names(joint))), np.nan, np.float32) for joint in joints}
    protocol = np.full((len(index), len(joints), len(PROTOCOL)), np.nan)
    channels = {
        name: np.full((len(index), len(joints)), np.nan)
        for name, values in observables.items()
        if name not in KEYS["observables"] and values.dtype != object
    }
    for i, patient in enumerate(index.tolist()):
        for j, joint in enumerate(joints):
            mine = rows.get((patient, joint), [])
            there = [row for row, _ in mine if row is not None and (patient, row.trial) in where]
            protocol[i, j] = _protocol(mine, len(there))
            samples = {
                row.trial: {name: observables[name][where[patient, row.trial]] for name in READABLE["observables"]}
                for row in there
            }
            features[joint][i] = describe(joint, _person(people, i, joint), there, samples)
            for name, means in channels.items():
                values = [observables[name][where[patient, row.trial]] for row in there]
                finite = np.concatenate(values) if values else np.zeros(0)
                finite = finite[np.isfinite(finite)]
                means[i, j] = finite.mean() if finite.size else math.nan
    latent = {
        name.removeprefix("latent/"): people[name].astype(np.float64)
        for name in latent_names
        if people[name].dtype != object
    }
    misplaced = tuple(index[people["split"] != split].tolist())
    return _Part(split, index, grades, features, latent, protocol, channels, undeclared, int((~ok).sum()), misplaced)


def _ranks(people: Columns, reader: str, joints: tuple[str, ...], path: Path) -> Ranks:
    """(n, J) ranks."""
    columns = []
    for joint in joints:
        name = f"{reader}_rank/{joint}"
        values = people[name].astype(np.float64)
        bad = np.isfinite(values) & ((values < MISSING) | (values >= N_GRADE) | (values != np.round(values)))
        if bad.any():
            row = int(np.argmax(bad))
            raise OutputError(
                f"{path}: column {name!r}, patient {people['patient'][row]}: {values[row]:g} is no rank of 0 to "
                f"{N_GRADE - 1}: generate this shard again"
            )
        columns.append(np.where(np.isfinite(values), values, MISSING).astype(np.int64))
    return np.stack(columns, axis=1)


def _person(people: Columns, i: int, joint: str) -> dict[str, float]:
    o = Guarded("patients", people, READS[joint]["person"])
    return {
        "female": float(o["sex"][i] == "F"),
        "height": float(o["height"][i]),
        "body_mass": float(o["body_mass"][i]),
    }


_Known = tuple[float, float, float]  # duration (s), rate (Hz), speed (deg/s)


def _trial_rows(trials: Columns) -> dict[tuple[int, str], list[tuple[TrialRow | None, _Known]]]:
    """By patient and joint, the instrumented trials; a failed one is None."""
    result: dict[tuple[int, str], list[tuple[TrialRow | None, _Known]]] = {}
    commanded = Guarded("trials", trials, READABLE["trials"])
    test, joint = commanded["test"], commanded["joint"]
    speed, start, end = (np.radians(commanded[name].astype(np.float64)) for name in READABLE["trials"][2:])
    for i in np.flatnonzero((trials["session"] == "instrumented") & (joint != "")).tolist():
        row = None
        if trials["status"][i] == "ok":
            row = TrialRow(int(trials["trial"][i]), test[i], joint[i], float(speed[i]), float(start[i]), float(end[i]))
        known = (float(trials["duration_s"][i]), float(trials["rate_hz"][i]), math.degrees(speed[i]))
        result.setdefault((int(trials["patient"][i]), joint[i]), []).append((row, known))
    return result


def _protocol(rows: list[tuple[TrialRow | None, _Known]], there: int) -> Array:
    """What `PROTOCOL` names."""
    if not rows:
        return np.array([0.0, 0.0, math.nan, math.nan, math.nan])
    return np.array([len(rows), len(rows) - there, *np.mean([known for _, known in rows], axis=0)])


def _segments(observables: Mapping[str, Column], path: Path) -> dict[tuple[int, int], slice]:
    """Rows of each patient's trial.

    Raises:
        OutputError: the rows of a trial do not lie together.
    """
    patient, trial = observables["patient"].astype(np.int64), observables["trial"].astype(np.int64)
    if not len(patient):
        return {}
    edges = np.flatnonzero((np.diff(patient) != 0) | (np.diff(trial) != 0)) + 1
    result: dict[tuple[int, int], slice] = {}
    for a, b in zip([0, *edges.tolist()], [*edges.tolist(), len(patient)], strict=True):
        key = (int(patient[a]), int(trial[a]))
        if key in result:
            raise OutputError(
                f"{path}: rows of patient {key[0]}, trial {key[1]} do not lie together: generate it again"
            )
        result[key] = slice(a, b)
    return result


def check_grades(cohort: Cohort, target: str) -> None:
    """See that there is something to learn.

    Args:
        cohort: to look at.
        target: one of `READERS`.

    Raises:
        SettingsError: an unknown target; a joint with fewer than two grades in training, or none in a split.
    """
    if target not in ("rater_a", "ideal"):
        raise SettingsError(f"target {target!r} is not known: choose rater_a or ideal")
    for j, joint in enumerate(cohort.joints):
        for split in HELD_OUT:
            grades = cohort.grades[target][cohort.rows(split), j]
            kinds = len(np.unique(grades[grades >= 0]))
            if kinds < (2 if split == "train" else 1):
                raise SettingsError(
                    f"{joint}: split {split} has {kinds} different grades of {target}: generate more patients"
                )

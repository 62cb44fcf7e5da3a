"""A dataset at a glance: who is in it, which grades there are, and why patients failed; read shard by shard."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.patients.grades import GRADES, READERS, weighted_kappa
from mjhcmc.patients.groups import TESTED
from mjhcmc.patients.show import stand_under_each_other
from mjhcmc.patients.stored import open_manifest, read_table, shards_in
from mjhcmc.patients.trials import stretch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

POINTS = 1500
"""Patients, at most, that are kept to be drawn one by one."""

BIN = 5.0
"""deg, width of the bins of catch angles."""

_REASONS = 5  # failed patients named on screen
_OF_POINT = ("rank", "gain", "threshold", "resistance", "range_affected")


@dataclass(frozen=True, eq=False)
class Overview:
    """What the tables of patients say of a cohort.

    Attributes:
        folder: of the dataset.
        seed: of the cohort.
        splits: by split, patients that are there.
        missing: patients whose shards are not there yet.
        failed: index and reason of patients whose simulation failed.
        grades: by joint, by reader, (6,) how many have each grade.
        ideal_rater: by joint, (6, 6) counts, rows the ideal grade, columns that of rater a.
        raters: by joint, (6, 6) counts, rows rater a, columns rater b.
        points: by joint, by name: rank of the ideal grade, gain and threshold of the stretched group's reflex (nan
            where the reflex is not of velocity), resistance (N m) and range_affected of the ideal reading; of some
            patients, evenly spaced.
        edges: by joint, deg in the direction of the stretch, of the bins of catch angles.
        catches: by joint, (n_bin, 6) how many limbs of each ideal grade catch there.
    """

    folder: str
    seed: int
    splits: dict[str, int]
    missing: int
    failed: tuple[tuple[int, str], ...]
    grades: dict[str, dict[str, Counts]]
    ideal_rater: dict[str, Counts]
    raters: dict[str, Counts]
    points: dict[str, dict[str, Array]]
    edges: dict[str, Array]
    catches: dict[str, Counts]

    @property
    def patients(self) -> int:
        """How many are there."""
        return sum(self.splits.values())

    def kappa(self, counts: Counts) -> float:
        """Quadratic-weighted kappa of a table of counts; nan where nothing is counted."""
        rows, columns = np.repeat(np.argwhere(counts >= 0), counts.ravel(), axis=0).T
        return weighted_kappa(rows, columns) if len(rows) else float("nan")

    def numbers(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "dataset": self.folder, "seed": self.seed, "patients": self.patients, "missing": self.missing,
            "splits": self.splits, "failed": [{"patient": i, "reason": reason} for i, reason in self.failed],
            "grades": {
                joint: {reader: dict(zip(GRADES, n.tolist(), strict=True)) for reader, n in of_joint.items()}
                for joint, of_joint in self.grades.items()
            },
            "inter_rater_kappa": {joint: _number(self.kappa(counts)) for joint, counts in self.raters.items()},
            "catches": {joint: int(counts.sum()) for joint, counts in self.catches.items()},
        }  # fmt: skip

    def screen(self) -> str:
        """As text, for a person."""
        splits = ", ".join(f"{name} {count}" for name, count in self.splits.items())
        lines = [f"{self.folder}: {self.patients} patients, seed {self.seed} ({splits or 'none'})"]
        if self.missing:
            lines.append(f"{self.missing} more are not there yet: let mjhcmc patients generate finish")
        table = [["joint", "grade of", *GRADES, "catch", "kappa of raters"]]
        for joint, of_joint in self.grades.items():
            for reader, counts in of_joint.items():
                ideal = reader == READERS[0]
                kappa = f"{self.kappa(self.raters[joint]):.2f}"
                more = [str(self.catches[joint].sum()), kappa] if ideal else ["", ""]
                table.append([joint if ideal else "", reader.replace("_", " "), *map(str, counts.tolist()), *more])
        lines += ["", *stand_under_each_other(table), "", f"failed: {len(self.failed)} of {self.patients}"]
        lines += [f"  patient {index}: {reason}" for index, reason in self.failed[:_REASONS]]
        if len(self.failed) > _REASONS:
            lines.append(f"  and {len(self.failed) - _REASONS} more (--json names all)")
        return "\n".join(lines)

    def figure(self) -> Figure:
        """Of the cohort."""
        from mjhcmc.plotting.cohort import cohort_figure

        return cohort_figure(self)


def look_at(folder: Path | str) -> Overview:
    """Read a dataset's tables of patients, one shard after the other; only counts and some points are kept.

    Args:
        folder: of the dataset; what is not there yet is counted.

    Raises:
        OutputError: no dataset, or a table that cannot be read.
    """
    folder = Path(folder)
    manifest = open_manifest(folder)
    there, missing = shards_in(folder, manifest)
    every = -(-manifest.patients // POINTS)
    n = len(GRADES)
    splits: Counter[str] = Counter()
    failed: list[tuple[int, str]] = []
    grades = {joint: {reader: np.zeros(n, dtype=np.int64) for reader in READERS} for joint in TESTED}
    ideal_rater, raters = ({joint: np.zeros((n, n), dtype=np.int64) for joint in TESTED} for _ in range(2))
    edges = {joint: _edges(joint) for joint in TESTED}
    catches = {joint: np.zeros((len(edges[joint]) - 1, n), dtype=np.int64) for joint in TESTED}
    points: dict[str, dict[str, list[Array]]] = {joint: {name: [] for name in _OF_POINT} for joint in TESTED}
    for shard in there:
        table = read_table(folder / shard.name / "patients.parquet", _columns())
        splits[shard.split] += table.num_rows
        index = table["patient"].to_numpy()
        status, reasons = table["status"].to_pylist(), table["reason"].to_pylist()
        failed += [(int(i), why) for i, ok, why in zip(index, status, reasons, strict=True) if ok != "ok"]
        velocity = np.array([law == "velocity" for law in table["latent/reflex"].to_pylist()], dtype=bool)
        some = index % every == 0
        for joint, group in TESTED.items():
            ranks = {reader: _floats(table, f"{reader}_rank/{joint}") for reader in READERS}
            ideal, a, b = ranks.values()
            for reader, own in ranks.items():
                grades[joint][reader] += np.bincount(own[np.isfinite(own)].astype(int), minlength=n)
            _count(ideal_rater[joint], ideal, a)
            _count(raters[joint], a, b)
            sign = stretch(joint, "mas").direction
            angle = sign * _floats(table, f"catch_angle/{joint}")
            place = np.clip(np.digitize(angle, edges[joint]) - 1.0, 0, len(edges[joint]) - 2)
            _count(catches[joint], np.where(np.isfinite(angle), place, np.nan), ideal)
            hidden = {name: _floats(table, f"latent/{name}/{group}") for name in ("gain", "threshold")}
            values = {
                "rank": ideal, **{name: np.where(velocity, value, np.nan) for name, value in hidden.items()},
                "resistance": _floats(table, f"resistance/{joint}"),
                "range_affected": _floats(table, f"range_affected/{joint}"),
            }  # fmt: skip
            for name in _OF_POINT:
                points[joint][name].append(values[name][some])
    return Overview(
        str(folder), int(manifest.configuration["seed"]), dict(splits), sum(s.last - s.first for s in missing),
        tuple(failed), grades, ideal_rater, raters,
        {joint: {name: np.concatenate([np.empty(0), *parts]) for name, parts in of_joint.items()}
         for joint, of_joint in points.items()},
        edges, catches,
    )  # fmt: skip


def _columns() -> list[str]:
    """Of the table of patients, those that are read."""
    of_joints = [*(f"{reader}_rank" for reader in READERS), "catch_angle", "resistance", "range_affected"]
    hidden = [f"latent/{name}/{group}" for group in TESTED.values() for name in ("gain", "threshold")]
    return ["patient", "status", "reason", "latent/reflex", *(f"{c}/{j}" for j in TESTED for c in of_joints), *hidden]


def _edges(joint: str) -> Array:
    """deg in the direction of the stretch, over its range."""
    trial = stretch(joint, "mas")
    low, high = np.degrees(trial.direction * np.array([trial.start, trial.end]))
    return np.arange(np.floor(low / BIN) * BIN, high + BIN, BIN)[: int(np.ceil((high - low) / BIN)) + 1]


def _floats(table: Any, column: str) -> Array:
    """A column; nan where there is nothing."""
    return np.asarray(table[column].to_pandas(), dtype=np.float64)


def _count(counts: Counts, rows: Array, columns: Array) -> None:
    """Count pairs where both are there."""
    both = np.isfinite(rows) & np.isfinite(columns)
    np.add.at(counts, (rows[both].astype(int), columns[both].astype(int)), 1)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None

"""A small dataset of invented patients, in the tables of a real one, without a simulation.

A latent gain, threshold and stiffness make crude torque, EMG and pendulum curves; the ideal grade follows a mixture of
what they do in a rating session with its own reflexes, and two raters each add their noise.
"""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mjhcmc.patients.trials import REST

JOINTS = ("hip", "knee", "ankle")
GROUPS = {"hip": "hip_flexors", "knee": "knee_extensors", "ankle": "plantarflexors"}
EMG = ("glut_max", "rect_fem", "hamstrings", "vasti", "gastroc", "soleus", "tib_ant")
STRETCHED = {"hip": ("rect_fem",), "knee": ("rect_fem", "vasti"), "ankle": ("gastroc", "soleus")}
MAS = ("0", "1", "1+", "2", "3", "4")
WAYS = {"hip": (60.0, -10.0), "knee": (-5.0, -110.0), "ankle": (-35.0, 15.0)}  # deg
RATE = 50.0
ORIGIN = {"generator": "test", "configuration": "abc", "seed": 7}
SHARES = {"train": 0.6, "validation": 0.1, "test": 0.15} | dict.fromkeys(
    ("shift_muscle", "shift_reflex", "shift_velocity"), 0.05
)


def make_dataset(folder: Path, n: int = 200, *, seed: int = 0, noise: float = 0.55, failed=(3,), tests=None) -> Path:
    """Write a dataset; noise is the raters', in ranks; failed are patients without trials."""
    rng = np.random.default_rng(seed)
    counts = {split: int(share * n) for split, share in SHARES.items()}
    counts["train"] += n - sum(counts.values())
    index = 0
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "manifest.json").write_text(json.dumps({"patients": n}))
    for split, count in counts.items():
        for k, size in enumerate(np.bincount(np.arange(count) * 2 // max(count, 1), minlength=2).tolist()):
            if size:
                patients = [Invented(rng, i, split, noise, i in failed, tests) for i in range(index, index + size)]
                write_shard(folder / split / f"shard-{k:05d}", patients)
                index += size
    return folder


class Invented:
    """One patient: rows of the tables."""

    def __init__(self, rng, index, split, noise, failed, tests):
        self.height, self.mass = rng.uniform(1.5, 1.9), rng.uniform(50, 95)
        row = {"patient": index, "split": split, "status": "failed" if failed else "ok", "reason": "", **ORIGIN}
        row |= {"sex": rng.choice(["M", "F"]), "height": self.height, "body_mass": self.mass}
        severity = rng.uniform(0, 1)
        row |= {"latent/severity": severity}
        self.trials, self.samples = [], []
        for joint in JOINTS:
            gain = max(0.0, 2 * severity + rng.normal(scale=0.5))
            threshold, stiff = rng.uniform(0.2, 1.5), rng.uniform(0.0, 1.0) ** 2
            row |= {f"latent/gain/{GROUPS[joint]}": gain, f"latent/threshold/{GROUPS[joint]}": threshold}
            caught = gain * max(0.0, 1.6 - threshold) * rng.lognormal(sigma=0.2)  # of the rating session
            true = min(5.0, 1.2 * caught + 2.0 * stiff)
            ideal = round(true)
            graders = {"ideal": ideal} | {f"rater_{r}": round(true + rng.normal(scale=noise)) for r in "ab"}
            for reader, rank in graders.items():
                rank = int(np.clip(rank, 0, 5))
                row |= {f"{reader}_rank/{joint}": rank, f"{reader}/{joint}": MAS[rank]}
            if not failed:
                for test, speed in tests or (("slow", 60), ("mas", 150), ("fast", 180), ("fast", 300)):
                    self.stretch(rng, index, split, joint, test, speed, gain, threshold, stiff)
                if joint == "knee":
                    self.pendulum(rng, index, split, gain)
        self.row = row

    def add(self, index, split, joint, test, speed, start, end, time, columns):
        trial = len(self.trials)
        self.trials.append({
            "patient": index, "split": split, "trial": trial, "name": f"{test}_{speed}/{joint}", "test": test,
            "joint": joint, "session": "instrumented", "posture": "side_lying", "examiner": "torque",
            "speed_deg_s": float(speed), "start_deg": start, "end_deg": end, "duration_s": len(time) / RATE,
            "rate_hz": RATE, "status": "ok", "reason": "", **ORIGIN,
        })  # fmt: skip
        zero = np.zeros(len(time))
        table = {"patient": np.full(len(time), index), "trial": np.full(len(time), trial, np.int16), "time": time}
        for name in (*(f"q/{j}" for j in JOINTS), *(f"v/{j}" for j in JOINTS), "torque", *(f"emg/{m}" for m in EMG)):
            table[name] = columns.get(name, zero).astype(np.float32)
        self.samples.append(table)

    def stretch(self, rng, index, split, joint, test, speed, gain, threshold, stiff):
        start, end = WAYS[joint]
        T = 1.875 * abs(end - start) / speed
        time = np.arange(0, 1.0 + T, 1 / RATE)
        x = np.clip((time - REST) / T, 0, 1)
        part, rate = x**3 * (10 + x * (-15 + 6 * x)), x**2 * (30 + x * (-60 + 30 * x)) / T
        sign, way = np.sign(end - start), np.radians(abs(end - start))
        burst = 0.5 * gain * np.maximum(0.0, rate - threshold) * rng.lognormal(sigma=0.25)
        size = self.mass * self.height
        torque = sign * size * (0.15 * stiff * part**3 + 0.05 * burst) + rng.normal(scale=0.3, size=len(time))
        columns = {
            f"q/{joint}": np.radians(start) + sign * way * part + rng.normal(scale=0.009, size=len(time)),
            f"v/{joint}": sign * way * rate + rng.normal(scale=0.017, size=len(time)),
            "torque": torque,
        }
        for muscle in EMG:
            level = 0.02 + (burst if muscle in STRETCHED[joint] else 0.0)
            columns[f"emg/{muscle}"] = np.abs(level * rng.lognormal(sigma=0.2, size=len(time)))
        self.add(index, split, joint, test, speed, start, end, time, columns)

    def pendulum(self, rng, index, split, gain):
        time = np.arange(0, 4, 1 / RATE)
        damping = (0.5 + 0.7 * gain) * rng.lognormal(sigma=0.25)
        q = -1.2 + 1.2 * np.exp(-damping * time) * np.cos(6 * time)
        columns = {"q/knee": q + rng.normal(scale=0.009, size=len(time)), "v/knee": np.gradient(q, time)}
        self.add(index, split, "knee", "pendulum", 0, 0.0, 0.0, time, columns)


def write_shard(folder: Path, patients: list[Invented]) -> None:
    """The three tables that learning reads."""
    folder.mkdir(parents=True)
    write(folder / "patients.parquet", columns_of([p.row for p in patients]))
    write(folder / "trials.parquet", columns_of([row for p in patients for row in p.trials]))
    samples = [table for p in patients for table in p.samples]
    joined = {name: np.concatenate([table[name] for table in samples]) for name in samples[0]}
    write(folder / "observables.parquet", joined | {k: [v] * len(joined["time"]) for k, v in ORIGIN.items()})


def columns_of(rows: list[dict]) -> dict:
    return {name: [row[name] for row in rows] for name in rows[0]}


def write(path: Path, columns: dict) -> None:
    table = pa.table(columns)
    for name in ("split", "generator", "configuration"):
        if name in table.column_names:
            i = table.column_names.index(name)
            table = table.set_column(i, name, table.column(name).dictionary_encode())
    pq.write_table(table, path)


def edit(path: Path, change) -> None:
    """Write a small table anew with its columns changed by change(columns)."""
    columns = pq.read_table(path).to_pydict()
    change(columns)
    write(path, columns)


def append(path: Path, name: str, values) -> None:
    """Write a table anew with one more column, values(columns)."""
    table = pq.read_table(path)
    pq.write_table(table.append_column(name, pa.array(values(table))), path)


def drop(path: Path, name: str) -> None:
    """Write a table anew without a column."""
    table = pq.read_table(path)
    pq.write_table(table.drop_columns([name]), path)

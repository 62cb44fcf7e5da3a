"""The dataset card: README.md with the front matter that Hugging Face reads, and what each column means."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Literal

from mjhcmc.patients.configuration import SHARES, Configuration, splits
from mjhcmc.patients.shards import TABLES

CARD = "README.md"

Kind = Literal["key", "observable", "label", "latent", "privileged"]


@dataclass(frozen=True)
class ColumnDoc:
    """What a column is, or all columns of a pattern.

    Attributes:
        table: where it is; ``"*"``: in all of them.
        pattern: its name; ``*`` stands for a joint, a muscle or a muscle group.
        unit: SI or degrees; empty for words and counts.
        kind: ``"key"`` joins and traces rows; ``"observable"`` is what a clinic could measure; ``"label"`` what is to
            be predicted; ``"latent"`` and ``"privileged"`` are known of virtual patients only.
        meaning: in words.
    """

    table: str
    pattern: str
    unit: str
    kind: Kind
    meaning: str

    def covers(self, table: str, column: str) -> bool:
        """Whether it is about a column."""
        return self.table in ("*", table) and fnmatchcase(column, self.pattern)


def column_docs() -> tuple[ColumnDoc, ...]:
    """What every column of the four tables is; where two cover one, the first counts."""
    return tuple(ColumnDoc(*row) for row in _ROWS)


def document(table: str, column: str) -> ColumnDoc | None:
    """What a column is; None where that is not known."""
    return next((doc for doc in column_docs() if doc.covers(table, column)), None)


_ROWS: tuple[tuple[str, str, str, Kind, str], ...] = (
    ("*", "generator", "", "key", "version of mjhcmc and of the dataset's format"),
    ("*", "configuration", "", "key", "hash of the configuration in manifest.json"),
    ("*", "seed", "", "key", "seed of the cohort; never an input"),
    ("*", "patient", "", "key", "index of the patient; never an input"),
    ("*", "split", "", "key", "split of the patient"),
    ("*", "trial", "", "key", "number of the trial within the patient's battery"),
    ("patients", "status", "", "key", "ok, or failed: then the reason says why, and labels may be missing"),
    ("patients", "reason", "", "key", "why the simulation failed; empty otherwise"),
    ("patients", "sex", "", "observable", "F or M"),
    ("patients", "height", "m", "observable", "body height"),
    ("patients", "body_mass", "kg", "observable", "body mass"),
    ("patients", "ideal/*", "", "label", "Modified Ashworth grade of a reader without noise: 0, 1, 1+, 2, 3, 4"),
    ("patients", "rater_a/*", "", "label", "grade that a simulated rater gives; the target"),
    ("patients", "rater_b/*", "", "label", "grade of a second rater; its agreement with the first is the ceiling"),
    ("patients", "ideal_rank/*", "0 to 5", "label", "rank of the ideal grade (1+ is 2)"),
    ("patients", "rater_a_rank/*", "0 to 5", "label", "rank of the first rater's grade"),
    ("patients", "rater_b_rank/*", "0 to 5", "label", "rank of the second rater's grade"),
    ("patients", "catch_angle/*", "deg", "label",
     "joint angle of the catch in the ideal reading; missing without a catch"),
    ("patients", "resistance/*", "N m", "label",
     "resistance in the ideal reading, the excess over a healthy limb of that size: the largest after the catch, or of "
     "the whole stretch where there is no catch"),
    ("patients", "range_affected/*", "0 to 1", "label", "share of the range with resistance in the ideal reading"),
    ("patients", "range_lost/*", "0 to 1", "label", "share of the passive range lost in the ideal reading"),
    ("patients", "latent/reflex", "", "latent", "model of the stretch reflex: velocity, equation1 or force"),
    ("patients", "latent/muscle", "", "latent", "muscle model that moves the patient"),
    ("patients", "latent/*_mass_fraction", "", "latent", "mass of thigh, shank or foot over body mass"),
    ("patients", "latent/strength", "", "latent", "max isometric force over that expected, before paresis"),
    ("patients", "latent/paresis", "", "latent", "share of the strength that is left"),
    ("patients", "latent/severity", "", "latent", "0 to 1, the cause that the mechanisms share"),
    ("patients", "latent/delay", "s", "latent", "delay of the reflex"),
    ("patients", "latent/cocontraction", "", "latent", "excitation of antagonists over that of agonists"),
    ("patients", "latent/activation_time", "s", "latent", "activation time constant"),
    ("patients", "latent/deactivation_time", "s", "latent", "deactivation time constant"),
    ("patients", "latent/gain/*", "s", "latent",
     "gain of the reflex: excitation per optimal fiber length a second (equation1: 1/lopt, excitation per optimal "
     "fiber length of stretch; force: per max isometric force)"),
    ("patients", "latent/threshold/*", "1/s", "latent",
     "threshold of the reflex, optimal fiber lengths a second (force: over max isometric force)"),
    ("patients", "latent/passive_strain/*", "", "latent", "fiber strain at which passive force is max isometric force"),
    ("patients", "latent/fiber_shortening/*", "", "latent", "share of the optimal fiber length lost to contracture"),
    ("patients", "latent/tone/*", "", "latent", "excitation at rest"),
    ("patients", "latent/*", "", "latent", "parameter of the patient"),
    ("trials", "name", "", "observable", "test, speed and joint"),
    ("trials", "test", "", "observable", "slow, mas, fast, pendulum, cosine or walk"),
    ("trials", "joint", "", "observable", "joint under test; empty in voluntary movements"),
    ("trials", "session", "", "observable", "only instrumented trials have rows in observables and privileged"),
    ("trials", "posture", "", "observable", "side_lying, seated, hanging or standing"),
    ("trials", "examiner", "", "observable", "servo, torque (an examiner's arm) or empty (none)"),
    ("trials", "speed_deg_s", "deg/s", "observable", "commanded peak speed"),
    ("trials", "start_deg", "deg", "observable", "commanded start of the stretch; signs as q"),
    ("trials", "end_deg", "deg", "observable", "commanded end of the stretch; signs as q"),
    ("trials", "duration_s", "s", "observable", "duration"),
    ("trials", "rate_hz", "Hz", "observable", "samples a second in observables"),
    ("trials", "reserve_nm", "N m", "privileged", "voluntary movements: what the muscles lack at the worst joint"),
    ("trials", "status", "", "key",
     "ok, failed or helped: a voluntary movement for which the muscles lack more than 5 N m at a joint, given by "
     "reserves (see reserve_nm)"),
    ("trials", "reason", "", "key", "why the trial failed or was helped; empty otherwise"),
    ("observables", "time", "s", "observable", "from the start of the trial"),
    ("observables", "q/*", "rad", "observable",
     "joint angle, with the goniometer's noise; 0 in the anatomical position; hip flexion, knee extension and ankle "
     "dorsiflexion positive: knee flexion is negative"),
    ("observables", "v/*", "rad/s", "observable", "joint velocity, with the gyroscope's noise; signs as q"),
    ("observables", "torque", "N m", "observable",
     "examiner's torque at the joint under test, with noise, positive in the direction of the positive angle; 0 where "
     "nobody pushes; torques that hold the other joints are not recorded"),
    ("observables", "emg/*", "", "observable", "EMG-like envelope with noise; iliopsoas has no surface EMG"),
    ("privileged", "time", "s", "privileged", "from the start of the trial; every second sample of observables"),
    ("privileged", "excitation/*", "0 to 1", "privileged", "excitation"),
    ("privileged", "reflex/*", "0 to 1", "privileged", "part of the excitation that is reflex"),
    ("privileged", "activation/*", "0 to 1", "privileged", "activation"),
    ("privileged", "fiber_length/*", "", "privileged", "fiber length over optimal fiber length"),
    ("privileged", "fiber_velocity/*", "1/s", "privileged", "optimal fiber lengths a second, lengthening positive"),
    ("privileged", "force/*", "N", "privileged", "muscle force along the tendon"),
)  # fmt: skip

_FOLLOWS = ("walk_digest",)
"""Settings that are computed from others."""

_ABOUT = {
    "patients": "one row a patient: demographics, labels, latent parameters",
    "trials": "one row a trial: what the test asked for",
    "observables": "samples of what a clinic could measure",
    "privileged": "samples of what only a simulation knows",
}

_SHIFTS = {
    "train": "fit here",
    "validation": "choose here",
    "test": "patients like those of train",
    "shift_muscle": "patients moved by another muscle model",
    "shift_reflex": "patients with another reflex model",
    "shift_velocity": "stretches at other speeds",
}

_TEXT = """
# Virtual patients with spasticity

**Synthetic data. Not clinically validated. Not for diagnosis, treatment, or any decision about a person.** No patient
was measured: anthropometry, strength, contracture, tone and stretch reflexes are drawn from distributions, clinical
tests of hip, knee and ankle are simulated on a muscle-driven leg, and simulated raters grade them.

Made by `{generator}` from configuration `{hash}`, seed {seed}: {patients} patients. `manifest.json` holds all settings,
versions and checksums; on one platform and those versions, the command below gives the same bytes.

    {command}

## Splits

By patient; no patient is in two. A patient that failed is a row with its reason, and counts.

{splits}

## Tables

Each split has folders `shard-00000`, ...; each of them holds the four tables of its patients as Parquet, and
`checksums.json`.

{tables}

Labels are in `patients`: the grade of each tested joint on the Modified Ashworth Scale by a simulated rater
(`rater_a_rank/<joint>` is the target), by a second rater, and by a reader without noise. The agreement of the two
raters is what a model is measured against: one that knows the ideal grade agrees with a rater better than another
rater does, so that a score may lie between the two; one well beyond means leakage. Inputs are observable columns only:
not latent or privileged ones, not `patient`, `seed` or the number of the shard.

{columns}

## Loading

```python
from datasets import load_dataset

load_dataset("DIR", "observables", split="train")
load_dataset("parquet", data_files={{"train": "DIR/train/*/patients.parquet"}})

import polars

polars.scan_parquet("DIR/train/*/observables.parquet").filter(polars.col("patient") == 0).collect()

import pandas
from pathlib import Path

pandas.concat(map(pandas.read_parquet, sorted(Path("DIR").glob("train/*/patients.parquet"))))
```

## Credit

The leg is after gait10dof18musc (Delp, Loan, Hoy, Zajac, Topp, Rosen, Thelen, Anderson, Seth; CC-BY 3.0), simplified
and changed for each virtual patient; made with mjhcmc (Apache-2.0).
"""


def card(configuration: Configuration) -> str:
    """README.md of a dataset.

    Args:
        configuration: of the dataset.
    """
    blocks = {name: block for name, block in splits(configuration.patients).items() if block}
    shares = [f"- `{name}` ({SHARES[name]} %): {_patients(block)}; {_SHIFTS[name]}" for name, block in blocks.items()]
    text = _TEXT.format(
        generator=configuration.generator,
        hash=configuration.hash,
        seed=configuration.seed,
        patients=configuration.patients,
        command=command(configuration),
        splits="\n".join(shares),
        tables="\n".join(f"- `{name}`: {about}" for name, about in _ABOUT.items()),
        columns="\n\n".join(_section(table) for table in ("*", *TABLES)),
    )
    return _front_matter(configuration, list(blocks)) + text


def command(configuration: Configuration) -> str:
    """The command line that makes a dataset, but for its folder: with every setting that is not the default.

    Args:
        configuration: of the dataset.
    """
    from mjhcmc.patients.examination import DEFAULTS  # loads the simulation

    words = ["mjhcmc", "patients", "generate", "--n", str(configuration.patients), "--seed", str(configuration.seed)]
    words += ["--shard-size", str(configuration.shard_size)]
    for name, value in configuration.settings.items():
        if name not in _FOLLOWS and (name not in DEFAULTS or value != DEFAULTS[name]):
            words += ["--set", f"{name}={value}"]
    return f"{shlex.join(words)} --out DIR"


def _patients(block: range) -> str:
    return f"patient {block[0]}" if len(block) == 1 else f"{len(block)} patients, {block[0]} to {block[-1]}"


def _front_matter(configuration: Configuration, present: list[str]) -> str:
    """What Hugging Face reads: one configuration a table, files by split; splits without patients have no files."""
    n = configuration.patients
    bounds = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
    lines = [
        "---",
        "pretty_name: Virtual patients with spasticity",
        "license: cc-by-3.0",  # as the model that it is after
        "task_categories:",
        "- tabular-classification",
        "tags:",
        "- synthetic",
        "- biomechanics",
        "- spasticity",
        "- EMG",
        "size_categories:",
        f"- {next((name for most, name in bounds if n < most), 'n>1M')}",
        "configs:",
    ]
    for table in TABLES:
        lines += [f"- config_name: {table}", *(["  default: true"] if table == "observables" else []), "  data_files:"]
        for split in present:
            lines += [f"  - split: {split}", f"    path: {split}/*/{table}.parquet"]
    return "\n".join([*lines, "---", ""])


def _section(table: str) -> str:
    rows = [doc for doc in column_docs() if doc.table == table]
    title = "### Columns of every table (`trial` not in patients)" if table == "*" else f"### {table}"
    head = ["| column | unit | kind | meaning |", "|---|---|---|---|"]
    return "\n".join(
        [title, "", *head, *(f"| `{doc.pattern}` | {doc.unit} | {doc.kind} | {doc.meaning} |" for doc in rows)]
    )

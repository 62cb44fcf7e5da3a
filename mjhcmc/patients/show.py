"""A look at one virtual patient, from a dataset or simulated on the spot: what the tests gave, and the figure of it."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import OutputError, SettingsError
from mjhcmc.leg8.table import JOINTS, MUSCLES
from mjhcmc.patients.configuration import Configuration, whole_number
from mjhcmc.patients.grades import READERS
from mjhcmc.patients.groups import TESTED
from mjhcmc.patients.patient import Patient
from mjhcmc.patients.record import Record
from mjhcmc.patients.shards import TABLES
from mjhcmc.patients.stored import open_manifest, read_table, shards_in
from mjhcmc.patients.trials import Trial, pendulum, stretch, voluntary

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.figure import Figure

    from mjhcmc.model import MuscleModel

Array = NDArray[np.float64]
Row = dict[str, Any]

_NOT_LATENT = ("sex", "height", "body_mass", "seed")
_HIDDEN = {"excitation": "excitation", "reflex": "reflex", "activation": "activation", "fiber_length": "fiber_length",
           "fiber_velocity": "fiber_velocity", "muscle_force": "force"}  # fmt: skip
_SMOOTH = 0.02  # s, of angular velocities before they are differentiated


@dataclass(frozen=True, eq=False)
class Shown:
    """A patient and the trials that instruments recorded.

    Attributes:
        row: of the table of patients.
        patient: whom it is about.
        records: of the trials, as instruments saw them; what is hidden is as it was. Accelerations come from the noisy
            velocities, smoothed.
        source: the dataset, or that the patient was simulated here.
    """

    row: Row
    patient: Patient
    records: tuple[Record, ...]
    source: str

    def record(self, name: str) -> Record:
        """The trial of a name.

        Raises:
            SettingsError: there is none.
        """
        names = [record.trial.name for record in self.records]
        return self.records[_place(name, names)]

    @property
    def title(self) -> str:
        """Who it is, for figures."""
        return f"Virtual patient {self.patient.index} · {self.person}"

    @property
    def person(self) -> str:
        """Sex, height and mass in words."""
        who = {"F": "woman", "M": "man"}[self.patient.sex]
        return f"{who}, {self.patient.height:.2f} m, {self.patient.body_mass:.0f} kg"

    def figure(self, trial: str | None = None) -> Figure:
        """The patient's sheet, or one trial.

        Args:
            trial: its name; None: the sheet.

        Raises:
            SettingsError: no such trial.
            SimulationError: it left nothing to draw.
        """
        from mjhcmc.plotting.patient import patient_figure
        from mjhcmc.plotting.trial import Grading, trial_figure

        gradings = {}
        for joint in TESTED:
            ideal, *raters = (self.row[f"{reader}/{joint}"] for reader in READERS)
            catch = self.row[f"catch_angle/{joint}"]
            gradings[joint] = Grading(
                ideal, tuple(filter(None, raters)), None if catch is None else float(np.radians(catch))
            )
        if trial is None:
            return patient_figure(self.records, gradings, self.title, self.patient)
        record = self.record(trial)
        return trial_figure(record, self.title, gradings.get(record.trial.joint, Grading()))

    def screen(self) -> str:
        """Grades, readings and latent values, for a person."""
        p, row = self.patient, self.row
        lines = [f"patient {p.index} ({self.source}, split {row['split']}): {self.person}", ""]
        if row["reason"]:
            lines += [f"FAILED  {row['reason']}", ""]
        table = [["joint", "ideal", "rater a", "rater b", "catch", "resistance", "range affected", "range lost"]]
        for joint in TESTED:
            grades = [row[f"{reader}/{joint}"] or "-" for reader in READERS]
            table.append([joint, *grades, *_reading(row, joint)])
        lines += [*stand_under_each_other(table), ""]
        unit, bound = {"velocity": ("s", "1/s"), "equation1": ("1/lopt", "1/s"), "force": ("1/F0", "F0")}[p.reflex]
        table = [["latent", f"gain ({unit})", f"threshold ({bound})", "tone", "shortening", "passive strain"]]
        for group in p.groups:
            values = (group.gain, group.threshold, group.tone, group.fiber_shortening, group.passive_strain)
            table.append([group.name.replace("_", " "), *(f"{value:.3g}" for value in values)])
        lines += stand_under_each_other(table)
        lines += [
            f"severity {p.severity:.2f}, strength {p.strength:.2f}, paresis {p.paresis:.2f} (of it left), "
            f"delay {1e3 * p.delay:.0f} ms, co-contraction {p.cocontraction:.3f},",
            f"activation {1e3 * p.activation_time:.0f} ms, deactivation {1e3 * p.deactivation_time:.0f} ms; "
            f"reflex {p.reflex}, muscles {p.muscle}",
        ]
        failed = [record for record in self.records if record.failure]
        lines += ["", *(f"failed  {record.failure}" for record in failed)] if failed else []
        return "\n".join(lines)


def patient_of_dataset(folder: Path | str, index: int) -> Shown:
    """A patient of a dataset.

    Args:
        folder: of the dataset.
        index: of the patient.

    Raises:
        OutputError: no dataset, or the patient's shard is not there or cannot be read.
        SettingsError: no such patient.
    """
    folder = Path(folder)
    manifest = open_manifest(folder)
    if not 0 <= index < manifest.patients:
        raise SettingsError(f"patient {index} is not in {folder}: choose one of 0 to {manifest.patients - 1}")
    there, missing = shards_in(folder, manifest)
    shard = next(shard for shard in (*there, *missing) if shard.first <= index < shard.last)
    if shard in missing:
        raise OutputError(f"{folder}: {shard} is not there yet: let mjhcmc patients generate finish")
    tables = {name: read_table(folder / shard.name / f"{name}.parquet", patient=index) for name in TABLES}
    return _shown(tables, index, str(folder))


def simulated_patient(seed: int, index: int) -> Shown:
    """A patient who is drawn and simulated here and now, with the default settings of a dataset.

    Args:
        seed: of the cohort.
        index: of the patient.

    Raises:
        SettingsError: a number below 0 or not whole.
    """
    from mjhcmc.patients import examination

    index = whole_number("index", index, 0)
    tables = examination.simulate_block(Configuration.with_defaults(index + 1, seed), "train", index, index + 1)
    return _shown(tables, index, f"seed {seed}, simulated now")


def _shown(tables: Mapping[str, pa.Table], index: int, source: str) -> Shown:
    rows = tables["patients"].to_pylist()
    if len(rows) != 1:
        raise OutputError(f"patient {index} has {len(rows)} rows in {source}: generate the dataset again")
    row = rows[0]
    try:
        latent = {name.removeprefix("latent/"): value for name, value in row.items() if name.startswith("latent/")}
        patient = Patient.from_row({**latent, "index": index, **{name: row[name] for name in _NOT_LATENT}})
        records = tuple(_record(patient, trial, tables) for trial in tables["trials"].to_pylist())
    except KeyError as error:
        raise OutputError(f"{source}: column {error} is missing: generate the dataset with this version") from None
    return Shown(row, patient, records, source)


def _record(patient: Patient, row: Row, tables: Mapping[str, pa.Table]) -> Record:
    """A trial as the tables have it; what is hidden, and kept of fewer samples, is interpolated."""
    trial = _trial(row)
    seen, hidden = (_samples(tables[name], row["trial"]) for name in ("observables", "privileged"))
    time = seen["time"]
    if not len(time):
        return Record.missing(trial, row["reason"])
    qpos, qvel = (np.column_stack([seen[f"{kind}/{joint}"] for joint in JOINTS]) for kind in "qv")
    torque, inertia = np.zeros_like(qpos), 0.0
    if trial.examiner:
        torque[:, JOINTS.index(trial.joint)] = seen["torque"]
        from mjhcmc.patients.bench import limb_inertia

        inertia = limb_inertia(_leg(patient), trial)
    of_muscles = {
        name: np.column_stack([np.interp(time, hidden["time"], hidden[f"{column}/{m}"]) for m in MUSCLES])
        for name, column in _HIDDEN.items()
    }
    return Record(
        trial, time, qpos, qvel, _derivative(qvel, trial.rate), torque, inertia, **of_muscles,
        reserve=row["reserve_nm"], failure=row["reason"],
    )  # fmt: skip


def _trial(row: Row) -> Trial:
    """What a row of the table of trials asked for."""
    if row["test"] == "pendulum":
        trial = pendulum(row["rate_hz"])
    elif row["joint"]:
        speed = None if row["test"] == "mas" else float(np.radians(row["speed_deg_s"]))
        trial = stretch(row["joint"], row["test"], speed, examiner=row["examiner"], rate=row["rate_hz"])
    else:
        trial = voluntary(row["test"], "", row["rate_hz"])
    return replace(
        trial, name=row["name"], posture=row["posture"], start=float(np.radians(row["start_deg"])),
        end=float(np.radians(row["end_deg"])), speed=float(np.radians(row["speed_deg_s"])), duration=row["duration_s"],
    )  # fmt: skip


def _samples(table: pa.Table, trial: int) -> dict[str, Array]:
    """The numbers of a trial, by column."""
    import pyarrow as pa
    import pyarrow.compute as pc

    own = table.filter(pc.equal(table["trial"], trial))
    return {
        field.name: np.asarray(own[field.name], dtype=np.float64)
        for field in own.schema
        if pa.types.is_floating(field.type)
    }


def _derivative(qvel: Array, rate: float) -> Array:
    """(n, 3) rad/s^2, of velocities with noise."""
    from scipy.ndimage import gaussian_filter1d

    found: Array = gaussian_filter1d(qvel, _SMOOTH * rate, axis=0, order=1, mode="nearest") * rate
    return found


@functools.lru_cache(maxsize=1)
def _leg(patient: Patient) -> MuscleModel:
    from mjhcmc.patients.leg import leg_of

    return leg_of(patient)


def show_command(
    folder: Path | None, patient: int | None, drawn: tuple[int, int] | None, trial: str | None, out: Path | None,
    as_json: bool = False, quiet: bool = False,
) -> int:  # fmt: skip
    """What ``mjhcmc patients show`` does: print, and draw.

    Args:
        folder: of the dataset.
        patient: index there; None: all patients.
        drawn: seed and index of a patient to simulate instead.
        trial: name of the only one to draw.
        out: folder for the figure; None: nothing is drawn.
        as_json: print one JSON object and nothing else.
        quiet: print nothing.

    Returns:
        0.

    Raises:
        MjhcmcError: no such dataset, patient or trial; a folder that cannot be written, or holds other things.
    """
    import json
    from contextlib import ExitStack
    from functools import partial

    import click

    from mjhcmc.io.files import output_folder
    from mjhcmc.patients.overview import Overview, look_at
    from mjhcmc.plotting import save_figures

    if folder is not None:
        open_manifest(folder)
    elif trial is not None:
        _check_trial(trial)
    stem = "cohort" if patient is None else f"patient-{patient}"
    if drawn is not None:
        stem = f"patient-seed{drawn[0]}-{drawn[1]}"
    stem += "" if trial is None else "-" + trial.replace("/", "-")
    with ExitStack() as stack:
        if out is not None:
            _check_ours(out, stem, folder)
            stack.enter_context(output_folder(out))
        found: Shown | Overview
        if drawn is not None:
            found = simulated_patient(*drawn)
        else:
            assert folder is not None  # one of them is given
            found = look_at(folder) if patient is None else patient_of_dataset(folder, patient)
        draw = partial(found.figure, trial) if isinstance(found, Shown) else found.figure
        files = [] if out is None else save_figures({stem: draw}, out)
    if as_json:
        about = found.row if isinstance(found, Shown) else found.numbers()
        click.echo(json.dumps({**about, "files": files}))
    elif not quiet:
        click.echo(found.screen())
        if files:
            click.echo(f"written  {', '.join(files)}")
    return 0


def _check_trial(name: str) -> None:
    """See that there is such a trial in the default battery, before it is simulated."""
    from mjhcmc.patients.examination import DEFAULTS, battery

    _place(name, [trial.name for trial in battery(dict(DEFAULTS)) if trial.session == "instrumented"])


def _place(name: str, names: list[str]) -> int:
    if name not in names:
        raise SettingsError(f"trial {name!r} is not among this patient's: choose one of {', '.join(names)}")
    return names.index(name)


def _check_ours(out: Path, stem: str, dataset: Path | None) -> None:
    """See that the figures replace nothing but figures of mjhcmc, and do not lie among what is loaded as a dataset."""
    if dataset is not None and dataset.resolve() in (out.resolve(), *out.resolve().parents):
        raise OutputError(f"{out}: lies in the dataset {dataset}: choose another --out")
    for kind in ("png", "pdf"):
        path = out / f"{stem}.{kind}"
        try:
            ours = not path.exists() or (path.is_file() and b"mjhcmc" in path.read_bytes())
        except OSError as error:
            raise OutputError(f"{path}: cannot be read ({error.strerror}): choose another --out") from None
        if not ours:
            raise OutputError(f"{path}: is there, and no figure of mjhcmc: move it away, or choose another --out")


def _reading(row: Row, joint: str) -> list[str]:
    """Catch, resistance, range affected and lost in words."""
    if row[f"ideal/{joint}"] is None:
        return ["-"] * 4
    catch = row[f"catch_angle/{joint}"]
    resistance, affected, lost = (row[f"{name}/{joint}"] for name in ("resistance", "range_affected", "range_lost"))
    return [
        "none" if catch is None else f"{catch:.0f}°".replace("-", "−"), f"{resistance:.1f} N m",
        f"{100 * affected:.0f} %", f"{100 * lost:.0f} %",
    ]  # fmt: skip


def stand_under_each_other(table: list[list[str]]) -> list[str]:
    """Rows whose columns stand under each other."""
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    return ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in table]

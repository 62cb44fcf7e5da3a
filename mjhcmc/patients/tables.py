"""The four tables of a dataset: what is measured, what is hidden, who the patients are, what was asked of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from mjhcmc.leg8.table import JOINTS, MUSCLES
from mjhcmc.patients.grades import READERS
from mjhcmc.patients.groups import TESTED
from mjhcmc.patients.patient import Patient
from mjhcmc.patients.record import Record
from mjhcmc.patients.sensors import EMG_MUSCLES, Observation

if TYPE_CHECKING:
    from mjhcmc.patients.configuration import Configuration

_TRACE = [("generator", pa.string()), ("configuration", pa.string()), ("seed", pa.int64())]
_SAMPLE = [("patient", pa.int64()), ("trial", pa.int16()), ("time", pa.float32())]
_READINGS = ("catch_angle", "resistance", "range_affected", "range_lost")
_HIDDEN = ("excitation", "reflex", "activation", "fiber_length", "fiber_velocity", "force")
_FIELDS = ("excitation", "reflex", "activation", "fiber_length", "fiber_velocity", "muscle_force")
_NOT_LATENT = ("seed", "index", "sex", "height", "body_mass")

HELP = 5.0
"""N m, of reserves in a movement by will, beyond which it is not the patient's own; a tenth of what a knee gives."""

_HIDDEN_EVERY = 2  # samples


def _schemas() -> dict[str, pa.Schema]:
    observed = [f"{kind}/{joint}" for kind in "qv" for joint in JOINTS] + ["torque", *(f"emg/{m}" for m in EMG_MUSCLES)]
    hidden = [f"{kind}/{muscle}" for kind in _HIDDEN for muscle in MUSCLES]
    trials = [
        ("patient", pa.int64()), ("split", pa.string()), ("trial", pa.int16()), ("name", pa.string()),
        ("test", pa.string()), ("joint", pa.string()), ("session", pa.string()), ("posture", pa.string()),
        ("examiner", pa.string()), ("speed_deg_s", pa.float64()), ("start_deg", pa.float64()),
        ("end_deg", pa.float64()), ("duration_s", pa.float64()), ("rate_hz", pa.float64()),
        ("reserve_nm", pa.float64()), ("status", pa.string()), ("reason", pa.string()),
    ]  # fmt: skip
    return {
        "trials": pa.schema(trials + _TRACE),
        "observables": pa.schema(_SAMPLE + [(name, pa.float32()) for name in observed] + _TRACE),
        "privileged": pa.schema(_SAMPLE + [(name, pa.float32()) for name in hidden] + _TRACE),
    }


SCHEMAS: dict[str, pa.Schema] = _schemas()
"""Of all tables but that of patients, whose latent columns are those of `Patient.row`."""


class Block:
    """Tables of some patients of one split, filled patient by patient.

    Args:
        configuration: of the dataset.
        split: of the patients.
    """

    def __init__(self, configuration: Configuration, split: str) -> None:
        self._trace = (configuration.generator, configuration.hash, configuration.seed)
        self._split = split
        self._patients: list[dict[str, Any]] = []
        self._trials: list[dict[str, Any]] = []
        self._samples: dict[str, list[pa.Table]] = {name: [] for name in ("observables", "privileged")}

    def patient(self, patient: Patient, grades: dict[str, dict[str, Any]], failure: str) -> None:
        """Add a patient.

        Args:
            patient: the patient.
            grades: labels by joint, with the ideal ``reading``; empty where there are none.
            failure: why some of the patient's trials are missing; empty where nothing is.
        """
        latent = patient.row()
        row: dict[str, Any] = {
            "patient": patient.index, "split": self._split, "status": "failed" if failure else "ok", "reason": failure,
            "sex": patient.sex, "height": patient.height, "body_mass": patient.body_mass,
        }  # fmt: skip
        for joint in TESTED:
            of_joint = grades.get(joint, {})
            for rater in READERS:
                row[f"{rater}/{joint}"] = of_joint.get(rater)
                row[f"{rater}_rank/{joint}"] = of_joint.get(f"{rater}_rank")
            reading = of_joint.get("reading")
            values: tuple[Any, ...] = (None,) * len(_READINGS)
            if reading is not None:
                caught = float(np.degrees(reading.catch_angle)) if reading.catch else None
                values = (caught, reading.peak_after_catch if reading.catch else reading.peak,
                          reading.range_affected, reading.range_lost)  # fmt: skip
            row.update({f"{name}/{joint}": value for name, value in zip(_READINGS, values, strict=True)})
        row.update({f"latent/{name}": value for name, value in latent.items() if name not in _NOT_LATENT})
        self._patients.append(row | self._traced())

    def trial(self, patient: Patient, number: int, record: Record, seen: Observation | None) -> None:
        """Add a trial; what instruments saw of it is None where there is nothing to see."""
        trial = record.trial
        duration = float(record.time[-1]) if trial.speed == 0 and len(record.time) else trial.duration
        self._trials.append(
            {
                "patient": patient.index, "split": self._split, "trial": number, "name": trial.name,
                "test": trial.test, "joint": trial.joint, "session": trial.session, "posture": trial.posture,
                "examiner": trial.examiner, "speed_deg_s": round(float(np.degrees(trial.speed)), 6),
                "start_deg": round(float(np.degrees(trial.start)), 6),
                "end_deg": round(float(np.degrees(trial.end)), 6), "duration_s": duration, "rate_hz": trial.rate,
                "reserve_nm": record.reserve, **_outcome(record),
            } | self._traced()
        )  # fmt: skip
        if seen is None:
            return
        observed = np.column_stack([seen.qpos, seen.qvel, seen.torque, seen.emg])
        self._add("observables", patient, number, seen.time, observed)
        some = slice(None, None, _HIDDEN_EVERY)
        hidden = np.column_stack([getattr(record, name)[some] for name in _FIELDS])
        self._add("privileged", patient, number, record.time[some], hidden)

    def tables(self) -> dict[str, pa.Table]:
        """All four tables, in the order of what was added."""
        found = {
            "patients": pa.Table.from_pylist(self._patients, schema=_patient_schema(self._patients)),
            "trials": pa.Table.from_pylist(self._trials, schema=SCHEMAS["trials"]),
        }
        for name, parts in self._samples.items():
            found[name] = pa.concat_tables(parts) if parts else SCHEMAS[name].empty_table()
        return found

    def _add(self, table: str, patient: Patient, number: int, time: Any, values: Any) -> None:
        n, schema = len(time), SCHEMAS[table]
        columns = [
            pa.array(np.full(n, patient.index), pa.int64()), pa.array(np.full(n, number), pa.int16()),
            pa.array(np.asarray(time, dtype=np.float32)),
            *(pa.array(np.ascontiguousarray(column, dtype=np.float32)) for column in np.asarray(values).T),
            *(pa.array([value] * n, kind) for value, (_, kind) in zip(self._trace, _TRACE, strict=True)),
        ]  # fmt: skip
        self._samples[table].append(pa.Table.from_arrays(columns, schema=schema))

    def _traced(self) -> dict[str, Any]:
        return dict(zip((name for name, _ in _TRACE), self._trace, strict=True))


def _outcome(record: Record) -> dict[str, str]:
    """Status and reason of a trial."""
    if record.failure:
        return {"status": "failed", "reason": record.failure}
    if record.reserve > HELP:
        lack = f"the muscles lack up to {record.reserve:.3g} N m at a joint, which were given"
        return {"status": "helped", "reason": f"{record.trial.name}: {lack}"}
    return {"status": "ok", "reason": ""}


def _patient_schema(rows: list[dict[str, Any]]) -> pa.Schema:
    """Of the table of patients: the same whatever is missing in these."""
    words = {"split", "status", "reason", "sex", *(f"{rater}/{joint}" for rater in READERS for joint in TESTED)}

    def kind(name: str, value: Any) -> pa.DataType:
        if name in words or isinstance(value, str):
            return pa.string()
        if "_rank/" in name:
            return pa.int8()
        return pa.int64() if name in ("patient", "seed") else pa.float64()

    return pa.schema([(name, kind(name, value)) for name, value in rows[0].items()])

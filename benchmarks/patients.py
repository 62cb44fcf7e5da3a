"""Virtual patients: how fast, how accurate the clock is, how grades fall, what gains can be read back.

The cohort's tables are of the dataset that is simulated on the way: ``--patients`` of them, on as many processes as the
machine has cores.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from _bare import many
from _markdown import ROOT, grid, into
from _timing import alternate, machine, ratios, read, spread, walls

import mjhcmc
from mjhcmc.io.files import written_whole
from mjhcmc.leg8.builder import build_leg8
from mjhcmc.leg8.table import JOINTS, MUSCLES
from mjhcmc.patients.bench import Case, clock_of, run_trials
from mjhcmc.patients.drive import drive_of
from mjhcmc.patients.examination import DEFAULTS, battery
from mjhcmc.patients.gain import estimate_gain
from mjhcmc.patients.grades import GRADES, weighted_kappa
from mjhcmc.patients.groups import GROUPS, TESTED
from mjhcmc.patients.leg import leg_of
from mjhcmc.patients.patient import sample_patient
from mjhcmc.patients.trials import stretch

SCRIPT = "patients.py"
DOCUMENT = ROOT / "docs" / "patients.md"
AT_ONCE = 64
SHOWN = 58  # a patient with some of everything
TURNS = 5


def rates() -> str:
    """HCMC of many legs at once on one thread, beside MuJoCo alone over the same steps."""
    sizes = np.linspace(0.0, 1.0, AT_ONCE)
    legs = [mjhcmc.MuscleModel.load(build_leg8(60 + 40 * s, 1.6 + 0.4 * s)) for s in sizes]
    patients = [leg_of(sample_patient(0, i)) for i in range(AT_ONCE)]
    rows = []
    for what, models, physics_dt in (
        ("leg8 at 64 sizes", legs, 0.005), ("leg8 at 64 sizes", legs, 0.001),
        ("64 patients", patients, 0.0025), ("64 patients", patients, 0.001),
    ):  # fmt: skip
        motions = [mjhcmc.Motion.cosine(model, "slow") for model in models]

        def solve(models: list = models, motions: list = motions, h: float = physics_dt) -> mjhcmc.SolutionBatch:
            return mjhcmc.hcmc_batch(models, motions, 0.01, h, threads=1)

        batch = solve()
        solved = [s for s in batch.solved.values() if math.isclose(s.settings["physics_dt"], physics_dt)]
        found = alternate({"hcmc": solve, "bare": many(solved, 1)}, TURNS)
        per = [len(models) / wall for wall in walls(found["hcmc"])]
        bare = [len(solved) / wall for wall in walls(found["bare"])]
        share = [len(models) / len(solved) * r for r in ratios(found["bare"], found["hcmc"])]
        error = max(np.degrees(np.abs(s.tracking_error)).max() for s in solved)
        rows.append(
            (what, f"{1e3 * physics_dt:g}", spread(per), spread(bare), spread([100 * s for s in share]),
             f"{error:.2g}", f"{len(models) - len(solved)}")
        )  # fmt: skip
    header = (
        "slow, dt 10 ms, 180 windows", "physics step, ms", "movements/s", "bare stepping, movements/s", "share, %",
        "largest error, deg", "failed or with finer steps",
    )  # fmt: skip
    return grid(header, rows)


def by_test(count: int = 24) -> str:
    """CPU time of each test, and what a finer clock changes."""
    patients = [sample_patient(3, i) for i in range(count)]
    legs = [leg_of(patient) for patient in patients]
    rows = []
    kinds = [(t.test, t.joint) for t in battery(DEFAULTS) if t.session == "instrumented" and t.joint]
    for test, joint in dict.fromkeys(kinds):
        trials = [t for t in battery(DEFAULTS) if (t.test, t.joint, t.session) == (test, joint, "instrumented")]
        cases = [Case(p, leg, t) for p, leg in zip(patients, legs, strict=True) for t in trials]
        run_trials(cases[:2])
        cpu = read(lambda cases=cases: run_trials(cases)).cpu / len(cases)
        usual, fine = run_trials(cases), run_trials(cases, finer=4)
        j = JOINTS.index(joint)
        off = [np.degrees(np.abs(a.qpos - b.qpos)).max() for a, b in zip(usual, fine, strict=True)]
        torque = [
            100 * np.abs(a.examiner_torque - b.examiner_torque)[:, j].max() / np.abs(b.examiner_torque[:, j]).max()
            for a, b in zip(usual, fine, strict=True) if test != "pendulum"
        ]  # fmt: skip
        clock = clock_of(trials[0])
        rows.append(
            (f"{test}, {joint}", f"{1e3 * clock.step:g}", f"{1e3 * clock.period:g}", f"{1e3 * cpu:.3g}",
             *(f"{value:.2g}" for value in np.quantile(off, (0.5, 0.9))),
             *((f"{value:.2g}" for value in np.quantile(torque, (0.5, 0.9))) if torque else ("-", "-")))
        )  # fmt: skip
    header = (
        "test", "physics step, ms", "control period, ms", "CPU, ms a trial", "angle, deg: median", "90 %",
        "torque, % of its peak: median", "90 %",
    )  # fmt: skip
    return grid(header, rows)


def gains(count: int = 60) -> str:
    """Gains read back from excitation and fiber velocity of fast stretches."""
    rows = []
    for mode in ("equation1", "velocity"):
        patients = [sample_patient(8, i, reflex=mode) for i in range(count)]
        trials = [stretch(joint, "fast", math.radians(240), session="ideal", rate=200.0) for joint in TESTED]
        cases = [Case(p, leg_of(p), t) for p in patients for t in trials]
        off, told = [], {"no reflex to see": 0, "not identifiable": 0}
        for case, record in zip(cases, run_trials(cases), strict=True):
            muscle = MUSCLES.index(GROUPS[TESTED[case.trial.joint]][-1])
            drive = drive_of(case.patient)
            true = drive.gain[muscle]
            period = clock_of(case.trial).period
            found = estimate_gain(
                record.reflex[:, muscle], record.fiber_velocity[:, muscle], 1.0 / case.trial.rate, mode=mode,
                delay=max(case.patient.delay - period / 2, 0.0) if mode == "velocity" else 0.0,
            )  # fmt: skip
            if true == 0 or record.reflex[:, muscle].max() == 0:
                told["no reflex to see"] += 1
                assert not found.identifiable
            elif not found.identifiable:
                told["not identifiable"] += 1
            else:
                off.append(100 * abs(found.gain / true - 1))
        quantiles = np.quantile(off, (0.5, 0.9))
        rows.append((mode, str(len(cases)), *(str(n) for n in told.values()), *(f"{q:.2g}" for q in quantiles)))
    header = ("law", "stretches", "no reflex to see", "not identifiable", "gain off, %: median", "90 %")
    return grid(header, rows)


def workers(out: Path, count: int) -> str:
    """A cohort on all cores, beside a smaller one on one process; and the memory that they take."""
    cores = len(os.sched_getaffinity(0))
    rows = []
    for what, n, processes in (("one process", max(50, count // 8), 1), (f"{cores} processes", count, cores)):
        folder = out / f"with_{processes}"
        command = [sys.executable, "-m", "mjhcmc", "patients", "generate", "--n", str(n), "--seed", "0", "--out",
                   str(folder), "--workers", str(processes), "--json"]  # fmt: skip
        told = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        rows.append(
            (what, str(n), str(told["failed"]), f"{told['seconds']:.0f}", f"{told['patients_per_second']:.3g}",
             f"{peak:.0f}", f"{told['bytes'] / n / 1e3:.0f}")
        )  # fmt: skip
    header = (
        "", "patients", "failed", "seconds", "patients/s", "largest process, MiB", "kB a patient",
    )  # fmt: skip
    ratio, rate = float(rows[1][4]) / float(rows[0][4]), float(rows[1][4]) / cores
    return (
        f"{grid(header, rows)}\n\n{cores} processes are {ratio:.2f} times as fast as one. At {rate:.2g} patients a "
        f"second and core, a million patients take {1e6 / rate / 86400:.2g} core-days, and {float(rows[1][6]):.0f} GB."
    )


def cohort(folder: Path) -> str:
    """Grades of a dataset's patients, agreement of its raters, and the baseline's scores."""
    import pandas as pd

    people = pd.concat(map(pd.read_parquet, sorted(folder.glob("*/*/patients.parquet"))))
    people = people[people.status == "ok"]
    rows = []
    for joint in TESTED:
        share = [100 * (people[f"ideal/{joint}"] == grade).mean() for grade in GRADES]
        pairs = (("rater_a", "rater_b"), ("rater_a", "ideal"))
        kappa = [weighted_kappa(*(people[f"{who}_rank/{joint}"] for who in pair)) for pair in pairs]
        rows.append((joint, *(f"{value:.0f}" for value in share), *(f"{value:.2f}" for value in kappa)))
    header = (
        "joint",
        *(f"grade {grade}, %" for grade in GRADES),
        "kappa of two raters",
        "kappa of a rater and the ideal",
    )
    with tempfile.TemporaryDirectory() as scores:
        command = [sys.executable, "-m", "mjhcmc", "patients", "grade", str(folder), "--quiet", "--out", scores]
        subprocess.run(command, check=False, capture_output=True)
        told = json.loads((Path(scores) / "grade.json").read_text(encoding="utf-8"))
    return f"{grid(header, rows)}\n\n{_scores(told)}"


def figures(folder: Path, docs: Path) -> None:
    """The cohort's figure, and that of one patient."""
    shown = [sys.executable, "-m", "mjhcmc", "patients", "show", "--quiet", "--out"]
    with tempfile.TemporaryDirectory() as out:
        for more in ([str(folder)], ["--seed", "0", "--index", str(SHOWN)]):
            subprocess.run([*shown, out, *more], check=True, capture_output=True)
        for path in Path(out).glob("*.png"):
            with written_whole(docs / ("cohort.png" if path.stem == "cohort" else "patient.png")) as temporary:
                temporary.write_bytes(path.read_bytes())


def _scores(told: dict) -> str:
    rows = []
    for split, found in told["scores"].items():
        rows += [
            (split, model, *(_interval(scores[name]) for name in ("kappa", "macro_f1", "mae")))
            for model, scores in found.items()
        ]
    return grid(("split", "model", "kappa", "macro-F1", "MAE, ranks"), rows)


def _interval(score: dict) -> str:
    return f"{score['value'] + 0.0:.2f} ({score['low'] + 0.0:.2f} .. {score['high'] + 0.0:.2f})".replace(
        "-0.00", "0.00"
    )


def main() -> None:
    """Print the tables; with --write put them into docs/patients.md."""
    parser = argparse.ArgumentParser(prog=SCRIPT, description="Virtual patients: rates, accuracy, cohort.")
    parser.add_argument("--write", action="store_true", help="put the tables into docs/patients.md")
    parser.add_argument("--patients", type=int, default=1000, help="of the cohort (%(default)s)")
    options = parser.parse_args()
    if options.write:
        into(DOCUMENT.read_text(encoding="utf-8"), SCRIPT, "")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", mjhcmc.MjhcmcWarning)
        parts: Sequence[tuple[str, Callable[[], str]]] = (
            ("HCMC of many at once, one thread", rates),
            ("Tests, and what a four times finer clock changes", by_test),
            ("Gains read back", gains),
            ("Datasets", lambda: workers(Path(folder), options.patients)),
            ("The cohort", lambda: cohort(Path(folder) / f"with_{len(os.sched_getaffinity(0))}")),
        )
        told = "\n\n".join(f"**{title}**\n\n{part()}" for title, part in parts)
        if options.write:
            figures(Path(folder) / f"with_{len(os.sched_getaffinity(0))}", DOCUMENT.parent)
    tables = f"{told}\n\n*Here*: {machine()} Medians, with the quartiles of {TURNS} turns in brackets."
    print(tables)
    if options.write:
        text = into(DOCUMENT.read_text(encoding="utf-8"), SCRIPT, tables)
        with written_whole(DOCUMENT) as temporary:
            temporary.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

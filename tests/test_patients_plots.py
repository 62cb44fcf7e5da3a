"""A look at virtual patients: what is drawn and told is what was recorded, from a dataset or simulated on the spot."""

import json
from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import matplotlib.colors
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from plot_tools import legend, line, titles

from mjhcmc.errors import OutputError, SettingsError, SimulationError
from mjhcmc.leg8.table import JOINTS, MUSCLES
from mjhcmc.patients import examination, tables
from mjhcmc.patients.bench import Case, run_trials
from mjhcmc.patients.configuration import Configuration, splits
from mjhcmc.patients.generation import generate
from mjhcmc.patients.grades import GRADES
from mjhcmc.patients.leg import leg_of
from mjhcmc.patients.overview import look_at
from mjhcmc.patients.patient import sample_patient
from mjhcmc.patients.record import Record
from mjhcmc.patients.sensors import observe
from mjhcmc.patients.show import patient_of_dataset
from mjhcmc.patients.trials import pendulum, stretch
from mjhcmc.plotting.cohort import GRADE_COLORS, cohort_figure
from mjhcmc.plotting.patient import patient_figure
from mjhcmc.plotting.trial import Grading, trial_figure

PATIENTS, SEED, FAILED = 40, 0, 5
TRIALS = (stretch("knee", "mas"), pendulum(duration=1.5))
CATCH = -40.0  # deg, of patient 0's knee


def made_up(trial, slope=20.0, viscous=0.0, reach=1.0):
    """A stretch that goes as it should, up to a share of the range; the limb resists by slope N m over the range."""
    time = np.arange(round(trial.duration * trial.rate) + 1) / trial.rate
    angle, speed, acceleration = trial.desired(time)
    angle = trial.start + np.minimum((angle - trial.start) / (trial.end - trial.start), reach) * (
        trial.end - trial.start
    )
    j, inertia = JOINTS.index(trial.joint), 0.3
    joints = np.zeros((3, len(time), 3))
    for of_joints, value in zip(joints, (angle, speed, acceleration), strict=True):
        of_joints[:, j] = value
    resistance = slope * (angle - trial.start) / (trial.end - trial.start) + viscous * abs(trial.speed)
    torque = np.zeros((len(time), 3))
    torque[:, j] = trial.direction * resistance + inertia * acceleration
    muscles = np.zeros((len(time), len(MUSCLES)))
    excitation = muscles + np.linspace(0.01, 0.08, len(MUSCLES))
    return Record(trial, time, *joints, torque, inertia, excitation, excitation / 2, muscles, muscles, muscles, muscles)


def labels(i):
    """Grades of a patient who was never simulated: they go round."""
    found = {}
    for k, joint in enumerate(JOINTS):
        ranks = {"ideal": (i + k) % 6, "rater_a": (i + k + i % 2) % 6, "rater_b": (i + k) % 4}
        reading = SimpleNamespace(
            catch=i % 3 == 0, catch_angle=np.radians(CATCH if joint == "knee" else -20.0), peak=1.0 * i,
            peak_after_catch=2.0 * i, range_affected=i / PATIENTS, range_lost=0.1,
        )  # fmt: skip
        found[joint] = {name: GRADES[r] for name, r in ranks.items()} | {f"{n}_rank": r for n, r in ranks.items()}
        found[joint]["reading"] = reading
    return found


@pytest.fixture(scope="module")
def true():
    """What happened to patient 0."""
    patient = sample_patient(SEED, 0)
    return run_trials([Case(patient, leg_of(patient), trial) for trial in TRIALS])


@pytest.fixture(scope="module")
def simulate(true):
    """A block of patients, of whom only the first is simulated, and one fails."""

    def block(configuration, split, first, last):
        found = tables.Block(configuration, split)
        for i in range(first, last):
            patient = sample_patient(SEED, i, reflex="force" if split == "shift_reflex" else "velocity")
            found.patient(
                patient, {} if i == FAILED else labels(i), "mas/knee at 0.5 s: it fell" if i == FAILED else ""
            )
            records = true if i == 0 else [Record.missing(TRIALS[0], "mas/knee at 0.5 s: it fell")] * (i == FAILED)
            for number, record in enumerate(records):
                seen = observe(record, SEED, i, number) if len(record.time) else None
                found.trial(patient, number, record, seen)
        return found.tables()

    return block


@pytest.fixture(scope="module")
def dataset(tmp_path_factory, simulate):
    folder = tmp_path_factory.mktemp("patients") / "dataset"
    generate(Configuration.with_defaults(PATIENTS, SEED, 7), folder, simulate=simulate, progress=False)
    return folder


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Stand in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


# ------------------------------------------------------------------ a record from the tables


def test_a_trial_of_the_dataset_is_what_was_recorded(dataset, true):
    for record, was in zip(patient_of_dataset(dataset, 0).records, true, strict=True):
        np.testing.assert_allclose(record.time, was.time, atol=1e-6)
        for name in ("name", "test", "joint", "examiner", "posture", "pose", "rate"):
            assert getattr(record.trial, name) == getattr(was.trial, name), name
        for name in ("start", "end", "speed"):
            assert getattr(record.trial, name) == pytest.approx(getattr(was.trial, name), abs=1e-7)
        for name in ("excitation", "reflex", "activation", "fiber_length", "fiber_velocity", "muscle_force"):
            np.testing.assert_allclose(getattr(record, name)[::2], getattr(was, name)[::2], rtol=1e-6, atol=1e-7)
        assert np.degrees(np.abs(record.qpos - was.qpos).max()) < 4  # sensors are within 1, five deviations aside
    stretched = patient_of_dataset(dataset, 0).record("mas/knee")
    assert stretched.inertia == pytest.approx(true[0].inertia, rel=1e-9)
    knee = JOINTS.index("knee")
    error = stretched.qacc[:, knee] - true[0].qacc[:, knee]
    assert np.sqrt(np.mean(error**2)) < 0.1 * np.abs(true[0].qacc[:, knee]).max()


def test_resistance_drawn_from_the_dataset_is_that_of_the_trial_itself(dataset, true):
    drawn = [
        line(trial_figure(r, "").axes[2], "resistance")[1] for r in (patient_of_dataset(dataset, 0).records[0], true[0])
    ]
    assert np.ptp(drawn[1]) > 10
    assert np.sqrt(np.mean((drawn[0] - drawn[1]) ** 2)) < 0.05 * np.ptp(drawn[1])


# ------------------------------------------------------------------ a trial


@pytest.mark.parametrize(
    ("joint", "name", "ends"),
    [("hip", "hip extension", (-45, 10)), ("knee", "knee flexion", (15, 100)), ("ankle", "dorsiflexion", (-35, 10))],
)
def test_a_stretch_goes_up_in_its_own_direction_in_degrees(joint, name, ends):
    record = made_up(stretch(joint, "mas"))
    angle, velocity, torque, excitation = trial_figure(record, "who").axes
    assert angle.get_ylabel() == f"{name} (°)"
    for label in ("angle", "commanded"):
        values = line(angle, label)[1]
        np.testing.assert_allclose(values[[0, -1]], ends, atol=1e-9)
        assert (np.diff(values) >= -1e-9).all()
    assert line(velocity, "velocity")[1].max() == pytest.approx(np.degrees(record.trial.speed), rel=1e-3)
    # the torque bears the inertia, the resistance is the spring's alone: 20 N m over the range
    share = (np.array(line(angle, "angle")[1]) - ends[0]) / (ends[1] - ends[0])
    np.testing.assert_allclose(line(torque, "resistance")[1], 20 * share, atol=0.1)
    j = JOINTS.index(joint)
    np.testing.assert_allclose(line(torque, "torque")[1], record.trial.direction * record.examiner_torque[:, j])
    assert [ax.get_xlabel() for ax in (angle, velocity, torque, excitation)] == ["", "", "", "time (s)"]


def test_excitation_is_of_the_stretched_muscles_and_of_those_against_them():
    for joint, names in (
        ("hip", ["iliopsoas", "glut max"]),
        ("knee", ["rect fem", "vasti", "hamstrings"]),
        ("ankle", ["gastroc", "soleus", "tib ant"]),
    ):
        record = made_up(stretch(joint, "mas"))
        ax = trial_figure(record, "").axes[3]
        assert [text.get_text() for text in ax.get_legend().get_texts()] == names
        for name in names:
            k = MUSCLES.index(name.replace(" ", "_"))
            np.testing.assert_array_equal(line(ax, name)[1], record.excitation[:, k])
        tops = sorted(
            area.get_paths()[0].vertices[:, 1].max() for area in ax.collections if area.get_label() == "reflex"
        )
        muscles = [MUSCLES.index(name.replace(" ", "_")) for name in names]
        np.testing.assert_allclose(tops, sorted(record.reflex[:, muscles].max(axis=0)))


def test_the_catch_is_marked_when_the_joint_first_is_there():
    record = made_up(stretch("knee", "mas"))
    grading = Grading("1+", ("1", "2"), np.radians(CATCH))
    figure = trial_figure(record, "who", grading)
    first = record.time[np.argmax(np.degrees(record.qpos[:, 1]) <= CATCH)]
    assert 0.3 < first < 1.3
    for ax in figure.axes:
        assert set(line(ax, "catch")[0]) == {first}
    assert titles(figure) == ["Knee · MAS 1+ (raters 1, 2)"]
    assert "catch (ideal reading)" in legend(figure)
    never = trial_figure(record, "who", replace(grading, catch_angle=np.radians(-120.0)))
    without = trial_figure(record, "who", replace(grading, catch_angle=None))
    for ax in (*never.axes, *without.axes):
        assert "catch" not in [artist.get_label() for artist in ax.get_lines()]
    assert "catch (ideal reading)" not in legend(without)


def test_a_movement_of_the_whole_leg_has_a_column_for_each_joint_and_no_examiner(true):
    moved = replace(true[0], trial=replace(TRIALS[1], name="cosine_slow", test="cosine", joint=""))
    figure = trial_figure(moved, "who")
    assert titles(figure) == ["Hip", "Knee", "Ankle"]
    assert len(figure.axes) == 9
    np.testing.assert_allclose(line(figure.axes[3], "angle")[1], -np.degrees(true[0].qpos[:, 1]))


def test_nothing_recorded_is_an_error_and_a_trial_that_stopped_says_so():
    with pytest.raises(SimulationError, match=r"'mas/knee' left nothing to draw \(it fell\)"):
        trial_figure(Record.missing(TRIALS[0], "it fell"), "who")
    figure = trial_figure(replace(made_up(TRIALS[0]), failure="it fell"), "who")
    assert "it fell" in figure.get_suptitle()


# ------------------------------------------------------------------ a sheet


def ankle():
    """At four speeds, viscous on top of elastic; the fastest stops at half of the range."""
    fast = [stretch("ankle", "fast", np.radians(speed)) for speed in (120.0, 240.0)]
    trials = [stretch("ankle", "slow", np.radians(10.0), examiner="servo", rate=20.0), stretch("ankle", "mas"), *fast]
    return [made_up(t, viscous=2.0, reach=0.5 if i == 3 else 1.0) for i, t in enumerate(trials)]


def test_resistance_over_the_range_is_drawn_for_each_speed_as_far_as_the_joint_went():
    records = ankle()
    figure = patient_figure(records, {"ankle": Grading("2", ("2", "2"))}, "who")
    (ax,) = [ax for ax in figure.axes if ax.get_xlabel() == "dorsiflexion (°)"]
    names = ["10°/s", "whole range in 1 s (as graded)", "120°/s", "240°/s"]
    for name, record in zip(names, records, strict=True):
        angle, resistance = line(ax, name)
        share = (angle + 35) / 45
        np.testing.assert_allclose(resistance, 20 * share + 2 * record.trial.speed, rtol=0.02, atol=0.3)
        assert angle.max() == pytest.approx(-12.5 if name == "240°/s" else 10, abs=1)
    colors = [matplotlib.colors.to_hex(a.get_color()) for a in ax.get_lines()]
    assert len(set(colors)) == 4
    assert [text.get_text() for text in figure.legends[1].get_texts()] == names  # from the slowest
    assert ax.get_xlim() == pytest.approx((-35, 10))


def test_the_sheet_says_which_records_are_missing_and_why():
    records = [*ankle(), Record.missing(stretch("knee", "mas"), "it fell")]
    figure = patient_figure(records, {}, "who")
    told = [text.get_text() for ax in figure.axes for text in ax.texts]
    assert told.count("no record: it fell") == 2  # over time and over the range
    assert told.count("no record") == 3  # of the hip, twice, and of the pendulum
    with pytest.raises(SettingsError, match="no passive stretch and no pendulum"):
        patient_figure([], {}, "who")


@pytest.mark.parametrize(("cycles", "words"), [(0.0, "never"), (0.3, "once"), (1.8, "4 times")])
def test_swings_of_the_pendulum_are_counted(cycles, words):
    trial = pendulum()
    time = np.arange(601) / 100
    knee = 60 - 60 * np.exp(-time) * np.cos(2 * np.pi * cycles * np.minimum(time, 1.0))
    joints = np.zeros((601, 3))
    joints[:, 1] = -np.radians(knee + np.random.default_rng(0).normal(scale=0.4, size=601))  # a sensor's noise
    muscles = np.zeros((601, 8))
    none = np.zeros((601, 3))
    record = Record(trial, time, joints, none, none, none, 0.0, *[muscles] * 6)
    (told,) = [
        t.get_text() for ax in patient_figure([record], {}, "who").axes for t in ax.texts if "swing" in t.get_text()
    ]
    assert told.endswith(f"rests at 60°, which it passes {words}")


# ------------------------------------------------------------------ a cohort


def test_the_overview_counts_what_the_tables_hold(dataset):
    overview = look_at(dataset)
    rows = pd.concat(map(pd.read_parquet, sorted(dataset.glob("*/shard-*/patients.parquet"))))
    assert overview.splits == {name: len(block) for name, block in splits(PATIENTS).items()}
    assert overview.failed == ((FAILED, "mas/knee at 0.5 s: it fell"),)
    assert (overview.patients, overview.missing, overview.seed) == (PATIENTS, 0, SEED)
    for joint in JOINTS:
        for reader, counts in overview.grades[joint].items():
            assert dict(zip(GRADES, counts.tolist(), strict=True)) == {
                grade: (rows[f"{reader}/{joint}"] == grade).sum() for grade in GRADES
            }
        pairs = pd.crosstab(rows[f"ideal_rank/{joint}"], rows[f"rater_a_rank/{joint}"])
        pairs = pairs.reindex(index=range(6), columns=range(6), fill_value=0)
        np.testing.assert_array_equal(overview.ideal_rater[joint], pairs)
        # Cohen's kappa by its definition: disagreement observed over that expected of independent raters
        p = pairs.to_numpy() / pairs.to_numpy().sum()
        weight = np.subtract.outer(np.arange(6), np.arange(6)) ** 2
        expected = np.outer(p.sum(axis=1), p.sum(axis=0))
        assert overview.kappa(overview.ideal_rater[joint]) == pytest.approx(
            1 - (weight * p).sum() / (weight * expected).sum()
        )
        assert overview.catches[joint].sum() == rows[f"catch_angle/{joint}"].notna().sum()
        assert len(overview.points[joint]["rank"]) == PATIENTS
        # gains of force reflexes have another unit
        assert np.isnan(overview.points[joint]["gain"]).sum() == overview.splits["shift_reflex"]
    (at,) = np.flatnonzero(overview.catches["knee"].sum(axis=1))
    assert overview.edges["knee"][at] <= -CATCH < overview.edges["knee"][at + 1]


def test_of_many_patients_some_are_drawn_and_all_are_counted(dataset, monkeypatch):
    monkeypatch.setattr("mjhcmc.patients.overview.POINTS", 10)
    overview = look_at(dataset)
    assert len(overview.points["hip"]["rank"]) == 10
    assert overview.grades["hip"]["ideal"].sum() == PATIENTS - 1


def test_the_figure_of_the_cohort_draws_these_counts(dataset):
    overview = look_at(dataset)
    figure = cohort_figure(overview)
    assert len(figure.axes) == 15
    assert legend(figure)[1:] == list(GRADES)
    assert figure.get_suptitle() == f"{PATIENTS} virtual patients, 1 failed · seed 0"
    for column, joint in enumerate(JOINTS):
        bars, matrix, reflex, felt, catches = figure.axes[5 * column : 5 * column + 5]
        share = overview.grades[joint]["ideal"] / overview.grades[joint]["ideal"].sum()
        np.testing.assert_allclose([p.get_width() for p in bars.patches[:6]], share)
        numbers = {t.get_position(): int(t.get_text()) for t in matrix.texts}
        counts = overview.ideal_rater[joint]
        assert numbers == {(c, r): n for (r, c), n in np.ndenumerate(counts) if n}
        for ax, x in ((reflex, "gain"), (felt, "resistance")):
            (points,) = ax.collections
            known = np.isfinite(overview.points[joint][x]) & np.isfinite(overview.points[joint]["rank"])
            assert len(points.get_offsets()) == known.sum()
            ranks = overview.points[joint]["rank"][known].astype(int)
            drawn = [matplotlib.colors.to_hex(color).upper() for color in points.get_facecolors()]
            assert drawn == [GRADE_COLORS[rank] for rank in ranks]
        assert sum(p.get_height() for p in catches.patches) == overview.catches[joint].sum()


@pytest.mark.parametrize("name", ["trial", "patient", "little", "cohort"])
def test_no_text_overlaps_another_or_leaves_the_page(name, dataset, monkeypatch):
    shown = patient_of_dataset(dataset, 0)
    every = {joint: Grading("1+", ("1+", "1+"), -0.3) for joint in JOINTS}
    many = [made_up(replace(r.trial)) for r in ankle()]
    many += [
        made_up(stretch(j, t, s)) for j in ("hip", "knee") for t, s in (("mas", None), ("fast", 2.0), ("fast", 4.0))
    ]
    figure = {
        "trial": lambda: shown.figure("mas/knee"),
        "patient": lambda: patient_figure([*many, shown.records[1]], every, shown.title, shown.patient),
        "little": lambda: shown.figure(),
        "cohort": lambda: cohort_figure(look_at(dataset)),
    }[name]()
    seen, draw = {}, Text.draw

    def record(text, renderer, *args, **kwargs):
        if text.get_visible() and text.get_text().strip():
            seen[id(text)] = (text.get_text(), text.get_window_extent(renderer))
        return draw(text, renderer, *args, **kwargs)

    monkeypatch.setattr(Text, "draw", record)
    figure.draw_without_rendering()
    assert len(seen) > 15
    page = figure.bbox
    for text, box in seen.values():
        assert box.x0 >= page.x0, text
        assert box.x1 <= page.x1, text
        assert box.y0 >= page.y0, text
        assert box.y1 <= page.y1, text
    for (one, a), (two, b) in combinations(seen.values(), 2):
        assert min(a.x1, b.x1) <= max(a.x0, b.x0) or min(a.y1, b.y1) <= max(a.y0, b.y0), (one, two)


# ------------------------------------------------------------------ the command


def test_show_a_dataset(run, dataset, here, monkeypatch):
    monkeypatch.setattr("mjhcmc.plotting.cohort.cohort_figure", lambda overview: Figure(figsize=(1, 1)))
    done = run("patients", "show", dataset)
    assert (done.code, done.err) == (0, "")
    assert f"{PATIENTS} patients, seed 0 (train 24, validation 4, test 6" in done.out
    assert f"failed: 1 of {PATIENTS}\n  patient {FAILED}: mas/knee at 0.5 s: it fell" in done.out
    assert sorted(p.name for p in (here / "mjhcmc-patient").iterdir()) == ["cohort.pdf", "cohort.png"]
    assert run("patients", "show", dataset).code == 0  # its own figures it replaces


@pytest.mark.usefixtures("coarse_figures")
def test_show_one_patient_and_one_trial(run, dataset, here):
    done = run("patients", "show", dataset, "--patient", 0, "--trial", "mas/knee", "--out", here / "new" / "out")
    assert (done.code, done.err) == (0, "")
    assert "\nknee   1      1        1        −40°   0.0 N m     0 %             10 %\n" in done.out

    assert f"severity {sample_patient(SEED, 0).severity:.2f}" in done.out
    names = ["patient-0-mas-knee.pdf", "patient-0-mas-knee.png"]
    assert sorted(p.name for p in (here / "new" / "out").iterdir()) == names


def test_json_is_the_row_and_draws_nothing_unasked(run, dataset, here):
    row = json.loads(run("patients", "show", dataset, "--patient", 7, "--json").out)
    (shard,) = [
        s for s in dataset.glob("*/shard-*") if 7 in pd.read_parquet(s / "patients.parquet")["patient"].tolist()
    ]
    stored = pd.read_parquet(shard / "patients.parquet").set_index("patient").loc[7]
    assert row.pop("files") == []
    assert row.pop("patient") == 7
    assert {k: v for k, v in row.items() if v is not None} == stored.dropna().to_dict()
    about = json.loads(run("patients", "show", dataset, "--json").out)
    assert about["failed"] == [{"patient": FAILED, "reason": "mas/knee at 0.5 s: it fell"}]
    assert about["grades"]["hip"]["ideal"]["1+"] == look_at(dataset).grades["hip"]["ideal"][2]
    assert not list(here.iterdir())


@pytest.mark.usefixtures("coarse_figures")
def test_a_failed_patient_is_shown_with_the_reason(run, dataset, here):
    done = run("patients", "show", dataset, "--patient", FAILED)
    assert done.code == 0
    assert "FAILED  mas/knee at 0.5 s: it fell" in done.out
    assert (here / "mjhcmc-patient" / f"patient-{FAILED}.png").exists()


@pytest.mark.usefixtures("coarse_figures")
def test_a_patient_simulated_now_is_the_one_of_the_dataset(run, dataset, here, simulate, monkeypatch):
    monkeypatch.setattr(examination, "simulate_block", simulate)
    row = json.loads(run("patients", "show", "--seed", SEED, "--index", 0, "--json", "--out", here).out)
    other = json.loads(run("patients", "show", dataset, "--patient", 0, "--json").out)
    assert row["files"] == [str(here / f"patient-seed0-0.{kind}") for kind in ("png", "pdf")]
    differ = {name for name in row if row[name] != other[name]}
    assert differ == {"files", "configuration"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "show either a dataset DIR, or a patient simulated now (--seed and --index)"),
        (("DATASET", "--seed", 1, "--index", 1), "show either"),
        (("--seed", 1), "--seed and --index belong together"),
        (("--seed", 1, "--index", 1, "--patient", 1), "with --seed give --index"),
        (("DATASET", "--trial", "mas/knee"), "give --patient too"),
        (("DATASET", "--patient", 40), "choose one of 0 to 39"),
        (("DATASET", "--patient", -1), "patient -1 is not in"),
        (("nowhere",), "nowhere: is no dataset, there is no such folder"),
        ((".", "--patient", 1), ".: is no dataset, it has no manifest.json"),
        (("DATASET", "--patient", 0, "--trial", "foo"), "'foo' is not among this patient's: choose one of mas/knee"),
        (("--seed", 0, "--index", 0, "--trial", "foo"), "'foo' is not among this patient's: choose one of slow_10"),
        (("DATASET", "--out", "DATASET/train"), "lies in the dataset"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_with_the_remedy_and_leaves_nothing(run, dataset, here, arguments, words):
    done = run("patients", "show", *(str(word).replace("DATASET", str(dataset)) for word in arguments))
    assert (done.code, done.out) == (2, "")
    assert len(done.err.splitlines()) == 1
    assert words in done.err
    assert not list(here.iterdir())
    assert not list(dataset.rglob("*.png"))


def test_what_is_no_figure_of_ours_is_not_replaced(run, dataset, here):
    (here / "cohort.png").write_text("a picture of a cat")
    done = run("patients", "show", dataset, "--out", here)
    assert done.code == 2
    assert "cohort.png: is there, and no figure of mjhcmc: move it away" in done.err
    assert (here / "cohort.png").read_text() == "a picture of a cat"
    assert len(list(here.iterdir())) == 1


def test_shards_that_are_missing_or_damaged_are_named(dataset, tmp_path):
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(dataset, copy)
    shutil.rmtree(copy / "train" / "shard-00001")
    overview = look_at(copy)
    assert (overview.patients, overview.missing) == (PATIENTS - 7, 7)
    assert "7 more are not there yet" in overview.screen()
    with pytest.raises(OutputError, match=r"train/shard-00001 \(patients 7 to 13\) is not there yet: let .* finish"):
        patient_of_dataset(copy, 8)
    broken = copy / "train" / "shard-00000" / "patients.parquet"
    broken.write_bytes(broken.read_bytes()[:100])
    with pytest.raises(OutputError, match=r"shard-00000/patients.parquet: cannot be read .*: run .* again"):
        look_at(copy)

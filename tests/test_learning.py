"""Grading a dataset: the baselines, the command, and that the search for leaks finds what is planted."""

import json
import shutil
import sys
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from cohort_tools import JOINTS, MAS, Invented, append, drop, edit, write_shard
from sklearn.metrics import cohen_kappa_score

from mjhcmc.errors import OutputError, SettingsError
from mjhcmc.patients.configuration import Configuration
from mjhcmc.patients.learning import baseline, features
from mjhcmc.patients.learning.cohort import load_cohort
from mjhcmc.patients.learning.leakage import search_leaks
from mjhcmc.patients.learning.read import open_dataset
from mjhcmc.patients.learning.report import grade_command, grade_dataset
from mjhcmc.patients.learning.scores import evaluate
from mjhcmc.patients.manifest import Manifest
from mjhcmc.patients.shards import shards_of

N = 120


def make_dataset(folder, n):
    """Invented patients in the shards that a manifest promises; patient 3 has no trials."""
    rng, configuration = np.random.default_rng(0), Configuration(n, 7, 36, {})
    for shard in shards_of(configuration):
        people = [Invented(rng, i, shard.split, 0.35, i == 3, None) for i in range(shard.first, shard.last)]
        write_shard(folder / shard.name, people)
    replace(Manifest.of(configuration), status="complete").write(folder)
    return folder


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return make_dataset(tmp_path_factory.mktemp("cohort") / "dataset", N)


@pytest.fixture(scope="module")
def report(dataset):
    return grade_dataset(dataset)


@pytest.fixture(scope="module")
def cohort(report):
    return report.cohort


@pytest.fixture
def copy(dataset, tmp_path):
    """A copy that a test may spoil."""
    return shutil.copytree(dataset, tmp_path / "copy")


def flagged(found):
    return {check.name for check in found.checks if not check.passed}


def reasons(found):
    return " ".join(reason for check in found.checks for reason in check.reasons)


# the whole


def test_baselines_beat_majority_and_stay_below_the_ceiling(report):
    test = report.scores["test"]
    assert set(report.scores) == {"validation", "test", "shift_muscle", "shift_reflex", "shift_velocity"}
    assert abs(test["majority"].kappa.value) < 1e-12
    for name in ("one feature", "ordinal logistic", "gradient boosting"):
        assert test[name].kappa.low > 0.3
        assert test[name].kappa.value <= test["ceiling (rater_b)"].kappa.high
    assert report.leaks.passed, reasons(report.leaks)
    assert report.cohort.failed["train"] == 1
    assert len(report.cohort.patient) == N - 1
    truth, other = (report.cohort.grades[r][report.cohort.rows("test")] for r in ("rater_a", "rater_b"))
    kappas = [cohen_kappa_score(truth[:, j], other[:, j], weights="quadratic", labels=np.arange(6)) for j in range(3)]
    assert test["ceiling (rater_b)"].kappa.value == pytest.approx(np.mean(kappas))


def test_a_torn_trial_is_left_out(copy, cohort):
    shard = copy / "train" / "shard-00000"

    def fail(columns):
        columns["status"][0] = "failed"

    edit(shard / "trials.parquet", fail)
    spoiled = load_cohort(open_dataset(copy), ("hip",))
    slow = [name.startswith("slow/") for name in spoiled.names["hip"]]
    assert np.isnan(spoiled.features["hip"][0, slow]).all()
    assert spoiled.protocol[0, 0, 1] == 1
    np.testing.assert_array_equal(spoiled.features["hip"][1:], cohort.features["hip"][1:])


def test_command(dataset, tmp_path, run, monkeypatch):
    monkeypatch.delitem(baseline.MODELS, "gradient boosting")
    out = tmp_path / "out"
    outcome = run("patients", "grade", dataset, "--json", "--joint", "ankle", "--out", out)
    assert outcome.code == 0, outcome.err
    found = json.loads(outcome.out)
    assert found["leakage"]["passed"] is True
    assert found["joints"] == ["ankle"]
    assert found["scores"]["test"]["ordinal logistic"]["kappa"]["low"] > 0
    assert sorted(path.name for path in out.iterdir()) == ["confusion.pdf", "confusion.png", "grade.json"]
    assert json.loads((out / "grade.json").read_text())["scores"] == found["scores"]
    counts = np.array(found["confusion"]["ordinal logistic"])
    assert counts.shape == (len(MAS), len(MAS))
    assert counts.sum() == found["patients"]["test"]["ok"]


def test_screen(report):
    screen = report.screen()
    for word in (
        "ordinal logistic",
        "ceiling (rater_b)",
        "test: 18 patients",
        "1 failed and left out",
        "No leak found",
    ):
        assert word in screen
    assert "nan" not in screen
    json.loads(json.dumps(report.numbers(), allow_nan=False))


def test_without_scikit_learn_the_row_says_what_to_install(cohort, monkeypatch, report):
    monkeypatch.setitem(sys.modules, "sklearn.ensemble", None)
    missing = baseline.grade("gradient boosting", cohort)
    assert missing.ranks is None
    assert 'pip install "mjhcmc[learn]"' in missing.note
    fewer = replace(report, predicted=(*report.predicted[:3], missing))
    assert missing.note in fewer.screen()
    assert fewer.numbers()["not_run"] == {"gradient boosting": missing.note}


def test_figure_shows_the_counts(report):
    figure = report.figure()
    counts = report.confusions()
    assert [ax.get_title(loc="left") for ax in figure.axes][:2] == ["majority", "one feature"]
    for ax, matrix in zip(figure.axes, counts.values(), strict=True):
        shown = {text.get_position()[::-1]: int(text.get_text()) for text in ax.texts}
        assert shown == {at: int(n) for at, n in np.ndenumerate(matrix) if n}


# leaks that are planted


def with_feature(cohort, joint, name, values):
    column = np.asarray(values, dtype=np.float32)[:, None]
    return replace(
        cohort,
        names=dict(cohort.names) | {joint: (*cohort.names[joint], name)},
        features=dict(cohort.features) | {joint: np.concatenate([cohort.features[joint], column], axis=1)},
    )


def test_gain_as_a_feature_is_flagged(cohort):
    gain = cohort.latent["gain/knee_extensors"]
    found = search_leaks(with_feature(cohort, "knee", "innocent", np.exp(-gain)))
    assert {"features from listed columns", "nothing hidden shows"} <= flagged(found)
    assert "innocent is as good as latent gain/knee_extensors" in reasons(found)
    # under a declared name only what it holds gives it away
    values = cohort.features["knee"].copy()
    values[:, 5] = gain
    spoiled = replace(cohort, features=dict(cohort.features) | {"knee": values})
    assert flagged(search_leaks(spoiled)) == {"nothing hidden shows"}


def test_label_copied_into_the_observables_is_flagged(copy):
    for path in copy.glob("*/shard-*"):
        people = pq.read_table(path / "patients.parquet")
        rank = np.zeros(N)
        rank[people["patient"].to_numpy()] = people["rater_a_rank/hip"].to_numpy()
        append(path / "observables.parquet", "note", lambda table, rank=rank: rank[table["patient"].to_numpy()])
    found = search_leaks(load_cohort(open_dataset(copy), ("hip",)))
    assert {"features from listed columns", "nothing hidden shows"} <= flagged(found)
    assert "column note is as good as the grade of rater_a" in reasons(found)


def test_patient_in_two_splits_is_flagged(copy):
    shutil.rmtree(copy / "test" / "shard-00003")
    shutil.copytree(copy / "train" / "shard-00001", copy / "test" / "shard-00003")
    found = search_leaks(load_cohort(open_dataset(copy), ("ankle",)))
    assert {"patients in one split", "no copies across splits"} <= flagged(found)
    assert "in more than one split" in reasons(found)
    assert "folder of another split" in reasons(found)


def test_copy_under_another_number_is_flagged(cohort):
    source, copy_of = cohort.rows("train")[4], cohort.rows("test")[2]
    spoiled = {joint: values.copy() for joint, values in cohort.features.items()}
    for values in spoiled.values():
        values[copy_of] = values[source]
    found = search_leaks(replace(cohort, features=spoiled))
    assert flagged(found) == {"no copies across splits"}
    assert f"{cohort.patient[source]} (train) and {cohort.patient[copy_of]} (test)" in reasons(found)


@pytest.mark.parametrize("how", ["sorted", "blocks"])
def test_index_that_tells_the_grade_is_flagged(cohort, how):
    grade = cohort.grades["rater_a"].sum(axis=1)
    order = np.argsort(np.argsort(grade, kind="stable"))  # patients numbered by severity
    patient = order if how == "sorted" else np.abs(2 * order - len(order))  # the mildest and the gravest last
    if how == "blocks":
        grade_like = np.where(order < len(order) / 3, 1, np.where(order < 2 * len(order) / 3, 2, 0))
        patient = np.argsort(np.argsort(grade_like * 10_000 + order, kind="stable"))
    found = search_leaks(replace(cohort, patient=patient))
    assert flagged(found) == {"index and protocol tell nothing"}
    assert "index tells the grade" in reasons(found)


def test_protocol_that_tells_the_grade_is_flagged(cohort):
    protocol = cohort.protocol.copy()
    protocol[..., 2] += 0.1 * (cohort.grades["rater_a"] > 1)  # longer trials for the graver
    assert "protocol" in reasons(search_leaks(replace(cohort, protocol=protocol)))
    values = cohort.features["hip"].copy()
    names = cohort.names["hip"]
    fast = [i for i, name in enumerate(names) if name.startswith("fast_high")]
    grave = cohort.grades["rater_a"][:, 0] > 2
    values[np.ix_(grave, fast)] = np.nan  # simulations that fail where spasticity is severe
    only = replace(cohort, joints=("hip",), features={"hip": values}, names={"hip": names})
    only = replace(only, grades={r: g[:, :1] for r, g in cohort.grades.items()}, protocol=cohort.protocol[:, :1])
    only = replace(only, channels={n: c[:, :1] for n, c in cohort.channels.items()})
    found = search_leaks(only)
    assert flagged(found) == {"index and protocol tell nothing"}
    assert "missing features" in reasons(found)


def test_training_that_peeks_is_flagged(cohort):
    test = cohort.rows("test")

    def peeking(x, y, new):
        for j, joint in enumerate(cohort.joints):
            if new.shape[1] == len(cohort.names[joint]) and np.array_equal(
                new, cohort.features[joint][test].astype(float), equal_nan=True
            ):
                return cohort.grades["rater_a"][test, j]
        raise AssertionError("no such rows")

    assert "shuffled grades teach nothing" in flagged(search_leaks(cohort, grades=peeking))


def test_model_above_the_ceiling_is_flagged(cohort):
    perfect = baseline.Predicted("oracle", cohort.grades["rater_a"], {})
    found = search_leaks(cohort, predicted=[perfect])
    assert flagged(found) == {"below the ceiling"}
    assert "oracle" in reasons(found)
    assert "look for the leak" in reasons(found)
    assert search_leaks(cohort, "ideal", [replace(perfect, ranks=cohort.grades["ideal"])]).passed


def test_a_model_above_the_raters_is_noted_and_not_failed(report):
    test = report.cohort.rows("test")
    truth, other, ideal = (report.cohort.grades[reader] for reader in ("rater_a", "rater_b", "ideal"))

    def kappas(ranks):
        values = [
            cohen_kappa_score(truth[test, j], ranks[test, j], weights="quadratic", labels=np.arange(6))
            for j in range(len(JOINTS))
        ]
        return [np.mean(values), *values]

    mixed = np.where(np.arange(len(ideal))[:, None] % 3 > 0, other, ideal)  # a little better than the other rater
    models = {"knowing": mixed, "oracle": truth}
    predicted = tuple(baseline.Predicted(name, ranks, {}) for name, ranks in models.items())
    scores = {n: evaluate(truth[test], r[test]) for n, r in models.items()} | {
        name: report.scores["test"][name] for name in ("ceiling (rater_b)", "ideal grade")
    }
    found = replace(report, predicted=predicted, scores={"test": scores})
    limits, best = kappas(other), kappas(ideal)
    expected = {
        (name, joint): (kappa, limit)
        for name, ranks in models.items()
        for joint, kappa, limit in zip(("mean", *JOINTS), kappas(ranks), limits, strict=True)
        if kappa > limit
    }
    assert ("knowing", "mean") in expected
    assert {(a.model, a.joint): (a.kappa, a.raters) for a in found.above} == {
        key: pytest.approx(values) for key, values in expected.items()
    }
    assert [a.ideal for a in found.above if a.joint == "mean"] == pytest.approx([best[0]] * 2)
    below, above = (found.screen().split(f"note: above the raters' agreement{how}")[1] for how in (", below", " and"))
    assert f"knowing, mean: {kappas(mixed)[0]:.3f}, raters {limits[0]:.3f}" in below.split("note:")[0]
    assert "oracle, mean: 1.000" in above
    assert {"split", "model", "joint", "kappa", "raters", "ideal"} == set(found.numbers()["above_raters"][0])
    assert search_leaks(report.cohort, predicted=predicted[:1]).passed
    assert not replace(
        found, scores={"test": scores | {"knowing": scores["ceiling (rater_b)"]}}, predicted=predicted[:1]
    ).above
    assert not replace(found, target="ideal").above


def test_a_feature_that_nobody_in_train_has_is_named(report):
    assert not report.cohort.never_known
    assert "warning" not in report.screen()
    values = report.cohort.features["knee"].copy()
    train = report.cohort.rows("train")
    values[train, 7], values[train[1:], 8] = np.nan, np.inf  # the next one is known of one patient
    name = report.cohort.names["knee"][7]
    cohort = replace(report.cohort, features=dict(report.cohort.features) | {"knee": values})
    found = replace(report, cohort=cohort)
    assert found.numbers()["never_known"] == {"knee": [name]}
    line = next(line for line in found.screen().splitlines() if line.startswith("warning: knee"))
    assert line.endswith(f": {name}")


def test_flag_gives_exit_code_1(copy, capsys, monkeypatch):
    monkeypatch.delitem(baseline.MODELS, "gradient boosting")
    for path in copy.glob("*/shard-*"):
        append(path / "observables.parquet", "gain", lambda table: np.ones(len(table)))
    assert grade_command(copy, joint="hip") == 1
    out = capsys.readouterr().out
    assert "FLAG  features from listed columns" in out
    assert "gain" in out


# bad input


def test_no_dataset(tmp_path, run):
    outcome = run("patients", "grade", tmp_path, "--out", tmp_path / "out")
    assert outcome.code == 2
    assert len(outcome.errors) == 1
    assert "is no dataset, it has no manifest.json" in outcome.errors[0]
    assert not (tmp_path / "out").exists()


def test_absent_split(tmp_path):
    with pytest.raises(OutputError, match="split validation is absent: generate more patients"):
        grade_dataset(make_dataset(tmp_path / "one", 1))


def test_a_shard_that_is_missing_is_refused(copy, run):
    shutil.rmtree(copy / "shift_muscle" / "shard-00004")
    outcome = run("patients", "grade", copy, "--json")
    assert (outcome.code, outcome.out, len(outcome.errors)) == (2, "", 1)
    told = "1 of 7 shards are missing, the first is shift_muscle/shard-00004 (patients 102 to 107): run mjhcmc patients"
    assert told in outcome.errors[0]


def test_a_dataset_that_is_not_finished_is_refused(copy, run):
    replace(Manifest.read(copy), status="running").write(copy)
    outcome = run("patients", "grade", copy)
    assert (outcome.code, outcome.out, len(outcome.errors)) == (2, "", 1)
    assert "its status is 'running': run mjhcmc patients generate again" in outcome.errors[0]


def test_a_manifest_without_a_configuration_is_refused(copy):
    replace(Manifest.read(copy), configuration={"patients": N}).write(copy)
    with pytest.raises(OutputError, match=r"manifest\.json: its configuration cannot be read"):
        grade_dataset(copy)


def test_folders_of_no_shard_are_not_read(copy):
    shutil.copytree(copy / "train" / "shard-00001", copy / "test" / "shard-00009")
    names = [path.relative_to(copy).as_posix() for paths in open_dataset(copy).shards.values() for path in paths]
    assert names == [shard.name for shard in shards_of(Configuration(N, 7, 36, {}))]


def test_missing_table_and_column(copy):
    shard = copy / "test" / "shard-00003"
    drop(shard / "observables.parquet", "v/hip")
    with pytest.raises(OutputError, match="column 'v/hip' is missing"):
        grade_dataset(copy)
    (shard / "trials.parquet").unlink()
    with pytest.raises(OutputError, match=r"trials\.parquet: this table is missing"):
        grade_dataset(copy)
    (shard / "patients.parquet").write_bytes(b"PAR1 torn")
    with pytest.raises(OutputError, match=r"patients\.parquet: cannot be read"):
        grade_dataset(copy)


def test_rank_that_is_none(copy):
    shard = copy / "train" / "shard-00000"
    edit(shard / "patients.parquet", lambda columns: columns["rater_b_rank/knee"].__setitem__(2, 9))
    with pytest.raises(OutputError, match=r"'rater_b_rank/knee', patient 2: 9 is no rank"):
        grade_dataset(copy)


def test_too_few(copy):
    for path in copy.glob("train/*/patients.parquet"):
        edit(path, lambda columns: columns.update(status=["failed"] * len(columns["status"])))
    with pytest.raises(SettingsError, match="split train has 0 patients"):
        grade_dataset(copy)


def test_a_single_grade(copy):
    for path in copy.glob("*/shard-*/patients.parquet"):
        edit(path, lambda columns: columns.update({"rater_a_rank/ankle": [2] * len(columns["patient"])}))
    with pytest.raises(SettingsError, match="ankle: split train has 1 different grades of rater_a"):
        grade_dataset(copy, joint="ankle")


@pytest.mark.parametrize(("options", "word"), [({"joint": "elbow"}, "elbow"), ({"target": "rater_b"}, "rater_b")])
def test_unknown_options(dataset, options, word):
    with pytest.raises(SettingsError, match=word):
        grade_dataset(dataset, **options)
    assert set(JOINTS) == set(features.READS)

"""Ordinal regression, scores and features: against scikit-learn, definitions, and curves of known shape."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import cohen_kappa_score, f1_score

from mjhcmc.errors import SettingsError
from mjhcmc.patients.learning import baseline, features
from mjhcmc.patients.learning.ordinal import OrdinalLogistic
from mjhcmc.patients.learning.read import READABLE, Guarded
from mjhcmc.patients.learning.scores import MISSING, confusion, evaluate, quadratic_kappa
from mjhcmc.patients.trials import REST

# ordinal regression


def test_two_grades_are_logistic_regression():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(300, 4))
    y = (x @ [1.0, -2.0, 0.5, 0.0] + rng.logistic(size=300) > 0.4).astype(int)
    for penalty in (0.3, 5.0):
        ours = OrdinalLogistic(penalty).fit(x, 2 + y)
        theirs = LogisticRegression(C=1 / penalty, tol=1e-10, max_iter=1000).fit(x, y)
        np.testing.assert_allclose(ours.coefficients, theirs.coef_[0], atol=2e-4)
        np.testing.assert_allclose(-ours.thresholds, theirs.intercept_, atol=2e-4)
        np.testing.assert_allclose(ours.predict_proba(x), theirs.predict_proba(x), atol=1e-4)
        assert set(ours.predict(x)) == {2, 3}


def test_parameters_are_recovered():
    rng = np.random.default_rng(1)
    beta, theta = np.array([1.5, -0.7, 0.0]), np.array([-2.0, -0.5, 0.1, 1.9])
    x = rng.normal(size=(20000, 3))
    y = np.searchsorted(theta, x @ beta + rng.logistic(size=len(x)))
    model = OrdinalLogistic(0.0).fit(x, y)
    np.testing.assert_allclose(model.coefficients, beta, atol=0.06)  # three standard errors
    np.testing.assert_allclose(model.thresholds, theta, atol=0.09)


def test_the_fit_is_the_least_of_what_it_minimises():
    rng = np.random.default_rng(4)
    x = rng.normal(size=(200, 2))
    y = np.searchsorted([-1.0, 0.5, 1.5], x @ [1.0, 2.0] + rng.logistic(size=200))
    model = OrdinalLogistic(3.0).fit(x, y)

    def loss(coefficients, thresholds):
        """From the definition, with plain probabilities."""
        below = 1 / (1 + np.exp(-(thresholds[None, :] - (x @ coefficients)[:, None])))
        edges = np.column_stack([np.zeros(200), below, np.ones(200)])
        p = edges[np.arange(200), y + 1] - edges[np.arange(200), y]
        return -np.log(p).sum() + 1.5 * coefficients @ coefficients

    least = loss(model.coefficients, model.thresholds)
    for i in range(5):
        for step in (-1e-2, 1e-2):
            moved = np.concatenate([model.coefficients, model.thresholds])
            moved[i] += step
            assert loss(moved[:2], moved[2:]) > least


def test_without_features_the_shares_come_back():
    y = np.repeat([0, 1, 3, 5], [10, 20, 30, 40])
    model = OrdinalLogistic(1.0).fit(np.zeros((100, 1)), y)
    np.testing.assert_allclose(model.predict_proba(np.zeros((1, 1)))[0], [0.1, 0.2, 0.3, 0.4], atol=1e-4)
    assert model.classes.tolist() == [0, 1, 3, 5]


@pytest.mark.parametrize(
    ("x", "y", "word"),
    [
        (np.zeros((3, 1)), [1, 1, 1], "two grades"),
        (np.full((2, 1), np.nan), [0, 1], "not finite"),
        (np.zeros((3, 1)), [0, 1], r"\(3, 1\)"),
    ],
)
def test_ordinal_bad_input(x, y, word):
    with pytest.raises(SettingsError, match=word):
        OrdinalLogistic().fit(x, y)
    with pytest.raises(SettingsError, match="penalty"):
        OrdinalLogistic(-1.0)


# scores


RANKS = st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=2, max_size=40)


@given(RANKS)
@settings(max_examples=60, deadline=None)
def test_scores_are_those_of_scikit_learn(pairs):
    a, b = np.array(pairs).T
    scores = evaluate(a[:, None], b[:, None], resamples=2)
    if len(set(a) | set(b)) > 1:
        expected = cohen_kappa_score(a, b, weights="quadratic", labels=np.arange(6))
        np.testing.assert_allclose(quadratic_kappa(a, b), expected, atol=1e-12)
        np.testing.assert_allclose(scores.kappa.value, expected, atol=1e-12)
    else:
        assert quadratic_kappa(a, b) == 0
    assert scores.macro_f1.value == pytest.approx(f1_score(a, b, average="macro"))
    assert scores.mae.value == pytest.approx(np.abs(a - b).mean())
    assert scores.within_one.value == pytest.approx((np.abs(a - b) <= 1).mean())
    assert confusion(a[:, None], b[:, None]).sum() == len(a)


def test_joints_of_a_patient_are_drawn_together():
    # three equal joints tell no more than one, so the interval stays; three independent ones narrow it
    rng = np.random.default_rng(2)
    truth = rng.integers(0, 6, (300, 3))
    given_ranks = np.clip(truth + rng.integers(-2, 3, truth.shape), 0, 5)

    def width(columns):
        scores = evaluate(truth[:, columns], given_ranks[:, columns])
        return scores.kappa.high - scores.kappa.low

    assert width([0, 0, 0]) == pytest.approx(width([0]))
    assert width([0, 1, 2]) < 0.75 * width([0])


def test_intervals_cover_the_true_kappa():
    # readings with three equally likely ranks that agree with probability p, else independent: kappa = p
    rng = np.random.default_rng(3)
    inside = 0
    for seed in range(60):
        a, other = rng.integers(0, 3, (2, 150, 1))
        b = np.where(rng.random((150, 1)) < 0.6, a, other)
        kappa = evaluate(a, b, resamples=200, seed=seed).kappa
        inside += kappa.low <= 0.6 <= kappa.high
    assert 51 <= inside <= 60  # 57 expected


def test_missing_grades_do_not_count():
    truth = np.array([[0, 1], [2, MISSING], [4, 3], [5, 5]])
    other = np.array([[0, 1], [1, 4], [MISSING, 3], [5, 4]])
    scores = evaluate(truth, other, resamples=5)
    assert scores.count == 6
    assert scores.by_joint[0] == pytest.approx(quadratic_kappa([0, 2, 5], [0, 1, 5]))
    with pytest.raises(SettingsError, match="no pair"):
        evaluate(np.full((3, 1), MISSING), np.zeros((3, 1)))
    with pytest.raises(SettingsError, match="0 to 5"):
        evaluate([[6]], [[0]])


# features


def row(speed_deg=240.0, start=-5.0, end=-110.0, test="fast"):
    return features.TrialRow(0, test, "knee", np.radians(speed_deg), np.radians(start), np.radians(end))


def ramp(one, torque, rate=200.0):
    """Noiseless samples of a commanded stretch; torque of (fraction, time s from its beginning), N m."""
    way = one.end - one.start
    T = 1.875 * abs(way) / one.speed
    time = np.arange(0, 1.0 + T, 1 / rate)
    x = np.clip((time - REST) / T, 0, 1)
    part, speed = x**3 * (10 + x * (-15 + 6 * x)), x**2 * (30 + x * (-60 + 30 * x)) / T
    acceleration = way * x * (60 + x * (-180 + 120 * x)) / T**2
    inertia = features.inertia_per_size("knee") * 70 * 1.8**2
    return {
        "time": time,
        "q/knee": one.start + way * part,
        "v/knee": way * speed,
        "torque": -torque(part, time - REST) + inertia * acceleration + 1.0,  # the stretch is negative; 1 N m is rest
    }


def test_features_of_a_spring():
    one = row()
    found = features.stretch_features("knee", one, ramp(one, lambda part, t: 63.0 * part), (70.0, 1.8))
    size = 70 * 1.8
    assert found["rest"] == pytest.approx(-1.0 / size, abs=1e-9)
    for percent in (25, 50, 75, 95):
        assert found[f"at{percent}"] == pytest.approx(0.5 * percent / 100, abs=0.015)
    assert found["peak"] == pytest.approx(0.5, abs=0.015)
    assert found["reach"] == pytest.approx(1.0, abs=1e-6)
    assert found["slowed"] < 0.03
    assert abs(found["released"]) < 0.015  # a spring does not let go
    assert found["slope_late"] == pytest.approx(0.5 * 0.45, abs=0.015)
    assert found["share"] == pytest.approx(1 - 0.02 / 0.5, abs=0.06)


def test_a_catch_lets_go_and_slows():
    one = row()
    caught = ramp(one, lambda part, t: 40.0 * np.exp(-(((part - 0.4) / 0.15) ** 2)))
    stopped = np.abs(caught["q/knee"] - one.start) > 0.5 * abs(one.end - one.start)
    found = features.stretch_features("knee", one, caught, (70.0, 1.8))
    assert found["peak"] == pytest.approx(40 / 126, rel=0.1)
    assert found["peak_at"] == pytest.approx(0.4, abs=0.05)
    assert found["released"] == pytest.approx(found["peak"], rel=0.05)
    short = caught | {
        "q/knee": np.where(stopped, one.start + 0.5 * (one.end - one.start), caught["q/knee"]),
        "v/knee": np.where(stopped, 0.0, caught["v/knee"]),
    }
    found = features.stretch_features("knee", one, short, (70.0, 1.8))
    assert found["reach"] == pytest.approx(0.5, abs=0.02)
    assert found["slowed"] > 0.8


def test_features_of_a_burst():
    one = row()
    samples = ramp(one, lambda part, t: 0 * part)
    part = (samples["q/knee"] - one.start) / (one.end - one.start)
    noise = 0.001 * np.sin(np.arange(len(part)))
    burst = samples | {f"emg/{m}": 0.05 + noise + 0.3 * (part > 0.3) for m in ("rect_fem", "vasti")}
    burst |= {"emg/hamstrings": np.full(len(part), 0.02)}
    found = features.emg_features("knee", one, burst)
    assert found["rest"] == pytest.approx(0.05, abs=1e-3)
    assert found["peak"] == pytest.approx(0.3, abs=5e-3)
    assert found["onset_at"] == pytest.approx(0.3, abs=0.05)
    assert found["onset_speed"] == pytest.approx(0.95, abs=0.1)
    assert found["opposed"] == pytest.approx(0.02)
    quiet = burst | {f"emg/{m}": 0.05 + noise for m in ("rect_fem", "vasti")}
    assert features.emg_features("knee", one, quiet)["onset_at"] > 1.2


def test_features_of_a_pendulum():
    time = np.arange(0, 8, 0.01)
    decay, frequency = 0.6, 6.0
    q = -1.2 + 1.2 * np.exp(-decay * time) * np.cos(frequency * time)
    found = features.pendulum_features({"time": time, "q/knee": q})
    period = 2 * np.pi / frequency
    assert found["decrement"] == pytest.approx(decay * period, rel=0.1)
    assert found["relaxation"] == pytest.approx(1 + np.exp(-decay * period / 2), rel=0.03)
    assert found["excursion"] == pytest.approx(1.2 * found["relaxation"], rel=0.02)
    stiff = -0.5 * (1 - np.exp(-3 * time))
    found = features.pendulum_features({"time": time, "q/knee": stiff})
    assert found["swings"] == 0
    assert found["relaxation"] == pytest.approx(1.0, abs=0.02)


def test_a_missing_trial_is_missing_features():
    one = row()
    samples = {0: ramp(one, lambda part, t: 20.0 * part) | {f"emg/{m}": np.full(1000, 0.1) for m in ()}}
    for muscle in ("rect_fem", "vasti", "hamstrings"):
        samples[0][f"emg/{muscle}"] = np.full(len(samples[0]["time"]), 0.1)
    person = {"female": 1.0, "height": 1.8, "body_mass": 70.0}
    names = features.feature_names("knee")
    values = dict(zip(names, features.describe("knee", person, [one], samples), strict=True))
    assert np.isfinite([values["fast_high/peak"], values["fast_low/emg_rest"], values["person/height"]]).all()
    for name in names:
        assert np.isnan(values[name]) == (not name.startswith(("person", "fast_low/", "fast_high/"))), name
    filled = baseline.Filler(np.array([[1.0, np.nan, 7.0], [2.0, np.nan, 7.0], [np.nan, np.nan, 7.0]]))
    np.testing.assert_allclose(filled(np.array([[np.nan, np.nan, np.nan]])), [[0.0, 0.0, 0.0]])


def test_only_declared_columns_can_be_read():
    columns = {"torque": np.zeros(3), "gain": np.ones(3), "time": np.arange(3.0)}
    assert Guarded("observables", columns, ("time", "torque"))["torque"].sum() == 0
    with pytest.raises(SettingsError, match="'gain'"):
        Guarded("observables", columns, ("time",))["gain"]
    with pytest.raises(SettingsError, match="'torque'"):  # readable, but not declared for this family
        Guarded("observables", columns, ("time",))["torque"]
    with pytest.raises(SettingsError, match="gain"):
        Guarded("observables", columns, ("time", "gain"))
    hidden = ("latent", "excitation", "activation", "force", "fiber", "reflex", "rank", "patient", "seed")
    assert not [c for names in READABLE.values() for c in names if c.startswith(hidden)]


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_cuts_part_the_ranks(seed):
    rng = np.random.default_rng(seed)
    rank = rng.integers(0, 6, 120)
    cuts = baseline.cut_points(rank + rng.uniform(-0.01, 0.01, 120), rank)
    assert (np.diff(cuts) >= 0).all()
    noisy = rank + rng.normal(scale=1.5, size=120)
    graded = np.searchsorted(baseline.cut_points(noisy, rank), noisy, side="right")
    assert quadratic_kappa(rank, graded) >= quadratic_kappa(rank, np.clip(np.rint(noisy), 0, 5)) - 0.02


def test_trees_pass_over_features_that_tell_nothing():
    pytest.importorskip("sklearn")
    from mjhcmc.patients.learning.baseline import boosting

    rng = np.random.default_rng(0)
    y = np.repeat(np.arange(3), 40)
    x = np.column_stack([y + 0.1 * rng.standard_normal(120), np.full(120, 2.0), np.full(120, np.nan)])
    predict, _ = boosting((x, y), (x, y), ("telling", "constant", "missing"))
    assert (predict(x) == y).mean() > 0.9

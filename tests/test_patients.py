"""Virtual patients: their distributions, how their parts hang together, and that a seed makes the same one anywhere."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from mjhcmc.errors import SettingsError
from mjhcmc.patients.distributions import (
    DISTRIBUTIONS,
    GROUP_RHO,
    GROUP_SHIFT,
    Kumaraswamy,
    LogNormal,
    Named,
    TruncatedNormal,
    Uniform,
    WithZeros,
    distributions_table,
)
from mjhcmc.patients.groups import GROUPS
from mjhcmc.patients.patient import PATIENT, RATERS, SENSORS, SESSION, GroupState, Patient, sample_patient, stream

GROUP_QUANTITIES = ("gain", "threshold", "passive_strain", "fiber_shortening", "tone")
COHORT = 2


@pytest.fixture(scope="module")
def cohort() -> pd.DataFrame:
    return pd.DataFrame([sample_patient(COHORT, index).row() for index in range(4000)])


# --- distributions


@given(
    u=st.floats(0, 1),
    v=st.floats(0, 1),
    kind=st.sampled_from([Uniform, TruncatedNormal, LogNormal, Kumaraswamy]),
    first=st.floats(0.1, 5),
    second=st.floats(0.1, 5),
    low=st.floats(0.01, 3),
    width=st.floats(1e-3, 10),
    zeros=st.floats(0, 0.9),
)
@settings(max_examples=300, deadline=None)
def test_an_inverse_cdf_rises_within_its_limits(u, v, kind, first, second, low, width, zeros):
    shape = () if kind is Uniform else (first, second)
    distribution = kind(*shape, low, low + width)
    assert distribution.low <= distribution.at(u) <= distribution.high
    if u < v:
        assert distribution.at(u) <= distribution.at(v)
    mixed = WithZeros(zeros, distribution)
    assert mixed.at(u) == 0.0 if u <= zeros else mixed.at(u) >= distribution.low


@pytest.mark.parametrize(
    ("distribution", "oracle"),
    [
        (Uniform(-1.0, 3.0), stats.uniform(-1, 4)),
        (TruncatedNormal(26, 4, 18, 38), stats.truncnorm(-2, 3, 26, 4)),
        (LogNormal(1.0, 0.2, 1e-3, 1e3), stats.lognorm(0.2)),
        (Kumaraswamy(1.0, 2.5, 2.0, 5.0), stats.beta(1, 2.5, 2, 3)),  # a beta distribution where a or b is 1
        (Kumaraswamy(4.0, 1.0, 0.3, 0.6), stats.beta(4, 1, 0.3, 0.3)),
    ],
)
def test_an_inverse_cdf_is_scipys(distribution, oracle):
    u = np.linspace(0.001, 0.999, 57)
    np.testing.assert_allclose([distribution.at(x) for x in u], oracle.ppf(u), rtol=1e-9)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Uniform(1.0, 1.0), "low"),
        (lambda: Uniform(math.nan, 1.0), "low is nan"),
        (lambda: TruncatedNormal(0.0, 0.0, -1.0, 1.0), "sd is 0.0"),
        (lambda: LogNormal(1.0, 0.2, 0.0, 2.0), "low is 0.0"),
        (lambda: Kumaraswamy(1.0, -2.0, 0.0, 1.0), "b is -2.0"),
        (lambda: Kumaraswamy(1.0, "2", 0.0, 1.0), "b is '2'"),
        (lambda: WithZeros(1.0, Uniform(0.0, 1.0)), "zeros is 1.0"),
        (lambda: WithZeros(0.5, Uniform(-1.0, 1.0)), "begin at -1"),
        (lambda: Uniform(0.0, 1.0).at(1.5), "u is 1.5"),
        (lambda: Uniform(0.0, 1.0).at(math.nan), "u is nan"),
        (lambda: Named(Uniform(0.0, 1.0), "m", " "), "source"),
        (lambda: Named(Uniform(0.0, 1.0), "m", "x", rho=0.9, reason="y"), "rho is 0.9"),
        (lambda: Named(Uniform(0.0, 1.0), "m", "x", rho=0.5), "no reason"),
    ],
)
def test_numbers_that_make_no_distribution_are_refused(make, says):
    with pytest.raises(SettingsError, match=says) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_every_quantity_has_a_source_in_the_table():
    lines = distributions_table().splitlines()
    assert len(lines) == len(DISTRIBUTIONS) + 2
    assert {line.count(" | ") for line in lines} == {4}
    for name, named in DISTRIBUTIONS.items():
        assert any(f"`{name}`" in line and named.source in line for line in lines)
        assert "chosen here" in named.source or "doi:" in named.source
        assert "|" not in named.source + named.reason + named.unit


# --- sampling


def test_a_seed_and_an_index_make_this_patient():
    # Written down once: a change here makes every data set another one, and needs another generator version.
    assert sample_patient(7, 0).row() == FROZEN


def test_patients_do_not_depend_on_each_other():
    backwards = {index: sample_patient(3, index) for index in reversed(range(20))}
    assert [sample_patient(3, index) for index in range(20)] == [backwards[index] for index in range(20)]
    assert len(set(backwards.values())) == 20
    assert sample_patient(4, 0) != backwards[0]
    assert sample_patient(np.int64(3), np.int32(5)) == backwards[5]


def test_streams_are_told_apart_by_seed_index_and_purpose():
    keys = list(itertools.product((0, 1), (0, 1), (PATIENT, SESSION, SENSORS, RATERS)))
    first = [float(stream(*key).random()) for key in keys]
    assert len(set(first)) == len(keys)
    assert first == [float(stream(*key).random()) for key in keys]
    own = np.random.default_rng(np.random.SeedSequence(entropy=1, spawn_key=(0, 2)))
    assert stream(1, 0, SENSORS).random() == own.random()


def test_another_reflex_or_muscle_model_leaves_the_patient_who_he_is():
    rows = {r: [sample_patient(2, i, reflex=r).row() for i in range(200)] for r in ("velocity", "equation1", "force")}
    for reflex in ("equation1", "force"):
        for one, other in zip(rows["velocity"], rows[reflex], strict=True):
            assert other["reflex"] == reflex
            assert {k for k in one if one[k] != other[k]} <= {
                "reflex",
                *(f"{name}/{group}" for group in GROUPS for name in ("gain", "threshold")),
            }
        for quantity in ("gain/plantarflexors", "threshold/plantarflexors"):
            ranks = [stats.rankdata([row[quantity] for row in rows[r]]) for r in ("velocity", reflex)]
            np.testing.assert_array_equal(*ranks)  # the same latent
    assert all(0.05 <= row["threshold/hip_flexors"] <= 0.3 for row in rows["force"])
    assert all(row["gain/hip_flexors"] <= 1.2 for row in rows["force"])
    assert dataclasses.replace(sample_patient(2, 0), muscle="compliant") == sample_patient(2, 0, muscle="compliant")


def test_numbers_have_nine_digits(cohort):
    numbers = cohort.select_dtypes("float").to_numpy().ravel()
    assert all(float(f"{value:.9g}") == value for value in numbers[:20000])


def _oracle(distribution):
    """The same distribution by scipy."""
    match distribution:
        case Uniform(low, high):
            return stats.uniform(low, high - low)
        case TruncatedNormal(mean, sd, low, high):
            return stats.truncnorm((low - mean) / sd, (high - mean) / sd, mean, sd)
        case LogNormal(median, sigma, low, high):
            a, b = (math.log(limit / median) / sigma for limit in (low, high))
            return stats.loguniform(1, 2) if a > b else _Exp(stats.truncnorm(a, b, math.log(median), sigma))
        case Kumaraswamy(1.0, b, low, high):
            return stats.beta(1, b, low, high - low)
        case Kumaraswamy(a, 1.0, low, high):
            return stats.beta(a, 1, low, high - low)
    raise AssertionError(distribution)


class _Exp:
    def __init__(self, logarithm):
        self.logarithm = logarithm

    def cdf(self, x):
        return self.logarithm.cdf(np.log(x))


@pytest.mark.parametrize(
    ("column", "name"),
    [
        *((name, name) for name in ("strength", "paresis", "severity", "delay", "cocontraction")),
        *((name, name) for name in ("activation_time", "deactivation_time")),
        ("gain/knee_extensors", "gain/velocity"),
        ("threshold/knee_flexors", "threshold/velocity"),
        ("passive_strain/knee_extensors", "passive_strain"),
        ("fiber_shortening/knee_flexors", "fiber_shortening"),
        ("tone/knee_extensors", "tone"),
    ],
)
def test_a_quantity_is_distributed_as_the_table_says(cohort, column, name):
    values, distribution = cohort[column].to_numpy()[:3000], DISTRIBUTIONS[name].distribution
    if isinstance(distribution, WithZeros):
        zeros = int((values == 0).sum())
        assert stats.binomtest(zeros, len(values), distribution.zeros).pvalue > 1e-3
        values, distribution = values[values > 0], distribution.others
    assert stats.kstest(values, _oracle(distribution).cdf).pvalue > 1e-3


@pytest.mark.parametrize("sex", ["F", "M"])
def test_bodies_are_those_of_their_sex(cohort, sex):
    own = cohort[cohort.sex == sex]
    assert len(own) == pytest.approx(2000, abs=120)
    quantities = ("height", *(f"{part}_mass_fraction" for part in ("thigh", "shank", "foot")))
    for name in quantities:
        assert stats.kstest(own[name], _oracle(DISTRIBUTIONS[f"{name}/{sex}"].distribution).cdf).pvalue > 1e-3
    index = own.body_mass / own.height**2
    assert stats.kstest(index, _oracle(DISTRIBUTIONS["body_mass_index"].distribution).cdf).pvalue > 1e-3


def test_the_farther_from_the_trunk_the_more_affected(cohort):
    # The normal score of a shifted group's quantity is that of the table, moved by rho times the shift.
    for group in ("hip_flexors", "plantarflexors"):
        for name, key in (("threshold", "threshold/velocity"), ("passive_strain", "passive_strain")):
            named = DISTRIBUTIONS[key]
            share = _oracle(named.distribution).cdf(cohort[f"{name}/{group}"])
            score = stats.norm.ppf(share) - named.rho * GROUP_SHIFT[group]
            assert stats.kstest(score, stats.norm.cdf).pvalue > 1e-3
    gains = cohort[[f"gain/{group}" for group in GROUPS]].mean()
    assert gains["gain/plantarflexors"] > gains["gain/knee_extensors"] > gains["gain/hip_flexors"]


def _spearman(cohort, one, other):
    return float(stats.spearmanr(cohort[one], cohort[other]).statistic)


@pytest.mark.parametrize("group", GROUPS)
def test_mechanisms_of_a_group_are_partly_independent(cohort, group):
    signs = {"gain": 1, "threshold": -1, "passive_strain": -1, "fiber_shortening": 1, "tone": 1}
    for one, other in itertools.combinations(signs, 2):
        found = _spearman(cohort, f"{one}/{group}", f"{other}/{group}")
        assert 0.15 < found * signs[one] * signs[other] < 0.8


def test_severity_tells_something_and_never_all(cohort):
    signs = {"gain": 1, "threshold": -1, "passive_strain": -1, "fiber_shortening": 1, "tone": 1}
    for name, sign in signs.items():
        assert 0.2 < sign * _spearman(cohort, "severity", f"{name}/knee_extensors") < 0.8
    assert -0.8 < _spearman(cohort, "severity", "paresis") < -0.3
    assert 0.3 < _spearman(cohort, "severity", "cocontraction") < 0.8
    for name in ("height", "strength", "delay", "activation_time", "thigh_mass_fraction"):
        assert abs(_spearman(cohort, "severity", name)) < 0.06
    unaffected = cohort[cohort.severity == 0]
    assert len(unaffected) == pytest.approx(1000, abs=110)
    assert (unaffected["gain/knee_extensors"] == 0).mean() > 2 * (cohort["gain/knee_extensors"] == 0).mean() - 0.1


def test_groups_of_a_patient_are_alike_and_not_the_same(cohort):
    for one, other in itertools.combinations(GROUPS, 2):
        named = DISTRIBUTIONS["threshold/velocity"]
        scores = [stats.norm.ppf(_oracle(named.distribution).cdf(cohort[f"threshold/{g}"])) for g in (one, other)]
        expected = (named.rho * GROUP_RHO) ** 2  # of the normal scores
        assert np.corrcoef(scores)[0, 1] == pytest.approx(expected, abs=0.05)
        assert 0.15 < _spearman(cohort, f"gain/{one}", f"gain/{other}") < 0.8


# --- records


def test_a_row_is_the_patient(cohort):
    patient = sample_patient(1, 17, reflex="force", muscle="rigid")
    row = patient.row()
    assert Patient.from_row(row) == patient
    assert Patient.from_row(json.loads(json.dumps(row))) == patient
    assert hash(Patient.from_row(row)) == hash(patient)
    table = cohort.iloc[:5]
    for index, record in enumerate(table.to_dict("records")):
        assert Patient.from_row(record) == sample_patient(COHORT, index)
    numpys = {
        k: np.float64(v) if isinstance(v, float) else np.int64(v) if isinstance(v, int) else v for k, v in row.items()
    }
    assert repr(Patient.from_row(numpys)) == repr(patient)
    assert patient.group("plantarflexors").gain == row["gain/plantarflexors"]
    assert [f"{name}/{group}" for group in GROUPS for name in GROUP_QUANTITIES] == list(row)[-20:]


def test_a_patient_cannot_be_changed():
    patient = sample_patient(0, 0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        patient.height = 2.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        patient.groups[0].gain = 2.0


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"delay": None}, "no column 'delay'"),
        ({"gain/hip_flexors": None}, "no column 'gain/hip_flexors'"),
        ({"age": 40}, "column 'age'"),
        ({"height": "tall"}, "height is 'tall'"),
        ({"height": math.nan}, "height is nan"),
        ({"height": True}, "height is True"),
        ({"height": 175.0}, "height is 175.0: give a number from 1 to 2.5"),
        ({"seed": 1.0}, "seed is 1.0"),
        ({"index": -1}, "index is -1"),
        ({"sex": "X"}, "sex 'X' is not known: choose one of F, M"),
        ({"sex": 1}, "sex is 1"),
        ({"reflex": "length"}, "'length' is not known"),
        ({"tone/knee_flexors": 1.5}, "tone/knee_flexors is 1.5"),
        ({"tone/knee_flexors": "low"}, "tone/knee_flexors is 'low'"),
        ({"paresis": 0.0}, "paresis is 0.0"),
    ],
)
def test_bad_rows_are_refused_by_name(change, says):
    row = sample_patient(0, 0).row() | change
    row = {key: value for key, value in row.items() if value is not None}
    with pytest.raises(SettingsError, match=says) as caught:
        Patient.from_row(row)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (lambda: sample_patient(-1, 0), "seed is -1"),
        (lambda: sample_patient(1.5, 0), "seed is 1.5"),
        (lambda: sample_patient(True, 0), "seed is True"),
        (lambda: sample_patient(0, -2), "index is -2"),
        (lambda: sample_patient(0, 0, reflex="length"), "reflex 'length' .*velocity, equation1, force"),
        (lambda: sample_patient(0, 0, muscle="wood"), "muscle 'wood' .*mujoco, rigid, compliant"),
        (lambda: stream(0, 0, 4), "purpose is 4"),
        (lambda: sample_patient(0, 0).group("arm"), "'arm' .*hip_flexors"),
        (lambda: GroupState("arm", 0.0, 1.0, 0.6, 0.0, 0.0), "'arm' .*hip_flexors"),
        (lambda: dataclasses.replace(sample_patient(0, 0), groups=()), "muscle groups are hip_flexors"),
    ],
)
def test_bad_input_is_refused(ask, says):
    with pytest.raises(SettingsError, match=says):
        ask()


FROZEN = {
    "seed": 7,
    "index": 0,
    "reflex": "velocity",
    "muscle": "mujoco",
    "sex": "F",
    "height": 1.55369866,
    "body_mass": 63.2510519,
    "thigh_mass_fraction": 0.135152074,
    "shank_mass_fraction": 0.0461650952,
    "foot_mass_fraction": 0.0126402218,
    "strength": 1.21742237,
    "paresis": 0.8280114,
    "severity": 0.571344318,
    "delay": 0.0413214043,
    "cocontraction": 0.0304637714,
    "activation_time": 0.0130916472,
    "deactivation_time": 0.0436936458,
    "gain/hip_flexors": 0.0250867142,
    "threshold/hip_flexors": 0.52296958,
    "passive_strain/hip_flexors": 0.526493851,
    "fiber_shortening/hip_flexors": 0.0369691734,
    "tone/hip_flexors": 0.0161690028,
    "gain/knee_extensors": 0.133913214,
    "threshold/knee_extensors": 1.04672272,
    "passive_strain/knee_extensors": 0.577599819,
    "fiber_shortening/knee_extensors": 0.0222776734,
    "tone/knee_extensors": 0.0192193383,
    "gain/knee_flexors": 0.144016971,
    "threshold/knee_flexors": 0.810426256,
    "passive_strain/knee_flexors": 0.563578335,
    "fiber_shortening/knee_flexors": 0.0,
    "tone/knee_flexors": 0.0107236777,
    "gain/plantarflexors": 0.0849297968,
    "threshold/plantarflexors": 0.24268596,
    "passive_strain/plantarflexors": 0.506932243,
    "fiber_shortening/plantarflexors": 0.0408442538,
    "tone/plantarflexors": 0.0281692942,
}

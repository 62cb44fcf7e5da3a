"""Grades from what is felt: the wording of the scale, order, and the scatter of raters."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from resistances import HAND, bump, held, onward, record, wall

from mjhcmc.errors import SettingsError
from mjhcmc.patients.bench import Case, run_trials
from mjhcmc.patients.examination import usual_of
from mjhcmc.patients.grades import GRADES, grade_of, number, rank, weighted_kappa
from mjhcmc.patients.groups import TESTED
from mjhcmc.patients.leg import leg_of
from mjhcmc.patients.patient import sample_patient
from mjhcmc.patients.rater import RATER_NOISE, Rater, Rubric, ideal_grade, inter_rater_kappa, rate, sample_raters
from mjhcmc.patients.resistance import hand_on, read_resistance, usual_resistance
from mjhcmc.patients.trials import stretch

DESCRIBED = {
    "no increase": ("0", lambda s, t: 0 * s, 1.0),
    "below what is felt": ("0", lambda s, t: 2.0 * s, 1.0),
    "catch and release": ("1", bump(0.5, 20.0), 1.0),
    "minimal at the end": ("1", lambda s, t: 14.0 * np.clip((s - 0.78) / 0.22, 0, 1), 1.0),
    "catch, then minimal through less than half": ("1+", held(0.62, 18.0, 7.0), 1.0),
    "late catch, minimal to the end": ("1+", held(0.78, 15.0, 8.0), 1.0),
    "marked through most of the range": ("2", onward(0.2, 25.0), 1.0),
    "catch, then marked through most of the range": ("2", held(0.3, 35.0, 20.0), 1.0),
    "considerable": ("3", onward(0.1, 75.0), 1.0),
    "range hard to get": ("3", wall(0.7, 60.0), 0.7),
    "rigid": ("4", wall(0.3, 120.0), 0.3),
}


def read(force, reach=1.0, **how):
    return read_resistance(record(force, reach=reach, **how), HAND)


@pytest.mark.parametrize(("grade", "force", "reach"), DESCRIBED.values(), ids=DESCRIBED)
def test_each_description_gets_its_grade(grade, force, reach):
    assert ideal_grade(read(force, reach)) == grade


def test_descriptions_cover_the_scale():
    assert {grade for grade, *_ in DESCRIBED.values()} == set(GRADES)


LIMBS = st.builds(
    lambda place, caught, rest, end, power, tone: (
        lambda s, t: held(place, caught + rest, rest)(s, t) + end * s**power + tone
    ),
    st.floats(0.1, 0.9), st.floats(0, 60), st.floats(0, 30), st.floats(0, 60), st.floats(1, 6), st.floats(0, 5),
)  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(LIMBS, st.floats(1, 8), st.floats(0.2, 1))
def test_more_resistance_never_lowers_the_grade(force, more, reach):
    less, stronger = read(force, reach), read(lambda s, t: more * force(s, t), reach)
    assert rank(ideal_grade(stronger)) >= rank(ideal_grade(less))


@settings(max_examples=40, deadline=None)
@given(
    LIMBS,
    st.sampled_from(["peak", "mean", "range_affected", "range_lost", "catch_size"]),
    st.floats(0, 1),
)
def test_more_of_anything_never_lowers_the_grade(force, what, much):
    felt = read(force)
    value = getattr(felt, what) + much * (20 * HAND.lever_arm if what in ("peak", "mean", "catch_size") else 1)
    assert rank(ideal_grade(dataclasses.replace(felt, **{what: value}))) >= rank(ideal_grade(felt))


def test_grade_of_a_larger_limb_goes_by_the_force_at_the_hand():
    small = read(onward(0.2, 15.0))
    long = dataclasses.replace(HAND, lever_arm=2 * HAND.lever_arm)
    large = dataclasses.replace(small, hand=long, peak=2 * small.peak, mean=2 * small.mean)
    assert ideal_grade(large) == ideal_grade(small)
    assert rank(ideal_grade(dataclasses.replace(small, hand=long))) < rank(ideal_grade(small))


# --- raters ---------------------------------------------------------------------------------------------------------


def healthy(s, t):
    return -10.0 + 35.0 * s


@pytest.fixture(scope="module")
def cohort():
    """Limbs of all kinds; most of them lie between grades, as in a clinic."""
    rng, limbs, usual = np.random.default_rng(3), [], usual_resistance(record(healthy))
    for _ in range(300):
        size = np.exp(rng.uniform(np.log(2), np.log(70)))
        place, kind = rng.uniform(0.1, 0.85), rng.integers(4)
        reach = 1.0 if rng.random() < 0.6 else rng.uniform(0.2, 1)
        force = (bump(place, size), held(place, size, 0.5 * size), onward(place, size), wall(reach, size))[kind]
        own = np.exp(0.2 * rng.standard_normal())  # what is healthy differs, and is only known on average
        limb = record(lambda s, t, force=force, own=own: force(s, t) + own * healthy(s, t), reach=reach)
        limbs.append(read_resistance(limb, HAND, usual))
    return limbs


def test_cohort_has_all_grades(cohort):
    share = np.bincount([rank(ideal_grade(limb)) for limb in cohort], minlength=6) / len(cohort)
    assert share.min() > 0.05


def test_raters_without_noise_are_ideal(cohort):
    rng = np.random.default_rng(0)
    for rater in (Rater(), *sample_raters(rng, 3, scale=0.0)):
        assert [rate(limb, rater, rng) for limb in cohort] == [ideal_grade(limb) for limb in cohort]


def test_raters_agree_as_published():
    """On limbs as they are simulated; benchmarks/patients.py has the figures of a large cohort."""
    people = [sample_patient(0, i) for i in range(16)]
    cases = [Case(p, leg_of(p), stretch(joint, "mas", session="ideal")) for p in people for joint in TESTED]
    limbs = [
        read_resistance(r, hand_on(r.trial.joint, c.patient.height), usual_of(c.patient, r.trial.joint))
        for c, r in zip(cases, run_trials(cases), strict=True)
    ]
    kappa = np.mean([inter_rater_kappa(limbs, np.random.default_rng(seed)) for seed in range(8)])
    assert 0.61 < kappa < 0.87


def test_more_noise_less_agreement(cohort):
    kappa = [inter_rater_kappa(cohort, np.random.default_rng(1), RATER_NOISE * more) for more in (0, 0.5, 2)]
    assert kappa[0] == 1
    assert kappa[0] > kappa[1] > kappa[2]


def test_raters_scatter_about_the_ideal_grade(cohort):
    rng = np.random.default_rng(2)
    off = [rank(rate(limb, sample_raters(rng, 1)[0], rng)) - rank(ideal_grade(limb)) for limb in cohort]
    assert abs(np.mean(off)) < 0.25


def test_a_severe_rater_gives_higher_grades(cohort):
    rng = np.random.default_rng(0)
    ranks = [[rank(rate(limb, Rater(force=force), rng)) for limb in cohort] for force in (0.6, 1.0, 1.6)]
    low, mid, high = np.array(ranks)
    assert (low <= mid).all()
    assert (mid <= high).all()
    assert low.mean() < mid.mean() < high.mean()


def test_only_uniform_numbers_are_drawn(cohort):
    class Uniform:
        """A generator that can do nothing else."""

        random = np.random.default_rng(5).random

    rng = np.random.default_rng(5)
    mine = Uniform()
    for _ in range(3):
        assert sample_raters(mine, 2) == sample_raters(rng, 2)
        assert rate(cohort[0], Rater(trial_force=0.5), mine) == rate(cohort[0], Rater(trial_force=0.5), rng)


@pytest.mark.parametrize(("n", "scale"), [(0, 1.0), (2, -1.0), (2, float("nan"))])
def test_raters_that_cannot_be(n, scale):
    with pytest.raises(SettingsError, match="raters"):
        sample_raters(np.random.default_rng(0), n, scale)


@pytest.mark.parametrize(
    ("wrong", "told"), [({"trace": 0.3}, "trace"), ({"hard": 0.0}, "hard"), ({"half": 0.2}, "brief")]
)
def test_rubric_that_cannot_be(wrong, told):
    with pytest.raises(SettingsError, match=told):
        Rubric(**wrong)


# --- the scale ------------------------------------------------------------------------------------------------------


def test_scale_round_trips():
    assert [grade_of(rank(grade)) for grade in GRADES] == list(GRADES)
    assert [number(grade) for grade in GRADES] == [0, 1, 1.5, 2, 3, 4]


@pytest.mark.parametrize("wrong", ["5", "1.5", ""])
def test_words_that_are_no_grade(wrong):
    with pytest.raises(SettingsError, match=r"Modified Ashworth Scale.*1\+"):
        rank(wrong)


@pytest.mark.parametrize("wrong", [-1, 6, 1.0, True])
def test_numbers_that_are_no_rank(wrong):
    with pytest.raises(SettingsError, match="0 to 5"):
        grade_of(wrong)


def kappa_by_table(a, b):
    """Cohen's weighted kappa from the table of counts."""
    counts = np.zeros((6, 6))
    np.add.at(counts, (a, b), 1 / len(a))
    weight = np.subtract.outer(np.arange(6), np.arange(6)) ** 2
    return 1 - (weight * counts).sum() / (weight * np.outer(counts.sum(1), counts.sum(0))).sum()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=2, max_size=40))
def test_kappa_is_that_of_the_table(pairs):
    a, b = np.array(pairs).T
    if len({*a, *b}) == 1:
        assert np.isnan(weighted_kappa(a, b))
    else:
        assert weighted_kappa(a, b) == pytest.approx(kappa_by_table(a, b), abs=1e-12)


@pytest.mark.parametrize(("a", "b"), [([], []), ([1, 2], [1]), ([0.5], [1]), ([6], [1])])
def test_kappa_of_what_are_no_ranks(a, b):
    with pytest.raises(SettingsError, match="kappa"):
        weighted_kappa(a, b)

"""What a hand feels in a passive stretch: synthetic records whose resistance is known."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from resistances import CATCH, HAND, bump, record, wall

from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.patients.rater import ideal_grade
from mjhcmc.patients.resistance import PLACES, Hand, hand_on, read_resistance, usual_resistance
from mjhcmc.patients.trials import pendulum

FEATURES = (
    "baseline", "onset", "peak", "mean", "end", "catch_size", "catch_position", "mean_after_catch", "peak_after_catch",
    "range_affected", "range_lost",
)  # fmt: skip


def read(force, hand=HAND, usual=None, **how):
    return read_resistance(record(force, **how), hand, usual)


def features(resistance):
    return {name: getattr(resistance, name) for name in FEATURES}


# --- closed forms ---------------------------------------------------------------------------------------------------


def test_constant_resistance_is_its_own_mean_peak_and_end():
    found = read(lambda s, t: np.full_like(s, 25.0))
    for name in ("baseline", "peak", "mean", "end"):
        assert getattr(found, name) == pytest.approx(25.0 * HAND.lever_arm, rel=1e-6), name
    assert found.range_affected == 1
    assert found.range_lost == pytest.approx(0, abs=1e-3)
    assert not found.catch


def test_ramp_is_felt_where_it_crosses_what_is_just_felt():
    found = read(lambda s, t: 20.0 * s)  # 3 N at .15 of the range
    assert found.onset == pytest.approx(0.15, abs=0.01)
    assert found.range_affected == pytest.approx(0.85, abs=0.01)
    assert found.mean == pytest.approx(10.0 * HAND.lever_arm, rel=0.01)


def test_limb_inertia_is_no_resistance():
    found = read(lambda s, t: 0 * s, inertia=0.4)
    assert abs(found.peak) < 0.02 * 0.4 * np.abs(record(lambda s, t: 0 * s).qacc).max()


@pytest.mark.parametrize("place", [0.25, 0.45, 0.65])
def test_catch_is_found_where_it_is(place):
    found = read(bump(place, 30.0))
    start, end = math.radians(-5), math.radians(-110)
    assert found.catch
    assert found.released
    assert found.catch_angle == pytest.approx(start + place * (end - start), abs=math.radians(5))
    assert 0.6 * 30 < found.catch_size / HAND.lever_arm <= 30


def test_held_catch_is_not_released():
    found = read(CATCH["held"])
    assert found.catch
    assert not found.released
    assert found.mean_after_catch == pytest.approx(15 * HAND.lever_arm, rel=0.15)


@pytest.mark.parametrize("onset", [0.0, 0.3, 0.6, 0.8])
@pytest.mark.parametrize("power", [1, 2, 4])
def test_strained_tissue_is_no_catch(onset, power):
    assert not read(lambda s, t: 80.0 * np.maximum((s - onset) / (1 - onset), 0) ** power).catch


@pytest.mark.parametrize("steep", [3.0, 8.0])
def test_exponential_stiffness_is_no_catch(steep):
    assert not read(lambda s, t: 60.0 * np.expm1(steep * s) / np.expm1(steep)).catch


def test_limb_that_ends_at_a_wall_has_lost_range():
    found = read(wall(0.4, 90.0), reach=0.4)
    assert found.range_lost == pytest.approx(0.6, abs=0.02)
    assert found.range_affected >= 0.6


def test_limb_that_moves_by_itself_does_not_resist():
    found = read(lambda s, t: -40.0 * (1 - s))
    assert found.baseline < 0
    assert found.mean == 0
    assert found.range_affected == 0


# --- what is usual --------------------------------------------------------------------------------------------------


def healthy(s, t):
    return -30.0 + 70.0 * s


def test_usual_resistance_is_not_felt():
    usual = usual_resistance(record(healthy))
    found = read(healthy, usual=usual)
    assert found.range_affected == 0
    assert found.range_lost == 0
    for name in ("peak", "mean", "end"):
        assert abs(getattr(found, name)) < 0.3 * HAND.lever_arm, name
    assert ideal_grade(found) == "0" != ideal_grade(read(healthy))


def test_catch_is_felt_over_what_is_usual():
    usual, caught = usual_resistance(record(healthy)), bump(0.6, 25.0)
    found = read(lambda s, t: healthy(s, t) + caught(s, t), usual=usual)
    alone = read(caught)
    assert found.catch
    assert found.catch_position == pytest.approx(alone.catch_position, abs=0.02)
    assert found.catch_size == pytest.approx(alone.catch_size, rel=0.05)


def test_usual_resistance_goes_with_size():
    usual = usual_resistance(record(healthy))
    np.testing.assert_allclose(usual.scaled(1.5).course, 1.5 * usual.course)
    assert usual.scaled(1.5).hold == 1.5 * usual.hold
    assert usual.scaled(2).reached == usual.reached
    assert usual.course.shape == PLACES.shape


# --- invariance -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("force", CATCH.values(), ids=CATCH)
@pytest.mark.parametrize("joint", ["hip", "ankle"])
def test_sign_of_the_coordinate_does_not_matter(force, joint):
    one, other = (features(read(force, joint=name)) for name in ("knee", joint))
    assert other == pytest.approx(one, rel=1e-6, abs=1e-9, nan_ok=True)


@pytest.mark.parametrize("force", CATCH.values(), ids=CATCH)
def test_sampling_rate_does_not_matter(force):
    slow, fast = read(force, rate=100.0), read(force, rate=200.0)
    for name in ("peak", "mean", "end", "catch_size", "mean_after_catch"):
        expected = pytest.approx(getattr(fast, name), rel=0.04, abs=0.3 * HAND.lever_arm, nan_ok=True)
        assert getattr(slow, name) == expected, name
    for name in ("onset", "catch_position", "range_affected", "range_lost"):
        assert getattr(slow, name) == pytest.approx(getattr(fast, name), abs=0.02, nan_ok=True), name
    assert (slow.catch, slow.released, ideal_grade(slow)) == (fast.catch, fast.released, ideal_grade(fast))


@pytest.mark.parametrize("force", CATCH.values(), ids=CATCH)
def test_ripple_does_not_matter(force):
    clean, rippled = read(force), read(lambda s, t: force(s, t) + 3.0 * np.sin(2 * np.pi * 25 * t))
    assert (clean.catch, clean.released, ideal_grade(clean)) == (rippled.catch, rippled.released, ideal_grade(rippled))
    for name in ("peak", "mean", "end", "catch_size"):
        expected = pytest.approx(getattr(clean, name), abs=0.5 * HAND.lever_arm, nan_ok=True)
        assert getattr(rippled, name) == expected, name


@settings(max_examples=30, deadline=None)
@given(st.floats(0.5, 2), st.floats(0.5, 2))
def test_another_hand_feels_what_it_would_read(force, perception):
    base = lambda s, t: CATCH["held"](s, t) + 20 * s**3  # noqa: E731
    hand = dataclasses.replace(HAND, perception=HAND.perception * perception)
    told, direct = read(base).felt(force=force, perception=perception), read(lambda s, t: force * base(s, t), hand)
    for name in ("onset", "peak", "mean", "catch_size", "range_affected", "range_lost"):
        assert getattr(told, name) == pytest.approx(getattr(direct, name), rel=1e-6, abs=1e-9), name


def test_same_hand_feels_the_same():
    found = read(lambda s, t: healthy(s, t) + CATCH["held"](s, t), usual=usual_resistance(record(healthy)))
    assert features(found.felt()) == pytest.approx(features(found), rel=1e-12, nan_ok=True)


# --- what cannot be read --------------------------------------------------------------------------------------------


def test_failed_record_is_named():
    broken = dataclasses.replace(record(healthy), failure="mas/knee at 0.4 s: diverged")
    with pytest.raises(SimulationError, match=r"mas/knee.*failed.*0\.4 s"):
        read_resistance(broken, HAND)


def test_short_record_is_named():
    whole = record(healthy)
    names = ("time", "qpos", "qvel", "qacc", "examiner_torque")
    for n in (0, 15, 40):
        short = dataclasses.replace(whole, **{name: getattr(whole, name)[:n] for name in names})
        with pytest.raises(SimulationError, match=f"mas/knee' has {n} samples"):
            read_resistance(short, HAND)


def test_value_that_is_not_finite_is_named():
    broken = record(healthy)
    broken.examiner_torque[50, 1] = math.nan
    with pytest.raises(SimulationError, match=r"not finite at 0\.500 s \(knee\)"):
        read_resistance(broken, HAND)


def test_only_stretches_are_read():
    swing = dataclasses.replace(record(healthy), trial=pendulum())
    with pytest.raises(SettingsError, match="pendulum/knee"):
        read_resistance(swing, HAND)


@pytest.mark.parametrize(
    "wrong", [{"lever_arm": 0.0}, {"lever_arm": math.nan}, {"perception": -1}, {"tolerance": -0.1}]
)
def test_hand_that_cannot_be(wrong):
    with pytest.raises(SettingsError, match=next(iter(wrong))):
        Hand(**({"lever_arm": 0.3} | wrong))


def test_hands_go_with_height():
    assert hand_on("knee", 1.8).lever_arm == pytest.approx(1.2 * hand_on("knee", 1.5).lever_arm)
    with pytest.raises(SettingsError, match="elbow"):
        hand_on("elbow", 1.7)

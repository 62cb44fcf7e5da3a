"""Properties of every model's curves: they rise where they must, fit their slopes, and have true inverses."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjhcmc.hill import (
    BezierCurve,
    Corner,
    Curves,
    DeGrooteFreglyActive,
    DeGrooteFreglyPassive,
    DeGrooteFreglyTendon,
    HillError,
    MujocoActive,
    MujocoForceVelocity,
    MujocoPassive,
    TendonForceLength,
    ThelenActive,
    ThelenForceVelocity,
    ThelenPassive,
    ThelenTendon,
    degroote_fregly2016,
    millard2012,
    mujoco_curves,
    tendon_force_length,
    thelen2003,
)

MODELS: dict[str, Curves] = {c.name: c for c in (thelen2003(), millard2012(), degroote_fregly2016(), mujoco_curves())}
TENDONS = {name: curves.tendon for name, curves in MODELS.items() if curves.tendon is not None}
each_model = pytest.mark.parametrize("curves", MODELS.values(), ids=MODELS)
each_tendon = pytest.mark.parametrize("tendon", TENDONS.values(), ids=TENDONS)


def difference(curve: Any, x: np.ndarray, *more: Any) -> np.ndarray:
    h = 1e-6
    return (curve(x + h, *more) - curve(x - h, *more)) / (2 * h)


@each_model
def test_known_points(curves: Curves) -> None:
    assert curves.active(1.0) == pytest.approx(1.0, abs=2e-3)  # De Groote and Fregly's sum of bells is .9994 there
    assert curves.force_velocity(0.0) == pytest.approx(1.0, abs=1e-12)
    assert curves.force_velocity(-1.0) == pytest.approx(0.0, abs=1e-9)
    assert curves.passive(0.5) == pytest.approx(0.0, abs=0.01)
    if curves.tendon is not None:
        assert curves.tendon(1.0) == pytest.approx(0.0, abs=1e-15)
        strain = 0.04 if "Thelen" in curves.name else 0.049
        assert curves.tendon(1 + strain) == pytest.approx(1.0, abs=1e-12)


def test_passive_strain_is_where_it_says() -> None:
    assert ThelenPassive(strain=0.5)(1.5) == pytest.approx(1.0)
    assert DeGrooteFreglyPassive(strain=0.5)(1.5) == pytest.approx(1.0)
    assert DeGrooteFreglyPassive(strain=0.5)(0.2) == pytest.approx(0.0, abs=1e-15)
    assert MujocoPassive(1.6, 1.3)(1.3) == pytest.approx(0.65)
    assert MujocoPassive(1.6, 1.3)(1.6) == pytest.approx(1.95)


@each_model
def test_passive_force_velocity_and_tendon_rise(curves: Curves) -> None:
    length, velocity = np.linspace(0.2, 2, 4001), np.linspace(-1.5, 1.5, 4001)
    assert np.all(np.diff(curves.passive(length)) >= 0)
    assert np.all(curves.passive(length) >= 0)
    assert np.all(curves.passive.derivative(length) >= 0)
    for a in (0.01, 0.3, 1.0):
        assert np.all(np.diff(curves.force_velocity(velocity, a)) >= -1e-15)
        assert np.all(curves.force_velocity.derivative(velocity, a) >= 0)
    active = curves.active(length)
    assert np.all((active >= 0) & (active <= 1.01))
    if curves.tendon is not None:
        strain = np.linspace(1.0, 1.1, 4001)
        assert np.all(np.diff(curves.tendon(strain)) > 0)
        assert np.all(curves.tendon(strain) >= 0)


@each_tendon
def test_a_slack_tendon_does_not_pull(tendon: Any) -> None:
    assert np.all(tendon(np.linspace(0.5, 1.0, 101)) <= 0)


@pytest.mark.parametrize("name", ["Thelen 2003", "Millard 2012"])
def test_nor_does_it_push(name: str) -> None:
    assert np.all(TENDONS[name](np.linspace(0.5, 1.0, 101)) == 0)


@each_model
def test_derivatives_are_the_slopes(curves: Curves) -> None:
    length, velocity = np.linspace(0.21, 1.9, 997) + 1.1e-5, np.linspace(-1.5, 1.5, 997) + 1.1e-5
    np.testing.assert_allclose(curves.active.derivative(length), difference(curves.active, length), atol=2e-4)
    steep = 1e-6 * (1 + np.abs(curves.passive.derivative(length)))
    assert np.all(np.abs(curves.passive.derivative(length) - difference(curves.passive, length)) < 20 * steep)
    for a in (0.05, 1.0):
        slope = curves.force_velocity.derivative(velocity, a)
        np.testing.assert_allclose(slope, difference(curves.force_velocity, velocity, a), rtol=2e-4, atol=2e-4)
    if curves.tendon is not None:
        strained = np.linspace(0.97, 1.08, 501) + 1.1e-6
        np.testing.assert_allclose(
            curves.tendon.derivative(strained), difference(curves.tendon, strained), rtol=1e-4, atol=2e-3
        )


@each_model
@settings(max_examples=60, deadline=None)
@given(share=st.floats(1e-3, 1 - 1e-3), a=st.floats(0.01, 1))
def test_the_velocity_curve_inverts(curves: Curves, share: float, a: float) -> None:
    low, high = np.clip(curves.force_velocity.bounds, -0.5, 1.8)
    multiplier = low + share * (high - low)
    velocity = curves.force_velocity.inverse(multiplier, a)
    assert curves.force_velocity(velocity, a) == pytest.approx(multiplier, abs=1e-11)
    assert curves.force_velocity.inverse(curves.force_velocity(velocity, a), a) == pytest.approx(velocity, abs=1e-9)


@each_tendon
@settings(max_examples=60, deadline=None)
@given(force=st.floats(0, 5))
def test_the_tendon_inverts(tendon: Any, force: float) -> None:
    assert tendon(tendon.inverse(force)) == pytest.approx(force, abs=1e-12)


@each_model
def test_shapes_and_nan(curves: Curves) -> None:
    for curve in (curves.active, curves.passive, curves.force_velocity, *([curves.tendon] if curves.tendon else [])):
        value, slope = curve.evaluate(np.full((2, 3), 1.01))
        assert np.shape(value) == np.shape(slope) == (2, 3)
        value, slope = curve.evaluate(np.array([np.nan, 1.01]))
        assert np.isnan(value[0])
        assert np.isfinite([value[1], slope[1]]).all()


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_bezier_points_lie_on_the_curve(seed: int) -> None:
    """The table of first guesses does not show: y(x) is found to rounding, whatever the bend."""
    rng = np.random.default_rng(seed)
    a, b = Corner(0.0, 0.0, rng.uniform(0, 0.5)), Corner(1.0, 1.0, rng.uniform(1.5, 6))
    bend = rng.uniform(0, 1)
    curve = BezierCurve([a, b], bend)
    # De Casteljau's construction of the same segment, at random parameters.
    x = (b.y - a.y - b.x * b.slope + a.x * a.slope) / (a.slope - b.slope)
    crossing = np.array([x, a.y + a.slope * (x - a.x)])
    ends, share = (np.array([a.x, a.y]), np.array([b.x, b.y])), 0.1 + 0.8 * bend
    near = [end + share * (crossing - end) for end in ends]
    points = np.array([ends[0], near[0], near[0], near[1], near[1], ends[1]])[:, :, None]
    u = rng.uniform(0, 1, 300)
    while len(points) > 1:
        points = points[:-1] * (1 - u) + points[1:] * u
    x, y = points[0]
    np.testing.assert_allclose(curve(x), y, rtol=0, atol=2e-14 * (1 + curve.derivative(x).max()))
    np.testing.assert_allclose(curve.inverse(y), x, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: ThelenActive(shape=0), "shape is 0"),
        (lambda: ThelenPassive(strain=-0.6), "strain is -0.6"),
        (lambda: ThelenTendon(toe_force=1.0), "toe_force is 1"),
        (lambda: ThelenForceVelocity(max_eccentric=1.0), "max_eccentric is 1"),
        (lambda: DeGrooteFreglyActive(width=float("nan")), "width is nan"),
        (lambda: DeGrooteFreglyPassive(zero_length=2.0), "zero_length is 2"),
        (lambda: DeGrooteFreglyTendon(strain=0), "strain is 0"),
        (lambda: MujocoActive(lmin=1.2), "lmin is 1.2"),
        (lambda: MujocoPassive(lmax=0.9), "lmax is 0.9"),
        (lambda: MujocoForceVelocity(fvmax=1.0), "fvmax is 1"),
        (lambda: tendon_force_length(TendonForceLength(strain_at_one_norm_force=-0.1)), "must be positive"),
        (lambda: tendon_force_length(TendonForceLength(stiffness_at_one_norm_force=10.0)), "BezierCurve"),
        (lambda: BezierCurve([Corner(0, 0, 3), Corner(1, 1, 2)], 0.5), "fit no curve"),
        (lambda: BezierCurve([Corner(0, 0, 0), Corner(1, float("nan"), 2)], 0.5), "not finite"),
        (lambda: millard2012().active.inverse(0.5), "only a curve whose corners rise"),  # type: ignore[attr-defined]
        (lambda: millard2012().force_velocity.inverse(1.5), "value 1.5"),
        (lambda: mujoco_curves().force_velocity.inverse(-0.1), "value -0.1"),
        (lambda: thelen2003().need_tendon().inverse(-0.1), "does not push"),
        (lambda: degroote_fregly2016().need_tendon().inverse(-0.2), "value -0.2"),
        (lambda: mujoco_curves().need_tendon(), "no tendon curve"),
    ],
)
def test_what_makes_no_curve_is_refused(make: Any, word: str) -> None:
    with pytest.raises(HillError, match=word):
        make()

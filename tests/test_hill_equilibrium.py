"""Hill muscles in balance and in motion: residuals, consistency between the solvers, energy, stiffness."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjhcmc.hill import (
    Curves,
    HillModel,
    MuscleParameters,
    MuscleState,
    degroote_fregly2016,
    dynamic_equilibrium,
    fiber_dynamics,
    fiber_length_along,
    fiber_velocity,
    millard2012,
    mujoco_curves,
    muscle_power,
    muscle_stiffness,
    pennation_angle,
    rigid_tendon,
    static_equilibrium,
    thelen2003,
)

COMPLIANT: dict[str, Curves] = {curves.name: curves for curves in (thelen2003(), millard2012(), degroote_fregly2016())}
ALL: dict[str, Curves] = {**COMPLIANT, "MuJoCo": mujoco_curves()}
compliant = pytest.mark.parametrize("curves", COMPLIANT.values(), ids=COMPLIANT)
all_models = pytest.mark.parametrize("curves", ALL.values(), ids=ALL)
seeds = given(seed=st.integers(0, 2**32 - 1))
few = settings(max_examples=8, deadline=None)

SOLEUS = MuscleParameters(5137.0, 0.05, 0.25, 0.4363, names="soleus")


def draw(rng: np.random.Generator, curves: Curves, damping: float | None = None) -> HillModel:
    """Eight muscles from all over: from nearly no tendon to ten fibers of it, pennation up to 60 degrees."""
    fiber = 10 ** rng.uniform(-2.3, -0.5, 8)
    slack = fiber * 10 ** rng.uniform(-2, 1, 8)
    return HillModel(
        MuscleParameters(10 ** rng.uniform(0, 4, 8), fiber, slack, rng.uniform(0, 1.05, 8), fiber_damping=damping),
        curves,
    )


def lengths(rng: np.random.Generator, model: HillModel, count: int = 60) -> np.ndarray:
    """Musculotendon lengths (count, 8) for fibers from about .65 to 1.6 optimal lengths, and tendons up to 3 %."""
    m = model.muscles
    normal = np.maximum(rng.uniform(0.65, 1.6, (count, 8)), np.sin(m.pennation_at_optimal) + 0.05)
    along = fiber_length_along(model, normal * m.optimal_fiber_length)
    return along + m.tendon_slack_length * rng.uniform(1.005, 1.03, (count, 8))


def balance(model: HillModel, state: MuscleState) -> np.ndarray:
    """Tendon force less fiber force along the tendon, relative."""
    force = model.muscles.max_isometric_force
    return (state.tendon_force - state.fiber_force_along_tendon) / (force + state.tendon_force)


@compliant
@few
@seeds
def test_static_equilibrium_balances(curves: Curves, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = draw(rng, curves)
    length = lengths(rng, model)
    state = static_equilibrium(model, rng.uniform(0, 1, length.shape), length)
    for field in fields(state):
        assert np.isfinite(getattr(state, field.name)).all()
        assert getattr(state, field.name).shape == length.shape
    assert np.abs(balance(model, state)).max() < 1e-11
    assert np.all(state.tendon_force >= 0)  # a tendon never pushes
    assert np.all(state.tendon_length >= model.muscles.tendon_slack_length * (1 - 1e-12))
    assert np.all(state.fiber_velocity == 0)
    along = fiber_length_along(model, state.fiber_length)
    np.testing.assert_allclose(along + state.tendon_length, length, rtol=1e-12)
    np.testing.assert_allclose(state.pennation, pennation_angle(model, state.fiber_length), atol=1e-7)
    stable = muscle_stiffness(model, state)
    assert np.all(stable.fiber_along_tendon + stable.tendon >= -1e-6 * stable.tendon)


@compliant
@few
@seeds
def test_moving_at_no_velocity_is_rest(curves: Curves, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = draw(rng, curves)
    length = lengths(rng, model, 10)
    a = rng.uniform(0, 1, length.shape)
    rest, moving = static_equilibrium(model, a, length), dynamic_equilibrium(model, a, length, 0.0)
    slow = dynamic_equilibrium(model, a, length, 1e-9 * model.muscles.optimal_fiber_length)
    force = model.muscles.max_isometric_force
    np.testing.assert_array_equal(moving.tendon_force, rest.tendon_force)
    np.testing.assert_allclose(slow.tendon_force / force, rest.tendon_force / force, atol=2e-6)


@compliant
@few
@seeds
def test_fiber_velocity_leads_back_to_the_motion(curves: Curves, seed: int) -> None:
    """The velocity at the fiber length of a steady motion is that motion's, whatever solver finds it."""
    rng = np.random.default_rng(seed)
    model = draw(rng, curves)
    length = lengths(rng, model, 20)
    m, a = model.muscles, rng.uniform(0.05, 1, length.shape)
    velocity = rng.uniform(0, 2, length.shape) * m.optimal_fiber_length
    state = dynamic_equilibrium(model, a, length, velocity)
    assert np.abs(balance(model, state)).max() < 1e-11
    np.testing.assert_allclose(state.fiber_velocity, velocity * state.cos_pennation, rtol=1e-12)
    again = fiber_dynamics(model, a, state.fiber_length, length, velocity)
    np.testing.assert_allclose(again.tendon_force, state.tendon_force, rtol=1e-6)
    assert np.abs(balance(model, again)).max() < 1e-11
    # Without damping, as Thelen's is, and with next to no active force, force hardly fixes velocity.
    sharp = (a * curves.active(state.fiber_length / m.optimal_fiber_length) > 0.05) | (model.fiber_damping > 0)
    difference = (again.fiber_velocity - state.fiber_velocity) / (m.optimal_fiber_length * m.max_fiber_velocity)
    np.testing.assert_allclose(difference[sharp], 0, atol=1e-6)


@compliant
@few
@seeds
def test_fiber_velocity_balances_anywhere(curves: Curves, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = draw(rng, curves, damping=0.1)
    length = lengths(rng, model)
    m = model.muscles
    longest = np.hypot(length - m.tendon_slack_length, m.fiber_width)
    fiber = np.maximum(longest - rng.uniform(0, 0.06, length.shape) * m.tendon_slack_length, m.fiber_width * 1.02)
    a = rng.uniform(0, 1, length.shape)
    state = fiber_dynamics(model, a, fiber, length)
    assert np.abs(balance(model, state)).max() < 1e-10
    np.testing.assert_array_equal(fiber_velocity(model, a, fiber, length), state.fiber_velocity)
    # Off equilibrium the fiber moves towards it: a tendon that pulls harder than the fiber at rest lengthens the fiber.
    rest = curves.passive(fiber / m.optimal_fiber_length) + a * curves.active(fiber / m.optimal_fiber_length)
    pull = state.tendon_force / state.cos_pennation / m.max_isometric_force - rest
    clear = np.abs(pull) > 1e-9
    assert np.array_equal(np.sign(state.fiber_velocity[clear]), np.sign(pull[clear]))


def test_undamped_velocity_is_the_inverse_curve() -> None:
    """The paper's Eq. 3 in closed form, for one muscle written out by hand."""
    curves = degroote_fregly2016(fiber_damping=0.0)
    model = HillModel(MuscleParameters(1000.0, 0.1, 0.2), curves)
    tendon = 0.2 * np.expm1(np.log(6) / 0.049 * 0.03)
    multiplier = (tendon - curves.passive(1.05)) / (0.6 * curves.active(1.05))
    d1, d2, d3, d4 = -0.3211346127989808, -8.149, -0.374, 0.8825327733249912
    expected = 10 * 0.1 * (np.sinh((multiplier - d4) / d1) - d3) / d2
    assert fiber_velocity(model, 0.6, 0.105, 0.105 + 0.206) == pytest.approx(expected, rel=1e-12)


@compliant
def test_a_relaxed_slack_muscle_rests_at_no_force(curves: Curves) -> None:
    model = HillModel(MuscleParameters(1000.0, 0.1, 0.2), curves)
    state = static_equilibrium(model, 0.0, 0.2 + 0.09)
    assert state.tendon_force == pytest.approx(0.0, abs=12.0)  # De Groote and Fregly's fiber always pulls a little
    assert state.fiber_length == pytest.approx(0.09, rel=5e-3)
    if curves.name != "De Groote-Fregly 2016":
        assert state.tendon_force == 0


@compliant
def test_a_stiff_tendon_is_a_rigid_one(curves: Curves) -> None:
    """With a tendon of next to no length, the compliant muscle is the rigid one."""
    model = HillModel(MuscleParameters(1000.0, 0.1, 1e-6, 0.3), curves)
    length, a = np.linspace(0.07, 0.14, 30), np.linspace(0, 1, 30)
    soft, stiff = static_equilibrium(model, a, length), rigid_tendon(model, a, length)
    np.testing.assert_allclose(soft.tendon_force, stiff.tendon_force, rtol=1e-5, atol=1e-3)


@all_models
@few
@seeds
def test_a_rigid_tendon_never_pushes(curves: Curves, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = draw(rng, curves, damping=0.1)
    length = lengths(rng, model)
    velocity = rng.uniform(-15, 15, length.shape) * model.muscles.optimal_fiber_length
    state = rigid_tendon(model, rng.uniform(0, 1, length.shape), length, velocity)
    assert np.all(state.tendon_force >= 0)
    assert state.slack.any()
    held = ~state.slack
    np.testing.assert_array_equal(state.tendon_force[held], state.fiber_force_along_tendon[held])
    along = fiber_length_along(model, state.fiber_length)
    np.testing.assert_allclose(along + model.muscles.tendon_slack_length, length, rtol=1e-12)
    # d(lM)/dt from lengths a moment apart
    later = rigid_tendon(model, 0.5, length + 1e-7 * velocity).fiber_length
    sooner = rigid_tendon(model, 0.5, length - 1e-7 * velocity).fiber_length
    speed = 10 * model.muscles.optimal_fiber_length
    np.testing.assert_allclose(state.fiber_velocity / speed, (later - sooner) / 2e-7 / speed, atol=1e-6)


@all_models
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_a_passive_cycle_gives_out_no_work(curves: Curves, damping: float) -> None:
    """Over a closed cycle without activation the springs give back what they took; damping only takes."""
    muscles = MuscleParameters(1000.0, 0.1, 0.2, 0.35, fiber_damping=damping)
    phase = np.arange(4000) / 4000 * 2 * np.pi
    length = 0.2 + 0.12 + 0.03 * np.sin(phase)
    velocity = 0.03 * np.cos(phase)  # a cycle of 2 pi s
    state = rigid_tendon(HillModel(muscles, curves), 0.0, length, velocity)
    power = muscle_power(state)
    step = 2 * np.pi / 4000
    assert np.abs(power.passive).max() > 1e-3
    assert np.sum(power.passive) * step == pytest.approx(0.0, abs=1e-9)
    assert np.all(power.damping <= 0)
    assert (np.sum(power.damping) * step < -1e-3) == (damping > 0)
    if not state.slack.any():
        np.testing.assert_allclose(power.musculotendon, power.active + power.passive + power.damping, atol=1e-9)


@compliant
def test_a_simulated_passive_cycle_gives_out_no_work(curves: Curves) -> None:
    """The same with fiber and tendon in series: the fiber's own equation of motion, by RK4 from rest to rest."""
    model = HillModel(MuscleParameters(1000.0, 0.1, 0.2, 0.35, fiber_damping=0.1), curves)
    period, steps = 0.2, 160
    h = period / steps

    def musculotendon(t: float) -> tuple[float, float]:
        phase = 2 * np.pi * t / period
        return 0.335 + 0.01 * np.cos(phase), -0.01 * 2 * np.pi / period * np.sin(phase)

    def rate(t: float, fiber: float) -> float:
        return float(fiber_velocity(model, 0.0, fiber, musculotendon(t)[0]))

    fiber = float(static_equilibrium(model, 0.0, musculotendon(0.0)[0]).fiber_length)
    start, work = None, 0.0
    for k in range(2 * steps):  # the first cycle settles
        t = k * h
        if k >= steps:
            start = fiber if start is None else start
            length, velocity = musculotendon(t)
            state = fiber_dynamics(model, 0.0, fiber, length, velocity)
            power = muscle_power(state)
            parts = power.active + power.passive + power.damping + power.tendon
            assert power.musculotendon == pytest.approx(parts, abs=1e-8)
            work += float(power.musculotendon) * h
        k1 = rate(t, fiber)
        k2 = rate(t + h / 2, fiber + h / 2 * k1)
        k3 = rate(t + h / 2, fiber + h / 2 * k2)
        k4 = rate(t + h, fiber + h * k3)
        fiber += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    assert fiber == pytest.approx(start, abs=1e-7)  # closed
    assert work < -1e-4  # and only damping's share is lost


@compliant
def test_stiffness_is_the_slope_of_force(curves: Curves) -> None:
    model, h = HillModel(SOLEUS, curves), 1e-6
    length, a = np.linspace(0.285, 0.32, 12), np.linspace(0.1, 1, 12)
    state = static_equilibrium(model, a, length)
    stiffness = muscle_stiffness(model, state)
    after, before = static_equilibrium(model, a, length + h), static_equilibrium(model, a, length - h)
    slope = (after.tendon_force - before.tendon_force) / (2 * h)
    np.testing.assert_allclose(stiffness.musculotendon, slope, rtol=1e-4, atol=1.0)
    solid = muscle_stiffness(model, rigid_tendon(model, a, length), rigid=True)
    slope = (rigid_tendon(model, a, length + h).tendon_force - rigid_tendon(model, a, length - h).tendon_force) / (
        2 * h
    )
    np.testing.assert_allclose(solid.musculotendon, slope, rtol=1e-4, atol=1.0)
    assert np.all(np.isinf(solid.tendon))


def test_shapes_and_mixed_inputs() -> None:
    muscles = MuscleParameters([1000.0, 500.0, 800.0], 0.1, 0.2)
    model = HillModel(muscles, thelen2003())
    assert static_equilibrium(model, 0.5, 0.3).shape == (3,)
    assert static_equilibrium(model, np.full((7, 1), 0.5), np.full((2, 7, 3), 0.3)).shape == (2, 7, 3)
    single = HillModel(MuscleParameters(1000.0, 0.1, 0.2), thelen2003())
    assert static_equilibrium(single, 0.5, 0.3).shape == ()
    assert static_equilibrium(single, 0.5, np.full((4, 5), 0.3)).shape == (4, 5)
    assert static_equilibrium(model, np.ones((0, 3)), 0.3).shape == (0, 3)
    part = static_equilibrium(model, np.linspace(0, 1, 5)[:, None], 0.3)[2]
    np.testing.assert_array_equal(part.tendon_force, static_equilibrium(model, 0.5, 0.3).tendon_force)

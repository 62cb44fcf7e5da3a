"""Laws of the stretch reflex, where the answers are known in closed form; and the fiber velocity they answer to."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_hosted_muscles import MILLARD, draw, fibers, rows, stretched

from mjhcmc import hill
from mjhcmc.errors import SettingsError
from mjhcmc.hosted.fiber_speed import fiber_lengths, fiber_speeds
from mjhcmc.hosted.muscle import COMPLIANT, RIGID
from mjhcmc.patients.reflex import MODES, ReflexArc, ReflexLaw, delayed, reflex_along

PERIOD = 0.01
TIME = np.arange(100) * PERIOD
DELAYS = [0.0, 0.004, 0.01, 0.07, 0.0333, 0.0999]  # within a period, whole periods (.07/.01 is over 7), and between

with_delays = pytest.mark.parametrize("delay", DELAYS)


def one(mode, gain, threshold, delay=0.0, period=PERIOD, **more):
    """The law of one muscle."""
    return ReflexLaw(mode, np.array([[gain]]), np.array([[threshold]]), np.array([delay]), period, **more)


def along(law, samples, time=TIME):
    """Its answer to velocity (n_time,), or with "force" to force."""
    samples = np.broadcast_to(samples, time.shape)[:, None]
    force = samples if law.mode == "force" else None
    return reflex_along(law, time, samples, force)[:, 0]


def drawn(mode, rng, b=6, n=3):
    """A law with some delays of whole periods, and velocities and forces (b, n_time, n)."""
    law = ReflexLaw(
        mode, rng.uniform(0, 2, (b, n)), rng.uniform(0.1, 0.6, (b, n)), rng.choice(DELAYS, b), PERIOD, steepness=20.0
    )  # fmt: skip
    return law, rng.normal(size=(b, len(TIME), n)), rng.uniform(0, 1, (b, len(TIME), n))


# --- velocity -----------------------------------------------------------------------------------------------------


@with_delays
def test_constant_velocity(delay):
    """Nothing until the delay is over, then the gain times what is above the threshold."""
    found = along(one("velocity", 0.4, 0.5, delay), 2.0)
    reached = delay - 1e-9 < TIME
    reached[0] &= delay == 0
    assert found[reached] == pytest.approx(0.4 * 1.5)
    np.testing.assert_array_equal(found[~reached], 0.0)


@with_delays
def test_a_ramp_of_velocity_is_a_ramp_later(delay):
    """Linear interpolation makes no error on a ramp, at any delay."""
    law, slope = one("velocity", 0.5, 0.2, delay), 2.0
    wanted = np.where(delay - 1e-9 <= TIME, 0.5 * np.maximum(slope * (TIME - delay) - 0.2, 0.0), 0.0)
    np.testing.assert_allclose(along(law, slope * TIME), wanted, atol=1e-12)


@pytest.mark.parametrize(("delay", "periods"), [(0.03, 3.0), (0.0333, 3.33), (0.004, 0.4)])
def test_a_step_of_velocity_arrives_after_the_delay(delay, periods):
    """Of a step between two samples, the sample in between has the share that interpolation gives."""
    found = along(one("velocity", 0.5, 0.0, delay), np.where(np.arange(100) >= 20, 1.0, 0.0))
    wanted = 0.5 * np.clip(np.arange(100) - 19 - periods, 0.0, 1.0)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_velocity_is_clipped_and_shortening_is_no_stretch():
    found = along(one("velocity", 3.0, 0.1), np.sin(40 * TIME))
    assert found.max() == 1.0
    np.testing.assert_array_equal(found[np.sin(40 * TIME) <= 0.1], 0.0)
    np.testing.assert_array_equal(along(one("velocity", 3.0, 0.1), np.full(100, -5.0)), 0.0)


# --- Equation 1 ---------------------------------------------------------------------------------------------------


def test_equation1_integrates():
    """u = G integral of v while v > V; the delay is not looked at."""
    law = one("equation1", 0.3, 0.5, 0.07)
    np.testing.assert_allclose(along(law, 2.0), 0.3 * 2.0 * TIME, rtol=1e-12)
    velocity = np.where(TIME < 0.2, 0.4, np.where(TIME < 0.5, 1.0, -3.0))
    wanted = 0.3 * np.clip(TIME - 0.2, 0.0, 0.3)
    np.testing.assert_allclose(along(law, velocity), wanted, atol=1e-12)


def test_equation1_is_strictly_above_the_threshold():
    np.testing.assert_array_equal(along(one("equation1", 1.0, 0.5), 0.5), 0.0)


@given(seed=st.integers(0, 2**32 - 1), gain=st.floats(0.1, 50))
@settings(max_examples=20, deadline=None)
def test_equation1_never_decays_and_stays_within_one(seed, gain):
    velocity = np.random.default_rng(seed).normal(size=100)
    found = along(one("equation1", gain, 0.2), velocity)
    assert (np.diff(found) >= 0).all()
    grown = np.concatenate([[0.0], np.cumsum(np.where(velocity > 0.2, gain * velocity * PERIOD, 0.0))])[:-1]
    np.testing.assert_allclose(found, np.minimum(grown, 1.0), rtol=1e-12)


def test_equation1_below_a_negative_threshold_returns_and_stops_at_zero():
    velocity = np.where(TIME < 0.5, 1.0, -1.0)
    found = along(one("equation1", 4.0, -2.0), velocity)
    wanted = np.maximum(np.minimum(4 * TIME, 1.0) - 4 * np.maximum(TIME - 0.5, 0.0), 0.0)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


# --- force --------------------------------------------------------------------------------------------------------


@with_delays
def test_a_step_of_force(delay):
    """A first-order rise with tau, from when the step arrives: exact at the samples of whole periods' delay."""
    force, at = np.where(np.arange(100) >= 20, 0.5, 0.1), 20 * PERIOD
    law = one("force", 1.2, 0.3, delay, tau=0.05, steepness=10.0)

    def drive(F):
        return 1.2 * F * (0.5 + 0.5 * np.tanh(10.0 * (F - 0.3)))

    found, low, high = along(law, force), drive(0.1), drive(0.5)
    np.testing.assert_allclose(found[at + delay + 1e-9 >= TIME], low, rtol=1e-12)
    if abs(delay / PERIOD - round(delay / PERIOD)) < 1e-9:
        late = np.maximum(TIME - at - delay, 0.0)
        np.testing.assert_allclose(found, high + (low - high) * np.exp(-late / 0.05), rtol=1e-12)
    else:  # one sample is in between: the same rise follows it
        after = at + delay <= TIME
        rise = np.log(np.abs(found[after][1:] - high))
        np.testing.assert_allclose(np.diff(rise)[:20], -PERIOD / 0.05, rtol=1e-8)


def test_force_is_clipped_outside_the_filter():
    """The excitation stays at 1 while the filter is beyond it, and is late to come back."""
    force = np.where((np.arange(100) >= 10) & (np.arange(100) < 60), 1.0, 0.0)
    found = along(one("force", 3.0, 0.2), force)
    filter_ = 3.0 * (1 - np.exp(-0.5 / 0.03)) * np.exp(-np.maximum(TIME - 0.6, 0.0) / 0.03)
    np.testing.assert_allclose(found[60:], np.minimum(filter_[60:], 1.0), rtol=1e-9)
    assert (found[30:60] == 1.0).all()


# --- the arc ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", MODES)
def test_an_answer_depends_on_its_own_simulation_alone(mode):
    """In any company and order, and left out at any time: bit for bit what it is alone."""
    rng = np.random.default_rng(1)
    law, velocity, force = drawn(mode, rng)
    b = law.count
    alone = [
        reflex_along(
            ReflexLaw(mode, law.gain[[i]], law.threshold[[i]], law.delay[[i]], PERIOD, steepness=20.0),
            TIME, velocity[i], force[i],
        )
        for i in range(b)
    ]  # fmt: skip
    np.testing.assert_array_equal(reflex_along(law, TIME, velocity, force), alone)
    assert np.ptp(alone) > 0.1
    arc, seen, found = ReflexArc(law), np.zeros(b, int), [[] for _ in range(b)]
    while (seen < len(TIME)).any():
        ids = rng.permutation(np.flatnonzero((seen < len(TIME)) & (rng.random(b) < 0.6)))
        answer = arc.step(ids, velocity[ids, seen[ids]], force[ids, seen[ids]])
        for i, values in zip(ids, answer, strict=True):
            found[i].append(values)
        seen[ids] += 1
    np.testing.assert_array_equal(found, alone)


@pytest.mark.parametrize("mode", MODES)
def test_nothing_is_seen_ahead(mode):
    """What comes later changes nothing, and what is sampled changes nothing before its delay."""
    law, velocity, force = drawn(mode, np.random.default_rng(2))
    before = reflex_along(law, TIME, velocity, force)
    velocity[:, 50:], force[:, 50:] = 3.0, 1.0
    after = reflex_along(law, TIME, velocity, force)
    for i, delay in enumerate(law.delay):
        last = 50 + (0 if mode == "equation1" else int(delay / PERIOD + 1e-9))
        np.testing.assert_array_equal(after[i, :last], before[i, :last])
        assert (after[i, last:] != before[i, last:]).any()


@pytest.mark.parametrize("mode", MODES)
def test_a_lost_simulation_does_not_look_alive(mode):
    law, velocity, force = drawn(mode, np.random.default_rng(3))
    fine = reflex_along(law, TIME, velocity, force)
    velocity[2, 40], force[2, 40] = np.nan, np.nan
    found = reflex_along(law, TIME, velocity, force)
    assert np.isnan(found[2]).any()
    others = np.arange(law.count) != 2
    np.testing.assert_array_equal(found[others], fine[others])


@with_delays
def test_delayed_samples(delay):
    samples = np.random.default_rng(4).normal(size=(100, 2))
    found = delayed(samples, delay, PERIOD)
    for i in range(2):
        wanted = np.interp(TIME - delay, TIME, samples[:, i])
        wanted[delay - 1e-9 > TIME] = 0.0
        np.testing.assert_allclose(found[:, i], wanted, atol=1e-9)


# --- bad input ----------------------------------------------------------------------------------------------------

GOOD = {
    "mode": "velocity", "gain": np.ones((2, 3)), "threshold": np.zeros((2, 3)), "delay": np.zeros(2), "period": 0.01
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"mode": "speed"}, r"reflex 'speed' is not known: choose one of velocity, equation1, force"),
        ({"gain": np.array([[1, 1, 1], [1, -0.5, 1]])}, r"gain -0.5 of simulation 1, muscle 1: give 0 or more"),
        ({"gain": np.ones(3)}, r"reflex gain has the shape \(3,\)"),
        ({"gain": [["a"]]}, r"reflex gain: give an array of numbers"),
        ({"gain": np.full((2, 3), np.nan)}, r"reflex gain is nan at \(0, 0\)"),
        ({"threshold": np.full((2, 3), np.inf)}, r"reflex threshold is inf"),
        ({"threshold": np.zeros((3, 2))}, r"threshold \(3, 2\) and delay \(2,\) must have"),
        ({"delay": np.zeros(3)}, r"delay \(3,\) must have"),
        ({"delay": np.array([0.03, -0.03])}, r"delay -0.03 s of simulation 1: give seconds, from 0"),
        ({"delay": np.array([35.0, 0])}, r"delay 35 s of simulation 0: give seconds, from 0 to 1"),
        ({"period": 0.0}, r"reflex period 0.0: give a positive number"),
        ({"period": np.nan}, r"reflex period nan"),
        ({"tau": -0.03}, r"reflex tau -0.03"),
        ({"steepness": True}, r"reflex steepness True"),
    ],
)
def test_a_law_that_is_none(change, told):
    with pytest.raises(SettingsError, match=told):
        ReflexLaw(**{**GOOD, **change})


def test_steps_that_do_not_fit():
    arc = ReflexArc(ReflexLaw(**GOOD))
    for ids in ([0, 0], [2], [-1]):
        with pytest.raises(SettingsError, match=r"ids are of 0 to 1, none twice"):
            arc.step(ids, np.zeros((len(ids), 3)))
    with pytest.raises(SettingsError, match=r"ids are integers"):
        arc.step([0.5], np.zeros((1, 3)))
    with pytest.raises(SettingsError, match=r"velocity has the shape \(2, 2\): give \(2, 3\)"):
        arc.step([0, 1], np.zeros((2, 2)))
    with pytest.raises(SettingsError, match=r"give force"):
        ReflexArc(ReflexLaw(**{**GOOD, "mode": "force"})).step([0], np.zeros((1, 3)))
    assert arc.step([], np.zeros((0, 3))).shape == (0, 3)


def test_times_that_are_not_a_period_apart():
    with pytest.raises(SettingsError, match=r"from 0.02 s the next time is 0.02 s away: give times 0.01 s apart"):
        reflex_along(one("velocity", 1, 0), [0, 0.01, 0.02, 0.04], np.zeros((4, 1)))


# --- what muscles tell --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [RIGID, COMPLIANT], ids=["rigid", "compliant"])
def test_fiber_speed_is_the_muscles(kind):
    """Against the NumPy reference, for muscles that differ between simulations."""
    rng = np.random.default_rng(5)
    models = [draw(rng, MILLARD, damping=0.1) for _ in range(3)]
    packed = [rows(model, ("rigid", "compliant")[kind]) for model in models]
    curves, p = packed[0][0], np.stack([parameters for _, parameters in packed])
    fiber = np.concatenate([fibers(rng, model, 1) for model in models])
    length = np.stack([stretched(rng, model, one, 1.0, 1.04) for model, one in zip(models, fiber, strict=True)])
    a, V = rng.uniform(0.01, 1, fiber.shape), rng.normal(size=fiber.shape) * 0.1
    speeds, lengths = fiber_speeds(kind, curves, p, a, fiber, length, V), fiber_lengths(kind, p, fiber, length)
    for i, model in enumerate(models):
        state = (
            hill.rigid_tendon(model, a[i], length[i], V[i])
            if kind == RIGID
            else hill.fiber_dynamics(model, a[i], fiber[i], length[i], V[i])
        )
        lopt = model.muscles.optimal_fiber_length
        np.testing.assert_allclose(speeds[i], state.fiber_velocity / lopt, rtol=1e-10, atol=1e-11)
        np.testing.assert_allclose(lengths[i], state.fiber_length / lopt, rtol=1e-12)


def test_no_length_left_is_no_number():
    model = hill.HillModel(hill.MuscleParameters([1000.0, 1000.0], 0.1, 0.2, 0.3), MILLARD)
    curves, p = rows(model)
    length = np.array([[0.15, 0.3]])
    none = np.zeros((1, 0))  # rigid muscles have no fiber states
    np.testing.assert_array_equal(np.isnan(fiber_lengths(RIGID, p[None], none, length)), [[True, False]])
    speeds = fiber_speeds(RIGID, curves, p[None], np.ones((1, 2)), none, length, np.ones((1, 2)))
    np.testing.assert_array_equal(np.isnan(speeds), [[True, False]])

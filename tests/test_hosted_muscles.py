"""The compiled muscles against `mjhcmc.hill`, the plain NumPy reference: the same equations to rounding."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjhcmc import hill
from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.hosted import curves as compiled
from mjhcmc.hosted.curves import compiled_curves
from mjhcmc.hosted.muscle import (
    COMPLIANT,
    advance,
    compliant_force,
    fiber_velocity,
    gain_and_bias,
    rigid_fiber,
    rigid_force,
)
from mjhcmc.hosted.muscles import HostedMuscles

EXACT = 1e-12

THELEN, MILLARD, DGF = hill.thelen2003(), hill.millard2012(), hill.degroote_fregly2016()

PAPERS = {"thelen": THELEN, "millard": MILLARD, "dgf": DGF}

OTHER_NUMBERS = {
    "thelen-own": hill.thelen2003(
        hill.ThelenActive(0.6),
        hill.ThelenPassive(0.7, 4.0),
        hill.ThelenForceVelocity(0.3, 1.6, 0.9),
        hill.ThelenTendon(0.05, 0.4, 2.5),
    ),
    "millard-own": hill.millard2012(
        hill.ActiveForceLength(0.5, 0.75, 1.7, 0.7, 0.05),
        hill.PassiveForceLength(-0.1, 0.5, curviness=0.6),
        hill.ForceVelocity(0.1, 0.3, 4.0, 0.1, 0.2, 1.5, 0.5, 0.8),
        hill.TendonForceLength(0.06, 25.0, 0.5, 0.4),
    ),
    "dgf-own": hill.degroote_fregly2016(
        hill.DeGrooteFreglyActive(1.3), hill.DeGrooteFreglyPassive(0.7, 3.5, 0.1), None,
        hill.DeGrooteFreglyTendon(0.06, 0.3),
    ),
}  # fmt: skip

MIXTURES = {
    "all-families": hill.Curves(
        "mixture", MILLARD.active, DGF.passive, THELEN.force_velocity, hill.DeGrooteFreglyTendon(0.055), 0.4441, 0.05
    ),
    "others": hill.Curves(
        "mixture", DGF.active, hill.MujocoPassive(1.7, 0.9), MILLARD.force_velocity, THELEN.tendon, 0.2, 0.1
    ),
    "mujoco-with-tendon": hill.Curves(
        "mixture", hill.MujocoActive(0.4, 1.7), THELEN.passive, hill.MujocoForceVelocity(1.4), MILLARD.tendon, 0.4, 0.1
    ),
}

TENDONED = {**PAPERS, **OTHER_NUMBERS, **MIXTURES}
RIGID_ONLY = {"mujoco": hill.mujoco_curves(), "mujoco-own": hill.mujoco_curves(0.35, 1.8, 0.7, 1.45)}
ALL = {**TENDONED, **RIGID_ONLY}

with_tendon = pytest.mark.parametrize("curves", TENDONED.values(), ids=TENDONED)
any_curves = pytest.mark.parametrize("curves", ALL.values(), ids=ALL)
seeds = given(seed=st.integers(0, 2**32 - 1))
few = settings(max_examples=5, deadline=None)


def draw(rng, curves, damping=None, count=8, least_tendon=-1.5):
    """Muscles from all over: from nearly no tendon to five fibers of it, pennation up to 50 degrees."""
    fiber = 10 ** rng.uniform(-2, -0.5, count)
    slack = fiber * 10 ** rng.uniform(least_tendon, 0.7, count)
    muscles = hill.MuscleParameters(
        10 ** rng.uniform(1, 4, count), fiber, slack, rng.uniform(0, 0.85, count), rng.uniform(5, 15, count),
        fiber_damping=damping,
    )  # fmt: skip
    return hill.HillModel(muscles, curves)


def rows(model, tendon="rigid"):
    """The muscles packed for compiled code."""
    hosts = HostedMuscles(model, tendon)
    return hosts.curves, hosts.parameters


def each(function, c, p, *values):
    """A compiled scalar function over samples (k, n) of n muscles."""
    values = np.broadcast_arrays(*values)
    return np.array(
        [[function(c, p[i], *(v[k, i] for v in values)) for i in range(len(p))] for k in range(len(values[0]))]
    )


def fibers(rng, model, count):
    """Fiber lengths (count, n) m, .6 to 1.6 optimal lengths, but over each fiber's width."""
    m = model.muscles
    normal = np.maximum(rng.uniform(0.6, 1.6, (count, *m.shape)), np.sin(m.pennation_at_optimal) + 0.05)
    return normal * m.optimal_fiber_length


def stretched(rng, model, fiber, low=0.995, high=1.04):
    """Musculotendon lengths of fibers on tendons of that many slack lengths."""
    m = model.muscles
    return hill.fiber_length_along(model, fiber) + m.tendon_slack_length * rng.uniform(low, high, fiber.shape)


# --- curves -------------------------------------------------------------------------------------------------------


@any_curves
@pytest.mark.parametrize("which", ["active", "passive", "tendon"])
def test_length_curves_are_the_models(curves, which):
    """Far beyond both ends, through every joint, and at 1 itself; no tendon curve gives no number."""
    curve = getattr(curves, which) or (lambda length: np.full_like(length, np.nan))
    x = np.concatenate([np.linspace(-0.5, 3.0, 701), [1.0, np.nextafter(1, 0), np.nextafter(1, 2)]])
    if which == "tendon":
        x = 1 + (x - 1) / 12
    c = compiled_curves(curves)
    found = np.array([getattr(compiled, which)(c, value) for value in x])
    np.testing.assert_allclose(found, curve(x), rtol=EXACT, atol=EXACT)


@any_curves
@pytest.mark.parametrize("activation", [0.0, 0.01, 0.4, 1.0])
def test_force_velocity_is_the_models(curves, activation):
    v = np.concatenate([np.linspace(-2.5, 2.5, 401), [0.0, -1.0, 1.0]])
    c = compiled_curves(curves)
    found = np.array([compiled.force_velocity(c, value, activation) for value in v])
    value, slope = curves.force_velocity.evaluate(v, activation)
    np.testing.assert_allclose(found[:, 0], value, rtol=EXACT, atol=EXACT)
    if not isinstance(curves.force_velocity, hill.BezierForceVelocity):  # whose slope is not needed
        np.testing.assert_allclose(found[:, 1], slope, rtol=EXACT, atol=EXACT)


@any_curves
def test_nan_stays_nan(curves):
    c = compiled_curves(curves)
    for function in (compiled.active, compiled.passive, compiled.tendon):
        assert np.isnan(function(c, np.nan))
    assert np.isnan(compiled.force_velocity(c, np.nan, 0.5)[0])


@settings(max_examples=50, deadline=None)
@given(
    low=st.floats(0.2, 0.6), shoulder=st.floats(0.05, 0.2), high=st.floats(1.4, 2.2), floor=st.floats(0, 0.1),
    strain=st.floats(0.02, 0.1), toe=st.floats(0.2, 0.9), x=st.floats(-1, 4),
)  # fmt: skip
def test_bezier_curves_of_any_numbers(low, shoulder, high, floor, strain, toe, x):
    active = hill.ActiveForceLength(low, low + shoulder, high, 0.6, floor)
    curves = hill.millard2012(active, tendon=hill.TendonForceLength(strain, force_at_toe_end=toe))
    c = compiled_curves(curves)
    np.testing.assert_allclose(compiled.active(c, x), curves.active(x), rtol=EXACT, atol=EXACT)
    length = 1 + 0.1 * x
    np.testing.assert_allclose(compiled.tendon(c, length), curves.tendon(length), rtol=EXACT, atol=EXACT)


class Flat:
    """A curve that a user made."""

    def __call__(self, x):
        return np.ones_like(x)

    def derivative(self, x):
        return np.zeros_like(x)

    def evaluate(self, x):
        return self(x), self.derivative(x)


class Steeper(hill.ThelenActive):
    """A curve of the package that a user changed: not the one that is compiled."""

    def __call__(self, x):
        return super().__call__(x) ** 2


@pytest.mark.parametrize("curve", [Flat(), Steeper()], ids=["Flat", "Steeper"])
def test_a_curve_that_is_not_compiled_is_named(curve):
    mixture = hill.Curves("my mixture", curve, THELEN.passive, THELEN.force_velocity, THELEN.tendon, 0.2, 0.1)
    with pytest.raises(SettingsError, match=f"my mixture: a curve of type {type(curve).__name__} is not compiled"):
        compiled_curves(mixture)


def test_a_bezier_curve_of_too_many_segments_is_refused():
    corners = [hill.Corner(float(x), float(x), 1.0) for x in range(8)]
    many = hill.BezierCurve(corners, curviness=0.5)
    with pytest.raises(SettingsError, match=r"Bezier curve of 7 segments is not compiled: give at most 5"):
        compiled_curves(hill.Curves("many", many, THELEN.passive, THELEN.force_velocity, None, 0.2, 0.1))


# --- compliant tendons --------------------------------------------------------------------------------------------


@with_tendon
@few
@seeds
def test_fiber_velocity_of_damped_fibers(curves, seed):
    rng = np.random.default_rng(seed)
    model = draw(rng, curves, damping=10 ** rng.uniform(-2, 0))
    fiber = fibers(rng, model, 6)
    length = stretched(rng, model, fiber)
    a = rng.uniform(0, 1, fiber.shape)
    a[0], a[1] = 0.0, 1.0
    wanted = hill.fiber_velocity(model, a, fiber, length)
    found = each(fiber_velocity, *rows(model, "compliant"), a, fiber, length)
    fastest = model.muscles.max_fiber_velocity * model.muscles.optimal_fiber_length
    np.testing.assert_allclose(found / fastest, wanted / fastest, rtol=EXACT, atol=EXACT)


@with_tendon
@few
@seeds
def test_fiber_velocity_of_undamped_fibers(curves, seed):
    """Fibers whose multiplier the force-velocity curve has: made by choosing the velocity first.

    Where the curve is steep enough to tell the velocity: near its flat ends rounding in force moves it at will.
    """
    rng = np.random.default_rng(seed)
    model = draw(rng, curves, damping=0.0)
    m = model.muscles
    normal = np.maximum(rng.uniform(0.75, 1.15, (6, *m.shape)), np.sin(m.pennation_at_optimal) + 0.05)
    fiber = normal * m.optimal_fiber_length
    a = rng.uniform(0.1, 1, fiber.shape)
    v = rng.uniform(-0.8, 0.35, fiber.shape) * (0.25 + 0.75 * a)
    along = hill.fiber_length_along(model, fiber)
    force = (a * curves.active(normal) * curves.force_velocity(v, a) + curves.passive(normal)) * along / fiber
    length = along + m.tendon_slack_length * curves.tendon.inverse(force)
    found = each(fiber_velocity, *rows(model, "compliant"), a, fiber, length)
    fastest = m.max_fiber_velocity * m.optimal_fiber_length
    wanted = hill.fiber_velocity(model, a, fiber, length)
    steep = np.asarray(curves.force_velocity.derivative(v, a)) * a * curves.active(normal)
    np.testing.assert_array_less(np.abs(found - wanted) / fastest * np.minimum(steep, 1.0), EXACT)
    np.testing.assert_array_less(np.abs(found / fastest - v) * steep, 1e-10)  # what rounding of the length leaves


@pytest.mark.parametrize("curves", [MILLARD, MIXTURES["mujoco-with-tendon"]], ids=["millard", "mujoco-with-tendon"])
@pytest.mark.parametrize("target", ["pulled beyond the eccentric plateau", "pushed"])
def test_no_velocity_is_nan(curves, target):
    """Without damping, a curve with flat ends has no velocity for such a force; `mjhcmc.hill` refuses it."""
    model = hill.HillModel(hill.MuscleParameters(1000.0, 0.1, 0.2, 0.0, fiber_damping=[0.0]), curves)
    stretch = 1.2 if target.startswith("pulled") else 0.9
    fiber = 0.1 if target.startswith("pulled") else 0.13  # with passive force on a slack tendon
    length = np.array([fiber + 0.2 * stretch])
    with pytest.raises(hill.HillError, match="force-velocity curve spans"):
        hill.fiber_velocity(model, 0.5, fiber, length)
    c, p = rows(model, "compliant")
    assert np.isnan(fiber_velocity(c, p[0], 0.5, fiber, length[0]))


@with_tendon
def test_without_a_muscle_is_nan(curves):
    """No activation and no damping; a fiber at its width; one longer than the whole; no length at all."""
    model = hill.HillModel(hill.MuscleParameters(1000.0, 0.1, 0.2, 0.5, fiber_damping=[0.1]), curves)
    bare = hill.HillModel(hill.MuscleParameters(1000.0, 0.1, 0.2, 0.5, fiber_damping=[0.0]), curves)
    width = float(model.muscles.fiber_width[0])
    c, p = rows(bare, "compliant")
    for whole in (0.29, 0.25):  # on a stretched tendon, and on a slack one, where any velocity would do
        assert np.isnan(fiber_velocity(c, p[0], 0.0, 0.1, whole)), whole
    c, p = rows(model, "compliant")
    for fiber in (width, 0.5 * width, 0.0, -0.1, 0.4, np.nan):
        assert np.isnan(fiber_velocity(c, p[0], 0.5, fiber, 0.29)), fiber
    for whole in (0.0, -0.1, np.nan):
        assert np.isnan(fiber_velocity(c, p[0], 0.5, 0.1, whole)), whole
    assert np.isfinite(fiber_velocity(c, p[0], 0.5, 0.1, 0.29))
    for fiber in (0.5 * width, np.nan):
        assert np.isnan(compliant_force(c, p[0], fiber, 0.29)), fiber
    for whole in (0.2, 0.1, np.nan):
        assert np.isnan(rigid_force(c, p[0], 0.5, whole, 0.0)), whole
    assert np.isnan(rigid_force(c, p[0], 0.5, 0.29, np.nan))
    assert np.isnan(rigid_force(c, p[0], np.nan, 0.29, 0.0))


@with_tendon
@few
@seeds
def test_compliant_force_is_the_tendons(curves, seed):
    rng = np.random.default_rng(seed)
    model = draw(rng, curves, damping=0.1)
    fiber = fibers(rng, model, 10)
    length, a = stretched(rng, model, fiber), rng.uniform(0, 1, fiber.shape)
    wanted = hill.fiber_dynamics(model, a, fiber, length).tendon_force
    found = each(compliant_force, *rows(model, "compliant"), fiber, length)
    F0 = model.muscles.max_isometric_force
    np.testing.assert_allclose(found / F0, wanted / F0, rtol=EXACT, atol=EXACT)


# --- rigid tendons ------------------------------------------------------------------------------------------------


@any_curves
@few
@seeds
def test_rigid_force(curves, seed):
    """Fast and slow, either way; a tendon that would push is slack."""
    rng = np.random.default_rng(seed)
    # MuJoCo's own damping is that of the path, which MuJoCo keeps: the muscle itself has none
    model = draw(rng, curves, damping=0.0 if curves.tendon is None else rng.choice([0.0, 0.1, 1.0]))
    m = model.muscles
    fiber = fibers(rng, model, 10)
    length = hill.fiber_length_along(model, fiber) + m.tendon_slack_length
    a = rng.uniform(0, 1, fiber.shape)
    speed = rng.uniform(-1.5, 1.5, fiber.shape) * m.max_fiber_velocity * m.optimal_fiber_length
    wanted = hill.rigid_tendon(model, a, length, speed)
    c, p = rows(model)
    found = each(rigid_force, c, p, a, length, speed)
    np.testing.assert_allclose(found / m.max_isometric_force, wanted.tendon_force / m.max_isometric_force, atol=EXACT)
    assert (found >= 0).all()
    lengths = [[rigid_fiber(p[i], length[k, i]) for i in range(len(p))] for k in range(len(length))]
    np.testing.assert_allclose(lengths, wanted.fiber_length, rtol=EXACT)


@any_curves
@few
@seeds
def test_gain_and_bias_are_the_force_at_activation_1_and_0(curves, seed):
    """Of a fiber on a rigid tendon, before the tendon goes slack."""
    rng = np.random.default_rng(seed)
    model = draw(rng, curves, damping=0.0 if curves.tendon is None else 0.1)
    m = model.muscles
    fiber = fibers(rng, model, 5)
    length = hill.fiber_length_along(model, fiber) + m.tendon_slack_length
    speed = rng.uniform(-0.8, 0.8, fiber.shape) * m.max_fiber_velocity * m.optimal_fiber_length
    c, p = rows(model)
    found = each(gain_and_bias, c, p, fiber, length, speed)
    rest, full = (hill.rigid_tendon(model, a, length, speed).fiber_force_along_tendon for a in (0.0, 1.0))
    F0 = m.max_isometric_force
    np.testing.assert_allclose(found[:, :, 1] / F0, rest / F0, atol=EXACT)
    np.testing.assert_allclose(found[:, :, 0] / F0, (full - rest) / F0, atol=EXACT)


# --- steady motion ------------------------------------------------------------------------------------------------


def rising(model, state, activation):
    """Whether the balance rises over every tendon strain up to 30 %: then both must find the same equilibrium."""
    m, curves, whole = model.muscles, model.curves, state.musculotendon_length
    shortest = np.sqrt(np.maximum((curves.shortest_fiber * m.optimal_fiber_length) ** 2 - m.fiber_width**2, 0.0))
    shortest = np.maximum(shortest, whole - 1.3 * m.tendon_slack_length)
    along = shortest + (whole - m.tendon_slack_length - shortest) * np.linspace(1e-3, 1, 200)[:, None]
    fiber = np.hypot(along, m.fiber_width)
    speed = state.musculotendon_velocity * along / fiber / (m.max_fiber_velocity * m.optimal_fiber_length)
    normal = fiber / m.optimal_fiber_length
    force = activation * curves.active(normal) * curves.force_velocity(speed, activation) + curves.passive(normal)
    pull = (force + model.fiber_damping * speed) * along / fiber
    surplus = curves.tendon((whole - along) / m.tendon_slack_length) - pull
    return (np.diff(surplus, axis=0) < 0).all(axis=0)


@with_tendon
@few
@seeds
def test_steady_motion(curves, seed):
    """Force and fiber length, against the reference's Newton search; and activation back from force."""
    rng = np.random.default_rng(seed)
    model = draw(rng, curves, damping=0.1)
    m, hosts = model.muscles, HostedMuscles(model, "compliant")
    fiber = fibers(rng, model, 1)[0]
    length = stretched(rng, model, fiber[None], 1.005, 1.03)[0]
    a = rng.uniform(0.05, 1, fiber.shape)
    for factor in (0.0, 0.1):
        velocity = factor * rng.uniform(-1, 1, fiber.shape) * m.max_fiber_velocity * m.optimal_fiber_length
        wanted = [steady_state(model, i, a[i], length[i], velocity[i]) for i in range(len(a))]
        found, at = hosts.steady_force(a, length, velocity), hosts.equilibrium(a, length, velocity)
        F0 = m.max_isometric_force
        for i, state in enumerate(wanted):
            if state is None:  # it would push
                assert found[i] == 0.0
            elif rising(alone(model, i), state, a[i]).all():
                assert abs(found[i] - state.tendon_force[0]) <= 1e-11 * F0[i]
                assert abs(at[i] - state.fiber_length[0]) <= 1e-11 * m.optimal_fiber_length[i]
            else:  # another equilibrium may be found, but it is one
                balanced = hill.fiber_dynamics(alone(model, i), a[i], at[i], length[i], velocity[i])
                along = hill.fiber_length_along(alone(model, i), at[i])
                assert abs(balanced.fiber_velocity - velocity[i] * along / at[i]) < 1e-9 * m.max_fiber_velocity[i]
        back = hosts.steady_activation(found, length, velocity)
        again = hosts.steady_force(back, length, velocity)
        np.testing.assert_allclose(again / F0, found / F0, atol=1e-11)


def alone(model, i):
    m = model.muscles
    one = hill.MuscleParameters(
        m.max_isometric_force[[i]], m.optimal_fiber_length[[i]], m.tendon_slack_length[[i]],
        m.pennation_at_optimal[[i]], m.max_fiber_velocity[[i]], model.fiber_damping[[i]],
    )  # fmt: skip
    return hill.HillModel(one, model.curves)


def steady_state(model, i, a, length, velocity):
    try:
        return hill.dynamic_equilibrium(alone(model, i), a, length, velocity)
    except hill.HillError:
        return None


@with_tendon
def test_equilibrium_at_rest_is_static_equilibrium(curves):
    rng = np.random.default_rng(3)
    model = draw(rng, curves, damping=0.1)
    length = stretched(rng, model, fibers(rng, model, 1), 1.005, 1.02)[0]
    m = model.muscles
    for a in (np.full(m.shape, 0.05), rng.uniform(0.05, 0.5, m.shape)):
        wanted = hill.static_equilibrium(model, a, length)
        one = rising(model, wanted, a)
        assert one.sum() >= 4
        found = HostedMuscles(model, "compliant").equilibrium(a, length, np.zeros(m.shape))
        np.testing.assert_allclose(found[one], wanted.fiber_length[one], rtol=1e-11)


@pytest.mark.parametrize("curves", [THELEN, MILLARD], ids=["thelen", "millard"])
def test_equilibrium_of_a_slack_muscle_is_its_fiber_on_a_slack_tendon(curves):
    """Without activation and below the passive curve nothing pulls: the reference puts the tendon at slack length."""
    model = hill.HillModel(hill.MuscleParameters([1000.0], 0.1, 0.2, 0.3), curves)
    length = np.array([0.2 + 0.06])
    found = HostedMuscles(model, "compliant").equilibrium(np.zeros(1), length, np.zeros(1))
    np.testing.assert_allclose(found, hill.static_equilibrium(model, 0.0, length).fiber_length, rtol=1e-12)
    assert HostedMuscles(model, "compliant").steady_force(np.zeros(1), length, np.zeros(1)) == 0.0


def test_no_equilibrium_is_named():
    muscles = hill.MuscleParameters([1000.0, 900.0], 0.1, 0.2, names=("soleus", "gastroc"))
    hosts = HostedMuscles(hill.HillModel(muscles, MILLARD), "compliant")
    with pytest.raises(
        SimulationError, match=r"cannot be put into equilibrium at the start: gastroc.*musculotendon_length is 0\.15"
    ):
        hosts.equilibrium(np.full(2, 0.5), np.array([0.3, 0.15]), np.zeros(2))


@any_curves
def test_rigid_steady_motion_is_the_rigid_muscle(curves):
    rng = np.random.default_rng(1)
    model = draw(rng, curves, damping=0.0 if curves.tendon is None else 0.1)
    hosts, m = HostedMuscles(model, "rigid"), model.muscles
    length = hill.fiber_length_along(model, fibers(rng, model, 1)[0]) + m.tendon_slack_length
    velocity = rng.uniform(-0.1, 0.2, m.shape) * m.max_fiber_velocity * m.optimal_fiber_length
    a = rng.uniform(0.3, 1, m.shape)
    wanted = hill.rigid_tendon(model, a, length, velocity).tendon_force
    found = hosts.steady_force(a, length, velocity)
    np.testing.assert_allclose(found / m.max_isometric_force, wanted / m.max_isometric_force, atol=EXACT)
    back = hosts.steady_activation(found, length, velocity)
    again = hosts.steady_force(back, length, velocity)
    np.testing.assert_allclose(again / m.max_isometric_force, wanted / m.max_isometric_force, atol=1e-11)
    beyond = hosts.steady_activation(np.full(m.shape, 1e9), length, velocity)
    np.testing.assert_array_equal(beyond, 1.0)
    np.testing.assert_array_equal(hosts.steady_activation(np.full(m.shape, -1e9), length, velocity), 0.0)


# --- a muscle alone, over time ------------------------------------------------------------------------------------

DYNAMICS = np.array([0.01, 0.04, 0.0])


@with_tendon
def test_a_step_is_runge_kutta_on_the_reference(curves):
    """One step of the muscle alone, written out with `mjhcmc.hill`."""
    model = hill.HillModel(hill.MuscleParameters([1000.0], 0.1, 0.2, 0.4, fiber_damping=[0.1]), curves)
    c, p = rows(model, "compliant")
    h, a, u, path = 1e-3, 0.3, 0.8, np.array([0.300, 0.3006, 0.301])
    fiber = float(hill.static_equilibrium(model, a, path[:1]).fiber_length[0])

    def rate(state, length):
        da = hill.MUJOCO_ACTIVATION.rate(u, state[0])
        return np.array([da, hill.fiber_velocity(model, state[0], state[1:], length)[0]])

    x = np.array([a, fiber])
    k1 = rate(x, path[0])
    k2 = rate(x + h / 2 * k1, path[1])
    k3 = rate(x + h / 2 * k2, path[1])
    k4 = rate(x + h * k3, path[2])
    wanted = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    found = advance(c, p[0], COMPLIANT, DYNAMICS, a, fiber, u, path, h)
    np.testing.assert_allclose(found, wanted, rtol=1e-12)

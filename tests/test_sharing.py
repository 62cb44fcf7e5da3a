"""Costs in closed form, floors under activation, muscles that are switched off, and choices that do not exist."""

import dataclasses

import mujoco
import numpy as np
import pytest
import qpsolvers
from conftest import HANGING_MASS, LINEAR_ACTUATOR, MUSCLE_ACTUATOR, load_xml
from scipy.optimize import brentq

import mjhcmc
from mjhcmc.solution import WindowStatus

METHODS = [mjhcmc.hcmc, mjhcmc.cmc, mjhcmc.static_optimization]

ARM = """
<mujoco model="arm">
  <option integrator="RK4"/>
  <worldbody><body>
    <joint name="elbow" type="hinge" axis="0 -1 0" range="-120 120" limited="true"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="10" contype="0" conaffinity="0"/>
  </body></worldbody>
  <actuator>
    <muscle name="long" joint="elbow" gear="-.05" force="300" lengthrange="-.1 .02" range=".75 1.35" ctrlrange="0 1"/>
    <muscle name="short" joint="elbow" gear="-.03" force="500" lengthrange="-.06 .02" range=".8 1.4" ctrlrange="0 1"/>
  </actuator>
</mujoco>"""
ANGLE = 0.7
MOMENT = 10 * 9.81 * 0.15 * np.sin(ANGLE)  # N m, holds the forearm up
ARMS = np.array([0.05, 0.03])  # m
STRENGTH = np.array([300.0, 500.0])  # N
FIBER = np.array([0.12 / 0.6, 0.08 / 0.6])  # m, optimal length: lengthrange over range


@pytest.fixture(scope="module")
def arm():
    """Two flexors of known arms at one joint, each force-length at its own place, both with passive force."""
    return load_xml(ARM)


def held(model, angle=ANGLE, windows=1, dt=0.01):
    """The joint kept still."""
    time = dt * np.linspace(0, windows, max(4, windows + 1))
    return mjhcmc.Motion(time, np.full((len(time), 1), angle))


def beginning(motion, seconds):
    return dataclasses.replace(motion, span=(motion.start, motion.start + seconds))


def gain_and_bias(model, angle=ANGLE):
    """N, pulling positive: active force at full activation and passive force, by MuJoCo's own functions."""
    m = model.mj_model
    gain, bias = [], []
    for i in range(m.nu):
        length = m.actuator_gear[i, 0] * angle
        prm = m.actuator_lengthrange[i], m.actuator_acc0[i]
        gain.append(-mujoco.mju_muscleGain(length, 0.0, *prm, m.actuator_gainprm[i, :9]))
        bias.append(-mujoco.mju_muscleBias(length, *prm, m.actuator_biasprm[i, :9]))
    return np.array(gain), np.array(bias)


def start(model, **choices):
    """Activation and force at the first node: one allocation, at rest."""
    solution = mjhcmc.static_optimization(model, held(model), **choices)
    np.testing.assert_allclose(solution.reserve, 0, atol=1e-5)
    np.testing.assert_allclose(ARMS @ solution.muscle_force[0], MOMENT, rtol=1e-7)
    return solution.activation[0], solution.muscle_force[0]


# --- costs in closed form ----------------------------------------------------------------------------------------

WEIGHTS = [
    (None, [1, 1]),
    ({"long": 3.0}, [3, 1]),
    ([0.5, 4], [0.5, 4]),
    (np.array([2, 7]), [2, 7]),
    (5, [1, 1]),  # one number for all changes nothing
    ({}, [1, 1]),
]


@pytest.mark.parametrize(("weights", "k"), WEIGHTS)
def test_effort(arm, weights, k):
    """min sum k a^2 with B a = Q: a_i = lambda B_i/k_i."""
    gain, bias = gain_and_bias(arm)
    assert bias.min() > 5  # N: passive force does a part of the work
    B, Q = ARMS * gain, MOMENT - ARMS @ bias
    expected = B / k * Q / np.sum(B**2 / k)
    np.testing.assert_allclose(start(arm, weights=weights)[0], expected, rtol=1e-7)


@pytest.mark.parametrize(("weights", "k"), WEIGHTS)
def test_cubic(arm, weights, k):
    """min sum k a^3: a_i ~ sqrt(B_i/k_i)."""
    gain, bias = gain_and_bias(arm)
    B, Q = ARMS * gain, MOMENT - ARMS @ bias
    shape = np.sqrt(B / k)
    np.testing.assert_allclose(start(arm, cost="cubic", weights=weights)[0], shape * Q / (B @ shape), rtol=1e-6)


@pytest.mark.parametrize(("weights", "k"), WEIGHTS)
def test_volume(arm, weights, k):
    """min sum k F0 lopt a^2."""
    gain, bias = gain_and_bias(arm)
    B, Q = ARMS * gain, MOMENT - ARMS @ bias
    price = np.array(k) * STRENGTH * FIBER
    expected = B / price * Q / np.sum(B**2 / price)
    np.testing.assert_allclose(start(arm, cost="volume", weights=weights)[0], expected, rtol=1e-7)


@pytest.mark.parametrize(("weights", "k"), WEIGHTS)
def test_stress(arm, weights, k):
    """min sum k (F/F0)^2 with sum r F = M, F the whole force: F_i = lambda r_i F0_i^2/k_i, whatever is passive."""
    share = ARMS * STRENGTH**2 / k
    expected = share * MOMENT / (ARMS @ share)
    activation, force = start(arm, cost="stress", weights=weights)
    np.testing.assert_allclose(force, expected, rtol=1e-7)
    gain, bias = gain_and_bias(arm)
    np.testing.assert_allclose(activation, (expected - bias) / gain, rtol=1e-6)


@pytest.mark.parametrize(("weights", "k"), WEIGHTS)
def test_capacity(arm, weights, k):
    """min sum k (F/gain)^2 with sum r F = M: F_i = lambda r_i gain_i^2/k_i."""
    gain, bias = gain_and_bias(arm)
    share = ARMS * gain**2 / k
    expected = share * MOMENT / (ARMS @ share)
    activation, force = start(arm, cost="capacity", weights=weights)
    np.testing.assert_allclose(force, expected, rtol=1e-7)
    np.testing.assert_allclose(activation, (expected - bias) / gain, rtol=1e-6)


@pytest.mark.parametrize("cost", ["stress", "capacity"])
def test_a_muscle_without_active_force_has_a_price_of_its_own(cost):
    """Stretched past its force-length curve `short` gives nothing, whatever its activation: it stays at rest."""
    far = ARM.replace('lengthrange="-.06 .02" range=".8 1.4"', 'lengthrange="-.06 .02" range="1.7 2.3" fpmax=".01"')
    model = load_xml(far)
    assert gain_and_bias(model)[0][1] == pytest.approx(0, abs=1e-6)
    solution = mjhcmc.static_optimization(model, held(model), cost=cost)
    assert 0 < solution.activation[0, 0] <= 1
    assert solution.activation[0, 1] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("cost", ["effort", "cubic", "volume"])
@pytest.mark.parametrize("sigma", [0.1, 1.0, 50])
def test_smoothness(arm, cost, sigma):
    """min sum k [a^2 + sigma (a - b)^2], for `cubic` sum k [a^3 + 3/2 sigma (a - b)^2], b being the activation before.

    Stationary, with a multiplier: (1 + sigma) a - sigma b = mu B/k, and a^2 + sigma (a - b) = mu B/k.
    """
    before = np.array([0.62, 0.75])
    k = np.array([2.0, 1.0])
    gain, bias = gain_and_bias(arm)
    B, Q = ARMS * gain, MOMENT - ARMS @ bias
    price = k * STRENGTH * FIBER if cost == "volume" else k

    def response(mu):
        pull = mu * B / price + sigma * before
        return 2 * pull / (sigma + np.sqrt(sigma**2 + 4 * pull)) if cost == "cubic" else pull / (1 + sigma)

    expected = response(brentq(lambda mu: B @ response(mu) - Q, -(sigma * before * price / B).min(), 1e3, xtol=1e-14))
    assert np.all((expected > 0.1) & (expected < 0.95))
    long = {"dt": 0.1, "look_ahead": 0.1}  # any of this is within reach
    solution = mjhcmc.cmc(
        arm, held(arm, dt=0.1), **long, initial_activation=before, cost=cost, smoothness=sigma, weights=k
    )
    np.testing.assert_allclose(solution.activation[1], expected, rtol=1e-6)


def test_smoothness_smooths_a_whole_solve(leg8, fast, fast_solution):
    smooth = mjhcmc.hcmc(leg8, fast, smoothness=5.0)
    change, effort = zip(
        *(((np.diff(s.activation, axis=0) ** 2).sum(), (s.activation**2).sum()) for s in (fast_solution, smooth)),
        strict=True,
    )
    assert change[1] < 0.8 * change[0]
    assert effort[1] > effort[0]  # which is its price
    assert np.rad2deg(np.abs(smooth.tracking_error)).max() < 0.1


def test_a_dear_muscle_does_less_and_the_others_more(leg8, slow, slow_solution):
    dear = mjhcmc.cmc(leg8, slow, weights={"gastroc": 100.0})
    i, j = leg8.muscle_names.index("gastroc"), leg8.muscle_names.index("hamstrings")
    assert dear.activation[:, i].mean() < 0.5 * slow_solution.activation[:, i].mean()
    assert dear.activation[:, j].mean() > slow_solution.activation[:, j].mean()
    assert np.rad2deg(np.abs(dear.tracking_error)).max() < 0.2


def test_the_choices_are_recorded(leg8, slow):
    motion = beginning(slow, 0.1)
    chosen = {"cost": "volume", "smoothness": 0.5, "solver": "daqp", "disabled": ["soleus"]}
    solution = mjhcmc.cmc(leg8, motion, **chosen, weights={"vasti": 2}, min_activation={"vasti": 0.01})
    assert chosen.items() <= solution.settings.items()
    assert solution.settings["weights"] == [1, 1, 1, 1, 2, 1, 1, 1]
    assert solution.settings["min_activation"] == [0, 0, 0, 0, 0.01, 0, 0, 0]


# --- floors under activation ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_activation_stays_at_or_above_its_floor(leg8, slow, method):
    floor = {"soleus": 0.05, "vasti": 0.1}
    solution = method(leg8, slow, min_activation=floor)
    least = dict(zip(leg8.muscle_names, solution.activation.min(axis=0), strict=True))
    for name, value in floor.items():
        assert least[name] >= value - 1e-12
        assert least[name] == pytest.approx(value, abs=1e-6)  # and not more than is asked
    assert least["rect_fem"] < 1e-4
    if method is not mjhcmc.static_optimization:
        assert np.rad2deg(np.abs(solution.tracking_error)).max() < 0.2


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("given", [0.7, np.full(8, 0.7)])
def test_a_floor_out_of_reach_is_approached_as_fast_as_can_be(leg8, slow, method, given):
    start = {"initial_activation": 0.01, "physics_dt": 2e-4}  # so active, the leg is too stiff for 1 ms
    solution = method(leg8, beginning(slow, 0.1), min_activation=given, **start)
    below = solution.activation[1:] < 0.7 - 1e-12
    assert below[0].all()
    assert not below[-1].any()
    np.testing.assert_array_equal(solution.excitation[below], 1.0)
    assert np.all(np.diff(below.astype(int), axis=0) <= 0)  # once reached, it is kept


def test_a_floor_above_the_models_own_limit_is_that_limit():
    limited = MUSCLE_ACTUATOR.replace('ctrlrange="0 1"', 'ctrlrange="0 .5" ctrllimited="true"')
    model = load_xml(HANGING_MASS.format(actuator=limited))
    still = mjhcmc.Motion(np.linspace(0, 0.1, 11), np.full((11, 1), 0.1))
    solution = mjhcmc.hcmc(model, still, min_activation=0.8)
    np.testing.assert_allclose(solution.activation, 0.5, atol=1e-9)


# --- muscles that are switched off ------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_a_disabled_muscle_stays_off_and_the_others_do_its_work(leg8, slow, method):
    off = [leg8.muscle_names.index(name) for name in ("gastroc", "rect_fem")]
    solution = method(leg8, slow, disabled=["gastroc", "rect_fem"], min_activation=0.02)
    assert not solution.excitation[:, off].any()
    assert not solution.activation[:, off].any()
    others = np.delete(solution.activation, off, axis=1)
    assert others.min() >= 0.02 - 1e-12  # the floor holds for the rest
    assert np.abs(solution.muscle_force[:, off]).max() > 1  # stretched fibers still pull
    if method is not mjhcmc.static_optimization:
        assert np.rad2deg(np.abs(solution.tracking_error)).max() < 0.2
        assert (solution.status == WindowStatus.OK).all()


@pytest.mark.parametrize("method", METHODS)
def test_what_nobody_else_can_do_is_a_reserve_that_is_flagged(leg8, slow, method):
    solution = method(leg8, beginning(slow, 0.6), disabled=["tib_ant"])
    i, ankle = leg8.muscle_names.index("tib_ant"), leg8.dof_names.index("ankle")
    assert not solution.excitation[:, i].any()
    assert not solution.activation[:, i].any()
    assert np.abs(solution.reserve[:, ankle]).max() > 0.1 * solution.peak_moment[ankle]
    assert (solution.status == WindowStatus.OK).mean() < 0.9
    assert not solution.verdict.passed
    assert any(text.startswith("ankle: reserve of") for text in solution.verdict.findings)
    if method is not mjhcmc.static_optimization:
        assert WindowStatus.RESERVE in solution.status
        assert np.rad2deg(np.abs(solution.tracking_error)).max() < 0.5


@pytest.mark.parametrize("method", METHODS)
def test_a_disabled_muscle_that_starts_active_is_let_go(leg8, slow, method):
    solution = method(leg8, beginning(slow, 0.2), disabled=["soleus"], initial_activation=0.3)
    i = leg8.muscle_names.index("soleus")
    assert not solution.excitation[:, i].any()
    assert np.all(np.diff(solution.activation[:, i]) < 0)


# --- bad input ----------------------------------------------------------------------------------------------------

BAD = [
    ({"cost": "fatigue"}, r"unknown cost 'fatigue': choose one of effort, cubic, volume, stress, capacity"),
    ({"cost": None}, r"unknown cost None: choose one of effort"),
    ({"cost": ["effort"]}, r"unknown cost \['effort'\]: choose one of effort"),
    ({"solver": "simplex"}, r"unknown QP solver 'simplex'; choose newton, .*daqp"),
    ({"solver": None}, r"solver must be a name, such as 'newton'; got None"),
    ({"cost": "cubic", "solver": "daqp"}, r"'daqp' takes quadratic costs only: use solver 'newton' with cost 'cubic'"),
    (
        {"weights": {"sartorius": 2}},
        r"weights: model 'leg8' has no muscle 'sartorius': its muscles are iliopsoas, .*ant",
    ),
    ({"min_activation": {"sartorius": 0.1}}, r"min_activation: .*no muscle 'sartorius': its muscles are iliopsoas"),
    ({"disabled": ["soleus", "sartorius"]}, r"disabled: .*no muscle 'sartorius': its muscles are iliopsoas, glut_max"),
    ({"disabled": "soleus"}, r"disabled must be a list of muscle names; got 'soleus': write \['soleus'\]"),
    ({"disabled": None}, r"disabled must be a list of muscle names; got None"),
    ({"disabled": [3]}, r"no muscle 3"),
    (
        {"weights": [1, 2, 3]},
        r"weights has shape \(3,\); model 'leg8' has 8 muscles: give one number a muscle, or a map",
    ),
    ({"weights": np.ones((8, 1))}, r"weights has shape \(8, 1\)"),
    ({"weights": [1, 1, -2, 1, 1, 1, 1, 1]}, r"weights of rect_fem must be positive; got -2"),
    ({"weights": {"vasti": 0}}, r"weights of vasti must be positive; got 0"),
    ({"weights": {"vasti": np.nan}}, r"weights of vasti must be finite; got nan"),
    ({"weights": np.inf}, r"weights of iliopsoas must be finite; got inf"),
    ({"weights": "heavy"}, r"weights must be numbers; got 'heavy'"),
    ({"weights": {"vasti": "heavy"}}, r"weights of vasti must be a number; got 'heavy'"),
    ({"weights": {"vasti": 1e12}}, r"weights .*span a factor of 1e\+12, at most 1e\+06: name muscles .* in disabled"),
    ({"min_activation": -0.1}, r"min_activation of iliopsoas must be at least 0 and below 1; got -0.1"),
    ({"min_activation": {"soleus": 1.0}}, r"min_activation of soleus must be at least 0 and below 1; got 1"),
    ({"min_activation": [0.1, 0.2]}, r"min_activation has shape \(2,\)"),
    ({"min_activation": np.nan}, r"min_activation of iliopsoas must be finite"),
    ({"smoothness": -1}, r"smoothness must be 0 or positive; got -1"),
    ({"smoothness": np.nan}, r"smoothness must be 0 or positive; got nan"),
    ({"smoothness": "much"}, r"smoothness must be 0 or positive; got 'much'"),
]


@pytest.mark.parametrize(("choice", "message"), BAD)
def test_bad_choices_are_named_before_the_work_begins(leg8, slow, choice, message):
    for method in METHODS:
        with pytest.raises(mjhcmc.SettingsError, match=message) as caught:
            method(leg8, slow, **choice, progress=pytest.fail)
        assert "\n" not in str(caught.value)


def test_all_muscles_cannot_be_disabled(leg8, slow):
    with pytest.raises(mjhcmc.SettingsError, match="disabled names every muscle: leave at least one"):
        mjhcmc.hcmc(leg8, slow, disabled=leg8.muscle_names)


def test_a_muscle_that_its_model_keeps_on_cannot_be_disabled():
    awake = ARM.replace('range=".8 1.4" ctrlrange="0 1"', 'range=".8 1.4" ctrlrange=".02 1" ctrllimited="true"')
    model = load_xml(awake)
    with pytest.raises(mjhcmc.SettingsError, match=r"ctrlrange keeps short from being switched off: set its lower end"):
        mjhcmc.hcmc(model, held(model), disabled=["short"])
    assert mjhcmc.hcmc(model, held(model), disabled=["long"]).activation[0, 1] >= 0.02


def test_a_solver_that_is_not_installed_tells_how_to_install_it(leg8, slow):
    absent = [name for name in ("scs", "highs", "cvxopt", "ecos") if name not in qpsolvers.available_solvers]
    if not absent:
        pytest.skip("all of qpsolvers' solvers are installed")
    message = rf"'{absent[0]}' is not installed: pip install \"qpsolvers\[{absent[0]}\]\"; or choose newton, .*daqp"
    with pytest.raises(mjhcmc.SettingsError, match=message):
        mjhcmc.hcmc(leg8, slow, solver=absent[0])


def test_a_cost_that_the_muscles_have_no_measure_for(linear_mass):
    """A fixed gain has a strength but no fiber; an affine one neither."""
    affine = LINEAR_ACTUATOR.replace('gaintype="fixed" gainprm="-100"', 'gaintype="affine" gainprm="-80 -20 0"')
    model = load_xml(HANGING_MASS.format(actuator=affine))
    for given, cost, measure in (
        (linear_mass, "volume", "optimal fiber length"),
        (model, "volume", "max isometric force"),
        (model, "stress", "max isometric force"),
    ):
        motion = held(given, angle=0.1)
        for method in METHODS:
            with pytest.raises(
                mjhcmc.SettingsError, match=rf"'{cost}': muscle pull has no {measure}.*choose cost 'eff"
            ):
                method(given, motion, cost=cost, progress=pytest.fail)
    force = mjhcmc.hcmc(linear_mass, held(linear_mass, angle=0.1), cost="stress").muscle_force
    np.testing.assert_allclose(force, 2 * 9.81, rtol=1e-6)  # one muscle has nothing to share


def test_numbers_of_numpy_are_numbers(leg8, slow):
    motion = beginning(slow, 0.1)
    plain = mjhcmc.hcmc(leg8, motion, smoothness=1.0, gain=2.5)
    same = mjhcmc.hcmc(leg8, motion, smoothness=np.int64(1), gain=np.float32(2.5), dt=np.float64(0.01))
    np.testing.assert_array_equal(plain.excitation, same.excitation)

"""EMG-informed solutions: what the cost is, what it becomes without weight and with much, in every method and batch."""

import dataclasses
import json

import numpy as np
import pytest
from conftest import load_xml
from hypothesis import given, settings
from hypothesis import strategies as st

import mjhcmc
from mjhcmc import Emg, EmgTargets
from mjhcmc.activation import activation_after
from mjhcmc.emg_targets import together
from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError
from mjhcmc.sharing import share

METHODS = [mjhcmc.hcmc, mjhcmc.cmc, mjhcmc.static_optimization]

ARM = """
<mujoco model="arm">
  <option integrator="RK4"/>
  <worldbody><body>
    <joint name="elbow" type="hinge" axis="0 -1 0" range="-120 120" limited="true"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="10" contype="0" conaffinity="0"/>
  </body></worldbody>
  <actuator>
    <general name="long" joint="elbow" gear="-.05" dyntype="muscle" dynprm=".01 .04" gaintype="fixed"
             gainprm="-1500" biastype="none" ctrlrange="0 1" ctrllimited="true"/>
    <general name="short" joint="elbow" gear="-.03" dyntype="muscle" dynprm=".01 .04" gaintype="fixed"
             gainprm="-2000" biastype="none" ctrlrange="0 1" ctrllimited="true"/>
  </actuator>
</mujoco>"""
ANGLE = 0.7
MOMENT = 10 * 9.81 * 0.15 * np.sin(ANGLE)  # N m, holds the forearm up
B = np.array([0.05 * 1500, 0.03 * 2000])  # N m at full activation


@pytest.fixture(scope="module")
def arm():
    return load_xml(ARM)


def held(model):
    return mjhcmc.Motion(np.linspace(0, 0.2, 21), np.full((21, 1), ANGLE))


def constant(**levels):
    """Envelopes that do not change, long before and after any motion here."""
    values = np.tile(list(levels.values()), (40, 1))
    return Emg(np.linspace(-2, 4, 40), values, tuple(levels), raw=False)


def as_emg(solution):
    """A solution's excitations as measured: steps, after a long rest at the first activation."""
    time = np.sort(np.concatenate([solution.time[:-1], solution.time[1:] - 1e-9]))
    time[-1] = solution.time[-1]
    values = np.repeat(solution.excitation, 2, axis=0)
    before = np.tile(solution.activation[0], (2, 1))
    time = np.concatenate([solution.time[0] + [-1.0, -1e-9], time])
    return Emg(time, np.concatenate([before, values]), solution.muscle_names, raw=False)


def largest_error(solution):
    return np.rad2deg(np.abs(solution.tracking_error)).max()


# --- the cost, in closed form -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("weight", [0.3, 1.0, 25.0])
@pytest.mark.parametrize("k", [(1.0, 1.0), (3.0, 0.5)])
def test_what_is_least(arm, method, weight, k):
    """min sum k [a^2 + w (a - e)^2] with B a = Q: a = (w e + lambda B/k)/(1 + w)."""
    e = np.array([0.05, 0.18])
    share_of = B / np.array(k)
    price = (MOMENT * (1 + weight) - weight * B @ e) / (B @ share_of)
    expected = (weight * e + price * share_of) / (1 + weight)
    assert np.all((expected > 0.01) & (expected < 0.9))
    targets = EmgTargets(constant(long=e[0], short=e[1]), weight=weight)
    solution = method(arm, held(arm), emg=targets, weights=k)
    np.testing.assert_allclose(solution.activation, np.tile(expected, (21, 1)), rtol=1e-5)


def test_one_muscle_measured_and_the_other_not(arm):
    """The unmeasured one takes what is left: a_2 = lambda B_2, a_1 = (w e + lambda B_1)/(1 + w)."""
    e, w = 0.02, 4.0
    price = (MOMENT - B[0] * w * e / (1 + w)) / (B[0] ** 2 / (1 + w) + B[1] ** 2)
    expected = [(w * e + price * B[0]) / (1 + w), price * B[1]]
    found = mjhcmc.static_optimization(arm, held(arm), emg=EmgTargets(constant(long=e), weight=w))
    np.testing.assert_allclose(found.activation[0], expected, rtol=1e-6)


@given(
    cost=st.sampled_from(["effort", "cubic", "volume", "stress", "capacity"]),
    e=st.lists(st.floats(0.05, 1), min_size=8, max_size=8),
    weight=st.floats(1e-3, 1e3),
    smoothness=st.sampled_from([0.0, 2.0]),
)
@settings(max_examples=40, deadline=None)
def test_every_cost_gets_the_same_term(leg8, cost, e, weight, smoothness):
    """What `weigh` gives with EMG less what it gives without is k w (a - e)^2/2, up to a constant."""
    targets = EmgTargets(constant(**dict(zip(leg8.muscle_names, e, strict=True))), weight=weight)
    rng = np.random.default_rng(1)
    gain, bias = rng.uniform(100, 1000, 8), rng.uniform(0, 50, 8)
    before = rng.random(8)
    with_emg = share(leg8, cost, smoothness=smoothness, emg=targets)
    plain = share(leg8, cost, smoothness=smoothness)

    def cost_of(sharing, a, time):
        w, a0, c = sharing.weigh(gain, bias, before, time)
        return w / 2 * (a - a0) ** 2 + (0 if c is None else c / 3 * a**3)

    a, b = rng.random(8), rng.random(8)
    time = rng.uniform(0, 2)
    target = with_emg.tracking.at(time)[0]
    np.testing.assert_allclose(target, e, atol=1e-12)
    difference = [cost_of(with_emg, x, time) - cost_of(plain, x, None) for x in (a, b)]
    term = [plain.weights * weight / 2 * (x - target) ** 2 for x in (a, b)]
    np.testing.assert_allclose(difference[0] - difference[1], term[0] - term[1], rtol=1e-9, atol=1e-9)


# --- its ends -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_without_weight_it_is_the_plain_solution(leg8, slow, method):
    slow = dataclasses.replace(slow, span=(0.0, 0.6))
    plain = method(leg8, slow)
    emg = constant(soleus=0.9, vasti=0.4)
    none = method(leg8, slow, emg=EmgTargets(emg, weight=0.0))
    np.testing.assert_array_equal(none.excitation, plain.excitation)
    faint = [np.abs(method(leg8, slow, emg=EmgTargets(emg, weight=w)).activation - plain.activation).max()
             for w in (1e-4, 1e-6)]  # fmt: skip
    assert faint[1] < 1e-5
    assert faint[1] < 0.02 * faint[0]  # it goes with the weight


@pytest.mark.parametrize("movement", ["slow", "fast"])
@pytest.mark.parametrize(
    ("method", "choices", "near"),
    [
        (mjhcmc.hcmc, {"tolerance": 0.0, "trials": 4}, 5e-4),
        (mjhcmc.hcmc, {}, 0.05),  # windows that end near enough are not corrected again: muscles may share otherwise
        (mjhcmc.cmc, {}, 5e-4),
    ],
)
def test_with_much_weight_it_is_what_was_measured(request, leg8, movement, method, choices, near):
    """Excitations of a solution with another cost, as fake EMG: feasible, and reproduced, the motion still followed."""
    motion = dataclasses.replace(request.getfixturevalue(movement), span=(0.0, 0.6))
    plain, other = method(leg8, motion, **choices), method(leg8, motion, cost="cubic", **choices)
    targets = EmgTargets(as_emg(other), weight=1e4)
    found = method(leg8, motion, emg=targets, initial_activation=other.activation[0], **choices)
    apart = np.abs(plain.activation - other.activation).max()
    assert apart > {"slow": 0.015, "fast": 0.2}[movement]
    assert np.abs(found.activation - other.activation).max() < near * apart
    assert np.abs(found.reserve).max() < 1e-4
    assert largest_error(found) == pytest.approx(largest_error(other), rel=0.01)


def test_the_more_weight_the_nearer(leg8, fast, fast_solution):
    other = mjhcmc.hcmc(leg8, fast, cost="cubic")
    emg, misses = as_emg(other), []
    for weight in (0.1, 1.0, 10.0, 100.0):
        found = mjhcmc.hcmc(leg8, fast, emg=EmgTargets(emg, weight=weight))
        misses.append(np.abs(found.activation[20:] - other.activation[20:]).mean())
        assert largest_error(found) < 1.2 * max(largest_error(other), largest_error(fast_solution))
    plain = np.abs(fast_solution.activation[20:] - other.activation[20:]).mean()
    assert np.all(np.diff([plain, *misses]) < 0)
    assert misses[-1] < 0.05 * plain


def test_measured_cocontraction_comes_back(leg8, slow, slow_solution):
    """Two antagonists at the ankle above what effort asks for; the motion is followed without reserves."""
    one = dataclasses.replace(slow, span=(0.0, 0.9))
    found = mjhcmc.hcmc(leg8, one, emg=EmgTargets(constant(soleus=0.2, tib_ant=0.3), weight=100.0))
    at = [leg8.muscle_names.index(name) for name in ("soleus", "tib_ant")]
    assert slow_solution.activation[:, at].mean() < 0.05
    np.testing.assert_allclose(found.activation[30:, at].mean(axis=0), [0.2, 0.3], atol=0.05)
    assert largest_error(found) < 0.1
    assert found.verdict.passed


def test_emg_that_cannot_be_does_not_spoil_the_motion(leg8, slow):
    """Nobody lifts a thigh by its extensors: the moments come first."""
    slow = dataclasses.replace(slow, span=(0.0, 0.6))
    targets = EmgTargets(constant(iliopsoas=0.0, hamstrings=0.3, soleus=0.3), weight=100.0)
    found = mjhcmc.hcmc(leg8, slow, emg=targets, physics_dt=2.5e-4)  # so tense, the leg is too stiff for 1 ms
    assert largest_error(found) < 0.05
    assert found.verdict.passed


# --- targets ----------------------------------------------------------------------------------------------------------


def test_targets_are_activation(leg8):
    """The envelope, through the muscle's own activation dynamics; independently: MuJoCo's map, window by window."""
    rng = np.random.default_rng(4)
    u = np.repeat(rng.random(40), 10)  # steps of 10 ms in samples of 1 ms
    time = 0.5e-3 + 1e-3 * np.arange(400)
    knots = np.sort(np.concatenate([time - 0.4999e-3, time + 0.4999e-3]))
    emg = Emg(knots, np.repeat(u, 2)[:, None], ("vasti",), raw=False)
    tracking = EmgTargets(emg, weight=2.0).tracking(leg8)
    i = leg8.muscle_names.index("vasti")
    prm = leg8.activation_parameters[[i]]
    a = np.array([u[0]])
    for k in range(40):
        a = activation_after(a, u[[10 * k]], prm, 1e-3, 10)
        target, weight = tracking.at(min(0.01 * (k + 1), knots[-1]))
        assert target[i] == pytest.approx(a[0], abs=1e-4)
        assert weight[i] == 2.0
        assert not np.delete(weight, i).any()


def test_delay_shifts_the_targets(leg8):
    time = np.linspace(0, 1, 501)
    emg = Emg(time, (0.5 + 0.4 * np.sin(7 * time))[:, None], ("soleus",), raw=False)
    now, late = (EmgTargets(emg, delay=delay).tracking(leg8) for delay in (0.0, 0.05))
    for t in (0.1, 0.456, 0.9):
        np.testing.assert_allclose(late.at(t + 0.05)[0], now.at(t)[0], atol=1e-12)
    assert not late.at(0.02)[1].any()  # nothing is known yet
    assert late.at(1.04)[1].any()


def test_gaps_are_not_followed(leg8, slow, slow_solution):
    time = np.linspace(-0.5, 2, 1001)
    values = np.full((1001, 1), 0.15)
    values[(time > 0.6) & (time < 1.2)] = np.nan
    targets = EmgTargets(Emg(time, values, ("soleus",), raw=False), weight=100.0)
    i = leg8.muscle_names.index("soleus")
    assert targets.tracking(leg8).at(0.9)[1][i] == 0
    found = mjhcmc.hcmc(leg8, slow, emg=targets)
    assert found.activation[20:60, i].min() > 0.12
    assert np.abs(found.activation[90:120, i] - slow_solution.activation[90:120, i]).max() < 0.01
    assert found.activation[130:, i].min() > 0.12


def test_several_simulations_together(leg8):
    one, other = (EmgTargets(constant(soleus=v), weight=w).tracking(leg8) for v, w in ((0.2, 1.0), (0.6, 3.0)))
    both = together([one, other, one])
    i = leg8.muscle_names.index("soleus")
    target, weight = both.at(np.array([0.0, 1.0, 99.0]))
    np.testing.assert_allclose(target[:, i], [0.2, 0.6, 0.0])
    np.testing.assert_allclose(weight[:, i], [1.0, 3.0, 0.0])
    np.testing.assert_allclose(both.of(1).at(0.0)[0], other.at(0.0)[0])
    np.testing.assert_allclose(both.of(np.array([2, 1])).at(np.zeros(2))[0][:, i], [0.2, 0.6])


def test_a_batch_gives_the_same_bits(leg8, slow):
    motion = dataclasses.replace(slow, span=(0.0, 0.3))
    targets = [EmgTargets(constant(soleus=v, vasti=0.3), weight=5.0) for v in (0.1, 0.4)]
    batch = mjhcmc.hcmc_batch(leg8, [motion, motion], emg=targets)
    for one, single in zip(batch, targets, strict=True):
        np.testing.assert_array_equal(one.excitation, mjhcmc.hcmc(leg8, motion, emg=single).excitation)
    same = mjhcmc.hcmc_batch(leg8, [motion, motion], emg=targets[0])
    np.testing.assert_array_equal(same[1].excitation, batch[0].excitation)


@pytest.mark.parametrize("solver", ["newton", "daqp"])
def test_other_solvers_and_floors(leg8, slow, solver):
    motion = dataclasses.replace(slow, span=(0.0, 0.3))
    targets = EmgTargets(constant(soleus=0.3, vasti=0.0), weight=50.0)
    found = mjhcmc.hcmc(leg8, motion, emg=targets, solver=solver, min_activation=0.05, disabled=["gastroc"])
    newton = mjhcmc.hcmc(leg8, motion, emg=targets, min_activation=0.05, disabled=["gastroc"])
    np.testing.assert_allclose(found.activation, newton.activation, atol=1e-4)
    assert found.activation[:, leg8.muscle_names.index("vasti")].min() >= 0.05 - 1e-9


def test_hill_muscles_follow_too(leg8, slow):
    motion = dataclasses.replace(slow, span=(0.0, 0.3))
    plant = mjhcmc.HillPlant(leg8, "millard", "rigid")
    i = leg8.muscle_names.index("soleus")
    targets = EmgTargets(constant(soleus=0.25), weight=100.0)
    found = mjhcmc.hcmc(leg8, motion, plant=plant, emg=targets)
    assert found.activation[10:, i] == pytest.approx(0.25, abs=0.05)
    assert largest_error(found) < 0.2


def test_the_record_says_so(leg8, slow, tmp_path):
    motion = dataclasses.replace(slow, span=(0.0, 0.1))
    targets = EmgTargets(constant(SOL=0.2, VL=0.1), {"vasti": "VL", "soleus": "SOL"}, {"SOL": 3.0}, delay=0.02)
    found = mjhcmc.hcmc(leg8, motion, emg=targets)
    assert found.settings["emg"] == {
        "name": "EMG", "scale": "none", "channels": {"vasti": "VL", "soleus": "SOL"}, "weight": {"SOL": 3.0},
        "delay": 0.02,
    }  # fmt: skip
    assert json.loads(json.dumps(found.settings["emg"])) == found.settings["emg"]
    found.save(tmp_path / "a.parquet")
    assert mjhcmc.Solution.load(tmp_path / "a.parquet").settings["emg"] == found.settings["emg"]
    assert mjhcmc.hcmc(leg8, motion).settings["emg"] is None


# --- bad input --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"weight": -1.0}, "EMG weight of soleus must lie within 0..100000; got -1.0"),
        ({"weight": "much"}, "EMG weight of soleus must lie within"),
        ({"weight": {"SOL": 1.0}}, "EMG weight: EMG has no channel 'SOL': its channels are soleus"),
        ({"delay": 2.0}, "delay must lie within 0..0.5 s; got 2.0"),
        ({"delay": -0.1}, "delay must lie within"),
    ],
)
def test_targets_that_make_no_sense(options, message):
    with pytest.raises(SettingsError, match=message):
        EmgTargets(constant(soleus=0.1), **options)


def test_signals_that_are_no_targets(leg8):
    noise = np.random.default_rng(0).standard_normal((4000, 1))
    raw = Emg(np.arange(4000) / 2000, noise, ("soleus",), raw=True)
    with pytest.raises(SettingsError, match="is raw: take its envelope and divide it"):
        EmgTargets(raw)
    with pytest.raises(SettingsError, match=r"rises to 40, full excitation is 1: divide by"):
        EmgTargets(constant(soleus=40.0))
    with pytest.raises(SettingsError, match="EMG targets take an Emg; got dict"):
        EmgTargets({})
    with pytest.warns(MjhcmcWarning, match=r"no envelope rises to 0.02 .*in volts still"):
        EmgTargets(constant(soleus=1e-4)).tracking(leg8)
    with pytest.warns(MjhcmcWarning, match="divided by its own peak, which hides how hard muscles worked"):
        EmgTargets(constant(soleus=0.3).normalised()).tracking(leg8)


@pytest.mark.parametrize("method", METHODS)
def test_bad_targets_are_named_before_the_work_begins(leg8, slow, method):
    def refused(error, message, emg):
        with pytest.raises(error, match=message):
            method(leg8, slow, emg=emg, progress=pytest.fail)

    refused(SettingsError, "emg must be EmgTargets; got Emg", constant(soleus=0.1))
    refused(SettingsError, "no muscle sartorius: the muscles are", EmgTargets(constant(S=0.1), {"sartorius": "S"}))
    refused(SettingsError, "no muscle is measured", EmgTargets(constant(S=0.1)))
    late = EmgTargets(constant(soleus=0.1).shifted(100))
    refused(
        MotionError,
        r"covers 98.000 .. 104.000 s .*, the motion .* 0.000 .. 1.800 s: bring it onto",
        late,
    )
    spread = EmgTargets(constant(soleus=0.1), weight=1e5)
    with pytest.raises(SettingsError, match="EMG weights times the muscles' weights span a factor of"):
        method(leg8, slow, emg=spread, weights={"soleus": 1e3}, progress=pytest.fail)


def test_emg_of_a_part_of_the_motion_is_told(leg8, slow):
    part = Emg(np.linspace(-1, 0.9, 20), np.full((20, 1), 0.2), ("soleus",), raw=False)
    with pytest.warns(MjhcmcWarning, match=r"of the motion's 0.000 .. 1.800 s: elsewhere activation follows nothing"):
        found = mjhcmc.hcmc(leg8, slow, emg=EmgTargets(part, weight=50.0))
    i = leg8.muscle_names.index("soleus")
    assert found.activation[40:90, i] == pytest.approx(0.2, abs=0.05)
    assert found.activation[130:, i].max() < 0.1

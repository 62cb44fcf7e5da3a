"""d(excitations)/d(parameters, motion) of HCMC's converged answer, against central differences of solving it again."""

import copy

import numpy as np
import pytest
from gradient_tools import AMPLITUDES, H, check, converged, difference, leg, scaled, short

import mjhcmc
from mjhcmc.gradients.gradient import TOLERANCE, TRIALS, Gradient
from mjhcmc.muscle_parameters import FORCE, FORCE_KINDS, TIME_KINDS, muscle_parameters, with_muscle_parameters
from mjhcmc.variants import variants


@pytest.fixture(scope="module")
def model():
    return leg()


@pytest.fixture(scope="module")
def fast(model):
    return mjhcmc.gradient(model, short(model))


def test_all_24_muscle_parameters_agree_with_central_differences(model, fast):
    motion = short(model)
    for name in fast.names:
        kind, muscle = name.split("/")
        numeric = difference(lambda h, kind=kind, muscle=muscle: (scaled(model, kind, muscle, 1 + h), motion))
        check(fast.relative[:, :, fast.names.index(name)], numeric, fast.margin)


def test_at_the_prompt_it_is_one_line(fast):
    assert repr(fast) == "Gradient(24 parameters, 20 windows, 8 muscles)"


def test_the_solution_is_hcmc_s_converged_answer(model, fast):
    whole = converged(model, short(model))
    # TOLERANCE is of the acceleration; excitation answers to it about as 1 to 1 where both are scaled to their peaks
    assert np.abs(fast.solution.excitation - whole.excitation).max() < 10 * TOLERANCE
    assert fast.solution.settings["trials"] == TRIALS


def test_state_activation_and_reserve_are_differentiated_too(model, fast):
    motion = short(model)
    name = "tendon_slack_length/gastroc"
    j, value = fast.names.index(name), fast.values[fast.names.index(name)]
    for array in ("qpos", "qvel", "activation"):
        numeric = difference(lambda h: (scaled(model, "tendon_slack_length", "gastroc", 1 + h), motion), name=array)
        exact = getattr(fast, array)[..., j] * value
        before = slice(0, 16)  # a muscle comes near a change in window 16
        assert (fast.margin[before] > 3 * H * np.abs(fast.relative[before, :, j])).all()
        assert np.abs(exact - numeric)[before].max() <= 1e-5 * np.abs(exact).max()


@pytest.mark.parametrize(
    "options",
    [{}, {"min_activation": 0.02}, {"smoothness": 0.3}, {"cost": "cubic", "min_activation": 0.01}],
    ids=["plain", "floor", "smooth", "cubic"],
)
def test_motion_bodies_sites_and_time_constants(model, options):
    motion, m = short(model), model.mj_model
    mass, place = np.zeros(m.nbody), np.zeros_like(m.site_pos)
    mass[m.body("shank").id] = m.body_mass[m.body("shank").id]
    place[m.site("soleus_P1").id, 0] = 1.0
    directions = {"shank": {"body_mass": mass}, "origin": {"site_pos": place}}
    found = mjhcmc.gradient(
        model, motion, parameters=TIME_KINDS, model_directions=directions,
        motion_directions={"amplitude": motion.qpos}, **options,
    )  # fmt: skip

    def moved(name):
        ((field, change),) = directions[name].items()
        now = getattr(m, field)
        return lambda h: (next(variants(model, {field: (now + h * change)[None]})), motion)

    cases = {
        "amplitude": lambda h: (model, mjhcmc.Motion(motion.time, (1 + h) * motion.qpos)),
        "shank": moved("shank"),
        "origin": moved("origin"),
        "activation_time/iliopsoas": lambda h: (scaled(model, "activation_time", "iliopsoas", 1 + h), motion),
        "deactivation_time/hamstrings": lambda h: (scaled(model, "deactivation_time", "hamstrings", 1 + h), motion),
    }
    for name, make in cases.items():
        check(found.relative[:, :, found.names.index(name)], difference(make, **options), found.margin)


def test_it_is_exact_where_reserves_carry_most(model):
    weak = with_muscle_parameters(model, {FORCE: 0.3 * model.max_isometric_force})
    motion = short(model)
    found = mjhcmc.gradient(weak, motion, parameters=(FORCE,))
    assert np.abs(found.solution.reserve).max() > 10  # N m
    for muscle in ("rect_fem", "tib_ant", "soleus"):
        numeric = difference(lambda h, muscle=muscle: (scaled(weak, FORCE, muscle, 1 + h), motion))
        # differences of a saturated answer are rougher: reserves are converged to 1e-11 of 35 N m
        check(found.relative[:, :, found.names.index(f"{FORCE}/{muscle}")], numeric, found.margin, within=1e-4)


def test_it_holds_from_a_wrong_start_where_gains_move(model):
    motion, options = short(model), {"initial_qpos": np.deg2rad([1.0, -1.0, 1.0])}
    found = mjhcmc.gradient(model, motion, parameters=(FORCE,), **options)
    for muscle in ("iliopsoas", "gastroc"):
        numeric = difference(lambda h, muscle=muscle: (scaled(model, FORCE, muscle, 1 + h), motion), **options)
        check(found.relative[:, :, found.names.index(f"{FORCE}/{muscle}")], numeric, found.margin, within=2e-5)


def test_one_sided_at_a_change_of_the_active_set(model, monkeypatch):
    """Where the vasti are just about to leave their bound in window 4, each side has a derivative of its own."""
    k, i, j = 4, 4, 1
    motion = short(model, until=0.06)

    def with_strength(s):
        return scaled(model, FORCE, "glut_max", s)

    low, high = 0.95, 0.98
    active = converged(with_strength(low), motion).excitation[k, i] > 0
    assert active != (converged(with_strength(high), motion).excitation[k, i] > 0)
    while high - low > 4e-15:
        middle = (low + high) / 2
        if (converged(with_strength(middle), motion).excitation[k, i] > 0) == active:
            low = middle
        else:
            high = middle
    s, h = low, 2e-5
    monkeypatch.setattr("mjhcmc.gradients.gradient.TOLERANCE", 0.0)
    here = converged(with_strength(s), motion).excitation
    slopes = {}
    for side in (1, -1):
        one, two = (converged(with_strength(s * (1 + side * n * h)), motion).excitation for n in (1, 2))
        numeric = side * (4 * one - 3 * here - two) / (2 * h)  # one-sided, second order
        found = mjhcmc.gradient(with_strength(s), motion, parameters=(FORCE,), side=side)
        slopes[side] = found.relative[:, :, j]
        assert found.margin[k, i] < 1e-9
        assert np.abs(slopes[side] - numeric).max() < 1e-4 * np.abs(slopes[side]).max()
    assert np.abs(slopes[1] - slopes[-1]).max() > 0.01


def test_a_batch_is_its_members_alone(model):
    motions = [short(model), short(model, 0.4)]
    weaker = with_muscle_parameters(model, {FORCE: 0.8 * model.max_isometric_force})
    batch = mjhcmc.gradient_batch([model, weaker], motions, parameters=(FORCE,), threads=2)
    for i, (one, motion) in enumerate(zip((model, weaker), motions, strict=True)):
        alone = mjhcmc.gradient(one, motion, parameters=(FORCE,))
        assert np.array_equal(batch[i].excitation, alone.excitation)
    assert len(batch) == 2
    assert not batch.errors


def test_a_member_that_fails_does_so_alone(model):
    beyond = mjhcmc.Motion(np.linspace(0, 0.2, 21), np.tile([0.0, 3.0, 0.0], (21, 1)))
    with pytest.warns(mjhcmc.MjhcmcWarning, match="1 of 2 gradients failed, the first of simulation 1"):
        batch = mjhcmc.gradient_batch(model, [short(model), beyond], parameters=(FORCE,))
    assert isinstance(batch[0], Gradient)
    with pytest.raises(mjhcmc.MotionError, match=r"joint 1 is at 171"):
        batch[1]


def test_a_limit_at_work_is_named(model):
    m = copy.deepcopy(model.mj_model)
    m.jnt_range[m.joint("knee").id] = [np.deg2rad(-15.0), np.deg2rad(10.0)]
    narrow = mjhcmc.MuscleModel.load(m)
    motion = mjhcmc.Motion.cosine(narrow, amplitudes=AMPLITUDES | {"knee": np.deg2rad(-14.9)}, period=0.6, cycles=1)
    starts = {"initial_qpos": np.deg2rad([0.0, -15.5, 0.0])}
    with pytest.raises(mjhcmc.MjhcmcError, match=r"limit|range"):
        mjhcmc.gradient(narrow, motion, parameters=(FORCE,), **starts)


def test_reserves_are_differentiated_too(model):
    """Of muscles too weak, where they are many N m."""
    weak = with_muscle_parameters(model, {FORCE: 0.3 * model.max_isometric_force})
    motion = short(model, until=0.1)
    found = mjhcmc.gradient(weak, motion, parameters=(FORCE,))
    j = found.names.index(f"{FORCE}/gastroc")
    numeric = difference(lambda h: (scaled(weak, FORCE, "gastroc", 1 + h), motion), name="reserve")
    exact = found.reserve[:, :, j] * found.values[j]
    assert np.abs(exact).max() > 1  # N m
    assert np.abs(exact - numeric).max() <= 1e-4 * np.abs(exact).max()


def test_emg_targets(model):
    """They are differentiated by strengths; times of activation, which they go through themselves, are refused."""
    motion = short(model)
    time = np.linspace(0.0, 0.2, 41)
    envelope = 0.3 + 0.2 * np.sin(20 * time[:, None])
    targets = mjhcmc.EmgTargets(mjhcmc.Emg(time, envelope, ("vasti",)), weight=3.0)
    found = mjhcmc.gradient(model, motion, parameters=(FORCE,), emg=targets)
    numeric = difference(lambda h: (scaled(model, FORCE, "vasti", 1 + h), motion), emg=targets)
    check(found.relative[:, :, found.names.index(f"{FORCE}/vasti")], numeric, found.margin)
    with pytest.raises(mjhcmc.SettingsError, match="leave activation_time"):
        mjhcmc.gradient(model, motion, parameters=("activation_time",), emg=targets)


def test_a_posture_that_is_held_says_that_its_derivative_has_two_sides(model):
    held = mjhcmc.Motion(np.linspace(0, 0.1, 11), np.tile([0.3, -0.3, 0.1], (11, 1)))
    with pytest.warns(mjhcmc.MjhcmcWarning, match="windows an excitation equals the activation"):
        mjhcmc.gradient(model, held, parameters=(FORCE,))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"parameters": "max_isometric_force"}, "in a sequence|a sequence of kinds"),
        ({"parameters": None}, "in a sequence|a sequence of kinds"),
        ({"threads": 0}, "threads"),
        ({"threads": "x"}, "threads"),
        ({"model_directions": {"x": {}}}, "must map fields"),
        ({"model_directions": {"x": [1.0]}}, "must map fields"),
        ({"model_directions": {"x": {"body_mass": "heavy"}}}, "no numbers"),
        ({"model_directions": {"x": {"actuator_ctrlrange": np.ones((8, 2))}}}, "actuator_ctrlrange"),
        ({"model_directions": {"x": {"body_subtreemass": np.ones(5)}}}, "follows from other fields"),
        ({"motion_directions": ["x"]}, "must map names"),
        ({"motion_directions": {"x": "up"}}, "no numbers"),
        ({"parameters": ("strength",)}, "max_isometric_force"),
        ({"parameters": ()}, "nothing to differentiate"),
        ({"cost": "stress"}, "effort, cubic"),
        ({"side": 0}, "side must be 1 or -1"),
        ({"model_directions": {"x": {"body_weight": [1.0]}}}, "body_weight"),
        ({"model_directions": {"x": {"body_mass": [1.0]}}}, "body_mass has shape"),
        ({"model_directions": {"x": {"actuator_dynprm": [1.0]}}}, "parameters of their own"),
        ({"motion_directions": {"x": [1.0]}}, "motion direction 'x'"),
    ],
)
def test_what_makes_no_sense_is_refused(model, arguments, told):
    with pytest.raises(mjhcmc.SettingsError, match=told):
        mjhcmc.gradient(model, short(model), **arguments)


def test_models_without_a_gradient_say_why():
    gait = mjhcmc.MuscleModel.load("leg8_gait")
    motion = mjhcmc.Motion.cosine(gait, amplitudes={"hip": 0.1}, period=0.5, cycles=1)
    with pytest.raises(mjhcmc.SettingsError, match="not tracked"):
        mjhcmc.gradient(gait, motion)


def test_an_unknown_name_lists_those_there_are(fast):
    with pytest.raises(mjhcmc.SettingsError, match="max_isometric_force/iliopsoas"):
        fast.of("strength")
    assert fast.of("max_isometric_force/soleus").shape == fast.solution.excitation.shape
    assert fast.names[:1] == (f"{FORCE_KINDS[0]}/iliopsoas",)
    assert fast.values[0] == muscle_parameters(leg())[FORCE][0]

"""The plant with Hill muscles: against `mj_step` where they are MuJoCo's own, states, lock step and bad input."""

import copy

import mujoco
import numpy as np
import pytest
from hill_bodies import FLOOR, arm, assert_states, leg_state, lengths_of, packed, start

import mjhcmc
from mjhcmc import HillPlant, MujocoPlant, hill
from mjhcmc.hill_muscles import hill_model
from mjhcmc.hosted.lockstep import HillLockstep
from mjhcmc.hosted.muscles import hosted_muscles
from mjhcmc.hosted.plant import lockstep_of
from mjhcmc.plant import State
from mjhcmc.surroundings import Surroundings

VARIANTS = {
    "plain": {},
    "gravity-free": {"gravity": "0"},
    "joint limits": {"joint": 'range="-20 15" limited="true"'},
    "soft limits": {"joint": 'range="-20 15" limited="true" solreflimit=".1 .5"'},
    "contact": {"world": FLOOR, "tip": ""},
    "friction": {"joint": 'frictionloss=".5"'},
    "joint damping": {"joint": 'damping=".7" stiffness="3" armature=".02"'},
    "path damping": {"damping": "8"},
    "servo beside": {"between": '<position name="servo" joint="elbow" kp="20" kv=".5"/><motor joint="shoulder"/>'},
    "shared path": {"extensor": "biceps_path", "damping": "8"},
}


@pytest.fixture(scope="module")
def smooth_arm():
    """No limits, no contacts, point to point paths: as smooth as its muscles."""
    return arm()


def sine_load(times):
    """(n, 2) N m, smooth in time."""
    return np.stack([3 * np.sin(40 * times), 2 * np.cos(25 * times)], axis=1)


# --- MuJoCo's own muscle ------------------------------------------------------------------------------------------


def mj_steps(model, state, u, n_step, h, reserve, load=None):
    """Plain MuJoCo: states (n_step + 1, nq + nv + n) after each step."""
    m = copy.deepcopy(model.mj_model)
    m.opt.timestep = h
    d = mujoco.MjData(m)
    d.qpos[:], d.qvel[:], d.act[:] = state.qpos, state.qvel, state.activation
    d.qacc_warmstart[:] = state.warmstart
    found = [np.concatenate([d.qpos, d.qvel, d.act])]
    for k in range(n_step):
        d.ctrl[model.ctrl_index] = u
        d.qfrc_applied[:] = reserve + (0.0 if load is None else load(np.array([(k + 0.5) * h]))[0])
        mujoco.mj_step(m, d)
        found.append(np.concatenate([d.qpos, d.qvel, d.act]))
    return np.array(found), d


@pytest.mark.parametrize("name", VARIANTS)
def test_steps_of_its_own_muscle_are_mj_steps(name):
    """150 steps; limits and contact come and go in them."""
    model = arm(**VARIANTS[name])
    plant = HillPlant(model, "mujoco", "rigid", physics_dt=1e-3)
    state = start(model, plant, [0.1, -0.2], [1.5, -2.0], [0.2, 0.5, 0.1])
    u, reserve = np.array([0.7, 0.1, 0.3]), np.array([0.5, -0.3])
    wanted, d = mj_steps(model, state, u, 150, 1e-3, reserve)
    constrained = 0
    for row in wanted[1:]:
        plant.advance(u, reserve, 1)
        end = plant.get_state()
        found = np.concatenate([end.qpos, end.qvel, end.activation])
        np.testing.assert_allclose(found, row, rtol=1e-12, atol=1e-12)
        plant.forward()
        constrained += plant.mj_data.nefc > 0
    assert end.time == pytest.approx(0.15)
    held = name in ("joint limits", "soft limits", "contact", "friction")
    assert (constrained > 20) == held  # the case is what it says
    if held:
        np.testing.assert_allclose(end.warmstart, d.qacc_warmstart, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("h", [1e-3, 2.5e-3])
def test_the_legs_own_muscles_step_as_mj_step(leg8, h):
    """All eight muscles, wrapping, path damping, through the knee's limit; moving, for 200 steps."""
    plant = HillPlant(leg8, "mujoco", "rigid", physics_dt=h)
    rng = np.random.default_rng(0)
    state = start(leg8, plant, [0.1, -0.1, 0.05], [1.0, 1.0, -1.0])
    u, reserve = rng.uniform(0, 0.6, 8), np.array([1.0, -0.5, 0.2])
    wanted, _ = mj_steps(leg8, state, u, 200, h, reserve)
    for row in wanted[1:]:
        plant.advance(u, reserve, 1)
        end = plant.get_state()
        np.testing.assert_allclose(np.concatenate([end.qpos, end.qvel, end.activation]), row, rtol=1e-12, atol=1e-12)
    assert np.abs(wanted[-1] - wanted[0]).max() > 0.1


def test_many_steps_in_one_call_are_the_same_bits(leg8):
    one, many = (HillPlant(leg8, "millard", "compliant") for _ in range(2))
    for plant in (one, many):
        start(leg8, plant, [0.1, -0.3, 0.0], [1.0, -1.0, 2.0])
    u, reserve = np.full(8, 0.3), np.array([1.0, 0.0, -1.0])
    many.advance(u, reserve, 10)
    for _ in range(10):
        one.advance(u, reserve, 1)
    assert_states(one.get_state(), many.get_state(), rtol=0)
    assert many.get_state().time == pytest.approx(0.01)


def test_loads_from_outside_are_held_as_in_mujocos_plant():
    model = arm()
    own, hosted = MujocoPlant(model, external=sine_load), HillPlant(model, "mujoco", "rigid", external=sine_load)
    state = start(model, hosted, [0.1, -0.2], [0.5, -1.0])
    own.set_state(state)
    u, reserve = np.array([0.4, 0.2, 0.3]), np.array([0.2, 0.1])
    wanted, _ = mj_steps(model, state, u, 120, 1e-3, reserve, sine_load)
    for plant in (own, hosted):
        plant.advance(u, reserve, 120)
    assert_states(hosted.get_state(), own.get_state(), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(hosted.get_state().qpos, wanted[-1, :2], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(hosted.forward(), own.forward(), rtol=1e-10)
    np.testing.assert_allclose(hosted.external_load(), sine_load(np.array([0.12]))[0], rtol=1e-9)
    plants = HillLockstep([model], [hosted.hosted], 1e-3, [Surroundings(sine_load)])
    rows = plants.step(np.arange(1), plants.rows([state]), u[None], reserve[None], 120)
    np.testing.assert_array_equal(plants.layout.state(rows[0]).qpos, hosted.get_state().qpos)
    np.testing.assert_allclose(plants.acceleration(np.arange(1), rows, reserve[None])[0], own.forward(), rtol=1e-10)


def test_longer_steps_are_those_of_a_plant_that_has_them(smooth_arm):
    short, long = (HillPlant(smooth_arm, "degroote-fregly", "compliant", physics_dt=h) for h in (5e-4, 1e-3))
    for plant in (short, long):
        start(smooth_arm, plant, [0.1, -0.2], [0.5, 1.0])
    short.advance(np.full(3, 0.4), np.zeros(2), 8, times=2.0)
    long.advance(np.full(3, 0.4), np.zeros(2), 8)
    assert_states(short.get_state(), long.get_state(), rtol=0)


# --- lock step ----------------------------------------------------------------------------------------------------


def company(leg8, count, tendon, curves="millard", threads=1):
    """Simulations that differ in state and, by their masses, in model."""
    hosts = hosted_muscles(leg8, curves, tendon)
    plants = HillLockstep([leg8] * count, [hosts], 1e-3, [Surroundings()] * count, threads)
    rows = plants.rows([leg_state(leg8, seed) for seed in range(count)])
    rng = np.random.default_rng(9)
    return plants, rows, rng.uniform(0, 1, (count, 8)), rng.normal(size=(count, 3))


@pytest.mark.parametrize("tendon", ["rigid", "compliant"])
@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_no_bit(leg8, tendon, threads):
    """Enough simulations that the compiled parts are spread, too."""
    (plants, rows, u, s), (others, *_) = company(leg8, 50, tendon), company(leg8, 50, tendon, threads=threads)
    ids = np.arange(50)
    np.testing.assert_array_equal(plants.step(ids, rows, u, s, 5), others.step(ids, rows, u, s, 5))
    np.testing.assert_array_equal(plants.acceleration(ids, rows, s), others.acceleration(ids, rows, s))
    for a, b in zip(plants.view(ids, rows, s).around, others.view(ids, rows, s).around, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("tendon", ["rigid", "compliant"])
def test_company_changes_no_bit(leg8, tendon):
    plants, rows, u, s = company(leg8, 7, tendon)
    whole = plants.step(np.arange(7), rows, u, s, 5)
    view = plants.view(np.arange(7), rows, s)
    for ids in (np.array([3]), np.array([1, 5]), np.array([0, 2, 4, 6]), np.arange(1, 7)):
        np.testing.assert_array_equal(plants.step(ids, rows[ids], u[ids], s[ids], 5), whole[ids])
        part = plants.view(ids, rows[ids], s[ids])
        for name in ("R", "force", "path", "slopes"):
            np.testing.assert_array_equal(getattr(part, name), getattr(view, name)[ids])
        for a, b in zip(part.around, view.around, strict=True):
            np.testing.assert_array_equal(a, None if b is None else b[ids])
    alone = HillPlant(leg8, "millard", tendon)
    for i in range(7):
        alone.set_state(plants.layout.state(rows[i]))
        alone.advance(u[i], s[i], 5)
        assert_states(alone.get_state(), plants.layout.state(whole[i]), rtol=0)


def test_the_knees_limit_in_company(leg8):
    """Some simulations under a constraint, some not: each as alone."""
    hosts = hosted_muscles(leg8, "thelen", "compliant")
    plants = HillLockstep([leg8] * 4, [hosts], 1e-3, [Surroundings()] * 4)
    states = [State(0.0, np.array([0.1, k, 0.0]), np.array([0.0, 2.0, 0.0]), np.full(8, 0.3), np.zeros(3))
              for k in (-0.3, 0.17, -0.2, 0.18)]  # fmt: skip
    rows, u, s = plants.rows(states), np.full((4, 8), 0.2), np.zeros((4, 3))
    together = plants.step(np.arange(4), rows, u, s, 15)
    for i, state in enumerate(states):
        alone = HillPlant(leg8, hosts)
        alone.set_state(state)
        alone.advance(u[i], s[i], 15)
        assert_states(alone.get_state(), plants.layout.state(together[i]), rtol=0)


def test_models_and_muscles_of_their_own(leg8):
    """Simulations whose bodies and muscles differ in numbers: each as alone."""
    heavy = copy.deepcopy(leg8.mj_model)
    heavy.body_mass[:] *= 1.3
    heavy.actuator_gainprm[:, 2] *= 0.8
    heavy.actuator_biasprm[:, 2] *= 0.8
    mujoco.mj_setConst(heavy, mujoco.MjData(heavy))
    other = mjhcmc.MuscleModel.load(heavy)
    curves = hill.millard2012()
    models = [leg8, other]
    hosts = [hosted_muscles(m, hill.HillModel(hill_model(m).muscles, curves), "compliant") for m in models]
    plants = HillLockstep(models, hosts, 1e-3, [Surroundings(), Surroundings(sine_on_three)])
    rows = plants.rows([leg_state(leg8, i) for i in range(2)])
    u, s = np.full((2, 8), 0.4), np.zeros((2, 3))
    ends = plants.step(np.arange(2), rows, u, s, 10)
    for i in range(2):
        alone = HillPlant(models[i], hosts[i], external=[None, sine_on_three][i])
        alone.set_state(plants.layout.state(rows[i]))
        alone.advance(u[i], s[i], 10)
        assert_states(alone.get_state(), plants.layout.state(ends[i]), rtol=0)


def sine_on_three(times):
    return np.stack([np.sin(30 * times), np.cos(20 * times), 0 * times], axis=1)


def test_plants_built_alike_step_together(leg8, smooth_arm):
    """By name, each plant has curves of its own that are the same."""
    plants = [HillPlant(leg8, "millard", "compliant") for _ in range(2)]
    assert lockstep_of(plants, 1).count == 2
    with pytest.raises(mjhcmc.SettingsError, match="curves"):
        lockstep_of([plants[0], HillPlant(leg8, "thelen", "compliant")], 1)
    with pytest.raises(mjhcmc.SettingsError, match="tendon"):
        lockstep_of([plants[0], HillPlant(leg8, "millard", "rigid")], 1)
    with pytest.raises(mjhcmc.SettingsError, match="physics_dt"):
        lockstep_of([plants[0], HillPlant(leg8, "millard", "compliant", 5e-4)], 1)


def test_one_that_runs_away_leaves_the_others_alone(leg8):
    plants, rows, u, s = company(leg8, 4, "compliant")
    ids = np.arange(4)
    wanted = plants.step(ids, rows, u, s, 20)
    wild = rows.copy()
    wild[2, plants.layout.qvel] = 1e7
    found = plants.step(ids, wild, u, s, 20)
    assert not np.isfinite(found[2, plants.layout.qpos]).all()
    np.testing.assert_array_equal(found[[0, 1, 3]], wanted[[0, 1, 3]])
    np.testing.assert_array_equal(plants.step(ids, rows, u, s, 20), wanted)  # and nothing of it stays behind


# --- states and inputs --------------------------------------------------------------------------------------------


def test_a_state_comes_back(leg8):
    plant = HillPlant(leg8, "thelen", "compliant")
    told = State(0.3, np.array([0.1, -0.2, 0.3]), np.array([1.0, 2.0, 3.0]), np.linspace(0, 1, 8), np.arange(3.0),
                 np.linspace(0.05, 0.12, 8))  # fmt: skip
    plant.set_state(told)
    back = plant.get_state()
    assert_states(back, told, rtol=0)
    np.testing.assert_array_equal(back.warmstart, told.warmstart)
    plant.forward()
    assert_states(plant.get_state(), told, rtol=0)  # looking changes nothing
    back.fiber_length[:] = 0.0
    assert_states(plant.get_state(), told, rtol=0)  # a copy
    row = plant.lockstep.rows([told])[0]
    assert_states(plant.lockstep.layout.state(row), told, rtol=0)


@pytest.mark.parametrize("curves", ["millard", "thelen", "degroote-fregly"])
def test_fibers_that_are_not_told_are_in_equilibrium(leg8, curves):
    """In steady motion with the path, as the reference finds it; the same from a plant and from lock step."""
    plant, state = HillPlant(leg8, curves, "compliant"), leg_state(leg8, 3, 0.3)
    plant.set_state(state)
    fiber = plant.get_state().fiber_length
    L, V = lengths_of(plant)
    wanted = hill.dynamic_equilibrium(plant.hosted.hill, state.activation, L, V).fiber_length
    np.testing.assert_allclose(fiber, wanted, rtol=1e-11)
    row = plant.lockstep.rows([state])[0]
    np.testing.assert_allclose(row[plant.lockstep.layout.fiber], fiber, rtol=1e-13)


def test_rigid_muscles_have_no_fiber_state(leg8):
    plant = HillPlant(leg8, "millard", "rigid")
    plant.set_state(leg_state(leg8))
    assert plant.get_state().fiber_length.shape == (0,)
    plant.forward()
    assert plant.internal_rate() == 0.0


def test_the_model_is_left_as_it_was(leg8):
    before = leg8.mj_model.actuator_gainprm.copy(), leg8.mj_model.tendon_damping.copy()
    plant = HillPlant(leg8, "millard", "compliant")
    plant.set_state(leg_state(leg8))
    plant.advance(np.full(8, 0.3), np.zeros(3), 3)
    np.testing.assert_array_equal(leg8.mj_model.actuator_gainprm, before[0])
    np.testing.assert_array_equal(leg8.mj_model.tendon_damping, before[1])


def test_excitation_is_held_to_its_range(smooth_arm):
    """Compliant muscles are never without tone: below .01 is .01; over 1 is 1."""
    ends = []
    for u in (-0.5, 0.0, 0.01, 1.0, 1.7):
        plant = HillPlant(smooth_arm, "millard", "compliant")
        start(smooth_arm, plant, [0.1, 0.1], [0.0, 0.0])
        plant.advance(np.full(3, u), np.zeros(2), 5)
        ends.append(packed(plant.get_state()))
    for k in (0, 1):
        np.testing.assert_array_equal(ends[k], ends[2])
    np.testing.assert_array_equal(ends[3], ends[4])


# --- bad input ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"muscles": "hill"}, "curves 'hill' are not known: choose one of millard, thelen, degroote-fregly, mujoco"),
        ({"tendon": "elastic"}, "tendon 'elastic' is not known: choose one of rigid, compliant"),
        ({"muscles": "mujoco", "tendon": "compliant"}, "MuJoCo: these curves have no tendon: take tendon 'rigid'"),
        ({"physics_dt": 0.0}, "physics_dt must be positive, in seconds; got 0"),
        ({"physics_dt": -1e-3}, "physics_dt must be positive"),
        ({"physics_dt": np.nan}, "physics_dt must be positive"),
        ({"muscles": 3}, "muscles are a name of curves or a HillModel; got int"),
    ],
    ids=str,
)
def test_bad_choices_are_named(leg8, options, words):
    with pytest.raises(mjhcmc.SettingsError, match=words.replace("(", r"\(")):
        HillPlant(leg8, **options)


def muscles_named(names, **changes):
    numbers = {"max_isometric_force": 1000.0, "optimal_fiber_length": 0.1, "tendon_slack_length": 0.2} | changes
    return hill.HillModel(
        hill.MuscleParameters(**{k: np.broadcast_to(v, len(names)) for k, v in numbers.items()}, names=names),
        hill.millard2012(),
    )


def test_muscles_of_another_model_are_refused(smooth_arm):
    names = smooth_arm.muscle_names
    HillPlant(smooth_arm, muscles_named(names))
    for other in (names[::-1], names[:2], ("flexor", "biceps", "soleus")):
        with pytest.raises(mjhcmc.SettingsError, match=f"{', '.join(other)} are not the model's"):
            HillPlant(smooth_arm, muscles_named(other))


def test_a_compliant_muscle_needs_a_slack_length(smooth_arm):
    bare = muscles_named(smooth_arm.muscle_names, tendon_slack_length=np.array([0.1, 0.0, 0.1]))
    with pytest.raises(
        mjhcmc.SettingsError, match="biceps: a tendon slack length of 0 cannot stretch: take tendon 'rigid'"
    ):
        HillPlant(smooth_arm, bare, "compliant")
    HillPlant(smooth_arm, bare, "rigid")


class Flat:
    """A curve that a user made."""

    def __call__(self, x):
        return np.ones_like(x)

    derivative = __call__

    def evaluate(self, x):
        return self(x), self(x)


def test_a_curve_of_the_users_own_is_named_before_work_begins(smooth_arm):
    m = muscles_named(smooth_arm.muscle_names).muscles
    t = hill.thelen2003()
    curves = hill.Curves("flat", Flat(), t.passive, t.force_velocity, t.tendon, 0.1, 0.1)
    with pytest.raises(mjhcmc.SettingsError, match="flat: a curve of type Flat is not compiled"):
        HillPlant(smooth_arm, hill.HillModel(m, curves))


@pytest.mark.parametrize(
    ("xml", "words"),
    [
        (
            {"between": '<muscle name="odd" joint="elbow" force="10" lengthrange="-1 1"/>'},
            "'odd': no Hill muscle pulls",
        ),
        ({"range": 'lengthrange=".13 .28" ctrlrange="0 1"'}, "'flexor'.*tendon slack length of -0.245 m"),
    ],
    ids=["joint", "slack length"],
)
def test_muscles_that_no_hill_muscle_stands_for_are_named(xml, words):
    with pytest.raises(mjhcmc.ModelError, match=words):
        HillPlant(arm(**xml))


def test_damping_that_mujocos_curves_leave_to_the_path_is_not_dropped(smooth_arm):
    """A user's own muscles with MuJoCo's curves and with damping: it acts, or is refused."""
    m = muscles_named(smooth_arm.muscle_names, fiber_damping=0.5, tendon_slack_length=0.1).muscles
    bare = muscles_named(smooth_arm.muscle_names, fiber_damping=0.0, tendon_slack_length=0.1).muscles
    try:
        plants = [HillPlant(smooth_arm, hill.HillModel(p, hill.mujoco_curves()), "rigid") for p in (m, bare)]
    except mjhcmc.SettingsError as error:
        assert "damping" in str(error)  # noqa: PT017
        return
    forces = []
    for plant in plants:
        start(smooth_arm, plant, [0.1, 0.1], [3.0, 3.0])
        plant.forward()
        forces.append(plant.muscle_force())
    assert np.abs(forces[0] - forces[1]).max() > 1.0

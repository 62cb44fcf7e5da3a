"""The task, and both libraries' environments of it: their interfaces, and that they step what the methods step."""

import io
import os
import re
import sys
import warnings

import mujoco
import numpy as np
import pytest
from myo_models import myo_model

import mjhcmc
from mjhcmc import MjhcmcError, MjhcmcWarning, SettingsError, SimulationError
from mjhcmc.environments import Episodes, Expert, TrackingTask

gymnasium = pytest.importorskip("gymnasium")
from mjhcmc.environments.gym import ID, TrackingEnv  # noqa: E402

dm = pytest.importorskip("mjhcmc.environments.dm") if sys.version_info < (3, 13) else None
needs_dm = pytest.mark.skipif(dm is None, reason="dm_control has no wheels for this Python")

DT = 0.01


@pytest.fixture(scope="module")
def bare(leg8, fast):
    """The fast movement by the muscles alone, at the environments' physics step."""
    return mjhcmc.hcmc(leg8, fast, DT, TrackingTask(leg8, fast).settings.physics_dt, reserves=False)


@pytest.fixture(scope="module")
def gait():
    """A leg on a pelvis that is led, pushed at the foot: model, motion, loads."""
    model = mjhcmc.MuscleModel.load("leg8_gait")
    swing = {"pelvis_ty": 0.03, "pelvis_tilt": np.deg2rad(4), "hip": np.deg2rad(20), "knee": np.deg2rad(-30)}
    motion = mjhcmc.Motion.cosine(model, amplitudes=swing, period=0.4, cycles=1)
    time = np.linspace(0, motion.end, 81)
    force = np.outer(np.sin(np.pi * time / motion.end) ** 2, [20.0, 0.0, 200.0])[:, None]
    point = np.tile([0.05, -0.08, 0.05], (len(time), 1, 1))
    return model, motion, mjhcmc.ExternalLoads("push", time, ("foot",), force, np.zeros_like(force), point)


def played_by_gym(env, policy):
    """(N+1, nz) rad tracking errors of an episode, and what it earned; a solution plays its excitations."""
    policy = Expert.of(policy, env.task) if isinstance(policy, mjhcmc.Solution) else policy
    _, info = env.reset(seed=0)
    errors, earned, over = [info["tracking_error"]], 0.0, False
    while not over:
        _, reward, terminated, truncated, info = env.step(policy(env.node, env.state))
        errors.append(info["tracking_error"])
        earned, over = earned + reward, terminated or truncated
    return np.array(errors), earned


def played_by_dm(env, policy):
    """The same."""
    step, own = env.reset(), env.task
    policy = Expert.of(policy, own.task) if isinstance(policy, mjhcmc.Solution) else policy
    errors, earned = [own.task.tracking_error(0, own.state(env.physics))], 0.0
    while not step.last():
        step = env.step(policy(own.node, own.state(env.physics)))
        errors.append(own.task.tracking_error(own.node, own.state(env.physics)))
        earned += step.reward
    return np.array(errors), earned


def test_gymnasium_finds_nothing_to_complain_of():
    from gymnasium.utils.env_checker import check_env

    for flat in (True, False):
        env = gymnasium.make(ID, motion="fast", start="random", noise=0.02, muscle_paths=True, flat=flat)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            check_env(env.unwrapped, skip_render_check=True)


def test_pictures(leg8, monkeypatch):
    """Also where MUJOCO_GL is not set and MuJoCo has been imported: wherever anything can draw."""
    from mjhcmc.offscreen import gl_back_end

    if os.environ.get("MUJOCO_GL") in ("egl", "osmesa"):
        monkeypatch.delenv("MUJOCO_GL")
    try:
        gl_back_end()
    except MjhcmcError as error:
        pytest.skip(str(error))
    env = TrackingEnv(leg8, "fast", render_mode="rgb_array", width=64, height=48, dt=0.02)
    assert env.metadata["render_fps"] == 50
    env.reset(seed=0)
    before = env.render()
    assert before.shape == (48, 64, 3)
    assert before.dtype == np.uint8
    assert before.flags.c_contiguous  # others turn it into tensors
    state = env.state
    for _ in range(10):
        env.step(np.zeros(8))
        after = env.render()
    assert np.any(after != before)  # the leg has fallen
    unseen = TrackingEnv(leg8, "fast", dt=0.02)
    unseen.reset(seed=0)
    for _ in range(10):
        unseen.step(np.zeros(8))
    np.testing.assert_array_equal(unseen.state.qpos, env.state.qpos)  # to look changes nothing
    assert np.any(state.qpos != env.state.qpos)
    env.close()


def test_spaces_hold_what_is_named(leg8):
    env = TrackingEnv(leg8, "slow", preview=2, muscle_paths=True)
    observation, _ = env.reset(seed=0)
    names = env.task.observation_names
    assert observation.shape == env.observation_space.shape == (len(names),)
    assert len(set(names)) == len(names) == 3 + 3 + 8 + 2 * 3 * 3 + 2 + 2 * 8
    assert env.action_names == leg8.muscle_names
    np.testing.assert_array_equal(env.action_space.low, np.zeros(8))
    np.testing.assert_array_equal(env.action_space.high, np.ones(8))
    seen = dict(zip(names, observation, strict=True))
    reference = env.task.windows.reference
    assert seen["position/knee"] == reference.qpos[0, 1]
    assert seen["to_desired/knee/+2"] == pytest.approx(reference.qpos[2, 1] - reference.qpos[0, 1])
    assert seen["desired_velocity/hip/+1"] == pytest.approx(reference.qvel[1, 0])
    assert seen["time_left"] == pytest.approx(1.8)
    data = mujoco.MjData(leg8.mj_model)
    data.qpos[:] = reference.qpos[0]
    mujoco.mj_forward(leg8.mj_model, data)
    assert seen["muscle_length/soleus"] == pytest.approx(data.actuator_length[6])
    nested = TrackingEnv(leg8, "slow", preview=2, muscle_paths=True, flat=False).reset(seed=0)[0]
    np.testing.assert_array_equal(np.concatenate([part.ravel() for part in nested.values()]), observation)


@needs_dm
def test_dm_control_says_the_same(leg8):
    env = dm.tracking(leg8, "slow", preview=2, muscle_paths=True, random=0)
    assert env.action_spec().name.split("\t") == list(leg8.muscle_names)
    assert (env.action_spec().minimum == 0).all()
    assert (env.action_spec().maximum == 1).all()
    step = env.reset()
    for name, spec in env.observation_spec().items():
        spec.validate(step.observation[name])
    seen = TrackingEnv(leg8, "slow", preview=2, muscle_paths=True, flat=False).reset(seed=0)[0]
    assert list(seen) == list(step.observation)
    for name, values in seen.items():
        np.testing.assert_array_equal(step.observation[name], values)
    one = dm.tracking(leg8, "slow", flat=True)
    flat = one.reset().observation["observations"]
    spec = one.observation_spec()["observations"]
    spec.validate(flat)
    assert spec.name.split("\t") == list(one.task.task.observation_names)
    np.testing.assert_array_equal(flat, TrackingEnv(leg8, "slow").reset(seed=0)[0])


@needs_dm
def test_dm_env_finds_nothing_to_complain_of(leg8):
    import unittest

    from absl.testing import absltest
    from dm_env import test_utils

    class Conforms(test_utils.EnvironmentTestMixin, absltest.TestCase):
        def make_object_under_test(self):
            return dm.tracking(leg8, mjhcmc.Motion.cosine(leg8, "fast", cycles=1), random=1)

        def make_action_sequence(self):
            for _ in range(25):
                yield self.make_action()

    result = unittest.TextTestRunner(stream=io.StringIO()).run(
        unittest.defaultTestLoader.loadTestsFromTestCase(Conforms)
    )
    assert result.testsRun >= 4
    assert result.wasSuccessful(), result.failures + result.errors


def test_solutions_played_by_gymnasium_are_themselves(leg8, fast, bare):
    errors, earned = played_by_gym(TrackingEnv(leg8, fast), bare)
    np.testing.assert_array_equal(errors, bare.tracking_error)
    tracking = np.exp(-(bare.tracking_error[1:] ** 2).mean(axis=1) / np.deg2rad(5) ** 2)
    effort = (bare.activation[1:] ** 2).mean(axis=1)
    assert earned == pytest.approx((0.9 * tracking + 0.1 * (1 - effort)).sum(), rel=1e-12)


@needs_dm
@pytest.mark.parametrize("integrator", ["rk4", "euler", "implicitfast"])
def test_solutions_played_by_dm_control_are_themselves(integrator, leg8, fast):
    env = dm.tracking(leg8, fast, DT, integrator=integrator)
    step = env.task.task.settings.physics_dt
    solution = mjhcmc.hcmc(leg8, fast, DT, step, reserves=False, integrator=integrator)
    errors, _ = played_by_dm(env, solution)
    np.testing.assert_array_equal(errors, solution.tracking_error)


def test_reserves_that_are_left_out_are_the_only_difference(leg8, fast):
    """Of leg8 reserves are so small that what they held back is, too."""
    env = TrackingEnv(leg8, fast)
    fast_solution = mjhcmc.hcmc(leg8, fast, DT, env.task.settings.physics_dt)
    errors, _ = played_by_gym(env, fast_solution)
    off = np.abs(errors - fast_solution.tracking_error).max()
    assert 0 < off < 1e-5
    assert np.abs(fast_solution.reserve).max() < 1e-3


def test_led_and_loaded_legs(gait):
    """A pelvis that is prescribed and a force at the foot act in the environments as in the solve."""
    model, motion, loads = gait
    env = TrackingEnv(model, motion, dt=DT, loads=loads)
    solution = mjhcmc.hcmc(model, motion, DT, env.task.settings.physics_dt, reserves=False, loads=loads)
    tracked = model.roles.tracked
    errors, _ = played_by_gym(env, solution)
    np.testing.assert_array_equal(errors, solution.tracking_error[:, tracked])
    without, _ = played_by_gym(TrackingEnv(model, motion, dt=DT), solution)
    length = min(len(errors), len(without))
    assert np.abs(without[:length] - errors[:length]).max() > np.deg2rad(5)
    if dm is not None:
        led = dm.tracking(model, motion, DT, loads=loads)
        errors, _ = played_by_dm(led, solution)
        np.testing.assert_array_equal(errors, solution.tracking_error[:, tracked])


@pytest.mark.filterwarnings("ignore:Attaching a spec", "ignore:model .* MuJoCo would step it by")
def test_models_of_others():
    model = mjhcmc.MuscleModel.load(myo_model("myoelbow"))
    motion = mjhcmc.Motion.cosine(model, amplitudes={"r_elbow_flex": np.deg2rad(40)}, period=0.4, cycles=1)
    env = TrackingEnv(model, motion)
    assert env.task.settings.physics_dt == 1e-3  # its muscles are soft enough
    solution = mjhcmc.hcmc(model, motion, DT, reserves=False)
    errors, _ = played_by_gym(env, solution)
    np.testing.assert_array_equal(errors, solution.tracking_error[:, model.roles.tracked])
    if dm is not None:
        errors, _ = played_by_dm(dm.tracking(model, motion), solution)
        np.testing.assert_array_equal(errors, solution.tracking_error[:, model.roles.tracked])


def test_seeds_decide_and_nothing_else(leg8):
    def episode(env, seed):
        observations = [env.reset(seed=seed)[0]]
        rng = np.random.default_rng(5)
        for _ in range(5):
            observation, _, terminated, truncated, _ = env.step(rng.random(8))
            observations.append(observation)
            if terminated or truncated:
                break
        return np.array(observations)

    one, other = (TrackingEnv(leg8, "slow", start="random", noise=0.05) for _ in range(2))
    first = episode(one, 7)
    episode(one, 8)
    np.testing.assert_array_equal(episode(one, 7), first)
    np.testing.assert_array_equal(episode(other, 7), first)
    assert not np.array_equal(episode(one, 8)[0], first[0])
    begins = [one.reset()[1]["node"] for _ in range(30)]
    assert len(set(begins)) > 10  # all along the motion


@needs_dm
def test_seeds_decide_in_dm_control(leg8):
    def begins(seed):
        env = dm.tracking(leg8, "slow", start="random", noise=0.05, random=seed)
        return np.array([env.reset().observation["position"] for _ in range(4)])

    np.testing.assert_array_equal(begins(3), begins(3))
    assert not np.array_equal(begins(3), begins(4))


def test_episodes_begin_on_the_motion(leg8, slow):
    """With the activations that its acceleration takes: MuJoCo by itself finds that acceleration."""
    task, reference = TrackingTask(leg8, slow), slow.sample(np.arange(181) * DT)
    data = mujoco.MjData(leg8.mj_model)
    for node in (0, 20, 75, 179):
        _, state = task.first(np.random.default_rng(0), node)
        np.testing.assert_array_equal(state.qpos, reference.qpos[node])
        np.testing.assert_array_equal(state.qvel, reference.qvel[node])
        data.qpos[:], data.qvel[:], data.act[:] = state.qpos, state.qvel, state.activation
        mujoco.mj_forward(leg8.mj_model, data)
        np.testing.assert_allclose(data.qacc, reference.qacc[node], atol=1e-4 * np.abs(reference.qacc).max())


def test_episodes_begin_in_the_states_of_a_solution(leg8, fast, bare):
    env = TrackingEnv(leg8, fast, solution=bare)
    env.reset(options={"node": 17})
    assert env.node == 17
    np.testing.assert_array_equal(env.state.activation, bare.activation[17])
    np.testing.assert_array_equal(env.state.qvel, bare.qvel[17])


def test_noise_keeps_to_joints_and_bound(leg8):
    task = TrackingTask(leg8, "slow", noise=10.0)
    for seed in range(20):
        _, state = task.first(np.random.default_rng(seed))
        assert (np.abs(task.tracking_error(0, state)) <= np.deg2rad(15)).all()
        assert ((state.qpos >= leg8.joint_range[:, 0]) & (state.qpos <= leg8.joint_range[:, 1])).all()


def test_who_leaves_the_motion_is_lost(leg8):
    env = TrackingEnv(leg8, "slow", bound=np.deg2rad(2))
    env.reset(seed=0)
    over = False
    while not over:
        *_, terminated, truncated, info = env.step(np.zeros(8))
        over = terminated or truncated
    assert terminated
    assert not truncated
    assert np.abs(info["tracking_error"]).max() > np.deg2rad(2)
    with pytest.raises(SimulationError, match="call reset"):
        env.step(np.zeros(8))
    if dm is not None:
        again = dm.tracking(leg8, "slow", bound=np.deg2rad(2))
        step = again.reset()
        while not step.last():
            step = again.step(np.zeros(8))
        assert step.discount == 0.0
        assert again.task.node == info["node"]


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_a_model_that_runs_away_is_lost_and_earns_nothing(leg8, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo keeps a log of it
    task = TrackingTask(leg8, "slow")
    episodes = Episodes(task)
    episodes.reset(np.random.default_rng(0))
    episodes.plant.mj_data.qvel[:] = 1e9
    outcome = episodes.step(np.ones(8))
    assert outcome.terminated
    assert outcome.reward == 0
    assert np.isfinite(task.flat(outcome.observation)).all()
    episodes.reset(np.random.default_rng(0))
    assert episodes.step(np.zeros(8)).reward > 0.9


def test_actions_are_clipped(leg8):
    env = TrackingEnv(leg8, "fast")
    ends = []
    for u in (1.0, 7.0):
        env.reset(seed=0)
        ends.append(env.step(np.full(8, u))[0])
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"dt": 0.01, "physics_dt": 0.003}, r"dt 0\.01 s is no multiple of physics_dt 0\.003 s: .* 0\.0025"),
        ({"dt": 0.001, "physics_dt": 0.01}, r"no multiple of physics_dt"),
        ({"dt": -1}, r"dt must be a positive number; got -1"),
        ({"physics_dt": "x"}, r"physics_dt must be a positive number; got 'x'"),
        ({"sart": "random"}, r"'sart' is no setting of the task: choose among dt, physics_dt"),
        ({"start": "middle"}, r"start must be one of beginning, random; got 'middle'"),
        ({"bound": np.nan}, r"bound must be a positive number; got nan"),
        ({"error_scale": np.inf}, r"error_scale must be a positive number; got inf"),
        ({"solution": "a.parquet"}, r"a solution is a Solution; got str: use Solution\.load"),
        ({"noise": np.nan}, r"noise must be 0 or positive; got nan"),
        ({"effort_weight": 2}, r"effort_weight must lie within 0\.\.1; got 2"),
        ({"preview": 1.5}, r"preview must be a number of windows, 0 or more; got 1\.5"),
        ({"muscle_paths": "yes"}, r"muscle_paths must be True or False"),
        ({"integrator": "rk5"}, r"integrator 'rk5' is not known"),
        ({"motion": "jump"}, r"no motion 'jump': give one of fast, slow, or a motion file"),
        ({"motion": 3}, r"a motion is a Motion, a name or a file; got int"),
        ({"motion": mjhcmc.Motion(np.arange(5.0), np.zeros((5, 7)))}, r"has 7 joints, model 'leg8' has 3"),
    ],
)
def test_bad_settings(leg8, choices, words):
    choices = {"motion": "slow", **choices}
    makers = [lambda: TrackingEnv(leg8, **choices)]
    if dm is not None:
        makers.append(lambda: dm.tracking(leg8, **choices))
    for make in makers:
        with pytest.raises(MjhcmcError, match=words) as told:
            make()
        assert "\n" not in str(told.value)


def test_bad_use(leg8, fast, bare):
    env = TrackingEnv(leg8, fast)
    with pytest.raises(SimulationError, match="has not begun: call reset"):
        env.step(np.zeros(8))
    with pytest.raises(SettingsError, match="reset knows no option 'nod'"):
        env.reset(options={"nod": 3})
    with pytest.raises(SettingsError, match=re.escape("node must be one of 0 .. 59")):
        env.reset(options={"node": 60})
    with pytest.raises(SettingsError, match=r"node must be one of .*; got True"):
        env.reset(options={"node": True})
    with pytest.raises(SettingsError, match=re.escape("its options in a dict, such as {'node': 3}; got [3]")):
        env.reset(options=[3])
    env.reset(seed=0)
    with pytest.raises(SettingsError, match="8 numbers; got 'x'"):
        env.step("x")
    with pytest.raises(SettingsError, match=re.escape("8 numbers; got shape (3,)")):
        env.step(np.zeros(3))
    with pytest.raises(SettingsError, match="finite excitations"):
        env.step(np.full(8, np.nan))
    with pytest.raises(SettingsError, match="render_mode must be None or 'rgb_array'"):
        TrackingEnv(leg8, fast, render_mode="human")
    with pytest.raises(SettingsError, match="has no camera 'above': it has side"):
        TrackingEnv(leg8, fast, camera="above")
    with pytest.raises(SettingsError, match=r"width must be a number of pixels; got 1\.5"):
        TrackingEnv(leg8, fast, width=1.5)
    with pytest.raises(SettingsError, match="another motion or dt"):
        TrackingEnv(leg8, "slow", solution=bare)
    with pytest.raises(SettingsError, match="another motion or dt"):
        Expert.of(bare, TrackingTask(leg8, "slow"))
    with pytest.raises(SettingsError, match="a task is a TrackingTask; got str"):
        Episodes("leg8")
    with pytest.raises(SettingsError, match="a task is a TrackingTask; got Solution"):
        Expert.of(bare, bare)
    for seed in (-1, "a"):
        for make in () if dm is None else (lambda: dm.tracking(leg8, fast, random=seed),):  # noqa: B023 - called here
            with pytest.raises(SettingsError, match="random must be a seed, 0 or more, or a generator; got"):
                make()
    with pytest.raises(SettingsError, match="by integrator 'rk4', the task by 'euler'"):
        TrackingEnv(leg8, fast, solution=bare, integrator="euler")
    with pytest.raises(SettingsError, match=r"node 1 is at 0\.02 s, in the solution at 0\.01 s"):
        played_by_gym(TrackingEnv(leg8, fast, dt=0.02), Expert(bare.excitation, bare.time))


def test_a_root_that_muscles_would_have_to_carry_is_refused():
    model = mjhcmc.MuscleModel.load("leg8_gait").with_roles(tracked=["pelvis_ty"])
    with pytest.raises(SettingsError, match=r"no muscle holds pelvis_ty on .*with_roles\(prescribed="):
        TrackingTask(model, mjhcmc.Motion.cosine(model, amplitudes={"hip": 0.2}, period=0.5, cycles=1))


def test_what_is_cut_off_is_told(leg8, fast):
    with pytest.warns(MjhcmcWarning, match="the last 0.005 s are dropped"):
        task = TrackingTask(leg8, fast, dt=0.007)
    assert task.n_window == 85
    assert task.windows.n_step * task.settings.physics_dt == pytest.approx(0.007)


@pytest.mark.parametrize(
    ("module", "missing", "words"), [("gym", "gymnasium", "mjhcmc[learn]"), ("dm", "dm_control", "dm-control")]
)
def test_missing_libraries_are_named(monkeypatch, module, missing, words):
    monkeypatch.setitem(sys.modules, missing, None)
    monkeypatch.delitem(sys.modules, f"mjhcmc.environments.{module}", raising=False)
    with pytest.raises(SettingsError, match=re.escape(words)):
        __import__(f"mjhcmc.environments.{module}")

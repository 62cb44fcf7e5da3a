"""The task itself: bounds from both sides, slides, noise on tied joints, where episodes begin, the physics step."""

import pickle
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from conftest import PENDULUMS

import mjhcmc
from mjhcmc import MjhcmcWarning, SettingsError
from mjhcmc.environments import Episodes, TrackingTask, returns

dm = pytest.importorskip("mjhcmc.environments.dm") if sys.version_info < (3, 13) else None
needs_dm = pytest.mark.skipif(dm is None, reason="dm_control has no wheels for this Python")

LIFT = """
<mujoco model="lift">
  <option integrator="RK4"/>
  <worldbody>
    <site name="ceiling" pos="0 0 1"/>
    <body>
      <joint name="height" type="slide" axis="0 0 1" range="-.5 .5" limited="true"/>
      <geom type="sphere" size=".05" mass="2"/>
      <site name="hook"/>
      <body>
        <joint name="turn" type="hinge" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".5" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <tendon><spatial name="rope"><site site="ceiling"/><site site="hook"/></spatial></tendon>
  <actuator>
    <general name="pull" tendon="rope" dyntype="muscle" dynprm=".01 .04" gainprm="-100" ctrlrange="0 1"/>
    <general name="forth" joint="turn" dyntype="muscle" dynprm=".01 .04" gainprm="5" ctrlrange="0 1"/>
    <general name="back" joint="turn" dyntype="muscle" dynprm=".01 .04" gainprm="-5" ctrlrange="0 1"/>
  </actuator>
</mujoco>
"""
TIED = PENDULUMS.replace(
    "</worldbody>", '</worldbody><equality><joint joint1="elbow" joint2="shoulder" polycoef=".1 .5 .2 0 0"/></equality>'
)


def load(xml):
    return mjhcmc.MuscleModel.load(mujoco.MjSpec.from_string(xml), integrator="rk4")


def moved(state, by):
    return replace(state, qpos=state.qpos + np.asarray(by))


@pytest.fixture(scope="module")
def lift():
    model = load(LIFT)
    return model, mjhcmc.Motion.cosine(model, amplitudes={"height": 0.1, "turn": 0.5}, period=1.0, cycles=1)


def test_bounds_from_both_sides(leg8, lift):
    """Of hinges in rad, of slides in m, each its own; a bound without end is none."""
    task = TrackingTask(leg8, "slow", bound=0.2)
    _, state = task.first(np.random.default_rng(0))
    for joint in np.eye(3):
        for sign in (1, -1):
            assert not task.is_lost(0, moved(state, 0.199 * sign * joint))
            assert task.is_lost(0, moved(state, 0.201 * sign * joint))
    task = TrackingTask(*lift, bound=0.2, bound_slide=0.05)
    _, state = task.first(np.random.default_rng(0))
    for by, lost in (((0.049, 0.199), False), ((0.051, 0.0), True), ((0.0, 0.201), True), ((-0.051, 0.0), True)):
        assert task.is_lost(0, moved(state, by)) == lost
    task = TrackingTask(*lift, bound=np.inf, bound_slide=np.inf, noise=0.3)
    assert not task.is_lost(0, moved(state, (1e3, 1e3)))
    assert task.is_lost(0, moved(state, (np.nan, 0)))
    assert np.isfinite(task.first(np.random.default_rng(0))[1].qpos).all()


def test_slides_have_a_scale_of_their_own(lift):
    """exp(-mean((.01 / .05)^2, (.2 / .4)^2))."""
    task = TrackingTask(*lift, error_scale=0.4, error_scale_slide=0.05)
    _, state = task.first(np.random.default_rng(0))
    tracking, effort = task.terms(0, moved(state, (0.01, 0.2)))
    assert tracking == pytest.approx(np.exp(-(0.2**2 + 0.5**2) / 2))
    assert effort == pytest.approx((state.activation**2).mean())
    assert task.terms(0, state)[0] == 1.0


def test_noise_keeps_ties(tied):
    task = TrackingTask(*tied, noise=0.1)
    starts = np.array([task.first(np.random.default_rng(seed))[1].qpos for seed in range(5)])
    assert np.ptp(starts[:, 0]) > 0.05
    q = starts[:, 0]
    np.testing.assert_allclose(starts[:, 1], 0.1 + 0.5 * q + 0.2 * q**2, atol=1e-9)


def test_noise_is_half_a_bound_at_most(leg8):
    task = TrackingTask(leg8, "slow", noise=5.0, bound=0.1)
    most = [np.abs(task.tracking_error(0, task.first(np.random.default_rng(i))[1])).max() for i in range(5)]
    assert max(most) == pytest.approx(0.05)


@needs_dm
def test_dm_control_begins_on_the_motions_clock_and_ends_with_discount_1(leg8):
    motion = mjhcmc.Motion.cosine(leg8, "fast", cycles=1)
    motion = replace(motion, time=motion.time + 2.0)
    env = dm.tracking(leg8, motion, start="random", random=1, bound=np.inf)
    data, own = env.physics.data, env.task
    for _ in range(3):
        step = env.reset()
        assert own.node > 0
        assert data.time == own.task.time[own.node]
        while not step.last():
            step = env.step(np.full(8, 0.1))
            assert data.time == own.task.time[own.node]
        assert step.discount == 1.0
        assert own.node == own.task.n_window


@needs_dm
def test_a_led_physics_can_be_copied():
    """And goes its own way, as the first would have."""
    model = mjhcmc.MuscleModel.load("leg8_gait")
    env = dm.tracking(model, "slow")
    env.reset()
    for _ in range(3):
        env.step(np.full(8, 0.1))
    copy = env.physics.copy()
    before = env.physics.data.qpos.copy()
    copy.step(5)
    np.testing.assert_array_equal(env.physics.data.qpos, before)
    env.physics.step(5)
    np.testing.assert_array_equal(copy.data.qpos, env.physics.data.qpos)
    assert np.any(before != copy.data.qpos)
    with pytest.raises(SettingsError, match="cannot be pickled"):
        pickle.dumps(env.physics)


@pytest.fixture(scope="module")
def tied():
    """Two pendulums, one tied to the other: the constraint solver is at work, and starts from the last step's end."""
    model = load(TIED)
    return model, mjhcmc.Motion.cosine(model, amplitudes={"shoulder": 0.3}, period=1.0, cycles=1)


def test_to_look_at_muscles_changes_no_bit_of_an_episode(tied):
    ends = []
    for paths in (False, True):
        episodes = Episodes(TrackingTask(*tied, muscle_paths=paths, bound=np.inf))
        for _ in range(2):  # nor does the episode before
            episodes.reset(np.random.default_rng(0))
            np.testing.assert_array_equal(episodes.state.warmstart, 0)
            for _ in range(10):
                episodes.step(np.array([0.3, 0.1]))
            ends.append(np.concatenate([episodes.state.qpos, episodes.state.qvel, episodes.state.warmstart]))
    assert np.any(ends[0][-2:] != 0)
    for end in ends[1:]:
        np.testing.assert_array_equal(end, ends[0])


@needs_dm
def test_dm_control_begins_with_a_fresh_constraint_solver(tied):
    env = dm.tracking(*tied)
    for _ in range(2):
        env.reset()
        np.testing.assert_array_equal(env.physics.data.qacc_warmstart, 0)
        for _ in range(3):
            env.step(np.array([0.3, 0.1]))
        assert env.physics.data.qacc_warmstart.any()


def test_info_at_the_start_is_of_the_start(leg8):
    gym = pytest.importorskip("mjhcmc.environments.gym")
    env = gym.TrackingEnv(leg8, "fast")
    info = env.reset(seed=0)[1]
    assert info["tracking"] == 1.0
    assert info["effort"] == pytest.approx((env.state.activation**2).mean())
    assert info["effort"] > 0


@pytest.mark.parametrize("integrator", ["rk4", "euler", "implicitfast"])
def test_all_muscles_at_once_at_the_step_that_is_chosen(leg8, integrator):
    """The motion is that of steps a third as long (the leg8 at 1 ms under RK4 is degrees off)."""

    def positions(physics_dt):
        task = TrackingTask(leg8, "slow", physics_dt=physics_dt, integrator=integrator, bound=np.inf)
        episodes = Episodes(task)
        episodes.reset(np.random.default_rng(0))
        q = []
        for _ in range(30):
            episodes.step(np.ones(8))
            q.append(episodes.state.qpos)
        return task.settings.physics_dt, np.array(q)

    step, q = positions(None)
    off = np.rad2deg(np.abs(positions(step / 3)[1] - q).max())
    assert off < (0.001 if integrator == "rk4" else 1.0)  # the others are of first order
    assert (step == 1e-3) == (integrator == "implicitfast")


def test_a_step_too_long_for_active_muscles_is_told(leg8):
    """It is stable for the passive leg, and for one that is only somewhat active."""
    with pytest.warns(MjhcmcWarning, match=r"0\.001 s is unstable where all muscles .*: use physics_dt (\S+),") as told:
        task = TrackingTask(leg8, "slow", physics_dt=1e-3)
    assert task.settings.physics_dt == 1e-3
    assert "\n" not in str(told[0].message)
    step = float(str(told[0].message).split("use physics_dt ")[1].split(",")[0])
    TrackingTask(leg8, "slow", physics_dt=step)  # silent


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"n": 0}, "n must be a whole number, at least 1; got 0"),
        ({"seed": -1}, "seed must be a whole number, at least 0; got -1"),
        ({"policies": [np.zeros]}, "policies are functions by name"),
        ({"task": "x"}, "a task is a TrackingTask; got str"),
    ],
)
def test_returns_of_nothing(leg8, choices, words):
    given = {"task": TrackingTask(leg8, "fast"), "policies": {}, **choices}
    with pytest.raises(SettingsError, match=words):
        returns(given.pop("task"), given.pop("policies"), **given)

"""Quaternions of ball and free joints: closed forms of turning, MuJoCo's differences, bad input."""

import re

import mujoco
import numpy as np
import pytest
from conftest import load_xml
from numpy.testing import assert_allclose, assert_array_equal

import mjhcmc
from mjhcmc.lockstep import Lockstep
from mjhcmc.motion_on_model import path_of
from mjhcmc.plant import State
from mjhcmc.quaternions import turning, unit_quaternions
from mjhcmc.surroundings import Surroundings

TIME = np.linspace(0, 1, 401)

BALL_AND_HINGES = """
<mujoco model="ball">
  <option integrator="RK4"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <site name="o" pos=".2 .1 .6"/><site name="p" pos="-.2 .15 .6"/><site name="q" pos="0 -.2 .4"/>
    <body>
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom size=".05" mass="1"/>
      <body>
        <joint name="hip" type="ball" damping=".3"/>
        <geom type="capsule" fromto="0 0 0 .05 0 -.4" size=".03" mass="2"/><site name="s" pos=".05 0 -.2"/>
        <body pos=".05 0 -.4">
          <joint name="knee" axis="0 1 0" damping=".2" stiffness="2"/>
          <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass="1"/><site name="t" pos="0.04 0 -.1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="a"><site site="o"/><site site="s"/></spatial>
    <spatial name="b"><site site="p"/><site site="s"/></spatial>
    <spatial name="c"><site site="q"/><site site="t"/></spatial>
  </tendon>
  <actuator>
    <muscle tendon="a" force="300" lengthrange=".4 1"/><muscle tendon="b" force="300" lengthrange=".4 1"/>
    <muscle tendon="c" force="300" lengthrange=".4 1.2"/>
  </actuator>
</mujoco>
"""


@pytest.fixture(scope="module")
def ball():
    return load_xml(BALL_AND_HINGES)


def about(axis, angle):
    """(n, 4) quaternions of turning about an axis (3,) by angles (n,)."""
    angle = np.asarray(angle)
    axis = np.asarray(axis) / np.linalg.norm(axis)
    return np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * axis])


def product(a, b):
    """(n, 4) a b of quaternions."""
    found = np.empty_like(a)
    for row, x, y in zip(found, a, b, strict=True):
        mujoco.mju_mulQuat(row, x, y)
    return found


def moving(q, name="turn"):
    """A motion of a ball joint alone."""
    return mjhcmc.Motion(TIME, q, name, quaternions=(0,))


def test_turning_about_an_axis():
    """Angle w t + c t^2: angular velocity w + 2 c t, acceleration 2 c, about the axis."""
    axis, w, c = np.array([2.0, -1.0, 2.0]) / 3, 1.3, -0.7
    found = moving(about(axis, w * TIME + c * TIME**2)).sample(TIME)
    assert_allclose(found.qvel, (w + 2 * c * TIME)[:, None] * axis, atol=1e-9)
    assert_allclose(found.qacc, np.tile(2 * c * axis, (len(TIME), 1)), atol=1e-6)


def test_a_top_on_a_cone():
    """Precession p about z, spin s about the body's own axis, inclined by a: Euler's formulas in the body's axes."""
    a, p, s = 0.4, 2.0, 5.0
    zz, xx = about([0, 0, 1], p * TIME), about([1, 0, 0], np.full_like(TIME, a))
    q = product(product(zz, xx), about([0, 0, 1], s * TIME))
    found = moving(q).sample(TIME)
    cos, sin = np.cos(s * TIME), np.sin(s * TIME)
    rate = np.column_stack([p * np.sin(a) * sin, p * np.sin(a) * cos, np.full_like(TIME, p * np.cos(a) + s)])
    second = np.column_stack([p * s * np.sin(a) * cos, -p * s * np.sin(a) * sin, 0 * TIME])
    assert_allclose(found.qvel, rate, atol=1e-8)
    assert_allclose(found.qacc[5:-5], second[5:-5], atol=1e-5)
    assert_allclose(np.linalg.norm(found.qpos, axis=1), 1, atol=1e-15)


def test_derivatives_do_not_depend_on_the_quaternions_length():
    """Q times any function of time turns alike."""
    rng = np.random.default_rng(0)
    Q, rate, second = rng.normal(size=(3, 20, 4))
    f, df, ddf = 1.5 + rng.uniform(size=(20, 1)), rng.normal(size=(20, 1)), rng.normal(size=(20, 1))
    plain = turning(Q, rate, second, (0,))
    other = turning(f * Q, f * rate + df * Q, f * second + 2 * df * rate + ddf * Q, (0,))
    for x, y in zip(plain, other, strict=True):
        assert_allclose(x, y, rtol=1e-12, atol=1e-12)


def test_mujocos_differences_along_a_motion(ball):
    """Slide, ball and hinge: velocity by mj_differentiatePos over a small time, acceleration by velocities'."""
    q = product(about([1, 2, -1], 0.8 * np.sin(4 * TIME)), about([0, 1, 1], 0.5 * TIME**2))
    qpos = np.column_stack([0.2 * np.sin(3 * TIME), q, np.cos(2 * TIME)])
    motion = mjhcmc.Motion(TIME, qpos, "all").on(ball, ball.quaternions)
    t, h = np.linspace(0.1, 0.9, 17), 1e-4
    here, before, after = (motion.sample(at) for at in (t, t - h, t + h))
    v = np.empty((len(t), 5))
    for row, x, y in zip(v, before.qpos, after.qpos, strict=True):
        mujoco.mj_differentiatePos(ball.mj_model, row, 2 * h, x.copy(), y.copy())
    assert_allclose(here.qvel, v, atol=1e-6)
    assert_allclose(here.qacc, (after.qvel - before.qvel) / (2 * h), atol=1e-5)


def test_the_path_is_the_motion(ball):
    q = product(about([1, 2, -1], 0.8 * np.sin(4 * TIME)), about([0, 1, 1], 0.5 * TIME**2))
    qpos = np.column_stack([0.2 * np.sin(3 * TIME), q, np.cos(2 * TIME)])
    motion = mjhcmc.Motion(TIME + 0.4, qpos, "all").on(ball, ball.quaternions)
    t = np.sort(np.random.default_rng(1).uniform(0.4, 1.4, 200))
    wanted = motion.sample(t)
    for found, own, size in zip(
        path_of(motion)(t), (wanted.qpos, wanted.qvel, wanted.qacc), (1, 1e2, 1e4), strict=True
    ):
        assert_allclose(found, own, rtol=0, atol=1e-12 * size)


def test_signs_that_jump_are_no_movement():
    q = about([0, 1, 0], 3 * TIME)
    jumping = q * np.where(np.arange(len(TIME)) % 7 < 3, -1, 1)[:, None]
    found, plain = moving(jumping), moving(-q)
    assert_allclose(found.qpos, plain.qpos, atol=1e-15)
    assert_allclose(found.sample(TIME).qvel, plain.sample(TIME).qvel, atol=1e-9)


def test_lengths_near_one_are_made_one():
    q = about([0, 1, 0], 3 * TIME)
    rows = unit_quaternions("m", TIME, 1.03 * q, (0,))
    assert_allclose(rows, q, atol=1e-15)
    assert not rows.flags.writeable


@pytest.mark.parametrize(("factor", "length"), [(0.0, "0"), (0.9, "0.9"), (1.2, "1.2")])
def test_other_lengths_are_refused(factor, length):
    q = about([0, 1, 0], 3 * TIME)
    q[100] *= factor
    message = f"turn: the quaternion in columns 0..3 of qpos has length {length} at 0.25 s: give unit quaternions"
    with pytest.raises(mjhcmc.MotionError, match=re.escape(message)):
        moving(q)


def test_differences_and_ways_on_any_joints(ball):
    """`moved` undoes `difference`; stacks of rows are taken one by one."""
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 3, 4, 6))
    for q in (a, b):
        q[..., 1:5] /= np.linalg.norm(q[..., 1:5], axis=-1, keepdims=True)
    way = ball.coordinates.difference(b, a)
    assert way.shape == (3, 4, 5)
    end = ball.coordinates.moved(a, way)
    end[..., 1:5] *= np.sign((end[..., 1:5] * b[..., 1:5]).sum(axis=-1, keepdims=True))
    assert_allclose(end, b, atol=1e-12)
    assert_array_equal(ball.coordinates.difference(b[0, 0], a[0, 0]), way[0, 0])


def test_stiffness_and_damping_with_a_ball_joint(ball):
    """Against central differences of MuJoCo's smooth forces along velocities of each degree of freedom."""
    m, rng = ball.mj_model, np.random.default_rng(0)
    q = rng.normal(size=6)
    q[1:5] /= np.linalg.norm(q[1:5])
    state = State(0.0, q, rng.normal(size=5), rng.uniform(size=3), np.zeros(5))
    d = mujoco.MjData(m)

    def force(qpos, qvel):
        d.qpos[:], d.qvel[:], d.act[:] = qpos, qvel, state.activation
        mujoco.mj_forward(m, d)
        return d.qfrc_smooth.copy()

    K, D, h = np.empty((5, 5)), np.empty((5, 5)), 1e-6
    for j, e in enumerate(np.eye(5)):
        ends = ball.coordinates.moved(np.tile(q, (2, 1)), h * np.array([-e, e]))
        K[:, j] = (force(ends[0], state.qvel) - force(ends[1], state.qvel)) / (2 * h)
        D[:, j] = (force(q, state.qvel - h * e) - force(q, state.qvel + h * e)) / (2 * h)
    plants = Lockstep([ball], 1e-3, [Surroundings()])
    found = plants.linearize(np.arange(1), plants.rows([state]), np.zeros((1, 5)), stiffness=True)
    assert_allclose(found.D[0], D, atol=1e-4)
    assert_allclose(found.K[0], K, atol=1e-3)

"""Joint reactions: closed forms, Newton and Euler, and virtual work on a cut model."""

import dataclasses
import warnings
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from conftest import load_xml
from many_muscles import chain, swing
from numpy.testing import assert_allclose, assert_array_equal
from probes import reactions_by_virtual_work
from recorded import recorded, reserve_at_nodes
from riders import PLANAR, RIDER

import mjhcmc
from mjhcmc import MujocoPlant
from mjhcmc.detail import detail_of
from mjhcmc.leg8 import leg8_xml
from mjhcmc.plant import State
from mjhcmc.plotting import moment_figure
from mjhcmc.reactions import joint_reactions
from mjhcmc.surroundings import Surroundings

GRAVITY = np.array([0, 0, -9.81])

EVERYTHING = """
<mujoco model="everything">
  <option integrator="RK4" gravity="1 -2 -9.81">{flag}</option>
  <compiler angle="radian"/>
  <worldbody>
    <site name="a" pos=".1 .03 .1"/><site name="a2" pos="-.1 .03 .1"/>
    <body name="upper" pos=".2 .1 .3" euler=".3 .2 .1">
      <joint name="slide" type="slide" axis="1 0 .2" stiffness="20" damping="3"/>
      <joint name="hinge" axis="0 -1 0" pos=".01 .02 .03" range="-1 .1" limited="true"/>
      <joint name="roll" axis="1 0 .3" stiffness="4" damping=".2" frictionloss=".1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="2" contype="0" conaffinity="0"/>
      <site name="b" pos=".05 0 -.1"/><site name="c" pos=".05 .01 -.15"/><site name="side" pos=".1 0 -.3"/>
      <geom name="wrap" type="cylinder" pos="0 0 -.3" size=".03 .1" euler="1.57 0 0" contype="0" conaffinity="0"/>
      <body name="lower" pos="0 0 -.3" gravcomp=".5">
        <joint name="elbow" axis="0 -1 .1" armature=".01"/>
        <geom type="capsule" fromto="0 0 0 .05 .02 -.25" size=".025" mass="1" contype="0" conaffinity="0"/>
        <site name="d" pos=".05 .02 -.08"/><site name="e" pos="0 .02 -.2"/>
        <body name="welded" pos="0 0 -.25">
          <geom type="box" size=".05 .02 .02" mass=".4" contype="0" conaffinity="0"/>
          <site name="f" pos=".04 0 0"/>
          <body name="hand" pos=".05 0 0">
            <joint name="wrist" axis="1 1 0" pos="0 .02 .01"/>
            <geom type="box" size=".05 .02 .02" mass=".3" contype="0" conaffinity="0"/>
            <site name="g" pos=".03 0 0"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="sprung" damping="20 3 2" stiffness="300 100 50" springlength=".1 .2">
      <site site="a"/><site site="b"/><site site="d"/>
    </spatial>
    <spatial name="wrapped" damping="1"><site site="c"/><geom geom="wrap" sidesite="side"/><site site="e"/></spatial>
    <spatial name="branched">
      <site site="a2"/><site site="b"/><pulley divisor="2"/><site site="b"/><geom geom="wrap"/><site site="e"/>
      <pulley divisor="3"/><site site="c"/><site site="f"/><site site="g"/>
    </spatial>
    <spatial name="ligament" limited="true" range=".01 .2"><site site="b"/><site site="g"/></spatial>
    <spatial name="strut" limited="true" range=".9 2" frictionloss="3"><site site="a"/><site site="g"/></spatial>
    <fixed name="fixed" stiffness="3"><joint joint="roll" coef="1"/><joint joint="elbow" coef="-.5"/></fixed>
  </tendon>
  <actuator>
    <muscle name="m1" tendon="sprung" force="400" lengthrange=".05 .6" ctrlrange="0 1"/>
    <muscle name="m2" tendon="wrapped" force="200" lengthrange=".1 .7" ctrlrange="0 1" gear="2"/>
    <muscle name="m3" tendon="branched" force="200" lengthrange=".05 .9" ctrlrange="0 1"/>
    <muscle name="m4" joint="wrist" force="20" lengthrange="-1 1" ctrlrange="0 1"/>
    <general name="m5" tendon="branched" dyntype="muscle" dynprm=".01 .04" gaintype="fixed" gainprm="-10"
             biastype="none" ctrlrange="0 1" damping="5"/>
    {more}
  </actuator>
</mujoco>
"""
NO_CONSTRAINTS = '<flag constraint="disable"/>'

PENDULUM = """
<mujoco model="pendulum">
  <option integrator="RK4" gravity="0 0 -9.81"/>
  <worldbody>
    <site name="wall" pos=".3 0 0"/>
    <body name="rod" pos="0 0 1">
      <joint name="pivot" axis="0 -1 0" damping="{damping}"/>
      <geom type="sphere" size=".05" pos="0 0 -.5" mass="2" contype="0" conaffinity="0"/>
      <site name="hook" pos="0 0 -1"/>
    </body>
  </worldbody>
  <tendon><spatial name="line"><site site="wall"/><site site="hook"/></spatial></tendon>
  <actuator>
    <general name="pull" tendon="line" dyntype="muscle" dynprm=".01 .04" gaintype="fixed" gainprm="-100"
             biastype="none" ctrlrange="0 1" ctrllimited="true"/>
  </actuator>
</mujoco>
"""


def random_state(model, seed, scale=0.4):
    rng = np.random.default_rng(seed)
    qpos, qvel = rng.normal(size=model.nv) * scale, rng.normal(size=model.nv) * 2
    return {"qpos": qpos, "qvel": qvel, "activation": rng.uniform(size=model.n_muscle)}, rng.normal(size=model.nv)


@pytest.mark.parametrize("angle", [0.0, 0.7])
@pytest.mark.parametrize("activation", [0.0, 0.8])
def test_a_pendulum_held_still(angle, activation):
    """A reserve holds it: the pivot bears weight less pull, and of the moment what the reserve gives."""
    model = load_xml(PENDULUM.format(damping=0.0))
    hook, mass, wall = np.array([np.sin(angle), 0, 1 - np.cos(angle)]), np.zeros(3), np.array([0.3, 0, 0])
    mass[:] = 0.5 * np.sin(angle), 0, 1 - 0.5 * np.cos(angle)
    pull = 100 * activation * (wall - hook) / np.linalg.norm(wall - hook)
    pivot = np.array([0, 0, 1])
    need = -np.cross(mass - pivot, 2 * GRAVITY) - np.cross(hook - pivot, pull)
    solution = recorded(model, [[angle]] * 2, activation=activation, reserve=-need[1])  # the axis is -y
    assert_allclose(solution.detail.joint_reaction_force[:, 0], [-2 * GRAVITY - pull] * 2, atol=1e-10)
    assert_allclose(solution.detail.joint_reaction_moment[:, 0], [need] * 2, atol=1e-10)


def test_a_swinging_pendulum_pulls_inwards():
    """m v^2/r along the rod; the damper's moment is the joint's, a frictionless hinge bears none."""
    for damping in (0.0, 0.5):
        detail = recorded(load_xml(PENDULUM.format(damping=damping)), [[0.0], [0.0]], qvel=[3.0]).detail
        assert_allclose(detail.joint_reaction_force[0, 0, 2], 2 * 9.81 + 2 * 3.0**2 * 0.5)
        assert_allclose(detail.joint_reaction_moment[0, 0] @ [0, -1, 0], -damping * 3.0, atol=1e-12)


def test_reactions_by_virtual_work_on_the_leg(fast_solution):
    for k in (0, 7, 20, 33, 60):
        state = fast_solution.qpos[k], fast_solution.qvel[k], fast_solution.activation[k]
        force, moment = reactions_by_virtual_work(leg8_xml(), *state, reserve_at_nodes(fast_solution)[k])
        assert_allclose(fast_solution.detail.joint_reaction_force[k], force, atol=1e-6)
        assert_allclose(fast_solution.detail.joint_reaction_moment[k], moment, atol=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_reactions_by_virtual_work_with_everything(seed):
    """Wraps, pulleys, springs, gears, slides, several joints in a body, gravity compensation; no constraints."""
    xml = EVERYTHING.format(flag=NO_CONSTRAINTS, more="")
    model = load_xml(xml)
    state, applied = random_state(model, seed)
    solution = recorded(model, [state["qpos"]] * 2, state["qvel"], state["activation"], applied)
    force, moment = reactions_by_virtual_work(xml, *state.values(), applied)
    assert_allclose(solution.detail.joint_reaction_force[0], force, atol=1e-7 * np.abs(force).max())
    assert_allclose(solution.detail.joint_reaction_moment[0], moment, atol=1e-7 * np.abs(force).max())


@pytest.mark.parametrize("seed", range(6))
def test_along_its_axis_a_joint_transmits_only_what_acts_on_its_coordinate(seed):
    """With limits of joints and tendons and friction at work as well."""
    model = load_xml(EVERYTHING.format(flag="", more=""))
    state, applied = random_state(model, seed)
    plant = MujocoPlant(model)
    plant.set_state(State(0.0, *state.values(), np.zeros(model.nv)))
    plant.set_input(None, applied)
    plant.forward()
    m, d = plant.mj_model, plant.mj_data
    own = applied - m.jnt_stiffness * d.qpos - m.dof_damping * d.qvel - m.dof_armature * d.qacc
    own[model.joint_names.index("wrist")] += d.actuator_force[model.muscle_names.index("m4")]
    own += 3 * d.ten_length[-1] * np.array([0, 0, -1, 0.5, 0])
    kinds = mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF, mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
    at_joints = np.where(np.isin(d.efc_type, [int(kind) for kind in kinds]), d.efc_force, 0.0)
    at_tendons = d.efc_force - at_joints
    assert np.count_nonzero(at_tendons) >= 2  # a limit and the friction
    result = np.empty(model.nv)
    mujoco.mj_mulJacTVec(m, d, result, at_joints)
    force, moment = joint_reactions(plant)
    along = np.where(model.joint_is_rotation, (moment * d.xaxis).sum(axis=1), (force * d.xaxis).sum(axis=1))
    assert_allclose(along, own + result, atol=1e-9 * np.abs(moment).max())


def test_the_hinges_of_the_leg_bear_no_moment_about_their_axes_but_the_reserve(fast_solution):
    overloaded = swing(chain(4, 24, force=15.0))
    for solution in (fast_solution, overloaded):
        damping = solution.model.mj_model.dof_damping * solution.qvel
        along = -solution.detail.joint_reaction_moment[:, :, 1]  # the axes are -y
        assert_allclose(along, reserve_at_nodes(solution) - damping, atol=1e-10)


def pull_on(plant, inside, tension):
    """Force (3,) and moment about the origin (3,) of all paths on a set of bodies, straight from the path points."""
    m, d = plant.mj_model, plant.mj_data
    points, kinds = d.wrap_xpos.reshape(-1, 3), d.wrap_obj.ravel()
    force, moment = np.zeros(3), np.zeros(3)
    for t in range(m.ntendon):
        path = range(d.ten_wrapadr[t], d.ten_wrapadr[t] + d.ten_wrapnum[t])
        on = [
            m.geom_bodyid[kinds[i]] if kinds[i] >= 0
            else m.site_bodyid[np.argmin(np.linalg.norm(d.site_xpos - points[i], axis=1))]
            for i in path
        ]  # fmt: skip
        for i, (a, b) in enumerate(pairwise(on)):
            if (a in inside) != (b in inside):
                p, q = points[path[i]], points[path[i + 1]]
                p, q = (p, q) if a in inside else (q, p)
                pull = tension[t] * (q - p) / np.linalg.norm(q - p)
                force += pull
                moment += np.cross(p, pull)
    return force, moment


def test_newton_and_euler_along_the_fast_movement(fast_solution):
    """Rate of momentum beyond each joint, by steps of 10 us, = reaction + weight + what the paths pull across."""
    solution, step = fast_solution, 1e-5
    plant = MujocoPlant(solution.model, step)
    m, d = plant.mj_model, plant.mj_data
    inside = {j: [b for b in range(m.nbody) if hangs_on(m, b, m.jnt_bodyid[j])] for j in range(m.njnt)}
    for k in range(0, 60, 11):
        state = State(0.0, solution.qpos[k], solution.qvel[k], solution.activation[k], np.zeros(m.nv))
        plant.set_state(state)
        momenta = []
        for n_step in (0, 1, 1):
            plant.advance(solution.excitation[k], solution.reserve[k], n_step)
            plant.forward()
            mujoco.mj_subtreeVel(m, d)
            momenta.append([momentum(m, d, m.jnt_bodyid[j]) for j in range(m.njnt)])
        first, second, third = np.array(momenta)
        rate = (-3 * first + 4 * second - third) / (2 * step)
        plant.set_state(state)
        plant.set_input(None, solution.reserve[k])
        plant.forward()
        for j in range(m.njnt):
            force, moment = pull_on(plant, inside[j], solution.muscle_force[k])
            mass, at = m.body_subtreemass[m.jnt_bodyid[j]], d.subtree_com[m.jnt_bodyid[j]]
            reaction = solution.detail.joint_reaction_force[k, j]
            force += reaction + mass * m.opt.gravity
            moment += solution.detail.joint_reaction_moment[k, j] + np.cross(d.xanchor[j], reaction)
            moment += np.cross(at, mass * m.opt.gravity)
            assert_allclose(rate[j], [force, moment], atol=1e-3)


def hangs_on(m, body, root):
    while body > root:
        body = m.body_parentid[body]
    return body == root


def momentum(m, d, body):
    """Linear momentum and angular momentum about the origin of a subtree."""
    linear = m.body_subtreemass[body] * d.subtree_linvel[body]
    return np.array([linear, d.subtree_angmom[body] + np.cross(d.subtree_com[body], linear)])


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (
            ("{more}", '<general name="thrust" site="e" dyntype="muscle" dynprm=".01 .04" gainprm="30"/>'),
            "'thrust' acts on a site",
        ),
        (('mass="2"', 'mass="2" fluidshape="ellipsoid"'), "move in a medium"),
        (('name="sprung"', 'name="sprung" armature=".1"'), "a tendon has armature"),
    ],
)
def test_what_acts_on_bodies_at_a_place_not_followed_leaves_reactions_unknown(change, found):
    xml = EVERYTHING.replace(*change)
    if "medium" in found:
        xml = xml.replace("<option ", '<option density="1000" ')
    model = load_xml(xml.format(flag=NO_CONSTRAINTS, more=""))
    detail = detail_of(recorded(model, np.zeros((2, 5))))
    with pytest.warns(mjhcmc.MjhcmcWarning, match=rf"model 'everything': joint reactions are not known.*{found}"):
        force = detail.joint_reaction_force
    assert np.isnan(force).all()
    assert np.isnan(detail.joint_reaction_moment).all()
    assert np.isfinite(detail.muscle_moment).all()


@pytest.fixture
def loaded(fast_solution):
    """Under a load from outside, as joint moments given by a user leave it."""
    around = Surroundings(external=lambda times: np.full((len(times), 3), 3.0))
    load = np.full_like(fast_solution.net_joint_moment, 3.0)
    return dataclasses.replace(fast_solution, external_load=load, surroundings=around)


def test_generalized_loads_from_outside_leave_reactions_unknown_and_nothing_else(fast_solution, loaded):
    detail = loaded.detail
    with pytest.warns(mjhcmc.MjhcmcWarning, match="where the loads from outside act on the bodies is not recorded"):
        force = detail.joint_reaction_force
    assert np.isnan(force).all()
    assert np.isnan(detail.joint_reaction_moment).all()
    assert_array_equal(detail.muscle_moment, fast_solution.detail.muscle_moment)


def test_loads_of_a_solution_that_does_not_know_where_they_act_leave_reactions_unknown(loaded):
    with pytest.warns(mjhcmc.MjhcmcWarning, match="where the loads from outside act on the bodies is not recorded"):
        assert np.isnan(dataclasses.replace(loaded, surroundings=None).detail.joint_reaction_force).all()


def test_joints_prescribed_along_a_path_that_is_not_known_leave_reactions_unknown():
    """Without the path the base would fall, and nothing would hang on it."""
    model = load_xml(RIDER.format(root=PLANAR))
    time = np.linspace(0, 0.3, 61)
    qpos = np.column_stack([0.5 * time, 0.02 * np.cos(11 * time), 0 * time, 0.3 * np.sin(5 * time), -0.4 + time])
    solution = mjhcmc.hcmc(model, mjhcmc.Motion(time, qpos))
    assert np.isfinite(solution.detail.joint_reaction_force).all()
    with pytest.warns(mjhcmc.MjhcmcWarning, match="joint reactions are not known"):
        assert np.isnan(dataclasses.replace(solution, surroundings=None).detail.joint_reaction_force).all()


@pytest.mark.parametrize("name", ["joint_reaction_force", "joint_reaction_moment"])
def test_the_notice_comes_once_and_where_reactions_are_read(loaded, name):
    detail = loaded.detail
    with pytest.warns(mjhcmc.MjhcmcWarning) as told:
        getattr(detail, name)
    assert [notice.filename for notice in told] == [__file__]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(detail.joint_reaction_force).all()
        assert np.isnan(detail.joint_reaction_moment).all()


def test_who_does_not_ask_for_reactions_hears_nothing_of_them(loaded):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isfinite(loaded.detail.muscle_power).all()
        assert moment_figure(loaded).axes

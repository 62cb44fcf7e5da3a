"""The models of myo-sim along small motions; and what users' own models hold: equalities, balls, motors, clamps."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from myo_models import myo_model

import mjhcmc
from mjhcmc import MjhcmcWarning, Motion, MotionError, MuscleModel, SimulationError
from mjhcmc.coupling import Coupling
from mjhcmc.surroundings import coordinates_of

pytestmark = [
    pytest.mark.filterwarnings("ignore:Attaching a spec"),
    pytest.mark.filterwarnings("ignore:model .* MuJoCo would step it by"),
]


def myo(name):
    return MuscleModel.load(myo_model(name))


def cosine(model, amplitudes, period=1.2, elsewhere=None):
    """A cosine movement, degrees; elsewhere: joints that stay off the reference pose."""
    motion = Motion.cosine(model, amplitudes={j: np.deg2rad(a) for j, a in amplitudes.items()}, period=period, cycles=1)
    qpos = motion.qpos.copy()
    for joint, angle in (elsewhere or {}).items():
        qpos[:, model.joint_names.index(joint)] += np.deg2rad(angle)
    return replace(motion, qpos=qpos)


def largest_error(solution, role="tracked"):
    """Degrees (or m) over all degrees of freedom of a role."""
    of = [own == role for own in solution.roles]
    scale = np.where(solution.dof_is_rotation, 180 / np.pi, 1.0)
    return float(np.abs(solution.tracking_error * scale)[:, of].max(initial=0.0))


def told(solution):
    """Whether every reserve that counts has its joint in the verdict."""
    share = np.abs(solution.reserve).max(axis=0) / np.maximum(solution.peak_moment, 1e-3)
    return {
        name for name, part in zip(solution.dof_names, share, strict=True) if part > 1e-3
    } <= {line.split(":")[0] for line in solution.verdict.findings}  # fmt: skip


def test_legs():
    model = myo("myolegs")
    motion = cosine(model, {"hip_flexion_r": 25, "knee_angle_r": 40, "ankle_angle_r": 10})
    solution = mjhcmc.hcmc(model, replace(motion, span=(0, 0.5)), 0.005)
    assert largest_error(solution) <= 0.01
    assert not solution.status.any()  # no window needed a reserve
    # the root was not named: it stays at the reference pose, held by a force that is told
    root = solution.is_root
    assert root.sum() == 6
    assert set(np.array(solution.roles)[root]) == {"prescribed"}
    np.testing.assert_allclose(solution.qpos[:, :7], np.tile(model.qpos_reference[:7], (len(solution.time), 1)), atol=0)
    weight = model.mj_model.body_mass.sum() * 9.81
    assert solution.residual[0, 2] == pytest.approx(weight, rel=0.02)
    # the patella and the knee's slides keep to their polynomials, as far as the engine's soft equalities do
    polynomials = Coupling(model.mj_model, model.roles).project(solution.qpos)
    assert np.abs(solution.qpos - polynomials).max() < 3e-3
    tied = coordinates_of(model.mj_model, model.roles.dependent)
    assert np.ptp(solution.qpos[:, tied], axis=0).max() > 0.1


SMALL = {
    "myoelbow": ({"r_elbow_flex": 60}, {}),
    "myohand": ({"flexion_r": 10}, {}),
    "myoarm": ({"elbow_flexion_r": 20}, {"shoulder_elv_r": 10}),  # at 0 the humerus is in the thorax
    "myotorso": ({"flex_extension": -15, "lat_bending": 5, "axial_rotation": 10}, {}),
}


TOLD = ("myoelbow",)  # a replay of the others takes long


@pytest.mark.parametrize("name", SMALL)
def test_upper_body(name):
    model = myo(name)
    amplitudes, elsewhere = SMALL[name]
    solution = mjhcmc.hcmc(model, replace(cosine(model, amplitudes, elsewhere=elsewhere), span=(0, 0.5)), 0.01)
    assert largest_error(solution) <= 0.02
    if len(model.roles.tracked) <= 3:  # in hands, one-way muscles leave some mN m to reserves
        assert not solution.status.any()
    if name in TOLD:
        assert told(solution)


def test_the_arm_where_nothing_moves_a_joint_and_bones_overlap():
    model = myo("myoarm")
    with pytest.warns(MjhcmcWarning, match=r"humerus.*thorax.*'shoulder_elv_r'.*muscles have"):
        solution = mjhcmc.hcmc(model, cosine(model, {"elbow_flexion_r": 5}, 0.05), 0.01, physics_dt=2.5e-4)
    assert not solution.verdict.passed
    assert told(solution)
    assert any(f.startswith("elv_angle_r: reserve") for f in solution.verdict.findings)


def test_the_finger_with_forces_a_hundredfold():
    model = myo("myofinger")
    with pytest.warns(MjhcmcWarning, match="diverged.*solved again"):
        solution = mjhcmc.hcmc(model, cosine(model, {"IFmcp": 20, "IFpip": 20, "IFdip": 15}), 0.005)
    assert largest_error(solution) <= 0.02
    assert told(solution)


def test_a_path_that_moves_with_the_knee():
    model = myo("myolegs26")
    solution = mjhcmc.hcmc(model, cosine(model, {"hip_flexion_r": 3, "knee_angle_r": -5}, 0.3), 0.005)
    assert largest_error(solution) <= 0.02
    assert not solution.status.any()


def test_a_socket_too_stiff_for_the_step_is_refused_with_one_that_works():
    model = myo("myolegs_osl")
    motion = cosine(model, {"hip_flexion_l": 0.3, "knee_angle_l": 0.3}, 0.06)
    with pytest.raises(SimulationError, match=r"unstable under its damping .*use physics_dt <= ") as caught:
        mjhcmc.hcmc(model, motion, 0.005)
    works = float(str(caught.value).rsplit("<=", 1)[1])
    assert works < 1e-3
    solution = mjhcmc.hcmc(model, motion, 0.005, physics_dt=works)
    assert largest_error(solution) <= 0.02
    weak = {f.split(":")[0] for f in solution.verdict.findings if "no strength" in f or "no muscle moves it" in f}
    assert {"socket_piston", "osl_ankle_angle_r"} <= weak


# Users' own models

LINKS = """
<mujoco model="links">
  <option integrator="RK4"/>
  <default><geom type="capsule" size=".02" contype="0" conaffinity="0"/></default>
  <worldbody>
    {floor}
    <body name="base">{root}
      <geom fromto="0 0 0 0 0 .1" mass="5"/>
      <site name="front" pos=".1 0 0"/><site name="back" pos="-.1 0 0"/>
      <site name="left" pos="0 .1 0"/><site name="right" pos="0 -.1 0"/>
      <body name="thigh">
        <joint name="{first}" {kind}/>
        <geom fromto="0 0 0 0 0 -.3" mass="2"/>
        <site name="f1" pos=".03 0 -.15"/><site name="b1" pos="-.03 0 -.15"/>
        <site name="l1" pos="0 .03 -.15"/><site name="r1" pos="0 -.03 -.15"/>
        <site name="f2" pos=".04 0 -.2"/><site name="b2" pos="-.04 0 -.2"/>
        <site name="t1" pos=".03 .03 -.2"/><site name="t2" pos="-.03 -.03 -.2"/>
        <body name="shank" pos="0 0 -.3">
          <joint name="knee" axis="0 -1 0" damping=".2" range="-100 100"/>
          <geom name="foot" fromto="0 0 0 0 0 -.25" mass="1" {collides}/>
          <site name="f3" pos=".04 0 -.08"/><site name="b3" pos="-.04 0 -.08"/>
          <site name="tip" pos="0 0 -.25"/>
        </body>
      </body>
      {more}
    </body>
  </worldbody>
  <tendon>
    <spatial name="tf"><site site="front"/><site site="f1"/></spatial>
    <spatial name="tb"><site site="back"/><site site="b1"/></spatial>
    <spatial name="tl"><site site="left"/><site site="l1"/></spatial>
    <spatial name="tr"><site site="right"/><site site="r1"/></spatial>
    <spatial name="ts"><site site="left"/><site site="t2"/></spatial>
    <spatial name="tt"><site site="right"/><site site="t1"/></spatial>
    <spatial name="kf"><site site="f2"/><site site="f3"/></spatial>
    <spatial name="kb"><site site="b2"/><site site="b3"/></spatial>
    {tendons}
  </tendon>
  {equality}
  <actuator>{muscles}{motors}</actuator>
</mujoco>
"""
TENDONS = ("tf", "tb", "tl", "tr", "ts", "tt", "kf", "kb")
HINGE, BALL = 'axis="0 -1 0" damping=".2" range="-100 100"', 'type="ball" damping=".2"'


def links(first="hip", kind=HINGE, of_muscle="", **parts):
    muscles = "".join(
        f'<muscle name="{t}" tendon="{t}" force="600" lengthrange=".02 .4" ctrlrange="0 1" {of_muscle}/>'
        for t in TENDONS
        if kind == BALL or t in ("tf", "tb", "kf", "kb")
    )
    blank = dict.fromkeys(("floor", "root", "collides", "more", "tendons", "equality", "motors"), "")
    text = LINKS.format(first=first, kind=kind, muscles=muscles, **(blank | parts))
    return MuscleModel.load(mujoco.MjModel.from_xml_string(text))


def test_a_tendon_equality():
    model = links(
        more='<body pos=".3 0 0"><joint name="pulley" axis="0 1 0" damping=".01"/>'
        '<geom fromto="0 0 0 0 0 -.1" mass=".2"/></body>',
        tendons='<fixed name="belt"><joint joint="knee" coef="1"/><joint joint="pulley" coef="-.5"/></fixed>',
        equality='<equality><tendon tendon1="belt" solimp=".99 .999 .001"/></equality>',
    )
    assert len(model.roles.dependent) == 1
    solution = mjhcmc.hcmc(model, cosine(model, {"knee": 20}, 0.4), 0.005)
    assert largest_error(solution) <= 0.02
    knee, pulley = (model.joint_names.index(j) for j in ("knee", "pulley"))
    np.testing.assert_allclose(solution.qpos[:, knee], 0.5 * solution.qpos[:, pulley], atol=1e-3)
    assert np.ptp(solution.qpos[:, pulley]) > np.deg2rad(30)


def test_a_loop_that_a_connect_closes():
    model = links(
        more='<body pos=".15 0 0"><joint name="rod1" axis="0 -1 0"/><geom fromto="0 0 0 0 0 -.3" mass=".2"/>'
        '<body name="rod" pos="0 0 -.3"><joint name="rod2" axis="0 -1 0"/>'
        '<geom fromto="0 0 0 -.15 0 -.05" mass=".1"/></body></body>',
        equality='<equality><connect body1="rod" body2="shank" anchor="-.15 0 -.05"/></equality>',
    )  # fmt: skip
    assert len(model.roles.dependent) == 2
    solution = mjhcmc.hcmc(model, cosine(model, {"knee": 10}, 0.4), 0.005)
    assert largest_error(solution) <= 0.02
    m, d = model.mj_model, mujoco.MjData(model.mj_model)
    rod, shank = (mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, name) for name in ("rod", "shank"))
    for q in solution.qpos[::8]:
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        ends = [
            d.xpos[b] + d.xmat[b].reshape(3, 3) @ at for b, at in ((rod, [-0.15, 0, -0.05]), (shank, [0, 0, -0.05]))
        ]
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-3)


def turned(axis, angle):
    """Unit quaternions (n, 4) of rotations about an axis, rad."""
    axis = np.asarray(axis) / np.linalg.norm(axis)
    return np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * axis])


def test_a_ball_joint_is_tracked():
    model = links(first="hip", kind=BALL)
    t = np.linspace(0, 0.6, 121)
    angle = np.deg2rad(8) * np.sin(np.pi * t / 0.6) ** 2
    qpos = np.zeros((len(t), model.nq))
    qpos[:, :4] = turned([0.4, -1, 0.2], angle)
    qpos[:, 4] = angle
    solution = mjhcmc.hcmc(model, Motion(t, qpos), 0.005)
    assert solution.roles == ("tracked",) * 4
    assert largest_error(solution) <= 0.02
    np.testing.assert_allclose(np.linalg.norm(solution.qpos[:, :4], axis=1), 1, atol=1e-12)
    assert told(solution)


def test_a_free_root_goes_along_its_motion():
    model = links(root='<freejoint name="root"/>')
    t = np.linspace(0, 0.6, 121)
    s = np.sin(np.pi * t / 0.6) ** 2
    qpos = np.zeros((len(t), model.nq))
    qpos[:, :3] = np.outer(s, [0.1, -0.05, 0.08])
    qpos[:, 3:7] = turned([1, 2, 3], 0.6 * s)
    qpos[:, 7:] = np.outer(s, [0.3, -0.4])
    solution = mjhcmc.hcmc(model, Motion(t, qpos), 0.005)
    assert solution.roles == ("prescribed",) * 6 + ("tracked",) * 2
    assert largest_error(solution) <= 0.02
    assert largest_error(solution, "prescribed") <= 1e-6
    np.testing.assert_allclose(solution.qpos[:, :7], solution.qpos_desired[:, :7], atol=1e-9)
    # what carries the root is Newton's law for the whole: sum of forces = m (a - g) of the centre of mass
    m, d = model.mj_model, mujoco.MjData(model.mj_model)
    com = []
    for q in solution.qpos:
        d.qpos[:] = q
        mujoco.mj_fwdPosition(m, d)
        com.append(d.subtree_com[0].copy())
    com = np.array(com)
    acceleration = (com[2:] - 2 * com[1:-1] + com[:-2]) / solution.dt**2
    force = m.body_mass.sum() * (acceleration - m.opt.gravity)
    np.testing.assert_allclose(solution.residual[1:-1, :3], force, atol=0.01 * np.abs(force).max())


def test_motors_keep_to_their_control():
    plain, helped = links(), links(motors='<motor name="push" joint="knee" gear="2"/>')
    motion = cosine(plain, {"hip": 15, "knee": 20}, 0.6)
    free, with_motor = mjhcmc.hcmc(plain, motion, 0.005), mjhcmc.hcmc(helped, motion, 0.005)
    assert helped.n_muscle == plain.n_muscle == 4
    np.testing.assert_allclose(free.excitation, with_motor.excitation, atol=1e-9)  # at control 0 it does nothing


def test_a_smooth_switch_between_time_constants():
    model = links(of_muscle='tausmooth=".2"')
    assert (model.activation_parameters[:, 2] == 0.2).all()
    solution = mjhcmc.hcmc(model, cosine(model, {"hip": 15, "knee": 20}, 0.6), 0.005)
    assert largest_error(solution) <= 0.02
    assert max(solution.verdict.replay_window_max_error) < 1e-5


def test_a_forcerange_that_clamps():
    model = links(of_muscle='forcelimited="true" forcerange="-25 0"')
    solution = mjhcmc.hcmc(model, cosine(model, {"hip": 15, "knee": 20}, 0.6), 0.005)
    assert solution.muscle_force.max() <= 25 + 1e-9
    assert solution.muscle_force.max() > 24  # it does clamp
    assert largest_error(solution) <= 0.02
    assert told(solution)


def test_a_floor_under_the_foot():
    floor = '<geom name="floor" type="plane" size="2 2 .1" pos="0 0 -.53" contype="1" conaffinity="1" '
    floor += 'priority="1" solref=".05 1" solimp=".5 .9 .02"/>'
    model = links(floor=floor, collides='contype="1" conaffinity="1"')
    motion = cosine(model, {"hip": 10, "knee": -20}, 0.6, {"hip": 10, "knee": -40})  # lifts off, and lands
    solution = mjhcmc.hcmc(model, motion, 0.005)
    m, d = model.mj_model, mujoco.MjData(model.mj_model)
    touching = []
    for q in solution.qpos:
        d.qpos[:] = q
        mujoco.mj_fwdPosition(m, d)
        touching.append(d.ncon)
    assert min(touching) == 0 < max(touching)
    assert largest_error(solution) <= 0.05
    assert told(solution)


def test_a_motion_against_an_equality_is_named():
    model = links(equality='<equality><joint joint1="knee" joint2="hip" polycoef=".1 .5 0 0 0"/></equality>')
    t = np.linspace(0, 0.6, 121)
    s = np.sin(np.pi * t / 0.6) ** 2
    qpos = np.column_stack([0.3 * s, 0.1 + 0.15 * s + 0.2 * (t > 0.299) * s])
    with pytest.raises(MotionError, match="knee is at") as caught:
        mjhcmc.hcmc(model, Motion(t, qpos), 0.005)
    assert "\n" not in str(caught.value)
    assert " 0.3 s" in str(caught.value)
    assert "0.45" in str(caught.value)


def test_a_step_too_large_for_the_damping_is_refused_with_one_that_works():
    model = links(kind=HINGE.replace('".2"', '"400"'))
    motion = cosine(model, {"hip": 5}, 0.1)
    with pytest.raises(SimulationError, match=r"use physics_dt <= ") as caught:
        mjhcmc.hcmc(model, motion, 0.005, physics_dt=0.005)
    works = float(str(caught.value).rsplit("<=", 1)[1])
    assert np.isfinite(mjhcmc.hcmc(model, motion, 0.005, physics_dt=works).qpos).all()

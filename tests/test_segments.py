"""Joint angles and segment angles: against MuJoCo's body rotations, there and back, and where there are none."""

import mujoco
import numpy as np
import pytest
from conftest import HANGING_MASS, LINEAR_ACTUATOR, load_xml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from motion_tools import DEG, LEG

from mjhcmc.errors import ModelError, MotionError
from mjhcmc.io.opensim import write_table
from mjhcmc.motion import Motion
from mjhcmc.segments import joint_angles, segment_angles

GEOM = '<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1" contype="0" conaffinity="0"/>'
BODY = GEOM + '<site name="{0}_site"/>'
BRANCHES = f"""
<mujoco model="branches">
  <option integrator="RK4"/>
  <worldbody>
    <site name="ceiling" pos=".1 0 .1"/>
    <body name="trunk" euler="20 30 40">
      <joint name="trunk" axis="0 1 0" ref="15"/>{BODY.format("trunk")}
      <body name="left" euler="0 70 0" pos="0 0 -.3">
        <joint name="left" axis="0 -1 0"/>{BODY.format("left")}
        <body name="plate" euler="0 10 0" pos="0 .1 0">
          <body name="left_tip" pos="0 0 -.3">
            <joint name="left_tip" axis="0 2 0"/>{BODY.format("left_tip")}
          </body>
        </body>
      </body>
      <body name="right" euler="180 0 0" pos="0 0 .3">
        <joint name="right" axis="0 1 0"/><joint name="right_again" axis="0 -1 0" pos="0 0 .1"/>{BODY.format("right")}
        <body name="right_tip" pos="0 0 -.3">
          <joint name="right_tip" axis="{{axis}}" type="{{kind}}"/>{BODY.format("right_tip")}
        </body>
      </body>
    </body>
  </worldbody>
  <tendon><spatial name="t"><site site="ceiling"/><site site="left_site"/></spatial></tendon>
  <actuator><muscle name="pull" tendon="t" force="10" lengthrange=".05 .95" ctrlrange="0 1"/></actuator>
</mujoco>
"""


@pytest.fixture(scope="module")
def branches():
    return load_xml(BRANCHES.format(axis="0 1 0", kind="hinge"))


def turned(model, qpos, body):
    """Rotation of a body from its pose at zero joint angles about the first joint's axis, by xmat, to half a turn."""
    m = model.mj_model
    data = mujoco.MjData(m)
    data.qpos[:] = 0
    mujoco.mj_kinematics(m, data)
    before, axis = data.body(body).xmat.reshape(3, 3).copy(), data.xaxis[0].copy()
    data.qpos[:] = qpos
    mujoco.mj_kinematics(m, data)
    rotation = data.body(body).xmat.reshape(3, 3) @ before.T
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    np.testing.assert_allclose(np.cross(skew, axis), 0, atol=1e-9)
    return np.arctan2(skew @ axis / 2, (np.trace(rotation) - 1) / 2)


def same_angle(found, expected):
    np.testing.assert_allclose(np.angle(np.exp(1j * (np.asarray(found) - expected))), 0, atol=1e-9)


@given(q=arrays(np.float64, 3, elements=st.floats(-2, 2)))
@settings(max_examples=25, deadline=None)
def test_the_legs_segments_are_bodies_turned(leg8, q):
    phi = segment_angles(leg8, q)
    np.testing.assert_allclose(phi, np.cumsum(q), atol=1e-15)
    for body, angle in zip(("thigh", "shank", "foot"), phi, strict=True):
        same_angle(turned(leg8, q, body), angle)


@given(q=arrays(np.float64, 6, elements=st.floats(-3, 3)))
@settings(max_examples=25, deadline=None)
def test_branches_opposite_axes_and_two_joints_of_one_body(branches, q):
    phi = dict(zip(branches.joint_names, segment_angles(branches, q), strict=True))
    for joint, body in {"trunk": "trunk", "left": "left", "left_tip": "left_tip", "right_again": "right",
                        "right_tip": "right_tip"}.items():  # fmt: skip
        same_angle(turned(branches, q, body), phi[joint])


@given(q=arrays(np.float64, (4, 6), elements=st.floats(-1e3, 1e3)))
@settings(max_examples=50, deadline=None)
def test_there_and_back(branches, q):
    np.testing.assert_allclose(joint_angles(branches, segment_angles(branches, q)), q, atol=1e-11)
    np.testing.assert_allclose(segment_angles(branches, joint_angles(branches, q)), q, atol=1e-11)


@pytest.mark.parametrize("convert", [segment_angles, joint_angles])
def test_models_without_segment_angles(convert):
    with pytest.raises(
        ModelError, match=r"model branches: the axis of joint right_tip stands at 90 deg to that of trunk"
    ):
        convert(load_xml(BRANCHES.format(axis="1 0 0", kind="hinge")), np.zeros(6))
    with pytest.raises(ModelError, match=r"joint right_tip stands at 0\.000115 deg"):
        convert(load_xml(BRANCHES.format(axis="2e-6 1 0", kind="hinge")), np.zeros(6))
    convert(load_xml(BRANCHES.format(axis="5e-7 1 0", kind="hinge")), np.zeros(6))
    with pytest.raises(ModelError, match=r"model branches: joint right_tip is a slide"):
        convert(load_xml(BRANCHES.format(axis="0 1 0", kind="slide")), np.zeros(6))
    with pytest.raises(ModelError, match=r"model hanging: joint height is a slide"):
        convert(load_xml(HANGING_MASS.format(actuator=LINEAR_ACTUATOR)), np.zeros(1))
    with pytest.raises(ModelError, match=r"model leg: .*give a MuscleModel"):
        convert(LEG, np.zeros(3))


@pytest.mark.parametrize("shape", [(), (2,), (4, 2), (1, 4, 3)])
def test_shapes_refused(leg8, shape):
    with pytest.raises(MotionError, match=r"qpos has shape .*: give \(T, 3\) or \(3,\), a column a joint of leg8"):
        segment_angles(leg8, np.zeros(shape))
    with pytest.raises(MotionError, match="segment has shape"):
        joint_angles(leg8, np.zeros(shape))


def test_a_file_of_segment_angles(leg8, tmp_path):
    """Knee angles that only fit as what they are: a thigh at 50 deg and a shank at -20 deg are a knee at -70 deg."""
    time = np.linspace(0, 1, 21)
    q = np.column_stack([50 * np.sin(time), -70 * time, 20 * time])
    path = tmp_path / "segments.mot"
    phi = np.cumsum(q, axis=1) * [1, -1, 1]
    write_table(path, ["hip", "shank", "ankle"], time, phi, name="m", in_degrees=True)
    motion = Motion.from_file(path, leg8, angles="segment", column_map={"knee": "-shank"})
    np.testing.assert_allclose(motion.qpos, q * DEG, atol=1e-14)
    write_table(path, leg8.joint_names, time, phi * 0 + [30, 45, 45], name="m", in_degrees=True)
    with pytest.raises(MotionError, match=r"joint knee is at 15 deg at .* outside its range"):
        Motion.from_file(path, leg8, angles="segment")
    write_table(path, leg8.joint_names, time, 0.05 * np.cumsum(q, axis=1), name="m", in_degrees=False)
    with pytest.raises(MotionError, match=r"knee .*as degrees the angles would fit"):
        Motion.from_file(path, leg8, angles="segment")


def test_segment_angles_need_a_model_with_a_chain(tmp_path):
    time = np.linspace(0, 1, 21)
    write_table(tmp_path / "m.mot", LEG.joint_names, time, np.zeros((21, 3)), name="m", in_degrees=True)
    with pytest.raises(ModelError, match="give a MuscleModel"):
        Motion.from_file(tmp_path / "m.mot", LEG, angles="segment")

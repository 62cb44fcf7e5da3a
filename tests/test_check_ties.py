"""check: roles of degrees of freedom, joints tied to others, contacts at the reference pose."""

import mujoco
import numpy as np
import pytest
from check_tools import check_xml, flexor_and_biceps, found, pendulum_strength
from conftest import HANGING_MASS, MUSCLE_ACTUATOR, PENDULUMS
from myo_models import myo_model

from mjhcmc.model_check.check import check

TIE = '<equality><joint name="tie" joint1="elbow" joint2="shoulder" polycoef=".1 .5 .2 0 0"/></equality>'
TENDON_TIE = """
<tendon>
  <fixed name="bent"><joint joint="elbow" coef="1"/></fixed>
  <fixed name="raised"><joint joint="shoulder" coef="1"/></fixed>
</tendon>
<equality><tendon name="tie" tendon1="bent" tendon2="raised" polycoef=".1 .5 .2 0 0"/></equality>"""
PELVIS = '<body name="pelvis">{joints}<geom size=".1" mass="9" contype="0" conaffinity="0"/>'
PLANAR = """
<joint name="forward" type="slide" axis="1 0 0"/><joint name="up" type="slide" axis="0 0 1"/>
<joint name="tilt" axis="0 1 0"/>"""


def tied(tie):
    return PENDULUMS.replace("<actuator>", tie + "<actuator>")


def on_a_pelvis(joints):
    return PENDULUMS.replace("<worldbody>", "<worldbody>" + PELVIS.format(joints=joints)).replace(
        "</worldbody>", "</body></worldbody>"
    )


def roles(report):
    return {dof.name: dof.role for joint in report.joints for dof in joint.dofs}


def test_a_joint_that_follows_another_counts_as_part_of_it():
    report = check_xml(tied(TIE))
    shoulder, elbow = report.joints
    B = pendulum_strength(0, 0.1)
    assert shoulder.strength == pytest.approx((0, B[0, 0] + 0.5 * B[1, 1]), rel=1e-6)
    assert (elbow.follows, elbow.strength, elbow.muscles) == ("shoulder", None, ())
    assert elbow.polynomial == (0.1, 0.5, 0.2, 0, 0)
    assert roles(report) == {"shoulder": "tracked", "elbow": "dependent"}
    assert report.roles == {"tracked": 1, "dependent": 1}
    assert [muscle.joints for muscle in report.muscles] == [("shoulder",), ("shoulder",)]
    q = np.deg2rad(np.linspace(-120, 120, 2001))
    lengths = np.array([flexor_and_biceps(x, 0.1 + 0.5 * x + 0.2 * x * x)[1] for x in q])
    assert report.muscles[1].fiber_length_range == pytest.approx((0.7 + lengths.min(), 0.7 + lengths.max()), abs=1e-4)
    assert report.solvable
    text = report.screen()
    assert "2 degrees of freedom: 1 tracked, 1 dependent" in text
    assert "follow x = shoulder\n  elbow  +0.1 +0.5 x +0.2 x^2\n" in text


def test_a_tendon_equality_measures_as_the_joint_equality_that_it_is():
    by_joint, by_tendon = check_xml(tied(TIE)), check_xml(tied(TENDON_TIE))
    assert roles(by_joint) == roles(by_tendon)
    for one, other in zip(by_joint.joints, by_tendon.joints, strict=True):
        for name in ("strength", "negative_strength_range", "positive_strength_range", "passive_moment", "scanned"):
            assert getattr(one, name) == (None if one.strength is None else pytest.approx(getattr(other, name)))
    for one, other in zip(by_joint.steps, by_tendon.steps, strict=True):
        assert one.over_range == pytest.approx(other.over_range, rel=1e-6)
    for one, other in zip(by_joint.muscles, by_tendon.muscles, strict=True):
        assert one.fiber_length_range == pytest.approx(other.fiber_length_range)
    assert [(tie.name, tie.type, tie.ties) for tie in by_tendon.equalities] == [("tie", "tendon", ("bent", "raised"))]
    assert "dependent through them: elbow" in by_tendon.screen()


SLIDER_CRANK = """
<mujoco model="slider_crank">
  <worldbody>
    <body>
      <joint name="crank" axis="0 -1 0" range="-60 60" limited="true"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" contype="0" conaffinity="0"/>
      <body name="rod" pos=".3 0 0">
        <joint name="pin" axis="0 -1 0"/>
        <geom type="capsule" fromto="0 0 0 .15 0 0" size=".02" contype="0" conaffinity="0"/>
      </body>
    </body>
    <body name="slider" pos=".45 0 0">
      <joint name="slider" type="slide" axis="1 0 0"/>
      <geom size=".03" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <equality><connect name="end" body1="slider" body2="rod" anchor="0 0 0"/></equality>
  <actuator>
    <general name="pull" joint="{joint}" gear="-.05" dyntype="muscle" dynprm=".01 .04" gainprm="-300"/>
  </actuator>
</mujoco>"""


def test_a_loop_is_followed_as_far_as_it_closes():
    report = check_xml(SLIDER_CRANK.format(joint="crank"))
    assert roles(report) == {"crank": "tracked", "pin": "dependent", "slider": "dependent"}
    crank = report.joints[0]
    # the rod, half as long as the crank, reaches the slider's line up to 30 deg; poses are 2 deg apart
    for end in np.rad2deg(crank.usable):
        assert 28 - 1e-6 <= abs(end) <= 30 + 1e-6
    assert crank.strength == pytest.approx((0, 15))
    assert [p.what for p in found(report, "note", "joint 'crank'") if "can be met" in p.what]
    assert "connect  slider and rod" in report.screen()


def test_muscles_that_move_a_joint_only_through_what_is_tied_to_it_track_it():
    # d(pin)/d(crank) = -1 - r/l = -3 at the reference pose
    loop = check_xml(SLIDER_CRANK.format(joint="pin").replace('"-60 60"', '"-20 20"'))
    assert loop.roles == {"tracked": 1, "dependent": 2}
    (tracked,) = (joint for joint in loop.joints if joint.strength is not None)
    assert tracked.strength == pytest.approx({"crank": (-45, 0), "pin": (0, 15)}[tracked.name])
    no_flexor = tied(TIE).replace(
        '<muscle name="flexor" tendon="flexor_path"', '<motor name="flexor" tendon="flexor_path"'
    )
    no_flexor = no_flexor.replace('force="400" lengthrange=".05 .35" ctrlrange="0 1"', "")
    arm = check_xml(no_flexor)
    assert roles(arm) == {"shoulder": "tracked", "elbow": "dependent"}
    assert arm.joints[0].strength == pytest.approx((0, 0.5 * pendulum_strength(0, 0.1)[1, 1]), rel=1e-6)


def test_where_what_follows_leaves_its_own_range():
    narrow = TIE.replace(".1 .5 .2 0 0", "0 .5 0 0 0")
    xml = tied(narrow).replace(
        'name="elbow" type="hinge" axis="0 -1 0" range="-120 120"',
        'name="elbow" type="hinge" axis="0 -1 0" range="-120 30"',
    )
    report = check_xml(xml)
    low, high = report.joints[0].usable
    assert (low, report.joints[0].first_out) == (report.joints[0].range[0], ("elbow",))
    assert np.deg2rad(60) <= high <= np.deg2rad(60) + 3e-3
    (note,) = found(report, "note", "joint 'shoulder'")
    assert "60" in note.what
    assert "elbow" in note.what
    assert check_xml(tied(narrow)).joints[0].usable is None


@pytest.mark.parametrize("joints", [PLANAR, '<freejoint name="root"/>', '<joint name="root" type="ball"/>'])
def test_what_no_muscle_moves_below_the_first_that_one_does_is_prescribed(joints):
    fixed, moving = check_xml(PENDULUMS), check_xml(on_a_pelvis(joints))
    assert set(roles(moving).values()) == {"prescribed", "tracked"}
    assert [name for name, role in roles(moving).items() if role == "tracked"] == ["shoulder", "elbow"]
    # prescribed is as good as fixed
    for one, other in zip(fixed.joints, moving.joints[-2:], strict=True):
        assert one.strength == pytest.approx(other.strength)
        assert one.positive_strength_range == pytest.approx(other.positive_strength_range)
    for one, other in zip(fixed.steps, moving.steps, strict=True):
        assert one.over_range == pytest.approx(other.over_range, rel=1e-4)
        assert one.fastest == other.fastest == "elbow"
    assert not found(moving, "warning", "joint '")
    assert found(moving, "note", "of the root")
    assert moving.solvable
    for name, role in roles(moving).items():
        assert role != "prescribed" or name in moving.screen()


def test_what_no_muscle_moves_at_all_is_free():
    thing = '<body name="thing" pos="0 0 3"><freejoint name="thing"/><geom size=".1"/></body>'
    report = check_xml(PENDULUMS.replace("<worldbody>", "<worldbody>" + thing))
    assert report.roles == {"free": 6, "tracked": 2}
    assert "free, led by nothing: thing_tx" in " ".join(report.screen().split())


def test_a_ball_is_as_strong_as_the_hinges_that_it_stands_for():
    axes = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    hinges = "".join(f'<joint name="{name}" axis="{axis}" range="-50 50"/>' for name, axis in axes.items())
    shoulder = '<joint name="shoulder" type="hinge" axis="0 -1 0" range="-120 120" limited="true"/>'
    body = PENDULUMS.replace(shoulder, "{}")
    body = body.replace('pos=".1 0 .1"', 'pos=".1 .03 .1"')
    three = check_xml(body.format(hinges))
    ball = check_xml(body.format('<joint name="shoulder" type="ball" damping=".2"/>'))
    strength = [dof.strength for dof in ball.joints[0].dofs]
    np.testing.assert_allclose(strength, [joint.strength for joint in three.joints[:3]], atol=1e-9)
    assert [dof.name for dof in ball.joints[0].dofs] == ["shoulder_rx", "shoulder_ry", "shoulder_rz"]
    assert np.abs(strength).max() > 1
    assert ball.solvable
    assert "shoulder_ry  ball" in ball.screen()


@pytest.mark.parametrize(("height", "too_much"), [(".085", False), (".05", True)])
def test_contacts_at_the_reference_pose_and_what_they_push(height, too_much):
    xml = HANGING_MASS.format(actuator=MUSCLE_ACTUATOR).replace('contype="0" conaffinity="0"', 'name="weight"')
    xml = xml.replace("<worldbody>", f'<worldbody><geom name="stop" size=".05" pos="0 0 {height}"/>')
    m = mujoco.MjModel.from_xml_string(xml)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    report = check(m)
    (contact,) = report.contacts
    assert set(contact.geoms) == {"stop", "weight"}
    assert contact.depth == pytest.approx(0.1 - float(height))
    assert (contact.joint, contact.push) == ("height", pytest.approx(d.qfrc_constraint[0]))
    assert contact.push < 0
    assert contact.strength == pytest.approx(92)
    assert report.joints[0].dofs[0].pushed == pytest.approx(contact.push)
    (problem,) = [p for p in report.problems if "geoms" in p.where]
    assert (problem.level == "warning") == too_much == (-contact.push > 92)
    assert ("more than the 92" in problem.what) == too_much


def test_equalities_that_contradict_each_other_are_told():
    held = '<joint joint1="elbow" polycoef="{} 0 0 0 0"/>'
    report = check_xml(tied(f"<equality>{held.format(0.1)}{held.format(0.5)}</equality>"))
    assert report.reference_missed == pytest.approx(0.5)
    (warning,) = found(report, "warning", "the equality constraints")
    assert "0.5" in warning.what
    assert check_xml(tied(TIE)).reference_missed is None


def test_a_forcerange_below_what_a_muscle_can_is_noted():
    clamped = check_xml(HANGING_MASS.format(actuator=MUSCLE_ACTUATOR.replace("/>", ' forcerange="-50 0"/>')))
    assert clamped.muscles[0].force_range == (0, 50)
    assert clamped.joints[0].positive_strength_range[1] == pytest.approx(50)
    assert any("to 50 N, less than its F0 of 100 N" in note.what for note in found(clamped, "note", "'pull'"))
    wide = check_xml(HANGING_MASS.format(actuator=MUSCLE_ACTUATOR.replace("/>", ' forcerange="-500 0"/>')))
    assert not any("forcerange" in problem.what for problem in wide.problems)


MYO = {
    "myofinger": {"tracked": 4},
    "myoelbow": {"tracked": 1},
    "myoarm": {"tracked": 27, "dependent": 11},
    "myotorso": {"tracked": 3, "dependent": 15},
    "myolegs": {"tracked": 14, "dependent": 14, "prescribed": 6},
    "myolegs26": {"tracked": 12, "dependent": 28, "prescribed": 6},
}


@pytest.mark.filterwarnings("ignore:Attaching a spec")
@pytest.mark.parametrize("name", MYO)
def test_models_of_myo_sim(name):
    report = check(myo_model(name))
    assert report.roles == MYO[name]
    assert report.solvable
    assert all(step.over_range > 0 for step in report.steps)
    weak = [problem.where for problem in report.problems if "cannot be moved" in problem.what]
    assert weak == (["joint 'elv_angle_r'"] if name == "myoarm" else [])  # its axis and the follower's cancel at rest
    assert max(map(len, report.screen().splitlines())) <= 100

"""check: every problem by name with its remedy, on the screen and as JSON."""

import dataclasses
import json
import re

import mujoco
import numpy as np
import pytest
from check_tools import check_xml, found
from conftest import HANGING_MASS, LINEAR_ACTUATOR, MUSCLE_ACTUATOR, PENDULUMS
from test_model import REFUSED

import mjhcmc
from mjhcmc.model_check.check import check

PLAIN_JOINT = 'type="slide" axis="0 0 1" range="-.5 .5" limited="true"'


def test_a_model_that_cannot_be_loaded_or_has_no_muscle_is_an_error(tmp_path):
    with pytest.raises(mjhcmc.ModelError, match="no model 'leg9'"):
        check("leg9")
    with pytest.raises(mjhcmc.ModelError, match="has no muscle among its 1 actuators"):
        check_xml(HANGING_MASS.format(actuator='<motor joint="height"/>'))
    broken = tmp_path / "broken.xml"
    broken.write_text("<mujoco><worldbody><body></mujoco>")
    with pytest.raises(mjhcmc.ModelError, match="MuJoCo cannot load it"):
        check(broken)


@pytest.mark.parametrize("case", [case for case in REFUSED if case != "no muscle"])
def test_what_load_refuses_check_lists_in_the_same_words(case):
    m = mujoco.MjModel.from_xml_string(REFUSED[case][0])
    report = check(m)
    errors = [problem for problem in report.problems if problem.level == "error"]
    assert not report.solvable
    assert len(errors) == 1
    with pytest.raises(mjhcmc.ModelError) as refusal:
        mjhcmc.MuscleModel.load(m)
    assert str(refusal.value) == errors[0].message(report.name)
    assert "1 error" in report.screen()
    assert errors[0].remedy in " ".join(report.screen().split())


BROKEN = (
    PENDULUMS.replace('name="elbow" type="hinge"', 'name="elbow" type="hinge" actuatorfrcrange="-5 5"')
    .replace('"400" lengthrange=".05 .35" ctrlrange="0 1"', '"400" lengthrange=".05 .35" ctrlrange="-2 0"')
    .replace('ctrlrange="0 1"/>\n  </act', 'ctrlrange="-1 0"/>\n  </act')
    .replace(
        "<actuator>",
        '<custom><text name="opensim_coordinates" data="wrist=x"/></custom>'
        '<equality><weld name="fix" body1="lower"/><connect name="pin" body1="upper" anchor="0 0 0"/></equality>'
        "<actuator>",
    )
)


def test_every_problem_is_listed_and_load_names_the_first_and_counts_the_rest():
    m = mujoco.MjModel.from_xml_string(BROKEN)
    report = check(m)
    assert [(p.where, p.what.split(",")[0]) for p in report.problems if p.level == "error"] == [
        ("muscle 'flexor'", "has ctrlrange -2..0"),
        ("muscle 'biceps'", "has ctrlrange -1..0"),
        ("the muscles' moment at joint 'elbow'", "is clamped by actuatorfrcrange"),
        ("custom text 'opensim_coordinates'", "holds 'wrist=x'"),
    ]
    with pytest.raises(
        mjhcmc.ModelError, match=r"muscle 'flexor' has ctrlrange.*\(and 3 more: mjhcmc check MODEL lists them\)$"
    ):
        mjhcmc.MuscleModel.load(m)
    assert "4 errors" in report.screen()


def test_problems_alike_are_told_together():
    assert "likewise, with other numbers (1): biceps" in check_xml(BROKEN).screen()
    assert "likewise (1): biceps" in check_xml(PENDULUMS.replace('ctrlrange="0 1"', 'ctrlrange="-1 0"')).screen()


@pytest.mark.parametrize("problem_field", ["what", "where", "remedy"])
def test_problems_are_frozen(problem_field, hanging_mass):
    problem = check(hanging_mass).problems[0]
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(problem, problem_field, "")


def test_a_muscle_across_no_joint_and_a_joint_without_muscle():
    report = check_xml(PENDULUMS.replace('<site site="c"/><site site="d"/>', '<site site="c"/><site site="b"/>'))
    assert [p.what for p in found(report, "warning", "'biceps'")] == [
        "crosses no joint, so its activation does nothing"
    ]
    assert [p.what for p in found(report, "warning", "'elbow'")] == ["cannot be moved either way by any muscle"]
    assert report.muscles[1].joints == report.joints[1].muscles == ()
    assert "NONE" in report.screen()


def test_default_vmax_is_noted_and_another_is_not():
    notes = found(check_xml(PENDULUMS.replace('force="400"', 'force="400" vmax="10"')), "note", "muscle")
    assert [(p.where, "vmax, 1.5" in p.what) for p in notes] == [("muscle 'biceps'", True)]


def test_a_muscle_beyond_its_curve_is_noted():
    stretched = MUSCLE_ACTUATOR.replace("/>", ' range=".75 2"/>')  # L0 is .8 m: .75 to 2 L0, lmax is 1.6
    report = check_xml(HANGING_MASS.format(actuator=stretched))
    assert report.muscles[0].leaves_limits
    assert any("from 0.75 to 2.00 L0" in p.what for p in found(report, "note", "'pull'"))
    assert "0.75..2.00!" in report.screen()


def test_joints_without_limits_and_reference_poses_outside_them():
    free = check_xml(HANGING_MASS.format(actuator=MUSCLE_ACTUATOR).replace('range="-.5 .5" limited="true"', ""))
    assert (free.joints[0].range, free.joints[0].scanned, free.joint_limits) == (None, (-0.1, 0.1), 0)
    assert "no limits" in free.screen()
    turned = check_xml(PENDULUMS.replace('range="-120 120" limited="true"', ""))
    assert turned.joints[0].scanned == pytest.approx((-np.pi / 2, np.pi / 2))
    outside = check_xml(HANGING_MASS.format(actuator=MUSCLE_ACTUATOR).replace('range="-.5 .5"', 'range=".2 .5"'))
    assert outside.joints[0].reference_outside == 0
    assert found(outside, "note", "joint 'height'")


def test_other_actuators_the_integrator_and_contacts_are_noted():
    xml = HANGING_MASS.format(actuator=MUSCLE_ACTUATOR + '<motor joint="height"/>').replace("RK4", "implicitfast")
    xml = xml.replace('contype="0" conaffinity="0"', "").replace(
        "<worldbody>", '<worldbody><geom type="sphere" size=".05" pos="0 0 .09"/>'
    )
    report = check_xml(xml)
    assert (report.other_actuators, report.integrator) == (1, "IMPLICITFAST")
    assert (report.colliding_pairs, len(report.contacts)) == (1, 1)
    assert {p.where for p in report.problems if p.level == "note"} >= {
        "the actuators that are no muscles",
        "the model's integrator",
    }
    said = [p for p in report.problems if p.where == "the model's integrator"]
    assert [p.what for p in said] == ["is implicitfast"]
    assert "by RK4; solve with --integrator implicitfast" in said[0].remedy
    default = check_xml(HANGING_MASS.format(actuator=MUSCLE_ACTUATOR).replace('integrator="RK4"', ""))
    assert [p.what for p in default.problems if p.where == "the model's integrator"] == [
        "is Euler, MuJoCo's default or the model's choice"
    ]
    assert report.joints[0].strength == pytest.approx((0, 92))  # the motor is none of the muscles' strength


WRAPPED = """
<mujoco model="wrapped">
  <worldbody>
    <site name="top" pos="0 0 .3"/>
    <geom name="bone" type="cylinder" size=".05 .1" euler="90 0 0" contype="0" conaffinity="0"/>
    <site name="side" pos=".1 0 0"/>
    <body pos="0 0 -.3">
      <joint name="slide" type="slide" axis="1 0 0" range="-.3 .3" limited="true"/>
      <geom size=".02" contype="0" conaffinity="0"/>
      <site name="end"/>
    </body>
  </worldbody>
  <tendon><spatial name="path"><site site="top"/><geom geom="bone" {side}/><site site="end"/></spatial></tendon>
  <actuator><muscle name="pull" tendon="path" force="100" lengthrange=".5 .8"/></actuator>
</mujoco>
"""


def test_a_path_that_slips_off_a_cylinder_jumps():
    bone_r, top, end = 0.05, 0.3, 0.25
    swing = '<joint name="swing" axis="0 1 0" range="-20 {}" limited="true"/>'
    xml = (
        WRAPPED.format(side='sidesite="side"')
        .replace('<body pos="0 0 -.3">', "<body>")
        .replace('<joint name="slide" type="slide" axis="1 0 0" range="-.3 .3" limited="true"/>', swing)
        .replace('<site name="end"/>', f'<site name="end" pos="0 0 {-end}"/>')
    )
    # once around the cylinder, MuJoCo lets the path go: from two tangents and an arc to the straight line
    around = np.sqrt(top**2 - bone_r**2) + np.sqrt(end**2 - bone_r**2)
    around += bone_r * (2 * np.pi - np.arccos(bone_r / top) - np.arccos(bone_r / end))
    (jump,) = found(check_xml(xml.format(200)), "warning", "'pull'")
    size, at = re.fullmatch(r"jumps in length by ([\d.]+) mm where joint 'swing' is at (\d+) deg", jump.what).groups()
    assert at == "180"
    assert float(size) == pytest.approx(1e3 * (around - (top - end)), abs=1)
    assert "side site" in jump.remedy
    assert not found(check_xml(xml.format(170)), "warning", "'pull'")


def test_a_moment_arm_that_flips_is_no_jump_in_length():
    report = check_xml(WRAPPED.format(side=""))  # the shorter way around: equal at the middle
    assert report.joints[0].strength != (0, 0)
    assert not found(report, "warning", "'pull'")


def many_muscles(count):
    actuators = "".join(
        f'<muscle name="a_long_name_of_muscle_{i}" tendon="{path}" force="{100 + i}" lengthrange=".05 .35"/>'
        for i in range(count)
        for path in [("flexor_path", "biceps_path")[i % 2]]
    )
    return PENDULUMS[: PENDULUMS.index("<actuator>")] + f"<actuator>{actuators}</actuator></mujoco>"


def test_the_screen_of_leg8_and_of_80_muscles(leg8):
    screen = check(leg8).screen()
    for name in (*leg8.muscle_names, *leg8.joint_names, "hip_flexion_r", "-120..120", "solve takes this model"):
        assert name in screen
    report = check_xml(many_muscles(80))
    assert len(report.to_dict()["muscles"]) == 80
    text = report.screen()
    assert "55 more with --json" in text
    for one in (screen, text):
        assert max(map(len, one.splitlines())) <= 100
        assert len(one.splitlines()) <= 60


def test_json_has_no_nan_and_says_everything(leg8):
    for report in (check(leg8), check_xml(BROKEN), check_xml(HANGING_MASS.format(actuator=LINEAR_ACTUATOR))):
        values = json.loads(json.dumps(report.to_dict(), allow_nan=False))
        assert values["solvable"] == report.solvable
        assert [joint["name"] for joint in values["joints"]] == [joint.name for joint in report.joints]
        assert [set(problem) for problem in values["problems"]] == [{"what", "where", "remedy", "level"}] * len(
            report.problems
        )


def test_a_model_without_joints_is_told():
    report = check_xml(
        HANGING_MASS.format(actuator=MUSCLE_ACTUATOR).replace(f'<joint name="height" {PLAIN_JOINT}/>', "")
    )
    assert report.joints == ()
    assert found(report, "warning", "the model")
    assert report.screen()

"""check: what it measures in models with closed forms, and every problem by name with its remedy."""

import dataclasses
import json
import re

import mujoco
import numpy as np
import pytest
from conftest import HANGING_MASS, LINEAR_ACTUATOR, MUSCLE_ACTUATOR, PENDULUMS
from test_model import REFUSED

import mjhcmc
from mjhcmc.leg8 import load_table
from mjhcmc.model_check.check import check

RK4_LIMIT = 2.78
PLAIN_JOINT = 'type="slide" axis="0 0 1" range="-.5 .5" limited="true"'


def check_xml(xml):
    return check(mujoco.MjModel.from_xml_string(xml))


def found(report, level, where):
    return [p for p in report.problems if p.level == level and where in p.where]


def force_length(L, lmin=0.5, lmax=1.6):
    """MuJoCo's active force-length curve, piecewise quadratic."""
    end = lmin if L < 1 else lmax
    x = (L - 1) / (end - 1)  # 0 at the optimum, 1 at the end of the curve
    return 1 - 2 * x**2 if x < 0.5 else 2 * max(0.0, 1 - x) ** 2


def flexor_and_biceps(shoulder, elbow):
    """Path lengths in the two-joint arm by plane geometry, x forward and z up; both joints swing forward."""

    def turn(angle, x, z):
        return np.array([x * np.cos(angle) - z * np.sin(angle), x * np.sin(angle) + z * np.cos(angle)])

    b, c = turn(shoulder, 0.05, -0.1), turn(shoulder, 0.05, -0.15)
    d = turn(shoulder, 0, -0.3) + turn(shoulder + elbow, 0.05, -0.08)
    return np.array([np.linalg.norm(b - [0.1, 0.1]), np.linalg.norm(d - c)])


def pendulum_strength(shoulder, elbow):
    """(2 muscles, 2 joints) N m at full activation: F0 FL(L) (-dL/dq)."""
    h = 1e-6
    arms = -np.stack(
        [
            (flexor_and_biceps(shoulder + h, elbow) - flexor_and_biceps(shoulder - h, elbow)) / (2 * h),
            (flexor_and_biceps(shoulder, elbow + h) - flexor_and_biceps(shoulder, elbow - h)) / (2 * h),
        ],
        axis=1,
    )
    L = 0.75 + flexor_and_biceps(shoulder, elbow) - 0.05  # L0 is .3 m/.3
    return np.array([400 * force_length(L[0]), 200 * force_length(L[1])])[:, None] * arms


def test_a_mass_on_a_muscle(hanging_mass):
    report = check(hanging_mass)
    (muscle,), (joint,) = report.muscles, report.joints
    assert (muscle.gain, muscle.max_isometric_force, muscle.joints) == ("muscle", 100, ("height",))
    assert muscle.optimal_fiber_length == pytest.approx(1 / 0.3)
    assert muscle.fiber_length == pytest.approx(0.9)
    assert muscle.fiber_length_range == pytest.approx((0.75, 1.05))
    assert (muscle.force_length_limits, muscle.leaves_limits, muscle.max_velocity) == ((0.5, 1.6), False, 1.5)
    assert (muscle.activation_time, muscle.deactivation_time, muscle.smoothing) == (0.01, 0.04, 0)
    assert (joint.type, joint.unit, joint.range, joint.scanned) == ("slide", "m", (-0.5, 0.5), (-0.5, 0.5))
    # it pulls the mass up: F0 FL(.9) at the reference pose, F0 FL(.75) to F0 FL(1) over the range
    assert joint.strength == pytest.approx((0, 92))
    assert joint.negative_strength_range == (0, 0)
    assert joint.positive_strength_range == pytest.approx((50, 100))
    assert joint.passive_moment == pytest.approx(0)
    assert (report.total_mass, report.gravity, report.integrator) == (2, (0, 0, -9.81), "RK4")
    # at rest nothing decays; at full activation D = F0 FL dFV/dV/(L0 vmax), dFV/dV = 2
    rest, active = report.steps
    assert (rest.at_reference, rest.over_range, rest.worst_joint) == (None, None, None)
    assert active.at_reference == pytest.approx(RK4_LIMIT / (92 * 2 * 0.3 / 1.5 / 2), rel=1e-4)
    assert active.over_range == pytest.approx(RK4_LIMIT / (100 * 2 * 0.3 / 1.5 / 2), rel=1e-2)
    assert active.worst_joint == "height"
    assert [(p.level, p.where) for p in report.problems] == [
        ("warning", "joint 'height'"),
        ("note", "muscle 'pull'"),
    ]
    assert "negative direction" in report.problems[0].what
    assert "reserves" in report.problems[0].remedy


def test_a_mass_on_a_muscle_without_curves(linear_mass):
    report = check(linear_mass)
    (muscle,), (joint,) = report.muscles, report.joints
    assert (muscle.gain, muscle.max_isometric_force, muscle.optimal_fiber_length) == ("fixed", 100, None)
    assert (muscle.fiber_length, muscle.fiber_length_range, muscle.leaves_limits) == (None, None, None)
    assert joint.strength == pytest.approx((0, 100))
    assert joint.positive_strength_range == pytest.approx((100, 100))
    assert report.solvable


def test_two_joints_against_plane_geometry(two_joints):
    report = check(two_joints)
    B = pendulum_strength(0, 0)
    grid = np.deg2rad(np.linspace(-120, 120, 2001))
    over = {
        "shoulder": np.array([pendulum_strength(q, 0)[:, 0] for q in grid]),
        "elbow": np.array([pendulum_strength(0, q)[:, 1] for q in grid]),
    }
    for j, joint in enumerate(report.joints):
        assert joint.strength == pytest.approx((np.minimum(B[:, j], 0).sum(), np.maximum(B[:, j], 0).sum()), abs=1e-5)
        most, least = over[joint.name].max(), over[joint.name].min()
        assert joint.positive_strength_range == pytest.approx((0, most), rel=5e-3)
        assert joint.negative_strength_range == pytest.approx((min(0, least), 0), rel=5e-3)
    assert [muscle.joints for muscle in report.muscles] == [("shoulder",), ("elbow",)]
    assert [joint.muscles for joint in report.joints] == [("flexor",), ("biceps",)]


def test_a_joint_that_follows_another_counts_as_part_of_it():
    tie = '<equality><joint name="tie" joint1="elbow" joint2="shoulder" polycoef=".1 .5 .2 0 0"/></equality>'
    report = check_xml(PENDULUMS.replace("<actuator>", tie + "<actuator>"))
    shoulder, elbow = report.joints
    B = pendulum_strength(0, 0.1)
    assert shoulder.strength == pytest.approx((0, B[0, 0] + 0.5 * B[1, 1]), rel=1e-6)
    assert (elbow.follows, elbow.strength, elbow.muscles) == ("shoulder", None, ())
    assert [muscle.joints for muscle in report.muscles] == [("shoulder",), ("shoulder",)]
    q = np.deg2rad(np.linspace(-120, 120, 2001))
    lengths = np.array([flexor_and_biceps(x, 0.1 + 0.5 * x + 0.2 * x * x)[1] for x in q])
    assert report.muscles[1].fiber_length_range == pytest.approx((0.7 + lengths.min(), 0.7 + lengths.max()), abs=1e-4)
    assert not report.solvable
    assert "tied to others" in report.screen()


@pytest.mark.parametrize(("damping", "stable"), [(5000.0, RK4_LIMIT * 2 / 5000), (10000.0, RK4_LIMIT * 2 / 10000)])
def test_the_stable_step_of_a_damped_mass(damping, stable):
    xml = HANGING_MASS.format(actuator=LINEAR_ACTUATOR).replace('name="height"', f'name="height" damping="{damping}"')
    report = check_xml(xml)
    assert [step.at_reference for step in report.steps] == pytest.approx([stable, stable], rel=1e-6)
    assert report.joints[0].damping == damping
    warned = found(report, "warning", "the model's damping")
    assert bool(warned) == (stable < 1e-3)
    if warned:  # solving says the same
        model = mjhcmc.MuscleModel.load(mujoco.MjModel.from_xml_string(xml))
        motion = mjhcmc.Motion.cosine(model, amplitudes={"height": 0.01}, period=1, cycles=1)
        step = re.search(r"[\d.]+$", warned[0].remedy).group()
        with pytest.raises(mjhcmc.SimulationError, match=re.escape(f"use physics_dt <= {step}")):
            mjhcmc.hcmc(model, motion)


def test_the_headline_names_the_step_that_solve_takes():
    xml = HANGING_MASS.format(actuator=LINEAR_ACTUATOR).replace('name="height"', 'name="height" damping="10000"')
    report = check_xml(xml)
    headline = report.screen().splitlines()[3]
    assert headline == (
        f"solve takes this model with --physics-dt {report.physics_dt_needed:.2g}: the default 1 ms is unstable"
    )
    step = float(re.search(r"--physics-dt ([\d.e-]+):", headline).group(1))
    model = mjhcmc.MuscleModel.load(mujoco.MjModel.from_xml_string(xml))
    motion = mjhcmc.Motion.cosine(model, amplitudes={"height": 0.001}, period=1, cycles=1)
    with pytest.raises(mjhcmc.SimulationError, match="physics_dt"):
        mjhcmc.static_optimization(model, motion)
    assert mjhcmc.static_optimization(model, motion, physics_dt=step).settings["physics_dt"] <= step
    assert report.to_dict()["physics_dt_needed"] == report.physics_dt_needed == 0.8 * report.steps[0].over_range


def test_the_headline_where_only_other_poses_need_a_smaller_step():
    # a damped path from above the joint to below it has no arm while the forearm hangs
    xml = (
        TWO_SIDED.format(bends="", stretches="")
        .replace(
            "<worldbody><body>", '<worldbody><site name="top" pos="0 0 .2"/><body><site name="low" pos="0 0 -.2"/>'
        )
        .replace(
            "<actuator>",
            '<tendon><spatial damping="2e4"><site site="top"/><site site="low"/></spatial></tendon><actuator>',
        )
    )
    report = check_xml(xml)
    assert report.steps[0].at_reference is None
    headline = report.screen().splitlines()[3]
    assert re.fullmatch(
        r"solve takes this model with --physics-dt 0\.000\d+: the default 1 ms is unstable at some poses",
        headline,
    )
    model = mjhcmc.MuscleModel.load(mujoco.MjModel.from_xml_string(xml))
    small = mjhcmc.Motion(np.linspace(0, 0.1, 11), np.full((11, 1), 0.01))
    assert mjhcmc.static_optimization(model, small).settings["physics_dt"] == 1e-3  # it depends on the motion
    wide = mjhcmc.Motion(np.linspace(0, 0.1, 11), np.full((11, 1), 1.0))
    with pytest.raises(mjhcmc.SimulationError, match=r"physics_dt 0\.001 s is unstable"):
        mjhcmc.static_optimization(model, wide)
    assert mjhcmc.static_optimization(model, wide, physics_dt=report.physics_dt_needed).n_window == 10
    assert check_xml(PENDULUMS).screen().splitlines()[3] == "solve takes this model"


def test_the_stable_step_is_where_simulation_turns_unstable():
    xml = HANGING_MASS.format(actuator=LINEAR_ACTUATOR).replace('name="height"', 'name="height" damping="4000"')
    stable = check_xml(xml).steps[0].at_reference
    speed = {}
    for factor in (0.99, 1.01):
        m = mujoco.MjModel.from_xml_string(xml.replace('gravity="0 0 -9.81"', 'gravity="0 0 0"'))
        m.opt.timestep = factor * stable
        d = mujoco.MjData(m)
        d.qvel[0] = 1e-6
        mujoco.mj_step(m, d, nstep=200)
        speed[factor] = abs(d.qvel[0])
    assert speed[0.99] < 1e-6 < speed[1.01]


def test_leg8_against_its_parameter_table(leg8):
    report = check("leg8")
    source = load_table()["source"]
    for muscle in report.muscles:
        row = source["muscles"][muscle.name]
        cosine = np.cos(row["pennation_angle"])
        assert muscle.max_isometric_force == pytest.approx(row["max_isometric_force"] * cosine, rel=1e-5)
        assert muscle.optimal_fiber_length == pytest.approx(row["optimal_fiber_length"] * cosine, rel=1e-4)
        assert (muscle.activation_time, muscle.deactivation_time) == (0.01, 0.04)
        least, most = muscle.fiber_length_range
        low, high = muscle.force_length_limits
        assert muscle.leaves_limits == (least < low or most > high) == bool(found(report, "note", repr(muscle.name)))
    assert {muscle.name: muscle.joints for muscle in report.muscles} == {
        "iliopsoas": ("hip",),
        "glut_max": ("hip",),
        "rect_fem": ("hip", "knee"),
        "hamstrings": ("hip", "knee"),
        "vasti": ("knee",),
        "gastroc": ("knee", "ankle"),
        "soleus": ("ankle",),
        "tib_ant": ("ankle",),
    }
    assert report.total_mass == pytest.approx(sum(body["mass"] for body in source["bodies"].values()))
    assert [joint.column for joint in report.joints] == ["hip_flexion_r", "knee_angle_r", "ankle_angle_r"]
    assert [joint.range for joint in report.joints] == [pytest.approx(tuple(row)) for row in leg8.joint_range]
    assert not [problem for problem in report.problems if problem.level != "note"]
    for joint in report.joints:
        negative, positive = joint.strength
        assert joint.negative_strength_range[0] - 1 <= negative <= joint.negative_strength_range[1] + 1
        assert joint.positive_strength_range[0] - 1 <= positive <= joint.positive_strength_range[1] + 1


def test_strength_of_leg8_is_what_the_engine_gives_with_muscles_on_and_off(leg8):
    m = leg8.mj_model
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    passive = d.qfrc_actuator.copy()
    each = []
    for i in range(m.nactuator):
        d.act[:] = 0
        d.act[i] = 1
        mujoco.mj_forward(m, d)
        each.append(d.qfrc_actuator - passive)
    each = np.array(each)
    for j, joint in enumerate(check(leg8).joints):
        assert joint.strength == pytest.approx((each[:, j].clip(max=0).sum(), each[:, j].clip(min=0).sum()))
        assert joint.passive_moment == pytest.approx(passive[j])


def test_the_same_whatever_is_handed_in(tmp_path, two_joints):
    path = tmp_path / "arm.xml"
    path.write_text(PENDULUMS)
    m = mujoco.MjModel.from_xml_string(PENDULUMS)
    flags = m.opt.disableflags
    reports = [check(source) for source in (path, str(path), m, mujoco.MjSpec.from_string(PENDULUMS), two_joints)]
    assert all(report.to_dict() == reports[0].to_dict() for report in reports)
    assert m.opt.disableflags == flags
    assert not two_joints.mj_model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)


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


TWO_SIDED = """
<mujoco model="two_sided">
  <option integrator="RK4"/>
  <worldbody><body>
    <joint name="elbow" type="hinge" axis="0 -1 0" range="-60 60" limited="true"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1" contype="0" conaffinity="0"/>
  </body></worldbody>
  <actuator>
    <general name="bends" joint="elbow" gear="-.05" dyntype="muscle" dynprm=".01 .04" gainprm="-300" {bends}/>
    <general name="stretches" joint="elbow" gear=".04" dyntype="muscle" dynprm=".01 .04" gainprm="-200" {stretches}/>
  </actuator>
</mujoco>"""


@pytest.mark.parametrize(
    ("bends", "stretches", "strength"),
    [
        ("0 1", "0 1", (-8, 15)),
        ("0 .5", "0 1", (-8, 7.5)),
        ("0 1", ".25 1", (-8, 13)),  # the one that stays on takes 200 N .25 .04 m away
        (".1 .5", ".25 .75", (-6 + 1.5, 7.5 - 2)),
        ("-1 3", "-1 1", (-8, 15)),  # what solve lets through is within 0..1
    ],
)
def test_strength_counts_the_range_of_excitations(bends, stretches, strength):
    ends = {"bends": bends, "stretches": stretches}
    xml = TWO_SIDED.format(**{name: f'ctrlrange="{text}" ctrllimited="true"' for name, text in ends.items()})
    report = check_xml(xml)
    (joint,) = report.joints
    assert joint.strength == pytest.approx(strength)
    assert joint.negative_strength_range == pytest.approx((strength[0], strength[0]))
    assert joint.positive_strength_range == pytest.approx((strength[1], strength[1]))
    model = mjhcmc.MuscleModel.load(mujoco.MjModel.from_xml_string(xml))
    for i, (name, text) in enumerate(ends.items()):
        low, high = np.clip([float(word) for word in text.split()], 0, 1)
        assert report.muscles[i].excitation_range == (low, high) == tuple(model.excitation_range[i])
        notes = [p for p in found(report, "note", repr(name)) if "ctrlrange" in p.remedy]
        assert len(notes) == ((low, high) != (0, 1))
        for note in notes:
            assert f"up to {high:g}" in note.what
            assert (f"never below {low:g}, where it weakens its antagonists" in note.what) == (low > 0)


def test_the_step_at_full_activation_is_that_at_the_upper_end():
    half = MUSCLE_ACTUATOR.replace('ctrlrange="0 1"', 'ctrlrange="0 .5" ctrllimited="true"')
    _, active = check_xml(HANGING_MASS.format(actuator=half)).steps
    assert active.at_reference == pytest.approx(RK4_LIMIT / (0.5 * 92 * 2 * 0.3 / 1.5 / 2), rel=1e-4)


@pytest.mark.parametrize("gainprm", ["-100", "100"])
def test_one_definition_of_max_isometric_force(gainprm):
    xml = HANGING_MASS.format(actuator=LINEAR_ACTUATOR.replace('"-100"', f'"{gainprm}"'))
    model = mjhcmc.MuscleModel.load(mujoco.MjModel.from_xml_string(xml))
    assert model.max_isometric_force == [100]
    assert np.isnan(model.optimal_fiber_length).all()
    assert check_xml(xml).muscles[0].max_isometric_force == 100
    affine = xml.replace('gaintype="fixed"', 'gaintype="affine"')
    assert np.isnan(mjhcmc.MuscleModel.load(mujoco.MjModel.from_xml_string(affine)).max_isometric_force).all()
    report = check_xml(affine)
    assert report.muscles[0].max_isometric_force is None
    json.dumps(report.to_dict(), allow_nan=False)
    assert "nan" not in report.screen().lower()


def test_a_disabled_muscle_is_measured_all_the_same():
    report = check_xml(REFUSED["disabled"][0])
    assert report.joints[0].strength == pytest.approx((0, 92))


BROKEN = (
    PENDULUMS.replace('name="elbow" type="hinge"', 'name="elbow" type="ball"')
    .replace('axis="0 -1 0" range="-120 120" limited="true"/>\n        <geom', "/>\n        <geom")
    .replace('force="400"', 'force="400" forcerange="-50 0" forcelimited="true"')
    .replace('force="200"', 'force="200" forcerange="-60 0" forcelimited="true"')
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
        ("joint 'elbow'", "is of type ball; only hinge and slide joints can be followed"),
        ("equality constraint 'fix'", "couples its joints"),
        ("equality constraint 'pin'", "couples its joints"),
        ("muscle 'flexor'", "is clamped by forcerange -50..0"),
        ("muscle 'biceps'", "is clamped by forcerange -60..0"),
        ("muscle 'biceps'", "has ctrlrange -1..0"),
        ("custom text 'opensim_coordinates'", "holds 'wrist=x'"),
    ]
    with pytest.raises(
        mjhcmc.ModelError, match=r"joint 'elbow' is of type ball.*\(and 6 more: mjhcmc check MODEL lists them\)$"
    ):
        mjhcmc.MuscleModel.load(m)
    assert [(joint.type, joint.strength is None) for joint in report.joints] == [("hinge", False), ("ball", True)]
    text = report.screen()
    assert "likewise, with other numbers (1): biceps" in text
    assert "likewise (1): pin" in text
    assert found(report, "note", "equality constraints")


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
    assert (report.colliding_pairs, report.contacts_at_reference) == (1, 1)
    assert {p.where for p in report.problems if p.level == "note"} >= {
        "the actuators that are no muscles",
        "the model's integrator",
        "some geoms",
    }
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
        assert len(one.splitlines()) < 60


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

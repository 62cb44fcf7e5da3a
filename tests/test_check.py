"""check: what it measures in models with closed forms."""

import json
import re

import mujoco
import numpy as np
import pytest
from check_tools import check_xml, found, pendulum_strength
from conftest import HANGING_MASS, LINEAR_ACTUATOR, MUSCLE_ACTUATOR, PENDULUMS
from test_model import REFUSED

import mjhcmc
from mjhcmc.leg8 import load_table
from mjhcmc.model_check.check import check

RK4_LIMIT = 2.78


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

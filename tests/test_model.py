"""MuscleModel: what it reads, and what it refuses by name."""

import warnings

import mujoco
import numpy as np
import pytest
from conftest import HANGING_MASS, MUSCLE_ACTUATOR, PENDULUMS, load_xml

import mjhcmc
from mjhcmc.dynamics import node_forces


def hanging(actuator=MUSCLE_ACTUATOR):
    return HANGING_MASS.format(actuator=actuator)


def test_reads_names_and_ranges(leg8):
    assert leg8.name == "leg8"
    assert leg8.joint_names == ("hip", "knee", "ankle") == leg8.dof_names
    assert leg8.muscle_names == (
        "iliopsoas", "glut_max", "rect_fem", "hamstrings", "vasti", "gastroc", "soleus", "tib_ant",
    )  # fmt: skip
    np.testing.assert_allclose(np.rad2deg(leg8.joint_range), [[-120, 120], [-120, 10], [-90, 90]])
    assert leg8.column_map == {"hip": "hip_flexion_r", "knee": "knee_angle_r", "ankle": "ankle_angle_r"}
    np.testing.assert_allclose(leg8.activation_parameters, np.tile([0.01, 0.04, 0], (8, 1)))


def test_loads_from_name_path_spec_and_model(tmp_path):
    path = tmp_path / "some_leg.xml"
    path.write_text(PENDULUMS)
    spec = mujoco.MjSpec.from_string(PENDULUMS)
    for source in (path, str(path), spec, mujoco.MjModel.from_xml_string(PENDULUMS)):
        assert mjhcmc.MuscleModel.load(source).muscle_names == ("flexor", "biceps")
    binary = tmp_path / "leg.mjb"
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(PENDULUMS), str(binary))
    assert mjhcmc.MuscleModel.load(binary).joint_names == ("shoulder", "elbow")
    model = mjhcmc.MuscleModel.load(path)
    assert mjhcmc.MuscleModel.load(model) is model


def test_what_is_handed_in_stays_as_it_was():
    theirs = mujoco.MjModel.from_xml_string(PENDULUMS.replace("RK4", "Euler"))
    with pytest.warns(mjhcmc.MjhcmcWarning, match=r"step it by Euler, its default or .*by RK4 .*integrator='euler'"):
        model = mjhcmc.MuscleModel.load(theirs)
    assert theirs.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mjhcmc.MuscleModel.load(theirs, integrator="euler")
    with pytest.raises(mjhcmc.SettingsError, match="integrator 'midpoint' is not known"):
        mjhcmc.MuscleModel.load(theirs, integrator="midpoint")
    assert model.mj_model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4


def test_motors_beside_muscles_are_no_muscles(two_joints):
    mixed = PENDULUMS.replace("<actuator>", '<actuator><motor name="m" joint="elbow"/><position joint="elbow" kp="5"/>')
    model = load_xml(mixed)
    assert model.muscle_names == ("flexor", "biceps")
    motion = mjhcmc.Motion.cosine(model, amplitudes={"shoulder": 0.3, "elbow": 0.3}, period=0.8, cycles=1)
    solution = mjhcmc.hcmc(model, motion)
    assert np.rad2deg(np.abs(solution.tracking_error).max()) < 0.5
    assert not np.isnan(solution.net_joint_moment).any()
    np.testing.assert_allclose(  # the position servo is an external force, not a muscle's
        solution.net_joint_moment[:-1] - solution.reserve,
        [_muscle_moment(model, solution, k) for k in range(solution.n_window)],
        atol=1e-8,
    )


def _muscle_moment(model, solution, k):
    plant = mjhcmc.MujocoPlant(model)
    from mjhcmc import dynamics
    from mjhcmc.plant import State

    plant.set_state(State(0.0, solution.qpos[k], solution.qvel[k], solution.activation[k], np.zeros(model.nv)))
    plant.forward()
    return dynamics.moment_arms(plant).T @ solution.muscle_force[k]


def test_a_name_made_up_for_a_nameless_joint_is_no_other_joints():
    model = load_xml(PENDULUMS.replace('name="shoulder"', 'name="joint1"').replace('joint name="elbow" ', "joint "))
    assert model.joint_names == ("joint1", "joint1_")


def test_column_map_of_a_model(tmp_path):
    text = '<custom><text name="opensim_coordinates" data="shoulder=-arm_flex elbow=elbow_flexion"/></custom>'
    model = load_xml(PENDULUMS.replace("<actuator>", text + "<actuator>"))
    assert model.column_map == {"shoulder": "-arm_flex", "elbow": "elbow_flexion"}
    with pytest.raises(mjhcmc.ModelError, match=r"'wrist=x'.*shoulder, elbow"):
        load_xml(PENDULUMS.replace("<actuator>", text.replace("shoulder=-arm_flex", "wrist=x") + "<actuator>"))


REFUSED = {
    "no muscle": (hanging('<motor name="m" joint="height"/>'), r"'hanging' has no muscle among its 1 actuators"),
    "joint clamp": (
        hanging().replace('name="height"', 'name="height" actuatorfrcrange="-5 5" actuatorfrclimited="true"'),
        r"joint 'height' is clamped by actuatorfrcrange",
    ),
    "tendon clamp": (
        hanging().replace('name="rope"', 'name="rope" actuatorfrcrange="-5 0" actuatorfrclimited="true"'),
        r"muscle 'pull' pulls tendon 'rope'.*actuatorfrcrange",
    ),
    "actearly": (
        hanging(
            '<general name="pull" tendon="rope" dyntype="muscle" dynprm=".01 .04" gaintype="fixed" gainprm="-1" '
            'actearly="true"/>'
        ),
        r"'pull' has actearly",
    ),
    "ctrlrange": (
        hanging(MUSCLE_ACTUATOR.replace('"0 1"', '"-1 0" ctrllimited="true"')),
        r"'pull' has ctrlrange -1\.\.0",
    ),
    "equality of flexes": (
        PENDULUMS.replace(
            "<worldbody>",
            '<worldbody><flexcomp name="cord" type="grid" count="2 1 1" spacing=".1 .1 .1" dim="1" pos="1 0 0">'
            '<edge equality="true"/></flexcomp>',
        ),
        r"equality constraint .* is of a type that cannot be followed \(only joint, tendon, connect and weld can\)",
    ),
    "disabled": (
        hanging().replace("<option", '<option actuatorgroupdisable="0"'),
        r"'pull' is disabled",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_by_name(case):
    xml, message = REFUSED[case]
    with pytest.raises(mjhcmc.ModelError, match=message):
        load_xml(xml)


@pytest.mark.parametrize("clamp", [(-50, -50), (0, 50), (20, 50)])
def test_a_forcerange_that_leaves_no_pull_is_refused(clamp):
    m = mujoco.MjModel.from_xml_string(hanging())
    m.actuator_forcelimited[0], m.actuator_forcerange[0] = True, clamp
    message = (
        rf"muscle 'pull' has forcerange {clamp[0]}\.\.{clamp[1]}, which leaves no pull \(negative force\): correct"
    )
    with pytest.raises(mjhcmc.ModelError, match=message):
        mjhcmc.MuscleModel.load(m)


# --- what models may have -----------------------------------------------------------------------------------------


def test_a_forcerange_is_taken():
    """Force is affine in activation up to the clamp; what is clamped comes back as what the muscle pulls."""
    model = load_xml(hanging(MUSCLE_ACTUATOR.replace("/>", ' forcerange="-50 0" forcelimited="true"/>')))
    assert model.muscle_names == ("pull",)
    plant = mjhcmc.MujocoPlant(model)
    for activation, clamped in ((0.2, False), (1.0, True)):
        plant.set_state(mjhcmc.plant.State(0.0, np.zeros(1), np.zeros(1), np.array([activation]), np.zeros(1)))
        plant.forward()
        force = node_forces(plant).muscle_force[0]
        assert (force == 50) == clamped
        assert 0 < force <= 50


def test_a_ball_joints_coordinates_and_degrees_of_freedom_are_named():
    ball = hanging().replace('type="slide" axis="0 0 1" range="-.5 .5" limited="true"', 'type="ball"')
    model = load_xml(ball.replace('site name="hook" pos="0 0 0"', 'site name="hook" pos=".1 0 0"'))
    assert model.joint_names == ("height_qw", "height_qx", "height_qy", "height_qz")
    assert model.dof_names == ("height_rx", "height_ry", "height_rz")
    assert model.dof_is_rotation.all()
    assert not model.joint_is_rotation.any()
    assert model.quaternions == (0,)
    np.testing.assert_array_equal(model.joint_range, np.tile([-np.inf, np.inf], (4, 1)))
    np.testing.assert_array_equal(model.qpos_reference, [1, 0, 0, 0])


def test_a_free_joints_coordinates_follow_those_before_it():
    free = '<worldbody><body name="base"><freejoint name="base"/><geom size=".1" contype="0" conaffinity="0"/></body>'
    model = load_xml(PENDULUMS.replace("<worldbody>", free))
    assert model.joint_names[:7] == ("base_tx", "base_ty", "base_tz", "base_qw", "base_qx", "base_qy", "base_qz")
    assert model.dof_names == ("base_tx", "base_ty", "base_tz", "base_rx", "base_ry", "base_rz", "shoulder", "elbow")
    assert model.dof_is_rotation.tolist() == [False] * 3 + [True] * 5
    assert model.quaternions == (3,)
    assert (model.nq, model.nv) == (9, 8)


def test_an_equality_makes_its_joint_dependent():
    tie = '<equality><joint name="tie" joint1="elbow" joint2="shoulder" polycoef=".1 -2 0 0 0"/></equality><actuator>'
    model = load_xml(PENDULUMS.replace("<actuator>", tie))
    assert [str(role) for role in model.roles.of] == ["tracked", "dependent"]
    np.testing.assert_allclose(model.qpos_reference, [0, 0.1])


# --- files --------------------------------------------------------------------------------------------------------


def test_files_that_are_no_model(tmp_path):
    with pytest.raises(mjhcmc.ModelError, match=r"no model 'leg9'.*shipped models \(leg8, leg8_gait\)"):
        mjhcmc.MuscleModel.load("leg9")
    broken = tmp_path / "broken.xml"
    broken.write_text("<mujoco><worldbody><body></mujoco>")
    with pytest.raises(mjhcmc.ModelError, match=r"broken\.xml: MuJoCo cannot load it"):
        mjhcmc.MuscleModel.load(broken)
    with pytest.raises(mjhcmc.ModelError, match="got int"):
        mjhcmc.MuscleModel.load(3)

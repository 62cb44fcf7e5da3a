"""A patient's leg: what the record says is what the model has, and passive joints resist as measured ones do."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

import mjhcmc
from mjhcmc.hill_muscles import hill_model
from mjhcmc.leg8 import MUSCLES, load_table
from mjhcmc.patients.groups import GROUPS
from mjhcmc.patients.leg import HEALTHY_STIFFNESS, gait_leg_of, leg_of, passive_stiffness
from mjhcmc.patients.patient import GroupState, sample_patient

TABLE = load_table()
SOURCE = TABLE["source"]
SEGMENTS = {"thigh": ("femur",), "shank": ("tibia",), "foot": ("talus", "calcn", "toes")}
TOLERANCE = 5e-6  # six digits, as the model's file has


def healthy(**changes):
    """Leg8's own body, and nothing wrong with it."""
    bodies = SOURCE["bodies"]
    fractions = {
        f"{segment}_mass_fraction": sum(bodies[part]["mass"] for part in parts) / SOURCE["body_mass"]
        for segment, parts in SEGMENTS.items()
    }
    own = {"height": SOURCE["height"], "body_mass": SOURCE["body_mass"], "strength": 1.0, "paresis": 1.0}
    times = {"activation_time": 0.01, "deactivation_time": 0.04}
    groups = tuple(GroupState(name, 0.0, 1.0, 0.6, 0.0, 0.0) for name in GROUPS)
    return dataclasses.replace(sample_patient(0, 0), **{**own, **fractions, **times, "groups": groups, **changes})


def group_of(patient, muscle):
    return next((group for group in patient.groups if muscle in GROUPS[group.name]), None)


@pytest.fixture(scope="module")
def patients():
    return [sample_patient(11, index) for index in range(4)]


def test_a_healthy_patient_of_the_sources_size_is_leg8_but_for_the_vasti():
    model, leg8 = leg_of(healthy()), mjhcmc.MuscleModel.load("leg8")
    m, own = model.mj_model, leg8.mj_model
    assert (model.name, model.muscle_names, model.joint_names) == ("leg8", leg8.muscle_names, leg8.joint_names)
    for name in ("body_mass", "body_ipos", "body_inertia", "body_pos", "site_pos", "tendon_damping"):
        np.testing.assert_allclose(getattr(m, name), getattr(own, name), rtol=TOLERANCE, atol=2e-6, err_msg=name)
    for name in ("actuator_gainprm", "actuator_biasprm"):
        expected = getattr(own, name).copy()
        expected[MUSCLES.index("vasti"), 7] *= HEALTHY_STIFFNESS["vasti"]
        np.testing.assert_allclose(getattr(m, name), expected, rtol=TOLERANCE)
    np.testing.assert_allclose(m.actuator_lengthrange, own.actuator_lengthrange, rtol=TOLERANCE)
    np.testing.assert_array_equal(m.opt.gravity, own.opt.gravity)


def test_segments_weigh_their_share(patients):
    for patient in patients:
        mass = patient.body_mass / SOURCE["body_mass"]
        size = patient.height / SOURCE["height"]
        for build in (leg_of, gait_leg_of):
            m = build(patient).mj_model
            for segment in SEGMENTS:
                expected = getattr(patient, f"{segment}_mass_fraction") * patient.body_mass
                assert m.body(segment).mass[0] == pytest.approx(expected, rel=TOLERANCE)
            assert m.body("pelvis").mass[0] == pytest.approx(SOURCE["bodies"]["pelvis"]["mass"] * mass, rel=TOLERANCE)
            # inertia about the mass centre goes with mass times size squared
            thigh = SOURCE["bodies"]["femur"]
            factor = patient.thigh_mass_fraction * patient.body_mass / thigh["mass"] * size**2
            expected = np.sort(np.array(thigh["inertia"]) * factor)
            np.testing.assert_allclose(np.sort(m.body("thigh").inertia), expected, rtol=TOLERANCE)
            np.testing.assert_allclose(m.body("thigh").ipos[2], thigh["com"][1] * size, atol=1e-6)


def test_muscles_have_the_patients_force_lengths_and_times(patients):
    for patient in patients:
        model = leg_of(patient)
        force = patient.body_mass / SOURCE["body_mass"] * patient.strength * patient.paresis
        size = patient.height / SOURCE["height"]
        hill = hill_model(model)  # undoes the pennation
        slack = []
        for i, name in enumerate(MUSCLES):
            own, group = SOURCE["muscles"][name], group_of(patient, name)
            short = 1 - (group.fiber_shortening if group else 0.0)
            assert hill.muscles.max_isometric_force[i] == pytest.approx(own["max_isometric_force"] * force, rel=1e-5)
            optimal = own["optimal_fiber_length"] * short * size
            assert hill.muscles.optimal_fiber_length[i] == pytest.approx(optimal, rel=1e-5)
            slack.append((own["tendon_slack_length"] + TABLE["fitted"]["slack_offset"][name]) * size)
        np.testing.assert_allclose(hill.muscles.tendon_slack_length, slack, rtol=1e-5)
        times = np.array([[patient.activation_time, patient.deactivation_time]])
        np.testing.assert_allclose(model.activation_parameters[:, :2], np.repeat(times, 8, axis=0), rtol=1e-9)


def test_passive_force_is_the_closed_form(patients):
    curves = TABLE["fitted"]["curves"]
    half = (curves["lmax"] - 1) / 2
    past_the_bend = 0
    for patient in patients:
        model = leg_of(patient)
        m, d = model.mj_model, mujoco.MjData(model.mj_model)
        unweakened = model.max_isometric_force / patient.paresis  # weakness leaves tissue as it is
        for posture in ((-10, -60, 0), (20, -110, 0), (60, -5, 25), (110, -5, 0)):
            d.qpos[:], d.qvel[:], d.act[:] = np.radians(posture), 0.0, 0.0
            mujoco.mj_forward(m, d)
            for i, name in enumerate(MUSCLES):
                own, group = SOURCE["muscles"][name], group_of(patient, name)
                size = patient.height / SOURCE["height"]
                slack = (own["tendon_slack_length"] + TABLE["fitted"]["slack_offset"][name]) * size
                optimal = own["optimal_fiber_length"] * size * (1 - (group.fiber_shortening if group else 0.0))
                strain = (d.actuator_length[i] - slack) / (optimal * np.cos(own["pennation_angle"])) - 1
                x = max(strain, 0.0) / half
                shape = 0.5 * x**2 if x < 1 else x - 0.5
                past_the_bend += x > 1
                stiffer = (0.6 / group.passive_strain) ** 2 if group else 1.0
                factor = HEALTHY_STIFFNESS.get(name, 1.0) * stiffer
                expected = -unweakened[i] * curves["fpmax"] * factor * shape
                assert d.actuator_force[i] == pytest.approx(expected, rel=2e-4, abs=0.01), (name, posture)
    assert past_the_bend  # both branches were there


def test_weakness_takes_active_force_only():
    strong = sample_patient(5, 3)
    weak = dataclasses.replace(strong, paresis=strong.paresis / 2)
    forces = []
    for patient, activation in ((strong, 0.0), (weak, 0.0), (strong, 1.0), (weak, 1.0)):
        m = leg_of(patient).mj_model
        d = mujoco.MjData(m)
        d.qpos[:], d.act[:] = np.radians((-5, -80, 5)), activation
        mujoco.mj_forward(m, d)
        forces.append(d.actuator_force.copy())
    np.testing.assert_allclose(forces[1], forces[0], rtol=TOLERANCE * 4)
    assert np.abs(forces[0]).max() > 50
    np.testing.assert_allclose(forces[3] - forces[1], (forces[2] - forces[0]) / 2, rtol=1e-4)


def test_contracture_stiffens_its_own_group_only():
    one = healthy()
    groups = tuple(
        dataclasses.replace(group, passive_strain=0.3) if group.name == "plantarflexors" else group
        for group in one.groups
    )
    stiff = dataclasses.replace(one, groups=groups)
    ratio = [passive_stiffness(stiff, name) / passive_stiffness(one, name) for name in MUSCLES]
    assert ratio == pytest.approx([4.0 if name in GROUPS["plantarflexors"] else 1.0 for name in MUSCLES])
    short = tuple(dataclasses.replace(g, fiber_shortening=0.1 * (g.name == "knee_flexors")) for g in one.groups)
    lengths = [leg_of(dataclasses.replace(one, groups=g)).optimal_fiber_length for g in (one.groups, short)]
    expected = [0.9 if name == "hamstrings" else 1.0 for name in MUSCLES]
    np.testing.assert_allclose(lengths[1] / lengths[0], expected, rtol=TOLERANCE)


def test_the_walking_leg_has_the_same_muscles(patients):
    for patient in patients[:2]:
        leg, gait = leg_of(patient).mj_model, gait_leg_of(patient).mj_model
        assert gait.nq == 6
        for name in ("actuator_gainprm", "actuator_biasprm", "actuator_dynprm", "actuator_lengthrange"):
            np.testing.assert_array_equal(getattr(leg, name), getattr(gait, name))
        np.testing.assert_array_equal(leg.tendon_damping, gait.tendon_damping)


def test_the_look_changes_no_motion_and_a_leg_is_the_same_each_time(patients):
    ends = []
    for look in (False, True, False):
        m = leg_of(patients[0], look=look).mj_model
        d = mujoco.MjData(m)
        d.ctrl[:] = 0.2
        mujoco.mj_step(m, d, 100)
        ends.append((d.qpos.copy(), d.qvel.copy(), m.ngeom))
    for qpos, qvel, _ in ends[1:]:
        np.testing.assert_array_equal(qpos, ends[0][0])
        np.testing.assert_array_equal(qvel, ends[0][1])
    assert ends[1][2] > ends[0][2] == ends[2][2]


def riener_edrich(hip, knee, ankle):
    """Measured passive moments (Riener, Edrich 1999, J. Biomech. 32, 539-544), N m.

    Angles in degrees, knee flexion and dorsiflexion positive; moments in leg8's signs (hip flexion, knee extension,
    dorsiflexion positive).
    """
    exp = np.exp
    at_hip = exp(1.4655 - 0.0034 * knee - 0.075 * hip) - exp(1.3403 - 0.0226 * knee + 0.0305 * hip) + 8.072
    at_knee = -(
        exp(1.8 + 0.046 * ankle - 0.0352 * knee + 0.0217 * hip)
        - exp(-3.971 + 0.0004 * ankle + 0.0495 * knee - 0.0128 * hip)
        - 4.82
        + exp(2.22 - 0.15 * knee)
    )
    at_ankle = exp(-7.9763 - 0.1949 * ankle + 0.0008 * knee) - exp(2.1016 + 0.0843 * ankle - 0.0176 * knee) + 1.792
    return at_hip, at_knee, at_ankle


@pytest.mark.parametrize(
    ("joint", "posture"),
    [
        *((0, (hip, -60, 0)) for hip in (40, 20, 0, -10)),
        *((1, (20, knee, 0)) for knee in (-20, -50, -80, -110)),
        *((2, (20, -10, ankle)) for ankle in (-35, -15, 0, 8, 15)),
    ],
)
def test_a_healthy_leg_resists_as_measured(joint, posture):
    m = leg_of(healthy()).mj_model
    d = mujoco.MjData(m)
    d.qpos[:] = np.radians(posture)
    mujoco.mj_forward(m, d)
    measured = riener_edrich(posture[0], -posture[1], posture[2])[joint]
    # joints have ligaments, and people differ; leg8's own vasti alone would be 20 N m off
    assert d.qfrc_actuator[joint] == pytest.approx(measured, abs=9.0)

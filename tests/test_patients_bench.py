"""Clinical tests on the muscle-driven leg."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.special import ellipk

from mjhcmc.errors import SettingsError
from mjhcmc.leg8.table import JOINTS, MUSCLES
from mjhcmc.patients.bench import Case, clock_of, run_trials
from mjhcmc.patients.drive import ANTAGONISTS, drive_of
from mjhcmc.patients.examination import usual_of
from mjhcmc.patients.examiner import HAND_MASS, LEVERS, strength_at
from mjhcmc.patients.leg import gait_leg_of, leg_of
from mjhcmc.patients.patient import healthy, sample_patient
from mjhcmc.patients.reflex import ReflexLaw, reflex_along
from mjhcmc.patients.resistance import hand_on, read_resistance
from mjhcmc.patients.trials import REST, Trial, min_jerk, pendulum, stretch, voluntary

HEALTHY = healthy()


def spastic(**changes):
    """A person with reflexes of some strength in all groups."""
    groups = tuple(
        replace(group, gain=0.15, threshold=0.3, tone=0.02, **changes.pop(group.name, {})) for group in HEALTHY.groups
    )
    return replace(HEALTHY, groups=groups, cocontraction=0.2, **changes)


@pytest.fixture(scope="module")
def records():
    """All kinds of trials of a spastic person, by name, all in one call."""
    patient = spastic()
    trials = [
        stretch("knee", "fast", np.radians(180), rate=200.0),
        stretch("ankle", "mas"),
        stretch("hip", "mas"),
        stretch("knee", "slow", np.radians(60), examiner="servo"),
        pendulum(duration=1.5),
    ]
    cases = [Case(patient, leg_of(patient), trial) for trial in trials]
    return {case.trial.name: (case, record) for case, record in zip(cases, run_trials(cases), strict=True)}


def test_what_the_examiner_applies_is_what_inverse_dynamics_asks_for(records):
    for case, record in records.values():
        assert not record.failure
        m = case.model.mj_model
        if case.trial.posture == "side_lying":
            gravity = [0.0, -9.80665, 0.0]
        else:  # seated: the thigh, at its hip angle, is level
            hip = case.trial.pose[0]
            gravity = [-9.80665 * np.cos(hip), 0.0, -9.80665 * np.sin(hip)]
        m.opt.gravity[:] = gravity
        d = mujoco.MjData(m)
        for k in range(len(record.time)):
            d.qpos[:], d.qvel[:], d.act[:] = record.qpos[k], record.qvel[k], record.activation[k]
            mujoco.mj_forward(m, d)
            d.qacc[:] = record.qacc[k]
            mujoco.mj_inverse(m, d)
            needed = d.qfrc_inverse - d.qfrc_actuator
            damping = m.tendon_damping * d.ten_velocity
            np.testing.assert_allclose(record.muscle_force[k], damping - d.actuator_force, rtol=1e-9, atol=1e-6)
            np.testing.assert_allclose(record.examiner_torque[k], needed, atol=2e-5 * max(1.0, np.abs(needed).max()))


def test_joints_that_are_not_under_test_stay_where_they_are_held(records):
    for case, record in records.values():
        held = [i for i, joint in enumerate(JOINTS) if joint != case.trial.joint]
        np.testing.assert_array_equal(
            record.qpos[:, held], np.tile(np.array(case.trial.pose)[held], (len(record.qpos), 1))
        )
        assert not record.qvel[:, held].any()


def test_a_machine_follows_its_course_exactly(records):
    case, record = records["slow_60/knee"]
    q, v, a = case.trial.desired(record.time)
    np.testing.assert_allclose(record.qpos[:, 1], q, atol=1e-12)
    np.testing.assert_allclose(record.qvel[:, 1], v, atol=1e-12)
    np.testing.assert_allclose(record.qacc[:, 1], a, atol=1e-5)


def test_the_reflex_is_the_law_along_the_fibers_own_velocity(records):
    case, record = records["fast_180/knee"]
    drive, period = drive_of(case.patient, case.trial.session), clock_of(case.trial).period
    assert np.diff(record.time) == pytest.approx(period)
    law = ReflexLaw(drive.mode, drive.gain[None], drive.threshold[None], np.array([drive.delay - period / 2]), period)
    np.testing.assert_allclose(record.reflex, reflex_along(law, record.time, record.fiber_velocity), atol=1e-12)
    assert record.reflex[:, MUSCLES.index("vasti")].max() > 0.05
    u = np.clip(drive.tone + record.reflex + 0.2 * record.reflex @ ANTAGONISTS, 0, 1)
    np.testing.assert_allclose(record.excitation, u, atol=1e-12)
    assert drive.gain[MUSCLES.index("glut_max")] == 0


def test_fibers_are_those_of_the_path(records):
    case, record = records["mas/ankle"]
    d = mujoco.MjData(case.model.mj_model)
    d.qpos[:] = record.qpos[40]
    mujoco.mj_forward(case.model.mj_model, d)
    gain, limits = case.model.mj_model.actuator_gainprm, case.model.mj_model.actuator_lengthrange
    L0 = (limits[:, 1] - limits[:, 0]) / (gain[:, 1] - gain[:, 0])
    np.testing.assert_allclose(
        record.fiber_length[40], gain[:, 0] + (d.actuator_length - limits[:, 0]) / L0, atol=1e-12
    )
    assert record.muscle_force[40].min() > -1.0
    v, grown = record.fiber_velocity[:, 6], np.diff(record.fiber_length[:, 6])
    np.testing.assert_allclose(np.cumsum((v[1:] + v[:-1]) / 2 * 0.01), np.cumsum(grown), atol=0.01)


def test_company_threads_and_order_change_no_bit(records):
    patient = spastic()
    names = list(records)
    alone = run_trials([records[names[1]][0]], threads=1)[0]
    other = [Case(sample_patient(1, i), leg_of(sample_patient(1, i)), stretch("ankle", "mas")) for i in range(2)]
    mixed = run_trials([*other, Case(patient, leg_of(patient), stretch("ankle", "mas"))], threads=2)[2]
    for record in (alone, mixed):
        for name in ("qpos", "qacc", "examiner_torque", "excitation", "muscle_force", "fiber_velocity"):
            np.testing.assert_array_equal(getattr(record, name), getattr(records[names[1]][1], name))


def test_resistance_goes_with_speed_only_where_there_are_reflexes():
    def peaks(patient):
        trials = [stretch("knee", "slow", np.radians(30), examiner="servo"), stretch("knee", "fast", np.radians(240))]
        found = run_trials([Case(patient, leg_of(patient), trial) for trial in trials])
        return [np.max(-(r.examiner_torque[:, 1] - r.inertia * r.qacc[:, 1])) for r in found]

    slow, fast = peaks(HEALTHY)
    assert fast == pytest.approx(slow, rel=0.35)  # damping of fibers only
    slow, fast = peaks(spastic())
    assert fast > 2 * slow


def test_a_limb_without_muscles_swings_like_a_pendulum():
    limp = replace(
        HEALTHY, strength=0.01, paresis=0.01, groups=tuple(replace(g, passive_strain=5.0) for g in HEALTHY.groups)
    )
    model = leg_of(limp)
    m = model.mj_model
    m.tendon_damping[:] = 0
    m.jnt_limited[:] = 0  # undamped it swings farther than a knee bends
    m.actuator_gainprm[:, 7] = m.actuator_biasprm[:, 7] = 1e-9  # no passive force either
    record = run_trials([Case(limp, model, pendulum(duration=1.5, rate=200.0))])[0]
    d = mujoco.MjData(m)
    d.qpos[:] = (np.radians(30), 0, 0)
    mujoco.mj_forward(m, d)
    shank = m.body("shank").id
    mass, com = m.body_subtreemass[shank], d.subtree_com[shank] - d.xpos[shank]
    l = np.hypot(com[0], com[2])  # noqa: E741
    # the mass centre does not lie on the shank's axis: the angle from the thigh's direction is where it begins
    thigh = np.array([np.sin(np.radians(30)), -np.cos(np.radians(30))])
    begin = np.pi / 2 - np.arctan2(*(np.array([[thigh[1], -thigh[0]], [thigh[0], thigh[1]]]) @ [com[0], com[2]]))
    quarter = ellipk(np.sin(begin / 2) ** 2) * np.sqrt(record.inertia / (mass * 9.80665 * l))
    turns = np.flatnonzero(np.diff(np.sign(record.qvel[:, 1])) > 0)[0]
    turned = record.time[turns] - record.qvel[turns, 1] / record.qacc[turns, 1]
    assert turned == pytest.approx(2 * quarter, rel=0.01)


def test_a_machine_stops_at_what_an_examiner_could_do():
    groups = tuple(replace(g, passive_strain=0.3, fiber_shortening=0.15) for g in HEALTHY.groups)
    stiff = replace(HEALTHY, groups=groups)
    record = run_trials([Case(stiff, leg_of(stiff), stretch("ankle", "slow", np.radians(30), examiner="servo"))])[0]
    most, resisted = strength_at("ankle", stiff.height), record.examiner_torque[:, 2]
    over = np.flatnonzero(resisted > most)
    assert len(over)
    assert resisted.max() < 1.1 * most
    stopped = record.qpos[over[0] + 2 :, 2]
    assert np.ptp(stopped) == 0
    assert stopped[0] < record.trial.end - 0.05


def test_a_healthy_limb_goes_as_fast_as_is_meant():
    trials = [stretch(joint, "fast", np.radians(v)) for joint in JOINTS for v in (120, 180, 240)]
    for trial, record in zip(trials, run_trials([Case(HEALTHY, leg_of(HEALTHY), t) for t in trials]), strict=True):
        fastest = np.abs(record.qvel[:, JOINTS.index(trial.joint)]).max()
        assert fastest == pytest.approx(trial.speed, rel=0.06), trial.name


def test_without_a_reflex_nothing_catches():
    """Fibers that shortened and stiffened resist, also while the limb is set going, but there is nothing sudden."""
    groups = tuple(replace(g, passive_strain=0.4, fiber_shortening=0.05) for g in HEALTHY.groups)
    stiff = replace(HEALTHY, groups=groups)
    for joint in JOINTS:
        record = run_trials([Case(stiff, leg_of(stiff), stretch(joint, "mas"))])[0]
        assert not read_resistance(record, hand_on(joint, stiff.height), usual_of(stiff, joint)).catch


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda case: run_trials([case], finer=0), "finer must be"),
        (lambda case: run_trials([replace(case, trial=voluntary("cosine", "slow", 100.0))]), "movement by will"),
        (lambda case: run_trials([replace(case, model=gait_leg_of(HEALTHY))]), "use leg_of"),
        (lambda case: run_trials([replace(case, trial=replace(case.trial, rate=150.0))]), "rate of 150 Hz is not kept"),
        (lambda case: stretch("knee", "mas", rate=0.0), "positive rate"),
        (lambda case: stretch("knee", "mas", rate=np.nan), "positive rate"),
    ],
)
def test_what_cannot_be_carried_out_is_refused(call, message):
    with pytest.raises(SettingsError, match=message):
        call(Case(HEALTHY, leg_of(HEALTHY), stretch("knee", "mas")))


def test_no_trials_no_records():
    assert run_trials([]) == []


def test_an_arm_is_no_stronger_than_it_is():
    groups = tuple(replace(g, passive_strain=0.3, fiber_shortening=0.15) for g in HEALTHY.groups)
    stiff = replace(HEALTHY, groups=groups)
    record = run_trials([Case(stiff, leg_of(stiff), stretch("ankle", "mas"))])[0]
    assert record.qpos[-1, 2] < record.trial.end - 0.05
    hand = HAND_MASS * (LEVERS["ankle"] * stiff.height) ** 2
    pushed = record.examiner_torque[:, 2] + hand * record.qacc[:, 2]
    assert np.abs(pushed).max() <= strength_at("ankle", stiff.height) + 1e-9
    assert pushed[-1] == pytest.approx(strength_at("ankle", stiff.height))  # it does go on pushing


@pytest.mark.parametrize("joint", ["hip", "knee", "ankle"])
def test_a_finer_clock_changes_little(joint):
    patient = spastic()
    case = Case(patient, leg_of(patient), stretch(joint, "fast", np.radians(240)))
    usual, fine = run_trials([case])[0], run_trials([case], finer=3)[0]
    j = JOINTS.index(joint)
    assert np.degrees(np.abs(usual.qpos - fine.qpos)).max() < 0.5
    most = np.abs(fine.examiner_torque[:, j]).max()
    assert np.abs(usual.examiner_torque[:, j] - fine.examiner_torque[:, j]).max() < 0.08 * most


@pytest.mark.parametrize(("muscle", "reflex"), [("rigid", "force"), ("compliant", "equation1")])
def test_other_muscles_and_reflexes_go_the_same_way(muscle, reflex):
    patient = replace(spastic(), muscle=muscle, reflex=reflex)
    if reflex == "force":
        patient = replace(patient, groups=tuple(replace(g, threshold=0.03) for g in patient.groups))
    record = run_trials([Case(patient, leg_of(patient), stretch("knee", "fast", np.radians(240)))])[0]
    assert not record.failure
    assert record.qpos[-1, 1] < record.trial.start - 0.5
    assert record.reflex.max() > 0.01
    if reflex == "equation1":  # it never decays
        assert (np.diff(record.reflex, axis=0) >= 0).all()
    if muscle == "compliant":  # the fiber is not the path
        v, grown = record.fiber_velocity[:, 4], np.diff(record.fiber_length[:, 4])
        np.testing.assert_allclose(np.cumsum((v[1:] + v[:-1]) / 2 * 0.01), np.cumsum(grown), atol=0.01)


def test_one_that_cannot_be_simulated_says_why_and_the_others_go_on(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs there
    model = leg_of(HEALTHY)
    model.mj_model.dof_damping[1] = 1e7
    trial = stretch("knee", "fast", np.radians(240))
    bad, good = run_trials([Case(HEALTHY, model, trial), Case(HEALTHY, leg_of(HEALTHY), trial)])
    assert not good.failure
    assert bad.failure.startswith("fast_240/knee at ")
    assert len(bad.time) < len(good.time)


def test_min_jerk():
    t = np.linspace(-0.1, 1.3, 1401)
    q, v, a = min_jerk(t, np.float64(0.2), np.float64(-1.0), np.float64(1.0))
    assert q[0] == 0.2
    assert q[-1] == pytest.approx(-1.0)
    assert np.abs(v).max() == pytest.approx(1.875 * 1.2, rel=1e-5)
    np.testing.assert_allclose(np.gradient(q, t)[1:-1], v[1:-1], atol=1e-3)
    np.testing.assert_allclose(np.gradient(v, t)[2:-2], a[2:-2], atol=0.2)
    still = min_jerk(t, np.float64(0.2), np.float64(0.2), np.float64(0.0))
    assert (still[0] == 0.2).all()


def test_a_stretch_peaks_at_the_speed_that_is_asked_for():
    trial = stretch("ankle", "fast", np.radians(120))
    _, v, _ = trial.desired(np.linspace(0, trial.duration, 5001))
    assert np.degrees(np.abs(v).max()) == pytest.approx(120, rel=1e-4)
    assert (v >= 0).all()  # dorsiflexion
    mas = stretch("knee", "mas")
    assert mas.movement_time == pytest.approx(1.0)
    assert mas.direction == -1
    assert trial.duration > REST + trial.movement_time


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: stretch("elbow", "mas"), "'elbow' cannot be stretched: choose one of hip, knee, ankle"),
        (lambda: stretch("knee", "pendulum"), "no passive stretch"),
        (lambda: stretch("knee", "fast", -1.0), "positive speed"),
        (lambda: stretch("knee", "fast", np.nan), "positive speed"),
        (lambda: stretch("knee", "mas", examiner="robot"), "examiner 'robot' is not known"),
        (lambda: stretch("knee", "mas", session="home"), "session 'home' is not known"),
        (lambda: Trial("t", "mas", "knee", 0, 1, 1, np.nan, "torque", "seated", (0, 0, 0)), "duration"),
    ],
)
def test_trials_that_make_no_sense_are_refused(call, message):
    with pytest.raises(SettingsError, match=message):
        call()


def test_sessions_differ_and_are_the_patients_own():
    patient = sample_patient(4, 2)
    ideal, one, again = (drive_of(patient, session) for session in ("ideal", "rating", "rating"))
    other = drive_of(patient, "instrumented")
    np.testing.assert_array_equal(one.gain, again.gain)
    assert not np.array_equal(one.gain, other.gain)
    which = ideal.gain > 0
    assert which.any()
    ratios = np.concatenate(
        [
            drive_of(p, "rating").gain[p_gain > 0] / p_gain[p_gain > 0]
            for p in (sample_patient(9, i) for i in range(150))
            for p_gain in [drive_of(p).gain]
        ]
    )
    assert np.log(ratios).std() == pytest.approx(0.2, rel=0.15)
    assert abs(np.log(ratios).mean()) < 0.04

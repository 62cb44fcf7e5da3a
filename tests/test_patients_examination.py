"""A patient's battery of tests, and the block of a dataset that comes of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mjhcmc
from mjhcmc.leg8.table import MUSCLES
from mjhcmc.patients import examination as battery_module
from mjhcmc.patients.bench import Case
from mjhcmc.patients.card import document
from mjhcmc.patients.configuration import Configuration
from mjhcmc.patients.drive import drive_of
from mjhcmc.patients.examination import DEFAULTS, battery, examine, grade, patient_of, simulate_block
from mjhcmc.patients.leg import gait_leg_of, leg_of
from mjhcmc.patients.movement import move
from mjhcmc.patients.patient import healthy, sample_patient
from mjhcmc.patients.record import Record
from mjhcmc.patients.sensors import EMG_MUSCLES, observe
from mjhcmc.patients.tables import SCHEMAS
from mjhcmc.patients.trials import stretch, voluntary
from mjhcmc.patients.walk import walks

WALK = Path(__file__).resolve().parents[2] / "shared" / "walk"
QUICK = DEFAULTS | {"slow_deg_s": 60.0, "fast_deg_s": "240", "shift_fast_deg_s": "200", "movement": "fast"}


@pytest.fixture(scope="module")
def configuration():
    return Configuration(20, 1, 2, QUICK)


@pytest.fixture(scope="module")
def block(configuration):
    return simulate_block(configuration, "train", 0, 2)


def test_the_block_holds_all_that_was_done(block, configuration):
    trials = [trial for trial in battery(QUICK) if trial.session == "instrumented"]
    assert block["trials"].num_rows == 2 * len(trials)
    assert set(block["trials"]["name"].to_pylist()) == {trial.name for trial in trials}
    assert set(block["trials"]["status"].to_pylist()) <= {"ok", "helped"}
    told = block["trials"].to_pandas()
    assert ((told.status == "helped") == (told.reserve_nm > 5)).all()
    assert told.reason[told.status == "helped"].str.contains("the muscles lack up to").all()
    for name, schema in SCHEMAS.items():
        assert block[name].schema == schema
    samples = block["observables"].to_pandas()
    counted = samples.groupby(["patient", "trial"]).size()
    asked = block["trials"].to_pandas().set_index(["patient", "trial"])
    np.testing.assert_allclose(counted, asked.duration_s * asked.rate_hz + 1, atol=1)
    assert np.isfinite(samples.select_dtypes("float").to_numpy()).all()
    hidden = block["privileged"].to_pandas()
    assert (hidden.groupby(["patient", "trial"]).size() == (counted + 1) // 2).all()
    people = block["patients"].to_pandas()
    assert (people.status == "ok").all()
    for joint in ("hip", "knee", "ankle"):
        assert people[f"rater_a/{joint}"].isin(["0", "1", "1+", "2", "3", "4"]).all()
        assert people[f"ideal_rank/{joint}"].between(0, 5).all()
    latent = sample_patient(1, 1).row()
    assert people["latent/gain/knee_extensors"][1] == latent["gain/knee_extensors"]
    for table in block.values():
        assert table["configuration"].unique().to_pylist() == [configuration.hash]
        assert table["seed"].unique().to_pylist() == [1]


def test_every_column_is_documented(block):
    for name, table in block.items():
        assert all(document(name, column) for column in table.column_names), name


def test_the_same_bytes_whoever_is_in_the_block(block, configuration):
    alone = simulate_block(configuration, "train", 1, 2)
    for name, table in block.items():
        whose = table.filter(np.asarray(table["patient"]) == 1)
        assert whose.equals(alone[name]), name


def test_raters_examine_in_sessions_of_their_own():
    names = [trial.name for trial in battery(DEFAULTS)]
    assert len(set(names)) == len(names)
    sessions = [trial.session for trial in battery(DEFAULTS)]
    assert sessions.count("rating") == sessions.count("ideal") == 3
    other = [trial.name for trial in battery(DEFAULTS, "shift_velocity") if trial.test == "fast"]
    assert {name.split("/")[0] for name in other} == {"fast_90", "fast_150", "fast_300"}


def test_shifted_splits_have_other_muscles_or_reflexes(configuration):
    kinds = {split: patient_of(configuration, split, 3) for split in ("test", "shift_muscle", "shift_reflex")}
    assert {split: (p.muscle, p.reflex) for split, p in kinds.items()} == {
        "test": ("mujoco", "velocity"),
        "shift_muscle": ("rigid", "velocity"),
        "shift_reflex": ("mujoco", "force"),
    }


def test_a_patient_who_fails_is_in_the_tables_with_the_reason(configuration, monkeypatch):
    real = battery_module.run_trials

    def fails(cases, **options):
        found = real(cases[:1], **options) * len(cases)
        failed = [Record.missing(c.trial, f"{c.trial.name} at 0.100 s: the simulation diverged") for c in cases]
        return [
            b if c.patient.index == 1 else replace(a, trial=c.trial)
            for a, b, c in zip(found, failed, cases, strict=True)
        ]

    monkeypatch.setattr(battery_module, "run_trials", fails)
    found = simulate_block(configuration, "train", 0, 2)
    people = found["patients"].to_pandas()
    assert people.status.tolist()[1] == "failed"
    assert "at 0.100 s: the simulation diverged" in people.reason[1]
    assert people["rater_a/knee"].isna()[1]
    trials = found["trials"].to_pandas()
    assert (trials[(trials.patient == 1) & (trials.test != "cosine")].status == "failed").all()
    assert found["observables"].to_pandas().query("patient == 1 and trial == 0").empty


def test_a_leg_that_cannot_be_built_fails_its_own_patient_only(configuration, monkeypatch):
    real = battery_module.leg_of

    def fails(patient):
        if patient.index == 0 and patient.severity != 0:
            raise mjhcmc.ModelError("leg8: no such leg")
        return real(patient)

    monkeypatch.setattr(battery_module, "leg_of", fails)
    people = simulate_block(configuration, "train", 0, 2)["patients"].to_pandas()
    assert people.status.tolist() == ["failed", "ok"]
    assert "no such leg" in people.reason[0]


def test_instruments_are_as_noisy_as_they_say():
    patient = healthy()
    trial = stretch("knee", "mas", rate=200.0)
    record = battery_module.run_trials([Case(patient, leg_of(patient), trial)])[0]
    seen = [observe(record, 5, i, 0) for i in range(60)]
    off = np.degrees(np.stack([one.qpos - record.qpos for one in seen]))
    assert off.std() == pytest.approx(0.5, rel=0.1)
    assert np.degrees(np.stack([one.qvel - record.qvel for one in seen])).std() == pytest.approx(1.0, rel=0.05)
    true = record.examiner_torque[:, 1]
    torque = np.stack([one.torque - true for one in seen]) / np.hypot(true, 5.0)
    assert torque.std() == pytest.approx(0.02, rel=0.1)
    assert seen[0].emg.shape[1] == len(EMG_MUSCLES) == 7
    assert (seen[0].emg > 0).all()
    again = observe(record, 5, 0, 0)
    np.testing.assert_array_equal(again.emg, seen[0].emg)
    assert not np.array_equal(observe(record, 5, 0, 1).torque, seen[0].torque)


def affected(**changes):
    groups = tuple(replace(g, gain=0.12, threshold=0.05, tone=0.03) for g in healthy().groups)
    return replace(healthy(), groups=groups, cocontraction=0.2, **changes)


def test_reflexes_and_spill_over_are_worked_against():
    patients = [healthy(), affected()]
    legs = [leg_of(p) for p in patients]
    trial = voluntary("cosine", "slow", 100.0)
    motions = [mjhcmc.Motion.cosine(leg, amplitudes={"knee": -0.5}, period=0.6, cycles=1) for leg in legs]
    free, spastic = move(
        [Case(p, leg, trial) for p, leg in zip(patients, legs, strict=True)], motions, physics_dt=0.002
    )
    assert not free.reflex.any()
    vasti, hamstrings = MUSCLES.index("vasti"), MUSCLES.index("hamstrings")
    assert spastic.reflex[:, vasti].max() > 0.05
    floor = drive_of(patients[1], "instrumented").tone + spastic.reflex
    middles = (floor[:-1] + floor[1:]) / 2
    assert (spastic.excitation[:-1] >= middles - 1e-9).all()
    assert spastic.excitation[:, hamstrings].mean() > free.excitation[:, hamstrings].mean() + 0.01
    for record, motion in zip((free, spastic), motions, strict=True):
        assert not record.failure
        assert np.degrees(np.abs(record.qpos - motion.sample(record.time).qpos)).max() < 0.2
        assert record.reserve < 0.1


def test_a_call_without_people_or_of_a_mixture():
    assert move([], []) == []
    assert examine([], battery(QUICK), Configuration(1, 0, 1, QUICK)) == []
    two = [healthy(), replace(healthy(), muscle="rigid")]
    cases = [Case(p, leg_of(p), voluntary("cosine", "slow", 100.0)) for p in two]
    motions = [mjhcmc.Motion.cosine(case.model, "slow") for case in cases]
    with pytest.raises(mjhcmc.SettingsError, match="different muscles"):
        move(cases, motions)
    with pytest.raises(mjhcmc.SettingsError, match="2 patients move by 1 motions"):
        move(cases, motions[:1])
    with pytest.raises(mjhcmc.SettingsError, match="dt must be a positive"):
        move(cases[:1], motions[:1], dt=0)


def test_fibers_of_hill_muscles_are_their_own():
    person = replace(healthy(), muscle="rigid")
    case = Case(person, leg_of(person), voluntary("cosine", "slow", 100.0))
    motion = mjhcmc.Motion.cosine(case.model, amplitudes={"ankle": -0.2}, period=0.3, cycles=1)
    hill, own = (move([replace(case, patient=p)], [motion], physics_dt=0.002)[0] for p in (person, healthy()))
    soleus = MUSCLES.index("soleus")  # pennate: its fiber is not its path
    assert np.abs(hill.fiber_length[:, soleus] - own.fiber_length[:, soleus]).max() > 1e-3
    v, grown = hill.fiber_velocity[:, soleus], np.diff(hill.fiber_length[:, soleus])
    np.testing.assert_allclose(np.cumsum((v[1:] + v[:-1]) / 2 * 0.01), np.cumsum(grown), atol=2e-3)


def test_a_movement_that_cannot_be_solved_fails_alone():
    patients = [healthy(), healthy()]
    legs = [leg_of(p) for p in patients]
    legs[1].mj_model.dof_damping[:] = 1e6
    trial = voluntary("cosine", "slow", 100.0)
    motions = [mjhcmc.Motion.cosine(leg, "fast") for leg in legs]
    good, bad = move([Case(p, leg, trial) for p, leg in zip(patients, legs, strict=True)], motions, physics_dt=0.002)
    assert not good.failure
    assert bad.failure.startswith("cosine_slow: ")
    assert not len(bad.time)


@pytest.mark.skipif(not WALK.exists(), reason="the measured walk is not there")
def test_patients_walk_with_forces_of_their_size():
    files = str(WALK / "subject_adjusted_Kinematics_q.sto"), str(WALK / "subject01_walk_grf.xml")
    subject = healthy(1.8, 72.6)
    small = healthy(1.5, 50.0)
    legs = [gait_leg_of(p) for p in (subject, small)]
    motions, loads = walks([subject, small], legs, *files, 1.0, 1.2, 1.8, 72.6)
    assert np.abs(loads[1].force).max() == pytest.approx(np.abs(loads[0].force).max() * 50 / 72.6)
    cases = [Case(p, leg, voluntary("walk", "", 200.0)) for p, leg in zip((subject, small), legs, strict=True)]
    first, second = move(cases, motions, loads, dt=0.005, physics_dt=0.001)
    assert not first.failure
    assert not second.failure
    assert first.excitation.max() > 0.2
    # the same walk by another size: about the same excitations, since strength goes with mass
    assert np.corrcoef(first.activation.ravel(), second.activation.ravel())[0, 1] > 0.9
    with pytest.raises(mjhcmc.SettingsError, match="needs its ground reaction"):
        walks([subject], legs, files[0], "", 1.0, 1.2, 1.8, 72.6)


def test_grades_are_of_the_resistance_not_of_the_gain(configuration):
    """A strong reflex with a threshold that no test reaches is graded as no reflex is."""
    silent = replace(healthy(), groups=tuple(replace(g, gain=0.5, threshold=50.0) for g in healthy().groups))
    trials = [t for t in battery(QUICK) if t.session != "instrumented"]
    quiet, loud = (grade(patient, examine([patient], trials, configuration)[0]) for patient in (healthy(), silent))
    assert {joint: labels["ideal"] for joint, labels in quiet.items()} == dict.fromkeys(("hip", "knee", "ankle"), "0")
    assert [labels["ideal"] for labels in loud.values()] == ["0", "0", "0"]
    spastic = grade(affected(), examine([affected()], trials, configuration)[0])
    assert spastic["knee"]["ideal_rank"] >= 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fast_deg_s": "fast"}, "'fast_deg_s' is 'fast': give speeds of 1 to 1000 deg/s"),
        ({"fast_deg_s": "1e9"}, "speeds of 1 to 1000"),
        ({"fast_deg_s": "120 120.3"}, "differ by 1 deg/s"),
        ({"slow_deg_s": "0"}, "'slow_deg_s' is 0.0: give a number from 1 to 1000"),
        ({"dt": "5"}, "'dt' is 5.0: give a number from 0.001 to 0.05"),
        ({"slow_deg_s": "slow"}, "'slow_deg_s' must be a number; got 'slow'"),
        ({"shift_muscle": "steel"}, "muscle 'steel' is not known"),
        ({"shift_reflex": "knee"}, "reflex 'knee' is not known"),
        ({"movement": "jump"}, "jump"),
        ({"speed": "3"}, "setting 'speed' is not known: choose one of dt, fast_deg_s"),
        ({"walk": "nowhere.sto"}, "needs its ground reaction"),
        ({"walk": "nowhere.sto", "walk_loads": "nowhere.xml", "walk_end": "1"}, "nowhere.sto"),
    ],
)
def test_settings_that_cannot_be_carried_out_are_refused_before_work_begins(changes, message):
    with pytest.raises(mjhcmc.MjhcmcError, match=message):
        Configuration.with_defaults(3, **changes)


@pytest.mark.skipif(not WALK.exists(), reason="the measured walk is not there")
def test_a_walk_is_known_by_what_it_holds(tmp_path):
    asked = {"walk_loads": str(WALK / "subject01_walk_grf.xml"), "walk_start": "1", "walk_end": "1.2"}
    here = WALK / "subject_adjusted_Kinematics_q.sto"
    copied = tmp_path / "other.sto"
    copied.write_bytes(here.read_bytes())
    found = [Configuration.with_defaults(3, walk=str(path), **asked).settings["walk_digest"] for path in (here, copied)]
    assert found[0] == found[1] != ""
    asked["walk_end"] = "1.3"
    assert Configuration.with_defaults(3, walk=str(here), **asked).settings["walk_digest"] != found[0]

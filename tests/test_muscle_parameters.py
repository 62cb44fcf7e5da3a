"""Parameters of MuJoCo's muscles by the field's names: reading, changing, and how force answers."""

import copy

import mujoco
import numpy as np
import pytest
from gradient_tools import leg
from hypothesis import given
from hypothesis import strategies as st

import mjhcmc
from mjhcmc.dynamics import fiber_damping
from mjhcmc.leg8.muscles import fiber_mapping
from mjhcmc.leg8.table import load_table
from mjhcmc.muscle_parameters import (
    FIBER,
    FORCE,
    FORCE_KINDS,
    KINDS,
    RISE,
    SLACK,
    muscle_force,
    muscle_parameters,
    parameter_fields,
    with_muscle_parameters,
)
from mjhcmc.plant import MujocoPlant, State

MODEL = leg()
NOW = muscle_parameters(MODEL)
Q, V = np.array([0.3, -0.5, 0.1]), np.array([1.0, -2.0, 3.0])


def seen(model, activation):
    """Force, length, velocity and fiber damping of MuJoCo's own muscles at one state."""
    plant = MujocoPlant(model)
    plant.set_state(State(0.0, Q, V, activation, np.zeros(3)))
    plant.set_input(None, np.zeros(3))
    plant.forward()
    d, rows = plant.mj_data, model.mj_model.actuator_outadr[model.muscle_ids]
    force, length, velocity = (getattr(d, f"actuator_{name}")[rows].copy() for name in ("force", "length", "velocity"))
    return -force, length, velocity, fiber_damping(model, d)


def test_leg8_s_parameters_are_those_of_its_table():
    table = load_table()
    for i, name in enumerate(MODEL.muscle_names):
        unit, force, _ = fiber_mapping({**table["source"]["muscle_common"], **table["source"]["muscles"][name]})
        slack = table["source"]["muscles"][name]["tendon_slack_length"] + table["fitted"]["slack_offset"][name]
        assert NOW[FORCE][i] == pytest.approx(force, rel=1e-5)  # the file keeps six digits
        assert NOW[FIBER][i] == pytest.approx(unit, rel=1e-4)
        assert NOW[SLACK][i] == pytest.approx(slack, abs=1e-4)


@given(st.lists(st.floats(0.8, 1.25), min_size=8, max_size=8), st.sampled_from(KINDS))
def test_what_is_written_is_read(factors, kind):
    values = NOW[kind] * factors
    found = muscle_parameters(with_muscle_parameters(MODEL, {kind: values}))
    for name in KINDS:
        assert found[name] == pytest.approx(values if name == kind else NOW[name], rel=1e-12)


def test_force_is_that_of_the_engine_s_muscles():
    a = np.linspace(0.0, 1.0, 8)
    values = {FORCE: 1.3 * NOW[FORCE], FIBER: 0.9 * NOW[FIBER], SLACK: 1.05 * NOW[SLACK]}
    model = with_muscle_parameters(MODEL, values)
    force, length, velocity, _ = seen(model, a)
    ours = muscle_force(model, length, velocity)
    assert ours.gain * a + ours.bias == pytest.approx(force, rel=1e-12)


@pytest.mark.parametrize("kind", FORCE_KINDS)
def test_slopes_of_force_are_central_differences_of_the_engine(kind):
    a, h = np.linspace(0.1, 1.0, 8), 1e-6 * NOW[kind]
    _, length, velocity, damping = seen(MODEL, a)
    ours = muscle_force(MODEL, length, velocity)
    up, down = (seen(with_muscle_parameters(MODEL, {kind: NOW[kind] + side * h}), a) for side in (1, -1))
    j = FORCE_KINDS.index(kind)
    slopes = ours.gain_slopes[j] * a + ours.bias_slopes[j]
    assert np.abs(slopes - (up[0] - down[0]) / (2 * h)).max() < 1e-7 * np.abs(slopes).max()
    shares = {FORCE: damping / NOW[FORCE], FIBER: -damping / NOW[FIBER], SLACK: np.zeros(8)}
    assert np.abs(shares[kind] - (up[3] - down[3]) / (2 * h)).max() <= 1e-7 * max(1.0, np.abs(shares[kind]).max())


def test_rows_for_a_batch_are_the_models_one_by_one():
    rows = {FORCE: NOW[FORCE] * [[0.8], [1.2]]}
    fields = parameter_fields(MODEL, rows)
    for i in range(2):
        one = with_muscle_parameters(MODEL, {FORCE: rows[FORCE][i]}).mj_model
        for name, values in fields.items():
            assert np.array_equal(getattr(one, name), values[i])


def test_the_model_stays_as_it_is():
    before = copy.deepcopy(MODEL.mj_model.actuator_gainprm)
    with_muscle_parameters(MODEL, {FORCE: 2 * NOW[FORCE]})
    assert np.array_equal(MODEL.mj_model.actuator_gainprm, before)
    assert with_muscle_parameters(MODEL, {}) is MODEL


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"strength": NOW[FORCE]}, "max_isometric_force, optimal_fiber_length"),
        ({FORCE: NOW[FORCE][:3]}, "8 numbers"),
        ({FORCE: NOW[FORCE] * [1, 1, 1, 1, -1, 1, 1, 1]}, "'vasti' is -4993"),
        ({RISE: NOW[RISE] * 0}, "positive"),
        ({SLACK: NOW[SLACK] * np.nan}, "finite"),
    ],
)
def test_numbers_that_make_no_muscle_are_refused(values, told):
    with pytest.raises(mjhcmc.SettingsError, match=told):
        with_muscle_parameters(MODEL, values)


def test_other_gains_have_no_fibers():
    m = copy.deepcopy(MODEL.mj_model)
    m.actuator_gaintype[0] = mujoco.mjtGain.mjGAIN_FIXED
    with pytest.raises(mjhcmc.ModelError, match="iliopsoas"):
        muscle_parameters(mjhcmc.MuscleModel.load(m))

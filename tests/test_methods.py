"""The methods side by side: one signature, one Solution, names that are found."""

import inspect

import numpy as np
import pytest

import mjhcmc
from mjhcmc.methods import METHODS, find_method

OWN = {
    "hcmc": {"trials", "tolerance", "gain", "authority", "imposed"},
    "cmc": {"look_ahead", "kp", "kv"},
    "static": set(),
}
POSITIONAL = (
    "model", "motion", "dt", "physics_dt", "initial_qpos", "initial_qvel", "initial_activation", "reserves",
)  # fmt: skip
SHARED = {
    "cost", "weights", "smoothness", "min_activation", "disabled", "solver", "emg", "joint_moments", "loads", "plant",
    "integrator", "progress",
}  # fmt: skip


def test_every_method_is_found_by_its_name():
    assert list(METHODS) == ["hcmc", "cmc", "static"]
    assert [find_method(name) for name in METHODS] == [mjhcmc.hcmc, mjhcmc.cmc, mjhcmc.static_optimization]


@pytest.mark.parametrize("name", ["moco", "HCMC", "static_optimization", ""])
def test_an_unknown_method_lists_the_known_ones(name):
    with pytest.raises(mjhcmc.SettingsError, match=rf"^unknown method '{name}': choose one of hcmc, cmc, static$"):
        find_method(name)


@pytest.mark.parametrize("name", METHODS)
def test_one_signature(name):
    parameters = inspect.signature(find_method(name)).parameters
    first = list(parameters)[:8]
    assert tuple(first) == POSITIONAL
    assert all(parameters[p].kind is inspect.Parameter.POSITIONAL_OR_KEYWORD for p in first)
    rest = set(parameters) - set(first)
    assert rest == SHARED | OWN[name]
    assert all(parameters[p].kind is inspect.Parameter.KEYWORD_ONLY for p in rest)
    reference = inspect.signature(mjhcmc.hcmc).parameters
    for p in (*first, *SHARED):
        assert parameters[p].default == reference[p].default
        assert parameters[p].annotation == reference[p].annotation
    assert inspect.signature(find_method(name)).return_annotation == "Solution"


@pytest.mark.parametrize("name", METHODS)
def test_one_solution(leg8, slow, slow_solution, name):
    calls = []
    solution = find_method(name)(leg8, slow, 0.02, 0.0015, progress=lambda *args: calls.append(args))
    assert calls == [(k, 90) for k in range(1, 91)]
    assert solution.settings["method"] == name
    assert set(slow_solution.settings) - OWN["hcmc"] == set(solution.settings) - OWN[name]
    assert OWN[name] <= set(solution.settings)
    assert solution.settings["physics_dt"] == pytest.approx(0.02 / 14)
    np.testing.assert_allclose(solution.time, 0.02 * np.arange(91), atol=1e-12)
    np.testing.assert_allclose(solution.qpos_desired, slow.sample(solution.time).qpos)
    np.testing.assert_allclose(solution.tracking_error, solution.qpos - solution.qpos_desired)
    np.testing.assert_array_equal(solution.external_load, 0)
    assert solution.model is leg8
    assert not solution.interrupted


def test_all_begin_alike_and_track_in_their_order(leg8, fast):
    solutions = [find_method(name)(leg8, fast) for name in METHODS]
    for other in solutions[1:]:
        np.testing.assert_array_equal(other.qpos[0], solutions[0].qpos[0])
        np.testing.assert_allclose(other.activation[0], solutions[0].activation[0], atol=1e-9)
    errors = [np.abs(s.tracking_error).max(axis=0) for s in solutions]
    assert np.all(errors[0] < errors[1])
    assert np.all(errors[1] < errors[2])


@pytest.mark.parametrize("name", METHODS)
def test_common_settings_are_checked_alike(leg8, slow, name):
    method = find_method(name)
    for settings, error, message in (
        ({"dt": 0}, mjhcmc.SettingsError, "dt must be a positive number"),
        ({"physics_dt": "x"}, mjhcmc.SettingsError, "physics_dt must be a positive number"),
        ({"dt": 9.0}, mjhcmc.SettingsError, "longer than the motion"),
        ({"initial_activation": -0.1}, mjhcmc.SettingsError, r"within 0\.\.1"),
        ({"initial_qpos": [0, 0.6, 0]}, mjhcmc.MotionError, "knee.*outside its range"),
        ({"initial_qvel": [0]}, mjhcmc.SettingsError, "initial_qvel must hold 3 numbers"),
    ):
        with pytest.raises(error, match=message):
            method(leg8, slow, **settings, progress=pytest.fail)
    with pytest.raises(mjhcmc.SettingsError, match=r"got str and Motion.*MuscleModel\.load"):
        method("leg8", slow)

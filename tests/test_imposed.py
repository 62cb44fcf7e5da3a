"""Excitation that is imposed on muscles while others follow a motion."""

import numpy as np
import pytest

import mjhcmc

TIME = np.array([0.0, 0.3, 0.6])


def one_muscle(model, name, values):
    u = np.zeros((len(values), model.n_muscle))
    u[:, model.muscle_names.index(name)] = values
    return mjhcmc.Imposed(TIME, u)


@pytest.fixture(scope="module")
def leg():
    return mjhcmc.MuscleModel.load("leg8")


@pytest.fixture(scope="module")
def motion(leg):
    return mjhcmc.Motion.cosine(leg, amplitudes={"hip": 0.2, "knee": -0.3}, period=0.6, cycles=1)


@pytest.mark.parametrize("muscle", ["mujoco", "compliant"])
def test_others_work_against_it_and_the_leg_still_follows(leg, motion, muscle):
    imposed = one_muscle(leg, "hamstrings", [0.0, 0.2, 0.1])
    batch = mjhcmc.hcmc_batch(leg, [motion, motion], physics_dt=0.002, imposed=[imposed, None], muscle=muscle)
    without, solution = batch[1], batch[0]
    i = leg.muscle_names.index("hamstrings")
    middles = (solution.time[:-1] + solution.time[1:]) / 2
    floor = np.interp(middles, TIME, [0.0, 0.2, 0.1])
    free = without.excitation[:, i] < floor - 1e-3
    assert free.any()  # it does ask for what would not be there
    assert (solution.excitation[:, i] >= floor - 1e-12).all()
    assert np.abs(np.degrees(solution.tracking_error)).max() < 0.2
    assert np.abs(solution.reserve).max() < 0.5
    opposing = leg.muscle_names.index("vasti"), leg.muscle_names.index("rect_fem")
    assert solution.excitation[:, opposing].mean() > without.excitation[:, opposing].mean() + 0.002


def test_nothing_imposed_is_nothing_changed(leg, motion):
    plain = mjhcmc.hcmc(leg, motion, physics_dt=0.005)
    imposed = mjhcmc.hcmc(leg, motion, physics_dt=0.005, imposed=one_muscle(leg, "vasti", [0.0, 0.0, 0.0]))
    np.testing.assert_array_equal(imposed.excitation, plain.excitation)
    assert imposed.settings["imposed"]
    assert not plain.settings["imposed"]


def test_means_over_windows_are_those_of_the_straight_lines():
    imposed = mjhcmc.Imposed([0.0, 1.0, 1.5], [[0.0], [1.0], [0.0]])
    np.testing.assert_allclose(
        imposed.over(np.array([0.0, 0.5, 1.25, 1.5]))[:, 0], [0.25, (0.375 + 0.1875) / 0.75, 0.25]
    )


@pytest.mark.parametrize(
    ("time", "u", "message"),
    [
        ([0.0, 0.0], np.zeros((2, 8)), "rising"),
        ([0.0], np.zeros((1, 8)), "at least two"),
        ([0.0, 1.0], np.full((2, 8), 1.2), r"muscle 0 is 1.2 at 0 s: give 0 to 1"),
        ([0.0, 1.0], np.full((2, 8), np.nan), "muscle 0 is nan"),
        ([0.0, 1.0], np.zeros((3, 8)), r"shape \(3, 8\)"),
        ([0.0, "x"], np.zeros((2, 8)), "must be numbers"),
    ],
)
def test_numbers_that_are_no_excitation_are_refused(time, u, message):
    with pytest.raises(mjhcmc.SettingsError, match=message):
        mjhcmc.Imposed(time, u)


def test_what_does_not_fit_model_or_motion_is_refused(leg, motion):
    with pytest.raises(mjhcmc.SettingsError, match="of 2 muscles, model 'leg8' has 8"):
        mjhcmc.hcmc(leg, motion, imposed=mjhcmc.Imposed([0.0, 1.0], np.zeros((2, 2))))
    with pytest.raises(mjhcmc.MotionError, match=r"covers 0 .. 0.2 s, the motion"):
        mjhcmc.hcmc(leg, motion, imposed=mjhcmc.Imposed([0.0, 0.2], np.zeros((2, 8))))
    with pytest.raises(mjhcmc.SettingsError, match="must be Imposed"):
        mjhcmc.hcmc(leg, motion, imposed=np.zeros((2, 8)))

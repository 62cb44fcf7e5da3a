"""MuJoCo's muscle in NumPy against MuJoCo itself, number for number."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjhcmc.hill import (
    FirstOrderActivation,
    HillError,
    HillModel,
    MuscleParameters,
    mujoco_activation_rate,
    mujoco_bias,
    mujoco_curves,
    mujoco_gain,
    rigid_tendon,
)


def draw(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameters (m, 9), length ranges (m, 2) and accelerations (m,); every third muscle has an automatic force."""
    lmin, lmax = rng.uniform(0, 0.9, count), rng.uniform(1.1, 2, count)
    range0 = rng.uniform(0.3, 0.9, count)
    force = np.where(np.arange(count) % 3 == 0, -1.0, rng.uniform(50, 5000, count))
    columns = (
        range0,
        range0 + rng.uniform(0.1, 1, count),
        force,
        rng.uniform(100, 300, count),
        lmin,
        lmax,
        rng.uniform(0.5, 12, count),
        rng.uniform(0, 2, count),
        rng.uniform(1.05, 2, count),
    )
    shortest = rng.uniform(0.05, 0.5, count)
    limits = np.stack([shortest, shortest + rng.uniform(0.02, 0.4, count)], axis=1)
    return np.stack(columns, axis=1), limits, rng.uniform(0.1, 30, count)


def test_gain_and_bias_are_mujocos() -> None:
    rng = np.random.default_rng(3)
    parameters, limits, acc0 = draw(rng, 40)
    optimal = np.ptp(limits, axis=1) / (parameters[:, 1] - parameters[:, 0])
    normal = rng.uniform(-0.2, 2.5, (60, 40))
    normal[0], normal[1] = 1.0, parameters[:, 5]  # the optimum and lmax themselves
    length = limits[:, 0] + (normal - parameters[:, 0]) * optimal
    velocity = rng.uniform(-1.6, 1.6, (60, 40)) * optimal * parameters[:, 6]
    velocity[2] = 0
    gain = mujoco_gain(length, velocity, limits, acc0, parameters)
    bias = mujoco_bias(length, limits, acc0, parameters)
    assert gain.shape == bias.shape == (60, 40)
    for k in range(40):
        given = (limits[k], acc0[k], parameters[k])
        size = abs(parameters[k, 2]) if parameters[k, 2] > 0 else parameters[k, 3] / acc0[k]
        theirs = [mujoco.mju_muscleGain(x, v, *given) for x, v in zip(length[:, k], velocity[:, k], strict=True)]
        assert np.ptp(theirs) > 0.1 * size
        np.testing.assert_allclose(gain[:, k] / size, np.array(theirs) / size, rtol=0, atol=1e-12)
        theirs = [mujoco.mju_muscleBias(x, *given) for x in length[:, k]]
        np.testing.assert_allclose(bias[:, k] / size, np.array(theirs) / size, rtol=0, atol=1e-12)


@settings(max_examples=200, deadline=None)
@given(
    u=st.floats(-0.2, 1.2),
    a=st.floats(-0.2, 1.2),
    tau=st.tuples(st.floats(0.001, 0.1), st.floats(0.001, 0.1)),
    width=st.sampled_from([0.0, 0.05, 0.5, 2.0]),
)
def test_activation_dynamics_are_mujocos(u: float, a: float, tau: tuple[float, float], width: float) -> None:
    constants = np.array([*tau, width])
    theirs = mujoco.mju_muscleDynamics(u, a, constants)
    assert mujoco_activation_rate(u, a, constants) == pytest.approx(theirs, rel=1e-12, abs=1e-12)
    if 0 <= u <= 1 and 0 <= a <= 1:
        ours = FirstOrderActivation(*tau, smoothing=width).rate(u, a)
        assert ours == pytest.approx(theirs, rel=1e-12, abs=1e-12)


def test_the_curves_make_the_same_muscle() -> None:
    """A rigid-tendon model with MuJoCo's curves gives the force of MuJoCo's actuator."""
    range0, range1, lmin, lmax, vmax, fpmax, fvmax = 0.7, 1.2, 0.4, 1.7, 6.0, 0.9, 1.3
    prm, limits = np.array([range0, range1, 800.0, 200.0, lmin, lmax, vmax, fpmax, fvmax]), np.array([0.3, 0.4])
    optimal = 0.1 / (range1 - range0)
    muscle = MuscleParameters(800.0, optimal, limits[0] - range0 * optimal, max_fiber_velocity=vmax)
    model = HillModel(muscle, mujoco_curves(lmin, lmax, fpmax, fvmax))
    rng = np.random.default_rng(5)
    length, velocity, a = rng.uniform(0.28, 0.45, 200), rng.uniform(-1.5, 1, 200), rng.uniform(0, 1, 200)
    force = rigid_tendon(model, a, length, velocity).tendon_force
    theirs = -mujoco_gain(length, velocity, limits, 1.0, prm) * a - mujoco_bias(length, limits, 1.0, prm)
    np.testing.assert_allclose(force, theirs, rtol=0, atol=800 * 1e-12)


@pytest.mark.parametrize(("column", "value"), [(1, 0.7), (4, 1.0), (5, 1.0), (6, 0.0), (8, 1.0), (2, np.nan)])
def test_parameters_that_make_no_muscle(column: int, value: float) -> None:
    prm = np.array([[0.75, 1.05, 800.0, 200.0, 0.5, 1.6, 1.5, 1.3, 1.2]] * 2)
    prm[1, column] = value
    with pytest.raises(HillError, match=r"MuJoCo muscle 1: .* makes no muscle"):
        mujoco_gain(0.3, 0.0, np.array([0.2, 0.4]), 1.0, prm)


def test_shapes_that_make_no_muscle() -> None:
    with pytest.raises(HillError, match="shape"):
        mujoco_bias(0.3, np.array([0.2, 0.4]), 1.0, np.ones(8))

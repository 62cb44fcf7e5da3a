"""The activation map against MuJoCo's own stepping, and its inverse."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjhcmc.activation import activation_after, excitation_for
from mjhcmc.errors import SettingsError

XML = """
<mujoco><option integrator="RK4" timestep="{step}"/>
  <worldbody><body><joint name="j" type="hinge"/><geom size=".1"/></body></worldbody>
  <actuator><general joint="j" dyntype="muscle" dynprm="{act} {deact} {smooth}" gaintype="fixed" gainprm="0"/>
  </actuator>
</mujoco>"""


@pytest.mark.parametrize(("act", "deact", "smooth"), [(0.01, 0.04, 0.0), (0.015, 0.06, 0.0), (0.01, 0.04, 0.2)])
@pytest.mark.parametrize(("step", "n_step"), [(0.001, 10), (0.01, 1), (0.0025, 3)])
def test_map_is_the_plants_own(act, deact, smooth, step, n_step):
    m = mujoco.MjModel.from_xml_string(XML.format(step=step, act=act, deact=deact, smooth=smooth))
    d = mujoco.MjData(m)
    rng = np.random.default_rng(0)
    a, u = rng.uniform(size=(2, 200))
    prm = np.tile([act, deact, smooth], (200, 1))
    stepped = np.empty(200)
    for i in range(200):
        mujoco.mj_resetData(m, d)
        d.act[:], d.ctrl[:] = a[i], u[i]
        mujoco.mj_step(m, d, n_step)
        stepped[i] = d.act[0]
    np.testing.assert_allclose(activation_after(a, u, prm, step, n_step), stepped, rtol=0, atol=1e-12)


unit = st.floats(0, 1)


@settings(max_examples=300, deadline=None)
@given(a=unit, u=unit, smooth=st.sampled_from([0.0, 0.1, 0.5]), n_step=st.integers(1, 12))
def test_inverse_gives_back_the_window(a, u, smooth, n_step):
    prm = np.array([[0.01, 0.04, smooth]])
    target = activation_after(np.array([a]), np.array([u]), prm, 0.001, n_step)
    found = excitation_for(np.array([a]), target, prm, 0.001, n_step)
    assert 0 <= found[0] <= 1
    np.testing.assert_allclose(activation_after(np.array([a]), found, prm, 0.001, n_step), target, rtol=0, atol=1e-12)


@settings(max_examples=200, deadline=None)
@given(a=unit, u=unit, v=unit, smooth=st.sampled_from([0.0, 0.1]))
def test_map_is_monotone_in_excitation(a, u, v, smooth):
    prm = np.array([[0.01, 0.04, smooth]])
    low, high = (activation_after(np.array([a]), np.array([x]), prm, 0.001, 10) for x in sorted((u, v)))
    assert low[0] <= high[0]


def test_beyond_reach_saturates():
    a, prm = np.array([0.5, 0.5]), np.tile([0.01, 0.04, 0.0], (2, 1))
    np.testing.assert_array_equal(excitation_for(a, np.array([-1.0, 2.0]), prm, 0.001, 10), [0.0, 1.0])
    limits = np.array([[0.1, 0.8], [0.1, 0.8]])
    np.testing.assert_array_equal(excitation_for(a, np.array([-1.0, 2.0]), prm, 0.001, 10, limits), [0.1, 0.8])


def test_bad_arrays_are_named():
    with pytest.raises(SettingsError, match="shapes"):
        activation_after(np.zeros(3), np.zeros(2), np.zeros((3, 3)), 0.001, 1)
    with pytest.raises(SettingsError, match="positive step"):
        activation_after(np.zeros(1), np.zeros(1), np.ones((1, 3)), 0.0, 1)

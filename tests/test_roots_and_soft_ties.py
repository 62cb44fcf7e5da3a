"""A root that is tracked, and joints that hang on others by soft equalities: what the muscles are asked for."""

import mujoco
import numpy as np
import pytest

import mjhcmc

pytestmark = pytest.mark.usefixtures("coarse_replay")
SWING = {"hip": 0.3, "knee": -0.5, "ankle": 0.1, "pelvis_ty": 0.02, "pelvis_tilt": 0.05}
TWO_LINKS = """
<mujoco model="links"><option timestep=".001" integrator="RK4"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody><body name="pelvis"><geom size=".05" mass="5"/>
    <site name="p1" pos=".06 0 .02"/><site name="p2" pos="-.06 0 .02"/>
    <body name="thigh"><joint name="hip" axis="0 -1 0" damping=".5"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".04" mass="6"/>
      <site name="t1" pos=".05 0 -.2"/><site name="t2" pos="-.05 0 -.2"/>
      <site name="t3" pos=".05 0 -.15"/><site name="t4" pos="-.05 0 -.15"/>
      <body name="shank" pos="0 0 -.4"><joint name="knee" axis="0 1 0" damping=".3"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="3"/>
        <site name="s1" pos=".06 0 -.05"/><site name="s2" pos="-.05 0 -.05"/>
      </body></body></body></worldbody>
  <tendon>
    <spatial name="hf"><site site="p1"/><site site="t1"/></spatial>
    <spatial name="he"><site site="p2"/><site site="t2"/></spatial>
    <spatial name="ke"><site site="t3"/><site site="s1"/></spatial>
    <spatial name="kf"><site site="t4"/><site site="s2"/></spatial>
  </tendon>
  <equality><joint joint1="hip" joint2="knee" polycoef="0 .5 0 0 0" {how}/></equality>
  <actuator>
    <muscle name="hf" tendon="hf" {of}/><muscle name="he" tendon="he" {of}/>
    <muscle name="ke" tendon="ke" {of}/><muscle name="kf" tendon="kf" {of}/>
  </actuator>
</mujoco>
"""


@pytest.mark.parametrize("tracked", [("pelvis_tx", "pelvis_ty", "pelvis_tilt")])
def test_a_tracked_root_asks_nothing_of_the_leg(tracked):
    plain = mjhcmc.MuscleModel.load("leg8_gait")
    motion = mjhcmc.Motion.cosine(plain, amplitudes=SWING, period=1.0, cycles=1)
    led, held = (mjhcmc.hcmc(m, motion, dt=0.005) for m in (plain, plain.with_roles(tracked=tracked)))
    leg = [plain.dof_names.index(name) for name in ("hip", "knee", "ankle")]
    np.testing.assert_allclose(held.reserve[:, leg], 0, atol=1e-3 * held.peak_moment[leg].max())
    assert held.verdict.passed
    assert not held.verdict.findings
    assert not held.status.any()
    assert np.rad2deg(np.abs(held.tracking_error).max()) < 0.05
    # what holds the root is the same force either way, and is reported as residual
    root = [plain.dof_names.index(name) for name in tracked]
    size = np.abs(led.residual[:, root]).max(axis=0)
    np.testing.assert_allclose(held.residual[:-1, root], led.residual[:-1, root], atol=0.05 * size.max())
    np.testing.assert_array_equal(held.residual[:-1, root], held.reserve[:, root])


@pytest.mark.parametrize("dt", [0.01, 0.005])
@pytest.mark.parametrize("how", ["", 'solref=".004 1"', 'solimp=".9999 .9999 .001 .5 2"'])
def test_what_hangs_on_an_equality_does_not_make_excitations_ring(how, dt):
    model = mjhcmc.MuscleModel.load(
        mujoco.MjModel.from_xml_string(TWO_LINKS.format(how=how, of='lengthrange=".1 .5" force="800"'))
    )
    motion = mjhcmc.Motion.cosine(model, amplitudes={"knee": np.deg2rad(30)}, period=1.0, cycles=1)
    solution = mjhcmc.hcmc(model, motion, dt=dt)
    assert np.abs(np.diff(solution.excitation, axis=0)).mean() < 0.005  # .4 where feedback rings
    assert np.abs(solution.reserve).max() < 1e-3 * solution.peak_moment.max()
    assert np.rad2deg(np.abs(solution.tracking_error).max()) < 0.1
    assert solution.verdict.passed


def test_a_motion_far_from_time_zero_is_judged_on_its_own_clock():
    model = mjhcmc.MuscleModel.load("leg8_gait")
    here = mjhcmc.Motion.cosine(model, amplitudes=SWING, period=1.0, cycles=1)
    later = mjhcmc.Motion(here.time + 50, here.qpos)
    one, other = (mjhcmc.hcmc(model, motion, dt=0.01) for motion in (here, later))
    np.testing.assert_allclose(other.excitation, one.excitation, atol=1e-6)

"""The muscle step in MJX and its derivatives, against MuJoCo in C and the derivatives along its stages."""

import builtins
import copy
from functools import cache

import mujoco
import numpy as np
import pytest

import mjhcmc
from mjhcmc.errors import ModelError, SettingsError, SimulationError
from mjhcmc.gradients.looks import States
from mjhcmc.gradients.mjx_step import muscle_step, window_jacobian
from mjhcmc.gradients.window_jacobian import ends_in_c, stagewise_jacobian
from mjhcmc.muscle_parameters import FORCE, KINDS, muscle_parameters

STEP, N_STEP, B = 0.002, 3, 3
ARM = """
<mujoco model="arm">
  <option timestep="0.002" integrator="RK4" gravity="0 0 -9.81"/>
  <worldbody>
    <site name="a0" pos="0.03 0 0.1"/><site name="b0" pos="-0.04 0 0.1"/>
    <body><joint name="shoulder" axis="0 -1 0" range="-150 150" limited="true" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1.5" contype="0" conaffinity="0"/>
      <site name="a1" pos="0.04 0 -0.15"/><site name="b1" pos="-0.03 0 -0.12"/><site name="c0" pos="0.03 0.005 -0.12"/>
      <geom name="wheel" type="cylinder" size="0.03 0.05" pos="0 0 -0.3" euler="90 0 0" contype="0" conaffinity="0"/>
      <site name="side" pos="0.06 0 -0.3"/>
      <body pos="0 0 -0.3"><joint name="elbow" axis="0 -1 0" range="-150 150" limited="true"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="1" contype="0" conaffinity="0"/>
        <site name="c1" pos="0.02 -0.005 -0.08"/></body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="front" damping="30"><site site="a0"/><site site="a1"/></spatial>
    <spatial name="back"><site site="b0"/><site site="b1"/></spatial>
    <spatial name="long" damping="20"><site site="c0"/><geom geom="wheel" sidesite="side"/><site site="c1"/></spatial>
  </tendon>
  <actuator>
    <muscle name="front" tendon="front" lengthrange="0.2 0.3" range="0.7 1.4" force="300" vmax="8"/>
    <muscle name="back" tendon="back" lengthrange="0.15 0.28" range="0.6 1.5" force="250" vmax="8"/>
    <muscle name="long" tendon="long" lengthrange="0.18 0.32" range="0.6 1.5" force="400" vmax="8"/>
  </actuator>
</mujoco>
"""


pytestmark = pytest.mark.compiled


def arm(change=None):
    spec = mujoco.MjSpec.from_string(ARM)
    if change is not None:
        change(spec)
    return mjhcmc.MuscleModel.load(spec)


@pytest.fixture
def jax():
    pytest.importorskip("mujoco.mjx")
    return pytest.importorskip("jax")


@cache
def built():
    return muscle_step(arm(), STEP, N_STEP, KINDS)


@cache
def drawn():
    """States where the third muscle is bent over its wheel, bent, and straight; one excitation at each bound."""
    rng = np.random.default_rng(5)
    qpos = np.array([[0.3, -0.7], [-0.2, -1.1], [0.1, 1.2]])
    a, u = rng.uniform(0.1, 0.7, (B, 3)), rng.uniform(0.1, 0.9, (B, 3))
    u[0, 1], u[1, 0] = 0.0, 1.0
    return States(qpos, rng.normal(0, 2, (B, 2)), a, rng.normal(0, 0.5, (B, 2))), u


@cache
def patients():
    return built().values * np.random.default_rng(6).uniform(0.9, 1.1, (B, len(built().names)))


@cache
def found():
    return window_jacobian(built(), *drawn(), patients())


def parts(states, u, values):
    return np.hstack([states.qpos, states.qvel, states.activation, u, states.reserve, values])


def end_of(x):
    cuts = np.cumsum([2, 2, 3, 3, 2])
    q, v, a, u, s, p = np.split(x[None], cuts, axis=1)
    values = dict(zip(KINDS, np.split(p, len(KINDS), axis=1), strict=True))
    return ends_in_c(arm_once(), States(q, v, a, s), u, STEP, N_STEP, values)[0]


@cache
def arm_once():
    return arm()


def test_the_jacobian_is_that_of_mujocos_steps_in_c(jax):
    x, n = parts(*drawn(), patients()), 7
    whole = np.concatenate([found().start, found().inputs], axis=2)
    for b in range(B):
        assert found().end[b] == pytest.approx(end_of(x[b]), abs=1e-11)
        for k in range(x.shape[1]):
            step = 1e-5 * max(0.01, abs(x[b, k]))
            if n <= k < n + 3 and not step < x[b, k] < 1 - step:
                way = np.where(np.arange(x.shape[1]) == k, step if x[b, k] == 0 else -step, 0.0)
                one, two = end_of(x[b] + way), end_of(x[b] + 2 * way)  # towards the inside, second order
                slope = (4 * one - two - 3 * end_of(x[b])) / (2 * way[k])
            else:
                way = np.where(np.arange(x.shape[1]) == k, step, 0.0)
                slope = (end_of(x[b] + way) - end_of(x[b] - way)) / (2 * step)
            scale = np.abs(whole[b]).max(axis=1) * 1e-6  # rows hold rad, rad/s and activation
            assert np.all(np.abs(whole[b, :, k] - slope) <= 1e-6 * np.abs(slope) + scale)


def test_it_agrees_with_the_tangents_along_the_stages(jax):
    states, u = drawn()
    by_jax = window_jacobian(built(), states, u)
    along = stagewise_jacobian(arm_once(), states, u, STEP, N_STEP, KINDS)
    assert by_jax.names == along.names == built().names
    assert by_jax.end == pytest.approx(along.end, abs=1e-10)
    for name in ("start", "inputs"):
        mine, theirs = getattr(by_jax, name), getattr(along, name)
        scale = np.abs(theirs).max(axis=0)  # an entry's largest value over the states
        assert scale.max() > 0.1
        assert np.all(np.abs(mine - theirs) <= 1e-7 * scale + 1e-12)
    assert by_jax.parameters.shape == (B, 7, len(KINDS) * 3)
    assert by_jax.parameters == pytest.approx(along.parameters, rel=1e-6, abs=1e-9)


def test_a_muscle_at_rest_answers_to_excitation_by_its_rising_time_constant(jax):
    states, _ = drawn()
    states = states._replace(activation=np.zeros((B, 3)))
    jacobian = window_jacobian(built(), states, np.zeros((B, 3)))
    along = stagewise_jacobian(arm_once(), states, np.zeros((B, 3)), STEP, N_STEP, KINDS)
    assert jacobian.inputs[:, :, :3] == pytest.approx(along.inputs[:, :, :3], rel=1e-6, abs=1e-9)
    rise = muscle_parameters(arm_once())["activation_time"][0]
    rate = STEP / (0.5 * rise)
    once = 1 - rate + rate**2 / 2 - rate**3 / 6 + rate**4 / 24  # RK4 of da' = (du - da)/(tau/2)
    assert np.diagonal(jacobian.inputs[0, 4:, :3]) == pytest.approx(np.full(3, 1 - once**N_STEP), rel=1e-9)


def test_it_steps_alone_as_in_a_batch(jax):
    states, u = drawn()
    with jax.enable_x64(True):
        alone = jax.jit(built())
        for b in range(B):
            x = (states.qpos[b], states.qvel[b], states.activation[b], u[b], states.reserve[b], patients()[b])
            assert np.concatenate(alone(*x)) == pytest.approx(found().end[b], rel=1e-13, abs=1e-13)


def test_single_precision_is_refused_and_stays_the_default(jax):
    states, u = drawn()
    before = jax.config.read("jax_enable_x64")
    step = built()
    with jax.enable_x64(False), pytest.raises(SettingsError, match="double precision"):
        step(states.qpos[0], states.qvel[0], states.activation[0], u[0], states.reserve[0])
    assert jax.config.read("jax_enable_x64") == before


def poly(m):
    m.tendon_dampingpoly[0, 0] = 1.0


def friction(m):
    m.dof_frictionloss[0] = 0.1


def no_springs(m):
    m.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SPRING)


def hosted(m):
    m.actuator_armature[1] = 0.1


def armature(m):
    m.tendon_armature[2] = 0.1


def elsewhere(m):
    m.site_bodyid[m.site("side").id] = 0


def inside(m):
    m.site_pos[m.site("side").id] = m.geom_pos[m.geom("wheel").id]


@pytest.mark.parametrize(
    ("change", "word"),
    [(poly, "tendon_dampingpoly"), (friction, "frictionloss"), (no_springs, "springs or dampers"),
     (hosted, "actuator_armature"), (armature, "tendon_armature and wraps"),
     (elsewhere, "'side' of wrap 'wheel' is on another"), (inside, "'side' of wrap 'wheel' is inside")],
)  # fmt: skip
def test_what_mjx_leaves_out_is_named_at_build(change, word):
    from dataclasses import replace

    m = copy.copy(arm_once().mj_model)
    change(m)
    with pytest.raises(ModelError, match=word):
        muscle_step(replace(arm_once(), mj_model=m))


def test_a_ball_joint_and_an_equality_are_refused():
    def ball(spec):
        spec.worldbody.add_body(name="bob").add_joint(name="ball", type=mujoco.mjtJoint.mjJNT_BALL)
        spec.body("bob").add_geom(size=[0.1, 0, 0])

    def tie(spec):
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_JOINT, name1="shoulder", name2="elbow", objtype=mujoco.mjtObj.mjOBJ_JOINT
        )

    for change, word in ((ball, "ball"), (tie, "equality")):
        with pytest.raises(ModelError, match=word):
            muscle_step(arm(change))


@pytest.mark.parametrize(
    ("settings", "word"),
    [({"n_step": 0}, "n_step"), ({"physics_dt": -1.0}, "physics_dt"), ({"parameters": ("strength",)}, "strength"),
     ({"parameters": (FORCE, FORCE)}, "twice")],
)  # fmt: skip
def test_settings_are_refused_before_jax_is_needed(settings, word, monkeypatch):
    without(monkeypatch, "jax")
    with pytest.raises(SettingsError, match=word):
        muscle_step(arm_once(), **settings)


def test_without_jax_the_install_command_is_told(monkeypatch):
    without(monkeypatch, "jax")
    with pytest.raises(SettingsError, match=r'pip install "mjhcmc\[jax\]"'):
        muscle_step(arm_once())


def without(monkeypatch, package):
    own = builtins.__import__

    def found(name, *args, **kwargs):
        if name.split(".")[0] == package:
            raise ModuleNotFoundError(f"No module named {package!r}")
        return own(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", found)


def test_windows_of_other_shapes_and_those_at_limits_are_refused(jax):
    states, u = drawn()
    with pytest.raises(SettingsError, match="excitation"):
        window_jacobian(built(), states, u[:, :2])
    with pytest.raises(SettingsError, match="qvel"):
        stagewise_jacobian(arm_once(), states._replace(qvel=states.qvel * np.nan), u)
    with pytest.raises(SettingsError, match="parameters have shape"):
        window_jacobian(built(), states, u, patients()[:, :4])
    beyond = states._replace(qpos=np.add(states.qpos, [[0, 0], [2.9, 0], [0, 0]]))
    with pytest.raises(SimulationError, match="at work in window 1"):
        window_jacobian(built(), beyond, u)


def test_the_steps_of_c_are_checked_with_every_call(jax, monkeypatch):
    """A model that MJX steps elsewhere than C is refused, whatever the reason."""
    from mjhcmc.gradients import mjx_step

    monkeypatch.setattr(mjx_step, "ends_in_c", lambda *args: ends_in_c(*args) + 1e-6)
    with pytest.raises(SimulationError, match="off by 1e-06"):
        window_jacobian(built(), *drawn())
    window_jacobian(built(), *drawn(), verify=False)

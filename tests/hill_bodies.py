"""An arm of two joints and three muscles, and its simulation without the package's plant: for tests of Hill plants."""

import copy

import mujoco
import numpy as np
from conftest import load_xml
from scipy.integrate import solve_ivp

from mjhcmc import hill
from mjhcmc.plant import State

ARM = """
<mujoco model="arm">
  <option integrator="RK4" gravity="0 0 {gravity}"/>
  <worldbody>
    {world}
    <site name="a" pos=".1 0 .1"/>
    <site name="e" pos="-.1 0 .1"/>
    <body name="upper">
      <joint name="shoulder" type="hinge" axis="0 -1 0" {joint}/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="2" contype="0" conaffinity="0"/>
      <site name="b" pos=".05 0 -.1"/>
      <site name="f" pos="-.05 0 -.1"/>
      <site name="c" pos=".05 0 -.15"/>
      <body name="lower" pos="0 0 -.3">
        <joint name="elbow" type="hinge" axis="0 -1 0" {joint}/>
        <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".025" mass="1" {tip}/>
        <site name="d" pos=".05 0 -.08"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="flexor_path" damping="{damping}"><site site="a"/><site site="b"/></spatial>
    <spatial name="biceps_path"><site site="c"/><site site="d"/></spatial>
    <spatial name="extensor_path"><site site="e"/><site site="f"/></spatial>
  </tendon>
  <actuator>
    <muscle name="flexor" tendon="flexor_path" force="400" {range}/>
    {between}
    <muscle name="biceps" tendon="biceps_path" force="200" {range}/>
    <muscle name="extensor" tendon="{extensor}" force="300" {range} tausmooth=".2"/>
  </actuator>
</mujoco>
"""
PLAIN = {
    "gravity": "-9.81", "world": "", "joint": "", "tip": 'contype="0" conaffinity="0"', "damping": "0", "between": "",
    "extensor": "extensor_path", "range": 'range=".5 1.5" lengthrange=".13 .28" ctrlrange="0 1"',
}  # fmt: skip
FLOOR = '<geom name="floor" type="plane" size="1 1 .1" pos="0 0 -.5" friction=".8"/>'


def arm(**changes):
    return load_xml(ARM.format(**(PLAIN | changes)))


def start(model, plant, qpos, qvel, activation=0.2):
    """A state; compliant fibers in equilibrium."""
    n = model.n_muscle
    a = np.broadcast_to(np.asarray(activation, dtype=float), n).copy()
    plant.set_state(State(0.0, np.array(qpos, dtype=float), np.array(qvel, dtype=float), a, np.zeros(model.nv)))
    return plant.get_state()


def leg_state(model, seed=0, scale=1.0):
    rng = np.random.default_rng(seed)
    qpos = np.array([0.1, -0.3, 0.05]) + scale * rng.uniform(-0.1, 0.1, 3)
    return State(0.0, qpos, scale * rng.normal(size=3), rng.uniform(0.1, 0.6, model.n_muscle), np.zeros(3))


def assert_states(found, wanted, **tolerance):
    for name in ("time", "qpos", "qvel", "activation", "fiber_length"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), err_msg=name, **tolerance)


class Free:
    """The same simulation without the package's plant: MuJoCo's bodies, `mjhcmc.hill` and scipy's integrator."""

    def __init__(self, model, muscles, tendon, reserve):
        m = self.m = copy.deepcopy(model.mj_model)
        ids = model.muscle_ids
        m.actuator_gainprm[ids], m.actuator_biasprm[ids] = 0.0, 0.0
        m.actuator_gaintype[ids], m.actuator_biastype[ids] = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_NONE
        m.tendon_damping[:] = 0.0
        self.d, self.rows, self.hill = mujoco.MjData(m), m.actuator_outadr[ids], muscles
        self.compliant, self.reserve, self.nv, self.n = tendon == "compliant", reserve, model.nv, len(ids)
        self.dynamics = [hill.FirstOrderActivation(*prm) for prm in model.activation_parameters]

    def paths(self, qpos, qvel):
        """Lengths, velocities and moment arms -dL/dq."""
        m, d = self.m, self.d
        d.qpos[:], d.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        dense = np.empty((m.nout, m.nv))
        mujoco.mju_sparse2dense(dense, d.actuator_moment, d.moment_rownnz, d.moment_rowadr, d.moment_colind)
        return d.actuator_length[self.rows].copy(), d.actuator_velocity[self.rows].copy(), -dense[self.rows]

    def muscles(self, a, fiber, L, V):
        if self.compliant:
            return hill.fiber_dynamics(self.hill, a, fiber, L, V)
        return hill.rigid_tendon(self.hill, a, L, V)

    def rate(self, x, u):
        nv, n = self.nv, self.n
        qpos, qvel, a, fiber = np.split(x, [nv, 2 * nv, 2 * nv + n])
        L, V, R = self.paths(qpos, qvel)
        state = self.muscles(a, fiber, L, V)
        self.d.qfrc_applied[:] = R.T @ state.tendon_force + self.reserve
        mujoco.mj_forward(self.m, self.d)
        rates = [float(dyn.rate(ui, ai)) for dyn, ui, ai in zip(self.dynamics, u, a, strict=True)]
        return np.concatenate([qvel, self.d.qacc, rates, state.fiber_velocity if self.compliant else []])

    def run(self, state, u, T):
        x = np.concatenate([state.qpos, state.qvel, state.activation, state.fiber_length])
        return solve_ivp(lambda _, x: self.rate(x, u), (0, T), x, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]


def packed(state):
    return np.concatenate([state.qpos, state.qvel, state.activation, state.fiber_length])


def lengths_of(plant):
    plant.forward()
    rows = plant.mj_model.actuator_outadr[plant.model.muscle_ids]
    return plant.mj_data.actuator_length[rows].copy(), plant.mj_data.actuator_velocity[rows].copy()


def undamped(model):
    m = model.muscles
    bare = hill.MuscleParameters(
        m.max_isometric_force, m.optimal_fiber_length, m.tendon_slack_length, m.pennation_at_optimal,
        m.max_fiber_velocity, 0.0, m.names,
    )  # fmt: skip
    return hill.HillModel(bare, model.curves)

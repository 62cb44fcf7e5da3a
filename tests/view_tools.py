"""What the tests of pictures share: solutions nobody solved, whose desired pose and excitation are their own."""

import mujoco
import numpy as np
import pytest
from conftest import PENDULUMS
from needs import missing

import mjhcmc

DRUMS = """
<mujoco model="drums">
  <worldbody>
    <body>
      <joint name="hinge" type="hinge" axis="1 0 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1" contype="0" conaffinity="0"/>
      <geom type="capsule" fromto="0 0 -.4 .2 0 -.4" size=".02" mass=".1" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator>
    <general name="forth" joint="hinge" dyntype="muscle" dynprm=".01 .04" gainprm="20" ctrlrange="0 1"/>
    <general name="back" joint="hinge" dyntype="muscle" dynprm=".01 .04" gainprm="-20" ctrlrange="0 1"/>
  </actuator>
</mujoco>
"""

BALL = """
<mujoco model="ball">
  <worldbody>
    <site name="wall" pos=".2 0 0"/>
    <body>
      <joint name="shoulder" type="ball"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1" contype="0" conaffinity="0"/>
      <site name="arm" pos=".03 0 -.2"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="rope"><site site="wall"/><site site="arm"/></spatial>
    <spatial name="ribbon" rgba="0 1 0 1"><site site="wall"/><site site="arm"/></spatial>
  </tendon>
  <actuator>
    <general name="weak" tendon="rope" dyntype="muscle" dynprm=".01 .04" gainprm="-20" ctrlrange="0 1"/>
    <general name="strong" tendon="rope" dyntype="muscle" dynprm=".01 .04" gainprm="-50" ctrlrange="0 1"/>
  </actuator>
</mujoco>
"""


def load(xml=PENDULUMS):
    return mjhcmc.MuscleModel.load(mujoco.MjSpec.from_string(xml), integrator="rk4")


def filmed(model, qpos, desired=None, *, activation=0.0, excitation=0.0, dt=0.01):
    """A solution with these (N+1, nq) positions, (N+1, n_muscle) activations and (N, n_muscle) excitations."""
    qpos = np.atleast_2d(np.asarray(qpos, dtype=float))
    n, nodes = len(qpos) - 1, np.zeros((len(qpos), model.nv))
    a, u = np.zeros((n + 1, model.n_muscle)), np.zeros((n, model.n_muscle))
    return mjhcmc.Solution(
        time=dt * np.arange(n + 1), excitation=u + excitation, activation=a + activation, qpos=qpos,
        qpos_desired=qpos if desired is None else np.asarray(desired, dtype=float), qvel=nodes, tracking_error=nodes,
        net_joint_moment=nodes, external_load=nodes, muscle_force=a, reserve=nodes[1:], shortfall=nodes[1:],
        status=np.zeros(n, dtype=int), muscle_names=model.muscle_names, dof_names=model.dof_names,
        dof_is_rotation=model.dof_is_rotation, settings={"dt": dt, "method": "hcmc"}, model=model,
    )  # fmt: skip


def swinging(n=21, **more):
    """The two pendulums, the upper swinging by half a radian."""
    qpos = np.stack([0.5 * np.sin(np.linspace(0, 2 * np.pi, n)), np.zeros(n)], axis=1)
    return filmed(load(), qpos, **more)


@pytest.fixture(scope="session")
def gl():
    """See `needs.missing` where nothing can be drawn."""
    from mjhcmc.offscreen import Canvas

    try:
        with Canvas(load().mj_model, 64, 64):
            pass
    except mjhcmc.OutputError as error:
        missing(str(error))

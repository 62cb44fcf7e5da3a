"""Models and states that the tests of mjhcmc.exact share."""

import mujoco
import numpy as np

from mjhcmc.exact.chain import Chain, chain_of, torque_driven_model
from mjhcmc.exact.scalars import Scalars
from mjhcmc.model import MuscleModel

OBLIQUE = """
<mujoco model="oblique">
  <compiler angle="radian"/>
  <option gravity="1 -2 -9" integrator="RK4"><flag contact="disable"/></option>
  <worldbody>
    <body name="base" pos=".1 .2 .3" quat="1 .2 .3 .4">
      <inertial pos="0 0 0" mass="3" diaginertia=".1 .1 .1"/>
      <body name="thigh" pos=".1 .2 .3" quat="1 .1 .3 -.4">
        <joint name="hip" axis="1 2 3" pos=".01 .02 -.03" armature=".01" damping=".2" ref=".3"/>
        <inertial pos=".05 .02 -.2" mass="2" fullinertia=".03 .04 .05 .004 -.003 .002"/>
        <body name="plate" pos=".05 .1 -.1" quat="1 2 3 4">
          <inertial pos=".05 .02 -.1" mass=".5" fullinertia=".003 .004 .005 .0004 -.0003 .0002"/>
          <body name="slider" pos=".1 -.2 -.3" quat=".5 -.1 .3 -.4">
            <joint name="slide" type="slide" axis="-1 .2 .3" pos=".01 .05 -.03" armature=".02" damping=".1"/>
            <inertial pos=".01 .02 -.2" mass="1" fullinertia=".03 .02 .04 .004 .003 -.002"/>
            <body name="shank" pos=".1 -.2 -.1" quat=".5 .1 -.3 -.4">
              <joint name="knee" axis="-1 .2 3" pos=".01 .05 .03" damping=".1"/>
              <inertial pos=".01 -.02 -.2" mass="1" fullinertia=".02 .03 .04 -.004 .003 .002"/>
            </body>
          </body>
        </body>
        <body name="branch" pos="-.1 -.2 -.3" quat=".5 -.1 .3 -.4">
          <joint name="branch" axis="-1 .2 -.3" pos=".01 .05 -.03" armature=".02" damping=".1"/>
          <inertial pos=".01 .02 -.2" mass="1" fullinertia=".03 .02 .04 .004 .003 -.002"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""A tree with oblique axes, off-diagonal inertia, offsets, armature, damping, a slide, a branch and a welded body."""

TURNED = """
<mujoco model="turned">
  <compiler angle="radian"/>
  <option gravity=".4 .3 -9" integrator="RK4"><flag contact="disable"/></option>
  <worldbody>
    <body name="a" pos=".1 .2 .3">
      <joint name="a" axis="1 2 2" pos=".1 .03 -.02" armature=".01" damping=".1"/>
      <inertial pos=".05 .1 -.2" mass="2" fullinertia=".03 .04 .05 .004 -.003 .002"/>
      <body name="b" pos=".05 .1 -.4" quat="1 .1 .2 .2">
        <joint name="b" axis="-1 -2 -2" pos=".02 .03 .01" ref=".2"/>
        <inertial pos=".01 .05 -.2" mass="1" fullinertia=".03 .02 .04 .004 .003 -.002"/>
        <body name="c" pos=".1 -.2 -.3" quat="1 -.25 -.5 -.5">
          <joint name="c" axis="2 4 4"/>
          <inertial pos=".04 .02 -.1" mass=".5" fullinertia=".003 .004 .005 .0004 -.0003 .0002"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""Three hinges with parallel, oblique axes, one of them turned round: the closed form holds."""


def model_of(name: str):
    """leg8, or a compiled model of this file."""
    if name == "leg8":
        return MuscleModel.load("leg8")
    return mujoco.MjModel.from_xml_string({"oblique": OBLIQUE, "turned": TURNED}[name])


def engine_of(name: str) -> tuple[Chain, object, object]:
    """The chain, the MuJoCo model without muscles, and its data."""
    model = model_of(name)
    m = torque_driven_model(model)
    return chain_of(model), m, mujoco.MjData(m)


def states(n: int, count: int, seed: int = 3):
    """Random q, v and torque, (n,) each."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield rng.uniform(-1, 1, n), rng.uniform(-3, 3, n), rng.uniform(-9, 9, n)


def furthest(one, other, scalars: Scalars) -> float:
    """Largest difference of lists, or lists of lists, of scalars."""
    if isinstance(one, (list, tuple)):
        return max(furthest(a, b, scalars) for a, b in zip(one, other, strict=True))
    with scalars.working():
        return scalars.size(one - other)

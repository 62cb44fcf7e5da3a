"""A leg under a pelvis that moves: with slides and a hinge, with a free joint, or not at all."""

RIDER = """
<mujoco model="rider">
  <option integrator="RK4" gravity="0 0 -9.81"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <site name="wall" pos="-.4 0 1"/>
    <body name="pelvis" pos="0 0 1">
      {root}
      <geom size=".1" mass="8" pos=".02 .01 .03"/><site name="a" pos=".06 0 .05"/><site name="e" pos="-.06 0 .02"/>
      <body name="thigh">
        <joint name="hip" axis="0 -1 0" damping=".4"/>
        <geom type="capsule" fromto="0 0 0 .02 0 -.4" size=".05" mass="5"/>
        <site name="b" pos=".05 0 -.15"/><site name="f" pos="-.05 0 -.15"/>
        <body name="shank" pos="0 0 -.4">
          <joint name="knee" axis="0 -1 0" damping=".2"/>
          <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="3"/><site name="c" pos=".05 0 -.1"/>
          <site name="g" pos="-.05 0 -.1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="front"><site site="a"/><site site="b"/></spatial>
    <spatial name="back" damping="3"><site site="e"/><site site="f"/></spatial>
    <spatial name="knee_front"><site site="b"/><site site="c"/></spatial>
    <spatial name="knee_back"><site site="f"/><site site="g"/></spatial>
  </tendon>
  <actuator>
    <muscle name="flexor" tendon="front" force="1500" lengthrange=".17 .23"/>
    <muscle name="extensor" tendon="back" force="1500" lengthrange=".17 .23"/>
    <muscle name="vasti" tendon="knee_front" force="900" lengthrange=".3 .39"/>
    <muscle name="hamstrings" tendon="knee_back" force="900" lengthrange=".3 .39"/>
  </actuator>
</mujoco>
"""
PLANAR = """<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
      <joint name="tilt" axis="0 -1 0"/>"""
FREE = '<freejoint name="pelvis"/>'
PENDULUM = RIDER.format(root="")

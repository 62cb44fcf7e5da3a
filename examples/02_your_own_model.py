"""Your own model: any MuJoCo model of hinges and slides with muscles, from a file, a string or an MjSpec."""

import mujoco
import numpy as np

import mjhcmc

# A forearm on an elbow with one muscle on either side. MuscleModel.load("elbow.xml") does the same from a file.
ARM = """
<mujoco model="elbow">
  <compiler angle="degree"/>
  <option integrator="RK4"/>
  <worldbody>
    <site name="biceps_origin" pos=".02 0 -.02"/>
    <site name="triceps_origin" pos="-.02 0 -.02"/>
    <body name="forearm" pos="0 0 -.3">
      <joint name="elbow" type="hinge" axis="0 -1 0" range="-10 140" limited="true" damping=".1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".03" mass="1.5"/>
      <site name="biceps_insertion" pos=".03 0 -.04"/>
      <site name="triceps_insertion" pos="-.025 0 .02"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="biceps_path"><site site="biceps_origin"/><site site="biceps_insertion"/></spatial>
    <spatial name="triceps_path"><site site="triceps_origin"/><site site="triceps_insertion"/></spatial>
  </tendon>
  <actuator>
    <muscle name="biceps" tendon="biceps_path" force="500" lengthrange=".2 .4" ctrlrange="0 1"/>
    <muscle name="triceps" tendon="triceps_path" force="500" lengthrange=".2 .4" ctrlrange="0 1"/>
  </actuator>
</mujoco>
"""
model = mjhcmc.MuscleModel.load(mujoco.MjSpec.from_string(ARM))
print(f"{model.name}: joints {', '.join(model.joint_names)}; muscles {', '.join(model.muscle_names)}")

# Bend the elbow by 60 degrees and stretch it again, twice.
motion = mjhcmc.Motion.cosine(model, amplitudes={"elbow": np.deg2rad(60)}, period=1.0, cycles=2)
solution = mjhcmc.hcmc(model, motion, dt=0.01)

print(f"max tracking error {np.rad2deg(np.abs(solution.tracking_error).max()):.2g} deg")
print(f"peak reserve       {np.abs(solution.reserve).max():.2g} N m of {solution.peak_moment[0]:.3g} N m")
for name, u in zip(solution.muscle_names, solution.excitation.T, strict=True):
    print(f"{name:8s} peak excitation {u.max():.2f}")

# A motion beyond the muscles: it still returns, with reserves, and says which joint, when, how much.
heavy = mjhcmc.Motion.cosine(model, amplitudes={"elbow": np.deg2rad(130)}, period=0.25, cycles=1)
beyond = mjhcmc.hcmc(model, heavy, dt=0.005)
print("beyond the muscles:", "holds" if beyond.verdict.passed else "FAILS")
print("\n".join(beyond.verdict.findings))

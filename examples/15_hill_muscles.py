"""MuJoCo's muscle beside a Hill model in NumPy: the same numbers, and what tendons that stretch would change."""

import tempfile
from pathlib import Path

import mujoco
import numpy as np

import mjhcmc
from mjhcmc.hill import mujoco_bias, mujoco_gain
from mjhcmc.plotting import excitation_figure, save_figure

folder = Path(tempfile.mkdtemp())
model = mjhcmc.MuscleModel.load("leg8")
motion = mjhcmc.Motion.cosine(model, "slow", cycles=1)
solution = mjhcmc.hcmc(model, motion)

# Number for number: force = gain(L, V) a + bias(L), in MuJoCo and in NumPy, at every node.
m, ids = model.mj_model, model.muscle_ids
data = mujoco.MjData(m)
engine, length, velocity = [], [], []
for q, v, a in zip(solution.qpos, solution.qvel, solution.activation, strict=True):
    data.qpos[:], data.qvel[:], data.act[model.act_index] = q, v, a
    mujoco.mj_forward(m, data)
    engine.append(data.actuator_force[ids].copy())
    length.append(data.actuator_length[ids].copy())
    velocity.append(data.actuator_velocity[ids].copy())
constants = m.actuator_lengthrange[ids], m.actuator_acc0[ids], m.actuator_gainprm[ids, :9]
force = mujoco_gain(length, velocity, *constants) * solution.activation + mujoco_bias(length, *constants)
apart = np.abs(force - engine).max() / model.max_isometric_force.max()
print(f"MuJoCo's muscles in NumPy: the same to {apart:.1g} of the largest F0")

# The same motion by Millard's muscles, on tendons that stretch: another plant under the same method.
plant = mjhcmc.HillPlant(model)
elastic = mjhcmc.hcmc(model, motion, plant=plant)
print("on compliant tendons the verdict", "holds" if elastic.verdict.passed else "FAILS")
for i, name in enumerate(model.muscle_names):
    rigid, stretched = solution.activation[:, i], elastic.activation[:, i]
    print(f"{name:10s} peak activation {rigid.max():.3f} by MuJoCo's muscle, {stretched.max():.3f} by Millard's")

save_figure(excitation_figure({"MuJoCo": solution, "Millard, compliant": elastic}), folder / "hill")
print("written to", folder, *sorted(path.name for path in folder.iterdir()))

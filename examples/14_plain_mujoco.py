"""The leg as it is shipped, in plain MuJoCo and in dm_control: the excitations that HCMC found move it there, too.

Only the first part needs mjhcmc; the rest reads an MJCF file and a table. In your own model's place stands its path.
"""

import tempfile
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd

import mjhcmc
from mjhcmc.assets import model_path

folder = Path(tempfile.mkdtemp())
leg = mjhcmc.MuscleModel.load("leg8")
motion = mjhcmc.Motion.cosine(leg, "fast")
mjhcmc.hcmc(leg, motion, dt=0.01, reserves=False).save(folder / "fast.parquet")  # by the muscles alone

# Plain MuJoCo: the shipped file, the table, and mj_step. Activation is MuJoCo's own state, act.
table = pd.read_parquet(folder / "fast.parquet")
model = mujoco.MjModel.from_xml_path(str(model_path("leg8")))
muscles = [model.actuator(i).name for i in range(model.nu)]
joints = [model.joint(i).name for i in range(model.njnt)]
excitation = table[[f"excitation/{name}" for name in muscles]].to_numpy()[
    :-1
]  # of the window from each row to the next
activation = table[[f"activation/{name}" for name in muscles]].to_numpy()
qpos, qvel = (table[[f"{what}/{name}" for name in joints]].to_numpy() for what in ("q", "qvel"))
n_step = round(0.01 / model.opt.timestep)

data = mujoco.MjData(model)
data.qpos[:], data.qvel[:], data.act[:] = qpos[0], qvel[0], activation[0]
played = [data.qpos.copy()]
for u in excitation:
    data.ctrl[:] = u
    mujoco.mj_step(model, data, n_step)
    played.append(data.qpos.copy())
off = np.rad2deg(np.abs(np.array(played) - qpos).max())
print(f"plain MuJoCo, {len(excitation)} windows of {n_step} steps: off by at most {off:.1g} deg, without any feedback")

# dm_control: the same file, read by its Physics.
try:
    from dm_control import mujoco as dm
except ImportError:
    print("dm_control is not installed: it has wheels for Python 3.12 and earlier")
else:
    physics = dm.Physics.from_xml_path(str(model_path("leg8")))
    with physics.reset_context():
        physics.named.data.qpos[joints] = qpos[0]
        physics.data.qvel[:], physics.data.act[:] = qvel[0], activation[0]
    for u in excitation:
        physics.set_control(u)
        physics.step(n_step)
    apart = np.rad2deg(np.abs(physics.data.qpos - played[-1]).max())
    print(f"dm_control ends {apart:.1g} deg from there")

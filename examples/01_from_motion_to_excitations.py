"""From a motion file to muscle excitations: the shortest path."""

import tempfile
from pathlib import Path

import numpy as np

import mjhcmc
from mjhcmc.io.opensim import write_table
from mjhcmc.summary import screen

folder = Path(tempfile.mkdtemp())

# A motion file, as OpenSim's inverse kinematics writes it: here one second of a swinging leg. Yours goes in its place.
time = np.linspace(0.0, 1.0, 101)
swing = 0.5 * (1 - np.cos(2 * np.pi * time))
columns = ["hip_flexion_r", "knee_angle_r", "ankle_angle_r"]
write_table(folder / "swing.mot", columns, time, np.outer(swing, [25.0, -50.0, -10.0]), name="swing", in_degrees=True)

# The five lines. A measured motion wants its noise filtered: from_file(..., lowpass_hz=6).
model = mjhcmc.MuscleModel.load("leg8")
motion = mjhcmc.Motion.from_file(folder / "swing.mot", model)
solution = mjhcmc.hcmc(model, motion, dt=0.01)
solution.save(folder / "swing.parquet")

print(screen(solution))
print("table:", folder / "swing.parquet")

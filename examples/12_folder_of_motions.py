"""Extraction by script: every motion file of a folder becomes a table of excitations, and all of them one summary."""

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

import mjhcmc
from mjhcmc.io.opensim import write_table

# A folder of motion files, in degrees, as OpenSim's inverse kinematics writes them. Yours goes in its place.
folder, out = Path(tempfile.mkdtemp()), Path(tempfile.mkdtemp())
rng = np.random.default_rng(1)
for trial, period in (("slow", 1.0), ("comfortable", 0.7), ("brisk", 0.5)):
    time = np.arange(0, 1.5 * period, 0.01)
    swing = 0.5 * (1 - np.cos(2 * np.pi * time / period))
    angles = np.outer(swing, [25.0, -50.0, -10.0]) + 0.1 * rng.standard_normal((len(time), 3))  # and noise
    columns = ["hip_flexion_r", "knee_angle_r", "ankle_angle_r"]
    write_table(folder / f"{trial}.mot", columns, time, angles, name=trial, in_degrees=True)

# All files are read before any work begins: a bad one is named at once. Markers' noise wants the filter.
model = mjhcmc.MuscleModel.load("leg8")
motions = mjhcmc.Motion.from_files(sorted(folder.glob("*.mot")), model, lowpass_hz=6)

rows = []
for motion in motions:
    solution = mjhcmc.hcmc(model, motion, dt=0.01)
    path = solution.save(out / f"{motion.name}.parquet")
    verdict = solution.verdict
    row = {"motion": motion.name, "holds": verdict.passed, "error_deg": np.rad2deg(max(verdict.tracking_max))}
    row |= {f"mean/{name}": u.mean() for name, u in zip(solution.muscle_names, solution.excitation.T, strict=True)}
    rows.append(row)
    print(f"{motion.name}: {solution.n_window} windows, {'holds' if verdict.passed else 'FAILS'}, {path}")

summary = pd.DataFrame(rows).set_index("motion")
summary.to_csv(out / "summary.csv")
print(summary.T.round(4).to_string())

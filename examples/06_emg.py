"""Measured EMG: envelopes, how well excitations agree with them, and a solution that follows them.

There is no recording in the package, so the example makes one: raw surface EMG, which is noise between 20 and 450 Hz as
large as the muscle is excited, of somebody who spares gastrocnemius and vasti, whatever the least effort would be.
"""

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import butter, sosfiltfilt

import mjhcmc
from mjhcmc.plotting import save_figure
from mjhcmc.plotting.emg import emg_figure

folder = Path(tempfile.mkdtemp())
model = mjhcmc.MuscleModel.load("leg8")
swing = dict(zip(("hip", "knee", "ankle"), np.deg2rad([25, -50, -15]), strict=True))
motion = mjhcmc.Motion.cosine(model, amplitudes=swing, period=0.6, cycles=3)

# The recording: four channels in volts at 2 kHz, from before the motion on; an electrode was loose for a while.
truth = mjhcmc.hcmc(model, motion, weights={"soleus": 0.1, "gastroc": 4.0, "vasti": 3.0})
rng = np.random.default_rng(1)
time = np.arange(-0.5, motion.end + 0.1, 1 / 2000)
noise = sosfiltfilt(butter(4, (30, 400), "bandpass", fs=2000, output="sos"), rng.standard_normal((4, len(time)))).T
names = {"soleus": "SOL", "gastroc": "GM", "vasti": "VL", "tib_ant": "TA"}
at = [model.muscle_names.index(muscle) for muscle in names]
size = [np.interp(time, truth.time[:-1] + truth.dt / 2, truth.excitation[:, i]) for i in at]
recording = pd.DataFrame(2e-4 * np.column_stack(size) * noise / noise.std(axis=0), columns=list(names.values()))
recording.insert(0, "time", time)
recording.loc[(time > 1.2) & (time < 1.25), "VL"] = np.nan
recording.to_csv(folder / "trial.csv", index=False)

# Envelopes over those of a maximum contraction (here known: 2e-4 V of noise, whose mean size is sqrt(2/pi) of that).
raw = mjhcmc.Emg.from_file(folder / "trial.csv")
emg = raw.envelope().normalised(2e-4 * np.sqrt(2 / np.pi))

# How well the least effort agrees with what was measured.
plain = mjhcmc.hcmc(model, motion)
before = mjhcmc.compare_emg(plain, emg, names)
print(before, "\n")
save_figure(emg_figure(before), folder / "before")

# Following it: activation is to be near the envelopes, the motion is followed all the same.
informed = mjhcmc.hcmc(model, motion, emg=mjhcmc.EmgTargets(emg, names, weight=20.0))
after = mjhcmc.compare_emg(informed, emg, names)
print(after, "\n")
save_figure(emg_figure(after), folder / "after")
print("written to", folder, *sorted(path.name for path in folder.iterdir()))

# Both are made with the same model as the recording: real muscles are further away.
others = [i for i in range(model.n_muscle) if i not in at]
for label, solution in (("least effort", plain), ("EMG-informed", informed)):
    apart = np.abs(solution.activation - truth.activation).mean(axis=0)
    error = np.rad2deg(np.abs(solution.tracking_error)).max()
    where = f"{apart[at].mean():.4f} where it was measured, {apart[others].mean():.4f} elsewhere"
    print(f"{label}: activation misses by {where}; max tracking error {error:.2g} deg")

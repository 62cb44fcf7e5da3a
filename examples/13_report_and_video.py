"""What to send to a colleague: a report in one HTML file, with EMG and another method beside it, and a video.

The video needs OpenGL without a screen (MUJOCO_GL=egl or osmesa); where there is none, the example says so.
"""

import tempfile
from pathlib import Path

import numpy as np

import mjhcmc

folder = Path(tempfile.mkdtemp())
model = mjhcmc.MuscleModel.load("leg8")
motion = mjhcmc.Motion.cosine(model, "fast", cycles=1)
solution = mjhcmc.hcmc(model, motion, dt=0.005)

# Envelopes of two muscles; a recording of yours comes from mjhcmc.Emg.from_file(...).envelope().
made_up = 1.2 * solution.excitation[:, :2] + 0.01
emg = mjhcmc.Emg(solution.time[:-1], np.clip(made_up, 0, 1), ("IL", "GM"), raw=False)

report = mjhcmc.write_report(
    solution,
    folder / "report.html",
    emg=emg,
    emg_map={"iliopsoas": "IL", "glut_max": "GM"},
    others={"static optimization": mjhcmc.static_optimization(model, motion, dt=0.005)},
)
print(f"{report}: {report.stat().st_size / 1e6:.1f} MB, no other file needed")

# Tendons in the colour of activation, a quarter of real time. An .mp4 needs the extra: pip install "mjhcmc[view]".
try:
    video = mjhcmc.write_video(solution, folder / "fast.gif", height=300, fps=20, speed=0.25)
except mjhcmc.OutputError as error:
    print(f"no video: {error}")
else:
    print(f"{video}: {video.stat().st_size / 1e3:.0f} kB")

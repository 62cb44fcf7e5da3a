"""Files that documents talk of, made from what the package ships, for `docs/test_blocks.py`.

Only documents named here get any. The others make what they need themselves.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from fences import ROOT

import mjhcmc
from mjhcmc.io.opensim import write_table

WALK = "walk.mot"
LOADS = """<?xml version="1.0" encoding="UTF-8" ?>
<OpenSimDocument Version="40000"><ExternalLoads name="push"><objects>
  <ExternalForce name="right">
    <applied_to_body>calcn_r</applied_to_body>
    <force_expressed_in_body>ground</force_expressed_in_body>
    <point_expressed_in_body>ground</point_expressed_in_body>
    <force_identifier>f_v</force_identifier>
    <point_identifier>f_p</point_identifier>
    <torque_identifier>t_</torque_identifier>
  </ExternalForce>
</objects><datafile>{table}</datafile></ExternalLoads></OpenSimDocument>
"""


def swing(folder: Path) -> None:
    """walk.mot: leg8 swings once a second, three times."""
    model = mjhcmc.MuscleModel.load("leg8")
    angles = {"hip": np.radians(25), "knee": np.radians(-50), "ankle": np.radians(10)}
    mjhcmc.Motion.cosine(model, amplitudes=angles, period=1.0, cycles=2).save(folder / WALK, model)


def step(folder: Path, motion: str = "walk_q.sto", loads: str = "grf.xml", document: str = "subject.osim") -> None:
    """A subject's model, a step of it with a moving pelvis, and a push from the ground."""
    sys.path.insert(0, str(ROOT / "tests"))
    try:
        from osim_documents import write_osim
    finally:
        sys.path.pop(0)
    write_osim(folder / document, size=1.02)
    model = mjhcmc.MuscleModel.load("leg8_gait")
    moves = {"pelvis_ty": 0.03, "pelvis_tilt": np.radians(4), "hip": np.radians(20), "knee": np.radians(-30)}
    mjhcmc.Motion.cosine(model, amplitudes=moves, period=1.0, cycles=2).save(folder / motion, model)
    time = np.linspace(0, 2, 401)
    push = 200 * np.sin(np.pi * time) ** 2  # N
    values = np.zeros((len(time), 9))
    values[:, 0], values[:, 1], values[:, 3] = push / 10, push, 0.05  # OpenSim's y is up
    columns = [f"{kind}{axis}" for kind in ("f_v", "f_p", "t_") for axis in "xyz"]
    table = Path(loads).with_suffix(".mot").name
    write_table(folder / table, columns, time, values, name="push", in_degrees=False)
    (folder / loads).write_text(LOADS.format(table=table), encoding="utf-8")


def opensim_step(folder: Path) -> None:
    """The same under the names that OpenSim's own example has: that one is not ours to ship."""
    step(folder, "subject_adjusted_Kinematics_q.sto", "subject01_walk_grf.xml", "subject01.osim")


def converted(folder: Path) -> None:
    """A model that was converted, with a motion, a load and its OpenSim document: here, too, a leg."""
    step(folder, "arm_q.sto", "handle.xml", "original.osim")
    shutil.copy(ROOT / "assets" / "leg8_gait.xml", folder / "converted.xml")


def recording(folder: Path) -> None:
    """trial.csv (raw EMG, V), channels.csv, mvc.json, and out/, the solution of walk.mot."""
    model = mjhcmc.MuscleModel.load("leg8")
    solution = mjhcmc.hcmc(model, mjhcmc.Motion.from_file(folder / WALK, model))
    (folder / "out").mkdir()
    solution.save(folder / "out" / "solution.parquet")
    time = np.arange(-0.5, 2.1, 1 / 1500)
    noise = np.diff(np.random.default_rng(0).standard_normal((len(time) + 1, 2)), axis=0) / np.sqrt(2)
    middle = solution.time[:-1] + solution.dt / 2
    columns = [solution.excitation[:, model.muscle_names.index(muscle)] for muscle in ("soleus", "vasti")]
    size = np.column_stack([np.interp(time, middle, column) for column in columns])
    signal = 2.4e-3 * (0.02 + size) * noise
    pd.DataFrame({"time": time, "SOL": signal[:, 0], "VL": signal[:, 1]}).to_csv(folder / "trial.csv", index=False)
    (folder / "channels.csv").write_text("muscle,channel\nvasti,VL\nsoleus,SOL\n")
    (folder / "mvc.json").write_text(json.dumps({"SOL": 1.9e-4, "VL": 2.4e-4}))


def pendulum(folder: Path) -> None:
    """arm.xml: two hinges."""
    shutil.copy(ROOT / "assets" / "leg8.xml", folder / "arm.xml")


FILES: dict[str, tuple[Callable[[Path], None], ...]] = {
    "README.md": (swing, step),
    "docs/emg.md": (swing, recording),
    "docs/coming-from-cmc.md": (step,),
    "docs/engines.md": (pendulum,),
    "docs/howto/opensim-files.md": (step, converted),
    "docs/sensitivity.md": (swing,),
    "docs/walking.md": (opensim_step,),
}


def prepare(name: str, folder: Path) -> None:
    """Put a document's files into a folder."""
    for make in FILES.get(name, ()):
        make(folder)

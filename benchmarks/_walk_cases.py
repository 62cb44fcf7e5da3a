"""The walking trial, solved: models, motions, loads and solutions that walk.py's tables and figure share."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from _markdown import ROOT
from numpy.typing import NDArray

import mjhcmc
from mjhcmc.activity import agreement
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.leg8 import JOINTS, leg8_from_osim
from mjhcmc.leg8.agreement import read_columns
from mjhcmc.methods import find_method
from mjhcmc.opensim_reference import OpenSimRun, read_run

Array = NDArray[np.float64]

WALK = ROOT.parent / "shared" / "walk"
OPENSIM = ROOT / "tests" / "data" / "walk" / "opensim_cmc.csv"
"""OpenSim's CMC on the trial, as _walk_opensim.py wrote it."""

SMOOTH, RAW = "subject_adjusted_Kinematics_q.sto", "subject01_walk_IK.mot"
START, END, DT = 0.6, 1.9, 0.005
FLOOR = 0.02
"""OpenSim's least activation, taken here too."""

COORDINATES = {"hip": "hip_flexion_r", "knee": "knee_angle_r", "ankle": "ankle_angle_r"}

MUJOCO_CURVES = {4: 0.5, 5: 1.6, 7: 1.3, 8: 1.2}
"""MuJoCo's defaults of lmin, lmax, fpmax and fvmax, by their places in gainprm and biasprm."""

MUJOCO_VMAX = {6: 1.5}


@cache
def model(*, side: str = "right", moving_knee: bool = False, muscles: str = "fitted") -> mjhcmc.MuscleModel:
    """The subject's leg; muscles: ``fitted``, ``curves`` (MuJoCo's but for vmax), ``defaults``, ``undamped``."""
    if not WALK.is_dir():
        raise SystemExit("the measured walk (shared/walk) is not beside this checkout")
    compiled = leg8_from_osim(WALK / "subject01.osim", side=side, moving_knee=moving_knee).compile()
    changes = {"curves": MUJOCO_CURVES, "defaults": MUJOCO_CURVES | MUJOCO_VMAX}.get(muscles, {})
    for place, value in changes.items():
        compiled.actuator_gainprm[:, place] = value
        compiled.actuator_biasprm[:, place] = value
    if muscles == "undamped":
        compiled.tendon_damping[:] = 0.0
    return mjhcmc.MuscleModel.load(compiled)


@cache
def solve(
    *,
    method: str = "hcmc",
    side: str = "right",
    moving_knee: bool = False,
    muscles: str = "fitted",
    kinematics: str = SMOOTH,
    lowpass: float | None = None,
    dt: float = DT,
    tendon: str | None = None,
    **settings: Any,
) -> mjhcmc.Solution:
    """A solution of the trial; tendon: ``rigid`` or ``compliant``, of Millard's muscles in place of MuJoCo's."""
    if tendon is not None:
        settings["plant"] = mjhcmc.HillPlant(
            model(side=side, moving_knee=moving_knee, muscles=muscles), muscles="millard", tendon=tendon
        )
    return find_method(method)(**inputs(side, moving_knee, muscles, kinematics, lowpass), dt=dt, **with_floor(settings))


def with_floor(settings: dict[str, Any]) -> dict[str, Any]:
    return {"min_activation": FLOOR} | settings


def inputs(
    side: str = "right", moving_knee: bool = False, muscles: str = "fitted", kinematics: str = SMOOTH,
    lowpass: float | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Model, motion and loads, as the methods take them."""
    own = model(side=side, moving_knee=moving_knee, muscles=muscles)
    motion = mjhcmc.Motion.from_file(WALK / kinematics, own, lowpass, start=START, end=END)
    loads = ExternalLoads.from_file(WALK / "subject01_walk_grf.xml", own, osim=WALK / "subject01.osim")
    return {"model": own, "motion": motion, "loads": loads}


def of_joints(solution: mjhcmc.Solution, values: Array, names: tuple[str, ...] = JOINTS) -> Array:
    """Columns of hip, knee and ankle, in this order, or of other degrees of freedom."""
    return values[..., [solution.dof_names.index(name) for name in names]]


@cache
def reference() -> dict[str, Array]:
    """OpenSim's kinematics and inverse dynamics of the trial, by column."""
    return dict(read_columns(WALK / "kinematics.csv"))


def opensim_moments(time: Array) -> Array:
    """(n, 3) N m: OpenSim's inverse dynamics at times that have a row there."""
    table = reference()
    rows = np.abs(table["time"][:, None] - time).argmin(axis=0)
    assert np.allclose(table["time"][rows], time, atol=1e-6)
    return np.stack([table[f"tau_{COORDINATES[joint]}"][rows] for joint in JOINTS], axis=1)


def moment_share(solution: mjhcmc.Solution) -> Array:
    """(3,) % : rms difference of the net joint moments from OpenSim's inverse dynamics, over its peak."""
    theirs = opensim_moments(solution.time)
    error = of_joints(solution, solution.net_joint_moment) - theirs
    return np.asarray(100 * np.sqrt((error**2).mean(axis=0)) / np.abs(theirs).max(axis=0))


@cache
def opensim_cmc() -> OpenSimRun | None:
    """OpenSim's activations, None where its table is not there."""
    return read_run(OPENSIM, model()) if OPENSIM.is_file() else None


def against(solution: mjhcmc.Solution, other: OpenSimRun) -> dict[str, tuple[float, float]]:
    """r and RMS of activation by muscle."""
    return agreement(solution.time, solution.activation, other.activity, FLOOR)


def as_run(solution: mjhcmc.Solution) -> OpenSimRun:
    """A solution as something to compare with."""
    return OpenSimRun(solution.time, solution.activation, solution.muscle_names)

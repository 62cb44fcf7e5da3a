"""A subject's leg from its .osim beside OpenSim, along the walking trial: joint moments, lengths, moment arms.

    python benchmarks/walk_geometry.py [--write DOCUMENT] [--json FILE] [--walk FOLDER]

The trial (shared/walk) holds subject01.osim, kinematics.csv, grf.csv and muscle_geometry.csv.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from _markdown import ROOT, grid, into
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from mjhcmc.io.files import written_whole
from mjhcmc.io.osim import read_osim
from mjhcmc.leg8 import JOINTS, MUSCLES, leg8_from_osim
from mjhcmc.leg8.agreement import read_columns
from mjhcmc.leg8.from_osim import subject_table
from mjhcmc.leg8.osim_leg import OsimLeg
from mjhcmc.leg8.subject_fit import PathModel
from mjhcmc.leg8.table import ROOT_JOINTS

Array = NDArray[np.float64]

COLUMNS = {"hip": "hip_flexion_r", "knee": "knee_angle_r", "ankle": "ankle_angle_r"} | {n: n for n in ROOT_JOINTS}
SUBJECT = "subject01.osim"


def world(columns: dict[str, Array], name: str, rows: Array) -> Array:
    """A vector of the ground reaction under the right foot at times (n,), in the model's world (n, 3)."""
    x, y, z = (np.interp(rows, columns["time"], columns[f"{name}{axis}_right"]) for axis in "xyz")
    return np.stack([x, -z, y], axis=1)


def net_moments(walk: Path, moving_knee: bool) -> tuple[Array, Array]:
    """Net joint moments (n, 3), N m, of hip, knee and ankle along the trial: the subject's leg, and OpenSim's.

    Inverse dynamics M q'' + h - J^T F, seen from the knee's angle where its slides follow it: N^T of the whole.
    """
    motion, load = read_columns(walk / "kinematics.csv"), read_columns(walk / "grf.csv")
    m = leg8_from_osim(walk / SUBJECT, moving_knee=moving_knee).compile()
    d = mujoco.MjData(m)
    force, point, torque = (world(load, name, motion["time"]) for name in "FPT")
    foot, moments = m.body("foot").id, np.empty((len(force), 3))
    for row in range(len(force)):
        d.qpos[:], d.qvel[:], d.qacc[:] = 0.0, 0.0, 0.0
        for joint, column in COLUMNS.items():
            own = d.joint(joint)
            own.qpos, own.qvel, own.qacc = (motion[f"{kind}_{column}"][row] for kind in ("q", "u", "udot"))
        N = follow(m, d)
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        Q, external = np.zeros(m.nv), np.zeros(m.nv)
        mujoco.mj_rne(m, d, 1, Q)
        mujoco.mj_applyFT(m, d, force[row], torque[row], point[row], foot, external)
        seen = N.T @ (Q + m.dof_armature * d.qacc - external)
        moments[row] = [seen[m.joint(joint).id] for joint in JOINTS]
    return moments, np.stack([motion[f"tau_{COLUMNS[joint]}"] for joint in JOINTS], axis=1)


def follow(m: Any, d: Any) -> Array:
    """Let joints that follow others do so, in place; returns N (nv, nv), what all velocities are by the led ones'."""
    N = np.eye(m.nv)
    for equality in range(m.neq):
        y, x = m.eq_obj1id[equality], m.eq_obj2id[equality]
        path = Polynomial(m.eq_data[equality, :5])
        slope, bend = path.deriv()(d.qpos[x]), path.deriv(2)(d.qpos[x])
        d.qpos[y], d.qvel[y] = path(d.qpos[x]), slope * d.qvel[x]
        d.qacc[y] = slope * d.qacc[x] + bend * d.qvel[x] ** 2
        N[y] = slope * N[x]
    return N


def moment_error(walk: Path, moving_knee: bool) -> Array:
    """Root mean square error of each net joint moment over its peak (3,)."""
    moments, reference = net_moments(walk, moving_knee)
    error: Array = np.sqrt(((moments - reference) ** 2).mean(axis=0)) / np.abs(reference).max(axis=0)
    return error


def path_error(walk: Path, moving_knee: bool) -> tuple[Array, Array]:
    """Root mean square errors of lengths (8,) and moment arms (8, 3) along the trial, m."""
    motion, own = read_columns(walk / "kinematics.csv"), read_columns(walk / "muscle_geometry.csv")
    qpos = np.stack([motion[f"q_{COLUMNS[joint]}"] for joint in JOINTS], axis=1)
    table = subject_table(OsimLeg(read_osim(walk / SUBJECT), "right"), moving_knee=moving_knee)
    length, arm = PathModel(table).lengths_and_arms(qpos)
    own_length = np.stack([own[f"lmt_{muscle}_r"] for muscle in MUSCLES], axis=1)
    own_arm = np.stack(
        [np.stack([own[f"r_{joint}_{muscle}_r"] for joint in JOINTS], axis=1) for muscle in MUSCLES], axis=1
    )
    return np.sqrt(((length - own_length) ** 2).mean(axis=0)), np.sqrt(((arm - own_arm) ** 2).mean(axis=0))


def measure(walk: Path) -> dict[str, Any]:
    """All figures: moments in % of the peak, lengths and moment arms in mm."""
    result: dict[str, Any] = {}
    for name, moving in (("fixed hinge", False), ("moving axis", True)):
        length, arm = path_error(walk, moving)
        result[name] = {
            "moments_percent": dict(zip(JOINTS, (moment_error(walk, moving) * 100).tolist(), strict=True)),
            "length_mm": dict(zip(MUSCLES, (length * 1e3).tolist(), strict=True)),
            "arm_mm": {
                m: dict(zip(JOINTS, row, strict=True)) for m, row in zip(MUSCLES, (arm * 1e3).tolist(), strict=True)
            },
        }
    return result


def markdown(found: dict[str, Any]) -> str:
    """The figures as two tables."""
    knees = list(found)
    to_reach = {"fixed hinge": "3 / 2 / 1", "moving axis": "1 / 1 / 0.5"}
    moments = grid(
        ("knee", *(f"{joint}, % of peak" for joint in JOINTS), "to reach"),
        ((k, *(f"{found[k]['moments_percent'][joint]:.2f}" for joint in JOINTS), to_reach[k]) for k in knees),
    )
    header = [f"{what}, {knee}" for knee in knees for what in ("length, mm", *(f"{joint} arm, mm" for joint in JOINTS))]
    rows = []
    for muscle in MUSCLES:
        cells = []
        for knee in knees:
            cells += [found[knee]["length_mm"][muscle], *found[knee]["arm_mm"][muscle].values()]
        rows.append((muscle, *(f"{value:.2f}" for value in cells)))
    return (
        "Net joint moments, root mean square error over the peak:\n\n"
        + moments
        + "\n\nMusculotendon lengths and moment arms, root mean square errors (5 mm to reach):\n\n"
        + grid(("muscle", *header), rows)
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--walk", type=Path, default=ROOT.parent / "shared" / "walk", help="folder of the trial")
    parser.add_argument("--write", type=Path, metavar="DOCUMENT", help="put the tables into a document")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures as JSON")
    options = parser.parse_args()
    if options.write:
        into(options.write.read_text(encoding="utf-8"), "walk_geometry.py", "")  # refuse before the work begins
    found = measure(options.walk)
    tables = markdown(found)
    print(tables)
    if options.json:
        with written_whole(options.json) as temporary:
            temporary.write_text(json.dumps(found, indent=1), encoding="utf-8")
    if options.write:
        text = into(options.write.read_text(encoding="utf-8"), "walk_geometry.py", tables)
        with written_whole(options.write) as temporary:
            temporary.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

"""The models of myo-sim: what mjhcmc sees in them, and how a small motion of their main joints is followed.

    python benchmarks/myo.py [--write [DOCUMENT]]

--write replaces the table in docs/models.md (or DOCUMENT). Needs the `myo-sim` package; the whole takes some minutes.
"""

from __future__ import annotations

import statistics
import time
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace

import mujoco
import numpy as np
from _markdown import ROOT, digits, grid, main

import mjhcmc

DT, PERIOD = 0.005, 1.2  # s
TURNS = 5  # readings of which the median is shown
ARM_AWAY = 10.0  # deg of shoulder elevation: at the reference pose the humerus is inside the thorax

LEG = {"hip_flexion_r": 25, "knee_angle_r": 40, "ankle_angle_r": 10}
TRUNK = {"flex_extension": -15, "lat_bending": 5, "axial_rotation": 10}
ELBOW = {"elbow_flexion_r": 20}
SOCKET_STEP, FINGER_STEP = 2.8e-4, 2.5e-4  # s, what the error messages name

CASES: tuple[tuple[str, Mapping[str, float], float], ...] = (
    ("myofinger", {"IFmcp": 20, "IFpip": 20, "IFdip": 15}, FINGER_STEP),
    ("myoelbow", {"r_elbow_flex": 60}, 1e-3),
    ("myoelbow_2dof", {"r_elbow_flex": 60}, 1e-3),
    ("myoelbow_exo", {"r_elbow_flex": 60}, 1e-3),
    ("myohand_r", {"flexion_r": 10}, 1e-3),
    ("myohands", {"flexion_r": 10, "flexion_l": 10}, 1e-3),
    ("myoarm_r", ELBOW, 1e-3),
    ("myoarms", ELBOW | {"elbow_flexion_l": 20}, 1e-3),
    ("myotorso", TRUNK, 1e-3),
    ("myotorso_abdomen", TRUNK, 1e-3),
    ("myotorso_arm_r", {"flex_extension": -10} | ELBOW, 1e-3),
    ("myotorso_arms", {"flex_extension": -10} | ELBOW, 1e-3),
    ("myolegs", LEG, 1e-3),
    ("myolegs_abdomen", LEG, 1e-3),
    ("myolegs26", LEG | {"knee_angle_r": -40}, 1e-3),
    ("myolegs_osl", {"hip_flexion_l": 25, "knee_angle_l": 40, "ankle_angle_l": 10}, SOCKET_STEP),
    ("myofullbody", LEG, 1e-3),
)
"""Model, amplitudes in degrees, physics step in s."""


def load(name: str) -> mjhcmc.MuscleModel:
    import myo_sim  # type: ignore[import-untyped]

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of how the package puts its models together, and of the integrator
        return mjhcmc.MuscleModel.load(myo_sim.load_model(name))


def motion_of(model: mjhcmc.MuscleModel, amplitudes: Mapping[str, float]) -> mjhcmc.Motion:
    """The cosine movement, with arms a little off the trunk."""
    radians = {joint: float(np.deg2rad(value)) for joint, value in amplitudes.items()}
    motion = mjhcmc.Motion.cosine(model, amplitudes=radians, period=PERIOD, cycles=1)
    qpos = motion.qpos.copy()
    for joint in ("shoulder_elv_r", "shoulder_elv_l"):
        if joint in model.joint_names:
            qpos[:, model.joint_names.index(joint)] += np.deg2rad(ARM_AWAY)
    return replace(motion, qpos=qpos)


def cpu(run: Callable[[], object]) -> float:
    began = time.process_time()
    run()
    return time.process_time() - began


def bare(solution: mjhcmc.Solution) -> float:
    """CPU seconds of mj_step alone, over the same windows, each from its recorded node."""
    model = solution.model
    assert model is not None
    plant = solution.plant(solution.settings["physics_dt"])
    m, d = plant.mj_model, mujoco.MjData(plant.mj_model)
    n_step = round(solution.dt / plant.physics_dt)

    def run() -> None:
        for k in range(solution.n_window):
            d.qpos[:], d.qvel[:], d.act[model.act_index] = solution.qpos[k], solution.qvel[k], solution.activation[k]
            d.ctrl[model.ctrl_index], d.qfrc_applied[:] = solution.excitation[k], solution.reserve[k]
            mujoco.mj_step(m, d, nstep=n_step)

    return cpu(run)


def row(name: str, amplitudes: Mapping[str, float], step: float) -> tuple[str, ...]:
    model = load(name)
    motion = motion_of(model, amplitudes)
    of = Counter(str(role) for role in model.roles.of)
    roles = ", ".join(f"{of[role]} {role}" for role in ("tracked", "dependent", "prescribed", "free") if of[role])
    size = f"{model.nq} / {model.nv} / {model.n_muscle}"
    solved: list[mjhcmc.Solution] = []
    ratios = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mjhcmc.MjhcmcWarning)
        for _ in range(TURNS):  # one after the other, so that both see the same machine
            taken = cpu(lambda: solved.append(mjhcmc.hcmc(model, motion, dt=DT, physics_dt=step)))
            ratios.append(taken / bare(solved[-1]))
    solution = solved[0]
    tracked = model.roles.tracked
    hinges = tracked[model.dof_is_rotation[tracked]]
    errors = np.rad2deg(np.abs(solution.tracking_error).max(axis=0))
    worst = hinges[np.argmax(errors[hinges])]
    share = np.abs(solution.reserve).max(axis=0) / np.maximum(solution.peak_moment, 1e-3)
    lacking = int(np.argmax(share))
    size_of = np.abs(solution.reserve[:, lacking]).max()
    unit = "N m" if solution.dof_is_rotation[lacking] else "N"
    reserve = f"{size_of:.1e} {unit} at {solution.dof_names[lacking]}" if share[lacking] > 1e-3 else "none"
    physics = f"{1e3 * solution.settings['physics_dt']:.2g}"
    return (
        name, size, roles, physics, f"{digits(errors[worst], 2)} ({solution.dof_names[worst]})", reserve,
        f"{statistics.median(ratios):.1f}",
    )  # fmt: skip


def markdown() -> str:
    warm = load("myotorso")  # compiles what is compiled once
    mjhcmc.hcmc(warm, mjhcmc.Motion.cosine(warm, amplitudes={"flex_extension": -0.1}, period=0.1, cycles=1), dt=DT)
    header = (
        "model", "nq / nv / muscles", "degrees of freedom", "physics step, ms", "largest error, deg",
        "largest reserve (share of the joint's peak moment over .1 %)", "CPU time over bare stepping",
    )  # fmt: skip
    return grid(header, (row(*case) for case in CASES))


if __name__ == "__main__":
    main("myo.py", "The models of myo-sim: seen, and driven.", markdown, document=ROOT / "docs" / "models.md")

"""OpenSim's CMC on the walking trial: the right leg's activations, to compare with.

    python benchmarks/_walk_opensim.py FOLDER TABLE

needs the Python package opensim (4.6) and nothing else, so that another interpreter can run it. FOLDER is the trial's
(shared/walk); TABLE, a .csv, is written. Takes two minutes of CPU.

The whole model of the trial walks: 10 coordinates, 18 muscles with compliant tendons, all coordinates tracked, ground
reactions on both feet. Residuals at the pelvis and the torque at the back cost next to nothing; reserves at the legs'
joints have an optimal force of 1 N m.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

START, END, INITIALISATION, STEP = 0.57, 1.9, 0.03, 0.01
"""s; CMC's first 30 ms are its search for a start, and are left out of the table; it does not write its last window."""

KP, KV, WINDOW, RESERVE = 100, 20, 0.005, 1.0
"""With a window of 10 ms activations ring, most at the ankle, and reserves come to 8 N m; with 5 ms to 0.02."""

FREE = {"pelvis_tx": 1000.0, "pelvis_ty": 1000.0, "pelvis_tilt": 1000.0, "lumbar_extension": 1000.0}
"""Optimal forces (N or N m) of what is not under study."""

LEG = ("hip_flexion", "knee_angle", "ankle_angle")

_CMC = """<?xml version="1.0" encoding="UTF-8" ?>
<OpenSimDocument Version="40000"><CMCTool name="cmc">
<model_file>{folder}/model.osim</model_file><replace_force_set>false</replace_force_set>
<results_directory>{folder}</results_directory><output_precision>12</output_precision>
<initial_time>{start}</initial_time><final_time>{end}</final_time>
<solve_for_equilibrium_for_auxiliary_states>true</solve_for_equilibrium_for_auxiliary_states>
<maximum_number_of_integrator_steps>30000</maximum_number_of_integrator_steps>
<maximum_integrator_step_size>{window}</maximum_integrator_step_size>
<minimum_integrator_step_size>1e-8</minimum_integrator_step_size>
<integrator_error_tolerance>1e-5</integrator_error_tolerance>
<external_loads_file>{loads}</external_loads_file>
<desired_kinematics_file>{motion}</desired_kinematics_file><task_set_file>{folder}/tasks.xml</task_set_file>
<lowpass_cutoff_frequency>-1</lowpass_cutoff_frequency><cmc_time_window>{window}</cmc_time_window>
<use_fast_optimization_target>true</use_fast_optimization_target>
<optimizer_algorithm>ipopt</optimizer_algorithm><optimization_convergence_tolerance>1e-4</optimization_convergence_tolerance>
<optimizer_max_iterations>2000</optimizer_max_iterations></CMCTool></OpenSimDocument>
"""


def prepare(source: Path, folder: Path, end: float = END) -> Path:
    """The model with residuals and reserves, the tracking tasks, and the tool's setup file, in a folder."""
    import opensim

    model = opensim.Model(str(source / "subject01.osim"))
    reserves = {f"{joint}_{side}": RESERVE for joint in LEG for side in "rl"}
    tasks = opensim.CMC_TaskSet()
    for coordinate, force in {**FREE, **reserves}.items():
        actuator = opensim.CoordinateActuator(coordinate)
        actuator.setName(f"reserve_{coordinate}")
        actuator.setOptimalForce(force)
        actuator.setMinControl(-100.0)
        actuator.setMaxControl(100.0)
        model.addForce(actuator)
        task = opensim.CMC_Joint()
        task.setName(coordinate)
        task.setCoordinateName(coordinate)
        task.setKP(KP, 1, 1)
        task.setKV(KV, 1, 1)
        task.setActive(True, False, False)
        tasks.cloneAndAppend(task)
    model.finalizeConnections()
    model.printToXML(str(folder / "model.osim"))
    tasks.printToXML(str(folder / "tasks.xml"))
    setup = folder / "setup.xml"
    setup.write_text(
        _CMC.format(
            folder=folder, start=START, end=end + WINDOW, window=WINDOW, loads=source / "subject01_walk_grf.xml",
            motion=source / "subject_adjusted_Kinematics_q.sto",
        ),
        encoding="utf-8",
    )  # fmt: skip
    return setup


def read_sto(path: Path) -> tuple[list[str], list[list[float]]]:
    """Labels and rows. CMC damages the head of its states file as it exits; rows and labels survive."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("time\t"))
    return lines[at].split("\t"), [[float(cell) for cell in line.split()] for line in lines[at + 1 :] if line.strip()]


def interpolated(rows: list[list[float]], column: int, at: float) -> float:
    """Linear, between rows with increasing times."""
    after = next((i for i, row in enumerate(rows) if row[0] >= at - 1e-9), len(rows) - 1)
    one, other = rows[max(after - 1, 0)], rows[after]
    span = other[0] - one[0]
    part = (at - one[0]) / span if span > 0 else 1.0
    return one[column] + min(max(part, 0.0), 1.0) * (other[column] - one[column])


def main(source: Path, table: Path, end: float = END) -> None:
    import opensim

    opensim.Logger.setLevelString("error")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        setup = prepare(source.resolve(), folder, end)
        tool = opensim.CMCTool(str(setup))
        wall, cpu = time.perf_counter(), time.process_time()
        if not tool.run():
            raise SystemExit("OpenSim's CMC failed on the walk")
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        labels, rows = read_sto(folder / "cmc_states.sto")
        force_labels, forces = read_sto(folder / "cmc_Actuation_force.sto")
    muscles = [label.split("/")[2] for label in labels if label.endswith("_r/activation")]
    columns = [labels.index(f"/forceset/{muscle}/activation") for muscle in muscles]
    peak = {
        name: max(abs(row[i]) for row in forces if row[0] >= START + INITIALISATION - 1e-9)
        for i, name in enumerate(force_labels)
        if name.startswith("reserve_") and not name.endswith("_l")
    }
    lines = [
        "# Activations of the right leg's muscles in a walk, found by OpenSim "
        f"{opensim.GetVersion().split('-')[0]} (CMC, kp {KP}, kv {KV}, window {WINDOW:g} s) with the model, motion and "
        "ground reaction of gait10dof18musc (Delp, Loan, Hoy, Zajac, Topp, Rosen, Thelen, Anderson, Seth; CC-BY 3.0).",
        f"# Seconds for {end + WINDOW - START:.2f} s of motion: {wall:.0f} by the clock, {cpu:.0f} of CPU. Peak "
        "residuals and reserves, N or N m: "
        + ", ".join(f"{k.removeprefix('reserve_')} {v:.3g}" for k, v in peak.items())
        + ".",
        ",".join(["time", *(f"a_{muscle}" for muscle in muscles)]),
    ]
    n = round((end - START - INITIALISATION) / STEP)
    for k in range(n + 1):
        at = START + INITIALISATION + k * STEP
        lines.append(",".join([f"{at:.2f}", *(f"{interpolated(rows, column, at):.5f}" for column in columns)]))
    temporary = table.with_name(table.name + ".part")
    temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
    temporary.replace(table)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

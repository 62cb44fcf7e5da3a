"""OpenSim's CMC and Static Optimization on leg8's source model, set up; also a script that times both.

    python benchmarks/_opensim_tools.py FOLDER MOVEMENT [MOVEMENT ...]

needs the Python package opensim (4.6) and nothing else, so that another interpreter can run it. FOLDER is the one of
leg8.osim and its motions (shared/reference/leg8). Prints JSON: OpenSim's version, and wall and CPU seconds of each run.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

MOTION = {"slow": ("traj_a_nopad.mot", 1.8), "fast": ("traj_b_nopad.mot", 0.6)}
"""File and last time (s) of a movement."""

COORDINATES = ("hip_flexion_r", "knee_angle_r", "ankle_angle_r")
KP, KV, WINDOW, RESERVE = 100, 20, 0.01, 1.0

_CMC = """<?xml version="1.0" encoding="UTF-8" ?>
<OpenSimDocument Version="40000"><CMCTool name="cmc">
<model_file>{folder}/model.osim</model_file><replace_force_set>false</replace_force_set>
<results_directory>{folder}</results_directory><output_precision>12</output_precision>
<initial_time>0</initial_time><final_time>{end}</final_time>
<solve_for_equilibrium_for_auxiliary_states>true</solve_for_equilibrium_for_auxiliary_states>
<maximum_number_of_integrator_steps>30000</maximum_number_of_integrator_steps>
<maximum_integrator_step_size>{window}</maximum_integrator_step_size>
<minimum_integrator_step_size>1e-8</minimum_integrator_step_size>
<integrator_error_tolerance>1e-5</integrator_error_tolerance>
<desired_kinematics_file>{motion}</desired_kinematics_file><task_set_file>{folder}/tasks.xml</task_set_file>
<lowpass_cutoff_frequency>-1</lowpass_cutoff_frequency><cmc_time_window>{window}</cmc_time_window>
<use_fast_optimization_target>true</use_fast_optimization_target>
<optimizer_algorithm>ipopt</optimizer_algorithm><optimization_convergence_tolerance>1e-4</optimization_convergence_tolerance>
<optimizer_max_iterations>2000</optimizer_max_iterations></CMCTool></OpenSimDocument>
"""


@contextmanager
def cmc_tool(source: Path, movement: str, tendon: str = "compliant") -> Iterator[tuple[Any, Path]]:
    """CMC ready to run, and the folder that its results go to."""
    import opensim

    motion, end = MOTION[movement]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write_model(source, folder, rigid=tendon == "rigid")
        tasks = opensim.CMC_TaskSet()
        for coordinate in COORDINATES:
            task = opensim.CMC_Joint()
            task.setName(coordinate)
            task.setCoordinateName(coordinate)
            task.setKP(KP, 1, 1)
            task.setKV(KV, 1, 1)
            task.setActive(True, False, False)
            tasks.cloneAndAppend(task)
        tasks.printToXML(str(folder / "tasks.xml"))
        setup = folder / "setup.xml"
        setup.write_text(_CMC.format(folder=folder, end=end, window=WINDOW, motion=source / motion), encoding="utf-8")
        yield opensim.CMCTool(str(setup)), folder


@contextmanager
def static_optimization_tool(source: Path, movement: str) -> Iterator[tuple[Any, Path]]:
    """Static Optimization (squared activations, every row of the motion) ready to run, and its folder."""
    import opensim

    motion, end = MOTION[movement]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write_model(source, folder, rigid=False)
        analysis = opensim.StaticOptimization()
        analysis.setStartTime(0)
        analysis.setEndTime(end)
        analysis.setStepInterval(1)
        analysis.setUseModelForceSet(True)
        analysis.setUseMusclePhysiology(True)
        analysis.setActivationExponent(2)
        tool = opensim.AnalyzeTool()
        tool.setName("so")
        tool.setModelFilename(str(folder / "model.osim"))
        tool.setStartTime(0)
        tool.setFinalTime(end)
        tool.setCoordinatesFileName(str(source / motion))
        tool.setLowpassCutoffFrequency(-1)
        tool.setSolveForEquilibrium(False)
        tool.setResultsDir(str(folder))
        tool.updAnalysisSet().cloneAndAppend(analysis)
        setup = folder / "setup.xml"
        tool.printToXML(str(setup))
        yield opensim.AnalyzeTool(str(setup)), folder


def _write_model(source: Path, folder: Path, *, rigid: bool) -> None:
    """The leg with a reserve on each coordinate."""
    import opensim

    leg = opensim.Model(str(source / "leg8.osim"))
    muscles = leg.getMuscles()
    for i in range(muscles.getSize()):
        muscles.get(i).set_ignore_tendon_compliance(rigid)
    for coordinate in COORDINATES:
        reserve = opensim.CoordinateActuator(coordinate)
        reserve.setName(f"reserve_{coordinate}")
        reserve.setOptimalForce(RESERVE)
        reserve.setMinControl(-100.0)
        reserve.setMaxControl(100.0)
        leg.addForce(reserve)
    leg.finalizeConnections()
    leg.printToXML(str(folder / "model.osim"))


def time_tools(source: Path, movements: list[str]) -> dict[str, Any]:
    """Wall and CPU seconds of one run of each tool on each movement; models and setups loaded before."""
    import opensim

    opensim.Logger.setLevelString("error")
    runs = []
    for movement in movements:
        for name, ready in (("CMC", cmc_tool), ("Static Optimization", static_optimization_tool)):
            with ready(source, movement) as (tool, _):
                wall, cpu = time.perf_counter(), time.process_time()
                if not tool.run():
                    raise SystemExit(f"OpenSim's {name} failed on {movement}")
                wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            runs.append({"tool": name, "movement": movement, "wall": wall, "cpu": cpu})
    return {"version": opensim.GetVersion(), "runs": runs}


if __name__ == "__main__":
    print(json.dumps(time_tools(Path(sys.argv[1]), sys.argv[2:])))

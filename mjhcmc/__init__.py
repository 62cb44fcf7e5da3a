"""mjhcmc: muscle excitations from motion, for any MuJoCo muscle model.

The shortest path from a motion file to excitations::

    import mjhcmc

    model = mjhcmc.MuscleModel.load("leg8")
    motion = mjhcmc.Motion.from_file("walk.mot", model, lowpass_hz=6)
    solution = mjhcmc.hcmc(model, motion, dt=0.005)
    solution.save("walk.parquet")
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mjhcmc.detail import Detail
    from mjhcmc.emg import Emg
    from mjhcmc.emg_comparison import EmgComparison, compare_emg
    from mjhcmc.emg_targets import EmgTargets
    from mjhcmc.errors import (
        DivergedError,
        MjhcmcError,
        MjhcmcWarning,
        ModelError,
        MotionError,
        OutputError,
        SettingsError,
        SimulationError,
    )
    from mjhcmc.external_loads import ExternalLoads
    from mjhcmc.gradients.calibration import Calibration, calibrate, calibrate_moments
    from mjhcmc.gradients.gradient import Gradient, GradientBatch, gradient, gradient_batch
    from mjhcmc.gradients.table import sensitivity_table
    from mjhcmc.gradients.uncertainty import intervals
    from mjhcmc.hosted.plant import HillPlant
    from mjhcmc.imposed import Imposed
    from mjhcmc.io.export import export_opensim
    from mjhcmc.joint_moments import JointMoments
    from mjhcmc.methods.cmc import cmc
    from mjhcmc.methods.hcmc import hcmc
    from mjhcmc.methods.hcmc_batch import hcmc_batch
    from mjhcmc.methods.run import SolveInterrupted
    from mjhcmc.methods.static_optimization import static_optimization
    from mjhcmc.model import MuscleModel
    from mjhcmc.model_check.check import check
    from mjhcmc.motion import Motion
    from mjhcmc.periodic import fit_harmonics
    from mjhcmc.plant import MujocoPlant
    from mjhcmc.report.page import write_report
    from mjhcmc.saved import Saved, open_saved
    from mjhcmc.segments import joint_angles, segment_angles
    from mjhcmc.solution import Solution, WindowStatus
    from mjhcmc.solution_batch import SimulationStatus, SolutionBatch
    from mjhcmc.verify import Verdict, replay, replay_windows
    from mjhcmc.viewing.browser import view_in_browser
    from mjhcmc.viewing.frames import Frames
    from mjhcmc.viewing.live import live_page
    from mjhcmc.viewing.video import write_image, write_video
    from mjhcmc.viewing.window import view

__version__ = "0.1.0"

# Where each public name lives. Imported on first use: MuJoCo and Numba take a second, `mjhcmc --help` should not.
_HOME = {
    "Calibration": "gradients.calibration",
    "Detail": "detail",
    "DivergedError": "errors",
    "Emg": "emg",
    "EmgComparison": "emg_comparison",
    "EmgTargets": "emg_targets",
    "ExternalLoads": "external_loads",
    "Frames": "viewing.frames",
    "Gradient": "gradients.gradient",
    "GradientBatch": "gradients.gradient",
    "HillPlant": "hosted.plant",
    "Imposed": "imposed",
    "JointMoments": "joint_moments",
    "MjhcmcError": "errors",
    "MjhcmcWarning": "errors",
    "ModelError": "errors",
    "Motion": "motion",
    "MotionError": "errors",
    "MujocoPlant": "plant",
    "MuscleModel": "model",
    "OutputError": "errors",
    "Saved": "saved",
    "SettingsError": "errors",
    "SimulationError": "errors",
    "SimulationStatus": "solution_batch",
    "Solution": "solution",
    "SolutionBatch": "solution_batch",
    "SolveInterrupted": "methods.run",
    "Verdict": "verify",
    "WindowStatus": "solution",
    "calibrate": "gradients.calibration",
    "calibrate_moments": "gradients.calibration",
    "check": "model_check.check",
    "cmc": "methods.cmc",
    "compare_emg": "emg_comparison",
    "export_opensim": "io.export",
    "fit_harmonics": "periodic",
    "gradient": "gradients.gradient",
    "gradient_batch": "gradients.gradient",
    "hcmc": "methods.hcmc",
    "hcmc_batch": "methods.hcmc_batch",
    "intervals": "gradients.uncertainty",
    "joint_angles": "segments",
    "live_page": "viewing.live",
    "open_saved": "saved",
    "replay": "verify",
    "replay_windows": "verify",
    "segment_angles": "segments",
    "sensitivity_table": "gradients.table",
    "static_optimization": "methods.static_optimization",
    "view": "viewing.window",
    "view_in_browser": "viewing.browser",
    "write_image": "viewing.video",
    "write_report": "report.page",
    "write_video": "viewing.video",
}

__all__ = [
    "Calibration",
    "Detail",
    "DivergedError",
    "Emg",
    "EmgComparison",
    "EmgTargets",
    "ExternalLoads",
    "Frames",
    "Gradient",
    "GradientBatch",
    "HillPlant",
    "Imposed",
    "JointMoments",
    "MjhcmcError",
    "MjhcmcWarning",
    "ModelError",
    "Motion",
    "MotionError",
    "MujocoPlant",
    "MuscleModel",
    "OutputError",
    "Saved",
    "SettingsError",
    "SimulationError",
    "SimulationStatus",
    "Solution",
    "SolutionBatch",
    "SolveInterrupted",
    "Verdict",
    "WindowStatus",
    "calibrate",
    "calibrate_moments",
    "check",
    "cmc",
    "compare_emg",
    "export_opensim",
    "fit_harmonics",
    "gradient",
    "gradient_batch",
    "hcmc",
    "hcmc_batch",
    "intervals",
    "joint_angles",
    "live_page",
    "open_saved",
    "replay",
    "replay_windows",
    "segment_angles",
    "sensitivity_table",
    "static_optimization",
    "view",
    "view_in_browser",
    "write_image",
    "write_report",
    "write_video",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'mjhcmc' has no attribute {name!r}; it offers {', '.join(__all__)}")
    value = getattr(import_module(f"mjhcmc.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

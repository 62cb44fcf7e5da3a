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
    from mjhcmc.errors import (
        MjhcmcError,
        MjhcmcWarning,
        ModelError,
        MotionError,
        OutputError,
        SettingsError,
        SimulationError,
    )
    from mjhcmc.methods.hcmc import hcmc
    from mjhcmc.methods.windows import SolveInterrupted
    from mjhcmc.model import MuscleModel
    from mjhcmc.motion import Motion
    from mjhcmc.plant import MujocoPlant
    from mjhcmc.solution import Solution, WindowStatus
    from mjhcmc.verify import Verdict, replay, replay_windows

__version__ = "0.1.0"

# Where each public name lives. Imported on first use: MuJoCo and Numba take a second, `mjhcmc --help` should not.
_HOME = {
    "MjhcmcError": "errors",
    "MjhcmcWarning": "errors",
    "ModelError": "errors",
    "Motion": "motion",
    "MotionError": "errors",
    "MujocoPlant": "plant",
    "MuscleModel": "model",
    "OutputError": "errors",
    "SettingsError": "errors",
    "SimulationError": "errors",
    "Solution": "solution",
    "SolveInterrupted": "methods.windows",
    "Verdict": "verify",
    "WindowStatus": "solution",
    "hcmc": "methods.hcmc",
    "replay": "verify",
    "replay_windows": "verify",
}

__all__ = [
    "MjhcmcError",
    "MjhcmcWarning",
    "ModelError",
    "Motion",
    "MotionError",
    "MujocoPlant",
    "MuscleModel",
    "OutputError",
    "SettingsError",
    "SimulationError",
    "Solution",
    "SolveInterrupted",
    "Verdict",
    "WindowStatus",
    "hcmc",
    "replay",
    "replay_windows",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'mjhcmc' has no attribute {name!r}; it offers {', '.join(__all__)}")
    value = getattr(import_module(f"mjhcmc.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

"""Hill-type muscle in NumPy alone: imports neither mujoco nor the rest of the package."""

from mjhcmc.hill.millard import (
    ActiveForceLength,
    BezierCurve,
    Corner,
    ForceVelocity,
    PassiveForceLength,
    active_force_length,
    force_velocity,
    passive_force_length,
)

__all__ = [
    "ActiveForceLength",
    "BezierCurve",
    "Corner",
    "ForceVelocity",
    "PassiveForceLength",
    "active_force_length",
    "force_velocity",
    "passive_force_length",
]

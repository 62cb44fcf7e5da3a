"""Hill-type muscle in NumPy alone: imports neither mujoco nor the rest of the package.

Four sets of curves (:func:`thelen2003`, :func:`millard2012`, :func:`degroote_fregly2016`, :func:`mujoco_curves`) behind
one shape, :class:`Curves`; with :class:`MuscleParameters` they make a :class:`HillModel`, which :func:`rigid_tendon`,
:func:`static_equilibrium`, :func:`dynamic_equilibrium` and :func:`fiber_velocity` solve for arrays (..., muscles).
"""

from mjhcmc.hill.activation import (
    DEGROOTE_FREGLY_ACTIVATION,
    MILLARD_ACTIVATION,
    MUJOCO_ACTIVATION,
    THELEN_ACTIVATION,
    FirstOrderActivation,
    SmoothActivation,
)
from mjhcmc.hill.bezier import BezierCurve, Corner
from mjhcmc.hill.curves import Curve, Curves, ForceVelocityCurve, InvertibleCurve
from mjhcmc.hill.degroote_fregly import (
    DeGrooteFreglyActive,
    DeGrooteFreglyForceVelocity,
    DeGrooteFreglyPassive,
    DeGrooteFreglyTendon,
    degroote_fregly2016,
)
from mjhcmc.hill.dynamics import fiber_dynamics, fiber_velocity
from mjhcmc.hill.energy import MusclePower, MuscleStiffness, muscle_power, muscle_stiffness
from mjhcmc.hill.equilibrium import dynamic_equilibrium, static_equilibrium
from mjhcmc.hill.errors import HillError
from mjhcmc.hill.millard import (
    ActiveForceLength,
    BezierForceVelocity,
    ForceVelocity,
    PassiveForceLength,
    TendonForceLength,
    active_force_length,
    force_velocity,
    millard2012,
    passive_force_length,
    tendon_force_length,
)
from mjhcmc.hill.mujoco_curves import MujocoActive, MujocoForceVelocity, MujocoPassive, mujoco_curves
from mjhcmc.hill.mujoco_muscle import mujoco_activation_rate, mujoco_bias, mujoco_gain
from mjhcmc.hill.parameters import HillModel, MuscleParameters
from mjhcmc.hill.pennation import fiber_length_along, pennation_angle
from mjhcmc.hill.rigid import rigid_tendon
from mjhcmc.hill.states import MuscleState
from mjhcmc.hill.thelen import ThelenActive, ThelenForceVelocity, ThelenPassive, ThelenTendon, thelen2003

__all__ = [
    "DEGROOTE_FREGLY_ACTIVATION",
    "MILLARD_ACTIVATION",
    "MUJOCO_ACTIVATION",
    "THELEN_ACTIVATION",
    "ActiveForceLength",
    "BezierCurve",
    "BezierForceVelocity",
    "Corner",
    "Curve",
    "Curves",
    "DeGrooteFreglyActive",
    "DeGrooteFreglyForceVelocity",
    "DeGrooteFreglyPassive",
    "DeGrooteFreglyTendon",
    "FirstOrderActivation",
    "ForceVelocity",
    "ForceVelocityCurve",
    "HillError",
    "HillModel",
    "InvertibleCurve",
    "MujocoActive",
    "MujocoForceVelocity",
    "MujocoPassive",
    "MuscleParameters",
    "MusclePower",
    "MuscleState",
    "MuscleStiffness",
    "PassiveForceLength",
    "SmoothActivation",
    "TendonForceLength",
    "ThelenActive",
    "ThelenForceVelocity",
    "ThelenPassive",
    "ThelenTendon",
    "active_force_length",
    "degroote_fregly2016",
    "dynamic_equilibrium",
    "fiber_dynamics",
    "fiber_length_along",
    "fiber_velocity",
    "force_velocity",
    "millard2012",
    "mujoco_activation_rate",
    "mujoco_bias",
    "mujoco_curves",
    "mujoco_gain",
    "muscle_power",
    "muscle_stiffness",
    "passive_force_length",
    "pennation_angle",
    "rigid_tendon",
    "static_equilibrium",
    "tendon_force_length",
    "thelen2003",
]

"""Which muscles drive a model, by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mjhcmc.errors import SettingsError
from mjhcmc.plant import physics_steps

if TYPE_CHECKING:
    from mjhcmc.hosted.plant import HillPlant
    from mjhcmc.model import MuscleModel

MUSCLES = ("mujoco", "rigid", "compliant")
"""MuJoCo's own; Hill muscles with rigid tendons; with compliant tendons."""

HILL_CURVES = ("millard", "thelen", "degroote-fregly")


def check_muscle(muscle: str, curves: str = "millard") -> None:
    """Refuse names that are not known.

    Raises:
        SettingsError: naming them and those that are.
    """
    if muscle not in MUSCLES:
        raise SettingsError(f"muscle {muscle!r} is not known: choose one of {', '.join(MUSCLES)}")
    if curves not in HILL_CURVES:
        raise SettingsError(f"curves {curves!r} are not known: choose one of {', '.join(HILL_CURVES)}")
    if muscle == "mujoco" and curves != HILL_CURVES[0]:
        raise SettingsError(f"curves {curves!r} are of Hill muscles: choose muscle 'rigid' or 'compliant' with them")


def plant_for(
    model: MuscleModel, muscle: str, dt: float, physics_dt: float, curves: str = "millard"
) -> HillPlant | None:
    """What a method takes as ``plant``: None for MuJoCo's own muscles.

    Args:
        model: the model.
        muscle: one of `MUSCLES`.
        dt: s, control window.
        physics_dt: s, largest physics step; rounded down to a divisor of dt.
        curves: of Hill muscles, one of `HILL_CURVES`.

    Raises:
        SettingsError: unknown names; a dt or physics_dt that is not positive.
        ModelError: muscles that no Hill model stands for.
    """
    check_muscle(muscle, curves)
    if muscle == "mujoco":
        return None
    for name, value in (("dt", dt), ("physics_dt", physics_dt)):
        if not 0 < value < float("inf"):
            raise SettingsError(f"{name} must be a positive number of seconds; got {value}")
    from mjhcmc.hosted.plant import HillPlant

    return HillPlant(model, curves, muscle, dt / physics_steps(dt, physics_dt))

"""What can be chosen of the task: times, where an episode begins, what is observed, rewarded and lost."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mjhcmc.checks import is_number
from mjhcmc.errors import SettingsError
from mjhcmc.integrators import scheme_of

STARTS = ("beginning", "random")
"""Where an episode may begin."""

_DIVIDES = 1e-6  # of a physics step


@dataclass(frozen=True)
class Settings:
    """Choices of the task; see `task` for how they are used.

    Attributes:
        dt: s, control window: excitation is constant over it.
        physics_dt: s, physics step; it divides dt. None: 1 ms, or the part of it that is stable where all muscles are
            fully active; the task's settings hold the one found.
        integrator: of the plant, see `mjhcmc.integrators`.
        start: ``"beginning"`` of the motion, or at a ``"random"`` node of it.
        noise: rad (slides: m), standard deviation of tracked positions at the start about the motion. No position is
            moved by more than half its bound, whatever the noise, nor out of its joint's range.
        preview: windows ahead for which the desired motion is observed, beside now.
        muscle_paths: whether musculotendon lengths and velocities are observed.
        error_scale: rad, tracking error that costs a hinge 63 % of its reward.
        error_scale_slide: m, the same of slides.
        effort_weight: share of the reward that is for little effort, within 0..1.
        bound: rad, tracking error of a hinge beyond which an episode is lost; infinite: it never is.
        bound_slide: m, the same of slides.
    """

    dt: float = 0.01
    physics_dt: float | None = None
    integrator: str = "rk4"
    start: str = "beginning"
    noise: float = 0.0
    preview: int = 5
    muscle_paths: bool = False
    error_scale: float = math.radians(5)
    error_scale_slide: float = 0.02
    effort_weight: float = 0.1
    bound: float = math.radians(30)
    bound_slide: float = 0.1

    def __post_init__(self) -> None:
        """Check the values."""
        for name in ("dt", "physics_dt", "error_scale", "error_scale_slide", "bound", "bound_slide"):
            value = getattr(self, name)
            if name == "physics_dt" and value is None:
                continue
            endless = name.startswith("bound")
            if not (is_number(value) and value > 0 and (value < math.inf or (endless and value == math.inf))):
                raise SettingsError(f"{name} must be a positive number; got {value!r}")
        if not (is_number(self.noise) and 0 <= self.noise < math.inf):
            raise SettingsError(f"noise must be 0 or positive; got {self.noise!r}")
        if not (is_number(self.effort_weight) and 0 <= self.effort_weight <= 1):
            raise SettingsError(f"effort_weight must lie within 0..1; got {self.effort_weight!r}")
        if not isinstance(self.preview, (int, np.integer)) or isinstance(self.preview, bool) or self.preview < 0:
            raise SettingsError(f"preview must be a number of windows, 0 or more; got {self.preview!r}")
        if not isinstance(self.muscle_paths, (bool, np.bool_)):
            raise SettingsError(f"muscle_paths must be True or False; got {self.muscle_paths!r}")
        if self.start not in STARTS:
            raise SettingsError(f"start must be one of {', '.join(STARTS)}; got {self.start!r}")
        scheme_of(self.integrator)
        if self.physics_dt is None:
            return
        steps = self.dt / self.physics_dt
        if abs(steps - round(steps)) > _DIVIDES * steps or round(steps) < 1:
            n = max(1, math.ceil(steps))
            raise SettingsError(
                f"dt {self.dt:g} s is no multiple of physics_dt {self.physics_dt:g} s: choose physics_dt "
                f"{self.dt / n:.6g}, or another dt"
            )

    @classmethod
    def of(cls, choices: dict[str, Any]) -> Settings:
        """Settings from choices by name.

        Raises:
            SettingsError: a name that is no setting, or a value outside its valid ones.
        """
        known = [item.name for item in fields(cls)]
        for name in choices:
            if name not in known:
                raise SettingsError(f"{name!r} is no setting of the task: choose among {', '.join(known)}")
        return cls(**choices)

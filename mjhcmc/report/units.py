"""Values as a person reads them: degrees and millimetres, newton metres and newtons, three digits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mjhcmc.plotting.panels import readable
from mjhcmc.solution import Solution
from mjhcmc.verify import MAX_TRACKING_RMS, MAX_TRACKING_RMS_SLIDE

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def short(value: float) -> str:
    """Three digits: ``0.0123``, ``1234``, ``1.23×10⁻⁵``."""
    value = float(value)
    if not math.isfinite(value):
        return "not known"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if -3 <= exponent < 4:
        text = f"{value:.0f}" if exponent >= 3 else f"{value:.3g}"
    else:
        text = f"{value / 10.0**exponent:.2f}×10{str(exponent).translate(_SUPERSCRIPT)}"
    return text.replace("-", "−")


def percent(share: float) -> str:
    """A share as percent; one too small to matter only as such."""
    value = 100 * float(share)
    return f"{short(value) if value >= 0.01 or value == 0 else '< 0.01'} %"


def way(solution: Solution, j: int) -> tuple[str, float]:
    """Unit of a degree of freedom's position on the screen, and what SI values are multiplied by for it."""
    return ("deg", 180 / np.pi) if solution.dof_is_rotation[j] else ("mm", 1e3)


def load_unit(solution: Solution, j: int) -> str:
    """Unit of what acts on a degree of freedom."""
    return "N m" if solution.dof_is_rotation[j] else "N"


def length(solution: Solution, j: int, value: float) -> str:
    """A position or error, with its unit."""
    unit, factor = way(solution, j)
    return f"{short(factor * float(value))} {unit}"


def load(solution: Solution, j: int, value: float) -> str:
    """A moment or force, with its unit."""
    return f"{short(value)} {load_unit(solution, j)}"


def dof_name(solution: Solution, j: int) -> str:
    """The name of a degree of freedom as a person writes it."""
    return readable(solution.dof_names[j])


def limits(solution: Solution) -> NDArray[np.float64]:
    """(nv,) rad or m, what the RMS tracking error may be."""
    return np.where(solution.dof_is_rotation, MAX_TRACKING_RMS, MAX_TRACKING_RMS_SLIDE)


def with_role(solution: Solution, *roles: str) -> list[int]:
    """Degrees of freedom of these roles."""
    return [j for j, role in enumerate(solution.roles) if role in roles]

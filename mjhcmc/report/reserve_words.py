"""What reserves gave, what nothing gave, and what kept prescribed joints on the motion, in words."""

from __future__ import annotations

import numpy as np

from mjhcmc.report.joints import RESIDUALS, unmet_moment
from mjhcmc.report.markup import Html, element, joined
from mjhcmc.report.units import dof_name, load, percent
from mjhcmc.solution import Solution, moment_scale


def allows_reserves(solution: Solution) -> bool:
    """Whether the solve could use reserves."""
    return bool(solution.settings.get("reserves", True)) or bool(solution.reserve.any())


def largest_unmet(solution: Solution) -> str:
    """What nothing gave: the largest of it; empty where everything was given."""
    unmet = np.abs(unmet_moment(solution))
    unmet[:, solution.is_root] = 0.0
    if not unmet.any():
        return ""
    share = unmet.max(axis=0) / moment_scale(solution.net_joint_moment)
    j = int(np.argmax(share))
    k = int(np.argmax(unmet[:, j]))
    return (
        f"up to {load(solution, j, unmet[k, j])} were unmet ({dof_name(solution, j)}, at {solution.time[k]:.3f} s; "
        f"{percent(share[j])} of its peak moment)"
    )


def largest_reserve(solution: Solution) -> str:
    """The largest reserve and what was missing beside it; what was missing, where none was allowed."""
    share = np.array(solution.verdict.peak_reserve_share)
    reserve, unmet = np.abs(solution.reserve), largest_unmet(solution)
    if not allows_reserves(solution):
        return f"no reserves were allowed; {unmet or 'the muscles gave every moment by themselves'}"
    if not share.size or not share.any():
        return f"none; {unmet}" if unmet else "none: the muscles gave every moment by themselves"
    j = int(np.argmax(share))
    k = int(np.argmax(reserve[:, j]))
    return (
        f"{dof_name(solution, j)}: {load(solution, j, reserve[k, j])} at {solution.time[k]:.3f} s, {percent(share[j])} "
        f"of its peak moment{'; beside it ' * bool(unmet)}{unmet}"
    )


def residual_words(solution: Solution) -> Html:
    """The largest residual among forces and among moments, and where they are drawn."""
    peak, words = np.abs(solution.residual).max(axis=0), []
    for rotation in (False, True):
        alike = np.flatnonzero(solution.dof_is_rotation == rotation)
        if alike.size and peak[alike].any():
            j = int(alike[np.argmax(peak[alike])])
            k = int(np.argmax(np.abs(solution.residual[:, j])))
            rms = float(np.sqrt(np.mean(solution.residual[:, j] ** 2)))
            words.append(
                f"{dof_name(solution, j)}: up to {load(solution, j, peak[j])}, at {solution.time[k]:.3f} s (RMS "
                f"{load(solution, j, rms)})"
            )
    text = f"{'; '.join(words)}. They keep joints on the motion that are not left to muscles alone: "
    return joined((text, element("a", "what they mean", href=f"#{RESIDUALS}"), "."), "")

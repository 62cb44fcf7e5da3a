"""A motion on a model: what equality constraints tie follows, and a path for what is prescribed."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError
from mjhcmc.motion import Motion
from mjhcmc.quaternions import turning
from mjhcmc.surroundings import Path, coordinates_of

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel

Array = NDArray[np.float64]

_VIOLATED = 0.02  # rad (1.1 deg) or m (2 cm)... of a coordinate that the motion names and an equality ties
_STILL = 1e-9  # a coordinate that never leaves the reference pose was not measured


def fit_to_model(motion: Motion, model: MuscleModel) -> Motion:
    """The motion with quaternions known, and with dependent coordinates where equality constraints put them.

    Args:
        motion: of the model's coordinates.
        model: the model.

    Raises:
        MotionError: a dependent coordinate that the motion moves is elsewhere, or the equalities cannot be met.
    """
    motion = motion.on(model, model.quaternions)
    if model.coupling is None:
        return motion
    tied = coordinates_of(model.mj_model, model.roles.dependent)
    try:
        rows = model.coupling.project(motion.qpos)
    except MotionError as error:
        raise MotionError(f"motion {motion.name!r}: {error}") from None
    start = np.stack([model.mj_model.qpos0, model.qpos_reference])[:, None]
    silent = (np.abs(motion.qpos - start).max(axis=1) <= _STILL).any(axis=0)
    named = tied[~silent[tied]]
    gap = np.abs(rows - motion.qpos)[:, named]
    if gap.size and gap.max() > _VIOLATED:
        i, j = np.unravel_index(int(np.argmax(gap)), gap.shape)
        at = int(named[j])
        raise MotionError(
            f"motion {motion.name!r}: {model.joint_names[at]} is at {motion.qpos[i, at]:.6g} at {motion.time[i]:.6g} "
            f"s, where an equality constraint of model {model.name!r} puts it at {rows[i, at]:.6g}: "
            f"{_instead(model, at, rows[i])}, or correct the motion"
        )
    return replace(motion, qpos=rows)


def _instead(model: MuscleModel, at: int, position: Array) -> str:
    """What to do in place of moving coordinate ``at``, which equalities tie: whom it follows at a position."""
    name = model.joint_names[at]
    leads: list[str] = []
    if model.coupling is not None:
        m = model.mj_model
        joint = int(m.jnt_qposadr.searchsorted(at, "right")) - 1
        end = int(m.jnt_dofadr[joint + 1]) if joint + 1 < m.njnt else m.nv
        share = np.abs(model.coupling.tangent(position)[int(m.jnt_dofadr[joint]) : end]).max(axis=0)
        leads = [model.dof_names[i] for i in np.flatnonzero(share > _STILL)]
    if not leads:
        return f"leave {name!r} out (it stays there)"
    return f"leave it out and move {' and '.join(map(repr, leads))} instead, which {name!r} follows"


def path_of(motion: Motion) -> Path:
    """The motion as a quick function of time; after its end it goes on with its last acceleration."""
    from scipy.interpolate import PPoly

    spline = motion.spline
    knots = np.unique(spline.t)
    # Taylor's coefficients at the knots, the highest first
    taylor = [spline(knots[:-1], m) / math.factorial(m) for m in range(spline.k, -1, -1)]
    whole = PPoly(np.array(taylor), knots)
    parts = [whole.derivative(k).c if k else whole.c for k in range(3)]
    padded = [np.concatenate([np.zeros((len(parts[0]) - len(c), *c.shape[1:])), c]) for c in parts]
    together = PPoly(np.concatenate(padded, axis=2), knots)
    n, starts, end = motion.qpos.shape[1], motion.quaternions, motion.end

    def path(times: Array) -> tuple[Array, Array, Array]:
        values = together(np.minimum(times, end))
        q, v, a = values[:, :n], values[:, n : 2 * n], values[:, 2 * n :]
        beyond = np.maximum(times - end, 0.0)
        if beyond.any():
            late = beyond[:, None]
            q, v = q + late * v + late**2 / 2 * a, v + late * a
        return turning(q, v, a, starts) if starts else (q, v, a)

    return path

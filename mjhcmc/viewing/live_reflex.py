"""The stretch reflex of the live page: what it adds to the excitation of any model's muscles along a movement.

The law is the ``"velocity"`` one of `mjhcmc.patients.reflex`; where the fibers go is known from the movement that is
meant, so that one pass of HCMC suffices (as in `mjhcmc.patients.movement`, whose second pass is for spill-over).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.checks import is_number
from mjhcmc.errors import SettingsError
from mjhcmc.imposed import Imposed
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.patients.bench import fibers_of
from mjhcmc.patients.reflex import ReflexLaw, reflex_along

Array = NDArray[np.float64]

DELAY = 0.035
"""s, from stretch to excitation: the mean of the virtual patients (see `mjhcmc.patients.distributions`)."""

LARGEST_GAIN, LARGEST_THRESHOLD = 0.5, 2.0
"""s (excitation per lopt/s), and lopt/s, of the page's sliders; virtual patients have up to .5 and 1.5."""

_NEVER = 1e6  # lopt/s, threshold of muscles without a reflex


@dataclass(frozen=True)
class Reflex:
    """A stretch reflex, the same in each muscle that has one: u = clip(gain max(0, v(t - delay) - threshold), 0, 1).

    Attributes:
        gain: s, excitation per optimal fiber length a second; 0: none, as in healthy people at these speeds.
        threshold: optimal fiber lengths a second, of lengthening.
        muscles: names of the muscles that have it; none named: all.
        delay: s.
    """

    gain: float = 0.0
    threshold: float = 0.1
    muscles: tuple[str, ...] = ()
    delay: float = DELAY

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            SettingsError: a number that is negative or not finite.
        """
        for name in ("gain", "threshold", "delay"):
            value = getattr(self, name)
            if not (is_number(value) and math.isfinite(value) and value >= 0):
                raise SettingsError(f"reflex {name} is {value!r}: give 0 or more")


def has_fibers(model: MuscleModel) -> bool:
    """Whether the fibers of all its muscles are known, as they are of MuJoCo's muscles, so that a reflex can be."""
    return bool(np.isfinite(model.optimal_fiber_length).all())


def fiber_velocity_along(model: MuscleModel, motion: Motion, time: Array) -> Array:
    """(n, n_muscle) optimal fiber lengths a second, lengthening positive, along a motion at times (n,) s."""
    at, m = motion.sample(np.minimum(time, motion.end)), model.mj_model
    data, rows = mujoco.MjData(m), m.actuator_outadr[model.muscle_ids]
    path = np.empty((len(time), model.n_muscle, 2))
    for k, (q, v) in enumerate(zip(at.qpos, at.qvel, strict=True)):
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_fwdPosition(m, data)
        mujoco.mj_fwdVelocity(m, data)
        path[k, :, 0], path[k, :, 1] = data.actuator_length[rows], data.actuator_velocity[rows]
    ids, still = np.zeros(len(time), dtype=np.intp), np.zeros((len(time), model.n_muscle))
    return fibers_of([model], [])(ids, still, still[:, :0], path)[1]


def reflex_of(model: MuscleModel, motion: Motion, dt: float, reflex: Reflex) -> Imposed:
    """What a reflex adds along a motion.

    Args:
        model: with MuJoCo's muscles, see `has_fibers`.
        motion: what is meant.
        dt: s, control window; the reflex is sampled once a window, and holds for the middle of the next.
        reflex: the reflex.

    Raises:
        SettingsError: muscles that the model does not have, or whose fibers are not known.
    """
    unknown = [name for name in reflex.muscles if name not in model.muscle_names]
    if unknown:
        raise SettingsError(
            f"reflex: model {model.name!r} has no muscle {', '.join(unknown)}: it has {', '.join(model.muscle_names)}"
        )
    if not has_fibers(model):
        raise SettingsError(f"reflex: model {model.name!r} has muscles without fibers: use one with MuJoCo's muscles")
    time = np.asarray(motion.start + dt * np.arange(int(motion.duration / dt + 1e-6) + 1), dtype=np.float64)
    has = np.array([not reflex.muscles or name in reflex.muscles for name in model.muscle_names])
    law = ReflexLaw(
        "velocity",
        np.where(has, reflex.gain, 0.0)[None],
        np.where(has, reflex.threshold, _NEVER)[None],
        np.array([max(reflex.delay - dt / 2, 0.0)]),  # as in patients.movement: in the middle of the period
        dt,
    )
    excitation = np.asarray(reflex_along(law, time, fiber_velocity_along(model, motion, time)))
    stretched = time.copy()
    stretched[-1] = max(motion.end, time[-1])  # a last window that is left out may lie beyond
    return Imposed(stretched, excitation)

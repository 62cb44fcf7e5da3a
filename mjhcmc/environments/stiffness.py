"""The physics step of a task: a policy may ask for all muscles at once, and active muscles damp most.

A method looks at the damping of the activations that it chooses, window by window. What a policy will choose is not
known, so the step is judged by full activation, at rest: there the slope of force over velocity is steepest.
"""

from __future__ import annotations

import math
import warnings

import numpy as np

from mjhcmc import dynamics
from mjhcmc.errors import MjhcmcWarning
from mjhcmc.methods.stability import decay_rate, explicit_damping
from mjhcmc.methods.windows import Windows
from mjhcmc.plant import State

USUAL_STEP = 1e-3
"""s"""

_POSES = 6  # along the motion
_MARGIN = 0.9  # of the stable step: between the poses it may be less


def fastest_rate(windows: Windows) -> tuple[float, float]:
    """1/s, the fastest decay of the tracked velocities with all muscles fully active, and the time (s) of that pose."""
    plant, model, reference = windows.plant, windows.model, windows.reference
    still, full = np.zeros(model.nv), np.ones(model.n_muscle)
    worst, at = 0.0, float(reference.time[0])
    for k in range(0, len(reference.time), max(1, len(reference.time) // _POSES)):
        plant.set_state(State(float(reference.time[k]), reference.qpos[k], still, full, still))
        plant.forward()
        M, D = dynamics.mass_matrix(plant), explicit_damping(windows)
        if not model.roles.all_tracked:
            W = windows.seen_from_tracked(reference.qpos[k], M)
            M, D = W.T @ M @ W, W.T @ D @ W
        rate = decay_rate(M, D)
        if rate > worst:
            worst, at = rate, float(reference.time[k])
    return worst, at


def with_stable_step(windows: Windows, *, given: bool) -> Windows:
    """The windows at a physics step that is stable with all muscles fully active.

    Args:
        windows: of the task.
        given: whether the user chose the step. Then it stays, and an `MjhcmcWarning` names one that is stable.
    """
    rate, time = fastest_rate(windows)
    limit, step = windows.scheme.limit, windows.physics_dt
    if rate * step <= (limit if given else _MARGIN * limit):
        return windows
    if not given:
        return windows.finer(math.ceil(step * rate / (_MARGIN * limit)))
    stable = windows.dt / math.ceil(windows.dt * rate / (_MARGIN * limit))
    warnings.warn(
        f"model {windows.model.name!r}: physics_dt {step:g} s is unstable where all muscles are fully active "
        f"({rate:.0f} /s at {time:.3g} s), which a policy may ask for: use physics_dt {stable:.6g}, or leave it out",
        MjhcmcWarning,
        stacklevel=3,
    )
    return windows

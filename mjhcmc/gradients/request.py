"""What a gradient is asked for: checked before work begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.beside import FEW
from mjhcmc.errors import SettingsError
from mjhcmc.gradients.along import Wanted
from mjhcmc.gradients.looks import STEP, moved
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.muscle_parameters import muscle_parameters

Array = NDArray[np.float64]

COSTS = ("effort", "cubic")
"""Costs that are differentiated; the others weigh muscles by their forces."""

_NOT_DIFFERENTIATED = ("actuator_dynprm", "actuator_ctrlrange")


def check_offered(model: MuscleModel, cost: str) -> None:
    """Refuse what has no gradient.

    Raises:
        SettingsError: names why.
        ModelError: muscles that are not MuJoCo's.
    """
    if not isinstance(model, MuscleModel):
        raise SettingsError(f"a gradient takes a MuscleModel; got {type(model).__name__}: use MuscleModel.load")
    if cost not in COSTS:
        raise SettingsError(f"a gradient with cost {cost!r} is not offered: choose from {', '.join(COSTS)}")
    m, why = model.mj_model, ""
    if model.nv > FEW:
        why = f"it has {model.nv} degrees of freedom, a gradient is offered up to {FEW}"
    elif not model.coordinates.flat:
        why = "it has ball or free joints"
    elif not model.roles.all_tracked or model.coupling is not None:
        why = "some of its degrees of freedom are not tracked"
    elif np.isfinite(model.force_limit).any():
        why = "its muscles have a forcerange"
    elif m.nplugin or m.nflex:
        why = "it has plugins or flexes"
    if why:
        raise SettingsError(f"model {model.name!r} has no gradient here: {why}; use differences of hcmc")
    muscle_parameters(model)


def model_direction(model: MuscleModel, name: str, given: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """A change of fields of ``MjModel``, checked."""
    if not isinstance(given, Mapping) or not given:
        raise SettingsError(f"model direction {name!r} must map fields of MjModel to changes, such as 'body_mass'")
    found: dict[str, Array] = {}
    for key, change in given.items():
        own = getattr(model.mj_model, str(key), None)
        if not (isinstance(own, np.ndarray) and own.dtype == np.float64) or key in _NOT_DIFFERENTIATED:
            raise SettingsError(
                f"model direction {name!r}: the model has no field {key!r} to differentiate by: name one of MjModel's "
                "real fields, such as 'body_mass' (times of activation are parameters of their own)"
            )
        array = _numbers(change)
        if array is None or array.shape != own.shape or not np.isfinite(array).all():
            shape = "no numbers" if array is None else f"shape {array.shape}"
            raise SettingsError(f"model direction {name!r}: {key} has {shape}: give {own.shape} finite numbers")
        found[key] = array
    changed = moved(model, found, STEP)
    for key, array in found.items():
        if not np.array_equal(getattr(changed, key), getattr(model.mj_model, key) + STEP * array):
            raise SettingsError(
                f"model direction {name!r}: {key} follows from other fields of MjModel: give those, such as 'body_mass'"
            )
    muscle_parameters(replace(model, mj_model=changed))
    return found


def motion_direction(motion: Motion, name: str, given: ArrayLike) -> Array:
    """A change (T, nq) of a motion's samples, checked."""
    array = _numbers(given)
    if array is None:
        raise SettingsError(f"motion direction {name!r} holds no numbers: give {motion.qpos.shape} finite ones")
    if array.shape != motion.qpos.shape or not np.isfinite(array).all():
        raise SettingsError(
            f"motion direction {name!r} has shape {array.shape}: give {motion.qpos.shape} finite numbers, the motion's "
            "own samples"
        )
    return array


def _numbers(given: object) -> Array | None:
    """An array of numbers, or None."""
    try:
        return np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        return None


def check_directions(name: str, given: object) -> None:
    """Refuse what is no mapping of names to directions."""
    if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
        raise SettingsError(f"{name} must map names to changes; got {type(given).__name__}")


def check_threads(threads: object) -> None:
    """Refuse what is no number of threads."""
    if not isinstance(threads, (int, np.integer)) or isinstance(threads, bool) or threads < 1:
        raise SettingsError(f"threads must be a whole number of at least 1; got {threads!r}")


def names_of(
    model: MuscleModel, wanted: Wanted, models: Sequence[str], motions: Sequence[str]
) -> tuple[tuple[str, ...], Array]:
    """Names and values (p,) of the parameters, as of `Gradient`."""
    now = muscle_parameters(model)
    names = [f"{kind}/{muscle}" for kind in wanted.kinds for muscle in model.muscle_names]
    whole = [*names, *models, *motions]
    twice = {name for name in whole if whole.count(name) > 1}
    if twice:
        raise SettingsError(f"parameters and directions share the name {min(twice)!r}: give each its own")
    values = np.concatenate([*(now[kind] for kind in wanted.kinds), np.full(len(models) + len(motions), np.nan)])
    return (*names, *models, *motions), values

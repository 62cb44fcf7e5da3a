"""The Hill muscles that a model's MuJoCo muscles stand for."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc import hill
from mjhcmc.errors import ModelError, SettingsError

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel

Array = NDArray[np.float64]

CURVES = ("millard", "thelen", "degroote-fregly", "mujoco")
"""Names that `hill_model` takes."""

MAX_FIBER_VELOCITY = 10.0
"""Optimal fiber lengths a second, of the Hill models: MuJoCo's own vmax is fitted to its own curve's shape."""


def hill_model(model: MuscleModel, curves: str = "millard") -> hill.HillModel:
    """The Hill muscles that a model's MuJoCo muscles stand for.

    A MuJoCo muscle has no pennation and no tendon: with the pennation alpha that the model ships (custom text
    ``pennation_angles``, else 0), L0 = (lr1 - lr0)/(r1 - r0) = lopt cos(alpha), force = F0 cos(alpha),
    lslack = lr0 - r0 L0, and damping b of the path = beta F0 cos^2(alpha)/(vmax lopt) (Millard et al. 2013,
    doi:10.1115/1.4023390); a muscle without damping of its own takes the curves'. vmax is `MAX_FIBER_VELOCITY`. With
    ``"mujoco"`` the muscles are MuJoCo's own: no pennation, no compliant tendon, its own vmax and damping.

    Args:
        model: muscles on tendons of their own, gear 1.
        curves: one of `CURVES`.

    Raises:
        SettingsError: unknown curves.
        ModelError: a muscle that is not MuJoCo's, is not on a tendon, or has no tendon slack length.
    """
    if curves not in CURVES:
        raise SettingsError(f"curves {curves!r} are not known: choose one of {', '.join(CURVES)}")
    m, ids, own = model.mj_model, model.muscle_ids, curves == "mujoco"
    for i, name in zip(ids, model.muscle_names, strict=True):
        if (
            m.actuator_gaintype[i] != mujoco.mjtGain.mjGAIN_MUSCLE
            or m.actuator_biastype[i] != mujoco.mjtBias.mjBIAS_MUSCLE
        ):
            raise ModelError(
                f"muscle {name!r}: its gain or bias is not MuJoCo's muscle: it has no Hill model to compare"
            )
        if m.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_TENDON or m.actuator_gear[i, 0] != 1:
            raise ModelError(f"muscle {name!r}: no Hill muscle pulls like it: put it on a tendon, with gear 1")
    optimal, force = model.optimal_fiber_length, model.max_isometric_force
    slack = m.actuator_lengthrange[ids, 0] - m.actuator_gainprm[ids, 0] * optimal
    for name, value in zip(model.muscle_names, slack, strict=True):
        if value < 0:
            raise ModelError(
                f"muscle {name!r}: its lengthrange and range leave a tendon slack length of {value:.4g} m: correct them"
            )
    angle = np.zeros(len(ids)) if own else np.array([model.opensim.pennation.get(n, 0.0) for n in model.muscle_names])
    cos = np.cos(angle)
    speed = m.actuator_gainprm[ids, 6] if own else np.full(len(ids), MAX_FIBER_VELOCITY)
    chosen = _own_curves(model) if own else _CURVES[curves]()
    damping = _damping(model) * speed * (optimal / cos) / (force / cos * cos**2)
    try:
        muscles = hill.MuscleParameters(
            force / cos, optimal / cos, slack, angle, speed,
            damping if own else np.where(damping > 0, damping, chosen.fiber_damping), model.muscle_names,
        )  # fmt: skip
    except hill.HillError as error:
        raise ModelError(f"model {model.name!r}: {error}") from error
    return hill.HillModel(muscles, chosen)


def _damping(model: MuscleModel) -> Array:
    """(n_muscle,) N s/m: linear damping of each muscle's own path."""
    owns = model.own_tendons >= 0
    damping = np.array(model.mj_model.actuator_damping[model.muscle_ids], dtype=np.float64).reshape(len(owns), -1)[:, 0]
    damping[owns] += model.mj_model.tendon_damping.reshape(model.mj_model.ntendon, -1)[model.own_tendons[owns], 0]
    return damping


def mujoco_curve_sets(model: MuscleModel) -> dict[tuple[float, ...], tuple[str, ...]]:
    """Muscles by their MuJoCo curve parameters lmin, lmax, fpmax, fvmax and vmax cos^2(alpha) (lopt/s)."""
    sets: dict[tuple[float, ...], tuple[str, ...]] = {}
    for i, name in zip(model.muscle_ids, model.muscle_names, strict=True):
        p = model.mj_model.actuator_gainprm[i]
        speed = p[6] * np.cos(model.opensim.pennation.get(name, 0.0)) ** 2
        key = tuple(float(f"{value:.3g}") for value in (p[4], p[5], p[7], p[8], speed))
        sets[key] = (*sets.get(key, ()), name)
    return sets


def _own_curves(model: MuscleModel) -> hill.Curves:
    shapes = np.unique(model.mj_model.actuator_gainprm[model.muscle_ids][:, [4, 5, 7, 8]], axis=0)
    if len(shapes) != 1:
        raise ModelError(f"model {model.name!r}: its muscles have {len(shapes)} sets of MuJoCo curves: one is needed")
    lmin, lmax, fpmax, fvmax = shapes[0].tolist()
    return hill.mujoco_curves(lmin, lmax, fpmax, fvmax)


_CURVES: dict[str, Callable[[], hill.Curves]] = {
    "millard": hill.millard2012,
    "thelen": hill.thelen2003,
    "degroote-fregly": hill.degroote_fregly2016,
}

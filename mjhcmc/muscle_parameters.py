"""The parameters of MuJoCo's muscles by the field's names: read, changed, and how muscle force answers to them.

MuJoCo keeps two lengths of the path, ``lengthrange`` lr, and what they are in units of the optimal fiber length,
``range`` r. With L0 the optimal fiber length (along the tendon) and LT the tendon slack length,

    L0 = (lr1 - lr0)/(r1 - r0),   LT = lr0 - r0 L0,   L = (length - LT)/L0,   V = velocity/(L0 vmax)

The lengthrange stays, the range follows. Damping that a muscle's own tendon or actuator hosts is that of its fiber,
proportional to F0/L0 (Millard 2013, doi 10.1115/1.4023390), and goes with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import ModelError, SettingsError
from mjhcmc.hill.mujoco_curves import active_shape, passive_shape, velocity_shape
from mjhcmc.model import MuscleModel
from mjhcmc.variants import variants

Array = NDArray[np.float64]

FORCE, FIBER, SLACK = "max_isometric_force", "optimal_fiber_length", "tendon_slack_length"
RISE, FALL = "activation_time", "deactivation_time"
FORCE_KINDS = (FORCE, FIBER, SLACK)
"""What decides a muscle's force: N, m along the tendon, m."""
TIME_KINDS = (RISE, FALL)
"""What decides how activation follows excitation: s."""
KINDS = (*FORCE_KINDS, *TIME_KINDS)

_LMIN, _LMAX, _VMAX, _FPMAX, _FVMAX = 4, 5, 6, 7, 8  # columns of gainprm


def muscle_parameters(model: MuscleModel) -> dict[str, Array]:
    """The parameters of all muscles, (n_muscle,) each, by `KINDS`.

    Raises:
        ModelError: a muscle whose gain or bias is not MuJoCo's muscle's.
    """
    if not isinstance(model, MuscleModel):
        raise SettingsError(f"muscle parameters are of a MuscleModel; got {type(model).__name__}: use MuscleModel.load")
    _check(model)
    m, i = model.mj_model, model.muscle_ids
    L0 = model.optimal_fiber_length
    rise, fall = m.actuator_dynprm[i, :2].T
    slack = m.actuator_lengthrange[i, 0] - m.actuator_gainprm[i, 0] * L0
    return {FORCE: model.max_isometric_force, FIBER: L0, SLACK: slack, RISE: rise.copy(), FALL: fall.copy()}


def with_muscle_parameters(model: MuscleModel, values: Mapping[str, ArrayLike]) -> MuscleModel:
    """The model with other muscle parameters.

    Args:
        model: the model; it stays as it is.
        values: (n_muscle,) by name of `KINDS`; those left out stay.

    Raises:
        SettingsError: an unknown name, other than n_muscle values, or one that is not positive (a tendon slack length
            may be anything finite: MuJoCo's default range implies negative ones).
        ModelError: a muscle whose gain is not MuJoCo's muscle's, or numbers that make no muscle.
    """
    if not isinstance(model, MuscleModel) or not isinstance(values, Mapping):
        raise SettingsError(
            "muscle parameters of a MuscleModel are changed by a mapping of kinds to values; got "
            f"{type(model).__name__} and {type(values).__name__}"
        )
    rows = {name: _row(model, name, value)[None] for name, value in values.items()}
    if not rows:
        return model
    (found,) = variants(model, parameter_fields(model, rows))
    if isinstance(found, ModelError):
        raise found
    return found


def _row(model: MuscleModel, name: str, value: ArrayLike) -> Array:
    array = _array(name, value)
    if array.shape != (model.n_muscle,):
        raise SettingsError(f"{name} must hold {model.n_muscle} numbers, one a muscle; got shape {array.shape}")
    return array


def parameter_fields(model: MuscleModel, values: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Fields of ``MjModel`` for muscle parameters: what `hcmc_batch` takes as ``parameters``.

    Args:
        model: the model.
        values: (B, n_muscle) by name of `KINDS`: a row a simulation; those left out stay.

    Raises:
        SettingsError: as `with_muscle_parameters`; or different numbers of rows.
        ModelError: a muscle whose gain or bias is not MuJoCo's muscle's.
    """
    now, m, i = muscle_parameters(model), model.mj_model, model.muscle_ids
    rows = {name: _values(model, name, value) for name, value in values.items()}
    counts = {name: len(row) for name, row in rows.items()}
    if len(set(counts.values())) != 1:
        told = ", ".join(f"{name} {count}" for name, count in counts.items()) or "none"
        raise SettingsError(f"muscle parameters have different numbers of rows ({told}): give one row a simulation")
    b = next(iter(counts.values()))
    new = {name: rows.get(name, np.broadcast_to(value, (b, len(value)))) for name, value in now.items()}
    fields = {
        name: np.repeat(getattr(m, name)[None], b, axis=0)
        for name in ("actuator_gainprm", "actuator_biasprm", "actuator_dynprm")
    }
    limits = m.actuator_lengthrange[i]
    for name in ("actuator_gainprm", "actuator_biasprm"):
        fields[name][:, i, :2] = (limits[None] - new[SLACK][:, :, None]) / new[FIBER][:, :, None]
        fields[name][:, i, 2] = new[FORCE]
    fields["actuator_dynprm"][:, i, 0], fields["actuator_dynprm"][:, i, 1] = new[RISE], new[FALL]
    factor = (new[FORCE] / now[FORCE]) * (now[FIBER] / new[FIBER])
    fields |= dict(_damping(model, factor))
    return fields


def _damping(model: MuscleModel, factor: Array) -> Iterator[tuple[str, Array]]:
    """Fields of fiber damping times a factor (b, n_muscle), where the model has any."""
    m, b = model.mj_model, len(factor)
    owns = model.own_tendons >= 0
    for name, at, by in (
        ("tendon_damping", model.own_tendons[owns], factor[:, owns]),
        ("tendon_dampingpoly", model.own_tendons[owns], factor[:, owns]),
        ("actuator_damping", model.muscle_ids, factor),
        ("actuator_dampingpoly", model.muscle_ids, factor),
    ):
        field = getattr(m, name)
        if field.size and field.any():
            values = np.repeat(field[None], b, axis=0)
            values[:, at] *= by if field.ndim == 1 else by[:, :, None]
            yield name, values


def _array(name: str, value: ArrayLike) -> Array:
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise SettingsError(f"{name} must hold numbers; got {value!r:.60}") from None


def _values(model: MuscleModel, name: str, value: ArrayLike) -> Array:
    check_kinds([name])
    array = _array(name, value)
    if array.ndim != 2 or array.shape[1] != model.n_muscle:
        raise SettingsError(f"{name} has shape {array.shape}: give (B, {model.n_muscle}), a row a simulation")
    bad = np.argwhere(~(np.isfinite(array) & ((array > 0) | (name == SLACK))))
    if len(bad):
        b, k = bad[0]
        raise SettingsError(
            f"{name} of muscle {model.muscle_names[k]!r} is {array[b, k]:g}: give a "
            + ("finite number" if name == SLACK else "positive number")
        )
    return array


def check_kinds(kinds: Sequence[str]) -> None:
    """Raise SettingsError unless all are of `KINDS`, once each."""
    for name in kinds:
        if name not in KINDS:
            raise SettingsError(f"muscle parameter {name!r} is not known: choose from {', '.join(KINDS)}")
    if len(set(kinds)) != len(kinds):
        raise SettingsError(f"muscle parameters are named twice in {', '.join(kinds)}: name each once")


def _check(model: MuscleModel) -> None:
    m, i = model.mj_model, model.muscle_ids
    ours = (m.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_MUSCLE) & (
        m.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_MUSCLE
    )
    if not ours.all():
        name = model.muscle_names[int(np.argmin(ours))]
        raise ModelError(
            f"model {model.name!r}: muscle {name!r} has a gain or bias that is not MuJoCo's muscle's: only those have "
            "fibers; write it as a <muscle> actuator"
        )
    if not np.array_equal(m.actuator_gainprm[i, :9], m.actuator_biasprm[i, :9]):
        bad = (m.actuator_gainprm[i, :9] != m.actuator_biasprm[i, :9]).any(axis=1)
        raise ModelError(
            f"model {model.name!r}: muscle {model.muscle_names[int(np.argmax(bad))]!r} has a gainprm and a biasprm of "
            "two different muscles: give both the same"
        )


class MuscleForce(NamedTuple):
    """Force of MuJoCo's muscles as gain a + bias, pulling positive, and how it answers to `FORCE_KINDS`.

    Attributes:
        gain: (..., n_muscle) N.
        bias: (..., n_muscle) N.
        gain_slopes: (3, ..., n_muscle) by F0 (1), L0 (N/m), LT (N/m).
        bias_slopes: (3, ..., n_muscle) likewise.
    """

    gain: Array
    bias: Array
    gain_slopes: Array
    bias_slopes: Array


def muscle_force(model: MuscleModel, length: Array, velocity: Array) -> MuscleForce:
    """See `MuscleForce`.

    Args:
        model: of MuJoCo's muscles.
        length: (..., n_muscle) m, of the actuators.
        velocity: (..., n_muscle) m/s.
    """
    p = model.mj_model.actuator_gainprm[model.muscle_ids].T
    now = muscle_parameters(model)
    F0, L0, LT = now[FORCE], now[FIBER], now[SLACK]
    L, V = (length - LT) / L0, velocity / (L0 * p[_VMAX])
    fl, fl_slope = active_shape(L, p[_LMIN], p[_LMAX])
    fv, fv_slope = velocity_shape(V, p[_FVMAX])
    fp, fp_slope = passive_shape(L, p[_LMAX], p[_FPMAX])
    by_length, by_slack = -L / L0, -1.0 / L0
    gain_slopes = np.stack(
        [fl * fv, F0 * (fl_slope * by_length * fv - fl * fv_slope * V / L0), F0 * fl_slope * by_slack * fv]
    )
    bias_slopes = np.stack([fp, F0 * fp_slope * by_length, F0 * fp_slope * by_slack])
    return MuscleForce(F0 * fl * fv, F0 * fp, gain_slopes, bias_slopes)

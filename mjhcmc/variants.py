"""Models of one structure with numbers of their own: the members of a batch."""

from __future__ import annotations

import copy
import difflib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import ModelError, SettingsError
from mjhcmc.model import MuscleModel, read_model
from mjhcmc.model_problems import find_problems

_SIZES = (
    "nq",
    "nv",
    "nu",
    "na",
    "nbody",
    "njnt",
    "ngeom",
    "nsite",
    "ntendon",
    "nwrap",
    "neq",
    "nactuator",
    "nM",
    "nJmom",
)


_STRUCTURE = (
    "body_parentid", "jnt_type", "jnt_qposadr", "dof_parentid", "dof_jntid", "actuator_dyntype", "actuator_ctrladr",
    "actuator_actadr", "actuator_outadr", "actuator_trntype", "actuator_trnid", "M_rownnz", "M_rowadr", "M_colind",
    "eq_type", "eq_active0",
)  # fmt: skip


def variants(model: MuscleModel, parameters: Mapping[str, ArrayLike]) -> Iterator[MuscleModel | ModelError]:
    """The model with other numbers, once for each row of the parameters.

    Constants that follow from the fields (such as ``dof_invweight0``) follow, by ``mj_setConst``.

    Args:
        model: the model; it stays as it is.
        parameters: by name of an ``MjModel`` field of real numbers, such as ``"body_mass"`` or
            ``"actuator_gainprm"``, its values (B, ...): the field's shape behind a first axis of simulations.

    Yields:
        A model, or why that one's numbers make none: a value that is not finite, or a model that cannot be driven.

    Raises:
        SettingsError: no parameters, an unknown field, values of the wrong shape, or of different numbers of rows.
    """
    if not isinstance(parameters, Mapping):
        raise SettingsError(f"parameters must map names of fields to rows of values; got {type(parameters).__name__}")
    values = {name: _values(model, name, given) for name, given in parameters.items()}
    counts = {name: len(array) for name, array in values.items()}
    if not counts:
        raise SettingsError("parameters are empty: name a field of MjModel, such as 'body_mass'")
    if len(set(counts.values())) > 1:
        told = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise SettingsError(f"parameters have different numbers of rows ({told}): give one row a simulation")
    for i in range(next(iter(counts.values()))):
        try:
            yield _variant(model, {name: array[i] for name, array in values.items()})
        except ModelError as error:
            yield error


def _values(model: MuscleModel, name: str, given: ArrayLike) -> NDArray[np.float64]:
    field = getattr(model.mj_model, name, None) if isinstance(name, str) and not name.startswith("_") else None
    if not (isinstance(field, np.ndarray) and field.dtype == np.float64 and field.size):
        close = difflib.get_close_matches(str(name), _real_fields(model.mj_model), n=3)
        raise SettingsError(
            f"parameters: the model has no field {name!r} of real numbers"
            + (f": did you mean {', '.join(close)}?" if close else ": name one of MjModel's, such as 'body_mass'")
        )
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise SettingsError(f"parameters: {name} must be numbers") from None
    if values.ndim == 0 or values.shape[1:] != field.shape:
        raise SettingsError(
            f"parameters: {name} has shape {values.shape}: give (B, {', '.join(map(str, field.shape))}), the field's "
            "own shape behind one row a simulation"
        )
    return values


def _real_fields(m: Any) -> list[str]:
    arrays = ((name, getattr(m, name, None)) for name in dir(m) if not name.startswith("_"))
    return [
        name for name, value in arrays if isinstance(value, np.ndarray) and value.dtype == np.float64 and value.size
    ]


def _variant(model: MuscleModel, fields: Mapping[str, NDArray[np.float64]]) -> MuscleModel:
    m = copy.copy(model.mj_model)
    for name, value in fields.items():
        bad = np.argwhere(~np.isfinite(value))
        if len(bad):
            at = ", ".join(map(str, bad[0]))
            raise ModelError(f"model {model.name!r}: {name}[{at}] is {value[tuple(bad[0])]}: give finite values")
        getattr(m, name)[:] = value
    data = mujoco.MjData(m)
    mujoco.mj_setConst(m, data)
    for name, value in fields.items():
        if not np.array_equal(getattr(m, name), value):
            raise SettingsError(
                f"parameters: {name} follows from other fields of MjModel: give those, such as 'body_mass'"
            )
    _check_inertia(m, data, model.name)
    problems = find_problems(m, model.name)
    if problems:
        raise ModelError(problems[0].message(model.name))
    return read_model(m, model.name)


def _check_inertia(m: Any, data: Any, name: str) -> None:
    """Refuse a mass matrix, at the reference pose, that is not positive definite."""
    mujoco.mj_forward(m, data)
    M = np.empty((m.nv, m.nv))
    mujoco.mj_fullM(m, data, M)
    if not (np.isfinite(M).all() and np.linalg.eigvalsh(M).min() > 0):
        negative = np.flatnonzero((m.body_mass < 0) | (m.body_inertia < 0).any(axis=1))
        which = f" (body {mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_BODY, int(negative[0]))!r})" if negative.size else ""
        raise ModelError(
            f"model {name!r}: its mass matrix is not positive definite{which}: give positive masses and inertias"
        )


def check_alike(models: Sequence[MuscleModel]) -> None:
    """Check that models can be stepped together: all alike but for numbers.

    Raises:
        SettingsError: names the first that differs from the first model, and in what.
    """
    for i, model in enumerate(models):
        first = models[0]
        if model is first:
            continue
        for what, a, b in (
            ("muscle names", first.muscle_names, model.muscle_names),
            ("dof names", first.dof_names, model.dof_names),
            ("roles", first.roles.of, model.roles.of),
        ):
            if a != b:
                raise SettingsError(
                    f"models[{i}] has the {what} {', '.join(b)}, models[0] has {', '.join(a)}: a "
                    "batch is of models of one structure; solve others in a batch of their own"
                )
        for size in _SIZES:
            a, b = (getattr(m.mj_model, size) for m in (first, model))
            if a != b:
                raise SettingsError(
                    f"models[{i}] has {size} = {b}, models[0] has {a}: a batch is of models of one structure; solve "
                    "others in a batch of their own"
                )
        for name in _STRUCTURE:
            if not np.array_equal(getattr(first.mj_model, name), getattr(model.mj_model, name)):
                raise SettingsError(
                    f"models[{i}] differs from models[0] in {name}: a batch is of models whose bodies, joints and "
                    "actuators come in the same order; solve others in a batch of their own"
                )

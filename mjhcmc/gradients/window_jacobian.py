"""How a control window's end answers to its start, its inputs and the muscles' parameters, without HCMC around it.

From MuJoCo in C, stage by stage (`along`, `tangents`). `mjx_step` finds the same by JAX, so each checks the other.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.gradients.along import Wanted, stages_along
from mjhcmc.gradients.looks import Looker, States
from mjhcmc.gradients.tangents import propagate
from mjhcmc.model import MuscleModel
from mjhcmc.muscle_parameters import FALL, FORCE_KINDS, RISE, check_kinds, parameter_fields

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class WindowJacobian:
    """How B control windows end, and the derivatives; rows are qpos, qvel and activation, in this order.

    Attributes:
        end: (B, 2 nv + n_muscle).
        start: (B, 2 nv + n_muscle, 2 nv + n_muscle) by qpos, qvel and activation at the start.
        inputs: (B, 2 nv + n_muscle, n_muscle + nv + p) by excitation, reserve and parameters, the columns of
            `gradients.tangents.propagate`.
        names: (p,) of the parameters.
    """

    end: Array
    start: Array
    inputs: Array
    names: tuple[str, ...]

    @property
    def parameters(self) -> Array:
        """(B, 2 nv + n_muscle, p) the last columns of ``inputs``."""
        return self.inputs[:, :, self.inputs.shape[2] - len(self.names) :]


def parameter_names(model: MuscleModel, kinds: Sequence[str]) -> tuple[str, ...]:
    """(p,) such as ``"max_isometric_force/soleus"``: those of every muscle, kind by kind."""
    return tuple(f"{kind}/{muscle}" for kind in kinds for muscle in model.muscle_names)


def ends_in_c(
    model: MuscleModel,
    states: States,
    excitation: Array,
    physics_dt: float,
    n_step: int,
    parameters: Mapping[str, Array] | None = None,
) -> Array:
    """(B, 2 nv + n_muscle) where MuJoCo in C ends the windows, stepped by mj_step under RK4.

    Args:
        model: the model.
        states: (B) at the starts, and the reserves.
        excitation: (B, n_muscle).
        physics_dt: s.
        n_step: physics steps of a window.
        parameters: (B, n_muscle) by kind; the model's own where they are left out.

    Raises:
        SimulationError: a limit, contact or other constraint is at work.
    """
    m = copy.copy(model.mj_model)
    m.opt.timestep = physics_dt
    fields = parameter_fields(model, parameters) if parameters else {}
    data, found = mujoco.MjData(m), []
    for b in range(len(excitation)):
        for name, rows in fields.items():
            getattr(m, name)[:] = rows[b]
        mujoco.mj_resetData(m, data)
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = states.qpos[b], states.qvel[b], states.reserve[b]
        data.act[model.act_index], data.ctrl[model.ctrl_index] = states.activation[b], excitation[b]
        for _ in range(n_step):
            mujoco.mj_step(m, data)
            if data.nefc:
                raise SimulationError(
                    f"a limit, contact or equality of model {model.name!r} is at work in window {b}: derivatives of a "
                    "window need a motion away from them"
                )
        found.append(np.concatenate([data.qpos, data.qvel, data.act[model.act_index]]))
    return np.array(found)


def stagewise_jacobian(
    model: MuscleModel,
    states: States,
    excitation: ArrayLike,
    physics_dt: float = 0.001,
    n_step: int = 1,
    parameters: Sequence[str] = FORCE_KINDS,
    threads: int = 1,
) -> WindowJacobian:
    """Differentiate B windows along the stages of MuJoCo's steps in C.

    Args:
        model: one patient's.
        states: (B) at the starts, and the reserves.
        excitation: (B, n_muscle).
        physics_dt: s.
        n_step: physics steps of a window.
        parameters: kinds.
        threads: to look at states on.

    Raises:
        SettingsError: arrays of other shapes, or not finite.
        SimulationError: a limit, contact or other constraint is at work.
        ModelError: muscles that are not MuJoCo's.
    """
    states, u = checked_windows(model, states, excitation)
    check_kinds(parameters)
    wanted = Wanted(tuple(parameters), (), 0)
    b, n, nv, p = len(u), model.n_muscle, model.nv, wanted.count(model)
    end, size = ends_in_c(model, states, u, physics_dt, n_step), 2 * nv + n
    along = stages_along(Looker(model, 4 * b * n_step, threads), states, end[:, :nv], u, physics_dt, n_step, wanted)
    times = np.full((p + size, 2), -1, dtype=np.intp)
    for kind, name in enumerate((RISE, FALL)):
        if name in wanted.kinds:
            times[wanted.kinds.index(name) * n + np.arange(n), kind] = np.arange(n)
    whole = np.zeros((b, size, n + nv + p + size))  # the start last, as parameters that only the start knows
    whole[:, :, n + nv + p :] = np.eye(size)
    Jp = np.concatenate([along.Jp, np.zeros((*along.Jp.shape[:-1], size))], axis=-1)
    for k in range(b):
        dq, dv, da = (np.ascontiguousarray(part) for part in np.split(whole[k], [nv, 2 * nv]))
        slopes = (along.Jq[k], along.Jv[k], along.Ja[k], along.Js[k], Jp[k], along.rates[k])
        propagate(*slopes, times, physics_dt, dq, dv, da)
        whole[k] = np.vstack([dq, dv, da])
    return WindowJacobian(
        end, whole[:, :, n + nv + p :], whole[:, :, : n + nv + p], parameter_names(model, wanted.kinds)
    )


def checked_windows(model: MuscleModel, states: States, excitation: ArrayLike) -> tuple[States, Array]:
    """States and excitations as arrays of one length.

    Raises:
        SettingsError: arrays of other shapes, or not finite.
    """
    parts = [np.asarray(part, dtype=np.float64) for part in (*states, excitation)]
    widths = (model.nv, model.nv, model.n_muscle, model.nv, model.n_muscle)
    b = len(parts[0]) if parts[0].ndim else 0
    names = ("qpos", "qvel", "activation", "reserve", "excitation")
    for name, part, width in zip(names, parts, widths, strict=True):
        if not b or part.shape != (b, width) or not np.isfinite(part).all():
            raise SettingsError(
                f"{name} of the windows has shape {part.shape}: give {(b or 'B', width)} finite numbers, a row a window"
            )
    return States(*parts[:4]), parts[4]

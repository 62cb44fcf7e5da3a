"""The muscle step in MJX (MuJoCo in JAX), and its derivative by JAX: the second route beside `gradients.tangents`.

`muscle_step` is a function for ``jax.jit``, ``jax.vmap``, ``jax.jacfwd`` and ``jax.jacrev``. `window_jacobian` is the
derivative of whole control windows by start, excitation, reserve and muscle parameters, for many patients at once.
`gradients.window_jacobian.stagewise_jacobian` finds the same from MuJoCo in C; the two share no derivative.

JAX is imported when a step is built. It computes in double precision only inside ``jax.enable_x64(True)``, which is a
local context; nothing here changes JAX's settings for the whole process.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import ModelError, SettingsError, SimulationError
from mjhcmc.gradients.looks import States
from mjhcmc.gradients.window_jacobian import WindowJacobian, checked_windows, ends_in_c, parameter_names
from mjhcmc.model import MuscleModel
from mjhcmc.muscle_parameters import FALL, FIBER, FORCE, FORCE_KINDS, RISE, SLACK, check_kinds, muscle_parameters

Array = NDArray[np.float64]

INSTALL = 'pip install "mjhcmc[jax]"'
"""What MJX needs."""

_EDGE = 1e-12  # of excitation: held this far inside its range, where MJX's clip has slope 1 (1/2 at 0 and 1 themselves)
_ABOVE_0, _BELOW_1 = 1e-300, float(np.nextafter(1.0, 0.0))  # of activation, likewise
_SAME = 1e-9  # rad, m, their rates, activation: MJX and C end where the other does


@dataclass(frozen=True, eq=False)
class MuscleStep:
    """See `muscle_step`; call it to step.

    Attributes:
        model: what is stepped.
        physics_dt: s.
        n_step: physics steps of a call.
        kinds: of `muscle_parameters.KINDS`.
        names: (p,) of the parameters, such as ``"max_isometric_force/soleus"``: those of every muscle, kind by kind.
        values: (p,) what they are in the model.
    """

    model: MuscleModel
    physics_dt: float
    n_step: int
    kinds: tuple[str, ...]
    names: tuple[str, ...]
    values: Array = field(repr=False)
    _mjx_model: Any = field(repr=False)
    _mjx_data: Any = field(repr=False)

    def __call__(
        self, qpos: Any, qvel: Any, activation: Any, excitation: Any, reserve: Any, parameters: Any = None
    ) -> tuple[Any, Any, Any]:
        """Classical Runge-Kutta steps with excitation and reserve held.

        At an edge the slope is that towards the inside: an excitation of exactly 0 has the derivative of excitations
        just above it, and a muscle that is at rest with it the time constant of rising activation.

        Args:
            qpos: (nv,) rad or m.
            qvel: (nv,) rad/s or m/s.
            activation: (n_muscle,).
            excitation: (n_muscle,).
            reserve: (nv,) N m.
            parameters: (p,) in the order of ``names``; the model's own where they are left out.

        Returns:
            qpos, qvel and activation at the end, as arrays of JAX.

        Raises:
            SettingsError: JAX is not set to double precision here.
        """
        import jax
        from jax import numpy as jnp
        from mujoco import mjx

        if jax.dtypes.canonicalize_dtype(np.float64) != np.float64:
            raise SettingsError(
                "a muscle step needs JAX in double precision: trace and call it inside 'with jax.enable_x64(True):'"
            )
        muscles, h = self.model, self.physics_dt
        m = self._mjx_model if parameters is None else self._with(jnp.asarray(parameters))
        low, high = muscles.excitation_range.T
        u = _held(jnp.asarray(excitation), low, high)
        ctrl = self._mjx_data.ctrl.at[muscles.ctrl_index].set(u)
        still = self._mjx_data.replace(ctrl=ctrl, qfrc_applied=jnp.asarray(reserve))

        def rate(q: Any, v: Any, a: Any) -> tuple[Any, ...]:
            act = jnp.where(a == 0, a + _ABOVE_0, jnp.where(a == 1, a - (1 - _BELOW_1), a))
            d = mjx.forward(m, still.replace(qpos=q, qvel=v, act=still.act.at[muscles.act_index].set(act)))
            return v, d.qacc, d.act_dot[muscles.act_index]

        # mjx.step writes the four stages out, and takes three times as long to compile. Only the state is carried:
        # MJX's data change from int32 to int64 with wraps in double precision, which no loop of JAX allows.
        def stage(carry: Any, tableau: Any) -> Any:
            start, k, total = carry
            k = rate(*(x + tableau[0] * h * slope for x, slope in zip(start, k, strict=True)))
            return (start, k, tuple(s + tableau[1] * slope for s, slope in zip(total, k, strict=True))), None

        def step(x: Any, _: Any) -> Any:
            none = tuple(jnp.zeros_like(part) for part in x)
            tableau = jnp.array([[0.0, 1 / 6], [0.5, 1 / 3], [0.5, 1 / 3], [1.0, 1 / 6]])
            (_, _, mean), _ = jax.lax.scan(stage, (x, none, none), tableau)
            return tuple(part + h * slope for part, slope in zip(x, mean, strict=True)), None

        start = tuple(jnp.asarray(part, dtype=float) for part in (qpos, qvel, activation))
        end = jax.lax.scan(step, start, None, length=self.n_step)[0]
        return end[0], end[1], end[2]

    def _with(self, parameters: Any) -> Any:
        """The MJX model with other muscle parameters; the fields are those of `parameter_fields`."""
        from jax import numpy as jnp

        model, m, i = self.model, self._mjx_model, self.model.muscle_ids
        own = muscle_parameters(model)
        now = own | dict(zip(self.kinds, parameters.reshape(-1, model.n_muscle), strict=True))
        lengths = (model.mj_model.actuator_lengthrange[i] - now[SLACK][:, None]) / now[FIBER][:, None]
        rows = jnp.column_stack([lengths, now[FORCE]])
        fields = {name: getattr(m, name).at[i, :3].set(rows) for name in ("actuator_gainprm", "actuator_biasprm")}
        times = jnp.column_stack([now[RISE], now[FALL]])
        fields["actuator_dynprm"] = m.actuator_dynprm.at[i, :2].set(times)
        owns = model.own_tendons >= 0
        factor = (now[FORCE] / own[FORCE]) * (own[FIBER] / now[FIBER])  # fiber damping goes with F0/L0
        damped = m.tendon_damping.at[model.own_tendons[owns]]
        fields["tendon_damping"] = damped.multiply(factor[owns], unique_indices=True)
        return m.tree_replace(fields)

    @cached_property
    def _ends_and_jacobians(self) -> Callable[..., Any]:
        """Compiled once for each number of windows: ends (B, 2 nv + n), and their derivatives by all that goes in."""
        import jax
        from jax import numpy as jnp

        nv, n = self.model.nv, self.model.n_muscle
        cuts = np.cumsum([nv, nv, n, n, nv])

        def end(x: Any) -> Any:
            found = jnp.concatenate(self(*jnp.split(x, cuts)))
            return found, found

        return jax.jit(jax.vmap(jax.jacfwd(end, has_aux=True)))


def _held(x: Any, low: Array, high: Array) -> Any:
    """x well within low and high; slope 1 from low to high, 0 beyond."""
    import jax
    from jax import numpy as jnp

    off = jax.lax.stop_gradient(jnp.clip(x, low + _EDGE, high - _EDGE) - x)
    return jnp.where((x >= low) & (x <= high), x, jax.lax.stop_gradient(x)) + off


def muscle_step(
    model: MuscleModel, physics_dt: float = 0.001, n_step: int = 1, parameters: Sequence[str] = FORCE_KINDS
) -> MuscleStep:
    """Build a model's step in MJX: (qpos, qvel, activation, excitation, reserve, parameters) to the end.

    Limits and contacts are left out: no derivative passes through them here. `window_jacobian` tells where one is at
    work.

    Args:
        model: of hinges and slides, with MuJoCo's muscles.
        physics_dt: s, of one Runge-Kutta step.
        n_step: steps of a call.
        parameters: kinds of muscle parameters that go in, of `mjhcmc.muscle_parameters.KINDS`.

    Raises:
        SettingsError: JAX or MJX is not installed; a step, count or kind that cannot be.
        ModelError: the model has something that MJX, or a derivative, does not support, or other muscles.
    """
    if not isinstance(model, MuscleModel):
        raise SettingsError(f"a muscle step takes a MuscleModel; got {type(model).__name__}: use MuscleModel.load")
    if not (np.isfinite(physics_dt) and physics_dt > 0):
        raise SettingsError(f"physics_dt is {physics_dt!r} s: give a positive number")
    if not isinstance(n_step, (int, np.integer)) or n_step < 1:
        raise SettingsError(f"n_step is {n_step!r}: give a whole number of 1 or more")
    check_kinds(parameters)
    now = muscle_parameters(model)
    for why in _unsupported(model):
        raise ModelError(f"model {model.name!r} has no step in MJX here: {why}")
    jax, mjx = _load()
    m = copy.copy(model.mj_model)
    bits = mujoco.mjtDisableBit
    m.opt.disableflags |= int(bits.mjDSBL_CONSTRAINT | bits.mjDSBL_CONTACT | bits.mjDSBL_SENSOR | bits.mjDSBL_CLAMPCTRL)
    m.geom_contype[:], m.geom_conaffinity[:] = 0, 0  # contacts are left out, so whatever their shapes are
    with jax.enable_x64(True):
        try:
            own = mjx.put_model(m)
        except NotImplementedError as error:
            told = "; ".join(str(error).split("\n"))
            raise ModelError(
                f"model {model.name!r} has no step in MJX: {told}: use mjhcmc.gradients, or leave it out"
            ) from error
        data = mjx.make_data(own)
        limits = np.where(m.actuator_ctrllimited[:, None], m.actuator_ctrlrange, [[-np.inf, np.inf]])
        data = data.replace(ctrl=data.ctrl + np.clip(0.0, *limits.T))  # of actuators that are no muscles
    kinds = tuple(parameters)
    names = parameter_names(model, kinds)
    values = np.concatenate([np.empty(0), *(now[kind] for kind in kinds)])
    return MuscleStep(model, float(physics_dt), int(n_step), kinds, names, values, own, data)


def _load() -> tuple[Any, Any]:
    try:
        with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere):  # MJX tells of what else is not there
            import jax
            from mujoco import mjx
    except ImportError as error:
        raise SettingsError(f"the muscle step in MJX needs jax and mujoco-mjx ({error}): {INSTALL}") from error
    return jax, mjx


def _unsupported(model: MuscleModel) -> Iterator[str]:
    """What of the model MJX leaves out without a word, or has no derivative of, and the remedy."""
    m, bits, wraps = model.mj_model, mujoco.mjtDisableBit, mujoco.mjtWrap
    if not model.coordinates.flat:
        yield "it has ball or free joints; only hinges and slides are offered"
    if m.neq and m.eq_active0.any():
        yield "it has equality constraints; MJX's solver of constraints has no reverse derivative: remove them"
    for name in ("dof_frictionloss", "tendon_frictionloss"):
        if getattr(m, name).any():
            yield f"it has {name}, a constraint; MJX's solver has no reverse derivative: write it as damping"
    for name in ("jnt_stiffnesspoly", "dof_dampingpoly", "tendon_stiffnesspoly", "tendon_dampingpoly"):
        if getattr(m, name).any():
            yield f"MJX leaves out {name}: use linear stiffness and damping"
    for name in ("actuator_damping", "actuator_dampingpoly", "actuator_armature"):
        if getattr(m, name).any():
            yield f"MJX leaves out {name}: put it on the joints or tendons"
    if m.geom_fluid.any():
        yield "MJX leaves out the fluid forces of ellipsoids (fluidshape): remove them"
    if m.nhistory:
        yield "MJX leaves out the delay of actuators or sensors: remove it"
    if m.nplugin or m.nflex:
        yield "it has plugins or flexes: remove them"
    flags = m.opt.disableflags
    if bool(flags & bits.mjDSBL_SPRING) != bool(flags & bits.mjDSBL_DAMPER):
        yield "it disables springs or dampers alone, and MJX then leaves out both: disable neither"
    wrapped = np.flatnonzero(np.isin(m.wrap_type, [int(wraps.mjWRAP_SPHERE), int(wraps.mjWRAP_CYLINDER)]))
    if len(wrapped) and m.tendon_armature.any():
        yield "it has tendon_armature and wraps, whose moment arms' rates MJX leaves out: remove the armature"
    for at in wrapped:
        geom, side = int(m.wrap_objid[at]), round(float(m.wrap_prm[at]))
        if side < 0:
            continue
        names = f"sidesite {m.site(side).name!r} of wrap {m.geom(geom).name!r}"
        if m.geom_bodyid[geom] != m.site_bodyid[side]:
            yield f"the {names} is on another body; MJX takes both for fixed to one: put it on the wrap's body"
        elif np.linalg.norm(m.site_pos[side] - m.geom_pos[geom]) < m.geom_size[geom, 0]:
            yield (
                f"the {names} is inside it; of a path inside a wrap MJX's derivative is NaN (sqrt at 0), its length "
                "good to 1e-4: put the sidesite outside, or use mjhcmc.gradients"
            )


def window_jacobian(
    step: MuscleStep, states: States, excitation: ArrayLike, parameters: ArrayLike | None = None, *, verify: bool = True
) -> WindowJacobian:
    """Differentiate B windows at once in MJX; the first call for a B takes seconds to compile.

    Args:
        step: of the model, built once for many calls.
        states: (B) at the starts, and the reserves.
        excitation: (B, n_muscle).
        parameters: (B, p) a patient a row, in the order of ``step.names``; the model's own where they are left out.
        verify: step the windows in C as well, and refuse if a limit or contact is at work or MJX ends elsewhere.

    Raises:
        SettingsError: arrays of other shapes, or not finite.
        SimulationError: a constraint is at work; MJX and MuJoCo in C end apart; or a derivative is not finite.
    """
    states, u = checked_windows(step.model, states, excitation)
    b, model = len(u), step.model
    own = np.tile(step.values, (b, 1)) if parameters is None else np.asarray(parameters, dtype=np.float64)
    if own.shape != (b, len(step.names)) or not np.isfinite(own).all():
        raise SettingsError(f"parameters have shape {own.shape}: give {(b, len(step.names))} finite numbers")
    jax, _ = _load()
    with jax.enable_x64(True):
        x = np.hstack([states.qpos, states.qvel, states.activation, u, states.reserve, own])
        whole, end = (np.asarray(part) for part in step._ends_and_jacobians(x))
    if verify:
        rows = own.reshape(b, len(step.kinds), model.n_muscle)
        values = {kind: rows[:, k] for k, kind in enumerate(step.kinds)}
        _compare(model, end, ends_in_c(model, states, u, step.physics_dt, step.n_step, values))
    bad = ~np.isfinite(whole).all(axis=(1, 2))
    if bad.any():
        raise SimulationError(
            f"MJX's derivative of window {int(np.argmax(bad))} of model {model.name!r} is not finite: a path's site "
            "lies on its wrap, or a muscle's number is degenerate; move the state"
        )
    n = 2 * model.nv + model.n_muscle
    return WindowJacobian(end, whole[:, :, :n], whole[:, :, n:], step.names)


def _compare(model: MuscleModel, found: Array, wanted: Array) -> None:
    off = np.abs(found - wanted).max(axis=1)
    worst = int(np.argmax(np.where(np.isnan(off), np.inf, off)))
    if not off[worst] <= _SAME:
        raise SimulationError(
            f"MJX ends window {worst} of model {model.name!r} off by {off[worst]:.2g} from MuJoCo in C: it leaves out "
            "something of the model; use mjhcmc.gradients"
        )

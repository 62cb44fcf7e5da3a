"""How joint moments are shared among the muscles: the cost, the muscles' bounds, the solver.

What every method minimizes, at the activations a that supply the moments:

    effort    sum_i k_i a_i^2           as OpenSim's static optimization
    cubic     sum_i k_i a_i^3           cubed, as the stress in Crowninshield & Brand (1981),
                                        doi 10.1016/0021-9290(81)90035-X
    volume    sum_i k_i V_i a_i^2       larger muscles cost more
    stress    sum_i k_i (F_i/F0_i)^2    whole force over max isometric force
    capacity  sum_i k_i (F_i/gain_i)^2  whole force over the active force at full activation, as OpenSim's CMC:
                                        effort but for passive force and fiber damping

k are the user's weights, V = F0 lopt (relative to their mean) goes with the muscle's volume, F = gain a + bias is the
muscle's whole force, gain what it can give actively at its length and velocity (see `_capacity`). Smoothness adds
sum_i k_i sigma (a_i - a_before,i)^2 (for `cubic` 3/2 of it, for `volume` with k_i V_i). EMG adds
sum_i k_i w_i (a_i - e_i(t))^2 likewise, over the muscles that were measured (see `emg_targets`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.allocation import Allocation, AllocationProblem, allocate, build_problem
from mjhcmc.checks import is_number
from mjhcmc.dynamics import MuscleMoments
from mjhcmc.errors import SettingsError
from mjhcmc.model import MuscleModel
from mjhcmc.qp_back_ends import NEWTON, check_solver

if TYPE_CHECKING:
    from mjhcmc.emg_targets import EmgTargets, Tracking

COSTS = ("effort", "cubic", "volume", "stress", "capacity")
"""Names of the costs."""

Array = NDArray[np.float64]

_BY_MUSCLE = ("weights", "min_activation", "disabled", "strength")
_CUBIC_CONVEXITY = 1e-8  # quadratic part of the cubic cost: keeps it strictly convex at 0, moves a by 5e-9
_LEAST_SHARE = 1e-4  # a muscle without gain still costs this much of its weight
_LEAST_CAPACITY = 0.1
_MOST_SPREAD = 1e6  # of the weights: beyond, rounding decides


@dataclass(frozen=True, eq=False)
class Sharing:
    """A cost, bounds and a solver, checked against a model; build it with `share`.

    Arrays are (n_muscle,), or (b, n_muscle) for simulations that go together, see `together`.

    Attributes:
        cost: one of `COSTS`.
        weights: (n_muscle,) positive; for `volume` times the relative volumes.
        smoothness: sigma, 0 or positive.
        min_activation: (n_muscle,) least activation asked of each muscle.
        disabled: (n_muscle,) True for muscles that stay switched off.
        strength: (n_muscle,) N, max isometric force; ones where the cost has no use for it, NaN where `capacity`
            does without.
        solver: ``"newton"`` or a qpsolvers back end.
        options: what the user asked for, as plain values for the record.
        tracking: what EMG asks for; None: nothing.
    """

    cost: str
    weights: Array
    smoothness: float
    min_activation: Array
    disabled: NDArray[np.bool_]
    strength: Array
    solver: str
    options: dict[str, Any]
    tracking: Tracking | None = None

    def of(self, which: int | NDArray[np.intp] | slice) -> Sharing:
        """That of one simulation, or of some, where the arrays have one row a simulation (see `together`)."""
        parts: dict[str, Any] = {name: getattr(self, name)[which] for name in _BY_MUSCLE}
        if self.tracking is not None:
            parts["tracking"] = self.tracking.of(which)
        return replace(self, **parts)

    @cached_property
    def unbounded(self) -> Sharing:
        """The same without a least activation of its own: where bounds hold it already."""
        return replace(self, min_activation=np.full_like(self.weights, -np.inf))

    @property
    def counts_forces(self) -> bool:
        """Whether the cost is one of whole forces, so that it needs to know fiber damping."""
        return self.cost in ("stress", "capacity")

    def bounds(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds (n_muscle,) on activation within those that can be reached.

        A least activation beyond reach is approached as fast as can be; a disabled muscle has no choice.
        """
        low = np.minimum(np.maximum(low, self.min_activation), high)
        return low, np.where(self.disabled, low, high)

    def excitation(self, excitation: Array) -> Array:
        """The excitation (n_muscle,) with the disabled muscles switched off."""
        return np.where(self.disabled, 0.0, excitation) if self.options["disabled"] else excitation

    def problem(
        self,
        moments: MuscleMoments,
        Q: Array,
        low: Array,
        high: Array,
        inertia: Array,
        before: Array | None,
        time: float | None = None,
    ) -> AllocationProblem:
        """The allocation of Q (nv,) N m.

        Args:
            moments: of the muscles at the state; with damping where `counts_forces`.
            Q: (nv,) N m that activation should supply.
            low: (n_muscle,) lowest activation that can be reached.
            high: (n_muscle,) highest.
            inertia: (nv, nv) kg m^2, by which reserves are priced, see `allocation.build_problem`.
            before: (n_muscle,) activation that smoothness holds on to; None: none yet.
            time: s, as `weigh`.
        """
        w, a0, c = self.weigh(moments.gain, moments.bias, before, time)
        return build_problem(moments.B, Q, *self.bounds(low, high), inertia=inertia, w=w, a0=a0, c=c)

    @cached_property
    def _nothing(self) -> Array:
        return np.zeros_like(self.weights)

    def weigh(
        self, gain: Array, bias: Array, before: Array | None, time: float | Array | None = None
    ) -> tuple[Array, Array, Array | None]:
        """The cost at a state as w, a0, c (n_muscle,) of `allocation`; c None where it is quadratic.

        Args:
            gain: (n_muscle,) N, see `dynamics.MuscleMoments`.
            bias: (n_muscle,) N.
            before: (n_muscle,) activation that smoothness holds on to; None: none yet.
            time: s, when the activation is to be there, on the motion's clock: the window's end; (b,) where arrays have
                a row a simulation. Needed with ``tracking`` only.
        """
        k, cubic = self.weights, None
        w, a0 = k, self._nothing
        if self.counts_forces:
            full = self.strength if self.cost == "stress" else _capacity(gain, self.strength)
            gain, bias = np.abs(gain) / full, bias / full  # a gain that pushes counts by its size
            share = np.maximum(gain**2, _LEAST_SHARE)
            w, a0 = k * share, -bias * gain / share
        elif self.cost == "cubic":
            w, cubic = _CUBIC_CONVEXITY * k, k
        if self.smoothness and before is not None:
            w, a0 = _held(w, a0, self.smoothness * k, before)
        if self.tracking is not None:
            assert time is not None
            target, weight = self.tracking.at(time)
            w, a0 = _held(w, a0, weight * k, target)
        return w, a0, cubic

    def allocate(self, problem: AllocationProblem) -> Allocation:
        """Solve a problem with the chosen solver; raises as `allocation.allocate`."""
        return allocate(problem, self.solver)


def together(sharings: Sequence[Sharing]) -> Sharing:
    """Those of several simulations, alike but for numbers, as one with a row a simulation."""
    parts: dict[str, Any] = {name: np.stack([getattr(s, name) for s in sharings]) for name in _BY_MUSCLE}
    trackings = [s.tracking for s in sharings if s.tracking is not None]
    if trackings:
        from mjhcmc.emg_targets import together as emg_together

        parts["tracking"] = emg_together(trackings)
    return replace(sharings[0], **parts)


def _capacity(gain: Array, strength: Array) -> Array:
    """(n_muscle,) N, what each muscle can give actively, but at least a tenth of F0 (unknown: of the largest gain).

    Below, forces cost less and less: the least of (F/gain)^2 is at full activation where damping pushes a muscle that
    has no gain.
    """
    size = np.abs(gain)  # a gain that pushes is a capacity, too
    known = np.isfinite(strength) & (strength > 0)
    full = np.maximum(size, _LEAST_CAPACITY * np.where(known, strength, size.max(axis=-1, keepdims=True)))
    return np.where(full > 0, full, 1.0)


def _held(w: Array, a0: Array, more: Array, before: Array) -> tuple[Array, Array]:
    """w/2 (a - a0)^2 + more/2 (a - before)^2 as one square, up to a constant."""
    return w + more, (w * a0 + more * before) / (w + more)


def share(
    model: MuscleModel,
    cost: str = "effort",
    weights: Mapping[str, float] | ArrayLike | None = None,
    smoothness: float = 0.0,
    min_activation: Mapping[str, float] | ArrayLike = 0.0,
    disabled: Sequence[str] = (),
    solver: str = NEWTON,
    emg: EmgTargets | None = None,
) -> Sharing:
    """Check the choices against a model.

    Args:
        model: the model.
        cost: one of `COSTS`.
        weights: by muscle name (1 for the others), or (n_muscle,); positive.
        smoothness: sigma, 0 or positive; see the module's docstring.
        min_activation: one number, by muscle name (0 for the others), or (n_muscle,); at least 0, below 1.
        disabled: names of muscles that stay switched off; their passive force stays.
        solver: ``"newton"``, or the name of an installed qpsolvers back end where the cost is quadratic.
        emg: measured excitations that activation is to follow; None: none.

    Raises:
        MotionError: a file that maps muscles to channels cannot be read.
        SettingsError: an unknown cost, muscle, channel or solver (the message lists the valid ones), a solver that is
            not installed or cannot take the cost, values of the wrong shape or outside their range, weights too far
            apart, a cost that the model's muscles have no measure for.
    """
    if not isinstance(cost, str) or cost not in COSTS:
        raise SettingsError(f"unknown cost {cost!r}: choose one of {', '.join(COSTS)}")
    if not isinstance(solver, str):
        raise SettingsError(f"solver must be a name, such as {NEWTON!r}; got {solver!r}")
    check_solver(solver)
    if cost == "cubic" and solver != NEWTON:
        raise SettingsError(f"QP solver {solver!r} takes quadratic costs only: use solver {NEWTON!r} with cost 'cubic'")
    if not (is_number(smoothness) and 0 <= smoothness < np.inf):
        raise SettingsError(f"smoothness must be 0 or positive; got {smoothness!r}")
    k = by_muscle(model, "weights", weights, 1.0)
    _check_muscles(model, "weights", k, k > 0, "positive")
    least = by_muscle(model, "min_activation", min_activation, 0.0)
    _check_muscles(model, "min_activation", least, (least >= 0) & (least < 1), "at least 0 and below 1")
    least = np.minimum(least, model.excitation_range[:, 1])
    if isinstance(disabled, str):
        raise SettingsError(f"disabled must be a list of muscle names; got {disabled!r}: write [{disabled!r}]")
    if not isinstance(disabled, Iterable):
        raise SettingsError(f"disabled must be a list of muscle names; got {disabled!r}")
    disabled = list(disabled)
    _check_names(model, "disabled", disabled)
    off = np.array([name in disabled for name in model.muscle_names], dtype=bool)
    held_on = np.flatnonzero(off & (model.excitation_range[:, 0] > 0))
    if held_on.size:
        raise SettingsError(
            f"disabled: the model's ctrlrange keeps {model.muscle_names[held_on[0]]} from being switched off: set its "
            "lower end to 0"
        )
    if off.all():
        raise SettingsError("disabled names every muscle: leave at least one")
    strength = model.max_isometric_force if cost in ("volume", "stress", "capacity") else np.ones(model.n_muscle)
    if cost in ("volume", "stress"):
        _check_measure(model, cost, strength, "max isometric force")
    if cost == "volume":
        volume = strength * model.optimal_fiber_length
        _check_measure(model, cost, volume, "optimal fiber length")
        k = k * volume / volume.mean()
    if k.max() > _MOST_SPREAD * k.min():
        raise SettingsError(
            f"weights (times volume, where it is the cost) span a factor of {k.max() / k.min():.0e}, at most "
            f"{_MOST_SPREAD:.0e}: name muscles that are to do nothing in disabled"
        )
    least = np.where(off, 0.0, least)
    tracking = None if emg is None else _tracking(model, emg, k)
    options = {
        "cost": cost,
        "weights": None if weights is None else by_muscle(model, "weights", weights, 1.0).tolist(),
        "smoothness": float(smoothness),
        "min_activation": least.tolist() if np.ptp(least) else float(least[0]),
        "disabled": [name for name in model.muscle_names if name in disabled],
        "solver": solver,
        "emg": None if tracking is None else tracking.options,
    }
    return Sharing(cost, k, float(smoothness), least, off, strength, solver, options, tracking)


def _tracking(model: MuscleModel, emg: EmgTargets, k: Array) -> Tracking:
    """What EMG asks for of a model, checked."""
    from mjhcmc.emg_targets import EmgTargets

    if not isinstance(emg, EmgTargets):
        raise SettingsError(f"emg must be EmgTargets; got {type(emg).__name__}: use EmgTargets(Emg.from_file(...))")
    tracking = emg.tracking(model)
    price = k * (1 + tracking.weight)
    if price.max() > _MOST_SPREAD * price.min():
        raise SettingsError(
            f"EMG weights times the muscles' weights span a factor of {price.max() / price.min():.0e}, at most "
            f"{_MOST_SPREAD:.0e}: choose smaller EMG weights"
        )
    return tracking


def by_muscle(model: MuscleModel, what: str, given: Mapping[str, float] | ArrayLike | None, default: float) -> Array:
    """(n_muscle,) numbers, given by name, as one number for all, or in the model's order.

    Raises:
        SettingsError: an unknown muscle, something that is no finite number, or the wrong shape.
    """
    values: Array
    if given is None:
        return np.full(model.n_muscle, default)
    if isinstance(given, Mapping):
        _check_names(model, what, list(given))
        pairs = [given.get(name, default) for name in model.muscle_names]
        for name, value in zip(model.muscle_names, pairs, strict=True):
            if not is_number(value):
                raise SettingsError(f"{what} of {name} must be a number; got {value!r}")
    else:
        pairs = given  # type: ignore[assignment]
    try:
        strange = [value for value in np.array(pairs, dtype=object).ravel() if not is_number(value)]
        if strange:
            raise SettingsError(f"{what} must be numbers; got {strange[0]!r}")
        values = np.array(pairs, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise SettingsError(f"{what} must be numbers; got {given!r}") from None
    if values.ndim == 0:
        values = np.full(model.n_muscle, float(values))
    if values.shape != (model.n_muscle,):
        raise SettingsError(
            f"{what} has shape {values.shape}; model {model.name!r} has {model.n_muscle} muscles: give one number a "
            "muscle, or a mapping of muscle names"
        )
    _check_muscles(model, what, values, np.isfinite(values), "finite")
    return values


def _check_muscles(model: MuscleModel, what: str, values: Array, good: NDArray[np.bool_], rule: str) -> None:
    if not good.all():
        i = int(np.argmin(good))
        raise SettingsError(f"{what} of {model.muscle_names[i]} must be {rule}; got {values[i]:g}")


def _check_names(model: MuscleModel, what: str, names: Sequence[str]) -> None:
    unknown = [name for name in names if name not in model.muscle_names]
    if unknown:
        raise SettingsError(
            f"{what}: model {model.name!r} has no muscle {unknown[0]!r}: its muscles are "
            f"{', '.join(model.muscle_names)}"
        )


def _check_measure(model: MuscleModel, cost: str, values: Array, what: str) -> None:
    missing = np.flatnonzero(~(np.isfinite(values) & (values > 0)))
    if missing.size:
        raise SettingsError(
            f"cost {cost!r}: muscle {model.muscle_names[missing[0]]} has no {what} that the model "
            "tells: choose cost 'effort'"
        )

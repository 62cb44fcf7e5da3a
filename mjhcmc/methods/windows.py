"""The control windows of a solve, common to all methods: their times, the desired motion, the start."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError
from mjhcmc.imposed import Imposed
from mjhcmc.integrators import RK4, Scheme, check_activation, check_engine, scheme_of
from mjhcmc.joint_moments import JointMoments
from mjhcmc.methods.stability import check_passive_stability
from mjhcmc.model import MuscleModel
from mjhcmc.motion import RANGE_ALLOWANCE, Motion, Reference, check_joint_range
from mjhcmc.motion_on_model import fit_to_model, path_of
from mjhcmc.plant import MujocoPlant, State, physics_steps
from mjhcmc.sharing import Sharing, share
from mjhcmc.start_checks import contacts_beyond_strength
from mjhcmc.surroundings import Surroundings, coordinates_of

if TYPE_CHECKING:
    from mjhcmc.external_loads import ExternalLoads

_MOST_STEPS = 10**8  # days of work, gigabytes of record


@dataclass(frozen=True)
class Windows:
    """What every method starts from, for one simulation.

    Attributes:
        model: the model.
        motion: the desired motion.
        reference: the desired motion at the N + 1 nodes.
        dt: s, length of a control window.
        physics_dt: s, length of a physics step.
        n_step: physics steps in a window.
        start: the plant's state at the first node; its activation is NaN where it is to be solved for.
        sharing: how moments are shared among the muscles.
        joint_moments: those that a user brought along; None: none.
        surroundings: what acts from outside, and what leads prescribed joints.
        imposed: (N, n_muscle) excitation below which muscles do not go; None: as the model says.
        own_plant: a plant that the user handed in; None: none.
        bench: a plant of the same model to look at states with, shared with other simulations; None: none.
        scheme: what integrates the plant.
    """

    model: MuscleModel
    motion: Motion
    reference: Reference
    dt: float
    physics_dt: float
    n_step: int
    start: State
    sharing: Sharing
    joint_moments: JointMoments | None = None
    surroundings: Surroundings = field(default_factory=Surroundings)
    imposed: NDArray[np.float64] | None = None
    own_plant: MujocoPlant | None = None
    bench: MujocoPlant | None = None
    scheme: Scheme = RK4

    @cached_property
    def plant(self) -> MujocoPlant:
        """What methods look at states with: the user's plant, or one of the model."""
        shared = self.bench if self.surroundings.empty else None
        return (
            self.own_plant
            or shared
            or MujocoPlant(
                self.model, self.physics_dt, surroundings=self.surroundings, integrator=self.scheme.name
            )
        )  # fmt: skip

    @property
    def may_be_finer(self) -> bool:
        """Whether the physics step is ours to change: a plant of the user's own making keeps its step."""
        return self.own_plant is None or self.own_plant.hosted is not None

    def finer(self, times: int) -> Windows:
        """The same with that many times more physics steps."""
        step, own = self.physics_dt / times, self.own_plant
        if own is not None:
            own = own.at(step, self.surroundings)
        anew = replace(self, physics_dt=step, n_step=self.n_step * times, bench=None, own_plant=own)
        if np.array_equal(self.start.qvel, self.target.qvel[0]):  # where it should start depends on the step
            anew = replace(anew, start=replace(self.start, qvel=anew.target.qvel[0].copy()))
        return anew

    @cached_property
    def target(self) -> Reference:
        """The desired motion at the nodes, with velocities and accelerations as the plant's steps have them.

        Those of `reference` under RK4; else see `integrators`.
        """
        return stepped(self, self.physics_dt) if self.scheme.first_order else self.reference

    def where_forces_act(self, state: State, qacc: NDArray[np.float64]) -> State:
        """The state with the velocity at which the integrator takes forces, when a step of qacc (nv,) follows."""
        if not self.scheme.implicit:
            return state
        return replace(state, qvel=state.qvel + self.physics_dt * qacc)

    def without_plant(self) -> Windows:
        """The same without the plant of the model, which is built again when it is asked for."""
        return replace(self)

    @cached_property
    def rms_qacc(self) -> NDArray[np.float64]:
        """(nv,) rad/s^2 or m/s^2, root mean square of the desired accelerations."""
        return np.asarray(np.sqrt((self.reference.qacc**2).mean(axis=0)))

    def reference_at(self, time: ArrayLike) -> Reference:
        """The desired motion at one time or at several; after its end it goes on with its last acceleration."""
        time = np.atleast_1d(np.asarray(time, dtype=np.float64))
        found = self.motion.sample(np.minimum(time, self.motion.end))
        beyond = np.maximum(time - self.motion.end, 0.0)[:, None]
        if not beyond.any():
            return replace(found, time=time)
        qpos = self.model.coordinates.moved(found.qpos, beyond * found.qvel + beyond**2 / 2 * found.qacc)
        return Reference(time, qpos, found.qvel + beyond * found.qacc, found.qacc)

    @cached_property
    def tangents(self) -> NDArray[np.float64] | None:
        """(N+1, nv, nv) of the equalities along the desired motion, see `coupling`; None where there are none."""
        coupling = self.model.coupling
        return None if coupling is None else coupling.tangent(self.reference.qpos)

    def seen_from_tracked(self, qpos: NDArray[np.float64], M: NDArray[np.float64]) -> NDArray[np.float64]:
        """W (nv, nz) at a position, see `coordinates`.

        Args:
            qpos: (nq,).
            M: (nv, nv) mass matrix there.
        """
        coupling = self.model.coupling
        return self.model.coordinates.seen_from_tracked(None if coupling is None else coupling.tangent(qpos), M)

    @property
    def count(self) -> int:
        """Number of windows, N."""
        return len(self.reference.time) - 1


def stepped(windows: Windows, step: float) -> Reference:
    """The desired motion at the nodes, differenced over a physics step; before its start it has its first acceleration.

    Args:
        windows: of the motion.
        step: s.
    """
    reference, moved, difference = (
        windows.reference, windows.model.coordinates.moved, windows.model.coordinates.difference
    )  # fmt: skip
    first = reference.qpos[:1], reference.qvel[:1], reference.qacc[:1]
    before = moved(first[0], -step * first[1] + step**2 / 2 * first[2])
    if windows.count:
        before = np.concatenate([before, windows.reference_at(reference.time[1:] - step).qpos])
    after = windows.reference_at(reference.time + step).qpos
    qvel = difference(reference.qpos, before) / step
    qacc = (difference(after, reference.qpos) / step - qvel) / step
    return replace(reference, qvel=qvel, qacc=qacc)


def prepare(
    model: MuscleModel,
    motion: Motion,
    dt: float,
    physics_dt: float,
    initial_qpos: ArrayLike | None = None,
    initial_qvel: ArrayLike | None = None,
    initial_activation: ArrayLike | None = None,
    joint_moments: JointMoments | None = None,
    plant: MujocoPlant | None = None,
    bench: MujocoPlant | None = None,
    loads: ExternalLoads | None = None,
    imposed: Imposed | None = None,
    integrator: str = "rk4",
    **choices: Any,
) -> Windows:
    """Check the settings of a solve and lay out its windows.

    Args:
        model: the model.
        motion: the motion to follow, rad or m.
        dt: s, control window.
        physics_dt: s, largest physics step; rounded down to a divisor of dt.
        initial_qpos: (nq,) rad or m; the motion's by default.
        initial_qvel: (nv,) rad/s or m/s; the motion's by default.
        initial_activation: (n_muscle,) or one number; NaN, to be solved for, by default.
        joint_moments: to be shared among the muscles in place of those of inverse dynamics.
        plant: what is stepped; a `MujocoPlant` at physics_dt by default. It keeps its own physics step.
        bench: see `Windows`.
        loads: measured forces on the model's bodies.
        imposed: excitation below which muscles do not go.
        choices: of cost, bounds and solver, see `sharing.share`.

    Raises:
        SettingsError: a setting outside its valid values.
        MotionError: a motion of other joints, outside the joints' range, or against the model's equalities; joint
            moments or loads that do not cover it.
        ModelError: loads on bodies that the model has not.
        SimulationError: a physics step at which the model's passive damping is unstable, or an integrator of first
            order overshoots in activation.
    """
    scheme = _scheme(integrator, plant)
    if not isinstance(model, MuscleModel) or not isinstance(motion, Motion):
        raise SettingsError(
            f"a method takes a MuscleModel and a Motion; got {type(model).__name__} and {type(motion).__name__}: use "
            "MuscleModel.load and Motion.from_file"
        )
    for name, value in (("dt", dt), ("physics_dt", physics_dt)):
        if not (isinstance(value, (int, float, np.integer, np.floating)) and math.isfinite(value) and value > 0):
            raise SettingsError(f"{name} must be a positive number of seconds; got {value}")
    dt, physics_dt = float(dt), float(physics_dt)  # a number of single precision would spoil what it meets
    if motion.qpos.shape[1] != model.nq:
        raise MotionError(
            f"motion {motion.name!r} has {motion.qpos.shape[1]} joints, model {model.name!r} has {model.nq} "
            f"({', '.join(model.joint_names)}): build the motion for this model"
        )
    motion = fit_to_model(motion, model)
    count = math.floor(motion.duration / dt + 1e-6)
    if count * physics_steps(dt, physics_dt) > _MOST_STEPS:
        raise SettingsError(
            f"dt {dt:g} s and physics_dt {physics_dt:g} s cut the motion ({motion.duration:g} s) into more than "
            f"{_MOST_STEPS:.0e} steps: choose larger ones"
        )
    if count < 1:
        raise SettingsError(f"dt {dt:g} s is longer than the motion ({motion.duration:g} s): choose a smaller dt")
    lost = motion.duration - count * dt
    if lost > 1e-6 * dt:
        warnings.warn(
            f"dt {dt:g} s does not divide the motion ({motion.duration:g} s): the last {lost:.4g} s are dropped",
            MjhcmcWarning,
            stacklevel=3,
        )
    times = np.minimum(motion.start + dt * np.arange(count + 1), motion.end)
    reference = motion.sample(times)
    _check_range(motion, model, reference.time, reference.qpos, f"motion {motion.name!r}")
    n_step = physics_steps(dt, physics_dt)
    step, external = dt / n_step, None
    if loads is not None:
        _check_loads(loads, model, motion)
    if imposed is not None:
        if not isinstance(imposed, Imposed):
            raise SettingsError(f"imposed must be Imposed excitation; got {type(imposed).__name__}")
        imposed.check_fits(motion, model)
    if plant is not None and (plant.model.joint_names, plant.model.muscle_names) != (
        model.joint_names, model.muscle_names
    ):  # fmt: skip
        raise SettingsError(
            f"the plant is of model {plant.model.name!r}, with other joints or muscles than {model.name!r}: build it "
            "of the model that is solved"
        )
    if plant is None:
        pass
    elif joint_moments is not None and plant.hosted is None:
        raise SettingsError(
            "joint_moments and a plant of one's own exclude each other: build the plant with "
            "external=joint_moments.implied_load(plant, motion)"
        )
    else:
        step, external = plant.physics_dt, plant.surroundings.external
        n_step = physics_steps(dt, step)
        if abs(n_step * step - dt) > 1e-9 * dt:
            raise SettingsError(f"the plant's step {step:g} s does not divide dt {dt:g} s: build it with dt/{n_step}")
    if joint_moments is not None:
        if not isinstance(joint_moments, JointMoments):
            raise SettingsError(
                f"joint_moments must be JointMoments; got {type(joint_moments).__name__}: use JointMoments.from_file"
            )
        if loads is not None or not model.roles.all_tracked:
            raise SettingsError(
                "joint_moments tell what all joints of a model carry, loads from outside included: leave loads out, "
                "and use a model whose joints are all tracked"
            )
        joint_moments.check_covers(motion, model)
        external = joint_moments.implied_load(MujocoPlant(model, step), motion)
    path = path_of(motion) if len(model.roles.prescribed) else None
    surroundings = Surroundings(external, loads, path, times)
    if plant is not None and plant.hosted is None:
        if loads is not None or (path is not None and plant.surroundings.path is None):
            raise SettingsError(
                "a plant of one's own brings its surroundings with it: build it with surroundings=Surroundings(...)"
            )
        surroundings = plant.surroundings
    elif plant is not None:
        surroundings = Surroundings(external, loads or plant.surroundings.loads, path, times)
        if (joint_moments, loads, path) != (None, None, None):
            plant = plant.at(step, surroundings)
    sharing = share(model, **choices)
    if sharing.tracking is not None:
        choices["emg"].check_covers(motion)
    check_activation(model, scheme, step)
    check_engine(model, scheme, step)
    qpos = _vector("initial_qpos", initial_qpos, reference.qpos[0])
    qvel = _vector("initial_qvel", initial_qvel, reference.qvel[0])
    if len(model.roles.prescribed):
        at = coordinates_of(model.mj_model, model.roles.prescribed)
        qpos[at], qvel[model.roles.prescribed] = reference.qpos[0, at], reference.qvel[0, model.roles.prescribed]
    if model.coupling is not None and initial_qpos is not None:
        qpos = model.coupling.project(qpos)
    _check_range(motion, model, times[:1], qpos[None], "initial_qpos")
    activation = _vector("initial_activation", initial_activation, np.full(model.n_muscle, np.nan))
    if initial_activation is not None and (np.any(activation < 0) or np.any(activation > 1)):
        raise SettingsError("initial_activation must lie within 0..1")
    start = State(float(times[0]), qpos, qvel, activation, np.zeros(model.nv))
    windows = Windows(
        model,
        motion,
        reference,
        dt,
        step,
        n_step,
        start,
        sharing,
        joint_moments,
        surroundings,
        None if imposed is None else imposed.over(times),
        plant,
        bench,
        scheme,
    )
    if initial_qvel is None and scheme.first_order:
        windows = replace(windows, start=replace(start, qvel=windows.target.qvel[0].copy()))
    windows.plant.check_motion(motion.name, reference.time, reference.qpos)
    check_passive_stability(windows)
    _check_contacts(windows)
    return windows


def _scheme(integrator: str, plant: MujocoPlant | None) -> Scheme:
    """What integrates the plant, the user's own if there is one."""
    scheme = scheme_of(integrator)
    if plant is None:
        return scheme
    if plant.hosted is not None and scheme is not RK4:
        raise SettingsError(
            f"integrator {integrator!r} does not step Hill muscles, which have a Runge-Kutta scheme of their own: "
            "leave integrator out, or use MuJoCo's muscles"
        )
    if scheme not in (RK4, plant.scheme):
        raise SettingsError(
            f"integrator {integrator!r} and a plant that is stepped by {plant.scheme.name!r}: build it with "
            f"MujocoPlant(..., integrator={integrator!r})"
        )
    return plant.scheme


def _check_contacts(windows: Windows) -> None:
    plant = windows.plant
    if plant.hosted is not None:
        return
    none = np.zeros(windows.model.nv)
    plant.set_state(State(windows.start.time, windows.start.qpos, none, np.zeros(windows.model.n_muscle), none))
    plant.set_input(None, none)
    plant.forward()
    for line in contacts_beyond_strength(windows):
        warnings.warn(line, MjhcmcWarning, stacklevel=4)


def _check_loads(loads: ExternalLoads, model: MuscleModel, motion: Motion) -> None:
    from mjhcmc.external_loads import ExternalLoads, suspicious

    if not isinstance(loads, ExternalLoads):
        raise SettingsError(f"loads must be ExternalLoads; got {type(loads).__name__}: use ExternalLoads.from_file")
    loads.check_covers(motion)
    loads.ids(model)
    for line in suspicious(loads, model, motion):
        warnings.warn(line, MjhcmcWarning, stacklevel=4)


def _check_range(
    motion: Motion, model: MuscleModel, time: NDArray[np.float64], qpos: NDArray[np.float64], what: str
) -> None:
    remedy = "check units and signs, or widen the model's range"
    if model.coupling is not None:  # where equalities put a joint is not the motion's doing
        tied = coordinates_of(model.mj_model, model.roles.dependent)
        qpos = qpos.copy()
        qpos[:, tied] = np.clip(qpos[:, tied], *model.joint_range[tied].T)
    check_joint_range(motion, model, time, qpos, what, RANGE_ALLOWANCE, remedy)


def check_flag(name: str, value: object) -> None:
    """Raise SettingsError unless a value is True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise SettingsError(f"{name} must be True or False; got {value!r}")


def _vector(name: str, given: ArrayLike | None, default: NDArray[np.float64]) -> NDArray[np.float64]:
    if given is None:
        return default.copy()
    try:
        value = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise SettingsError(f"{name} must hold {default.size} numbers; got {given!r}") from None
    if value.ndim == 0:
        value = np.full(default.shape, float(value))
    if value.shape != default.shape:
        raise SettingsError(f"{name} must hold {default.size} numbers; got shape {value.shape}")
    if not np.isfinite(value).all():
        raise SettingsError(f"{name} must hold finite numbers; got {value.tolist()}")
    return value

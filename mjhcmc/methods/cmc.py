"""CMC, computed muscle control: the method that OpenSim users know, on any MuJoCo muscle model.

After Thelen and Anderson (2006), doi 10.1016/j.jbiomech.2005.02.010, with OpenSim's choices. At the start t of each
window, from the simulated state (q, v, a), with a look-ahead T:

    q''* = q''_d(t+T) + kv (v_d(t) - v) + kp (q_d(t) - q)

The muscles are to give q''* at t+T, where the motion is expected to be: at q_d(t+T) + q - q_d(t), likewise v. The
forces that they can have there lie between those after T under no and under full excitation. The fast target gives
q''* exactly at the least cost; where the muscles cannot, the slow target trades accelerations for cost,

    minimize  |q''(a) - q''*|^2 + cost/(mean weight)   (q'' in rad/s^2, at slides in m/s^2),

unless reserves help. Excitations are the roots of F(t+T; u) = F*; they are held over the window dt.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc import dynamics
from mjhcmc.checks import is_number
from mjhcmc.emg_targets import EmgTargets
from mjhcmc.errors import MjhcmcWarning, SettingsError
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.joint_moments import JointMoments
from mjhcmc.methods.run import (
    Driver,
    Inputs,
    Progress,
    Separately,
    Team,
    needs,
    rate_at,
    reserve_price,
    run,
    static_start,
)
from mjhcmc.methods.windows import Windows, check_flag, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import MujocoPlant, State
from mjhcmc.sharing import Sharing
from mjhcmc.solution import Solution

_FEASIBLE = 1e-6  # of the acceleration that all muscles together can give: the fast target is met
_SLOW_COST = 1.0  # (rad/s^2)^2 a unit of cost: accelerations come first
_FASTEST = 50.0  # 1/s: kp = w^2, kv = 2 w, chosen by benchmarks/cmc_gains.py
_FASTEST_IN_WINDOWS = 0.8  # w dt: the held law is unstable from 1


def cmc(
    model: MuscleModel,
    motion: Motion,
    dt: float = 0.01,
    physics_dt: float = 0.001,
    initial_qpos: ArrayLike | None = None,
    initial_qvel: ArrayLike | None = None,
    initial_activation: ArrayLike | None = None,
    reserves: bool = True,
    *,
    cost: str = "effort",
    weights: Mapping[str, float] | ArrayLike | None = None,
    smoothness: float = 0.0,
    min_activation: Mapping[str, float] | ArrayLike = 0.0,
    disabled: Sequence[str] = (),
    solver: str = "newton",
    emg: EmgTargets | None = None,
    joint_moments: JointMoments | None = None,
    look_ahead: float | None = None,
    kp: float | None = None,
    kv: float | None = None,
    loads: ExternalLoads | None = None,
    plant: MujocoPlant | None = None,
    integrator: str = "rk4",
    progress: Progress | None = None,
) -> Solution:
    """Find muscle excitations by computed muscle control.

    Args:
        model: as for `hcmc`, like all arguments that are not named here.
        motion: the motion to follow.
        dt: s, control window.
        physics_dt: s, the plant's step.
        initial_qpos: (nq,) rad or m.
        initial_qvel: (nv,) rad/s or m/s.
        initial_activation: (n_muscle,) or one number.
        reserves: apply to the joints what the muscles cannot give; without, the slow target takes over.
        cost: what is least; OpenSim's CMC takes ``"capacity"``.
        weights: by muscle.
        smoothness: weight of (change of activation)^2.
        min_activation: least activation.
        disabled: names of muscles that stay switched off.
        solver: of the allocation.
        emg: measured excitations to be near.
        joint_moments: to share in place of those of inverse dynamics.
        look_ahead: s, T; dt by default, as OpenSim's CMC has one window for both (10 ms, as dt here). Rounded to
            physics steps. Longer than dt the force is on its way only, much shorter excitations chatter.
        kp: 1/s^2, position gain: 2500 by default, less where dt is above 16 ms. OpenSim's 100 follows fast movements
            less well (benchmarks/cmc_gains.py).
        kv: 1/s, velocity gain; 2 sqrt(kp), critical damping, by default.
        loads: measured forces on the model's bodies.
        plant: what is stepped.
        integrator: of the plant.
        progress: called with (windows solved, windows in all).

    Returns:
        The solution. ``shortfall`` is what the targets leave at t+T.

    Raises:
        SettingsError: as `hcmc`; a look-ahead or gain that is not a positive number; gains too fast for dt.
        MotionError: as `hcmc`.
        SimulationError: as `hcmc`.
        SolveInterrupted: as `hcmc`.
    """
    windows = prepare(
        model, motion, dt, physics_dt, initial_qpos, initial_qvel, initial_activation, joint_moments, plant,
        loads=loads, cost=cost, weights=weights, smoothness=smoothness, min_activation=min_activation,
        disabled=disabled, solver=solver, emg=emg, integrator=integrator,
    )  # fmt: skip
    method = _Cmc(reserves, _steps_ahead(look_ahead, windows), *_gains(kp, kv, windows.dt))
    return run(method, windows, progress)


def _gains(kp: float | None, kv: float | None, dt: float) -> tuple[float, float]:
    """kp and kv, with defaults that suit the window.

    Held over dt, the law q'' = -kv v - kp q is stable where kv dt < 2 and kp dt < 2 kv (Jury's conditions for the
    double integrator under a zero-order hold).
    """
    for name, value in (("kp", kp), ("kv", kv)):
        if value is not None and not (is_number(value) and 0 < value < np.inf):
            raise SettingsError(f"{name} must be a positive number; got {value!r}")
    w = min(_FASTEST, _FASTEST_IN_WINDOWS / dt) if kp is None else float(np.sqrt(kp))
    position, velocity = float(w**2 if kp is None else kp), float(2 * w if kv is None else kv)
    if velocity * dt >= 2 or position * dt >= 2 * velocity:
        raise SettingsError(
            f"kp {position:g} and kv {velocity:g} are unstable when held over dt {dt:g} s, which takes kv < {2 / dt:g} "
            "and kp < 2 kv/dt: choose smaller gains or a smaller dt"
        )
    return position, velocity


def _steps_ahead(look_ahead: float | None, windows: Windows) -> float:
    """The look-ahead, s, as a whole number of physics steps."""
    if look_ahead is None:
        return windows.dt
    if not (is_number(look_ahead) and 0 < look_ahead <= windows.motion.duration):
        raise SettingsError(
            f"look_ahead must be positive and at most the motion's {windows.motion.duration:g} s; got {look_ahead!r}"
        )
    if look_ahead < windows.dt / 2:
        warnings.warn(
            f"look_ahead {look_ahead:g} s is short for dt {windows.dt:g} s, over which excitations are held: expect "
            "them to chatter",
            MjhcmcWarning,
            stacklevel=3,
        )
    return max(1, round(look_ahead / windows.plant.physics_dt)) * windows.plant.physics_dt


@dataclass(frozen=True)
class _Cmc:
    """The method with its settings; see `cmc`."""

    reserves: bool
    look_ahead: float
    kp: float
    kv: float

    def __post_init__(self) -> None:
        check_flag("reserves", self.reserves)

    def settings(self) -> dict[str, Any]:
        """See `run.Method`."""
        own = {"reserves": self.reserves, "look_ahead": self.look_ahead, "kp": self.kp, "kv": self.kv}
        return {"method": "cmc", **own}

    def start(self, windows: Windows) -> tuple[State, Inputs]:
        """See `run.Method`."""
        return static_start(windows, reserves=self.reserves)

    def drive(self, team: Team) -> Driver:
        """See `run.Method`."""
        return Separately(team, self._window)

    def _window(self, windows: Windows, k: int, state: State, before: Inputs) -> Inputs:
        """The inputs of window k, which begins in a state, after those of the window before."""
        plant, reference, space = windows.plant, windows.target, windows.model.coordinates
        n_step = round(self.look_ahead / plant.physics_dt)
        ahead = windows.reference_at(reference.time[k] + n_step * plant.physics_dt)
        q_error, v_error = space.difference(reference.qpos[k], state.qpos), reference.qvel[k] - state.qvel
        qacc = ahead.qacc[0] + self.kv * v_error + self.kp * q_error
        if not space.all_tracked:  # feedback is for what muscles move; what is tied to it follows
            N = np.eye(space.nv) if windows.tangents is None else windows.tangents[k]
            q_error, v_error = (N[:, space.tracked] @ space.of(error) for error in (q_error, v_error))
            qacc = ahead.qacc[0] + self.kv * v_error + self.kp * q_error
        rate = rate_at(windows, state, before.reserve)
        qpos = space.moved(ahead.qpos[0], -q_error)
        lag = windows.physics_dt / 2 * ahead.qacc[0] if windows.scheme.first_order else 0.0
        expected = replace(state, time=float(ahead.time[0]), qpos=qpos, qvel=ahead.qvel[0] - lag - v_error)
        expected = windows.where_forces_act(expected, qacc)
        outlook = plant.outlook(state, expected, n_step, windows.sharing.min_activation)
        sharing = windows.sharing.unbounded  # the outlook's bounds hold the least activation
        needed = needs(windows, qpos, qacc)
        activation, lacking = self._targets(
            sharing, needed.moments, needed.Q, (outlook.low, outlook.high), needed.M, before=state.activation,
            time=float(ahead.time[0]),
        )  # fmt: skip
        lacking = space.full(lacking)
        return Inputs(
            excitation=sharing.excitation(outlook.excitation(activation)),
            reserve=lacking if self.reserves else np.zeros_like(lacking),
            shortfall=lacking,
            fastest_rate=rate,
        )

    def _targets(
        self,
        sharing: Sharing,
        moments: dynamics.MuscleMoments,
        Q: NDArray[np.float64],
        bounds: tuple[NDArray[np.float64], NDArray[np.float64]],
        M: NDArray[np.float64],
        before: NDArray[np.float64],
        time: float,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Activation (n_muscle,) and what it leaves of Q (nv,) N m: by the fast target, else by the slow one."""
        problem = sharing.problem(moments, Q, *bounds, reserve_price(M, reserves=self.reserves), before, time)
        found = sharing.allocate(problem)
        if not self.reserves and np.abs(problem.P @ found.reserve).max(initial=0.0) > _FEASIBLE:
            inverse: NDArray[np.float64] = np.asarray(np.linalg.inv(M))
            size = float(np.abs(inverse @ moments.B).sum(axis=1).max(initial=1.0))
            eps = _SLOW_COST / (size**2 * float(sharing.weights.mean()))  # of weights only ratios matter
            slow = replace(problem, P=inverse / size, eps=eps)
            found = sharing.allocate(slow)
        return found.activation, found.reserve

"""HCMC, hybrid computed muscle control: the excitations that make the muscle-driven model follow a motion.

After Inai, Takabayashi, Edama and Kubo (2020), formulated at the END of the control window: activation is chosen so
that the acceleration at the predicted end state takes its desired value. The prediction is a trial: the plant itself is
stepped over the window, and a Newton step on the end acceleration corrects the activation.

At the end (q, v, a) of a trial with excitation u and reserve s, with qacc its acceleration and h the window, what is
missing is the acceleration

    r = q''_d + kv (v_d - v) + kp (q_d - q) - qacc

A change da of activation at the window's end and ds of the reserve take X da + Y ds of it, where X and Y hold how the
end's acceleration, velocity (times kv) and position (times kp) answer (see `sensitivity`). In units of joint moment,
with N = (M + h/2 D + h^2/6 K) diag(1/c), c = 1 + kv h/2 + kp h^2/6 (what a change that grows linearly over the window
meets),

    A da + T ds = N r,        A = N X,  T = N Y

A is close to B, the joint moments at full activation. The allocation shares B a + T s = Q among the muscles and Q is
moved until A da + T ds = N r holds: sharing by A itself would prefer muscles for how they answer within one window, and
where some saturate it would spend the others on joints that they do not cross. u* is the excitation that reaches a*.
"""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc import dynamics
from mjhcmc.allocation import allocate, build_problem
from mjhcmc.errors import MjhcmcWarning, SettingsError, SimulationError
from mjhcmc.methods.windows import Progress, Record, SolveInterrupted, Windows, decay_rate, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import MujocoPlant, State
from mjhcmc.sensitivity import build_up, window_response
from mjhcmc.solution import Solution

_FINER_TRIES = 2  # a simulation that diverges is solved again with a quarter of the step, and a sixteenth
_LARGEST_GAIN = 3.0  # beyond, the sampled error rings or grows
_MOST_REFINEMENTS = 4
_REFINED = 1e-2  # of what a trial misses: the next trial, or the window itself, shows the rest


def hcmc(
    model: MuscleModel,
    motion: Motion,
    dt: float = 0.01,
    physics_dt: float = 0.001,
    initial_qpos: ArrayLike | None = None,
    initial_qvel: ArrayLike | None = None,
    initial_activation: ArrayLike | None = None,
    reserves: bool = True,
    *,
    trials: int = 2,
    gain: float = 2.7,
    authority: float = 0.15,
    solver: str = "newton",
    plant: MujocoPlant | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Find the muscle excitations that make the muscle-driven model follow a motion.

    Args:
        model: the model.
        motion: the motion to follow.
        dt: s, control window: excitation is constant over it.
        physics_dt: s, the plant's step; rounded down to a divisor of dt.
        initial_qpos: (nq,) rad or m; the motion's by default.
        initial_qvel: (nv,) rad/s or m/s; the motion's by default.
        initial_activation: (n_muscle,) or one number; by default the allocation of the first desired acceleration.
        reserves: apply to the joints what the muscles cannot give. Without, the muscles do what they can.
        trials: trial windows for each control window.
        gain: feedback bandwidth times dt: errors are to vanish in about dt/gain. Beyond 3 excitations ring.
        authority: share of the muscles' acceleration that feedback may ask for.
        solver: ``"newton"``, or a qpsolvers back end.
        plant: what is stepped; the model in MuJoCo by default.
        progress: called with (windows solved, windows in all).

    Returns:
        The solution; a window that cannot be met is solved with reserves and flagged in its status.

    Raises:
        SettingsError: a setting outside its valid values.
        MotionError: the motion does not fit the model.
        SimulationError: the physics step is unstable under the model's passive damping; or the simulation diverged,
            also with a quarter and a sixteenth of the step (an `MjhcmcWarning` tells of each; a plant that was handed
            in keeps its step). Its ``solution`` holds what was solved before, marked interrupted.
        SolveInterrupted: a KeyboardInterrupt came; it carries what was solved.
    """
    settings = _Settings(reserves, trials, gain, authority, solver)
    windows = prepare(model, motion, dt, physics_dt, initial_qpos, initial_qvel, initial_activation, plant)
    for _ in range(_FINER_TRIES):
        try:
            return _solve(windows, settings, progress)
        except SimulationError as error:
            if plant is not None:  # its step is not ours to change
                raise
            step = windows.plant.physics_dt / 4
            warnings.warn(f"{error}; it is solved again with physics_dt {step:.2g} s", MjhcmcWarning, stacklevel=2)
            windows = replace(windows, plant=MujocoPlant(model, step), n_step=4 * windows.n_step)
    return _solve(windows, settings, progress)


def _solve(windows: Windows, settings: _Settings, progress: Progress | None) -> Solution:
    """All windows, one after another; raises as `hcmc` does."""
    model = windows.model
    start, reserve = _start(windows, settings)
    aim = _Aim(
        excitation=np.clip(start.activation, *model.excitation_range.T),
        reserve=reserve if settings.reserves else np.zeros(model.nv),
        shortfall=reserve,
        fastest_rate=0.0,
    )
    record = Record(windows, {"method": "hcmc", **asdict(settings)}, [start])
    try:
        for k in range(windows.count):
            aim = _aim(windows, k, record.states[-1], aim, settings)
            windows.plant.set_state(record.states[-1])
            windows.plant.advance(aim.excitation, aim.reserve, windows.n_step)
            end = replace(windows.plant.get_state(), time=float(windows.reference.time[k + 1]))
            record.window(aim.excitation, aim.reserve, aim.shortfall, aim.fastest_rate, end)
            if progress is not None:
                progress(k + 1, windows.count)
        return record.solution()
    except SimulationError as error:
        error.solution = record.solution(interrupted=True) if record.count else None
        raise
    except KeyboardInterrupt as interrupt:
        partly = record.count < windows.count
        raise SolveInterrupted(record.solution(interrupted=partly) if record.count else None) from interrupt


@dataclass(frozen=True)
class _Settings:
    """The method's own settings; see `hcmc`."""

    reserves: bool
    trials: int
    gain: float
    authority: float
    solver: str

    def __post_init__(self) -> None:
        if not isinstance(self.reserves, (bool, np.bool_)):
            raise SettingsError(f"reserves must be True or False; got {self.reserves!r}")
        if not isinstance(self.trials, (int, np.integer)) or self.trials < 1:
            raise SettingsError(f"trials must be at least 1; got {self.trials!r}")
        for name, most in (("gain", _LARGEST_GAIN), ("authority", 1.0)):
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and 0 < value <= most):
                raise SettingsError(f"{name} must be positive and at most {most:g}; got {value!r}")

    def price(self, M: NDArray[np.float64]) -> NDArray[np.float64]:
        """(nv, nv) kg m^2, the inertia by which reserves are priced (see `build_problem`).

        Reserves that are applied are motors, one a joint: each is priced by what it is worth at its own joint, so that
        a joint whose muscles suffice needs none. Where nothing fills the gap the joints share it, and by Gauss's
        principle the shares are those that change the accelerations least; the leg comes back from a wrong start by it.
        """
        return np.diag(np.diag(M)) if self.reserves else M


@dataclass(frozen=True)
class _Aim:
    """What one window is driven with.

    Attributes:
        excitation: (n_muscle,).
        reserve: (nv,) N m, applied.
        shortfall: (nv,) N m, what the muscles cannot give.
        fastest_rate: 1/s, decay rate of the velocities at the end of the last trial.
    """

    excitation: NDArray[np.float64]
    reserve: NDArray[np.float64]
    shortfall: NDArray[np.float64]
    fastest_rate: float


def _start(windows: Windows, settings: _Settings) -> tuple[State, NDArray[np.float64]]:
    """The first state, with the static allocation of the first desired acceleration where none was given.

    Returns:
        The state, and the reserve (nv,) N m of that allocation.
    """
    plant, model, start = windows.plant, windows.model, windows.start
    given = np.isfinite(start.activation).all()
    plant.set_state(start if given else replace(start, activation=np.zeros(model.n_muscle)))
    plant.set_input(None, np.zeros(model.nv))
    plant.forward()
    moments = dynamics.muscle_moments(plant)
    Q = dynamics.required_moment(plant, windows.reference.qacc[0], moments.p)
    low, high = model.excitation_range.T
    price = settings.price(dynamics.mass_matrix(plant))
    found = allocate(build_problem(moments.B, Q, low, high, inertia=price), settings.solver)
    return (start if given else replace(start, activation=found.activation)), found.reserve


def _feedback(
    windows: Windows, k: int, state: State, reserve: NDArray[np.float64], settings: _Settings
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gains kp (nv,) 1/s^2 and kv (nv,) 1/s of window k, from the error at its start.

    As fast as gain/h and no faster than the joint can follow: kp = w^2, kv = 2 w,
    w_j = min(gain/h, alpha_j/(|e'_j| + sqrt(e'_j^2 + alpha_j |e_j|))), so that w^2 |e| + 2 w |e'| <= alpha_j.
    At w = gain/h, kv is 2 w (1 - gain/6): aiming at the end of the window damps by itself, and critical damping would
    make the sampled error ring (largest root at gain 2.7: .44 against -.72; at 3: .5 against -.84).
    alpha_j is a share of the smaller of the accelerations that full activation gives the joint either way. Where
    reserves help it is at least the rms of q''_d, or a motion beyond the muscles would be fed forward and not fed
    back. A joint that nothing limits keeps gain/h.
    """
    plant, reference = windows.plant, windows.reference
    plant.set_state(state)
    plant.set_input(None, reserve)
    plant.forward()
    reach = np.linalg.solve(dynamics.mass_matrix(plant), dynamics.muscle_moments(plant).B)
    alpha = settings.authority * np.minimum(np.maximum(reach, 0).sum(axis=1), np.maximum(-reach, 0).sum(axis=1))
    if settings.reserves:
        alpha = np.maximum(alpha, np.sqrt((reference.qacc**2).mean(axis=0)))
    e = np.abs(reference.qpos[k] - state.qpos)
    e_rate = np.abs(reference.qvel[k] - state.qvel)
    denominator = e_rate + np.sqrt(e_rate**2 + alpha * e)
    limited = (denominator > 0) & (alpha > 0)
    fastest = settings.gain / windows.dt
    w = np.full(windows.model.nv, fastest)
    w[limited] = np.minimum(w[limited], alpha[limited] / denominator[limited])
    return w**2, 2 * w * np.where(w < fastest, 1.0, 1 - settings.gain / 6)


def _aim(windows: Windows, k: int, start: State, aim: _Aim, settings: _Settings) -> _Aim:
    """The aim of window k, corrected by trial windows from that of the window before (see the module's docstring)."""
    plant, reference, h = windows.plant, windows.reference, windows.dt
    prm, n = plant.model.activation_parameters, plant.model.n_muscle
    kp, kv = _feedback(windows, k, start, aim.reserve, settings)
    c = 1 + kv * h / 2 + kp * h**2 / 6
    lb, ub = plant.reachable(start.activation, windows.n_step)
    for _ in range(settings.trials):
        plant.set_state(start)
        plant.advance(aim.excitation, aim.reserve, windows.n_step)
        end = plant.get_state()
        qacc = plant.forward().copy()
        if not (np.isfinite(qacc).all() and np.isfinite(end.activation).all()):
            raise SimulationError(
                f"the simulation diverged in the window at {reference.time[k]:.4g} s: use physics_dt <= "
                f"{plant.physics_dt / 2:.2g}, or filter the motion"
            )
        B = dynamics.muscle_moments(plant).B
        M = dynamics.mass_matrix(plant)
        D, K = dynamics.damping_and_stiffness(plant)
        v_error, q_error = reference.qvel[k + 1] - end.qvel, reference.qpos[k + 1] - end.qpos
        r = reference.qacc[k + 1] + kv * v_error + kp * q_error - qacc

        phi = build_up(start.activation, aim.excitation, prm, plant.physics_dt, windows.n_step)
        response = window_response(M, D, K, B, phi, plant.physics_dt)
        answer = response.qacc + kv[:, None] * response.qvel + kp[:, None] * response.qpos
        N = (M + h / 2 * D + h**2 / 6 * K) / c
        A, T = N @ answer[:, :n], N @ answer[:, n:]
        missing = wanted = N @ r
        Q = B @ end.activation + T @ aim.reserve
        for _ in range(_MOST_REFINEMENTS):
            Q = Q + missing
            found = allocate(build_problem(B, Q, lb, ub, inertia=settings.price(M)), settings.solver)
            missing = wanted - A @ (found.activation - end.activation) - (found.reserve - T @ aim.reserve)
            if np.abs(missing).max(initial=0.0) <= _REFINED * np.abs(wanted).max(initial=0.0):
                break

        shortfall = np.asarray(np.linalg.solve(T, found.reserve))
        aim = _Aim(
            excitation=plant.excitation_reaching(start.activation, found.activation, windows.n_step),
            reserve=shortfall if settings.reserves else np.zeros_like(shortfall),
            shortfall=shortfall,
            fastest_rate=decay_rate(M, D),
        )
    return aim

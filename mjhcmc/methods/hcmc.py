"""HCMC, hybrid computed muscle control: the excitations that make the muscle-driven model follow a motion.

After Inai, Takabayashi, Edama and Kubo (2020), formulated at the END of the control window: activation is chosen so
that the acceleration at the predicted end state takes its desired value. The prediction is a trial: the plant itself is
stepped over the window, and a Newton step on the end acceleration corrects the activation.

At the end (q, v, a) of a trial with excitation u and reserve s, with qacc its acceleration and h the window:

    qacc_d = q''_d + kv (v_d - v) + kp (q_d - q)
    d      = (qacc_d - qacc)/c,                    c = 1 + kv h/2 + kp h^2/6
    B (a* - a) + T (s* - s) = E d,                 E = M + h/2 D + h^2/6 K

D = -dF/dv and K = -dF/dq of all smooth forces at fixed activation; a change of acceleration that grows linearly over
the window changes v by h/2 d and q by h^2/6 d at its end, hence c and the effective mass E. A reserve is constant over
the window: it changes v by h d and q by h^2/2 d, hence T = E diag(c_s/c) E_s^-1 with c_s = 1 + kv h + kp h^2/2 and
E_s = M + h D + h^2/2 K. The allocation finds a* within what activation can reach, and u* is the excitation that
reaches it; its slack is T s*.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc import dynamics
from mjhcmc.allocation import allocate, build_problem
from mjhcmc.errors import SettingsError
from mjhcmc.methods.windows import Progress, Record, SolveInterrupted, Windows, decay_rate, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import MujocoPlant, State
from mjhcmc.solution import Solution


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
    gain: float = 2.0,
    authority: float = 0.3,
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
        gain: feedback bandwidth times dt: errors are to vanish in about dt/gain.
        authority: share of the muscles' acceleration that feedback may ask for.
        solver: ``"newton"``, or a qpsolvers back end.
        plant: what is stepped; the model in MuJoCo by default.
        progress: called with (windows solved, windows in all).

    Returns:
        The solution; a window that cannot be met is solved with reserves and flagged in its status.

    Raises:
        SettingsError: a setting outside its valid values.
        MotionError: the motion does not fit the model.
        SimulationError: the physics step is unstable, or the simulation diverged.
        SolveInterrupted: a KeyboardInterrupt came; it carries what was solved.
    """
    if trials < 1:
        raise SettingsError(f"trials must be at least 1; got {trials}")
    for name, value in (("gain", gain), ("authority", authority)):
        if not (np.isfinite(value) and value > 0):
            raise SettingsError(f"{name} must be positive; got {value}")
    windows = prepare(model, motion, dt, physics_dt, initial_qpos, initial_qvel, initial_activation, plant)
    settings = {
        "method": "hcmc",
        "reserves": reserves,
        "trials": trials,
        "gain": gain,
        "authority": authority,
        "solver": solver,
    }
    start, s = initial_activation_for(windows, solver)
    s = s if reserves else np.zeros(model.nv)
    u = np.clip(start.activation, model.excitation_range[:, 0], model.excitation_range[:, 1])
    record = Record(windows, states=[start])
    try:
        for k in range(windows.count):
            feedback = Feedback.at(windows, k, record.states[-1], s, gain, authority)
            aim = _aim(windows, k, record.states[-1], u, s, feedback, trials, solver, reserves)
            u, s = aim.excitation, aim.reserve
            windows.plant.set_state(record.states[-1])
            windows.plant.advance(u, s, windows.n_step)
            end = replace(windows.plant.get_state(), time=float(windows.reference.time[k + 1]))
            record.window(u, s, aim.shortfall, aim.fastest_rate, end)
            if progress is not None:
                progress(k + 1, windows.count)
    except KeyboardInterrupt as interrupt:
        done = record.solution(settings, interrupted=True) if record.excitation else None
        raise SolveInterrupted(done) from interrupt
    return record.solution(settings)


def initial_activation_for(windows: Windows, solver: str) -> tuple[State, NDArray[np.float64]]:
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
    found = allocate(build_problem(moments.B, Q, low, high, inertia=dynamics.mass_matrix(plant)), solver)
    return (start if given else replace(start, activation=found.activation)), found.reserve


@dataclass(frozen=True)
class Feedback:
    """Gains of one window, chosen from the error at its start.

    Attributes:
        kp: (nv,) 1/s^2.
        kv: (nv,) 1/s.
    """

    kp: NDArray[np.float64]
    kv: NDArray[np.float64]

    @classmethod
    def at(
        cls,
        windows: Windows,
        k: int,
        state: State,
        reserve: NDArray[np.float64],
        gain: float,
        authority: float,
    ) -> Feedback:
        """Critically damped, as fast as gain/h and no faster than the muscles can follow, joint by joint.

        kp = w^2, kv = 2 w, w_j = min(gain/h, alpha_j/(|e'_j| + sqrt(e'_j^2 + alpha_j |e_j|))): w^2 |e| + 2 w |e'| then
        asks for at most alpha_j, the given share of the smaller of the accelerations that full activation gives the
        joint either way. A joint that no muscle moves belongs to its reserve and keeps gain/h.

        Args:
            windows: the solve.
            k: the window's index.
            state: at its start.
            reserve: (nv,) N m, held in the window before.
            gain: see `hcmc`.
            authority: see `hcmc`.
        """
        plant = windows.plant
        plant.set_state(state)
        plant.set_input(None, reserve)
        plant.forward()
        reach = np.linalg.solve(dynamics.mass_matrix(plant), dynamics.muscle_moments(plant).B)
        alpha = authority * np.minimum(np.maximum(reach, 0).sum(axis=1), np.maximum(-reach, 0).sum(axis=1))
        e = np.abs(windows.reference.qpos[k] - state.qpos)
        e_rate = np.abs(windows.reference.qvel[k] - state.qvel)
        fastest = gain / windows.dt
        denominator = e_rate + np.sqrt(e_rate**2 + alpha * e)
        limited = (denominator > 0) & (alpha > 0)
        w = np.full(windows.model.nv, fastest)
        w[limited] = np.minimum(fastest, alpha[limited] / denominator[limited])
        return cls(kp=w**2, kv=2 * w)


@dataclass(frozen=True)
class _Aim:
    excitation: NDArray[np.float64]
    reserve: NDArray[np.float64]
    shortfall: NDArray[np.float64]
    fastest_rate: float


def _aim(
    windows: Windows,
    k: int,
    start: State,
    u: NDArray[np.float64],
    s: NDArray[np.float64],
    feedback: Feedback,
    trials: int,
    solver: str,
    reserves: bool,
) -> _Aim:
    """Excitation and reserve of window k, corrected by trial windows; the equations are in the module's docstring."""
    plant, reference, h = windows.plant, windows.reference, windows.dt
    kp, kv = feedback.kp, feedback.kv
    c = 1 + kv * h / 2 + kp * h**2 / 6
    c_reserve = 1 + kv * h + kp * h**2 / 2
    lb, ub = plant.reachable(start.activation, windows.n_step)
    shortfall, rate = s, 0.0
    for _ in range(trials):
        plant.set_state(start)
        plant.advance(u, s, windows.n_step)
        end = plant.get_state()
        qacc = plant.forward().copy()
        moments = dynamics.muscle_moments(plant)
        M = dynamics.mass_matrix(plant)
        D, K = dynamics.damping_and_stiffness(plant)
        rate = decay_rate(M, D)
        qacc_desired = (
            reference.qacc[k + 1] + kv * (reference.qvel[k + 1] - end.qvel) + kp * (reference.qpos[k + 1] - end.qpos)
        )
        E = M + h / 2 * D + h**2 / 6 * K
        E_reserve = M + h * D + h**2 / 2 * K
        T = (E * (c_reserve / c)) @ np.linalg.inv(E_reserve)
        Q = moments.B @ end.activation + T @ s + E @ ((qacc_desired - qacc) / c)
        found = allocate(build_problem(moments.B, Q, lb, ub, inertia=M), solver)
        shortfall = np.linalg.solve(T, found.reserve)
        s = shortfall if reserves else np.zeros_like(s)
        u = plant.excitation_reaching(start.activation, found.activation, windows.n_step)
    return _Aim(u, s, shortfall, rate)

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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc import dynamics
from mjhcmc.errors import DivergedError, SettingsError
from mjhcmc.joint_moments import JointMoments
from mjhcmc.methods.run import Inputs, Progress, reserve_price, run, static_start
from mjhcmc.methods.windows import Windows, check_flag, decay_rate, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import MujocoPlant, State
from mjhcmc.sensitivity import build_up, window_response
from mjhcmc.sharing import Sharing, share
from mjhcmc.solution import Solution

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
    cost: str = "effort",
    weights: Mapping[str, float] | ArrayLike | None = None,
    smoothness: float = 0.0,
    min_activation: Mapping[str, float] | ArrayLike = 0.0,
    disabled: Sequence[str] = (),
    solver: str = "newton",
    joint_moments: JointMoments | None = None,
    trials: int = 2,
    gain: float = 2.7,
    authority: float = 0.15,
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
        cost: what is least where muscles can share: ``"effort"`` (sum a^2), ``"cubic"`` (sum a^3), ``"volume"``
            (sum V a^2), ``"stress"`` (sum (F/F0)^2) or ``"capacity"`` (sum (F/gain)^2); see `sharing`.
        weights: more for muscles that are to do less: by muscle name (1 for the others), or (n_muscle,); positive.
        smoothness: weight of (change of activation over a window)^2 beside the cost; 0: none.
        min_activation: least activation: one number, by muscle name, or (n_muscle,).
        disabled: names of muscles that stay switched off; their passive force stays.
        solver: ``"newton"``, or for quadratic costs a qpsolvers back end.
        joint_moments: net joint moments to share among the muscles in place of those of inverse dynamics; what they
            imply to act from outside is applied to the plant (see `joint_moments`).
        trials: trial windows for each control window.
        gain: feedback bandwidth times dt: errors are to vanish in about dt/gain. Beyond 3 excitations ring.
        authority: share of the muscles' acceleration that feedback may ask for.
        plant: what is stepped; the model in MuJoCo by default.
        progress: called with (windows solved, windows in all).

    Returns:
        The solution; a window that cannot be met is solved with reserves and flagged in its status.

    Raises:
        SettingsError: a setting outside its valid values.
        MotionError: the motion does not fit the model, or the joint moments do not cover it.
        SimulationError: the physics step is unstable under the model's passive damping; or the simulation diverged,
            also with a quarter and a sixteenth of the step (an `MjhcmcWarning` tells of each; a plant that was handed
            in keeps its step). Its ``solution`` holds what was solved before, marked interrupted.
        SolveInterrupted: a KeyboardInterrupt came; it carries what was solved.
    """
    windows = prepare(
        model, motion, dt, physics_dt, initial_qpos, initial_qvel, initial_activation, joint_moments, plant
    )
    sharing = share(model, cost, weights, smoothness, min_activation, disabled, solver)
    method = _Hcmc(sharing, reserves, trials, gain, authority)
    return run(method, windows, progress, own_plant=plant is not None)


@dataclass(frozen=True)
class _Hcmc:
    """The method with its settings; see `hcmc`."""

    sharing: Sharing
    reserves: bool
    trials: int
    gain: float
    authority: float

    def __post_init__(self) -> None:
        check_flag("reserves", self.reserves)
        if not isinstance(self.trials, (int, np.integer)) or self.trials < 1:
            raise SettingsError(f"trials must be at least 1; got {self.trials!r}")
        for name, most in (("gain", _LARGEST_GAIN), ("authority", 1.0)):
            value = getattr(self, name)
            if not (isinstance(value, (int, float, np.integer, np.floating)) and 0 < value <= most):
                raise SettingsError(f"{name} must be positive and at most {most:g}; got {value!r}")

    def settings(self) -> dict[str, Any]:
        """See `run.Method`."""
        own = {"reserves": self.reserves, "trials": self.trials, "gain": self.gain, "authority": self.authority}
        return {"method": "hcmc", **self.sharing.options, **own}

    def start(self, windows: Windows) -> tuple[State, Inputs]:
        """See `run.Method`."""
        return static_start(windows, self.sharing, reserves=self.reserves)

    def window(self, windows: Windows, k: int, state: State, before: Inputs) -> Inputs:
        """See `run.Method`: corrected by trial windows from the window before, see the module's docstring."""
        plant, reference, h = windows.plant, windows.reference, windows.dt
        prm, n = plant.model.activation_parameters, plant.model.n_muscle
        kp, kv = _feedback(windows, k, state, before.reserve, self)
        c = 1 + kv * h / 2 + kp * h**2 / 6
        lb, ub = plant.reachable(state.activation, windows.n_step)
        for _ in range(self.trials):
            plant.set_state(state)
            plant.advance(before.excitation, before.reserve, windows.n_step)
            end = plant.get_state()
            qacc = plant.forward().copy()
            if not (np.isfinite(qacc).all() and np.isfinite(end.activation).all()):
                raise DivergedError(
                    f"the simulation diverged in the window at {reference.time[k]:.4g} s: use physics_dt <= "
                    f"{plant.physics_dt / 2:.2g}, or filter the motion"
                )
            moments = dynamics.muscle_moments(plant)
            B = moments.B
            M = dynamics.mass_matrix(plant)
            D, K = dynamics.damping_and_stiffness(plant)
            v_error, q_error = reference.qvel[k + 1] - end.qvel, reference.qpos[k + 1] - end.qpos
            r = reference.qacc[k + 1] + kv * v_error + kp * q_error - qacc

            phi = build_up(state.activation, before.excitation, prm, plant.physics_dt, windows.n_step)
            response = window_response(M, D, K, B, phi, plant.physics_dt)
            answer = response.qacc + kv[:, None] * response.qvel + kp[:, None] * response.qpos
            N = (M + h / 2 * D + h**2 / 6 * K) / c
            A, T = N @ answer[:, :n], N @ answer[:, n:]
            missing = wanted = N @ r
            Q = B @ end.activation + T @ before.reserve
            price = reserve_price(M, reserves=self.reserves)
            for _ in range(_MOST_REFINEMENTS):
                Q = Q + missing
                found = self.sharing.allocate(self.sharing.problem(moments, Q, lb, ub, price, state.activation))
                missing = wanted - A @ (found.activation - end.activation) - (found.reserve - T @ before.reserve)
                if np.abs(missing).max(initial=0.0) <= _REFINED * np.abs(wanted).max(initial=0.0):
                    break

            shortfall = np.asarray(np.linalg.solve(T, found.reserve))
            before = Inputs(
                excitation=self.sharing.excitation(
                    plant.excitation_reaching(state.activation, found.activation, windows.n_step)
                ),
                reserve=shortfall if self.reserves else np.zeros_like(shortfall),
                shortfall=shortfall,
                fastest_rate=decay_rate(M, D),
            )
        return before


def _feedback(
    windows: Windows, k: int, state: State, reserve: NDArray[np.float64], settings: _Hcmc
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
    alpha = float(settings.authority) * np.minimum(np.maximum(reach, 0).sum(axis=1), np.maximum(-reach, 0).sum(axis=1))
    if settings.reserves:
        alpha = np.maximum(alpha, np.sqrt((reference.qacc**2).mean(axis=0)))
    e = np.abs(reference.qpos[k] - state.qpos)
    e_rate = np.abs(reference.qvel[k] - state.qvel)
    denominator = e_rate + np.sqrt(e_rate**2 + alpha * e)
    limited = (denominator > 0) & (alpha > 0)
    gain = float(settings.gain)
    fastest = gain / windows.dt
    w = np.full(windows.model.nv, fastest)
    w[limited] = np.minimum(w[limited], alpha[limited] / denominator[limited])
    return w**2, 2 * w * np.where(w < fastest, 1.0, 1 - gain / 6)

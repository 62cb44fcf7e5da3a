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

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc import dynamics
from mjhcmc.errors import DivergedError, SettingsError
from mjhcmc.joint_moments import JointMoments
from mjhcmc.methods.correction import Trial, correct
from mjhcmc.methods.run import Inputs, Progress, run, static_start
from mjhcmc.methods.windows import Windows, check_flag, decay_rate, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import RK4_LIMIT, MujocoPlant, State
from mjhcmc.sharing import Sharing, share
from mjhcmc.small_linear import solve_in_place
from mjhcmc.solution import Solution

_LARGEST_GAIN = 3.0  # beyond, the sampled error rings or grows


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
        plant, reference = windows.plant, windows.reference
        prm = plant.model.activation_parameters
        kp, kv = _feedback(windows, k, state, before.reserve, self)
        lb, ub = plant.reachable(state.activation, windows.n_step)
        for _ in range(self.trials):
            plant.set_state(state)
            plant.advance(before.excitation, before.reserve, windows.n_step)
            end = plant.get_state()
            qacc = plant.forward().copy()
            moments = dynamics.muscle_moments(plant, damping=self.sharing.counts_forces)
            M = dynamics.mass_matrix(plant)
            D, K = dynamics.damping_and_stiffness(plant)
            if not all(np.isfinite(part).all() for part in (qacc, end.activation, D, K)):
                raise DivergedError(
                    f"the simulation diverged in the window at {reference.time[k]:.4g} s: use physics_dt <= "
                    f"{plant.physics_dt / 2:.2g}, or filter the motion"
                )
            v_error, q_error = reference.qvel[k + 1] - end.qvel, reference.qpos[k + 1] - end.qpos
            r = reference.qacc[k + 1] + kv * v_error + kp * q_error - qacc

            trial = Trial(
                state.activation, before.excitation, before.reserve, end.activation, r, moments, M, D, K, kp, kv,
                lb, ub, prm, plant.physics_dt, windows.n_step,
            )  # fmt: skip
            activation, shortfall = correct(trial, self.sharing, reserves=self.reserves)
            before = Inputs(
                excitation=self.sharing.excitation(
                    plant.excitation_reaching(state.activation, activation, windows.n_step)
                ),
                reserve=shortfall if self.reserves else np.zeros_like(shortfall),
                shortfall=shortfall,
                fastest_rate=decay_rate(M, D, RK4_LIMIT / plant.physics_dt),
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
    B = dynamics.muscle_moments(plant, damping=False).B
    least = windows.rms_qacc if settings.reserves else np.zeros(windows.model.nv)
    q_error, v_error = reference.qpos[k] - state.qpos, reference.qvel[k] - state.qvel
    kp, kv = np.empty_like(least), np.empty_like(least)
    _fill_gains(
        dynamics.mass_matrix(plant), B, q_error, v_error, least, float(settings.authority), float(settings.gain),
        windows.dt, kp, kv,
    )  # fmt: skip
    return kp, kv


@numba.njit(cache=True, error_model="numpy")
def _fill_gains(M, B, q_error, v_error, least, authority, gain, h, kp, kv):  # type: ignore[no-untyped-def]
    used, reach = np.empty_like(M), np.empty(B.shape)
    for j in range(B.shape[0]):
        for i in range(B.shape[0]):
            used[j, i] = M[j, i]
        for i in range(B.shape[1]):
            reach[j, i] = B[j, i]
    solve_in_place(used, reach)
    for j in range(least.size):
        up, down = 0.0, 0.0
        for i in range(B.shape[1]):
            up += max(reach[j, i], 0.0)
            down += max(-reach[j, i], 0.0)
        alpha = max(authority * min(up, down), least[j])
        e, e_rate = abs(q_error[j]), abs(v_error[j])
        denominator = e_rate + np.sqrt(e_rate * e_rate + alpha * e)
        w = gain / h
        damped = 1.0 - gain / 6.0
        if denominator > 0.0 and alpha > 0.0 and alpha / denominator < w:
            w, damped = alpha / denominator, 1.0
        kp[j] = w * w
        kv[j] = 2.0 * w * damped

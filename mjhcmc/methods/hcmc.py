"""HCMC, hybrid computed muscle control: the excitations that make the muscle-driven model follow a motion.

After Inai, Takabayashi, Edama and Kubo (2020), formulated at the END of the control window: activation is chosen so
that the acceleration at the window's end takes its desired value. A window goes in three:

1. *Expect.* Where the window should end follows from the desired motion and the feedback (see `HcmcDriver._aim`). There
   M, the muscles' moments and the slopes D, K of all forces are looked at, and activation is allocated for the
   acceleration wanted there.
2. *Try.* The plant itself is stepped over the window with that, about twice as coarsely, and a Newton step on the
   acceleration at the end corrects the activation.
3. *Step*, and look: where the end still misses the wanted acceleration by more than a tolerance, correct, step again.

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
from numpy.typing import ArrayLike

from mjhcmc.checks import is_number
from mjhcmc.emg_targets import EmgTargets
from mjhcmc.errors import SettingsError
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.imposed import Imposed
from mjhcmc.joint_moments import JointMoments
from mjhcmc.methods.hcmc_driver import HcmcDriver
from mjhcmc.methods.run import Driver, Inputs, Progress, Team, run, static_start
from mjhcmc.methods.windows import Windows, check_flag, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import MujocoPlant, State
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
    emg: EmgTargets | None = None,
    joint_moments: JointMoments | None = None,
    trials: int = 2,
    tolerance: float = 0.1,
    gain: float = 2.7,
    authority: float = 0.15,
    loads: ExternalLoads | None = None,
    imposed: Imposed | None = None,
    plant: MujocoPlant | None = None,
    integrator: str = "rk4",
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
        emg: measured excitations that the muscles' activation is to be near, see `emg_targets`.
        joint_moments: net joint moments to share among the muscles in place of those of inverse dynamics; what they
            imply to act from outside is applied to the plant (see `joint_moments`).
        trials: most corrections of a window, each after a trial of it.
        tolerance: a window is kept when the acceleration at its end misses by less than this share of the desired
            acceleration's rms, at every joint; 0: after ``trials`` corrections. Below 10 ms it goes with dt^2, as the
            method's own error does.
        gain: feedback bandwidth times dt: errors are to vanish in about dt/gain. Beyond 3 excitations ring.
        authority: share of the muscles' acceleration that feedback may ask for.
        loads: measured forces on the model's bodies, such as ground reactions (see `ExternalLoads`).
        imposed: excitation that muscles receive in any case, such as reflexes: they do not go below it.
        plant: what is stepped; the model in MuJoCo by default.
        integrator: of the plant: ``"rk4"``, ``"euler"``, ``"implicit"`` or ``"implicitfast"``, as MuJoCo has them; see
            `integrators`. A plant that is handed in keeps its own.
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
        model, motion, dt, physics_dt, initial_qpos, initial_qvel, initial_activation, joint_moments, plant,
        loads=loads, imposed=imposed, cost=cost, weights=weights, smoothness=smoothness, min_activation=min_activation,
        disabled=disabled, solver=solver, emg=emg, integrator=integrator,
    )  # fmt: skip
    return run(Hcmc(reserves, trials, tolerance, gain, authority), windows, progress)


@dataclass(frozen=True)
class Hcmc:
    """The method with its settings; see `hcmc`.

    Attributes:
        reserves: see `hcmc`, as the rest.
        trials: at least 1.
        tolerance: 0 or positive.
        gain: positive, at most 3.
        authority: positive, at most 1.
        threads: to compute on.
    """

    reserves: bool
    trials: int
    tolerance: float
    gain: float
    authority: float
    threads: int = 1

    def __post_init__(self) -> None:
        """Check the settings."""
        check_flag("reserves", self.reserves)
        if not isinstance(self.trials, (int, np.integer)) or isinstance(self.trials, bool) or self.trials < 1:
            raise SettingsError(f"trials must be at least 1; got {self.trials!r}")
        if not (is_number(self.tolerance) and 0 <= self.tolerance < np.inf):
            raise SettingsError(f"tolerance must be 0 or positive; got {self.tolerance!r}")
        for name, most in (("gain", _LARGEST_GAIN), ("authority", 1.0)):
            value = getattr(self, name)
            if not (is_number(value) and 0 < value <= most):
                raise SettingsError(f"{name} must be positive and at most {most:g}; got {value!r}")

    def settings(self) -> dict[str, Any]:
        """See `run.Method`."""
        names = ("reserves", "trials", "tolerance", "gain", "authority")
        return {"method": "hcmc"} | {name: getattr(self, name) for name in names}

    def start(self, windows: Windows) -> tuple[State, Inputs]:
        """See `run.Method`."""
        return static_start(windows, reserves=self.reserves)

    def drive(self, team: Team) -> Driver:
        """See `run.Method`."""
        own = team.windows[0].own_plant
        if own is not None and own.hosted is not None:
            from mjhcmc.methods.force_driver import ForceDriver

            return ForceDriver(self, team)
        return HcmcDriver(self, team)

"""CMC, computed muscle control: the method that OpenSim users know, on any MuJoCo muscle model.

After Thelen and Anderson (2006), doi 10.1016/j.jbiomech.2005.02.010, with OpenSim's choices. At the start t of each
window, from the simulated state (q, v, a), with a look-ahead T:

    q''* = q''_d(t+T) + kv (v_d(t) - v) + kp (q_d(t) - q)

The muscles are to give q''* at t+T, where the motion is expected to be: at q_d(t+T) + q - q_d(t), likewise v. The
forces that they can have there lie between those after T under no and under full excitation. The fast target gives
q''* exactly at the least cost; where the muscles cannot, the slow target trades accelerations for cost,

    minimize  |q''(a) - q''*|^2 + sum w (a - a0)^2,

unless reserves help. Excitations are the roots of F(t+T; u) = F*; they are held over the window dt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc import dynamics
from mjhcmc.errors import SettingsError
from mjhcmc.joint_moments import JointMoments
from mjhcmc.methods.run import Inputs, Progress, reserve_price, run, static_start
from mjhcmc.methods.windows import Windows, check_flag, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import MujocoPlant, State
from mjhcmc.sharing import Sharing, share
from mjhcmc.solution import Solution

LOOK_AHEAD = 0.01
"""s, OpenSim's default."""

_FEASIBLE = 1e-6  # of the acceleration that all muscles together can give: the fast target is met
_SLOW_COST = 1.0  # (rad/s^2)^2 a unit of cost: accelerations come first


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
    joint_moments: JointMoments | None = None,
    look_ahead: float = LOOK_AHEAD,
    kp: float = 2500.0,
    kv: float = 100.0,
    plant: MujocoPlant | None = None,
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
        joint_moments: to share in place of those of inverse dynamics.
        look_ahead: s, T; rounded to physics steps. It does not depend on dt.
        kp: 1/s^2, position gain; OpenSim's 100 follows fast movements less well (benchmarks/cmc_gains.py).
        kv: 1/s, velocity gain; 2 sqrt(kp) damps critically.
        plant: what is stepped.
        progress: called with (windows solved, windows in all).

    Returns:
        The solution. ``shortfall`` is what the targets leave at t+T.

    Raises:
        SettingsError: as `hcmc`; or a look-ahead or gain that is not a positive number.
        MotionError: as `hcmc`.
        SimulationError: as `hcmc`.
        SolveInterrupted: as `hcmc`.
    """
    windows = prepare(
        model, motion, dt, physics_dt, initial_qpos, initial_qvel, initial_activation, joint_moments, plant
    )
    sharing = share(model, cost, weights, smoothness, min_activation, disabled, solver)
    method = _Cmc(sharing, reserves, look_ahead, kp, kv)
    return run(method, windows, progress, own_plant=plant is not None)


@dataclass(frozen=True)
class _Cmc:
    """The method with its settings; see `cmc`."""

    sharing: Sharing
    reserves: bool
    look_ahead: float
    kp: float
    kv: float

    def __post_init__(self) -> None:
        check_flag("reserves", self.reserves)
        for name in ("look_ahead", "kp", "kv"):
            value = getattr(self, name)
            if not (isinstance(value, (int, float, np.integer, np.floating)) and 0 < value < np.inf):
                raise SettingsError(f"{name} must be a positive number; got {value!r}")

    def settings(self) -> dict[str, Any]:
        """See `run.Method`."""
        own = {"reserves": self.reserves, "look_ahead": self.look_ahead, "kp": self.kp, "kv": self.kv}
        return {"method": "cmc", **self.sharing.options, **own}

    def start(self, windows: Windows) -> tuple[State, Inputs]:
        """See `run.Method`."""
        return static_start(windows, self.sharing, reserves=self.reserves)

    def window(self, windows: Windows, k: int, state: State, before: Inputs) -> Inputs:
        """See `run.Method`."""
        plant, reference = windows.plant, windows.reference
        n_step = max(1, round(self.look_ahead / plant.physics_dt))
        ahead = windows.reference_at(reference.time[k] + n_step * plant.physics_dt)
        q_error, v_error = reference.qpos[k] - state.qpos, reference.qvel[k] - state.qvel
        qacc = ahead.qacc[0] + self.kv * v_error + self.kp * q_error
        lb, ub = plant.reachable(state.activation, n_step)

        expected = replace(state, time=float(ahead.time[0]), qpos=ahead.qpos[0] - q_error, qvel=ahead.qvel[0] - v_error)
        plant.set_state(expected)
        plant.set_input(None, np.zeros(windows.model.nv))
        plant.forward()
        moments = dynamics.muscle_moments(plant)
        Q = dynamics.required_moment(plant, qacc, moments.p)
        activation, lacking = self._targets(moments, Q, (lb, ub), dynamics.mass_matrix(plant), before=state.activation)
        return Inputs(
            excitation=self.sharing.excitation(plant.excitation_reaching(state.activation, activation, n_step)),
            reserve=lacking if self.reserves else np.zeros_like(lacking),
            shortfall=lacking,
            fastest_rate=0.0,
        )

    def _targets(
        self,
        moments: dynamics.MuscleMoments,
        Q: NDArray[np.float64],
        bounds: tuple[NDArray[np.float64], NDArray[np.float64]],
        M: NDArray[np.float64],
        before: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Activation (n_muscle,) and what it leaves of Q (nv,) N m: by the fast target, else by the slow one."""
        problem = self.sharing.problem(moments, Q, *bounds, reserve_price(M, reserves=self.reserves), before)
        found = self.sharing.allocate(problem)
        if not self.reserves and np.abs(problem.P @ found.reserve).max(initial=0.0) > _FEASIBLE:
            inverse: NDArray[np.float64] = np.asarray(np.linalg.inv(M))
            size = float(np.abs(inverse @ moments.B).sum(axis=1).max(initial=1.0))
            slow = replace(problem, P=inverse / size, eps=_SLOW_COST / size**2)
            found = self.sharing.allocate(slow)
        return found.activation, found.reserve

"""Static optimization: activations from the desired motion alone, then driven through the muscles open loop.

At each node the muscles share what inverse dynamics of the desired motion asks for (Crowninshield & Brand 1981,
doi 10.1016/0021-9290(81)90035-X); nothing knows of activation dynamics or of what the driven model does. The excitation
that takes activation from node to node (clipped to what can be) then drives the model without feedback, and drifts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc import dynamics
from mjhcmc.joint_moments import JointMoments
from mjhcmc.methods.run import Inputs, Progress, reserve_price, run, static_start
from mjhcmc.methods.windows import Windows, check_flag, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import MujocoPlant, State
from mjhcmc.sharing import Sharing, share
from mjhcmc.solution import Solution


def static_optimization(
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
    plant: MujocoPlant | None = None,
    progress: Progress | None = None,
) -> Solution:
    """Find muscle excitations by static optimization, and drive the model with them open loop.

    Args:
        model: as for `hcmc`, like all arguments that are not named here.
        motion: the motion.
        dt: s, from node to node.
        physics_dt: s, the plant's step.
        initial_qpos: (nq,) rad or m.
        initial_qvel: (nv,) rad/s or m/s.
        initial_activation: (n_muscle,) or one number.
        reserves: apply to the joints what the muscles cannot give in the desired motion, the mean of a window's ends.
        cost: what is least where muscles can share.
        weights: by muscle.
        smoothness: weight of (change of activation from node to node)^2.
        min_activation: least activation.
        disabled: names of muscles that stay switched off.
        solver: of the allocation.
        joint_moments: to share in place of those of inverse dynamics.
        plant: what is stepped.
        progress: called with (windows solved, windows in all).

    Returns:
        The solution; its tracking error is the drift of the muscle-driven model. ``shortfall`` also counts the moment
        of activation that cannot be reached from one node to the next.

    Raises:
        SettingsError: as `hcmc`.
        MotionError: as `hcmc`.
        SimulationError: as `hcmc`.
        SolveInterrupted: as `hcmc`.
    """
    windows = prepare(
        model, motion, dt, physics_dt, initial_qpos, initial_qvel, initial_activation, joint_moments, plant
    )
    sharing = share(model, cost, weights, smoothness, min_activation, disabled, solver)
    return run(_Static(sharing, reserves), windows, progress, own_plant=plant is not None)


@dataclass(frozen=True)
class _Static:
    """The method with its settings; see `static_optimization`."""

    sharing: Sharing
    reserves: bool

    def __post_init__(self) -> None:
        check_flag("reserves", self.reserves)

    def settings(self) -> dict[str, Any]:
        """See `run.Method`."""
        return {"method": "static", **self.sharing.options, "reserves": self.reserves}

    def start(self, windows: Windows) -> tuple[State, Inputs]:
        """See `run.Method`."""
        return static_start(windows, self.sharing, reserves=self.reserves)

    def window(self, windows: Windows, k: int, state: State, before: Inputs) -> Inputs:
        """See `run.Method`; of the state only its activation counts, which no position or velocity changes."""
        plant = windows.plant
        first = self._node(windows, k, state.activation)[1]
        activation, lacking, B = self._node(windows, k + 1, state.activation)
        excitation = self.sharing.excitation(plant.excitation_reaching(state.activation, activation, windows.n_step))
        plant.set_state(state)
        low, high = plant.reachable(state.activation, windows.n_step)
        unreached = B @ (activation - np.clip(activation, low, high))
        reserve = (first + lacking) / 2 if self.reserves else np.zeros_like(lacking)
        return Inputs(excitation, reserve, (reserve if self.reserves else lacking) + unreached, 0.0)

    def _node(
        self, windows: Windows, k: int, before: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """At node k of the desired motion: activation (n_muscle,), what it leaves (nv,) N m, and B."""
        plant, reference, model = windows.plant, windows.reference, windows.model
        zero = np.zeros(model.nv)
        time = float(reference.time[k])
        plant.set_state(State(time, reference.qpos[k], reference.qvel[k], np.zeros(model.n_muscle), zero))
        plant.set_input(None, zero)
        plant.forward()
        moments = dynamics.muscle_moments(plant)
        Q = dynamics.required_moment(plant, reference.qacc[k], moments.p)
        price = reserve_price(dynamics.mass_matrix(plant), reserves=self.reserves)
        low, high = model.excitation_range.T
        found = self.sharing.allocate(self.sharing.problem(moments, Q, low, high, price, before))
        return found.activation, found.reserve, moments.B

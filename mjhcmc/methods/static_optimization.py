"""Static optimization: activations from the desired motion alone, then driven through the muscles open loop.

At each node the muscles share what inverse dynamics of the desired motion asks for (Crowninshield & Brand 1981,
doi 10.1016/0021-9290(81)90035-X). This plan knows nothing of activation dynamics. The excitation
that takes activation from node to node (clipped to what can be) then drives the model without feedback, and drifts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.allocation import Allocation
from mjhcmc.clamps import activation_cap
from mjhcmc.emg_targets import EmgTargets
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.joint_moments import JointMoments
from mjhcmc.methods.run import Driver, Inputs, Progress, Separately, Team, needs, rate_at, reserve_price, run
from mjhcmc.methods.windows import Windows, check_flag, prepare
from mjhcmc.model import MuscleModel
from mjhcmc.motion import Motion
from mjhcmc.plant import MujocoPlant, State
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
    emg: EmgTargets | None = None,
    joint_moments: JointMoments | None = None,
    loads: ExternalLoads | None = None,
    plant: MujocoPlant | None = None,
    integrator: str = "rk4",
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
        emg: measured excitations to be near.
        joint_moments: to share in place of those of inverse dynamics.
        loads: measured forces on the model's bodies.
        plant: what is stepped.
        integrator: of the plant.
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
        model, motion, dt, physics_dt, initial_qpos, initial_qvel, initial_activation, joint_moments, plant,
        loads=loads, cost=cost, weights=weights, smoothness=smoothness, min_activation=min_activation,
        disabled=disabled, solver=solver, emg=emg, integrator=integrator,
    )  # fmt: skip
    check_flag("reserves", reserves)
    method = _Static(reserves, _plan(windows, reserves=reserves))
    return run(method, windows, progress)


@dataclass(frozen=True, eq=False)
class _Plan:
    """What the muscles do along the desired motion, at its N+1 nodes.

    Attributes:
        activation: (N+1, n_muscle).
        lacking: (N+1, nv) N m, what it leaves.
        B: (N+1, nv, n_muscle) N m, joint moments at full activation.
    """

    activation: NDArray[np.float64]
    lacking: NDArray[np.float64]
    B: NDArray[np.float64]


def _plan(windows: Windows, *, reserves: bool) -> _Plan:
    """Static optimization proper: node by node, from the desired motion alone."""
    plant, reference, model, sharing = windows.plant, windows.reference, windows.model, windows.sharing
    rest, zero = np.zeros(model.n_muscle), np.zeros(model.nv)
    low, high = model.excitation_range.T
    found: list[Allocation] = []
    activation, B = [], []
    for k, time in enumerate(reference.time):
        plant.set_state(State(float(time), reference.qpos[k], reference.qvel[k], rest, zero))
        plant.set_input(None, zero)
        plant.forward()
        needed = needs(windows, reference.qpos[k], reference.qacc[k], steady=True)
        price = reserve_price(needed.M, reserves=reserves)
        before = found[-1].activation if found else None
        cap = activation_cap(model.force_limit, needed.moments.gain, needed.moments.bias)
        top = np.maximum(low, np.minimum(high, cap))
        problem = sharing.problem(needed.moments, needed.Q, low, top, price, before, float(time))
        found.append(sharing.allocate(problem))
        settled = plant.steady_activation(found[-1].activation)
        if plant.hosted is not None:
            settled = np.maximum(settled, np.where(sharing.disabled, 0.0, np.minimum(sharing.min_activation, high)))
        activation.append(settled)
        B.append(model.coordinates.full(needed.moments.B.T).T)
    lacking = model.coordinates.full(np.array([f.reserve for f in found]))
    return _Plan(np.array(activation), lacking, np.array(B))


@dataclass(frozen=True)
class _Static:
    """The method with its settings; see `static_optimization`."""

    reserves: bool
    plan: _Plan

    def settings(self) -> dict[str, Any]:
        """See `run.Method`."""
        return {"method": "static", "reserves": self.reserves}

    def start(self, windows: Windows) -> tuple[State, Inputs]:
        """See `run.Method`; the first activation is the plan's, wherever the model starts."""
        start, zero = windows.start, np.zeros(windows.model.nv)
        given = np.isfinite(start.activation).all()
        state = start if given else replace(start, activation=self.plan.activation[0])
        return state, Inputs(state.activation, zero, zero, 0.0)

    def drive(self, team: Team) -> Driver:
        """See `run.Method`."""
        return Separately(team, self._window)

    def _window(self, windows: Windows, k: int, state: State, before: Inputs) -> Inputs:
        """The inputs of window k; of the state only its activation counts, which no position or velocity changes."""
        plant, plan = windows.plant, self.plan
        goal = plan.activation[k + 1]
        excitation = windows.sharing.excitation(plant.excitation_reaching(state.activation, goal, windows.n_step))
        low, high = plant.reachable(state.activation, windows.n_step)
        unreached = plan.B[k + 1] @ (goal - np.clip(goal, low, high))
        lacking = (plan.lacking[k] + plan.lacking[k + 1]) / 2
        reserve = lacking if self.reserves else np.zeros_like(lacking)
        shortfall = (reserve if self.reserves else plan.lacking[k + 1]) + unreached
        return Inputs(excitation, reserve, shortfall, rate_at(windows, state, reserve))

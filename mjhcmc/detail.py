"""Detail: fibers, muscle power, each muscle's share of the joint moments, and joint reactions, along a solution."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc import dynamics
from mjhcmc.errors import MjhcmcWarning
from mjhcmc.plant import MujocoPlant
from mjhcmc.reactions import joint_reactions, reactions_unknown

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel
    from mjhcmc.solution import Solution


@dataclass(frozen=True, eq=False)
class Detail:
    """What follows from a solution at its N + 1 nodes; muscles, degrees of freedom and joints in the solution's order.

    What is given of fibers is their length ALONG THE TENDON. Of Hill muscles (see `HillPlant`) it is l cos(alpha), from
    their own state where tendons are compliant. MuJoCo's muscle has a rigid tendon and no pennation, so a fiber is as
    long as the path less a constant (l cos(alpha) of Millard et al. 2013, doi 10.1115/1.4023390,
    equations 1-4, with a rigid tendon). With the muscle's lengthrange (lr0, lr1), range (r0, r1) and path length lMT:

        L0 = (lr1 - lr0)/(r1 - r0),   l = r0 L0 + (lMT - lr0)

    A muscle's force F counts fiber damping in (`Solution.muscle_force`), so the moments R^T F of all muscles and the
    reserve add up to `Solution.net_joint_moment`, and the powers of muscles to R^T F . qvel.

    Attributes:
        musculotendon_length: (N+1, n_muscle) m, length of the path (rad for a muscle that acts on a hinge).
        musculotendon_velocity: (N+1, n_muscle) m/s, lengthening positive.
        fiber_length: (N+1, n_muscle) m, along the tendon; NaN where the gain is not MuJoCo's muscle.
        fiber_velocity: (N+1, n_muscle) m/s, along the tendon, lengthening positive; NaN likewise.
        normalized_fiber_length: (N+1, n_muscle) in L0, the optimal fiber length along the tendon; NaN likewise.
        normalized_fiber_velocity: (N+1, n_muscle) in L0 a second; NaN likewise.
        muscle_power: (N+1, n_muscle) W, -F times musculotendon velocity: positive where the muscle shortens and gives
            energy to the bodies (Winter 2009, ISBN 978-0-470-39818-0, chapter 6).
        muscle_moment: (N+1, n_muscle, nv) N m or N, what each muscle adds to each net joint moment, R_ij F_i.
        active_moment: (N+1, n_muscle, nv) N m or N, the part of it that is proportional to activation.
        passive_moment: (N+1, n_muscle, nv) N m or N, the rest: passive fiber force and fiber damping.
        solution: what all this follows from.
    """

    musculotendon_length: NDArray[np.float64]
    musculotendon_velocity: NDArray[np.float64]
    fiber_length: NDArray[np.float64]
    fiber_velocity: NDArray[np.float64]
    normalized_fiber_length: NDArray[np.float64]
    normalized_fiber_velocity: NDArray[np.float64]
    muscle_power: NDArray[np.float64]
    muscle_moment: NDArray[np.float64]
    active_moment: NDArray[np.float64]
    passive_moment: NDArray[np.float64]
    solution: Solution = field(repr=False)

    @property
    def joint_reaction_force(self) -> NDArray[np.float64]:
        """(N+1, njnt, 3) N, on the child body, in the world's axes (`reactions.joint_reactions`).

        Reactions are computed when first asked for. They are NaN, with an `MjhcmcWarning`, where something acts on the
        bodies at a place that is not known.
        """
        return self._reactions[0]

    @property
    def joint_reaction_moment(self) -> NDArray[np.float64]:
        """(N+1, njnt, 3) N m, on the child body, about the joint's anchor, in the world's axes; NaN as the force is."""
        return self._reactions[1]

    @cached_property
    def _reactions(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Force and moment."""
        plant = self.solution.plant()
        shape = len(self.solution.time), plant.mj_model.njnt, 3
        force, moment = np.full(shape, np.nan), np.full(shape, np.nan)
        unknown = reactions_unknown(plant)
        around = self.solution.surroundings
        if self.solution.external_load.any() and (around is None or around.loads is None):
            unknown = unknown or (
                "where the loads from outside act on the bodies is not recorded: solve with ExternalLoads, without "
                "joint_moments, and ask the solution before it is saved"
            )
        elif not self.solution.knows_surroundings:
            unknown = unknown or "the file does not hold the motion of prescribed joints: ask before saving"
        if unknown:
            warnings.warn(
                f"model {plant.model.name!r}: joint reactions are not known (NaN): {unknown}",
                MjhcmcWarning,
                stacklevel=4,  # where a reaction is read: past this, the cache and the property
            )
        else:
            for k in range(len(force)):
                _put_at_node(plant, self.solution, k)
                force[k], moment[k] = joint_reactions(plant)
        force.flags.writeable = moment.flags.writeable = False
        return force, moment

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                value.flags.writeable = False


def detail_of(solution: Solution) -> Detail:
    """See `Detail`; one pass over the nodes, each with the reserve of the window that starts there (the last: ends).

    Raises:
        SimulationError: the solution does not know its model (it was read from a file without one).
    """
    plant = solution.plant()
    n, m, v = len(solution.time), plant.model.n_muscle, plant.model.nv
    length, velocity, force = np.empty((n, m)), np.empty((n, m)), np.empty((n, m))
    active, passive = np.empty((n, m, v)), np.empty((n, m, v))
    rows = plant.mj_model.actuator_outadr[plant.model.muscle_ids]
    for k in range(n):
        _put_at_node(plant, solution, k)
        length[k] = plant.mj_data.actuator_length[rows]
        velocity[k] = plant.mj_data.actuator_velocity[rows]
        R = dynamics.moment_arms(plant)
        if plant.model.coupling is not None:  # what acts on tied joints acts on those that move them
            R = R @ plant.model.coupling.tangent(solution.qpos[k])
        if plant.hosted is None:
            parts = dynamics.muscle_moments(plant)  # leaves the actuator forces at activation 0
            driven, rest = parts.gain * solution.activation[k], parts.bias
        else:
            driven, rest = plant.hosted.shares(solution.state(k), length[k], velocity[k])
        active[k], passive[k], force[k] = R * driven[:, None], R * rest[:, None], driven + rest
    gear = _gear(plant)
    return Detail(
        musculotendon_length=length / gear,
        musculotendon_velocity=velocity / gear,
        **_fibers(solution, length, velocity, gear),
        muscle_power=-force * velocity,
        muscle_moment=active + passive,
        active_moment=active,
        passive_moment=passive,
        solution=solution,
    )


def _fibers(
    solution: Solution, length: NDArray[np.float64], velocity: NDArray[np.float64], gear: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Fiber lengths and velocities (N+1, n_muscle), from those of the actuators."""
    if solution.muscles is not None:
        along, speed = solution.muscles.fibers(solution.activation, solution.fiber_length, length, velocity)
        optimal = solution.muscles.optimal_length_along
        normal, normal_speed = along / optimal, speed / optimal
    else:
        optimal, start = _optimal_length(_model_of(solution))
        normal, normal_speed = start[:, 1] + (length - start[:, 0]) / optimal, velocity / optimal
        along, speed = normal * optimal / np.abs(gear), np.where(np.isfinite(optimal), velocity / np.abs(gear), np.nan)
    return {
        "fiber_length": along,
        "fiber_velocity": speed,
        "normalized_fiber_length": normal,
        "normalized_fiber_velocity": normal_speed,
    }


def _model_of(solution: Solution) -> MuscleModel:
    assert solution.model is not None  # its plant is known
    return solution.model


def _put_at_node(plant: MujocoPlant, solution: Solution, k: int) -> None:
    """The state of a node, under the reserve of the window that starts there and the load from outside."""
    plant.set_state(solution.state(k))
    # a plant that knows its surroundings adds by itself what acts from outside
    load = solution.external_load[k] if plant.surroundings.empty else 0.0
    plant.set_input(None, solution.reserve[min(k, solution.n_window - 1)] + load)
    plant.forward_as_stepped()


def _gear(plant: MujocoPlant) -> NDArray[np.float64]:
    """(n_muscle,) the actuator's length is so many times the path's; 1 off a tendon."""
    m, ids = plant.mj_model, plant.model.muscle_ids
    on_tendon = m.actuator_trntype[ids] == mujoco.mjtTrn.mjTRN_TENDON
    return np.where(on_tendon, m.actuator_gear[ids, 0], 1.0)


def _optimal_length(model: MuscleModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """L0 (n_muscle,) in the actuator's length, and (n_muscle, 2) a length and the normalized length that it means."""
    m, ids = model.mj_model, model.muscle_ids
    low, high = m.actuator_lengthrange[ids].T
    r0, r1 = m.actuator_gainprm[ids, 0], m.actuator_gainprm[ids, 1]
    is_muscle = m.actuator_gaintype[ids] == mujoco.mjtGain.mjGAIN_MUSCLE
    optimal = np.full(len(ids), np.nan)
    np.divide(high - low, r1 - r0, out=optimal, where=is_muscle)
    return optimal, np.column_stack([low, r0])

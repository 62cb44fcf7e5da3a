"""Plants that a user handed in, stepped one after the other: `Plants` for whatever a single plant can do."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mjhcmc import dynamics
from mjhcmc.dynamics import NodeForces
from mjhcmc.linearization import Array, Ids, Layout, Linearization
from mjhcmc.lockstep import NEAR
from mjhcmc.plant import MujocoPlant, State
from mjhcmc.surroundings import coordinates_of


class OneByOne:
    """See `lockstep.Plants`.

    Args:
        plants: one a simulation, of models of the same structure and of one physics step.
    """

    def __init__(self, plants: Sequence[MujocoPlant]) -> None:
        self._plants = plants
        self.count, self.physics_dt, self.scheme = len(plants), plants[0].physics_dt, plants[0].scheme
        model = plants[0].model
        ends = np.cumsum([1, model.nq, model.nv, model.n_muscle, model.nv])
        self.layout = Layout(0, *(slice(int(a), int(b)) for a, b in pairwise(ends)))
        self._n_row = int(ends[-1])
        tied = coordinates_of(model.mj_model, model.roles.dependent)
        self._limited = np.setdiff1d(np.flatnonzero(np.isfinite(model.joint_range).any(axis=1)), tied)
        self._limits = model.joint_range[self._limited]

    def rows(self, states: Sequence[State]) -> Array:
        """See `Plants`."""
        return np.array([_row(state) for state in states])

    def step(self, ids: Ids, rows: Array, excitation: Array, reserve: Array, n_step: int, times: float = 1.0) -> Array:
        """See `Plants`."""
        ends = np.empty_like(rows)
        for k, i in enumerate(ids):
            plant = self._plants[i]
            plant.set_state(self.layout.state(rows[k]))
            plant.advance(excitation[k], reserve[k], n_step, times)
            ends[k] = _row(plant.get_state())
        return ends

    def acceleration(self, ids: Ids, rows: Array, reserve: Array) -> Array:
        """See `Plants`."""
        found = []
        for i, row, s in zip(ids, rows, reserve, strict=True):
            self._set(i, row, s)
            found.append(self._plants[i].step_acceleration())
        return np.array(found)

    def linearize(
        self, ids: Ids, rows: Array, reserve: Array, *, stiffness: bool = False, damping: bool = False
    ) -> Linearization:
        """See `Plants`."""
        qacc, M, B, gain, bias, D, K, held = [], [], [], [], [], [], [], []
        for i, row, s in zip(ids, rows, reserve, strict=True):
            plant = self._plants[i]
            qacc.append(self._put(i, row, s))
            M.append(dynamics.mass_matrix(plant))
            moments = dynamics.muscle_moments(plant, damping=damping)
            B.append(moments.B)
            gain.append(moments.gain)
            bias.append(moments.bias)
            plant.forward()
            D.append(dynamics.damping_matrix(plant))
            if stiffness:
                K.append(dynamics.stiffness_matrix(plant))
            self._put(i, row, s)
            held.append(self._near_limit(plant) or plant.mj_data.ncon > 0)
        return Linearization(
            np.array(qacc), np.array(M), np.array(B), np.array(gain), np.array(bias), np.array(D),
            np.array(K) if stiffness else None, np.array(held, dtype=bool),
        )  # fmt: skip

    def nodes(self, i: int, rows: Array, reserve: Array) -> NodeForces:
        """See `Plants`."""
        found = []
        for row, s in zip(rows, reserve, strict=True):
            self._set(i, row, s)
            self._plants[i].forward_as_stepped()
            found.append(dynamics.node_forces(self._plants[i]))
        return dynamics.stacked(found)

    def fault(self, i: int) -> str:
        """See `Plants`: MuJoCo's errors come as they are."""
        return ""

    def _near_limit(self, plant: MujocoPlant) -> bool:
        """Whether a joint is at its limit, or nearly so; not one that equality constraints put there."""
        q = plant.mj_data.qpos[self._limited]
        return bool(((q < self._limits[:, 0] + NEAR) | (q > self._limits[:, 1] - NEAR)).any())

    def _set(self, i: int, row: Array, reserve: Array) -> None:
        self._plants[i].set_state(self.layout.state(row))
        self._plants[i].set_input(None, reserve)

    def _put(self, i: int, row: Array, reserve: Array) -> Array:
        self._set(i, row, reserve)
        return self._plants[i].forward().copy()


def _row(state: State) -> Array:
    return np.concatenate([[state.time], state.qpos, state.qvel, state.activation, state.warmstart])

"""MuJoCo itself: what the others are compared with, and the point of reference of all times."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjhcmc.engines.base import Array, Dynamics, Engine, windows_and_steps


class MujocoDynamics:
    """A model and its data."""

    def __init__(self, model: Any) -> None:
        import mujoco

        self.mujoco, self.model, self.data = mujoco, model, mujoco.MjData(model)

    def mass_matrix(self, q: Array) -> Array:
        """M, by the composite rigid body algorithm."""
        self.data.qpos[:] = q
        self.mujoco.mj_fwdPosition(self.model, self.data)
        M = np.empty((self.model.nv, self.model.nv))
        self.mujoco.mj_fullM(self.model, self.data, M)
        return M

    def bias(self, q: Array, v: Array) -> Array:
        """qfrc_bias, by the recursive Newton-Euler algorithm."""
        self.data.qpos[:], self.data.qvel[:] = q, v
        self.mujoco.mj_fwdPosition(self.model, self.data)
        self.mujoco.mj_fwdVelocity(self.model, self.data)
        return np.array(self.data.qfrc_bias)

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """By mj_inverse."""
        self.data.qpos[:], self.data.qvel[:], self.data.qacc[:] = q, v, a
        self.mujoco.mj_inverse(self.model, self.data)
        return np.array(self.data.qfrc_inverse)

    def simulate(self, q: Array, v: Array, torques: Array, dt: float, step: float) -> Array:
        """By RK4."""
        self.mujoco.mj_resetData(self.model, self.data)
        self.model.opt.integrator = self.mujoco.mjtIntegrator.mjINT_RK4
        self.model.opt.timestep = step
        self.data.qpos[:], self.data.qvel[:] = q, v
        nodes, count = [np.array(q)], windows_and_steps(dt, step)
        for torque in torques:
            self.data.qfrc_applied[:] = torque
            self.mujoco.mj_step(self.model, self.data, count)
            nodes.append(np.array(self.data.qpos))
        return np.array(nodes)


def load(model: Any) -> Dynamics:
    """The model, copied."""
    import copy

    return MujocoDynamics(copy.copy(model))


ENGINE = Engine("MuJoCo", "mujoco", "mujoco", "mujoco>=3.17,<4", integrator="RK4", order=4, reads="MjModel", load=load)

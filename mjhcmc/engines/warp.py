"""MuJoCo Warp (https://github.com/google-deepmind/mujoco_warp): MuJoCo in NVIDIA Warp, in single precision."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjhcmc.engines.base import Array, Dynamics, Engine, windows_and_steps


class WarpDynamics:
    """One world on Warp's default device: a GPU where there is one."""

    def __init__(self, model: Any) -> None:
        import mujoco
        import mujoco_warp
        import warp

        warp.config.quiet = True
        self.mjw, self.warp, self.mujoco, self.source = mujoco_warp, warp, mujoco, model
        self._put(model)

    def mass_matrix(self, q: Array) -> Array:
        """M, by the composite rigid body algorithm; mujoco_warp.mul_m gives its columns."""
        self._set(q, 0 * q, 0 * q)
        self.mjw.inverse(self.model, self.data)
        columns = []
        for unit in np.eye(len(q), dtype=np.float32):
            vector, found = (self.warp.array(x[None], dtype=float) for x in (unit, 0 * unit))
            self.mjw.mul_m(self.model, self.data, found, vector)
            columns.append(found.numpy()[0])
        return np.array(columns, float).T

    def bias(self, q: Array, v: Array) -> Array:
        """qfrc_bias."""
        self._set(q, v, 0 * q)
        self.mjw.inverse(self.model, self.data)
        return np.array(self.data.qfrc_bias.numpy()[0], float)

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """By mujoco_warp.inverse."""
        self._set(q, v, a)
        self.mjw.inverse(self.model, self.data)
        return np.array(self.data.qfrc_inverse.numpy()[0], float)

    def simulate(self, q: Array, v: Array, torques: Array, dt: float, step: float) -> Array:
        """By mujoco_warp.step under RK4."""
        self.source.opt.timestep = step
        self._put(self.source)
        self._set(q, v, 0 * q)
        nodes = [np.array(q)]
        for torque in torques:
            self.data.qfrc_applied.assign(np.asarray(torque, np.float32)[None])
            for _ in range(windows_and_steps(dt, step)):
                self.mjw.step(self.model, self.data)
            nodes.append(np.array(self.data.qpos.numpy()[0], float))
        return np.array(nodes)

    def _put(self, model: Any) -> None:
        self.model = self.mjw.put_model(model)
        self.data = self.mjw.put_data(model, self.mujoco.MjData(model))

    def _set(self, q: Array, v: Array, a: Array) -> None:
        for field, values in (("qpos", q), ("qvel", v), ("qacc", a)):
            getattr(self.data, field).assign(np.asarray(values, np.float32)[None])


def load(model: Any) -> Dynamics:
    """The MjModel, copied."""
    import copy

    return WarpDynamics(copy.copy(model))


ENGINE = Engine(
    "MuJoCo Warp", "mujoco-warp", "mujoco_warp", "mujoco-warp>=3.17,<4", precision="float32", integrator="RK4", order=4,
    reads="MjModel", load=load, distribution="mujoco-warp",
)  # fmt: skip

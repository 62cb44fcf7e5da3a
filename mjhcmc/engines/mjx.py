"""MJX (https://mujoco.readthedocs.io/en/stable/mjx.html): MuJoCo in JAX, in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjhcmc.engines.base import Array, Dynamics, Engine, windows_and_steps


class MjxDynamics:
    """An mjx.Model, and compiled functions of it."""

    def __init__(self, model: Any) -> None:
        import jax
        from mujoco import mjx

        self.jax = jax
        with jax.enable_x64(True):
            self.model = mjx.put_model(model)
            data = mjx.make_data(self.model)

            def everything(m: Any, q: Any, v: Any, a: Any) -> Any:  # one function, since each takes seconds to compile
                d = mjx.inverse(m, data.replace(qpos=q, qvel=v, qacc=a))
                return mjx.full_m(m, d), d.qfrc_bias, d.qfrc_inverse

            self._everything = jax.jit(everything)

            def run(m: Any, q: Any, v: Any, torques: Any, count: Any) -> Any:
                def window(d: Any, torque: Any) -> Any:
                    d = d.replace(qfrc_applied=torque)
                    d = jax.lax.fori_loop(0, count, lambda _, d: mjx.step(m, d), d)
                    return d, d.qpos

                return jax.lax.scan(window, data.replace(qpos=q, qvel=v), torques)[1]

            self._run = jax.jit(run)

    def mass_matrix(self, q: Array) -> Array:
        """M, by full_m."""
        return self._at(q, 0 * q, 0 * q)[0]

    def bias(self, q: Array, v: Array) -> Array:
        """qfrc_bias."""
        return self._at(q, v, 0 * q)[1]

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """By mjx.inverse."""
        return self._at(q, v, a)[2]

    def simulate(self, q: Array, v: Array, torques: Array, dt: float, step: float) -> Array:
        """By mjx.step under RK4."""
        with self.jax.enable_x64(True):
            model = self.model.tree_replace({"opt.timestep": np.float64(step)})
            nodes = self._run(model, q, v, torques, windows_and_steps(dt, step))
            return np.vstack([q, np.array(nodes)])

    def _at(self, q: Array, v: Array, a: Array) -> tuple[Array, ...]:
        with self.jax.enable_x64(True):
            return tuple(np.array(value) for value in self._everything(self.model, q, v, a))


def load(model: Any) -> Dynamics:
    """The MjModel."""
    return MjxDynamics(model)


ENGINE = Engine(
    "MJX", "mjx", "mujoco.mjx", "mujoco-mjx>=3.17,<4", integrator="RK4, compiled by JAX", reads="MjModel", load=load,
    distribution="mujoco-mjx",
)  # fmt: skip

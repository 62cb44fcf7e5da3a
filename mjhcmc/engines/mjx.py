"""MJX (https://mujoco.readthedocs.io/en/stable/mjx.html): MuJoCo in JAX, in double precision."""

from __future__ import annotations

from typing import Any

from mjhcmc.engines.base import Dynamics, Engine
from mjhcmc.engines.compiled import JaxDynamics


class MjxDynamics(JaxDynamics):
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

            self.everything = jax.jit(everything)

            def run(m: Any, q: Any, v: Any, torques: Any, count: Any) -> Any:
                def window(d: Any, torque: Any) -> Any:
                    d = d.replace(qfrc_applied=torque)
                    d = jax.lax.fori_loop(0, count, lambda _, d: mjx.step(m, d), d)
                    return d, d.qpos

                return jax.lax.scan(window, data.replace(qpos=q, qvel=v), torques)[1]

            self.run = jax.jit(run)


def load(model: Any) -> Dynamics:
    """The MjModel."""
    return MjxDynamics(model)


ENGINE = Engine(
    "MJX", "mjx", "mujoco.mjx", "mujoco-mjx>=3.17,<4", integrator="RK4, compiled by JAX", order=4,
    reads="MjModel", load=load, distribution="mujoco-mjx",
)  # fmt: skip

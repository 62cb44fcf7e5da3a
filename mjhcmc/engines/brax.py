"""Brax (Freeman et al. 2021, arXiv:2106.13281): its generalized pipeline in JAX, in double precision.

Its reader wants a joint on every body: welded ones are fused before. It computes in single precision unless JAX is told
otherwise, which is done here for its calls only.
"""

from __future__ import annotations

import warnings
from typing import Any

from mjhcmc.engines.base import Dynamics, Engine
from mjhcmc.engines.compiled import JaxDynamics
from mjhcmc.engines.legs import bodies_spec


class BraxDynamics(JaxDynamics):
    """A brax System, and compiled functions of it."""

    def __init__(self, model: Any) -> None:
        import jax
        from brax.generalized import dynamics, pipeline
        from brax.io import mjcf

        self.jax = jax
        with jax.enable_x64(True), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that Brax's pipelines are no longer developed: docs/engines.md says so
            self.model = mjcf.load_model(_as_brax_reads(model))

            def everything(sys: Any, q: Any, v: Any, a: Any) -> Any:
                state = pipeline.init(sys, q, v)
                bias = dynamics.inverse(sys, state)
                return state.mass_mx, bias, state.mass_mx @ a + bias

            self.everything = jax.jit(everything)

            def run(sys: Any, q: Any, v: Any, torques: Any, count: Any) -> Any:
                def window(state: Any, torque: Any) -> Any:
                    state = jax.lax.fori_loop(0, count, lambda _, s: pipeline.step(sys, s, torque), state)
                    return state, state.q

                return jax.lax.scan(window, pipeline.init(sys, q, v), torques)[1]

            self.run = jax.jit(run)


def _as_brax_reads(model: Any) -> Any:
    """The same with welded bodies fused, a motor on each hinge, Euler's method, and something to see."""
    import mujoco

    spec = bodies_spec(model)
    spec.compiler.fusestatic = True
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER  # a model that names another is refused
    # so is, by an IndexError, a model without geoms
    spec.worldbody.add_geom(size=[0.01, 0, 0], type=mujoco.mjtGeom.mjGEOM_SPHERE, contype=0, conaffinity=0)
    for joint in spec.joints:
        motor = spec.add_actuator(name=f"{joint.name}_torque", target=joint.name)
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.set_to_motor()
    return spec.compile()


def load(model: Any) -> Dynamics:
    """The MjModel, welded bodies fused."""
    return BraxDynamics(model)


ENGINE = Engine(
    "Brax", "brax", "brax", "brax>=0.14.2", integrator="semi-implicit Euler of its generalized pipeline", order=1,
    reads="MjModel", load=load,
)  # fmt: skip

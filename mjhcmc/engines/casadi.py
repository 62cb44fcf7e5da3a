"""CasADi (Andersson et al. 2019, doi 10.1007/s12532-018-0139-4): the equations of mjhcmc.exact as symbols.

CasADi has no bodies of its own. What runs here is our own closed form, written out in its symbols and evaluated by its
virtual machine: a second evaluation of mjhcmc.exact, and derivatives by its algorithmic differentiation.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mjhcmc.engines.base import Array, Dynamics, Engine, windows_and_steps


class CasadiDynamics:
    """Functions of SX expressions."""

    def __init__(self, model: Any) -> None:
        import casadi

        from mjhcmc.exact import dynamics, scalars
        from mjhcmc.exact.chain import chain_of

        self.casadi = casadi
        chain, kind = chain_of(model), scalars.casadi()
        q, v, a, torque = (casadi.SX.sym(name, chain.n) for name in ("q", "v", "a", "torque"))
        at, speed, change, push = (casadi.vertsplit(values) for values in (q, v, a, torque))
        M = dynamics.mass_matrix(chain, at, kind)
        inverse = casadi.vertcat(*dynamics.inverse_dynamics(chain, at, speed, change, kind))
        forward = casadi.vertcat(*dynamics.forward_dynamics(chain, at, speed, push, kind))
        self._mass = casadi.Function("mass", [q], [casadi.vertcat(*(casadi.horzcat(*row) for row in M))])
        self._bias = casadi.Function("bias", [q, v], [casadi.vertcat(*dynamics.bias(chain, at, speed, kind))])
        self._inverse = casadi.Function("inverse", [q, v, a], [inverse])
        self._slopes = casadi.Function("slopes", [q, v, a], [casadi.jacobian(inverse, casadi.vertcat(q, v))])
        self._ode = {"x": casadi.vertcat(q, v), "p": torque, "ode": casadi.vertcat(v, forward)}

    def mass_matrix(self, q: Array) -> Array:
        """M, by composite rigid bodies in symbols."""
        return np.array(self._mass(q))

    def bias(self, q: Array, v: Array) -> Array:
        """By recursive Newton-Euler in symbols."""
        return np.array(self._bias(q, v)).ravel()

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """Likewise."""
        return np.array(self._inverse(q, v, a)).ravel()

    def inverse_dynamics_slopes(self, q: Array, v: Array, a: Array) -> Array:
        """Derivative of the inverse dynamics by (q, v), (nv, 2 nv), by CasADi's algorithmic differentiation."""
        return np.array(self._slopes(q, v, a))

    def simulate(self, q: Array, v: Array, torques: Array, dt: float, step: float) -> Array:
        """By CasADi's integrator "rk": RK4 with fixed steps."""
        options = {"number_of_finite_elements": windows_and_steps(dt, step)}
        window = self.casadi.integrator("window", "rk", self._ode, 0.0, dt, options)
        nodes = [np.concatenate([q, v])]
        for torque in torques:
            nodes.append(np.array(window(x0=nodes[-1], p=torque)["xf"]).ravel())
        return np.array(nodes)[:, : len(q)]


def load(model: Any) -> Dynamics:
    """The closed form of mjhcmc.exact, of the MjModel's numbers."""
    return CasadiDynamics(model)


ENGINE = Engine(
    "CasADi", "casadi", "casadi", "casadi>=3.6.5", integrator="its fixed-step rk (RK4)", order=4,
    reads="mjhcmc.exact in symbols", load=load,
)  # fmt: skip

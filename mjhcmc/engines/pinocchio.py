"""Pinocchio (Carpentier et al. 2019, doi 10.1109/SII.2019.8700380): recursive algorithms, no integrator."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjhcmc.engines.base import Array, Dynamics, Engine, windows_and_steps
from mjhcmc.engines.runge_kutta import rk4
from mjhcmc.engines.urdf import urdf_of


class PinocchioDynamics:
    """Pinocchio's model of a URDF, and its data."""

    def __init__(self, model: Any) -> None:
        import pinocchio

        self.pin, self.nv = pinocchio, int(model.nv)
        self.model = pinocchio.buildModelFromXML(urdf_of(model))
        self.model.gravity.linear = np.array(model.opt.gravity)
        self.model.armature[:] = 0.0
        self.data = self.model.createData()
        # where each of MuJoCo's joints is in Pinocchio's vectors, which follow the names of the joints
        self.order = [self.model.joints[self.model.getJointId(model.joint(j).name)].idx_v for j in range(model.njnt)]
        # a hinge without limits is a point of the circle there: (cos q, sin q)
        self.circle = [self.model.joints[self.model.getJointId(model.joint(j).name)].nq == 2 for j in range(model.njnt)]
        self.at = [self.model.joints[self.model.getJointId(model.joint(j).name)].idx_q for j in range(model.njnt)]

    def mass_matrix(self, q: Array) -> Array:
        """M, by crba."""
        M = np.array(self.pin.crba(self.model, self.data, self._q(q)))
        M = np.triu(M) + np.triu(M, 1).T  # crba fills the upper half
        return np.asarray(M[np.ix_(self.order, self.order)])

    def bias(self, q: Array, v: Array) -> Array:
        """By nonLinearEffects."""
        return np.array(self.pin.nonLinearEffects(self.model, self.data, self._q(q), self._v(v)))[self.order]

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """By rnea."""
        return np.array(self.pin.rnea(self.model, self.data, self._q(q), self._v(v), self._v(a)))[self.order]

    def simulate(self, q: Array, v: Array, torques: Array, dt: float, step: float) -> Array:
        """By the articulated body algorithm (aba) and our own RK4."""

        def acceleration(q: Array, v: Array, torque: Array) -> Array:
            return np.array(self.pin.aba(self.model, self.data, self._q(q), self._v(v), self._v(torque)))[self.order]

        return rk4(acceleration, q, v, torques, step, windows_and_steps(dt, step))

    def _v(self, v: Array) -> Array:
        out = np.empty(self.nv)
        out[self.order] = v
        return out

    def _q(self, q: Array) -> Array:
        out = np.empty(self.model.nq)
        for value, at, circle in zip(q, self.at, self.circle, strict=True):
            if circle:
                out[at : at + 2] = np.cos(value), np.sin(value)
            else:
                out[at] = value
        return out


def load(model: Any) -> Dynamics:
    """The model, through URDF."""
    return PinocchioDynamics(model)


ENGINE = Engine(
    "Pinocchio",
    "pinocchio",
    "pinocchio",
    "pin>=3.3",
    integrator="our RK4 over its aba (it has no integrator)",
    order=4,
    reads="URDF",
    load=load,
    distribution="pin",
)

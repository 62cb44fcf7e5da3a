"""DART (Lee et al. 2018, doi 10.21105/joss.00500): a Skeleton, moved by its World."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjhcmc.engines.base import Array, Dynamics, Engine, windows_and_steps
from mjhcmc.engines.urdf import urdf_of


class DartDynamics:
    """A Skeleton from a URDF, alone in a World."""

    def __init__(self, model: Any) -> None:
        import dartpy

        loader = dartpy.utils.DartLoader()
        self.skeleton = loader.parseSkeletonString(urdf_of(model), dartpy.common.Uri())
        self.world = dartpy.simulation.World()
        self.world.setGravity(np.array(model.opt.gravity))
        self.world.addSkeleton(self.skeleton)
        self.order = [self.skeleton.getDof(model.joint(j).name).getIndexInSkeleton() for j in range(model.njnt)]

    def mass_matrix(self, q: Array) -> Array:
        """M, by getMassMatrix."""
        self._set(q, np.zeros_like(q))
        return np.asarray(self.skeleton.getMassMatrix()[np.ix_(self.order, self.order)])

    def bias(self, q: Array, v: Array) -> Array:
        """By getCoriolisAndGravityForces."""
        self._set(q, v)
        return np.array(self.skeleton.getCoriolisAndGravityForces())[self.order]

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """By computeInverseDynamics, without its springs, damping and external forces."""
        self._set(q, v)
        self.skeleton.setAccelerations(self._ours(a))
        self.skeleton.computeInverseDynamics()
        return np.array(self.skeleton.getForces())[self.order]

    def simulate(self, q: Array, v: Array, torques: Array, dt: float, step: float) -> Array:
        """By World.step: semi-implicit Euler."""
        self.world.setTimeStep(step)
        self._set(q, v)
        nodes = [np.array(q)]
        for torque in torques:
            for _ in range(windows_and_steps(dt, step)):
                self.skeleton.setForces(self._ours(torque))  # a step uses them up
                self.world.step()
            nodes.append(np.array(self.skeleton.getPositions())[self.order])
        return np.array(nodes)

    def _set(self, q: Array, v: Array) -> None:
        self.skeleton.setPositions(self._ours(q))
        self.skeleton.setVelocities(self._ours(v))

    def _ours(self, values: Array) -> Array:
        out = np.empty(len(self.order))
        out[self.order] = values
        return out


def load(model: Any) -> Dynamics:
    """The model, through URDF."""
    return DartDynamics(model)


ENGINE = Engine(
    "DART", "dart", "dartpy", "dartpy>=6.16.2", integrator="semi-implicit Euler of its World", order=1,
    reads="URDF", load=load,
)  # fmt: skip

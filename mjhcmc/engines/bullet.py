"""Bullet (Coumans and Bai, https://pybullet.org): a multibody with a fixed base in a DIRECT physics server."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from mjhcmc.engines.base import Array, Dynamics, Engine, windows_and_steps
from mjhcmc.engines.urdf import urdf_of


class BulletDynamics:
    """One body in a physics server of its own."""

    def __init__(self, model: Any) -> None:
        import pybullet
        from pybullet_utils.bullet_client import BulletClient

        self.client = client = BulletClient(connection_mode=pybullet.DIRECT)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "model.urdf"
            path.write_text(urdf_of(model), encoding="utf-8")
            # without the flag Bullet makes up inertias of its own from collision shapes
            self.body = client.loadURDF(str(path), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
        client.setGravity(*(float(g) for g in model.opt.gravity))
        info = [client.getJointInfo(self.body, i) for i in range(client.getNumJoints(self.body))]
        place = {row[1].decode(): row[0] for row in info}
        self.joints = [place[model.joint(j).name] for j in range(model.njnt)]
        moving = [row[0] for row in info if row[2] != pybullet.JOINT_FIXED]
        self.order = [moving.index(joint) for joint in self.joints]  # in vectors over the moving joints
        self.torque_control = pybullet.TORQUE_CONTROL
        # Bullet damps bodies and joints unless told otherwise, and each joint has a motor that holds it
        for link in range(-1, len(info)):
            client.changeDynamics(
                self.body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, maxJointVelocity=1e4
            )
        for joint in self.joints:
            client.setJointMotorControl2(self.body, joint, pybullet.VELOCITY_CONTROL, force=0.0)

    def mass_matrix(self, q: Array) -> Array:
        """M, by calculateMassMatrix."""
        M = np.array(self.client.calculateMassMatrix(self.body, self._ours(q)))
        return np.asarray(M[np.ix_(self.order, self.order)])

    def bias(self, q: Array, v: Array) -> Array:
        """By calculateInverseDynamics at zero acceleration."""
        return self.inverse_dynamics(q, v, np.zeros_like(q))

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """By calculateInverseDynamics."""
        found = self.client.calculateInverseDynamics(self.body, self._ours(q), self._ours(v), self._ours(a))
        return np.array(found)[self.order]

    def simulate(self, q: Array, v: Array, torques: Array, dt: float, step: float) -> Array:
        """By stepSimulation: semi-implicit Euler."""
        client = self.client
        client.setTimeStep(step)
        for joint, angle, speed in zip(self.joints, q, v, strict=True):
            client.resetJointState(self.body, joint, float(angle), float(speed))
        nodes = [np.array(q)]
        for torque in torques:
            for _ in range(windows_and_steps(dt, step)):  # a step uses the torques up
                client.setJointMotorControlArray(self.body, self.joints, self.torque_control, forces=torque.tolist())
                client.stepSimulation()
            nodes.append(np.array([state[0] for state in client.getJointStates(self.body, self.joints)]))
        return np.array(nodes)

    def _ours(self, values: Array) -> list[float]:
        out = np.empty(len(self.order))
        out[self.order] = values
        return [float(value) for value in out]


def load(model: Any) -> Dynamics:
    """The model, through URDF."""
    return BulletDynamics(model)


ENGINE = Engine(
    "Bullet", "bullet", "pybullet", "pybullet>=3.2.7", integrator="semi-implicit Euler of its multibody world", order=1,
    reads="URDF", load=load,
)  # fmt: skip

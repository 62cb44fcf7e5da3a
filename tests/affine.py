"""What muscles can do at one state, by plain MuJoCo: an oracle that knows nothing of the package."""

import mujoco
import numpy as np


class Affine:
    """Accelerations rest + J a and muscle forces bias + gain a at a state; forces pull positive, with fiber damping."""

    def __init__(self, model, qpos, qvel):
        self.m, self.qpos, self.qvel = model.mj_model, qpos, qvel
        self.d = mujoco.MjData(self.m)
        n = self.m.nu
        self.rest, self.bias = self.at(np.zeros(n))
        columns = [self.at(row) for row in np.eye(n)]
        self.J = np.column_stack([qacc - self.rest for qacc, _ in columns])
        self.gain = np.array([force[i] - self.bias[i] for i, (_, force) in enumerate(columns)])
        self.strength = self.m.actuator_gainprm[:, 2]

    def at(self, activation):
        """Accelerations and forces under an activation, by a forward pass."""
        m, d = self.m, self.d
        mujoco.mj_resetData(m, d)
        d.qpos[:], d.qvel[:], d.act[:] = self.qpos, self.qvel, activation
        mujoco.mj_forward(m, d)
        damping = m.tendon_damping * d.ten_velocity if m.ntendon else 0.0
        return d.qacc.copy(), damping - d.actuator_force

    def cost(self, name):
        """(n_muscle,) factor and offset of a cost, which is the sum of (factor a + offset)^2."""
        one, zero = np.ones_like(self.gain), np.zeros_like(self.gain)
        full = np.maximum(np.abs(self.gain), 0.1 * self.strength)  # who gives next to nothing has a capacity, too
        return {
            "effort": (one, zero),
            "stress": (self.gain / self.strength, self.bias / self.strength),
            "capacity": (self.gain / full, self.bias / full),
        }[name]

    def cheapest(self, qacc, low, high, cost, start, smoothness=0.0, before=0.0):
        """The activation within bounds that gives an acceleration at the least cost, by scipy's SLSQP."""
        from scipy.optimize import minimize

        factor, offset = self.cost(cost)
        return minimize(
            lambda a: np.sum((factor * a + offset) ** 2) + smoothness * np.sum((a - before) ** 2),
            np.clip(start, low, high),
            jac=lambda a: 2 * factor * (factor * a + offset) + 2 * smoothness * (a - before),
            bounds=list(zip(low, high, strict=True)),
            constraints={
                "type": "eq",
                "fun": lambda a: 1e-3 * (self.rest + self.J @ a - qacc),
                "jac": lambda _: 1e-3 * self.J,
            },
            method="SLSQP",
            options={"ftol": 1e-16, "maxiter": 500},
        ).x

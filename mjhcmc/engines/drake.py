"""Drake (Tedrake et al., https://drake.mit.edu): MultibodyPlant in continuous time, moved by its Simulator."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjhcmc.engines.base import Array, Dynamics, Engine
from mjhcmc.engines.urdf import urdf_of


class DrakeDynamics:
    """A MultibodyPlant that holds a URDF, with joint torques as its input."""

    def __init__(self, model: Any) -> None:
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.multibody.tree import JointActuatorIndex

        plant: Any = MultibodyPlant(time_step=0.0)
        self.plant = plant
        Parser(plant).AddModelsFromString(urdf_of(model), "urdf")
        joints = [plant.GetJointByName(model.joint(j).name) for j in range(model.njnt)]
        for joint in joints:
            plant.AddJointActuator(f"{joint.name()}_torque", joint)
        plant.mutable_gravity_field().set_gravity_vector(np.array(model.opt.gravity))
        plant.Finalize()
        self.context = plant.CreateDefaultContext()
        self.order = [joint.velocity_start() for joint in joints]
        inputs = [plant.get_joint_actuator(JointActuatorIndex(i)) for i in range(plant.num_actuators())]
        self.torques = [joints.index(actuator.joint()) for actuator in inputs]

    def mass_matrix(self, q: Array) -> Array:
        """M, by CalcMassMatrix."""
        self._set(q)
        return np.asarray(self.plant.CalcMassMatrix(self.context)[np.ix_(self.order, self.order)])

    def bias(self, q: Array, v: Array) -> Array:
        """CalcBiasTerm, which has no gravity, less CalcGravityGeneralizedForces."""
        self._set(q, v)
        bias = self.plant.CalcBiasTerm(self.context) - self.plant.CalcGravityGeneralizedForces(self.context)
        return np.asarray(bias[self.order])

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """By CalcInverseDynamics, gravity taken as an applied force."""
        from pydrake.multibody.tree import MultibodyForces

        self._set(q, v)
        forces = MultibodyForces(self.plant)
        self.plant.CalcForceElementsContribution(self.context, forces)
        return np.asarray(self.plant.CalcInverseDynamics(self.context, self._ours(a), forces)[self.order])

    def simulate(self, q: Array, v: Array, torques: Array, dt: float, step: float) -> Array:
        """By Drake's third-order Runge-Kutta integrator (its Simulator's default), steps fixed."""
        from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig

        simulator = Simulator(self.plant)
        scheme = SimulatorConfig(integration_scheme="runge_kutta3", max_step_size=step, use_error_control=False)
        ApplySimulatorConfig(scheme, simulator)
        context = simulator.get_mutable_context()
        self.plant.SetPositions(context, self._ours(q))
        self.plant.SetVelocities(context, self._ours(v))
        port = self.plant.get_actuation_input_port()
        nodes = [np.array(q)]
        for i, torque in enumerate(torques):
            port.FixValue(context, torque[self.torques])
            if i == 0:
                simulator.Initialize()
            simulator.AdvanceTo((i + 1) * dt)
            nodes.append(self.plant.GetPositions(context)[self.order])
        return np.array(nodes)

    def _set(self, q: Array, v: Array | None = None) -> None:
        self.plant.SetPositions(self.context, self._ours(q))
        self.plant.SetVelocities(self.context, self._ours(np.zeros_like(q) if v is None else v))

    def _ours(self, values: Array) -> Array:
        out = np.empty(len(self.order))
        out[self.order] = values
        return out


def load(model: Any) -> Dynamics:
    """The model, through URDF."""
    return DrakeDynamics(model)


ENGINE = Engine(
    "Drake",
    "drake",
    "pydrake",
    "drake>=1.40",
    integrator="RK3 of its Simulator, fixed steps",
    order=3,
    reads="URDF",
    load=load,
    distribution="drake",
)

"""OpenSim (Seth et al. 2018, doi 10.1371/journal.pcbi.1006223): a model built by its API, computed by Simbody."""

from __future__ import annotations

from typing import Any

import numpy as np

from mjhcmc.engines.base import Array, Dynamics, Engine
from mjhcmc.engines.urdf import link_inertia, link_origin, matrix_of, roll_pitch_yaw


class OpensimDynamics:
    """An OpenSim model of bodies, PinJoints and coordinate actuators."""

    def __init__(self, model: Any) -> None:
        import opensim

        self.osim, self.nv = opensim, int(model.nv)
        opensim.Logger.setLevelString("Off")
        self.model = self._build(model)
        self.state = self.model.initSystem()
        self.matter = self.model.getMatterSubsystem()
        coordinates = self.model.getCoordinateSet()
        self.coordinates = [coordinates.get(f"q{j}") for j in range(self.nv)]
        self.order = self._order()

    def mass_matrix(self, q: Array) -> Array:
        """M, by Simbody's calcM."""
        self._realize(q, 0 * q)
        M = self.osim.Matrix()
        self.matter.calcM(self.state, M)
        return np.array([[M.get(i, k) for k in self.order] for i in self.order])

    def bias(self, q: Array, v: Array) -> Array:
        """The residual force at zero acceleration."""
        return self.inverse_dynamics(q, v, 0 * q)

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """By calcResidualForceIgnoringConstraints, gravity's forces on the bodies applied."""
        self._realize(q, v)
        known = self.osim.Vector(self.nv, 0.0)
        for place, value in zip(self.order, a, strict=True):
            known.set(place, float(value))
        bodies = self.model.getGravityBodyForces(self.state)
        found = self.osim.Vector()
        self.matter.calcResidualForceIgnoringConstraints(
            self.state, self.osim.Vector(self.nv, 0.0), bodies, known, found
        )
        return np.array([found.get(place) for place in self.order])

    def simulate(self, q: Array, v: Array, torques: Array, dt: float, step: float) -> Array:
        """By OpenSim's Manager: Runge-Kutta-Merson."""
        state = self.osim.State(self.state)
        state.setTime(0.0)
        for coordinate, angle, speed in zip(self.coordinates, q, v, strict=True):
            coordinate.setValue(state, float(angle), False)
            coordinate.setSpeedValue(state, float(speed))
        nodes = [np.array(q)]
        for i, torque in enumerate(torques):
            for actuator, value in zip(self.actuators, torque, strict=True):
                actuator.overrideActuation(state, True)
                actuator.setOverrideActuation(state, float(value))
            manager = self.osim.Manager(self.model)
            manager.setIntegratorMethod(self.osim.Manager.IntegratorMethod_RungeKuttaMerson)
            manager.setIntegratorFixedStepSize(step)
            manager.initialize(state)
            state = self.osim.State(manager.integrate((i + 1) * dt))  # a copy: the manager's own ends with it
            nodes.append(np.array([coordinate.getValue(state) for coordinate in self.coordinates]))
        return np.array(nodes)

    def _build(self, model: Any) -> Any:
        """OpenSim's pins turn about the z axis of their frames; links are as in the URDF."""
        osim = self.osim
        built = osim.Model()
        built.setUseVisualizer(False)
        built.setGravity(_vec3(osim, model.opt.gravity))
        frames = [built.getGround()]
        self.actuators = []
        for b in range(1, model.nbody):
            com, inertia = link_inertia(model, b)
            pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
            own = osim.Inertia(*(float(inertia[i, k]) for i, k in pairs))
            body = osim.Body(f"body{b}", float(model.body_mass[b]), _vec3(osim, com), own)
            built.addBody(body)
            parent, turn = frames[int(model.body_parentid[b])], matrix_of(model.body_quat[b])
            j = int(model.body_jntadr[b])
            pin = _z_to(model.jnt_axis[j]) if j >= 0 else np.eye(3)
            places = (
                parent, _vec3(osim, link_origin(model, b)), _vec3(osim, _body_xyz(turn @ pin)),
                body, osim.Vec3(0), _vec3(osim, _body_xyz(pin)),
            )  # fmt: skip
            joint = (osim.PinJoint if j >= 0 else osim.WeldJoint)(f"joint{b}", *places)
            if j >= 0:
                joint.updCoordinate().setName(f"q{j}")
            built.addJoint(joint)
            frames.append(body)
        for j in range(model.njnt):
            actuator = osim.CoordinateActuator(f"q{j}")
            actuator.setName(f"torque{j}")
            actuator.setOptimalForce(1.0)
            built.addForce(actuator)
            self.actuators.append(actuator)
        return built

    def _realize(self, q: Array, v: Array) -> None:
        for coordinate, angle, speed in zip(self.coordinates, q, v, strict=True):
            coordinate.setValue(self.state, float(angle), False)
            coordinate.setSpeedValue(self.state, float(speed))
        self.model.realizeDynamics(self.state)

    def _order(self) -> list[int]:
        """Where each coordinate's speed is in Simbody's vectors."""
        order = []
        for j in range(self.nv):
            self._realize(np.zeros(self.nv), np.eye(self.nv)[j])
            order.append(int(np.argmax([self.state.getU().get(i) for i in range(self.nv)])))
        return order


def _vec3(osim: Any, values: Array) -> Any:
    return osim.Vec3(*(float(value) for value in values))


def _z_to(axis: Array) -> Array:
    """A rotation (3, 3) that takes z to a unit vector."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(other, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def _body_xyz(turn: Array) -> Array:
    """(3,) rad: about x, then the new y, then the new z, which give the rotation (3, 3)."""
    return -roll_pitch_yaw(turn.T)


def load(model: Any) -> Dynamics:
    """Bodies and PinJoints, made one by one."""
    return OpensimDynamics(model)


ENGINE = Engine(
    "OpenSim", "opensim", "opensim", "opensim>=4.6", integrator="Runge-Kutta-Merson of its Manager, fixed steps",
    order=4, reads="its API", load=load,
)  # fmt: skip

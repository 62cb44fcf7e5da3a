"""The Hill models against the OpenSim package itself, where it is installed: other muscles than those of the tables."""

from typing import Any

import numpy as np
import pytest

from mjhcmc.hill import (
    DEGROOTE_FREGLY_ACTIVATION,
    MILLARD_ACTIVATION,
    THELEN_ACTIVATION,
    Curves,
    DeGrooteFreglyPassive,
    FirstOrderActivation,
    HillModel,
    MuscleParameters,
    SmoothActivation,
    degroote_fregly2016,
    millard2012,
    muscle_stiffness,
    rigid_tendon,
    static_equilibrium,
    thelen2003,
)

opensim = pytest.importorskip("opensim")

FORCE, FIBER, SLACK, PENNATION = 1000.0, 0.08, 0.2, 0.3
KINDS: dict[str, tuple[Curves, FirstOrderActivation | SmoothActivation]] = {
    "Millard2012EquilibriumMuscle": (millard2012(), MILLARD_ACTIVATION),
    "Thelen2003Muscle": (thelen2003(), THELEN_ACTIVATION),
    "DeGrooteFregly2016Muscle": (
        degroote_fregly2016(passive=DeGrooteFreglyPassive(strain=0.6), fiber_damping=0.0),  # the class's own defaults
        DEGROOTE_FREGLY_ACTIVATION,
    ),
}


def hill(kind: str) -> HillModel:
    return HillModel(MuscleParameters(FORCE, FIBER, SLACK, PENNATION), KINDS[kind][0])


class Bench:
    """One of OpenSim's muscles between the ground and a slider, whose coordinate is its length."""

    def __init__(self, kind: str, rigid: bool = False) -> None:
        opensim.Logger.setLevelString("Off")
        self.model = opensim.Model()
        body = opensim.Body("weight", 1.0, opensim.Vec3(0), opensim.Inertia(1, 1, 1, 0, 0, 0))
        joint = opensim.SliderJoint("slider", self.model.getGround(), body)
        muscle = getattr(opensim, kind)()
        muscle.setName("muscle")
        muscle.setMaxIsometricForce(FORCE)
        muscle.setOptimalFiberLength(FIBER)
        muscle.setTendonSlackLength(SLACK)
        muscle.setPennationAngleAtOptimalFiberLength(PENNATION)
        muscle.set_ignore_tendon_compliance(rigid)
        muscle.addNewPathPoint("origin", self.model.getGround(), opensim.Vec3(0))
        muscle.addNewPathPoint("insertion", body, opensim.Vec3(0))
        self.model.addBody(body)
        self.model.addJoint(joint)
        self.model.addForce(muscle)
        self.state: Any = self.model.initSystem()
        self.muscle = opensim.Muscle.safeDownCast(self.model.getForceSet().get(0))
        self.coordinate = joint.getCoordinate()

    def settle(self, activation: float, length: float, velocity: float = 0.0) -> None:
        self.coordinate.setValue(self.state, length)
        self.coordinate.setSpeedValue(self.state, velocity)
        self.muscle.setActivation(self.state, activation)
        self.muscle.computeEquilibrium(self.state)
        self.model.realizeDynamics(self.state)


@pytest.mark.parametrize("kind", KINDS)
def test_static_equilibrium(kind: str) -> None:
    bench = Bench(kind)
    grid = [(a, length) for a in (0.02, 0.3, 0.7, 1.0) for length in np.linspace(0.25, 0.32, 8)]
    theirs = []
    for a, length in grid:
        bench.settle(a, length)
        theirs.append((bench.muscle.getTendonForce(bench.state), bench.muscle.getFiberLength(bench.state)))
    state = static_equilibrium(hill(kind), *np.array(grid).T)
    force, length = np.array(theirs).T
    assert np.ptp(force) > 0.8 * FORCE
    np.testing.assert_allclose(state.tendon_force / FORCE, force / FORCE, rtol=0, atol=1e-6)
    np.testing.assert_allclose(state.fiber_length / FIBER, length / FIBER, rtol=0, atol=1e-6)


@pytest.mark.parametrize("kind", ["Millard2012EquilibriumMuscle", "DeGrooteFregly2016Muscle"])
def test_rigid_tendon(kind: str) -> None:
    bench = Bench(kind, rigid=True)
    grid = [(a, x, v) for a in (0.02, 0.3, 1.0) for x in (0.25, 0.27, 0.3) for v in (-0.5, -0.1, 0.0, 0.2)]
    theirs = []
    for a, length, velocity in grid:
        bench.settle(a, length, velocity)
        theirs.append(bench.muscle.getTendonForce(bench.state))
    state = rigid_tendon(hill(kind), *np.array(grid).T)
    np.testing.assert_allclose(state.tendon_force / FORCE, np.array(theirs) / FORCE, rtol=0, atol=1e-6)


def test_stiffness_of_millards_muscle() -> None:
    kind = "Millard2012EquilibriumMuscle"
    bench, model = Bench(kind), hill(kind)
    for a, length in ((0.2, 0.27), (0.9, 0.28), (0.5, 0.31)):
        bench.settle(a, length)
        ours = muscle_stiffness(model, static_equilibrium(model, a, length))
        muscle, state = bench.muscle, bench.state
        assert ours.fiber == pytest.approx(muscle.getFiberStiffness(state), rel=1e-4, abs=1e-3 * FORCE)
        assert ours.fiber_along_tendon == pytest.approx(muscle.getFiberStiffnessAlongTendon(state), rel=1e-4)
        assert ours.tendon == pytest.approx(muscle.getTendonStiffness(state), rel=1e-4)
        assert ours.musculotendon == pytest.approx(muscle.getMuscleStiffness(state), rel=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_activation_dynamics(kind: str) -> None:
    bench, dynamics = Bench(kind), KINDS[kind][1]
    names = [bench.model.getStateVariableNames().get(k) for k in range(bench.model.getNumStateVariables())]
    name = next(name for name in names if name.endswith("activation"))
    for a, u in ((0.05, 0.5), (0.5, 0.05), (0.3, 1.0), (0.9, 0.2), (0.02, 0.01), (0.4, 0.4)):
        bench.settle(a, 0.28)
        bench.model.realizeVelocity(bench.state)
        bench.model.setControls(bench.state, opensim.Vector(1, u))
        bench.model.realizeAcceleration(bench.state)
        theirs = bench.model.getStateVariableDerivativeValue(bench.state, name)
        assert dynamics.rate(u, a) == pytest.approx(theirs, rel=1e-9, abs=1e-9)

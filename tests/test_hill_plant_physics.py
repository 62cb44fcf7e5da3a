"""The plant with Hill muscles against scipy's integrators, the NumPy muscles, energy, and differences of forces."""

import mujoco
import numpy as np
import pytest
from hill_bodies import Free, arm, assert_states, leg_state, lengths_of, packed, start, undamped
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import mjhcmc
from mjhcmc import HillPlant, MujocoPlant, hill
from mjhcmc.hill_muscles import hill_model
from mjhcmc.hosted.lockstep import HillLockstep
from mjhcmc.plant import State
from mjhcmc.surroundings import Surroundings


@pytest.fixture(scope="module")
def smooth_arm():
    """No limits, no contacts, point to point paths: as smooth as its muscles."""
    return arm()


U = np.array([0.7, 0.4, 0.5])

CASES = [("degroote-fregly", "rigid"), ("degroote-fregly", "compliant"), ("millard", "compliant"),
         ("thelen", "rigid"), ("thelen", "compliant"), ("mujoco", "rigid")]  # fmt: skip


@pytest.mark.parametrize(("curves", "tendon"), CASES, ids=[f"{c}-{t}" for c, t in CASES])
def test_a_free_standing_simulation_agrees(smooth_arm, curves, tendon):
    """Excitations over activations all the while, so that the activation's rate has no kink."""
    model, reserve, T = smooth_arm, np.array([0.4, -0.2]), 0.03
    plants = [HillPlant(model, curves, tendon, physics_dt=h) for h in (5e-4, 2.5e-4)]
    state = start(model, plants[0], [0.05, 0.1], [0.2, 0.3])
    wanted = Free(model, hill_model(model, curves), tendon, reserve).run(state, U, T)
    errors = []
    for plant in plants:
        plant.set_state(state)
        plant.advance(U, reserve, round(T / plant.physics_dt))
        errors.append(np.abs(packed(plant.get_state()) - wanted).max() / np.abs(wanted).max())
    assert errors[1] < 1e-6
    assert errors[1] < errors[0] / 4 or errors[1] < 1e-11


@pytest.mark.parametrize("tendon", ["rigid", "compliant"])
def test_order_four(smooth_arm, tendon):
    """Halved steps have a sixteenth of the error; De Groote and Fregly's curves are smooth everywhere."""
    T, ends = 0.064, []
    for n_step in (32, 64, 128, 1024):
        plant = HillPlant(smooth_arm, "degroote-fregly", tendon, physics_dt=T / n_step)
        start(smooth_arm, plant, [0.05, 0.1], [0.2, 0.3])
        plant.advance(U, np.zeros(2), n_step)
        ends.append(packed(plant.get_state()))
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    orders = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    assert errors[2] > 1e-13  # not rounding
    assert (orders > 3.7).all()
    assert orders[1] < 4.6


def test_the_leg_agrees_with_a_free_standing_simulation(leg8):
    """Millard's curves, compliant tendons, wrapping paths, muscles of all kinds: the same but for RK4's own error."""
    T, u, reserve, errors = 0.01, np.linspace(0.3, 0.9, 8), np.array([2.0, -1.0, 0.5]), []
    plants = [HillPlant(leg8, "millard", "compliant", physics_dt=h) for h in (5e-4, 2.5e-4, 1.25e-4)]
    state = start(leg8, plants[0], [0.1, -0.25, 0.05], [0.5, -1.0, 1.0], 0.2)
    wanted = Free(leg8, hill_model(leg8, "millard"), "compliant", reserve).run(state, u, T)
    for plant in plants:
        plant.set_state(state)
        plant.advance(u, reserve, round(T / plant.physics_dt))
        errors.append(np.abs(packed(plant.get_state()) - wanted).max() / np.abs(wanted).max())
    assert errors[2] < 1e-6
    assert errors[0] > 10 * errors[1] > 100 * errors[2]


@pytest.mark.parametrize("curves", ["millard", "thelen", "degroote-fregly"])
def test_fibers_follow_the_references_fiber_velocity(leg8, curves):
    """The fibers' equation alone, along the recorded lengths, by an implicit integrator."""
    plant, n = HillPlant(leg8, curves, "compliant", physics_dt=2.5e-4), 80
    start(leg8, plant, [0.1, -0.3, 0.0], [1.0, -1.0, 2.0], 0.2)
    u = np.linspace(0.05, 0.9, 8)
    record, lengths = [plant.get_state()], []
    for _ in range(n):
        plant.advance(u, np.zeros(3), 1)
        record.append(plant.get_state())
    for state in record:
        plant.set_state(state)
        plant.forward()
        lengths.append(plant.mj_data.actuator_length[leg8.mj_model.actuator_outadr[leg8.muscle_ids]].copy())
    t = np.array([s.time for s in record])
    path, active = CubicSpline(t, lengths), CubicSpline(t, [s.activation for s in record])
    model = hill_model(leg8, curves)

    def rate(time, fiber):
        return hill.fiber_velocity(model, np.clip(active(time), 0, 1), fiber, path(time))

    found = solve_ivp(rate, (0, t[-1]), record[0].fiber_length, "LSODA", t_eval=t[::10], rtol=1e-9, atol=1e-11)
    wanted = np.array([s.fiber_length for s in record[::10]]).T
    optimal = model.muscles.optimal_fiber_length[:, None]
    np.testing.assert_allclose(wanted / optimal, found.y / optimal, atol=2e-6)
    assert np.ptp(wanted / optimal, axis=1).max() > 0.02


# --- forces, energy, slopes ---------------------------------------------------------------------------------------

EVERY = [("millard", "rigid"), ("millard", "compliant"), ("thelen", "rigid"), ("thelen", "compliant"),
         ("degroote-fregly", "rigid"), ("degroote-fregly", "compliant"), ("mujoco", "rigid")]  # fmt: skip
every = pytest.mark.parametrize(("curves", "tendon"), EVERY, ids=[f"{c}-{t}" for c, t in EVERY])


def travel(model, curves, tendon, n_step=40, knee=-0.3):
    """A plant, and the states that it passes."""
    plant = HillPlant(model, curves, tendon)
    start(model, plant, [0.1, knee, 0.05], [1.0, -1.0, 2.0], 0.3)
    record = [plant.get_state()]
    for k in range(n_step):
        plant.advance(np.clip(np.linspace(-0.2, 1.0, 8) + 0.3 * np.sin(k / 5), 0, 1), np.zeros(3), 1)
        record.append(plant.get_state())
    return plant, record


@every
def test_forces_at_nodes_are_the_reference_muscles(leg8, curves, tendon):
    plant, record = travel(leg8, curves, tendon)
    hosts, reserve = plant.hosted, np.array([1.0, -2.0, 0.5])
    plants = HillLockstep([leg8], [hosts], 1e-3, [Surroundings()])
    rows = np.array([plants.rows([state])[0] for state in record])
    nodes = plants.nodes(0, rows, np.tile(reserve, (len(record), 1)))
    free = Free(leg8, hill_model(leg8, curves), tendon, reserve)
    F0 = hosts.hill.muscles.max_isometric_force
    for k, state in enumerate(record):
        L, V, R = free.paths(state.qpos, state.qvel)
        force = free.muscles(state.activation, state.fiber_length, L, V).tendon_force
        if curves == "mujoco":  # whose damping stays with the path
            ids = leg8.muscle_ids
            force = hill.rigid_tendon(undamped(free.hill), state.activation, L, V).tendon_force
            damping = leg8.mj_model.tendon_damping.reshape(leg8.mj_model.ntendon, -1)[:, 0]
            force = force + damping[leg8.mj_model.actuator_trnid[ids, 0]] * V
        np.testing.assert_allclose(nodes.muscle_force[k] / F0, force / F0, atol=1e-9)
        scale = np.abs(R.T * force).sum()
        np.testing.assert_allclose(nodes.muscle_moment[k], R.T @ force, atol=1e-9 * scale)
        np.testing.assert_allclose(nodes.net_joint_moment[k], R.T @ force + reserve, atol=1e-8 * scale)


@every
def test_the_single_plant_and_lock_step_see_the_same(leg8, curves, tendon):
    plant, record = travel(leg8, curves, tendon, 5)
    plants, reserve = plant.lockstep, np.array([[0.5, -1.0, 0.2]])
    state = record[-1]
    rows = plants.rows([state])
    view = plants.view(np.arange(1), rows, reserve)
    plant.set_state(state)
    plant.set_input(None, reserve[0])
    qacc = plant.forward().copy()
    F0 = plant.hosted.hill.muscles.max_isometric_force
    np.testing.assert_allclose(view.around.qacc[0], qacc, rtol=1e-9)
    np.testing.assert_allclose(plants.acceleration(np.arange(1), rows, reserve)[0], qacc, rtol=1e-9)
    np.testing.assert_allclose(view.force[0] / F0, plant.muscle_force() / F0, atol=1e-12)
    gain, bias = plant.gain_and_bias()
    np.testing.assert_allclose(view.around.gain[0], gain, rtol=1e-12)
    np.testing.assert_allclose(view.around.bias[0] / F0, bias / F0, atol=1e-12)
    M = np.empty((3, 3))
    mujoco.mj_fullM(plant.mj_model, plant.mj_data, M)
    np.testing.assert_allclose(view.around.M[0], M, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(view.around.B[0], view.R[0].T * gain, rtol=1e-12)
    assert_states(plants.layout.state(rows[0]), state, rtol=0)


def test_linearize_is_the_views(leg8):
    """The stiffness only where it is asked for."""
    plant, record = travel(leg8, "millard", "compliant", 3)
    plants, reserve, ids = plant.lockstep, np.array([[0.5, -1.0, 0.2]]), np.arange(1)
    rows = plants.rows([record[-1]])
    whole, bare = plants.view(ids, rows, reserve).around, plants.linearize(ids, rows, reserve)
    assert bare.K is None
    for name in set(bare._fields) - {"K"}:
        np.testing.assert_array_equal(getattr(bare, name), getattr(whole, name))
    np.testing.assert_array_equal(plants.linearize(ids, rows, reserve, stiffness=True).K, whole.K)


@every
def test_the_outlooks_excitation_gives_the_force_asked_for(leg8, curves, tendon):
    """Where the path keeps still: activation and fiber go on alone, by scipy's integrator."""
    plant, T = HillPlant(leg8, curves, tendon, physics_dt=2.5e-4), 0.01
    now = start(leg8, plant, [0.1, -0.3, 0.05], np.zeros(3), np.linspace(0.1, 0.6, 8))
    outlook = plant.outlook(now, now, 40, np.full(8, 0.02))
    model = undamped(plant.hosted.hill) if curves == "mujoco" else plant.hosted.hill
    plant.set_state(now)
    L, _ = lengths_of(plant)
    gain, bias = plant.gain_and_bias()

    def after(u):
        def rate(_, x):
            fiber = [] if tendon == "rigid" else hill.fiber_velocity(model, np.clip(x[:8], 0, 1), x[8:], L)
            return np.concatenate([hill.MUJOCO_ACTIVATION.rate(u, np.clip(x[:8], 0, 1)), fiber])

        x = solve_ivp(rate, (0, T), np.append(now.activation, now.fiber_length), "LSODA", rtol=1e-9, atol=1e-11).y[
            :, -1
        ]
        state = hill.rigid_tendon(model, x[:8], L) if tendon == "rigid" else hill.fiber_dynamics(model, x[:8], x[8:], L)
        return (state.tendon_force - bias) / gain

    F0 = model.muscles.max_isometric_force
    for share in (0.2, 0.8):
        goal = outlook.low + share * (outlook.high - outlook.low)
        u = outlook.excitation(goal)
        assert ((u >= 0.02) & (u <= 1)).all()
        np.testing.assert_allclose(after(u) * gain / F0, goal * gain / F0, atol=2e-6)
    np.testing.assert_allclose(after(np.full(8, 0.02)) * gain / F0, outlook.low * gain / F0, atol=2e-6)
    np.testing.assert_allclose(after(np.ones(8)) * gain / F0, outlook.high * gain / F0, atol=2e-6)
    np.testing.assert_array_equal(outlook.excitation(outlook.high + 10), 1.0)
    np.testing.assert_array_equal(outlook.excitation(outlook.low - 10), 0.02)


def test_the_outlook_of_mujocos_own_muscles_is_mujocos_plants(leg8):
    """There, effective activation is activation, and the path does not matter."""
    hosted, own = HillPlant(leg8, "mujoco", "rigid"), MujocoPlant(leg8)
    now = leg_state(leg8, 1)
    expected = State(0.01, now.qpos + 0.01 * now.qvel, 1.1 * now.qvel, now.activation, now.warmstart)
    ours, wanted = (plant.outlook(now, expected, 10, np.zeros(8)) for plant in (hosted, own))
    able = hosted.gain_and_bias()[0] > 0.05 * hosted.hosted.hill.muscles.max_isometric_force
    assert able.sum() >= 6
    np.testing.assert_allclose(ours.low[able], wanted.low[able], atol=1e-9)
    np.testing.assert_allclose(ours.high[able], wanted.high[able], atol=1e-9)
    goal = 0.3 * wanted.low + 0.7 * wanted.high
    np.testing.assert_allclose(ours.excitation(goal)[able], wanted.excitation(goal)[able], atol=1e-8)


def test_an_outlook_from_a_state_without_fiber_lengths_is_from_equilibrium(leg8):
    plant, state = HillPlant(leg8, "millard", "compliant"), leg_state(leg8)
    plant.set_state(state)
    told = plant.get_state()
    wanted = plant.outlook(told, told, 10, np.full(8, 0.01))
    found = plant.outlook(state, told, 10, np.full(8, 0.01))
    np.testing.assert_array_equal(found.low, wanted.low)
    np.testing.assert_array_equal(found.high, wanted.high)
    goal = 0.5 * (wanted.low + wanted.high)
    np.testing.assert_array_equal(found.excitation(goal), wanted.excitation(goal))


def smooth_forces(free, qpos, qvel, a, fiber):
    """What acts on the joints but for constraints and reserves, by MuJoCo and the reference muscles."""
    L, V, R = free.paths(qpos, qvel)
    free.d.qfrc_applied[:] = 0.0
    mujoco.mj_forward(free.m, free.d)
    muscles = R.T @ free.muscles(a, fiber, L, V).tendon_force
    return free.d.qfrc_passive + free.d.qfrc_actuator - free.d.qfrc_bias + muscles


@pytest.mark.parametrize("limit", [False, True], ids=["free", "at a limit"])
@pytest.mark.parametrize("tendon", ["rigid", "compliant"])
def test_damping_and_stiffness_are_slopes_of_the_smooth_forces(tendon, limit):
    """Central differences of them; a constraint in play, which is none of them, changes nothing."""
    joint = 'damping=".7" stiffness="3" armature=".02"'
    model = arm(joint=joint + (' range="-20 15" limited="true"' if limit else ""))
    plant = HillPlant(model, "degroote-fregly", tendon)
    state = start(model, plant, [0.1, np.radians(16) if limit else 0.2], [1.0, -0.5], [0.3, 0.5, 0.2])
    plants = plant.lockstep
    around = plants.view(np.arange(1), plants.rows([state]), np.array([[1.0, -1.0]])).around
    free = Free(model, hill_model(model, "degroote-fregly"), tendon, np.zeros(2))
    a, fiber, h, D, K = state.activation, state.fiber_length, 1e-6, np.empty((2, 2)), np.empty((2, 2))
    for j, e in enumerate(h * np.eye(2)):
        low, high = (smooth_forces(free, state.qpos, state.qvel + s * e, a, fiber) for s in (-1, 1))
        D[:, j] = -(high - low) / (2 * h)
        low, high = (smooth_forces(free, state.qpos + s * e, state.qvel, a, fiber) for s in (-1, 1))
        K[:, j] = -(high - low) / (2 * h)
    plant.forward()
    assert (plant.mj_data.nefc > 0) == limit
    np.testing.assert_allclose(around.D[0], D, rtol=1e-3, atol=1e-4 * np.abs(D).max())
    np.testing.assert_allclose(around.K[0], K, rtol=1e-3, atol=1e-4 * np.abs(K).max())
    np.testing.assert_allclose(mjhcmc.dynamics.damping_matrix(plant), D, rtol=1e-3, atol=1e-4 * np.abs(D).max())
    np.testing.assert_allclose(mjhcmc.dynamics.stiffness_matrix(plant), K, rtol=1e-3, atol=1e-4 * np.abs(K).max())


@pytest.mark.parametrize("curves", ["millard", "degroote-fregly"])
def test_slopes_of_a_compliant_muscle(leg8, curves):
    """dF/dl, dF/dL, dv/dl, dv/dL, by central differences of the reference."""
    plant, record = travel(leg8, curves, "compliant", 5)
    view = plant.lockstep.view(np.arange(1), plant.lockstep.rows([record[-1]]), np.zeros((1, 3)))
    model, a, l, L = plant.hosted.hill, record[-1].activation, record[-1].fiber_length, view.path[0, :, 0]  # noqa: E741
    h = 1e-6 * model.muscles.optimal_fiber_length

    def slope(name, dl, dL):
        high, low = (hill.fiber_dynamics(model, a, l + s * dl, L + s * dL) for s in (1, -1))
        return (getattr(high, name) - getattr(low, name)) / (2 * h)

    wanted = [slope(name, *way) for name in ("tendon_force", "fiber_velocity") for way in ((h, 0), (0, h))]
    np.testing.assert_allclose(view.slopes[0], np.transpose(wanted), rtol=1e-3)
    plant.forward()
    assert plant.internal_rate() == pytest.approx(-np.min(wanted[2]), rel=1e-3)


def test_an_undamped_passive_arm_keeps_its_energy(smooth_arm):
    """Rigid tendons, activation 0: kinetic, potential and the fibers' elastic energy; RK4 loses next to nothing."""
    model = undamped(hill_model(smooth_arm, "degroote-fregly"))
    plant = HillPlant(smooth_arm, model, "rigid", physics_dt=5e-4)
    start(smooth_arm, plant, [0.3, 0.2], [1.0, -2.0], 0.0)
    energies, parts = [], []
    for _ in range(20):
        elastic = fiber_energy(model, plant_fibers(plant)).sum()
        energies.append(mechanical_energy(plant) + elastic)
        parts.append(elastic)
        plant.advance(np.zeros(3), np.zeros(2), 20)
    assert np.ptp(parts) > 0.05  # the fibers do take part
    np.testing.assert_allclose(energies, energies[0], atol=1e-8)


def test_what_active_fibers_work_is_what_bodies_and_springs_gain(smooth_arm):
    """Compliant tendons: the whole energy changes by the contractile elements' and the dampers' work."""
    plant = HillPlant(smooth_arm, "degroote-fregly", "compliant", physics_dt=1.25e-4)
    model = plant.hosted.hill
    state = start(smooth_arm, plant, [0.1, 0.2], [0.5, -1.0], 0.2)
    m, energies, powers = model.muscles, [], []
    for _ in range(401):
        state = plant.get_state()
        L, V = lengths_of(plant)
        muscle = hill.fiber_dynamics(model, state.activation, state.fiber_length, L, V)
        rate = model.curves.tendon.stiffness
        strain = muscle.tendon_length / m.tendon_slack_length - 1
        spring = m.max_isometric_force * m.tendon_slack_length * 0.2 * (np.expm1(rate * strain) / rate - strain)
        energies.append(mechanical_energy(plant) + (spring + fiber_energy(model, state.fiber_length)).sum())
        powers.append(-((muscle.active_force + muscle.damping_force) * muscle.fiber_velocity).sum())
        plant.advance(U, np.zeros(2), 1)
    p = np.array(powers)
    work = (p[0] + p[-1] + 4 * p[1:-1:2].sum() + 2 * p[2:-1:2].sum()) * 1.25e-4 / 3  # Simpson's rule
    gained = energies[-1] - energies[0]
    assert abs(gained) > 0.5
    assert work == pytest.approx(gained, rel=5e-7)


def mechanical_energy(plant):
    m, d = plant.mj_model, plant.mj_data
    plant.forward()
    mujoco.mj_energyPos(m, d)
    mujoco.mj_energyVel(m, d)
    return float(d.energy.sum())


def plant_fibers(plant):
    m = plant.hosted.hill.muscles
    return np.hypot(lengths_of(plant)[0] - m.tendon_slack_length, m.fiber_width)


def fiber_energy(model, fiber):
    """(n,) J, the integral of De Groote and Fregly's passive force from the optimal length."""
    m = model.muscles
    rate, scale, offset = model.curves.passive.exponential()
    stretch = fiber / m.optimal_fiber_length - 1
    return m.max_isometric_force * m.optimal_fiber_length * (scale * np.expm1(rate * stretch) / rate - offset * stretch)

"""The reference integrator, classical Runge-Kutta and the activation map on any scalar type."""

import mujoco
import numpy as np
import pytest
from exact_tools import engine_of, furthest, model_of
from hypothesis import given, settings
from hypothesis import strategies as st

import mjhcmc
from mjhcmc.activation import activation_after as stepped_activation
from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.exact import scalars
from mjhcmc.exact.activation import activation_after, activation_reference, activation_rk4
from mjhcmc.exact.chain import chain_of, torque_driven_model
from mjhcmc.exact.dynamics import total_energy
from mjhcmc.exact.leg import inverse_dynamics, planar_leg_of
from mjhcmc.exact.reference import floats, integrate, rk4, torque_driven, torque_driven_rk4
from mjhcmc.exact.scalars import COMPLEX, FLOAT, LONGDOUBLE

ARB = scalars.flint_arb(40)
DT, WINDOWS = 0.03125, 16
START = ([0.1, -0.3, 0.2], [0.5, -1.0, 2.0])
TORQUES = np.array([-9.0, 5.0, 1.0]) * np.sin(2 * np.pi * np.arange(WINDOWS) / WINDOWS)[:, None]


@pytest.fixture(scope="module")
def reference():
    """Of the torque-driven leg over half a second, to 35 digits."""
    return torque_driven(planar_leg_of(model_of("leg8")), *START, TORQUES, DT, ARB)[0]


@pytest.mark.parametrize("s", [FLOAT, LONGDOUBLE, COMPLEX, scalars.mpmath(50), ARB], ids=lambda s: s.name)
def test_the_integrator_finds_known_solutions(s):
    """x' = -y, y' = x, z' = 2 t z: cosine, sine and exp(t^2), to the type's digits."""
    found = integrate(lambda t, x: [-x[1], x[0], 2 * t * x[2]], [1.0, 0.0, 1.0], [0.0, 0.5, 2.0], s)
    with s.working():
        for row, t in zip(found, ("0", "0.5", "2"), strict=True):
            t = s.number(t)
            assert furthest(row[:2], [s.cos(t), s.sin(t)], s) < 1e5 * s.epsilon
            assert furthest([row[2] / s.exp(t * t)], [1], s) < 1e5 * s.epsilon


def test_energy_stays_without_damping_and_torque():
    s = scalars.mpmath(36)
    chain = chain_of(model_of("leg8"))
    assert not any(chain.damping)
    q, v = torque_driven(planar_leg_of(chain), *START, [[0.0] * 3] * 5, 0.02, s)
    energies = [total_energy(chain, a, b, s) for a, b in zip(q, v, strict=True)]
    assert furthest(energies[1:], energies[:1] * 5, s) < 1e-30
    assert furthest(q[0], q[-1], s) > 0.05  # it does move


def test_recursions_and_closed_form_move_alike(reference):
    s = scalars.flint_arb(24)
    q, _ = torque_driven(chain_of(model_of("leg8")), *START, TORQUES[:3], DT, s)
    assert furthest(q, reference[:4], ARB) < 1e-18


def test_rk4_is_of_fourth_order_in_extended_precision(reference):
    leg = planar_leg_of(model_of("leg8"))
    steps = (64, 128, 256)  # of 1/2 to 1/8 ms
    error = [furthest(torque_driven_rk4(leg, *START, TORQUES[:2], DT, n, ARB)[0], reference[:3], ARB) for n in steps]
    assert error[-1] < 1e-13  # under what float64 could tell apart from rounding
    assert np.log2(error[:-1]) - np.log2(error[1:]) == pytest.approx([4.0, 4.0], abs=0.05)


def paper_torques(leg, windows=10, dt=0.02, period=0.2):
    """Joint moments of one cycle of the paper's fast movement, of the middle of each window, held over it."""
    size = np.deg2rad([10.0, -20.0, -10.0]) / 2
    w = 2 * np.pi / period
    middles = dt * (np.arange(windows) + 0.5)
    return [
        inverse_dynamics(leg, size * (1 - np.cos(w * t)), size * w * np.sin(w * t), size * w**2 * np.cos(w * t), FLOAT)
        for t in middles
    ]


def test_mujocos_rk4_is_of_fourth_order_and_ours():
    model = model_of("leg8")
    leg, m = planar_leg_of(model), torque_driven_model(model)
    torques, still = paper_torques(leg), [0.0] * 3
    assert m.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4

    def stepped(n):
        d = mujoco.MjData(m)
        m.opt.timestep = 0.02 / n
        rows = [d.qpos.copy()]
        for torque in torques:
            d.qfrc_applied[:] = torque
            mujoco.mj_step(m, d, nstep=n)
            rows.append(d.qpos.copy())
        return np.array(rows)

    exact = floats(torque_driven(leg, still, still, torques, 0.02, ARB)[0], ARB)
    error = [np.abs(stepped(n) - exact).max() for n in (1, 2, 4, 8)]
    assert (np.log2(error[:-1]) - np.log2(error[1:]) >= 4).all()
    ours, _ = torque_driven_rk4(leg, still, still, torques, 0.02, 4, FLOAT)
    np.testing.assert_allclose(stepped(4), ours, rtol=0, atol=1e-13)


def test_a_tree_with_slides_and_damping_moves_as_in_mujoco():
    chain, m, d = engine_of("oblique")
    q0, v0, torque = [0.3, 0.1, -0.4, 0.5], [1.0, -0.2, 2.0, -1.0], [2.0, -1.0, 0.5, 0.3]
    q, v = torque_driven(chain, q0, v0, [torque] * 4, 0.01, LONGDOUBLE)
    m.opt.timestep = 0.01 / 64
    d.qpos[:], d.qvel[:], d.qfrc_applied[:] = q0, v0, torque
    mujoco.mj_step(m, d, nstep=4 * 64)
    np.testing.assert_allclose(d.qpos, floats(q, LONGDOUBLE)[-1], rtol=0, atol=1e-11)
    np.testing.assert_allclose(d.qvel, floats(v, LONGDOUBLE)[-1], rtol=0, atol=1e-9)


def test_complex_step_through_a_whole_motion():
    """d q(T)/d torque: the reference itself can be differentiated."""
    leg, h, d = planar_leg_of(model_of("leg8")), 1e-40, 1e-4
    at = [complex(1.0, h), complex(0.5), complex(-0.2)]
    q, _ = torque_driven(leg, *START, [at], 0.05, COMPLEX)
    ends = [torque_driven(leg, *START, [[1.0 + x, 0.5, -0.2]], 0.05, FLOAT)[0][-1] for x in (d, -d)]
    np.testing.assert_allclose([x.imag / h for x in q[-1]], np.subtract(*ends) / (2 * d), rtol=1e-7)


def test_what_cannot_be_integrated_is_named():
    leg = planar_leg_of(model_of("leg8"))
    with pytest.raises(SettingsError, match="times must increase"):
        integrate(lambda t, x: x, [1.0], [0.0, 1.0, 1.0], FLOAT)
    with pytest.raises(SettingsError, match="below what float64 rounds"):
        integrate(lambda t, x: x, [1.0], [0.0, 1.0], FLOAT, tolerance=1e-20)
    with pytest.raises(SimulationError, match="at time 0: no step"):
        integrate(lambda t, x: [x[0] * x[0]], [1.0], [0.0, 2.0], scalars.mpmath(20))  # 1/(1 - t)
    with pytest.raises(SettingsError, match="must have 3 values"):
        torque_driven(leg, [0.0] * 3, [0.0] * 3, [[0.0] * 2], 0.01, FLOAT)
    with pytest.raises(SettingsError, match="positive length"):
        torque_driven(leg, [0.0] * 3, [0.0] * 3, [[0.0] * 3], 0.0, FLOAT)
    with pytest.raises(SettingsError, match="at least one step"):
        torque_driven_rk4(leg, [0.0] * 3, [0.0] * 3, [[0.0] * 3], 0.01, 0, FLOAT)


def test_rk4_is_exact_for_cubics_only():
    """x' = t^3 integrates exactly, x' = t^4 does not (one step of length 1: Simpson's 5/24)."""
    s = scalars.mpmath(30)
    assert s.size(rk4(lambda t, x: [t * t * t], [0.0], 0.0, 1.0, 1, s)[0] - s.number(0.25)) < 1e-29
    assert s.real(rk4(lambda t, x: [t * t * t * t], [0.0], 0.0, 1.0, 1, s)[0]) == pytest.approx(5 / 24, rel=1e-15)


UNIT = st.floats(0.0, 1.0)


@settings(max_examples=25, deadline=None)
@given(a=UNIT, u=UNIT, time=st.floats(1e-3, 0.05))
def test_activation_in_closed_form_agrees_with_the_reference(a, u, time):
    s = scalars.flint_arb(30)
    exact = activation_after(a, u, 0.01, 0.04, time, s)
    other = activation_reference(a, u, 0.01, 0.04, time, s)
    assert furthest([exact], [other], s) < 1e-24
    assert min(a, u) - 1e-15 <= s.real(exact) <= max(a, u) + 1e-15


def test_activation_in_closed_form_composes():
    """G(t1 + t2) = G(t2) G(t1), on another type."""
    s = scalars.mpmath(40)
    for a, u in ((0.1, 0.9), (0.9, 0.1), (0.0, 1.0)):
        half = activation_after(a, u, 0.01, 0.04, 0.0078125, s)
        assert (
            furthest(
                [activation_after(half, u, 0.01, 0.04, 0.0078125, s)],
                [activation_after(a, u, 0.01, 0.04, 0.015625, s)],
                s,
            )
            < 1e-38
        )


def test_activation_map_is_rk4_of_fourth_order():
    prm = np.array([[0.01, 0.04, 0.0]])
    for a, u in ((0.1, 0.9), (0.9, 0.1), (1.0, 0.0)):
        exact = activation_after(a, u, 0.01, 0.04, 0.0078125, ARB)
        ours = activation_rk4(a, u, 0.01, 0.04, 0.0078125, 8, FLOAT)
        theirs = stepped_activation(np.array([a]), np.array([u]), prm, 0.0078125 / 8, 8)[0]
        assert theirs == pytest.approx(ours, rel=1e-15)
        error = [furthest([activation_rk4(a, u, 0.01, 0.04, 0.0078125, n, ARB)], [exact], ARB) for n in (128, 256, 512)]
        assert np.log2(error[:-1]) - np.log2(error[1:]) == pytest.approx([4.0, 4.0], abs=0.05)


def test_leg8s_muscles_have_the_activation_dynamics_of_the_closed_form():
    """In MuJoCo itself: the muscles' activation after 5 ms of fine steps."""
    model = mjhcmc.MuscleModel.load("leg8")
    m, d = model.mj_model, mujoco.MjData(model.mj_model)
    m.opt.timestep = 0.005 / 256
    d.ctrl[:] = np.linspace(0, 1, m.nu)
    d.act[:] = 0.4
    mujoco.mj_step(m, d, nstep=256)
    for i, muscle in enumerate(model.muscle_names):
        act, deact, smooth = model.activation_parameters[i]
        assert smooth == 0, muscle
        u = float(d.ctrl[model.ctrl_index[i]])
        exact = activation_after(0.4, u, act, deact, 0.005, FLOAT)
        assert d.act[model.act_index[i]] == pytest.approx(exact, abs=1e-11)


def test_activation_outside_its_range_is_refused():
    with pytest.raises(SettingsError, match=r"the excitation 1.5 is not within 0 .. 1"):
        activation_after(0.5, 1.5, 0.01, 0.04, 0.01, FLOAT)
    with pytest.raises(SettingsError, match="time constants must be positive"):
        activation_after(0.5, 0.5, 0.0, 0.04, 0.01, FLOAT)

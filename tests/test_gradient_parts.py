"""The parts of a gradient against complex steps, extended precision, and the engine's own steps."""

import mujoco
import numpy as np
import pytest
from gradient_tools import leg
from hypothesis import given
from hypothesis import strategies as st

from mjhcmc.activation import activation_after
from mjhcmc.allocation import ELASTICITY
from mjhcmc.exact.activation import activation_rate
from mjhcmc.exact.chain import chain_of
from mjhcmc.exact.dynamics import forward_dynamics
from mjhcmc.exact.scalars import COMPLEX
from mjhcmc.gradients import windows as one
from mjhcmc.gradients.along import Nodes, Wanted, stages_along
from mjhcmc.gradients.looks import Looker, States, slope
from mjhcmc.gradients.tangents import activation_slopes, propagate
from mjhcmc.muscle_parameters import FORCE, FORCE_KINDS, muscle_parameters, with_muscle_parameters
from mjhcmc.plant import MujocoPlant, State

RNG = np.random.default_rng(5)
BOTH = np.array([[0.0, 1.0]])


@given(a=st.floats(0.01, 0.99), u=st.floats(0.0, 1.0), act=st.floats(0.005, 0.05), deact=st.floats(0.02, 0.1))
def test_slopes_of_activation_are_those_of_complex_steps(a, u, act, deact):
    if abs(u - a) < 1e-6:
        return
    slopes = np.empty((1, 1, 5))
    activation_slopes(np.array([[a]]), np.array([[u]]), np.array([[act, deact, 0.0]]), BOTH, slopes)
    h = 1e-30
    point = [a, u, act, deact]
    for i in range(4):
        moved = [complex(x, h if i == j else 0.0) for j, x in enumerate(point)]
        exact = activation_rate(*moved, COMPLEX).imag / h
        assert slopes[0, 0, i] == pytest.approx(exact, rel=1e-12, abs=1e-9)


@given(a=st.floats(0.05, 0.95), u=st.floats(0.05, 0.95), width=st.floats(0.02, 0.5))
def test_slopes_of_smoothed_activation_are_central_differences(a, u, width):
    def end(a, u, act, deact):
        h = 1e-7  # a short step is the rate
        prm = np.array([[act, deact, width]])
        return (activation_after(np.array([a]), np.array([u]), prm, h, 1)[0] - a) / h

    slopes = np.empty((1, 1, 5))
    activation_slopes(np.array([[a]]), np.array([[u]]), np.array([[0.01, 0.04, width]]), BOTH, slopes)
    point = np.array([a, u, 0.01, 0.04])
    for i, step in enumerate((1e-4, 1e-4, 1e-5, 1e-5)):
        up, down = point.copy(), point.copy()
        up[i] += step
        down[i] -= step
        numeric = (end(*up) - end(*down)) / (2 * step)
        size = max(1.0, abs(slopes[0, 0]).max())
        assert abs(slopes[0, 0, i] - numeric) < 2e-3 * size  # of differences: 1e-9/1e-7/1e-5 of rounding


def test_slopes_of_the_skeleton_are_those_of_complex_steps():
    """With muscles of no strength, MuJoCo's slopes are those of the closed-form equations of motion."""
    model = leg()
    weak = with_muscle_parameters(model, {FORCE: np.full(model.n_muscle, 1e-9)})
    q, v, s = np.array([0.3, -0.7, 0.1]), np.array([2.0, -3.0, 4.0]), np.array([5.0, -3.0, 1.0])
    at = States(q[None], v[None], np.zeros((1, model.n_muscle)), s[None])
    _, by_position, by_velocity, _ = Looker(weak, 1).around(at)
    chain, h = chain_of(weak), 1e-30
    exact = np.empty((3, 6))
    for i in range(6):
        state = [complex(x, h if i == j else 0.0) for j, x in enumerate([*q, *v])]
        exact[:, i] = [
            x.imag / h for x in forward_dynamics(chain, state[:3], state[3:], list(s.astype(complex)), COMPLEX)
        ]
    found = np.hstack([slope(by_position, "qacc")[0], slope(by_velocity, "qacc")[0]])
    assert np.abs(found - exact).max() < 1e-7 * np.abs(exact).max()


def test_tangents_of_a_window_are_those_of_mujoco_s_steps():
    model = leg()
    n, nv, n_step, h = model.n_muscle, model.nv, 5, 1e-3
    q, v = np.array([0.2, -0.4, 0.05]), np.array([1.0, -2.0, 1.5])
    a, u = RNG.uniform(0.1, 0.6, n), RNG.uniform(0.0, 1.0, n)
    s = np.array([3.0, -1.0, 0.2])

    def end(q, v, a, u, s, model=model):
        plant = MujocoPlant(model, h)
        plant.set_state(State(0.0, q, v, a, np.zeros(nv)))
        plant.set_input(u, s)
        for _ in range(n_step):
            mujoco.mj_step(plant.mj_model, plant.mj_data)
        state = plant.get_state()
        return np.concatenate([state.qpos, state.qvel, state.activation])

    looker = Looker(model, 4 * n_step)
    at = States(q[None], v[None], a[None], s[None])
    wanted = Wanted(FORCE_KINDS, (), 0)
    stages = stages_along(looker, at, end(q, v, a, u, s)[None, :nv], u[None], h, n_step, wanted)
    p = wanted.count(model)
    width = 2 * nv + n  # start states as parameters of their own, behind the muscles'
    dq, dv, da = (np.zeros((rows, n + nv + p + width)) for rows in (nv, nv, n))
    for rows, first in ((dq, 0), (dv, nv), (da, 2 * nv)):
        rows[:, n + nv + p + first + np.arange(len(rows))] = np.eye(len(rows))
    Jp = np.concatenate([stages.Jp[0], np.zeros((*stages.Jp[0].shape[:-1], width))], axis=-1)
    times = np.full((p + width, 2), -1)
    propagate(stages.Jq[0], stages.Jv[0], stages.Ja[0], stages.Js[0], Jp, stages.rates[0], times, h, dq, dv, da)
    exact = np.vstack([dq, dv, da])
    parts, step = [q, v, a, u, s], 1e-6
    columns = [*range(n + nv + p, n + nv + p + width), *range(n + nv)]
    places = [(k, i) for k in range(5) for i in range(len(parts[k]))]
    numeric = np.empty((2 * nv + n, len(columns)))
    for c, (k, i) in enumerate(places):
        sides = []
        for side in (1, -1):
            moved = [part.copy() for part in parts]
            moved[k][i] += side * step
            sides.append(end(*moved))
        numeric[:, c] = (sides[0] - sides[1]) / (2 * step)
    scale = np.abs(numeric).max(axis=1, keepdims=True)
    assert (np.abs(exact[:, columns] - numeric) < 1e-7 * scale).all()
    now = muscle_parameters(model)
    for j, kind in enumerate(FORCE_KINDS):
        for i in range(n):
            sides = []
            for side in (1, -1):
                values = now[kind].copy()
                values[i] *= 1 + side * 1e-6
                sides.append(end(q, v, a, u, s, with_muscle_parameters(model, {kind: values})))
            numeric_one = (sides[0] - sides[1]) / 2e-6
            exact_one = exact[:, n + nv + j * n + i] * now[kind][i]
            assert np.abs(exact_one - numeric_one).max() < 1e-7 * max(1.0, np.abs(numeric_one).max())


@pytest.mark.parametrize("fixed", [(), (1, 4)], ids=["all free", "two at bounds"])
def test_the_allocation_is_differentiated_as_extended_precision_does(fixed):
    """The optimality conditions solved to 40 digits on either side, of a plant that is linear in all it is given."""
    mpmath = pytest.importorskip("mpmath")
    mp = mpmath.mp.clone()
    mp.dps = 40
    rng = np.random.default_rng(11)
    nv, n, p = 2, 5, 1
    B = rng.normal(size=(nv, n)) * 30
    M = np.array([[2.0, 0.3], [0.3, 0.5]])
    B_slopes, M_slopes = rng.normal(size=(nv, n, 2 * nv + p)) * 5, np.zeros((nv, nv, 2 * nv + p))
    M_slopes[0, 0], M_slopes[1, 1] = 0.1 * rng.normal(size=(2, 2 * nv + p))
    a = rng.uniform(0.2, 0.8, n)
    Jq, Jv = rng.normal(size=(2, nv, nv)) * 10
    Ja, Js, Jp = rng.normal(size=(nv, n)) * 20, np.linalg.inv(M), rng.normal(size=(nv, p))
    ends = rng.normal(size=(2 * nv + n, n + nv + p)) * 0.01
    ends[2 * nv :, :n] = np.diag(rng.uniform(0.3, 0.6, n))
    ends[2 * nv :, n : n + nv] = 0.0
    kp, kv = np.array([300.0, 400.0]), np.array([30.0, 40.0])
    missing_v, missing_q = rng.normal(size=(2, nv)) * 1e-3
    w, c = rng.uniform(0.5, 2.0, n), rng.uniform(0.0, 1.0, n)
    price = rng.normal(size=nv) * 0.01
    free = [i for i in range(n) if i not in fixed]
    a0 = np.zeros(n)
    a0[free] = (a + (c * a**2 - B.T @ price) / w)[free]  # so that the conditions hold
    T = np.array([[1.1, 0.05], [-0.02, 0.9]])
    strength = (np.abs(B) / np.sqrt(np.diag(M))[:, None]).sum(axis=1).max()
    C = ELASTICITY / (w + c).mean() * strength**2 * np.diag(M)
    s = np.linalg.solve(T, C * price)
    u = np.full(n, 0.5)
    u[list(fixed)] = 0.0
    nodes = Nodes(*(x[None] for x in (np.zeros(nv), Jq, Jv, Ja, Js, Jp, M, M_slopes, B, B_slopes)))
    choice = one.Choice(
        u, np.tile([0.0, 1.0], (n, 1)), np.full(n, 0.9), a, np.zeros(n), np.zeros(n, dtype=bool), s, missing_v,
        missing_q, kp, kv,
    )  # fmt: skip
    cost = one.Cost(w, a0, c, np.zeros(n))
    slopes = [rng.normal(size=(nv, p)) for _ in range(5)]
    found = one.answer(choice, cost, nodes, 0, ends, np.zeros((n, p)), one.Moved(*slopes), T, 0.0, 1)

    wide = np.vectorize(mp.mpf, otypes=[object])
    E, G_B, G_M = wide(ends), wide(B_slopes), wide(M_slopes)
    qd, vd, ad, kp_slope, kv_slope = (wide(part[:, 0]) for part in slopes)

    def conditions(theta, x):
        """All conditions at du (free), ds, dprice = x."""
        du, ds, dprice = wide(np.zeros(n)), np.array(x[len(free) : len(free) + nv]), np.array(x[len(free) + nv :])
        du[free] = x[: len(free)]
        move = E @ np.array([*du, *ds, theta])
        around = np.array([*move[: 2 * nv], theta])
        now_B, now_M, price_now = wide(B) + G_B @ around, np.diag(wide(M) + G_M @ around), wide(price) + dprice
        act = wide(a) + move[2 * nv :]
        qacc = Jq @ move[:nv] + Jv @ move[nv : 2 * nv] + Ja @ move[2 * nv :] + Js @ ds + Jp[:, 0] * theta
        v_gap = wide(missing_v) + vd * theta - move[nv : 2 * nv]
        q_gap = wide(missing_q) + qd * theta - move[:nv]
        r = ad * theta + (wide(kv) + kv_slope * theta) * v_gap + (wide(kp) + kp_slope * theta) * q_gap - qacc
        g = wide(w) * (act - wide(a0)) + wide(c) * act**2 - now_B.T @ price_now
        sums = [sum(abs(row)) / mp.sqrt(inertia) for row, inertia in zip(now_B, now_M, strict=True)]
        scale = mp.mpf(ELASTICITY) / mp.mpf((w + c).mean()) * max(sums) ** 2
        return [*r, *g[free], *(wide(T) @ (wide(s) + ds) - scale * now_M * price_now)]

    size, h = len(free) + 2 * nv, mp.mpf("1e-12")
    offset = conditions(mp.mpf(0), [mp.mpf(0)] * size)  # rounding of the numbers above

    def solved(theta):
        return mp.findroot(
            lambda *x: [value - o for value, o in zip(conditions(theta, x), offset, strict=True)],
            [mp.mpf(0)] * size, tol=1e-60, verify=False,
        )  # fmt: skip

    up, down = solved(h), solved(-h)
    exact = np.array([float((up[k] - down[k]) / (2 * h)) for k in range(size)])
    assert np.abs(found.excitation[free, 0] - exact[: len(free)]).max() < 1e-9 * np.abs(exact).max()
    assert np.abs(found.reserve[:, 0] - exact[len(free) : len(free) + nv]).max() < 1e-7 * np.abs(found.reserve).max()
    assert not found.excitation[list(fixed)].any()

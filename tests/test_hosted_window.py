"""Hill muscles alone over a window, against the same steps written out with `mjhcmc.hill`."""

import numpy as np
import pytest
from test_hosted_muscles import ALL, DYNAMICS, draw

from mjhcmc import hill
from mjhcmc.hosted.muscle import RIGID, gain_and_bias
from mjhcmc.hosted.muscles import HostedMuscles
from mjhcmc.hosted.window import excite, reach


class Window:
    """Arguments of `reach` and `excite`, for one simulation of n muscles of which path and trial are given."""

    def __init__(self, curves, tendon, seed=0, n_step=10, moving=0.05, push=0.0):
        rng = np.random.default_rng(seed)
        # tendons of a fiber's length and more: shorter ones are stiff beyond what a step of 1 ms resolves
        self.model = draw(rng, curves, damping=0.0 if curves.tendon is None else 0.1, least_tendon=0.0)
        self.hosts = HostedMuscles(self.model, tendon)
        m = self.model.muscles
        n, self.h, self.n_step = len(m.names), 1e-3, n_step
        self.F0 = m.max_isometric_force
        self.a = rng.uniform(0.2, 0.6, n)
        normal = np.maximum(rng.uniform(0.9, 1.1, n), np.sin(m.pennation_at_optimal) + 0.1)
        along = hill.fiber_length_along(self.model, normal * m.optimal_fiber_length)
        L = along + m.tendon_slack_length * (1.01 if tendon == "compliant" else 1.0)
        fast = m.max_fiber_velocity * m.optimal_fiber_length
        V = moving * rng.uniform(-1, 1, n) * fast
        T = n_step * self.h
        self.fiber = self.hosts.equilibrium(self.a, L, V) if tendon == "compliant" else np.empty(0)
        self.start = np.stack([L, V], axis=1)
        self.end = np.stack([L + T * V * 1.05, V * 1.2], axis=1)
        self.limits = np.tile([0.01, 1.0], (n, 1))
        self.u = rng.uniform(0.2, 0.9, n)
        self.push = push * self.F0

    def run(self, tried=True):
        n = len(self.F0)
        self.low, self.high, self.shift, self.x = (np.empty((1, n)) for _ in range(4))
        self.forces, self.phi = np.empty((1, n, 4)), np.empty((1, self.n_step + 1, n))
        c, p = self.hosts.curves, self.hosts.parameters
        m = self.model.muscles
        fiber = np.hypot(self.end[:, 0] - m.tendon_slack_length, m.fiber_width)
        around = np.array([gain_and_bias(c, p[i], fiber[i], *self.end[i]) for i in range(n)])
        self.gain, self.bias = around[:, 0].copy(), around[:, 1].copy()
        self.trial = self.after(self.u)[-1] + self.push
        reach(
            **self.muscle(), u=self.u[None], gain=self.gain[None], bias=self.bias[None], force=self.trial[None],
            tried=tried, low=self.low, high=self.high, forces=self.forces, shift=self.shift, x=self.x, phi=self.phi,
        )  # fmt: skip
        return self

    def muscle(self):
        """What `reach` and `excite` are both told: one simulation."""
        n = len(self.F0)
        return {
            "first": 0, "last": 1, "kind": self.hosts.kind, "curves": self.hosts.curves,
            "p": self.hosts.parameters[None], "prm": np.tile(DYNAMICS, (1, n, 1)), "limits": self.limits[None],
            "activation": self.a[None], "fiber": self.fiber[None], "start": self.start[None], "end": self.end[None],
            "h": self.h, "n_step": self.n_step,
        }  # fmt: skip

    def excite(self, goal, close=1e-12):
        u = np.full((1, len(self.F0)), -1.0)
        excite(**self.muscle(), goal=goal[None], tried=self.u[None], forces=self.forces, close=close, u=u)
        return u[0]

    def path(self, t):
        """Length and velocity (n,) of the cubic through both ends, by the Hermite basis."""
        T = self.n_step * self.h
        s = t / T
        (L0, V0), (L1, V1) = self.start.T, self.end.T
        L = (2 * s**3 - 3 * s**2 + 1) * L0 + (s**3 - 2 * s**2 + s) * T * V0
        L = L + (3 * s**2 - 2 * s**3) * L1 + (s**3 - s**2) * T * V1
        V = (6 * s**2 - 6 * s) / T * (L0 - L1) + (3 * s**2 - 4 * s + 1) * V0 + (3 * s**2 - 2 * s) * V1
        return L, V

    def after(self, u):
        """(n_step + 1, n) N, forces of the muscles alone under an excitation, by the reference's equations."""
        h, model = self.h, self.model
        found, fiber = np.empty((self.n_step + 1, len(self.F0))), self.fiber
        a = self.a
        for k in range(self.n_step + 1):
            L, V = self.path(k * h)
            if self.hosts.kind == RIGID:
                found[k] = hill.rigid_tendon(model, a, L, V).tendon_force
                fiber = np.zeros_like(a)
            else:
                found[k] = hill.fiber_dynamics(model, a, fiber, L).tendon_force
            if k == self.n_step:
                break
            a1, l1 = self.rates(u, a, fiber, k * h)
            a2, l2 = self.rates(u, a + h / 2 * a1, fiber + h / 2 * l1, (k + 0.5) * h)
            a3, l3 = self.rates(u, a + h / 2 * a2, fiber + h / 2 * l2, (k + 0.5) * h)
            a4, l4 = self.rates(u, a + h * a3, fiber + h * l3, (k + 1) * h)
            a, fiber = a + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4), fiber + h / 6 * (l1 + 2 * l2 + 2 * l3 + l4)
        return found

    def rates(self, u, a, fiber, t):
        rate = hill.mujoco_activation_rate(u, a, DYNAMICS)
        if self.hosts.kind == RIGID:
            return rate, 0.0
        return rate, hill.fiber_velocity(self.model, a, fiber, self.path(t)[0])


KINDS = [("millard", "rigid"), ("millard", "compliant"), ("dgf", "compliant"), ("thelen", "compliant"),
         ("thelen", "rigid"), ("mujoco", "rigid"), ("all-families", "compliant")]  # fmt: skip
windows = pytest.mark.parametrize(("name", "tendon"), KINDS, ids=[f"{n}-{t}" for n, t in KINDS])


@windows
def test_reach_is_the_force_of_the_least_and_the_most_excitation(name, tendon):
    w = Window(ALL[name], tendon, push=0.03).run()
    for side, u in enumerate((0.01, 1.0)):
        wanted = w.after(np.full(len(w.F0), u))[-1]
        np.testing.assert_allclose(w.forces[0, :, side] / w.F0, wanted / w.F0, atol=1e-11)
    np.testing.assert_allclose(w.shift[0] / w.F0, 0.03, atol=1e-11)
    for found, side in ((w.low, 0), (w.high, 1)):
        reached = w.bias + w.gain * found[0]
        np.testing.assert_allclose(reached / w.F0, w.forces[0, :, side] / w.F0 + 0.03, atol=1e-11)
    np.testing.assert_allclose((w.bias + w.gain * w.x[0]) / w.F0, w.trial / w.F0, atol=1e-12)


@windows
def test_without_a_trial_there_is_nothing_beyond_the_muscle_alone(name, tendon):
    w = Window(ALL[name], tendon, push=0.03).run(tried=False)
    np.testing.assert_array_equal(w.shift, 0.0)
    for found, side in ((w.low, 0), (w.high, 1)):
        np.testing.assert_allclose((w.bias + w.gain * found[0]) / w.F0, w.forces[0, :, side] / w.F0, atol=1e-11)


@windows
def test_phi_is_how_a_small_change_of_excitation_builds_up(name, tendon):
    w = Window(ALL[name], tendon, seed=2).run()
    step = 1e-3 * np.where(w.u < 0.5, 1.0, -1.0)
    change = w.after(w.u + step) - w.after(w.u)
    np.testing.assert_allclose(w.phi[0], change / change[-1], atol=1e-8)
    np.testing.assert_array_equal(w.phi[0, -1], 1.0)
    np.testing.assert_array_equal(w.phi[0, 0], 0.0)


@windows
def test_excitation_reaches_the_force(name, tendon):
    w = Window(ALL[name], tendon, seed=4).run()
    for share in (0.05, 0.5, 0.95):
        goal = w.forces[0, :, 0] + share * (w.forces[0, :, 1] - w.forces[0, :, 0])
        u = w.excite(goal)
        assert ((u >= 0.01) & (u <= 1)).all()
        np.testing.assert_allclose(w.after(u)[-1] / w.F0, goal / w.F0, atol=1e-11)
    np.testing.assert_array_equal(w.excite(w.forces[0, :, 0] - w.F0), 0.01)
    np.testing.assert_array_equal(w.excite(w.forces[0, :, 1] + w.F0), 1.0)
    known = np.linspace(0.05, 0.95, len(w.F0))
    np.testing.assert_allclose(w.excite(w.after(known)[-1]), known, atol=1e-6)
    assert np.isnan(w.excite(np.full(len(w.F0), np.nan))).all()

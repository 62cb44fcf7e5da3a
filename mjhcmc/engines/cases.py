"""What engines are asked: random states of a leg, a torque-driven second, and the answers they should give."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mjhcmc.engines import mujoco as reference
from mjhcmc.engines.base import Array
from mjhcmc.engines.legs import leg
from mjhcmc.errors import SimulationError

QUANTITIES = ("mass_matrix", "bias", "inverse_dynamics")

WINDOW = 0.01
"""s, over which a torque is held."""

WINDOWS = 100

_SPEED, _CHANGE = 5.0, 50.0  # rad/s, rad/s^2: the largest of random states; walking's are about these
_SWING = (0.3, -0.5, 0.25)  # rad; the legs swing to twice that and back in a second, well within their ranges
_WILD = 1e-5  # deg, of MuJoCo's RK4; what is worse is no test of integrators
_OWN_SWING = 0.2  # rad, at most, of a user's leg, about the middle of a joint's range


@dataclass(frozen=True, eq=False)
class Case:
    """A leg, states of it, and what MuJoCo and the reference integrator say of them.

    Attributes:
        name: of the leg.
        model: MjModel of bodies and hinges.
        q: (n, nv) rad, within the joints' ranges.
        v: (n, nv) rad/s.
        a: (n, nv) rad/s^2.
        expected: by quantity, MuJoCo's values at the states, the states first.
        start: (nv,) rad, where the motion starts, at rest.
        torques: (WINDOWS, nv) N m, each held over a window.
        nodes: (WINDOWS + 1, nv) rad, where they take the leg.
        slack: factor on the limits of the motion's error: 1 on `LEGS`; a user's leg may be harder to move than they.
    """

    name: str
    model: Any
    q: Array
    v: Array
    a: Array
    expected: dict[str, Array]
    start: Array
    torques: Array
    nodes: Array
    slack: float = 1.0

    def arguments(self, quantity: str, i: int) -> tuple[Array, ...]:
        """What a quantity is a function of, at state i."""
        return (self.q[i], self.v[i], self.a[i])[: QUANTITIES.index(quantity) + 1]


def case_of(name: str, states: int, seed: int, model: Any = None) -> Case:
    """The questions about one leg.

    Args:
        name: one of `mjhcmc.engines.legs.LEGS`, or what another is called.
        states: how many random ones.
        seed: of the random numbers.
        model: MjModel of another leg's bodies and hinges, without limits (`mjhcmc.engines.legs.bodies_of`); where
            joints have a range, states and motion are in it.

    Raises:
        SimulationError: the model's motion cannot be integrated.
    """
    known, model = model is None, leg(name) if model is None else model
    rng = np.random.default_rng(seed)
    low, high = np.where(np.ptp(model.jnt_range, axis=1)[:, None] > 0, model.jnt_range, [[-np.pi, np.pi]]).T
    shape = (states, model.nv)
    q, v, a = rng.uniform(low, high, shape), rng.uniform(-_SPEED, _SPEED, shape), rng.uniform(-_CHANGE, _CHANGE, shape)
    own = reference.load(model)
    expected = {
        "mass_matrix": np.array([own.mass_matrix(at) for at in q]),
        "bias": np.array([own.bias(*state) for state in zip(q, v, strict=True)]),
        "inverse_dynamics": np.array([own.inverse_dynamics(*state) for state in zip(q, v, a, strict=True)]),
    }
    if known:
        start, swing = np.zeros(model.nv), np.array(_SWING)
    else:
        swing = np.minimum(_OWN_SWING, (high - low) / 8) * (-1.0) ** np.arange(model.nv)
        start = (low + high) / 2 - swing
    torques = _torques(model, start, swing)
    slack = 1.0 if known else _slack(name, model, start, torques)
    return Case(name, model, q, v, a, expected, start, torques, _nodes(model, start, torques), slack)


def _slack(name: str, model: Any, start: Array, torques: Array) -> float:
    """How many times more than 1e-8 deg, as on `LEGS`, MuJoCo's own RK4 is off in steps of 1 ms; 1 at least.

    Half the step shows it, before the reference, which takes minutes on what is wild.
    """
    own, still = reference.load(model), np.zeros_like(start)
    coarse, fine = (own.simulate(start, still, torques, WINDOW, step) for step in (1e-3, 5e-4))
    error = float(np.rad2deg(np.abs(coarse - fine).max()))
    if not error < _WILD:
        raise SimulationError(
            f"model '{name}': its second of motion cannot be compared, steps of 1 ms and .5 ms of MuJoCo's RK4 differ "
            f"by {error:.2g} deg: give its bodies more inertia, or compare a part of it"
        )
    return max(1.0, error / 1e-8)


def _torques(model: Any, start: Array, swing: Array) -> Array:
    """(WINDOWS, nv) N m: what a cosine swing of a second asks for in the middle of each window."""
    own = reference.load(model)
    rate = 2 * np.pi / (WINDOWS * WINDOW)
    time = (np.arange(WINDOWS) + 0.5)[:, None] * WINDOW
    q, v, a = (
        start + swing * (1 - np.cos(rate * time)),
        swing * rate * np.sin(rate * time),
        swing * rate**2 * np.cos(rate * time),
    )
    return np.array([own.inverse_dynamics(*state) for state in zip(q, v, a, strict=True)])


def _nodes(model: Any, start: Array, torques: Array) -> Array:
    """The reference motion, by `mjhcmc.exact` in float64; its error is about 1e-12 deg."""
    from mjhcmc.exact.chain import chain_of
    from mjhcmc.exact.reference import floats, torque_driven
    from mjhcmc.exact.scalars import FLOAT

    rest = [0.0] * int(model.nv)
    q, _ = torque_driven(chain_of(model), start.tolist(), rest, torques.tolist(), WINDOW, FLOAT)
    return floats(q, FLOAT)

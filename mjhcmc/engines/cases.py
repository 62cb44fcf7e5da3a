"""What engines are asked: random states of a leg, a torque-driven second, and the answers they should give."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mjhcmc.engines import mujoco as reference
from mjhcmc.engines.base import Array
from mjhcmc.engines.legs import leg

QUANTITIES = ("mass_matrix", "bias", "inverse_dynamics")

WINDOW = 0.01
"""s, over which a torque is held."""

WINDOWS = 100

_SPEED, _CHANGE = 5.0, 50.0  # rad/s, rad/s^2: the largest of random states; walking's are about these
_SWING = (0.3, -0.5, 0.25)  # rad; the legs swing to twice that and back in a second, well within their ranges


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
        torques: (WINDOWS, nv) N m, each held over a window; the motion starts at rest at zero angles.
        nodes: (WINDOWS + 1, nv) rad, where they take the leg.
    """

    name: str
    model: Any
    q: Array
    v: Array
    a: Array
    expected: dict[str, Array]
    torques: Array
    nodes: Array

    def arguments(self, quantity: str, i: int) -> tuple[Array, ...]:
        """What a quantity is a function of, at state i."""
        return (self.q[i], self.v[i], self.a[i])[: QUANTITIES.index(quantity) + 1]


def case_of(name: str, states: int, seed: int) -> Case:
    """The questions about one leg.

    Args:
        name: one of `mjhcmc.engines.legs.LEGS`.
        states: how many random ones.
        seed: of the random numbers.
    """
    model = leg(name)
    rng = np.random.default_rng(seed)
    low, high = np.where(model.jnt_limited.astype(bool)[:, None], model.jnt_range, [[-np.pi, np.pi]]).T
    shape = (states, model.nv)
    q, v, a = rng.uniform(low, high, shape), rng.uniform(-_SPEED, _SPEED, shape), rng.uniform(-_CHANGE, _CHANGE, shape)
    own = reference.load(model)
    expected = {
        "mass_matrix": np.array([own.mass_matrix(at) for at in q]),
        "bias": np.array([own.bias(*state) for state in zip(q, v, strict=True)]),
        "inverse_dynamics": np.array([own.inverse_dynamics(*state) for state in zip(q, v, a, strict=True)]),
    }
    torques = _torques(model)
    return Case(name, model, q, v, a, expected, torques, _nodes(model, torques))


def _torques(model: Any) -> Array:
    """(WINDOWS, nv) N m: what a cosine swing of a second asks for in the middle of each window."""
    own = reference.load(model)
    rate = 2 * np.pi / (WINDOWS * WINDOW)
    time = (np.arange(WINDOWS) + 0.5)[:, None] * WINDOW
    swing = np.array(_SWING)
    q, v, a = (
        swing * (1 - np.cos(rate * time)),
        swing * rate * np.sin(rate * time),
        swing * rate**2 * np.cos(rate * time),
    )
    return np.array([own.inverse_dynamics(*state) for state in zip(q, v, a, strict=True)])


def _nodes(model: Any, torques: Array) -> Array:
    """The reference motion, by `mjhcmc.exact` in float64; its error is about 1e-12 deg."""
    from mjhcmc.exact.chain import chain_of
    from mjhcmc.exact.reference import floats, torque_driven
    from mjhcmc.exact.scalars import FLOAT

    rest = [0.0] * int(model.nv)
    q, _ = torque_driven(chain_of(model), rest, rest, torques.tolist(), WINDOW, FLOAT)
    return floats(q, FLOAT)

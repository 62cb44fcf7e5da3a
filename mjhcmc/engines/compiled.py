"""What engines in JAX share: their functions are compiled once, and run in double precision, for their calls only."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mjhcmc.engines.base import Array, windows_and_steps


class JaxDynamics:
    """See `base.Dynamics`; each engine fills in what is compiled.

    Attributes:
        jax: the module.
        model: the engine's own, with ``tree_replace``.
        everything: of model, q, v, a: mass matrix, bias, inverse dynamics; one function, since each takes seconds to
            compile.
        run: of model, q, v, torques and steps a window: positions at the ends of the windows.
    """

    jax: Any
    model: Any
    everything: Callable[..., Any]
    run: Callable[..., Any]

    def mass_matrix(self, q: Array) -> Array:
        """See `base.Dynamics`, as the rest."""
        return self._at(q, 0 * q, 0 * q)[0]

    def bias(self, q: Array, v: Array) -> Array:
        """See there."""
        return self._at(q, v, 0 * q)[1]

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """See there."""
        return self._at(q, v, a)[2]

    def simulate(self, q: Array, v: Array, torques: Array, dt: float, step: float) -> Array:
        """See there."""
        with self.jax.enable_x64(True):
            model = self.model.tree_replace({"opt.timestep": np.float64(step)})
            nodes = self.run(model, q, v, torques, windows_and_steps(dt, step))
            return np.vstack([q, np.array(nodes)])

    def _at(self, q: Array, v: Array, a: Array) -> tuple[Array, ...]:
        with self.jax.enable_x64(True):
            return tuple(np.array(value) for value in self.everything(self.model, q, v, a))

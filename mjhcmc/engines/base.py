"""What an engine is here: a name, how it is installed, and five things that it computes of a tree of hinges."""

from __future__ import annotations

import importlib.metadata
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError

Array = NDArray[np.float64]

TOLERANCE = {"float64": 1e-9, "float32": 1e-4}
"""Largest difference from MuJoCo, relative to the largest value, by an engine's precision."""

FORWARD_LIMIT = {1: 0.5, 2: 1e-2, 3: 1e-4, 4: 1e-4}
"""deg, of the angles over a second in steps of 1 ms, by the order of the method.

First-order methods err by .1 on the legs here, RK3 by 3e-6, fourth-order ones by 1e-8: each limit is well above its own
and far below that of the order before, so that no method passes for a better one.
"""

SINGLE_LIMIT = 1e-3
"""deg, likewise in single precision, where no order can be measured: rounding makes 1e-4, a first-order method .1."""

ORDER_TOLERANCE = 0.2
"""How far the order found by halving the step may be off."""


class Dynamics(Protocol):
    """A model inside an engine. Coordinates are in the order of MuJoCo's qpos; SI units, rad."""

    def mass_matrix(self, q: Array) -> Array:
        """M(q), (nv, nv), kg m^2."""

    def bias(self, q: Array, v: Array) -> Array:
        """What is left of the inverse dynamics at zero acceleration, (nv,), N m: MuJoCo's qfrc_bias."""

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """M(q) a + bias(q, v), (nv,), N m, by the engine's own recursion where it has one."""

    def simulate(self, q: Array, v: Array, torques: Array, dt: float, step: float) -> Array:
        """Move under joint torques, each held over one window, by the engine's own integrator.

        Args:
            q: (nv,) rad, at the start.
            v: (nv,) rad/s, at the start.
            torques: (N, nv) N m.
            dt: s, a window.
            step: s, the integrator's; divides dt.

        Returns:
            Angles at the ends of the windows and at the start, (N + 1, nv), rad.
        """


@dataclass(frozen=True)
class Engine:
    """An engine of rigid-body dynamics.

    Attributes:
        title: what it is called.
        key: what it is called on the command line.
        module: what Python imports; empty where there is none.
        requirement: what pip installs; empty where pip cannot.
        precision: "float64" or "float32", of what it computes here.
        integrator: what `Dynamics.simulate` steps with.
        order: of that; 0 where this project has no adapter.
        reads: how the model gets there.
        load: a model with hinges only inside the engine; None where this project has no adapter.
        missing: why there is no adapter, and what it would take; empty where there is one.
        distribution: what carries the version, where pip's requirement names something else.
    """

    title: str
    key: str
    module: str = ""
    requirement: str = ""
    precision: str = "float64"
    integrator: str = ""
    order: int = 0
    reads: str = ""
    load: Callable[[Any], Dynamics] | None = None
    missing: str = ""
    distribution: str = ""

    def why_not(self) -> str:
        """Why it cannot run here, in a line; empty where it can."""
        if self.load is None:
            return self.missing
        try:
            found = importlib.util.find_spec(self.module)
        except ModuleNotFoundError:  # what it is a part of is not there
            found = None
        if found is None:
            return f"the package '{self.module}' is not installed"
        return ""

    @property
    def forward_limit(self) -> float:
        """deg, what `FORWARD_LIMIT` or `SINGLE_LIMIT` allows it."""
        limit = FORWARD_LIMIT[self.order]
        return max(limit, SINGLE_LIMIT) if self.precision == "float32" else limit

    @property
    def install(self) -> str:
        """The command that installs it; empty where there is none."""
        return f'pip install "{self.requirement}"' if self.requirement else ""

    def version(self) -> str:
        """The installed version, "unknown" where nothing tells it."""
        try:
            return importlib.metadata.version(self.distribution or self.module)
        except importlib.metadata.PackageNotFoundError:  # not installed by pip
            return str(getattr(importlib.import_module(self.module), "__version__", "unknown"))


def windows_and_steps(dt: float, step: float) -> int:
    """How many steps a window has.

    Raises:
        SettingsError: step does not divide dt.
    """
    count = round(dt / step)
    if count < 1 or abs(count * step - dt) > 1e-9 * dt:
        raise SettingsError(f"a step of {step:g} s does not divide a window of {dt:g} s: choose one that does")
    return count

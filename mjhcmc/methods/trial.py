"""What a correction starts from and what it finds: records of several simulations at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SimulationError

Array = NDArray[np.float64]


class Trial(NamedTuple):
    """What the trial windows of b simulations found at their ends, and what they began with.

    Attributes:
        start_activation: (b, n_muscle) at the window's start.
        excitation: (b, n_muscle) of the trial.
        reserve: (b, nv) N m, of the trial.
        activation: (b, n_muscle) at the end.
        missing: (b, nv) rad/s^2, r of `hcmc`.
        M: (b, nv, nv) kg m^2.
        B: (b, nv, n_muscle) N m, joint moments at full activation.
        gain: (b, n_muscle) N, see `dynamics.MuscleMoments`.
        bias: (b, n_muscle) N.
        D: (b, nv, nv) N m s.
        K: (b, nv, nv) N m.
        kp: (b, nv) 1/s^2.
        kv: (b, nv) 1/s.
        step: s, physics step of the trial.
        n_step: its physics steps; 0: no trial, the end is where the window should end but for the activation.
        cap: (b, n_muscle) activation beyond which muscles pull no more.
        time: (b,) s, at the end.
        inertia: (b, nv, nv) kg m^2, M + s D_s of `integrators`, of the trial's steps; None: M, under RK4.
        explicit: (b, nv, nv) N m s, what of D bounds the physics step; None: D.
        euler: whether the trial was stepped by an integrator of first order.
    """

    start_activation: Array
    excitation: Array
    reserve: Array
    activation: Array
    missing: Array
    M: Array
    B: Array
    gain: Array
    bias: Array
    D: Array
    K: Array
    kp: Array
    kv: Array
    step: float
    n_step: int
    cap: Array
    time: Array
    inertia: Array | None = None
    explicit: Array | None = None
    euler: bool = False

    def of(self, which: NDArray[np.intp]) -> Trial:
        """That of some of the simulations."""
        return Trial(*(part[which] if isinstance(part, np.ndarray) else part for part in self))  # type: ignore[arg-type]


class Reach(NamedTuple):
    """How excitations become activations, in b simulations.

    Attributes:
        parameters: (b, n_muscle, 3) of activation dynamics.
        excitation_range: (b, n_muscle, 2).
        step: s, physics step.
        n_step: physics steps in a window.
        integrator: of the plant.
    """

    parameters: Array
    excitation_range: Array
    step: float
    n_step: int
    integrator: str = "rk4"

    def of(self, which: NDArray[np.intp]) -> Reach:
        """That of some of the simulations."""
        return self._replace(parameters=self.parameters[which], excitation_range=self.excitation_range[which])


class Correction(NamedTuple):
    """What to drive the window with.

    Attributes:
        excitation: (b, n_muscle).
        shortfall: (b, nv) N m, the moment that the muscles leave to reserves.
        errors: by simulation of the call, those whose allocation holds a value that is not finite, or has no optimum.
        fastest_rate: (b,) 1/s, a bound on the decay rate of the velocities at the trial's end.
    """

    excitation: Array
    shortfall: Array
    errors: dict[int, SimulationError]
    fastest_rate: Array


class Program(NamedTuple):
    """What `_linearize` found, with the bounds: answers (b, nv, n + nv), wanted, Q (b, nv), low, high (b, n)."""

    answers: Array
    wanted: Array
    Q: Array
    low: Array
    high: Array

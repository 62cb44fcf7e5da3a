"""Engines against MuJoCo: mass matrix, bias and inverse dynamics at random states, and a second of motion."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from mjhcmc.engines.base import FORWARD_LIMIT, ORDER_TOLERANCE, TOLERANCE, Array, Dynamics, Engine
from mjhcmc.engines.cases import QUANTITIES, WINDOW, WINDOWS, Case, case_of
from mjhcmc.engines.legs import LEGS, bodies_of
from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.log import get_logger

_log = get_logger(__name__)

STEP = 0.001
"""s, of every integrator."""

_FLOOR = 1e-11  # deg: below it rounding, and the reference's own error
_COARSE = 1.0  # deg: above it an error is more than its first power of the step
_SMALL = 1e-2  # of the inverse dynamics: a smaller bias is what is left of larger terms, and rounded as they are


@dataclass(frozen=True)
class LegResult:
    """What one engine made of one leg.

    Attributes:
        difference: by quantity, max |theirs - MuJoCo's| / max |MuJoCo's| over all states.
        call_us: median time of one inverse dynamics, us: a state in, torques out, through Python.
        forward_error_deg: largest difference of an angle from the reference at a node, deg.
        forward_order: log2 of that over the same at half the step; None where rounding decides, in single precision,
            and where the error is more than a degree.
        step_us: time of an integration step, us: of the second in all, over its steps.
    """

    difference: dict[str, float]
    call_us: float
    forward_error_deg: float
    forward_order: float | None
    step_us: float

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, which knows no infinity: None there."""
        values = asdict(self) | {"forward_error_deg": _or_none(self.forward_error_deg)}
        return values | {"difference": {key: _or_none(value) for key, value in self.difference.items()}}


@dataclass(frozen=True)
class EngineResult:
    """One row.

    Attributes:
        engine: which.
        status: "agrees", "disagrees", "failed" or "not installed".
        reason: why it is not installed, failed or disagrees, in a line; empty where it agrees.
        version: of the engine; empty where it is not installed.
        legs: by name; empty where it did not run.
    """

    engine: Engine
    status: str
    reason: str = ""
    version: str = ""
    legs: dict[str, LegResult] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        keys = ("key", "title", "precision", "integrator", "order", "reads", "install")
        about = {key: getattr(self.engine, key) for key in keys}
        found = {"status": self.status, "reason": self.reason, "version": self.version}
        return about | found | {"legs": {name: result.to_dict() for name, result in self.legs.items()}}


@dataclass(frozen=True)
class Comparison:
    """All rows, in the registry's order.

    Attributes:
        rows: one an engine.
        states: how many random ones each leg had.
        seed: of the random numbers.
    """

    rows: tuple[EngineResult, ...]
    states: int
    seed: int

    @property
    def compared(self) -> int:
        """How many engines ran, or tried to, beside MuJoCo."""
        return sum(row.engine.key != "mujoco" and row.status != "not installed" for row in self.rows)

    @property
    def passed(self) -> bool:
        """Whether every installed engine agrees; so where nothing was compared."""
        return all(row.status in ("agrees", "not installed") for row in self.rows)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        how = {"states": self.states, "seed": self.seed, "step_s": STEP, "seconds": WINDOWS * WINDOW}
        limits = {"tolerance": TOLERANCE, "forward_limit_deg": FORWARD_LIMIT, "order_tolerance": ORDER_TOLERANCE}
        verdict = {"compared": self.compared, "passed": self.passed}
        return how | limits | {"engines": [row.to_dict() for row in self.rows]} | verdict


def compare(
    engines: Sequence[Engine],
    states: int = 100,
    seed: int = 0,
    legs: Sequence[str] = LEGS,
    models: Mapping[str, Any] | None = None,
    progress: Callable[[Engine], None] | None = None,
) -> Comparison:
    """Ask engines about legs.

    Args:
        engines: which; those that cannot run here keep their row.
        states: how many random states a leg.
        seed: of the random numbers.
        legs: names of `mjhcmc.engines.legs.LEGS`.
        models: further legs by name, MjModels; their bodies and hinges are taken (`mjhcmc.engines.legs.bodies_of`).
        progress: told of each engine that runs, before it does.

    Raises:
        SettingsError: states or seed out of range, no such leg, no leg at all, or two of one name.
        ModelError: one of the models is no tree of hinges.
        SimulationError: the motion of one of the models cannot be integrated.
    """
    further = dict(models or {})
    if states < 1:
        raise SettingsError(f"states must be 1 or more; got {states}")
    if seed < 0:
        raise SettingsError(f"seed must be 0 or more; got {seed}")
    for name in legs:
        if name not in LEGS:
            raise SettingsError(f"no leg {name!r}: the legs are {', '.join(LEGS)}; give others as models")
        if name in further:
            raise SettingsError(f"two legs are called {name!r}: call the model something else")
    if not legs and not further:
        raise SettingsError(f"no leg to compare: give {' or '.join(LEGS)}, or a model")
    bodies = {name: bodies_of(model, limits=False) for name, model in further.items()}
    runnable = [engine for engine in engines if not engine.why_not()]
    cases = [case_of(name, states, seed) for name in legs] if runnable else []
    cases += [case_of(name, states, seed, model) for name, model in bodies.items()] if runnable else []
    rows = []
    for engine in engines:
        if progress is not None and engine in runnable:
            progress(engine)
        row = run(engine, cases) if engine in runnable else EngineResult(engine, "not installed", engine.why_not())
        _log.info("%s: %s %s", engine.title, row.status, row.reason)
        rows.append(row)
    return Comparison(tuple(rows), states, seed)


def run(engine: Engine, cases: Sequence[Case]) -> EngineResult:
    """One engine's row; what it raises becomes its reason."""
    version = ""
    try:
        version = engine.version()
        found = {case.name: _measure(engine, case) for case in cases}
    except Exception as error:  # any engine may raise anything: the others are to run all the same
        _log.debug("%s", engine.title, exc_info=True)
        return EngineResult(engine, "failed", f"{type(error).__name__}: {' '.join(str(error).split())}"[:200], version)
    wrong = [text for case in cases for text in _complaints(engine, case, found[case.name])]
    return EngineResult(engine, "disagrees" if wrong else "agrees", "; ".join(wrong), version, found)


def forward_error(dynamics: Dynamics, case: Case, step: float) -> float:
    """Largest difference of an angle from the reference at a node, deg."""
    found = dynamics.simulate(case.start, np.zeros_like(case.start), case.torques, WINDOW, step)
    return math.degrees(largest(found - case.nodes))


def largest(values: Array) -> float:
    """Max |value|; infinite where one is not finite, so that no comparison with NaN passes."""
    return float(np.max(np.abs(values))) if np.all(np.isfinite(values)) else math.inf


def differences(dynamics: Dynamics, case: Case) -> dict[str, float]:
    """By quantity, max |theirs - MuJoCo's| / max |MuJoCo's| over all states.

    A bias below a hundredth of the inverse dynamics, as of a balanced hinge, is measured by that.

    Raises:
        SimulationError: an answer of another shape.
    """
    out = {}
    least = {"bias": _SMALL * largest(case.expected["inverse_dynamics"])}
    for quantity in QUANTITIES:
        of, expected = getattr(dynamics, quantity), case.expected[quantity]
        found = np.array([of(*case.arguments(quantity, i)) for i in range(len(case.q))])
        if found.shape != expected.shape:
            raise SimulationError(f"{quantity} has shape {found.shape[1:]}, not {expected.shape[1:]}")
        out[quantity] = largest(found - expected) / max(largest(expected), least.get(quantity, 0.0))
    return out


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _measure(engine: Engine, case: Case) -> LegResult:
    assert engine.load is not None
    dynamics = engine.load(case.model)
    difference = differences(dynamics, case)
    times = []
    for i in range(len(case.q)):
        state = case.arguments("inverse_dynamics", i)
        began = time.perf_counter_ns()
        dynamics.inverse_dynamics(*state)
        times.append(time.perf_counter_ns() - began)
    single = engine.precision == "float32"
    half = None if single else forward_error(dynamics, case, STEP / 2)  # first: what compiles does so now
    began = time.perf_counter_ns()
    error = forward_error(dynamics, case, STEP)
    spent = (time.perf_counter_ns() - began) / 1e3
    known = half is not None and _FLOOR < half < math.inf and 0 < error < _COARSE
    order = math.log2(error / half) if known and half else None
    return LegResult(difference, float(np.median(times)) / 1e3, error, order, spent / round(WINDOWS * WINDOW / STEP))


def _complaints(engine: Engine, case: Case, result: LegResult) -> list[str]:
    limit, leg = TOLERANCE[engine.precision], case.name
    out = [
        f"{leg}: {quantity.replace('_', ' ')} differs by {value:.2g}, {limit:g} allowed"
        for quantity, value in result.difference.items()
        if not value <= limit
    ]
    allowed, order = engine.forward_limit * case.slack, result.forward_order
    if not result.forward_error_deg <= allowed:
        out.append(f"{leg}: {result.forward_error_deg:.2g} deg off over a second, {allowed:.2g} allowed")
    if order is not None and abs(order - engine.order) > ORDER_TOLERANCE:
        out.append(f"{leg}: of order {order:.2f}, {engine.integrator} is of order {engine.order}")
    return out

"""Reference solutions of x' = f(t, x) on any scalar type: extrapolation to any order, and classical Runge-Kutta.

The reference is Gragg's modified midpoint rule extrapolated to step 0 (Gragg 1965, doi 10.1137/0702030; Bulirsch &
Stoer 1966, doi 10.1007/BF02165234): 2, 4, .., 2k substeps give order 2k. Columns are added until two orders agree;
where they do not, the step is halved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.exact import dynamics, leg
from mjhcmc.exact.chain import Chain
from mjhcmc.exact.dynamics import Numbers, to_numbers
from mjhcmc.exact.leg import PlanarLeg
from mjhcmc.exact.scalars import Number, Scalars
from mjhcmc.exact.vectors import Vec

__all__ = ["default_tolerance", "floats", "integrate", "rk4", "torque_driven", "torque_driven_rk4"]

Rate = Callable[[Number, Vec], Vec]
"""f(t, x) -> x', lists of scalars."""

_SMALLEST = 2.0**-30  # of an interval: below it no step is tried
_GUARD = 2.0**12  # of the scalar type's rounding error, that extrapolation amplifies


def default_tolerance(scalars: Scalars) -> float:
    """Of the state over one step: what the type's rounding allows."""
    return _GUARD * scalars.epsilon


def integrate(
    f: Rate,
    x0: Numbers,
    times: Sequence[float | Number],
    scalars: Scalars,
    *,
    tolerance: float | None = None,
) -> list[Vec]:
    """The solution of x' = f(t, x), x(times[0]) = x0, at the given times.

    Args:
        f: smooth between two times; x has the scalar type.
        x0: (n,) floats or scalars.
        times: (m,) increasing; steps end on each of them, so f may jump there.
        scalars: a numeric type.
        tolerance: largest |error| of a step relative to 1 + |x|, as two orders' difference estimates it;
            by default what the type's rounding allows (`default_tolerance`).

    Returns:
        m states (n,), the first of them x0.

    Raises:
        SettingsError: times that do not increase, or a tolerance below the type's rounding error.
        SimulationError: no step, however small, meets the tolerance.
    """
    goal = default_tolerance(scalars) if tolerance is None else tolerance
    if not (math.isfinite(goal) and goal >= 2 * scalars.epsilon):
        raise SettingsError(
            f"tolerance {goal:g} is below what {scalars.name} rounds ({scalars.epsilon:.2g}): use more digits"
        )
    with scalars.working():
        at = to_numbers(times, scalars)
        if any(not scalars.real(b - a) > 0 for a, b in pairwise(at)):
            raise SettingsError("times must increase: steps go from each to the next")
        states = [to_numbers(x0, scalars)]
        share = 1.0
        for begin, end in pairwise(at):
            x, share = _over(f, begin, end, states[-1], scalars, goal, share)
            states.append(x)
        return states


def rk4(f: Rate, x0: Numbers, start: float | Number, step: float | Number, n: int, scalars: Scalars) -> Vec:
    """The state after n steps of the classical Runge-Kutta method, as MuJoCo's RK4 takes them.

    Args:
        f: x has the scalar type.
        x0: (m,) floats or scalars.
        start: time of x0.
        step: length of a step.
        n: steps.
        scalars: any type, symbolic too.
    """
    with scalars.working():
        x = to_numbers(x0, scalars)
        t, h = to_numbers([start, step], scalars)
        half, sixth = h / 2, h / 6
        for i in range(n):
            now = t + i * h
            k1 = f(now, x)
            k2 = f(now + half, [a + half * b for a, b in zip(x, k1, strict=True)])
            k3 = f(now + half, [a + half * b for a, b in zip(x, k2, strict=True)])
            k4 = f(now + h, [a + h * b for a, b in zip(x, k3, strict=True)])
            x = [
                scalars.trim(a + sixth * (b + 2 * (c + d) + e)) for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)
            ]
        return x


def torque_driven(
    system: Chain | PlanarLeg,
    q0: Numbers,
    v0: Numbers,
    torques: Sequence[Numbers],
    dt: float | Number,
    scalars: Scalars,
    *,
    tolerance: float | None = None,
) -> tuple[list[Vec], list[Vec]]:
    """The motion under torques that are held constant over windows: the reference.

    Args:
        system: a chain, or a leg in closed form (faster).
        q0: (nv,) rad or m.
        v0: (nv,) rad/s or m/s.
        torques: (N, nv) N m or N.
        dt: s, length of a window, exactly.
        scalars: a numeric type; arb of 35 digits is a good reference.
        tolerance: see `integrate`.

    Returns:
        q and v, N + 1 rows (nv,) each; `floats` makes arrays of them.

    Raises:
        SettingsError: shapes that do not fit, or as `integrate`.
        SimulationError: as `integrate`.
    """
    return _driven(
        system, q0, v0, torques, scalars, lambda f, x, h: integrate(f, x, [0.0, h], scalars, tolerance=tolerance)[1], dt
    )


def torque_driven_rk4(
    system: Chain | PlanarLeg,
    q0: Numbers,
    v0: Numbers,
    torques: Sequence[Numbers],
    dt: float | Number,
    n_step: int,
    scalars: Scalars,
) -> tuple[list[Vec], list[Vec]]:
    """The same motion by n_step steps of classical Runge-Kutta a window: what MuJoCo's RK4 does, on any scalar type.

    Args:
        system: see `torque_driven`; likewise q0, v0, torques, dt, scalars.
        q0: see `torque_driven`.
        v0: see `torque_driven`.
        torques: see `torque_driven`.
        dt: see `torque_driven`.
        n_step: steps a window.
        scalars: see `torque_driven`.

    Returns:
        As `torque_driven`.

    Raises:
        SettingsError: shapes that do not fit, or no step.
    """
    if n_step < 1:
        raise SettingsError(f"a window needs at least one step; got {n_step}")
    return _driven(system, q0, v0, torques, scalars, lambda f, x, h: rk4(f, x, 0.0, h / n_step, n_step, scalars), dt)


def floats(rows: Sequence[Numbers], scalars: Scalars) -> NDArray[np.float64]:
    """Rows of scalars as an array of the nearest floats."""
    return np.array([[scalars.real(x) for x in row] for row in rows], dtype=np.float64)


def _driven(
    system: Chain | PlanarLeg,
    q0: Numbers,
    v0: Numbers,
    torques: Sequence[Numbers],
    scalars: Scalars,
    advance: Callable[[Rate, Vec, Number], Vec],
    dt: float | Number,
) -> tuple[list[Vec], list[Vec]]:
    n = system.n
    if len(q0) != n or len(v0) != n or any(len(row) != n for row in torques):
        raise SettingsError(f"q0, v0 and every row of torques must have {n} values, one a joint")
    with scalars.working():
        if isinstance(system, PlanarLeg):
            act = leg.acceleration(system, scalars)
        else:
            act = dynamics.acceleration(system, scalars)
        (h,) = to_numbers([dt], scalars)
        if not scalars.real(h) > 0:
            raise SettingsError(f"a window must have a positive length; got {scalars.real(h):g} s")
        x = [*to_numbers(q0, scalars), *to_numbers(v0, scalars)]
        q, v = [x[:n]], [x[n:]]
        for row in torques:
            torque = to_numbers(row, scalars)

            def rate(t: Number, x: Vec, torque: Vec = torque) -> Vec:
                return [*x[n:], *act(x[:n], x[n:], torque)]

            x = advance(rate, x, h)
            q.append(x[:n])
            v.append(x[n:])
        return q, v


def _over(
    f: Rate, begin: Number, end: Number, x: Vec, scalars: Scalars, goal: float, share: float
) -> tuple[Vec, float]:
    """From begin to end in steps of about ``share`` of the interval; returns the share that went well."""
    columns = _columns(goal)
    span, done = end - begin, 0.0
    while done < 1.0:
        share = min(share, 1.0 - done)
        h = span * scalars.number(share)  # shares are powers of two: exact
        found, used = _extrapolated(f, begin + span * scalars.number(done), x, h, columns, scalars, goal)
        if found is None:
            share /= 2
            if share < _SMALLEST:
                raise SimulationError(
                    f"at time {scalars.real(begin):g}: no step down to {share * scalars.real(span):.2g} meets the "
                    f"tolerance {goal:.2g} on {scalars.name}: use a larger tolerance or more digits"
                )
            continue
        x = found
        done += share
        if 2 * used <= columns and (done / share) % 2 == 0:
            share *= 2
    return x, share


def _columns(goal: float) -> int:
    """Columns of the table before a step is halved: about what makes the work least.

    k columns multiply the rounding of the first by some 600 (k = 10), 1e4 (14), 3e6 (22): no more than 14.
    """
    return max(6, min(14, round(-math.log10(goal) / 2.2)))


def _extrapolated(
    f: Rate, t: Number, x: Vec, h: Number, columns: int, scalars: Scalars, goal: float
) -> tuple[Vec | None, int]:
    """The state after a step h, None where ``columns`` columns do not meet the goal; and the columns used."""
    slope = f(t, x)
    table: list[Vec] = []
    last = math.inf
    for k in range(1, columns + 1):
        row = [_midpoint(f, t, x, slope, h, 2 * k)]
        for j in range(1, k):
            # (n_k/n_{k-j})^2 - 1 = (k^2 - (k-j)^2)/(k-j)^2, in integers
            above, below = (k - j) ** 2, k * k - (k - j) ** 2
            row.append([a + (a - b) * above / below for a, b in zip(row[j - 1], table[j - 1], strict=True)])
        if k > 1:
            error = max(scalars.size(a - b) / (1.0 + scalars.size(a)) for a, b in zip(row[-1], row[-2], strict=True))
            if error <= goal:
                return [scalars.trim(a) for a in row[-1]], k
            if not math.isfinite(error) or (k > 4 and error > 4 * last):
                return None, k
            last = error
        table = row
    return None, columns


def _midpoint(f: Rate, t: Number, x: Vec, slope: Vec, h: Number, n: int) -> Vec:
    """Gragg's rule: n (even) substeps of the midpoint rule; the error has even powers of h/n only."""
    step = h / n
    double = step * 2
    old, new = x, [a + step * b for a, b in zip(x, slope, strict=True)]
    for i in range(1, n):
        rate = f(t + step * i, new)
        old, new = new, [a + double * b for a, b in zip(old, rate, strict=True)]
    return new

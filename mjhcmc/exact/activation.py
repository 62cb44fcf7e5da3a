"""Thelen's activation dynamics on any scalar type: the rate, its closed-form solution, and what RK4 makes of it.

    a' = (u - a)/tau,  tau = tau_act (.5 + 1.5 a) where u > a, else tau_deact/(.5 + 1.5 a)

(Thelen 2003, doi 10.1115/1.1531112). Under a constant excitation u it separates. With c = .5 + 1.5 u and y0 = a0 - u:

    falling   a = u + c y0 e/(c + 1.5 y0 (1 - e)),  e = exp(-c t/tau_deact)
    rising    t/tau_act = -1.5 (a - a0) - c ln((u - a)/(u - a0)),  solved for a by Newton's method

a never crosses u.
"""

from __future__ import annotations

from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.exact.reference import integrate, rk4
from mjhcmc.exact.scalars import Number, Scalars

__all__ = ["activation_after", "activation_rate", "activation_reference", "activation_rk4"]

_ITERATIONS = 400


def activation_rate(a: Number, u: Number, act: Number, deact: Number, scalars: Scalars) -> Number:
    """a', 1/s, of an activation and an excitation within [0, 1].

    Args:
        a: activation; beyond [0, 1] the time constants stay what they are at its end, as in MuJoCo.
        u: excitation.
        act: s, time constant of activation.
        deact: s, of deactivation.
        scalars: a numeric type; all values are of it.
    """
    size = scalars.real(a)
    held = scalars.number(min(1.0, max(0.0, size))) if not 0.0 <= size <= 1.0 else a
    bend = (1 + 3 * held) / 2
    gap = u - a
    return gap / (act * bend) if scalars.real(gap) > 0.0 else gap * bend / deact


def activation_after(
    a: float | str | Number, u: float | str | Number, act: float, deact: float, time: float, scalars: Scalars
) -> Number:
    """Activation after a time under a constant excitation: the closed form.

    Args:
        a: activation at the start, within [0, 1]; a float, a decimal string or a scalar.
        u: excitation, within [0, 1].
        act: s, time constant of activation.
        deact: s, of deactivation.
        time: s.
        scalars: a numeric type.

    Raises:
        SettingsError: activation or excitation outside [0, 1], a time constant that is not positive, a negative time.
    """
    with scalars.working():
        a0, goal, rise, fall, t = _values(a, u, act, deact, time, scalars)
        c = (1 + 3 * goal) / 2
        gap = scalars.real(a0 - goal)
        if gap == 0.0:
            return a0
        if gap > 0.0:
            y0 = a0 - goal
            left = scalars.exp(-c * t / fall)
            return scalars.trim(goal + c * y0 * left / (c + 3 * y0 * (1 - left) / 2))
        # z = ln((u - a)/(u - a0)): f(z) = 1.5 y0 (e^z - 1) - c z - t/tau falls and is convex: from where it is positive
        # Newton's method never overshoots
        y0 = goal - a0
        k, x = 3 * y0 / 2, t / rise
        z = -(x + k) / c
        for _ in range(_ITERATIONS):
            power = scalars.exp(z)
            step = (k * (power - 1) - c * z - x) / (c - k * power)
            z = scalars.trim(z + step)
            if scalars.size(step) <= 4 * scalars.epsilon * (1.0 + scalars.size(z)):
                return scalars.trim(goal - y0 * scalars.exp(z))
        raise SimulationError(
            f"Newton's method has not settled after {_ITERATIONS} steps on {scalars.name}: use more digits"
        )


def activation_reference(
    a: float | str | Number, u: float | str | Number, act: float, deact: float, time: float, scalars: Scalars
) -> Number:
    """The same by `reference.integrate`: for checking one by the other.

    Args:
        a: see `activation_after`; likewise the rest.
        u: see `activation_after`.
        act: see `activation_after`.
        deact: see `activation_after`.
        time: s, positive.
        scalars: a numeric type.

    Raises:
        SettingsError: as `activation_after`.
    """
    with scalars.working():
        a0, goal, rise, fall, t = _values(a, u, act, deact, time, scalars)
        return integrate(lambda _, x: [activation_rate(x[0], goal, rise, fall, scalars)], [a0], [0.0, t], scalars)[1][0]


def activation_rk4(
    a: float | str | Number, u: float | str | Number, act: float, deact: float, time: float, n: int, scalars: Scalars
) -> Number:
    """The same by n steps of classical Runge-Kutta: the map that MuJoCo's RK4 and `mjhcmc.activation` step by.

    Args:
        a: see `activation_after`; likewise the rest.
        u: see `activation_after`.
        act: see `activation_after`.
        deact: see `activation_after`.
        time: s, of all steps together.
        n: steps.
        scalars: a numeric type.

    Raises:
        SettingsError: as `activation_after`, or no step.
    """
    if n < 1:
        raise SettingsError(f"a window needs at least one step; got {n}")
    with scalars.working():
        a0, goal, rise, fall, t = _values(a, u, act, deact, time, scalars)
        return rk4(lambda _, x: [activation_rate(x[0], goal, rise, fall, scalars)], [a0], 0.0, t / n, n, scalars)[0]


def _values(
    a: float | str | Number, u: float | str | Number, act: float, deact: float, time: float, scalars: Scalars
) -> tuple[Number, ...]:
    values = [scalars.number(x) if isinstance(x, (str, float, int)) else x for x in (a, u, act, deact, time)]
    sizes = [scalars.real(x) for x in values]
    for name, size in zip(("activation", "excitation"), sizes, strict=False):
        if not 0.0 <= size <= 1.0:
            raise SettingsError(f"the {name} {size:g} is not within 0 .. 1")
    if not (sizes[2] > 0 and sizes[3] > 0 and sizes[4] >= 0):
        raise SettingsError(
            "time constants must be positive and the time not negative; got "
            f"{sizes[2]:g} s, {sizes[3]:g} s, {sizes[4]:g} s"
        )
    return tuple(values)

"""How one computes on a scalar type: float, longdouble, complex, mpmath, python-flint, CasADi.

What is written with ``+ - * /`` and the functions of `Scalars` runs on all of them. Packages are imported when asked
for: none of them is needed by the rest of mjhcmc.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from mjhcmc.errors import SettingsError

__all__ = [
    "COMPLEX",
    "FLOAT",
    "LONGDOUBLE",
    "QUADRUPLE_BITS",
    "Number",
    "Scalars",
    "casadi",
    "flint_acb",
    "flint_arb",
    "mpmath",
]

Number = Any
"""A scalar of some type: what `Scalars.number` returns, and what comes of computing with it."""

QUADRUPLE_BITS = 113
"""Of the significand of IEEE 754 binary128, which C calls _Float128."""

_MOST_DIGITS = 280  # errors are compared as floats, which end at 1e-308


@dataclass(frozen=True)
class Scalars:
    """A scalar type.

    Attributes:
        name: for tables and messages.
        bits: of the significand; relative rounding error is 2**-bits where results are rounded to nearest.
        number: a float, exactly, or a decimal string to all the type's digits, as this type.
        sin: of such a number; likewise cos, sqrt, exp, log.
        cos: see sin.
        sqrt: see sin.
        exp: see sin.
        log: natural; see sin.
        size: magnitude as a float; symbolic types have none.
        real: the nearest float of its real part; symbolic types have none.
        trim: the number without the error bound that ball arithmetic carries along; else the number itself.
        working: a context in which computations have this type's precision.
    """

    name: str
    bits: int
    number: Callable[[float | str], Number]
    sin: Callable[[Number], Number]
    cos: Callable[[Number], Number]
    sqrt: Callable[[Number], Number]
    exp: Callable[[Number], Number]
    log: Callable[[Number], Number]
    size: Callable[[Number], float]
    real: Callable[[Number], float]
    trim: Callable[[Number], Number] = lambda x: x
    working: Callable[[], AbstractContextManager[Any]] = nullcontext

    @property
    def digits(self) -> int:
        """Decimal digits that survive a round trip."""
        return int((self.bits - 1) * math.log10(2))

    @property
    def epsilon(self) -> float:
        """Relative rounding error, 2**-bits."""
        return math.ldexp(1.0, -self.bits)


def _magnitude(x: Number) -> float:
    return float(abs(x))


FLOAT = Scalars("float64", 53, float, math.sin, math.cos, math.sqrt, math.exp, math.log, _magnitude, float)
"""IEEE 754 binary64."""

COMPLEX = Scalars(
    "complex128",
    53,
    complex,
    cmath.sin,
    cmath.cos,
    cmath.sqrt,
    cmath.exp,
    cmath.log,
    _magnitude,
    lambda x: float(x.real),
)
"""For derivatives by complex steps (Squire & Trapp 1998, doi 10.1137/S003614459631241X): f'(x) = Im f(x + ih)/h."""

LONGDOUBLE = Scalars(
    "longdouble",
    int(np.finfo(np.longdouble).nmant) + 1,
    np.longdouble,
    np.sin,
    np.cos,
    np.sqrt,
    np.exp,
    np.log,
    _magnitude,
    float,
)
"""What C calls long double: 80 bits (a significand of 64) on x86, float64 with MSVC, 128 bits on some others."""


@cache
def mpmath(digits: int | None = None, *, bits: int | None = None) -> Scalars:
    """Floating point of any precision, rounded to nearest (mpmath), in a context of its own.

    Args:
        digits: decimal digits; or
        bits: of the significand. 113 rounds as binary128 does.

    Raises:
        SettingsError: the package is not installed, or not one of digits and bits is given.
    """
    n = _bits(digits, bits)
    ctx = _package("mpmath", "mpmath").mp.clone()
    ctx.prec = n
    return Scalars(f"mpmath {n} bits", n, ctx.mpf, ctx.sin, ctx.cos, ctx.sqrt, ctx.exp, ctx.log, _magnitude, float)


@cache
def flint_arb(digits: int | None = None, *, bits: int | None = None) -> Scalars:
    """Real balls (Arb in FLINT): numbers with bounds on their error. Faster than mpmath; midpoints are truncated.

    Bounds grow without end along a trajectory: integrators drop them (`Scalars.trim`) at every step.

    Args:
        digits: decimal digits; or
        bits: of the significand.

    Raises:
        SettingsError: as `mpmath`.
    """
    n = _bits(digits, bits)
    flint = _package("flint", "python-flint")
    arb = flint.arb

    def number(x: float | str) -> Number:
        with flint.ctx.workprec(n):
            return arb(x).mid()

    return Scalars(
        f"arb {n} bits",
        n,
        number,
        arb.sin,
        arb.cos,
        arb.sqrt,
        arb.exp,
        arb.log,
        lambda x: abs(float(x.mid())),
        lambda x: float(x.mid()),
        arb.mid,
        lambda: flint.ctx.workprec(n),
    )


@cache
def flint_acb(digits: int | None = None, *, bits: int | None = None) -> Scalars:
    """Complex balls (Arb in FLINT), for complex steps at any precision.

    Args:
        digits: decimal digits; or
        bits: of the significand.

    Raises:
        SettingsError: as `mpmath`.
    """
    n = _bits(digits, bits)
    flint = _package("flint", "python-flint")
    acb = flint.acb

    def trim(x: Number) -> Number:
        return acb(x.real.mid(), x.imag.mid())

    def number(x: float | str) -> Number:
        with flint.ctx.workprec(n):
            return trim(acb(flint.arb(x)))

    return Scalars(
        f"acb {n} bits",
        n,
        number,
        acb.sin,
        acb.cos,
        acb.sqrt,
        acb.exp,
        acb.log,
        lambda x: float(abs(x).mid()),
        lambda x: float(x.real.mid()),
        trim,
        lambda: flint.ctx.workprec(n),
    )


@cache
def casadi() -> Scalars:
    """CasADi's scalar expressions (SX): symbolic; there are no magnitudes, so no adaptive integration.

    Raises:
        SettingsError: the package is not installed.
    """
    ca = _package("casadi", "casadi")
    return Scalars("casadi SX", 53, _symbolic(ca.SX), ca.sin, ca.cos, ca.sqrt, ca.exp, ca.log, _none, _none)


def _symbolic(expression: Callable[[float], Number]) -> Callable[[float | str], Number]:
    return lambda x: expression(float(x))


def _none(x: Number) -> float:
    raise SettingsError(f"the expression {x!s:.40} has no value: use a numeric scalar type")


def _bits(digits: int | None, bits: int | None) -> int:
    if (digits is None) == (bits is None):
        raise SettingsError(f"give either digits or bits; got digits {digits}, bits {bits}")
    n = bits if bits is not None else math.ceil((digits or 0) * math.log2(10)) + 1
    if not 16 <= n <= _MOST_DIGITS * 4:
        raise SettingsError(f"{n} bits is not within 16 .. {_MOST_DIGITS * 4}, some 4 to {_MOST_DIGITS} digits")
    return n


def _package(module: str, distribution: str) -> Any:
    try:
        return import_module(module)
    except ImportError as error:
        extra = "engines" if module == "casadi" else "precision"
        raise SettingsError(
            f'the package {distribution} is not installed: pip install {distribution}, or "mjhcmc[{extra}]"'
        ) from error

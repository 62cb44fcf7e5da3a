"""What virtual patients are drawn from: distributions by name, each with its unit and where it comes from.

A distribution turns a uniform number into a value by its inverse cumulative distribution function, in closed form or
by the normal's. Nothing is rejected and drawn again, so a patient takes the same numbers from a generator whatever
comes out, and a change of one distribution moves no other quantity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Protocol

from scipy.special import ndtr, ndtri

from mjhcmc.checks import is_number
from mjhcmc.errors import SettingsError

MAX_RHO = 0.8
"""Most that a quantity may share with severity: more, and one latent would tell the others."""


class Distribution(Protocol):
    """A distribution that is sampled by its inverse cumulative distribution function."""

    def at(self, u: float) -> float:
        """The value below which a share u (0 to 1) of the population lies."""

    def __str__(self) -> str:
        """For people: kind and numbers."""


@dataclass(frozen=True)
class Uniform:
    """Every value from low to high alike."""

    low: float
    high: float

    def __post_init__(self) -> None:
        """Check the limits.

        Raises:
            SettingsError: no finite numbers, or low is not below high.
        """
        _check(self)

    def at(self, u: float) -> float:
        """low + u (high - low)."""
        return _within(self.low + _share(u) * (self.high - self.low), self.low, self.high)

    def __str__(self) -> str:
        """For people."""
        return f"uniform, {self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class TruncatedNormal:
    """A normal distribution of which only low to high is left. Mean and sd are those before the cut."""

    mean: float
    sd: float
    low: float
    high: float

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            SettingsError: no finite numbers, sd not positive, or low not below high.
        """
        _check(self, "sd")

    def at(self, u: float) -> float:
        """Mean + sd z, z = Phi^-1(Phi(a) + u (Phi(b) - Phi(a))), a and b the limits in sd from the mean."""
        a, b = (float(ndtr((limit - self.mean) / self.sd)) for limit in (self.low, self.high))
        return _within(self.mean + self.sd * float(ndtri(a + _share(u) * (b - a))), self.low, self.high)

    def __str__(self) -> str:
        """For people."""
        return f"normal, {self.mean:g} ± {self.sd:g}, cut at {self.low:g} and {self.high:g}"


@dataclass(frozen=True)
class LogNormal:
    """The logarithm is normal about log(median) with sd sigma; only low to high is left."""

    median: float
    sigma: float
    low: float
    high: float

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            SettingsError: no finite numbers, any not positive, or low not below high.
        """
        _check(self, "median", "sigma", "low")

    def at(self, u: float) -> float:
        """exp of a cut normal's value; see `TruncatedNormal.at`."""
        logarithm = TruncatedNormal(math.log(self.median), self.sigma, math.log(self.low), math.log(self.high))
        return _within(math.exp(logarithm.at(u)), self.low, self.high)

    def __str__(self) -> str:
        """For people."""
        return f"log-normal, {self.median:g}, sigma {self.sigma:g}, cut at {self.low:g} and {self.high:g}"


@dataclass(frozen=True)
class Kumaraswamy:
    """A skewed distribution from low to high: with x = (value - low)/(high - low), F = 1 - (1 - x^a)^b.

    It takes the shapes of a beta distribution and has a closed inverse (Kumaraswamy 1980,
    doi:10.1016/0022-1694(80)90036-0). With a = 1 and b > 1 most values are near low, with a > 1 and b = 1 near high.
    """

    a: float
    b: float
    low: float
    high: float

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            SettingsError: no finite numbers, a or b not positive, or low not below high.
        """
        _check(self, "a", "b")

    def at(self, u: float) -> float:
        """low + (high - low) (1 - (1 - u)^(1/b))^(1/a)."""
        x = (1.0 - (1.0 - _share(u)) ** (1.0 / self.b)) ** (1.0 / self.a)
        return _within(self.low + (self.high - self.low) * x, self.low, self.high)

    def __str__(self) -> str:
        """For people."""
        return f"Kumaraswamy, a {self.a:g}, b {self.b:g}, {self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class WithZeros:
    """A share of the population has exactly 0, the others have what another distribution gives."""

    zeros: float
    others: Uniform | TruncatedNormal | LogNormal | Kumaraswamy

    def __post_init__(self) -> None:
        """Check the share.

        Raises:
            SettingsError: zeros is not in [0, 1), or the others would be below 0.
        """
        if not (is_number(self.zeros) and 0 <= self.zeros < 1):
            raise SettingsError(f"WithZeros: zeros is {self.zeros!r}: give a share from 0 to under 1")
        if self.others.low < 0:
            raise SettingsError(f"WithZeros: the others begin at {self.others.low:g}: give a distribution from 0 up")

    def at(self, u: float) -> float:
        """0 up to u = zeros, then the others' value at (u - zeros)/(1 - zeros)."""
        u = _share(u)
        return self.others.at((u - self.zeros) / (1.0 - self.zeros)) if u > self.zeros else 0.0

    def __str__(self) -> str:
        """For people."""
        return f"0 in {100 * self.zeros:g} %, else {self.others}"


def _check(distribution: Uniform | TruncatedNormal | LogNormal | Kumaraswamy, *positive: str) -> None:
    """Refuse numbers that make no distribution."""
    kind = type(distribution).__name__
    for field in fields(distribution):
        value = getattr(distribution, field.name)
        if not (is_number(value) and math.isfinite(value)):
            raise SettingsError(f"{kind}: {field.name} is {value!r}: give a finite number")
        if field.name in positive and not value > 0:
            raise SettingsError(f"{kind}: {field.name} is {value!r}: give a number over 0")
    if not distribution.low < distribution.high:
        raise SettingsError(f"{kind}: low is {distribution.low:g}, high {distribution.high:g}: give low below high")


def _share(u: float) -> float:
    if not (is_number(u) and 0 <= u <= 1):
        raise SettingsError(f"u is {u!r}: a share of a population is a number from 0 to 1")
    return float(u)


def _within(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)  # what rounding puts a last digit outside


@dataclass(frozen=True)
class Named:
    """A quantity's distribution, with all that is to be said about it.

    Attributes:
        distribution: of its value in the population.
        unit: of the value; empty where it has none.
        source: the paper it comes from, or that it was chosen here and why.
        rho: correlation of its normal score with that of severity; its sign says whether severity raises it.
        reason: for rho, where it is not 0.
    """

    distribution: Distribution
    unit: str
    source: str
    rho: float = 0.0
    reason: str = ""

    def __post_init__(self) -> None:
        """Check what can be checked.

        Raises:
            SettingsError: no source, rho beyond `MAX_RHO`, or a rho without a reason.
        """
        if not self.source.strip():
            raise SettingsError(
                f"distribution {self.distribution}: it has no source: name a paper, or say why it is so"
            )
        if not (is_number(self.rho) and abs(self.rho) <= MAX_RHO):
            raise SettingsError(f"distribution {self.distribution}: rho is {self.rho!r}: give at most {MAX_RHO:g}")
        if self.rho and not self.reason.strip():
            raise SettingsError(f"distribution {self.distribution}: rho is {self.rho:g} for no reason: give one")


_HEIGHT = "chosen here: adults of high-income countries, after NCD-RisC (2016, doi:10.7554/eLife.13410)"
_SEGMENT = "mean of de Leva (1996, doi:10.1016/0021-9290(95)00178-6); the spread of 5 % is chosen here"
_NO_TABLE = "chosen here: no published table maps spasticity of leg muscles to parameters"
_FALISSE = "Falisse et al. (2018, doi:10.1371/journal.pone.0208811)"
_STRETCH = "stretches of leg8's muscles in one-second passive tests peak at 1 to 2 optimal fiber lengths a second"
_TISSUE = (
    "chosen here: spastic muscle is stiffer and its sarcomeres longer "
    "(Smith et al. 2011, doi:10.1113/jphysiol.2010.203364)"
)
_SLOWLY = "contracture follows spasticity and disuse over months, so it goes with severity loosely"
_GAIN = "the more severe the lesion, the stronger the stretch reflex; far from one to one"
_THRESHOLD = "the more severe the lesion, the slower the stretch that is answered; far from one to one"


def _segment(fraction: float) -> Named:
    spread = 0.05 * fraction
    return Named(TruncatedNormal(fraction, spread, fraction - 3 * spread, fraction + 3 * spread), "", _SEGMENT)


DISTRIBUTIONS: Mapping[str, Named] = MappingProxyType(
    {
        "sex": Named(Uniform(0.0, 1.0), "M from 0.5 up", "chosen here: half and half"),
        "height/M": Named(TruncatedNormal(1.75, 0.07, 1.54, 1.96), "m", _HEIGHT),
        "height/F": Named(TruncatedNormal(1.62, 0.065, 1.425, 1.815), "m", _HEIGHT),
        "body_mass_index": Named(
            TruncatedNormal(26.0, 4.0, 18.0, 38.0),
            "kg/m^2",
            "chosen here: adults of high-income countries, after NCD-RisC (2016, doi:10.1016/S0140-6736(16)30054-X)",
        ),
        "thigh_mass_fraction/M": _segment(0.1416),
        "thigh_mass_fraction/F": _segment(0.1478),
        "shank_mass_fraction/M": _segment(0.0433),
        "shank_mass_fraction/F": _segment(0.0481),
        "foot_mass_fraction/M": _segment(0.0137),
        "foot_mass_fraction/F": _segment(0.0129),
        "strength": Named(
            LogNormal(1.0, 0.2, 0.55, 1.8),
            "",
            "chosen here: people of the same mass and height still differ; muscle volume goes with mass times height "
            "(Handsfield et al. 2014, doi:10.1016/j.jbiomech.2013.12.002)",
        ),
        "paresis": Named(
            Uniform(0.4, 1.0),
            "",
            "chosen here: from no weakness to less than half of the strength",
            rho=-0.6,
            reason="weakness and spasticity come from one lesion, by different pathways",
        ),
        "severity": Named(
            WithZeros(0.25, Uniform(0.0, 1.0)),
            "",
            "chosen here: 0 in the least affected quarter, so that grade 0 is well represented",
        ),
        "delay": Named(
            TruncatedNormal(0.035, 0.005, 0.02, 0.06),
            "s",
            f"chosen here: about the 30 ms of published models ({_FALISSE}), with a spread",
        ),
        "cocontraction": Named(
            Kumaraswamy(1.0, 2.0, 0.0, 0.2),
            "",
            _NO_TABLE,
            rho=0.5,
            reason="antagonists are inhibited less after the same lesion",
        ),
        "activation_time": Named(
            Uniform(0.010, 0.015),
            "s",
            "from 10 ms (Millard et al. 2013, doi:10.1115/1.4023390) to 15 ms (Thelen 2003, doi:10.1115/1.1531112)",
        ),
        "deactivation_time": Named(
            Uniform(0.040, 0.060),
            "s",
            "from 40 ms (Millard et al. 2013, doi:10.1115/1.4023390) to 60 ms (De Groote et al. 2016, "
            "doi:10.1007/s10439-016-1591-9)",
        ),
        "gain/velocity": Named(
            WithZeros(0.3, Kumaraswamy(1.0, 3.0, 0.02, 0.5)),
            "s",
            f"{_NO_TABLE}; {_STRETCH}, which are answered with up to half of full excitation, mostly a tenth",
            rho=0.8,
            reason=_GAIN,
        ),
        "gain/equation1": Named(
            WithZeros(0.3, Kumaraswamy(1.0, 3.0, 0.02, 0.6)),
            "1/lopt",
            f"{_NO_TABLE}; the excitation is this times the length of the stretch, of .3 to 1 optimal fiber lengths",
            rho=0.8,
            reason=_GAIN,
        ),
        "gain/force": Named(
            WithZeros(0.3, Kumaraswamy(1.0, 3.0, 0.05, 0.8)),
            "per F0",
            f"{_NO_TABLE}; the law is that of {_FALISSE}; from about 1 up the reflex keeps itself going",
            rho=0.8,
            reason=_GAIN,
        ),
        "threshold/velocity": Named(
            Uniform(0.05, 1.5), "lopt/s", f"{_NO_TABLE}; {_STRETCH}", rho=-0.6, reason=_THRESHOLD
        ),
        "threshold/force": Named(
            Uniform(0.05, 0.3),
            "F0",
            f"{_NO_TABLE}; the law is that of {_FALISSE}",
            rho=-0.6,
            reason=_THRESHOLD,
        ),
        "passive_strain": Named(Kumaraswamy(4.0, 1.0, 0.3, 0.6), "lopt", _TISSUE, rho=-0.5, reason=_SLOWLY),
        "fiber_shortening": Named(
            WithZeros(0.3, Kumaraswamy(1.0, 2.5, 0.0, 0.15)),
            "lopt",
            f"{_TISSUE}; half of the people with a stroke get a contracture somewhere (Kwah et al. 2012, "
            "doi:10.1016/S1836-9553(12)70071-1)",
            rho=0.5,
            reason=_SLOWLY,
        ),
        "tone": Named(
            Kumaraswamy(1.0, 2.0, 0.0, 0.05),
            "",
            f"{_NO_TABLE}; muscles at rest are all but silent, with spasticity not always",
            rho=0.5,
            reason="muscles that cannot be relaxed go with a strong reflex, not in everyone",
        ),
    }
)
"""What each latent quantity of a patient is drawn from. A name with a slash holds for the sex or reflex after it."""

GROUP_RHO = 0.85
"""Correlation of a muscle group's severity with the patient's, as normal scores; two groups' is its square.

Chosen here: groups of one leg share a lesion but are not equally affected."""

GROUP_SHIFT: Mapping[str, float] = MappingProxyType(
    {"hip_flexors": -0.4, "knee_extensors": 0.0, "knee_flexors": 0.0, "plantarflexors": 0.4}
)
"""How far a muscle group's severity lies from the patient's on average, in standard deviations.

Chosen here: the farther from the trunk, the more affected; plantarflexors most often of all muscles of the leg."""


def distributions_table() -> str:
    """`DISTRIBUTIONS` as a Markdown table: quantity, unit, distribution, share with severity, source."""
    rows = [("Quantity", "Unit", "Distribution", "With severity", "Source"), ("---",) * 5]
    for name, named in DISTRIBUTIONS.items():
        shared = f"{named.rho:+g}: {named.reason}" if named.rho else ""
        rows.append((f"`{name}`", named.unit, str(named.distribution), shared, named.source))
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"

"""A virtual patient: a frozen record of latent mechanisms, drawn from one seed and an index.

How the parts of a patient hang together: severity has a normal score z; each muscle group has a severity of its own,
z_g = r z + sqrt(1 - r^2) e_g + shift_g; and a quantity k of the group takes z_k = rho_k z_g + sqrt(1 - rho_k^2) e_k,
e all independent standard normal. Its value is that of its distribution at Phi(z_k): a Gaussian copula, so that every
distribution is as stated (moved by rho_k shift_g in its score), and quantities are partly independent of each other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from mjhcmc.checks import is_number
from mjhcmc.errors import SettingsError
from mjhcmc.muscle_choice import MUSCLES as MUSCLE_MODELS
from mjhcmc.patients.distributions import DISTRIBUTIONS, GROUP_RHO, GROUP_SHIFT
from mjhcmc.patients.groups import GROUPS

REFLEXES = ("velocity", "equation1", "force")
"""Stretch reflexes: of velocity over a threshold, delayed; the paper's Eq. 1; of muscle force."""

SEXES = ("F", "M")

PATIENT, SESSION, SENSORS, RATERS = range(4)
"""Purposes of `stream`."""

_PURPOSES = 4
_THRESHOLDS = {"velocity": "threshold/velocity", "equation1": "threshold/velocity", "force": "threshold/force"}

# The order of draws: a new one goes to the end, or everyone becomes someone else.
_DRAWS = (
    "sex", "height", "body_mass_index", "thigh_mass_fraction", "shank_mass_fraction", "foot_mass_fraction", "strength",
    "paresis", "severity", "delay", "cocontraction", "activation_time", "deactivation_time",
)  # fmt: skip
_GROUP_DRAWS = ("severity", "gain", "threshold", "passive_strain", "fiber_shortening", "tone")

# What a patient's numbers may be; wider than what is drawn, for patients made by hand.
_LIMITS: Mapping[str, tuple[float, float]] = {
    "height": (1.0, 2.5), "body_mass": (20.0, 250.0), "thigh_mass_fraction": (0.01, 0.5),
    "shank_mass_fraction": (0.005, 0.5), "foot_mass_fraction": (0.001, 0.5), "strength": (0.01, 10.0),
    "paresis": (0.01, 1.0), "severity": (0.0, 1.0), "delay": (0.0, 1.0), "cocontraction": (0.0, 1.0),
    "activation_time": (0.001, 1.0), "deactivation_time": (0.001, 1.0),
    "gain": (0.0, 1e3), "threshold": (0.0, 1e3), "passive_strain": (0.05, 5.0), "fiber_shortening": (0.0, 0.5),
    "tone": (0.0, 1.0),
}  # fmt: skip
_CHOICES: Mapping[str, tuple[str, ...]] = {"sex": SEXES, "reflex": REFLEXES, "muscle": MUSCLE_MODELS}


@dataclass(frozen=True)
class GroupState:
    """What spasticity and contracture make of a muscle group.

    Attributes:
        name: one of `groups.GROUPS`.
        gain: of the reflex: s (excitation per lopt/s) of ``"velocity"``, 1/lopt of ``"equation1"``, excitation
            per F0 of ``"force"``.
        threshold: of the reflex, lopt/s, or in F0 of ``"force"``.
        passive_strain: fiber strain at which passive force is F0, beside a healthy .6; the smaller the stiffer.
        fiber_shortening: share of the optimal fiber length that contracture took.
        tone: excitation at rest.
    """

    name: str
    gain: float
    threshold: float
    passive_strain: float
    fiber_shortening: float
    tone: float

    def __post_init__(self) -> None:
        """Check that the numbers can be.

        Raises:
            SettingsError: naming the group and what is out of place.
        """
        if self.name not in GROUPS:
            raise SettingsError(f"muscle group {self.name!r} is not known: choose one of {', '.join(GROUPS)}")
        for name in _GROUP_DRAWS[1:]:
            _check_number(f"{name}/{self.name}", getattr(self, name), *_LIMITS[name])


@dataclass(frozen=True)
class Patient:
    """A virtual patient. Two are equal where all their values are.

    Attributes:
        seed: of the cohort.
        index: in the cohort, from 0.
        reflex: one of `REFLEXES`.
        muscle: one of `mjhcmc.muscle_choice.MUSCLES`: which muscle model moves the patient.
        sex: "F" or "M".
        height: m.
        body_mass: kg.
        thigh_mass_fraction: of the body mass; shank and foot alike.
        shank_mass_fraction: of the body mass.
        foot_mass_fraction: of the body mass.
        strength: max isometric force over that expected at this mass, before paresis.
        paresis: share of the strength that is left.
        severity: 0 to 1, the latent that the mechanisms share.
        delay: s, of the reflex.
        cocontraction: excitation of antagonists over that of agonists.
        activation_time: s.
        deactivation_time: s.
        groups: one `GroupState` for each of `groups.GROUPS`, in that order.
    """

    seed: int
    index: int
    reflex: str
    muscle: str
    sex: str
    height: float
    body_mass: float
    thigh_mass_fraction: float
    shank_mass_fraction: float
    foot_mass_fraction: float
    strength: float
    paresis: float
    severity: float
    delay: float
    cocontraction: float
    activation_time: float
    deactivation_time: float
    groups: tuple[GroupState, ...]

    def __post_init__(self) -> None:
        """Check that the values can be.

        Raises:
            SettingsError: naming what is out of place.
        """
        for name in ("seed", "index"):
            _check_count(name, getattr(self, name))
        for name, known in _CHOICES.items():
            _check_word(name, getattr(self, name), known)
        for name in _NUMBERS:
            _check_number(name, getattr(self, name), *_LIMITS[name])
        names = tuple(group.name for group in self.groups)
        if names != tuple(GROUPS):
            raise SettingsError(f"a patient's muscle groups are {', '.join(GROUPS)}, in this order; got {names}")

    def group(self, name: str) -> GroupState:
        """The state of a muscle group.

        Raises:
            SettingsError: no such group.
        """
        for group in self.groups:
            if group.name == name:
                return group
        raise SettingsError(f"muscle group {name!r} is not known: choose one of {', '.join(GROUPS)}")

    def row(self) -> dict[str, float | int | str]:
        """All values by column: the attributes, and each group's as ``gain/knee_extensors``."""
        row: dict[str, float | int | str] = {name: getattr(self, name) for name in _COLUMNS if "/" not in name}
        return row | {
            f"{name}/{group.name}": getattr(group, name) for group in self.groups for name in _GROUP_DRAWS[1:]
        }

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> Patient:
        """The patient of a row, as `row` gives it; numpy's numbers and words will do.

        Args:
            row: value by column.

        Raises:
            SettingsError: a column is missing or unknown, or a value is of the wrong kind or out of place.
        """
        for column in _COLUMNS:
            if column not in row:
                raise SettingsError(
                    f"a patient's row has no column {column!r}: give all {len(_COLUMNS)} of Patient.row()"
                )
        for column in row:
            if column not in _COLUMNS:
                raise SettingsError(f"a patient's row has the column {column!r}, which is not known: leave it out")
        values = {column: _read(column, row[column]) for column in _COLUMNS}
        groups = (GroupState(name, **{key: values[f"{key}/{name}"] for key in _GROUP_DRAWS[1:]}) for name in GROUPS)
        own = {column: value for column, value in values.items() if "/" not in column}
        return cls(**own, groups=tuple(groups))


_NUMBERS = tuple(field.name for field in fields(Patient) if field.name in _LIMITS)
_COLUMNS = (
    *(field.name for field in fields(Patient) if field.name != "groups"),
    *(f"{name}/{group}" for group in GROUPS for name in _GROUP_DRAWS[1:]),
)


def healthy(height: float = 1.8, body_mass: float = 75.1646) -> Patient:
    """A person with no reflex, contracture, tone or weakness; by default of leg8's size.

    Args:
        height: m.
        body_mass: kg.
    """
    fractions = {f"{part}_mass_fraction": DISTRIBUTIONS[f"{part}_mass_fraction/M"].distribution.at(0.5) for part in
                 ("thigh", "shank", "foot")}  # fmt: skip
    none = tuple(GroupState(name, 0.0, 1.0, 0.6, 0.0, 0.0) for name in GROUPS)
    return Patient(
        seed=0, index=0, reflex="velocity", muscle="mujoco", sex="M", height=height, body_mass=body_mass, **fractions,
        strength=1.0, paresis=1.0, severity=0.0, delay=0.035, cocontraction=0.0, activation_time=0.01,
        deactivation_time=0.04, groups=none,
    )  # fmt: skip


def stream(seed: int, index: int, purpose: int) -> np.random.Generator:
    """The random numbers of one patient for one purpose, independent of all others.

    Args:
        seed: of the cohort, 0 or more.
        index: of the patient, 0 or more.
        purpose: `PATIENT`, `SESSION`, `SENSORS` or `RATERS`.

    Raises:
        SettingsError: a seed or index below 0 or not whole, or an unknown purpose.
    """
    for name, value in (("seed", seed), ("index", index), ("purpose", purpose)):
        _check_count(name, value)
    if purpose >= _PURPOSES:
        raise SettingsError(f"purpose is {purpose}: choose PATIENT, SESSION, SENSORS or RATERS, 0 to {_PURPOSES - 1}")
    sequence = np.random.SeedSequence(entropy=int(seed), spawn_key=(int(index), int(purpose)))
    return np.random.Generator(np.random.PCG64(sequence))


def sample_patient(seed: int, index: int, *, reflex: str = "velocity", muscle: str = "mujoco") -> Patient:
    """Draw a patient, the same on every machine.

    Only uniform numbers are drawn, always as many. Values are rounded to nine significant digits, so that the last
    digits of a machine's logarithms do not tell. Reflex and muscle model change nothing but the unit and range of gains
    and thresholds: the patient is the same one.

    Args:
        seed: of the cohort, 0 or more.
        index: in the cohort, 0 or more.
        reflex: one of `REFLEXES`.
        muscle: one of `mjhcmc.muscle_choice.MUSCLES`.

    Raises:
        SettingsError: a seed or index below 0 or not whole, or an unknown reflex or muscle model.
    """
    for name, value in (("reflex", reflex), ("muscle", muscle)):
        _check_word(name, value, _CHOICES[name])
    numbers = stream(seed, index, PATIENT).random(len(_DRAWS) + len(GROUPS) * len(_GROUP_DRAWS)).tolist()
    u = dict(zip(_DRAWS, numbers, strict=False))
    rest = iter(numbers[len(_DRAWS) :])
    sex = SEXES[int(_value("sex", u["sex"]) >= 0.5)]
    height = _value(f"height/{sex}", u["height"])
    severity = _score(u["severity"])
    groups = []
    for name in GROUPS:
        own = {draw: next(rest) for draw in _GROUP_DRAWS}
        affected = _mix(GROUP_RHO, severity, own.pop("severity")) + GROUP_SHIFT[name]
        keys = {"gain": f"gain/{reflex}", "threshold": _THRESHOLDS[reflex]}
        groups.append(GroupState(name, **{k: _digits(_value(keys.get(k, k), own[k], affected)) for k in own}))
    fractions = {f"{part}_mass_fraction": f"{part}_mass_fraction/{sex}" for part in ("thigh", "shank", "foot")}
    plain = (
        *fractions,
        "strength",
        "paresis",
        "severity",
        "delay",
        "cocontraction",
        "activation_time",
        "deactivation_time",
    )
    return Patient(
        seed=int(seed),
        index=int(index),
        reflex=reflex,
        muscle=muscle,
        sex=sex,
        height=_digits(height),
        body_mass=_digits(_value("body_mass_index", u["body_mass_index"]) * height**2),
        **{name: _digits(_value(fractions.get(name, name), u[name], severity)) for name in plain},
        groups=tuple(groups),
    )


def _value(name: str, u: float, severity: float = 0.0) -> float:
    """A quantity's value at the uniform number u, moved by the normal score of severity as far as it shares it."""
    named = DISTRIBUTIONS[name]
    return named.distribution.at(float(ndtr(_mix(named.rho, severity, u))) if named.rho else u)


def _mix(rho: float, severity: float, u: float) -> float:
    return rho * severity + math.sqrt(1 - rho**2) * _score(u)


def _score(u: float) -> float:
    return float(ndtri(max(u, 2.0**-54)))  # a generator may give 0, never 1


def _digits(value: float) -> float:
    return float(f"{value:.9g}")


def _check_count(name: str, value: object) -> None:
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 0:
        raise SettingsError(f"{name} is {value!r}: give a whole number, 0 or more")


def _check_word(name: str, value: object, known: tuple[str, ...]) -> None:
    if value not in known:
        raise SettingsError(f"{name} {value!r} is not known: choose one of {', '.join(known)}")


def _check_number(name: str, value: object, low: float, high: float) -> None:
    if not (is_number(value) and low <= value <= high):
        raise SettingsError(f"{name} is {value!r}: give a number from {low:g} to {high:g}")


def _read(column: str, value: object) -> Any:
    """A row's value as Python's own; errors as `Patient.from_row`."""
    if column in _CHOICES:
        if not isinstance(value, str):
            raise SettingsError(f"a patient's row: {column} is {value!r}: give a word")
        return str(value)
    if column in ("seed", "index"):
        _check_count(column, value)
        return int(value)  # type: ignore[call-overload]
    if not is_number(value):
        raise SettingsError(f"a patient's row: {column} is {value!r}: give a number")
    return float(value)

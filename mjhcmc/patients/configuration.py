"""What determines a dataset: how many patients, from which seed, simulated with which settings, by which version."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mjhcmc import __version__
from mjhcmc.checks import is_number
from mjhcmc.errors import SettingsError

FORMAT = 1
"""Of the dataset: raised when the same settings and version would give other columns or files."""

GENERATOR = f"mjhcmc-{__version__}/dataset-{FORMAT}"
"""What every row says it was made by."""

SHARD_SIZE = 25
"""Patients a shard, by default."""

SHARES: dict[str, int] = {
    "train": 60,
    "validation": 10,
    "test": 15,
    "shift_muscle": 5,
    "shift_reflex": 5,
    "shift_velocity": 5,
}
"""Percent of the patients in each split, in the order of their indices."""

_LARGEST = 2**63 - 1  # seed and index are int64 columns
_MOST_PATIENTS = 10**7  # the plan of all shards is held in memory
_POSITIVE = ("dt", "physics_dt", "rate")

Setting = int | float | str


def splits(patients: int) -> dict[str, range]:
    """Patient indices of each split: contiguous blocks in the order of `SHARES`.

    Sizes by largest remainder (Hamilton's method) in whole numbers; of equal remainders, the earlier split's first. A
    patient's split depends on the number of patients and on its index only.

    Args:
        patients: how many there are.

    Returns:
        A range for every split; empty where few patients leave none for it.
    """
    sizes = {name: patients * share // 100 for name, share in SHARES.items()}
    by_remainder = sorted(SHARES, key=lambda name: -(patients * SHARES[name] % 100))  # stable: ties keep the order
    for name in by_remainder[: patients - sum(sizes.values())]:
        sizes[name] += 1
    blocks, first = {}, 0
    for name, size in sizes.items():
        blocks[name] = range(first, first + size)
        first += size
    return blocks


@dataclass(frozen=True)
class Configuration:
    """What determines every byte of a dataset, on one platform and one set of versions.

    Attributes:
        patients: how many; ten million at most.
        seed: of all patients; each is drawn from (seed, index).
        shard_size: patients a shard, at most.
        settings: of the simulation, by name: numbers (SI) and words; by default those of the battery of tests.
    """

    patients: int
    seed: int = 0
    shard_size: int = SHARD_SIZE
    settings: Mapping[str, Setting] = field(default_factory=lambda: _defaults())

    def __post_init__(self) -> None:
        """Check the values, and keep a plain copy of the settings.

        Raises:
            SettingsError: a number that is not whole or out of range, or a setting that is no finite number or word.
        """
        for name, least, most in (("patients", 1, _MOST_PATIENTS), ("seed", 0, _LARGEST), ("shard_size", 1, _LARGEST)):
            object.__setattr__(self, name, whole_number(name, getattr(self, name), least, most))
        settings = {name: _plain(name, self.settings[name]) for name in sorted(self.settings)}
        object.__setattr__(self, "settings", settings)

    @classmethod
    def with_defaults(
        cls, patients: int, seed: int = 0, shard_size: int = SHARD_SIZE, **changes: Setting
    ) -> Configuration:
        """The default settings of the simulation, but for some.

        Raises:
            SettingsError: as the constructor; a setting that the simulation does not have, or of another kind.
        """
        from mjhcmc.patients.examination import checked

        settings = _defaults()
        for name, value in changes.items():
            if name not in settings:
                raise SettingsError(f"setting {name!r} is not known: choose one of {', '.join(sorted(settings))}")
            settings[name] = _like(name, _plain(name, value), settings[name])
        return cls(patients, seed, shard_size, checked(settings))

    @property
    def generator(self) -> str:
        """Version of mjhcmc and format of the dataset."""
        return GENERATOR

    @cached_property
    def hash(self) -> str:
        """First 16 hex digits of the SHA-256 of `to_dict` and `generator` as canonical JSON."""
        text = json.dumps({**self.to_dict(), "generator": self.generator}, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def to_dict(self) -> dict[str, object]:
        """The fields as plain values."""
        return {
            "patients": self.patients,
            "seed": self.seed,
            "shard_size": self.shard_size,
            "settings": dict(self.settings),
        }


def whole_number(name: str, value: object, least: int, most: int = _LARGEST) -> int:
    """A whole number of at least and at most so much, as Python's int.

    Raises:
        SettingsError: it is none, or out of range.
    """
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole or int(value) < least:  # type: ignore[call-overload]
        raise SettingsError(f"{name} must be a whole number of at least {least}; got {value!r}")
    if int(value) > most:  # type: ignore[call-overload]
        raise SettingsError(f"{name} must be a whole number of at most {most}; got {value!r}")
    return int(value)  # type: ignore[call-overload, no-any-return]


def _defaults() -> dict[str, Setting]:
    from mjhcmc.patients.examination import DEFAULTS  # loads the simulation, which a given mapping can do without

    return dict(DEFAULTS)


def _plain(name: str, value: object) -> Setting:
    """A setting as Python's number or string, which JSON writes the same everywhere."""
    if isinstance(value, str):
        return str(value)
    if not is_number(value) or not math.isfinite(value):
        raise SettingsError(f"setting {name!r} must be a finite number or a word; got {value!r}")
    if name in _POSITIVE and value <= 0:
        raise SettingsError(f"{name} must be positive; got {value!r}")
    return int(value) if isinstance(value, (int, np.integer)) else float(value)


def _like(name: str, value: Setting, default: Setting) -> Setting:
    """A setting as the kind that its default has, so that 1 and 1.0 are one configuration."""
    if isinstance(value, str) and not isinstance(default, str):
        try:
            value = _plain(name, float(value))  # as the command line has it
        except ValueError:
            raise SettingsError(f"setting {name!r} must be a number; got {value!r}") from None
    if isinstance(value, str) != isinstance(default, str):
        raise SettingsError(f"setting {name!r} must be a {'word' if isinstance(default, str) else 'number'}: {value!r}")
    if isinstance(default, str) or isinstance(value, str):
        return value
    if isinstance(default, float):
        return float(value)
    if value != int(value):
        raise SettingsError(f"setting {name!r} must be a whole number; got {value!r}")
    return int(value)

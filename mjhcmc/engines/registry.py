"""Which engines there are: those of the paper's Table 1 in its order, then the others."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module

from mjhcmc.engines.base import Engine
from mjhcmc.errors import SettingsError

MODULES = (
    "mujoco",
    "dojo",
    "brax",
    "raisim",
    "drake",
    "dart",
    "bullet",
    "pinocchio",
    "mjx",
    "warp",
    "casadi",
    "opensim",
)


def all_engines() -> tuple[Engine, ...]:
    """Every engine, installed or not; nothing of theirs is imported."""
    return tuple(import_module(f"mjhcmc.engines.{name}").ENGINE for name in MODULES)


def engines_named(keys: Sequence[str]) -> tuple[Engine, ...]:
    """Engines by their keys, in the registry's order, and MuJoCo, which times are read beside; all without keys.

    Raises:
        SettingsError: no such engine.
    """
    known = {engine.key: engine for engine in all_engines()}
    for key in keys:
        if key not in known:
            raise SettingsError(f"no engine {key!r}: the engines are {', '.join(known)}")
    return tuple(engine for engine in known.values() if not keys or engine.key in ("mujoco", *keys))

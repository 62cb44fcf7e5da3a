"""The methods: one signature, one Solution. ``windows`` and ``run`` hold what they share."""

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING

from mjhcmc.errors import SettingsError

if TYPE_CHECKING:
    from mjhcmc.solution import Solution

METHODS = {"hcmc": "hcmc", "cmc": "cmc", "static": "static_optimization"}
"""Function of ``mjhcmc.methods.<function>`` by the name that users give; imported when asked for."""


def find_method(name: str) -> "Callable[..., Solution]":
    """The method of that name.

    Raises:
        SettingsError: an unknown name; the message lists the valid ones.
    """
    if name not in METHODS:
        raise SettingsError(f"unknown method {name!r}: choose one of {', '.join(METHODS)}")
    found: Callable[..., Solution] = getattr(import_module(f"mjhcmc.methods.{METHODS[name]}"), METHODS[name])
    return found

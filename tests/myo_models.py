"""The models of myo-sim, each composed once: that takes most of a second."""

from functools import cache

import pytest


@cache
def myo_model(name: str):
    """An MjModel; it is shared, so do not change it."""
    return pytest.importorskip("myo_sim").load_model(name)

"""What counts as a number among settings that users give."""

from __future__ import annotations

from typing import TypeGuard

import numpy as np


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is one real number, Python's or numpy's. True and False are none; NaN and infinities are."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)

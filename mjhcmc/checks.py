"""What counts as a number, or as an array of them, among what users give."""

from __future__ import annotations

from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value is one real number, Python's or numpy's. True and False are none; NaN and infinities are."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def frozen_array(value: Any, what: str) -> NDArray[np.float64]:
    """A copy as a read-only array of numbers.

    Args:
        value: what a user gave.
        what: it is, for the message.

    Raises:
        MotionError: it is no array of numbers.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise MotionError(f"{what} is not an array of numbers ({error}): give one") from None
    array.setflags(write=False)
    return array

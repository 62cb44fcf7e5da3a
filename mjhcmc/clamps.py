"""Muscles whose force a forcerange clamps: what is left of activation."""

import numpy as np
from numpy.typing import NDArray


def activation_cap(
    force_limit: NDArray[np.float64], gain: NDArray[np.float64], bias: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(..., n_muscle) activation from which on a forcerange lets a muscle pull no more; at least 0.

    Args:
        force_limit: (..., n_muscle) N, inf where there is none.
        gain: (..., n_muscle) N, see `dynamics.MuscleMoments`; so is bias.
        bias: (..., n_muscle) N.
    """
    room = np.maximum(force_limit - bias, 0.0)
    return np.where(gain > 0, room / np.where(gain > 0, gain, 1.0), np.inf)

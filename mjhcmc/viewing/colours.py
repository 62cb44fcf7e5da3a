"""The colour of an activation: from pale blue-grey through orange to deep red, one scale for every picture.

The way leads through OKLab (Ottosson 2020, "A perceptual color space for image processing"), where equal distances look
equally different, at constant speed: a step of .1 looks the same everywhere. Lightness falls all the way, so that the
order is read in grey, and by those who do not tell red from green.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

SILENT, ACTIVE = "#9aafc6", "#a60a24"
"""Activation 0 and 1: both are seen on white and on black."""

UNKNOWN = (0.5, 0.5, 0.5, 0.35)
"""Of an activation that is not a number."""

_STOPS = (SILENT, "#d39068", "#d1482e", ACTIVE)
_ENTRIES = 512  # of the table: finer than eight bits

# linear sRGB to the cube of cone responses, and their cube roots to OKLab (Ottosson 2020)
_CONES = np.array([
    [0.4122214708, 0.5363325363, 0.0514459929],
    [0.2119034982, 0.6806995451, 0.1073969566],
    [0.0883024619, 0.2817188376, 0.6299787005],
])  # fmt: skip
_LAB = np.array([
    [0.2104542553, 0.7936177850, -0.0040720468],
    [1.9779984951, -2.4285922050, 0.4505937099],
    [0.0259040371, 0.7827717662, -0.8086757660],
])  # fmt: skip


def activation_rgba(activation: ArrayLike) -> Array:
    """(..., 4) red, green, blue, alpha in 0 .. 1 (sRGB) of activations (...).

    Args:
        activation: 0 .. 1; what lies outside has the colour of the nearer end, NaN is `UNKNOWN`.
    """
    a = np.asarray(activation, dtype=float)
    known = np.isfinite(a)
    table = _table()
    place = np.clip(np.where(known, a, 0.0), 0.0, 1.0) * (_ENTRIES - 1)
    low = np.minimum(place.astype(int), _ENTRIES - 2)
    part = (place - low)[..., None]
    rgb = (1 - part) * table[low] + part * table[low + 1]
    rgba = np.concatenate([rgb, np.ones((*a.shape, 1))], axis=-1)
    return np.where(known[..., None], rgba, UNKNOWN)


def oklab(rgb: ArrayLike) -> Array:
    """(..., 3) lightness, green to red, blue to yellow, of colours (..., 3) in 0 .. 1 (sRGB)."""
    c = np.asarray(rgb, dtype=float)
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.cbrt(linear @ _CONES.T) @ _LAB.T)


def hex_colour(rgba: ArrayLike) -> str:
    """``#rrggbb`` of one colour, without its alpha."""
    return "#" + "".join(f"{round(255 * float(c)):02x}" for c in np.clip(np.asarray(rgba, dtype=float)[:3], 0, 1))


@cache
def _table() -> Array:
    """(_ENTRIES, 3) colours at equal distances along the way through the stops."""
    stops = oklab([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in _STOPS])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(stops, axis=0), axis=1))])
    way = np.linspace(0.0, length[-1], _ENTRIES)
    lab = np.stack([np.interp(way, length, stops[:, i]) for i in range(3)], axis=-1)
    linear = (lab @ np.linalg.inv(_LAB).T) ** 3 @ np.linalg.inv(_CONES).T
    linear = np.clip(linear, 0.0, 1.0)
    found: Array = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    found.setflags(write=False)
    return found

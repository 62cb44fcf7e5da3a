"""The Modified Ashworth Scale: six ordered grades of resistance to passive movement, and how well two raters agree.

Bohannon & Smith 1987, doi:10.1093/ptj/67.2.206.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mjhcmc.errors import SettingsError

READERS = ("ideal", "rater_a", "rater_b")
"""Who grades: a reader without noise, and two raters."""

GRADES: tuple[str, ...] = ("0", "1", "1+", "2", "3", "4")
"""The scale's grades in their order."""

_NUMBERS = (0.0, 1.0, 1.5, 2.0, 3.0, 4.0)


def rank(grade: str) -> int:
    """Place of a grade in the scale, 0 to 5.

    Raises:
        SettingsError: no grade of the scale.
    """
    if grade not in GRADES:
        raise SettingsError(f"grade {grade!r} is not on the Modified Ashworth Scale: use one of {', '.join(GRADES)}")
    return GRADES.index(grade)


def grade_of(rank: int) -> str:
    """The grade of a place in the scale, 0 to 5.

    Raises:
        SettingsError: no whole number of 0 to 5.
    """
    if isinstance(rank, bool) or not isinstance(rank, int | np.integer) or not 0 <= rank < len(GRADES):
        raise SettingsError(f"rank {rank!r} is not on the Modified Ashworth Scale: use a whole number of 0 to 5")
    return GRADES[int(rank)]


def number(grade: str) -> float:
    """A grade as a number, 1+ being 1.5, as studies that average grades write it.

    Raises:
        SettingsError: no grade of the scale.
    """
    return _NUMBERS[rank(grade)]


def weighted_kappa(first: ArrayLike, second: ArrayLike) -> float:
    """Quadratic-weighted kappa of two raters' ranks: 1 they agree, 0 no better than chance.

    kappa = 1 - mean (a - b)^2 / (var a + var b + (mean a - mean b)^2), which is Cohen's kappa with the weights
    (i - j)^2, since chance alone pairs a and b independently (Cohen 1968, doi:10.1037/h0026256; Fleiss & Cohen 1973,
    doi:10.1177/001316447303300309).

    Args:
        first: (n,) ranks, 0 to 5.
        second: (n,) ranks of the same limbs.

    Returns:
        Kappa; NaN where both gave every limb one and the same grade, which shows nothing.

    Raises:
        SettingsError: lengths that differ, none at all, or numbers that are no ranks.
    """
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if a.ndim != 1 or a.shape != b.shape or not a.size:
        raise SettingsError(f"kappa takes two lists of ranks of one length; got shapes {a.shape} and {b.shape}")
    for values in (a, b):
        if not np.isin(values, np.arange(len(GRADES))).all():
            wrong = values[~np.isin(values, np.arange(len(GRADES)))][0]
            raise SettingsError(f"kappa takes ranks, whole numbers of 0 to 5; got {wrong:g}")
    chance = float(a.var() + b.var() + (a.mean() - b.mean()) ** 2)
    return 1.0 - float(np.mean((a - b) ** 2)) / chance if chance > 0 else float("nan")

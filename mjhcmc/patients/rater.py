"""Raters: the Modified Ashworth grade of a limb from what a hand felt, without and with the scatter between people.

The wording (Bohannon & Smith 1987, doi:10.1093/ptj/67.2.206) names no forces; `Rubric` says which are meant here. A
rater knows nothing of a reflex's gain: the grade comes from a `Resistance` alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.special import ndtri

from mjhcmc.errors import SettingsError
from mjhcmc.patients.grades import rank, weighted_kappa
from mjhcmc.patients.resistance import Resistance

RATER_NOISE = 0.45
"""Scale of all scatter of raters, set so that two of them agree on a cohort about as examiners do: our aim is a
quadratic-weighted kappa within .61 to .87 over all joints (benchmarks/patients.py measures it)."""


@dataclass(frozen=True)
class Rubric:
    """What the words of the scale are taken to mean. Forces in N at the hand, above what is usual; shares of the range.

    All are chosen here: lifting a litre of water takes 10 N, and 100 N are half of what an examiner's arm can do
    (`mjhcmc.patients.examiner.HAND_STRENGTH`).

    Attributes:
        catch: a sudden rise that counts, "slight increase ... manifested by a catch": twice what is just felt.
        trace: share of the range below which an increase is none, "no increase in muscle tone": a few degrees.
        end: last part of the range, "minimal resistance at the end of the range of motion".
        brief: share of the range that resistance which is released may take, "catch and release": at a second for the
            range, a twitch of a quarter of a second takes as much in the middle.
        half: "less than half of the range" (1+) against "most of the range" (2).
        marked: mean force over the range of "more marked increase", when most of the range is affected.
        strong: largest force that is marked wherever it stands.
        considerable: mean force of "considerable increase, passive movement difficult".
        hard: largest force that makes it so, wherever it stands.
        short: share of the range lost that makes it so: a hand that can do no more.
        rigid: share of the range lost of "affected part rigid": less than half of it is left.
    """

    catch: float = 6.0
    trace: float = 0.06
    end: float = 0.25
    brief: float = 0.4
    half: float = 0.5
    marked: float = 8.0
    strong: float = 40.0
    considerable: float = 40.0
    hard: float = 100.0
    short: float = 0.2
    rigid: float = 0.5

    def __post_init__(self) -> None:
        """Check that thresholds rise with the grade.

        Raises:
            SettingsError: a threshold that is not positive, or two out of order.
        """
        for field in fields(self):
            if not getattr(self, field.name) > 0:
                raise SettingsError(f"rubric: {field.name} must be positive; got {getattr(self, field.name)}")
        for low, high in (("trace", "end"), ("end", "brief"), ("brief", "half"), ("short", "rigid")):
            if getattr(self, low) >= getattr(self, high):
                raise SettingsError(f"rubric: {low} must be below {high}; got {getattr(self, low)}")


RUBRIC = Rubric()
"""The one in use."""


def ideal_grade(resistance: Resistance, rubric: Rubric = RUBRIC) -> str:
    """The grade by the wording of the scale, without scatter.

    More resistance, or more of the range affected or lost, never lowers it.

    Args:
        resistance: what was felt.
        rubric: what the words mean.

    Returns:
        One of `mjhcmc.patients.grades.GRADES`.
    """
    hand = resistance.hand.lever_arm
    peak, mean = resistance.peak / hand, resistance.mean / hand
    affected, lost = resistance.range_affected, resistance.range_lost
    caught = resistance.catch and resistance.catch_size / hand >= rubric.catch
    if lost >= rubric.rigid:
        return "4"
    if lost >= rubric.short or mean >= rubric.considerable or peak >= rubric.hard:
        return "3"
    if (affected >= rubric.half and mean >= rubric.marked) or peak >= rubric.strong:
        return "2"
    if affected > (rubric.brief if resistance.released else rubric.end):
        return "1+"
    if caught and not resistance.released and affected > rubric.trace:
        return "1+"
    return "1" if caught or affected > rubric.trace else "0"


@dataclass(frozen=True)
class Rater:
    """One person who grades. All factors are 1, and all scatter 0, in an ideal one.

    Attributes:
        force: resistance seems this much larger to this rater.
        usual: this rater is used to this much more from healthy limbs.
        perception: factor of what this rater just feels.
        extent: shares of the range seem this much larger.
        rubric: this rater's meaning of the words.
        trial_force: log standard deviation of the felt resistance from one trial to the next.
        trial_usual: of what the limb is held against.
        trial_extent: of shares of the range.
    """

    force: float = 1.0
    usual: float = 1.0
    perception: float = 1.0
    extent: float = 1.0
    rubric: Rubric = RUBRIC
    trial_force: float = 0.0
    trial_usual: float = 0.0
    trial_extent: float = 0.0


_FORCE = (0.30, 0.25)
_USUAL = (0.10, 0.08)
_PERCEPTION = 0.30
_EXTENT = (0.15, 0.15)
_THRESHOLD = 0.15
"""Log standard deviations at scale 1: between raters, and from trial to trial. Forces scatter more than angles, which a
rater sees: passive testing speed, on which the reflex hangs, differs by 18 to 29 % between examiners (Banky et al.
2019, doi:10.2340/16501977-2496)."""


def sample_raters(rng: np.random.Generator, n: int, scale: float = RATER_NOISE, rubric: Rubric = RUBRIC) -> list[Rater]:
    """Draw raters.

    Args:
        rng: only its uniform numbers are used.
        n: how many.
        scale: of all scatter; 0: ideal raters.
        rubric: what the words mean in the middle of them.

    Raises:
        SettingsError: fewer than one rater, or a scale below 0.
    """
    if n < 1 or not (np.isfinite(scale) and scale >= 0):
        raise SettingsError(f"raters: n must be 1 or more and scale 0 or more; got {n} and {scale}")
    names = [field.name for field in fields(Rubric)]
    raters = []
    for _ in range(n):
        z = _normal(rng, 4 + len(names))
        widths = np.array([_FORCE[0], _USUAL[0], _PERCEPTION, _EXTENT[0], *[_THRESHOLD] * len(names)])
        force, usual, perception, extent, *shifts = (float(value) for value in np.exp(scale * widths * z))
        moved = {name: getattr(rubric, name) * shift for name, shift in zip(names, shifts, strict=True)}
        mine = _in_order(moved)
        trial = (scale * width for width in (_FORCE[1], _USUAL[1], _EXTENT[1]))
        raters.append(Rater(force, usual, perception, extent, mine, *trial))
    return raters


def rate(resistance: Resistance, rater: Rater, rng: np.random.Generator) -> str:
    """The grade that a rater gives in one trial.

    Args:
        resistance: what there was to feel.
        rater: who grades.
        rng: of this trial; three uniform numbers are drawn.

    Returns:
        One of `mjhcmc.patients.grades.GRADES`.
    """
    force, usual, extent = np.exp(
        np.array([rater.trial_force, rater.trial_usual, rater.trial_extent]) * _normal(rng, 3)
    )
    felt = resistance.felt(
        force=float(rater.force * force), usual=float(rater.usual * usual), perception=rater.perception
    )
    seen = float(rater.extent * extent)
    felt = replace(
        felt, range_affected=min(felt.range_affected * seen, 1.0), range_lost=min(felt.range_lost * seen, 1.0)
    )
    return ideal_grade(felt, rater.rubric)


def inter_rater_kappa(resistances: Sequence[Resistance], rng: np.random.Generator, scale: float = RATER_NOISE) -> float:
    """How well two raters agree: quadratic-weighted kappa, every limb graded by two raters drawn for it.

    Args:
        resistances: the limbs.
        rng: of raters and trials.
        scale: of all scatter.

    Raises:
        SettingsError: no limb.
    """
    ranks = []
    for resistance in resistances:
        pair = sample_raters(rng, 2, scale)
        ranks.append([rank(rate(resistance, rater, rng)) for rater in pair])
    table = np.reshape(ranks, (-1, 2))
    return weighted_kappa(table[:, 0], table[:, 1])


def _normal(rng: np.random.Generator, n: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(n,) standard normal numbers by the inverse of their distribution: the same wherever uniforms are."""
    uniform = np.maximum(rng.random(n), 1e-16)  # 0 would be minus infinity
    normal: np.ndarray[tuple[int], np.dtype[np.float64]] = ndtri(uniform)
    return normal


def _in_order(moved: dict[str, float]) -> Rubric:
    """A rater's thresholds, those that crossed set a little apart."""
    for low, high in (("trace", "end"), ("end", "brief"), ("brief", "half"), ("short", "rigid")):
        moved[high] = max(moved[high], 1.01 * moved[low])
    return Rubric(**moved)

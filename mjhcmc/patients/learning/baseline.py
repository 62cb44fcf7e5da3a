"""Models that grade: majority, one feature, ordinal logistic, gradient boosting; one for each joint.

Each learns on train; what it may choose (feature, penalty, size of trees, how a grade is decided) it chooses by
kappa on validation. No other split is seen before it is scored.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import SettingsError
from mjhcmc.patients.learning.cohort import Cohort
from mjhcmc.patients.learning.ordinal import OrdinalLogistic
from mjhcmc.patients.learning.scores import MISSING, N_GRADE, quadratic_kappa

Array = NDArray[np.float64]
Ranks = NDArray[np.int64]
Predict = Callable[[Array], Ranks]
Split = tuple[Array, Ranks]

PENALTIES = (1.0, 10.0, 100.0, 1000.0)
TREES: tuple[dict[str, Any], ...] = ({"max_iter": 80, "max_leaf_nodes": 4}, {"max_iter": 80, "max_leaf_nodes": 12})
EXTRA = 'pip install "mjhcmc[learn]"'

_CANDIDATES = 8  # single features that are tried on validation
_GRID = 48  # quantiles between which a cut may lie
_FOLDS = 3
_THREADS_FROM = 10_000  # rows; below, threads of the trees wait for each other five times as long as they work
_CLIP = 5.0  # standard deviations: a shifted split must not throw the linear model off


@dataclass(frozen=True, eq=False)
class Predicted:
    """What a model says of every patient of a cohort.

    Attributes:
        name: of the model.
        ranks: (P, J); None where the model cannot run.
        chosen: by joint, what was chosen on validation.
        note: why there are no ranks.
    """

    name: str
    ranks: Ranks | None
    chosen: Mapping[str, Mapping[str, Any]]
    note: str = ""


class Filler:
    """Medians for what is missing, then mean 0 and variance 1, all of training; columns that do not vary are 0."""

    def __init__(self, x: Array) -> None:
        with np.errstate(invalid="ignore"):
            empty = ~np.isfinite(x).any(axis=0)
            self._median = np.where(empty, 0.0, np.nanmedian(np.where(empty, 0.0, x), axis=0))
        filled = self._fill(x)
        self._mean, spread = filled.mean(axis=0), filled.std(axis=0)
        varies = spread > 1e-9 * np.maximum(1.0, np.abs(self._mean))
        self._scale = np.where(varies, 1 / np.where(varies, spread, 1.0), 0.0)

    def __call__(self, x: Array) -> Array:
        """(n, n_feature) without gaps."""
        return np.asarray(np.clip((self._fill(x) - self._mean) * self._scale, -_CLIP, _CLIP))

    def _fill(self, x: Array) -> Array:
        return np.where(np.isfinite(x), x, self._median)


def cut_points(score: ArrayLike, rank: ArrayLike) -> Array:
    """Cuts of a score that give the largest quadratic-weighted kappa with the ranks, by coordinate ascent.

    Args:
        score: (n,), higher for higher ranks.
        rank: (n,) 0..5.

    Returns:
        (5,) rising; the grade is how many of them the score reaches.
    """
    score, rank = np.asarray(score, dtype=np.float64), np.asarray(rank, dtype=np.int64)
    edges = np.unique(np.quantile(score, np.linspace(0, 1, _GRID + 1)[1:-1]))
    bins = np.searchsorted(edges, score, side="right")
    n_bin = len(edges) + 1
    count = np.bincount(bins, minlength=n_bin).astype(np.float64)
    total = np.bincount(bins, rank, n_bin)
    # cut k lies before bin at[k]; at first the shares of the grades are met
    below = np.cumsum(np.bincount(rank, minlength=N_GRADE))[:-1] / len(rank)
    at = np.searchsorted(np.cumsum(count) / len(rank), below - 1e-9) + 1

    def kappa(at: Ranks) -> float:
        given = np.searchsorted(at, np.arange(n_bin), side="right")
        n, a, b = len(rank), rank.mean(), float(given @ count) / len(rank)
        aa, bb, ab = float(rank @ rank) / n, float(given**2 @ count) / n, float(given @ total) / n
        chance = aa + bb - 2 * a * b
        return 1 - (aa + bb - 2 * ab) / chance if chance > 1e-12 else 0.0

    best = kappa(at)
    for _ in range(20):
        before = best
        for k in range(N_GRADE - 1):
            low, high = at[k - 1] if k else 0, at[k + 1] if k + 2 < N_GRADE else n_bin
            for place in range(int(low), int(high) + 1):
                trial = at.copy()
                trial[k] = place
                value = kappa(trial)
                if value > best + 1e-12:
                    best, at = value, trial
        if best <= before:
            break
    padded = np.concatenate([[-np.inf], edges, [np.inf]])
    return np.asarray(padded[at])


def majority(train: Split, validation: Split, names: tuple[str, ...]) -> tuple[Predict, dict[str, Any]]:
    """The most common grade of training."""
    most = int(np.argmax(np.bincount(train[1], minlength=N_GRADE)))
    return lambda x: np.full(len(x), most, dtype=np.int64), {"rank": most}


def one_feature(train: Split, validation: Split, names: tuple[str, ...]) -> tuple[Predict, dict[str, Any]]:
    """Cuts of one feature, of those that follow the grade most closely in training."""
    fill = Filler(train[0])
    x, y = fill(train[0]), train[1]
    follows = rank_correlation(x, y[:, None].astype(np.float64))[:, 0]
    best: tuple[float, Predict, int] | None = None
    for i in np.argsort(-np.abs(follows), kind="stable")[:_CANDIDATES].tolist():
        sign = 1.0 if follows[i] >= 0 else -1.0
        predict = _cut(partial(_one_column, fill, i, sign), cut_points(sign * x[:, i], y))
        kappa = quadratic_kappa(validation[1], predict(validation[0]))
        if best is None or kappa > best[0]:
            best = (kappa, predict, i)
    assert best is not None
    return best[1], {"feature": names[best[2]]}


def _one_column(fill: Filler, i: int, sign: float, x: Array) -> Array:
    return sign * fill(x)[:, i]


def ordinal_logistic(train: Split, validation: Split, names: tuple[str, ...]) -> tuple[Predict, dict[str, Any]]:
    """Proportional odds; the grade is the most likely one, or where cuts of the linear score put it."""
    best: tuple[float, Predict, dict[str, Any]] | None = None
    for penalty in PENALTIES:
        for decision, predict in _ordinal(*train, penalty).items():
            kappa = quadratic_kappa(validation[1], predict(validation[0]))
            if best is None or kappa > best[0]:
                best = (kappa, predict, {"penalty": penalty, "decision": decision})
    assert best is not None
    return best[1], best[2]


def _ordinal(x: Array, y: Ranks, penalty: float) -> dict[str, Predict]:
    """Both ways of deciding, of one fit."""
    fill = Filler(x)
    model = OrdinalLogistic(penalty).fit(fill(x), y)
    cuts = cut_points(model.linear(fill(x)), y)
    return {
        "likeliest": lambda new: model.predict(fill(new)),
        "cuts": lambda new: np.searchsorted(cuts, model.linear(fill(new)), side="right"),
    }


def quick_grades(x: Array, y: Ranks, new: Array) -> Ranks:
    """Grades of new rows by an ordinal logistic without choices: what the search for leaks trains again and again."""
    if len(np.unique(y)) < 2:
        return np.full(len(new), y[0], dtype=np.int64)
    return _ordinal(x, y, 10.0)["cuts"](new)


def boosting(train: Split, validation: Split, names: tuple[str, ...]) -> tuple[Predict, dict[str, Any]]:
    """Boosted trees on the rank (scikit-learn), cut where folds of training agree best; gaps need no filling.

    Raises:
        ImportError: scikit-learn is not installed.
    """
    from sklearn.ensemble import HistGradientBoostingRegressor

    def fit(x: Array, y: Ranks, choice: dict[str, Any]) -> tuple[Any, NDArray[np.bool_]]:
        trees = HistGradientBoostingRegressor(
            learning_rate=0.08, min_samples_leaf=15, early_stopping=False, random_state=0, **choice
        )
        telling = np.array([len(np.unique(column[np.isfinite(column)])) > 1 for column in x.T])
        with _threads(len(y)):  # scikit-learn does not bin a feature of fewer than two values
            return trees.fit(x[:, telling], y.astype(np.float64)), telling

    (x, y), fold = train, np.random.default_rng(0).permutation(len(train[1])) % _FOLDS
    best: tuple[float, Predict, dict[str, Any]] | None = None
    for choice in TREES:
        unseen = np.empty(len(y))  # a tree's own rows would look better told apart than they are
        for k in range(_FOLDS):
            unseen[fold == k] = _score(fit(x[fold != k], y[fold != k], choice), x[fold == k])
        predict = _cut(partial(_score, fit(x, y, choice)), cut_points(unseen, y))
        kappa = quadratic_kappa(validation[1], predict(validation[0]))
        if best is None or kappa > best[0]:
            best = (kappa, predict, dict(choice))
    assert best is not None
    return best[1], best[2]


def _score(fitted: tuple[Any, NDArray[np.bool_]], x: Array) -> Array:
    trees, telling = fitted
    with _threads(len(x)):
        return np.asarray(trees.predict(x[:, telling]))


def _threads(rows: int) -> AbstractContextManager[Any]:
    """How many threads trees may use for so many rows."""
    from threadpoolctl import threadpool_limits  # comes with scikit-learn

    limit: AbstractContextManager[Any] = threadpool_limits(1 if rows < _THREADS_FROM else None, user_api="openmp")
    return limit


def _cut(score: Callable[[Array], Array], cuts: Array) -> Predict:
    return lambda x: np.searchsorted(cuts, score(x), side="right")


MODELS: dict[str, Callable[[Split, Split, tuple[str, ...]], tuple[Predict, dict[str, Any]]]] = {
    "majority": majority,
    "one feature": one_feature,
    "ordinal logistic": ordinal_logistic,
    "gradient boosting": boosting,
}


def grade(name: str, cohort: Cohort, target: str = "rater_a") -> Predicted:
    """Train a model for each joint and let it grade every patient.

    Args:
        name: one of `MODELS`.
        cohort: features and grades.
        target: whose grades are learned.

    Raises:
        SettingsError: no such model.
    """
    if name not in MODELS:
        raise SettingsError(f"model {name!r} is not known: choose one of {', '.join(MODELS)}")
    ranks = np.full((len(cohort.patient), len(cohort.joints)), MISSING, dtype=np.int64)
    chosen: dict[str, dict[str, Any]] = {}
    for j, joint in enumerate(cohort.joints):
        x, y = cohort.features[joint].astype(np.float64), cohort.grades[target][:, j]
        train, validation = (labelled(x, y, cohort.rows(split)) for split in ("train", "validation"))
        try:
            predict, chosen[joint] = MODELS[name](train, validation, cohort.names[joint])
        except ImportError:
            return Predicted(name, None, {}, f"needs scikit-learn: {EXTRA}")
        ranks[:, j] = predict(x)
    return Predicted(name, ranks, chosen)


def labelled(x: Array, y: Ranks, rows: NDArray[np.int64]) -> Split:
    """Those of the rows that have a grade."""
    rows = rows[y[rows] >= 0]
    return x[rows], y[rows]


def rank_correlation(x: Array, y: Array) -> Array:
    """Spearman's correlation of each column of x (n, p) with each of y (n, q): (p, q); 0 where one does not vary."""
    from scipy.stats import rankdata

    def standard(values: Array) -> Array:
        ranks = rankdata(values, axis=0)
        centred = ranks - ranks.mean(axis=0)
        size = np.sqrt((centred**2).sum(axis=0))
        return np.asarray(centred / np.where(size > 0, size, 1.0))

    return np.asarray(standard(x).T @ standard(y))

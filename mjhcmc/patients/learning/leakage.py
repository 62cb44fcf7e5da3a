"""The search for leaks: ways by which a grade could be told without looking at the patient.

Every check can fail by itself and says why. That all of them pass proves nothing; that one fails means that no score
of this dataset may be believed before it is explained.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mjhcmc.patients.learning.baseline import Predicted, labelled, quick_grades, rank_correlation
from mjhcmc.patients.learning.cohort import PROTOCOL, Cohort
from mjhcmc.patients.learning.features import READS, feature_names
from mjhcmc.patients.learning.read import HELD_OUT, READABLE
from mjhcmc.patients.learning.scores import MISSING, Scores, evaluate

Array = NDArray[np.float64]
Ranks = NDArray[np.int64]
Grades = Callable[[Array, Ranks, Array], Ranks]
"""Trains on (x, ranks) and grades new rows: what the permutation check runs."""

DETERMINISTIC = 0.995
"""|Spearman| from which one quantity is as good as the other."""

HIDDEN = ("gain/", "threshold/", "severity")
"""Latent quantities that no observable may give away by itself. Others, such as tone, may show: EMG at rest is tone."""

_MIN_ROWS = 20  # below, ranks agree by chance
_MAX_ROWS = 20_000  # above, more rows tell no more
_PERMUTATIONS = 5
_FOLDS = 5
_SURE = 0.99  # level of the intervals that flag: a sound dataset is flagged once in two hundred
_SLIGHT = 0.05  # kappa that is no matter, however certain


@dataclass(frozen=True)
class Check:
    """One check: what it looked at, whether all is well, and why not."""

    name: str
    passed: bool
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class LeakReport:
    """All checks."""

    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """No check flags anything."""
        return all(check.passed for check in self.checks)


def search_leaks(
    cohort: Cohort,
    target: str = "rater_a",
    predicted: Sequence[Predicted] = (),
    *,
    grades: Grades = quick_grades,
    seed: int = 0,
) -> LeakReport:
    """Run every check.

    Args:
        cohort: what the models saw.
        target: whose grades they learned.
        predicted: what they said.
        grades: how the permutation check trains and grades.
        seed: of permutations and resamples.
    """
    return LeakReport((
        _splits(cohort),
        _duplicates(cohort),
        _columns(cohort),
        _deterministic(cohort),
        _shuffled(cohort, target, grades, seed),
        _protocol(cohort, target, seed),
        _ceiling(cohort, target, predicted),
    ))  # fmt: skip


def _splits(cohort: Cohort) -> Check:
    """No patient in two splits, and each in the folder that its row names."""
    pairs = sorted(set(zip(cohort.patient.tolist(), cohort.split.tolist(), strict=True)))
    patients = [patient for patient, _ in pairs]
    both = sorted({a for a, b in pairwise(patients) if a == b})
    reasons = []
    if both:
        reasons.append(f"{_some(both)} in more than one split")
    if cohort.misplaced:
        reasons.append(f"{_some(cohort.misplaced)} in the folder of another split than their row names")
    return _check("patients in one split", reasons)


def _duplicates(cohort: Cohort) -> Check:
    """No two patients of different splits have the same values: a copy under another number is still a copy."""
    seen: dict[bytes, tuple[int, str]] = {}
    copies = []
    for i in range(len(cohort.patient)):
        rows = [cohort.features[joint][i] for joint in cohort.joints]
        if not all(np.isfinite(row).sum() > 3 for row in rows):
            continue  # nothing was measured: height, mass and sex may agree
        key = hashlib.sha256(b"".join(row.tobytes() for row in rows)).digest()
        patient, split = int(cohort.patient[i]), str(cohort.split[i])
        other = seen.setdefault(key, (patient, split))
        if other[1] != split:
            copies.append(f"{other[0]} ({other[1]}) and {patient} ({split})")
    reasons = [f"patients with identical features across splits: {_listed(copies)}"] if copies else []
    return _check("no copies across splits", reasons)


def _columns(cohort: Cohort) -> Check:
    """Every feature is declared, reads only readable columns, and the observables hold no others."""
    reasons = []
    if cohort.undeclared:
        reasons.append(f"columns of the observables in no list: {_listed(cohort.undeclared)}")
    for joint in cohort.joints:
        more = [name for name in cohort.names[joint] if name not in feature_names(joint)]
        if more or cohort.features[joint].shape[1] != len(cohort.names[joint]):
            reasons.append(f"{joint}: features that are not declared: {_listed(more) or 'without a name'}")
        readable = {name for columns in READABLE.values() for name in columns}
        hidden = sorted({name for columns in READS[joint].values() for name in columns} - readable)
        if hidden:
            reasons.append(f"{joint}: features read columns that an examiner cannot know: {_listed(hidden)}")
    return _check("features from listed columns", reasons)


def _deterministic(cohort: Cohort) -> Check:
    """No feature, and no column of the observables, is as good as a hidden latent quantity or a grade."""
    reasons = []
    # gains of shifted reflexes are in other units, and would hide the order of the rest
    rows = np.flatnonzero(np.isin(cohort.split, HELD_OUT))[:_MAX_ROWS]
    hidden = {name: values for name, values in cohort.latent.items() if name.startswith(HIDDEN)}
    for j, joint in enumerate(cohort.joints):
        seen = dict(zip(cohort.names[joint], cohort.features[joint].T.astype(np.float64), strict=False))
        seen |= {f"column {name}": values[:, j] for name, values in cohort.channels.items()}
        against = {f"latent {name}": values for name, values in hidden.items()}
        for reader, ranks in cohort.grades.items():
            against[f"the grade of {reader}"] = np.where(ranks[:, j] == MISSING, np.nan, ranks[:, j])
        what, other = list(seen), list(against)
        r = _correlations(*(np.column_stack([v[rows] for v in group.values()]) for group in (seen, against)))
        for a, b in np.argwhere(np.abs(r) > DETERMINISTIC).tolist():
            reasons.append(f"{joint}: {what[a]} is as good as {other[b]} (Spearman {r[a, b]:.4f})")
    return _check("nothing hidden shows", reasons)


def _correlations(x: Array, y: Array) -> Array:
    """Spearman of the columns (p, q) over rows where both are known; 0 where these are few, or take two values."""
    result = np.zeros((x.shape[1], y.shape[1]))
    for known_x, a in _alike(x):
        for known_y, b in _alike(y):
            both = known_x & known_y
            if both.sum() >= _MIN_ROWS:
                left, right = x[both][:, a], y[both][:, b]
                several = _many(left)[:, None] & _many(right)[None, :]
                result[np.ix_(a, b)] = np.where(several, rank_correlation(left, right), 0.0)
    return result


def _alike(values: Array) -> list[tuple[NDArray[np.bool_], list[int]]]:
    """Columns that are known in the same rows, which are ranked together: the rows, the columns."""
    groups: dict[bytes, tuple[NDArray[np.bool_], list[int]]] = {}
    for i, known in enumerate(np.isfinite(values).T):
        groups.setdefault(known.tobytes(), (known, []))[1].append(i)
    return list(groups.values())


def _many(values: Array) -> NDArray[np.bool_]:
    """Columns of more than two values: fewer agree by chance."""
    ordered = np.sort(values, axis=0)
    return np.asarray((np.diff(ordered, axis=0) > 0).sum(axis=0) > 1)


def _shuffled(cohort: Cohort, target: str, grades: Grades, seed: int) -> Check:
    """Trained on grades that are shuffled among the patients of train, nothing is known of test."""
    rng = np.random.default_rng([seed, 1])
    train, test = cohort.rows("train"), cohort.rows("test")
    truth = cohort.grades[target]
    found: list[Scores] = []
    for _ in range(_PERMUTATIONS):
        mixed = truth.copy()
        mixed[train] = truth[rng.permutation(train)]
        ranks = np.empty((len(test), len(cohort.joints)), dtype=np.int64)
        for j, joint in enumerate(cohort.joints):
            x = cohort.features[joint].astype(np.float64)
            ranks[:, j] = grades(*labelled(x, mixed[:, j], train), x[test])
        found.append(evaluate(truth[test], ranks, resamples=300, level=_SURE, seed=seed))
    kappa = float(np.mean([scores.kappa.value for scores in found]))
    half = float(np.mean([scores.kappa.high - scores.kappa.low for scores in found])) / 2
    reasons = []
    if kappa > half + _SLIGHT:
        reasons.append(f"trained on shuffled grades, kappa on test is {kappa:.2f}, chance reaches {half + _SLIGHT:.2f}")
    return _check("shuffled grades teach nothing", reasons)


def _protocol(cohort: Cohort, target: str, seed: int) -> Check:
    """A patient's number, and how many trials of what length and rate there are, do not tell the grade."""
    rows = np.flatnonzero(np.isin(cohort.split, HELD_OUT))  # shift splits have their own protocol on purpose
    kept, fold_of = np.unique(cohort.patient[rows], return_inverse=True)
    fold = (np.random.default_rng([seed, 2]).permutation(len(kept)) % _FOLDS)[fold_of]
    index = cohort.patient[rows].astype(np.float64)
    place = 2 * (index - index.min()) / max(np.ptp(index), 1.0) - 1
    # polynomials of the index: a straight line would not see grades that come in blocks
    number = np.column_stack([np.polynomial.legendre.legvander(place, 8)[:, 1:], index % 2])
    how = cohort.protocol[rows]
    truth = cohort.grades[target][rows]
    reasons = []
    for what, tells in (
        ("the patient's index", lambda j: number),
        (f"the protocol ({', '.join(PROTOCOL)}, missing features)", lambda j: _pattern(cohort, how, rows, j)),
    ):
        ranks = np.full(truth.shape, MISSING, dtype=np.int64)
        for j in range(len(cohort.joints)):
            x = tells(j)
            for k in range(_FOLDS):
                learned = labelled(x, truth[:, j], np.flatnonzero(fold != k))
                ranks[fold == k, j] = quick_grades(*learned, x[fold == k])
        kappa = evaluate(truth, ranks, level=_SURE, seed=seed).kappa
        if kappa.low > _SLIGHT:
            reasons.append(f"{what} tells the grade: kappa {kappa.words()} without a look at the signals")
    return _check("index and protocol tell nothing", reasons)


def _pattern(cohort: Cohort, how: Array, rows: NDArray[np.int64], j: int) -> Array:
    """Protocol of a joint, and which kinds of features are missing."""
    missing = ~np.isfinite(cohort.features[cohort.joints[j]][rows])
    kinds = np.unique(missing, axis=1)  # features of one trial are missing together
    return np.column_stack([how[:, j], kinds[:, kinds.any(axis=0)]])


def _ceiling(cohort: Cohort, target: str, predicted: Sequence[Predicted]) -> Check:
    """On test, no model's mean kappa lies above the interval of the raters' agreement.

    What lies above the value, but within the interval, `above_raters` tells: a model that knows the ideal grade may.
    """
    reasons = []
    if target != "ideal":
        test = cohort.rows("test")
        truth = cohort.grades[target][test]
        limit = evaluate(truth, cohort.grades["rater_b"][test]).kappa
        for model in predicted:
            if model.ranks is None:
                continue
            kappa = evaluate(truth, model.ranks[test]).kappa.value
            if kappa > limit.high:
                reasons.append(
                    f"{model.name}: kappa {kappa:.2f} on test lies above that between raters {limit.words()}: "
                    "look for the leak"
                )
    return _check("below the ceiling", reasons)


@dataclass(frozen=True)
class Above:
    """A model's kappa that lies above the agreement of the raters.

    Attributes:
        split: where.
        model: whose.
        joint: which; ``"mean"``: over all joints.
        kappa: of the model with the first rater.
        raters: of the second rater with the first.
        ideal: of the ideal grade with the first rater.
    """

    split: str
    model: str
    joint: str
    kappa: float
    raters: float
    ideal: float


def above_raters(
    scores: Mapping[str, Mapping[str, Scores]], joints: Sequence[str], models: Sequence[str], raters: str, ideal: str
) -> tuple[Above, ...]:
    """Where models agree with a rater better than another rater does: not a leak by itself, but to be explained.

    Args:
        scores: by split and row.
        joints: that are graded.
        models: rows that are models.
        raters: the row of the second rater.
        ideal: the row of the ideal grade.
    """

    def kappas(found: Scores) -> tuple[float, ...]:
        return (found.kappa.value, *found.by_joint)

    return tuple(
        Above(split, model, joint, *values)
        for split, rows in scores.items()
        for model in models
        for joint, *values in zip(
            ("mean", *joints), *(kappas(rows[name]) for name in (model, raters, ideal)), strict=True
        )
        if values[0] > values[1]
    )


def _check(name: str, reasons: Sequence[str]) -> Check:
    return Check(name, not reasons, tuple(reasons))


def _some(patients: Sequence[int]) -> str:
    return f"patient{'s' if len(patients) > 1 else ''} {_listed(patients)}"


def _listed(things: Sequence[object]) -> str:
    """The first five."""
    return ", ".join(map(str, things[:5])) + (f" and {len(things) - 5} more" if len(things) > 5 else "")

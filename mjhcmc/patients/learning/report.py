"""Baselines, the ceiling and the search for leaks of one dataset, as a table, one JSON object and a figure."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjhcmc.errors import SettingsError
from mjhcmc.patients.grades import GRADES
from mjhcmc.patients.learning.baseline import MODELS, Predicted, grade
from mjhcmc.patients.learning.cohort import Cohort, Ranks, check_grades, load_cohort
from mjhcmc.patients.learning.features import READS
from mjhcmc.patients.learning.leakage import Above, LeakReport, above_raters, search_leaks
from mjhcmc.patients.learning.read import open_dataset
from mjhcmc.patients.learning.scores import Scores, confusion, evaluate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

"""The modified Ashworth scale, by rank."""

_RATERS, _IDEAL = "ceiling (rater_b)", "ideal grade"

_METRICS = ("kappa", "macro_f1", "mae", "within_one")
_BELOW_IDEAL = (
    "above the raters' agreement, below the ideal grade's: a model that knows the ideal grade agrees with a rater "
    "better than another rater does; no leak by itself"
)
_ABOVE_IDEAL = (
    "above the raters' agreement and the ideal grade's: by chance, by learning how raters err, or by a leak: look for "
    "the leak"
)
_FEW = 10  # patients of a split, below which its intervals are worth little


@dataclass(frozen=True, eq=False)
class GradeReport:
    """What `grade_dataset` found.

    Attributes:
        folder: of the dataset.
        target: whose grades were learned.
        cohort: patients, features, grades.
        predicted: what each model says.
        scores: by split, by row (models, then readers), agreement with the target.
        leaks: the search for leaks.
    """

    folder: str
    target: str
    cohort: Cohort
    predicted: tuple[Predicted, ...]
    scores: Mapping[str, Mapping[str, Scores]]
    leaks: LeakReport

    def numbers(self) -> dict[str, Any]:
        """For JSON; a score that is not defined is null."""
        counts = {split: {"ok": len(self.cohort.rows(split)), "failed": n} for split, n in self.cohort.failed.items()}
        return {
            "dataset": self.folder,
            "target": self.target,
            "joints": list(self.cohort.joints),
            "patients": counts,
            "scores": {
                split: {name: self._score(scores) for name, scores in rows.items()}
                for split, rows in self.scores.items()
            },
            "chosen": {model.name: {j: dict(c) for j, c in model.chosen.items()} for model in self.predicted},
            "not_run": {model.name: model.note for model in self.predicted if model.ranks is None},
            "confusion": {"grades": list(GRADES)} | {n: m.tolist() for n, m in self.confusions().items()},
            "above_raters": [asdict(above) for above in self.above],
            "never_known": {joint: list(names) for joint, names in self.cohort.never_known.items()},
            "leakage": {
                "passed": self.leaks.passed,
                "checks": [{"name": c.name, "passed": c.passed, "reasons": list(c.reasons)} for c in self.leaks.checks],
            },
        }

    def _score(self, scores: Scores) -> dict[str, Any]:
        found: dict[str, Any] = {"pairs": scores.count}
        for metric in _METRICS:
            values = getattr(scores, metric).numbers()
            found[metric] = {k: v if math.isfinite(v) else None for k, v in values.items()}
        return found | {"kappa_by_joint": dict(zip(self.cohort.joints, scores.by_joint, strict=True))}

    def confusions(self) -> dict[str, Ranks]:
        """On test, by row: counts, rows the target's grades."""
        test = self.cohort.rows("test")
        truth = self.cohort.grades[self.target][test]
        given = {model.name: model.ranks for model in self.predicted if model.ranks is not None}
        return {
            name: confusion(truth, ranks[test]) for name, ranks in (given | _readers(self.cohort, self.target)).items()
        }

    def screen(self) -> str:
        """As Markdown, for a person."""
        lines = [
            f"Grades of {self.target} by {', '.join(self.cohort.joints)}; scores are means over joints with "
            "95 % intervals over patients.",
            "",
            f"train: {self._count('train')}",
        ]
        for joint, names in self.cohort.never_known.items():
            lines.append(
                f"warning: {joint}: missing for every patient of train, no model learns of it: {', '.join(names)}"
            )
        for split, rows in self.scores.items():
            lines += ["", f"{split}: {self._count(split)}", ""]
            table = [["", "kappa", "macro-F1", "MAE (ranks)", "within one", "kappa by joint"]]
            for name, scores in rows.items():
                by_joint = " ".join(f"{round(value, 2) + 0.0:.2f}" for value in scores.by_joint)
                table.append([name, *(getattr(scores, metric).words() for metric in _METRICS), by_joint])
            table += [[m.name, m.note, "", "", "", ""] for m in self.predicted if m.ranks is None]
            lines += _markdown(table)
            lines += self._notes(split)
        lines.append("")
        for check in self.leaks.checks:
            lines.append(f"{'pass' if check.passed else 'FLAG'}  {check.name}")
            lines += [f"      {reason}" for reason in check.reasons]
        lines.append("No leak found." if self.leaks.passed else "Leakage: explain what is flagged before any score.")
        return "\n".join(lines)

    @property
    def above(self) -> tuple[Above, ...]:
        """Where a model agrees with the target better than the second rater does; none where the target is ideal."""
        if self.target == "ideal":
            return ()
        models = [model.name for model in self.predicted if model.ranks is not None]
        return above_raters(self.scores, self.cohort.joints, models, _RATERS, _IDEAL)

    def _notes(self, split: str) -> list[str]:
        """What of a split's table needs to be explained."""
        groups: dict[str, list[str]] = {}
        for above in self.above:
            if above.split == split:
                why = _BELOW_IDEAL if above.kappa <= above.ideal else _ABOVE_IDEAL
                values = f"{above.kappa:.3f}, raters {above.raters:.3f}, ideal {above.ideal:.3f}"
                groups.setdefault(why, []).append(f"{above.model}, {above.joint}: {values}")
        return [line for why, where in groups.items() for line in ("", f"note: {why}", *(f"      {w}" for w in where))]

    def _count(self, split: str) -> str:
        n, failed = len(self.cohort.rows(split)), self.cohort.failed[split]
        left_out = f", {failed} failed and left out" if failed else ""
        return f"{n} patients{left_out}" + (", few: little is certain" if n < _FEW else "")

    def figure(self) -> Figure:
        """Confusion matrices on test."""
        from mjhcmc.plotting.confusion import confusion_figure

        title = f"Grades on held-out patients · {', '.join(self.cohort.joints)}"
        return confusion_figure(
            self.confusions(), GRADES, title=title, truth=f"grade of {self.target.replace('_', ' ')}"
        )


def grade_dataset(
    folder: str | Path,
    *,
    joint: str | None = None,
    target: str = "rater_a",
    progress: Callable[[int, int], None] | None = None,
) -> GradeReport:
    """Train the baselines on a dataset, score them on every other split, and search for leaks.

    Args:
        folder: of the dataset.
        joint: the only one to grade; None: every one.
        target: ``"rater_a"`` or ``"ideal"``.
        progress: called with shards read and shards in all.

    Raises:
        OutputError: no dataset, a table, column or split that is missing or cannot be read.
        SettingsError: an unknown joint or target; too few patients or grades.
    """
    if joint is not None and joint not in READS:
        raise SettingsError(f"joint {joint!r} is not graded: choose one of {', '.join(READS)}")
    if target not in ("rater_a", "ideal"):
        raise SettingsError(f"target {target!r} is not known: choose rater_a or ideal")
    cohort = load_cohort(open_dataset(folder), tuple(READS) if joint is None else (joint,), progress)
    check_grades(cohort, target)
    predicted = tuple(grade(name, cohort, target) for name in MODELS)
    given = {model.name: model.ranks for model in predicted if model.ranks is not None}
    scores: dict[str, dict[str, Scores]] = {}
    for split in cohort.splits:
        rows = cohort.rows(split)
        truth = cohort.grades[target][rows]
        if split == "train" or not (truth >= 0).any(axis=0).all():
            continue
        scores[split] = {n: evaluate(truth, r[rows]) for n, r in (given | _readers(cohort, target)).items()}
    return GradeReport(str(folder), target, cohort, predicted, scores, search_leaks(cohort, target, predicted))


def _readers(cohort: Cohort, target: str) -> dict[str, Ranks]:
    """Who else graded, under the name of the row."""
    if target == "ideal":
        return {"rater_a": cohort.grades["rater_a"], "rater_b": cohort.grades["rater_b"]}
    return {_RATERS: cohort.grades["rater_b"], _IDEAL: cohort.grades["ideal"]}


def _markdown(table: list[list[str]]) -> list[str]:
    """A table whose columns also stand under each other on a screen."""
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    lines = ["| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |" for row in table]
    return [lines[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *lines[1:]]


def grade_command(
    folder: str | Path,
    as_json: bool = False,
    quiet: bool = False,
    *,
    joint: str | None = None,
    target: str = "rater_a",
    out: Path | None = None,
) -> int:
    """What ``mjhcmc patients grade`` does: grade, print, and write.

    Args:
        folder: of the dataset.
        as_json: print one JSON object and nothing else.
        quiet: print nothing.
        joint: as `grade_dataset`.
        target: as `grade_dataset`.
        out: folder for grade.json and the figure; nothing is written without.

    Returns:
        0 where no leak is flagged, else 1.
    """
    from contextlib import ExitStack

    import click
    from tqdm import tqdm

    from mjhcmc.io.files import output_folder

    with ExitStack() as stack:
        written = None if out is None else stack.enter_context(output_folder(out))
        # disable=None hides the bar where standard error is no terminal
        bar = stack.enter_context(tqdm(unit="shard", leave=False, disable=True if quiet or as_json else None))

        def progress(done: int, count: int) -> None:
            bar.total = count
            bar.update(done - bar.n)

        report = grade_dataset(folder, joint=joint, target=target, progress=progress)
        files = [] if written is None else _write(report, written)
    if as_json:
        click.echo(json.dumps({**report.numbers(), "files": files}))
    elif not quiet:
        click.echo(report.screen())
        if files:
            click.echo(f"written  {', '.join(files)}")
    return 0 if report.leaks.passed else 1


def _write(report: GradeReport, folder: Path) -> list[str]:
    """Numbers and figure into a folder; the paths written."""
    from mjhcmc.io.files import written_whole
    from mjhcmc.plotting import save_figure

    path = folder / "grade.json"
    with written_whole(path) as temporary:
        temporary.write_text(json.dumps(report.numbers(), indent=2) + "\n", encoding="utf-8")
    return [str(path), *map(str, save_figure(report.figure(), folder / "confusion"))]

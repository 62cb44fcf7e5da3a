"""The page of validation: what is claimed, whether the tables of the other pages bear it out, which script made them.

    python benchmarks/validation.py [--write [DOCUMENT]]

Nothing is computed anew: tables are read where the other scripts have put them, between their marks, and each claim is
tried row by row. A limit stands here once; the claim's words and its test take it from there. Run it with --write after
any of the other scripts.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite, nan

from _markdown import ROOT, main, marks

Row = dict[str, str]
Test = Callable[..., bool | None]
DOCS = ROOT / "docs"
NOTHING = ("", "-", "–", "—")
"""Cells of which nothing can be asked. Any other cell that is no number fails."""


@dataclass(frozen=True)
class Claim:
    """What is said of a table, and how a row is asked whether it is so.

    Attributes:
        title: of the section.
        words: the claim, without numbers that stand in the table; {0}, {1} are the limits.
        page, script: where the table is, and whose it is.
        table: which one of the script's tables there, from 0.
        has: a column that it must have, so that another table in its place is noticed.
        holds: of a row and the limits, whether the row bears the claim out; None where it says nothing.
        limits: of the claim.
        about: whether a row is of what is claimed. Others are not asked: limits, medians, other quantities.
        silent: why a row that it is about may say nothing; where it is empty none may.
        told: of a row, what its figures leave out.
        shown: whether the table itself is repeated; long ones are not.
    """

    title: str
    words: str
    page: str
    script: str
    table: int
    has: str
    holds: Test
    limits: tuple[float, ...] = ()
    about: Callable[[Row], bool] = lambda row: True
    silent: str = ""
    told: Callable[[Row], str] | None = None
    shown: bool = True


@dataclass(frozen=True)
class Judgement:
    """Names of the rows that bear a claim out, that do not, and that say nothing; what figures leave out."""

    met: list[str]
    missed: list[str]
    unasked: list[str]
    told: list[str]


def number(text: str) -> float:
    """The number that a text is; NaN where it is none."""
    try:
        return float(text.replace("−", "-"))
    except ValueError:
        return nan


def numbers(cell: str) -> list[float]:
    """The numbers of a cell, between slashes; NaN for each part that is none."""
    return [number(part) for part in cell.strip("*").split("/")]


def head(cell: str) -> str:
    """What a cell begins with, before any comma, bracket or unit."""
    return re.split(r"[,(\s]", cell)[0]


def plain(limit: float) -> str:
    """A limit as these pages write it: .9, 2, 1e-9."""
    return re.sub(r"e-0", "e-", f"{limit:g}").removeprefix("0") or "0"


def says(column: str, word: str) -> Test:
    """A row holds where a column begins with a word."""
    return lambda row: row[column].startswith(word)


def below(*columns: str) -> Test:
    """A row holds where every number of columns is at most a limit."""

    def holds(row: Row, limit: float) -> bool | None:
        if all(row[column] in NOTHING for column in columns):
            return None
        return all(isfinite(value) and value <= limit for column in columns for value in numbers(row[column]))

    return holds


def first_within(column: str) -> Test:
    """A row holds where the first number of a column is within two limits, or with one limit at most that."""

    def holds(row: Row, *limits: float) -> bool | None:
        if head(row[column]) in NOTHING:
            return None
        value = number(head(row[column]))
        return isfinite(value) and value <= limits[-1] and (len(limits) == 1 or limits[0] <= value)

    return holds


def correlates(column: str) -> Test:
    """A row holds where its correlation, before any comma, is at least the limit."""

    def holds(row: Row, least: float) -> bool | None:
        return first_within(column)(row, least, 1.0)

    return holds


def reached(*columns: str) -> Test:
    """A row holds where its cells that name what was to be reached say that it was, and columns hold finite numbers."""

    def holds(row: Row) -> bool:
        aims = [cell for cell in row.values() if "reached" in cell]
        finite = all(isfinite(value) for column in columns for value in numbers(row[column].removesuffix(" (reached)")))
        return bool(aims) and all("(reached)" in cell for cell in aims) and finite

    return holds


def engines_agree(row: Row, double: float, single: float) -> bool | None:
    """All of an engine's differences are within the limit of its precision."""
    columns = [f"{model} {what}" for model in ("leg8", "oblique") for what in ("M", "bias", "tau")]
    return below(*columns)(row, single if row["computes in"] == "float32" else double)


def as_exact(row: Row, times: float, rounding: float) -> bool:
    """MuJoCo's error is no more than so many times that of the same steps with 60 digits, or rounding."""
    ours, exact = number(row["MuJoCo RK4"]), number(row["RK4, 60 digits"])
    return isfinite(ours) and isfinite(exact) and ours <= max(times * exact, rounding)


def reserves_over(share: float) -> str:
    """The column of the models' table that tells of reserves above a share of their joint's peak moment, in percent."""
    return f"largest reserve (share of the joint's peak moment over {plain(share)} %)"


def no_reserve(row: Row, share: float) -> bool:
    """A model's row tells of no reserve."""
    return row[reserves_over(share)] == "none"


def of_a_muscle(row: Row) -> bool:
    """Not the median of the muscles."""
    return "median" not in row["muscle"]


HARDLY = "one of the two signals hardly moves, so that a correlation would say nothing: [how](opensim.md)"
STEP = "largest disagreement (windows left out), step 1e-05"
QUANTILE = "90 %"
SHARE = 0.1
LEFT_OUT = "rows left out: OpenSim's tendon pushes"
PEAK_SHARE = "root mean square, % of the peak"

CLAIMS = (
    Claim("Tracking", "The muscle-driven leg follows the paper's movement and the slow one as closely as was set.",
          "accuracy", "accuracy.py", 0, "hip max", reached("hip max", "knee max", "ankle max"),
          about=lambda row: row[""].startswith("to reach")),
    Claim("Reserves and replay", "Muscles alone carry the movement, and excitations replay in a plain simulation: the "
          "verdict holds.", "accuracy", "accuracy.py", 1, "verdict", says("verdict", "holds")),
    Claim("Coming back", "Without reserves, muscles bring the leg back from starts off the motion within the cycles "
          "allowed.", "accuracy", "recovery.py", 0, "within 2", says("within 2", "yes"), shown=False),
    Claim("Activations beside OpenSim's CMC, slow", "With leg8's MuJoCo muscles, activations correlate above {0} with "
          "those of OpenSim's CMC on the model that leg8 is built from.", "opensim", "opensim_agreement.py", 2,
          "OpenSim peak", correlates("HCMC r"), (0.9,), of_a_muscle, HARDLY),
    Claim("The Hill model beside OpenSim's tables", "Tendon forces of the NumPy Hill model are those of OpenSim's "
          "muscles.", "hill", "hill.py", 0, "largest difference of tendon force, F0",
          reached("largest difference of tendon force, F0"),
          told=lambda row: f"{row['']}, {row[LEFT_OUT]} of {row['rows']} rows, where OpenSim's tendon pushes"
          if row[LEFT_OUT] != "0" else ""),
    Claim("Tracking on Hill muscles", "HCMC follows on Hill muscles with compliant and rigid tendons as closely as was "
          "set.", "hill", "hill.py", 1, "OpenSim 4.6 CMC, the same muscles", reached("HCMC")),
    Claim("Activations beside OpenSim's CMC on Hill muscles, slow", "With OpenSim's own muscle model and compliant "
          "tendons, activations correlate above {0} with those of its CMC.", "hill", "hill.py", 6, "OpenSim's peak",
          correlates("compliant, HCMC: r, RMS"), (0.9,), of_a_muscle, HARDLY),
    Claim("A measured walk", "The subject's leg follows the measured walk without reserves that matter.",
          "walking", "walk.py", 0, "peak moment, N m", says("verdict", "holds"),
          about=lambda row: "to reach" not in row["leg, control window"]),
    Claim("Net joint moments of the walk", "They are those of OpenSim's inverse dynamics, within what was set.",
          "walking", "walk.py", 1, "reached", says("reached", "yes"),
          about=lambda row: "knee, " in row[PEAK_SHARE] and "to reach" not in row[PEAK_SHARE]),
    Claim("Activations of the walk", "With OpenSim's muscle model and the cost that its CMC has, activations correlate "
          "above {0} with those of its CMC.", "walking", "walk.py", 3, "capacity: r", correlates("capacity: r"), (0.9,),
          of_a_muscle),
    Claim("Other engines", "Mass matrix, bias and inverse dynamics of the leg agree with MuJoCo's in every engine, "
          "within {0} ({1} in single precision).", "engines", "engines.py", 0, "oblique tau", engines_agree,
          (1e-9, 1e-4)),
    Claim("Integration", "MuJoCo's RK4 is off by no more than {0} times what the same steps with 60 digits are, or by "
          "rounding ({1} deg).", "precision", "precision.py", 0, "RK4, 60 digits", as_exact, (1.1, 1e-11)),
    Claim("Derivatives of a window", "MJX and the closed forms with stages in C, which share no derivative, agree to "
          "{0}.", "mjx", "mjx.py", 0, "of activation", below("of position", "of velocity", "of activation"), (1e-8,)),
    Claim("Gradients of whole movements", "The gradient agrees with central differences to {0} where these keep the "
          "active set.", "gradients", "gradients.py", 0, "parameter of 8 muscles", first_within(STEP), (1e-4,)),
    Claim("Calibration", "Strengths of simulated patients are found to {0} % from clean excitations.",
          "gradients", "gradients.py", 2, "clean: largest error, %", below("clean: largest error, %"), (1,)),
    Claim("Reflex gains read back", "Where a reflex shows, its gain is read back to {0} % in " + QUANTILE + " of the "
          "stretches.", "patients", "patients.py", 2, "gain off, %: median", below(QUANTILE), (1,),
          told=lambda row: f"{row['law']}, {row['no reflex to see']} of {row['stretches']} stretches that show no "
          f"reflex, {row['not identifiable']} whose gain cannot be told"),
    Claim("Simulated raters", "Two simulated raters agree as their scatter was set for, at each joint: kappa is {0} to "
          "{1}. The range is the project's own aim; no measurement stands behind it here.",
          "patients", "patients.py", 4, "kappa of two raters", first_within("kappa of two raters"), (0.61, 0.87)),
    Claim("The leg's dynamics", "leg8's inverse dynamics are within {0} % of those of the model it is built from.",
          "leg8", "leg8_agreement.py", 6, "worst error", first_within("worst error"), (2,),
          lambda row: row[""].startswith("inverse dynamics")),
    Claim("Models of others, with reserves", "Models of myo-sim are followed to {0} deg, from one joint to a whole "
          "body. Reserves are on and may be what carries a joint: the next claim.", "models", "myo.py", 0,
          "largest error, deg", first_within("largest error, deg"), (0.01,), shown=False),
    Claim("Models of others, by muscles alone", "The same models need no reserve over {0} % of its joint's peak "
          "moment. Why some do stands there.", "models", "myo.py", 0, reserves_over(SHARE), no_reserve, (SHARE,)),
)  # fmt: skip


def table_of(claim: Claim) -> str:
    """The claim's table as it stands on its page.

    Raises:
        SystemExit: it is not there any more, or another one is in its place.
    """
    text = (DOCS / f"{claim.page}.md").read_text(encoding="utf-8")
    begin, end = marks(claim.script)
    tables = re.findall(r"(?:^\|.*\n)+", text.partition(begin)[2].partition(end)[0], re.MULTILINE)
    if claim.table >= len(tables) or claim.has not in cells(tables[claim.table].splitlines()[0]):
        raise SystemExit(
            f"{claim.title}: table {claim.table} of {claim.script} in docs/{claim.page}.md has no {claim.has!r}"
        )
    return tables[claim.table].rstrip("\n")


def cells(line: str) -> list[str]:
    """The cells of a row."""
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def judged(claim: Claim, table: str) -> Judgement:
    """The answers of a table's rows.

    Raises:
        SystemExit: no row says anything about the claim, or one of those that must says nothing.
    """
    lines = table.splitlines()
    header = cells(lines[0])
    rows = [(cells(line)[0].replace("*", ""), dict(zip(header, cells(line), strict=True))) for line in lines[2:]]
    asked = [(name, row, claim.holds(row, *claim.limits)) for name, row in rows if claim.about(row)]
    named = {answer: [name for name, _, one in asked if one is answer] for answer in (True, False, None)}
    if len(named[None]) == len(asked):
        raise SystemExit(f"{claim.title}: no row of its table says anything about it")
    if named[None] and not claim.silent:
        raise SystemExit(f"{claim.title}: these rows say nothing, and no reason is given: {', '.join(named[None])}")
    told = [claim.told(row) for _, row, _ in asked] if claim.told else []
    return Judgement(named[True], named[False], named[None], [one for one in told if one])


def section(claim: Claim, found: Judgement, table: str) -> str:
    """What is claimed, whether it holds, what was not asked, and the table."""
    asked = len(found.met) + len(found.missed)
    parts = [claim.words.format(*map(plain, claim.limits))]
    parts += [
        f"**Does not hold** for {', '.join(found.missed)}." if found.missed else f"**Holds** in all {asked} rows."
    ]
    parts += [f"Not asked: {', '.join(found.unasked)}, where {claim.silent}."] if found.unasked else []
    parts += [f"Left out: {'; '.join(found.told)}."] if found.told else []
    parts += [f"From [{claim.page}]({claim.page}.md), by `benchmarks/{claim.script}`."]
    return "\n\n".join([f"### {claim.title}", " ".join(parts), *([table] if claim.shown else [])])


def markdown() -> str:
    """A summary, and a section for each claim."""
    summary = ["| claim | rows asked | not asked | holds in | page | script |", "|---|---:|---:|---:|---|---|"]
    sections = []
    for claim in CLAIMS:
        table = table_of(claim)
        found = judged(claim, table)
        asked = len(found.met) + len(found.missed)
        held = f"**{len(found.met)}**" if found.missed else "all"
        summary.append(
            f"| {claim.title} | {asked} | {len(found.unasked)} | {held} | [{claim.page}]({claim.page}.md) "
            f"| `benchmarks/{claim.script}` |"
        )
        sections.append(section(claim, found, table))
    return "\n\n".join(["\n".join(summary), *sections])


if __name__ == "__main__":
    main("validation.py", "The page of validation, from the tables of the others.", markdown,
         document=DOCS / "validation.md")  # fmt: skip

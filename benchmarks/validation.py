"""The page of validation: what is claimed, whether the tables of the other pages bear it out, which script made them.

    python benchmarks/validation.py [--write [DOCUMENT]]

Nothing is computed anew and no number is typed: tables are read where the other scripts have put them, between their
marks, and each claim is tried row by row. Run it with --write after any of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from _markdown import ROOT, main, marks

Row = dict[str, str]
DOCS = ROOT / "docs"
_NUMBER = re.compile(r"[-−]?\d[\d,]*\.?\d*(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Claim:
    """What is said of a table, and how a row is asked whether it is so.

    Attributes:
        title: of the section.
        words: the claim, without numbers that stand in the table.
        page, script: where the table is, and whose it is.
        table: which one of the script's tables there, from 0.
        has: a column that it must have, so that another table in its place is noticed.
        holds: whether a row bears the claim out; None where the row says nothing about it.
        shown: whether the table itself is repeated; long ones are not.
    """

    title: str
    words: str
    page: str
    script: str
    table: int
    has: str
    holds: Callable[[Row], bool | None]
    shown: bool = True


def numbers(cell: str) -> list[float]:
    """The numbers in a cell."""
    return [float(found.replace(",", "").replace("−", "-")) for found in _NUMBER.findall(cell)]


def says(column: str, word: str) -> Callable[[Row], bool | None]:
    """A row holds where a column begins with a word; where that is empty the row is not asked."""
    return lambda row: row[column].startswith(word) if row[column] else None


def below(limit: float, *columns: str) -> Callable[[Row], bool | None]:
    """A row holds where the numbers of columns are at most a limit; where there are none it is not asked."""

    def holds(row: Row) -> bool | None:
        found = [value for column in columns for value in numbers(row[column])]
        return max(found) <= limit if found else None

    return holds


def reached(row: Row) -> bool | None:
    """Rows and cells that name what was to be reached say whether it was."""
    aims = [cell for cell in row.values() if "reached" in cell]
    return all("(reached)" in cell for cell in aims) if aims else None


def correlates(column: str, least: float) -> Callable[[Row], bool | None]:
    """A row of a muscle holds where its correlation, before any comma, is at least so much."""

    def holds(row: Row) -> bool | None:
        found = numbers(row[column].partition(",")[0])
        return found[0] >= least if found and "median" not in row["muscle"] else None

    return holds


CLAIMS = (
    Claim("Tracking", "The muscle-driven leg follows the paper's movement and the slow one as closely as was set.",
          "accuracy", "accuracy.py", 0, "hip max", reached),
    Claim("Reserves and replay", "Muscles alone carry the movement, and excitations replay in a plain simulation: the "
          "verdict holds.", "accuracy", "accuracy.py", 1, "verdict", says("verdict", "holds")),
    Claim("Coming back", "Without reserves, muscles bring the leg back from starts off the motion within the cycles "
          "allowed.", "accuracy", "recovery.py", 0, "within 2", says("within 2", "yes"), shown=False),
    Claim("Activations beside OpenSim's CMC, slow", "With leg8's MuJoCo muscles, activations correlate above .9 with "
          "those of OpenSim's CMC on the model that leg8 is built from.", "opensim", "opensim_agreement.py", 2,
          "OpenSim peak", correlates("HCMC r", 0.9)),
    Claim("The Hill model beside OpenSim's tables", "Tendon forces of the NumPy Hill model are those of OpenSim's "
          "muscles.", "hill", "hill.py", 0, "largest difference of tendon force, F0", reached),
    Claim("Tracking on Hill muscles", "HCMC follows on Hill muscles with compliant and rigid tendons as closely as was "
          "set.", "hill", "hill.py", 1, "OpenSim 4.6 CMC, the same muscles", reached),
    Claim("Activations beside OpenSim's CMC on Hill muscles, slow", "With OpenSim's own muscle model and compliant "
          "tendons, activations correlate above .9 with those of its CMC.", "hill", "hill.py", 6, "OpenSim's peak",
          correlates("compliant, HCMC: r, RMS", 0.9)),
    Claim("A measured walk", "The subject's leg follows the measured walk without reserves that matter.",
          "walking", "walk.py", 0, "peak moment, N m", says("verdict", "holds")),
    Claim("Net joint moments of the walk", "They are those of OpenSim's inverse dynamics, within what was set.",
          "walking", "walk.py", 1, "reached", says("reached", "yes")),
    Claim("Activations of the walk", "With OpenSim's muscle model and the cost that its CMC has, activations correlate "
          "above .9 with those of its CMC.", "walking", "walk.py", 3, "capacity: r", correlates("capacity: r", 0.9)),
    Claim("Other engines", "Mass matrix, bias and inverse dynamics of the leg agree with MuJoCo's in every engine, "
          "within 1e-9 (1e-4 in single precision).", "engines", "engines.py", 0, "oblique tau", says("", "agrees")),
    Claim("Integration", "MuJoCo's RK4 is off by no more than the same steps with 60 digits, to a tenth, or by "
          "rounding (1e-11 deg).", "precision", "precision.py", 0, "RK4, 60 digits",
          lambda row: numbers(row["MuJoCo RK4"])[0] <= max(1.1 * numbers(row["RK4, 60 digits"])[0], 1e-11)),
    Claim("Derivatives of a window", "MJX and the closed forms with stages in C, which share no derivative, agree to "
          "1e-8.", "mjx", "mjx.py", 0, "of activation", below(1e-8, "of position", "of velocity", "of activation")),
    Claim("Gradients of whole movements", "The gradient agrees with central differences to 1e-4 where these keep the "
          "active set.", "gradients", "gradients.py", 0, "parameter of 8 muscles",
          lambda row: numbers(row["largest disagreement (windows left out), step 1e-05"])[0] <= 1e-4),
    Claim("Calibration", "Strengths of simulated patients are found to 1 % from clean excitations.",
          "gradients", "gradients.py", 2, "clean: largest error, %", below(1, "clean: largest error, %")),
    Claim("Reflex gains read back", "The gains of simulated reflexes are read back to 1 % in nine cases of ten.",
          "patients", "patients.py", 2, "gain off, %: median", below(1, "90 %")),
    Claim("Simulated raters", "Two raters agree about as two examiners do who know their scale: kappa is above .7.",
          "patients", "patients.py", 4, "kappa of two raters",
          lambda row: numbers(row["kappa of two raters"])[0] > 0.7),
    Claim("The leg's dynamics", "leg8's inverse dynamics are within 2 % of those of the model it is built from.",
          "leg8", "leg8_agreement.py", 6, "worst error",
          lambda row: numbers(row["worst error"])[0] <= 2 if row[""].startswith("inverse dynamics") else None),
    Claim("Models of others", "Models of myo-sim are followed to a hundredth of a degree, from one joint to a whole "
          "body.", "models", "myo.py", 0, "largest error, deg",
          lambda row: numbers(row["largest error, deg"])[0] <= 0.01, shown=False),
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


def judged(claim: Claim, table: str) -> tuple[list[str], int]:
    """Rows that do not bear a claim out, and how many were asked.

    Raises:
        SystemExit: no row says anything about it.
    """
    lines = table.splitlines()
    header = cells(lines[0])
    rows = [cells(line) for line in lines[2:]]
    answers = [(row[0], claim.holds(dict(zip(header, row, strict=True)))) for row in rows]
    asked = [(name, answer) for name, answer in answers if answer is not None]
    if not asked:
        raise SystemExit(f"{claim.title}: no row of its table says anything about it")
    return [name.replace("*", "") for name, answer in asked if not answer], len(asked)


def markdown() -> str:
    """A summary, and a section for each claim."""
    summary = ["| claim | rows | holds in | page | script |", "|---|---:|---:|---|---|"]
    sections = []
    for claim in CLAIMS:
        table = table_of(claim)
        misses, asked = judged(claim, table)
        page, script = f"[{claim.page}]({claim.page}.md)", f"`benchmarks/{claim.script}`"
        held = "all" if not misses else f"**{asked - len(misses)}**"
        summary.append(f"| {claim.title} | {asked} | {held} | {page} | {script} |")
        verdict = f"**Holds** in all {asked} rows." if not misses else f"**Does not hold** for {', '.join(misses)}."
        parts = [f"### {claim.title}", f"{claim.words} {verdict} From {page}, by {script}."]
        sections.append("\n\n".join([*parts, table] if claim.shown else parts))
    return "\n\n".join(["\n".join(summary), *sections])


if __name__ == "__main__":
    main("validation.py", "The page of validation, from the tables of the others.", markdown,
         document=DOCS / "validation.md")  # fmt: skip

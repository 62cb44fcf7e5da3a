"""How the leg comes back from a wrong start with reserves switched off, as Markdown.

    python benchmarks/recovery.py [--write [DOCUMENT]]

--write replaces the table in docs/accuracy.md (or DOCUMENT). Each ratio is the largest tracking error over the nodes
after the allowed cycles, over the largest nominal error (right start, no reserves) over the nodes after the first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from _markdown import JOINTS, digits, grid, main
from numpy.typing import NDArray

import mjhcmc
from mjhcmc.motion import COSINE_PERIODS

DT = 0.005
LIMIT = 2.0
ALLOWED = {("slow", 1): 1, ("slow", 5): 1, ("fast", 1): 1, ("fast", 5): 2}
"""Cycles allowed, by movement and degrees of offset."""

RESTING_ACTIVATION = 0.01
_SUBSETS = {"all joints": (1, 1, 1), "hip": (1, 0, 0), "knee": (0, 1, 0), "ankle": (0, 0, 1)}


@dataclass(frozen=True)
class Case:
    """One movement with a right start, to compare wrong ones with."""

    movement: str
    model: mjhcmc.MuscleModel
    motion: mjhcmc.Motion
    nominal: NDArray[np.float64]

    def solve(self, **start: Any) -> mjhcmc.Solution:
        """From another start, muscles alone."""
        return mjhcmc.hcmc(self.model, self.motion, dt=DT, reserves=False, **start)

    def after(self, solution: mjhcmc.Solution, cycles: int) -> NDArray[np.float64]:
        """(nv,) rad, the largest error over the nodes from the end of these cycles on."""
        nodes = solution.time >= cycles * COSINE_PERIODS[self.movement] - 1e-9
        return np.asarray(np.abs(solution.tracking_error[nodes]).max(axis=0))

    def ratios(self, solution: mjhcmc.Solution, cycles: int) -> NDArray[np.float64]:
        """(nv,) the largest error after these cycles over the nominal one."""
        return self.after(solution, cycles) / self.nominal


def prepare(movement: str) -> Case:
    model = mjhcmc.MuscleModel.load("leg8")
    motion = mjhcmc.Motion.cosine(model, movement)
    case = Case(movement, model, motion, np.ones(model.nv))
    return Case(movement, model, motion, case.after(case.solve(), 1))


def markdown() -> str:
    cases = {movement: prepare(movement) for movement in ("slow", "fast")}
    header = ("movement", "start", "where", "cycles allowed", *(f"{joint} ratio" for joint in JOINTS), "within 2")
    rows = [row for case in cases.values() for row in rows_of(case)]
    nominal = "; ".join(
        f"{movement} {'/'.join(digits(v) for v in np.rad2deg(case.nominal))}" for movement, case in cases.items()
    )
    missed = sum(row[-1] != "yes" for row in rows)
    verdict = "every case is within twice the nominal error" if not missed else f"{missed} cases are not"
    summary = f"Nominal max error after the first cycle, {'/'.join(JOINTS)}, deg: {nominal}."
    return f"{summary} Of {len(rows)} starts, {verdict}.\n\n{grid(header, rows)}"


def rows_of(case: Case) -> list[tuple[str, ...]]:
    rows = []
    rest = case.motion.sample(case.motion.start).qpos[0]
    for (movement, degrees), cycles in ALLOWED.items():
        if movement != case.movement:
            continue
        for where, joints in _SUBSETS.items():
            for sign, symbol in ((1, "+"), (-1, "−")):
                offset = sign * np.deg2rad(degrees) * np.array(joints)
                solution = case.solve(initial_qpos=rest + offset)
                rows.append(row(case, f"{symbol}{degrees} deg", where, solution, cycles))
    solution = case.solve(initial_activation=RESTING_ACTIVATION)
    rows.append(row(case, f"activation {RESTING_ACTIVATION:g}", "all muscles", solution, 1))
    return rows


def row(case: Case, start: str, where: str, solution: mjhcmc.Solution, cycles: int) -> tuple[str, ...]:
    ratios = case.ratios(solution, cycles)
    met = "yes" if (ratios <= LIMIT).all() else "NO"
    return (case.movement, start, where, str(cycles), *(f"{ratio:.2f}" for ratio in ratios), met)


if __name__ == "__main__":
    main("recovery.py", "How the leg comes back from a wrong start without reserves.", markdown)

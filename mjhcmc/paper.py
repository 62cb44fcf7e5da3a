"""What the paper reports, to set results beside it.

"Integrator for Musculoskeletal Simulation in Python" (2024), doi 10.17979/ja-cea.2024.45.10802: Table 2 and the text.
Its movement is `fast` at dt .01, on its own leg of 3 joints and 8 muscles.
"""

from __future__ import annotations

from dataclasses import dataclass

JOINTS = ("hip", "knee", "ankle")
"""Of its leg, and of leg8."""

MOVEMENT, DT = "fast", 0.01
"""The movement and control window (s) of its Table 2."""


@dataclass(frozen=True)
class PaperResult:
    """One method's row of Table 2.

    Attributes:
        max_error_deg: largest tracking error, hip, knee, ankle, deg.
        rmse_deg: RMSE, deg. The paper's formula for it is the mean square without a root; its numbers are roots.
        solve_time_s: s, in Python.
    """

    max_error_deg: tuple[float, float, float]
    rmse_deg: tuple[float, float, float]
    solve_time_s: float


PAPER = {
    "hcmc": PaperResult((0.0537, 0.0880, 0.2305), (0.0104, 0.01503, 0.0375), 4.85),
    "cmc": PaperResult((1.6756, 2.8159, 10.4), (0.7147, 1.2252, 5.6407), 4.6),
}
"""Table 2 and the times in the text, by method."""

HARD_MUSCLES = ("rect_fem", "gastroc", "iliopsoas")
"""Muscles that, by the paper, need an excitation above .5 at some time."""

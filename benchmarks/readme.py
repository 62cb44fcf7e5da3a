"""The README's table: the paper's errors and ours on the paper's movement, as Markdown.

    python benchmarks/readme.py [--write [DOCUMENT]]

--write replaces the table in README.md (or DOCUMENT).
"""

from __future__ import annotations

from _markdown import JOINTS, ROOT, digits, grid, main

import mjhcmc
from mjhcmc.paper import PAPER
from mjhcmc.summary import numbers


def markdown() -> str:
    """Max error and RMSE of the fast movement at dt 10 ms, and the ratios."""
    model = mjhcmc.MuscleModel.load("leg8")
    values = numbers(mjhcmc.hcmc(model, mjhcmc.Motion.cosine(model, "fast"), dt=0.01))
    paper = [*PAPER["hcmc"].max_error_deg, *PAPER["hcmc"].rmse_deg]
    ours = [*(values["max_error_deg"][j] for j in JOINTS), *(values["rmse_deg"][j] for j in JOINTS)]
    header = ("tracking error, deg", *(f"{j} max" for j in JOINTS), *(f"{j} RMSE" for j in JOINTS))
    rows = [
        ("HCMC, as the paper reports it", *(f"{value:g}" for value in paper)),
        ("**mjhcmc**", *(f"**{digits(value, 2)}**" for value in ours)),
        ("times smaller", *(digits(p / o, 2) for p, o in zip(paper, ours, strict=True))),
    ]
    return grid(header, rows)


if __name__ == "__main__":
    main("readme.py", "The README's table.", markdown, document=ROOT / "README.md")

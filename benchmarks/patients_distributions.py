"""What virtual patients are drawn from, as a table."""

from __future__ import annotations

from _markdown import ROOT, main

from mjhcmc.patients.distributions import distributions_table

if __name__ == "__main__":
    main(
        "patients_distributions.py",
        "What virtual patients are drawn from.",
        lambda: distributions_table().strip(),
        document=ROOT / "docs" / "patients.md",
    )

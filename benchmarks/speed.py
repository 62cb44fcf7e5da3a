"""How fast: solves against MuJoCo alone, QP solvers, many at once, sizes, cold start, OpenSim; as Markdown.

    python benchmarks/speed.py [--write] [--runs N] [--quick] [--only PART ...] [--opensim-python PATH]

--write replaces the tables in docs/speed.md and the one in README.md; it wants all parts. Everything is timed in turns
with what it is compared with; compare ratios, not milliseconds, and leave the machine alone while it runs (about 8
minutes; --quick takes one, for a look).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import _speed_cold
import _speed_many
import _speed_one
import _speed_opensim
import _speed_qp
import _speed_share
from _markdown import ROOT, into
from _speed_summary import summary
from _timing import machine

import mjhcmc
from mjhcmc.io.files import written_whole

SCRIPT = "speed.py"
DOCUMENTS = {"details": ROOT / "docs" / "speed.md", "summary": ROOT / "README.md"}

TITLES = {
    "methods": "One movement, by method",
    "windows": "One movement, by control window",
    "share": "Where the time goes",
    "many": "Many movements at once",
    "memory": "Memory of many movements",
    "sizes": "Larger models",
    "qp": "QP solvers against each other",
    "opensim": "OpenSim on the same movement",
    "cold": "Cold start",
}
_MANY = ("many", "memory")


def measure(parts: list[str], options: argparse.Namespace) -> tuple[dict[str, str], dict[str, Any]]:
    """Table by part, and what some of them hold."""
    runs, quick = options.runs, options.quick
    opensim = _speed_opensim.find_python(options.opensim_python)
    calls: dict[str, Callable[[], Any]] = {
        "methods": lambda: _speed_one.methods(runs),
        "windows": lambda: _speed_one.windows(max(2, runs // 2)),
        "share": lambda: _speed_share.table(3, quick),
        "many": lambda: _speed_many.rates(runs, quick),
        "memory": lambda: _speed_many.memory(quick),
        "sizes": lambda: _speed_one.sizes(max(2, runs // 2), quick),
        "qp": lambda: _speed_qp.table(max(3, runs // 2), quick),
        "opensim": lambda: _speed_opensim.compare(opensim, 3, quick),
        "cold": lambda: _speed_cold.cold(1 if quick else 3),
    }
    tables, values = {}, {}
    for part in parts:
        began = time.perf_counter()
        result = calls[part]()
        tables[part], values[part] = result if isinstance(result, tuple) else (result, None)
        print(f"{section(part, tables[part])}\n", flush=True)
        print(f"({part}: {time.perf_counter() - began:.0f} s)", file=sys.stderr, flush=True)
    return tables, values


def main() -> None:
    parser = argparse.ArgumentParser(prog=SCRIPT, description="How fast mjhcmc is, beside what it could be.")
    parser.add_argument("--write", action="store_true", help="put the tables into docs/speed.md and README.md")
    parser.add_argument("--runs", type=int, default=9, help="timed calls of the cheap cases; dear ones take fewer")
    parser.add_argument("--quick", action="store_true", help="few and small cases, to see that all of it runs")
    parser.add_argument("--only", nargs="+", choices=list(TITLES), metavar="PART", help=f"of {', '.join(TITLES)}")
    parser.add_argument("--opensim-python", type=Path, help="an interpreter that has opensim; this one by default")
    options = parser.parse_args()
    if options.quick:
        options.runs = min(options.runs, 3)
    if options.runs < 2:
        parser.error("--runs must be at least 2")
    if options.write:
        if options.only or options.quick:
            parser.error("--write wants all parts in full: leave out --only and --quick")
        for path in DOCUMENTS.values():
            into(path.read_text(encoding="utf-8"), SCRIPT, "")  # refuse before the work begins
    parts = [part for part in options.only or TITLES if hasattr(mjhcmc, "hcmc_batch") or part not in _MANY]
    where = f"{machine()} Medians, with the quartiles of the readings in brackets."
    print(f"{where}\n", flush=True)
    tables, values = measure(parts, options)
    if options.only:
        return
    text = summary(values, where)
    print(text)
    if options.write:
        details = "\n\n".join([where, *(section(part, table) for part, table in tables.items())])
        write({"details": details, "summary": text})


def section(part: str, table: str) -> str:
    """A part under its title."""
    return f"### {TITLES[part]}\n\n{table}"


def write(texts: dict[str, str]) -> None:
    """Put each text between the script's marks in its document."""
    for name, path in DOCUMENTS.items():
        whole = into(path.read_text(encoding="utf-8"), SCRIPT, texts[name])
        with written_whole(path) as temporary:
            temporary.write_text(whole, encoding="utf-8")


if __name__ == "__main__":
    main()

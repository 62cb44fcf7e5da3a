"""Rigid-body engines beside MuJoCo, each in an environment of its own, as Markdown.

    python benchmarks/engines.py [--write [DOCUMENT]] [--envs DIR] [--only NAME ...] [--states N]

Some engines do not get along with each other or with this project's MuJoCo, so each one gets a virtual environment:
this project without its dependencies, what `mjhcmc engines` needs of them, and the engine. There `mjhcmc engines --json
--only NAME` runs. --envs keeps the environments for the next time; --write replaces the tables in docs/engines.md (or
DOCUMENT).
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from _markdown import ROOT, grid, into
from _timing import processor

from mjhcmc.engines.base import Engine
from mjhcmc.engines.registry import engines_named
from mjhcmc.io.files import written_whole

SCRIPT = "engines.py"
NEEDED = ("mujoco", "numpy", "click")  # of the project's dependencies; the rest of it does not run there
PATIENCE = 3600  # s, for an installation or a comparison
QUANTITIES = {"mass_matrix": "M", "bias": "bias", "inverse_dynamics": "tau"}

Row = dict[str, Any]


def rows_of(engines: tuple[Engine, ...], folder: Path, states: int) -> dict[str, Row]:
    """What each engine's environment says of it, by key; MuJoCo's own row is from the first that ran."""
    rows: dict[str, Row] = {}
    for engine in engines:
        if engine.key == "mujoco":
            continue
        print(f"{engine.title} ...", file=sys.stderr, flush=True)
        found = _row(engine, folder, states)
        rows[engine.key] = found[engine.key]
        if "mujoco" in found:
            rows.setdefault("mujoco", found["mujoco"])
    return {engine.key: rows[engine.key] for engine in engines if engine.key in rows}


def _row(engine: Engine, folder: Path, states: int) -> dict[str, Row]:
    """The rows of an engine and of MuJoCo beside it."""
    about = {key: getattr(engine, key) for key in ("key", "title", "precision", "integrator", "reads", "install")}
    none: Row = about | {"status": "not installed", "reason": engine.missing, "version": "", "legs": {}}
    if engine.load is None:
        return {engine.key: none}
    python = folder / engine.key / "bin" / "python"
    if not python.exists():
        venv.create(folder / engine.key, with_pip=True)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = [line for line in project["dependencies"] if re.match(r"[\w-]+", line)[0] in NEEDED]
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    for command in ([*pip, *needed, engine.requirement], [*pip, "--no-deps", "--force-reinstall", str(ROOT)]):
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
        if done.returncode:
            return {engine.key: none | {"reason": f"pip: {_last(done.stderr)}"}}
    command = [str(python), "-m", "mjhcmc", "engines", "--json", "--only", engine.key, "--states", str(states)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, cwd=folder)
        found = json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        return {engine.key: none | {"status": "failed", "reason": f"no answer within {PATIENCE} s"}}
    except ValueError:  # it took the process down with it
        return {engine.key: none | {"status": "failed", "reason": f"exit code {done.returncode}: {_last(done.stderr)}"}}
    rows = {row["key"]: row for row in found["engines"]}
    rows[engine.key]["mujoco_call_us"] = {name: result["call_us"] for name, result in rows["mujoco"]["legs"].items()}
    return rows


def _last(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:200] if lines else "no message"


def markdown(rows: dict[str, Row], states: int) -> str:
    """Agreement, then times and the forward second, then who is not there."""
    ran = [row for row in rows.values() if row["legs"]]
    others = [row for row in rows.values() if not row["legs"]]
    legs = list(ran[0]["legs"]) if ran else []
    agreement = [
        (
            row["title"], row["version"], row["precision"], row["reads"],
            *(_small(row["legs"][leg]["difference"][key], 1) for leg in legs for key in QUANTITIES), row["status"],
        )
        for row in ran
    ]  # fmt: skip
    header = (
        "engine",
        "version",
        "computes in",
        "from",
        *(f"{leg} {q}" for leg in legs for q in QUANTITIES.values()),
        "",
    )
    forward = [
        (
            row["title"], row["integrator"],
            *(_small(row["legs"][leg]["forward_error_deg"], 2) for leg in legs), _order(row),
            _span(row, "step_us"), _span(row, "call_us"), _ratio(row),
        )
        for row in ran
    ]  # fmt: skip
    head = (
        "engine", "integrator", *(f"{leg}, error over 1 s, deg" for leg in legs), "order", "a step, us",
        "inverse dynamics, us", "times MuJoCo's",
    )  # fmt: skip
    wrong = [
        f"- {row['title']} {row['status']}: {row['reason']}" for row in rows.values() if row["reason"] and row["legs"]
    ]
    absent = [f"- {row['title']} {row['status']}: {row['reason']}" for row in others]
    gpu = "with a" if shutil.which("nvidia-smi") else "without a"
    parts = [
        f"{states} random states a leg. Largest difference from MuJoCo over the largest value:",
        grid(header, agreement), *wrong, "A torque-driven second in steps of 1 ms, and times:", grid(head, forward),
        f"Measured on {processor()}, {gpu} GPU, Python {sys.version.split()[0]}. Compare ratios, not microseconds.",
        "\n".join(absent),
    ]  # fmt: skip
    return "\n\n".join(part for part in parts if part)


def _small(value: float | None, digits: int) -> str:
    return "not finite" if value is None else f"{value:.{digits}e}"


def _order(row: Row) -> str:
    orders = [leg["forward_order"] for leg in row["legs"].values()]
    return "–" if None in orders else f"{min(orders):.2f}"


def _span(row: Row, key: str) -> str:
    values = [leg[key] for leg in row["legs"].values()]
    return " to ".join(dict.fromkeys(f"{value:.3g}" for value in (min(values), max(values))))


def _ratio(row: Row) -> str:
    beside = row.get("mujoco_call_us")
    if not beside:
        return "1"
    return f"{max(leg['call_us'] / beside[name] for name, leg in row['legs'].items()):.2g}"


@contextmanager
def _folder(kept: Path | None) -> Iterator[Path]:
    if kept is not None:
        kept.mkdir(parents=True, exist_ok=True)
        yield kept.resolve()
        return
    with tempfile.TemporaryDirectory() as made:
        yield Path(made)


def main() -> None:
    parser = argparse.ArgumentParser(prog=SCRIPT, description="Engines beside MuJoCo, each in its own environment.")
    document = ROOT / "docs" / "engines.md"
    parser.add_argument(
        "--write", type=Path, nargs="?", const=document, metavar="DOCUMENT", help="put the tables there"
    )
    parser.add_argument("--envs", type=Path, metavar="DIR", help="keep the environments here, and use them again")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="some engines (their keys)")
    parser.add_argument("--states", type=int, default=100, metavar="N", help="random states a leg")
    given = parser.parse_args()
    if given.write:
        into(given.write.read_text(encoding="utf-8"), SCRIPT, "")  # refuse before the work begins
    with _folder(given.envs) as folder:
        rows = rows_of(engines_named(given.only), folder, given.states)
    tables = markdown(rows, given.states)
    print(tables)
    if given.write:
        text = into(given.write.read_text(encoding="utf-8"), SCRIPT, tables)
        with written_whole(given.write) as temporary:
            temporary.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

"""A cold start: fresh processes with an empty folder for Numba's compiled code, then with that folder filled."""

from __future__ import annotations

import json
import tempfile
from functools import partial

from _markdown import grid
from _timing import fresh_python, read, spread

IMPORT = "import mjhcmc"
FIRST_SOLVE = """
import json, time
began = time.perf_counter()
import mjhcmc
model = mjhcmc.MuscleModel.load("leg8")
motion = mjhcmc.Motion.cosine(model, "fast")
mjhcmc.hcmc  # imported when first asked for
loaded = time.perf_counter()
mjhcmc.hcmc(model, motion)
first = time.perf_counter()
mjhcmc.hcmc(model, motion)
print(json.dumps([loaded - began, first - loaded, time.perf_counter() - first]))
"""
PARTS = ("import, load model and motion", "first `hcmc` (fast, dt 10 ms)", "second `hcmc`")
COMMANDS = {
    "`python -c 'import mjhcmc'`, whole process": ["-c", IMPORT],
    "`mjhcmc --help`, whole process": ["-m", "mjhcmc", "--help"],
    "`mjhcmc reproduce`, whole process, all methods, figures": ["-m", "mjhcmc", "reproduce", "--out", "{folder}"],
}


def cold(runs: int) -> str:
    """The table, s."""
    rows: dict[str, tuple[list[float], list[float]]] = {}

    def note(name: str, filled: int, seconds: float) -> None:
        rows.setdefault(name, ([], []))[filled].append(seconds)

    for _ in range(runs):
        with tempfile.TemporaryDirectory() as cache:
            for filled in (0, 1):
                times = json.loads(fresh_python(["-c", FIRST_SOLVE], NUMBA_CACHE_DIR=cache))
                for name, seconds in zip(PARTS, times, strict=True):
                    note(name, filled, seconds)
        for name, arguments in COMMANDS.items():
            with tempfile.TemporaryDirectory() as cache, tempfile.TemporaryDirectory() as folder:
                given = [argument.format(folder=folder) for argument in arguments]
                for filled in (0, 1):
                    note(name, filled, read(partial(fresh_python, given, NUMBA_CACHE_DIR=cache)).wall)
    return grid(
        ("s", "Numba's folder empty", "filled"),
        ((name, spread(empty), spread(filled)) for name, (empty, filled) in rows.items()),
    )

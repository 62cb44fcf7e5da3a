"""The README's table of speed: ours beside the paper's time and OpenSim's."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median
from typing import Any

from _markdown import grid
from _speed_many import Rate, best
from _speed_opensim import Compared
from _timing import figure, spread, walls

from mjhcmc.paper import PAPER

OPENSIM_CPU_SECONDS = 42
"""CPU s of OpenSim's CMC, from the plan of this project; which movement and machine it does not say."""

_TENDONS = {"OpenSim CMC": ", elastic tendons"}

Row = tuple[str, str, str, str]


def summary(values: dict[str, Any], where: str) -> str:
    """The table and what it was measured on, from what the parts of the benchmark hold."""
    rows = [*_one(values["methods"]), *_many(values.get("many") or []), *_opensim(values.get("opensim")), *_others()]
    header = ("solved, dt 10 ms", "seconds", "× bare stepping", "where")
    return f"{grid(header, rows)}\n\n*Here*: {where}"


def _one(found: dict[tuple[str, str, float], Any]) -> list[Row]:
    rows = []
    for movement, what in (("fast", ".6 s, 60 windows"), ("slow", "1.8 s, 180 windows")):
        one = found["HCMC", movement, 0.01]
        rows.append((f"**`mjhcmc.hcmc`**, {movement} ({what})", spread(one.wall), spread(one.ratio), "here"))
    return rows


def _many(found: Sequence[Rate]) -> list[Row]:
    rows = []
    for count in sorted({case.count for case in found} - {1}):
        case = best(found, count)
        assert case is not None
        rows.append(
            (
                f"**`mjhcmc.hcmc_batch`**, {count} movements of {case.windows} windows at once, "
                f"{case.threads} thread{'s' if case.threads > 1 else ''}, each",
                f"{figure(1 / median(case.rate))} ({figure(median(case.rate))} movements/s)",
                figure(1 / median(case.share)),
                "here",
            )
        )
    return rows


def _opensim(found: Compared | None) -> list[Row]:
    if found is None:
        return []
    return [
        (
            f"{name.replace('OpenSim', 'OpenSim 4.6')}, {movement}, leg8's source model{_TENDONS.get(name, '')}",
            f"{spread(walls(readings))}; CPU {spread([reading.cpu for reading in readings])}",
            "",
            "here, same run",
        )
        for (name, movement), readings in found.readings.items()
        if name.startswith("OpenSim")
    ]


def _others() -> list[Row]:
    """Times that others report, on machines of theirs."""
    paper = figure(PAPER["hcmc"].solve_time_s)
    return [
        (
            "the paper's HCMC in Python, its leg of 3 joints and 8 muscles, the movement of `fast`",
            paper,
            "",
            "as reported, another machine",
        ),
        (
            "OpenSim's CMC, when this project was planned; the movement was not noted",
            f"CPU {OPENSIM_CPU_SECONDS}",
            "",
            "as noted, another machine",
        ),
    ]

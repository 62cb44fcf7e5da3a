"""OpenSim's own CMC on leg8's source model, with compliant and with rigid tendons, beside HCMC, as Markdown.

    python benchmarks/opensim_cmc.py [--write [DOCUMENT]]

Runs OpenSim: needs its Python package (opensim 4.6) in the same environment, and its model of the leg
(shared/reference/leg8) beside the checkout. Takes two minutes. --write replaces the tables in docs/opensim.md.
"""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
from _markdown import ROOT, digits, grid, main
from _opensim_tools import cmc_tool
from opensim_agreement import (
    FLOOR,
    MOVEMENTS,
    Agreement,
    compare,
    correlation,
    model,
    reference,
    solve,
    summary,
    tracking_error,
)

from mjhcmc.io.opensim import read_table
from mjhcmc.opensim_reference import OpenSimRun, find_reference
from mjhcmc.sharing import COSTS

TENDONS = ("compliant", "rigid")


@cache
def run(movement: str, tendon: str) -> OpenSimRun:
    """OpenSim's CMC."""
    import opensim

    found = find_reference()
    source = found.parent / "leg8" if found else ROOT / "absent"
    if not (source / "leg8.osim").is_file():
        raise SystemExit("OpenSim's model of the leg (shared/reference/leg8) is not beside this checkout")
    opensim.Logger.setLevelString("error")
    with cmc_tool(source, movement, tendon) as (tool, folder):
        if not tool.run():
            raise SystemExit(f"OpenSim's CMC failed on {movement} with {tendon} tendons")
        with warnings.catch_warnings(action="ignore"):  # CMC damages the header of its own states file
            table = read_table(folder / "cmc_states.sto")
    columns = dict(zip(table.columns, table.values.T, strict=True))
    names = model().opensim
    return OpenSimRun(
        time=table.time,
        activation=np.column_stack([columns[f"/forceset/{names.muscles[m]}/activation"] for m in model().muscle_names]),
        muscle_names=model().muscle_names,
        qpos=np.column_stack([columns[f"{names.paths[joint]}/value"] for joint in model().joint_names]),
    )


def between(one: OpenSimRun, other: OpenSimRun) -> list[Agreement]:
    """Of two results of OpenSim, on the first's times; peaks: the second's, the first's."""
    result = []
    kept = one.time >= 0.03
    for i in range(len(one.muscle_names)):
        a, b = one.activation[kept, i], np.interp(one.time[kept], other.time, other.activation[:, i])
        r = np.nan if min(a.max(), b.max()) - FLOOR["cmc"] < 0.02 else float(np.corrcoef(a, b)[0, 1])
        result.append(Agreement(b.max(), a.max(), float(np.sqrt(np.mean((a - b) ** 2))), r))
    return result


def markdown() -> str:
    sections = ["### OpenSim's runs\n\n" + runs()]
    for movement in MOVEMENTS:
        sections.append(f"### HCMC and OpenSim's CMC, by tendon, {movement}\n\n" + tendons(movement))
    sections.append("### HCMC by cost, against OpenSim's CMC with rigid tendons\n\n" + costs())
    return "\n\n".join(sections)


def runs() -> str:
    """Errors of the runs, and of the stored one, and how far a run is from the stored one of the same settings."""

    def errors(one: OpenSimRun, movement: str) -> str:
        return "/".join(map(digits, np.abs(tracking_error(one, movement)).max(axis=0)))

    rows = []
    for movement in MOVEMENTS:
        stored = reference(movement, "cmc")
        rows.append((f"{movement}, compliant tendons, stored run", errors(stored, movement), *"   "))
        for tendon in TENDONS:
            found = run(movement, tendon)
            apart = summary(between(found, stored)) if tendon == "compliant" else "   "
            rows.append((f"{movement}, {tendon} tendons, run anew", errors(found, movement), *apart))
    header = ("", "max error hip/knee/ankle, deg", "r with the stored run", "median RMS", "largest RMS")
    return grid(header, rows)


def tendons(movement: str) -> str:
    ours = solve("hcmc", movement, min_activation=FLOOR["cmc"])
    found = {tendon: run(movement, tendon) for tendon in TENDONS}
    columns = {
        **{f"HCMC and {tendon}": compare(ours, one, FLOOR["cmc"]) for tendon, one in found.items()},
        "rigid and compliant": between(found["rigid"], found["compliant"]),
    }
    peaks = [one.activation[one.time >= 0.03].max(axis=0) for one in found.values()]
    rows = [
        (
            name,
            *(f"{peak[i]:.2f}" for peak in peaks),
            f"{columns['HCMC and rigid'][i].ours:.2f}",
            *(c for pair in columns.values() for c in (correlation(pair[i].r), f"{pair[i].rms:.3f}")),
        )
        for i, name in enumerate(model().muscle_names)
    ]
    rows.append(("**median**", *"   ", *(c for pair in columns.values() for c in summary(pair)[:2])))
    header = (
        "muscle",
        *(f"{t} peak" for t in TENDONS),
        "HCMC peak",
        *(f"{c} {w}" for c in columns for w in ("r", "RMS")),
    )
    return grid(header, rows)


def costs() -> str:
    rows = []
    for cost in COSTS:
        cells = (
            cell
            for movement in MOVEMENTS
            for cell in summary(
                compare(
                    solve("hcmc", movement, min_activation=FLOOR["cmc"], cost=cost),
                    run(movement, "rigid"),
                    FLOOR["cmc"],
                )
            )
        )
        rows.append((cost, *cells))
    columns = ("median r", "median RMS", "largest RMS")
    return grid(("cost", *(f"{movement}: {column}" for movement in MOVEMENTS for column in columns)), rows)


if __name__ == "__main__":
    main(
        "opensim_cmc.py",
        "OpenSim's CMC with compliant and rigid tendons, beside HCMC.",
        markdown,
        document=ROOT / "docs" / "opensim.md",
    )

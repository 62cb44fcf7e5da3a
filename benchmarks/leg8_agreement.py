"""How leg8 compares with gait10dof18musc, as Markdown; with --write the tables go into docs/leg8.md.

    python benchmarks/leg8_agreement.py [--reference tests/data] [--write docs/leg8.md]

The folder of reference tables holds leg8_paths.csv, leg8_dynamics.csv and millard_rigid_tendon.csv.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from mjhcmc.leg8 import JOINTS, MUSCLES, build_leg8, load_table
from mjhcmc.leg8.agreement import (
    FIT_RANGE_DEG,
    dynamics_agreement,
    force_agreement,
    knee_deviation,
    path_agreement,
    read_dynamics,
    read_paths,
)
from mjhcmc.leg8.builder import fiber_mapping
from mjhcmc.leg8.fit_curves import fit_curves

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = "<!-- tables: benchmarks/leg8_agreement.py -->", "<!-- end of tables -->"


def markdown(reference: Path) -> str:
    """All the tables, in the order of the document."""
    table = load_table()
    source, fitted = table["source"], table["fitted"]
    return "\n\n".join(
        [
            "### Bodies\n\n" + bodies(source),
            "### Muscles\n\n" + muscles(source, fitted),
            "### Paths\n\n" + paths(source, fitted),
            "### Wrapping cylinders\n\n" + wraps(fitted),
            "### Curves\n\n" + curves(source, fitted),
            "### Agreement: moment arms and lengths\n\n" + arms(table, reference),
            "### Agreement: dynamics and the knee\n\n" + dynamics(table, reference),
            "### Agreement: muscle force\n\n" + forces(table, reference),
        ]
    )


def grid(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    header = list(header)
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join([*lines, *("| " + " | ".join(str(cell) for cell in row) + " |" for row in rows)])


def vector(values: Iterable[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def bodies(source: dict[str, Any]) -> str:
    owner = {"pelvis": "pelvis", "femur": "thigh", "tibia": "shank"}
    return grid(
        ("source body", "body of leg8", "mass, kg", "centre of mass, m", "Ixx, Iyy, Izz about it, kg m²"),
        (
            (name, owner.get(name, "foot"), f"{body['mass']:g}", vector(body["com"]), vector(body["inertia"]))
            for name, body in source["bodies"].items()
        ),
    )


def muscles(source: dict[str, Any], fitted: dict[str, Any]) -> str:
    rows = []
    for name in MUSCLES:
        own = source["muscles"][name]
        unit, force, velocity = fiber_mapping(own)
        rows.append(
            (
                name,
                f"{own['max_isometric_force']:g}",
                f"{own['optimal_fiber_length'] * 1e3:g}",
                f"{own['tendon_slack_length'] * 1e3:g}",
                f"{math.degrees(own['pennation_angle']):.0f}",
                f"{force:.0f}",
                f"{unit * 1e3:.2f}",
                f"{fitted['curves']['vmax'] * velocity:.3f}",
                f"{fitted['slack_offset'][name] * 1e3:.2f}",
            )
        )
    header = ("F0, N", "lopt, mm", "lslack, mm", "pennation, deg")
    derived = ("→ force, N", "→ L0, mm", "→ vmax, L0/s", "fitted slack shift, mm")
    return grid(("muscle", *header, *derived), rows)


def paths(source: dict[str, Any], fitted: dict[str, Any]) -> str:
    rows = []
    for name in MUSCLES:
        given = {point["name"][-2:]: point for point in source["muscles"][name]["path"]}
        for point in fitted["paths"][name]:
            if "wrap" in point:
                rows.append((name, "over", "femur", point["wrap"], "fitted"))
                continue
            own = given[point["name"]]
            same = own.get("pos") == point["pos"]
            credit = f"source, {own['name']}" if same else f"fitted, for {own['name']}"
            if same and own["kind"] == "conditional":
                credit += f", there only within {vector(np.round(np.degrees(own['active_range'])))} deg"
            rows.append((name, point["name"], point["body"], vector(point["pos"]), credit))
    return grid(("muscle", "point", "source body", "position, m", "from"), rows)


def wraps(fitted: dict[str, Any]) -> str:
    return grid(
        ("cylinder", "in", "axis at (x, y), m", "radius, mm"),
        (
            (name, wrap["body"], vector(wrap["pos"][:2]), f"{wrap['radius'] * 1e3:.1f}")
            for name, wrap in fitted["wraps"].items()
        ),
    )


def curves(source: dict[str, Any], fitted: dict[str, Any]) -> str:
    own = fitted["curves"]
    residual = fit_curves(source).residual
    return grid(
        ("Millard curve", "MuJoCo's parameters", "residual RMS, F0"),
        (
            (
                "active force-length",
                f"lmin {own['lmin']:g}, lmax {own['lmax']:g}",
                f"{residual['active_force_length']:.3f}",
            ),
            ("passive force-length", f"fpmax {own['fpmax']:g}", f"{residual['passive_force_length']:.3f}"),
            (
                "force-velocity",
                f"vmax {own['vmax']:g}/cos²α, fvmax {own['fvmax']:g}",
                f"{residual['force_velocity']:.3f}",
            ),
        ),
    )


def arms(table: dict[str, Any], reference: Path) -> str:
    model = build_leg8(table=table).compile()
    grid_points = read_paths(reference / "leg8_paths.csv")
    offset = np.array([table["fitted"]["slack_offset"][name] for name in MUSCLES])
    inside = path_agreement(model, grid_points.within(FIT_RANGE_DEG), offset)
    everywhere = path_agreement(model, grid_points, offset)
    rows = []
    for i, muscle in enumerate(MUSCLES):
        for j, joint in enumerate(JOINTS):
            if np.abs(grid_points.arm[:, i, j]).max() < 1e-9:
                continue
            errors = (inside.worst_arm[i, j], inside.rms_arm[i, j], everywhere.worst_arm[i, j])
            lengths = (inside.worst_length[i], everywhere.worst_length[i])
            rows.append((muscle, joint, *(f"{value * 1e3:.2f}" for value in (*errors, *lengths))))
    return grid(
        (
            "muscle",
            "joint",
            "moment arm worst, mm",
            "rms, mm",
            "worst, whole table, mm",
            "length worst, mm",
            "whole table, mm",
        ),
        rows,
    )


def dynamics(table: dict[str, Any], reference: Path) -> str:
    model = build_leg8(table=table).compile()
    states = read_dynamics(reference / "leg8_dynamics.csv")
    torque, mass_matrix = dynamics_agreement(model, states)
    peaks = np.abs(states.mass_matrix).max(axis=0)
    whole = (mass_matrix * peaks).max() / peaks.max()
    rows = [(f"inverse dynamics, {joint}", f"{torque[i] * 100:.2f} %") for i, joint in enumerate(JOINTS)]
    rows.append(("mass matrix, over the matrix's peak", f"{whole * 100:.2f} %"))
    for i, first in enumerate(JOINTS):
        for j, second in list(enumerate(JOINTS))[i:]:
            rows.append((f"mass matrix, {first}-{second}, over its own peak", f"{mass_matrix[i, j] * 100:.2f} %"))
    for low in (-60, -120):
        worst = knee_deviation(table, np.radians(np.linspace(low, 10, 131))).max()
        rows.append((f"shank from where the sliding knee puts it, knee {low}..10 deg", f"{worst * 1e3:.1f} mm"))
    return grid(("", "worst error"), rows)


def forces(table: dict[str, Any], reference: Path) -> str:
    model = build_leg8(table=table).compile()
    rms = force_agreement(model, table, reference / "millard_rigid_tendon.csv")
    return grid(
        ("muscle", "RMS difference, F0"), ((name, f"{value:.3f}") for name, value in zip(MUSCLES, rms, strict=True))
    )


def into(document: str, tables: str) -> str:
    """The document with its tables replaced."""
    head, rest = document.split(BEGIN)
    return f"{head}{BEGIN}\n\n{tables}\n\n{END}{rest.split(END)[1]}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--reference", type=Path, default=ROOT / "tests" / "data", help="folder of reference tables")
    parser.add_argument("--write", type=Path, help="document whose tables are replaced")
    options = parser.parse_args()
    tables = markdown(options.reference)
    print(tables)
    if options.write:
        options.write.write_text(into(options.write.read_text(encoding="utf-8"), tables), encoding="utf-8")


if __name__ == "__main__":
    main()

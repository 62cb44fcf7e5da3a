"""``python -m mjhcmc.leg8.fit paths|curves``: compute again the fitted numbers of the table, and print what is left.

With ``--write`` the table takes the new numbers; then ``python -m mjhcmc.leg8`` writes the model anew.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from mjhcmc.errors import MjhcmcError
from mjhcmc.leg8.agreement import FIT_RANGE_DEG, dynamics_agreement, path_agreement, read_dynamics, read_paths
from mjhcmc.leg8.builder import build_leg8
from mjhcmc.leg8.fit_curves import fit_curves
from mjhcmc.leg8.fit_paths import fit_paths
from mjhcmc.leg8.table import JOINTS, MUSCLES, load_table, save_table


def main(arguments: list[str] | None = None) -> int:
    """Run a fit; returns the exit code, 2 on bad input."""
    parser = argparse.ArgumentParser(prog="python -m mjhcmc.leg8.fit", description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    paths = commands.add_parser("paths", help="knee hinge, wrapping cylinders, sites, slack offsets")
    paths.add_argument("--reference", type=Path, required=True, help="leg8_paths.csv: lengths and moment arms")
    paths.add_argument("--dynamics", type=Path, help="leg8_dynamics.csv (beside the other)")
    curves = commands.add_parser("curves", help="MuJoCo's muscle curves to the Millard curves")
    for command in (paths, curves):
        command.add_argument("--write", action="store_true", help="put the result into the table")
    options = parser.parse_args(arguments)
    try:
        if options.command == "curves":
            _curves(options.write)
        else:
            dynamics = options.dynamics or options.reference.with_name("leg8_dynamics.csv")
            _paths(options.reference, dynamics, options.write)
    except MjhcmcError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _curves(write: bool) -> None:
    table = load_table()
    fit = fit_curves(table["source"])
    print("| parameter | value |\n|---|---|")
    for name, value in fit.parameters().items():
        print(f"| {name} | {value:g} |")
    print("\n| curve | residual RMS, F0 |\n|---|---|")
    for name, value in fit.residual.items():
        print(f"| {name.replace('_', '-')} | {value:.4f} |")
    if write:
        table["fitted"]["curves"] = fit.parameters()
        save_table(table)


def _paths(reference: Path, dynamics: Path, write: bool) -> None:
    paths, states = read_paths(reference), read_dynamics(dynamics)
    table = fit_paths(load_table(), paths, states)
    model = build_leg8(table=table).compile()
    fitted = table["fitted"]
    offset = np.array([fitted["slack_offset"][name] for name in MUSCLES])
    print(f"knee axis in the femur, m: {fitted['knee_axis']}")
    for name, wrap in fitted["wraps"].items():
        print(f"{name}: centre {wrap['pos']}, radius {wrap['radius']}")
    inside, everywhere = (path_agreement(model, p, offset) for p in (paths.within(FIT_RANGE_DEG), paths))
    print("\n| muscle | joint | worst, mm | rms, mm | worst over the whole table, mm |\n|---|---|---|---|---|")
    for i, muscle in enumerate(MUSCLES):
        for j, joint in enumerate(JOINTS):
            if np.abs(paths.arm[:, i, j]).max() > 1e-9:
                values = (inside.worst_arm[i, j], inside.rms_arm[i, j], everywhere.worst_arm[i, j])
                print(f"| {muscle} | {joint} | " + " | ".join(f"{v * 1e3:.2f}" for v in values) + " |")
    torque, mass_matrix = dynamics_agreement(model, states)
    print(f"\ninverse dynamics, worst over peak, %: {np.round(torque * 100, 2)}")
    print(f"mass matrix, worst over each entry's peak, %:\n{np.round(mass_matrix * 100, 2)}")
    if write:
        save_table(table)


if __name__ == "__main__":
    sys.exit(main())

"""The command ``mjhcmc doctor``."""

from __future__ import annotations

import json

import click


@click.command()
@click.option("--thorough", is_flag=True, help="Import optional parts, and time a solve whose code is compiled anew.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of the report.")
def doctor(thorough: bool, as_json: bool) -> int:
    """What mjhcmc stands on here: packages, optional parts, compiled code, pictures, and a small solve.

    Exit code 0 if nothing that is needed is broken, else 1. Put its output into a bug report.

    \b
    Example:
      mjhcmc doctor
    """
    from mjhcmc.doctor.examine import examine
    from mjhcmc.doctor.screen import screen

    found = examine(thorough=thorough)
    click.echo(json.dumps(found.to_dict()) if as_json else screen(found))
    return 0 if found.passed else 1

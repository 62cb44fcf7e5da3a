"""The command ``mjhcmc engines``."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path

import click

from mjhcmc.cli_support import FILE, VERBOSE, told


@click.command("engines")
@click.option(
    "--states", type=click.IntRange(min=1), default=100, show_default=True, metavar="N", help="Random states a leg."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="S", help="Of the random states."
)
@click.option("--only", multiple=True, metavar="NAME", help="An engine, or several by commas; may be repeated.")
@click.option("--urdf", type=FILE, metavar="FILE", help="Write a model as URDF instead, and compare nothing.")
@click.option("--model", default="leg8", show_default=True, help="For --urdf: leg8, oblique, or an MJCF file.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of the table.")
@VERBOSE
def engines(
    states: int, seed: int, only: tuple[str, ...], urdf: Path | None, model: str, as_json: bool, verbose: int
) -> int:
    """Compare rigid-body engines with MuJoCo: mass matrix, bias, inverse dynamics, a second of motion.

    Two legs without muscles are computed by every engine that is installed: leg8's bodies, and a leg with oblique axes
    and inertias. Exit code 0 if all agree, 1 if one does not or fails.
    """
    click.get_current_context().with_resource(told(verbose))
    if urdf is not None:
        from mjhcmc.engines.legs import model_named
        from mjhcmc.engines.urdf import write_urdf

        written = write_urdf(model_named(model), urdf)
        click.echo(json.dumps({"written": str(written)}) if as_json else f"written  {written}")
        return 0
    from mjhcmc.engines.compare import compare
    from mjhcmc.engines.registry import engines_named
    from mjhcmc.engines.screen import screen

    names = [name.strip() for names in only for name in names.split(",")]
    chosen = engines_named(names)
    with _chatter_dropped():
        found = compare(chosen, states, seed)
    click.echo(json.dumps(found.to_dict()) if as_json else screen(found))
    return 0 if found.passed else 1


@contextmanager
def _chatter_dropped() -> Iterator[None]:
    """Drop what engines print of themselves on standard output, from C too: --json promises one object there."""
    sys.stdout.flush()
    with Path(os.devnull).open("w") as nowhere, redirect_stdout(nowhere):
        kept = os.dup(1)
        os.dup2(nowhere.fileno(), 1)
        try:
            yield
        finally:
            os.dup2(kept, 1)
            os.close(kept)

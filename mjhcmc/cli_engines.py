"""The command ``mjhcmc engines``."""

from __future__ import annotations

import json
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from mjhcmc.cli_support import FILE, VERBOSE, engine_notices, told
from mjhcmc.errors import MjhcmcWarning, SettingsError

if TYPE_CHECKING:
    from mjhcmc.engines.base import Engine


@click.command("engines")
@click.option(
    "--states", type=click.IntRange(min=1), default=100, show_default=True, metavar="N", help="Random states a leg."
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="S", help="Of the random states."
)
@click.option("--only", multiple=True, metavar="NAME", help="An engine, or several by commas; may be repeated.")
@click.option("--model", metavar="FILE", help="An MJCF file whose tree of hinges is compared too.")
@click.option(
    "--urdf",
    type=FILE,
    metavar="FILE",
    help="Write --model (leg8 unless given, oblique, or an MJCF file) as URDF instead, and compare nothing.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of the table.")
@click.option("--quiet", is_flag=True, help="No progress, no table, no notices: errors only, and the exit code.")
@VERBOSE
def engines(
    states: int, seed: int, only: tuple[str, ...], model: str | None, urdf: Path | None, as_json: bool, quiet: bool,
    verbose: int,
) -> int:  # fmt: skip
    """Compare rigid-body engines with MuJoCo: mass matrix, bias, inverse dynamics, a second of motion.

    Two legs without muscles are computed by every engine that is installed: leg8's bodies, and a leg with oblique axes
    and inertias; and the bodies and hinges of a model of yours (--model). pip install "mjhcmc[engines]" brings four.
    Exit code 0 if all agree, 1 if one does not or fails.

    \b
    Examples:
      mjhcmc engines
      mjhcmc engines --only pinocchio,drake --states 20
      mjhcmc engines --model leg8 --urdf leg8.urdf
    """
    context = click.get_current_context()
    context.with_resource(told(verbose))
    context.with_resource(engine_notices())
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    from mjhcmc.engines.legs import LEGS, model_named

    if urdf is not None:
        from mjhcmc.engines.urdf import write_urdf

        for name in ("states", "seed", "only"):
            if context.get_parameter_source(name) is not ParameterSource.DEFAULT:
                raise click.UsageError(f"--{name} says what is compared, --urdf compares nothing: give one of them")
        written = write_urdf(model_named(model or LEGS[0]), urdf)
        if quiet:
            return 0
        click.echo(json.dumps({"written": str(written)}) if as_json else f"written  {written}")
        return 0
    from mjhcmc.engines.compare import compare
    from mjhcmc.engines.registry import engines_named
    from mjhcmc.engines.screen import screen

    names = [name.strip() for names in only for name in names.split(",")]
    chosen = engines_named(names)
    for engine in chosen:
        if engine.key in names and (why := engine.why_not()):
            raise SettingsError(f"--only {engine.key}: {why}{f': {engine.install}' if engine.install else ''}")
    if model in LEGS:
        raise click.UsageError(f"--model {model}: it is compared anyway: leave --model out, or give an MJCF file")
    further: dict[str, Any] = {}
    if model is not None:
        stem = Path(model).stem
        further[model if stem in LEGS else stem] = model_named(model)
    shown = None if as_json or quiet else _tell
    with _chatter_dropped():
        found = compare(chosen, states, seed, models=further, progress=shown)
    if as_json:
        click.echo(json.dumps(found.to_dict()))
    elif not quiet:
        click.echo(screen(found))
    return 0 if found.passed else 1


def _tell(engine: Engine) -> None:
    click.echo(f"{engine.title} ...", err=True)


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

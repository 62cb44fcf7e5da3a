"""The commands ``mjhcmc patients ...``."""

from __future__ import annotations

import json
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjhcmc.cli_support import FILE, QUIET, VERBOSE, engine_notices, told
from mjhcmc.errors import MjhcmcWarning

if TYPE_CHECKING:
    from mjhcmc.patients.manifest import Manifest


@click.group()
def patients() -> None:
    """Virtual patients with spasticity: datasets of clinical tests.

    \b
    Examples:
      mjhcmc patients generate --n 6 --out cohort    draw patients, take them through the tests
      mjhcmc patients show cohort --patient 2        look at one of them
      mjhcmc patients grade cohort                   learn grades from it; 60 patients or more
    """


@patients.command(short_help="simulate patients into a dataset")
@click.option("--n", "number", type=click.IntRange(min=1), required=True, help="Patients.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of all patients.")
@click.option("--out", type=FILE, metavar="DIR", required=True, help="Folder of the dataset; begun there, it goes on.")
@click.option(
    "--workers", type=click.IntRange(min=1), default=None, help="Processes to compute on.  [default: 1, this one]"
)
@click.option(
    "--cluster", metavar="ADDRESS", help="Of a dask scheduler, whose workers compute instead (extra cluster)."
)
@click.option("--shard-size", type=click.IntRange(min=1), default=25, show_default=True, help="Patients a shard.")
@click.option("--physics-dt", type=float, default=None, help="Largest physics step of voluntary movements, s.")
@click.option(
    "--set",
    "settings",
    metavar="NAME=VALUE",
    multiple=True,
    help="Another setting of the tests; an unknown one lists all.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
@QUIET
@VERBOSE
def generate(
    number: int, seed: int, out: Path, workers: int | None, cluster: str | None, shard_size: int,
    physics_dt: float | None, settings: tuple[str, ...], as_json: bool, quiet: bool, verbose: int,
) -> int:  # fmt: skip
    """Simulate patients into a dataset of Parquet shards.

    Killed, or interrupted, and started again, it goes on where it was, to the same bytes.

    \b
    Examples:
      mjhcmc patients generate --n 1000 --out cohort --workers 2
      mjhcmc patients generate --n 1000 --out cohort --cluster tcp://scheduler:8786
    """
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    if cluster is not None and workers is not None:
        raise click.UsageError("--workers and --cluster exclude each other: give one of them")
    click.get_current_context().with_resource(told(verbose))
    from mjhcmc.patients.configuration import Configuration
    from mjhcmc.patients.generation import generate as run

    click.get_current_context().with_resource(engine_notices())
    changes: dict[str, float | str] = dict(_setting(text) for text in settings)
    if physics_dt is not None:
        changes["physics_dt"] = physics_dt
    configuration = Configuration.with_defaults(number, seed, shard_size, **changes)
    started = time.perf_counter()
    try:
        manifest = run(
            configuration, out, workers=workers or 1, cluster=cluster, progress=False if quiet or as_json else None
        )
    except KeyboardInterrupt:
        click.echo(f"mjhcmc: {out} keeps the shards that are whole: the same command goes on from there", err=True)
        raise
    seconds = time.perf_counter() - started
    if as_json:
        click.echo(json.dumps(_numbers(manifest, out, seconds)))
    elif not quiet:
        click.echo(_summary(manifest, out, seconds))
    return 0


@patients.command("grade", short_help="learn grades from a dataset, and search it for leaks")
@click.argument("folder", type=FILE, metavar="DIR")
@click.option("--joint", metavar="hip|knee|ankle", help="Grade only this one; every joint by default.")
@click.option(
    "--target", default="rater_a", show_default=True, metavar="rater_a|ideal", help="Whose grades are learned."
)
@click.option("--out", type=FILE, metavar="DIR", help="Folder for grade.json and the figure; none by default.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
@QUIET
@VERBOSE
def grade(
    folder: Path, joint: str | None, target: str, out: Path | None, as_json: bool, quiet: bool, verbose: int
) -> int:
    """Learn grades from what an examiner could measure, and search the dataset DIR for leaks.

    Exit code 1 where the search flags something.

    \b
    Example:
      mjhcmc patients grade cohort --joint knee --out grades
    """
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    click.get_current_context().with_resource(told(verbose))
    from mjhcmc.patients.learning.report import grade_command

    return grade_command(folder, as_json, quiet, joint=joint, target=target, out=out)


@patients.command("show", short_help="look at a dataset, or at one patient")
@click.argument("folder", type=FILE, metavar="[DIR]", required=False)
@click.option("--patient", "patient", type=int, metavar="I", help="Index of one patient; all of them by default.")
@click.option("--seed", type=click.IntRange(min=0), help="Without DIR: draw and simulate a patient of this seed ...")
@click.option("--index", type=click.IntRange(min=0), help="... and this index, as generate would.")
@click.option("--trial", metavar="NAME", help="Draw one trial of the patient, such as mas/knee.")
@click.option("--out", type=FILE, metavar="DIR", help="Folder for the figure; ./mjhcmc-patient, or none with --json.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
@QUIET
@VERBOSE
def show(
    folder: Path | None, patient: int | None, seed: int | None, index: int | None, trial: str | None, out: Path | None,
    as_json: bool, quiet: bool, verbose: int,
) -> int:  # fmt: skip
    """A look at the dataset DIR, at one of its patients, or at a patient simulated now (--seed and --index).

    \b
    Examples:
      mjhcmc patients show cohort
      mjhcmc patients show cohort --patient 3 --trial mas/knee
      mjhcmc patients show --seed 1 --index 0
    """
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    drawn = None if seed is None or index is None else (seed, index)
    if (seed is None) != (index is None):
        raise click.UsageError("--seed and --index belong together: give both")
    if (folder is None) == (drawn is None):
        raise click.UsageError("show either a dataset DIR, or a patient simulated now (--seed and --index)")
    if drawn is not None and patient is not None:
        raise click.UsageError("--patient is one of a dataset DIR: with --seed give --index")
    if trial is not None and patient is None and drawn is None:
        raise click.UsageError("--trial is one of a patient: give --patient too")
    click.get_current_context().with_resource(told(verbose))
    from mjhcmc.patients.show import show_command

    click.get_current_context().with_resource(engine_notices())
    if out is None and not as_json:
        out = Path("mjhcmc-patient")
    return show_command(folder, patient, drawn, trial, out, as_json, quiet)


def _setting(text: str) -> tuple[str, float | str]:
    """NAME=VALUE as a name and a word; what kind it is to be, `Configuration` knows."""
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise click.UsageError(f"--set takes NAME=VALUE; got {text!r}")
    return name, value


def _numbers(manifest: Manifest, out: Path, seconds: float) -> dict[str, object]:
    return {
        "out": str(out),
        "patients": manifest.patients,
        "made": manifest.made,
        "failed": manifest.failed,
        "shards": len(manifest.shards),
        "bytes": manifest.size,
        "seconds": seconds,
        "patients_per_second": manifest.made / seconds,
        "hash": manifest.hash,
        "generator": manifest.generator,
    }


def _summary(manifest: Manifest, out: Path, seconds: float) -> str:
    kept = manifest.patients - manifest.made
    made = f"{manifest.made / seconds:.3g} patients/s over {seconds:.0f} s" if manifest.made else "nothing to do"
    return (
        f"{manifest.patients} patients, {manifest.failed} failed, {len(manifest.shards)} shards, "
        f"{_size(manifest.size)}; {made}{f', {kept} patients were there' if kept else ''}\nwritten  {out}"
    )


def _size(count: float) -> str:
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} GB"

"""The command ``mjhcmc report``."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjhcmc.cli_support import FILE, QUIET, VERBOSE, told
from mjhcmc.errors import MjhcmcWarning, OutputError, SettingsError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mjhcmc.emg_comparison import EmgComparison
    from mjhcmc.solution import Solution

_NAME = "report.html"


@click.command("report")
@click.argument("solution", type=FILE)
@click.option("--model", metavar="M", help="The model that was driven; by default what run.json tells.")
@click.option("--with", "beside", type=FILE, multiple=True, metavar="OTHER", help="Another solution, drawn dashed.")
@click.option("--emg", type=FILE, metavar="FILE", help="Measured EMG, laid over the excitations.")
@click.option(
    "--emg-map", "--map", "emg_map", type=FILE, metavar="FILE",
    help='CSV with lines muscle,channel, or JSON: {"muscle": "channel"}; by default channels have muscles\' names.',
)  # fmt: skip
@click.option("--raw/--envelope", default=None, help="What the EMG's file holds; by default its values tell.")
@click.option("--band", type=float, nargs=2, metavar="LOW HIGH", help="Band-pass of raw EMG, Hz; 20 450 by default.")
@click.option("--lowpass", type=float, metavar="HZ", help="Low-pass of rectified EMG; 6 by default.")
@click.option("--shift", type=float, metavar="S", help="Add to the EMG's times; 0 by default.")
@click.option("--delay", type=float, metavar="S", help="Largest lag of the best correlation; 0.1 by default.")
@click.option("--threshold", type=float, help="EMG is on above this share of its range; 0.2 by default.")
@click.option("--start", type=float, metavar="S", help="EMG: leave out what comes before.")
@click.option("--title", metavar="TEXT", help="Over the page; by default method, model and motion.")
@click.option("--out", type=FILE, metavar="FILE", help=f"The page; {_NAME} beside the solution by default.")
@QUIET
@VERBOSE
def report_command(
    solution: Path, model: str | None, beside: tuple[Path, ...], emg: Path | None, emg_map: Path | None,
    raw: bool | None, band: tuple[float, float] | None, lowpass: float | None, shift: float | None,
    delay: float | None, threshold: float | None, start: float | None, title: str | None, out: Path | None,
    quiet: bool, verbose: int,
) -> int:  # fmt: skip
    """Write a SOLUTION (a folder that solve wrote, or its file) as one HTML page to look at.

    The page needs no network and no other file: verdict in words, replay, excitations and activations (beside EMG and
    other solutions), angles, moments with what each muscle adds, fibers, model and run.

    \b
    Examples:
      mjhcmc report walk
      mjhcmc report walk --with static --out compared.html
      mjhcmc report walk --emg trial.csv --emg-map channels.csv
    """
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    click.get_current_context().with_resource(told(verbose))
    given = {
        "map": emg_map, "raw": raw, "band": band, "lowpass": lowpass, "shift": shift, "delay": delay,
        "threshold": threshold, "start": start,
    }  # fmt: skip
    if emg is None and (extra := [name for name, value in given.items() if value is not None]):
        raise SettingsError(f"--{extra[0]} is of EMG: name a file of it with --emg, or leave it out")
    from mjhcmc.cli_support import engine_notices
    from mjhcmc.report.page import write_report
    from mjhcmc.saved import open_saved

    click.get_current_context().with_resource(engine_notices())
    saved = open_saved(solution, model)
    path = saved.folder / _NAME if out is None else out
    if os.path.isdir(path):  # noqa: PTH112 - Path.is_dir raises on names that are too long
        raise OutputError(f"{path}: is a folder: name a file for the page, such as {path / _NAME}")
    measured = None
    if emg is not None:
        measured = _compared(
            saved.solution, emg, emg_map, raw, band, 6.0 if lowpass is None else lowpass, shift or 0.0,
            {k: given[k] for k in ("delay", "threshold", "start") if given[k] is not None},
        )  # fmt: skip
    others = {label: open_saved(file).solution for label, file in _labels(beside)}
    written = write_report(
        saved.solution, path, emg=measured, others=others, run=_run_facts(saved.run, saved.path), title=title,
        why_no_model=saved.why_no_model,
    )  # fmt: skip
    if not quiet:
        verdict = "holds" if saved.solution.verdict.passed else "FAILS"
        click.echo(f"verdict  {verdict}")
        click.echo(f"written  {written}")
    return 0


def _compared(
    solution: Solution, emg: Path, emg_map: Path | None, raw: bool | None, band: tuple[float, float] | None,
    lowpass: float, shift: float, settings: dict[str, object],
) -> EmgComparison:  # fmt: skip
    from mjhcmc.cli_emg import envelopes_of
    from mjhcmc.emg_comparison import compare_emg

    envelopes, _ = envelopes_of(emg, emg_map, solution.muscle_names, raw, band, lowpass, shift)
    return compare_emg(solution, envelopes, emg_map, **settings)  # type: ignore[arg-type]


def _labels(files: Sequence[Path]) -> list[tuple[str, Path]]:
    """Short names by which solutions can be told apart: of their folder or file, longer where two are alike."""

    def label(file: Path, parts: int) -> str:
        named = file.resolve()
        if named.name == "solution.parquet":
            named = named.parent
        return "/".join(named.with_suffix("").parts[-parts:])

    longest = max((len(file.resolve().parts) for file in files), default=1)
    for parts in range(1, longest + 1):
        found = [label(file, parts) for file in files]
        if len(set(found)) == len(found):
            return list(zip(found, files, strict=True))
    twice = next(file for file in files if files.count(file) > 1)
    raise SettingsError(f"--with {twice}: stands twice: name each solution once")


def _run_facts(run: dict[str, object], solution: Path) -> dict[str, object]:
    """What run.json tells; where there is none, at least which file this is."""
    if run:
        return run
    from mjhcmc.run_facts import sha256_of

    return {"solution": {"file": solution.name, "sha256": sha256_of(solution)}}

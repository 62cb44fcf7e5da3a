"""``mjhcmc sensitivity``: which muscle parameters move which excitation, and how far excitations are known."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjhcmc.cli_support import (
    FILE,
    QUIET,
    VERBOSE,
    engine_notices,
    interrupt_later,
    progress_bar,
    told,
)
from mjhcmc.errors import MjhcmcWarning, SettingsError
from mjhcmc.io.files import output_folder

if TYPE_CHECKING:
    from mjhcmc.gradients.table import SensitivityTable
    from mjhcmc.gradients.uncertainty import Intervals
    from mjhcmc.model import MuscleModel
    from mjhcmc.motion import Motion


@click.command("sensitivity")
@click.argument("motion", type=FILE, required=False, metavar="[MOTION]")
@click.option("--movement", metavar="fast|slow", help="A cosine movement, without MOTION; fast.")
@click.option(
    "--model", default="leg8", show_default=True, metavar="MODEL", help="A shipped name or a path to an MJCF file."
)
@click.option("--dt", default=0.01, show_default=True, help="Control window, s.")
@click.option("--physics-dt", default=0.001, show_default=True, help="Largest physics step, s.")
@click.option("--lowpass", type=float, metavar="HZ", help="Zero-phase low-pass filter of MOTION's angles.")
@click.option(
    "--samples", type=click.IntRange(min=0), default=200, show_default=True, metavar="N",
    help="Draws of the parameters, of 2 or more; 0: no intervals.",
)  # fmt: skip
@click.option(
    "--sd", multiple=True, metavar="KIND=VALUE",
    help="Relative standard deviation of a kind of parameter, such as tendon_slack_length=.02; 0: known. May be "
    "repeated. Without: max_isometric_force=.1, optimal_fiber_length=.05, tendon_slack_length=.02.",
)  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="S", help="Of the draws.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of the tables.")
@QUIET
@VERBOSE
@click.option("--out", required=True, type=FILE, metavar="DIR", help="Folder for the results.")
def sensitivity(
    motion: Path | None,
    movement: str | None,
    model: str,
    dt: float,
    physics_dt: float,
    lowpass: float | None,
    samples: int,
    sd: tuple[str, ...],
    seed: int,
    as_json: bool,
    quiet: bool,
    verbose: int,
    out: Path,
) -> int:
    """Which muscle parameters move which excitation, and intervals on excitations from what is not known of them.

    Writes DIR/sensitivity.csv and, unless --samples is 0, DIR/intervals.csv, with their figures. Exit code 0 also where
    draws fail: notices name them, and the intervals are of the others.

    \b
    Examples:
      mjhcmc sensitivity --movement fast --out out
      mjhcmc sensitivity walk.mot --lowpass 6 --samples 500 --sd tendon_slack_length=.03 --out out
    """
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    click.get_current_context().with_resource(told(verbose))
    from mjhcmc.muscle_parameters import FORCE_KINDS, check_kinds

    given = _spreads(sd)
    check_kinds(list(given))
    if samples == 1:
        raise SettingsError("--samples 1: an interval needs 2 draws or more; 0 leaves it out")
    import mjhcmc
    from mjhcmc.gradients.gradient import gradient
    from mjhcmc.gradients.spread import check_draws, spreads, typical
    from mjhcmc.gradients.table import sensitivity_table
    from mjhcmc.gradients.uncertainty import intervals

    click.get_current_context().with_resource(engine_notices())
    muscle_model = mjhcmc.MuscleModel.load(model)
    to_follow = _motion(motion, movement, lowpass, muscle_model)
    spread: dict[str, float] = {}
    if samples:
        check_draws(samples, seed)
        spread = {**typical(muscle_model), **given}
        spreads(muscle_model, spread)
    kinds = (*FORCE_KINDS, *(kind for kind in given if kind not in FORCE_KINDS))
    found: Intervals | None = None
    with output_folder(out) as folder:
        slopes = gradient(muscle_model, to_follow, dt, physics_dt, parameters=kinds)
        table = sensitivity_table(slopes)
        if samples:
            with progress_bar(quiet or as_json) as progress:
                found = intervals(
                    muscle_model, to_follow, spread, samples, seed, dt=dt, physics_dt=physics_dt, first_order=slopes,
                    progress=progress,
                )  # fmt: skip
        files = _write(table, found, folder)
    if as_json:
        numbers: dict[str, Any] = {
            "model": muscle_model.name, "motion": to_follow.name, "settings": slopes.solution.settings,
            "table": table.numbers(), "intervals": None if found is None else found.numbers(), "files": files,
        }  # fmt: skip
        click.echo(json.dumps(numbers))
    elif not quiet:
        click.echo(_screen(table, found))
        click.echo(f"written  {', '.join(files)}")
    return 0


def _spreads(given: tuple[str, ...]) -> dict[str, float]:
    """Of --sd, by kind."""
    found: dict[str, float] = {}
    for text in given:
        kind, equals, number = text.partition("=")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not equals or not 0 <= value <= 1:
            raise SettingsError(f"--sd {text!r}: write KIND=VALUE with a value within 0 .. 1, such as .1 for 10 %")
        if kind.strip() in found:
            raise SettingsError(f"--sd {text!r}: {kind.strip()} is given twice")
        found[kind.strip()] = value
    return found


def _motion(path: Path | None, movement: str | None, lowpass: float | None, model: MuscleModel) -> Motion:
    from mjhcmc.motion import Motion

    if path is None:
        if lowpass is not None:
            raise SettingsError("--lowpass is of a motion file: give MOTION, or leave it out")
        return Motion.cosine(model, movement or "fast")
    if movement is not None:
        raise SettingsError(f"--movement {movement} and the motion {path}: give one of them")
    motion = Motion.from_file(path, model, lowpass)
    noise = motion.noise_warning() if lowpass is None else None
    for notice in (*motion.notices, *([noise] if noise else [])):
        warnings.warn(notice, MjhcmcWarning, stacklevel=2)
    return motion


def _write(table: SensitivityTable, found: Intervals | None, folder: Path) -> list[str]:
    """Tables and figures into a folder; the paths written."""
    from mjhcmc.plotting import interval_figure, save_figures, sensitivity_figure

    with interrupt_later():
        paths = [str(table.save(folder / "sensitivity.csv"))]
        figures: dict[str, Callable[[], Any]] = {"sensitivity": partial(sensitivity_figure, table)}
        if found is not None:
            paths.append(str(found.save(folder / "intervals.csv")))
            figures["intervals"] = partial(interval_figure, found)
    return [*paths, *save_figures(figures, folder)]


def _screen(table: SensitivityTable, found: Intervals | None) -> str:
    """What a person asks for first."""
    from mjhcmc.gradients.table import said, share
    from mjhcmc.summary import columns

    width = max(map(len, ("muscle", *table.muscle_names)))
    lines = [
        f"{table.label}: change of excitation with 1 % of a parameter, percentage points",
        f"{'muscle'.ljust(width)}    rms   mean  parameters that matter most",
    ]
    for j, muscle in enumerate(table.muscle_names):
        top = table.top(muscle)
        for rank, parameter in enumerate(top):
            i = table.names.index(parameter)
            head = (muscle if rank == 0 else "").ljust(width)
            lines.append(f"{head}  {table.rms[i, j]:5.2f}  {table.mean[i, j]:+5.2f}  {said(parameter)}")
        if not top:
            lines.append(f"{muscle.ljust(width)}   none   none  no parameter moves it")
    lines += [
        f"valid nearby only: a change of {100 * table.change:g} % of one parameter changes an active set in "
        f"{share(table.near_any)} of the windows",
        "",
    ]
    if found is None:
        return "\n".join([*lines, *columns([["muscle", "near a change"], *_nears(table)])])
    low, high = found.levels
    nears = _nears(table)
    titles = ["muscle", "near a change", "interval", "sd", "first order sd", "their ratio", "without bounds", "clipped"]
    rows = [
        [
            *near, f"{100 * found.width[j]:.2f}",
            *(f"{100 * _rms(sd[:, j]):.2f}" for sd in (found.sd, found.first_order_sd)),
            *(f"{value:.2f}" if math.isfinite(value) else "none" for value in (found.ratio[j], found.ratio_inside[j])),
            share(found.clipped[j]),
        ]
        for j, near in enumerate(nears)
    ]  # fmt: skip
    return "\n".join([
        *lines, *columns([titles, *rows]),
        f"interval: from {100 * low:g} to {100 * high:g} % of {len(found.solved)} draws, mean over the motion; sd: "
        "root mean square; both in points",
        "without bounds: the ratio where no draw is at a bound; clipped: windows where some draws are at one",
        f"largest reserve in any draw: {share(float(found.reserve_share.max()))} of the joint's peak moment; "
        f"{found.helped} draws needed one, {len(found.failed)} failed",
    ])  # fmt: skip


def _nears(table: SensitivityTable) -> list[list[str]]:
    from mjhcmc.gradients.table import share

    return [[name, share(near)] for name, near in zip(table.muscle_names, table.near.tolist(), strict=True)]


def _rms(values: Any) -> float:
    return float((values**2).mean() ** 0.5)

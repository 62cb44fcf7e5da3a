"""The command line: ``mjhcmc solve``, ``reproduce``, ``check`` and ``compare-muscles``.

Exit codes: 0 the verdict holds, 1 it fails, 2 bad input, 130 interrupted. Only what a command needs is imported, when
it runs, so that ``mjhcmc --help`` is instant.
"""

from __future__ import annotations

import json
import sys
import warnings
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjhcmc import __version__
from mjhcmc.cli_compare import compare_muscles
from mjhcmc.cli_emg import emg_command, emg_options, targets_from
from mjhcmc.cli_support import (
    INTERRUPTED,
    engine_notices,
    fail,
    interrupt_later,
    output_folder,
    progress_bar,
    show_warning,
    told,
)
from mjhcmc.errors import MjhcmcError, MjhcmcWarning
from mjhcmc.methods import METHODS, find_method

if TYPE_CHECKING:
    from collections.abc import Callable

    from mjhcmc.model import MuscleModel
    from mjhcmc.motion import Motion
    from mjhcmc.solution import Solution

_FILE = click.Path(path_type=Path)
_quiet = click.option("--quiet", is_flag=True, help="No progress bar, no summary, no notices: errors only.")
_muscle = click.option(
    "--muscle", default="mujoco", show_default=True, metavar="mujoco|rigid|compliant",
    help="What drives the model: MuJoCo's own muscles, or Hill muscles with rigid or compliant tendons.",
)  # fmt: skip
_curves = click.option(
    "--curves",
    default="millard",
    show_default=True,
    metavar="NAME",
    help="Of Hill muscles: millard, thelen, degroote-fregly.",
)
_verbose = click.option("-v", "--verbose", count=True, help="Log what is done on standard error; twice: in detail.")


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="mjhcmc")
def cli() -> None:
    """Muscle excitations from motion, for any MuJoCo muscle model."""


cli.add_command(compare_muscles)
cli.add_command(emg_command)


@cli.command()
@click.argument("motions", type=_FILE, nargs=-1, required=True, metavar="MOTION...")
@click.option("--model", default="leg8", show_default=True, help="A shipped name or a path to an MJCF file.")
@_muscle
@_curves
@click.option("--method", default="hcmc", show_default=True, help=f"One of: {', '.join(METHODS)}.")
@click.option("--dt", default=0.01, show_default=True, help="Control window, s: excitation is constant over it.")
@click.option("--physics-dt", default=0.001, show_default=True, help="Largest physics step, s.")
@click.option("--lowpass", type=float, metavar="HZ", help="Zero-phase low-pass filter of the angles.")
@click.option("--resample", type=float, metavar="HZ", help="Put the motion on an even grid of that many rows a second.")
@click.option("--start", type=float, metavar="S", help="Begin here, on the file's clock.")
@click.option("--end", type=float, metavar="S", help="End here, on the file's clock.")
@click.option(
    "--map", "column_map", type=_FILE, metavar="FILE",
    help='JSON: {"joint": "column"}, or a .csv of such pairs; a leading - on the column flips its sign.',
)  # fmt: skip
@click.option("--unit", metavar="deg|rad", help="Unit of the angles, where the file does not say.")
@click.option("--angles", default="joint", show_default=True, metavar="joint|segment", help="What the angles are of.")
@click.option("--moments", type=_FILE, metavar="FILE", help="Net joint moments to share, in place of inverse dynamics.")
@click.option("--cost", metavar="NAME", help="effort (a^2, the default), cubic, volume, stress or capacity.")
@click.option("--weights", type=_FILE, metavar="FILE", help='JSON: {"muscle": weight}; more: does less.')
@click.option("--smoothness", type=float, metavar="W", help="Weight of changes of activation beside the cost.")
@click.option("--min-activation", type=float, metavar="A", help="Least activation of every muscle.")
@click.option("--disable", multiple=True, metavar="MUSCLE", help="Keep a muscle switched off; may be repeated.")
@click.option("--solver", default="newton", show_default=True, help="newton, or a qpsolvers back end (daqp, osqp ...).")
@emg_options
@click.option("--opensim", is_flag=True, help="Write controls and states for OpenSim, too.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of the summary.")
@_quiet
@_verbose
@click.option("--out", required=True, type=_FILE, metavar="DIR", help="Folder for the results.")
def solve(
    motions: tuple[Path, ...],
    model: str,
    muscle: str,
    curves: str,
    method: str,
    dt: float,
    physics_dt: float,
    lowpass: float | None,
    resample: float | None,
    start: float | None,
    end: float | None,
    column_map: Path | None,
    unit: str | None,
    angles: str,
    moments: Path | None,
    cost: str | None,
    weights: Path | None,
    smoothness: float | None,
    min_activation: float | None,
    disable: tuple[str, ...],
    solver: str,
    emg: Path | None,
    emg_map: Path | None,
    emg_weight: float | None,
    emg_mvc: Path | None,
    emg_delay: float | None,
    opensim: bool,
    as_json: bool,
    quiet: bool,
    verbose: int,
    out: Path,
) -> int:
    """From motion files (.mot, .sto, .csv, .trc) to muscle excitations.

    Writes DIR/solution.parquet, DIR/verdict.json and the figures; of several motions, into a folder each in DIR.
    """
    from mjhcmc.muscle_choice import check_muscle, plant_for

    find_method(method)
    check_muscle(muscle, curves)
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    click.get_current_context().with_resource(told(verbose))
    import mjhcmc

    click.get_current_context().with_resource(engine_notices())
    muscle_model = mjhcmc.MuscleModel.load(model)
    read = mjhcmc.Motion.from_files(
        motions, muscle_model, lowpass, column_map=column_map, start=start, end=end, angle_unit=unit,  # type: ignore[arg-type]
        angles=angles,  # type: ignore[arg-type]
    )  # fmt: skip
    for motion in read:
        noise = motion.noise_warning() if lowpass is None else None
        for notice in (*motion.notices, *([noise] if noise else [])):
            warnings.warn(notice if len(read) == 1 else f"{motion.name}: {notice}", MjhcmcWarning, stacklevel=1)
    if resample is not None:
        read = [motion.resampled(resample) for motion in read]
    options: dict[str, Any] = {"dt": dt, "physics_dt": physics_dt, "solver": solver, "disabled": disable}
    chosen = {"cost": cost, "smoothness": smoothness, "min_activation": min_activation}
    options |= {name: value for name, value in chosen.items() if value is not None}
    options["plant"] = plant_for(muscle_model, muscle, dt, physics_dt, curves)
    if weights is not None:
        options["weights"] = _read_weights(weights)
    if moments is not None:
        options["joint_moments"] = mjhcmc.JointMoments.from_file(moments, muscle_model, column_map)
        for motion in read:
            options["joint_moments"].check_covers(motion, muscle_model)
    targets = targets_from(emg, emg_map, emg_weight, emg_mvc, emg_delay, muscle_model.muscle_names)
    if targets is not None:
        options["emg"] = targets
        for motion in read:
            targets.check_covers(motion)
    if opensim:
        from mjhcmc.io.export import check_names

        check_names(muscle_model)
    with output_folder(out) as folder:
        results = {}
        for motion in read:
            place = folder if len(read) == 1 else folder / motion.name
            results[motion.name] = _solve_one(
                method, muscle_model, motion, options, place, opensim=opensim, as_json=as_json, quiet=quiet
            )
            if results[motion.name]["interrupted"]:
                break
    if as_json:
        click.echo(json.dumps(next(iter(results.values())) if len(read) == 1 else {"motions": results}))
    if any(result["interrupted"] for result in results.values()):
        return INTERRUPTED
    return 0 if all(result["verdict"]["passed"] for result in results.values()) else 1


def _solve_one(
    method: str,
    model: MuscleModel,
    motion: Motion,
    options: dict[str, Any],
    place: Path,
    *,
    opensim: bool,
    as_json: bool,
    quiet: bool,
) -> dict[str, Any]:
    """Solve one motion into a folder; what --json prints of it."""
    import mjhcmc
    from mjhcmc.summary import numbers, screen

    interrupted = False
    with output_folder(place) as folder:
        try:
            with progress_bar(quiet or as_json) as progress:
                solution = find_method(method)(model, motion, progress=progress, **options)
        except mjhcmc.SolveInterrupted as stop:
            if stop.solution is None:
                raise
            solution, interrupted = stop.solution, True
        files = _write(solution, folder, opensim=opensim)
    if not (as_json or quiet):
        click.echo(screen(solution))
        click.echo(f"written  {', '.join(files)}")
    return {**numbers(solution), "settings": solution.settings, "interrupted": interrupted, "files": files}


def _read_weights(path: Path) -> dict[str, float]:
    """Weights by muscle from a JSON file; names and ranges are checked against the model later."""
    from mjhcmc.checks import is_number
    from mjhcmc.errors import SettingsError

    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise SettingsError(f"weights {path}: cannot be read ({error.strerror}): check the path") from None
    except ValueError as error:
        raise SettingsError(f'weights {path}: not JSON ({error}): give {{"muscle": weight}}') from None
    if not isinstance(content, dict):
        raise SettingsError(f'weights {path}: holds no object: give {{"muscle": weight}}')
    for name, value in content.items():
        if not is_number(value):
            told = json.dumps(value)
            told = told if len(told) <= 40 else f"{told[:37]}..."
            raise SettingsError(f"weights {path}: that of {name} is {told}, no number: give a positive one")
    return content


@cli.command()
@click.option("--movement", default="fast", show_default=True, help="fast (the paper's) or slow.")
@click.option("--dt", default=0.01, show_default=True, help="Control window, s.")
@click.option("--physics-dt", default=0.001, show_default=True, help="Largest physics step, s.")
@_muscle
@_curves
@click.option(
    "--out", type=_FILE, metavar="DIR", help="Folder for the results; ./mjhcmc-reproduce, or nothing with --json."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
@_quiet
@_verbose
def reproduce(
    movement: str, dt: float, physics_dt: float, muscle: str, curves: str, out: Path | None, as_json: bool,
    quiet: bool, verbose: int,
) -> int:  # fmt: skip
    """The paper's experiment, by every method: table, figures, verdict."""
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    click.get_current_context().with_resource(told(verbose))
    from mjhcmc.muscle_choice import check_muscle

    check_muscle(muscle, curves)
    import mjhcmc
    from mjhcmc.plotting import excitation_figure
    from mjhcmc.reproduce import reproduce as run

    click.get_current_context().with_resource(engine_notices())
    if out is None and not as_json:
        out = Path("mjhcmc-reproduce")
    files: list[str] = []
    if out is None:
        with progress_bar(quiet or as_json) as progress:
            result = run(movement, dt, physics_dt, progress, muscle, curves)
    else:
        with output_folder(out) as folder:
            try:
                with progress_bar(quiet or as_json) as progress:
                    result = run(movement, dt, physics_dt, progress, muscle, curves)
            except mjhcmc.SolveInterrupted as stop:
                if stop.solution is not None:
                    click.echo(f"written  {', '.join(_write(stop.solution, folder))}", err=True)
                raise
            files = _write(result.solutions["hcmc"], folder)
            overlay = None if result.opensim is None else {"OpenSim 4.6 CMC": result.opensim.activity}
            files += _save({"methods": partial(excitation_figure, result.solutions, overlay)}, folder)
    if as_json:
        click.echo(json.dumps(result.numbers()))
    elif not quiet:
        click.echo(result.screen())
        click.echo(f"written  {', '.join(files)}")
    return 0 if result.passed else 1


@cli.command()
@click.argument("model")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of the report.")
@_verbose
def check(model: str, as_json: bool, verbose: int) -> int:
    """What mjhcmc sees in a model: muscles, joints, strength, and every problem with its remedy."""
    click.get_current_context().with_resource(told(verbose))
    from mjhcmc.model_check.check import check as look

    click.get_current_context().with_resource(engine_notices())
    report = look(model)
    click.echo(json.dumps(report.to_dict()) if as_json else report.screen())
    return 0


def _write(solution: Solution, folder: Path, *, opensim: bool = False) -> list[str]:
    """Solution, verdict and figures into a folder; the paths written."""
    from mjhcmc.io.files import written_whole
    from mjhcmc.plotting import excitation_figure, moment_figure, tracking_figure

    with interrupt_later():
        paths = [solution.save(folder / "solution.parquet")]
        verdict = folder / "verdict.json"
        with written_whole(verdict) as temporary:
            temporary.write_text(json.dumps(solution.verdict.to_dict(), indent=2) + "\n")
        paths.append(verdict)
        if opensim:
            from mjhcmc.io.export import export_opensim

            paths += export_opensim(solution, folder / "solution")
    figures = {"excitations": excitation_figure, "tracking": tracking_figure, "moments": moment_figure}
    return [*map(str, paths), *_save({name: partial(draw, solution) for name, draw in figures.items()}, folder)]


def _save(figures: dict[str, Callable[[], Any]], folder: Path) -> list[str]:
    """Draw figures into a folder; the paths written."""
    from mjhcmc.plotting import save_figure

    return [str(path) for name, draw in figures.items() for path in save_figure(draw(), folder / name)]


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; errors are one line on standard error and exit code 2."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        with warnings.catch_warnings():
            warnings.showwarning = show_warning
            warnings.simplefilter("always", MjhcmcWarning)
            code = cli.main(arguments or ["--help"], prog_name="mjhcmc", standalone_mode=False)
    except click.ClickException as error:
        fail(error.format_message())
    except MjhcmcError as error:
        fail(str(error))
    except (KeyboardInterrupt, click.Abort):
        click.echo("mjhcmc: interrupted before the work was done", err=True)
        sys.exit(INTERRUPTED)
    sys.exit(code)


if __name__ == "__main__":
    main()

"""The command line: ``mjhcmc solve`` and ``mjhcmc reproduce``.

Exit codes: 0 the verdict holds, 1 it fails, 2 bad input, 130 interrupted. Only what a command needs is imported, when
it runs, so that ``mjhcmc --help`` is instant.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjhcmc import __version__
from mjhcmc.errors import MjhcmcError, MjhcmcWarning, OutputError
from mjhcmc.methods import METHODS, find_method

if TYPE_CHECKING:
    from mjhcmc.methods.windows import Progress
    from mjhcmc.solution import Solution

_INTERRUPTED = 130


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="mjhcmc")
def cli() -> None:
    """Muscle excitations from motion, for any MuJoCo muscle model."""


@cli.command()
@click.argument("motion", type=click.Path(path_type=Path))
@click.option("--model", default="leg8", show_default=True, help="A shipped name or a path to an MJCF file.")
@click.option("--method", default="hcmc", show_default=True, help=f"One of: {', '.join(METHODS)}.")
@click.option("--dt", default=0.01, show_default=True, help="Control window, s: excitation is constant over it.")
@click.option("--physics-dt", default=0.001, show_default=True, help="Largest physics step, s.")
@click.option("--lowpass", type=float, metavar="HZ", help="Zero-phase low-pass filter of the angles.")
@click.option("--start", type=float, metavar="S", help="Begin here, on the file's clock.")
@click.option("--end", type=float, metavar="S", help="End here, on the file's clock.")
@click.option(
    "--map", "column_map", type=click.Path(path_type=Path), metavar="FILE",
    help='JSON: {"joint": "column"}; a leading - on the column flips its sign.',
)  # fmt: skip
@click.option("--solver", default="newton", show_default=True, help="newton, or a qpsolvers back end (daqp, osqp ...).")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of the summary.")
@click.option("--quiet", is_flag=True, help="No progress bar, no summary.")
@click.option("--out", required=True, type=click.Path(path_type=Path), metavar="DIR", help="Folder for the results.")
def solve(
    motion: Path,
    model: str,
    method: str,
    dt: float,
    physics_dt: float,
    lowpass: float | None,
    start: float | None,
    end: float | None,
    column_map: Path | None,
    solver: str,
    as_json: bool,
    quiet: bool,
    out: Path,
) -> int:
    """From a motion file (.mot, .sto) to muscle excitations.

    Writes DIR/solution.parquet, DIR/verdict.json and the figures.
    """
    run = find_method(method)
    import mjhcmc
    from mjhcmc.summary import numbers, screen

    muscle_model = mjhcmc.MuscleModel.load(model)
    read = mjhcmc.Motion.from_file(motion, muscle_model, lowpass, column_map=column_map, start=start, end=end)
    for notice in read.notices:
        _notice(notice)
    noise = read.noise_warning() if lowpass is None else None
    if noise:
        _notice(noise)
    with _output_folder(out) as folder:
        interrupted = False
        try:
            with _progress_bar(quiet or as_json) as progress:
                solution = run(muscle_model, read, dt, physics_dt, solver=solver, progress=progress)
        except mjhcmc.SolveInterrupted as stop:
            if stop.solution is None:
                raise
            solution, interrupted = stop.solution, True
        files = _write(solution, folder)
    result = {**numbers(solution), "settings": solution.settings, "interrupted": interrupted, "files": files}
    if as_json:
        click.echo(json.dumps(result))
    elif not quiet:
        click.echo(screen(solution))
        click.echo(f"written  {', '.join(files)}")
    if interrupted:
        return _INTERRUPTED
    return 0 if solution.verdict.passed else 1


@cli.command()
@click.option("--movement", default="fast", show_default=True, help="fast (the paper's) or slow.")
@click.option("--dt", default=0.01, show_default=True, help="Control window, s.")
@click.option("--physics-dt", default=0.001, show_default=True, help="Largest physics step, s.")
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="DIR",
    help="Folder for the results; ./mjhcmc-reproduce, or nothing with --json.",
)  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
def reproduce(movement: str, dt: float, physics_dt: float, out: Path | None, as_json: bool) -> int:
    """The paper's experiment: table, figures, verdict."""
    from mjhcmc.reproduce import reproduce as run

    if out is None and not as_json:
        out = Path("mjhcmc-reproduce")
    files: list[str] = []
    if out is None:
        result = run(movement, dt, physics_dt)
    else:
        with _output_folder(out) as folder:
            result = run(movement, dt, physics_dt)
            files = _write(result.solutions["hcmc"], folder)
    if as_json:
        click.echo(json.dumps(result.numbers()))
    else:
        click.echo(result.screen())
        click.echo(f"written  {', '.join(files)}")
    return 0 if result.passed else 1


def _write(solution: Solution, folder: Path) -> list[str]:
    """Solution, verdict and figures into a folder; the paths written."""
    from mjhcmc.io.files import written_whole
    from mjhcmc.plotting import excitation_figure, save_figure, tracking_figure

    paths = [solution.save(folder / "solution.parquet")]
    verdict = folder / "verdict.json"
    with written_whole(verdict) as temporary:
        temporary.write_text(json.dumps(solution.verdict.to_dict(), indent=2) + "\n")
    paths.append(verdict)
    paths += save_figure(excitation_figure(solution), folder / "excitations")
    paths += save_figure(tracking_figure(solution), folder / "tracking")
    return [str(path) for path in paths]


@contextmanager
def _output_folder(path: Path) -> Iterator[Path]:
    """Make the folder and see that it can be written, before the work; take it away again if the work fails."""
    made = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / ".mjhcmc-probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        _remove(made)
        raise OutputError(
            f"{path}: the output folder cannot be written ({error.strerror}): choose another --out"
        ) from error
    try:
        yield path
    except BaseException:
        _remove(made)
        raise


def _remove(folders: list[Path]) -> None:
    """Remove folders that are there and empty, innermost first."""
    for folder in folders:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()


@contextmanager
def _progress_bar(hidden: bool) -> Iterator[Progress]:
    from tqdm import tqdm

    # disable=None hides the bar where standard error is no terminal
    with tqdm(unit="window", leave=False, disable=True if hidden else None) as bar:

        def progress(done: int, count: int) -> None:
            bar.total = count
            bar.update(done - bar.n)

        yield progress


def _notice(message: Any, *_: Any) -> None:
    click.echo(f"mjhcmc: notice: {message}", err=True)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; errors are one line on standard error and exit code 2."""
    warnings.showwarning = lambda message, category, *rest: (
        _notice(message) if issubclass(category, MjhcmcWarning) else None
    )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", MjhcmcWarning)
            code = cli.main(arguments, prog_name="mjhcmc", standalone_mode=False)
    except click.ClickException as error:
        _fail(error.format_message())
    except MjhcmcError as error:
        _fail(str(error))
    except (KeyboardInterrupt, click.Abort):
        click.echo("mjhcmc: interrupted before the first window was solved", err=True)
        sys.exit(_INTERRUPTED)
    sys.exit(code)


def _fail(message: str) -> None:
    click.echo(f"mjhcmc: error: {' '.join(message.split())}", err=True)
    sys.exit(2)


if __name__ == "__main__":
    main()

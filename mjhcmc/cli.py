"""The command line: ``mjhcmc solve`` and ``mjhcmc reproduce``.

Exit codes: 0 the verdict holds, 1 it fails, 2 bad input, 130 interrupted. Only what a command needs is imported, when
it runs, so that ``mjhcmc --help`` is instant.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
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
@click.option("--quiet", is_flag=True, help="No progress bar, no summary, no notices: errors only.")
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
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    import mjhcmc
    from mjhcmc.summary import numbers, screen

    click.get_current_context().with_resource(_engine_notices())
    muscle_model = mjhcmc.MuscleModel.load(model)
    read = mjhcmc.Motion.from_file(motion, muscle_model, lowpass, column_map=column_map, start=start, end=end)
    noise = read.noise_warning() if lowpass is None else None
    for notice in (*read.notices, *([noise] if noise else [])):
        warnings.warn(notice, MjhcmcWarning, stacklevel=1)
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
    import mjhcmc
    from mjhcmc.reproduce import reproduce as run

    click.get_current_context().with_resource(_engine_notices())
    if out is None and not as_json:
        out = Path("mjhcmc-reproduce")
    files: list[str] = []
    if out is None:
        with _progress_bar(as_json) as progress:
            result = run(movement, dt, physics_dt, progress)
    else:
        with _output_folder(out) as folder:
            try:
                with _progress_bar(as_json) as progress:
                    result = run(movement, dt, physics_dt, progress)
            except mjhcmc.SolveInterrupted as stop:
                if stop.solution is not None:
                    _write(stop.solution, folder)
                raise
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

    with _interrupt_later():
        paths = [solution.save(folder / "solution.parquet")]
        verdict = folder / "verdict.json"
        with written_whole(verdict) as temporary:
            temporary.write_text(json.dumps(solution.verdict.to_dict(), indent=2) + "\n")
    paths.append(verdict)
    paths += save_figure(excitation_figure(solution), folder / "excitations")
    paths += save_figure(tracking_figure(solution), folder / "tracking")
    return [str(path) for path in paths]


@contextmanager
def _engine_notices() -> Iterator[None]:
    """MuJoCo's warnings as notices; left alone, it prints them and writes a MUJOCO_LOG.TXT where the user stands."""
    import mujoco

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: warnings.warn(f"MuJoCo: {text}", MjhcmcWarning, stacklevel=1))
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def _interrupt_later() -> Iterator[None]:
    """Hold an interrupt back until the block ends, so that what was solved is kept; a second one does not wait."""
    with _held_back() as interrupted:
        yield
    if interrupted():
        raise KeyboardInterrupt


@contextmanager
def _held_back() -> Iterator[Callable[[], bool]]:
    """Hold an interrupt back; gives whether one came. A second one is let through."""
    came = False
    if threading.current_thread() is not threading.main_thread():  # interrupts never reach it
        yield lambda: came
        return

    def hold_back(*_: Any) -> None:
        nonlocal came
        came = True
        signal.signal(signal.SIGINT, before)

    before = signal.signal(signal.SIGINT, hold_back)
    try:
        yield lambda: came
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _output_folder(path: Path) -> Iterator[Path]:
    """Make the folder and see that it can be written, before the work; take it away again if the work fails."""
    made: list[Path] = []
    try:
        made = [folder for folder in (path, *path.parents) if not folder.exists()]
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
        with suppress(OSError):  # never made, or not empty
            folder.rmdir()


@contextmanager
def _progress_bar(hidden: bool) -> Iterator[Progress]:
    """A bar over the windows. An interrupt ends the work at the end of the window, a second one at once.

    Raised where it comes, an interrupt could fall into a callback from compiled code, which prints and drops it.
    """
    from tqdm import tqdm

    # disable=None hides the bar where standard error is no terminal
    with _held_back() as interrupted, tqdm(unit="window", leave=False, disable=True if hidden else None) as bar:

        def progress(done: int, count: int) -> None:
            bar.total = count
            bar.update(done - bar.n)
            if interrupted():
                raise KeyboardInterrupt

        yield progress


def _show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    if issubclass(category, MjhcmcWarning):
        click.echo(f"mjhcmc: notice: {_one_line(str(message))}", err=True)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; errors are one line on standard error and exit code 2."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            warnings.simplefilter("always", MjhcmcWarning)
            code = cli.main(arguments or ["--help"], prog_name="mjhcmc", standalone_mode=False)
    except click.ClickException as error:
        _fail(error.format_message())
    except MjhcmcError as error:
        _fail(str(error))
    except (KeyboardInterrupt, click.Abort):
        click.echo("mjhcmc: interrupted before the work was done", err=True)
        sys.exit(_INTERRUPTED)
    sys.exit(code)


def _fail(message: str) -> None:
    click.echo(f"mjhcmc: error: {_one_line(message)}", err=True)
    sys.exit(2)


def _one_line(message: str) -> str:
    return " ".join(message.split())


if __name__ == "__main__":
    main()

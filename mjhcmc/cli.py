"""The command line: ``mjhcmc solve``, ``reproduce``, ``check``, ``sensitivity``, ``engines`` and more.

Exit codes: 0 the verdict holds, 1 it fails, 2 bad input, 130 interrupted. Only what a command needs is imported, when
it runs, so that ``mjhcmc --help`` is instant.
"""

from __future__ import annotations

import json
import sys
import warnings
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjhcmc import __version__
from mjhcmc.cli_compare import compare_muscles
from mjhcmc.cli_completion import complete_values, completion
from mjhcmc.cli_doctor import doctor
from mjhcmc.cli_emg import emg_command
from mjhcmc.cli_engines import engines
from mjhcmc.cli_live import live
from mjhcmc.cli_patients import patients
from mjhcmc.cli_report import report_command
from mjhcmc.cli_sensitivity import sensitivity
from mjhcmc.cli_solve import solve
from mjhcmc.cli_support import (
    CURVES,
    FILE,
    INTERRUPTED,
    MUSCLE,
    NO_CACHE,
    QUIET,
    VERBOSE,
    engine_notices,
    fail,
    look_at,
    progress_bar,
    show_warning,
    told,
    typed,
    write_solution,
)
from mjhcmc.cli_view import view_command
from mjhcmc.errors import MjhcmcError, MjhcmcWarning
from mjhcmc.io.files import output_folder

if TYPE_CHECKING:
    from mjhcmc.solution import Solution


_EXAMPLES = """\b
Examples:
  mjhcmc reproduce --out paper                    the paper's experiment
  mjhcmc solve walk.mot --lowpass 6 --out walk    joint angles to excitations
  mjhcmc report walk                              a page to look at
  mjhcmc view walk                                replay it
  mjhcmc solve arm.sto --model arm.xml --out arm  any MuJoCo model with muscles
  mjhcmc check arm.xml                            what mjhcmc sees in a model
  mjhcmc doctor                                   what is installed, and what is not

Exit codes: 0 the verdict holds, 1 it fails, 2 bad input, 130 interrupted. Each command tells more: mjhcmc solve --help.
"""


class _InOrder(click.Group):
    """A group that lists its commands in the order in which they were added."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)


@click.group(
    cls=_InOrder, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}, epilog=_EXAMPLES
)
@click.version_option(__version__, prog_name="mjhcmc")
def cli() -> None:
    """Muscle excitations from motion, for any MuJoCo muscle model."""


@click.command()
@click.option("--movement", default="fast", show_default=True, metavar="fast|slow", help="fast is the paper's.")
@click.option("--dt", default=0.01, show_default=True, help="Control window, s.")
@click.option("--physics-dt", default=0.001, show_default=True, help="Largest physics step, s.")
@MUSCLE
@CURVES
@click.option(
    "--out", type=FILE, metavar="DIR", help="Folder for the results; ./mjhcmc-reproduce, or nothing with --json."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
@QUIET
@VERBOSE
def reproduce(
    movement: str, dt: float, physics_dt: float, muscle: str, curves: str, out: Path | None, as_json: bool,
    quiet: bool, verbose: int,
) -> int:  # fmt: skip
    """The paper's experiment, by every method: table, figures, verdict.

    \b
    Examples:
      mjhcmc reproduce
      mjhcmc reproduce --movement slow --dt .005 --out slow
      mjhcmc reproduce --muscle compliant --json
    """
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    click.get_current_context().with_resource(told(verbose))
    from mjhcmc.muscle_choice import check_muscle

    check_muscle(muscle, curves)
    import mjhcmc
    from mjhcmc.plotting import excitation_figure, save_figures
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
                    files = write_solution(stop.solution, folder)
                    files.append(_write_run(stop.solution, folder, None))
                    click.echo(f"written  {', '.join(files)}", err=True)
                raise
            files = write_solution(result.solutions["hcmc"], folder)
            overlay = None if result.opensim is None else {"OpenSim 4.6 CMC": result.opensim.activity}
            files += save_figures({"methods": partial(excitation_figure, result.solutions, overlay)}, folder)
            files.append(_write_run(result.solutions["hcmc"], folder, result.solve_time["hcmc"]))
    if as_json:
        click.echo(json.dumps(result.numbers()))
    elif not quiet:
        click.echo(result.screen())
        click.echo(f"written  {', '.join(files)}")
        if out is not None:
            click.echo(look_at(out))
    return 0 if result.passed else 1


def _write_run(solution: Solution, folder: Path, wall_time: float | None) -> str:
    """Write what HCMC's solution was made with; the path written."""
    from mjhcmc.run_facts import model_facts, run_facts, write_run

    assert solution.model is not None  # it was just solved
    facts = run_facts(
        command=typed(), model=model_facts(solution.model, "leg8"), solution=folder / "solution.parquet",
        wall_time=wall_time, interrupted=wall_time is None,
    )  # fmt: skip
    return write_run(folder, facts)


@click.command()
@click.argument("model")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of the report.")
@VERBOSE
def check(model: str, as_json: bool, verbose: int) -> int:
    """What mjhcmc sees in a model: muscles, joints, strength, and every problem with its remedy.

    \b
    Examples:
      mjhcmc check leg8
      mjhcmc check arm.xml --json
    """
    click.get_current_context().with_resource(told(verbose))
    from mjhcmc.model_check.check import check as look

    click.get_current_context().with_resource(engine_notices())
    report = look(model)
    click.echo(json.dumps(report.to_dict()) if as_json else report.screen())
    return 0


# in the order of their use, with the line that `mjhcmc --help` has of each
for _command, _line in (
    (solve, "motion files to excitations"),
    (reproduce, "the paper's experiment, by every method"),
    (report_command, "a page to look at, of what solve found"),
    (view_command, "replay: in a window, in the browser, as a video"),
    (live, "a page of sliders that solves as you drag them"),
    (emg_command, "excitations beside measured EMG"),
    (sensitivity, "which muscle parameter moves which excitation"),
    (check, "what mjhcmc sees in a model, and every problem with it"),
    (compare_muscles, "MuJoCo's muscles beside a Hill model's"),
    (patients, "virtual patients with spasticity: datasets, grades"),
    (engines, "rigid-body engines beside MuJoCo"),
    (doctor, "what is installed here, what works, what to do"),
    (completion, "completion of commands and values in your shell"),
):
    _command.short_help = _line
    cli.add_command(_command)
complete_values(cli)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; errors are one line on standard error and exit code 2."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        with warnings.catch_warnings():
            warnings.showwarning = show_warning
            warnings.simplefilter("always", MjhcmcWarning)
            code = cli.main(arguments or ["--help"], prog_name="mjhcmc", standalone_mode=False, obj=arguments)
    except click.ClickException as error:
        fail(error.format_message())
    except MjhcmcError as error:
        fail(str(error))
    except (KeyboardInterrupt, click.Abort):  # before RuntimeError, which Abort is
        click.echo("mjhcmc: interrupted before the work was done", err=True)
        sys.exit(INTERRUPTED)
    except ModuleNotFoundError as error:
        if (error.name or "mjhcmc").partition(".")[0] == "mjhcmc":
            raise
        fail(f"{error}: mjhcmc doctor tells what is missing here, and how to install it")
    except RuntimeError as error:
        if "MUJOCO_GL" in str(error):
            fail(f"{error}: set it to egl, osmesa or glfw, or unset it (mjhcmc doctor tells which work)")
        if NO_CACHE not in str(error):
            raise
        fail(f"compiled code can be kept nowhere ({error}): set NUMBA_CACHE_DIR to a folder that you may write to")
    sys.exit(code)


if __name__ == "__main__":
    main()

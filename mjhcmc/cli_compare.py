"""The command ``mjhcmc compare-muscles``."""

from __future__ import annotations

import json
import warnings
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjhcmc.cli_support import engine_notices, interrupt_later, progress_bar, told
from mjhcmc.errors import MjhcmcWarning
from mjhcmc.io.files import output_folder

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel
    from mjhcmc.muscle_comparison import MuscleComparison


@click.command()
@click.option("--movement", default="fast", show_default=True, metavar="fast|slow", help="A cosine movement.")
@click.option(
    "--model", default="leg8", show_default=True, metavar="MODEL", help="A shipped name or a path to an MJCF file."
)
@click.option(
    "--curves",
    default="millard",
    show_default=True,
    metavar="NAME",
    help="millard, thelen, degroote-fregly, or mujoco (a check).",
)
@click.option("--step", default=0.001, show_default=True, help="Largest step of the compliant fibers' motion, s.")
@click.option(
    "--out", type=click.Path(path_type=Path), metavar="DIR",
    help="Folder for the results; ./mjhcmc-compare-muscles, or nothing with --json.",
)  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
@click.option("--quiet", is_flag=True, help="No progress bar, no summary, no notices: errors only.")
@click.option("-v", "--verbose", count=True, help="Log what is done on standard error; twice: in detail.")
def compare_muscles(
    movement: str, model: str, curves: str, step: float, out: Path | None, as_json: bool, quiet: bool, verbose: int
) -> int:
    """MuJoCo's muscles against a Hill model along a movement: tables, figures.

    Writes DIR/muscles.csv, DIR/joints.csv, DIR/comparison.json and the figures of curves and forces.

    \b
    Example:
      mjhcmc compare-muscles --movement slow --curves thelen --out muscles
    """
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    click.get_current_context().with_resource(told(verbose))
    import mjhcmc
    from mjhcmc import muscle_comparison
    from mjhcmc.hill_muscles import hill_model

    click.get_current_context().with_resource(engine_notices())
    driven = mjhcmc.MuscleModel.load(model)
    muscles = hill_model(driven, curves)
    muscle_comparison.check_step(step)
    motion = mjhcmc.Motion.cosine(driven, movement)
    if out is None and not as_json:
        out = Path("mjhcmc-compare-muscles")

    def work() -> MuscleComparison:
        with progress_bar(quiet or as_json) as progress:
            solution = mjhcmc.hcmc(driven, motion, progress=progress)
        return muscle_comparison.compare_muscles(solution, muscles, step)

    files: list[str] = []
    if out is None:
        result = work()
    else:
        with output_folder(out) as folder:
            result = work()
            files = _write(result, driven, folder)
    if as_json:
        click.echo(json.dumps(result.numbers()))
    elif not quiet:
        click.echo(result.screen())
        click.echo(f"written  {', '.join(files)}")
    return 0


def _write(result: MuscleComparison, model: MuscleModel, folder: Path) -> list[str]:
    """Tables and figures into a folder; the paths written."""
    from mjhcmc.io.files import written_whole
    from mjhcmc.plotting import save_figure
    from mjhcmc.plotting.muscles import curve_figure, force_figure

    texts = {f"{name}.csv": "".join(f"{','.join(row)}\n" for row in rows) for name, rows in result.tables().items()}
    texts["comparison.json"] = json.dumps(result.numbers(), indent=2) + "\n"
    with interrupt_later():
        for name, text in texts.items():
            with written_whole(folder / name) as temporary:
                temporary.write_text(text, encoding="utf-8")
    paths = [folder / name for name in texts]
    for name, draw in {"curves": partial(curve_figure, model), "forces": partial(force_figure, result)}.items():
        paths += save_figure(draw(), folder / name)
    return [str(path) for path in paths]

"""The command ``mjhcmc emg``, and what ``solve`` needs for its EMG options."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjhcmc.cli_support import interrupt_later, told
from mjhcmc.errors import MjhcmcWarning, SettingsError
from mjhcmc.io.files import output_folder

if TYPE_CHECKING:
    from mjhcmc.emg import Emg
    from mjhcmc.emg_comparison import EmgComparison
    from mjhcmc.emg_targets import EmgTargets

_FILE = click.Path(path_type=Path)


@click.command("emg")
@click.argument("solution", type=_FILE)
@click.argument("emg", type=_FILE, metavar="EMG")
@click.option(
    "--map", "emg_map", type=_FILE, metavar="FILE",
    help='CSV with lines muscle,channel, or JSON: {"muscle": "channel"}; by default channels have muscles\' names.',
)  # fmt: skip
@click.option("--raw/--envelope", default=None, help="What the file holds; by default its values tell.")
@click.option("--band", type=float, nargs=2, metavar="LOW HIGH", help="Band-pass of raw EMG, Hz; 20 450 by default.")
@click.option("--lowpass", default=6.0, show_default=True, metavar="HZ", help="Low-pass of the rectified EMG.")
@click.option("--shift", default=0.0, show_default=True, metavar="S", help="Add to the EMG's times.")
@click.option("--delay", default=0.1, show_default=True, metavar="S", help="Largest lag of the best correlation.")
@click.option("--threshold", default=0.2, show_default=True, help="On above this share of a signal's range.")
@click.option("--start", type=float, metavar="S", help="Leave out what comes before.")
@click.option("--out", type=_FILE, metavar="DIR", help="Folder for emg.csv, emg.json and the figure; none by default.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
@click.option("--quiet", is_flag=True, help="No summary, no notices: errors only.")
@click.option("-v", "--verbose", count=True, help="Log what is done on standard error; twice: in detail.")
def emg_command(
    solution: Path, emg: Path, emg_map: Path | None, raw: bool | None, band: tuple[float, float] | None, lowpass: float,
    shift: float, delay: float, threshold: float, start: float | None, out: Path | None, as_json: bool, quiet: bool,
    verbose: int,
) -> int:  # fmt: skip
    """Compare the excitations of a SOLUTION (a folder that solve wrote, or its file) with measured EMG.

    EMG is a .csv, .sto, .mot or .parquet file with a column time and a column for each channel.

    \b
    Example:
      mjhcmc emg walk emg.csv --map map.csv --out emg
    """
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    click.get_current_context().with_resource(told(verbose))
    from mjhcmc.emg_comparison import compare_emg
    from mjhcmc.saved import solution_file
    from mjhcmc.solution import Solution

    found = Solution.load(solution_file(solution))
    measured, _ = envelopes_of(emg, emg_map, found.muscle_names, raw, band, lowpass, shift)
    result = compare_emg(found, measured, emg_map, delay=delay, threshold=threshold, start=start)
    files: list[str] = []
    if out is not None:
        with output_folder(out) as folder:
            files = _write(result, folder)
    if as_json:
        click.echo(json.dumps({**result.numbers(), "files": files}))
    elif not quiet:
        click.echo(result.screen())
        if files:
            click.echo(f"written  {', '.join(files)}")
    return 0


def envelopes_of(
    path: Path, emg_map: Path | None, muscles: tuple[str, ...], raw: bool | None, band: tuple[float, float] | None,
    lowpass: float, shift: float,
) -> tuple[Emg, bool]:  # fmt: skip
    """The channels of a file that measure a muscle, as envelopes; and whether the file holds raw signals."""
    from mjhcmc.emg import Emg
    from mjhcmc.io.emg_file import channel_map

    whole = Emg.from_file(path, raw=raw)
    chosen = whole.only(list(dict.fromkeys(channel_map(emg_map, muscles, whole.channels).values())))
    if chosen.raw:
        return chosen.envelope(band, lowpass).shifted(shift), True
    if band is not None:
        raise SettingsError(f"--band is of raw EMG, {path} holds envelopes: leave it out, or say --raw")
    return chosen.shifted(shift), False


def _read_mvc(path: Path) -> dict[str, float]:
    """Envelopes of maximum contractions by channel, from a JSON file; the values are checked later."""
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise SettingsError(f"EMG mvc {path}: cannot be read ({error.strerror}): check the path") from None
    except ValueError as error:
        raise SettingsError(f'EMG mvc {path}: not JSON ({error}): give {{"channel": value}}') from None
    if not isinstance(content, dict):
        raise SettingsError(f'EMG mvc {path}: holds no object: give {{"channel": value}}')
    return content


def _write(result: EmgComparison, folder: Path) -> list[str]:
    """Table, numbers and figure into a folder; the paths written."""
    from mjhcmc.io.files import written_whole
    from mjhcmc.plotting import save_figure
    from mjhcmc.plotting.emg import emg_figure

    texts = {
        "emg.csv": result.to_dataframe().to_csv(index=False),
        "emg.json": json.dumps(result.numbers(), indent=2) + "\n",
    }
    with interrupt_later():
        for name, text in texts.items():
            with written_whole(folder / name) as temporary:
                temporary.write_text(text, encoding="utf-8")
    paths = [folder / name for name in texts]
    return [str(path) for path in [*paths, *save_figure(emg_figure(result), folder / "emg")]]


def emg_options(command: Any) -> Any:
    """Decorator: the options of ``solve`` that `targets_from` takes."""
    options = (
        click.option("--emg", type=_FILE, metavar="FILE", help="EMG that activation is to follow, see docs/emg.md."),
        click.option("--emg-map", type=_FILE, metavar="FILE", help="Which channel measures which muscle."),
        click.option("--emg-weight", type=float, metavar="W", help="Weight of following it; 10 by default."),
        click.option("--emg-mvc", type=_FILE, metavar="FILE", help='JSON: {"channel": envelope of an MVC}.'),
        click.option(
            "--emg-delay", type=float, metavar="S", help="Excitation comes that much after EMG; 0 by default."
        ),
    )
    for option in reversed(options):
        command = option(command)
    return command


def targets_from(
    emg: Path | None, emg_map: Path | None, emg_weight: float | None, emg_mvc: Path | None, emg_delay: float | None,
    muscles: tuple[str, ...],
) -> EmgTargets | None:  # fmt: skip
    """What ``emg=`` of a method takes, from the options of ``solve``; None where there is no EMG.

    Raw EMG becomes envelopes with the default filters; without maximum contractions it is divided by its own peaks (a
    notice tells what that means); envelopes from a file are taken as divided already.

    Raises:
        SettingsError: options of EMG without a file of it, and as `emg_targets.EmgTargets`.
        MotionError: the files.
    """
    from mjhcmc.emg_targets import WEIGHT, EmgTargets

    if emg is None:
        for name, value in (("map", emg_map), ("weight", emg_weight), ("mvc", emg_mvc), ("delay", emg_delay)):
            if value is not None:
                raise SettingsError(f"--emg-{name} goes with --emg: name a file of EMG, or leave it out")
        return None
    from mjhcmc.emg import LOWPASS_HZ

    mvc = None if emg_mvc is None else _read_mvc(emg_mvc)
    measured, was_raw = envelopes_of(emg, emg_map, muscles, None, None, LOWPASS_HZ, 0.0)
    if mvc is not None:
        measured = measured.normalised({name: mvc[name] for name in measured.channels if name in mvc})
    elif was_raw:
        measured = measured.normalised()
    return EmgTargets(measured, emg_map, WEIGHT if emg_weight is None else emg_weight, emg_delay or 0.0)

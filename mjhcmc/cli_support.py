"""What the commands share: interrupts, notices, the progress bar."""

from __future__ import annotations

import json
import logging
import re
import shlex
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from mjhcmc.errors import MjhcmcWarning
from mjhcmc.log import get_logger

if TYPE_CHECKING:
    from mjhcmc.methods.run import Progress
    from mjhcmc.solution import Solution

INTERRUPTED = 130
"""Exit code after an interrupt."""

NO_CACHE = "cannot cache function"
"""In what Numba says where it finds no folder that it may write compiled code to."""

FILE = click.Path(path_type=Path)
QUIET = click.option("--quiet", is_flag=True, help="No progress bar, no summary, no notices: errors only.")
VERBOSE = click.option("-v", "--verbose", count=True, help="Log what is done on standard error; twice: in detail.")
MUSCLE = click.option(
    "--muscle", default="mujoco", show_default=True, metavar="mujoco|rigid|compliant",
    help="What drives the model: MuJoCo's own muscles, or Hill muscles with rigid or compliant tendons.",
)  # fmt: skip
CURVES = click.option(
    "--curves",
    default="millard",
    show_default=True,
    metavar="NAME",
    help="Of Hill muscles: millard, thelen, degroote-fregly.",
)

_log = get_logger(__name__)

_ENGINE_NOTICES = 5  # of MuJoCo shown in all; every one is in the log (-vv)
_ENGINE_KIND = re.compile(r" in Q[A-Z]+ at |\d")  # where, which number, when: what differs within one kind of warning


def _word(name: str) -> str:
    """A pattern of a Python name as a word of a message: in no path, and not quoted, as what users name is."""
    return rf"(?<![\w./\\'\"-]){name}(?![\w/\\'\"-]|\.\w)"


_NUMBER = r"-?(?:[\d.]|inf|nan)"
_IN_OPTIONS: tuple[tuple[re.Pattern[str], str], ...] = tuple(
    (re.compile(pattern), option)
    for pattern, option in (
        (_word("angle_unit"), "--unit"),
        (_word("column_map"), "--map"),
        (_word("joint_moments"), "--moments"),
        (r"(?<!the )\bintegrator[= ]'(\w+)'", r"--integrator \1"),
        (_word("lowpass_hz"), "--lowpass"),
        (_word("min_activation"), "--min-activation"),
        (_word("physics_dt"), "--physics-dt"),
        (_word("initial_(?:qpos|qvel|activation)"), "the start of the motion"),
        # plain words, where they are arguments
        (_word("dt") + rf"(?= {_NUMBER}| must|:|,|$)", "--dt"),
        (_word("disabled") + "(?=:| must| names every)", "--disable"),
        (r"(?<=to do nothing in )disabled\b", "--disable"),
        (_word("(smoothness|weights)") + r"(?= must| of \S+ must| span|:)", r"--\1"),
        (_word("angles") + "(?= ')", "--angles"),
        (_word("(start|end)") + rf"(?= {_NUMBER}\S* s\b)", r"--\1"),
        (r"\bwith start and end\b", "with --start and --end"),
        (r"\ba column map\b(?! \()", "a column map (--map)"),
    )
)
"""Names of arguments in messages of the library, and what a user of the command line knows them by."""


def in_options(message: str) -> str:
    """A message of the library in terms of the command line."""
    for pattern, option in _IN_OPTIONS:
        message = pattern.sub(option, message)
    return message


@contextmanager
def engine_notices() -> Iterator[None]:
    """MuJoCo's warnings as notices; left alone, it prints them and writes a MUJOCO_LOG.TXT where the user stands.

    One of a kind: a simulation that diverges warns of each joint's position, velocity and acceleration, at each try.
    """
    import mujoco

    shown: set[str] = set()

    def notice(text: str) -> None:
        _log.debug("MuJoCo: %s", text)
        kind = _ENGINE_KIND.split(text, maxsplit=1)[0]
        if kind not in shown and len(shown) < _ENGINE_NOTICES:
            shown.add(kind)
            warnings.warn(f"MuJoCo: {text}", MjhcmcWarning, stacklevel=1)

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(notice)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def interrupt_later() -> Iterator[None]:
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
def progress_bar(hidden: bool) -> Iterator[Progress]:
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


@contextmanager
def told(verbose: int) -> Iterator[None]:
    """Log records of mjhcmc on standard error: INFO with one -v, DEBUG with two."""
    if not verbose:
        yield
        return
    logger, handler = logging.getLogger("mjhcmc"), logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(name)s: %(message)s"))
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO if verbose == 1 else logging.DEBUG)
    try:
        yield
    finally:
        logger.setLevel(before)
        logger.removeHandler(handler)


def show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    """A notice as one line on standard error."""
    if issubclass(category, MjhcmcWarning):
        click.echo(f"mjhcmc: notice: {in_options(_one_line(str(message)))}", err=True)


@contextmanager
def kept_notices(quiet: bool) -> Iterator[list[str]]:
    """What is noticed within the block, as it is shown; with quiet it is kept, not shown."""
    kept: list[str] = []
    show = warnings.showwarning

    def keep(message: Warning | str, category: type[Warning], *rest: Any, **named: Any) -> None:
        ours = issubclass(category, MjhcmcWarning)
        if ours:
            kept.append(in_options(_one_line(str(message))))
        if not (ours and quiet):
            show(message, category, *rest, **named)

    warnings.showwarning = keep
    try:
        yield kept
    finally:
        warnings.showwarning = show


def fail(message: str) -> NoReturn:
    """One line on standard error, and exit code 2."""
    click.echo(f"mjhcmc: error: {in_options(_one_line(message))}", err=True)
    sys.exit(2)


def _one_line(message: str) -> str:
    return " ".join(message.split())


def typed() -> list[str]:
    """The arguments of the command that runs, as they were typed."""
    arguments = click.get_current_context().find_root().obj
    return list(arguments) if isinstance(arguments, list) else sys.argv[1:]


def look_at(folder: Path) -> str:
    """What to do next with a folder that holds a solution."""
    return f"look at it:  mjhcmc report {shlex.quote(str(folder))}"


def write_solution(solution: Solution, folder: Path, *, opensim: bool = False, draw: bool = True) -> list[str]:
    """Solution, verdict and, where asked for, figures into a folder; the paths written."""
    from mjhcmc.io.files import written_whole

    with interrupt_later():
        paths = [solution.save(folder / "solution.parquet")]
        verdict = folder / "verdict.json"
        with written_whole(verdict) as temporary:
            temporary.write_text(json.dumps(solution.verdict.to_dict(), indent=2) + "\n")
        paths.append(verdict)
        if opensim:
            from mjhcmc.io.export import export_opensim

            paths += export_opensim(solution, folder / "solution")
    if not draw:
        return [*map(str, paths)]
    from mjhcmc.plotting import excitation_figure, moment_figure, residual_figure, save_figures, tracking_figure

    figures = {"excitations": excitation_figure, "tracking": tracking_figure, "moments": moment_figure}
    if solution.residual.any():
        figures["residuals"] = residual_figure
    return [
        *map(str, paths),
        *save_figures({name: partial(figure, solution) for name, figure in figures.items()}, folder),
    ]

"""The command ``mjhcmc view``."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mjhcmc.cli_support import FILE, QUIET, VERBOSE, engine_notices, told
from mjhcmc.errors import MjhcmcWarning, SettingsError, SimulationError

if TYPE_CHECKING:
    from mjhcmc.methods.run import Progress
    from mjhcmc.solution import Solution

_SIZE = re.compile(r"(\d+)x(\d+)")
_OF_WHICH = {
    "port": ("browser",),
    "no_open": ("browser",),
    "at": ("image",),
    "fps": ("video",),
    "size": ("video", "image"),
    "speed": ("window", "video"),
    "start": ("window", "video"),
    "end": ("window", "video"),
    "ghost": ("window", "video", "image"),
    "camera": ("window", "video", "image"),
}
"""Which options belong to which ways of looking."""


@click.command("view")
@click.argument("solution", type=FILE)
@click.option("--model", metavar="M", help="The model that was driven; by default what run.json tells.")
@click.option("--browser", is_flag=True, help="On a page in the browser (extra view).")
@click.option("--port", type=click.IntRange(0, 65535), metavar="N", help="Of the page; 8080; 0: any that is free.")
@click.option("--no-open", is_flag=True, default=None, help="Do not open the page: only say where it is.")
@click.option("--video", type=FILE, metavar="FILE", help="Write a video, .mp4 (extra view) or .gif.")
@click.option("--image", type=FILE, metavar="FILE", help="Write one picture, .png or .jpg.")
@click.option("--at", type=float, metavar="S", help="Time of the picture; the middle.")
@click.option("--with-ghost/--no-ghost", "ghost", default=None, help="The desired pose, where it differs; shown.")
@click.option("--speed", type=float, metavar="X", help="Seconds of the motion in a second; 1. Slow motion: .25.")
@click.option("--fps", type=float, metavar="N", help="Frames in a second of the video; 30.")
@click.option("--size", metavar="WxH", help="Of video or picture, pixels; 720 high and as wide as the motion asks.")
@click.option("--start", type=float, metavar="S", help="Leave out what comes before.")
@click.option("--end", type=float, metavar="S", help="Leave out what comes after.")
@click.option("--camera", metavar="C", help="side, front, top, or the name of one of the model's cameras; side.")
@QUIET
@VERBOSE
def view_command(
    solution: Path, model: str | None, browser: bool, port: int | None, no_open: bool | None, video: Path | None,
    image: Path | None, at: float | None, ghost: bool | None, speed: float | None, fps: float | None, size: str | None,
    start: float | None, end: float | None, camera: str | None, quiet: bool, verbose: int,
) -> int:  # fmt: skip
    """Replay a SOLUTION (a folder that solve wrote, or its file) with muscles in the colour of their activation.

    In MuJoCo's window; with --browser on a page; with --video or --image in a file, for which no display is needed.
    In the window space pauses, arrows step, [ and ] change the speed, and the panel Control has a slider of time.

    \b
    Examples:
      mjhcmc view walk
      mjhcmc view walk --browser
      mjhcmc view walk --video walk.mp4 --speed .25
      mjhcmc view walk --image walk.png --at 1.25 --camera side
    """
    if quiet:
        warnings.simplefilter("ignore", MjhcmcWarning)
    click.get_current_context().with_resource(told(verbose))
    ways = [name for name, given in (("browser", browser), ("video", video), ("image", image)) if given]
    if len(ways) > 1:
        raise SettingsError(f"--{ways[0]} and --{ways[1]}: give one of them")
    way = ways[0] if ways else "window"
    given = {
        "port": port, "no_open": no_open, "at": at, "fps": fps, "size": size, "speed": speed, "start": start,
        "end": end, "ghost": ghost, "camera": camera,
    }  # fmt: skip
    chosen: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    for name in chosen:
        if way not in _OF_WHICH[name]:
            raise SettingsError(f"--{_option(name)} is {_of(_OF_WHICH[name])}: leave it out")
    if size is not None:
        chosen["width"], chosen["height"] = _pixels(chosen.pop("size"))
    if way == "window":
        from mjhcmc.viewing.window import check_window

        check_window()
    click.get_current_context().with_resource(engine_notices())
    found = _open(solution, model)
    if way == "browser":
        from mjhcmc.viewing.browser import PORT, view_in_browser

        view_in_browser(found, port=PORT if port is None else port, open_browser=not no_open, say=click.echo)
    elif way == "window":
        from mjhcmc.viewing.window import view

        view(found, **chosen)
    else:
        _write(found, video, image, chosen, quiet)
    return 0


def _option(name: str) -> str:
    return {"ghost": "with-ghost or --no-ghost", "no_open": "no-open"}.get(name, name)


def _of(ways: tuple[str, ...]) -> str:
    """Ways of looking, as messages say them."""
    return "of " + " and ".join("the window" if way == "window" else f"--{way}" for way in ways)


def _pixels(size: str) -> tuple[int, int]:
    """Width and height of --size."""
    match = _SIZE.fullmatch(size.strip().lower())
    if match is None:
        raise SettingsError(f"--size {size!r}: write width and height in pixels, such as 960x720")
    return int(match[1]), int(match[2])


def _open(path: Path, model: str | None) -> Solution:
    """The solution, with its model."""
    from mjhcmc.saved import open_saved

    saved = open_saved(path, model)
    if saved.solution.model is None:
        raise SimulationError(saved.why_no_model or f"{path}: its model was not found: name it with --model")
    return saved.solution


def _write(solution: Solution, video: Path | None, image: Path | None, chosen: dict[str, Any], quiet: bool) -> None:
    """A video or a picture, and where it is."""
    from mjhcmc.viewing.video import write_image, write_video

    if image is not None:
        written = write_image(solution, image, **chosen)
    else:
        assert video is not None
        with _frame_bar(quiet) as progress:
            written = write_video(solution, video, progress=progress, **chosen)
    if not quiet:
        click.echo(f"written  {written}")


@contextmanager
def _frame_bar(hidden: bool) -> Iterator[Progress]:
    """A bar over the frames."""
    from tqdm import tqdm

    # disable=None hides the bar where standard error is no terminal
    with tqdm(unit="frame", leave=False, disable=True if hidden else None) as bar:

        def progress(done: int, count: int) -> None:
            bar.total = count
            bar.update(done - bar.n)

        yield progress

"""Videos and stills of a solution, drawn without a window."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.checks import is_number
from mjhcmc.errors import OutputError, SettingsError
from mjhcmc.io.files import written_whole
from mjhcmc.offscreen import Canvas, gl_back_end
from mjhcmc.viewing.camera import Margins, check_camera, make_camera, natural_aspect
from mjhcmc.viewing.colours import activation_rgba
from mjhcmc.viewing.frames import Frames
from mjhcmc.viewing.legend import FOOT, HEAD, Legend, hidden_words
from mjhcmc.viewing.scene import MAX_GEOMS, Stage

if TYPE_CHECKING:
    from mjhcmc.methods.run import Progress
    from mjhcmc.solution import Solution

Image = NDArray[np.uint8]

VIDEOS, STILLS = (".mp4", ".gif"), (".png", ".jpg")

HEIGHT = 720
"""Pixels, unless told otherwise."""

_ASPECTS = (0.75, 16 / 9)  # of pictures whose size nobody chose

_SMALLEST, _LARGEST = 64, 4096  # pixels
_GIF_FPS = 50  # a GIF counts in hundredths, and players take one of them for a tenth of a second
_QUALITY = "18"  # of x264: no loss that is seen
_OF_SCALE = 32  # of a GIF's colours are those of activation, which few pixels have
_MOSAIC = 6  # frames that a GIF's colours are chosen from


def write_video(
    solution: Solution,
    path: str | Path,
    *,
    width: int | None = None,
    height: int | None = None,
    fps: float = 30.0,
    speed: float = 1.0,
    ghost: bool = True,
    camera: str = "side",
    start: float | None = None,
    end: float | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write a video of a solution: tendons in the colour of activation, the desired pose as a ghost. No display needed.

    Args:
        solution: with its model.
        path: the file; .mp4 (H.264; extra ``view``) or .gif.
        width: pixels, an odd one is raised by one for .mp4; None: as the shape of what moves has it.
        height: pixels, likewise; None: 720.
        fps: frames in each second of the video.
        speed: seconds of the motion in each second of the video: .25 is slow motion.
        ghost: whether the desired pose is shown where it differs.
        camera: ``side``, ``front``, ``top``, or the name of one of the model's cameras, see `make_camera`.
        start: s, on the motion's clock; None: from the beginning.
        end: s; None: to the end.
        progress: called with frames done and to do.

    Returns:
        The path.

    Raises:
        SettingsError: a size, fps, speed, span or camera that cannot be.
        OutputError: an unknown suffix, a folder that cannot be written, a missing extra, or no OpenGL.
        SimulationError: the solution does not know its model.
    """
    path = Path(path)
    _check_target(path, VIDEOS)
    check_size(width, height)
    check_rate("fps", fps, "30 is usual")
    check_rate("speed", speed, "1 is real time, .25 slow motion")
    if path.suffix.lower() == ".gif" and fps > _GIF_FPS:
        raise SettingsError(f"fps {fps:g}: a .gif shows at most {_GIF_FPS} frames a second: lower it, or write .mp4")
    if path.suffix.lower() == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise OutputError(f'{path}: .mp4 needs imageio-ffmpeg: pip install "mjhcmc[view]", or write .gif')
    frames = Frames.of(solution, fps=fps / speed, start=start, end=end)
    check_camera(frames.model, camera)
    gl_back_end()
    width, height = _size(frames, width, height, camera)
    if path.suffix.lower() == ".mp4":
        width, height = width + width % 2, height + height % 2  # H.264 halves the resolution of colour
    is_gif, n = path.suffix.lower() == ".gif", len(frames)
    samples = np.unique(np.linspace(0, n - 1, _MOSAIC).round().astype(int)).tolist() if is_gif else []
    pictures = _pictures(frames, [*samples, *range(n)], (width, height), ghost=ghost, camera=camera, speed=speed)
    with written_whole(path) as temporary:
        if is_gif:
            palette = _palette([next(pictures) for _ in samples])
            _write_gif(_counted(pictures, n, progress), temporary, fps, n, palette)
        else:
            _write_mp4(_counted(pictures, n, progress), temporary, fps, (width, height))
    return path


def write_image(
    solution: Solution,
    path: str | Path,
    *,
    at: float | None = None,
    width: int | None = None,
    height: int | None = None,
    ghost: bool = True,
    camera: str = "side",
) -> Path:
    """Write one picture of a solution, as `write_video` draws it.

    Args:
        solution: with its model.
        path: the file; .png or .jpg.
        at: s, on the motion's clock; None: the middle of the motion.
        width: pixels; None: as the shape of what moves has it.
        height: pixels; None: 720.
        ghost: as for `write_video`.
        camera: likewise.

    Returns:
        The path.

    Raises:
        SettingsError: a size, time or camera that cannot be.
        OutputError: an unknown suffix, a folder that cannot be written, or no OpenGL.
        SimulationError: the solution does not know its model.
    """
    path = Path(path)
    _check_target(path, STILLS)
    check_size(width, height)
    first, last = float(solution.time[0]), float(solution.time[-1])
    if at is not None and not (is_number(at) and first <= at <= last):
        raise SettingsError(f"at {at!r} s is outside the solution: give a time from {first:g} to {last:g} s")
    frames = Frames.of(solution)
    check_camera(frames.model, camera)
    width, height = _size(frames, width, height, camera)
    k = frames.at((first + last) / 2 if at is None else at)
    (picture,) = _pictures(frames, [k], (width, height), ghost=ghost, camera=camera, speed=None)
    from PIL import Image as Images

    with written_whole(path) as temporary:
        Images.fromarray(picture).save(temporary)
    return path


def check_size(width: int | None, height: int | None) -> None:
    """See that a picture can have this size.

    Raises:
        SettingsError: it cannot.
    """
    for name, value in (("width", width), ("height", height)):
        if value is None:
            continue
        if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or not _SMALLEST <= value <= _LARGEST:
            raise SettingsError(f"{name} must be from {_SMALLEST} to {_LARGEST} pixels, got {value!r}")


def _size(frames: Frames, width: int | None, height: int | None, camera: str) -> tuple[int, int]:
    """Pixels; what was not chosen is as the shape of the motion has it."""
    if width is not None and height is not None:
        return width, height
    aspect = float(np.clip(natural_aspect(frames, camera), *_ASPECTS))
    if width is not None:
        height = int(np.clip(round(width / aspect), _SMALLEST, _LARGEST))
        return width, height
    height = HEIGHT if height is None else height
    return int(np.clip(round(aspect * height), _SMALLEST, _LARGEST)), height


def check_rate(name: str, value: float, usual: str) -> None:
    """See that fps or speed is a number above 0.

    Raises:
        SettingsError: it is not.
    """
    if not (is_number(value) and math.isfinite(value) and value > 0):
        raise SettingsError(f"{name} must be a number above 0, got {value!r}: {usual}")


def _check_target(path: Path, suffixes: tuple[str, ...]) -> None:
    """See, before the work, that the file can be written."""
    if path.suffix.lower() not in suffixes:
        what = "videos" if suffixes is VIDEOS else "pictures"
        raise OutputError(f"{path}: {what} are written as {' or '.join(suffixes)}: change the suffix")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: cannot be written, there is no folder {path.parent}: create it first")
    if path.is_dir() or not os.access(path.parent, os.W_OK):
        raise OutputError(f"{path}: cannot be written: choose a folder that you may write to")


def _pictures(
    frames: Frames, which: list[int], size: tuple[int, int], *, ghost: bool, camera: str, speed: float | None
) -> Iterator[Image]:
    """Frames as pictures (height, width, 3), one after the other."""
    width, height = size
    stage = Stage(frames, ghost=ghost)
    eye = make_camera(frames, camera, aspect=width / height, margins=Margins(head=HEAD, foot=FOOT))
    seen = stage.shows_ghost(sorted(set(which)))
    hidden = hidden_words(frames) if ghost and not seen else ""
    legend = Legend(width, height, frames.title, speed=speed, ghost=seen, hidden=hidden)
    with Canvas(stage.model, width, height) as canvas:
        scene = mujoco.MjvScene(stage.model, MAX_GEOMS)
        for k in which:
            stage.show(k)
            stage.compose(scene, eye)
            yield legend.write_on(canvas.draw(scene), float(frames.time[k]))


def _counted(pictures: Iterator[Image], count: int, progress: Progress | None) -> Iterator[Image]:
    """The same, and progress told."""
    for done, picture in enumerate(pictures, start=1):
        yield picture
        if progress is not None:
            progress(done, count)


def _write_mp4(pictures: Iterator[Image], path: Path, fps: float, size: tuple[int, int]) -> None:
    """H.264 in colours that every player takes."""
    from imageio_ffmpeg import write_frames

    writer = write_frames(
        str(path), size, fps=fps, codec="libx264", pix_fmt_out="yuv420p", quality=None, macro_block_size=1,
        output_params=["-crf", _QUALITY, "-movflags", "+faststart"], ffmpeg_log_level="error",
    )  # fmt: skip
    writer.send(None)
    try:
        for picture in pictures:
            writer.send(np.ascontiguousarray(picture))
    finally:
        writer.close()
    if not path.is_file() or not path.stat().st_size:
        raise OSError("ffmpeg wrote nothing")


def _write_gif(pictures: Iterator[Image], path: Path, fps: float, count: int, palette: Any) -> None:
    """One set of colours for all frames, so that nothing flickers; delays in hundredths that keep the time."""
    from PIL import Image as Images

    indexed = [Images.fromarray(p).quantize(palette=palette, dither=Images.Dither.NONE) for p in pictures]
    ends = np.round(100 * np.arange(count + 1) / fps).astype(int)
    indexed[0].save(
        path, save_all=True, append_images=indexed[1:], duration=(10 * np.diff(ends)).tolist(), loop=0, optimize=False,
        disposal=1,
    )  # fmt: skip


def _palette(samples: list[Image]) -> Any:
    """256 colours: those of activation, and what else some frames have."""
    from PIL import Image as Images

    mosaic = Images.fromarray(np.concatenate(samples))
    scale = (255 * activation_rgba(np.linspace(0, 1, _OF_SCALE))[:, :3]).round().astype(np.uint8)
    found = mosaic.quantize(256 - _OF_SCALE, method=Images.Quantize.MEDIANCUT, dither=Images.Dither.NONE)
    found.putpalette(bytes((found.getpalette() or [])[: 3 * (256 - _OF_SCALE)]) + scale.tobytes())
    return found

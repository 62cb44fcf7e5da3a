"""MuJoCo's own viewer, playing a solution."""

from __future__ import annotations

import math
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from mjhcmc.errors import OutputError
from mjhcmc.offscreen import display_answers, has_display
from mjhcmc.viewing.camera import Margins, check_camera, make_camera
from mjhcmc.viewing.clock import HELP, Clock
from mjhcmc.viewing.frames import Frames, span_of
from mjhcmc.viewing.legend import scale_image
from mjhcmc.viewing.scene import Stage, quiet
from mjhcmc.viewing.video import check_rate

if TYPE_CHECKING:
    from mjhcmc.solution import Solution

REMEDY = "use --browser, or write a video with --video FILE.mp4"

_FPS = 240  # frames of the motion are made for slow motion, too
_MOST = 20_000  # frames, of long motions fewer a second
_TICK = 1 / 60  # s
_TEXTS = 0.1  # s: each new text waits for the window to be drawn
_HELP = 12.0  # s, that the keys are told
_SLIDER = b"time"
_OFF_GROUP = 7  # of actuators; those of a disabled group have no slider
_BRACKETS = (ord("["), ord("]"))
_LEGEND = 12  # pixels, height of its letters
_CLOSING = 5.0  # s, that the window may take to close


def view(
    solution: Solution,
    *,
    speed: float = 1.0,
    ghost: bool = True,
    camera: str = "side",
    loop: bool = True,
    start: float | None = None,
    end: float | None = None,
) -> None:
    """Play a solution in MuJoCo's viewer; returns when its window is closed (or with Ctrl-C).

    Tendons have the colour of activation; the desired pose is a ghost where it differs. Space pauses, arrows go by one
    control window, ``[`` and ``]`` (or ``-`` and ``=``) change the speed, Home and End go to the ends; the slider
    ``time`` in the panel Control moves through the motion.

    Args:
        solution: with its model.
        speed: seconds of the motion in each second.
        ghost: whether the desired pose is shown.
        camera: ``side``, ``front``, ``top``, or the name of one of the model's cameras, see `make_camera`.
        loop: whether it begins again at the end.
        start: s, on the motion's clock; None: from the beginning.
        end: s; None: to the end.

    Raises:
        SettingsError: a speed, span or camera that cannot be.
        OutputError: no window can be opened.
        SimulationError: the solution does not know its model.
    """
    check_rate("speed", speed, "1 is real time, .25 slow motion")
    check_window()
    first, last = span_of(solution, start, end)
    count = min(math.ceil(_FPS * (last - first)), _MOST)  # whole steps, so that the last frame is the end
    frames = Frames.of(solution, fps=count / (last - first), start=start, end=end)
    check_camera(frames.model, camera)
    model, slider = with_time_slider(frames.model, first, last)
    stage = Stage(replace(frames, model=model), ghost=ghost)
    clock = Clock(first, last, speed=speed, step=solution.dt, loop=loop)
    eye = make_camera(frames, camera, aspect=1.0, margins=Margins(head=0.05, foot=0.1))
    with suppress(KeyboardInterrupt):  # closes the window as well
        _play(stage, slider, clock, eye)


def check_window() -> None:
    """See that a window can be opened here.

    Raises:
        OutputError: it cannot.
    """
    if not has_display():
        raise OutputError(f"no window can be opened, there is no display (DISPLAY is not set): {REMEDY}")
    if sys.platform == "darwin":
        from mujoco import viewer

        if viewer._MJPYTHON is None:
            raise OutputError(
                "on macOS MuJoCo's window needs its own launcher: run mjpython -m mjhcmc view SOLUTION, or "
                f"{REMEDY.removeprefix('use ')}"
            )
        return
    if not display_answers():
        raise OutputError(f"no window can be opened, the display does not answer: {REMEDY}")


def with_time_slider(model: Any, first: float, last: float) -> tuple[Any, int]:
    """A copy of a model whose panel Control has one slider, ``time``; and the index of its control.

    The viewer makes sliders of actuators only, and a compiled model cannot be given another: one of its own is renamed,
    in the model's binary form, and the others go into a disabled group. The copy is for showing, not for simulating.

    Args:
        model: ``mujoco.MjModel`` with an actuator.
        first: s, at the slider's left.
        last: s, at its right.
    """
    ends = [model.names.index(b"\0", at) for at in model.name_actuatoradr]
    lengths = np.array(ends) - model.name_actuatoradr
    chosen = int(np.argmax(lengths >= len(_SLIDER)))  # the first whose name has room; 0 where none has
    raw = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, raw)
    content = raw.tobytes()
    if lengths[chosen] >= len(_SLIDER):
        at = content.index(model.names) + int(model.name_actuatoradr[chosen])
        after = at + int(lengths[chosen])
        content = content[:at] + _SLIDER.ljust(after - at, b"\0") + content[after:]
    m = mujoco.MjModel.from_binary_path("shown.mjb", {"shown.mjb": content})
    m.actuator_group[:] = _OFF_GROUP
    m.actuator_group[chosen] = 0
    m.opt.disableactuator = 1 << _OFF_GROUP
    m.actuator_ctrllimited[chosen] = 1
    m.actuator_ctrlrange[chosen] = first, last
    return m, int(m.actuator_ctrladr[chosen])


def _play(stage: Stage, slider: int, clock: Clock, camera: Any) -> None:
    """Open the window and keep it up to date until it is closed."""
    from mujoco.viewer import launch_passive

    keys: deque[int] = deque()
    before = set(threading.enumerate())
    frames, data = stage.frames, stage.data
    window = launch_passive(stage.model, data, key_callback=keys.append, show_left_ui=False)
    threads = set(threading.enumerate()) - before
    try:
        with window.lock():
            quiet(window.opt)
            _look(window.cam, camera)
        begun = last = time.perf_counter()
        texts_at, legend_at = -math.inf, None
        while window.is_running():
            while keys:
                key = keys.popleft()
                clock.press(key)
                if key in _BRACKETS:  # MuJoCo changes cameras by them
                    with window.lock():
                        window.cam.type = camera.type
                        window.cam.fixedcamid = camera.fixedcamid
            now = time.perf_counter()
            clock.advance(now - last)
            last = now
            told = clock.time
            with window.lock():
                stage.show(frames.at(told))
                data.time = told
                data.ctrl[slider] = told
                window.user_scn.ngeom = 0
                stage.add_to(window.user_scn)
            if now - texts_at > _TEXTS:
                window.set_texts(_texts(clock, frames, with_help=now - begun < _HELP))
                legend_at, texts_at = _put_legend(window, legend_at), now
            window.sync()
            if abs(data.ctrl[slider] - told) > 1e-9:  # somebody moved the slider
                clock.seek(float(data.ctrl[slider]))
            time.sleep(max(0.0, _TICK - (time.perf_counter() - now)))
    finally:
        window.close()
        for thread in threads:  # leaving while it closes its window would be an error of X
            thread.join(_CLOSING)


def _look(to: Any, camera: Any) -> None:
    """Look as another camera does."""
    to.type, to.fixedcamid = camera.type, camera.fixedcamid
    if camera.type == mujoco.mjtCamera.mjCAMERA_FREE:
        to.lookat[:], to.distance = camera.lookat, camera.distance
        to.azimuth, to.elevation = camera.azimuth, camera.elevation


def _texts(clock: Clock, frames: Frames, *, with_help: bool) -> list[tuple[Any, Any, str, str]]:
    """What stands in the corners of the window."""
    speed = f"x {clock.speed:g}" + ("" if clock.playing else ", paused")
    small, large = mujoco.mjtFontScale.mjFONTSCALE_100, mujoco.mjtFontScale.mjFONTSCALE_150
    place = mujoco.mjtGridPos
    keys, words = zip(*HELP, strict=True)
    told = (large, place.mjGRID_TOPLEFT, "time\nspeed", f"{clock.time:.3f} of {frames.time[-1]:.3f} s\n{speed}")
    return [told, (small, place.mjGRID_BOTTOMRIGHT, "\n".join(keys), "\n".join(words))] if with_help else [told]


def _put_legend(window: Any, before: tuple[int, int] | None) -> tuple[int, int] | None:
    """Put the scale of activation into the lower left corner, again where that has moved; gives where it is."""
    room = window.viewport
    if room is None:
        return before
    corner = (int(room.left) + 12, int(room.bottom) + 12)
    if corner != before:
        image = scale_image(_LEGEND)
        window.set_images((mujoco.MjrRect(*corner, image.shape[1], image.shape[0]), image))
    return corner

"""Drawing without a window: an OpenGL back end that works here, and a canvas on it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from types import TracebackType
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import OutputError

Image = NDArray[np.uint8]

_HEADLESS = ("egl", "osmesa")
_TRY = "import mujoco.{0}; context = mujoco.{0}.GLContext(16, 16); context.make_current(); context.free()"
_PATIENCE = 60.0  # s
_MOST_GEOMS = 10_000  # in a scene


def has_display() -> bool:
    """Whether the environment names a display, without which Linux has no windows."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def display_answers() -> bool:
    """Whether the display is there."""
    import glfw

    glfw.ERROR_REPORTING = "ignore"
    return bool(glfw.init())


@cache
def gl_back_end() -> str:
    """The OpenGL back end that pictures are drawn with: of MUJOCO_GL, or one that works without a display.

    Returns:
        ``egl`` or ``osmesa``; ``glfw`` where MUJOCO_GL is not set and there is a display, ``cgl`` and ``wgl`` likewise
        (each is MuJoCo's own choice).

    Raises:
        OutputError: MUJOCO_GL switches drawing off, or there is neither a display nor EGL nor OSMesa.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    if asked in ("disable", "disabled", "off", "false", "0"):
        raise OutputError(f"MUJOCO_GL={asked} switches drawing off: unset it, or set it to egl or osmesa")
    if asked in _HEADLESS and sys.platform.startswith("linux"):
        return asked
    if not sys.platform.startswith("linux"):
        return {"darwin": "cgl", "win32": "wgl"}.get(sys.platform, "glfw")
    if has_display() and display_answers():
        return "glfw"
    for name in _HEADLESS:  # in processes of their own: what fails to load here could not be taken back
        environment = {**os.environ, "MUJOCO_GL": name, "PYOPENGL_PLATFORM": name}
        with suppress(OSError, subprocess.TimeoutExpired):
            tried = subprocess.run(
                [sys.executable, "-c", _TRY.format(name)], env=environment, capture_output=True, timeout=_PATIENCE,
                check=False,
            )  # fmt: skip
            if tried.returncode == 0:
                return name
    raise OutputError(
        "pictures cannot be drawn: there is no display, and neither EGL nor OSMesa works: install one of them (Debian "
        "and Ubuntu: apt install libegl1, or libosmesa6)"
    )


def _context(name: str, width: int, height: int) -> Any:
    """An OpenGL context, whatever MuJoCo chose when it was imported."""
    if name in _HEADLESS:
        return import_module(f"mujoco.{name}").GLContext(width, height)
    from mujoco.gl_context import GLContext

    return GLContext(width, height)


@contextmanager
def _told(name: str) -> Iterator[None]:
    """MuJoCo's C code looks into the environment for where OpenGL's functions are."""
    if name not in _HEADLESS or "MUJOCO_GL" in os.environ:
        yield
        return
    os.environ["MUJOCO_GL"] = name
    try:
        yield
    finally:
        del os.environ["MUJOCO_GL"]


class Canvas:
    """A picture of fixed size in memory that scenes are drawn on; use it as a context manager.

    Args:
        model: ``mujoco.MjModel``; its ``vis.global_.offwidth`` and ``offheight`` are raised to the size where smaller.
        width: pixels.
        height: pixels.

    Raises:
        OutputError: no OpenGL is to be had.
    """

    def __init__(self, model: Any, width: int, height: int) -> None:
        name = gl_back_end()
        size = model.vis.global_
        size.offwidth, size.offheight = max(size.offwidth, width), max(size.offheight, height)
        try:
            with _told(name):
                self._gl = _context(name, width, height)
                self._gl.make_current()
                self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        except Exception as error:  # each back end raises its own kind
            raise OutputError(
                f"pictures cannot be drawn: no OpenGL by {name} ({error}): set MUJOCO_GL to egl or osmesa and install "
                "that library"
            ) from error
        self._scene: Any = None
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._shape = (height, width, 3)

    def draw(self, scene: Any) -> Image:
        """(height, width, 3) the picture of a ``mujoco.MjvScene``."""
        self._gl.make_current()
        mujoco.mjr_render(self._rect, scene, self._context)
        pixels: Image = np.empty(self._shape, np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._context)
        return pixels[::-1]

    def picture(self, model: Any, data: Any, camera: int | str | None = None, option: Any = None) -> Image:
        """(height, width, 3) what a camera sees of a model.

        Args:
            model: ``mujoco.MjModel``, the canvas' own.
            data: ``mujoco.MjData``, brought forward.
            camera: number or name of one of the model's; None: MuJoCo's free camera.
            option: ``mujoco.MjvOption``; None: the usual.
        """
        if self._scene is None:
            self._scene = mujoco.MjvScene(model, _MOST_GEOMS)
        seen = mujoco.MjvCamera()
        if camera is None:
            mujoco.mjv_defaultFreeCamera(model, seen)
        else:
            seen.type = mujoco.mjtCamera.mjCAMERA_FIXED.value
            seen.fixedcamid = model.camera(camera).id
        mujoco.mjv_updateScene(
            model, data, option or mujoco.MjvOption(), None, seen, mujoco.mjtCatBit.mjCAT_ALL.value, self._scene
        )
        return np.ascontiguousarray(self.draw(self._scene))

    def close(self) -> None:
        """Give the memory back."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()

    def __enter__(self) -> Canvas:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()

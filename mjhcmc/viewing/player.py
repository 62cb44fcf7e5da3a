"""Playing frames in the browser: time, speed, ghost, which muscle is which, how active each is now."""

from __future__ import annotations

import atexit
import html
import threading
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.log import get_logger
from mjhcmc.viewing.browser_scene import GHOST, Scene
from mjhcmc.viewing.colours import activation_rgba, hex_colour
from mjhcmc.viewing.echo import echo
from mjhcmc.viewing.frames import Frames
from mjhcmc.viewing.poses import Poses, ghost_bodies
from mjhcmc.viewing.scene import GHOST_RGBA

Array = NDArray[np.float64]

RATE = 25.0
"""Pictures a second."""

MOST_BARS = 24
"""Muscles with a bar; of more, those that are most active at some time."""

MAGNIFIED = 500
"""Largest factor of the ghost's distance: errors of HCMC are hundredths of a degree."""

_WORDS_RATE = 8.0  # updates a second of numbers and bars
_SPEEDS = (0.05, 2.0)
_PATIENCE = 0.25  # s, that a picture waits for browsers to have drawn the one before
_FADES = 0.9  # of that time, from picture to picture
_SLOW = 0.06  # s: a browser that takes longer over a picture draws without a GPU, and is given time for the rest
_WATCHED = 4.0  # s, that a movement should last on the screen, if it can

_log = get_logger(__name__)


class Player:
    """Plays frames in a viser scene; a thread of its own moves them.

    Args:
        server: a ``viser.ViserServer``.
        frames: what is played first.
    """

    def __init__(self, server: Any, frames: Frames) -> None:
        self._server, self._frames = server, frames
        self._lock = threading.RLock()
        self._poses = Poses.of(frames)
        self.scene = Scene(server, frames.model, self._poses)
        self._ghost: tuple[Array, Array] | None = None
        self._time = 0.0  # since the first frame
        self._dirty, self._drawn = True, -1
        self._selected: int | None = None  # a tendon
        self._label: Any = None
        self._taken = 0.0  # s, that browsers took for one of the last pictures
        self._held_until = self._last = 0.0  # on the clock of time.perf_counter
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="mjhcmc-player", daemon=True)

    def add_playback(self) -> None:
        """The controls of time and ghost, into the GUI's present container."""
        gui, frames = self._server.gui, self._frames
        self._play = gui.add_button("Pause")
        self._slider = gui.add_slider("Time, s", 0.0, frames.duration, 0.001, 0.0)
        self._speed = gui.add_slider("Speed", *_SPEEDS, 0.05, fair_speed(frames.duration))
        self._show_ghost = gui.add_checkbox(
            "Ghost", True, hint="The desired motion; inside the bones, and not seen, where the model is on it"
        )
        self._factor = gui.add_slider(
            "Error ×", 1, MAGNIFIED, 1, 1, hint="How many times farther from the model the ghost is drawn"
        )
        if self.scene.has_skin:
            skin = gui.add_checkbox("Skin", False, hint="What is translucent in the model; it pales the muscles")
            skin.on_update(lambda _: self.scene.show_skin(bool(skin.value)))
        self.playing = True
        self._play.on_click(lambda _: self.set_playing(not self.playing))

        self._slider.on_update(self._slid)
        self._show_ghost.on_update(self._ghost_changed)
        self._factor.on_update(self._ghost_changed)

    def _slid(self, event: Any) -> None:
        if event.client_id is not None:  # not from the thread that plays
            self.set_playing(False)
            self.seek(float(self._slider.value))

    def _ghost_changed(self, _: Any) -> None:
        with self._lock:
            self.scene.show_ghost(bool(self._show_ghost.value))
            self._magnify()
            self._dirty = True

    def add_muscles(self) -> None:
        """The colours' legend and the muscles' bars, into the GUI's present container."""
        gui = self._server.gui
        gui.add_html(colour_legend())
        self._picked = gui.add_html(_note("Click a muscle to see which it is."))
        self._bars = gui.add_html("")
        self.scene.on_tendon(self._pick)

    def start(self) -> None:
        """Begin to play; after the controls are there."""
        self._magnify()
        self._thread.start()
        atexit.register(self.close)  # at the interpreter's end, a thread in compiled code would crash

    def close(self) -> None:
        """End the thread."""
        atexit.unregister(self.close)
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join()

    @property
    def time(self) -> float:
        """s since the first frame."""
        return self._time

    def set_playing(self, playing: bool) -> None:
        """Play or pause."""
        with self._lock:
            self.playing = playing
            self._play.label = "Pause" if playing else "Play"

    def seek(self, since: float) -> None:
        """Go to a time, s since the first frame."""
        with self._lock:
            self._time, self._dirty = since, True

    def hold(self, seconds: float) -> None:
        """Leave the processor to something else for so long, if a browser draws pictures on it; 0 ends it."""
        self._held_until = time.perf_counter() + seconds

    def swap(self, frames: Frames) -> None:
        """Play other frames of the same model, at the same phase."""
        poses = Poses.of(frames, pieces=self.scene.pieces)
        with self._lock:
            before = max(self._frames.duration, 1e-9)
            self._time *= frames.duration / before
            self._frames, self._poses, self._dirty = frames, poses, True
            if self._slider.max != frames.duration:
                self._slider.max = frames.duration
            self._magnify()

    def _magnify(self) -> None:
        factor = float(self._factor.value)
        self._ghost = None if factor == 1.0 else ghost_bodies(self._frames, factor)

    def _pick(self, piece: int | None) -> None:
        with self._lock:
            k = self._frames.at(self._frames.time[0] + self._time)
            if piece is None or piece >= self._poses.tendon.shape[1] or self._poses.tendon[k, piece] < 0:
                return
            tendon = int(self._poses.tendon[k, piece])
            self._selected = None if tendon == self._selected else tendon
            self._dirty = True

    def _run(self) -> None:
        last, words_due, period = time.perf_counter(), 0.0, 1.0 / RATE
        while not self._closed.wait(period):
            now = time.perf_counter()
            passed, last = now - last, now
            try:
                with self._lock:
                    if not self._server.get_clients() or self._rests(now):
                        continue  # nobody looks, or is not done with the last picture
                    if self.playing:
                        self._time += passed * float(self._speed.value)
                        if self._time > self._frames.duration:
                            self._time %= max(self._frames.duration, 1e-9)
                    changed = self._draw()
                    if (changed or not self.playing) and now >= words_due:
                        words_due = now + 1.0 / _WORDS_RATE
                        self._write()
                if changed:
                    self._wait_for_browsers()
            except Exception:  # a page that goes away must not end the others'
                _log.exception("a frame could not be shown")

    def _rests(self, now: float) -> bool:
        """Whether a slow browser is left alone: as long as it drew, or while something more important is on its way."""
        return self._taken > _SLOW and (now < self._last + self._taken or now < self._held_until)

    def _wait_for_browsers(self) -> None:
        """Send no picture before the last one is drawn: what a browser cannot draw would come late, and all at once."""
        self._server.flush()
        began = time.perf_counter()
        for client in self._server.get_clients().values():
            echo(client, _PATIENCE)
        self._last = time.perf_counter()
        self._taken = max(self._last - began, _FADES * self._taken)  # one that had rested answers at once

    def _draw(self) -> bool:
        k = self._frames.at(self._frames.time[0] + self._time)
        if k == self._drawn and not self._dirty:
            return False
        self.scene.show(self._poses, k, self._ghost)
        self._name_selected(k)
        self._drawn, self._dirty = k, False
        return True

    def _write(self) -> None:
        k = max(self._drawn, 0)
        shown = round(float(self._frames.time[k] - self._frames.time[0]), 3)
        if self.playing and self._slider.value != shown:
            self._slider.value = shown
        frames = self._frames
        content = bars(frames.muscle_names, frames.activation[k], frames.excitation[k], shown_muscles(frames))
        if self._bars.content != content:
            self._bars.content = content

    def _name_selected(self, k: int) -> None:
        """The name at the muscle that was clicked."""
        frames, tendon = self._frames, self._selected
        if tendon is None:
            if self._label is not None:
                self._label.visible = False
                self._picked.content = _note("Click a muscle to see which it is.")
            return
        muscles = np.flatnonzero(frames.tendon_of_muscle == tendon)
        own = np.flatnonzero((self._poses.tendon[k] == tendon) & (self._poses.length[k] > 0))
        name = ", ".join(frames.muscle_names[i] for i in muscles) or "a tendon without muscle"
        if own.size:
            at = self._poses.middle[k, own[np.argmax(self._poses.length[k, own])]]
            if self._label is None or self._label.text != name:
                self._label = self._server.scene.add_label("/picked", name, anchor="center-left")
            self._label.position, self._label.visible = at, True
        numbers = "".join(
            f"<b>{html.escape(frames.muscle_names[i])}</b>: activation {frames.activation[k, i]:.2f}, "
            f"excitation {frames.excitation[k, i]:.2f}<br>"
            for i in muscles
        )
        content = f'<div style="font-size:12px;padding:2px 12px">{numbers or html.escape(name)}</div>'
        if self._picked.content != content:
            self._picked.content = content


def fair_speed(duration: float) -> float:
    """1, or less so that a short movement can be followed; a step of the slider."""
    return round(float(np.clip(np.floor(duration / _WATCHED / 0.05 + 1e-9) * 0.05, 0.1, 1.0)), 9)


def shown_muscles(frames: Frames) -> NDArray[np.intp]:
    """The muscles that have a bar, in the model's order."""
    n = len(frames.muscle_names)
    if n <= MOST_BARS:
        return np.arange(n)
    return np.sort(np.argsort(-frames.activation.max(axis=0), kind="stable")[:MOST_BARS])


def bars(names: Sequence[str], activation: Array, excitation: Array, which: NDArray[np.intp]) -> str:
    """HTML: a bar of activation in its colour for each muscle, and a mark at its excitation."""
    colours = activation_rgba(activation)
    rows = "".join(
        '<div style="display:flex;align-items:center;height:17px">'
        f'<span style="flex:0 0 104px;overflow:hidden;text-overflow:ellipsis;white-space:nowrap" '
        f'title="{html.escape(names[i])}">{html.escape(names[i])}</span>'
        '<span style="flex:1;position:relative;height:11px;background:#86929e26;border-radius:2px">'
        f'<span style="position:absolute;left:0;top:0;bottom:0;border-radius:2px;background:{hex_colour(colours[i])};'
        f'width:{100 * float(np.clip(activation[i], 0, 1)):.1f}%"></span>'
        f'<span style="position:absolute;top:-1px;bottom:-1px;width:2px;background:currentColor;'
        f'left:{100 * float(np.clip(excitation[i], 0, 1)):.1f}%"></span></span>'
        f'<span style="flex:0 0 34px;text-align:right;font-variant-numeric:tabular-nums">{activation[i]:.2f}</span>'
        "</div>"
        for i in which
    )
    note = f"{len(which)} of {len(names)} muscles, largest peaks; " if len(which) < len(names) else ""
    return (
        f'<div style="font-size:12px;padding:0 12px 6px">{rows}'
        f'<div style="color:#868e96;padding-top:3px">{note}bar: activation, mark: excitation</div></div>'
    )


def colour_legend() -> str:
    """HTML: the scale of activation, and the ghost's colour."""
    steps = ",".join(hex_colour(rgba) for rgba in activation_rgba(np.linspace(0, 1, 9)))
    ghost = "rgb({},{},{})".format(*GHOST)
    return (
        '<div style="font-size:12px;padding:4px 12px"><div style="display:flex;align-items:center;gap:8px">'
        f'<span>activation 0</span><span style="flex:1;height:9px;border-radius:3px;'
        f'background:linear-gradient(90deg,{steps})"></span><span>1</span>'
        f'<span style="width:9px;height:9px;border-radius:3px;background:{ghost};opacity:{GHOST_RGBA[3]};'
        'margin-left:8px"></span>'
        "<span>desired</span></div></div>"
    )


def _note(words: str) -> str:
    return f'<div style="font-size:12px;padding:2px 12px;color:#868e96">{words}</div>'

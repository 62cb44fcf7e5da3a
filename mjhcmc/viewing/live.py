"""The live page: drag a movement or a reflex, and see the excitations that follow."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mjhcmc.errors import SettingsError, SimulationError
from mjhcmc.model import MuscleModel
from mjhcmc.patients.groups import GROUPS
from mjhcmc.viewing.browser import HOST, PORT, style
from mjhcmc.viewing.echo import echo
from mjhcmc.viewing.frames import Frames
from mjhcmc.viewing.live_reflex import LARGEST_GAIN, LARGEST_THRESHOLD, Reflex, has_fibers
from mjhcmc.viewing.live_solver import LiveJoint, LiveRequest, LiveResult, LiveSolver
from mjhcmc.viewing.live_words import about_words, beside_words, latency_words, verdict_words
from mjhcmc.viewing.newest import Newest
from mjhcmc.viewing.server import serve, start_server, stop_server, url_of

_KEPT = 50  # latencies, for their median
_ALL = "all muscles"
_FIRST = {"hip": 10.0, "knee": -20.0, "ankle": -10.0}  # deg: the paper's
_PERIOD = 0.3  # s, at first
_PATIENCE = 1.0  # s, that a result waits for the browser to have drawn its excitations
_OFTEN = 0.25  # s, at least so often the replay is that of the newest result, while one drags
_THRESHOLD = 0.1  # lopt/s, at first
_SHARE = 0.3  # of its range, that the first joint of other models moves at first


class LivePage:
    """A live page that is being served. Build it with `live_page`.

    Attributes:
        solver: what solves; only the page's own thread may use it.
        server: the ``viser.ViserServer``.
        player: plays the newest movement.
        charts: curves of the newest solution.
        sent: s, of the last results, from a slider's event at the server to the excitations on their way.
        seen: s, to the answer of the browser whose slider it was that they are drawn: the way there, a picture, and the
            way back, which stands for that of the slider's event. Nothing of results that no browser asked for.
        result: the newest.
        shown: how many results there were.
    """

    def __init__(self, solver: LiveSolver, host: str, port: int) -> None:
        from mjhcmc.viewing.charts import Charts
        from mjhcmc.viewing.player import Player

        self.solver = solver
        self.sent, self.seen = deque[float](maxlen=_KEPT), deque[float](maxlen=_KEPT)
        self._asker: Any = None  # the browser that moved a slider last
        self._swapped = 0.0  # when the replay was
        self._healthy: LiveResult | None = None
        self.shown = 0
        self._has_reflex = has_fibers(solver.model)
        self.server = start_server(host, port)
        gui = self.server.gui
        try:
            style(self.server, "live")
            with gui.add_folder("Movement"):
                self._amplitudes = [self._amplitude_slider(joint, i) for i, joint in enumerate(solver.joints)]
                least, most, step = solver.periods
                self._period = gui.add_slider("Period, s", least, most, step, _nearest(_PERIOD, least, most, step))
            if self._has_reflex:
                self._add_reflex(gui)
            with gui.add_folder("Result"):
                self._latency, self._verdict, self._beside = (gui.add_html("") for _ in range(3))
                gui.add_html(about_words(solver, self._has_reflex))
            self.result = solver.solve(self._request())
            if self.result.solution is None:
                raise SimulationError(f"the first movement cannot be solved: {self.result.error}")
            self.player = Player(self.server, Frames.of(self.result.solution))
            with gui.add_folder("Replay"):
                self.player.add_playback()
                self.player.add_muscles()
            self.charts = Charts(self.server, self.result.solution, self.result.reflex if self._has_reflex else None)
        except BaseException:
            stop_server(self.server)
            raise
        self._newest = Newest(solver, self._show, self._compare)
        for slider in (*self._amplitudes, self._period):
            slider.on_update(self._ask)
        self.player.start()
        self._ask()

    @property
    def url(self) -> str:
        """Where the page is."""
        return url_of(self.server)

    @property
    def busy(self) -> bool:
        """Whether a request waits."""
        return self._newest.busy

    def slider(self, name: str) -> Any:
        """The slider of a joint, or ``"period"``, ``"gain"``, ``"threshold"``: its ``value`` is what it shows."""
        named = {joint.name: slider for joint, slider in zip(self.solver.joints, self._amplitudes, strict=True)}
        more = {"gain": self._gain, "threshold": self._threshold} if self._has_reflex else {}
        return (named | {"period": self._period} | more)[name]

    def words(self, part: str) -> str:
        """What stands (HTML) under ``"latency"``, ``"verdict"`` or ``"beside"`` (patient and healthy)."""
        return str({"latency": self._latency, "verdict": self._verdict, "beside": self._beside}[part].content)

    def close(self) -> None:
        """End what runs, and the page."""
        self._end()
        stop_server(self.server)

    def _end(self) -> None:
        self._newest.close()
        self.player.close()

    def _amplitude_slider(self, joint: LiveJoint, i: int) -> Any:
        first = _FIRST.get(joint.name, 0.0) if set(_FIRST) <= {j.name for j in self.solver.joints} else None
        if joint.is_rotation:
            low, high, step, unit = np.rad2deg(joint.low), np.rad2deg(joint.high), 0.5, "deg"
        else:
            low, high, step, unit = 1e3 * joint.low, 1e3 * joint.high, 1.0, "mm"
        low, high = step * np.ceil(low / step - 1e-9), step * np.floor(high / step + 1e-9)
        if first is None:
            first = 0.0 if i else _SHARE * (high if high > -low else low)
        value = float(np.clip(step * round(first / step), low, high))
        return self.server.gui.add_slider(f"{joint.name}, {unit}", float(low), float(high), step, value)

    def _add_reflex(self, gui: Any) -> None:
        names = self.solver.model.muscle_names
        groups = {group.replace("_", " "): own for group, own in GROUPS.items() if set(own) <= set(names)}
        self._choices = {_ALL: (), **groups, **{name: (name,) for name in names}}
        with gui.add_folder("Stretch reflex"):
            self._gain = gui.add_slider(
                "Gain, s", 0.0, LARGEST_GAIN, 0.005, 0.0,
                hint="Excitation per optimal fiber length a second of stretch beyond the threshold; 0: healthy",
            )  # fmt: skip
            self._threshold = gui.add_slider(
                "Threshold", 0.0, LARGEST_THRESHOLD, 0.05, _THRESHOLD, hint="Optimal fiber lengths a second"
            )
            self._who = gui.add_dropdown("In", tuple(self._choices), initial_value=_ALL)
        for handle in (self._gain, self._threshold, self._who):
            handle.on_update(self._ask)

    def _request(self) -> LiveRequest:
        """What the sliders say."""
        amplitudes = tuple(
            float(np.deg2rad(slider.value) if joint.is_rotation else slider.value / 1e3)
            for joint, slider in zip(self.solver.joints, self._amplitudes, strict=True)
        )
        amplitudes = tuple(
            float(np.clip(a, joint.low, joint.high)) for a, joint in zip(amplitudes, self.solver.joints, strict=True)
        )
        reflex = Reflex()
        if self._has_reflex:
            muscles = self._choices[str(self._who.value)]
            reflex = Reflex(float(self._gain.value), float(self._threshold.value), muscles)
        return LiveRequest(amplitudes, float(self._period.value), reflex, time.perf_counter())

    def _ask(self, event: Any = None) -> None:
        request = self._request()
        self._asker = None if event is None else event.client
        self.player.hold(_OFTEN)
        self._newest.ask(request)

    def _show(self, result: LiveResult) -> None:
        """What matters first, the excitations, and once the browser has drawn them the rest."""
        solution, asker = result.solution, self._asker
        if solution is not None:
            with self.server.atomic():
                self.charts.show_muscles(solution, result.reflex)
            self.server.flush()
        self.sent.append(time.perf_counter() - result.request.asked)
        answered = solution is not None and asker is not None and echo(asker, _PATIENCE) is not None
        if answered:
            self.seen.append(time.perf_counter() - result.request.asked)
        self._latency.content = latency_words(self.seen if answered else (), self.sent, result)
        self._verdict.content = verdict_words(result)
        if solution is not None:
            self.result = result
            with self.server.atomic():
                self.charts.show_joints(solution)
            now = time.perf_counter()
            if not self.busy or now > self._swapped + _OFTEN:
                self._swapped = now
                self.player.swap(Frames.of(solution))
        self.shown += 1

    def _compare(self, result: LiveResult) -> None:
        """While nothing waits: the same movement without a reflex, beside it."""
        if result.solution is None:
            self._beside.content = ""
            return
        if result.request.reflex.gain == 0:
            self._healthy = result
        elif self._healthy is None or not self._healthy.request.same_movement(result.request):
            self._healthy = self.solver.solve(result.request.healthy, self._newest.give_up_if_asked)
        self._beside.content = beside_words(result, self._healthy)


def live_page(
    model: MuscleModel | str | Path = "leg8",
    *,
    dt: float = 0.01,
    physics_dt: float = 0.001,
    port: int = PORT,
    host: str = HOST,
    open_browser: bool = True,
    block: bool = True,
    say: Callable[[str], None] = print,
) -> LivePage:
    """A page with sliders for a movement and a stretch reflex, solved again as one drags (extra ``view``).

    Each joint goes out of the reference pose and back along a cosine (`Motion.cosine`). A reflex adds excitation where
    fibers are stretched faster than a threshold; the other muscles work against it (see `Imposed`). Only the newest
    request is solved. All browsers that look share the sliders.

    Args:
        model: what `MuscleModel.load` takes.
        dt: s, control window.
        physics_dt: s, physics step.
        port: of the page; 0: any that is free.
        host: to listen on. The default is reached from this machine only; nothing asks for a password.
        open_browser: open the page.
        block: wait for Ctrl-C. Otherwise return at once; `LivePage.close` ends the page.
        say: prints what is going on, a line each.

    Returns:
        The page.

    Raises:
        SettingsError: viser is not installed, the port is taken, the host is not this machine's, or dt is not positive.
        ModelError: the model cannot be driven, or has no joint for a slider.
        SimulationError: the first movement cannot be solved.
    """
    for name, value in (("dt", dt), ("physics_dt", physics_dt)):
        if not 0 < value < 0.1:
            raise SettingsError(f"{name} is {value!r} s: give a number above 0 and below .1, such as .01")
    stop_server(start_server(host, port))  # before the work: is there viser, and the port?
    loaded = model if isinstance(model, MuscleModel) else MuscleModel.load(model)
    solver = LiveSolver(loaded, dt=dt, physics_dt=physics_dt)
    say("preparing: what solves is compiled, the first time for some 20 s")
    solver.warm_up()
    page = LivePage(solver, host, port)
    serve(page.server, f"live, {loaded.name}", open_browser=open_browser, block=block, say=say, close=page._end)
    return page


def _nearest(value: float, low: float, high: float, step: float) -> float:
    """The slider's step nearest to a value."""
    return round(float(np.clip(low + step * round((value - low) / step), low, high)), 9)

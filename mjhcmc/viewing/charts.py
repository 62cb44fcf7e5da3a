"""Curves of a solution beside viser's scene: excitations, joints, moments; redrawn when another solution comes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.solution import Solution

Array = NDArray[np.float64]

MOST_MUSCLES, MOST_JOINTS = 12, 8
"""Charts; where a solution has more muscles, those of largest peak excitation are drawn."""

EXCITATION, ACTIVATION, REFLEX = "#0072B2", "#003f62", "#D55E00"
DESIRED, ACTUAL, ERROR, MOMENT, RESERVE = "#adb5bd", "#0072B2", "#D55E00", "#222222", "#E69F00"
"""As in the report."""

_TOPS = (0.2, 0.5)  # of charts of excitation where no muscle does more; else 1
_HEIGHT = 78  # pixels of a chart
_AXIS = "#868e96"


class Charts:
    """Three tabs of charts in a panel of their own.

    Args:
        server: a ``viser.ViserServer``.
        solution: the first one; others have the same muscles and joints.
        reflex: (N, n_muscle) part of the excitations that a reflex imposes; None: there are no reflexes.
    """

    def __init__(self, server: Any, solution: Solution, reflex: Array | None = None) -> None:
        self._joints = tracked_joints(solution)
        self._with_reflex = reflex is not None
        gui = server.gui
        panel = gui.add_panel()
        with panel.add_tab("Excitations"):
            self._muscle_words = gui.add_html("")
            self._top = top_of(solution)
            n = min(len(solution.muscle_names), MOST_MUSCLES)
            self._excitations = [self._excitation_chart(gui) for _ in range(n)]
        with panel.add_tab("Joints"):
            gui.add_html(legend([("desired", DESIRED), ("muscle-driven", ACTUAL)]))
            self._angles = [_chart(gui, (DESIRED, ACTUAL)) for _ in self._joints]
            gui.add_html(legend([("tracking error, muscle-driven minus desired", ERROR)]))
            self._errors = [_chart(gui, (ERROR,)) for _ in self._joints]
        with panel.add_tab("Moments"):
            gui.add_html(legend([("net joint moment", MOMENT), ("reserve", RESERVE)]))
            self._moments = [_chart(gui, (MOMENT, RESERVE)) for _ in self._joints]
        panel.dock_left()
        panel.set_width(360)
        self.panel = panel
        self.show(solution, reflex)

    def _excitation_chart(self, gui: Any) -> Any:
        colours = (EXCITATION, ACTIVATION, REFLEX) if self._with_reflex else (EXCITATION, ACTIVATION)
        return _chart(gui, colours, (0.0, self._top), filled=(0, 2))

    def show(self, solution: Solution, reflex: Array | None = None) -> None:
        """Draw a solution in place of the one before."""
        self.show_muscles(solution, reflex)
        self.show_joints(solution)

    def show_muscles(self, solution: Solution, reflex: Array | None = None) -> None:
        """Draw its excitations and activations; all charts reach as high, see `top_of`."""
        peaks = solution.excitation.max(axis=0)
        muscles = np.arange(len(peaks))
        if len(peaks) > MOST_MUSCLES:
            muscles = np.sort(np.argsort(-peaks, kind="stable")[:MOST_MUSCLES])
        words = [("excitation", EXCITATION), ("activation", ACTIVATION)]
        has_reflex = self._with_reflex and reflex is not None and bool(np.any(reflex))
        words += [("of it reflex", REFLEX)] if has_reflex else []
        chosen = f"{len(muscles)} of {len(peaks)} muscles, largest peaks" if len(peaks) > len(muscles) else ""
        _set(self._muscle_words, "content", legend(words, chosen))
        time, held, top = solution.time, held_times(solution.time), top_of(solution)
        if top != self._top:
            self._top = top
            for chart in self._excitations:
                chart.scales = _scales((0.0, top))
        for chart, i in zip(self._excitations, muscles, strict=True):
            curves = [np.repeat(solution.excitation[:, i], 2), np.interp(held, time, solution.activation[:, i])]
            if self._with_reflex:
                part = reflex[:, i] if has_reflex and reflex is not None else np.full(solution.n_window, np.nan)
                curves.append(np.repeat(part, 2))  # not a number: no line
            _redraw(chart, solution.muscle_names[i], held, curves)

    def show_joints(self, solution: Solution) -> None:
        """Draw its joint angles, tracking errors, moments and reserves."""
        time, held = solution.time, held_times(solution.time)
        for j, angle, error, moment in zip(self._joints, self._angles, self._errors, self._moments, strict=True):
            rotation, name = bool(solution.dof_is_rotation[j]), solution.dof_names[j]
            unit, scale = ("deg", 180 / np.pi) if rotation else ("mm", 1e3)
            error_now = scale * solution.tracking_error[:, j]
            desired, actual = angles_of(solution, j)
            _redraw(angle, f"{name}, {unit}", time, [scale * desired, scale * actual])
            _redraw(error, f"{name}, {unit}", time, [error_now])
            _redraw(
                moment, f"{name}, {'N m' if rotation else 'N'}", held,
                [np.interp(held, time, solution.net_joint_moment[:, j]), np.repeat(solution.reserve[:, j], 2)],
            )  # fmt: skip


def top_of(solution: Solution) -> float:
    """The least of .2, .5 and 1 that no excitation and no activation exceeds."""
    highest = max(float(np.nanmax(each, initial=0.0)) for each in (solution.excitation, solution.activation))
    return next((top for top in _TOPS if top > highest), 1.0)


def tracked_joints(solution: Solution) -> list[int]:
    """Degrees of freedom that muscles lead; of many, those of largest moment."""
    tracked = [j for j, role in enumerate(solution.roles) if role == "tracked"]
    if len(tracked) > MOST_JOINTS:
        largest = np.argsort(-solution.peak_moment[tracked], kind="stable")[:MOST_JOINTS]
        tracked = sorted(tracked[i] for i in largest)
    return tracked


def angles_of(solution: Solution, dof: int) -> tuple[Array, Array]:
    """(N+1,) desired and actual position of a degree of freedom, rad or m.

    Of balls and free joints, whose coordinates are no angles, the error about a desired 0.
    """
    names = solution.coordinate_names
    name = solution.dof_names[dof]
    if name not in names:
        return np.zeros(len(solution.time)), solution.tracking_error[:, dof]
    at = names.index(name)
    return solution.qpos_desired[:, at], solution.qpos[:, at]


def held_times(time: Array) -> Array:
    """(2 N,) the start and the end of each window, for what is constant over it."""
    return np.repeat(time, 2)[1:-1]


def legend(entries: Sequence[tuple[str, str]], note: str = "") -> str:
    """HTML: a coloured stroke for each name."""
    strokes = "".join(
        f'<span style="white-space:nowrap;margin-right:12px"><span style="display:inline-block;width:16px;height:3px;'
        f'vertical-align:middle;margin-right:5px;background:{colour}"></span>{name}</span>'
        for name, colour in entries
    )
    tail = f'<div style="color:#868e96">{note}</div>' if note else ""
    return f'<div style="font-size:12px;padding:6px 12px 0">{strokes}{tail}</div>'


def _chart(
    gui: Any, colours: Sequence[str], limits: tuple[float, float] | None = None, filled: Sequence[int] = ()
) -> Any:
    series: list[dict[str, Any]] = [{"label": "t, s"}]
    for i, colour in enumerate(colours):
        one: dict[str, Any] = {"stroke": colour, "width": 1.5, "points": {"show": False}, "spanGaps": True}
        if i in filled:
            one["fill"] = colour + "30"
        series.append(one)
    axis: dict[str, Any] = {"stroke": _AXIS, "font": "10px sans-serif", "grid": {"stroke": "#ced4da55", "width": 1}}
    axis |= {"ticks": {"show": False}, "gap": 2}
    nothing = np.array([0.0, 1.0])
    return gui.add_uplot(
        (nothing, *(np.zeros(2) for _ in colours)), tuple(series), title=" ", height=_HEIGHT, scales=_scales(limits),
        axes=({**axis, "size": 16}, {**axis, "size": 34, "space": 24}), legend={"show": False},
        cursor={"drag": {"x": False, "y": False}, "y": False}, padding=(4, 12, 0, 0),
    )  # fmt: skip


def _scales(limits: tuple[float, float] | None) -> dict[str, Any]:
    return {"x": {"time": False}} | ({} if limits is None else {"y": {"range": limits}})


def _redraw(chart: Any, title: str, time: Array, curves: Sequence[Array]) -> None:
    _set(chart, "title", title)
    chart.data = (np.asarray(time), *(np.asarray(curve) for curve in curves))


def _set(handle: Any, name: str, value: Any) -> None:
    if getattr(handle, name) != value:
        setattr(handle, name, value)

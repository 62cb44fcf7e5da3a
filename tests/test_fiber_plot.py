"""Fibers and power: what is drawn is what the detail holds, on scales that all muscles share."""

import dataclasses

import matplotlib
import numpy as np
import pytest
from conftest import HANGING_MASS, LINEAR_ACTUATOR, load_xml
from many_muscles import chain, swing
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.testing import assert_allclose
from scipy.integrate import trapezoid

import mjhcmc
from mjhcmc.plotting import detail_figure, save_figure


@pytest.fixture(scope="module")
def drawn(fast_solution):
    return detail_figure(fast_solution)


def panels(figure):
    """(fiber, power) of each muscle."""
    return list(zip(figure.axes[::2], figure.axes[1::2], strict=True))


def collection(ax, label):
    (found,) = [c for c in ax.collections if c.get_label() == label]
    return found


def test_fibers_and_power_are_the_details(fast_solution, drawn):
    detail, time = fast_solution.detail, fast_solution.time
    for i, (fiber, power) in enumerate(panels(drawn)):
        assert fiber.get_title(loc="left") == fast_solution.muscle_names[i].replace("_", " ")
        path = np.array(collection(fiber, "fiber").get_segments())
        expected = np.column_stack([detail.normalized_fiber_length[:, i], detail.normalized_fiber_velocity[:, i]])
        assert_allclose(path[:, 0], expected[:-1])
        assert_allclose(path[:, 1], expected[1:])
        drawn = np.zeros_like(time)
        for label in ("gives", "takes"):
            (vertices,) = [p.vertices for p in collection(power, label).get_paths()]
            outer = {round(x, 9): y for x, y in vertices if y}
            drawn += [outer.get(round(t, 9), 0.0) for t in time]
        assert_allclose(drawn, detail.muscle_power[:, i], atol=1e-9)


def test_the_fiber_is_darker_where_the_muscle_is_more_active(fast_solution, drawn):
    for i, (fiber, _) in enumerate(panels(drawn)):
        light = collection(fiber, "fiber").get_colors()[:, :3].sum(axis=1)
        active = fast_solution.activation[:, i]
        middle = 0.5 * (active[:-1] + active[1:])
        order = np.argsort(middle)
        assert (np.diff(light[order]) <= 1e-9).all()
        assert light.max() > light.min()


def test_all_muscles_share_their_scales(fast_solution, drawn):
    pairs = panels(drawn)
    assert len({(fiber.get_xlim(), fiber.get_ylim(), power.get_ylim()) for fiber, power in pairs}) == 1
    detail = fast_solution.detail
    fiber, power = pairs[0]
    for limits, values in (
        (fiber.get_xlim(), detail.normalized_fiber_length),
        (fiber.get_ylim(), detail.normalized_fiber_velocity),
        (power.get_ylim(), detail.muscle_power),
    ):
        assert limits[0] < values.min()
        assert limits[1] > values.max()


def test_the_work_given_and_taken_is_noted(fast_solution, drawn):
    """iliopsoas: both are the integrals of the power that is drawn."""
    _, power = panels(drawn)[0]
    values = fast_solution.detail.muscle_power[:, 0]
    given, taken = (trapezoid(part, dx=0.01) for part in (np.maximum(values, 0), np.minimum(values, 0)))
    assert [t.get_text() for t in power.texts] == [f"+{given:.3g} J  −{-taken:.3g} J"]


def test_a_muscle_without_a_fiber_says_so():
    model = load_xml(HANGING_MASS.format(actuator=LINEAR_ACTUATOR))
    motion = mjhcmc.Motion.cosine(model, amplitudes={"height": 0.02}, period=1.0, cycles=0.1)
    ((fiber, power),) = panels(detail_figure(mjhcmc.hcmc(model, motion)))
    assert [t.get_text() for t in fiber.texts] == ["no fiber in this model"]
    assert np.isfinite(power.get_ylim()).all()


@pytest.mark.parametrize("count", [1, 8, 24])
def test_many_muscles_fit_on_the_sheet(count, drawn):
    figure = drawn if count == 8 else detail_figure(swing(chain(1 if count == 1 else 5, count, force=400.0), windows=5))
    assert len(figure.axes) == 2 * count
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw_without_rendering()
    for ax in figure.axes:
        box = ax.get_tightbbox(renderer)
        assert box.x0 >= 0
        assert box.y0 >= 0
        assert box.x1 <= figure.bbox.width
        assert box.y1 <= figure.bbox.height
    for fiber, power in panels(figure):  # a length's label stays clear of the panel below it
        assert fiber.xaxis.label.get_window_extent(renderer).y0 >= power.get_window_extent().y1


def test_the_figure_is_the_same_wherever_it_is_drawn(tmp_path, coarse_figures):
    solution = swing(chain(1, 2, force=400.0), windows=5)
    first = [p.read_bytes() for p in save_figure(detail_figure(solution), tmp_path / "one")]
    with matplotlib.rc_context({"font.size": 20, "axes.grid": False, "lines.linewidth": 9}):
        second = [p.read_bytes() for p in save_figure(detail_figure(solution), tmp_path / "two")]
    assert first == second


def test_without_muscles_there_is_nothing_to_draw(fast_solution):
    none = {name: getattr(fast_solution, name)[:, :0] for name in ("excitation", "activation", "muscle_force")}
    with pytest.raises(mjhcmc.SettingsError, match="has no muscle"):
        detail_figure(dataclasses.replace(fast_solution, muscle_names=(), **none))

"""The figure of errors against steps shows what it is given, and refuses what it cannot show."""

import numpy as np
import pytest

from mjhcmc.errors import SettingsError
from mjhcmc.plotting.precision import ErrorPanel, precision_figure

STEPS = np.array([1.0, 2.0, 4.0])


def test_curves_and_guides_are_drawn_where_they_belong():
    curves = {"fine": (STEPS, 3 * STEPS**4), "floor": (STEPS, [1e-9, 0.0, 2e-9])}
    figure = precision_figure([ErrorPanel("leg", "step (ms)", "error", curves, {4: "fine"})], "title")
    (ax,) = figure.axes
    fine, floor, guide = ax.get_lines()
    np.testing.assert_allclose(fine.get_ydata(), 3 * STEPS**4)
    assert floor.get_xdata().tolist() == [1.0, 4.0]  # what is not positive has no place
    x, y = guide.get_xdata(), guide.get_ydata()
    assert np.log2(y[1] / y[0]) / np.log2(x[1] / x[0]) == pytest.approx(4)
    assert (y < 3 * x**4).all()
    assert ax.get_xscale() == ax.get_yscale() == "log"


def test_what_does_not_fit_is_refused():
    with pytest.raises(SettingsError, match="at least one panel"):
        precision_figure([], "title")
    with pytest.raises(SettingsError, match="'a' has 3 steps and 2 errors"):
        precision_figure([ErrorPanel("p", "x", "y", {"a": (STEPS, [1.0, 2.0])}, {})], "title")
    with pytest.raises(SettingsError, match="guides have orders 1, 2, 4; got 3"):
        precision_figure([ErrorPanel("p", "x", "y", {"a": (STEPS, STEPS)}, {3: "a"})], "title")

"""Stacked contributions: the areas add up to the net moment, names and colors are unmistakable, nothing overlaps."""

import dataclasses
from itertools import combinations

import matplotlib
import numpy as np
import pytest
from many_muscles import chain, swing
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb
from numpy.testing import assert_allclose, assert_array_equal

import mjhcmc
from mjhcmc.plotting import excitation_figure, moment_figure, save_figure
from mjhcmc.plotting.moments import MUSCLE_COLORS
from mjhcmc.plotting.panels import ORANGE


@pytest.fixture(scope="module")
def crowded():
    """Six joints, 60 weak muscles of long names, reserves: more muscles a joint than can be named."""
    return swing(chain(6, 60, force=15.0), windows=12)


@pytest.fixture(scope="module", params=["fast_solution", "crowded"])
def drawn(request):
    solution = request.getfixturevalue(request.param)
    return solution, moment_figure(solution)


def areas(ax, time):
    """(above, below, label, color) of each area: its outer less its inner edge at the nodes."""
    result = []
    for collection in ax.collections:
        (path,) = collection.get_paths()
        n = len(time)
        # fill_between walks along one edge and back along the other
        vertices = path.vertices[:-1]
        half = len(vertices) // 2
        first, back = vertices[1:half][:, 1], vertices[half + 1 :][::-1][:, 1]
        assert len(first) == len(back) == n
        assert_array_equal(vertices[1:half, 0], time)
        result.append((first, back, collection.get_label(), to_hex(collection.get_facecolor()[0])))
    return result


def named(ax):
    return [(t.get_text(), to_hex(p.get_facecolor())) for t, p in zip(
        ax.get_legend().get_texts(), ax.get_legend().get_patches(), strict=True)]  # fmt: skip


def net_line(ax):
    (found,) = [line for line in ax.get_lines() if line.get_label().startswith("net joint")]
    return np.asarray(found.get_ydata())


def test_areas_add_up_to_the_net_moment(drawn):
    solution, figure = drawn
    for j, ax in enumerate(figure.axes):
        assert_array_equal(net_line(ax), solution.net_joint_moment[:, j])
        total = sum(
            np.where(np.abs(a) > np.abs(b), a - b, b - a) for a, b, *_ in areas(ax, solution.time)
        )  # an area reaches from its inner edge outwards
        assert_allclose(total, solution.net_joint_moment[:, j], atol=1e-9 * solution.peak_moment[j])


def test_each_area_is_its_muscles_contribution(fast_solution):
    figure = moment_figure(fast_solution)
    for j, ax in enumerate(figure.axes):
        for i, name in enumerate(fast_solution.muscle_names):
            parts = [x for x in areas(ax, fast_solution.time) if x[2] == name.replace("_", " ")]
            total = sum(np.where(np.abs(a) > np.abs(b), a - b, b - a) for a, b, *_ in parts)
            assert_allclose(total, fast_solution.detail.muscle_moment[:, i, j], atol=1e-9)


def test_a_joint_names_its_own_muscles_the_largest_first(fast_solution):
    hip, knee, ankle = ([label for label, _ in named(ax)] for ax in moment_figure(fast_solution).axes)
    assert set(hip) == {"iliopsoas", "hamstrings", "rect fem", "glut max"}
    assert set(knee) == {"vasti", "hamstrings", "rect fem", "gastroc"}
    assert set(ankle) == {"tib ant", "gastroc", "soleus"}
    peak = np.abs(fast_solution.detail.muscle_moment).max(axis=0)
    order = [fast_solution.muscle_names[i].replace("_", " ") for i in np.argsort(-peak[:, 0])]
    assert hip == order[:4]


def test_a_muscle_has_one_color_on_all_joints_of_a_leg(fast_solution):
    colors = {}
    for ax in moment_figure(fast_solution).axes:
        for label, color in named(ax):
            assert colors.setdefault(label, color) == color
    assert len(set(colors.values())) == len(colors) == 8


def test_a_muscle_has_the_same_color_in_every_figure_whatever_its_size(fast_solution, slow_solution):
    peaks = [np.abs(s.detail.muscle_moment).max(axis=0) for s in (fast_solution, slow_solution)]
    assert (np.argsort(peaks[0], axis=0) != np.argsort(peaks[1], axis=0)).any()  # sizes do change
    wanted = dict(zip(fast_solution.muscle_names, (c.lower() for c in MUSCLE_COLORS), strict=False))
    for solution in (fast_solution, slow_solution):
        for ax in moment_figure(solution).axes:
            for label, color in named(ax):
                assert color == wanted[label.replace(" ", "_")]


def test_beyond_nine_muscles_colors_still_do_not_follow_sizes():
    """Twelve, of which at most eight cross a joint: none is short of colors."""
    solution = swing(chain(3, 12), windows=6)
    weak = dataclasses.replace(solution, activation=solution.activation[:, ::-1].copy())
    peaks = [np.abs(s.detail.muscle_moment).max(axis=0) for s in (solution, weak)]
    assert (np.argsort(peaks[0], axis=0) != np.argsort(peaks[1], axis=0)).any()
    one, other = ([dict(named(ax)) for ax in moment_figure(s).axes] for s in (solution, weak))
    assert [sorted(panel) for panel in one] == [sorted(panel) for panel in other]
    assert one == other
    for panel in one:
        assert len(set(panel.values())) == len(panel)


def test_of_many_muscles_the_smallest_are_merged(crowded):
    figure = moment_figure(crowded)
    peak = np.abs(crowded.detail.muscle_moment).max(axis=0)
    for j, ax in enumerate(figure.axes):
        labels, colors = zip(*named(ax), strict=True)
        across = np.count_nonzero(peak[:, j] > 1e-6 * peak[:, j].max())
        assert across > 10
        assert len(labels) == 10
        assert labels[-1] == f"{across - 9} others"
        assert len(set(colors)) == 10
        assert set(colors[:-1]) <= {c.lower() for c in MUSCLE_COLORS}


def test_the_reserve_is_an_area_of_its_own_and_is_told(crowded, fast_solution):
    for j, ax in enumerate(moment_figure(crowded).axes):
        parts = [x for x in areas(ax, crowded.time) if x[2] == "reserve"]
        total = sum(np.where(np.abs(a) > np.abs(b), a - b, b - a) for a, b, *_ in parts)
        assert_allclose(total[:-1], crowded.reserve[:, j], atol=1e-9)
        hatched = [c for c in ax.collections if c.get_label() == "reserve"]
        assert all(c.get_hatch() and to_hex(c.get_edgecolor()[0]) == ORANGE.lower() for c in hatched)
        assert any(t.get_text().startswith("reserve ") and "% of peak" in t.get_text() for t in ax.texts)
    for ax in moment_figure(fast_solution).axes:
        assert [t.get_text() for t in ax.texts] == ["no reserve"]


def test_slides_have_forces(linear_mass):
    motion = mjhcmc.Motion.cosine(linear_mass, amplitudes={"height": 0.02}, period=1.0, cycles=0.1)
    (ax,) = moment_figure(mjhcmc.hcmc(linear_mass, motion)).axes
    assert ax.get_ylabel() == "force (N)"
    assert [label for label, _ in named(ax)] == ["pull"]


def test_everything_is_inside_the_sheet_and_nothing_overlaps(drawn):
    _, figure = drawn
    renderer, sheet = FigureCanvasAgg(figure).get_renderer(), figure.bbox
    figure.draw_without_rendering()
    boxes = [text.get_window_extent(renderer) for text in figure.legends[0].get_texts()]
    for ax in figure.axes:
        boxes += [
            ax.get_window_extent(),
            ax.get_legend().get_window_extent(renderer),
            ax.yaxis.label.get_window_extent(renderer),
        ]
    for box in boxes:
        assert box.x0 >= 0
        assert box.y0 >= 0
        assert box.x1 <= sheet.width
        assert box.y1 <= sheet.height
    for a, b in combinations(boxes, 2):
        assert not (a.x0 < b.x1 and b.x0 < a.x1 and a.y0 < b.y1 and b.y0 < a.y1)


def test_colors_are_apart_for_color_blind_eyes():
    """Any two of them, as deuteranopes and protanopes see them (Vienot, Brettel, Mollon 1999), in CIE Lab."""
    seen = [np.array([to_rgb(c) for c in MUSCLE_COLORS])]
    linear = np.where(seen[0] <= 0.04045, seen[0] / 12.92, ((seen[0] + 0.055) / 1.055) ** 2.4)
    to_lms = np.array([[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]])
    protan = np.array([[0, 2.02344, -2.52581], [0, 1, 0], [0, 0, 1]])
    deutan = np.array([[1, 0, 0], [0.494207, 0, 1.24827], [0, 0, 1]])
    for blind in (np.eye(3), protan, deutan):
        rgb = np.clip(linear @ (np.linalg.inv(to_lms) @ blind @ to_lms).T, 0, 1)
        lab = to_lab(rgb)
        least = min(np.linalg.norm(a - b) for a, b in combinations(lab, 2))
        assert least > 9, least


def to_lab(linear):
    xyz = linear @ np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]).T
    f = np.cbrt(xyz / [0.9505, 1.0, 1.089])
    return np.column_stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])])


def test_only_what_is_tracked_by_muscles_is_shown(fast_solution):
    """Prescribed, dependent and free degrees of freedom have no muscles to show, nor has a tracked root."""
    roles = {"roles": ["tracked", "prescribed", "tracked"], "root": ["hip"]}
    figure = moment_figure(dataclasses.replace(fast_solution, settings={**fast_solution.settings, **roles}))
    assert [ax.get_title(loc="left") for ax in figure.axes] == ["ankle"]
    assert_array_equal(net_line(figure.axes[0]), fast_solution.net_joint_moment[:, 2])


def test_of_many_joints_twelve_are_shown_and_the_rest_is_counted():
    solution = swing(chain(14, 30), windows=3)
    figure = moment_figure(solution)
    shown = [int(ax.get_title(loc="left").split()[1]) for ax in figure.axes]
    assert len(shown) == 12
    assert shown == sorted(shown)
    assert int(np.argmax(solution.peak_moment)) in shown
    for j, ax in zip(shown, figure.axes, strict=True):
        assert_array_equal(net_line(ax), solution.net_joint_moment[:, j])
    told = figure.legends[0].get_texts()[-1].get_text()
    assert told == "2 of 14 tracked left out: those that move, carry and err least"


def test_a_solution_without_its_model_is_refused(fast_solution):
    bare = dataclasses.replace(fast_solution, model=None)
    with pytest.raises(mjhcmc.SimulationError, match=r"Solution\.load\(path, model=\.\.\.\)"):
        moment_figure(bare)
    excitation_figure(bare)  # which needs none


def test_the_figure_is_the_same_wherever_it_is_drawn_and_can_be_saved(fast_solution, tmp_path, coarse_figures):
    figure = moment_figure(fast_solution)
    first = [p.read_bytes() for p in save_figure(figure, tmp_path / "one")]
    with matplotlib.rc_context({"font.size": 20, "axes.grid": False, "lines.linewidth": 9}):
        second = [p.read_bytes() for p in save_figure(moment_figure(fast_solution), tmp_path / "two")]
    assert first == second
    assert figure.get_suptitle() == "Muscle contributions to the joint moments · HCMC · leg8 · fast · dt 10 ms"

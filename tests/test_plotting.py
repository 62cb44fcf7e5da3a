"""Figures: what is drawn is what the solution holds, nothing overlaps, and files come whole or not at all."""

import pickle
import struct
import subprocess
import sys
from dataclasses import replace
from itertools import combinations

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.text import Text
from plot_tools import activations, legend, line, make, pixels, rooted, shaded, steps

from mjhcmc.errors import OutputError, SettingsError
from mjhcmc.plotting import convergence_figure, excitation_figure, residual_figure, save_figure, tracking_figure
from mjhcmc.solution import WindowStatus

# ------------------------------------------------------------------ excitation


@pytest.mark.parametrize("count", [1, 8, 13, 36])
def test_a_panel_for_each_muscle(count):
    names = [f"muscle_{i}" for i in range(count)]
    figure = excitation_figure(make(names, n=4))
    assert [ax.get_title(loc="left") for ax in figure.axes] == [n.replace("_", " ") for n in names]


def test_excitation_is_a_step_over_its_window_and_activation_a_line_at_the_nodes():
    solution = make()
    for j, ax in enumerate(excitation_figure(solution).axes):
        (step,) = steps(ax, "excitation")
        data = step.get_data()
        np.testing.assert_array_equal(data.values, solution.excitation[:, j])
        np.testing.assert_array_equal(data.edges, solution.time)
        time, activation = line(ax, "activation")
        np.testing.assert_array_equal(time, solution.time)
        np.testing.assert_array_equal(activation, solution.activation[:, j])
        assert ax.get_ylim()[0] <= 0
        assert ax.get_ylim()[1] >= 1
        assert ax.get_xlim() == (solution.time[0], solution.time[-1])


@pytest.mark.parametrize("count", [416])
def test_of_many_muscles_those_with_the_highest_peaks_are_drawn_and_the_rest_is_counted(count):
    names = [f"muscle_{i}" for i in range(count)]
    solution = make(names, n=4)
    figure = excitation_figure(solution)
    peak = np.maximum(solution.excitation.max(axis=0), solution.activation.max(axis=0))
    drawn = [int(ax.get_title(loc="left").split()[1]) for ax in figure.axes]
    assert drawn == sorted(np.argsort(-peak)[:36])
    assert legend(figure)[-1] == f"{count - 36} of {count} muscles left out: those with the lowest peaks"
    assert max(figure.get_size_inches()) < 16


@pytest.mark.parametrize(("peak", "top"), [(0.15, 0.2), (0.45, 0.5), (0.55, 1.0)])
def test_all_panels_reach_as_high_as_the_highest_muscle_needs(peak, top):
    solution = make()
    quiet = {"excitation": solution.excitation * 0.1, "activation": solution.activation * 0.1}
    quiet["activation"][4, 2] = peak
    for ax in excitation_figure(replace(solution, **quiet)).axes:
        assert ax.get_yticks().tolist() == [0, top / 2, top]
        assert ax.get_ylim()[0] < 0
        assert ax.get_ylim()[1] > top


def test_leg8_has_two_rows_of_four_and_units_on_the_outer_axes():
    figure = excitation_figure(make())
    corners = [ax.get_position() for ax in figure.axes]
    assert len({round(p.x0, 6) for p in corners}) == 4
    assert len({round(p.y0, 6) for p in corners}) == 2
    assert [ax.get_xlabel() for ax in figure.axes] == [""] * 4 + ["time (s)"] * 4
    assert [bool(ax.get_ylabel()) for ax in figure.axes] == [True, False, False, False] * 2


def test_the_title_says_method_model_motion_and_dt():
    assert excitation_figure(make()).get_suptitle() == "Muscle excitation · HCMC · leg8 · fast · dt 10 ms"
    bare = replace(make(), settings={})  # a .csv keeps no settings
    assert tracking_figure(bare).get_suptitle() == "Tracking and joint moments · dt 10 ms"
    assert excitation_figure(replace(make(), interrupted=True)).get_suptitle().endswith("interrupted")


def test_saturated_windows_are_shaded_in_their_muscle_only():
    solution = make()
    excitation = solution.excitation.copy()
    excitation[[0, 4, 5, 29], 2] = 1.0
    plain = excitation_figure(solution)
    assert not any(shaded(ax, 30, solution.time).any() for ax in plain.axes)
    assert "saturated" not in legend(plain)
    figure = excitation_figure(replace(solution, excitation=excitation))
    assert np.flatnonzero(shaded(figure.axes[2], 30, solution.time)).tolist() == [0, 4, 5, 29]
    assert not shaded(figure.axes[1], 30, solution.time).any()
    assert "saturated" in legend(figure)


def test_windows_that_are_not_ok_are_shaded_in_every_panel():
    solution = make()
    status = solution.status.copy()
    status[10:13] = WindowStatus.RESERVE
    figure = excitation_figure(replace(solution, status=status))
    for ax in figure.axes:
        assert np.flatnonzero(shaded(ax, 30, solution.time)).tolist() == [10, 11, 12]
    assert "reserve in use" in legend(figure)


def test_several_solutions_lie_over_each_other_in_their_own_colors():
    one, two = make(seed=1), make(seed=2, method="cmc")
    figure = excitation_figure({"HCMC": one, "CMC": two})
    for j, ax in enumerate(figure.axes):
        drawn = activations(ax)
        np.testing.assert_array_equal([a.get_ydata() for a in drawn], [one.activation[:, j], two.activation[:, j]])
        assert drawn[0].get_color() != drawn[1].get_color()
    assert legend(figure) == ["HCMC", "CMC", "excitation of HCMC"]
    assert figure.get_suptitle() == "Muscle activation · HCMC, CMC · leg8 · fast · dt 10 ms"
    assert figure.axes[0].get_ylabel() == "activation (–)"
    # A method keeps its color, whatever stands beside it.
    other = excitation_figure({"CMC": two, "HCMC": one}).axes[0]
    assert activations(other)[0].get_color() == activations(figure.axes[0])[1].get_color()


def test_of_several_only_the_first_shows_its_excitation():
    one, two = make(seed=1), make(seed=2, method="cmc")
    for j, ax in enumerate(excitation_figure({"HCMC": one, "CMC": two}).axes):
        (step,) = steps(ax, "excitation")
        np.testing.assert_array_equal(step.get_data().values, one.excitation[:, j])
        assert step.get_edgecolor()[:3] == pytest.approx(to_rgb(activations(ax)[0].get_color()))


def test_solutions_that_agree_are_all_seen():
    """Each line on top is thinner than what it lies on: nothing is hidden, the first least."""
    one = make(seed=1)
    figure = excitation_figure({"a": one, "b": replace(one, settings={"method": "cmc"})})
    wide, thin = activations(figure.axes[0])
    assert wide.get_zorder() < thin.get_zorder()
    assert wide.get_linewidth() >= 2 * thin.get_linewidth()
    before = pixels(figure)
    for drawn in (wide, thin):
        drawn.set_visible(False)
        assert (pixels(figure) != before).any(axis=-1).sum() > 100
        drawn.set_visible(True)
    handles = figure.legends[0].get_lines()
    assert [h.get_linewidth() for h in handles] == [wide.get_linewidth(), thin.get_linewidth()]
    assert [h.get_color() for h in handles] == [wide.get_color(), thin.get_color()]


def test_solutions_of_one_method_still_differ_in_color():
    figure = excitation_figure({f"dt {k}": make(seed=k) for k in range(4)})
    assert len({a.get_color() for a in activations(figure.axes[0])}) == 4


def test_the_legend_tells_once_which_windows_of_several_solutions_are_not_ok():
    one = make(seed=1)
    status = np.full(30, WindowStatus.UNMET, dtype=np.int64)
    status[:4] = WindowStatus.RESERVE
    figure = excitation_figure({"a": one, "b": replace(make(seed=2, method="cmc"), status=status)})
    assert legend(figure)[:2] == ["a", "b (reserve in use in 4 of 30 windows, moment unmet in 26 of 30 windows)"]
    for ax in figure.axes:
        assert not shaded(ax, 30, one.time).any()


def test_a_muscle_that_one_solution_lacks_is_drawn_for_the_other():
    figure = excitation_figure({"a": make(("soleus", "vasti")), "b": make(("vasti", "tib_ant"), method="cmc")})
    titles = {ax.get_title(loc="left"): len(activations(ax)) for ax in figure.axes}
    assert titles == {"soleus": 1, "vasti": 2, "tib ant": 1}
    assert not steps(figure.axes[2], "excitation")


def test_nothing_to_draw_is_refused():
    with pytest.raises(SettingsError, match="at least one solution"):
        excitation_figure({})


# ------------------------------------------------------------------ convergence


def test_convergence_shows_the_errors_and_order_two_below_them():
    dt = np.array([0.02, 0.0025, 0.01, 0.005])
    error = np.outer(dt**3, [1.0, 50.0])
    ax = convergence_figure(dt, error, ("hip", "knee_r")).axes[0]
    assert ax.get_xscale() == ax.get_yscale() == "log"
    for j, name in enumerate(("hip", "knee r")):
        x, y = line(ax, name)
        np.testing.assert_array_equal(x, np.sort(dt))
        np.testing.assert_allclose(y, np.sort(error[:, j]))
    x, y = line(ax, "order 2")
    np.testing.assert_allclose(np.diff(np.log(y)) / np.diff(np.log(x)), 2.0)
    assert (y[:, None] < np.sort(error, axis=0)).all()
    assert [t.get_text() for t in ax.get_xticklabels()] == ["2.5", "5", "10", "20"]


def test_convergence_leaves_out_what_a_logarithm_cannot_show():
    ax = convergence_figure([0.01, 0.005], [[0.0], [1e-3]], ("hip",)).axes[0]
    np.testing.assert_array_equal(line(ax, "hip")[1], [1e-3, np.nan])
    pixels(ax.figure)


@pytest.mark.parametrize(
    ("dt", "error", "names", "message"),
    [
        ([0.01], [[1.0, 2.0]], ("hip",), "shape"),
        ([], np.empty((0, 1)), ("hip",), "shape"),
        ([0.01, 0.0], [[1.0], [2.0]], ("hip",), "positive"),
    ],
)
def test_convergence_refuses_what_does_not_fit(dt, error, names, message):
    with pytest.raises(SettingsError, match=message):
        convergence_figure(dt, error, names)


# ------------------------------------------------------------------ how they look


def _busy():
    reserve = np.zeros((30, 3))
    reserve[5:9, 2] = 12.0
    status = np.where(reserve[:, 2] > 0, int(WindowStatus.RESERVE), 0)
    leg = replace(make(), reserve=reserve, shortfall=reserve.copy(), status=status)
    long = [f"flexor_digitorum_longus_{i}_r" for i in range(40)]
    many = make(long, [f"metatarsophalangeal_{i}_r" for i in range(12)], n=6, motion="subject01_walk_IK.mot")
    one = make(("m",), ("elbow_flexion_r",), model="a_model_of_the_arm", motion="a_motion_with_a_long_name.sto")
    several = {f"a method with a long label, {k}": replace(make(seed=k), status=status) for k in range(5)}
    return {
        "leg8 excitation": lambda: excitation_figure(leg),
        "leg8 tracking": lambda: tracking_figure(leg),
        "40 muscles": lambda: excitation_figure(many),
        "12 joints": lambda: tracking_figure(many),
        "1 muscle": lambda: excitation_figure(one),
        "1 joint": lambda: tracking_figure(one),
        "several": lambda: excitation_figure(several),
        "residuals": lambda: residual_figure(rooted(20)),
        "40 joints": lambda: tracking_figure(make(dofs=[f"metatarsophalangeal_{i}_r" for i in range(40)], n=5)),
        "convergence": lambda: convergence_figure([0.02, 0.01, 0.005], np.ones((3, 3)), ("hip", "knee", "ankle")),
    }


@pytest.mark.parametrize("name", list(_busy()))
def test_no_text_overlaps_another_or_leaves_the_page(name, monkeypatch):
    figure, seen, draw = _busy()[name](), {}, Text.draw

    def record(text, renderer, *args, **kwargs):
        if text.get_visible() and text.get_text().strip():
            seen[id(text)] = (text.get_text(), text.get_window_extent(renderer))
        return draw(text, renderer, *args, **kwargs)

    monkeypatch.setattr(Text, "draw", record)
    figure.draw_without_rendering()
    assert len(seen) > 5
    page = figure.bbox
    for text, box in seen.values():
        assert box.x0 >= page.x0, text
        assert box.x1 <= page.x1, text
        assert box.y0 >= page.y0, text
        assert box.y1 <= page.y1, text
    for (one, a), (two, b) in combinations(seen.values(), 2):
        assert min(a.x1, b.x1) <= max(a.x0, b.x0) or min(a.y1, b.y1) <= max(a.y0, b.y0), (one, two)


def test_a_figure_looks_the_same_whatever_style_surrounds_it():
    make_both = (lambda: excitation_figure(make()), lambda: tracking_figure(make()))
    expected = [pixels(build()) for build in make_both]
    loud = {"xtick.color": "red", "ytick.labelsize": 20, "font.size": 20, "grid.color": "red", "xtick.direction": "in",
            "font.family": "serif", "axes.facecolor": "black", "lines.linewidth": 9}  # fmt: skip
    with matplotlib.rc_context(loud):
        for build, image in zip(make_both, expected, strict=True):
            np.testing.assert_array_equal(pixels(build()), image)


def test_a_notebook_shows_a_figure_and_a_pickle_keeps_it():
    figure = excitation_figure(make(("a", "b"), n=5))
    assert figure._repr_png_().startswith(b"\x89PNG")
    again = pickle.loads(pickle.dumps(figure))
    assert again._repr_png_() == figure._repr_png_()


def test_neither_pyplot_nor_a_screen_is_needed(tmp_path):
    code = (
        "import sys, pickle; import mjhcmc.plotting as p; assert 'matplotlib' not in sys.modules;"
        "s = pickle.load(open(sys.argv[1], 'rb')); p.save_figure(p.excitation_figure(s), sys.argv[2]);"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    (tmp_path / "s.pkl").write_bytes(pickle.dumps(make(("m",), n=3)))
    subprocess.run([sys.executable, "-c", code, tmp_path / "s.pkl", tmp_path / "figure"], check=True)
    assert (tmp_path / "figure.png").exists()


# ------------------------------------------------------------------ files


def test_png_and_pdf_are_written_at_a_resolution_for_print(tmp_path):
    figure = tracking_figure(make(("m",), ("hip",)))
    paths = save_figure(figure, tmp_path / "fast_0.01")
    assert paths == [tmp_path / "fast_0.01.png", tmp_path / "fast_0.01.pdf"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["fast_0.01.pdf", "fast_0.01.png"]
    png, pdf = (p.read_bytes() for p in paths)
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    width, _height = struct.unpack(">II", png[16:24])
    assert width >= 150 * figure.get_size_inches()[0]
    assert pdf.startswith(b"%PDF-")
    assert pdf.rstrip().endswith(b"%%EOF")


def test_the_same_solution_gives_the_same_bytes(tmp_path, coarse_figures):
    first = save_figure(excitation_figure(make()), tmp_path / "a")
    second = save_figure(excitation_figure(make()), tmp_path / "b")
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


def test_a_folder_that_cannot_be_written_is_named_and_nothing_is_left(tmp_path):
    figure = excitation_figure(make(n=3))
    (tmp_path / "file").write_text("in the way")
    for stem in (tmp_path / "missing" / "figure", tmp_path / "file" / "figure"):
        with pytest.raises(OutputError) as caught:
            save_figure(figure, stem)
        message = str(caught.value)
        assert f"{stem}.png" in message
        assert "folder" in message
        assert "\n" not in message
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_pdf_that_cannot_be_drawn_keeps_the_files_that_were_there(tmp_path, monkeypatch, coarse_figures):
    figure = excitation_figure(make(("m",), n=3))
    before = [p.read_bytes() for p in save_figure(figure, tmp_path / "figure")]
    savefig = type(figure).savefig

    def full_disk(self, path, **kwargs):
        if kwargs["format"] == "pdf":
            raise OSError(28, "No space left on device")
        savefig(self, path, **kwargs)

    monkeypatch.setattr(type(figure), "savefig", full_disk)
    with pytest.raises(OutputError, match="No space left"):
        save_figure(tracking_figure(make(("m",), ("hip",))), tmp_path / "figure")
    assert [(tmp_path / f"figure.{kind}").read_bytes() for kind in ("png", "pdf")] == before
    assert len(list(tmp_path.iterdir())) == 2

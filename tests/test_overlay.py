"""Activity from elsewhere, and how it is laid over the excitations; OpenSim's tables as one source of it."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from conftest import SHARED

from mjhcmc import MotionError, SettingsError
from mjhcmc import opensim_reference as reference
from mjhcmc.activity import Activity
from mjhcmc.opensim_reference import find_reference, read_reference, read_run
from mjhcmc.plotting import excitation_figure
from mjhcmc.reproduce import Reproduction

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
TIME = np.array([0.6, 0.7, 0.8])
TABLE = """time,q_hip,q_knee,q_ankle,a_tib_ant_r,a_iliopsoas_r,u_iliopsoas_r,u_tib_ant_r,a_somebody
0,0,0,-0,.1,.2,.3,.4,9
.005,90,-45,180,.5,.6,.7,.8,9
"""


def activity(**changes):
    given = {"time": TIME, "muscle_names": ["soleus", "vasti"], "activation": np.arange(6).reshape(3, 2) / 10}
    return Activity(**{**given, **changes})


def panel(figure, name):
    (found,) = [ax for ax in figure.axes if ax.get_title(loc="left") == name]
    return found


def line(ax, label):
    (found,) = [artist for artist in ax.get_lines() if artist.get_label() == label]
    return found


# --- Activity ------------------------------------------------------------------------------------------------------


def test_activity_keeps_private_read_only_copies():
    values = np.zeros((3, 2))
    kept = activity(activation=values)
    values[:] = 1
    assert not kept.activation.any()
    assert kept.muscle_names == ("soleus", "vasti")
    assert kept.excitation is None
    with pytest.raises(ValueError, match="read-only"):
        kept.activation[0, 0] = 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"activation": None}, "neither activation nor excitation is given: give one"),
        ({"muscle_names": ("vasti", "vasti")}, "muscle 'vasti' stands twice: name each muscle once"),
        ({"muscle_names": ()}, "there is no muscle: name"),
        (
            {"activation": np.zeros((2, 2))},
            r"activation has shape \(2, 2\) with 2 muscles and time \(3,\): give \(T, n\)",
        ),
        ({"excitation": np.zeros(3)}, r"excitation has shape \(3,\)"),
        ({"time": np.zeros((3, 1))}, r"time has shape \(3, 1\).*give \(T,\)"),
        ({"time": [], "activation": np.zeros((0, 2))}, r"time has shape \(0,\)"),
        ({"activation": [[0, 0], [0, np.nan], [0, 0]]}, r"activation\[1, 1\] is nan: give finite values"),
        ({"time": [0.6, 0.8, 0.8]}, "time 0.8 s follows 0.8 s: give increasing times"),
        ({"activation": [["a", "b"]] * 3}, "activation must hold numbers; got list"),
    ],
)
def test_activity_refused(changes, message):
    with pytest.raises(SettingsError, match=rf"^activity: .*{message}[^\n]*$"):
        activity(**changes)


# --- the overlay ---------------------------------------------------------------------------------------------------


def test_overlay_is_drawn_where_it_has_the_muscle(fast_solution):
    lab = activity(activation=None, excitation=np.ones((3, 2)))
    figure = excitation_figure(fast_solution, {"EMG": activity(), "lab": lab})
    for j, name in enumerate(("soleus", "vasti")):
        drawn = line(panel(figure, name), "EMG")
        np.testing.assert_array_equal(drawn.get_xdata(), TIME)
        np.testing.assert_array_equal(drawn.get_ydata(), activity().activation[:, j])
        np.testing.assert_array_equal(line(panel(figure, name), "lab").get_ydata(), 1)
    assert not any(artist.get_label() in ("EMG", "lab") for artist in panel(figure, "gastroc").get_lines())
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts[-2:] == ["EMG (activation)", "lab (excitation)"]


def test_overlays_are_told_apart_and_lie_on_top(fast_solution):
    ax = panel(excitation_figure(fast_solution, {"a": activity(), "b": activity()}), "vasti")
    mine, first, second = (line(ax, label) for label in ("activation", "a", "b"))
    assert mine.get_linestyle() == "-"
    assert first.get_linestyle() == second.get_linestyle() == "--"
    assert first._dash_pattern != second._dash_pattern
    assert first.get_zorder() > max(artist.get_zorder() for artist in (mine, *ax.patches))


def test_overlays_lie_on_top_of_any_number_of_solutions(fast_solution):
    solutions = {f"run {k}": fast_solution for k in range(9)}
    ax = panel(excitation_figure(solutions, {"EMG": activity()}), "vasti")
    below = [artist for artist in ax.get_lines() if artist.get_label() == "activation"]
    assert len(below) == 9
    assert line(ax, "EMG").get_zorder() > max(artist.get_zorder() for artist in (*below, *ax.patches))


def test_overlay_does_not_change_the_axes(fast_solution):
    far = activity(time=TIME + 100, activation=np.full((3, 2), 7.0))
    for solution in (fast_solution, {"a": fast_solution, "b": fast_solution}):
        with_it = panel(excitation_figure(solution, {"EMG": far}), "vasti")
        without = panel(excitation_figure(solution), "vasti")
        assert with_it.get_xlim() == without.get_xlim()
        assert with_it.get_ylim() == without.get_ylim()


def test_overlay_without_a_common_muscle_is_refused(fast_solution):
    with pytest.raises(SettingsError, match=r"overlay 'EMG' has none of the muscles iliopsoas, .*: use their names$"):
        excitation_figure(fast_solution, {"EMG": activity(muscle_names=("M. soleus", "M. vastus"))})


# --- OpenSim's tables ----------------------------------------------------------------------------------------------


def test_reads_a_run(leg8, tmp_path):
    path = tmp_path / "cmc_b.csv"
    path.write_text(TABLE)
    run = read_run(path, leg8)
    assert run.muscle_names == ("iliopsoas", "tib_ant")  # the model's names and order
    np.testing.assert_array_equal(run.time, [0, 0.005])
    np.testing.assert_array_equal(run.activation, [[0.2, 0.1], [0.6, 0.5]])
    np.testing.assert_array_equal(run.excitation, [[0.3, 0.4], [0.7, 0.8]])
    np.testing.assert_allclose(run.qpos, [[0, 0, 0], [np.pi / 2, -np.pi / 4, np.pi]])
    np.testing.assert_array_equal(run.activity.activation, run.activation)
    assert run.activity.muscle_names == run.muscle_names
    path.write_text("time,a_soleus_r\n0,.5\n")
    assert read_run(path, leg8).excitation is None
    assert read_run(path, leg8).qpos is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("a_tib_ant_r,a_iliopsoas_r", "b,c", "no activation of a muscle of model 'leg8' among .*such as a_iliopsoas_r"),
        ("u_tib_ant_r", "u_x", "no column 'u_tib_ant_r', but others of its kind"),
        ("q_knee", "q_elbow", "no column 'q_knee', but others of its kind"),
        (".6,", "nan,", r"line 3, column 'a_iliopsoas_r': nan: give finite numbers"),
        (".005", "inf", r"line 3, column 'time': inf: give finite"),
        (".005", "0", r"line 3: time 0 s follows 0 s: put the rows in order"),
        (".6,", "six,", r"line 3, column 'a_iliopsoas_r': 'six' is not a number"),
        ("time", "clock", "no column 'time'"),
    ],
)
def test_bad_tables_are_refused(leg8, tmp_path, old, new, message):
    path = tmp_path / "run.csv"
    assert old in TABLE
    path.write_text(TABLE.replace(old, new, 1))
    with pytest.raises(MotionError, match=rf"^{path}.*{message}[^\n]*$"):
        read_run(path, leg8)


def test_reference_is_none_where_there_is_none(leg8, tmp_path):
    assert read_reference(leg8, "fast", folder=tmp_path) is None
    (tmp_path / "so_b.csv").write_text(TABLE)
    assert read_reference(leg8, "fast", "static", tmp_path) is not None
    assert read_reference(leg8, "fast", "cmc", tmp_path) is None
    for movement, method, message in (("walk", "cmc", "no movement 'walk'.*slow, fast"), ("slow", "so", "cmc, static")):
        with pytest.raises(SettingsError, match=message):
            read_reference(leg8, movement, method, tmp_path)


def test_reference_is_found_beside_the_checkout_or_the_current_folder(tmp_path, monkeypatch):
    package, here = tmp_path / "site" / "mjhcmc", tmp_path / "work" / "project"
    for folder in (package, here):
        folder.mkdir(parents=True)
    monkeypatch.setattr(reference, "__file__", str(package / "opensim_reference.py"))
    monkeypatch.chdir(here)
    assert find_reference() is None
    beside_here = here.parent / "shared" / "reference" / "opensim_cmc"
    beside_checkout = tmp_path / "shared" / "reference" / "opensim_cmc"
    beside_here.mkdir(parents=True)
    assert find_reference() == beside_here
    (package.parent / "pyproject.toml").write_text("")
    assert find_reference() is None
    beside_checkout.mkdir(parents=True)
    assert find_reference() == beside_checkout


def test_opensims_own_runs_follow_the_cosine(leg8, slow, fast):
    """Its CMC tracks the movement within .4 deg: angles, signs and times are read as they are meant."""
    for name, motion in (("slow", slow), ("fast", fast)):
        run = read_reference(leg8, name)
        assert np.rad2deg(np.abs(run.qpos - motion.sample(run.time).qpos).max()) < 0.4
        assert run.muscle_names == leg8.muscle_names
        static = read_reference(leg8, name, "static")
        assert (static.excitation, static.qpos) == (None, None)
        np.testing.assert_allclose(static.time[[0, -1]], motion.time[[0, -1]])


def test_documents_tell_one_error_of_opensims_stored_run(leg8, fast, tmp_path, monkeypatch):
    """The table of accuracy.py has what the stored run says, as `reproduce` has; where there is none, no figure."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    script = runpy.run_path(str(BENCHMARKS / "accuracy.py"))
    run = read_reference(leg8, "fast")
    error = np.rad2deg(Reproduction("fast", {}, {}, 0.0, run).opensim_error())
    expected = [f"{value:.3g}" for value in (*np.abs(error).max(axis=0), *np.sqrt((error**2).mean(axis=0)))]
    assert script["opensim_cmc"]("fast", 0.01) == expected
    row = "| fast, 10 ms | OpenSim 4.6 CMC, 10 ms look-ahead | " + " | ".join(expected) + " |"
    assert row in (BENCHMARKS.parent / "docs" / "accuracy.md").read_text(encoding="utf-8")
    assert script["opensim_cmc"]("slow", 0.005) == []
    monkeypatch.setattr(reference, "SHIPPED", tmp_path)
    assert script["opensim_cmc"]("fast", 0.01) == []


def test_shipped_tables_are_those_that_were_made():
    made = SHARED / "reference" / "opensim_cmc"
    if not made.is_dir():
        pytest.skip("OpenSim's runs (shared/reference/opensim_cmc) are not beside this checkout")
    tables = sorted(path.name for path in reference.SHIPPED.glob("*.csv"))
    assert tables == sorted(path.name for path in made.glob("*.csv"))
    for name in tables:
        assert (reference.SHIPPED / name).read_bytes() == (made / name).read_bytes()

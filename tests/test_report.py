"""The report's text and data: all of the solution is there, as it is, in one file that asks for nothing else."""

import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plot_tools import make, with_roles
from report_tools import of_many_nodes, off_by, page_of, taken_apart, with_reserve

import mjhcmc
from mjhcmc.emg_comparison import compare_emg
from mjhcmc.plotting.moments import MUSCLE_COLORS
from mjhcmc.plotting.panels import PALETTE
from mjhcmc.report.page import report, write_report
from mjhcmc.report.series import MOST_POINTS, Book, thinned, unpacked
from mjhcmc.report.units import percent, short

SECTIONS = ["verdict", "replay", "excitations", "angles", "moments", "muscles", "facts"]
NASTY = ('</script><script>alert("1")</script>', "Oberschenkel \"hinten\" & 'größer'", "<b>&amp;%{x}", "soleus")


@pytest.fixture(scope="module")
def fast_page(fast_solution):
    return page_of(fast_solution, run={"command": ["solve", "leg8", "a b.mot"], "versions": {"mujoco": "3.17"}})


@pytest.fixture(scope="module")
def measured(fast_solution):
    """Envelopes of three muscles: their own activation, 20 ms early."""
    s = fast_solution
    return mjhcmc.Emg(s.time - 0.02, 3 * s.activation[:, :3], s.muscle_names[:3], name="a recording", raw=False)


def test_sections_are_there_in_order_and_the_contents_lead_to_them(fast_page):
    assert [name for name in fast_page.sections if name in SECTIONS] == SECTIONS
    links = [attrs["href"] for tag, attrs in fast_page.elements if tag == "a"]
    assert [f"#{name}" for name in SECTIONS] == links[1:]
    ids = [attrs["id"] for _, attrs in fast_page.elements if "id" in attrs]
    assert len(ids) == len(set(ids))
    assert sum(tag == "h1" for tag, _ in fast_page.elements) == 1


def test_every_number_is_the_solutions(fast_page, fast_solution):
    s, deg = fast_solution, np.rad2deg
    reserve = np.concatenate([s.reserve, s.reserve[-1:]])

    def same(name, time, values):
        found = fast_page.column(name)
        np.testing.assert_array_equal(found[0], time)
        np.testing.assert_allclose(found[1], values, rtol=1e-7, atol=1e-30)

    for i, muscle in enumerate(s.muscle_names):
        same(f"excitation/{muscle}", s.time[:-1], s.excitation[:, i])
        same(f"activation/{muscle}", s.time, s.activation[:, i])
        same(f"force/{muscle}", s.time, s.muscle_force[:, i])
        same(f"fiber_length/{muscle}", s.time, s.detail.normalized_fiber_length[:, i])
        same(f"fiber_velocity/{muscle}", s.time, s.detail.normalized_fiber_velocity[:, i])
    for j, joint in enumerate(s.dof_names):
        same(f"desired/{joint}", s.time, deg(s.qpos_desired[:, j]))
        same(f"actual/{joint}", s.time, deg(s.qpos[:, j]))
        same(f"error/{joint}", s.time, deg(s.tracking_error[:, j]))
        same(f"net/{joint}", s.time, s.net_joint_moment[:, j])
        same(f"reserve/{joint}", s.time[:-1], s.reserve[:, j])
        parts = [name for name in fast_page.data["columns"] if name.startswith(f"contribution/{joint}/")]
        total = sum(fast_page.column(name)[1] for name in parts)  # the stack, reserve and all, is the net moment
        np.testing.assert_allclose(total, s.net_joint_moment[:, j], atol=1e-5 * s.peak_moment[j])
        np.testing.assert_allclose(fast_page.column(f"contribution/{joint}/reserve")[1], reserve[:, j], rtol=1e-6)
    assert {own["clock"] for own in fast_page.data["columns"].values()} == {"nodes", "windows", "detail"}
    assert fast_page.data["clocks"]["windows"]["end"] == s.time[-1]


def test_every_muscle_and_joint_has_its_panels(fast_page, fast_solution):
    places = [attrs["data-panel"] for tag, attrs in fast_page.elements if tag == "figure"]
    assert sorted(places) == sorted(fast_page.data["panels"])
    count = {kind: sum(name.startswith(kind) for name in places) for kind in ("excitation", "state", "angle", "moment")}
    assert count == {"excitation": 8, "state": 8, "angle": 3, "moment": 3}
    first = fast_page.data["panels"]["excitation-0"]["lines"]
    assert [(line["role"], line.get("step", False)) for line in first] == [("excitation", True), ("activation", False)]
    for tag, attrs in fast_page.elements:  # what is drawn is told to those who do not see it
        if attrs.get("class") == "plot":
            assert attrs["role"] == "img"
            assert len(attrs["aria-label"]) > 30, tag


def test_a_verdict_that_holds_with_what_decides_beside_its_threshold(fast_page, fast_solution):
    verdict = fast_solution.verdict
    words = fast_page.words("verdict")
    assert "The simulation holds: muscles moved the model along the motion." in words
    assert "Whether the person's muscles did the same is another question" in words  # no claim about a person
    assert "cannot" not in words
    assert "Residuals" not in words
    worst = int(np.argmax(verdict.tracking_rms))
    assert fast_page.row("Error of angles, RMS")[1:] == [
        "at most 1 deg",
        f"{short(np.rad2deg(verdict.tracking_rms[worst]))} deg ({fast_solution.dof_names[worst]})",
        "holds",
    ]
    assert fast_page.row("Reserve, of the peak moment")[1::2] == ["at most 5 %", "holds"]
    for j, name in enumerate(fast_solution.dof_names):
        largest, rms, peak, reserve, replay = fast_page.row(name)[1:]
        assert largest == f"{short(np.rad2deg(verdict.tracking_max[j]))} deg"
        assert rms == f"{short(np.rad2deg(verdict.tracking_rms[j]))} deg"
        assert peak == f"{short(fast_solution.peak_moment[j])} N m"
        assert reserve == f"{short(verdict.peak_reserve[j])} N m ({percent(verdict.peak_reserve_share[j])})"
        assert replay == f"{short(np.rad2deg(verdict.replay_max_error[j]))} deg"


def test_a_reserve_that_is_too_large_is_told_with_joint_share_and_time():
    solution = with_reserve(make(), joint=1, share=0.2, window=7)
    page = page_of(solution)
    words = page.words("verdict")
    at = f"{solution.time[7]:.3f} s"
    told = "The simulation fails: at knee the reserve reaches 20 % of the peak moment, above the threshold of 5 %"
    assert told in words
    assert "These excitations cannot be believed." in words
    assert f"knee: {short(0.2 * solution.peak_moment[1])} N m at {at}, 20 % of its peak moment" in words
    assert page.row("Reserve, of the peak moment")[2:] == ["20 % (knee)", "fails"]
    assert "reserve in use in 1 of 30 windows (0.670 to 0.680 s)" in words
    assert all(line in words for line in solution.verdict.findings)
    assert "What to try" in words
    assert page.data["flagged"] == [[solution.time[7], solution.time[8]]]
    assert "above the threshold" in page.words("moments")


def test_an_error_that_is_too_large_and_a_method_that_explains_it():
    words = page_of(off_by(make(method="static"), joint=2, error=np.deg2rad(-3))).words("verdict")
    assert "The simulation fails: at ankle the tracking error is 3 deg RMS, above the threshold of 1 deg" in words
    assert "ankle: off by up to 3 deg" in words
    assert "Solve the same motion by hcmc or cmc" in words
    assert "Solve the same motion by hcmc or cmc" not in page_of(make(method="static")).words("verdict")


def test_an_interrupted_solve_is_no_result():
    page = page_of(replace(make(), interrupted=True))
    assert "The simulation fails: the solve was interrupted at 0.900 s" in page.words("verdict")
    assert page.row("Motion solved")[2:] == ["to 0.900 s, interrupted", "fails"]


def test_the_muscle_that_is_longest_at_full_excitation():
    solution = make()
    excitation = solution.excitation.copy()
    excitation[3:8, 4], excitation[10:12, 1], excitation[20:23, 1] = 1.0, 1.0, 1.0
    page = page_of(replace(solution, excitation=excitation))
    told = "vasti: at full excitation for 50 ms from 0.630 s, 16.7 % of the time; 2 muscles reach full excitation"
    assert told in page.words("verdict")
    spans = page.data["panels"]["excitation-1"]["bands"]["saturated"]
    np.testing.assert_allclose(spans, [[0.7, 0.72], [0.8, 0.83]])
    assert "bands" not in page.data["panels"]["excitation-0"]


def test_what_nothing_gave_is_drawn_where_it_counts():
    solution = make()
    shortfall = solution.shortfall.copy()
    shortfall[:, 0] = 0.3 * solution.peak_moment[0]
    shortfall[:, 1] = 1e-5 * solution.peak_moment[1]
    page = page_of(replace(solution, shortfall=shortfall))
    np.testing.assert_allclose(page.column("unmet/hip")[1], shortfall[:, 0], rtol=1e-6)
    assert "unmet/knee" not in page.data["columns"]
    assert "unmet up to 30 % of it" in page.words("moments")


def test_slides_are_in_millimetres_and_prescribed_joints_are_named():
    solution = with_roles(make(dofs=("pelvis_tx", "hip"), slides=("pelvis_tx",)), ["prescribed", "tracked"])
    residual = np.zeros_like(solution.net_joint_moment)
    residual[:, 0] = np.linspace(-40, 60, 31)
    page = page_of(replace(solution, residual=residual))
    np.testing.assert_allclose(page.column("error/pelvis_tx")[1], 1e3 * solution.tracking_error[:, 0], rtol=1e-6)
    np.testing.assert_allclose(page.column("residual/pelvis_tx")[1], residual[:, 0], rtol=1e-6)
    assert "follow the motion: pelvis tx." in page.words("verdict")
    assert "peak 60 N at 0.900 s" in page.words("moments")
    # residuals are told, and what is right by construction does not count among what decides
    rms = short(np.sqrt((residual[:, 0] ** 2).mean()))
    assert f"pelvis tx: up to 60 N, at 0.900 s (RMS {rms} N)" in page.words("verdict")
    assert "Error of positions, RMS" not in {cells[0] for cells in page.cells}
    places = [attrs["id"] for _, attrs in page.elements if attrs.get("id") == "residuals"]
    assert places == ["residuals"]
    assert "#residuals" in {attrs.get("href") for tag, attrs in page.elements if tag == "a"}
    tracked = page_of(make(dofs=("pelvis_tx", "hip"), slides=("pelvis_tx",)))
    assert tracked.row("Error of positions, RMS")[1] == "at most 10 mm"


def test_without_reserves_what_was_unmet_is_told():
    solution = make()
    shortfall = np.zeros_like(solution.reserve)
    shortfall[12, 0] = -0.4 * solution.peak_moment[0]
    settings = {**solution.settings, "reserves": False}
    page = page_of(replace(solution, reserve=np.zeros_like(shortfall), shortfall=shortfall, settings=settings))
    told = (
        f"up to {short(0.4 * solution.peak_moment[0])} N m were unmet (hip, at {solution.time[12]:.3f} s; 40 % of its"
    )
    assert f"no reserves were allowed; {told}" in page.words("verdict")
    assert page.row("Reserve, of the peak moment")[3] == "not used"
    assert "gave every moment" not in page.words("verdict")
    all_met = page_of(replace(solution, reserve=np.zeros_like(shortfall), shortfall=0 * shortfall, settings=settings))
    assert "no reserves were allowed; the muscles gave every moment by themselves" in all_met.words("verdict")


def test_what_is_not_a_number_stays_a_gap_and_an_odd_run_is_no_obstacle():
    solution = make()
    net = solution.net_joint_moment.copy()
    net[3:5, 1] = np.nan
    page = page_of(replace(solution, net_joint_moment=net), run={"notices": 5, "command": 7, "model": {"path": 5}})
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(page.column("net/knee")[1])), [3, 4])
    assert "limits" not in page.data["panels"]["moment-1"]["rows"][1]


def test_names_from_outside_are_text_and_nothing_else(tmp_path):
    solution = make(muscles=NASTY, dofs=("hip", "</title>knee"), model="<img src=x onerror=alert(1)>")
    plain = taken_apart(report(make(muscles=("a", "b", "c", "d"), dofs=("hip", "knee"))))
    page = page_of(
        solution, others={"<i>other</i>": solution}, title="</title><script>bad()</script>",
        run={"command": "</code><script>x</script>", "inputs": [{"<b>what": "ü & \"'"}]},
    )  # fmt: skip
    tags = {tag for tag, _ in page.elements}
    assert tags <= {tag for tag, _ in plain.elements} | {"code", "h3"}
    assert len(page.scripts) == len(plain.scripts)
    titles = [page.data["panels"][f"excitation-{i}"]["title"] for i in range(4)]
    assert titles == [name.replace("_", " ") for name in NASTY]
    for name in (*titles, "<i>other</i>: activation"):
        assert " ".join(name.split()) in page.words("excitations")
    assert "</code><script>x</script>" in page.words("facts")
    written = write_report(solution, tmp_path / "ä ö.html", title="größer")
    assert "<title>größer</title>" in written.read_text(encoding="utf-8")


def test_one_file_that_asks_for_nothing(fast_page):
    for tag, attrs in fast_page.elements:
        assert tag not in ("link", "img", "iframe", "object", "embed", "base", "form"), tag
        assert "src" not in attrs, tag
        assert attrs.get("href", "#").startswith("#")
        assert not any(key.startswith("on") for key in attrs)
    assert not any("url(" in style or "@import" in style for style in fast_page.styles)
    policy = next(attrs["content"] for tag, attrs in fast_page.elements if "http-equiv" in attrs)
    assert policy.startswith("default-src 'none'")
    assert not re.search(r"https?:|\*", policy)
    own = [text for _, parts in fast_page.scripts if len(text := "".join(parts)) < 500_000]
    assert not any(re.search(r"https?://|fetch\(|XMLHttpRequest|import\(", text) for text in own)
    assert fast_page.text.count("* plotly.js v") == 1
    assert len(fast_page.text.encode()) < 6e6


def test_colours_are_those_of_the_figures(fast_page):
    (style,) = [style for style in fast_page.styles if "--blue" in style]
    light = dict(re.findall(r"--(\w+): (#\w{6})", style.split('[data-theme="dark"]')[0]))
    names = ("blue", "vermillion", "green", "purple", "orange", "sky")
    assert [light[name] for name in names] == list(PALETTE[:6])
    assert [light[f"m{i}"] for i in range(len(MUSCLE_COLORS))] == list(MUSCLE_COLORS)


def test_emg_is_laid_over_with_how_well_it_agrees(fast_solution, measured):
    page = page_of(fast_solution, emg=measured)
    found = compare_emg(fast_solution, measured)
    for i, one in enumerate(found.muscles):
        time, envelope = page.column(f"emg/{one.muscle}")
        np.testing.assert_array_equal(time, found.time)
        np.testing.assert_allclose(envelope, found.envelope[:, i], rtol=1e-6)
        line = page.data["panels"][f"excitation-{i}"]["lines"][0]
        assert (line["role"], line["factor"]) == ("emg", pytest.approx(one.scale))
        told = f"r {one.r:.2f}, best {one.r_best:.2f} at lag {1e3 * one.lag:+.0f} ms, overlap {one.jaccard:.2f}, "
        assert f"{told}MAE {one.mae:.3f}".replace("-", "−") in page.words("excitations")
    assert "5 of 8 muscles have no EMG" in page.words("excitations")
    assert page.data == page_of(fast_solution, emg=found).data  # compared before: the same page


def test_emg_that_does_not_fit_is_refused_and_nothing_written(fast_solution, measured, tmp_path):
    path = tmp_path / "page.html"
    with pytest.raises(mjhcmc.SettingsError, match="bring it onto the solution's clock"):
        write_report(fast_solution, path, emg=measured.shifted(50))
    with pytest.raises(mjhcmc.SettingsError, match="gastroc"):
        write_report(fast_solution, path, emg=measured, emg_map={"soleus": "gastroc"})
    assert not list(tmp_path.iterdir())


def test_other_solutions_are_drawn_for_what_is_common():
    solution, other = make(), make(muscles=("soleus", "extra"), dofs=("knee",), seed=3, n=20, method="static")
    page = page_of(solution, others={"static": other})
    drawn = {name for name, panel in page.data["panels"].items() for own in panel["lines"] if own["role"] == "other0"}
    assert drawn == {"excitation-6", "angle-1"}
    time, values = page.column("other0/activation/soleus")
    np.testing.assert_array_equal(time, other.time)
    np.testing.assert_allclose(values, other.activation[:, 0], rtol=1e-6)
    time, values = page.column("other0/excitation/soleus")
    np.testing.assert_array_equal(time, other.time[:-1])
    np.testing.assert_allclose(values, other.excitation[:, 0], rtol=1e-6)
    np.testing.assert_allclose(page.column("other0/actual/knee")[1], np.rad2deg(other.qpos[:, 0]), rtol=1e-6)
    assert page.row("static")[1] == "static"
    assert "static has 1 of the 8 muscles" in page.text


@pytest.mark.parametrize(
    ("others", "words"),
    [
        ({"arm": make(muscles=("biceps",))}, "arm: has none of the muscles"),
        ({"later": replace(make(), time=make().time + 9)}, "later: covers 9.6 to 9.9 s"),
        ({str(i): make() for i in range(5)}, "draws 4 at most"),
    ],
)
def test_others_that_cannot_be_drawn_are_refused(others, words, tmp_path):
    with pytest.raises(mjhcmc.SettingsError, match=words):
        write_report(make(), tmp_path / "page.html", others=others)
    assert not list(tmp_path.iterdir())


def test_without_its_model_a_solution_tells_what_it_knows():
    solution = make()
    page = page_of(solution, why_no_model="the model was not found: name it with --model")
    for section in ("replay", "moments", "muscles", "facts"):
        assert "name it with --model" in page.words(section)
    assert "Replay: not known" in page.words("verdict")
    np.testing.assert_allclose(page.column("net/hip")[1], solution.net_joint_moment[:, 0], rtol=1e-6)
    assert "stack" not in page.data["panels"]["moment-0"]
    assert len(page.data["panels"]["state-0"]["rows"]) == 1  # force alone
    assert "mjhcmc-replay-data" not in page.text


def test_what_has_no_number_is_a_gap():
    solution = make()
    error = solution.tracking_error.copy()
    error[5:9, 0] = np.nan
    values = page_of(replace(solution, tracking_error=error)).column("error/hip")[1]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(values)), range(5, 9))


def test_facts_of_model_and_run(fast_page, fast_solution):
    words = fast_page.words("facts")
    assert "mjhcmc solve leg8 'a b.mot'" in words
    assert fast_page.row("versions")[1] == "mujoco: 3.17"
    assert fast_page.row("dt")[1] == "0.01"
    assert {cells[0] for cells in fast_page.cells} >= set(fast_solution.settings)
    assert [cells[2] for cells in fast_page.cells if len(cells) == 4 and cells[1] == "hinge (deg)"] == ["tracked"] * 3


def test_long_motions_are_thinned_and_keep_their_peaks(fast_solution):
    solution = of_many_nodes(fast_solution, 4000)
    excitation = solution.excitation.copy()
    excitation[2503, 6] = 0.987  # one window
    page = page_of(replace(solution, excitation=excitation, stored_verdict=fast_solution.verdict))
    assert "4001 nodes" in page.text
    for name, own in page.data["columns"].items():
        assert len(unpacked(own["v"])) <= 1.01 * MOST_POINTS, name
    time, values = page.column("excitation/soleus")
    at = np.searchsorted(solution.time, time - 1e-9)
    np.testing.assert_allclose(values, excitation[at, 6], rtol=1e-6, atol=1e-30)
    assert values.max() == pytest.approx(0.987)
    stack = [name for name in page.data["columns"] if name.startswith("contribution/knee/")]
    times = {page.column(name)[0].tobytes() for name in stack}
    assert len(times) == 1  # areas are added up: of the same instants
    total = sum(page.column(name)[1] for name in stack)
    at = np.searchsorted(solution.time, page.column(stack[0])[0] - 1e-9)
    np.testing.assert_allclose(total, solution.net_joint_moment[at, 1], atol=1e-4)


@given(st.lists(st.floats(-1e3, 1e3) | st.just(np.nan), min_size=1, max_size=200), st.integers(2, 40))
def test_thinning_keeps_ends_extremes_and_gaps(values, most):
    values = np.array(values)
    kept = thinned(values, most)
    if len(values) <= most:
        assert kept is None
        return
    assert {0, len(values) - 1} <= set(kept.tolist())
    assert (np.diff(kept) > 0).all()
    assert len(kept) <= 1.5 * most + 4
    if np.isfinite(values).any():
        assert np.nanmax(values[kept]) == np.nanmax(values)
        assert np.nanmin(values[kept]) == np.nanmin(values)
    assert np.isnan(values[kept]).any() == np.isnan(values).any()


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (0.0123456, "0.0123"),
        (1234.5, "1234"),
        (-12.34, "−12.3"),
        (1.234e-5, "1.23×10⁻⁵"),
        (np.nan, "not known"),
    ],
)
def test_three_digits(value, text):
    assert short(value) == text


def test_the_folder_must_be_there(tmp_path):
    with pytest.raises(mjhcmc.OutputError, match="create it first"):
        write_report(make(), tmp_path / "none" / "page.html")


def test_texts_are_escaped_once(fast_solution):
    page = page_of(replace(fast_solution, settings={**fast_solution.settings, "note": "5 < 6 & more"}))
    assert page.row("note")[1] == "5 < 6 & more"
    assert "&amp;lt;" not in page.text
    assert unescape("&lt;") in page.row("note")[1]


def test_columns_of_the_same_name_are_kept_apart():
    book = Book()
    nodes = book.clock("nodes", np.arange(3.0))
    first, second = (book.column("reserve", nodes, np.full(3, value)) for value in (1.0, 2.0))
    assert [unpacked(book.columns[name]["v"])[0] for name in (first, second)] == [1.0, 2.0]

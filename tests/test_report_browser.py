"""The report in a real browser, without a network: it draws, answers the pointer, changes its colours, and prints."""

import re

import numpy as np
import pytest
from browser_tools import browser, watched_page
from plot_tools import make

import mjhcmc
from mjhcmc.report.page import write_report

__all__ = ["browser"]

pytestmark = pytest.mark.browser

LEFT, RIGHT = 54, 18  # px beside the axes, as in report.js
SHOWN, FOLDED = 14, 8  # panels of the fast movement


@pytest.fixture(scope="module")
def fast_file(fast_solution, tmp_path_factory):
    return write_report(fast_solution, tmp_path_factory.mktemp("report") / "report.html", run={"command": ["solve"]})


def opened(browser, path, **context):
    context.setdefault("viewport", {"width": 1300, "height": 850})
    watched = watched_page(browser, **context)
    watched.page.goto(path.as_uri())
    watched.page.wait_for_selector("html[data-ready]")
    return watched


@pytest.fixture(scope="module")
def desk(browser, fast_file):
    """The page on a desk; what went wrong by the end is told by the last test that uses it."""
    watched = opened(browser, fast_file)
    yield watched
    assert watched.errors == []
    assert watched.outside == []


def until(page, expression):
    """Wait for an expression to hold; playwright's own waiting evaluates texts, which the page's policy forbids."""
    for _ in range(200):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(25)
    pytest.fail(f"never came: {expression}")


def drawn(page):
    """How many panels hold a plot."""
    return page.evaluate(
        "[...document.querySelectorAll('figure[data-drawn]')].filter((f) => f.querySelector('.main-svg')).length"
    )


def scrolled_through(page):
    height = page.evaluate("document.documentElement.scrollHeight")
    for y in range(0, height, 1000):
        page.evaluate(f"scrollTo(0, {y})")
        page.wait_for_timeout(40)


def panel(page, name):
    """The plot of a panel, in sight and drawn."""
    plot = page.locator(f"figure[data-panel='{name}'] .plot")
    plot.scroll_into_view_if_needed()
    page.wait_for_selector(f"figure[data-panel='{name}'][data-drawn]")
    return plot


def spot(plot, time, span):
    """Where a time is in a plot, px from its left."""
    width = plot.bounding_box()["width"]
    return LEFT + (time - span[0]) / (span[1] - span[0]) * (width - LEFT - RIGHT)


def label_at(page, plot, time, solution):
    """What the label says with the pointer at a time, and the time that it tells."""
    plot.hover(position={"x": spot(plot, time, (solution.time[0], solution.time[-1])), "y": 60})
    label = page.locator("#tip")
    assert label.is_visible()
    lines = [label.locator("b").inner_text(), *label.locator("div").all_inner_texts()]
    told = float(lines[0].removesuffix(" s"))
    assert told == pytest.approx(time, abs=0.003)
    return " | ".join(lines), told


def told_number(label):
    """The label with numbers as Python reads them."""
    raised = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    return re.sub(r"×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", lambda found: "e" + found[1].translate(raised), label.replace("−", "-"))


def test_it_draws_what_is_near_and_then_all(desk):
    page = desk.page
    assert page.title() == "HCMC · leg8 · fast · dt 10 ms"
    assert drawn(page) < SHOWN
    scrolled_through(page)
    assert drawn(page) == SHOWN
    page.locator("#muscles summary").click()
    scrolled_through(page)
    assert drawn(page) == SHOWN + FOLDED
    assert page.locator("figure .main-svg .trace").count() > 3 * SHOWN
    assert page.locator("#replay-player canvas").count() == 1
    assert page.evaluate("performance.getEntriesByType('resource').length") == 0


def test_the_label_under_the_pointer_tells_the_solutions_values(desk, fast_solution):
    page, s = desk.page, fast_solution
    plot, k = panel(page, "excitation-6"), 25
    label, time = label_at(page, plot, s.time[k] + 0.008, s)  # nearer to node k + 1, in window k
    assert s.time[k] < time < s.time[k + 1]
    found = dict(re.findall(r"soleus (\w+) (\S+)", label))
    assert float(found["activation"]) == pytest.approx(np.interp(time, s.time, s.activation[:, 6]), rel=1e-2)
    assert float(found["excitation"]) == pytest.approx(s.excitation[k, 6], rel=1e-3)


def test_lines_of_other_windows_are_told_at_the_same_time(browser, leg8, fast_solution, tmp_path):
    s = fast_solution
    fine = mjhcmc.hcmc(leg8, mjhcmc.Motion.cosine(leg8, "fast"), dt=0.005)
    watched = opened(browser, write_report(s, tmp_path / "report.html", others={"fine": fine}))
    k = int(np.argmax(np.minimum(*(np.abs(np.diff(u)) for u in (s.excitation[:, 6], fine.excitation[1::2, 6])))))
    label, time = label_at(watched.page, panel(watched.page, "excitation-6"), s.time[k] + 0.0075, s)
    found = {name: float(value) for name, value in re.findall(r"(soleus \w+|fine: \w+) (\S+)", told_number(label))}
    for name, one in (("soleus", s), ("fine:", fine)):
        window = int(np.searchsorted(one.time, time, side="right")) - 1
        assert abs(one.excitation[window, 6] - one.excitation[window + 1, 6]) > 0.01  # no other's would do
        assert found[f"{name} excitation"] == pytest.approx(one.excitation[window, 6], rel=1e-3)
        assert found[f"{name} activation"] == pytest.approx(np.interp(time, one.time, one.activation[:, 6]), rel=1e-2)
    assert watched.errors == []


def test_the_label_of_a_stack_tells_each_muscle_with_its_unit(desk, fast_solution):
    page, s = desk.page, fast_solution
    plot, k = panel(page, "moment-1"), 31
    label, time = label_at(page, plot, s.time[k], s)
    told = dict(re.findall(r"([a-z][a-z ]*) (\S+) N m", told_number(label)))
    net, vasti = s.net_joint_moment[:, 1], s.detail.muscle_moment[:, s.muscle_names.index("vasti"), 1]
    for name, values in (("knee net moment", net), ("vasti", vasti)):
        off = 1e-3 * np.ptp(values)
        assert float(told[name]) == pytest.approx(np.interp(time, s.time, values), abs=off)


def test_a_click_moves_the_replay_and_the_replay_moves_the_line(desk, fast_solution):
    page, span = desk.page, (fast_solution.time[0], fast_solution.time[-1])
    page.evaluate("document.addEventListener('mjhcmc:time', (e) => (window.told = e.detail))")
    plot = panel(page, "angle-0")
    plot.click(position={"x": spot(plot, 0.2, span), "y": 90})
    until(page, "window.told && window.told.from === 'plot'")
    assert page.evaluate("window.told.time") == pytest.approx(0.2, abs=0.003)
    shown = re.search(r"(\d\.\d{3}) s", page.locator("#replay-player").inner_text())
    assert float(shown[1]) == pytest.approx(0.2, abs=0.003)
    page.evaluate("document.dispatchEvent(new CustomEvent('mjhcmc:time', {detail: {time: 0.45, from: 'replay'}}))")
    for name in ("angle-0", "angle-2"):
        plot = panel(page, name)
        line, box = plot.locator(".cursor").bounding_box(), plot.bounding_box()
        assert line["x"] - box["x"] == pytest.approx(spot(plot, 0.45, span), abs=1.5)


def test_looking_closer_in_one_plot_is_so_in_all(desk):
    page = desk.page
    plot = panel(page, "angle-1")
    box = plot.bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 80)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 82, steps=4)
    page.mouse.up()
    other = "document.querySelector(\"figure[data-panel='angle-0'] .js-plotly-plot\").layout.xaxis.range"
    until(page, f"{other}[0] > 0.05")
    low, high = page.evaluate(other)
    width = box["width"] - LEFT - RIGHT
    np.testing.assert_allclose([low, high], [0.6 * (x - LEFT) / width for x in (100, 200)], atol=0.01)
    page.evaluate("document.querySelector(\"figure[data-panel='angle-0'] .js-plotly-plot\").emit('plotly_doubleclick')")
    until(page, f"{other}[1] === 0.6")


def test_dark_and_light(browser, fast_file):
    watched = opened(browser, fast_file, color_scheme="dark")
    page = watched.page
    panel(page, "angle-0")
    paper = "getComputedStyle(document.body).backgroundColor"
    stroke = "getComputedStyle(document.querySelector(\"figure[data-panel='angle-0'] .js-line\")).stroke"
    dark = page.evaluate(paper), page.evaluate(stroke)
    assert page.locator("#theme").inner_text() == "Light"  # what a click gives
    page.locator("#theme").click()
    until(page, f"{stroke} !== '{dark[1]}'")
    light = page.evaluate(paper), page.evaluate(stroke)
    assert sum(map(int, re.findall(r"\d+", dark[0])[:3])) < 150 < 700 < sum(map(int, re.findall(r"\d+", light[0])[:3]))
    page.reload()  # what was chosen is remembered
    page.wait_for_selector("html[data-ready]")
    assert page.evaluate(paper) == light[0]
    assert watched.errors == []


def test_on_a_phone_nothing_sticks_out(browser, fast_file):
    watched = opened(
        browser, fast_file, viewport={"width": 360, "height": 740}, is_mobile=True, has_touch=True
    )  # fmt: skip
    page = watched.page
    scrolled_through(page)
    assert drawn(page) == SHOWN
    wide = page.evaluate("[document.documentElement.scrollWidth, document.documentElement.clientWidth, innerWidth]")
    assert wide == [360, 360, 360]
    lefts = page.evaluate("[...document.querySelectorAll('#excitations figure')].map((f) => f.offsetLeft)")
    assert len(set(lefts)) == 1  # one column
    plot = panel(page, "excitation-0")
    plot.tap(position={"x": 200, "y": 70})
    assert re.fullmatch(r"0\.\d{3} s", page.locator("#tip b").inner_text())
    assert page.locator("#tip").is_visible()  # stays when the finger is gone
    page.evaluate("scrollBy(0, 60)")
    until(page, "document.getElementById('tip').hidden")
    assert watched.errors == []


def test_on_paper_all_that_is_not_folded_away_is_light_and_not_too_wide(browser, fast_file):
    watched = opened(browser, fast_file, color_scheme="dark")
    page = watched.page
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 703, "height": 1000})  # A4 less margins
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert drawn(page) == SHOWN
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.evaluate("document.documentElement.scrollWidth") <= 703
    assert not page.locator("#theme").is_visible()
    assert page.locator("#replay-player canvas").is_visible()  # stills
    assert not page.locator("#replay-player input[type=range]").is_visible()
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    page.emulate_media(media="screen")
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    pdf = page.pdf(format="A4", print_background=True)
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 12
    assert watched.errors == []


def test_many_muscles_are_found_and_put_in_order_and_names_are_no_markup(browser, tmp_path):
    names = [f"muscle_{i:02d}" for i in range(19)] + ["</script><script>window.bad = 1</script><b>%{x}"]
    solution = make(muscles=names)
    watched = opened(browser, write_report(solution, tmp_path / "many ö.html"))
    page = watched.page
    titles = page.locator("#muscle-grid figure:visible h3")
    assert titles.count() == 20
    page.locator("#muscle-filter").fill("cle 1")
    assert titles.all_inner_texts() == [f"muscle {i}" for i in range(10, 19)]
    page.locator("#muscle-filter").fill("zzz")
    assert page.locator("#muscle-none").is_visible()
    page.locator("#muscle-filter").fill("")
    page.locator("#muscle-order").click()
    wanted = np.argsort(-solution.activation.max(axis=0), kind="stable")
    assert titles.all_inner_texts() == [names[i].replace("_", " ") for i in wanted]
    page.locator("#muscle-order").click()
    assert titles.first.inner_text() == "muscle 00"
    plot = panel(page, "excitation-19")
    label, _ = label_at(page, plot, 0.75, solution)
    assert "<b>%{x} excitation" in label
    assert page.evaluate("window.bad") is None
    assert watched.errors == []

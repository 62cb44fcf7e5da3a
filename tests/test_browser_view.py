"""The pages of `mjhcmc view --browser` and `mjhcmc live` in a real browser: they draw, they answer."""

import io
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from browser_tools import gl_browser, watched_page

import mjhcmc

__all__ = ["gl_browser"]

pytestmark = pytest.mark.browser
pytest.importorskip("viser")

SIZE = {"width": 860, "height": 480}  # small: it is drawn without a GPU
COARSE = 0.4  # of a pixel: software draws each
READY = 15_000  # ms
SCENE = {"x": 380, "y": 30, "width": 130, "height": 440}  # between the panels
BUSY_FOR = 1500  # ms
BUSY = """ms => {
  const path = "//label[normalize-space()='knee, deg']/following::*[@role='slider'][1]";
  const slider = document.evaluate(path, document, null, XPathResult.FIRST_ORDERED_NODE_TYPE).singleNodeValue;
  const vasti = Object.values(window.__viserTestpoints.uplots)
      .find(u => u.chart.root.querySelector('.u-title')?.textContent === 'vasti').chart.data[1];
  slider.focus();
  slider.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight', bubbles: true, cancelable: true}));
  setTimeout(() => { const end = performance.now() + ms; while (performance.now() < end); }, 0);
  return Array.from(vasti);
}"""
SLOW_GL = ("GPU stall due to ReadPixels", "GL Driver Message")  # notes of software rendering


@contextmanager
def opened(browser, page):
    """A tab with the page, once its charts are there."""
    host = page.url.removeprefix("http://")
    watched = watched_page(browser, lambda url: host in url, viewport=SIZE, device_scale_factor=COARSE)
    watched.page.goto(page.url)
    watched.page.wait_for_function(
        "() => Object.keys(window.__viserTestpoints?.uplots ?? {}).length >= 8", timeout=READY
    )
    watched.page.wait_for_selector("canvas")
    try:
        yield watched
    finally:
        watched.page.context.close()


def ours(watched):
    """What the page complains of, without what software rendering does."""
    return [line for line in watched.errors if not any(note in line for note in SLOW_GL)] + watched.outside


def picture(watched):
    """(h, w, 3) 0 .. 255 of the scene between the panels."""
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(watched.page.screenshot(clip=SCENE))).convert("RGB"), dtype=float)


def steady(watched):
    """The picture once it does not change any more."""
    last = [picture(watched)]

    def same():
        last.append(picture(watched))
        return np.abs(last[-1] - last[-2]).mean() < 0.05 and last[-1].std() > 5  # drawn, and not one colour

    wait_until(watched, same)
    return last[-1]


def type_into(watched, label, value):
    """Set a slider by the number beside it, as a user would."""
    box = watched.page.locator(
        f"xpath=//label[normalize-space()='{label}']/following::input[not(@type='hidden')][1]"
    ).first
    box.fill(str(value))
    box.press("Enter")


def drag(watched, label, by):
    """Drag a slider's thumb by pixels, in some moves."""
    thumb = watched.page.locator(f"xpath=//label[normalize-space()='{label}']/following::*[@role='slider'][1]").first
    box = thumb.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    watched.page.mouse.move(x, y)
    watched.page.mouse.down()
    for part in (0.25, 0.5, 0.75, 1.0):
        watched.page.mouse.move(x + part * by, y)
    watched.page.mouse.up()


def charts(watched):
    """{title: last of the charts' data arrays}: what is drawn."""
    return watched.page.evaluate(
        "() => Object.fromEntries(Object.values(window.__viserTestpoints.uplots)"
        ".map(u => [u.chart.root.querySelector('.u-title')?.textContent, Array.from(u.chart.data[1])]))"
    )


def wait_until(watched, condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        watched.page.wait_for_timeout(100)


@pytest.fixture(scope="module")
def solution():
    model = mjhcmc.MuscleModel.load("leg8")
    return mjhcmc.hcmc(model, mjhcmc.Motion.cosine(model, amplitudes={"hip": 0.6, "knee": -0.9}, period=0.6, cycles=1))


@pytest.fixture(scope="module")
def replay(solution):
    asked = solution.qpos + np.array([0.002, 0.0, 0.0])  # HCMC's own errors are too small to be seen, 500 times larger
    page = mjhcmc.view_in_browser(
        replace(solution, qpos_desired=asked), port=0, open_browser=False, block=False, say=print
    )
    page.player.set_playing(False)
    page.player.seek(0.0)
    yield page
    page.close()


def test_the_replay_draws_and_its_slider_moves_the_leg(gl_browser, replay, solution):
    with opened(gl_browser, replay) as one:
        before = steady(one)
        drawn = charts(one)
        assert set(solution.muscle_names) <= set(drawn)
        assert max(drawn["vasti"]) == pytest.approx(solution.excitation[:, solution.muscle_names.index("vasti")].max())
        type_into(one, "Time, s", 0.3)
        wait_until(one, lambda: np.abs(picture(one) - before).mean() > 2)
        moved = steady(one)
        assert replay.player.time == pytest.approx(0.3)
        assert not replay.player.playing  # who drags the time wants to look
        name = "hamstrings"
        at = solution.activation[30, solution.muscle_names.index(name)]
        wait_until(one, lambda: f"{at:.2f}" in one.page.locator("body").inner_text())
        type_into(one, "Error ×", 150)  # the ghost comes out of the bones
        wait_until(one, lambda: np.abs(picture(one) - moved).mean() > 0.2)
        assert ours(one) == []


def test_dragging_brings_new_excitations_and_their_latency(gl_browser, monkeypatch):
    from mjhcmc.viewing import live

    monkeypatch.setattr(live, "_PATIENCE", 15.0)  # software draws
    page = live.live_page(port=0, open_browser=False, block=False, say=lambda line: None)
    try:
        page.player.set_playing(False)  # software rendering would take the processor
        with opened(gl_browser, page) as watched:
            body = watched.page.locator("body")
            wait_until(watched, lambda: "from slider to drawn curves" in body.inner_text())
            before = charts(watched)["vasti"]
            drag(watched, "knee, deg", -40)
            wait_until(watched, lambda: charts(watched)["vasti"] != before)
            names = page.solver.model.muscle_names

            def drawn_as_solved():
                """The curve is that of HCMC on the movement that the slider now says."""
                knee = np.deg2rad(page.slider("knee").value)
                amplitudes = {"hip": np.deg2rad(10.0), "knee": knee, "ankle": np.deg2rad(-10.0)}
                motion = mjhcmc.Motion.cosine(page.solver.model, amplitudes=amplitudes, period=0.3, cycles=2)
                vasti = mjhcmc.hcmc(page.solver.model, motion).excitation[:, names.index("vasti")]
                return charts(watched)["vasti"] == pytest.approx(np.repeat(vasti, 2).tolist())

            wait_until(watched, drawn_as_solved)
            assert page.slider("knee").value < -30
            wait_until(watched, lambda: f"{1e3 * page.seen[-1]:.0f} ms" in body.inner_text())
            late = watched.page.evaluate(BUSY, BUSY_FOR)  # the browser draws nothing for a while after the slider
            wait_until(watched, lambda: charts(watched)["vasti"] != late)
            wait_until(watched, lambda: page.seen[-1] > 0.6 * BUSY_FOR / 1e3)  # it began a little before the event came
            assert page.seen[-1] > page.sent[-1]
            wait_until(watched, lambda: "holds" in body.inner_text())
            type_into(watched, "Gain, s", 0.05)
            wait_until(watched, lambda: page.result.reflex.any())
            wait_until(watched, lambda: "co-contraction, knee" in body.inner_text())
            assert ours(watched) == []
    finally:
        page.close()


def test_ctrl_c_ends_the_command():
    """The whole command in a process of its own."""
    done = subprocess.Popen(
        [sys.executable, "-m", "mjhcmc", "live", "--no-open", "--port", "0"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    said = [done.stdout.readline(), done.stdout.readline()]
    assert said[1].startswith("live, leg8: http://127.0.0.1:")
    done.send_signal(signal.SIGINT)
    rest, complaints = done.communicate(timeout=20)
    assert done.returncode in (0, 130)
    assert complaints == ""
    assert rest == "ended\n"

"""From a slider of the live page to curves that are drawn, as Markdown.

    python benchmarks/live.py [--write [DOCUMENT]]

--write replaces the tables in docs/viewing.md (or DOCUMENT). Needs the extra view. The first table is of the server
alone. Where there is Chromium (or what MJHCMC_CHROMIUM names) and playwright, a browser looks at the page: the second
is from a key in it to its next picture with the new curves, by its own clock, beside what the page says of itself.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from _markdown import ROOT, grid
from _markdown import main as run_script
from _timing import PACKAGES, machine, quiet

from mjhcmc.viewing.live import LivePage, live_page

CHANGES = 50
LOOKS = 15  # changes in the browser, for each row
PAUSE = 0.25  # s between changes, so that nothing of the one before is left
DRAGGED, EVENTS = 0.05, 80  # s between events of a hand that does not stop, and how many
AMPLITUDES = {"hip": (-10.0, 20.0), "knee": (-40.0, 0.0), "ankle": (-20.0, 10.0)}  # deg
PERIODS = (0.2, 1.0)
GAIN, THRESHOLD = (0.02, 0.15), 0.1
WAIT = 30.0
SIZES = ((800, 300), (1300, 850))  # pixels of the browser
REST = 0.8  # s between changes there

CHART = "vasti"
_WATCH = """title => {
  const path = "//label[normalize-space()='knee, deg']/following::*[@role='slider'][1]";
  const slider = document.evaluate(path, document, null, XPathResult.FIRST_ORDERED_NODE_TYPE).singleNodeValue;
  const of = () => Object.values(window.__viserTestpoints.uplots)
      .find(u => u.chart.root.querySelector('.u-title')?.textContent === title).chart;
  slider.focus();
  window.__answer = new Promise(resolve => window.addEventListener('keydown', () => {
    const before = of().data, began = performance.now();
    const look = () => {
      const passed = performance.now() - began;
      if (of().data !== before) requestAnimationFrame(() => setTimeout(() => resolve(performance.now() - began), 0));
      else if (passed > 10000) resolve(NaN);
      else setTimeout(look, 0);
    };
    look();
  }, {capture: true, once: true}));
}"""


@dataclass
class Seen:
    """Of a series of changes: s from slider to excitations sent, s of solving alone, and control windows."""

    latency: list[float] = field(default_factory=list)
    solving: list[float] = field(default_factory=list)
    windows: list[int] = field(default_factory=list)

    def add(self, page: LivePage) -> None:
        """Take in the newest result."""
        assert page.result.solution is not None
        self.latency.append(page.sent[-1])
        self.solving.append(page.result.solve_time)
        self.windows.append(page.result.solution.n_window)


def markdown() -> str:
    ran_on = machine((*PACKAGES, "viser"))
    rng = np.random.default_rng(9)
    with quiet(), served() as page:
        rows = [row("movement, no reflex", changes(page, rng, ("hip", "knee", "ankle", "period")))]
        page.slider("threshold").value = THRESHOLD
        page.slider("gain").value = GAIN[0]
        settle(page)
        rows.append(row("movement and reflex gain", changes(page, rng, ("hip", "knee", "ankle", "period", "gain"))))
        for name, value in (("gain", 0.0), ("period", 0.3), ("hip", 10.0), ("knee", -20.0), ("ankle", -10.0)):
            page.slider(name).value = value
        settle(page)
        rows.append(row("a hand that does not stop, 20 events/s", dragged(page)))
        seen = in_browser(page)
    header = ("sliders moved", "solutions", "windows", "solving alone, ms: median", "90 %")
    table = grid((*header, "server: slider event to excitations sent, ms: median", "90 %"), rows)
    names = (
        *("window, pixels", "replay", "key to drawn curves, ms: median", "90 %"),
        *("the page says: slider to drawn curves, ms: median", "90 %", "server alone, ms: median", "90 %"),
    )
    browser = "" if seen is None else f"\n\n{grid(names, seen)}"
    return f"{table}{browser}\n\n*Here*: {ran_on}"


def row(name: str, seen: Seen) -> tuple[object, ...]:
    return (
        name, len(seen.latency), f"{np.median(seen.windows):.0f} ({min(seen.windows)}–{max(seen.windows)})",
        *quantiles(seen.solving), *quantiles(seen.latency),
    )  # fmt: skip


def quantiles(values: list[float]) -> tuple[str, str]:
    median, most = 1e3 * np.quantile(values, (0.5, 0.9))
    return f"{median:.0f}", f"{most:.0f}"


@contextmanager
def served() -> Iterator[LivePage]:
    page = live_page(port=0, open_browser=False, block=False, say=lambda line: None)
    page.player.set_playing(False)
    try:
        settle(page)
        yield page
    finally:
        page.close()


def settle(page: LivePage) -> None:
    """Until there has been nothing to do for a while."""
    shown = -1
    while shown != page.shown or page.busy:
        shown = page.shown
        time.sleep(PAUSE)


def changes(page: LivePage, rng: np.random.Generator, names: tuple[str, ...]) -> Seen:
    """One slider at a time, drawn by chance, to a value drawn by chance."""
    seen = Seen()
    ranges = AMPLITUDES | {"period": PERIODS, "gain": GAIN}
    while len(seen.latency) < CHANGES:
        name = str(rng.choice(names))
        slider, before = page.slider(name), page.shown
        steps = round((ranges[name][1] - ranges[name][0]) / slider.step)
        value = round(ranges[name][0] + int(rng.integers(steps + 1)) * slider.step, 6)
        if value == slider.value:
            continue
        slider.value = value
        end = time.monotonic() + WAIT
        while page.shown == before:
            if time.monotonic() > end:
                raise SystemExit("the page does not answer")
            time.sleep(0.002)
        seen.add(page)
        time.sleep(PAUSE)
    return seen


def dragged(page: LivePage) -> Seen:
    """The knee's slider back and forth, as fast as viser sends what a hand does."""
    seen, shown = Seen(), page.shown
    for event in range(EVENTS):
        page.slider("knee").value = round(-20.0 + 15.0 * np.sin(0.3 * (event + 1)), 3)
        end = time.monotonic() + DRAGGED
        while time.monotonic() < end:
            if page.shown != shown:
                shown = page.shown
                seen.add(page)
            time.sleep(0.002)
    settle(page)
    return seen


def in_browser(page: LivePage) -> list[tuple[object, ...]] | None:
    """A row for each size, replay paused and playing; None without a browser."""
    path = os.environ.get("MJHCMC_CHROMIUM") or shutil.which("chromium")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return None
    if path is None:
        return None
    rows: list[tuple[object, ...]] = []
    with sync_playwright() as play:
        browser = play.chromium.launch(
            executable_path=path, args=["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader"]
        )
        for width, height in SIZES:
            tab: Any = browser.new_context(viewport={"width": width, "height": height}).new_page()
            tab.goto(page.url)
            tab.wait_for_function(
                "() => Object.keys(window.__viserTestpoints?.uplots ?? {}).length >= 8", timeout=60000
            )
            for playing in (False, True):
                page.player.set_playing(playing)
                tab.wait_for_timeout(3000)
                rows.append((f"{width} × {height}", "playing" if playing else "paused", *looked_at(page, tab)))
            page.player.set_playing(False)
            tab.context.close()
        browser.close()
    return rows


def looked_at(page: LivePage, tab: Any) -> tuple[str, ...]:
    """Medians and 90 % of changes by a key on the knee's slider: by the browser's clock, and as the page says."""
    times, answered, inside = [], [], []
    for change in range(LOOKS):
        before = page.shown
        tab.evaluate(_WATCH, CHART)
        tab.keyboard.press("ArrowLeft" if change % 2 else "ArrowRight")
        times.append(tab.evaluate("() => window.__answer") / 1e3)
        tab.wait_for_timeout(1e3 * REST)
        if page.shown == before or not page.seen:
            raise SystemExit("the browser did not answer")
        answered.append(page.seen[-1])
        inside.append(page.sent[-1])
    if not np.isfinite(times).all():
        raise SystemExit("the page in the browser did not answer")
    return (*quantiles(times), *quantiles(answered), *quantiles(inside))


if __name__ == "__main__":
    run_script("live.py", __doc__.splitlines()[0], markdown, document=ROOT / "docs" / "viewing.md")

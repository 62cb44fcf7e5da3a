"""A real browser for tests of pages: Chromium without a screen and without a network; what it complains of is kept."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

import pytest
from needs import missing

_QUIET = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
_NO_GPU = ("--disable-gpu",)
_SOFTWARE_GL = ("--use-gl=angle", "--use-angle=swiftshader")
_INSIDE = ("data:", "blob:", "about:")


def chromium_path() -> str:
    """Where the browser is; without one the test is skipped, or fails where MJHCMC_REQUIRE_BROWSER is set."""
    found = os.environ.get("MJHCMC_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    with suppress(ImportError):
        import playwright.sync_api  # noqa: F401

        if found:
            return found
    why = "this test needs a browser: install playwright (pip) and chromium, or name one in MJHCMC_CHROMIUM"
    return missing(why)


@contextmanager
def chromium(gl: bool = False) -> Iterator[Any]:
    """A playwright Browser; with WebGL by software if asked."""
    path = chromium_path()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=path, args=[*_QUIET, *(_SOFTWARE_GL if gl else _NO_GPU)], headless=True
        )
        try:
            yield browser
        finally:
            browser.close()


@dataclass
class Watched:
    """A page and what it complained of.

    Attributes:
        page: playwright's Page.
        errors: console errors, uncaught exceptions and failed requests.
        outside: addresses it asked for that are not allowed; each was refused.
    """

    page: Any
    errors: list[str] = field(default_factory=list)
    outside: list[str] = field(default_factory=list)


def watched_page(
    browser: Any, allowed: Callable[[str], bool] = lambda url: url.startswith("file://"), **context: Any
) -> Watched:
    """A fresh page that may load what ``allowed`` lets it, by default files only.

    Args:
        browser: what `chromium` gives.
        allowed: of an address; others are refused and noted in `Watched.outside`.
        **context: what playwright's ``new_context`` takes: viewport, color_scheme, is_mobile, has_touch, ...
    """
    opened = browser.new_context(**context)
    page = opened.new_page()
    watched = Watched(page)

    def route(one: Any) -> None:
        url = one.request.url
        if allowed(url) or url.startswith(_INSIDE):
            one.continue_()
        else:
            watched.outside.append(url)
            one.abort()

    opened.route("**/*", route)
    page.on("pageerror", lambda error: watched.errors.append(f"uncaught: {error}"))
    page.on("console", lambda line: watched.errors.append(f"console: {line.text}") if line.type == "error" else None)
    page.on("requestfailed", lambda request: watched.errors.append(f"failed: {request.url}"))
    return watched


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """One Chromium for a test file, without GL."""
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def gl_browser() -> Iterator[Any]:
    """One Chromium for a test file, with WebGL by software."""
    with chromium(gl=True) as found:
        yield found

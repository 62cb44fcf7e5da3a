"""The picture of a report: replay and muscles of the paper's movement. Needs Chromium and `playwright`.

python benchmarks/report_picture.py [--write [FILE]]
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from pathlib import Path

from _markdown import ROOT

import mjhcmc
from mjhcmc.io.files import written_whole

PICTURE = ROOT / "docs" / "report.png"
SIZE = {"width": 1100, "height": 3000}  # pixels: nothing is left to be scrolled to
AT = 0.21  # s, where the replay stands


def picture() -> bytes:
    """A PNG of the page, light."""
    from playwright.sync_api import sync_playwright

    chromium = os.environ.get("MJHCMC_CHROMIUM") or shutil.which("chromium")
    if chromium is None:
        sys.exit("report_picture.py: no chromium on PATH: install it, or name it in MJHCMC_CHROMIUM")
    model = mjhcmc.MuscleModel.load("leg8")
    solution = mjhcmc.hcmc(model, mjhcmc.Motion.cosine(model, "fast"))
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        page_file = mjhcmc.write_report(solution, Path(folder) / "report.html")
        browser = play.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(viewport=SIZE, color_scheme="light")
        page.goto(page_file.as_uri())
        page.wait_for_selector("#excitations .main-svg")
        page.evaluate(f"document.dispatchEvent(new CustomEvent('mjhcmc:time', {{detail: {{time: {AT}, from: 'us'}}}}))")
        page.wait_for_timeout(500)  # ms, for the canvas
        first, last = (page.locator(name).bounding_box() for name in ("#replay", "#angles"))
        assert first is not None
        assert last is not None
        top, bottom = first["y"], last["y"]
        left = first["x"] - 12
        clip = {"x": left, "y": top, "width": SIZE["width"] - left, "height": bottom - top}
        pixels: bytes = page.screenshot(clip=clip)
        browser.close()
    return pixels


def main() -> None:
    parser = argparse.ArgumentParser(prog="report_picture.py", description="The picture of a report.")
    parser.add_argument("--write", type=Path, nargs="?", const=PICTURE, metavar="FILE", help="where (docs/report.png)")
    path = parser.parse_args().write
    pixels = picture()
    print(f"{len(pixels)} bytes")
    if path:
        with written_whole(path) as temporary:
            temporary.write_bytes(pixels)


if __name__ == "__main__":
    main()

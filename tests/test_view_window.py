"""MuJoCo's window on a virtual screen: it plays, its slider moves time, its keys do what they say, it closes."""

import os
import shutil
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from needs import missing

pytestmark = pytest.mark.browser  # like a browser it needs a screen of its own


@pytest.fixture(autouse=True)
def tools():
    if not (shutil.which("Xvfb") and shutil.which("xdotool")):
        missing("Xvfb or xdotool is not installed")


SCREEN = (1280, 900)
# MuJoCo's window has two thirds of the screen, its right panel starts at CONTROL's left; pixels
CONTROL, SLIDER = (700, 55), (715, 785, 114)

PLAY = """
import threading
from view_tools import swinging
from mjhcmc.viewing import window
from mjhcmc.viewing.clock import Clock

seek, press, advance = Clock.seek, Clock.press, Clock.advance
state = {"n": 0}

def told_seek(self, time):
    seek(self, time)
    print(f"seek {self.time:.4f}", flush=True)

def told_press(self, key):
    done = press(self, key)
    print(f"key {key} {self.speed:g} {self.playing}", flush=True)
    return done

def told_advance(self, seconds):
    advance(self, seconds)
    state["n"] += 1
    if self.playing and state["n"] == 1:
        state["first"] = self.time
    if self.playing and state["n"] > 5 and self.time > state["first"]:
        print("plays", flush=True)
        state["first"] = 1.0

Clock.seek, Clock.press, Clock.advance = told_seek, told_press, told_advance
window.view(swinging(), speed=0.02)
print("closed", flush=True)
"""


@pytest.fixture
def screen():
    """A virtual screen; the environment that has it."""
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "{}x{}x24".format(*SCREEN)], pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    os.close(write)
    with os.fdopen(read) as told:
        number = told.readline().strip()
    here = Path(__file__).resolve().parent
    paths = [str(here), str(here.parent), os.environ.get("PYTHONPATH", "")]
    yield {**os.environ, "DISPLAY": f":{number}", "PYTHONPATH": os.pathsep.join(p for p in paths if p)}
    server.terminate()
    server.wait()


def test_the_window(screen, tmp_path):
    log = tmp_path / "log"

    def do(*words):
        subprocess.run(["xdotool", *map(str, words)], env=screen, check=True, timeout=20)

    def wait_for(what, seconds=40.0):
        end = time.monotonic() + seconds
        while what not in log.read_text():
            assert time.monotonic() < end, f"{what!r} is not in {log.read_text()!r}"
            time.sleep(0.1)

    with log.open("w") as out:
        player = subprocess.Popen([sys.executable, "-c", PLAY], env=screen, stdout=out, stderr=out)
    try:
        wait_for("plays", 60.0)
        do("key", "bracketright")
        wait_for("key 93 0.04 True")
        do("key", "space")
        wait_for("key 32 0.04 False")
        do("key", "Right")
        wait_for("key 262")
        before = log.read_text().count("seek")
        do("mousemove", *CONTROL, "click", 1)
        time.sleep(1.0)
        left, right, y = SLIDER
        do("mousemove", left, y, "mousedown", 1)
        for x in (left + 25, left + 50, right):
            time.sleep(0.3)
            do("mousemove", x, y)
        time.sleep(0.3)
        do("mouseup", 1)
        wait_for("seek 0.1")  # of .2 s
        assert log.read_text().count("seek") > before + 1
        do("key", "ctrl+q")
        wait_for("closed")
        assert player.wait(20) == 0
    finally:
        with suppress(ProcessLookupError):
            player.kill()
        player.wait()

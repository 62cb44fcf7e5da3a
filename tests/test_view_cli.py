"""``mjhcmc view``: what it writes, and what it refuses before any work."""

import numpy as np
import pytest
from cli_tools import run
from view_tools import filmed, gl

import mjhcmc

__all__ = ["gl", "run"]


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A short solution of the leg."""
    leg8 = mjhcmc.MuscleModel.load("leg8")
    folder = tmp_path_factory.mktemp("saved")
    q = np.deg2rad(np.linspace([0, 0, 0], [10, -30, -5], 6))
    filmed(leg8, q, q + 0.1, activation=0.3).save(folder / "solution.parquet")
    return folder


@pytest.fixture(autouse=True)
def _no_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


@pytest.mark.usefixtures("gl")
def test_a_video_of_a_folder(run, saved, tmp_path):
    target = tmp_path / "leg.gif"
    told = run(
        "view", saved, "--model", "leg8", "--video", target, "--size", "96x128", "--speed", ".5", "--fps", "20",
        "--no-ghost", "--camera", "front", "--end", ".04",
    )  # fmt: skip
    assert (told.code, told.errors) == (0, [])
    assert told.out.splitlines() == [f"written  {target}"]
    from PIL import Image

    with Image.open(target) as image:
        assert (image.size, image.n_frames) == ((96, 128), 2)


@pytest.mark.usefixtures("gl")
def test_a_picture(run, saved, tmp_path):
    told = run(
        "view", saved / "solution.parquet", "--model", "leg8", "--image", tmp_path / "a.png", "--at", "0.02", "--quiet"
    )
    assert (told.code, told.out, told.err) == (0, "", "")
    assert (tmp_path / "a.png").stat().st_size


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ((), "--browser, or write a video with --video FILE.mp4"),
        (("--video", "a.gif", "--browser"), "give one of them"),
        (("--video", "a.gif", "--image", "a.png"), "give one of them"),
        (("--video", "a.mov"), ".mp4 or .gif"),
        (("--video", "a.gif", "--speed", "0"), "speed"),
        (("--video", "a.gif", "--fps", "0"), "fps"),
        (("--video", "a.gif", "--size", "640"), "960x720"),
        (("--video", "a.gif", "--size", "1x1"), "width"),
        (("--video", "a.gif", "--at", "1"), "--at is of --image"),
        (("--video", "a.gif", "--port", "1"), "--port is of --browser"),
        (("--video", "a.gif", "--start", "7"), "--start 7.0 s"),
        (("--video", "a.gif", "--camera", "side2"), "no camera 'side2'"),
        (("--video", "no/a.gif"), "no folder"),
        (("--browser", "--speed", "2"), "--speed is of the window and --video"),
        (("--fps", "20"), "--fps is of --video"),
    ],
)
def test_one_line_and_nothing_written(run, saved, tmp_path, monkeypatch, options, word):
    monkeypatch.chdir(tmp_path)
    told = run("view", saved, "--model", "leg8", *options)
    assert told.code == 2
    assert len(told.errors) == 1
    assert word in told.err
    assert not list(tmp_path.iterdir())


def test_no_display_is_told_before_anything_is_read(run, tmp_path):
    assert "no display" in run("view", tmp_path / "none").err


def test_no_solution(run, tmp_path):
    told = run("view", tmp_path / "none", "--video", "a.gif")
    assert (told.code, len(told.errors)) == (2, 1)
    assert str(tmp_path / "none") in told.err

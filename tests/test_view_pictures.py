"""Pictures and videos: what is drawn, read back from pixels and files."""

import math
import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from view_tools import BALL, DRUMS, filmed, gl, load, swinging

import mjhcmc
from mjhcmc import OutputError, SettingsError, SimulationError, offscreen
from mjhcmc.offscreen import Canvas, gl_back_end
from mjhcmc.viewing import video
from mjhcmc.viewing.camera import make_camera
from mjhcmc.viewing.colours import activation_rgba
from mjhcmc.viewing.frames import Frames
from mjhcmc.viewing.legend import FOOT, HEAD, Legend
from mjhcmc.viewing.scene import GHOST_RGBA, Stage, quiet
from mjhcmc.viewing.video import write_image, write_video

__all__ = ["gl"]

WIDTH, HEIGHT = 240, 180


class Shot:
    """A frame without legend, and where points of the world are in it."""

    def __init__(self, frames, k=0, *, ghost=True):
        stage = Stage(frames, ghost=ghost)
        stage.show(k)
        scene = mujoco.MjvScene(stage.model, 1000)
        stage.compose(scene, make_camera(frames, aspect=WIDTH / HEIGHT))
        with Canvas(stage.model, WIDTH, HEIGHT) as canvas:
            self.pixels = canvas.draw(scene).astype(int)
        self._eye = scene.camera

    def at(self, point):
        """(3,) the mean colour of the nine pixels around a point of the world."""
        names = ("pos", "forward", "up")
        eye, ahead, up = (np.mean([np.array(getattr(e, n)) for e in self._eye], axis=0) for n in names)
        half = self._eye[0].frustum_top / self._eye[0].frustum_near
        way = np.asarray(point) - eye
        scale = HEIGHT / 2 / (half * (way @ ahead))
        x, y = WIDTH / 2 + scale * (way @ np.cross(ahead, up)), HEIGHT / 2 - scale * (way @ up)
        return self.pixels[int(y) - 1 : int(y) + 2, int(x) - 1 : int(x) + 2].mean(axis=(0, 1))


def red(colour):
    return colour[0] - colour[2]


@pytest.mark.usefixtures("gl")
def test_tendons_have_the_colour_of_activation_not_of_excitation():
    frames = Frames.of(swinging(activation=[0.0, 1.0], excitation=[1.0, 0.0]))
    other = Frames.of(swinging(activation=[1.0, 0.0], excitation=[1.0, 0.0]))
    shot, swapped = Shot(frames), Shot(other)
    flexor, biceps = (path.mean(axis=0) for path in frames.paths(0))
    for point, silent, active in ((flexor, shot, swapped), (biceps, swapped, shot)):
        assert red(silent.at(point)) < 10
        assert red(active.at(point)) > red(silent.at(point)) + 40


def test_nothing_of_mujocos_own_is_drawn_over_it():
    """Neither its tint of actuated tendons, by control or activation in MjData, nor sites, which hide their ends."""
    frames = Frames.of(swinging(activation=1.0))
    stage = Stage(frames)
    option = mujoco.MjvOption()
    option.flags[:] = 1
    quiet(option)
    for own in (stage.option, option):
        stage.option = own
        scene = mujoco.MjvScene(stage.model, 100)
        stage.compose(scene, make_camera(frames))
        drawn = [(g.objtype, g.category) for g in scene.geoms[: scene.ngeom]]
        decor = {objtype for objtype, category in drawn if category == mujoco.mjtCatBit.mjCAT_DECOR}
        assert not decor & {mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_ACTUATOR}
        tendons = [g for g in scene.geoms[: scene.ngeom] if g.objtype == mujoco.mjtObj.mjOBJ_TENDON]
        assert len(tendons) == 2  # each once
        for geom in tendons:
            np.testing.assert_allclose(geom.rgba[:3], activation_rgba(1.0)[:3], atol=1e-6)


def test_the_legend_tells_time_speed_scale_and_ghost():
    plain = np.full((300, 400, 3), 230, np.uint8)

    def written(time=0.5, title="", speed=1.0, ghost=False, hidden=""):
        return Legend(400, 300, title, speed=speed, ghost=ghost, hidden=hidden).write_on(plain, time).astype(int)

    first = written()
    rows, columns = np.nonzero((first != written(time=0.9)).any(axis=2))
    assert rows.min() > 300 * (1 - FOOT)
    assert columns.max() < 100
    for other in (written(speed=0.25), written(ghost=True), written(title="HCMC"), written(hidden="hidden")):
        assert (other != first).any()
    assert (written(title="HCMC")[: int(HEAD * 300)] != 230).any()
    left = (1 - GHOST_RGBA[3]) ** 2  # of what is behind its front and its back
    green = left * 230 + (1 - left) * 255 * np.array(GHOST_RGBA[:3])

    def swatch(picture):
        return (np.abs(picture - green).max(axis=2) < 2).sum()

    assert swatch(written(ghost=True)) > 30  # as it is drawn over what is behind
    assert swatch(first) == swatch(written(hidden="hidden")) == 0
    # the scale: its colours from silent to active, left to right
    ends = [255 * activation_rgba(a)[:3] for a in (0.0, 1.0)]
    silent, active = (np.argwhere(np.abs(first - end).max(axis=2) < 4)[:, 1].mean() for end in ends)
    assert silent < active - 20


def test_the_legend_is_light_on_dark():
    dark = Legend(400, 300, "", speed=None, ghost=False).write_on(np.full((300, 400, 3), 10, np.uint8), 0.5)
    assert dark[:, :100].max() > 200


@pytest.mark.usefixtures("gl")
def test_the_ghost_is_where_the_leg_should_be():
    desired = np.tile([0.0, 1.2], (21, 1))
    solution = swinging(desired=desired)
    frames = Frames.of(solution)
    with_it, without = Shot(frames), Shot(frames, ghost=False)
    stage = Stage(frames)
    shank = frames.place(desired[0]).geom_xpos[-1].copy()
    assert np.abs(with_it.at(shank) - without.at(shank)).max() > 20
    changed = (with_it.pixels != without.pixels).any(axis=2).mean()
    assert 0.001 < changed < 0.2  # a leg, not the whole picture
    # the tendons have no ghost, nor has the part that is where it should be
    scene = mujoco.MjvScene(stage.model, 1000)
    stage.add_to(scene)
    assert [int(g.objid) for g in scene.geoms[: scene.ngeom]] == [1]
    assert all(0 < g.rgba[3] < 1 for g in scene.geoms[: scene.ngeom])
    assert stage.shows_ghost(range(21))
    exact = Frames.of(swinging())
    assert not Stage(exact).shows_ghost(range(21))
    assert not Stage(frames, ghost=False).shows_ghost(range(21))
    np.testing.assert_array_equal(Shot(exact).pixels, Shot(exact, ghost=False).pixels)


@pytest.mark.usefixtures("gl")
def test_muscles_on_a_joint_are_beads_around_it():
    frames = Frames.of(filmed(load(DRUMS), np.array([[0.0], [0.5]]), activation=[0.0, 1.0]))
    scene = mujoco.MjvScene(frames.model, 100)
    Stage(frames).add_to(scene)
    forth, back = scene.geoms[: scene.ngeom]
    assert red(forth.rgba) < 0 < red(back.rgba)
    ways = np.array([forth.pos, back.pos])  # the joint is at the origin
    np.testing.assert_allclose(ways[0], -ways[1], atol=1e-6)
    assert ways[0, 0] == pytest.approx(0, abs=1e-6)  # around the axis, along which one looks
    assert np.linalg.norm(ways[0]) >= 0.03 + forth.size[0] - 1e-6  # outside the limb
    shot = Shot(frames)
    assert red(shot.at(back.pos)) > red(shot.at(forth.pos)) + 40


def test_the_world_and_its_floor_have_no_ghost():
    xml = BALL.replace("<worldbody>", '<worldbody><geom type="plane" size="1 1 1"/><geom size=".05" pos="0 0 .2"/>')
    turned = np.tile([np.cos(0.5), np.sin(0.5), 0, 0], (2, 1))
    frames = Frames.of(filmed(load(xml), np.tile([1.0, 0, 0, 0], (2, 1)), turned))
    scene = mujoco.MjvScene(frames.model, 100)
    Stage(frames).add_to(scene)
    assert [int(g.objid) for g in scene.geoms[: scene.ngeom]] == [2]


def test_strong_muscles_are_thick():
    frames = Frames.of(swinging())  # 400 and 200 N
    widths = Stage(frames).model.tendon_width
    assert widths[0] / widths[1] == pytest.approx(math.sqrt(2), rel=1e-6)
    assert (frames.model.tendon_width == load().mj_model.tendon_width).all()


@pytest.mark.usefixtures("gl")
def test_gif(tmp_path):
    told = []
    path = write_video(
        swinging(), tmp_path / "swing.gif", width=121, height=90, fps=15, speed=0.2,
        progress=lambda done, count: told.append((done, count)),
    )  # fmt: skip
    from PIL import Image, ImageSequence

    with Image.open(path) as image:
        assert image.size == (121, 90)
        pages = [(page.convert("RGB").tobytes(), page.info["duration"]) for page in ImageSequence.Iterator(image)]
    assert len(pages) == 16  # .2 s of the motion, five times slower, both ends
    assert sum(duration for _, duration in pages) == pytest.approx(16 / 15 * 1000, abs=10)
    assert len({content for content, _ in pages}) > 10  # it moves
    assert told == [(k + 1, 16) for k in range(16)]
    assert [p.name for p in tmp_path.iterdir()] == ["swing.gif"]


@pytest.mark.usefixtures("gl")
def test_mp4(tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    imageio = pytest.importorskip("imageio.v3")
    path = write_video(swinging(), tmp_path / "swing.mp4", width=121, height=91, fps=20, start=0.1, camera="front")
    facts = imageio.immeta(path)
    assert facts["size"] == (122, 92)
    assert facts["fps"] == 20
    assert facts["codec"] == "h264"
    assert len(list(imageio.imiter(path))) == 3  # .1 s, both ends
    assert [p.name for p in tmp_path.iterdir()] == ["swing.mp4"]


@pytest.mark.usefixtures("gl")
def test_still(tmp_path):
    from PIL import Image

    first, later = (write_image(swinging(), tmp_path / f"{at}.png", at=at, height=100) for at in (0.0, 0.05))
    with Image.open(first) as a, Image.open(later) as b:
        assert a.size == b.size
        assert a.size[1] == 100
        assert a.tobytes() != b.tobytes()
        foot = np.asarray(a).astype(int)[80:, -30:]
    assert np.abs(foot - 255 * activation_rgba(1.0)[:3]).max(axis=2).min() < 10  # with its legend


@pytest.mark.usefixtures("gl")
def test_nothing_half_written_stays(tmp_path):
    def stop(done, count):
        raise KeyboardInterrupt

    (tmp_path / "swing.gif").write_text("before")
    with pytest.raises(KeyboardInterrupt):
        write_video(swinging(), tmp_path / "swing.gif", width=80, height=64, progress=stop)
    assert [p.read_text() for p in tmp_path.iterdir()] == ["before"]


@pytest.mark.parametrize(
    ("name", "asked", "error", "word"),
    [
        ("a.avi", {}, OutputError, ".mp4 or .gif"),
        ("no/a.gif", {}, OutputError, "no folder"),
        ("a.gif", {"fps": 0}, SettingsError, "fps"),
        ("a.gif", {"fps": 60}, SettingsError, "50"),
        ("a.gif", {"speed": 0}, SettingsError, "speed"),
        ("a.gif", {"speed": math.inf}, SettingsError, "speed"),
        ("a.gif", {"width": 10}, SettingsError, "width"),
        ("a.gif", {"height": 9000}, SettingsError, "height"),
        ("a.gif", {"height": 90.5}, SettingsError, "height"),
        ("a.gif", {"camera": "back"}, SettingsError, "side, front, top"),
        ("a.gif", {"start": 3}, SettingsError, "start"),
        ("a.gif", {"speed": 1e-9}, SettingsError, "frames"),
    ],
)
def test_bad_videos_are_found_before_the_work(tmp_path, monkeypatch, name, asked, error, word):
    monkeypatch.setattr(video, "_pictures", None)
    with pytest.raises(error, match=word):
        write_video(swinging(), tmp_path / name, **asked)
    assert not list(tmp_path.iterdir())


def test_bad_stills(tmp_path):
    for name, asked, error in (
        ("a.mp4", {}, OutputError), ("a.png", {"at": 0.3}, SettingsError), ("a.png", {"at": math.nan}, SettingsError),
    ):  # fmt: skip
        with pytest.raises(error):
            write_image(swinging(), tmp_path / name, **asked)


def test_a_missing_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "find_spec", lambda name: None)
    with pytest.raises(OutputError, match=r"mjhcmc\[view\].*\.gif"):
        write_video(swinging(), tmp_path / "a.mp4")


def test_where_nothing_can_draw(monkeypatch):
    def fail(*_, **__):
        return subprocess.CompletedProcess([], 1)

    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(offscreen.subprocess, "run", fail)
    with pytest.raises(OutputError, match="libegl1, or libosmesa6"):
        gl_back_end.__wrapped__()
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(OutputError, match="switches drawing off"):
        gl_back_end.__wrapped__()
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert gl_back_end.__wrapped__() == "osmesa"


@pytest.mark.usefixtures("gl")
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="EGL and OSMesa are Linux's")
def test_the_back_end_is_chosen_without_a_display_and_kept_to_itself():
    """In a process of its own: MuJoCo is imported before anything is chosen."""
    code = (
        "import mujoco, os; from mjhcmc.offscreen import Canvas, gl_back_end; "
        "m = mujoco.MjModel.from_xml_string('<mujoco/>'); s = mujoco.MjvScene(m, 10)\n"
        "with Canvas(m, 64, 64) as c: print(c.draw(s).shape, gl_back_end(), 'MUJOCO_GL' in os.environ)"
    )
    environment = {k: v for k, v in os.environ.items() if k not in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert done.stdout.strip() in ("(64, 64, 3) egl False", "(64, 64, 3) osmesa False"), done.stderr


def test_the_window_needs_a_display(monkeypatch):
    from mjhcmc.viewing import window

    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(OutputError, match=r"--browser.*--video FILE\.mp4"):
        window.view(swinging())
    with pytest.raises(SettingsError, match="speed"):
        window.view(swinging(), speed=0)


def test_public_names():
    assert mjhcmc.write_video is write_video


def test_without_its_model(tmp_path):
    from dataclasses import replace

    with pytest.raises(SimulationError, match="model="):
        write_video(replace(swinging(), model=None), tmp_path / "a.gif")

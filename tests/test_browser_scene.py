"""What is sent to the browser, where the answers are known: triangles, bodies, tendons, the ghost, curves."""

import time
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

import mjhcmc
from mjhcmc.viewing.charts import angles_of, held_times, top_of, tracked_joints
from mjhcmc.viewing.frames import Frames
from mjhcmc.viewing.meshes import ground_of, parts_of
from mjhcmc.viewing.player import Player, bars, fair_speed, shown_muscles
from mjhcmc.viewing.poses import Poses

ROUND = 0.05  # a polygon of 24 sides is that much smaller than what is round

SHAPES = """
<mujoco><worldbody>
  <geom name="ground" type="plane" size="1 1 1" pos="0 0 -.3" euler="0 0 90"/>
  <body name="b" pos="1 2 3"><geom type="{}" size="{}" pos=".1 .2 .3" euler="30 40 50"/></body>
</worldbody></mujoco>
"""


def volume(part):
    a, b, c = (part.vertices[part.faces[:, i]] for i in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


@pytest.mark.parametrize(
    ("kind", "size", "exact", "slack"),
    [
        ("sphere", ".1", 4 / 3 * np.pi * 1e-3, ROUND),
        ("ellipsoid", ".1 .2 .3", 4 / 3 * np.pi * 6e-3, ROUND),
        ("capsule", ".1 .3", 4 / 3 * np.pi * 1e-3 + 6e-3 * np.pi, ROUND),
        ("cylinder", ".1 .3", 6e-3 * np.pi, ROUND),
        ("box", ".1 .2 .3", 8 * 6e-3, 1e-9),
    ],
)
def test_triangles_enclose_the_geom_from_outside(kind, size, exact, slack):
    [part] = parts_of(mujoco.MjModel.from_xml_string(SHAPES.format(kind, size)))  # the plane is not among them
    assert part.body == 1
    assert exact * (1 - slack) <= volume(part) <= exact * (1 + 1e-9)
    middle = np.array([0.1, 0.2, 0.3])
    outward = np.einsum("ij,ij->i", part.normals, part.vertices - middle)
    used = np.unique(part.faces)
    assert (outward[used] > 0).all()


def test_colours_and_groups_decide_what_is_seen():
    xml = """<mujoco><asset><material name="blue" rgba="0 0 1 1"/></asset><worldbody><body>
      <geom size=".1" rgba="1 0 0 1"/><geom size=".1" pos="1 0 0" rgba="1 0 0 1"/><geom size=".1" material="blue"/>
      <geom size=".1" rgba="0 1 0 0"/><geom size=".1" rgba="0 1 0 1" group="4"/></body></worldbody></mujoco>"""
    red, blue = parts_of(mujoco.MjModel.from_xml_string(xml))
    assert red.rgba == (1, 0, 0, 1)
    assert blue.rgba == (0, 0, 1, 1)
    assert len(red.vertices) == 2 * len(blue.vertices)


def test_the_ground_is_the_models_own_plane():
    position, quat = ground_of(mujoco.MjModel.from_xml_string(SHAPES.format("sphere", ".1")))
    assert position == pytest.approx([0, 0, -0.3])
    assert quat == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    assert ground_of(mjhcmc.MuscleModel.load("leg8").mj_model) is None


@pytest.fixture(scope="module")
def solution():
    model = mjhcmc.MuscleModel.load("leg8")
    return mjhcmc.hcmc(model, mjhcmc.Motion.cosine(model, amplitudes={"knee": -0.6}, period=0.2, cycles=0.5))


@pytest.fixture(scope="module")
def frames(solution):
    return Frames.of(solution)


def test_bodies_and_tendons_are_where_mujoco_has_them(frames):
    poses, k, m = Poses.of(frames), 7, frames.model
    data = mujoco.MjData(m)
    data.qpos[:] = frames.qpos[k]
    mujoco.mj_forward(m, data)
    assert poses.body_position[k] == pytest.approx(data.xpos, abs=1e-12)
    assert poses.body_quat[k] == pytest.approx(data.xquat, abs=1e-12)
    length = np.bincount(poses.tendon[k][poses.tendon[k] >= 0], poses.length[k][poses.tendon[k] >= 0])
    spans = zip(data.ten_wrapadr, data.ten_wrapnum, strict=True)
    wraps = np.array([(data.wrap_obj.ravel()[first : first + n] >= 0).any() for first, n in spans])
    assert length[~wraps] == pytest.approx(data.ten_length[~wraps], abs=1e-12)
    assert (length[wraps] < data.ten_length[wraps]).all()  # a chord of each arc
    assert length == pytest.approx(data.ten_length, rel=1e-3)
    first = int(np.argmax(poses.tendon[k] == 0))  # its ends, from its middle, length and turn
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, poses.quat[k, first])
    half = poses.length[k, first] / 2 * turn.reshape(3, 3)[:, 2]
    ends = poses.middle[k, first] + np.array([half, -half])
    path = frames.paths(k)[0]
    assert min(abs(ends - path[:2]).max(), abs(ends[::-1] - path[:2]).max()) < 1e-12
    assert (poses.colour[k, first] == np.rint(255 * frames.tendon_rgba(k)[0, :3])).all()


def test_the_ghost_is_as_many_times_away_as_asked(frames):
    away = SimpleNamespace(
        **{name: getattr(frames, name) for name in ("model", "place", "paths", "tendon_rgba")},
        qpos=frames.qpos, desired=frames.qpos + np.array([0.0, 0.01, 0.0]), __len__=frames.__len__,
    )  # fmt: skip
    from mjhcmc.viewing.poses import ghost_bodies

    _, quat = ghost_bodies(away, 5.0)
    own = Poses.of(frames).body_quat
    shank = frames.model.body("shank").id
    turned = 2 * np.arccos(np.clip(np.abs(np.einsum("ki,ki->k", quat[:, shank], own[:, shank])), 0, 1))
    assert turned == pytest.approx(np.full(len(frames), 0.05), abs=1e-6)


def test_what_is_constant_over_windows_is_drawn_so():
    assert held_times(np.array([0.0, 1.0, 2.0])).tolist() == [0, 1, 1, 2]


def test_curves_are_of_tracked_joints(solution):
    assert tracked_joints(solution) == [0, 1, 2]
    desired, actual = angles_of(solution, 1)
    assert np.array_equal(desired, solution.qpos_desired[:, 1])
    assert np.array_equal(actual, solution.qpos[:, 1])


def test_charts_reach_a_little_higher_than_the_muscles():
    def tops(excitation, activation):
        return top_of(SimpleNamespace(excitation=np.array([[excitation]]), activation=np.array([[activation]])))

    assert [tops(0.19, 0.1), tops(0.1, 0.2), tops(0.49, 0.0), tops(0.5, 0.5), tops(1.0, 1.0)] == [0.2, 0.5, 0.5, 1, 1]


def test_a_page_that_cannot_be_built_leaves_no_server(solution, monkeypatch):
    pytest.importorskip("viser")
    from mjhcmc.viewing import browser, server

    ended = []
    monkeypatch.setattr(browser, "stop_server", lambda one: (ended.append(one), server.stop_server(one)))
    monkeypatch.setattr("mjhcmc.viewing.charts.Charts.show", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        mjhcmc.view_in_browser(solution, port=0, open_browser=False, block=False)
    assert len(ended) == 1


class Browser:
    """One that takes so long over a picture."""

    def __init__(self, seconds):
        self.asked = 0
        self.seconds = seconds
        self.local_storage = self

    def get_item(self, key, timeout):
        self.asked += 1
        time.sleep(self.seconds)


@pytest.mark.parametrize(("takes", "slow"), [(0.0, False), (0.1, True)])
def test_a_slow_browser_is_sent_no_more_than_it_draws(takes, slow):
    browser = Browser(takes)
    looks = SimpleNamespace(get_clients=lambda: {0: browser}, flush=lambda: None)
    player = Player.__new__(Player)
    player._server, player._held_until, player._taken = looks, 0.0, 0.0
    player._wait_for_browsers()
    assert browser.asked == 1
    now = player._last
    assert player._rests(now + takes / 2) is slow  # as long again is left to the rest
    assert not player._rests(now + 2 * takes)
    player.hold(60.0)
    assert player._rests(now + 2 * takes) is slow  # something more important is on its way
    player.hold(0.0)
    assert not player._rests(time.perf_counter() + 2 * takes)


def test_bars_tell_names_and_numbers_and_nothing_a_name_could_smuggle_in():
    text = bars(("<b>", "soleus"), np.array([0.25, 1.0]), np.array([0.5, 0.0]), np.arange(2))
    assert "<b>" not in text
    assert "&lt;b&gt;" in text
    assert "width:25.0%" in text
    assert "left:50.0%" in text
    assert ">0.25<" in text


def test_of_many_muscles_the_most_active_have_bars():
    many = SimpleNamespace(muscle_names=[str(i) for i in range(40)], activation=np.tile(np.arange(40) / 40, (3, 1)))
    assert shown_muscles(many).tolist() == list(range(16, 40))


def test_short_movements_are_slowed_down_at_first():
    assert fair_speed(0.6) == pytest.approx(0.15)
    assert fair_speed(0.1) == pytest.approx(0.1)
    assert fair_speed(30.0) == 1.0


def test_a_page_without_a_model_is_refused_before_there_is_one(solution):
    from dataclasses import replace

    with pytest.raises(mjhcmc.SimulationError, match="does not know its model"):
        mjhcmc.view_in_browser(replace(solution, model=None), port=0, open_browser=False, block=False)

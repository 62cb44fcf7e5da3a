"""The replay's data against MuJoCo's own positions, its size and safety, and the player in a real browser."""

import base64
import json

import mujoco
import numpy as np
import pytest
from browser_tools import browser, watched_page
from hypothesis import given
from hypothesis import strategies as st
from myo_models import myo_model
from osim_documents import write_osim

from mjhcmc.errors import OutputError
from mjhcmc.leg8 import leg8_from_osim
from mjhcmc.report import replay
from mjhcmc.report.replay import ReplayPart, replay_part
from mjhcmc.report.replay_motion import rotation_matrices, rotation_vectors
from mjhcmc.report.replay_shapes import thinned
from mjhcmc.report.units import short
from mjhcmc.viewing.colours import hex_colour
from mjhcmc.viewing.frames import Frames

__all__ = ["browser"]

SORTS = """
<mujoco model="sorts">
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 .1" pos="0 0 -.5"/>
    <geom name="wall" type="box" size="5 .1 5" pos="0 9 0"/>
    <body name="trunk" pos="0 0 .4"><freejoint/>
      <geom name="chest" type="ellipsoid" size=".1 .05 .2" mass="1"/>
      <geom name="hidden" type="sphere" size=".3" group="3"/>
      <site name="origin" pos=".05 0 .1"/>
      <body name="rigid" pos=".02 0 .1" euler="10 20 30">
        <geom name="pack" type="box" size=".02 .04 .06" pos=".01 .02 .03" euler="40 0 10" mass=".1"/>
        <site name="hook" pos=".03 .01 0"/>
      </body>
      <body name="arm" pos="0 0 -.2" euler="0 15 0"><joint name="shoulder" type="ball"/>
        <geom name="upper" type="capsule" fromto="0 0 0 .02 0 -.3" size=".03" mass="1"/>
        <geom name="roll" type="cylinder" size=".03 .02" pos=".01 0 -.3" euler="90 0 0" mass=".1"/>
        <body name="hand" pos=".02 0 -.3"><joint name="wrist" axis="0 1 0"/>
          <geom type="sphere" size=".03" pos="0 0 -.1" mass=".2"/>
          <site name="end" pos=".02 0 -.08"/><site name="middle" pos="-.02 0 -.04"/><site name="beside" pos=".08 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="over"><site site="origin"/><geom geom="roll" sidesite="beside"/><site site="end"/></spatial>
    <spatial name="split"><site site="hook"/><site site="middle"/><pulley divisor="2"/><site site="hook"/><site
      site="end"/></spatial>
    <spatial name="band" rgba=".1 .2 .3 1"><site site="hook"/><site site="end"/></spatial>
    <fixed name="tied"><joint joint="wrist" coef="1"/></fixed>
  </tendon>
  <actuator>
    <muscle name="m&lt;/script&gt;&lt;b&gt;" tendon="over" force="100" lengthrange=".2 1"/>
    <muscle name="second" tendon="over" force="100" lengthrange=".2 1"/>
    <muscle name="on_split" tendon="split" force="100" lengthrange=".2 1"/>
    <muscle name="on_wrist" joint="wrist" force="1" lengthrange="-1 1"/>
    <muscle name="on_tied" tendon="tied" force="1" lengthrange="-1 1"/>
  </actuator>
</mujoco>
"""
N_FRAME = 30


def frames_of(model, qpos, desired=None, activation=None, time=None):
    """Frames without a solve: every actuator is a muscle."""
    n, ids = len(qpos), np.arange(model.nu)
    on_tendon = model.actuator_trntype[ids] == mujoco.mjtTrn.mjTRN_TENDON
    some = np.linspace(0, 1, n * model.nu).reshape(n, model.nu) if activation is None else activation
    return Frames(
        model=model,
        title="a </script> title",
        time=np.arange(n) * 0.02 if time is None else time,
        qpos=np.array(qpos),
        desired=np.array(qpos if desired is None else desired),
        activation=some,
        excitation=some[::-1].copy(),
        muscle_names=tuple(model.actuator(i).name for i in ids),
        muscle_ids=ids,
        tendon_of_muscle=np.where(on_tendon, model.actuator_trnid[ids, 0], -1),
    )


@pytest.fixture(scope="module")
def sorts():
    """Each sort of geom and joint, welded bodies, wrapping on and off, a pulley; desired 1e-6 rad off."""
    model = mujoco.MjModel.from_xml_string(SORTS)
    rng = np.random.default_rng(5)
    velocity = rng.normal(size=model.nv) * 1.5
    qpos, q = [], model.qpos0.copy()
    for _ in range(N_FRAME):
        qpos.append(q.copy())
        mujoco.mj_integratePos(model, q, velocity, 0.05)
    desired = np.array(qpos)
    for row in desired:
        mujoco.mj_integratePos(model, row, rng.normal(size=model.nv), 1e-6)
    return frames_of(model, qpos, desired)


@pytest.fixture(scope="module")
def swing(leg8):
    """The leg swings in its sagittal plane."""
    phase = np.linspace(0, 2 * np.pi, 61)[:, None]
    return frames_of(leg8.mj_model, np.sin(phase) * [0.4, -0.3, 0.2], np.sin(phase) * [0.4, -0.3, 0.2] + 2e-5)


class Read:
    """The data as a player reads them, after a way through JSON."""

    def __init__(self, part: ReplayPart):
        self.data = data = json.loads(json.dumps(part.data, allow_nan=False))
        n, moving, groups = len(data["time"]), data["moving"], len(data["groups"])
        self.at = np.tile([g["at"] for g in data["groups"]], (n, 1, 1)).astype(float)
        self.turn = rotation_matrices(np.tile([g["turn"] for g in data["groups"]], (n, 1, 1)).astype(float))
        self.wanted_at, self.wanted_turn = self.at.copy(), self.turn.copy()
        assert groups == self.at.shape[1]
        self.at[:, moving] = self.numbers("position").reshape(n, -1, 3) + data["centre"]
        self.turn[:, moving] = rotation_matrices(self.numbers("turn").reshape(n, -1, 4))
        self.shift = self.numbers("shift").reshape(n, -1, 3)
        self.shift_turn = self.numbers("shift_turn").reshape(n, -1, 3)
        self.wrapped = np.frombuffer(base64.b64decode(data["wrapped"]), np.uint8).reshape(n, -1)
        self.wrap_points = self.numbers("wrap_points").reshape(-1, 2, 3) + data["centre"]

    def numbers(self, name):
        return self.unpacked(self.data[name])

    @staticmethod
    def unpacked(packed):
        return np.frombuffer(base64.b64decode(packed["of"]), "<i2") * packed["scale"]

    def world(self, k, body, points):
        return np.asarray(points) @ self.turn[k, body].T + self.at[k, body]

    def path(self, k, stops):
        """World points of a path in frame k; NaN at pulleys, as in Frames.paths."""
        found, before = [], int(self.wrapped[:k].sum())
        for stop in stops:
            if isinstance(stop, list):
                found.append(self.world(k, stop[0], [stop[1:]])[0])
            elif stop < 0:
                found.append(np.full(3, np.nan))
            elif self.wrapped[k, stop]:
                found += list(self.wrap_points[before + int(self.wrapped[k, :stop].sum())])
        return np.array(found)


def own_points(model, data, name):
    """What bounds a geom, from MuJoCo's own position and orientation of it."""
    g = model.geom(name).id
    size, turn, at = model.geom_size[g], data.geom_xmat[g].reshape(3, 3), data.geom_xpos[g]
    kind = mujoco.mjtGeom(model.geom_type[g])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return np.array([at - size[1] * turn[:, 2], at + size[1] * turn[:, 2]])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return np.array([at + turn @ (size * s) for s in np.ndindex(2, 2, 2) for s in [2 * np.array(s) - 1]])
    return np.concatenate([[at], at + (turn * size).T])


def test_bodies_are_where_mujoco_has_them(sorts):
    read, model, data = Read(replay_part(sorts)), sorts.model, mujoco.MjData(sorts.model)
    assert len(read.data["time"]) == N_FRAME
    shapes = dict(
        zip(("chest", "pack", "upper", "roll", ""), read.data["shapes"], strict=True)
    )  # no wall, nothing hidden
    assert read.data["moving"] == [1, 2, 3]  # the rigid body went into the trunk
    for k in range(N_FRAME):
        data.qpos[:] = sorts.qpos[k]
        mujoco.mj_forward(model, data)
        for name in ("chest", "upper", "pack"):
            told, own = shapes[name], own_points(model, data, name)
            if told["kind"] == "mesh":
                local = Read.unpacked(told["vertices"]).reshape(-1, 3) + told["middle"]
            else:
                local = np.array(told["points"])
                local[1:] += local[0] if told["kind"] == "ellipsoid" else 0.0
            np.testing.assert_allclose(read.world(k, told["body"], local), own, atol=1e-4)
    assert shapes["upper"]["radius"] == pytest.approx(0.03)
    roll = Read.unpacked(shapes["roll"]["vertices"]).reshape(-1, 3) + shapes["roll"]["middle"]
    centred = (roll - model.geom("roll").pos) @ rotation_matrices(model.geom("roll").quat)
    assert np.abs(centred[:, 2]).max() == pytest.approx(0.02, abs=1e-4)
    assert np.hypot(*centred[:, :2].T).max() == pytest.approx(0.03, abs=1e-4)


def test_paths_are_where_mujoco_has_them(sorts):
    read, model, data = Read(replay_part(sorts)), sorts.model, mujoco.MjData(sorts.model)
    tendons = read.data["tendons"]
    assert [t["muscles"] for t in tendons] == [[0, 1], [2], []]
    assert tendons[2]["rgb"] == "#1a334d"  # without muscles: its own colour
    assert 0 < read.wrapped.sum() < read.wrapped.size  # it wraps, but not always
    for k in range(N_FRAME):
        data.qpos[:] = sorts.qpos[k]
        mujoco.mj_forward(model, data)
        points, what = data.wrap_xpos.reshape(-1, 3), data.wrap_obj.reshape(-1)
        for t, told in enumerate(tendons):
            row = slice(data.ten_wrapadr[t], data.ten_wrapadr[t] + data.ten_wrapnum[t])
            own = np.where((what[row] == -2)[:, None], np.nan, points[row])
            np.testing.assert_allclose(read.path(k, told["stops"]), own, atol=1e-4)
            np.testing.assert_allclose(own, sorts.paths(k)[t], atol=1e-12)


def test_tiny_errors_keep_their_digits(sorts):
    """1e-6 rad and m, far below the rounding of positions: they are to be drawn a thousand times as large."""
    read, model, data = Read(replay_part(sorts)), sorts.model, mujoco.MjData(sorts.model)
    bodies = [model.body(name).id for name in ("trunk", "arm", "hand")]
    for k in (0, N_FRAME // 2, N_FRAME - 1):
        found = []
        for qpos in (sorts.qpos[k], sorts.desired[k]):
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            found.append((data.xpos[bodies].copy(), data.xmat[bodies].reshape(-1, 3, 3).copy()))
        (at, turn), (wanted_at, wanted_turn) = found
        np.testing.assert_allclose(read.shift[k], wanted_at - at, atol=1e-9)
        skew = np.einsum("bji,bjk->bik", turn, wanted_turn) - np.eye(3)
        vector = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
        np.testing.assert_allclose(read.shift_turn[k], vector, atol=1e-9)


@given(st.lists(st.floats(-1, 1), min_size=8, max_size=8))
def test_rotation_vectors_are_mujocos(numbers):
    real = np.array([1.5, 0, 0, 0])
    first, second = np.array(numbers[:4]) + real, np.array(numbers[4:]) - real
    first, second = first / np.linalg.norm(first), second / np.linalg.norm(second)
    own, matrix = np.empty(3), np.empty(9)
    mujoco.mju_subQuat(own, second, first)
    mujoco.mju_quat2Mat(matrix, first)
    np.testing.assert_allclose(rotation_vectors(first, second), own, atol=1e-7)
    np.testing.assert_allclose(rotation_matrices(first).ravel(), matrix, atol=1e-12)


def test_activation_and_its_colour_are_those_of_frames(sorts):
    read = Read(replay_part(sorts))
    m, colours = len(sorts.muscle_names), read.data["colours"]
    for name in ("activation", "excitation"):
        sent = np.frombuffer(base64.b64decode(read.data[name]), "<u2").reshape(-1, m) / 65534
        np.testing.assert_allclose(sent, getattr(sorts, name), atol=1e-5)
    for k in (0, 11, N_FRAME - 1):
        for t, told in enumerate(read.data["tendons"][:2]):
            drawn = colours[round(float(sorts.activation[k, told["muscles"]].max()) * 255)]
            own = hex_colour(sorts.tendon_rgba(k)[t])
            channels = [abs(int(drawn[i : i + 2], 16) - int(own[i : i + 2], 16)) for i in (1, 3, 5)]
            assert max(channels) <= 3
    assert {tuple(ring["muscles"]) for ring in read.data["rings"]} == {(3, 4)}  # both at the wrist
    data = sorts.place(sorts.qpos[7])
    ring = read.data["rings"][0]
    np.testing.assert_allclose(read.world(7, ring["body"], ring["at"]), data.xanchor[2], atol=1e-4)


def test_nothing_can_end_the_script(sorts):
    unknown = np.full_like(sorts.activation, np.nan)
    part = replay_part(frames_of(sorts.model, sorts.qpos, activation=unknown))
    assert part.data["muscles"][0] == "m</script><b>"
    assert part.markup.count("</script") == 2  # the data's and the player's own
    assert "NaN" not in json.dumps(part.data)
    assert "Infinity" not in json.dumps(part.data)
    assert "http" not in part.markup.replace("http://www.w3.org", "")
    sent = np.frombuffer(base64.b64decode(part.data["activation"]), "<u2")
    assert (sent == replay.UNKNOWN).all()


def test_frames_without_positions_are_left_out(sorts):
    qpos = np.array(sorts.qpos)
    qpos[3:] = np.nan
    assert len(replay_part(frames_of(sorts.model, qpos)).data["time"]) == 3
    with pytest.raises(OutputError, match="no frame has finite positions"):
        replay_part(frames_of(sorts.model, qpos[3:]))


def test_long_motions_are_thinned(swing, monkeypatch):
    qpos = np.tile(swing.qpos, (40, 1))
    time = np.arange(len(qpos)) * 0.005
    sent = replay_part(frames_of(swing.model, qpos, time=time)).data["time"]
    assert len(sent) == replay.MAX_FRAMES
    assert sent[0] == 0
    assert sent[-1] == pytest.approx(time[-1])
    assert np.ptp(np.diff(sent)) <= 0.0051  # even, to a frame
    fine = time[:401] / 5  # 1000 a second for 0.4 s
    assert len(replay_part(frames_of(swing.model, qpos[:401], time=fine)).data["time"]) == 0.4 * replay.MAX_RATE + 1
    whole = replay_part(frames_of(swing.model, qpos[:101], time=time[:101])).data
    assert (len(whole["time"]), whole["thinned"]) == (101, False)
    monkeypatch.setattr(replay, "MAX_BYTES", 4000)
    assert 2 <= len(replay_part(frames_of(swing.model, qpos, time=time)).data["time"]) < 30


def test_eighty_muscles_and_forty_meshes_stay_below_a_megabyte():
    model = myo_model("myolegs")
    phase = np.linspace(0, 20, 400)[:, None]
    qpos = model.qpos0 + np.where(np.arange(model.nq) < 7, 0, 0.2) * np.sin(phase)
    part = replay_part(frames_of(model, qpos, qpos + np.where(np.arange(model.nq) < 7, 0, 1e-4)))
    assert len(part.data["time"]) > 100
    assert len(part.markup) < 1_000_000
    bones = [s for s in part.data["shapes"] if s["kind"] == "mesh"]
    assert len(bones) > 30  # and not the scenery that stands around
    read = Read(part)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos[0]
    mujoco.mj_forward(model, data)
    every = np.concatenate(
        [read.world(0, s["body"], Read.unpacked(s["vertices"]).reshape(-1, 3) + s["middle"]) for s in bones]
    )
    femur = model.geom("femur_r")
    first, count = model.mesh_vertadr[femur.dataid[0]], model.mesh_vertnum[femur.dataid[0]]
    own = model.mesh_vert[first : first + count][::40] @ data.geom_xmat[femur.id].reshape(3, 3).T
    near = np.linalg.norm(every[:, None] - (own + data.geom_xpos[femur.id]), axis=-1).min(axis=0)
    assert near.max() < 0.005  # coarse at most, but that bone


def test_a_thinned_ball_is_still_a_ball():
    n = 60
    angle, height = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.linspace(0, np.pi, n), indexing="ij")
    ball = np.stack([np.sin(height) * np.cos(angle), np.sin(height) * np.sin(angle), np.cos(height)], axis=-1)
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(n - 1), indexing="ij"))
    a, b, c, d = i * n + j, i * n + j + 1, (i + 1) % n * n + j + 1, (i + 1) % n * n + j
    points, faces = thinned(ball.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]), 300)
    assert 100 < len(points) <= 300
    assert faces.max() == len(points) - 1
    corner = points[faces]
    volume = np.einsum("fi,fi->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6
    assert volume == pytest.approx(4 / 3 * np.pi, rel=0.1)  # positive: counterclockwise from outside


def test_a_gap_in_a_path_is_closed_and_a_pulley_divides(sorts, tmp_path):
    write_osim(tmp_path / "own.osim")
    model = leg8_from_osim(tmp_path / "own.osim", base="fixed").compile()
    frames = frames_of(model, np.linspace(0, -1.2, 5)[:, None] * [0, 1, 0])
    part = replay_part(frames)
    read, paths = Read(part), frames.paths(3)
    vasti = next(t for t in part.data["tendons"] if [frames.muscle_names[i] for i in t["muscles"]] == ["vasti"])
    assert all(isinstance(stop, list) or stop >= 0 for stop in vasti["stops"])  # one strand
    path = next(path for t, path in enumerate(paths) if model.tendon(t).name == "vasti_tendon")
    np.testing.assert_allclose(read.path(3, vasti["stops"]), path, atol=1e-4)
    split = replay_part(sorts).data["tendons"][1]
    assert -1 in split["stops"]


def test_the_first_view_holds_thick_limbs():
    xml = '<mujoco><worldbody><body><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".2"/></body>'
    model = mujoco.MjModel.from_xml_string(xml + "</worldbody></mujoco>")
    view = replay_part(frames_of(model, np.linspace(-0.1, 0.1, 5)[:, None])).data["view"]
    for axis, least in (("right", -0.2), ("up", -0.2)):
        k = ["right", "up"].index(axis)
        middle = np.dot(view["centre"][0], view[axis])
        assert middle - view["half"][k] <= least + 1e-4
    assert np.dot(view["centre"][0], view["right"]) + view["half"][0] >= 0.5 - 1e-4


def test_how_far_off_is_told(swing, sorts):
    assert replay_part(swing).data["off"] == f"at most {short(np.rad2deg(2e-5))} deg off"
    same = replay_part(frames_of(sorts.model, sorts.qpos)).data["off"]
    assert same == "the same as the model's"


def test_the_first_view_shows_the_movement(swing, sorts):
    view = replay_part(swing).data["view"]
    assert (view["right"], view["up"]) == ([1, 0, 0], [0, 0, 1])  # sagittal: forward to the right
    turned = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint axis="0 0 1"/><geom type="capsule" fromto="0 0 0 0 .5 0" size=".02"/></body>'
        "</worldbody></mujoco>"
    )
    view = replay_part(frames_of(turned, np.linspace(-0.3, 0.3, 9)[:, None])).data["view"]
    assert np.cross(view["right"], view["up"])[2] > 0.8  # from above
    travel = np.tile(sorts.model.qpos0, (50, 1))
    travel[:, 1] -= np.linspace(0, 8, 50)
    view = replay_part(frames_of(sorts.model, travel)).data["view"]
    assert view["right"] == [0, -1, 0]  # goes to the right,
    assert np.ptp(view["centre"], axis=0) == pytest.approx([0, 8, 0], abs=1e-3)  # and is followed


# in a browser


def opened(browser, tmp_path, frames, **context):
    page = tmp_path / "page.html"
    page.write_text(f"<!doctype html><meta charset=utf-8><body>{replay_part(frames).markup}", encoding="utf-8")
    watched = watched_page(browser, viewport={"width": 800, "height": 700}, **context)
    watched.page.goto(page.as_uri())
    return watched


def picture(page):
    """The canvas after the next drawing: how many pixels are drawn, and a checksum."""
    return page.evaluate(
        """() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => {
          const c = document.querySelector(".replay canvas"), ctx = c.getContext("2d");
          const p = ctx.getImageData(0, 0, c.width, c.height).data;
          let sum = 0, drawn = 0;
          for (let i = 0; i < p.length; i++) { drawn += i % 4 == 3 && p[i] > 0; sum = (sum * 31 + p[i]) % 1e9; }
          done([drawn, sum]);
        })))"""
    )


@pytest.mark.browser
def test_the_player(browser, tmp_path, swing):
    watched = opened(browser, tmp_path, swing, device_scale_factor=2)
    page = watched.page
    page.evaluate("window.told = []; document.addEventListener('mjhcmc:time', (e) => told.push(e.detail))")
    drawn, first = picture(page)
    assert drawn > 5000  # not blank
    assert page.evaluate("document.querySelector('canvas').width / document.querySelector('canvas').clientWidth") == 2
    assert page.evaluate("told.length") == 0  # it does not play by itself

    slider = page.locator(".replay input[type=range]")
    slider.evaluate("(e) => { e.value = 0.4; e.dispatchEvent(new Event('input')) }")
    _, later = picture(page)
    assert later != first
    assert page.evaluate("told") == [{"time": 0.4, "from": "replay"}]
    assert page.locator(".replay output").inner_text() == "0.400 s"

    page.evaluate(
        "document.dispatchEvent(new CustomEvent('mjhcmc:time', {detail: {time: 0, from: 'plot'}}))"
    )  # a plot leads
    assert picture(page)[1] == first
    assert page.evaluate("told.length") == 2  # the plot's own, and no echo

    place, name = page.evaluate(
        """() => { const p = document.querySelector(".replay").replayPlayer, b = p.canvas.getBoundingClientRect();
          const item = p.hits.find((h) => p.data.muscles[h.muscles[0]] === "soleus"), [s, e] = item.strands[0];
          return [[b.left + (s[0] + e[0]) / 2, b.top + (s[1] + e[1]) / 2], p.data.muscles[item.muscles[0]]]; }"""
    )
    page.mouse.move(*place)
    tip = page.locator(".replay-tip")
    tip.wait_for(state="visible")
    told = tip.inner_text()
    muscle = swing.muscle_names.index(name)
    assert f"activation {swing.activation[0, muscle]:.3f}, excitation {swing.excitation[0, muscle]:.3f}" in told
    assert "soleus" in told

    page.mouse.move(600, 100)
    tip.wait_for(state="hidden")
    page.mouse.down()
    page.mouse.move(660, 130)
    page.mouse.up()
    assert picture(page)[1] != first  # turned
    page.mouse.dblclick(600, 100)
    page.mouse.move(5, 5)
    assert picture(page)[1] == first  # and back
    page.locator(".replay select[data-part=factor]").select_option("1000")
    assert picture(page)[1] != first  # 2e-5 rad is seen
    assert "1000 times as large" in page.locator(".replay-legend").inner_text()

    page.locator(".replay canvas").focus()
    page.keyboard.press("ArrowRight")
    assert page.locator(".replay output").inner_text() == "0.020 s"
    page.keyboard.press("Space")
    page.wait_for_function("told.length > 8 && told.at(-1).time > 0.05")  # it plays
    page.keyboard.press("Space")
    assert page.locator(".replay button").first.inner_text() == "Play"

    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert picture(page)[0] > 20000  # stills in a row
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert (watched.errors, watched.outside) == ([], [])
    page.context.close()


@pytest.mark.browser
@pytest.mark.parametrize("case", ["unknown", "one frame", "no muscles"])
def test_the_player_takes_what_is_odd(browser, tmp_path, sorts, case):
    frames = sorts
    if case == "unknown":
        frames = frames_of(sorts.model, sorts.qpos, activation=np.full_like(sorts.activation, np.nan))
    elif case == "one frame":
        frames = frames_of(sorts.model, sorts.qpos[:1])
    else:
        bare = mujoco.MjModel.from_xml_string(
            '<mujoco><worldbody><body><joint axis="0 1 0"/><inertial pos="0 0 -1" mass="1" diaginertia="1 1 1"/>'
            "</body></worldbody></mujoco>"
        )  # nothing but a line figure
        frames = frames_of(bare, np.linspace(0, 1, 5)[:, None], activation=np.zeros((5, 0)))
    watched = opened(browser, tmp_path, frames, color_scheme="dark")
    drawn, first = picture(watched.page)
    assert drawn > 200
    watched.page.evaluate("(() => { const p = document.querySelector('.replay').replayPlayer; p.show(p.last) })()")
    assert (picture(watched.page)[1] == first) == (case == "one frame")
    watched.page.mouse.move(400, 200)
    assert (watched.errors, watched.outside) == ([], [])
    watched.page.context.close()

"""Frames of a solution, the colour of activation, the camera, the clock of a replay: all that needs no OpenGL."""

import dataclasses
import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from osim_documents import write_osim
from view_tools import BALL, DRUMS, filmed, load, swinging

import mjhcmc
from mjhcmc import SettingsError, SimulationError
from mjhcmc.leg8 import leg8_from_osim
from mjhcmc.viewing.camera import Margins, make_camera
from mjhcmc.viewing.clock import Clock
from mjhcmc.viewing.colours import ACTIVE, SILENT, UNKNOWN, activation_rgba, hex_colour, oklab
from mjhcmc.viewing.frames import Frames
from mjhcmc.viewing.legend import hidden_words
from mjhcmc.viewing.scene import Stage
from mjhcmc.viewing.window import with_time_slider

SPACE, RIGHT, LEFT, HOME, END = 32, 262, 263, 268, 269


def spun(turns):
    """(n, 4) unit quaternions of turns (n,), rad, around one axis that is none of the coordinates'."""
    axis = np.array([1.0, 2.0, -2.0]) / 3
    return np.column_stack([np.cos(turns / 2), np.sin(turns / 2)[:, None] * axis])


def test_frames_at_the_nodes_are_the_solution():
    rng = np.random.default_rng(1)
    solution = swinging(activation=rng.random((21, 2)), excitation=rng.random((20, 2)))
    frames = Frames.of(solution)
    np.testing.assert_array_equal(frames.time, solution.time)
    np.testing.assert_array_equal(frames.qpos, solution.qpos)
    np.testing.assert_array_equal(frames.desired, solution.qpos_desired)
    np.testing.assert_array_equal(frames.activation, solution.activation)
    np.testing.assert_array_equal(frames.excitation[:-1], solution.excitation)
    np.testing.assert_array_equal(frames.excitation[-1], solution.excitation[-1])
    assert frames.muscle_names == ("flexor", "biceps")
    assert frames.tendon_of_muscle.tolist() == [0, 1]
    assert [frames.at(t) for t in (-1.0, 0.0, 0.0149, 0.0151, 9.0)] == [0, 0, 1, 2, 20]
    # the copy is the frames' own
    frames.model.tendon_rgba[:] = 0
    assert solution.model.mj_model.tendon_rgba.any()


def test_between_nodes_constant_velocity_is_met_exactly():
    model = load(BALL)
    turns = np.linspace(0.3, 1.5, 4)
    a = np.linspace(0, 1, 4)[:, None] * [1.0, 0.5]
    u = np.array([[0.1, 0], [0.2, 0], [0.3, 0]])
    frames = Frames.of(filmed(model, spun(turns), spun(-turns), activation=a, excitation=u), fps=700)
    assert len(frames) == 22
    now = np.interp(frames.time, [0, 0.03], [0.3, 1.5])
    np.testing.assert_allclose(frames.qpos, spun(now), atol=1e-12)
    np.testing.assert_allclose(frames.desired, spun(-now), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(frames.qpos, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(frames.activation[:, 1], frames.time / 0.06, atol=1e-12)
    window = np.minimum((frames.time / 0.01 + 1e-9).astype(int), 2)
    np.testing.assert_allclose(frames.excitation[:, 0], 0.1 * (1 + window))


def test_part_of_the_motion():
    solution = swinging()
    assert Frames.of(solution, start=0.05, end=0.1).time.tolist() == solution.time[5:11].tolist()
    np.testing.assert_allclose(Frames.of(solution, fps=100, start=0.045).time, np.arange(0.045, 0.2, 0.01), atol=1e-12)


@pytest.mark.parametrize(
    ("asked", "word"),
    [
        ({"fps": 0}, "fps"), ({"fps": -1.0}, "fps"), ({"fps": math.nan}, "fps"), ({"fps": True}, "fps"),
        ({"fps": "30"}, "fps"), ({"fps": 1e9}, "lower it"), ({"start": 0.1, "end": 0.1}, "before"),
        ({"start": -0.1}, "start"), ({"end": 0.3}, "end"), ({"start": math.nan}, "start"),
        ({"start": 0.051, "end": 0.059}, "no node"),
    ],
)  # fmt: skip
def test_bad_frames(asked, word):
    with pytest.raises(SettingsError, match=word):
        Frames.of(swinging(), **asked)


def test_without_its_model():
    with pytest.raises(SimulationError, match="model="):
        Frames.of(dataclasses.replace(swinging(), model=None))


def test_paths_are_the_models_own():
    frames = Frames.of(swinging())
    for k in (0, 7):
        data = mujoco.MjData(frames.model)
        data.qpos[:] = frames.qpos[k]
        mujoco.mj_forward(frames.model, data)
        flexor, biceps = frames.paths(k)
        for path, names in ((flexor, "ab"), (biceps, "cd")):
            np.testing.assert_allclose(path, [data.site(name).xpos for name in names], atol=1e-12)
        length = np.linalg.norm(flexor[1] - flexor[0])
        assert length == pytest.approx(data.ten_length[0], rel=1e-12)


def test_a_pulley_breaks_the_path():
    xml = BALL.replace(
        '<spatial name="rope"><site site="wall"/><site site="arm"/></spatial>',
        '<spatial name="rope"><site site="wall"/><site site="arm"/><pulley divisor="2"/><site site="arm"/>'
        '<site site="wall"/></spatial>',
    )
    rope, ribbon = Frames.of(filmed(load(xml), spun(np.zeros(2)))).paths(0)
    assert np.isnan(rope).all(axis=1).tolist() == [False, False, True, False, False]
    np.testing.assert_allclose(rope[:2], ribbon)


@pytest.fixture(scope="module")
def subject_leg(tmp_path_factory):
    """A leg of somebody's document, whose vasti leave off above the knee and go on below."""
    path = tmp_path_factory.mktemp("osim") / "own.osim"
    write_osim(path)
    return mjhcmc.MuscleModel.load(leg8_from_osim(path, base="fixed"))


def test_a_gap_in_a_path_is_closed(subject_leg):
    frames = Frames.of(filmed(subject_leg, np.zeros((2, 3))))
    m = frames.model
    assert (m.wrap_type == mujoco.mjtWrap.mjWRAP_PULLEY).any()
    vasti = frames.tendon_of_muscle[frames.muscle_names.index("vasti")]
    path, data = frames.paths(0)[vasti], frames.place(frames.qpos[0])
    assert np.isfinite(path).all()
    (gap,) = (gap for gap in frames.gaps if gap.tendon == vasti)
    ends = [data.site_xpos[site] for site in gap.ends]
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    closed = np.linalg.norm(ends[1] - ends[0])
    assert any(np.allclose(path[i : i + 2], ends) for i in range(len(path) - 1))
    arcs = data.ten_length[vasti] - (steps.sum() - closed)  # all the rest counts, arcs by their chords here
    assert 0 <= arcs < 1e-4
    # a piece as thick as the tendon and in its colour, from one end to the other
    stage = Stage(frames)
    scene = mujoco.MjvScene(stage.model, 1000)
    stage.add_to(scene)
    (piece,) = (g for g in scene.geoms[: scene.ngeom] if g.objid == vasti and g.objtype == mujoco.mjtObj.mjOBJ_TENDON)
    np.testing.assert_allclose(piece.pos, np.mean(ends, axis=0), atol=1e-6)
    assert 2 * piece.size[2] == pytest.approx(closed, abs=1e-6)
    assert piece.size[0] == pytest.approx(stage.model.tendon_width[vasti])
    np.testing.assert_allclose(piece.rgba, stage.model.tendon_rgba[vasti], atol=1e-6)


def test_how_far_off_the_desired_pose_is_at_most():
    turns = np.array([0.0, 0.02, 0.01])
    frames = Frames.of(filmed(load(BALL), spun(0 * turns), spun(turns)))
    turn, way = frames.largest_error
    assert turn == pytest.approx(0.02 * 2 / 3, rel=1e-6)  # of the largest of its coordinates
    assert way == 0
    assert hidden_words(frames) == f"desired: hidden, at most {np.rad2deg(turn):.2g} deg off"
    assert hidden_words(Frames.of(swinging())) == "desired: the same pose"


def test_colour_is_of_activation_the_largest_on_each_tendon():
    model = load(BALL)
    frames = Frames.of(filmed(model, spun(np.zeros(3)), activation=[0.2, 0.9], excitation=[1.0, 0.0]))
    rgba = frames.tendon_rgba(1)
    np.testing.assert_allclose(rgba[0], activation_rgba(0.9))  # neither the excitation nor the other muscle's
    np.testing.assert_allclose(rgba[1], [0, 1, 0, 1])  # no muscle: as the model has it
    assert np.isnan(frames.tendon_activation(1)).tolist() == [False, True]
    frames.model.tendon_rgba[:] = 0.5
    np.testing.assert_allclose(frames.tendon_rgba(1)[1], [0, 1, 0, 1])


def test_muscles_on_joints_have_no_tendon():
    frames = Frames.of(filmed(load(DRUMS), np.zeros((2, 1))))
    assert frames.tendon_of_muscle.tolist() == [-1, -1]
    assert frames.tendon_rgba(0).shape == (0, 4)
    assert frames.paths(0) == ()


def test_colours_have_an_order():
    a = np.linspace(0, 1, 41)
    colours = activation_rgba(a)
    assert (hex_colour(colours[0]), hex_colour(colours[-1])) == (SILENT, ACTIVE)
    assert (colours[:, 3] == 1).all()
    lab = oklab(colours[:, :3])
    assert (np.diff(lab[:, 0]) < 0).all()  # read in grey
    steps = np.linalg.norm(np.diff(lab, axis=0), axis=1)
    assert steps.max() < 1.15 * steps.min()  # equal steps look equal
    # OKLab of Ottosson's own examples: white and the pure red of sRGB
    np.testing.assert_allclose(oklab([1.0, 1.0, 1.0]), [1, 0, 0], atol=1e-3)
    np.testing.assert_allclose(oklab([1.0, 0.0, 0.0]), [0.628, 0.225, 0.126], atol=1e-3)


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_every_number_has_a_colour(a):
    rgba = activation_rgba(a)
    assert rgba.shape == (4,)
    if math.isfinite(a):
        np.testing.assert_array_equal(rgba, activation_rgba(min(max(a, 0.0), 1.0)))
    else:
        assert tuple(rgba) == UNKNOWN


def seen(frames, camera, aspect):
    """(n, 2) where the ends of capsules are in the picture, -1 .. 1 to the right and up; by MuJoCo's own camera."""
    stage = Stage(frames)
    found = []
    for k in range(len(frames)):
        stage.show(k)
        scene = mujoco.MjvScene(stage.model, 100)
        stage.compose(scene, camera)
        eyes = scene.camera  # two, a little beside each other
        eye, ahead, up = (np.mean([np.array(getattr(e, n)) for e in eyes], axis=0) for n in ("pos", "forward", "up"))
        half = eyes[0].frustum_top / eyes[0].frustum_near
        along = stage.data.geom_xmat.reshape(-1, 3, 3)[:, :, 2] * stage.model.geom_size[:, 1:2]
        points = np.concatenate([stage.data.geom_xpos + along, stage.data.geom_xpos - along]) - eye
        depth = points @ ahead
        flat = [points @ np.cross(ahead, up) / (depth * half * aspect), points @ up / (depth * half)]
        found.append(np.stack(flat, axis=1))
    return np.concatenate(found)


def test_the_side_camera_looks_across_the_movement():
    side = make_camera(Frames.of(swinging()))
    assert side.azimuth % 180 == pytest.approx(90)  # along y: the pendulums swing in x and z
    other = Frames.of(filmed(load(DRUMS), np.linspace(-1, 1, 9)[:, None]))
    assert make_camera(other).azimuth % 180 == pytest.approx(0)  # these in y and z
    still = Frames.of(filmed(load(DRUMS), np.zeros((2, 1)), np.ones((2, 1))))  # only the ghost is elsewhere
    assert make_camera(still).azimuth % 180 == pytest.approx(0)
    front = make_camera(other, "front")
    assert (front.azimuth - make_camera(other).azimuth) % 360 == pytest.approx(90)
    assert make_camera(other, "top").elevation < -80


@pytest.mark.parametrize("aspect", [0.5, 2.0])
@pytest.mark.parametrize("name", ["side", "front", "top"])
def test_the_camera_sees_the_whole_motion(aspect, name):
    frames = Frames.of(swinging())
    places = seen(frames, make_camera(frames, name, aspect=aspect, margins=Margins(head=0.1, foot=0.2)), aspect)
    slack = [
        0.94 - np.abs(places[:, 0]).max(),
        places[:, 1].min() + 0.6,  # the foot of the picture is .2 of 2
        0.8 - places[:, 1].max(),
    ]
    assert min(slack) > 0, slack
    assert min(slack) < 0.25  # and not from far away


def test_a_left_limb_is_seen_from_its_left():
    xml, turns = DRUMS.replace("1 0 0", "0 1 0"), np.linspace(-1, 1, 5)[:, None]
    left, right = (
        make_camera(Frames.of(filmed(load(xml.replace("<body>", f'<body pos="0 {y} 0">')), turns))) for y in (0.3, -0.3)
    )
    assert (left.azimuth % 360, right.azimuth % 360) == (pytest.approx(270), pytest.approx(90))


def test_the_models_own_camera():
    xml = DRUMS.replace("<worldbody>", '<worldbody><camera name="door" pos="0 -3 0"/>')
    frames = Frames.of(filmed(load(xml), np.zeros((2, 1))))
    camera = make_camera(frames, "door")
    assert (camera.type, camera.fixedcamid) == (mujoco.mjtCamera.mjCAMERA_FIXED, 0)
    with pytest.raises(SettingsError, match=r"'window'.*side, front, top, or of the model's own: door"):
        make_camera(frames, "window")


def test_the_clock():
    clock = Clock(1.0, 2.0, speed=0.5, step=0.1)
    clock.advance(0.5)
    assert clock.time == 1.25
    clock.advance(2.0)
    assert clock.time == pytest.approx(1.25)  # round again
    assert clock.press(SPACE)
    clock.advance(1.0)
    assert (clock.time, clock.playing) == (pytest.approx(1.25), False)
    clock.press(RIGHT)
    assert clock.time == pytest.approx(1.35)
    clock.press(HOME)
    clock.press(LEFT)
    assert clock.time == 1.0
    clock.press(END)
    assert clock.time == 2.0
    clock.press(SPACE)  # from the end: again
    assert (clock.time, clock.playing) == (1.0, True)
    for key, speed in (("]", 1.0), ("=", 2.0), ("[", 1.0), ("-", 0.5)):
        clock.press(ord(key))
        assert clock.speed == speed
    assert not clock.press(ord("Q"))
    clock.seek(7.0)
    assert (clock.time, clock.playing) == (2.0, False)


def test_without_a_loop_the_clock_stops():
    clock = Clock(0.0, 1.0, loop=False)
    clock.advance(1.5)
    assert (clock.time, clock.playing) == (1.0, False)


def test_the_slider_of_time_is_the_only_one():
    model = load().mj_model
    m, slider = with_time_slider(model, 0.5, 2.0)
    assert mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_ACTUATOR, slider) == "time"
    assert m.actuator_ctrlrange[slider].tolist() == [0.5, 2.0]
    hidden = [bool(m.opt.disableactuator >> int(group) & 1) for group in m.actuator_group]
    assert hidden == [i != slider for i in range(m.nu)]
    assert mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_ACTUATOR, 1) == "biceps"
    assert mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, 0) == "flexor"  # the solution's stays as it was


def test_public_names():
    assert mjhcmc.Frames is Frames

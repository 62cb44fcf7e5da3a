"""Inverse kinematics: angles from markers against the motion that made them, and where markers do not suffice."""

import json

import mujoco
import numpy as np
import pytest
from conftest import HANGING_MASS, LINEAR_ACTUATOR, load_xml
from motion_tools import LEG
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from mjhcmc.errors import ModelError, MotionError, SettingsError
from mjhcmc.io.trc import write_trc
from mjhcmc.motion import Motion

PELVIS = ("iliopsoas_P1", "glut_max_P1", "rect_fem_P1", "hamstrings_P1")
SITES = (
    *PELVIS, "vasti_P1", "glut_max_P4", "gastroc_P1",
    "tib_ant_P1", "soleus_P1", "tib_ant_P2",
    "gastroc_P3", "soleus_P2", "tib_ant_P3",
)  # fmt: skip
TIME = np.linspace(2, 2.6, 31)
QPOS = np.column_stack([0.6 * np.sin(9 * TIME), -0.9 + 0.8 * np.cos(7 * TIME), 0.4 * np.sin(5 * TIME)])
UP = Rotation.from_euler("x", -90, degrees=True)  # the model's z up to the laboratory's Y up


def laboratory(frame):
    """Model to laboratory: Y up, walking along X, the pelvis swaying."""
    sway = Rotation.from_rotvec([0.1 * np.sin(frame / 3), 0.3, 0.05 * np.cos(frame / 4)])
    return sway * UP, np.array([0.4 + 0.03 * frame, 0.9, -0.2])


def sites_at(model, qpos, sites=SITES):
    data = mujoco.MjData(model.mj_model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model.mj_model, data)
    return np.array([data.site(site).xpos for site in sites])


def synthesise(model, qpos=QPOS, sites=SITES, noise=0.0):
    """(T, n, 3) m, markers on the sites, in the laboratory's frame."""
    points = []
    for frame, q in enumerate(qpos):
        turn, shift = laboratory(frame)
        points.append(turn.apply(sites_at(model, q, sites)) + shift)
    return np.array(points) + noise * np.random.default_rng(0).normal(size=(len(qpos), len(sites), 3))


@pytest.fixture(scope="module")
def clean(leg8):
    return synthesise(leg8)


@pytest.fixture
def put(tmp_path):
    def put(points, names=SITES, time=TIME, unit="mm"):
        write_trc(tmp_path / "walk.trc", names, time, points, unit=unit)
        return tmp_path / "walk.trc"

    return put


def where(*names):
    return [SITES.index(name) for name in names]


# --- angles ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", ["mm", "m"])
def test_angles_come_back_whatever_the_laboratory(leg8, clean, put, unit):
    motion = Motion.from_file(put(clean, unit=unit), leg8)
    np.testing.assert_array_equal(motion.time, TIME)
    np.testing.assert_allclose(motion.qpos, QPOS, atol=1e-6)
    assert (motion.name, motion.joint_names) == ("walk", leg8.joint_names)
    assert len(motion.notices) == 1
    assert motion.notices[0].startswith("inverse kinematics on 13 markers: ")


def test_noise_of_a_millimetre_gives_what_the_geometry_allows(leg8, put):
    """Errors against the Cramer-Rao bound: sigma^2 (J^T J)^-1 of all unknowns, J by differences of the sites."""
    time = np.linspace(0, 3, 301)
    qpos = np.column_stack([0.3 * np.sin(6 * time), -0.5 + 0.3 * np.cos(5 * time), 0.2 * np.sin(9 * time)])
    motion = Motion.from_file(put(synthesise(leg8, qpos, noise=1e-3), time=time), leg8)

    def rotated(x):
        return Rotation.from_rotvec(x[3:6]).apply(sites_at(leg8, x[:3])).ravel() + np.tile(x[6:], len(SITES))

    middle, step = np.concatenate([qpos.mean(axis=0), np.zeros(6)]), 1e-6
    jacobian = np.column_stack([(rotated(middle + e) - rotated(middle - e)) / (2 * step) for e in step * np.eye(9)])
    bound = 1e-3 * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian))[:3])
    error = motion.qpos - qpos
    np.testing.assert_allclose(error.std(axis=0), bound, rtol=0.2)
    assert (np.abs(error.mean(axis=0)) < 4 * bound / np.sqrt(len(time))).all()


def test_one_frame_is_the_minimum_that_another_solver_finds(leg8, put):
    points = synthesise(leg8, QPOS[:4], noise=5e-3)
    motion = Motion.from_file(put(points, time=TIME[:4]), leg8)
    turn, shift = laboratory(2)

    def residual(x):
        moved = (Rotation.from_rotvec(x[3:6]) * turn).apply(sites_at(leg8, x[:3])) + shift + x[6:]
        return (moved - points[2]).ravel()

    other = least_squares(residual, np.concatenate([QPOS[2], np.zeros(6)]), xtol=1e-12, ftol=1e-14, gtol=1e-14)
    np.testing.assert_allclose(motion.qpos[2], other.x[:3], atol=1e-6)


def test_the_notice_gives_rms_and_the_worst_marker(leg8, clean, put):
    points = clean.copy()
    points[12, SITES.index("soleus_P2")] += [0, 0.06, 0]
    notice = Motion.from_file(put(points), leg8).notices[0]
    words = notice.split()
    assert "worst soleus_P2 with" in notice
    assert notice.endswith(f"mm at {TIME[12]:.6g} s")
    assert 20 < float(words[words.index("with") + 1]) < 60
    assert 1 < float(words[words.index("markers:") + 1]) < 60 / np.sqrt(13 * 31) + 1e-9


def test_markers_that_fit_badly_are_said_to(leg8, clean, put):
    notice = Motion.from_file(put(1.1 * clean[:4], time=TIME[:4]), leg8).notices[0]
    assert notice.endswith("markers on wrong sites, or a model of other lengths, make such distances")


def test_y_up_from_the_models_z_up_is_exact(leg8, put):
    """Forward, up, right: y up is the model's z, z right is the model's -y."""
    points = np.array([sites_at(leg8, q) for q in QPOS])[:, :, [0, 2, 1]] * [1, 1, -1]
    motion = Motion.from_file(put(points), leg8)
    np.testing.assert_allclose(motion.qpos, QPOS, atol=1e-6)
    assert len(motion.notices) == 1


def test_markers_not_seen_are_left_out(leg8, clean, put):
    points = clean.copy()
    for frame, marker in ((0, "tib_ant_P1"), (7, PELVIS[0]), (7, "soleus_P2"), (30, "vasti_P1")):
        points[frame, SITES.index(marker)] = np.nan
    np.testing.assert_allclose(Motion.from_file(put(points), leg8).qpos, QPOS, atol=1e-6)


def test_markers_of_other_names_are_mapped_or_not_used(leg8, clean, put, tmp_path):
    names = [f"S1:{site}" for site in SITES]
    names[0], names[4] = "RASI", "RTHI"
    chosen = {SITES[0]: "RASI", SITES[4]: "RTHI"}
    points = np.concatenate([clean, clean[:, :2] + 1], axis=1)
    path = put(points, [*names, "C7", "HEAD"])
    (tmp_path / "map.json").write_text(json.dumps(chosen))
    (tmp_path / "map.csv").write_text("site,marker\n" + "".join(f"{s},{m}\n" for s, m in chosen.items()))
    for given_map in (chosen, tmp_path / "map.json", tmp_path / "map.csv"):
        motion = Motion.from_file(path, leg8, column_map=given_map)
        np.testing.assert_allclose(motion.qpos, QPOS, atol=1e-6)
        assert motion.notices[1:] == ("markers not used: C7, HEAD",)
    motion = Motion.from_file(path, leg8)
    np.testing.assert_allclose(motion.qpos, QPOS, atol=1e-6)
    assert motion.notices[1:] == ("markers not used: RASI, RTHI, C7, HEAD",)


def test_crop_and_filter_work_as_on_tables(leg8, clean, put):
    path = put(clean)
    whole = Motion.from_file(path, leg8, 20)
    crop = Motion.from_file(path, leg8, 20, start=2.15, end=2.45)
    assert crop.span == (2.15, 2.45)
    t = np.linspace(2.15, 2.45, 40)
    np.testing.assert_allclose(crop.sample(t).qpos, whole.sample(t).qpos, atol=1e-5)
    assert whole.notices[-1] == "low-pass filtered at 20 Hz"


def test_a_joint_held_at_its_limit_is_told(leg8, put):
    knee = np.deg2rad(np.clip(30 * (TIME - TIME[0]) / 0.6 - 10.5, -20, 12))
    qpos = np.column_stack([QPOS[:, 0], knee, QPOS[:, 2]])
    motion = Motion.from_file(put(synthesise(leg8, qpos)), leg8, 6)
    held = np.flatnonzero(knee > np.deg2rad(10))
    assert motion.notices[1] == (
        f"joint knee is held at a limit of its range -120 .. 10 deg in {len(held)} of 31 frames, first at "
        f"{TIME[held[0]]:.6g} s"
    )


def test_slides_and_hinges_without_limits(put):
    model = load_xml(
        HANGING_MASS.format(actuator=LINEAR_ACTUATOR).replace(
            '<site name="hook" pos="0 0 0"/>',
            '<site name="hook" pos="0 0 0"/><body><joint name="spin" axis="0 1 0"/>'
            '<geom size=".05" mass="1" pos=".1 0 0"/><site name="tip" pos=".2 0 0"/></body>',
        ).replace(
            '<site name="ceiling" pos="0 0 1"/>',
            '<site name="ceiling" pos="0 0 1"/><site name="left" pos="1 0 1"/><site name="right" pos="0 1 1"/>',
        )
    )  # fmt: skip
    sites = ("ceiling", "left", "right", "hook", "tip")
    qpos = np.column_stack([0.3 * np.sin(TIME), np.linspace(-3, 12, len(TIME))])
    motion = Motion.from_file(put(synthesise(model, qpos, sites), sites), model)
    np.testing.assert_allclose(motion.qpos, qpos, atol=1e-6)


# --- what is refused ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axes", "signs", "noise"),
    [([0, 1, 2], [-1, 1, 1], 0), ([0, 2, 1], [1, 1, 1], 5e-3), ([0, 1, 2], [-1] * 3, 0)],
)
def test_left_handed_axes_are_said_to_be(leg8, put, axes, signs, noise):
    points = synthesise(leg8, QPOS[:10], noise=noise)[:, :, axes] * signs
    points[4, SITES.index("soleus_P2")] = np.nan
    with pytest.raises(
        MotionError,
        match=r"walk\.trc: inverse kinematics on 13 markers: 4\d\.?\d* mm rms, worst .*: axes are left-handed: "
        r"mirrored, the markers come within ([\d.e-]+) mm rms: reverse the sign of one axis",
    ) as raised:
        Motion.from_file(put(points, time=TIME[:10]), leg8)
    assert "\n" not in str(raised.value)
    within = float(str(raised.value).split("come within ")[1].split()[0])
    assert 0.6 * noise <= 1e-3 * within <= 2 * noise + 1e-6


@pytest.mark.parametrize("spoil", ["unit"])
def test_markers_nowhere_near_their_sites(leg8, clean, put, spoil):
    points = {"larger": 1.5 * clean, "unit": 1e-3 * clean}[spoil]
    with pytest.raises(
        MotionError, match=r"walk\.trc: inverse kinematics on 13 markers: .* mm rms, worst .*: too far for markers on"
    ):
        Motion.from_file(put(points), leg8)


def test_how_far_markers_may_be_goes_with_the_size_of_the_animal(put):
    """A model of 5 cm: markers on each other's sites are off by less than skin moves on a person."""
    joint = '<joint name="knee" axis="0 1 0"/>'
    body = f'<body>{joint}<geom size=".005"/><site name="hook" pos="0 0 -.03"/><site name="tip" pos=".01 0 -.04"/>'
    model = load_xml(
        '<mujoco><option integrator="RK4"/><worldbody><site name="a" pos="0 0 .02"/>'
        f'<site name="b" pos=".03 0 .01"/><site name="c" pos="0 .02 .01"/>{body}</body></worldbody>'
        '<tendon><spatial name="rope"><site site="b"/><site site="tip"/></spatial></tendon>'
        f"<actuator>{LINEAR_ACTUATOR}</actuator></mujoco>"
    )
    sites = ("a", "b", "c", "hook", "tip")
    points = synthesise(model, 0.3 * np.sin(TIME)[:, None], sites)
    np.testing.assert_allclose(Motion.from_file(put(points, sites), model).qpos[:, 0], 0.3 * np.sin(TIME), atol=1e-5)
    with pytest.raises(MotionError, match=r" [1-4]\d\.?\d* mm rms, worst .*: (too far for markers on|axes are left)"):
        Motion.from_file(put(points[:, [3, 1, 4, 2, 0]], sites), model)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((*PELVIS[:2], *SITES[4:]), r"walk\.trc: the joint angles need at least 3 markers, not on a line, on the "
         r"bodies that no joint of model leg8 moves; there is only iliopsoas_P1, glut_max_P1: add markers there"),
        (SITES[4:], r"not on a line, .* there is none: add markers there"),
        ((*PELVIS, "vasti_P1", "tib_ant_P1"), r"walk\.trc: the markers do not see joint ankle of model leg8: add"),
        (PELVIS, r"the markers do not see joint (hip|knee|ankle)"),
    ],
)  # fmt: skip
def test_markers_that_do_not_determine_the_angles(leg8, clean, put, names, message):
    with pytest.raises(MotionError, match=message) as raised:
        Motion.from_file(put(clean[:, where(*names)], names), leg8)
    assert "\n" not in str(raised.value)


def test_pelvis_markers_on_a_line(put):
    model = load_xml(
        HANGING_MASS.format(actuator=LINEAR_ACTUATOR).replace(
            '<site name="ceiling" pos="0 0 1"/>',
            '<site name="ceiling" pos="0 0 1"/><site name="left" pos="1 0 1"/><site name="right" pos="2 0 1.001"/>',
        )
    )
    sites = ("ceiling", "left", "right", "hook")
    with pytest.raises(MotionError, match=r"3 markers, not on a line, .* there is only ceiling, left, right"):
        Motion.from_file(put(synthesise(model, np.zeros((31, 1)), sites), sites), model)


def test_a_frame_with_too_few_markers_names_time_and_marker(leg8, clean, put):
    points = clean.copy()
    points[3, where(*PELVIS[:2])] = np.nan  # line 10
    points[1] = np.nan
    points[20, where("gastroc_P3", "soleus_P2", "tib_ant_P3")] = np.nan
    path = put(points)
    with pytest.raises(
        MotionError,
        match=r"walk\.trc, line 10: at 2\.06 s markers iliopsoas_P1, glut_max_P1 not seen: .* at least 3 markers",
    ):
        Motion.from_file(path, leg8, start=2.05)
    with pytest.raises(
        MotionError,
        match=r"line 27: at 2\.4 s markers gastroc_P3, soleus_P2, tib_ant_P3 not seen: .* joint ankle .*crop it",
    ):
        Motion.from_file(path, leg8, start=2.1)
    motion = Motion.from_file(path, leg8, start=2.1, end=2.35)
    np.testing.assert_array_equal(motion.time, TIME[4:20])  # neighbours lead the spline, up to the frames with gaps
    np.testing.assert_allclose(motion.qpos, QPOS[4:20], atol=1e-6)


def test_times_that_stand_or_fall(leg8, clean, put):
    time = TIME.copy()
    time[5] = time[4]
    with pytest.raises(
        MotionError, match=r"walk\.trc, line 12: time 2\.08 s follows 2\.08 s: the same time with other"
    ):
        Motion.from_file(put(clean, time=time), leg8)
    with pytest.raises(MotionError, match=r"walk\.trc: 3 rows from 2 to 2\.04 s: a motion needs at least 4"):
        Motion.from_file(put(clean[:3], time=TIME[:3]), leg8)


@pytest.mark.parametrize(
    ("names", "column_map", "message"),
    [
        (SITES, {"patella": "vasti_P1"}, r"model leg8 has no site patella: its sites are iliopsoas_P1, .* more"),
        (SITES, {"vasti_P2": "KNEE"}, r"walk\.trc: no marker KNEE, which the column map names; its markers are"),
        (SITES, {"vasti_P2": "vasti_P1"}, r"marker 'vasti_P1' stands for the sites vasti_P1 and vasti_P2: map each"),
        (SITES, {"vasti_P2": 3}, r"site 'vasti_P2' maps to 3: give a marker's name$"),
        ([f"M{i}" for i in range(13)], None, r"walk\.trc: no marker has the name of a site of model leg8; the markers "
         r"are M0, .* and 1 more, the sites .*: give a column map of sites and markers"),
    ],
)  # fmt: skip
def test_maps_and_names_refused(leg8, clean, put, names, column_map, message):
    with pytest.raises(MotionError, match=message):
        Motion.from_file(put(clean, names), leg8, column_map=column_map)


def test_markers_have_no_angle_unit_and_need_a_model_with_sites(leg8, clean, put):
    path = put(clean)
    for options, given in (
        ({"angle_unit": "deg"}, "angle_unit 'deg'"),
        ({"angles": "segment"}, "angles 'segment'"),
        ({"angle_unit": "rad", "angles": "segment"}, "angle_unit 'rad' and angles 'segment'"),
    ):
        with pytest.raises(SettingsError, match=rf"walk\.trc: holds markers, not angles: leave out {given}$"):
            Motion.from_file(path, leg8, **options)
    with pytest.raises(ModelError, match=r"model leg: markers need its sites: give a MuscleModel"):
        Motion.from_file(path, LEG)

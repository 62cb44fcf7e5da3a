"""leg8_gait and subjects' legs: file, moving pelvis, scaling, both sides, moving knee, the walking trial."""

from __future__ import annotations

import importlib.util
import math
import sys
import warnings
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest
from osim_documents import write_osim

import mjhcmc
from mjhcmc.errors import MjhcmcWarning, ModelError, SettingsError
from mjhcmc.io.osim import read_osim
from mjhcmc.leg8 import JOINTS, MUSCLES, build_leg8, build_leg8_gait, leg8_from_osim, leg8_gait_xml
from mjhcmc.leg8.from_osim import subject_table
from mjhcmc.leg8.knee import KNEE_SLIDES, fit_knee_axis, fit_knee_motion
from mjhcmc.leg8.osim_leg import OsimLeg
from mjhcmc.leg8.subject_fit import PathModel
from mjhcmc.leg8.table import ROOT_JOINTS
from mjhcmc.opensim_names import read_pairs

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "assets" / "leg8_gait.xml"
WALK = ROOT.parent / "shared" / "walk"
POSTURES = np.radians([[0, 0, 0], [25, -15, 5], [-20, -5, 10], [20, -60, -15], [10, 5, 0]])
UNEVEN = {"pelvis": 1.03, "femur": 1.15, "tibia": 0.97, "foot": 1.06}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(FILE))


@pytest.fixture(scope="module")
def documents(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Documents: the source's own size, an uneven subject, and twice the size."""
    folder = tmp_path_factory.mktemp("osim")
    write_osim(folder / "own.osim")
    write_osim(folder / "uneven.osim", size=UNEVEN, mass=0.9, version=30000)
    write_osim(folder / "large.osim", size=1.2, mass=1.5)
    return folder


def names(m: mujoco.MjModel) -> list[str]:
    return [m.joint(i).name for i in range(m.njnt)]


def text_of(m: mujoco.MjModel, name: str) -> str:
    index = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_TEXT, name)
    start = m.text_adr[index]
    return bytes(m.text_data[start : start + m.text_size[index] - 1]).decode()


def inverse(m: mujoco.MjModel, state: dict[str, tuple[float, float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Generalized forces without muscles, and the mass matrix, with named values, velocities and accelerations."""
    d, torque, mass = mujoco.MjData(m), np.zeros(m.nv), np.zeros((m.nv, m.nv))
    for name, (q, v, a) in state.items():
        d.joint(name).qpos, d.joint(name).qvel, d.joint(name).qacc = q, v, a
    mujoco.mj_fwdPosition(m, d)
    mujoco.mj_fwdVelocity(m, d)
    mujoco.mj_rne(m, d, 1, torque)
    mujoco.mj_fullM(m, d, mass)
    return torque, mass


# leg8_gait


def test_file_is_what_the_builder_writes() -> None:
    assert FILE.read_text(encoding="utf-8") == leg8_gait_xml()


def test_model_loads_and_names_opensims_parts(model: mujoco.MjModel) -> None:
    own = mjhcmc.MuscleModel.load("leg8_gait")
    assert own.joint_names == (*ROOT_JOINTS, *JOINTS)
    assert own.muscle_names == MUSCLES
    assert own.column_map == {
        "pelvis_tx": "pelvis_tx",
        "pelvis_ty": "pelvis_ty",
        "pelvis_tilt": "pelvis_tilt",
        "hip": "hip_flexion_r",
        "knee": "knee_angle_r",
        "ankle": "ankle_angle_r",
    }
    assert own.opensim.paths["pelvis_ty"] == "/jointset/ground_pelvis/pelvis_ty"
    bodies = "pelvis=pelvis femur_r=thigh tibia_r=shank talus_r=foot calcn_r=foot toes_r=foot"
    assert text_of(model, "opensim_bodies") == bodies
    assert text_of(build_leg8().compile(), "opensim_bodies") == bodies
    keys = [pair.split("=")[0] for pair in bodies.split()]
    assert read_pairs(model, "leg8_gait", "opensim_bodies", "body=body", keys)["calcn_r"] == "foot"
    np.testing.assert_allclose(model.key("rest").qpos, model.qpos0)
    assert not model.jnt_limited[:3].any()


def test_root_has_opensims_signs_and_places(model: mujoco.MjModel) -> None:
    """Coordinates are the pelvis' place in the ground; tilt turns forward up; the leg hangs as leg8's does."""
    d = mujoco.MjData(model)
    for name, value in zip(ROOT_JOINTS, (0.6, 1.02, 0.3), strict=True):
        d.joint(name).qpos = value
    mujoco.mj_kinematics(model, d)
    np.testing.assert_allclose(d.body("pelvis").xpos, [0.6, 0.0, 1.02], atol=1e-12)
    forward = d.body("pelvis").xmat.reshape(3, 3)[:, 0]
    np.testing.assert_allclose(forward, [math.cos(0.3), 0.0, math.sin(0.3)], atol=1e-12)
    hanging, own = build_leg8().compile(), mujoco.MjData(build_leg8().compile())
    mujoco.mj_kinematics(hanging, own)
    d.qpos[:] = model.qpos0
    mujoco.mj_kinematics(model, d)
    for body in ("thigh", "shank", "foot"):
        np.testing.assert_allclose(d.body(body).xpos - d.body("pelvis").xpos, own.body(body).xpos, atol=1e-12)
    assert 0.0 < d.site("soleus_P2").xpos[2] < 0.06  # the heel is near the ground


def test_leg_moves_as_leg8_does_where_the_pelvis_stands(model: mujoco.MjModel) -> None:
    state = {"hip": (0.4, 1.0, 9.0), "knee": (-0.7, -2.0, 5.0), "ankle": (0.2, 3.0, -7.0)}
    torque, mass = inverse(model, state | {"pelvis_ty": (0.95, 0.0, 0.0)})
    hanging, own = inverse(build_leg8().compile(), state)
    np.testing.assert_allclose(torque[3:], hanging, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(mass[3:, 3:], own, rtol=1e-6)
    falling, _ = inverse(model, state | {"pelvis_tx": (0.0, 0.0, 0.0), "pelvis_ty": (0.95, 0.0, -9.80665)})
    weightless = build_leg8()
    weightless.option.gravity = [0.0, 0.0, 0.0]
    np.testing.assert_allclose(falling[3:], inverse(weightless.compile(), state)[0], rtol=1e-6, atol=1e-6)
    assert mass[0, 0] == pytest.approx(model.body_mass.sum(), rel=1e-9)


def test_gait_scales_as_leg8(model: mujoco.MjModel) -> None:
    scaled = build_leg8_gait(90.0, 1.5).compile()
    np.testing.assert_allclose(scaled.body_mass, model.body_mass * 90.0 / 75.1646, rtol=1e-5)
    assert scaled.qpos0[1] == pytest.approx(0.95 * 1.5 / 1.8, abs=1e-6)
    with pytest.raises(SettingsError, match="height"):
        build_leg8_gait(height=3.0)


# Subjects


def test_the_sources_own_document_gives_leg8(documents: Path) -> None:
    """Same bodies, same fixed points; only the knee's fits are made anew."""
    own, leg8 = leg8_from_osim(documents / "own.osim", base="fixed").compile(), build_leg8().compile()
    assert names(own) == names(leg8)
    np.testing.assert_allclose(own.body_mass, leg8.body_mass, rtol=1e-6)
    np.testing.assert_allclose(own.jnt_range, leg8.jnt_range, atol=1e-6)
    np.testing.assert_allclose(own.tendon_damping, leg8.tendon_damping, rtol=1e-5)
    np.testing.assert_allclose(own.body_inertia[[1, 2, 3, 4]], leg8.body_inertia[[1, 2, 3, 4]], rtol=1e-5)
    np.testing.assert_allclose(own.body("shank").pos, leg8.body("shank").pos, atol=0.003)
    for name in ("force", "vmax"):
        index = {"force": 2, "vmax": 6}[name]
        np.testing.assert_allclose(own.actuator_gainprm[:, index], leg8.actuator_gainprm[:, index], rtol=1e-5)
    fits = {"rect_fem_P3", "vasti_P4", "gastroc_P1"}
    for i in range(leg8.nsite):
        site = leg8.site(i)
        if site.name in fits or site.name.endswith("_side"):
            continue
        shift = 0.003 if leg8.body(site.bodyid[0]).name == "shank" else 1e-6
        np.testing.assert_allclose(own.site(site.name).pos, site.pos, atol=shift, err_msg=site.name)
    assert text_of(own, "opensim_muscles") == text_of(leg8, "opensim_muscles")


@pytest.mark.parametrize(("name", "moving_knee"), [("own", False), ("own", True), ("uneven", True), ("large", False)])
def test_lengths_and_moment_arms_follow_any_subject(documents: Path, name: str, moving_knee: bool) -> None:
    """Within the figures to reach, for subjects of any proportions, without any shift of lengths."""
    leg = OsimLeg(read_osim(documents / f"{name}.osim"), "right")
    angle = np.linspace(0.0, 2 * np.pi, 60)
    qpos = np.radians(np.stack([10 + 20 * np.cos(angle), -30 + 33 * np.sin(angle), 10 * np.sin(2 * angle)], axis=1))
    own_length, own_arm = PathModel(subject_table(leg, moving_knee=moving_knee)).lengths_and_arms(qpos)
    length, arm = leg.lengths_and_arms(qpos)
    rms_length = np.sqrt(((own_length - length) ** 2).mean(axis=0))
    rms_arm = np.sqrt(((own_arm - arm) ** 2).mean(axis=0))
    assert rms_length.max() < 0.0012, dict(zip(MUSCLES, rms_length, strict=True))
    assert rms_arm.max() < 0.003, dict(zip(MUSCLES, rms_arm, strict=True))
    free = [MUSCLES.index(muscle) for muscle in ("iliopsoas", "glut_max", "soleus", "tib_ant")]
    assert rms_length[free].max() < 2e-6


@pytest.mark.parametrize(("femur", "moving_knee"), [(0.85, True), (1.25, False)])
def test_lengths_have_no_jumps_over_the_whole_range(tmp_path: Path, femur: float, moving_knee: bool) -> None:
    """No step along a joint changes a length by more than the moment arm says; wraps that flip would."""
    path = write_osim(tmp_path / "own.osim", size={"pelvis": 1.0, "femur": femur, "tibia": 1.1, "foot": 1.0})
    model = PathModel(subject_table(OsimLeg(read_osim(path), "right"), moving_knee=moving_knee))
    for joint, (low, high) in enumerate(np.radians([[-120, 120], [-120, 12], [-90, 90]])):
        for other in (0.0, -0.9):
            qpos = np.zeros((601, 3))
            qpos[:, 1] = other
            qpos[:, joint] = np.linspace(low, high, len(qpos))
            length, arm = model.lengths_and_arms(qpos)
            reach = np.maximum(np.abs(arm[1:, :, joint]), np.abs(arm[:-1, :, joint])) * (high - low) / 600
            assert (np.abs(np.diff(length, axis=0)) <= reach * 1.02 + 1e-6).all(), JOINTS[joint]


def test_scaling_laws(documents: Path) -> None:
    """A document of 1.2 times the size and 1.5 times the mass: forces of gravity and inertia, damping, muscle range."""
    own, large = (leg8_from_osim(documents / f"{name}.osim", base="fixed").compile() for name in ("own", "large"))
    state = {"hip": (0.4, 1.0, 9.0), "knee": (-0.7, -2.0, 5.0), "ankle": (0.2, 3.0, -7.0)}
    slow = {joint: (q, v / math.sqrt(1.2), a / 1.2) for joint, (q, v, a) in state.items()}
    torque, mass = inverse(own, state)
    large_torque, large_mass = inverse(large, slow)
    np.testing.assert_allclose(large_mass, mass * 1.5 * 1.2**2, rtol=1e-4)
    np.testing.assert_allclose(large_torque, torque * 1.5 * 1.2, rtol=1e-4)
    np.testing.assert_allclose(large.tendon_damping.ravel(), own.tendon_damping.ravel() / 1.2, rtol=1e-5)
    np.testing.assert_allclose(large.actuator_gainprm[:, 2], own.actuator_gainprm[:, 2], rtol=1e-6)
    assert large.qpos0.max() == 0.0


@pytest.mark.parametrize("moving_knee", [True])
def test_left_leg_mirrors_the_right(documents: Path, moving_knee: bool) -> None:
    right, left = (
        leg8_from_osim(documents / "uneven.osim", side=side, moving_knee=moving_knee).compile()
        for side in ("right", "left")
    )
    assert names(left) == names(right)
    flip = np.array([1.0, -1.0, 1.0])
    np.testing.assert_allclose(left.site_pos, right.site_pos * flip, atol=2e-6)
    np.testing.assert_allclose(left.body_ipos, right.body_ipos * flip, atol=2e-6)
    np.testing.assert_allclose(left.cam_pos, right.cam_pos * flip, atol=1e-9)
    joints = (*ROOT_JOINTS, *JOINTS)
    state = {joint: (0.2 - 0.1 * i, 1.0 - 0.3 * i, 5.0 - i) for i, joint in enumerate(joints)}
    for one, other in zip(inverse(left, state), inverse(right, state), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4)
    own = mjhcmc.MuscleModel.load(leg8_from_osim(documents / "uneven.osim", side="left", moving_knee=moving_knee))
    assert own.column_map["knee"] == "knee_angle_l"
    assert own.opensim.muscles["soleus"] == "soleus_l"
    assert own.opensim.paths["hip"] == "/jointset/hip_l/hip_flexion_l"
    assert text_of(left, "opensim_bodies").startswith("pelvis=pelvis femur_l=thigh")
    legs = [OsimLeg(read_osim(documents / "uneven.osim"), side) for side in ("right", "left")]
    tables = [subject_table(leg, moving_knee=moving_knee) for leg in legs]
    arms = [PathModel(table).lengths_and_arms(POSTURES)[1] for table in tables]
    np.testing.assert_allclose(arms[0], arms[1], atol=1e-5)


def test_base_and_standing_height(documents: Path) -> None:
    fixed = leg8_from_osim(documents / "own.osim", base="fixed").compile()
    planar = leg8_from_osim(documents / "own.osim").compile()
    assert names(fixed) == list(JOINTS)
    assert names(planar) == [*ROOT_JOINTS, *JOINTS]
    np.testing.assert_allclose(planar.qpos0, [0.0, 0.94, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(planar.key("rest").qpos, planar.qpos0)
    np.testing.assert_allclose(planar.body_mass, fixed.body_mass)


@pytest.fixture
def unfitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Legs keep leg8's own cylinders, where a test is not about paths: a fit takes most of a second."""
    monkeypatch.setattr("mjhcmc.leg8.from_osim.fit_subject", lambda leg, table, scales: table)


@pytest.mark.usefixtures("unfitted")
def test_muscles_own_times_and_speeds_are_kept(tmp_path: Path) -> None:
    path = write_osim(tmp_path / "own.osim", kind="Thelen2003Muscle", edit=lambda root: slow_down(root))
    model, plain = leg8_from_osim(path, base="fixed").compile(), build_leg8().compile()
    np.testing.assert_allclose(model.actuator_dynprm[:, :2], np.tile([0.015, 0.05], (8, 1)))
    assert not model.tendon_damping.any()  # Thelen's muscle has no fiber damping
    ratio = model.actuator_gainprm[:, 6] / plain.actuator_gainprm[:, 6]
    np.testing.assert_allclose(ratio, [0.5 if muscle == "soleus" else 1.0 for muscle in MUSCLES], rtol=1e-5)


def slow_down(root: ET.Element) -> None:
    soleus = root.find(".//Thelen2003Muscle[@name='soleus_r']")
    assert soleus is not None
    ET.SubElement(soleus, "max_contraction_velocity").text = "5"


def test_turned_frames_give_the_same_leg(tmp_path: Path) -> None:
    """A document whose tibia frame is turned by .1 rad about z and moved, with all that lies in it: the same leg."""

    def turn(root: ET.Element) -> None:
        sine, cosine = math.sin(0.1), math.cos(0.1)
        for element in (*root.iter("PathPoint"), *root.iter("Body")):
            body = element.findtext("socket_parent_frame") or element.get("name")
            place = element.find("location" if element.tag == "PathPoint" else "mass_center")
            if body in ("/bodyset/calcn_r", "calcn_r") and place is not None:
                x, y, z = (float(word) for word in (place.text or "").split())
                place.text = f"{cosine * x - sine * y + 0.01!r} {sine * x + cosine * y!r} {z!r}"
        for joint in root.iter("WeldJoint"):
            frame = joint.find("frames")
            if joint.get("name") not in ("subtalar_r", "mtp_r") or frame is None:
                continue
            if joint.get("name") == "subtalar_r":
                own = ET.SubElement(frame, "PhysicalOffsetFrame", name="own")
                socket = joint.find("socket_child_frame")
            else:
                own, socket = frame[0], None
                x, y, z = (float(word) for word in (own.findtext("translation") or "").split())
                place = own.find("translation")
                assert place is not None
                place.text = f"{cosine * x - sine * y + 0.01!r} {sine * x + cosine * y!r} {z!r}"
                angles = own.find("orientation")
                assert angles is not None
                angles.text = "0 0 0.1"
            if socket is not None:
                socket.text = "own"
                for tag, words in (
                    ("socket_parent", "/bodyset/calcn_r"),
                    ("translation", "0.01 0 0"),
                    ("orientation", "0 0 0.1"),
                ):
                    ET.SubElement(own, tag).text = words

    plain = leg8_from_osim(write_osim(tmp_path / "plain.osim"), base="fixed").compile()
    turned = leg8_from_osim(write_osim(tmp_path / "turned.osim", edit=turn), base="fixed").compile()
    np.testing.assert_allclose(turned.site_pos, plain.site_pos, atol=2e-6)
    np.testing.assert_allclose(turned.body_ipos, plain.body_ipos, atol=2e-6)


# The knee


def test_moving_knee_follows_the_documents(documents: Path) -> None:
    leg = OsimLeg(read_osim(documents / "uneven.osim"), "right")
    motion = fit_knee_motion(leg.knee_path, *np.radians([-120.0, 10.0]))
    angle = np.radians(np.linspace(-120, 10, 261))
    forward, up = np.abs(motion.path(angle) - leg.knee_path(angle)[:, :2]).max(axis=0)
    assert forward < 5e-5  # the split slide follows the bends that one polynomial cannot
    assert up < 2e-4
    single = np.polynomial.Polynomial.fit(angle, leg.knee_path(angle)[:, 0], 4)
    assert np.abs(single(angle) - leg.knee_path(angle)[:, 0]).max() > 5 * forward


def test_fixed_knee_of_a_hinge_is_that_hinge() -> None:
    center, zero = np.array([0.01, -0.42]), np.array([-0.004, -0.4])

    def path(angle: np.ndarray) -> np.ndarray:
        offset = zero - center
        cosine, sine = np.cos(angle), np.sin(angle)
        x, y = cosine * offset[0] - sine * offset[1], sine * offset[0] + cosine * offset[1]
        return np.stack([center[0] + x, center[1] + y, np.zeros_like(angle)], axis=1)

    assert fit_knee_axis(path, -1.0, 0.0) == pytest.approx((*center, 0.0), abs=1e-6)


def test_coupling_holds_while_the_leg_swings(documents: Path) -> None:
    """RK4 at 1 ms under changing excitations: stable, and the tibia within .1 mm of where its polynomials put it."""
    leg = OsimLeg(read_osim(documents / "uneven.osim"), "right")
    low, high = leg.model.coordinates["knee_angle_r"].low, leg.model.coordinates["knee_angle_r"].high
    motion = fit_knee_motion(leg.knee_path, low, high)
    m = leg8_from_osim(documents / "uneven.osim", base="fixed", moving_knee=True).compile()
    assert names(m) == ["hip", *KNEE_SLIDES, "knee", "ankle"]
    assert m.opt.timestep == 0.001
    d, rng = mujoco.MjData(m), np.random.default_rng(3)
    place, speed = [], 0.0
    for step in range(1500):
        if step % 150 == 0:
            d.ctrl[:] = rng.uniform(0, 0.5, 8) * (rng.random(8) < 0.5)
        mujoco.mj_step(m, d)
        x, y, up, forward = (d.joint(name).qpos[0] for name in KNEE_SLIDES)
        wanted = motion.path(d.joint("knee").qpos) - np.asarray(motion.place[:2])
        place.append(np.hypot(x + forward - wanted[0, 0], y + up - wanted[0, 1]))
        speed = max(speed, abs(d.joint("knee").qvel[0]))
    assert not d.warning.number.any()
    assert speed > 5.0
    assert max(place) < 1e-4


# Bad input


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (
            lambda r: rename(r, "Millard2012EquilibriumMuscle", "vasti_r", "vas_int_r"),
            ("no muscles vasti_r", "hamstrings_r"),
        ),
        (lambda r: rename(r, "Coordinate", "knee_angle_r", "knee"), ("knee",)),
        (lambda r: rename(r, "Body", "toes_r", "toe_r"), ("no bodies toes_r",)),
        (lambda r: axis_to(r, "1 0 0"), ("joint knee_r", "planar")),
        (lambda r: put_mass(r, "0"), ("femur_r", "mass is 0")),
        (lambda r: put_inertia(r, "0.1 0.1 0.5 0 0 0"), ("femur_r", "moments of inertia")),
        (lambda r: retype(r, "hip_r", "BallJoint"), ("hip_r", "BallJoint")),
        (lambda r: long_tendon(r), ("soleus_r", "tendon slack length")),
    ],
)
def test_legs_that_leg8_cannot_follow(tmp_path: Path, edit: object, words: tuple[str, ...]) -> None:
    path = write_osim(tmp_path / "bad.osim", edit=edit)  # type: ignore[arg-type]
    with pytest.raises(ModelError) as raised:
        leg8_from_osim(path)
    message = str(raised.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    for word in words:
        assert word in message


def find(root: ET.Element, tag: str, name: str) -> ET.Element:
    element = root.find(f".//{tag}[@name='{name}']")
    assert element is not None
    return element


def rename(root: ET.Element, tag: str, old: str, new: str) -> None:
    find(root, tag, old).set("name", new)


def retype(root: ET.Element, name: str, tag: str) -> None:
    find(root, "PinJoint", name).tag = tag


def put(element: ET.Element | None, text: str) -> None:
    assert element is not None
    element.text = text


def axis_to(root: ET.Element, text: str) -> None:
    put(find(root, "CustomJoint", "knee_r").find("SpatialTransform/TransformAxis[@name='rotation1']/axis"), text)


def put_mass(root: ET.Element, text: str) -> None:
    put(find(root, "Body", "femur_r").find("mass"), text)


def put_inertia(root: ET.Element, text: str) -> None:
    put(find(root, "Body", "femur_r").find("inertia"), text)


def long_tendon(root: ET.Element) -> None:
    put(find(root, "Millard2012EquilibriumMuscle", "soleus_r").find("tendon_slack_length"), "0.9")


def test_missing_side_and_wrong_words(tmp_path: Path) -> None:
    path = write_osim(tmp_path / "right.osim", sides="r")
    with pytest.raises(ModelError, match=r"no bodies femur_l, tibia_l, talus_l, calcn_l, toes_l"):
        leg8_from_osim(path, side="left")
    with pytest.raises(SettingsError, match="side is 'both'"):
        leg8_from_osim(path, side="both")
    with pytest.raises(SettingsError, match="base is 'free'"):
        leg8_from_osim(path, base="free")


@pytest.mark.usefixtures("unfitted")
def test_wrapping_objects_are_named(tmp_path: Path) -> None:
    def edit(root: ET.Element) -> None:
        path = find(root, "Millard2012EquilibriumMuscle", "glut_max_r")[0]
        wraps = ET.SubElement(ET.SubElement(path, "PathWrapSet"), "objects")
        ET.SubElement(ET.SubElement(wraps, "PathWrap"), "wrap_object").text = "Gmax_at_pelvis"

    with pytest.warns(MjhcmcWarning, match="glut_max_r wraps over Gmax_at_pelvis"):
        leg8_from_osim(write_osim(tmp_path / "own.osim", edit=edit))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        leg8_from_osim(write_osim(tmp_path / "own.osim"))


# The walking trial


@pytest.fixture(scope="module")
def script() -> ModuleType:
    if not WALK.is_dir():
        pytest.skip("the walking trial is not beside the checkout")
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        spec = importlib.util.spec_from_file_location("walk_geometry", ROOT / "benchmarks" / "walk_geometry.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(ROOT / "benchmarks"))
    return module


@pytest.mark.parametrize(("moving_knee", "limits"), [(False, (3.0, 2.0, 1.0)), (True, (1.0, 1.0, 0.5))])
def test_walking_moments(script: ModuleType, moving_knee: bool, limits: tuple[float, float, float]) -> None:
    error = script.moment_error(WALK, moving_knee)
    assert (error * 100 < limits).all(), error


@pytest.mark.parametrize("moving_knee", [False, True])
def test_walking_lengths_and_arms(script: ModuleType, moving_knee: bool) -> None:
    length, arm = script.path_error(WALK, moving_knee)
    assert length.max() < 0.001
    assert arm.max() < 0.0025

"""Reading .osim files: both structures of the document, what is in them, and what is wrong with bad ones."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from osim_documents import SOURCE, write_osim

from mjhcmc.errors import ModelError
from mjhcmc.io.osim import read_osim
from mjhcmc.io.osim_functions import CubicSpline, PiecewiseLinear, Polynomial, Scaled
from mjhcmc.leg8 import JOINTS, MUSCLES
from mjhcmc.leg8.agreement import read_paths
from mjhcmc.leg8.osim_leg import OsimLeg

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(__file__).parent / "data"
SHARED = ROOT.parent / "shared"


@pytest.mark.parametrize("version", [20303, 30000, 40000, 40600])
def test_all_versions_give_the_same_model(tmp_path: Path, version: int) -> None:
    model = read_osim(write_osim(tmp_path / "own.osim", version=version))
    assert model.version == version
    parts = ("femur", "tibia", "talus", "calcn", "toes")
    assert model.body_names == {"pelvis", *(f"{part}_{side}" for part in parts for side in "rl")}
    assert model.total_mass == pytest.approx(
        sum(body["mass"] * (1 if name == "pelvis" else 2) for name, body in SOURCE["bodies"].items())
    )
    assert model.gravity == (0.0, -9.80665, 0.0)
    femur = model.bodies["femur_r"]
    assert (femur.mass, femur.mass_center) == (9.3014, (0.0, -0.17, 0.0))
    assert femur.inertia == (0.1339, 0.0351, 0.1412, 0.0, 0.0, 0.0)
    hip, knee = model.joints["femur_l"], model.joints["tibia_r"]
    assert (hip.kind, hip.parent, hip.parent_pos) == ("PinJoint", "pelvis", (-0.0707, -0.0661, -0.0835))
    assert list(knee.coordinates) == ["knee_angle_r"]
    assert np.degrees([knee.coordinates["knee_angle_r"].low, knee.coordinates["knee_angle_r"].high]) == pytest.approx(
        [-120, 10]
    )
    assert model.coordinates["pelvis_ty"].default == 0.94
    assert set(model.muscles) == {f"{muscle}_{side}" for muscle in MUSCLES for side in "rl"}
    soleus = model.muscles["soleus_r"]
    own = SOURCE["muscles"]["soleus"]
    assert soleus.max_isometric_force == own["max_isometric_force"]
    assert soleus.optimal_fiber_length == own["optimal_fiber_length"]
    assert soleus.tendon_slack_length == own["tendon_slack_length"]
    assert soleus.pennation_angle == own["pennation_angle"]
    assert (soleus.activation_time, soleus.deactivation_time, soleus.fiber_damping) == (0.01, 0.04, 0.1)
    assert [point.body for point in model.muscles["rect_fem_r"].path] == ["pelvis", "femur_r", "tibia_r"]
    assert model.muscles["rect_fem_r"].path[1].active == ("knee_angle_r", -2.61799, -1.45997)
    assert set(model.muscles["rect_fem_r"].path[2].moves) == {0, 1, 2}


@pytest.mark.parametrize("version", [30000, 40000])
def test_lengths_and_moment_arms_are_opensims(tmp_path: Path, version: int) -> None:
    """The document's joints, splines, moving and conditional points against OpenSim's own table."""
    paths = read_paths(DATA / "leg8_paths.csv")
    leg = OsimLeg(read_osim(write_osim(tmp_path / "own.osim", version=version)), "right")
    length, arm = leg.lengths_and_arms(paths.qpos)
    np.testing.assert_allclose(length, paths.length, atol=2e-8)
    np.testing.assert_allclose(arm, paths.arm, atol=1e-6)


def test_walking_geometry_is_opensims() -> None:
    from mjhcmc.leg8.agreement import read_columns

    if not (SHARED / "walk").is_dir():
        pytest.skip("the walking trial is not beside the checkout")
    motion, own = (read_columns(SHARED / "walk" / name) for name in ("kinematics.csv", "muscle_geometry.csv"))
    qpos = np.stack([motion[f"q_{name}_r"] for name in ("hip_flexion", "knee_angle", "ankle_angle")], axis=1)
    leg = OsimLeg(read_osim(SHARED / "walk" / "subject01.osim"), "right")
    length, arm = leg.lengths_and_arms(qpos)
    for i, muscle in enumerate(MUSCLES):
        np.testing.assert_allclose(length[:, i], own[f"lmt_{muscle}_r"], atol=1e-6)
        for j, joint in enumerate(JOINTS):
            np.testing.assert_allclose(arm[:, i, j], own[f"r_{joint}_{muscle}_r"], atol=1e-6)


# Functions


def test_spline_is_opensims() -> None:
    """OpenSim reports the tibia at zero knee angle; natural ends would put it 2 micrometres lower."""
    knee = SOURCE["joints"]["knee"]
    for i, axis in enumerate("xy"):
        spline = CubicSpline(tuple(knee[axis]["knee_angle"]), tuple(knee[axis]["value"]))
        assert spline(np.zeros(1))[0] == pytest.approx(knee["offset_at_zero"][i], abs=1e-9)
        np.testing.assert_allclose(spline(np.asarray(spline.x)), spline.y, atol=1e-15)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-2, 2), min_size=4, max_size=4), st.integers(4, 9))
def test_spline_of_a_cubic_is_the_cubic(coefficients: list[float], count: int) -> None:
    """The ends take the third derivative of the outermost points, so that a cubic is met everywhere."""
    cubic, x = Polynomial(tuple(coefficients)), np.linspace(-1, 2, count) ** 3 / 3
    spline = CubicSpline(tuple(x), tuple(cubic(x)))
    inside = np.linspace(x[0], x[-1], 40)
    np.testing.assert_allclose(spline(inside), cubic(inside), atol=1e-9)
    ahead = x[-1] + np.array([0.0, 1.0, 2.0])
    assert np.diff(spline(ahead), 2)[0] == pytest.approx(0.0, abs=1e-9)  # straight beyond


def test_small_functions() -> None:
    assert Polynomial((2.0, 1.0, 3.0))(np.array([2.0]))[0] == 13.0
    assert CubicSpline((0.0, 2.0), (1.0, 5.0))(np.array([-1.0, 1.0, 3.0])) == pytest.approx([-1.0, 3.0, 7.0])
    line = PiecewiseLinear((0.0, 1.0, 2.0), (0.0, 1.0, 0.0))
    assert line(np.array([-1.0, 0.5, 1.5, 3.0])) == pytest.approx([-1.0, 0.5, 0.5, -1.0])
    assert Scaled(line, 3.0)(np.array([0.5]))[0] == pytest.approx(1.5)


# Muscles of other kinds


def with_defaults(root: ET.Element) -> None:
    default = ET.SubElement(ET.SubElement(root, "defaults"), "Thelen2003Muscle", name="default")
    for tag, text in (("activation_time_constant", "0.012"), ("max_contraction_velocity", "15")):
        ET.SubElement(default, tag).text = text
    own = root.find(".//Thelen2003Muscle[@name='soleus_r']")
    assert own is not None
    ET.SubElement(own, "max_contraction_velocity").text = "12"


def schutte(root: ET.Element) -> None:
    for muscle in root.iter("Schutte1993Muscle_Deprecated"):
        ET.SubElement(muscle, "time_scale").text = "0.1"


@pytest.mark.parametrize(
    ("kind", "times", "damping"),
    [
        ("Millard2012EquilibriumMuscle", (0.01, 0.04), 0.1),
        ("Thelen2003Muscle", (0.015, 0.05), 0.0),
        ("DeGrooteFregly2016Muscle", (0.015, 0.06), 0.0),
    ],
)
def test_what_is_left_out_is_opensims_default(
    tmp_path: Path, kind: str, times: tuple[float, float], damping: float
) -> None:
    muscle = read_osim(write_osim(tmp_path / "own.osim", kind=kind)).muscles["vasti_r"]
    assert muscle.kind == kind
    assert (muscle.activation_time, muscle.deactivation_time) == times
    assert muscle.fiber_damping == damping
    assert muscle.max_contraction_velocity == 10.0


def test_the_documents_own_defaults_come_first(tmp_path: Path) -> None:
    model = read_osim(write_osim(tmp_path / "own.osim", kind="Thelen2003Muscle", version=30000, edit=with_defaults))
    assert model.muscles["vasti_r"].activation_time == 0.012
    assert model.muscles["vasti_r"].max_contraction_velocity == 15.0
    assert model.muscles["soleus_r"].max_contraction_velocity == 12.0
    old = read_osim(write_osim(tmp_path / "old.osim", kind="Schutte1993Muscle_Deprecated", edit=schutte))
    assert old.muscles["soleus_r"].deactivation_time == pytest.approx(0.1 / 1.459854)
    assert old.muscles["soleus_r"].activation_time < 0.015


# Bad input


def muscle_of(root: ET.Element, name: str = "soleus_r") -> ET.Element:
    element = root.find(f".//Millard2012EquilibriumMuscle[@name='{name}']")
    assert element is not None
    return element


def put(element: ET.Element | None, text: str) -> None:
    assert element is not None
    element.text = text


def drop(root: ET.Element, path: str, tag: str) -> None:
    parent = root.find(path)
    assert parent is not None
    child = parent.find(tag)
    assert child is not None
    parent.remove(child)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda r: put(muscle_of(r).find("max_isometric_force"), "-5"), ("soleus_r", "max_isometric_force is -5")),
        (lambda r: put(muscle_of(r).find("optimal_fiber_length"), "0"), ("soleus_r", "optimal_fiber_length is 0")),
        (lambda r: put(muscle_of(r).find("tendon_slack_length"), "NaN"), ("soleus_r", "tendon_slack_length is 'NaN'")),
        (lambda r: put(muscle_of(r).find("pennation_angle_at_optimal"), "25"), ("soleus_r", "pennation", "radians")),
        (lambda r: muscle_of(r).remove(muscle_of(r)[1]), ("soleus_r", "no max_isometric_force")),
        (lambda r: muscle_of(r).remove(muscle_of(r)[0]), ("soleus_r", "no GeometryPath")),
        (lambda r: put(r.find(".//Body[@name='femur_r']/mass"), "-1"), ("Body femur_r", "mass is -1")),
        (lambda r: put(r.find(".//Body[@name='femur_r']/mass"), "1 2"), ("Body femur_r", "one number")),
        (lambda r: drop(r, ".//Body[@name='tibia_l']", "inertia"), ("Body tibia_l", "no inertia_xx")),
        (lambda r: put(r.find(".//PathPoint/location"), "0 x 0"), ("PathPoint", "location is '0 x 0'", "3 numbers")),
        (lambda r: put(r.find(".//SimmSpline/x"), "0 1"), ("SimmSpline", "2 x and 12 y")),
        (lambda r: r.find(".//Body[@name='toes_r']").set("name", "calcn_r"), ("'calcn_r' is there twice",)),
        (lambda r: r.remove(r[0]), ("holds no Model",)),
        (lambda r: drop(r, "Model", "BodySet"), ("has no body",)),
    ],
)
def test_bad_documents_are_named(tmp_path: Path, edit: object, words: tuple[str, ...]) -> None:
    path = write_osim(tmp_path / "bad.osim", edit=edit)  # type: ignore[arg-type]
    with pytest.raises(ModelError) as raised:
        read_osim(path)
    message = str(raised.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"", "not XML"),
        (b"time\tq\n0\t1\n", "not XML"),
        (b"<OpenSimDocument Version='40000'><Model>", "not XML"),
        (b"<mujoco/>", "not OpenSimDocument"),
        (b"<OpenSimDocument Version='new'/>", "version 'new'"),
        (b"\x00\xff\xfe garbage", "not XML"),
        (
            b"<!DOCTYPE x [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]><OpenSimDocument Version='1'>&b;</OpenSimDocument>",
            "document type",
        ),
        (
            "<!DOCTYPE x [<!ENTITY a 'aaaa'>]><OpenSimDocument Version='1'>&a;</OpenSimDocument>".encode("utf-16"),
            "document type",
        ),
        (b"<?xml version='1.0' encoding='klingon'?><OpenSimDocument Version='1'/>", "not XML"),
    ],
)
def test_files_that_are_no_documents(tmp_path: Path, content: bytes, word: str) -> None:
    path = tmp_path / "bad.osim"
    path.write_bytes(content)
    with pytest.raises(ModelError, match=word) as raised:
        read_osim(path)
    assert str(raised.value).startswith(str(path))
    assert "\n" not in str(raised.value)


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no such file"):
        read_osim(tmp_path / "absent.osim")
    with pytest.raises(ModelError, match="folder"):
        read_osim(tmp_path)


def test_unknown_function_matters_only_where_it_is_asked(tmp_path: Path) -> None:
    def edit(root: ET.Element) -> None:
        for axis in root.iter("TransformAxis"):
            if axis.get("name") == "translation1" and "knee" in (axis.findtext("coordinates") or ""):
                axis.remove(axis[-1])
                ET.SubElement(axis, "GCVSpline", name="function")

    path = write_osim(tmp_path / "own.osim", edit=edit)
    model = read_osim(path)
    assert len(model.body_names) == 11
    with pytest.raises(ModelError, match="GCVSpline is not known"):
        OsimLeg(model, "right")

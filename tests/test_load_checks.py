"""Do loads fit a movement: closed cases, and the measured walk with its own table as oracle."""

import dataclasses

import numpy as np
import pytest
from load_tools import (
    BODIES,
    constant,
    leg,
    motion,
    posed,
)
from numpy.testing import assert_allclose

import mjhcmc
from mjhcmc import MjhcmcWarning, Motion
from mjhcmc.external_loads import ExternalLoads, suspicious
from mjhcmc.io.opensim import read_table, write_table

__all__ = ["leg"]


STANDING = [0, -0.02, 0, 0, 0, 0]


def under_foot(model, qpos, **changed):
    d = posed(model, qpos)
    return constant(point=d.xpos[model.mj_model.body("foot").id] + [0.05, 0, -0.06], labels=("right",), **changed)


def test_sound_loads_raise_no_doubt(leg):
    assert suspicious(under_foot(leg, STANDING), leg, motion(0, 1, qpos=STANDING)) == []
    assert suspicious(constant(force=(0, 0, 5), point=(9, 9, 9)), leg, motion(0, 1)) == []  # too small to count
    assert suspicious(constant(time=(2.0, 3.0), point=(9, 9, 9)), leg, motion(0, 1)) == []  # never together


def test_a_foot_in_the_air_that_carries_load(leg):
    lifted = [0, 0.4, 0, 0, 0, 0]
    (message,) = suspicious(under_foot(leg, STANDING), leg, motion(0, 1, qpos=lifted))
    assert "plates: load 'right' on body 'foot': at 0 s 700 N act at a point" in message
    assert "in the air: check the frame and units, or that the motion and the loads share a clock" in message


def test_a_point_elsewhere(leg):
    aside = [0.8, -0.02, 0, 0, 0, 0]
    (message,) = suspicious(under_foot(leg, STANDING), leg, motion(0, 1, qpos=aside))
    assert "m from the body: check the frame" in message


def test_the_distance_is_that_in_the_pose(leg):
    """A kneeling leg: the foot is where the knee takes it."""
    kneeling = [0, -0.02, 0, 0, -1.5, 0]
    assert suspicious(under_foot(leg, kneeling), leg, motion(0, 1, qpos=kneeling)) == []
    assert len(suspicious(under_foot(leg, STANDING), leg, motion(0, 1, qpos=kneeling))) == 1


@pytest.mark.parametrize(
    ("force", "what"), [((0, 0, -700), "pulls the body down"), ((0, 700, 100), "pushes the body more aside than up")]
)
def test_a_force_that_points_the_wrong_way(leg, force, what):
    (message,) = suspicious(under_foot(leg, STANDING, force=force), leg, motion(0, 1, qpos=STANDING))
    assert what in message
    assert message.endswith("check the frame and axes of the loads")


def test_a_pull_in_a_bodys_own_frame_may_point_anywhere(leg):
    loads = constant(force=(0, 700, 0), force_frame=("foot",), point_frame=("foot",))
    assert suspicious(loads, leg, motion(0, 1, qpos=STANDING)) == []


def test_a_force_in_a_bodys_frame_is_looked_at_in_the_world(leg):
    """The leg lies forward, knee straight: the foot's z axis is the world's horizontal."""
    lying = [0, -0.02, 0, 1.5, 0, 0]
    (message,) = suspicious(under_foot(leg, lying, force_frame=("foot",)), leg, motion(0, 1, qpos=lying))
    assert "pushes the body more aside than up" in message
    assert suspicious(under_foot(leg, STANDING, force_frame=("foot",)), leg, motion(0, 1, qpos=STANDING)) == []


def test_a_ground_reaction_in_kilonewtons(leg):
    (message,) = suspicious(under_foot(leg, STANDING, force=(0, 0, 0.8)), leg, motion(0, 1, qpos=STANDING))
    assert message.startswith("plates: the largest force is 0.8 N, 0.18 % of the modelled bodies' weight of 433.6 N")
    assert "in kN" in message
    for push, frames in (((0, 0, 10), {}), ((0, 0, 0), {}), ((0, 0, 0.8), {"force_frame": ("foot",)})):
        loads = under_foot(leg, STANDING, force=push, **frames)
        assert suspicious(loads, leg, motion(0, 1, qpos=STANDING)) == []


def test_a_flight_phase_of_a_sound_file_is_no_reason_to_doubt(leg):
    loads = under_foot(leg, STANDING, time=(0.0, 1.0, 2.0))
    force = np.array([0.0, 0.0, 700.0])[:, None, None] * np.array([0, 0, 1.0])
    assert suspicious(dataclasses.replace(loads, force=force), leg, motion(0, 1, qpos=STANDING)) == []


@pytest.fixture(scope="module")
def walk(walk_folder, leg):
    """The right foot's loads, the motion of pelvis and leg, and the plain columns of the same forces."""
    loads = ExternalLoads.from_file(walk_folder / "subject01_walk_grf.xml", leg, osim=walk_folder / "subject01.osim")
    rows = np.genfromtxt(walk_folder / "kinematics.csv", delimiter=",", names=True)
    names = ("pelvis_tx", "pelvis_ty", "pelvis_tilt", "hip_flexion_r", "knee_angle_r", "ankle_angle_r")
    qpos = np.column_stack([rows[f"q_{name}"] for name in names]) - [0, 1, 0, 0, 0, 0]
    return loads, Motion(rows["time"], qpos, "walk"), np.genfromtxt(walk_folder / "grf.csv", delimiter=",", names=True)


def test_the_walks_ground_reaction_is_the_plain_table_turned(walk):
    loads, motion, plain = walk
    assert loads.body == ("foot",)
    assert [notice for notice in loads.notices if "calcn_l left out: subject01.osim has that body" in notice]
    at = loads.sample(plain["time"])
    for got, letter in ((at.force, "F"), (at.point, "P"), (at.torque, "T")):
        x, y, z = (plain[f"{letter}{axis}_right"] for axis in "xyz")
        assert_allclose(got[:, 0], np.column_stack([x, -z, y]), rtol=1e-7, atol=1e-6)
    loads.check_covers(motion)
    peak = loads.sample(np.linspace(0.6, 1.9, 1301)).force[:, 0, 2].max()
    assert 700 < peak < 900  # N, up: one body weight and some


def test_the_walks_plain_table_with_a_map_is_the_same(walk, walk_folder, leg):
    loads, _, _ = walk
    columns = {
        kind: [f"{letter}{axis}_right" for axis in "xyz"]
        for kind, letter in (("force", "F"), ("point", "P"), ("torque", "T"))
    }
    plain = ExternalLoads.from_file(walk_folder / "grf.csv", leg, column_map={"calcn_r": columns})
    for mine, other in zip(plain.sample(plain.time), loads.sample(plain.time), strict=True):
        assert_allclose(mine, other, rtol=1e-7, atol=1e-6)


def test_the_walks_loads_fit_its_motion_and_only_its(walk, walk_folder, leg):
    loads, motion, _ = walk
    assert suspicious(loads, leg, motion) == []
    (in_kilonewtons,) = suspicious(dataclasses.replace(loads, force=loads.force / 1000), leg, motion)
    assert "in kN" in in_kilonewtons
    late = dataclasses.replace(loads, time=loads.time + 0.4)
    assert any("share a clock" in message for message in suspicious(late, leg, motion))
    path = walk_folder / "subject01_walk_grf.xml"
    unturned = ExternalLoads.from_file(path, leg, osim=BODIES, rotation=np.eye(3))
    assert any("more aside than up" in message for message in suspicious(unturned, leg, motion))
    other_foot = ExternalLoads.from_file(
        walk_folder / "subject01_walk_grf.mot",
        leg,
        column_map={"foot": {"force": "1_ground_force_v", "point": "1_ground_force_p"}},
    )
    assert any("act at a point" in message for message in suspicious(other_foot, leg, motion))


def test_the_walk_in_mm_is_warned_of(walk_folder, leg, tmp_path):
    table = read_table(walk_folder / "subject01_walk_grf.mot")
    scale = np.array([1000.0 if "_p" in name else 1.0 for name in table.columns])
    write_table(tmp_path / "mm.mot", table.columns, table.time, table.values * scale, name="mm", in_degrees=False)
    with pytest.warns(MjhcmcWarning, match=r"'ground_force_p[xyz]' of load 'right' .*looks like mm"):
        ExternalLoads.from_file(
            walk_folder / "subject01_walk_grf.xml", leg, data=tmp_path / "mm.mot", osim=walk_folder / "subject01.osim"
        )


def test_a_batch_may_hold_movements_without_loads(two_joints):
    still = mjhcmc.Motion.cosine(two_joints, amplitudes={"elbow": 0.1}, period=0.2, cycles=1)
    push = constant(body="lower", force=(0.5, 0, 0), point_frame=("lower",), force_frame=("lower",))
    batch = mjhcmc.hcmc_batch(two_joints, [still, still], loads=[push, None])
    for solution, loads in zip(batch, (push, None), strict=True):
        alone = mjhcmc.hcmc(two_joints, still, loads=loads)
        np.testing.assert_array_equal(solution.excitation, alone.excitation)
    assert np.abs(batch[0].excitation - batch[1].excitation).max() > 1e-4
    with pytest.raises(mjhcmc.SettingsError, match=r"loads\[1\] must be an ExternalLoads or None; got str"):
        mjhcmc.hcmc_batch(two_joints, [still, still], loads=[push, "grf.xml"])
    with pytest.raises(mjhcmc.SettingsError, match=r"motions\[1\] must be a Motion; got NoneType"):
        mjhcmc.hcmc_batch(two_joints, [still, None])

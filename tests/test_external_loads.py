"""External loads over time, and the wrenches that they make."""

import dataclasses
import timeit

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from load_tools import (
    RNG,
    TIME,
    TO_Z_UP,
    VALUES,
    build,
    constant,
    files,
    leg,
    motion,
    posed,
    wrenches_at,
)
from numpy.testing import assert_allclose, assert_array_equal

from mjhcmc import MotionError
from mjhcmc.external_loads import ExternalLoads, wrenches

__all__ = ["files", "leg"]


def test_loads_run_straight_between_rows(files, leg):
    loads = ExternalLoads.from_file(files(), leg)
    times = np.sort(RNG.uniform(0, 0.4, 50))
    at = loads.sample(times)
    for got, first in ((at.force, 0), (at.point, 3), (at.torque, 6)):
        columns = [np.interp(times, TIME, VALUES[:, first + i]) for i in range(3)]
        assert_allclose(got[:, 0], np.column_stack(columns) @ TO_Z_UP.T, atol=1e-12)
    assert_allclose(loads.sample(TIME).force, loads.force, rtol=1e-14)
    assert loads.sample(0.1).force.shape == (1, 1, 3)
    assert_array_equal(loads.sample(0.4 + 5e-10).force, loads.sample(0.4).force)


@pytest.mark.parametrize("time", [-1e-6, 0.400001, np.nan, np.inf])
def test_times_outside_are_refused(files, leg, time):
    loads = ExternalLoads.from_file(files(), leg)
    with pytest.raises(MotionError, match=r"lies outside the loads, 0 \.\. 0\.4 s"):
        loads.sample([0.1, time])


def test_loads_must_cover_the_motion():
    loads = constant(time=(0.5, 1.5))
    loads.check_covers(motion(0.5, 1.5))
    loads.check_covers(motion(0.7, 1.5))
    with pytest.raises(
        MotionError,
        match=r"plates: the loads last from 0\.5 to 1\.5 s, motion 'walk' from 0 to 1 s: .* within 0\.5 \.\. 1 s",
    ):
        loads.check_covers(motion(0, 1))
    with pytest.raises(MotionError, match="on its clock"):
        loads.check_covers(motion(2, 3))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"body": ()}, "no load"),
        ({"time": [0.0, 0.0]}, r"row 1 \(from 0\): time 0 s follows 0 s"),
        ({"time": [0.0, 1.0, 2.0]}, r"shape \(3,\)"),
        ({"point": np.full((2, 1, 3), np.nan)}, "row 0 .*point of load 'foot' is not finite"),
        ({"force_frame": ("a", "b")}, "2 force_frame for 1 loads"),
    ],
)
def test_loads_made_by_hand_are_checked(changed, message):
    given = {field.name: getattr(constant(), field.name) for field in dataclasses.fields(ExternalLoads)}
    if "body" in changed:
        given |= {"labels": (), "force_frame": (), "point_frame": ()}
    with pytest.raises(MotionError, match=message):
        ExternalLoads(**(given | changed))


def test_loads_are_frozen():
    with pytest.raises(ValueError, match="read-only"):
        constant().force[:] = 0


def test_wrench_in_closed_form(leg):
    """A force under the hanging foot: its lever is the horizontal distance to the centre of mass."""
    d = posed(leg, np.zeros(6))
    com = d.xipos[leg.mj_model.body("foot").id]
    loads = constant(force=(10, 0, 700), point=com + np.array([0.2, 0.1, -0.05]), torque=(1, 2, 3))
    expected = [10, 0, 700, 0.1 * 700 + 1, -0.05 * 10 - 0.2 * 700 + 2, -0.1 * 10 + 3]
    assert_allclose(wrenches_at(loads, leg, d, 0.5)[0, 0], expected, atol=1e-10)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_generalized_forces_are_those_of_virtual_work(seed):
    """Against mj_applyFT and mj_jac at the point, with force and point in any frames, in several poses at once."""
    model = MODEL
    m = model.mj_model
    rng = np.random.default_rng(seed)
    bodies = ["pelvis", "thigh", "shank", "foot"]
    k, n = 3, 4
    loads = ExternalLoads(
        "random",
        np.array([0.0, 1.0]),
        tuple(rng.choice(bodies, k)),
        *(rng.normal(size=(2, k, 3)) for _ in range(3)),
        force_frame=tuple(rng.choice(["", *bodies], k)),
        point_frame=tuple(rng.choice(["", *bodies], k)),
    )
    times = rng.uniform(0, 1, n)
    data = [posed(model, rng.normal(size=m.nq)) for _ in range(n)]
    body_ids, force_ids, point_ids = loads.ids(model)
    at = loads.sample(times)
    poses = (np.array([getattr(d, key) for d in data]) for key in ("xpos", "xmat", "xipos"))
    made = wrenches(at, body_ids, force_ids, point_ids, *poses)
    for i, d in enumerate(data):
        for j in range(k):
            R = d.xmat[force_ids[j]].reshape(3, 3)
            point = d.xpos[point_ids[j]] + d.xmat[point_ids[j]].reshape(3, 3) @ at.point[i, j]
            expected, by_jacobian, got = np.zeros((3, m.nv))
            mujoco.mj_applyFT(m, d, R @ at.force[i, j], R @ at.torque[i, j], point, body_ids[j], expected)
            jacp, jacr = np.zeros((2, 3, m.nv))
            mujoco.mj_jac(m, d, jacp, jacr, point, body_ids[j])
            by_jacobian += jacp.T @ R @ at.force[i, j] + jacr.T @ R @ at.torque[i, j]
            com = d.xipos[body_ids[j]]
            mujoco.mj_applyFT(m, d, made[i, j, :3], made[i, j, 3:], com, body_ids[j], got)
            assert_allclose(got, expected, atol=1e-12)
            assert_allclose(got, by_jacobian, atol=1e-12)


def test_mujoco_takes_the_wrench_as_it_is(leg):
    """Through xfrc_applied, where the simulation takes it."""
    d = posed(leg, [0.1, 0.2, 0.3, -0.4, 0.5, -0.6])
    loads = constant(point=(0.1, 0.05, 0.1), torque=(3, 4, 5))
    before, expected = d.qfrc_smooth.copy(), np.zeros(leg.nv)
    foot = leg.mj_model.body("foot").id
    mujoco.mj_applyFT(
        leg.mj_model, d, *(np.array(v, float) for v in [(0, 0, 700), (3, 4, 5), (0.1, 0.05, 0.1)]), foot, expected
    )
    d.xfrc_applied[foot] = wrenches_at(loads, leg, d, 0.5)[0, 0]
    mujoco.mj_forward(leg.mj_model, d)
    assert_allclose(d.qfrc_smooth - before, expected, atol=1e-9)


MODEL = build(turn='euler=".2 .3 -.4"')


@pytest.mark.parametrize("frame", ["", "shank"])
def test_wrenches_are_quick(leg, frame):
    """Called at every stage of every step."""
    loads = constant(force_frame=(frame,), point_frame=(frame,))
    d = posed(leg, np.zeros(6))
    ids, at = loads.ids(leg), loads.sample(0.5)
    poses = [np.array(array)[None] for array in (d.xpos, d.xmat, d.xipos)]
    took = min(timeit.repeat(lambda: wrenches(at, *ids, *poses), number=200, repeat=20)) / 200
    assert took < 30e-6
    assert min(timeit.repeat(lambda: loads.sample(0.5), number=200, repeat=20)) / 200 < 30e-6

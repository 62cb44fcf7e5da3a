"""A walk from end to end: a subject's leg under ground reactions, its pelvis moving; a made-up one runs anywhere."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

import mjhcmc
from mjhcmc.activity import agreement
from mjhcmc.external_loads import ExternalLoads
from mjhcmc.leg8 import JOINTS, MUSCLES, leg8_from_osim
from mjhcmc.leg8.agreement import read_columns
from mjhcmc.leg8.table import ROOT_JOINTS
from mjhcmc.opensim_reference import read_run
from mjhcmc.solution import WindowStatus
from mjhcmc.verify import judge, replay_windows

COORDINATES = {"hip": "hip_flexion_r", "knee": "knee_angle_r", "ankle": "ankle_angle_r"}
MOTION, LOADS, SUBJECT = "subject_adjusted_Kinematics_q.sto", "subject01_walk_grf.xml", "subject01.osim"
FLOOR = 0.02
OPENSIM = Path(__file__).parent / "data" / "walk" / "opensim_cmc.csv"


def walk(folder: Path, *, side: str = "right", moving_knee: bool = False, method=mjhcmc.hcmc, dt: float = 0.005):
    model = mjhcmc.MuscleModel.load(leg8_from_osim(folder / SUBJECT, side=side, moving_knee=moving_knee))
    motion = mjhcmc.Motion.from_file(folder / MOTION, model, start=0.6, end=1.9)
    loads = ExternalLoads.from_file(folder / LOADS, model, osim=folder / SUBJECT)
    assert [notice.split()[1] for notice in loads.notices] == ["'left'" if side == "right" else "'right'"]
    return method(model, motion, dt=dt, loads=loads, min_activation=FLOOR)


@pytest.fixture(scope="module")
def fixed(walk_folder):
    return walk(walk_folder)


@pytest.fixture(scope="module")
def moving(walk_folder):
    return walk(walk_folder, moving_knee=True)


@pytest.fixture(params=["fixed", "moving"])
def solution(request):
    return request.getfixturevalue(request.param)


def head(solution, n):
    """The first n windows of a solution."""
    arrays = {field.name: getattr(solution, field.name) for field in dataclasses.fields(solution)}
    lengths = {solution.n_window: n, solution.n_window + 1: n + 1}
    cut = {
        name: value[: lengths[len(value)]]
        for name, value in arrays.items()
        if isinstance(value, np.ndarray) and len(value) in lengths
    }
    return dataclasses.replace(solution, **cut)


def of(solution, values, names=JOINTS):
    """Columns of some degrees of freedom."""
    return values[..., [solution.dof_names.index(name) for name in names]]


# The measured walk


@pytest.mark.parametrize(("knee", "most"), [("fixed", (3, 2, 1)), ("moving", (1, 1, 0.5))])
def test_net_joint_moments_are_those_of_opensims_inverse_dynamics(request, walk_folder, knee, most):
    """Root mean squares in % of the peak, over all nodes of the trial."""
    solution, table = request.getfixturevalue(knee), read_columns(walk_folder / "kinematics.csv")
    np.testing.assert_allclose(solution.time, table["time"], atol=1e-9)
    theirs = np.stack([table[f"tau_{COORDINATES[joint]}"] for joint in JOINTS], axis=1)
    error = of(solution, solution.net_joint_moment) - theirs
    share = 100 * np.sqrt((error**2).mean(axis=0)) / np.abs(theirs).max(axis=0)
    assert (share <= most).all(), share


def test_leg_follows_without_help_and_verdict_holds(solution, coarse_replay):
    assert np.rad2deg(np.abs(of(solution, solution.tracking_error)).max()) < 0.05
    share = np.abs(of(solution, solution.reserve)).max(axis=0) / of(solution, solution.peak_moment)
    assert share.max() < 0.01
    assert (solution.status == WindowStatus.OK).all()
    assert solution.verdict.passed
    assert not solution.verdict.findings
    assert solution.activation.min() > FLOOR - 1e-9
    assert 0.2 < solution.activation.max() < 1


def test_windows_played_again_end_where_they_ended(solution):
    """With the same physics step to rounding; with a tenth of it, which takes long, by the physics step's own error."""
    same = replay_windows(solution, solution.settings["physics_dt"])
    assert np.abs(same - solution.qpos).max() < 1e-12
    part = solution if len(solution.dof_names) == 6 else head(solution, 60)  # into the stance, of the moving knee
    verdict = judge(part)
    assert np.rad2deg(max(of(solution, np.array(verdict.replay_window_max_error)))) < 1e-3
    assert verdict.replay_max_error is None  # open loop under a measured reaction falls: not reported


def test_pelvis_follows_exactly_and_its_residual_is_told(solution, walk_folder):
    table = read_columns(walk_folder / "kinematics.csv")
    measured = np.stack([table[f"q_{name}"] for name in ROOT_JOINTS], axis=1)
    error = np.abs(of(solution, solution.qpos, ROOT_JOINTS) - measured).max(axis=0)
    turns = of(solution, solution.dof_is_rotation, ROOT_JOINTS)
    assert error[~turns].max() < 1e-5
    assert np.rad2deg(error[turns]).max() < 1e-3
    assert [solution.roles[solution.dof_names.index(name)] for name in ROOT_JOINTS] == ["prescribed"] * 3
    residual = of(solution, solution.residual, ROOT_JOINTS)
    assert (np.abs(residual).max(axis=0) > 10).all()
    assert not of(solution, solution.residual).any()


def test_lengths_and_moment_arms_along_the_walk(solution, walk_folder):
    """Root mean squares against OpenSim's, of the model as it was driven; its own lengths give the arms."""
    theirs = read_columns(walk_folder / "muscle_geometry.csv")
    length = np.stack([theirs[f"lmt_{muscle}_r"] for muscle in MUSCLES], axis=1)
    arm = np.stack([[theirs[f"r_{joint}_{muscle}_r"] for joint in JOINTS] for muscle in MUSCLES]).transpose(2, 0, 1)
    m = solution.model.mj_model
    d, tendons = mujoco.MjData(m), [m.actuator(muscle).trnid[0] for muscle in MUSCLES]

    def lengths(qpos):
        d.qpos[:] = qpos
        for i in range(m.neq):  # joints that follow the knee
            x = d.qpos[m.jnt_qposadr[m.eq_obj2id[i]]]
            d.qpos[m.jnt_qposadr[m.eq_obj1id[i]]] = np.polynomial.Polynomial(m.eq_data[i, :5])(x)
        mujoco.mj_fwdPosition(m, d)
        return d.ten_length[tendons].copy()

    rows, step = np.arange(0, len(solution.time), 5), 1e-5
    ours = np.array([lengths(solution.qpos[row]) for row in rows])
    error = np.sqrt(((ours - length[rows]) ** 2).mean(axis=0))
    assert error.max() < 0.005, error
    own = np.empty((len(rows), len(MUSCLES), len(JOINTS)))
    for j, joint in enumerate(JOINTS):
        way = step * np.eye(m.nq)[m.joint(joint).qposadr[0]]
        for i, row in enumerate(rows):
            above, below = lengths(solution.qpos[row] + way), lengths(solution.qpos[row] - way)
            own[i, :, j] = (below - above) / (2 * step)
    error = np.sqrt(((own - arm[rows]) ** 2).mean(axis=0))
    assert error.max() < 0.005, error


def test_either_leg_walks(walk_folder, coarse_replay):
    solution = walk(walk_folder, side="left", dt=0.01)
    assert solution.verdict.passed
    assert np.rad2deg(np.abs(solution.tracking_error).max()) < 0.05
    assert np.abs(of(solution, solution.external_load, ["pelvis_ty"])).max() > 700  # its own reaction


def test_mirrored_walk_is_that_of_the_other_leg(walk_folder, tmp_path):
    """Columns of left and right exchanged, forces mirrored: the left leg does what the right one did."""
    for name in (MOTION, LOADS, SUBJECT, "subject01_walk_grf.mot"):
        shutil.copy(walk_folder / name, tmp_path / name)
    swap = {"hip_flexion": "_", "knee_angle": "_", "ankle_angle": "_"}
    text = (tmp_path / MOTION).read_text(encoding="utf-8")
    for name in swap:
        text = (
            text.replace(f"{name}_r", f"{name}_x").replace(f"{name}_l", f"{name}_r").replace(f"{name}_x", f"{name}_l")
        )
    (tmp_path / MOTION).write_text(text, encoding="utf-8")
    text = (tmp_path / LOADS).read_text(encoding="utf-8")
    text = text.replace("calcn_r", "calcn_x").replace("calcn_l", "calcn_r").replace("calcn_x", "calcn_l")
    (tmp_path / LOADS).write_text(text.replace('"right"', '"x"').replace('"left"', '"right"').replace('"x"', '"left"'))
    lines = (tmp_path / "subject01_walk_grf.mot").read_text(encoding="utf-8").splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("time"))
    labels = lines[at].split()
    odd = [i for i, name in enumerate(labels) if name.endswith(("vz", "pz", "torque_x", "torque_y"))]
    assert len(odd) == 8
    for i in range(at + 1, len(lines)):
        cells = lines[i].split()
        for j in odd if cells else ():
            cells[j] = str(-float(cells[j]))
        lines[i] = "\t".join(cells)
    (tmp_path / "subject01_walk_grf.mot").write_text("\n".join(lines), encoding="utf-8")
    right, left = walk(walk_folder, dt=0.01), walk(tmp_path, side="left", dt=0.01)
    np.testing.assert_allclose(left.qpos, right.qpos, atol=1e-6)
    scale = np.abs(right.net_joint_moment).max(axis=0)
    assert np.abs((left.net_joint_moment - right.net_joint_moment) / scale).max() < 0.01
    assert np.abs(left.activation - right.activation).max() < 0.01


def test_other_methods_walk_too(walk_folder, fixed, coarse_replay):
    """CMC follows; static optimization finds nearly the same activations and falls, open loop: its verdict says so."""
    cmc = walk(walk_folder, method=mjhcmc.cmc, dt=0.01)
    assert cmc.verdict.passed
    assert np.rad2deg(np.abs(cmc.tracking_error).max()) < 1
    static = walk(walk_folder, method=mjhcmc.static_optimization, dt=0.01)
    assert not static.verdict.passed
    assert any("tracking RMS" in finding for finding in static.verdict.findings)
    for other in (cmc, static):
        assert np.abs(of(other, other.tracking_error, ROOT_JOINTS)).max() < 1e-5
        assert np.sqrt(((other.activation - fixed.activation[::2]) ** 2).mean()) < 0.03


def test_activations_are_like_opensims(walk_folder, fixed):
    """OpenSim's CMC on the whole model, with nine muscles on this leg and compliant tendons."""
    run = read_run(OPENSIM, fixed.model)
    assert run.muscle_names == MUSCLES
    assert run.time[[0, -1]].tolist() == pytest.approx([0.6, 1.9])
    found = agreement(fixed.time, fixed.activation, run.activity, FLOOR)
    assert np.median([r for r, _ in found.values()]) > 0.9
    for muscle in ("iliopsoas", "glut_max", "vasti", "gastroc", "tib_ant"):
        assert found[muscle][0] > 0.9, (muscle, found[muscle])
    assert max(rms for _, rms in found.values()) < 0.1


# A walk that is made up

DURATION = 0.8


@pytest.fixture(scope="module")
def stride():
    """leg8 on a pelvis that moves on and sways; heel to toe, the ground pushes for half of the stride."""
    model = mjhcmc.MuscleModel.load("leg8_gait")
    time = np.linspace(0, DURATION, 161)
    phase = 2 * np.pi * time / DURATION
    columns = {
        "pelvis_tx": 1.1 * time + 0.01 * np.sin(2 * phase),
        "pelvis_ty": 0.95 + 0.02 * np.cos(2 * phase),
        "pelvis_tilt": 0.04 * np.sin(phase),
        "hip": 0.1 + 0.35 * np.cos(phase),
        "knee": -0.35 + 0.25 * np.sin(phase),
        "ankle": 0.12 * np.sin(2 * phase),
    }
    motion = mjhcmc.Motion(time, np.stack([columns[name] for name in model.joint_names], axis=1), "stride")
    pushed = np.clip((time - 0.1) / 0.4, 0, 1)
    size = np.sin(np.pi * pushed) ** 2
    m, d = model.mj_model, mujoco.MjData(model.mj_model)
    point = np.empty((len(time), 1, 3))
    for k in range(len(time)):
        d.qpos[:] = motion.qpos[k]
        mujoco.mj_kinematics(m, d)
        point[k, 0] = d.body("foot").xpos + np.array([-0.03 + 0.16 * pushed[k], 0, -0.06])
    force = size[:, None, None] * np.array([-90 * np.cos(np.pi * pushed), 0 * time, 450 + 0 * time]).T[:, None]
    return model, motion, ExternalLoads("plate", time, ("foot",), force, np.zeros_like(force), point)


@pytest.fixture(scope="module")
def made_up(stride):
    model, motion, loads = stride
    return mjhcmc.hcmc(model, motion, loads=loads)


def test_made_up_walk_is_followed_and_played_again(made_up):
    assert made_up.verdict.passed
    assert made_up.roles == ("prescribed",) * 3 + ("tracked",) * 3
    assert np.rad2deg(np.abs(made_up.tracking_error[:, 3:]).max()) < 0.1
    assert np.abs(made_up.tracking_error[:, :3]).max() < 1e-9
    assert made_up.verdict.replay_window_max_error is not None
    assert np.abs(replay_windows(made_up, made_up.settings["physics_dt"]) - made_up.qpos).max() < 1e-12
    assert np.rad2deg(max(made_up.verdict.replay_window_max_error)) < 1e-2


def test_made_up_walk_obeys_newton(stride, made_up):
    """At the pelvis: what the leg's momentum takes beside weight and ground; at the joints: recursive Newton-Euler."""
    model, motion, loads = stride
    m, d, h = model.mj_model, mujoco.MjData(model.mj_model), 1e-3
    time = made_up.time[1:-1]
    mass = m.body_mass.sum()

    def center(at):
        rows = []
        for qpos in motion.sample(at).qpos:
            d.qpos[:] = qpos
            mujoco.mj_fwdPosition(m, d)
            rows.append(d.subtree_com[0].copy())
        return np.array(rows)

    acceleration = (center(time + h) - 2 * center(time) + center(time - h)) / h**2
    ground = loads.sample(time).force[:, 0]
    needed = mass * (acceleration - m.opt.gravity) - ground
    assert np.ptp(needed[:, 2]) > 400
    for name, axis in (("pelvis_tx", 0), ("pelvis_ty", 2)):
        told = of(made_up, made_up.residual, [name])[1:-1, 0]
        assert np.sqrt(((told - needed[:, axis]) ** 2).mean()) < 0.02 * np.abs(needed[:, axis]).max()

    reference = motion.sample(time)
    moments = np.empty((len(time), m.nv))
    for k in range(len(time)):
        d.qpos[:], d.qvel[:], d.qacc[:] = reference.qpos[k], reference.qvel[k], reference.qacc[k]
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        mujoco.mj_rne(m, d, 1, moments[k])
        pushed, at = np.zeros(m.nv), loads.sample(time[k])
        mujoco.mj_applyFT(m, d, at.force[0, 0], np.zeros(3), at.point[0, 0], m.body("foot").id, pushed)
        moments[k] -= pushed
    error = of(made_up, made_up.net_joint_moment[1:-1] - moments)
    assert (np.sqrt((error**2).mean(axis=0)) < 0.02 * np.abs(of(made_up, moments)).max(axis=0)).all()


def test_without_the_ground_reaction_the_moments_are_others(stride, made_up, coarse_replay):
    """The load is in the plant: what it takes at the ankle is gone without it."""
    model, motion, _ = stride
    free = mjhcmc.hcmc(model, motion)
    assert free.verdict.passed
    ankle = free.dof_names.index("ankle")
    assert free.peak_moment[ankle] < 0.2 * made_up.peak_moment[ankle]
    assert not free.external_load.any()
    assert made_up.external_load[:, ankle].any()

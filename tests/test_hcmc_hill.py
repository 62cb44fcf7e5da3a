"""The methods on Hill muscles: the figures they must reach, OpenSim's own results, recovery, and what is kept of it."""

import json
from dataclasses import replace

import numpy as np
import pytest

import mjhcmc
from mjhcmc import hill
from mjhcmc.activity import agreement
from mjhcmc.hill_muscles import hill_model
from mjhcmc.muscle_comparison import compare_muscles
from mjhcmc.opensim_reference import CMC_FLOOR, INITIALISATION, read_reference
from mjhcmc.verify import judge

# Figures of the leg driven by Hill muscles, degrees hip/knee/ankle, at default settings: what the project promises.
FIGURES = {"slow": (0.02, 0.04, 0.02), "fast": (0.04, 0.1, 0.1)}


@pytest.fixture(scope="module")
def fast(leg8):
    return mjhcmc.Motion.cosine(leg8, "fast")


@pytest.fixture(scope="module")
def swing(leg8):
    """One cycle of `slow`, for what does not need more."""
    amplitudes = dict(zip(leg8.joint_names, np.deg2rad([10, -20, -10]), strict=True))
    return mjhcmc.Motion.cosine(leg8, amplitudes=amplitudes, period=0.6, cycles=1)


@pytest.fixture(scope="module")
def compliant(leg8, fast):
    return mjhcmc.hcmc(leg8, fast, plant=mjhcmc.HillPlant(leg8))


@pytest.fixture(scope="module")
def rigid(leg8, fast):
    return mjhcmc.hcmc(leg8, fast, plant=mjhcmc.HillPlant(leg8, tendon="rigid"))


@pytest.fixture(scope="module")
def swung(leg8, swing):
    return mjhcmc.hcmc(leg8, swing, dt=0.02, plant=mjhcmc.HillPlant(leg8))


def largest(solution):
    return np.rad2deg(np.abs(solution.tracking_error).max(axis=0))


@pytest.mark.parametrize("tendon", ["rigid", "compliant"])
@pytest.mark.parametrize("dt", [0.01, 0.005])
def test_tracking_figures(request, leg8, fast, tendon, dt):
    if dt == 0.01:
        solution = request.getfixturevalue(tendon)
    else:
        solution = mjhcmc.hcmc(leg8, fast, dt=dt, plant=mjhcmc.HillPlant(leg8, tendon=tendon))
    assert solution.settings["muscles"]["tendon"] == tendon
    assert solution.dt == dt
    assert np.all(largest(solution) <= FIGURES["fast"]), largest(solution)
    assert np.all(np.abs(solution.reserve).max(axis=0) <= 0.01 * solution.peak_moment)
    assert solution.verdict.passed
    assert np.all(np.rad2deg(solution.verdict.replay_max_error) <= 0.01)


def test_it_follows_better_than_opensims_cmc_with_the_same_muscles(leg8, fast, compliant):
    run = read_reference(leg8, "fast")
    inside = run.time <= fast.end + 1e-9
    theirs = np.rad2deg(np.abs(run.qpos[inside] - fast.sample(run.time[inside]).qpos).max(axis=0))
    assert np.all(largest(compliant) < theirs)


@pytest.mark.parametrize("method", ["hcmc", "cmc"])
def test_activations_are_those_of_opensims_cmc(leg8, fast, method):
    run = read_reference(leg8, "fast")
    solution = getattr(mjhcmc, method)(leg8, fast, min_activation=CMC_FLOOR, plant=mjhcmc.HillPlant(leg8))
    found = agreement(solution.time, solution.activation, run.activity, CMC_FLOOR, INITIALISATION)
    assert min(r for r, _ in found.values()) > 0.9  # all eight work on fast
    assert np.median([rms for _, rms in found.values()]) < 0.06


@pytest.mark.parametrize(("tendon", "offset", "reserves"), [
    ("rigid", 5, True), ("rigid", 1, False), ("compliant", 5, True), ("compliant", -5, True), ("compliant", 1, False),
])  # fmt: skip
def test_it_comes_back_from_a_wrong_start(leg8, fast, tendon, offset, reserves):
    plant = mjhcmc.HillPlant(leg8, tendon=tendon)
    start = np.deg2rad(np.full(3, offset))
    solution = mjhcmc.hcmc(leg8, fast, initial_qpos=start, reserves=reserves, plant=plant)
    last = np.abs(solution.tracking_error[2 * len(solution.time) // 3 :]).max(axis=0)
    assert np.all(np.rad2deg(last) <= 1.5 * np.array([0.0053, 0.0153, 0.095]))  # nominal, of the worse tendon


@pytest.mark.usefixtures("coarse_replay")
@pytest.mark.parametrize(("tendon", "limit"), [("rigid", (0.2, 0.6, 1.5)), ("compliant", (0.04, 0.1, 0.15))])
def test_cmc_follows(leg8, fast, tendon, limit):
    solution = mjhcmc.cmc(leg8, fast, plant=mjhcmc.HillPlant(leg8, tendon=tendon))
    assert np.all(largest(solution) <= limit), largest(solution)
    assert solution.verdict.passed


@pytest.mark.usefixtures("coarse_replay")
@pytest.mark.parametrize("tendon", ["rigid", "compliant"])
def test_static_optimization_drifts_and_says_so(request, leg8, fast, tendon):
    plant = mjhcmc.HillPlant(leg8, tendon=tendon)
    solution = mjhcmc.static_optimization(leg8, fast, plant=plant)
    assert np.all((largest(solution) > 1) & (largest(solution) < 30))
    assert not solution.verdict.passed
    # at rest its plan is exact: settled muscles give what the first acceleration needs
    first = solution.net_joint_moment[0] - solution.reserve[0]
    wanted = request.getfixturevalue(tendon).net_joint_moment[0]
    np.testing.assert_allclose(first, wanted, atol=1e-3 * np.abs(wanted).max())


@pytest.mark.usefixtures("coarse_replay")
@pytest.mark.parametrize("curves", ["thelen", "degroote-fregly"])
@pytest.mark.parametrize("tendon", ["rigid", "compliant"])
def test_other_curves_follow_too(leg8, swing, curves, tendon):
    solution = mjhcmc.hcmc(leg8, swing, plant=mjhcmc.HillPlant(leg8, curves, tendon))
    assert np.all(largest(solution) <= FIGURES["slow"]), largest(solution)
    assert solution.verdict.passed


@pytest.mark.usefixtures("coarse_replay")
def test_muscles_too_stiff_for_the_step_are_solved_again_with_a_finer_one(leg8, fast):
    plant = mjhcmc.HillPlant(leg8, "thelen", "rigid")
    with pytest.warns(mjhcmc.MjhcmcWarning, match="solved again with physics_dt 0.00025 s"):
        solution = mjhcmc.hcmc(leg8, fast, plant=plant)
    assert solution.settings["physics_dt"] == pytest.approx(0.00025)
    assert np.all(largest(solution) < 0.2)
    assert not solution.verdict.passed  # Thelen's muscles are too weak for it
    assert plant.physics_dt == 0.001


def test_mujocos_own_muscles_are_followed_by_either_way(leg8, swing):
    """HCMC on forces and HCMC on activations: other code, other linearization, the same muscles."""
    ours = mjhcmc.hcmc(leg8, swing, dt=0.005)
    hosted = mjhcmc.hcmc(leg8, swing, dt=0.005, plant=mjhcmc.HillPlant(leg8, "mujoco", "rigid"))
    np.testing.assert_allclose(hosted.excitation, ours.excitation, atol=5e-3)
    np.testing.assert_allclose(hosted.net_joint_moment, ours.net_joint_moment, atol=2e-2)
    assert np.all(largest(hosted) < FIGURES["slow"])


def test_a_muscle_is_engaged_gently_while_its_tendon_is_slack(leg8):
    """Vasti slacken and tighten again here: asked for force at once, they would pull far too much afterwards."""
    time = np.linspace(0.0, 1.0, 201)
    angle = 20 * (1 - np.cos(2 * np.pi * time)) / 2
    motion = mjhcmc.Motion(time, np.deg2rad(np.stack([angle, -2 * angle, -angle / 2], axis=1)))
    solution = mjhcmc.hcmc(leg8, motion, plant=mjhcmc.HillPlant(leg8))
    assert np.all(largest(solution) <= FIGURES["slow"])
    assert np.abs(solution.reserve).max() < 1e-2
    assert np.abs(np.diff(solution.excitation, axis=0)).max() < 0.1


def test_a_plant_of_another_model_is_named(leg8, swing, two_joints):
    with pytest.raises(mjhcmc.SettingsError, match="the plant is of model 'two_joints', with other joints"):
        mjhcmc.hcmc(leg8, swing, plant=mjhcmc.MujocoPlant(two_joints))


def test_compliant_muscles_keep_their_tone(compliant, leg8, fast):
    assert compliant.excitation.min() == pytest.approx(0.01)
    assert compliant.activation.min() >= 0.01 - 1e-9
    cycle = replace(fast, span=(0, 0.2))
    quiet = mjhcmc.hcmc(leg8, cycle, min_activation={"soleus": 0.1}, plant=mjhcmc.HillPlant(leg8))
    assert quiet.excitation[:, leg8.muscle_names.index("soleus")].min() == pytest.approx(0.1)


def test_the_books_balance(compliant, leg8):
    """Net moments are those of the muscles and the reserve; tendon forces those of the NumPy model at the states."""
    detail = compliant.detail
    reserve = np.vstack([compliant.reserve, compliant.reserve[-1:]])
    total = detail.muscle_moment.sum(axis=1) + reserve
    np.testing.assert_allclose(total, compliant.net_joint_moment, atol=1e-9 * np.abs(total).max())
    muscles = hill_model(leg8)
    state = hill.fiber_dynamics(
        muscles, compliant.activation.clip(0, 1), compliant.fiber_length, detail.musculotendon_length,
        detail.musculotendon_velocity,
    )  # fmt: skip
    strongest = muscles.muscles.max_isometric_force
    assert (np.abs(compliant.muscle_force - state.tendon_force) / strongest).max() < 1e-9
    np.testing.assert_allclose(detail.fiber_length, state.fiber_length * state.cos_pennation, rtol=1e-12)
    np.testing.assert_allclose(detail.fiber_velocity, state.fiber_velocity / state.cos_pennation, rtol=1e-9, atol=1e-12)
    power = -state.tendon_force * detail.musculotendon_velocity
    np.testing.assert_allclose(detail.muscle_power, power, atol=1e-6)
    assert compliant.muscle_force.min() >= 0  # a tendon never pushes


def test_rigid_muscles_in_detail(leg8, swing):
    solution = mjhcmc.hcmc(leg8, swing, dt=0.02, plant=mjhcmc.HillPlant(leg8, tendon="rigid"))
    assert solution.fiber_length is None
    detail, muscles = solution.detail, hill_model(leg8)
    slack = muscles.muscles.tendon_slack_length
    np.testing.assert_allclose(detail.fiber_length, detail.musculotendon_length - slack, rtol=1e-12)
    state = hill.rigid_tendon(
        muscles, solution.activation, detail.musculotendon_length, detail.musculotendon_velocity
    )  # fmt: skip
    active = detail.active_moment[:, :, 2] / np.where(state.active_force > 0, state.active_force, 1)
    assert np.isfinite(active).all()
    assert (np.abs(solution.muscle_force - state.tendon_force) / muscles.muscles.max_isometric_force).max() < 1e-9


@pytest.mark.usefixtures("coarse_replay")
@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".sto", ".nc"])
def test_saved_and_loaded(swung, leg8, tmp_path, suffix):
    if suffix == ".nc":
        pytest.importorskip("xarray")
    path = swung.save(tmp_path / f"swing{suffix}")
    back = mjhcmc.Solution.load(path, leg8)
    np.testing.assert_allclose(back.fiber_length, swung.fiber_length, rtol=1e-12)
    assert back.hosted
    if suffix == ".csv":  # it holds no settings, so not which muscles
        with pytest.raises(mjhcmc.SimulationError, match="Hill muscles that its file does not hold"):
            mjhcmc.replay(back)
        return
    assert back.settings["muscles"] == {"tendon": "compliant", "curves": "millard", "named": True}
    assert back.hosted
    assert mjhcmc.Solution.load(path).hosted
    replayed = mjhcmc.replay(back, 1e-3)
    np.testing.assert_allclose(replayed, swung.qpos, atol=1e-12)  # the same steps
    with pytest.raises(mjhcmc.SimulationError, match="does not know its model"):
        mjhcmc.replay(mjhcmc.Solution.load(path))


@pytest.mark.usefixtures("coarse_replay")
def test_muscles_of_the_users_own_are_not_in_the_file(leg8, swing, tmp_path):
    muscles = hill_model(leg8, "degroote-fregly")
    solution = mjhcmc.hcmc(leg8, swing, dt=0.02, plant=mjhcmc.HillPlant(leg8, muscles))
    assert solution.verdict.replay_max_error is not None
    back = mjhcmc.Solution.load(solution.save(tmp_path / "own.parquet"), leg8)
    assert back.settings["muscles"]["named"] is False
    with pytest.raises(mjhcmc.SimulationError, match="Hill muscles that its file does not hold"):
        mjhcmc.replay_windows(back)
    fresh = judge(back)
    assert fresh.replay_max_error is None
    assert fresh.passed == solution.verdict.passed


def test_replay_windows_are_the_windows(swung):
    same = mjhcmc.replay_windows(swung, swung.settings["physics_dt"])
    np.testing.assert_allclose(same, swung.qpos, atol=1e-12)


def test_many_at_once_are_each_alone(leg8, swing, swung, fast):
    cycle = replace(fast, span=(0, 0.2))
    batch = mjhcmc.hcmc_batch(leg8, [swing, cycle], dt=0.02, muscle="compliant", threads=2)
    for alone, found in zip([swung, mjhcmc.hcmc(leg8, cycle, dt=0.02, plant=swung.plant())], batch, strict=True):
        for name in ("excitation", "qpos", "fiber_length", "reserve", "muscle_force"):
            np.testing.assert_array_equal(getattr(found, name), getattr(alone, name))


@pytest.mark.usefixtures("coarse_replay")
def test_variants_have_muscles_of_their_own(leg8, swing):
    """A model whose muscles are stronger has stronger Hill muscles, so they need less."""
    factor = np.array([1.0, 1.5])
    gain = leg8.mj_model.actuator_gainprm[None] * np.ones((2, 1, 1))
    bias = leg8.mj_model.actuator_biasprm[None] * np.ones((2, 1, 1))
    gain[:, :, 2] *= factor[:, None]
    bias[:, :, 2] *= factor[:, None]
    parameters = {"actuator_gainprm": gain, "actuator_biasprm": bias}
    batch = mjhcmc.hcmc_batch(leg8, swing, dt=0.02, parameters=parameters, muscle="rigid")
    effort = [float((solution.activation**2).sum()) for solution in batch]
    assert effort[1] < 0.7 * effort[0]
    assert all(solution.verdict.passed for solution in batch)


def test_joint_moments_reach_hill_muscles(leg8, swing):
    moments = mjhcmc.hcmc(leg8, swing, dt=0.02)
    given = mjhcmc.JointMoments(moments.time, moments.net_joint_moment, leg8.joint_names)
    plant = mjhcmc.HillPlant(leg8)
    solution = mjhcmc.hcmc(leg8, swing, dt=0.02, joint_moments=given, plant=plant)
    assert np.abs(solution.external_load).max() > 0
    assert np.all(largest(solution) < 1)


@pytest.mark.usefixtures("coarse_replay")
def test_costs_and_solvers_on_hill_muscles(leg8, swing, swung):
    part = replace(swing, span=(0, 0.3))
    newton, daqp = (
        mjhcmc.hcmc(leg8, part, dt=0.02, solver=solver, plant=mjhcmc.HillPlant(leg8)) for solver in ("newton", "daqp")
    )
    np.testing.assert_allclose(daqp.excitation, newton.excitation, atol=1e-3)
    other = mjhcmc.hcmc(leg8, swing, dt=0.02, cost="cubic", plant=mjhcmc.HillPlant(leg8))
    assert other.verdict.passed
    assert np.abs(other.excitation - swung.excitation).max() > 1e-2  # it does choose otherwise
    off = mjhcmc.hcmc(leg8, swing, dt=0.02, disabled=["rect_fem"], plant=mjhcmc.HillPlant(leg8))
    assert off.excitation[:, leg8.muscle_names.index("rect_fem")].max() == 0.01  # its tone
    assert off.verdict.passed


def test_a_tendon_longer_than_its_path_is_named(leg8, swing):
    m = hill_model(leg8).muscles
    slack = m.tendon_slack_length.copy()
    slack[5] += 0.2
    long = hill.MuscleParameters(
        m.max_isometric_force, m.optimal_fiber_length, slack, m.pennation_at_optimal, names=m.names
    )  # fmt: skip
    plant = mjhcmc.HillPlant(leg8, hill.HillModel(long, hill.millard2012()), "rigid")
    with pytest.raises(mjhcmc.MotionError, match=r"path of 'gastroc' is .* m long and its tendon .* m"):
        mjhcmc.hcmc(leg8, swing, plant=plant)
    with pytest.raises(mjhcmc.SimulationError, match=r"gastroc.*no equilibrium"):
        mjhcmc.hcmc(leg8, swing, plant=mjhcmc.HillPlant(leg8, plant.hosted.hill, "compliant"))


def test_a_step_too_coarse_for_the_fibers_is_seen(leg8):
    """Taut passive fibers come to rest at more than 556 /s, where Runge-Kutta steps of 5 ms blow up on them."""
    taut = mjhcmc.Motion.cosine(leg8, amplitudes={"hip": np.deg2rad(60)}, period=1.0, cycles=1)
    with pytest.raises(mjhcmc.SimulationError, match="unstable under its damping"):
        mjhcmc.hcmc(leg8, taut, dt=0.02, plant=mjhcmc.HillPlant(leg8, physics_dt=0.005))


def test_the_comparison_of_muscles_wants_mujocos(swung, leg8):
    with pytest.raises(mjhcmc.SimulationError, match="muscles are Hill muscles"):
        compare_muscles(swung, hill_model(leg8))


@pytest.mark.usefixtures("coarse_replay")
def test_on_the_command_line(run, mot, tmp_path, no_figures):
    found = run("solve", mot(), "--muscle", "compliant", "--dt", 0.02, "--json", "--quiet", "--out", tmp_path / "out")
    assert found.code == 0, found.err
    told = json.loads(found.out)
    assert told["settings"]["muscles"] == {"tendon": "compliant", "curves": "millard", "named": True}
    back = mjhcmc.Solution.load(tmp_path / "out" / "solution.parquet")
    assert back.fiber_length.shape == back.activation.shape
    assert told["verdict"]["passed"]


@pytest.mark.usefixtures("coarse_replay", "timed_once")
def test_reproduce_on_hill_muscles(run):
    found = run("reproduce", "--muscle", "rigid", "--curves", "degroote-fregly", "--dt", 0.02, "--json")
    assert found.code == 0, found.err
    told = json.loads(found.out)
    assert (told["muscle"], told["curves"]) == ("rigid", "degroote-fregly")
    assert set(told["methods"]) == {"hcmc", "cmc", "static"}
    assert told["methods"]["hcmc"]["verdict"]["passed"]
    assert not told["methods"]["static"]["verdict"]["passed"]
    assert told["bare_step_time_s"] > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--muscle", "elastic"), "muscle 'elastic' is not known: choose one of mujoco, rigid, compliant"),
        (("--curves", "hill"), "curves 'hill' are not known: choose one of millard, thelen, degroote-fregly"),
        (("--curves", "thelen"), "curves 'thelen' are of Hill muscles: choose muscle 'rigid' or 'compliant'"),
        (("--muscle", "rigid", "--dt", "-1"), "dt must be a positive number"),
    ],
)
@pytest.mark.parametrize("command", ["reproduce", "solve"])
def test_bad_names_are_one_line(run, mot, tmp_path, command, arguments, message):
    start = [command] if command == "reproduce" else [command, mot()]
    found = run(*start, *arguments, "--out", tmp_path / "none")
    assert found.code == 2
    assert message in found.errors[-1]
    assert len(found.errors) == 1
    assert not (tmp_path / "none").exists()

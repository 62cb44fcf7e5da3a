"""Many movements in lock step: each as if solved alone, whatever happens to the others."""

import copy
import re

import mujoco
import numpy as np
import pytest
from conftest import load_xml
from many_muscles import chain

import mjhcmc
from mjhcmc.dynamics import mass_matrix
from mjhcmc.lockstep import Lockstep
from mjhcmc.one_by_one import OneByOne
from mjhcmc.solution_batch import SimulationStatus

FIELDS = (
    "time", "excitation", "activation", "qpos", "qvel", "tracking_error", "net_joint_moment", "muscle_force",
    "reserve", "shortfall", "external_load", "status",
)  # fmt: skip


def assert_identical(a, b):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    assert a.settings == b.settings


def short(model, movement="fast", cycles=1, scale=1.0):
    """One cycle of a cosine movement, its amplitudes scaled."""
    amplitudes = {"hip": 0.17, "knee": -0.34, "ankle": 0.17}
    period = {"fast": 0.2, "slow": 0.6}[movement]
    return mjhcmc.Motion.cosine(
        model, amplitudes={j: scale * a for j, a in amplitudes.items()}, period=period, cycles=cycles
    )


@pytest.fixture(scope="module")
def motions(leg8):
    return [
        short(leg8), short(leg8, "slow"), short(leg8, scale=0.5), mjhcmc.Motion.cosine(leg8, "fast"),
        short(leg8, scale=1.1),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def alone(leg8, motions):
    return [mjhcmc.hcmc(leg8, motion) for motion in motions]


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_each_is_solved_as_if_alone(leg8, motions, alone, threads):
    """Bit for bit, motions of different lengths, any number of threads."""
    batch = mjhcmc.hcmc_batch(leg8, motions, threads=threads)
    assert len(batch) == len(motions)
    assert list(batch.status) == [SimulationStatus.SOLVED] * len(motions)
    for solution, own in zip(batch, alone, strict=True):
        assert_identical(solution, own)


def test_chunks_of_many_threads_change_nothing(leg8):
    """Enough simulations for the compiled parts to be spread over threads, too."""
    motion, scales = short(leg8), np.linspace(0.2, 1.0, 34)
    cosines = [short(leg8, scale=scale) for scale in scales]
    one, two = (mjhcmc.hcmc_batch(leg8, cosines, dt=0.02, threads=threads) for threads in (1, 2))
    for a, b in zip(one, two, strict=True):
        assert_identical(a, b)
    assert_identical(one[-1], mjhcmc.hcmc(leg8, motion, dt=0.02))


def test_models_with_numbers_of_their_own(leg8):
    """Parameters, the same models made by hand, and each alone."""
    motion, scale = short(leg8), np.array([0.9, 1.0, 1.2])
    m = leg8.mj_model
    gain = m.actuator_gainprm[None] * np.where(np.arange(m.actuator_gainprm.shape[1]) == 2, scale[:, None, None], 1.0)
    mass = m.body_mass[None] * scale[:, None]
    batch = mjhcmc.hcmc_batch(leg8, motion, parameters={"actuator_gainprm": gain, "body_mass": mass})
    for i, solution in enumerate(batch):
        spec = mujoco.MjModel.from_xml_path(str(mjhcmc.assets.model_path("leg8")))
        spec.actuator_gainprm[:], spec.body_mass[:] = gain[i], mass[i]
        mujoco.mj_setConst(spec, mujoco.MjData(spec))
        model = mjhcmc.MuscleModel.load(spec)
        assert_identical(solution, mjhcmc.hcmc(model, motion))
        np.testing.assert_array_equal(solution.model.mj_model.body_subtreemass, spec.body_subtreemass)
    np.testing.assert_array_equal(batch[1].excitation, mjhcmc.hcmc(leg8, motion).excitation)
    assert batch[0].excitation.max() != batch[2].excitation.max()
    by_models = mjhcmc.hcmc_batch([s.model for s in batch], motion)
    for a, b in zip(batch, by_models, strict=True):
        assert_identical(a, b)


@pytest.mark.parametrize(
    "options",
    [
        {"cost": "cubic"}, {"cost": "stress"}, {"cost": "capacity"}, {"cost": "volume", "smoothness": 0.1},
        {"reserves": False}, {"solver": "daqp"}, {"disabled": ["soleus"], "min_activation": 0.02},
        {"trials": 1}, {"tolerance": 0.0, "trials": 3}, {"weights": {"soleus": 5.0}}, {"physics_dt": 0.0033},
    ],
    ids=str,
)  # fmt: skip
def test_every_choice_is_as_for_one(leg8, options):
    batch = mjhcmc.hcmc_batch(leg8, [short(leg8), short(leg8, scale=0.7)], **options)
    assert_identical(batch[0], mjhcmc.hcmc(leg8, short(leg8), **options))


def test_starts_and_joint_moments_of_their_own(leg8):
    motion = short(leg8, "slow")
    start = motion.qpos[0] + np.array([[0.0, 0.0, 0.0], [0.01, -0.02, 0.01]])
    activation = np.array([[0.1] * 8, [0.3] * 8])
    batch = mjhcmc.hcmc_batch(leg8, [motion, motion], initial_qpos=start, initial_activation=activation)
    alone = mjhcmc.hcmc(leg8, motion, initial_qpos=start[1], initial_activation=activation[1])
    assert_identical(batch[1], alone)
    own = mjhcmc.hcmc(leg8, motion)
    moments = mjhcmc.JointMoments(own.time, 0.9 * own.net_joint_moment)
    batch = mjhcmc.hcmc_batch(leg8, [motion, motion], joint_moments=moments)
    assert_identical(batch[1], mjhcmc.hcmc(leg8, motion, joint_moments=moments))


# --- failures ---------------------------------------------------------------------------------------------------


def test_one_that_diverges_fails_alone_and_is_named(leg8, motions):
    """A start so fast that no step follows it."""
    qvel = np.zeros((len(motions), 3))
    qvel[2, 1] = 1e7
    with pytest.warns(mjhcmc.MjhcmcWarning) as told:
        batch = mjhcmc.hcmc_batch(leg8, motions, initial_qvel=qvel)
    texts = [str(w.message) for w in told]
    assert any("simulation 2" in text and "solved again with physics_dt" in text for text in texts)
    assert "1 of 5 simulations failed: simulation 2:" in texts[-1]
    assert list(batch.status) == [0, 0, SimulationStatus.DIVERGED, 0, 0]
    assert SimulationStatus(batch.status[2]).message
    with pytest.raises(mjhcmc.DivergedError, match="diverged"):
        batch[2]
    with pytest.raises(mjhcmc.DivergedError):
        list(batch)
    for i in (0, 3, 4):
        assert_identical(batch[i], mjhcmc.hcmc(leg8, motions[i], initial_qvel=qvel[i]))


def test_one_with_nan_is_refused_alone_and_is_named(leg8):
    mass = np.tile(leg8.mj_model.body_mass, (3, 1))
    mass[1, 2] = np.nan
    with pytest.warns(mjhcmc.MjhcmcWarning, match=r"1 of 3 simulations failed: simulation 1: .*body_mass\[2\] is nan"):
        batch = mjhcmc.hcmc_batch(leg8, short(leg8), parameters={"body_mass": mass})
    assert list(batch.status) == [0, SimulationStatus.REFUSED, 0]
    with pytest.raises(mjhcmc.ModelError, match="give finite values"):
        batch[1]
    assert_identical(batch[0], mjhcmc.hcmc(leg8, short(leg8)))
    qpos = np.zeros((2, 3))
    qpos[0, 0] = np.nan
    with pytest.warns(mjhcmc.MjhcmcWarning, match=r"simulation 0: initial_qpos must hold finite"):
        batch = mjhcmc.hcmc_batch(leg8, [short(leg8)] * 2, initial_qpos=qpos)
    assert sorted(batch.solved) == [1]


def test_a_step_too_long_is_refined_for_those_that_need_it(leg8):
    """One step of 10 ms a window is too long for active muscles."""
    motion = short(leg8, "slow")
    with pytest.warns(mjhcmc.MjhcmcWarning) as told:
        batch = mjhcmc.hcmc_batch(leg8, [motion, motion], physics_dt=1)
    for i, notice in enumerate(told):
        assert re.match(rf"simulation {i}: .*diverged.*solved again with physics_dt 0\.0025", str(notice.message))
    with pytest.warns(mjhcmc.MjhcmcWarning, match=r"^the .*diverged.*solved again"):
        assert_identical(batch[1], mjhcmc.hcmc(leg8, motion, physics_dt=1))


def test_where_all_fail_the_first_error_is_raised(leg8):
    with pytest.raises(mjhcmc.SettingsError, match="longer than the motion"):
        mjhcmc.hcmc_batch(leg8, [short(leg8)] * 3, dt=5.0)
    with pytest.raises(mjhcmc.SettingsError, match="unknown cost"):
        mjhcmc.hcmc_batch(leg8, [short(leg8)] * 3, cost="money")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"motions": []}, "motions is empty"),
        ({"models": []}, "models is empty"),
        ({"threads": 0}, r"threads must be a whole number of at least 1; got 0"),
        ({"threads": -2}, "threads must be"),
        ({"threads": 1.5}, "threads must be"),
        ({"models": 3}, r"models has 3 entries, the batch|motions has 2 entries, the batch has 3"),
        ({"motions": ["walk.mot", "run.mot"]}, r"motions\[0\] must be a Motion; got str"),
        ({"models": "leg8"}, r"models\[0\] must be a MuscleModel; got str"),
        ({"initial_qpos": np.zeros((3, 3))}, r"initial_qpos has 3 entries, the batch has 2"),
        ({"parameters": {}}, "parameters are empty"),
        ({"parameters": {"body_mas": np.ones((2, 5))}}, "no field 'body_mas'.*did you mean body_mass"),
        ({"parameters": {"body_mass": np.ones(5)}}, r"body_mass has shape \(5,\): give \(B, "),
        ({"parameters": {"nq": np.ones(2)}}, "no field 'nq' of real numbers"),
        ({"trials": 0}, "trials must be at least 1"),
        ({"tolerance": -1}, "tolerance must be 0 or positive"),
    ],
    ids=str,
)
def test_bad_input_is_named(leg8, arguments, message):
    if arguments.get("models") == 3:
        arguments = {"models": [leg8] * 3}
    given = {"models": leg8, "motions": [short(leg8)] * 2} | arguments
    with pytest.raises(mjhcmc.SettingsError, match=message):
        mjhcmc.hcmc_batch(**given)


def test_members_of_different_structure_are_named(leg8):
    other = chain(3, 8)
    with pytest.raises(mjhcmc.SettingsError, match=r"models\[1\] has the muscle names"):
        mjhcmc.hcmc_batch([leg8, other], short(leg8))
    m = leg8.mj_model
    rows = {"body_mass": np.tile(m.body_mass, (2, 1)), "dof_damping": np.tile(m.dof_damping, (3, 1))}
    with pytest.raises(mjhcmc.SettingsError, match=r"parameters have different numbers of rows \(body_mass 2, "):
        mjhcmc.hcmc_batch(leg8, short(leg8), parameters=rows)


def test_an_interrupt_keeps_what_was_solved_of_each(leg8, motions):
    def stop(done, total):
        if done == 7:
            raise KeyboardInterrupt

    with pytest.raises(mjhcmc.SolveInterrupted) as caught:
        mjhcmc.hcmc_batch(leg8, motions, progress=stop)
    parts = caught.value.solutions
    assert [part.n_window for part in parts] == [7] * len(motions)
    assert all(part.interrupted for part in parts)
    whole = mjhcmc.hcmc(leg8, motions[0])
    np.testing.assert_array_equal(parts[0].excitation, whole.excitation[:7])


# --- the plants -------------------------------------------------------------------------------------------------

CONTACT = """<mujoco><option integrator="RK4"/><worldbody><geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .5"><joint name="lift" type="slide" axis="0 0 1" damping="3" stiffness="20"/>
    <geom type="sphere" size=".1" mass="2" contype="0" conaffinity="0"/>
    <body pos="0 0 0"><joint name="swing" axis="0 1 0" range="-40 40" limited="true" damping=".5"/>
    <geom type="capsule" fromto="0 0 0 .3 0 -.2" size=".02" mass=".5"/><site name="s" pos=".1 0 -.1"/></body></body>
    <site name="o" pos=".4 0 1"/></worldbody>
    <tendon><spatial name="t" damping="4"><site site="o"/><site site="s"/></spatial></tendon>
    <actuator><muscle name="m" tendon="t" force="80" lengthrange=".3 .9"/>
    <muscle name="j" joint="swing" force="20" lengthrange="-1 1"/><motor name="motor" joint="lift"/></actuator>
    </mujoco>"""


@pytest.mark.parametrize("model", ["leg8", "contact"])
def test_the_batch_and_a_plain_plant_agree(leg8, model):
    """MuJoCo's batch against mj_step, mj_forward and differences of them, one at a time."""
    model = leg8 if model == "leg8" else load_xml(CONTACT)
    rng, b, n, nv = np.random.default_rng(3), 3, model.n_muscle, model.nv
    load = lambda t: np.sin(7 * t)[:, None] * np.ones(nv)  # noqa: E731
    plants = [mjhcmc.MujocoPlant(model, 0.001, load if i == 1 else None) for i in range(b)]
    together = Lockstep([model] * b, 0.001, [p.surroundings for p in plants], threads=2)
    alone = OneByOne(plants)
    states = [
        mjhcmc.plant.State(
            0.1 * i, 0.2 * rng.normal(size=nv), rng.normal(size=nv), rng.uniform(size=n), rng.normal(size=nv)
        )
        for i in range(b)
    ]  # fmt: skip
    for ids in (np.arange(b), np.array([0, 2]), np.array([1])):
        u, s = rng.uniform(size=(len(ids), n)), rng.normal(size=(len(ids), nv))
        for times in (1.0, 1.5):
            ends = [p.step(ids, p.rows(states)[ids], u, s, 7, times) for p in (together, alone)]
            parts = [[p.layout.state(row) for row in end] for p, end in zip((together, alone), ends, strict=True)]
            for x, y in zip(*parts, strict=True):
                for name in ("time", "qpos", "qvel", "activation", "warmstart"):
                    np.testing.assert_array_equal(getattr(x, name), getattr(y, name), err_msg=name)
        rows = [p.rows(states)[ids] for p in (together, alone)]
        a, b_ = (p.acceleration(ids, r, s) for p, r in zip((together, alone), rows, strict=True))
        np.testing.assert_array_equal(a, b_)
        x, y = (
            p.linearize(ids, r, s, stiffness=True, damping=True) for p, r in zip((together, alone), rows, strict=True)
        )
        for name, tolerance in (("qacc", 0), ("M", 0), ("B", 1e-12), ("gain", 1e-12), ("bias", 1e-12)):
            np.testing.assert_allclose(getattr(x, name), getattr(y, name), rtol=tolerance, atol=1e3 * tolerance)
        for name in ("D", "K"):  # by differences
            size = np.abs(getattr(y, name)).max()
            np.testing.assert_allclose(getattr(x, name), getattr(y, name), rtol=0, atol=1e-7 * size)
    rows, s = np.repeat(together.rows(states)[[1]], 4, axis=0), rng.normal(size=(4, nv))
    theirs = np.repeat(alone.rows(states)[[1]], 4, axis=0)
    x, y = together.nodes(1, rows, s), alone.nodes(1, theirs, s)
    for name in ("muscle_force", "muscle_moment", "net_joint_moment", "external_load"):
        np.testing.assert_allclose(getattr(x, name), getattr(y, name), rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize(
    ("model", "poses", "held", "contacts"),
    [
        ("leg8", ([0.1, -0.3, 0.2], [0.1, 0.1740, 0.2], [0.1, 0.2, 0.2]), [False, True, True], [0, 0, 0]),
        ("contact", ([0.2, 0.1], [1.0, 0.6977], [-0.35, 0.1], [-0.5, 0.72]), [False, True, True, True], [0, 0, 1, 2]),
    ],
)  # fmt: skip
def test_what_holds_a_model_is_seen_alike(leg8, model, poses, held, contacts):
    """Held: within 1e-3 of a limit, or in contact; neither adds to M, since it may come off."""
    model = leg8 if model == "leg8" else load_xml(CONTACT)
    rng, b, nv = np.random.default_rng(5), len(poses), model.nv
    plants = [mjhcmc.MujocoPlant(model, 0.001) for _ in range(b)]
    together, alone = Lockstep([model] * b, 0.001, [p.surroundings for p in plants]), OneByOne(plants)
    states = [
        mjhcmc.plant.State(0.0, np.array(q), rng.normal(size=nv), rng.uniform(size=model.n_muscle), np.zeros(nv))
        for q in poses
    ]
    ids, s = np.arange(b), rng.normal(size=(b, nv))
    x, y = (p.linearize(ids, p.rows(states), s, stiffness=True) for p in (together, alone))
    assert [p.mj_data.ncon for p in plants] == contacts
    assert x.held.tolist() == y.held.tolist() == held
    np.testing.assert_array_equal(x.qacc, y.qacc)
    np.testing.assert_array_equal(x.M, y.M)
    for k, plant in enumerate(plants):
        plant.set_state(states[k])
        plant.forward()
        np.testing.assert_allclose(x.M[k], mass_matrix(plant), rtol=1e-12)
    for name in ("D", "K"):
        size = np.abs(getattr(y, name)).max()
        np.testing.assert_allclose(getattr(x, name), getattr(y, name), rtol=0, atol=1e-7 * size)


def test_a_plant_of_ones_own_gives_the_same(leg8):
    motion = short(leg8)
    ours, own = mjhcmc.hcmc(leg8, motion), mjhcmc.hcmc(leg8, motion, plant=mjhcmc.MujocoPlant(leg8, 0.001))
    np.testing.assert_allclose(ours.excitation, own.excitation, rtol=0, atol=1e-6)
    np.testing.assert_allclose(ours.qpos, own.qpos, rtol=0, atol=1e-8)


# --- what belongs to one simulation ------------------------------------------------------------------------------


def variant(leg8, **changes):
    """leg8 with some columns of its actuators' fields changed."""
    import copy

    m = copy.copy(leg8.mj_model)
    for name, (column, factor) in changes.items():
        getattr(m, name)[:, column] *= factor
    mujoco.mj_setConst(m, mujoco.MjData(m))
    return mjhcmc.MuscleModel.load(m)


@pytest.mark.parametrize("cost", ["stress", "volume", "capacity"])
def test_strength_and_time_constants_are_each_models_own(leg8, cost):
    """Strengths enter the cost, time constants the reach of excitations: of its own model, not of the first."""
    weaker = variant(leg8, actuator_gainprm=(2, np.linspace(0.7, 1.1, 8)), actuator_biasprm=(2, 0.9))
    slower = variant(leg8, actuator_dynprm=(slice(0, 2), 1.4))
    motion = short(leg8, scale=0.6)
    batch = mjhcmc.hcmc_batch([leg8, weaker, slower], motion, cost=cost)
    for i, model in enumerate((leg8, weaker, slower)):
        assert_identical(batch[i], mjhcmc.hcmc(model, motion, cost=cost))


def test_joint_moments_are_each_simulations_own(leg8):
    motion = short(leg8, "slow")
    own = mjhcmc.hcmc(leg8, motion)
    moments = [mjhcmc.JointMoments(own.time, scale * own.net_joint_moment) for scale in (1.0, 0.8)]
    batch = mjhcmc.hcmc_batch(leg8, [motion, motion], joint_moments=moments)
    assert_identical(batch[1], mjhcmc.hcmc(leg8, motion, joint_moments=moments[1]))
    with pytest.raises(mjhcmc.SettingsError, match="joint_moments has 2 entries, the batch has 3"):
        mjhcmc.hcmc_batch(leg8, [motion] * 3, joint_moments=moments)


BEFORE_OR_AFTER = """<mujoco><option integrator="RK4"/><worldbody><body><joint name="j" axis="0 -1 0" damping=".2"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1" contype="0" conaffinity="0"/></body></worldbody>
    <actuator>{}<muscle name="up" joint="j" force="20" lengthrange="-1 1" gear="-1"/>
    <muscle name="down" joint="j" force="20" lengthrange="-1 1" gear="1"/>{}</actuator></mujoco>"""


def test_models_whose_actuators_come_in_another_order_are_refused():
    motor = '<motor name="motor" joint="j"/>'
    models = [load_xml(BEFORE_OR_AFTER.format(*order)) for order in (("", motor), (motor, ""))]
    motion = mjhcmc.Motion.cosine(models[0], amplitudes={"j": 0.2}, period=0.5, cycles=1)
    with pytest.raises(mjhcmc.SettingsError, match=r"models\[1\] differs from models\[0\] in actuator_"):
        mjhcmc.hcmc_batch(models, motion)
    assert len(mjhcmc.hcmc_batch([models[1]] * 2, motion)) == 2
    heavier = load_xml(
        BEFORE_OR_AFTER.format("", motor + motor.replace("motor", "motor", 1).replace('"motor"', '"m2"'))
    )
    with pytest.raises(mjhcmc.SettingsError, match=r"models\[1\] has nu = 4, models\[0\] has 3"):
        mjhcmc.hcmc_batch([models[0], heavier], motion)


def test_parameters_that_make_no_model_are_refused_alone(leg8):
    mass = np.tile(leg8.mj_model.body_mass, (3, 1))
    mass[1] *= -1
    with pytest.warns(mjhcmc.MjhcmcWarning, match="simulation 1: .*mass matrix is not positive definite"):
        batch = mjhcmc.hcmc_batch(leg8, short(leg8), parameters={"body_mass": mass})
    assert list(batch.status) == [0, SimulationStatus.REFUSED, 0]
    dynprm = np.tile(leg8.mj_model.actuator_dynprm, (2, 1, 1))
    dynprm[0, 3, 1] = 0.0
    with pytest.warns(mjhcmc.MjhcmcWarning, match="simulation 0: .*muscle 'hamstrings' has time constants .* and 0 s"):
        mjhcmc.hcmc_batch(leg8, short(leg8), parameters={"actuator_dynprm": dynprm})
    with pytest.raises(mjhcmc.ModelError, match="give finite values"):
        mjhcmc.hcmc_batch(leg8, short(leg8), parameters={"body_mass": mass * np.nan})
    with pytest.raises(mjhcmc.SettingsError, match="dof_M0 follows from other fields"):
        mjhcmc.hcmc_batch(leg8, short(leg8), parameters={"dof_M0": np.full((2, 3), 7.0)})
    with pytest.raises(mjhcmc.SettingsError, match="parameters must map names"):
        mjhcmc.hcmc_batch(leg8, short(leg8), parameters=[1, 2])


def test_an_interrupt_while_one_is_solved_again_keeps_the_others(leg8):
    """And simulations keep their numbers, though one was refused before."""
    calls = []

    def stop(done, total):
        calls.append(done)
        if len(calls) > total and done == 1:
            raise KeyboardInterrupt

    qpos = np.tile(short(leg8).qpos[0], (4, 1))
    qpos[0, 0] = np.nan
    qvel = np.zeros((4, 3))
    qvel[2, 1] = 1e7
    with (
        pytest.warns(mjhcmc.MjhcmcWarning, match="simulation 2: .*solved again"),
        pytest.raises(mjhcmc.SolveInterrupted) as caught,
    ):
        mjhcmc.hcmc_batch(leg8, [short(leg8)] * 4, initial_qpos=qpos, initial_qvel=qvel, progress=stop)
    parts = caught.value.solutions
    assert [part is None for part in parts] == [True, False, parts[2] is None, False]
    assert not parts[1].interrupted
    assert parts[1].n_window == parts[3].n_window == 20


def test_a_notice_that_all_give_comes_once(leg8):
    with pytest.warns(mjhcmc.MjhcmcWarning) as told:
        mjhcmc.hcmc_batch(leg8, [short(leg8)] * 5, dt=0.03)
    assert [str(w.message).split(":")[0] for w in told] == ["dt 0.03 s does not divide the motion (0.2 s)"]


def test_a_batch_is_a_sequence_that_says_what_it_is(leg8):
    batch = mjhcmc.hcmc_batch(leg8, [short(leg8)] * 2)
    assert repr(batch) == "SolutionBatch(2 simulations, 2 solved)"
    assert batch[-1] is batch[1]
    assert batch.failures == ""
    with pytest.raises(IndexError, match="simulation 2 of 2"):
        batch[2]


@pytest.mark.filterwarnings("ignore::mjhcmc.MjhcmcWarning")
def test_a_run_away_that_stays_finite_is_solved_again(leg8):
    """Half activated, the leg is too stiff for 1 ms; the first windows used to be lost without a word."""
    solution = mjhcmc.hcmc(leg8, mjhcmc.Motion.cosine(leg8, "fast"), initial_activation=0.5)
    assert solution.settings["physics_dt"] < 0.001
    assert np.rad2deg(np.abs(solution.tracking_error).max()) < 0.5


def test_a_window_that_missed_is_looked_at_anew(leg8):
    """An ankle beyond the strength of its muscles: the end is not where it was expected."""
    time = np.arange(0, 1.001, 0.002)
    qpos = np.deg2rad(np.tile([10.0, -40.0, 5.0], (len(time), 1)))
    qpos[:, 2] += np.deg2rad(15) * np.sin(2 * np.pi * time / 0.15)
    solution = mjhcmc.hcmc(leg8, mjhcmc.Motion(time, qpos), physics_dt=5e-4)
    error = np.rad2deg(np.abs(solution.tracking_error))
    assert error.max() < 2.6  # by the expected end alone: 3.3
    assert not (solution.status == mjhcmc.WindowStatus.STIFF).any()


def weak(leg8, i):
    """A leg much too weak for fast movements: reserves, and velocities at which muscles can do nothing."""
    m = copy.copy(leg8.mj_model)
    strength = 0.25 + 0.1 * i
    m.actuator_gainprm[:, 2] *= strength
    m.actuator_biasprm[:, 2] *= strength
    m.tendon_damping[:] *= strength
    m.actuator_gainprm[:, 7] *= 4.0 / strength
    m.actuator_biasprm[:, 7] *= 4.0 / strength
    return mjhcmc.MuscleModel.load(m)


@pytest.mark.filterwarnings("ignore::mjhcmc.errors.MjhcmcWarning")
def test_company_changes_no_bit_where_muscles_are_far_beyond_their_strength(leg8, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs what diverges
    models = [weak(leg8, i) for i in range(3)]
    motions = [short(model, scale=3.0) for model in models]
    batch = mjhcmc.hcmc_batch(models, motions, physics_dt=0.002)
    for i, (model, motion) in enumerate(zip(models, motions, strict=True)):
        assert np.abs(batch[i].reserve).max() > 50
        assert_identical(batch[i], mjhcmc.hcmc(model, motion, physics_dt=0.002))

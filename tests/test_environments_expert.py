"""HCMC as the expert: it is the method's own solve, comes back from elsewhere, earns most; and what it writes down."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import mjhcmc
from mjhcmc import MjhcmcWarning, OutputError, SettingsError, SimulationError
from mjhcmc.environments import (
    Episodes,
    Expert,
    FeedbackExpert,
    TrackingTask,
    Trajectories,
    expert_trajectories,
    returns,
)
from mjhcmc.errors import DivergedError

DT = 0.01


@pytest.fixture(scope="module")
def bare(leg8, slow):
    """The slow movement by the muscles alone."""
    return mjhcmc.hcmc(leg8, slow, DT, TrackingTask(leg8, slow).settings.physics_dt, reserves=False)


@pytest.fixture(scope="module")
def written(leg8):
    return expert_trajectories(leg8, ["fast"], n=3, disturbance=0.1, seed=4, start="random", noise=0.02)


def followed(episodes, policy, seed=0, node=None, push=None):
    """(n, nz) rad tracking errors of an episode; push: called with the plant before each window."""
    task = episodes.task
    episodes.reset(np.random.default_rng(seed), node)
    errors, over = [task.tracking_error(episodes.node, episodes.state)], False
    while not over:
        if push is not None:
            push(episodes)
        outcome = episodes.step(policy(episodes.node, episodes.state))
        errors.append(outcome.tracking_error)
        over = outcome.terminated or outcome.truncated
    return np.array(errors)


@pytest.mark.parametrize("integrator", ["rk4", "implicit"])
def test_undisturbed_it_is_the_solve(leg8, slow, bare, integrator):
    solution = bare if integrator == "rk4" else mjhcmc.hcmc(leg8, slow, DT, reserves=False, integrator=integrator)
    task = TrackingTask(leg8, slow, dt=DT, integrator=integrator)
    expert, episodes = FeedbackExpert(task), Episodes(task)
    episodes.reset(np.random.default_rng(0))
    for k in range(task.n_window):
        excitation = expert(k, episodes.state)
        np.testing.assert_array_equal(excitation, solution.excitation[k])
        episodes.step(excitation)
    np.testing.assert_array_equal(episodes.state.qpos, solution.qpos[-1])


def test_costs_are_the_methods(leg8, slow):
    task = TrackingTask(leg8, replace(slow, span=(0.0, 0.3)), dt=DT)
    step = task.settings.physics_dt
    solution = mjhcmc.hcmc(leg8, slow, DT, step, reserves=False, cost="cubic", disabled=["gastroc"])
    expert = FeedbackExpert(task, cost="cubic", disabled=["gastroc"])
    errors = followed(Episodes(task), expert)
    np.testing.assert_allclose(errors, solution.tracking_error[:31], atol=1e-7)  # another span, other rms accelerations


def test_asked_at_any_node_it_says_what_the_solve_did(leg8, slow, bare):
    """It needs no past: from the solution's own states, in any order, it finds nearly the same excitations."""
    expert = FeedbackExpert(TrackingTask(leg8, slow, dt=DT))
    for k in (150, 3, 77, 76, 179):
        np.testing.assert_allclose(expert(k, bare.state(k)), bare.excitation[k], atol=1e-3)


@pytest.mark.parametrize(("node", "seed"), [(0, 1), (37, 2), (110, 1)])
def test_it_comes_back_from_a_wrong_start(leg8, slow, bare, node, seed):
    """Within half a second, from degrees away; open loop it does not."""
    task = TrackingTask(leg8, slow, dt=DT, noise=np.deg2rad(3))
    errors = np.abs(followed(Episodes(task), FeedbackExpert(task), seed, node)).max(axis=1)
    assert errors[0] > np.deg2rad(1)
    assert errors[50:].max() < 2 * np.abs(bare.tracking_error).max()
    alone = np.abs(followed(Episodes(task), Expert.of(bare, task), seed, node)).max(axis=1)
    assert alone[50:].max() > 10 * errors[50:].max()


def test_it_comes_back_from_a_push(leg8, slow, bare):
    """A kick at .3 s: 50 deg/s at the knee."""
    task = TrackingTask(leg8, slow, dt=DT)

    def push(episodes):
        if episodes.node == 30:
            episodes.plant.mj_data.qvel[1] += np.deg2rad(50)

    errors = np.rad2deg(np.abs(followed(Episodes(task), FeedbackExpert(task), push=push))).max(axis=1)
    assert errors[31:40].max() > 0.3
    assert errors[80:].max() < 2 * np.rad2deg(np.abs(bare.tracking_error).max())


def test_it_answers_however_it_is_disturbed(leg8):
    """Muscles that are pushed hard against each other damp much; it still finds its way at each window."""
    t = expert_trajectories(leg8, "slow", n=3, disturbance=0.3, start="random", noise=0.05)
    assert t.metadata["given_up"] == []
    assert not t.terminated.any()
    np.testing.assert_array_equal(t.node[t.truncated], 179)


def test_it_takes_finer_steps_where_the_tasks_are_too_long(leg8):
    """At a step that a user insists on; by the task's own steps it would find no answer somewhere on this way."""
    with pytest.warns(MjhcmcWarning, match="unstable where all muscles are fully active"):
        t = expert_trajectories(leg8, "slow", n=1, physics_dt=1e-3, disturbance=0.3, noise=0.05, start="random", seed=4)
    assert t.metadata["given_up"] == []
    assert t.node[-1] == 179


def test_where_it_gives_up_is_kept_and_told(leg8, monkeypatch):
    """What was recorded before stands; the episode is truncated there, and the metadata says why."""
    asked = FeedbackExpert.__call__
    at = [0]

    def stubborn(self, node, state):
        at[0] += 1
        if at[0] in (70, 71):  # once within the second episode, once at the third's start
            raise DivergedError("no way on")
        return asked(self, node, state)

    monkeypatch.setattr(FeedbackExpert, "__call__", stubborn)
    with pytest.warns(MjhcmcWarning, match=r"2 of 4 episodes end early, .* episode 1, at 0\.09 s: no way on"):
        t = expert_trajectories(leg8, "fast", n=4)
    assert [(g["episode"], g["node"]) for g in t.metadata["given_up"]] == [(1, 9), (2, 0)]
    np.testing.assert_array_equal(np.bincount(t.episode, minlength=4), [60, 9, 0, 60])
    np.testing.assert_array_equal(np.flatnonzero(t.truncated), [59, 68, 128])
    assert t.returns.shape == (4,)
    assert t.returns[2] == 0
    at[0] = 69
    with pytest.raises(SimulationError, match="no answer at the start of any episode"):
        expert_trajectories(leg8, "fast", n=2)


@pytest.mark.parametrize("movement", ["slow", "fast"])
def test_it_earns_most(leg8, movement):
    """Nearly all that there is, over random starts with noise; others far less."""
    task = TrackingTask(leg8, movement, dt=DT, start="random", noise=np.deg2rad(1))
    rng = np.random.default_rng(0)
    policies = {
        "expert": FeedbackExpert(task),
        "zero": lambda node, state: np.zeros(8),
        "random": lambda node, state: rng.random(8),
        "constant": lambda node, state: np.full(8, 0.05),
        "hold": lambda node, state: state.activation,
    }
    earned = returns(task, policies, n=3, seed=2)
    for name, rows in earned.items():
        assert (rows[:, 0] >= 0).all()
        assert (rows[:, 0] <= rows[:, 1]).all()
        np.testing.assert_array_equal(rows[:, 2], earned["expert"][:, 2])  # the same starts
        if name != "expert":
            assert rows[:, 0].sum() < 0.7 * earned["expert"][:, 0].sum()
    assert earned["expert"][:, 0].sum() > 0.98 * earned["expert"][:, 2].sum()


def test_bad_questions(leg8, slow, bare, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo keeps a log of what diverges
    task = TrackingTask(leg8, slow, dt=DT)
    expert = FeedbackExpert(task)
    with pytest.raises(SettingsError, match="has 180 windows: none begins at node 180"):
        expert(180, bare.state(180))
    with pytest.raises(SettingsError, match="none begins at node 180"):
        Expert.of(bare, task)(180, bare.state(180))
    with pytest.raises(SettingsError, match="gain must be positive"):
        FeedbackExpert(task, gain=0.0)
    with pytest.raises(SettingsError, match="unknown cost 'least'"):
        FeedbackExpert(task, cost="least")
    with pytest.raises(SettingsError, match=r"'foo' is no setting of the expert: choose among trials.* cost, weights"):
        FeedbackExpert(task, foo=1)
    with pytest.raises(SettingsError, match="a task is a TrackingTask; got str"):
        FeedbackExpert("leg8")
    with pytest.raises(DivergedError, match=r"no excitation for the window at 0\.03 s: .* diverged, also with"):
        expert(3, replace(bare.state(3), qvel=np.full(3, 1e200)))
    expert(3, bare.state(3))  # and is itself again


def test_trajectories_hold_together(leg8, written):
    t = written
    assert t.observation.shape == (len(t.time), len(t.observation_names))
    assert t.action.shape == t.applied.shape == (len(t.time), 8)
    assert t.action_names == leg8.muscle_names
    ends = t.terminated | t.truncated
    assert ends.sum() == 3
    np.testing.assert_array_equal(np.flatnonzero(ends), np.flatnonzero(np.diff(t.episode, append=3)))
    np.testing.assert_allclose(t.time, t.node * 0.01, atol=1e-12)
    assert t.returns.shape == (3,)
    assert t.returns.sum() == pytest.approx(t.reward.sum())
    assert np.abs(t.applied - t.action).max() > 0.1  # disturbed
    assert t.applied.min() >= 0
    assert t.applied.max() <= 1
    seen = dict(zip(t.observation_names, t.observation.T, strict=True))
    task = TrackingTask(leg8, "fast")
    way = task.windows.reference.qpos[t.node, 2] - seen["position/ankle"]
    np.testing.assert_allclose(seen["to_desired/ankle/+0"], way, atol=1e-12)


def test_trajectories_follow_from_what_was_applied(leg8, written):
    """The environment under the applied excitations shows the same observations and rewards."""
    task = TrackingTask(leg8, "fast", start="random", noise=0.02)
    episodes = Episodes(task)
    for i in range(3):
        rows = np.flatnonzero(written.episode == i)
        seen = episodes.reset(np.random.default_rng([4, 0, i]))
        for row in rows:
            np.testing.assert_array_equal(task.flat(seen), written.observation[row])
            outcome = episodes.step(written.applied[row])
            assert outcome.reward == written.reward[row]
            np.testing.assert_array_equal(task.flat(outcome.observation), written.next_observation[row])
            seen = outcome.observation


def test_trajectories_of_one_seed_are_the_same(leg8, written):
    again = expert_trajectories(leg8, ["fast"], n=1, disturbance=0.1, seed=4, start="random", noise=0.02)
    np.testing.assert_array_equal(again.action, written.action[written.episode == 0])
    other = expert_trajectories(leg8, "fast", n=1, disturbance=0.1, seed=5, start="random", noise=0.02)
    assert not np.array_equal(other.observation[0], written.observation[0])


@pytest.mark.parametrize("suffix", [".npz", ".parquet"])
def test_trajectories_survive_a_file(tmp_path, written, suffix):
    path = written.save(tmp_path / "new" / f"expert{suffix}")
    assert [one.name for one in path.parent.iterdir()] == [path.name]
    back = Trajectories.load(path)
    for name, value in vars(written).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(getattr(back, name), value)
            assert getattr(back, name).dtype == value.dtype
    assert back.observation_names == written.observation_names
    assert back.action_names == written.action_names
    assert back.metadata == written.metadata
    assert set(back.metadata["versions"]) == {"mjhcmc", "python", "mujoco", "numpy", "scipy", "numba", "qpsolvers"}
    assert len(back.metadata["model_sha256"]) == 64
    assert back.metadata["settings"]["noise"] == 0.02


def test_other_tools_read_them(tmp_path, written):
    table = pd.read_parquet(written.save(tmp_path / "expert.parquet"))
    assert list(table.columns[:4]) == ["time", "episode", "motion", "node"]
    np.testing.assert_array_equal(table["action/soleus"], written.action[:, 6])
    with np.load(written.save(tmp_path / "expert.npz")) as file:
        assert json.loads(str(file["metadata"]))["action_names"][6] == "soleus"


def test_the_models_hash_tells_models_apart(leg8, written):
    from mjhcmc.muscle_parameters import with_muscle_parameters

    weaker = with_muscle_parameters(leg8, {"max_isometric_force": 0.9 * leg8.max_isometric_force})
    motion = mjhcmc.Motion.cosine(leg8, amplitudes={"knee": -0.1}, period=0.1, cycles=1)
    other, same = (expert_trajectories(model, motion, n=1) for model in (weaker, leg8))
    assert other.metadata["model_sha256"] != written.metadata["model_sha256"] == same.metadata["model_sha256"]


def test_the_hashes_tell_motions_and_solutions_apart(leg8, fast):
    """Two cosines have one name."""
    motions = [mjhcmc.Motion.cosine(leg8, amplitudes={"knee": a}, period=0.1, cycles=1) for a in (-0.1, -0.2, -0.1)]
    one, other, same = expert_trajectories(leg8, motions, n=1).metadata["motions"]
    assert one["name"] == other["name"]
    assert one["sha256"] != other["sha256"]
    assert one["sha256"] == same["sha256"]
    solutions = [mjhcmc.hcmc(leg8, motions[0], reserves=False, cost=cost) for cost in ("effort", "cubic")]
    notes = [expert_trajectories(leg8, motions[0], n=1, solution=s).metadata for s in solutions]
    assert len(notes[0]["solution"]) == 64
    assert notes[0]["solution"] != notes[1]["solution"]


def test_metadata_is_strict_json(tmp_path, leg8):
    """JSON has no infinity."""
    motion = mjhcmc.Motion.cosine(leg8, amplitudes={"knee": -0.1}, period=0.1, cycles=1)
    t = expert_trajectories(leg8, motion, n=1, bound=np.inf)
    text = json.dumps(t.metadata, allow_nan=False)
    assert json.loads(text)["settings"]["bound"] == "infinite"


def test_bad_trajectories(tmp_path, leg8, written):
    for choices, words in (
        ({"n": 0}, "n must be a whole number, at least 1; got 0"),
        ({"seed": -1}, "seed must be a whole number, at least 0; got -1"),
        ({"seed": None}, "seed must be a whole number, at least 0; got None"),
        ({"seed": "a"}, "seed must be a whole number, at least 0; got 'a'"),
        ({"disturbance": 2.0}, "disturbance must lie within 0..1; got 2.0"),
        ({"motions": []}, "no motions"),
        ({"nois": 0.1}, "'nois' is no setting of the task"),
    ):
        with pytest.raises(SettingsError, match=words):
            expert_trajectories(leg8, **choices)
    with pytest.raises(OutputError, match=r"use \.npz or \.parquet"):
        written.save(tmp_path / "expert.csv")
    (tmp_path / "in_the_way").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        written.save(tmp_path / "in_the_way" / "expert.npz")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    pd.DataFrame({"x": [1]}).to_parquet(tmp_path / "other.parquet")
    (tmp_path / "other.bin").write_bytes(b"nothing")
    names = ["other.npz", "other.parquet", "other.bin", "none.npz"]
    for suffix in (".npz", ".parquet"):
        whole = written.save(tmp_path / f"whole{suffix}").read_bytes()
        (tmp_path / f"cut{suffix}").write_bytes(whole[: len(whole) // 2])
        (tmp_path / f"empty{suffix}").write_bytes(b"")
        names += [f"cut{suffix}", f"empty{suffix}"]
    with np.load(tmp_path / "whole.npz") as file:
        arrays = dict(file)
    for i, notes in enumerate(("[1]", "{}", '{"observation_names": 3, "action_names": null}', "no JSON")):
        np.savez(tmp_path / f"notes{i}.npz", **{**arrays, "metadata": np.array(notes)})
        names.append(f"notes{i}.npz")
    np.savez(tmp_path / "short.npz", **{**arrays, "action": arrays["action"][:-1]})
    for name in (*names, "short.npz"):
        with pytest.raises(OutputError, match="holds no expert trajectories") as told:
            Trajectories.load(tmp_path / name)
        assert "\n" not in str(told.value)

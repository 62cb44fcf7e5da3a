"""Verdict and replay: thresholds at the joint that breaks them, findings in words, replay against plain mj_step."""

import copy
import dataclasses
import json

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mjhcmc
from mjhcmc import verify
from mjhcmc.solution import WindowStatus

JOINTS = ("hip", "knee", "ankle")


@pytest.fixture(scope="module")
def overloaded(linear_mass):
    """100 N lift 2 kg at 40.19 m/s^2 at most, and this asks for 63."""
    return mjhcmc.hcmc(
        linear_mass, mjhcmc.Motion.cosine(linear_mass, amplitudes={"height": 0.2}, period=0.25, cycles=1)
    )


def synthetic(
    solution, *, reserve=None, error=None, moment=None, shortfall=None, excitation=None, status=None, rotation=None
):
    """A Solution without a model: no reserves, no error, peak moments 100, 10 and 1, but for what is given."""
    n, v = solution.n_window, len(solution.dof_names)
    reserve = np.zeros((n, v)) if reserve is None else reserve
    if moment is None:
        moment = np.tile([100.0, 10.0, 1.0][:v], (n + 1, 1))
        moment[::2] *= -1
    error = np.zeros((n + 1, v)) if error is None else error
    return dataclasses.replace(
        solution,
        reserve=reserve.copy(),
        shortfall=(reserve if shortfall is None else shortfall).copy(),
        tracking_error=error.copy(),
        net_joint_moment=moment.copy(),
        excitation=np.full_like(solution.excitation, 0.5) if excitation is None else excitation,
        status=np.zeros(n, dtype=np.int64) if status is None else status,
        dof_is_rotation=solution.dof_is_rotation.copy() if rotation is None else rotation,
        model=None,
    )


# --- thresholds -------------------------------------------------------------------------------------------------


def test_a_flawless_solution_passes(fast_solution):
    verdict = synthetic(fast_solution).verdict
    assert verdict.passed
    assert verdict.findings == ()
    assert verdict.peak_reserve == verdict.tracking_rms == verdict.tracking_max == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("sign", [1, -1])
def test_a_reserve_may_reach_five_percent_of_its_joints_peak_moment(fast_solution, joint, sign):
    peak = [100.0, 10.0, 1.0][joint]
    for share, passes in ((0.0499, True), (0.0501, False)):
        reserve = np.zeros((60, 3))
        reserve[17, joint] = sign * share * peak
        verdict = synthetic(fast_solution, reserve=reserve).verdict
        assert verdict.passed is passes
        expected = np.zeros(3)
        expected[joint] = share
        np.testing.assert_allclose(verdict.peak_reserve_share, expected, rtol=1e-12)
        assert verdict.peak_reserve[joint] == pytest.approx(share * peak, rel=1e-12)
        (finding,) = verdict.findings
        assert finding.startswith(f"{JOINTS[joint]}: reserve of ")
        assert ("is within 5 %: a note" if passes else "exceeds 5 %") in finding


def test_exactly_five_percent_passes(fast_solution):
    reserve = np.zeros((60, 3))
    reserve[5, 0] = 0.05 * 100.0
    assert synthetic(fast_solution, reserve=reserve).verdict.passed


def test_a_weak_joint_is_measured_by_its_own_peak(fast_solution):
    moment = np.tile([100.0, 10.0, 0.05], (61, 1))
    for newton_meter, passes in ((0.0024, True), (0.0026, False)):
        reserve = np.zeros((60, 3))
        reserve[3, 2] = newton_meter
        assert synthetic(fast_solution, reserve=reserve, moment=moment).verdict.passed is passes


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("sign", [1, -1])
def test_tracking_may_be_one_degree_rms(fast_solution, joint, sign):
    for degrees, passes in ((0.999, True), (1.001, False)):
        error = np.zeros((61, 3))
        error[:, joint] = sign * np.deg2rad(degrees)
        verdict = synthetic(fast_solution, error=error).verdict
        assert verdict.passed is passes
        assert verdict.tracking_rms[joint] == pytest.approx(np.deg2rad(degrees), rel=1e-12)
        assert bool(verdict.findings) is not passes
        assert all(text.startswith(f"{JOINTS[joint]}: tracking RMS 1 deg exceeds 1 deg") for text in verdict.findings)


def test_a_peak_over_a_degree_is_no_rms_over_a_degree(fast_solution):
    error = np.zeros((61, 3))
    error[30, 1] = np.deg2rad(7.8)  # RMS over 61 nodes: 7.8/sqrt(61) = .9987
    verdict = synthetic(fast_solution, error=error).verdict
    assert verdict.passed
    assert np.rad2deg(verdict.tracking_max[1]) == pytest.approx(7.8)
    error[30, 1] = np.deg2rad(7.82)  # 1.0013
    verdict = synthetic(fast_solution, error=error).verdict
    assert not verdict.passed
    (finding,) = verdict.findings
    assert "worst 7.82 deg at 0.300 s" in finding


def test_a_slide_is_judged_in_metres(fast_solution):
    rotation = np.array([True, False, True])
    for metres, passes in ((0.0099, True), (0.0101, False)):
        error = np.zeros((61, 3))
        error[:, 1] = metres
        verdict = synthetic(fast_solution, error=error, rotation=rotation).verdict
        assert verdict.passed is passes
        assert all("0.0101 m exceeds 0.01 m" in text for text in verdict.findings)


def test_an_interrupted_solution_fails_and_says_when(fast_solution):
    verdict = dataclasses.replace(synthetic(fast_solution), interrupted=True).verdict
    assert not verdict.passed
    (finding,) = verdict.findings
    assert finding.startswith("interrupted at 0.600 s")


@settings(max_examples=50, deadline=None)
@given(share=st.lists(st.floats(0, 0.2), min_size=3, max_size=3), rms=st.lists(st.floats(0, 3), min_size=3, max_size=3))
def test_it_passes_where_and_only_where_every_joint_does(fast_solution, share, rms):
    reserve = np.zeros((60, 3))
    reserve[9] = np.array(share) * [100.0, 10.0, 1.0]
    error = np.tile(np.deg2rad(rms), (61, 1))
    verdict = synthetic(fast_solution, reserve=reserve, error=error).verdict
    close = np.any(np.abs(np.array(share) - 0.05) < 1e-9) or np.any(np.abs(np.array(rms) - 1) < 1e-9)
    assert close or verdict.passed == (max(share) < 0.05 and max(rms) < 1)
    named = {text.split(":")[0] for text in verdict.findings if "exceeds" in text}
    assert close or named == {JOINTS[j] for j in range(3) if share[j] > 0.05 or rms[j] > 1}


# --- findings ---------------------------------------------------------------------------------------------------


def test_a_reserve_is_named_with_moment_share_time_and_muscles(fast_solution):
    reserve = np.zeros((60, 3))
    reserve[20:30, 1] = 0.6
    reserve[24, 1] = -0.8
    excitation = np.full((60, 8), 0.5)
    excitation[24, [2, 4]] = 1.0
    excitation[20, 0] = 1.0  # full, but in another window
    (finding,) = synthetic(fast_solution, reserve=reserve, excitation=excitation).verdict.findings
    assert finding == (
        "knee: reserve of -0.8 N m at 0.240 s, 8 % of the peak moment (exceeds 5 %); "
        "at full excitation: rect_fem, vasti"
    )


def test_a_failing_reserve_is_named_whatever_the_windows_status(fast_solution):
    reserve = np.zeros((60, 3))
    reserve[24, 1] = 0.8
    status = np.zeros(60, dtype=np.int64)
    status[24] = WindowStatus.STIFF
    verdict = synthetic(fast_solution, reserve=reserve, status=status).verdict
    assert any(text.startswith("knee: reserve") for text in verdict.findings)
    assert any("1 window, first at 0.240 s" in text and "physics_dt" in text for text in verdict.findings)


def test_a_moment_that_nothing_gave_is_not_measured_as_a_reserve(fast_solution):
    shortfall = np.zeros((60, 3))
    shortfall[24, 1] = 0.8
    verdict = synthetic(fast_solution, shortfall=shortfall).verdict
    assert verdict.passed  # tracking decides
    (finding,) = verdict.findings
    assert finding.startswith("knee: unmet moment of 0.8 N m at 0.240 s, 8 % of the peak moment;")
    assert "within" not in finding


def test_full_excitation_is_the_models_own_limit():
    from conftest import HANGING_MASS, LINEAR_ACTUATOR, load_xml

    limited = LINEAR_ACTUATOR.replace('ctrlrange="0 1"', 'ctrlrange="0 .3"')
    model = load_xml(HANGING_MASS.format(actuator=limited))
    solution = mjhcmc.hcmc(model, mjhcmc.Motion.cosine(model, amplitudes={"height": 0.1}, period=0.4, cycles=1))
    (finding,) = solution.verdict.findings
    assert "at full excitation: pull" in finding


def test_a_real_overload_names_joint_force_and_time_and_that_there_is_no_strength(overloaded):
    verdict = overloaded.verdict
    assert not verdict.passed
    k = int(np.argmax(np.abs(overloaded.reserve[:, 0])))
    assert verdict.peak_reserve[0] == abs(overloaded.reserve[k, 0])
    (finding,) = verdict.findings
    for word in ("height: reserve of", " N at ", f"{overloaded.time[k]:.3f} s", "exceeds 5 %"):
        assert word in finding
    # a muscle cannot push: at the top, 63.2 m/s^2 downward is more than gravity
    assert "no strength: all muscles together have 0 N that way there; silent: pull" in finding
    assert verdict.peak_reserve[0] == pytest.approx(2 * (0.1 * (2 * np.pi / 0.25) ** 2 - 9.81), rel=0.2)


def test_a_verdict_survives_json(fast_solution, overloaded):
    for solution in (fast_solution, overloaded, synthetic(fast_solution)):
        text = json.dumps(solution.verdict.to_dict(), allow_nan=False)
        assert mjhcmc.Verdict.from_dict(json.loads(text)) == solution.verdict


# --- replay -----------------------------------------------------------------------------------------------------


def stepped(solution, first, windows, *, steps):
    """Plain mj_step from a recorded node over windows; qpos at the end of each."""
    m = copy.deepcopy(solution.model.mj_model)
    m.opt.timestep = solution.dt / steps
    d = mujoco.MjData(m)
    d.qpos[:], d.qvel[:], d.act[:] = solution.qpos[first], solution.qvel[first], solution.activation[first]
    rows = []
    for k in windows:
        d.ctrl[:], d.qfrc_applied[:] = solution.excitation[k], solution.reserve[k]
        for _ in range(steps):
            mujoco.mj_step(m, d)
        rows.append(d.qpos.copy())
    return np.array(rows)


def test_open_loop_replay_is_a_plain_simulation_at_a_tenth_of_a_millisecond(fast_solution, overloaded):
    for solution in (fast_solution, overloaded):
        replayed = mjhcmc.replay(solution)
        assert replayed.shape == solution.qpos.shape
        np.testing.assert_array_equal(replayed[0], solution.qpos[0])
        plain = stepped(solution, 0, range(solution.n_window), steps=100)
        np.testing.assert_allclose(replayed[1:], plain, rtol=0, atol=1e-12)


def test_replay_by_windows_starts_each_from_its_recorded_node(fast_solution):
    replayed = mjhcmc.replay_windows(fast_solution)
    np.testing.assert_array_equal(replayed[0], fast_solution.qpos[0])
    for k in range(fast_solution.n_window):
        plain = stepped(fast_solution, k, [k], steps=100)
        np.testing.assert_allclose(replayed[k + 1], plain[0], rtol=0, atol=1e-13)


def test_replay_at_the_solvers_own_step_gives_the_recorded_motion(fast_solution):
    np.testing.assert_allclose(mjhcmc.replay(fast_solution, 1e-3), fast_solution.qpos, rtol=0, atol=1e-12)
    np.testing.assert_allclose(mjhcmc.replay_windows(fast_solution, 1e-3), fast_solution.qpos, rtol=0, atol=1e-13)


def test_a_physics_step_that_does_not_divide_is_rounded_down(fast_solution):
    np.testing.assert_array_equal(mjhcmc.replay(fast_solution, 3e-3), mjhcmc.replay(fast_solution, 2.5e-3))


def test_replay_leaves_the_model_alone(fast_solution):
    m = fast_solution.model.mj_model
    before = m.opt.timestep, m.opt.integrator
    mjhcmc.replay(fast_solution)
    assert (m.opt.timestep, m.opt.integrator) == before


def test_the_true_excitations_replay_and_tampered_ones_show(leg8, slow_solution):
    verdict = slow_solution.verdict
    assert np.rad2deg(max(verdict.replay_max_error)) < 0.02
    assert max(verdict.replay_window_max_error) <= max(verdict.replay_max_error)
    excitation = slow_solution.excitation.copy()
    excitation[60:70, 5] += 0.1  # gastroc, for 100 ms of 1.8 s
    tampered = dataclasses.replace(slow_solution, excitation=excitation)
    assert np.rad2deg(max(tampered.verdict.replay_max_error)) > 1
    error = np.abs(mjhcmc.replay_windows(tampered) - slow_solution.qpos).max(axis=1)
    assert error[61:71].min() > 1000 * np.delete(error, np.arange(61, 71)).max()  # by windows, only theirs are off
    assert tampered.verdict.passed  # replay informs, it does not decide


def test_replay_needs_the_recorded_reserves(overloaded):
    assert max(overloaded.verdict.replay_max_error) < 1e-4
    without = dataclasses.replace(overloaded, reserve=np.zeros_like(overloaded.reserve))
    assert max(without.verdict.replay_max_error) > 0.05


@pytest.mark.parametrize("chunk", [1, 1100])
def test_chunks_give_the_same_bits(fast_solution, monkeypatch, chunk):
    whole = mjhcmc.replay(fast_solution), mjhcmc.replay_windows(fast_solution)
    monkeypatch.setattr(verify, "_CHUNK", chunk)
    np.testing.assert_array_equal(mjhcmc.replay(fast_solution), whole[0])
    np.testing.assert_array_equal(mjhcmc.replay_windows(fast_solution), whole[1])


def test_chunks_give_the_same_bits_under_constraints(monkeypatch):
    """Friction is solved iteratively from where the step before ended: that must cross the seams of the chunks."""
    from conftest import PENDULUMS, load_xml

    model = load_xml(PENDULUMS.replace('name="elbow"', 'name="elbow" frictionloss=".05"'))
    motion = mjhcmc.Motion.cosine(model, amplitudes={"elbow": 0.3, "shoulder": 0.2}, period=0.5, cycles=1)
    solution = mjhcmc.hcmc(model, motion)
    whole = mjhcmc.replay(solution)
    monkeypatch.setattr(verify, "_CHUNK", 100)
    np.testing.assert_array_equal(mjhcmc.replay(solution), whole)


def test_a_solution_from_a_file_cannot_be_replayed(tmp_path, fast_solution):
    loaded = mjhcmc.Solution.load(fast_solution.save(tmp_path / "fast.parquet"))
    for act in (mjhcmc.replay, mjhcmc.replay_windows):
        with pytest.raises(mjhcmc.SimulationError, match=r"read from a file.*solve again to replay") as error:
            act(loaded)
        assert "\n" not in str(error.value)
    assert loaded.verdict == fast_solution.verdict  # the file tells what replay came to

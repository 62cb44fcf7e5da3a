"""Excitations against EMG: comparisons whose answers are known, and signals that say nothing."""

import dataclasses
import json

import numpy as np
import pytest

from mjhcmc.emg import Emg
from mjhcmc.emg_comparison import compare_emg
from mjhcmc.errors import SettingsError


def at_windows(solution, values, shift=0.0):
    """An envelope through values in the middle of each window, shifted in time; channels have the muscles' names."""
    middle = (solution.time[:-1] + solution.time[1:]) / 2
    return Emg(middle + shift, np.maximum(values, 0), solution.muscle_names, raw=False)


def test_a_solution_agrees_with_itself(slow_solution):
    found = compare_emg(slow_solution, at_windows(slow_solution, 3.0 * slow_solution.excitation))
    moving = np.ptp(slow_solution.excitation, axis=0) >= 0.02
    assert moving.sum() >= 5
    for one, moves, others in zip(found.muscles, moving, slow_solution.excitation.T, strict=True):
        assert one.scale == pytest.approx(1 / 3) or not others.any()
        assert one.mae == pytest.approx(0, abs=1e-12)
        if moves:
            assert one.r == pytest.approx(1)
            assert (one.lag, one.rank) == (0, 1)
            assert one.agreement == one.jaccard == 1
            assert one.r_best_others < one.r_best
            assert one.above_others > 0
            assert one.mae_others > 0
        else:
            assert np.isnan(one.r)
            assert np.isnan(one.jaccard)
            assert "hardly varies" in one.reason or "varies by" in one.reason


def test_correlations_are_numpys(fast_solution):
    rng = np.random.default_rng(3)
    values = fast_solution.excitation + 0.2 * rng.random(fast_solution.excitation.shape)
    found = compare_emg(fast_solution, at_windows(fast_solution, values))
    names, u = fast_solution.muscle_names, fast_solution.excitation
    moving = np.ptp(u, axis=0) >= 0.02
    for i, one in enumerate(found.muscles):
        if not moving[i]:
            continue
        assert one.r == pytest.approx(np.corrcoef(u[:, i], values[:, i])[0, 1], rel=1e-9)
        others = [np.corrcoef(u[:, j], values[:, i])[0, 1] for j in range(len(names)) if j != i and moving[j]]
        assert one.r_others == pytest.approx(np.median(others), rel=1e-9)
        k = np.linalg.lstsq(values[:, [i]], u[:, i])[0][0]
        assert one.scale == pytest.approx(k)
        assert one.mae == pytest.approx(np.abs(u[:, i] - k * values[:, i]).mean())


@pytest.mark.parametrize("late", [-0.06, -0.02, 0.0, 0.035, 0.08])
def test_the_lag_is_found(slow_solution, late):
    """Excitation comes `late` after EMG: the envelope is the excitation, that much earlier."""
    found = compare_emg(slow_solution, at_windows(slow_solution, slow_solution.excitation, shift=-late))
    for one in found.muscles:
        if not one.reason:
            assert one.lag == pytest.approx(late, abs=1.1e-3)
            assert one.r_best == pytest.approx(1, abs=1e-4)
            assert one.r <= one.r_best
    none = compare_emg(slow_solution, at_windows(slow_solution, slow_solution.excitation, shift=-late), delay=0.0)
    for one in none.muscles:
        assert one.reason or (one.r == one.r_best and one.lag == 0)


def pulses(solution, *spans):
    """One signal: 1 within spans (windows), else 0."""
    values = np.zeros(solution.n_window)
    for first, last in spans:
        values[first:last] = 1.0
    return values


def with_excitation(solution, column):
    excitation = np.tile(0.1 * np.arange(len(solution.muscle_names)), (solution.n_window, 1))
    excitation[:, 0] = column
    return dataclasses.replace(solution, excitation=excitation)


def test_on_and_off_by_hand(slow_solution):
    name = slow_solution.muscle_names[0]
    solution = with_excitation(slow_solution, pulses(slow_solution, (20, 60), (80, 82), (100, 110)))
    envelope = pulses(slow_solution, (30, 70), (102, 105), (106, 112))
    emg = Emg(at_windows(slow_solution, envelope[:, None] * np.ones(8)).time, envelope[:, None], (name,), raw=False)
    one = compare_emg(solution, emg).muscles[0]
    # 80..82 is too short, the hole at 105 too: u is on in 20..60, 100..110, EMG in 30..70, 102..112
    both, either = 30 + 8, 50 + 12
    assert one.jaccard == pytest.approx(both / either)
    assert one.agreement == pytest.approx(1 - (either - both) / solution.n_window)
    rough = compare_emg(solution, emg, least_duration=0.0).muscles[0]
    assert rough.jaccard == pytest.approx((30 + 7) / (50 + 2 + 12))
    np.testing.assert_equal(one.jaccard_others, np.nan)  # the others are constant


def test_constant_and_tiny_signals_give_a_reason_and_no_number(slow_solution):
    names = slow_solution.muscle_names
    solution = with_excitation(slow_solution, np.linspace(0, 0.019, slow_solution.n_window))
    ramp = np.linspace(0, 1, slow_solution.n_window)
    time = at_windows(slow_solution, slow_solution.excitation).time
    emg = Emg(time, np.column_stack([ramp, np.full_like(ramp, 0.7)]), ("up", "flat"), raw=False)
    tiny, still, flat = compare_emg(solution, emg, {names[0]: "up", names[1]: "up", names[2]: "flat"}).muscles
    assert "excitation varies by 0.019 only" in tiny.reason
    assert "excitation varies by 0 only" in still.reason
    assert "the envelope hardly varies (by 0 at a peak of 0.7)" in flat.reason
    for one in (tiny, still, flat):
        values = (one.r, one.r_best, one.lag, one.rank, one.jaccard, one.agreement, one.above_others)
        assert np.isnan(values).all()
        assert np.isfinite(one.mae)
    text = str(compare_emg(solution, emg, {names[0]: "up"}))
    assert f"notice   {names[0]}: excitation varies by 0.019 only: no correlation" in text


def test_a_channel_is_not_measured_against_its_own_muscles(slow_solution):
    names = slow_solution.muscle_names
    i, j = names.index("rect_fem"), names.index("vasti")
    emg = at_windows(slow_solution, slow_solution.excitation)
    alone = compare_emg(slow_solution, emg, {"rect_fem": "rect_fem"}).muscles[0]
    both = compare_emg(slow_solution, emg, {"rect_fem": "rect_fem", "vasti": "rect_fem"}).muscles[0]
    assert np.corrcoef(slow_solution.excitation[:, [i, j]].T)[0, 1] > 0.5
    assert both.of == alone.of - 1


def test_gaps_are_left_out(slow_solution):
    values = slow_solution.excitation.copy()
    values[40:60] = np.nan
    found = compare_emg(slow_solution, at_windows(slow_solution, values), delay=0.0)
    rest = np.delete(np.arange(slow_solution.n_window), np.arange(40, 60))
    other = np.ones_like(values) * np.linspace(0, 1, len(values))[:, None]
    other[40:60] = np.nan
    ramp = compare_emg(slow_solution, at_windows(slow_solution, other), delay=0.0)
    for i, (one, two) in enumerate(zip(found.muscles, ramp.muscles, strict=True)):
        if not one.reason:
            assert one.r == pytest.approx(1)
            assert two.r == pytest.approx(np.corrcoef(slow_solution.excitation[rest, i], other[rest, i])[0, 1])
        assert one.windows == len(rest)
    almost = np.full_like(values, np.nan)
    almost[:5] = slow_solution.excitation[:5]
    assert (
        compare_emg(slow_solution, at_windows(slow_solution, almost))
        .muscles[0]
        .reason.startswith("the channel has a value in 5 windows only")
    )


def test_start_leaves_out_what_comes_before(slow_solution):
    emg = at_windows(slow_solution, slow_solution.excitation)
    assert compare_emg(slow_solution, emg, start=0.6).time[0] == pytest.approx(0.605)


def test_raw_synthetic_emg_of_a_solution_is_recognised(slow_solution):
    """The whole way: raw EMG whose size follows the excitations, envelopes, comparison."""
    time = np.arange(slow_solution.time[0], slow_solution.time[-1], 1 / 2000)
    rng = np.random.default_rng(0)
    size = [np.interp(time, slow_solution.time[:-1] + 0.005, u) for u in slow_solution.excitation.T]
    signal = np.column_stack([1e-4 * (s + 0.002) * rng.standard_normal(len(time)) for s in size])
    found = compare_emg(slow_solution, Emg(time, signal, slow_solution.muscle_names).envelope())
    moving = [one for one in found.muscles if not one.reason]
    assert len(moving) >= 5
    assert found.medians()["r"] > 0.8
    assert found.medians()["above_others"] > 0.3


def test_table_numbers_and_screen(slow_solution):
    found = compare_emg(slow_solution, at_windows(slow_solution, slow_solution.excitation))
    table = found.to_dataframe()
    assert list(table["muscle"]) == list(slow_solution.muscle_names)
    np.testing.assert_array_equal(table["above_others"], [one.above_others for one in found.muscles])
    numbers = found.numbers()
    assert json.loads(json.dumps(numbers, allow_nan=False)) == numbers
    assert numbers["median"]["r"] == pytest.approx(1)
    text = found.screen()
    for one in found.muscles:
        assert one.muscle in text
    assert "hcmc on leg8" in text


BAD = [
    ({"delay": -0.1}, "delay must lie within 0..1 s"),
    ({"delay": "long"}, "delay must lie within 0..1 s; got 'long'"),
    ({"threshold": 1.0}, "threshold must lie between 0 and 1"),
    ({"least_duration": np.nan}, "least_duration must lie within"),
    ({"start": np.inf}, "start must be a number"),
    ({"lowpass_hz": 80}, "windows of 0.01 s carry less than 50 Hz"),
    ({"start": 1.75}, r"5 of the solution's windows from 1.75 s \(0.000 .. 1.800 s\), at least 10 are needed"),
    ({"mapping": {"sartorius": "soleus"}}, "no muscle sartorius"),
]


@pytest.mark.parametrize(("options", "message"), BAD)
def test_comparisons_that_cannot_be(slow_solution, options, message):
    with pytest.raises(SettingsError, match=message):
        compare_emg(slow_solution, at_windows(slow_solution, slow_solution.excitation), **options)


def test_raw_emg_or_another_thing_is_not_compared(slow_solution):
    with pytest.raises(SettingsError, match="is raw: take its envelope first"):
        compare_emg(slow_solution, Emg(np.arange(9.0), np.eye(9)[:, :1], ("vasti",), raw=True))
    with pytest.raises(SettingsError, match="emg must be an Emg; got ndarray"):
        compare_emg(slow_solution, np.zeros(3))
    with pytest.raises(SettingsError, match=r"0 of the solution's windows .*bring it onto the solution's clock"):
        compare_emg(slow_solution, at_windows(slow_solution, slow_solution.excitation).shifted(10))

"""Sensitivity: the table against differences, intervals against the delta method, draws, figures, the command."""

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest

import mjhcmc
from mjhcmc.gradients import uncertainty
from mjhcmc.gradients.gradient import gradient
from mjhcmc.gradients.spread import draw_factors
from mjhcmc.gradients.table import sensitivity_table
from mjhcmc.gradients.uncertainty import first_order_sd, intervals
from mjhcmc.muscle_parameters import (
    FIBER,
    FORCE,
    FORCE_KINDS,
    KINDS,
    RISE,
    SLACK,
    muscle_parameters,
    parameter_fields,
    with_muscle_parameters,
)
from mjhcmc.plotting import interval_figure, sensitivity_figure

DT, STEP = 0.02, 0.002
CONVERGED = {"trials": 16, "tolerance": 0.0}
SD = {FORCE: 0.1, FIBER: 0.05, SLACK: 0.02}


@pytest.fixture(scope="module")
def slopes(leg8, fast):
    return gradient(leg8, fast, DT, STEP)


@pytest.fixture(scope="module")
def table(slopes):
    return sensitivity_table(slopes)


@pytest.fixture(scope="module")
def drawn(leg8, fast, slopes):
    """Few draws of what the documents draw many of."""
    return intervals(leg8, fast, SD, 6, dt=DT, physics_dt=STEP, first_order=slopes, threads=1)


# --- the table ---------------------------------------------------------------------------------------------------


def test_the_table_is_what_central_differences_give(leg8, fast, table):
    names = f"{SLACK}/gastroc", f"{FORCE}/vasti"
    h, now = 2e-6, muscle_parameters(leg8)  # no active set changes within h: the tightest margin is beyond it
    values = {kind: np.repeat(now[kind][None], 4, axis=0) for kind in (SLACK, FORCE)}
    for row, name in enumerate(names):
        kind, muscle = name.split("/")
        values[kind][2 * row : 2 * row + 2, leg8.muscle_names.index(muscle)] *= (1 + h, 1 - h)
    batch = mjhcmc.hcmc_batch(leg8, fast, DT, STEP, parameters=parameter_fields(leg8, values), threads=1, **CONVERGED)
    for row, name in enumerate(names):
        i = table.names.index(name)
        u = [batch[2 * row + k].excitation for k in (0, 1)]
        points = (u[0] - u[1]) / (2 * h)  # percentage points per 1 %
        near = {"rtol": 1e-4, "atol": 1e-5}
        np.testing.assert_allclose(table.rms[i], np.sqrt((points**2).mean(axis=0)), **near)
        np.testing.assert_allclose(table.mean[i], points.mean(axis=0), **near)
        np.testing.assert_allclose(table.largest[i], points[np.abs(points).argmax(axis=0), np.arange(8)], **near)
        busy = table.rms[i] > 0.01
        at = np.searchsorted(batch[0].time, table.largest_time[i, busy])
        np.testing.assert_allclose(np.abs(points[at, busy]), np.abs(points).max(axis=0)[busy], rtol=1e-3)
        drift = (batch[2 * row].qpos - batch[2 * row + 1].qpos) / (2 * h) / 100
        np.testing.assert_allclose(table.drift[i], np.sqrt((drift**2).mean(axis=0)), rtol=1e-3)


def test_rows_are_sorted_and_kept_in_a_file(table, tmp_path):
    frame = pd.read_csv(table.save(tmp_path / "table.csv"))
    assert len(frame) == 24
    assert frame["size"].is_monotonic_decreasing
    assert set(frame["kind"]) == set(FORCE_KINDS)
    first = frame.iloc[0]
    i = table.names.index(first["parameter"])
    assert first["parameter"] == f"{first['kind']}/{first['muscle']}"
    assert first["rms/soleus"] == pytest.approx(table.rms[i, table.muscle_names.index("soleus")])
    assert first["reserve/knee"] == pytest.approx(table.reserve[i, 1])
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


def test_what_matters_most_is_named(table):
    j = table.muscle_names.index("soleus")
    top = table.top("soleus", 2)
    assert list(top) == [table.names[i] for i in np.argsort(-table.rms[:, j])[:2]]
    kind, muscle = top[0].split("/")
    (line,) = (line for line in table.words() if line.startswith("soleus: "))
    assert f"+1 % of {kind.replace('_', ' ')} of {muscle} moves it by" in line
    with pytest.raises(mjhcmc.SettingsError, match=r"no muscle 'sartorius'.*soleus"):
        table.top("sartorius")


def test_a_larger_change_is_near_more_changes_of_active_sets(slopes, table):
    shares = [sensitivity_table(slopes, change) for change in (1e-6, 0.01, 0.1)]
    assert shares[1].near_any == table.near_any
    assert np.all(np.diff([one.near for one in shares], axis=0) >= 0)
    assert shares[0].near_any < 0.1 < shares[2].near_any <= 1
    worst = int(shares[2].near.argmax())
    assert "valid nearby only" in shares[2].words()[worst]
    assert "valid nearby only" not in shares[0].words()[int(shares[0].near.argmin())]
    with pytest.raises(mjhcmc.SettingsError, match=r"change must be a positive number.*got 0"):
        sensitivity_table(slopes, 0)


def test_changes_of_active_sets_are_about_as_many_as_expected(leg8, fast):
    """To first order: of the windows and muscles that change, and of those said to, more than half are the other's."""
    own, change = gradient(leg8, fast, DT, STEP, parameters=[SLACK]), 0.01
    expected = sensitivity_table(own, change).near
    values = muscle_parameters(leg8)[SLACK] * (1 + change * np.vstack([np.eye(8), -np.eye(8)]))
    batch = mjhcmc.hcmc_batch(
        leg8, fast, DT, STEP, parameters=parameter_fields(leg8, {SLACK: values}), trials=8, tolerance=1e-3, threads=1
    )
    found = np.array([does(solution) != does(own.solution) for solution in batch]).any(axis=0).mean(axis=0)
    assert found.sum() > 0.1
    assert 0.5 < expected.sum() / found.sum() < 2
    assert np.minimum(expected, found).sum() > 0.5 * max(expected.sum(), found.sum())


def does(solution):
    """(N, n_muscle) at which bound a muscle is; between them, whether it rises or falls."""
    u = solution.excitation
    return np.where((u > 1e-9) & (u < 1 - 1e-9), np.sign(u - solution.activation[:-1]), 3 + (u > 0.5))


def test_parameters_that_do_nothing_have_rows_of_zeros(leg8, fast):
    """A muscle that is switched off has no activation that takes time, and no parameter excites it."""
    found = sensitivity_table(gradient(leg8, fast, DT, STEP, parameters=KINDS, disabled=["rect_fem"]))
    for kind in KINDS:
        row = found.rms[found.names.index(f"{kind}/rect_fem")]
        assert np.all(row == 0) == (kind not in (FORCE, FIBER)), kind  # fiber damping, F0/L0, stays
    assert np.all(found.rms[:, 2] == 0)
    assert found.top("rect_fem") == ()
    assert "no parameter moves it" in found.words()[2]


# --- draws -------------------------------------------------------------------------------------------------------


def test_fewer_draws_are_the_first_of_more_and_kinds_do_not_touch_each_other():
    spread = np.full((2, 8), 0.1)
    many = draw_factors(spread, (FORCE, SLACK), 9, seed=3)
    np.testing.assert_array_equal(draw_factors(spread, (FORCE, SLACK), 4, seed=3), many[:4])
    np.testing.assert_array_equal(draw_factors(spread[:1], (SLACK,), 4, seed=3)[:, 0], many[:4, 1])
    assert not np.any(draw_factors(spread, (FORCE, SLACK), 9, seed=4) == many)
    assert len(np.unique(many)) == many.size


@pytest.mark.parametrize("correlation", [0.0, 0.5, 1.0])
def test_factors_have_the_mean_spread_and_correlation_that_were_asked_for(correlation):
    n, sd = 4000, np.array([[0.3, 0.02]])
    f = draw_factors(sd, (FORCE,), n, correlation=correlation)[:, 0]
    assert f.min() > 0
    np.testing.assert_allclose(f.mean(axis=0), 1, atol=4 * 0.3 / np.sqrt(n))  # 4 standard errors
    # 4 standard errors of a standard deviation; log-normal tails at .3 make them about 1.5 times a normal's
    np.testing.assert_allclose(f.std(axis=0), sd[0], rtol=1.5 * 4 / np.sqrt(2 * n))
    assert np.corrcoef(np.log(f).T)[0, 1] == pytest.approx(correlation, abs=4 / np.sqrt(n))


def test_the_formula_is_the_spread_of_the_linear_answer(slopes):
    """Factors put through the gradient alone spread as the formula says, with and without correlation."""
    n, spread = 1500, {kind: np.full(8, 0.5 * value) for kind, value in SD.items()}
    for correlation in (0.0, 0.7):
        factors = draw_factors(np.stack(list(spread.values())), FORCE_KINDS, n, correlation=correlation)
        linear = np.einsum("kjp,np->nkj", slopes.relative, (factors - 1).reshape(n, -1))
        expected = first_order_sd(slopes, spread, correlation)
        moving = expected > 1e-6
        ratio = linear.std(axis=0)[moving] / expected[moving]
        # a sample's standard deviation is known to 1/sqrt(2 n); 4.5 of those, there are some 100 numbers
        np.testing.assert_allclose(ratio, 1, atol=4.5 / np.sqrt(2 * n))


def test_for_small_spreads_the_delta_method_is_what_monte_carlo_finds(leg8, fast, slopes):
    """The same draws, solved and put through the gradient.

    A spread of 1e-4 is small against all margins but one: outside of windows with a margin below what 4 standard
    deviations do, what remains is of second order (1e-4 of the spread) and what the solver leaves.
    """
    n, spread = 8, dict.fromkeys(FORCE_KINDS, 1e-4)
    found = intervals(
        leg8, fast, spread, n, dt=DT, physics_dt=STEP, first_order=slopes, threads=1, **CONVERGED,
    )  # fmt: skip
    linear = np.einsum("kjp,np->nkj", slopes.relative, (found.factors - 1).reshape(n, -1))
    far = (slopes.margin > 4 * first_order_sd(slopes, spread).max(axis=1, keepdims=True)).all(axis=1)
    assert far.mean() > 0.8
    moved = (found.excitation - slopes.solution.excitation)[:, far]
    for j, name in enumerate(found.muscle_names):
        off, size = np.linalg.norm((moved - linear[:, far])[:, :, j]), np.linalg.norm(linear[:, far, j])
        assert off < 0.01 * size, name
    sampled = np.sqrt((found.sd[far] ** 2).mean(axis=0) / (found.first_order_sd[far] ** 2).mean(axis=0))
    # 8 draws: 1/sqrt(14) in each window, less over several of them; 3 of those
    np.testing.assert_allclose(sampled, 1, atol=3 / np.sqrt(2 * (n - 1)))
    assert np.all(np.abs(found.nominal - slopes.solution.excitation) == 0)


# --- intervals ---------------------------------------------------------------------------------------------------


def test_intervals_sum_up_what_was_solved(drawn, leg8):
    assert drawn.excitation.shape == (6, 30, 8)
    np.testing.assert_allclose(drawn.median, np.median(drawn.excitation, axis=0))
    np.testing.assert_allclose(drawn.high, np.quantile(drawn.excitation, 0.95, axis=0))
    np.testing.assert_allclose(drawn.sd, np.std(drawn.excitation, axis=0, ddof=1))
    assert np.all(drawn.low <= drawn.median)
    assert np.all((drawn.at_bound == 1) <= (drawn.sd == 0))  # all at 0, or all at 1
    assert np.all(drawn.clipped > 0)  # 10 % of strength moves when each muscle starts and stops
    assert drawn.failed == {}
    assert drawn.numbers()["muscles"]["soleus"]["width"] == pytest.approx(drawn.width[6])
    assert json.loads(json.dumps(drawn.numbers()))["draws"] == 6


def test_a_draw_is_the_same_whatever_is_solved_beside_it(leg8, fast, slopes, drawn):
    few = intervals(leg8, fast, SD, 2, dt=DT, physics_dt=STEP, first_order=False, threads=2)
    np.testing.assert_array_equal(few.excitation, drawn.excitation[:2])
    assert np.isnan(few.first_order_sd).all()
    assert few.numbers()["muscles"]["soleus"]["ratio"] is None
    own = {kind: muscle_parameters(leg8)[kind][None] * few.factors[1:2, i] for i, kind in enumerate(few.kinds)}
    alone = mjhcmc.hcmc_batch(
        leg8, fast, DT, STEP, parameters=parameter_fields(leg8, own), trials=8, tolerance=1e-3
    )[0]  # fmt: skip
    np.testing.assert_array_equal(alone.excitation, few.excitation[1])


def test_muscles_may_differ(leg8, fast, slopes):
    found = intervals(
        leg8, fast, {FORCE: {"soleus": 0.2}}, 2, dt=DT, physics_dt=STEP, first_order=slopes, threads=1
    )  # fmt: skip
    assert found.kinds == (FORCE,)
    np.testing.assert_array_equal(found.spread, [[0, 0, 0, 0, 0, 0, 0.2, 0]])
    assert np.all((found.factors[:, 0] != 1) == (found.spread[0] > 0))
    np.testing.assert_allclose(found.first_order_sd, 0.2 * np.abs(slopes.relative[:, :, 6]))


def test_draws_that_fail_are_named_and_left_out(leg8, fast, slopes, drawn, monkeypatch):
    def broken(*arguments, **more):
        factors = draw_factors(*arguments, **more)
        factors[1, 1, 4] = 1e-320  # no number of the model's is finite
        return factors

    monkeypatch.setattr(uncertainty, "draw_factors", broken)
    with (
        pytest.warns(mjhcmc.MjhcmcWarning, match=r"1 of 3 simulations failed: simulation 1: .*finite"),
        np.errstate(over="ignore"),
    ):
        found = intervals(leg8, fast, SD, 3, dt=DT, physics_dt=STEP, first_order=slopes, threads=1)
    assert list(found.solved) == [0, 2]
    assert list(found.failed) == [1]
    assert "finite" in found.failed[1]
    np.testing.assert_array_equal(found.excitation, drawn.excitation[[0, 2]])
    assert found.numbers()["failed"] == {"1": found.failed[1]}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"sd": {"strength": 0.1}}, r"'strength' is not known: choose from max_isometric_force, .*deactivation_time"),
        ({"sd": {FORCE: {"sartorius": 0.1}}}, r"sd of max_isometric_force.*sartorius.*soleus"),
        ({"sd": {FORCE: 10}}, r"sd of max_isometric_force of iliopsoas is 10: give a share .*\.1 for 10 %"),
        ({"sd": {FORCE: {"soleus": -0.1}}}, r"of soleus is -0.1"),
        ({"sd": {FORCE: float("nan")}}, r"sd of max_isometric_force of iliopsoas must be finite"),
        ({"sd": {FORCE: "much"}}, r"sd of max_isometric_force must be numbers; got 'much'"),
        ({"sd": {FORCE: [0.1, 0.2]}}, r"has shape \(2,\).*8 muscles"),
        ({"sd": {FORCE: 0}}, r"no parameter varies"),
        ({"sd": {}}, r"no parameter varies"),
        ({"sd": 0.1}, r"sd must map kinds"),
        ({"n": 1}, r"n must be a whole number from 2 to"),
        ({"seed": -1}, r"seed must be a whole number from 0 to"),
        ({"levels": (0.9, 0.1)}, r"levels must be two numbers.*0\.9"),
        ({"levels": (0.5,)}, r"levels must be two numbers"),
        ({"correlation": 2}, r"correlation must be a number within 0 \.\. 1; got 2"),
        ({"sd": {RISE: 0.1}}, r"first_order lacks the parameter 'activation_time/iliopsoas'"),
    ],
)
def test_bad_input_is_named_before_work_begins(leg8, fast, slopes, arguments, words):
    with pytest.raises(mjhcmc.SettingsError, match=words):
        intervals(leg8, fast, **{"first_order": slopes, "dt": DT, "physics_dt": STEP, **arguments})


def test_a_tendon_of_negative_slack_has_no_relative_spread(two_joints):
    motion = mjhcmc.Motion.cosine(two_joints, amplitudes={"shoulder": 0.2}, period=0.6, cycles=1)
    with pytest.raises(mjhcmc.SettingsError, match=r"tendon_slack_length of flexor is -0\.7 m.*leave it out"):
        intervals(two_joints, motion, {SLACK: 0.1}, 2)


# --- figures -----------------------------------------------------------------------------------------------------


def test_the_heat_map_shows_the_table(table):
    figure = sensitivity_figure(table)
    *blocks, bar = figure.axes
    assert [ax.get_title(loc="left") for ax in blocks] == [kind.replace("_", " ") for kind in FORCE_KINDS]
    for block, ax in enumerate(blocks):
        np.testing.assert_array_equal(ax.images[0].get_array(), table.rms[8 * block : 8 * block + 8])
        told = [name.get_text() for name in ax.get_yticklabels()]
        assert told == [name.replace("_", " ") for name in table.muscle_names]
        for text in ax.texts:
            column, row = map(int, text.get_position())
            assert float(text.get_text()) == pytest.approx(table.rms[8 * block + row, column], abs=0.0051)
    assert "percentage points per 1 %" in bar.get_ylabel()


def test_of_many_muscles_those_that_matter_are_drawn(table):
    many, rng = tuple(f"muscle_{i:02d}" for i in range(40)), np.random.default_rng(0)
    rms = rng.uniform(0, 1, (40, 40))
    rms[[3, 17, 30, 38]] = rms[:, [3, 17, 30, 38]] = 0.0
    names = tuple(f"{FORCE}/{muscle}" for muscle in many)
    figure = sensitivity_figure(dataclasses.replace(table, names=names, muscle_names=many, rms=rms))
    block, _ = figure.axes
    kept = np.delete(np.arange(40), [3, 17, 30, 38])
    np.testing.assert_array_equal(block.images[0].get_array(), rms[np.ix_(kept, kept)])
    assert [name.get_text() for name in block.get_xticklabels()] == [many[i].replace("_", " ") for i in kept]
    assert any("4 of 40 muscles left out" in text.get_text() for text in figure.legends[0].get_texts())


def test_directions_have_a_block_of_their_own(leg8, fast):
    steeper = {"steeper": fast.qpos - fast.qpos[0]}
    found = sensitivity_table(gradient(leg8, fast, DT, STEP, parameters=[FORCE], motion_directions=steeper))
    *blocks, _ = sensitivity_figure(found).axes
    assert [ax.get_title(loc="left") for ax in blocks] == ["max isometric force", "direction"]
    assert [name.get_text() for name in blocks[1].get_yticklabels()] == ["steeper"]
    frame = found.to_dataframe().set_index("parameter")
    assert frame.loc["steeper", "kind"] == "direction"
    assert frame.loc["steeper", "muscle"] == ""


def test_bands_are_the_intervals(drawn):
    figure = interval_figure(drawn)
    assert len(figure.axes) == 8
    for j, ax in enumerate(figure.axes):
        by_label = {}
        for patch in ax.patches:
            by_label.setdefault(patch.get_label(), []).append(patch.get_data())
        (band,), (median,) = by_label["interval"], by_label["median"]
        np.testing.assert_array_equal(band.values, drawn.high[:, j])
        np.testing.assert_array_equal(band.baseline, drawn.low[:, j])
        np.testing.assert_array_equal(median.values, drawn.median[:, j])
        low, high = (data.values for data in by_label["first order"])
        np.testing.assert_allclose((high + low) / 2, drawn.nominal[:, j], atol=1e-12)
        np.testing.assert_allclose(high - low, 2 * 1.6448536 * drawn.first_order_sd[:, j], rtol=1e-6, atol=1e-12)
        assert [text.get_text() for text in ax.texts] == [f"{drawn.ratio[j]:.2f}"]


# --- the command -------------------------------------------------------------------------------------------------

QUICK = ("--dt", DT, "--physics-dt", STEP)


def test_the_command_writes_tables_and_figures(run, mot, tmp_path, coarse_figures):
    path, out = mot(period=0.2), tmp_path / "out"
    outcome = run("sensitivity", path, "--samples", 2, "--sd", "tendon_slack_length=0", *QUICK, "--out", out)
    assert outcome.code == 0, outcome.err
    names = {f"{name}.{kind}" for name in ("sensitivity", "intervals") for kind in ("csv", "png", "pdf")}
    assert {path.name for path in out.iterdir()} == names
    table, bands = (pd.read_csv(out / f"{name}.csv") for name in ("sensitivity", "intervals"))
    assert len(table) == 24
    assert len(bands) == 10
    assert (bands["low/soleus"] <= bands["high/soleus"]).all()
    for muscle in ("iliopsoas", "tib_ant"):
        top = table.sort_values(f"rms/{muscle}", ascending=False).iloc[0]
        line = next(line for line in outcome.out.splitlines() if line.startswith(f"{muscle} "))
        assert f"{top['kind'].replace('_', ' ')} of {top['muscle']}" in line
        assert f"{top[f'rms/{muscle}']:.2f}" in line
    assert "of 2 draws" in outcome.out


def test_json_is_one_object(run, tmp_path, no_figures, monkeypatch):
    for name in ("sensitivity_figure", "interval_figure"):
        monkeypatch.setattr(f"mjhcmc.plotting.{name}", lambda found: None)
    out = tmp_path / "out"
    outcome = run("sensitivity", "--movement", "fast", "--samples", 2, "--json", *QUICK, "--out", out)
    assert outcome.code == 0, outcome.err
    found = json.loads(outcome.out, parse_constant=pytest.fail)  # NaN and Infinity are no JSON
    assert (found["model"], found["motion"]) == ("leg8", "fast")
    most = found["table"]["muscles"]["soleus"]["matters_most"]
    assert len(most) == 3
    assert most[0]["rms"] >= most[1]["rms"] > 0
    assert found["intervals"]["spread"][FIBER]["soleus"] == 0.05
    assert found["intervals"]["draws"] == 2
    assert {path.split("/")[-1] for path in found["files"]} == {"sensitivity.csv", "intervals.csv"}


def test_without_samples_there_are_no_intervals(run, tmp_path, no_figures, monkeypatch):
    monkeypatch.setattr("mjhcmc.plotting.sensitivity_figure", lambda found: None)
    out = tmp_path / "out"
    outcome = run("sensitivity", "--samples", 0, "--sd", "activation_time=.1", *QUICK, "--quiet", "--out", out)
    assert outcome.code == 0, outcome.err
    assert outcome.out == ""
    assert [path.name for path in out.iterdir()] == ["sensitivity.csv"]
    assert set(pd.read_csv(out / "sensitivity.csv")["kind"]) == {*FORCE_KINDS, RISE}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--sd", "strength=.1"), ("'strength'", "max_isometric_force")),
        (("--sd", "max_isometric_force"), ("--sd 'max_isometric_force'", "KIND=VALUE")),
        (("--sd", "max_isometric_force=ten"), ("KIND=VALUE", "within 0 .. 1")),
        (("--sd", "max_isometric_force=10"), ("within 0 .. 1", ".1 for 10 %")),
        (("--sd", "max_isometric_force=nan"), ("within 0 .. 1",)),
        (("--sd", "max_isometric_force=.1", "--sd", "max_isometric_force=.2"), ("given twice",)),
        (("--sd", "max_isometric_force=0", "--sd", "optimal_fiber_length=0", "--sd", "tendon_slack_length=0"),
         ("no parameter varies",)),
        (("--samples", "1"), ("--samples 1", "2 draws or more")),
        (("--samples", "-1"), ("--samples",)),
        (("--seed", "-1"), ("--seed",)),
        (("--movement", "hop"), ("'hop'", "fast", "slow")),
        (("--lowpass", "6"), ("--lowpass", "MOTION")),
        (("walk.mot", "--movement", "slow"), ("walk.mot", "--movement slow", "one of them")),
        (("none.mot",), ("none.mot", "no such file")),
        (("--dt", "0"), ("--dt", "positive")),
        (("--dt", "9"), ("dt 9 s", "longer than the motion")),
        (("--physics-dt", "nan"), ("--physics-dt",)),
        (("--model", "leg9"), ("'leg9'", "leg8")),
        (("--model", "leg8_gait"), ("leg8_gait", "no gradient")),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_exit_code_2(run, tmp_path, arguments, words):
    outcome = run("sensitivity", *arguments, "--out", tmp_path / "deep" / "out")
    assert outcome.code == 2
    assert outcome.out == ""
    (line,) = outcome.errors
    assert line.startswith("mjhcmc: error: ")
    for word in words:
        assert word in line
    assert not (tmp_path / "deep").exists()


def test_the_output_folder_must_be_one(run, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    outcome = run("sensitivity", "--out", tmp_path / "file")
    assert outcome.code == 2
    assert "cannot be written" in outcome.errors[0]


def test_a_gradient_of_something_else_is_refused(leg8, fast, slopes):
    other = mjhcmc.Motion(fast.time, 0.5 * fast.qpos, "half")
    stronger = with_muscle_parameters(leg8, {FORCE: 1.1 * leg8.max_isometric_force})
    with pytest.raises(mjhcmc.SettingsError, match="another motion or settings"):
        intervals(leg8, other, {FORCE: 0.01}, 2, first_order=slopes)
    with pytest.raises(mjhcmc.SettingsError, match="another motion or settings"):
        intervals(leg8, fast, {FORCE: 0.01}, 2, first_order=slopes, min_activation=0.01)
    with pytest.raises(mjhcmc.SettingsError, match="other muscles"):
        intervals(stronger, fast, {FORCE: 0.01}, 2, first_order=slopes)
    with pytest.raises(mjhcmc.SettingsError, match="a Gradient, True or False"):
        intervals(leg8, fast, {FORCE: 0.01}, 2, first_order="yes")

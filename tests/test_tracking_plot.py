"""Tracking and residuals: which degrees of freedom are drawn, in which units, and what is told of them."""

from dataclasses import replace

import numpy as np
import pytest
from plot_tools import legend, line, make, pixels, rooted, steps, titles, with_roles

from mjhcmc.errors import SettingsError
from mjhcmc.plotting import residual_figure, tracking_figure

# ------------------------------------------------------------------ tracking


@pytest.mark.parametrize("count", [1, 2, 3, 5, 12])
def test_three_panels_for_each_joint(count):
    solution = make(dofs=[f"joint_{i}" for i in range(count)], n=5)
    figure = tracking_figure(solution)
    assert len(figure.axes) == 3 * count
    for j in range(count):
        angle, error, moment = figure.axes[3 * j : 3 * j + 3]
        assert angle.get_title(loc="left") == f"joint {j}"
        np.testing.assert_allclose(line(angle, "desired")[1], np.rad2deg(solution.qpos_desired[:, j]))
        np.testing.assert_allclose(line(angle, "actual")[1], np.rad2deg(solution.qpos[:, j]))
        np.testing.assert_allclose(line(error, "tracking error")[1], np.rad2deg(solution.tracking_error[:, j]))
        np.testing.assert_array_equal(line(moment, "net joint moment")[1], solution.net_joint_moment[:, j])


def test_the_largest_error_is_marked_and_told_in_the_units_of_its_axis():
    error = np.zeros((31, 2))
    error[7] = np.deg2rad([-0.5, 2.5e-4])
    error[9] = np.deg2rad([0.25, -1e-4])
    figure = tracking_figure(replace(make(dofs=("hip", "knee")), tracking_error=error))
    hip, knee = figure.axes[1], figure.axes[4]
    time, value = line(hip, "max")
    np.testing.assert_allclose([time[0], value[0]], [0.67, -0.5])
    assert "max 0.5 deg at 0.67 s" in [t.get_text() for t in hip.texts]
    assert hip.get_ylabel() == "error (deg)"
    assert "max 250×10⁻⁶ deg at 0.67 s" in [t.get_text() for t in knee.texts]
    assert knee.get_ylabel() == "error (10⁻⁶ deg)"
    ticks = dict(zip(knee.get_yticks(), knee.yaxis.get_major_formatter().format_ticks(knee.get_yticks()), strict=True))
    assert all(float(label.replace("−", "-")) == pytest.approx(1e6 * tick) for tick, label in ticks.items())


def test_a_slide_is_shown_in_meters_and_newtons():
    solution = make(dofs=("hip", "pelvis_ty"), slides=("pelvis_ty",))
    angle, error, force = tracking_figure(solution).axes[3:]
    np.testing.assert_array_equal(line(angle, "actual")[1], solution.qpos[:, 1])
    np.testing.assert_array_equal(line(error, "tracking error")[1], solution.tracking_error[:, 1])
    assert angle.get_ylabel() == "position (m)"
    assert error.get_ylabel().endswith("m)")
    assert "deg" not in error.get_ylabel()
    assert force.get_ylabel() == "force (N)"


def test_the_reserve_is_filled_and_its_share_told_or_that_it_is_zero():
    solution = make()
    reserve = np.zeros_like(solution.reserve)
    reserve[3, 2] = -0.3 * solution.peak_moment[2]
    figure = tracking_figure(replace(solution, reserve=reserve, shortfall=reserve.copy()))
    for j in range(3):
        ax = figure.axes[3 * j + 2]
        (fill,) = steps(ax, "reserve")
        assert fill.get_fill()
        np.testing.assert_array_equal(fill.get_data().values, reserve[:, j])
        np.testing.assert_array_equal(fill.get_data().edges, solution.time)
    notes = [figure.axes[3 * j + 2].texts[0].get_text() for j in range(3)]
    assert notes[:2] == ["reserve zero"] * 2
    assert notes[2] == f"reserve {0.3 * solution.peak_moment[2]:.3g} N m, 30 % of peak"


def test_where_reserves_are_off_the_unmet_moment_is_drawn():
    shortfall = np.ones((30, 3))
    figure = tracking_figure(replace(make(), shortfall=shortfall))
    assert steps(figure.axes[2], "unmet")
    assert not steps(figure.axes[2], "reserve")
    assert "unmet moment" in legend(figure)


def test_a_perfect_and_motionless_solution_draws():
    still = np.zeros((31, 3))
    solution = replace(make(), qpos=still, qpos_desired=still.copy(), tracking_error=still, net_joint_moment=still)
    figure = tracking_figure(solution)
    pixels(figure)
    assert all(np.diff(ax.get_ylim())[0] > 0 for ax in figure.axes)


def test_only_what_is_tracked_is_shown_and_at_the_root_a_residual():
    solution = make(dofs=("px", "tilt", "hip", "patella", "knee", "toe"))
    roles = ["prescribed", "tracked", "tracked", "dependent", "tracked", "free"]
    reserve = np.full((30, 6), 5.0)
    solution = replace(with_roles(solution, roles, root=["px", "tilt"]), reserve=reserve)
    figure = tracking_figure(solution)
    assert titles(figure) == ["tilt", "hip", "knee"]
    assert figure.axes[2].texts[0].get_text() == "residual 5 N m"
    assert figure.axes[5].texts[0].get_text().startswith("reserve 5 N m")
    np.testing.assert_array_equal(line(figure.axes[5], "net joint moment")[1], solution.net_joint_moment[:, 2])


def test_where_nothing_is_tracked_everything_is_shown():
    assert titles(tracking_figure(with_roles(make(), ["prescribed", "free", "dependent"]))) == ["hip", "knee", "ankle"]


def test_of_many_joints_those_that_move_carry_or_err_most_are_shown_in_order():
    names = [f"joint_{i}" for i in range(40)]
    solution, still = make(dofs=names, n=10), np.zeros((11, 40))
    qpos, error, moment, reserve = still.copy(), still.copy(), np.ones((11, 40)), np.zeros((10, 40))
    qpos[5, 31] = 1.0
    error[3, 7] = 1e-3
    moment[4, 22] = 80.0
    moment[:, 39] = 1e-2
    reserve[2, 39] = 2e-2  # the only one whose reserve is larger than its moment
    reserve[2, 5] = 0.5
    figure = tracking_figure(
        replace(solution, qpos_desired=qpos, qpos=qpos + error, tracking_error=error, net_joint_moment=moment,
                reserve=reserve, shortfall=reserve.copy())
    )  # fmt: skip
    shown = [int(title.split()[1]) for title in titles(figure)]
    assert len(shown) == 12
    assert {31, 7, 22, 39, 5} <= set(shown)
    assert shown == sorted(shown)
    assert legend(figure)[-1] == "28 of 40 tracked left out: those that move, carry and err least"
    assert max(figure.get_size_inches()) < 16


def test_a_joint_that_stands_still_is_drawn_as_standing_still():
    figure = tracking_figure(replace(make(), qpos=np.full((31, 3), 1e-6), qpos_desired=np.zeros((31, 3))))
    low, high = figure.axes[0].get_ylim()
    assert low < -0.4
    assert high > 0.4


def test_a_ball_is_shown_by_its_turn_from_where_the_motion_starts():
    n, angle = 30, np.linspace(0, 1.2, 31)
    start = np.array([np.cos(0.2), 0, 0, np.sin(0.2)])  # .4 about z
    qpos = np.empty((n + 1, 5))
    qpos[:, 0] = 0.3
    for k in range(n + 1):  # then about the body's own x
        w, x = np.cos(angle[k] / 2), np.sin(angle[k] / 2)
        qpos[k, 1:] = start[0] * w, start[0] * x, start[3] * x, start[3] * w
    ball = replace(
        make(dofs=("slide", "neck_rx", "neck_ry", "neck_rz"), slides=("slide",)), qpos=qpos, qpos_desired=qpos.copy(),
        coordinate_names=("slide", "neck_qw", "neck_qx", "neck_qy", "neck_qz"),
    )  # fmt: skip
    figure = tracking_figure(ball)
    np.testing.assert_array_equal(line(figure.axes[0], "actual")[1], 0.3)
    np.testing.assert_allclose(line(figure.axes[3], "actual")[1], np.rad2deg(angle), atol=1e-9)
    for ax in (figure.axes[6], figure.axes[9]):
        np.testing.assert_allclose(line(ax, "actual")[1], 0, atol=1e-9)


# ------------------------------------------------------------------ residuals


def test_residuals_are_drawn_forces_before_moments_and_their_peaks_told():
    solution = rooted()
    figure = residual_figure(solution)
    assert titles(figure) == ["pelvis tx", "pelvis ty", "pelvis tilt"]
    assert [ax.get_ylabel() for ax in figure.axes] == ["force (N)", "force (N)", "moment (N m)"]
    top = [ax.get_position().y0 for ax in figure.axes]
    assert top[0] == pytest.approx(top[1])
    assert top[2] < top[0]
    for ax, j, unit in zip(figure.axes, (1, 2, 0), ("N", "N", "N m"), strict=True):
        values = solution.residual[:, j]
        np.testing.assert_array_equal(line(ax, "residual")[1], values)
        k = np.argmax(np.abs(values))
        rms = np.sqrt((values**2).mean())
        told = f"peak {abs(values[k]):.3g} {unit} at {solution.time[k]:.4g} s, RMS {rms:.3g}"
        assert ax.texts[0].get_text() == told
        assert [a[0] for a in line(ax, "peak")] == [solution.time[k], values[k]]


def test_of_many_residuals_the_largest_are_drawn():
    solution = rooted(20)
    figure = residual_figure(solution)
    assert len(figure.axes) == 12 + 1
    peak = np.abs(solution.residual[:, 1:20]).max(axis=0)
    expected = [solution.dof_names[1 + i].replace("_", " ") for i in sorted(np.argsort(-peak)[:12])]
    assert titles(figure)[:12] == expected
    assert legend(figure)[-1] == "7 of 20 left out: those with the lowest peaks"


def test_without_a_residual_there_is_nothing_to_draw():
    with pytest.raises(SettingsError, match="no residual"):
        residual_figure(with_roles(make(), ["prescribed", "tracked", "tracked"]))

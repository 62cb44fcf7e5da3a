"""A solution on the screen: the load from outside that joint moments of a user's own imply."""

import dataclasses

import numpy as np
import pytest

from mjhcmc.summary import numbers, screen


@pytest.fixture
def loaded(slow_solution):
    """A copy of a solution under a load from outside; factors of the net joint moment's peak, by joint."""

    def loaded(factors, difference=None, name="given.sto"):
        load = np.zeros_like(slow_solution.external_load)
        load[3] = -np.array(factors) * slow_solution.peak_moment
        settings = {**slow_solution.settings, "joint_moments": name}
        if difference is not None:
            settings["joint_moment_difference"] = difference
        return dataclasses.replace(
            slow_solution, external_load=load, settings=settings, stored_verdict=slow_solution.verdict
        )

    return loaded


def lines_of(solution, *begins):
    return [line for line in screen(solution).splitlines() if line.startswith(begins)]


def test_without_a_load_there_is_no_line(slow_solution):
    assert numbers(slow_solution)["peak_external_load_nm"] is None
    assert not lines_of(slow_solution, "load", "moments")
    assert "are these joint moments" not in screen(slow_solution)


def test_the_peak_load_and_its_share(loaded):
    solution = loaded([0.25, 0.5, 1.0])
    peak = solution.peak_moment
    values = numbers(solution)["peak_external_load_nm"]
    assert list(values) == ["hip", "knee", "ankle"]
    np.testing.assert_allclose(list(values.values()), [0.25, 0.5, 1.0] * peak)
    assert lines_of(solution, "load") == [
        "load     peak from outside, implied by given.sto: "
        f"hip {0.25 * peak[0]:.3g} N m (25 % of the net joint moment's peak), "
        f"knee {0.5 * peak[1]:.3g} N m (50 % of the net joint moment's peak), "
        f"ankle {peak[2]:.3g} N m (100 % of the net joint moment's peak)"
    ]
    assert "are these joint moments" not in screen(solution)


def test_a_load_beyond_the_moments_is_doubted(loaded):
    text = screen(loaded([0.25, 1.5, 1.1]))
    assert "larger than the net joint moment at knee, ankle: are these joint moments, in N m?" in text
    own_plant = screen(loaded([0.25, 1.5, 1.1], name=None))
    assert "peak from outside: hip" in own_plant
    assert "are these joint moments" not in own_plant


def test_the_difference_from_the_given_moments(loaded):
    solution = loaded([0.1, 0.1, 0.1], {"hip": 0.1234, "knee": 2.0, "ankle": 0})
    assert lines_of(solution, "moments") == [
        "moments  largest difference from those given: hip 0.123 N m, knee 2 N m, ankle 0 N m"
    ]


def test_angles_given_for_moments_are_doubted_on_the_screen(run, mot, tmp_path, no_figures, slow_solution):
    """The motion's own angles, in a table that names no unit: degrees far beyond the moments of a swing."""
    path, moments = mot(), tmp_path / "angles.csv"
    rows = np.linspace(0, 0.6, 121)
    angle = 5 * (1 - np.cos(2 * np.pi * rows / 0.6))
    table = zip(rows, angle, angle, 3 * angle, strict=True)
    moments.write_text("time,hip,knee,ankle\n" + "".join(",".join(map(str, row)) + "\n" for row in table))
    outcome = run("solve", path, "--moments", moments, "--out", tmp_path / "out")
    assert outcome.code in (0, 1)
    assert f"load     peak from outside, implied by {moments}: hip " in outcome.out
    assert "moments  largest difference from those given: hip " in outcome.out

"""The Millard curves: OpenSim's own tables, calculus, and bad input."""

import ast
from pathlib import Path

import numpy as np
import pytest

from mjhcmc.hill import (
    ActiveForceLength,
    BezierCurve,
    Corner,
    ForceVelocity,
    PassiveForceLength,
    active_force_length,
    force_velocity,
    passive_force_length,
)

DATA = Path(__file__).parent / "data"
CURVES = {"active": active_force_length(), "passive": passive_force_length(), "velocity": force_velocity()}


def table(name: str) -> np.ndarray:
    return np.loadtxt(DATA / name, delimiter=",", comments="#", skiprows=2)


@pytest.mark.parametrize(
    ("curve", "file", "column"),
    [
        ("active", "millard_force_length.csv", 1),
        ("passive", "millard_force_length.csv", 2),
        ("velocity", "millard_force_velocity.csv", 1),
    ],
)
def test_agrees_with_opensim(curve: str, file: str, column: int) -> None:
    reference = table(file)
    assert len(reference) > 50
    assert np.ptp(reference[:, column]) > 0.9  # the table covers the curve
    np.testing.assert_allclose(CURVES[curve](reference[:, 0]), reference[:, column], rtol=0, atol=1e-6)


@pytest.mark.parametrize("curve", CURVES.values(), ids=CURVES)
def test_derivative_is_the_slope(curve: BezierCurve) -> None:
    x = np.linspace(-1.3, 2.2, 701) + 1e-4
    step = 1e-6
    slope = (curve(x + step) - curve(x - step)) / (2 * step)
    np.testing.assert_allclose(curve.derivative(x), slope, atol=5e-6)


def test_known_points() -> None:
    active, passive, velocity = CURVES["active"], CURVES["passive"], CURVES["velocity"]
    np.testing.assert_allclose(active([0.4441, 1.0, 1.8123]), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(passive([0.5, 1.0, 1.7]), [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(velocity([-1.0, 0.0, 1.0]), [0, 1, 1.4], atol=1e-12)
    assert velocity.derivative(0.0) == pytest.approx(5.0)
    assert passive.derivative(1.7) == pytest.approx(2 / 0.7)


def test_linear_beyond_the_ends() -> None:
    passive = CURVES["passive"]
    np.testing.assert_allclose(passive([1.8, 2.5]), 1 + 2 / 0.7 * np.array([0.1, 0.8]))
    np.testing.assert_allclose(CURVES["velocity"]([-3.0, 4.0]), [0.0, 1.4])


def test_parameters_move_the_curves() -> None:
    assert active_force_length(ActiveForceLength(max_norm_length=1.6))(1.6) == pytest.approx(0.0)
    assert force_velocity(ForceVelocity(max_eccentric_multiplier=1.8))(1.0) == pytest.approx(1.8)
    assert passive_force_length(PassiveForceLength(strain_at_one_norm_force=0.4))(1.4) == pytest.approx(1.0)


def test_shapes_and_nan() -> None:
    curve = CURVES["active"]
    assert curve(1.0).shape == ()
    assert curve(np.ones((2, 3))).shape == (2, 3)
    values = curve(np.array([np.nan, 1.0]))
    assert np.isnan(values[0])
    assert values[1] == pytest.approx(1.0)
    assert np.isnan(curve.derivative(np.nan))


def test_a_bezier_through_collinear_corners_is_the_line() -> None:
    line = BezierCurve([Corner(0, 1, 2), Corner(1, 3, 2), Corner(3, 7, 2)], curviness=0.3)
    x = np.linspace(-1, 4, 101)
    np.testing.assert_allclose(line(x), 1 + 2 * x, atol=1e-12)
    np.testing.assert_allclose(line.derivative(x), 2, atol=1e-12)


@pytest.mark.parametrize(
    ("corners", "curviness"),
    [
        ([Corner(0, 0, 0)], 0.5),
        ([Corner(0, 0, 0), Corner(0, 1, 0)], 0.5),
        ([Corner(0, 0, 0), Corner(1, 1, 0)], 1.5),
        ([Corner(0, 0, 0), Corner(1, 1, 0)], -0.1),
    ],
)
def test_bad_curves_are_refused(corners: list[Corner], curviness: float) -> None:
    with pytest.raises(ValueError, match="BezierCurve"):
        BezierCurve(corners, curviness)


def test_hill_stands_alone() -> None:
    import mjhcmc.hill

    for path in Path(mjhcmc.hill.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = (
                [alias.name for alias in node.names]
                if isinstance(node, ast.Import)
                else [node.module or ""]
                if isinstance(node, ast.ImportFrom)
                else []
            )
            for name in names:
                assert not name.startswith("mujoco"), path
                assert not name.startswith("mjhcmc") or name.startswith("mjhcmc.hill"), path

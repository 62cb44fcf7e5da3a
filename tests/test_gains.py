"""Sharing among muscles whose gain is not MuJoCo's muscle; choices that are no numbers."""

import numpy as np
import pytest
from conftest import load_xml
from test_sharing import ANGLE, ARM, ARMS, METHODS, MOMENT, STRENGTH, held, start

import mjhcmc

PASSIVE = 40.0  # N, at any length


PUSHER = f"""
  <actuator>
    <general name="long" joint="elbow" gear="-.05" dyntype="muscle" dynprm=".01 .04" gaintype="fixed" gainprm="-300"
      biastype="affine" biasprm="{-PASSIVE} 0 0" ctrlrange="0 1"/>
    <general name="short" joint="elbow" gear=".03" dyntype="muscle" dynprm=".01 .04" gaintype="fixed" gainprm="500"
      biastype="affine" biasprm="{-PASSIVE} 0 0" ctrlrange="0 1"/>
  </actuator>
</mujoco>"""


def plain_arm(long, short):
    """The arm with muscles of other gains, (type, parameters) each, and a constant passive force."""
    actuators = "".join(
        f'<general name="{name}" joint="elbow" gear="-{arm}" dyntype="muscle" dynprm=".01 .04" gaintype="{kind}" '
        f'gainprm="{prm}" biastype="affine" biasprm="{-PASSIVE} 0 0" ctrlrange="0 1"/>'
        for name, arm, (kind, prm) in zip(("long", "short"), ARMS, (long, short), strict=True)
    )
    return load_xml(ARM[: ARM.index("<actuator>")] + f"<actuator>{actuators}</actuator></mujoco>")


@pytest.mark.parametrize("cost", ["stress", "capacity"])
def test_fixed_gains_are_forces_at_full_activation(cost):
    """min sum (F/F0)^2 with sum r F = M, F0 being the gain: F_i = lambda r_i F0_i^2; the gain is the capacity, too."""
    model = plain_arm(("fixed", "-300"), ("fixed", "-500"))
    np.testing.assert_array_equal(model.max_isometric_force, STRENGTH)
    share = ARMS * STRENGTH**2
    activation, force = start(model, cost=cost)
    np.testing.assert_allclose(force, share * MOMENT / (ARMS @ share), rtol=1e-7)
    np.testing.assert_allclose(activation, (force - PASSIVE) / STRENGTH, rtol=1e-6)


def test_capacity_needs_no_max_isometric_force():
    """F_i = lambda r_i gain_i^2, where gains change with length and nobody knows F0."""
    model = plain_arm(("affine", "-300 1000 0"), ("affine", "-500 2000 0"))
    gain = np.array([300, 500]) + np.array([1000, 2000]) * ARMS * ANGLE
    share = ARMS * gain**2
    activation, force = start(model, cost="capacity")
    np.testing.assert_allclose(force, share * MOMENT / (ARMS @ share), rtol=1e-7)
    np.testing.assert_allclose(activation, (force - PASSIVE) / gain, rtol=1e-6)


def test_capacity_of_a_muscle_that_pushes():
    """It counts by the size of its gain: being no use here, it rests, with a price that the other does not pay for."""
    model = plain_arm(("fixed", "-300"), ("fixed", "100"))
    activation, _ = start(model, cost="capacity")
    assert activation == pytest.approx([(MOMENT - ARMS.sum() * PASSIVE) / (ARMS[0] * 300), 0], abs=1e-7)
    down = mjhcmc.Motion(np.linspace(0, 0.1, 11), np.full((11, 1), -0.3))  # held up from behind: only pushing helps
    moment = 10 * 9.81 * 0.15 * np.sin(-0.3)
    solution = mjhcmc.static_optimization(model, down, cost="capacity")
    need = (ARMS.sum() * PASSIVE - moment) / (ARMS[1] * 100)
    assert need > 1  # so that it pushes all it can
    assert solution.activation[0] == pytest.approx([0, 1], abs=1e-6)


def test_capacity_of_a_muscle_that_bends_by_pushing():
    """Least sum (a + P/|gain|)^2 with B a = Q: it shares the work by the size of its gain."""
    model = load_xml(ARM[: ARM.index("<actuator>")] + PUSHER)
    gain, B = np.array([300.0, 500.0]), np.array([0.05 * 300, 0.03 * 500])
    a0, Q = -PASSIVE / gain, MOMENT - (0.05 - 0.03) * PASSIVE
    solution = mjhcmc.static_optimization(model, held(model), cost="capacity")
    np.testing.assert_allclose(solution.activation[0], a0 + B * (Q - B @ a0) / (B @ B), rtol=1e-6)


@pytest.mark.parametrize("gains", [("affine", "0 0 0"), ("affine", "-1e-9 0 0"), ("fixed", "0"), ("fixed", "1e-9")])
def test_capacity_where_gain_vanishes(gains):
    """A muscle that gives nothing rests, whatever it is; where none gives anything all do."""
    activation, _ = start(plain_arm(("fixed", "-300"), gains), cost="capacity")
    assert activation == pytest.approx([(MOMENT - ARMS.sum() * PASSIVE) / (ARMS[0] * 300), 0], abs=1e-6)
    model = plain_arm(gains, gains)
    nothing = mjhcmc.static_optimization(model, held(model), cost="capacity")
    assert np.isfinite(nothing.activation).all()


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"weights": {"vasti": True}}, r"weights of vasti must be a number; got True"),
        ({"weights": {"vasti": None}}, r"weights of vasti must be a number; got None"),
        ({"weights": [True] * 8}, r"weights must be numbers; got True"),
        ({"weights": np.ones(8, dtype=bool)}, r"weights must be numbers; got True"),
        ({"weights": {"vasti": 10**400}}, r"weights must be numbers; got \{'vasti': 1000"),
        ({"min_activation": True}, r"min_activation must be numbers; got True"),
        ({"smoothness": True}, r"smoothness must be 0 or positive; got True"),
    ],
)
def test_truth_is_no_number(leg8, slow, choice, message):
    for method in METHODS:
        with pytest.raises(mjhcmc.SettingsError, match=message):
            method(leg8, slow, **choice, progress=pytest.fail)

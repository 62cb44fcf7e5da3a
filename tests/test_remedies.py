"""What a message says of a joint that an equality ties: which joints to move or name instead."""

import numpy as np
import pytest
from conftest import load_xml
from test_roles import ARM, SLIDES, TIE

import mjhcmc
from mjhcmc.motion_on_model import fit_to_model

TENDON = '<tendon tendon1="bend"/>'  # elbow + 2 wrist stays


@pytest.mark.parametrize(
    ("equality", "message"),
    [
        (TIE.format("wrist", "elbow"), "leave it out and move 'elbow' instead, which 'wrist' follows, or correct"),
        (TENDON, "leave it out and move 'elbow' instead, which 'wrist' follows, or correct"),
        (TIE.format("wrist", "x") + TIE.format("x", "z"), "leave it out and move 'z' instead, which 'wrist' follows"),
        ('<joint joint1="wrist" polycoef=".2 0 0 0 0"/>', r"leave 'wrist' out \(it stays there\), or correct"),
    ],
)
def test_a_motion_that_moves_a_tied_joint(equality, message):
    model = load_xml(ARM.format(root=SLIDES, more="", equality=equality, origin="a"))
    time = np.linspace(0, 1, 9)
    qpos = np.zeros((9, 4))
    qpos[:, 3] = 0.5 * np.sin(3 * time)
    with pytest.raises(mjhcmc.MotionError, match=message) as raised:
        fit_to_model(mjhcmc.Motion(time, qpos, "walk"), model)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("equality", "message"),
    [
        (TIE.format("wrist", "elbow"), "others: name 'elbow', which it follows, or remove the equality"),
        (TENDON, "others: name 'elbow', which it follows, or remove the equality"),
        (TIE.format("wrist", "x") + TIE.format("x", "z"), "others: name 'z', which it follows, or remove"),
        ('<joint joint1="wrist" polycoef=".2 0 0 0 0"/>', "others: name the joint that it follows, or remove"),
    ],
)
def test_a_role_for_a_tied_joint(equality, message):
    model = load_xml(ARM.format(root=SLIDES, more="", equality=equality, origin="a"))
    for asking in (model, model.with_roles(free=["elbow"])):
        with pytest.raises(mjhcmc.SettingsError, match=message):
            asking.with_roles(prescribed=["wrist"])

"""Input that makes no muscle or has no answer: one line that names the muscle and the value, and nothing clipped."""

import ast
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mjhcmc.hill
from mjhcmc.hill import (
    FirstOrderActivation,
    HillError,
    HillModel,
    MuscleParameters,
    SmoothActivation,
    degroote_fregly2016,
    dynamic_equilibrium,
    fiber_length_along,
    fiber_velocity,
    millard2012,
    mujoco_curves,
    pennation_angle,
    rigid_tendon,
    static_equilibrium,
    thelen2003,
)

GOOD: dict[str, Any] = {
    "max_isometric_force": [1000.0, 500.0],
    "optimal_fiber_length": [0.1, 0.05],
    "tendon_slack_length": [0.2, 0.3],
    "pennation_at_optimal": [0.0, 0.4],
    "names": ["vasti", "soleus"],
}


def model(**changes: Any) -> HillModel:
    return HillModel(MuscleParameters(**{**GOOD, **changes}), millard2012())


def refused(call: Callable[[], Any], *words: str) -> None:
    with pytest.raises(HillError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message, message


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("max_isometric_force", [1000.0, 0.0], ("soleus", "0 N")),
        ("max_isometric_force", [-5.0, 500.0], ("vasti", "-5")),
        ("optimal_fiber_length", [0.1, -0.05], ("soleus", "-0.05 m")),
        ("optimal_fiber_length", 0.0, ("vasti", "0 m")),
        ("tendon_slack_length", [-0.2, 0.3], ("vasti", "-0.2 m")),
        ("pennation_at_optimal", [0.0, np.pi / 2], ("soleus", "1.5708 rad", "90 deg")),
        ("pennation_at_optimal", [0.0, 25.0], ("soleus", "25 rad", "radians")),
        ("pennation_at_optimal", [-0.1, 0.0], ("vasti", "-0.1 rad")),
        ("max_fiber_velocity", [10.0, 0.0], ("soleus", "max_fiber_velocity is 0")),
        ("fiber_damping", [0.1, -0.1], ("soleus", "-0.1")),
        ("max_isometric_force", [np.nan, 1.0], ("vasti", "nan")),
        ("optimal_fiber_length", [0.1, np.inf], ("soleus", "inf")),
        ("optimal_fiber_length", [0.1, 0.1, 0.1], ("shapes", "(3,)")),
        ("optimal_fiber_length", [[0.1, 0.1]], ("shapes", "(1, 2)")),
        ("optimal_fiber_length", "long", ("optimal_fiber_length", "'long'")),
        ("names", ["vasti"], ("1 muscle names for 2",)),
    ],
)
def test_parameters(name: str, value: Any, words: tuple[str, ...]) -> None:
    refused(lambda: model(**{name: value}), *words)


@pytest.mark.parametrize("solve", [static_equilibrium, rigid_tendon])
@pytest.mark.parametrize(
    ("a", "length", "words"),
    [
        ([0.5, 1.2], [0.3, 0.35], ("soleus", "activation", "1.2")),
        ([-0.01, 0.5], [0.3, 0.35], ("vasti", "activation", "-0.01")),
        ([0.5, np.nan], [0.3, 0.35], ("soleus", "nan")),
        (0.5, [0.3, -0.35], ("soleus", "musculotendon_length", "-0.35")),
        (0.5, [0.0, 0.35], ("vasti", "musculotendon_length", "is 0")),
        (0.5, [np.inf, 0.35], ("vasti", "inf")),
        (0.5, [[0.3, 0.35], [0.3, 0.3]], ("soleus at index 1", "musculotendon_length", "0.3")),  # all of it is tendon
        (0.5, [[0.3, 0.35], [0.15, 0.35]], ("vasti at index 1", "0.15")),
        (0.5, [0.3, 0.35, 0.4], ("(3,)", "2 muscles")),
        (0.5, [[0.3], [0.35]], ()),
        ("much", [0.3, 0.35], ("activation", "'much'")),
    ],
)
def test_states(solve: Callable[..., Any], a: Any, length: Any, words: tuple[str, ...]) -> None:
    if words:
        refused(lambda: solve(model(), a, length), *words)
    else:
        assert solve(model(), a, np.array(length) + 0.05).shape == (2, 2)


def test_lengths_without_equilibrium() -> None:
    # Millard's fiber makes no force under .4441 of its optimal length: nothing can straighten a tendon that loose.
    refused(lambda: static_equilibrium(model(), 0.5, [0.24, 0.35]), "vasti", "0.24", "no equilibrium", "slack")
    # Thelen's and De Groote and Fregly's pull even at their shortest.
    for curves, length in ((thelen2003(), 0.2011), (degroote_fregly2016(), 0.2201)):
        muscle = HillModel(MuscleParameters(1000.0, 0.1, 0.2, names="vasti"), curves)
        refused(
            lambda m=muscle, x=length: static_equilibrium(m, 1.0, x), "vasti", "no equilibrium", "even at its short"
        )
    stiff = HillModel(MuscleParameters(1000.0, 0.1, 0.2, names="vasti"), thelen2003())
    refused(lambda: static_equilibrium(stiff, 0.5, 100.0), "vasti", "100", "beyond all reason")
    refused(lambda: dynamic_equilibrium(model(), 0.01, [0.3, 0.35], -0.9), "vasti", "no equilibrium", "push")


def test_the_second_chunk_is_named_as_well() -> None:
    length = np.full((9000, 2), 0.36)
    length[8500, 1] = 0.31
    refused(lambda: static_equilibrium(model(), 0.5, length), "soleus at index 8500", "0.31")
    thelen = HillModel(MuscleParameters(**GOOD), thelen2003())
    length = np.full((9000, 2), 0.36)
    length[7000, 0] = 0.2011
    refused(lambda: static_equilibrium(thelen, 1.0, length), "vasti at index 7000", "0.2011")


def test_a_compliant_tendon_needs_length() -> None:
    without = model(tendon_slack_length=[0.2, 0.0])
    assert np.all(rigid_tendon(without, 0.5, [0.3, 0.05]).tendon_force > 0)  # a muscle without tendon is one
    refused(lambda: static_equilibrium(without, 0.5, [0.3, 0.05]), "soleus", "tendon_slack_length is 0", "rigid tendon")
    refused(lambda: fiber_velocity(without, 0.5, [0.1, 0.05], [0.3, 0.1]), "soleus", "tendon_slack_length is 0")


def test_mujocos_curves_have_no_tendon() -> None:
    muscle = HillModel(MuscleParameters(**GOOD), mujoco_curves())
    refused(lambda: static_equilibrium(muscle, 0.5, [0.3, 0.35]), "MuJoCo", "no tendon")
    refused(lambda: fiber_velocity(muscle, 0.5, 0.06, [0.3, 0.35]), "MuJoCo", "no tendon")


def test_fibers_that_cannot_be() -> None:
    short = 0.05 * np.sin(0.4) * 0.99
    for call in (pennation_angle, fiber_length_along):
        refused(lambda call=call: call(model(), [0.1, short]), "soleus", "fiber_length", "90 deg")
    refused(lambda: fiber_velocity(model(), 0.5, [0.1, short], 0.35), "soleus", "90 deg")
    refused(lambda: fiber_velocity(model(), 0.5, [0.3, 0.05], 0.3), "vasti", "fiber_length is 0.3", "no length is left")
    refused(lambda: fiber_velocity(model(), 0.5, [0.0, 0.05], 0.3), "vasti", "fiber_length is 0")


def test_undamped_fibers_without_an_answer() -> None:
    bare = model(fiber_damping=0.0)
    refused(lambda: fiber_velocity(bare, [0.0, 0.5], [0.1, 0.05], [0.303, 0.35]), "vasti", "fiber_damping")
    refused(lambda: fiber_velocity(bare, 0.5, [0.03, 0.05], [0.232, 0.35]), "vasti", "fiber_damping")
    refused(lambda: fiber_velocity(bare, 0.1, [0.1, 0.05], [0.31, 0.35]), "vasti", "force-velocity multiplier", "1.4")


@pytest.mark.parametrize("dynamics", [FirstOrderActivation(), SmoothActivation()])
def test_activation_dynamics(dynamics: FirstOrderActivation | SmoothActivation) -> None:
    refused(lambda: dynamics.rate([0.5, 1.1], 0.5), "excitation at index 1 is 1.1")
    refused(lambda: dynamics.rate(0.5, -0.2), "activation is -0.2")
    refused(lambda: dynamics.rate(0.5, np.full((2, 2), np.nan)), "activation at index (0, 0) is nan")
    refused(lambda: dynamics.rate([0.1, 0.2], [0.1, 0.2, 0.3]), "(2,)", "(3,)")
    kind = type(dynamics)
    refused(lambda: kind(tau_act=0.0), "tau_act is 0")
    refused(lambda: kind(tau_deact=float("inf")), "tau_deact is inf")


def test_activation_constants() -> None:
    refused(lambda: FirstOrderActivation(smoothing=-1.0), "smoothing is -1")
    refused(lambda: SmoothActivation(sharpness=0.0), "sharpness is 0")


def test_parameters_cannot_change() -> None:
    muscles = MuscleParameters(**GOOD)
    with pytest.raises(ValueError, match="read-only"):
        muscles.max_isometric_force[0] = 1
    with pytest.raises(AttributeError):
        muscles.names = ("a", "b")  # type: ignore[misc]


def test_only_numpy_is_imported() -> None:
    roots = set()
    for path in Path(mjhcmc.hill.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                roots |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                roots.add(node.module or "")
    foreign = {name for name in roots if not name.startswith("mjhcmc.hill")}
    standard = {"__future__", "collections.abc", "dataclasses", "itertools", "typing"}
    assert foreign <= standard | {"numpy", "numpy.typing"}

"""Equations of motion on any scalar type, against MuJoCo, against each other and against what must be so."""

import re

import mujoco
import numpy as np
import pytest
from exact_tools import OBLIQUE, TURNED, engine_of, furthest, model_of, states

from mjhcmc.errors import ModelError, SettingsError
from mjhcmc.exact import dynamics, leg, scalars
from mjhcmc.exact.chain import chain_of
from mjhcmc.exact.leg import planar_leg_of
from mjhcmc.exact.reference import floats
from mjhcmc.exact.scalars import COMPLEX, FLOAT, LONGDOUBLE

FORTY = scalars.mpmath(40)
TYPES = {
    "float": FLOAT,
    "complex": COMPLEX,
    "longdouble": LONGDOUBLE,
    "mpmath": FORTY,
    "arb": scalars.flint_arb(40),
    "acb": scalars.flint_acb(40),
}


@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("name", ["leg8", "oblique", "turned"])
def test_dynamics_agree_with_mujoco(name, kind):
    chain, m, d = engine_of(name)
    s = TYPES[kind]
    for q, v, torque in states(m.nv, 3):
        d.qpos[:], d.qvel[:], d.qfrc_applied[:] = q, v, torque
        mujoco.mj_forward(m, d)
        M = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, d, M)
        np.testing.assert_allclose(floats(dynamics.mass_matrix(chain, q, s), s), M, rtol=0, atol=1e-13)
        np.testing.assert_allclose(floats([dynamics.bias(chain, q, v, s)], s)[0], d.qfrc_bias, rtol=0, atol=1e-12)
        found = floats([dynamics.forward_dynamics(chain, q, v, torque, s)], s)[0]
        np.testing.assert_allclose(found, d.qacc, rtol=1e-12, atol=1e-12 * np.abs(d.qacc).max())
        a = np.array(d.qacc)
        mujoco.mj_inverse(m, d)
        found = floats([dynamics.inverse_dynamics(chain, q, v, a, s)], s)[0]
        np.testing.assert_allclose(found, d.qfrc_inverse, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["leg8", "turned"])
def test_closed_form_agrees_with_the_recursions(name):
    # turned: its axes are floats, parallel exactly; what is normalised is so to all digits
    chain = chain_of(model_of(name))
    planar = planar_leg_of(chain)
    for q, v, torque in states(chain.n, 2):
        assert furthest(leg.mass_matrix(planar, q, FORTY), dynamics.mass_matrix(chain, q, FORTY), FORTY) < 1e-38
        assert furthest(leg.bias(planar, q, v, FORTY), dynamics.bias(chain, q, v, FORTY), FORTY) < 1e-37
        one, other = (
            f(x, q, v, torque, FORTY) for f, x in ((leg.inverse_dynamics, planar), (dynamics.inverse_dynamics, chain))
        )
        assert furthest(one, other, FORTY) < 1e-37
        one, other = (
            f(x, q, v, torque, FORTY) for f, x in ((leg.forward_dynamics, planar), (dynamics.forward_dynamics, chain))
        )
        assert furthest(one, other, FORTY) < 1e-35


def test_forward_and_inverse_dynamics_undo_each_other():
    chain = chain_of(model_of("oblique"))
    for q, v, torque in states(chain.n, 2):
        a = dynamics.forward_dynamics(chain, q, v, torque, FORTY)
        back = dynamics.inverse_dynamics(chain, q, v, a, FORTY)
        assert furthest(back, [FORTY.number(x) for x in torque], FORTY) < 1e-36


def test_bias_is_lagranges():
    """d/dt of dT/dq' minus dT/dq, plus dV/dq, by complex steps at 60 digits: an oracle without recursion or signs."""
    s = scalars.flint_acb(60)
    chain = chain_of(model_of("oblique"))
    n = chain.n
    (q, v, _), *_ = states(n, 1)
    tiny = "1e-40"
    with s.working():
        x, y = [s.number(value) for value in q], [s.number(value) for value in v]
        import flint

        h = flint.arb(tiny)
        step = flint.acb(0, h)

        def moved(values, i, by=step):
            return [value + by if j == i else value for j, value in enumerate(values)]

        slope = [dynamics.total_energy(chain, moved(x, i), y, s).imag / h for i in range(n)]
        rest = [dynamics.total_energy(chain, moved(x, i), [s.number(0.0)] * n, s).imag / h for i in range(n)]
        along = [a + step * b for a, b in zip(x, y, strict=True)]
        rate = [[entry.imag / h for entry in row] for row in dynamics.mass_matrix(chain, along, s)]
        # (dM/dt) v - dT/dq + dV/dq = (dM/dt) v - dE/dq + 2 dV/dq
        expected = [
            float((sum((rate[i][j] * y[j].real for j in range(n)), flint.arb(0)) - slope[i] + 2 * rest[i]).mid())
            for i in range(n)
        ]
    np.testing.assert_allclose(expected, dynamics.bias(chain, q, v, FLOAT), rtol=0, atol=1e-12)


def test_kinetic_energy_is_that_of_the_mass_matrix():
    chain = chain_of(model_of("oblique"))
    (q, v, _), *_ = states(chain.n, 1)
    still = dynamics.total_energy(chain, q, np.zeros(chain.n), FLOAT)
    kinetic = dynamics.total_energy(chain, q, v, FLOAT) - still
    assert kinetic == pytest.approx(0.5 * v @ np.array(dynamics.mass_matrix(chain, q, FLOAT)) @ v, rel=1e-13)


@pytest.mark.parametrize("name", ["leg8", "oblique"])
def test_complex_steps_agree_with_central_differences(name):
    chain = chain_of(model_of(name))
    (q, v, torque), *_ = states(chain.n, 1)
    h, d = 1e-30, 1e-5
    for i in range(chain.n):
        e = np.eye(chain.n)[i]
        for at in (0, 1):
            args = [q, v, torque]
            stepped = [[complex(x, h * e[j] * (k == at)) for j, x in enumerate(row)] for k, row in enumerate(args)]
            exact = np.array([x.imag / h for x in dynamics.forward_dynamics(chain, *stepped, COMPLEX)])
            ends = []
            for sign in (1, -1):
                moved = [row + sign * d * e * (k == at) for k, row in enumerate(args)]
                ends.append(np.array(dynamics.forward_dynamics(chain, *moved, FLOAT)))
            np.testing.assert_allclose((ends[0] - ends[1]) / (2 * d), exact, rtol=1e-6, atol=1e-6 * np.abs(exact).max())


class Opaque:
    """A number that knows + - * / and nothing else: any question about its value fails, as a symbol's would."""

    __hash__ = None

    def __init__(self, value):
        self.hidden = float(getattr(value, "hidden", value))

    def __add__(self, other):
        return Opaque(self.hidden + Opaque(other).hidden)

    def __sub__(self, other):
        return Opaque(self.hidden - Opaque(other).hidden)

    def __rsub__(self, other):
        return Opaque(Opaque(other).hidden - self.hidden)

    def __mul__(self, other):
        return Opaque(self.hidden * Opaque(other).hidden)

    def __truediv__(self, other):
        return Opaque(self.hidden / Opaque(other).hidden)

    def __rtruediv__(self, other):
        return Opaque(Opaque(other).hidden / self.hidden)

    def __neg__(self):
        return Opaque(-self.hidden)

    def __bool__(self):
        raise AssertionError("a symbol has no truth")

    __radd__, __rmul__ = __add__, __mul__
    __lt__ = __gt__ = __le__ = __ge__ = __eq__ = __abs__ = __float__ = lambda self, *_: self.__bool__()


@pytest.mark.parametrize("name", ["leg8", "oblique"])
def test_nothing_branches_on_a_value(name):
    def of(function):
        return lambda x: Opaque(function(x.hidden)) if isinstance(x, Opaque) else function(x)

    functions = (of(f) for f in (np.sin, np.cos, np.sqrt, np.exp, np.log))
    symbols = scalars.Scalars("symbols", 53, float, *functions, size=float, real=float)
    chain = chain_of(model_of(name))
    (q, v, torque), *_ = states(chain.n, 1)
    a, b, c = ([Opaque(x) for x in row] for row in (q, v, torque))

    def check(found, plain):
        np.testing.assert_allclose([x.hidden for x in found], plain, rtol=1e-12)

    check(dynamics.forward_dynamics(chain, a, b, c, symbols), dynamics.forward_dynamics(chain, q, v, torque, FLOAT))
    check(dynamics.inverse_dynamics(chain, a, b, c, symbols), dynamics.inverse_dynamics(chain, q, v, torque, FLOAT))
    if name == "leg8":
        planar = planar_leg_of(chain)
        check(leg.forward_dynamics(planar, a, b, c, symbols), leg.forward_dynamics(planar, q, v, torque, FLOAT))
        check(leg.inverse_dynamics(planar, a, b, c, symbols), leg.inverse_dynamics(planar, q, v, torque, FLOAT))


def test_casadi_evaluates_to_the_same():
    ca = pytest.importorskip("casadi")
    s = scalars.casadi()
    chain = chain_of(model_of("oblique"))
    args = [ca.SX.sym(name, chain.n) for name in ("q", "v", "t")]
    out = dynamics.forward_dynamics(chain, *(ca.vertsplit(x) for x in args), s)
    of = ca.Function("f", args, [ca.vertcat(*out)])
    for q, v, torque in states(chain.n, 2):
        plain = dynamics.forward_dynamics(chain, q, v, torque, FLOAT)
        np.testing.assert_allclose(np.array(of(q, v, torque)).ravel(), plain, rtol=1e-11)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (('type="slide" axis="-1 .2 .3"', 'type="ball"'), "ball joint 'slide'"),
        (('name="knee"', 'name="knee" stiffness="3"'), "spring of joint 'knee'"),
        (('name="knee"', 'name="knee" frictionloss="3"'), "frictionloss 3 of joint 'knee'"),
        (('<joint name="knee"', '<joint name="twist"/><joint name="knee"'), "'shank' with 2 joints"),
        (('name="shank"', 'name="shank" gravcomp="1"'), "gravity compensation of body 'shank'"),
        (('gravity="1 -2 -9"', 'gravity="1 -2 -9" density="1.2"'), "medium (density 1.2"),
        (("</worldbody>", '</worldbody><equality><joint name="tie" joint1="hip" joint2="knee"/></equality>'), "'tie'"),
        (
            (
                "</worldbody>",
                '</worldbody><tendon><fixed name="band" stiffness="9"><joint joint="hip" coef="1"/></fixed></tendon>',
            ),
            "stiffness of tendon 'band'",
        ),
    ],
)
def test_what_the_equations_do_not_hold_is_refused(change, named):
    assert change[0] in OBLIQUE
    m = mujoco.MjModel.from_xml_string(OBLIQUE.replace(*change))
    with pytest.raises(ModelError, match=re.escape(named)) as error:
        chain_of(m)
    assert "\n" not in str(error.value)


def test_a_model_without_joints_is_refused():
    with pytest.raises(ModelError, match="no joint"):
        chain_of(mujoco.MjModel.from_xml_string("<mujoco/>"))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (OBLIQUE, "'slide' is a slide"),
        (
            TURNED.replace('axis="2 4 4"', 'axis="2 4 3"'),
            f"axis of joint 'c' is {np.rad2deg(np.arccos(16 / 3 / 29**0.5)):.3g} deg",
        ),
        (re.sub(r'<body name="slider".*?</body>\s*</body>', "", OBLIQUE, flags=re.S), "axis of joint 'branch'"),
    ],
)
def test_the_closed_form_refuses_what_is_not_planar(text, named):
    with pytest.raises(ModelError, match=named):
        planar_leg_of(mujoco.MjModel.from_xml_string(text))


def test_a_branch_is_not_a_row():
    side = '<body name="d"><joint name="d" axis="1 2 2"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
    text = TURNED.replace('<body name="b"', side + '<body name="b"')
    with pytest.raises(ModelError, match="joint 'b' does not hang from the one before"):
        planar_leg_of(mujoco.MjModel.from_xml_string(text))


def test_switches_of_the_model_are_obeyed():
    text = OBLIQUE.replace('contact="disable"', 'contact="disable" gravity="disable"')
    chain = chain_of(mujoco.MjModel.from_xml_string(text))
    assert dynamics.bias(chain, np.ones(chain.n), np.zeros(chain.n), FLOAT) == pytest.approx(np.zeros(chain.n), abs=0)


def test_wrong_lengths_and_settings_are_named():
    chain = chain_of(model_of("leg8"))
    planar = planar_leg_of(chain)
    with pytest.raises(SettingsError, match=r"v has 2 values; chain .* has 3 joints"):
        dynamics.bias(chain, [0.0] * 3, [0.0] * 2, FLOAT)
    with pytest.raises(SettingsError, match=r"torque has 4 values; leg .* has 3 joints"):
        leg.forward_dynamics(planar, [0.0] * 3, [0.0] * 3, [0.0] * 4, FLOAT)
    with pytest.raises(SettingsError, match="either digits or bits"):
        scalars.mpmath(30, bits=100)
    with pytest.raises(SettingsError, match="not within"):
        scalars.flint_arb(100000)


def test_an_absent_package_is_named_with_its_remedy(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "flint", None)
    with pytest.raises(SettingsError, match=r"python-flint is not installed: pip install python-flint, or .*precision"):
        scalars.flint_arb(77)


@pytest.mark.parametrize("kind", ["mpmath", "arb"])
def test_numbers_have_their_own_digits(kind):
    """Two precisions side by side do not disturb each other, nor what the package was set to."""
    make = {"mpmath": scalars.mpmath, "arb": scalars.flint_arb}[kind]
    few, many = make(20), make(60)
    third = []
    for s in (few, many, few):
        with s.working():
            third.append(s.size(s.number(1.0) / 3 - s.number("0." + "3" * 90)))
    assert 1e-23 < third[0] < 1e-20 or third[0] == 0
    assert third[1] < 1e-60
    assert third[2] == third[0]
    assert FORTY.number("0.1") != FORTY.number(0.1)  # a string is all the digits, a float itself

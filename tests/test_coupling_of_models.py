"""Coupling: where equalities put dependent degrees of freedom, against closed forms, differences and MuJoCo's rows."""

import mujoco
import numpy as np
import pytest
from conftest import load_xml
from numpy.testing import assert_allclose, assert_array_equal

import mjhcmc
from mjhcmc.motion_on_model import fit_to_model
from mjhcmc.roles import equality_jacobian

HINGES = """
<mujoco model="chain">
  <option integrator="RK4"/>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0" size=".02" mass=".5"/></default>
  <worldbody>
    <site name="o" pos=".1 0 .2"/>
    <body><joint name="a" axis="0 1 0"/><geom/><site name="s" pos=".05 0 -.1"/>
      <body pos="0 0 -.3"><joint name="b" axis="1 0 0" ref="{ref_b}"/><geom/>
        <body pos="0 0 -.3"><joint name="c" axis="0 1 0" ref="{ref_c}"/><geom/>
          <body pos="0 0 -.3"><joint name="d" type="slide" axis="0 0 1"/><geom/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="path"><site site="o"/><site site="s"/></spatial>
    <fixed name="ab"><joint joint="a" coef="1"/><joint joint="b" coef="-2"/></fixed>
    <fixed name="cd"><joint joint="c" coef=".5"/><joint joint="d" coef="4"/></fixed>
  </tendon>
  <equality>{equality}</equality>
  <actuator><muscle name="m" tendon="path" force="100" lengthrange=".05 1"/></actuator>
</mujoco>
"""

FOUR_BAR = """
<mujoco model="four_bar">
  <option integrator="RK4"/>
  <default><geom contype="0" conaffinity="0" size=".02" mass=".5"/></default>
  <worldbody>
    <site name="o" pos=".2 0 .1"/>
    <body name="crank"><joint name="crank" axis="0 -1 0"/><geom/><site name="s" pos=".1 0 .1"/>
      <body name="coupler" pos="0 0 .3"><joint name="coupler" axis="0 -1 0"/><geom/></body>
    </body>
    <body name="rocker" pos=".5 0 0"><joint name="rocker" axis="0 -1 0"/><geom/></body>
    {more}
  </worldbody>
  <tendon><spatial name="path"><site site="o"/><site site="s"/></spatial></tendon>
  <equality>{equality}</equality>
  <actuator><muscle name="m" tendon="path" force="100" lengthrange=".05 1"/></actuator>
</mujoco>
"""


def chain(equality, ref_b=0.0, ref_c=0.0):
    return load_xml(HINGES.format(equality=equality, ref_b=ref_b, ref_c=ref_c))


def four_bar(equality='<connect body1="coupler" body2="rocker" anchor=".5 0 .1"/>', more=""):
    return load_xml(FOUR_BAR.format(equality=equality, more=more))


def tie(y, x, *c):
    of = f'joint2="{x}"' if x else ""
    return f'<joint joint1="{y}" {of} polycoef="{" ".join(str(v) for v in c)}"/>'


B_OF_A, C_OF_B = (0.1, -0.6, 0.3, 0.2, -0.1), (-0.2, 0.5, 0.4, 0.0, 0.3)
TOOL = '<body name="tool" pos=".2 .1 0"><freejoint name="tool"/><geom/></body>'

MODELS = {
    "one": chain(tie("b", "a", *B_OF_A)),
    "chain": chain(tie("c", "b", *C_OF_B) + tie("b", "a", *B_OF_A)),  # the follower's first
    "chain, references": chain(tie("b", "a", *B_OF_A) + tie("c", "b", *C_OF_B), ref_b=0.4, ref_c=-0.7),
    "to a slide": chain(tie("d", "a", 0, 0.2, 0, -0.1, 0)),
    "constant": chain(tie("c", "", 0.3, 0, 0, 0, 0) + tie("d", "c", 0.1, 2, 0, 0, 0)),
    "tendon": chain('<tendon tendon1="ab"/>'),
    "two tendons": chain(f'<tendon tendon1="cd" tendon2="ab" polycoef="0 .7 .2 0 0"/>{tie("b", "a", *B_OF_A)}'),
    "four-bar": four_bar(),
    "four-bar, said twice": four_bar(2 * '<connect body1="coupler" body2="rocker" anchor=".5 0 .1"/>'),
    "ball at the coupler": four_bar('<connect body1="coupler" body2="tool" anchor=".1 0 .1"/>', TOOL),
    "weld": four_bar('<weld body1="crank" body2="tool"/>', TOOL),
}


@pytest.fixture(params=MODELS)
def model(request):
    return MODELS[request.param]


def independents(model):
    return np.setdiff1d(np.arange(model.nv), model.roles.dependent)


def near(model, count=5, size=0.15):
    """Positions near the reference pose that keep to the equalities no more."""
    way = np.random.default_rng(3).normal(size=(count, model.nv)) * size
    return model.coordinates.moved(np.tile(model.mj_model.qpos0, (count, 1)), way)


def rows(model, qpos):
    """MuJoCo's own Jacobian (ne, nv) and violation (ne,) of the equalities."""
    m, d = model.mj_model, mujoco.MjData(model.mj_model)
    d.qpos[:] = qpos
    mujoco.mj_forward(m, d)
    return equality_jacobian(m, d), d.efc_pos[: d.ne].copy()


def test_projected_positions_meet_mujocos_equalities(model):
    qpos = near(model)
    assert max(np.abs(rows(model, row)[1]).max() for row in qpos) > 0.01
    for row in model.coupling.project(qpos):
        assert_allclose(rows(model, row)[1], 0, atol=1e-10)


def test_projection_moves_dependent_degrees_of_freedom_alone_and_once(model):
    qpos = near(model)
    found = model.coupling.project(qpos)
    moved = model.coordinates.difference(found, qpos)
    assert_allclose(moved[:, independents(model)], 0, atol=1e-12)
    assert np.abs(moved[:, model.roles.dependent]).max() > 0.01
    assert_allclose(model.coupling.project(found), found, rtol=0, atol=1e-10)
    assert found.shape == qpos.shape
    assert_allclose(model.coupling.project(qpos[0]), found[0], rtol=0, atol=1e-13)  # one as of several


def test_tangents_keep_to_the_equalities(model):
    I = independents(model)  # noqa: E741 - the equation's
    found = model.coupling.project(near(model))
    tangents = model.coupling.tangent(found)
    for row, N in zip(found, tangents, strict=True):
        J = rows(model, row)[0]
        assert_allclose(J @ N, 0, atol=1e-9 * np.abs(J).max())
        assert_array_equal(N[np.ix_(I, I)], np.eye(len(I)))
        assert_array_equal(N[:, model.roles.dependent], 0)


def test_tangents_are_slopes_of_projections(model):
    """Central differences along each independent degree of freedom."""
    h, row = 1e-5, model.coupling.project(near(model))[0]
    N = model.coupling.tangent(row)
    for i in independents(model):
        ends = model.coordinates.moved(np.tile(row, (2, 1)), h * np.outer([-1, 1], np.eye(model.nv)[i]))
        low, high = model.coupling.project(ends)
        assert_allclose(model.coordinates.difference(high, low) / (2 * h), N[:, i], atol=1e-7)


def test_a_chain_in_closed_form():
    """b of a, c of b, each from its reference: values and the chain rule."""
    model = MODELS["chain, references"]
    a = np.linspace(-1, 1, 7)
    qpos = np.column_stack([a, 9 + 0 * a, -9 + 0 * a, 0.1 * a])
    polyval = np.polynomial.polynomial.polyval
    slope = [np.polynomial.polynomial.polyder(c) for c in (B_OF_A, C_OF_B)]
    up = polyval(a, B_OF_A)
    found = model.coupling.project(qpos)
    assert_allclose(found, np.column_stack([a, 0.4 + up, -0.7 + polyval(up, C_OF_B), 0.1 * a]), atol=1e-14)
    N = model.coupling.tangent(found)
    assert_allclose(N[:, 1, 0], polyval(a, slope[0]), atol=1e-14)
    assert_allclose(N[:, 2, 0], polyval(a, slope[0]) * polyval(up, slope[1]), atol=1e-14)
    assert_array_equal(N[:, :, 3], np.tile([0, 0, 0, 1], (7, 1)))


def test_a_tendon_in_closed_form():
    """Length a - 2 b stays what it is in the reference pose: b = a/2."""
    model = MODELS["tendon"]
    dependent, independent = (1, 0) if model.roles.dependent.tolist() == [1] else (0, 1)
    found = model.coupling.project(np.array([0.3, 0.5, 0.1, 0.0]))
    assert found[0] == pytest.approx(2 * found[1], abs=1e-11)
    assert found[independent] == [0.3, 0.5][independent]
    N = model.coupling.tangent(found)
    assert N[dependent, independent] == pytest.approx([2, 0.5][dependent])


def test_a_four_bars_loop_stays_closed():
    """The coupler's end and the rocker's are one point: cosine rule for the rocker's angle."""
    model = MODELS["four-bar"]
    m = model.mj_model
    assert len(model.roles.dependent) == 2
    for row in model.coupling.project(near(model)):
        crank, coupler, rocker = row
        # x forward and z up, angles about -y: the ends of the bars as complex numbers
        turn = [np.exp(1j * angle) for angle in (crank, crank + coupler, rocker)]
        assert m.eq_data[0, :3] == pytest.approx([0.5, 0, 0.1])
        end = 0.3j * turn[0] + (0.5 + 0.1j) * turn[1]
        assert abs(end - (0.5 + (0.4j + 0) * turn[2])) < 1e-10


def test_a_ring_of_joints_is_solved():
    """a follows b and b follows a: neither is a function of the other's alone; only one pose is left."""
    model = chain(tie("a", "b", 0.1, 0.5, 0, 0, 0) + tie("b", "a", -0.2, 0.3, 0.1, 0, 0))
    assert model.roles.dependent.tolist() == [0, 1]
    found = model.coupling.project(np.array([0.4, -0.3, 0.2, 0.1]))
    assert found[0] == pytest.approx(0.1 + 0.5 * found[1], abs=1e-10)
    assert found[1] == pytest.approx(-0.2 + 0.3 * found[0] + 0.1 * found[0] ** 2, abs=1e-10)
    assert_array_equal(found[2:], [0.2, 0.1])


def test_equalities_that_contradict_each_other_are_named():
    model = chain(tie("b", "a", 0.1, 1, 0, 0, 0) + tie("b", "a", 0.3, 1, 0, 0, 0))
    message = r"the equality constraints cannot be met at this position \(they miss by 0\.1\): change the motion, or"
    with pytest.raises(mjhcmc.MotionError, match=message):
        model.coupling.project(np.zeros(4))


def test_a_motion_off_the_equalities_is_named_and_one_that_leaves_the_joint_out_follows():
    model = MODELS["one"]
    time = np.linspace(0, 1, 51)
    a = 0.3 * np.sin(6 * time)
    b = np.polynomial.polynomial.polyval(a, B_OF_A)
    quiet = np.zeros((51, 4))
    quiet[:, 0], quiet[:, 1] = a, 0.0
    assert_allclose(fit_to_model(mjhcmc.Motion(time, quiet, "walk"), model).qpos[:, 1], b, atol=1e-14)
    wrong = quiet.copy()
    wrong[:, 1] = b + np.where(time == 0.5, 0.05, 0.0)
    with pytest.raises(mjhcmc.MotionError, match=r"motion 'walk': b is at .* at 0\.5 s, where an equality .* puts it"):
        fit_to_model(mjhcmc.Motion(time, wrong, "walk"), model)

"""Joint equalities: dependent joints where the engine's constraint wants them, forces by the chain rule."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mjhcmc.model_check.coupling import JointCoupling

CHAIN = """
<mujoco>
  <worldbody>
    <body><joint name="a" axis="0 1 0"/><geom size=".1"/>
      <body pos="0 0 -.3"><joint name="b" axis="0 1 0" ref="20"/><geom size=".1"/>
        <body pos="0 0 -.3"><joint name="c" type="slide"/><geom size=".1"/>
          <body name="tip" pos="0 0 -.3"><joint name="held" axis="0 1 0"/><geom size=".1"/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality>
    <joint joint1="c" joint2="b" polycoef=".01 .2 -.1 .05 .02"/>
    <joint joint1="b" joint2="a" polycoef=".1 .7 .3 0 0"/>
    <joint joint1="held" polycoef=".4 0 0 0 0"/>
    <joint joint1="a" joint2="c" active="false"/>
    {more}
  </equality>
</mujoco>
"""


def chain(more=""):
    m = mujoco.MjModel.from_xml_string(CHAIN.format(more=more))
    return m, JointCoupling(m)


@settings(max_examples=25, deadline=None)
@given(q=st.floats(-2, 2))
def test_the_filled_pose_satisfies_the_engines_constraints(q):
    m, coupling = chain()
    d = mujoco.MjData(m)
    d.qpos[:] = coupling.fill(np.array([q, 9.0, 9.0, 9.0]))
    mujoco.mj_fwdPosition(m, d)
    is_equality = d.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    assert is_equality.sum() == 3
    np.testing.assert_allclose(d.efc_pos[is_equality], 0, atol=1e-12)
    assert d.qpos[0] == q


@settings(max_examples=25, deadline=None)
@given(q=st.floats(-2, 2))
def test_reducing_is_dual_to_filling(q):
    _, coupling = chain()
    h = 1e-6
    ends = [coupling.fill(np.array([q + s, 0.0, 0.0, 0.0])) for s in (h, -h)]
    N = (ends[0] - ends[1]) / (2 * h)
    forces = np.array([1.0, -2.0, 3.0, 5.0])
    at = coupling.fill(np.array([q, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(coupling.reduce(at, forces), [N @ forces, 0, 0, 0], rtol=1e-7, atol=1e-7)
    assert coupling.free_dofs.tolist() == [0]


@pytest.mark.parametrize(
    "more",
    [
        '<joint joint1="a" joint2="c"/>',  # a circle
        '<joint joint1="c" joint2="a"/>',  # follows two
        '<connect body1="tip" anchor="0 0 0"/>',  # ties no joints
    ],
)
def test_what_is_no_tree_of_joints_is_counted_and_left_out(more):
    _, coupling = chain(more)
    assert coupling.others == 1
    assert coupling.follows == {2: 1, 1: 0, 3: -1}

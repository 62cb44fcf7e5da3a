"""Roles of degrees of freedom: what follows from a model, and what a user asks for."""

import pytest
from conftest import load_xml

import mjhcmc
from mjhcmc.roles import Role, find_roles

ARM = """
<mujoco model="arm">
  <option integrator="RK4"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <site name="ceiling" pos="0 .1 2"/>
    <body name="base" pos="0 0 1">
      {root}
      <geom size=".1" mass="3"/>
      <site name="a" pos=".05 0 0"/>
      <body name="arm">
        <joint name="elbow" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="1"/>
        <site name="b" pos=".05 0 -.2"/>
        <body name="hand" pos="0 0 -.4">
          <joint name="wrist" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0 0 -.1" size=".02" mass=".3"/>
        </body>
      </body>
    </body>
    {more}
  </worldbody>
  <tendon>
    <spatial name="path"><site site="{origin}"/><site site="b"/></spatial>
    <fixed name="bend"><joint joint="elbow" coef="1"/><joint joint="wrist" coef="2"/></fixed>
  </tendon>
  <equality>{equality}</equality>
  <actuator><muscle name="flexor" tendon="path" force="200" lengthrange=".05 1.5"/></actuator>
</mujoco>
"""
SLIDES = '<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>'
BALL = '<body name="ball" pos="1 0 0"><freejoint name="thrown"/><geom size=".1" mass="1"/></body>'
HELD = '<body name="tool" pos="0 0 .5"><freejoint name="held"/><geom size=".02" mass=".1"/></body>'
TIE = '<joint joint1="{}" joint2="{}" polycoef="0 .5 0 0 0"/>'


def arm(root="", more="", equality="", origin="a"):
    return load_xml(ARM.format(root=root, more=more, equality=equality, origin=origin))


def roles(model):
    """Role by name of degree of freedom, in one letter; upper case at the root."""
    letters = [str(role)[0] for role in model.roles.of]
    return dict(
        zip(
            model.dof_names,
            [x.upper() if at_root else x for x, at_root in zip(letters, model.roles.is_root, strict=True)],
            strict=True,
        )
    )


SIX = ("tx", "ty", "tz", "rx", "ry", "rz")

CASES = {
    "fixed root": ({}, {"elbow": "t", "wrist": "t"}),
    "slides": ({"root": SLIDES}, {"x": "P", "z": "P", "elbow": "t", "wrist": "t"}),
    "free root": (
        {"root": '<freejoint name="base"/>'},
        {**{f"base_{end}": "P" for end in SIX}, "elbow": "t", "wrist": "t"},
    ),
    "ball root": (
        {"root": '<joint name="neck" type="ball"/>'},
        {"neck_rx": "P", "neck_ry": "P", "neck_rz": "P", "elbow": "t", "wrist": "t"},
    ),
    # from the ceiling: no root is left
    "muscle from the world": (
        {"root": SLIDES, "origin": "ceiling"},
        {"x": "t", "z": "t", "elbow": "t", "wrist": "t"},
    ),
    "tree without muscles": (
        {"more": BALL},
        {"elbow": "t", "wrist": "t", **{f"thrown_{end}": "f" for end in SIX}},
    ),
    "joint equality": ({"equality": TIE.format("wrist", "elbow")}, {"elbow": "t", "wrist": "d"}),
    "the first joint, moved or not": ({"equality": TIE.format("elbow", "wrist")}, {"elbow": "d", "wrist": "t"}),
    "constant": ({"equality": '<joint joint1="wrist" polycoef=".2 0 0 0 0"/>'}, {"elbow": "t", "wrist": "d"}),
    "inactive": (
        {"equality": TIE.format("wrist", "elbow").replace("<joint ", '<joint active="false" ')},
        {"elbow": "t", "wrist": "t"},
    ),
    "said twice": ({"equality": 2 * TIE.format("wrist", "elbow")}, {"elbow": "t", "wrist": "d"}),
    # a tendon takes one away: the one that no muscle moves
    "tendon equality": ({"equality": '<tendon tendon1="bend"/>'}, {"elbow": "t", "wrist": "d"}),
    "connect, in place of a joint": (
        {"more": HELD, "equality": '<connect body1="hand" body2="tool" anchor="0 0 -.1"/>'},
        None,  # three of six: see below
    ),
    "weld": (
        {"more": HELD, "equality": '<weld body1="arm" body2="tool"/>'},
        {"elbow": "t", "wrist": "t", **{f"held_{end}": "d" for end in SIX}},
    ),
    "root tied to the root": (
        {"root": SLIDES, "equality": TIE.format("z", "x")},
        {"x": "P", "z": "d", "elbow": "t", "wrist": "t"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", [name for name, (_, wanted) in CASES.items() if wanted])
def test_roles_follow_from_the_model(case):
    changes, wanted = CASES[case]
    assert roles(arm(**changes)) == wanted


def test_a_connect_takes_three_degrees_of_freedom_of_what_it_holds():
    """None of the arm's; what is left of the tool turns about the point."""
    model = arm(**CASES["connect, in place of a joint"][0])
    found = roles(model)
    assert len(model.roles.dependent) == 3
    assert found["elbow"] == "t"
    assert found["wrist"] == "t"
    assert [found[f"held_{end}"] for end in SIX].count("d") == 3


def test_a_root_of_several_bodies():
    more = f'<body name="cart" pos="0 2 0">{SLIDES}<geom size=".1" mass="1"/></body>'
    xml = ARM.format(root='<joint name="tilt" axis="0 1 0"/>', more="", equality="", origin="a")
    cart = f'<body name="cart">{SLIDES}<geom size=".1" mass="1"/><body name="base"'
    xml = xml.replace('<body name="base"', cart).replace("</body>\n    \n  </worldbody>", "</body></body></worldbody>")
    assert roles(load_xml(xml)) == {"x": "P", "z": "P", "tilt": "P", "elbow": "t", "wrist": "t"}
    # beside it, the same cart carries nothing that muscles move
    assert roles(arm(more=more)) == {"elbow": "t", "wrist": "t", "x": "f", "z": "f"}


def test_indices_by_role():
    model = arm(root=SLIDES, more=BALL, equality=TIE.format("wrist", "elbow"))
    found = model.roles
    assert found.prescribed.tolist() == [0, 1]
    assert found.tracked.tolist() == [2]
    assert found.dependent.tolist() == [3]
    assert found.free.tolist() == [4, 5, 6, 7, 8, 9]
    assert not found.all_tracked
    assert arm().roles.all_tracked
    assert list(found.of) == list(find_roles(model.mj_model, model.muscle_ids).of)
    assert all(role.meaning for role in Role)


# --- what a user asks for ---------------------------------------------------------------------------------------


def test_other_roles_for_some_joints():
    model = arm(root=SLIDES)
    other = model.with_roles(tracked=["x"], prescribed=["wrist"], free=["elbow"])
    assert roles(other) == {"x": "T", "z": "P", "elbow": "f", "wrist": "p"}
    assert roles(model) == {"x": "P", "z": "P", "elbow": "t", "wrist": "t"}  # its own are left
    assert other.mj_model is model.mj_model
    assert roles(other.with_roles(tracked=["elbow"])) == {"x": "T", "z": "P", "elbow": "t", "wrist": "p"}


@pytest.mark.parametrize("name", ["base", "base_tz", "base_rx"])
def test_the_degrees_of_freedom_of_a_free_joint_go_together(name):
    model = arm(root='<freejoint name="base"/>')
    assert list(roles(model.with_roles(tracked=[name])).values()) == ["T"] * 6 + ["t"] * 2


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (
            {"tracked": ["shoulder"]},
            r"^tracked: model 'arm' has no joint 'shoulder': its joints are x, z, elbow",
        ),
        ({"free": "elbow"}, r"^free: give a list of joint names; got 'elbow': write \['elbow'\]$"),
        ({"tracked": ["x"], "free": ["x"]}, r"^joint 'x' is asked to be tracked and free: choose one$"),
        (
            {"prescribed": ["wrist"]},
            r"^prescribed: an equality constraint ties joint 'wrist' to others: name",
        ),
    ],
)
def test_what_cannot_be_asked_for(asked, message):
    model = arm(root=SLIDES, equality=TIE.format("wrist", "elbow"))
    with pytest.raises(mjhcmc.SettingsError, match=message):
        model.with_roles(**asked)

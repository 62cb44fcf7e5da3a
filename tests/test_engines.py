"""Other engines against MuJoCo on the leg, and on one whose axes and inertias are oblique; URDF, their way in."""

import copy

import hypothesis
import hypothesis.strategies as st
import mujoco
import numpy as np
import pytest

import mjhcmc
from mjhcmc.engines import mujoco as reference
from mjhcmc.engines.base import TOLERANCE
from mjhcmc.engines.cases import QUANTITIES, WINDOW, case_of
from mjhcmc.engines.compare import STEP, compare, differences, forward_error
from mjhcmc.engines.legs import LEGS, bodies_of, leg
from mjhcmc.engines.registry import all_engines, engines_named
from mjhcmc.engines.urdf import matrix_of, roll_pitch_yaw, urdf_of, write_urdf

ENGINES = {engine.key: engine for engine in all_engines() if engine.load is not None}
ORDERS = {"mujoco": 4, "drake": 3, "dart": 1, "bullet": 1, "pinocchio": 4, "casadi": 4, "opensim": 4}
# MuJoCo in JAX and in Warp, and Brax, take up to a minute to compile a simulation: benchmarks/engines.py runs theirs
COMPILED = ("brax", "mjx")
# what JAX compiles takes seconds a leg: the oblique one, on which every number counts


def loaded(key, case):
    engine = ENGINES[key]
    pytest.importorskip(engine.module)
    return engine, engine.load(case.model)


@pytest.fixture(scope="module", params=LEGS)
def case(request):
    return case_of(request.param, states=10, seed=1)


# --- the engines -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "key", [pytest.param(key, marks=pytest.mark.compiled) if key in COMPILED else key for key in ENGINES]
)
def test_engines_compute_what_mujoco_does(key, case):
    if key in COMPILED and case.name != "oblique":
        pytest.skip("the oblique leg is enough: compiling takes seconds")
    engine, dynamics = loaded(key, case)
    for quantity, value in differences(dynamics, case).items():
        assert value <= TOLERANCE[engine.precision], quantity


@pytest.mark.parametrize("key", ORDERS)
def test_integrators_converge_on_the_reference_at_their_order(key, case):
    # The error is C h^p: halving the step shows p, and an engine that moves another model converges on nothing.
    _, dynamics = loaded(key, case)
    coarse, fine = forward_error(dynamics, case, 2 * STEP), forward_error(dynamics, case, STEP)
    assert np.log2(coarse / fine) == pytest.approx(ORDERS[key], abs=0.1)
    assert ENGINES[key].order == ORDERS[key]
    # semi-implicit Euler runs half a step ahead, h/2 |q'|; as much again for what the motion makes of it
    speed = np.abs(np.diff(case.nodes, axis=0)).max() / WINDOW
    assert fine < (np.rad2deg(STEP * speed) if ORDERS[key] == 1 else 1e-5)


def test_the_reference_motion_is_that_of_many_small_steps(case):
    assert forward_error(reference.load(case.model), case, STEP / 10) < 1e-11


def test_casadi_differentiates_the_closed_form(case):
    pytest.importorskip("casadi")
    from mjhcmc.engines.casadi import CasadiDynamics
    from mjhcmc.exact.chain import chain_of
    from mjhcmc.exact.dynamics import inverse_dynamics
    from mjhcmc.exact.scalars import COMPLEX

    chain, q, v, a = chain_of(case.model), case.q[0], case.v[0], case.a[0]
    columns = []
    for k in range(2 * chain.n):  # by complex steps: no difference is taken, nothing cancels
        x = np.concatenate([q, v]).astype(complex)
        x[k] += 1e-30j
        columns.append([value.imag / 1e-30 for value in inverse_dynamics(chain, x[:3], x[3:], a, COMPLEX)])
    expected = np.array(columns).T
    found = CasadiDynamics(case.model).inverse_dynamics_slopes(q, v, a)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_a_step_that_does_not_divide_the_window_is_refused(case):
    with pytest.raises(mjhcmc.SettingsError, match=r"0\.003 s does not divide a window of 0\.01 s"):
        reference.load(case.model).simulate(case.q[0], case.v[0], case.torques, WINDOW, 0.003)


# --- the legs ----------------------------------------------------------------------------------------------------


def test_leg8_without_muscles_has_leg8s_dynamics(leg8):
    ours, whole = reference.load(leg("leg8")), reference.load(leg8.mj_model)
    q, v = np.array([0.4, -0.7, 0.2]), np.array([1.0, -2.0, 3.0])
    np.testing.assert_allclose(ours.mass_matrix(q), whole.mass_matrix(q), rtol=1e-14)
    np.testing.assert_allclose(ours.bias(q, v), whole.bias(q, v), rtol=1e-13)


def test_engines_that_drop_off_diagonal_inertia_would_be_seen():
    model = leg("oblique")
    case = case_of("oblique", states=5, seed=0)
    spec_like = copy.copy(model)
    for b in range(1, model.nbody):  # the diagonal in the body's frame, what a careless reader keeps
        turn = matrix_of(model.body_iquat[b])
        spec_like.body_inertia[b] = np.diag(turn @ np.diag(model.body_inertia[b]) @ turn.T)
        spec_like.body_iquat[b] = [1, 0, 0, 0]
    assert differences(reference.load(spec_like), case)["mass_matrix"] > 1e-3


def test_inverse_dynamics_are_without_the_forces_of_joint_limits(case):
    # What stops a joint at its limit is no part of M a + bias; mj_inverse adds it unless told otherwise.
    own, q = reference.load(case.model), case.model.jnt_range[:, 1] + 0.2
    v, a = np.array([1.0, -2.0, 3.0]), np.array([10.0, 20.0, -30.0])
    expected = own.mass_matrix(q) @ a + own.bias(q, v)
    np.testing.assert_allclose(own.inverse_dynamics(q, v, a), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def hinges(n, *, names=(), limits=None):
    """A chain of unlike rods on oblique hinges."""
    spec, rng = mujoco.MjSpec(), np.random.default_rng(3)
    spec.compiler.degree = False
    body = spec.worldbody
    for i in range(n):
        body = body.add_body(pos=[0, 0, -0.3 if i else 0])
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.04, 0, 0], fromto=[0, 0, 0, 0.05, 0, -0.3])
        joint = body.add_joint(axis=rng.normal(size=3), name=names[i] if i < len(names) else "", damping=1.0)
        if limits:
            joint.limited, joint.range = True, limits
    return spec.compile()


def test_another_tree_of_hinges_is_a_leg_too():
    found = compare(
        engines_named(["pinocchio", "drake"]), states=3, legs=(), models={"five": hinges(5, limits=[-2, 0])}
    )
    assert found.passed
    own = found.rows[0].legs["five"]
    assert own.forward_order == pytest.approx(4, abs=0.1)
    case = case_of("five", 20, 0, bodies_of(hinges(5, limits=[-2, 0]), limits=False))
    for angles in (case.q, case.nodes):  # the ranges count, though nothing holds the joints there
        assert angles.min() > -2
        assert angles.max() < 0
    assert not case.model.jnt_limited.any()


def test_a_balanced_hinge_has_no_bias_to_be_relative_to():
    ball = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="a" axis="0 1 0"/><geom size=".1"/></body></worldbody></mujoco>'
    )
    case = case_of("ball", 5, 0, bodies_of(ball, limits=False))
    assert case.expected["bias"].max() == 0
    assert max(differences(reference.load(case.model), case).values()) == 0


def test_a_motion_that_steps_cannot_follow_is_refused():
    with pytest.raises(mjhcmc.SimulationError, match=r"model 'ten'.* differ by .* deg"):
        compare(engines_named(["mujoco"]), states=1, legs=(), models={"ten": hinges(10, limits=[0, 3])})


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"legs": ("foo",)}, "no leg 'foo': the legs are leg8, oblique"),
        ({"legs": ()}, "no leg to compare"),
        ({"models": {"leg8": None}}, "two legs are called 'leg8'"),
    ],
)
def test_legs_that_cannot_be_compared_are_named(given, words):
    with pytest.raises(mjhcmc.SettingsError, match=words):
        compare(engines_named(["mujoco"]), states=1, **given)


def test_motions_stay_within_the_joints_ranges(case):
    low, high = case.model.jnt_range.T
    assert np.all(case.nodes > low + 0.3)
    assert np.all(case.nodes < high - 0.05)
    assert np.ptp(case.nodes, axis=0).min() > 0.4


# --- URDF --------------------------------------------------------------------------------------------------------


def same_by_urdf(model, rng):
    """The largest relative difference of M and the bias between a model and its URDF, as MuJoCo reads it."""
    read = mujoco.MjModel.from_xml_string(urdf_of(model))
    read.opt.gravity = model.opt.gravity
    assert [read.joint(j).name for j in range(read.njnt)] == [model.joint(j).name for j in range(model.njnt)]
    np.testing.assert_array_equal(read.jnt_range[read.jnt_limited == 1], model.jnt_range[model.jnt_limited == 1])
    ours, theirs = reference.load(model), reference.load(read)
    worst = 0.0
    for _ in range(5):
        q, v = rng.uniform(-2, 2, model.nv), rng.uniform(-5, 5, model.nv)
        for one, other in (
            (ours.mass_matrix(q), theirs.mass_matrix(q)),
            (ours.bias(q, v), theirs.bias(q, v)),
        ):
            worst = max(worst, np.abs(one - other).max() / np.abs(one).max())
    return worst


@pytest.mark.parametrize("name", LEGS)
def test_mujoco_reads_the_urdf_as_the_same_leg(name):
    assert same_by_urdf(leg(name), np.random.default_rng(0)) < 1e-12


@hypothesis.given(st.integers(0, 2**32 - 1), st.lists(st.booleans(), min_size=2, max_size=6))
@hypothesis.settings(max_examples=15)
def test_trees_with_branches_and_welds_survive_urdf(seed, hinged):
    rng = np.random.default_rng(seed)
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    bodies = [spec.worldbody]
    for i, free in enumerate([True, *hinged]):
        body = bodies[rng.integers(len(bodies))].add_body(name=f"part {i} & <more>")
        bodies.append(body)
        body.pos, body.quat = rng.normal(size=3), rng.normal(size=4)
        body.explicitinertial, body.mass = True, rng.uniform(0.5, 5)
        body.ipos, body.iquat = rng.normal(size=3), rng.normal(size=4)
        a, b, c = rng.uniform(0.1, 1, 3)
        body.inertia = [a + b, b + c, c + a]  # what some mass has
        if free:
            joint = body.add_joint(name=f"hinge {i}", axis=rng.normal(size=3), pos=rng.normal(size=3))
            joint.limited, joint.range = bool(rng.integers(2)), [-1.5, 2.0]
    assert same_by_urdf(spec.compile(), rng) < 1e-12


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-10, 0.3])
def test_rotations_become_angles_and_come_back(pitch):
    def about(axis, angle):
        return matrix_of(np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * np.eye(3)[axis]]))

    turn = about(2, 0.7) @ about(1, pitch) @ about(0, -0.4)
    roll, y, yaw = roll_pitch_yaw(turn)
    np.testing.assert_allclose(about(2, yaw) @ about(1, y) @ about(0, roll), turn, atol=1e-9)


def test_what_urdf_cannot_say_is_refused_by_name(tmp_path):
    gait = mujoco.MjModel.from_xml_path(str(mjhcmc.assets.model_path("leg8_gait")))
    with pytest.raises(mjhcmc.ModelError, match="'pelvis_tx' is a slide"):
        urdf_of(gait)
    two = '<mujoco><worldbody><body name="b">{}<geom size=".1"/></body></worldbody></mujoco>'
    with pytest.raises(mjhcmc.ModelError, match="body 'b' has 2 joints"):
        urdf_of(mujoco.MjModel.from_xml_string(two.format('<joint axis="1 0 0"/><joint axis="0 1 0"/>')))
    with pytest.raises(mjhcmc.ModelError, match=r"'bent' has ref 0\.5"):
        bodies_of(mujoco.MjModel.from_xml_string(two.format('<joint name="bent" ref="28.6478897565"/>')))
    with pytest.raises(mjhcmc.OutputError):
        write_urdf(leg("leg8"), tmp_path / "nowhere" / "leg.urdf")


def test_names_are_made_up_that_nothing_else_has():
    model = hinges(4, names=["joint_1", "", "joint_3", ""])
    names = [bodies_of(model).joint(j).name for j in range(4)]
    assert names[::2] == ["joint_1", "joint_3"]
    assert len(set(names)) == 4
    read = mujoco.MjModel.from_xml_string(urdf_of(model))
    assert [read.joint(j).name for j in range(4)] == names
    welded = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="body_2"><joint name="body_2__weld"/><geom size=".1"/>'
        '<body><geom size=".1" pos="0 0 1"/></body></body></worldbody></mujoco>'
    )
    text = urdf_of(welded)
    for name in ("body_2", "body_2_", "body_2__weld", "body_2__weld_"):
        assert text.count(f'link name="{name}"') + text.count(f'joint name="{name}"') == 1


def test_models_that_have_no_hinge_or_cannot_be_compiled_are_refused_in_a_line():
    still = mujoco.MjModel.from_xml_string('<mujoco model="rock"><worldbody><geom size="1"/></worldbody></mujoco>')
    with pytest.raises(mjhcmc.ModelError, match="model 'rock' has no joint"):
        urdf_of(still)
    broken = leg("leg8")
    broken.jnt_axis[0] = 0.0
    with pytest.raises(mjhcmc.ModelError, match="leg8") as stop:
        bodies_of(broken)
    assert "\n" not in str(stop.value)


def test_engines_are_listed_as_in_the_paper():
    titles = [engine.title for engine in all_engines()]
    assert titles[:7] == ["MuJoCo", "Dojo", "Brax", "RaiSim", "Drake", "DART", "Bullet"]
    assert [engine.key for engine in engines_named(["dart"])] == ["mujoco", "dart"]
    for engine in all_engines():
        assert engine.load is not None or "it takes" in engine.missing, engine.title
        assert (engine.load is None) == (engine.order == 0), engine.title
    assert QUANTITIES == ("mass_matrix", "bias", "inverse_dynamics")

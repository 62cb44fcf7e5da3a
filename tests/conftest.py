"""Models that the tests share: the leg, and small ones whose answers are known in closed form."""

import copy
import os
from pathlib import Path

# two workers on two cores: threads of their own would only be in each other's way; workers inherit it
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import pytest
from cli_tools import blank_figures, coarse_figures, coarse_replay, mot, no_figures, run, timed_once
from motion_tools import write

import mjhcmc

# fixtures of the command line and of motion files
__all__ = ["blank_figures", "coarse_figures", "coarse_replay", "mot", "no_figures", "run", "timed_once", "write"]

hypothesis.settings.register_profile("patient", deadline=None)  # a busy machine is no failure
hypothesis.settings.load_profile("patient")

SHARED = Path(__file__).resolve().parents[2] / "shared"

HANGING_MASS = """
<mujoco model="hanging">
  <option integrator="RK4" gravity="0 0 -9.81"/>
  <worldbody>
    <site name="ceiling" pos="0 0 1"/>
    <body name="mass">
      <joint name="height" type="slide" axis="0 0 1" range="-.5 .5" limited="true"/>
      <geom type="sphere" size=".05" mass="2" contype="0" conaffinity="0"/>
      <site name="hook" pos="0 0 0"/>
    </body>
  </worldbody>
  <tendon><spatial name="rope"><site site="ceiling"/><site site="hook"/></spatial></tendon>
  <actuator>{actuator}</actuator>
</mujoco>
"""

LINEAR_ACTUATOR = (
    '<general name="pull" tendon="rope" dyntype="muscle" dynprm=".01 .04" gaintype="fixed" gainprm="-100" '
    'biastype="none" ctrlrange="0 1" ctrllimited="true"/>'
)
MUSCLE_ACTUATOR = '<muscle name="pull" tendon="rope" force="100" lengthrange=".5 1.5" ctrlrange="0 1"/>'

PENDULUMS = """
<mujoco model="two_joints">
  <option integrator="RK4" gravity="0 0 -9.81"/>
  <worldbody>
    <site name="a" pos=".1 0 .1"/>
    <body name="upper">
      <joint name="shoulder" type="hinge" axis="0 -1 0" range="-120 120" limited="true"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="2" contype="0" conaffinity="0"/>
      <site name="b" pos=".05 0 -.1"/>
      <site name="c" pos=".05 0 -.15"/>
      <body name="lower" pos="0 0 -.3">
        <joint name="elbow" type="hinge" axis="0 -1 0" range="-120 120" limited="true"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".025" mass="1" contype="0" conaffinity="0"/>
        <site name="d" pos=".05 0 -.08"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="flexor_path" damping="2"><site site="a"/><site site="b"/></spatial>
    <spatial name="biceps_path" damping="1"><site site="c"/><site site="d"/></spatial>
  </tendon>
  <actuator>
    <muscle name="flexor" tendon="flexor_path" force="400" lengthrange=".05 .35" ctrlrange="0 1"/>
    <muscle name="biceps" tendon="biceps_path" force="200" lengthrange=".05 .35" ctrlrange="0 1"/>
  </actuator>
</mujoco>
"""


def judged(solution: mjhcmc.Solution) -> mjhcmc.Solution:
    """The solution, its verdict found now: a test that asks for `coarse_replay` may be the first to use it."""
    assert solution.verdict.replay_max_error is not None
    return solution


def load_xml(xml: str) -> mjhcmc.MuscleModel:
    """A MuscleModel from MJCF text."""
    import mujoco

    return mjhcmc.MuscleModel.load(mujoco.MjModel.from_xml_string(xml))


@pytest.fixture(scope="session", autouse=True)
def each_leg_is_fitted_once():
    """A second to fit a subject's leg: the same document, side and knee give the same one again."""
    from mjhcmc.leg8 import from_osim

    real, known = from_osim.fit_subject, {}

    def fit(leg, table, scales):
        key = Path(leg.model.path).read_bytes(), leg.side, "knee_motion" in table["fitted"]
        if key not in known:
            known[key] = real(leg, table, scales)
        return copy.deepcopy(known[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(from_osim, "fit_subject", fit)
        yield


@pytest.fixture(scope="session")
def leg8() -> mjhcmc.MuscleModel:
    return mjhcmc.MuscleModel.load("leg8")


@pytest.fixture(scope="session")
def linear_mass() -> mjhcmc.MuscleModel:
    """2 kg on a muscle whose force is 100 N times activation: m q'' = 100 a - m g."""
    return load_xml(HANGING_MASS.format(actuator=LINEAR_ACTUATOR))


@pytest.fixture(scope="session")
def hanging_mass() -> mjhcmc.MuscleModel:
    """2 kg on one MuJoCo muscle."""
    return load_xml(HANGING_MASS.format(actuator=MUSCLE_ACTUATOR))


@pytest.fixture(scope="session")
def two_joints() -> mjhcmc.MuscleModel:
    """Two hinges with one muscle each: excitations follow uniquely from the motion."""
    return load_xml(PENDULUMS)


@pytest.fixture(scope="session")
def slow(leg8):
    return mjhcmc.Motion.cosine(leg8, "slow")


@pytest.fixture(scope="session")
def fast(leg8):
    return mjhcmc.Motion.cosine(leg8, "fast")


@pytest.fixture(scope="session")
def slow_solution(leg8, slow):
    return judged(mjhcmc.hcmc(leg8, slow))


@pytest.fixture(scope="session")
def fast_solution(leg8, fast):
    return judged(mjhcmc.hcmc(leg8, fast))


@pytest.fixture(scope="session")
def walk_folder() -> Path:
    folder = SHARED / "walk"
    if not folder.is_dir():
        pytest.skip("the measured walk (shared/walk) is not beside this checkout")
    return folder

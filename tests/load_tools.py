"""What the tests of external loads share: a leg on a moving pelvis, and OpenSim's files of its loads."""

import mujoco
import numpy as np
import pytest
from conftest import load_xml

from mjhcmc import Motion
from mjhcmc.external_loads import ExternalLoads, wrenches
from mjhcmc.io.opensim import write_table

TO_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # x forward stays, OpenSim's up y becomes z

LEG = """
<mujoco model="stepper">
  <option integrator="RK4" gravity="{gravity}"/>
  <compiler angle="radian"/>
  {custom}
  <worldbody>
    <site name="a" pos=".1 0 1"/>
    <body name="pelvis" pos="0 0 1">
      <joint name="forward" type="slide" axis="1 0 0"/>
      <joint name="up" type="slide" axis="0 0 1"/>
      <joint name="tilt" axis="0 -1 0"/>
      <geom type="sphere" size=".1" mass="30" contype="0" conaffinity="0"/>
      <body name="thigh" pos="-.07 0 -.07">
        <joint name="hip" axis="0 -1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05" mass="9" contype="0" conaffinity="0"/>
        <site name="b" pos=".05 0 -.1"/>
        <body name="shank" pos="0 0 -.4" {turn}>
          <joint name="knee" axis="0 -1 0"/>
          <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="4" contype="0" conaffinity="0"/>
          <body name="foot" pos="0 0 -.43">
            <joint name="ankle" axis="0 -1 0"/>
            <geom type="capsule" fromto="-.05 0 -.04 .13 0 -.04" size=".02" mass="1.2" contype="0" conaffinity="0"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon><spatial name="path"><site site="a"/><site site="b"/></spatial></tendon>
  <actuator><muscle name="pull" tendon="path" force="100" lengthrange=".05 1.5" ctrlrange="0 1"/></actuator>
</mujoco>
"""
OPENSIM_BODIES = '<custom><text name="opensim_bodies" data="calcn_r=foot talus_r=foot tibia_r=shank"/></custom>'

BODIES = ("pelvis", "femur_r", "tibia_r", "talus_r", "calcn_r", "calcn_l")


def build(gravity="0 0 -9.81", custom=OPENSIM_BODIES, turn=""):
    return load_xml(LEG.format(gravity=gravity, custom=custom, turn=turn))


@pytest.fixture(scope="module")
def leg():
    return build()


TIME = np.array([0.0, 0.1, 0.3, 0.4])
RNG = np.random.default_rng(6)
COLUMNS = [f"{n}{kind}{axis}" for n in ("", "1_") for kind in ("f_v", "f_p", "t_") for axis in "xyz"]
VALUES = RNG.normal(size=(4, 18)) * np.tile(np.repeat([100.0, 0.3, 5.0], 3), 2)

FORCE = """
<ExternalForce name="{name}">{switch}
  <applied_to_body>{body}</applied_to_body>
  <force_expressed_in_body>{force_frame}</force_expressed_in_body>
  <point_expressed_in_body>{point_frame}</point_expressed_in_body>
  <force_identifier>{force}</force_identifier>
  <point_identifier>{point}</point_identifier>
  <torque_identifier>{torque}</torque_identifier>
  <data_source_name>Unassigned</data_source_name>
</ExternalForce>
"""


def one_force(**changed):
    """An ExternalForce as OpenSim writes it, the right foot's unless changed."""
    given = {
        "name": "right", "switch": "", "body": "calcn_r", "force_frame": "ground", "point_frame": "ground",
        "force": "f_v", "point": "f_p", "torque": "t_",
    }  # fmt: skip
    return FORCE.format(**(given | changed))


LEFT = one_force(name="left", body="calcn_l", force="1_f_v", point="1_f_p", torque="1_t_")


@pytest.fixture
def files(tmp_path):
    """Write an external-loads file and its table; return the path of the first."""

    def files(*forces, datafile="grf.mot", version="30000", values=VALUES, columns=COLUMNS, time=TIME, form=None):
        if datafile == "grf.mot":
            write_table(tmp_path / "grf.mot", columns, time, values, name="grf", in_degrees=False)
        form = form or (
            '<?xml version="1.0" encoding="UTF-8" ?>\n<OpenSimDocument Version="{version}"><ExternalLoads name="x">'
            "<objects>{forces}</objects><groups/><datafile>{datafile}</datafile></ExternalLoads></OpenSimDocument>"
        )
        path = tmp_path / "grf.xml"
        path.write_text(form.format(version=version, forces="".join(forces or [one_force()]), datafile=datafile))
        return path

    return files


def constant(body="foot", force=(0, 0, 700), point=(0, 0, 0), torque=(0, 0, 0), time=(0.0, 1.0), **more):
    T = len(time)
    three = (np.tile(np.asarray(v, dtype=float), (T, 1, 1)) for v in (force, torque, point))
    return ExternalLoads("plates", np.array(time), (body,), *three, **more)


def motion(start, end, name="walk", qpos=None):
    time = np.linspace(start, end, 11)
    return Motion(time, np.zeros((11, 6)) if qpos is None else np.tile(qpos, (11, 1)), name)


def posed(model, qpos):
    d = mujoco.MjData(model.mj_model)
    d.qpos[:] = qpos
    mujoco.mj_forward(model.mj_model, d)
    return d


def wrenches_at(loads, model, d, times):
    n = np.size(times)
    poses = (np.tile(array, (n, 1, 1)) for array in (d.xpos, d.xmat, d.xipos))
    return wrenches(loads.sample(times), *loads.ids(model), *poses)

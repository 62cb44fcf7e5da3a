"""An oracle for joint reactions: virtual work at a cut, by MuJoCo's inverse dynamics on an altered model."""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np


def reactions_by_virtual_work(xml, qpos, qvel, activation, applied):
    """Reaction force and moment (njnt, 3) at each joint's anchor, in the world's axes.

    Each joint's body is cut and put together again by three slides and three hinges that stand still, along the world's
    axes at the anchor. What must act on them is the reaction; the altered model knows all forces by their generalized
    ones alone. The model has no constraints; its bodies and joints have names.
    """
    m = mujoco.MjModel.from_xml_string(xml)
    d = mujoco.MjData(m)
    d.qpos[:], d.qvel[:], d.act[:], d.qfrc_applied[:] = qpos, qvel, activation, applied
    mujoco.mj_forward(m, d)
    found = np.empty((m.njnt, 6))
    for j in range(m.njnt):
        b = m.jnt_bodyid[j]
        R = d.xmat[b].reshape(3, 3)
        at = R.T @ (d.xanchor[j] - d.xpos[b])
        pm = mujoco.MjModel.from_xml_string(_cut(xml, m.body(b).name, R, at))
        pd = mujoco.MjData(pm)
        own = [pm.joint(m.joint(i).name).id for i in range(m.njnt)]
        probes = [pm.joint(f"probe{k}").id for k in range(6)]
        pd.qpos[own], pd.qvel[own], pd.act[:] = qpos, qvel, activation
        mujoco.mj_forward(pm, pd)
        pd.qacc[:] = 0
        pd.qacc[own] = d.qacc
        mujoco.mj_inverse(pm, pd)
        found[j] = (pd.qfrc_inverse - pd.qfrc_actuator)[probes]
    return found[:, :3], found[:, 3:]


def _cut(xml, name, axes, at):
    root = ET.fromstring(xml)
    body = next(b for b in root.iter("body") if b.get("name") == name)
    inner = ET.Element("body", name="inner")
    if "gravcomp" in body.attrib:
        inner.set("gravcomp", body.attrib.pop("gravcomp"))
    for k in range(6):
        ET.SubElement(
            inner, "joint", name=f"probe{k}", type="slide" if k < 3 else "hinge", axis=_text(axes[k % 3]), pos=_text(at)
        )
    for item in list(body):
        if item.tag != "joint":
            body.remove(item)
            inner.append(item)
    ET.SubElement(body, "inertial", pos="0 0 0", mass="1e-12", diaginertia="1e-12 1e-12 1e-12")
    body.append(inner)
    return ET.tostring(root, encoding="unicode")


def _text(values):
    return " ".join(repr(float(v)) for v in values)

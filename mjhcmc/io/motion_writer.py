"""A Motion written as a table that OpenSim's tools take for coordinates."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import OutputError
from mjhcmc.io.files import written_whole
from mjhcmc.io.opensim import SUFFIXES, table_text
from mjhcmc.joints import TIME_TOLERANCE, JointModel
from mjhcmc.motion import Motion

Array = NDArray[np.float64]

_STILL = 1e-12  # m, or of a quaternion: rounding of its length


def write_motion(
    motion: Motion,
    model: JointModel,
    path: str | os.PathLike[str],
    *,
    angle_unit: Literal["deg", "rad"] = "deg",
    lead: bool = False,
) -> Path:
    """Write a motion to a .mot or .sto file, which OpenSim and `Motion.from_file` read.

    A column a joint, in the model's order, under the name and with the sign that the model's column map gives it
    (OpenSim's coordinate, where the model ships that), else under its own name. Hinges in degrees or radians, as the
    header's inDegrees says, slides in m. Ball and free joints have a column a coordinate (JOINT_tx .. JOINT_qz, m and
    the parts of a unit quaternion), which `Motion.from_file` reads and OpenSim has no use for; one that stays in the
    model's reference pose, where reading holds what a file does not name, is left out.

    Radians come back bit for bit. Degrees are rounded twice on the way, and come back within 2 units in the last place
    (some 1e-16 of the angle).

    Args:
        motion: what to write.
        model: whose joints it moves.
        path: a .mot or .sto file; a file of that name is replaced, at once and only when all is written.
        angle_unit: of the file's angles, "deg" (what OpenSim's tools write) or "rad".
        lead: write also the rows outside start and end, which lead the motion's spline in and out. Read with the
            motion's start and end, such a file gives the same motion; without, one that is longer. Left out, the file
            begins and ends exactly at start and end, and near them derivatives may differ a little when read back.

    Returns:
        The path.

    Raises:
        OutputError: a suffix other than these, an unknown unit, a model whose joints are not those of the motion, a
            name that OpenSim cannot read, or a file that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(
            f"{path}: a motion is written to {' or '.join(SUFFIXES)}, not to {path.suffix or 'nothing'!r}"
        )
    if angle_unit not in ("deg", "rad"):
        raise OutputError(f"{path}: angle_unit {angle_unit!r}: choose 'deg' or 'rad'")
    _check_joints(path, motion, model)
    time, qpos = _rows(motion, lead)
    kept = _kept(model, qpos)
    names, signs = _columns(path, model, kept)
    values = np.where(signs < 0, 0.0 - qpos[:, kept], qpos[:, kept])  # 0 - x: no -0.0
    if angle_unit == "deg":
        values = np.where(np.asarray(model.joint_is_rotation)[kept], _degrees(values), values)
    text = table_text(path, names, time, values, name=_table_name(motion.name), in_degrees=angle_unit == "deg")
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    return path


def _check_joints(path: Path, motion: Motion, model: JointModel) -> None:
    """Raise OutputError unless the motion moves the model's joints."""
    joints = tuple(model.joint_names)
    if motion.qpos.shape[1] != len(joints) or (motion.joint_names and tuple(motion.joint_names) != joints):
        raise OutputError(
            f"{path}: cannot be written: {motion.name} moves {', '.join(motion.joint_names) or motion.qpos.shape[1]}, "
            f"model {model.name} has the joints {', '.join(joints)}: give the model that the motion was made for"
        )


def _columns(path: Path, model: JointModel, kept: list[int]) -> tuple[list[str], Array]:
    """Name and sign of each kept coordinate's column."""
    joints = [model.joint_names[i] for i in kept]
    mapped = [model.column_map.get(joint, joint) for joint in joints]
    names = [name.removeprefix("-") for name in mapped]
    for joint, name in zip(joints, names, strict=True):
        if len(name.split()) != 1:
            raise OutputError(
                f"{path}: cannot be written: the column of joint {joint!r} would be called {name!r}, and OpenSim's "
                "names hold no blanks: rename it in the model"
            )
    return names, np.array([-1.0 if name.startswith("-") else 1.0 for name in mapped])


def _kept(model: JointModel, qpos: Array) -> list[int]:
    """Coordinates to write: all but those of ball and free joints that stay in the reference pose.

    All where a file without them could not be read: see `match_columns`.
    """
    silent: Mapping[str, bool] = getattr(model, "may_be_silent", {})
    every = list(range(qpos.shape[1]))
    away = np.abs(qpos - np.asarray(model.qpos_reference)).max(axis=0) > _STILL
    left = {
        i
        for joint in _many_coordinates(getattr(model, "mj_model", None))
        if not away[joint].any() and all(model.joint_names[i] in silent for i in joint)
        for i in joint
    }
    kept = [i for i in every if i not in left]
    return kept if any(not silent.get(model.joint_names[i], False) for i in kept) else every


def _many_coordinates(m: Any) -> list[list[int]]:
    """The coordinates of each ball and free joint of a compiled model."""
    if m is None:
        return []
    import mujoco

    sizes = {int(mujoco.mjtJoint.mjJNT_BALL): 4, int(mujoco.mjtJoint.mjJNT_FREE): 7}
    return [
        list(range(int(at), int(at) + sizes[int(kind)]))
        for at, kind in zip(m.jnt_qposadr, m.jnt_type, strict=True)
        if int(kind) in sizes
    ]


def _rows(motion: Motion, lead: bool) -> tuple[Array, Array]:
    """Times, and (T, nq) positions there: the motion's own rows, and its start and end where none stands."""
    if lead:
        return motion.time, motion.qpos
    inside = (motion.time > motion.start + TIME_TOLERANCE) & (motion.time < motion.end - TIME_TOLERANCE)
    time = np.concatenate([[motion.start], motion.time[inside], [motion.end]])
    first, last = (_position_at(motion, t) for t in (motion.start, motion.end))
    return time, np.vstack([first, motion.qpos[inside], last])


def _position_at(motion: Motion, t: float) -> Array:
    """(nq,) position at a time: the row's own where one stands there."""
    row = np.flatnonzero(motion.time == t)
    position: Array = motion.qpos[row[0]] if len(row) else motion.sample(t).qpos[0]
    return position


def _degrees(radians: Array) -> Array:
    """Degrees that come back as near to the radians as doubles allow: of the neighbours, the one that reads best."""
    about = np.rad2deg(radians)
    tries = np.stack([about, np.nextafter(about, -np.inf), np.nextafter(about, np.inf)])
    best = np.abs(tries * (np.pi / 180) - radians).argmin(axis=0)
    chosen: Array = np.take_along_axis(tries, best[None], axis=0)[0]
    return chosen


def _table_name(name: str) -> str:
    """A motion's name as the first line of a table, which takes less."""
    words = " ".join(name.replace("=", " ").replace("\0", " ").split())
    return f"motion {words}" if words.split()[:1] != ["motion"] else words

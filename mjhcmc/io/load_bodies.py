"""Whose body is it: from the bodies that a loads file names to those of a MuJoCo model."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import ModelError, MotionError, SettingsError
from mjhcmc.external_loads import GROUND
from mjhcmc.io.columns import listed
from mjhcmc.io.opensim_loads import bare_name, read_body_names

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel
from mjhcmc.opensim_names import BODIES_TEXT

_GROUND_NAMES = ("", "ground", "world")


class BodyNames:
    """The bodies of a file, an OpenSim model and a MuJoCo model, brought together."""

    def __init__(
        self,
        path: Path,
        model: MuscleModel,
        bodies: Mapping[str, str] | None,
        osim: str | os.PathLike[str] | Iterable[str] | None,
    ) -> None:
        """Read the names; see `ExternalLoads.from_file` for the arguments."""
        m = model.mj_model
        self.path, self.model = path, model
        self.own = tuple(m.body(i).name for i in range(1, m.nbody))
        self.given = {bare_name(key): value for key, value in (bodies or {}).items()}
        for name, own in self.given.items():
            if own not in self.own:
                raise SettingsError(
                    f"bodies: {name!r} maps to {own!r}, but the bodies of model {model.name!r} are {listed(self.own)}"
                )
        self.shipped = _bodies_text(model, self.own)
        self.osim_name, self.osim = "", frozenset[str]()
        if isinstance(osim, (str, os.PathLike)):
            self.osim_name, self.osim = Path(osim).name, frozenset(read_body_names(Path(osim)))
        elif osim is not None:
            self.osim_name, self.osim = "osim", frozenset(osim)

    def find(self, name: str, load: str) -> str | None:
        """The model's body, "" for the ground; None where only the OpenSim model has it.

        Args:
            name: the file's body.
            load: the load's label, for messages.

        Raises:
            MotionError: it is in neither model.
        """
        if name in self.given:
            return self.given[name]
        if name in self.own:
            return name
        if name.lower() in _GROUND_NAMES:
            return GROUND
        if name in self.shipped:
            return self.shipped[name]
        if name in self.osim:
            return None
        own = list(dict.fromkeys([*self.own, *self.shipped]))
        known = f"model {self.model.name!r} has {listed(own)}"
        more = sorted(self.osim.difference(own))
        known += f"; {self.osim_name} also has {listed(more)}" if more else ""
        remedy = (
            "correct the name, or map it with bodies= (on the command line --loads-map, with a table)"
            if self.osim
            else "map it with bodies=, or give the measured model with osim= (on the command line --osim, or "
            "--loads-map with a table)"
        )
        raise MotionError(f"{self.path}: load {load!r} names body {name!r}, which is not known: {known}: {remedy}")

    def check_given(self, named: Iterable[str]) -> None:
        """Raise SettingsError where the user's map holds a body that the file does not name."""
        names = sorted(set(named))
        for name in self.given:
            if name not in names:
                raise SettingsError(f"bodies: {self.path} has no load on {name!r}: it names {listed(names)}")


def _bodies_text(model: MuscleModel, own: tuple[str, ...]) -> dict[str, str]:
    m = model.mj_model
    index = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_TEXT, BODIES_TEXT)
    if index < 0:
        return {}
    start, size = int(m.text_adr[index]), int(m.text_size[index])
    pairs: dict[str, str] = {}
    for pair in bytes(m.text_data[start : start + size - 1]).decode().split():
        key, _, value = pair.partition("=")
        if not key or value not in own or key in pairs:
            raise ModelError(
                f"model {model.name!r}: custom text {BODIES_TEXT!r} holds {pair!r}: write opensim_body=body, "
                f"once each, with the model's bodies {listed(own)}"
            )
        pairs[key] = value
    return pairs


def up_axis(model: MuscleModel) -> NDArray[np.float64] | None:
    """(3,) the direction against gravity; None where the model has no gravity."""
    gravity = np.asarray(model.mj_model.opt.gravity, dtype=np.float64)
    size = float(np.linalg.norm(gravity))
    return -gravity / size if size > 0 else None


def to_world(model: MuscleModel, rotation: object | None) -> NDArray[np.float64]:
    """(3, 3) takes vectors in the file's ground to the model's world.

    Raises:
        SettingsError: what is given is no rotation.
        ModelError: none is given, and neither y nor z is the model's up.
    """
    if rotation is not None:
        try:
            R = np.array(rotation, dtype=np.float64)
        except (TypeError, ValueError):
            raise SettingsError("rotation: not an array of numbers: give a rotation matrix (3, 3)") from None
        if R.shape != (3, 3):
            raise SettingsError(f"rotation has shape {R.shape}: give a rotation matrix (3, 3)")
        if not np.abs(R @ R.T - np.eye(3)).max() < 1e-6 or np.linalg.det(R) < 0:
            raise SettingsError(
                f"rotation {np.array2string(R, precision=4, separator=', ').replace(chr(10), '')}: its rows are not "
                "three perpendicular unit vectors of a right-handed frame: give a rotation matrix"
            )
        return R
    up = up_axis(model)
    if up is not None and np.allclose(up, [0, 1, 0], atol=1e-6):
        return np.eye(3)
    if up is not None and np.allclose(up, [0, 0, 1], atol=1e-6):
        return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    what = "has no gravity" if up is None else f"has gravity {np.array2string(model.mj_model.opt.gravity, precision=4)}"
    raise ModelError(
        f"model {model.name!r} {what}, so that its up is neither y nor z: give rotation, (3, 3) from the loads' ground "
        "to the model's world"
    )


def zero_pose(model: MuscleModel) -> NDArray[np.float64]:
    """(nbody, 3, 3) the bodies' axes in the world where all hinges and slides are at 0."""
    m = model.mj_model
    d = mujoco.MjData(m)
    d.qpos[:] = m.qpos0
    single = np.isin(m.jnt_type, [int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)])
    d.qpos[m.jnt_qposadr[single]] = 0
    mujoco.mj_kinematics(m, d)
    return np.array(d.xmat).reshape(-1, 3, 3)


def body_weight(model: MuscleModel) -> float:
    """N, of all bodies; with 9.81 m/s2 where the model has no gravity."""
    m = model.mj_model
    return float(m.body_mass.sum() * (np.linalg.norm(m.opt.gravity) or 9.81))

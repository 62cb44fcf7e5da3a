"""Everything in a compiled model that the methods cannot follow, each with its place and its remedy."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import ModelError
from mjhcmc.opensim_names import read_opensim_names, read_pairs

COLUMN_MAP_TEXT = "opensim_coordinates"
"""Name of the MJCF ``<custom><text>`` whose data, ``joint=column ...``, maps a model's joints onto file columns."""

Level = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Problem:
    """Something about a model that its user should know.

    Attributes:
        what: what is found, with its value, as the end of a sentence that begins with `where`.
        where: the thing by its kind and name, such as ``muscle 'soleus'``.
        remedy: what to do about it.
        level: ``error`` (the methods refuse the model), ``warning`` (a solve will go wrong or need reserves somewhere)
            or ``note`` (good to know).
    """

    what: str
    where: str
    remedy: str
    level: Level = "error"

    def message(self, model: str) -> str:
        """The problem in one line, for a model of that name."""
        return f"model {model!r}: {self.where} {self.what}: {self.remedy}"


def names_of(m: Any, kind: Any, ids: Iterable[int], fallback: str) -> tuple[str, ...]:
    """Names in the order of ids; one without a name is called by its kind and number, such as joint3.

    Args:
        m: the compiled model.
        kind: the engine's type of object (``mjtObj``).
        ids: which of them.
        fallback: what to call a nameless one, before its number.
    """
    ids = [int(i) for i in ids]
    given = [mujoco.mj_id2name(m, kind, i) for i in ids]
    names = []
    for i, name in zip(ids, given, strict=True):
        own = name or f"{fallback}{i}"
        while not name and own in given:  # another has that very name
            own += "_"
        names.append(own)
    return tuple(names)


def joint_names_of(m: Any) -> tuple[str, ...]:
    """(njnt,) names of all joints."""
    return names_of(m, mujoco.mjtObj.mjOBJ_JOINT, range(m.njnt), "joint")


def joint_type(m: Any, j: int) -> str:
    """``hinge``, ``slide``, ``ball`` or ``free``."""
    return str(mujoco.mjtJoint(m.jnt_type[j]).name.removeprefix("mjJNT_").lower())


_COORDINATES = {"hinge": ("",), "slide": ("",), "ball": ("_qw", "_qx", "_qy", "_qz")}
_COORDINATES["free"] = ("_tx", "_ty", "_tz", *_COORDINATES["ball"])
_DOFS = {
    "hinge": ("",),
    "slide": ("",),
    "ball": ("_rx", "_ry", "_rz"),
    "free": ("_tx", "_ty", "_tz", "_rx", "_ry", "_rz"),
}


def coordinate_names_of(m: Any) -> list[tuple[str, str]]:
    """(nq) name and joint type of each coordinate, see `MuscleModel.joint_names`."""
    kinds = [joint_type(m, j) for j in range(m.njnt)]
    return [(n + end, k) for n, k in zip(joint_names_of(m), kinds, strict=True) for end in _COORDINATES[k]]


def dof_names_of(m: Any) -> tuple[str, ...]:
    """(nv,) names of the degrees of freedom, see `MuscleModel.dof_names`."""
    return tuple(n + end for j, n in enumerate(joint_names_of(m)) for end in _DOFS[joint_type(m, j)])


def dof_is_rotation_of(m: Any) -> NDArray[np.bool_]:
    """(nv,) True where a degree of freedom is a rotation."""
    kinds = [(joint_type(m, j), end) for j in range(m.njnt) for end in _DOFS[joint_type(m, j)]]
    return np.array([kind == "hinge" or end.startswith("_r") for kind, end in kinds], dtype=bool)


def muscle_ids_of(m: Any) -> NDArray[np.intp]:
    """(n_muscle,) actuator index of each muscle: what has MuJoCo's muscle activation dynamics."""
    return np.flatnonzero(m.actuator_dyntype == mujoco.mjtDyn.mjDYN_MUSCLE).astype(np.intp)


def read_column_map(m: Any, name: str) -> dict[str, str]:
    """File column by joint, as the model ships it in its custom text.

    Raises:
        ModelError: an entry that is no such pair.
    """
    return read_pairs(m, name, COLUMN_MAP_TEXT, "joint=column", joint_names_of(m))


def find_problems(m: Any, name: str) -> tuple[Problem, ...]:
    """All that keeps the methods from driving a compiled model; empty where they can.

    The methods need every muscle's force to be gain * activation + bias, up to a forcerange, with gain and bias
    functions of the posture and the velocities alone.

    Args:
        m: a ``mujoco.MjModel`` with at least one muscle.
        name: the model's name.
    """
    muscles = muscle_ids_of(m)
    names = names_of(m, mujoco.mjtObj.mjOBJ_ACTUATOR, muscles, "muscle")
    found = [*_joint_problems(m), *_state_problems(m)]
    for i, muscle in zip(muscles, names, strict=True):
        found += [Problem(what, f"muscle {muscle!r}", remedy) for what, remedy in _muscle_problems(m, int(i))]
    return (*found, *_moment_clamps(m), *_text_problems(m, name, names))


def _state_problems(m: Any) -> Iterator[Problem]:
    """Other actuators with a state that no window starts from: the plant's state is joints and muscle activation."""
    others = [i for i in range(m.nactuator) if m.actuator_dyntype[i] != mujoco.mjtDyn.mjDYN_MUSCLE]
    for i, name in zip(others, names_of(m, mujoco.mjtObj.mjOBJ_ACTUATOR, others, "actuator"), strict=True):
        kind = mujoco.mjtDyn(m.actuator_dyntype[i])
        if kind != mujoco.mjtDyn.mjDYN_NONE:
            what = f"has a state of its own (dyntype {kind.name.removeprefix('mjDYN_').lower()})"
            yield Problem(what, f"actuator {name!r}", "remove its dyntype or timeconst")
        elif m.actuator_delay[i] > 0:
            yield Problem(f"has a delay of {m.actuator_delay[i]:g} s", f"actuator {name!r}", "remove delay")


def _joint_problems(m: Any) -> Iterator[Problem]:
    kinds = mujoco.mjtEq
    known = {int(k) for k in (kinds.mjEQ_JOINT, kinds.mjEQ_TENDON, kinds.mjEQ_CONNECT, kinds.mjEQ_WELD)}
    active = np.flatnonzero(m.eq_active0)
    names = names_of(m, mujoco.mjtObj.mjOBJ_EQUALITY, active, "equality")
    for e, name in zip(active, names, strict=True):
        if int(m.eq_type[e]) not in known:
            yield Problem(
                "is of a type that cannot be followed (only joint, tendon, connect and weld can)",
                f"equality constraint {name!r}",
                'remove it or set active="false"',
            )


def _muscle_problems(m: Any, i: int) -> Iterator[tuple[str, str]]:
    """What would make the muscle's force other than gain * activation + bias, and the remedy."""
    gain, bias = mujoco.mjtGain, mujoco.mjtBias
    plain_gain = {int(kind) for kind in (gain.mjGAIN_FIXED, gain.mjGAIN_AFFINE, gain.mjGAIN_MUSCLE)}
    plain_bias = {int(kind) for kind in (bias.mjBIAS_NONE, bias.mjBIAS_AFFINE, bias.mjBIAS_MUSCLE)}
    if int(m.actuator_gaintype[i]) not in plain_gain or int(m.actuator_biastype[i]) not in plain_bias:
        yield "has a user-defined gain or bias", "use gaintype and biastype muscle"
    low, high = m.actuator_forcerange[i]
    if m.actuator_forcelimited[i] and not low < min(high, 0.0):
        yield f"has forcerange {_range((low, high))}, which leaves no pull (negative force)", "correct or remove it"
    if m.actuator_actlimited[i] and not (m.actuator_actrange[i, 0] <= 0 and m.actuator_actrange[i, 1] >= 1):
        yield f"has actrange {_range(m.actuator_actrange[i])}, narrower than 0..1", "remove actrange"
    if m.actuator_actearly[i]:
        yield "has actearly, so its force depends on excitation", "remove actearly"
    if m.actuator_delay[i] > 0:
        yield f"has a delay of {m.actuator_delay[i]:g} s", "remove delay"
    act, deact = m.actuator_dynprm[i, :2]
    if not (act > 0 and deact > 0):
        yield f"has time constants {act:g} and {deact:g} s", "give positive ones (timeconst)"
    low, high = m.actuator_ctrlrange[i]
    if m.actuator_ctrllimited[i] and not max(low, 0) < min(high, 1):
        yield f"has ctrlrange {_range((low, high))}, which leaves nothing of 0..1", "set ctrlrange to 0 1"
    off = m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    if off or (0 <= m.actuator_group[i] < 31 and m.opt.disableactuator & (1 << int(m.actuator_group[i]))):
        yield "is disabled by the model's options", "enable actuation and its actuator group"
    kind, target = m.actuator_trntype[i], int(m.actuator_trnid[i, 0])
    if kind == mujoco.mjtTrn.mjTRN_TENDON and m.tendon_actfrclimited[target]:
        tendon = names_of(m, mujoco.mjtObj.mjOBJ_TENDON, [target], "tendon")[0]
        yield f"pulls tendon {tendon!r}, whose force is clamped by actuatorfrcrange", "remove it"


def _moment_clamps(m: Any) -> Iterator[Problem]:
    for name, clamped in zip(joint_names_of(m), m.jnt_actfrclimited, strict=True):
        if clamped:
            yield Problem(
                "is clamped by actuatorfrcrange, so it is not affine in activation",
                f"the muscles' moment at joint {name!r}",
                "remove actuatorfrcrange",
            )


def _text_problems(m: Any, name: str, muscles: Sequence[str]) -> Iterator[Problem]:
    """The first slip in the column map and in OpenSim's names; their readers tell no more."""
    for read in (
        lambda: read_column_map(m, name),
        lambda: read_opensim_names(m, name, joint_names_of(m), muscles),
    ):
        try:
            read()
        except ModelError as error:
            told = str(error).removeprefix(f"model {name!r}: ")
            split = re.fullmatch(r"(custom text '[^']*') (.*)[;:] (.*)", told)
            where, what, remedy = split.groups() if split else ("a custom text", told, "correct it")
            yield Problem(what, where, remedy)


def _range(values: Any) -> str:
    return f"{values[0]:g}..{values[1]:g}"

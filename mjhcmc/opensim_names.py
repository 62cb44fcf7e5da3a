"""What OpenSim calls a model's joints and muscles, as the model's own custom texts say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from mjhcmc.errors import ModelError

BODIES_TEXT = "opensim_bodies"
"""Name of the MJCF custom text that tells which body stands for each of OpenSim's: ``calcn_r=foot toes_r=foot``."""

PATHS_TEXT = "opensim_paths"
"""Name of the MJCF ``<custom><text>`` with each joint's coordinate in OpenSim, ``joint=/jointset/joint/coordinate``."""

MUSCLES_TEXT = "opensim_muscles"
"""Name of the text with each muscle's name in OpenSim, ``muscle=name ...``."""

PENNATION_TEXT = "pennation_angles"
"""Name of the text with each muscle's pennation angle at optimal fiber length, ``muscle=rad ...``."""


@dataclass(frozen=True)
class OpenSimNames:
    """What a model knows of its twin in OpenSim; a joint or muscle that is missing goes by its own name.

    Attributes:
        paths: ``/jointset/<joint>/<coordinate>`` by joint.
        muscles: OpenSim's muscle by muscle.
        pennation: rad by muscle, the pennation angle at optimal fiber length, which MuJoCo's muscle has no place for.
    """

    paths: Mapping[str, str] = field(default_factory=dict)
    muscles: Mapping[str, str] = field(default_factory=dict)
    pennation: Mapping[str, float] = field(default_factory=dict)


def read_opensim_names(m: Any, name: str, joints: Sequence[str], muscles: Sequence[str]) -> OpenSimNames:
    """The names in a compiled model's custom texts; empty where it ships none.

    Args:
        m: the ``mujoco.MjModel``.
        name: what messages call the model.
        joints: names of its joints.
        muscles: names of its muscles.

    Raises:
        ModelError: a text that cannot be understood, names a joint or muscle that is none, or gives two of them the
            same name.
    """
    paths = read_pairs(m, name, PATHS_TEXT, "joint=/jointset/joint/coordinate", joints)
    named = read_pairs(m, name, MUSCLES_TEXT, "muscle=name", muscles)
    for joint, path in paths.items():
        parts = path.split("/")
        if len(parts) < 3 or parts[0] or not all(parts[1:]):
            raise ModelError(
                f"model {name!r}: custom text {PATHS_TEXT!r} gives joint {joint!r} the path {path!r}: write it as "
                "/jointset/joint/coordinate"
            )
    for text, given in ((PATHS_TEXT, paths), (MUSCLES_TEXT, named)):
        for own, other in given.items():
            twice = next(key for key, value in given.items() if value == other)
            if twice != own:
                raise ModelError(
                    f"model {name!r}: custom text {text!r} gives {twice!r} and {own!r} the same name {other!r}: "
                    "correct one"
                )
    pennation = {}
    for muscle, word in read_pairs(m, name, PENNATION_TEXT, "muscle=rad", muscles).items():
        try:
            angle = float(word)
        except ValueError:
            angle = math.nan
        if not 0 <= angle < math.pi / 2:
            raise ModelError(
                f"model {name!r}: custom text {PENNATION_TEXT!r} gives {muscle!r} the angle {word!r}: write radians, "
                "0 to under pi/2"
            )
        pennation[muscle] = angle
    return OpenSimNames(paths, named, pennation)


def read_pairs(m: Any, name: str, text: str, form: str, keys: Sequence[str]) -> dict[str, str]:
    """The ``key=value`` pairs of a custom text, empty where the model has no such text.

    Raises:
        ModelError: a pair without value, with a key that is not among keys, or with a key that stands twice.
    """
    import mujoco

    index = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_TEXT, text)
    if index < 0:
        return {}
    start, size = int(m.text_adr[index]), int(m.text_size[index])
    pairs: dict[str, str] = {}
    for pair in bytes(m.text_data[start : start + size - 1]).decode().split():
        key, found, value = pair.partition("=")
        if not found or key not in keys or not value.lstrip("-") or key in pairs:
            twice = " a second time" if key in pairs else ""
            raise ModelError(
                f"model {name!r}: custom text {text!r} holds {pair!r}{twice}; write {form}, once each, for "
                f"{', '.join(keys)}"
            )
        pairs[key] = value
    return pairs

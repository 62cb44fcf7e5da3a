"""What the tests of motions share: small stand-ins for models, and files of their movements."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from mjhcmc.io.opensim import read_table, write_table

WALK = Path(__file__).parent / "data" / "walk"
DEG = np.pi / 180


@dataclass(frozen=True)
class Leg:
    name: str = "leg"
    joint_names: tuple[str, ...] = ("hip", "knee", "ankle")
    joint_is_rotation: np.ndarray = field(default_factory=lambda: np.ones(3, dtype=bool))
    joint_range: np.ndarray = field(
        default_factory=lambda: np.array([[-120.0, 120.0], [-120.0, 10.0], [-90.0, 90.0]]) * DEG
    )
    qpos_reference: np.ndarray = field(default_factory=lambda: np.zeros(3))
    column_map: dict[str, str] = field(
        default_factory=lambda: {
            "hip": "hip_flexion_r",
            "knee": "knee_angle_r",
            "ankle": "ankle_angle_r",
        }
    )


LEG = Leg()
CART = Leg(
    name="cart",
    joint_names=("rail", "pole"),
    joint_is_rotation=np.array([False, True]),
    joint_range=np.array([[-1.0, 1.0], [-np.inf, np.inf]]),
    qpos_reference=np.array([0.1, 0.2]),
    column_map={},
)


def wave(time, amplitude=20.0):
    return amplitude * np.sin(np.outer(time, [2, 3, 4])) * [1, 0.4, 1]


TIME = np.linspace(0, 1, 21)
DATA = wave(TIME)


def measured():
    """Times and angles, deg, of the leg in the measured walk."""
    table = read_table(WALK / "subject01_walk_IK.mot")
    used = [table.columns.index(name) for name in LEG.column_map.values()]
    return table.time, table.values[:, used]


@pytest.fixture
def write(tmp_path):
    """Write a table and return its path; columns default to the leg's joints."""

    def write(time, values, columns=LEG.joint_names, in_degrees=True, name="m.mot"):
        path = tmp_path / name
        write_table(path, columns, time, values, name="m", in_degrees=in_degrees)
        return path

    return write

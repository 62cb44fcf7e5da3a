"""The one parameter table of leg8: reading it, and writing it back after a fit.

The table has three sections. ``source`` holds the numbers of gait10dof18musc (Delp, Loan, Hoy, Zajac, Topp, Rosen,
Thelen, Anderson, Seth; CC-BY 3.0), unchanged, in SI units, radians and the source's frames. ``fitted`` holds what
:mod:`mjhcmc.leg8.fit` computed. ``appearance`` holds the visible shapes and colours, which carry no mechanics.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

MUSCLES: tuple[str, ...] = (
    "iliopsoas",
    "glut_max",
    "rect_fem",
    "hamstrings",
    "vasti",
    "gastroc",
    "soleus",
    "tib_ant",
)
"""The eight muscles in the order of the model's actuators."""

JOINTS: tuple[str, ...] = ("hip", "knee", "ankle")
"""The three hinges in the order of the model's coordinates."""

ROOT_JOINTS: tuple[str, ...] = ("pelvis_tx", "pelvis_ty", "pelvis_tilt")
"""The joints of a pelvis that moves in the sagittal plane, before the three hinges; OpenSim's names."""


def table_path() -> Path:
    """Where the parameter table lies, in the package itself."""
    return Path(str(files("mjhcmc.leg8").joinpath("parameters.json")))


def load_table(path: Path | None = None) -> dict[str, Any]:
    """Read the parameter table.

    Args:
        path: Another table to read; the package's own where None.

    Returns:
        The table as nested dictionaries with the sections ``source``, ``fitted`` and ``appearance``.
    """
    text = (path or table_path()).read_text(encoding="utf-8")
    table: dict[str, Any] = json.loads(text)
    return table


def dump_table(table: Mapping[str, Any]) -> str:
    """The table as JSON text: one key a line, and whatever fits on a line is kept on it."""
    return _dump(table, 0) + "\n"


def save_table(table: Mapping[str, Any], path: Path | None = None) -> None:
    """Write the table whole or not at all (to a temporary name, then renamed)."""
    target = path or table_path()
    temporary = target.with_suffix(".json.part")
    temporary.write_text(dump_table(table), encoding="utf-8")
    temporary.replace(target)


def _dump(value: Any, level: int) -> str:
    line = json.dumps(value, ensure_ascii=False)
    flat = isinstance(value, list) and not any(isinstance(item, dict | list) for item in value)
    if flat or not isinstance(value, dict | list) or len(line) + level <= 100:
        return line
    pad = " " * (level + 1)
    if isinstance(value, dict):
        body = [f"{pad}{json.dumps(key, ensure_ascii=False)}: {_dump(item, level + 1)}" for key, item in value.items()]
        return "{\n" + ",\n".join(body) + "\n" + " " * level + "}"
    body = [pad + _dump(item, level + 1) for item in value]
    return "[\n" + ",\n".join(body) + "\n" + " " * level + "]"

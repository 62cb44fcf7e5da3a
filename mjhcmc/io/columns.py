"""Which column of a table holds which joint: the user's map, the names, the model's own map."""

import csv
import json
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError
from mjhcmc.io.motion_table import MotionTable
from mjhcmc.io.text import read_lines
from mjhcmc.io.units import SOLUTION_PREFIX, split_unit
from mjhcmc.joints import JointModel

Array = NDArray[np.float64]

MANY = 12
"""Names listed in a message before the rest is only counted."""


def listed(names: tuple[str, ...] | list[str]) -> str:
    """Names for a message, the first dozen of them."""
    more = len(names) - MANY
    return ", ".join(names[:MANY]) + (f" and {more} more" if more > 0 else "")


def read_map(
    given: Mapping[str, str] | str | os.PathLike[str] | None,
    key: str = "joint",
    value: str = "column",
    what: str = "column map",
) -> dict[str, str]:
    """The user's map of joints to columns (or of sites to markers).

    Args:
        given: the map; or a file of it: a .csv with two cells a line (a first line such as ``joint,column`` is
            passed over, so are lines that begin with #), any other a JSON object.
        key: what is mapped, for messages.
        value: what it is mapped to, for messages.
        what: what to call the map, for messages.

    Raises:
        MotionError: the file cannot be read or holds no such map, or an entry is no name.
    """
    if given is None:
        return {}
    where = what
    if isinstance(given, Mapping):
        content = dict(given)
    else:
        where = f"{what} {given}"
        path = Path(given)
        if path.suffix.lower() == ".csv":
            content = _read_csv_map(path, what, key, value)
        else:
            content = _read_json(path, where, f"{key} names and {value} names")
    for name, target in content.items():
        if not isinstance(target, str) or not target.strip("- "):
            raise MotionError(
                f"{where}: {key} {name!r} maps to {target!r}: give a {value}'s name"
                f"{', with a minus to flip it' if value == 'column' else ''}"
            )
    return content


def _read_json(path: Path, where: str, names: str) -> dict[str, str]:
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise MotionError(f"{where}: cannot be read ({error.strerror}): check the path") from None
    except UnicodeDecodeError:
        raise MotionError(f"{where}: not a text file: give JSON, an object of {names}") from None
    except json.JSONDecodeError as error:
        raise MotionError(f"{where}, line {error.lineno}: not JSON ({error.msg}): give an object of {names}") from None
    if not isinstance(content, dict):
        raise MotionError(f"{where}: holds no object: give one of {names}")
    return content


def _read_csv_map(path: Path, what: str, key: str, value: str) -> dict[str, str]:
    where = f"{what} {path}"
    try:
        lines = read_lines(path, f"a table of {key}s and {value}s")
    except MotionError as error:
        raise MotionError(f"{what} {error}") from None
    content: dict[str, str] = {}
    first = True
    for at, line in enumerate(lines, 1):
        if not line.strip(" \t,;") or line.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in split_cells(path, at, line, delimiter_of(line))]
        if len(cells) != 2 or not all(cells):
            raise MotionError(f"{where}, line {at}: {line.strip()!r} are no two names: write {key},{value}")
        if first and cells[0].lower() == key:
            first = False
            continue
        first = False
        if cells[0] in content:
            raise MotionError(f"{where}, line {at}: {key} {cells[0]!r} stands twice: remove one of the lines")
        content[cells[0]] = cells[1]
    if not content:
        raise MotionError(f"{where}: holds no pair of names: write lines {key},{value}")
    return content


def delimiter_of(line: str) -> str:
    """What separates the cells of a line: the comma, semicolon or tab that is there most often."""
    return max(",;\t", key=line.count)


def split_cells(path: Path, at: int, line: str, delimiter: str) -> list[str]:
    """The cells of a line of a .csv, with quotes taken off."""
    if '"' not in line:
        return line.split(delimiter)
    if line.count('"') % 2:
        raise MotionError(f"{path}, line {at}: a quote that does not end: correct it")
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except csv.Error as error:
        raise MotionError(f"{path}, line {at}: cannot be split into cells ({error}): correct it") from None


def match_columns(table: MotionTable, model: JointModel, given: dict[str, str]) -> tuple[list[int], list[int], Array]:
    """Joints that have a column (n, among nq), the index of each one's column among the table's, its sign (n,).

    Joints that need not be named (see `MuscleModel.may_be_silent`) may lack one, but not all of the others.
    """
    joints = tuple(model.joint_names)
    unknown = [joint for joint in given if joint not in joints]
    if unknown:
        raise MotionError(
            f"column map: model {model.name} has no joint {', '.join(unknown)}: its joints are {', '.join(joints)}"
        )
    columns = {joint: _column_of(table, model, joint, given) for joint in joints}
    found = [j for j, joint in enumerate(joints) if columns[joint] is not None]
    silent = getattr(model, "may_be_silent", {})
    # joints that follow or are led anyway do not make a motion
    moved = any(not silent.get(joints[j], False) for j in found)
    for joint in joints:
        if columns[joint] is None and (joint in given or joint not in silent or not moved):
            if joint in silent and silent[joint] and any(j not in silent or not silent[j] for j in joints):
                continue
            raise _no_column(table, model, joint, given)
    pairs = [pair for pair in columns.values() if pair is not None]
    return found, [at for at, _ in pairs], np.array([sign for _, sign in pairs])


def _column_of(table: MotionTable, model: JointModel, joint: str, given: dict[str, str]) -> tuple[int, float] | None:
    for name in _names_of(model, joint, given):
        at = find_column(table, name.removeprefix("-"))
        if at is not None:
            return at, -1.0 if name.startswith("-") else 1.0
    return None


def _no_column(table: MotionTable, model: JointModel, joint: str, given: dict[str, str]) -> MotionError:
    columns = f"its columns are {listed(table.columns)}"
    if joint in given:
        return MotionError(
            f"{table.path}: no column {given[joint].removeprefix('-')!r}, which the column map names for joint "
            f"{joint}; {columns}: name one of them"
        )
    looked_for = [name.removeprefix("-") for name in _names_of(model, joint, given)]
    looked_for.remove(SOLUTION_PREFIX + joint)
    return MotionError(
        f"{table.path}: no column for joint {joint} of model {model.name} (looked for {' and '.join(looked_for)}); "
        f"{columns}: map one with a column map such as "
        f"{{{json.dumps(joint)}: {json.dumps(_free_column(table, model, given))}}}"
    )


def _names_of(model: JointModel, joint: str, given: dict[str, str]) -> list[str]:
    """Names that a joint's column may have, a minus in front of those that flip it."""
    if joint in given:
        return [given[joint]]
    return [joint, SOLUTION_PREFIX + joint, *filter(None, [model.column_map.get(joint)])]


def _free_column(table: MotionTable, model: JointModel, given: dict[str, str]) -> str:
    """A column that is no joint's, for an example; a word in its place where each is."""
    names = [name.removeprefix("-") for joint in model.joint_names for name in _names_of(model, joint, given)]
    taken = {find_column(table, name) for name in names}
    return next((column for i, column in enumerate(table.columns) if i not in taken), "its column")


def find_column(table: MotionTable, name: str) -> int | None:
    """A column by its name, else by the coordinate in an OpenSim path (/jointset/hip/hip_flexion/value)."""
    if name in table.columns:
        return table.columns.index(name)
    bare, unit = split_unit(name)
    if unit is not None and bare in table.columns and table.units[table.columns.index(bare)] == unit:
        return table.columns.index(bare)
    paths = [column.split("/") for column in table.columns]
    found = [i for i, path in enumerate(paths) if len(path) > 1 and path[-1] == "value" and path[-2] == name]
    if len(found) > 1:
        raise MotionError(
            f"{table.path}: columns {' and '.join(table.columns[i] for i in found)} both hold {name}: "
            "name one in full in a column map"
        )
    return found[0] if found else None

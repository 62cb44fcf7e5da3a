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
    given: Mapping[str, str] | str | os.PathLike[str] | None, key: str = "joint", value: str = "column"
) -> dict[str, str]:
    """The user's map of joints to columns (or of sites to markers).

    Args:
        given: the map; or a file of it: a .csv with two cells a line (a first line such as ``joint,column`` is
            passed over, so are lines that begin with #), any other a JSON object.
        key: what is mapped, for messages.
        value: what it is mapped to, for messages.

    Raises:
        MotionError: the file cannot be read or holds no such map, or an entry is no name.
    """
    if given is None:
        return {}
    where = "column map"
    if isinstance(given, Mapping):
        content = dict(given)
    else:
        where = f"column map {given}"
        path = Path(given)
        content = _read_csv_map(path, where, key, value) if path.suffix.lower() == ".csv" else _read_json(path, where)
    for name, target in content.items():
        if not isinstance(target, str) or not target.strip("- "):
            raise MotionError(
                f"{where}: {key} {name!r} maps to {target!r}: give a {value}'s name"
                f"{', with a minus to flip it' if value == 'column' else ''}"
            )
    return content


def _read_json(path: Path, where: str) -> dict[str, str]:
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise MotionError(f"{where}: cannot be read ({error.strerror}): check the path") from None
    except UnicodeDecodeError:
        raise MotionError(f"{where}: not a text file: give JSON, an object of joint names and column names") from None
    except json.JSONDecodeError as error:
        raise MotionError(
            f"{where}, line {error.lineno}: not JSON ({error.msg}): give an object of joint names and column names"
        ) from None
    if not isinstance(content, dict):
        raise MotionError(f"{where}: holds no object: give one of joint names and column names")
    return content


def _read_csv_map(path: Path, where: str, key: str, value: str) -> dict[str, str]:
    try:
        lines = read_lines(path, f"a table of {key}s and {value}s")
    except MotionError as error:
        raise MotionError(f"column map {error}") from None
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


def match_columns(table: MotionTable, model: JointModel, given: dict[str, str]) -> tuple[list[int], Array]:
    """(nq) index of each joint's column among the table's, and (nq,) its sign."""
    joints = tuple(model.joint_names)
    unknown = [joint for joint in given if joint not in joints]
    if unknown:
        raise MotionError(
            f"column map: model {model.name} has no joint {', '.join(unknown)}: its joints are {', '.join(joints)}"
        )
    used, signs = [], np.ones(len(joints))
    for j, joint in enumerate(joints):
        for name in _names_of(model, joint, given):
            at = find_column(table, name.removeprefix("-"))
            if at is not None:
                used.append(at)
                signs[j] = -1.0 if name.startswith("-") else 1.0
                break
        else:
            columns = f"its columns are {listed(table.columns)}"
            if joint in given:
                raise MotionError(
                    f"{table.path}: no column {given[joint].removeprefix('-')!r}, which the column map "
                    f"names for joint {joint}; {columns}: name one of them"
                )
            looked_for = [name.removeprefix("-") for name in _names_of(model, joint, given)]
            looked_for.remove(SOLUTION_PREFIX + joint)
            raise MotionError(
                f"{table.path}: no column for joint {joint} of model {model.name} (looked for "
                f"{' and '.join(looked_for)}); {columns}: "
                f"map one with a column map such as "
                f"{{{json.dumps(joint)}: {json.dumps(_free_column(table, model, given))}}}"
            )
    return used, signs


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

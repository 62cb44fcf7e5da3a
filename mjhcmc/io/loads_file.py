"""From a file to ExternalLoads: the table and its columns, whose bodies, in which axes, in which units."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import MjhcmcWarning, MotionError, SettingsError
from mjhcmc.external_loads import GROUND, ExternalLoads
from mjhcmc.io import csv_table, opensim
from mjhcmc.io.columns import listed
from mjhcmc.io.load_bodies import BodyNames, body_weight, to_world, zero_pose
from mjhcmc.io.motion_table import MotionTable
from mjhcmc.io.opensim_loads import LoadEntry, LoadsDocument, bare_name, read_loads_xml
from mjhcmc.joints import TIME_TOLERANCE

if TYPE_CHECKING:
    from mjhcmc.model import MuscleModel

Array = NDArray[np.float64]

TABLE_SUFFIXES = (*opensim.SUFFIXES, *csv_table.SUFFIXES)
XML_SUFFIXES = (".xml",)

_KINDS = ("force", "point", "torque")
_EXAMPLE = '{"foot": {"force": "ground_force_v", "point": "ground_force_p", "torque": "ground_torque_"}}'
_FAR = 30.0  # m: a point this far out under load looks like mm
_LOADED = 0.05  # of the load's peak: below, the point is noise
_HEAVY = 20.0  # body weights
_TWIST = 3.0  # m: a free torque over force, or weight, at this lever looks like N mm


def read_loads(
    path: str | os.PathLike[str],
    model: MuscleModel,
    *,
    data: str | os.PathLike[str] | None,
    column_map: Mapping[str, Any] | str | os.PathLike[str] | None,
    bodies: Mapping[str, str] | None,
    osim: str | os.PathLike[str] | Iterable[str] | None,
    rotation: ArrayLike | None,
) -> ExternalLoads:
    """See `ExternalLoads.from_file`."""
    path = Path(path)
    suffix = path.suffix.lower()
    notices: list[str] = []
    if suffix in XML_SUFFIXES:
        if column_map is not None:
            raise SettingsError(f"{path}: says itself which columns it takes: leave column_map out")
        document = read_loads_xml(path)
        entries, source = document.entries, loads_table(document, data, notices)
    elif suffix in TABLE_SUFFIXES:
        if data is not None:
            raise SettingsError(f"{path}: is a table: leave data out, or give the .xml that describes the loads")
        if column_map is None:
            raise SettingsError(
                f"{path}: nothing says which columns load which body: give the .xml that describes them, or a "
                f"column_map such as {_EXAMPLE}"
            )
        entries, source = _entries_of_map(column_map), path
    else:
        endings = ", ".join((*XML_SUFFIXES, *TABLE_SUFFIXES))
        raise MotionError(f"{path}: a file of loads ends in {endings}, not in {path.suffix or 'nothing'!r}")

    R = to_world(model, rotation)
    placed = _place(path, entries, BodyNames(path, model, bodies, osim), notices)
    table = csv_table.read_csv(source) if source.suffix.lower() in csv_table.SUFFIXES else opensim.read_table(source)
    columns = [[_columns(table, each.entry, kind) for kind in _KINDS] for each in placed]
    rows = _rows(table, sorted({i for load in columns for three in load for i in three}), notices)
    loads = [_values(table, rows, each.entry, three, notices) for each, three in zip(placed, columns, strict=True)]
    time = table.time[rows]
    for each, three, values in zip(placed, columns, loads, strict=True):
        _check_units(table, each.entry.label, time, three, values, body_weight(model))
    axes = _Axes(model, R)
    return ExternalLoads(
        str(path),
        time,
        tuple(each.body for each in placed),
        np.stack([axes.turned(load[0], each.force_frame) for load, each in zip(loads, placed, strict=True)], axis=1),
        np.stack([axes.turned(load[2], each.force_frame) for load, each in zip(loads, placed, strict=True)], axis=1),
        np.stack([axes.turned(load[1], each.point_frame) for load, each in zip(loads, placed, strict=True)], axis=1),
        tuple(each.force_frame for each in placed),
        tuple(each.point_frame for each in placed),
        tuple(each.entry.label for each in placed),
        tuple(notices),
    )


@dataclass(frozen=True)
class _Placed:
    """A load whose bodies are the model's."""

    entry: LoadEntry
    body: str
    force_frame: str
    point_frame: str


class _Axes:
    """Turns vectors from OpenSim's axes to the model's."""

    def __init__(self, model: MuscleModel, R: Array) -> None:
        self.R, self.pose, self.m = R, zero_pose(model), model.mj_model

    def turned(self, vectors: Array, frame: str) -> Array:
        """(T, 3) in the world, or in a body's axes."""
        R = self.R if frame == GROUND else self.pose[self.m.body(frame).id].T @ self.R
        return vectors if np.array_equal(R, np.eye(3)) else np.asarray(vectors @ R.T)


def loads_table(document: LoadsDocument, data: str | os.PathLike[str] | None, notices: list[str]) -> Path:
    """The table that holds the loads of a document; what the user may want to know of the choice joins the notices."""
    if data is not None:
        return Path(data)
    path = document.path
    name = document.datafile
    if not name:
        sources = {entry.source for entry in document.entries if entry.source and not entry.is_disabled}
        if len(sources) != 1:
            found = f"its loads name {listed(sorted(sources))}" if sources else "nor do its loads"
            raise MotionError(f"{path}: names no datafile, {found}: give the table of loads with data")
        name = sources.pop()
    told = path.parent / name
    beside = path.parent / name.replace("\\", "/").rpartition("/")[2]  # written on another machine
    for candidate in (told, path.parent / name.replace("\\", "/"), beside):
        if candidate.is_file():
            if candidate == beside != told:
                notices.append(f"{path}: its datafile {name!r} is not there: {beside} is read")
            return candidate
    raise MotionError(f"{path}: its datafile {name!r} is not there: put it beside the .xml, or give it with data")


def _entries_of_map(given: Mapping[str, Any] | str | os.PathLike[str]) -> tuple[LoadEntry, ...]:
    """The loads of an explicit map."""
    where, content = "column_map", given
    if not isinstance(given, Mapping):
        where = f"column_map {os.fspath(given)}"
        try:
            content = json.loads(Path(given).read_text(encoding="utf-8-sig"))
        except OSError as error:
            raise MotionError(f"{where}: cannot be read ({error.strerror}): check the path") from None
        except UnicodeDecodeError:
            raise MotionError(f"{where}: not a text file: give JSON such as {_EXAMPLE}") from None
        except json.JSONDecodeError as error:
            raise MotionError(
                f"{where}, line {error.lineno}: not JSON ({error.msg}): write it like {_EXAMPLE}"
            ) from None
    if not isinstance(content, Mapping) or not content:
        raise MotionError(f"{where}: holds no bodies: write it like {_EXAMPLE}")
    return tuple(
        _entry_of_map(
            where, str(body), load, f"{body} {i}" if isinstance(loads, list) and len(loads) > 1 else str(body)
        )
        for body, loads in content.items()
        for i, load in enumerate(loads if isinstance(loads, list) else [loads], 1)
    )


def _entry_of_map(where: str, body: str, load: Any, label: str) -> LoadEntry:
    if not isinstance(load, Mapping) or not load:
        raise MotionError(f"{where}: body {body!r} maps to {load!r}: write it like {_EXAMPLE}")
    unknown = [key for key in load if key not in (*_KINDS, "frame")]
    if unknown:
        raise MotionError(f"{where}: body {body!r} has {unknown[0]!r}: its entries are {', '.join(_KINDS)} and frame")
    three: dict[str, str | tuple[str, ...]] = {}
    for kind in _KINDS:
        value = load.get(kind)
        if isinstance(value, str) and value:
            three[kind] = value
        elif isinstance(value, (list, tuple)) and len(value) == 3 and all(isinstance(name, str) for name in value):
            three[kind] = tuple(value)
        elif value is not None:
            raise MotionError(
                f"{where}: {kind} of body {body!r} is {value!r}: give the beginning of three columns' names, or the "
                "three names"
            )
    if "force" not in three and ("torque" not in three or "point" in three):
        raise MotionError(f"{where}: body {body!r} has no force: name its columns")
    frame = load.get("frame") or "ground"
    if not isinstance(frame, str):
        raise MotionError(f"{where}: frame of body {body!r} is {frame!r}: give a body's name, or leave it out")
    frame = bare_name(frame)
    return LoadEntry(label, bare_name(body), three.get("force"), three.get("point"), three.get("torque"), frame, frame)


def _place(path: Path, entries: tuple[LoadEntry, ...], names: BodyNames, notices: list[str]) -> list[_Placed]:
    """The loads that act on the model's bodies; the others are noted."""
    names.check_given(
        name for entry in entries for name in (entry.body, entry.force_frame, entry.point_frame) if name != "ground"
    )
    placed = []
    for entry in entries:
        what = f"load {entry.label!r} on {entry.body}"
        if entry.is_disabled:
            notices.append(f"{what} left out: the file switches it off")
            continue
        body = names.find(entry.body, entry.label)
        if body is None:
            notices.append(f"{what} left out: {names.osim_name} has that body, model {names.model.name!r} has not")
            continue
        if body == GROUND:
            notices.append(f"{what} left out: it acts on the ground")
            continue
        frames = [names.find(frame, entry.label) for frame in (entry.force_frame, entry.point_frame)]
        for own, frame in zip(frames, (entry.force_frame, entry.point_frame), strict=True):
            if own is None:
                raise MotionError(
                    f"{path}: {what} is given in the frame of {frame}, which model {names.model.name!r} has not: "
                    "give it in the ground's, or map that body with bodies"
                )
        force_frame, point_frame = (frame or GROUND for frame in frames)
        if entry.point is None:
            point_frame = body
            if entry.force is not None:
                notices.append(f"{what} has no point: it acts at the origin of body {body!r}")
        elif point_frame != GROUND and point_frame != entry.point_frame:
            notices.append(f"{what} acts at a point in {entry.point_frame}, taken from the origin of {point_frame!r}")
        placed.append(_Placed(entry, body, force_frame, point_frame))
    if not placed:
        raise MotionError(f"{path}: no load is left for model {names.model.name!r}: {'; '.join(notices)}")
    return placed


def _columns(table: MotionTable, entry: LoadEntry, kind: str) -> tuple[int, ...]:
    """Indices of the three columns of a load's force, point or torque; none where it has none."""
    wanted: str | tuple[str, ...] | None = getattr(entry, kind)
    if wanted is None:
        return ()
    what = f"{kind} of load {entry.label!r} on {entry.body}"
    if isinstance(wanted, tuple):
        missing = [name for name in wanted if name not in table.columns]
        if missing:
            raise MotionError(
                f"{table.path}: no column {missing[0]!r} for the {what}; its columns are {listed(table.columns)}: "
                "name one of them"
            )
        return tuple(table.columns.index(name) for name in wanted)
    for ends in ("xyz", "XYZ"):
        if all(wanted + end in table.columns for end in ends):
            return tuple(table.columns.index(wanted + end) for end in ends)
    found = [i for i, name in enumerate(table.columns) if name.startswith(wanted)]
    if len(found) != 3:
        have = f"{listed([table.columns[i] for i in found])} do" if found else "none does"
        raise MotionError(
            f"{table.path}: the {what} is to be in three columns whose names begin with {wanted!r}, and {have}; "
            f"its columns are {listed(table.columns)}: correct the identifier or the column names"
        )
    return tuple(found)


def _rows(table: MotionTable, used: list[int], notices: list[str]) -> NDArray[np.intp]:
    """Rows to use: all but those that repeat the row before; times must increase."""
    bad = np.flatnonzero(~np.isfinite(table.time))
    if len(bad):
        raise MotionError(
            f"{table.path}, line {table.line_numbers[bad[0]]}: time is not finite: correct or remove the row"
        )
    steps = np.diff(table.time)
    values = table.values[:, used]
    repeated = (np.abs(steps) <= TIME_TOLERANCE) & ((values[1:] == values[:-1]) | np.isnan(values[1:])).all(axis=1)
    wrong = np.flatnonzero((steps <= TIME_TOLERANCE) & ~repeated)
    if len(wrong):
        i = wrong[0]
        raise MotionError(
            f"{table.path}, line {table.line_numbers[i + 1]}: time {table.time[i + 1]:.12g} s follows "
            f"{table.time[i]:.12g} s: times must increase: remove one of the rows"
        )
    if repeated.any():
        notices.append(f"{table.path}: {int(repeated.sum())} rows dropped that repeat the row before")
    rows = np.flatnonzero(np.concatenate([[True], ~repeated]))
    if len(rows) < 2:
        raise MotionError(f"{table.path}: {len(rows)} row: loads need at least 2")
    return rows


def _values(
    table: MotionTable,
    rows: NDArray[np.intp],
    entry: LoadEntry,
    columns: list[tuple[int, ...]],
    notices: list[str],
) -> list[Array]:
    """Force, point and torque, each (T, 3), of one load; zeros for what it does not have."""
    read = []
    for kind, three in zip(_KINDS, columns, strict=True):
        values = table.values[rows][:, list(three)] if three else np.zeros((len(rows), 3))
        for axis, i in enumerate(three):
            unit = table.units[i]
            if unit is not None and (kind != "point" or unit not in ("m", "mm")):
                remedy = "points are in m or mm" if kind == "point" else "forces are in N, torques in N m"
                raise MotionError(
                    f"{table.path}: column {table.columns[i]!r}, {kind} of load {entry.label!r}, is in {unit}: {remedy}"
                )
            values[:, axis] *= 1e-3 if unit == "mm" else 1.0
        read.append(values)
    force, point, torque = read
    gone = ~np.isfinite(point).all(axis=1)
    idle = gone & (force == 0).all(axis=1) & (torque == 0).all(axis=1)
    if idle.any():
        known = np.flatnonzero(~gone)
        if len(known):
            point[idle] = point[_nearest(len(rows), known)[idle]]
        else:
            point[idle] = 0.0
        notices.append(
            f"{table.path}: load {entry.label!r} is 0 and has no point in {int(idle.sum())} rows: the nearest is kept"
        )
    for kind, three, values in zip(_KINDS, columns, read, strict=True):
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            row, axis = bad[0]
            raise MotionError(
                f"{table.path}, line {table.line_numbers[rows[row]]}, column {table.columns[three[axis]]!r}: "
                f"{values[row, axis]} in the {kind} of load {entry.label!r}: fill the gap, or write 0 for force and "
                "torque where there is no load"
            )
    return read


def _nearest(n: int, known: NDArray[np.intp]) -> NDArray[np.intp]:
    """(n,) for each row the nearest of the known ones."""
    after = np.minimum(np.searchsorted(known, np.arange(n)), len(known) - 1)
    before = np.maximum(after - 1, 0)
    closer = np.abs(known[before] - np.arange(n)) <= np.abs(known[after] - np.arange(n))
    return np.where(closer, known[before], known[after])


def _check_units(
    table: MotionTable,
    label: str,
    time: Array,
    columns: list[tuple[int, ...]],
    values: list[Array],
    weight: float,
) -> None:
    """Warn where magnitudes look like other units."""
    force, point, torque = values
    size = np.linalg.norm(force, axis=1)
    peak = float(size.max())
    doubts = (
        (0, force, _HEAVY * weight, f"over {_HEAVY:g} times the model's weight ({weight:.4g} N)", "forces are in N"),
        (
            1,
            np.where((size > _LOADED * peak)[:, None], point, 0.0),
            _FAR,
            "which looks like mm",
            "points are in m: divide by 1000",
        ),
        (2, torque, _TWIST * max(weight, peak), "which looks like N mm", "torques are in N m: divide by 1000"),
    )
    for kind, of_interest, limit, why, remedy in doubts:
        row, axis = np.unravel_index(int(np.abs(of_interest).argmax()), of_interest.shape)
        value = float(of_interest[row, axis])
        if columns[kind] and abs(value) > limit:
            warnings.warn(
                f"{table.path}: column {table.columns[columns[kind][axis]]!r} of load {label!r} reaches {value:.6g} at "
                f"{time[row]:.6g} s, {why}: {remedy}",
                MjhcmcWarning,
                stacklevel=4,
            )

"""Force plates of a .c3d file: force on the body, its point, and the free torque, in the laboratory's frame.

Plates of the types 1 to 4 of the C3D user guide (www.c3d.org). With the channels' force F and moment M_o about the
transducers' origin, both along the plate's axes, and c the vector from there to the centre of the plate's surface
(FORCE_PLATFORM:ORIGIN), the moment about that centre is M = M_o - c x F. Types give F and M_o so:

    type 2   channels are F and M_o
    type 4   CAL_MATRIX times the channels is F and M_o
    type 1   channels are F, the point (px, py) on the surface, and the torque about it
    type 3   channels are fx12 fx34 fy14 fy23 fz1 fz2 fz3 fz4 of four sensors at (+-a, +-b): F are their sums,
             M_o = (b (fz1 + fz2 - fz3 - fz4), a (fz2 + fz3 - fz1 - fz4), b (fx34 - fx12) + a (fy14 - fy23)),
             and ORIGIN is (a, b, c_z)

The plate's axes follow from its corners (x from 2 to 1, y from 4 to 1), and with the surface's normal n the centre of
pressure is p = (n x M) / (n . F) from the surface's centre; what is left, M - p x F, is the free torque along n.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mjhcmc.errors import MotionError, OutputError, SettingsError
from mjhcmc.io.c3d import C3DFile, open_c3d
from mjhcmc.io.columns import listed
from mjhcmc.io.opensim import write_table

if TYPE_CHECKING:
    from mjhcmc.external_loads import ExternalLoads

Array = NDArray[np.float64]

THRESHOLD = 20.0
"""N across the surface, below which a plate counts as not loaded."""

_CHANNELS = {1: 6, 2: 6, 3: 8, 4: 6}
_FORCE_UNITS = {"n": 1.0, "kn": 1e3}
_MOMENT_UNITS = {"nmm": 1e-3, "ncm": 1e-2, "nm": 1.0, "knm": 1e3}
_ABOVE = 0.1  # m on average: markers this far off a plate's surface tell which side of it is up
_MARGIN = 0.02  # m beyond a plate's edge that a centre of pressure may seem to lie
_OFF_PLATE = 0.05  # of the loaded rows: more off the plate is worth a word


@dataclass(frozen=True, eq=False)
class ForcePlates:
    """What force plates measured: the load that each puts on who stands on it.

    Attributes:
        path: the file read.
        names: (k,) of the plates, plate1, plate2 ..., in the file's order.
        time: (T,) s, on the file's clock (0 s at frame 1).
        force: (T, k, 3) N in the laboratory's frame, on the body; zero where the plate is not loaded.
        point: (T, k, 3) m, the centre of pressure on the plate's surface; where the plate is not loaded, that of the
            nearest time at which it is, and the plate's centre where it never is.
        torque: (T, k, 3) N m, the free torque on the body about the point, along the surface's normal.
        corners: (k, 4, 3) m.
        notices: what the user may want to know of how they were read, a line each.
    """

    path: Path
    names: tuple[str, ...]
    time: Array = field(repr=False)
    force: Array = field(repr=False)
    point: Array = field(repr=False)
    torque: Array = field(repr=False)
    corners: Array = field(repr=False)
    notices: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for array in (self.time, self.force, self.point, self.torque, self.corners):
            array.setflags(write=False)

    def moved(self, rotation: ArrayLike, shift: ArrayLike = (0, 0, 0)) -> "ForcePlates":
        """The same in another frame, such as the model's: points become rotation y + shift.

        Args:
            rotation: (3, 3) laboratory to the other frame.
            shift: (3,) m.

        Raises:
            SettingsError: rotation is none (its columns are not orthonormal, or it mirrors).
        """
        R, p = np.asarray(rotation, dtype=np.float64), np.asarray(shift, dtype=np.float64)
        if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
            raise SettingsError("rotation is no rotation matrix: give (3, 3), orthonormal, with determinant 1")
        return replace(
            self,
            force=self.force @ R.T,
            point=self.point @ R.T + p,
            torque=self.torque @ R.T,
            corners=self.corners @ R.T + p,
        )

    def loads_on(self, bodies: Mapping[str, str]) -> "ExternalLoads":
        """The plates as external loads.

        Args:
            bodies: plate to the model's body that stands on it; other plates are left out.

        Raises:
            MotionError: a plate that is none, or no plate.
        """
        from mjhcmc.external_loads import ExternalLoads

        unknown = [plate for plate in bodies if plate not in self.names]
        if unknown:
            raise MotionError(f"{self.path}: no plate {listed(unknown)}: its plates are {listed(self.names)}")
        used = [self.names.index(plate) for plate in bodies]
        return ExternalLoads(
            name=str(self.path),
            time=self.time,
            body=tuple(bodies.values()),
            force=self.force[:, used],
            torque=self.torque[:, used],
            point=self.point[:, used],
            labels=tuple(bodies),
            notices=self.notices,
        )


def force_plates(path: str | os.PathLike[str], threshold: float = THRESHOLD) -> ForcePlates:
    """Read the force plates of a .c3d file.

    Units are those of the channels (ANALOG:UNITS); where these say nothing, N, and N times the unit of length for
    moments, as C3D has it. A baseline (FORCE_PLATFORM:ZERO) is taken off where the plate is not loaded in it. Some
    systems record the force on the plate, others that on the body: the force is turned where needed, so that it pushes
    away from the surface, to the side where the markers are (without markers: against the plate's z axis, which C3D
    has downwards). Kistler's corrections of the centre of pressure (FPCOPPOLY) are not made.

    Args:
        path: a .c3d file.
        threshold: N across the surface, below which force and torque are set to zero.

    Returns:
        The plates, in the laboratory's frame, which need not be the model's: see `ForcePlates.moved`.

    Raises:
        MotionError: as `mjhcmc.io.c3d.open_c3d`; or no plates, one of another type, one without its channels, corners
            or calibration matrix, or a sample that is not finite.
        SettingsError: threshold is negative or not finite.
    """
    if not 0 <= threshold < np.inf:
        raise SettingsError(f"threshold {threshold} N: choose 0 or more, such as {THRESHOLD:g}")
    file = open_c3d(path)
    group = file.parameters.get("FORCE_PLATFORM", {})
    n = int(next(iter(np.ravel(group.get("USED", []))), 0))
    if n < 1 or not file.channels.size:
        raise MotionError(f"{file.path}: no force plates (FORCE_PLATFORM:USED is {n}): export the trial with them")
    read = [_read_plate(file, group, i, threshold) for i in range(n)]
    time = file.start + np.arange(file.channels.shape[1]) / file.channel_rate
    return ForcePlates(
        path=file.path,
        names=tuple(plate.name for plate in read),
        time=time,
        force=np.stack([plate.force for plate in read], axis=1),
        point=np.stack([plate.point for plate in read], axis=1),
        torque=np.stack([plate.torque for plate in read], axis=1),
        corners=np.stack([plate.corners for plate in read]),
        notices=tuple(notice for plate in read for notice in plate.notices),
    )


def write_force_plates(plates: ForcePlates, path: str | os.PathLike[str]) -> None:
    """Write a .mot for OpenSim's external loads: plate1_force_vx .. vz, plate1_force_px .. pz, plate1_torque_x .. z.

    Raises:
        OutputError: another suffix, or a file that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in (".mot", ".sto"):
        raise OutputError(f"{path}: force plates are written to .mot or .sto, not to {path.suffix or 'nothing'!r}")
    columns = [
        f"{name}_{what}{axis}" for name in plates.names for what in ("force_v", "force_p", "torque_") for axis in "xyz"
    ]
    values = np.concatenate([plates.force, plates.point, plates.torque], axis=2).reshape(len(plates.time), -1)
    write_table(path, columns, plates.time, values, name="force plates", in_degrees=False)


@dataclass(frozen=True, eq=False)
class _Plate:
    name: str
    force: Array
    point: Array
    torque: Array
    corners: Array
    notices: tuple[str, ...]


def _read_plate(file: C3DFile, group: dict[str, Any], i: int, threshold: float) -> _Plate:
    name = f"plate{i + 1}"
    kind = int(_entries(file, group, "TYPE", name, 1)[i, 0])
    if kind == 4 and not np.size(group.get("CAL_MATRIX", [])):
        kind = 2  # some systems leave the matrix out where the channels are calibrated
    if kind not in _CHANNELS:
        raise MotionError(f"{file.path}: {name} is of type {kind}: types 1 to 4 are read: export it as type 2")
    corners = _entries(file, group, "CORNERS", name, 12)[i].reshape(4, 3) / file.metres
    axes = _axes(file, name, corners)
    samples = _samples(file, group, i, name, kind)
    convert = _Wrench(file, group, i, name, kind)
    samples, notices = _without_baseline(file, group, name, kind, samples, convert)
    force, moment = (part @ axes.T for part in convert(samples))
    normal, centre = axes[:, 2], corners.mean(axis=0)
    up = normal * _upward(file, normal, centre)
    loaded = np.abs(force @ normal) >= max(threshold, 1e-9)
    if (force[loaded] @ up).sum() < 0:
        force, moment = -force, -moment
        notices.append(f"{name}: its channels hold the force on the plate: turned to that on the body")
    across = np.where(loaded, force @ normal, 1.0)[:, None]
    arm = np.cross(normal, moment) / across
    torque = (moment - np.cross(arm, force)) * loaded[:, None]
    off = np.abs(arm[loaded] @ axes[:, :2]) > 0.5 * _sides(corners) + _MARGIN
    n_off = int(off.any(axis=1).sum())
    if n_off > _OFF_PLATE * loaded.sum():
        notices.append(
            f"{name}: the centre of pressure lies off the plate in {n_off} of {loaded.sum()} loaded rows: check its "
            "units, corners and origin, and who else touched it"
        )
    return _Plate(name, force * loaded[:, None], centre + _held(arm, loaded), torque, corners, tuple(notices))


def _entries(file: C3DFile, group: dict[str, Any], key: str, name: str, size: int) -> Array:
    """(k, size) a parameter's numbers, a row a plate."""
    values = np.ravel(np.asarray(group.get(key, []), dtype=np.float64), order="F")
    number = int(name.removeprefix("plate"))
    if values.size < number * size or not np.isfinite(values).all():
        raise MotionError(
            f"{file.path}: FORCE_PLATFORM:{key} has {values.size} numbers, {name} needs {number * size}: export the "
            "trial again"
        )
    return values[: values.size // size * size].reshape(-1, size)


def _axes(file: C3DFile, name: str, corners: Array) -> Array:
    """(3, 3) the plate's axes as columns, in the laboratory."""
    x, y = corners[0] - corners[1], corners[0] - corners[3]
    z = np.cross(x, y)
    if not np.linalg.norm(z) > 1e-6:  # m2
        raise MotionError(f"{file.path}: {name}: its corners span no surface: correct FORCE_PLATFORM:CORNERS")
    y = np.cross(z, x)
    return np.column_stack([axis / np.linalg.norm(axis) for axis in (x, y, z)])


def _sides(corners: Array) -> Array:
    """(2,) m, the plate's extent along its x and y."""
    return np.array([np.linalg.norm(corners[0] - corners[1]), np.linalg.norm(corners[0] - corners[3])])


def _samples(file: C3DFile, group: dict[str, Any], i: int, name: str, kind: int) -> Array:
    """(T, 6 or 8) the plate's channels, in N, N m and m (type 4: as they are)."""
    rows = np.asarray(group.get("CHANNEL", np.zeros((0, 0)))).shape[:1]
    per_plate = int(rows[0]) if rows else 0
    if per_plate < _CHANNELS[kind]:
        raise MotionError(
            f"{file.path}: {name} of type {kind} has {per_plate} channels in FORCE_PLATFORM:CHANNEL, needs "
            f"{_CHANNELS[kind]}: export the trial again"
        )
    used = _entries(file, group, "CHANNEL", name, per_plate)[i, : _CHANNELS[kind]].astype(int) - 1
    if used.min() < 0 or used.max() >= len(file.channels):
        raise MotionError(
            f"{file.path}: {name} names channels {listed([str(c + 1) for c in used])}, the file has "
            f"{len(file.channels)}: export the trial with its analog channels"
        )
    samples: Array = file.channels[used].T
    bad = np.argwhere(~np.isfinite(samples))
    if len(bad):
        raise MotionError(
            f"{file.path}: {name}, channel {used[bad[0][1]] + 1}, sample {bad[0][0] + 1}: not finite: export it again"
        )
    if kind == 4:
        return samples
    factors = np.ones(samples.shape[1])
    for j, channel in enumerate(used):
        unit = "".join(c for c in file.channel_units[channel].lower() if c.isalpha())
        is_force, is_point = j < 3 or kind == 3, kind == 1 and j in (3, 4)
        if is_point:
            factors[j] = 1 / file.metres
        elif is_force:
            factors[j] = _FORCE_UNITS.get(unit, 1.0)
        else:
            factors[j] = _MOMENT_UNITS.get(unit, 1 / file.metres)
    return np.multiply(samples, factors)


class _Wrench:
    """From a plate's channels (..., 6 or 8) to force, N, and moment about the surface's centre, N m, in its axes."""

    def __init__(self, file: C3DFile, group: dict[str, Any], i: int, name: str, kind: int) -> None:
        self.kind = kind
        origin = np.zeros(3) if kind == 1 else _entries(file, group, "ORIGIN", name, 3)[i] / file.metres
        self.origin = -origin if origin[2] > 0 else origin  # the surface is above the transducers, z is down
        self.matrix = np.eye(6)
        if kind == 4:
            self.matrix = _entries(file, group, "CAL_MATRIX", name, 36)[i].reshape(6, 6).T
            self.matrix = self.matrix * np.repeat([1.0, 1 / file.metres], 3)[:, None]

    def __call__(self, samples: Array) -> tuple[Array, Array]:
        """Force and moment, each (..., 3)."""
        if self.kind in (2, 4):
            both = samples @ self.matrix.T
            force, moment = both[..., :3], both[..., 3:]
            return force, moment - np.cross(self.origin, force)
        if self.kind == 1:
            force, point, torque = samples[..., :3], samples[..., 3:5], samples[..., 5]
            zero = np.zeros_like(torque)
            arm = np.stack([point[..., 0], point[..., 1], zero], axis=-1)
            return force, np.cross(arm, force) + np.stack([zero, zero, torque], axis=-1)
        fx12, fx34, fy14, fy23, fz1, fz2, fz3, fz4 = np.moveaxis(samples, -1, 0)
        a, b = np.abs(self.origin[:2])
        force = np.stack([fx12 + fx34, fy14 + fy23, fz1 + fz2 + fz3 + fz4], axis=-1)
        about_x, about_y = b * (fz1 + fz2 - fz3 - fz4), a * (fz2 + fz3 - fz1 - fz4)
        moment = np.stack([about_x, about_y, b * (fx34 - fx12) + a * (fy14 - fy23)], axis=-1)
        return force, moment - np.cross([0.0, 0.0, self.origin[2]], force)


def _without_baseline(
    file: C3DFile, group: dict[str, Any], name: str, kind: int, samples: Array, convert: _Wrench
) -> tuple[Array, list[str]]:
    """The samples less their mean over the frames that are said to be unloaded, and what was done, in words."""
    given = np.ravel(group.get("ZERO", []))
    if kind == 1 or given.size < 2 or given[1] < max(given[0], 1):
        return samples, []
    first, last = max(int(given[0]), 1), int(given[1])
    per_frame = file.channel_rate / file.rate
    begin, end = round((first - file.first_frame) * per_frame), round((last + 1 - file.first_frame) * per_frame)
    if begin < 0 or end > len(samples):
        return samples, []
    mean = samples[begin:end].mean(axis=0)
    across = float(convert(mean)[0][2])
    if not np.any(mean):
        return samples, []
    if abs(across) >= THRESHOLD:
        return samples, [
            f"{name}: {across:.4g} N across it in frames {first} to {last}, which FORCE_PLATFORM:ZERO calls unloaded: "
            "no baseline is taken off"
        ]
    return samples - mean, [f"{name}: baseline of frames {first} to {last} taken off ({across:.3g} N across it)"]


def _upward(file: C3DFile, normal: Array, centre: Array) -> float:
    """1 where up is along the plate's z axis, -1 where it is against it."""
    points = file.points[[i for i, label in enumerate(file.point_names) if label]] / file.metres
    seen = points[np.isfinite(points).all(axis=-1)]
    height = float(np.mean((seen - centre) @ normal)) if len(seen) else 0.0
    return float(np.sign(height)) if abs(height) > _ABOVE else -1.0


def _held(arm: Array, loaded: NDArray[np.bool_]) -> Array:
    """The arm, where there is no load that of the nearest row with one; zero where there never is one."""
    rows = np.flatnonzero(loaded)
    if not len(rows):
        return np.zeros_like(arm)
    here = np.arange(len(arm))
    after = np.searchsorted(rows, here).clip(0, len(rows) - 1)
    before = (after - 1).clip(0)
    nearest = np.where(np.abs(rows[before] - here) <= np.abs(rows[after] - here), rows[before], rows[after])
    held: Array = arm[nearest]
    return held

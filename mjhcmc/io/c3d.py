"""Motion capture's binary files (.c3d), read through the package ezc3d (the extra ``c3d``): markers and channels.

The format is that of the C3D user guide (www.c3d.org): frames of points and, several times a frame, samples of analog
channels, with parameters in named groups. Force plates, which are groups of channels, are `mjhcmc.io.force_plates`.

Tested on files that the tests write themselves: no package that could be had ships a recorded one.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MotionError
from mjhcmc.io.trc import SHIFTS, UNIT_NAMES, MarkerTable

Array = NDArray[np.float64]

SUFFIXES = (".c3d",)

_HEADER = 512  # bytes of the header, and of every block
_MAGIC = 0x50
_MIPS = 86  # the processor whose words begin with the high byte
_FULL_WORD = 65535  # what longer trials write for their last frame
_MODELLED = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")  # lists of points that are no positions


@dataclass(frozen=True, eq=False)
class C3DFile:
    """What a .c3d file holds, in the file's own units.

    Attributes:
        path: the file read.
        points: (n, T, 3) in unit; a point that was not seen has three NaN.
        point_names: (n,) as labelled; empty where a point has no label.
        unit: of the points, "mm", "cm" or "m".
        rate: frames a second.
        first_frame: number of the first frame; the file's clock is 0 s at frame 1.
        channels: (n_channel, T_channel) analog samples, scaled.
        channel_units: (n_channel,) as written, empty where there is none.
        channel_rate: samples a second; 0 without channels.
        parameters: group to parameter to value: arrays, or lists of texts.
    """

    path: Path
    points: Array = field(repr=False)
    point_names: tuple[str, ...]
    unit: str
    rate: float
    first_frame: int
    channels: Array = field(repr=False)
    channel_units: tuple[str, ...]
    channel_rate: float
    parameters: dict[str, dict[str, Any]] = field(repr=False)

    @property
    def start(self) -> float:
        """Time of the first frame, s, on the file's clock."""
        return (self.first_frame - 1) / self.rate

    @property
    def metres(self) -> float:
        """How many of the file's unit of length make a metre."""
        return float(10.0 ** -SHIFTS[self.unit])


def read_c3d(path: str | os.PathLike[str]) -> MarkerTable:
    """Markers of a .c3d file.

    Points without a label, and those that the file lists as angles, forces, moments, powers or scalars of a model, are
    no markers. A point that was not seen (a negative residual, or at the very origin) is a gap. The file's clock is 0 s
    at frame 1, so a trial that was cut begins later.

    Args:
        path: a .c3d file (the suffix is not looked at).

    Returns:
        The markers, in metres.

    Raises:
        MotionError: ezc3d is not installed; the file cannot be read, is no .c3d or is cut off; it gives no unit or
            rate, holds no marker, or names one twice.
    """
    file = open_c3d(path)
    modelled = {
        label.strip()
        for key, value in file.parameters.get("POINT", {}).items()
        if key.rstrip("0123456789") in _MODELLED and isinstance(value, list)
        for label in value
    }
    used = [i for i, name in enumerate(file.point_names) if name and name not in modelled]
    if not used or not file.points.shape[1]:
        raise MotionError(f"{file.path}: no markers, of {len(file.point_names)} points: export the trial with labels")
    names = tuple(file.point_names[i] for i in used)
    for name in names:
        if names.count(name) > 1:
            raise MotionError(f"{file.path}: marker {name!r} stands twice: rename or remove one")
    n_frame = file.points.shape[1]
    frames = file.first_frame + np.arange(n_frame)
    positions = np.swapaxes(file.points[used], 0, 1) / file.metres
    return MarkerTable(file.path, names, (frames - 1) / file.rate, positions, frames, file.unit, row_word="frame")


def open_c3d(path: str | os.PathLike[str]) -> C3DFile:
    """All that a .c3d file holds, checked.

    Raises:
        MotionError: as `read_c3d`, but for the markers.
    """
    path = Path(path)
    said = _frames_said(path)
    raw = _through_ezc3d(path)
    parameters = {
        group: {key: entry["value"] for key, entry in entries.items() if "value" in entry}
        for group, entries in raw["parameters"].items()
    }
    header = raw["header"]["points"]
    points = np.moveaxis(np.asarray(raw["data"]["points"], dtype=np.float64)[:3], 0, -1)  # (n, T, 3)
    channels = np.asarray(raw["data"]["analogs"], dtype=np.float64)
    channels = channels.reshape(channels.shape[-2:])
    found = int(header["last_frame"]) - int(header["first_frame"]) + 1
    if said is not None and found < said:
        raise MotionError(f"{path}: cut off: the header says {said} frames, {found} are there: copy or export it again")
    rate = _number(parameters, "POINT", "RATE") or float(header["frame_rate"])
    if not 0 < rate < np.inf:
        raise MotionError(f"{path}: POINT:RATE is {rate}: export it with the frames' rate")
    missing = ~np.isfinite(points).all(axis=2) | (points == 0).all(axis=2)
    points[missing] = np.nan
    return C3DFile(
        path=path,
        points=points,
        point_names=_labels(parameters, "POINT", "LABELS", len(points)),
        unit=_unit(path, parameters),
        rate=rate,
        first_frame=int(header["first_frame"]) + 1,  # ezc3d counts from 0
        channels=channels,
        channel_units=_labels(parameters, "ANALOG", "UNITS", len(channels)),
        channel_rate=_channel_rate(path, parameters, raw, rate, found) if channels.size else 0.0,
        parameters=parameters,
    )


def _frames_said(path: Path) -> int | None:
    """Number of frames by the header's own words; None where these are too short for it. Also: is it a C3D file?"""
    try:
        with path.open("rb") as stream:
            start = stream.read(_HEADER)
            stream.seek(max(start[0] - 1, 0) * _HEADER if start else 0)
            processor = stream.read(4)[3:]
    except FileNotFoundError:
        raise MotionError(f"{path}: no such file: check the path") from None
    except IsADirectoryError:
        raise MotionError(f"{path}: is a folder: name a file in it") from None
    except OSError as error:
        raise MotionError(f"{path}: cannot be read ({error.strerror}): check its permissions") from error
    if not start:
        raise MotionError(f"{path}: the file is empty: write it again")
    if len(start) < 2 or start[1] != _MAGIC:
        raise MotionError(f"{path}: not a C3D file: give one, or markers as .trc")
    if len(start) < _HEADER or not processor:
        raise MotionError(f"{path}: cut off after {len(start)} bytes of its header: copy or export it again")
    first, last = np.frombuffer(start[6:10], ">u2" if processor[0] == _MIPS else "<u2").tolist()
    return None if last == _FULL_WORD or last < first else last - first + 1


def _through_ezc3d(path: Path) -> Any:
    try:
        import ezc3d
    except ImportError:
        raise MotionError(f'{path}: ezc3d, which reads .c3d, is not installed: pip install "mjhcmc[c3d]"') from None
    try:
        return ezc3d.c3d(str(path))
    except Exception as error:  # of many kinds: C++ exceptions as they come
        why = " ".join(str(error).split()).removesuffix(": iostream error")
        raise MotionError(
            f"{path}: ezc3d cannot read it ({why}): the file is damaged or cut off, copy or export it again"
        ) from error


def _number(parameters: dict[str, dict[str, Any]], group: str, key: str) -> float:
    """A parameter that is a number; 0 where it is not there."""
    value = np.ravel(parameters.get(group, {}).get(key, []))
    return float(value[0]) if value.size and np.issubdtype(value.dtype, np.number) else 0.0


def _labels(parameters: dict[str, dict[str, Any]], group: str, key: str, n: int) -> tuple[str, ...]:
    """n texts: of the parameter and of those that go on where it is full (LABELS, LABELS2, ...), then empty ones."""
    entries = parameters.get(group, {})
    texts: list[str] = list(entries.get(key, []))
    more = 2
    while f"{key}{more}" in entries:
        texts += entries[f"{key}{more}"]
        more += 1
    return tuple(text.strip() for text in [*texts, *[""] * n][:n])


def _unit(path: Path, parameters: dict[str, dict[str, Any]]) -> str:
    said = next((text.strip() for text in parameters.get("POINT", {}).get("UNITS", [])), "")
    if said.lower() not in UNIT_NAMES:
        raise MotionError(f"{path}: POINT:UNITS is {said!r}: export it in mm, cm or m")
    return UNIT_NAMES[said.lower()]


def _channel_rate(path: Path, parameters: dict[str, dict[str, Any]], raw: Any, rate: float, n_frame: int) -> float:
    """Samples a second, by the samples a frame."""
    samples = int(np.asarray(raw["data"]["analogs"]).shape[-1])
    if n_frame > 0 and samples % n_frame == 0:
        return rate * (samples // n_frame)
    said = _number(parameters, "ANALOG", "RATE")
    if not 0 < said < np.inf:
        raise MotionError(f"{path}: ANALOG:RATE is {said}: export it with the channels' rate")
    return said

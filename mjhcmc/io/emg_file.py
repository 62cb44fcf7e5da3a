"""From a file to Emg: time and channels of .csv, .sto, .mot and .parquet tables; and the map of muscles to channels."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mjhcmc.emg import Emg
from mjhcmc.errors import MotionError, SettingsError
from mjhcmc.io import csv_table, opensim
from mjhcmc.io.columns import listed, read_map

SUFFIXES = (*csv_table.SUFFIXES, *opensim.SUFFIXES, ".parquet")


def read_emg(path: Path, channels: Sequence[str] | None, raw: bool | None) -> Emg:
    """See `Emg.from_file`."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise MotionError(f"{path}: a file of EMG ends in {', '.join(SUFFIXES)}, not in {suffix or 'nothing'!r}")
    if suffix == ".parquet":
        time, columns = _read_parquet(path)
    else:
        table = csv_table.read_csv(path) if suffix in csv_table.SUFFIXES else opensim.read_table(path)
        time, columns = table.time, dict(zip(table.columns, table.values.T, strict=True))
    if isinstance(channels, str):
        raise SettingsError(f"channels must be a list of names; got {channels!r}: write [{channels!r}]")
    wanted = list(columns) if channels is None else list(channels)
    unknown = [name for name in wanted if name not in columns]
    if unknown:
        raise MotionError(f"{path}: no column {unknown[0]!r}: its columns are {listed(list(columns))}")
    if not wanted:
        raise MotionError(f"{path}: no column beside time: give one for each channel")
    lost = np.flatnonzero(~np.isfinite(time))
    if len(lost):
        raise MotionError(f"{path}: time is not finite in row {lost[0]} (from 0): fill the gap or leave the row out")
    return Emg(time, np.column_stack([columns[name] for name in wanted]), tuple(wanted), str(path), raw)


def _read_parquet(path: Path) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    import pyarrow.parquet as pq

    if not path.is_file():
        raise MotionError(f"{path}: no such file: check the path")
    try:
        table = pq.read_table(path)
    except Exception as error:  # a damaged file may break its reader in any way
        first = next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
        raise MotionError(f"{path}: cannot be read as .parquet ({first}): write it again") from error
    columns: dict[str, NDArray[np.float64]] = {}
    for name in table.column_names:
        if name.startswith("__index"):  # an index that pandas wrote
            continue
        try:
            columns[name] = np.asarray(table[name].to_numpy(), dtype=np.float64)
        except (TypeError, ValueError):
            raise MotionError(f"{path}: column {name!r} holds no numbers: leave it out") from None
    timed = [name for name in columns if name.lower() == "time"]
    if not timed:
        raise MotionError(f"{path}: no column 'time' among {listed(list(columns))}: name the time column 'time'")
    return columns.pop(timed[0]), columns


def channel_map(
    mapping: Mapping[str, str] | str | os.PathLike[str] | None, muscles: Sequence[str], channels: Sequence[str]
) -> dict[str, str]:
    """Which channel measures which muscle, in the muscles' order; one channel may serve several muscles.

    Args:
        mapping: muscle to channel; a file of it: a .csv with lines ``muscle,channel``, any other a JSON object; None:
            channels that have a muscle's name measure it.
        muscles: of the model or solution.
        channels: that were measured.

    Raises:
        MotionError: the file cannot be read or holds no such map.
        SettingsError: muscles or channels that do not exist, all of them listed; nothing is mapped.
    """
    if mapping is None:
        given = {name: name for name in muscles if name in channels}
    else:
        given = read_map(mapping, "muscle", "channel", "EMG map")
    no_muscle = [name for name in given if name not in muscles]
    no_channel = list(dict.fromkeys(name for name in given.values() if name not in channels))
    if no_muscle and all(name in channels for name in given) and all(name in muscles for name in given.values()):
        raise SettingsError("EMG map is turned round: it maps channels to muscles: give muscle, channel")
    if no_muscle:
        raise SettingsError(
            f"EMG map: no muscle{'s' * (len(no_muscle) > 1)} {listed(no_muscle)}: the muscles are "
            f"{listed(list(muscles))}"
        )
    if no_channel:
        raise SettingsError(
            f"EMG map: no channel{'s' * (len(no_channel) > 1)} {listed(no_channel)}: the channels are "
            f"{listed(list(channels))}"
        )
    if not given:
        raise SettingsError(
            f"EMG map: no muscle is measured: map the muscles ({listed(list(muscles))}) to the channels "
            f"({listed(list(channels))})"
        )
    return {name: given[name] for name in muscles if name in given}

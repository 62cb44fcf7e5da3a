"""Reading a dataset shard by shard, and the list of columns that a feature may be made of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import OutputError, SettingsError
from mjhcmc.leg8.table import JOINTS, MUSCLES
from mjhcmc.patients.stored import open_manifest, shards_in

Column = NDArray[Any]
Columns = dict[str, Column]

HELD_OUT = ("train", "validation", "test")
"""Splits that a baseline cannot do without."""

ORIGIN = ("split", "generator", "configuration", "seed")
"""Columns of every table that tell where a row comes from; no feature reads them."""

READABLE: dict[str, tuple[str, ...]] = {
    "patients": ("sex", "height", "body_mass"),
    "trials": ("test", "joint", "speed_deg_s", "start_deg", "end_deg"),
    "observables": (
        "time", "torque", *(f"q/{j}" for j in JOINTS), *(f"v/{j}" for j in JOINTS),
        *(f"emg/{m}" for m in MUSCLES if m != "iliopsoas"),
    ),
}  # fmt: skip
"""By table, every column that a feature may be made of: what an examiner could know."""

KEYS: dict[str, tuple[str, ...]] = {
    "patients": ("patient", "split", "status"),
    "trials": ("patient", "trial", "session", "status", "duration_s", "rate_hz"),
    "observables": ("patient", "trial"),
}
"""By table, columns that join rows, choose them, or are audited; no feature is made of them."""


class Guarded(Mapping[str, Column]):
    """Columns of a table of which only those of a list can be read."""

    def __init__(self, table: str, columns: Mapping[str, Column], allowed: tuple[str, ...]) -> None:
        """Take the columns; `allowed` may only narrow what `READABLE` lists for the table.

        Raises:
            SettingsError: a column is allowed here that is not in `READABLE`.
        """
        more = [name for name in allowed if name not in READABLE.get(table, ())]
        if more:
            raise SettingsError(f"table {table}: features may not read {', '.join(more)}: see READABLE")
        self._table, self._columns, self._allowed = table, columns, allowed

    def __getitem__(self, name: str) -> Column:
        """The column.

        Raises:
            SettingsError: it is not on the list.
        """
        if name not in self._allowed:
            raise SettingsError(f"table {self._table}: this feature may not read column {name!r}: it is not declared")
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        """Names that can be read."""
        return iter(self._allowed)

    def __len__(self) -> int:
        """How many can be read."""
        return len(self._allowed)


@dataclass(frozen=True)
class Dataset:
    """Where a dataset's shards lie.

    Attributes:
        folder: of the dataset.
        shards: by split, the folders of its shards in order.
    """

    folder: Path
    shards: Mapping[str, tuple[Path, ...]]

    @property
    def count(self) -> int:
        """Shards in all."""
        return sum(len(paths) for paths in self.shards.values())


def open_dataset(folder: str | Path) -> Dataset:
    """Find the shards of a dataset.

    Args:
        folder: that ``mjhcmc patients generate`` wrote.

    Raises:
        OutputError: it is none, is not complete, or has nobody in train, validation or test.
    """
    folder = Path(folder)
    manifest = open_manifest(folder)
    there, missing = shards_in(folder, manifest)
    again = "run mjhcmc patients generate again with the same options, it makes the rest"
    if missing:
        which = f"{len(missing)} of {len(there) + len(missing)} shards are missing, the first is {missing[0]}"
        raise OutputError(f"{folder}: this dataset is not complete: {which}: {again}")
    if manifest.status != "complete":
        raise OutputError(f"{folder}: this dataset is not complete: its status is {manifest.status!r}: {again}")
    shards: dict[str, tuple[Path, ...]] = {}
    for shard in there:
        shards[shard.split] = (*shards.get(shard.split, ()), folder / shard.name)
    for split in HELD_OUT:
        if split not in shards:
            raise OutputError(f"{folder}: split {split} is absent: generate more patients")
    return Dataset(folder, shards)


def column_names(path: Path) -> tuple[str, ...]:
    """Columns of a Parquet file.

    Raises:
        OutputError: the file is missing or cannot be read.
    """
    import pyarrow.parquet as pq

    try:
        return tuple(pq.read_schema(path).names)
    except FileNotFoundError:
        raise OutputError(f"{path}: this table is missing: let mjhcmc patients generate finish") from None
    except (OSError, ValueError) as error:  # pyarrow's ArrowInvalid is a ValueError
        raise OutputError(f"{path}: cannot be read ({error}): generate this shard again") from None


def check_columns(path: Path, names: tuple[str, ...]) -> None:
    """See that a Parquet file has these columns.

    Raises:
        OutputError: the file or a column is missing.
    """
    there = column_names(path)
    for name in names:
        if name not in there:
            raise OutputError(f"{path}: column {name!r} is missing: generate the dataset with this version")


def read_columns(path: Path, names: tuple[str, ...]) -> Columns:
    """Columns of a Parquet file as arrays; text as objects, missing numbers nan, missing text empty.

    Args:
        path: the file.
        names: its columns to read; no other is touched.

    Raises:
        OutputError: the file or a column is missing or cannot be read.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    check_columns(path, names)
    try:
        table = pq.read_table(path, columns=list(names), partitioning=None)
    except (OSError, ValueError) as error:
        raise OutputError(f"{path}: cannot be read ({error}): generate this shard again") from None
    result: Columns = {}
    for name in names:
        column = table.column(name)
        kind = column.type.value_type if pa.types.is_dictionary(column.type) else column.type
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            values = np.empty(len(column), dtype=object)
            values[:] = [value or "" for value in column.to_pylist()]
            result[name] = values
        elif pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind):
            result[name] = np.asarray(column.to_pandas())
        else:
            raise OutputError(f"{path}: column {name!r} is of type {column.type}: generate the dataset again")
    return result

"""Shards: a few patients' tables in a folder of their own, which is there whole or not at all."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mjhcmc.errors import MjhcmcError, OutputError, SimulationError
from mjhcmc.patients.configuration import SHARES, Configuration, splits

TABLES = ("patients", "trials", "observables", "privileged")
CHECKSUMS = "checksums.json"
LEFTOVER = ".shard-"
"""Temporary folders of shards start so."""

_LEVEL = 3  # of zstd: beyond it files shrink by 2 % and take three times as long


@dataclass(frozen=True)
class Shard:
    """Patients of one split that are simulated and written together: indices first to last - 1."""

    number: int
    split: str
    first: int
    last: int

    @property
    def name(self) -> str:
        """Its folder within the dataset."""
        return f"{self.split}/shard-{self.number:05d}"

    def __str__(self) -> str:
        """As messages tell it."""
        return f"{self.name} (patients {self.first} to {self.last - 1})"


@dataclass(frozen=True)
class Written:
    """What is known of a shard on the disk.

    Attributes:
        shard: its folder within the dataset.
        first: index of the first patient.
        last: index after the last patient.
        failed: patients whose simulation failed.
        size: bytes of its tables.
        checksums: SHA-256 of its checksums.json, which holds those of the tables.
    """

    shard: str
    first: int
    last: int
    failed: int
    size: int
    checksums: str


class DamagedShardError(MjhcmcError):
    """A shard that is there, but not as it was written."""


def shards_of(configuration: Configuration) -> list[Shard]:
    """The shards of a dataset, in the order of patients: numbered through all splits, no shard in two of them."""
    shards: list[Shard] = []
    for split, block in splits(configuration.patients).items():
        for first in range(block.start, block.stop, configuration.shard_size):
            last = min(first + configuration.shard_size, block.stop)
            shards.append(Shard(len(shards), split, first, last))
    return shards


def write_shard(out: Path, shard: Shard, configuration: Configuration, tables: Mapping[str, Any]) -> Written:
    """Write a shard's tables under a temporary name, make sure they are on the disk, and rename the folder.

    Args:
        out: folder of the dataset.
        shard: which.
        configuration: of the dataset.
        tables: pyarrow tables by name, those of `TABLES`.

    Returns:
        What was written; what is there already, if another process was faster.

    Raises:
        SimulationError: the tables are not those of the shard's patients.
        OutputError: the disk is full, or the folder cannot be written. The temporary folder is removed.
    """
    failed = _failed(shard, tables)
    folder = out / shard.name
    temporary = folder.with_name(f"{LEFTOVER}{shard.number:05d}.{os.getpid()}-{secrets.token_hex(8)}")
    with writing(folder):
        try:
            temporary.mkdir(parents=True)
            files = {}
            for name in TABLES:
                data = _parquet(tables[name])
                _write(temporary / f"{name}.parquet", data)
                digest = hashlib.sha256(data).hexdigest()
                files[f"{name}.parquet"] = {"sha256": digest, "rows": tables[name].num_rows, "size": len(data)}
            about = {**asdict(shard), "failed": failed, "configuration": configuration.hash, "files": files}
            _write(temporary / CHECKSUMS, _json(about))
            _sync(temporary)
            try:
                temporary.rename(folder)
            except OSError:
                with suppress(DamagedShardError):  # made by a worker that was taken for dead: the bytes are the same
                    if (there := read_shard(out, shard, configuration)) is not None:
                        return there
                raise
            _sync(folder.parent)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    return _written(shard, about, _json(about))


def read_shard(out: Path, shard: Shard, configuration: Configuration) -> Written | None:
    """What is known of a shard; every byte of it is read.

    Args:
        out: folder of the dataset.
        shard: which.
        configuration: of the dataset.

    Returns:
        None where there is none.

    Raises:
        DamagedShardError: a file is missing, cannot be read, or is not as it was written; the message says which.
    """
    folder = out / shard.name
    if not os.path.lexists(folder):
        return None
    try:
        text = (folder / CHECKSUMS).read_bytes()
        about = json.loads(text)
        if about["configuration"] != configuration.hash or {key: about[key] for key in asdict(shard)} != asdict(shard):
            raise DamagedShardError(f"{folder}: {CHECKSUMS} is of other patients or another configuration")
        if sorted(about["files"]) != sorted(f"{name}.parquet" for name in TABLES):
            raise DamagedShardError(f"{folder}: {CHECKSUMS} does not name the tables")
        for name, known in about["files"].items():
            with (folder / name).open("rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() != known["sha256"]:
                    raise DamagedShardError(f"{folder / name}: its bytes do not give the checksum in {CHECKSUMS}")
        return _written(shard, about, text)
    except OSError as error:
        raise DamagedShardError(f"{error.filename or folder}: cannot be read ({error.strerror})") from error
    except (ValueError, KeyError, TypeError) as error:
        raise DamagedShardError(f"{folder / CHECKSUMS}: no checksums can be read from it") from error


def remove_shard(out: Path, shard: Shard) -> None:
    """Remove a shard's folder, at once under its name.

    Raises:
        OutputError: it cannot be removed.
    """
    with writing(out / shard.name):
        _remove(out / shard.name)


def remove_leftovers(out: Path) -> None:
    """Remove what shards that were not finished left behind; only while nobody writes there.

    Raises:
        OutputError: something cannot be removed.
    """
    with writing(out):
        for split in SHARES:
            for leftover in sorted((out / split).glob(f"{LEFTOVER}*")):
                _remove(leftover)


def strangers(out: Path, shards: list[Shard]) -> Iterator[Path]:
    """What lies among the shards and is none of them: whoever loads the dataset by pattern would load it too."""
    expected = {shard.name for shard in shards}
    for split in SHARES:
        for path in sorted((out / split).glob("*")):
            if not path.name.startswith(".") and f"{split}/{path.name}" not in expected:
                yield path


def write_file(path: Path, text: str) -> None:
    """Write a text file under a temporary name, and rename it when it is on the disk.

    Raises:
        OutputError: the disk is full, or the folder cannot be written.
    """
    temporary = path.with_name(f".{path.name}.partial")
    with writing(path):
        try:
            _write(temporary, text.encode())
            temporary.replace(path)
            _sync(path.parent)
        finally:
            with suppress(OSError):  # renamed, or never written: the error in the block is the one to tell
                temporary.unlink()


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Tell an error of the disk as one of the output."""
    try:
        yield
    except OSError as error:
        why = error.strerror or " ".join(str(error).split())
        raise OutputError(
            f"{path}: cannot be written ({why}); the shards that are whole are kept: make room, or make the folder "
            "writable, and start again to resume"
        ) from error


def _failed(shard: Shard, tables: Mapping[str, Any]) -> int:
    """How many of the shard's patients failed."""
    if set(tables) != set(TABLES):
        raise SimulationError(f"{shard}: the simulation gave tables {sorted(tables)}, not {sorted(TABLES)}")
    patients = tables["patients"]
    for column in ("patient", "status"):
        if column not in patients.column_names:
            raise SimulationError(f"{shard}: the simulation's table of patients has no column {column!r}")
    indices = patients["patient"].to_pylist()
    if indices != list(range(shard.first, shard.last)):
        raise SimulationError(
            f"{shard}: the simulation gave {len(indices)} patients {indices[:3]}..., not those asked for"
        )
    return sum(status != "ok" for status in patients["status"].to_pylist())


def _parquet(table: Any) -> memoryview:
    """A table as a Parquet file; the same bytes for the same table and version of pyarrow.

    Bytes of floats by their significance (BYTE_STREAM_SPLIT): 14 % smaller where there is noise, half the size where
    there is none. Dictionaries for the rest, and for times, which every trial repeats.
    """
    import pyarrow as pa
    from pyarrow import parquet

    def is_split(field: Any) -> bool:
        return field.name != "time" and field.type in (pa.float32(), pa.float64())

    rest = [field.name for field in table.schema if not is_split(field)]
    sink = pa.BufferOutputStream()
    parquet.write_table(
        table.replace_schema_metadata(None).combine_chunks(), sink, version="2.6", compression="zstd",
        compression_level=_LEVEL, use_dictionary=rest, write_statistics=rest,
        use_byte_stream_split=[field.name for field in table.schema if is_split(field)],
    )  # fmt: skip
    return memoryview(sink.getvalue())


def _json(value: object) -> bytes:
    return (json.dumps(value, indent=1) + "\n").encode()


def _written(shard: Shard, about: Mapping[str, Any], text: bytes) -> Written:
    size = sum(int(known["size"]) for known in about["files"].values())
    return Written(shard.name, shard.first, shard.last, int(about["failed"]), size, hashlib.sha256(text).hexdigest())


def _write(path: Path, data: bytes | memoryview) -> None:
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _sync(folder: Path) -> None:
    """See that a folder's names are on the disk, where the system can."""
    with suppress(OSError):  # Windows opens no folders, and some file systems do not sync them
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _remove(path: Path) -> None:
    """Remove a file or folder; renamed first, so that nobody sees, or renames, a part of it."""
    gone = path.with_name(f"{LEFTOVER}{secrets.token_hex(4)}")
    path.rename(gone)
    if gone.is_dir() and not gone.is_symlink():
        shutil.rmtree(gone)
    else:
        gone.unlink()

"""Reading a dataset from the disk: its manifest, which shards are there, and their tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mjhcmc.errors import OutputError, SettingsError
from mjhcmc.patients.configuration import Configuration
from mjhcmc.patients.manifest import MANIFEST, Manifest
from mjhcmc.patients.shards import Shard, shards_of

if TYPE_CHECKING:
    import pyarrow as pa


def open_manifest(folder: Path) -> Manifest:
    """The manifest of a dataset.

    Raises:
        OutputError: the folder is none.
    """
    manifest = Manifest.read(folder)
    if manifest is None:
        what = "there is no such folder" if not folder.exists() else f"it has no {MANIFEST}"
        raise OutputError(f"{folder}: is no dataset, {what}: name a folder of mjhcmc patients generate")
    return manifest


def shards_in(folder: Path, manifest: Manifest) -> tuple[list[Shard], list[Shard]]:
    """The shards of a dataset that are there, and those that are not yet.

    Raises:
        OutputError: the manifest holds no configuration.
    """
    about = manifest.configuration
    try:
        whole = Configuration(about["patients"], about["seed"], about["shard_size"], about["settings"])
    except (KeyError, TypeError, SettingsError) as error:
        raise OutputError(
            f"{folder / MANIFEST}: its configuration cannot be read ({error}): generate it again"
        ) from None
    shards = shards_of(whole)
    there = [shard for shard in shards if (folder / shard.name).is_dir()]
    return there, [shard for shard in shards if shard not in there]


def read_table(path: Path, columns: Sequence[str] | None = None, patient: int | None = None) -> pa.Table:
    """A table of a shard.

    Args:
        path: of the Parquet file.
        columns: to read; None: all.
        patient: index of the only one whose rows are read; None: everybody's.

    Raises:
        OutputError: it is missing, cannot be read, or lacks a column.
    """
    import pyarrow.parquet as pq

    chosen = None if patient is None else [("patient", "==", patient)]
    try:
        return pq.read_table(
            path, columns=None if columns is None else list(columns), filters=chosen, partitioning=None
        )
    except (OSError, ValueError) as error:  # pyarrow's ArrowInvalid is a ValueError
        why = getattr(error, "strerror", None) or str(error).splitlines()[0]
        raise OutputError(
            f"{path}: cannot be read ({why}): run mjhcmc patients generate again, it repairs what is damaged"
        ) from None

"""The manifest of a dataset: what it was made of and by, and, at the end, what it holds."""

from __future__ import annotations

import json
import os
import platform
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

from mjhcmc import __version__
from mjhcmc.errors import MjhcmcWarning, OutputError
from mjhcmc.patients.configuration import Configuration, splits
from mjhcmc.patients.shards import Written, write_file, writing

MANIFEST = "manifest.json"
LOCK = ".lock"

_NUMERIC = ("mujoco", "numpy", "numba", "scipy", "pyarrow")  # each can change the last bits of a trajectory or a file


def versions() -> dict[str, str]:
    """Of what decides the bytes of a dataset."""
    found = {"mjhcmc": __version__}
    for name in _NUMERIC:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def system() -> str:
    """The platform: trajectories are the same bit for bit on one only."""
    return f"{platform.system()} {platform.machine()}"


@dataclass(frozen=True)
class Manifest:
    """What a dataset is made of and holds. Its file has no times or rates: it is the same however the work went.

    Attributes:
        configuration: of the dataset, as plain values (`Configuration.to_dict`).
        generator: version of mjhcmc and format of the dataset.
        hash: of the configuration; every row carries it.
        versions: of the packages that decide the bytes.
        platform: system and processor.
        status: ``"running"`` until every shard is there, then ``"complete"``.
        shards: all of them in the order of patients; none while running.
        made: patients that this run simulated, the rest was there; not in the file.
    """

    configuration: Mapping[str, Any]
    generator: str
    hash: str
    versions: Mapping[str, str]
    platform: str
    status: Literal["running", "complete"] = "running"
    shards: tuple[Written, ...] = ()
    made: int = field(default=0, compare=False)

    @classmethod
    def of(cls, configuration: Configuration) -> Manifest:
        """Of a dataset to be made here."""
        return cls(configuration.to_dict(), configuration.generator, configuration.hash, versions(), system())

    @classmethod
    def read(cls, folder: Path | str) -> Manifest | None:
        """From the folder of a dataset; None where it has no manifest.

        Raises:
            OutputError: there is one, and it cannot be read.
        """
        path = Path(folder) / MANIFEST
        try:
            about = json.loads(path.read_text(encoding="utf-8"))
            return cls(
                about["configuration"], about["generator"], about["hash"], about["versions"], about["platform"],
                about["status"], tuple(Written(**shard) for shard in about.get("shards", ())),
            )  # fmt: skip
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise OutputError(f"{path}: cannot be read ({error.strerror}): make it readable") from error
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise OutputError(
                f"{path}: is no manifest of a dataset: choose another folder, or remove this one"
            ) from error

    def complete(self, shards: list[Written], made: int) -> Manifest:
        """With all that was written."""
        in_order = tuple(sorted(shards, key=lambda written: written.first))
        return replace(self, status="complete", shards=in_order, made=made)

    @property
    def patients(self) -> int:
        """How many there are, or are to be."""
        return int(self.configuration["patients"])

    @property
    def failed(self) -> int:
        """Patients whose simulation failed."""
        return sum(shard.failed for shard in self.shards)

    @property
    def size(self) -> int:
        """Bytes of all tables."""
        return sum(shard.size for shard in self.shards)

    def write(self, folder: Path) -> None:
        """Write manifest.json whole.

        Raises:
            OutputError: it cannot be written.
        """
        about: dict[str, Any] = {
            "status": self.status,
            "generator": self.generator,
            "hash": self.hash,
            "configuration": self.configuration,
            "versions": self.versions,
            "platform": self.platform,
            "splits": {name: [block.start, block.stop] for name, block in splits(self.patients).items()},
        }
        if self.status == "complete":
            about |= {"failed": self.failed, "size": self.size, "shards": [asdict(shard) for shard in self.shards]}
        write_file(folder / MANIFEST, json.dumps(about, indent=1) + "\n")

    def differences(self, other: Manifest) -> list[str]:
        """What another one has otherwise: name, value here, value there."""
        mine, its = self._flat(), other._flat()
        return [
            f"{name} is {mine.get(name, 'not set')} there and {its.get(name, 'not set')} here"
            for name in {**mine, **its}
            if mine.get(name) != its.get(name)
        ]

    def _flat(self) -> dict[str, Any]:
        plain = {name: value for name, value in self.configuration.items() if name != "settings"}
        packages = {f"version of {name}": value for name, value in self.versions.items()}
        settings = self.configuration["settings"]
        return {**plain, **settings, "generator": self.generator, **packages, "platform": self.platform}


def check_folder(out: Path, manifest: Manifest) -> Manifest | None:
    """See whether a dataset can be made, or resumed, in a folder.

    Args:
        out: folder; it need not be there.
        manifest: of what is to be made.

    Returns:
        The manifest that is there; None where the folder is empty.

    Raises:
        OutputError: the folder holds something else, or a dataset of another configuration, version or platform.
    """
    there = Manifest.read(out)
    if there is None:
        ours = {LOCK, f".{MANIFEST}.partial"}
        if others := sorted(path.name for path in out.glob("*") if path.name not in ours):
            raise OutputError(
                f"{out}: holds {others[0]!r} and no {MANIFEST}, so it is no dataset: choose an empty folder"
            )
        return None
    differences = there.differences(manifest)
    if not differences and there.hash != manifest.hash:
        differences = [f"hash is {there.hash} there and {manifest.hash} here"]
    if differences:
        raise OutputError(
            f"{out}: is another dataset: {'; '.join(differences)}: choose another folder, or make them the same"
        )
    return there


@contextmanager
def locked(out: Path) -> Iterator[None]:
    """Make a folder and keep other generators out of it; the system lets go of the lock of a process that dies.

    A folder that is still empty at the end is taken away again.

    Raises:
        OutputError: another process works there, or the folder cannot be written.
    """
    made = [folder for folder in (out, *out.parents) if not folder.exists()]
    path = out / LOCK
    try:
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
            file = _lock(path)
        try:
            yield
        finally:
            with suppress(OSError):  # removed by someone else, or Windows, which removes no open files
                path.unlink()
            os.close(file)
    finally:
        for folder in made:
            with suppress(OSError):  # it holds something now
                folder.rmdir()


def _lock(path: Path) -> int:
    """Open and lock a file, with this process' number in it."""
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            if not _take(file):
                holder = os.read(file, 100).decode(errors="replace").strip() or "another process"
                raise OutputError(f"{path.parent}: {holder} works there: wait for it, or choose another folder")
            if _is(path, file):
                os.ftruncate(file, 0)
                os.write(file, f"process {os.getpid()} on {platform.node()}\n".encode())
                return file
        except BaseException:
            os.close(file)
            raise
        os.close(file)  # whoever had it removed it meanwhile: this is no longer the file of that name


def _is(path: Path, file: int) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(file))
    except FileNotFoundError:
        return False


def _take(file: int) -> bool:
    """Lock an open file; whether it could be had."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError as error:  # some shared file systems know no locks
        warnings.warn(
            f"the folder cannot be locked ({error.strerror}): see that nobody else generates there",
            MjhcmcWarning,
            stacklevel=2,
        )
    return True

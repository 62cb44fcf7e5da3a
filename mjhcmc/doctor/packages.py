"""Which packages mjhcmc needs, which are there, and which are of a version that it was made for."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution, requires, version
from pathlib import Path
from typing import TYPE_CHECKING

from mjhcmc.doctor.children import Child

if TYPE_CHECKING:
    from packaging.requirements import Requirement

DEVELOPERS = ("test", "docs", "lint")
"""Extras that are for work on mjhcmc itself."""

_ROOT = Path(__file__).resolve().parents[2]
_MODULES = {"dm-control": "dm_control"}  # that are imported by another name than they are installed by
_PATIENCE = 120.0  # s, for imports: a cold disk

_IMPORT = """
import importlib, json, sys
for name in sys.argv[1:]:
    print(json.dumps({"name": name, "began": True}), flush=True)
    try:
        importlib.import_module(name)
        why = None
    except BaseException as error:
        why = f"{type(error).__name__}: {' '.join(str(error).split())}"
    print(json.dumps({"name": name, "why": why}), flush=True)
"""


@dataclass(frozen=True)
class Package:
    """A package that is asked for.

    Attributes:
        name: as it is installed.
        needs: versions that are asked for, such as ``>=3.17,<4``; empty: any.
        version: that is there; None where there is none.
        problem: why it cannot be used, or None.
        remedy: what to type, where there is a problem.
    """

    name: str
    needs: str
    version: str | None
    problem: str | None = None
    remedy: str | None = None


@dataclass(frozen=True)
class Requirements:
    """What mjhcmc asks for.

    Attributes:
        python: versions of Python, such as ``>=3.11``.
        core: what it cannot do without.
        extras: by extra, what it brings itself, without the extras that it names.
        source: where this was read: ``installed`` (its metadata) or ``checkout`` (its pyproject.toml).
    """

    python: str
    core: tuple[Requirement, ...]
    extras: Mapping[str, tuple[Requirement, ...]]
    source: str


def read_requirements() -> Requirements | None:
    """What this mjhcmc asks for, as far as it applies to this Python and platform; None where nothing tells.

    Raises:
        ImportError: the package ``packaging`` is not there.
    """
    from packaging.requirements import Requirement

    project = _ROOT / "pyproject.toml"
    if project.is_file():  # before the metadata: those of a checkout are as old as its installation
        told = tomllib.loads(project.read_text(encoding="utf-8")).get("project", {})
        if told.get("name") == "mjhcmc":
            extras = {
                name: _applicable([Requirement(line) for line in lines], name)
                for name, lines in told.get("optional-dependencies", {}).items()
            }
            core = _applicable([Requirement(line) for line in told.get("dependencies", [])])
            return Requirements(told.get("requires-python", ""), core, extras, "checkout")
    try:
        about = distribution("mjhcmc")
    except PackageNotFoundError:
        return None
    asked = [Requirement(line) for line in about.requires or []]
    by_extra = [each for each in asked if each.marker is not None and "extra" in str(each.marker)]
    names = about.metadata.get_all("Provides-Extra") or []
    return Requirements(
        about.metadata["Requires-Python"] or "",
        _applicable([each for each in asked if each not in by_extra]),
        _own({name: _applicable(by_extra, name) for name in names}),
        "installed",
    )


def _applicable(asked: Sequence[Requirement], extra: str = "") -> tuple[Requirement, ...]:
    """Those that this Python and platform need; an extra's own, not those of extras that it names."""
    return tuple(
        each
        for each in asked
        if each.name != "mjhcmc" and (each.marker is None or each.marker.evaluate({"extra": extra}))
    )


def _own(extras: Mapping[str, tuple[Requirement, ...]]) -> dict[str, tuple[Requirement, ...]]:
    """What each extra brings itself: in metadata, one that names others holds what those bring."""
    names = {extra: {each.name for each in brought} for extra, brought in extras.items()}
    found = {}
    for extra, brought in extras.items():
        others = set().union(*(other for other in names.values() if other < names[extra]))
        found[extra] = tuple(each for each in brought if each.name not in others)
    return found


def look_up(asked: Requirement, remedy: str | None = None) -> Package:
    """A package as its metadata tell.

    Args:
        asked: what is asked for.
        remedy: what to type where it is missing; by default its own name and versions.
    """
    # without the quotes a shell takes > for a redirection
    own = f'pip install "{asked.name}{_extras(asked)}{_bounds(asked)}"'
    needs = _bounds(asked)
    try:
        found = version(asked.name)
    except PackageNotFoundError:
        return Package(asked.name, needs, None, "missing", remedy or own)
    if not asked.specifier.contains(found, prereleases=True):
        return Package(asked.name, needs, found, f"{found} is not {needs}", own)
    absent = _absent_of_extras(asked)
    if absent:
        return Package(asked.name, needs, found, f"{found} without {', '.join(absent)}", remedy or own)
    return Package(asked.name, needs, found)


def _absent_of_extras(asked: Requirement) -> list[str]:
    """What extras of a package would have brought, imageio[ffmpeg] its encoder, and is not there."""
    from packaging.requirements import Requirement

    brought = [Requirement(line) for line in requires(asked.name) or []]
    by_extra = [each for each in brought if each.marker is not None and "extra" in str(each.marker)]
    names = dict.fromkeys(each.name for extra in sorted(asked.extras) for each in _applicable(by_extra, extra))
    return [name for name in names if not _is_there(name)]


def _is_there(name: str) -> bool:
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True


def _extras(asked: Requirement) -> str:
    return f"[{','.join(sorted(asked.extras))}]" if asked.extras else ""


def _bounds(asked: Requirement) -> str:
    """Lower before upper, as people write them."""
    return ",".join(sorted(map(str, asked.specifier), key=lambda bound: (not bound.startswith(">"), bound)))


def module_of(name: str) -> str:
    """What a package is imported by."""
    return _MODULES.get(name, name.replace("-", "_"))


def start_imports(modules: Sequence[str]) -> Child:
    """Import modules in a process of its own, one after another."""
    return Child(_IMPORT, modules, {"MUJOCO_GL": None})  # what is wrong with that is told apart


def import_problems(child: Child) -> dict[str, str]:
    """Why modules could not be imported, by module; one that takes the process with it is the last that began."""
    outcome = child.wait(_PATIENCE)
    why = {line["name"]: line["why"] for line in outcome.lines if "why" in line}
    begun = [line["name"] for line in outcome.lines if line.get("began")]
    if begun and begun[-1] not in why:
        why[begun[-1]] = outcome.why or "the import did not end"
    return {name: reason for name, reason in why.items() if reason}


def python_problem(asked: str) -> str | None:
    """Why this Python is not one that mjhcmc was made for; None where it is.

    Raises:
        ImportError: the package ``packaging`` is not there.
    """
    from packaging.specifiers import SpecifierSet

    own = ".".join(map(str, sys.version_info[:3]))
    return None if SpecifierSet(asked).contains(own) else f"Python {own} is not {asked}"

"""The house of docs/architecture.md: every module stands on a floor, imports point down, files stay small."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from mjhcmc import _HOME

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "mjhcmc"
PAGE = ROOT / "docs" / "architecture.md"
MOST_LINES = 450  # "about 400": beyond it a file has become two

MODULES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix("__init__").rstrip("."): path
    for path in sorted(PACKAGE.rglob("*.py"))
}
"""Name within the package: file; the package itself is ''."""


def block(kind: str) -> list[str]:
    """Lines of the page's text block of floors, of doors (``->``), or of those who look names up (import_module)."""
    every = re.findall(r"```text\n(.*?)```", PAGE.read_text(), re.S)
    kinds = {
        "->" if "->" in each else "import_module" if each.startswith("import_module") else "floors": each
        for each in every
    }
    assert len(kinds) == len(every) == 3, f"{PAGE.name}: one block of floors, one of doors, one of import_module"
    return kinds[kind].splitlines()


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@cache
def imports_of(path: Path) -> tuple[tuple[str, bool], ...]:
    return tuple(imported(parsed(path)))


def floors() -> dict[str, int]:
    """What the page says: module or package, and its floor, 0 for the ground."""
    return {name: at for at, line in enumerate(block("floors")) for name in line.split()[1:]}


def floor_of(module: str, of: dict[str, int]) -> int | None:
    """That of the module, or of the nearest package that holds it."""
    while module:
        if module in of:
            return of[module]
        module = module.rpartition(".")[0]
    return None


def imported(tree: ast.AST, *, later: bool = False) -> Iterator[tuple[str, bool]]:
    """Modules of mjhcmc that a file imports, and whether only when a function runs, but those for type checkers.

    A public name taken from the package (``from mjhcmc import hcmc``, ``mjhcmc.hcmc``) is one of its home.
    """
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            yield from imported(ast.Module(node.orelse, []), later=later)
            continue
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"a relative import: {ast.unparse(node)}"
            if (node.module or "").split(".")[0] == "mjhcmc":
                module = (node.module or "").partition(".")[2]
                for name in node.names:
                    inner = f"{module}.{name.name}".lstrip(".")
                    yield (inner if inner in MODULES else module or _HOME.get(name.name, "")), later
        elif isinstance(node, ast.Import):
            for name in node.names:
                if name.name.split(".")[0] == "mjhcmc":
                    yield name.name.partition(".")[2], later
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "mjhcmc":
            yield _HOME.get(node.attr, ""), later
        inside = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        yield from imported(node, later=later or inside)


def upward(*, later: bool) -> set[tuple[str, str]]:
    """Imports from a higher floor: (who, what)."""
    of = floors()
    found = set()
    for module, path in MODULES.items():
        here = floor_of(module, of)
        for target, when in imports_of(path):
            there = floor_of(target, of)
            if when == later and here is not None and there is not None and there > here:
                found.add((module, target))
    return found


def test_every_module_stands_on_a_floor_and_every_name_is_there() -> None:
    of = floors()
    homeless = [module for module in MODULES if module and floor_of(module, of) is None]
    assert not homeless, f"give {', '.join(homeless)} a floor in docs/architecture.md"
    gone = [name for name in of if name not in MODULES]
    assert not gone, f"docs/architecture.md names {', '.join(gone)}, which is not there any more"
    named = [name for line in block("floors") for name in line.split()[1:]]
    assert len(named) == len(set(named))


def test_imports_point_down_the_house() -> None:
    found = sorted(upward(later=False))
    assert not found, "; ".join(f"{who} imports {what} from a floor above" for who, what in found)


def test_doors_upward_are_those_of_the_page() -> None:
    """What is imported upward when a function runs: methods of data that read, write, solve or judge."""
    doors = {
        (who, what)
        for line in block("->")
        for who, _, targets in [line.partition("->")]
        for what in targets.split()
        for who in [who.strip()]
    }
    found = upward(later=True)
    assert found - doors == set(), "a door that docs/architecture.md does not list"
    assert doors - found == set(), "a door of docs/architecture.md that is not there any more"


def test_the_package_itself_imports_nothing_when_loaded() -> None:
    assert not [target for target, later in imported(ast.parse(MODULES[""].read_text())) if not later]


@pytest.mark.parametrize("folder", ["hill", "exact"])
def test_islands_import_only_errors_of_the_house(folder: str) -> None:
    """`hill` is NumPy alone; `exact` reads models and tells errors."""
    may = {"hill": ("hill",), "exact": ("exact", "errors", "model")}[folder]
    for module, path in MODULES.items():
        if module.split(".")[0] == folder:
            for target, _ in imports_of(path):
                assert target.split(".")[0] in may, f"{module} imports {target}"


def test_hill_needs_numpy_alone() -> None:
    for path in sorted((PACKAGE / "hill").rglob("*.py")):
        for node in ast.walk(parsed(path)):
            names = [name.name for name in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                top = name.split(".")[0]
                assert top in {"numpy", "mjhcmc"} | sys.stdlib_module_names, f"{path.name} imports {name}"


def test_names_are_looked_up_where_that_is_a_modules_work() -> None:
    """An import by a name that is put together escapes the tests above: few may."""
    may = set(block("import_module")[0].split()[1:])
    found = {
        module or "mjhcmc" for module, path in MODULES.items()
        if any(
            isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in {"import_module", "__import__"}
            for node in ast.walk(parsed(path))
        )
    }  # fmt: skip
    assert found == may


def test_nothing_imports_in_a_circle_while_it_is_loaded() -> None:
    needs = {
        module: {name for name, later in imports_of(path) if not later and name in MODULES}
        for module, path in MODULES.items()
    }
    TopologicalSorter({module: found - {"", module} for module, found in needs.items()}).prepare()


def test_files_stay_small() -> None:
    files = [path for kind in ("*.py", "*.js", "*.css", "*.html") for path in PACKAGE.rglob(kind)]
    large = {path.name: n for path in files if (n := len(path.read_text().splitlines())) > MOST_LINES}
    assert not large, f"more than {MOST_LINES} lines: {large}"


def test_the_check_sees_an_import_that_points_up() -> None:
    """The parser tells what runs when loaded from what runs later, and what type checkers alone read."""
    text = """
from typing import TYPE_CHECKING
from mjhcmc.methods import hcmc
import mjhcmc.plotting.panels
if TYPE_CHECKING:
    from mjhcmc.solution import Solution
else:
    from mjhcmc import motion
class Thing:
    def method(self):
        from mjhcmc import Solution
        return mjhcmc.check(1)
"""
    found = set(imported(ast.parse(text)))
    assert found == {
        ("methods.hcmc", False), ("plotting.panels", False), ("motion", False), ("solution", True),
        ("model_check.check", True),
    }  # fmt: skip
    with pytest.raises(AssertionError, match="relative"):
        list(imported(ast.parse("from .report import page")))

"""The examination: everything started at once, gathered, and told as text or JSON."""

from __future__ import annotations

import os
import platform
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from mjhcmc.cli_support import NO_CACHE
from mjhcmc.doctor import packages, pictures, small_solve
from mjhcmc.doctor.packages import DEVELOPERS, Package
from mjhcmc.doctor.pictures import Pictures
from mjhcmc.doctor.small_solve import SmallSolve

if TYPE_CHECKING:
    from mjhcmc.doctor.children import Child

_THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Examination:
    """What was found.

    Attributes:
        facts: versions of mjhcmc and Python, platform, cores, variables that set numbers of threads.
        problems: what keeps mjhcmc from working, a line each with its remedy.
        needed: packages that mjhcmc cannot do without.
        parts: by extra, what it brings itself; those for work on mjhcmc only where most of their packages are there.
        solve: the small solve.
        cache_problem: what is wrong with NUMBA_CACHE_DIR, or None.
        pictures: what can be drawn.
    """

    facts: dict[str, Any]
    problems: tuple[str, ...]
    needed: tuple[Package, ...]
    parts: dict[str, tuple[Package, ...]]
    solve: SmallSolve
    cache_problem: str | None
    pictures: Pictures

    @property
    def passed(self) -> bool:
        """Whether nothing that is needed is broken."""
        return not self.problems

    def to_dict(self) -> dict[str, Any]:
        """Plain values, as ``mjhcmc doctor --json`` prints them."""
        return {
            "passed": self.passed,
            "problems": list(self.problems),
            **self.facts,
            "needed": [asdict(each) for each in self.needed],
            "parts": {
                name: {"installed": all(each.problem is None for each in found), "packages": [asdict(p) for p in found]}
                for name, found in self.parts.items()
            },
            "solve": asdict(self.solve),
            "cache_problem": self.cache_problem,
            "pictures": {**asdict(self.pictures), "use": self.pictures.use, "remedy": self.pictures.remedy},
        }


def examine(*, thorough: bool = False) -> Examination:
    """Look at everything; takes some seconds.

    Args:
        thorough: also import the optional parts, and time the small solve with an empty cache (half a minute).
    """
    with ExitStack() as held:
        solving = small_solve.start()
        cold = small_solve.start(cold=True, held=held) if thorough else None
        drawing, asking = pictures.start(), pictures.start_asked()
        children: list[Child] = [solving, *drawing.values(), *(each for each in (cold, asking) if each)]
        for child in children:
            held.callback(child.end)  # an interrupt shall leave none behind
        problems, needed, parts = _packages(thorough)
        drawn = pictures.gather(drawing)
        refused = pictures.asked_problem(asking, drawn.use)
        if refused and not any(each.name == "mujoco" and each.problem for each in needed):  # it is not MuJoCo itself
            problems.append(refused)
        solve = small_solve.gather(solving, cold)
    if solve.problem and NO_CACHE in solve.problem:
        problems.append(
            f"compiled code can be kept nowhere ({solve.problem}): set NUMBA_CACHE_DIR to a folder that you may write "
            "to"
        )
    elif solve.problem:
        remedy = "mend the lines above, or tell the developers" if problems else "tell the developers, with these lines"
        problems.append(f"a small solve fails: {solve.problem}: {remedy}")
    asked, why = small_solve.cache_asked()
    cache_problem = None
    if why is not None:
        at = f", code is kept in {solve.cache}" if solve.cache else ""
        cache_problem = (
            f"NUMBA_CACHE_DIR={asked} cannot be written ({why}){at}: set it to a folder that you may write to, or "
            "unset it"
        )
    return Examination(_facts(), tuple(problems), needed, parts, solve, cache_problem, drawn)


def _packages(thorough: bool) -> tuple[list[str], tuple[Package, ...], dict[str, tuple[Package, ...]]]:
    """Problems, packages that are needed, and those of optional parts."""
    try:
        asked = packages.read_requirements()
        python = None if asked is None or not asked.python else packages.python_problem(asked.python)
    except ImportError:
        return ['packaging: missing: pip install "packaging"'], (), {}
    if asked is None:
        return ["mjhcmc: not installed, and no checkout: what it needs is not known: pip install mjhcmc"], (), {}
    problems = [f"{python}: install another Python"] if python else []
    needed = [packages.look_up(each) for each in asked.core]
    parts = {}
    for name, brought in asked.extras.items():
        found = tuple(packages.look_up(each, f'pip install "mjhcmc[{name}]"') for each in brought)
        there = sum(each.version is not None for each in found)
        if not found or (name in DEVELOPERS and 2 * there <= len(found)):
            continue  # a sum of others, or for those who work on mjhcmc: not for whoever has one of its packages
        parts[name] = found
    optional = [p.name for found in parts.values() for p in found if p.version] if thorough else []
    modules = [packages.module_of(each.name) for each in needed if each.version]
    modules += [packages.module_of(name) for name in dict.fromkeys(optional)]
    why = packages.import_problems(packages.start_imports(modules))
    needed = [_unusable(each, why) for each in needed]
    parts = {name: tuple(_unusable(each, why) for each in found) for name, found in parts.items()}
    problems += [f"{each.name}: {each.problem}: {each.remedy}" for each in needed if each.problem]
    return problems, tuple(needed), parts


def _unusable(package: Package, why: dict[str, str]) -> Package:
    """The package, with what kept it from being imported."""
    reason = why.get(packages.module_of(package.name))
    if reason is None or package.problem is not None:
        return package
    remedy = f'pip install --force-reinstall "{package.name}{package.needs}"'
    return Package(package.name, package.needs, package.version, f"cannot be imported ({reason})", remedy)


def _facts() -> dict[str, Any]:
    from mjhcmc import __version__

    may_use = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "mjhcmc": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cores": may_use,
        "threads": {name: os.environ[name] for name in _THREADS if name in os.environ},
    }

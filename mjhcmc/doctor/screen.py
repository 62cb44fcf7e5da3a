"""An examination as text: what is there, and under it what to do, one line each."""

from __future__ import annotations

from mjhcmc.doctor.examine import Examination
from mjhcmc.doctor.packages import Package


def screen(found: Examination) -> str:
    """The examination as a person reads it."""
    facts = found.facts
    threads = "".join(f", {name}={value}" for name, value in facts["threads"].items())
    lines = [
        f"mjhcmc {facts['mjhcmc']}, Python {facts['python']}, {facts['platform']}, {facts['cores']} cores{threads}",
        "",
        "needed",
        *_needed(found.needed),
        "",
        "optional parts",
        *_parts(found),
        "",
        *_solve(found),
        "",
        *_pictures(found),
        "",
    ]
    if found.passed:
        return "\n".join([*lines, "nothing that is needed is broken"])
    return "\n".join([*lines, "BROKEN", *[f"  {problem}" for problem in found.problems]])


def _needed(packages: tuple[Package, ...]) -> list[str]:
    wide = max((len(each.name) for each in packages), default=0)
    return [
        f"  {each.name.ljust(wide)}  {(each.version or '-').ljust(9)} "
        + (each.needs if each.problem is None else f"{each.needs}  {each.problem}: {each.remedy}")
        for each in packages
    ] or ["  not known"]


def _parts(found: Examination) -> list[str]:
    wide = max(map(len, found.parts), default=0)
    lines = []
    for name, packages in found.parts.items():
        wrong = [each for each in packages if each.problem is not None]
        if not wrong:
            words = ", ".join(f"{each.name} {each.version}" for each in packages)
        else:
            words = ", ".join(f"{each.name} {each.problem}" for each in wrong)
            words += f": {wrong[0].remedy if len(wrong) == 1 else _install(name)}"
        lines.append(f"  {name.ljust(wide)}  {words}")
    return lines or ["  not known"]


def _install(extra: str) -> str:
    return f'pip install "mjhcmc[{extra}]"'


def _solve(found: Examination) -> list[str]:
    solve = found.solve
    if solve.problem or solve.error_deg is None or solve.solve_seconds is None:
        lines = [f"a small solve  FAILS: {solve.problem}"]
    else:
        lines = [
            f"a small solve  tracks to {solve.error_deg:.2g} deg, as it should; {solve.solve_seconds:.2g} s, "
            f"{solve.seconds:.2g} s with the start of Python"
        ]
        if solve.compiled:
            lines.append(f"  compiled code  {solve.compiled} functions were compiled now, the next time is faster")
        else:
            lines.append("  compiled code  warm: nothing had to be compiled")
        if solve.cache:
            lines.append(f"  kept in        {solve.cache}")
        if solve.cold_seconds is not None:
            lines.append(f"  from nothing   {solve.cold_seconds:.2g} s, as on a new machine")
    return [*lines, *([f"  {found.cache_problem}"] if found.cache_problem else [])]


def _pictures(found: Examination) -> list[str]:
    drawn = found.pictures
    asked = f"MUJOCO_GL={drawn.asked}" if drawn.asked else "MUJOCO_GL is not set"
    lines = [f"pictures         {asked}; screen: {drawn.screen or 'none, so no windows (mjhcmc view)'}"]
    for each in drawn.back_ends:
        lines.append(f"  {each.name.ljust(13)}  " + ("works" if each.works else f"{each.why}: needs {each.needs}"))
    return [*lines, *([f"  {drawn.remedy}"] if drawn.remedy else [])]

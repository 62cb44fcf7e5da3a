"""What a solution that was read from a file gets back from the model that was driven."""

from __future__ import annotations

from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mjhcmc.errors import OutputError
from mjhcmc.roles import Role, Roles

if TYPE_CHECKING:
    from mjhcmc.hosted.muscles import HostedMuscles
    from mjhcmc.model import MuscleModel
    from mjhcmc.solution import Solution


def with_model(solution: Solution, model: MuscleModel, path: Path) -> Solution:
    """A solution that knows its model, whose degrees of freedom have the roles that they had.

    Args:
        solution: without a model.
        model: the one that was driven.
        path: of the solution's file, for messages.

    Raises:
        OutputError: names or equality constraints are not the model's.
    """
    for what, found, expected in (
        ("muscle", solution.muscle_names, model.muscle_names),
        ("joint", solution.dof_names, model.dof_names),
        ("coordinate", solution.coordinate_names, model.joint_names),
    ):
        for i, (own, other) in enumerate(zip_longest(found, expected)):
            if own != other:
                raise OutputError(
                    f"{path}: {what} {i + 1} is {_quoted(own)} in the file and {_quoted(other)} in model "
                    f"{model.name!r}: give the model that was driven ({solution.settings.get('model', 'not recorded')})"
                )
    roles = _roles(solution, model, path)
    return replace(
        solution,
        model=model if roles.of == model.roles.of else replace(model, roles=roles),
        settings=solution.settings | _settings(roles, model),
        dof_is_rotation=model.dof_is_rotation,
        muscles=_muscles(solution, model),
    )


def _roles(solution: Solution, model: MuscleModel, path: Path) -> Roles:
    """Those of the file, where it holds them; else the model's, but for what the table itself tells (a .csv)."""
    own, known = model.roles, "model" in solution.settings
    of = []
    for name, told, usual in zip(model.dof_names, map(Role, solution.roles), own.of, strict=True):
        if not known:
            of.append(usual if told == Role.TRACKED and usual in (Role.DEPENDENT, Role.FREE) else told)
            continue
        if (told == Role.DEPENDENT) != (usual == Role.DEPENDENT):
            raise OutputError(
                f"{path}: {name!r} is {told} in the file and {usual} in model {model.name!r}: their equality "
                "constraints differ: give the model that was driven"
            )
        of.append(told)
    return Roles(tuple(of), solution.is_root if known else own.is_root)


def _settings(roles: Roles, model: MuscleModel) -> dict[str, Any]:
    """The settings that tell roles."""
    found: dict[str, Any] = {} if roles.all_tracked else {"roles": [str(role) for role in roles.of]}
    if roles.is_root.any():
        found["root"] = [model.dof_names[i] for i in np.flatnonzero(roles.is_root)]
    return found


def _muscles(solution: Solution, model: MuscleModel) -> HostedMuscles | None:
    """The Hill muscles that drove a solution, where its settings name them."""
    named = solution.settings.get("muscles")
    if not isinstance(named, dict) or not named.get("named"):
        return None
    from mjhcmc.hosted.muscles import hosted_muscles

    return hosted_muscles(model, named["curves"], named["tendon"])


def _quoted(name: str | None) -> str:
    return "missing" if name is None else repr(name)

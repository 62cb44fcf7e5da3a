"""Model and run: what was driven, with which settings, by which versions, from which files."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

import numpy as np

from mjhcmc.plotting.panels import readable
from mjhcmc.report.markup import Html, element, joined, paragraphs, section, table
from mjhcmc.report.units import short
from mjhcmc.roles import Role
from mjhcmc.solution import Solution

_ELSEWHERE = ("command", "notices")  # of run.json, what the page shows at another place


def facts_section(solution: Solution, run: Mapping[str, Any], why_no_model: str | None) -> Html:
    """The page's last section."""
    return section(
        "facts", "Model and run",
        paragraphs(_model_words(solution), why_no_model),
        _command(run.get("command")),
        element("details", element("summary", "Joints and their roles"), _joints(solution), class_="fold", open=True),
        element("details", element("summary", "Muscles"), _muscles(solution), class_="fold"),
        element(
            "details", element("summary", "Settings"), _pairs(solution.settings, "Settings"), class_="fold", open=True
        ),
        element(
            "details", element("summary", "Run: versions, files, hashes"),
            _pairs({k: v for k, v in run.items() if k not in _ELSEWHERE}, "Run")
            if run
            else paragraphs("Nothing is known of the run: there is no run.json beside the solution."),
            class_="fold", open=True,
        ),
    )  # fmt: skip


def _model_words(solution: Solution) -> str:
    name = solution.settings.get("model", "not named")
    hosted = "Hill muscles (mjhcmc's)" if solution.hosted else "the model's own muscles"
    text = (
        f"Model {name}: {len(solution.muscle_names)} muscles, {len(solution.dof_names)} degrees of freedom, driven by "
        f"{hosted}."
    )
    if solution.model is not None:
        m = solution.model.mj_model
        text += f" {m.nbody - 1} bodies, {short(float(m.body_mass.sum()))} kg in all, {m.ntendon} tendons."
    return text


def _command(words: object) -> Html:
    if not words:
        return Html("")
    if not isinstance(words, str | list):
        return Html("")  # a run.json that somebody wrote otherwise
    text = words if isinstance(words, str) else "mjhcmc " + shlex.join(str(word) for word in words)
    return element(
        "div", element("code", text, id="command"),
        element("button", "Copy command", type="button", class_="tool", data_copy="command"), class_="command",
    )  # fmt: skip


def _joints(solution: Solution) -> Html:
    rows = [
        (
            readable(name),
            "hinge (deg)" if solution.dof_is_rotation[j] else "slide (mm)",
            solution.roles[j] + (", root" if solution.is_root[j] else ""),
            Role(solution.roles[j]).meaning,
        )
        for j, name in enumerate(solution.dof_names)
    ]
    return table(("Joint", "Kind", "Role", "Meaning"), rows, "Joints and their roles", numeric=False)


def _muscles(solution: Solution) -> Html:
    head = ["Muscle", "Peak excitation", "Mean excitation", "Peak activation", "Peak force, N"]
    strength = None if solution.model is None or solution.hosted else solution.model.max_isometric_force
    if strength is not None:
        head.append("Max isometric force, N")
    rows = []
    for i, name in enumerate(solution.muscle_names):
        row = [
            readable(name), f"{solution.excitation[:, i].max():.3f}", f"{solution.excitation[:, i].mean():.3f}",
            f"{solution.activation[:, i].max():.3f}", short(float(np.nanmax(solution.muscle_force[:, i]))),
        ]  # fmt: skip
        rows.append([*row, short(float(strength[i]))] if strength is not None else row)
    return table(head, rows, "Muscles")


def _pairs(values: Mapping[str, Any], caption: str) -> Html:
    return table(("What", "Value"), [(key, _value(value)) for key, value in values.items()], caption, numeric=False)


def _value(value: Any) -> object:
    """A setting as a person reads it; what it is made of below each other."""
    if isinstance(value, Mapping):
        parts = [element("div", element("span", f"{key}: ", class_="soft"), _value(v)) for key, v in value.items()]
        return joined(parts, "") if parts else "none"
    if isinstance(value, list | tuple):
        if all(not isinstance(v, Mapping | list | tuple) for v in value):
            return ", ".join(str(v) for v in value) or "none"
        return joined((element("div", _value(v), class_="entry") for v in value), "")
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)

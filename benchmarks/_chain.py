"""A chain of hinges under many muscles, to see how time grows with both."""

from __future__ import annotations

from itertools import combinations

import numpy as np

import mjhcmc

_REACH = 3  # joints that a muscle crosses at most
_STRENGTH = 4000.0  # N for each joint, shared among all muscles: enough for `swing`
_SIDES = (("front", 0.04), ("back", -0.04))


def chain(n_joint: int, n_muscle: int) -> mjhcmc.MuscleModel:
    """A hanging chain with muscles in front and behind in turn, each over one, two or three joints."""
    import mujoco

    body = ""
    for joint in reversed(range(n_joint)):
        body = (
            f'<body pos="0 0 {-0.2 if joint else 0}"><joint name="joint_{joint}" axis="0 -1 0" damping=".2"/>'
            '<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".03" mass="1" contype="0" conaffinity="0"/>'
            f"{_sites(joint + 1, -0.05)}{body}</body>"
        )
    spans = [(a, b) for a, b in combinations(range(n_joint + 1), 2) if b - a <= _REACH]
    spans.sort(key=lambda span: span[1] - span[0])
    force = _STRENGTH * n_joint / n_muscle
    tendons = actuators = ""
    for i in range(n_muscle):
        (a, b), (side, _) = spans[(i // 2) % len(spans)], _SIDES[i % 2]
        path = "".join(f'<site site="{side}{k}"/>' for k in range(a, b + 1))
        tendons += f'<spatial name="t{i}" damping="2">{path}</spatial>'
        actuators += (
            f'<muscle name="m{i}" tendon="t{i}" force="{force:g}" ctrlrange="0 1" '
            f'lengthrange="{0.1 * (b - a)} {0.3 * (b - a)}"/>'
        )
    return mjhcmc.MuscleModel.load(
        mujoco.MjModel.from_xml_string(
            f'<mujoco model="chain"><option integrator="RK4"/><worldbody>{_sites(0, 0.1)}{body}</worldbody>'
            f"<tendon>{tendons}</tendon><actuator>{actuators}</actuator></mujoco>"
        )
    )


def _sites(level: int, height: float) -> str:
    return "".join(f'<site name="{side}{level}" pos="{x} 0 {height}"/>' for side, x in _SIDES)


def swing(model: mjhcmc.MuscleModel, duration: float = 0.3) -> mjhcmc.Motion:
    """A small swing of every joint, each with a phase of its own."""
    time = np.linspace(0.0, duration, round(duration / 0.005) + 1)
    return mjhcmc.Motion(time, 0.1 * np.sin(6 * time[:, None] + np.arange(model.nq)), name="swing")

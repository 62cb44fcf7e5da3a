"""A chain of hinges that many muscles of long names pull on."""

from itertools import combinations

import numpy as np
from conftest import load_xml

import mjhcmc


def chain(n_joint: int, n_muscle: int, force: float = 60.0) -> mjhcmc.MuscleModel:
    """Muscles in front of and behind the chain, each over one, two or three joints."""
    sites = "".join(f'<site name="{side}{{0}}" pos="{x} 0 {{1}}"/>' for side, x in (("front", 0.04), ("back", -0.04)))
    body = ""
    for j in reversed(range(n_joint)):
        body = (
            f'<body pos="0 0 {-0.2 if j else 0}"><joint name="joint_{j}" axis="0 -1 0" damping=".2"/>'
            f'<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".03" mass="1" contype="0" conaffinity="0"/>'
            f"{sites.format(j + 1, -0.05)}{body}</body>"
        )
    spans = sorted((p for p in combinations(range(n_joint + 1), 2) if p[1] - p[0] <= 3), key=lambda p: p[1] - p[0])
    tendons = actuators = ""
    for i in range(n_muscle):
        (a, b), side = spans[(i // 2) % len(spans)], ("front", "back")[i % 2]
        path = "".join(f'<site site="{side}{k}"/>' for k in range(a, b + 1))
        tendons += f'<spatial name="t{i}" damping="2">{path}</spatial>'
        actuators += (
            f'<muscle name="{side}_muscle_from_{a}_to_{b}_number_{i}" tendon="t{i}" force="{force}" ctrlrange="0 1" '
            f'lengthrange="{0.1 * (b - a)} {0.3 * (b - a)}"/>'
        )
    return load_xml(
        f'<mujoco model="chain"><option integrator="RK4"/><worldbody>{sites.format(0, 0.1)}{body}</worldbody>'
        f"<tendon>{tendons}</tendon><actuator>{actuators}</actuator></mujoco>"
    )


def swing(model: mjhcmc.MuscleModel, windows: int = 10) -> mjhcmc.Solution:
    """A small swing of every joint."""
    time = 0.01 * np.arange(windows + 1)
    phase = np.arange(model.nq)
    return mjhcmc.hcmc(model, mjhcmc.Motion(time, 0.1 * np.sin(12 * time[:, None] + phase), name="swing"))
